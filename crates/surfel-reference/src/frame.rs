//! Drawing of a frame: runs a plan's passes in order and composites transparent layers over the opaque image.

use crate::ball::{self, BallFragment, BallLayer};
use crate::edge::Edges;
use crate::eye_dome::EyeDome;
use crate::front::{Front, MeshLayer};
use crate::layer_compositor::LayerCompositor;
use crate::outlines::Outlines;
use crate::pixels::center_in;
use crate::raster::{Passes, Sums};
use crate::samples::Samples;
use crate::scene::ResidentScene;
use crate::shade::{Lighting, Surface};
use crate::{margin, nearest, shadow};
use rayon::prelude::*;
use std::time::Instant;
use surfel_math::V2;
use surfel_math::kernel::FULL_COVERAGE;
use surfel_math::srgb::limit_color;
use surfel_model::{Light, Matcap, Shader};
use surfel_render::{Frame, FramePlan, Identity, Pass, PassTime, Region, Stats, View};

/// Draws a frame by its plan, and returns statistics.
pub(crate) fn render(scene: &ResidentScene, view: &View, plan: &FramePlan, frame: &mut Frame, threads: usize) -> Stats {
    let start = Instant::now();
    let mut stats = Stats::default().with_splats(plan.splats).with_threads(threads);
    let mut lap = {
        let mut last = start;
        move |stats: &mut Stats, name| {
            let now = Instant::now();
            stats.passes.push(PassTime { name, ms: (now - last).as_secs_f64() * 1e3 });
            last = now;
        }
    };
    let headlight = [Light::Directional { direction: view.forward().to_array(), color: [1.0; 3], shadow: false }];
    let shadows = shadow::draw(scene, plan);
    if !shadows.is_empty() {
        lap(&mut stats, "shadow maps");
    }
    let lighting = Lighting {
        view,
        plan,
        shadows: &shadows,
        lights: scene.lights.as_deref().unwrap_or(&headlight),
        ambient: scene.ambient,
        matcap: scene.matcap.clone().unwrap_or_else(Matcap::builtin),
        material: scene.material.factors(),
    };
    let rect = work_rect(view, plan);
    let front = Front::draw(scene, &lighting, rect, 1.0);
    let balls = front.balls.as_ref();
    stats.drawn = (front.opaque.len() + front.transparent.len() + balls.map_or(0, |b| b.drawn)) as u64;
    stats.fragments = front.passes.fragments + front.layers.iter().map(|v| u64::from(v.fragments)).sum::<u64>();
    lap(&mut stats, "rasterise");
    let behind = plan.has(Pass::EdgeAntialiasing).then(|| front.behind_edges(&lighting, rect));
    if behind.is_some() {
        lap(&mut stats, "behind edges");
    }
    let mut image =
        OpaqueImage { behind: behind.as_ref(), ..OpaqueImage::new(&lighting, rect, scene.background, &front) };
    image.shade();
    let sampled = plan.has(Pass::EdgeSamples).then(|| Samples::draw(scene, &image, &front));
    if sampled.is_some() {
        lap(&mut stats, "edge samples");
    }
    image.resolve(&front.layers, sampled.as_ref(), frame);
    if plan.has(Pass::Nearest) {
        let found = nearest::identities(scene, &front, &lighting, rect);
        frame.index_mut().iter_mut().enumerate().for_each(|(to, index)| *index = place_in(rect, view, to) as u32);
        frame.finish(view, |at| found[at as usize]);
        lap(&mut stats, "nearest");
    } else {
        frame.finish(view, |_| Identity::NOTHING);
    }
    lap(&mut stats, "shade");
    stats.fragments += balls.map_or(0, |b| b.pixels.iter().map(|p| p.len() as u64).sum::<u64>());
    let bytes: usize = scene.objects.iter().map(|o| o.cloud.bytes()).sum();
    stats.bytes_per_splat = bytes as f64 / (scene.summary.splats.max(1)) as f64;
    stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
    stats
}

/// Converts a pixel's index `to` in the view's region to its index in the work rectangle `rect`.
fn place_in(rect: Region, view: &View, to: usize) -> usize {
    let region = view.region;
    let (x, y) = (to % region.width as usize, to / region.width as usize);
    (y + (region.y - rect.y) as usize) * rect.width as usize + x + (region.x - rect.x) as usize
}

/// Returns the candidates for the nearest splat or polygon in each pixel of the region, nearest first. Their depths
/// exceed the smallest one in the pixel by at most the fraction `relative`.
pub(crate) fn candidates(scene: &ResidentScene, view: &View, plan: &FramePlan, relative: f64) -> Vec<Vec<Identity>> {
    let plan = &FramePlan { shader: Shader::Unlit, ..plan.clone() };
    let lighting = Lighting {
        view,
        plan,
        shadows: &[],
        lights: &[],
        ambient: scene.ambient,
        matcap: Matcap::builtin(),
        material: scene.material.factors(),
    };
    let rect = work_rect(view, plan);
    let front = Front::draw(scene, &lighting, rect, 1.0);
    let all = nearest::all(scene, &nearest::candidates(scene, &front, &lighting, rect, relative));
    (0..view.region.width as usize * view.region.height as usize)
        .map(|to| all[place_in(rect, view, to)].clone())
        .collect()
}

/// Returns the work rectangle, over which all passes run. It is the view's region, enlarged on each side by the number
/// of neighbouring pixels that passes read, and limited to the image.
fn work_rect(view: &View, plan: &FramePlan) -> Region {
    view.region.grown(plan.reach_px(), view.size)
}

/// Opaque image of a frame: the results of the passes in each pixel of the work rectangle, and the shaded nearest
/// surfaces.
pub(crate) struct OpaqueImage<'a> {
    pub lighting: &'a Lighting<'a>,
    pub rect: Region,
    background: [f64; 4],
    front: &'a Passes,
    /// Passes over the surfaces behind edges, and a flag per pixel, true for edge pixels; `None` without edge
    /// antialiasing by coverage.
    behind: Option<&'a (Passes, Vec<bool>)>,
    meshes: Option<&'a MeshLayer<'a>>,
    balls: Option<&'a BallLayer>,
    /// Eye-dome lighting computed from the nearest surfaces; `None` if the plan has none, and until [`Self::shade`]
    /// runs.
    eye_dome: Option<EyeDome<'a>>,
    /// Outlines detected between the nearest surfaces; `None` if the plan has none, and until [`Self::shade`] runs.
    outlines: Option<Outlines<'a>>,
    /// Shaded nearest surface of each pixel in the work rectangle, `None` in empty pixels, and true if rounding could
    /// change it. The vector is empty until [`Self::shade`] runs.
    pixels: Vec<(Option<Surface>, bool)>,
}

impl<'a> OpaqueImage<'a> {
    /// Creates the image from the results of the passes, before its surfaces are shaded.
    pub(crate) fn new(lighting: &'a Lighting<'a>, rect: Region, background: [f64; 4], front: &'a Front<'a>) -> Self {
        let (passes, meshes, balls) = (&front.passes, front.meshes.as_ref(), front.balls.as_ref());
        let (eye_dome, outlines, pixels) = (None, None, Vec::new());
        Self { lighting, rect, background, front: passes, behind: None, meshes, balls, eye_dome, outlines, pixels }
    }

    /// Shades the nearest surface of every pixel, then runs the passes that read neighbouring pixels.
    fn shade(&mut self) {
        let (rect, view) = (self.rect, self.lighting.view);
        let count = rect.width as usize * rect.height as usize;
        let this = &*self;
        let mut pixels: Vec<_> =
            (0..count).into_par_iter().map(|at| this.front_surface(at, center_in(rect, at))).collect();
        let plan = self.lighting.plan;
        self.outlines = plan.has(Pass::Outlines).then(|| Outlines::new(&pixels, rect, view));
        self.eye_dome = plan.has(Pass::EyeDome).then(|| EyeDome::new(&pixels, rect, view));
        for (at, (surface, marginal)) in pixels.iter_mut().enumerate() {
            let open;
            (*surface, open) = self.under_screen_space(*surface, at, center_in(rect, at));
            *marginal |= open;
        }
        self.pixels = pixels;
    }

    /// Applies outlines or eye-dome lighting to the surface at position `place` in pixel `at`, using the depths of
    /// neighbouring pixels. The second value is true if rounding could change the result.
    pub(crate) fn under_screen_space(
        &self,
        surface: Option<Surface>,
        at: usize,
        place: V2<f64>,
    ) -> (Option<Surface>, bool) {
        let Some(surface) = surface else { return (None, false) };
        if let Some(outlines) = &self.outlines {
            let (surface, open) = outlines.draw(at, surface, place);
            return (Some(surface), open);
        }
        let Some(dome) = &self.eye_dome else { return (Some(surface), false) };
        let (brightness, open) = dome.brightness(at, surface.depth);
        (Some(Surface { color: surface.color * brightness, ..surface }), open)
    }

    /// Returns the colour of a surface as RGBA over the background, or the background colour if there is no surface.
    pub(crate) fn over_background(&self, surface: Option<Surface>) -> [f64; 4] {
        match surface {
            Some(s) => [s.color.x, s.color.y, s.color.z, 1.0],
            None => self.background,
        }
    }

    /// Returns the nearest surface of a pixel: splats, a polygon, or splats blended over a polygon (rendering model
    /// §6). The second value is true if rounding could change the surface.
    pub(crate) fn front_surface(&self, at: usize, pixel: V2<f64>) -> (Option<Surface>, bool) {
        let sums = &self.front.sums[at];
        let mut surface = self.lighting.shade(sums, pixel);
        let mut marginal = sums.marginal;
        if let Some(meshes) = self.meshes {
            marginal |= meshes.marginal[at];
            if meshes.depth[at].is_finite() {
                let polygon = self.lighting.shade_polygon(&meshes.hits[at], &meshes.polygons, pixel);
                let share = (sums.coverage / FULL_COVERAGE).min(1.0);
                surface = Some(surface.map_or(polygon, |splats| splats.blended_over(&polygon, share)));
            }
        }
        (surface, marginal || surface.is_some_and(|s| s.marginal))
    }

    /// Returns the depth of the nearest surface or transparent layer in a pixel, ignoring balls; +∞ if there is none.
    pub(crate) fn shown_depth(&self, at: usize, layers: &[LayerCompositor]) -> f64 {
        let surface = self.front_surface(at, center_in(self.rect, at)).0.map_or(f64::INFINITY, |s| s.depth);
        let layer = layers.get(at).and_then(|layers| layers.nearest.as_ref());
        layer.map_or(surface, |layer| layer.depth.min(surface))
    }

    /// Fills the frame's planes. `layers` has the transparent layers of each pixel, or is empty without transparent
    /// splats.
    fn resolve(&self, layers: &[LayerCompositor], samples: Option<&Samples>, frame: &mut Frame) {
        let (view, planes) = (self.lighting.view, self.lighting.plan.planes);
        let (region, rect) = (view.region, self.rect);
        frame.reset(region.width, region.height, planes);
        let edge_margin = match self.behind {
            Some(_) if planes.margin => {
                let polygons = self.meshes.map_or(&[][..], |m| &m.hits);
                Edges { passes: self.front, polygons, rect }.marginal()
            }
            _ => Vec::new(),
        };
        for y in 0..region.height {
            for x in 0..region.width {
                let (px, py) = (region.x + x, region.y + y);
                let from = ((py - rect.y) * rect.width + px - rect.x) as usize;
                let to = (y * region.width + x) as usize;
                let pixel = center_in(rect, from);
                let transparent = layers.get(from);
                let opaque = self.opaque(from, pixel);
                let balls = ball::between(BallLayer::of(self.balls, from), 0.0, opaque.ends);
                let mut opaque = self.with_layers(opaque, transparent, balls);
                if let Some(samples) = samples {
                    if let Some(sampled) = samples.of(from) {
                        opaque.color = sampled.color;
                        opaque.marginal |= sampled.marginal;
                    }
                    opaque.marginal |= samples.marginal(from);
                }
                if planes.color {
                    frame.color_mut()[to] = opaque.color.map(|c| limit_color(c) as f32);
                }
                if let Some(s) = opaque.surface {
                    if planes.depth {
                        frame.depth_mut()[to] = s.depth as f32;
                    }
                    if planes.normal {
                        frame.normal_mut()[to] = s.normal.as_vec3().to_array();
                    }
                    if planes.weight {
                        frame.weight_mut()[to] = s.weight as f32;
                    }
                }
                if planes.fragments {
                    frame.fragments_mut()[to] =
                        self.front.sums[from].fragments + transparent.map_or(0, |v| v.fragments) + balls.len() as u32;
                }
                if planes.margin {
                    let marginal = opaque.marginal || edge_margin.get(from).is_some_and(|&m| m);
                    frame.margin_mut()[to] = f32::from(u8::from(marginal));
                }
            }
        }
    }

    /// Composites the transparent layers and the fragments of balls in front of the opaque surface over a pixel. The
    /// pixel's surface becomes that of the nearest layer, or of a solid ball in front of it.
    fn with_layers(&self, mut pixel: Pixel, transparent: Option<&LayerCompositor>, balls: &[BallFragment]) -> Pixel {
        let none = LayerCompositor::default();
        let layers = transparent.unwrap_or(&none);
        let depths: Vec<f64> = layers.depths().chain([pixel.ends]).collect();
        pixel.color = layers.over(balls, pixel.color);
        pixel.surface = layers.nearest.or(pixel.surface);
        pixel.marginal |= layers.marginal | ball::is_marginal(balls, &depths);
        if let Some(shown) = ball::shown(balls)
            && pixel.surface.is_none_or(|surface| shown.z < surface.depth)
        {
            pixel.surface = Some(shown.surface);
        }
        pixel
    }

    /// Returns a pixel of the opaque image. At an edge, the surface behind the nearest one is blended in by coverage.
    fn opaque(&self, at: usize, pixel: V2<f64>) -> Pixel {
        let (surface, mut marginal) = self.pixels[at];
        let mut color = self.over_background(surface);
        let mut ends = surface.map_or(f64::INFINITY, |s| s.depth);
        if let Some((behind, edges)) = self.behind {
            marginal |= behind.sums[at].marginal;
            // Pixels with a threshold but without a filtered fragment count as edges too; their coverage is 0.
            if edges[at] {
                let q = self.front.sums[at].coverage.min(1.0);
                let back = self.behind_edge(&behind.sums[at], at, pixel);
                marginal |= back.is_some_and(|s| s.marginal);
                let back = self.under_eye_dome(back, at);
                let end = back.map_or(f64::INFINITY, |s| s.depth);
                ends = ends.min(end);
                let balls = ball::between(BallLayer::of(self.balls, at), ends, end);
                marginal |= ball::is_marginal(balls, &[ends, end]);
                let behind = LayerCompositor::default().over(balls, self.over_background(back));
                for (c, b) in color.iter_mut().zip(behind) {
                    *c = q * *c + (1.0 - q) * b;
                }
            }
        }
        Pixel { color, surface, ends, marginal }
    }

    /// Applies eye-dome lighting to the surface behind an edge pixel, by comparing its depth with the nearest surfaces
    /// of the neighbours.
    fn under_eye_dome(&self, surface: Option<Surface>, at: usize) -> Option<Surface> {
        let Some(dome) = &self.eye_dome else { return surface };
        surface.map(|s| Surface { color: s.color * dome.brightness(at, s.depth).0, ..s })
    }

    /// Returns the surface behind an edge pixel: splats or the nearest polygon, whichever is nearer.
    fn behind_edge(&self, sums: &Sums, at: usize, pixel: V2<f64>) -> Option<Surface> {
        let splats = self.lighting.shade(sums, pixel);
        // Behind a pixel without a threshold, there is only the background.
        let has_threshold = self.front.thresholds[at].depth.is_finite();
        match self.meshes {
            Some(meshes) if has_threshold && meshes.hits[at].z < sums.resolved_depth() => {
                let mut polygon = self.lighting.shade_polygon(&meshes.hits[at], &meshes.polygons, pixel);
                polygon.marginal |= meshes.hits[at].marginal || margin::on_depth(polygon.depth, sums.resolved_depth());
                Some(polygon)
            }
            _ => splats,
        }
    }
}

/// Pixel of the opaque image, with everything that the frame's planes need.
struct Pixel {
    /// Colour as linear premultiplied RGBA.
    color: [f64; 4],
    surface: Option<Surface>,
    /// Depth of the nearest opaque surface, up to which layers and balls are composited; +∞ without one.
    ends: f64,
    marginal: bool,
}
