//! Render settings: trade-offs of speed and accuracy, and shading.

use crate::ModelError;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// All parameters of a render except the scene and the camera. The defaults are those of the scene file and never
/// change.
///
/// Set fields by `Settings::default().with_shader(Shader::Phong)` or one by one. Other crates can't write literals,
/// because later versions may add fields.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields, default))]
#[non_exhaustive]
pub struct Settings {
    /// Screen-space filter, which widens splats smaller than a pixel.
    pub filter: Filter,
    /// Kernel cutoff c in the weight exp(−c·ρ²); in (0, 50].
    pub cutoff: f64,
    /// Smallest half-width h of a filtered footprint, in pixels, from 0 to 10,000; 0 disables the filter.
    pub prefilter_radius_px: f64,
    /// Mapping by which a pixel finds its position on a splat: exact or approximate.
    pub mapping: Mapping,
    /// Depth tolerance: largest distance behind the nearest surface at which a fragment is blended with it.
    pub depth_tolerance: DepthTolerance,
    /// Shader: rule for the colour of a pixel.
    pub shader: Shader,
    /// Method of edge antialiasing.
    pub edge_aa: EdgeAa,
    /// Method of drawing transparent splats.
    pub transparency: Transparency,
    /// Method by which clip curves and lines cut splats.
    pub clip: ClipPolicy,
    /// Smallest precision in which weighted attributes of fragments are summed.
    pub accumulate: Accumulate,
    /// Method of drawing files of trained Gaussians.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_surface"))]
    pub composite: Composite,
    /// Order in which trained Gaussians are blended one over another.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_by_center"))]
    pub sort: Sort,
    /// Screen-space filter of trained Gaussians that are blended one over another. `clamp` is the filter of their
    /// training; for `principal` see [`Filter::Principal`].
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_clamp"))]
    pub gaussian_filter: Filter,
    /// Largest radius, in pixels, of the splats that are selected from levels of detail (octrees and COPC files);
    /// greater than 0, at most [`MAX_LOD_ERROR_PX`].
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_default_lod_error"))]
    pub lod_error_px: f64,
}

/// Default of [`Settings::lod_error_px`], in pixels.
const DEFAULT_LOD_ERROR_PX: f64 = 1.0;

/// True if the value is the default; scene files then omit it.
#[cfg(feature = "serde")]
fn is_default_lod_error(error_px: &f64) -> bool {
    *error_px == DEFAULT_LOD_ERROR_PX
}

/// True if Gaussians are drawn as surfaces, the default; scene files then omit the value.
#[cfg(feature = "serde")]
fn is_surface(composite: &Composite) -> bool {
    *composite == Composite::Surface
}

/// True if the filter of Gaussians is the default; scene files then omit it.
#[cfg(feature = "serde")]
fn is_clamp(filter: &Filter) -> bool {
    *filter == Filter::Clamp
}

/// True if the order of Gaussians is the default; scene files then omit it.
#[cfg(feature = "serde")]
fn is_by_center(sort: &Sort) -> bool {
    *sort == Sort::Center
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
            edge_aa: EdgeAa::Off,
            transparency: Transparency::Off,
            clip: ClipPolicy::Exact,
            accumulate: Accumulate::F32,
            composite: Composite::Surface,
            sort: Sort::Center,
            gaussian_filter: Filter::Clamp,
            lod_error_px: DEFAULT_LOD_ERROR_PX,
        }
    }
}

/// Largest accepted kernel cutoff c. The weight at a splat's rim is then e^−50 = 2e-22. f32 can still represent this
/// weight when it is multiplied by a tiny splat's fraction of a pixel.
const MAX_CUTOFF: f64 = 50.0;
/// Largest accepted value of [`Settings::lod_error_px`], in pixels.
pub const MAX_LOD_ERROR_PX: f64 = 1e6;

/// Largest accepted number of layers of transparent splats. Nothing is visible behind so many layers, and backends draw
/// one pass for each.
const MAX_LAYERS: u32 = 64;

impl Settings {
    crate::setters! {
        with_filter filter: Filter,
        with_cutoff cutoff: f64,
        with_prefilter_radius_px prefilter_radius_px: f64,
        with_mapping mapping: Mapping,
        with_depth_tolerance depth_tolerance: DepthTolerance,
        with_shader shader: Shader,
        with_edge_aa edge_aa: EdgeAa,
        with_transparency transparency: Transparency,
        with_clip clip: ClipPolicy,
        with_accumulate accumulate: Accumulate,
        with_composite composite: Composite,
        with_sort sort: Sort,
        with_gaussian_filter gaussian_filter: Filter,
        with_lod_error_px lod_error_px: f64,
    }

    /// Validates that every number is in its range, and that the filter of Gaussians is `clamp` or `principal`.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] naming the field.
    pub fn validate(&self) -> Result<(), ModelError> {
        if !(self.cutoff > 0.0 && self.cutoff <= MAX_CUTOFF) {
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
        if !matches!(self.gaussian_filter, Filter::Clamp | Filter::Principal) {
            let found = self.gaussian_filter.name();
            return Err(ModelError::range("settings.gaussian_filter", found, "clamp or principal"));
        }
        if !(self.lod_error_px > 0.0 && self.lod_error_px <= MAX_LOD_ERROR_PX) {
            let found = self.lod_error_px;
            return Err(ModelError::range("settings.lod_error_px", found, "a number of pixels in (0, 1000000]"));
        }
        if let Transparency::Peel { layers, .. } | Transparency::ABuffer { layers } = self.transparency
            && !(1..=MAX_LAYERS).contains(&layers)
        {
            return Err(ModelError::range("settings.transparency", self.transparency, "1 to 64 layers"));
        }
        Ok(())
    }
}

/// Edge antialiasing (rendering model §5). Written as `off`, `on` or `samples`; scene files may also use `false` and
/// `true`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum EdgeAa {
    /// No antialiasing of edges, which therefore look jagged.
    #[default]
    Off,
    /// Antialiasing by coverage: a pixel's sum of weights relative to the interior weight of its cloud
    /// ([`CloudData::interior_weight`](crate::CloudData::interior_weight)).
    Coverage,
    /// Antialiasing by samples: pixels at edges are the mean of 4×4 samples, each drawn as a pixel.
    Samples,
}

impl EdgeAa {
    /// All methods of edge antialiasing.
    pub const ALL: [Self; 3] = [Self::Off, Self::Coverage, Self::Samples];

    /// Returns the name used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Coverage => "on",
            Self::Samples => "samples",
        }
    }
}

#[cfg(feature = "serde")]
impl Serialize for EdgeAa {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Off => serializer.serialize_bool(false),
            Self::Coverage => serializer.serialize_bool(true),
            Self::Samples => serializer.serialize_str("samples"),
        }
    }
}

#[cfg(feature = "serde")]
impl<'de> Deserialize<'de> for EdgeAa {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(EdgeAaVisitor)
    }
}

#[cfg(feature = "serde")]
struct EdgeAaVisitor;

#[cfg(feature = "serde")]
impl serde::de::Visitor<'_> for EdgeAaVisitor {
    type Value = EdgeAa;

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("\"off\" (or false), \"on\" (or true) or \"samples\"")
    }

    fn visit_bool<E: serde::de::Error>(self, on: bool) -> Result<EdgeAa, E> {
        Ok(if on { EdgeAa::Coverage } else { EdgeAa::Off })
    }

    fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<EdgeAa, E> {
        let named = EdgeAa::ALL.into_iter().find(|edge_aa| edge_aa.name() == name);
        named.ok_or_else(|| E::invalid_value(serde::de::Unexpected::Str(name), &self))
    }
}

/// Screen-space filter, which widens splats smaller than a pixel (rendering model §4). Its radius h is
/// [`Settings::prefilter_radius_px`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
#[non_exhaustive]
pub enum Filter {
    /// No filter: the weight of a pixel is that of the splat's own kernel.
    None,
    /// Maximum of the splat's own kernel and that of a disk of radius h in the image (B05, Botsch et al. 2005, §5).
    Clamp,
    /// Each half-axis of the projected splat lengthened independently, to at least h (G06, Guennebaud et al. 2006,
    /// §4.1).
    Adjust,
    /// Projected ellipse lengthened along its own principal axes to at least h. The weight of a lengthened splat is
    /// reduced to that of its original area (Surfel's own method).
    Principal,
    /// Affine projection of the splat, convolved with a Gaussian (Z01, Zwicker et al. 2001).
    Ewa,
}

impl Filter {
    /// All screen-space filters.
    pub const ALL: [Self; 5] = [Self::None, Self::Clamp, Self::Adjust, Self::Principal, Self::Ewa];

    /// Returns the name used in files and on the command line.
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

/// Mapping by which a pixel finds its position on a splat (rendering model §3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
pub enum Mapping {
    /// Projective mapping of the splat's plane (Guennebaud 2006 §3).
    Exact,
    /// Affine approximation of the projective mapping around the projected centre (Zwicker 2001).
    Affine,
}

/// Depth tolerance: largest distance behind the nearest surface at which a fragment is blended with it (rendering model
/// §5). Scene files use `{"relative": K}` or `{"absolute": D}`; they may also use the command line's forms, `K` and
/// `"abs:D"`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(Serialize, Deserialize),
    serde(rename_all = "lowercase", from = "DepthToleranceKey")
)]
pub enum DepthTolerance {
    /// Tolerance as a multiple of the splat's larger radius; finite, at least 0.
    Relative(f64),
    /// Tolerance as a distance in world units; finite, at least 0.
    Absolute(f64),
}

#[cfg(feature = "serde")]
#[derive(Deserialize)]
#[serde(untagged, expecting = "{\"relative\": K}, {\"absolute\": D}, K or \"abs:D\"")]
enum DepthToleranceKey {
    Named(NamedTolerance),
    Number(f64),
    Text(AbsoluteText),
}

#[cfg(feature = "serde")]
#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum NamedTolerance {
    Relative(f64),
    Absolute(f64),
}

/// Absolute depth tolerance as a text of the form `abs:D`, in world units.
#[cfg(feature = "serde")]
#[derive(Deserialize)]
#[serde(try_from = "String")]
struct AbsoluteText(f64);

#[cfg(feature = "serde")]
impl TryFrom<String> for AbsoluteText {
    type Error = &'static str;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        let distance = text.strip_prefix("abs:").and_then(|distance| distance.trim().parse().ok());
        distance.map(Self).ok_or("expected abs:D")
    }
}

#[cfg(feature = "serde")]
impl From<DepthToleranceKey> for DepthTolerance {
    fn from(key: DepthToleranceKey) -> Self {
        match key {
            DepthToleranceKey::Named(NamedTolerance::Relative(k)) | DepthToleranceKey::Number(k) => Self::Relative(k),
            DepthToleranceKey::Named(NamedTolerance::Absolute(d)) | DepthToleranceKey::Text(AbsoluteText(d)) => {
                Self::Absolute(d)
            }
        }
    }
}

/// Shader: rule for the colour of a pixel (rendering model §5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
#[non_exhaustive]
pub enum Shader {
    /// Albedo (the splats' own colours) without lighting.
    Unlit,
    /// Ambient, diffuse and specular light.
    Phong,
    /// Quantised diffuse light with outlines.
    Toon,
    /// World normals as colours.
    Normal,
    /// Stored depth (rendering model §1) as a level of grey.
    Depth,
    /// Colours from the scene's matcap, an image of a lit sphere, looked up by the normal.
    Matcap,
    /// Eye-dome lighting: albedo, darkened where a pixel is deeper than its neighbours.
    Edl,
}

impl Shader {
    /// All shaders.
    pub const ALL: [Self; 7] =
        [Self::Unlit, Self::Phong, Self::Toon, Self::Normal, Self::Depth, Self::Matcap, Self::Edl];

    /// Returns the name used in files and on the command line.
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

/// Method of drawing transparent splats (rendering model §8). Written as `off`, `peel:N`, `peel:N:drop` or `abuffer:L`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(try_from = "String", into = "String"))]
pub enum Transparency {
    /// Every splat is drawn opaque.
    Off,
    /// Depth peeling (Guennebaud 2006 §6): the layers of transparent splats are drawn one by one, from front to back.
    Peel {
        /// Number of layers including the last; 1 to 64.
        layers: u32,
        /// True to omit the last layer, which blends all fragments that remain.
        drop_last: bool,
    },
    /// A-buffer (Zwicker 2001 §6): the fragments of a pixel are joined into surfaces in the order of their depths. The
    /// surfaces are then blended one over another.
    ABuffer {
        /// Maximum number of surfaces per pixel, 1 to 64. If there are more, the two nearest to each other are merged.
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
                .filter(|n| (1..=MAX_LAYERS).contains(n))
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

/// Evaluation of clip curves and lines (rendering model §7).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
pub enum ClipPolicy {
    /// Clipping by the implicit form of each curve, which is exact.
    Exact,
    /// Clipping by equation 7 of the 2012 paper on Bézier clips (C12), numerically repaired.
    Paper,
    /// Clipping by the straight chord between the ends of each curve.
    Line,
    /// No clipping: clipped splats are drawn whole.
    Off,
}

/// Method of drawing trained Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
#[non_exhaustive]
pub enum Composite {
    /// Gaussians drawn as opaque surface splats with half-axes of two standard deviations.
    #[default]
    Surface,
    /// Gaussians blended one over another, as in their training ([`crate::Geometry::Gaussians`]).
    Over,
}

/// Order in which trained Gaussians are blended one over another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
#[non_exhaustive]
pub enum Sort {
    /// Order of the centres' depths, which is the same in all pixels, as in the training of the Gaussians.
    #[default]
    Center,
    /// Order of the depths at which each pixel's ray meets the Gaussians: nothing pops when the camera turns.
    Pixel,
}

/// Minimum precision in which weighted attributes are summed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
pub enum Accumulate {
    /// 32-bit floats.
    F32,
    /// 16-bit floats (B05 §7), which halve the memory of a GPU's render targets. CPU backends gain nothing from them,
    /// and sum in a higher precision.
    F16,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(feature = "serde")]
    #[test]
    fn edge_antialiasing_is_written_as_scene_files_have_it() {
        for (edge_aa, text) in [(EdgeAa::Off, "false"), (EdgeAa::Coverage, "true"), (EdgeAa::Samples, "\"samples\"")] {
            assert_eq!(serde_json::to_string(&edge_aa).unwrap(), text);
            assert_eq!(serde_json::from_str::<EdgeAa>(text).unwrap(), edge_aa);
        }
        for edge_aa in EdgeAa::ALL {
            assert_eq!(serde_json::from_value::<EdgeAa>(edge_aa.name().into()).unwrap(), edge_aa);
        }
        let problem = serde_json::from_str::<EdgeAa>("\"sample\"").unwrap_err().to_string();
        assert!(problem.contains("expected \"off\" (or false), \"on\" (or true) or \"samples\""), "{problem}");
        assert!(serde_json::from_str::<EdgeAa>("1").is_err());
    }

    #[cfg(feature = "serde")]
    #[test]
    fn depth_tolerances_are_read_in_both_forms() {
        for (text, tolerance) in [
            (r#"{"relative": 2}"#, DepthTolerance::Relative(2.0)),
            (r#"{"absolute": 0.5}"#, DepthTolerance::Absolute(0.5)),
            ("2", DepthTolerance::Relative(2.0)),
            (r#""abs:0.5""#, DepthTolerance::Absolute(0.5)),
        ] {
            assert_eq!(serde_json::from_str::<DepthTolerance>(text).unwrap(), tolerance);
        }
        for bad in [r#""0.5""#, r#""abs:x""#, r#"{"abs": 1}"#, "[1]"] {
            let problem = serde_json::from_str::<DepthTolerance>(bad).unwrap_err().to_string();
            assert!(problem.contains(r#"{"relative": K}, {"absolute": D}, K or "abs:D""#), "{bad}: {problem}");
        }
    }

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
        for error in [0.0, -1.0, 1.000001e6, 1e308, f64::INFINITY, f64::NAN] {
            refused("lod_error_px", &|s| s.lod_error_px = error);
        }
        for filter in [Filter::None, Filter::Adjust, Filter::Ewa] {
            refused("gaussian_filter", &|s| s.gaussian_filter = filter);
        }
        assert_eq!(check(&|s| s.gaussian_filter = Filter::Principal), Ok(()));
        // A frame is drawn with one pass for each layer.
        for layers in [0, 65, u32::MAX] {
            refused("transparency", &|s| s.transparency = Transparency::Peel { layers, drop_last: false });
            refused("transparency", &|s| s.transparency = Transparency::ABuffer { layers });
        }
        assert_eq!(check(&|s| s.transparency = Transparency::ABuffer { layers: 64 }), Ok(()));
    }
}
