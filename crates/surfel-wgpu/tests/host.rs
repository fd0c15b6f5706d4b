//! Tests drawing into the render target of an embedding application: colours equal those of a frame, and the
//! application's depth test decides which pixels show them.

use glam::{DVec3, Vec3};
use surfel_model::{
    Camera, CloudData, Column3, EdgeAa, GaussianCloud, GaussianData, GaussianKind, OnInvalid, Projection, Scene,
    Settings, Shape, Sort, SplatCloud,
};
use surfel_render::{Frame, Identity, Planes, Renderer as _, View};
use surfel_wgpu::{GpuPath, HostDepth, HostTarget, Options, Renderer};

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
    // Balls need more buffers than WebGPU's core limits have.
    let buffers = adapter.limits().max_storage_buffers_per_shader_stage;
    let required_limits = wgpu::Limits { max_storage_buffers_per_shader_stage: buffers, ..Default::default() };
    let descriptor = wgpu::DeviceDescriptor { required_features, required_limits, ..Default::default() };
    Some(pollster::block_on(adapter.request_device(&descriptor)).unwrap())
}

/// Returns renderers on the application's device: by raster hardware, which is the default here, and by compute
/// shaders.
fn renderers((device, queue): &(wgpu::Device, wgpu::Queue)) -> [Renderer; 2] {
    let raster = Renderer::from_device(device.clone(), queue.clone()).unwrap();
    let options = Options::default().with_path(GpuPath::Compute);
    [raster, Renderer::from_device_with(device.clone(), queue.clone(), &options).unwrap()]
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

/// Returns the application's colours after splats were drawn into a target cleared to `HOST` and a given depth. The
/// depth buffer has the given additional usages.
fn drawn(
    renderer: &mut Renderer,
    pair: &(wgpu::Device, wgpu::Queue),
    what: (&Scene, &Settings, &View),
    mapping: HostDepth,
    depth: (f32, wgpu::TextureUsages),
) -> Vec<[f32; 4]> {
    drawn_with_index(renderer, pair, what, mapping, depth, false).0
}

/// Returns the application's colours, and the identities that its index texture names, if it has one. An identity is
/// `None` where the texture is as the application cleared it.
fn drawn_with_index(
    renderer: &mut Renderer,
    (device, queue): &(wgpu::Device, wgpu::Queue),
    (scene, settings, view): (&Scene, &Settings, &View),
    mapping: HostDepth,
    (clear, usage): (f32, wgpu::TextureUsages),
    has_index: bool,
) -> (Vec<[f32; 4]>, Vec<Option<Identity>>) {
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
    let numbers = format(wgpu::TextureFormat::Rg32Sint, wgpu::TextureUsages::COPY_SRC);
    let numbers_view = numbers.create_view(&Default::default());
    let nothing = wgpu::Color { r: -1.0, g: -1.0, b: 0.0, a: 0.0 };
    drop(encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &numbers_view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(nothing), store },
        })],
        ..Default::default()
    }));
    let resident = renderer.upload(scene).unwrap();
    let index = has_index.then_some(&numbers_view);
    let target = HostTarget { color, color_format, depth, depth_format, mapping, index };
    let host_index = renderer.render_to_view(&mut encoder, &resident, view, settings, &target).unwrap();
    let size = u64::from(16 * SIZE[0] * SIZE[1]);
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
    let buffer = device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(16 * SIZE[0]), rows_per_image: None };
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
        texture.size(),
    );
    let size = u64::from(8 * SIZE[0] * SIZE[1]);
    let of_numbers =
        device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false });
    let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(8 * SIZE[0]), rows_per_image: None };
    encoder.copy_texture_to_buffer(
        numbers.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &of_numbers, layout },
        numbers.size(),
    );
    queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
    of_numbers.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let view = buffer.get_mapped_range(..).unwrap();
    let pairs = of_numbers.get_mapped_range(..).unwrap();
    let pairs: &[[i32; 2]] = bytemuck::cast_slice(&pairs);
    let identity = |pair: &[i32; 2]| (*pair != [-1, -1]).then(|| host_index.identity(&resident, *pair));
    (bytemuck::cast_slice(&view).to_vec(), pairs.iter().map(identity).collect())
}

#[test]
fn host_target_gets_the_frame_s_colours_where_its_depth_test_lets_them() {
    let Some(pair) = device() else { return };
    for mut renderer in renderers(&pair) {
        colours_pass_the_depth_test(&mut renderer, &pair);
    }
}

fn colours_pass_the_depth_test(renderer: &mut Renderer, pair: &(wgpu::Device, wgpu::Queue)) {
    let perspective = view(Projection::Perspective { fov_y_deg: 60.0 });
    let orthographic = view(Projection::Orthographic { height: 3.0 });
    let linear = HostDepth { offset: -0.5 / 9.5, scale: 1.0 / 9.5, compare: wgpu::CompareFunction::Less };
    // Depth of a wall 3 units away, between the disks, in each application's mapping; and the clear value behind
    // everything.
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
            let pixels = drawn(renderer, pair, what, mapping, (clear, wgpu::TextureUsages::empty()));
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

/// Returns the depth with which pixel `i` of a frame passes the application's depth test if the image is composited
/// from planes. It is the pixel's own depth or, without one, the nearest of its neighbours.
fn tested_depth(frame: &Frame, i: usize) -> f32 {
    let [width, height] = SIZE.map(|side| side as usize);
    if frame.depth()[i].is_finite() {
        return frame.depth()[i];
    }
    let (x, y) = (i % width, i / width);
    let rows = y.saturating_sub(1)..(y + 2).min(height);
    let neighbours = rows.flat_map(|y| (x.saturating_sub(1)..(x + 2).min(width)).map(move |x| y * width + x));
    neighbours.map(|at| frame.depth()[at]).fold(f32::INFINITY, f32::min)
}

/// Returns the disks of `scene`, with a ball between and before them.
fn balls() -> Scene {
    let mut scene = scene();
    let cloud = SplatCloud::balls(&[[0.0, 0.3, 0.5]], &[0.4]).unwrap().with_colors(&[[0.2, 0.9, 0.3]]).unwrap();
    scene.objects.push(surfel_model::Object::from(cloud));
    scene
}

/// Returns trained Gaussians before the eye, at these distances.
fn gaussians(distances: &[f32]) -> Scene {
    let count = distances.len();
    let data = GaussianData {
        origin: DVec3::ZERO,
        centers: Column3::from_f32(distances.iter().map(|d| Vec3::new(0.1 * d, 0.0, 3.0 - d)).collect()),
        kind: GaussianKind::Flat,
        sigmas: distances.iter().map(|d| [0.15 * d, 0.1 * d, 0.0]).collect(),
        rotations: vec![[0.0, 0.0, 0.0, 1.0]; count],
        opacities: vec![0.8; count],
        degree: 0,
        harmonics: distances.iter().map(|d| [0.9 - 0.3 * d, 0.4, 0.2 * d]).collect(),
        linear_colors: true,
        up: None,
    };
    Scene::from(GaussianCloud::new(data, OnInvalid::Refuse).unwrap().0)
}

#[test]
fn edges_by_samples_and_balls_equal_those_of_a_frame_over_the_host_s_colours() {
    let Some(pair) = device() else { return };
    for mut renderer in renderers(&pair) {
        edges_and_balls_equal_a_frame_s(&mut renderer, &pair);
    }
}

fn edges_and_balls_equal_a_frame_s(renderer: &mut Renderer, pair: &(wgpu::Device, wgpu::Queue)) {
    let view = view(Projection::Perspective { fov_y_deg: 60.0 });
    let samples = Settings::default().with_edge_aa(EdgeAa::Samples);
    let peeled = samples.with_transparency("peel:4".parse().unwrap());
    let layers = panes(&[(2.0, 0.5), (2.5, 0.25), (2.7, 1.0)]);
    let coverage = Settings::default().with_edge_aa(EdgeAa::Coverage);
    let mut weighed = scene();
    weighed.objects[0].material.interior_weight = Some(1.0);
    let frames = [
        (weighed, &coverage),
        (scene(), &samples),
        (balls(), &Settings::default()),
        (balls(), &samples),
        (layers, &peeled),
    ];
    for (scene, settings) in frames {
        let resident = renderer.upload(&scene).unwrap();
        let mut frame = Frame::default();
        renderer.render_into(&resident, &view, settings, Planes::ALL, &mut frame).unwrap();
        // The background isn't drawn into the application's target.
        let scene = Scene { background: [1.0; 4], ..scene };
        // The application's wall is behind all splats, between the disks, and before all splats.
        for (clear, farthest) in [(0.0, f32::INFINITY), (0.5 / 3.0, 3.0), (1.0, 0.0)] {
            let usage = wgpu::TextureUsages::TEXTURE_BINDING;
            let mapping = HostDepth::reversed(0.5);
            let pixels = drawn(renderer, pair, (&scene, settings, &view), mapping, (clear, usage));
            let (mut partial, mut shown) = (0, 0);
            for (i, pixel) in pixels.iter().enumerate() {
                let color = frame.color()[i];
                let passes = color[3] > 0.0 && tested_depth(&frame, i) < farthest;
                shown += usize::from(passes);
                partial += usize::from(passes && color[3] < 1.0);
                let over = |k: usize| color[k] + (1.0 - color[3]) * HOST[k] as f32;
                let want = if passes { std::array::from_fn(over) } else { HOST.map(|c| c as f32) };
                // The frame's sums may be those of compute shaders: they differ by the order of f32 sums.
                let is_close = pixel.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-5);
                assert!(is_close, "{clear} at {i}: {pixel:?} {want:?}");
            }
            assert_eq!(shown == 0, farthest == 0.0);
            assert!(shown == 0 || partial > 10 || settings.edge_aa != EdgeAa::Samples, "{partial} of {shown}");
        }
    }
}

#[test]
fn gaussians_are_cut_off_by_the_host_s_geometry() {
    let Some(pair) = device() else { return };
    let mut renderer = Renderer::from_device(pair.0.clone(), pair.1.clone()).unwrap();
    let settings = Settings::default();
    let view = view(Projection::Perspective { fov_y_deg: 60.0 });
    let frame = |renderer: &mut Renderer, scene: &Scene| {
        let resident = renderer.upload(scene).unwrap();
        let mut frame = Frame::default();
        let planes = Planes::COLOR.with_depth(true);
        renderer.render_into(&resident, &view, &settings, planes, &mut frame).unwrap();
        frame
    };
    let (before, all) = (gaussians(&[2.0, 2.5]), gaussians(&[2.0, 2.5, 4.0]));
    let over_white = Scene { background: [1.0; 4], ..all.clone() };
    let far = 10.0 / 9.5;
    let hosts =
        [(HostDepth::reversed(0.5), [0.0, 0.5 / 3.0]), (HostDepth::usual(0.5, 10.0), [1.0, far * (1.0 - 0.5 / 3.0)])];
    for (mapping, [behind, wall]) in hosts {
        // The same fragments in the same order are blended: colours differ by the blending over the application's
        // alone.
        for (clear, wanted) in [(behind, &all), (wall, &before)] {
            let wanted = frame(&mut renderer, wanted);
            let depth = (clear, wgpu::TextureUsages::TEXTURE_BINDING);
            let pixels = drawn(&mut renderer, &pair, (&over_white, &settings, &view), mapping, depth);
            let mut tinted = 0;
            for (i, (pixel, color)) in pixels.iter().zip(wanted.color()).enumerate() {
                let want: [f32; 4] = std::array::from_fn(|k| color[k] + (1.0 - color[3]) * HOST[k] as f32);
                tinted += usize::from(color[3] > 0.5);
                let is_close = pixel.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-6);
                assert!(is_close, "{mapping:?} {clear} at {i}: {pixel:?} {want:?}");
            }
            assert!(tinted > 50, "{tinted}");
        }
        // A depth that can't be read decides about whole pixels.
        let wanted = frame(&mut renderer, &all);
        let pixels =
            drawn(&mut renderer, &pair, (&over_white, &settings, &view), mapping, (wall, wgpu::TextureUsages::empty()));
        let mut shown = 0;
        for (i, (pixel, color)) in pixels.iter().zip(wanted.color()).enumerate() {
            let passes = tested_depth(&wanted, i) < 3.0 && color[3] > 0.0;
            shown += usize::from(passes);
            let over = |k: usize| color[k] + (1.0 - color[3]) * HOST[k] as f32;
            let want: [f32; 4] = if passes { std::array::from_fn(over) } else { HOST.map(|c| c as f32) };
            assert!(pixel.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-6), "at {i}: {pixel:?} {want:?}");
        }
        assert!(shown > 50, "{shown}");
    }
}

#[test]
fn numbers_name_the_splats_that_pass_the_host_s_depth_test() {
    let Some(pair) = device() else { return };
    for mut renderer in renderers(&pair) {
        numbers_name_splats(&mut renderer, &pair);
    }
}

fn numbers_name_splats(renderer: &mut Renderer, pair: &(wgpu::Device, wgpu::Queue)) {
    let view = view(Projection::Perspective { fov_y_deg: 60.0 });
    let settings = Settings::default();
    let peeled = Settings::default().with_transparency("peel:4".parse().unwrap());
    let with_rows = |mut scene: Scene| {
        for object in &mut scene.objects {
            let surfel_model::Geometry::Splats(cloud) = &object.geometry else { continue };
            let mut data = cloud.data().clone();
            data.rows = Some((70..).take(cloud.len()).collect());
            let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
            object.geometry = surfel_model::Geometry::Splats(std::sync::Arc::new(cloud));
        }
        scene
    };
    for (scene, settings) in [(scene(), &settings), (balls(), &settings), (panes(&[(2.0, 0.5), (2.5, 1.0)]), &peeled)] {
        let scene = with_rows(scene);
        let resident = renderer.upload(&scene).unwrap();
        let mut frame = Frame::default();
        let planes = Planes::ALL.with_index(true);
        renderer.render_into(&resident, &view, settings, planes, &mut frame).unwrap();
        for (clear, farthest) in [(0.0, f32::INFINITY), (0.5 / 3.0, 3.0)] {
            let usage = wgpu::TextureUsages::TEXTURE_BINDING;
            let what = (&scene, settings, &view);
            let mapping = HostDepth::reversed(0.5);
            let (colors, found) = drawn_with_index(renderer, pair, what, mapping, (clear, usage), true);
            assert_eq!(colors, drawn(renderer, pair, what, mapping, (clear, usage)));
            let mut named = 0;
            for (i, found) in found.iter().enumerate() {
                let passes = frame.depth()[i] < farthest;
                let want = passes.then(|| (frame.index()[i], frame.object()[i]));
                assert_eq!(found.map(|found| (found.row, found.object)), want, "at {i}");
                named += usize::from(passes);
            }
            assert!(named > 50, "{named}");
        }
    }
}

#[test]
fn frames_that_need_a_readback_are_refused() {
    let Some(pair) = device() else { return };
    let mut renderer = Renderer::from_device(pair.0.clone(), pair.1.clone()).unwrap();
    let format = |format| {
        let texture = pair.0.create_texture(&wgpu::TextureDescriptor {
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
    };
    let (color_format, depth_format) = (wgpu::TextureFormat::Rgba32Float, wgpu::TextureFormat::Depth32Float);
    let (color, depth) = (format(color_format), format(depth_format));
    let mapping = HostDepth::reversed(0.5);
    let target = HostTarget { color: &color, color_format, depth: &depth, depth_format, mapping, index: None };
    let view = view(Projection::Perspective { fov_y_deg: 60.0 });
    // The passes of balls bind more storage buffers than WebGPU's core limits allow.
    let small = wgpu::Limits { max_storage_buffers_per_shader_stage: 8, ..wgpu::Limits::default() };
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let descriptor = wgpu::DeviceDescriptor { required_limits: small, ..Default::default() };
    let (device, queue) = pollster::block_on(adapters[0].request_device(&descriptor)).unwrap();
    let mut core = Renderer::from_device(device, queue).unwrap();
    let resident = core.upload(&balls()).unwrap();
    let error =
        core.render_into(&resident, &view, &Settings::default(), Planes::ALL, &mut Frame::default()).unwrap_err();
    assert!(error.to_string().contains("raise `max_storage_buffers_per_shader_stage`"), "{error}");
    let mut refused = |scene: Scene, settings: Settings, words: &str| {
        let resident = renderer.upload(&scene).unwrap();
        let mut encoder = pair.0.create_command_encoder(&Default::default());
        let refused = renderer.render_to_view(&mut encoder, &resident, &view, &settings, &target);
        let message = refused.err().map(|error| error.to_string()).unwrap_or_default();
        assert!(message.contains(words), "{message}");
    };
    let by_abuffer = Settings::default().with_transparency("abuffer:4".parse().unwrap());
    refused(panes(&[(2.0, 0.5)]), by_abuffer, "A-buffer");
    let by_pixel = Settings::default().with_sort(Sort::Pixel);
    refused(gaussians(&[2.0]), by_pixel, "choose `sort=center`");
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
    // The application's wall is 3 units away.
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
