//! Shading (rendering model §5): divides attributes by Σw, then applies the plan's shader, once per pixel.

use crate::ball::ScreenBall;
use crate::polygon::{self, Polygons};
use crate::raster::Sums;
use crate::shadow::{self, Shadow};
use crate::splat::ScreenSplat;
use crate::{margin, matcap};
use glam::DVec3;
use std::sync::Arc;
use surfel_math::V2;
use surfel_math::basis::unit;
use surfel_math::srgb::limit_color;
use surfel_math::toon;
use surfel_model::{BallLight, Light, Matcap, Shader};
use surfel_render::{FramePlan, View};

/// Inputs of shading that are the same for all pixels of a frame.
pub(crate) struct Lighting<'a> {
    pub view: &'a View,
    pub plan: &'a FramePlan,
    pub shadows: &'a [Shadow<'a>],
    pub lights: &'a [Light],
    pub ambient: DVec3,
    /// Image of a lit sphere by which the shader `matcap` colours surfaces.
    pub matcap: Arc<Matcap>,
    /// Ambient, diffuse, specular and shininess factors of all splats, if the plan doesn't sum materials because all
    /// objects share them.
    pub material: [f64; 4],
}

/// Nearest surface, or surface of a layer, in a pixel after shading.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    pub color: DVec3,
    pub depth: f64,
    /// Unit normal in world space; zero if it is undefined.
    pub normal: DVec3,
    pub weight: f64,
    /// Opacity of the surface: Σwα/Σw over its fragments.
    pub alpha: f64,
    /// True if rounding could add or remove a highlight or a shadow at this surface.
    pub marginal: bool,
}

/// Point of a surface with the properties from which a shader computes its colour.
struct Point {
    /// Position of the point in view space.
    at: DVec3,
    depth: f64,
    /// Unit normal in world space; zero if it is undefined.
    normal: DVec3,
    albedo: DVec3,
    material: [f64; 4],
}

impl Surface {
    /// Blends colour, depth and normal of this surface over those of another one, with the weight `share` (rendering
    /// model §6).
    pub(crate) fn blended_over(&self, behind: &Self, share: f64) -> Self {
        Self {
            color: self.color * share + behind.color * (1.0 - share),
            depth: self.depth * share + behind.depth * (1.0 - share),
            normal: unit(self.normal * share + behind.normal * (1.0 - share)),
            marginal: self.marginal || behind.marginal,
            ..*self
        }
    }
}

impl Lighting<'_> {
    /// Divides a pixel's sums by Σw and shades the result; `None` if Σw = 0.
    pub(crate) fn shade(&self, sums: &Sums, pixel: V2<f64>) -> Option<Surface> {
        if sums.weight <= 0.0 {
            return None;
        }
        let inverse = 1.0 / sums.weight;
        let wants = self.plan.attributes;
        let albedo = if wants.color { DVec3::from(sums.color) / sums.weight } else { DVec3::ONE };
        let normal = unit(sums.normal);
        let depth = sums.depth * inverse;
        let material = if wants.material { sums.material.map(|m| m * inverse) } else { self.material };
        let point = Point { at: self.position(pixel, depth), depth, normal, albedo, material };
        let (color, marginal) = self.color(&point);
        let alpha = sums.alpha * inverse;
        Some(Surface { color, depth, normal, weight: sums.weight, alpha, marginal })
    }

    /// Shades a polygon at a pixel.
    pub(crate) fn shade_polygon(&self, hit: &polygon::Hit, polygons: &Polygons, pixel: V2<f64>) -> Surface {
        let polygon::Material { albedo, normal, factors } = polygons.material(hit, pixel);
        let point = Point { at: self.position(pixel, hit.z), depth: hit.z, normal, albedo, material: factors };
        let (color, marginal) = self.color(&point);
        Surface { color, depth: hit.z, normal, weight: 0.0, alpha: 1.0, marginal }
    }

    /// Shades a ball at a pixel with the given planar depth and unit normal in world space. `weight` is the fragment's
    /// coverage, which the weight plane shows.
    pub(crate) fn shade_ball(
        &self,
        ball: &ScreenBall,
        pixel: V2<f64>,
        depth: f64,
        normal: DVec3,
        weight: f64,
    ) -> Surface {
        let albedo = DVec3::from(ball.color);
        let point = Point { at: self.position(pixel, depth), depth, normal, albedo, material: ball.material };
        let (mut color, marginal) = self.color(&point);
        if let Some(light) = ball.light.filter(|_| self.plan.shader == Shader::Unlit) {
            color *= stored_light(&light, normal);
        }
        if self.plan.shader == Shader::Edl {
            // Eye-dome lighting darkens a tilted plane by about its cosine.
            color *= self.cosine_to_eye(&point).abs();
        }
        Surface { color, depth, normal, weight, alpha: 1.0, marginal }
    }

    /// Divides the sums of a pixel whose fragments were already shaded ([`Lighting::lit_splat`]); `None` if Σw = 0.
    pub(crate) fn shade_lit(sums: &Sums) -> Option<Surface> {
        (sums.weight > 0.0).then(|| {
            let inverse = 1.0 / sums.weight;
            Surface {
                color: DVec3::from(sums.color) * inverse,
                depth: sums.depth * inverse,
                normal: unit(sums.normal),
                weight: sums.weight,
                alpha: sums.alpha * inverse,
                marginal: false,
            }
        })
    }

    /// Shades a splat at its centre, and returns it with the shaded colour in place of its albedo. The second value is
    /// true if rounding could change the colour.
    pub(crate) fn lit_splat(&self, splat: &ScreenSplat) -> (ScreenSplat, bool) {
        let albedo = DVec3::from(splat.color);
        // The centre may be in front of z_near, where the stored depth would exceed 1.
        let depth = splat.center.z.max(self.view.projection.near);
        let point = Point { at: splat.center, depth, normal: splat.normal, albedo, material: splat.material };
        let (color, marginal) = self.color(&point);
        (ScreenSplat { color: color.to_array(), ..splat.clone() }, marginal)
    }

    /// Returns the view-space position at which a pixel's ray has this depth.
    fn position(&self, pixel: V2<f64>, depth: f64) -> DVec3 {
        let (origin, direction) = self.view.projection.ray(pixel);
        let at = origin + direction * depth;
        DVec3::new(at.x, at.y, at.z)
    }

    /// Returns the colour that the plan's shader computes for a point, and true if rounding could change it.
    fn color(&self, point: &Point) -> (DVec3, bool) {
        let (color, marginal) = self.unlimited_color(point);
        (DVec3::from(color.to_array().map(limit_color)), marginal)
    }

    /// Returns the colour of the plan's shader for a point, without limits of its range, and true if rounding could
    /// change it.
    fn unlimited_color(&self, point: &Point) -> (DVec3, bool) {
        match self.plan.shader {
            Shader::Matcap => {
                let sphere = matcap::color(&self.matcap, point.normal, self.to_eye(point), self.view);
                (point.albedo * sphere, false)
            }
            Shader::Normal if point.normal == DVec3::ZERO => (DVec3::ZERO, false),
            Shader::Normal => (point.normal * 0.5 + 0.5, false),
            Shader::Depth => (DVec3::splat(self.view.projection.stored_depth(point.depth)), false),
            Shader::Phong => self.lit(point, |light| light, |strength, reaching| strength * reaching),
            Shader::Toon => {
                let (color, marginal) = self.lit(point, toon::ramp, |s, reaching| toon::highlight(s * reaching));
                (color * toon::line(self.cosine_to_eye(point).abs()), marginal)
            }
            // `Shader::Unlit`, and `Shader::Edl`, which is applied later, when neighbours are known.
            _ => (point.albedo, false),
        }
    }

    /// Returns the cosine n·v between normal and eye direction; 1 if there is no normal.
    fn cosine_to_eye(&self, point: &Point) -> f64 {
        let normal = self.view.view_from_world * point.normal;
        if normal == DVec3::ZERO { 1.0 } else { normal.dot(self.to_eye(point)) }
    }

    /// Returns the unit vector from a point to the eye, in view space.
    fn to_eye(&self, point: &Point) -> DVec3 {
        if self.view.projection.is_perspective() { -unit(point.at) } else { DVec3::NEG_Z }
    }

    /// Computes ambient, diffuse and specular light at a point. The second value is true if rounding could add or
    /// remove a highlight or a shadow. `diffused` returns the diffuse factor for max(0, n·l) times the fraction of the
    /// light that reaches the point. `highlighted` returns the specular factor for a highlight's strength max(0,
    /// r·v)^shininess, and that fraction.
    fn lit(
        &self,
        point: &Point,
        diffused: impl Fn(f64) -> f64,
        highlighted: impl Fn(f64, f64) -> f64,
    ) -> (DVec3, bool) {
        let Point { normal, albedo, .. } = *point;
        let [ambient, diffuse, specular, shininess] = point.material;
        let mut matte = self.ambient * ambient;
        let mut gloss = DVec3::ZERO;
        let mut marginal = false;
        if normal != DVec3::ZERO {
            // Relative to the eye, so that scenes far from the origin stay precise.
            let position = self.view.view_from_world.transpose() * point.at;
            let to_eye = if self.view.projection.is_perspective() { -unit(position) } else { -self.view.forward() };
            for (i, light) in self.lights.iter().enumerate() {
                let (to_light, color) = self.incident(light, position);
                let cosine = normal.dot(to_light);
                let reflected = normal * (2.0 * cosine) - to_light;
                let strength = reflected.dot(to_eye).max(0.0).powf(shininess);
                marginal |=
                    margin::on_terminator(cosine) && color * (specular * highlighted(strength, 1.0)) != DVec3::ZERO;
                if cosine > 0.0 {
                    let (reaching, open) = shadow::visibility(self.shadows, i, self.view, position, normal);
                    matte += color * (diffuse * diffused(cosine * reaching));
                    gloss += color * (specular * highlighted(strength, reaching));
                    marginal |= open;
                }
            }
        }
        (albedo * matte + gloss, marginal)
    }

    /// Returns the unit vector to a light, and the colour of the light that arrives at a position, before shadows. The
    /// position is relative to the eye. Only a spot light's colour depends on it.
    fn incident(&self, light: &Light, position: DVec3) -> (DVec3, DVec3) {
        match light {
            Light::Directional { direction, color, .. } => (-unit(DVec3::from(*direction)), DVec3::from(*color)),
            Light::Point { position: at, color } => {
                (unit(DVec3::from(*at) - self.view.eye - position), DVec3::from(*color))
            }
            Light::Spot { position: at, direction, color, inner_deg, outer_deg, .. } => {
                let to_light = unit(DVec3::from(*at) - self.view.eye - position);
                let angle = angle_between(-to_light, unit(DVec3::from(*direction))).to_degrees();
                (to_light, DVec3::from(*color) * smooth_fade(angle, *inner_deg, *outer_deg))
            }
            // A kind of light that may be added to the enum emits no light.
            _ => (DVec3::Z, DVec3::ZERO),
        }
    }
}

/// Returns the light stored in a ball for a unit normal, as brightness of a white surface (rendering model §12).
fn stored_light(light: &BallLight, n: DVec3) -> f64 {
    let [xx, yy, zz, xy, xz, yz] = light.quadratic.map(f64::from);
    let linear = DVec3::from(light.linear.map(f64::from)).dot(n);
    let squares = xx * n.x * n.x + yy * n.y * n.y + zz * n.z * n.z;
    let products = xy * n.x * n.y + xz * n.x * n.z + yz * n.y * n.z;
    (linear + squares + 2.0 * products).max(0.0)
}

/// Returns the angle between two unit vectors in radians, accurate close to 0 and to π.
fn angle_between(a: DVec3, b: DVec3) -> f64 {
    2.0 * (a - b).length().atan2((a + b).length())
}

/// Returns the strength of a spot light at an angle from its axis: 1 up to `inner`, 0 from `outer` on, and a smoothstep
/// in between.
fn smooth_fade(angle: f64, inner: f64, outer: f64) -> f64 {
    if angle <= inner {
        return 1.0;
    }
    if angle >= outer {
        return 0.0;
    }
    let x = (outer - angle) / (outer - inner);
    x * x * (3.0 - 2.0 * x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spot_fades_smoothly_between_its_half_angles() {
        assert_eq!(smooth_fade(10.0, 20.0, 30.0), 1.0);
        assert_eq!(smooth_fade(30.0, 20.0, 30.0), 0.0);
        assert!((smooth_fade(25.0, 20.0, 30.0) - 0.5).abs() < 1e-15);
        assert_eq!(smooth_fade(20.0, 20.0, 20.0), 1.0);
        assert!((angle_between(DVec3::X, DVec3::Y).to_degrees() - 90.0).abs() < 1e-13);
    }
}
