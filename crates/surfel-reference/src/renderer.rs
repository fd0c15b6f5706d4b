//! The backend: scenes in, frames out.

use crate::edge::{edge_pixels, marginal_edges};
use crate::raster::{self, Bands, Passes, Sums};
use crate::shade::{Lighting, Surface};
use crate::splat::{ObjectView, ScreenSplat, project};
use crate::supersample;
use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;
use surfel_math::V2;
use surfel_model::{Geometry, Light, Material, Scene, Settings, SplatCloud};
use surfel_render::{
    Capabilities, Feature, Frame, FramePlan, Pass, PassTime, Planes, Region, RenderError, RendererInfo, SceneSummary,
    Stats, View, plan,
};

const CAPABILITIES: Capabilities =
    Capabilities { backend: "reference", features: &[Feature::EdgeAntialiasing, Feature::Clips, Feature::Margin] };

/// The f64 reference backend.
pub struct Renderer {
    info: RendererInfo,
    pool: rayon::ThreadPool,
}

/// A scene as the reference holds it: shared clouds and what belongs to their objects.
pub struct ResidentScene {
    summary: SceneSummary,
    objects: Vec<ResidentObject>,
    lights: Option<Vec<Light>>,
    ambient: DVec3,
    /// Linear, premultiplied.
    background: [f64; 4],
}

/// One object of splats.
pub(crate) struct ResidentObject {
    pub cloud: Arc<SplatCloud>,
    pub world_from_object: DAffine3,
    pub material: Material,
    pub interior_weight: Option<f64>,
    pub first_splat: u32,
}

impl Renderer {
    /// A renderer with its own `threads` threads; 0: as many as there are cores.
    ///
    /// # Errors
    /// [`RenderError::Backend`] if threads can't be started.
    pub fn new(threads: usize) -> Result<Self, RenderError> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .map_err(|e| RenderError::Backend { backend: "reference", message: e.to_string() })?;
        let info = RendererInfo {
            backend: "reference",
            adapter: "f64, brute force".into(),
            driver: format!("surfel {}", env!("CARGO_PKG_VERSION")),
            threads: pool.current_num_threads(),
            capabilities: CAPABILITIES,
        };
        Ok(Self { info, pool })
    }

    /// Renders `samples`×`samples` samples a pixel without a pre-filter and averages them: the truth that filters
    /// approximate.
    ///
    /// # Errors
    /// As [`surfel_render::Renderer::render`]; also for more samples than fit into memory.
    pub fn render_supersampled(
        &mut self,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        samples: u32,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let fine_view = view.supersampled(samples)?;
        let settings = Settings { prefilter_radius_px: 0.0, edge_aa: false, ..*settings };
        let planes = Planes { margin: false, ..planes };
        let mut fine = Frame::default();
        let stats = surfel_render::Renderer::render(self, scene, &fine_view, &settings, planes, &mut fine)?;
        supersample::average(&fine, samples, planes, frame);
        Ok(stats)
    }
}

impl surfel_render::Renderer for Renderer {
    type Scene = ResidentScene;

    fn info(&self) -> &RendererInfo {
        &self.info
    }

    fn upload(&mut self, scene: &Scene) -> Result<ResidentScene, RenderError> {
        scene.validate()?;
        let mut first_splat = 0u64;
        let mut objects = Vec::new();
        for object in &scene.objects {
            if let Geometry::Splats(cloud) = &object.geometry {
                objects.push(ResidentObject {
                    cloud: cloud.clone(),
                    world_from_object: object.world_from_object,
                    material: object.material,
                    interior_weight: object.material.interior_weight.or(cloud.data().interior_weight),
                    first_splat: first_splat as u32,
                });
                first_splat += cloud.len() as u64;
            }
        }
        if first_splat > u64::from(u32::MAX) {
            return Err(RenderError::Backend {
                backend: "reference",
                message: format!("the scene has {first_splat} splats, at most {} can be drawn", u32::MAX),
            });
        }
        let [r, g, b, a] = scene.background;
        Ok(ResidentScene {
            summary: SceneSummary::of(scene),
            objects,
            lights: scene.lights.clone(),
            ambient: DVec3::from(scene.ambient),
            background: [r * a, g * a, b * a, a],
        })
    }

    fn render(
        &mut self,
        scene: &ResidentScene,
        view: &View,
        settings: &Settings,
        planes: Planes,
        frame: &mut Frame,
    ) -> Result<Stats, RenderError> {
        let plan = plan(&scene.summary, view, settings, planes, &CAPABILITIES)?;
        Ok(self.pool.install(|| render(scene, view, &plan, frame, self.info.threads)))
    }
}

/// The rectangle that passes run over: the region, and for edge antialiasing its neighbours inside the image.
fn work_rect(view: &View, plan: &FramePlan) -> Region {
    if !plan.has(Pass::EdgeAntialiasing) {
        return view.region;
    }
    let r = view.region;
    let (x, y) = (r.x.saturating_sub(1), r.y.saturating_sub(1));
    let right = (r.x + r.width + 1).min(view.size[0]);
    let bottom = (r.y + r.height + 1).min(view.size[1]);
    Region { x, y, width: right - x, height: bottom - y }
}

fn render(scene: &ResidentScene, view: &View, plan: &FramePlan, frame: &mut Frame, threads: usize) -> Stats {
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
    let splats: Vec<ScreenSplat> = scene
        .objects
        .iter()
        .flat_map(|object| {
            let object_view = ObjectView::new(object, view);
            let each = |i| project(object, &object_view, i, view, plan);
            (0..object.cloud.len()).into_par_iter().filter_map(each).collect::<Vec<_>>()
        })
        .collect();
    stats.drawn = splats.len() as u64;
    lap(&mut stats, "project");
    let rect = work_rect(view, plan);
    let bands = Bands::new(&splats, rect);
    let front = raster::run(&splats, &bands, view, plan, None);
    stats.fragments = front.fragments;
    lap(&mut stats, "rasterise");
    let behind = plan.has(Pass::EdgeAntialiasing).then(|| {
        let edges = edge_pixels(&front, rect);
        // Where nothing is kept, nothing lies behind either.
        let limit: Vec<f64> =
            front.kept.iter().zip(&edges).map(|(k, &edge)| if edge { k.value } else { f64::INFINITY }).collect();
        (raster::run(&splats, &bands, view, plan, Some(&limit)), edges)
    });
    if behind.is_some() {
        lap(&mut stats, "behind edges");
    }
    resolve(scene, view, plan, frame, rect, &front, behind.as_ref());
    lap(&mut stats, "shade");
    let bytes: usize = scene.objects.iter().map(|o| o.cloud.bytes()).sum();
    stats.bytes_per_splat = bytes as f64 / (scene.summary.splats.max(1)) as f64;
    stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
    stats
}

fn resolve(
    scene: &ResidentScene,
    view: &View,
    plan: &FramePlan,
    frame: &mut Frame,
    rect: Region,
    front: &Passes,
    behind: Option<&(Passes, Vec<bool>)>,
) {
    let headlight = [Light::Directional { direction: view.forward().to_array(), color: [1.0; 3], shadow: false }];
    let lighting = Lighting {
        view,
        plan,
        lights: scene.lights.as_deref().unwrap_or(&headlight),
        ambient: scene.ambient,
        material: scene.objects.first().map_or(Material::default(), |o| o.material).factors(),
    };
    let region = view.region;
    frame.reset(region.width, region.height, plan.planes);
    let edge_margin = match behind {
        Some(_) if plan.planes.margin => marginal_edges(front, rect),
        _ => Vec::new(),
    };
    let over = |surface: Option<Surface>| match surface {
        Some(s) => [s.color.x, s.color.y, s.color.z, 1.0],
        None => scene.background,
    };
    for y in 0..region.height {
        for x in 0..region.width {
            let (px, py) = (region.x + x, region.y + y);
            let from = ((py - rect.y) * rect.width + px - rect.x) as usize;
            let to = (y * region.width + x) as usize;
            let pixel = V2::new(f64::from(px) + 0.5, f64::from(py) + 0.5);
            let sums: &Sums = &front.sums[from];
            let surface = lighting.shade(sums, pixel);
            let mut marginal = sums.marginal || surface.is_some_and(|s| s.marginal);
            if plan.planes.color {
                let mut color = over(surface);
                if let (Some((back, edges)), Some(_)) = (behind, surface)
                    && edges[from]
                {
                    let q = sums.coverage.min(1.0);
                    let back = lighting.shade(&back.sums[from], pixel);
                    marginal |= back.is_some_and(|s| s.marginal);
                    for (c, b) in color.iter_mut().zip(over(back)) {
                        *c = q * *c + (1.0 - q) * b;
                    }
                }
                frame.color[to] = color.map(|c| c as f32);
            }
            if let Some(s) = surface {
                if plan.planes.depth {
                    frame.depth[to] = s.depth as f32;
                }
                if plan.planes.normal {
                    frame.normal[to] = s.normal.as_vec3().to_array();
                }
                if plan.planes.weight {
                    frame.weight[to] = s.weight as f32;
                }
            }
            if plan.planes.fragments {
                frame.fragments[to] = sums.fragments;
            }
            if plan.planes.margin {
                marginal |= behind.is_some_and(|(b, _)| b.sums[from].marginal);
                marginal |= edge_margin.get(from).is_some_and(|&m| m);
                frame.margin[to] = f32::from(u8::from(marginal));
            }
        }
    }
}
