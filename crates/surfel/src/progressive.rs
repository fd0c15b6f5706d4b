//! Scenes that get finer: a coarse one soon, and then the whole.

use crate::request::{Request, Resolved};
use crate::{Error, levels};
use std::sync::Arc;
use surfel_sample::Progress;

/// Points of the coarsest scene, of each file.
pub const FIRST_POINTS: u32 = 100_000;
/// Coarse scenes of files with levels.
const STEPS: u32 = 2;

/// How much of its files a scene shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// A part, and a finer scene follows.
    Coarse,
    /// What the request asks for: this is the last.
    Full,
}

/// Loads and resolves a request as scenes that get finer, and hands over each when it is there, the full one last: the
/// same as [`Request::load`] and [`Request::resolve`] give. `note` is told what concerns that.
///
/// Where files have levels (COPC), two coarse scenes come before it, of 1/64 and 1/16 of its points at most, but not
/// fewer than [`FIRST_POINTS`], and of splats up to 16 and 4 times as large; all have the same camera. Where none has,
/// scans of more than [`FIRST_POINTS`] are read twice: so many of each, evenly chosen, are one coarse scene, with the
/// camera that they are framed by. Anything else comes once.
///
/// ```no_run
/// # fn main() -> Result<(), surfel::Error> {
/// use surfel::{NoProgress, Renderer, progressive, request};
/// let source = request::Source::of(&["scan.copc.laz".into()], None)?;
/// let request = request::Request::new(source, &request::Pictures::One, &Default::default())?;
/// let mut backend = surfel::Backend::auto()?;
/// progressive::resolve(request, None, &NoProgress, &mut |_| (), &mut |resolved, detail| {
///     let resident = backend.upload(&resolved.scene)?;
///     let frame = backend.render(&resident, &resolved.file.camera, &resolved.file.settings)?;
///     println!("{detail:?}: {} pixels", frame.color().len());
///     Ok::<_, surfel::Error>(())
/// })
/// # }
/// ```
///
/// # Errors
/// As [`Request::load`] and [`Request::resolve`]; those of `each`, which end it.
pub fn resolve<E: From<Error>>(
    request: Request,
    stdin: Option<Arc<[u8]>>,
    progress: &dyn Progress,
    note: &mut dyn FnMut(String),
    each: &mut dyn FnMut(Resolved, Detail) -> Result<(), E>,
) -> Result<(), E> {
    let has_levels = request.files().any(|path| levels::has_levels(&path));
    let mut loaded;
    if has_levels {
        loaded = request.load(stdin, progress)?;
        if loaded.facts.iter().any(|facts| facts.partial) {
            for step in (1..=STEPS).rev() {
                let fewer = |most: Option<u32>| {
                    let most = most.unwrap_or(levels::DEFAULT_MOST_POINTS as u32);
                    (most >> (2 * (step + 1))).max(FIRST_POINTS).min(most)
                };
                let coarse = request.coarser(fewer, f64::from(1 << (2 * step)));
                each(coarse.resolve(loaded.clone(), progress, &mut |_| ())?, Detail::Coarse)?;
            }
        }
    } else {
        let coarse = request.coarser(|most| most.map_or(FIRST_POINTS, |most| most.min(FIRST_POINTS)), 1.0);
        loaded = coarse.load(stdin.clone(), progress)?;
        if loaded.facts.iter().any(|facts| facts.thinned) {
            each(coarse.resolve(loaded, progress, &mut |_| ())?, Detail::Coarse)?;
            loaded = request.load(stdin, progress)?;
        } else if !request.objects().iter().any(|object| object.convert.max_points.is_some()) {
            // It is all there, and nobody has asked for fewer points.
            loaded.unused.retain(|(_, option)| option.option != "max_points");
        }
    }
    each(request.resolve(loaded, progress, note)?, Detail::Full)
}
