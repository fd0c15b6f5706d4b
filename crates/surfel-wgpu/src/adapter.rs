//! Lists the adapters (GPUs, or software in place of one) of this machine, and opens the device of one of them.

use crate::error::failed;
use crate::options::Options;
use crate::{CAPABILITIES, NAME};
use surfel_render::{RenderError, RendererInfo};

/// Description of an adapter that wgpu found: a GPU, or software in place of one, through one graphics API.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterSummary {
    /// Name reported by the driver.
    pub name: String,
    /// Graphics API through which wgpu uses the adapter.
    pub api: String,
    /// Name and version of the driver; empty if the graphics API doesn't report them.
    pub driver: String,
    /// True if the adapter computes on the CPU.
    pub is_software: bool,
    /// Limits and features by wgpu's names, with their values as text.
    pub facts: Vec<(&'static str, String)>,
}

/// Returns the adapters that wgpu finds. Hardware comes before software.
pub fn adapters() -> Vec<AdapterSummary> {
    // Without any graphics API, wgpu panics instead of returning an instance.
    if wgpu::Instance::enabled_backend_features().is_empty() {
        return Vec::new();
    }
    found(&instance(false)).iter().map(summary).collect()
}

/// Returns the description of an adapter.
fn summary(adapter: &wgpu::Adapter) -> AdapterSummary {
    let (info, limits) = (adapter.get_info(), adapter.limits());
    let facts = vec![
        ("device_type", format!("{:?}", info.device_type)),
        ("max_texture_dimension_2d", limits.max_texture_dimension_2d.to_string()),
        ("max_buffer_size", limits.max_buffer_size.to_string()),
        ("max_storage_buffer_binding_size", limits.max_storage_buffer_binding_size.to_string()),
        ("max_storage_buffers_per_shader_stage", limits.max_storage_buffers_per_shader_stage.to_string()),
        ("max_color_attachment_bytes_per_sample", limits.max_color_attachment_bytes_per_sample.to_string()),
        ("max_compute_workgroup_storage_size", limits.max_compute_workgroup_storage_size.to_string()),
        ("max_compute_invocations_per_workgroup", limits.max_compute_invocations_per_workgroup.to_string()),
        ("features", adapter.features().iter_names().map(|(name, _)| name).collect::<Vec<_>>().join(" ")),
    ];
    AdapterSummary {
        name: info.name.clone(),
        api: info.backend.to_string(),
        driver: driver(&info),
        is_software: info.device_type == wgpu::DeviceType::Cpu,
        facts,
    }
}

/// Returns the name and version of an adapter's driver; empty if the graphics API doesn't report them.
fn driver(info: &wgpu::AdapterInfo) -> String {
    let words = [info.driver.as_str(), info.driver_info.as_str()];
    words.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ")
}

/// Creates an instance of wgpu, with the graphics API's validation if `validation` is true.
fn instance(validation: bool) -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.flags = wgpu::InstanceFlags::empty();
    if validation {
        // Without the flag DEBUG, messages of Vulkan's validation aren't printed.
        descriptor.flags |= wgpu::InstanceFlags::VALIDATION | wgpu::InstanceFlags::DEBUG;
    }
    wgpu::Instance::new(descriptor)
}

/// Returns the adapters of an instance, the fastest kind first. Within a kind, Vulkan, Metal and DX12 come before GL.
fn found(instance: &wgpu::Instance) -> Vec<wgpu::Adapter> {
    let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    adapters.sort_by_key(|adapter| {
        let info = adapter.get_info();
        let kind = match info.device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        };
        (kind, info.backend == wgpu::Backend::Gl)
    });
    adapters
}

/// Device that was opened, with its queue and the description of its adapter.
pub(crate) struct OpenDevice {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub info: wgpu::AdapterInfo,
}

/// Returns the optional features that are enabled if the adapter has them.
fn wanted_features(options: &Options) -> wgpu::Features {
    let passed = if options.wgsl { wgpu::Features::empty() } else { wgpu::Features::PASSTHROUGH_SHADERS };
    wgpu::Features::FLOAT32_BLENDABLE
        | wgpu::Features::TIMESTAMP_QUERY
        | wgpu::Features::PIPELINE_STATISTICS_QUERY
        | passed
}

/// Opens the device of the adapter that the options select.
pub(crate) fn open(options: &Options) -> Result<OpenDevice, RenderError> {
    // Without any graphics API, wgpu panics instead of returning an instance.
    if wgpu::Instance::enabled_backend_features().is_empty() {
        return Err(failed(
            "no graphics API of this platform is built in; build with feature vulkan, metal, dx12 or gles",
        ));
    }
    let adapters = found(&instance(options.validation));
    let names: Vec<String> = adapters.iter().map(|adapter| adapter.get_info().name).collect();
    let wanted = options.adapter.as_ref().map(|name| name.to_lowercase());
    let fits = |name: &str| wanted.as_ref().is_none_or(|wanted| name.to_lowercase().contains(wanted));
    let adapter = adapters.iter().zip(&names).find(|(_, name)| fits(name)).map(|(adapter, _)| adapter);
    let Some(adapter) = adapter else {
        return Err(failed(match &options.adapter {
            Some(wanted) if !names.is_empty() => {
                format!("no adapter is called '{wanted}'; found: {}", names.join(", "))
            }
            _ => "no adapter was found by Vulkan, Metal, DX12 or GL; install a graphics driver".to_owned(),
        }));
    };
    let descriptor = wgpu::DeviceDescriptor {
        label: Some("surfel"),
        required_features: adapter.features() & wanted_features(options),
        required_limits: adapter.limits(),
        ..wgpu::DeviceDescriptor::default()
    };
    let (device, queue) =
        pollster::block_on(adapter.request_device(&descriptor)).map_err(|error| failed(error.to_string()))?;
    Ok(OpenDevice { device, queue, info: adapter.get_info() })
}

/// True if the device can blend targets of f32.
pub(crate) fn blends_f32(device: &wgpu::Device) -> bool {
    device.features().contains(wgpu::Features::FLOAT32_BLENDABLE)
}

/// Returns the description of a renderer on an adapter. `f32_sums` is true if the adapter can sum attributes in f32.
pub(crate) fn renderer_info(info: &wgpu::AdapterInfo, f32_sums: bool) -> RendererInfo {
    let mut driver = format!("{}: {}", info.backend, driver(info));
    if !f32_sums {
        driver += "; sums in f16, for it can't blend f32";
    }
    RendererInfo { backend: NAME, adapter: info.name.clone(), driver, threads: 0, capabilities: CAPABILITIES }
}
