//! Loading of inputs, with the options of the command line, as one scene.

use crate::console::Console;
use crate::failure::Failure;
use crate::output;
use crate::stdin::{Stdin, is_stdin};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_app::options::Options;
use surfel_app::progressive::{self, Detail};
use surfel_app::request::{Pictures, Request};
pub(crate) use surfel_app::request::{Resolved, SceneSource, Source};

/// Returns the source that these inputs form: a scene file, or files of geometry.
pub(crate) fn source(inputs: &[PathBuf], stdin: &Stdin) -> Result<Source, Failure> {
    let bytes = if inputs.iter().any(|path| is_stdin(path)) { Some(stdin.bytes()?) } else { None };
    Ok(Source::of(inputs, bytes.as_deref())?)
}

/// Loads a scene and resolves its images: cameras, settings and planes.
pub(crate) fn resolve(
    source: Source,
    pictures: &Pictures,
    args: &Options,
    stdin: &Stdin,
    console: &Console,
) -> Result<Resolved, Failure> {
    let (request, bytes) = request(source, pictures, args, stdin)?;
    let progress = console.progress();
    let loaded = request.load(bytes, &progress)?;
    let mut notes = Vec::new();
    let resolved = request.resolve(loaded, &progress, &mut |note| notes.push(note));
    drop(progress);
    notes.iter().for_each(|note| console.note(note));
    Ok(resolved?)
}

/// Loads a scene progressively, and calls `each` with successively finer scenes.
pub(crate) fn resolve_progressively(
    source: Source,
    pictures: &Pictures,
    args: &Options,
    stdin: &Stdin,
    console: &Console,
    each: &mut dyn FnMut(Resolved, Detail) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let (request, bytes) = request(source, pictures, args, stdin)?;
    let progress = console.progress();
    let notes = std::cell::RefCell::new(Vec::new());
    let tell = || {
        progress.clear();
        notes.take().iter().for_each(|note: &String| console.note(note));
    };
    let resolved = progressive::resolve(
        request,
        bytes,
        &progress,
        &mut |note| notes.borrow_mut().push(note),
        &mut |scene, detail| {
            tell();
            each(scene, detail)
        },
    );
    tell();
    resolved
}

/// Request for images of a scene, and the content of stdin (`None` unless an input is `-`).
type Asked = (Request, Option<Arc<[u8]>>);

/// Creates the request for images of a source.
pub(crate) fn request(source: Source, pictures: &Pictures, args: &Options, stdin: &Stdin) -> Result<Asked, Failure> {
    let mut said = args.render.clone();
    if let (Some(bar), Source::Geometry(paths)) = (&mut said.splats.colorbar, &source) {
        *bar = output::of_input(bar, paths.first().map_or(Path::new(""), PathBuf::as_path));
    }
    let request = Request::new(source, pictures, &said)?;
    let from_stdin = request.objects().iter().flat_map(|o| [&o.splats, &o.mesh]).flatten().any(|path| is_stdin(path));
    let bytes = if from_stdin { Some(stdin.bytes()?) } else { None };
    Ok((request, bytes))
}
