//! `surfel render`.

use crate::args::RenderArgs;
use crate::camera;
use crate::console::{self, Console};
use crate::failure::Failure;
use crate::output::{Format, Output};
use crate::resolve::{Resolved, resolve};
use crate::stats;
use crate::verify::verify;
use std::path::{Path, PathBuf};
use surfel::render::{Capabilities, SceneSummary, unsupported};
use surfel::{
    Backend, BackendOptions, BackendScene, Camera, Chosen, Frame, Planes, Preset, Progress as _, Renderer, Scene,
    SceneFile, Stats, View,
};

pub(crate) fn run(args: &RenderArgs, threads: usize, command: &str, console: &Console) -> Result<(), Failure> {
    let output = args.output.as_deref().map(|o| Output::new(o, args.force, args.png16, args.exr_f32)).transpose()?;
    check(args, output.as_ref())?;
    let renders = output.is_some() || args.stats || args.verify;
    let mut backend = if renders { Some(start(args, threads, console)?) } else { None };
    let frames = args.frames.unwrap_or(1);
    let input = args.inputs.first().map_or(Path::new(""), PathBuf::as_path);
    let name_of = |backend: &Backend, frame: u32| output.as_ref()?.path(backend.info().backend, frame, input);
    if let (Some(backend), Some(output)) = (&backend, &output) {
        for frame in 0..frames {
            output.check(name_of(backend, frame).as_deref())?;
        }
    }

    let resolved = resolve(args, console)?;
    camera::view(&resolved.file.camera, args)?;
    if args.print_scene {
        print_scene(args, &resolved.file, console)?;
    }
    let Some(backend) = &mut backend else { return Ok(()) };
    let planes = match output.as_ref().map(|o| o.format) {
        Some(Format::Exr { .. }) => Planes::ALL,
        _ => Planes::COLOR,
    };
    let mut summary = SceneSummary::of(&resolved.scene);
    // Any frame may come close enough for polygons.
    summary.meshes |= !resolved.hybrids.is_empty();
    let refuses = |c: &Capabilities| unsupported(&summary, &resolved.file.settings, planes, c).map(|e| e.to_string());
    if args.backend == "auto" && refuses(&backend.info().capabilities).is_some() {
        *backend = choose(args, threads, console, refuses)?;
        if let Some(output) = &output {
            for frame in 0..frames {
                output.check(name_of(backend, frame).as_deref())?;
            }
        }
    }
    let mut job = Job { args, console, planes, runs: Vec::new(), frame: Frame::default(), scene: None };
    for index in 0..frames {
        let (camera, moved) = turned(&resolved, index, frames);
        job.render(backend, &resolved, &camera, moved)?;
        if let Some(output) = &output {
            let path = name_of(backend, index);
            output.write(path.as_deref(), &job.frame, metadata(args, &camera, &resolved.file, command))?;
            if let (Some(path), Some(last)) = (&path, job.runs.last()) {
                console.detail(&format!("{}: {:.1} ms, {} splats", path.display(), last.frame_ms, last.splats));
            }
        }
    }
    let verified = if args.verify {
        let view = camera::view(&resolved.file.camera, args)?;
        let scene = at_detail(&resolved, &view, args)?;
        let scene = scene.as_ref().unwrap_or(&resolved.scene);
        let drawn = (backend.info().backend, &job.frame);
        Some(verify(&resolved.file.settings, promised(args, &resolved), scene, &view, threads, drawn)?)
    } else {
        None
    };
    if args.stats {
        let size = [job.frame.width, job.frame.height];
        let mut stats = stats::json(&job.runs, backend.info(), size, frames, promised(args, &resolved));
        if let Some(verified) = &verified {
            stats["verify"] = verified.json();
        }
        console::json_result(&stats)?;
    } else if let Some(verified) = &verified {
        console::result(verified.text().as_bytes())?;
    }
    verified.map_or(Ok(()), |verified| verified.judge())
}

/// The preset whose promise holds: none of splats in 16 bits.
fn promised(args: &RenderArgs, resolved: &Resolved) -> Option<Preset> {
    Preset::of(&resolved.file.settings).filter(|_| args.storage != "16")
}

/// The scene at the detail that a view needs, where it has octrees.
fn at_detail(resolved: &Resolved, view: &View, args: &RenderArgs) -> Result<Option<Scene>, Failure> {
    match resolved.hybrids.as_slice() {
        [] => Ok(None),
        hybrids => Ok(Some(surfel::at_detail(&resolved.scene, hybrids, view, args.lod_error)?)),
    }
}

/// Combinations that make no sense.
fn check(args: &RenderArgs, output: Option<&Output>) -> Result<(), Failure> {
    let stdout = output.is_some_and(Output::is_stdout);
    if output.is_none() && !args.print_scene && !args.stats && !args.verify {
        let expected = "expected -o OUT.png or OUT.exr (or --print-scene, --stats, --verify)";
        return Err(Failure::usage(format!("no output is given, {expected}")));
    }
    if stdout && (args.stats || args.print_scene || args.verify) {
        let flag = match (args.stats, args.verify) {
            (true, _) => "--stats",
            (_, true) => "--verify",
            _ => "--print-scene",
        };
        return Err(Failure::usage(format!("{flag} and the picture can't both go to stdout: give -o a file name")));
    }
    if args.frames.is_some_and(|n| n > 1) && output.is_some_and(|o| !o.names_frames()) {
        return Err(Failure::usage(
            "--frames writes several files, expected {frame} in the name, as in -o f_{frame}.png",
        ));
    }
    if args.samples.is_some() && !matches!(args.backend.as_str(), "auto" | "reference") {
        return Err(Failure::usage(format!("--samples needs --backend reference, found {}", args.backend)));
    }
    match output.map(|o| o.format) {
        Some(Format::Exr { .. }) if args.png16 => Err(Failure::usage("--png16 is for PNG, but -o names an EXR file")),
        Some(Format::Png { .. }) if args.exr_f32 => Err(Failure::usage("--exr-f32 is for EXR, but -o names a PNG")),
        _ => Ok(()),
    }
}

fn start(args: &RenderArgs, threads: usize, console: &Console) -> Result<Backend, Failure> {
    let name = if args.samples.is_some() { "reference" } else { args.backend.as_str() };
    if name == "auto" {
        return choose(args, threads, console, |_| None);
    }
    let backend = Backend::by_name(name, &options(args, threads))?;
    introduce(&backend, console);
    Ok(backend)
}

/// The fastest backend that nothing speaks against, and a line on why it isn't a faster one.
fn choose(
    args: &RenderArgs,
    threads: usize,
    console: &Console,
    refuses: impl FnMut(&Capabilities) -> Option<String>,
) -> Result<Backend, Failure> {
    let Chosen { backend, passed_over } = Backend::choose(&options(args, threads), refuses)?;
    let slow = if backend.info().backend == "reference" { ", which is exact and slow" } else { "" };
    if !passed_over.is_empty() {
        let reasons = passed_over.join("; ");
        console.note(&format!("drawing with '{}'{slow} ({reasons})", backend.info().backend));
    } else if !slow.is_empty() {
        console.note("no fast backend is built into this program: drawing with 'reference', which is exact and slow");
    }
    introduce(&backend, console);
    Ok(backend)
}

fn options(args: &RenderArgs, threads: usize) -> BackendOptions {
    BackendOptions { threads, adapter: args.adapter.clone(), quantised: args.storage == "16" }
}

fn introduce(backend: &Backend, console: &Console) {
    let info = backend.info();
    let threads = if info.threads > 0 { format!(", {} threads", info.threads) } else { String::new() };
    console.detail(&format!("backend {}: {} ({}){threads}", info.backend, info.adapter, info.driver));
}

/// The resolved scene file on stdout: it gives the same picture.
fn print_scene(args: &RenderArgs, file: &SceneFile, console: &Console) -> Result<(), Failure> {
    for (given, flag) in [(args.texture.is_some(), "--texture"), (args.repair, "--repair")] {
        if given {
            console.note(&format!("a scene file can't say {flag}: give it again when you render the file"));
        }
    }
    let text = surfel::io::scene_file::to_json_pretty(file);
    if text.trim().is_empty() {
        return Err(Failure::other("the scene can't be written as JSON: an input's name is not UTF-8: rename it"));
    }
    console::result(text.as_bytes())
}

/// Camera of a frame, and the scene with its lights moved where they have to.
fn turned(resolved: &Resolved, index: u32, frames: u32) -> (Camera, Option<Scene>) {
    if index == 0 {
        return (resolved.file.camera.clone(), None);
    }
    let lights = resolved.scene.lights.clone().unwrap_or_default();
    let turn = f64::from(index) / f64::from(frames);
    let (camera, lights) = resolved.turntable.at(turn, &resolved.file.camera, &lights);
    let moved = (!lights.is_empty()).then(|| Scene { lights: Some(lights), ..resolved.scene.clone() });
    (camera, moved)
}

/// What stays from frame to frame.
struct Job<'a> {
    args: &'a RenderArgs,
    console: &'a Console,
    planes: Planes,
    runs: Vec<Stats>,
    frame: Frame,
    scene: Option<BackendScene>,
}

impl Job<'_> {
    fn upload(&self, backend: &mut Backend, scene: &Scene) -> Result<BackendScene, Failure> {
        let bar = self.console.progress();
        let mut last = None;
        Ok(backend.upload_reporting(scene, &mut |now| {
            match last {
                None => bar.stage("uploading", now.total_bytes),
                Some(before) => bar.advance(now.done_bytes.saturating_sub(before)),
            }
            last = Some(now.done_bytes);
        })?)
    }

    fn render(
        &mut self,
        backend: &mut Backend,
        resolved: &Resolved,
        camera: &Camera,
        moved: Option<Scene>,
    ) -> Result<(), Failure> {
        let view = camera::view(camera, self.args)?;
        let moved = match (resolved.hybrids.as_slice(), moved) {
            ([], moved) => moved,
            (hybrids, moved) => {
                let whole = moved.as_ref().unwrap_or(&resolved.scene);
                Some(surfel::at_detail(whole, hybrids, &view, self.args.lod_error)?)
            }
        };
        let resident = match (self.scene.take(), moved) {
            (_, Some(moved)) => self.upload(backend, &moved)?,
            (Some(resident), None) => resident,
            (None, None) => self.upload(backend, &resolved.scene)?,
        };
        let settings = &resolved.file.settings;
        let mut once = |planes| match self.args.samples {
            Some(n) => backend.render_supersampled(&resident, &view, settings, planes, n, &mut self.frame),
            None => backend.render(&resident, &view, settings, planes, &mut self.frame),
        };
        // The frame that isn't timed counts fragments, which takes some time.
        let counted = once(Planes { fragments: self.args.stats, ..self.planes })?;
        if let Some(repeat) = self.args.repeat {
            for _ in 0..repeat {
                self.runs.push(stats::with_fragments(once(self.planes)?, &counted));
            }
        } else {
            self.runs.push(counted);
        }
        self.scene = Some(resident);
        Ok(())
    }
}

fn metadata(args: &RenderArgs, camera: &Camera, file: &SceneFile, command: &str) -> Vec<(String, String)> {
    let json = |value: Result<String, serde_json::Error>| value.unwrap_or_default();
    let mut entries = vec![
        ("surfel:version", env!("CARGO_PKG_VERSION").to_owned()),
        ("surfel:camera", json(serde_json::to_string(camera))),
        ("surfel:settings", json(serde_json::to_string(&file.settings))),
        ("surfel:command", command.to_owned()),
    ];
    if let Some(r) = args.region {
        entries.push(("surfel:region", format!("{},{},{},{}", r.x, r.y, r.width, r.height)));
    }
    entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}
