//! Charts of curves and labelled points over logarithmic axes, as SVG.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::prelude::*;
use std::ops::Range;

/// Size of the whole chart in pixels, including its legend.
const SIZE: (u32, u32) = (680, 340);
/// Left edge of the legend in pixels.
const LEGEND_LEFT: u32 = 484;
/// Palette of Okabe and Ito 2008, which is distinguishable with colour vision deficiencies.
const COLORS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(85, 85, 85),
    RGBColor(0, 0, 0),
];
/// Colour of grid lines.
const GRID: RGBColor = RGBColor(221, 221, 221);
/// Colour of the shaded range of a chart.
const SHADE: RGBColor = RGBColor(232, 242, 228);
/// Colour of the name of the shaded range.
const SHADE_TEXT: RGBColor = RGBColor(74, 122, 58);

/// Logarithmic axis of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Quantity along the axis, with its unit.
    pub label: String,
    /// True if large values come first. A value that isn't above 0 is drawn at the end of small values.
    pub descends: bool,
    /// Values at the two ends, both above 0; `None` fits the range to the data. Values outside of the range are drawn
    /// at its ends.
    pub range: Option<[f64; 2]>,
}

impl Axis {
    /// Creates an ascending axis whose range is fitted to the data.
    pub fn new(label: impl Into<String>) -> Self {
        Self { label: label.into(), descends: false, range: None }
    }

    /// Sets the range of the axis.
    #[must_use]
    pub fn over(self, range: [f64; 2]) -> Self {
        Self { range: Some(range), ..self }
    }

    /// Returns the range of the drawn axis: the axis's own range, or else a range that fits `values`.
    fn fit(&self, values: impl Iterator<Item = f64>) -> LogAxis {
        let values = self.range.map_or_else(|| values.collect(), |range| range.to_vec());
        let exponents = values.iter().filter(|v| v.is_finite() && **v > 0.0).map(|v| v.log10());
        let ends = exponents
            .fold(None, |ends: Option<[f64; 2]>, e| Some(ends.map_or([e, e], |[low, high]| [low.min(e), high.max(e)])));
        let [low, high] = ends.unwrap_or([0.0, 1.0]);
        // A given range is exact. A fitted range gets a margin, and a range of a single value spans a factor of two.
        let room = if self.range.is_some() { 0.0 } else { (0.04 * (high - low)).max(0.5 * (0.3 - (high - low))) };
        let (low, high) = (low - room, high + room);
        if self.descends { LogAxis { first: high, last: low } } else { LogAxis { first: low, last: high } }
    }
}

/// Range of a logarithmic axis, as decimal exponents.
#[derive(Clone, Copy, Debug)]
struct LogAxis {
    first: f64,
    last: f64,
}

impl LogAxis {
    /// Returns the values with labels: powers of ten. On short axes, multiples in between have labels, too; on long
    /// axes, only every second, fifth or later power has one.
    fn ticks(self) -> Vec<f64> {
        let (low, high) = (self.first.min(self.last), self.first.max(self.last));
        let length = high - low;
        let digits: &[u8] = match length {
            ..0.7 => &[1, 2, 3, 4, 5, 6, 7, 8, 9],
            0.7..2.0 => &[1, 2, 5],
            _ => &[1],
        };
        let step = [1, 2, 5, 10, 20, 50].into_iter().find(|&step| length <= 7.0 * f64::from(step)).unwrap_or(100);
        let exponents = (low.floor() as i32)..=(high.ceil() as i32);
        let values = exponents.filter(|e| e % step == 0).flat_map(|e| digits.iter().map(move |&d| (d, e)));
        let on_axis = |v: &f64| (low - 1e-9..=high + 1e-9).contains(&v.log10());
        values.map(|(d, e)| f64::from(d) * 10f64.powi(e)).filter(on_axis).collect()
    }
}

impl Ranged for LogAxis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let at = (value.max(0.0).log10() - self.first) / (self.last - self.first);
        limit.0 + (at.clamp(0.0, 1.0) * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks()
    }

    fn range(&self) -> Range<f64> {
        10f64.powf(self.first)..10f64.powf(self.last)
    }
}

impl ValueFormatter<f64> for LogAxis {
    fn format(value: &f64) -> String {
        match (value.log10() + 1e-9).floor() as i32 {
            0..=3 => format!("{value:.0}"),
            exponent @ -3..=-1 => format!("{value:.*}", exponent.unsigned_abs() as usize),
            _ => format!("{value:.0e}"),
        }
    }
}

/// Drawing style of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// A line with a mark at each point.
    Line,
    /// A dashed line without marks, for a bound of the other series.
    Bound,
    /// A dotted line with small marks, for a reference curve.
    Faint,
    /// Marks without lines, with optional labels.
    Points,
    /// A thin line of horizontal and vertical steps without marks, for a Pareto front.
    Steps,
}

/// Series of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend; the legend omits a series with an empty name.
    pub name: String,
    /// Drawing style.
    pub style: Style,
    /// Index of the colour in the palette, which has eight colours. From index 8 on, colours repeat and marks are
    /// squares.
    pub color: usize,
    /// Points [x, y] in drawing order. NaN interrupts the line.
    pub points: Vec<[f64; 2]>,
    /// Labels of the points, which are drawn only with [`Style::Points`]; either one per point, or none.
    pub labels: Vec<String>,
}

impl Series {
    /// Creates a series without labels.
    pub fn new(name: impl Into<String>, style: Style, color: usize, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), style, color, points, labels: Vec::new() }
    }

    fn color(&self) -> RGBColor {
        COLORS[self.color % COLORS.len()]
    }

    fn has_squares(&self) -> bool {
        self.color >= COLORS.len()
    }

    /// Returns the points without those that contain NaN, which mark gaps.
    fn places(&self) -> impl Iterator<Item = (f64, f64)> {
        self.points.iter().filter(|p| !is_gap(p)).map(|p| (p[0], p[1]))
    }
}

fn is_gap(point: &[f64; 2]) -> bool {
    point.iter().any(|v| v.is_nan())
}

/// Chart of several series.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Title above the chart.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Series, from back to front.
    pub series: Vec<Series>,
    /// Shaded range along x, with its name; `None` shades nothing.
    pub shaded: Option<([f64; 2], String)>,
}

type Drawing<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
type DrawingError<'a> = DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>;
type Plot<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<LogAxis, LogAxis>>;

/// Factor between a text height in pixels and the size that `plotters` needs for it.
const TEXT_SCALE: f64 = 1.24;

/// Returns a text style with a text height in pixels.
fn text(pixels: f64, color: RGBColor) -> TextStyle<'static> {
    ("sans-serif", pixels * TEXT_SCALE).into_font().color(&color)
}

impl Chart {
    /// Returns the chart as an SVG element of fixed size.
    ///
    /// # Panics
    /// If `plotters` can't write to a string.
    pub fn svg(&self) -> String {
        let mut svg = String::new();
        self.draw(&mut svg).expect("a string takes whatever is drawn");
        svg
    }

    fn draw<'a>(&self, svg: &'a mut String) -> Result<(), DrawingError<'a>> {
        let values = |axis: usize| self.series.iter().flat_map(move |s| s.points.iter().map(move |p| p[axis]));
        let (x, y) = (self.x.fit(values(0)), self.y.fit(values(1)));
        let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let title = ("sans-serif", 13.0 * TEXT_SCALE, FontStyle::Bold);
        let (plot_area, legend) = root.titled(&self.title, title)?.split_horizontally(LEGEND_LEFT);
        let mut plot = ChartBuilder::on(&plot_area)
            .margin(6)
            .x_label_area_size(40)
            .y_label_area_size(58)
            .build_cartesian_2d(x, y)?;
        if let Some(([from, to], name)) = &self.shaded {
            let vertical = y.range();
            plot.draw_series([Rectangle::new([(*from, vertical.start), (*to, vertical.end)], SHADE.filled())])?;
            let (left, top) = (plot.backend_coord(&(*from, 1.0)).0, plot.backend_coord(&(1.0, vertical.end)).1);
            root.draw(&Text::new(name.clone(), (left + 5, top + 4), text(10.0, SHADE_TEXT)))?;
        }
        plot.configure_mesh()
            .max_light_lines(0)
            .bold_line_style(GRID)
            .label_style(text(11.0, BLACK))
            .axis_desc_style(text(11.0, BLACK))
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .draw()?;
        for series in &self.series {
            draw_series(&mut plot, series)?;
        }
        self.label(&root, &plot)?;
        for (row, series) in self.series.iter().filter(|series| !series.name.is_empty()).enumerate() {
            draw_legend(&legend, series, 12 + 16 * row as i32)?;
        }
        root.present()
    }

    /// Draws the labels of points. Each label is at one of four sides of its point. It is omitted if at all four it
    /// would leave the plot, or overlap another label or a mark of a series of points.
    fn label<'a>(&self, root: &Drawing<'a>, plot: &Plot<'_, 'a>) -> Result<(), DrawingError<'a>> {
        let labelled = || self.series.iter().filter(|series| series.style == Style::Points);
        let place = |point: (f64, f64)| plot.backend_coord(&point);
        let mark = |(x, y): (i32, i32)| LabelBox { left: x - 4, top: y - 4, right: x + 4, bottom: y + 4 };
        let mut taken: Vec<LabelBox> = labelled().flat_map(Series::places).map(|point| mark(place(point))).collect();
        let (across, up) = plot.plotting_area().get_pixel_range();
        let whole = LabelBox { left: across.start, top: up.start, right: across.end, bottom: up.end };
        for series in labelled() {
            for (point, label) in series.points.iter().zip(&series.labels).filter(|(point, _)| !is_gap(point)) {
                let places = LabelBox::beside(place((point[0], point[1])), label.chars().count());
                let is_free = |b: &LabelBox| b.is_in(whole) && !taken.iter().any(|other| b.meets(*other));
                if let Some(free) = places.into_iter().find(is_free) {
                    root.draw(&Text::new(label.clone(), (free.left, free.top), text(9.0, BLACK)))?;
                    taken.push(free);
                }
            }
        }
        Ok(())
    }
}

/// Rectangle that a label or a mark covers, in pixels.
#[derive(Clone, Copy, Debug)]
struct LabelBox {
    left: i32,
    top: i32,
    right: i32,
    bottom: i32,
}

impl LabelBox {
    /// Returns possible rectangles of a label of `letters` characters: right of a point, left of it, above and below.
    fn beside((x, y): (i32, i32), letters: usize) -> [Self; 4] {
        // A label is nine pixels high, and 5.3 pixels wide per letter.
        let width = (5.3 * letters as f64).ceil() as i32;
        let at = |left: i32, top: i32| Self { left, top, right: left + width, bottom: top + 9 };
        [at(x + 6, y - 5), at(x - 6 - width, y - 5), at(x - width / 2, y - 14), at(x - width / 2, y + 5)]
    }

    fn is_in(self, whole: Self) -> bool {
        self.left > whole.left && self.top > whole.top && self.right < whole.right && self.bottom < whole.bottom
    }

    fn meets(self, other: Self) -> bool {
        let across = self.left < other.right && other.left < self.right;
        across && self.top < other.bottom && other.top < self.bottom
    }
}

fn draw_series<'a>(plot: &mut Plot<'_, 'a>, series: &Series) -> Result<(), DrawingError<'a>> {
    let color = series.color();
    for run in series.points.split(is_gap).filter(|run| !run.is_empty()) {
        let line: Vec<(f64, f64)> = run.iter().map(|p| (p[0], p[1])).collect();
        match series.style {
            Style::Points => {}
            Style::Line => {
                plot.draw_series([PathElement::new(line, color.stroke_width(2))])?;
            }
            Style::Bound => {
                plot.draw_series(DashedLineSeries::new(line, 6, 4, color.stroke_width(1)))?;
            }
            Style::Faint => {
                plot.draw_series(DashedLineSeries::new(line, 2, 3, color.stroke_width(1)))?;
            }
            Style::Steps => {
                let corners = line.windows(2).flat_map(|w| [(w[1].0, w[0].1), w[1]]);
                let steps: Vec<(f64, f64)> = line.first().copied().into_iter().chain(corners).collect();
                plot.draw_series([PathElement::new(steps, color.stroke_width(1))])?;
            }
        }
    }
    let radius = match series.style {
        Style::Line => 3,
        Style::Faint => 2,
        Style::Points => 4,
        Style::Bound | Style::Steps => return Ok(()),
    };
    if series.has_squares() {
        let square = |at| EmptyElement::at(at) + Rectangle::new([(-radius, -radius), (radius, radius)], color.filled());
        plot.draw_series(series.places().map(square))?;
    } else {
        plot.draw_series(series.places().map(|at| Circle::new(at, radius, color.filled())))?;
    }
    Ok(())
}

/// Draws a row of the legend. `y` is the distance from the legend's top in pixels.
fn draw_legend<'a>(legend: &Drawing<'a>, series: &Series, y: i32) -> Result<(), DrawingError<'a>> {
    let color = series.color();
    let dashes: &[(i32, i32)] = match series.style {
        Style::Points => &[],
        Style::Line | Style::Steps => &[(0, 22)],
        Style::Bound => &[(0, 6), (10, 16), (20, 22)],
        Style::Faint => &[(0, 2), (5, 7), (10, 12), (15, 17), (20, 22)],
    };
    let width = if series.style == Style::Line { 2 } else { 1 };
    for &(from, to) in dashes {
        legend.draw(&PathElement::new([(from, y), (to, y)], color.stroke_width(width)))?;
    }
    if matches!(series.style, Style::Line | Style::Points) {
        if series.has_squares() {
            legend.draw(&Rectangle::new([(8, y - 3), (14, y + 3)], color.filled()))?;
        } else {
            legend.draw(&Circle::new((11, y), 3, color.filled()))?;
        }
    }
    legend.draw(&Text::new(series.name.clone(), (28, y - 6), text(11.0, BLACK)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: Vec<[f64; 2]>) -> Chart {
        let series = vec![Series::new("a & b", Style::Line, 0, points)];
        let (x, y) = (Axis::new("parameter <px>"), Axis::new("error"));
        Chart { title: "A chart".into(), x, y, series, shaded: Some(([1.0, 10.0], "range".into())) }
    }

    fn names(axis: &Axis, values: &[f64]) -> Vec<String> {
        axis.fit(values.iter().copied()).ticks().iter().map(LogAxis::format).collect()
    }

    #[test]
    fn axis_names_round_values_that_hold_the_data() {
        let axis = Axis::new("");
        assert_eq!(names(&axis, &[0.02, 900.0]), ["0.1", "1", "10", "100", "1000"]);
        assert_eq!(names(&axis, &[1.0, 1e-4]), ["1e-4", "0.001", "0.01", "0.1", "1"]);
        assert_eq!(names(&axis, &[3.0, 30.0]), ["5", "10", "20"]);
        assert_eq!(names(&axis, &[0.034, 0.061]), ["0.04", "0.05", "0.06"]);
        assert_eq!(names(&axis, &[1e-9, 1.0]), ["1e-8", "1e-6", "1e-4", "0.01", "1"]);
    }

    #[test]
    fn axis_puts_what_it_cannot_show_at_its_ends() {
        let at = |axis: &Axis, value: f64| axis.fit([1e-8, 1.0].into_iter()).map(&value, (0, 1000));
        let up = Axis::new("");
        assert_eq!([0.0, -1.0, f64::INFINITY].map(|v| at(&up, v)), [0, 0, 1000]);
        assert!(at(&up, 1e-8) < 50 && at(&up, 1.0) > 950);
        let down = Axis { descends: true, ..up };
        assert_eq!(at(&down, 0.0), 1000);
        assert!(at(&down, 1.0) < 50 && at(&down, 1e-8) > 950);
    }

    #[test]
    fn axis_of_nothing_or_of_one_value_has_a_length() {
        assert!(names(&Axis::new(""), &[]).len() > 1);
        assert!(names(&Axis::new(""), &[5.0]).len() > 1);
    }

    #[test]
    fn chart_of_hostile_values_has_finite_coordinates() {
        let svg = chart(vec![[1.0, 0.0], [f64::INFINITY, 1.0], [10.0, f64::NAN], [1e300, f64::INFINITY]]).svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert!(!svg.contains("2147483647"), "{svg}");
    }

    #[test]
    fn chart_escapes_words_and_is_one_element() {
        let svg = chart(vec![[1.0, 1.0], [10.0, 2.0]]).svg();
        assert!(svg.contains("parameter &lt;px&gt;") && svg.contains("a &amp; b"), "{svg}");
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
    }

    #[test]
    fn labels_that_would_cover_each_other_or_a_mark_are_left_out() {
        let mut crowded = chart(vec![[1.0, 1.0], [100.0, 100.0]]);
        let points = vec![[10.0, 10.0]; 9];
        let labels = (0..9).map(|i| format!("label {i}")).collect();
        crowded.series.push(Series { labels, ..Series::new("", Style::Points, 1, points) });
        assert_eq!(crowded.svg().matches("label ").count(), 4);
        // A later series has a mark at the right of the points, where a label would be.
        crowded.series.push(Series::new("", Style::Points, 2, vec![[11.0, 10.0]]));
        assert_eq!(crowded.svg().matches("label ").count(), 3);
    }

    #[test]
    fn marks_are_squares_where_the_palette_begins_again() {
        let circles = |color| {
            let mut chart = chart(vec![]);
            chart.series = vec![Series::new("a", Style::Points, color, vec![[1.0, 1.0]])];
            chart.svg().matches("<circle").count()
        };
        assert_eq!([circles(7), circles(8)], [2, 0], "the point and the legend's");
    }

    #[test]
    fn chart_leaves_a_gap_where_nothing_was_measured() {
        let lines = |points| chart(points).svg().matches("stroke-width=\"2\"").count();
        let whole = lines(vec![[1.0, 1.0], [2.0, 1.0], [4.0, 1.0], [8.0, 2.0]]);
        assert_eq!(lines(vec![[1.0, 1.0], [2.0, f64::NAN], [4.0, 1.0], [8.0, 2.0]]), whole + 1);
    }
}
