//! Shadow maps (rendering model §5), which determine the fraction of a light that reaches a point.

use crate::simd::lanes::{LANES, Lanes};
use crate::simd::math::transform;
use fearless_simd::prelude::{SimdFloat, SimdMask};
use fearless_simd::{Simd, mask32x16};
use glam::{Mat3, Vec3};
use surfel_math::depth::plane_gradient;
use surfel_math::projection::Projection;
use surfel_math::shadow::{TAPS, lookup_bias, tap_weights};
use surfel_math::{Real, V2, V3};

/// A drawn shadow map, in which lighting looks up whether points are lit.
pub(crate) struct ShadowMap {
    /// Index in the scene of the light that casts the shadows.
    pub light: usize,
    pub projection: Projection,
    /// Rotation from world axes to the axes of the map's view.
    pub map_from_world: Mat3,
    /// Vector from the eye of the map's view to the eye of the image, in world space.
    pub to_eye: Vec3,
    /// Number of texels along each side of the map.
    pub side: usize,
    /// Depth threshold of each texel, row by row: the largest depth at which a point is lit, apart from the bias of
    /// lookups. +∞ where nothing casts a shadow.
    pub thresholds: Vec<f32>,
}

/// Returns the fraction of a light, whose shadow maps are `maps`, that reaches points. Of several maps, the one along
/// whose axis a point is farthest is used. `position` is relative to the eye, `normal` a unit vector, both in world
/// axes. Only the lanes of `wanted` are meaningful.
#[inline(always)]
pub(crate) fn light_fraction<S: Simd>(
    simd: S,
    maps: &[ShadowMap],
    position: V3<Lanes<S>>,
    normal: V3<Lanes<S>>,
    wanted: mask32x16<S>,
) -> Lanes<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let mut farthest = k(f32::NEG_INFINITY);
    for shadow in maps {
        farthest = farthest.max(shadow.in_map(simd, position).z);
    }
    let mut share = k(1.0);
    for shadow in maps {
        let p = shadow.in_map(simd, position);
        let own = wanted & farthest.le(p.z);
        if own.to_bitmask() != 0 {
            let n = transform(&shadow.map_from_world, normal);
            share = Lanes::select(own, shadow.share(simd, p, n), share);
        }
    }
    share
}

impl ShadowMap {
    /// Returns the heap memory that the map uses, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.thresholds.as_slice())
    }

    /// Converts a position relative to the image's eye to the map's view space.
    #[inline(always)]
    fn in_map<S: Simd>(&self, simd: S, position: V3<Lanes<S>>) -> V3<Lanes<S>> {
        let k = |v: f32| Lanes::splat(simd, v);
        let o = self.to_eye;
        transform(&self.map_from_world, position + V3::new(k(o.x), k(o.y), k(o.z)))
    }

    /// Returns the fraction of the light that reaches points `p` with these normals, both in the map's view space. The
    /// fraction is 1 for points in front of the map's near plane.
    #[inline(never)]
    fn share<S: Simd>(&self, simd: S, p: V3<Lanes<S>>, normal: V3<Lanes<S>>) -> Lanes<S> {
        simd.vectorize(
            #[inline(always)]
            || self.filtered(simd, p, normal),
        )
    }

    #[inline(always)]
    fn filtered<S: Simd>(&self, simd: S, p: V3<Lanes<S>>, normal: V3<Lanes<S>>) -> Lanes<S> {
        let k = |v: f32| Lanes::splat(simd, v);
        let (projection, one) = (&self.projection, k(1.0));
        let before = p.z.lt(k(projection.near as f32));
        let depth = if projection.is_perspective() { Lanes::select(before, one, p.z) } else { one };
        let [fx, fy] = projection.focal_px.map(|f| k(f as f32));
        let [cx, cy] = projection.principal_px.map(|c| k(c as f32));
        let at = V2::new((p.x / depth).mul_add(fx, cx), (p.y / depth).mul_add(fy, cy));
        let gradient = plane_gradient(p, normal, projection);
        let nearer = p.z - lookup_bias(p.z, projection);
        let (columns, rows) = (taps(at.x), taps(at.y));
        let (left, top) = (columns.0.to_array().map(|v| v as i32), rows.0.to_array().map(|v| v as i32));
        let mut share = k(0.0);
        for (j, row_weight) in (0u8..).zip(rows.1) {
            let row_z = (rows.0 + k(f32::from(j) + 0.5) - at.y).mul_add(gradient.y, nearer);
            for (i, column_weight) in (0u8..).zip(columns.1) {
                let mut thresholds = [0.0; LANES];
                for (threshold, (x, y)) in thresholds.iter_mut().zip(left.iter().zip(&top)) {
                    *threshold = self.texel(x.wrapping_add(i.into()), y.wrapping_add(j.into()));
                }
                let z = (columns.0 + k(f32::from(i) + 0.5) - at.x).mul_add(gradient.x, row_z);
                let lit = z.le(Lanes::load(simd, &thresholds));
                share = share + Lanes::select(lit, column_weight * row_weight, k(0.0));
            }
        }
        Lanes::select(before, one, share)
    }

    /// Returns the largest lit depth of the texel in this column and row; +∞ outside the map, where nothing casts a
    /// shadow.
    #[inline(always)]
    fn texel(&self, x: i32, y: i32) -> f32 {
        let (x, y) = (x as u32 as usize, y as u32 as usize);
        if x < self.side && y < self.side { self.thresholds[y * self.side + x] } else { f32::INFINITY }
    }
}

/// Computes [`surfel_math::shadow::taps`] in lanes: the first column (or row) of a lookup, and the weights of its
/// texels.
#[inline(always)]
fn taps<S: Simd>(texel: Lanes<S>) -> (Lanes<S>, [Lanes<S>; TAPS]) {
    let from_center = texel - texel.constant(0.5);
    let whole = Lanes(from_center.0.floor());
    (whole - texel.one(), tap_weights(from_center - whole))
}
