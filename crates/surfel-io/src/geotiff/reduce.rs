//! Overviews of a GeoTIFF: each pixel is the mean of up to four pixels of the next larger image.
//!
//! Colours are averaged in linear light, weighted by alpha. Numbers are averaged over the pixels that have data. Images
//! with three numbers per pixel contain normals, whose means are normalised.

use super::{GeoImage, GeoSamples, TILE};
use crate::color::linear_of_8_bit;
use surfel_math::srgb::nearest_8_bit;

/// Returns a tile at half its width and height, for the next overview. `columns` and `rows` are the tile's numbers of
/// columns and rows inside the image; the pixels beyond them aren't averaged.
pub(super) fn halved(tile: &[u8], [columns, rows]: [u32; 2], image: &GeoImage) -> Vec<u8> {
    let pixel = image.pixel_bytes();
    let mut half = Vec::with_capacity((columns.div_ceil(2) * rows.div_ceil(2)) as usize * pixel);
    for y in (0..rows).step_by(2) {
        for x in (0..columns).step_by(2) {
            let places = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
            let inside = places.into_iter().filter(|(x, y)| *x < columns && *y < rows);
            let pixels = inside.map(|(x, y)| {
                let at = (y * TILE + x) as usize * pixel;
                &tile[at..at + pixel]
            });
            match image.samples {
                GeoSamples::Rgba8 => mean_color(pixels, &mut half),
                GeoSamples::F32(own) => mean_numbers(pixels, own == 3, &mut half),
            }
        }
    }
    half
}

/// Appends the mean of pixels with RGBA colours, weighted by alpha. A fifth band, if there is one, is averaged
/// likewise. Alpha itself is the plain mean, but at least 1. If all alphas are 0, the appended pixel is zero.
fn mean_color<'a>(pixels: impl Iterator<Item = &'a [u8]>, out: &mut Vec<u8>) {
    let table = linear_of_8_bit();
    let (mut sums, mut marks, mut alpha, mut count, mut bands) = ([0.0_f32; 3], 0.0, 0.0, 0.0, 4);
    for pixel in pixels {
        let own = f32::from(pixel[3]);
        (0..3).for_each(|k| sums[k] += own * table[usize::from(pixel[k])]);
        marks += own * pixel.get(4).map_or(0.0, |mark| f32::from(*mark));
        alpha += own;
        count += 1.0;
        bands = pixel.len();
    }
    if alpha == 0.0 {
        out.extend(std::iter::repeat_n(0, bands));
        return;
    }
    out.extend(sums.map(|sum| nearest_8_bit(sum / alpha)));
    // A pixel that is covered in part must not become empty.
    out.push(((alpha / count + 0.5) as u8).max(1));
    if bands > 4 {
        out.push((marks / alpha + 0.5) as u8);
    }
}

/// Appends the mean of pixels with 32-bit floats, over the pixels that have data. Appends a pixel without data if none
/// has. If `are_normals`, the first three numbers of the mean are normalised.
fn mean_numbers<'a>(pixels: impl Iterator<Item = &'a [u8]>, are_normals: bool, out: &mut Vec<u8>) {
    // The bands are one or more heights, or a normal; a mark may follow.
    let (mut sums, mut count, mut bands) = (Vec::<f64>::new(), 0.0, 0);
    for pixel in pixels {
        let numbers = pixel.as_chunks::<4>().0.iter().map(|bytes| f32::from_be_bytes(*bytes));
        bands = pixel.len() / 4;
        if numbers.clone().next() == Some(GeoSamples::NODATA) {
            continue;
        }
        sums.resize(bands, 0.0);
        sums.iter_mut().zip(numbers).for_each(|(sum, number)| *sum += f64::from(number));
        count += 1.0;
    }
    if count == 0.0 {
        out.extend(GeoSamples::NODATA.to_be_bytes().repeat(bands));
        return;
    }
    sums.iter_mut().for_each(|sum| *sum /= count);
    if are_normals {
        let length = sums[..3].iter().map(|v| v * v).sum::<f64>().sqrt();
        if length > 0.0 {
            sums[..3].iter_mut().for_each(|v| *v /= length);
        }
    }
    out.extend(sums.iter().flat_map(|mean| (*mean as f32).to_be_bytes()));
}
