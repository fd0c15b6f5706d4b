//! Render passes and framebuffers.

use crate::device::Device;
use crate::error::Failure;
use crate::memory::{Image, read_layout};
use crate::object::{Owned, destroy};
use ash::vk;
use std::sync::Arc;
use surfel_gpu::Sums;

/// Depth buffer of the visibility pass. Every device has it.
pub(crate) const KEPT_FORMAT: vk::Format = vk::Format::D32_SFLOAT;

/// Precision of the sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Precision {
    F32,
    F16,
}

impl Precision {
    /// Of a target of four.
    pub(crate) fn four(self) -> vk::Format {
        match self {
            Self::F32 => vk::Format::R32G32B32A32_SFLOAT,
            Self::F16 => vk::Format::R16G16B16A16_SFLOAT,
        }
    }

    /// Of a target of one.
    pub(crate) fn one(self) -> vk::Format {
        match self {
            Self::F32 => vk::Format::R32_SFLOAT,
            Self::F16 => vk::Format::R16_SFLOAT,
        }
    }
}

/// What a pass over the splats draws into.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Kind {
    Visibility,
    Sums(Sums, Precision),
}

impl Kind {
    /// Formats of its targets.
    pub(crate) fn formats(self) -> Vec<vk::Format> {
        match self {
            Self::Visibility => vec![KEPT_FORMAT],
            Self::Sums(Sums::Color, p) => vec![p.four()],
            Self::Sums(Sums::Surface, p) => vec![p.four(), p.four()],
            Self::Sums(Sums::Further, p) => vec![p.four(), p.one()],
        }
    }
}

/// A render pass that clears its targets, and a compatible one that adds to them.
pub(crate) struct Pass {
    clearing: Owned<vk::RenderPass>,
    loading: Owned<vk::RenderPass>,
    targets: usize,
}

impl Pass {
    pub(crate) fn new(device: &Arc<Device>, kind: Kind) -> Result<Self, Failure> {
        let clearing = render_pass(device, kind, vk::AttachmentLoadOp::CLEAR)?;
        let loading = render_pass(device, kind, vk::AttachmentLoadOp::LOAD)?;
        Ok(Self { clearing, loading, targets: kind.formats().len() })
    }

    /// Either is compatible with pipelines and framebuffers of the other.
    pub(crate) fn raw(&self, clears: bool) -> vk::RenderPass {
        if clears { self.clearing.raw } else { self.loading.raw }
    }

    /// One for each target. A depth of 0 is infinitely far: nothing is kept.
    pub(crate) fn clear_values(&self) -> Vec<vk::ClearValue> {
        vec![vk::ClearValue { color: vk::ClearColorValue { float32: [0.0; 4] } }; self.targets]
    }
}

fn render_pass(device: &Arc<Device>, kind: Kind, load: vk::AttachmentLoadOp) -> Result<Owned<vk::RenderPass>, Failure> {
    let is_depth = kind == Kind::Visibility;
    let (aspect, drawn_layout) = if is_depth {
        (vk::ImageAspectFlags::DEPTH, vk::ImageLayout::DEPTH_STENCIL_ATTACHMENT_OPTIMAL)
    } else {
        (vk::ImageAspectFlags::COLOR, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL)
    };
    let attachments: Vec<vk::AttachmentDescription> = kind
        .formats()
        .into_iter()
        .map(|format| {
            vk::AttachmentDescription::default()
                .format(format)
                .samples(vk::SampleCountFlags::TYPE_1)
                .load_op(load)
                .store_op(vk::AttachmentStoreOp::STORE)
                .stencil_load_op(vk::AttachmentLoadOp::DONT_CARE)
                .stencil_store_op(vk::AttachmentStoreOp::DONT_CARE)
                .initial_layout(read_layout(aspect))
                .final_layout(read_layout(aspect))
        })
        .collect();
    let references: Vec<vk::AttachmentReference> = (0..attachments.len() as u32)
        .map(|attachment| vk::AttachmentReference { attachment, layout: drawn_layout })
        .collect();
    let subpass = vk::SubpassDescription::default().pipeline_bind_point(vk::PipelineBindPoint::GRAPHICS);
    let subpass = match references.first().filter(|_| is_depth) {
        Some(depth) => subpass.depth_stencil_attachment(depth),
        None => subpass.color_attachments(&references),
    };
    let subpasses = [subpass];
    // Layouts change after all that was before, and before all that follows.
    let (all, graphics) = (vk::PipelineStageFlags::ALL_COMMANDS, vk::PipelineStageFlags::ALL_GRAPHICS);
    let dependency = vk::SubpassDependency::default()
        .src_access_mask(vk::AccessFlags::MEMORY_WRITE)
        .dst_access_mask(vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE);
    let before = dependency.src_subpass(vk::SUBPASS_EXTERNAL).src_stage_mask(all).dst_stage_mask(graphics);
    let after = dependency.dst_subpass(vk::SUBPASS_EXTERNAL).src_stage_mask(graphics).dst_stage_mask(all);
    let dependencies = [before, after];
    let info =
        vk::RenderPassCreateInfo::default().attachments(&attachments).subpasses(&subpasses).dependencies(&dependencies);
    // SAFETY: references are to attachments of this pass, in layouts that fit their aspect.
    let raw = unsafe { device.raw.create_render_pass(&info, None) }?;
    Ok(Owned::new(device, raw, "pass over the splats", destroy!(destroy_render_pass)))
}

/// A framebuffer of images of one size.
pub(crate) fn framebuffer(
    device: &Arc<Device>,
    pass: &Pass,
    images: &[&Image],
    [width, height]: [u32; 2],
) -> Result<Owned<vk::Framebuffer>, Failure> {
    let views: Vec<vk::ImageView> = images.iter().map(|image| image.view()).collect();
    let info = vk::FramebufferCreateInfo::default()
        .render_pass(pass.raw(true))
        .attachments(&views)
        .width(width)
        .height(height)
        .layers(1);
    // SAFETY: the views have the pass's formats in order, and this size; they live as long as the framebuffer's owner.
    let raw = unsafe { device.raw.create_framebuffer(&info, None) }?;
    Ok(Owned::new(device, raw, "targets", destroy!(destroy_framebuffer)))
}
