//! Splats placed on a mesh, and their clipping at the mesh's borders.

use super::borders::{Borders, FACING, FARTHEST, VisiblePart, clip_columns};
use super::density::Density;
use super::geometry::Geometry;
use super::parts::Sample;
use crate::parallel::map_each;
use crate::tree::Nearest;
use crate::{Progress, assemble, radii};
use glam::{DVec2, DVec3};
use surfel_math::basis::orthonormal;
use surfel_model::{ClipColumns, Shape};

/// Factors by which a splat's radius is multiplied, tried in order until clip lines leave enough of the splat's area.
const GROWTH: [f64; 3] = [1.3, 1.7, MAX_GROWN];
/// Largest growth factor of a splat's radius because of clip lines.
pub(super) const MAX_GROWN: f64 = 2.2;

/// Largest height of a place over a splat's plane, relative to the splat's radius, at which the place counts as in the
/// plane.
const IN_PLANE: f64 = 1e-3;

/// Number of directions from which a place near a border must be covered.
pub(super) const TEST_DIRECTIONS: usize = 9;

/// Splats placed on a mesh, before they are clipped at its borders.
pub(super) struct Placed<'a> {
    pub(super) geometry: &'a Geometry<'a>,
    /// Density of the splats, which gives the distances between them and thus their radii.
    pub(super) density: &'a Density,
    /// Factor by which radii that follow from the density are scaled.
    pub(super) radius_scale: f64,
    pub(super) samples: Vec<Sample>,
    pub(super) positions: Vec<DVec3>,
    /// Unit normals of the splats' planes.
    pub(super) planes: Vec<DVec3>,
    pub(super) radii: Vec<f64>,
}

/// Growth factor of a clipped splat's radius, and the visible part of the grown splat.
pub(super) type Grown = (f64, VisiblePart);

/// Shape and clip columns of splats that end at the borders of the surface.
pub(super) struct ClippedShape {
    pub(super) shape: Shape,
    pub(super) clips: Option<ClipColumns>,
}

impl Placed<'_> {
    fn axes(&self, i: usize, scale: f64) -> (DVec3, DVec3) {
        let (u, v) = orthonormal(self.planes[i]);
        (u * self.radii[i] * scale, v * self.radii[i] * scale)
    }

    /// Moves splat `i` to another place, and updates its plane and radius.
    pub(super) fn put(&mut self, i: usize, sample: Sample) {
        self.samples[i] = sample;
        self.positions[i] = sample.place(self.geometry);
        self.planes[i] = self.geometry.normals[sample.face as usize];
        self.radii[i] = radii::DENSITY * self.density.at(&sample) * self.radius_scale;
    }

    /// Returns the growth factor and the visible part of splat `i` after clipping; `None` if no border clips it.
    pub(super) fn grown(&self, i: usize, borders: &Borders, regions: &[u32], found: &mut Nearest) -> Option<Grown> {
        let region = regions[self.samples[i].face as usize];
        let mut at = |scale: f64| borders.keep(self.positions[i], self.axes(i, scale), region, found);
        let (mut scale, mut kept) = (1.0, at(1.0)?);
        for larger in GROWTH {
            if kept.area * scale * scale >= kept.least() {
                break;
            }
            // A larger splat meets every border that a smaller one does.
            (scale, kept) = (larger, at(larger)?);
        }
        kept.widen(kept.least() / (scale * scale));
        Some((scale, kept))
    }

    /// Returns the growth factor and the visible part of each splat ([`Self::grown`]); `None` for splats that no border
    /// clips.
    pub(super) fn all_grown(&self, borders: &Borders, regions: &[u32], progress: &dyn Progress) -> Vec<Option<Grown>> {
        let count = self.samples.len();
        if borders.is_empty() {
            return vec![None; count];
        }
        progress.stage("borders", count as u64);
        map_each(count, progress, Borders::nearest, |found, i| self.grown(i, borders, regions, found))
    }

    /// Returns the radius of splat `i` including its growth.
    pub(super) fn reach(&self, i: usize, kept: &[Option<Grown>]) -> f64 {
        self.radii[i] * kept[i].as_ref().map_or(1.0, |(scale, _)| *scale)
    }

    /// Clears the flags in `bare` of the directions from which splat `i` covers `place`. `eyes` are unit vectors toward
    /// the viewer, and `bare` has one flag for each, true if no splat covers the place from there.
    pub(super) fn cover(
        &self,
        i: usize,
        kept: &[Option<Grown>],
        place: DVec3,
        eyes: &[DVec3; TEST_DIRECTIONS],
        bare: &mut [bool; TEST_DIRECTIONS],
    ) {
        let (reach, normal) = (self.reach(i, kept), self.planes[i]);
        let ((s, t), d) = (orthonormal(normal), place - self.positions[i]);
        let keeps = |at: DVec3| {
            let q = DVec2::new(at.dot(s), at.dot(t)) / reach;
            q.length_squared() < 1.0 && kept[i].as_ref().is_none_or(|(_, kept)| kept.keeps(q))
        };
        let height = -d.dot(normal);
        // In the splat's plane, the result is the same for all directions.
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

    /// Returns the splats' shape and clips: disks, or clipped ellipses if a border clips any splat.
    pub(super) fn bordered(&self, kept: &[Option<Grown>]) -> ClippedShape {
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
        ClippedShape { shape, clips }
    }
}
