//! Which squares of a frame hold the background alone: the next image needn't write them again.

use crate::view::Region;
use std::sync::atomic::AtomicBool;

/// Squares of a [`Frame`](crate::Frame)'s planes in which a backend left the background and nothing else. A frame
/// forgets them where anything else may have written its planes.
#[derive(Debug, Default)]
pub struct Background {
    of: Option<Of>,
    /// Row by row.
    squares: Vec<AtomicBool>,
}

/// What squares belong to.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Of {
    color: [f32; 4],
    region: Region,
    side_px: u32,
}

impl Background {
    /// The squares of a view's region, in columns and rows of squares of so many pixels, before a background of this
    /// colour. A square is true if it holds nothing else.
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

    /// Knows nothing from now on.
    pub(crate) fn forget(&mut self) {
        self.of = None;
    }
}

/// A copy knows nothing.
impl Clone for Background {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// Frames are equal if their planes are.
impl PartialEq for Background {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}
