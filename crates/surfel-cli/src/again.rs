//! `surfel again`: draws an image again, from the scene that the image's metadata contains.

use crate::console::Console;
use crate::failure::Failure;
use crate::output::{Format, Output};
use crate::render::Session;
use crate::resolve::{SceneSource, Source};
use crate::stdin::{self, Stdin, is_stdin};
use serde_json::Value;
use std::path::{Path, PathBuf};
use surfel_app::metadata::{Content, DRAWN_KEY, INPUTS_KEY, SCENE_KEY, VERSION, VERSION_KEY, content};
use surfel_app::options::{Commands, Options, table};
use surfel_io::Planes;
use surfel_io::ShowPath as _;

pub(crate) fn run(args: &Options, threads: usize, console: &Console) -> Result<(), Failure> {
    let path = input(args);
    let name = path.shown();
    let image = surfel_io::read_image(path)?;
    let text = |key: &str| image.metadata.iter().find(|(k, _)| k == key).map(|(_, text)| text.as_str());
    let Some(scene) = text(SCENE_KEY) else {
        return Err(Failure::input(format!(
            "{name}: carries no scene, expected a PNG or EXR that surfel drew without --no-metadata\n  help: programs \
             that edit images often leave such text out: take the file as it was drawn"
        )));
    };
    let (file, keys) = surfel_load::scene::parse_scene_file(scene.as_bytes(), path)?;
    let base = path.parent().unwrap_or(Path::new("")).to_path_buf();
    let stdin = Stdin::default();

    let mut changed = Vec::new();
    if let Some(version) = text(VERSION_KEY).filter(|version| *version != VERSION) {
        changed.push(format!("it was drawn by surfel {version}, this is {VERSION}"));
    }
    changed.extend(changed_inputs(args, &json(args, INPUTS_KEY, text(INPUTS_KEY))?, &base, &stdin)?);
    changed.iter().for_each(|what| console.note(&format!("{name}: {what}")));

    let output = args.output.clone().unwrap_or_else(|| default_output(path));
    let drawn = json(args, DRAWN_KEY, text(DRAWN_KEY))?;
    let mut render = render_options(args, &drawn)?;
    render.inputs.push(path.to_path_buf());
    let target = Output::still(&output, args.force, render.png16, render.exr_f32)?;
    let is_exr = image.depth.is_some() || image.weight.is_some();
    if is_exr != matches!(target.format, Format::Exr { .. }) || target.format == Format::Jpeg {
        let format = if is_exr { "an EXR" } else { "a PNG" };
        return Err(Failure::usage(format!("-o {}: {name} is {format}, expected a name for another", output.shown())));
    }
    let mut session = Session::start(&render, Some(target), stdin, threads, console)?;
    session.check_names(path)?;
    let source = SceneSource { file, keys, name: path.to_path_buf(), base };
    let files = session.draw(Source::Scene(Box::new(source)), path)?.files;
    let Some(written) = files.first() else { return Ok(()) };
    judge(args, &image, written, &changed, &drawn, console)
}

/// Reports whether colour and depth of the image drawn again are identical to those of the original. Fails with exit
/// code 5 if they differ although `changed` is empty, the command line states no backend, and no GPU drew the original.
fn judge(
    args: &Options,
    image: &Planes,
    written: &Path,
    changed: &[String],
    drawn: &Value,
    console: &Console,
) -> Result<(), Failure> {
    let again = surfel_io::read_image(written)?;
    let (name, written) = (input(args).shown(), written.shown());
    let planes = |p: &Planes| (bits(p.color.as_ref().map(|c| c.as_flattened())), bits(p.depth.as_deref()));
    if (again.width, again.height) == (image.width, image.height) && planes(&again) == planes(image) {
        console.note(&format!("{written}: the same image as {name}, to the bit"));
        return Ok(());
    }
    let differs = format!("{written}: is not the image of {name} to the bit");
    // Changes reported before, another backend, or another machine's GPU explain the difference.
    if !changed.is_empty() || args.backend.is_some() || !drawn["adapter"].is_null() {
        console.note(&differs);
        return Ok(());
    }
    Err(Failure::threshold(format!("{differs}, although its inputs and surfel's version are as they were")))
}

/// Returns the bit patterns of a plane, so that NaN compares equal to itself.
fn bits(plane: Option<&[f32]>) -> Vec<u32> {
    plane.into_iter().flatten().map(|value| value.to_bits()).collect()
}

/// Returns the default output: the name of IMAGE with `-again`, in the current folder.
fn default_output(image: &Path) -> PathBuf {
    let mut name = image.file_stem().unwrap_or_default().to_owned();
    name.push("-again.");
    name.push(image.extension().unwrap_or("png".as_ref()));
    name.into()
}

/// Parses a metadata entry as JSON; null if the entry is missing. `key` names the entry in the error message.
fn json(args: &Options, key: &str, text: Option<&str>) -> Result<Value, Failure> {
    let Some(text) = text else { return Ok(Value::Null) };
    serde_json::from_str(text).map_err(|e| Failure::input(format!("{}: {key} is damaged: {e}", input(args).shown())))
}

/// Returns a description of each input that has changed since the image was drawn.
///
/// Fails if inputs are missing; all of them are named before anything is loaded.
fn changed_inputs(args: &Options, inputs: &Value, base: &Path, stdin: &Stdin) -> Result<Vec<String>, Failure> {
    let (mut missing, mut changed) = (Vec::new(), Vec::new());
    for input in inputs.as_array().into_iter().flatten() {
        let Some(path) = input["path"].as_str().map(Path::new) else { continue };
        let place = if is_stdin(path) { path.to_path_buf() } else { base.join(path) };
        let was_missing = input["missing"] == true;
        let bytes = if is_stdin(path) { Some(stdin.bytes()?) } else { None };
        match content(&place, bytes.as_deref())? {
            Content::Missing if !was_missing => missing.push(place.shown().to_string()),
            Content::Known { .. } if was_missing => changed.push(format!("{} was not there", place.shown())),
            Content::Known { bytes, sha256 } if input["bytes"] != bytes || input["sha256"] != *sha256 => {
                changed.push(format!("{} has changed since", stdin::display(&place)));
            }
            _ => {}
        }
    }
    if missing.is_empty() {
        return Ok(changed);
    }
    Err(Failure::input(format!(
        "{}: is drawn of what is not there: {}\n  help: its paths are relative to it: put the files back, or the \
         image beside them",
        input(args).shown(),
        missing.join(", ")
    )))
}

/// Returns the options with which the image was drawn, as stored in its metadata, updated by the command line.
fn render_options(args: &Options, drawn: &Value) -> Result<Options, Failure> {
    let name = input(args).shown();
    let mut options = Options::default();
    options.force = args.force;
    for (key, value) in drawn.as_object().into_iter().flatten() {
        let text = match value {
            Value::String(text) => text.clone(),
            Value::Bool(on) => (if *on { "on" } else { "off" }).to_owned(),
            other => other.to_string(),
        };
        match table().find(Commands::RENDER, key).filter(|row| row.is_drawn) {
            Some(row) => {
                let damaged =
                    |problem| Failure::input(format!("{name}: {DRAWN_KEY} is damaged: {key}={text}: {problem}"));
                let is_named = row.names.is_none() || row.is_list || row.has_name(&text);
                let known = if is_named { Ok(()) } else { Err("is no name of it".to_owned()) };
                known.and_then(|()| row.set(&mut options, text.as_ref())).map_err(damaged)?;
            }
            // The adapter can explain differences, but the image may be drawn on another one.
            None if key == "adapter" => {}
            None => {
                let message = format!("{name}: {DRAWN_KEY} has the unknown key '{key}'");
                return Err(Failure::input(format!("{message}: a later version of surfel drew it")));
            }
        }
    }
    if args.backend.is_some() {
        options.backend.clone_from(&args.backend);
    }
    Ok(options)
}

/// Returns the path of the image to draw again.
fn input(args: &Options) -> &Path {
    args.inputs.first().map_or(Path::new(""), PathBuf::as_path)
}
