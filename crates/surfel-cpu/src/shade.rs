//! Dividing a block's sums, and what a surface looks like (§5), sixteen pixels of a block at a time.

use crate::lane_math::transform;
use crate::lanes::Lanes;
use crate::light::{Lighting, phong};
use crate::raster::Sums;
use crate::sight::{Place, vector};
use fearless_simd::{Simd, mask32x16};
use surfel_math::depth::plane_gradient;
use surfel_math::projection::ProjectionKind;
use surfel_math::{Real, V2, V3, toon};
use surfel_model::Shader;

/// What a pixel shows before it is lit.
#[derive(Clone, Copy)]
pub(crate) struct Surface<S: Simd> {
    /// Where there is one; elsewhere numbers are finite and mean nothing.
    pub covered: mask32x16<S>,
    pub albedo: V3<Lanes<S>>,
    /// Unit world normal, or zero.
    pub normal: V3<Lanes<S>>,
    pub z: Lanes<S>,
    /// Ambient, diffuse, specular, shininess.
    pub material: [Lanes<S>; 4],
    pub weight: Lanes<S>,
}

/// A surface that is lit.
#[derive(Clone, Copy)]
pub(crate) struct Shaded<S: Simd> {
    pub covered: mask32x16<S>,
    /// Means nothing where nothing is covered, as do depth and normal.
    pub color: V3<Lanes<S>>,
    pub z: Lanes<S>,
    pub normal: V3<Lanes<S>>,
    pub weight: Lanes<S>,
}

/// Finished pixels of a block.
pub(crate) struct Pixels<S: Simd> {
    /// Linear, premultiplied.
    pub color: [Lanes<S>; 4],
    pub depth: Lanes<S>,
    pub normal: [Lanes<S>; 3],
    pub weight: Lanes<S>,
    pub fragments: Lanes<S>,
}

/// Σw below this has lost its attributes to underflow: the pixel is empty. Only splats smaller than 1e-14 pixels
/// (by c = 2; 1e-7 by the greatest cutoff) weigh less.
const LEAST_WEIGHT: f32 = 1e-36;

/// Divides and lights the block whose first pixel is (x, y).
#[inline(always)]
pub(crate) fn resolve<S: Simd>(simd: S, lighting: &Lighting, sums: &Sums<S>, at: (i32, i32)) -> Pixels<S> {
    lit(simd, lighting, divided(simd, lighting, sums), at).over_background(simd, lighting, sums.fragments)
}

/// Lights what the pixels of a block show.
#[inline(always)]
pub(crate) fn lit<S: Simd>(simd: S, lighting: &Lighting, surface: Surface<S>, at: (i32, i32)) -> Shaded<S> {
    let zero = Lanes::splat(simd, 0.0);
    let mut color = V3::new(zero, zero, zero);
    if lighting.planes.color {
        color = shaded(simd, lighting, &surface, Place::Block(at));
    }
    let Surface { covered, normal, z, weight, .. } = surface;
    Shaded { covered, color, z, normal, weight }
}

/// Divides a block's sums by Σw.
#[inline(always)]
pub(crate) fn divided<S: Simd>(simd: S, lighting: &Lighting, sums: &Sums<S>) -> Surface<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let (zero, one) = (k(0.0), k(1.0));
    let attributes = &lighting.attributes;
    let covered = k(LEAST_WEIGHT).le(sums.weight);
    // Not by Σw, which need not be known to a unit vector.
    let scale = sums.weight.scale_to_one();
    let normal = if attributes.normal { unit_or_zero(scaled3(sums.normal, scale)) } else { V3::new(zero, zero, zero) };
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

/// The colour that the plan's shader gives a surface.
#[inline(always)]
pub(crate) fn shaded<S: Simd>(simd: S, lighting: &Lighting, surface: &Surface<S>, place: Place<S>) -> V3<Lanes<S>> {
    let k = |v: f32| Lanes::splat(simd, v);
    let (zero, one) = (k(0.0), k(1.0));
    let Surface { covered, normal, z, .. } = *surface;
    match lighting.shader {
        // Eye-dome lighting follows where neighbours are known.
        Shader::Unlit | Shader::Edl => surface.albedo,
        Shader::Matcap => match &lighting.ball {
            Some(ball) => {
                let down = vector(simd, lighting.rays.world_from_view.y_axis);
                let to_eye = lighting.rays.sight(simd, place).to_eye();
                let c = ball.color(simd, covered, [normal, to_eye, down]);
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
    }
}

impl<S: Simd> Shaded<S> {
    /// No surface anywhere.
    #[inline(always)]
    pub(crate) fn nothing(simd: S) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        let none = V3::new(zero, zero, zero);
        Self { covered: zero.lt(zero), color: none, z: zero, normal: none, weight: zero }
    }

    /// The surface, or the background where there is none.
    #[inline(always)]
    pub(crate) fn over_background(&self, simd: S, lighting: &Lighting, fragments: Lanes<S>) -> Pixels<S> {
        let k = |v: f32| Lanes::splat(simd, v);
        let (zero, covered) = (k(0.0), self.covered);
        let mut color = [zero; 4];
        if lighting.planes.color {
            let [r, g, b, a] = lighting.background;
            let over = |c: Lanes<S>, background: f32| Lanes::select(covered, c, k(background));
            let lit = self.color;
            color = [over(lit.x, r), over(lit.y, g), over(lit.z, b), over(k(1.0), a)];
        }
        Pixels {
            color,
            depth: Lanes::select(covered, self.z, k(f32::INFINITY)),
            normal: [
                Lanes::select(covered, self.normal.x, zero),
                Lanes::select(covered, self.normal.y, zero),
                Lanes::select(covered, self.normal.z, zero),
            ],
            weight: Lanes::select(covered, self.weight, zero),
            fragments,
        }
    }

    /// This surface, or another where there is none.
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

    /// This surface over another by a share, where there is another: colour, Z and normal alike (§6).
    #[inline(always)]
    pub(crate) fn blended_over(&self, behind: &Self, share: Lanes<S>) -> Self {
        let one = share.one();
        // Where there is nothing to blend, a surface stands alone.
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
            normal: V3::select(self.covered & behind.covered, unit_or_zero([normal.x, normal.y, normal.z]), normal),
            weight: Lanes::select(self.covered, self.weight, one.zero()),
        }
    }
}

#[inline(always)]
fn scaled3<S: Simd>([x, y, z]: [Lanes<S>; 3], by: Lanes<S>) -> [Lanes<S>; 3] {
    [x * by, y * by, z * by]
}

#[inline(always)]
fn unit_or_zero<S: Simd>([x, y, z]: [Lanes<S>; 3]) -> V3<Lanes<S>> {
    let square = x.mul_add(x, y.mul_add(y, z * z));
    // Of smaller squares the root is some finite number.
    let there = x.constant(1e-30).lt(square);
    let inverse = Lanes::select(there, square.inverse_sqrt(), x.zero());
    V3::new(x * inverse, y * inverse, z * inverse)
}

/// How deep a block's neighbours may be before a line is drawn (§5, `toon`).
#[inline(always)]
pub(crate) fn line_limit<S: Simd>(simd: S, lighting: &Lighting, surface: &Shaded<S>, at: (i32, i32)) -> Lanes<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let projection = lighting.projection();
    let (sx, sy) = lighting.rays.slopes(simd, at);
    let z = Lanes::select(surface.covered, surface.z, k(1.0));
    let at = if projection.is_perspective() { V3::new(sx * z, sy * z, z) } else { V3::new(sx, sy, z) };
    let n = transform(&lighting.view_from_world(), surface.normal);
    let there = k(0.0).lt(surface.normal.dot(surface.normal));
    let none = V2::new(k(0.0), k(0.0));
    toon::step_back_limit(z, V2::select(there, plane_gradient(at, n, projection), none), projection)
}
