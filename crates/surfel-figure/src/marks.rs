//! Layout of marks over images: scale bars, axes, arrows, labels and lines.

use crate::drawing::{Anchor, Drawing, Item, Picture, Rect, Rgb, Text};
use crate::figure::{Axis, Mark, Panel, Style};
use crate::font;

/// Distance of corner marks from the panel's border, in ems of [`Style::font`].
const INSET: f64 = 0.9;
/// Length, in ems, of an axis that is parallel to the image.
const AXIS: f64 = 1.9;
/// Distance from the tip of an axis to its name, in ems.
const AXIS_NAME: f64 = 0.6;
/// Length of the north arrow, in ems.
const ARROW: f64 = 2.2;
/// Width of axes and polylines, in ems.
const LINE: f64 = 0.12;
/// Width of the halo on either side of a line, in ems.
const HALO: f64 = 0.12;
/// Radius of the dot at a labelled point, in ems.
const DOT: f64 = 0.22;
/// Width, in ems, of the surroundings of a corner mark that must have the same colour as the area behind the mark.
const CLEARANCE: f64 = 0.25;
/// Largest distance, in ems, by which a corner mark moves away from its corner along each axis to find an even area.
const MAX_MOVE: f64 = 5.0;
/// Distance between the positions that are tried for a corner mark, in ems.
const MOVE: f64 = 0.25;
/// Largest difference per channel, in 8-bit levels, between a pixel and the figure's background at which the pixel
/// counts as background. Pixels with at most this alpha level count as background, too.
const SAME_LEVELS: u8 = 24;
/// Largest range per channel, in 8-bit levels, within an area that counts as one colour. The shades of one surface in
/// soft light differ by less, and the colours of two classes by more.
const ONE_COLOR_LEVELS: u8 = 48;

/// Places the marks of a panel, whose image is in the rectangle `at`.
pub(crate) fn place(panel: &Panel, at: Rect, style: &Style, drawing: &mut Drawing) {
    let marks = &panel.marks;
    let mut placer = Placer { panel: at, picture: panel.picture.as_deref(), style, drawing, taken: Vec::new() };
    // Lines are drawn first, so that they are below all texts. Axes and north arrows are placed next, then scale bars,
    // which avoid them, and then labels, which avoid all other marks.
    let order = |mark: &Mark| match mark {
        Mark::Line { .. } => 0,
        Mark::Axes(_) | Mark::North { .. } => 1,
        Mark::Scale { .. } => 2,
        Mark::Label { .. } => 3,
    };
    for step in 0..4 {
        for mark in marks.iter().filter(|mark| order(mark) == step) {
            match mark {
                Mark::Scale { length, label } => placer.scale(*length, label),
                Mark::Axes(axes) => placer.axes(axes),
                Mark::North { direction } => placer.north(*direction),
                Mark::Label { at, text } => placer.label(*at, text),
                Mark::Line { points, color } => placer.line(points, *color),
            }
        }
    }
}

/// Draws the marks of one panel into a drawing, so that they don't overlap.
struct Placer<'a> {
    panel: Rect,
    /// Image of the panel, behind the marks.
    picture: Option<&'a Picture>,
    style: &'a Style,
    drawing: &'a mut Drawing,
    /// Areas already occupied by marks and their texts.
    taken: Vec<Rect>,
}

impl Placer<'_> {
    fn em(&self) -> f64 {
        self.style.font
    }

    /// Adds an area to the occupied ones and to the drawing's areas.
    fn take(&mut self, area: Rect) {
        self.taken.push(area);
        self.drawing.areas.push(("mark", area));
    }

    /// Returns the area for a mark that is wanted in one of these corners of the panel, in order of preference. From
    /// each corner, the nearest free area is searched in which the image has one colour. Otherwise, the result is the
    /// nearest free area that covers either only background pixels or none of them. If there is no such area either, or
    /// the panel has no image, the result is the first corner.
    fn even_area(&self, corners: &[Rect]) -> Rect {
        let em = self.em();
        let steps = (MAX_MOVE / MOVE) as i32;
        let all = (-steps..=steps).flat_map(|y| (-steps..=steps).map(move |x| [x, y]));
        let mut moves: Vec<[i32; 2]> = all.collect();
        moves.sort_by_key(|[x, y]| x * x + y * y);
        let moved = |corner: &Rect, step: [i32; 2]| {
            let [x, y] = step.map(|n| f64::from(n) * MOVE * em);
            Rect::new([corner.at[0] + x, corner.at[1] + y], corner.size)
        };
        let free: Vec<Rect> = corners
            .iter()
            .flat_map(|corner| moves.iter().map(move |step| moved(corner, *step)))
            .filter(|area| self.is_free(*area))
            .collect();
        let margin = CLEARANCE * em;
        let first = |is_even: fn(&Picture, Rect, Rect, &Style) -> bool| {
            let picture = self.picture?;
            free.iter().find(|area| {
                let around = Rect::new(area.at.map(|c| c - margin), area.size.map(|c| c + 2.0 * margin));
                is_even(picture, self.panel, around, self.style)
            })
        };
        first(has_one_color).or_else(|| first(is_uniform)).or(corners.first()).copied().unwrap_or(self.panel)
    }

    /// True if an area lies within the panel and overlaps no occupied area.
    fn is_free(&self, area: Rect) -> bool {
        self.panel.contains(&area) && !self.taken.iter().any(|taken| taken.overlaps(&area))
    }

    /// Draws a text with a halo, and returns its bounds.
    fn words(&mut self, text: &str, at: [f64; 2], anchor: Anchor, color: Rgb) -> Rect {
        let (size, halo) = (self.em(), Some(self.style.halo()));
        let text = Text { text: text.to_owned(), at, size, anchor, is_turned: false, color, halo };
        let bounds = text.bounds();
        self.drawing.items.push(Item::Text(text));
        bounds
    }

    /// Draws the halo of a line, a wider line below it that separates it from the image.
    fn border(&mut self, points: Vec<[f64; 2]>, width: f64) {
        let (width, color) = (width + 2.0 * HALO * self.em(), self.style.halo());
        self.drawing.items.push(Item::Line { points, width, color });
    }

    /// Draws a line with a halo.
    fn stroke(&mut self, points: Vec<[f64; 2]>, width: f64, color: Rgb) {
        self.border(points.clone(), width);
        self.drawing.items.push(Item::Line { points, width, color });
    }

    fn scale(&mut self, length: f64, label: &str) {
        let em = self.em();
        let (width, cap) = ((0.16 * em).max(1.0), 0.3 * em);
        // The label may be wider than the bar.
        let half = 0.5 * length.max(font::width(label) * em);
        let height = cap + (0.25 + font::ASCENT) * em;
        let lefts = [self.panel.at[0] + INSET * em, self.panel.end()[0] - INSET * em - 2.0 * half];
        let top = self.panel.end()[1] - INSET * em - height;
        let area = self.even_area(&lefts.map(|left| Rect::new([left, top], [2.0 * half, height])));
        let [left, bottom] = [area.at[0], area.end()[1]];
        let middle = left + half;
        let ends = [middle - 0.5 * length, middle + 0.5 * length];
        let bar = vec![[ends[0], bottom - cap], [ends[0], bottom], [ends[1], bottom], [ends[1], bottom - cap]];
        let ink = self.style.ink();
        self.stroke(bar, width, ink);
        let baseline = bottom - cap - 0.25 * em;
        let words = self.words(label, [middle, baseline], Anchor::Middle, ink);
        let top = words.at[1];
        self.take(Rect::new([left, top], [2.0 * half, bottom - top]));
    }

    fn axes(&mut self, axes: &[Axis; 3]) {
        let em = self.em();
        let reach = (AXIS + AXIS_NAME + 0.5) * em;
        let inset = INSET * em * 0.6 + reach;
        let origin = [self.panel.end()[0] - inset, self.panel.end()[1] - inset];
        let mut order: Vec<&Axis> = axes.iter().collect();
        // Axes are drawn from far to near.
        order.sort_by(|a, b| b.direction[2].total_cmp(&a.direction[2]));
        let width = (LINE * em).max(1.0);
        let tip_of = |axis: &Axis| [0, 1].map(|k| origin[k] + AXIS * em * axis.direction[k]);
        // Halos are drawn first, so that they cover no other axis.
        axes.iter().for_each(|axis| self.border(vec![origin, tip_of(axis)], width));
        for axis in order {
            let [x, y, _] = axis.direction;
            let (length, tip) = (x.hypot(y), tip_of(axis));
            self.drawing.items.push(Item::Line { points: vec![origin, tip], width, color: axis.color });
            // The name of an axis along the view is next to the origin.
            let away = if length > 0.05 { [x / length, y / length] } else { [-0.7, 0.7] };
            let name = [tip[0] + away[0] * AXIS_NAME * em, tip[1] + away[1] * AXIS_NAME * em];
            self.words(&axis.name, [name[0], name[1] + 0.5 * 0.545 * em], Anchor::Middle, axis.color);
        }
        self.take(Rect::new([origin[0] - reach, origin[1] - reach], [2.0 * reach; 2]));
    }

    fn north(&mut self, [x, y]: [f64; 2]) {
        let em = self.em();
        let length = x.hypot(y);
        if length == 0.0 {
            return;
        }
        let ([x, y], reach) = ([x / length, y / length], (0.5 * ARROW + 1.0) * em);
        let corner = [self.panel.end()[0] - INSET * em - 2.0 * reach, self.panel.at[1] + INSET * em];
        let center = self.even_area(&[Rect::new(corner, [2.0 * reach; 2])]).at.map(|c| c + reach);
        let at = |along: f64, across: f64| {
            [center[0] + (along * x - across * y) * em, center[1] + (along * y + across * x) * em]
        };
        let ink = self.style.ink();
        let tip = 0.5 * ARROW;
        self.stroke(vec![at(-tip, 0.0), at(tip - 0.4, 0.0)], (0.14 * em).max(1.0), ink);
        let head = vec![at(tip, 0.0), at(tip - 0.95, 0.42), at(tip - 0.75, 0.0), at(tip - 0.95, -0.42)];
        let outline = head.iter().chain(&head[..2]).copied().collect();
        self.border(outline, 0.0);
        self.drawing.items.push(Item::Polygon(head, ink));
        let [nx, ny] = at(tip + 0.6, 0.0);
        self.words("N", [nx, ny + 0.5 * font::CAP_HEIGHT * em], Anchor::Middle, ink);
        self.take(Rect::new([center[0] - reach, center[1] - reach], [2.0 * reach; 2]));
    }

    /// Draws a labelled point. If possible, its text is placed beside the point so that it overlaps neither another
    /// mark nor the panel's border, and where the image has one colour. Points outside the panel aren't drawn.
    fn label(&mut self, at: [f64; 2], text: &str) {
        let em = self.em();
        let at = [self.panel.at[0] + at[0], self.panel.at[1] + at[1]];
        let is_inside = self.panel.contains(&Rect::new(at, [0.0; 2]));
        if !is_inside || !at.iter().all(|c| c.is_finite()) {
            return;
        }
        let (gap, lift) = (0.5 * em, 0.5 * font::CAP_HEIGHT * em);
        let below = gap + font::ASCENT * em * 0.8;
        let places = [
            ([gap, lift], Anchor::Start),
            ([-gap, lift], Anchor::End),
            ([0.0, -gap], Anchor::Middle),
            ([0.0, below], Anchor::Middle),
            ([gap * 0.7, -gap * 0.7], Anchor::Start),
            ([-gap * 0.7, -gap * 0.7], Anchor::End),
            ([gap * 0.7, below], Anchor::Start),
            ([-gap * 0.7, below], Anchor::End),
        ];
        let text_at = |([x, y], anchor): ([f64; 2], Anchor)| Text {
            text: text.to_owned(),
            at: [at[0] + x, at[1] + y],
            size: em,
            anchor,
            is_turned: false,
            color: self.style.ink(),
            halo: Some(self.style.halo()),
        };
        let candidates: Vec<Text> = places.into_iter().map(text_at).collect();
        let is_free = |text: &&Text| self.is_free(text.bounds());
        let is_even = |text: &&Text| {
            self.picture.is_none_or(|picture| has_one_color(picture, self.panel, text.bounds(), self.style))
        };
        let free = || candidates.iter().filter(is_free);
        let inside = || candidates.iter().find(|text| self.panel.contains(&text.bounds()));
        let chosen = free().find(is_even).or_else(|| free().next()).or_else(inside);
        let chosen = chosen.unwrap_or(&candidates[0]).clone();
        let dot = Rect::new([at[0] - DOT * em, at[1] - DOT * em], [2.0 * DOT * em; 2]);
        let (ink, halo) = (self.style.ink(), self.style.halo());
        self.drawing.items.push(Item::Polygon(disk(at, (DOT + 0.1) * em), halo));
        self.drawing.items.push(Item::Polygon(disk(at, DOT * em), ink));
        let bounds = chosen.bounds();
        self.drawing.items.push(Item::Text(chosen));
        self.taken.push(dot);
        self.take(bounds);
    }

    /// Draws the parts of a polyline that are inside the panel.
    fn line(&mut self, points: &[[f64; 2]], color: Rgb) {
        let [x, y] = self.panel.at;
        let width = (LINE * self.em()).max(1.0);
        for pair in points.windows(2) {
            let ends = [pair[0], pair[1]].map(|p| [p[0] + x, p[1] + y]);
            if let Some([a, b]) = clipped(ends, self.panel) {
                self.drawing.items.push(Item::Line { points: vec![a, b], width, color });
            }
        }
    }
}

/// Returns the pixels of a panel's image that a rectangle of the figure covers, row by row.
fn pixels_in(picture: &Picture, panel: Rect, area: Rect) -> impl Iterator<Item = [u8; 4]> {
    let [width, height] = picture.size;
    let range = |k: usize, count: u32| {
        let scale = f64::from(count) / panel.size[k].max(1.0);
        let [from, to] = [area.at[k], area.end()[k]].map(|c| (c - panel.at[k]) * scale);
        let end = to.ceil().clamp(0.0, f64::from(count)) as u32;
        (from.floor().max(0.0) as u32).min(end)..end
    };
    let (columns, rows) = (range(0, width), range(1, height));
    rows.flat_map(move |y| columns.clone().map(move |x| picture.rgba[(y * width + x) as usize]))
}

/// Returns a function that is true for transparent pixels and for pixels of the background's colour.
fn background_test(style: &Style) -> impl Fn([u8; 4]) -> bool {
    let own = style.background;
    // Transparent pixels show what is behind the image.
    move |pixel| {
        pixel[3] <= SAME_LEVELS
            || own[3] > SAME_LEVELS && pixel.iter().zip(own).all(|(p, own)| p.abs_diff(own) <= SAME_LEVELS)
    }
}

/// True if a rectangle of the figure covers only background pixels of a panel's image, or only other pixels.
fn is_uniform(picture: &Picture, panel: Rect, area: Rect, style: &Style) -> bool {
    let is_background = background_test(style);
    let mut pixels = pixels_in(picture, panel, area).map(is_background);
    let first = pixels.next();
    pixels.all(|pixel| Some(pixel) == first)
}

/// True if a rectangle of the figure covers only background pixels of a panel's image, or only other pixels of about
/// one colour ([`ONE_COLOR_LEVELS`]).
fn has_one_color(picture: &Picture, panel: Rect, area: Rect, style: &Style) -> bool {
    let (mut low, mut high) = ([u8::MAX; 4], [u8::MIN; 4]);
    let has_one = pixels_in(picture, panel, area).all(|pixel| {
        low = std::array::from_fn(|k| low[k].min(pixel[k]));
        high = std::array::from_fn(|k| high[k].max(pixel[k]));
        low.iter().zip(high).all(|(low, high)| high - low <= ONE_COLOR_LEVELS)
    });
    has_one && is_uniform(picture, panel, area, style)
}

/// Returns a polygon that approximates a disk.
fn disk(center: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    const CORNERS: u32 = 24;
    let at = |i: u32| (f64::from(i) / f64::from(CORNERS) * std::f64::consts::TAU).sin_cos();
    (0..CORNERS).map(at).map(|(s, c)| [center[0] + radius * c, center[1] + radius * s]).collect()
}

/// Returns the part of a segment inside a rectangle (Liang and Barsky 1984); `None` if the segment misses it.
fn clipped([a, b]: [[f64; 2]; 2], rect: Rect) -> Option<[[f64; 2]; 2]> {
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for k in 0..2 {
        let step = b[k] - a[k];
        let limits = [rect.at[k] - a[k], rect.end()[k] - a[k]];
        if step == 0.0 {
            if limits[0] > 0.0 || limits[1] < 0.0 {
                return None;
            }
            continue;
        }
        let [enter, leave] = if step > 0.0 { limits } else { [limits[1], limits[0]] };
        from = from.max(enter / step);
        to = to.min(leave / step);
    }
    let at = |t: f64| [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
    (from < to && from.is_finite() && to.is_finite()).then(|| [at(from), at(to)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_clipped_at_the_border() {
        let rect = Rect::new([0.0, 0.0], [10.0, 10.0]);
        assert_eq!(clipped([[-5.0, 5.0], [15.0, 5.0]], rect), Some([[0.0, 5.0], [10.0, 5.0]]));
        assert_eq!(clipped([[2.0, 2.0], [3.0, 4.0]], rect), Some([[2.0, 2.0], [3.0, 4.0]]));
        assert_eq!(clipped([[-5.0, 0.0], [0.0, -5.0]], rect), None);
        assert_eq!(clipped([[11.0, 0.0], [11.0, 9.0]], rect), None);
    }
}
