//! Drawing of trained Gaussians, blended one over another (docs/gaussians.md), with every pixel computed independently.

use crate::scene::ResidentScene;
use glam::DVec3;
use rayon::prelude::*;
use std::time::Instant;
use surfel_math::gaussian::{
    self, GaussianForms, MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE, MIN_WEIGHT, depth_step, distortion_depth,
};
use surfel_math::{V2, V3};
use surfel_model::Sort;
use surfel_render::{Frame, FramePlan, GaussianColors, GaussianView, Identity, PassTime, Stats, View};

/// Largest relative distance of a value, such as α, from a limit at which rounding could change the comparison with the
/// limit.
const MARGIN: f64 = 1e-4;
/// Distance, in pixels, by which rounding may move a Gaussian relative to a pixel's ray. A value that crosses a limit
/// within this distance of the ray is uncertain.
const RIM_PX: f64 = 1e-3;
/// Largest relative change of a depth by f32 rounding. The order of two depths may change if they differ by at most
/// twice as much.
const DEPTH_MARGIN: f64 = 5e-7;
/// Largest change of a colour or normal component, by a swap of fragments, that doesn't count as visible.
const CHANGE_MARGIN: f64 = 1e-4;

/// Gaussian that may be visible, projected to the view.
struct VisibleGaussian {
    /// Depth of the Gaussian's centre, by which [`Sort::Center`] sorts.
    depth: f64,
    center_px: V2<f64>,
    bounds_px: Option<[V2<f64>; 2]>,
    forms: GaussianForms<f64>,
    opacity: f64,
    /// Factor by which α is multiplied after its comparison with the limits: the fraction of the filtered footprint
    /// that the Gaussian covers, or 1 if Gaussians are drawn as they were trained.
    weight: f64,
    color: DVec3,
    /// Unit normal in world space.
    normal: DVec3,
    /// Index of the Gaussian among all Gaussians of the scene.
    number: usize,
}

/// Gaussian evaluated at the point where a pixel's ray meets it.
struct Fragment<'a> {
    gaussian: &'a VisibleGaussian,
    alpha: f64,
    z: f64,
    shows: bool,
    /// True if rounding could change whether the Gaussian is visible at this pixel.
    open: bool,
    /// Smallest and largest α within [`RIM_PX`] of the ray.
    alphas: [f64; 2],
    /// Depths at [`RIM_PX`] from the ray, in four directions.
    depths: [f64; 4],
}

/// Sums over the Gaussians on a pixel's ray, accumulated front to back.
struct Pixel {
    transmittance: f64,
    weight: f64,
    color: DVec3,
    normal: DVec3,
    depth: f64,
    median_depth: f64,
    distortion: f64,
    /// Sums Σw·m and Σw·m² for the plane `distortion`, where w is a Gaussian's weight and m its [`distortion_depth`].
    moments: [f64; 2],
    fragments: u32,
    marginal: bool,
    /// Relative change of the transmittance that moving all earlier Gaussians by [`RIM_PX`] may cause.
    slack: f64,
}

/// Draws a frame of Gaussians by its plan, and returns statistics.
pub(crate) fn render(scene: &ResidentScene, view: &View, plan: &FramePlan, frame: &mut Frame, threads: usize) -> Stats {
    let start = Instant::now();
    let seen = by_centers(scene, view, plan);
    let sorted = Instant::now();
    let region = view.region;
    let near = gaussian::near(&view.projection);
    let pixels: Vec<Pixel> = (0..view.pixels())
        .into_par_iter()
        .map(|at| {
            let [x, y] = [at % region.width as usize, at / region.width as usize];
            let x = f64::from(region.x) + x as f64 + 0.5;
            let y = f64::from(region.y) + y as f64 + 0.5;
            Pixel::through(&seen, V2::new(x, y), near, plan)
        })
        .collect();
    let linear = scene.summary.gaussians == Some(GaussianColors::Linear);
    // The scene's background is premultiplied.
    let [r, g, b, a] = scene.background;
    let straight = [r, g, b].map(|c| if a > 0.0 { c / a } else { 0.0 });
    let background = gaussian::background([straight[0], straight[1], straight[2], a], linear);
    frame.reset(region.width, region.height, plan.planes);
    let planes = frame.planes_mut();
    fill(planes.color, &pixels, |p| {
        gaussian::resolve(p.color.to_array(), p.transmittance, background, linear).map(|c| c as f32)
    });
    let of_what_is_there = |p: &Pixel, value: f64| if p.weight > MIN_WEIGHT { value as f32 } else { f32::INFINITY };
    fill(planes.depth, &pixels, |p| of_what_is_there(p, p.depth / p.weight));
    fill(planes.median_depth, &pixels, |p| of_what_is_there(p, p.median_depth));
    fill(planes.normal, &pixels, |p| p.normal.as_vec3().to_array());
    fill(planes.weight, &pixels, |p| (1.0 - p.transmittance) as f32);
    fill(planes.alpha, &pixels, |p| (1.0 - p.transmittance) as f32);
    fill(planes.distortion, &pixels, |p| p.distortion as f32);
    fill(planes.fragments, &pixels, |p| p.fragments);
    fill(planes.margin, &pixels, |p| f32::from(u8::from(p.marginal)));
    frame.finish(view, |_| Identity::NOTHING);
    let mut stats = Stats::default().with_splats(plan.splats).with_drawn(seen.len() as u64).with_threads(threads);
    stats.fragments = pixels.iter().map(|p| u64::from(p.fragments)).sum();
    let bytes: usize = scene.gaussians.iter().map(|(cloud, _)| cloud.bytes()).sum();
    stats.bytes_per_splat = bytes as f64 / plan.splats.max(1) as f64;
    stats.passes.push(PassTime { name: "sort", ms: (sorted - start).as_secs_f64() * 1e3 });
    stats.passes.push(PassTime { name: "blend", ms: sorted.elapsed().as_secs_f64() * 1e3 });
    stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
    stats
}

fn fill<T>(plane: &mut [T], pixels: &[Pixel], value: impl Fn(&Pixel) -> T) {
    plane.iter_mut().zip(pixels).for_each(|(at, pixel)| *at = value(pixel));
}

/// Projects the Gaussians that may be visible, and sorts them by the depth of their centres; equal depths in scene
/// order.
fn by_centers(scene: &ResidentScene, view: &View, plan: &FramePlan) -> Vec<VisibleGaussian> {
    let (mut all, mut first) = (Vec::new(), 0);
    for (cloud, world_from_object) in &scene.gaussians {
        let seen = GaussianView::new(cloud, world_from_object, (view, plan));
        all.extend((0..cloud.len()).filter_map(|i| {
            let projected = seen.project(i)?;
            let V3 { x, y, z } = projected.normal;
            Some(VisibleGaussian {
                depth: seen.depth(i),
                center_px: projected.center_px,
                bounds_px: projected.bounds_px,
                forms: projected.forms,
                opacity: cloud.data().opacities[i].into(),
                weight: projected.weight,
                color: seen.color(i).into(),
                normal: view.view_from_world.transpose() * DVec3::new(x, y, z),
                number: first + i,
            })
        }));
        first += cloud.len();
    }
    all.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    all
}

impl<'a> Fragment<'a> {
    /// Evaluates a Gaussian on the ray through the pixel position `at`; `None` if it certainly isn't visible there.
    fn of(gaussian: &'a VisibleGaussian, at: V2<f64>, near: f64) -> Option<Self> {
        let d = V2::new(at.x - gaussian.center_px.x, at.y - gaussian.center_px.y);
        if let Some([lo, hi]) = gaussian.bounds_px {
            // A little more than the bounds, since decisions at the bounds may be within their margin.
            let out = |d: f64, lo: f64, hi: f64| d < 1.01 * lo || d > 1.01 * hi;
            if out(d.x, lo.x, hi.x) || out(d.y, lo.y, hi.y) {
                return None;
            }
        }
        let seen_at = |[x, y]: [f64; 2]| {
            let (rho, z) = gaussian.forms.at(V2::new(d.x + x, d.y + y));
            ((gaussian.opacity * (-0.5 * rho).exp()).min(MAX_ALPHA), z)
        };
        let (alpha, z) = seen_at([0.0; 2]);
        // Limits of alpha and depth act as rims: a value that crosses a limit within a rim's width is uncertain.
        let about = [[RIM_PX, 0.0], [-RIM_PX, 0.0], [0.0, RIM_PX], [0.0, -RIM_PX]].map(seen_at);
        let range =
            |at: f64, about: [f64; 4]| about.into_iter().fold([at; 2], |[least, most], v| [least.min(v), most.max(v)]);
        let (alphas, depths) = (range(alpha, about.map(|(alpha, _)| alpha)), about.map(|(_, z)| z));
        let goes_through =
            |[least, most]: [f64; 2], limit: f64| least * (1.0 - MARGIN) < limit && most * (1.0 + MARGIN) >= limit;
        let may_show = alphas[1] * (1.0 + MARGIN) >= MIN_ALPHA;
        let open = may_show && (goes_through(alphas, MIN_ALPHA) || goes_through(range(z, depths), near));
        let shows = alpha >= MIN_ALPHA && z >= near && z.is_finite();
        let (alpha, alphas) = (alpha * gaussian.weight, alphas.map(|alpha| alpha * gaussian.weight));
        (shows || open).then_some(Self { gaussian, alpha, z, shows, open, alphas, depths })
    }

    /// True if both fragments certainly are in the same depth step. Then the scene's order decides which one is in
    /// front, and rounding can't swap them.
    fn is_surely_in_step_with(&self, other: &Self) -> bool {
        let mut depths = self.depths.into_iter().chain(other.depths);
        let step = depth_step(self.z);
        depths.all(|z| depth_step(z * (1.0 - DEPTH_MARGIN)) == step && depth_step(z * (1.0 + DEPTH_MARGIN)) == step)
    }
}

impl Pixel {
    /// Blends all Gaussians on the ray through the pixel position `at`, in the plan's order.
    fn through(seen: &[VisibleGaussian], at: V2<f64>, near: f64, plan: &FramePlan) -> Self {
        let mut pixel = Self {
            transmittance: 1.0,
            weight: 0.0,
            color: DVec3::ZERO,
            normal: DVec3::ZERO,
            depth: 0.0,
            median_depth: 0.0,
            distortion: 0.0,
            moments: [0.0; 2],
            fragments: 0,
            marginal: false,
            slack: 0.0,
        };
        let fragments = seen.iter().filter_map(|gaussian| Fragment::of(gaussian, at, near));
        match plan.sort {
            Sort::Pixel => {
                let mut fragments: Vec<Fragment<'_>> = fragments.collect();
                fragments.sort_by_key(|f| (depth_step(f.z), f.gaussian.number));
                for (i, fragment) in fragments.iter().enumerate() {
                    pixel.marginal |= plan.planes.margin && pixel.may_swap(fragment, &fragments[i + 1..]);
                    if !pixel.blend(fragment) {
                        break;
                    }
                }
            }
            // `Sort::Center`, the default.
            _ => {
                for fragment in fragments {
                    if !pixel.blend(&fragment) {
                        break;
                    }
                }
            }
        }
        pixel
    }

    /// True if rounding may swap the fragment `front` with fragments in `behind`, and the swap would visibly change the
    /// pixel.
    fn may_swap(&self, front: &Fragment<'_>, behind: &[Fragment<'_>]) -> bool {
        let change = |f: &Fragment<'_>| {
            let is_apart = front.depths.iter().zip(f.depths).all(|(z, other)| other > z * (1.0 + 2.0 * DEPTH_MARGIN));
            if is_apart || front.is_surely_in_step_with(f) {
                return 0.0;
            }
            let difference = (f.gaussian.color - front.gaussian.color).abs();
            let difference = difference.max((f.gaussian.normal - front.gaussian.normal).abs());
            difference.max_element() * f.alpha * front.alpha * self.transmittance
        };
        let changes: f64 = behind.iter().filter(|f| f.shows).map(change).sum();
        front.shows && changes > CHANGE_MARGIN
    }

    /// Blends a fragment behind the earlier ones. Returns false if the fragment would lower the transmittance below
    /// [`MIN_TRANSMITTANCE`]. It isn't blended then, and the pixel is finished.
    fn blend(&mut self, fragment: &Fragment<'_>) -> bool {
        let Fragment { gaussian, alpha, z, alphas, .. } = *fragment;
        self.marginal |= fragment.open;
        if !fragment.shows {
            return true;
        }
        let is_open = |value: f64, limit: f64, slack: f64| (value / limit - 1.0).abs() < MARGIN + slack;
        let left = self.transmittance * (1.0 - alpha);
        self.marginal |= is_open(self.transmittance, 0.5, self.slack);
        self.slack += (alphas[1] - alphas[0]) / (1.0 - alpha);
        self.marginal |= is_open(left, MIN_TRANSMITTANCE, self.slack);
        if left < MIN_TRANSMITTANCE {
            return false;
        }
        let weight = alpha * self.transmittance;
        self.weight += weight;
        self.color += gaussian.color * weight;
        self.normal += gaussian.normal * weight;
        self.depth += z * weight;
        if self.transmittance > 0.5 {
            self.median_depth = z;
        }
        let m = distortion_depth(z);
        let [first, second] = self.moments;
        self.distortion += weight * (m * m * (1.0 - self.transmittance) + second - 2.0 * m * first);
        self.moments = [first + weight * m, second + weight * m * m];
        self.transmittance = left;
        self.fragments += 1;
        true
    }
}
