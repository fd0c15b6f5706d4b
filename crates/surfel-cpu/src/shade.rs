//! Dividing and lighting a block (§5), sixteen pixels of a block at a time.

use crate::lane_math::transform;
use crate::lanes::{LANES, Lanes};
use crate::raster::Sums;
use fearless_simd::Simd;
use glam::{DVec3, Mat3, Vec3};
use surfel_math::projection::ProjectionKind;
use surfel_math::{Real, V3};
use surfel_model::{Light, Shader};
use surfel_render::{FramePlan, Planes, View};

/// A light as the shader reads it: positions relative to the eye, so that nothing is lost far from the origin.
pub(crate) enum FrameLight {
    Directional { to_light: Vec3, color: Vec3 },
    Point { position: Vec3, color: Vec3 },
    Spot { position: Vec3, direction: Vec3, color: Vec3, inner: f64, outer: f64 },
}

/// Everything that lights a frame.
pub(crate) struct Lighting {
    pub shader: Shader,
    pub planes: Planes,
    pub wants_color: bool,
    pub wants_material: bool,
    pub lights: Vec<FrameLight>,
    pub ambient: Vec3,
    /// Ambient, diffuse, specular, shininess where all objects share them.
    pub material: [f32; 4],
    /// See [`whole_power`], where all objects share the exponent.
    whole_shininess: Option<(u32, f32)>,
    /// Linear, premultiplied.
    pub background: [f32; 4],
    world_from_view: Mat3,
    forward: Vec3,
    view: View,
}

impl Lighting {
    pub(crate) fn new(
        plan: &FramePlan,
        view: &View,
        lights: &[Light],
        ambient: [f64; 3],
        material: [f64; 4],
        background: [f64; 4],
    ) -> Self {
        let unit = |v: &[f64; 3]| surfel_math::basis::unit(DVec3::from(*v)).as_vec3();
        let relative = |p: &[f64; 3]| (DVec3::from(*p) - view.eye).as_vec3();
        let color = |c: &[f64; 3]| DVec3::from(*c).as_vec3();
        let lights = lights.iter().map(|light| match light {
            Light::Directional { direction, color: c, .. } => {
                FrameLight::Directional { to_light: -unit(direction), color: color(c) }
            }
            Light::Point { position, color: c } => FrameLight::Point { position: relative(position), color: color(c) },
            Light::Spot { position, direction, color: c, inner_deg, outer_deg, .. } => FrameLight::Spot {
                position: relative(position),
                direction: unit(direction),
                color: color(c),
                inner: *inner_deg,
                outer: *outer_deg,
            },
        });
        Self {
            shader: plan.shader,
            planes: plan.planes,
            wants_color: plan.attributes.color,
            wants_material: plan.attributes.material,
            lights: lights.collect(),
            ambient: DVec3::from(ambient).as_vec3(),
            material: material.map(|m| m as f32),
            whole_shininess: whole_power(material[3]).filter(|_| !plan.attributes.material),
            background: background.map(|c| c as f32),
            world_from_view: view.view_from_world.transpose().as_mat3(),
            forward: view.forward().as_vec3(),
            view: view.clone(),
        }
    }
}

/// An exponent that a few multiplications serve better than a logarithm, and the base whose power is still a normal
/// number: smaller ones would make the processor stop for every product that isn't. 256 roundings are 1.5e-5 of a highlight.
fn whole_power(exponent: f64) -> Option<(u32, f32)> {
    let suits = (1.0..=256.0).contains(&exponent) && exponent.fract() == 0.0;
    suits.then(|| (exponent as u32, 1e-36f64.powf(1.0 / exponent) as f32))
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

/// Σw below this has lost its attributes to underflow: the pixel is empty. Only splats smaller than 1e-18 pixels weigh less.
const LEAST_WEIGHT: f32 = 1e-36;

/// Divides and lights the block whose first pixel is (x, y).
#[inline(always)]
pub(crate) fn resolve<S: Simd>(simd: S, lighting: &Lighting, sums: &Sums<S>, (x, y): (i32, i32)) -> Pixels<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let (zero, one) = (k(0.0), k(1.0));
    let planes = &lighting.planes;
    let covered = k(LEAST_WEIGHT).le(sums.weight);
    let inverse = one / Lanes::select(covered, sums.weight, one);
    let needs_normal = planes.normal || matches!(lighting.shader, Shader::Phong | Shader::Normal);
    let normal = if needs_normal { unit_or_zero(scaled3(sums.normal, inverse)) } else { V3::new(zero, zero, zero) };
    let needs_depth = planes.depth || matches!(lighting.shader, Shader::Phong | Shader::Depth);
    let z = if needs_depth { sums.depth * inverse } else { zero };
    let mut color = [zero; 4];
    if planes.color {
        let albedo = if lighting.wants_color {
            let [r, g, b] = scaled3(sums.color, inverse);
            V3::new(r, g, b)
        } else {
            V3::new(one, one, one)
        };
        let lit = match lighting.shader {
            Shader::Unlit | Shader::Toon => albedo,
            Shader::Normal => {
                let half = k(0.5);
                let there = zero.lt(normal.dot(normal));
                let c = |n: Lanes<S>| Lanes::select(there, n.mul_add(half, half), zero);
                V3::new(c(normal.x), c(normal.y), c(normal.z))
            }
            Shader::Depth => {
                let near = k(lighting.view.projection.near as f32);
                let d = match lighting.view.projection.kind {
                    ProjectionKind::Perspective => near / Lanes::select(covered, z, one),
                    ProjectionKind::Orthographic { far, .. } => {
                        one - (z - near) * k((1.0 / (far - lighting.view.projection.near)) as f32)
                    }
                };
                V3::new(d, d, d)
            }
            Shader::Phong => {
                let m = &lighting.material;
                let material = if lighting.wants_material {
                    let [a, d, s, n] = sums.material;
                    [a * inverse, d * inverse, s * inverse, n * inverse]
                } else {
                    [k(m[0]), k(m[1]), k(m[2]), k(m[3])]
                };
                let at = (Lanes::block_columns(simd) + k(x as f32), Lanes::block_rows(simd) + k(y as f32));
                phong(simd, lighting, albedo, normal, z, at, material)
            }
        };
        let [r, g, b, a] = lighting.background;
        let over = |c: Lanes<S>, background: f32| Lanes::select(covered, c, k(background));
        color = [over(lit.x, r), over(lit.y, g), over(lit.z, b), over(one, a)];
    }
    Pixels {
        color,
        depth: Lanes::select(covered, z, k(f32::INFINITY)),
        normal: [
            Lanes::select(covered, normal.x, zero),
            Lanes::select(covered, normal.y, zero),
            Lanes::select(covered, normal.z, zero),
        ],
        weight: Lanes::select(covered, sums.weight, zero),
        fragments: sums.fragments,
    }
}

#[inline(always)]
fn scaled3<S: Simd>([x, y, z]: [Lanes<S>; 3], by: Lanes<S>) -> [Lanes<S>; 3] {
    [x * by, y * by, z * by]
}

#[inline(always)]
fn unit_or_zero<S: Simd>([x, y, z]: [Lanes<S>; 3]) -> V3<Lanes<S>> {
    let square = x.mul_add(x, y.mul_add(y, z * z));
    let (zero, one) = (x.zero(), x.one());
    let there = x.constant(1e-30).lt(square);
    let inverse = Lanes::select(there, Lanes::select(there, square, one).inverse_sqrt(), zero);
    V3::new(x * inverse, y * inverse, z * inverse)
}

#[inline(always)]
fn phong<S: Simd>(
    simd: S,
    lighting: &Lighting,
    albedo: V3<Lanes<S>>,
    normal: V3<Lanes<S>>,
    z: Lanes<S>,
    (x, y): (Lanes<S>, Lanes<S>),
    [ambient, diffuse, specular, shininess]: [Lanes<S>; 4],
) -> V3<Lanes<S>> {
    let k = |v: f32| Lanes::splat(simd, v);
    let zero = k(0.0);
    let (position, to_eye) = position(simd, lighting, z, (x, y));
    let mut matte = vector(simd, lighting.ambient) * ambient;
    let mut gloss = V3::new(zero, zero, zero);
    for light in &lighting.lights {
        let (to_light, color) = match light {
            FrameLight::Directional { to_light, color } => (vector(simd, *to_light), vector(simd, *color)),
            FrameLight::Point { position: at, color } => (unit(vector(simd, *at) - position), vector(simd, *color)),
            FrameLight::Spot { position: at, direction, color, inner, outer } => {
                let to_light = unit(vector(simd, *at) - position);
                let strength = spot(simd, to_light, *direction, *inner, *outer);
                (to_light, vector(simd, *color) * strength)
            }
        };
        let cosine = normal.dot(to_light);
        let lit = zero.lt(cosine);
        matte = matte + color * (diffuse * cosine.max(zero));
        if lighting.wants_material || lighting.material[2] != 0.0 {
            let reflected = normal * (cosine + cosine) - to_light;
            let mirrored = reflected.dot(to_eye).max(zero).min(k(1.0));
            let highlight = match lighting.whole_shininess {
                Some((n, least)) => mirrored.max(k(least)).whole_power(n),
                None => mirrored.power(shininess),
            };
            gloss = gloss + color * Lanes::select(lit, specular * highlight, zero);
        }
    }
    V3::new(albedo.x.mul_add(matte.x, gloss.x), albedo.y.mul_add(matte.y, gloss.y), albedo.z.mul_add(matte.z, gloss.z))
}

/// World position relative to the eye, and the unit vector to the eye.
#[inline(always)]
fn position<S: Simd>(
    simd: S,
    lighting: &Lighting,
    z: Lanes<S>,
    (x, y): (Lanes<S>, Lanes<S>),
) -> (V3<Lanes<S>>, V3<Lanes<S>>) {
    let k = |v: f32| Lanes::splat(simd, v);
    let p = &lighting.view.projection;
    let (sx, sy) = (slope(x, p.focal_px[0], p.principal_px[0]), slope(y, p.focal_px[1], p.principal_px[1]));
    let m = &lighting.world_from_view;
    match p.kind {
        ProjectionKind::Perspective => {
            let ray = transform(m, V3::new(sx, sy, k(1.0)));
            (ray * z, -ray * ray.dot(ray).inverse_sqrt())
        }
        ProjectionKind::Orthographic { .. } => {
            let f = -lighting.forward;
            (transform(m, V3::new(sx, sy, z)), V3::new(k(f.x), k(f.y), k(f.z)))
        }
    }
}

/// A ray's slope along one axis, from whole pixel numbers, so that it doesn't depend on where a run of pixels starts.
#[inline(always)]
fn slope<S: Simd>(pixel: Lanes<S>, focal_px: f64, principal_px: f64) -> Lanes<S> {
    pixel.mul_add(pixel.constant(1.0 / focal_px), pixel.constant((0.5 - principal_px) / focal_px))
}

#[inline(always)]
fn vector<S: Simd>(simd: S, v: Vec3) -> V3<Lanes<S>> {
    V3::new(Lanes::splat(simd, v.x), Lanes::splat(simd, v.y), Lanes::splat(simd, v.z))
}

#[inline(always)]
fn unit<S: Simd>(v: V3<Lanes<S>>) -> V3<Lanes<S>> {
    // Relative to the largest coordinate: a square neither overflows nor vanishes.
    let largest = v.max_abs();
    let there = v.x.zero().lt(largest);
    let one = v.x.one();
    let v = v * (one / Lanes::select(there, largest, one));
    v * Lanes::select(there, v.dot(v), one).inverse_sqrt()
}

/// Strength of a spot light: smoothstep between its half-angles. The angle needs an arctangent, so it is scalar.
#[cold]
fn spot<S: Simd>(simd: S, to_light: V3<Lanes<S>>, direction: Vec3, inner: f64, outer: f64) -> Lanes<S> {
    let (x, y, z) = (to_light.x.to_array(), to_light.y.to_array(), to_light.z.to_array());
    let strength: [f32; LANES] = std::array::from_fn(|i| {
        let ray = -DVec3::new(x[i].into(), y[i].into(), z[i].into());
        let axis = direction.as_dvec3();
        let angle = (2.0 * (ray - axis).length().atan2((ray + axis).length())).to_degrees();
        let t = if angle <= inner {
            1.0
        } else if angle >= outer {
            0.0
        } else {
            (outer - angle) / (outer - inner)
        };
        (t * t * (3.0 - 2.0 * t)) as f32
    });
    Lanes::load(simd, &strength)
}
