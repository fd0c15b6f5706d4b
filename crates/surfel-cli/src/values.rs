//! Thresholds of `surfel compare`.

/// Threshold of a metric above (or below) which `surfel compare` fails.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Threshold {
    pub(crate) metric: &'static str,
    pub(crate) value: f64,
}

/// Names of the metrics for which thresholds may be given, as `surfel compare` prints them.
pub(crate) const METRICS: [&str; 4] = ["max_abs", "rmse", "psnr", "flip"];

pub(crate) fn threshold(text: &str) -> Result<Threshold, String> {
    let wrong = || format!("expected METRIC=V, METRIC one of {}, V a number", METRICS.join(", "));
    let (name, value) = text.split_once('=').ok_or_else(wrong)?;
    let name = name.trim().to_ascii_lowercase().replace('-', "_");
    let metric = METRICS.into_iter().find(|m| *m == name).ok_or_else(wrong)?;
    let value = value.trim().parse::<f64>().ok().filter(|v| !v.is_nan()).ok_or_else(wrong)?;
    Ok(Threshold { metric, value })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_out_of_range_are_refused() {
        for bad in ["rmse", "rmse=x", "ssim=1", "rmse=nan"] {
            assert!(threshold(bad).is_err(), "{bad}");
        }
        assert_eq!(threshold("max-abs=0.1").unwrap().metric, "max_abs");
    }
}
