//! Raster output of drawings, as images and PNG files.

use crate::drawing::{Drawing, Item, Picture, Rect, Rgb, Text};
use crate::font::{self, Segment};
use ab_glyph_rasterizer::{Point, Rasterizer, point};
use png::{BitDepth, ColorType, Compression, Encoder, PixelDimensions, Unit};

/// Number of copies of a text, shifted in all directions, that are drawn below it as its halo.
const HALO_COPIES: u32 = 16;
/// Width of the halo around a text, in ems.
pub(crate) const HALO: f64 = 0.11;
/// Number of inches per metre, for the resolution in PNG files.
const INCHES: f64 = 39.370_078_740_157_48;

/// Image into which the items of a drawing are rasterised.
struct Canvas {
    size: [usize; 2],
    rgba: Vec<[u8; 4]>,
}

impl Canvas {
    /// Blends a colour with opacity `alpha` over a pixel.
    fn blend(&mut self, [x, y]: [usize; 2], color: Rgb, alpha: f64) {
        let pixel = &mut self.rgba[y * self.size[0] + x];
        let below = f64::from(pixel[3]) / 255.0 * (1.0 - alpha);
        let whole = alpha + below;
        if whole <= 0.0 {
            return;
        }
        let mix = |over: u8, under: u8| ((f64::from(over) * alpha + f64::from(under) * below) / whole).round() as u8;
        let [r, g, b, _] = *pixel;
        *pixel = [mix(color[0], r), mix(color[1], g), mix(color[2], b), (255.0 * whole).round() as u8];
    }

    /// Fills the area inside closed outlines. Outlines of holes run in the opposite direction.
    fn fill(&mut self, segments: &[Segment], color: Rgb) {
        let mut points = segments.iter().flat_map(|segment| match segment {
            Segment::Line(a, b) => [*a, *b, *b],
            Segment::Curve(a, b, c) => [*a, *b, *c],
        });
        let Some(first) = points.next() else { return };
        let (mut lo, mut hi) = (first, first);
        for p in points {
            (lo, hi) = ([lo[0].min(p[0]), lo[1].min(p[1])], [hi[0].max(p[0]), hi[1].max(p[1])]);
        }
        if !lo.iter().chain(&hi).all(|c| c.is_finite()) {
            return;
        }
        let limit = |v: f64, k: usize| v.clamp(0.0, self.size[k] as f64);
        let from = [0, 1].map(|k| limit(lo[k].floor(), k));
        let to = [0, 1].map(|k| limit(hi[k].ceil() + 1.0, k));
        let [width, height] = [0, 1].map(|k| (to[k] - from[k]).max(0.0) as usize);
        if width == 0 || height == 0 {
            return;
        }
        let mut rasterizer = Rasterizer::new(width, height);
        let at = |p: &[f64; 2]| -> Point { point((p[0] - from[0]) as f32, (p[1] - from[1]) as f32) };
        for segment in segments {
            match segment {
                Segment::Line(a, b) => rasterizer.draw_line(at(a), at(b)),
                Segment::Curve(a, b, c) => rasterizer.draw_quad(at(a), at(b), at(c)),
            }
        }
        let [x0, y0] = from.map(|c| c as usize);
        rasterizer.for_each_pixel_2d(|x, y, coverage| {
            if coverage > 0.0 {
                self.blend([x0 + x as usize, y0 + y as usize], color, f64::from(coverage).min(1.0));
            }
        });
    }

    fn picture(&mut self, rect: Rect, picture: &Picture) {
        let [columns, rows] = picture.size.map(|side| side as usize);
        let [x0, y0] = rect.at.map(|c| c.round().max(0.0) as usize);
        let [x1, y1] = [0, 1].map(|k| (rect.end()[k].round().max(0.0) as usize).min(self.size[k]));
        if columns == 0 || rows == 0 {
            return;
        }
        for y in y0..y1 {
            for x in x0..x1 {
                let [u, v] = [(x - x0) * columns / (x1 - x0), (y - y0) * rows / (y1 - y0)];
                let [r, g, b, a] = picture.rgba[v * columns + u];
                self.blend([x, y], [r, g, b], f64::from(a) / 255.0);
            }
        }
    }

    fn text(&mut self, text: &Text) {
        let outlines = font::outlines(&text.text);
        let lead = text.lead();
        let placed = |offset: [f64; 2]| -> Vec<Segment> {
            let at = |[x, y]: [f64; 2]| {
                let [x, y] = [x * text.size - lead, y * text.size];
                let [x, y] = if text.is_turned { [y, -x] } else { [x, y] };
                [text.at[0] + x + offset[0], text.at[1] + y + offset[1]]
            };
            outlines
                .iter()
                .map(|segment| match *segment {
                    Segment::Line(a, b) => Segment::Line(at(a), at(b)),
                    Segment::Curve(a, b, c) => Segment::Curve(at(a), at(b), at(c)),
                })
                .collect()
        };
        if let Some(halo) = text.halo {
            for i in 0..HALO_COPIES {
                let (s, c) = (f64::from(i) / f64::from(HALO_COPIES) * std::f64::consts::TAU).sin_cos();
                let radius = HALO * text.size;
                self.fill(&placed([radius * c, radius * s]), halo);
            }
        }
        self.fill(&placed([0.0; 2]), text.color);
    }
}

/// Converts a polygon to a closed outline of lines.
fn outline(points: &[[f64; 2]]) -> Vec<Segment> {
    let next = points.iter().cycle().skip(1);
    points.iter().zip(next).map(|(a, b)| Segment::Line(*a, *b)).collect()
}

/// Converts a polyline to an outline with square ends and corners.
fn stroke(points: &[[f64; 2]], width: f64) -> Vec<Segment> {
    let half = 0.5 * width;
    let quads = points.windows(2).filter_map(|pair| {
        let [a, b] = [pair[0], pair[1]];
        let [x, y] = [b[0] - a[0], b[1] - a[1]];
        let length = x.hypot(y);
        let [x, y] = [x / length * half, y / length * half];
        let corners = [
            [a[0] - x + y, a[1] - y - x],
            [b[0] + x + y, b[1] + y - x],
            [b[0] + x - y, b[1] + y + x],
            [a[0] - x - y, a[1] - y + x],
        ];
        (length > 0.0).then(|| outline(&corners))
    });
    quads.flatten().collect()
}

impl Drawing {
    /// Rasterises the drawing to an image, with one pixel per unit.
    pub fn picture(&self) -> Picture {
        let size = self.size.map(|side| side as usize);
        let mut canvas = Canvas { size, rgba: vec![self.background; size[0] * size[1]] };
        for item in &self.items {
            match item {
                Item::Picture(rect, picture) => canvas.picture(*rect, picture),
                Item::Polygon(points, color) => canvas.fill(&outline(points), *color),
                Item::Line { points, width, color } => canvas.fill(&stroke(points, *width), *color),
                Item::Text(text) => canvas.text(text),
            }
        }
        Picture { size: self.size, rgba: canvas.rgba }
    }

    /// Encodes the drawing as a PNG file, which states `dpi` pixels per inch if given. The result is empty for a
    /// drawing without pixels.
    pub fn png(&self, dpi: Option<f64>) -> Vec<u8> {
        encode_png(&self.picture(), dpi)
    }
}

/// Encodes an image as a PNG file; opaque images are stored without alpha.
pub(crate) fn encode_png(picture: &Picture, dpi: Option<f64>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, picture.size[0], picture.size[1]);
    let opaque = picture.is_opaque();
    encoder.set_color(if opaque { ColorType::Rgb } else { ColorType::Rgba });
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::Balanced);
    if let Some(dpi) = dpi {
        let per_metre = (dpi * INCHES).round() as u32;
        encoder.set_pixel_dims(Some(PixelDimensions { xppu: per_metre, yppu: per_metre, unit: Unit::Meter }));
    }
    let data = bytes_of(picture, opaque);
    // Writing to memory fails only for images without pixels, which become empty files.
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&data));
    if written.is_ok() { bytes } else { Vec::new() }
}

/// Returns the channel levels of an image, without alpha if `opaque` is true.
pub(crate) fn bytes_of(picture: &Picture, opaque: bool) -> Vec<u8> {
    let count = if opaque { 3 } else { 4 };
    picture.rgba.iter().flat_map(|pixel| pixel.iter().copied().take(count)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawing::Anchor;

    fn drawing(items: Vec<Item>) -> Picture {
        Drawing { size: [20, 20], background: [255; 4], items, areas: Vec::new() }.picture()
    }

    #[test]
    fn shapes_cover_their_pixels() {
        let square = Rect::new([5.0, 5.0], [4.0, 4.5]).corners();
        let picture = drawing(vec![Item::Polygon(square, [0; 3])]);
        let dark = |x: usize, y: usize| picture.rgba[y * 20 + x][0];
        assert_eq!((dark(5, 5), dark(8, 8), dark(4, 5), dark(9, 5)), (0, 0, 255, 255));
        assert_eq!(dark(5, 9), 128, "half a pixel");
        let line = Item::Line { points: vec![[2.0, 10.0], [18.0, 10.0], [18.0, 2.0]], width: 2.0, color: [0; 3] };
        let picture = drawing(vec![line]);
        let count = picture.rgba.iter().filter(|pixel| pixel[0] == 0).count();
        // Two bars of width 2 with square ends: 18×2 and 10×2 pixels, less the corner that both cover.
        assert_eq!(count, 36 + 20 - 4);
    }

    #[test]
    fn text_has_the_area_of_its_letters_whichever_way_it_runs() {
        let text = |is_turned| {
            let at = if is_turned { [15.0, 10.0] } else { [10.0, 15.0] };
            let (size, anchor, color) = (14.0, Anchor::Middle, [0; 3]);
            Item::Text(Text { text: "H".into(), at, size, anchor, is_turned, color, halo: None })
        };
        let ink = |is_turned| {
            let picture = drawing(vec![text(is_turned)]);
            picture.rgba.iter().map(|pixel| f64::from(255 - pixel[0]) / 255.0).sum::<f64>()
        };
        let (across, up) = (ink(false), ink(true));
        assert!((across - up).abs() < 0.5 && across > 20.0 && across < 60.0, "{across} {up}");
    }

    #[test]
    fn transparent_backgrounds_stay() {
        let mut empty = Drawing { size: [4, 4], background: [0; 4], ..Drawing::default() };
        empty.items.push(Item::Polygon(Rect::new([0.0, 0.0], [2.0, 4.0]).corners(), [10, 20, 30]));
        let picture = empty.picture();
        assert_eq!((picture.rgba[0], picture.rgba[3]), ([10, 20, 30, 255], [0; 4]));
    }
}
