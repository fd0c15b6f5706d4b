//! How a file becomes splats: an object's `convert` in the scene file.

use crate::ModelError;
use crate::range::positive;
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
        ] {
            let options: ConvertOptions = serde_json::from_str(text).unwrap();
            let error = options.validate(3).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        let both = r#"{"sharp": true, "splats": 5, "error": 0.1, "crease_angle": 20, "radius_scale": 2}"#;
        serde_json::from_str::<ConvertOptions>(both).unwrap().validate(0).unwrap();
    }
}
