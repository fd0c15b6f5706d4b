//! Images of clipped splats against closed forms, and faults that the clip scenes catch.

use crate::drawing::reference_image;
use glam::DVec3;
use surfel_conformance::build::{Clipped, Splat, axes, camera, clipped_cloud, object, scene};
use surfel_conformance::harness::{compare_frames, reference_frame};
use surfel_conformance::scenes::{self, Case};
use surfel_model::{
    ClipCurve, ClipLine, ClipMode, ClipPolicy, CloudData, Filter, Geometry, OnInvalid, Projection, Scene, Settings,
    SplatCloud,
};
use surfel_reference::Renderer as Reference;

/// Returns the world direction through a pixel's centre, from the camera's fields alone.
fn ray(case: &Case, x: u32, y: u32) -> DVec3 {
    let Projection::Perspective { fov_y_deg } = case.camera.projection else { panic!("perspective") };
    let [right, down, forward] = axes(&case.camera);
    let [w, h] = case.camera.size.map(f64::from);
    let f = h / (2.0 * (0.5 * fov_y_deg.to_radians()).tan());
    forward + right * ((f64::from(x) + 0.5 - 0.5 * w) / f) + down * ((f64::from(y) + 0.5 - 0.5 * h) / f)
}

/// A clip that a filter stretches with a splat of an oriented cloud leaves no pixel empty.
#[test]
fn grazing_clipped_splats_leave_no_pixel_empty() {
    for filter in Filter::ALL {
        let frame = reference_image(&scenes::clip_grazing().with("empty", |s| s.filter = filter));
        let empty = frame.weight().iter().filter(|weight| **weight == 0.0).count();
        let before = frame.depth().iter().filter(|depth| **depth < 4.0).count();
        assert!(empty == 0, "{filter:?}: {empty}");
        // With `none`, splats thinner than a pixel are hit by chance.
        assert!(before > 20, "{filter:?}: {before} of splats before the wall");
    }
}

/// Six splats with four lines each: every pixel has the face, the normal and the depth that its ray meets.
#[test]
fn clip_lines_make_a_perfect_cube() {
    // `ewa` is affine: a face's outline is that of its affine projection.
    for filter in Filter::ALL.into_iter().filter(|f| *f != Filter::Ewa) {
        let case = scenes::clipped_cube().with("truth", |s| s.filter = filter);
        let frame = reference_image(&case);
        let eye = DVec3::from(case.camera.eye);
        let (mut covered, mut marginal) = (0, 0);
        for y in 0..frame.height() {
            for x in 0..frame.width() {
                let at = (y * frame.width() + x) as usize;
                if frame.margin()[at] != 0.0 {
                    marginal += 1;
                    continue;
                }
                let direction = ray(&case, x, y);
                // Slab test: the ray hits the face that it enters last, unless it has left a slab before.
                let (a, b) = ((-scenes::CUBE_HALF - eye) / direction, (scenes::CUBE_HALF - eye) / direction);
                let (enter, leave) = (a.min(b), a.max(b));
                let z = enter.max_element();
                if z > leave.min_element() {
                    assert_eq!((frame.weight()[at], frame.depth()[at]), (0.0, f32::INFINITY), "{filter:?} {x},{y}");
                    continue;
                }
                let normal = DVec3::select(enter.cmpge(DVec3::splat(z)), -direction.signum(), DVec3::ZERO);
                let got = DVec3::from(frame.normal()[at].map(f64::from));
                // Both the normal and the axes from which it is computed are stored in f32.
                assert!((got - normal).length() < 1e-6, "{filter:?} {x},{y}: {got} {normal}");
                assert!((f64::from(frame.depth()[at]) / z - 1.0).abs() < 1e-6, "{filter:?} {x},{y}");
                covered += 1;
            }
        }
        // The margin is a band of 2e-3 px along 9 edges of about 40 px, and 1e-4 of the disk.
        assert!(covered > 2000 && marginal < 40, "{covered} {marginal}");
    }
}

/// A quarter of a facing disk's rim is clipped by the circle through the same ends that bends inwards: a lens of known
/// area.
#[test]
fn clip_curve_keeps_a_known_area() {
    // P1 = (1, 0), P3 = (0, 1), P2 the origin, w = √½: the arc of the unit circle around (1, 1). The disk remains
    // without the lens that both circles share, 2·(π/4 − ½).
    let curve = ClipCurve {
        theta1: 0.0,
        theta3: std::f32::consts::FRAC_PI_2,
        u: 0.0,
        v: 0.0,
        w: std::f32::consts::FRAC_1_SQRT_2,
    };
    let splat = Splat { p: DVec3::ZERO, s: DVec3::X, t: DVec3::Y, color: [1.0; 3] };
    let clipped = Clipped { splat, curve: Some(curve), lines: Vec::new(), mode: ClipMode::And };
    let scene = Scene { objects: vec![object(clipped_cloud(&[clipped]))], ..scene(&[]) };
    // 100 px per unit.
    let case = Case::new("area", scene, camera(1.28, 90.0, [256, 256]));
    for (policy, want) in [
        (ClipPolicy::Exact, std::f64::consts::FRAC_PI_2 + 1.0),
        (ClipPolicy::Paper, std::f64::consts::FRAC_PI_2 + 1.0),
        (ClipPolicy::Line, 0.75 * std::f64::consts::PI + 0.5),
        (ClipPolicy::Off, std::f64::consts::PI),
    ] {
        let frame = reference_image(&case.with("policy", |s| s.clip = policy));
        let area = frame.weight().iter().filter(|w| **w > 0.0).count() as f64 / 1e4;
        // Tolerance for counting pixels of an outline of 600 px: about its square root.
        assert!((area - want).abs() < 6e-3, "{policy:?}: {area} {want}");
        let kept = |x: usize, y: usize| frame.weight()[y * 256 + x] > 0.0;
        // (0.5, 0.5) is up right of the centre; rows count down.
        assert_eq!(kept(128 + 50, 127 - 50), policy == ClipPolicy::Off);
        assert!(kept(128 - 50, 128 + 50) && kept(128, 128));
    }
}

#[test]
fn clip_by_the_papers_equation_is_the_same_image() {
    for case in [scenes::clip_curves(), scenes::clipped_confetti(), scenes::clipped_near()] {
        let exact = reference_frame(&mut Reference::new(Default::default()).unwrap(), &case).unwrap();
        let paper = reference_image(&case.with("paper", |s| s.clip = ClipPolicy::Paper));
        let report = compare_frames(&case.name, &paper, &exact, exact.margin());
        assert!(report.is_ok() && report.planes.iter().all(|p| p.worst == 0.0), "{report}");
    }
}

type ChangeData = fn(&mut CloudData);
type ChangeSettings = fn(&mut Settings);

fn with_data(case: &Case, change: ChangeData) -> Case {
    let mut case = case.clone();
    for object in &mut case.scene.objects {
        let Geometry::Splats(cloud) = &object.geometry else { continue };
        let mut data = cloud.data().clone();
        change(&mut data);
        object.geometry = Geometry::Splats(SplatCloud::new(data, OnInvalid::Refuse).unwrap().0.into());
    }
    case
}

fn curves(data: &mut CloudData) -> &mut [ClipCurve] {
    data.clips.as_mut().and_then(|c| c.curves.as_deref_mut()).unwrap_or_default()
}

fn lines(data: &mut CloudData) -> impl Iterator<Item = &mut ClipLine> {
    data.clips.as_mut().and_then(|c| c.lines.as_deref_mut()).unwrap_or_default().iter_mut().flatten()
}

#[test]
fn clip_scenes_catch_faults() {
    let data: [(&str, ChangeData, Case); 7] = [
        (
            "ends swapped",
            |d| curves(d).iter_mut().for_each(|c| (c.theta1, c.theta3) = (c.theta3, c.theta1)),
            scenes::clip_curves(),
        ),
        ("weight off by 3 %", |d| curves(d).iter_mut().for_each(|c| c.w *= 1.03), scenes::clip_curves()),
        ("P2 mirrored", |d| curves(d).iter_mut().for_each(|c| c.v = -c.v), scenes::clipped_confetti()),
        ("lines turned", |d| lines(d).for_each(|l| l.b = -l.b), scenes::clip_lines_mirrored()),
        ("first line alone", |d| lines(d).skip(1).step_by(4).for_each(|l| l.a = f32::NAN), scenes::clipped_cube()),
        (
            "or for and",
            |d| d.clips.as_mut().unwrap().modes = Some(vec![ClipMode::Or; d.centers.len()]),
            scenes::clip_lines(),
        ),
        ("no clip", |d| d.clips = None, scenes::clipped_near()),
    ];
    let settings: [(&str, ChangeSettings, Case); 3] = [
        ("line", |s| s.clip = ClipPolicy::Line, scenes::clip_curves()),
        ("off", |s| s.clip = ClipPolicy::Off, scenes::clipped_confetti()),
        (
            "exact for line",
            |s| s.clip = ClipPolicy::Exact,
            scenes::clip_curves().with("line", |s| s.clip = ClipPolicy::Line),
        ),
    ];
    let faulty = data.map(|(fault, change, case)| (fault, with_data(&case, change), case));
    let by_settings = settings.map(|(fault, change, case)| (fault, case.with("fault", change), case));
    for (fault, wrong, case) in faulty.into_iter().chain(by_settings) {
        let want = reference_frame(&mut Reference::new(Default::default()).unwrap(), &case).unwrap();
        let report = compare_frames(&case.name, &reference_image(&wrong), &want, want.margin());
        assert!(!report.is_ok(), "{fault} passes {}", case.name);
    }
}
