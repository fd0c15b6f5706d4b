//! Tests drawing into a host's render target: colours equal those of a frame, and the host's depth test decides where.

use glam::{DVec3, Vec3};
use surfel_model::{Camera, CloudData, Column3, EdgeAa, OnInvalid, Projection, Scene, Settings, Shape, SplatCloud};
use surfel_render::{Frame, Planes, Renderer as _, View};
use surfel_wgpu::{HostDepth, HostTarget, Renderer};

const SIZE: [u32; 2] = [64, 32];
const HOST: [f64; 4] = [0.25, 0.5, 0.75, 1.0];

fn device() -> Option<(wgpu::Device, wgpu::Queue)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let Some(adapter) = adapters.first() else {
        let required = std::env::var("SURFEL_REQUIRE").unwrap_or_default();
        assert!(
            !required.split(',').any(|word| word.trim() == "wgpu"),
            "SURFEL_REQUIRE asks for wgpu, but has no adapter"
        );
        println!("skipped: no adapter was found");
        return None;
    };
    let required_features = adapter.features() & wgpu::Features::FLOAT32_BLENDABLE;
    let descriptor = wgpu::DeviceDescriptor { required_features, ..Default::default() };
    Some(pollster::block_on(adapter.request_device(&descriptor)).unwrap())
}

/// Returns two disks beside each other, 2 and 4 units before the eye.
fn scene() -> Scene {
    let centers = vec![Vec3::new(-0.6, 0.0, 1.0), Vec3::new(1.2, 0.0, -1.0)];
    let shape = Shape::Disks { normals: Column3::from_f32(vec![Vec3::Z; 2]), radii: vec![0.5, 1.0] };
    let mut data = CloudData::new(DVec3::ZERO, Column3::from_f32(centers), shape);
    data.colors = Some(vec![[0.9, 0.2, 0.1], [0.1, 0.3, 0.8]]);
    Scene::from(SplatCloud::new(data, OnInvalid::Refuse).unwrap().0)
}

fn view(projection: Projection) -> View {
    let (eye, up) = ([0.0, 0.0, 3.0], [0.0, 1.0, 0.0]);
    View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.5, far: Some(10.0), size: SIZE }).unwrap()
}

/// Returns a host's colours after splats were drawn into a target cleared to `HOST` and a given depth. The depth buffer
/// has the given additional usages.
fn drawn(
    renderer: &mut Renderer,
    (device, queue): &(wgpu::Device, wgpu::Queue),
    (scene, settings, view): (&Scene, &Settings, &View),
    mapping: HostDepth,
    (clear, usage): (f32, wgpu::TextureUsages),
) -> Vec<[f32; 4]> {
    let format = |format, usage| {
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
    };
    let (color_format, depth_format) = (wgpu::TextureFormat::Rgba32Float, wgpu::TextureFormat::Depth32Float);
    let texture = format(color_format, wgpu::TextureUsages::COPY_SRC);
    let color = &texture.create_view(&Default::default());
    let depth = &format(depth_format, usage).create_view(&Default::default());
    let mut encoder = device.create_command_encoder(&Default::default());
    let [r, g, b, a] = HOST;
    let store = wgpu::StoreOp::Store;
    drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: color,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a }), store },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: depth,
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(clear), store }),
            stencil_ops: None,
        }),
        ..Default::default()
    }));
    let resident = renderer.upload(scene).unwrap();
    let target = HostTarget { color, color_format, depth, depth_format, mapping };
    renderer.render_to_view(&mut encoder, &resident, view, settings, &target).unwrap();
    let size = u64::from(16 * SIZE[0] * SIZE[1]);
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
    let buffer = device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(16 * SIZE[0]), rows_per_image: None };
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
        texture.size(),
    );
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let view = buffer.get_mapped_range(..).unwrap();
    bytemuck::cast_slice(&view).to_vec()
}

#[test]
fn host_target_gets_the_frame_s_colours_where_its_depth_test_lets_them() {
    let Some(pair) = device() else { return };
    let mut renderer = Renderer::from_device(pair.0.clone(), pair.1.clone()).unwrap();
    let perspective = view(Projection::Perspective { fov_y_deg: 60.0 });
    let orthographic = view(Projection::Orthographic { height: 3.0 });
    let linear = HostDepth { offset: -0.5 / 9.5, scale: 1.0 / 9.5, compare: wgpu::CompareFunction::Less };
    // Depth of a wall 3 units away, between the disks, in each host's mapping; and the clear value behind everything.
    let hosts = [
        (&perspective, HostDepth::reversed(0.5), 0.5 / 3.0, 0.0),
        (&perspective, HostDepth::usual(0.5, 10.0), 10.0 / 9.5 * (1.0 - 0.5 / 3.0), 1.0),
        (&orthographic, linear, 2.5 / 9.5, 1.0),
    ];
    for (view, mapping, wall, behind) in hosts {
        let resident = renderer.upload(&scene()).unwrap();
        let mut frame = Frame::default();
        renderer.render_into(&resident, view, &Settings::default(), Planes::ALL, &mut frame).unwrap();
        for (clear, farthest) in [(behind, f32::INFINITY), (wall, 3.0), (1.0 - behind, 0.0)] {
            let what = (&scene(), &Settings::default(), view);
            let pixels = drawn(&mut renderer, &pair, what, mapping, (clear, wgpu::TextureUsages::empty()));
            let mut shown = 0;
            for (i, pixel) in pixels.iter().enumerate() {
                let passes = frame.depth()[i] < farthest && frame.depth()[i].is_finite();
                shown += usize::from(passes);
                let want = if passes { frame.color()[i] } else { HOST.map(|c| c as f32) };
                assert!(
                    pixel.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-6),
                    "{mapping:?} {clear} at {i}: {pixel:?} {want:?}"
                );
            }
            assert_eq!(shown == 0, farthest == 0.0, "{mapping:?}");
        }
    }
}

#[test]
fn edges_by_samples_are_refused() {
    let Some((device, queue)) = device() else { return };
    let mut renderer = Renderer::from_device(device.clone(), queue).unwrap();
    let (color_format, depth_format) = (wgpu::TextureFormat::Rgba32Float, wgpu::TextureFormat::Depth32Float);
    let [color, depth] = [color_format, depth_format].map(|format| {
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: SIZE[0], height: SIZE[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        texture.create_view(&Default::default())
    });
    let (mapping, resident) = (HostDepth::reversed(0.5), renderer.upload(&scene()).unwrap());
    let target = HostTarget { color: &color, color_format, depth: &depth, depth_format, mapping };
    let settings = Settings::default().with_edge_aa(EdgeAa::Samples);
    let mut encoder = device.create_command_encoder(&Default::default());
    let view = view(Projection::Perspective { fov_y_deg: 60.0 });
    let refused = renderer.render_to_view(&mut encoder, &resident, &view, &settings, &target);
    assert!(refused.is_err_and(|error| error.to_string().contains("edges by samples")));
}

/// Returns disks that face the eye, one for each pair of distance and alpha.
fn panes(panes: &[(f32, f32)]) -> Scene {
    let centers = panes.iter().map(|pane| Vec3::new(0.0, 0.0, 3.0 - pane.0)).collect();
    let radii = panes.iter().map(|pane| 0.4 * pane.0).collect();
    let shape = Shape::Disks { normals: Column3::from_f32(vec![Vec3::Z; panes.len()]), radii };
    let mut data = CloudData::new(DVec3::ZERO, Column3::from_f32(centers), shape);
    data.colors = Some(panes.iter().map(|pane| [0.9, 0.2 * pane.0, 0.1]).collect());
    data.alphas = Some(panes.iter().map(|pane| pane.1).collect());
    Scene::from(SplatCloud::new(data, OnInvalid::Refuse).unwrap().0)
}

#[test]
fn host_geometry_is_seen_between_transparent_layers() {
    let Some(pair) = device() else { return };
    let mut renderer = Renderer::from_device(pair.0.clone(), pair.1.clone()).unwrap();
    let settings = Settings::default().with_transparency("peel:4".parse().unwrap());
    let perspective = view(Projection::Perspective { fov_y_deg: 60.0 });
    let orthographic = view(Projection::Orthographic { height: 3.0 });
    let linear = HostDepth { offset: -0.5 / 9.5, scale: 1.0 / 9.5, compare: wgpu::CompareFunction::Less };
    let far = 10.0 / 9.5;
    // The host's wall is 3 units away.
    let hosts = [
        (&perspective, HostDepth::reversed(0.5), 0.5 / 3.0),
        (&perspective, HostDepth::usual(0.5, 10.0), far * (1.0 - 0.5 / 3.0)),
        (&orthographic, linear, 2.5 / 9.5),
    ];
    // Splats before the wall occlude it or blend over it; splats behind it are hidden, whether or not it is opaque.
    let before = [(2.0, 0.5), (2.5, 0.25)];
    let scenes =
        [panes(&before), panes(&[before[0], before[1], (4.0, 0.75)]), panes(&[before[0], before[1], (4.0, 1.0)])];
    for (view, mapping, wall) in hosts {
        let resident = renderer.upload(&scenes[0]).unwrap();
        let mut frame = Frame::default();
        renderer.render_into(&resident, view, &settings, Planes::ALL, &mut frame).unwrap();
        let over = |c: &[f32; 4]| -> [f32; 4] { std::array::from_fn(|i| c[i] + (1.0 - c[3]) * HOST[i] as f32) };
        let want: Vec<[f32; 4]> = frame.color().iter().map(over).collect();
        for scene in &scenes {
            let depth = (wall, wgpu::TextureUsages::TEXTURE_BINDING);
            let pixels = drawn(&mut renderer, &pair, (scene, &settings, view), mapping, depth);
            for (i, (pixel, want)) in pixels.iter().zip(&want).enumerate() {
                let close = pixel.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-6);
                assert!(close, "{mapping:?} at {i}: {pixel:?} {want:?}");
            }
        }
        let tinted = want.iter().filter(|color| (f64::from(color[0]) - HOST[0]).abs() > 0.1).count();
        assert!(tinted > 50, "{tinted}");
        // An opaque disk before the wall occludes it; if the depth can't be read, only this is required.
        for usage in [wgpu::TextureUsages::empty(), wgpu::TextureUsages::TEXTURE_BINDING] {
            let pixels = drawn(
                &mut renderer,
                &pair,
                (&panes(&[(2.0, 0.5), (2.5, 1.0)]), &settings, view),
                mapping,
                (wall, usage),
            );
            let middle = pixels[(SIZE[1] / 2 * SIZE[0] + SIZE[0] / 2) as usize];
            for (got, want) in middle.iter().zip([0.9, 0.5 * (0.4 + 0.5), 0.1, 1.0]) {
                assert!((got - want).abs() < 1e-5, "{middle:?}");
            }
        }
    }
}
