//! A colour bar as an image of its own, with numbers.

use super::{ColorScale, Coloring, linear, maps, short};
use std::path::Path;
use surfel_io::{IoError, PlanesView, PngOptions};

/// Size of the bar and of its numbers' pixels, in pixels of the image.
const BAR: [usize; 2] = [512, 32];
const MARGIN: usize = 24;
const DOT: usize = 2;
/// Numbers below the bar.
const TICKS: usize = 5;
/// Side of a category's square, and most of them.
const SQUARE: usize = 24;
const MOST: usize = 64;

/// Rows of five dots, the leftmost the highest bit, from the top.
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
        'e' => [0, 0, 0x0e, 0x11, 0x1f, 0x10, 0x0e],
        _ => [0; 7],
    }
}

/// An opaque white image that is drawn into.
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

/// The colour bar of a coloring; `None` for colours that stand for no value.
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
            let text = shown.iter().map(|c| width_of(&short(c.value))).max().unwrap_or(0);
            let height = 2 * MARGIN + shown.len() * (SQUARE + 8);
            let mut canvas = Canvas::new(2 * MARGIN + SQUARE + 12 + text, height);
            for (k, category) in shown.iter().enumerate() {
                let y = MARGIN + k * (SQUARE + 8);
                canvas.fill([MARGIN, y], [SQUARE, SQUARE], category.color);
                canvas.text([MARGIN + SQUARE + 12, y + (SQUARE - 7 * DOT) / 2], &short(category.value));
            }
            Some(canvas)
        }
    }
}

/// Writes the colours of a coloring with their values: a bar with five numbers, or a square for each of up to 64
/// categories. False where colours stand for no value, and nothing is written.
///
/// # Errors
/// [`IoError`] if the file exists and `overwrite` is false, or can't be written.
pub fn save_color_bar(path: &Path, overwrite: bool, coloring: &Coloring) -> Result<bool, IoError> {
    let Some(canvas) = draw(coloring) else { return Ok(false) };
    let (width, height) = (canvas.width as u32, canvas.height as u32);
    let planes = PlanesView { width, height, color: Some(&canvas.pixels), ..PlanesView::default() };
    surfel_io::save_png(path, overwrite, &planes, &PngOptions::default())?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coloring::Category;
    use surfel_model::Colormap;

    #[test]
    fn bars_hold_their_numbers_and_colours() {
        let of = |scale| draw(&Coloring { attribute: "a".into(), scale });
        // The longest numbers are whole within the image: its border stays white.
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
}
