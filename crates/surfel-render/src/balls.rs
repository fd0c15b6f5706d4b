//! Balls and dots (§11): the scale of their radii.

use crate::View;
use glam::{DAffine3, DVec3};

/// Returns the factor by which an object's placement scales the radii of its balls (§11). Balls remain spheres, and the
/// factor preserves the ratio of their volume to the volume of space.
pub fn ball_scale(world_from_object: &DAffine3) -> f64 {
    world_from_object.matrix3.determinant().abs().cbrt()
}

/// Length of an image pixel in world units as a function of the position, for balls whose radii are in pixels (§11).
/// Shadow maps and edge samples use the length of the image's pixels, too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallPixel {
    eye: DVec3,
    /// Change of the length in world units along each world axis; zero in an orthographic view.
    slope: DVec3,
    /// Length at the eye, in world units; zero in perspective.
    at_eye: f64,
    /// Minimum length in world units: the length at z_near.
    least: f64,
}

impl BallPixel {
    /// Computes the length of a view's pixels.
    pub fn of(view: &View) -> Self {
        let [fx, fy] = view.projection.focal_px;
        let length = 1.0 / (fx * fy).sqrt();
        let eye = view.eye;
        if view.projection.is_perspective() {
            let least = length * view.projection.near;
            return Self { eye, slope: view.forward() * length, at_eye: 0.0, least };
        }
        Self { eye, slope: DVec3::ZERO, at_eye: length, least: length }
    }

    /// Returns the length as a function of the points p of an object: max(slope·p + constant, least).
    pub fn in_object(&self, world_from_object: &DAffine3) -> BallPixelForm {
        BallPixelForm {
            slope: world_from_object.matrix3.transpose() * self.slope,
            constant: self.at_eye + self.slope.dot(world_from_object.translation - self.eye),
            least: self.least,
        }
    }
}

/// Length of a pixel in world units, as a function of a point in object space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallPixelForm {
    /// Gradient of the length, in world units per object unit.
    pub slope: DVec3,
    /// Length at the object's origin, in world units.
    pub constant: f64,
    /// Minimum length in world units: the length at z_near.
    pub least: f64,
}

impl BallPixelForm {
    /// Returns the length in world units at a point in object space.
    pub fn at(&self, p: DVec3) -> f64 {
        (self.slope.dot(p) + self.constant).max(self.least)
    }

    /// Returns the same function for points that are given relative to `origin`.
    #[must_use]
    pub fn about(&self, origin: DVec3) -> Self {
        Self { constant: self.slope.dot(origin) + self.constant, ..*self }
    }
}
