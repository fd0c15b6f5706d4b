//! Render settings: what trades speed for accuracy, and how the surface is shaded.

use crate::ModelError;
use serde::{Deserialize, Serialize};

/// Everything about a render that is neither scene nor camera. The defaults are the scene file's and never change.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Screen-space filter.
    pub filter: Filter,
    /// Kernel cutoff c: the weight is exp(−c·ρ²). Greater than 0.
    pub cutoff: f64,
    /// Least half-width of a filtered footprint, in pixels (h). At least 0; 0 switches the filter off.
    pub prefilter_radius_px: f64,
    /// How a splat is mapped to the screen.
    pub mapping: Mapping,
    /// How much farther than the nearest surface a fragment may be and still blend with it.
    pub depth_tolerance: DepthTolerance,
    /// How pixels are shaded.
    pub shader: Shader,
    /// Edge antialiasing by coverage.
    pub edge_aa: bool,
    /// How transparent splats are drawn.
    pub transparency: Transparency,
    /// How clip curves and lines are evaluated.
    pub clip: ClipPolicy,
    /// Precision of accumulation.
    pub accumulate: Accumulate,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            filter: Filter::Principal,
            cutoff: 2.0,
            prefilter_radius_px: std::f64::consts::FRAC_1_SQRT_2,
            mapping: Mapping::Exact,
            depth_tolerance: DepthTolerance::Relative(1.0),
            shader: Shader::Unlit,
            edge_aa: false,
            transparency: Transparency::Off,
            clip: ClipPolicy::Exact,
            accumulate: Accumulate::F32,
        }
    }
}

/// Greatest cutoff: e^−50 is 2e-22, and f32 still holds it times the share of a pixel that a tiny splat has.
const MOST_CUTOFF: f64 = 50.0;

/// Most layers of transparent splats: what lies behind so many shows nothing, and a plan has a pass for each.
const MOST_LAYERS: u32 = 64;

impl Settings {
    /// Checks that every number is in its range.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] naming the field.
    pub fn validate(&self) -> Result<(), ModelError> {
        if !(self.cutoff > 0.0 && self.cutoff <= MOST_CUTOFF) {
            return Err(ModelError::range("settings.cutoff", self.cutoff, "a number in (0, 50]"));
        }
        if !(self.prefilter_radius_px >= 0.0 && self.prefilter_radius_px <= 1e4) {
            let found = self.prefilter_radius_px;
            return Err(ModelError::range("settings.prefilter_radius_px", found, "a number of pixels in [0, 10000]"));
        }
        let (DepthTolerance::Relative(t) | DepthTolerance::Absolute(t)) = self.depth_tolerance;
        if !(t >= 0.0 && t.is_finite()) {
            return Err(ModelError::range("settings.depth_tolerance", t, "a finite number, at least 0"));
        }
        if let Transparency::Peel { layers, .. } | Transparency::ABuffer { layers } = self.transparency
            && !(1..=MOST_LAYERS).contains(&layers)
        {
            return Err(ModelError::range("settings.transparency", self.transparency, "1 to 64 layers"));
        }
        Ok(())
    }
}

/// Screen-space filters (rendering model §4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Filter {
    /// The object kernel alone.
    None,
    /// Botsch 2005 §5: the larger of the object kernel and a disk of radius h.
    Clamp,
    /// Guennebaud 2006 §4.1: tangent vectors lengthened one by one.
    Adjust,
    /// Lengthened along the projected ellipse's own axes, weighted by area (ours).
    Principal,
    /// Zwicker 2001: affine projection convolved with a Gaussian.
    Ewa,
}

impl Filter {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::None, Self::Clamp, Self::Adjust, Self::Principal, Self::Ewa];

    /// The name used in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Clamp => "clamp",
            Self::Adjust => "adjust",
            Self::Principal => "principal",
            Self::Ewa => "ewa",
        }
    }
}

/// How a splat is mapped to the screen (rendering model §3).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mapping {
    /// The projective mapping of the splat's plane (Guennebaud 2006 §3).
    Exact,
    /// Its affine approximation about the projected centre (Zwicker 2001).
    Affine,
}

/// How much farther than the nearest surface a fragment may be and still blend with it (rendering model §5).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DepthTolerance {
    /// A multiple of the splat's larger radius.
    Relative(f64),
    /// World units.
    Absolute(f64),
}

/// How pixels are shaded (rendering model §5).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shader {
    /// Albedo as it is.
    Unlit,
    /// Ambient, diffuse and specular light.
    Phong,
    /// Quantised diffuse with outlines.
    Toon,
    /// World normals as colours.
    Normal,
    /// Stored depth as grey.
    Depth,
    /// The scene's picture of a lit ball, looked up by the normal.
    Matcap,
    /// Eye-dome lighting: albedo, darker the deeper a pixel lies among its neighbours.
    Edl,
}

impl Shader {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Unlit, Self::Phong, Self::Toon, Self::Normal, Self::Depth, Self::Matcap, Self::Edl];

    /// The name used in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Unlit => "unlit",
            Self::Phong => "phong",
            Self::Toon => "toon",
            Self::Normal => "normal",
            Self::Depth => "depth",
            Self::Matcap => "matcap",
            Self::Edl => "edl",
        }
    }
}

/// How transparent splats are drawn (rendering model §8). Written `off`, `peel:N`, `peel:N:drop` or `abuffer:L`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Transparency {
    /// Every splat is opaque.
    Off,
    /// Depth peeling (Guennebaud 2006 §6).
    Peel {
        /// Number of layers, the last one included.
        layers: u32,
        /// Leaves out the last layer, which blends everything that remains.
        drop_last: bool,
    },
    /// Zwicker 2001 §6.
    ABuffer {
        /// Fragments a pixel.
        layers: u32,
    },
}

impl std::fmt::Display for Transparency {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::Peel { layers, drop_last } => write!(f, "peel:{layers}{}", if *drop_last { ":drop" } else { "" }),
            Self::ABuffer { layers } => write!(f, "abuffer:{layers}"),
        }
    }
}

impl std::str::FromStr for Transparency {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let layers = |n: &str| {
            n.parse::<u32>()
                .ok()
                .filter(|n| (1..=MOST_LAYERS).contains(n))
                .ok_or_else(|| format!("'{s}': the number of layers must be a whole number from 1 to 64"))
        };
        match s.split(':').collect::<Vec<_>>()[..] {
            ["off"] => Ok(Self::Off),
            ["peel", n] => Ok(Self::Peel { layers: layers(n)?, drop_last: false }),
            ["peel", n, "drop"] => Ok(Self::Peel { layers: layers(n)?, drop_last: true }),
            ["abuffer", n] => Ok(Self::ABuffer { layers: layers(n)? }),
            _ => Err(format!("'{s}' is not one of off, peel:N, peel:N:drop, abuffer:L")),
        }
    }
}

impl TryFrom<String> for Transparency {
    type Error = String;

    fn try_from(s: String) -> Result<Self, String> {
        s.parse()
    }
}

impl From<Transparency> for String {
    fn from(t: Transparency) -> Self {
        t.to_string()
    }
}

/// How clip curves and lines are evaluated (rendering model §7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ClipPolicy {
    /// The curve's implicit form.
    Exact,
    /// Equation 7 of the 2012 paper, numerically repaired.
    Paper,
    /// The chord of each curve.
    Line,
    /// No clipping.
    Off,
}

/// Precision in which weighted attributes are summed, at least.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Accumulate {
    /// 32-bit floats.
    F32,
    /// 16-bit floats (B05 §7), in half the memory of a GPU's targets. Backends that have nothing to gain by it, on processors, sum in
    /// more.
    F16,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_their_range_are_refused_and_named() {
        let check = |change: &dyn Fn(&mut Settings)| {
            let mut settings = Settings::default();
            change(&mut settings);
            settings.validate().map_err(|error| error.to_string())
        };
        assert_eq!(check(&|_| ()), Ok(()));
        let refused = |field: &str, change: &dyn Fn(&mut Settings)| {
            let problem = check(change).unwrap_err();
            assert!(problem.starts_with(&format!("settings.{field} is ")), "{problem}");
        };
        for cutoff in [0.0, -1.0, 50.1, f64::NAN] {
            refused("cutoff", &|s| s.cutoff = cutoff);
        }
        for radius in [-0.1, 1.1e4, f64::NAN] {
            refused("prefilter_radius_px", &|s| s.prefilter_radius_px = radius);
        }
        for tolerance in [-0.1, f64::INFINITY] {
            refused("depth_tolerance", &|s| s.depth_tolerance = DepthTolerance::Relative(tolerance));
            refused("depth_tolerance", &|s| s.depth_tolerance = DepthTolerance::Absolute(tolerance));
        }
        // A plan has a pass for each.
        for layers in [0, 65, u32::MAX] {
            refused("transparency", &|s| s.transparency = Transparency::Peel { layers, drop_last: false });
            refused("transparency", &|s| s.transparency = Transparency::ABuffer { layers });
        }
        assert_eq!(check(&|s| s.transparency = Transparency::ABuffer { layers: 64 }), Ok(()));
    }
}
