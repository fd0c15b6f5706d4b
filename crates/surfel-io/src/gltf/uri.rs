//! URIs of buffers and images: `data:` and relative paths.

use crate::files::Beside;

/// What a URI refers to.
pub(super) fn read(uri: &str, beside: &Beside) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let Some((kind, data)) = data.split_once(',') else {
            return Err("the data URI has no comma".into());
        };
        if !kind.ends_with(";base64") {
            return Ok(percent_decode(data));
        }
        return base64(data.as_bytes()).ok_or_else(|| "its base64 is damaged".into());
    }
    if uri.contains("://") {
        return Err("only files and data URIs are read".into());
    }
    let path = String::from_utf8(percent_decode(uri)).map_err(|_| "its name is not text")?;
    beside.read(&path)
}

fn percent_decode(text: &str) -> Vec<u8> {
    let mut out = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let [first, after @ ..] = rest {
        let hex = |b: &u8| char::from(*b).to_digit(16);
        match (first, after) {
            (b'%', [a, b, tail @ ..]) if hex(a).is_some() && hex(b).is_some() => {
                out.push((hex(a).unwrap_or(0) * 16 + hex(b).unwrap_or(0)) as u8);
                rest = tail;
            }
            _ => {
                out.push(*first);
                rest = after;
            }
        }
    }
    out
}

/// RFC 4648, either alphabet, with or without padding; blanks are skipped.
fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len() / 4 * 3 + 3);
    let (mut bits, mut count) = (0_u32, 0);
    for &b in text {
        let value = match b {
            b'A'..=b'Z' => b - b'A',
            b'a'..=b'z' => b - b'a' + 26,
            b'0'..=b'9' => b - b'0' + 52,
            b'+' | b'-' => 62,
            b'/' | b'_' => 63,
            b'=' => break,
            b' ' | b'\n' | b'\r' | b'\t' => continue,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        count += 1;
        if count == 4 {
            out.extend_from_slice(&bits.to_be_bytes()[1..]);
            (bits, count) = (0, 0);
        }
    }
    match count {
        0 => {}
        2 => out.push((bits >> 4) as u8),
        3 => out.extend_from_slice(&((bits >> 2) as u16).to_be_bytes()),
        _ => return None,
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_uris_are_decoded() {
        // RFC 4648 §10.
        for (text, expected) in [("", ""), ("Zg==", "f"), ("Zm8", "fo"), ("Zm9v", "foo"), ("Zm9vYmFy", "foobar")] {
            let uri = format!("data:application/octet-stream;base64,{text}");
            assert_eq!(read(&uri, &Beside::Nowhere).unwrap(), expected.as_bytes());
        }
        assert_eq!(read("data:,a%20b%", &Beside::Nowhere).unwrap(), b"a b%");
        assert!(read("data:;base64,Z!", &Beside::Nowhere).is_err());
        assert!(read("data:;base64,Z", &Beside::Nowhere).is_err());
        assert!(read("data:", &Beside::Nowhere).is_err());
        assert!(read("http://a/b", &Beside::Nowhere).is_err());
    }
}
