//! Lines of a stream that may never end.

use std::io::{self, BufRead, Read};

/// Result of [`read_line`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// The stream has ended.
    End,
    /// The whole line was read, with its newline unless the stream ended without one.
    Whole,
    /// The line is longer than the caller's limit, and its rest was skipped.
    TooLong,
}

/// Reads the stream's next line into `line`, replacing its contents. A line of more than `longest` bytes without its
/// newline is too long: its first `longest` + 1 bytes are stored and the rest is skipped.
///
/// # Errors
/// Errors of the stream.
pub fn read_line(input: &mut impl BufRead, line: &mut Vec<u8>, longest: usize) -> io::Result<Line> {
    line.clear();
    let count = input.by_ref().take(longest as u64 + 1).read_until(b'\n', line)?;
    if count == 0 {
        return Ok(Line::End);
    }
    if line.last() == Some(&b'\n') || count <= longest {
        return Ok(Line::Whole);
    }
    loop {
        let buffer = input.fill_buf()?;
        let newline = buffer.iter().position(|&byte| byte == b'\n');
        let (used, ended) = (newline.map_or(buffer.len(), |at| at + 1), newline.is_some() || buffer.is_empty());
        input.consume(used);
        if ended {
            return Ok(Line::TooLong);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read_up_to_a_length() {
        const LONGEST: usize = 100;
        let (long, fits) = ("x".repeat(LONGEST + 5), "y".repeat(LONGEST));
        let text = format!("a\n{long}\n\n{fits}\n{long}");
        let mut input = io::BufReader::with_capacity(7, text.as_bytes());
        let mut line = Vec::new();
        let mut next = || {
            let found = read_line(&mut input, &mut line, LONGEST).unwrap();
            assert!(line.len() <= LONGEST + 1);
            (found, line.len())
        };
        assert_eq!(next(), (Line::Whole, 2));
        assert_eq!(next().0, Line::TooLong);
        assert_eq!(next(), (Line::Whole, 1));
        assert_eq!(next(), (Line::Whole, LONGEST + 1));
        assert_eq!(next().0, Line::TooLong);
        assert_eq!(next().0, Line::End);
    }
}
