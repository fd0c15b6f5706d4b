//! Random scenes on backends and on the reference.

use super::{case, shrink::shrink, store};
use crate::backends::{Backend, Session};
use crate::harness::{Report, Truth, Verdict};
use crate::scenes::Case;
use std::fmt;
use std::path::{Path, PathBuf};
use surfel_reference::Renderer as Reference;
use surfel_render::RenderError;

/// A scene that failed on a backend.
#[derive(Clone, Debug)]
pub struct Failure {
    /// The scene's number.
    pub seed: u64,
    /// Who drew it.
    pub backend: Backend,
    /// How it compares.
    pub report: Report,
    /// Where the scene file is.
    pub file: Option<PathBuf>,
    /// Where the scene file is of what was left when everything was taken out that doesn't matter.
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

/// What came of a backend.
#[derive(Clone, Debug)]
pub struct Tally {
    /// The backend.
    pub backend: Backend,
    /// Scenes that passed.
    pub passed: usize,
    /// Scenes that the backend says it doesn't draw.
    pub skipped: usize,
    /// Pixels that were off within the margin, all scenes together.
    pub forgiven: usize,
    /// Greatest error outside of the margin in a scene that passed, as a share of the tolerance, and the scene's
    /// number.
    pub worst: (f64, u64),
    /// Scenes that failed.
    pub failures: Vec<Failure>,
}

/// Backends that are held against the reference in one random scene after another.
pub struct Against {
    reference: Reference,
    sessions: Vec<(Session, Tally)>,
    keep: Option<PathBuf>,
}

impl Against {
    /// With a reference and no backend yet. Scenes that fail are written to `keep`, where that is given, whole and
    /// shrunk.
    ///
    /// # Errors
    /// [`RenderError`] if there is no reference.
    pub fn new(keep: Option<&Path>) -> Result<Self, RenderError> {
        let reference = Reference::new(Default::default())?;
        Ok(Self { reference, sessions: Vec::new(), keep: keep.map(Path::to_path_buf) })
    }

    /// Starts a backend.
    ///
    /// # Errors
    /// [`RenderError`] if it doesn't start.
    pub fn start(&mut self, backend: Backend, adapter: Option<&str>) -> Result<(), RenderError> {
        let session = Session::start(backend, adapter)?;
        let tally = Tally { backend, passed: 0, skipped: 0, forgiven: 0, worst: (0.0, 0), failures: Vec::new() };
        self.sessions.push((session, tally));
        Ok(())
    }

    /// Has all backends draw the scene of a number. Gives the failures that it added.
    ///
    /// # Errors
    /// [`surfel_io::IoError`], or the system's, if a scene that failed can't be written.
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

    /// What came of it, backend by backend.
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
