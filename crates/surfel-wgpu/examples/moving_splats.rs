//! Draws a million splats that move every frame among the application's own triangle. A compute shader of the
//! application writes their centres, normals and colours into a buffer, and Surfel reads them there: the CPU neither
//! computes nor uploads any splat.
//!
//! `cargo run --release -p surfel-wgpu --example moving_splats -- image.png 1000 10`: a sheet of 1000×1000 splats, ten
//! frames, and the last one as an image.

use std::error::Error;
use surfel_io::{PlanesView, PngOptions};
use surfel_model::{Camera, Scene, Settings, Shader, SplatCloud};
use surfel_render::View;
use surfel_wgpu::{HostAttribute, HostDepth, HostFormat, HostLayout, HostSplats, HostTarget, Renderer};

const SIZE: [u32; 2] = [480, 320];
const NEAR: f64 = 0.1;

/// The application's shader that moves the splats: waves of a sheet of side×side splats. A splat has seven words in the
/// buffer: three of its centre, one of its colour, three of its normal.
const WAVES: &str = "
struct Params { time: f32, side: u32 }
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> words: array<u32>;

@compute @workgroup_size(64)
fn move_splats(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let i = (group.y * 1024u + group.x) * 64u + lane;
    if i >= params.side * params.side {
        return;
    }
    let at = vec2f(f32(i % params.side), f32(i / params.side)) / f32(params.side - 1u) * 2.0 - 1.0;
    let phase = 9.0 * at - vec2f(params.time, 0.6 * params.time);
    let height = 0.12 * (sin(phase.x) + cos(phase.y));
    let slope = 0.12 * 9.0 * vec2f(cos(phase.x), -sin(phase.y));
    let color = mix(vec3f(0.1, 0.25, 0.6), vec3f(0.75, 0.9, 0.95), smoothstep(-0.1, 0.25, height));
    let first = 7u * i;
    words[first] = bitcast<u32>(at.x);
    words[first + 1u] = bitcast<u32>(height);
    words[first + 2u] = bitcast<u32>(at.y);
    words[first + 3u] = pack4x8unorm(vec4f(color, 1.0));
    words[first + 4u] = bitcast<u32>(-slope.x);
    words[first + 5u] = bitcast<u32>(1.0);
    words[first + 6u] = bitcast<u32>(-slope.y);
}
";

/// Returns the layout of the buffer that `WAVES` writes, for Surfel, and the box that the waves stay in.
fn layout(splats: u32) -> HostLayout {
    HostLayout {
        count: splats,
        stride: 28,
        position: 0,
        normal: Some(HostAttribute { offset: 16, format: HostFormat::F32x3 }),
        color: Some(HostAttribute { offset: 12, format: HostFormat::Srgb8x4 }),
        bounds: [[-1.0, -0.25, -1.0], [1.0, 0.25, 1.0]],
    }
}

/// The application's shader that draws: a triangle in clip space, with the same depth near/z as the splats.
const TRIANGLE: &str = "
@vertex
fn triangle_vertex(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    // In view space, y up: upright in the middle of the sheet.
    let corners = array(vec3f(-0.7, -0.8, 2.7), vec3f(0.7, -0.8, 2.7), vec3f(0.0, 0.9, 2.9));
    let p = corners[i];
    let f = 1.0 / tan(radians(22.5));
    return vec4f(p.x * f * 320.0 / 480.0, p.y * f, 0.1, p.z);
}

@fragment
fn triangle_fragment() -> @location(0) vec4f {
    return vec4f(0.9, 0.55, 0.1, 1.0);
}
";

/// Pixels of the last frame, linear RGBA row by row, and the costs of each frame.
pub(crate) type Drawn = (Vec<[f32; 4]>, Vec<FrameCost>);

/// Costs of a frame on the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FrameCost {
    /// Bytes that Surfel wrote to the queue.
    pub written_bytes: u64,
    /// Splats that Surfel visited on the CPU.
    pub splats: u64,
    /// Chunks of splats that Surfel visited on the CPU.
    pub chunks: u64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().unwrap_or_else(|| "moving_splats.png".into());
    let mut number = |default: u32| arguments.next().map_or(Ok(default), |text| text.parse());
    let (side, frames) = (number(1000)?, number(10)?);
    let start = std::time::Instant::now();
    let (pixels, costs) = run(side, frames)?;
    let seconds = start.elapsed().as_secs_f64();
    let [width, height] = SIZE;
    let planes = PlanesView { width, height, color: Some(&pixels), ..PlanesView::default() };
    surfel_io::save_png(path.as_ref(), true, &planes, &PngOptions::default())?;
    println!("{path}: {frames} frames of {} splats in {seconds:.2} s, start included", side * side);
    if let Some(FrameCost { written_bytes, splats, chunks }) = costs.last() {
        println!("last frame: {written_bytes} bytes written, {splats} splats and {chunks} chunks visited by the CPU");
    }
    Ok(())
}

/// Draws frames of a sheet of `side`×`side` splats. Returns the pixels of the last frame, and the costs of each.
pub(crate) fn run(side: u32, frames: u32) -> Result<Drawn, Box<dyn Error>> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))?;
    let required_features = adapter.features() & wgpu::Features::FLOAT32_BLENDABLE;
    let descriptor = wgpu::DeviceDescriptor { required_features, ..wgpu::DeviceDescriptor::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))?;

    // The cloud gives Surfel the number of splats, their radii and the material. Its centres are those before the first
    // frame, and neighbours in it should stay neighbours.
    let at = |i: u32| 2.0 * f64::from(i) / f64::from(side - 1) - 1.0;
    let centers: Vec<[f32; 3]> = (0..side * side).map(|i| [at(i % side) as f32, 0.0, at(i / side) as f32]).collect();
    let normals = vec![[0.0, 1.0, 0.0]; centers.len()];
    let colors = vec![[0.5f32; 3]; centers.len()];
    let radii = vec![3.0 / side as f32; centers.len()];
    let cloud = SplatCloud::disks(&centers, &normals, &radii)?.with_colors(&colors)?;
    let mut renderer = Renderer::from_device(device.clone(), queue.clone())?;
    let mut resident = renderer.upload(&Scene::from(cloud))?;

    let layout = layout(side * side);
    let storage = wgpu::BufferUsages::STORAGE;
    let splats = buffer(&device, u64::from(layout.count) * u64::from(layout.stride), storage);
    let params = buffer(&device, 8, wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST);
    let module = module(&device, WAVES);
    let waves = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: None,
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let resources = [params.as_entire_binding(), splats.as_entire_binding()];
    let entries = (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &waves.get_bind_group_layout(0),
        entries: &entries.collect::<Vec<_>>(),
    });

    let color_format = wgpu::TextureFormat::Rgba32Float;
    let depth_format = wgpu::TextureFormat::Depth32Float;
    let color = texture(&device, color_format, wgpu::TextureUsages::COPY_SRC);
    let depth = texture(&device, depth_format, wgpu::TextureUsages::empty());
    let (color_view, depth_view) = (color.create_view(&Default::default()), depth.create_view(&Default::default()));
    let triangle = Triangle::new(&device, [color_format, depth_format]);
    let target = HostTarget {
        color: &color_view,
        color_format,
        depth: &depth_view,
        depth_format,
        mapping: HostDepth::reversed(NEAR as f32),
        index: None,
    };
    let mut camera = Camera::perspective([0.0, 1.5, 2.4], [0.0; 3], 45.0, SIZE);
    camera.near = NEAR;
    let view = View::new(&camera)?;
    let settings = Settings::default().with_shader(Shader::Phong);

    let mut costs = Vec::new();
    for frame in 0..frames {
        // The application moves the splats.
        let words = [(0.2 * frame as f32).to_bits(), side];
        queue.write_buffer(&params, 0, bytemuck::cast_slice(&words));
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&waves);
        pass.set_bind_group(0, &group, &[]);
        let groups = layout.count.div_ceil(64);
        pass.dispatch_workgroups(groups.min(1024), groups.div_ceil(1024), 1);
        drop(pass);
        queue.submit([encoder.finish()]);

        // Surfel reads them, and draws among the application's triangle.
        let before = (renderer.written_bytes(), renderer.host_work());
        renderer.place_splats(&mut resident, 0, &HostSplats { buffer: &splats, layout })?;
        let mut encoder = device.create_command_encoder(&Default::default());
        triangle.draw(&mut encoder, [&color_view, &depth_view]);
        renderer.render_to_view(&mut encoder, &resident, &view, &settings, &target)?;
        queue.submit([encoder.finish()]);
        let work = renderer.host_work();
        costs.push(FrameCost {
            written_bytes: renderer.written_bytes() - before.0,
            splats: work.splats - before.1.splats,
            chunks: work.chunks - before.1.chunks,
        });
    }
    Ok((read(&device, &queue, &color)?, costs))
}

fn module(device: &wgpu::Device, text: &'static str) -> wgpu::ShaderModule {
    let source = wgpu::ShaderSource::Wgsl(text.into());
    device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source })
}

fn buffer(device: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
}

fn texture(device: &wgpu::Device, format: wgpu::TextureFormat, usage: wgpu::TextureUsages) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: SIZE[0], height: SIZE[1], depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    })
}

/// The application's own renderer: the pipeline that draws its triangle.
struct Triangle(wgpu::RenderPipeline);

impl Triangle {
    fn new(device: &wgpu::Device, [color, depth]: [wgpu::TextureFormat; 2]) -> Self {
        let module = &module(device, TRIANGLE);
        let compilation_options = wgpu::PipelineCompilationOptions::default();
        Self(device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: None,
            vertex: wgpu::VertexState {
                module,
                entry_point: None,
                compilation_options: compilation_options.clone(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: depth,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module,
                entry_point: None,
                compilation_options,
                targets: &[Some(color.into())],
            }),
            multiview_mask: None,
            cache: None,
        }))
    }

    /// Clears the target and draws the triangle.
    fn draw(&self, encoder: &mut wgpu::CommandEncoder, [color, depth]: [&wgpu::TextureView; 2]) {
        let background = wgpu::Color { r: 0.02, g: 0.025, b: 0.04, a: 1.0 };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(background), store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.0);
        pass.draw(0..3, 0..1);
    }
}

/// Reads back the pixels of an image.
fn read(device: &wgpu::Device, queue: &wgpu::Queue, color: &wgpu::Texture) -> Result<Vec<[f32; 4]>, Box<dyn Error>> {
    // A row of 480 pixels of 16 bytes is 30 times the required alignment of 256 bytes.
    let bytes_per_row = 16 * SIZE[0];
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
    let buffer = buffer(device, u64::from(bytes_per_row * SIZE[1]), usage);
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(bytes_per_row), rows_per_image: None };
    let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    let mut encoder = device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(color.as_image_copy(), to, color.size());
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |_| ());
    device.poll(wgpu::PollType::wait_indefinitely())?;
    let view = buffer.get_mapped_range(..)?;
    Ok(bytemuck::cast_slice(&view).to_vec())
}
