//! Shadow maps (rendering model §5): the lights that cast shadows, the bounds of their scene, and the maps' views.

use crate::{Region, SplatFilter, View, ball_scale};
use glam::{DAffine3, DMat3, DVec3};
use surfel_math::basis::{orthonormal, unit};
use surfel_math::depth::Tolerance;
use surfel_math::projection::{Projection, ProjectionKind};
use surfel_model::{Filter, Geometry, Light, Mesh, Scene, SplatCloud};

/// Number of texels along each side of a shadow map.
pub const SHADOW_MAP_SIDE: u32 = 1024;

/// Bias of a shadow map: the factor k of the tolerance ε (rendering model §5), in splat radii. Surfaces up to k radii
/// behind the nearest one are lit, so that a surface doesn't shade itself.
///
/// Measured on a ball over a floor (`tests/tests/conformance/shadow_maps.rs`) as the loss of light on surfaces that
/// face the light. k = 0 loses 7–15 %, ¼ 2–4·10⁻⁴, ½ 0.1–2·10⁻⁴, and 1 at most 8·10⁻⁵. No value lets light leak into
/// the shadow.
pub const SHADOW_BIAS_RADII: f64 = 1.0;

/// Largest half-angle, in degrees, of a spot light with one shadow map. A wider light has six maps, in all directions.
const WIDEST_SINGLE_MAP_DEG: f64 = 60.0;

/// Smallest half-angle of a spot light's shadow map, in degrees. A narrower cone lights nothing visible, but its map
/// needs a width.
const NARROWEST_MAP_DEG: f64 = 0.05;

/// Width, in texels, of the border of a spot light's shadow maps, outside the cone or the cube face that the map
/// covers. Filters can thus read across the edge.
const CUBE_BORDER_TEXELS: f64 = 3.0;

/// Lights of a scene that cast shadows, and the bounds of everything that shadows can fall on.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadowScene {
    /// Lights that cast shadows, each with its index in the scene.
    pub lights: Vec<(usize, Light)>,
    /// Centre, in world space, of a sphere that contains every splat and polygon.
    pub center: DVec3,
    /// Radius of the sphere in world units, greater than 0.
    pub radius: f64,
}

/// Shadow map of a light: the view from the light, in which only visibility is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadowMap {
    /// Index in the scene of the light that casts the shadows.
    pub light: usize,
    /// View of the map; its region is the whole map.
    pub view: View,
    /// Parameters by which splats are drawn into the map: exact mapping, no filter, and a tolerance that serves as
    /// bias.
    pub splat_filter: SplatFilter,
}

impl ShadowScene {
    /// Collects the lights that cast shadows and the bounds of the scene. Returns `None` if no light casts a shadow, or
    /// if the radius of the scene's bounds isn't positive and finite.
    pub fn of(scene: &Scene) -> Option<Self> {
        let lights: Vec<(usize, Light)> =
            scene.lights.iter().flatten().cloned().enumerate().filter(|(_, light)| light.casts_shadow()).collect();
        if lights.is_empty() {
            return None;
        }
        let (low, high) = bounds(scene)?;
        let center = low + (high - low) * 0.5;
        let mut radius = 0.0f64;
        for_extents(scene, |p, r| radius = radius.max((p - center).length() + r));
        (radius > 0.0 && radius.is_finite()).then_some(Self { lights, center, radius })
    }

    /// Extends the bounds by a sphere in world space.
    pub fn include(&mut self, center: DVec3, radius: f64) {
        let apart = center - self.center;
        let distance = apart.length();
        if distance + radius <= self.radius {
            return;
        }
        if distance + self.radius <= radius {
            (self.center, self.radius) = (center, radius);
            return;
        }
        let joint = 0.5 * (distance + self.radius + radius);
        self.center += apart * ((joint - self.radius) / distance);
        self.radius = joint;
    }

    /// Returns the maps of all lights, for splats with the kernel cutoff `cutoff`, in (0, 50].
    pub fn maps(&self, cutoff: f64) -> Vec<ShadowMap> {
        self.lights.iter().flat_map(|(i, light)| self.maps_of(*i, light, cutoff)).collect()
    }

    fn maps_of(&self, index: usize, light: &Light, cutoff: f64) -> Vec<ShadowMap> {
        let side = f64::from(SHADOW_MAP_SIDE);
        let map = |eye: DVec3, forward: DVec3, kind, focal: f64, near: f64| ShadowMap {
            light: index,
            view: View {
                eye,
                view_from_world: looking(forward),
                projection: Projection { kind, focal_px: [focal; 2], principal_px: [0.5 * side; 2], near },
                size: [SHADOW_MAP_SIDE; 2],
                region: Region { x: 0, y: 0, width: SHADOW_MAP_SIDE, height: SHADOW_MAP_SIDE },
            },
            splat_filter: SplatFilter {
                filter: Filter::None,
                radius_px: 0.0,
                cutoff,
                projective: kind == ProjectionKind::Perspective,
                drop_before_near: false,
                tolerance: Tolerance::Relative(SHADOW_BIAS_RADII),
            },
        };
        let r = self.radius;
        match light {
            Light::Directional { direction, shadow: true, .. } => {
                let forward = unit(DVec3::from(*direction));
                // The scene's sphere with a margin of two texels, between depths of 0.1 and 2.1 radii.
                let height = 2.0 * r * side / (side - 4.0);
                let kind = ProjectionKind::Orthographic { height, far: 2.2 * r };
                vec![map(self.center - forward * (1.1 * r), forward, kind, side / height, 0.05 * r)]
            }
            Light::Spot { position, direction, outer_deg, shadow: true, .. } => {
                let position = DVec3::from(*position);
                let forward = unit(DVec3::from(*direction));
                let farthest = (self.center - position).length() + r;
                // Depths are stored as floats, which have enough precision for a near plane at a thousandth of the
                // range.
                let near = 1e-3 * farthest;
                let perspective = |forward, focal| map(position, forward, ProjectionKind::Perspective, focal, near);
                if *outer_deg <= WIDEST_SINGLE_MAP_DEG {
                    let half_angle = outer_deg.max(NARROWEST_MAP_DEG).to_radians();
                    return vec![perspective(forward, (0.5 * side - CUBE_BORDER_TEXELS) / half_angle.tan())];
                }
                let (s, t) = orthonormal(forward);
                let faces = [forward, -forward, s, -s, t, -t];
                faces.into_iter().map(|face| perspective(face, 0.5 * side - CUBE_BORDER_TEXELS)).collect()
            }
            _ => Vec::new(),
        }
    }
}

/// Returns the rotation from world axes to the axes of a view that looks along `forward`. The roll around `forward` is
/// arbitrary.
fn looking(forward: DVec3) -> DMat3 {
    let (right, down) = orthonormal(forward);
    DMat3::from_cols(right, down, forward).transpose()
}

/// Returns the bounding box of all objects, in world space.
fn bounds(scene: &Scene) -> Option<(DVec3, DVec3)> {
    let mut bounds: Option<(DVec3, DVec3)> = None;
    for_extents(scene, |p, r| {
        let (low, high) = bounds.unwrap_or((p - r, p + r));
        bounds = Some((low.min(p - r), high.max(p + r)));
    });
    bounds
}

/// Calls `each` with the world position and bounding radius of every splat, and with every vertex and the radius 0.
/// Unselected parts of an octree are included, so that the maps don't change with the selection.
fn for_extents(scene: &Scene, mut each: impl FnMut(DVec3, f64)) {
    for object in &scene.objects {
        let m = &object.world_from_object;
        match &object.geometry {
            Geometry::Splats(cloud) => for_splats(cloud, m, &mut each),
            Geometry::Mesh(mesh) => for_vertices(mesh, m, &mut each),
            // Gaussians neither cast nor receive shadows.
            Geometry::Gaussians(_) => {}
            Geometry::Octree(octree) => {
                for_splats(octree.cloud(), m, &mut each);
                for_vertices(octree.mesh(), m, &mut each);
            }
        }
    }
}

fn for_splats(cloud: &SplatCloud, world_from_object: &DAffine3, each: &mut impl FnMut(DVec3, f64)) {
    let m = world_from_object;
    for i in 0..cloud.len() {
        let at = m.transform_point3(cloud.center(i));
        if cloud.is_balls() {
            each(at, cloud.radius_max(i) * ball_scale(m));
            continue;
        }
        let (s, t) = cloud.axes(i);
        let (s, t) = (m.transform_vector3(s), m.transform_vector3(t));
        each(at, s.length().hypot(t.length()));
    }
}

fn for_vertices(mesh: &Mesh, world_from_object: &DAffine3, each: &mut impl FnMut(DVec3, f64)) {
    for i in 0..mesh.positions.len() {
        each(world_from_object.transform_point3(mesh.origin + mesh.positions.get(i)), 0.0);
    }
}
