//! Views: cameras converted to the numbers that renderers need.

use crate::SAMPLES_SIDE;
use glam::{DMat3, DVec3};
use surfel_math::V2;
use surfel_math::basis::unit;
use surfel_math::projection::{Projection, ProjectionKind};
use surfel_model::{Camera, MAX_IMAGE_PIXELS, ModelError};

/// A rectangle of an image's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Left column.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
}

impl Region {
    /// Returns the region grown by `by` pixels on every side, clipped to an image of this size.
    #[must_use]
    pub fn grown(self, by: u32, [width, height]: [u32; 2]) -> Self {
        let (x, y) = (self.x.saturating_sub(by), self.y.saturating_sub(by));
        let (end_x, end_y) = ((self.x + self.width + by).min(width), (self.y + self.height + by).min(height));
        Self { x, y, width: end_x - x, height: end_y - y }
    }
}

impl Region {
    /// Returns the same region in samples instead of pixels ([`View::of_samples`]).
    #[must_use]
    pub fn of_samples(self) -> Self {
        let [x, y, width, height] = [self.x, self.y, self.width, self.height].map(|px| px * SAMPLES_SIDE);
        Self { x, y, width, height }
    }
}

/// View of a scene: a validated camera, in the form that renderers use, and the region of its image to render.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Position of the eye in world space.
    pub eye: DVec3,
    /// Rotation from world to view axes (x right, y down, z forward): v_view = R·(v_world − eye).
    pub view_from_world: DMat3,
    /// Projection of the whole image.
    pub projection: Projection,
    /// Size of the whole image, in pixels.
    pub size: [u32; 2],
    /// Rectangle of the image that is rendered, in pixels of the whole image.
    pub region: Region,
}

impl View {
    /// Returns the world-space point at planar depth `z` on the ray through a position in the whole image, in pixels.
    /// The point is computed in f64; all its coordinates are +∞ if `z` isn't finite.
    pub(crate) fn world_position(&self, [x, y]: [f64; 2], z: f64) -> [f64; 3] {
        if !z.is_finite() {
            return [f64::INFINITY; 3];
        }
        let (origin, direction) = self.projection.ray(V2::new(x, y));
        let at = origin + direction * z;
        (self.view_from_world.transpose() * DVec3::new(at.x, at.y, at.z) + self.eye).to_array()
    }

    /// Creates the view of a camera, with the whole image as its region.
    ///
    /// # Errors
    /// Errors of [`Camera::validate`]; also [`ModelError::OutOfRange`] for an image of more than [`MAX_IMAGE_PIXELS`].
    pub fn new(camera: &Camera) -> Result<Self, ModelError> {
        let view = Self::of_region(camera, None)?;
        Ok(view)
    }

    /// Creates the view of a camera, cropped to `region` (the whole image if `None`).
    ///
    /// # Errors
    /// Errors of [`Camera::validate`]; also [`ModelError::OutOfRange`] for a region that is empty, extends beyond the
    /// image, or has more than [`MAX_IMAGE_PIXELS`].
    pub fn of_region(camera: &Camera, region: Option<Region>) -> Result<Self, ModelError> {
        camera.validate()?;
        let [width, height] = camera.size;
        let region = region.unwrap_or(Region { x: 0, y: 0, width, height });
        let fits = |start: u32, length: u32, limit: u32| {
            length > 0 && u64::from(start) + u64::from(length) <= u64::from(limit)
        };
        if !fits(region.x, region.width, width) || !fits(region.y, region.height, height) {
            return Err(ModelError::OutOfRange {
                field: "region".into(),
                found: format!("{},{},{},{}", region.x, region.y, region.width, region.height),
                expected: "a rectangle X,Y,W,H of at least one pixel inside the image",
            });
        }
        if u64::from(region.width) * u64::from(region.height) > MAX_IMAGE_PIXELS {
            return Err(ModelError::OutOfRange {
                field: "camera.size".into(),
                found: format!("{}x{}", region.width, region.height),
                expected: "at most 268435456 pixels at a time (render larger images by regions)",
            });
        }
        let (eye, target) = (DVec3::from(camera.eye), DVec3::from(camera.target));
        let forward = unit(target - eye);
        let right = unit(forward.cross(unit(DVec3::from(camera.up))));
        let down = forward.cross(right);
        let (w, h) = (f64::from(width), f64::from(height));
        let center = [0.5 * w, 0.5 * h];
        use surfel_model::Projection as P;
        let (kind, focal_px, principal_px) = match camera.projection {
            P::Perspective { fov_y_deg } => {
                let f = h / (2.0 * (0.5 * fov_y_deg.to_radians()).tan());
                (ProjectionKind::Perspective, [f, f], center)
            }
            P::Intrinsics { fx, fy, cx, cy } => (ProjectionKind::Perspective, [fx, fy], [cx, cy]),
            P::Orthographic { height } => {
                let far = camera.far.unwrap_or(f64::INFINITY);
                (ProjectionKind::Orthographic { height, far }, [h / height, h / height], center)
            }
        };
        Ok(Self {
            eye,
            view_from_world: DMat3::from_cols(right, down, forward).transpose(),
            projection: Projection { kind, focal_px, principal_px, near: camera.near },
            size: camera.size,
            region,
        })
    }

    /// Returns the viewing direction, a unit vector in world space.
    pub fn forward(&self) -> DVec3 {
        self.view_from_world.row(2)
    }

    /// Returns the number of pixels of the rendered region.
    pub fn pixels(&self) -> usize {
        self.region.width as usize * self.region.height as usize
    }

    /// Returns the view with `factor` times as many pixels along each side, for supersampling.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] if `factor` is 0, or if the result's region has more than [`MAX_IMAGE_PIXELS`].
    pub fn supersampled(&self, factor: u32) -> Result<Self, ModelError> {
        let k = f64::from(factor);
        let size = self.size.map(|s| s.checked_mul(factor));
        let r = self.region;
        let region = [r.x, r.y, r.width, r.height].map(|v| v.checked_mul(factor));
        let ([Some(w), Some(h)], [Some(x), Some(y), Some(width), Some(height)]) = (size, region) else {
            return Err(too_many_samples(factor));
        };
        if factor == 0 || u64::from(width) * u64::from(height) > MAX_IMAGE_PIXELS {
            return Err(too_many_samples(factor));
        }
        Ok(Self { size: [w, h], region: Region { x, y, width, height }, ..self.by(k) })
    }

    /// Returns the view whose pixels are the 4×4 samples of this view's pixels, for antialiasing edges by samples
    /// (rendering model §5). Its size is not limited, because the view isn't drawn completely.
    #[must_use]
    pub fn of_samples(&self) -> Self {
        let size = self.size.map(|px| px * SAMPLES_SIDE);
        Self { size, region: self.region.of_samples(), ..self.by(f64::from(SAMPLES_SIDE)) }
    }

    /// Returns the same view with `factor` times as many pixels along each side.
    fn by(&self, factor: f64) -> Self {
        let p = self.projection;
        let projection = Projection {
            focal_px: p.focal_px.map(|f| f * factor),
            principal_px: p.principal_px.map(|c| c * factor),
            ..p
        };
        Self { projection, ..self.clone() }
    }
}

fn too_many_samples(factor: u32) -> ModelError {
    ModelError::OutOfRange {
        field: "samples".into(),
        found: factor.to_string(),
        expected: "at least 1, and samples² x pixels of at most 268435456",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Projection as P;

    fn camera() -> Camera {
        Camera {
            eye: [1e6, 0.0, 5.0],
            target: [1e6, 0.0, 0.0],
            up: [0.0, 1.0, 0.0],
            projection: P::Perspective { fov_y_deg: 90.0 },
            near: 0.1,
            far: None,
            size: [200, 100],
        }
    }

    #[test]
    fn view_axes_are_right_down_forward() {
        let view = View::new(&camera()).unwrap();
        let to_view = |v: DVec3| view.view_from_world * v;
        assert!((to_view(DVec3::X) - DVec3::X).length() < 1e-15);
        assert!((to_view(DVec3::Y) - DVec3::NEG_Y).length() < 1e-15);
        assert!((to_view(DVec3::NEG_Z) - DVec3::Z).length() < 1e-15);
        assert!((view.projection.focal_px[0] - 50.0).abs() < 1e-12);
        assert_eq!(view.projection.principal_px, [100.0, 50.0]);
    }

    #[test]
    fn views_of_an_engine_s_matrices_project_to_its_pixels() {
        use glam::dcamera::rh;
        use glam::{DMat4, DVec4};
        let matrix = rh::view::look_at_mat4(DVec3::new(3.0, -2.0, 5.0), DVec3::new(0.5, 0.25, 0.0), DVec3::Y);
        let (near, far, size) = (0.1, 50.0, [640, 480]);
        // Off the centre, and square pixels.
        let perspective = DMat4::from_cols(
            DVec4::new(1.5, 0.0, 0.0, 0.0),
            DVec4::new(0.0, 2.0, 0.0, 0.0),
            DVec4::new(0.25, -0.125, far / (near - far), -1.0),
            DVec4::new(0.0, 0.0, near * far / (near - far), 0.0),
        );
        let orthographic = rh::proj::directx::orthographic(-3.0, 5.0, -4.0, 2.0, near, far);
        for clip_from_view in [perspective, orthographic] {
            let camera = Camera::from_matrices(matrix, clip_from_view, [near, far], size).unwrap();
            let view = View::new(&camera).unwrap();
            for i in 0..50 {
                let at = |k: f64| (k * f64::from(i)).sin();
                let p = DVec3::new(at(1.0), at(2.3), at(3.7));
                let clip = clip_from_view * matrix * p.extend(1.0);
                let (x, y) = (320.0 * (1.0 + clip.x / clip.w), 240.0 * (1.0 - clip.y / clip.w));
                let seen = view.view_from_world * (p - view.eye);
                let found = view.projection.pixel(surfel_math::V3::new(seen.x, seen.y, seen.z));
                assert!((found.x - x).hypot(found.y - y) < 1e-9, "{found:?}, expected {x} {y}");
            }
        }
    }

    #[test]
    fn a_region_outside_the_image_is_refused() {
        let region = |x, y, width, height| View::of_region(&camera(), Some(Region { x, y, width, height }));
        assert!(region(0, 0, 200, 100).is_ok());
        assert!(region(199, 99, 1, 1).is_ok());
        assert!(region(199, 99, 2, 1).is_err());
        assert!(region(0, 0, 0, 1).is_err());
        assert!(region(u32::MAX, 0, 2, 1).is_err());
    }

    #[test]
    fn supersampling_scales_pixels_and_refuses_what_cannot_fit() {
        let view = View::new(&camera()).unwrap().supersampled(4).unwrap();
        assert_eq!((view.size, view.region.height), ([800, 400], 400));
        assert!((view.projection.focal_px[1] - 200.0).abs() < 1e-12);
        assert!(View::new(&camera()).unwrap().supersampled(10_000).is_err());
    }
}
