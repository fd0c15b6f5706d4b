//! Writing of animated PNG films: complete frames, sRGB-encoded with 8 bits and straight alpha, repeated forever.

use super::{FilmOptions, FrameRate, Frames};
use std::io::{self, Write};

/// Writes the frames as an animated PNG.
pub(super) fn write(out: &mut dyn Write, options: &FilmOptions, frames: &Frames) -> io::Result<()> {
    let [width, height] = options.size;
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    // The number of repetitions 0 means forever.
    encoder.set_animated(options.frames, 0).map_err(io::Error::other)?;
    let (numerator, denominator) = delay(options.rate);
    encoder.set_frame_delay(numerator, denominator).map_err(io::Error::other)?;
    encoder.set_blend_op(png::BlendOp::Source).map_err(io::Error::other)?;
    let mut writer = encoder.write_header().map_err(io::Error::other)?;
    while let Some(pixels) = frames.next()? {
        writer.write_image_data(pixels.as_flattened()).map_err(io::Error::other)?;
    }
    writer.finish().map_err(io::Error::other)
}

/// Returns the duration of a frame in seconds, as numerator and denominator.
fn delay(rate: FrameRate) -> (u16, u16) {
    let hundredths = rate.hundredths();
    match u16::try_from(hundredths / 100) {
        Ok(whole) if hundredths.is_multiple_of(100) && whole > 0 => (1, whole),
        // The rate is at most 240 per second, so that this is at most 24,000.
        _ => (100, u16::try_from(hundredths).unwrap_or(u16::MAX)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::tests::{SIZE, film, frame};

    #[test]
    fn animated_pngs_have_all_frames_exactly() {
        let bytes = film("a.apng", 12.5).unwrap();
        let mut reader = png::Decoder::new(io::Cursor::new(&bytes)).read_info().unwrap();
        let control = reader.info().animation_control.unwrap();
        assert_eq!((control.num_frames, control.num_plays), (3, 0));
        for index in 0..3 {
            let mut pixels = vec![0; (SIZE[0] * SIZE[1] * 4) as usize];
            reader.next_frame(&mut pixels).unwrap();
            let control = reader.info().frame_control.unwrap();
            assert_eq!((control.delay_num, control.delay_den), (100, 1250));
            assert_eq!(pixels, frame(index).as_flattened(), "{index}");
        }
    }

    #[test]
    fn delays_are_exact() {
        let of = |rate: f64| delay(FrameRate::new(rate).unwrap());
        assert_eq!(
            [of(25.0), of(0.5), of(29.97), of(240.0), of(0.01)],
            [(1, 25), (100, 50), (100, 2997), (1, 240), (100, 1)]
        );
    }
}
