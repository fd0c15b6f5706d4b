//! Tests that splats of points leave no holes in the sampled surface.

use crate::common;

use common::{Coverage, Lcg, coverage, points};
use glam::DVec3;
use surfel_model::{Shape, SplatCloud};
use surfel_sample::{NoProgress, PointOptions, PointReport, splats_from_points};

fn splats(positions: &[DVec3]) -> (SplatCloud, PointReport) {
    splats_from_points(&points(positions, None), &PointOptions::default(), &NoProgress).unwrap()
}

/// Returns `count` random places on the unit square, except within `rim` of its border, and their normals.
fn square_places(count: usize, rim: f64) -> Vec<(DVec3, DVec3)> {
    let mut random = Lcg(99);
    let mut coordinate = || rim + (1.0 - 2.0 * rim) * random.unit();
    (0..count).map(|_| (DVec3::new(coordinate(), coordinate(), 0.0), DVec3::Z)).collect()
}

fn check(
    name: &str,
    cloud: &SplatCloud,
    report: &PointReport,
    places: &[(DVec3, DVec3)],
    weights: (f64, f64),
) -> Coverage {
    let c = coverage(cloud, places);
    println!("{name}: {c:?}, interior weight {:?}, {} ellipses", report.interior_weight, report.ellipses);
    assert_eq!(c.holes, 0, "{name}: {c:?}");
    let interior = report.interior_weight.unwrap();
    for w in [c.median_weight, interior] {
        assert!(weights.0 <= w && w <= weights.1, "{name}: Σw = {w}, expected {weights:?}; {c:?}");
    }
    c
}

#[test]
fn cover_regular_grid() {
    let positions: Vec<DVec3> =
        (0..60 * 60).map(|i| DVec3::new(f64::from(i % 60), f64::from(i / 60), 0.0) / 59.0).collect();
    let (cloud, report) = splats(&positions);
    assert!(matches!(cloud.data().shape, Shape::Disks { .. }));
    // The density rule on a grid: 0.4323·π·1.65² = 3.70, within its ripple of a few percent.
    let c = check("grid", &cloud, &report, &square_places(20_000, 0.0), (3.5, 3.9));
    assert!(c.twice > 0.97, "{c:?}");
    let radius = cloud.radius_max(30 * 60 + 30) * 59.0;
    assert!((radius - 1.65).abs() < 1e-6, "{radius}");
}

#[test]
fn cover_random_samples() {
    for seed in 1..=4 {
        let mut random = Lcg(seed);
        let positions: Vec<DVec3> = (0..5000).map(|_| DVec3::new(random.unit(), random.unit(), 0.0)).collect();
        let (cloud, report) = splats(&positions);
        assert!(matches!(cloud.data().shape, Shape::Disks { .. }), "{}", report.ellipses);
        let c = check("random", &cloud, &report, &square_places(50_000, 0.03), (3.0, 6.0));
        assert!(c.twice > 0.95, "{c:?}");
    }
}

#[test]
fn cover_scan_lines_with_ellipses() {
    for ratio in [2.0, 4.0, 8.0, 12.0] {
        let mut random = Lcg(5);
        let step = 0.0025;
        let mut positions = Vec::new();
        for line in 0..=(1.0 / (step * ratio)) as usize {
            for i in 0..=(1.0 / step) as usize {
                let jitter = DVec3::new(random.unit() - 0.5, random.unit() - 0.5, 0.0) * 0.3 * step;
                positions.push(DVec3::new(i as f64 * step, line as f64 * step * ratio, 0.0) + jitter);
            }
        }
        let (cloud, report) = splats(&positions);
        assert!(report.ellipses as f64 > 0.9 * cloud.len() as f64, "1:{ratio}: {}", report.ellipses);
        let rim = 2.0 * step * ratio;
        let c = check(&format!("lines 1:{ratio}"), &cloud, &report, &square_places(50_000, rim), (3.0, 6.0));
        assert!(c.twice > 0.99, "1:{ratio}: {c:?}");
        // Splats are stretched like the sampling, except that jitter shears the cells of long ratios.
        let mut ratios: Vec<f64> =
            (0..cloud.len()).map(|i| cloud.axes(i).0.length() / cloud.axes(i).1.length()).collect();
        ratios.sort_by(f64::total_cmp);
        let median = ratios[ratios.len() / 2];
        assert!((0.5..1.15).contains(&(median / ratio)), "1:{ratio}: {median}");
    }
}

#[test]
fn cover_sphere_with_estimated_normals() {
    let mut random = Lcg(11);
    let even: Vec<DVec3> = (0..4000)
        .map(|i| {
            let (z, a) = (1.0 - (2.0 * f64::from(i) + 1.0) / 4000.0, f64::from(i) * 2.399_963_229_728_653);
            let p = DVec3::new((1.0 - z * z).sqrt() * a.cos(), (1.0 - z * z).sqrt() * a.sin(), z);
            (p + 0.3 * 0.056 * DVec3::new(random.unit() - 0.5, random.unit() - 0.5, random.unit() - 0.5)).normalize()
        })
        .collect();
    let uneven: Vec<DVec3> = (0..4000).map(|_| random.sphere()).collect();
    for (name, positions) in [("jittered sphere", even), ("random sphere", uneven)] {
        let (cloud, report) = splats(&positions);
        let inward = (0..cloud.len()).filter(|i| cloud.normal(*i).dot(cloud.center(*i)) < 0.9).count();
        assert_eq!(inward, 0, "{name}");
        let places: Vec<_> = (0..50_000).map(|_| random.sphere()).map(|x| (x, x)).collect();
        let c = check(name, &cloud, &report, &places, (3.0, 6.0));
        assert!(c.twice > 0.95, "{name}: {c:?}");
    }
}

#[test]
fn cover_both_sides_of_a_thin_plate() {
    // Two sheets closer to each other than points are to their neighbours: normals must separate the sheets.
    let mut random = Lcg(21);
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    for side in [1.0, -1.0] {
        for _ in 0..4000 {
            positions.push(DVec3::new(random.unit(), random.unit(), 0.002 * side));
            normals.push(DVec3::Z * side);
        }
    }
    let (cloud, report) =
        splats_from_points(&points(&positions, Some(&normals)), &PointOptions::default(), &NoProgress).unwrap();
    assert_eq!(report.normals_given, 8000);
    for side in [1.0, -1.0] {
        let places: Vec<_> = square_places(20_000, 0.04)
            .into_iter()
            .map(|(x, _)| (x + DVec3::Z * 0.002 * side, DVec3::Z * side))
            .collect();
        check("plate", &cloud, &report, &places, (3.0, 6.0));
    }
}
