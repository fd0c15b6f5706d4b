//! The two containers of glTF: a JSON file, and GLB, which combines JSON and a buffer in one file.

use crate::error::{Fault, Location, Problem};

/// Contents of a glTF or GLB file: the document's JSON, and a buffer.
pub(super) struct Container<'a> {
    pub(super) json: &'a [u8],
    /// Buffer inside a GLB file, which is the document's first buffer. `None` for JSON files and for GLB files without
    /// a buffer.
    pub(super) binary: Option<&'a [u8]>,
}

/// Type of a GLB chunk with JSON: "JSON" as a little-endian number.
const JSON: u32 = 0x4E4F_534A;
/// Type of a GLB chunk with a buffer: "BIN\0" as a little-endian number.
const BINARY: u32 = 0x004E_4942;

/// Detects by the signature whether a file is JSON or GLB, and splits it.
pub(super) fn split(bytes: &[u8]) -> Result<Container<'_>, Fault> {
    let (json, binary) = if bytes.starts_with(b"glTF") { chunks(bytes)? } else { (bytes, None) };
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    // The chunk is padded with spaces; some programs write zeros.
    let length = json.iter().rposition(|&b| b != 0 && !b.is_ascii_whitespace()).map_or(0, |last| last + 1);
    Ok(Container { json: &json[..length], binary })
}

/// Returns the JSON chunk and the binary chunk of a GLB file.
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
        if word(offset.checked_add(4)?)? != kind {
            return None;
        }
        let start = offset.checked_add(8)?;
        let end = start.checked_add(length)?;
        Some((bytes.get(start..end)?, end))
    };
    let Some((json, end)) = chunk(12, JSON) else {
        let problem = Problem::new("the GLB file has no complete JSON chunk").at(Location::Byte(12));
        return Err(problem.help("copy or export the file again: it is incomplete").into());
    };
    // A chunk should be padded to four bytes and its length should include the padding; some programs do only one of
    // the two.
    let binary = chunk(end, BINARY).or_else(|| chunk(end.next_multiple_of(4), BINARY));
    let whole = word(8).map_or(0, |length| length as usize);
    if binary.is_none() && bytes.len() < whole {
        let what = format!("the GLB file ends at byte {} of {whole}", bytes.len());
        return Err(Problem::new(what).help("the file is cut off: copy or download it again").into());
    }
    Ok((json, binary.map(|(data, _)| data)))
}
