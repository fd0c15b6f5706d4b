//! Named trades of speed for accuracy.

use surfel_model::{Filter, Mapping, Settings};

/// A named trade of speed for accuracy; sets filter, mapping, cutoff and edge antialiasing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Preset {
    /// Clamped affine footprints with the paper's short kernel.
    Fastest,
    /// Affine footprints.
    Fast,
    /// The default of bare inputs.
    #[default]
    Balanced,
    /// Antialiased edges.
    Quality,
    /// As the reference renders.
    Reference,
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

    /// Applies the preset's choices to `settings`; shader, tolerance and the rest stay.
    pub fn apply(self, settings: Settings) -> Settings {
        let (filter, mapping, cutoff, edge_aa) = match self {
            Self::Fastest => (Filter::Clamp, Mapping::Affine, 1.0, false),
            Self::Fast => (Filter::Principal, Mapping::Affine, 2.0, false),
            Self::Balanced => (Filter::Principal, Mapping::Exact, 2.0, false),
            Self::Quality | Self::Reference => (Filter::Principal, Mapping::Exact, 2.0, true),
        };
        let prefilter_radius_px = Settings::default().prefilter_radius_px;
        Settings { filter, mapping, cutoff, edge_aa, prefilter_radius_px, ..settings }
    }
}
