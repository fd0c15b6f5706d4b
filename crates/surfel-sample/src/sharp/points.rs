//! Clipping of the splats of points along detected edges. If a neighbourhood consists of two or three planes, each
//! splat is assigned to one of them and clipped by the others. Both sides of an edge thus end at the same line (Z04:
//! clip lines).
//!
//! The method is our own. Z04 and C12 clip too, but require edges as input.
//!
//! A *slot* is a point's place in the order of [`SortedPoints`](crate::sorted::SortedPoints), and a *grid step* is the
//! unit of its coordinates. A point's *patch* is the plane fitted to the point and its nearest neighbours. Its *wide*
//! neighbours are the [`WIDE`] nearest ones, among whose patches planes are searched.

use crate::eigen::symmetric3;
use crate::nearest::Search;
use crate::neighbours::Neighbours;
use crate::normals::covariance;
use crate::parallel::map_each;
use crate::{Progress, SampleError, assemble, interior, radii};
use glam::DVec3;
use surfel_math::basis::{orthonormal, unit};
use surfel_model::{ClipColumns, ClipLine, ClipMode, CloudData, Column3, NO_LINE, OnInvalid, SplatCloud};

/// Number of neighbours from which a point's patch is fitted and tested for flatness. The number is small, so that flat
/// patches reach close to edges.
const FLAT_NEIGHBOURS: usize = 12;
/// Number of neighbours of a point among whose patches planes are searched. With this many, each of a corner's three
/// faces has flat patches.
const WIDE: usize = 112;
/// Smallest number of flat patches ([`Patch`]) that form a plane ([`Plane`]).
const MIN_ON_PLANE: usize = 4;
/// Largest residual ([`PlaneFit::residual`]) of a flat patch, relative to the median residual of the cloud, which
/// measures noise. Noisy surfaces thus count as flat.
const NOISE_MARGIN: f64 = 2.0;
/// Largest residual ([`PlaneFit::residual`]) of a flat patch, relative to its extent, regardless of noise. The limit
/// admits patches of a slightly curved surface.
const BOW: f64 = 0.02;
/// Largest angle between the normals of a flat patch and of the plane to which the patch is assigned, as a fraction of
/// the crease angle. Planes whose normals differ by no more don't form an edge.
const SAME_SHARE: f64 = 0.625;
/// Smallest ratio of the angle between two planes to the larger of their spreads of normals ([`Plane::spread`]) at
/// which the planes meet in an edge. The ratio is 3.5 for two halves of an even bend, and less for two caps of a
/// sphere. It is 9 for an edge of 45° between faces with 5° of noise.
const JUMP: f64 = 6.0;
/// Smallest fraction of the angle between two planes that must remain at their edge if each side is assumed to continue
/// its bend. Otherwise the surface is curved and has no edge.
const AT_EDGE: f64 = 0.7;
/// Smallest one-sidedness of a face at which it meets another face's plane in an edge. One-sidedness is 1 if the whole
/// face is on one side of the plane, and 0 if equal parts are on both sides.
const ONE_SIDED: f64 = 0.5;
/// Distance from a plane, in point spacings, from which a patch counts fully for its side of the plane
/// ([`Plane::side_of`]); nearer patches count less.
const SIDE_SPACINGS: f64 = 0.5;
/// Distance of a point from its plane, in point spacings, from which the point belongs to no plane. The larger of this
/// limit and [`FAR_RESIDUALS`] counts.
const FAR_SPACINGS: f64 = 0.35;
/// Distance of a point from its plane, in units of the cloud's median residual ([`PlaneFit::residual`]), from which the
/// point belongs to no plane ([`FAR_SPACINGS`]).
const FAR_RESIDUALS: f64 = 4.0;

/// Report of [`sharpen_points`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SharpPointsReport {
    /// Number of splats that got at least one clip line.
    pub clipped: usize,
    /// Number of splats clipped by at least two lines, as at corners.
    pub corners: usize,
    /// Number of splats next to an edge that were moved onto a plane and turned parallel to it.
    pub turned: usize,
}

/// Clips splats made of points (by [`crate::splats_from_points`]) along edges detected in the points. An edge is where
/// planes meet that contain patches whose normals differ by more than `crease_angle_deg` (1 to 179 degrees). The
/// planes' own normals, which are means, differ by at least 0.625 of that angle. Disks become ellipses of equal axes.
///
/// Each plane is the mean of flat patches, weighted by nearness; patches form up to three clusters by normal. A point
/// is assigned to the nearest plane, and its splat ends where that plane meets the others. Both sides of an edge use
/// the same planes, apart from different weights.
///
/// Two planes meet in an edge only if their normals differ by several times the spread on either side. Most of the
/// difference must remain if either side is assumed to continue its bend, because a curved surface has no edge, however
/// sparsely sampled. If a face turns around a reflex corner, its visible part is the union of two half-planes. Features
/// narrower than about three spacings stay round. The method is our own; Z04 defines the clip lines.
///
/// # Errors
/// [`SampleError::Option`] for the angle, and [`SampleError::TooMany`] above 268 million splats. [`SampleError::Model`]
/// doesn't occur for a valid cloud without clips.
pub fn sharpen_points(
    cloud: &SplatCloud,
    crease_angle_deg: f64,
    progress: &dyn Progress,
) -> Result<(SplatCloud, SharpPointsReport), SampleError> {
    SampleError::check_crease_angle(crease_angle_deg)?;
    let positions: Vec<DVec3> = (0..cloud.len()).map(|i| cloud.center(i)).collect();
    let points = Neighbours::new(&positions, FLAT_NEIGHBOURS, progress)?;
    let patches = Patches::new(&points, cloud, crease_angle_deg.to_radians(), progress);
    progress.stage("edges", points.len() as u64);
    let state = || Search::new(&points.points);
    let sides =
        map_each(points.len(), progress, state, |search, slot| patches.side(slot, search.nearest(slot, WIDE, 0.0).0));
    assemble_cloud(cloud, &points, &sides, &positions)
}

/// Patch of the surface around a point, as a plane. Lengths are in grid steps from the centre of all points.
#[derive(Clone, Copy, Default)]
struct Patch {
    center: DVec3,
    /// Unit normal on the outer side of the surface.
    normal: DVec3,
    is_flat: bool,
}

/// Plane fitted to a point and its neighbours, and measures of its flatness, in grid steps.
#[derive(Clone, Copy, Default)]
struct PlaneFit {
    patch: Patch,
    /// Standard deviation of the points perpendicular to the plane (the residual).
    residual: f64,
    /// Largest standard deviation of the points along a direction in the plane.
    extent: f64,
    /// Mean distance from the point to its six nearest neighbours.
    spacing: f64,
}

/// Plane near a point: the weighted mean of flat patches with similar normals. It passes through `center` and has the
/// unit normal `normal`.
#[derive(Clone)]
struct Plane {
    center: DVec3,
    normal: DVec3,
    /// Root mean square angle between the patches' normals and their mean, in radians.
    spread: f64,
    /// Flat patches that belong to the plane.
    members: Vec<Patch>,
}

impl Plane {
    fn distance(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.center)
    }

    /// Returns on which side of another plane this plane's patches are: from −1 (all behind it) to 1 (all in front).
    /// Patches nearer to that plane than `width` count less.
    fn side_of(&self, other: &Self, width: f64) -> f64 {
        let side = |patch: &Patch| (other.distance(patch.center) / width).clamp(-1.0, 1.0);
        self.members.iter().map(side).sum::<f64>() / self.members.len().max(1) as f64
    }

    /// Extrapolates the direction of the patches' normals to the edge that passes through `edge`. Returns the direction
    /// as an angle in radians, from `across` toward `away`. A line is fitted to the patches' angles over their distance
    /// from the edge along `outward`, a unit vector in the plane and perpendicular to the edge.
    fn angle_at_edge(&self, edge: DVec3, outward: DVec3, [across, away]: [DVec3; 2]) -> f64 {
        let count = self.members.len().max(1) as f64;
        let place = |patch: &Patch| (patch.center - edge).dot(outward);
        let angle = |patch: &Patch| patch.normal.dot(away).atan2(patch.normal.dot(across));
        let mean = |f: &dyn Fn(&Patch) -> f64| self.members.iter().map(f).sum::<f64>() / count;
        let (place_mean, angle_mean) = (mean(&place), mean(&angle));
        let variance = mean(&|m| (place(m) - place_mean).powi(2));
        let covariance = mean(&|m| (place(m) - place_mean) * (angle(m) - angle_mean));
        let slope = if variance > 0.0 { covariance / variance } else { 0.0 };
        angle_mean - slope * place_mean
    }
}

/// Splat next to an edge, turned and clipped. Its position is in grid steps from the centre of all points.
#[derive(Clone, Debug)]
struct Side {
    center: DVec3,
    /// Normal of the plane into which the splat is turned; `None` if it isn't turned.
    turned: Option<DVec3>,
    /// Half-spaces that clip the splat, each as the unit normal into the half-space and the signed distance of the
    /// splat's centre.
    keeps: Vec<(DVec3, f64)>,
    mode: ClipMode,
}

struct Patches<'a> {
    points: &'a Neighbours,
    patches: Vec<Patch>,
    /// Median over all points of [`PlaneFit::residual`], in grid steps.
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
                let (values, vectors) = symmetric3(covariance(&points.points, slot, near));
                let count = (near.len() + 1) as f64;
                let offset = |j: &u32| points.point(*j as usize) - points.point(slot);
                let center = points.point(slot) + near.iter().map(offset).sum::<DVec3>() / count;
                let outward = cloud.normal(points.points.inputs(slot)[0] as usize);
                let normal = if vectors[0].dot(outward) < 0.0 { -vectors[0] } else { vectors[0] };
                let [residual, _, extent] = values.map(|v| (v / count).max(0.0).sqrt());
                let spacing =
                    near.iter().take(6).map(|j| offset(j).length()).sum::<f64>() / near.len().clamp(1, 6) as f64;
                PlaneFit { patch: Patch { center, normal, is_flat: false }, residual, extent, spacing }
            },
        );
        let residual = radii::median(&mut fits.iter().map(|f| f.residual).collect::<Vec<_>>()).unwrap_or(0.0);
        let spacing = radii::median(&mut fits.iter().map(|f| f.spacing).collect::<Vec<_>>()).unwrap_or(0.0);
        let is_flat = |found: f64, extent: f64| found <= (NOISE_MARGIN * residual).max(BOW * extent);
        let patches =
            fits.iter().map(|fit| Patch { is_flat: is_flat(fit.residual, fit.extent), ..fit.patch }).collect();
        Self { points, patches, residual, spacing, crease_cos: crease.cos(), same_cos: (SAME_SHARE * crease).cos() }
    }

    /// Returns the planes around the point `slot`, found among the flat patches of its `wide` neighbours; an edge needs
    /// at least two.
    fn planes(&self, slot: usize, wide: &[u32]) -> Vec<Plane> {
        let p = self.points.point(slot);
        let flat: Vec<Patch> = std::iter::once(slot)
            .chain(wide.iter().map(|j| *j as usize))
            .filter(|j| self.patches[*j].is_flat)
            .map(|j| self.patches[j])
            .collect();
        // The seeds are the nearest flat normal, the one farthest from it, and the one farthest from both.
        let mut seeds: Vec<DVec3> = flat.first().map(|f| f.normal).into_iter().collect();
        for _ in 0..2 {
            let nearness = |n: DVec3| seeds.iter().map(|s| s.dot(n)).fold(f64::NEG_INFINITY, f64::max);
            let farthest = flat.iter().map(|f| f.normal).min_by(|a, b| nearness(*a).total_cmp(&nearness(*b)));
            match farthest.filter(|n| nearness(*n) < self.crease_cos) {
                Some(n) => seeds.push(n),
                None => break,
            }
        }
        let seed = |normal| Plane { center: p, normal, spread: 0.0, members: Vec::new() };
        let mut planes: Vec<Plane> = seeds.into_iter().map(seed).collect();
        // Means of the patches nearest to each plane, iterated a few times (Lloyd 1982).
        for _ in 0..4 {
            let mut sums = vec![(DVec3::ZERO, DVec3::ZERO, 0.0, Vec::<Patch>::new()); planes.len()];
            for patch in &flat {
                let cosine = |i: &usize| planes[*i].normal.dot(patch.normal);
                let Some(best) = (0..planes.len()).max_by(|a, b| cosine(a).total_cmp(&cosine(b))) else { continue };
                if cosine(&best) <= self.same_cos {
                    continue;
                }
                let offset = patch.center - p;
                let weight = 1.0 / (offset.length_squared() + (1.5 * self.spacing).powi(2)).max(f64::MIN_POSITIVE);
                let (normal, center, total, members) = &mut sums[best];
                *normal += patch.normal * weight;
                *center += offset * weight;
                *total += weight;
                members.push(*patch);
            }
            let sound = |s: &(DVec3, DVec3, f64, Vec<Patch>)| s.3.len() >= MIN_ON_PLANE && s.0 != DVec3::ZERO;
            let mean = |(normal, center, total, members): (DVec3, DVec3, f64, Vec<Patch>)| Plane {
                center: p + center / total,
                normal: unit(normal),
                // For unit vectors, 2 − 2·|mean| is the mean squared distance from the mean's direction.
                spread: (2.0 - 2.0 * normal.length() / total).max(0.0).sqrt(),
                members,
            };
            planes = sums.into_iter().filter(sound).map(mean).collect();
        }
        planes
    }

    /// Returns the kind of edge in which two planes meet: −1 for a convex edge (each face is behind the other's plane),
    /// 1 for a concave one. `None` if there is no edge.
    fn meet(&self, a: &Plane, b: &Plane) -> Option<f64> {
        let jump = a.normal.dot(b.normal).clamp(-1.0, 1.0).acos();
        if jump.cos() >= self.same_cos || jump < JUMP * a.spread.max(b.spread) {
            return None;
        }
        if self.turn_at_edge(a, b) < AT_EDGE * jump {
            return None;
        }
        // A face that turns around a reflex corner is on both sides of the other plane. The other face is on one side
        // only, so the clearer side counts.
        let width = SIDE_SPACINGS * self.spacing;
        let sides = [a.side_of(b, width), b.side_of(a, width)];
        let purest = if sides[0].abs() > sides[1].abs() { sides[0] } else { sides[1] };
        (purest.abs() >= ONE_SIDED).then(|| purest.signum())
    }

    /// Returns the angle, in radians, by which the surface turns at the line where two planes meet, if either side
    /// continues its bend up to the line. At an edge it is the whole angle between the planes, and in an even bend it
    /// is 0.
    fn turn_at_edge(&self, a: &Plane, b: &Plane) -> f64 {
        let cosine = a.normal.dot(b.normal);
        let along = unit(a.normal.cross(b.normal));
        let (across, away) = (unit(a.normal + b.normal), unit(b.normal - a.normal));
        // The point of the line nearest to the middle of the two planes' centres.
        let middle = 0.5 * (a.center + b.center);
        let (d, e) = (a.distance(middle), b.distance(middle));
        let scale = 1.0 / (1.0 - cosine * cosine).max(f64::MIN_POSITIVE);
        let edge = middle - (a.normal * (d - cosine * e) + b.normal * (e - cosine * d)) * scale;
        let [before, after] = [a, b].map(|p| p.angle_at_edge(edge, along.cross(p.normal), [across, away]));
        after - before
    }

    /// Returns the planes that clip the splats of the plane with index `own`, and the mode that combines the clips.
    /// Each plane comes with its visible side: 1 in front of it, −1 behind it.
    fn cuts<'b>(&self, planes: &'b [Plane], own: usize) -> (Vec<(&'b Plane, f64)>, ClipMode) {
        let meeting: Vec<(&Plane, f64)> = (0..planes.len())
            .filter(|i| *i != own)
            .filter_map(|i| Some((&planes[i], self.meet(&planes[own], &planes[i])?)))
            .collect();
        if let [(b, side), (c, other)] = meeting[..]
            && side == other
            && self.meet(b, c) == Some(-side)
        {
            return (meeting, ClipMode::Or);
        }
        // A face that continues beyond another plane isn't clipped by it.
        let width = SIDE_SPACINGS * self.spacing;
        let ends = |(plane, side): &(&Plane, f64)| side * planes[own].side_of(plane, width) >= ONE_SIDED;
        (meeting.into_iter().filter(ends).collect(), ClipMode::And)
    }

    /// Returns the splat of the point `slot`, turned into its plane and clipped by the other planes at an edge. `wide`
    /// are the slots of its [`WIDE`] nearest neighbours. `None` if no edge clips the splat, or if the point belongs to
    /// no plane.
    fn side(&self, slot: usize, wide: &[u32]) -> Option<Side> {
        let planes = self.planes(slot, wide);
        if planes.len() < 2 {
            return None;
        }
        let (p, patch) = (self.points.point(slot), self.patches[slot]);
        let rank = |plane: &Plane| {
            if patch.is_flat { -plane.normal.dot(patch.normal) } else { plane.distance(p).abs() }
        };
        let far = (FAR_RESIDUALS * self.residual).max(FAR_SPACINGS * self.spacing);
        let mut nearest: Vec<usize> = (0..planes.len()).collect();
        nearest.sort_by(|a, b| rank(&planes[*a]).total_cmp(&rank(&planes[*b])));
        // Of the planes whose clips leave the point visible, the nearest one is used.
        let (own, (cuts, mode)) =
            nearest.into_iter().map(|i| (&planes[i], self.cuts(&planes, i))).find(|(_, (cuts, mode))| {
                let keeps = |(plane, side): &(&Plane, f64)| side * plane.distance(p) > -far;
                match mode {
                    ClipMode::And => cuts.iter().all(keeps),
                    ClipMode::Or => cuts.iter().any(keeps),
                }
            })?;
        if cuts.is_empty() || own.distance(p).abs() >= far {
            return None;
        }
        let (center, turned) =
            if patch.is_flat { (p, None) } else { (p - own.normal * own.distance(p), Some(own.normal)) };
        let keeps = cuts.iter().map(|(plane, side)| (plane.normal * *side, plane.distance(center) * side)).collect();
        Some(Side { center, turned, keeps, mode })
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
    let mut modes = vec![ClipMode::And; cloud.len()];
    for (i, center) in centers.iter_mut().enumerate() {
        let (mut s, mut t) = cloud.axes(i);
        let mut own = [NO_LINE; 4];
        if let Some(side) = &sides[points.slot_of[i] as usize] {
            if let Some(normal) = side.turned {
                let radius = (s.length() * t.length()).sqrt();
                (s, t) = orthonormal(normal);
                (s, t) = (s * radius, t * radius);
                *center = points.points.center + side.center * points.points.step;
                report.turned += 1;
            }
            let keeps = side.keeps.iter().map(|(into, d)| [s.dot(*into), t.dot(*into), d * points.points.step]);
            let keeps: Vec<[f64; 3]> = keeps.collect();
            // Lines that miss the disk clip nothing. Under `Or`, no line clips anything if one of them leaves the whole
            // disk visible.
            let is_whole = side.mode == ClipMode::Or && keeps.iter().any(|[a, b, c]| *c >= a.hypot(*b));
            let crossing = keeps.iter().filter(|[a, b, c]| !is_whole && c.abs() < a.hypot(*b));
            let mut count = 0;
            for (line, [a, b, c]) in own.iter_mut().zip(crossing) {
                *line = ClipLine { a: *a as f32, b: *b as f32, c: *c as f32 };
                count += 1;
            }
            modes[i] = side.mode;
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
        data.clips = Some(ClipColumns { curves: None, lines: Some(lines), modes: Some(modes) });
    }
    let (mut sharp, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
    if let Some(weight) = interior::interior_weight(&sharp) {
        sharp.set_interior_weight(weight);
    }
    Ok((sharp, report))
}
