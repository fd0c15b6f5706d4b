//! Division of a block's weighted sums, and lighting of the results (rendering model §5), sixteen pixels at a time.
//!
//! A *block* is 4×4 pixels ([`BLOCK`](crate::tiles::grid::BLOCK)).

use crate::raster::sums::Sums;
use crate::shade::lighting::{Lighting, phong};
use crate::shade::surface::{Shaded, Surface, direction_or_zero, limited};
use crate::shade::view_ray::Place;
use crate::simd::lanes::Lanes;
use crate::simd::math::{transform, vector};
use crate::tiles::target::Pixels;
use fearless_simd::Simd;
use surfel_math::depth::plane_gradient;
use surfel_math::projection::ProjectionKind;
use surfel_math::{Real, V2, V3, toon};
use surfel_model::Shader;

/// Divides a block's weighted sums by the sums of weights, lights the results, and puts them over the background. `at`
/// is the block's first pixel.
#[inline(always)]
pub(crate) fn resolve<S: Simd>(simd: S, lighting: &Lighting, sums: &Sums<S>, at: (i32, i32)) -> Pixels<S> {
    lit(simd, lighting, divided(simd, lighting, sums), at).over_background(
        simd,
        lighting.background_color(),
        sums.fragments,
    )
}

/// Lights the surfaces of the block whose first pixel is `at`.
#[inline(always)]
pub(crate) fn lit<S: Simd>(simd: S, lighting: &Lighting, surface: Surface<S>, at: (i32, i32)) -> Shaded<S> {
    let zero = Lanes::splat(simd, 0.0);
    let mut color = V3::new(zero, zero, zero);
    if lighting.planes.shows_color() {
        color = shaded(simd, lighting, &surface, Place::Block(at));
    }
    let Surface { covered, normal, z, weight, .. } = surface;
    Shaded { covered, color, z, normal, weight }
}

/// Divides a block's weighted sums by the sums of weights, Σw, and returns the surfaces.
#[inline(always)]
pub(crate) fn divided<S: Simd>(simd: S, lighting: &Lighting, sums: &Sums<S>) -> Surface<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let (zero, one) = (k(0.0), k(1.0));
    let attributes = &lighting.attributes;
    let covered = sums.has_weight();
    // A power of two instead of Σw: the normal's length doesn't matter, since it is normalised.
    let scale = sums.weight.scale_to_one();
    let normal =
        if attributes.normal { direction_or_zero(scaled3(sums.normal, scale)) } else { V3::new(zero, zero, zero) };
    let divides = attributes.color | attributes.depth | attributes.material;
    let inverse = if divides { one / Lanes::select(covered, sums.weight, one) } else { one };
    let z = if attributes.depth { sums.depth * inverse } else { zero };
    let albedo = if attributes.color {
        let [r, g, b] = scaled3(sums.color, inverse);
        V3::new(r, g, b)
    } else {
        V3::new(one, one, one)
    };
    let m = &lighting.material;
    let material = if attributes.material {
        let [a, d, s, n] = sums.material;
        [a * inverse, d * inverse, s * inverse, n * inverse]
    } else {
        [k(m[0]), k(m[1]), k(m[2]), k(m[3])]
    };
    Surface { covered, albedo, normal, z, material, weight: sums.weight }
}

/// Returns the colours of surfaces at `place` by the plan's shader.
#[inline(always)]
pub(crate) fn shaded<S: Simd>(simd: S, lighting: &Lighting, surface: &Surface<S>, place: Place<S>) -> V3<Lanes<S>> {
    let k = |v: f32| Lanes::splat(simd, v);
    let (zero, one) = (k(0.0), k(1.0));
    // Sums of colours may have overflowed f32, which would yield NaN in what follows.
    let surface = &Surface { albedo: limited(surface.albedo), ..*surface };
    let Surface { covered, normal, z, .. } = *surface;
    limited(match lighting.shader {
        Shader::Matcap => match &lighting.matcap {
            Some(matcap) => {
                let down = vector(simd, lighting.rays.world_from_view.y_axis);
                let to_eye = lighting.rays.view_ray(simd, place).to_eye();
                let c = matcap.color(simd, covered, [normal, to_eye, down]);
                V3::new(surface.albedo.x * c.x, surface.albedo.y * c.y, surface.albedo.z * c.z)
            }
            None => surface.albedo,
        },
        Shader::Normal => {
            let half = k(0.5);
            let there = zero.lt(normal.dot(normal));
            let c = |n: Lanes<S>| Lanes::select(there, n.mul_add(half, half), zero);
            V3::new(c(normal.x), c(normal.y), c(normal.z))
        }
        Shader::Depth => {
            let near = k(lighting.near());
            let d = match lighting.projection().kind {
                ProjectionKind::Perspective => near / Lanes::select(covered, z, one),
                ProjectionKind::Orthographic { far, .. } => {
                    one - (z - near) * k((1.0 / (far - lighting.projection().near)) as f32)
                }
            };
            V3::new(d, d, d)
        }
        Shader::Phong => phong::<S, false>(simd, lighting, surface, place),
        Shader::Toon => phong::<S, true>(simd, lighting, surface, place),
        // `Shader::Unlit`, and `Shader::Edl`, which is applied later, when neighbours are known.
        _ => surface.albedo,
    })
}

#[inline(always)]
fn scaled3<S: Simd>([x, y, z]: [Lanes<S>; 3], by: Lanes<S>) -> [Lanes<S>; 3] {
    [x * by, y * by, z * by]
}

/// Returns, for each pixel of a block, the largest depth that a neighbour may have without an outline (rendering model
/// §5, `toon`).
#[inline(always)]
pub(crate) fn outline_limit<S: Simd>(simd: S, lighting: &Lighting, surface: &Shaded<S>, at: (i32, i32)) -> Lanes<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let projection = lighting.projection();
    let (sx, sy) = lighting.rays.slopes(simd, at);
    let z = Lanes::select(surface.covered, surface.z, k(1.0));
    let at = if projection.is_perspective() { V3::new(sx * z, sy * z, z) } else { V3::new(sx, sy, z) };
    let n = transform(&lighting.view_from_world(), surface.normal);
    let there = k(0.0).lt(surface.normal.dot(surface.normal));
    let none = V2::new(k(0.0), k(0.0));
    let gradient = plane_gradient(at, n, projection) * k(lighting.pixel_px as f32);
    toon::step_back_limit(z, V2::select(there, gradient, none), projection)
}
