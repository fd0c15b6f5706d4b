//! Colour bar images with labelled values.

use super::{Category, ColorScale, Coloring, linear, maps, short};
use std::path::Path;
use surfel_io::{IoError, PlanesView, PngOptions};

/// Width and height of the bar in pixels.
const BAR: [usize; 2] = [512, 32];
/// Margin around the bar in pixels.
const MARGIN: usize = 24;
/// Side in image pixels of one dot of a glyph.
const DOT: usize = 2;
/// Number of labelled values below the bar.
const TICKS: usize = 5;
/// Side of a category's square in pixels.
const SQUARE: usize = 24;
/// Largest number of categories: as many as LAS has classes.
const MOST: usize = 256;

/// Returns the glyph of a character: rows from the top, each with five dots, the leftmost in the highest bit.
fn glyph(c: char) -> [u8; 7] {
    match c {
        '0' => [0x0e, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0e],
        '1' => [0x04, 0x0c, 0x04, 0x04, 0x04, 0x04, 0x0e],
        '2' => [0x0e, 0x11, 0x01, 0x02, 0x04, 0x08, 0x1f],
        '3' => [0x1f, 0x02, 0x04, 0x02, 0x01, 0x11, 0x0e],
        '4' => [0x02, 0x06, 0x0a, 0x12, 0x1f, 0x02, 0x02],
        '5' => [0x1f, 0x10, 0x1e, 0x01, 0x01, 0x11, 0x0e],
        '6' => [0x06, 0x08, 0x10, 0x1e, 0x11, 0x11, 0x0e],
        '7' => [0x1f, 0x01, 0x02, 0x04, 0x08, 0x08, 0x08],
        '8' => [0x0e, 0x11, 0x11, 0x0e, 0x11, 0x11, 0x0e],
        '9' => [0x0e, 0x11, 0x11, 0x0f, 0x01, 0x02, 0x0c],
        '-' => [0, 0, 0, 0x1f, 0, 0, 0],
        '.' => [0, 0, 0, 0, 0, 0x0c, 0x0c],
        '+' => [0, 0x04, 0x04, 0x1f, 0x04, 0x04, 0],
        'a' => [0, 0, 0x0e, 0x01, 0x0f, 0x11, 0x0f],
        'b' => [0x10, 0x10, 0x16, 0x19, 0x11, 0x11, 0x1e],
        'c' => [0, 0, 0x0e, 0x10, 0x10, 0x11, 0x0e],
        'd' => [0x01, 0x01, 0x0d, 0x13, 0x11, 0x11, 0x0f],
        'e' => [0, 0, 0x0e, 0x11, 0x1f, 0x10, 0x0e],
        'f' => [0x06, 0x09, 0x08, 0x1c, 0x08, 0x08, 0x08],
        'g' => [0, 0x0d, 0x13, 0x13, 0x0d, 0x01, 0x0e],
        'h' => [0x10, 0x10, 0x16, 0x19, 0x11, 0x11, 0x11],
        'i' => [0x04, 0, 0x0c, 0x04, 0x04, 0x04, 0x0e],
        'j' => [0x02, 0, 0x06, 0x02, 0x02, 0x12, 0x0c],
        'k' => [0x10, 0x10, 0x12, 0x14, 0x18, 0x14, 0x12],
        'l' => [0x0c, 0x04, 0x04, 0x04, 0x04, 0x04, 0x0e],
        'm' => [0, 0, 0x1a, 0x15, 0x15, 0x11, 0x11],
        'n' => [0, 0, 0x16, 0x19, 0x11, 0x11, 0x11],
        'o' => [0, 0, 0x0e, 0x11, 0x11, 0x11, 0x0e],
        'p' => [0, 0, 0x1e, 0x11, 0x1e, 0x10, 0x10],
        'q' => [0, 0, 0x0d, 0x13, 0x0f, 0x01, 0x01],
        'r' => [0, 0, 0x16, 0x19, 0x10, 0x10, 0x10],
        's' => [0, 0, 0x0e, 0x10, 0x0e, 0x01, 0x1e],
        't' => [0x08, 0x08, 0x1c, 0x08, 0x08, 0x09, 0x06],
        'u' => [0, 0, 0x11, 0x11, 0x11, 0x13, 0x0d],
        'v' => [0, 0, 0x11, 0x11, 0x11, 0x0a, 0x04],
        'w' => [0, 0, 0x11, 0x11, 0x15, 0x15, 0x0a],
        'x' => [0, 0, 0x11, 0x0a, 0x04, 0x0a, 0x11],
        'y' => [0, 0, 0x11, 0x11, 0x0f, 0x01, 0x0e],
        'z' => [0, 0, 0x1f, 0x02, 0x04, 0x08, 0x1f],
        _ => [0; 7],
    }
}

/// An opaque image, initially white.
struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 4]>,
}

impl Canvas {
    fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![[1.0; 4]; width * height] }
    }

    fn fill(&mut self, [x, y]: [usize; 2], [width, height]: [usize; 2], color: [u8; 3]) {
        let [r, g, b] = color.map(|c| linear(f64::from(c) / 255.0));
        for row in y..(y + height).min(self.height) {
            for column in x..(x + width).min(self.width) {
                self.pixels[row * self.width + column] = [r, g, b, 1.0];
            }
        }
    }

    fn text(&mut self, [x, y]: [usize; 2], text: &str) {
        for (i, c) in text.chars().enumerate() {
            for (row, bits) in glyph(c).into_iter().enumerate() {
                for column in (0..5).filter(|column| bits >> (4 - column) & 1 == 1) {
                    let at = [x + (6 * i + column) * DOT, y + row * DOT];
                    self.fill(at, [DOT, DOT], [0; 3]);
                }
            }
        }
    }
}

fn width_of(text: &str) -> usize {
    (6 * text.chars().count()).saturating_sub(1) * DOT
}

/// Draws the colour bar of a colouring; `None` if its colours don't represent values.
fn draw(coloring: &Coloring) -> Option<Canvas> {
    match &coloring.scale {
        ColorScale::Direct => None,
        ColorScale::Range { map, range: [lo, hi] } => {
            let label = |k: usize| short(lo + (hi - lo) * k as f64 / (TICKS - 1) as f64);
            let side = (0..TICKS).map(|k| width_of(&label(k))).max().unwrap_or(0) / 2 + MARGIN;
            let mut canvas = Canvas::new(BAR[0] + 2 * side, MARGIN + BAR[1] + 12 + 7 * DOT + MARGIN);
            let levels = maps::levels(*map);
            for x in 0..BAR[0] {
                canvas.fill([side + x, MARGIN], [1, BAR[1]], levels[x * levels.len() / BAR[0]]);
            }
            for k in 0..TICKS {
                let x = side + k * (BAR[0] - 1) / (TICKS - 1);
                canvas.fill([x - 1, MARGIN + BAR[1]], [2, 6], [0; 3]);
                let text = label(k);
                canvas.text([x - width_of(&text) / 2, MARGIN + BAR[1] + 12], &text);
            }
            Some(canvas)
        }
        ColorScale::Categories(categories) => {
            let shown = &categories[..categories.len().min(MOST)];
            let label = |c: &Category| match c.name {
                Some(name) => format!("{} {name}", short(c.value)),
                None => short(c.value),
            };
            let more =
                Some(categories.len() - shown.len()).filter(|more| *more > 0).map(|more| format!("+{more} more"));
            let labels: Vec<String> = shown.iter().map(label).chain(more).collect();
            let text = labels.iter().map(|label| width_of(label)).max().unwrap_or(0);
            let height = 2 * MARGIN + labels.len() * (SQUARE + 8);
            let mut canvas = Canvas::new(2 * MARGIN + SQUARE + 12 + text, height);
            for (k, label) in labels.iter().enumerate() {
                let y = MARGIN + k * (SQUARE + 8);
                if let Some(category) = shown.get(k) {
                    canvas.fill([MARGIN, y], [SQUARE, SQUARE], category.color);
                }
                canvas.text([MARGIN + SQUARE + 12, y + (SQUARE - 7 * DOT) / 2], label);
            }
            Some(canvas)
        }
    }
}

/// Writes a colour bar: a bar with five numbers, or a labelled square for each of up to 256 categories, with the names
/// of classes. Returns false and writes nothing if the colours don't represent values.
///
/// # Errors
/// [`IoError`] if a different file exists and `overwrite` is false, or the file can't be written. An existing identical
/// file is no error, since several shards of a job may write it.
pub fn save_color_bar(path: &Path, overwrite: bool, coloring: &Coloring) -> Result<bool, IoError> {
    let Some(canvas) = draw(coloring) else { return Ok(false) };
    let (width, height) = (canvas.width as u32, canvas.height as u32);
    let planes = PlanesView { width, height, color: Some(&canvas.pixels), ..PlanesView::default() };
    match surfel_io::save_png(path, overwrite, &planes, &PngOptions::default()) {
        Err(IoError::Exists { path }) if !is_same(&path, &planes) => Err(IoError::Exists { path }),
        Err(IoError::Exists { .. }) | Ok(()) => Ok(true),
        Err(other) => Err(other),
    }
}

/// True if the file at `path` is identical to what would be written.
fn is_same(path: &Path, planes: &PlanesView<'_>) -> bool {
    let mut bytes = Vec::new();
    let written = surfel_io::write_png(&mut bytes, planes, &PngOptions::default());
    written.is_ok() && std::fs::read(path).is_ok_and(|known| known == bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Colormap;

    #[test]
    fn bars_hold_their_numbers_and_colours() {
        let of = |scale| draw(&Coloring { attribute: "a".into(), scale });
        // Even the longest numbers fit within the image: its border stays white.
        for range in [[0.0, 1.0], [-1.234_567e-30, 1e300], [-123_456.7, 9_999_999.0]] {
            let canvas = of(ColorScale::Range { map: Colormap::Turbo, range }).unwrap();
            let border = |i: usize| {
                let (x, y) = (i % canvas.width, i / canvas.width);
                x < 4 || y < 4 || x >= canvas.width - 4 || y >= canvas.height - 4
            };
            assert!((0..canvas.pixels.len()).all(|i| !border(i) || canvas.pixels[i] == [1.0; 4]), "{range:?}");
            let black = canvas.pixels.iter().filter(|p| **p == [0.0, 0.0, 0.0, 1.0]).count();
            assert!(black > 300, "{range:?}: {black} black pixels");
        }
        let category = |value, color| Category { value, name: None, color, count: 1 };
        let many = (0..300).map(|i| category(f64::from(i), [255, 0, 0])).collect();
        let canvas = of(ColorScale::Categories(many)).unwrap();
        assert_eq!(canvas.pixels.iter().filter(|p| **p == [1.0, 0.0, 0.0, 1.0]).count(), MOST * SQUARE * SQUARE);
        assert!(of(ColorScale::Categories(vec![])).is_some_and(|canvas| canvas.pixels.iter().all(|p| *p == [1.0; 4])));
        assert!(of(ColorScale::Direct).is_none());
    }

    #[test]
    fn every_class_s_name_has_its_letters() {
        let names: Vec<&str> = (0..=22).filter_map(|class| Some(maps::class(f64::from(class))?.0)).collect();
        let letters: std::collections::BTreeSet<char> = names.join("").chars().filter(|c| *c != ' ').collect();
        for (i, a) in letters.iter().enumerate() {
            assert!(glyph(*a) != [0; 7], "{a}");
            assert!(letters.iter().skip(i + 1).all(|b| glyph(*a) != glyph(*b)), "{a} is like another letter");
        }
        let category = |value: u32| {
            let (name, color) = maps::class(f64::from(value)).unwrap();
            Category { value: f64::from(value), name: Some(name), color, count: 0 }
        };
        let width = |value: u32| {
            let scale = ColorScale::Categories(vec![category(value)]);
            draw(&Coloring { attribute: "a".into(), scale }).unwrap().width
        };
        assert_eq!(width(22) - width(9), "22 temporal exclusion".len() * 12 - "9 water".len() * 12);
    }

    #[test]
    fn bars_that_are_the_same_may_be_written_twice() {
        let path = std::env::temp_dir().join(format!("surfel-bar-{}.png", std::process::id()));
        let bar = |hi: f64| {
            let scale = ColorScale::Range { map: Colormap::Viridis, range: [0.0, hi] };
            save_color_bar(&path, false, &Coloring { attribute: "a".into(), scale })
        };
        let written = [bar(1.0), bar(1.0)].map(Result::ok);
        let refused = bar(2.0);
        std::fs::remove_file(&path).unwrap();
        assert_eq!(written, [Some(true); 2]);
        assert!(matches!(refused, Err(IoError::Exists { .. })));
    }
}
