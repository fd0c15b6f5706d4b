//! Shadow maps (§5): small pictures of what lights see.

use crate::segment::{Limits, UploadedScene};
use crate::tile::{TileData, tiles};
use crate::uniforms::{FrameScene, ShadowPlace};
use crate::words::Words;
use std::sync::Arc;
use surfel_render::{Attributes, FramePlan, Pass, Planes, SHADOW_MAP_SIDE, ShadowMap, View};
use surfel_shaders::layout;

/// Texels of a map.
const MAP_TEXELS: u32 = SHADOW_MAP_SIDE * SHADOW_MAP_SIDE;

/// Texels of a plan's maps, one at least: a binding of nothing is an error.
///
/// # Errors
/// What is wrong and what to do, if the device's buffers don't hold them.
pub fn shadow_texels(plan: &FramePlan, limits: Limits) -> Result<u64, String> {
    let maps = plan.shadow_maps.len() as u64;
    let bytes = 4 * maps * u64::from(MAP_TEXELS);
    if bytes <= limits.buffer_bytes && maps * u64::from(MAP_TEXELS) <= u64::from(u32::MAX) {
        return Ok((bytes / 4).max(1));
    }
    Err(format!(
        "{maps} shadow maps need {bytes} bytes, more than the {} of the device's buffers; let fewer lights cast shadows",
        limits.buffer_bytes
    ))
}

/// The shaders' `ShadowMap`s, one at least.
pub(crate) fn shadow_map_words(plan: &FramePlan, view: &View) -> Vec<u32> {
    use layout::shadow_map as at;
    let mut all = Vec::new();
    for (i, map) in plan.shadow_maps.iter().enumerate() {
        let mut words = Words::new(at::SIZE);
        words.mat3(at::VIEW_FROM_WORLD, map.view.view_from_world).vec3(at::EYE, view.eye - map.view.eye);
        words.u32(at::TEXELS_AT, i as u32 * MAP_TEXELS).projection(at::PROJECTION, &map.view.projection);
        all.extend(words.into_vec());
    }
    all.resize(all.len().max(at::SIZE / 4), 0);
    all
}

/// Name in the statistics of all that draws shadow maps.
pub const SHADOW_MAPS: &str = "shadow maps";

/// Shadow maps as they were drawn last: they serve again while the scene, its lights and the settings that they depend on are
/// the same, wherever the eye is.
pub struct MapCache<B> {
    /// Their texels.
    pub texels: B,
    scene: Arc<()>,
    maps: Vec<(View, FramePlan)>,
}

impl<B> MapCache<B> {
    /// Of maps that were drawn by these jobs.
    pub fn new(texels: B, scene: &UploadedScene, jobs: &[MapJob]) -> Self {
        Self { texels, scene: scene.identity.clone(), maps: jobs.iter().map(MapJob::key).collect() }
    }

    /// True if these jobs would draw the same.
    pub fn fits(&self, scene: &UploadedScene, jobs: &[MapJob]) -> bool {
        Arc::ptr_eq(&self.scene, &scene.identity) && self.maps.iter().cloned().eq(jobs.iter().map(MapJob::key))
    }
}

/// What draws a shadow map.
pub struct MapJob {
    /// Visibility, and polygons, of the scene that the plan is of.
    pub plan: FramePlan,
    /// What all tiles of the map share.
    pub frame: FrameScene,
    view: View,
}

impl MapJob {
    /// What it depends on besides the scene.
    fn key(&self) -> (View, FramePlan) {
        (self.view.clone(), self.plan.clone())
    }

    /// The map's tiles.
    pub fn tiles(&self, scene: &UploadedScene, limits: Limits) -> Vec<TileData> {
        let tiles = tiles(&self.view, &self.plan, limits);
        tiles.into_iter().map(|tile| TileData::new(scene, &self.frame, &self.view, &self.plan, tile)).collect()
    }
}

/// What draws each of a plan's shadow maps. Everything opaque casts, whichever side of it the light or the eye sees.
pub fn map_jobs(scene: &UploadedScene, plan: &FramePlan) -> Vec<MapJob> {
    let job = |(i, map): (usize, &ShadowMap)| {
        let none = Planes { color: false, ..Planes::COLOR };
        let passes = plan.passes.iter().copied().filter(|pass| *pass == Pass::Polygons);
        let own = FramePlan {
            passes: [Pass::ShadowMap].into_iter().chain(passes).collect(),
            splat_filter: map.splat_filter,
            attributes: Attributes::default(),
            shadow_maps: Vec::new(),
            planes: none,
            ..plan.clone()
        };
        let place = ShadowPlace { at: i as u32 * MAP_TEXELS };
        MapJob { frame: FrameScene::of_map(scene, &map.view, &own, place), view: map.view.clone(), plan: own }
    };
    plan.shadow_maps.iter().enumerate().map(job).collect()
}
