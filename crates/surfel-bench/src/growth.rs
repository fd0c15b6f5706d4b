//! Chart of the table that `cargo xtask growth` prints: the cost of conversion to levels of detail by number of points.

use crate::Failure;
use crate::chart::{Axis, Chart, Series, Style};
use std::path::PathBuf;

/// Draws the table of `cargo xtask growth` as a chart.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Page that contains the table.
    #[arg(value_name = "TABLE.md")]
    table: PathBuf,
    /// Output file of the chart; replaces an existing file.
    #[arg(short, long, value_name = "FILE.svg")]
    output: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = arguments.table.display();
    let text = std::fs::read_to_string(&arguments.table).map_err(|e| format!("could not read {path}: {e}"))?;
    let svg = chart(&text).map_err(|problem| format!("{path}: {problem}"))?.svg();
    surfel_io::atomic::write(&arguments.output, true, |out| out.write_all(svg.as_bytes()))?;
    Ok(())
}

/// Curves of the chart: name in the legend, name of the column in the table, and number of earlier columns with the
/// same name.
const DRAWN: [(&str, &str, usize); 4] = [
    ("to COPC, wall", "to COPC, s", 0),
    ("to COPC, CPU", "CPU, s", 0),
    ("whole view, CPU", "CPU, s", 1),
    ("near view, CPU", "CPU, s", 2),
];

fn chart(page: &str) -> Result<Chart, String> {
    let mut rows = page.lines().filter(|line| line.starts_with('|')).map(cells);
    let head = rows.next().filter(|head| head[0] == "million points").ok_or("has no table of growth")?;
    let numbers = |row: Vec<&str>| -> Result<Vec<f64>, String> {
        let row: Vec<f64> = row
            .iter()
            .map(|cell| cell.parse().map_err(|_| format!("'{cell}' is no number")))
            .collect::<Result<_, _>>()?;
        if row.len() == head.len() {
            Ok(row)
        } else {
            Err(format!("expected {} columns, found {}", head.len(), row.len()))
        }
    };
    let rows: Vec<Vec<f64>> = rows.skip(1).map(numbers).collect::<Result<_, _>>()?;
    let mut series = Vec::new();
    for (color, (name, title, after)) in DRAWN.into_iter().enumerate() {
        let mut named = (0..head.len()).filter(|&column| head[column] == title);
        let column = named.nth(after).ok_or_else(|| format!("has no column '{title}' {}", after + 1))?;
        let points = rows.iter().map(|row| [row[0], row[column]]).collect();
        series.push(Series::new(name, Style::Line, color, points));
    }
    // Reference line of linear growth, through the CPU time of conversion in the first row.
    if let (Some(&[from, cost]), Some(last)) = (series[1].points.first(), rows.last()) {
        let line = vec![[from, cost], [last[0], cost * last[0] / from]];
        series.push(Series::new("as many times the points", Style::Faint, 6, line));
    }
    let (x, y) = (Axis::new("million points"), Axis::new("seconds"));
    Ok(Chart { title: "Levels: time over points".into(), x, y, series, shaded: None })
}

fn cells(line: &str) -> Vec<&str> {
    line.trim().trim_matches('|').split('|').map(str::trim).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PAGE: &str = "# Growth\n\n\
        | million points | LAZ, MB | to COPC, s | CPU, s | warm, s | CPU, s | CPU, s |\n\
        | --- | --- | --- | --- | --- | --- | --- |\n\
        | 1 | 9 | 3 | 5 | 1 | 2 | 0.5 |\n| 10 | 90 | 30 | 50 | 2 | 4 | 1.5 |\n";

    #[test]
    fn columns_of_one_name_are_told_by_their_order() {
        let chart = chart(PAGE).unwrap();
        let ends: Vec<_> = chart.series.iter().map(|series| series.points[1]).collect();
        assert_eq!(ends, [[10.0, 30.0], [10.0, 50.0], [10.0, 4.0], [10.0, 1.5], [10.0, 50.0]]);
    }

    #[test]
    fn what_is_no_table_of_growth_is_refused() {
        assert_eq!(chart("words").unwrap_err(), "has no table of growth");
        assert_eq!(chart(&PAGE.replace("50", "x")).unwrap_err(), "'x' is no number");
        assert_eq!(chart(&PAGE.replace("| 10 |", "|")).unwrap_err(), "expected 7 columns, found 6");
        assert_eq!(chart(&PAGE.replace("to COPC", "to LAZ")).unwrap_err(), "has no column 'to COPC, s' 1");
    }
}
