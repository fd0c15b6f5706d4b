//! Named trades of speed for accuracy.

use crate::Frame;
use surfel_model::{Accumulate, EdgeAa, Filter, Mapping, Settings};

/// A named trade of speed for accuracy; sets filter, mapping, cutoff and edge antialiasing.
///
/// Chosen from what `cargo xtask tradeoff` measured (docs/accuracy.md). None clamps or has a short kernel, which is
/// slower than `principal` and no better. Edges are antialiased by samples, which errs least for closed surfaces and
/// for scans of uneven density.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Preset {
    /// Affine footprints without a filter.
    Fastest,
    /// No filter: splats smaller than pixels alias, and vanish where they are alone.
    Fast,
    /// Filtered, and edges antialiased by samples: the default of bare inputs.
    #[default]
    Balanced,
    /// As `Balanced`: nothing that takes longer errs less on every scene.
    Quality,
    /// What the others are held against: as `Quality`, since no setting is better on every scene.
    Reference,
}

/// What a preset promises: least PSNR (dB) of linear premultiplied colour, and largest errors of depths and normals,
/// with splats and sums in 32 bits; tests hold it on every scene of `surfel-conformance` and on every backend
/// (docs/accuracy.md says how it was measured).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Promise {
    /// Fidelity: a backend's image against the reference's at the same settings, outside of decision margins.
    pub fidelity_db: f64,
    /// The same for depths: most that the root mean square of their relative differences is.
    pub fidelity_depth: f64,
    /// The same for normals: most that the root mean square angle is, degrees.
    pub fidelity_normal_deg: f64,
    /// Model error: the preset's image against the preset `reference`'s. Infinite where they are the same.
    pub model_db: f64,
    /// The same of pixels inside of surfaces ([`inside_surfaces`]), where nothing is transparent: what is left beside
    /// rims, loose splats and needles.
    pub inside_db: f64,
}

/// Largest step of depth from pixel to pixel within a surface, relative.
const STEP: f32 = 0.02;

/// Least share of an image's pixels for there to be a surface.
const LEAST_SHARE: f64 = 0.05;

/// Pixels inside of surfaces: something is there and at all neighbours, and none of the eight is nearer or farther by
/// more than a fiftieth. By the depth plane, which the frame has to have. `None` where fewer than one pixel in twenty
/// is: such an image is of loose splats.
pub fn inside_surfaces(frame: &Frame) -> Option<Vec<bool>> {
    let (width, height) = (i64::from(frame.width()), i64::from(frame.height()));
    let depth = |x: i64, y: i64| {
        let is_there = (0..width).contains(&x) && (0..height).contains(&y);
        // What lies outside of the image says nothing.
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
    (count > 0 && count as f64 >= LEAST_SHARE * inside.len() as f64).then_some(inside)
}

impl Preset {
    /// All of them, fastest first.
    pub const ALL: [Self; 5] = [Self::Fastest, Self::Fast, Self::Balanced, Self::Quality, Self::Reference];

    /// The name used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fastest => "fastest",
            Self::Fast => "fast",
            Self::Balanced => "balanced",
            Self::Quality => "quality",
            Self::Reference => "reference",
        }
    }

    /// The first preset that changes nothing of these settings; none where sums may be in 16 bits, which no promise
    /// covers.
    pub fn of(settings: &Settings) -> Option<Self> {
        let is_whole = settings.accumulate == Accumulate::F32;
        Self::ALL.into_iter().find(|preset| is_whole && preset.apply(*settings) == *settings)
    }

    /// What it promises.
    pub fn promise(self) -> Promise {
        let (model_db, inside_db) = match self {
            // Splats across z_near, which the affine mapping leaves out, and large clipped ones.
            Self::Fastest => (10.0, 9.0),
            // Needles, which alias.
            Self::Fast => (12.0, 24.0),
            Self::Balanced | Self::Quality | Self::Reference => (f64::INFINITY, f64::INFINITY),
        };
        Promise { fidelity_db: 90.0, fidelity_depth: 1e-4, fidelity_normal_deg: 0.01, model_db, inside_db }
    }

    /// Applies the preset's choices to `settings`; shader, tolerance and the rest stay.
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
        // A hole takes its neighbours along, and so does what is farther by more than a fiftieth.
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
