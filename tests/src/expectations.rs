//! What backends are known to miss, and why.
//!
//! An entry lets one plane of one scene be off by more than the tolerance on one backend and adapter, up to a factor.
//! It fails when it isn't needed any more, so that the table says what is so.

use crate::backends::Backend;
use crate::harness::{Plane, Report, Verdict};
use surfel_render::RendererInfo;

/// A known difference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectation {
    /// Who is off.
    pub backend: Backend,
    /// Part of the adapter's name, any case; empty for every adapter.
    pub adapter: &'static str,
    /// The scene's whole name.
    pub scene: &'static str,
    /// The plane.
    pub plane: Plane,
    /// How far it may be off, as a multiple of the tolerance: above 1.
    pub factor: f64,
    /// Why that is right, or nothing to be done about.
    pub because: &'static str,
}

impl Expectation {
    fn is_about(&self, info: &RendererInfo) -> bool {
        self.backend.name() == info.backend && info.adapter.to_lowercase().contains(&self.adapter.to_lowercase())
    }

    fn place(&self) -> String {
        format!("{} on '{}', {}, plane {}", self.backend.name(), self.adapter, self.scene, self.plane.name())
    }
}

/// Every known difference. None so far.
pub const EXPECTATIONS: &[Expectation] = &[];

/// Which scenes were compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// All of them: an entry of which nothing was seen is unused.
    EveryScene,
    /// Some of them.
    SomeScenes,
}

/// Applies a table to what was found on a backend, and gives a failure for each entry that nothing needs.
///
/// A report that failed only in what entries allow becomes [`Verdict::Expected`]. One that needed none of its entries
/// fails: the entry is to be removed.
pub fn apply<'a>(
    table: &[Expectation],
    info: &RendererInfo,
    extent: Extent,
    reports: impl IntoIterator<Item = &'a mut Report>,
) -> Vec<Report> {
    // The first of two entries about the same is used, the second is not.
    let mut open: Vec<&Expectation> = table.iter().filter(|entry| entry.is_about(info)).collect();
    for report in reports {
        let mut own: Vec<&Expectation> = Vec::new();
        open.retain(|entry| {
            let plane = report.planes.iter().any(|p| p.plane == entry.plane);
            let takes = entry.scene == report.name && plane && !own.iter().any(|o| o.plane == entry.plane);
            if takes {
                own.push(entry);
            }
            !takes
        });
        if !own.is_empty() {
            judge(report, &own);
        }
    }
    let unused = |entry: &&Expectation| {
        let message = format!("no image of {}: correct the entry of expectations.rs or remove it", entry.place());
        Report::failed("expectations", message)
    };
    if extent == Extent::EveryScene { open.iter().map(unused).collect() } else { Vec::new() }
}

/// The verdict on a report, all of whose entries are `own`, one a plane.
fn judge(report: &mut Report, own: &[&Expectation]) {
    let worst = |plane| report.planes.iter().find(|p| p.plane == plane).map_or(0.0, |p| p.worst);
    let factor = |plane| own.iter().find(|entry| entry.plane == plane).map_or(1.0, |entry| entry.factor);
    let mut faults = report.faults(factor);
    for entry in own.iter().filter(|entry| worst(entry.plane) <= 1.0) {
        let place = entry.place();
        faults.push(format!("{place}, is within tolerance: remove the entry of expectations.rs, it passes without"));
    }
    let because: Vec<&str> = own.iter().map(|entry| entry.because).collect();
    report.verdict =
        if faults.is_empty() { Verdict::Expected(because.join("; ")) } else { Verdict::Failed(faults.join("; ")) };
}
