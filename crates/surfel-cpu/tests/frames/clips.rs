//! Tests of clips (rendering model §7): their cost, and lines that are constant.

use glam::{DVec3, Vec3};
use surfel_cpu::{Options, Renderer};
use surfel_math::mapping::Linear;
use surfel_model::{
    Camera, ClipColumns, ClipLine, ClipMode, ClipPolicy, CloudData, Column3, NO_LINE, OnInvalid, Projection, Scene,
    Settings, Shape, SplatCloud,
};
use surfel_render::{Frame, Planes, Renderer as _, View};

/// Returns forty ellipses in a row, of which the first `clipped` have one line each.
fn row(clipped: Option<usize>) -> Scene {
    let half = [ClipLine { a: 1.0, b: 0.0, c: 0.0 }, NO_LINE, NO_LINE, NO_LINE];
    row_of(clipped.map(|count| Clipped { count, lines: half, mode: ClipMode::And }))
}

/// The clipped splats at the start of a row, and their clip.
struct Clipped {
    count: usize,
    lines: [ClipLine; 4],
    mode: ClipMode,
}

fn row_of(clipped: Option<Clipped>) -> Scene {
    const COUNT: usize = 40;
    let same = |v: [f32; 3]| Column3::from_f32(vec![Vec3::from(v); COUNT]);
    let shape = Shape::Ellipses { s: same([0.1, 0.0, 0.0]), t: same([0.0, 0.1, 0.0]) };
    let clips = clipped.map(|Clipped { count, lines, mode }| ClipColumns {
        lines: Some((0..COUNT).map(|i| if i < count { lines } else { [NO_LINE; 4] }).collect()),
        modes: Some(vec![mode; COUNT]),
        ..ClipColumns::default()
    });
    let centers = (0..COUNT).map(|i| Vec3::new(0.05 * (i as f32 - 20.0), 0.0, 0.0)).collect();
    let data = CloudData { clips, ..CloudData::new(DVec3::ZERO, Column3::from_f32(centers), shape) };
    Scene::from(SplatCloud::new(data, OnInvalid::Refuse).unwrap().0)
}

/// Memory, counts and weights of a drawn row.
#[derive(PartialEq)]
struct Drawn {
    resident_bytes: usize,
    /// Number of clips that setup found.
    clips: f64,
    weights: Vec<f32>,
}

fn drawn(scene: &Scene, clip: ClipPolicy) -> Drawn {
    let projection = Projection::Perspective { fov_y_deg: 45.0 };
    let (eye, up, size) = ([0.0, 0.0, 3.0], [0.0, 1.0, 0.0], [64, 64]);
    let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
    let mut renderer = Renderer::new(Options::default().with_threads(1)).unwrap();
    let resident = renderer.upload(scene).unwrap();
    let mut frame = Frame::default();
    let settings = Settings::default().with_clip(clip);
    let stats = renderer.render_into(&resident, &view, &settings, Planes::ALL, &mut frame).unwrap();
    assert_eq!(stats.drawn, 40);
    let clips = stats.counters.iter().find(|(name, _)| *name == "clips").unwrap().1;
    Drawn { resident_bytes: resident.bytes(), clips, weights: frame.weight().to_vec() }
}

#[test]
fn only_splats_with_a_clip_pay_for_it() {
    let plain = drawn(&row(None), ClipPolicy::Exact);
    assert_eq!(plain.clips, 0.0);
    // Columns of clips without any clip: no memory, no clip in a frame, and the same image.
    assert!(drawn(&row(Some(0)), ClipPolicy::Exact) == plain);
    let some = drawn(&row(Some(13)), ClipPolicy::Exact);
    // An index for each of the 48 slots, and 13 clips of one form, whose heads take 12 bytes.
    assert_eq!(
        some.resident_bytes - plain.resident_bytes,
        48 * size_of::<u32>() + 13 * (12 + size_of::<Linear<f32>>())
    );
    assert_eq!(some.clips, 13.0);
    assert!(some.weights != plain.weights);
    let off = drawn(&row(Some(13)), ClipPolicy::Off);
    assert_eq!(off.clips, 0.0);
    assert!(off.weights == plain.weights);
    assert_eq!(drawn(&row(Some(40)), ClipPolicy::Line).clips, 40.0);
}

#[test]
fn constant_line_keeps_all_or_nothing_in_either_mode() {
    let whole = drawn(&row(None), ClipPolicy::Exact).weights;
    let nothing = vec![0.0; whole.len()];
    let constant = |c: f32| ClipLine { a: 0.0, b: 0.0, c };
    for (lines, mode, keeps) in [
        ([constant(-1.0), NO_LINE, NO_LINE, NO_LINE], ClipMode::Or, false),
        ([constant(-1.0), constant(-0.5), NO_LINE, NO_LINE], ClipMode::Or, false),
        ([constant(-1.0), NO_LINE, NO_LINE, NO_LINE], ClipMode::And, false),
        ([constant(-1.0), constant(0.5), NO_LINE, NO_LINE], ClipMode::Or, true),
        ([constant(1.0), NO_LINE, NO_LINE, NO_LINE], ClipMode::Or, true),
        ([constant(0.0), NO_LINE, NO_LINE, NO_LINE], ClipMode::Or, true),
        ([constant(1.0), NO_LINE, NO_LINE, NO_LINE], ClipMode::And, true),
    ] {
        let clipped = Clipped { count: 40, lines, mode };
        let found = drawn(&row_of(Some(clipped)), ClipPolicy::Exact).weights;
        assert!(found == if keeps { whole.clone() } else { nothing.clone() }, "{lines:?} {mode:?}");
    }
}
