//! Lines, words and numbers of text formats, from arbitrary bytes.

#![cfg_attr(not(all(feature = "laz", feature = "pcd", feature = "points")), allow(dead_code))]

use crate::bytes::Bytes;
use crate::error::{Fault, Location, Problem};
use std::io::{BufRead, Read};

/// Iterator over the lines of a text. Each item is the line's number, from 1, and its bytes. Lines end at LF, CRLF or a
/// CR alone. A UTF-8 byte order mark at the start of the text is skipped.
pub(crate) struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
}

impl<'a> Lines<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), number: 0 }
    }

    /// Returns the text after the lines that the iterator has returned so far.
    #[cfg(feature = "pcd")]
    pub(crate) fn rest(&self) -> &'a [u8] {
        self.rest
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = (usize, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.iter().position(|&b| b == b'\n' || b == b'\r').unwrap_or(self.rest.len());
        let (line, rest) = self.rest.split_at(end);
        self.rest = match rest {
            [b'\r', b'\n', rest @ ..] | [_, rest @ ..] => rest,
            [] => rest,
        };
        self.number += 1;
        Some((self.number, line))
    }
}

/// Length in bytes, with its line feed, from which [`each_line`] refuses a line of a file. For this limit, a file whose
/// lines all end in a CR alone is one line. Text in memory has no such limit.
const MAX_LINE_BYTES: usize = 1 << 24;

/// Passes each line of a text and its number, from 1, to `each`. Lines end as in [`Lines`]. Only part of a file is in
/// memory at a time. Returns the first error of `each`, and an error for a line of [`MAX_LINE_BYTES`] or more.
pub(crate) fn each_line(
    bytes: Bytes<'_>,
    mut each: impl FnMut(usize, &[u8]) -> Result<(), Fault>,
) -> Result<(), Fault> {
    if let Bytes::Memory(bytes) = bytes {
        return Lines::new(bytes).try_for_each(|(number, line)| each(number, line));
    }
    let (mut reader, mut text, mut before) = (bytes.reader(), Vec::new(), 0);
    loop {
        // Reads up to a LF, so that a CRLF isn't split.
        let most = (MAX_LINE_BYTES - text.len()) as u64;
        let read = (&mut reader).take(most).read_until(b'\n', &mut text).unwrap_or(0);
        if read == 0 {
            return Ok(());
        }
        if text.len() == MAX_LINE_BYTES {
            let problem = Problem::new(format!("has a line of more than {MAX_LINE_BYTES} bytes"));
            return Err(problem.at(Location::Line(before + 1)).expected("a line for each point").into());
        }
        let mut lines = if before == 0 { Lines::new(&text) } else { Lines { rest: &text, number: before } };
        for (number, line) in lines.by_ref() {
            each(number, line)?;
        }
        before = lines.number;
        text.clear();
    }
}

/// Returns the words of a line, which are separated by ASCII whitespace.
pub(crate) fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty())
}

/// Converts UTF-16 text with a byte order mark, as spreadsheets write it, to UTF-8. Returns `None` for text without
/// this mark. Unpaired surrogates become U+FFFD.
pub(crate) fn utf8_of_utf16(bytes: &[u8]) -> Option<Vec<u8>> {
    let of: fn([u8; 2]) -> u16 = match bytes.first_chunk()? {
        [0xff, 0xfe] => u16::from_le_bytes,
        [0xfe, 0xff] => u16::from_be_bytes,
        _ => return None,
    };
    let units = bytes[2..].as_chunks().0.iter().map(|unit| of(*unit));
    let mut text = String::with_capacity(bytes.len() / 2);
    text.extend(char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)));
    Some(text.into_bytes())
}

/// Parses a number as printed by any C library: also `nan`, `-nan(ind)`, `inf`, `1.#QNAN`. Words that begin with
/// `1.#q`, `1.#ind` or `1.#inf`, in upper or lower case, count as such numbers, whatever follows. Returns `None` for
/// all other words.
pub(crate) fn number(word: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(word).ok()?;
    text.parse().ok().or_else(|| c_library_number(text))
}

/// Parses a number like [`number`], but rounds it directly to f32 rather than first to f64.
pub(crate) fn number_f32(word: &[u8]) -> Option<f32> {
    let text = std::str::from_utf8(word).ok()?;
    text.parse().ok().or_else(|| c_library_number(text).map(|v| v as f32))
}

fn c_library_number(text: &str) -> Option<f64> {
    let lower = text.to_ascii_lowercase();
    let magnitude = lower.trim_start_matches(['+', '-']);
    let is_nan = magnitude == "nan" || magnitude.starts_with("nan(") && magnitude.ends_with(')');
    if is_nan || magnitude.starts_with("1.#q") || magnitude.starts_with("1.#ind") {
        return Some(f64::NAN);
    }
    magnitude.starts_with("1.#inf").then(|| if lower.starts_with('-') { f64::NEG_INFINITY } else { f64::INFINITY })
}

/// Returns the number, from 1, of the line that contains the byte at `offset`.
pub(crate) fn line_at(bytes: &[u8], offset: usize) -> usize {
    let before = &bytes[..offset.min(bytes.len())];
    1 + before
        .iter()
        .enumerate()
        .filter(|&(i, &b)| b == b'\n' || (b == b'\r' && before.get(i + 1) != Some(&b'\n')))
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_in_any_of_the_three_ways() {
        let lines: Vec<_> = Lines::new(b"a\r\nb\rc\n\nd").collect();
        assert_eq!(lines, [(1, &b"a"[..]), (2, b"b"), (3, b"c"), (4, b""), (5, b"d")]);
        assert_eq!(line_at(b"a\r\nb\rc\n\nd", 7), 4);
    }

    #[test]
    fn numbers_of_every_c_library_are_read() {
        assert_eq!(number(b"-1.5e3"), Some(-1500.0));
        assert!(number(b"-nan(ind)").is_some_and(f64::is_nan));
        assert!(number(b"1.#QNAN").is_some_and(f64::is_nan));
        assert_eq!(number(b"-1.#INF"), Some(f64::NEG_INFINITY));
        assert!([&b"1,5"[..], b"nanometre", b"nan("].iter().all(|word| number(word).is_none()));
        // Halfway between two f32 values after rounding to f64: parsing as f64 first would round twice.
        assert_eq!(number_f32(b"1.00000017881393432617187499"), Some(1.000_000_1));
    }
}
