//! Adaptive exactness, seen: which evaluators the backend `cpu` draws splats by, and what choosing by splat saves.

use surfel::{Backend, Frame, Planes, Renderer, Stats, View};
use surfel_cpu::{Evaluation, Options, Work};
use surfel_plot::Table;

use super::measure::median;
use super::subjects::Subject;
use crate::Failure;
use crate::machine::busy_ms;

/// Counters of the renderer, and their column.
const EVALUATORS: [(&str, &str); 6] = [
    ("records_shallow", "shallow"),
    ("records_soft", "soft"),
    ("records_plain", "plain"),
    ("records_general", "general"),
    ("records_dot", "dots"),
    ("records_near", "in f64"),
];

fn start(evaluation: Evaluation, counts_evaluators: bool) -> Result<Backend, Failure> {
    let work = Work { evaluation, counts_evaluators, ..Work::default() };
    Ok(Backend::Cpu(surfel_cpu::Renderer::with_options(&Options { threads: 1, work, ..Options::default() })?))
}

/// Every subject: the share of its splats by evaluator, and the time and the difference of the picture when every splat goes to
/// the one that is right for any.
pub(crate) fn table(subjects: &[Subject], runs: usize) -> Result<Table, Failure> {
    let mut counting = start(Evaluation::Cheapest, true)?;
    let mut both = [start(Evaluation::Cheapest, false)?, start(Evaluation::General, false)?];
    let mut head = vec!["subject", "splats drawn"];
    head.extend(EVALUATORS.map(|(_, name)| name));
    head.extend(["ms, by splat", "ms, all general", "saved", "RMSE between"]);
    let mut table = Table::new(&head);
    for subject in subjects {
        let view = View::new(&subject.camera)?;
        // One upload serves all: how a scene is kept doesn't depend on how it is drawn.
        let scene = counting.upload(&subject.scene)?;
        let mut frames = [Frame::default(), Frame::default()];
        let stats = counting.render(&scene, &view, &subject.settings, Planes::COLOR, &mut frames[0])?;
        let mut times = [Vec::new(), Vec::new()];
        for _ in 0..runs {
            for ((backend, frame), times) in both.iter_mut().zip(&mut frames).zip(&mut times) {
                let (clock, busy) = (std::time::Instant::now(), busy_ms());
                backend.render(&scene, &view, &subject.settings, Planes::COLOR, frame)?;
                let elapsed = clock.elapsed().as_secs_f64() * 1e3;
                times.push(busy_ms().zip(busy).map_or(elapsed, |(end, start)| end - start));
            }
        }
        let [cheapest, general] = times.map(|t| median(&t).unwrap_or(f64::NAN));
        let counts = EVALUATORS.map(|(counter, _)| count(&stats, counter));
        let all = counts.iter().sum::<f64>().max(1.0);
        let mut row = vec![subject.name.to_owned(), stats.drawn.to_string()];
        row.extend(counts.map(|n| format!("{:.1} %", 100.0 * n / all)));
        row.extend([format!("{cheapest:.2}"), format!("{general:.2}")]);
        row.push(format!("{:.0} %", 100.0 * (1.0 - cheapest / general)));
        let [a, b] = frames.each_ref().map(|frame| frame.color.as_flattened());
        row.push(format!("{:.1e}", surfel_metrics::rmse(a, b, None)?));
        table.rows.push(row);
    }
    Ok(table)
}

fn count(stats: &Stats, name: &str) -> f64 {
    stats.counters.iter().find(|counter| counter.0 == name).map_or(0.0, |counter| counter.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tradeoff::subjects;

    #[test]
    fn splats_of_a_subject_are_counted_by_evaluator() {
        let all = subjects::all(256, true, std::path::Path::new("no such folder")).unwrap().wanted;
        let ball: Vec<Subject> = all.into_iter().filter(|s| s.name == "ball" || s.name == "needles").collect();
        let table = table(&ball, 1).unwrap();
        assert_eq!(table.rows.len(), 2);
        let share = |row: usize, column: &str| -> f64 {
            let at = table.head.iter().position(|name| name == column).unwrap();
            table.rows[row][at].trim_end_matches(" %").parse().unwrap()
        };
        for row in 0..2 {
            let sum: f64 = EVALUATORS.iter().map(|(_, name)| share(row, name)).sum();
            assert!((sum - 100.0).abs() < 0.3, "{:?}", table.rows[row]);
        }
        // Needles thinner than a pixel are all widened by the filter, and no needle is near the eye.
        assert!(share(1, "shallow") < 1.0 && share(1, "in f64") == 0.0, "{:?}", table.rows[1]);
        assert!(share(0, "shallow") > 10.0, "{:?}", table.rows[0]);
    }
}
