//! Points to clipped splats: where a neighbourhood lies on two or three planes, splats are given one of them each and
//! clipped by the others, so that both sides of an edge end at the same line (Z04: clip lines).
//!
//! Source: ours. Z04 and C12 clip, but take edges as given.

use crate::eigen::symmetric3;
use crate::nearest::Search;
use crate::neighbours::Neighbours;
use crate::normals::covariance;
use crate::parallel::map_each;
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
/// An edge's jump over the spread of the normals on each of its sides, both in radians, at least. Two halves of a bend
/// of any strength have 3.5, two caps of a sphere less; an edge of 45° between faces with 5° of noise has 9.
const JUMP: f64 = 6.0;
/// How much of an edge's jump is left at the edge itself where each side is taken to go on bending as it does, at
/// least.
const AT_EDGE: f64 = 0.7;
/// How purely a face lies on one side of another one's plane where they meet in an edge: 1 is all of it, 0 as much as
/// not.
const ONE_SIDED: f64 = 0.5;
/// Within so many spacings of a plane a patch counts for its side in part.
const SIDE_SPACINGS: f64 = 0.5;
/// A point that lies farther than this from every plane belongs to none, in spacings.
const FAR_SPACINGS: f64 = 0.35;
/// A point that lies farther than this from every plane belongs to none, in median residuals.
const FAR_RESIDUALS: f64 = 4.0;

/// Report of [`sharpen_points`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SharpPointsReport {
    /// Splats clipped by a line.
    pub clipped: usize,
    /// Of them, by two lines: corners.
    pub corners: usize,
    /// Splats that were turned into a plane beside an edge, and moved onto it.
    pub turned: usize,
}

/// Clips splats made of points (by [`crate::splats_from_points`]) along the edges that the points show: where planes
/// meet at more than `crease_angle_deg` (1 to 179 degrees). Disks become ellipses of equal axes.
///
/// Planes are means of flat neighbourhoods' planes, weighted by nearness, in up to three clusters by normal; a point
/// amid them takes the nearest, and its splat ends where that plane meets the others. Both sides intersect the same
/// planes, up to the difference of their weights. Two planes meet in an edge only if their normals differ by several
/// times what they spread on either side, and if most of that is left where either side is taken to go on bending as it
/// does: a surface that bends has no edge, however thinly it is sampled. Where a face turns a reflex corner, one of the
/// two half-planes is enough to keep. Limit: features narrower than about three spacings stay round.
///
/// # Errors
/// [`SampleError::Option`] for the angle, [`SampleError::TooMany`] above 268 million splats, [`SampleError::Model`]
/// never for a valid cloud without clips.
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
    let state = || Search::new(&points.points);
    let sides =
        map_each(points.len(), progress, state, |search, slot| patches.side(slot, search.nearest(slot, WIDE, 0.0).0));
    assemble_cloud(cloud, &points, &sides, &positions)
}

/// The flat piece about a point, in working coordinates.
#[derive(Clone, Copy, Default)]
struct Patch {
    center: DVec3,
    /// Unit, outward.
    normal: DVec3,
    is_flat: bool,
}

/// A plane fitted to a point and its neighbours, in working coordinates.
#[derive(Clone, Copy, Default)]
struct PlaneFit {
    patch: Patch,
    /// Standard deviation of the points along the plane's normal.
    residual: f64,
    /// Their largest standard deviation within the plane.
    extent: f64,
    /// Mean distance of the nearest neighbours.
    spacing: f64,
}

/// A plane through `center`, the weighted mean of flat patches.
#[derive(Clone)]
struct Plane {
    center: DVec3,
    normal: DVec3,
    /// Root mean square angle of the patches' normals from their mean, radians.
    spread: f64,
    /// The patches.
    members: Vec<Patch>,
}

impl Plane {
    fn distance(&self, p: DVec3) -> f64 {
        self.normal.dot(p - self.center)
    }

    /// On which side of another plane this one's patches lie: from −1, all behind it, to 1.
    fn side_of(&self, other: &Self, width: f64) -> f64 {
        let side = |patch: &Patch| (other.distance(patch.center) / width).clamp(-1.0, 1.0);
        self.members.iter().map(side).sum::<f64>() / self.members.len().max(1) as f64
    }

    /// Angle in radians from `across` toward `away` of the patches' normals where this plane meets the edge through
    /// `edge`, by a straight line through their angles over the distance from it along `outward`, in the plane.
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

/// A splat beside an edge, turned and clipped, in working coordinates.
#[derive(Clone, Debug)]
struct Side {
    center: DVec3,
    /// The plane's normal where the splat is turned.
    turned: Option<DVec3>,
    /// Half-spaces that keep it: unit normals into them, and the signed distance of the centre.
    keeps: Vec<(DVec3, f64)>,
    mode: ClipMode,
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
        let seed = |normal| Plane { center: p, normal, spread: 0.0, members: Vec::new() };
        let mut planes: Vec<Plane> = seeds.into_iter().map(seed).collect();
        // Means of what is nearest to each, a few times over (Lloyd 1982).
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
            let sound = |s: &(DVec3, DVec3, f64, Vec<Patch>)| s.3.len() >= LEAST_ON_PLANE && s.0 != DVec3::ZERO;
            let mean = |(normal, center, total, members): (DVec3, DVec3, f64, Vec<Patch>)| Plane {
                center: p + center / total,
                normal: unit(normal),
                // Of unit vectors, 2 − 2·|mean| is the mean square distance from the mean's direction.
                spread: (2.0 - 2.0 * normal.length() / total).max(0.0).sqrt(),
                members,
            };
            planes = sums.into_iter().filter(sound).map(mean).collect();
        }
        planes
    }

    /// How two planes meet about here: −1 in a convex edge, each behind the other; 1 in a concave one; `None` if they
    /// don't meet in an edge.
    fn meet(&self, a: &Plane, b: &Plane) -> Option<f64> {
        let jump = a.normal.dot(b.normal).clamp(-1.0, 1.0).acos();
        if jump.cos() >= self.same_cos || jump < JUMP * a.spread.max(b.spread) {
            return None;
        }
        if self.turn_at_edge(a, b) < AT_EDGE * jump {
            return None;
        }
        // A face that turns a reflex corner lies on both sides, but the other one doesn't.
        let width = SIDE_SPACINGS * self.spacing;
        let sides = [a.side_of(b, width), b.side_of(a, width)];
        let purest = if sides[0].abs() > sides[1].abs() { sides[0] } else { sides[1] };
        (purest.abs() >= ONE_SIDED).then(|| purest.signum())
    }

    /// By how much the surface turns at the line where two planes meet, radians, if on either side it goes on to turn
    /// as it does there: all of the angle between the planes in an edge, nothing in an even bend.
    fn turn_at_edge(&self, a: &Plane, b: &Plane) -> f64 {
        let cosine = a.normal.dot(b.normal);
        let along = unit(a.normal.cross(b.normal));
        let (across, away) = (unit(a.normal + b.normal), unit(b.normal - a.normal));
        // The point of the line that is nearest to the middle of the two planes' centres.
        let middle = 0.5 * (a.center + b.center);
        let (d, e) = (a.distance(middle), b.distance(middle));
        let scale = 1.0 / (1.0 - cosine * cosine).max(f64::MIN_POSITIVE);
        let edge = middle - (a.normal * (d - cosine * e) + b.normal * (e - cosine * d)) * scale;
        let [before, after] = [a, b].map(|p| p.angle_at_edge(edge, along.cross(p.normal), [across, away]));
        after - before
    }

    /// The planes that cut one of the planes, with the sides that keep it, and whether all must.
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
        // A face that runs on beyond another one's plane isn't cut by it.
        let width = SIDE_SPACINGS * self.spacing;
        let ends = |(plane, side): &(&Plane, f64)| side * planes[own].side_of(plane, width) >= ONE_SIDED;
        (meeting.into_iter().filter(ends).collect(), ClipMode::And)
    }

    /// The splat of a point beside an edge; `None` where no edge is.
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
        // The nearest plane that isn't cut away where the point is.
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
            // Lines that miss the disk clip nothing, nor do any if one of those of which one is enough keeps all.
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
