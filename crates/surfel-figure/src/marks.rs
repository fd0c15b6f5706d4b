//! Marks over images: scale bars, axes, arrows, labels and lines.

use crate::drawing::{Anchor, Drawing, Item, Picture, Rect, Rgb, Text};
use crate::figure::{Axis, Mark, Panel, Style};
use crate::font;

/// Lengths in ems.
const INSET: f64 = 0.9;
const AXIS: f64 = 1.9;
const AXIS_NAME: f64 = 0.6;
const ARROW: f64 = 2.2;
const LINE: f64 = 0.12;
const HALO: f64 = 0.12;
const DOT: f64 = 0.22;
/// Distance between a mark in a corner and the border of the image's content.
const CLEARANCE: f64 = 0.25;
/// Largest distance along each axis by which a mark moves away from that border, and the step of the search.
const MOST_MOVE: f64 = 3.0;
const MOVE: f64 = 0.25;
/// Largest difference of levels, per channel, between the background and a pixel without content.
const SAME_LEVELS: u8 = 24;

/// Places the marks of a panel, whose image lies in the rectangle `at`.
pub(crate) fn place(panel: &Panel, at: Rect, style: &Style, drawing: &mut Drawing) {
    let marks = &panel.marks;
    let mut placer = Placer { panel: at, picture: panel.picture.as_deref(), style, drawing, taken: Vec::new() };
    // Lines lie below all words. Labels avoid the marks in the corners, so that they come last.
    let order = |mark: &Mark| match mark {
        Mark::Line { .. } => 0,
        Mark::Scale { .. } | Mark::Axes(_) | Mark::North { .. } => 1,
        Mark::Label { .. } => 2,
    };
    for step in 0..3 {
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

struct Placer<'a> {
    panel: Rect,
    /// Image below the marks.
    picture: Option<&'a Picture>,
    style: &'a Style,
    drawing: &'a mut Drawing,
    /// Areas of the panel's words and marks.
    taken: Vec<Rect>,
}

impl Placer<'_> {
    fn em(&self) -> f64 {
        self.style.font
    }

    fn take(&mut self, area: Rect) {
        self.taken.push(area);
        self.drawing.areas.push(("mark", area));
    }

    /// Returns how far a mark in a corner has to move so that it lies wholly inside the content of the image, or wholly
    /// outside of it: the shortest way, within the panel. The mark stays where it is if there is no such place nearby.
    fn move_off_border(&self, area: Rect) -> [f64; 2] {
        let em = self.em();
        let Some(picture) = self.picture else { return [0.0; 2] };
        let steps = (MOST_MOVE / MOVE) as i32;
        let all = (-steps..=steps).flat_map(|y| (-steps..=steps).map(move |x| [x, y]));
        let mut moves: Vec<[i32; 2]> = all.collect();
        moves.sort_by_key(|[x, y]| x * x + y * y);
        let margin = CLEARANCE * em;
        let is_clear = |[x, y]: &[f64; 2]| {
            let area = Rect::new([area.at[0] + x, area.at[1] + y], area.size);
            let around = Rect::new(area.at.map(|c| c - margin), area.size.map(|c| c + 2.0 * margin));
            self.panel.contains(&area)
                && !self.taken.iter().any(|taken| taken.overlaps(&area))
                && is_uniform(picture, self.panel, around, self.style)
        };
        moves.into_iter().map(|step| step.map(|n| f64::from(n) * MOVE * em)).find(is_clear).unwrap_or_default()
    }

    fn words(&mut self, text: &str, at: [f64; 2], anchor: Anchor, color: Rgb) -> Rect {
        let (size, halo) = (self.em(), Some(self.style.halo()));
        let text = Text { text: text.to_owned(), at, size, anchor, is_turned: false, color, halo };
        let bounds = text.bounds();
        self.drawing.items.push(Item::Text(text));
        bounds
    }

    /// Draws the border that sets a line off from the image.
    fn border(&mut self, points: Vec<[f64; 2]>, width: f64) {
        let (width, color) = (width + 2.0 * HALO * self.em(), self.style.halo());
        self.drawing.items.push(Item::Line { points, width, color });
    }

    /// Draws a line with its border.
    fn stroke(&mut self, points: Vec<[f64; 2]>, width: f64, color: Rgb) {
        self.border(points.clone(), width);
        self.drawing.items.push(Item::Line { points, width, color });
    }

    fn scale(&mut self, length: f64, label: &str) {
        let em = self.em();
        let (width, cap) = ((0.16 * em).max(1.0), 0.3 * em);
        // The words may be wider than the bar.
        let half = 0.5 * length.max(font::width(label) * em);
        let corner = [self.panel.at[0] + INSET * em, self.panel.end()[1] - INSET * em];
        let height = cap + (0.25 + font::ASCENT) * em;
        let moved = self.move_off_border(Rect::new([corner[0], corner[1] - height], [2.0 * half, height]));
        let [left, bottom] = [corner[0] + moved[0], corner[1] + moved[1]];
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
        // The farthest first.
        order.sort_by(|a, b| b.direction[2].total_cmp(&a.direction[2]));
        let width = (LINE * em).max(1.0);
        let tip_of = |axis: &Axis| [0, 1].map(|k| origin[k] + AXIS * em * axis.direction[k]);
        // The border of an axis covers no other axis.
        axes.iter().for_each(|axis| self.border(vec![origin, tip_of(axis)], width));
        for axis in order {
            let [x, y, _] = axis.direction;
            let (length, tip) = (x.hypot(y), tip_of(axis));
            self.drawing.items.push(Item::Line { points: vec![origin, tip], width, color: axis.color });
            // An axis along the view has its name beside the origin.
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
        let corner = [self.panel.end()[0] - INSET * em - reach, self.panel.at[1] + INSET * em + reach];
        let moved = self.move_off_border(Rect::new(corner.map(|c| c - reach), [2.0 * reach; 2]));
        let center = [corner[0] + moved[0], corner[1] + moved[1]];
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

    /// Places a text beside a point, where it covers neither other marks nor the panel's border.
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
        let is_free = |text: &Text| {
            let bounds = text.bounds();
            self.panel.contains(&bounds) && !self.taken.iter().any(|taken| taken.overlaps(&bounds))
        };
        let inside = |text: &Text| self.panel.contains(&text.bounds());
        let candidates: Vec<Text> = places.into_iter().map(text_at).collect();
        let chosen =
            candidates.iter().find(|text| is_free(text)).or_else(|| candidates.iter().find(|text| inside(text)));
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

    /// Draws the parts of a polyline that lie within the panel.
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

/// True if a rectangle of a panel shows nothing but the background, or nothing but the content of its image.
fn is_uniform(picture: &Picture, panel: Rect, area: Rect, style: &Style) -> bool {
    let [width, height] = picture.size;
    let range = |k: usize, count: u32| {
        let scale = f64::from(count) / panel.size[k].max(1.0);
        let [from, to] = [area.at[k], area.end()[k]].map(|c| (c - panel.at[k]) * scale);
        let end = to.ceil().clamp(0.0, f64::from(count)) as u32;
        (from.floor().max(0.0) as u32).min(end)..end
    };
    let [r, g, b, a] = style.background;
    let is_background = |[pr, pg, pb, pa]: [u8; 4]| {
        let is_same = |(p, own): (u8, u8)| p.abs_diff(own) <= SAME_LEVELS;
        // Transparent pixels show what is behind the image.
        pa <= SAME_LEVELS || a > SAME_LEVELS && [(pr, r), (pg, g), (pb, b), (pa, a)].into_iter().all(is_same)
    };
    let mut found = [false; 2];
    for y in range(1, height) {
        for x in range(0, width) {
            let pixel = picture.rgba[(y * width + x) as usize];
            found[usize::from(is_background(pixel))] = true;
        }
        if found == [true; 2] {
            return false;
        }
    }
    true
}

/// Returns a polygon for a disk.
fn disk(center: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
    const CORNERS: u32 = 24;
    let at = |i: u32| (f64::from(i) / f64::from(CORNERS) * std::f64::consts::TAU).sin_cos();
    (0..CORNERS).map(at).map(|(s, c)| [center[0] + radius * c, center[1] + radius * s]).collect()
}

/// Returns the part of a segment within a rectangle (Liang and Barsky 1984).
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
