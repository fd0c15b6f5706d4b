//! Content of figures: panels, keys and marks without positions.

use crate::drawing::{Picture, Rgb};
use std::ops::Range;
use std::sync::Arc;

/// Content of a figure: rows of panels, with a title above and keys to the right.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figure {
    /// Line of text above the panels.
    pub title: Option<String>,
    /// Texts above the columns of panels; empty for none.
    pub headings: Vec<String>,
    /// Rows of panels, from top to bottom.
    pub rows: Vec<Row>,
    /// Colour bars and legends, in a column to the right of the panels.
    pub keys: Vec<Key>,
    /// Sizes and colours of text and lines.
    pub style: Style,
}

/// Row of panels in a [`Figure`], with an optional label on the left.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Text to the left of the row, turned by 90°. It also labels the rows below, up to the next row with a label.
    pub label: Option<String>,
    /// Panels from left to right; `None` leaves a gap in the grid.
    pub panels: Vec<Option<Panel>>,
}

impl From<Vec<Option<Panel>>> for Row {
    fn from(panels: Vec<Option<Panel>>) -> Self {
        Self { label: None, panels }
    }
}

/// Image in a figure, with a caption below and marks over it.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Width and height of the image in pixels.
    pub size: [u32; 2],
    /// Image that the panel shows. `None` leaves the panel's area empty, so that a layout can be computed before the
    /// image exists.
    pub picture: Option<Arc<Picture>>,
    /// Line of text below the image.
    pub caption: Option<String>,
    /// Marks drawn over the image, such as a scale bar.
    pub marks: Vec<Mark>,
}

impl Panel {
    /// Creates a panel with an image, without a caption or marks.
    pub fn new(picture: Picture) -> Self {
        Self { size: picture.size, picture: Some(Arc::new(picture)), caption: None, marks: Vec::new() }
    }

    /// Creates a panel of the given size in pixels, without an image, to compute a layout.
    pub fn empty(size: [u32; 2]) -> Self {
        Self { size, picture: None, caption: None, marks: Vec::new() }
    }

    /// Sets the caption.
    #[must_use]
    pub fn with_caption(self, caption: &str) -> Self {
        Self { caption: Some(caption.to_owned()), ..self }
    }

    /// Returns the range from the first to the last row of the image that has a pixel of another colour than `color`.
    /// Returns `None` if the panel has no image, or the whole image has this colour.
    pub fn rows_unlike(&self, color: [u8; 4]) -> Option<Range<u32>> {
        let picture = self.picture.as_ref()?;
        let width = picture.size[0].max(1) as usize;
        let mut differing =
            picture.rgba.chunks(width).enumerate().filter(|(_, row)| row.iter().any(|pixel| *pixel != color));
        let first = differing.next()?.0 as u32;
        Some(first..differing.next_back().map_or(first, |(row, _)| row as u32) + 1)
    }

    /// Reduces the panel to these rows of its image. Labels and lines move with the image.
    pub fn crop_rows(&mut self, rows: Range<u32>) {
        let Range { start, end } = rows.start.min(self.size[1])..rows.end.min(self.size[1]);
        if let Some(picture) = &self.picture {
            let width = picture.size[0] as usize;
            let rgba = picture.rgba[start as usize * width..end as usize * width].to_vec();
            self.picture = Some(Arc::new(Picture { size: [picture.size[0], end - start], rgba }));
        }
        self.size[1] = end - start;
        for mark in &mut self.marks {
            match mark {
                Mark::Label { at, .. } => at[1] -= f64::from(start),
                Mark::Line { points, .. } => points.iter_mut().for_each(|point| point[1] -= f64::from(start)),
                Mark::Scale { .. } | Mark::Axes(_) | Mark::North { .. } => {}
            }
        }
    }

    /// Adds a mark.
    #[must_use]
    pub fn with_mark(mut self, mark: Mark) -> Self {
        self.marks.push(mark);
        self
    }
}

/// Mark over an image. Positions and lengths are in pixels of the image, with y down.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// Scale bar near the lower left corner. It is near the lower right corner if only there the image behind the bar
    /// has one colour.
    Scale {
        /// Length of the bar, in pixels of the image.
        length: f64,
        /// Text above the bar, such as "2 m".
        label: String,
    },
    /// Directions of the world's axes, drawn in the lower right corner.
    Axes([Axis; 3]),
    /// North arrow near the upper right corner.
    North {
        /// Direction of north as a vector in the image (x right, y down), of any length but 0.
        direction: [f64; 2],
    },
    /// Point of interest in the image, drawn as a dot with a text next to it.
    Label {
        /// Position of the point in the image.
        at: [f64; 2],
        /// Text of the label.
        text: String,
    },
    /// Thin polyline, such as the edges of a camera's frustum.
    Line {
        /// Vertices of the polyline.
        points: Vec<[f64; 2]>,
        /// Colour of the polyline.
        color: Rgb,
    },
}

/// Axis of the world, as a camera shows it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Axis {
    /// Name of the axis that is drawn at its tip, such as "x".
    pub name: String,
    /// Unit vector along the axis, as its components to the right, down and away from the viewer.
    pub direction: [f64; 3],
    /// Colour of the axis and its name.
    pub color: Rgb,
}

/// Explanation of the colours of panels: a colour bar or a legend.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    /// Text above the colour bar or legend; empty for none.
    pub title: String,
    /// Colours that the key explains: a colour bar or legend entries.
    pub content: KeyContent,
    /// Range of indices of panel rows next to which the key is placed; an empty range stands for all rows.
    pub rows: Range<usize>,
}

/// Kind of a [`Key`], with its colours and values.
#[derive(Clone, Debug, PartialEq)]
pub enum KeyContent {
    /// Colour bar for a range of values, with tick labels.
    Bar {
        /// Colours from the smallest value to the largest.
        colors: Vec<Rgb>,
        /// Values at the lower and the upper end of the bar.
        range: [f64; 2],
        /// True if values above the bar's range occur in the panels. They are drawn in the last colour, and the bar
        /// ends in an arrow.
        is_exceeded: bool,
    },
    /// Legend: one entry per colour, with the text and the colour of a square.
    Legend(Vec<(String, Rgb)>),
}

impl Key {
    /// Creates a colour bar from its title, its colours from the smallest value to the largest, and the values at its
    /// ends.
    pub fn bar(title: &str, colors: Vec<Rgb>, range: [f64; 2]) -> Self {
        Self { title: title.to_owned(), content: KeyContent::Bar { colors, range, is_exceeded: false }, rows: 0..0 }
    }

    /// Sets whether a colour bar ends in an arrow, because larger values occur. Legends don't change.
    #[must_use]
    pub fn exceeded(mut self, exceeded: bool) -> Self {
        if let KeyContent::Bar { is_exceeded, .. } = &mut self.content {
            *is_exceeded = exceeded;
        }
        self
    }

    /// Creates a legend from its title, and the texts and colours of its entries.
    pub fn legend(title: &str, entries: Vec<(String, Rgb)>) -> Self {
        Self { title: title.to_owned(), content: KeyContent::Legend(entries), rows: 0..0 }
    }

    /// Sets the rows of panels next to which the key is placed.
    #[must_use]
    pub fn beside(self, rows: Range<usize>) -> Self {
        Self { rows, ..self }
    }
}

/// Sizes and colours of a figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Style {
    /// Font size in pixels (height of an em), more than 0. All other lengths of the layout are proportional to it.
    pub font: f64,
    /// Background colour: sRGB levels and alpha.
    pub background: [u8; 4],
    /// Smallest width of the figure in pixels; narrower content leaves empty space on the right. `None` for no minimum.
    /// A wider figure isn't cut.
    pub width: Option<u32>,
}

impl Style {
    /// Creates a style with a white background and a font size in pixels.
    pub fn new(font: f64) -> Self {
        Self { font, background: [255; 4], width: None }
    }

    /// Returns the colour of text and lines: white on dark backgrounds, nearly black on light and on transparent ones.
    pub fn ink(&self) -> Rgb {
        if self.is_dark() { [255; 3] } else { [20, 20, 20] }
    }

    /// Returns the colour of the halo around text and lines over images.
    pub(crate) fn halo(&self) -> Rgb {
        if self.is_dark() { [20, 20, 20] } else { [255; 3] }
    }

    fn is_dark(&self) -> bool {
        let [r, g, b, a] = self.background.map(f64::from);
        a > 127.0 && 0.299 * r + 0.587 * g + 0.114 * b < 110.0
    }
}

impl Default for Style {
    fn default() -> Self {
        Self::new(12.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_are_cropped_with_their_marks() {
        let mut picture = Picture::filled([3, 10], [255; 4]);
        picture.rgba[3 * 4 + 1] = [0; 4];
        picture.rgba[3 * 6] = [0; 4];
        let label = Mark::Label { at: [1.0, 4.5], text: "a".into() };
        let line = Mark::Line { points: vec![[0.0, 3.0], [1.0, 6.0]], color: [0; 3] };
        let mut panel = Panel::new(picture).with_mark(label).with_mark(line);
        assert_eq!((panel.rows_unlike([255; 4]), Panel::empty([3, 3]).rows_unlike([255; 4])), (Some(4..7), None));
        panel.crop_rows(3..8);
        let cropped = panel.picture.as_ref().unwrap();
        assert_eq!((panel.size, cropped.size, cropped.rgba.len()), ([3, 5], [3, 5], 15));
        assert_eq!(cropped.rgba[4], [0; 4]);
        let [Mark::Label { at, .. }, Mark::Line { points, .. }] = &panel.marks[..] else { panic!() };
        assert_eq!((at, &points[..]), (&[1.0, 1.5], &[[0.0, 0.0], [1.0, 3.0]][..]));
    }
}
