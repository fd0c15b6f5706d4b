//! Compositing of transparent layers and balls over a pixel, front to back.

use crate::ball::BallFragment;
use crate::shade::Surface;
use glam::DVec3;

/// Transparent layer of a pixel: a surface with its depth, colour and opacity.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layer {
    pub depth: f64,
    /// Colour, premultiplied by `alpha`.
    pub color: DVec3,
    pub alpha: f64,
}

impl Layer {
    /// Converts a ball's fragment to a layer.
    fn of_ball(ball: &BallFragment) -> Self {
        Self { depth: ball.z, color: ball.surface.color * ball.alpha, alpha: ball.alpha }
    }
}

/// Transparent layers of a pixel, nearest first, to which layers are added from front to back.
#[derive(Clone, Debug, Default)]
pub(crate) struct LayerCompositor {
    layers: Vec<Layer>,
    /// Surface of the nearest layer, which the planes of depth and normal show; `None` without layers.
    pub nearest: Option<Surface>,
    /// Number of surfaces that were added as layers, before any are merged; empty surfaces don't count.
    pub count: u32,
    /// Number of fragments that were summed in the layers' surfaces.
    pub fragments: u32,
    /// True if rounding could change a decision by which the layers were made.
    pub marginal: bool,
}

impl LayerCompositor {
    /// Adds a surface of opacity `alpha` behind the present layers.
    pub(crate) fn add_behind(&mut self, surface: &Surface, alpha: f64) {
        self.count += 1;
        self.add_premultiplied(surface, surface.color * alpha, alpha);
    }

    /// Adds a surface of premultiplied `color` and opacity `alpha` behind the present layers.
    pub(crate) fn add_premultiplied(&mut self, surface: &Surface, color: DVec3, alpha: f64) {
        self.layers.push(Layer { depth: surface.depth, color, alpha });
        self.nearest = self.nearest.or(Some(*surface));
        self.marginal |= surface.marginal;
    }

    /// Returns the depths of the layers, nearest first.
    pub(crate) fn depths(&self) -> impl Iterator<Item = f64> {
        self.layers.iter().map(|layer| layer.depth)
    }

    /// Composites the layers, with fragments of balls between them, over a premultiplied colour. The order of the
    /// layers never changes: a fragment comes before the first layer that isn't nearer.
    pub(crate) fn over(&self, balls: &[BallFragment], [r, g, b, a]: [f64; 4]) -> [f64; 4] {
        let (mut color, mut transmittance) = (DVec3::ZERO, 1.0);
        let mut add = |layer: &Layer| {
            color += layer.color * transmittance;
            transmittance *= 1.0 - layer.alpha;
        };
        let mut balls = balls.iter().peekable();
        for layer in &self.layers {
            while let Some(ball) = balls.next_if(|ball| ball.z < layer.depth) {
                add(&Layer::of_ball(ball));
            }
            add(layer);
        }
        balls.for_each(|ball| add(&Layer::of_ball(ball)));
        let c = color + DVec3::new(r, g, b) * transmittance;
        [c.x, c.y, c.z, 1.0 - transmittance + a * transmittance]
    }
}
