//! A chart, drawn as SVG.

use crate::axis::{Axis, Fitted};
use crate::page::escape;
use std::fmt::Write;

/// Of the whole picture, in SVG's units.
const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 340.0;
/// Left, top, right and bottom of the plotted area.
const AREA: [f64; 4] = [64.0, 34.0, 476.0, 292.0];
/// Told apart also by those who don't see all colours alike (Okabe and Ito 2008).
const COLORS: [&str; 8] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#555555", "#000000"];

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// A line with a mark at each point.
    Line,
    /// A dashed line without marks: a bound.
    Bound,
    /// A thin, dotted line with small marks: what is compared with.
    Faint,
    /// Marks alone, each with its label where it has one.
    Points,
    /// A thin line without marks, right then up or down: a Pareto front.
    Steps,
}

/// A series of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Its name in the legend; none, and it has no line there.
    pub name: String,
    /// How it is drawn.
    pub style: Style,
    /// Index of its colour; the palette has eight, and from the ninth on marks are squares.
    pub color: usize,
    /// Points in order. A NaN leaves a gap.
    pub points: Vec<[f64; 2]>,
    /// Labels of points; as many as points, or none.
    pub labels: Vec<String>,
}

impl Series {
    /// A series without labels.
    pub fn new(name: impl Into<String>, style: Style, color: usize, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), style, color, points, labels: Vec::new() }
    }
}

/// A chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Above it.
    pub title: String,
    /// Across.
    pub x: Axis,
    /// Up.
    pub y: Axis,
    /// What is drawn, from back to front.
    pub series: Vec<Series>,
    /// A range along x that is shaded, with its name.
    pub shaded: Option<([f64; 2], String)>,
}

impl Chart {
    /// The chart as an SVG element with a size of its own.
    pub fn svg(&self) -> String {
        let values = |axis: usize| self.series.iter().flat_map(move |s| s.points.iter().map(move |p| p[axis]));
        let (x, y) = (self.x.fit(values(0)), self.y.fit(values(1)));
        let mut svg = String::new();
        // Writing to a string can't fail, here and below.
        let _ = write!(
            svg,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{HEIGHT}\" \
             viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" font-size=\"11\" role=\"img\">\
             <title>{0}</title><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\
             <text x=\"{1}\" y=\"18\" font-size=\"13\" font-weight=\"bold\">{0}</text>",
            escape(&self.title),
            AREA[0]
        );
        self.shade(&mut svg, &x);
        self.frame(&mut svg, &x, &y);
        // Labels come last, beside all marks.
        let mut taken = Vec::new();
        for series in &self.series {
            draw(&mut svg, series, &x, &y, &mut taken);
        }
        for series in self.series.iter().filter(|series| !series.labels.is_empty()) {
            label(&mut svg, series, &x, &y, &mut taken);
        }
        self.legend(&mut svg);
        svg.push_str("</svg>");
        svg
    }

    fn shade(&self, svg: &mut String, x: &Fitted) {
        let Some((range, name)) = &self.shaded else { return };
        let [a, b] = range.map(|v| across(x.at(v)));
        let (left, right) = (a.min(b), a.max(b));
        let _ = write!(
            svg,
            "<rect x=\"{left:.1}\" y=\"{}\" width=\"{:.1}\" height=\"{}\" fill=\"#e8f2e4\"/>\
             <text x=\"{:.1}\" y=\"{}\" fill=\"#4a7a3a\" font-size=\"10\">{}</text>",
            AREA[1],
            right - left,
            AREA[3] - AREA[1],
            left + 4.0,
            AREA[1] + 12.0,
            escape(name)
        );
    }

    fn frame(&self, svg: &mut String, x: &Fitted, y: &Fitted) {
        let [left, top, right, bottom] = AREA;
        for (at, name) in x.ticks() {
            let at = across(at);
            let _ = write!(
                svg,
                "<path d=\"M{at:.1} {top}V{bottom}\" stroke=\"#ddd\"/>\
                 <text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{name}</text>",
                bottom + 15.0
            );
        }
        for (at, name) in y.ticks() {
            let at = up(at);
            let _ = write!(
                svg,
                "<path d=\"M{left} {at:.1}H{right}\" stroke=\"#ddd\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{name}</text>",
                left - 5.0,
                at + 4.0
            );
        }
        let _ = write!(
            svg,
            "<rect x=\"{left}\" y=\"{top}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#333\"/>\
             <text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>\
             <text transform=\"translate(14 {}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            right - left,
            bottom - top,
            0.5 * (left + right),
            bottom + 34.0,
            escape(&self.x.label),
            0.5 * (top + bottom),
            escape(&self.y.label)
        );
    }

    fn legend(&self, svg: &mut String) {
        let named = self.series.iter().filter(|series| !series.name.is_empty());
        for (row, series) in named.enumerate() {
            let (x, y) = (AREA[2] + 12.0, AREA[1] + 8.0 + 16.0 * row as f64);
            let color = color(series);
            match series.style {
                Style::Points => mark(svg, series, [x + 11.0, y], 3.5),
                style => {
                    let _ = write!(svg, "<path d=\"M{x} {y}h22\" {}/>", stroke(style, color));
                    if matches!(style, Style::Line) {
                        mark(svg, series, [x + 11.0, y], 2.5);
                    }
                }
            }
            let _ = write!(svg, "<text x=\"{}\" y=\"{}\">{}</text>", x + 28.0, y + 4.0, escape(&series.name));
        }
    }
}

fn across(at: f64) -> f64 {
    AREA[0] + at * (AREA[2] - AREA[0])
}

fn up(at: f64) -> f64 {
    AREA[3] - at * (AREA[3] - AREA[1])
}

fn color(series: &Series) -> &'static str {
    COLORS[series.color % COLORS.len()]
}

fn stroke(style: Style, color: &str) -> String {
    let look = match style {
        Style::Line | Style::Points => "stroke-width=\"1.8\"",
        Style::Bound => "stroke-width=\"1.5\" stroke-dasharray=\"6 4\"",
        Style::Faint => "stroke-width=\"1.2\" stroke-dasharray=\"2 3\"",
        Style::Steps => "stroke-width=\"1\"",
    };
    format!("fill=\"none\" stroke=\"{color}\" {look}")
}

/// A disk, or a square where the palette has begun anew.
fn mark(svg: &mut String, series: &Series, [x, y]: [f64; 2], radius: f64) {
    let color = color(series);
    let _ = if series.color < COLORS.len() {
        write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{color}\"/>")
    } else {
        let (left, top, side) = (x - radius, y - radius, 2.0 * radius);
        write!(svg, "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{side}\" height=\"{side}\" fill=\"{color}\"/>")
    };
}

/// Left, top, right and bottom of a label.
type Rectangle = [f64; 4];

/// Draws a series without its labels, which have to keep clear of marks that have some.
fn draw(svg: &mut String, series: &Series, x: &Fitted, y: &Fitted, taken: &mut Vec<Rectangle>) {
    let color = color(series);
    if series.style != Style::Points {
        let mut path = String::new();
        let mut pen = false;
        for [px, py] in &series.points {
            if px.is_nan() || py.is_nan() {
                pen = false;
                continue;
            }
            let (px, py) = (across(x.at(*px)), up(y.at(*py)));
            let _ = match (pen, series.style) {
                (false, _) => write!(path, "M{px:.1} {py:.1}"),
                (true, Style::Steps) => write!(path, "H{px:.1}V{py:.1}"),
                (true, _) => write!(path, "L{px:.1} {py:.1}"),
            };
            pen = true;
        }
        let _ = write!(svg, "<path d=\"{path}\" {}/>", stroke(series.style, color));
    }
    let radius = match series.style {
        Style::Line => 2.5,
        Style::Faint => 1.5,
        Style::Points => 3.5,
        Style::Bound | Style::Steps => return,
    };
    for [px, py] in series.points.iter().filter(|[px, py]| !px.is_nan() && !py.is_nan()) {
        let (px, py) = (across(x.at(*px)), up(y.at(*py)));
        mark(svg, series, [px, py], radius);
        if series.style == Style::Points {
            taken.push([px - radius, py - radius, px + radius, py + radius]);
        }
    }
}

/// Writes the labels of a series where there is room.
fn label(svg: &mut String, series: &Series, x: &Fitted, y: &Fitted, taken: &mut Vec<Rectangle>) {
    for ([px, py], label) in series.points.iter().zip(&series.labels) {
        if !px.is_nan() && !py.is_nan() {
            write_label(svg, label, [across(x.at(*px)), up(y.at(*py))], taken);
        }
    }
}

/// Writes a label right or left of a point, above or below; nowhere if all of that is taken.
fn write_label(svg: &mut String, label: &str, [x, y]: [f64; 2], taken: &mut Vec<Rectangle>) {
    // Nine units high, a little more than five wide a letter.
    let width = 5.3 * label.chars().count() as f64;
    let places = [(6.0, 3.0), (-6.0 - width, 3.0), (-0.5 * width, -6.0), (-0.5 * width, 13.0)];
    let rectangle = |(dx, dy): (f64, f64)| [x + dx, y + dy - 8.0, x + dx + width, y + dy + 1.0];
    let is_free = |r: &Rectangle| {
        let inside = r[0] > AREA[0] && r[1] > AREA[1] && r[2] < AREA[2] && r[3] < AREA[3];
        inside && !taken.iter().any(|t| r[0] < t[2] && t[0] < r[2] && r[1] < t[3] && t[1] < r[3])
    };
    if let Some(free) = places.into_iter().map(rectangle).find(is_free) {
        let _ = write!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" font-size=\"9\" paint-order=\"stroke\" stroke=\"#fff\" stroke-width=\"2.5\">{}</text>",
            free[0],
            free[3] - 1.0,
            escape(label)
        );
        taken.push(free);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scale;

    fn chart(points: Vec<[f64; 2]>) -> Chart {
        let (x, y) = (Axis::new("parameter <px>", Scale::Log), Axis::new("error", Scale::Log));
        let series = vec![Series::new("a & b", Style::Line, 0, points)];
        Chart { title: "A chart".into(), x, y, series, shaded: Some(([1.0, 10.0], "range".into())) }
    }

    #[test]
    fn chart_of_hostile_values_has_finite_coordinates() {
        let svg = chart(vec![[1.0, 0.0], [f64::INFINITY, 1.0], [10.0, f64::NAN], [1e300, f64::INFINITY]]).svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }

    #[test]
    fn chart_escapes_words_and_closes_what_it_opens() {
        let svg = chart(vec![[1.0, 1.0], [10.0, 2.0]]).svg();
        assert!(svg.contains("parameter &lt;px&gt;") && svg.contains("a &amp; b"));
        assert_eq!(svg.matches("<text").count(), svg.matches("</text>").count());
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>"));
    }

    #[test]
    fn labels_that_would_cover_each_other_or_a_mark_are_left_out() {
        let mut crowded = chart(vec![[1.0, 1.0], [100.0, 100.0]]);
        let points = vec![[10.0, 10.0]; 9];
        let labels = (0..9).map(|i| format!("label {i}")).collect();
        crowded.series.push(Series { labels, ..Series::new("", Style::Points, 1, points) });
        assert_eq!(crowded.svg().matches("label ").count(), 4);
        // A mark to the right of them, which comes later, takes that place.
        crowded.series.push(Series::new("", Style::Points, 2, vec![[11.0, 10.0]]));
        assert_eq!(crowded.svg().matches("label ").count(), 3);
    }

    #[test]
    fn marks_are_squares_where_the_palette_begins_anew() {
        let of = |color| {
            let mut chart = chart(vec![]);
            chart.series = vec![Series::new("a", Style::Points, color, vec![[1.0, 1.0]])];
            chart.svg()
        };
        assert_eq!(of(7).matches("<circle").count(), 2, "the point and the legend's");
        assert_eq!(of(8).matches("<circle").count(), 0);
    }

    #[test]
    fn chart_leaves_a_gap_where_nothing_was_measured() {
        let svg = chart(vec![[1.0, 1.0], [2.0, f64::NAN], [4.0, 1.0], [8.0, 2.0]]).svg();
        let path = svg.split("d=\"").find(|d| d.matches('M').count() == 2);
        assert!(path.is_some(), "{svg}");
    }
}
