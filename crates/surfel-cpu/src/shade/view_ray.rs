//! View rays through sixteen pixels, and positions on them. Axes are the world's, positions are relative to the eye.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)).

use crate::simd::lanes::Lanes;
use crate::simd::math::{transform, unit_or_zero, vector};
use fearless_simd::Simd;
use glam::{DVec3, Mat3, Vec3};
use surfel_math::projection::Projection;
use surfel_math::{Real, V3};
use surfel_render::View;

/// Positions of the sixteen surfaces that are lit together.
#[derive(Clone, Copy)]
pub(crate) enum Place<S: Simd> {
    /// Surfaces in the pixels of the block with this first pixel, on the view rays through the pixels' centres.
    Block((i32, i32)),
    /// Surfaces at these positions, in world axes relative to the eye.
    Points(V3<Lanes<S>>),
}

/// View rays to sixteen surfaces, in world axes.
#[derive(Clone, Copy)]
pub(crate) struct ViewRay<S: Simd> {
    /// Direction of each ray away from the eye, of any length.
    pub ray: V3<Lanes<S>>,
    /// Reciprocal of the length of `ray`.
    pub inverse_length: Lanes<S>,
}

impl<S: Simd> ViewRay<S> {
    /// Returns the unit vector to the eye.
    #[inline(always)]
    pub(crate) fn to_eye(self) -> V3<Lanes<S>> {
        self.ray * -self.inverse_length
    }
}

/// The view rays through the pixels of a view, in world axes. In perspective, a ray extends to z = 1 in view space; in
/// an orthographic view, all rays are the forward direction.
pub(crate) struct ViewRays {
    pub world_from_view: Mat3,
    projection: Projection,
    /// Change of the ray from a pixel to the next one on its right.
    across: Vec3,
    /// Change of the ray from a pixel to the next one below.
    down: Vec3,
    /// Ray through the centre of the image's upper left pixel.
    first: Vec3,
}

impl ViewRays {
    pub(crate) fn of(view: &View) -> Self {
        let axes = view.view_from_world.transpose();
        let projection = view.projection;
        let ([fx, fy], [cx, cy]) = (projection.focal_px, projection.principal_px);
        let (right, down, forward) = (axes.x_axis, axes.y_axis, axes.z_axis);
        let [across, down, first] = match projection.is_perspective() {
            true => [right / fx, down / fy, right * ((0.5 - cx) / fx) + down * ((0.5 - cy) / fy) + forward],
            false => [right * 0.0, down * 0.0, forward],
        };
        let [across, down, first] = [across, down, first].map(DVec3::as_vec3);
        Self { world_from_view: axes.as_mat3(), projection, across, down, first }
    }

    /// Returns the view rays to the surfaces at a place.
    #[inline(always)]
    pub(crate) fn view_ray<S: Simd>(&self, simd: S, place: Place<S>) -> ViewRay<S> {
        let (first, one) = (vector(simd, self.first), Lanes::splat(simd, 1.0));
        match place {
            Place::Block(at) => {
                let (x, y) = Lanes::block_pixels(simd, at);
                let (across, down) = (vector(simd, self.across), vector(simd, self.down));
                // Computed from whole pixel numbers, so that the ray doesn't depend on the start of the block.
                let ray = V3::new(
                    x.mul_add(across.x, y.mul_add(down.x, first.x)),
                    x.mul_add(across.y, y.mul_add(down.y, first.y)),
                    x.mul_add(across.z, y.mul_add(down.z, first.z)),
                );
                ViewRay { ray, inverse_length: ray.dot(ray).inverse_sqrt() }
            }
            Place::Points(p) if self.projection.is_perspective() => {
                ViewRay { ray: unit_or_zero(p), inverse_length: one }
            }
            Place::Points(_) => ViewRay { ray: first, inverse_length: one },
        }
    }

    /// Returns the positions, in world axes relative to the eye, of surfaces at depths `z`; `ray` are the view rays to
    /// the place.
    #[inline(always)]
    pub(crate) fn position<S: Simd>(&self, simd: S, place: Place<S>, ray: V3<Lanes<S>>, z: Lanes<S>) -> V3<Lanes<S>> {
        match place {
            Place::Points(position) => position,
            Place::Block(_) if self.projection.is_perspective() => ray * z,
            Place::Block(at) => {
                let (x, y) = self.slopes(simd, at);
                transform(&self.world_from_view, V3::new(x, y, z))
            }
        }
    }

    /// Returns the slopes x/z and y/z, in view space, of the rays through a block's pixels; in an orthographic view,
    /// the coordinates x and y.
    #[inline(always)]
    pub(crate) fn slopes<S: Simd>(&self, simd: S, at: (i32, i32)) -> (Lanes<S>, Lanes<S>) {
        let (p, (x, y)) = (&self.projection, Lanes::block_pixels(simd, at));
        (slope(x, p.focal_px[0], p.principal_px[0]), slope(y, p.focal_px[1], p.principal_px[1]))
    }
}

/// Returns the slope along one axis of the rays through the centres of pixels; in an orthographic view, the coordinate.
#[inline(always)]
fn slope<S: Simd>(pixel: Lanes<S>, focal_px: f64, principal_px: f64) -> Lanes<S> {
    pixel.mul_add(pixel.constant(1.0 / focal_px), pixel.constant((0.5 - principal_px) / focal_px))
}
