//! Clip curves by C12 eq. 6–8, from the intersection of the curve with a line from the point to the chord's middle.

use crate::clip::Curve;
use crate::{Real, V2};

/// A clip curve that classifies points as in C12 §3.2, with numerical repairs.
///
/// The type serves for comparison: [`crate::clip::Clip`] yields the same image without a root, and over pixels without
/// a division.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperCurve<R> {
    /// Start of the curve, in (u, v) on the unit circle.
    pub p1: V2<R>,
    /// Middle control point of the curve, anywhere in (u, v).
    pub p2: V2<R>,
    /// End of the curve, in (u, v) on the unit circle.
    pub p3: V2<R>,
    /// Weight of the control point `p2`, at least 0. A larger weight pulls the curve closer to `p2`; 0 makes it the
    /// chord.
    pub w: R,
    /// Turn of the control polygon at `p2`: 1 for left, −1 for right. A left turn retains the inside of the curve, a
    /// right turn the outside. 0 replaces the curve by its chord.
    pub turn: R,
}

impl PaperCurve<f64> {
    /// Converts a curve to the numbers that [`Self::keeps`] needs.
    pub fn new(curve: &Curve) -> Self {
        let turn = if curve.is_chord() { 0.0 } else { 1f64.copysign(curve.turn()) };
        Self { p1: curve.p1, p2: curve.p2, p3: curve.p3, w: curve.w, turn }
    }
}

impl<R: Real> PaperCurve<R> {
    /// True where the curve retains the point q = (u, v); outside the control triangle the chord decides.
    ///
    /// The line through q and the chord's middle M = (P1 + P3)/2 meets the curve at a parameter t. C12 eq. 7 solves
    /// b(1−t)² + 2w·d2·(P2−q)·t(1−t) + d2·(P3−q)·t² = 0, where d2 is perpendicular to M − q and b = d2·(P1−q). The
    /// denominator c of its solution may be zero. Because the line passes through M, d2·(P3−q) = −b. In r = t/(1−t) the
    /// roots' product is therefore −1, so that exactly one root is on the curve. Its t : (1−t) needs neither c nor a
    /// difference that cancels. The point q is outside the lens if the curve's point is between q and M (eq. 6), not
    /// behind q.
    #[inline(always)]
    pub fn keeps(&self, q: V2<R>) -> R::Mask {
        let zero = q.x.zero();
        let area = |a: V2<R>, b: V2<R>| (a - q).cross(b - q);
        let (a1, a2, a3) = (area(self.p2, self.p3), area(self.p3, self.p1), area(self.p1, self.p2));
        let within = |a: R| zero.le(a * self.turn);
        let straight = self.turn.abs().lt(zero.one());
        let in_triangle = within(a1) & within(a2) & within(a3) & !straight;

        let d = (self.p1 + self.p3) * q.x.constant(0.5) - q;
        let d2 = V2::new(d.y, -d.x);
        let b = d2.dot(self.p1 - q);
        let pull = d2.dot(self.p2 - q) * self.w;
        let root = R::sum_of_products(b, b, pull, pull).sqrt();
        let pull = R::select(b.lt(zero), -pull, pull);
        let (large, small) = (pull.abs() + root, b.abs());
        let forward = zero.le(pull);
        let (t, s) = (R::select(forward, large, small), R::select(forward, small, large));
        let weight = (t + t) * s * self.w;
        let along = (s * s).mul_add((self.p1 - q).dot(d), (t * t) * (self.p3 - q).dot(d));
        let external = zero.lt(weight.mul_add((self.p2 - q).dot(d), along));
        let keeps_inside = zero.lt(self.turn);
        let lens_kept = (keeps_inside & !external) | (!keeps_inside & external);
        // Outside the triangle, the part right of P1→P3 is removed; P1 = P3 removes nothing.
        (in_triangle & lens_kept) | (!in_triangle & a2.le(zero))
    }
}
