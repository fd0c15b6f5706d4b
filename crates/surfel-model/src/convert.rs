//! How a file becomes splats: an object's `convert` in the scene file.

use crate::range::positive;
use crate::{ModelError, Returns, parse_conditions};
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// How an object's file becomes splats. The keys are the long flags of `surfel convert`; what isn't said is chosen by
/// what the file holds, and what says nothing about that (`splats` of a splat file) has no effect.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields, default))]
pub struct ConvertOptions {
    /// Invalid splats are dropped and counted instead of refusing the file.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub repair: bool,
    /// Texture (PNG or JPEG) of a mesh with texture coordinates that names none itself, relative to the scene file.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub texture: Option<PathBuf>,
    /// One splat for each vertex of a mesh.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub per_vertex: bool,
    /// One splat for each triangle of a mesh.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub per_face: bool,
    /// This many splats spread evenly over a mesh, 1 to 200,000,000; with `sharp` at most this many.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub splats: Option<u32>,
    /// At most this many points of a point cloud, at least 1; evenly chosen.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub max_points: Option<u32>,
    /// Multiplies every radius; greater than 0.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub radius_scale: Option<f64>,
    /// Splats are clipped along creases.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub sharp: bool,
    /// With `sharp`: angle from which an edge is a crease, in degrees from 0 to 180.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub crease_angle: Option<f64>,
    /// With `sharp`: largest distance from the mesh that simplification may cause, in object units; greater than 0.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub error: Option<f64>,
    /// The attribute that points and splats are coloured by: `rgb`, `height`, `normal`, or a property of the file.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub color_by: Option<String>,
    /// Colours of values, with `color_by`.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub colormap: Option<Colormap>,
    /// Values at the two ends of the colour map, with `color_by`; the first less than the second.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub range: Option<[f64; 2]>,
    /// Only points within this box count: least x, y, z, then largest.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub crop: Option<[f64; 6]>,
    /// Only points of these classes count; empty: all.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Vec::is_empty"))]
    pub classes: Vec<u32>,
    /// Only these of a pulse's returns count.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub returns: Option<Returns>,
    /// Only points of which this is true count: comparisons such as `intensity>100`, joined by `and`.
    #[cfg_attr(feature = "serde", serde(rename = "where", skip_serializing_if = "Option::is_none"))]
    pub condition: Option<String>,
    /// Only every so-manyth point counts, the first included; at least 1.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub every: Option<u32>,
    /// Points at exactly (0, 0, 0), and more than 16 in one place, count as well.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub all_points: bool,
    /// All levels of a COPC file are drawn, not only those that the view needs.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub all_levels: bool,
    /// The file may refer to files outside of its own folder.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "is_false"))]
    pub allow_outside: bool,
    /// Longest side of a texture in texels, 1 to 32,768 (default 8192): larger ones are reduced.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub max_texture: Option<u32>,
}

/// Colours of values from the least to the largest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
#[expect(missing_docs, reason = "the variants are the maps' own names")]
pub enum Colormap {
    Viridis,
    Cividis,
    Turbo,
    Coolwarm,
    /// Twenty colours for categories.
    Tab20,
    Grey,
}

impl Colormap {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Viridis, Self::Cividis, Self::Turbo, Self::Coolwarm, Self::Tab20, Self::Grey];

    /// Its name in scene files and flags.
    pub fn name(self) -> &'static str {
        match self {
            Self::Viridis => "viridis",
            Self::Cividis => "cividis",
            Self::Turbo => "turbo",
            Self::Coolwarm => "coolwarm",
            Self::Tab20 => "tab20",
            Self::Grey => "grey",
        }
    }
}

/// Largest number of splats that may be asked of a mesh.
const MAX_SPLATS: u32 = 200_000_000;

impl ConvertOptions {
    /// True if nothing is said.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Checks the numbers, and that no two options exclude each other; `i` is the object's index.
    ///
    /// # Errors
    /// [`ModelError`] naming the key as it is called in the scene file.
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
        if let Some(n) = self.splats.filter(|n| !(1..=MAX_SPLATS).contains(n)) {
            return Err(ModelError::range(field("splats"), n, "1 to 200000000"));
        }
        if self.max_points == Some(0) {
            return Err(ModelError::range(field("max_points"), 0, "at least 1"));
        }
        if let Some(angle) = self.crease_angle.filter(|a| !(0.0..=180.0).contains(a)) {
            return Err(ModelError::range(field("crease_angle"), angle, "degrees from 0 to 180"));
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
        if let Some(Err(problem)) = self.condition.as_deref().map(parse_conditions) {
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
            + r#""classes":[2,6],"returns":"last","where":"z > 1","every":3,"allow_outside":true,"max_texture":64}"#;
        let read: ConvertOptions = serde_json::from_str(&chosen).unwrap();
        read.validate(0).unwrap();
        assert_eq!(serde_json::to_string(&read).unwrap(), chosen);
        let text = r#"{"splats":500,"radius_scale":1.5,"sharp":true,"crease_angle":30.0}"#;
        let read: ConvertOptions = serde_json::from_str(text).unwrap();
        assert_eq!(
            (read.splats, read.radius_scale, read.sharp, read.crease_angle),
            (Some(500), Some(1.5), true, Some(30.0))
        );
        assert_eq!(serde_json::to_string(&read).unwrap(), text);
        assert_eq!(serde_json::to_string(&ConvertOptions::default()).unwrap(), "{}");
        assert!(serde_json::from_str::<ConvertOptions>(r#"{"splat":5}"#).is_err());
    }

    #[test]
    fn options_out_of_range_and_contradictions_are_named() {
        for (text, part) in [
            (r#"{"splats": 0}"#, "objects[3].convert.splats"),
            (r#"{"max_points": 0}"#, "objects[3].convert.max_points"),
            (r#"{"radius_scale": -1}"#, "objects[3].convert.radius_scale"),
            (r#"{"sharp": true, "error": 0}"#, "objects[3].convert.error"),
            (r#"{"sharp": true, "crease_angle": 181}"#, "objects[3].convert.crease_angle"),
            (r#"{"crease_angle": 20}"#, "sharp"),
            (r#"{"per_face": true, "per_vertex": true}"#, "both per_vertex and per_face"),
            (r#"{"per_face": true, "splats": 5}"#, "both per_face and splats"),
            (r#"{"per_face": true, "sharp": true}"#, "both per_face and sharp"),
            (r#"{"colormap": "turbo"}"#, "objects[3].convert.colormap needs color_by"),
            (r#"{"range": [0, 1]}"#, "objects[3].convert.range needs color_by"),
            (r#"{"color_by": "x", "range": [1, 1]}"#, "objects[3].convert.range"),
            (r#"{"crop": [0, 0, 0, 1, -1, 1]}"#, "objects[3].convert.crop"),
            (r#"{"where": "intensity"}"#, "objects[3].convert.where"),
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
