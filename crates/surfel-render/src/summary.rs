//! What planning needs to know of a scene: counted once, when it is uploaded.

use crate::{Selection, ShadowScene};
use glam::DAffine3;
use std::sync::Arc;
use surfel_model::{Cull, Geometry, Light, Octree, Scene};

/// An object that is an octree: a plan chooses what of it is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneOctree {
    /// Index of the object.
    pub object: usize,
    /// The octree.
    pub octree: Arc<Octree>,
    /// The object's placement.
    pub world_from_object: DAffine3,
    /// What the object's material leaves out.
    pub cull: Cull,
}

/// In which space the colours of a scene's Gaussians blend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GaussianColors {
    /// As displayed (sRGB-encoded).
    Displayed,
    /// Linear light.
    Linear,
    /// Some so, some so: they can't be blended with each other.
    Mixed,
}

/// What planning needs to know of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneSummary {
    /// Number of splats, all of the octrees' among them.
    pub splats: u64,
    /// Some cloud or mesh has colours.
    pub colors: bool,
    /// Some splat has an alpha below 1.
    pub transparent: bool,
    /// Some cloud has clip curves or lines.
    pub clips: bool,
    /// Some object is drawn as polygons.
    pub meshes: bool,
    /// Objects differ in ambient, diffuse, specular or shininess.
    pub materials_differ: bool,
    /// Some light's direction depends on where a surface is.
    pub lights_nearby: bool,
    /// Lights that cast shadows, and what they fall on.
    pub shadows: Option<ShadowScene>,
    /// Objects that are octrees.
    pub octrees: Vec<SceneOctree>,
    /// Some object is of Gaussians, which have such colours.
    pub gaussians: Option<GaussianColors>,
    /// Some object isn't of Gaussians.
    pub surfaces: bool,
    /// First object of splats whose interior weight is unknown.
    pub without_interior_weight: Option<usize>,
    /// First object of splats without rows, or that is an octree, which has none.
    pub without_rows: Option<usize>,
    /// Some cloud is oriented and shows its back faces, too.
    pub both_facings: bool,
}

impl SceneSummary {
    /// Summarises a scene.
    pub fn of(scene: &Scene) -> Self {
        let lights_nearby = scene.lights.iter().flatten().any(|light| !matches!(light, Light::Directional { .. }));
        let mut summary = Self { lights_nearby, shadows: ShadowScene::of(scene), ..Self::default() };
        let mut first_factors = None;
        for (i, object) in scene.objects.iter().enumerate() {
            summary.surfaces |= !matches!(object.geometry, Geometry::Gaussians(_));
            match &object.geometry {
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

    /// The summary of what is chosen of the octrees, one selection for each: as if they were clouds and meshes.
    pub(crate) fn of_chosen<'a>(&self, selections: impl Iterator<Item = &'a Selection>) -> Self {
        let all: u64 = self.octrees.iter().map(|o| o.octree.cloud().len() as u64).sum();
        let mut chosen = Self { splats: self.splats - all, octrees: Vec::new(), ..self.clone() };
        for selection in selections {
            chosen.splats += selection.splats.iter().map(|range| range.len() as u64).sum::<u64>();
            chosen.meshes |= !selection.triangles.is_empty();
        }
        chosen
    }

    /// True if polygons may be among what a view shows.
    pub fn may_have_polygons(&self) -> bool {
        self.meshes || !self.octrees.is_empty()
    }
}
