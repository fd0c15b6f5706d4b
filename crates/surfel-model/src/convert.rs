//! Conversion options: the key `convert` of an object in the scene file.

use crate::range::positive;
use crate::{Classes, Condition, ModelError, PointsAs, Returns, TableColumns};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Options of the conversion of an object's file to splats. The keys are the long flags of `surfel convert`.
///
/// Absent options are chosen by the file's content. Options that don't apply to the file, such as `splats` for a splat
/// file, have no effect.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields, default))]
pub struct ConvertOptions {
    /// True to drop and count invalid splats instead of rejecting the file.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub repair: bool,
    /// Sampling of a mesh's colours, and a texture for meshes that name none.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "TextureOption::is_default"))]
    pub texture: TextureOption,
    /// True to make one splat per vertex of a mesh.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub per_vertex: bool,
    /// True to make one splat per triangle of a mesh.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub per_face: bool,
    /// Number of splats spread evenly over a mesh; with `sharp` the maximum number.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub splats: Option<SplatCount>,
    /// Maximum number of points of a point cloud, at least 1; larger clouds are reduced evenly. `None` sets no maximum,
    /// except for the default point budget of files with levels of detail.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub max_points: Option<u32>,
    /// Factor by which every radius is multiplied, greater than 0; `None` means 1.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub radius_scale: Option<f64>,
    /// True to clip splats along the sharp edges (creases) of a mesh.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub sharp: bool,
    /// Smallest angle between adjacent triangles at which their edge is a crease, in degrees from 1 to 179; with
    /// `sharp`.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub crease_angle: Option<f64>,
    /// Simplification tolerance: largest distance of the splats from the mesh, in object units, greater than 0; with
    /// `sharp`.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub error: Option<f64>,
    /// Attribute by which points and splats are coloured: `rgb`, `height`, `normal`, or a property of the file. `None`
    /// uses the colours of the file.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub color_by: Option<String>,
    /// Colour map of the values, with `color_by`.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub colormap: Option<Colormap>,
    /// File with the colours of a colour map, from the smallest value to the largest, with `color_by`.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub colormap_file: Option<PathBuf>,
    /// File with the names, and optionally the colours, of categories, with `color_by`.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub labels: Option<PathBuf>,
    /// Values at the two ends of the colour map, with `color_by`; the first is less than the second.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub range: Option<[f64; 2]>,
    /// Colours of the splats made of points: as stored, or fitted.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub colors: Option<PointColors>,
    /// Kind of splat that each point is drawn as; estimated from the points if absent.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub points_as: Option<PointsAs>,
    /// Box of the selected points, in the file's coordinates: smallest x, y, z, then largest. `None` selects points
    /// everywhere.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub crop: Option<[f64; 6]>,
    /// Classes of the selected points; `None` selects all classes.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub classes: Option<Classes>,
    /// Returns of a laser pulse that are selected; `None` selects all.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub returns: Option<Returns>,
    /// [`Condition`] for the selected points, such as `intensity>100 and not z<5`. Scene files may use a list of
    /// conditions, all of which must hold.
    #[cfg_attr(
        feature = "serde",
        serde(rename = "where", deserialize_with = "joined_conditions", skip_serializing_if = "Option::is_none")
    )]
    pub condition: Option<String>,
    /// Interval n of selected points, at least 1: every n-th of the points that the other options select, starting with
    /// the first. `None` selects every point.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub every: Option<u32>,
    /// True to select all points, even points at exactly (0, 0, 0) and more than 16 points in one place.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub all_points: bool,
    /// Handling of isolated points. Dropping them requires reading a COPC file completely.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub outliers: Option<Outliers>,
    /// True to draw all levels of detail of a COPC file, not only those that the view needs.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub all_levels: bool,
    /// True to allow references to files outside the file's own folder.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub allow_outside: bool,
    /// Longest side of a texture in texels, 1 to 32,768 (default 8192); larger textures are reduced.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub max_texture: Option<u32>,
    /// Names, and optionally types, of the columns of a table: text, NPY, NPZ, or a binary file without a header.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub columns: Option<TableColumns>,
}

#[cfg(feature = "serde")]
#[derive(Deserialize)]
#[serde(untagged, expecting = "a condition such as \"intensity>100\", or a list of conditions")]
enum ConditionKey {
    One(String),
    All(Vec<String>),
}

#[cfg(feature = "serde")]
fn joined_conditions<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    Ok(match Option::<ConditionKey>::deserialize(deserializer)? {
        None => None,
        Some(ConditionKey::One(text)) => Some(text),
        Some(ConditionKey::All(texts)) => (!texts.is_empty()).then(|| Condition::all(&texts)),
    })
}

/// Number of splats made of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(try_from = "CountKey", into = "CountKey"))]
pub enum SplatCount {
    /// The number that the mesh's geometry and texture need.
    Auto,
    /// A fixed number, 1 to 200,000,000.
    Count(u32),
}

#[cfg(feature = "serde")]
#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "a whole number of splats, or \"auto\"")]
enum CountKey {
    Count(u32),
    Word(String),
}

#[cfg(feature = "serde")]
impl TryFrom<CountKey> for SplatCount {
    type Error = String;

    fn try_from(key: CountKey) -> Result<Self, String> {
        match key {
            CountKey::Count(n) => Ok(Self::Count(n)),
            CountKey::Word(word) if word == "auto" => Ok(Self::Auto),
            CountKey::Word(word) => Err(format!("splats is \"{word}\", expected a whole number or \"auto\"")),
        }
    }
}

#[cfg(feature = "serde")]
impl From<SplatCount> for CountKey {
    fn from(count: SplatCount) -> Self {
        match count {
            SplatCount::Auto => Self::Word("auto".into()),
            SplatCount::Count(n) => Self::Count(n),
        }
    }
}

/// Sampling of a mesh's colours, and the texture file. In a scene file: `"fit"`, `"bark.png"`, or both in a list. A
/// file named like a sampling is written as `"./fit"`.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(try_from = "TextureKey", into = "TextureKey"))]
pub struct TextureOption {
    /// Texture file (PNG or JPEG), relative to the scene file. It is used for a mesh that has texture coordinates but
    /// names no texture itself.
    pub file: Option<PathBuf>,
    /// Sampling of the colours; `None` means [`TextureSampling::Point`].
    pub sampling: Option<TextureSampling>,
}

impl TextureOption {
    /// True if no option is set.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

#[cfg(feature = "serde")]
#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "\"point\", \"ewa\", \"fit\", a file's path, or one of each in a list")]
enum TextureKey {
    One(PathBuf),
    Both(Vec<PathBuf>),
}

#[cfg(feature = "serde")]
impl TryFrom<TextureKey> for TextureOption {
    type Error = String;

    fn try_from(key: TextureKey) -> Result<Self, String> {
        let all = match key {
            TextureKey::One(one) => vec![one],
            TextureKey::Both(both) => both,
        };
        let mut option = Self::default();
        for path in all {
            let sampling = path.to_str().and_then(TextureSampling::from_name);
            let is_new = match sampling {
                Some(sampling) => option.sampling.replace(sampling).is_none(),
                None => option.file.replace(path).is_none(),
            };
            if !is_new {
                return Err("texture has two files or two samplings: give one of each".into());
            }
        }
        Ok(option)
    }
}

#[cfg(feature = "serde")]
impl From<TextureOption> for TextureKey {
    fn from(option: TextureOption) -> Self {
        let plain = |file: PathBuf| {
            let is_word = file.to_str().is_some_and(|f| TextureSampling::from_name(f).is_some());
            if is_word { std::path::Path::new(".").join(file) } else { file }
        };
        let sampling = option.sampling.map(|s| PathBuf::from(s.name()));
        match (option.file.map(plain), sampling) {
            (Some(file), Some(sampling)) => Self::Both(vec![file, sampling]),
            (file, sampling) => Self::One(file.or(sampling).unwrap_or_default()),
        }
    }
}

/// Colours of the splats made of points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "kebab-case"))]
pub enum PointColors {
    /// The points' own colours. The surface blends neighbouring colours, so it is smoother than the points.
    #[default]
    AsIs,
    /// Colours fitted so that the blended surface shows the points' colours, but doesn't reproduce their noise.
    Fit,
}

/// Handling of isolated points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
pub enum Outliers {
    /// Isolated points are kept, and drawn like all others.
    #[default]
    Keep,
    /// Isolated points are dropped.
    Drop,
}

/// Sampling of a surface's colours by splats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
pub enum TextureSampling {
    /// Each splat gets the mean colour of the square that it represents.
    #[default]
    Point,
    /// Each splat gets the mean colour under its own kernel: view-independent EWA (Z01 §5).
    Ewa,
    /// All splats are fitted together, so that their blend equals the surface (Z01 §5, within the bounds of a colour).
    Fit,
}

impl TextureSampling {
    /// All ways in which splats sample a surface's colours.
    pub const ALL: [Self; 3] = [Self::Point, Self::Ewa, Self::Fit];

    /// Returns the name used in scene files and flags.
    pub fn name(self) -> &'static str {
        match self {
            Self::Point => "point",
            Self::Ewa => "ewa",
            Self::Fit => "fit",
        }
    }

    /// Returns the sampling with this name; `None` if there is none.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|sampling| sampling.name() == name)
    }
}

/// Colour map from the smallest to the largest value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
#[expect(missing_docs, reason = "the variants are the maps' own names")]
pub enum Colormap {
    Viridis,
    Cividis,
    Turbo,
    Coolwarm,
    Magma,
    Inferno,
    Plasma,
    RdBu,
    Jet,
    /// Ten colours for categories (matplotlib's `tab10`).
    Tab10,
    /// Twenty colours for categories (matplotlib's `tab20`).
    Tab20,
    /// Nine colours for categories (ColorBrewer's `Set1`).
    Set1,
    Grey,
}

impl Colormap {
    /// All built-in colour maps.
    pub const ALL: [Self; 13] = [
        Self::Viridis,
        Self::Cividis,
        Self::Turbo,
        Self::Coolwarm,
        Self::Magma,
        Self::Inferno,
        Self::Plasma,
        Self::RdBu,
        Self::Jet,
        Self::Tab10,
        Self::Tab20,
        Self::Set1,
        Self::Grey,
    ];

    /// Returns the number of colours of a map for categories; `None` for a map of a range of values.
    pub fn categories(self) -> Option<usize> {
        match self {
            Self::Tab10 => Some(10),
            Self::Tab20 => Some(20),
            Self::Set1 => Some(9),
            _ => None,
        }
    }

    /// Returns the name used in scene files and flags.
    pub fn name(self) -> &'static str {
        match self {
            Self::Viridis => "viridis",
            Self::Cividis => "cividis",
            Self::Turbo => "turbo",
            Self::Coolwarm => "coolwarm",
            Self::Magma => "magma",
            Self::Inferno => "inferno",
            Self::Plasma => "plasma",
            Self::RdBu => "rdbu",
            Self::Jet => "jet",
            Self::Tab10 => "tab10",
            Self::Tab20 => "tab20",
            Self::Set1 => "set1",
            Self::Grey => "grey",
        }
    }
}

/// One more than the largest number of splats that a mesh may be converted to: the end of the accepted range.
const SPLAT_COUNT_END: u32 = 200_000_001;

impl ConvertOptions {
    /// Valid values of [`Self::crease_angle`], in degrees.
    pub const CREASE_ANGLES_DEG: RangeInclusive<f64> = 1.0..=179.0;

    /// True if no option is set.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Validates the numbers, that no two options exclude each other, and that `sharp` or `color_by` is set for options
    /// that need it. `i` is the object's index.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] or [`ModelError::Conflict`], naming the key as in the scene file.
    pub fn validate(&self, i: usize) -> Result<(), ModelError> {
        let field = |name: &str| format!("objects[{i}].convert.{name}");
        let methods = [
            (self.per_vertex, "per_vertex"),
            (self.per_face, "per_face"),
            (self.splats.is_some() && !self.sharp, "splats"),
            (self.sharp, "sharp"),
        ];
        let mut chosen = methods.iter().filter(|(given, _)| *given).map(|(_, name)| *name);
        if let (Some(first), Some(second)) = (chosen.next(), chosen.next()) {
            return Err(ModelError::Conflict(format!("objects[{i}].convert has both {first} and {second}: give one")));
        }
        if !self.sharp && (self.crease_angle.is_some() || self.error.is_some()) {
            let name = if self.error.is_some() { "error" } else { "crease_angle" };
            return Err(ModelError::Conflict(format!("objects[{i}].convert.{name} needs \"sharp\": true beside it")));
        }
        if self.sharp && self.splats == Some(SplatCount::Auto) {
            let problem =
                format!("objects[{i}].convert.splats is \"auto\", but \"sharp\" chooses by \"error\": give that");
            return Err(ModelError::Conflict(problem));
        }
        if let Some(SplatCount::Count(n @ (0 | SPLAT_COUNT_END..))) = self.splats {
            return Err(ModelError::range(field("splats"), n, "1 to 200000000"));
        }
        if self.max_points == Some(0) {
            return Err(ModelError::range(field("max_points"), 0, "at least 1"));
        }
        if let Some(angle) = self.crease_angle.filter(|a| !Self::CREASE_ANGLES_DEG.contains(a)) {
            return Err(ModelError::range(field("crease_angle"), angle, "degrees from 1 to 179"));
        }
        if self.color_by.is_none() && (self.colormap.is_some() || self.range.is_some()) {
            let name = if self.range.is_some() { "range" } else { "colormap" };
            return Err(ModelError::Conflict(format!("objects[{i}].convert.{name} needs color_by beside it")));
        }
        if let Some([lo, hi]) = self.range.filter(|[lo, hi]| !(lo < hi && (hi - lo).is_finite())) {
            let expected = "two finite numbers, the first less than the second";
            return Err(ModelError::range(field("range"), format!("{lo},{hi}"), expected));
        }
        if let Some(c) = self.crop.filter(|c| c.iter().any(|v| v.is_nan()) || (0..3).any(|k| c[k] > c[k + 3])) {
            let expected = "least x, y, z, then largest x, y, z, none less than its least";
            return Err(ModelError::range(field("crop"), format!("{c:?}"), expected));
        }
        if let Some(Err(problem)) = self.condition.as_deref().map(Condition::parse) {
            return Err(ModelError::Conflict(format!("objects[{i}].convert.where {problem}")));
        }
        if self.every == Some(0) {
            return Err(ModelError::range(field("every"), 0, "at least 1"));
        }
        if let Some(n) = self.max_texture.filter(|n| !(1..=32_768).contains(n)) {
            return Err(ModelError::range(field("max_texture"), n, "1 to 32768"));
        }
        self.radius_scale.map_or(Ok(()), |scale| positive(&field("radius_scale"), scale))?;
        self.error.map_or(Ok(()), |error| positive(&field("error"), error))
    }
}

#[cfg(feature = "serde")]
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde's form")]
fn is_false(value: &bool) -> bool {
    !value
}

#[cfg(all(test, feature = "serde"))]
mod tests {
    use super::*;

    #[test]
    fn keys_are_the_flags_and_what_is_not_said_is_not_written() {
        let chosen = r#"{"color_by":"intensity","colormap":"turbo","range":[0.0,9.0],"crop":[0.0,0.0,0.0,1.0,1.0,1.0],"#
            .to_owned()
            + r#""classes":[2,6],"returns":"last","where":"z > 1","every":3,"allow_outside":true,"max_texture":64,"#
            + r#""columns":"f4:x,y,z,u1:r,g,b,_"}"#;
        let read: ConvertOptions = serde_json::from_str(&chosen).unwrap();
        read.validate(0).unwrap();
        assert_eq!(serde_json::to_string(&read).unwrap(), chosen);
        let text = r#"{"splats":500,"radius_scale":1.5,"sharp":true,"crease_angle":30.0}"#;
        let read: ConvertOptions = serde_json::from_str(text).unwrap();
        assert_eq!(
            (read.splats, read.radius_scale, read.sharp, read.crease_angle),
            (Some(SplatCount::Count(500)), Some(1.5), true, Some(30.0))
        );
        assert_eq!(serde_json::to_string(&read).unwrap(), text);
        assert_eq!(serde_json::to_string(&ConvertOptions::default()).unwrap(), "{}");
        assert!(serde_json::from_str::<ConvertOptions>(r#"{"splat":5}"#).is_err());
        let wrong = serde_json::from_str::<ConvertOptions>(r#"{"columns":"x,y"}"#).unwrap_err().to_string();
        assert!(wrong.contains("columns names too few columns"), "{wrong}");
    }

    #[test]
    fn classes_and_conditions_are_texts_or_lists() {
        let read = |text: &str| serde_json::from_str::<ConvertOptions>(text);
        for text in [r#"{"classes":[2,6]}"#, r#"{"classes":"!7,18"}"#, r#"{"classes":"all","where":"a>1"}"#] {
            assert_eq!(serde_json::to_string(&read(text).unwrap()).unwrap(), text);
        }
        assert_eq!(read(r#"{"classes": "2,6"}"#).unwrap(), read(r#"{"classes": [2, 6]}"#).unwrap());
        assert_eq!(read(r#"{"classes": []}"#).unwrap().classes, Some(Classes::All));
        let joined = read(r#"{"where": ["a>1 or b>1", "c>1"]}"#).unwrap().condition;
        assert_eq!(joined.as_deref(), Some("(a>1 or b>1) and (c>1)"));
        assert_eq!(read(r#"{"where": []}"#).unwrap().condition, None);
        for (text, part) in [
            (r#"{"classes": "ground"}"#, "expected numbers of classes"),
            (r#"{"classes": [2.5]}"#, "a list of classes such as [2, 6]"),
            (r#"{"where": 5}"#, "or a list of conditions"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn a_texture_is_a_sampling_a_file_or_both() {
        let read = |text: &str| serde_json::from_str::<ConvertOptions>(text);
        for text in [
            r#"{"texture":"fit"}"#,
            r#"{"texture":"bark.png"}"#,
            r#"{"texture":["bark.png","ewa"]}"#,
            r#"{"texture":"./point","splats":"auto","colors":"as-is"}"#,
        ] {
            assert_eq!(serde_json::to_string(&read(text).unwrap()).unwrap(), text);
        }
        let both = read(r#"{"texture": ["fit", "a.png"]}"#).unwrap().texture;
        assert_eq!(both, TextureOption { file: Some("a.png".into()), sampling: Some(TextureSampling::Fit) });
        let named = TextureOption { file: Some("fit".into()), sampling: None };
        assert_eq!(serde_json::to_string(&named).unwrap(), r#""./fit""#);
        for (text, part) in [
            (r#"{"texture": ["a.png", "b.png"]}"#, "two files"),
            (r#"{"texture": 5}"#, "a file's path"),
            (r#"{"splats": "many"}"#, "auto"),
            (r#"{"splats": 1.5}"#, "whole number"),
            (r#"{"colors": "blur"}"#, "as-is"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn options_out_of_range_and_contradictions_are_named() {
        for (text, part) in [
            (r#"{"splats": 0}"#, "objects[3].convert.splats"),
            (r#"{"max_points": 0}"#, "objects[3].convert.max_points"),
            (r#"{"radius_scale": -1}"#, "objects[3].convert.radius_scale"),
            (r#"{"sharp": true, "error": 0}"#, "objects[3].convert.error"),
            (r#"{"sharp": true, "crease_angle": 0.5}"#, "objects[3].convert.crease_angle"),
            (r#"{"sharp": true, "crease_angle": 179.5}"#, "objects[3].convert.crease_angle"),
            (r#"{"crease_angle": 20}"#, "sharp"),
            (r#"{"sharp": true, "splats": "auto"}"#, "objects[3].convert.splats"),
            (r#"{"splats": 200000001}"#, "objects[3].convert.splats"),
            (r#"{"per_face": true, "per_vertex": true}"#, "both per_vertex and per_face"),
            (r#"{"per_face": true, "splats": 5}"#, "both per_face and splats"),
            (r#"{"per_face": true, "sharp": true}"#, "both per_face and sharp"),
            (r#"{"colormap": "turbo"}"#, "objects[3].convert.colormap needs color_by"),
            (r#"{"range": [0, 1]}"#, "objects[3].convert.range needs color_by"),
            (r#"{"color_by": "x", "range": [1, 1]}"#, "objects[3].convert.range"),
            (r#"{"crop": [0, 0, 0, 1, -1, 1]}"#, "objects[3].convert.crop"),
            (r#"{"where": "intensity"}"#, "objects[3].convert.where ends after character 9"),
            (r#"{"where": ["a>1", "b"]}"#, "objects[3].convert.where has ')' at character 13"),
            (r#"{"every": 0}"#, "objects[3].convert.every"),
            (r#"{"max_texture": 0}"#, "objects[3].convert.max_texture"),
        ] {
            let options: ConvertOptions = serde_json::from_str(text).unwrap();
            let error = options.validate(3).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        let both = r#"{"sharp": true, "splats": 5, "error": 0.1, "crease_angle": 20, "radius_scale": 2}"#;
        serde_json::from_str::<ConvertOptions>(both).unwrap().validate(0).unwrap();
    }
}
