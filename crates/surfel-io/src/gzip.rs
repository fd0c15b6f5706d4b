//! Decompression of files with gzip, whose content is then loaded.

use crate::bytes::Bytes;
use crate::error::Problem;
use crate::files::{most_unpacked, most_unpacked_in_words, pour};
use flate2::bufread::MultiGzDecoder;
use std::io::{self, Write};

pub(crate) fn is_gzip(bytes: &[u8]) -> bool {
    // Deflate is gzip's only method (byte 8), so that the third byte excludes most other files.
    bytes.starts_with(b"\x1f\x8b") && bytes.get(2).is_none_or(|method| *method == 8)
}

/// Unpacks a gzip file to `out`. If the file has several members, their contents are concatenated. Returns an error if
/// the file is damaged, or if it unpacks to more than [`most_unpacked`] bytes.
pub(crate) fn unpack(bytes: Bytes<'_>, out: &mut dyn Write) -> Result<(), Problem> {
    let limit = most_unpacked(bytes.len());
    let (unpacked, failed) = pour(MultiGzDecoder::new(bytes.reader()), limit + 1, out)?;
    if let Some(why) = failed {
        let problem = if why.kind() == io::ErrorKind::UnexpectedEof {
            Problem::new(format!("the gzip file ends too early, after {unpacked} bytes of its content"))
        } else {
            Problem::new(format!("is a damaged gzip file: {why}"))
        };
        return Err(problem.help("copy or download the file again: it is incomplete or damaged"));
    }
    if unpacked > limit {
        return Err(Problem::new(format!("holds more than {limit} bytes, compressed by gzip to {}", bytes.len()))
            .expected(most_unpacked_in_words())
            .help("unpack it first"));
    }
    Ok(())
}

/// Returns the first bytes of a gzip file's content, at most `most` and only those before any damage, and the estimated
/// size of the whole content in bytes. The size is extrapolated from the start.
#[cfg(feature = "laz")]
pub(crate) fn head(bytes: Bytes<'_>, most: usize) -> (Vec<u8>, u64) {
    let mut reader = bytes.source();
    let mut decoder = MultiGzDecoder::new(io::BufReader::with_capacity(1 << 12, &mut reader));
    let mut head = Vec::new();
    let _ = pour(&mut decoder, most as u64, &mut head);
    drop(decoder);
    let taken = io::Seek::stream_position(&mut reader).unwrap_or(0).max(1);
    let all = head.len() as f64 * (bytes.len() as f64 / taken as f64);
    (head, all as u64)
}
