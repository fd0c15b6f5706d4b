//! Layout of keys: colour bars and legends.

use crate::drawing::{Anchor, Drawing, Item, Picture, Rect, Rgb, Text};
use crate::figure::{Key, KeyContent, Style};
use crate::font;
use crate::ticks::Ticks;
use std::sync::Arc;

/// Width of a colour bar, in ems of [`Style::font`].
const BAR_WIDTH: f64 = 1.0;
/// Height, in ems, of the arrow above a colour bar that shows that larger values occur.
const ARROW: f64 = 0.8;
/// Smallest and largest height of a colour bar, in ems.
const BAR_HEIGHT: (f64, f64) = (7.0, 26.0);
/// Length of the tick lines beside a colour bar, in ems.
const TICK: f64 = 0.35;
/// Distance between a tick line and its label, in ems.
const TICK_GAP: f64 = 0.3;
/// Smallest average distance between the ticks of a colour bar, in ems. It determines the number of ticks, from 2 to 8.
const TICK_DISTANCE: f64 = 2.6;
/// Side of the coloured square of a legend entry, in ems.
const SWATCH: f64 = 0.95;
/// Distance between the tops of successive legend entries, in ems.
const ENTRY_HEIGHT: f64 = 1.5;
/// Distance between the square of a legend entry and its text, in ems.
const ENTRY_GAP: f64 = 0.5;
/// Distance between the columns of a legend, in ems.
const COLUMN_GAP: f64 = 1.2;
/// Height that a key's title takes above the bar or the entries, in ems.
const TITLE_HEIGHT: f64 = 1.7;
/// Largest width of a legend entry's text, in ems; longer texts end in an ellipsis.
const ENTRY_WIDTH: f64 = 20.0;
/// Height, in ems, that a legend fills before it gets a second column, even next to lower panels.
const COLUMN_HEIGHT: f64 = 12.0;
/// Maximum number of entries that a legend shows; the rest is summarised as "+N more".
const MAX_ENTRIES: usize = 256;

/// Key laid out as drawing items, with positions relative to the key's upper left corner.
pub(crate) struct SizedKey {
    pub(crate) size: [f64; 2],
    drawing: Drawing,
}

impl SizedKey {
    /// Lays out a key beside panels that are `height` pixels high. A colour bar fills this height within the limits of
    /// [`BAR_HEIGHT`], and a legend gets as many columns as it needs.
    pub(crate) fn new(key: &Key, height: f64, style: &Style) -> Self {
        let mut sized = Self { size: [0.0; 2], drawing: Drawing::default() };
        let title = if let KeyContent::Bar { range, .. } = &key.content {
            let factor = Ticks::new(*range, sized.ticks(height, key, style)).factor();
            [key.title.as_str(), factor.as_str()].into_iter().filter(|t| !t.is_empty()).collect::<Vec<_>>().join(" ")
        } else {
            key.title.clone()
        };
        let top = if title.is_empty() { 0.0 } else { TITLE_HEIGHT * style.font };
        if !title.is_empty() {
            sized.text([0.0, font::CAP_HEIGHT * style.font], title, style);
        }
        match &key.content {
            KeyContent::Bar { colors, range, is_exceeded } => {
                let arrow = if *is_exceeded { ARROW * style.font } else { 0.0 };
                let height = bar_height(height - top - arrow, style);
                let ticks = Ticks::new(*range, tick_count(height, style));
                let bar = Rect::new([0.0, top + arrow], [BAR_WIDTH * style.font, height]);
                if let Some(color) = colors.last().filter(|_| *is_exceeded) {
                    sized.arrow(bar, arrow, *color, style);
                }
                sized.bar(bar, colors, *range, &ticks, style);
            }
            KeyContent::Legend(entries) => sized.legend(entries, top, (height - top).max(0.0), style),
        }
        let texts: Vec<Rect> = sized.drawing.texts().map(Text::bounds).collect();
        for bounds in texts {
            sized.extend(bounds.end());
        }
        sized
    }

    /// Returns the number of ticks of a colour bar with a title, next to panels of this height in pixels.
    fn ticks(&self, height: f64, key: &Key, style: &Style) -> usize {
        let top = if key.title.is_empty() { 0.0 } else { TITLE_HEIGHT * style.font };
        tick_count(bar_height(height - top, style), style)
    }

    /// Enlarges the key's size so that it contains a point.
    fn extend(&mut self, [x, y]: [f64; 2]) {
        self.size = [self.size[0].max(x), self.size[1].max(y)];
    }

    fn text(&mut self, at: [f64; 2], text: String, style: &Style) {
        let (size, color) = (style.font, style.ink());
        let text = Text { text, at, size, anchor: Anchor::Start, is_turned: false, color, halo: None };
        self.drawing.items.push(Item::Text(text));
    }

    fn bar(&mut self, bar: Rect, colors: &[Rgb], [lo, hi]: [f64; 2], ticks: &Ticks, style: &Style) {
        let rgba = colors.iter().rev().map(|[r, g, b]| [*r, *g, *b, 255]).collect();
        let picture = Picture { size: [1, colors.len() as u32], rgba };
        let (em, [right, bottom]) = (style.font, bar.end());
        self.drawing.items.push(Item::Picture(bar, Arc::new(picture)));
        let width = (0.06 * em).max(1.0);
        let mut border = bar.corners();
        border.push(bar.at);
        self.drawing.items.push(Item::Line { points: border, width, color: style.ink() });
        for (value, label) in ticks.values.iter().zip(&ticks.labels) {
            let share = if hi > lo { ((value - lo) / (hi - lo)).clamp(0.0, 1.0) } else { 0.5 };
            let y = bottom - share * bar.size[1];
            let end = right + TICK * em;
            self.drawing.items.push(Item::Line { points: vec![[right, y], [end, y]], width, color: style.ink() });
            self.text([end + TICK_GAP * em, y + 0.5 * font::CAP_HEIGHT * em], label.clone(), style);
        }
        self.extend([right + TICK * em, bottom]);
    }

    /// Draws the arrow above a colour bar, which shows that values above the bar's range occur. `color` is the colour
    /// of these values.
    fn arrow(&mut self, bar: Rect, height: f64, color: Rgb, style: &Style) {
        let ([left, top], right) = (bar.at, bar.end()[0]);
        let corners = vec![[left, top], [0.5 * (left + right), top - height], [right, top]];
        self.drawing.items.push(Item::Polygon(corners.clone(), color));
        let width = (0.06 * style.font).max(1.0);
        self.drawing.items.push(Item::Line { points: corners, width, color: style.ink() });
    }

    fn legend(&mut self, entries: &[(String, Rgb)], top: f64, height: f64, style: &Style) {
        let em = style.font;
        let room = (height.max(COLUMN_HEIGHT * em) / (ENTRY_HEIGHT * em)).floor().max(1.0) as usize;
        let shown = &entries[..entries.len().min(MAX_ENTRIES)];
        let more = Some(entries.len() - shown.len()).filter(|more| *more > 0);
        let count = shown.len() + usize::from(more.is_some());
        // Entries are divided evenly among the columns.
        let columns = count.div_ceil(room).max(1);
        let in_column = count.div_ceil(columns).max(1);
        let texts: Vec<(String, Option<Rgb>)> = shown
            .iter()
            .map(|(text, color)| (font::shortened(text, ENTRY_WIDTH), Some(*color)))
            .chain(more.map(|more| (format!("+{more} more"), None)))
            .collect();
        let mut x = 0.0;
        for column in texts.chunks(in_column) {
            let mut widest: f64 = 0.0;
            for (i, (text, color)) in column.iter().enumerate() {
                let y = top + i as f64 * ENTRY_HEIGHT * em;
                if let Some(color) = color {
                    let swatch = Rect::new([x, y], [SWATCH * em; 2]);
                    self.drawing.items.push(Item::Polygon(swatch.corners(), *color));
                    let mut border = swatch.corners();
                    border.push(swatch.at);
                    let width = (0.04 * em).max(0.5);
                    self.drawing.items.push(Item::Line { points: border, width, color: [128; 3] });
                    self.extend(swatch.end());
                }
                let baseline = y + 0.5 * (SWATCH + font::CAP_HEIGHT) * em;
                self.text([x + (SWATCH + ENTRY_GAP) * em, baseline], text.clone(), style);
                widest = widest.max(font::width(text));
            }
            x += (SWATCH + ENTRY_GAP + widest + COLUMN_GAP) * em;
        }
    }

    /// Moves the key to the position `at`, and adds it to a drawing.
    pub(crate) fn place(self, at: [f64; 2], drawing: &mut Drawing) {
        let moved = |[x, y]: [f64; 2]| [x + at[0], y + at[1]];
        for mut item in self.drawing.items {
            match &mut item {
                Item::Picture(rect, _) => rect.at = moved(rect.at),
                Item::Polygon(points, _) | Item::Line { points, .. } => points.iter_mut().for_each(|p| *p = moved(*p)),
                Item::Text(text) => text.at = moved(text.at),
            }
            drawing.items.push(item);
        }
        drawing.areas.push(("key", Rect::new(at, self.size)));
    }
}

/// Returns the height, in ems, for which a key is laid out in a figure without panels.
pub(crate) fn alone(key: &Key) -> f64 {
    match key.content {
        KeyContent::Bar { .. } => 14.0,
        KeyContent::Legend(_) => 36.0,
    }
}

/// Returns the height in pixels of a colour bar next to panels of this height in pixels, within the limits of
/// [`BAR_HEIGHT`].
fn bar_height(height: f64, style: &Style) -> f64 {
    height.clamp(BAR_HEIGHT.0 * style.font, BAR_HEIGHT.1 * style.font)
}

fn tick_count(height: f64, style: &Style) -> usize {
    (height / (TICK_DISTANCE * style.font)).floor().clamp(2.0, 8.0) as usize
}
