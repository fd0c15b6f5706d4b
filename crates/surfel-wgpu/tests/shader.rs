//! Tests shader functions of an embedding application: they get the surface that `phong` gets, on both paths, and
//! errors name their line.

use surfel_model::{Camera, EdgeAa, Light, Scene, Settings, Shader, SplatCloud};
use surfel_render::{Frame, Planes, Renderer as _, View};
use surfel_wgpu::{GpuPath, Options, Renderer};

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

/// Returns two tilted disks, one of them in part behind the other.
fn scene() -> Scene {
    let normals = [[0.3, 0.1, 1.0], [-0.4, 0.2, 1.0]];
    let cloud = SplatCloud::disks(&[[-0.4, 0.0, 0.5], [0.4, 0.1, -0.5]], &normals, &[0.7, 0.9]).unwrap();
    let mut scene = Scene::from(cloud.with_colors(&[[0.9, 0.3, 0.1], [0.2, 0.5, 0.8]]).unwrap());
    let light = |shadow| Light::Directional { direction: [-0.5, -0.6, -1.0], color: [0.9; 3], shadow };
    scene.lights = Some(vec![light(false)]);
    scene
}

fn view() -> View {
    View::new(&Camera::perspective([0.2, 0.3, 3.0], [0.0; 3], 50.0, [64, 48])).unwrap()
}

fn drawn(renderer: &mut Renderer, scene: &Scene, settings: &Settings) -> Frame {
    let resident = renderer.upload(scene).unwrap();
    let mut frame = Frame::default();
    renderer.render_into(&resident, &view(), settings, Planes::ALL.with_position(true), &mut frame).unwrap();
    frame
}

/// A shader whose colour is a sum of all attributes, which the test computes from the planes, too.
const ATTRIBUTES: &str = "
const SCALE = 0.25;

fn packed(v: vec3f) -> vec3f {
    return v * SCALE + 0.5;
}

fn host_color(surface: HostSurface) -> vec3f {
    let forward = dot(surface.position, surface.to_eye) / length(surface.position);
    let rest = vec3f(surface.depth, surface.albedo.g, -forward);
    return packed(surface.normal) + rest + surface.position + surface.material.xyz;
}
";

#[test]
fn function_of_a_host_gets_the_attributes_of_the_planes() {
    for path in [GpuPath::Compute, GpuPath::Raster] {
        let Some(mut renderer) = renderer(Options::default().with_path(path)) else { return };
        let phong = Settings::default().with_shader(Shader::Phong);
        let plain = drawn(&mut renderer, &scene(), &phong);
        let albedo = drawn(&mut renderer, &scene(), &Settings::default().with_shader(Shader::Unlit));
        // The colour of `phong` itself.
        let lit = "fn host_color(surface: HostSurface) -> vec3f { return 0.5 * surface.lit; }";
        renderer.set_shader(Some(lit)).unwrap();
        let half = drawn(&mut renderer, &scene(), &phong);
        let halves = half.color().iter().zip(plain.color());
        let close = |a: &[f32; 4], b: &[f32; 4]| (0..3).all(|i| (a[i] - 0.5 * b[i]).abs() < 1e-6) && a[3] == b[3];
        assert!(halves.clone().all(|(a, b)| close(a, b)), "{path:?}");
        assert!(halves.filter(|(_, b)| b[3] > 0.0).count() > 300, "{path:?}");
        // Its attributes.
        renderer.set_shader(Some(ATTRIBUTES)).unwrap();
        let shown = drawn(&mut renderer, &scene(), &phong);
        let material = scene().objects[0].material.factors();
        let view = view();
        let mut pixels = 0;
        for i in 0..plain.color().len() {
            if plain.color()[i][3] <= 0.0 {
                continue;
            }
            pixels += 1;
            let (normal, z) = (plain.normal()[i], plain.depth()[i]);
            let at: [f64; 3] = plain.position()[i];
            let position: [f64; 3] = std::array::from_fn(|k| at[k] - view.eye.to_array()[k]);
            let more = [f64::from(z), f64::from(albedo.color()[i][1]), 1.0];
            for k in 0..3 {
                let want = 0.25 * f64::from(normal[k]) + 0.5 + more[k] + position[k] + material[k];
                // A dozen operations in f32 on numbers up to 4.
                assert!((f64::from(shown.color()[i][k]) - want).abs() < 1e-5, "{path:?} {i} {k}");
            }
        }
        assert!(pixels > 300, "{pixels}");
        // Other shaders of the settings, and `phong` once the text is gone, are as before.
        let unlit = drawn(&mut renderer, &scene(), &Settings::default().with_shader(Shader::Unlit));
        assert_eq!(unlit.color(), albedo.color(), "{path:?}");
        renderer.set_shader(None).unwrap();
        assert_eq!(drawn(&mut renderer, &scene(), &phong).color(), plain.color(), "{path:?}");
    }
}

#[test]
fn function_of_a_host_colours_edges_layers_and_shadows() {
    let Some(mut renderer) = renderer(Options::default()) else { return };
    let phong = Settings::default().with_shader(Shader::Phong);
    let mut shadowed = scene();
    for light in shadowed.lights.iter_mut().flatten() {
        if let Light::Directional { shadow, .. } = light {
            *shadow = true;
        }
    }
    let surfel_model::Geometry::Splats(cloud) = &scene().objects[0].geometry else { panic!() };
    let mut data = cloud.data().clone();
    data.alphas = Some(vec![0.5, 1.0]);
    let transparent = SplatCloud::new(data, surfel_model::OnInvalid::Refuse).unwrap().0;
    let mut transparent = Scene::from(transparent);
    transparent.lights = scene().lights;
    let cases = [
        (scene(), phong.with_edge_aa(EdgeAa::Samples)),
        (shadowed, phong),
        (transparent, phong.with_transparency("peel:2".parse().unwrap())),
    ];
    let plain: Vec<Frame> = cases.iter().map(|(scene, settings)| drawn(&mut renderer, scene, settings)).collect();
    let lit = "fn host_color(surface: HostSurface) -> vec3f { return 0.5 * surface.lit; }";
    renderer.set_shader(Some(lit)).unwrap();
    for (i, ((scene, settings), plain)) in cases.iter().zip(&plain).enumerate() {
        let half = drawn(&mut renderer, scene, settings);
        for (a, b) in half.color().iter().zip(plain.color()) {
            assert!((0..3).all(|k| (a[k] - 0.5 * b[k]).abs() < 1e-6) && a[3] == b[3], "{i}: {a:?} {b:?}");
        }
    }
}

#[test]
fn mistakes_in_a_text_are_named_with_their_line() {
    let Some(mut renderer) = renderer(Options::default()) else { return };
    let phong = Settings::default().with_shader(Shader::Phong);
    let plain = drawn(&mut renderer, &scene(), &phong);
    let wrong = [
        (
            "// A comment.\nfn host_color(surface: HostSurface) -> vec3f {\n    return surface.albedo * colour;\n}",
            "in line 3",
        ),
        ("fn host_color(surface: HostSurface) -> vec3f {\n    return surface.albdo;\n}", "in line 2"),
        ("fn host_color(surface: HostSurface) -> vec3f {\n    return 1.0;\n}", "in line"),
        ("fn host_color(surface: HostSurface) -> vec3f {\n    return surface.albedo\n}", "in line"),
        ("fn color(surface: HostSurface) -> vec3f { return surface.albedo; }", "has to define `fn host_color("),
        ("fn host_color(surface: HostSurface) -> vec3f { return dpdx(surface.albedo); }", "isn't valid"),
        ("@group(1) @binding(0) var<uniform> mine: vec4f;", "`@group` in line 1"),
        ("", "has to define `fn host_color("),
    ];
    for (text, words) in wrong {
        let message = renderer.set_shader(Some(text)).unwrap_err().to_string();
        println!("{message}\n");
        assert!(message.contains(words), "{text}\n{message}");
    }
    // The shader is the one before.
    assert_eq!(drawn(&mut renderer, &scene(), &phong).color(), plain.color());
}
