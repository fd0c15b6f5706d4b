//! Estimation of splat radii from the local spacing of points.
//!
//! Two rules apply to points in a surface, and the larger radius wins. The *density* rule makes the weights of
//! neighbours add up. The radius is [`DENSITY`] times the square root of the local area per point, for which Σw is
//! about 3.7 (the renderer's kernel exp(−2ρ²) integrates to 0.432·π·r²). The *covering* rule leaves no holes if the
//! sampling is uneven. A splat reaches past the farthest corner of its own Voronoi cell in the tangent plane: a plane
//! whose cells are all covered has no holes.
//!
//! Only the covering rule applies if the surface turns within the density radius, because a larger disk would stick
//! out. Points in no surface get small disks: [`crate::class`] lists the rule of each class. If the cells of a
//! neighbourhood are stretched in the same direction (scan lines), the splat is an ellipse. The same rules then apply
//! after the affine map that makes the cells round. Finally, [`crate::largest`] limits all splats.
//!
//! A *slot* is a point's place in the order of [`SortedPoints`], and a *grid step* is the unit of its coordinates.

use crate::block::{Block, Scale, tangents};
pub(crate) use crate::class::{COVER, DENSITY};
use crate::class::{Evidence, PointClass};
use crate::median::median_of;
use crate::orient::Oriented;
use crate::parallel::{for_chunks, map_each};
use crate::progress::{NoProgress, Progress};
use crate::size::{ANISOTROPIC_RATIO, Ellipse, Size};
use crate::sorted::{RUN, SortedPoints};
use crate::tree::{KdTree, Nearest};
use glam::{DVec2, DVec3};
use std::sync::{Mutex, PoisonError};

/// Ratio of a point's spacing to the cloud's typical spacing above which the point counts as sparse.
const SPARSE: f64 = 2.0;
/// Smallest number of sparse points within [`FEW_REACH`] of a sparse point, including itself, at which it can be in a
/// surface. A point with fewer is isolated, like a few returns from a spire. In a sparse surface the number is about
/// 80, and at its border 40.
const FEW: usize = 24;
/// Distance from a sparse point within which other sparse points are counted, in units of the point's spacing.
const FEW_REACH: f64 = 5.0;
/// Radius above which a sparse point in a surface is tested for too few sparse neighbours ([`FEW`]), relative to the
/// density radius for the cloud's typical spacing. It is also the largest radius of a mesh's sample of class
/// [`PointClass::Line`].
const LARGE: f64 = 2.5;
/// Smallest fraction of points in surfaces at which the cloud's typical spacing is computed from these points alone.
const IN_SURFACES: f64 = 0.1;

/// Fraction of points with stretched cells in a cloud above which its splats are ellipses. Random samplings have about
/// 5 % such points by chance.
const ANISOTROPIC_FRACTION: f64 = 0.1;
/// Number of points per task. A task also measures the points around its block, which are measured again by other
/// tasks. For random points on a surface, the additional points are about a tenth of a block.
const BLOCK: usize = 2 * RUN;

/// Sizes of all splats and the evidence for the classes of their points. Lengths are in grid steps of [`SortedPoints`].
#[derive(Debug)]
pub(crate) struct Sizes {
    all: Vec<Size>,
    /// Ellipse of each slot's splat; empty if the sampling of the cloud isn't stretched.
    ellipses: Vec<Ellipse>,
    /// Typical spacing of the cloud: a median over its points, in grid steps.
    pub(crate) typical: f64,
    /// Number of splats that are ellipses; 0 if the cloud isn't stretched.
    pub(crate) stretched: usize,
    /// True if the caller gave the spacing, false if it was measured.
    is_known: bool,
}

impl Sizes {
    /// Returns the number of slots.
    pub(crate) fn len(&self) -> usize {
        self.all.len()
    }

    /// Returns the class of a slot's point.
    pub(crate) fn class(&self, slot: usize) -> PointClass {
        self.all[slot].evidence.class()
    }

    /// Returns the evidence for the class of a slot's point.
    pub(crate) fn evidence(&self, slot: usize) -> Evidence {
        self.all[slot].evidence
    }

    /// Returns the radius `own` of a slot's disk, in grid steps, limited by the class of the point. If `own` is 0,
    /// because the point has no neighbours, the result is the density radius for the typical spacing.
    fn bounded(&self, slot: usize, own: f32) -> f64 {
        if own <= 0.0 {
            return DENSITY * self.typical;
        }
        let class = self.class(slot);
        // Samples of a mesh are always on its surface.
        let most = if self.is_known && class == PointClass::Line { LARGE * DENSITY } else { class.most() };
        f64::from(own).min(most * self.typical)
    }

    /// Returns the ellipse of the splat at `slot`; `None` if the splat is a disk.
    fn ellipse(&self, slot: usize) -> Option<Ellipse> {
        self.ellipses.get(slot).copied().filter(|ellipse| ellipse.ratio > 0)
    }

    /// Adds a piece of evidence (a bit of [`Evidence`]) to the point at `slot`, and makes its splat a disk of at most
    /// `radius` grid steps.
    pub(crate) fn reclassify(&mut self, slot: usize, piece: u8, radius: f64) {
        let evidence = self.all[slot].evidence.with(piece, true);
        self.all[slot].evidence = evidence;
        self.limit(slot, radius);
    }

    /// Makes the splat at `slot` a disk of at most `radius` grid steps.
    pub(crate) fn limit(&mut self, slot: usize, radius: f64) {
        self.all[slot].radius = (radius as f32).min(self.bounded(slot, self.all[slot].radius) as f32);
        self.remove_ellipse(slot);
    }

    fn remove_ellipse(&mut self, slot: usize) {
        if self.ellipse(slot).is_some() {
            self.ellipses[slot] = Ellipse::default();
            self.stretched -= 1;
        }
    }

    /// Limits both half-axes of the splat at `slot` to `most` grid steps. An ellipse becomes a disk if its axis ratio
    /// is then at most [`ANISOTROPIC_RATIO`].
    pub(crate) fn shorten(&mut self, slot: usize, most: f64) {
        let Some(ellipse) = self.ellipse(slot) else {
            self.all[slot].radius = (most as f32).min(self.bounded(slot, self.all[slot].radius) as f32);
            return;
        };
        let (mean, root) = (self.bounded(slot, ellipse.mean), ellipse.ratio().sqrt());
        let (long, short) = ((mean * root).min(most), (mean / root).min(most));
        let mean = (long * short).sqrt() as f32;
        if long > ANISOTROPIC_RATIO * short {
            self.ellipses[slot] = Ellipse::new(mean, ellipse.angle(), long / short);
        } else {
            self.all[slot].radius = mean;
            self.remove_ellipse(slot);
        }
    }

    /// Returns the larger half-axis of the splat at `slot`, in grid steps.
    pub(crate) fn radius(&self, slot: usize) -> f64 {
        match self.ellipse(slot) {
            Some(ellipse) => self.bounded(slot, ellipse.mean) * ellipse.ratio().sqrt(),
            None => self.bounded(slot, self.all[slot].radius),
        }
    }

    /// Returns the half-axes (s, t) of the splat at `slot`, in grid steps of [`SortedPoints`]; s × t points along the
    /// unit `normal`. The half-axes of a disk have equal lengths.
    pub(crate) fn axes(&self, slot: usize, normal: DVec3) -> (DVec3, DVec3) {
        let (u, v) = tangents(normal.as_vec3());
        let (u, v) = (u.as_dvec3(), v.as_dvec3());
        let Some(ellipse) = self.ellipse(slot) else {
            let radius = self.bounded(slot, self.all[slot].radius);
            return (u * radius, v * radius);
        };
        let (mean, direction) = (self.bounded(slot, ellipse.mean), DVec2::from_angle(ellipse.angle()));
        let s = u * direction.x + v * direction.y;
        let t = v * direction.x - u * direction.y;
        (s * (mean * ellipse.ratio().sqrt()), t * (mean / ellipse.ratio().sqrt()))
    }
}

/// Spacing of the points, in grid steps, with which sizes are computed.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Spacing {
    /// Spacing is measured. The value is used for a cloud that has no spacing (a single point).
    Unknown(f64),
    /// Spacing is given: an average that is the same everywhere, by which the density rule computes radii.
    Known(f64),
}

/// Measures the size and class of each slot's point from its `degree` nearest neighbours. `oriented` has one entry per
/// slot. `level` has a flag per slot, true if the normal points up because the neighbours form no plane, or is empty.
pub(crate) fn sizes(
    points: &SortedPoints,
    (oriented, level): (&[Oriented], &[bool]),
    degree: usize,
    spacing: Spacing,
    ellipses: bool,
    progress: &dyn Progress,
) -> Sizes {
    let (Spacing::Unknown(fallback) | Spacing::Known(fallback)) = spacing;
    let known = if let Spacing::Known(s) = spacing { Some(s as f32) } else { None };
    let count = points.len();
    progress.stage("radii", count as u64);
    let farthest = median_of(count, |slot| oriented[slot].farthest2).map_or(0.0, f32::sqrt);
    let scale = Scale { degree: degree.min(count - 1), known, farthest, ellipses };
    let mut all = vec![Size::default(); count];
    // Usually few slots have an ellipse, so that a list of them is small; only in a stretched cloud nearly all have
    // one.
    let ellipses = Mutex::new(Vec::new());
    for_chunks(&mut all, BLOCK, &|first, sizes| {
        let mut block = Block::new(points, (oriented, level), scale);
        block.measure(first..first + sizes.len());
        let mut found = Vec::new();
        for (i, size) in sizes.iter_mut().enumerate() {
            let ellipse;
            (*size, ellipse) = block.size(i);
            found.extend(ellipse.map(|ellipse| ((first + i) as u32, ellipse)));
        }
        ellipses.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(&found);
        progress.advance(sizes.len() as u64);
    });
    let found = ellipses.into_inner().unwrap_or_else(PoisonError::into_inner);
    let is_stretched = !found.is_empty() && found.len() as f64 >= ANISOTROPIC_FRACTION * count as f64;
    let mut ellipses = vec![Ellipse::default(); if is_stretched { count } else { 0 }];
    for (slot, ellipse) in found.iter().filter(|_| is_stretched) {
        ellipses[*slot as usize] = *ellipse;
    }
    let stretched = if is_stretched { found.len() } else { 0 };
    let typical = typical(&all).unwrap_or(fallback);
    let mut sizes = Sizes { all, ellipses, typical, stretched, is_known: known.is_some() };
    for slot in few(points, &sizes) {
        sizes.reclassify(slot, Evidence::ALONE, DENSITY * typical);
    }
    sizes
}

/// Returns the typical spacing of a cloud: the median spacing of the points in surfaces, or of all points if less than
/// a tenth are in surfaces. `None` if no point has a spacing.
fn typical(all: &[Size]) -> Option<f64> {
    let is_in_surface = |size: &Size| size.evidence.class().is_surface();
    let in_surfaces = all.iter().filter(|size| is_in_surface(size)).count();
    let counts = |size: &Size| (in_surfaces as f64) < IN_SURFACES * all.len() as f64 || is_in_surface(size);
    median_of(all.len(), |i| if counts(&all[i]) { all[i].spacing } else { 0.0 }).map(f64::from)
}

/// Returns the slots of large splats at sparse points with fewer than [`FEW`] sparse points around them. A point inside
/// a sparse part of a surface has more sparse points around it; a point at the border has about half as many.
fn few(points: &SortedPoints, sizes: &Sizes) -> Vec<usize> {
    let spacing = |slot: usize| f64::from(sizes.all[slot].spacing);
    let is_sparse = |slot: usize| spacing(slot) > SPARSE * sizes.typical;
    let is_large = |slot: usize| sizes.class(slot).is_surface() && sizes.radius(slot) > LARGE * DENSITY * sizes.typical;
    let large: Vec<usize> = (0..sizes.len()).filter(|slot| is_sparse(*slot) && is_large(*slot)).collect();
    if large.is_empty() {
        return large;
    }
    let is_one = |slot: &usize| is_sparse(*slot) && sizes.class(*slot).is_surface();
    let sparse: Vec<DVec3> = (0..sizes.len()).filter(is_one).map(|slot| points.point(slot)).collect();
    let tree = KdTree::new(&sparse);
    let are_few = |slot: usize| {
        let mut found = Nearest::within(FEW, spacing(slot) * FEW_REACH);
        tree.nearest(points.point(slot), &mut found);
        found.items().len() < FEW
    };
    let are_few = map_each(large.len(), &NoProgress, || (), |(), i| are_few(large[i]));
    large.into_iter().zip(are_few).filter(|(_, few)| *few).map(|(slot, _)| slot).collect()
}

/// Returns the lower median; `None` if there are no values. Reorders `values`.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len().checked_sub(1)? / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ellipses_keep_their_axes_to_a_ten_thousandth_of_the_longest() {
        for (angle, ratio) in [(-1.5, 1.6), (0.0, 16.0), (0.3, 2.0), (1.57, 7.7), (0.7, 48.0)] {
            let ellipse = Ellipse::new(3.0, angle, ratio);
            // Half a turn gives the same ellipse.
            let turn = ((ellipse.angle() - angle) / std::f64::consts::PI + 0.5).rem_euclid(1.0) - 0.5;
            // Half a step of 48 / 65,535.
            assert!(turn.abs() < 3e-5 && (ellipse.ratio() - ratio).abs() < 3.7e-4, "{angle} {ratio}: {ellipse:?}");
        }
        assert_eq!(size_of::<Size>() + size_of::<Ellipse>(), 20);
    }

    #[test]
    fn shortened_splats_keep_their_short_axis_and_their_direction() {
        let size = Size { radius: 2.0, spacing: 1.0, evidence: Evidence::default() };
        let ellipses = vec![Ellipse::default(), Ellipse::new(2.0, 0.5, 4.0)];
        let mut sizes = Sizes { all: vec![size; 2], ellipses, typical: 1.0, stretched: 1, is_known: false };
        sizes.shorten(0, 1.5);
        assert_eq!(sizes.radius(0), 1.5);
        // Half-axes 4 and 1.
        let direction = sizes.axes(1, DVec3::Z).0.normalize();
        sizes.shorten(1, 3.0);
        let (s, t) = sizes.axes(1, DVec3::Z);
        assert!((s.length() - 3.0).abs() < 1e-3 && (t.length() - 1.0).abs() < 1e-3, "{s} {t}");
        assert!(s.normalize().distance(direction) < 1e-3 && sizes.stretched == 1);
        sizes.shorten(1, 1.2);
        assert!((sizes.radius(1) - 1.2_f64.sqrt()).abs() < 1e-3 && sizes.stretched == 0, "{}", sizes.radius(1));
    }
}
