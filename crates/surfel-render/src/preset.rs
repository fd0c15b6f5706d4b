//! Named trades of speed for accuracy.

use surfel_model::{Filter, Mapping, Settings};

/// A named trade of speed for accuracy; sets filter, mapping, cutoff and edge antialiasing.
///
/// Chosen from what `cargo xtask tradeoff` measured (docs/accuracy.md). None clamps or has a short kernel, which is slower
/// than `principal` and no better. Edges are antialiased by coverage, which a closed surface gains much from and a scan of
/// uneven density loses by: so not by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Preset {
    /// Affine footprints without a filter.
    Fastest,
    /// No filter: splats smaller than pixels alias, and vanish where they are alone.
    Fast,
    /// Filtered: the default of bare inputs.
    #[default]
    Balanced,
    /// Filtered, and edges antialiased.
    Quality,
    /// What the others are held against: as `Quality`, since no setting is better on every scene.
    Reference,
}

/// What a preset promises, as least PSNR (dB) of linear premultiplied colour; tests hold it on every scene of
/// `surfel-conformance` (docs/accuracy.md says how it was measured).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Promise {
    /// Fidelity: a backend's picture against the reference's at the same settings, outside of decision margins.
    pub fidelity_db: f64,
    /// Model error: the preset's picture against the preset `reference`'s. Infinite where they are the same.
    pub model_db: f64,
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

    /// The first preset that changes nothing of these settings.
    pub fn of(settings: &Settings) -> Option<Self> {
        Self::ALL.into_iter().find(|preset| preset.apply(*settings) == *settings)
    }

    /// What it promises.
    pub fn promise(self) -> Promise {
        let model_db = match self {
            // Splats across z_near, which the affine mapping leaves out.
            Self::Fastest => 10.0,
            Self::Fast => 15.0,
            // Loose needles: without antialiased edges each is as wide as a pixel.
            Self::Balanced => 10.0,
            Self::Quality | Self::Reference => f64::INFINITY,
        };
        Promise { fidelity_db: 90.0, model_db }
    }

    /// Applies the preset's choices to `settings`; shader, tolerance and the rest stay.
    pub fn apply(self, settings: Settings) -> Settings {
        let (filter, mapping, edge_aa) = match self {
            Self::Fastest => (Filter::None, Mapping::Affine, false),
            Self::Fast => (Filter::None, Mapping::Exact, false),
            Self::Balanced => (Filter::Principal, Mapping::Exact, false),
            Self::Quality | Self::Reference => (Filter::Principal, Mapping::Exact, true),
        };
        let Settings { cutoff, prefilter_radius_px, .. } = Settings::default();
        Settings { filter, mapping, cutoff, edge_aa, prefilter_radius_px, ..settings }
    }
}
