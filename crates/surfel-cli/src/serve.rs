//! `surfel serve --stdio`: draws images of one scene on request.
//!
//! A request is a line of JSON on stdin. Its answer is a line of JSON on stdout, in the order of the requests. A
//! request that fails is answered by an error message, and the next one is read.

use crate::console::Console;
use crate::failure::Failure;
use crate::output::{self, Format, Output};
use crate::render::{backend_options, drawn, start};
use crate::stdin::is_stdin;
use crate::stdout;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use surfel_app::metadata::{self, Input};
use surfel_app::options::Options;
use surfel_app::{camera, session::Session, values};
use surfel_io::lines::{Line, read_line};
use surfel_load::scene::is_scene_file;
use surfel_model::Camera;
use surfel_model::SceneFile;
use surfel_render::{Planes, Region, Renderer as _};

/// Largest accepted length of a request, in bytes.
const MAX_LINE: usize = 1 << 16;
/// Largest accepted number of pixels of an image; larger images have to be drawn by regions.
const MAX_PIXELS: usize = 1 << 26;

/// Number of pixels of an image up to which its memory is reused for the next one. The memory of larger images is
/// freed.
const MAX_REUSED_PIXELS: usize = 1 << 22;

pub(crate) fn run(args: &Options, threads: usize, console: &Console) -> Result<(), Failure> {
    check(args)?;
    let mut server = Server::start(args, threads, console)?;
    let mut input = std::io::stdin().lock();
    let mut line = Vec::new();
    loop {
        let answer = match read_line(&mut input, &mut line, MAX_LINE) {
            Ok(Line::End) => return Ok(()),
            Ok(Line::Whole) if line.trim_ascii().is_empty() => continue,
            Ok(Line::Whole) => server.answer(&line),
            Ok(Line::TooLong) => {
                let message = format!("the line has more than {MAX_LINE} bytes, expected a request");
                json!({ "ok": false, "error": message, "code": 3 })
            }
            Err(error) => return Err(Failure::input(format!("stdin: cannot read it: {error}"))),
        };
        stdout::result(format!("{answer}\n").as_bytes())?;
    }
}

/// Refuses stdin as an input, because stdin has the requests.
fn check(args: &Options) -> Result<(), Failure> {
    if args.inputs.iter().any(|path| is_stdin(path)) {
        return Err(Failure::usage("-: stdin has the requests, expected a scene file, splats, points or meshes"));
    }
    Ok(())
}

/// A request for an image.
#[derive(Debug)]
struct Request {
    output: PathBuf,
    camera: Option<Camera>,
    view: Option<surfel_framing::ViewChoice>,
    size: Option<[u32; 2]>,
    region: Option<Region>,
    planes: Option<Planes>,
    force: bool,
}

/// Parses a request. The error describes the problem for the client.
fn parse(object: &Value) -> Result<Request, String> {
    let mut request = Request {
        output: PathBuf::new(),
        camera: None,
        view: None,
        size: None,
        region: None,
        planes: None,
        force: false,
    };
    for (key, value) in object.as_object().ok_or("is no JSON object, expected {\"output\": \"a.png\", ...}")? {
        let wrong = |what: &str| format!("{key}: expected {what}, found {value}");
        match key.as_str() {
            "id" => {}
            "output" => request.output = value.as_str().ok_or_else(|| wrong("a file's name"))?.into(),
            "camera" => {
                let camera: Camera = serde_json::from_value(value.clone()).map_err(|e| format!("camera: {e}"))?;
                camera.validate().map_err(|e| e.to_string())?;
                request.camera = Some(camera);
            }
            "view" => {
                let text = value.as_str().ok_or_else(|| wrong("a view's name or \"AZIMUTH,ELEVATION\""))?;
                request.view = Some(values::view(text).map_err(|e| format!("view: {e}"))?);
            }
            "size" => {
                let [w, h] = whole_numbers(value).ok_or_else(|| wrong("[WIDTH, HEIGHT] in pixels"))?;
                request.size = Some(values::size(&format!("{w}x{h}")).map_err(|e| format!("size: {e}"))?);
            }
            "region" => {
                let [x, y, width, height] =
                    whole_numbers(value).ok_or_else(|| wrong("[X, Y, WIDTH, HEIGHT] in pixels"))?;
                request.region = Some(Region { x, y, width, height });
            }
            "planes" => {
                let names = value.as_array().ok_or_else(|| wrong("a list of color, depth, normal, weight"))?;
                let mut planes = Planes::COLOR;
                for name in names {
                    planes = match name.as_str() {
                        Some("color") => planes,
                        Some("depth") => planes.with_depth(true),
                        Some("normal") => planes.with_normal(true),
                        Some("weight") => planes.with_weight(true),
                        _ => return Err(wrong("a list of color, depth, normal, weight")),
                    };
                }
                request.planes = Some(planes);
            }
            "force" => request.force = value.as_bool().ok_or_else(|| wrong("true or false"))?,
            _ => {
                return Err(format!(
                    "there is no key '{key}', expected output, camera, view, size, region, planes, force or id"
                ));
            }
        }
    }
    if request.output.as_os_str().is_empty() {
        return Err("has no output, expected the name of a file that ends in .png, .jpg or .exr".to_owned());
    }
    if is_stdin(&request.output) {
        return Err("output: expected a file's name, because answers go to stdout".to_owned());
    }
    Ok(request)
}

fn whole_numbers<const N: usize>(value: &Value) -> Option<[u32; N]> {
    let numbers: Option<Vec<u32>> = value.as_array()?.iter().map(|v| u32::try_from(v.as_u64()?).ok()).collect();
    numbers?.try_into().ok()
}

/// Server of one scene, which is in memory with its backend.
struct Server<'a> {
    args: &'a Options,
    session: Session,
    /// Names and hashes of the input files, which the metadata of every image contains.
    inputs: Vec<Input>,
}

impl<'a> Server<'a> {
    fn start(args: &'a Options, threads: usize, console: &Console) -> Result<Self, Failure> {
        let backend = start(args, threads, console)?;
        let choice = (args.backend_name(), backend_options(args, threads));
        let mut session = Session::with_backend(args.inputs.clone(), None, backend, choice).for_any_camera();
        let mut options = args.render.clone();
        let first = args.inputs.first().map_or(Path::new(""), PathBuf::as_path);
        if let Some(bar) = options.splats.colorbar.as_mut().filter(|_| !is_scene_file(first)) {
            *bar = output::of_input(bar, first);
        }
        let (progress, mut notes) = (console.progress(), Vec::new());
        let shown = session.show(&options, &progress, &mut |note| notes.push(note)).map(|_| ());
        drop(progress);
        notes.iter().for_each(|note| console.note(note));
        shown?;
        let inputs = if args.no_metadata { Vec::new() } else { session.hashes()? };
        console.note(&format!("ready: the scene is in memory, drawn by '{}'", session.backend().info().backend));
        Ok(Self { args, session, inputs })
    }

    /// Returns the answer to a line of the input, which may contain anything.
    fn answer(&mut self, line: &[u8]) -> Value {
        let request: Value = match serde_json::from_slice(line) {
            Ok(request) => request,
            Err(error) => {
                return json!({ "ok": false, "error": format!("the line is not JSON: {error}"), "code": 3 });
            }
        };
        let drawn = parse(&request).map_err(Failure::input).and_then(|request| self.draw(&request));
        let mut answer = match drawn {
            Ok(answer) => answer,
            Err(failure) => json!({ "ok": false, "error": failure.message(), "code": failure.code() }),
        };
        if let Some(id) = request.get("id") {
            answer["id"] = id.clone();
        }
        answer
    }

    fn draw(&mut self, request: &Request) -> Result<Value, Failure> {
        let path = request.output.as_path();
        let output = Output::still(path, request.force || self.args.force, self.args.png16, self.args.exr_f32)?;
        output.check(Some(path))?;
        // The scene's camera already includes the camera flags of the command line. The fields of the request act like
        // further flags.
        let mut said = self.args.render.clone();
        (said.view, said.size, said.region) = (request.view, request.size, request.region);
        (said.eye, said.target, said.camera_up, said.fov_y, said.ortho) = (None, None, None, None, false);
        let resolved = self.session.shown().ok_or_else(|| Failure::other("no scene is in memory"))?;
        let camera = resolved.seen(request.camera.as_ref(), &said);
        let (scene, background) =
            (SceneFile { camera: camera.clone(), ..resolved.file.clone() }, resolved.scene.background);
        let view = camera::view(&camera, &said)?;
        if view.pixels() > MAX_PIXELS {
            return Err(Failure::input(format!(
                "the picture has {} pixels, expected at most {MAX_PIXELS}: draw it by regions",
                view.pixels()
            )));
        }
        let planes = match output.format {
            Format::Exr { .. } => request.planes.unwrap_or(Planes::ALL),
            _ if request.planes.is_some_and(|planes| planes != Planes::COLOR) => {
                return Err(Failure::input("planes: only an EXR holds more than the colour, expected output in .exr"));
            }
            _ => Planes::COLOR,
        };
        let stats = self.session.draw_from(&camera, &said, planes)?;
        let metadata = if self.args.no_metadata || output.format == Format::Jpeg {
            Vec::new()
        } else {
            let drawn = drawn(self.args, &said, &scene.camera, self.session.backend().info(), output.format)?;
            let is_exr = matches!(output.format, Format::Exr { .. });
            let entries = metadata::entries(Output::folder(Some(path)), &scene, &self.inputs, &drawn, is_exr)?;
            entries.unwrap_or_default()
        };
        let frame = self.session.frame();
        let written = output.write(Some(path), frame, background, metadata);
        let (width, height) = (frame.width(), frame.height());
        if view.pixels() > MAX_REUSED_PIXELS {
            self.session.release_memory();
        }
        written?;
        Ok(json!({
            "ok": true,
            "path": path,
            "stats": { "frame_ms": stats.frame_ms, "splats": stats.splats, "drawn": stats.drawn,
                       "width": width, "height": height },
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_that_say_something_else_are_refused() {
        for bad in [
            "[]",
            "3",
            "{}",
            r#"{"output": 3}"#,
            r#"{"output": "-"}"#,
            r#"{"output": "a.png", "what": 1}"#,
            r#"{"output": "a.png", "size": [0, 5]}"#,
            r#"{"output": "a.png", "size": [5]}"#,
            r#"{"output": "a.png", "size": [4294967296, 5]}"#,
            r#"{"output": "a.png", "region": [-1, 0, 1, 1]}"#,
            r#"{"output": "a.png", "view": "somewhere"}"#,
            r#"{"output": "a.png", "camera": {}}"#,
            r#"{"output": "a.png", "planes": ["colour"]}"#,
            r#"{"output": "a.png", "force": 1}"#,
        ] {
            assert!(parse(&serde_json::from_str(bad).unwrap()).is_err(), "{bad}");
        }
        let good = r#"{"id": [1], "output": "a.exr", "size": [5, 7], "view": "30,20", "planes": ["depth"]}"#;
        let request = parse(&serde_json::from_str(good).unwrap()).unwrap();
        assert_eq!((request.size, request.planes), (Some([5, 7]), Some(Planes::COLOR.with_depth(true))));
    }
}
