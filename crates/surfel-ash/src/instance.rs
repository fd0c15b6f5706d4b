//! Vulkan instance, its validation messages, and the physical devices that it finds.

use crate::error::Failure;
use ash::{ext, vk};
use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex, PoisonError};

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Messages of Vulkan's validation layers, in the order in which they arrived.
pub(crate) type Messages = Mutex<Vec<String>>;

/// Vulkan instance, and the messenger through which validation layers report messages.
pub(crate) struct Instance {
    pub raw: ash::Instance,
    /// True if debug utilities are enabled, so that objects can have names.
    pub has_names: bool,
    /// Messages of the validation layers that [`Instance::take_messages`] hasn't returned yet.
    messages: Arc<Messages>,
    /// Functions of the extension for debug utilities, and the messenger; `None` without validation.
    messenger: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    /// True if this value created the instance, and therefore destroys it.
    is_own: bool,
    /// Vulkan loader, which contains the functions that the other fields use.
    _entry: ash::Entry,
}

impl Instance {
    /// Loads Vulkan and creates an instance, with validation layers if `validation` is true.
    pub(crate) fn new(validation: bool) -> Result<Self, Failure> {
        // SAFETY: the loader is the system's; it has to be trusted like any other linked library.
        let entry = unsafe { ash::Entry::load() };
        let entry = entry.map_err(|error| {
            Failure::Other(format!("no Vulkan loader ({error}); install libvulkan1, or a graphics driver"))
        })?;
        // SAFETY: no requirement beyond a loaded entry.
        let version = unsafe { entry.try_enumerate_instance_version() }?.unwrap_or(vk::API_VERSION_1_0);
        if version < vk::API_VERSION_1_1 {
            return Err(Failure::other(
                "the Vulkan loader is of version 1.0, expected 1.1; update the graphics driver",
            ));
        }
        let application = vk::ApplicationInfo::default()
            .application_name(c"surfel")
            .engine_name(c"surfel")
            .api_version(vk::API_VERSION_1_1.max(version.min(vk::API_VERSION_1_2)));
        let (mut layers, mut extensions) = (Vec::new(), Vec::new());
        if validation {
            check_layer(&entry)?;
            layers.push(VALIDATION_LAYER.as_ptr());
            extensions.push(ext::debug_utils::NAME.as_ptr());
            extensions.push(ext::validation_features::NAME.as_ptr());
        }
        // Synchronisation validation finds missing barriers. Without a barrier, software drivers still draw correctly,
        // and other drivers fail only sometimes.
        let hazards = [vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION];
        let mut checks = vk::ValidationFeaturesEXT::default().enabled_validation_features(&hazards);
        let info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&extensions);
        let info = if validation { info.push_next(&mut checks) } else { info };
        // SAFETY: everything that `info` points to lives until the end of this function.
        let raw = unsafe { entry.create_instance(&info, None) }?;
        let messages = Arc::new(Messages::default());
        let mut instance = Self { raw, has_names: validation, messages, messenger: None, is_own: true, _entry: entry };
        if validation {
            instance.create_messenger()?;
        }
        Ok(instance)
    }

    /// Wraps a program's existing instance. The program remains its owner.
    pub(crate) fn borrowed(entry: ash::Entry, raw: ash::Instance) -> Self {
        let messages = Arc::new(Messages::default());
        Self { raw, has_names: false, messages, messenger: None, is_own: false, _entry: entry }
    }

    /// Creates the messenger, so that messages of the validation layers are stored in `messages`.
    fn create_messenger(&mut self) -> Result<(), Failure> {
        let severity = vk::DebugUtilsMessageSeverityFlagsEXT::WARNING | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR;
        let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(severity)
            .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
            .pfn_user_callback(Some(on_message))
            .user_data(Arc::as_ptr(&self.messages).cast_mut().cast());
        let utilities = ext::debug_utils::Instance::new(&self._entry, &self.raw);
        // SAFETY: the extension is enabled. The user data outlives the messenger: `self` owns it, and destroys the
        // messenger first.
        let messenger = unsafe { utilities.create_debug_utils_messenger(&info, None) }?;
        self.messenger = Some((utilities, messenger));
        Ok(())
    }

    /// Removes and returns the messages of the validation layers.
    pub(crate) fn take_messages(&self) -> Vec<String> {
        std::mem::take(&mut self.messages.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Returns the physical devices that can draw and compute with Vulkan 1.1, the fastest kind first.
    pub(crate) fn candidates(&self) -> Result<Vec<Candidate>, Failure> {
        // SAFETY: the instance is alive.
        let devices = unsafe { self.raw.enumerate_physical_devices() }?;
        let mut candidates: Vec<Candidate> =
            devices.into_iter().filter_map(|physical| Candidate::of(&self.raw, physical)).collect();
        candidates.sort_by_key(|candidate| match candidate.properties.device_type {
            vk::PhysicalDeviceType::DISCRETE_GPU => 0,
            vk::PhysicalDeviceType::INTEGRATED_GPU => 1,
            vk::PhysicalDeviceType::VIRTUAL_GPU => 2,
            vk::PhysicalDeviceType::CPU => 4,
            _ => 3,
        });
        Ok(candidates)
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        if let Some((utilities, messenger)) = self.messenger.take() {
            // SAFETY: created from this instance, and destroyed once, by its only owner.
            unsafe { utilities.destroy_debug_utils_messenger(messenger, None) };
        }
        if self.is_own {
            // SAFETY: devices hold their instance, so none exists any more.
            unsafe { self.raw.destroy_instance(None) };
        }
    }
}

/// Returns an error if the validation layer isn't installed.
fn check_layer(entry: &ash::Entry) -> Result<(), Failure> {
    // SAFETY: no requirement beyond a loaded entry.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }?;
    let is_there = layers.iter().any(|layer| layer.layer_name_as_c_str() == Ok(VALIDATION_LAYER));
    if is_there {
        return Ok(());
    }
    Err(Failure::other("the Vulkan validation layer is not installed; install vulkan-validationlayers"))
}

/// Stores a message of the validation layers. Vulkan calls this function.
///
/// # Safety
/// `data` is valid during the call, as Vulkan guarantees, and `user` points to [`Messages`].
unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _types: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: Vulkan gives a valid pointer or null.
    let data = unsafe { data.as_ref() };
    // SAFETY: `user` is the messenger's user data, which outlives it.
    let messages = unsafe { user.cast::<Messages>().as_ref() };
    if let (Some(data), Some(messages)) = (data, messages) {
        // SAFETY: the message is a string that ends with zero, valid during the call.
        let text = unsafe { data.message_as_c_str() }.map(|text| text.to_string_lossy().into_owned());
        messages.lock().unwrap_or_else(PoisonError::into_inner).push(text.unwrap_or_default());
    }
    // The call that caused the message continues.
    vk::FALSE
}

/// Physical device that the backend can draw on.
pub(crate) struct Candidate {
    pub physical: vk::PhysicalDevice,
    pub properties: vk::PhysicalDeviceProperties,
    /// Queue family that can draw and compute.
    pub family: u32,
    /// Number of valid bits in the timestamps of the queue family; 0 without timestamps.
    pub timestamp_bits: u32,
    /// Name of the device.
    pub name: String,
    /// Version of Vulkan, and name and version of the driver.
    pub driver: String,
}

impl Candidate {
    /// Creates the candidate of a physical device; `None` for a device with Vulkan 1.0, or without a queue family that
    /// both draws and computes.
    fn of(instance: &ash::Instance, physical: vk::PhysicalDevice) -> Option<Self> {
        // SAFETY: the physical device is the instance's.
        let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
        let both = vk::QueueFlags::GRAPHICS | vk::QueueFlags::COMPUTE;
        let family = families.iter().position(|family| family.queue_flags.contains(both))?;
        let timestamp_bits = families.get(family)?.timestamp_valid_bits;
        Self::with_family(instance, physical, family as u32, timestamp_bits)
    }

    /// Creates a candidate for a program's own device and queue family; `None` for Vulkan 1.0.
    pub(crate) fn with_family(
        instance: &ash::Instance,
        physical: vk::PhysicalDevice,
        family: u32,
        timestamp_bits: u32,
    ) -> Option<Self> {
        // SAFETY: the physical device is the instance's.
        let properties = unsafe { instance.get_physical_device_properties(physical) };
        if properties.api_version < vk::API_VERSION_1_1 {
            return None;
        }
        let name = text(properties.device_name_as_c_str());
        let driver = driver(instance, physical, &properties);
        Some(Self { physical, properties, family, timestamp_bits, name, driver })
    }

    /// True if the device computes on the CPU.
    pub(crate) fn is_software(&self) -> bool {
        self.properties.device_type == vk::PhysicalDeviceType::CPU
    }
}

/// Returns the version of Vulkan, and the name and version of the driver, as text.
fn driver(instance: &ash::Instance, physical: vk::PhysicalDevice, properties: &vk::PhysicalDeviceProperties) -> String {
    let api = properties.api_version;
    let (major, minor) = (vk::api_version_major(api), vk::api_version_minor(api));
    if api < vk::API_VERSION_1_2 {
        return format!("Vulkan {major}.{minor}, driver {:#x}", properties.driver_version);
    }
    let mut driver = vk::PhysicalDeviceDriverProperties::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut driver);
    // SAFETY: the device is of Vulkan 1.2, which has driver properties; the chain lives through the call.
    unsafe { instance.get_physical_device_properties2(physical, &mut all) };
    let (name, info) = (text(driver.driver_name_as_c_str()), text(driver.driver_info_as_c_str()));
    format!("Vulkan {major}.{minor}, {name} {info}")
}

/// Returns a C string as text; empty if it is invalid.
fn text<E>(name: Result<&CStr, E>) -> String {
    name.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}
