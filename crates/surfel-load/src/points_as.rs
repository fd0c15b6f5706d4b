//! Drawing of points as balls, disks or dots, instead of as a surface estimated from them.
//!
//! A surface is estimated in any case, because up axis, view and radii are derived from it. Then each point's splat is
//! replaced by one of the chosen kind, with the same attributes.
//!
//! Points of a bare file are drawn as balls if they are too sparse or too scattered to estimate a surface. Each piece
//! of `EVIDENCE` has a strength from 0 to 1. Points become balls if the sum of the strengths is at least 1:
//!
//! | evidence | strength 0 | strength 1 |
//! | --- | --- | --- |
//! | number of points without normals and radii, times the larger strength of the next two | 16,384 | 256 to 4,096 |
//! | roughness: fraction of points whose neighbours are off the point's plane | 0.12 | 0.26 |
//! | unevenness: fraction of the sum of squared radii in splats above two median radii | 0.06 | 0.2 |
//! | fraction of points on lines, or isolated | 15 % | 45 % |
//!
//! Clouds of fewer than 256 points don't count as few: their files are mostly written by hand, and each splat is
//! visible anyway.

use crate::Error;
use glam::DVec3;
use std::sync::Arc;
use surfel_model::{CloudData, Column3, DOT_PX, Geometry, Object, OnInvalid, PointRadius, PointsAs, Shape, SplatCloud};
use surfel_sample::{PointClass, PointReport};

/// Default radius of a ball or disk, as a fraction of the spacing of the points. At one half, neighbours touch.
pub const RADIUS_OF_SPACING: f64 = 0.5;

/// Returns the radius of an object's balls or disks in world units if no radius is stated: half of the points' spacing.
/// `None` if a radius is stated, and for other kinds of splats and geometry.
pub(crate) fn own_radius(object: &Object, points_as: PointsAs) -> Option<f64> {
    let Geometry::Splats(cloud) = &object.geometry else { return None };
    let is_own = matches!(points_as, PointsAs::Balls(None) | PointsAs::Disks(None)) && !cloud.is_balls();
    is_own.then(|| RADIUS_OF_SPACING * spacing(cloud))
}

/// Returns the median of radii; `None` if there are none. For an even number of radii, returns the larger of the two in
/// the middle.
pub(crate) fn median(mut radii: Vec<f64>) -> Option<f64> {
    radii.sort_unstable_by(f64::total_cmp);
    radii.get(radii.len() / 2).copied()
}

/// Replaces the splats of an object that were made from points by balls, disks or dots. Balls and disks without a
/// stated radius get the radius `shared`, or else their [`own_radius`]; dots get [`DOT_PX`]. Objects of other geometry
/// don't change.
pub(crate) fn redraw(object: &mut Object, points_as: PointsAs, shared: Option<f64>) -> Result<(), Error> {
    let own = || shared.or_else(|| own_radius(object, points_as)).map(PointRadius::World);
    let given = match points_as {
        PointsAs::Surface => None,
        PointsAs::Balls(radius) | PointsAs::Disks(radius) => radius.or_else(own),
        PointsAs::Dots(radius) => radius.or(Some(PointRadius::Pixels(DOT_PX))),
    };
    let Geometry::Splats(cloud) = &object.geometry else { return Ok(()) };
    if cloud.is_balls() || points_as == PointsAs::Surface {
        return Ok(());
    }
    let flat = matches!(points_as, PointsAs::Dots(_));
    let (radius, in_pixels) = match given {
        Some(PointRadius::Pixels(radius)) => (radius, true),
        Some(PointRadius::World(radius)) => (radius, false),
        None => return Ok(()),
    };
    let count = cloud.len();
    let radii = vec![radius as f32; count];
    let shape = match points_as {
        PointsAs::Disks(_) => {
            let normals: Vec<_> = (0..count).map(|i| cloud.normal(i).as_vec3()).collect();
            Shape::Disks { normals: Column3::from_f32(normals), radii }
        }
        _ => Shape::Balls { radii, in_pixels, flat },
    };
    let is_disks = matches!(shape, Shape::Disks { .. });
    let data = Arc::unwrap_or_clone(cloud.clone()).into_data();
    let shading_normals = data.shading_normals.filter(|_| is_disks);
    let data = CloudData { shape, shading_normals, clips: None, interior_weight: None, ..data };
    let (mut cloud, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
    if is_disks && let Some(weight) = surfel_sample::interior_weight(&cloud) {
        cloud.set_interior_weight(weight);
    }
    object.geometry = cloud.into();
    Ok(())
}

/// Returns the typical spacing of points, which is the square root of the area per point. It is estimated from the
/// median radius of the splats made of them; 1 without splats.
pub fn spacing(cloud: &SplatCloud) -> f64 {
    let mut radii: Vec<f64> = (0..cloud.len()).map(|i| cloud.radius_max(i)).collect();
    let middle = radii.len() / 2;
    if radii.is_empty() {
        return 1.0;
    }
    let (_, median, _) = radii.select_nth_unstable_by(middle, f64::total_cmp);
    *median / surfel_sample::DENSITY
}

/// Reason why the points of a file aren't sufficient to estimate a surface, so that they are drawn as balls by default.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SparseReason {
    /// The file has few points, without normals or radii. Neighbours lie off each other's planes, or at uneven
    /// distances.
    Few,
    /// Many of the points are isolated, or lie on lines instead of surfaces.
    Loose,
    /// The file has few points, without normals and radii, and another file of the scene is drawn as balls because of
    /// its few points.
    Others,
}

impl SparseReason {
    /// Returns the reason to draw points as balls, if the sum of the evidence reaches 1: that of the strongest
    /// evidence. `cloud` has the splats made of the points.
    pub(crate) fn of(report: &PointReport, cloud: &SplatCloud) -> Option<Self> {
        let found = EVIDENCE.map(|(reason, strength)| (reason, strength(report, cloud)));
        let score: f64 = found.iter().map(|(_, strength)| strength).sum();
        let strongest = found.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        (score >= 1.0).then_some(strongest.0)
    }

    /// True if the number of points is small enough to count as evidence.
    pub(crate) fn may_be_few(report: &PointReport) -> bool {
        few(report) > 0.0
    }

    /// Returns the reason as the text of a note.
    pub fn words(self) -> &'static str {
        match self {
            Self::Others => "those of other files are, and it has few points, too",
            Self::Few => "they are few, and rough or uneven, without normals and radii",
            Self::Loose => "many are isolated or lie on lines",
        }
    }
}

/// Evidence for drawing points as balls. Each piece has its reason and the function that returns its strength.
const EVIDENCE: [(SparseReason, Strength); 2] =
    [(SparseReason::Few, strength_of_few), (SparseReason::Loose, strength_of_loose)];

/// Function that returns the strength of a piece of evidence, from 0 to 1, for points and the splats made of them.
type Strength = fn(&PointReport, &SplatCloud) -> f64;

/// Three limits on the number of points as evidence for balls. Below the first, points don't count as few. Up to the
/// second, the evidence has full strength. From the third on, it has strength 0.
const FEW: (usize, f64, f64) = (256, 4096.0, 16_384.0);
/// Fractions of points on lines or isolated, at which the strength of this evidence for balls is 0 and 1.
const LOOSE: (f64, f64) = (0.15, 0.45);

/// Values of [`roughness`] at which the strength of this evidence for balls is 0 and 1. Measured with 2,048 points: 0
/// for a sphere or hills, 0.3 to 0.4 for a chair, a bunny or a rocker arm. Measured with 300 points: 0.2 for a sphere.
const ROUGH: (f64, f64) = (0.12, 0.26);

/// Returns the strength of a small number of points as evidence for balls, from 0 to 1. Points with normals or radii
/// never count as few.
fn few(report: &PointReport) -> f64 {
    if report.splats < FEW.0 || report.normals_given > 0 || report.radii_given > 0 {
        return 0.0;
    }
    ((FEW.2 / report.splats as f64).ln() / (FEW.2 / FEW.1).ln()).clamp(0.0, 1.0)
}

fn strength_of_few(report: &PointReport, cloud: &SplatCloud) -> f64 {
    let few = few(report);
    let strength = |share: f64, (none, full): (f64, f64)| ((share - none) / (full - none)).clamp(0.0, 1.0);
    if few == 0.0 { 0.0 } else { few * strength(roughness(cloud), ROUGH).max(strength(unevenness(cloud), UNEVEN)) }
}

/// Values of [`unevenness`] at which the strength of this evidence for balls is 0 and 1. Measured: 0 for evenly
/// distributed points, and 0.05, 0.23 and 0.86 for the visible sides of a lamp, a car and a chair. The legs and the
/// rims of the chair's seat are lines, on which the orientation of disks is arbitrary.
const UNEVEN: (f64, f64) = (0.06, 0.2);

/// Returns the fraction of the sum of squared radii that is due to splats larger than two median radii. It is large if
/// the points' spacing is uneven.
fn unevenness(cloud: &SplatCloud) -> f64 {
    let radii: Vec<f64> = (0..cloud.len()).map(|i| cloud.radius_max(i)).collect();
    let large = 2.0 * surfel_sample::DENSITY * spacing(cloud);
    let area = |least: f64| radii.iter().filter(|r| **r > least).map(|r| r * r).sum::<f64>();
    area(large) / area(0.0).max(f64::MIN_POSITIVE)
}

/// Largest number of splats that are tested for roughness, and number of neighbours with which each is tested.
const ROUGH_SAMPLES: (usize, usize) = (256, 8);

/// Mean distance of a splat's neighbours from its plane, in units of the points' spacing, above which the splat is
/// rough.
const OFF_PLANE: f64 = 0.2;

/// Returns the fraction of rough splats, from 0 to 1, estimated from a sample. The neighbours of a rough splat are off
/// its plane by more than [`OFF_PLANE`] on average.
fn roughness(cloud: &SplatCloud) -> f64 {
    let (most, neighbours) = ROUGH_SAMPLES;
    if cloud.len() <= neighbours {
        return 0.0;
    }
    let centers: Vec<DVec3> = (0..cloud.len()).map(|i| cloud.center(i)).collect();
    let limit = OFF_PLANE * spacing(cloud) * neighbours as f64;
    let mut rough = 0;
    let samples: Vec<usize> = (0..cloud.len()).step_by(cloud.len().div_ceil(most)).collect();
    for i in &samples {
        let mut squares: Vec<(f64, usize)> = centers.iter().map(|p| p.distance_squared(centers[*i])).zip(0..).collect();
        squares.select_nth_unstable_by(neighbours, |a, b| a.0.total_cmp(&b.0));
        let off = |(_, k): &(f64, usize)| (centers[*k] - centers[*i]).dot(cloud.normal(*i)).abs();
        rough += usize::from(squares[..=neighbours].iter().map(off).sum::<f64>() > limit);
    }
    rough as f64 / samples.len() as f64
}

fn strength_of_loose(report: &PointReport, _: &SplatCloud) -> f64 {
    let loose = report.classes[PointClass::Line as usize] + report.classes[PointClass::Isolated as usize];
    let share = loose as f64 / report.splats.max(FEW.0) as f64;
    ((share - LOOSE.0) / (LOOSE.1 - LOOSE.0)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loaded_objects::{LoadedObjects, ObjectFacts};
    use crate::scene::bare_object;

    fn report(splats: usize, loose: usize) -> PointReport {
        let mut report = PointReport { splats, normals_estimated: splats, ..PointReport::default() };
        report.classes[PointClass::Surface as usize] = splats - loose;
        report.classes[PointClass::Isolated as usize] = loose;
        report
    }

    /// Returns disks at random places on a unit square, off its plane by up to `off`.
    fn square(count: usize, off: f64) -> SplatCloud {
        // Multiples of three unrelated numbers fill a cube evenly.
        let fraction = |k: usize, step: f64| (k as f64 * step).fract();
        let place = |k: usize| {
            [fraction(k, 0.754_877_666), fraction(k, 0.569_840_291), off * (fraction(k, 0.414_213_562) - 0.5)]
        };
        let places: Vec<[f32; 3]> = (0..count).map(|k| place(k).map(|x| x as f32)).collect();
        let radius = (surfel_sample::DENSITY / (count as f64).sqrt()) as f32;
        SplatCloud::disks(&places, &vec![[0.0, 0.0, 1.0_f32]; count], &vec![radius; count]).unwrap()
    }

    #[test]
    fn balls_are_chosen_where_points_tell_no_surface() {
        let (rough, smooth) = (square(2048, 0.05), square(2048, 0.0));
        assert!(roughness(&smooth) < 1e-9 && roughness(&rough) > 0.5, "{}", roughness(&rough));
        assert_eq!(SparseReason::of(&report(2048, 0), &rough), Some(SparseReason::Few));
        assert_eq!(SparseReason::of(&report(2048, 0), &smooth), None, "a plane");
        let strays = (0..60u8).map(|k| [f32::from(k), 3.0 + f32::from(k % 7), f32::from(k % 11) - 5.0]);
        let places: Vec<[f32; 3]> = (0..2048).map(|i| smooth.center(i).as_vec3().to_array()).chain(strays).collect();
        let radii = vec![smooth.radius_max(0) as f32; places.len()];
        let normals = [vec![[0.0, 0.0, 1.0_f32]; 2048], vec![[0.0, 0.6, 0.8]; 60]].concat();
        let strewn = SplatCloud::disks(&places, &normals, &radii).unwrap();
        assert_eq!(SparseReason::of(&report(2108, 60), &strewn), None, "a plane and strays: {}", roughness(&strewn));
        // Between few points that are even there are some as far apart as the legs of a chair.
        let with_large = |every: usize| {
            let radius = |i: usize| smooth.radius_max(i) as f32 * if i.is_multiple_of(every) { 4.0 } else { 1.0 };
            let places: Vec<[f32; 3]> = (0..2048).map(|i| smooth.center(i).as_vec3().to_array()).collect();
            SplatCloud::disks(&places, &[[0.0, 0.0, 1.0]; 2048], &(0..2048).map(radius).collect::<Vec<_>>()).unwrap()
        };
        assert_eq!(SparseReason::of(&report(2048, 0), &with_large(12)), Some(SparseReason::Few), "uneven");
        assert_eq!(SparseReason::of(&report(2048, 0), &with_large(300)), None, "nearly even");
        assert_eq!(SparseReason::of(&report(12_000, 0), &with_large(12)), None, "many");
        assert_eq!(SparseReason::of(&PointReport { normals_given: 2048, ..report(2048, 0) }, &rough), None);
        assert_eq!(SparseReason::of(&report(100, 100), &rough), None, "an example");
        assert_eq!(SparseReason::of(&report(50_000, 30_000), &smooth), Some(SparseReason::Loose));
        assert_eq!(SparseReason::of(&report(50_000, 10_000), &rough), None);
        assert_eq!(SparseReason::of(&report(8192, 0), &rough), None);
        assert_eq!(SparseReason::of(&report(8192, 2600), &rough), Some(SparseReason::Loose), "half of either evidence");
    }

    #[test]
    fn every_kind_keeps_the_points_and_their_attributes() {
        let centers: Vec<[f32; 3]> = (0..9u8).map(|i| [f32::from(i % 3), f32::from(i / 3), 0.0]).collect();
        let cloud = SplatCloud::disks(&centers, &[[0.0, 0.0, 1.0]; 9], &[1.65; 9]).unwrap();
        let cloud = cloud.with_colors(&[[0.5, 0.25, 1.0]; 9]).unwrap().with_rows(&[7; 9]).unwrap();
        for (kind, radius, is_balls) in [
            (PointsAs::Surface, 1.65, false),
            (PointsAs::Balls(None), 0.5, true),
            (PointsAs::Balls(Some(PointRadius::World(0.2))), 0.2, true),
            (PointsAs::Disks(None), 0.5, false),
            (PointsAs::Dots(None), 1.5, true),
            (PointsAs::Dots(Some(PointRadius::World(3.0))), 3.0, true),
        ] {
            let mut object = Object::from(cloud.clone());
            redraw(&mut object, kind, None).unwrap();
            let Geometry::Splats(found) = &object.geometry else { panic!("{kind}") };
            assert_eq!((found.len(), found.color(3), found.is_balls()), (9, [0.5, 0.25, 1.0], is_balls), "{kind}");
            assert_eq!((&found.data().rows, found.center(5)), (&cloud.data().rows, cloud.center(5)));
            let (Shape::Balls { radii, .. } | Shape::Disks { radii, .. }) = &found.data().shape else {
                panic!("{kind}")
            };
            assert!(radii.iter().all(|r| (f64::from(*r) - radius).abs() < 1e-6), "{kind}: {radii:?}");
        }
    }

    #[test]
    fn files_that_are_compared_have_balls_of_one_radius() {
        let clouds = [square(1024, 0.0), square(4096, 0.0), square(400, 0.0)];
        let points_as = Some(PointsAs::Balls(None));
        let radii = |has_one_radius: bool| {
            let mut loaded = LoadedObjects { has_one_radius, ..LoadedObjects::default() };
            loaded.objects = clouds.clone().map(Object::from).to_vec();
            loaded.facts = vec![ObjectFacts { points: true, ..ObjectFacts::default() }; 3];
            let mut file = bare_object("a.xyz".as_ref());
            file.convert.points_as = points_as;
            loaded.draw_points(&vec![file; 3]).unwrap();
            let radius = |object: &Object| match &object.geometry {
                Geometry::Splats(cloud) => cloud.radius_max(0) as f32,
                _ => panic!(),
            };
            loaded.objects.iter().map(radius).collect::<Vec<_>>()
        };
        let own = [1024.0_f32, 4096.0, 400.0].map(|count| 0.5 / count.sqrt());
        assert!(radii(false).iter().zip(own).all(|(found, own)| (found - own).abs() < 1e-6));
        assert!(radii(true).iter().all(|found| (found - own[0]).abs() < 1e-6), "the median");
    }
}
