//! Tests of point classes: splats of points in no surface stay small, surfaces have no holes at any sampling, and disks
//! follow the layout of the points.

use crate::common;

use common::{Lcg, coverage, points};
use glam::{DMat3, DQuat, DVec3};
use surfel_model::{PointCloud, Shape, SplatCloud};
use surfel_sample::{NoProgress, PointClass, PointOptions, PointReport, splats_from_points};

fn splats(cloud: &PointCloud) -> (SplatCloud, PointReport) {
    splats_from_points(cloud, &PointOptions::default(), &NoProgress).unwrap()
}

fn area(cloud: &SplatCloud, i: usize) -> f64 {
    let (s, t) = cloud.axes(i);
    std::f64::consts::PI * s.cross(t).length()
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = (values.len() - 1) / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Counts disks larger than six times the median radius of their 100 nearest points, by brute force.
fn too_large(cloud: &SplatCloud) -> usize {
    let all: Vec<(DVec3, f64)> = (0..cloud.len()).map(|i| (cloud.center(i), largest(cloud, i))).collect();
    let is_too_large = |i: usize| {
        let mut near: Vec<(f64, f64)> = (0..all.len())
            .filter(|j| all[*j].0 != all[i].0)
            .map(|j| (all[j].0.distance_squared(all[i].0), all[j].1))
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        all[i].1 > 6.0 * median(near.into_iter().take(100).map(|n| n.1))
    };
    (0..all.len()).filter(|i| is_too_large(*i)).count()
}

/// Returns the length of splat `i`'s larger half-axis.
fn largest(cloud: &SplatCloud, i: usize) -> f64 {
    let (s, t) = cloud.axes(i);
    s.length().max(t.length())
}

/// Returns the 1200 points of a facade from a data file, and the 60 stray points around it.
fn facade_with_strays() -> (Vec<DVec3>, Vec<DVec3>) {
    let line = |line: &str| {
        let numbers: Vec<f64> = line.split_whitespace().map(|n| n.parse().unwrap()).collect();
        (DVec3::new(numbers[0], numbers[1], numbers[2]), numbers[3] == 150.0)
    };
    let (facade, strays): (Vec<_>, Vec<_>) =
        include_str!("data/facade_with_strays.txt").lines().map(line).partition(|(_, is_facade)| *is_facade);
    let places = |of: Vec<(DVec3, bool)>| of.into_iter().map(|(p, _)| p).collect();
    (places(facade), places(strays))
}

#[test]
fn strays_about_a_facade_stay_small_whatever_their_number() {
    let (facade, strays) = facade_with_strays();
    assert_eq!((facade.len(), strays.len()), (1200, 60));
    let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.48, 0.6, 0.64), 1.1));
    let mut random = Lcg(3);
    let mut more = |count: usize, size: f64| -> Vec<DVec3> {
        let at = |_| (DVec3::new(random.unit(), random.unit(), random.unit()) - 0.5) * size;
        (0..count).map(at).filter(|p| p.y.abs() > 0.3).collect()
    };
    let cases = [
        ("the case", facade.clone(), strays.clone()),
        ("turned", facade.iter().map(|p| turn * *p).collect(), strays.iter().map(|p| turn * *p).collect()),
        ("tiny", facade.iter().map(|p| *p * 1e-9).collect(), strays.iter().map(|p| *p * 1e-9).collect()),
        ("few", facade.clone(), more(8, 30.0)),
        ("some", facade.clone(), more(250, 30.0)),
        ("near", facade.clone(), more(250, 12.0)),
        ("as many", facade.clone(), more(1200, 40.0)),
    ];
    for (name, facade, strays) in cases {
        let (cloud, report) = splats(&points(&[facade.clone(), strays].concat(), None));
        let usual = median((0..facade.len()).map(|i| largest(&cloud, i)));
        let of_strays = (facade.len()..cloud.len()).map(|i| largest(&cloud, i)).fold(0.0, f64::max);
        let share = |range: std::ops::Range<usize>| range.map(|i| area(&cloud, i)).sum::<f64>();
        let share = share(facade.len()..cloud.len()) / share(0..cloud.len());
        let of_points = (cloud.len() - facade.len()) as f64 / cloud.len() as f64;
        println!("{name}: {} times the usual radius, {share} of the area, {:?}", of_strays / usual, report.classes);
        assert!(of_strays < 2.0 * usual, "{name}: {of_strays}, usually {usual}");
        assert!(share < 1.3 * of_points, "{name}: {of_points} of the points have {share} of the area");
        // The facade has no hole except at its rim.
        assert!(
            report.classes[PointClass::Isolated as usize] < cloud.len() - facade.len() + 30,
            "{:?}",
            report.classes
        );
        assert_eq!(too_large(&cloud), 0, "{name}");
    }
}

/// Points of a scene around a spinning sensor: a scan of ground and a wall, and five crowns of trees.
struct Sweep {
    positions: Vec<DVec3>,
    /// Flag per point, true for points of crowns.
    is_clutter: Vec<bool>,
}

impl Sweep {
    /// Scans the scene with `beams` beams that are `step_deg` apart in elevation, the lowest at `lowest_deg`. Each beam
    /// has a return every `turn_deg` degrees, if it hits ground or wall within 70 units. Each crown has 60 random
    /// points. `axes` turns all points.
    fn new([beams, lowest_deg, step_deg, turn_deg]: [f64; 4], axes: DMat3) -> Self {
        let mut random = Lcg(12);
        let mut crown = |x: f64, y: f64| {
            let leaf = |_: usize| random.sphere() * (1.5 * random.unit().cbrt()) + DVec3::new(x, y, 2.5);
            (0..60).map(leaf).collect::<Vec<DVec3>>()
        };
        let clutter: Vec<DVec3> = [(30.0, 20.0), (-35.0, 25.0), (45.0, -30.0), (-25.0, -40.0), (60.0, 5.0)]
            .map(|(x, y)| crown(x, y))
            .concat();
        let mut noise = Lcg(4);
        let mut all = Self { positions: Vec::new(), is_clutter: Vec::new() };
        for beam in 0..beams as usize {
            for turn in 0..(360.0 / turn_deg) as usize {
                let elevation = (lowest_deg + step_deg * beam as f64).to_radians();
                let azimuth = (turn_deg * turn as f64).to_radians();
                let d = DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
                // The ground is 1.8 below; a wall is 9 to the left, up to 4 high.
                let ground = if d.z < 0.0 { -1.8 / d.z } else { f64::INFINITY };
                let wall = if d.y > 0.0 && (9.0 / d.y * d.z) < 2.2 { 9.0 / d.y } else { f64::INFINITY };
                let distance = ground.min(wall);
                if distance < 70.0 {
                    all.positions.push(axes * (d * (distance + 0.02 * (noise.unit() - 0.5))));
                    all.is_clutter.push(false);
                }
            }
        }
        all.positions.extend(clutter.iter().map(|p| axes * *p));
        all.is_clutter.resize(all.positions.len(), true);
        all
    }
}

#[test]
fn ground_under_a_sweep_closes_and_what_stands_about_stays_small() {
    let z_up = DMat3::IDENTITY;
    let y_up = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
    // Like a Velodyne with 32 beams, one with 64, one with 16, and a faster one.
    let cases = [
        ("32", [32.0, -30.67, 1.333, 0.4], z_up, 9.0),
        ("64, y up", [64.0, -24.8, 0.42, 0.36], y_up, 14.0),
        ("16", [16.0, -25.0, 2.0, 0.4], z_up, 8.0),
        ("32, coarse", [32.0, -30.67, 1.333, 0.8], y_up, 9.0),
    ];
    for (name, scanner, axes, until) in cases {
        let Sweep { positions, is_clutter } = Sweep::new(scanner, axes);
        let options = PointOptions { viewpoint: Some(DVec3::ZERO), ..PointOptions::default() };
        let (cloud, report) = splats_from_points(&points(&positions, None), &options, &NoProgress).unwrap();
        let mut random = Lcg(5);
        let nearest = 1.8 / (-scanner[1]).to_radians().tan() + 0.3;
        let places: Vec<(DVec3, DVec3)> = (0..4000)
            .map(|_| {
                let (r, a) = (nearest + (until - nearest) * random.unit(), std::f64::consts::TAU * random.unit());
                DVec3::new(r * a.cos(), r * a.sin(), -1.8)
            })
            .filter(|p| p.y < 8.5)
            .map(|p| (axes * p, axes * DVec3::Z))
            .collect();
        let holes = coverage(&cloud, &places).holes as f64 / places.len() as f64;
        let clutter: Vec<f64> = (0..cloud.len()).filter(|i| is_clutter[*i]).map(|i| largest(&cloud, i)).collect();
        let most = clutter.iter().copied().fold(0.0, f64::max);
        let share = |is: bool| (0..cloud.len()).filter(|i| is_clutter[*i] == is).map(|i| area(&cloud, i)).sum::<f64>();
        let share = share(true) / share(false);
        println!("{name}: {holes} holes, clutter up to {most}, {share} of the area, {:?}", report.classes);
        assert!(holes < 0.002, "{name}: {holes} of the ground is bare");
        assert!(most < 0.7, "{name}: {most}");
        assert!(share < 0.02, "{name}: {share}");
    }
}

#[test]
fn no_disk_is_larger_than_six_times_the_median_of_the_hundred_nearest() {
    let mut random = Lcg(8);
    let mut sheet = |count: usize, at: DVec3, size: f64| -> Vec<DVec3> {
        (0..count).map(|_| at + size * DVec3::new(random.unit(), random.unit(), 0.0)).collect()
    };
    // A dense part in a sparse one, two sheets with few large disks between, and fewer than a hundred points.
    let dense = [sheet(1500, DVec3::ZERO, 1.0), sheet(900, DVec3::new(0.45, 0.45, 0.0), 0.02)].concat();
    let steps = [sheet(1000, DVec3::ZERO, 1.0), sheet(60, DVec3::X, 1.0), sheet(1000, DVec3::X * 2.0, 1.0)].concat();
    let few = sheet(60, DVec3::ZERO, 1.0);
    for (name, positions) in [("dense", dense), ("steps", steps), ("few", few)] {
        let (cloud, _) = splats(&points(&positions, None));
        assert_eq!(too_large(&cloud), 0, "{name}");
    }
    let Sweep { positions, .. } = Sweep::new([16.0, -25.0, 2.0, 1.0], DMat3::IDENTITY);
    assert_eq!(too_large(&splats(&points(&positions, None)).0), 0);
}

/// Returns the points of a flat grid, and their unit normals, which are tilted. `lean` returns the tilt of a normal and
/// the direction of the tilt, both in degrees.
fn leaning(side: usize, axes: DMat3, lean: &mut dyn FnMut() -> (f64, f64)) -> (Vec<DVec3>, Vec<DVec3>) {
    let place = |i: usize| axes * DVec3::new((i / side) as f64 * 0.1, (i % side) as f64 * 0.1, 0.0);
    let mut normal = || {
        let (off, toward) = lean();
        let ((sin, cos), (y, x)) = (off.to_radians().sin_cos(), toward.to_radians().sin_cos());
        axes * DVec3::new(sin * x, sin * y, cos)
    };
    (0..side * side).map(|i| (place(i), normal())).unzip()
}

#[test]
fn layout_lays_disks_whose_stored_normals_lean_from_it() {
    let mut random = Lcg(14);
    let turned = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.6, 0.64, 0.48), 2.0));
    type Lean<'a> = &'a mut dyn FnMut() -> (f64, f64);
    let cases: [(&str, DMat3, Lean<'_>); 6] = [
        ("30", DMat3::IDENTITY, &mut || (30.0, 90.0)),
        ("30, turned", turned, &mut || (30.0, 90.0)),
        ("45, far", DMat3::IDENTITY * 1e6, &mut || (45.0, 200.0)),
        ("70, tiny", turned * 1e-6, &mut || (70.0, 10.0)),
        ("inward", DMat3::IDENTITY, &mut || (150.0, 90.0)),
        // Noise like that of normals that CloudCompare estimated for ripple_ascii.ply, half of which are tilted by more
        // than 21°.
        ("noise", DMat3::IDENTITY, &mut || (80.0 * random.unit(), 360.0 * random.unit())),
    ];
    for (name, axes, lean) in cases {
        let (positions, normals) = leaning(21, axes, lean);
        let up = (axes * DVec3::Z).normalize();
        let normals: Vec<DVec3> = normals.iter().map(|n| n.normalize()).collect();
        let (cloud, report) = splats(&points(&positions, Some(&normals)));
        // Within the tolerance of a fit, and of a bend where noise resembles one.
        let at_most = if name == "noise" { 0.8 } else { 0.999 };
        for (i, n) in normals.iter().enumerate() {
            let across = cloud.normal(i).dot(up);
            assert!(across.abs() >= at_most && across * n.dot(up) > 0.0, "{name}: {i} {across}");
            assert!(cloud.shading_normal(i).dot(*n) > 0.999_999, "{name}: {i}");
        }
        assert!(report.normals_off > if name == "noise" { 250 } else { 440 }, "{name}: {}", report.normals_off);
        assert_eq!(report.normals_given, 441);
        // Nothing within the rim is uncovered.
        let place = |k: usize| axes * DVec3::new(0.1 + 0.045 * (k % 40) as f64, 0.1 + 0.045 * (k / 40) as f64, 0.0);
        let side = if name == "inward" { -up } else { up };
        let places: Vec<(DVec3, DVec3)> = (0..1600).map(|k| (place(k), side)).collect();
        assert_eq!(coverage(&cloud, &places).holes, 0, "{name}");
    }
}

#[test]
fn normals_that_fit_stay_as_they_are_on_bodies_creases_limbs_and_thin_sheets() {
    let mut random = Lcg(15);
    let ball: Vec<(DVec3, DVec3)> = (0..3000).map(|_| random.sphere()).map(|p| (p, p * 3.0)).collect();
    let mut face = |i: usize| {
        let (axis, sign) = (i % 3, if i.is_multiple_of(2) { 1.0 } else { -1.0 });
        let mut p = DVec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
        p[axis] = sign;
        (p, DVec3::AXES[axis] * sign)
    };
    let cube: Vec<(DVec3, DVec3)> = (0..6000).map(&mut face).collect();
    let limb: Vec<(DVec3, DVec3)> = (0..400)
        .map(|_| {
            let (a, z) = (std::f64::consts::TAU * random.unit(), 60.0 * random.unit());
            (DVec3::new(a.cos(), a.sin(), z), DVec3::new(a.cos(), a.sin(), 0.0))
        })
        .collect();
    let mut side = |i: usize| {
        let sign = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        (DVec3::new(random.unit(), random.unit(), 0.002 * sign), DVec3::Z * sign)
    };
    let sheet: Vec<(DVec3, DVec3)> = (0..6000).map(&mut side).collect();
    for (name, all, most) in [("ball", ball, 0), ("cube", cube, 0), ("limb", limb, 0), ("sheet", sheet, 0)] {
        let (positions, normals): (Vec<DVec3>, Vec<DVec3>) = all.into_iter().unzip();
        let (cloud, report) = splats(&points(&positions, Some(&normals)));
        println!("{name}: {} off", report.normals_off);
        assert!(report.normals_off <= most, "{name}: {}", report.normals_off);
        if report.normals_off == 0 {
            assert!(cloud.data().shading_normals.is_none(), "{name}");
            if let Shape::Disks { normals: kept, .. } = &cloud.data().shape {
                assert!((0..cloud.len()).all(|i| kept.high()[i] == normals[i].as_vec3()), "{name}");
            }
        }
    }
}

#[test]
fn disks_on_a_line_lie_across_it_and_face_the_outside() {
    // A tilted wire, alone and above a plate.
    let along = DVec3::new(0.6, 0.0, 0.8);
    let wire: Vec<DVec3> = (0..300).map(|i| DVec3::new(0.0, 3.0, 1.0) + along * 0.1 * f64::from(i)).collect();
    let options = PointOptions { viewpoint: Some(DVec3::new(0.0, -500.0, 100.0)), ..PointOptions::default() };
    let (cloud, report) = splats_from_points(&points(&wire, None), &options, &NoProgress).unwrap();
    assert_eq!(report.classes[PointClass::Line as usize], 300);
    for (i, p) in wire.iter().enumerate() {
        let toward = (DVec3::new(0.0, -500.0, 100.0) - *p).reject_from_normalized(along).normalize();
        assert!(cloud.normal(i).dot(along).abs() < 1e-5 && cloud.normal(i).dot(toward) > 0.999, "{i}");
        // The second neighbour is at 0.1 inside, and at 0.2 at the ends.
        assert!(largest(&cloud, i) < 1.66 * 0.2, "{}", largest(&cloud, i));
    }
}

#[test]
fn classes_and_sizes_do_not_depend_on_the_number_of_threads() {
    let Sweep { positions, .. } = Sweep::new([16.0, -25.0, 2.0, 0.8], DMat3::IDENTITY);
    let (facade, strays) = facade_with_strays();
    for positions in [positions, [facade, strays].concat()] {
        let cloud = points(&positions, None);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| splats(&cloud))
        };
        let one = with(1);
        for threads in [2, 3, 5] {
            assert!(with(threads) == one, "{threads} threads");
        }
        assert_eq!(one.1.classes.iter().sum::<usize>(), positions.len());
    }
}
