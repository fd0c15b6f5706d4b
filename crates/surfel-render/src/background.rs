//! Record of the squares of a frame that contain only background, so that backends needn't write these squares again in
//! the next image.

use crate::view::Region;
use std::sync::atomic::AtomicBool;

/// Record of the squares of a [`Frame`](crate::Frame)'s planes in which a backend wrote only the background. The frame
/// clears the record whenever its planes may have been written otherwise.
#[derive(Debug, Default)]
pub struct Background {
    /// Parameters of the recorded squares; `None` if nothing is recorded.
    key: Option<RecordKey>,
    /// One flag per square, row by row: true if the square contains only the background.
    squares: Vec<AtomicBool>,
}

/// Parameters of a [`Background`] record. The record is valid only for an image with the same parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RecordKey {
    /// Background colour, linear premultiplied RGBA.
    color: [f32; 4],
    /// Region of the view that is divided into squares.
    region: Region,
    /// Side of a square, in pixels.
    side_px: u32,
}

impl Background {
    /// Returns one flag per square of a view's region, row by row: true if the square contains only the background
    /// `color` (linear premultiplied RGBA). `columns` and `rows` are the numbers of squares, and `side_px` is a
    /// square's side in pixels. All flags are false if a parameter differs from the last call's, or if the record was
    /// cleared since.
    pub fn squares(
        &mut self,
        color: [f32; 4],
        region: Region,
        side_px: u32,
        [columns, rows]: [u32; 2],
    ) -> &[AtomicBool] {
        let key = Some(RecordKey { color, region, side_px });
        if self.key != key {
            let none = || AtomicBool::new(false);
            let count = columns as usize * rows as usize;
            *self = Self { key, squares: std::iter::repeat_with(none).take(count).collect() };
        }
        &self.squares
    }

    /// Clears the record, so that no square counts as containing only background.
    pub(crate) fn forget(&mut self) {
        self.key = None;
    }
}

/// A copy has an empty record, so that backends write all squares of a copied frame.
impl Clone for Background {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// All records are equal, because frames are compared by their planes alone.
impl PartialEq for Background {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}
