//! Comparison of the reports of two runs.

use crate::Failure;
use crate::report::{Report, median, quantile};
use crate::table::aligned;

/// Returns a table with the ratios of B to A: medians, their noise, and minima. Only scenes and numbers of threads that
/// both runs have are compared.
///
/// The table compares CPU times if both runs have them, since other work on the machine affects CPU time little.
/// Otherwise it compares wall-clock times.
pub(crate) fn table(a: &Report, b: &Report) -> Result<String, Failure> {
    let cells = |cells: [&str; 8]| cells.map(str::to_owned).to_vec();
    let mut lines = vec![cells(["scene", "thr", "A ms", "B ms", "B / A", "noise", "least", ""])];
    for row in &a.rows {
        let same = |other: &&crate::report::Row| other.scene == row.scene && other.threads == row.threads;
        let Some(other) = b.rows.iter().find(same) else { continue };
        let (of_a, of_b) = match (row.busy_frames_ms.as_slice(), other.busy_frames_ms.as_slice()) {
            ([], _) | (_, []) => (&row.frames_ms, &other.frames_ms),
            _ => (&row.busy_frames_ms, &other.busy_frames_ms),
        };
        let ratio = median(of_b) / median(of_a);
        let noise = 2.0 * standard_error(of_a).hypot(standard_error(of_b));
        let verdict = match ratio - 1.0 {
            change if change.abs() <= noise || noise.is_nan() => "within noise",
            change if change > 0.0 => "slower",
            _ => "faster",
        };
        lines.push(vec![
            row.scene.clone(),
            row.threads.to_string(),
            format!("{:.2}", median(of_a)),
            format!("{:.2}", median(of_b)),
            format!("{ratio:.3}"),
            format!("±{noise:.3}"),
            format!("{:.3}", least(of_b) / least(of_a)),
            verdict.to_owned(),
        ]);
    }
    if lines.len() == 1 {
        return Err("the two files have no scene and thread count in common".into());
    }
    let name = |r: &Report| {
        format!("{} on {} ({}), commit {}", r.backend.name, r.machine.cpu, r.backend.adapter, r.machine.commit)
    };
    let mut text = format!("A  {}\nB  {}\n\n{}", name(a), name(b), aligned(&lines));
    if a.machine.cpu != b.machine.cpu {
        text += "The machines differ: the ratios compare them too.\n";
    }
    Ok(text)
}

/// Returns the time of the least disturbed frame, which is the minimum.
fn least(frames_ms: &[f64]) -> f64 {
    frames_ms.iter().copied().fold(f64::INFINITY, f64::min)
}

/// Returns the standard error of a median, relative to the median: 1.2533·σ/√n, or NaN for fewer than two frames. σ is
/// computed from the quartiles, so that a few disturbed frames have no effect. Both constants are those of the normal
/// distribution. A disturbance of the whole run isn't included.
fn standard_error(frames_ms: &[f64]) -> f64 {
    if frames_ms.len() < 2 {
        return f64::NAN;
    }
    let sigma = (quantile(frames_ms, 0.75) - quantile(frames_ms, 0.25)) / 1.349;
    1.2533 * sigma / (frames_ms.len() as f64).sqrt() / median(frames_ms)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_falls_with_runs_and_ignores_an_outlier() {
        let steady: Vec<f64> = (0..16).map(|i| 10.0 + f64::from(i % 4) * 0.1).collect();
        let mut disturbed = steady.clone();
        disturbed[3] = 500.0;
        let few = standard_error(&steady[..4]);
        assert!(standard_error(&steady) < few);
        assert!(standard_error(&disturbed) < 2.0 * standard_error(&steady));
        assert!(standard_error(&[1.0]).is_nan());
    }
}
