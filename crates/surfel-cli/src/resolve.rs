//! From inputs and flags to one scene.

use crate::args::RenderArgs;
use crate::console::Console;
use crate::failure::Failure;
use crate::options;
use crate::stdin::{Stdin, is_stdin};
use std::path::PathBuf;
use surfel::request::{Pictures, Request};
pub(crate) use surfel::request::{Resolved, SceneSource, Source};

/// What these inputs are.
pub(crate) fn source(inputs: &[PathBuf], stdin: &Stdin) -> Result<Source, Failure> {
    let bytes = if inputs.iter().any(|path| is_stdin(path)) { Some(stdin.bytes()?) } else { None };
    Ok(Source::of(inputs, bytes.as_deref())?)
}

/// Loads a scene for pictures.
pub(crate) fn resolve(
    source: Source,
    pictures: &Pictures,
    args: &RenderArgs,
    stdin: &Stdin,
    console: &Console,
) -> Result<Resolved, Failure> {
    let request = Request::new(source, pictures, &options::render(args)?)?;
    let from_stdin = request.objects().iter().flat_map(|o| [&o.splats, &o.mesh]).flatten().any(|path| is_stdin(path));
    let bytes = if from_stdin { Some(stdin.bytes()?) } else { None };
    let progress = console.progress();
    let loaded = request.load(bytes, &progress)?;
    let mut notes = Vec::new();
    let resolved = request.resolve(loaded, &progress, &mut |note| notes.push(note));
    // Lines of a progress bar and notes don't mix.
    drop(progress);
    notes.iter().for_each(|note| console.note(note));
    Ok(resolved?)
}
