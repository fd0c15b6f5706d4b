//! Tests that sizes of tiles and cells, occlusion culling, and tiny splats change the speed, but no bit of an image.

use crate::scenes::{ellipses, everything, haze, specks, view, walls};
use surfel_cpu::{Options, Renderer, Tuning};
use surfel_model::{Camera, ClipPolicy, EdgeAa, Filter, Mapping, Scene, Settings, Shader, Transparency};
use surfel_render::{Frame, Planes, Region, Renderer as _, Stats, View};

fn all() -> Planes {
    Planes::ALL.with_fragments(true)
}

fn draw(tuning: Tuning, scene: &Scene, view: &View, settings: &Settings, planes: Planes) -> (Vec<u32>, Stats) {
    let mut renderer = Renderer::new(Options::default().with_threads(2)).unwrap();
    renderer.set_tuning(tuning);
    let resident = renderer.upload(scene).unwrap();
    let mut frame = Frame::default();
    let stats = renderer.render_into(&resident, view, settings, planes, &mut frame).unwrap();
    let floats = frame.color().as_flattened().iter().chain(frame.normal().as_flattened());
    let floats = floats.chain(frame.depth()).chain(frame.weight()).map(|v| v.to_bits());
    (floats.chain(frame.fragments().iter().copied()).collect(), stats)
}

fn counter(stats: &Stats, name: &str) -> f64 {
    stats.counters.iter().find(|counter| counter.0 == name).map_or(f64::NAN, |counter| counter.1)
}

/// Returns settings with different passes, for scenes with or without transparent splats.
fn settings() -> Vec<Settings> {
    let layers = Transparency::Peel { layers: 2, drop_last: false };
    vec![
        Settings::default().with_shader(Shader::Phong),
        Settings::default().with_shader(Shader::Toon).with_edge_aa(EdgeAa::Coverage).with_transparency(layers),
        Settings::default().with_shader(Shader::Edl).with_transparency(layers),
    ]
}

/// A scene, view and settings to draw.
struct Case {
    name: &'static str,
    scene: Scene,
    view: View,
    settings: Settings,
}

/// Returns cases with every kind of geometry, evaluator and pass: a whole image whose near plane cuts the mesh and some
/// splats, a region that begins within a tile, and a parallel projection.
fn cases() -> Vec<Case> {
    let camera = |near| Camera::perspective([0.1, 0.2, 4.0], [0.0; 3], 45.0, [100, 70]).with_near(near);
    let whole = View::new(&camera(2.9)).unwrap();
    let part = View::of_region(&camera(0.1), Some(Region { x: 13, y: 6, width: 62, height: 45 })).unwrap();
    let parallel = Camera::orthographic([0.1, 0.2, 4.0], [0.0; 3], 3.0, 9.0, [81, 66]);
    let parallel = View::new(&parallel.with_near(0.1)).unwrap();
    let mut cases = Vec::new();
    let mut add = |name, scene: &Scene, view: &View, settings| {
        cases.push(Case { name, scene: scene.clone(), view: view.clone(), settings });
    };
    for (name, scene) in [("everything", everything()), ("walls", walls()), ("specks", specks(0.02)), ("haze", haze())]
    {
        for settings in settings() {
            add(name, &scene, &whole, settings);
        }
        add(name, &scene, &part, Settings::default().with_transparency(Transparency::ABuffer { layers: 3 }));
        add(name, &scene, &parallel, Settings::default().with_edge_aa(EdgeAa::Coverage));
    }
    let ellipses_alone = ellipses(false);
    for filter in Filter::ALL {
        add("ellipses", &ellipses_alone, &whole, Settings::default().with_filter(filter));
        let affine = Settings::default().with_filter(filter).with_mapping(Mapping::Affine);
        add("ellipses, affine", &ellipses_alone, &part, affine);
    }
    let clipped = ellipses(true);
    for clip in [ClipPolicy::Exact, ClipPolicy::Line, ClipPolicy::Off] {
        add("clips", &clipped, &whole, Settings::default().with_clip(clip));
        add("clips", &clipped, &parallel, Settings::default().with_clip(clip).with_filter(Filter::Clamp));
    }
    cases
}

#[test]
fn every_size_of_tiles_and_cells_gives_the_same_bits_and_counts_each_splat_once() {
    for Case { name, scene, view, settings } in cases() {
        let (whole, stats) = draw(Tuning::default(), &scene, &view, &settings, all());
        assert!(stats.drawn > 100, "{name}: {} splats", stats.drawn);
        for (tile_blocks, cell_splats) in [(2, 0), (8, 0), (2, 300), (4, 1 << 20)] {
            let tuning = Tuning { tile_blocks, cell_splats, culls_occluded: false, ..Tuning::default() };
            let (bits, cut) = draw(tuning, &scene, &view, &settings, all());
            assert!(bits == whole, "{name}, {settings:?}: {tuning:?}");
            assert_eq!(cut.drawn, stats.drawn, "{name}, {settings:?}: {tuning:?}");
        }
    }
}

#[test]
fn occluded_chunks_are_left_out_and_no_bit_changes() {
    let (scene, view) = (walls(), view([128, 96], 0.1));
    let draw = |culls_occluded, settings: &Settings| {
        let tuning = Tuning { tile_blocks: 2, cell_splats: 500, culls_occluded, ..Tuning::default() };
        draw(tuning, &scene, &view, settings, all())
    };
    for settings in settings() {
        let ((with, stats), (without, none)) = (draw(true, &settings), draw(false, &settings));
        assert!(with == without, "{settings:?}");
        assert_eq!(counter(&none, "culled_occluded"), 0.0);
        // 3,600 splats per wall, of which some at the borders and the hole are visible; edge antialiasing draws hidden
        // splats too.
        let occluded = counter(&stats, "culled_occluded");
        assert!(occluded > 1800.0 || settings.edge_aa != EdgeAa::Off, "{settings:?}: {occluded}");
    }
}

#[test]
fn tiny_splats_are_the_same_to_the_bit_however_they_are_drawn() {
    let view = view([90, 70], 3.02);
    for filter in [Filter::Principal, Filter::None, Filter::Ewa, Filter::Adjust, Filter::Clamp] {
        for radius in [0.004, 0.02, 0.03] {
            let (scene, settings) = (specks(radius), Settings::default().with_filter(filter));
            for planes in [all(), Planes::COLOR] {
                let off = Tuning { finds_tiny: false, ..Tuning::default() };
                let (one_by_one, stats) = draw(off, &scene, &view, &settings, planes);
                let share = |stats: &Stats| counter(stats, "fragments_tested") / counter(stats, "block_pairs");
                assert_eq!(share(&stats), 16.0);
                for (tile_blocks, cell_splats) in [(8, 1 << 20), (2, 100), (4, 0)] {
                    let tuning = Tuning { tile_blocks, cell_splats, ..Tuning::default() };
                    let (bits, stats) = draw(tuning, &scene, &view, &settings, planes);
                    assert!(bits == one_by_one, "{filter:?}, radius {radius}: {tuning:?}");
                    // Most splats are tiny, except with `clamp`, whose disks aren't ellipses.
                    assert_eq!(share(&stats) < 14.0, filter != Filter::Clamp, "{filter:?}, radius {radius}");
                }
            }
        }
    }
}

#[test]
fn small_cells_bound_the_memory_of_meshes_and_large_splats() {
    let view = view([256, 256], 0.1);
    for scene in [everything(), specks(1.0)] {
        let bytes = |cell_splats| {
            let tuning = Tuning { tile_blocks: 2, cell_splats, ..Tuning::default() };
            let (_, stats) = draw(tuning, &scene, &view, &Settings::default(), Planes::COLOR);
            counter(&stats, "batch_bytes")
        };
        let (whole, parts) = (bytes(1 << 20), bytes(64));
        assert!(parts < 0.7 * whole, "{parts} of {whole} bytes");
    }
}
