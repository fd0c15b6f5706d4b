//! glTF 2.0 and GLB: points, triangles and Gaussian splats of the default scene, in world space.
//!
//! Read from the raw JSON, and not with the `gltf` crate: that one panics on attribute names it doesn't know,
//! such as those of `KHR_gaussian_splatting`, unless the whole document is validated first, and then it
//! refuses them.

mod accessor;
mod document;
mod scene;
mod uri;

use crate::error::{Fault, Location, Problem, quote};
use crate::load::{Content, Context};
use crate::scene_file::json_problem;
use document::Document;
use std::borrow::Cow;

/// Extensions that a file may require: they are read, or don't change shape and base colour.
const KNOWN_EXTENSIONS: [&str; 6] = [
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_gaussian_splatting",
    "KHR_materials_unlit",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
];

/// A document with its buffers.
struct Gltf<'a> {
    document: Document,
    buffers: Vec<Cow<'a, [u8]>>,
}

pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let (json, chunk) = if bytes.starts_with(b"glTF") { chunks(bytes)? } else { (bytes, None) };
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    let document: Document = serde_json::from_slice(json).map_err(|e| {
        let problem = json_problem(&e);
        Problem { what: format!("is not a valid glTF document: {}", problem.what), ..problem }
    })?;
    if !document.asset.version.starts_with("2.") {
        let what = format!("the glTF version is {}", quote(&document.asset.version));
        return Err(Problem::new(what).expected("\"asset\": {\"version\": \"2.0\"}").into());
    }
    if let Some(name) = document.extensions_required.iter().find(|e| !KNOWN_EXTENSIONS.contains(&e.as_str())) {
        let problem = Problem::new(format!("requires the glTF extension {}, which is not read", quote(name)));
        return Err(problem.help("export it again without compression or extensions").into());
    }
    let mut buffers = Vec::new();
    for (i, buffer) in document.buffers.iter().enumerate() {
        let data: Cow<'_, [u8]> = match (&buffer.uri, chunk) {
            (Some(uri), _) => match uri::read(uri, &context.beside) {
                Ok(data) => Cow::Owned(data),
                Err(why) => {
                    let shown = uri.get(..60).unwrap_or(uri);
                    let problem = Problem::new(format!("can't read buffer {i}, {}: {why}", quote(shown)));
                    return Err(problem.help("keep the .bin file beside the .gltf file").into());
                }
            },
            (None, Some(chunk)) if i == 0 => Cow::Borrowed(chunk),
            (None, _) => return Err(Problem::new(format!("buffer {i} has no data")).expected("a uri").into()),
        };
        if data.len() < buffer.byte_length {
            let what = format!("buffer {i} has {} bytes", data.len());
            return Err(Problem::new(what).expected(format!("{}, as it says", buffer.byte_length)).into());
        }
        buffers.push(data);
    }
    scene::build(&Gltf { document, buffers }, context)
}

/// The JSON and the binary chunk of a GLB file.
fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Fault> {
    let word = |offset: usize| {
        let raw = bytes.get(offset..offset.checked_add(4)?)?;
        Some(u32::from_le_bytes(raw.try_into().ok()?))
    };
    if word(4) != Some(2) {
        let what = format!("the GLB version is {}", word(4).map_or("missing".into(), |v| v.to_string()));
        return Err(Problem::new(what).at(Location::Byte(4)).expected("2").into());
    }
    let chunk = |offset: usize, kind: u32| {
        let length = word(offset)? as usize;
        if word(offset + 4)? != kind {
            return None;
        }
        let start = offset + 8;
        Some((bytes.get(start..start.checked_add(length)?)?, start + length))
    };
    // "JSON" and "BIN\0", little endian.
    let Some((json, end)) = chunk(12, 0x4E4F_534A) else {
        let problem = Problem::new("the GLB file has no complete JSON chunk").at(Location::Byte(12));
        return Err(problem.help("copy or export the file again: it is incomplete").into());
    };
    Ok((json, chunk(end.next_multiple_of(4), 0x004E_4942).map(|(data, _)| data)))
}
