//! Reduction of large images to the size limit of textures. PNG images are reduced row by row.

use crate::color::linear_of_8_bit;
use crate::decode::{Samples, decode, is_png, size_of, texels};
use std::io::Cursor;
use surfel_math::srgb::nearest_8_bit;
use surfel_model::Texture;

/// Decodes an image whose size has been checked, and reduces it to `width` × `height` texels, at most the image's own
/// size. Each texel is the mean of the covered pixels in linear light. A PNG that is reduced and isn't interlaced is
/// never in memory as a whole. Returns the reason if the image can't be decoded.
pub(super) fn decode_reduced(bytes: &[u8], max_bytes: usize, [width, height]: [u32; 2]) -> Result<Texture, String> {
    if (width, height) == size_of(bytes)? {
        let image = decode(bytes, max_bytes)?;
        let srgba8 = match image.samples {
            Samples::Eight(texels) => texels,
            Samples::Sixteen(texels) => texels.into_iter().map(|t| t.map(nearest_8_of_16_bit)).collect(),
        };
        return Ok(Texture { width: image.width, height: image.height, srgba8 });
    }
    if is_png(bytes) {
        let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), png::Limits { bytes: max_bytes });
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
        if !reader.info().interlaced {
            let (from, (color, depth)) = (reader.info().size(), reader.output_color_type());
            let mut reducer = Reducer::new(from, [width, height]);
            while let Some(row) = reader.next_row().map_err(|e| e.to_string())? {
                if depth == png::BitDepth::Sixteen {
                    let row = row.data().chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]]));
                    let row: Vec<u8> = row.map(nearest_8_of_16_bit).collect();
                    reducer.row(&texels(&row, color.samples(), u8::MAX));
                } else {
                    reducer.row(&texels(row.data(), color.samples(), u8::MAX));
                }
            }
            return Ok(reducer.finish());
        }
    }
    let image = decode(bytes, max_bytes)?;
    let mut reducer = Reducer::new((image.width, image.height), [width, height]);
    match image.samples {
        Samples::Eight(texels) => texels.chunks(image.width.max(1) as usize).for_each(|row| reducer.row(row)),
        Samples::Sixteen(texels) => {
            let rows = texels.chunks(image.width.max(1) as usize);
            rows.for_each(|row| reducer.row(&row.iter().map(|t| t.map(nearest_8_of_16_bit)).collect::<Vec<_>>()));
        }
    }
    Ok(reducer.finish())
}

/// Converts a 16-bit level of a channel to the nearest 8-bit level.
fn nearest_8_of_16_bit(level: u16) -> u8 {
    ((u32::from(level) + 128) / 257) as u8
}

/// Reducer of an image that is passed row by row.
struct Reducer {
    /// Number of rows of the source image.
    height: u32,
    size: [u32; 2],
    /// First source column of each output texel in a row. A last entry is the end of the last texel's columns.
    starts: Vec<usize>,
    /// Number of source rows that were passed so far.
    read: u32,
    /// Sum of linear premultiplied colours and number of pixels so far, for each texel of the current output row.
    sums: Vec<([f32; 4], f32)>,
    done: Vec<[u8; 4]>,
}

impl Reducer {
    fn new(from: (u32, u32), size: [u32; 2]) -> Self {
        let (width, to) = (u64::from(from.0), u64::from(size[0].max(1)));
        let starts = (0..=to).map(|x| (x * width).div_ceil(to) as usize).collect();
        let sums = vec![Default::default(); size[0] as usize];
        Self { height: from.1, size, starts, read: 0, sums, done: Vec::new() }
    }

    fn row(&mut self, row: &[[u8; 4]]) {
        let table = linear_of_8_bit();
        for ((sum, count), ends) in self.sums.iter_mut().zip(self.starts.windows(2)) {
            let part = row.get(ends[0]..ends[1]).unwrap_or_default();
            for [r, g, b, a] in part {
                let a = f32::from(*a) / 255.0;
                sum[0] += table[usize::from(*r)] * a;
                sum[1] += table[usize::from(*g)] * a;
                sum[2] += table[usize::from(*b)] * a;
                sum[3] += a;
            }
            *count += part.len() as f32;
        }
        let of = |row: u32| u64::from(row) * u64::from(self.size[1]) / u64::from(self.height.max(1));
        self.read += 1;
        if self.read >= self.height || of(self.read) != of(self.read - 1) {
            for (sum, count) in &mut self.sums {
                let straight = |c: f32| if sum[3] > 0.0 { nearest_8_bit(c / sum[3]) } else { 0 };
                let alpha = (sum[3] / count.max(1.0) * 255.0 + 0.5) as u8;
                self.done.push([straight(sum[0]), straight(sum[1]), straight(sum[2]), alpha]);
                (*sum, *count) = Default::default();
            }
        }
    }

    /// Returns the reduced image. Rows for which no source rows were passed are transparent.
    fn finish(mut self) -> Texture {
        let [width, height] = self.size;
        self.done.resize(width as usize * height as usize, [0; 4]);
        Texture { width, height, srgba8: self.done }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn png(width: u32, height: u32, texels: &[[u8; 4]]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.write_header().unwrap().write_image_data(texels.as_flattened()).unwrap();
        bytes
    }

    #[test]
    fn reduced_images_are_means_of_light() {
        // Alternating black and white: half the light is level 188, not 128. A transparent texel has no colour.
        let (k, w, none) = ([0, 0, 0, 255], [255; 4], [255, 0, 0, 0]);
        let bytes = png(4, 2, &[k, w, k, none, w, k, none, k]);
        let small = decode_reduced(&bytes, 1 << 20, [2, 1]).unwrap();
        assert_eq!((small.width, small.height), (2, 1));
        assert_eq!(small.srgba8, [[188, 188, 188, 255], [0, 0, 0, 128]]);
        // Sides that don't divide evenly must not change a uniform colour.
        let bytes = png(5, 3, &[w; 15]);
        for size in [[1, 1], [2, 2], [3, 1], [5, 3]] {
            let small = decode_reduced(&bytes, 1 << 20, size).unwrap();
            assert_eq!(small.srgba8, vec![w; (size[0] * size[1]) as usize], "{size:?}");
        }
        assert!(decode_reduced(&bytes[..bytes.len() - 20], 1 << 20, [2, 2]).is_err(), "a part of an image");
    }
}
