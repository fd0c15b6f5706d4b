//! The shader `matcap` (rendering model §5), which finds the point of a lit sphere that has a surface's normal.
//!
//! Source: Sloan, Martin, Gooch and Gooch 2001, "The Lit Sphere". Deviation: the sphere is viewed along each pixel's
//! own ray. A silhouette therefore maps to the rim of the sphere, also where perspective turns the silhouette.

use crate::{Real, V2, V3};

/// Returns the position of a unit normal in the sphere's image: x to the right and y down, (0, 0) where the sphere
/// faces the eye, distance 1 at the rim. A zero normal counts as facing the eye. `to_eye` is a unit vector, `down` the
/// view's down direction; all vectors are in the same coordinate system. If `down` is parallel to the ray, the result
/// is (0, 0).
#[inline(always)]
pub fn coordinates<R: Real>(normal: V3<R>, to_eye: V3<R>, down: V3<R>) -> V2<R> {
    let across = to_eye.cross(down);
    let length = across.length();
    let x = across * (length.one() / R::select(length.zero().lt(length), length, length.one()));
    let y = x.cross(to_eye);
    V2::new(normal.dot(x), normal.dot(y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matcap_coordinates_are_the_sphere_s_as_the_eye_sees_it() {
        let down = V3::new(0.0, 1.0, 0.0);
        let ahead = V3::new(0.0, 0.0, -1.0);
        let at = |n: [f64; 3], to_eye| {
            let c = coordinates(V3::new(n[0], n[1], n[2]), to_eye, down);
            [c.x, c.y]
        };
        assert_eq!(at([0.0, 0.0, -1.0], ahead), [0.0, 0.0]);
        assert_eq!(at([1.0, 0.0, 0.0], ahead), [1.0, 0.0]);
        assert_eq!(at([0.0, 0.6, -0.8], ahead), [0.0, 0.6]);
        assert_eq!(at([0.0, 0.0, 0.0], ahead), [0.0, 0.0]);
        // Towards the side of the image, a surface that faces the eye still maps to the middle of the sphere, and an
        // edge-on one to its rim.
        let aside = V3::new(-0.6, 0.0, -0.8);
        assert!(at([-0.6, 0.0, -0.8], aside).iter().all(|c| c.abs() < 1e-15));
        assert!((at([0.8, 0.0, -0.6], aside)[0] - 1.0).abs() < 1e-15);
        // Straight up or down, right and left are undefined, but the result isn't NaN.
        assert_eq!(at([1.0, 0.0, 0.0], down), [0.0, 0.0]);
    }
}
