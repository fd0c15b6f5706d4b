//! Storage of light in the colours of splats and vertices, and in the coefficients of balls.

use crate::buried::buried;
use crate::casters::Sphere;
use crate::directions::{Ray, open};
use crate::receivers::{Light, Receiver, Sides};
use glam::{DMat3, Vec3};
use surfel_math::basis::{normal_matrix, unit};
use surfel_model::{BallLight, CloudData, Cull, Geometry, Material, Mesh, Object, OnInvalid, Scene, Sky, SplatCloud};
use surfel_render::ball_scale;

use crate::LightError;
use std::sync::Arc;

/// Number of normals at which the light of a ball is computed: 6 along the axes and 8 along the diagonals.
const BALL_NORMALS: usize = 14;
/// Weights of an axis normal and of a diagonal normal in the mean over a ball's surface. The mean is exact for
/// polynomials up to degree 5 (Lebedev 1976).
const MEAN_WEIGHTS: [f32; 2] = [1.0 / 15.0, 3.0 / 40.0];
/// Maximum number of splats of a cloud at which [`noise_of`] compares neighbours.
const NOISE_SAMPLES: usize = 4096;
/// Number of neighbours in Morton order with which [`noise_of`] compares a splat.
const NEIGHBOURS: usize = 8;
/// Largest distance along a splat's plane, in half-axes, of the neighbours that [`noise_of`] uses. Their height above
/// the plane may be at most one half-axis.
const MAX_NEIGHBOUR_DISTANCE: f64 = 1.25;
/// Number of splats of a cloud below which [`noise_of`] returns [`MIN_NOISE`] instead of an estimate.
const MIN_NOISE_SPLATS: usize = 64;
/// Ratio of a cloud's noise to the 90th percentile of the largest heights of neighbours above a splat's plane.
const NOISE_FACTOR: f32 = 1.5;
/// Smallest noise of a cloud that [`noise_of`] returns, in half-axes. Even without noise, neighbours on a curved
/// surface are outside each other's planes.
const MIN_NOISE: f32 = 0.05;
/// Weights of linear red, green and blue in the luminance (ITU-R BT.709).
const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// Returns the unit normals at which the light of a ball is computed: along the axes, then along the diagonals.
fn ball_normals() -> [Vec3; BALL_NORMALS] {
    let diagonal = 1.0 / 3f32.sqrt();
    std::array::from_fn(|i| match i {
        0..6 => Vec3::AXES[i / 2] * if i % 2 == 0 { 1.0 } else { -1.0 },
        _ => {
            let sign = |bit: usize| if (i - 6) >> bit & 1 == 0 { diagonal } else { -diagonal };
            Vec3::new(sign(0), sign(1), sign(2))
        }
    })
}

/// Returns the weight of one of the [`ball_normals`] in the mean over a ball's surface.
fn mean_weight(normal: Vec3) -> f32 {
    MEAN_WEIGHTS[usize::from(normal.abs().max_element() < 1.0)]
}

/// Returns the points of a scene at which light is summed, object by object.
pub(crate) fn receivers(scene: &Scene, sphere: &Sphere) -> Vec<Receiver> {
    scene.objects.iter().flat_map(|object| of_object(object, sphere)).collect()
}

fn of_object(object: &Object, sphere: &Sphere) -> Vec<Receiver> {
    let m = &object.world_from_object;
    let normals = normal_matrix(&m.matrix3);
    match &object.geometry {
        Geometry::Splats(cloud) if cloud.is_balls() => {
            let (scale, around) = (ball_scale(m), ball_normals());
            let of_ball = |i: usize| {
                let center = sphere.point(m.transform_point3(cloud.center(i)));
                let radius = sphere.length(cloud.radius_max(i) * scale);
                around.map(|normal| Receiver {
                    position: center + normal * radius,
                    normal,
                    noise: 0.0,
                    sides: Sides::Front,
                })
            };
            (0..cloud.len()).flat_map(of_ball).collect()
        }
        Geometry::Splats(cloud) => {
            let knows_front = object.material.is_oriented(cloud) || object.material.cull == Cull::Back;
            let sides = match (object.material.two_sided, object.material.cull) {
                (true, _) if !knows_front => Sides::Both,
                (true, Cull::None) => Sides::FrontAndSparseBack,
                _ => Sides::Front,
            };
            let noise = noise_of(cloud);
            let of_splat = |i: usize| Receiver {
                position: sphere.point(m.transform_point3(cloud.center(i))),
                normal: in_world(&normals, cloud.shading_normal(i)),
                noise: noise * sphere.length(m.transform_vector3(cloud.axes(i).0).length()),
                sides,
            };
            (0..cloud.len()).map(of_splat).collect()
        }
        Geometry::Mesh(mesh) => {
            let of_vertex = |(i, normal): (usize, Vec3)| Receiver {
                position: sphere.point(m.transform_point3(mesh.origin + mesh.positions.get(i))),
                normal: in_world(&normals, normal.as_dvec3()),
                noise: 0.0,
                sides: Sides::Both,
            };
            vertex_normals(mesh).into_iter().enumerate().map(of_vertex).collect()
        }
        Geometry::Octree(_) | Geometry::Gaussians(_) => Vec::new(),
    }
}

/// Estimates the noise of a cloud, in half-axes of a splat: how far neighbours are outside of each other's planes. The
/// result is from [`MIN_NOISE`] to 1. The noise offsets the lookup of light, so that noisy splats don't shade each
/// other.
fn noise_of(cloud: &SplatCloud) -> f32 {
    let order = cloud.morton_order();
    let step = order.len().div_ceil(NOISE_SAMPLES).max(1);
    let of_splat = |at: usize| {
        let i = order[at] as usize;
        let (center, normal, reach) = (cloud.center(i), cloud.normal(i), cloud.axes(i).0.length());
        let around = at.saturating_sub(NEIGHBOURS / 2)..(at + NEIGHBOURS / 2 + 1).min(order.len());
        let offsets = order[around].iter().map(|j| cloud.center(*j as usize) - center);
        let heights = offsets.filter_map(|offset| {
            let height = normal.dot(offset);
            let is_beside = (offset - normal * height).length() <= MAX_NEIGHBOUR_DISTANCE * reach;
            (is_beside && height.abs() <= reach).then_some(height.abs() / reach)
        });
        heights.fold(0.0, f64::max)
    };
    let mut heights: Vec<f64> = (0..order.len()).step_by(step).map(of_splat).collect();
    if order.len() < MIN_NOISE_SPLATS {
        return MIN_NOISE;
    }
    let place = heights.len() * 9 / 10;
    let height = *heights.select_nth_unstable_by(place, f64::total_cmp).1;
    (NOISE_FACTOR * height as f32).clamp(MIN_NOISE, 1.0)
}

/// Transforms a normal to world space by a normal matrix.
fn in_world(normals: &DMat3, normal: glam::DVec3) -> Vec3 {
    unit(*normals * normal).as_vec3()
}

/// Returns the vertex normals of a mesh. If it has none, they are means of the triangles' normals, weighted by area.
fn vertex_normals(mesh: &Mesh) -> Vec<Vec3> {
    if let Some(normals) = &mesh.normals {
        return normals.iter().map(|normal| Vec3::from(*normal)).collect();
    }
    let mut sums = vec![glam::DVec3::ZERO; mesh.positions.len()];
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|i| mesh.positions.get(i as usize));
        let normal = (b - a).cross(c - a);
        corners.iter().for_each(|i| sums[*i as usize] += normal);
    }
    sums.into_iter().map(|sum| unit(sum).as_vec3()).collect()
}

/// Stores light in a copy of a scene's objects. `light` has one entry for each of the scene's [`receivers`].
pub(crate) fn store(scene: &Scene, sky: &Sky, rays: &[Ray], light: &[Light]) -> Result<Vec<Object>, LightError> {
    let mut rest = light;
    let mut next = |count: usize| {
        let (own, others) = rest.split_at(count.min(rest.len()));
        rest = others;
        own
    };
    let mut objects = Vec::with_capacity(scene.objects.len());
    for object in &scene.objects {
        let material = &object.material;
        let shading = Shading { sky, rays, material };
        let normals = normal_matrix(&object.world_from_object.matrix3);
        let geometry = match &object.geometry {
            Geometry::Splats(cloud) if cloud.is_balls() => {
                let all = shading.balls(cloud, next(BALL_NORMALS * cloud.len()));
                let data = CloudData { ball_light: Some(all), ..cloud.data().clone() };
                SplatCloud::new(data, OnInvalid::Refuse)?.0.into()
            }
            Geometry::Splats(cloud) => {
                let mut light = next(cloud.len()).to_vec();
                if material.is_oriented(cloud) {
                    light.iter_mut().for_each(Light::prefer_front);
                }
                let light = &light;
                let color = |i: usize, lit_as: usize| {
                    let normal = in_world(&normals, cloud.shading_normal(lit_as));
                    shading.color(cloud.color(i), normal, &light[lit_as])
                };
                let mut colors: Vec<[f32; 3]> = (0..cloud.len()).map(|i| color(i, i)).collect();
                buried(cloud, light).into_iter().for_each(|(i, lit)| colors[i] = color(i, lit));
                SplatCloud::new(CloudData { colors: Some(colors), ..cloud.data().clone() }, OnInvalid::Refuse)?.0.into()
            }
            Geometry::Mesh(mesh) => {
                let light = next(mesh.positions.len());
                let own = |i: usize| mesh.colors.as_ref().map_or([1.0; 3], |colors| colors[i]);
                let normals = vertex_normals(mesh).into_iter().map(|n| in_world(&normals, n.as_dvec3()));
                let color = |(i, normal): (usize, Vec3)| shading.color(own(i), normal, &light[i]);
                let colors = Some(normals.enumerate().map(color).collect());
                Geometry::Mesh(Arc::new(Mesh { colors, ..Mesh::clone(mesh) }))
            }
            other => other.clone(),
        };
        objects.push(Object { geometry, ..object.clone() });
    }
    Ok(objects)
}

/// Sky and material from which the light that an object reflects is computed.
struct Shading<'a> {
    sky: &'a Sky,
    rays: &'a [Ray],
    material: &'a Material,
}

impl Shading<'_> {
    /// Returns the colour of a surface with albedo `own` (linear RGB) in `light`. The brighter side of the surface
    /// counts.
    fn color(&self, own: [f32; 3], normal: Vec3, light: &Light) -> [f32; 3] {
        let total = |[sky, areas]: [f32; 2]| sky + areas;
        // The brighter side of a two-sided surface is the outer one.
        let (side, normal) =
            if total(light.back) > total(light.front) { (light.back, -normal) } else { (light.front, normal) };
        let [whole, _] = open(self.rays, normal);
        own.map(|albedo| albedo * self.reflected(side, whole, albedo))
    }

    /// Returns the brightness of a white surface that gets the light `[sky, areas]`, with the sky's even light and the
    /// material's diffuse factor. If [`Sky::bounce`] is true, light that other surfaces reflect is added, as if their
    /// albedo were `albedo`. `whole` is the light of the sky on an unoccluded surface.
    fn reflected(&self, [sky, areas]: [f32; 2], whole: f32, albedo: f32) -> f32 {
        let sky = if self.sky.bounce && whole > 0.0 { whole * with_interreflection(sky / whole, albedo) } else { sky };
        let even = self.sky.even as f32;
        (even + (1.0 - even) * (sky + areas)) * self.material.diffuse as f32
    }

    /// Computes the light coefficients of balls. `light` has one entry per ball and normal ([`ball_normals`]), ball by
    /// ball.
    fn balls(&self, cloud: &SplatCloud, light: &[Light]) -> Vec<BallLight> {
        let around = ball_normals();
        let whole = around.map(|normal| open(self.rays, normal)[0]);
        let of_ball = |(i, light): (usize, &[Light])| {
            let albedo = Vec3::from(cloud.color(i)).dot(LUMINANCE).clamp(0.0, 1.0);
            let mut coefficients = BallLight::default();
            for ((normal, whole), light) in around.iter().zip(whole).zip(light) {
                coefficients.add(*normal, mean_weight(*normal) * self.reflected(light.front, whole, albedo));
            }
            coefficients
        };
        light.chunks_exact(BALL_NORMALS).enumerate().map(of_ball).collect()
    }
}

/// Returns the visibility of the sky, 0 to 1, increased by light that neighbouring surfaces of this albedo reflect to
/// each other. Source: Jimenez et al. 2016, *Practical realtime strategies for accurate indirect occlusion*.
fn with_interreflection(visibility: f32, albedo: f32) -> f32 {
    let a = 2.0404 * albedo - 0.3324;
    let b = -4.7951 * albedo + 0.6417;
    let c = 2.7552 * albedo + 0.6903;
    visibility.max(((visibility * a + b) * visibility + c) * visibility)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_of_a_ball_are_exact_for_quadratic_light() {
        // Light from a half of the sky: (1 + n·up)/2, and a quadratic term.
        let light = |n: Vec3| 0.25 + 0.5 * (1.0 + n.z) + 0.25 * n.x * n.y - 0.125 * n.z * n.z;
        let mut coefficients = BallLight::default();
        for normal in ball_normals() {
            coefficients.add(normal, mean_weight(normal) * light(normal));
        }
        for n in [Vec3::Z, Vec3::NEG_Z, Vec3::new(0.6, 0.8, 0.0), Vec3::new(0.36, 0.48, -0.8)] {
            let found = coefficients.toward(n);
            assert!((found - light(n)).abs() < 1e-6, "{n}: {found}, expected {}", light(n));
        }
        let sum: f32 = ball_normals().into_iter().map(mean_weight).sum();
        assert!((sum - 1.0).abs() < 1e-6);
    }

    #[test]
    fn reflected_light_brightens_bright_surfaces_alone() {
        assert_eq!(with_interreflection(0.0, 1.0), 0.0);
        assert!(
            (with_interreflection(1.0, 0.5) - 1.0).abs() < 0.01 && (with_interreflection(1.0, 0.9) - 1.0).abs() < 0.01
        );
        assert!((with_interreflection(0.5, 0.0) - 0.5).abs() < 0.02, "black surfaces reflect nothing");
        // Closed form at visibility 0.5 and albedo 0.8: A = 1.29992, B = -3.19438, C = 2.89446.
        let expected = ((0.5 * 1.29992 - 3.19438) * 0.5 + 2.89446) * 0.5;
        assert!((with_interreflection(0.5, 0.8) - expected).abs() < 1e-6);
    }
}
