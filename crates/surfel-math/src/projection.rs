//! Projection from view space to pixels (rendering model §1).

use crate::{Real, V2, V3};

/// A camera's projection from view space (x right, y down, z forward) to pixels. Row 0 is at the top.
///
/// Its numbers are the same for a whole frame, so they are plain f64 and rounded where they are used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Kind of the projection: perspective or orthographic.
    pub kind: ProjectionKind,
    /// Focal lengths in x and y: pixels per unit of slope x/z (perspective), or per world unit (orthographic).
    pub focal_px: [f64; 2],
    /// Principal point: position of the optical axis in pixels from the image's upper left corner.
    pub principal_px: [f64; 2],
    /// Smallest planar depth that is drawn (z_near), in world units; greater than 0.
    pub near: f64,
}

/// The kind of a projection, with the parameters that only this kind has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ProjectionKind {
    /// Central projection: pixel = f·(x/z) + c. There is no far plane.
    Perspective,
    /// Parallel projection: pixel = f·x + c.
    Orthographic {
        /// Height of the view in world units.
        height: f64,
        /// Largest planar depth that is drawn, in world units.
        far: f64,
    },
}

impl Projection {
    /// True for a perspective projection.
    #[inline(always)]
    pub fn is_perspective(&self) -> bool {
        self.kind == ProjectionKind::Perspective
    }

    /// Returns the largest planar depth that is drawn, in world units: infinite in perspective.
    pub fn far(&self) -> f64 {
        match self.kind {
            ProjectionKind::Perspective => f64::INFINITY,
            ProjectionKind::Orthographic { far, .. } => far,
        }
    }

    /// Returns the pixel coordinates of a view-space point (perspective: in front of the eye).
    pub fn pixel(&self, p: V3<f64>) -> V2<f64> {
        let w = if self.is_perspective() { p.z } else { 1.0 };
        V2::new(self.focal_px[0] * p.x / w + self.principal_px[0], self.focal_px[1] * p.y / w + self.principal_px[1])
    }

    /// Returns the view ray through a pixel position in view space: its origin, and its direction with z = 1.
    pub fn ray(&self, pixel: V2<f64>) -> (V3<f64>, V3<f64>) {
        let x = (pixel.x - self.principal_px[0]) / self.focal_px[0];
        let y = (pixel.y - self.principal_px[1]) / self.focal_px[1];
        match self.kind {
            ProjectionKind::Perspective => (V3::new(0.0, 0.0, 0.0), V3::new(x, y, 1.0)),
            ProjectionKind::Orthographic { .. } => (V3::new(x, y, 0.0), V3::new(0.0, 0.0, 1.0)),
        }
    }

    /// Returns the stored depth of planar depth `z` (rendering model §1): z_near/z, or 1 − (z − z_near)/(z_far −
    /// z_near); 0 for z = ∞.
    pub fn stored_depth(&self, z: f64) -> f64 {
        if z.is_infinite() {
            return 0.0;
        }
        match self.kind {
            ProjectionKind::Perspective => self.near / z,
            ProjectionKind::Orthographic { far, .. } => 1.0 - (z - self.near) / (far - self.near),
        }
    }

    /// Returns the offset in pixels from the pixel position `base_px` to the projection of `p`. A difference of two
    /// pixel coordinates would cancel; this is (f·p_x − (base − c)·p_z)/p_z by Kahan's product difference. In f32 the
    /// offset's error is that of p itself, not that of a pixel coordinate.
    #[inline(always)]
    pub fn offset_from<R: Real>(&self, p: V3<R>, base_px: V2<R>) -> V2<R> {
        let focal = [p.x.constant(self.focal_px[0]), p.x.constant(self.focal_px[1])];
        let bx = base_px.x - p.x.constant(self.principal_px[0]);
        let by = base_px.y - p.x.constant(self.principal_px[1]);
        match self.kind {
            ProjectionKind::Perspective => {
                let inverse = p.x.one() / p.z;
                V2::new(
                    R::difference_of_products(focal[0], p.x, bx, p.z) * inverse,
                    R::difference_of_products(focal[1], p.y, by, p.z) * inverse,
                )
            }
            ProjectionKind::Orthographic { .. } => V2::new(focal[0].mul_add(p.x, -bx), focal[1].mul_add(p.y, -by)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERSPECTIVE: Projection = Projection {
        kind: ProjectionKind::Perspective,
        focal_px: [2000.0, 1900.0],
        principal_px: [1920.25, 1080.5],
        near: 0.01,
    };

    #[test]
    fn rays_go_through_their_pixels() {
        let orthographic = Projection { kind: ProjectionKind::Orthographic { height: 2.0, far: 9.0 }, ..PERSPECTIVE };
        for projection in [PERSPECTIVE, orthographic] {
            let (o, d) = projection.ray(V2::new(17.25, 900.5));
            let p = projection.pixel(o + d * 3.5);
            assert!((p.x - 17.25).abs() < 1e-9 && (p.y - 900.5).abs() < 1e-9);
        }
    }

    #[test]
    fn stored_depth_is_one_at_near_and_zero_at_far() {
        assert_eq!(PERSPECTIVE.stored_depth(0.01), 1.0);
        assert_eq!(PERSPECTIVE.stored_depth(f64::INFINITY), 0.0);
        let o = Projection { kind: ProjectionKind::Orthographic { height: 2.0, far: 9.01 }, ..PERSPECTIVE };
        assert!((o.stored_depth(0.01) - 1.0).abs() < 1e-15 && o.stored_depth(9.01).abs() < 1e-15);
    }

    #[test]
    fn offset_in_f32_is_hundreds_of_times_better_than_subtracting_pixel_coordinates() {
        let (mut ours, mut naive) = (0.0f64, 0.0f64);
        for i in 0..10_000u32 {
            let p = V3::new(
                (f64::from(i).sin() * 2.0) as f32,
                (f64::from(i * 7).sin() * 1.1) as f32,
                (2.5 + f64::from(i * 3).sin()) as f32,
            );
            let exact = PERSPECTIVE.pixel(V3::new(p.x.into(), p.y.into(), p.z.into()));
            let base = V2::new(exact.x.floor() as f32, exact.y.floor() as f32);
            let offset = PERSPECTIVE.offset_from(p, base);
            ours = ours.max((f64::from(base.x) + f64::from(offset.x) - exact.x).abs());
            let direct = 2000.0 * p.x / p.z + 1920.25;
            naive = naive.max((f64::from(direct) - exact.x).abs());
        }
        // Ours: a few ulp of an offset below 1 px. The naive difference: an ulp of a coordinate up to 4096.
        assert!(ours < 1e-6, "{ours}");
        assert!(naive > 200.0 * ours, "{naive} {ours}");
    }
}
