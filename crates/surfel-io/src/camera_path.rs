//! Reader of camera paths in JSON. A camera path is a list of cameras that a film passes through, its *keys*:
//!
//! ```json
//! { "keys": [ { "camera": { "eye": [3, 0, 1], "target": [0, 0, 0], "up": [0, 0, 1],
//!                           "projection": { "perspective": { "fov_y_deg": 35 } }, "size": [640, 480] } },
//!             { "camera": "side.json", "time": 2.5 } ] }
//! ```

use crate::error::{Fault, IoError, Problem};
use crate::files;
use crate::scene_file::{self, MAX_BYTES, json};
use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::path::{Path, PathBuf};
use surfel_model::{Camera, Projection};

/// Largest number of keys in a camera path. Paths with more are refused.
const MAX_KEYS: usize = 100_000;
/// Factor for the near plane of a camera with the default near plane and without a stated far plane. The plane's
/// distance from the eye is at most `NEAR` times the target's, so that the plane clips nothing.
const NEAR: f64 = 1e-3;
/// Factor for the far plane of a parallel projection that doesn't state one. The plane's distance from the eye is `FAR`
/// times the sum of the target's distance and the view's height, so that the plane clips nothing.
const FAR: f64 = 1e3;

/// Keys of a camera path: cameras that a film passes through.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraKeys {
    /// Keys in the order of their times, at least two.
    pub keys: Vec<PathKey>,
    /// True if the film returns from the last key to the first.
    pub closed: bool,
}

/// A camera that a film passes through.
#[derive(Clone, Debug, PartialEq)]
pub struct PathKey {
    /// The camera at this point of the path.
    pub camera: Camera,
    /// Time in seconds at which the film passes through the camera. Either all keys of a path have a time or none has.
    pub time: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PathFile {
    keys: Vec<KeyFile>,
    #[serde(default)]
    closed: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyFile {
    camera: CameraEntry,
    #[serde(default)]
    time: Option<f64>,
    /// Name that the viewer stores with a camera. It is accepted in the file, but ignored.
    #[serde(default, rename = "name")]
    _name: Option<String>,
}

/// A camera in a path's file, or the name of another file with the camera.
enum CameraEntry {
    Camera(Box<Camera>),
    File(PathBuf),
}

impl<'de> Deserialize<'de> for CameraEntry {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Entry;
        impl<'de> Visitor<'de> for Entry {
            type Value = CameraEntry;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a camera, or the name of a scene file or camera file")
            }

            fn visit_str<E>(self, text: &str) -> Result<CameraEntry, E> {
                Ok(CameraEntry::File(text.into()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<CameraEntry, A::Error> {
                Camera::deserialize(MapAccessDeserializer::new(map)).map(|camera| CameraEntry::Camera(Box::new(camera)))
            }
        }
        deserializer.deserialize_any(Entry)
    }
}

/// Reads a camera path. Names of files in it are relative to its folder.
///
/// # Errors
/// [`IoError::System`] if a file can't be read. [`IoError::Invalid`] if the content isn't a camera path, with line and
/// column; for fewer than 2 or more than 100,000 keys; for an invalid camera; and for times that don't increase or that
/// only some keys have.
pub fn read(path: &Path) -> Result<CameraKeys, IoError> {
    parse(&files::read(path, MAX_BYTES)?, path)
}

/// Parses a camera path. `path` is the file that contains it, for messages; names of files in the camera path are
/// relative to the folder of this file.
///
/// # Errors
/// Errors of [`read`].
pub fn parse(bytes: &[u8], path: &Path) -> Result<CameraKeys, IoError> {
    let file: PathFile = json(bytes).map_err(|fault| fault.of(path))?;
    let refused = |problem: Problem| Err(Fault::from(problem).of(path));
    let count = file.keys.len();
    if count < 2 {
        let found = if count == 1 { "1 key".to_owned() } else { format!("{count} keys") };
        return refused(Problem::new(format!("has {found}")).expected("at least 2: the first and the last camera"));
    }
    if count > MAX_KEYS {
        return refused(Problem::new(format!("has {count} keys")).expected(format!("at most {MAX_KEYS}")));
    }
    let base = path.parent().unwrap_or(Path::new(""));
    let mut keys: Vec<PathKey> = Vec::with_capacity(count);
    for (i, KeyFile { camera, time, .. }) in file.keys.into_iter().enumerate() {
        if i > 0 && time.is_some() != keys[0].time.is_some() {
            return refused(Problem::new("has times for some keys only").expected("a time for each key, or for none"));
        }
        let before = keys.last().and_then(|key| key.time);
        if let Some((time, before)) = time.zip(before).filter(|(time, before)| time <= before) {
            let what = format!("keys[{i}].time is {time}, after {before}");
            return refused(Problem::new(what).expected("times that increase"));
        }
        let mut camera = match camera {
            CameraEntry::Camera(camera) => *camera,
            CameraEntry::File(name) => camera_of(&base.join(name))?,
        };
        choose_depths(&mut camera);
        if let Err(error) = camera.validate() {
            return refused(Problem::new(format!("keys[{i}]: {error}")));
        }
        keys.push(PathKey { camera, time });
    }
    Ok(CameraKeys { keys, closed: file.closed })
}

/// Sets the clip planes that a camera doesn't state, so that they clip nothing. If no far plane is stated, a near plane
/// with the default value moves nearer to the eye if the target is near. A parallel projection without a far plane gets
/// a distant one.
fn choose_depths(camera: &mut Camera) {
    let distance = (0..3).map(|k| (camera.target[k] - camera.eye[k]).powi(2)).sum::<f64>().sqrt();
    if camera.far.is_none() && camera.near == Camera::perspective([0.0; 3], [1.0; 3], 45.0, [1, 1]).near {
        camera.near = camera.near.min(NEAR * distance);
    }
    if let (Projection::Orthographic { height }, None) = (camera.projection, camera.far) {
        camera.far = Some(FAR * (distance + height));
    }
}

/// Reads a camera from a scene file, or from a file that contains a camera alone.
fn camera_of(path: &Path) -> Result<Camera, IoError> {
    let bytes = files::read(path, MAX_BYTES)?;
    let value: serde_json::Value = json(&bytes).map_err(|fault| fault.of(path))?;
    if value.get("camera").is_some() {
        return Ok(scene_file::parse(&bytes, path)?.camera);
    }
    json(&bytes).map_err(|fault| fault.of(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: &str = r#"{"eye": [0,0,5], "target": [0,0,0], "projection": {"perspective": {"fov_y_deg": 45}},
        "size": [64,48]}"#;

    fn read_text(text: &str) -> Result<CameraKeys, String> {
        let folder = tempfile::tempdir().unwrap();
        let scene = format!(r#"{{"camera": {CAMERA}, "objects": [{{"splats": "a.ply"}}]}}"#);
        std::fs::write(folder.path().join("scene.json"), scene).unwrap();
        std::fs::write(folder.path().join("camera.json"), CAMERA).unwrap();
        let path = folder.path().join("keys.json");
        std::fs::write(&path, text).unwrap();
        read(&path).map_err(|error| error.to_string().replace(&folder.path().display().to_string(), ""))
    }

    #[test]
    fn keys_are_cameras_or_files() {
        let text = format!(
            r#"{{"closed": true, "keys": [{{"camera": {CAMERA}, "time": 0, "name": "front"}},
                {{"camera": "scene.json", "time": 1}}, {{"camera": "camera.json", "time": 2.5}}]}}"#
        );
        let path = read_text(&text).unwrap();
        assert!(path.closed && path.keys.iter().all(|key| key.camera == path.keys[0].camera));
        assert_eq!(path.keys.iter().map(|key| key.time).collect::<Vec<_>>(), [Some(0.0), Some(1.0), Some(2.5)]);
    }

    #[test]
    fn planes_that_a_camera_leaves_out_clip_nothing() {
        let small = CAMERA.replace("[0,0,5]", "[0,0,0.005]");
        let flat = CAMERA.replace(r#""perspective": {"fov_y_deg": 45}"#, r#""orthographic": {"height": 2}"#);
        let keys = |camera: &str| format!(r#"{{"keys": [{{"camera": {camera}}}, {{"camera": {camera}}}]}}"#);
        let camera = |text: &str| read_text(&keys(text)).unwrap().keys[0].camera.clone();
        assert_eq!((camera(&small).near, camera(CAMERA).near), (5e-6, 5e-3));
        assert_eq!(camera(&flat).far, Some(7000.0));
        let stated = CAMERA.replace("\"size\"", "\"near\": 2, \"size\"");
        assert_eq!(camera(&stated).near, 2.0);
    }

    #[test]
    fn wrong_paths_are_refused_with_the_place() {
        let key = |more: &str| format!(r#"{{"camera": {CAMERA}{more}}}"#);
        let keys = |all: &[String]| format!(r#"{{"keys": [{}]}}"#, all.join(","));
        for (text, part) in [
            (keys(&[]), "has 0 keys"),
            (keys(&[key("")]), "has 1 key"),
            (keys(&[key(""), key(r#", "speed": 1"#)]), "unknown field `speed`"),
            (keys(&[key(""), r#"{"camera": {"eyes": [0,0,1]}}"#.to_owned()]), "unknown field `eyes`"),
            (keys(&[key(""), r#"{"camera": 5}"#.to_owned()]), "a camera, or the name"),
            (keys(&[key(r#", "time": 1"#), key("")]), "times for some keys only"),
            (keys(&[key(r#", "time": 1"#), key(r#", "time": 1"#)]), "times that increase"),
            (keys(&[key(""), key("").replace("[0,0,5]", "[0,0,0]")]), "keys[1]: "),
            (keys(&[key(""), r#"{"camera": "none.json"}"#.to_owned()]), "none.json"),
            (r#"{"key": []}"#.to_owned(), "unknown field `key`"),
        ] {
            let error = read_text(&text).unwrap_err();
            assert!(error.contains(part) && error.lines().count() <= 4, "{text}: {error}");
        }
    }
}
