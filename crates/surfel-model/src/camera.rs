//! Cameras and projections, as described in the scene file.

use crate::ModelError;
use crate::range::{finite, positive};
use glam::DVec3;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// Largest image side, in pixels.
pub const MAX_IMAGE_SIDE: u32 = 65_536;
/// Largest number of pixels in one render (the image, or its region).
pub const MAX_IMAGE_PIXELS: u64 = 1 << 28;

/// Default direction that appears upward ([`Camera::up`]).
const DEFAULT_UP: [f64; 3] = [0.0, 1.0, 0.0];

/// Default near plane: planar depth in world units; nothing nearer to the eye is drawn.
const DEFAULT_NEAR: f64 = 0.01;

/// Camera of the scene file, in world space, world units and degrees.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct Camera {
    /// Position of the eye in world space.
    pub eye: [f64; 3],
    /// Point in world space that the camera looks at; differs from `eye`.
    pub target: [f64; 3],
    /// Direction in world space that appears upward, of any length but zero; not parallel to the viewing direction.
    #[cfg_attr(feature = "serde", serde(default = "default_up"))]
    pub up: [f64; 3],
    /// Projection of view space onto the image: perspective or orthographic.
    pub projection: Projection,
    /// Near plane: planar depth in world units, greater than 0. Nothing nearer to the eye is drawn.
    #[cfg_attr(feature = "serde", serde(default = "default_near"))]
    pub near: f64,
    /// Far plane of an orthographic view: planar depth in world units; nothing farther from the eye is drawn. A
    /// perspective view ignores the far plane, and an orthographic view is invalid without one.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Option::is_none"))]
    pub far: Option<f64>,
    /// Image width and height in pixels, each from 1 to [`MAX_IMAGE_SIDE`].
    pub size: [u32; 2],
}

#[cfg(feature = "serde")]
fn default_up() -> [f64; 3] {
    DEFAULT_UP
}

#[cfg(feature = "serde")]
fn default_near() -> f64 {
    DEFAULT_NEAR
}

/// Projection from view space to pixels (rendering model §1).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "snake_case", deny_unknown_fields))]
pub enum Projection {
    /// Centred perspective projection with square pixels.
    Perspective {
        /// Vertical field of view in degrees, in (0, 180).
        fov_y_deg: f64,
    },
    /// Perspective projection of a calibrated camera: pinhole intrinsics in pixels, without distortion and skew.
    Intrinsics {
        /// Focal length along x, in pixels; greater than 0.
        fx: f64,
        /// Focal length along y, in pixels; greater than 0.
        fy: f64,
        /// x of the principal point, in pixels from the image's left edge.
        cx: f64,
        /// y of the principal point, in pixels from the image's upper edge.
        cy: f64,
    },
    /// Parallel projection.
    Orthographic {
        /// Height of the view in world units; greater than 0.
        height: f64,
    },
}

impl Camera {
    /// Creates a camera at `eye` that looks at `target`. The vertical field of view is in degrees, in (0, 180); the
    /// image has `size` = [width, height] pixels. By default, +y appears upward and nothing nearer than 0.01 world
    /// units is drawn; see [`Camera::with_up`] and [`Camera::with_near`]. Numbers are validated when the camera is
    /// used.
    pub fn perspective(eye: [f64; 3], target: [f64; 3], fov_y_deg: f64, size: [u32; 2]) -> Self {
        Self::looking(eye, target, Projection::Perspective { fov_y_deg }, None, size)
    }

    /// Creates a calibrated camera like [`Camera::perspective`]. Focal lengths are in pixels and greater than 0; the
    /// principal point is in pixels from the image's upper left corner.
    pub fn intrinsics(eye: [f64; 3], target: [f64; 3], focal: [f64; 2], principal: [f64; 2], size: [u32; 2]) -> Self {
        let ([fx, fy], [cx, cy]) = (focal, principal);
        Self::looking(eye, target, Projection::Intrinsics { fx, fy, cx, cy }, None, size)
    }

    /// Creates a camera like [`Camera::perspective`] with a parallel projection. The view is `height` world units high,
    /// and nothing farther from the eye than `far` is drawn.
    pub fn orthographic(eye: [f64; 3], target: [f64; 3], height: f64, far: f64, size: [u32; 2]) -> Self {
        Self::looking(eye, target, Projection::Orthographic { height }, Some(far), size)
    }

    fn looking(eye: [f64; 3], target: [f64; 3], projection: Projection, far: Option<f64>, size: [u32; 2]) -> Self {
        Self { eye, target, up: DEFAULT_UP, projection, near: DEFAULT_NEAR, far, size }
    }

    crate::setters! {
        with_up up: [f64; 3],
        with_near near: f64,
        with_size size: [u32; 2],
    }

    /// Validates every number, and that the camera has a direction.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] naming the field as in the scene file. [`ModelError::Conflict`] for equal `eye` and
    /// `target`, for `up` along the viewing direction, and for an orthographic camera without `far`.
    pub fn validate(&self) -> Result<(), ModelError> {
        finite("camera.eye", &self.eye)?;
        finite("camera.target", &self.target)?;
        finite("camera.up", &self.up)?;
        positive("camera.near", self.near)?;
        let (eye, target, up) = (DVec3::from(self.eye), DVec3::from(self.target), DVec3::from(self.up));
        let forward = target - eye;
        if forward == DVec3::ZERO || !forward.is_finite() {
            return Err(ModelError::Conflict(
                "camera.eye and camera.target are the same point: the camera has no direction".into(),
            ));
        }
        if up == DVec3::ZERO {
            return Err(ModelError::range("camera.up", up, "a direction that is not zero"));
        }
        let (f, u) = (surfel_math::basis::unit(forward), surfel_math::basis::unit(up));
        if f.cross(u).length() < 1e-9 {
            return Err(ModelError::Conflict("camera.up is parallel to the view direction: choose another up".into()));
        }
        let [w, h] = self.size;
        if w == 0 || h == 0 || w > MAX_IMAGE_SIDE || h > MAX_IMAGE_SIDE {
            return Err(ModelError::range("camera.size", format!("{w}x{h}"), "1 to 65536 pixels a side"));
        }
        match self.projection {
            Projection::Perspective { fov_y_deg } => {
                if !(fov_y_deg > 0.0 && fov_y_deg < 180.0) {
                    return Err(ModelError::range(
                        "camera.projection.perspective.fov_y_deg",
                        fov_y_deg,
                        "degrees in (0, 180)",
                    ));
                }
            }
            Projection::Intrinsics { fx, fy, cx, cy } => {
                positive("camera.projection.intrinsics.fx", fx)?;
                positive("camera.projection.intrinsics.fy", fy)?;
                finite("camera.projection.intrinsics", &[cx, cy])?;
            }
            Projection::Orthographic { height } => {
                positive("camera.projection.orthographic.height", height)?;
                let Some(far) = self.far else {
                    return Err(ModelError::Conflict("an orthographic camera needs camera.far".into()));
                };
                if !(far > self.near && far.is_finite()) {
                    return Err(ModelError::range("camera.far", far, "a finite number greater than camera.near"));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_made_of_what_differs_from_one_to_the_next() {
        let (eye, size) = ([0.0, 0.0, 5.0], [640, 480]);
        let ortho = Camera::orthographic(eye, [0.0; 3], 2.0, 9.0, size);
        assert_eq!((ortho.far, ortho.projection), (Some(9.0), Projection::Orthographic { height: 2.0 }));
        let calibrated = Camera::intrinsics(eye, [0.0; 3], [600.0, 610.0], [320.0, 240.0], size);
        for camera in [Camera::perspective(eye, [0.0; 3], 45.0, size), ortho, calibrated] {
            assert_eq!(camera.validate(), Ok(()));
            assert!(camera.clone().with_near(0.0).validate().is_err());
            assert!(camera.with_up([0.0, 0.0, 1.0]).validate().is_err());
        }
        assert!(Camera::perspective(eye, eye, 45.0, size).validate().is_err());
    }

    #[test]
    fn a_camera_without_direction_or_with_its_up_along_the_view_is_refused() {
        let camera = Camera::perspective([0.0, 0.0, 5.0], [0.0; 3], 45.0, [8, 8]);
        assert!(camera.validate().is_ok());
        assert!(Camera { target: camera.eye, ..camera.clone() }.validate().is_err());
        assert!(Camera { up: [0.0, 0.0, 2.0], ..camera.clone() }.validate().is_err());
        assert!(Camera { size: [0, 4], ..camera.clone() }.validate().is_err());
        assert!(Camera { near: 0.0, ..camera.clone() }.validate().is_err());
        let ortho = Projection::Orthographic { height: 2.0 };
        assert!(Camera { projection: ortho, ..camera.clone() }.validate().is_err());
        assert!(Camera { projection: ortho, far: Some(9.0), ..camera }.validate().is_ok());
    }
}
