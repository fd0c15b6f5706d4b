//! How large a splat must be, from the local spacing of the points around it.
//!
//! Two rules hold in a surface, and the larger wins. The *density* rule makes the weights of neighbours add up: a
//! radius of [`DENSITY`] times the square root of the local area per point, for which Σw is about 3.7 (the renderer's
//! kernel exp(−2ρ²) integrates to 0.432·π·r²). The *covering* rule closes the surface where the sampling is uneven: a
//! splat reaches past the farthest corner of its own Voronoi cell in the tangent plane, because a plane whose cells
//! are all covered has no holes. Where the surface turns within the first rule's radius, the second alone holds, for a
//! disk there would stick out. Points in no surface have small disks: [`crate::class`] lists the rule of each class.
//! Where cells are stretched alike over a neighbourhood (scan lines), the same rules are applied after the affine map
//! that makes them round, and the splat is an ellipse. At last, no disk is larger than [`crate::largest`] allows.

use crate::block::{Block, Scale, tangents};
pub(crate) use crate::class::{COVER, DENSITY};
use crate::class::{Evidence, PointClass};
use crate::median::median_of;
use crate::orient::Oriented;
use crate::parallel::{for_chunks, map_each};
use crate::progress::{NoProgress, Progress};
use crate::sorted::{RUN, SortedPoints};
use crate::tree::{KdTree, Nearest};
use glam::{DVec2, DVec3};
use std::sync::{Mutex, PoisonError};

/// A point is sparse whose spacing is this many times that of the cloud. Where fewer than so many of these are within
/// so many times its spacing, of some 80 in a surface and 40 at its border, no more is known of a surface there than of
/// strays: a few returns of a spire, say.
const SPARSE: f64 = 2.0;
const FEW: usize = 24;
const FEW_REACH: f64 = 5.0;
/// Radius, over that of the density rule of the cloud, from which a sparse point is looked at; and largest radius of
/// samples of a mesh that few others surround.
const LARGE: f64 = 2.5;
/// Share of points in surfaces from which these alone decide what spacing is typical.
const IN_SURFACES: f64 = 0.1;
/// Axis ratio from which sampling counts as anisotropic.
pub(crate) const STRETCHED: f64 = 1.5;
/// Axis ratio of the longest ellipse.
pub(crate) const MOST_STRETCHED: f64 = 48.0;
/// Share of stretched points from which a cloud gets ellipses: random samplings have about 5 % by chance.
const STRETCHED_SHARE: f64 = 0.1;
/// Points of a task. What lies around them is measured too, and again by its own task: of random points
/// on a surface, about a tenth.
const BLOCK: usize = 2 * RUN;

/// Sizes and classes in steps, one a slot.
#[derive(Debug)]
pub(crate) struct Sizes {
    all: Vec<Size>,
    /// Of each slot, where the cloud is stretched.
    ellipses: Vec<Ellipse>,
    /// The spacing of the cloud.
    pub(crate) typical: f64,
    /// Splats that are not circles, where the cloud is stretched, else 0.
    pub(crate) stretched: usize,
    /// True if the spacing was known beforehand.
    is_known: bool,
}

/// A size as one point's neighbourhood suggests it, and the evidence for its class.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Size {
    /// Radius of a disk, 0 where there is no neighbour.
    pub(crate) radius: f32,
    /// √ of the area per point.
    pub(crate) spacing: f32,
    pub(crate) evidence: Evidence,
}

/// The ellipse that suits a point better than its disk, in 64 bits; a ratio of 0 where none does.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ellipse {
    /// √ of the product of the half-axes.
    mean: f32,
    /// Steps of the long axis's angle in the normal's tangent frame, up to half a turn.
    angle: u16,
    /// Steps of its length over the short one's.
    ratio: u16,
}

impl Ellipse {
    /// Steps of half a turn, and of the largest ratio.
    const STEPS: f64 = 65_535.0;

    pub(crate) fn new(mean: f32, angle: f64, ratio: f64) -> Self {
        let turn = (angle / std::f64::consts::PI).rem_euclid(1.0);
        let ratio = (ratio / MOST_STRETCHED * Self::STEPS).round() as u16;
        Self { mean, angle: (turn * Self::STEPS).round() as u16, ratio }
    }

    fn angle(self) -> f64 {
        f64::from(self.angle) / Self::STEPS * std::f64::consts::PI
    }

    fn ratio(self) -> f64 {
        f64::from(self.ratio) / Self::STEPS * MOST_STRETCHED
    }
}

impl Sizes {
    /// Number of slots.
    pub(crate) fn len(&self) -> usize {
        self.all.len()
    }

    /// The class of a slot's point.
    pub(crate) fn class(&self, slot: usize) -> PointClass {
        self.all[slot].evidence.class()
    }

    /// The evidence for the class of a slot's point.
    pub(crate) fn evidence(&self, slot: usize) -> Evidence {
        self.all[slot].evidence
    }

    /// Radius of a disk of this slot, within what its class allows.
    fn bounded(&self, slot: usize, own: f32) -> f64 {
        if own <= 0.0 {
            return DENSITY * self.typical;
        }
        let class = self.class(slot);
        // Samples of a mesh are on it wherever they are.
        let most = if self.is_known && class == PointClass::Line { LARGE * DENSITY } else { class.most() };
        f64::from(own).min(most * self.typical)
    }

    /// The ellipse of this slot, if it has one.
    fn ellipse(&self, slot: usize) -> Option<Ellipse> {
        self.ellipses.get(slot).copied().filter(|ellipse| ellipse.ratio > 0)
    }

    /// Adds a piece of evidence to those of a slot, whose splat becomes a disk no larger than this.
    pub(crate) fn reclassify(&mut self, slot: usize, piece: u8, radius: f64) {
        let evidence = self.all[slot].evidence.with(piece, true);
        self.all[slot].evidence = evidence;
        self.limit(slot, radius);
    }

    /// Makes the splat of a slot a disk, no larger than this.
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

    /// Makes no axis of a slot's splat longer than this.
    pub(crate) fn shorten(&mut self, slot: usize, most: f64) {
        let Some(ellipse) = self.ellipse(slot) else {
            self.all[slot].radius = (most as f32).min(self.bounded(slot, self.all[slot].radius) as f32);
            return;
        };
        let (mean, root) = (self.bounded(slot, ellipse.mean), ellipse.ratio().sqrt());
        let (long, short) = ((mean * root).min(most), (mean / root).min(most));
        let mean = (long * short).sqrt() as f32;
        if long > STRETCHED * short {
            self.ellipses[slot] = Ellipse::new(mean, ellipse.angle(), long / short);
        } else {
            self.all[slot].radius = mean;
            self.remove_ellipse(slot);
        }
    }

    /// The larger half-axis.
    pub(crate) fn radius(&self, slot: usize) -> f64 {
        match self.ellipse(slot) {
            Some(ellipse) => self.bounded(slot, ellipse.mean) * ellipse.ratio().sqrt(),
            None => self.bounded(slot, self.all[slot].radius),
        }
    }

    /// Half-axes (s, t), s × t along the unit `normal`.
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

/// The spacing of points, as far as it is known beforehand, in steps.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Spacing {
    /// Nothing; a cloud that has none (one point) gets this.
    Unknown(f64),
    /// It is this on average everywhere: the density rule takes it instead of measuring.
    Known(f64),
}

/// Measures sizes and classes from the `degree` nearest of each point (one of `oriented` a slot, and of `level` true
/// where a point lies in no surface and its normal is up; none if no point does).
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
    // Of few slots, mostly: all of them have one only where the cloud is stretched.
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
    let is_stretched = !found.is_empty() && found.len() as f64 >= STRETCHED_SHARE * count as f64;
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

/// The spacing that is typical of a cloud: the median of those in surfaces, where these are many.
fn typical(all: &[Size]) -> Option<f64> {
    let is_in_surface = |size: &Size| size.evidence.class().is_surface();
    let in_surfaces = all.iter().filter(|size| is_in_surface(size)).count();
    let counts = |size: &Size| (in_surfaces as f64) < IN_SURFACES * all.len() as f64 || is_in_surface(size);
    median_of(all.len(), |i| if counts(&all[i]) { all[i].spacing } else { 0.0 }).map(f64::from)
}

/// Slots of points that are sparse and few: fewer than [`FEW`] are as sparse as one about it. A sparse part of a
/// surface has more, of which its border has half.
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

/// The lower median; `None` of nothing. Reorders `values`.
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
            // Half a turn is the same ellipse.
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
