//! Progressive loading: first a coarse scene, then finer ones up to the full scene.

use crate::request::{Request, Resolved};
use std::sync::Arc;
use surfel_load::LoadedObjects;
use surfel_load::{Error, levels};
use surfel_sample::Progress;

/// Largest number of points per file in the coarse scene, for files without levels of detail. For files with levels, it
/// is a lower bound on the point limits of coarse scenes, unless the full scene's limit is smaller.
pub const FIRST_POINTS: u32 = 100_000;
/// Number of successively finer scenes that are drawn before the full scene, if files have levels of detail.
const STEPS: u32 = 2;

/// Step of progressive loading that a scene belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// A coarse scene; a finer one follows.
    Coarse,
    /// The full scene as requested, which is the last one.
    Full,
}

/// Loads and resolves a request as successively finer scenes, and calls `each` with each scene when it is ready. The
/// last scene is the full scene, as [`Request::load`] and [`Request::resolve`] return it. Notes about the full scene
/// are passed to `note`.
///
/// Depending on the files, the coarse scenes are:
///
/// - Files with levels of detail (COPC), some of them loaded only in part: two coarse scenes, with the camera of the
///   full scene. Their point limits are 1/64 and 1/16 of the full scene's, but no lower than [`FIRST_POINTS`], unless
///   that exceeds the full scene's limit. Their splats are up to 16 and 4 times as large.
/// - Files without levels, some of them with more than [`FIRST_POINTS`]: one coarse scene, with its own framed camera.
///   It shows [`FIRST_POINTS`] of each file, evenly selected, and the files are then read again.
/// - Other files: no coarse scene.
///
/// ```no_run
/// # fn main() -> Result<(), surfel_load::Error> {
/// use surfel_app::{progressive, request};
/// use surfel_render::Renderer;
/// use surfel_sample::NoProgress;
/// let source = request::Source::of(&["scan.copc.laz".into()], None)?;
/// let request = request::Request::new(source, &request::Pictures::One, &Default::default())?;
/// let mut backend = surfel_backend::Backend::auto()?;
/// progressive::resolve(request, &NoProgress, &mut |_| (), &mut |resolved, detail| {
///     let resident = backend.upload(&resolved.scene)?;
///     let frame = backend.render(&resident, &resolved.file.camera, &resolved.file.settings)?;
///     println!("{detail:?}: {} pixels", frame.color().len());
///     Ok::<_, surfel_load::Error>(())
/// })
/// # }
/// ```
///
/// # Errors
/// Errors of [`Request::load`] and [`Request::resolve`]. An error that `each` returns ends the loading.
pub fn resolve<E: From<Error>>(
    request: Request,
    progress: &dyn Progress,
    note: &mut dyn FnMut(String),
    each: &mut dyn FnMut(Resolved, Detail) -> Result<(), E>,
) -> Result<(), E> {
    let has_levels = request.files().any(|path| levels::has_levels(&path));
    let mut loaded;
    if has_levels {
        loaded = request.load(progress)?;
        if loaded.facts.iter().any(|facts| facts.partial) {
            for step in (1..=STEPS).rev() {
                let fewer = |most: Option<u32>| {
                    let most = most.unwrap_or(levels::DEFAULT_POINT_BUDGET as u32);
                    (most >> (2 * (step + 1))).max(FIRST_POINTS).min(most)
                };
                let coarse = request.coarser(fewer, f64::from(1 << (2 * step)));
                each(coarse.resolve(loaded.clone(), progress, &mut |_| ())?, Detail::Coarse)?;
            }
        }
    } else {
        let coarse = sample_of(&request);
        loaded = coarse.load(progress)?;
        if loaded.facts.iter().any(|facts| facts.thinned) {
            each(coarse.resolve(loaded, progress, &mut |_| ())?, Detail::Coarse)?;
            loaded = request.load(progress)?;
        } else {
            loaded = as_whole(&request, loaded);
        }
    }
    each(request.resolve(loaded, progress, note)?, Detail::Full)
}

/// Returns the request for the coarse scene of files without levels: [`FIRST_POINTS`] of each file, evenly selected. It
/// has its own cache of estimates.
fn sample_of(request: &Request) -> Request {
    let coarse = request.coarser(|most| most.map_or(FIRST_POINTS, |most| most.min(FIRST_POINTS)), 1.0);
    coarse.with_estimates(Arc::default())
}

/// Returns the loaded objects of a sample that turned out to include all points, as if `request` had loaded them. The
/// point limit that the sample added isn't reported as an option without effect.
fn as_whole(request: &Request, mut loaded: LoadedObjects) -> LoadedObjects {
    if !request.objects().iter().any(|object| object.convert.max_points.is_some()) {
        // The request itself states no point limit.
        loaded.unused.retain(|(_, option)| option.option != "max_points");
    }
    loaded
}

/// Result of loading a coarse selection of points first.
pub(crate) enum First {
    /// No objects, because the files have levels of detail.
    Nothing,
    /// A coarse selection of points, and the request for it.
    Coarse(Box<Request>, LoadedObjects),
    /// All points, because the files have few.
    Whole(LoadedObjects),
}

/// Loads a coarse selection of the points of files without levels of detail.
pub(crate) fn first(request: &Request, progress: &dyn Progress) -> Result<First, Error> {
    if request.files().any(|path| levels::has_levels(&path)) {
        return Ok(First::Nothing);
    }
    let coarse = sample_of(request);
    let loaded = coarse.load(progress)?;
    Ok(match loaded.facts.iter().any(|facts| facts.thinned) {
        true => First::Coarse(Box::new(coarse), loaded),
        false => First::Whole(as_whole(request, loaded)),
    })
}
