//! Tests splats that an embedding application places from a buffer. They are drawn as if they had been uploaded at
//! these places, and cost the CPU nothing per splat.

#[path = "../examples/among_triangles.rs"]
#[allow(dead_code, reason = "the example's main isn't called")]
mod among_triangles;
#[path = "../examples/moving_splats.rs"]
#[allow(dead_code, reason = "the example's main isn't called")]
mod moving_splats;

use glam::Vec3;
use surfel_model::{Camera, EdgeAa, Scene, Settings, Shader, SplatCloud};
use surfel_render::{Frame, Planes, Renderer as _, View};
use surfel_wgpu::{GpuPath, HostAttribute, HostFormat, HostLayout, HostSplats, Options, Renderer, Storage};

/// Returns a renderer, or `None` without an adapter.
fn renderer(options: Options) -> Option<Renderer> {
    match Renderer::new(options) {
        Ok(renderer) => Some(renderer),
        Err(error) => {
            let required = std::env::var("SURFEL_REQUIRE").unwrap_or_default();
            assert!(!required.split(',').any(|word| word.trim() == "wgpu"), "SURFEL_REQUIRE asks for wgpu: {error}");
            println!("skipped: {error}");
            None
        }
    }
}

/// Splats of a test, as numbers in the application's buffer.
#[derive(Clone)]
struct Splats {
    centers: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    colors: Vec<[f32; 3]>,
    radius: f32,
}

impl Splats {
    /// Returns `count` disks on an ellipsoid, whose turn, shape and colours depend on `phase`.
    fn ball(count: u32, phase: f32) -> Self {
        let points = (0..count).map(|i| {
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
            let angle = 2.399_963_2 * i as f32 + phase;
            Vec3::new((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin(), z)
        });
        let points: Vec<Vec3> = points.collect();
        let stretch = Vec3::new(1.0, 1.0 + 0.2 * phase, 0.8);
        let color = |p: &Vec3| [0.5 + 0.4 * p.x, 0.5 + 0.2 * phase * p.y, 0.5 - 0.3 * p.z];
        Self {
            centers: points.iter().map(|p| (*p * stretch).to_array()).collect(),
            normals: points.iter().map(|p| (*p / stretch).normalize().to_array()).collect(),
            colors: points.iter().map(color).collect(),
            radius: 3.0 / (count as f32).sqrt(),
        }
    }

    fn scene(&self) -> Scene {
        let radii = vec![self.radius; self.centers.len()];
        let cloud = SplatCloud::disks(&self.centers, &self.normals, &radii).unwrap();
        Scene::from(cloud.with_colors(&self.colors).unwrap())
    }

    /// Returns the words of the application's buffer in `layout`.
    fn words(&self, layout: &HostLayout) -> Vec<u32> {
        let mut words = vec![0xdead_beef; layout.count as usize * layout.stride as usize / 4];
        let byte = |c: f32| (255.0 * c).round() as u32;
        let bytes = |c: [f32; 3]| byte(c[0]) | byte(c[1]) << 8 | byte(c[2]) << 16;
        let encoded = |c: f32| if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
        for (i, splat) in words.chunks_exact_mut(layout.stride as usize / 4).enumerate() {
            let mut put = |attribute: HostAttribute, v: [f32; 3], unit: [f32; 3]| {
                let at = attribute.offset as usize / 4;
                match attribute.format {
                    HostFormat::F32x3 => splat[at..at + 3].copy_from_slice(&v.map(f32::to_bits)),
                    _ => splat[at] = bytes(unit),
                }
            };
            put(HostAttribute { offset: layout.position, format: HostFormat::F32x3 }, self.centers[i], [0.0; 3]);
            if let Some(normal) = layout.normal {
                // The application's normals may have any length.
                put(normal, self.normals[i].map(|c| 2.5 * c), self.normals[i].map(|c| 0.5 * c + 0.5));
            }
            if let Some(color) = layout.color {
                let is_encoded = color.format == HostFormat::Srgb8x4;
                put(color, self.colors[i], self.colors[i].map(|c| if is_encoded { encoded(c) } else { c }));
            }
        }
        words
    }
}

const BOUNDS: [[f32; 3]; 2] = [[-1.5; 3], [1.5; 3]];

fn layout(count: usize) -> HostLayout {
    HostLayout {
        count: count as u32,
        stride: 40,
        position: 4,
        normal: Some(HostAttribute { offset: 16, format: HostFormat::F32x3 }),
        color: Some(HostAttribute { offset: 28, format: HostFormat::F32x3 }),
        bounds: BOUNDS,
    }
}

fn buffer(renderer: &Renderer, words: &[u32]) -> wgpu::Buffer {
    let buffer = renderer.device().create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 4 * words.len() as u64,
        usage: wgpu::BufferUsages::STORAGE,
        mapped_at_creation: true,
    });
    buffer.get_mapped_range_mut(..).unwrap().copy_from_slice(bytemuck::cast_slice(words));
    buffer.unmap();
    buffer
}

fn view() -> View {
    View::new(&Camera::perspective([0.4, 0.9, 3.2], [0.0; 3], 40.0, [96, 72])).unwrap()
}

/// Compares two frames. The two differ by the rounding of centres to f32, about the chunk or about the object: 2⁻²⁴ of
/// the extent, which is 1e-6 of a radius and changes weights by a few times as much. In a few pixels, a fragment at the
/// rim of a splat or at the depth tolerance may be drawn in one frame and not in the other.
fn compare(got: &Frame, want: &Frame, what: &str) {
    let mut flipped = 0;
    let mut covered = 0;
    for i in 0..want.color().len() {
        let (a, b) = (got.color()[i], want.color()[i]);
        let (y, z) = (got.depth()[i], want.depth()[i]);
        covered += usize::from(z.is_finite());
        let same_depth = y == z || (y - z).abs() < 1e-4;
        let is_close = a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-4) && same_depth;
        flipped += usize::from(!is_close);
    }
    assert!(covered > 1000, "{what}: {covered}");
    assert!(flipped <= 3, "{what}: {flipped} pixels of {covered} differ");
}

#[test]
fn placed_splats_are_drawn_as_if_they_had_been_uploaded() {
    for path in [GpuPath::Compute, GpuPath::Raster] {
        let Some(mut renderer) = renderer(Options::default().with_path(path)) else { return };
        let (start, later) = (Splats::ball(3000, 0.0), [Splats::ball(3000, 0.7), Splats::ball(3000, 1.6)]);
        let layout = layout(3000);
        let mut resident = renderer.upload(&start.scene()).unwrap();
        let planes = Planes::ALL;
        for edge_aa in [EdgeAa::Off, EdgeAa::Samples] {
            let settings = Settings::default().with_shader(Shader::Phong).with_edge_aa(edge_aa);
            for splats in &later {
                let host = buffer(&renderer, &splats.words(&layout));
                renderer.place_splats(&mut resident, 0, &HostSplats { buffer: &host, layout }).unwrap();
                let (mut got, mut want) = (Frame::default(), Frame::default());
                renderer.render_into(&resident, &view(), &settings, planes, &mut got).unwrap();
                let uploaded = renderer.upload(&splats.scene()).unwrap();
                renderer.render_into(&uploaded, &view(), &settings, planes, &mut want).unwrap();
                compare(&got, &want, &format!("{path:?} {edge_aa:?}"));
            }
        }
    }
}

#[test]
fn index_of_a_placed_splat_is_its_place_in_the_buffer() {
    for path in [GpuPath::Compute, GpuPath::Raster] {
        let Some(mut renderer) = renderer(Options::default().with_path(path)) else { return };
        let (start, later) = (Splats::ball(3000, 0.0), Splats::ball(3000, 0.7));
        let mut scene = start.scene();
        let rows = |scene: &mut Scene| {
            let surfel_model::Geometry::Splats(cloud) = &scene.objects[0].geometry else { panic!() };
            let mut data = cloud.data().clone();
            data.rows = Some((0..3000).collect());
            let cloud = SplatCloud::new(data, surfel_model::OnInvalid::Refuse).unwrap().0;
            *scene = Scene::from(cloud);
        };
        rows(&mut scene);
        let mut resident = renderer.upload(&scene).unwrap();
        let layout = layout(3000);
        let host = buffer(&renderer, &later.words(&layout));
        renderer.place_splats(&mut resident, 0, &HostSplats { buffer: &host, layout }).unwrap();
        let (mut got, mut want) = (Frame::default(), Frame::default());
        let planes = Planes::COLOR.with_index(true);
        renderer.render_into(&resident, &view(), &Settings::default(), planes, &mut got).unwrap();
        let mut scene = later.scene();
        rows(&mut scene);
        let uploaded = renderer.upload(&scene).unwrap();
        renderer.render_into(&uploaded, &view(), &Settings::default(), planes, &mut want).unwrap();
        let differ = got.index().iter().zip(want.index()).filter(|(a, b)| a != b).count();
        assert!(differ <= 3, "{path:?}: {differ} pixels");
    }
}

#[test]
fn formats_of_the_host_s_buffer_are_read_as_stated() {
    let Some(mut renderer) = renderer(Options::default()) else { return };
    let splats = Splats::ball(3000, 0.7);
    let at = |offset, format| Some(HostAttribute { offset, format });
    let formats = [
        (HostFormat::F32x3, HostFormat::Unorm8x4),
        (HostFormat::F32x3, HostFormat::Srgb8x4),
        (HostFormat::Unorm8x4, HostFormat::F32x3),
    ];
    let settings = Settings::default().with_shader(Shader::Phong);
    for (normal, color) in formats {
        let stride = 12 + normal.bytes() + color.bytes();
        let (normal, color) = (at(12, normal), at(12 + normal.bytes(), color));
        let layout = HostLayout { stride, position: 0, normal, color, ..layout(3000) };
        let mut resident = renderer.upload(&Splats::ball(3000, 0.0).scene()).unwrap();
        let host = buffer(&renderer, &splats.words(&layout));
        renderer.place_splats(&mut resident, 0, &HostSplats { buffer: &host, layout }).unwrap();
        let got = renderer.render(&resident, &camera(), &settings).unwrap();
        let uploaded = renderer.upload(&splats.scene()).unwrap();
        let want = renderer.render(&uploaded, &camera(), &settings).unwrap();
        // Half a step of 8 bits: 1/510 of a linear colour, 2.3 times as much of the steepest part of sRGB's curve. A
        // normal turns by up to √3/255, and a sum of highlights by Phong of shininess 10 or so by ten times as much; so
        // pixels are compared in the mean.
        let error: f32 =
            got.color().iter().flatten().zip(want.color().iter().flatten()).map(|(a, b)| (a - b).abs()).sum();
        let mean = error / (4 * got.color().len()) as f32;
        assert!(mean < 1.5e-3, "{normal:?} {color:?}: {mean}");
        assert!(mean > 1e-7, "{normal:?} {color:?}: 8 bits differ from 32");
    }
    // What the buffer doesn't have stays as it was uploaded.
    let kept = Splats { centers: splats.centers.clone(), ..Splats::ball(3000, 0.0) };
    let layout = HostLayout { normal: None, color: None, ..layout(3000) };
    let mut resident = renderer.upload(&Splats::ball(3000, 0.0).scene()).unwrap();
    let host = buffer(&renderer, &splats.words(&layout));
    renderer.place_splats(&mut resident, 0, &HostSplats { buffer: &host, layout }).unwrap();
    let (mut got, mut want) = (Frame::default(), Frame::default());
    renderer.render_into(&resident, &view(), &settings, Planes::ALL, &mut got).unwrap();
    let uploaded = renderer.upload(&kept.scene()).unwrap();
    renderer.render_into(&uploaded, &view(), &settings, Planes::ALL, &mut want).unwrap();
    compare(&got, &want, "positions alone");
}

fn camera() -> Camera {
    Camera::perspective([0.4, 0.9, 3.2], [0.0; 3], 40.0, [96, 72])
}

#[test]
fn splats_that_are_nowhere_or_too_near_aren_t_drawn() {
    for path in [GpuPath::Compute, GpuPath::Raster] {
        let Some(mut renderer) = renderer(Options::default().with_path(path)) else { return };
        let splats = Splats::ball(3000, 0.7);
        let layout = layout(3000);
        let drawn = |renderer: &mut Renderer, words: &[u32], layout: HostLayout, eye: f64| {
            let mut resident = renderer.upload(&splats.scene()).unwrap();
            let host = buffer(renderer, words);
            renderer.place_splats(&mut resident, 0, &HostSplats { buffer: &host, layout }).unwrap();
            let mut camera = Camera::perspective([0.0, 0.0, eye], [0.0, 0.0, eye - 1.0], 120.0, [96, 72]);
            camera.near = 1.0;
            let mut frame = Frame::default();
            let stats = renderer
                .render_into(&resident, &View::new(&camera).unwrap(), &Settings::default(), Planes::ALL, &mut frame)
                .unwrap();
            assert!(frame.color().iter().flatten().all(|c| c.is_finite()), "{path:?}");
            stats.drawn
        };
        let words = splats.words(&layout);
        assert_eq!(drawn(&mut renderer, &words, layout, 5.0), 3000);
        assert_eq!(drawn(&mut renderer, &words, HostLayout { count: 2000, ..layout }, 5.0), 2000);
        let mut broken = words.clone();
        // A centre that isn't finite, one outside of the box, normals that aren't finite or 0, an infinite colour.
        let values = [(1, f32::NAN), (3, 1.9), (4, f32::INFINITY), (7, f32::INFINITY)];
        for (i, (word, value)) in values.into_iter().enumerate() {
            broken[10 * i + word] = f32::to_bits(value);
        }
        broken[44..47].fill(0);
        assert_eq!(drawn(&mut renderer, &broken, layout, 5.0), 3000 - 5);
        // Only splats behind a near plane at 1 unit are drawn, which the ball reaches through; one may round to it.
        let inside = drawn(&mut renderer, &words, layout, 1.7);
        let beyond = splats.centers.iter().filter(|center| 1.7 - center[2] > 1.0).count() as u64;
        assert!(inside > 500 && inside <= beyond + 1, "{path:?}: {inside} of {beyond}");
        // The box decides whether the object is drawn.
        let beside = HostLayout { bounds: [[90.0; 3], [91.0; 3]], ..layout };
        assert_eq!(drawn(&mut renderer, &words, beside, 5.0), 0);
    }
}

#[test]
fn host_s_mistakes_are_refused_in_words() {
    let Some(mut renderer) = renderer(Options::default()) else { return };
    let splats = Splats::ball(100, 0.7);
    let mut resident = renderer.upload(&splats.scene()).unwrap();
    let host = buffer(&renderer, &splats.words(&layout(100)));
    let mut refused = |layout: HostLayout, object, buffer: &wgpu::Buffer, words: &str| {
        let error = renderer.place_splats(&mut resident, object, &HostSplats { buffer, layout }).unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
    };
    refused(HostLayout { stride: 30, ..layout(100) }, 0, &host, "the stride is 30 bytes");
    refused(HostLayout { count: 101, ..layout(100) }, 0, &host, "but the buffer has 4000");
    refused(layout(100), 1, &host, "no splats of object 1");
    let descriptor = wgpu::BufferDescriptor {
        label: None,
        size: 4000,
        usage: wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    };
    let unreadable = renderer.device().create_buffer(&descriptor);
    let unreadable = HostSplats { buffer: &unreadable, layout: layout(100) };
    let error = renderer.place_splats(&mut resident, 0, &unreadable).unwrap_err();
    assert!(error.to_string().contains("lacks the usage STORAGE"), "{error}");
    let options = Options::default().with_storage(Storage::Quantised);
    let mut renderer = Renderer::new(options).unwrap();
    let mut resident = renderer.upload(&splats.scene()).unwrap();
    let host = buffer(&renderer, &splats.words(&layout(100)));
    let splats = HostSplats { buffer: &host, layout: layout(100) };
    let error = renderer.place_splats(&mut resident, 0, &splats).unwrap_err();
    assert!(error.to_string().contains("Storage::F32"), "{error}");
}

#[test]
fn moving_splats_cost_the_cpu_the_same_however_many_they_are() {
    if renderer(Options::default()).is_none() {
        return;
    }
    // The example draws into the application's target; frames after the first upload neither splats nor their order.
    let [(pixels, few), (_, many)] = [64, 256].map(|side| moving_splats::run(side, 3).unwrap());
    assert_eq!(few[1..], many[1..]);
    assert_eq!(few[1], few[2]);
    let moving_splats::FrameCost { written_bytes, splats, chunks } = few[1];
    assert_eq!((splats, chunks), (0, 1));
    assert!(written_bytes < 4096, "{written_bytes}");
    // The first frame uploads the order of the splats.
    assert_eq!(many[0].written_bytes - few[0].written_bytes, 4 * (256 * 256 - 64 * 64));
    // Orange triangle and blue waves.
    let count = |is: fn(&[f32; 4]) -> bool| pixels.iter().filter(|pixel| is(pixel)).count();
    let (triangle, waves) = (count(|c| c[0] > 0.85 && c[2] < 0.15), count(|c| c[2] > c[0] && c[2] > 0.1));
    assert!(triangle > 2000 && waves > 10_000, "{triangle} {waves}");
    // Frames that are read back cost no more either.
    let cost = |count: u32| {
        let mut renderer = Renderer::new(Options::default()).unwrap();
        let splats = Splats::ball(count, 0.7);
        let layout = layout(count as usize);
        let mut resident = renderer.upload(&splats.scene()).unwrap();
        let host = buffer(&renderer, &splats.words(&layout));
        let mut costs = Vec::new();
        for _ in 0..2 {
            let before = (renderer.written_bytes(), renderer.host_work());
            renderer.place_splats(&mut resident, 0, &HostSplats { buffer: &host, layout }).unwrap();
            renderer.render(&resident, &camera(), &Settings::default()).unwrap();
            let work = renderer.host_work();
            costs.push((
                renderer.written_bytes() - before.0,
                work.splats - before.1.splats,
                work.chunks - before.1.chunks,
            ));
        }
        costs[1]
    };
    let (few, many) = (cost(1000), cost(20_000));
    assert_eq!(few, many);
    assert_eq!((few.1, few.2), (0, 1));
}

#[test]
fn example_among_triangles_runs() {
    if renderer(Options::default()).is_none() {
        return;
    }
    let path = std::env::temp_dir().join(format!("among-triangles-{}.png", std::process::id()));
    among_triangles::run(&path).unwrap();
    assert!(std::fs::metadata(&path).unwrap().len() > 1000);
    std::fs::remove_file(&path).unwrap();
}
