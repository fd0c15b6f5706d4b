//! Surfaces in pixels, before and after lighting.
//!
//! A *lane* is one of the 16 numbers that SIMD instructions compute at once.

use crate::simd::lanes::Lanes;
use crate::tiles::target::Pixels;
use fearless_simd::{Simd, mask32x16};
use surfel_math::srgb::limit_color;
use surfel_math::{Real, V3};

/// The surfaces of sixteen pixels before lighting.
#[derive(Clone, Copy)]
pub(crate) struct Surface<S: Simd> {
    /// Mask of the pixels that have a surface. In other lanes, numbers are finite but meaningless.
    pub covered: mask32x16<S>,
    pub albedo: V3<Lanes<S>>,
    /// Unit shading normal in world space, or zero if the normals cancel or aren't needed.
    pub normal: V3<Lanes<S>>,
    pub z: Lanes<S>,
    /// Ambient, diffuse, specular and shininess factors of the surface's material.
    pub material: [Lanes<S>; 4],
    pub weight: Lanes<S>,
}

/// The surfaces of sixteen pixels after lighting.
#[derive(Clone, Copy)]
pub(crate) struct Shaded<S: Simd> {
    pub covered: mask32x16<S>,
    /// Lit colour, linear. Colour, depth and normal are meaningless in lanes that aren't covered.
    pub color: V3<Lanes<S>>,
    pub z: Lanes<S>,
    pub normal: V3<Lanes<S>>,
    pub weight: Lanes<S>,
}

impl<S: Simd> Shaded<S> {
    /// Returns surfaces of which no lane is covered.
    #[inline(always)]
    pub(crate) fn nothing(simd: S) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        let none = V3::new(zero, zero, zero);
        Self { covered: zero.lt(zero), color: none, z: zero, normal: none, weight: zero }
    }

    /// Returns the surfaces' depths; +∞ in lanes without a surface.
    #[inline(always)]
    pub(crate) fn depth_or_infinite(&self) -> Lanes<S> {
        Lanes::select(self.covered, self.z, self.z.constant(f64::INFINITY))
    }

    /// Returns finished pixels: the surfaces, or the background where there are none. `background` is linear and
    /// premultiplied; if it is `None`, no colour is needed, and all colours are 0.
    #[inline(always)]
    pub(crate) fn over_background(&self, simd: S, background: Option<[f32; 4]>, fragments: Lanes<S>) -> Pixels<S> {
        let k = |v: f32| Lanes::splat(simd, v);
        let (zero, covered) = (k(0.0), self.covered);
        let mut color = [zero; 4];
        if let Some([r, g, b, a]) = background {
            let over = |c: Lanes<S>, background: f32| Lanes::select(covered, c, k(background));
            let lit = self.color;
            color = [over(lit.x, r), over(lit.y, g), over(lit.z, b), over(k(1.0), a)];
        }
        let normal = V3::select(covered, self.normal, V3::new(zero, zero, zero));
        Pixels {
            color,
            depth: Lanes::select(covered, self.z, k(f32::INFINITY)),
            normal: [normal.x, normal.y, normal.z],
            weight: Lanes::select(covered, self.weight, zero),
            fragments,
        }
    }

    /// Returns this surface, with `other` in the lanes that this surface doesn't cover.
    #[inline(always)]
    pub(crate) fn or(&self, other: &Self) -> Self {
        let (mask, pick) = (self.covered, |a: V3<Lanes<S>>, b: V3<Lanes<S>>| V3::select(self.covered, a, b));
        Self {
            covered: mask | other.covered,
            color: pick(self.color, other.color),
            z: Lanes::select(mask, self.z, other.z),
            normal: pick(self.normal, other.normal),
            weight: Lanes::select(mask, self.weight, other.weight),
        }
    }

    /// Blends this surface over the surface `behind` it, where there is one, with weight `share`. Colour, depth and
    /// normal are blended alike (rendering model §6).
    #[inline(always)]
    pub(crate) fn blended_over(&self, behind: &Self, share: Lanes<S>) -> Self {
        let one = share.one();
        // A surface with nothing behind it counts fully.
        let share = Lanes::select(self.covered, share, one.zero());
        let share = Lanes::select(behind.covered, share, one);
        let rest = one - share;
        let mix = |a: Lanes<S>, b: Lanes<S>| {
            let mixed = a.mul_add(share, b * rest);
            Lanes::select(self.covered, Lanes::select(behind.covered, mixed, a), b)
        };
        let mix3 = |a: V3<Lanes<S>>, b: V3<Lanes<S>>| V3::new(mix(a.x, b.x), mix(a.y, b.y), mix(a.z, b.z));
        let normal = mix3(self.normal, behind.normal);
        Self {
            covered: self.covered | behind.covered,
            color: mix3(self.color, behind.color),
            z: mix(self.z, behind.z),
            normal: V3::select(
                self.covered & behind.covered,
                direction_or_zero([normal.x, normal.y, normal.z]),
                normal,
            ),
            weight: Lanes::select(self.covered, self.weight, one.zero()),
        }
    }
}

/// Limits a colour to the range of colours (rendering model §10), so that blending never overflows.
#[inline(always)]
pub(crate) fn limited<S: Simd>(color: V3<Lanes<S>>) -> V3<Lanes<S>> {
    V3::new(limit_color(color.x), limit_color(color.y), limit_color(color.z))
}

#[inline(always)]
pub(crate) fn direction_or_zero<S: Simd>([x, y, z]: [Lanes<S>; 3]) -> V3<Lanes<S>> {
    let square = x.mul_add(x, y.mul_add(y, z * z));
    // The inverse root of smaller squares is a meaningless finite number.
    let there = x.constant(1e-30).lt(square);
    let inverse = Lanes::select(there, square.inverse_sqrt(), x.zero());
    V3::new(x * inverse, y * inverse, z * inverse)
}
