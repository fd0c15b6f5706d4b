//! Row numbers of points in their file, for readers that drop some points.

#![cfg_attr(not(all(feature = "las", feature = "e57", feature = "points")), allow(dead_code))]

use crate::content::Content;

/// Recorder of the row numbers of points while rows are read and some are dropped.
#[derive(Default)]
pub(crate) struct RowNumbers {
    read: u32,
    /// Row number in the file of each point; `None` as long as no row was dropped.
    rows: Option<Vec<u32>>,
}

impl RowNumbers {
    /// Records that the next row becomes a point.
    #[inline]
    pub(crate) fn keep(&mut self) {
        if let Some(rows) = &mut self.rows {
            rows.push(self.read);
        }
        self.read = self.read.saturating_add(1);
    }

    /// Records that the next row is dropped.
    pub(crate) fn skip(&mut self) {
        self.rows.get_or_insert_with(|| (0..self.read).collect());
        self.read = self.read.saturating_add(1);
    }

    /// Returns the row numbers in the file of the kept points; `None` if no row was dropped.
    pub(crate) fn finish(self) -> Option<Vec<u32>> {
        self.rows
    }

    /// Sets the row numbers of points that were made from the recorded rows. Does nothing for other content, or if no
    /// row was dropped.
    pub(crate) fn give(self, content: &mut Content) {
        let own = match content {
            Content::Points(points) => &mut points.rows,
            _ => return,
        };
        let Some(rows) = self.rows else { return };
        // Some points may have been dropped since.
        *own = Some(match own.take() {
            Some(kept) => kept.iter().map(|&i| rows.get(i as usize).copied().unwrap_or(u32::MAX)).collect(),
            None => rows,
        });
    }
}
