//! Cameras from the view and projection matrices of a graphics engine.

use crate::{Camera, ModelError, Projection};
use glam::{DMat3, DMat4, DVec3};

/// Largest accepted deviation of a matrix from a rotation, or from a projection without skew. Skew is relative to the
/// matrix's scale, and other deviations are absolute. Matrices of f32 deviate by about 1e-7.
const TOLERANCE: f64 = 1e-4;

/// Expected form of a view matrix, for error messages.
const VIEW: &str = "a rotation and a translation to a right-handed space in which the camera looks along -z";
/// Expected form of a projection matrix, for error messages.
const PROJECTION: &str = "a right-handed perspective or orthographic projection without skew";

impl Camera {
    /// Creates a camera from the matrices of a graphics engine.
    ///
    /// `view_from_world` is a matrix as glam's `dcamera::rh::view` returns. `clip_from_view` is a matrix as a function
    /// of glam's `dcamera::rh::proj` returns, for OpenGL, DirectX (also wgpu) or Vulkan. The principal point may be off
    /// the centre, and y may point down in clip space, as in Vulkan. The image has `size` = [width, height] pixels.
    ///
    /// `near_far` are the depths of the near and far planes in world units. They are arguments because conventions of
    /// clip-space depth differ. A perspective camera ignores the far plane.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] for a view matrix that scales, mirrors or isn't finite, for a projection of another
    /// form, and for numbers that [`Camera::validate`] refuses.
    pub fn from_matrices(
        view_from_world: DMat4,
        clip_from_view: DMat4,
        [near, far]: [f64; 2],
        size: [u32; 2],
    ) -> Result<Self, ModelError> {
        let rotation = DMat3::from_mat4(view_from_world);
        let error = (rotation * rotation.transpose() - DMat3::IDENTITY).to_cols_array().map(f64::abs);
        let is_affine = near_to(view_from_world.row(3).to_array(), [0.0, 0.0, 0.0, 1.0]);
        if !(view_from_world.is_finite() && is_affine && rotation.determinant() > 0.0)
            || error.into_iter().fold(0.0, f64::max) > TOLERANCE
        {
            return Err(ModelError::range("view_from_world", view_from_world, VIEW));
        }
        let world_from_view = rotation.transpose();
        let eye = -(world_from_view * view_from_world.w_axis.truncate());
        let [right, up, forward] = [DVec3::X, DVec3::Y, DVec3::NEG_Z].map(|axis| world_from_view * axis);

        let [x, y, _, w] = [0, 1, 2, 3].map(|row| clip_from_view.row(row).to_array());
        // Vulkan's clip space points down.
        let y = if y[1] < 0.0 { y.map(|value| -value) } else { y };
        let [width, height] = size.map(f64::from);
        let scale = [x[0], y[1]];
        let is_skewed = x[1].abs() > TOLERANCE * x[0].abs() || y[0].abs() > TOLERANCE * y[1].abs();
        let refused = || ModelError::range("clip_from_view", clip_from_view, PROJECTION);
        if !clip_from_view.is_finite() || is_skewed || scale.iter().any(|scale| *scale <= 0.0) {
            return Err(refused());
        }
        let (projection, eye, far) = if near_to(w, [0.0, 0.0, -1.0, 0.0]) && x[3] == 0.0 && y[3] == 0.0 {
            let [fx, fy] = [0.5 * width * x[0], 0.5 * height * y[1]];
            let (cx, cy) = (0.5 * width * (1.0 - x[2]), 0.5 * height * (1.0 + y[2]));
            (Projection::Intrinsics { fx, fy, cx, cy }, eye, None)
        } else if near_to(w, [0.0, 0.0, 0.0, 1.0]) && x[2] == 0.0 && y[2] == 0.0 {
            if (x[0] * width - y[1] * height).abs() > TOLERANCE * y[1] * height {
                let expected = "square pixels: the proportions of the projection are those of the image";
                return Err(ModelError::range("clip_from_view", clip_from_view, expected));
            }
            let center = right * (-x[3] / x[0]) + up * (-y[3] / y[1]);
            (Projection::Orthographic { height: 2.0 / y[1] }, eye + center, Some(far))
        } else {
            return Err(refused());
        };
        let (eye, target, up) = (eye.into(), (eye + forward).into(), up.into());
        let camera = Self { eye, target, up, projection, near, far, size };
        camera.validate()?;
        Ok(camera)
    }
}

fn near_to(found: [f64; 4], expected: [f64; 4]) -> bool {
    found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= TOLERANCE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dcamera::{lh, rh};
    use rh::proj::{directx, opengl, vulkan};

    const SIZE: [u32; 2] = [640, 480];

    fn view() -> DMat4 {
        rh::view::look_at_mat4(DVec3::new(3.0, -2.0, 5.0), DVec3::new(0.5, 0.25, 0.0), DVec3::Z)
    }

    #[test]
    fn matrices_of_glam_give_its_camera() {
        let fov: f64 = 0.8;
        let aspect = 640.0 / 480.0;
        let focal = 240.0 / (0.5 * fov).tan();
        for clip in [
            directx::perspective(fov, aspect, 0.1, 50.0),
            directx::perspective_infinite_reverse(fov, aspect, 0.1),
            vulkan::perspective(fov, aspect, 0.1, 50.0),
            opengl::perspective(fov, aspect, 0.1, 50.0),
        ] {
            let camera = Camera::from_matrices(view(), clip, [0.1, 50.0], SIZE).unwrap();
            let Projection::Intrinsics { fx, fy, cx, cy } = camera.projection else { panic!() };
            for (found, expected) in [(fx, focal), (fy, focal), (cx, 320.0), (cy, 240.0)] {
                assert!((found - expected).abs() < 1e-9, "{found}, expected {expected}");
            }
            assert!(DVec3::from(camera.eye).distance(DVec3::new(3.0, -2.0, 5.0)) < 1e-12);
            assert_eq!((camera.near, camera.far), (0.1, None));
        }
    }

    #[test]
    fn other_matrices_are_refused() {
        let clip = directx::perspective(0.8, 4.0 / 3.0, 0.1, 50.0);
        let is_refused = |view, clip| Camera::from_matrices(view, clip, [0.1, 50.0], SIZE).is_err();
        assert!(!is_refused(view(), clip));
        let scaled = DMat4::from_scale(DVec3::splat(2.0));
        let mirrored = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let skewed = DMat4 { y_axis: glam::DVec4::new(0.1, 1.0, 0.0, 0.0), ..DMat4::IDENTITY };
        let nan = DMat4::from_translation(DVec3::NAN);
        for view in [scaled * view(), mirrored * view(), view() * skewed, nan, DMat4::ZERO] {
            assert!(is_refused(view, clip), "{view}");
        }
        let left_handed = lh::proj::directx::perspective(0.8, 4.0 / 3.0, 0.1, 50.0);
        let wide = directx::orthographic(-1.0, 1.0, -1.0, 1.0, 0.1, 9.0);
        for clip in [left_handed, wide, mirrored * clip, skewed * clip, DMat4::ZERO, DMat4::NAN] {
            assert!(is_refused(view(), clip), "{clip}");
        }
    }
}
