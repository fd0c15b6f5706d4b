//! Shadow maps (rendering model §5): views of lights, drawn as frames of their own.

use crate::frame::tile::TileData;
use crate::frame::tiling::tiles;
use crate::frame::uniforms::{FrameScene, MAP_TEXELS, ShadowMapSlot};
use crate::scene::limits::Limits;
use crate::scene::segment::UploadedScene;
use std::sync::Arc;
use surfel_render::{Attributes, FramePlan, Pass, Planes, ShadowMap, View};

/// Returns the number of texels of a plan's shadow maps. It is at least one, since an empty buffer can't be bound.
///
/// # Errors
/// A message that states the cause and a remedy, if the maps exceed the device's buffer size or have 2³² texels or
/// more.
pub fn shadow_texels(plan: &FramePlan, limits: Limits) -> Result<u64, String> {
    let maps = plan.shadow_maps.len() as u64;
    let bytes = 4 * maps * u64::from(MAP_TEXELS);
    if bytes <= limits.buffer_bytes && maps * u64::from(MAP_TEXELS) <= u64::from(u32::MAX) {
        return Ok((bytes / 4).max(1));
    }
    Err(format!(
        "{maps} shadow maps need {bytes} bytes, more than the {} of the device's buffers; let fewer lights cast \
         shadows",
        limits.buffer_bytes
    ))
}

/// Name of the passes that draw shadow maps, in the statistics.
pub const SHADOW_MAPS: &str = "shadow maps";

/// Cached shadow maps of an earlier frame. They are reused while the scene, its lights and the relevant settings don't
/// change, even if the camera moves.
pub struct ShadowMapCache<B> {
    /// Buffer of the maps' texels.
    pub texels: B,
    /// Identity of the scene of which the maps were drawn.
    scene: Arc<()>,
    /// Inputs of each map other than the scene: its view and its plan.
    maps: Vec<(View, FramePlan)>,
}

impl<B> ShadowMapCache<B> {
    /// Caches the maps that these jobs drew into the buffer `texels`.
    pub fn new(texels: B, scene: &UploadedScene, jobs: &[ShadowMapJob]) -> Self {
        Self { texels, scene: scene.identity.clone(), maps: jobs.iter().map(ShadowMapJob::key).collect() }
    }

    /// True if the cached maps can be reused: the scene is the same, and the jobs have the same views and plans.
    pub fn fits(&self, scene: &UploadedScene, jobs: &[ShadowMapJob]) -> bool {
        Arc::ptr_eq(&self.scene, &scene.identity) && self.maps.iter().cloned().eq(jobs.iter().map(ShadowMapJob::key))
    }
}

/// Inputs of the frame that draws one shadow map.
pub struct ShadowMapJob {
    /// Plan of the map: the passes that draw splats, polygons and balls into the map.
    pub plan: FramePlan,
    /// Uniform data that all tiles of the map share.
    pub frame: FrameScene,
    /// View of the light.
    view: View,
}

impl ShadowMapJob {
    /// Returns the cache key of the map: its inputs other than the scene.
    fn key(&self) -> (View, FramePlan) {
        (self.view.clone(), self.plan.clone())
    }

    /// Returns the data of the map's tiles, in the order in which they are drawn.
    pub fn tiles(&self, scene: &UploadedScene, limits: Limits) -> Vec<TileData> {
        let tiles = tiles(&self.view, &self.plan, limits, false);
        tiles.into_iter().map(|tile| TileData::new(scene, &self.frame, &self.view, &self.plan, tile)).collect()
    }
}

/// Returns the jobs that draw a plan's shadow maps, one per map. Everything opaque casts shadows, whichever side faces
/// the light or the eye.
pub fn shadow_map_jobs(scene: &UploadedScene, plan: &FramePlan) -> Vec<ShadowMapJob> {
    let job = |(i, map): (usize, &ShadowMap)| {
        let none = Planes::COLOR.with_color(false);
        let passes = plan.passes.iter().copied().filter(|pass| matches!(pass, Pass::Polygons | Pass::Balls));
        let own = FramePlan {
            passes: [Pass::ShadowMap].into_iter().chain(passes).collect(),
            splat_filter: map.splat_filter,
            attributes: Attributes::default(),
            shadow_maps: Vec::new(),
            keeps_facings: false,
            planes: none,
            ..plan.clone()
        };
        let slot = ShadowMapSlot { at: i as u32 * MAP_TEXELS };
        ShadowMapJob {
            frame: FrameScene::of_shadow_map(scene, &map.view, &own, slot),
            view: map.view.clone(),
            plan: own,
        }
    };
    plan.shadow_maps.iter().enumerate().map(job).collect()
}
