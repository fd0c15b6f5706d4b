//! One frame: the plan's passes in order, and what they give each pixel.

use crate::edge::Edges;
use crate::eye_dome::EyeDome;
use crate::polygon::{Hit, Polygons};
use crate::raster::{Bands, Kept, Limits, Passes, Run, Sums};
use crate::renderer::ResidentScene;
use crate::shade::{Lighting, Surface};
use crate::splat::{ScreenSplat, project_all};
use crate::veil::Veil;
use crate::{abuffer, layers, margin, outline, shadow};
use rayon::prelude::*;
use std::time::Instant;
use surfel_math::V2;
use surfel_math::kernel::FULL_COVERAGE;
use surfel_model::{Light, Matcap};
use surfel_render::{Frame, FramePlan, Pass, PassTime, Region, Stats, View};

/// Draws a planned frame.
pub(crate) fn render(scene: &ResidentScene, view: &View, plan: &FramePlan, frame: &mut Frame, threads: usize) -> Stats {
    let start = Instant::now();
    let mut stats = Stats { splats: scene.summary.splats, threads, ..Stats::default() };
    let mut lap = {
        let mut last = start;
        move |stats: &mut Stats, name| {
            let now = Instant::now();
            stats.passes.push(PassTime { name, ms: (now - last).as_secs_f64() * 1e3 });
            last = now;
        }
    };
    let splats = project_all(&scene.objects, view, plan);
    stats.drawn = splats.len() as u64;
    let is_transparent = |s: &ScreenSplat| plan.separates_transparent && s.alpha < 1.0;
    let (transparent, opaque): (Vec<_>, Vec<_>) = splats.into_iter().partition(is_transparent);
    lap(&mut stats, "project");

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
    let bands = Bands::new(&opaque, rect);
    let run = Run::new(&opaque, &bands, view, plan);
    let kept = run.kept();
    let mesh_layer = plan.has(Pass::Polygons).then(|| MeshLayer::new(scene, view, plan, rect, &kept));
    let limits = Limits { polygon: mesh_layer.as_ref().map(|m| m.depth.as_slice()), ..Limits::default() };
    let front = Run { limits, ..run }.passes(kept);
    stats.fragments = front.fragments;
    lap(&mut stats, "rasterise");
    let behind = plan.has(Pass::EdgeAntialiasing).then(|| {
        let polygons = mesh_layer.as_ref().map_or(&[][..], |m| &m.hits);
        let mut edges = Edges { passes: &front, polygons, rect }.pixels();
        if let Some(meshes) = &mesh_layer {
            edges.iter_mut().zip(&meshes.depth).for_each(|(edge, z)| *edge &= z.is_infinite());
        }
        // Where nothing is kept, nothing lies behind either.
        let limit: Vec<f64> =
            front.kept.iter().zip(&edges).map(|(k, &edge)| if edge { k.value } else { f64::INFINITY }).collect();
        let limits = Limits { beyond: Some(&limit), ..Limits::default() };
        let run = Run { limits, ..Run::new(&opaque, &bands, view, plan) };
        (run.passes(run.kept()), edges)
    });
    if behind.is_some() {
        lap(&mut stats, "behind edges");
    }
    let veils = if transparent.is_empty() {
        Vec::new()
    } else {
        let bands = Bands::new(&transparent, rect);
        let mut opaque_depth: Vec<f64> = front.sums.iter().map(Sums::resolved_depth).collect();
        if let Some(meshes) = &mesh_layer {
            opaque_depth.iter_mut().zip(&meshes.depth).for_each(|(z, polygon)| *z = z.min(*polygon));
        }
        let through = layers::Through { splats: &transparent, bands: &bands, opaque_depth: &opaque_depth, rect };
        let veils = match plan.has(Pass::ABuffer) {
            true => abuffer::gather(&through, &lighting),
            false => layers::peel(&through, &lighting),
        };
        stats.fragments += veils.iter().map(|v| u64::from(v.fragments)).sum::<u64>();
        lap(&mut stats, "transparent");
        veils
    };
    let (behind, meshes) = (behind.as_ref(), mesh_layer.as_ref());
    let mut picture = Picture {
        lighting: &lighting,
        rect,
        background: scene.background,
        front: &front,
        behind,
        meshes,
        eye_dome: None,
        pixels: Vec::new(),
    };
    picture.shade();
    picture.resolve(&veils, frame);
    lap(&mut stats, "shade");
    let bytes: usize = scene.objects.iter().map(|o| o.cloud.bytes()).sum();
    stats.bytes_per_splat = bytes as f64 / (scene.summary.splats.max(1)) as f64;
    stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
    stats
}

/// The rectangle that passes run over: the region, and where they look at neighbours, those inside the image.
fn work_rect(view: &View, plan: &FramePlan) -> Region {
    view.region.grown(plan.reach_px(), view.size)
}

/// Centre of pixel `at` of a rectangle.
pub(crate) fn center(rect: Region, at: usize) -> V2<f64> {
    let (x, y) = (at as u32 % rect.width, at as u32 / rect.width);
    V2::new(f64::from(rect.x + x) + 0.5, f64::from(rect.y + y) + 0.5)
}

/// Polygons of a frame, by pixel of the work rectangle.
struct MeshLayer<'a> {
    polygons: Polygons<'a>,
    /// The nearest ones, whatever hides them.
    hits: Vec<Hit>,
    /// Depth of those that no splat hides; +∞ elsewhere.
    depth: Vec<f64>,
    /// Rounding could flip whether a splat hides one.
    marginal: Vec<bool>,
}

impl<'a> MeshLayer<'a> {
    fn new(scene: &'a ResidentScene, view: &'a View, plan: &FramePlan, rect: Region, kept: &[Kept]) -> Self {
        let polygons = Polygons::new(&scene.meshes, view);
        let hits = polygons.nearest(rect, plan.planes.margin);
        let pairs = || hits.iter().zip(kept);
        let depth = pairs().map(|(h, k)| if h.z <= k.value { h.z } else { f64::INFINITY }).collect();
        let marginal = pairs().map(|(h, k)| h.marginal && h.z <= k.value || margin::on_depth(h.z, k.value)).collect();
        Self { polygons, hits, depth, marginal }
    }
}

/// What the passes found, ready to become pixels.
struct Picture<'a> {
    lighting: &'a Lighting<'a>,
    rect: Region,
    background: [f64; 4],
    front: &'a Passes,
    /// What lies behind edges, and which pixels are edges.
    behind: Option<&'a (Passes, Vec<bool>)>,
    meshes: Option<&'a MeshLayer<'a>>,
    /// Where the plan has it, of the front surfaces.
    eye_dome: Option<EyeDome<'a>>,
    /// Front surfaces of the work rectangle, and whether rounding could change them.
    pixels: Vec<(Option<Surface>, bool)>,
}

impl Picture<'_> {
    /// Shades the front surface of every pixel, then does what needs its neighbours.
    fn shade(&mut self) {
        let rect = self.rect;
        let count = rect.width as usize * rect.height as usize;
        let this = &*self;
        let mut pixels: Vec<_> =
            (0..count).into_par_iter().map(|at| this.front_surface(at, center(rect, at))).collect();
        if self.lighting.plan.has(Pass::Outlines) {
            outline::draw(&mut pixels, rect, self.lighting.view);
        }
        if self.lighting.plan.has(Pass::EyeDome) {
            let dome = EyeDome::new(&pixels, rect, self.lighting.view);
            for (at, (surface, marginal)) in pixels.iter_mut().enumerate() {
                let Some(surface) = surface else { continue };
                let (brightness, open) = dome.brightness(at, surface.depth);
                surface.color *= brightness;
                *marginal |= open;
            }
            self.eye_dome = Some(dome);
        }
        self.pixels = pixels;
    }

    /// The front surface of a pixel: splats, polygon, or the ones blended over the other (§6).
    fn front_surface(&self, at: usize, pixel: V2<f64>) -> (Option<Surface>, bool) {
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

    /// Fills the frame's planes. `veils` is what transparent splats add to each pixel; empty where there are none.
    fn resolve(&self, veils: &[Veil], frame: &mut Frame) {
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
                let pixel = center(rect, from);
                let veil = veils.get(from);
                let mut opaque = self.opaque(from, pixel);
                if let Some(veil) = veil {
                    opaque.color = veil.over(opaque.color);
                    opaque.surface = veil.nearest.or(opaque.surface);
                    opaque.marginal |= veil.marginal;
                }
                if planes.color {
                    frame.color[to] = opaque.color.map(|c| c as f32);
                }
                if let Some(s) = opaque.surface {
                    if planes.depth {
                        frame.depth[to] = s.depth as f32;
                    }
                    if planes.normal {
                        frame.normal[to] = s.normal.as_vec3().to_array();
                    }
                    if planes.weight {
                        frame.weight[to] = s.weight as f32;
                    }
                }
                if planes.fragments {
                    frame.fragments[to] = self.front.sums[from].fragments + veil.map_or(0, |v| v.fragments);
                }
                if planes.margin {
                    let marginal = opaque.marginal || edge_margin.get(from).is_some_and(|&m| m);
                    frame.margin[to] = f32::from(u8::from(marginal));
                }
            }
        }
    }

    /// A pixel of the opaque picture.
    fn opaque(&self, at: usize, pixel: V2<f64>) -> Pixel {
        let over = |surface: Option<Surface>| match surface {
            Some(s) => [s.color.x, s.color.y, s.color.z, 1.0],
            None => self.background,
        };
        let (surface, mut marginal) = self.pixels[at];
        let mut color = over(surface);
        if let Some((behind, edges)) = self.behind {
            marginal |= behind.sums[at].marginal;
            // Also where something is kept that has no filtered fragment there: it covers nothing.
            if edges[at] {
                let q = self.front.sums[at].coverage.min(1.0);
                let back = self.behind_edge(&behind.sums[at], at, pixel);
                marginal |= back.is_some_and(|s| s.marginal);
                let back = self.under_eye_dome(back, at);
                for (c, b) in color.iter_mut().zip(over(back)) {
                    *c = q * *c + (1.0 - q) * b;
                }
            }
        }
        Pixel { color, surface, marginal }
    }

    /// What lies behind an edge pixel, among the front surfaces about it.
    fn under_eye_dome(&self, surface: Option<Surface>, at: usize) -> Option<Surface> {
        let Some(dome) = &self.eye_dome else { return surface };
        surface.map(|s| Surface { color: s.color * dome.brightness(at, s.depth).0, ..s })
    }

    /// What lies behind an edge pixel: the splats there or the nearest polygon, whichever is in front.
    fn behind_edge(&self, sums: &Sums, at: usize, pixel: V2<f64>) -> Option<Surface> {
        let splats = self.lighting.shade(sums, pixel);
        // Nothing kept: the background.
        let anything = self.front.kept[at].value.is_finite();
        match self.meshes {
            Some(meshes) if anything && meshes.hits[at].z < sums.resolved_depth() => {
                let mut polygon = self.lighting.shade_polygon(&meshes.hits[at], &meshes.polygons, pixel);
                polygon.marginal |= meshes.hits[at].marginal || margin::on_depth(polygon.depth, sums.resolved_depth());
                Some(polygon)
            }
            _ => splats,
        }
    }
}

/// A pixel, resolved.
struct Pixel {
    /// Linear, premultiplied.
    color: [f64; 4],
    surface: Option<Surface>,
    marginal: bool,
}
