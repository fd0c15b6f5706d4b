//! SVG output of drawings, with words as text and images embedded as PNG.

use crate::drawing::{Anchor, Drawing, Item, Rgb, Text};
use crate::{font, raster};
use std::fmt::Write as _;

impl Drawing {
    /// Converts the drawing to an SVG file, with one CSS pixel per pixel of the drawing.
    pub fn svg(&self) -> String {
        self.svg_at(None)
    }

    /// Converts the drawing to an SVG file. With `dpi` pixels per inch, its size is stated in millimetres.
    pub fn svg_at(&self, dpi: Option<f64>) -> String {
        let [width, height] = self.size;
        let side = |pixels: u32| match dpi {
            Some(dpi) => format!("{}mm", short(f64::from(pixels) / dpi * 25.4)),
            None => pixels.to_string(),
        };
        let mut text = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" xmlns:xlink=\"http://www.w3.org/1999/xlink\" width=\"{}\" \
             height=\"{}\" viewBox=\"0 0 {width} {height}\">\n",
            side(width),
            side(height)
        );
        let _ = writeln!(
            text,
            "<style>@font-face {{ font-family: Inter; src: url(data:font/ttf;base64,{}); }} text {{ font-family: {}; \
             white-space: pre; }}</style>",
            base64(font::FILE),
            font::FAMILY
        );
        if self.background[3] > 0 {
            let [r, g, b, a] = self.background;
            let _ = writeln!(
                text,
                "<rect width=\"{width}\" height=\"{height}\" fill=\"{}\" fill-opacity=\"{}\"/>",
                color([r, g, b]),
                short(f64::from(a) / 255.0)
            );
        }
        for item in &self.items {
            put(&mut text, item);
        }
        text + "</svg>\n"
    }
}

fn put(out: &mut String, item: &Item) {
    let _ = match item {
        Item::Picture(rect, picture) => writeln!(
            out,
            "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" \
             xlink:href=\"data:image/png;base64,{}\"/>",
            short(rect.at[0]),
            short(rect.at[1]),
            short(rect.size[0]),
            short(rect.size[1]),
            base64(&raster::encode_png(picture, None))
        ),
        Item::Polygon(points, fill) => {
            writeln!(out, "<polygon points=\"{}\" fill=\"{}\"/>", path(points), color(*fill))
        }
        Item::Line { points, width, color: stroke } => writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-linecap=\"square\"/>",
            path(points),
            color(*stroke),
            short(*width)
        ),
        Item::Text(text) => {
            put_text(out, text);
            Ok(())
        }
    };
}

fn put_text(out: &mut String, text: &Text) {
    let anchor = match text.anchor {
        Anchor::Start => "start",
        Anchor::Middle => "middle",
        Anchor::End => "end",
    };
    let [x, y] = text.at.map(short);
    let _ = write!(
        out,
        "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\" text-anchor=\"{anchor}\" fill=\"{}\"",
        short(text.size),
        color(text.color)
    );
    if let Some(halo) = text.halo {
        let width = short(2.0 * raster::HALO * text.size);
        let _ = write!(
            out,
            " stroke=\"{}\" stroke-width=\"{width}\" stroke-linejoin=\"round\" paint-order=\"stroke\"",
            color(halo)
        );
    }
    if text.is_turned {
        let _ = write!(out, " transform=\"rotate(-90 {x} {y})\"");
    }
    let _ = writeln!(out, ">{}</text>", escaped(&text.text));
}

/// Formats a number with at most two decimals.
fn short(value: f64) -> String {
    let text = format!("{value:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn path(points: &[[f64; 2]]) -> String {
    points.iter().map(|[x, y]| format!("{},{}", short(*x), short(*y))).collect::<Vec<_>>().join(" ")
}

fn color([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Escapes text for XML, and replaces control characters by spaces.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let byte = |i: usize| u32::from(chunk.get(i).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for i in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= chunk.len() { char::from(digit) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_rfc_4648() {
        let all = ["", "f", "fo", "foo", "foob", "fooba", "foobar"].map(|text| base64(text.as_bytes()));
        assert_eq!(all, ["", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy"]);
    }
}
