//! Image borrowed for a comparison.

use crate::error::{MetricsError, check_length, pixel_count};

/// Borrowed RGBA image: linear light, premultiplied alpha, rows from the top, no padding.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    width: u32,
    height: u32,
    rgba: &'a [f32],
}

impl<'a> Image<'a> {
    /// Creates a view of `rgba`, 4 values per pixel, row by row from the top.
    ///
    /// # Errors
    /// [`MetricsError::Length`] if `rgba` doesn't have `width`·`height`·4 values, [`MetricsError::TooLarge`] if this
    /// product overflows a `usize`.
    pub fn new(width: u32, height: u32, rgba: &'a [f32]) -> Result<Self, MetricsError> {
        let pixels = pixel_count(width, height, 4)?;
        check_length("the image", rgba.len(), pixels * 4, "width x height x 4")?;
        Ok(Self { width, height, rgba })
    }

    /// Returns the width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Returns the height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Returns the pixels' values as linear premultiplied RGBA: 4 per pixel, row by row from the top.
    pub fn rgba(&self) -> &'a [f32] {
        self.rgba
    }

    /// Composites every pixel over an opaque linear `background`, and returns the linear RGB.
    pub fn over(&self, background: [f32; 3]) -> Vec<[f32; 3]> {
        let (pixels, _) = self.rgba.as_chunks::<4>();
        pixels
            .iter()
            .map(|&[r, g, b, a]| [(r, 0), (g, 1), (b, 2)].map(|(c, i)| c + (1.0 - a) * background[i]))
            .collect()
    }
}
