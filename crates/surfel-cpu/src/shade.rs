//! Dividing and lighting a block (§5), sixteen pixels of a block at a time.

use crate::lane_math::transform;
use crate::lanes::Lanes;
use crate::matcap::Ball;
use crate::raster::Sums;
use crate::shadow::{self, Shadow};
use crate::spot;
use fearless_simd::prelude::SimdMask;
use fearless_simd::{Simd, mask32x16};
use glam::{DVec3, Mat3, Vec3};
use std::sync::Arc;
use surfel_math::depth::plane_gradient;
use surfel_math::projection::{Projection, ProjectionKind};
use surfel_math::{Real, V2, V3, toon};
use surfel_model::{Light, Matcap, Shader};
use surfel_render::{Attributes, FramePlan, Planes, View};

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
    pub attributes: Attributes,
    pub lights: Vec<FrameLight>,
    /// Shadow maps of each light.
    pub shadows: Vec<Vec<Shadow>>,
    pub ambient: Vec3,
    /// Ambient, diffuse, specular, shininess where all objects share them.
    pub material: [f32; 4],
    /// See [`whole_power`], where all objects share the exponent.
    whole_shininess: Option<(u32, f32)>,
    /// Linear, premultiplied.
    pub background: [f32; 4],
    /// Where the shader is `matcap`.
    ball: Option<Ball>,
    world_from_view: Mat3,
    forward: Vec3,
    view: View,
}

impl Lighting {
    pub(crate) fn new(
        plan: &FramePlan,
        view: &View,
        lights: &[Light],
        shadows: Vec<Shadow>,
        ambient: [f64; 3],
        material: [f64; 4],
        background: [f64; 4],
    ) -> Self {
        let mut shadows_of_light: Vec<Vec<Shadow>> = lights.iter().map(|_| Vec::new()).collect();
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
        for shadow in shadows {
            if let Some(maps) = shadows_of_light.get_mut(shadow.light) {
                maps.push(shadow);
            }
        }
        Self {
            shader: plan.shader,
            planes: plan.planes,
            attributes: plan.attributes,
            lights: lights.collect(),
            shadows: shadows_of_light,
            ambient: DVec3::from(ambient).as_vec3(),
            material: material.map(|m| m as f32),
            whole_shininess: whole_power(material[3]).filter(|_| !plan.attributes.material),
            background: background.map(|c| c as f32),
            world_from_view: view.view_from_world.transpose().as_mat3(),
            forward: view.forward().as_vec3(),
            view: view.clone(),
            ball: None,
        }
    }

    /// With what the shader `matcap` looks up, if it is the frame's.
    pub(crate) fn with_matcap(self, image: Option<Arc<Matcap>>) -> Self {
        let wanted = self.shader == Shader::Matcap && self.planes.color;
        Self { ball: wanted.then(|| Ball::new(image.unwrap_or_else(Matcap::builtin))), ..self }
    }
}

/// An exponent that a few multiplications serve better than a logarithm, and the base whose power is still a normal
/// number: smaller ones would make the processor stop for every product that isn't. 256 roundings are 1.5e-5 of a highlight.
fn whole_power(exponent: f64) -> Option<(u32, f32)> {
    let suits = (1.0..=256.0).contains(&exponent) && exponent.fract() == 0.0;
    suits.then(|| (exponent as u32, 1e-36f64.powf(1.0 / exponent) as f32))
}

impl Lighting {
    /// World position relative to the eye of a view position.
    pub(crate) fn world_from_view(&self, p: Vec3) -> Vec3 {
        self.world_from_view * p
    }

    /// The view's.
    pub(crate) fn projection(&self) -> &Projection {
        &self.view.projection
    }

    /// z_near.
    pub(crate) fn near(&self) -> f32 {
        self.view.projection.near as f32
    }
}

/// What a pixel shows before it is lit.
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
pub(crate) fn lit<S: Simd>(simd: S, lighting: &Lighting, surface: Surface<S>, (x, y): (i32, i32)) -> Shaded<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let zero = k(0.0);
    let mut color = V3::new(zero, zero, zero);
    if lighting.planes.color {
        let sight = if matches!(lighting.shader, Shader::Phong | Shader::Toon | Shader::Matcap) {
            let at = (Lanes::block_columns(simd) + k(x as f32), Lanes::block_rows(simd) + k(y as f32));
            position(simd, lighting, surface.z, at)
        } else {
            (color, color)
        };
        color = shaded(simd, lighting, &surface, sight);
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
    let inverse = one / Lanes::select(covered, sums.weight, one);
    let normal =
        if attributes.normal { unit_or_zero(scaled3(sums.normal, inverse)) } else { V3::new(zero, zero, zero) };
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

/// The colour that the plan's shader gives a surface, seen at a world position relative to the eye, by the unit vector to the eye.
#[inline(always)]
fn shaded<S: Simd>(
    simd: S,
    lighting: &Lighting,
    surface: &Surface<S>,
    sight: (V3<Lanes<S>>, V3<Lanes<S>>),
) -> V3<Lanes<S>> {
    let k = |v: f32| Lanes::splat(simd, v);
    let (zero, one) = (k(0.0), k(1.0));
    let Surface { covered, normal, z, .. } = *surface;
    match lighting.shader {
        // Eye-dome lighting follows where neighbours are known.
        Shader::Unlit | Shader::Edl => surface.albedo,
        Shader::Matcap => match &lighting.ball {
            Some(ball) => {
                let down = vector(simd, lighting.world_from_view.y_axis);
                let c = ball.color(simd, covered, [normal, sight.1, down]);
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
            let near = k(lighting.view.projection.near as f32);
            let d = match lighting.view.projection.kind {
                ProjectionKind::Perspective => near / Lanes::select(covered, z, one),
                ProjectionKind::Orthographic { far, .. } => {
                    one - (z - near) * k((1.0 / (far - lighting.view.projection.near)) as f32)
                }
            };
            V3::new(d, d, d)
        }
        Shader::Phong => phong(simd, lighting, surface, sight, Style::Smooth),
        Shader::Toon => phong(simd, lighting, surface, sight, Style::Toon),
    }
}

/// Lights a surface at a world position relative to the eye.
#[inline(always)]
pub(crate) fn lit_at<S: Simd>(
    simd: S,
    lighting: &Lighting,
    surface: &Surface<S>,
    position: V3<Lanes<S>>,
) -> V3<Lanes<S>> {
    let k = |v: f32| Lanes::splat(simd, v);
    let to_eye = match lighting.view.projection.kind {
        ProjectionKind::Perspective => -unit(position),
        ProjectionKind::Orthographic { .. } => {
            let f = -lighting.forward;
            V3::new(k(f.x), k(f.y), k(f.z))
        }
    };
    shaded(simd, lighting, surface, (position, to_eye))
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
    let (zero, one) = (x.zero(), x.one());
    let there = x.constant(1e-30).lt(square);
    let inverse = Lanes::select(there, Lanes::select(there, square, one).inverse_sqrt(), zero);
    V3::new(x * inverse, y * inverse, z * inverse)
}

/// How light becomes colour.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Style {
    Smooth,
    Toon,
}

#[inline(always)]
fn phong<S: Simd>(
    simd: S,
    lighting: &Lighting,
    surface: &Surface<S>,
    (position, to_eye): (V3<Lanes<S>>, V3<Lanes<S>>),
    style: Style,
) -> V3<Lanes<S>> {
    let k = |v: f32| Lanes::splat(simd, v);
    let zero = k(0.0);
    let Surface { normal, albedo, .. } = *surface;
    let [ambient, diffuse, specular, shininess] = surface.material;
    let mut matte = vector(simd, lighting.ambient) * ambient;
    let mut gloss = V3::new(zero, zero, zero);
    for (light, maps) in lighting.lights.iter().zip(&lighting.shadows) {
        let (to_light, color) = match light {
            FrameLight::Directional { to_light, color } => (vector(simd, *to_light), vector(simd, *color)),
            FrameLight::Point { position: at, color } => (unit(vector(simd, *at) - position), vector(simd, *color)),
            FrameLight::Spot { position: at, direction, color, inner, outer } => {
                let to_light = unit(vector(simd, *at) - position);
                let strength = spot::strength(simd, to_light, *direction, *inner, *outer);
                (to_light, vector(simd, *color) * strength)
            }
        };
        let cosine = normal.dot(to_light);
        let lit = zero.lt(cosine);
        let light = cosine.max(zero);
        let mask = lit & surface.covered;
        // The share of the light that reaches the surface.
        let share = match maps.is_empty() || mask.to_bitmask() == 0 {
            true => None,
            false => Some(shadow::reaching(simd, maps, position, normal, mask)),
        };
        let light = if let Some(share) = share { light * share } else { light };
        let light = if style == Style::Toon { toon::ramp(light) } else { light };
        matte = matte + color * (diffuse * light);
        if lighting.attributes.material || lighting.material[2] != 0.0 {
            let reflected = normal * (cosine + cosine) - to_light;
            let mirrored = reflected.dot(to_eye).max(zero).min(k(1.0));
            let highlight = match lighting.whole_shininess {
                Some((n, least)) => mirrored.max(k(least)).whole_power(n),
                None => mirrored.power(shininess),
            };
            let highlight = if let Some(share) = share { highlight * share } else { highlight };
            let highlight = if style == Style::Toon { toon::highlight(highlight) } else { highlight };
            gloss = gloss + color * Lanes::select(lit, specular * highlight, zero);
        }
    }
    let c = V3::new(
        albedo.x.mul_add(matte.x, gloss.x),
        albedo.y.mul_add(matte.y, gloss.y),
        albedo.z.mul_add(matte.z, gloss.z),
    );
    if style == Style::Toon {
        let there = zero.lt(normal.dot(normal));
        return c * toon::line(Lanes::select(there, normal.dot(to_eye).abs(), k(1.0)));
    }
    c
}

/// How deep a block's neighbours may be before a line is drawn (§5, `toon`).
#[inline(always)]
pub(crate) fn line_limit<S: Simd>(simd: S, lighting: &Lighting, surface: &Shaded<S>, (x, y): (i32, i32)) -> Lanes<S> {
    let k = |v: f32| Lanes::splat(simd, v);
    let projection = &lighting.view.projection;
    let (sx, sy) = slopes(lighting, (Lanes::block_columns(simd) + k(x as f32), Lanes::block_rows(simd) + k(y as f32)));
    let z = Lanes::select(surface.covered, surface.z, k(1.0));
    let at = if projection.is_perspective() { V3::new(sx * z, sy * z, z) } else { V3::new(sx, sy, z) };
    let n = transform(&lighting.world_from_view.transpose(), surface.normal);
    let there = k(0.0).lt(surface.normal.dot(surface.normal));
    let none = V2::new(k(0.0), k(0.0));
    toon::step_back_limit(z, V2::select(there, plane_gradient(at, n, projection), none), projection)
}

/// x/z and y/z of the rays through pixels, or x and y of an orthographic view.
#[inline(always)]
fn slopes<S: Simd>(lighting: &Lighting, (x, y): (Lanes<S>, Lanes<S>)) -> (Lanes<S>, Lanes<S>) {
    let p = &lighting.view.projection;
    (slope(x, p.focal_px[0], p.principal_px[0]), slope(y, p.focal_px[1], p.principal_px[1]))
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
    let (sx, sy) = slopes(lighting, (x, y));
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

#[inline(always)]
fn unit<S: Simd>(v: V3<Lanes<S>>) -> V3<Lanes<S>> {
    // Relative to the largest coordinate: a square neither overflows nor vanishes.
    let largest = v.max_abs();
    let there = v.x.zero().lt(largest);
    let one = v.x.one();
    let v = v * (one / Lanes::select(there, largest, one));
    v * Lanes::select(there, v.dot(v), one).inverse_sqrt()
}
