//! An object in a view: what is the same for all of its splats, and which chunks can't be seen.

use crate::bins::Grid;
use crate::store::{Chunk, StoredObject};
use crate::veil::VeilSplat;
use glam::{DMat3, DVec3};
use surfel_math::projection::ProjectionKind;
use surfel_model::{Cull, Filter, Material};
use surfel_render::{FramePlan, View};

/// What is the same for all splats of an object in a view.
pub(crate) struct ObjectSetup<'a> {
    pub object: &'a StoredObject,
    pub index: u32,
    /// The object's, unless nothing is to be culled.
    pub material: Material,
    /// Object to view directions, and view position of the object's origin.
    pub linear: DMat3,
    pub origin: DVec3,
    /// Object to world normals up to scale: cofactors with the sign of the determinant.
    pub normals: DMat3,
    /// Object to view normals; a rotation if `scale` is given, and `normals` then another.
    pub view_normals: DMat3,
    /// Factor of all lengths, of an object placed without distortion.
    pub scale: Option<f64>,
    /// Factor by which the object's largest length grows.
    stretch: f64,
    /// The eye, or of an orthographic view the unit direction away from it, in object space.
    eye_in_object: DVec3,
    pub view: &'a View,
    pub plan: &'a FramePlan,
    pub grid: Grid,
}

impl<'a> ObjectSetup<'a> {
    pub(crate) fn new(
        object: &'a StoredObject,
        index: u32,
        view: &'a View,
        plan: &'a FramePlan,
        grid: Grid,
        cull: Cull,
    ) -> Self {
        let m = object.world_from_object.matrix3;
        let cofactors = DMat3::from_cols(m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis));
        let scale = cofactors.to_cols_array().iter().fold(0.0f64, |a, b| a.max(b.abs()));
        let sign = 1.0f64.copysign(m.determinant());
        // The Frobenius norm bounds the largest singular value.
        let stretch = m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt();
        let inverse = object.world_from_object.inverse();
        let uniform = uniform_scale(&m);
        let normals = cofactors * (sign / uniform.map_or(scale, |length| length * length));
        let eye_in_object = if view.projection.is_perspective() {
            inverse.transform_point3(view.eye)
        } else {
            surfel_math::basis::unit(inverse.transform_vector3(view.forward()))
        };
        Self {
            object,
            index,
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
            stretch,
            view,
            plan,
            grid,
        }
    }

    /// What a splat of a slot has besides its record, if it is transparent; its centre is in view space.
    #[inline(always)]
    pub(crate) fn transparent(&self, slot: usize, center: impl FnOnce() -> [f32; 3]) -> Option<VeilSplat> {
        let alphas = self.object.alphas.as_ref().filter(|_| self.plan.separates_transparent)?;
        let alpha = alphas.get(slot).copied().filter(|&alpha| alpha < 1.0)?;
        Some(VeilSplat { alpha, center: center(), lit: [0.0; 3] })
    }

    /// View position of a chunk's origin.
    pub(crate) fn center(&self, chunk: &Chunk) -> DVec3 {
        self.origin + self.linear * chunk.origin
    }

    /// True if the material leaves back faces out and every splat of the chunk is one.
    ///
    /// Facing is affine invariant, so the eye is brought into the object's space: a normal within the cone faces away from
    /// every ray through the chunk's ball if its angle to the axis of both stays below 90°.
    pub(crate) fn is_turned_away(&self, chunk: &Chunk) -> bool {
        if self.material.cull != Cull::Back {
            return false;
        }
        let Some(cone) = &chunk.cone else { return false };
        let (toward, spread_sine) = match self.view.projection.kind {
            ProjectionKind::Perspective => {
                let ray = chunk.origin - self.eye_in_object;
                let distance = ray.length();
                if distance <= chunk.ball {
                    return false;
                }
                (ray / distance, chunk.ball / distance)
            }
            ProjectionKind::Orthographic { .. } => (self.eye_in_object, 0.0),
        };
        // cos(a) > sin(cone + spread), for both below 90° together; the slack is far above f32's rounding in setup.
        let spread_cosine = (1.0 - spread_sine * spread_sine).max(0.0).sqrt();
        let sine = cone.sine * spread_cosine + cone.cosine * spread_sine;
        let cosine = cone.cosine * spread_cosine - cone.sine * spread_sine;
        cosine > 0.0 && toward.dot(cone.axis) > sine + 1e-4
    }

    /// First and last row that a chunk may touch, roughly: it only shares out the work.
    pub(crate) fn rows(&self, chunk: &Chunk) -> [f64; 2] {
        let center = self.center(chunk);
        let p = &self.view.projection;
        let z = if p.is_perspective() { center.z.max(p.near) } else { 1.0 };
        let row = p.focal_px[1] * center.y / z + p.principal_px[1];
        let reach = p.focal_px[1] * chunk.ball * self.stretch / z;
        [row - reach, row + reach]
    }

    /// True if no splat of the chunk can touch the picture.
    pub(crate) fn is_outside(&self, center: DVec3, chunk: &Chunk) -> bool {
        let ball = chunk.ball * self.stretch;
        let projection = &self.view.projection;
        if center.z + ball < projection.near || center.z - ball > projection.far() {
            return true;
        }
        // An affine footprint leaves the splat's own outline, by less than half its distance from the centre
        // (p_z/z < 3/2 on its far side); three times the ball is ample.
        let affine = !self.plan.splat_filter.projective || self.plan.splat_filter.filter == Filter::Ewa;
        let ball = if affine && projection.is_perspective() { 3.0 * ball } else { ball };
        let r = self.view.region;
        // A filtered footprint reaches past its splat: by h, or for ewa by no more than both together.
        let margin = self.plan.splat_filter.radius_px + 1.0;
        let x = [f64::from(r.x) - margin, f64::from(r.x + r.width) + margin];
        let y = [f64::from(r.y) - margin, f64::from(r.y + r.height) + margin];
        let side = |limit: f64, axis: usize, sign: f64| {
            let f = projection.focal_px[axis];
            let slope = (limit - projection.principal_px[axis]) / f;
            let along = if axis == 0 { center.x } else { center.y };
            match projection.kind {
                // Signed distance beyond the plane through the eye and the picture's side.
                ProjectionKind::Perspective => {
                    center.z + ball > 0.0 && sign * (along - slope * center.z) > ball * slope.hypot(1.0)
                }
                ProjectionKind::Orthographic { .. } => sign * (along - slope) > ball,
            }
        };
        // Sides of a ball about the eye tell nothing.
        if projection.is_perspective() && center.z < 4.0 * ball {
            return false;
        }
        side(x[0], 0, -1.0) || side(x[1], 0, 1.0) || side(y[0], 1, -1.0) || side(y[1], 1, 1.0)
    }
}

/// The factor of all lengths, if the matrix is a rotation (or reflection) and that; within rounding of f32.
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
