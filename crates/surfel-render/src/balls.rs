//! Balls and dots (§11): the scale of their radii.

use crate::View;
use glam::{DAffine3, DVec3};

/// Returns the factor by which an object's placement scales the radii of its balls (§11): balls stay balls, and the map
/// preserves the ratio of their volume to that of space.
pub fn ball_scale(world_from_object: &DAffine3) -> f64 {
    world_from_object.matrix3.determinant().abs().cbrt()
}

/// Length of a pixel of the image, for balls whose radii are in pixels (§11). It is the same where shadow maps and
/// samples are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallPixel {
    eye: DVec3,
    /// Change of the length in world units along each world axis; zero in an orthographic view.
    slope: DVec3,
    /// Length at the eye, in world units; zero in perspective.
    at_eye: f64,
    /// Least length in world units: that at z_near.
    least: f64,
}

impl BallPixel {
    /// Returns the length of a view's pixels.
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

    /// Returns the length at the points p of an object, as max(slope·p + constant, least).
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
    /// Gradient of the length.
    pub slope: DVec3,
    /// Length at the object's origin.
    pub constant: f64,
    /// Least length: that at z_near.
    pub least: f64,
}

impl BallPixelForm {
    /// Returns the length at a point.
    pub fn at(&self, p: DVec3) -> f64 {
        (self.slope.dot(p) + self.constant).max(self.least)
    }

    /// Returns the form for points relative to an origin.
    #[must_use]
    pub fn about(&self, origin: DVec3) -> Self {
        Self { constant: self.slope.dot(origin) + self.constant, ..*self }
    }
}
