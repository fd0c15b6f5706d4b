//! `surfel render`: draws images of scenes.

mod sequence;

use crate::console::{self, Console};
use crate::failure::Failure;
use crate::film::Film;
use crate::output::{self, Format, Output};
use crate::pieces::{self, Pictures};
use crate::resolve::{self, Resolved, Source, resolve};
use crate::series::{self, Series};
use crate::stats;
use crate::stdin::{self, Stdin, is_stdin};
use crate::stdout;
use crate::verify::{Verified, verify};
use serde_json::{Map, Value, json};
use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use surfel_app::film::FilmEncoder;
use surfel_app::options::Options;
use surfel_app::progressive::Detail;
use surfel_app::request::{self, RenderOptions};
use surfel_app::{blank_image, camera, metadata};
use surfel_backend::{Backend, BackendOptions, BackendScene};
use surfel_backend::{Chosen, refusals};
use surfel_io::ShowPath as _;
use surfel_io::atomic::target;
use surfel_load::paths;
use surfel_model::SceneFile;
use surfel_model::{Camera, Scene};
use surfel_render::{Capabilities, RendererInfo};
use surfel_render::{Frame, Planes, Preset, Renderer, Stats};
use surfel_sample::Progress as _;

pub(crate) fn run(args: &Options, threads: usize, console: &Console) -> Result<(), Failure> {
    let default = default_output(args);
    let output = args.output.as_deref().or(default.as_deref());
    let output =
        output.map(|o| Output::new(&pieces::with_tile(o, args), args.force, args.png16, args.exr_f32)).transpose()?;
    check(args, output.as_ref())?;
    let apart = !args.sequence && args.inputs.len() > 1 && output.as_ref().is_some_and(Output::names_inputs);
    let shared;
    let args = if apart && args.render.splats.shared_range {
        shared = with_shared_range(args, console)?;
        &shared
    } else {
        args
    };
    let mut session = Session::start(args, output, Stdin::default(), threads, console)?;
    if apart {
        return session.draw_each();
    }
    let label = args.inputs.first().map_or(Path::new(""), PathBuf::as_path);
    session.check_names(label)?;
    let drawn = if args.sequence {
        session.draw_sequence()?
    } else {
        session.draw(resolve::source(&args.inputs, &session.stdin)?, label)?
    };
    if args.names_output && args.output.is_none() {
        drawn.files.iter().for_each(|file| console.note(&format!("wrote {}", file.shown())));
    }
    if let Some(stats) = &drawn.stats {
        stdout::json_result(stats)?;
    } else if let Some(verified) = &drawn.verified {
        stdout::result(verified.text().as_bytes())?;
    }
    drawn.verified.map_or(Ok(()), |verified| verified.judge())
}

/// Returns the options with one range of values for the colours of all inputs, even of inputs that this run doesn't
/// draw.
fn with_shared_range(args: &Options, console: &Console) -> Result<Options, Failure> {
    let sources = args.inputs.iter().map(|input| match is_stdin(input) {
        true => Err(surfel_load::Error::Usage(
            "--range shared reads all inputs first, which stdin can't be: give files".into(),
        )),
        false => Source::of(std::slice::from_ref(input), None),
    });
    let progress = console.progress();
    let found = request::shared_coloring(sources, &args.render, None, &progress)?;
    drop(progress);
    let mut args = args.clone();
    args.render.splats.shared_range = false;
    if let Some(coloring) = found {
        args.render.splats.set_coloring(coloring);
    }
    Ok(args)
}

/// Returns the output of `surfel INPUT` without `-o`: the name of INPUT with .png, in the current folder. `None` for
/// other command lines.
pub(crate) fn default_output(args: &Options) -> Option<PathBuf> {
    let wanted = args.names_output && !args.print_scene && !args.stats && !args.render.verify;
    (wanted && args.inputs.len() == 1).then(|| "{input}.png".into())
}

/// State of a command that draws images of one scene, or of each of several inputs as its own scene.
pub(crate) struct Session<'a> {
    args: &'a Options,
    output: Option<Output>,
    stdin: Rc<Stdin>,
    threads: usize,
    console: &'a Console,
    /// Cameras for which images are drawn, and their names.
    series: Series,
    /// Video encoder, if the output is a film.
    encoder: Option<FilmEncoder>,
    /// Index of the first occurrence of each input on the command line, by path.
    input_numbers: HashMap<&'a Path, usize>,
    /// Selection of the images that this run draws, such as those of a shard.
    pictures: Pictures,
    /// Rendering backend; `None` if no image is drawn.
    backend: Option<Backend>,
}

/// Result of drawing all images of a scene or a sequence.
#[derive(Default)]
pub(crate) struct Drawn {
    /// Files written, one per frame, or a film; empty for stdout.
    pub(crate) files: Vec<PathBuf>,
    /// Statistics that `--stats` prints; `None` without the option.
    stats: Option<Value>,
    /// Measured errors that `--verify` prints; `None` without the option.
    verified: Option<Verified>,
}

impl<'a> Session<'a> {
    /// Creates the session, and starts the backend if any image is drawn.
    pub(crate) fn start(
        args: &'a Options,
        output: Option<Output>,
        stdin: Stdin,
        threads: usize,
        console: &'a Console,
    ) -> Result<Self, Failure> {
        let draws = output.is_some() || args.stats || args.render.verify;
        let series = Series::of(args, output.as_ref())?;
        let encoder = output.as_ref().and_then(Output::film).map(FilmEncoder::find).transpose()?;
        let names_inputs = !args.sequence && output.as_ref().is_some_and(Output::names_inputs);
        let inputs = if names_inputs { args.inputs.len() } else { 1 };
        let frames = (series.count(), encoder.is_some());
        let pictures = if draws { Pictures::of(args, inputs, frames, console)? } else { Pictures::default() };
        let backend = if draws { Some(start(args, threads, console)?) } else { None };
        let input_numbers = args.inputs.iter().enumerate().rev().map(|(i, input)| (input.as_path(), i)).collect();
        let stdin = Rc::new(stdin);
        Ok(Self { args, output, stdin, threads, console, series, encoder, input_numbers, pictures, backend })
    }

    /// Returns the numbers of the frames that are drawn of the input with the path `label`.
    fn frames_of(&self, label: &Path) -> &[u32] {
        self.pictures.of_input(self.input_numbers.get(label).copied().unwrap_or(0))
    }

    /// Returns the file name of a frame's image, or of the film; `None` for stdout.
    fn path(&self, backend: &Backend, label: &Path, frame: u32) -> Option<PathBuf> {
        let input = self.args.inputs.get(frame as usize).filter(|_| self.args.sequence);
        let input = input.map_or(label, PathBuf::as_path);
        self.output.as_ref()?.path(backend.info().backend, frame, self.series.name(frame), input)
    }

    /// Returns the file names of all frames of an input; empty for stdout and for films.
    fn paths(&self, backend: &Backend, label: &Path) -> Vec<PathBuf> {
        let frames = if self.encoder.is_some() { &[] } else { self.frames_of(label) };
        frames.iter().filter_map(|frame| self.path(backend, label, *frame)).collect()
    }

    /// Returns the files written for an input: one per frame, or a film; empty for stdout.
    fn names(&self, backend: &Backend, label: &Path) -> Vec<PathBuf> {
        match (&self.encoder, self.frames_of(label).first()) {
            (Some(_), Some(first)) => self.path(backend, label, *first).into_iter().collect(),
            _ => self.paths(backend, label),
        }
    }

    /// Creates the film of an input; `None` if the output isn't a film.
    fn film(&self, backend: &Backend, label: &Path, frames: usize) -> Option<Film<'_>> {
        let (output, encoder) = (self.output.as_ref()?, self.encoder.as_ref()?);
        let path = self.names(backend, label).into_iter().next()?;
        Some(Film::new(&path, output, encoder, frames as u32, series::rate(self.args)))
    }

    /// Checks that the image files of an input can be written ([`Output::check`]). Called before anything is drawn.
    pub(crate) fn check_names(&self, label: &Path) -> Result<(), Failure> {
        self.check_distinct_files(&[label])?;
        let (Some(output), Some(backend)) = (&self.output, &self.backend) else { return Ok(()) };
        self.names(backend, label).iter().filter(|path| !self.skips(path)).try_for_each(|path| output.check(Some(path)))
    }

    /// Refuses two files with one name, and an output that is an input, also through links, because one file would be
    /// lost.
    fn check_distinct_files(&self, labels: &[&Path]) -> Result<(), Failure> {
        let Some(backend) = &self.backend else { return Ok(()) };
        let bar = self.args.render.splats.colorbar.as_ref();
        let inputs: HashSet<PathBuf> =
            labels.iter().filter(|label| !is_stdin(label)).map(|label| target(label)).collect();
        let mut owners: HashMap<PathBuf, (&Path, PathBuf)> = HashMap::new();
        for label in labels {
            let images = self.names(backend, label).into_iter();
            for file in images.chain(bar.map(|bar| output::of_input(bar, label))) {
                if inputs.contains(&target(&file)) {
                    return Err(Failure::usage(format!("{} is an input, too, expected another name", file.shown())));
                }
                let Some((other, path)) = owners.insert(target(&file), (label, file.clone())) else { continue };
                let [one, two] = [other, label].map(stdin::display);
                return Err(Failure::usage(if other == *label {
                    let (path, file) = (path.shown(), file.shown());
                    format!("{path} and {file} are one file, expected another name for each")
                } else {
                    let file = file.shown();
                    format!(
                        "{one} and {two} would both be written to {file}, expected inputs of different names: draw \
                         them by two commands"
                    )
                }));
            }
        }
        Ok(())
    }

    /// True if the image exists already and `--skip-existing` is set, so that it isn't drawn.
    fn skips(&self, path: &Path) -> bool {
        self.args.skip_existing && path.is_file()
    }

    /// Draws each input as its own image, in order. A failure is reported, and the next image is drawn. The exit code
    /// is that of the first failure.
    fn draw_each(&mut self) -> Result<(), Failure> {
        let inputs = &self.args.inputs;
        self.check_distinct_files(&inputs.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
        let (mut failed, mut first, mut stats) = (0, 0, Vec::new());
        for input in inputs {
            if self.frames_of(input).is_empty() {
                continue;
            }
            match self.draw_one(input) {
                Ok(of_input) => stats.extend(of_input),
                Err(failure) => {
                    failed += 1;
                    first = if first == 0 { failure.code() } else { first };
                    let (name, message) = (stdin::display(input).to_string(), failure.message());
                    let named = message.contains(&name);
                    console::error(&if named { message.to_owned() } else { format!("{name}: {message}") });
                }
            }
        }
        if self.args.stats {
            stdout::json_result(&Value::Array(stats))?;
        }
        match failed {
            0 => Ok(()),
            _ => Err(Failure::with_code(first, format!("{failed} of {} images failed, as said above", inputs.len()))),
        }
    }

    /// Draws one of several inputs, and returns its statistics if the options ask for them.
    fn draw_one(&mut self, input: &Path) -> Result<Option<Value>, Failure> {
        self.check_names(input)?;
        let source = resolve::source(&[input.to_path_buf()], &self.stdin)?;
        let drawn = self.draw(source, input)?;
        if let Some(verified) = &drawn.verified {
            if !self.args.stats {
                stdout::result(format!("{}\n{}", stdin::display(input), verified.text()).as_bytes())?;
            }
            verified.judge()?;
        }
        Ok(drawn.stats.map(|mut stats| {
            stats["input"] = stdin::display(input).to_string().into();
            stats
        }))
    }

    /// Draws all frames of a scene. `label` is the input that `{input}` stands for in the output's name.
    pub(crate) fn draw(&mut self, source: Source, label: &Path) -> Result<Drawn, Failure> {
        let (args, console) = (self.args, self.console);
        if let Some(backend) = self.backend.as_ref().filter(|_| !args.print_scene) {
            let (frames, names) = (self.frames_of(label).len(), self.names(backend, label));
            let expected = if self.encoder.is_some() { frames.min(1) } else { frames };
            if names.iter().filter(|path| self.skips(path)).count() == expected && names.len() == expected {
                if expected > 0 {
                    console.note(&format!("all of {expected} pictures exist, so that none is drawn"));
                }
                let stats = args.stats.then(|| json!({ "frames": 0, "runs": 0 }));
                return Ok(Drawn { stats, ..Drawn::default() });
            }
        }
        if args.progressive {
            self.check_progressive(label)?;
        }
        let (pictures, stdin) = (self.series.pictures.clone(), Rc::clone(&self.stdin));
        let mut drawn = Drawn::default();
        resolve(source, &pictures, args, &stdin, console, &mut |resolved, detail| {
            drawn = self.draw_scene(resolved, detail, label)?;
            Ok(())
        })?;
        Ok(drawn)
    }

    /// Refuses outputs of `--progressive` other than a single file, since the file is rewritten.
    fn check_progressive(&self, label: &Path) -> Result<(), Failure> {
        let Some(backend) = &self.backend else { return Ok(()) };
        let names = self.names(backend, label);
        let frames = self.frames_of(label).len();
        if frames > 1 {
            let what = format!("--progressive is of one picture, but this draws {frames}: leave it out");
            return Err(Failure::usage(what));
        }
        match names.first() {
            Some(path) if path.exists() && !path.is_file() => {
                let what = format!("-o {}: --progressive rewrites a file, and this is none", path.shown());
                Err(Failure::usage(what))
            }
            _ => Ok(()),
        }
    }

    /// Returns another backend if the current one was selected automatically and can't draw the scene.
    fn suitable(&self, backend: &Backend, resolved: &Resolved, planes: Planes) -> Result<Option<Backend>, Failure> {
        let refuses = refusals(&resolved.scene, &resolved.file.settings, planes);
        if self.args.backend_name() != "auto" || refuses(&backend.info().capabilities).is_none() {
            return Ok(None);
        }
        choose(self.args, self.threads, self.console, refuses).map(Some)
    }

    /// Draws all frames of a loaded scene.
    fn draw_scene(&mut self, resolved: Resolved, detail: Detail, label: &Path) -> Result<Drawn, Failure> {
        let args = self.args;
        camera::view(&resolved.file.camera, &args.render)?;
        if args.print_scene && detail == Detail::Full {
            print_scene(&resolved.file)?;
        }
        let Some(mut backend) = self.backend.take() else { return Ok(Drawn::default()) };
        let planes = planes(&args.render, args.render.verify, self.output.as_ref());
        let mut other = self.suitable(&backend, &resolved, planes)?;
        let result = self.draw_by(other.as_mut().unwrap_or(&mut backend), resolved, detail, planes, label);
        // The next image may be drawn by the fastest backend again.
        self.backend = Some(backend);
        if let (Detail::Coarse, Some(output)) = (detail, &mut self.output) {
            output.replace();
        }
        result
    }

    fn draw_by(
        &self,
        backend: &mut Backend,
        mut resolved: Resolved,
        detail: Detail,
        planes: Planes,
        label: &Path,
    ) -> Result<Drawn, Failure> {
        let (args, console) = (self.args, self.console);
        let names = self.paths(backend, label);
        let frame_and_name = |(i, &frame): (usize, &u32)| (frame, names.get(i).map(PathBuf::as_path));
        let mut pictures: Vec<_> = self.frames_of(label).iter().enumerate().map(frame_and_name).collect();
        let all = pictures.len();
        pictures.retain(|(_, path)| !path.is_some_and(|path| self.skips(path)));
        if pictures.len() < all {
            console.note(&format!("left out {} of {all} pictures, which exist", all - pictures.len()));
        }
        if let Some(output) = &self.output {
            pictures.iter().try_for_each(|(_, path)| output.check(*path))?;
        }
        let last_upload = pictures.len() == 1 && !args.render.verify;
        let mut job = Job::new(args, console, planes, last_upload);
        let mut sink = Sink::new(self.film(backend, label, pictures.len()));
        let (mut carried, frames) = (None, pictures.len() as u32);
        for (index, path) in pictures {
            let (camera, moved) = resolved.picture(&self.series.pictures, index);
            job.render(backend, &mut resolved, detail, &camera, moved.as_ref())?;
            if detail == Detail::Coarse {
                if let (Some(output), Some(path)) = (&self.output, path) {
                    // A coarse image has no metadata, because its metadata would describe the final image that replaces
                    // it.
                    output.write(Some(path), &job.frame, resolved.file.background, Vec::new())?;
                    console.detail(&format!("{}: a coarse picture, which a finer one replaces", path.shown()));
                }
                continue;
            }
            let lights = moved.map_or_else(|| resolved.file.lights.clone(), |moved| moved.lights);
            let scene = SceneFile { camera, lights, ..resolved.file.clone() };
            self.put(&mut sink, path, &job, (&scene, &resolved.beside), (backend, &mut carried))?;
        }
        if detail == Detail::Coarse {
            return Ok(Drawn::default());
        }
        let why = job.why_blank.unwrap_or_else(|| blank_image::why_blank(&resolved.scene));
        let files = sink.finish(console, frames, is_whole(args).then_some(why))?;
        let verified = if args.render.verify {
            let view = camera::view(&resolved.file.camera, &args.render)?;
            let drawn = (backend.info().backend, &job.frame);
            let promised = promised(args, &resolved);
            Some(verify(&resolved.file.settings, promised, &resolved.scene, &view, self.threads, drawn)?)
        } else {
            None
        };
        let stats = args.stats.then(|| {
            let size = [job.frame.width(), job.frame.height()];
            let mut stats = stats::json(&job.runs, backend.info(), size, frames, promised(args, &resolved));
            if let Some(verified) = &verified {
                stats["verify"] = verified.json();
            }
            stats
        });
        Ok(Drawn { files, stats, verified })
    }

    /// Writes a drawn frame as an image, or appends it to the film. `carried` caches the hashes of the inputs.
    fn put(
        &self,
        sink: &mut Sink<'_>,
        path: Option<&Path>,
        job: &Job<'_>,
        (scene, beside): (&SceneFile, &BTreeSet<PathBuf>),
        (backend, carried): (&Backend, &mut Option<Vec<metadata::Input>>),
    ) -> Result<(), Failure> {
        let console = self.console;
        sink.blank += u32::from(blank_image::is_blank(&job.frame, scene.background));
        if let Some(film) = &mut sink.film {
            film.push(&job.frame, scene.background, console)?;
        } else if let Some(output) = &self.output {
            let metadata = self.metadata(output, path, (scene, beside), backend, carried)?;
            self.note_missing_alpha(output, path, &job.frame, scene.background);
            match output.write(path, &job.frame, scene.background, metadata) {
                // Another run has written the same image meanwhile.
                Err(_) if path.is_some_and(|path| self.skips(path)) => {}
                written => written?,
            }
            sink.files.extend(path.map(Path::to_path_buf));
        }
        if let (Some(path), Some(last)) = (path, job.runs.last()) {
            console.detail(&format!("{}: {:.1} ms, {} splats", path.shown(), last.frame_ms, last.splats));
        }
        Ok(())
    }

    /// Returns the metadata of the image at `path`. They are empty with `--no-metadata`, for formats that store none,
    /// and, with a note, if a path isn't UTF-8. `carried` caches the hashes of the inputs from frame to frame.
    fn metadata(
        &self,
        output: &Output,
        path: Option<&Path>,
        (scene, beside): (&SceneFile, &BTreeSet<PathBuf>),
        backend: &Backend,
        carried: &mut Option<Vec<metadata::Input>>,
    ) -> Result<Vec<(String, String)>, Failure> {
        if self.args.no_metadata || matches!(output.format, Format::Jpeg | Format::Npz | Format::Film) {
            return Ok(Vec::new());
        }
        let inputs = match carried.take() {
            Some(inputs) => inputs,
            None => {
                let objects = scene.objects.iter().flat_map(|o| [&o.splats, &o.mesh]).flatten();
                let bytes =
                    if objects.into_iter().any(|path| is_stdin(path)) { Some(self.stdin.bytes()?) } else { None };
                metadata::inputs(scene, beside, bytes.as_deref())?
            }
        };
        let drawn = drawn(self.args, &self.args.render, &scene.camera, backend.info(), output.format)?;
        let is_exr = matches!(output.format, Format::Exr { .. });
        let entries = metadata::entries(Output::folder(path), scene, &inputs, &drawn, is_exr)?;
        *carried = Some(inputs);
        Ok(entries.unwrap_or_else(|| {
            let what = "the image carries no scene, because the name of an input or of its folder is not UTF-8";
            self.console.note(what);
            Vec::new()
        }))
    }

    /// Prints a note if an image has alpha but its format, JPEG, doesn't.
    fn note_missing_alpha(&self, output: &Output, path: Option<&Path>, frame: &Frame, [r, g, b, _]: [f64; 4]) {
        let (Format::Jpeg, Some(path)) = (output.format, path) else { return };
        if frame.color().iter().any(|c| c[3] < 1.0) {
            self.console.note(&format!(
                "{}: a JPEG has no transparency, so the image is blended onto the background's colour {r},{g},{b}",
                path.shown()
            ));
        }
    }
}

/// Returns the options that, together with the scene, determine an image, as the image's metadata stores them.
pub(crate) fn drawn(
    args: &Options,
    options: &RenderOptions,
    camera: &Camera,
    info: &RendererInfo,
    format: Format,
) -> Result<Map<String, Value>, Failure> {
    let mut drawn = metadata::drawn(options, camera, args.quantised, info)?;
    match format {
        Format::Png { sixteen: true } => drawn.insert("png16".to_owned(), json!(true)),
        Format::Exr { f32_color: true } => drawn.insert("exr-f32".to_owned(), json!(true)),
        _ => None,
    };
    Ok(drawn)
}

/// Returns the preset that the settings match, whose promise of accuracy then applies. `None` if they match no preset,
/// and with 16-bit storage.
fn promised(args: &Options, resolved: &Resolved) -> Option<Preset> {
    Preset::of(&resolved.file.settings).filter(|_| !args.quantised)
}

/// True if the options request planes that the files of planes don't always contain.
fn asks_for_planes(args: &Options) -> bool {
    !args.render.planes.is_empty() || args.render.label.is_some()
}

/// Returns the planes that the output needs.
fn planes(options: &RenderOptions, verifies: bool, output: Option<&Output>) -> Planes {
    options.planes_besides(match output.map(|output| output.format) {
        Some(format) if format.has_planes() => Planes::ALL,
        Some(Format::Png { sixteen: false } | Format::Film) if !verifies => Planes::RGBA8,
        _ => Planes::COLOR,
    })
}

/// Refuses combinations of flags that contradict each other.
fn check(args: &Options, output: Option<&Output>) -> Result<(), Failure> {
    let stdout = output.is_some_and(Output::is_stdout);
    pieces::check(args, output.is_some_and(|output| !output.is_stdout()))?;
    series::check(args, output)?;
    if output.is_none() && !args.print_scene && !args.stats && !args.render.verify {
        let expected = match args.inputs.len() {
            1 => "expected -o OUT.png, .jpg, .exr or .npz (or --print-scene, --stats, --verify)",
            _ => "expected -o OUT.png for one image of all inputs, or -o {input}.png for an image of each",
        };
        return Err(Failure::usage(format!("no output is given, {expected}")));
    }
    if args.progressive && (stdout || output.is_none()) {
        return Err(Failure::usage("--progressive rewrites a file: give -o a file name"));
    }
    if args.progressive && args.inputs.len() > 1 && output.is_some_and(Output::names_inputs) {
        return Err(Failure::usage("--progressive is of one picture, but -o has {input}: an image of each input"));
    }
    if args.print_scene && args.inputs.len() > 1 && output.is_some_and(Output::names_inputs) {
        return Err(Failure::usage("--print-scene is for one scene, but -o has {input}: an image of each input"));
    }
    if stdout && (args.stats || args.print_scene || args.render.verify) {
        let flag = match (args.stats, args.render.verify) {
            (true, _) => "--stats",
            (_, true) => "--verify",
            _ => "--print-scene",
        };
        return Err(Failure::usage(format!("{flag} and the image can't both go to stdout: give -o a file name")));
    }
    if args.render.samples.is_some() && !matches!(args.backend_name(), "auto" | "reference") {
        return Err(Failure::usage(format!("--samples needs --backend reference, found {}", args.backend_name())));
    }
    if let Some(format) = output.map(|o| o.format).filter(|format| !format.has_planes())
        && asks_for_planes(args)
    {
        let found = match format {
            Format::Film => "a film",
            Format::Jpeg => "a JPEG",
            _ => "a PNG",
        };
        let flag = if args.render.planes.is_empty() { "--label" } else { "--planes" };
        let message = format!("{flag} is for EXR and NPZ, but -o names {found}, which holds colour alone");
        return Err(Failure::usage(message));
    }
    if args.render.samples.is_some() && asks_for_planes(args) {
        return Err(Failure::usage("--samples averages, and planes of what is nearest have no mean: leave out one"));
    }
    match output.map(|o| o.format) {
        Some(Format::Npz) if args.png16 => Err(Failure::usage("--png16 is for PNG, but -o names an NPZ file")),
        Some(Format::Npz) if args.exr_f32 => Err(Failure::usage("--exr-f32 is for EXR, but -o names an NPZ file")),
        Some(Format::Exr { .. }) if args.png16 => Err(Failure::usage("--png16 is for PNG, but -o names an EXR file")),
        Some(Format::Jpeg) if args.png16 => Err(Failure::usage("--png16 is for PNG, but -o names a JPEG")),
        Some(Format::Jpeg) if args.exr_f32 => Err(Failure::usage("--exr-f32 is for EXR, but -o names a JPEG")),
        Some(Format::Png { .. }) if args.exr_f32 => Err(Failure::usage("--exr-f32 is for EXR, but -o names a PNG")),
        _ => Ok(()),
    }
}

pub(crate) fn start(args: &Options, threads: usize, console: &Console) -> Result<Backend, Failure> {
    let name = if args.render.samples.is_some() { "reference" } else { args.backend_name() };
    if name == "auto" {
        return choose(args, threads, console, |_| None);
    }
    let backend = Backend::by_name(name, &backend_options(args, threads))?;
    print_backend(&backend, console);
    Ok(backend)
}

/// Starts the fastest backend that `refuses` accepts. Prints a note with the reasons why faster backends weren't
/// chosen.
pub(crate) fn choose(
    args: &Options,
    threads: usize,
    console: &Console,
    refuses: impl FnMut(&Capabilities) -> Option<String>,
) -> Result<Backend, Failure> {
    let Chosen { backend, rejected } = Backend::choose(&backend_options(args, threads), refuses)?;
    let slow = if backend.info().backend == "reference" { ", which is exact and slow" } else { "" };
    if !rejected.is_empty() {
        let reasons = rejected.join("; ");
        console.note(&format!("drawing with '{}'{slow} ({reasons})", backend.info().backend));
    } else if !slow.is_empty() {
        console.note("no fast backend is built into this program: drawing with 'reference', which is exact and slow");
    }
    print_backend(&backend, console);
    Ok(backend)
}

pub(crate) fn backend_options(args: &Options, threads: usize) -> BackendOptions {
    let options = BackendOptions::default().with_threads(threads).with_quantised(args.quantised);
    options.with_adapter(args.adapter.clone())
}

fn print_backend(backend: &Backend, console: &Console) {
    let info = backend.info();
    let threads = if info.threads > 0 { format!(", {} threads", info.threads) } else { String::new() };
    console.detail(&format!("backend {}: {} ({}){threads}", info.backend, info.adapter, info.driver));
}

/// Prints the resolved scene file on stdout, with paths relative to the current folder. Rendering the file from this
/// folder gives the same image.
fn print_scene(file: &SceneFile) -> Result<(), Failure> {
    let text = surfel_io::scene_file::to_json_pretty(&paths::relative_to(Path::new("."), file)?);
    if text.trim().is_empty() {
        return Err(Failure::other("the scene can't be written as JSON: an input's name is not UTF-8: rename it"));
    }
    stdout::result(text.as_bytes())
}

/// True if whole images are drawn. A tile or region may well be blank.
fn is_whole(args: &Options) -> bool {
    args.render.tile.is_none() && args.render.region.is_none()
}

/// Destination of the frames of a scene or a sequence.
struct Sink<'a> {
    /// Film to which the frames are appended; `None` if each frame is an image file.
    film: Option<Film<'a>>,
    /// Paths of the files that have been written.
    files: Vec<PathBuf>,
    /// Number of frames in which nothing is visible, for a note.
    blank: u32,
}

impl<'a> Sink<'a> {
    fn new(film: Option<Film<'a>>) -> Self {
        Self { film, files: Vec::new(), blank: 0 }
    }

    /// Completes a film of `frames` frames, and returns all files. Prints a note if frames are blank and `why`, the
    /// likely reason, is given.
    fn finish(self, console: &Console, frames: u32, why: Option<&str>) -> Result<Vec<PathBuf>, Failure> {
        let Self { film, mut files, blank } = self;
        if let Some(film) = film.filter(|_| frames > 0) {
            files.push(film.finish(console)?);
        }
        if let Some(why) = why.filter(|_| blank > 0) {
            let of_all = if frames > 1 { format!(" in {blank} of {frames} pictures") } else { String::new() };
            console.note(&format!("nothing is seen{of_all}: {why}"));
        }
        Ok(files)
    }
}

/// State that is shared by the frames of one scene while they are drawn.
struct Job<'a> {
    args: &'a Options,
    console: &'a Console,
    planes: Planes,
    /// True if the scene is uploaded only once, so that its geometry can be freed after the upload.
    last_upload: bool,
    runs: Vec<Stats>,
    frame: Frame,
    scene: Option<BackendScene>,
    /// Likely reason for which images are blank, for a note; `None` if no reason is needed. It is determined before the
    /// scene's geometry is freed.
    why_blank: Option<&'static str>,
}

impl<'a> Job<'a> {
    fn new(args: &'a Options, console: &'a Console, planes: Planes, last_upload: bool) -> Self {
        let (runs, frame) = (Vec::new(), Frame::default());
        Self { args, console, planes, last_upload, runs, frame, scene: None, why_blank: None }
    }

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
        resolved: &mut Resolved,
        detail: Detail,
        camera: &Camera,
        moved: Option<&Scene>,
    ) -> Result<(), Failure> {
        let view = camera::view(camera, &self.args.render)?;
        let resident = match (self.scene.take(), moved) {
            (Some(mut resident), Some(moved)) => match backend.update(&mut resident, moved)? {
                true => resident,
                false => self.upload(backend, moved)?,
            },
            (None, Some(moved)) => self.upload(backend, moved)?,
            (Some(resident), None) => resident,
            (None, None) => {
                let resident = self.upload(backend, &resolved.scene)?;
                if self.last_upload {
                    self.why_blank = Some(blank_image::why_blank(&resolved.scene));
                    resolved.scene.objects = Vec::new();
                }
                resident
            }
        };
        let settings = &resolved.file.settings;
        let bar = self.console.progress();
        bar.stage("drawing", 0);
        let samples = self.args.render.samples;
        let mut once = |planes| backend.render_sampled(&resident, &view, settings, planes, samples, &mut self.frame);
        // The frame that isn't timed also counts fragments, because counting takes time.
        let counted = once(self.planes.with_fragments(self.args.stats))?;
        if let Some(repeat) = self.args.repeat.filter(|_| detail == Detail::Full) {
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
