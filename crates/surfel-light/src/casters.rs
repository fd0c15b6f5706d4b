//! Surfaces that cast shadows, in the coordinates of the depth maps.

use glam::{DAffine3, DVec3, Vec3};
use surfel_math::clip::Clip;
use surfel_model::{ClipPolicy, Cull, Geometry, Mesh, Object, Scene, Shape, SplatCloud};
use surfel_render::ball_scale;

/// Fraction of the sampled points inside the inner sphere, which is centred at their median. The depth maps cover
/// points within [`OUTER_RADIUS`] times its radius.
const INNER_SHARE: f64 = 0.98;
/// Largest distance, in radii of the inner sphere, from the median of the points to points that the depth maps cover.
/// Points outside are stray points, which neither cast nor receive shadows.
const OUTER_RADIUS: f64 = 2.5;
/// Maximum number of splats and vertices from which the depth maps' sphere is estimated.
const ESTIMATED: usize = 1 << 16;

/// Sphere that the depth maps cover. Coordinates in the maps are relative to its centre, in units of its radius.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sphere {
    pub center: DVec3,
    pub radius: f64,
}

impl Sphere {
    /// Estimates the sphere that contains a scene's splats and meshes except for stray points; `None` if there are
    /// none. Octrees and Gaussians don't count.
    pub(crate) fn of(scene: &Scene) -> Option<Self> {
        let total: usize = scene.objects.iter().map(count).sum();
        let step = total.div_ceil(ESTIMATED).max(1);
        let mut points = Vec::with_capacity(total / step + 1);
        let mut first = 0;
        for object in &scene.objects {
            let count = count(object);
            // Every step-th of all points is used, counted over all objects.
            let start = (step - first % step) % step;
            points.extend((start..count).step_by(step).filter_map(|i| place(object, i)));
            first += count;
        }
        if points.is_empty() {
            return None;
        }
        let median = |axis: usize| {
            let mut values: Vec<f64> = points.iter().map(|(p, _)| p[axis]).collect();
            let middle = values.len() / 2;
            *values.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let middle = DVec3::new(median(0), median(1), median(2));
        let mut reaches: Vec<f64> = points.iter().map(|(p, radius)| p.distance(middle) + radius).collect();
        let inner = (((reaches.len() - 1) as f64) * INNER_SHARE) as usize;
        let limit = OUTER_RADIUS * *reaches.select_nth_unstable_by(inner, f64::total_cmp).1;
        // The sphere surrounds the bounds of the points within the limit, which a sample may miss by a little.
        let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for (p, radius) in points.iter().filter(|(p, radius)| p.distance(middle) + radius <= limit) {
            (lo, hi) = (lo.min(*p - DVec3::splat(*radius)), hi.max(*p + DVec3::splat(*radius)));
        }
        let center = 0.5 * (lo + hi);
        let reach = |(p, radius): &(DVec3, f64)| p.distance(center) + radius;
        let within = points.iter().filter(|(p, radius)| p.distance(middle) + radius <= limit);
        let radius = within.map(reach).fold(0.0, f64::max) * if step > 1 { 1.05 } else { 1.0 };
        // A single point with a radius in pixels has no size.
        Some(Self { center, radius: if radius > 0.0 { radius } else { 1.0 } })
    }

    /// Converts a point from world space to the coordinates of the depth maps.
    pub(crate) fn point(&self, p: DVec3) -> Vec3 {
        ((p - self.center) / self.radius).as_vec3()
    }

    /// Converts a vector from world space to the units of the depth maps.
    pub(crate) fn vector(&self, v: DVec3) -> Vec3 {
        (v / self.radius).as_vec3()
    }

    /// Converts a length from world units to the units of the depth maps.
    pub(crate) fn length(&self, length: f64) -> f32 {
        (length / self.radius) as f32
    }
}

/// Returns the number of splats or vertices by which an object counts for the sphere; 0 for octrees and Gaussians.
fn count(object: &Object) -> usize {
    match &object.geometry {
        Geometry::Splats(cloud) => cloud.len(),
        Geometry::Mesh(mesh) => mesh.positions.len(),
        Geometry::Octree(_) | Geometry::Gaussians(_) => 0,
    }
}

/// Returns the world position and radius of splat `i`, or the position of mesh vertex `i` with radius 0.
fn place(object: &Object, i: usize) -> Option<(DVec3, f64)> {
    let m = &object.world_from_object;
    let (point, radius) = match &object.geometry {
        Geometry::Splats(cloud) if cloud.is_balls() => (cloud.center(i), cloud.radius_max(i) * ball_scale(m)),
        Geometry::Splats(cloud) => {
            let (s, t) = cloud.axes(i);
            let radius = m.transform_vector3(s).length().max(m.transform_vector3(t).length());
            (cloud.center(i), radius)
        }
        Geometry::Mesh(mesh) => (mesh.origin + mesh.positions.get(i), 0.0),
        Geometry::Octree(_) | Geometry::Gaussians(_) => return None,
    };
    let point = m.transform_point3(point);
    (point.is_finite() && radius.is_finite()).then_some((point, radius))
}

/// Surface that casts a shadow, in the coordinates of the depth maps.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Caster {
    /// Splat with half-axes s and t. `clip` is the index of its clip in [`Casters::clips`]. If `facing` isn't 0,
    /// `facing`·(s × t) points out of a watertight surface. Splats that face away from the light then needn't be drawn.
    Disk { center: Vec3, s: Vec3, t: Vec3, clip: Option<u32>, facing: f32 },
    /// Ball, a splat that is a sphere.
    Ball { center: Vec3, radius: f32 },
    /// Triangle of a mesh, given by its corners.
    Triangle([Vec3; 3]),
}

/// Surfaces of a scene that cast shadows, in the coordinates of the depth maps.
#[derive(Debug, Default)]
pub(crate) struct Casters {
    pub casters: Vec<Caster>,
    pub clips: Vec<Clip<f64>>,
}

impl Casters {
    /// Collects the surfaces that cast shadows: opaque disks and balls with centres inside of the sphere, and all
    /// triangles of meshes.
    pub(crate) fn of(scene: &Scene, sphere: &Sphere) -> Self {
        let mut all = Self::default();
        for object in &scene.objects {
            match &object.geometry {
                Geometry::Splats(cloud) => all.add_cloud(cloud, object, sphere),
                Geometry::Mesh(mesh) => all.add_mesh(mesh, &object.world_from_object, sphere),
                Geometry::Octree(_) | Geometry::Gaussians(_) => {}
            }
        }
        all
    }

    fn add_cloud(&mut self, cloud: &SplatCloud, object: &Object, sphere: &Sphere) {
        let m = &object.world_from_object;
        // A mirroring matrix reverses s × t.
        let facing = match object.material.cull {
            Cull::None => 0.0,
            Cull::Back => m.matrix3.determinant().signum() as f32,
        };
        let is_within = |center: Vec3| center.length_squared() <= 1.0;
        let opaque = |i: &usize| cloud.alpha(*i) >= 1.0;
        self.casters.reserve(cloud.len());
        if let Shape::Balls { .. } = &cloud.data().shape {
            let scale = ball_scale(m);
            for i in (0..cloud.len()).filter(opaque) {
                let center = sphere.point(m.transform_point3(cloud.center(i)));
                if is_within(center) {
                    self.casters.push(Caster::Ball { center, radius: sphere.length(cloud.radius_max(i) * scale) });
                }
            }
            return;
        }
        for i in (0..cloud.len()).filter(opaque) {
            let (s, t) = cloud.axes(i);
            let [s, t] = [s, t].map(|axis| sphere.vector(m.transform_vector3(axis)));
            let center = sphere.point(m.transform_point3(cloud.center(i)));
            if !is_within(center) {
                continue;
            }
            let clip = cloud.data().clips.as_ref().and_then(|clips| clips.clip(i, ClipPolicy::Exact));
            let clip = clip.map(|clip| {
                self.clips.push(clip);
                (self.clips.len() - 1) as u32
            });
            self.casters.push(Caster::Disk { center, s, t, clip, facing });
        }
    }

    fn add_mesh(&mut self, mesh: &Mesh, m: &DAffine3, sphere: &Sphere) {
        let corner = |i: u32| sphere.point(m.transform_point3(mesh.origin + mesh.positions.get(i as usize)));
        let triangles = mesh.triangles.iter().map(|corners| Caster::Triangle(corners.map(corner)));
        self.casters.extend(triangles);
    }
}
