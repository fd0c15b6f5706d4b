//! What an image carries, so that it can be drawn again: version, scene, how it was drawn, and its inputs' hashes.
//!
//! Only what decides the image: neither threads nor names nor times, so that the same command writes the same bytes.

use crate::Error;
use crate::paths::{self, is_stdin};
use crate::render_options::RenderOptions;
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use surfel_io::IoError;
use surfel_model::{Camera, SceneFile};
use surfel_render::RendererInfo;

/// This program's version.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Keyword of the version.
pub const VERSION_KEY: &str = "surfel:version";
/// Keyword of the scene file, whose paths are relative to the image's folder.
pub const SCENE_KEY: &str = "surfel:scene";
/// Keyword of what decides the image beside the scene.
pub const DRAWN_KEY: &str = "surfel:drawn";
/// Keyword of the inputs and their hashes.
pub const INPUTS_KEY: &str = "surfel:inputs";

/// A file that an image is made of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Input {
    /// Absolute, or `-` for stdin.
    pub path: PathBuf,
    /// What it holds.
    pub content: Content,
}

/// What a file holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Content {
    /// Size in bytes and SHA-256 in hexadecimal digits.
    Known {
        /// Bytes.
        bytes: u64,
        /// Digits.
        sha256: String,
    },
    /// A pipe, which is read but once.
    Unknown,
    /// A file that another one refers to, and that isn't there.
    Missing,
}

/// The files that a scene names and those that these refer to (`beside`), each once, with their hashes; paths are
/// absolute. `stdin` is what the name `-` stands for.
///
/// # Errors
/// [`Error::Io`] for one that can't be read.
pub fn inputs(file: &SceneFile, beside: &BTreeSet<PathBuf>, stdin: Option<&[u8]>) -> Result<Vec<Input>, Error> {
    let mut names = beside.clone();
    paths::for_each(&mut file.clone(), |path| {
        names.insert(path.clone());
        Ok(())
    })?;
    let objects = file.objects.iter().flat_map(|o| [&o.splats, &o.mesh]).flatten();
    names.extend(objects.filter(|path| is_stdin(path)).cloned());
    names.into_iter().map(|path| Ok(Input { content: content(&path, stdin)?, path })).collect()
}

/// Size and hash of a file, or of `stdin` where its name is `-`.
///
/// # Errors
/// [`Error::Io`] if it can't be read.
pub fn content(path: &Path, stdin: Option<&[u8]>) -> Result<Content, Error> {
    let mut hash = Sha256::new();
    let bytes = if is_stdin(path) {
        let Some(bytes) = stdin else { return Ok(Content::Unknown) };
        hash.update(bytes);
        bytes.len() as u64
    } else {
        let failed = |source| IoError::System { path: path.to_path_buf(), action: "read it", source };
        let metadata = match path.metadata() {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Content::Missing),
            metadata => metadata.map_err(failed)?,
        };
        // To open a pipe that nobody writes to would wait forever.
        if !metadata.is_file() {
            return Ok(Content::Unknown);
        }
        let mut file = File::open(path).map_err(failed)?;
        let (mut size, mut block) = (0, vec![0; 1 << 20]);
        loop {
            let n = file.read(&mut block).map_err(failed)?;
            if n == 0 {
                break size;
            }
            hash.update(&block[..n]);
            size += n as u64;
        }
    };
    let sha256 = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    Ok(Content::Known { bytes, sha256 })
}

/// How a camera's image is drawn, beside its scene: flags of `render` by their long names. What is said of the file's
/// format is the caller's to add.
///
/// # Errors
/// As [`RenderOptions::region_of`].
pub fn drawn(
    options: &RenderOptions,
    camera: &Camera,
    quantised: bool,
    info: &RendererInfo,
) -> Result<Map<String, Value>, Error> {
    let mut drawn = Map::new();
    drawn.insert("backend".to_owned(), json!(info.backend));
    if !matches!(info.backend, "cpu" | "reference") {
        // Two GPUs may round differently; CPUs don't.
        drawn.insert("adapter".to_owned(), json!(info.adapter));
    }
    if let Some(r) = options.region_of(camera)? {
        drawn.insert("region".to_owned(), json!(format!("{},{},{},{}", r.x, r.y, r.width, r.height)));
    }
    if let Some(n) = options.samples {
        drawn.insert("samples".to_owned(), json!(n));
    }
    if quantised {
        drawn.insert("storage".to_owned(), json!("16"));
    }
    Ok(drawn)
}

/// The entries of an image in `folder`: of a scene with absolute paths, and its inputs.
///
/// `None` if a path is not UTF-8, which JSON must be.
///
/// # Errors
/// None today.
pub fn entries(
    folder: &Path,
    scene: &SceneFile,
    inputs: &[Input],
    drawn: &Map<String, Value>,
    is_exr: bool,
) -> Result<Option<Vec<(String, String)>>, Error> {
    let Ok(text) = serde_json::to_string(&paths::relative_to(folder, scene)?) else { return Ok(None) };
    let mut list = Vec::new();
    for Input { path, content } in inputs {
        let path = if is_stdin(path) { path.clone() } else { paths::relative(path, folder) };
        let Some(path) = path.to_str() else { return Ok(None) };
        list.push(match content {
            Content::Known { bytes, sha256 } => json!({ "path": path, "bytes": bytes, "sha256": sha256 }),
            Content::Unknown => json!({ "path": path }),
            Content::Missing => json!({ "path": path, "missing": true }),
        });
    }
    let mut entries = vec![
        (VERSION_KEY, VERSION.to_owned()),
        (SCENE_KEY, ascii(&text)),
        (DRAWN_KEY, ascii(&json!(drawn).to_string())),
        (INPUTS_KEY, ascii(&Value::Array(list).to_string())),
    ];
    if is_exr {
        // Compositors show an EXR's attributes, where parts are easier to read than the whole.
        let json = |value: serde_json::Result<String>| value.unwrap_or_default();
        entries.push(("surfel:camera", json(serde_json::to_string(&scene.camera))));
        entries.push(("surfel:settings", json(serde_json::to_string(&scene.settings))));
        if let Some(region) = drawn.get("region").and_then(Value::as_str) {
            entries.push(("surfel:region", region.to_owned()));
        }
    }
    Ok(Some(entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()))
}

/// JSON in ASCII: other characters occur in strings alone, where they may be escaped. So it fits into a PNG's `tEXt`
/// and an EXR's attributes.
fn ascii(json: &str) -> String {
    let mut text = String::with_capacity(json.len());
    for c in json.chars() {
        if c.is_ascii() {
            text.push(c);
        } else {
            text.extend(c.encode_utf16(&mut [0; 2]).iter().map(|unit| format!("\\u{unit:04x}")));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ascii_json_is_the_same_json() {
        let value = json!({ "path": "größe/☃/𝒳 \"\\.ply" });
        let text = ascii(&value.to_string());
        assert!(text.is_ascii());
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), value);
    }

    #[test]
    fn content_is_told_by_size_and_sha_256() {
        let path = std::env::temp_dir().join(format!("surfel-hash-{}", std::process::id()));
        std::fs::write(&path, "abc").unwrap();
        let found = content(&path, None).unwrap();
        std::fs::remove_file(&path).unwrap();
        // FIPS 180-2, appendix B.1.
        let digest = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(found, Content::Known { bytes: 3, sha256: digest.to_owned() });
        assert_eq!(content(&path, None).unwrap(), Content::Missing);
    }
}
