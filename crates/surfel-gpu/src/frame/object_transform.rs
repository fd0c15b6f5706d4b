//! The transform of an object into a view, in f64.

use glam::{DAffine3, DMat3, DVec3};
use surfel_math::basis::normal_matrix;
use surfel_render::View;

/// An object's transform into a view, in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ObjectTransform {
    /// Object to view directions.
    pub linear: DMat3,
    /// View position of the object's origin.
    pub origin: DVec3,
    /// Object to world normals up to scale: cofactors with the sign of the determinant.
    pub normals: DMat3,
    /// Factor by which the object's largest length grows, at most.
    pub stretch: f64,
}

impl ObjectTransform {
    pub(crate) fn new(world_from_object: &DAffine3, view: &View) -> Self {
        let m = world_from_object.matrix3;
        Self {
            linear: view.view_from_world * m,
            // Subtracting the eye before anything is rotated keeps scenes far from the origin exact.
            origin: view.view_from_world * (world_from_object.translation - view.eye),
            normals: normal_matrix(&m),
            // The Frobenius norm bounds the largest singular value.
            stretch: m.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt(),
        }
    }

    /// View position of an object-space point.
    pub(crate) fn point(&self, p: DVec3) -> DVec3 {
        self.origin + self.linear * p
    }
}
