//! The lights of a frame, and lighting of surfaces (rendering model §5), sixteen pixels at a time.

use crate::shade::matcap::MatcapSphere;
use crate::shade::shadow_map::{self, ShadowMap};
use crate::shade::surface::{Surface, limited};
use crate::shade::view_ray::{Place, ViewRay, ViewRays};
use crate::simd::lanes::{LANES, Lanes};
use crate::simd::math::{unit_or_zero, vector};
use fearless_simd::Simd;
use fearless_simd::prelude::SimdMask;
use glam::{DVec3, Mat3, Vec3};
use std::sync::Arc;
use surfel_math::projection::Projection;
use surfel_math::srgb::limit_light;
use surfel_math::{Real, V3, toon};
use surfel_model::{Light, Matcap, Shader};
use surfel_render::{Attributes, FramePlan, Planes, SAMPLES_SIDE, View};

/// Kind of a light, with its position or direction in world axes. Positions are relative to the eye, so that they stay
/// precise far from the origin. Directions are unit vectors; `inner` and `outer` are half-angles in degrees.
enum Source {
    Directional { to_light: Vec3 },
    Point { position: Vec3 },
    Spot { position: Vec3, direction: Vec3, inner: f64, outer: f64 },
}

/// A light in the form in which the shader reads it.
struct FrameLight {
    source: Source,
    /// Shadow maps of the light; empty if the light casts no shadows.
    maps: Vec<ShadowMap>,
    /// Colour of the light, multiplied by the diffuse factor if all objects share it.
    diffuse: Vec3,
    /// Colour of the light, multiplied by the specular factor if all objects share it.
    specular: Vec3,
}

/// Parameters of a frame's shading: shader, lights, materials and background.
pub(crate) struct Lighting {
    pub shader: Shader,
    pub planes: Planes,
    pub attributes: Attributes,
    lights: Arc<[FrameLight]>,
    /// Colour of the ambient light, multiplied by the ambient factor if all objects share it.
    ambient: Vec3,
    /// True if all lights are directional and cast no shadow, so that positions of surfaces needn't be computed.
    are_directional: bool,
    /// Ambient, diffuse, specular and shininess factors of the first object's material, which all objects share unless
    /// these factors are accumulated per pixel.
    pub material: [f32; 4],
    /// The shininess that all objects share, a whole number, and the smallest base of its power ([`whole_power`]).
    /// `None` if the shininess isn't a whole number from 1 to 256, or differs between objects.
    whole_shininess: Option<(u32, f32)>,
    /// Background colour, linear and premultiplied.
    pub background: [f32; 4],
    /// Lit sphere of the shader `matcap`; `None` for other shaders, and if the frame needs no colour.
    pub matcap: Option<MatcapSphere>,
    pub rays: ViewRays,
    /// Side of a pixel of the image, in pixels of the view: 1, or the number of samples along a pixel's side.
    pub pixel_px: f64,
    view: View,
}

impl Lighting {
    pub(crate) fn new(
        plan: &FramePlan,
        view: &View,
        lights: &[Light],
        shadows: Vec<ShadowMap>,
        ambient: [f64; 3],
        material: [f64; 4],
        background: [f64; 4],
    ) -> Self {
        let unit = |v: &[f64; 3]| surfel_math::basis::unit(DVec3::from(*v)).as_vec3();
        let relative = |p: &[f64; 3]| (DVec3::from(*p) - view.eye).as_vec3();
        let factors = if plan.attributes.material { [1.0; 4] } else { material };
        let count = lights.len();
        let by = |color: &[f64; 3], factor: f64| DVec3::from(limit_light(color.map(|c| c * factor), count)).as_vec3();
        let light = |light: &Light| {
            let (source, color) = match light {
                Light::Directional { direction, color, .. } => {
                    (Source::Directional { to_light: -unit(direction) }, color)
                }
                Light::Point { position, color } => (Source::Point { position: relative(position) }, color),
                Light::Spot { position, direction, color, inner_deg, outer_deg, .. } => {
                    let (position, direction) = (relative(position), unit(direction));
                    (Source::Spot { position, direction, inner: *inner_deg, outer: *outer_deg }, color)
                }
                // A kind of light that may be added to the enum emits no light.
                _ => (Source::Directional { to_light: Vec3::Z }, &[0.0; 3]),
            };
            FrameLight { source, maps: Vec::new(), diffuse: by(color, factors[1]), specular: by(color, factors[2]) }
        };
        let mut lights: Vec<FrameLight> = lights.iter().map(light).collect();
        for shadow in shadows {
            if let Some(light) = lights.get_mut(shadow.light) {
                light.maps.push(shadow);
            }
        }
        let is_directional = |l: &FrameLight| matches!(l.source, Source::Directional { .. }) && l.maps.is_empty();
        Self {
            shader: plan.shader,
            planes: plan.planes,
            attributes: plan.attributes,
            are_directional: lights.iter().all(is_directional),
            lights: lights.into(),
            ambient: by(&ambient, factors[0]),
            material: material.map(|m| m as f32),
            whole_shininess: whole_power(material[3]).filter(|_| !plan.attributes.material),
            background: background.map(|c| c as f32),
            rays: ViewRays::of(view),
            pixel_px: 1.0,
            view: view.clone(),
            matcap: None,
        }
    }

    /// Adds the image of a lit sphere that the shader `matcap` samples, if the frame uses that shader and needs
    /// colours. `None` selects the built-in image.
    pub(crate) fn with_matcap(self, image: Option<Arc<Matcap>>) -> Self {
        let wanted = self.shader == Shader::Matcap && self.planes.shows_color();
        Self { matcap: wanted.then(|| MatcapSphere::new(image.unwrap_or_else(Matcap::builtin))), ..self }
    }

    /// Returns the same lighting for a view whose pixels are samples.
    pub(crate) fn of_samples(&self, plan: &FramePlan, view: &View) -> Self {
        Self {
            planes: plan.planes,
            lights: self.lights.clone(),
            matcap: self.matcap.clone(),
            rays: ViewRays::of(view),
            pixel_px: f64::from(SAMPLES_SIDE),
            view: view.clone(),
            ..*self
        }
    }

    /// Returns the background colour, linear and premultiplied; `None` if the frame needs no colour.
    pub(crate) fn background_color(&self) -> Option<[f32; 4]> {
        self.planes.shows_color().then_some(self.background)
    }

    /// Converts a position in view space to one in world axes, relative to the eye.
    pub(crate) fn world_from_view(&self, p: Vec3) -> Vec3 {
        self.rays.world_from_view * p
    }

    /// Returns the rotation from world axes to the view's.
    pub(crate) fn view_from_world(&self) -> Mat3 {
        self.rays.world_from_view.transpose()
    }

    /// Returns the view's projection.
    pub(crate) fn projection(&self) -> &Projection {
        &self.view.projection
    }

    /// Returns the smallest depth that is drawn, z_near, in world units.
    pub(crate) fn near(&self) -> f32 {
        self.view.projection.near as f32
    }
}

/// Returns the exponent if it is a whole number from 1 to 256, and the smallest base whose power is a normal number;
/// otherwise `None`. For such exponents a few multiplications are faster than a logarithm. Smaller bases would yield
/// subnormal products, which slow the CPU down. 256 roundings are 1.5e-5 of a highlight.
fn whole_power(exponent: f64) -> Option<(u32, f32)> {
    let suits = (1.0..=256.0).contains(&exponent) && exponent.fract() == 0.0;
    suits.then(|| (exponent as u32, 1e-36f64.powf(1.0 / exponent) as f32))
}

/// Intermediate results while lights are added to a surface.
struct Lit<S: Simd> {
    normal: V3<Lanes<S>>,
    view_ray: ViewRay<S>,
    /// 2(n·s), where n is the normal and s the view ray before normalisation.
    along_ray: Lanes<S>,
    /// Sum of ambient and diffuse light, by which the albedo is multiplied.
    matte: V3<Lanes<S>>,
    /// Sum of specular light.
    gloss: V3<Lanes<S>>,
}

impl<S: Simd> Lit<S> {
    /// Returns n·l and r·v for a light in the unit direction l. The vector r = 2(n·l)n − l is the mirror image of l,
    /// and v = −s/|s| is the unit vector to the eye.
    #[inline(always)]
    fn cosines(&self, to_light: V3<Lanes<S>>) -> (Lanes<S>, Lanes<S>) {
        let cosine = self.normal.dot(to_light);
        let mirrored =
            (-cosine).mul_add(self.along_ray, to_light.dot(self.view_ray.ray)) * self.view_ray.inverse_length;
        (cosine, mirrored)
    }
}

#[inline(always)]
fn plus<S: Simd>(sum: V3<Lanes<S>>, color: Vec3, by: Lanes<S>) -> V3<Lanes<S>> {
    let c = vector(by.0.simd, color);
    V3::new(c.x.mul_add(by, sum.x), c.y.mul_add(by, sum.y), c.z.mul_add(by, sum.z))
}

/// Returns the colour of a surface under the frame's lights. `TOON` selects the shader `toon`, with light in steps,
/// instead of `phong`.
#[inline(always)]
pub(crate) fn phong<S: Simd, const TOON: bool>(
    simd: S,
    lighting: &Lighting,
    surface: &Surface<S>,
    place: Place<S>,
) -> V3<Lanes<S>> {
    let zero = Lanes::splat(simd, 0.0);
    let Surface { normal, albedo, .. } = *surface;
    let view_ray = lighting.rays.view_ray(simd, place);
    let along = normal.dot(view_ray.ray);
    let none = V3::new(zero, zero, zero);
    let ambient = vector(simd, lighting.ambient);
    let mut lit = Lit { normal, view_ray, along_ray: along + along, matte: ambient, gloss: none };
    let is_glossy = lighting.material[2] != 0.0;
    if !TOON && lighting.are_directional && !lighting.attributes.material {
        for light in lighting.lights.iter() {
            let Source::Directional { to_light } = light.source else { continue };
            let (cosine, mirrored) = lit.cosines(vector(simd, to_light));
            lit.matte = plus(lit.matte, light.diffuse, cosine.max(zero));
            if is_glossy {
                let highlight = highlight(lighting, mirrored, Lanes::splat(simd, lighting.material[3]));
                lit.gloss = plus(lit.gloss, light.specular, Lanes::select(zero.lt(cosine), highlight, zero));
            }
        }
    } else {
        // A copy, since the argument of a call lives in memory.
        let own = *surface;
        lit = add_lights_of_any_kind::<S, TOON>(simd, lighting, &own, place, lit);
    }
    let Lit { matte, gloss, .. } = lit;
    let c = V3::new(
        albedo.x.mul_add(matte.x, gloss.x),
        albedo.y.mul_add(matte.y, gloss.y),
        albedo.z.mul_add(matte.z, gloss.z),
    );
    if TOON {
        let there = zero.lt(normal.dot(normal));
        let facing = (along * lit.view_ray.inverse_length).abs();
        return limited(c) * toon::line(Lanes::select(there, facing, zero.one()));
    }
    c
}

/// Adds lights of any kind, with their shadows. Not inlined, so that the code for directional lights, which are more
/// frequent, keeps its operands in registers.
#[inline(never)]
fn add_lights_of_any_kind<S: Simd, const TOON: bool>(
    simd: S,
    lighting: &Lighting,
    surface: &Surface<S>,
    place: Place<S>,
    lit: Lit<S>,
) -> Lit<S> {
    simd.vectorize(
        #[inline(always)]
        || add_all::<S, TOON>(simd, lighting, surface, place, lit),
    )
}

#[inline(always)]
fn add_all<S: Simd, const TOON: bool>(
    simd: S,
    lighting: &Lighting,
    surface: &Surface<S>,
    place: Place<S>,
    mut lit: Lit<S>,
) -> Lit<S> {
    let zero = Lanes::splat(simd, 0.0);
    let differ = lighting.attributes.material;
    let [ambient, diffuse, specular, shininess] = surface.material;
    if differ {
        lit.matte = lit.matte * ambient;
    }
    let position = lighting.rays.position(simd, place, lit.view_ray.ray, surface.z);
    for light in lighting.lights.iter() {
        let mut strength = None;
        let to_light = match &light.source {
            Source::Directional { to_light } => vector(simd, *to_light),
            Source::Point { position: at } => unit_or_zero(vector(simd, *at) - position),
            Source::Spot { position: at, direction, inner, outer } => {
                let to_light = unit_or_zero(vector(simd, *at) - position);
                strength = Some(spot_strength(simd, to_light, *direction, *inner, *outer));
                to_light
            }
        };
        let (cosine, mirrored) = lit.cosines(to_light);
        let faces = zero.lt(cosine);
        let mut matte = cosine.max(zero);
        let mut gloss = zero;
        if differ || lighting.material[2] != 0.0 {
            gloss = Lanes::select(faces, highlight(lighting, mirrored, shininess), zero);
        }
        let mask = faces & surface.covered;
        if !light.maps.is_empty() && mask.to_bitmask() != 0 {
            // Fraction of the light that reaches the surface.
            let share = shadow_map::light_fraction(simd, &light.maps, position, lit.normal, mask);
            (matte, gloss) = (matte * share, gloss * share);
        }
        if TOON {
            (matte, gloss) = (toon::ramp(matte), toon::highlight(gloss));
        }
        if differ {
            (matte, gloss) = (matte * diffuse, gloss * specular);
        }
        if let Some(strength) = strength {
            (matte, gloss) = (matte * strength, gloss * strength);
        }
        lit.matte = plus(lit.matte, light.diffuse, matte);
        lit.gloss = plus(lit.gloss, light.specular, gloss);
    }
    lit
}

/// Returns the strength of a highlight, max(0, r·v)^shininess. If all objects share a shininess that is a whole number
/// from 1 to 256, the result is about 10⁻³⁶ instead of 0. `mirrored` is r·v, with r the mirror image of the direction
/// to the light, and v the direction to the eye.
#[inline(always)]
fn highlight<S: Simd>(lighting: &Lighting, mirrored: Lanes<S>, shininess: Lanes<S>) -> Lanes<S> {
    match lighting.whole_shininess {
        Some((n, least)) => mirrored.max(mirrored.constant(least.into())).whole_power(n),
        None => mirrored.max(mirrored.zero()).min(mirrored.one()).power(shininess),
    }
}

/// Returns the strength of a spot light in the direction of a surface: smoothstep of the angle between the half-angles
/// `inner` and `outer` (degrees). Lane by lane, since it needs an arctangent.
#[cold]
fn spot_strength<S: Simd>(simd: S, to_light: V3<Lanes<S>>, direction: Vec3, inner: f64, outer: f64) -> Lanes<S> {
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
