//! Descriptor set layouts, and sets of buffers and images.

use crate::device::Device;
use crate::error::Failure;
use crate::memory::{Buffer, Image};
use crate::object::{Owned, destroy};
use ash::vk;
use std::sync::Arc;
use surfel_gpu::binding_slots;
use surfel_shaders::{BindingKind, Stage};

/// Descriptor set layout with the types of its bindings, in order.
pub(crate) struct SetLayout {
    pub raw: Owned<vk::DescriptorSetLayout>,
    /// Number and type of each binding.
    bindings: Vec<(u32, vk::DescriptorType)>,
}

impl SetLayout {
    /// Creates the layout of descriptor set number `group` from the bindings that the entry points named `entries` use.
    pub(crate) fn new(
        device: &Arc<Device>,
        name: &str,
        entries: &[impl AsRef<str>],
        group: u32,
    ) -> Result<Self, Failure> {
        let binding_slots = binding_slots(entries, group);
        let raw: Vec<vk::DescriptorSetLayoutBinding<'_>> = binding_slots
            .iter()
            .map(|slot| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(slot.binding)
                    .descriptor_type(descriptor_type(slot.kind))
                    .descriptor_count(1)
                    .stage_flags(slot.stages.iter().fold(vk::ShaderStageFlags::empty(), |all, &s| all | stage(s)))
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&raw);
        // SAFETY: binding numbers are distinct, as reflected.
        let raw = unsafe { device.raw.create_descriptor_set_layout(&info, None) }?;
        let raw = Owned::new(device, raw, name, destroy!(destroy_descriptor_set_layout));
        let bindings = binding_slots.iter().map(|slot| (slot.binding, descriptor_type(slot.kind))).collect();
        Ok(Self { raw, bindings })
    }
}

impl SetLayout {
    /// Returns the numbers of the bindings.
    pub(crate) fn numbers(&self) -> Vec<u32> {
        self.bindings.iter().map(|(number, _)| *number).collect()
    }
}

/// Returns the descriptor type of a kind of binding.
fn descriptor_type(kind: BindingKind) -> vk::DescriptorType {
    match kind {
        BindingKind::Uniform => vk::DescriptorType::UNIFORM_BUFFER,
        BindingKind::StorageRead | BindingKind::StorageWrite => vk::DescriptorType::STORAGE_BUFFER,
        BindingKind::Texture | BindingKind::DepthTexture => vk::DescriptorType::SAMPLED_IMAGE,
    }
}

/// Returns Vulkan's flag of a shader stage.
pub(crate) fn stage(stage: Stage) -> vk::ShaderStageFlags {
    match stage {
        Stage::Vertex => vk::ShaderStageFlags::VERTEX,
        Stage::Fragment => vk::ShaderStageFlags::FRAGMENT,
        Stage::Compute => vk::ShaderStageFlags::COMPUTE,
    }
}

/// Resource of a binding.
#[derive(Clone, Copy)]
pub(crate) enum Resource<'a> {
    /// A whole buffer.
    Buffer(&'a Buffer),
    /// An image, in the layout in which shaders read it.
    Image(&'a Image),
}

/// Returns buffers as resources with binding numbers from 0.
pub(crate) fn numbered<'a>(buffers: impl IntoIterator<Item = &'a Buffer>) -> Vec<(u32, Resource<'a>)> {
    (0..).zip(buffers).map(|(binding, buffer)| (binding, Resource::Buffer(buffer))).collect()
}

/// Pool of descriptor sets. The sets are freed when it is dropped.
pub(crate) struct Sets {
    device: Arc<Device>,
    pool: Owned<vk::DescriptorPool>,
}

impl Sets {
    /// Creates a pool for `sets` sets of any of the backend's layouts.
    pub(crate) fn new(device: &Arc<Device>, sets: u32) -> Result<Self, Failure> {
        // These are the largest numbers of descriptors in any layout.
        let size = |ty, count: u32| vk::DescriptorPoolSize { ty, descriptor_count: count.saturating_mul(sets).max(1) };
        let sizes = [
            size(vk::DescriptorType::UNIFORM_BUFFER, 1),
            size(vk::DescriptorType::STORAGE_BUFFER, 7),
            size(vk::DescriptorType::SAMPLED_IMAGE, 12),
        ];
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(sets.max(1)).pool_sizes(&sizes);
        // SAFETY: sizes and sets are not 0.
        let pool = unsafe { device.raw.create_descriptor_pool(&info, None) }?;
        let pool = Owned::new(device, pool, "sets", destroy!(destroy_descriptor_pool));
        Ok(Self { device: device.clone(), pool })
    }

    /// Allocates a descriptor set and writes its bindings. `resources` are pairs of binding number and resource.
    /// Resources whose number isn't in the layout are ignored.
    pub(crate) fn set(
        &self,
        layout: &SetLayout,
        name: &str,
        resources: &[(u32, Resource<'_>)],
    ) -> Result<vk::DescriptorSet, Failure> {
        let layouts = [layout.raw.raw];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.pool.raw).set_layouts(&layouts);
        // SAFETY: pool and layout are this device's; only this thread uses the pool.
        let sets = unsafe { self.device.raw.allocate_descriptor_sets(&info) }?;
        let set = *sets.first().ok_or(Failure::OutOfMemory)?;
        self.device.name(set, name);
        for &(binding, ty) in &layout.bindings {
            let given = resources.iter().find(|(given, _)| *given == binding);
            let (_, resource) =
                given.ok_or_else(|| Failure::other(format!("{name}: binding {binding} has no resource")))?;
            let write = vk::WriteDescriptorSet::default().dst_set(set).dst_binding(binding).descriptor_type(ty);
            let buffer;
            let image;
            let write = match resource {
                Resource::Buffer(it) => {
                    buffer = [vk::DescriptorBufferInfo::default().buffer(it.raw()).range(vk::WHOLE_SIZE)];
                    write.buffer_info(&buffer)
                }
                Resource::Image(it) => {
                    image = [vk::DescriptorImageInfo::default().image_view(it.view()).image_layout(it.read_layout())];
                    write.image_info(&image)
                }
            };
            // SAFETY: the set is new and used by no command; binding and type are its layout's, the resource is alive
            // and outlives the submission that reads it.
            unsafe { self.device.raw.update_descriptor_sets(&[write], &[]) };
        }
        Ok(set)
    }
}
