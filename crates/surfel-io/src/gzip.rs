//! Files wrapped by gzip: what is inside is what is loaded.

use crate::error::Problem;
use crate::files::{most_unpacked, most_unpacked_in_words};
use flate2::bufread::MultiGzDecoder;
use std::io::Read;

pub(crate) fn is_gzip(bytes: &[u8]) -> bool {
    bytes.starts_with(b"\x1f\x8b")
}

/// The whole of what a gzip file holds, its members end to end.
pub(crate) fn decompress(bytes: &[u8]) -> Result<Vec<u8>, Problem> {
    let limit = most_unpacked(bytes.len());
    let mut content = Vec::new();
    MultiGzDecoder::new(bytes).take(limit + 1).read_to_end(&mut content).map_err(|why| {
        let problem = if why.kind() == std::io::ErrorKind::UnexpectedEof {
            Problem::new(format!("the gzip file ends too early, after {} bytes of its content", content.len()))
        } else {
            Problem::new(format!("is a damaged gzip file: {why}"))
        };
        problem.help("copy or download the file again: it is incomplete or damaged")
    })?;
    if content.len() as u64 > limit {
        return Err(Problem::new(format!("holds more than {limit} bytes, compressed by gzip to {}", bytes.len()))
            .expected(most_unpacked_in_words())
            .help("unpack it first"));
    }
    Ok(content)
}
