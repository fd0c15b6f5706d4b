//! Scene of an octree of splats and polygons.

use super::Case;
use crate::build::{camera, cloud, object, scene};
use crate::polygons::{mesh, mesh_object, mesh_sphere};
use glam::{DAffine3, DVec3};
use std::sync::Arc;
use surfel_model::{Cull, EdgeAa, Geometry, Light, Octree, Scene, Shader};
use surfel_render::{Selection, View, select};
use surfel_sample::{NoProgress, OctreeOptions, octree_from_mesh};

/// Value of `--lod-error` for [`octree`], in pixels. It is so large that the near end is drawn as polygons, the middle
/// as splats of leaves, and the far end as splats of higher nodes.
pub const OCTREE_ERROR_PX: f64 = 5.5;

/// Background of [`octree`], a colour that no other scene has.
pub const OCTREE_BACKGROUND: [f64; 4] = [0.11, 0.02, 0.07, 0.5];

pub(super) fn octree_cases() -> Vec<Case> {
    let octree = octree();
    vec![octree.with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage), octree]
}

/// Returns a long ball that points at the eye, as an octree of polygons and splats. Nodes are selected for the view.
/// Catches transition splats that are missing or drawn twice, and nodes that are drawn together with their parents or
/// children.
pub fn octree() -> Case {
    octree_by(|octree, view| select(octree, &DAffine3::IDENTITY, Cull::Back, view, OCTREE_ERROR_PX))
}

/// Returns the scene [`octree`] with another selection of the octree's parts.
///
/// # Panics
/// If the octree can't be built: scenes are written in code, not read.
pub fn octree_by(choose: impl FnOnce(&Octree, &View) -> Selection) -> Case {
    let ball = mesh_sphere(3);
    let vertices: Vec<DVec3> =
        (0..ball.positions.len()).map(|i| ball.positions.get(i) * DVec3::new(0.6, 0.5, 2.2)).collect();
    let mut mesh = mesh(&vertices, ball.triangles);
    let color = |p: &DVec3| [0.5 + 0.3 * (4.0 * p.x).sin(), 0.5 + 0.3 * (2.0 * p.z).cos(), 0.6].map(|c| c as f32);
    mesh.colors = Some(vertices.iter().map(color).collect());
    let options = OctreeOptions { leaf_triangles: 24, splats_per_side: 6, ..OctreeOptions::default() };
    let octree = octree_from_mesh(&mesh, &options, &NoProgress).expect("the ball has triangles");
    let mut camera = camera(0.0, 40.0, [72, 56]);
    (camera.eye, camera.target) = ([1.5, 1.0, 3.6], [0.1, 0.0, 0.6]);
    let view = View::new(&camera).expect("cases have valid cameras");
    let scene = Scene { background: OCTREE_BACKGROUND, ..scene_of(&octree, &choose(&octree, &view)) };
    Case::new("octree", scene, camera).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns a scene of the selected parts of an octree, arranged as by `surfel::at_detail`, with a light above the eye.
///
/// # Panics
/// If the parts are invalid, like [`octree_by`].
pub fn scene_of(octree: &Octree, selection: &Selection) -> Scene {
    let mut splats = object(cloud(&[]));
    let chosen = octree.cloud_of(&selection.splats).expect("parts of a valid cloud are valid");
    splats.geometry = Geometry::Splats(Arc::new(chosen));
    let mut objects = vec![splats];
    if !selection.triangles.is_empty() {
        objects.push(mesh_object(octree.mesh_of(&selection.triangles)));
    }
    for object in &mut objects {
        object.material.cull = Cull::Back;
    }
    let lights = vec![Light::Directional { direction: [-0.4, -0.7, -1.0], color: [0.8; 3], shadow: false }];
    Scene { objects, lights: Some(lights), ..scene(&[]) }
}

/// Removes the transition splats, which are on the edges between leaves, from a selection.
pub fn without_transitions(octree: &Octree, mut selection: Selection) -> Selection {
    let first = octree.transitions().first().map_or(u32::MAX, |t| t.splats.start);
    selection.splats.retain(|splats| splats.start < first);
    selection
}
