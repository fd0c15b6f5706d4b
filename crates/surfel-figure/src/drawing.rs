//! Drawings: lists of images, polygons, lines and texts at fixed positions.

use crate::font;
use std::sync::Arc;

/// Opaque colour as sRGB levels of red, green and blue.
pub type Rgb = [u8; 3];

/// Image as 8-bit sRGB levels with straight alpha, in rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width and height of the image in pixels.
    pub size: [u32; 2],
    /// Red, green, blue and alpha levels of each pixel.
    pub rgba: Vec<[u8; 4]>,
}

impl Picture {
    /// Creates an image of one colour.
    pub fn filled(size: [u32; 2], color: [u8; 4]) -> Self {
        Self { size, rgba: vec![color; size[0] as usize * size[1] as usize] }
    }

    /// True if every pixel is opaque.
    pub fn is_opaque(&self) -> bool {
        self.rgba.iter().all(|pixel| pixel[3] == 255)
    }
}

/// Rectangle in pixels of a drawing, with y down.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rect {
    /// Position of the top left corner.
    pub at: [f64; 2],
    /// Width and height of the rectangle.
    pub size: [f64; 2],
}

impl Rect {
    /// Creates a rectangle from its top left corner and its size.
    pub const fn new(at: [f64; 2], size: [f64; 2]) -> Self {
        Self { at, size }
    }

    /// Returns the bottom right corner.
    pub fn end(&self) -> [f64; 2] {
        [self.at[0] + self.size[0], self.at[1] + self.size[1]]
    }

    /// Returns the centre.
    pub fn center(&self) -> [f64; 2] {
        [self.at[0] + 0.5 * self.size[0], self.at[1] + 0.5 * self.size[1]]
    }

    /// True if both rectangles share an area.
    pub fn overlaps(&self, other: &Self) -> bool {
        (0..2).all(|k| self.at[k] < other.end()[k] && other.at[k] < self.end()[k])
    }

    /// True if `other` is inside this rectangle, up to rounding.
    pub fn contains(&self, other: &Self) -> bool {
        const SLACK: f64 = 1e-6;
        (0..2).all(|k| other.at[k] >= self.at[k] - SLACK && other.end()[k] <= self.end()[k] + SLACK)
    }

    pub(crate) fn corners(&self) -> Vec<[f64; 2]> {
        let ([x, y], [right, bottom]) = (self.at, self.end());
        vec![[x, y], [right, y], [right, bottom], [x, bottom]]
    }
}

/// Point on the baseline of a [`Text`] that is placed at [`Text::at`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Start of the baseline: the text extends from the position in reading direction.
    Start,
    /// Middle of the baseline: the text is centred on the position.
    Middle,
    /// End of the baseline: the text ends at the position.
    End,
}

/// Single line of text with its position and style.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// Content of the text.
    pub text: String,
    /// Position, in pixels, of the baseline point that `anchor` selects.
    pub at: [f64; 2],
    /// Font size in pixels (height of an em).
    pub size: f64,
    /// Point of the baseline that is placed at `at`: its start, middle or end.
    pub anchor: Anchor,
    /// True if the text is turned by 90°, so that it runs upward.
    pub is_turned: bool,
    /// Colour of the letters.
    pub color: Rgb,
    /// Colour of the halo, a thin border that separates the letters from an image; `None` for no halo.
    pub halo: Option<Rgb>,
}

impl Text {
    /// Returns the distance along the baseline, in pixels, from the start of the text to its anchor point.
    pub(crate) fn lead(&self) -> f64 {
        let share = match self.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5,
            Anchor::End => 1.0,
        };
        share * font::width(&self.text) * self.size
    }

    /// Returns the bounding rectangle of the text.
    pub fn bounds(&self) -> Rect {
        let (lead, width) = (self.lead(), font::width(&self.text) * self.size);
        let (ascent, descent) = (font::ASCENT * self.size, font::DESCENT * self.size);
        let [x, y] = self.at;
        if self.is_turned {
            Rect::new([x - ascent, y + lead - width], [ascent + descent, width])
        } else {
            Rect::new([x - lead, y - ascent], [width, ascent + descent])
        }
    }
}

/// Item of a drawing at a fixed position; later items cover earlier ones.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// Image, scaled to a rectangle of the drawing.
    Picture(Rect, Arc<Picture>),
    /// Filled polygon without holes, given by its corners and colour.
    Polygon(Vec<[f64; 2]>, Rgb),
    /// Polyline of constant width.
    Line {
        /// Vertices of the polyline.
        points: Vec<[f64; 2]>,
        /// Width of the polyline in pixels.
        width: f64,
        /// Colour of the polyline.
        color: Rgb,
    },
    /// Text, including its position and style.
    Text(Text),
}

/// Items at fixed positions, and the named areas that they occupy.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    /// Width and height of the drawing in pixels.
    pub size: [u32; 2],
    /// Background colour: sRGB levels and alpha.
    pub background: [u8; 4],
    /// Items from back to front.
    pub items: Vec<Item>,
    /// Rectangles that the layout assigned, each with the kind of its content: title, heading, panel, caption, row
    /// label, key or mark. Areas don't overlap, except for marks, which are inside their panels unless these are too
    /// small for them.
    pub areas: Vec<(&'static str, Rect)>,
}

impl Drawing {
    /// Returns all texts.
    pub fn texts(&self) -> impl Iterator<Item = &Text> {
        self.items.iter().filter_map(|item| if let Item::Text(text) = item { Some(text) } else { None })
    }

    /// Returns all images, from back to front.
    pub fn pictures(&self) -> impl Iterator<Item = &Picture> {
        self.items.iter().filter_map(|item| if let Item::Picture(_, picture) = item { Some(&**picture) } else { None })
    }

    /// Returns the characters that occur in texts of the drawing but are missing from the font, each once.
    pub fn missing(&self) -> Vec<char> {
        font::missing(&self.texts().map(|text| text.text.as_str()).collect::<String>())
    }
}
