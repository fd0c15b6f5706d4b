//! Tests of the reference's margin plane: it marks what rounding could change, and little else.

use glam::DVec3;
use surfel_conformance::build::{Splat, camera, cloud, object, scene, with_alpha};
use surfel_conformance::harness::reference_frame;
use surfel_conformance::polygons::{mesh_object, quad};
use surfel_conformance::scenes::{self, Case};
use surfel_model::{DepthTolerance, EdgeAa, Filter, Light, Object, Shader, Transparency};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Renderer, SceneSummary, View};

fn margin(case: &Case) -> Vec<f32> {
    reference_frame(&mut Reference::new(Default::default()).unwrap(), case).unwrap().margin().to_vec()
}

/// Returns a facing plane under a light from the right at this n·l.
fn at_terminator(cosine: f64, specular: f64) -> Case {
    let mut case = scenes::facing_plane();
    case.scene.objects[0].material.specular = specular;
    let direction = [-1.0, 0.0, -cosine];
    case.scene.lights = Some(vec![Light::Directional { direction, color: [1.0; 3], shadow: false }]);
    case
}

#[test]
fn margin_holds_highlights_at_the_terminator() {
    let splats_alone = margin(&at_terminator(0.0, 0.0));
    let inner = |m: &[f32], x: std::ops::Range<usize>| {
        let pixels = (2..46).flat_map(move |y| x.clone().map(move |x| y * 48 + x));
        let pixels: Vec<usize> = pixels.filter(|i| splats_alone[*i] == 0.0).collect();
        assert!(pixels.len() > 700);
        (pixels.iter().filter(|i| m[**i] != 0.0).count(), pixels.len())
    };
    for cosine in [5e-5, 0.0, -5e-5] {
        let m = margin(&at_terminator(cosine, 0.5));
        let (marked, all) = inner(&m, 26..46);
        assert_eq!(marked, all, "r·v > 0 on the right: the highlight comes and goes at {cosine}");
        // r·v < 0 on the left: there is no highlight.
        assert_eq!(inner(&m, 2..22).0, 0, "{cosine}");
        assert_eq!(inner(&margin(&at_terminator(cosine, 0.0)), 2..46).0, 0, "nothing jumps without a highlight");
    }
    for cosine in [2e-4, -2e-4] {
        assert_eq!(inner(&margin(&at_terminator(cosine, 0.5)), 2..46).0, 0, "{cosine}");
    }
}

/// With edge antialiasing, rounding can change more decisions. The margin plane must mark every pixel that it marks
/// without antialiasing, and less than 2 % of all pixels.
#[test]
fn margin_of_edges_adds_to_that_of_fragments_and_stays_small() {
    let with = scenes::sphere_before_plane();
    let without = with.with("off", |s| s.edge_aa = EdgeAa::Off);
    let (a, b) = (margin(&with), margin(&without));
    assert!(a.iter().zip(&b).all(|(a, b)| a >= b));
    let share = a.iter().sum::<f32>() / a.len() as f32;
    assert!(share < 0.02, "{share}");
}

/// Shifts of the view by a third of the margin change only marked pixels abruptly, in every scene.
#[test]
fn margin_holds_all_that_a_third_of_it_flips() {
    // `px` is the width of a drawn pixel in pixels of the image: 1, or ¼ for samples.
    let shifts: [fn(&mut View, f64); 4] = [
        |v, px| v.projection.principal_px = v.projection.principal_px.map(|c| c + 3e-4 * px),
        |v, px| v.projection.principal_px = v.projection.principal_px.map(|c| c - 3e-4 * px),
        |v, _| v.projection.focal_px = v.projection.focal_px.map(|f| f * (1.0 - 3e-6)),
        |v, _| v.eye += DVec3::new(0.7, -0.5, 0.6) * (1e-6 * v.projection.near.max(1e-6)),
    ];
    let mut reference = Reference::new(Default::default()).unwrap();
    let (mut jumps, mut marked) = (Vec::new(), 0);
    for case in scenes::all() {
        let want = reference_frame(&mut reference, &case).unwrap();
        let resident = reference.upload(&case.scene).unwrap();
        let is_of_toon_balls = case.settings.shader == Shader::Toon && SceneSummary::of(&case.scene).balls > 0;
        for (i, shift) in shifts.into_iter().enumerate() {
            let mut view = case.view();
            shift(&mut view, if case.settings.edge_aa == EdgeAa::Samples { 0.25 } else { 1.0 });
            let mut got = Frame::default();
            reference.render_into(&resident, &view, &case.settings, Planes::ALL, &mut got).unwrap();
            let moved = |got: &Frame, at: usize| {
                let colors = got.color()[at].iter().zip(want.color()[at]);
                colors.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
            };
            // Continuous changes are smaller: colours change by less than 40 per pixel, relative depths by less than
            // 100. Toon shades change by 50 per unit of the cosine, which changes by more than 1 per pixel on balls of
            // a pixel: by 65 in all.
            let most = if is_of_toon_balls { 0.025 } else { 0.012 };
            for at in 0..want.color().len() {
                let color = moved(&got, at);
                let depth = (got.depth()[at] - want.depth()[at]).abs() / want.depth()[at].abs().min(f32::MAX);
                if color > most || depth > 0.03 {
                    match want.margin()[at] == 0.0 {
                        true => jumps.push((case.name.clone(), i, at, color, depth)),
                        false => marked += 1,
                    }
                }
            }
        }
    }
    println!("{marked} pixels jumped, all marked but {}", jumps.len());
    assert!(jumps.is_empty(), "{} of {}: {jumps:#?}", jumps.len(), jumps.len() + marked);
    assert!(marked > 150, "{marked}");
}

/// Returns an image of 33×33 pixels, each 1/16.5 wide at depth 1 (fov 90°), with objects in front of an eye at the
/// origin that looks along −z.
fn before_eye(objects: Vec<Object>) -> Case {
    let mut scene = scene(&[]);
    scene.objects = objects;
    for object in &mut scene.objects {
        object.material.interior_weight = Some(1.0);
    }
    let mut case = Case::new("before-eye", scene, camera(0.0, 90.0, [33, 33]));
    case.camera.target = [0.0, 0.0, -1.0];
    case.settings.filter = Filter::None;
    case.settings.depth_tolerance = DepthTolerance::Absolute(0.05);
    case
}

fn disk(z: f64, alpha: f32) -> Object {
    let disk = Splat::disk(DVec3::new(0.0, 0.0, -z), DVec3::Z, 0.5 * z, [0.5; 3]);
    object(with_alpha(cloud(&[disk]), |_| alpha))
}

const MIDDLE: usize = 16 * 33 + 16;

#[test]
fn margin_holds_what_is_within_a_ten_thousandth_of_the_near_plane() {
    // A fragment behind the near plane exists, one in front doesn't.
    for (apart, marked) in [(5e-5, true), (-5e-5, true), (3e-4, false), (-3e-4, false)] {
        // Tilted, so that the near plane intersects it.
        let disk = Splat::disk(-DVec3::Z, DVec3::new(0.6, 0.0, 0.8), 0.5, [0.5; 3]);
        let mut case = before_eye(vec![object(cloud(&[disk]))]);
        case.camera.near = 1.0 / (1.0 + apart);
        assert_eq!(margin(&case)[MIDDLE] != 0.0, marked, "{apart}");
    }
}

#[test]
fn margin_holds_the_edges_of_polygons_within_a_thousandth_of_a_pixel() {
    // The left edge runs through the centres of column 10, or that many pixels beside them.
    for (beside, marked) in [(0.0, true), (5e-4, true), (-5e-4, true), (2e-3, false), (-2e-3, false)] {
        let left = (10.5 + beside - 16.5) / 16.5;
        let center = DVec3::new(left + 0.5, 0.0, -1.0);
        let case = before_eye(vec![mesh_object(quad(center, [DVec3::X * 0.5, DVec3::Y * 0.5], 1.0))]);
        let margin = margin(&case);
        let of_column = |x: usize| (10..23).filter(|y| margin[y * 33 + x] != 0.0).count();
        assert_eq!((of_column(9), of_column(10)), (0, if marked { 13 } else { 0 }), "{beside}");
    }
}

#[test]
fn margin_holds_depths_of_layers_and_polygons_within_a_ten_thousandth() {
    let peel = |objects| {
        let mut case = before_eye(objects);
        case.settings.transparency = Transparency::Peel { layers: 3, drop_last: false };
        margin(&case)[MIDDLE] != 0.0
    };
    // Shifted, so that no inner edge meets the pixel.
    let wall = |z: f64| mesh_object(quad(DVec3::new(0.3, 0.1, -z), [DVec3::X, DVec3::Y], 1.0));
    for (apart, marked) in [(5e-5, true), (-5e-5, true), (3e-4, false), (-3e-4, false)] {
        // A transparent disk against an opaque one, and against a polygon.
        assert_eq!(peel(vec![disk(1.0, 1.0), disk(1.0 + apart, 0.5)]), marked, "{apart}");
        assert_eq!(peel(vec![wall(1.0), disk(1.0 + apart, 0.5)]), marked, "{apart}");
        // A second layer against the first layer's threshold: its ε is 0.05 plus the slope term, 0 for a facing disk.
        assert_eq!(peel(vec![disk(1.0, 0.5), disk(1.05 + apart, 0.5)]), marked, "{apart}");
        let mut gathered = before_eye(vec![disk(1.0, 0.5), disk(1.05 + apart, 0.5)]);
        gathered.settings.transparency = Transparency::ABuffer { layers: 3 };
        assert_eq!(margin(&gathered)[MIDDLE] != 0.0, marked, "{apart}");
        // A polygon against the depth threshold, and against z − ε, of a disk.
        assert_eq!(margin(&before_eye(vec![disk(1.0, 1.0), wall(1.05 + apart)]))[MIDDLE] != 0.0, marked, "{apart}");
        assert_eq!(margin(&before_eye(vec![disk(1.0, 1.0), wall(0.95 + apart)]))[MIDDLE] != 0.0, marked, "{apart}");
        // A polygon against another polygon.
        assert_eq!(margin(&before_eye(vec![wall(1.0), wall(1.0 + apart)]))[MIDDLE] != 0.0, marked, "{apart}");
    }
}

#[test]
fn margin_holds_outlines_that_a_rounding_draws() {
    // Facing, so without slope; a line is drawn if the neighbour is 2 % farther back.
    for (apart, marked) in [(5e-5, true), (-5e-5, true), (3e-4, false), (-3e-4, false)] {
        let wall = |x: f64, z: f64| mesh_object(quad(DVec3::new(x, 0.0, -z), [DVec3::X, DVec3::Y], 1.0));
        let mut case = before_eye(vec![wall(-1.01, 1.0), wall(0.98, 1.02 + apart)]);
        case.settings.shader = Shader::Toon;
        let margin = margin(&case);
        let any = (12..21).any(|y| margin[y * 33 + 15] != 0.0 || margin[y * 33 + 16] != 0.0);
        assert_eq!(any, marked, "{apart}");
    }
}

/// The shadow map's bias has no slope term for a surface that faces the light. Rounding must not decide all over it.
#[test]
fn margin_is_small_where_polygons_face_the_light() {
    let floor = quad(DVec3::new(0.0, -0.5, -1.5), [DVec3::X, DVec3::NEG_Z], 1.0);
    let card = quad(DVec3::new(0.0, -0.3, -1.5), [DVec3::X * 0.3, DVec3::NEG_Z * 0.3], 1.0);
    let mut case = before_eye(vec![mesh_object(floor), mesh_object(card)]);
    case.scene.lights = Some(vec![Light::Directional { direction: [0.0, -1.0, 0.0], color: [1.0; 3], shadow: true }]);
    case.settings.shader = Shader::Phong;
    let unlit = margin(&case.with("unlit", |s| s.shader = Shader::Unlit));
    let more = margin(&case).iter().zip(unlit).filter(|(m, u)| **m != 0.0 && *u == 0.0).count();
    assert!(more < 10, "{more}");
}
