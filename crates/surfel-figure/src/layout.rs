//! Layout of figures: positions of panels, texts, marks and keys.

use crate::drawing::{Anchor, Drawing, Item, Rect, Text};
use crate::figure::{Figure, Key, Panel, Row, Style};
use crate::keys::{self, SizedKey};
use crate::{font, marks};
use std::ops::Range;

/// Width of the empty margin around the figure, in ems of [`Style::font`].
const MARGIN: f64 = 0.8;
/// Distance between neighbouring panels, in ems.
const GAP: f64 = 0.7;
/// Distance, in ems, below a group of several rows that share a row label. It replaces [`GAP`] there.
const GROUP_GAP: f64 = 1.6;
/// Font size of the title, in ems.
const TITLE_SIZE: f64 = 1.25;
/// Height that the title takes above the panels, in ems.
const TITLE_HEIGHT: f64 = 2.4;
/// Height that a caption or a heading takes, in ems.
const CAPTION_HEIGHT: f64 = 1.7;
/// Width of the column of row labels, in ems.
const ROW_LABEL_WIDTH: f64 = 1.7;
/// Distance between the panels and the column of keys, in ems.
const KEY_GAP: f64 = 1.4;
/// Vertical distance between keys, in ems.
const KEY_DISTANCE: f64 = 1.6;
/// Smallest factor by which a text is shrunk to fit its panel or figure. A text that is still too wide ends in an
/// ellipsis.
const MIN_SIZE: f64 = 0.75;

/// Sizes of the rows and columns of a figure's panels, in pixels.
struct Grid {
    columns: Vec<f64>,
    /// Height of each row's images, and height of the captions below them.
    rows: Vec<(f64, f64)>,
    /// Upper edge of each row's images, relative to that of the first row.
    tops: Vec<f64>,
    /// Width of the column of row labels on the left; 0 if no row has a label.
    labels: f64,
}

impl Grid {
    fn of(figure: &Figure) -> Self {
        let em = figure.style.font;
        let count = figure.rows.iter().map(|row| row.panels.len()).max().unwrap_or(0);
        let mut columns = vec![0.0_f64; count];
        let mut rows = Vec::new();
        for row in &figure.rows {
            let (mut height, mut caption) = (0.0_f64, 0.0_f64);
            for (panel, width) in row.panels.iter().zip(&mut columns) {
                let Some(panel) = panel else { continue };
                *width = width.max(f64::from(panel.size[0]));
                height = height.max(f64::from(panel.size[1]));
                if panel.caption.is_some() {
                    caption = (CAPTION_HEIGHT * em).round();
                }
            }
            rows.push((height, caption));
        }
        let has_labels = figure.rows.iter().any(|row| row.label.is_some());
        let labels = if has_labels { (ROW_LABEL_WIDTH * em).round() } else { 0.0 };
        let mut tops = vec![0.0];
        for (r, (height, caption)) in rows.iter().enumerate().take(rows.len().saturating_sub(1)) {
            let ends_group = figure.group(r).len() > 1 && !figure.group(r).contains(&(r + 1));
            let gap = if ends_group { GROUP_GAP } else { GAP };
            tops.push(tops[r] + height + caption + (gap * em).round());
        }
        Self { columns, rows, tops, labels }
    }

    fn width(&self, gap: f64) -> f64 {
        self.labels + self.columns.iter().sum::<f64>() + gap * self.columns.len().saturating_sub(1) as f64
    }

    fn height(&self) -> f64 {
        let last = self.tops.last().zip(self.rows.last());
        last.map_or(0.0, |(top, (height, caption))| top + height + caption)
    }
}

impl Figure {
    /// Returns the rows that share the label of row `r`: the row that has it, and the rows without a label below it.
    /// Returns only row `r` if neither it nor a row above has a label.
    fn group(&self, r: usize) -> Range<usize> {
        let has_label = |row: &Row| row.label.is_some();
        let Some(first) = self.rows[..=r].iter().rposition(has_label) else { return r..r + 1 };
        let below = self.rows[first + 1..].iter().position(has_label);
        first..below.map_or(self.rows.len(), |more| first + 1 + more)
    }

    /// Computes the layout: the size of the figure, and the position of each panel, text, mark and key.
    pub fn layout(&self) -> Drawing {
        let (style, em) = (&self.style, self.style.font);
        let (margin, gap) = ((MARGIN * em).round(), (GAP * em).round());
        let grid = Grid::of(self);
        let mut drawing = Drawing { background: style.background, ..Drawing::default() };
        let title_height = if self.title.is_some() { (TITLE_HEIGHT * em).round() } else { 0.0 };
        let heading_height = if self.headings.is_empty() { 0.0 } else { (CAPTION_HEIGHT * em).round() };
        let origin = [margin, margin + title_height + heading_height];
        let (left, mut x) = (origin[0] + grid.labels, Vec::new());
        let mut next = left;
        for width in &grid.columns {
            x.push(next);
            next += width + gap;
        }
        for ((heading, x), width) in self.headings.iter().zip(&x).zip(&grid.columns) {
            let baseline = origin[1] - 0.5 * (CAPTION_HEIGHT - font::CAP_HEIGHT) * em;
            let text = fitted(heading, [x + 0.5 * width, baseline], *width, style);
            drawing.areas.push(("heading", text.bounds()));
            drawing.items.push(Item::Text(text));
        }
        for (r, row) in self.rows.iter().enumerate() {
            let (top, (height, _)) = (origin[1] + grid.tops[r], grid.rows[r]);
            if let Some(label) = &row.label {
                let last = self.group(r).end - 1;
                let height = grid.tops[last] + grid.rows[last].0 - grid.tops[r];
                let area = Rect::new([margin, top], [grid.labels, height]);
                let at = [margin + font::CAP_HEIGHT * em, top + 0.5 * height];
                let text = fitted(label, at, height, style);
                drawing.items.push(Item::Text(Text { is_turned: true, ..text }));
                drawing.areas.push(("row label", area));
            }
            for (c, panel) in row.panels.iter().enumerate() {
                if let Some(panel) = panel {
                    place_panel(panel, [x[c], top], [grid.columns[c], height], style, &mut drawing);
                }
            }
        }
        let panels = Rect::new(origin, [grid.width(gap), grid.height()]);
        let has_panels = !grid.columns.is_empty();
        let keys_at = if has_panels { (panels.end()[0] + KEY_GAP * em).round() } else { margin };
        self.place_keys(keys_at, origin[1], &grid, &mut drawing);
        let mut end = if has_panels { panels.end() } else { origin };
        for (_, area) in drawing.areas.iter().filter(|(name, _)| *name == "key") {
            end = [end[0].max(area.end()[0]), end[1].max(area.end()[1])];
        }
        let width = (end[0] + margin).ceil().max(f64::from(style.width.unwrap_or(1)));
        drawing.size = [width as u32, (end[1] + margin).ceil() as u32];
        if let Some(title) = &self.title {
            let middle = if has_panels { left + 0.5 * (panels.end()[0] - left) } else { 0.5 * width };
            // A title may be wider than the panels, but not than the figure.
            let room = 2.0 * (middle - margin).min(width - margin - middle);
            let baseline = margin + font::ASCENT * TITLE_SIZE * em;
            let text = fitted_at(title, [middle, baseline], room, TITLE_SIZE * em, style);
            drawing.areas.push(("title", text.bounds()));
            drawing.items.push(Item::Text(text));
        }
        drawing
    }

    /// Places the keys in a column. Each key is beside its rows, or below the previous key if that one reaches farther
    /// down.
    fn place_keys(&self, x: f64, top: f64, grid: &Grid, drawing: &mut Drawing) {
        let tops = &grid.tops;
        let em = self.style.font;
        let mut free = top;
        for key in &self.keys {
            let rows = rows_of(key, grid.rows.len());
            let first = tops.get(rows.start).copied().unwrap_or(0.0);
            let last = rows.end.saturating_sub(1);
            let end = tops.get(last).map_or(0.0, |y| y + grid.rows.get(last).map_or(0.0, |(height, _)| *height));
            let shares = self.keys.iter().filter(|other| rows_of(other, grid.rows.len()) == rows).count();
            let distance = KEY_DISTANCE * em * (shares - 1) as f64;
            let beside = ((end - first) - distance) / shares as f64;
            let height = if grid.rows.is_empty() { keys::alone(key) * em } else { beside };
            let sized = SizedKey::new(key, height, &self.style);
            let y = (top + first).max(free);
            // A key that is smaller than its rows is centred, if no other key shares the rows.
            let spare = if shares == 1 { (0.5 * (end - first - sized.size[1])).max(0.0) } else { 0.0 };
            let centred = (top + first + spare).max(y);
            free = centred + sized.size[1] + KEY_DISTANCE * em;
            sized.place([x, centred.round()], drawing);
        }
    }
}

/// Returns the range of rows beside which a key is placed, in a figure with `count` rows.
fn rows_of(key: &Key, count: usize) -> Range<usize> {
    if key.rows.is_empty() { 0..count } else { key.rows.start.min(count)..key.rows.end.min(count) }
}

/// Places a panel in the middle of its cell in the grid.
fn place_panel(panel: &Panel, at: [f64; 2], area: [f64; 2], style: &Style, drawing: &mut Drawing) {
    let size = panel.size.map(f64::from);
    let place = [(at[0] + 0.5 * (area[0] - size[0])).round(), (at[1] + 0.5 * (area[1] - size[1])).round()];
    let rect = Rect::new(place, size);
    drawing.areas.push(("panel", rect));
    if let Some(picture) = &panel.picture {
        drawing.items.push(Item::Picture(rect, picture.clone()));
    }
    marks::place(panel, rect, style, drawing);
    if let Some(caption) = &panel.caption {
        let baseline = at[1] + area[1] + 0.5 * (CAPTION_HEIGHT + font::CAP_HEIGHT) * style.font;
        let text = fitted(caption, [at[0] + 0.5 * area[0], baseline], area[0], style);
        drawing.areas.push(("caption", text.bounds()));
        drawing.items.push(Item::Text(text));
    }
}

/// Returns a centred text. If it is wider than `width` pixels, it is shrunk to 75 % at most, and then shortened.
fn fitted(text: &str, at: [f64; 2], width: f64, style: &Style) -> Text {
    fitted_at(text, at, width, style.font, style)
}

fn fitted_at(text: &str, at: [f64; 2], width: f64, size: f64, style: &Style) -> Text {
    let needed = font::width(text) * size;
    let size = if needed > width { size * (width / needed).max(MIN_SIZE) } else { size };
    let text = font::shortened(text, width / size);
    Text { text, at, size, anchor: Anchor::Middle, is_turned: false, color: style.ink(), halo: None }
}
