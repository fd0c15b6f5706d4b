//! Presets: named trade-offs of speed and accuracy.

use crate::Frame;
use surfel_model::{Accumulate, EdgeAa, Filter, Mapping, Settings};

/// Named trade-off of speed and accuracy; sets filter, prefilter radius, mapping, cutoff and edge antialiasing.
///
/// The presets are chosen by measurements of `cargo xtask tradeoff` (docs/accuracy.md). None uses the filter `clamp` or
/// another kernel cutoff than the default: both are less accurate at the same cost. Presets that antialias edges do so
/// by samples, which has the smallest error for watertight surfaces and for scans of uneven density.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Preset {
    /// No filter, no edge antialiasing, and affine footprints: splats whose centre is nearer than the near plane are
    /// dropped.
    Fastest,
    /// No filter, no edge antialiasing, and exact footprints: splats smaller than pixels alias, and vanish if they are
    /// isolated.
    Fast,
    /// Filtered splats, and edges antialiased by samples: the default for bare inputs.
    #[default]
    Balanced,
    /// Same as `Balanced`: no slower setting has a smaller error on every scene.
    Quality,
    /// Settings against which the model error of the other presets is measured. Same as `Quality`, because no setting
    /// is better on every scene.
    Reference,
}

/// Guaranteed accuracy of a preset: smallest PSNR (dB) of linear premultiplied colour, and largest errors of depths and
/// normals, with splats and sums in 32 bits. Tests verify it on every scene of `surfel-conformance` and on every
/// backend (docs/accuracy.md describes the measurement).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Promise {
    /// Smallest PSNR, in dB, of a backend's image against the reference backend's with the same settings. Pixels within
    /// decision margins, where backends may differ, are excluded.
    pub fidelity_db: f64,
    /// Largest root mean square of the relative differences of depths between a backend and the reference backend.
    pub fidelity_depth: f64,
    /// Largest root mean square angle, in degrees, between a backend's normals and the reference backend's.
    pub fidelity_normal_deg: f64,
    /// Smallest PSNR, in dB, of the preset's image against that of the preset `reference`. Infinite if both presets are
    /// the same.
    pub model_db: f64,
    /// Smallest PSNR, in dB, of pixels inside surfaces ([`inside_surfaces`]) against the preset `reference`, in scenes
    /// without transparency. Surfaces' rims, isolated splats and needles don't count.
    pub inside_db: f64,
}

/// Largest difference of depth between neighbouring pixels that count as the same surface, relative to the nearer
/// depth.
const STEP: f32 = 0.02;

/// Smallest fraction of an image's pixels that must be inside surfaces. An image with fewer shows isolated splats, and
/// [`inside_surfaces`] returns `None`.
const MIN_SHARE: f64 = 0.05;

/// Returns a flag per pixel that is true inside a surface. There the pixel and all its neighbours in the image have a
/// surface, and no neighbour's depth differs from the pixel's by more than 1/50 of the nearer depth. Requires the depth
/// plane. `None` if fewer than one pixel in twenty is inside: such an image shows isolated splats.
pub fn inside_surfaces(frame: &Frame) -> Option<Vec<bool>> {
    let (width, height) = (i64::from(frame.width()), i64::from(frame.height()));
    let depth = |x: i64, y: i64| {
        let is_there = (0..width).contains(&x) && (0..height).contains(&y);
        // Pixels outside the image don't count as neighbours.
        is_there.then(|| frame.depth().get((y * width + x) as usize).copied().unwrap_or(f32::INFINITY))
    };
    let is_inside = |i: i64| {
        let (x, y) = (i % width, i / width);
        let here = depth(x, y).unwrap_or(f32::INFINITY);
        let is_near = |z: f32| (z - here).abs() <= STEP * here.abs().min(z.abs());
        here.is_finite() && (-1..=1).all(|dy| (-1..=1).all(|dx| depth(x + dx, y + dy).is_none_or(is_near)))
    };
    let inside: Vec<bool> = (0..width * height).map(is_inside).collect();
    let count = inside.iter().filter(|inside| **inside).count();
    (count > 0 && count as f64 >= MIN_SHARE * inside.len() as f64).then_some(inside)
}

impl Preset {
    /// All presets, fastest first.
    pub const ALL: [Self; 5] = [Self::Fastest, Self::Fast, Self::Balanced, Self::Quality, Self::Reference];

    /// Returns the name used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fastest => "fastest",
            Self::Fast => "fast",
            Self::Balanced => "balanced",
            Self::Quality => "quality",
            Self::Reference => "reference",
        }
    }

    /// Returns the first preset that would not change these settings. Returns `None` if every preset would change them,
    /// or if attributes are summed in 16 bits ([`Accumulate`]), because no preset's promise covers such sums.
    pub fn of(settings: &Settings) -> Option<Self> {
        let is_whole = settings.accumulate == Accumulate::F32;
        Self::ALL.into_iter().find(|preset| is_whole && preset.apply(*settings) == *settings)
    }

    /// Returns the accuracy that the preset guarantees.
    pub fn promise(self) -> Promise {
        let (model_db, inside_db) = match self {
            // The largest errors are at splats across z_near, which the affine mapping drops, and at large clipped
            // splats.
            Self::Fastest => (10.0, 9.0),
            // The largest errors are at needles (long, thin splats), which alias.
            Self::Fast => (12.0, 24.0),
            Self::Balanced | Self::Quality | Self::Reference => (f64::INFINITY, f64::INFINITY),
        };
        Promise { fidelity_db: 90.0, fidelity_depth: 1e-4, fidelity_normal_deg: 0.01, model_db, inside_db }
    }

    /// Applies the preset's choices to `settings`; shader, tolerance and other settings don't change.
    pub fn apply(self, settings: Settings) -> Settings {
        let (filter, mapping, edge_aa) = match self {
            Self::Fastest => (Filter::None, Mapping::Affine, EdgeAa::Off),
            Self::Fast => (Filter::None, Mapping::Exact, EdgeAa::Off),
            Self::Balanced | Self::Quality | Self::Reference => (Filter::Principal, Mapping::Exact, EdgeAa::Samples),
        };
        let defaults = Settings::default();
        settings
            .with_filter(filter)
            .with_mapping(mapping)
            .with_edge_aa(edge_aa)
            .with_cutoff(defaults.cutoff)
            .with_prefilter_radius_px(defaults.prefilter_radius_px)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Planes;

    #[test]
    fn inside_of_surfaces_is_where_no_neighbour_is_empty_or_at_another_depth() {
        let mut frame = Frame::default();
        frame.reset(6, 5, Planes::COLOR.with_depth(true));
        let of = |frame: &Frame| -> Vec<usize> {
            let inside = inside_surfaces(frame).unwrap_or_default();
            (0..inside.len()).filter(|i| inside[*i]).collect()
        };
        frame.depth_mut().fill(f32::INFINITY);
        assert!(of(&frame).is_empty());
        frame.depth_mut().fill(2.0);
        assert_eq!(of(&frame).len(), 30, "the image's border is none of the surface");
        // A hole excludes its neighbours, and so does a pixel that is farther by more than 1/50.
        for depth in [f32::INFINITY, 2.1] {
            frame.depth_mut().fill(2.0);
            frame.depth_mut()[1] = depth;
            assert_eq!(of(&frame).len(), 24);
            assert!(!of(&frame).contains(&8) && of(&frame).contains(&3) && of(&frame).contains(&13));
        }
        frame.depth_mut()[1] = 2.03;
        assert_eq!(of(&frame).len(), 30);
        frame.depth_mut().fill(f32::INFINITY);
        for i in [0, 1, 6, 7] {
            frame.depth_mut()[i] = 2.0;
        }
        assert_eq!(inside_surfaces(&frame), None, "one pixel of thirty is no surface");
        frame.reset(6, 5, Planes::COLOR);
        assert!(of(&frame).is_empty(), "no depth, no surface");
    }
}
