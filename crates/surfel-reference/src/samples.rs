//! Edge antialiasing by samples (rendering model §5): pixels at a depth step become the mean of 4×4 samples.
//!
//! Samples are the pixels of an image that is four times as wide and high, and that is drawn as a whole.

use crate::ball::{self, BallLayer};
use crate::frame::OpaqueImage;
use crate::front::Front;
use crate::layer_compositor::LayerCompositor;
use crate::pixels::center_in;
use crate::scene::ResidentScene;
use crate::shade::Lighting;
use crate::steps::Steps;
use rayon::prelude::*;
use surfel_render::SAMPLES_SIDE;

/// Pixel whose colour is the mean of its samples.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sampled {
    /// Mean colour as linear premultiplied RGBA.
    pub color: [f64; 4],
    /// True if rounding could change a decision by which one of the samples was drawn.
    pub marginal: bool,
}

/// Result of edge antialiasing by samples over a rectangle: its pixels at depth steps are averaged from samples.
pub(crate) struct Samples {
    /// Mean of each pixel's samples; meaningless for pixels that `wanted` excludes.
    pixels: Vec<Sampled>,
    wanted: Vec<bool>,
    /// Flag per pixel, true if rounding could change whether the pixel is averaged from samples; empty if margins
    /// aren't needed.
    open: Vec<bool>,
}

impl Samples {
    /// Finds the pixels at depth steps in a shaded image, and draws their samples.
    pub(crate) fn draw(scene: &ResidentScene, image: &OpaqueImage, front: &Front) -> Self {
        let (rect, lighting) = (image.rect, image.lighting);
        let transparent = front.nearest_transparent(lighting, rect);
        let transparent = transparent.as_ref().map(|passes| (passes, front.layers.as_slice()));
        let (meshes, view) = (front.meshes.as_ref(), lighting.view);
        let steps = Steps { front: &front.passes, meshes, transparent, rect, view };
        let wanted = steps.pixels();
        let open = if lighting.plan.planes.margin { steps.marginal() } else { Vec::new() };
        Self { pixels: sampled(scene, image, &wanted), wanted, open }
    }

    /// Returns the mean of a pixel's samples; `None` if the pixel isn't averaged from samples.
    pub(crate) fn of(&self, at: usize) -> Option<&Sampled> {
        self.wanted[at].then(|| &self.pixels[at])
    }

    /// True if rounding could change whether a pixel is averaged from samples.
    pub(crate) fn marginal(&self, at: usize) -> bool {
        self.open.get(at).copied().unwrap_or(false)
    }
}

/// Draws the image of samples, and averages the samples of those pixels of `image` that `wanted` flags.
fn sampled(scene: &ResidentScene, image: &OpaqueImage, wanted: &[bool]) -> Vec<Sampled> {
    let mut sampled = vec![Sampled::default(); wanted.len()];
    if !wanted.contains(&true) {
        return sampled;
    }
    let (view, plan) = (image.lighting.view.of_samples(), image.lighting.plan.of_samples());
    let lighting = Lighting { view: &view, plan: &plan, matcap: image.lighting.matcap.clone(), ..*image.lighting };
    let rect = image.rect.of_samples();
    let front = Front::draw(scene, &lighting, rect, f64::from(SAMPLES_SIDE));
    let fine = OpaqueImage::new(&lighting, rect, scene.background, &front);
    let pixels = sampled.par_iter_mut().enumerate().filter(|(at, _)| wanted[*at]);
    pixels.for_each(|(at, pixel)| *pixel = mean(image, &fine, &front, at));
    sampled
}

/// Returns the mean of the samples of pixel `at`.
fn mean(image: &OpaqueImage, fine: &OpaqueImage, front: &Front, at: usize) -> Sampled {
    let (width, side) = (image.rect.width as usize, SAMPLES_SIDE as usize);
    let share = 1.0 / (side * side) as f64;
    let mut pixel = Sampled::default();
    for (j, i) in (0..side).flat_map(|j| (0..side).map(move |i| (j, i))) {
        let sample = (at / width * side + j) * width * side + at % width * side + i;
        let place = center_in(fine.rect, sample);
        let (surface, mut marginal) = fine.front_surface(sample, place);
        let (surface, open) = image.under_screen_space(surface, at, place * (1.0 / side as f64));
        marginal |= open;
        let mut color = fine.over_background(surface);
        let depth = surface.map_or(f64::INFINITY, |s| s.depth);
        let balls = ball::between(BallLayer::of(front.balls.as_ref(), sample), 0.0, depth);
        marginal |= ball::is_marginal(balls, &[depth]);
        let none = LayerCompositor::default();
        let layers = front.layers.get(sample).unwrap_or(&none);
        color = layers.over(balls, color);
        marginal |= layers.marginal;
        pixel.marginal |= marginal;
        pixel.color.iter_mut().zip(color).for_each(|(sum, c)| *sum += c * share);
    }
    pixel
}
