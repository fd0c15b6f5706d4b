//! What planning needs to know of a scene: counted once, when it is uploaded.

use crate::ShadowScene;
use surfel_model::{Geometry, Light, Scene};

/// What planning needs to know of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneSummary {
    /// Number of splats.
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
    /// First object of splats whose interior weight is unknown.
    pub without_interior_weight: Option<usize>,
}

impl SceneSummary {
    /// Summarises a scene.
    pub fn of(scene: &Scene) -> Self {
        let lights_nearby = scene.lights.iter().flatten().any(|light| !matches!(light, Light::Directional { .. }));
        let mut summary = Self { lights_nearby, shadows: ShadowScene::of(scene), ..Self::default() };
        let mut first_factors = None;
        for (i, object) in scene.objects.iter().enumerate() {
            match &object.geometry {
                Geometry::Splats(cloud) => {
                    let data = cloud.data();
                    summary.splats += cloud.len() as u64;
                    summary.colors |= data.colors.is_some();
                    summary.transparent |= cloud.is_transparent();
                    summary.clips |= data.clips.is_some();
                    if object.material.interior_weight.or(data.interior_weight).is_none() {
                        summary.without_interior_weight.get_or_insert(i);
                    }
                }
                Geometry::Mesh(mesh) => {
                    summary.meshes = true;
                    summary.colors |= mesh.colors.is_some() || mesh.texture.is_some();
                }
            }
            let factors = object.material.factors();
            summary.materials_differ |= *first_factors.get_or_insert(factors) != factors;
        }
        summary
    }
}
