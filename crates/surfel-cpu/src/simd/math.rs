//! Vectors and matrices in SIMD lanes.

use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::Simd;
use glam::{Mat3, Vec3};
use surfel_math::{Real, V3};

#[inline(always)]
pub(crate) fn transform<S: Simd>(m: &Mat3, v: V3<Lanes<S>>) -> V3<Lanes<S>> {
    V3::new(
        row([m.x_axis.x, m.y_axis.x, m.z_axis.x], v),
        row([m.x_axis.y, m.y_axis.y, m.z_axis.y], v),
        row([m.x_axis.z, m.y_axis.z, m.z_axis.z], v),
    )
}

/// Returns the product of a matrix's row with a vector. A function, since a closure isn't inlined into SIMD code.
#[inline(always)]
fn row<S: Simd>([a, b, c]: [f32; 3], v: V3<Lanes<S>>) -> Lanes<S> {
    let simd = v.x.0.simd;
    let inner = Lanes::splat(simd, b).mul_add(v.y, Lanes::splat(simd, c) * v.z);
    Lanes::splat(simd, a).mul_add(v.x, inner)
}

/// Scales vectors to unit length; no vector may be zero.
#[inline(always)]
pub(crate) fn unit<R: Real>(v: V3<R>) -> V3<R> {
    let v = v * v.max_abs().scale_to_one();
    v * v.dot(v).inverse_sqrt()
}

/// Computes [`surfel_math::basis::orthonormal`] for unit normals in lanes: a pair (s, t) perpendicular to each normal.
#[inline(always)]
pub(crate) fn orthonormal<R: Real>(n: V3<R>) -> (V3<R>, V3<R>) {
    let (zero, one) = (n.x.zero(), n.x.one());
    let sign = R::select(n.z.lt(zero), -one, one);
    let a = -(one / (sign + n.z));
    let b = n.x * n.y * a;
    (
        V3::new((sign * n.x * n.x).mul_add(a, one), sign * b, -(sign * n.x)),
        V3::new(b, (n.y * n.y).mul_add(a, sign), -n.y),
    )
}

/// Returns the vector `v` in all lanes.
#[inline(always)]
pub(crate) fn vector<S: Simd>(simd: S, v: Vec3) -> V3<Lanes<S>> {
    V3::new(Lanes::splat(simd, v.x), Lanes::splat(simd, v.y), Lanes::splat(simd, v.z))
}

/// Scales vectors to unit length; zero vectors remain zero.
#[inline(always)]
pub(crate) fn unit_or_zero<S: Simd>(v: V3<Lanes<S>>) -> V3<Lanes<S>> {
    // The vector is divided by its largest coordinate first, so that its square neither overflows nor vanishes.
    let largest = v.max_abs();
    let there = v.x.zero().lt(largest);
    let one = v.x.one();
    let v = v * (one / Lanes::select(there, largest, one));
    v * Lanes::select(there, v.dot(v), one).inverse_sqrt()
}

/// Conversion of a mask of lanes to a word with one bit per lane.
pub(crate) trait Bits {
    fn bits(self) -> u64;
}

impl<S: Simd> Bits for fearless_simd::mask32x16<S> {
    #[inline(always)]
    fn bits(self) -> u64 {
        fearless_simd::prelude::SimdMask::to_bitmask(self)
    }
}

/// Returns the largest lane; no lane may be NaN.
#[inline(always)]
pub(crate) fn largest<S: Simd>(v: Lanes<S>) -> f32 {
    let mut lanes = v.to_array();
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            lanes[i] = if lanes[i] > lanes[i + half] { lanes[i] } else { lanes[i + half] };
        }
        half /= 2;
    }
    lanes[0]
}
