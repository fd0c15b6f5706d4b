//! Reports of sweeps as a table and as a page.

use super::{Outcome, Point, Sweep, first_break};
use surfel_bench::chart::{Axis, Chart, Series, Style};
use surfel_bench::page::{Page, Table};

/// Sweep with the results of all backends.
pub struct Measured {
    /// Sweep that was run.
    pub sweep: Sweep,
    /// One outcome per backend.
    pub outcomes: Vec<Outcome>,
    /// Pairs of value and error of the published formula; the error is NaN without a formula.
    pub naive: Vec<[f64; 2]>,
}

impl Measured {
    /// Returns the faults of the backend with index `backend` within the sweep's required range.
    pub fn faults(&self, backend: usize) -> Vec<String> {
        let points = self.outcomes.get(backend).map_or(&[][..], |outcome| &outcome.points);
        let required = points.iter().filter(|point| self.sweep.requires(point.value));
        let say = |p: &Point| Some(format!("{} at {:e}: {}", self.sweep.name, p.value, p.fault()?));
        required.filter_map(say).collect()
    }
}

/// Returns a table with the first faulty value of each backend, by sweep.
pub fn breaks(measured: &[Measured], backends: &[String]) -> Table {
    let mut head = vec!["sweep", "parameter", "required to", "swept to"];
    head.extend(backends.iter().map(String::as_str));
    head.push("formula replaced: first error above 0.1");
    let mut table = Table::new(&head);
    for one in measured {
        let Sweep { name, parameter, required, values, .. } = &one.sweep;
        let mut row = vec![(*name).to_owned(), (*parameter).to_owned(), number(*required)];
        row.push(values.last().map_or_else(String::new, |&v| number(v)));
        let mut is_ok = true;
        for (index, outcome) in one.outcomes.iter().enumerate() {
            is_ok &= one.faults(index).is_empty();
            row.push(match first_break(outcome) {
                None if outcome.points.iter().any(|point| point.unsupported) => "not drawn".to_owned(),
                None => "nowhere".to_owned(),
                Some(point) => format!("{}: {}", number(point.value), point.fault().unwrap_or_default()),
            });
        }
        let far = one.naive.iter().find(|[_, error]| *error > 0.1);
        let none = one.naive.iter().all(|[_, error]| error.is_nan());
        row.push(match far {
            Some([value, _]) => number(*value),
            None if none => "-".to_owned(),
            None => "nowhere".to_owned(),
        });
        table.marked.push((table.rows.len(), is_ok));
        table.rows.push(row);
    }
    table
}

/// Returns a self-contained page with all sweeps, their first faults, and a chart of each sweep.
pub fn page(measured: &[Measured], backends: &[String]) -> String {
    let mut page = Page::new("Numerical stability");
    page.paragraph(
        "Surfel draws surfaces as overlapping disks. Each sweep takes one image and drives one of its numbers from \
         where nothing is difficult to where arithmetic fails: disks seen from their edge, sizes from atoms to \
         galaxies, cameras a billion units from the origin. The curves show how far each backend's image is off; what \
         it should be is computed in exact arithmetic (whole numbers of any length) where a sweep has a single splat, \
         and by the f64 reference else.",
    );
    page.paragraph(
        "Dashed lines are bounds that follow from the number of roundings, not from the measurement; an error above \
         its bound is a fault, as is a pixel that is not finite, and one that is covered and shouldn't be, or the \
         other way round, unless the exact result is within 1e-3 pixels or 1e-4 of the decision. Where a bound passes \
         1, weights may be anything: the image can't be had in that precision. The green range is what has to work. \
         Dotted curves are the formulas as published, in f32. An error of 0, or one below the chart, lies on its lower \
         edge; a gap means that no pixel was covered, and where the reference is the truth it has no curve.",
    );
    page.section("The first value at which anything breaks");
    page.table(&breaks(measured, backends));
    page.section("Curves");
    for one in measured {
        page.heading(one.sweep.name);
        page.paragraph(one.sweep.about);
        page.chart(&chart(one, backends));
        page.paragraph(&format!("Bound: {}.", one.sweep.law));
        if !one.sweep.naive.is_empty() {
            page.paragraph(&format!("Compared with: {}.", one.sweep.naive));
        }
    }
    page.html()
}

fn chart(one: &Measured, backends: &[String]) -> Chart {
    let values = &one.sweep.values;
    let [first, last] = [values.first(), values.last()].map(|v| v.copied().unwrap_or(1.0));
    let mut series = Vec::new();
    // An empty curve isn't listed in the legend.
    let mut add = |name: String, style, color, points: Vec<[f64; 2]>| {
        if points.iter().any(|[_, error]| !error.is_nan()) {
            series.push(Series::new(name, style, color, points));
        }
    };
    for (index, (outcome, name)) in one.outcomes.iter().zip(backends).enumerate() {
        let bound = |p: &Point| [p.value, if p.error.is_nan() || p.bound == 0.0 { f64::NAN } else { p.bound }];
        add(format!("{name}, bound"), Style::Bound, index, outcome.points.iter().map(bound).collect());
    }
    add("as published, f32".to_owned(), Style::Faint, 6, one.naive.clone());
    for (index, (outcome, name)) in one.outcomes.iter().zip(backends).enumerate() {
        add(name.clone(), Style::Line, index, outcome.points.iter().map(|p| [p.value, p.error]).collect());
    }
    let required = if (last < first) == (one.sweep.required < last) { last } else { one.sweep.required };
    Chart {
        title: format!("{}: error against {}", one.sweep.name, one.sweep.parameter),
        x: Axis { descends: last < first, ..Axis::new(one.sweep.parameter) },
        y: Axis::new(measure(one.sweep.measure)).over([1e-10, 1.0]),
        series,
        shaded: Some(([first, required], "has to work".to_owned())),
    }
}

fn measure(measure: super::Measure) -> &'static str {
    match measure {
        super::Measure::Weight => "largest error of a weight (1 = a splat's whole)",
        super::Measure::Depth => "largest relative error of depth",
        super::Measure::Color => "largest error of a colour",
        super::Measure::Coverage => "share of pixels on the wrong side",
    }
}

/// Formats a value of a parameter briefly.
fn number(value: f64) -> String {
    if (0.01..1e5).contains(&value.abs()) {
        format!("{}", (value * 100.0).round() / 100.0)
    } else {
        format!("{value:.0e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(error: f64) -> Measured {
        let sweep = super::super::sweeps().remove(0);
        let point = |&value: &f64| Point { value, error, bound: 0.5, compared: 1, ..Point::default() };
        let points = sweep.values.iter().map(point).collect();
        let naive = sweep.values.iter().map(|&v| [v, f64::NAN]).collect();
        Measured { sweep, outcomes: vec![Outcome { points }], naive }
    }

    #[test]
    fn table_names_the_first_value_that_breaks() {
        let backends = ["cpu".to_owned()];
        assert_eq!(breaks(&[measured(0.1)], &backends).rows[0][4], "nowhere");
        let broken = breaks(&[measured(0.6)], &backends);
        assert!(broken.rows[0][4].starts_with("90: error 6.0e-1"), "{:?}", broken.rows);
        assert_eq!(broken.marked, [(0, false)]);
    }

    #[test]
    fn page_has_a_chart_for_every_sweep() {
        let html = page(&[measured(0.1), measured(f64::NAN)], &["cpu".to_owned()]);
        assert_eq!(html.matches("<svg").count(), 2);
        assert!(!html.contains("NaN"));
    }
}
