//! Results of the passes in each pixel of a frame, before shading.

use crate::ball::{BallFragment, BallLayer};
use crate::edge::Edges;
use crate::layer_compositor::LayerCompositor;
use crate::polygon::{Hit, Polygons};
use crate::raster::{Bands, DepthLimits, Passes, Run, Sums};
use crate::scene::ResidentScene;
use crate::shade::Lighting;
use crate::splat::{ScreenSplat, project_all};
use crate::threshold::Threshold;
use crate::{abuffer, margin, peeling};
use surfel_render::{Pass, Region};

/// Results of the passes over a rectangle: opaque surfaces before shading, balls and transparent layers.
pub(crate) struct Front<'a> {
    pub(crate) opaque: Vec<ScreenSplat>,
    pub(crate) bands: Bands,
    pub(crate) passes: Passes,
    pub(crate) meshes: Option<MeshLayer<'a>>,
    pub(crate) transparent: Vec<ScreenSplat>,
    /// Fragments of the frame's balls; `None` if the plan draws no balls.
    pub(crate) balls: Option<BallLayer>,
    /// Transparent layers of each pixel, nearest first; empty if the frame has no transparent splats.
    pub(crate) layers: Vec<LayerCompositor>,
}

impl<'a> Front<'a> {
    /// Runs the passes over `rect`. `pixel_px` is the width of an image pixel in pixels of the view, by which decision
    /// margins are scaled. It exceeds 1 if the view is a finer image of samples.
    pub(crate) fn draw(scene: &'a ResidentScene, lighting: &Lighting<'a>, rect: Region, pixel_px: f64) -> Self {
        let (view, plan) = (lighting.view, lighting.plan);
        let mut splats = project_all(&scene.objects, view, plan);
        splats.iter_mut().for_each(|splat| splat.rim_px *= pixel_px);
        let is_transparent = |s: &ScreenSplat| plan.separates_transparent && s.alpha < 1.0;
        let (transparent, opaque): (Vec<_>, Vec<_>) = splats.into_iter().partition(is_transparent);
        let bands = Bands::new(&opaque, rect);
        let run = Run { keeps_facings: plan.keeps_facings, ..Run::new(&opaque, &bands, view, plan) };
        let thresholds = run.thresholds();
        let meshes = plan.has(Pass::Polygons).then(|| MeshLayer::new(scene, lighting, rect, &thresholds, pixel_px));
        let limits = DepthLimits { polygon: meshes.as_ref().map(|m| m.depth.as_slice()), ..DepthLimits::default() };
        let passes = Run { limits, ..run }.accumulate(thresholds);
        let balls = plan.has(Pass::Balls).then(|| BallLayer::draw(&scene.objects, lighting, rect));
        let mut front = Self { opaque, bands, passes, meshes, transparent, balls, layers: Vec::new() };
        if !front.transparent.is_empty() {
            front.layers = front.layers(lighting, rect);
        }
        front
    }

    /// Draws the transparent layers of every pixel by the plan's method.
    pub(crate) fn layers(&self, lighting: &Lighting, rect: Region) -> Vec<LayerCompositor> {
        let bands = Bands::new(&self.transparent, rect);
        let opaque_depth = self.opaque_depth();
        let transparent =
            peeling::TransparentSplats { splats: &self.transparent, bands: &bands, opaque_depth: &opaque_depth, rect };
        match lighting.plan.has(Pass::ABuffer) {
            true => abuffer::gather(&transparent, lighting),
            false => peeling::peel(&transparent, lighting),
        }
    }

    /// Runs the visibility and attribute passes over the transparent splats in front of opaque surfaces, as if these
    /// splats were opaque. Their thresholds and sums give the depths of the nearest transparent surfaces. `None` if
    /// there are no transparent splats.
    pub(crate) fn nearest_transparent(&self, lighting: &Lighting, rect: Region) -> Option<Passes> {
        if self.transparent.is_empty() {
            return None;
        }
        let bands = Bands::new(&self.transparent, rect);
        let opaque_depth = self.opaque_depth();
        let limits = DepthLimits { up_to: Some(&opaque_depth), ..DepthLimits::default() };
        let run = Run { limits, ..Run::new(&self.transparent, &bands, lighting.view, lighting.plan) };
        Some(run.accumulate(run.thresholds()))
    }

    /// Returns the depth of the nearest opaque surface in each pixel; +∞ without one. Fragments of opaque balls count
    /// only if they cover the whole pixel.
    pub(crate) fn opaque_depth(&self) -> Vec<f64> {
        let mut depths: Vec<f64> = self.passes.sums.iter().map(Sums::resolved_depth).collect();
        if let Some(meshes) = &self.meshes {
            depths.iter_mut().zip(&meshes.depth).for_each(|(z, polygon)| *z = z.min(*polygon));
        }
        if let Some(balls) = &self.balls {
            let full = |fragments: &Vec<BallFragment>| fragments.iter().find(|f| f.alpha >= 1.0).map(|f| f.z);
            depths.iter_mut().zip(&balls.pixels).for_each(|(z, of)| *z = z.min(full(of).unwrap_or(f64::INFINITY)));
        }
        depths
    }

    /// Runs the passes over the surfaces behind edges. The second value has a flag per pixel, true for edge pixels. A
    /// pixel that shows a polygon isn't one.
    pub(crate) fn behind_edges(&self, lighting: &Lighting, rect: Region) -> (Passes, Vec<bool>) {
        let (front, polygons) = (&self.passes, self.meshes.as_ref().map_or(&[][..], |m| &m.hits));
        let mut edges = Edges { passes: front, polygons, rect }.pixels();
        if let Some(meshes) = &self.meshes {
            edges.iter_mut().zip(&meshes.depth).for_each(|(edge, z)| *edge &= z.is_infinite());
        }
        // The limit is also +∞ at an edge pixel without a threshold, since nothing is drawn behind it.
        let limit: Vec<f64> = front
            .thresholds
            .iter()
            .zip(&edges)
            .map(|(t, &edge)| if edge { t.writer_depth } else { f64::INFINITY })
            .collect();
        let limits = DepthLimits { beyond: Some(&limit), ..DepthLimits::default() };
        let run = Run { limits, ..Run::new(&self.opaque, &self.bands, lighting.view, lighting.plan) };
        (run.accumulate(run.thresholds()), edges)
    }
}

/// Nearest polygons of a frame, per pixel of the rectangle over which the passes run.
pub(crate) struct MeshLayer<'a> {
    pub(crate) polygons: Polygons<'a>,
    /// Nearest polygon of each pixel, whether a splat occludes it or not.
    pub(crate) hits: Vec<Hit>,
    /// Depth of the nearest polygon in each pixel; +∞ if a splat occludes it or if there is none.
    pub(crate) depth: Vec<f64>,
    /// Flag per pixel, true if rounding could change the polygon or whether a splat occludes it.
    pub(crate) marginal: Vec<bool>,
}

impl<'a> MeshLayer<'a> {
    pub(crate) fn new(
        scene: &'a ResidentScene,
        lighting: &Lighting<'a>,
        rect: Region,
        thresholds: &[Threshold],
        pixel_px: f64,
    ) -> Self {
        let plan = lighting.plan;
        let polygons = Polygons::new(&scene.meshes, lighting.view, plan);
        let hits = polygons.nearest(rect, plan.planes.margin.then_some(margin::RIM_PX * pixel_px));
        let pairs = || hits.iter().zip(thresholds);
        let depth = pairs().map(|(h, t)| if h.z <= t.depth { h.z } else { f64::INFINITY }).collect();
        let marginal = pairs().map(|(h, t)| h.marginal && h.z <= t.depth || margin::on_depth(h.z, t.depth)).collect();
        Self { polygons, hits, depth, marginal }
    }
}
