//! Tests that disks of points end where the surface does.

use crate::common;

use common::{Lcg, coverage, points};
use glam::DVec3;
use surfel_model::SplatCloud;
use surfel_sample::{NoProgress, PointOptions, splats_from_points};

fn splats(positions: &[DVec3], normals: &[DVec3]) -> SplatCloud {
    splats_from_points(&points(positions, Some(normals)), &PointOptions::default(), &NoProgress).unwrap().0
}

fn radii(cloud: &SplatCloud) -> Vec<f64> {
    (0..cloud.len()).map(|i| cloud.radius_max(i)).collect()
}

/// Returns the quantile of some values: the value below which the fraction `share` of them is.
fn quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share) as usize]
}

#[test]
fn disks_of_thin_limbs_dont_stick_out() {
    // Rods of radius 1, 40 long, with points 1 apart: six around each rod.
    let mut random = Lcg(5);
    let mut at = |margin: f64| {
        let (angle, along) = (std::f64::consts::TAU * random.unit(), margin + (40.0 - 2.0 * margin) * random.unit());
        let normal = DVec3::new(angle.cos(), angle.sin(), 0.0);
        (normal + DVec3::Z * along, normal)
    };
    let count = (40.0 * std::f64::consts::TAU) as usize;
    let (positions, normals): (Vec<DVec3>, Vec<DVec3>) = (0..count).map(|_| at(0.0)).unzip();
    let places: Vec<(DVec3, DVec3)> = (0..5000).map(|_| at(3.0)).collect();
    let cloud = splats(&positions, &normals);
    let (radii, holes) = (radii(&cloud), coverage(&cloud, &places).holes);
    // Distance of a disk's rim from the rod; with the density radius of 1.65 alone, the median would be 0.93.
    let out = |share| quantile(radii.iter().map(|r| (1.0 + r * r).sqrt() - 1.0), share);
    let (middle, most) = (out(0.5), out(0.95));
    assert!(middle < 0.75 && most < 1.5, "{middle} {most}");
    assert_eq!(holes, 0);
}

#[test]
fn disks_beside_a_crease_end_near_it() {
    // Two sides of a box that meet at x = 0, with random points 0.02 apart. By the density rule alone, radii would be
    // 1.65 times that.
    let mut random = Lcg(6);
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    for _ in 0..2500 {
        let (u, v) = (random.unit(), random.unit());
        positions.extend([DVec3::new(-u, v, 0.0), DVec3::new(0.0, v, -u)]);
        normals.extend([DVec3::Z, DVec3::X]);
    }
    let radii = radii(&splats(&positions, &normals));
    let beside = |i: &usize| {
        let p = positions[*i];
        p.x.abs().max(p.z.abs()) < 0.02 && (0.1..0.9).contains(&p.y)
    };
    let radius = |share| quantile((0..radii.len()).filter(beside).map(|i| radii[i] / 0.02), share);
    assert!(radius(0.5) < 1.3 && radius(0.95) < 1.85, "{} {}", radius(0.5), radius(0.95));
}

#[test]
fn few_returns_far_from_each_other_stay_small() {
    // Ground with points 0.01 apart, and above it a piece of a wall with twenty points, 0.06 apart, and one with a
    // thousand.
    let mut random = Lcg(7);
    let mut positions: Vec<DVec3> = (0..10_000).map(|_| DVec3::new(random.unit(), random.unit(), 0.0)).collect();
    for (y, width, height, count) in [(0.5, 0.3, 0.24, 20), (2.0, 3.0, 1.2, 1000)] {
        positions.extend((0..count).map(|_| DVec3::new(width * random.unit(), y, 0.3 + height * random.unit())));
    }
    let normals: Vec<DVec3> = (0..positions.len()).map(|i| if i < 10_000 { DVec3::Z } else { DVec3::Y }).collect();
    let radii = radii(&splats(&positions, &normals));
    let (few, many) = radii[10_000..].split_at(20);
    let (largest, usual) = (quantile(few.iter().copied(), 1.0), quantile(many.iter().copied(), 0.05));
    assert!(largest < 0.03 && usual > 0.06, "{largest} {usual}");
}

/// Returns `count` points distributed over a ball of radius 1.
fn crown(random: &mut Lcg, count: usize) -> Vec<DVec3> {
    let mut all = Vec::with_capacity(count);
    while all.len() < count {
        let p = DVec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
        if p.length() < 1.0 {
            all.push(p);
        }
    }
    all
}

#[test]
fn leaves_are_shaded_as_the_crown_that_they_make() {
    let mut random = Lcg(8);
    let estimated = |positions: &[DVec3]| {
        splats_from_points(&points(positions, None), &PointOptions::default(), &NoProgress).unwrap().0
    };
    // A crown of 3000 leaves above ground with points 0.05 apart.
    let leaves = crown(&mut random, 3000);
    let ground = (0..14_400).map(|_| DVec3::new(6.0 * random.unit() - 3.0, 6.0 * random.unit() - 3.0, -2.5));
    let positions: Vec<DVec3> = leaves.iter().copied().chain(ground).collect();
    let cloud = estimated(&positions);
    let outer: Vec<usize> = (0..3000).filter(|i| leaves[*i].length() > 0.8).collect();
    let outward =
        outer.iter().filter(|i| cloud.normal(**i).dot(leaves[**i].normalize() + 0.5 * DVec3::Z) > 0.0).count();
    let upward = (0..3000).filter(|i| cloud.normal(*i).z > 0.0).count();
    let largest = radii(&cloud)[..3000].iter().copied().fold(0.0, f64::max);
    println!("{outward} of {} outer ones, {upward} of 3000 upward, largest {largest}", outer.len());
    assert!(outward as f64 > 0.83 * outer.len() as f64 && upward > 2750, "{outward} {upward}");
    assert!(largest < 2.0 * 1.65 * 0.05 * 1.1, "{largest}");
    let ground_is_up = (3000..cloud.len()).all(|i| cloud.normal(i).z > 0.9);
    assert!(ground_is_up);

    // Independent of the unit of length, and far from the origin.
    for (scale, origin) in [(1e15, 0.0), (1e-15, 0.0), (1.0, 1e6)] {
        let moved: Vec<DVec3> = positions.iter().map(|p| *p * scale + DVec3::splat(origin)).collect();
        let other = estimated(&moved);
        let same = (0..3000).filter(|i| other.normal(*i).dot(cloud.normal(*i)) > 0.99).count();
        assert!(same > 2950, "{scale} {origin}: {same}");
    }

    // Surfaces aren't foliage: a sheet with noise of half its spacing, and a rod with six points around it.
    let mut normal_of = |sheet: bool| {
        let mut shake = || (random.unit() + random.unit() + random.unit() - 1.5) * 0.03;
        let at = |i: u32| {
            let (u, v) = (f64::from(i % 60) * 0.05, f64::from(i / 60) * 0.05);
            let angle = f64::from(i) * 2.399_963;
            if sheet { DVec3::new(u, v, 0.0) } else { DVec3::new(angle.cos(), angle.sin(), f64::from(i) / 6.3) }
        };
        let positions: Vec<DVec3> =
            (0..2400).map(at).map(|p| if sheet { p + DVec3::new(shake(), shake(), shake()) } else { p }).collect();
        let cloud = estimated(&positions);
        (cloud, positions)
    };
    let (sheet, _) = normal_of(true);
    let tilted = quantile((0..2400).map(|i| sheet.normal(i).z.abs().acos().to_degrees()), 0.95);
    let (rod, positions) = normal_of(false);
    let off = quantile(
        (60..2340).map(|i| {
            let outward = DVec3::new(positions[i].x, positions[i].y, 0.0);
            rod.normal(i).dot(outward).clamp(-1.0, 1.0).acos().to_degrees()
        }),
        0.95,
    );
    println!("sheet {tilted}°, rod {off}°");
    assert!(tilted < 30.0 && off < 25.0, "{tilted} {off}");
}

#[test]
fn what_stands_in_a_forest_is_small_and_its_ground_closes() {
    // Ground with points 0.05 apart, but 0.2 at one end; 16 crowns above it, and a vertical plate of few returns. The
    // scanner is above.
    let mut random = Lcg(9);
    let mut positions = Vec::new();
    for i in 0..16 {
        let middle = DVec3::new(f64::from(i % 4) * 2.0 + 1.0, f64::from(i / 4) * 2.0 + 1.0, 2.0);
        positions.extend(crown(&mut random, 1200).iter().map(|p| *p * 0.9 + middle));
    }
    let leaves = positions.len();
    positions.extend((0..25_600).map(|_| DVec3::new(8.0 * random.unit(), 8.0 * random.unit(), 0.0)));
    let sparse = positions.len();
    positions.extend((0..800).map(|_| DVec3::new(8.0 + 4.0 * random.unit(), 8.0 * random.unit(), 0.0)));
    let plate = positions.len();
    positions.extend((0..60).map(|_| DVec3::new(9.0, 3.0 + 2.0 * random.unit(), 1.0 + 1.5 * random.unit())));
    let above = PointOptions { viewpoint: Some(DVec3::new(6.0, 4.0, 1e3)), ..PointOptions::default() };
    let cloud = splats_from_points(&points(&positions, None), &above, &NoProgress).unwrap().0;
    let radii = radii(&cloud);
    let upward = (0..leaves).filter(|i| cloud.normal(*i).z > 0.0).count() as f64 / leaves as f64;
    let [steep, far] = [&radii[plate..], &radii[sparse..plate]].map(|radii| quantile(radii.iter().copied(), 0.5));
    // Except where the spacing changes.
    let mut place = || DVec3::new(0.3 + 11.0 * random.unit(), 0.3 + 7.4 * random.unit(), 0.0);
    let ground = (0..4000).map(|_| (place(), DVec3::Z)).filter(|(p, _)| (p.x - 8.1).abs() > 0.4);
    let places: Vec<(DVec3, DVec3)> = ground.collect();
    let holes = coverage(&cloud, &places).holes;
    println!("{upward} upward, {steep} on the plate, {far} on sparse ground, {holes} holes");
    assert!(upward > 0.95 && steep < 0.15 && far > 0.15 && holes == 0, "{upward} {steep} {far} {holes}");
}

#[test]
fn a_surface_with_noise_as_large_as_its_spacing_is_no_forest() {
    // A unit sphere of 20,000 points, 0.025 apart, each off by up to 0.02 along each axis.
    let mut random = Lcg(21);
    let mut on_sphere = || loop {
        let p = DVec3::new(random.unit(), random.unit(), random.unit()) * 2.0 - 1.0;
        if (0.01..1.0).contains(&p.length()) {
            let mut shake = || 0.04 * random.unit() - 0.02;
            return p.normalize() + DVec3::new(shake(), shake(), shake());
        }
    };
    let positions: Vec<DVec3> = (0..20_000).map(|_| on_sphere()).collect();
    let cloud = splats_from_points(&points(&positions, None), &PointOptions::default(), &NoProgress).unwrap().0;
    let inward = (0..cloud.len()).filter(|i| cloud.normal(*i).dot(positions[*i]) < 0.0).count();
    let radii = radii(&cloud);
    let least = quantile(radii.iter().copied(), 0.02) / quantile(radii.iter().copied(), 0.5);
    println!("{inward} inward, 2 % of the radii are below {least} medians");
    assert!(inward < 40 && least > 0.7, "{inward} {least}");
}
