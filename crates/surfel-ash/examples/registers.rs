//! Prints registers, memory and instructions of each compute entry point, as Vulkan's driver compiles it for its GPU.
//! `cargo xtask shader-stats` runs it with Mesa's compiler for AMD's GPUs, which needs no such GPU.
//!
//! The numbers come from `VK_KHR_pipeline_executable_properties`, whose names of statistics are the driver's own. A
//! statistic that the driver doesn't report is an empty cell.

use ash::{khr, vk};
use std::error::Error;
use std::ffi::CString;
use surfel_shaders::{BindingKind, ENTRIES, Entry, SPIRV, Stage};

/// Statistics that Mesa's driver for AMD reports, and their columns in the table.
const COLUMNS: [(&str, &str); 6] = [
    ("VGPRs", "vector registers"),
    ("Spilled VGPRs", "spilled"),
    ("LDS size", "workgroup bytes"),
    ("Subgroups per SIMD", "waves per SIMD"),
    ("Instructions", "instructions"),
    ("Code size", "code bytes"),
];

fn main() -> Result<(), Box<dyn Error>> {
    // SAFETY: the loader is the system's; it has to be trusted like any other linked library.
    let entry = unsafe { ash::Entry::load() }?;
    let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_1);
    let info = vk::InstanceCreateInfo::default().application_info(&application);
    // SAFETY: the pointers of `info` outlive the call.
    let instance = unsafe { entry.create_instance(&info, None) }?;
    let printed = Compiler::new(&instance).and_then(|compiler| compiler.print_table());
    // SAFETY: every object made with the instance has been destroyed.
    unsafe { instance.destroy_instance(None) };
    printed
}

/// Device that compiles entry points and reports statistics of the result.
struct Compiler {
    /// The driver's name of the GPU for which it compiles.
    name: String,
    device: ash::Device,
    reports: khr::pipeline_executable_properties::Device,
}

impl Compiler {
    /// Opens the first device that reports statistics of pipelines.
    fn new(instance: &ash::Instance) -> Result<Self, Box<dyn Error>> {
        // SAFETY: the instance is alive.
        let devices = unsafe { instance.enumerate_physical_devices() }?;
        for physical in devices {
            // SAFETY: the device is the instance's.
            let extensions = unsafe { instance.enumerate_device_extension_properties(physical) }?;
            let wanted = khr::pipeline_executable_properties::NAME;
            if !extensions.iter().any(|one| one.extension_name_as_c_str().is_ok_and(|name| name == wanted)) {
                continue;
            }
            // SAFETY: the device is the instance's.
            let properties = unsafe { instance.get_physical_device_properties(physical) };
            let name = properties.device_name_as_c_str()?.to_string_lossy().into_owned();
            let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
            let mut feature =
                vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default().pipeline_executable_info(true);
            let names = [wanted.as_ptr()];
            let info = vk::DeviceCreateInfo::default()
                .queue_create_infos(&queues)
                .enabled_extension_names(&names)
                .push_next(&mut feature);
            // SAFETY: the extension exists, and every Vulkan device has a queue family 0.
            let device = unsafe { instance.create_device(physical, &info, None) }?;
            let reports = khr::pipeline_executable_properties::Device::new(instance, &device);
            return Ok(Self { name, device, reports });
        }
        Err("no device of the Vulkan driver reports statistics of pipelines".into())
    }

    /// Prints a row for each compute entry point.
    fn print_table(&self) -> Result<(), Box<dyn Error>> {
        println!("Compute entry points as compiled for {}.\n", self.name);
        let titles = COLUMNS.map(|(_, title)| title);
        println!("| entry point | {} |", titles.join(" | "));
        println!("| --- |{}", " --- |".repeat(titles.len()));
        for entry in ENTRIES.iter().filter(|entry| entry.stage == Stage::Compute) {
            let found = self.statistics(entry)?;
            let cell = |name: &str| found.iter().find(|one| one.0 == name).map_or(String::new(), |one| one.1.clone());
            println!("| `{}` | {} |", entry.name, COLUMNS.map(|(name, _)| cell(name)).join(" | "));
        }
        Ok(())
    }

    /// Compiles an entry point, and returns names and values of the driver's statistics.
    fn statistics(&self, entry: &Entry) -> Result<Vec<(String, String)>, Box<dyn Error>> {
        let words = SPIRV.iter().find(|(name, _)| *name == entry.name).ok_or("the entry point has no SPIR-V")?.1;
        let info = vk::ShaderModuleCreateInfo::default().code(words);
        // SAFETY: the build of surfel-shaders has validated the SPIR-V.
        let module = unsafe { self.device.create_shader_module(&info, None) }?;
        let mut sets = Vec::new();
        for group in 0..entry.bindings.iter().map(|binding| binding.group + 1).max().unwrap_or(0) {
            sets.push(self.set_layout(entry, group)?);
        }
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets);
        // SAFETY: the layouts of the sets are this device's.
        let layout = unsafe { self.device.create_pipeline_layout(&info, None) }?;
        let name = CString::new(entry.name)?;
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(&name);
        let flags = vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR;
        let info = vk::ComputePipelineCreateInfo::default().flags(flags).stage(stage).layout(layout);
        // SAFETY: the layout has all bindings of the entry point.
        let made = unsafe { self.device.create_compute_pipelines(vk::PipelineCache::null(), &[info], None) };
        let pipeline = *made.map_err(|(_, error)| error)?.first().ok_or("the driver made no pipeline")?;
        let info = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline).executable_index(0);
        // SAFETY: the pipeline captures statistics, and has one executable at least.
        let found = unsafe { self.reports.get_pipeline_executable_statistics(&info) }?;
        let mut named = Vec::new();
        for one in &found {
            named.push((one.name_as_c_str()?.to_string_lossy().into_owned(), value_of(one)));
        }
        // SAFETY: nothing uses the pipeline.
        unsafe { self.device.destroy_pipeline(pipeline, None) };
        // SAFETY: the pipeline is destroyed.
        unsafe { self.device.destroy_pipeline_layout(layout, None) };
        for set in sets {
            // SAFETY: the pipeline's layout is destroyed.
            unsafe { self.device.destroy_descriptor_set_layout(set, None) };
        }
        // SAFETY: the pipeline is destroyed.
        unsafe { self.device.destroy_shader_module(module, None) };
        Ok(named)
    }

    /// Creates the layout of an entry point's bindings in one group.
    fn set_layout(&self, entry: &Entry, group: u32) -> Result<vk::DescriptorSetLayout, vk::Result> {
        let bindings: Vec<_> = entry
            .bindings
            .iter()
            .filter(|binding| binding.group == group)
            .map(|binding| {
                let kind = match binding.kind {
                    BindingKind::Uniform => vk::DescriptorType::UNIFORM_BUFFER,
                    BindingKind::StorageRead | BindingKind::StorageWrite => vk::DescriptorType::STORAGE_BUFFER,
                    BindingKind::Texture | BindingKind::DepthTexture => vk::DescriptorType::SAMPLED_IMAGE,
                };
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding.binding)
                    .descriptor_type(kind)
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: binding numbers are distinct, as reflected.
        unsafe { self.device.create_descriptor_set_layout(&info, None) }
    }
}

impl Drop for Compiler {
    fn drop(&mut self) {
        // SAFETY: every object made with the device has been destroyed, unless an error ends the program.
        unsafe { self.device.destroy_device(None) };
    }
}

/// Returns the value of a statistic as text.
fn value_of(one: &vk::PipelineExecutableStatisticKHR<'_>) -> String {
    use vk::PipelineExecutableStatisticFormatKHR as Format;
    match one.format {
        // SAFETY: the format states that this field of the union is set.
        Format::BOOL32 => unsafe { one.value.b32 }.to_string(),
        // SAFETY: as above.
        Format::INT64 => unsafe { one.value.i64 }.to_string(),
        // SAFETY: as above.
        Format::UINT64 => unsafe { one.value.u64 }.to_string(),
        // SAFETY: as above; the fourth format is the last.
        _ => unsafe { one.value.f64 }.to_string(),
    }
}
