//! Splats that the embedding application places: a compute pass writes them from the application's buffer into the
//! resident scene.

use crate::error::{failed, scoped};
use crate::renderer::Renderer;
use crate::scene::{ResidentScene, bind_some, filled};
use surfel_gpu::{HostLayout, workgroups};
use surfel_render::RenderError;

/// Name of the entry point that places splats.
const ENTRY: &str = "place_splats";

/// Buffer of the application with the positions (and normals and colours) that [`Renderer::place_splats`] gives to an
/// object's splats, and its layout.
#[derive(Clone, Copy, Debug)]
pub struct HostSplats<'a> {
    /// Buffer on the renderer's device, with the usage `STORAGE`.
    pub buffer: &'a wgpu::Buffer,
    /// Layout of the splats in the buffer, and the box that contains their centres.
    pub layout: HostLayout,
}

impl Renderer {
    /// Moves the splats of an object to the positions in a buffer of the application, for all frames until the next
    /// call. `object` is the object's index in the uploaded scene. A compute pass reads centres, normals and colours
    /// from the buffer and writes them into the resident scene. The CPU neither reads nor uploads any splat.
    ///
    /// The pass is submitted by this call: submit the commands that fill the buffer before. The scene may afterwards be
    /// drawn in any way.
    ///
    /// Splat i of the object is splat i of the buffer. It keeps its radius, alpha and clip. The half-axes of a disk
    /// follow from its normal and radius: they are perpendicular to the normal and as long as the radius. Splats of a
    /// cloud of ellipses keep their half-axes, so the application can't give them normals. A shading normal is replaced
    /// by the normal. Negative colours become 0.
    ///
    /// These splats aren't drawn:
    /// - those beyond [`HostLayout::count`];
    /// - those whose centre is outside of [`HostLayout::bounds`];
    /// - those whose centre, normal or colour isn't finite, or whose normal is 0;
    /// - those that reach the near plane: whose centre is nearer than the near plane, whose depth range in perspective
    ///   is at least their centre's depth, or which are more than 10⁷ times as large as their distance. The CPU sets up
    ///   such splats of other objects, but it doesn't have the positions of these.
    ///
    /// The CPU uses the box where it otherwise uses positions: the object is culled as a whole. The bounds of shadow
    /// maps contain both the box and the object as it was uploaded. Centres are f32 numbers about the origin of the
    /// object, so the object should be near its origin in units of its splats' radii.
    ///
    /// The first call for an object uploads four bytes per splat, the order in which its splats are stored. Each
    /// further call uploads 64 bytes. There is no way back to the uploaded places other than a new upload.
    ///
    /// # Errors
    /// [`RenderError::Backend`] if the layout doesn't fit the buffer or the object, if the object isn't a cloud of
    /// disks or ellipses, if the renderer stores splats in 16 bits, or if the device fails. Unless the device
    /// fails, nothing is then changed.
    pub fn place_splats(
        &mut self,
        scene: &mut ResidentScene,
        object: usize,
        splats: &HostSplats<'_>,
    ) -> Result<(), RenderError> {
        let HostSplats { buffer, layout } = splats;
        if !buffer.usage().contains(wgpu::BufferUsages::STORAGE) {
            return Err(failed("the buffer of splats lacks the usage STORAGE"));
        }
        let most = self.device.limits().max_storage_buffer_binding_size;
        if buffer.size() > most {
            let bytes = buffer.size();
            return Err(failed(format!("the buffer of splats has {bytes} bytes, the device reads at most {most}")));
        }
        layout.check(buffer.size()).map_err(failed)?;
        let placed = scene.cpu.place(object, layout).map_err(failed)?;
        let (device, storage, uniform) =
            (self.device.clone(), wgpu::BufferUsages::STORAGE, wgpu::BufferUsages::UNIFORM);
        scoped(&device, || {
            self.pipelines.prepare_cells(&device, ENTRY);
            let Some(pipeline) = self.pipelines.cells(ENTRY) else { return };
            let frame_group = bind_some(&device, "no frame", &pipeline.frame_group.layout, &[]);
            let mut encoder =
                device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("place splats") });
            let words = filled(&device, &self.queue, "layout of placed splats", &layout.words(), uniform);
            for index in placed {
                let (Some(segment), Some(cpu)) = (scene.segments.get_mut(index), scene.cpu.segments.get(index)) else {
                    continue;
                };
                if segment.members.is_none() {
                    let members = filled(&device, &self.queue, "members", &cpu.members, storage);
                    segment.members = Some(members);
                    segment.uniform = filled(&device, &self.queue, "segment", &cpu.uniform, uniform);
                }
                let Some(members) = &segment.members else { continue };
                let buffers =
                    [(0, &segment.uniform), (58, &words), (59, *buffer), (60, members), (61, &segment.splats)];
                let group = bind_some(&device, "place splats", &pipeline.group.layout, &buffers);
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: Some("place splats"),
                    timestamp_writes: None,
                });
                pass.set_pipeline(&pipeline.raw);
                pass.set_bind_group(0, &frame_group, &[]);
                pass.set_bind_group(1, &group, &[]);
                pass.dispatch_workgroups(workgroups(segment.count, ENTRY, 0), 1, 1);
            }
            self.queue.submit([encoder.finish()]);
        })?;
        self.errors.check()
    }
}
