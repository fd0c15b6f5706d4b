//! Reports of results, as a table for the terminal and as a page for the browser.

mod page;
mod table;

pub use page::page;
pub use table::table;

use crate::backends::{Backend, Run};
use crate::harness::{Report, Verdict};

/// Result of one requested backend.
pub enum Entry {
    /// The backend was compared.
    Ran(Run),
    /// The backend didn't start, and isn't required. Contains the reason.
    Absent(Backend, String),
    /// The backend didn't start, although `SURFEL_REQUIRE` names it. Contains the reason.
    Missing(Backend, String),
}

impl Entry {
    /// True unless something failed.
    pub fn is_ok(&self) -> bool {
        match self {
            Self::Ran(run) => run.is_ok(),
            Self::Absent(..) => true,
            Self::Missing(..) => false,
        }
    }

    fn backend(&self) -> &'static str {
        match self {
            Self::Ran(run) => run.info.backend,
            Self::Absent(backend, _) | Self::Missing(backend, _) => backend.name(),
        }
    }
}

/// Number of reports by verdict, and the report with the largest error.
struct Sum<'a> {
    passed: usize,
    expected: usize,
    skipped: usize,
    failed: usize,
    /// Number of outliers outside of decision margins, in all scenes.
    outliers: usize,
    /// Number of forgiven outliers, in all scenes.
    forgiven: usize,
    /// Report with the largest error; `None` if no plane was compared.
    worst: Option<&'a Report>,
}

impl<'a> Sum<'a> {
    fn of(run: &'a Run) -> Self {
        let reports = || run.checked.iter().map(|c| &c.report);
        let count = |kind: fn(&Verdict) -> bool| reports().filter(|r| kind(&r.verdict)).count();
        let worst = |report: &&Report| report.worst_plane().map_or(-1.0, |p| p.worst);
        Self {
            passed: count(|v| *v == Verdict::Passed),
            expected: count(|v| matches!(v, Verdict::Expected(_))),
            skipped: count(|v| matches!(v, Verdict::Skipped(_))),
            failed: count(|v| matches!(v, Verdict::Failed(_))),
            outliers: reports().map(Report::outliers).sum(),
            forgiven: reports().map(|r| r.forgiven).sum(),
            worst: reports().max_by(|a, b| worst(a).total_cmp(&worst(b))),
        }
    }

    fn scenes(&self) -> String {
        let some = |count: usize, word: &str| if count == 0 { String::new() } else { format!(", {count} {word}") };
        let Self { passed, expected, skipped, failed, .. } = *self;
        let rest = [some(expected, "as expected"), some(skipped, "skipped"), some(failed, "failed")];
        format!("{passed} passed{}", rest.concat())
    }
}

/// Returns the word for a verdict in reports.
pub(crate) fn word(verdict: &Verdict) -> &'static str {
    match verdict {
        Verdict::Passed => "passed",
        Verdict::Expected(_) => "as expected",
        Verdict::Skipped(_) => "skipped",
        Verdict::Failed(_) => "FAILED",
    }
}
