//! Draws splats into an image in which the application's own pipeline has drawn a triangle. The splats form a ring that
//! passes through the triangle, so that each lies in part before the other and in part behind. The triangle's pipeline
//! writes the depth buffer against which the splats are tested.
//!
//! `cargo run -p surfel-wgpu --example among_triangles -- image.png`

use glam::DVec3;
use std::error::Error;
use surfel_io::{PlanesView, PngOptions};
use surfel_model::{Camera, CloudData, Column3, OnInvalid, Projection, Scene, Settings, Shader, Shape, SplatCloud};
use surfel_render::View;
use surfel_wgpu::{HostDepth, HostTarget};

const SIZE: [u32; 2] = [480, 320];
const NEAR: f64 = 0.1;

/// The application's own shader: a triangle in clip space, with the same depth z_near/z as the splats.
const TRIANGLE: &str = "
@vertex fn vertex(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    // In view space, y up: 4 units away, through the middle of the ring.
    let corners = array(vec3f(-0.65, -0.9, 3.8), vec3f(0.65, -0.9, 3.8), vec3f(0.0, 1.2, 4.2));
    let p = corners[i];
    let f = 1.0 / tan(radians(22.5));
    return vec4f(p.x * f * 320.0 / 480.0, p.y * f, 0.1, p.z);
}
@fragment fn fragment() -> @location(0) vec4f { return vec4f(0.9, 0.55, 0.1, 1.0); }
";

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "among_triangles.png".into());
    run(path.as_ref())?;
    println!("{path}");
    Ok(())
}

/// Draws the image and writes it as a PNG.
pub(crate) fn run(path: &std::path::Path) -> Result<(), Box<dyn Error>> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()))?;
    let required_features = adapter.features() & wgpu::Features::FLOAT32_BLENDABLE;
    let descriptor = wgpu::DeviceDescriptor { required_features, ..wgpu::DeviceDescriptor::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))?;

    let color_format = wgpu::TextureFormat::Rgba32Float;
    let depth_format = wgpu::TextureFormat::Depth32Float;
    let color = texture(&device, color_format, wgpu::TextureUsages::COPY_SRC);
    let depth = texture(&device, depth_format, wgpu::TextureUsages::empty());
    let (color_view, depth_view) = (color.create_view(&Default::default()), depth.create_view(&Default::default()));

    let mut encoder = device.create_command_encoder(&Default::default());
    draw_triangle(&device, &mut encoder, [color_format, depth_format], [&color_view, &depth_view]);

    // Draws the splats into the same colour and depth textures.
    let mut renderer = surfel_wgpu::Renderer::from_device(device.clone(), queue.clone())?;
    let resident = renderer.upload(&ring()?)?;
    let camera = Camera {
        eye: [0.0, 1.8, 3.6],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: 45.0 },
        near: NEAR,
        far: None,
        size: SIZE,
    };
    let settings = Settings::default().with_shader(Shader::Phong);
    let target = HostTarget {
        color: &color_view,
        color_format,
        depth: &depth_view,
        depth_format,
        mapping: HostDepth::reversed(NEAR as f32),
        index: None,
    };
    renderer.render_to_view(&mut encoder, &resident, &View::new(&camera)?, &settings, &target)?;

    save(&device, &queue, encoder, &color, path)
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

/// Returns disks on a torus around the y axis, which passes through the triangle.
fn ring() -> Result<Scene, Box<dyn Error>> {
    let (mut centers, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..160 {
        for j in 0..40 {
            let (a, b) = (f64::from(i) / 160.0 * std::f64::consts::TAU, f64::from(j) / 40.0 * std::f64::consts::TAU);
            let out = DVec3::new(a.cos(), 0.0, a.sin());
            let normal = out * b.cos() + DVec3::Y * b.sin();
            centers.push((out * 0.9 + normal * 0.2).as_vec3());
            normals.push(normal.as_vec3());
            colors.push([0.15 + 0.1 * b.cos() as f32, 0.4, 0.7]);
        }
    }
    let radii = vec![0.035; centers.len()];
    let shape = Shape::Disks { normals: Column3::from_f32(normals), radii };
    let mut data = CloudData::new(DVec3::ZERO, Column3::from_f32(centers), shape);
    data.colors = Some(colors);
    Ok(Scene::from(SplatCloud::new(data, OnInvalid::Refuse)?.0))
}

fn draw_triangle(
    device: &wgpu::Device,
    encoder: &mut wgpu::CommandEncoder,
    [color_format, depth_format]: [wgpu::TextureFormat; 2],
    [color, depth]: [&wgpu::TextureView; 2],
) {
    let source = wgpu::ShaderSource::Wgsl(TRIANGLE.into());
    let module = &device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let compilation_options = wgpu::PipelineCompilationOptions::default();
    let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vertex"),
            compilation_options: compilation_options.clone(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: depth_format,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some("fragment"),
            compilation_options,
            targets: &[Some(color_format.into())],
        }),
        multiview_mask: None,
        cache: None,
    });
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
    pass.set_pipeline(&pipeline);
    pass.draw(0..3, 0..1);
}

/// Submits the commands and writes the image as a PNG.
fn save(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    mut encoder: wgpu::CommandEncoder,
    color: &wgpu::Texture,
    path: &std::path::Path,
) -> Result<(), Box<dyn Error>> {
    // A row of 480 pixels of 16 bytes is 30 times the required alignment of 256 bytes.
    let bytes_per_row = 16 * SIZE[0];
    let size = u64::from(bytes_per_row * SIZE[1]);
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
    let buffer = device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(bytes_per_row), rows_per_image: None };
    let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(color.as_image_copy(), to, color.size());
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |_| ());
    device.poll(wgpu::PollType::wait_indefinitely())?;
    let view = buffer.get_mapped_range(..)?;
    let pixels: &[[f32; 4]] = bytemuck::cast_slice(&view);
    let [width, height] = SIZE;
    let planes = PlanesView { width, height, color: Some(pixels), ..PlanesView::default() };
    surfel_io::save_png(path, true, &planes, &PngOptions::default())?;
    Ok(())
}
