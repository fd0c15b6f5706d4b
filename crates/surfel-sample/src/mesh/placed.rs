//! Splats at places on a mesh, and what its borders leave of them.

use super::borders::{Borders, FACING, FARTHEST, Kept, clip_columns};
use super::density::Density;
use super::geometry::Geometry;
use super::parts::Sample;
use crate::parallel::map_each;
use crate::tree::Nearest;
use crate::{Progress, assemble, radii};
use glam::{DVec2, DVec3};
use surfel_math::basis::orthonormal;
use surfel_model::{ClipColumns, Shape};

/// Radii that a splat is tried at, over its own, where lines leave too little of it: what they cut off doesn't grow.
const GROWTH: [f64; 3] = [1.3, 1.7, MOST_GROWN];
/// The largest.
pub(super) const MOST_GROWN: f64 = 2.2;

/// A place that stands off a splat's plane by less, over its reach, is in it.
const IN_PLANE: f64 = 1e-3;

/// Directions that a place is seen from.
pub(super) const EYES: usize = 9;

/// Splats on the surface, before borders cut them.
pub(super) struct Placed<'a> {
    pub(super) geometry: &'a Geometry<'a>,
    /// How far apart they are, and what their radii are of what that asks for.
    pub(super) density: &'a Density,
    pub(super) radius_scale: f64,
    pub(super) samples: Vec<Sample>,
    pub(super) positions: Vec<DVec3>,
    /// Unit normals.
    pub(super) planes: Vec<DVec3>,
    pub(super) radii: Vec<f64>,
}

/// How large a splat is that borders cut, over its radius, and what it keeps.
pub(super) type Grown = (f64, Kept);

/// Splats that end at the borders of the surface.
pub(super) struct Bordered {
    pub(super) shape: Shape,
    pub(super) clips: Option<ClipColumns>,
}

impl Placed<'_> {
    fn axes(&self, i: usize, scale: f64) -> (DVec3, DVec3) {
        let (u, v) = orthonormal(self.planes[i]);
        (u * self.radii[i] * scale, v * self.radii[i] * scale)
    }

    /// Puts a splat elsewhere.
    pub(super) fn put(&mut self, i: usize, sample: Sample) {
        self.samples[i] = sample;
        self.positions[i] = sample.place(self.geometry);
        self.planes[i] = self.geometry.normals[sample.face as usize];
        self.radii[i] = radii::DENSITY * self.density.at(&sample) * self.radius_scale;
    }

    /// What is left of a splat; `None` where no border cuts it.
    pub(super) fn grown(&self, i: usize, borders: &Borders, regions: &[u32], found: &mut Nearest) -> Option<Grown> {
        let region = regions[self.samples[i].face as usize];
        let mut at = |scale: f64| borders.keep(self.positions[i], self.axes(i, scale), region, found);
        let (mut scale, mut kept) = (1.0, at(1.0)?);
        for larger in GROWTH {
            if kept.area * scale * scale >= kept.least() {
                break;
            }
            // It meets every border that a smaller one does.
            (scale, kept) = (larger, at(larger)?);
        }
        kept.widen(kept.least() / (scale * scale));
        Some((scale, kept))
    }

    /// That of each.
    pub(super) fn all_grown(&self, borders: &Borders, regions: &[u32], progress: &dyn Progress) -> Vec<Option<Grown>> {
        let count = self.samples.len();
        if borders.is_empty() {
            return vec![None; count];
        }
        progress.stage("borders", count as u64);
        map_each(count, progress, Borders::nearest, |found, i| self.grown(i, borders, regions, found))
    }

    /// How far a splat reaches.
    pub(super) fn reach(&self, i: usize, kept: &[Option<Grown>]) -> f64 {
        self.radii[i] * kept[i].as_ref().map_or(1.0, |(scale, _)| *scale)
    }

    /// Takes from the unit vectors toward eyes that see a place bare those along which a splat covers it.
    pub(super) fn cover(
        &self,
        i: usize,
        kept: &[Option<Grown>],
        place: DVec3,
        eyes: &[DVec3; EYES],
        bare: &mut [bool; EYES],
    ) {
        let (reach, normal) = (self.reach(i, kept), self.planes[i]);
        let ((s, t), d) = (orthonormal(normal), place - self.positions[i]);
        let keeps = |at: DVec3| {
            let q = DVec2::new(at.dot(s), at.dot(t)) / reach;
            q.length_squared() < 1.0 && kept[i].as_ref().is_none_or(|(_, kept)| kept.keeps(q))
        };
        let height = -d.dot(normal);
        // In the splat's plane it is the same for all.
        let in_plane = (height.abs() < IN_PLANE * reach).then(|| keeps(d));
        if in_plane == Some(false) {
            return;
        }
        for (to_eye, bare) in eyes.iter().zip(bare) {
            let facing = normal.dot(*to_eye);
            let behind = height / facing;
            let covers = || in_plane == Some(true) || keeps(d + *to_eye * behind);
            if *bare && facing > FACING && behind.abs() < FARTHEST * reach && covers() {
                *bare = false;
            }
        }
    }

    /// Disks, or ellipses and the lines that clip them where a border cuts any.
    pub(super) fn bordered(&self, kept: &[Option<Grown>]) -> Bordered {
        let clips = clip_columns(kept.iter().map(|kept| kept.as_ref().map(|(_, kept)| kept)));
        let shape = if clips.is_none() {
            Shape::Disks {
                normals: assemble::normals32(&self.planes),
                radii: self.radii.iter().map(|r| assemble::radius32(*r)).collect(),
            }
        } else {
            let scale = |i: usize| kept[i].as_ref().map_or(1.0, |(scale, _)| *scale);
            assemble::ellipses(&map_each(kept.len(), &crate::NoProgress, || (), |(), i| self.axes(i, scale(i))))
        };
        Bordered { shape, clips }
    }
}
