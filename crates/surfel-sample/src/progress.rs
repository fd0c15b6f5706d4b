//! Progress of long conversions.

/// Observer of a long conversion. Several threads call it.
pub trait Progress: Sync {
    /// Reports that a new stage with `total` steps begins.
    fn stage(&self, name: &str, total: u64);

    /// Reports `steps` finished steps of the current stage.
    fn advance(&self, steps: u64);
}

/// Observer that ignores all reports.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn stage(&self, _name: &str, _total: u64) {}

    fn advance(&self, _steps: u64) {}
}
