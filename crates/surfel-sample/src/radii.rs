//! How large a splat must be, from the local spacing of the points around it.
//!
//! Two rules, and the larger wins. The *density* rule makes the weights of neighbours add up: a radius of
//! [`DENSITY`] times the square root of the local area per point, for which Σw is about 3.7 (the renderer's kernel
//! exp(−2ρ²) integrates to 0.432·π·r²). The *covering* rule closes the surface where the sampling is uneven: a
//! splat reaches past the farthest corner of its own Voronoi cell in the tangent plane, because a plane whose cells
//! are all covered has no holes. Where cells are stretched alike over a neighbourhood (scan lines), the same two
//! rules are applied after the affine map that makes them round, and the splat is an ellipse.

use crate::cell::Cell;
use crate::eigen::symmetric2;
use crate::neighbours::{Neighbours, WIDE};
use crate::parallel::map_each;
use crate::progress::Progress;
use crate::tree::Nearest;
use glam::{DVec2, DVec3};
use surfel_math::basis::orthonormal;

/// Radius over the square root of the area per point.
pub(crate) const DENSITY: f64 = 1.65;
/// Radius over the reach of the Voronoi cell: what curvature and tilted neighbours may take away, and a weight of
/// exp(−2/1.15²) = 0.22 instead of exp(−2) = 0.14 at the corner, times the three or more splats that meet there.
const COVER: f64 = 1.15;
/// No radius exceeds this times that of the density rule: beyond it a gap is one of the scan, not of the sampling.
const LARGEST: f64 = 2.5;
/// Radius over the reach at a border, where the corners of a cell may lie far outside the surface.
const LARGEST_AT_BORDER: f64 = 1.5;
/// Axis ratio from which sampling counts as anisotropic.
pub(crate) const STRETCHED: f64 = 1.5;
/// Axis ratio of the longest ellipse.
const MOST_STRETCHED: f64 = 16.0;
/// Share of stretched points from which a cloud gets ellipses: random samplings have about 5 % by chance.
const STRETCHED_SHARE: f64 = 0.1;
/// A closed cell is believed when its corners are no farther than this share of the farthest neighbour: at a border,
/// where points jut out by chance, cells close far outside the surface. Shares for the table's neighbours and for
/// the wider look, which is more generous in itself; half the spacing of scan lines must pass.
const BELIEVED: f64 = 0.75;
const BELIEVED_WIDE: f64 = 0.55;
/// Neighbours take part in a point's cell when their normals agree within 60°, and they lie within 60° of its
/// tangent plane: others belong to the back of a thin part, or to the far side of a crease.
const AGREE: f64 = 0.5;
const STEEPEST: f64 = 0.866;
/// A point is isolated when its spacing is this many times the median of its neighbours' spacings.
const ISOLATED: f64 = 8.0;
/// The neighbour whose distance is a point's spacing, counted from 1: as many as surround it in a plane.
const RING: usize = 6;

/// Sizes in working units, one a slot.
#[derive(Debug)]
pub(crate) struct Sizes {
    pub(crate) radii: Vec<f64>,
    /// Half-axes (s, t) of every splat, s × t along the normal, where the cloud is stretched; the number of splats
    /// that are not circles is `stretched`.
    pub(crate) axes: Option<Vec<(DVec3, DVec3)>>,
    pub(crate) stretched: usize,
    pub(crate) isolated: Vec<bool>,
}

/// Measures of one point's cell; f32 halves the memory, and 1e-7 is nothing here.
#[derive(Clone, Copy, Default)]
struct Summary {
    /// Area of a closed cell, else 0.
    area: f32,
    /// Distance of the farthest corner, 0 when there is none.
    reach: f32,
    /// Distance to the sixth neighbour.
    spacing: f32,
    /// Second moments of a closed cell about its centroid over its area: xx xy xz yy yz zz in space.
    moments: [f32; 6],
}

#[derive(Clone)]
struct Work {
    cell: Cell,
    offsets: Vec<DVec2>,
    found: Nearest,
    wide: Vec<u32>,
    values: Vec<f64>,
}

impl Work {
    fn new() -> Self {
        let found = Nearest::new(WIDE + 1);
        Self { cell: Cell::default(), offsets: Vec::new(), found, wide: Vec::new(), values: Vec::new() }
    }
}

/// The spacing of points, as far as it is known beforehand, in working units.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Spacing {
    /// Nothing; a cloud that has none (one point) gets this.
    Unknown(f64),
    /// It is this on average everywhere: the density rule takes it instead of measuring.
    Known(f64),
}

/// Measures sizes for points with unit `normals` (one a slot); ellipses only if `ellipses`.
pub(crate) fn sizes(
    cloud: &Neighbours,
    normals: &[DVec3],
    spacing: Spacing,
    ellipses: bool,
    progress: &dyn Progress,
) -> Sizes {
    let (Spacing::Unknown(fallback) | Spacing::Known(fallback)) = spacing;
    let known = if let Spacing::Known(s) = spacing { Some(s) } else { None };
    let count = cloud.len();
    progress.stage("radii", 2 * count as u64);
    let measure = Measure { cloud, normals, known };
    let summaries = map_each(count, progress, Work::new, |work, slot| measure.summary(slot, work));
    let results = map_each(count, progress, Work::new, |work, slot| measure.size(slot, &summaries, work));

    let typical = median(&mut results.iter().map(|r| r.spacing).filter(|s| *s > 0.0).collect::<Vec<_>>());
    let typical = typical.unwrap_or(fallback);
    let radius = |own: f64, r: &Size| match (own > 0.0, r.isolated, r.is_loose) {
        (false, ..) => DENSITY * typical,
        (true, true, _) => own.min(DENSITY * typical),
        (true, false, true) => own.min(LARGEST * DENSITY * typical),
        (true, false, false) => own,
    };
    let stretched = results.iter().filter(|r| r.ellipse.is_some()).count();
    let isolated = results.iter().map(|r| r.isolated).collect();
    let mut radii: Vec<f64> = results.iter().map(|r| radius(r.radius, r)).collect();
    if !ellipses || (stretched as f64) < STRETCHED_SHARE * count as f64 {
        return Sizes { radii, axes: None, stretched: 0, isolated };
    }
    let axes = results.iter().zip(&mut radii).zip(normals).map(|((r, radius_max), normal)| {
        let (u, v) = orthonormal(*normal);
        let Some(Ellipse { angle, ratio, radius: own }) = r.ellipse else { return (u * *radius_max, v * *radius_max) };
        let (mean, direction) = (radius(own, r), DVec2::from_angle(angle));
        *radius_max = mean * ratio.sqrt();
        let s = u * direction.x + v * direction.y;
        let t = v * direction.x - u * direction.y;
        (s * *radius_max, t * (mean / ratio.sqrt()))
    });
    let axes = axes.collect();
    Sizes { radii, axes: Some(axes), stretched, isolated }
}

/// A size as one point's neighbourhood suggests it.
#[derive(Clone, Default)]
struct Size {
    /// Radius of a disk; 0 where there is no neighbour.
    radius: f64,
    /// √ of the area per point.
    spacing: f64,
    ellipse: Option<Ellipse>,
    isolated: bool,
    /// Neither it nor any neighbour is surrounded: a few stray points are, and they must not become large.
    is_loose: bool,
}

#[derive(Clone)]
struct Ellipse {
    /// Of the long axis, in the normal's tangent frame.
    angle: f64,
    /// Long axis over short axis.
    ratio: f64,
    /// √ of the product of the half-axes.
    radius: f64,
}

struct Measure<'a> {
    cloud: &'a Neighbours,
    normals: &'a [DVec3],
    known: Option<f64>,
}

impl Measure<'_> {
    fn same_side(&self, a: usize, b: usize) -> bool {
        self.normals[a].dot(self.normals[b]) >= AGREE
    }

    /// Builds the cell of `slot` among `neighbours`, unrolled into its tangent plane: directions are projected,
    /// distances are kept, as on the surface itself. True if it is closed, with corners within the `believed` share
    /// of the farthest neighbour's distance.
    fn cell(&self, slot: usize, neighbours: &[u32], believed: f64, cell: &mut Cell, offsets: &mut Vec<DVec2>) -> bool {
        let (p, n) = (self.cloud.point(slot), self.normals[slot]);
        let (u, v) = orthonormal(n);
        offsets.clear();
        let mut limit = 0.0;
        for &j in neighbours {
            let d = self.cloud.point(j as usize) - p;
            let distance = d.length();
            limit = distance;
            if d.dot(n).abs() <= STEEPEST * distance && self.same_side(slot, j as usize) {
                let flat = DVec2::new(d.dot(u), d.dot(v));
                offsets.push(flat * (distance / flat.length()));
            }
        }
        cell.build(offsets, limit);
        // Where half of the neighbours are another sheet's, the farthest of this one's would be farther.
        let share = offsets.len() as f64 / neighbours.len().max(1) as f64;
        cell.is_closed() && cell.reach() * share.sqrt() <= believed * limit
    }

    /// Builds the cell of `slot`, among more neighbours when those of the table don't close it; true if it is closed.
    fn best_cell(&self, slot: usize, work: &mut Work) -> bool {
        let near = self.cloud.of(slot);
        if self.cell(slot, near, BELIEVED, &mut work.cell, &mut work.offsets) {
            return true;
        }
        if self.cloud.len() > near.len() + 1 {
            self.cloud.widen(slot, &mut work.found, &mut work.wide);
            if self.cell(slot, &work.wide, BELIEVED_WIDE, &mut work.cell, &mut work.offsets) {
                return true;
            }
        }
        // At a border the wider view only adds slivers along it.
        self.cell(slot, near, BELIEVED, &mut work.cell, &mut work.offsets);
        false
    }

    fn summary(&self, slot: usize, work: &mut Work) -> Summary {
        let near = self.cloud.of(slot);
        let Some(&ring) = near.get(RING - 1).or(near.last()) else { return Summary::default() };
        let spacing = self.cloud.point(ring as usize).distance(self.cloud.point(slot)) as f32;
        let is_closed = self.best_cell(slot, work);
        let reach = work.cell.reach() as f32;
        if !is_closed {
            return Summary { reach, spacing, ..Summary::default() };
        }
        let (area, [xx, xy, yy]) = work.cell.moments();
        let (u, v) = orthonormal(self.normals[slot]);
        let scale = if area > 0.0 { 1.0 / area } else { 0.0 };
        let at = |i: usize, j: usize| {
            (scale * (xx * u[i] * u[j] + xy * (u[i] * v[j] + v[i] * u[j]) + yy * v[i] * v[j])) as f32
        };
        let moments = [at(0, 0), at(0, 1), at(0, 2), at(1, 1), at(1, 2), at(2, 2)];
        Summary { area: area as f32, reach, spacing, moments }
    }

    /// Median area and mean moments of the closed cells of `slot` and `neighbours`.
    fn smooth(
        &self,
        slot: usize,
        neighbours: &[u32],
        all: &[Summary],
        areas: &mut Vec<f64>,
    ) -> Option<(f64, [f64; 6])> {
        areas.clear();
        let mut sum = [0.0; 6];
        for j in neighbours.iter().map(|j| *j as usize).chain([slot]) {
            if all[j].area > 0.0 && self.same_side(slot, j) {
                areas.push(f64::from(all[j].area));
                for (s, m) in sum.iter_mut().zip(all[j].moments) {
                    *s += f64::from(m);
                }
            }
        }
        Some((median(areas)?, sum))
    }

    fn size(&self, slot: usize, all: &[Summary], work: &mut Work) -> Size {
        let near = self.cloud.of(slot);
        let isolated = self.is_isolated(slot, all, &mut work.values);
        let mut smooth = self.smooth(slot, near, all, &mut work.values);
        if smooth.is_none() && self.cloud.len() > near.len() + 1 {
            self.cloud.widen(slot, &mut work.found, &mut work.wide);
            smooth = self.smooth(slot, &work.wide, all, &mut work.values);
        }
        let Some((area, moments)) = smooth else {
            // Nothing is surrounded here: a line, a pair, a sliver. Its neighbours' distances are all there is.
            let p = self.cloud.point(slot);
            let near = near.iter().take(2).map(|j| self.cloud.point(*j as usize).distance(p)).fold(0.0, f64::max);
            return Size { radius: DENSITY * near, spacing: near, ellipse: None, isolated, is_loose: true };
        };
        let spacing = self.known.unwrap_or(area.sqrt());
        let largest = if all[slot].area > 0.0 { LARGEST } else { LARGEST_AT_BORDER };
        let bounded = |reach: f64| (COVER * reach).clamp(DENSITY * spacing, largest * DENSITY * spacing);
        let radius = bounded(f64::from(all[slot].reach));
        let ellipse = self.ellipse(slot, moments, bounded, work);
        Size { radius, spacing, ellipse, isolated, is_loose: false }
    }

    fn ellipse(&self, slot: usize, m: [f64; 6], bounded: impl Fn(f64) -> f64, work: &mut Work) -> Option<Ellipse> {
        let (u, v) = orthonormal(self.normals[slot]);
        let along = |a: DVec3, b: DVec3| {
            a.x * (m[0] * b.x + m[1] * b.y + m[2] * b.z)
                + a.y * (m[1] * b.x + m[3] * b.y + m[4] * b.z)
                + a.z * (m[2] * b.x + m[4] * b.y + m[5] * b.z)
        };
        let ([large, small], direction) = symmetric2(along(u, u), along(u, v), along(v, v));
        let ratio = (large / small.max(large * 1e-9)).sqrt();
        if ratio.is_nan() || ratio <= STRETCHED {
            return None;
        }
        let ratio = ratio.min(MOST_STRETCHED);
        self.best_cell(slot, work);
        let round = |c: DVec2| DVec2::new(c.dot(direction) / ratio.sqrt(), c.dot(direction.perp()) * ratio.sqrt());
        let reach = work.cell.corners().map(|c| round(c).length()).fold(0.0, f64::max);
        Some(Ellipse { angle: direction.to_angle(), ratio, radius: bounded(reach) })
    }

    fn is_isolated(&self, slot: usize, all: &[Summary], values: &mut Vec<f64>) -> bool {
        if self.cloud.degree < RING {
            return false;
        }
        values.clear();
        values.extend(self.cloud.of(slot).iter().map(|j| f64::from(all[*j as usize].spacing)));
        median(values).is_some_and(|typical| f64::from(all[slot].spacing) > ISOLATED * typical)
    }
}

/// The lower median; `None` of nothing. Reorders `values`.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
