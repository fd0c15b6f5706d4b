//! Detection of stray points: few points far away from all others. If they were framed, the other points of a scene
//! would be small in the image.

use glam::DVec3;
use surfel_model::{Column3, Geometry, Object, PointCloud};
use surfel_sample::{NoProgress, outliers};

/// Kind of a scene's geometry, which determines the criteria for stray points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Clouds of splats. Their stray points are isolated.
    Splats,
    /// Trained Gaussians. Their scene is surrounded by clumps, and by haze that becomes thinner outwards.
    Gaussians,
    /// Other geometry, and scenes with several kinds.
    Other,
}

impl Kind {
    /// Returns the kind of geometry of objects.
    pub fn of(objects: &[Object]) -> Self {
        let are_all = |is: fn(&Geometry) -> bool| objects.iter().all(|object| is(&object.geometry));
        if are_all(|geometry| matches!(geometry, Geometry::Splats(_))) {
            Self::Splats
        } else if are_all(|geometry| matches!(geometry, Geometry::Gaussians(_))) {
            Self::Gaussians
        } else {
            Self::Other
        }
    }

    /// Returns N, where at most 1 in N points of a scene may be a stray.
    const fn one_in(self) -> usize {
        match self {
            Self::Splats => 25,
            Self::Gaussians => 50,
            Self::Other => 200,
        }
    }

    /// Returns the ratio of two distances from the centre above which strays are left out of the frame. For clouds of
    /// splats, they are those of the farthest stray and of the farthest other point. Otherwise, they are those of any
    /// stray and of the farthest point that remains when the farthest 1 in N ([`Self::one_in`]) is excluded. In
    /// perspective, a point toward the eye, 1.5 times as far from the centre as all others, would make the other points
    /// less than half as high as the image.
    const fn farther(self) -> f64 {
        match self {
            Self::Splats | Self::Gaussians => 1.5,
            Self::Other => 4.0,
        }
    }
}

/// Factor on the radius of a sphere around the sampled points that aren't strays. The enlarged sphere also contains
/// nearly all points that weren't sampled.
const SLACK: f64 = 1.1;
/// Smallest number of sampled points from which stray points are detected.
const FEWEST: usize = 200;
/// Number of far points above which only a regular sample of them is tested for isolation.
const JUDGED: usize = 1000;

/// Sphere in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Centre of the sphere.
    pub middle: DVec3,
    /// Radius in world units.
    pub radius: f64,
}

impl Sphere {
    /// True if the sphere contains a point.
    pub fn contains(&self, p: DVec3) -> bool {
        p.distance(self.middle) <= self.radius
    }
}

/// Returns a sphere around a scene without its stray points, or `None` if no stray points are detected or `sample` has
/// fewer than 200 points. `sample` is a selection of the scene's `total` points. `far(middle, distance)` returns all
/// points of the scene that are farther than `distance` from `middle`.
///
/// - In clouds of splats, at most 1 point in 25 is a stray. All strays are isolated by the criteria of [`outliers`],
///   and the farthest is more than 1.5 sphere radii from the centre. The sphere contains all sampled points that aren't
///   isolated, so that no part of the surface is lost.
/// - Among Gaussians, at most 1 in 50 is a stray. Each stray is more than 1.5 times as far from the centre as the
///   nearest 98 % of the sampled Gaussians.
/// - In other geometry, at most 1 point in 200 is a stray. Each stray is more than four times as far from the centre as
///   the nearest 99.5 % of the sampled points.
pub fn without_strays(
    (sample, total): (&[DVec3], usize),
    kind: Kind,
    far: impl FnOnce(DVec3, f64) -> Vec<DVec3>,
) -> Option<Sphere> {
    let count = sample.len();
    if count < FEWEST {
        return None;
    }
    let median = |axis: usize| {
        let mut values: Vec<f64> = sample.iter().map(|p| p[axis]).collect();
        *values.select_nth_unstable_by(count / 2, f64::total_cmp).1
    };
    let middle = DVec3::new(median(0), median(1), median(2));
    let mut distances: Vec<f64> = sample.iter().map(|p| p.distance(middle)).collect();
    let rank = count - 1 - count / kind.one_in();
    let core = *distances.select_nth_unstable_by(rank, f64::total_cmp).1;
    let limit = core * kind.farther();
    let far = if core > 0.0 { far(middle, limit) } else { Vec::new() };
    let farthest = far.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
    if far.is_empty() || kind != Kind::Splats {
        return (!far.is_empty()).then_some(Sphere { middle, radius: limit });
    }
    if far.len() * kind.one_in() > total {
        return None;
    }
    // Far points may be sampled more densely than the others. This only makes parts of the surface denser, too.
    let near = sample.iter().filter(|p| p.distance(middle) <= limit);
    let judged = near.chain(far.iter().step_by(far.len().div_ceil(JUDGED)));
    let relative: Vec<DVec3> = judged.map(|p| *p - middle).collect();
    let cloud = PointCloud { positions: Column3::from_f64(&relative), ..PointCloud::default() };
    let is_alone = outliers(&cloud, &NoProgress).ok()?;
    let others = relative.iter().zip(&is_alone).filter(|(_, is_alone)| !**is_alone);
    let radius = SLACK * others.fold(core, |most, (p, _)| most.max(p.length()));
    (farthest > kind.farther() * radius).then_some(Sphere { middle, radius })
}

/// Returns the sphere around points without strays ([`without_strays`]), or `None` if there are no strays. `all` has
/// all points of the scene.
pub fn without_strays_of(all: &[DVec3], kind: Kind) -> Option<Sphere> {
    let far = |middle: DVec3, limit: f64| all.iter().copied().filter(|p| p.distance(middle) > limit).collect();
    without_strays((all, all.len()), kind, far)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns `count` points on a sphere about `middle`.
    fn ball(count: usize, middle: DVec3, radius: f64) -> impl Iterator<Item = DVec3> {
        let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        (0..count).map(move |i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            middle + DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z) * radius
        })
    }

    /// Returns points scattered at 3 to `times` times the radius of a unit sphere.
    fn strays(count: usize, times: f64) -> impl Iterator<Item = DVec3> {
        let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        (0..count).map(move |i| {
            let share = (i as f64 * 0.618_034).fract();
            let z = 2.0 * (i as f64 * 0.754_878).fract() - 1.0;
            let (sin, cos) = (golden * i as f64).sin_cos();
            DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z) * (3.0 + (times - 3.0) * share)
        })
    }

    #[test]
    fn few_isolated_points_far_out_are_strays_whatever_the_size() {
        for count in [2000, 6000] {
            for (share, times) in [(0.005, 50.0), (0.01, 5.0), (0.03, 3.5), (0.03, 20.0), (0.035, 50.0)] {
                let alone = (count as f64 * share) as usize;
                for (scale, offset) in [(1.0, DVec3::ZERO), (1e-6, DVec3::ZERO), (1e3, DVec3::splat(5e6))] {
                    let all = ball(count, DVec3::ZERO, 1.0).chain(strays(alone, times));
                    let all: Vec<DVec3> = all.map(|p| p * scale + offset).collect();
                    let Sphere { middle, radius } = without_strays_of(&all, Kind::Splats).unwrap();
                    assert!(middle.distance(offset) < 0.2 * scale, "{count} {share} {times}");
                    assert!(radius > scale && radius < 1.4 * scale, "{count} {share} {times} {scale}: {radius}");
                }
            }
        }
    }

    #[test]
    fn small_parts_far_out_and_sparse_surroundings_are_no_strays() {
        let with = |others: Vec<DVec3>| {
            without_strays_of(&ball(10_000, DVec3::ZERO, 1.0).chain(others).collect::<Vec<_>>(), Kind::Splats)
        };
        assert_eq!(with(Vec::new()), None);
        // A part of 1 %, as dense as the rest; with strays beyond it, the sphere holds the part.
        let part = || ball(100, DVec3::X * 12.0, 0.1).collect::<Vec<_>>();
        assert_eq!(with(part()), None);
        let Sphere { middle, radius } = with(part().into_iter().chain(strays(100, 60.0)).collect()).unwrap();
        assert!(middle.length() < 0.1 && radius > 12.1 && radius < 14.0, "{radius}");
        // One point in ten far out isn't few.
        assert_eq!(with(strays(1000, 6.0).collect()), None);
        // Points that are little farther out don't matter.
        assert_eq!(with(ball(50, DVec3::ZERO, 1.5).collect()), None);
    }

    #[test]
    fn strays_of_other_geometry_are_few_and_far_in_clumps_or_alone() {
        let clump: Vec<DVec3> = ball(10_000, DVec3::ZERO, 1.0).chain(ball(40, DVec3::X * 9.0, 0.01)).collect();
        let Sphere { radius, .. } = without_strays_of(&clump, Kind::Other).unwrap();
        assert!((radius - 4.0).abs() < 0.05, "{radius}");
        assert_eq!(without_strays_of(&clump, Kind::Splats), None);
        let many: Vec<DVec3> = ball(10_000, DVec3::ZERO, 1.0).chain(ball(60, DVec3::X * 9.0, 0.01)).collect();
        assert_eq!(without_strays_of(&many, Kind::Other), None);
    }

    #[test]
    fn strays_of_gaussians_are_haze_that_thins_out() {
        let with = |count: usize| -> Vec<DVec3> {
            ball(10_000, DVec3::ZERO, 1.0).chain(strays(count, 6.0).map(|p| 0.6 * p)).collect()
        };
        let Sphere { radius, .. } = without_strays_of(&with(150), Kind::Gaussians).unwrap();
        assert!((radius - 1.5).abs() < 0.02, "{radius}");
        assert_eq!(without_strays_of(&with(150), Kind::Other), None);
        assert_eq!(without_strays_of(&with(0), Kind::Gaussians), None);
    }

    #[test]
    fn strays_and_parts_that_a_sample_misses_count() {
        let few: Vec<DVec3> = ball(10_000, DVec3::ZERO, 1.0).collect();
        let with = |others: Vec<DVec3>| {
            let far =
                |middle: DVec3, limit: f64| others.iter().copied().filter(|p| p.distance(middle) > limit).collect();
            without_strays((&few, 1_000_000), Kind::Splats, far)
        };
        assert!(with(strays(3, 50.0).collect()).is_some_and(|sphere| sphere.radius < 1.2));
        assert!(with(strays(30_000, 50.0).collect()).is_some_and(|sphere| sphere.radius < 1.4));
        assert_eq!(with(ball(300, DVec3::X * 12.0, 0.05).collect()), None);
        assert_eq!(with(strays(60_000, 50.0).collect()), None, "not few");
    }
}
