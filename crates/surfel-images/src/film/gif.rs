//! Writing of GIF films, repeated forever: frames of at most 256 colours, dithered if they had more.

use super::palette::Quantiser;
use super::{FilmOptions, Frames};
use std::io::{self, Write};

/// Unit of a GIF's delays, as units per second: a delay is in hundredths of a second.
const UNITS: u64 = 100;

/// Writes the frames as a GIF. The pixels must be opaque.
pub(super) fn write(out: &mut dyn Write, options: &FilmOptions, frames: &Frames) -> io::Result<()> {
    let too_large = |_| io::Error::new(io::ErrorKind::InvalidInput, "the frames are too large for a GIF");
    let [width, height] = options.size;
    let (wide, high) = (u16::try_from(width).map_err(too_large)?, u16::try_from(height).map_err(too_large)?);
    let mut encoder = gif::Encoder::new(out, wide, high, &[]).map_err(io::Error::other)?;
    encoder.set_repeat(gif::Repeat::Infinite).map_err(io::Error::other)?;
    let mut quantiser = Quantiser::default();
    let mut number = 0;
    while let Some(pixels) = frames.next()? {
        // Delays are whole units. They are differences of rounded times, so that rounding errors don't accumulate.
        let delay = options.rate.time(number + 1, UNITS) - options.rate.time(number, UNITS);
        number += 1;
        let indices = quantiser.indices(&pixels, width as usize);
        let frame = gif::Frame {
            width: wide,
            height: high,
            delay: u16::try_from(delay).unwrap_or(u16::MAX),
            dispose: gif::DisposalMethod::Keep,
            palette: Some(quantiser.palette().as_flattened().to_vec()),
            buffer: indices.into(),
            ..gif::Frame::default()
        };
        encoder.write_frame(&frame).map_err(io::Error::other)?;
    }
    encoder.into_inner().map_err(io::Error::other)?.flush()
}

#[cfg(test)]
mod tests {
    use crate::film::blend;
    use crate::film::tests::{film, frame};

    #[test]
    fn gifs_have_all_frames_nearly() {
        let bytes = film("a.gif", 30.0).unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(&bytes[..]).unwrap();
        for (index, delay) in [3, 4, 3].into_iter().enumerate() {
            let found = decoder.read_next_frame().unwrap().unwrap();
            let mut want = frame(index as u32);
            blend(&mut want, [1.0; 3]);
            assert_eq!(found.delay, delay);
            // Fewer than 256 colours are exact.
            assert_eq!(&found.buffer[..], want.as_flattened(), "{index}");
        }
        assert!(decoder.read_next_frame().unwrap().is_none());
        assert_eq!(decoder.repeat(), gif::Repeat::Infinite);
    }
}
