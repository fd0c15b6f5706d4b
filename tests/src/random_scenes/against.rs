//! Comparison of backends with the reference in random scenes.

use super::{case, shrink::shrink, store};
use crate::backends::{Backend, Session};
use crate::harness::{Report, Truth, Verdict};
use crate::scenes::Case;
use std::fmt;
use std::path::{Path, PathBuf};
use surfel_reference::Renderer as Reference;
use surfel_render::RenderError;

/// Scene in which a backend differs from the reference.
#[derive(Clone, Debug)]
pub struct Failure {
    /// Seed of the scene.
    pub seed: u64,
    /// Backend that drew the scene.
    pub backend: Backend,
    /// Report of the comparison.
    pub report: Report,
    /// Path of the scene file; `None` if it wasn't written.
    pub file: Option<PathBuf>,
    /// Path of the shrunk scene's file: the smallest scene found that still fails. `None` if it wasn't written.
    pub smallest: Option<PathBuf>,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "seed {} on {}: {}", self.seed, self.backend.name(), self.report)?;
        for (what, path) in [("scene", &self.file), ("smallest part that fails", &self.smallest)] {
            if let Some(path) = path {
                write!(f, "\n  {what}: {}", path.display())?;
            }
        }
        Ok(())
    }
}

/// Counts of a backend's results.
#[derive(Clone, Debug)]
pub struct Tally {
    /// Backend that was compared.
    pub backend: Backend,
    /// Number of scenes that passed, or that differ as expected.
    pub passed: usize,
    /// Number of scenes that the backend doesn't support.
    pub skipped: usize,
    /// Number of forgiven outliers in all scenes, which are within a decision margin.
    pub forgiven: usize,
    /// Largest error outside of decision margins in scenes that passed, in multiples of the tolerance, and the seed of
    /// its scene.
    pub worst: (f64, u64),
    /// Scenes that failed.
    pub failures: Vec<Failure>,
}

/// Backends to be compared with the reference in random scenes.
pub struct ReferenceComparison {
    reference: Reference,
    sessions: Vec<(Session, Tally)>,
    keep: Option<PathBuf>,
}

impl ReferenceComparison {
    /// Creates a comparison without backends. If `keep` is given, failing scenes are written to this folder, both as
    /// they are and shrunk.
    ///
    /// # Errors
    /// [`RenderError`] if the reference doesn't start.
    pub fn new(keep: Option<&Path>) -> Result<Self, RenderError> {
        let reference = Reference::new(Default::default())?;
        Ok(Self { reference, sessions: Vec::new(), keep: keep.map(Path::to_path_buf) })
    }

    /// Starts a backend and adds it to the comparison.
    ///
    /// # Errors
    /// [`RenderError`] if the backend doesn't start.
    pub fn start(&mut self, backend: Backend, adapter: Option<&str>) -> Result<(), RenderError> {
        let session = Session::start(backend, adapter)?;
        let tally = Tally { backend, passed: 0, skipped: 0, forgiven: 0, worst: (0.0, 0), failures: Vec::new() };
        self.sessions.push((session, tally));
        Ok(())
    }

    /// Draws the scene of a seed with all backends, and compares their images with the reference's. Returns the new
    /// failures.
    ///
    /// # Errors
    /// [`surfel_io::IoError`], or the system's error, if a failing scene can't be written.
    pub fn draw(&mut self, seed: u64) -> Result<Vec<Failure>, Box<dyn std::error::Error>> {
        let truth = Truth::of(&mut self.reference, case(seed));
        let mut new = Vec::new();
        for (session, tally) in &mut self.sessions {
            let report = session.check(&truth).report;
            tally.forgiven += report.forgiven;
            match report.verdict {
                Verdict::Skipped(_) => tally.skipped += 1,
                Verdict::Passed | Verdict::Expected(_) => {
                    tally.passed += 1;
                    let worst = report.worst_plane().map_or(0.0, |p| p.worst);
                    if worst > tally.worst.0 {
                        tally.worst = (worst, seed);
                    }
                }
                Verdict::Failed(_) => {
                    let mut failure = Failure { seed, backend: tally.backend, report, file: None, smallest: None };
                    if let Some(folder) = &self.keep {
                        let folder = store::folder(folder)?;
                        failure.file = Some(store::store(&truth.case, folder)?);
                        let reference = &mut self.reference;
                        let fails = |case: &Case| {
                            let truth = Truth::of(reference, case.clone());
                            truth.want.is_ok() && !session.check(&truth).report.is_ok()
                        };
                        let mut smallest = shrink(&truth.case, fails);
                        smallest.name = format!("{}-{}-smallest", truth.case.name, tally.backend.name());
                        failure.smallest = Some(store::store(&smallest, folder)?);
                    }
                    tally.failures.push(failure.clone());
                    new.push(failure);
                }
            }
        }
        Ok(new)
    }

    /// Returns the counts of each backend.
    pub fn tallies(&self) -> impl Iterator<Item = &Tally> {
        self.sessions.iter().map(|(_, tally)| tally)
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { passed, skipped, forgiven, worst: (worst, seed), .. } = self;
        write!(f, "{}: {passed} passed, {skipped} skipped, {} failed", self.backend.name(), self.failures.len())?;
        write!(f, "; worst {worst:.3} of the tolerance (seed {seed}), {forgiven} pixels forgiven")
    }
}
