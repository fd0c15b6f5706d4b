//! A cloud in a view: its object transform, the pixels its chunks may cover, and culling of its chunks.
//!
//! A *record* is a splat projected to the screen ([`Record`](crate::setup::record::Record)). A *slot* is the index of a
//! stored splat in the columns of its object ([`StoredObject`]). A *tile* is a square of 8 to 32 pixels a side
//! ([`Grid`](crate::tiles::grid::Grid)).

use crate::scene::cloud::{Chunk, StoredObject};
use crate::tiles::bins::{Entry, RECORD_BYTES};
use glam::{DMat3, DVec3};
use surfel_math::projection::{Projection, ProjectionKind};
use surfel_model::{Cull, Filter, Material};
use surfel_render::{FramePlan, Region, View};

/// Ratio of the memory of an entry in a tile's list to the memory of a record with one entry.
const ENTRY_SHARE: f64 = size_of::<Entry>() as f64 / (RECORD_BYTES + size_of::<Entry>()) as f64;

/// A cloud in a view: the values that all of its splats share.
pub(crate) struct ObjectView<'a> {
    pub object: &'a StoredObject,
    /// Index of the object among the scene's clouds.
    pub index: u32,
    /// Number of the object's first splat ([`SplatNumbers`](crate::scene::numbers::SplatNumbers)), if the frame outputs
    /// the nearest splat. Records then store numbers of splats instead of the object's index.
    pub first_number: Option<u32>,
    /// The object's material; its `cull` is [`Cull::None`] if the caller disables back-face culling.
    pub material: Material,
    /// Linear map of directions from object to view space.
    pub linear: DMat3,
    /// Position of the object's origin in view space.
    pub origin: DVec3,
    /// Map of normals from object to world space, up to a positive scale. Normals of a mirrored object stay outward.
    pub normals: DMat3,
    /// Map of normals from object to view space, up to the same positive scale as `normals`. If `scale` is given, both
    /// maps preserve lengths.
    pub view_normals: DMat3,
    /// Factor by which the object's matrix scales lengths; `None` if the factor isn't the same in all directions.
    pub scale: Option<f64>,
    /// −1 if the object's matrix mirrors it, else 1.
    pub handedness: f64,
    /// Upper bound of the factor by which the object's matrix lengthens vectors.
    stretch: f64,
    /// Eye position in object space; in an orthographic view, the unit viewing direction instead.
    pub eye_in_object: DVec3,
    pub view: &'a View,
    pub plan: &'a FramePlan,
}

impl<'a> ObjectView<'a> {
    fn new(object: &'a StoredObject, index: u32, view: &'a View, plan: &'a FramePlan, cull: Cull) -> Self {
        let m = object.world_from_object.matrix3;
        let cofactors = DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
        let scale = cofactors.to_cols_array().iter().fold(0.0f64, |a, b| a.max(b.abs()));
        let sign = 1.0f64.copysign(m.determinant());
        let inverse = object.world_from_object.inverse();
        let uniform = uniform_scale(&m);
        // The Frobenius norm bounds the largest singular value.
        let stretch = uniform
            .map_or_else(|| m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt(), |scale| scale * (1.0 + 1e-6));
        let normals = cofactors * (sign / uniform.map_or(scale, |length| length * length));
        let eye_in_object = if view.projection.is_perspective() {
            inverse.transform_point3(view.eye)
        } else {
            surfel_math::basis::unit(inverse.transform_vector3(view.forward()))
        };
        Self {
            object,
            index,
            first_number: None,
            material: Material {
                cull: if cull == Cull::None { cull } else { object.material.cull },
                ..object.material
            },
            eye_in_object,
            linear: view.view_from_world * m,
            origin: view.view_from_world * (object.world_from_object.translation - view.eye),
            normals,
            view_normals: view.view_from_world * normals,
            scale: uniform,
            handedness: sign,
            stretch,
            view,
            plan,
        }
    }

    /// Returns the views of all clouds of a scene. [`Cull::None`] disables back-face culling, overriding the materials.
    pub(crate) fn all(clouds: &'a [StoredObject], view: &'a View, plan: &'a FramePlan, cull: Cull) -> Vec<Self> {
        clouds.iter().zip(0..).map(|(cloud, index)| Self::new(cloud, index, view, plan, cull)).collect()
    }

    /// True if some of the object's splats are drawn as transparent.
    pub(crate) fn is_transparent(&self) -> bool {
        self.plan.separates_transparent && self.object.alphas.is_some()
    }

    /// True if front- and back-facing splats of the object are accumulated separately, so that each pixel shows one
    /// side.
    pub(crate) fn keeps_facings(&self) -> bool {
        self.plan.keeps_facings && self.object.oriented
    }

    /// Returns the position of a chunk's origin in view space.
    pub(crate) fn center(&self, chunk: &Chunk) -> DVec3 {
        self.origin + self.linear * chunk.space.origin
    }

    /// True if the material culls back faces and every splat of the chunk is certainly back-facing. False if the chunk
    /// has no cone of normals, and if the eye is inside its bounding sphere. The test runs in object space.
    pub(crate) fn is_back_facing(&self, chunk: &Chunk) -> bool {
        if self.material.cull != Cull::Back {
            return false;
        }
        let Some(cone) = &chunk.cone else { return false };
        let (toward, spread_sine) = match self.view.projection.kind {
            ProjectionKind::Perspective => {
                let ray = chunk.space.origin - self.eye_in_object;
                let distance = ray.length();
                if distance <= chunk.radius {
                    return false;
                }
                (ray / distance, chunk.radius / distance)
            }
            ProjectionKind::Orthographic { .. } => (self.eye_in_object, 0.0),
        };
        cone.is_back_facing(toward, spread_sine)
    }

    /// Returns the bounds of the pixels that a chunk may touch: minimum x and y, maximum x and y. The bounds are
    /// infinite in perspective if the chunk is around, behind or close to the eye ([`pixels_of_box`]). `center` is the
    /// view position of the chunk's origin.
    pub(crate) fn pixels(&self, center: DVec3, chunk: &Chunk) -> [f64; 4] {
        let half = self.half(chunk) * self.extent_ratio();
        pixels_of_box(&self.view.projection, center, half, self.plan.splat_filter.reach_px())
    }

    /// Returns the nearest and farthest planar depth of a chunk's splats, in world units. `center` is the view position
    /// of the chunk's origin.
    pub(crate) fn depths(&self, center: DVec3, chunk: &Chunk) -> [f64; 2] {
        let half = self.half(chunk);
        [center.z - half.z, center.z + half.z]
    }

    /// Returns half the size of a box around a chunk's origin that contains the chunk's splats. The box is aligned with
    /// the view's axes.
    fn half(&self, chunk: &Chunk) -> DVec3 {
        let (m, half) = (&self.linear, chunk.half);
        let side = m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z;
        side.min(DVec3::splat(chunk.radius * self.stretch))
    }

    /// Returns an upper bound of the ratio of a drawn footprint's extent to its splat's own extent, both measured from
    /// the splat's centre.
    fn extent_ratio(&self) -> f64 {
        // An affine footprint exceeds the splat's own outline by less than half its distance from the centre (p_z/z <
        // 3/2 on its far side). Three times the bounding sphere is ample.
        let affine = !self.plan.splat_filter.projective || self.plan.splat_filter.filter == Filter::Ewa;
        if affine && self.view.projection.is_perspective() { 3.0 } else { 1.0 }
    }

    /// Returns the planes through the eye and the region's four sides, for testing bounding spheres.
    pub(crate) fn sides(&self, region: Region) -> RegionSides {
        let projection = &self.view.projection;
        let margin = self.plan.splat_filter.reach_px();
        let slopes = |axis: usize, start: u32, length: u32| {
            let limits = [f64::from(start) - margin, f64::from(start + length) + margin];
            limits.map(|limit| (limit - projection.principal_px[axis]) / projection.focal_px[axis])
        };
        let slopes = [slopes(0, region.x, region.width), slopes(1, region.y, region.height)];
        let perspective = projection.is_perspective();
        RegionSides {
            slopes,
            lengths: slopes.map(|pair| pair.map(|slope| if perspective { slope.hypot(1.0) } else { 1.0 })),
            perspective,
            reach: self.stretch * self.extent_ratio(),
        }
    }

    /// True if no splat of the chunk can touch the region. `center` is the view position of the chunk's origin.
    pub(crate) fn is_outside(&self, center: DVec3, chunk: &Chunk, region: Region) -> bool {
        let projection = &self.view.projection;
        let [nearest, farthest] = self.depths(center, chunk);
        let [x0, y0, x1, y1] = self.pixels(center, chunk);
        let [start_x, start_y, end_x, end_y] =
            [region.x, region.y, region.x + region.width, region.y + region.height].map(f64::from);
        farthest < projection.near
            || nearest > projection.far()
            || x1 < start_x
            || x0 > end_x
            || y1 < start_y
            || y0 > end_y
    }

    /// Returns the memory of the records (projected splats) and tile entries of a chunk's splats within these pixels
    /// (minimum x and y, maximum x and y). The unit is the memory of a record with one entry. A large splat has one
    /// entry for every tile, of `tile_px`² pixels, that it touches.
    pub(crate) fn load(&self, center: DVec3, chunk: &Chunk, [x0, y0, x1, y1]: [f64; 4], tile_px: u32) -> f64 {
        let count = chunk.count as f64;
        let side = (self.area_px(center, chunk) / count).sqrt() + 2.0 * self.plan.splat_filter.reach_px();
        // For a chunk around the eye, `side` may be infinite or NaN, and the whole length counts.
        let tiles = |length: f64| 1.0 + side.min(length).max(0.0) / f64::from(tile_px);
        count * (1.0 + ENTRY_SHARE * (tiles(x1 - x0) * tiles(y1 - y0) - 1.0))
    }

    /// Returns an upper bound of the total area of a chunk's splats, in square pixels, as if all of them faced the eye
    /// at the depth of the chunk's origin.
    pub(crate) fn area_px(&self, center: DVec3, chunk: &Chunk) -> f64 {
        let [fx, fy] = self.view.projection.focal_px;
        let depth = if self.view.projection.is_perspective() { center.z } else { 1.0 };
        chunk.area * (self.stretch / depth).powi(2) * fx * fy
    }
}

/// Clips a box of pixels (minimum x and y, maximum x and y) to a region.
pub(crate) fn inside([x0, y0, x1, y1]: [f64; 4], r: Region) -> [f64; 4] {
    let [x, y, end_x, end_y] = [r.x, r.y, r.x + r.width, r.y + r.height].map(f64::from);
    [x0.max(x), y0.max(y), x1.min(end_x), y1.min(end_y)]
}

/// Returns the bounds of the pixels that a box around `center` (view space) may touch, with a margin. Bounds are
/// minimum x and y, maximum x and y. `half` is the box's half extents. In perspective, the bounds are infinite if
/// `center` is nearer than four times the half extent in depth, that is, if the box is around, behind or close to the
/// eye.
pub(crate) fn pixels_of_box(projection: &Projection, center: DVec3, half: DVec3, margin_px: f64) -> [f64; 4] {
    if projection.is_perspective() && center.z < 4.0 * half.z {
        return [f64::NEG_INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY];
    }
    let range = |axis: usize| {
        let (at, half_side) = ([center.x, center.y][axis], [half.x, half.y][axis]);
        let slopes = match projection.kind {
            // If the minimum slope is negative, it belongs to the near side.
            ProjectionKind::Perspective => [-1.0, 1.0].map(|sign: f64| {
                let edge = at + sign * half_side;
                edge / (center.z - sign * half.z.copysign(edge))
            }),
            ProjectionKind::Orthographic { .. } => [at - half_side, at + half_side],
        };
        let px = slopes.map(|slope| slope.mul_add(projection.focal_px[axis], projection.principal_px[axis]));
        [px[0].min(px[1]) - margin_px, px[0].max(px[1]) + margin_px]
    };
    let ([x0, x1], [y0, y1]) = (range(0), range(1));
    [x0, y0, x1, y1]
}

/// Planes through the eye and a region's sides, for culling bounding spheres. The planes are moved outwards by the
/// distance that a filter extends splats.
pub(crate) struct RegionSides {
    /// Slopes x/z of the left and the right plane, and y/z of the top and the bottom plane. In an orthographic view,
    /// their coordinates x and y.
    pub slopes: [[f64; 2]; 2],
    /// Lengths of the planes' normals (1, −slope), in the order of `slopes`; 1 in an orthographic view.
    pub lengths: [[f64; 2]; 2],
    pub perspective: bool,
    /// Factor from a length in object space to the largest extent, in view space, to which a splat of that size is
    /// drawn.
    pub reach: f64,
}

/// Returns the scale factor if the matrix is a rotation or reflection times a scale other than 0; else `None`. Products
/// of its columns may be off by 10⁻⁹ of the squared scale.
fn uniform_scale(m: &DMat3) -> Option<f64> {
    let columns = [m.x_axis, m.y_axis, m.z_axis];
    let scale = m.x_axis.length();
    let slack = 1e-9 * scale * scale;
    let fits = (0..3).all(|i| {
        (columns[i].length_squared() - scale * scale).abs() <= slack
            && columns[i].dot(columns[(i + 1) % 3]).abs() <= slack
    });
    (fits && scale > 0.0).then_some(scale)
}
