//! Drawings: lists of pictures, polygons, lines and texts at fixed places.

use crate::font;
use std::sync::Arc;

/// sRGB levels of an opaque colour.
pub type Rgb = [u8; 3];

/// An image of sRGB levels with straight alpha, in rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Levels of red, green, blue and alpha of each pixel.
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

/// A rectangle in pixels, with y down.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rect {
    /// Left top corner.
    pub at: [f64; 2],
    /// Width and height.
    pub size: [f64; 2],
}

impl Rect {
    /// Creates a rectangle from its corner and its size.
    pub const fn new(at: [f64; 2], size: [f64; 2]) -> Self {
        Self { at, size }
    }

    /// Returns the right bottom corner.
    pub fn end(&self) -> [f64; 2] {
        [self.at[0] + self.size[0], self.at[1] + self.size[1]]
    }

    /// Returns the centre.
    pub fn center(&self) -> [f64; 2] {
        [self.at[0] + 0.5 * self.size[0], self.at[1] + 0.5 * self.size[1]]
    }

    /// True if both rectangles have an area in common.
    pub fn overlaps(&self, other: &Self) -> bool {
        (0..2).all(|k| self.at[k] < other.end()[k] && other.at[k] < self.end()[k])
    }

    /// True if `other` lies within this rectangle.
    pub fn contains(&self, other: &Self) -> bool {
        const SLACK: f64 = 1e-6;
        (0..2).all(|k| other.at[k] >= self.at[k] - SLACK && other.end()[k] <= self.end()[k] + SLACK)
    }

    pub(crate) fn corners(&self) -> Vec<[f64; 2]> {
        let ([x, y], [right, bottom]) = (self.at, self.end());
        vec![[x, y], [right, y], [right, bottom], [x, bottom]]
    }
}

/// The point of a line of text that lies at a given place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Begin of the baseline.
    Start,
    /// Middle of the baseline.
    Middle,
    /// End of the baseline.
    End,
}

/// A line of text.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// The words.
    pub text: String,
    /// Place of the anchor, on the baseline.
    pub at: [f64; 2],
    /// Height of an em in pixels.
    pub size: f64,
    /// Point of the text that lies at `at`.
    pub anchor: Anchor,
    /// True if the text runs upwards.
    pub is_turned: bool,
    /// Colour.
    pub color: Rgb,
    /// Colour of a thin border around the letters.
    pub halo: Option<Rgb>,
}

impl Text {
    /// Returns the distance from the anchor back to the begin of the text.
    pub(crate) fn lead(&self) -> f64 {
        let share = match self.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5,
            Anchor::End => 1.0,
        };
        share * font::width(&self.text) * self.size
    }

    /// Returns the rectangle around the text.
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

/// Part of a drawing; later parts cover earlier ones.
#[derive(Clone, Debug, PartialEq)]
pub enum Item {
    /// An image, scaled to a rectangle.
    Picture(Rect, Arc<Picture>),
    /// A filled polygon without holes.
    Polygon(Vec<[f64; 2]>, Rgb),
    /// A polyline of this width.
    Line {
        /// Corners.
        points: Vec<[f64; 2]>,
        /// Width in pixels.
        width: f64,
        /// Colour.
        color: Rgb,
    },
    /// A line of text.
    Text(Text),
}

/// Items at fixed places, and the names of the areas that they fill.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// sRGB levels and alpha of the background.
    pub background: [u8; 4],
    /// The parts, from back to front.
    pub items: Vec<Item>,
    /// Areas of the layout, with their names: title, panel, caption, row label, key, mark. Areas of different names
    /// don't overlap, except for marks, which lie in their panels.
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

    /// Returns the characters that the font lacks, each once.
    pub fn missing(&self) -> Vec<char> {
        font::missing(&self.texts().map(|text| text.text.as_str()).collect::<String>())
    }
}
