//! Transform of an object into a view, in f64.

use glam::{DAffine3, DMat3, DVec3};
use surfel_math::basis::{normal_matrix, unit};
use surfel_render::View;

/// Affine map from an object's space to a view's, in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ObjectTransform {
    /// Linear part of the map, for directions.
    pub linear: DMat3,
    /// Position of the object's origin in view space.
    pub origin: DVec3,
    /// Matrix from normals in object space to outward normals in world space, up to scale: the cofactors of the
    /// object's matrix, times the sign of its determinant.
    pub normals: DMat3,
    /// Position of the eye in object space; in an orthographic view, the unit viewing direction instead. It isn't
    /// finite, or is zero, if the map has no inverse.
    pub eye_in_object: DVec3,
    /// Upper bound of the factor by which the map lengthens a vector.
    pub stretch: f64,
}

impl ObjectTransform {
    /// Computes the transform of an object with this matrix into a view.
    pub(crate) fn new(world_from_object: &DAffine3, view: &View) -> Self {
        let m = world_from_object.matrix3;
        let object_from_world = world_from_object.inverse();
        let eye_in_object = if view.projection.is_perspective() {
            object_from_world.transform_point3(view.eye)
        } else {
            unit(object_from_world.transform_vector3(view.forward()))
        };
        Self {
            linear: view.view_from_world * m,
            // The eye is subtracted before any rotation, so that scenes far from the origin stay exact.
            origin: view.view_from_world * (world_from_object.translation - view.eye),
            normals: normal_matrix(&m),
            eye_in_object,
            // The Frobenius norm bounds the largest singular value.
            stretch: m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt(),
        }
    }

    /// Returns the view position of an object-space point.
    pub(crate) fn point(&self, p: DVec3) -> DVec3 {
        self.origin + self.linear * p
    }
}
