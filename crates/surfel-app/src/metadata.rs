//! Metadata in images, from which an image can be drawn again: version, scene, drawing options, and hashes of the
//! inputs.
//!
//! Metadata contain only data that determine the image. They contain no number of threads, user name or time, so that
//! the same command writes the same bytes.

use crate::render_options::RenderOptions;
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use surfel_io::IoError;
use surfel_load::Error;
use surfel_load::paths::{self, is_stdin};
use surfel_model::{Camera, SceneFile};
use surfel_render::RendererInfo;

/// Version of this package and the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Metadata key of the version of the program that drew the image.
pub const VERSION_KEY: &str = "surfel:version";
/// Metadata key of the scene file, whose paths are relative to the image's folder.
pub const SCENE_KEY: &str = "surfel:scene";
/// Metadata key of the drawing options that aren't part of the scene, such as the backend and the region ([`drawn`]).
pub const DRAWN_KEY: &str = "surfel:drawn";
/// Metadata key of the inputs and their hashes.
pub const INPUTS_KEY: &str = "surfel:inputs";

/// Largest size, in bytes, up to which a file is hashed completely. Of larger files, evenly spaced blocks are hashed:
/// hashing all would take longer than drawing with levels of detail.
const WHOLE_BYTES: u64 = 256 << 20;
/// Number of blocks that are hashed of a file larger than [`WHOLE_BYTES`], evenly spaced from its beginning to its end.
const PARTS: u64 = 64;
/// Size, in bytes, of each hashed block of a file larger than [`WHOLE_BYTES`].
const PART_BYTES: u64 = 1 << 20;

/// An input file of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Input {
    /// Absolute path, or `-` for stdin.
    pub path: PathBuf,
    /// Size and hash of the file.
    pub content: Content,
}

/// Identity of a file's content, by which `surfel again` detects that an input has changed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Content {
    /// A file with known size and hash.
    Known {
        /// Size in bytes.
        bytes: u64,
        /// SHA-256 in hexadecimal digits. For a file larger than 256 MiB, the digits follow `parts:`. The hash then
        /// covers 64 blocks of 1 MiB, evenly spaced from the file's beginning to its end.
        sha256: String,
    },
    /// Anything but a regular file, such as a pipe. It isn't hashed, because a pipe can be read only once.
    Unknown,
    /// A file that doesn't exist, although another input refers to it.
    Missing,
}

/// Returns the input files of a scene with their hashes, each file once. Inputs are the files that the scene names, and
/// the files in `beside`, to which these refer. Paths are absolute. `stdin` is the content of the input named `-`.
///
/// # Errors
/// [`Error::Io`] for a file that can't be read.
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

/// Returns size and hash of a file, or of `stdin` if the path is `-`. Returns [`Content::Missing`] if the file doesn't
/// exist, and [`Content::Unknown`] for a pipe, and for `-` without `stdin`.
///
/// # Errors
/// [`Error::Io`] if the file can't be read.
pub fn content(path: &Path, stdin: Option<&[u8]>) -> Result<Content, Error> {
    if is_stdin(path) {
        let Some(bytes) = stdin else { return Ok(Content::Unknown) };
        return Ok(Content::Known { bytes: bytes.len() as u64, sha256: digits(Sha256::new_with_prefix(bytes)) });
    }
    let failed = |source| IoError::System { path: path.to_path_buf(), action: "read it", source };
    let metadata = match path.metadata() {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Content::Missing),
        metadata => metadata.map_err(failed)?,
    };
    // A pipe must not be opened: opening one without a writer would block forever.
    if !metadata.is_file() {
        return Ok(Content::Unknown);
    }
    let bytes = metadata.len();
    let sha256 = File::open(path).and_then(|file| hash(file, bytes)).map_err(failed)?;
    Ok(Content::Known { bytes, sha256 })
}

/// Hashes a file of `bytes` bytes. Returns the text of `sha256` in [`Content::Known`].
fn hash(mut file: impl Read + Seek, bytes: u64) -> std::io::Result<String> {
    let mut hash = Sha256::new();
    let mut block = vec![0; PART_BYTES as usize];
    if bytes <= WHOLE_BYTES {
        loop {
            match file.read(&mut block)? {
                0 => return Ok(digits(hash)),
                n => hash.update(&block[..n]),
            }
        }
    }
    let last = bytes - PART_BYTES;
    for part in 0..PARTS {
        file.seek(SeekFrom::Start(part * last / (PARTS - 1)))?;
        file.read_exact(&mut block)?;
        hash.update(&block);
    }
    Ok(format!("parts:{}", digits(hash)))
}

fn digits(hash: Sha256) -> String {
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns the options that determine an image in addition to its scene, by the long names of `surfel render`'s flags.
/// `quantised` is true if the backend stores splats as 16-bit numbers. The caller adds the options of the file format.
///
/// # Errors
/// Errors of [`RenderOptions::region_of`].
pub fn drawn(
    options: &RenderOptions,
    camera: &Camera,
    quantised: bool,
    info: &RendererInfo,
) -> Result<Map<String, Value>, Error> {
    let mut drawn = Map::new();
    drawn.insert("backend".to_owned(), json!(info.backend));
    if !matches!(info.backend, "cpu" | "reference") {
        // The adapter is stored because two GPUs may round differently, which CPUs don't.
        drawn.insert("adapter".to_owned(), json!(info.adapter));
    }
    if let Some(r) = options.region_of(camera)? {
        drawn.insert("region".to_owned(), json!(format!("{},{},{},{}", r.x, r.y, r.width, r.height)));
    }
    if let Some(n) = options.samples {
        drawn.insert("samples".to_owned(), json!(n));
    }
    if !options.planes.is_empty() {
        drawn.insert("planes".to_owned(), json!(options.planes.join(",")));
    }
    if let Some(label) = &options.label {
        drawn.insert("label".to_owned(), json!(label));
    }
    if quantised {
        drawn.insert("storage".to_owned(), json!("16"));
    }
    Ok(drawn)
}

/// Returns the metadata entries, as keys and values, of an image in `folder`. The scene's paths are absolute. `drawn`
/// has the options from [`drawn`]. `is_exr` is true for an EXR file, which gets more entries.
///
/// Returns `None` if a path isn't UTF-8, since JSON must be UTF-8.
///
/// # Errors
/// [`Error`] never occurs at present.
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
        // Compositors display an EXR's attributes, where short entries are easier to read than the whole scene.
        let json = |value: serde_json::Result<String>| value.unwrap_or_default();
        entries.push(("surfel:camera", json(serde_json::to_string(&scene.camera))));
        entries.push(("surfel:settings", json(serde_json::to_string(&scene.settings))));
        if let Some(region) = drawn.get("region").and_then(Value::as_str) {
            entries.push(("surfel:region", region.to_owned()));
        }
    }
    Ok(Some(entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()))
}

/// Converts JSON to ASCII by escaping all other characters, which occur only in strings. A PNG's `tEXt` and an EXR's
/// attributes can store the result.
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

    /// A file of zeros except for one byte, which counts the bytes read.
    struct Large {
        at: u64,
        one: u64,
        read: u64,
    }

    impl Read for Large {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            buffer.fill(0);
            if let Some(byte) = self.one.checked_sub(self.at).and_then(|i| buffer.get_mut(i as usize)) {
                *byte = 1;
            }
            self.at += buffer.len() as u64;
            self.read += buffer.len() as u64;
            Ok(buffer.len())
        }
    }

    impl Seek for Large {
        fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
            let SeekFrom::Start(at) = to else { panic!("{to:?}") };
            self.at = at;
            Ok(at)
        }
    }

    #[test]
    fn large_file_is_told_by_its_parts() {
        let bytes = WHOLE_BYTES + 12_345;
        let mut read = 0;
        let mut of = |one: u64| {
            let mut file = Large { at: 0, one, read: 0 };
            let text = hash(&mut file, bytes).unwrap();
            read = file.read;
            text
        };
        let zeros = of(u64::MAX);
        assert!(zeros.strip_prefix("parts:").is_some_and(|digits| digits.len() == 64), "{zeros}");
        let inner = 30 * (bytes - PART_BYTES) / (PARTS - 1) + 17;
        for told in [0, PART_BYTES - 1, inner, bytes - 1, bytes - PART_BYTES] {
            assert_ne!(of(told), zeros, "byte {told}");
        }
        assert_eq!(of(PART_BYTES), zeros, "between parts");
        assert_eq!(read, PARTS * PART_BYTES);
    }
}
