//! Sharp features of point clouds without a mesh: where a neighbourhood lies on two or three planes, splats are given one
//! of them each and clipped by the others, so that both sides of an edge end at the same line (Z04: clip lines).
//!
//! Source: ours. Z04 and C12 clip, but take edges as given.

use crate::eigen::symmetric3;
use crate::neighbours::{Neighbours, map_each};
use crate::normals::covariance;
use crate::tree::Nearest;
use crate::{Progress, SampleError, assemble, interior, radii};
use glam::DVec3;
use surfel_math::basis::{orthonormal, unit};
use surfel_model::{ClipColumns, ClipLine, ClipMode, CloudData, Column3, NO_LINE, OnInvalid, SplatCloud};

/// Neighbours that tell whether a point is amid a flat piece: few, so that pieces reach close to edges.
const FLAT_NEIGHBOURS: usize = 12;
/// Neighbours among which planes are looked for: enough that each of a corner's three faces has flat ones.
const WIDE: usize = 112;
/// Flat neighbours that make a plane.
const LEAST_ON_PLANE: usize = 4;
/// Residuals of a flat neighbourhood over the cloud's median one, so that noise counts as flat.
const NOISE_MARGIN: f64 = 2.0;
/// Residual of a flat neighbourhood over its extent, where there is no noise: the bow of a curved surface.
const BOW: f64 = 0.02;
/// Normals that belong to one plane differ by at most this share of the crease angle.
const SAME_SHARE: f64 = 0.625;
/// A point that lies farther than this from every plane belongs to none, in spacings.
const FAR_SPACINGS: f64 = 0.35;
/// The same over the median residual.
const FAR_RESIDUALS: f64 = 4.0;

/// What was found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SharpPointsReport {
    /// Splats clipped by a line.
    pub clipped: usize,
    /// Of them, by two lines: corners.
    pub corners: usize,
    /// Splats that were turned into a plane beside an edge, and moved onto it.
    pub turned: usize,
}

/// Clips splats made of points (by [`crate::splats_from_points`]) along the edges that the points show: where planes meet
/// at more than `crease_angle_deg` (1 to 179 degrees). Disks become ellipses of equal axes.
///
/// Planes are means of flat neighbourhoods' planes, weighted by nearness, in up to three clusters by normal; a point amid
/// them takes the nearest, and its splat ends where that plane meets the others. Both sides intersect the same planes, up to
/// the difference of their weights. Limits: features narrower than about three spacings stay round, and a face's reflex corner
/// is cut as if it were convex.
///
/// # Errors
/// [`SampleError::Option`] for the angle, [`SampleError::TooMany`] above 268 million splats, [`SampleError::Model`] never
/// for a valid cloud without clips.
pub fn sharpen_points(
    cloud: &SplatCloud,
    crease_angle_deg: f64,
    progress: &dyn Progress,
) -> Result<(SplatCloud, SharpPointsReport), SampleError> {
    if !(1.0..=179.0).contains(&crease_angle_deg) {
        return Err(SampleError::option("the crease angle", crease_angle_deg, "1 to 179 degrees"));
    }
    let positions: Vec<DVec3> = (0..cloud.len()).map(|i| cloud.center(i)).collect();
    let points = Neighbours::new(&positions, FLAT_NEIGHBOURS, progress)?;
    let patches = Patches::new(&points, cloud, crease_angle_deg.to_radians(), progress);
    progress.stage("edges", points.len() as u64);
    let state = || (Nearest::new(WIDE + 1), Vec::new());
    let sides = map_each(points.len(), progress, state, |(found, wide), slot| {
        points.widen(slot, found, wide);
        patches.side(slot, wide)
    });
    assemble_cloud(cloud, &points, &sides, &positions)
}

/// The flat piece about a point, in working coordinates.
#[derive(Clone, Copy)]
struct Patch {
    center: DVec3,
    /// Unit, outward.
    normal: DVec3,
    is_flat: bool,
}

/// A plane through `center`, the weighted mean of flat patches.
#[derive(Clone, Copy)]
struct Plane {
    center: DVec3,
    normal: DVec3,
}

impl Plane {
    fn distance(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.center)
    }
}

/// What becomes of a splat beside an edge, in working coordinates.
#[derive(Clone, Debug)]
struct Side {
    center: DVec3,
    /// The plane's normal where the splat is turned.
    turned: Option<DVec3>,
    /// Half-spaces that keep it: unit normals into them, and the signed distance of the centre.
    keeps: Vec<(DVec3, f64)>,
}

struct Patches<'a> {
    points: &'a Neighbours,
    patches: Vec<Patch>,
    /// Median distance of flat neighbourhoods' points from their planes.
    residual: f64,
    spacing: f64,
    crease_cos: f64,
    same_cos: f64,
}

impl<'a> Patches<'a> {
    fn new(points: &'a Neighbours, cloud: &SplatCloud, crease: f64, progress: &dyn Progress) -> Self {
        progress.stage("planes", points.len() as u64);
        let fits = map_each(
            points.len(),
            progress,
            || (),
            |(), slot| {
                let near = points.of(slot);
                let (values, vectors) = symmetric3(covariance(points, slot, near));
                let count = (near.len() + 1) as f64;
                let offset = |j: &u32| points.point(*j as usize) - points.point(slot);
                let center = points.point(slot) + near.iter().map(offset).sum::<DVec3>() / count;
                let outward = cloud.normal(points.first_of[slot] as usize);
                let normal = if vectors[0].dot(outward) < 0.0 { -vectors[0] } else { vectors[0] };
                let [residual, _, extent] = values.map(|v| (v / count).max(0.0).sqrt());
                let spacing =
                    near.iter().take(6).map(|j| offset(j).length()).sum::<f64>() / near.len().clamp(1, 6) as f64;
                (Patch { center, normal, is_flat: false }, residual, extent, spacing)
            },
        );
        let residual = radii::median(&mut fits.iter().map(|f| f.1).collect::<Vec<_>>()).unwrap_or(0.0);
        let spacing = radii::median(&mut fits.iter().map(|f| f.3).collect::<Vec<_>>()).unwrap_or(0.0);
        let is_flat = |found: f64, extent: f64| found <= (NOISE_MARGIN * residual).max(BOW * extent);
        let patches = fits
            .iter()
            .map(|(patch, found, extent, _)| Patch { is_flat: is_flat(*found, *extent), ..*patch })
            .collect();
        Self { points, patches, residual, spacing, crease_cos: crease.cos(), same_cos: (SAME_SHARE * crease).cos() }
    }

    /// The planes about a point; none or one where nothing is sharp.
    fn planes(&self, slot: usize, wide: &[u32]) -> Vec<Plane> {
        let p = self.points.point(slot);
        let flat: Vec<Patch> = std::iter::once(slot)
            .chain(wide.iter().map(|j| *j as usize))
            .filter(|j| self.patches[*j].is_flat)
            .map(|j| self.patches[j])
            .collect();
        // The nearest flat normal, the one farthest from it, and the one farthest from both.
        let mut seeds: Vec<DVec3> = flat.first().map(|f| f.normal).into_iter().collect();
        for _ in 0..2 {
            let nearness = |n: DVec3| seeds.iter().map(|s| s.dot(n)).fold(f64::NEG_INFINITY, f64::max);
            let farthest = flat.iter().map(|f| f.normal).min_by(|a, b| nearness(*a).total_cmp(&nearness(*b)));
            match farthest.filter(|n| nearness(*n) < self.crease_cos) {
                Some(n) => seeds.push(n),
                None => break,
            }
        }
        let mut planes: Vec<Plane> = seeds.into_iter().map(|normal| Plane { center: p, normal }).collect();
        // Means of what is nearest to each, a few times over (Lloyd 1982).
        for _ in 0..4 {
            let mut sums = vec![(DVec3::ZERO, DVec3::ZERO, 0.0, 0usize); planes.len()];
            for patch in &flat {
                let cosine = |i: &usize| planes[*i].normal.dot(patch.normal);
                let Some(best) = (0..planes.len()).max_by(|a, b| cosine(a).total_cmp(&cosine(b))) else { continue };
                if cosine(&best) <= self.same_cos {
                    continue;
                }
                let offset = patch.center - p;
                let weight = 1.0 / (offset.length_squared() + (1.5 * self.spacing).powi(2)).max(f64::MIN_POSITIVE);
                let (normal, center, total, count) = &mut sums[best];
                *normal += patch.normal * weight;
                *center += offset * weight;
                *total += weight;
                *count += 1;
            }
            let sound = |s: &&(DVec3, DVec3, f64, usize)| s.3 >= LEAST_ON_PLANE && s.0 != DVec3::ZERO;
            planes = sums.iter().filter(sound).map(|s| Plane { center: p + s.1 / s.2, normal: unit(s.0) }).collect();
        }
        planes
    }

    /// What becomes of the splats at a point; `None` where no edge is.
    fn side(&self, slot: usize, wide: &[u32]) -> Option<Side> {
        let planes = self.planes(slot, wide);
        if planes.len() < 2 {
            return None;
        }
        let (p, patch) = (self.points.point(slot), self.patches[slot]);
        let rank = |plane: &Plane| {
            if patch.is_flat { -plane.normal.dot(patch.normal) } else { plane.distance(p).abs() }
        };
        let own = *planes.iter().min_by(|a, b| rank(a).total_cmp(&rank(b)))?;
        let far = (FAR_RESIDUALS * self.residual).max(FAR_SPACINGS * self.spacing);
        if own.distance(p).abs() >= far {
            return None;
        }
        let (center, turned) =
            if patch.is_flat { (p, None) } else { (p - own.normal * own.distance(p), Some(own.normal)) };
        let normal = turned.unwrap_or(patch.normal);
        let others = planes.iter().filter(|plane| normal.dot(plane.normal) < self.same_cos);
        let keep = |plane: &Plane| {
            let side = plane.distance(own.center).signum();
            (plane.normal * side, plane.distance(center) * side)
        };
        Some(Side { center, turned, keeps: others.map(keep).collect() })
    }
}

fn assemble_cloud(
    cloud: &SplatCloud,
    points: &Neighbours,
    sides: &[Option<Side>],
    positions: &[DVec3],
) -> Result<(SplatCloud, SharpPointsReport), SampleError> {
    let mut report = SharpPointsReport::default();
    let mut centers = positions.to_vec();
    let (mut axes, mut lines) = (Vec::with_capacity(cloud.len()), Vec::with_capacity(cloud.len()));
    for (i, center) in centers.iter_mut().enumerate() {
        let (mut s, mut t) = cloud.axes(i);
        let mut own = [NO_LINE; 4];
        if let Some(side) = &sides[points.slot_of[i] as usize] {
            if let Some(normal) = side.turned {
                let radius = (s.length() * t.length()).sqrt();
                (s, t) = orthonormal(normal);
                (s, t) = (s * radius, t * radius);
                *center = points.center + side.center * points.scale;
                report.turned += 1;
            }
            let mut count = 0;
            for (into, distance) in &side.keeps {
                let [a, b, c] = [s.dot(*into), t.dot(*into), distance * points.scale];
                // Lines that miss the disk clip nothing.
                if c.abs() < a.hypot(b) && count < own.len() {
                    own[count] = ClipLine { a: a as f32, b: b as f32, c: c as f32 };
                    count += 1;
                }
            }
            report.clipped += usize::from(count > 0);
            report.corners += usize::from(count > 1);
        }
        axes.push((s, t));
        lines.push(own);
    }
    let data = cloud.data().clone();
    let (origin, centers) = Column3::with_origin(&centers);
    let mut data = CloudData { origin, centers, shape: assemble::ellipses(&axes), ..data };
    if report.clipped > 0 {
        data.clips =
            Some(ClipColumns { curves: None, lines: Some(lines), modes: Some(vec![ClipMode::And; positions.len()]) });
    }
    let (mut sharp, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
    if let Some(weight) = interior::interior_weight(&sharp) {
        sharp.set_interior_weight(weight);
    }
    Ok((sharp, report))
}
