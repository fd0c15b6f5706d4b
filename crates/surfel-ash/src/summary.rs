//! Descriptions of this machine's Vulkan devices, queried without opening one.

use crate::error::Failure;
use crate::instance::{Candidate, Instance};
use ash::vk;
use surfel_render::RenderError;

/// Description of a device that this backend can draw on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeviceSummary {
    /// Name reported by the driver.
    pub name: String,
    /// Version of Vulkan, and name and version of the driver.
    pub driver: String,
    /// True if the device computes on the CPU.
    pub is_software: bool,
    /// Limits and features by Vulkan's names, with their values as text.
    pub facts: Vec<(&'static str, String)>,
}

/// Returns the devices that Vulkan finds. The first is the default of a renderer.
///
/// # Errors
/// [`RenderError::Backend`] if there is no Vulkan loader, or no instance can be created.
pub fn devices() -> Result<Vec<DeviceSummary>, RenderError> {
    let instance = Instance::new(false)?;
    Ok(instance.candidates()?.iter().map(|candidate| summary(&instance, candidate)).collect())
}

/// Returns the description of a device.
fn summary(instance: &Instance, candidate: &Candidate) -> DeviceSummary {
    DeviceSummary {
        name: candidate.name.clone(),
        driver: candidate.driver.clone(),
        is_software: candidate.is_software(),
        facts: facts(instance, candidate).unwrap_or_default(),
    }
}

/// Returns limits and features of a device by Vulkan's names, with their values as text.
fn facts(instance: &Instance, candidate: &Candidate) -> Result<Vec<(&'static str, String)>, Failure> {
    let physical = candidate.physical;
    // SAFETY: the physical device is the instance's.
    let features = unsafe { instance.raw.get_physical_device_features(physical) };
    // SAFETY: the physical device is the instance's.
    let memory = unsafe { instance.raw.get_physical_device_memory_properties(physical) };
    // SAFETY: the physical device is the instance's.
    let extensions = unsafe { instance.raw.enumerate_device_extension_properties(physical) }?;
    // SAFETY: the physical device is the instance's.
    let families = unsafe { instance.raw.get_physical_device_queue_family_properties(physical) };
    let blends = |format| {
        // SAFETY: the physical device is the instance's.
        let properties = unsafe { instance.raw.get_physical_device_format_properties(physical, format) };
        properties.optimal_tiling_features.contains(vk::FormatFeatureFlags::COLOR_ATTACHMENT_BLEND).to_string()
    };
    let mut subgroup = vk::PhysicalDeviceSubgroupProperties::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut subgroup);
    // SAFETY: the device is of Vulkan 1.1, which has these properties; the chain lives through the call.
    unsafe { instance.raw.get_physical_device_properties2(physical, &mut all) };
    let limits = candidate.properties.limits;
    let heaps: Vec<String> = memory
        .memory_heaps_as_slice()
        .iter()
        .map(|heap| {
            let is_own = heap.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL);
            format!("{} MiB{}", heap.size >> 20, if is_own { " of the device" } else { "" })
        })
        .collect();
    let queues: Vec<String> =
        families.iter().map(|family| format!("{}x {:?}", family.queue_count, family.queue_flags)).collect();
    let mut names: Vec<String> = extensions
        .iter()
        .filter_map(|extension| Some(extension.extension_name_as_c_str().ok()?.to_string_lossy().into_owned()))
        .collect();
    names.sort();
    let has = |feature: vk::Bool32| (feature == vk::TRUE).to_string();
    Ok(vec![
        ("deviceType", format!("{:?}", candidate.properties.device_type)),
        ("memoryHeaps", heaps.join(", ")),
        ("queueFamilies", queues.join(", ")),
        ("timestampValidBits", candidate.timestamp_bits.to_string()),
        ("timestampPeriod", limits.timestamp_period.to_string()),
        ("subgroupSize", subgroup.subgroup_size.to_string()),
        ("maxImageDimension2D", limits.max_image_dimension2_d.to_string()),
        ("maxStorageBufferRange", limits.max_storage_buffer_range.to_string()),
        ("maxPerStageDescriptorStorageBuffers", limits.max_per_stage_descriptor_storage_buffers.to_string()),
        ("maxComputeSharedMemorySize", limits.max_compute_shared_memory_size.to_string()),
        ("maxComputeWorkGroupInvocations", limits.max_compute_work_group_invocations.to_string()),
        ("maxColorAttachments", limits.max_color_attachments.to_string()),
        ("blends R32G32B32A32_SFLOAT", blends(vk::Format::R32G32B32A32_SFLOAT)),
        ("blends R32G32_SFLOAT", blends(vk::Format::R32G32_SFLOAT)),
        ("occlusionQueryPrecise", has(features.occlusion_query_precise)),
        ("pipelineStatisticsQuery", has(features.pipeline_statistics_query)),
        ("fragmentStoresAndAtomics", has(features.fragment_stores_and_atomics)),
        ("shaderInt64", has(features.shader_int64)),
        ("extensions", names.join(" ")),
    ])
}
