//! Shadow maps (§5): which lights cast, what they must see, and the views they see it in.

use crate::{Region, SplatFilter, View};
use glam::{DAffine3, DMat3, DVec3};
use surfel_math::basis::{orthonormal, unit};
use surfel_math::depth::Tolerance;
use surfel_math::projection::{Projection, ProjectionKind};
use surfel_model::{Filter, Geometry, Light, Mesh, Scene, SplatCloud};

/// Texels on a side of a shadow map.
pub const SHADOW_MAP_SIDE: u32 = 1024;

/// Bias of a shadow map: k of §5's ε. Measured on a ball over a floor (`tests/tests/shadows.rs`): of the light that
/// falls on surfaces that face it, k = 0 loses 7–15 %, ¼ 2–4·10⁻⁴, ½ 0.1–2·10⁻⁴, 1 at most 8·10⁻⁵; none lets light into
/// the shadow.
pub const SHADOW_BIAS_RADII: f64 = 1.0;

/// Half-angle up to which a spot light has one map, degrees; beyond, six that look all around.
const WIDEST_SINGLE_MAP_DEG: f64 = 60.0;

/// Least half-angle of a map, degrees: a narrower cone lights nothing that can be seen, but a map needs a width.
const NARROWEST_MAP_DEG: f64 = 0.05;

/// Texels beyond a cube's face that its map sees too, for filtering across its edges.
const CUBE_BORDER_TEXELS: f64 = 3.0;

/// The lights of a scene that cast shadows, and all that they can fall on.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadowScene {
    /// Index into the scene's lights, and the light.
    pub lights: Vec<(usize, Light)>,
    /// Centre of a sphere around every splat and polygon, world space.
    pub center: DVec3,
    /// Its radius, greater than 0.
    pub radius: f64,
}

/// A view from a light, for visibility alone.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadowMap {
    /// Index into the scene's lights.
    pub light: usize,
    /// What it sees; its region is the whole map.
    pub view: View,
    /// How its splats are drawn: exact and unfiltered, with the map's own tolerance for bias.
    pub splat_filter: SplatFilter,
}

impl ShadowScene {
    /// `None` if no light casts a shadow, or there is nothing that could.
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

    /// The maps of every light.
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
                // The scene's sphere with two texels to spare, between depths of 0.1 and 2.1 radii.
                let height = 2.0 * r * side / (side - 4.0);
                let kind = ProjectionKind::Orthographic { height, far: 2.2 * r };
                vec![map(self.center - forward * (1.1 * r), forward, kind, side / height, 0.05 * r)]
            }
            Light::Spot { position, direction, outer_deg, shadow: true, .. } => {
                let position = DVec3::from(*position);
                let forward = unit(DVec3::from(*direction));
                let farthest = (self.center - position).length() + r;
                // Depth is kept as a float: a thousandth of the range is near enough to the light.
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

/// Rotation from world to the axes of a view along `forward`, turned about it in some way.
fn looking(forward: DVec3) -> DMat3 {
    let (right, down) = orthonormal(forward);
    DMat3::from_cols(right, down, forward).transpose()
}

/// Box of everything, world space.
fn bounds(scene: &Scene) -> Option<(DVec3, DVec3)> {
    let mut bounds: Option<(DVec3, DVec3)> = None;
    for_extents(scene, |p, r| {
        let (low, high) = bounds.unwrap_or((p - r, p + r));
        bounds = Some((low.min(p - r), high.max(p + r)));
    });
    bounds
}

/// Calls `each` with the world position and radius of every splat and vertex: of an octree, of those that no view has
/// chosen too, so that the maps don't move with what is chosen.
fn for_extents(scene: &Scene, mut each: impl FnMut(DVec3, f64)) {
    for object in &scene.objects {
        let m = &object.world_from_object;
        match &object.geometry {
            Geometry::Splats(cloud) => for_splats(cloud, m, &mut each),
            Geometry::Mesh(mesh) => for_vertices(mesh, m, &mut each),
            // They cast and take no shadow.
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
        let (s, t) = cloud.axes(i);
        let (s, t) = (m.transform_vector3(s), m.transform_vector3(t));
        each(m.transform_point3(cloud.center(i)), s.length().hypot(t.length()));
    }
}

fn for_vertices(mesh: &Mesh, world_from_object: &DAffine3, each: &mut impl FnMut(DVec3, f64)) {
    for i in 0..mesh.positions.len() {
        each(world_from_object.transform_point3(mesh.origin + mesh.positions.get(i)), 0.0);
    }
}
