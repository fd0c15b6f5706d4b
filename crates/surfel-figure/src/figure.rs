//! Content of figures, without positions.

use crate::drawing::{Picture, Rgb};
use std::ops::Range;
use std::sync::Arc;

/// A figure: rows of panels, with a title above and keys beside them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figure {
    /// Line of text above the panels.
    pub title: Option<String>,
    /// Lines of text above the columns of panels; empty for none.
    pub headings: Vec<String>,
    /// Rows of panels.
    pub rows: Vec<Row>,
    /// Colour bars and legends, in a column to the right of the panels.
    pub keys: Vec<Key>,
    /// Sizes and colours.
    pub style: Style,
}

/// A row of panels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Text to the left of the row, and of the rows without a label that follow it.
    pub label: Option<String>,
    /// Panels from left to right; `None` leaves a place empty.
    pub panels: Vec<Option<Panel>>,
}

impl From<Vec<Option<Panel>>> for Row {
    fn from(panels: Vec<Option<Panel>>) -> Self {
        Self { label: None, panels }
    }
}

/// An image with a caption and marks.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The image; `None` leaves the panel's area empty, to find out the layout before the image exists.
    pub picture: Option<Arc<Picture>>,
    /// Line of text below the image.
    pub caption: Option<String>,
    /// Marks over the image.
    pub marks: Vec<Mark>,
}

impl Panel {
    /// Creates a panel of an image.
    pub fn new(picture: Picture) -> Self {
        Self { size: picture.size, picture: Some(Arc::new(picture)), caption: None, marks: Vec::new() }
    }

    /// Creates a panel of this size without an image.
    pub fn empty(size: [u32; 2]) -> Self {
        Self { size, picture: None, caption: None, marks: Vec::new() }
    }

    /// Sets the caption.
    #[must_use]
    pub fn with_caption(self, caption: &str) -> Self {
        Self { caption: Some(caption.to_owned()), ..self }
    }

    /// Adds a mark.
    #[must_use]
    pub fn with_mark(mut self, mark: Mark) -> Self {
        self.marks.push(mark);
        self
    }
}

/// A mark over an image. Places and lengths are in pixels of the image, with y down.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// A scale bar in the lower left corner, or in the lower right if only that corner's content has one colour.
    Scale {
        /// Length of the bar.
        length: f64,
        /// Text above the bar, such as "2 m".
        label: String,
    },
    /// Directions of the world's axes, in the lower right corner.
    Axes([Axis; 3]),
    /// An arrow in the upper right corner.
    North {
        /// Direction of north in the image.
        direction: [f64; 2],
    },
    /// A point with a text beside it.
    Label {
        /// Place of the point.
        at: [f64; 2],
        /// The text.
        text: String,
    },
    /// A thin polyline, such as the edges of a camera's frustum.
    Line {
        /// Corners.
        points: Vec<[f64; 2]>,
        /// Colour.
        color: Rgb,
    },
}

/// An axis of the world, seen by a camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Axis {
    /// Name, such as "x".
    pub name: String,
    /// Components of the unit vector to the right, down and away from the viewer.
    pub direction: [f64; 3],
    /// Colour.
    pub color: Rgb,
}

/// A colour bar or a legend.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    /// Text above the colours; empty for none.
    pub title: String,
    /// Colours and their meaning.
    pub content: KeyContent,
    /// Rows of panels that the key stands beside; all rows if the range is empty.
    pub rows: Range<usize>,
}

/// Content of a key.
#[derive(Clone, Debug, PartialEq)]
pub enum KeyContent {
    /// A colour bar.
    Bar {
        /// Colours from the least value to the largest.
        colors: Vec<Rgb>,
        /// Values at the ends.
        range: [f64; 2],
        /// True if larger values occur, which have the last colour. The bar ends in an arrow.
        is_exceeded: bool,
    },
    /// A coloured square and a text for each category.
    Legend(Vec<(String, Rgb)>),
}

impl Key {
    /// Creates a colour bar from its title, its colours from the least value to the largest, and the values at its
    /// ends.
    pub fn bar(title: &str, colors: Vec<Rgb>, range: [f64; 2]) -> Self {
        Self { title: title.to_owned(), content: KeyContent::Bar { colors, range, is_exceeded: false }, rows: 0..0 }
    }

    /// Ends a colour bar in an arrow if values are larger than its end. Legends don't change.
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

    /// Sets the rows of panels that the key stands beside.
    #[must_use]
    pub fn beside(self, rows: Range<usize>) -> Self {
        Self { rows, ..self }
    }
}

/// Sizes and colours of a figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Style {
    /// Height of an em of the text in pixels; more than 0. All other lengths follow from it.
    pub font: f64,
    /// sRGB levels and alpha of the background.
    pub background: [u8; 4],
    /// Width of the figure in pixels, if it is fixed; a wider figure isn't cut.
    pub width: Option<u32>,
}

impl Style {
    /// Creates a style with a white background and text of this height in pixels.
    pub fn new(font: f64) -> Self {
        Self { font, background: [255; 4], width: None }
    }

    /// Returns the colour of text and lines: black on light backgrounds and on transparent ones, white on dark ones.
    pub fn ink(&self) -> Rgb {
        if self.is_dark() { [255; 3] } else { [20, 20, 20] }
    }

    /// Returns the colour of borders around text and lines that lie over images.
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
