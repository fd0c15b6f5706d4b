//! Python functions for the commands `convert`, `ortho`, `info`, `compare` and `backends`.

use crate::draw::{Input, on_threads};
use crate::errors;
use crate::frame::NativeFrame;
use crate::interrupt;
use crate::memory;
use crate::pool::{BackendRequest, PooledBackend};
use crate::scene::{Flags, NativeScene, wrong};
use pyo3::prelude::*;
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;
use surfel_app::compare::{check_diff, save_diff};
use surfel_app::ortho_request::OrthoRequest;
use surfel_app::request::SplatOptions;
use surfel_app::splat_file::{ConvertRequest, summary};
use surfel_app::values::{self, Part};
use surfel_app::{copc_output, ortho_request};
use surfel_backend::BackendOptions;
use surfel_io::ShowPath as _;
use surfel_io::{IoError, Planes, PlyEncoding};
use surfel_load::Error;
use surfel_load::levels::{self, CopcRequest};
use surfel_ortho::{OrthoFiles, OrthoOptions};
use surfel_render::Renderer;

/// Runs `work` on files or on a scene's arrays, if there is memory for the arrays and for the number of splats in the
/// options. Errors about arrays name the argument `points`.
fn named<T>(
    input: Option<&Arc<Input>>,
    options: &SplatOptions,
    work: impl FnOnce() -> Result<T, Error>,
) -> Result<T, Error> {
    memory::check_splats(input.map_or(0, |input| input.points), options, 1)?;
    match input {
        Some(input) => input.named(work()),
        None => work(),
    }
}

/// Returns notes in which options are named as in Python, and arrays by their argument `points`.
fn named_notes(input: Option<&Arc<Input>>, notes: Vec<String>) -> Vec<String> {
    let notes = input.map_or(notes.clone(), |input| input.named_notes(notes));
    notes.iter().map(|note| errors::in_python(note)).collect()
}

/// Writes splats, an octree, or points with levels of detail (COPC). Returns notes for the user.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "Python's half names them")]
pub(crate) fn convert(
    py: Python<'_>,
    inputs: Vec<PathBuf>,
    scene: Option<PyRef<'_, NativeScene>>,
    output: PathBuf,
    flags: Flags,
    hybrid: bool,
    ascii: bool,
    force: bool,
) -> PyResult<Vec<String>> {
    let mut options = SplatOptions::default();
    options.force = force;
    let (mut who, mut resume, mut shard) = (BackendRequest::default(), false, None);
    for (flag, text) in &flags {
        let set = match flag.as_str() {
            "threads" => who.set(flag, text),
            "resume" => values::switch(text).map(|on| resume = on).map(|()| true),
            "shard" => values::part(text).map(|part| shard = Some(part)).map(|()| true),
            _ => options.set(flag, text),
        };
        match set {
            Ok(true) => {}
            Ok(false) => return Err(wrong(py, flag, text, "there is no such argument here")),
            Err(message) => return Err(wrong(py, flag, text, &message)),
        }
    }
    let input = scene.map(|scene| scene.input.clone());
    let (stdin, of_arrays) = (input.as_ref().and_then(|input| input.bytes.clone()), input.clone());
    let asked = options.clone();
    let convert = move |progress: &interrupt::Reporter| {
        // The output is checked before the work starts.
        if output.is_file() && !force && !resume {
            return Err(IoError::Exists { path: output }.into());
        }
        let is_copc = (levels::is_copc(&output) || levels::is_shard(&output)) && !hybrid;
        if !is_copc && (resume || shard.is_some()) {
            let what = "--resume and --shard are of names that end in .copc.laz and in .shard";
            return Err(Error::Usage(format!("-o {}: {what}", output.shown())));
        }
        let path = match &inputs[..] {
            [path] => path,
            [path, ..] if is_copc => path,
            _ => {
                return Err(Error::Usage(format!(
                    "{} inputs, expected one, or any number of LAZ files and an output \
                                                  that ends in .copc.laz",
                    inputs.len()
                )));
            }
        };
        let request = ConvertRequest { path, options: &options, stdin };
        on_threads(who.options.threads, || {
            if is_copc {
                copc_output::check_copc(&output, &options, ascii, shard)?;
                let columns = options.convert.columns.clone();
                let request = CopcRequest {
                    overwrite: force,
                    memory: options.memory,
                    resume,
                    shard: shard.map(Part::index_and_count),
                    columns,
                };
                let report = levels::save_copc(&inputs, &output, &request, progress)?;
                let summary = format!("{}: {}", output.shown(), levels::summary(&report));
                return Ok(report.notes.into_iter().chain([summary]).collect());
            }
            if hybrid {
                let (octree, notes) = surfel_load::octree::load_octree(path, &request.load_options()?, progress)?;
                surfel_io::save_octree(&output, force, &octree)?;
                return Ok(notes);
            }
            let mut notes = Vec::new();
            let cloud = request.convert(request.load(progress)?, &mut |note| notes.push(note))?;
            let encoding = if ascii { PlyEncoding::Ascii } else { PlyEncoding::BinaryLittleEndian };
            surfel_io::save_splat_ply(&output, force, &cloud, encoding)?;
            notes.push(format!("{}: {}", output.shown(), summary(&cloud)));
            Ok(notes)
        })?
    };
    let notes = interrupt::run(py, move |progress| named(of_arrays.as_ref(), &asked, || convert(progress)))?;
    Ok(named_notes(input.as_ref(), notes))
}

/// Memory of one block of an orthoimage of any size, in bytes. A block has 2064² pixels of all planes, and edge data;
/// 200 MB were measured.
const BLOCK_BYTES: u64 = 256 << 20;

/// Draws an orthoimage. Returns the output of `--stats` as JSON, and notes for the user.
#[pyfunction]
pub(crate) fn ortho(
    py: Python<'_>,
    inputs: Vec<PathBuf>,
    scene: Option<PyRef<'_, NativeScene>>,
    output: Option<PathBuf>,
    flags: Flags,
    force: bool,
) -> PyResult<(String, Vec<String>)> {
    let mut splats = SplatOptions::default();
    splats.force = force;
    let mut options = OrthoOptions::new(0.0);
    let mut files = OrthoFiles { color: output, overwrite: force, ..OrthoFiles::default() };
    let mut who = BackendRequest { name: "auto".to_owned(), options: BackendOptions::default() };
    for (flag, text) in &flags {
        let known = match flag.as_str() {
            "gsd" => values::positive(text).map(|gsd| options.gsd = gsd),
            "bounds" => values::bounds(text).map(|bounds| options.bounds = Some(bounds)),
            "origin" => values::place(text).map(|origin| options.origin = origin),
            "size" => values::size(text).map(|size| options.size = Some(size)),
            "fill" => values::positive(text).map(|distance| options.fill = Some(distance)),
            "crs" => values::epsg(text).map(|code| options.epsg = Some(code)),
            "dsm" | "normals" => {
                let file = if flag == "dsm" { &mut files.dsm } else { &mut files.normals };
                *file = Some(text.into());
                Ok(())
            }
            _ => match who.set(flag, text) {
                Ok(false) => splats.set(flag, text).map(|_| ()),
                set => set.map(|_| ()),
            },
        };
        known.map_err(|message| wrong(py, flag, text, &message))?;
    }
    let input = scene.map(|scene| scene.input.clone());
    let (stdin, of_arrays) = (input.as_ref().and_then(|input| input.bytes.clone()), input.clone());
    let asked = splats.clone();
    let draw = move |progress: &interrupt::Reporter| {
        let request = OrthoRequest { inputs: &inputs, options, splats: &splats, files: &files, stdin };
        let mut notes = Vec::new();
        let stats = on_threads(who.options.threads, || {
            let mut ortho = request.open(progress, &mut |note| notes.push(note))?;
            let mut taken = PooledBackend::new(&who, |_| None)?;
            let backend = taken.backend()?;
            memory::check("gsd", BLOCK_BYTES, who.options.threads, Some(u64::MAX))?;
            let software = concat!("surfel ", env!("CARGO_PKG_VERSION"));
            let stats = ortho.draw(&files, software, backend, progress)?;
            notes.extend(ortho_request::notes_of(&stats));
            Ok::<_, Error>(ortho_request::stats_json(&ortho, &stats, backend.info().backend))
        })??;
        Ok((stats, notes))
    };
    let (json, notes) = interrupt::run(py, move |progress| named(of_arrays.as_ref(), &asked, || draw(progress)))?;
    Ok((json.to_string(), named_notes(input.as_ref(), notes)))
}

/// Returns a description of a file's contents, as JSON.
#[pyfunction]
pub(crate) fn info(
    py: Python<'_>,
    path: PathBuf,
    scene: Option<PyRef<'_, NativeScene>>,
    repair: bool,
    allow_outside: bool,
    max_texture: Option<u32>,
    columns: Option<String>,
) -> PyResult<String> {
    let columns = columns.map(|text| values::columns(&text).map_err(|problem| wrong(py, "columns", &text, &problem)));
    let columns = columns.transpose()?;
    let options = surfel_io::LoadOptions { repair, allow_outside, max_texture, columns, ..Default::default() };
    let input = scene.map(|scene| scene.input.clone()).filter(|input| input.bytes.is_some());
    let of_arrays = input.clone();
    let mut facts = interrupt::run(py, move |_| {
        let input = of_arrays;
        let bytes = input.as_ref().and_then(|input| input.bytes.clone());
        let read = || surfel_load::info::info(&path, &options, bytes.as_deref());
        // The work runs in a pool of its own, because a forked process has no threads of the global pool.
        named(input.as_ref(), &SplatOptions::default(), || on_threads(0, read)?)
    })?;
    let notes = facts["notes"].as_array().into_iter().flatten().filter_map(|note| note.as_str());
    facts["notes"] = named_notes(input.as_ref(), notes.map(str::to_owned).collect()).into();
    if input.is_some() {
        facts["file"] = errors::ARRAYS.into();
    }
    Ok(facts.to_string())
}

/// Memory that a copy of an image's planes takes, in bytes per pixel. It must be available before planes are copied.
const COPIED_BYTES: u64 = 80;
/// Memory that a comparison takes, in bytes per pixel; 95 were measured. It must be available before images are
/// compared.
const COMPARED_BYTES: u64 = 128;

/// Image to compare: the path of a file, or a drawn image.
#[derive(FromPyObject)]
pub(crate) enum ImageOrPath<'py> {
    Frame(PyRef<'py, NativeFrame>),
    Path(PathBuf),
}

impl ImageOrPath<'_> {
    fn planes(&self, py: Python<'_>) -> PyResult<Planes> {
        match self {
            Self::Path(path) => {
                let read = py.detach(|| surfel_io::read_image(path));
                read.map_err(|error| errors::raise(py, &error.into()))
            }
            Self::Frame(frame) => frame.check_memory(py, COPIED_BYTES).and_then(|()| {
                frame.with_planes(py, |planes| Planes {
                    width: planes.width,
                    height: planes.height,
                    color: planes.color.map(<[_]>::to_vec),
                    depth: planes.depth.map(<[_]>::to_vec),
                    normal: planes.normal.map(<[_]>::to_vec),
                    weight: planes.weight.map(<[_]>::to_vec),
                    whole: planes.whole.iter().map(|(name, plane)| ((*name).to_owned(), plane.to_vec())).collect(),
                    // These planes are in the form of an EXR file.
                    other: planes.position.map_or_else(Vec::new, |position| {
                        let axis = |i: usize| position.iter().map(|p| p[i] as f32).collect();
                        ["X", "Y", "Z"].iter().enumerate().map(|(i, n)| (format!("position.{n}"), axis(i))).collect()
                    }),
                    ..Planes::default()
                })
            }),
        }
    }

    fn name(&self, otherwise: &str) -> PathBuf {
        if let Self::Path(path) = self { path.clone() } else { otherwise.into() }
    }
}

/// Compares image `b` with the reference `a`. Returns the measures as JSON.
#[pyfunction]
pub(crate) fn compare(
    py: Python<'_>,
    a: ImageOrPath<'_>,
    b: ImageOrPath<'_>,
    diff: Option<PathBuf>,
    force: bool,
) -> PyResult<String> {
    let names = [a.name("a"), b.name("b")];
    if let Some(diff) = &diff {
        check_diff(diff, [&names[0], &names[1]], force).map_err(|error| errors::raise(py, &error))?;
    }
    let (a, b) = (a.planes(py)?, b.planes(py)?);
    let json = interrupt::run(py, move |_| {
        memory::check("a and b", u64::from(a.width) * u64::from(a.height) * COMPARED_BYTES, 1, None)?;
        let compared = surfel_app::compare::compare(&a, &b, [&names[0], &names[1]])?;
        if let Some(diff) = &diff {
            save_diff(diff, force, &compared)?;
        }
        let mut json = compared.to_json();
        let [a, b] = names.map(|name: PathBuf| name.to_string_lossy().into_owned());
        (json["a"], json["b"]) = (a.into(), b.into());
        Ok::<_, Error>(json)
    })?;
    Ok(json.to_string())
}

/// Lists the backends and whether this machine can run them, as JSON.
#[pyfunction]
pub(crate) fn backends(py: Python<'_>) -> PyResult<String> {
    let entry = |b: surfel_backend::BackendInfo| {
        let reason = match (b.missing_feature, &b.state) {
            (Some(feature), _) => Some(format!("not built in: {}", errors::how_to_build(py, feature)?)),
            (None, Err(reason)) => Some(reason.clone()),
            (None, Ok(_)) => None,
        };
        let info = b.state.ok();
        let info = info.as_ref();
        Ok(json!({
            "name": b.name,
            "available": info.is_some(),
            "adapter": info.map(|info| &info.adapter),
            "driver": info.map(|info| &info.driver),
            "threads": info.map(|info| info.threads),
            "reason": reason,
        }))
    };
    let infos = py.detach(surfel_backend::backends);
    let list: serde_json::Value = infos.into_iter().map(entry).collect::<PyResult<_>>()?;
    Ok(list.to_string())
}
