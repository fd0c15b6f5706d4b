//! Tests of small, degenerate and hostile clouds, of normals, outliers and determinism.

use crate::common;

use common::{Lcg, points};
use glam::DVec3;
use surfel_model::{PointCloud, Shape, Up};
use surfel_sample::{NoProgress, PointOptions, SampleError, outliers, splats_from_points};

fn disk(count: usize, seed: u64) -> Vec<DVec3> {
    let mut random = Lcg(seed);
    (0..count).map(|_| DVec3::new(random.unit(), random.unit(), 0.0)).collect()
}

#[test]
fn small_and_degenerate_clouds_get_sensible_radii() {
    let options = PointOptions::default();
    let line: Vec<DVec3> = (0..100).map(|i| DVec3::new(1.0, 2.0, 3.0) * f64::from(i)).collect();
    let step = 14.0_f64.sqrt();
    let cases = [
        ("one", vec![DVec3::ONE], 1.0, 1.0),
        ("coincident", vec![DVec3::splat(1e6); 500], 1.0, 1.0),
        ("two", vec![DVec3::ZERO, DVec3::X * 1e-3], 1e-3, 2e-3),
        ("three", vec![DVec3::ZERO, DVec3::X, DVec3::Y], 1.0, 2.5),
        ("collinear", line, step, 4.0 * step),
        ("tiny", disk(400, 3).iter().map(|p| *p * 1e-30).collect(), 0.04e-30, 0.3e-30),
        ("huge", disk(400, 3).iter().map(|p| *p * 1e30).collect(), 0.04e30, 0.3e30),
    ];
    for (name, positions, least, most) in cases {
        let (cloud, report) = splats_from_points(&points(&positions, None), &options, &NoProgress).unwrap();
        assert_eq!(cloud.len(), positions.len(), "{name}");
        assert!((least..=most).contains(&report.median_radius), "{name}: {}", report.median_radius);
        assert!(report.interior_weight.is_some(), "{name}");
    }
}

#[test]
fn splats_without_an_interior_weight_are_the_same_otherwise() {
    let points = points(&disk(2000, 1), None);
    let (cloud, report) = splats_from_points(&points, &PointOptions::default(), &NoProgress).unwrap();
    let without = PointOptions { interior_weight: false, ..PointOptions::default() };
    let (mut other, none) = splats_from_points(&points, &without, &NoProgress).unwrap();
    assert_eq!((none.interior_weight, other.data().interior_weight), (None, None));
    other.set_interior_weight(report.interior_weight.unwrap());
    assert_eq!(other, cloud);
}

#[test]
fn duplicates_get_their_neighbours_radius() {
    let mut positions = disk(2000, 1);
    let (alone, _) = splats_from_points(&points(&positions, None), &PointOptions::default(), &NoProgress).unwrap();
    // Every tenth point forty times: more copies than neighbours in a search.
    for i in (0..2000).step_by(10) {
        positions.extend([positions[i]; 39]);
    }
    let (cloud, report) = splats_from_points(&points(&positions, None), &PointOptions::default(), &NoProgress).unwrap();
    assert_eq!(report.duplicates, 200 * 39);
    for i in 0..2000 {
        assert_eq!(cloud.radius_max(i), alone.radius_max(i), "{i}");
    }
    assert_eq!(cloud.radius_max(2000), cloud.radius_max(0));
}

#[test]
fn given_normals_are_kept_and_decide_the_others() {
    let mut random = Lcg(4);
    let positions: Vec<DVec3> = (0..3000).map(|_| random.sphere()).collect();
    // Inward, of odd lengths, and unknown (zero or NaN) for nine in ten.
    let normals: Vec<DVec3> = positions
        .iter()
        .enumerate()
        .map(|(i, p)| match i % 10 {
            0 => *p * -2.5,
            1 => DVec3::NAN,
            _ => DVec3::ZERO,
        })
        .collect();
    let (cloud, report) =
        splats_from_points(&points(&positions, Some(&normals)), &PointOptions::default(), &NoProgress).unwrap();
    assert_eq!((report.normals_given, report.normals_estimated), (300, 2700));
    for (i, p) in positions.iter().enumerate() {
        assert!(cloud.normal(i).dot(*p) < -0.9, "{i}");
        if let (0, Shape::Disks { normals: kept, .. }) = (i % 10, &cloud.data().shape) {
            assert_eq!(kept.high()[i], normals[i].as_vec3());
        }
    }
}

#[test]
fn orientation_outward_on_a_torus_and_on_separate_parts() {
    let mut random = Lcg(6);
    let (mut positions, mut outward) = (Vec::new(), Vec::new());
    for i in 0..12_000 {
        let (a, b) = (std::f64::consts::TAU * random.unit(), std::f64::consts::TAU * random.unit());
        let n = DVec3::new(a.cos() * b.cos(), a.sin() * b.cos(), b.sin());
        // Three tori, each a component of its own.
        positions.push(DVec3::new(a.cos(), a.sin(), 0.0) + 0.4 * n + DVec3::X * 10.0 * f64::from(i % 3));
        outward.push(n);
    }
    let (cloud, _) = splats_from_points(&points(&positions, None), &PointOptions::default(), &NoProgress).unwrap();
    let wrong = outward.iter().enumerate().filter(|(i, n)| cloud.normal(*i).dot(**n) < 0.7).count();
    // PCA over a random sampling is rarely more than 45° off, and here no sign is wrong.
    assert!(wrong <= 12, "{wrong} of 12000");
    let flipped = outward.iter().enumerate().filter(|(i, n)| cloud.normal(*i).dot(**n) < 0.0).count();
    assert_eq!(flipped, 0);
}

#[test]
fn orientation_of_valleys_and_leaning_sheets_is_up() {
    // Sides of a valley rise by up to 13°, and the whole valley is tilted.
    for (depth, lean) in [(0.0, 0.5), (0.15, 0.0), (-0.15, 0.0), (0.15, 0.4), (0.1, 0.8)] {
        let turn = glam::DQuat::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), lean);
        let place = |p: &DVec3| {
            let (x, y) = (2.0 * p.x - 1.0, 2.0 * p.y - 1.0);
            turn * DVec3::new(x, y, 0.5 * depth * (x * x + y * y))
        };
        let positions: Vec<DVec3> = disk(8000, 3).iter().map(place).collect();
        let (cloud, _) = splats_from_points(&points(&positions, None), &PointOptions::default(), &NoProgress).unwrap();
        let down = (0..cloud.len()).filter(|i| cloud.normal(*i).z < 0.0).count();
        assert_eq!(down, 0, "{depth} {lean}");
    }
}

#[test]
fn orientation_of_deep_valleys_is_up_if_the_up_axis_is_certain() {
    // A gorge whose sides rise by up to 60° is convex from below, and so is a mountain from above.
    let gorge = |height: f64, up| {
        let place = |p: &DVec3| DVec3::new(p.x, p.y, height * (p.x - 0.5).powi(2));
        let positions: Vec<DVec3> = disk(8000, 3).iter().map(place).collect();
        let cloud = PointCloud { up, ..points(&positions, None) };
        let (cloud, _) = splats_from_points(&cloud, &PointOptions::default(), &NoProgress).unwrap();
        (0..cloud.len()).filter(|i| cloud.normal(*i).z < 0.0).count()
    };
    assert_eq!(gorge(1.7, Some(Up::PlusZ)), 0);
    assert_eq!(gorge(-1.7, Some(Up::PlusZ)), 0);
    assert!(gorge(1.7, None) > 7900, "an object's shell faces away from its inside");
    // A closed object keeps its outside.
    let mut random = Lcg(5);
    let ball: Vec<DVec3> = (0..4000).map(|_| random.sphere()).collect();
    let cloud = PointCloud { up: Some(Up::PlusZ), ..points(&ball, None) };
    let (cloud, _) = splats_from_points(&cloud, &PointOptions::default(), &NoProgress).unwrap();
    assert!((0..ball.len()).all(|i| cloud.normal(i).dot(ball[i]) > 0.0));
}

#[test]
fn disks_of_points_in_no_surface_are_as_large_as_their_neighbours_are_far() {
    // A ball of leaves.
    let mut random = Lcg(31);
    let positions: Vec<DVec3> = (0..4000).map(|_| random.sphere() * random.unit().cbrt()).collect();
    let (cloud, _) = splats_from_points(&points(&positions, None), &PointOptions::default(), &NoProgress).unwrap();
    let too_large = (0..positions.len()).filter(|i| {
        let mut distances: Vec<f64> = positions.iter().map(|p| p.distance(positions[*i])).collect();
        // The first is the point itself.
        let sixth = *distances.select_nth_unstable_by(6, f64::total_cmp).1;
        cloud.radius_max(*i) > 1.6501 * sixth
    });
    // 3 % happen to be in a patch that resembles a surface. By their cells alone, 22 % would be too large.
    let too_large = too_large.count();
    assert!(too_large < 200, "{too_large} of 4000");
}

#[test]
fn orientation_of_a_sheet_is_up_or_toward_the_viewpoint() {
    let sheet = |up| PointCloud { up, ..points(&disk(1000, 2), None) };
    let normal = |cloud: &PointCloud, viewpoint| {
        let options = PointOptions { viewpoint, ..PointOptions::default() };
        splats_from_points(cloud, &options, &NoProgress).unwrap().0.normal(500)
    };
    assert!(normal(&sheet(None), None).z > 0.99);
    assert!(normal(&sheet(Some(Up::MinusZ)), None).z < -0.99);
    assert!(normal(&sheet(None), Some(DVec3::new(0.5, 0.5, -9.0))).z < -0.99);
    // The viewpoint is in world coordinates, also for a cloud with an origin.
    let far: Vec<DVec3> = disk(1000, 2).iter().map(|p| *p + DVec3::new(4.5e6, 1.1, 300.1)).collect();
    let cloud = points(&far, None);
    assert_ne!(cloud.origin, DVec3::ZERO);
    assert!(normal(&cloud, Some(DVec3::new(4.5e6, 1.0, 299.0))).z < -0.99);
}

#[test]
fn strays_beside_strays_get_no_large_radius_and_sparse_parts_of_a_surface_do() {
    let mut random = Lcg(17);
    let surface: Vec<DVec3> = (0..20_000).map(|_| random.sphere()).collect();
    let strays = (0..300).map(|_| 3.0 * (DVec3::new(random.unit(), random.unit(), random.unit()) - 0.5));
    // The sixth neighbour of a point of the surface is .035 away; points beyond eight times that distance are isolated.
    let strays: Vec<DVec3> = strays.filter(|p| (p.length() - 1.0).abs() > 0.3).collect();
    let positions = [surface.clone(), strays.clone()].concat();
    let (cloud, report) = splats_from_points(&points(&positions, None), &PointOptions::default(), &NoProgress).unwrap();
    let large = |i: &usize| cloud.radius_max(*i) > 4.0 * report.median_radius;
    let found = (surface.len()..positions.len()).filter(large).count();
    // A few are in a plane with their neighbours by chance.
    assert!(found * 100 < strays.len(), "{found} of {} strays are large", strays.len());
    assert!(report.isolated * 20 > strays.len() * 19, "{} isolated", report.isolated);
    // A plane has no hole although one half has a 400th of the other's density.
    let half = |count: usize, x: f64, random: &mut Lcg| -> Vec<DVec3> {
        (0..count).map(|_| DVec3::new(x + random.unit(), random.unit(), 0.0)).collect()
    };
    let positions = [half(80_000, 0.0, &mut random), half(200, 1.0, &mut random)].concat();
    let (cloud, report) = splats_from_points(&points(&positions, None), &PointOptions::default(), &NoProgress).unwrap();
    // Beside the dense half, disks are no larger than six times the median radius of the 100 nearest points, most of
    // which are in that half.
    let away = || (80_000..80_200).filter(|i| positions[*i].x > 1.45);
    let large = away().filter(|i| cloud.radius_max(*i) > 8.0 * report.median_radius).count();
    assert!(large == away().count() && large > 80, "{large} of {} cover their part", away().count());
}

#[test]
fn far_returns_in_short_columns_dont_become_a_wall() {
    // A scanned disk, and beyond it seven columns of three returns, seven times as far from each other as the returns.
    let mut positions = disk(2000, 9);
    positions.extend((0..21).map(|i| DVec3::new(9.0 + 0.2 * f64::from(i / 3), 0.0, 0.03 * f64::from(i % 3))));
    let normals: Vec<DVec3> = (0..2021).map(|i| if i < 2000 { DVec3::Z } else { DVec3::Y }).collect();
    let points = points(&positions, Some(&normals));
    let (splats, _) = splats_from_points(&points, &PointOptions::default(), &NoProgress).unwrap();
    for i in 2000..2021 {
        // At most 1.65 times the distance of the second nearest.
        assert!(splats.radius_max(i) < 1.7 * 0.06, "{}", splats.radius_max(i));
    }
}

#[test]
fn isolated_points_get_no_large_radius() {
    let mut positions = disk(2000, 9);
    positions.extend([DVec3::new(0.5, 0.5, 3.0), DVec3::new(9.0, 0.0, 0.0)]);
    let (splats, report) =
        splats_from_points(&points(&positions, None), &PointOptions::default(), &NoProgress).unwrap();
    assert_eq!((report.isolated, splats.len()), (2, 2002));
    for i in [2000, 2001] {
        assert!(splats.radius_max(i) < 1.5 * report.median_radius, "{}", splats.radius_max(i));
        assert_eq!(splats.normal(i), DVec3::Z);
    }
    // The disks face the viewpoint.
    let options = PointOptions { viewpoint: Some(DVec3::new(0.5, 0.5, 9.0)), ..PointOptions::default() };
    let (splats, _) = splats_from_points(&points(&positions, None), &options, &NoProgress).unwrap();
    let toward = (DVec3::new(0.5, 0.5, 9.0) - positions[2001]).normalize();
    assert!((splats.normal(2001) - toward).length() < 1e-6, "{}", splats.normal(2001));
}

/// Returns the indices of the points that [`outliers`] finds.
fn outliers_of(positions: &[DVec3]) -> Vec<usize> {
    let found = outliers(&points(positions, None), &NoProgress).unwrap();
    (0..positions.len()).filter(|i| found[*i]).collect()
}

#[test]
fn outliers_are_found_however_far_and_however_many() {
    let good = disk(2000, 9);
    let strays = [DVec3::new(0.5, 0.5, 3.0), DVec3::new(9.0, 0.0, 0.0)];
    // Strays at any distance, beside each other, and moved to where f32 can't resolve millimetres.
    for scale in [1.0, 1e3, 1e8, 1e30] {
        let with: Vec<DVec3> = good.iter().copied().chain(strays.map(|s| s * scale)).collect();
        assert_eq!(outliers_of(&with), [2000, 2001], "{scale}");
    }
    let far: Vec<DVec3> = good.iter().chain(&strays).map(|p| *p + DVec3::new(4.5e6, 5.1e5, 300.0)).collect();
    assert_eq!(outliers_of(&far), [2000, 2001]);
    let pair = [DVec3::new(0.0, 0.0, 5.0), DVec3::new(0.0, 0.0, 5.0), DVec3::new(0.001, 0.0, 5.0)];
    let with: Vec<DVec3> = pair.into_iter().chain(good.iter().copied()).collect();
    assert_eq!(outliers_of(&with), [0, 1, 2]);
    // So many strays that none of them is alone; they would dominate the mean and the deviation.
    let noise = |i: usize| {
        let part = |k: usize| ((i * 3 + k) as f64 * 0.618_033_988_749_9).fract() * 40.0 - 20.0;
        DVec3::new(part(0), ((i as f64) * 0.754_877_666_2).fract() * 40.0 - 20.0, part(2))
    };
    let many: Vec<DVec3> = good.iter().copied().chain((0..300).map(noise).filter(|p| p.length() > 3.0)).collect();
    assert_eq!(outliers_of(&many), (2000..many.len()).collect::<Vec<_>>());
    assert!(many.len() > 2290);
}

#[test]
fn clean_clouds_have_no_outliers() {
    assert_eq!(outliers_of(&disk(5000, 3)), [0; 0]);
    let grid = |i: usize| DVec3::new((i % 50) as f64, (i / 50) as f64, 0.0);
    assert_eq!(outliers_of(&(0..2500).map(grid).collect::<Vec<_>>()), [0; 0]);
    // Density that falls with the square of the distance, as on the ground around a scanner; the range is 200 to one.
    let ground = |i: usize| {
        let (ring, angle) = (i / 360, (i % 360) as f64);
        let distance = 1.6 / (0.2 - 0.0015 * ring as f64);
        DVec3::new(distance * angle.to_radians().cos(), distance * angle.to_radians().sin(), -1.6)
    };
    assert_eq!(outliers_of(&(0..360 * 125).map(ground).collect::<Vec<_>>()), [0; 0]);
    // Too few, equal, or no points have no outliers.
    let spread: Vec<DVec3> = (0..15).map(|i| DVec3::splat(2_f64.powi(i))).collect();
    assert_eq!(outliers_of(&spread), [0; 0]);
    assert_eq!(outliers_of(&[DVec3::ONE; 1000]), [0; 0]);
    assert_eq!(outliers_of(&[DVec3::ONE]), [0; 0]);
    assert_eq!(outliers_of(&[]), [0; 0]);
    // Coincident points don't count as near neighbours of each other.
    let twice: Vec<DVec3> = disk(500, 3).into_iter().flat_map(|p| [p; 20]).chain(disk(500, 4)).collect();
    assert_eq!(outliers_of(&twice), [0; 0]);
    let holey = points(&[DVec3::ZERO, DVec3::NAN, DVec3::INFINITY], None);
    assert_eq!(outliers(&holey, &NoProgress).unwrap_err(), SampleError::NotFinite { index: 1, count: 2, total: 3 });
}

#[test]
fn strays_beside_dense_parts_are_outliers_where_others_are_as_sparse() {
    // A dense ball, while half of all points are so sparse that no global limit finds strays beside the ball.
    let ball = disk(4000, 5).into_iter().map(|p| p * 0.1);
    let sparse = disk(4000, 6).into_iter().map(|p| p * 30.0 + DVec3::new(100.0, 0.0, 0.0));
    let all: Vec<DVec3> = ball.chain(sparse).chain([DVec3::new(0.0, 0.0, 0.4)]).collect();
    assert_eq!(outliers_of(&all), [8000]);
}

#[test]
fn what_cannot_work_is_refused_with_a_reason() {
    let options = PointOptions::default();
    let error =
        |cloud: &PointCloud, options: &PointOptions| splats_from_points(cloud, options, &NoProgress).unwrap_err();
    assert_eq!(
        error(&PointCloud::default(), &options).to_string(),
        "the point cloud has no points, expected at least one: check that the file is complete"
    );
    let holey = points(&[DVec3::ZERO, DVec3::NAN, DVec3::INFINITY], None);
    assert_eq!(error(&holey, &options), SampleError::NotFinite { index: 1, count: 2, total: 3 });
    let fine = points(&disk(50, 1), None);
    for bad in [
        PointOptions { radius_scale: 0.0, ..options },
        PointOptions { radius_scale: f64::NAN, ..options },
        PointOptions { neighbours: 2, ..options },
        PointOptions { neighbours: usize::MAX, ..options },
        PointOptions { viewpoint: Some(DVec3::NAN), ..options },
    ] {
        assert!(matches!(error(&fine, &bad), SampleError::Option { .. }), "{bad:?}");
    }
    let uneven = PointCloud { colors: Some(vec![]), ..fine.clone() };
    assert!(matches!(error(&uneven, &options), SampleError::Model(_)));
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let mut random = Lcg(13);
    let positions: Vec<DVec3> = (0..30_000).map(|_| random.sphere()).collect();
    let cloud = points(&positions, None);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| splats_from_points(&cloud, &PointOptions::default(), &NoProgress).unwrap())
    };
    let one = with(1);
    for threads in [2, 5] {
        assert!(with(threads) == one, "{threads} threads");
    }
}

#[test]
fn radius_scale_scales() {
    let cloud = points(&disk(300, 5), None);
    let radius = |radius_scale| {
        let options = PointOptions { radius_scale, ..PointOptions::default() };
        splats_from_points(&cloud, &options, &NoProgress).unwrap().0.radius_max(7)
    };
    assert!((radius(2.0) / radius(1.0) - 2.0).abs() < 1e-6);
}

#[test]
fn normals_of_exact_scan_lines_come_from_the_lines_beside() {
    // 1:10, without jitter: the 16 nearest of every point are on its own line and leave its normal undetermined.
    let turn = glam::DQuat::from_rotation_x(0.4) * glam::DQuat::from_rotation_z(0.3);
    let positions: Vec<DVec3> =
        (0..4000).map(|i| turn * DVec3::new(f64::from(i % 200), f64::from(i / 200) * 10.0, 0.0)).collect();
    let (cloud, report) = splats_from_points(&points(&positions, None), &PointOptions::default(), &NoProgress).unwrap();
    assert!((0..4000).all(|i| cloud.normal(i).dot(turn * DVec3::Z) > 0.999), "{report:?}");
}

#[test]
fn scattered_points_are_level_where_asked_and_close_from_above() {
    // Flat ground with noise for x < 0, and a crown as deep as wide beside it, with 400 points per square unit.
    let mut random = Lcg(7);
    let mut at = |x: f64, depth: f64| DVec3::new(x + random.unit(), random.unit(), depth * random.unit());
    let positions: Vec<DVec3> = (0..800).map(|i| if i < 400 { at(-1.5, 0.01) } else { at(0.5, 0.3) }).collect();
    let asked = PointOptions { level_where_scattered: true, viewpoint: Some(DVec3::Z * 1e3), ..Default::default() };
    let (cloud, report) = splats_from_points(&points(&positions, None), &asked, &NoProgress).unwrap();
    let of_ground = report.level.iter().filter(|i| **i < 400).count();
    assert!(of_ground < 8 && report.level.len() > 380, "{of_ground} of {}", report.level.len());
    for i in &report.level {
        assert_eq!(cloud.normal(*i as usize), DVec3::Z, "{i}");
    }
    // Seen from above there is no hole, and radii are those of points in the plane, or a little larger.
    let leaves = 400..800;
    for k in 0..400 {
        let (x, y) = (0.6 + 0.04 * f64::from(k % 20), 0.1 + 0.04 * f64::from(k / 20));
        let covers = |i: usize| (cloud.center(i) - DVec3::new(x, y, cloud.center(i).z)).length() < cloud.radius_max(i);
        assert!(leaves.clone().any(covers), "{x} {y}");
    }
    let mean = leaves.map(|i| cloud.radius_max(i)).sum::<f64>() / 400.0;
    assert!((1.65 * 0.05..1.4 * 1.65 * 0.05).contains(&mean), "{mean}");
    let (_, report) = splats_from_points(&points(&positions, None), &PointOptions::default(), &NoProgress).unwrap();
    assert!(report.level.is_empty());
}

#[test]
fn given_radii_are_splats_up_to_five_spacings() {
    // A grid of spacing 0.25, with an area per point of 0.0625.
    let grid: Vec<DVec3> = (0..900).map(|i| DVec3::new(f64::from(i % 30), f64::from(i / 30), 0.0) * 0.25).collect();
    let made = |radii: Vec<f32>, scale: f64| {
        let cloud = PointCloud { radii: Some(radii), ..points(&grid, None) };
        let options = PointOptions { radius_scale: scale, ..PointOptions::default() };
        splats_from_points(&cloud, &options, &NoProgress).unwrap()
    };
    let (estimated, _) = splats_from_points(&points(&grid, None), &PointOptions::default(), &NoProgress).unwrap();
    // Each radius is used as it is, also if radii differ; invalid ones are estimated.
    let own: Vec<f32> = (0..900).map(|i| [0.1, 0.2, 0.9, -1.0, f32::NAN, 0.0][i % 6]).collect();
    let (cloud, report) = made(own, 1.0);
    assert_eq!((report.radii_given, report.radii_too_large, report.normals_estimated), (450, None, 900));
    assert!(matches!(cloud.data().shape, Shape::Disks { .. }));
    for i in 0..900 {
        let expected = [0.1_f32, 0.2, 0.9].get(i % 6).map_or(estimated.radius_max(i), |r| f64::from(*r));
        assert_eq!(cloud.radius_max(i), expected, "{i}");
        assert!(cloud.normal(i).z.abs() > 0.999);
    }
    assert_eq!(made(vec![0.5; 900], 3.0).0.radius_max(7), 1.5);
    // The median decides, in spacings of the cloud.
    assert_eq!(made(vec![1.2; 900], 1.0).0.radius_max(450), f64::from(1.2_f32));
    let (cloud, report) = made(vec![1.3; 900], 1.0);
    assert_eq!((report.radii_given, cloud), (0, estimated.clone()));
    assert!((5.0..5.4).contains(&report.radii_too_large.unwrap()), "{:?}", report.radii_too_large);
    let (cloud, report) = made(vec![0.0; 900], 1.0);
    assert_eq!((report.radii_given, report.radii_too_large, cloud), (0, None, estimated));
    // A single place has no spacing to compare with.
    let one = PointCloud { radii: Some(vec![40.0]), ..points(&[DVec3::ONE], None) };
    assert_eq!(splats_from_points(&one, &PointOptions::default(), &NoProgress).unwrap().0.radius_max(0), 40.0);
}
