//! Tests of changes that must not change an image, or must change it in a known way.

use crate::drawing::reference_image;
use glam::{DAffine3, DVec3};
use surfel_conformance::build::{cloud, object, scene, sphere};
use surfel_conformance::harness::render;
use surfel_conformance::random::Random;
use surfel_conformance::scenes::{self, Case};
use surfel_model::{Camera, EdgeAa, Geometry, Projection, Shader};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, Region, Renderer, View};

/// Asserts that `got` at `map(x, y)` equals `want` at (x, y) where neither is within its margin. Colour and weight may
/// differ by `tolerance` (relative above 1), Z after division by `scale`. Returns the number of compared pixels.
fn assert_same(
    got: &Frame,
    want: &Frame,
    scale: f64,
    tolerance: f64,
    map: impl Fn(u32, u32) -> Option<[u32; 2]>,
) -> usize {
    let mut compared = 0;
    for y in 0..want.height() {
        for x in 0..want.width() {
            let Some([gx, gy]) = map(x, y) else { continue };
            let (w, g) = ((y * want.width() + x) as usize, (gy * got.width() + gx) as usize);
            if want.margin()[w] != 0.0 || got.margin()[g] != 0.0 {
                continue;
            }
            let close = |a: f64, b: f64| a == b || (a - b).abs() <= tolerance * b.abs().max(1.0);
            for (a, b) in got.color()[g].iter().zip(want.color()[w]) {
                assert!(close(f64::from(*a), f64::from(b)), "{x},{y}: {:?} {:?}", got.color()[g], want.color()[w]);
            }
            assert!(close(f64::from(got.weight()[g]), f64::from(want.weight()[w])), "weight at {x},{y}");
            assert!(close(f64::from(got.depth()[g]) / scale, f64::from(want.depth()[w])), "Z at {x},{y}");
            compared += 1;
        }
    }
    compared
}

fn here(x: u32, y: u32) -> Option<[u32; 2]> {
    Some([x, y])
}

/// Tolerance of reordered sums: up to a few hundred fragments in f64 differ by 1e-13, and in f32 storage by an ulp.
const REORDERED: f64 = 1.3e-7;
/// Tolerance of world coordinates moved by 1e6 units: their rounding is 1e-10 units, or 1e-8 px.
const MOVED: f64 = 1e-6;

#[test]
fn constant_colour_stays_constant() {
    let color = [0.25f32, 0.5, 0.75];
    let mut splats = sphere(1500, 1.1, 1);
    splats.iter_mut().for_each(|s| s.color = color);
    let case = Case { scene: scene(&splats), ..scenes::closed_sphere() };
    for filter in surfel_model::Filter::ALL {
        let frame = reference_image(&case.with(filter.name(), |s| s.filter = filter));
        let covered: Vec<_> = frame.color().iter().zip(frame.weight()).filter(|p| *p.1 > 0.0).map(|p| *p.0).collect();
        assert!(covered.len() > 2000);
        for got in covered {
            // Σw·c/Σw in f64 rounds to the f32 it came from.
            assert_eq!(got, [color[0], color[1], color[2], 1.0], "{filter:?}");
        }
    }
}

#[test]
fn splat_order_changes_nothing() {
    let mut splats = surfel_conformance::build::confetti(500, 0.06, 3.0, 3);
    let base = Case { scene: scene(&splats), ..scenes::confetti_ball() };
    let want = reference_image(&base);
    Random::new(5).shuffle(&mut splats);
    let got = reference_image(&Case { scene: scene(&splats), ..base });
    assert!(assert_same(&got, &want, 1.0, REORDERED, here) > 3000);
    assert_ne!(splats, surfel_conformance::build::confetti(500, 0.06, 3.0, 3));
}

#[test]
fn camera_roll_by_a_right_angle_turns_the_image() {
    let base = scenes::confetti_ball();
    let mut rolled = base.clone();
    // Up becomes +x: right is −y, down is −x.
    rolled.camera.up = [1.0, 0.0, 0.0];
    let (want, got) = (reference_image(&base), reference_image(&rolled));
    let side = want.width() - 1;
    assert!(assert_same(&got, &want, 1.0, MOVED, |x, y| Some([y, side - x])) > 3000);
}

#[test]
fn principal_point_shifts_the_image_by_whole_pixels() {
    let base = scenes::intrinsics();
    let mut shifted = base.clone();
    if let Projection::Intrinsics { cx, cy, .. } = &mut shifted.camera.projection {
        *cx += 3.0;
        *cy -= 5.0;
    }
    let (want, got) = (reference_image(&base), reference_image(&shifted));
    let map = |x: u32, y: u32| (x + 3 < 64 && y >= 5).then(|| [x + 3, y - 5]);
    assert!(assert_same(&got, &want, 1.0, MOVED, map) > 2500);
}

#[test]
fn scale_of_the_world_changes_nothing_but_z() {
    for base in [
        scenes::confetti_ball(),
        scenes::near_crossing(),
        scenes::closed_sphere().with("aa", |s| s.edge_aa = EdgeAa::Coverage),
    ] {
        let want = reference_image(&base);
        for factor in [1e-4, 1e4, 1e-12, 1e12] {
            let got = reference_image(&scenes::scaled(&base, factor));
            assert!(assert_same(&got, &want, factor, MOVED, here) > 2500, "{} {factor}", base.name);
        }
    }
}

#[test]
fn place_in_the_world_changes_nothing() {
    for base in [scenes::confetti_ball(), scenes::closed_sphere(), scenes::facing_plane()] {
        let want = reference_image(&base);
        let got = reference_image(&scenes::moved(&base, DVec3::new(1e6, -1e6, 1e6)));
        assert!(assert_same(&got, &want, 1.0, MOVED, here) > 2000, "{}", base.name);
    }
}

#[test]
fn mirrored_object_is_a_mirrored_image() {
    let mut base = scenes::closed_sphere();
    base.scene.objects[0].material.cull = surfel_model::Cull::Back;
    base.scene.objects[0].material.two_sided = false;
    base.settings.shader = Shader::Phong;
    let mut mirrored = base.clone();
    mirrored.scene.objects[0].world_from_object = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let (want, got) = (reference_image(&base), reference_image(&mirrored));
    let side = want.width() - 1;
    assert!(assert_same(&got, &want, 1.0, MOVED, |x, y| Some([side - x, y])) > 4000);
    assert!(want.weight().iter().filter(|w| **w > 0.0).count() > 2000);
}

#[test]
fn occluded_splats_change_no_bit() {
    let base = scenes::closed_sphere();
    let want = reference_image(&base);
    let mut more = base.clone();
    let mut inner = object(cloud(&sphere(800, 1.2, 7)));
    inner.world_from_object = DAffine3::from_scale(DVec3::splat(0.5));
    inner.material = more.scene.objects[0].material;
    more.scene.objects.push(inner);
    let got = reference_image(&more);
    assert!(got.color() == want.color() && got.depth() == want.depth() && got.weight() == want.weight());
}

#[test]
fn splitting_a_cloud_into_objects_changes_no_bit() {
    let splats = sphere(600, 1.2, 9);
    let base = Case { scene: scene(&splats), ..scenes::confetti_ball() };
    let mut split = base.clone();
    split.scene.objects = splats.chunks(7).map(|part| object(cloud(part))).collect();
    assert_eq!(reference_image(&split), reference_image(&base));
}

#[test]
fn thread_count_changes_no_bit() {
    for case in [scenes::sphere_before_plane(), scenes::near_crossing(), scenes::three_materials()] {
        let planes = Planes::ALL.with_margin(true).with_fragments(true);
        let frames = [1, 2, 5].map(|n| {
            render(&mut Reference::new(surfel_reference::Options::default().with_threads(n)).unwrap(), &case, planes)
                .unwrap()
        });
        assert!(frames[0] == frames[1] && frames[0] == frames[2], "{}", case.name);
    }
}

#[test]
fn region_is_a_crop_of_the_image() {
    let mut reference = Reference::new(Default::default()).unwrap();
    let planes = Planes::ALL.with_margin(true).with_fragments(true);
    for case in [scenes::sphere_before_plane(), scenes::closed_sphere(), scenes::near_crossing()] {
        let resident = reference.upload(&case.scene).unwrap();
        let mut whole = Frame::default();
        reference.render_into(&resident, &case.view(), &case.settings, planes, &mut whole).unwrap();
        let Camera { size: [w, h], .. } = case.camera;
        for [x, y, width, height] in [[0, 0, w, 1], [7, 9, 31, 17], [w - 1, h - 1, 1, 1], [20, 0, 1, h], [12, 13, 1, 1]]
        {
            let region = Region { x, y, width, height };
            let view = View::of_region(&case.camera, Some(region)).unwrap();
            let mut part = Frame::default();
            reference.render_into(&resident, &view, &case.settings, planes, &mut part).unwrap();
            for row in 0..height {
                let (a, b) = ((row * width) as usize, ((y + row) * w + x) as usize);
                let n = width as usize;
                let what = format!("{} {region:?} row {row}", case.name);
                assert_eq!(part.color()[a..a + n], whole.color()[b..b + n], "{what}");
                assert_eq!(part.depth()[a..a + n], whole.depth()[b..b + n], "{what}");
                assert_eq!(part.weight()[a..a + n], whole.weight()[b..b + n], "{what}");
                assert_eq!(part.normal()[a..a + n], whole.normal()[b..b + n], "{what}");
                assert_eq!(part.fragments()[a..a + n], whole.fragments()[b..b + n], "{what}");
                assert_eq!(part.margin()[a..a + n], whole.margin()[b..b + n], "{what}");
            }
        }
    }
}

#[test]
fn no_scene_gives_nan_or_colours_from_nowhere() {
    for case in scenes::all() {
        let frame = reference_image(&case);
        assert!(frame.color().as_flattened().iter().all(|c| c.is_finite()), "{}", case.name);
        assert!(frame.depth().iter().all(|z| *z >= case.camera.near as f32 * 0.999_999), "{}", case.name);
        assert!(frame.weight().iter().all(|w| w.is_finite() && *w >= 0.0), "{}", case.name);
        for (n, z) in frame.normal().iter().zip(frame.depth()) {
            let length = DVec3::from(n.map(f64::from)).length();
            if scenes::gaussians_of(&case).is_some() {
                // The normal is Σw·n.
                assert!(length <= 1.0 + 1e-6 && (z.is_finite() || length == 0.0), "{}", case.name);
                continue;
            }
            assert!(
                if z.is_finite() { (length - 1.0).abs() < 1e-6 || length == 0.0 } else { length == 0.0 },
                "{}",
                case.name
            );
        }
        for object in &case.scene.objects {
            let empty = match &object.geometry {
                Geometry::Splats(cloud) => cloud.is_empty(),
                Geometry::Mesh(mesh) => mesh.triangles.is_empty(),
                Geometry::Octree(octree) => octree.cloud().is_empty(),
                Geometry::Gaussians(cloud) => cloud.is_empty(),
            };
            assert!(!empty, "{}", case.name);
        }
    }
}
