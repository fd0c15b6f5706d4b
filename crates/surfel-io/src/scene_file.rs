//! Scene files and camera files in JSON; unknown keys are refused.

use crate::error::{Fault, IoError, Location, Problem};
use crate::files;
use serde::de::DeserializeOwned;
use std::path::Path;
use surfel_model::{Camera, SceneFile};

/// Largest size of a scene file or another JSON file that is read, in bytes. Ordinary files are far smaller.
pub(crate) const MAX_BYTES: u64 = 64 << 20;

/// Reads a scene file, without checking its numbers (`Scene::validate` and `Camera::validate` do that).
///
/// # Errors
/// [`IoError::System`] if the file can't be read. [`IoError::Invalid`] with line and column if it isn't a scene file;
/// for an unknown key, with the expected ones.
pub fn read(path: &Path) -> Result<SceneFile, IoError> {
    parse(&files::read(path, MAX_BYTES)?, path)
}

/// Reads a scene file from bytes; `name` is for messages.
///
/// # Errors
/// [`IoError::Invalid`], as [`read`].
pub fn parse(bytes: &[u8], name: &Path) -> Result<SceneFile, IoError> {
    let file: SceneFile = json(bytes).map_err(|fault| fault.of(name))?;
    for (i, object) in file.objects.iter().enumerate() {
        let found = match (&object.splats, &object.mesh) {
            (Some(_), Some(_)) => "both \"splats\" and \"mesh\"",
            (None, None) => "neither \"splats\" nor \"mesh\"",
            _ => continue,
        };
        let problem = Problem::new(format!("objects[{i}] has {found}")).expected("one of them: the object's file");
        return Err(Fault::from(problem).of(name));
    }
    Ok(file)
}

/// Reads a camera file, which contains only what a scene file has under the key `camera`.
///
/// # Errors
/// Errors of [`read`].
pub fn read_camera(path: &Path) -> Result<Camera, IoError> {
    json(&files::read(path, MAX_BYTES)?).map_err(|fault| fault.of(path))
}

/// Returns the scene file as indented text, with all defaults, ending in a newline.
pub fn to_json_pretty(file: &SceneFile) -> String {
    // Serialisation can't fail, because the type has only string keys.
    let mut text = serde_json::to_string_pretty(file).unwrap_or_default();
    text.push('\n');
    text
}

pub(crate) fn json<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, Fault> {
    serde_json::from_slice(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)).map_err(|e| json_problem(&e).into())
}

/// Converts a JSON error to a problem, with its position separate from the message.
pub(crate) fn json_problem(error: &serde_json::Error) -> Problem {
    let (line, column) = (error.line(), error.column());
    let text = error.to_string();
    let what = text.strip_suffix(&format!(" at line {line} column {column}")).unwrap_or(&text);
    let what: String = what.chars().take(400).map(|c| if c.is_control() { ' ' } else { c }).collect();
    let problem = match what.split_once(", expected ") {
        Some((found, expected)) => Problem::new(found).expected(expected),
        None => Problem::new(what),
    };
    if line > 0 { problem.at(Location::LineColumn(line, column)) } else { problem }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = r#"{"camera": {"eye": [0,0,5], "target": [0,0,0],
        "projection": {"perspective": {"fov_y_deg": 45}}, "size": [64,48]},
 "objects": [{"splats": "a.ply"}]}"#;

    #[test]
    fn scene_file_survives_writing_and_reading() {
        let file = parse(SCENE.as_bytes(), Path::new("s.json")).unwrap();
        let text = to_json_pretty(&file);
        assert!(text.contains("\"filter\": \"principal\"") && text.ends_with("}\n"), "{text}");
        assert_eq!(parse(text.as_bytes(), Path::new("s.json")).unwrap(), file);
    }

    #[test]
    fn scene_file_unknown_key_is_named_with_its_place_and_the_known_ones() {
        let text = SCENE.replace("\"splats\"", "\"splat\"");
        let error = parse(text.as_bytes(), Path::new("s.json")).unwrap_err().to_string();
        assert!(error.starts_with("s.json: unknown field `splat` (line 3, column 21)"), "{error}");
        assert!(error.contains("expected: one of `splats`, `mesh`, `matrix`"), "{error}");
        assert!(error.lines().count() <= 4);
    }

    #[test]
    fn scene_file_object_without_exactly_one_file_is_refused() {
        for (objects, found) in [(r#"{}"#, "neither"), (r#"{"splats": "a", "mesh": "b"}"#, "both")] {
            let text = SCENE.replace(r#"{"splats": "a.ply"}"#, objects);
            let error = parse(text.as_bytes(), Path::new("s.json")).unwrap_err().to_string();
            assert!(error.contains(&format!("objects[0] has {found}")), "{error}");
        }
    }

    #[test]
    fn scene_file_truncated_or_binary_is_an_error() {
        for bytes in [&SCENE.as_bytes()[..40], b"", b"\xff\xfe", b"[[[[[["] {
            assert!(parse(bytes, Path::new("s.json")).is_err());
        }
        assert!(parse("[".repeat(100_000).as_bytes(), Path::new("s.json")).is_err());
    }
}
