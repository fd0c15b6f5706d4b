//! Loading of inputs, with the options of the command line, as one scene.

use crate::console::Console;
use crate::failure::Failure;
use crate::output;
use crate::stdin::{Stdin, is_stdin};
use std::path::{Path, PathBuf};
use surfel_app::options::Options;
use surfel_app::progressive::{self, Detail};
use surfel_app::request::{Pictures, Request};
pub(crate) use surfel_app::request::{Resolved, SceneSource, Source};

/// Returns the source that these inputs form: a scene file, or files of geometry.
pub(crate) fn source(inputs: &[PathBuf], stdin: &Stdin) -> Result<Source, Failure> {
    let bytes = if inputs.iter().any(|path| is_stdin(path)) { Some(stdin.bytes()?) } else { None };
    Ok(Source::of(inputs, bytes.as_deref())?)
}

/// Loads the objects of a source, resolves them into a scene with camera, settings and planes, and passes the scene to
/// `each`. With `--progressive`, coarse scenes are passed to `each` before the full one.
pub(crate) fn resolve(
    source: Source,
    pictures: &Pictures,
    args: &Options,
    stdin: &Stdin,
    console: &Console,
    each: &mut dyn FnMut(Resolved, Detail) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let mut said = args.render.clone();
    if let (Some(bar), Source::Geometry(paths)) = (&mut said.splats.colorbar, &source) {
        *bar = output::of_input(bar, paths.first().map_or(Path::new(""), PathBuf::as_path));
    }
    let request = Request::new(source, pictures, &said)?;
    let from_stdin = request.objects().iter().flat_map(|o| [&o.splats, &o.mesh]).flatten().any(|path| is_stdin(path));
    let request = if from_stdin { request.with_stdin(Some(stdin.bytes()?)) } else { request };
    let progress = console.progress();
    let notes = std::cell::RefCell::new(Vec::new());
    let tell = || {
        progress.clear();
        notes.take().iter().for_each(|note: &String| console.note(note));
    };
    let note = &mut |note| notes.borrow_mut().push(note);
    let each = &mut |scene, detail| {
        tell();
        each(scene, detail)
    };
    let resolved = match args.progressive {
        true => progressive::resolve(request, &progress, note, each),
        false => request
            .load(&progress)
            .and_then(|loaded| request.resolve(loaded, &progress, note))
            .map_err(Failure::from)
            .and_then(|scene| each(scene, Detail::Full)),
    };
    tell();
    resolved
}
