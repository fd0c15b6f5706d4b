//! Cost and error of the innermost formulas: the kernel and the reciprocal. No option selects them. This measurement
//! shows that the formulas in use are the fastest whose error is invisible.

use std::time::Instant;

use crate::page::Table;
use surfel_cpu::formulas::{Formula, Reciprocal, Weight};

use super::measure::median;
use crate::Failure;

/// Number of values per run; few enough for the first-level cache.
const COUNT: usize = 2048;
/// Number of passes over the values per measurement of time.
const PASSES: usize = 40;
/// Number of measurements of time.
const RUNS: usize = 15;

/// Formula that is measured, with its inputs and exact values.
struct Case {
    name: &'static str,
    formula: Formula,
    inputs: Vec<f32>,
    exact: fn(f64) -> f64,
    /// Largest error of a splat's weight per unit of error of the formula. For the reciprocal 1/w, by which (u, v) is
    /// divided, a relative error changes the weight e^(−2ρ²) by at most 2/e times this error.
    per_error: f64,
    /// Reason for or against using the formula.
    verdict: &'static str,
}

/// Returns a table of every formula with its error and time.
pub(crate) fn table() -> Result<Table, Failure> {
    let cases = cases().ok_or("this CPU lacks the least instructions of the backend cpu")?;
    let mut times: Vec<Vec<f64>> = vec![Vec::new(); cases.len()];
    let mut outputs = vec![0.0; COUNT];
    for _ in 0..RUNS {
        for (case, times) in cases.iter().zip(&mut times) {
            let start = Instant::now();
            for _ in 0..PASSES {
                case.formula.apply(std::hint::black_box(&case.inputs), std::hint::black_box(&mut outputs));
            }
            times.push(start.elapsed().as_secs_f64() * 1e9 / (PASSES * COUNT) as f64);
        }
    }
    let mut table = Table::new(&["formula", "largest error", "in a weight", "ns each", "verdict"]);
    for (case, times) in cases.iter().zip(&times) {
        case.formula.apply(&case.inputs, &mut outputs);
        let pairs = case.inputs.iter().zip(&outputs);
        let error = pairs.map(|(&x, &y)| (f64::from(y) - (case.exact)(f64::from(x))).abs()).fold(0.0, f64::max);
        table.rows.push(vec![
            case.name.to_owned(),
            format!("{error:.1e}"),
            format!("{:.1e}", error * case.per_error),
            median(times).map_or_else(|| "-".to_owned(), |ns| format!("{ns:.2}")),
            case.verdict.to_owned(),
        ]);
    }
    Ok(table)
}

fn cases() -> Option<Vec<Case>> {
    let over = |low: f32, high: f32| (0..COUNT).map(|i| low + (high - low) * i as f32 / (COUNT - 1) as f32).collect();
    let weight = |name, way, verdict| {
        let (inputs, exact): (_, fn(f64) -> f64) = (over(0.0, 1.0), |x| (-2.0 * x).exp());
        Some(Case { name, formula: Formula::weight(way)?, inputs, exact, per_error: 1.0, verdict })
    };
    let reciprocal = |name, way, verdict| {
        let (inputs, exact): (_, fn(f64) -> f64) = (over(0.66, 2.01), |x| 1.0 / x);
        // The factor is for relative errors. They equal absolute errors at w = 1, which is the centre of a splat.
        let per_error = 2.0 / std::f64::consts::E;
        Some(Case { name, formula: Formula::reciprocal(way)?, inputs, exact, per_error, verdict })
    };
    [
        weight("kernel: exponential in f64, rounded", Weight::Exact, "slowest, and differs between libraries"),
        weight(
            "kernel: 2^x by bits and degree 6",
            Weight::PowerOfTwo,
            "right for any exponent, which a kernel doesn't need",
        ),
        weight("kernel: degree 5, squared", Weight::Polynomial, "used: below f32's error of ρ² in most images"),
        weight("kernel: degree 3, squared", Weight::Cubic, "would break the promise of 90 dB"),
        weight("kernel: table of 33, interpolated", Weight::Interpolated, "dominated: reads one by one"),
        weight("kernel: table of 256, nearest", Weight::Nearest, "dominated: reads one by one"),
        reciprocal("1/w: division", Reciprocal::Division, "slower, and no more accurate than its input"),
        reciprocal("1/w: linear guess, 2 steps of Halley", Reciprocal::Halley, "used: the same bits on any CPU"),
        reciprocal("1/w: linear guess, 1 step", Reciprocal::HalleyOnce, "would break the promise of 90 dB"),
        reciprocal("1/w: CPU's estimate, 1 step of Newton", Reciprocal::NewtonOnce, "differs between CPUs"),
        reciprocal("1/w: CPU's estimate", Reciprocal::Estimate, "differs between CPUs, breaks 90 dB"),
    ]
    .into_iter()
    .collect()
}
