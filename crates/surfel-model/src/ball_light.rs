//! Light that is stored for a ball, so that every image shows it without lights.

use glam::Vec3;

/// Light that reaches a ball from all sides (rendering model §12), stored as a quadratic polynomial of the direction. A
/// white surface with the unit normal n, in world space, has the brightness max(0, b·n + nᵀ·Q·n).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BallLight {
    /// Linear coefficients b along x, y and z.
    pub linear: [f32; 3],
    /// Coefficients of the symmetric matrix Q: Q_xx, Q_yy, Q_zz, Q_xy, Q_xz and Q_yz.
    pub quadratic: [f32; 6],
}

impl BallLight {
    /// Returns the brightness of a white surface with this unit normal.
    pub fn toward(&self, n: Vec3) -> f32 {
        let [xx, yy, zz, xy, xz, yz] = self.quadratic;
        let squares = xx * n.x * n.x + yy * n.y * n.y + zz * n.z * n.z;
        let products = xy * n.x * n.y + xz * n.x * n.z + yz * n.y * n.z;
        (Vec3::from(self.linear).dot(n) + squares + 2.0 * products).max(0.0)
    }

    /// Adds a sample to the polynomial: the brightness `amount` of a white surface with the unit normal `n`.
    ///
    /// The sample is projected onto polynomials of degree 2. The caller multiplies `amount` by the sample's weight in a
    /// mean over the sphere.
    pub fn add(&mut self, n: Vec3, amount: f32) {
        // Projection onto degree 2 at a unit vector m: the sum over l of (2l + 1)·P_l(n·m) with Legendre polynomials
        // P_l, which is 1 + 3·n·m + 5/2·(3·(n·m)² − 1).
        for (linear, n) in self.linear.iter_mut().zip(n.to_array()) {
            *linear += 3.0 * amount * n;
        }
        let (square, constant) = (7.5 * amount, -1.5 * amount);
        let products = [n.x * n.x, n.y * n.y, n.z * n.z, n.x * n.y, n.x * n.z, n.y * n.z];
        for (i, (q, product)) in self.quadratic.iter_mut().zip(products).enumerate() {
            *q += square * product + if i < 3 { constant } else { 0.0 };
        }
    }

    /// Returns the nine coefficients: linear b, then quadratic Q, in the order of the fields.
    pub fn to_array(self) -> [f32; 9] {
        let ([a, b, c], [d, e, f, g, h, i]) = (self.linear, self.quadratic);
        [a, b, c, d, e, f, g, h, i]
    }
}
