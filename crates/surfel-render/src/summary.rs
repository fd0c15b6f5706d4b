//! Summary of a scene for planning, computed once when the scene is uploaded.

use crate::{Selection, ShadowScene};
use glam::DAffine3;
use std::sync::Arc;
use surfel_model::{Cull, Geometry, Light, Octree, Scene, Shape};

/// An object that draws an octree. For each view, a plan selects parts of the octree.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneOctree {
    /// Index in the scene of the object that draws the octree.
    pub object: usize,
    /// The octree that the object draws.
    pub octree: Arc<Octree>,
    /// Matrix of the object, from object to world space.
    pub world_from_object: DAffine3,
    /// Faces that the object's material culls.
    pub cull: Cull,
}

/// Colour space in which a scene's Gaussians are blended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GaussianColors {
    /// Displayed (sRGB-encoded) colours are blended.
    Displayed,
    /// Linear colours are blended.
    Linear,
    /// Some clouds need displayed colours and others linear ones, so that they can't be blended with each other.
    Mixed,
}

/// Properties of a scene from which frames are planned.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneSummary {
    /// Number of splats, including all splats of octrees and all Gaussians, but not balls.
    pub splats: u64,
    /// Number of balls and dots.
    pub balls: u64,
    /// True if some balls' radii are in pixels.
    pub has_balls_in_pixels: bool,
    /// True if the scene has a sky whose light isn't stored in the splats yet.
    pub has_sky: bool,
    /// True if some cloud, mesh or octree has colours or a texture.
    pub colors: bool,
    /// True if some splat, other than balls and Gaussians, has an alpha below 1.
    pub transparent: bool,
    /// True if some cloud has splats that are cut by clip curves or lines.
    pub clips: bool,
    /// True if some object is a mesh. Octrees count only in the summary of a view's selected parts, if polygons are
    /// selected.
    pub meshes: bool,
    /// True if objects differ in ambient, diffuse, specular or shininess.
    pub materials_differ: bool,
    /// True if the direction to some light depends on the position of the lit surface, as for spot lights.
    pub has_local_lights: bool,
    /// Lights that cast shadows, and the bounds of the scene; `None` if no light casts shadows or the scene is empty.
    pub shadows: Option<ShadowScene>,
    /// Objects that are octrees.
    pub octrees: Vec<SceneOctree>,
    /// Colour space in which the scene's Gaussians are blended; `None` without Gaussians.
    pub gaussians: Option<GaussianColors>,
    /// True if some object is drawn as a surface, not as Gaussians.
    pub surfaces: bool,
    /// Index of the first object of splats (not balls) that has no interior weight
    /// ([`CloudData::interior_weight`](surfel_model::CloudData::interior_weight)), the sum of weights inside its
    /// surface; `None` if all have one. Without it, images that need it
    /// ([`needs_interior_weight`](crate::needs_interior_weight)) can't be drawn.
    pub without_interior_weight: Option<usize>,
    /// Index of the first object whose splats or balls have no rows (their numbers in the input file); octrees never
    /// have them. `None` if all objects with splats have rows.
    pub without_rows: Option<usize>,
    /// True if some cloud is oriented and its back faces are drawn, so that both sides of its surface may be visible.
    pub both_facings: bool,
}

impl SceneSummary {
    /// Collects the properties of a scene.
    pub fn of(scene: &Scene) -> Self {
        let has_local_lights = scene.lights.iter().flatten().any(|light| !matches!(light, Light::Directional { .. }));
        let has_sky = scene.sky.is_some();
        let mut summary = Self { has_local_lights, has_sky, shadows: ShadowScene::of(scene), ..Self::default() };
        let mut first_factors = None;
        for (i, object) in scene.objects.iter().enumerate() {
            summary.surfaces |= !matches!(object.geometry, Geometry::Gaussians(_));
            match &object.geometry {
                Geometry::Splats(cloud) if cloud.is_balls() => {
                    summary.balls += cloud.len() as u64;
                    let is_in_pixels = matches!(cloud.data().shape, Shape::Balls { in_pixels: true, .. });
                    summary.has_balls_in_pixels |= is_in_pixels;
                    summary.colors |= cloud.data().colors.is_some();
                    if cloud.data().rows.is_none() {
                        summary.without_rows.get_or_insert(i);
                    }
                }
                Geometry::Splats(cloud) => {
                    let data = cloud.data();
                    summary.splats += cloud.len() as u64;
                    summary.colors |= data.colors.is_some();
                    summary.transparent |= cloud.is_transparent();
                    summary.clips |= data.clips.is_some();
                    if data.rows.is_none() {
                        summary.without_rows.get_or_insert(i);
                    }
                    if object.material.interior_weight.or(data.interior_weight).is_none() {
                        summary.without_interior_weight.get_or_insert(i);
                    }
                    summary.both_facings |= object.material.is_oriented(cloud) && object.material.cull == Cull::None;
                }
                Geometry::Octree(octree) => {
                    let (cloud, data) = (octree.cloud(), octree.cloud().data());
                    summary.without_rows.get_or_insert(i);
                    summary.splats += cloud.len() as u64;
                    summary.colors |= data.colors.is_some() || octree.mesh().colors.is_some();
                    summary.colors |= octree.mesh().texture.is_some();
                    summary.transparent |= cloud.is_transparent();
                    summary.clips |= data.clips.is_some();
                    if object.material.interior_weight.or(data.interior_weight).is_none() {
                        summary.without_interior_weight.get_or_insert(i);
                    }
                    summary.both_facings |= object.material.is_oriented(cloud) && object.material.cull == Cull::None;
                    let (world_from_object, cull) = (object.world_from_object, object.material.cull);
                    summary.octrees.push(SceneOctree { object: i, octree: octree.clone(), world_from_object, cull });
                }
                Geometry::Gaussians(cloud) => {
                    summary.splats += cloud.len() as u64;
                    let linear = cloud.data().linear_colors;
                    let colors = if linear { GaussianColors::Linear } else { GaussianColors::Displayed };
                    let first = *summary.gaussians.get_or_insert(colors);
                    summary.gaussians = Some(if first == colors { first } else { GaussianColors::Mixed });
                }
                Geometry::Mesh(mesh) => {
                    summary.meshes = true;
                    summary.colors |= mesh.colors.is_some() || mesh.is_textured();
                }
            }
            let factors = object.material.factors();
            summary.materials_differ |= *first_factors.get_or_insert(factors) != factors;
        }
        summary
    }

    /// Returns the summary of the selected parts of the octrees, one selection for each, as if they were clouds and
    /// meshes.
    pub(crate) fn of_selected<'a>(&self, selections: impl Iterator<Item = &'a Selection>) -> Self {
        let all: u64 = self.octrees.iter().map(|o| o.octree.cloud().len() as u64).sum();
        let mut chosen = Self { splats: self.splats - all, octrees: Vec::new(), ..self.clone() };
        for selection in selections {
            chosen.splats += selection.splats.iter().map(|range| range.len() as u64).sum::<u64>();
            chosen.meshes |= !selection.triangles.is_empty();
        }
        chosen
    }

    /// True if a view may show polygons.
    pub fn may_have_polygons(&self) -> bool {
        self.meshes || !self.octrees.is_empty()
    }
}
