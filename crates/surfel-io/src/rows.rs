//! Which rows of a file its points are, where a reader leaves some out.

#![cfg_attr(not(all(feature = "las", feature = "e57", feature = "points")), allow(dead_code))]

use crate::content::Content;

/// Rows of the points that are kept, in their order.
#[derive(Default)]
pub(crate) struct KeptRows {
    read: u32,
    /// `None` as long as none is left out.
    rows: Option<Vec<u32>>,
}

impl KeptRows {
    /// The next row becomes a point.
    #[inline]
    pub(crate) fn keep(&mut self) {
        if let Some(rows) = &mut self.rows {
            rows.push(self.read);
        }
        self.read = self.read.saturating_add(1);
    }

    /// The next row is left out.
    pub(crate) fn skip(&mut self) {
        self.rows.get_or_insert_with(|| (0..self.read).collect());
        self.read = self.read.saturating_add(1);
    }

    /// The rows, if some were left out.
    pub(crate) fn finish(self) -> Option<Vec<u32>> {
        self.rows
    }

    /// Gives points that were made of those kept the rows of the file.
    pub(crate) fn give(self, content: &mut Content) {
        let own = match content {
            Content::Points(points) => &mut points.rows,
            _ => return,
        };
        let Some(rows) = self.rows else { return };
        // Some may have been dropped since.
        *own = Some(match own.take() {
            Some(kept) => kept.iter().map(|&i| rows.get(i as usize).copied().unwrap_or(u32::MAX)).collect(),
            None => rows,
        });
    }
}
