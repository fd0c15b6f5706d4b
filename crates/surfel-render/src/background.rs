//! Record of the squares of a frame that contain only background, which the next image needn't write again.

use crate::view::Region;
use std::sync::atomic::AtomicBool;

/// Squares of a [`Frame`](crate::Frame)'s planes in which a backend wrote only the background. A frame clears the
/// record if anything else may have written its planes.
#[derive(Debug, Default)]
pub struct Background {
    of: Option<Of>,
    /// Flags of the squares, row by row.
    squares: Vec<AtomicBool>,
}

/// Parameters for which the squares are valid.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Of {
    color: [f32; 4],
    region: Region,
    side_px: u32,
}

impl Background {
    /// Returns one flag per square of a view's region, true if the square contains only the background of this colour
    /// (linear premultiplied RGBA).
    /// `columns` and `rows` are the numbers of squares, and `side_px` is their side. All flags are false if a parameter
    /// changed.
    pub fn squares(
        &mut self,
        color: [f32; 4],
        region: Region,
        side_px: u32,
        [columns, rows]: [u32; 2],
    ) -> &[AtomicBool] {
        let of = Some(Of { color, region, side_px });
        if self.of != of {
            let none = || AtomicBool::new(false);
            let count = columns as usize * rows as usize;
            *self = Self { of, squares: std::iter::repeat_with(none).take(count).collect() };
        }
        &self.squares
    }

    /// Clears the record, so that no square counts as containing only background.
    pub(crate) fn forget(&mut self) {
        self.of = None;
    }
}

/// A copy has an empty record.
impl Clone for Background {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// Frames are equal if their planes are, so records are ignored.
impl PartialEq for Background {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}
