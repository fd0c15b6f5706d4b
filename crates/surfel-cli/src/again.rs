//! `surfel again`: draws an image again from the scene stored in its metadata.

use crate::args::{AgainArgs, Cli, Command, RenderArgs, command};
use crate::console::Console;
use crate::failure::Failure;
use crate::output::{Format, Output};
use crate::render::Session;
use crate::resolve::{SceneSource, Source};
use crate::stdin::{self, Stdin, is_stdin};
use clap::FromArgMatches;
use serde_json::Value;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use surfel::io::Planes;
use surfel::io::ShowPath as _;
use surfel::metadata::{Content, DRAWN_KEY, INPUTS_KEY, SCENE_KEY, VERSION, VERSION_KEY, content};

pub(crate) fn run(args: &AgainArgs, threads: usize, console: &Console) -> Result<(), Failure> {
    let name = args.image.shown();
    let image = surfel::io::read_image(&args.image)?;
    let text = |key: &str| image.metadata.iter().find(|(k, _)| k == key).map(|(_, text)| text.as_str());
    let Some(scene) = text(SCENE_KEY) else {
        return Err(Failure::input(format!(
            "{name}: carries no scene, expected a PNG or EXR that surfel drew without --no-metadata\n  help: programs \
             that edit images often leave such text out: take the file as it was drawn"
        )));
    };
    let (file, keys) = surfel::scene::parse_scene_file(scene.as_bytes(), &args.image)?;
    let base = args.image.parent().unwrap_or(Path::new("")).to_path_buf();
    let stdin = Stdin::default();

    let mut changed = Vec::new();
    if let Some(version) = text(VERSION_KEY).filter(|version| *version != VERSION) {
        changed.push(format!("it was drawn by surfel {version}, this is {VERSION}"));
    }
    changed.extend(changed_inputs(args, &json(args, INPUTS_KEY, text(INPUTS_KEY))?, &base, &stdin)?);
    changed.iter().for_each(|what| console.note(&format!("{name}: {what}")));

    let output = args.output.clone().unwrap_or_else(|| default_output(&args.image));
    let drawn = json(args, DRAWN_KEY, text(DRAWN_KEY))?;
    let render = render_args(args, &drawn, &output)?;
    let target = Output::new(&output, args.force, render.png16, render.exr_f32)?;
    let is_exr = image.depth.is_some() || image.weight.is_some();
    if is_exr != matches!(target.format, Format::Exr { .. }) || target.format == Format::Jpeg {
        let format = if is_exr { "an EXR" } else { "a PNG" };
        return Err(Failure::usage(format!("-o {}: {name} is {format}, expected a name for another", output.shown())));
    }
    let mut session = Session::start(&render, Some(target), stdin, threads, console)?;
    session.check_names(&args.image)?;
    let source = SceneSource { file, keys, name: args.image.clone(), base };
    let files = session.draw(Source::Scene(Box::new(source)), &args.image)?.files;
    let Some(written) = files.first() else { return Ok(()) };
    judge(args, &image, written, &changed, &drawn, console)
}

/// Reports whether the image is identical to the original. Fails with exit code 5 if it differs although nothing is
/// known to have changed.
fn judge(
    args: &AgainArgs,
    image: &Planes,
    written: &Path,
    changed: &[String],
    drawn: &Value,
    console: &Console,
) -> Result<(), Failure> {
    let again = surfel::io::read_image(written)?;
    let (name, written) = (args.image.shown(), written.shown());
    let planes = |p: &Planes| (bits(p.color.as_ref().map(|c| c.as_flattened())), bits(p.depth.as_deref()));
    if (again.width, again.height) == (image.width, image.height) && planes(&again) == planes(image) {
        console.note(&format!("{written}: the same image as {name}, to the bit"));
        return Ok(());
    }
    let differs = format!("{written}: is not the image of {name} to the bit");
    // The difference is explained by changes reported before, another backend, or another machine's GPU.
    if !changed.is_empty() || args.backend.is_some() || !drawn["adapter"].is_null() {
        console.note(&differs);
        return Ok(());
    }
    Err(Failure::threshold(format!("{differs}, although its inputs and surfel's version are as they were")))
}

/// Returns the bits of a plane, so that NaN compares equal to itself.
fn bits(plane: Option<&[f32]>) -> Vec<u32> {
    plane.into_iter().flatten().map(|value| value.to_bits()).collect()
}

/// Returns the default output: IMAGE's name with `-again`, in the current folder.
fn default_output(image: &Path) -> PathBuf {
    let mut name = image.file_stem().unwrap_or_default().to_owned();
    name.push("-again.");
    name.push(image.extension().unwrap_or("png".as_ref()));
    name.into()
}

/// Parses a metadata entry as JSON; null if the entry is missing.
fn json(args: &AgainArgs, key: &str, text: Option<&str>) -> Result<Value, Failure> {
    let Some(text) = text else { return Ok(Value::Null) };
    serde_json::from_str(text).map_err(|e| Failure::input(format!("{}: {key} is damaged: {e}", args.image.shown())))
}

/// Returns a description of each input that has changed since the image was drawn.
///
/// Fails if inputs are missing; all of them are named before anything is loaded.
fn changed_inputs(args: &AgainArgs, inputs: &Value, base: &Path, stdin: &Stdin) -> Result<Vec<String>, Failure> {
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
        args.image.shown(),
        missing.join(", ")
    )))
}

/// Returns the flags that draw the image, parsed by the command line's own parser.
fn render_args(args: &AgainArgs, drawn: &Value, output: &Path) -> Result<RenderArgs, Failure> {
    let mut to = OsString::from("--output=");
    to.push(output);
    // The scene is already known, so the input's name has no effect.
    let mut words: Vec<OsString> = vec!["surfel".into(), "render".into(), "scene".into(), to];
    if args.force {
        words.push("--force".into());
    }
    for (key, value) in drawn.as_object().into_iter().flatten() {
        let text = match value {
            Value::String(text) => text.clone(),
            other => other.to_string(),
        };
        match key.as_str() {
            "backend" if args.backend.is_some() => {}
            "backend" | "region" | "samples" | "storage" | "planes" | "label" => {
                words.push(format!("--{key}={text}").into());
            }
            "png16" | "exr-f32" if text == "true" => words.push(format!("--{key}").into()),
            "adapter" => {}
            _ => {
                let message = format!("{}: {DRAWN_KEY} has the unknown key '{key}'", args.image.shown());
                return Err(Failure::input(format!("{message}: a later version of surfel drew it")));
            }
        }
    }
    words.extend(args.backend.iter().map(|name| format!("--backend={name}").into()));
    let damaged = |e: clap::Error| {
        let line = e.to_string().lines().next().unwrap_or_default().to_owned();
        Failure::input(format!("{}: {DRAWN_KEY} is damaged: {line}", args.image.shown()))
    };
    let matches = command().try_get_matches_from(words).map_err(damaged)?;
    match Cli::from_arg_matches(&matches).map_err(damaged)?.command {
        Command::Render(render) => Ok(*render),
        _ => Err(Failure::input(format!("{}: {DRAWN_KEY} is damaged", args.image.shown()))),
    }
}
