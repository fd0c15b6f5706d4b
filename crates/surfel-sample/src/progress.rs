//! Progress of long conversions.

/// An observer of a long conversion. Calls come from several threads.
pub trait Progress: Sync {
    /// A new stage begins, with `total` steps.
    fn stage(&self, name: &str, total: u64);

    /// `steps` more steps of the current stage are done.
    fn advance(&self, steps: u64);
}

/// An observer that ignores all.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProgress;

impl Progress for NoProgress {
    fn stage(&self, _name: &str, _total: u64) {}

    fn advance(&self, _steps: u64) {}
}
