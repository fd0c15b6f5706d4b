//! Interface that programs rely on: the front page's program, threads, and a root module that fits on a page.

use surfel_backend::Backend;
use surfel_model::{Camera, Scene, Settings, SplatCloud};
use surfel_render::{Frame, Planes, Renderer, Stats, View};

/// The front page's program, with its own output name.
#[test]
fn front_page_program_draws_two_disks() -> Result<(), Box<dyn std::error::Error>> {
    let (centers, normals, radii) = ([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]], [[0.0, 0.0, 1.0]; 2], [0.6, 0.6]);
    let colors = [[0.8, 0.2, 0.1], [0.1, 0.3, 0.8]];
    let out = std::env::temp_dir().join(format!("surfel-program-{}.png", std::process::id()));

    let cloud = SplatCloud::disks(&centers, &normals, &radii)?.with_colors(&colors)?;
    let scene = Scene::from(cloud);
    let camera = Camera::perspective([0., 0., 3.], [0.; 3], 45.0, [800, 600]);
    let mut backend = Backend::auto()?;
    let resident = backend.upload(&scene)?;
    let frame = backend.render(&resident, &camera, &Settings::default())?;
    frame.save_png(&out)?;

    let image = surfel_io::read_image(&out)?;
    std::fs::remove_file(&out)?;
    let color = image.color.ok_or("a PNG has colours")?;
    let at = |x: usize| color[300 * 800 + x];
    // 8-bit sRGB: half a level.
    let close = |found: [f32; 4], want: [f32; 3]| (0..3).all(|c| (found[c] - want[c]).abs() < 0.005) && found[3] == 1.0;
    assert!(close(at(280), colors[0]) && close(at(520), colors[1]), "{:?} {:?}", at(280), at(520));
    assert_eq!(at(5), [0.0; 4]);
    Ok(())
}

/// The long form of rendering, on which the short one is built: reused frame, more planes, and a region.
#[test]
fn longer_form_gives_the_short_one_s_colours_and_more() -> Result<(), Box<dyn std::error::Error>> {
    let cloud = SplatCloud::disks(&[[0.0, 0.0, 0.0]], &[[0.0, 0.0, 1.0]], &[0.6])?;
    let camera = Camera::perspective([0., 0., 3.], [0.; 3], 45.0, [40, 30]);
    let mut backend = Backend::auto()?;
    let resident = backend.upload(&Scene::from(cloud))?;
    let short = backend.render(&resident, &camera, &Settings::default())?;
    let mut frame = Frame::default();
    let planes = Planes::COLOR.with_depth(true);
    let stats: Stats =
        backend.render_into(&resident, &View::new(&camera)?, &Settings::default(), planes, &mut frame)?;
    assert_eq!((frame.color(), stats.splats), (short.color(), 1));
    assert!(short.depth().is_empty() && (frame.depth()[15 * 40 + 20] - 3.0).abs() < 1e-5);
    Ok(())
}

#[test]
fn scenes_and_renderers_go_where_threads_are() {
    fn shared<T: Send + Sync>() {}
    fn sent<T: Send>() {}
    shared::<SplatCloud>();
    shared::<Scene>();
    shared::<surfel_model::Octree>();
    shared::<surfel_model::Mesh>();
    shared::<Settings>();
    shared::<Camera>();
    shared::<View>();
    shared::<Planes>();
    shared::<Frame>();
    shared::<Stats>();
    shared::<surfel_load::Error>();
    shared::<surfel_stage::LoadedScene>();
    shared::<surfel_load::LoadedCloud>();
    shared::<surfel_render::FramePlan>();
    shared::<surfel_render::SceneSummary>();
    sent::<Backend>();
    sent::<surfel_backend::BackendScene>();
    #[cfg(feature = "cpu")]
    {
        sent::<surfel_cpu::Renderer>();
        shared::<surfel_cpu::ResidentScene>();
    }
    #[cfg(feature = "reference")]
    {
        sent::<surfel_reference::Renderer>();
        shared::<surfel_reference::ResidentScene>();
    }
    #[cfg(feature = "wgpu")]
    {
        sent::<surfel_wgpu::Renderer>();
        sent::<surfel_wgpu::ResidentScene>();
    }
    #[cfg(feature = "ash")]
    {
        sent::<surfel_ash::Renderer>();
        sent::<surfel_ash::ResidentScene>();
    }
}

/// Items that programs use only once are in modules, not in the root.
#[test]
fn root_fits_on_a_page_and_shows_no_internals() {
    let text = include_str!("../src/lib.rs");
    let uses: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("pub use ")).collect();
    let joined = text.split("pub use ").skip(1).map(|item| item.split(';').next().unwrap_or_default());
    let names: Vec<String> = joined
        .flat_map(|item| match item.split_once('{') {
            Some((_, list)) => list.split(',').map(|name| name.trim_matches([' ', '\n', '}']).to_owned()).collect(),
            None => vec![item.rsplit([':', ' ']).next().unwrap_or_default().to_owned()],
        })
        .filter(|name: &String| !name.is_empty())
        .collect();
    assert!(uses.len() > 5 && names.iter().any(|name| name == "Backend") && names.iter().any(|name| name == "io"));
    // Modules are the packages behind the facade.
    let modules = uses.iter().filter(|item| item.contains(" as ")).count();
    assert!(modules <= 8 && !text.contains("\nmod ") && !text.contains("pub mod "), "{modules}");
    assert!((20..=35).contains(&(names.len() - modules)), "{} names: {names:?}", names.len());
}
