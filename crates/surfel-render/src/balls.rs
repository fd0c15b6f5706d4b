//! Balls and dots (rendering model §11): the scale of their radii.

use crate::View;
use glam::{DAffine3, DVec3};

/// Returns the factor by which an object's matrix scales the radii of its balls (rendering model §11): the cube root of
/// the determinant's absolute value. Balls remain spheres, and their volume changes by the same factor as all volumes.
pub fn ball_scale(world_from_object: &DAffine3) -> f64 {
    world_from_object.matrix3.determinant().abs().cbrt()
}

/// Side of an image pixel in world units as a function of the position, for balls whose radii are in pixels (rendering
/// model §11). Shadow maps and edge samples use this length of the image's pixels, too, so that balls have the same
/// size there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallPixel {
    /// Position of the eye in world space.
    eye: DVec3,
    /// Gradient of the pixel's side in world space, in world units per world unit; zero in an orthographic view.
    slope: DVec3,
    /// Side of a pixel at the eye, in world units; zero in perspective.
    at_eye: f64,
    /// Smallest side of a pixel in world units: the side at z_near.
    least: f64,
}

impl BallPixel {
    /// Computes the side of a view's pixels as a function of the position.
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

    /// Returns the side of a pixel in world units as a function of an object's points, in object space.
    pub fn in_object(&self, world_from_object: &DAffine3) -> BallPixelForm {
        BallPixelForm {
            slope: world_from_object.matrix3.transpose() * self.slope,
            constant: self.at_eye + self.slope.dot(world_from_object.translation - self.eye),
            least: self.least,
        }
    }
}

/// Side of an image pixel in world units as a function of a point p in object space: max(slope·p + constant, least).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallPixelForm {
    /// Gradient of the pixel's side, in world units per object unit.
    pub slope: DVec3,
    /// Side of a pixel at the object's origin, in world units.
    pub constant: f64,
    /// Smallest side of a pixel in world units: the side at z_near.
    pub least: f64,
}

impl BallPixelForm {
    /// Returns the side of a pixel, in world units, at a point in object space.
    pub fn at(&self, p: DVec3) -> f64 {
        (self.slope.dot(p) + self.constant).max(self.least)
    }

    /// Returns the same function for points that are given relative to `origin`.
    #[must_use]
    pub fn about(&self, origin: DVec3) -> Self {
        Self { constant: self.slope.dot(origin) + self.constant, ..*self }
    }
}
