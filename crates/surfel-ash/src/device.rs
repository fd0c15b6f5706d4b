//! Logical device, with its queue and memory allocator.

use crate::error::Failure;
use crate::instance::{Candidate, Instance};
use crate::recorder::Recorder;
use ash::{ext, vk};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use gpu_allocator::{AllocationSizes, AllocatorDebugSettings};
use std::ffi::CString;
use std::mem::ManuallyDrop;
use std::sync::{Arc, Mutex, PoisonError};

/// Logical device with its queue, allocator and capabilities. All objects created from it have a reference to it.
pub(crate) struct Device {
    pub raw: ash::Device,
    pub queue: vk::Queue,
    /// Index of the queue's family.
    pub family: u32,
    pub caps: DeviceCaps,
    pub instance: Arc<Instance>,
    /// Allocator of device memory. It is dropped before the device.
    pub allocator: ManuallyDrop<Mutex<Allocator>>,
    /// Recorder of the last submission, reused for the next one. `None` before the first submission and while one runs.
    pub recorder: Mutex<Option<Recorder>>,
    /// Functions that set names of objects; `None` without the extension for debug utilities.
    names: Option<ext::debug_utils::Device>,
    /// True if this value created the device, and therefore destroys it.
    is_own: bool,
}

/// Capabilities of a device that decide how the backend uses it.
#[derive(Clone, Debug)]
pub(crate) struct DeviceCaps {
    pub limits: vk::PhysicalDeviceLimits,
    /// Largest size of an allocation, in bytes.
    pub allocation_bytes: u64,
    /// Total size of all device-local heaps, in bytes.
    pub memory_bytes: u64,
    /// True if targets of f32 can be blended.
    pub blends_f32: bool,
    /// Duration of a timestamp tick, in nanoseconds; 0 if the queue has no timestamps.
    pub timestamp_period: f64,
    /// True if queries can exactly count the samples that pass the depth test.
    pub counts_samples: bool,
    /// True if queries can count shader invocations.
    pub counts_invocations: bool,
}

impl DeviceCaps {
    /// Queries the capabilities of a physical device whose features `enabled` the logical device enables.
    fn of(instance: &ash::Instance, candidate: &Candidate, enabled: &vk::PhysicalDeviceFeatures) -> Self {
        let physical = candidate.physical;
        let mut maintenance = vk::PhysicalDeviceMaintenance3Properties::default();
        let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut maintenance);
        // SAFETY: the device is of Vulkan 1.1, which has these properties; the chain lives through the call.
        unsafe { instance.get_physical_device_properties2(physical, &mut all) };
        // SAFETY: the physical device is the instance's.
        let memory = unsafe { instance.get_physical_device_memory_properties(physical) };
        let own = memory.memory_heaps_as_slice().iter();
        let own = own.filter(|heap| heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL));
        let blends = |format| {
            // SAFETY: the physical device is the instance's.
            let properties = unsafe { instance.get_physical_device_format_properties(physical, format) };
            properties.optimal_tiling_features.contains(vk::FormatFeatureFlags::COLOR_ATTACHMENT_BLEND)
        };
        let limits = candidate.properties.limits;
        Self {
            limits,
            allocation_bytes: maintenance.max_memory_allocation_size,
            memory_bytes: own.map(|heap| heap.size).sum(),
            blends_f32: blends(vk::Format::R32G32B32A32_SFLOAT) && blends(vk::Format::R32G32_SFLOAT),
            timestamp_period: if candidate.timestamp_bits > 0 { limits.timestamp_period.into() } else { 0.0 },
            counts_samples: enabled.occlusion_query_precise == vk::TRUE,
            counts_invocations: enabled.pipeline_statistics_query == vk::TRUE,
        }
    }

    /// Returns the largest side of an image that passes can draw into, in pixels.
    pub(crate) fn texture_side(&self) -> u32 {
        let limits = &self.limits;
        limits.max_image_dimension2_d.min(limits.max_framebuffer_width).min(limits.max_framebuffer_height)
    }

    /// Returns the largest size of a buffer that a shader can read, in bytes.
    pub(crate) fn buffer_bytes(&self) -> u64 {
        u64::from(self.limits.max_storage_buffer_range).min(self.allocation_bytes)
    }
}

impl Device {
    /// Opens a logical device with one queue, and enables the features for queries that it has.
    pub(crate) fn new(instance: Arc<Instance>, candidate: &Candidate) -> Result<Arc<Self>, Failure> {
        // SAFETY: the physical device is the instance's.
        let has = unsafe { instance.raw.get_physical_device_features(candidate.physical) };
        let enabled = vk::PhysicalDeviceFeatures {
            occlusion_query_precise: has.occlusion_query_precise,
            pipeline_statistics_query: has.pipeline_statistics_query,
            ..vk::PhysicalDeviceFeatures::default()
        };
        let priorities = [1.0];
        let queue =
            vk::DeviceQueueCreateInfo::default().queue_family_index(candidate.family).queue_priorities(&priorities);
        let queues = [queue];
        let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_features(&enabled);
        // SAFETY: the queue family is the device's, the features are among those that it has, and everything that
        // `info` points to lives through the call.
        let raw = unsafe { instance.raw.create_device(candidate.physical, &info, None) }?;
        // SAFETY: the device was made with one queue of this family.
        let queue = unsafe { raw.get_device_queue(candidate.family, 0) };
        Self::wrap(instance, candidate, raw, queue, &enabled, true)
    }

    /// Wraps a program's existing device, without assuming any optional feature. The program still owns the device.
    pub(crate) fn borrowed(
        instance: Arc<Instance>,
        candidate: &Candidate,
        raw: ash::Device,
        queue: vk::Queue,
    ) -> Result<Arc<Self>, Failure> {
        Self::wrap(instance, candidate, raw, queue, &vk::PhysicalDeviceFeatures::default(), false)
    }

    /// Wraps a logical device, and creates its memory allocator. If that fails and `is_own` is true, the logical device
    /// is destroyed; otherwise its owner keeps it.
    fn wrap(
        instance: Arc<Instance>,
        candidate: &Candidate,
        raw: ash::Device,
        queue: vk::Queue,
        enabled: &vk::PhysicalDeviceFeatures,
        is_own: bool,
    ) -> Result<Arc<Self>, Failure> {
        let caps = DeviceCaps::of(&instance.raw, candidate, enabled);
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: instance.raw.clone(),
            device: raw.clone(),
            physical_device: candidate.physical,
            debug_settings: AllocatorDebugSettings::default(),
            buffer_device_address: false,
            allocation_sizes: AllocationSizes::default(),
        });
        let allocator = match allocator {
            Ok(allocator) => ManuallyDrop::new(Mutex::new(allocator)),
            Err(error) => {
                if is_own {
                    // SAFETY: the caller created the device for this function, and no other object was created from it.
                    unsafe { raw.destroy_device(None) };
                }
                return Err(error.into());
            }
        };
        let names = instance.has_names.then(|| ext::debug_utils::Device::new(&instance.raw, &raw));
        Ok(Arc::new(Self {
            raw,
            queue,
            family: candidate.family,
            caps,
            instance,
            allocator,
            recorder: Mutex::default(),
            names,
            is_own,
        }))
    }

    /// Sets the name of an object for messages and debuggers, if the extension for debug utilities is enabled.
    pub(crate) fn name<H: vk::Handle>(&self, handle: H, name: &str) {
        let (Some(names), Ok(name)) = (&self.names, CString::new(name)) else { return };
        let info = vk::DebugUtilsObjectNameInfoEXT::default().object_handle(handle).object_name(&name);
        // SAFETY: the extension is enabled, and the object is alive and this device's. A name that isn't set is no
        // loss.
        let _ = unsafe { names.set_debug_utils_object_name(&info) };
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        let recorder = self.recorder.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(recorder) = recorder {
            recorder.destroy(&self.raw);
        }
        // SAFETY: dropped once, here; everything allocated from it holds the device, and so no longer exists.
        unsafe { ManuallyDrop::drop(&mut self.allocator) };
        if self.is_own {
            // SAFETY: every object created from the device holds it, and so no longer exists; every submission was
            // waited for.
            unsafe { self.raw.destroy_device(None) };
        }
    }
}
