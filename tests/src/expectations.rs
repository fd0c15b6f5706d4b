//! Table of known differences of backends from the reference, with reasons.
//!
//! An entry lets one plane of one scene exceed the tolerance on one backend and adapter, up to a factor. An entry that
//! is no longer needed is a failure, so that the table stays true.

use crate::backends::Backend;
use crate::harness::{Plane, Report, Verdict};
use surfel_render::RendererInfo;

/// Known difference of a backend from the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectation {
    /// Backend that differs.
    pub backend: Backend,
    /// Part of the adapter's name, in upper or lower case; empty for every adapter.
    pub adapter: &'static str,
    /// Full name of the scene.
    pub scene: &'static str,
    /// Plane that differs.
    pub plane: Plane,
    /// Largest error of the plane that is expected, in multiples of the tolerance; above 1.
    pub factor: f64,
    /// Reason why the difference is right or unavoidable.
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

/// All known differences.
pub const EXPECTATIONS: &[Expectation] = &[];

/// Set of scenes that were compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// All scenes, so that an entry without a matching result is unused.
    EveryScene,
    /// Some of the scenes.
    SomeScenes,
}

/// Applies a table to the results of a backend. If every scene was compared, returns a failure for each entry that
/// matches no report.
///
/// A failed report whose errors are within the limits of its entries becomes [`Verdict::Expected`]. A report that
/// didn't need its entries fails, so that the entries are removed.
pub fn apply<'a>(
    table: &[Expectation],
    info: &RendererInfo,
    extent: Extent,
    reports: impl IntoIterator<Item = &'a mut Report>,
) -> Vec<Report> {
    // If two entries are for the same place, only the first is used.
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

/// Sets the verdict of a report. `own` are the table's entries for the report, at most one per plane.
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
