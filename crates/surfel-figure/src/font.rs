//! Font of figures: widths and outlines of text.

use std::sync::LazyLock;
use ttf_parser::{Face, GlyphId, OutlineBuilder};

/// Content of the TrueType font file with which all text is measured and drawn.
pub const FILE: &[u8] = include_bytes!("../fonts/Inter-Regular-subset.ttf");
/// CSS list of font families for SVG files. The first family is embedded in the file.
pub const FAMILY: &str = "Inter, Helvetica, Arial, sans-serif";
/// Height of capital letters above the baseline, in ems.
pub const CAP_HEIGHT: f64 = 0.727;
/// Largest height of letters above the baseline, in ems.
pub const ASCENT: f64 = 0.97;
/// Largest depth of letters below the baseline, in ems, as a positive number.
pub const DESCENT: f64 = 0.25;

static FACE: LazyLock<Option<Face<'static>>> = LazyLock::new(|| Face::parse(FILE, 0).ok());

pub(crate) fn face() -> Option<&'static Face<'static>> {
    FACE.as_ref()
}

/// Returns the number of font units in an em.
pub(crate) fn units_per_em() -> f64 {
    face().map_or(1.0, |face| f64::from(face.units_per_em()))
}

/// Returns the identifier of a character's glyph; glyph 0, an empty box, if the font lacks the character.
pub(crate) fn glyph(c: char) -> GlyphId {
    face().and_then(|face| face.glyph_index(c)).unwrap_or(GlyphId(0))
}

/// Returns the advance width of a glyph, in ems.
pub(crate) fn advance(glyph: GlyphId) -> f64 {
    let units = face().and_then(|face| face.glyph_hor_advance(glyph)).unwrap_or(0);
    f64::from(units) / units_per_em()
}

/// Returns the width of a line of text, in ems.
pub fn width(text: &str) -> f64 {
    text.chars().map(|c| advance(glyph(c))).sum()
}

/// Returns the characters of a text that the font has no glyph for, each once.
pub fn missing(text: &str) -> Vec<char> {
    let mut missing: Vec<char> = text.chars().filter(|c| glyph(*c).0 == 0).collect();
    missing.sort_unstable();
    missing.dedup();
    missing
}

/// Segment of a glyph's outline, in ems, with y down and the baseline at 0.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Segment {
    Line([f64; 2], [f64; 2]),
    Curve([f64; 2], [f64; 2], [f64; 2]),
}

#[derive(Default)]
struct Outline {
    segments: Vec<Segment>,
    offset: f64,
    scale: f64,
    start: [f64; 2],
    at: [f64; 2],
}

impl Outline {
    fn point(&self, x: f32, y: f32) -> [f64; 2] {
        [self.offset + f64::from(x) * self.scale, -f64::from(y) * self.scale]
    }
}

impl OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        self.start = self.point(x, y);
        self.at = self.start;
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let to = self.point(x, y);
        self.segments.push(Segment::Line(self.at, to));
        self.at = to;
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let (middle, to) = (self.point(x1, y1), self.point(x, y));
        self.segments.push(Segment::Curve(self.at, middle, to));
        self.at = to;
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        // TrueType fonts have no cubic curves.
        self.line_to(x1, y1);
        self.line_to(x2, y2);
        self.line_to(x, y);
    }

    fn close(&mut self) {
        self.segments.push(Segment::Line(self.at, self.start));
        self.at = self.start;
    }
}

/// Returns the outlines of a line of text in ems; its baseline starts at (0, 0).
pub(crate) fn outlines(text: &str) -> Vec<Segment> {
    let mut outline = Outline { scale: 1.0 / units_per_em(), ..Outline::default() };
    for c in text.chars() {
        let glyph = glyph(c);
        face().and_then(|face| face.outline_glyph(glyph, &mut outline));
        outline.offset += advance(glyph);
    }
    outline.segments
}

/// Cuts a text that is wider than `most` ems to this width, and ends it with an ellipsis.
pub(crate) fn shortened(text: &str, most: f64) -> String {
    if width(text) <= most {
        return text.to_owned();
    }
    let mut short: String = text.to_owned();
    while !short.is_empty() && width(&short) + advance(glyph('…')) > most {
        short.pop();
    }
    format!("{}…", short.trim_end())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_what_figures_need() {
        let text = "AZaz09 äöüßéñçø ΑΩαω µ°²³±×÷−–—…“”‘’≤≥≈≠√∞ ⁰¹²³⁴⁵⁶⁷⁸⁹⁻ ₀₁ →";
        assert_eq!(missing(text), Vec::<char>::new());
        assert_eq!(missing("a漢字漢"), ['字', '漢']);
        assert!(FILE.len() <= 150_000, "{}", FILE.len());
    }

    #[test]
    fn shortened_texts_fit() {
        for most in [2.0, 3.5, 9.0, 40.0] {
            let short = shortened("a rather long caption of a panel", most);
            assert!(width(&short) <= most, "{short}");
        }
        assert_eq!(shortened("short", 9.0), "short");
    }
}
