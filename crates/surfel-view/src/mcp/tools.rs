//! Tools of the server: their descriptions, arguments and results.

use super::access::Access;
use crate::sessions::{Difference, Key, Sessions, draw_png, draw_timed, picked_json};
use crate::state::{self, Fixed, State, name_of};
use data_encoding::BASE64;
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use surfel_app::options::Options;
use surfel_app::session::Session;
use surfel_app::wording::{as_flags, notes_as_flags};
use surfel_backend::BackendOptions;
use surfel_figure::{Figure, Panel, Picture, Row, Style};
use surfel_io::{LoadOptions, to_srgb8};
use surfel_load::scene::is_scene_file;
use surfel_render::{Frame, Planes, Renderer as _};
use surfel_sample::NoProgress;

/// Largest accepted number of views in a request.
const MAX_VIEWS: usize = 12;
/// Largest accepted number of files in a request.
const MAX_FILES: usize = 64;
/// Largest accepted number of pixels of all images of a request together.
const MAX_PIXELS: u64 = 1 << 23;
/// Default width and height of an image, in pixels.
const SIZE: [u32; 2] = [768, 768];
/// Default width and height, in pixels, of each image on a contact sheet (one image with several views).
const SHEET_SIZE: [u32; 2] = [384, 384];
/// Font height of the panel names on a contact sheet, as a fraction of an image's shorter side; at least 10 pixels.
const SHEET_FONT: f64 = 0.045;
/// Largest number of notes about one image in an answer. Further notes about the image are left out.
const MAX_NOTES: usize = 16;

/// Returns the descriptions of all tools, with the schemas of their arguments.
pub(super) fn descriptions() -> Value {
    let paths = json!({
        "type": "array", "items": { "type": "string" }, "minItems": 1, "maxItems": MAX_FILES,
        "description": "Files that form one scene: points, scans, splats or meshes, or one scene file (.json).",
    });
    let size = json!({
        "type": "array", "items": { "type": "integer", "minimum": 1 }, "minItems": 2, "maxItems": 2,
        "description": format!("Width and height in pixels. Default {SIZE:?}, in a contact sheet {SHEET_SIZE:?}."),
    });
    let view = "auto, front, back, left, right, top, bottom, iso, or degrees to the right of the front and above the \
                horizon as in \"30,20\"";
    let options = json!({
        "type": "object",
        "description": "Options of `surfel render` by their long names without hyphens in front, such as \
                        {\"color-by\": \"height\", \"shader\": \"edl\", \"up\": \"z\", \"where\": \"z<5\"}. \
                        A camera: {\"eye\": \"1,2,3\", \"target\": \"0,0,0\"}.",
    });
    let common = |more: Value| {
        let mut properties = json!({ "paths": paths, "size": size, "options": options });
        if let (Value::Object(all), Value::Object(more)) = (&mut properties, more) {
            all.extend(more);
        }
        properties
    };
    let one_view = json!({ "type": "string", "description": format!("The view: {view}. Default auto.") });
    let side = json!({
        "type": "object", "properties": { "paths": paths, "options": options },
        "description": "What this side has in place of the common paths and options.",
    });
    let tool = |name: &str, title: &str, text: &str, properties: Value, required: &[&str]| {
        json!({
            "name": name, "title": title, "description": text,
            "inputSchema": {
                "type": "object", "properties": properties, "required": required, "additionalProperties": false,
            },
            "annotations": { "readOnlyHint": true, "openWorldHint": false },
        })
    };
    json!([
        tool(
            "inspect",
            "Describe a file",
            "Tells what a file holds, without drawing it: format, counts, bounds, up axis, attributes with their \
             ranges, classes, coordinate reference system, estimated radii and notes.",
            json!({ "path": { "type": "string", "description": "The file." } }),
            &["path"],
        ),
        tool(
            "render",
            "Draw images",
            "Draws a scene as PNG: of one view, of several, or of several on one contact sheet. The text beside the \
             images tells the camera of each, and the command that draws it.",
            common(json!({
                "views": {
                    "type": "array", "items": { "type": "string" }, "minItems": 1, "maxItems": MAX_VIEWS,
                    "description": format!("The views, each {view}. Default [\"auto\"]."),
                },
                "sheet": { "type": "boolean", "description": "True: all views on one image, with captions." },
            })),
            &["paths"],
        ),
        tool(
            "pick",
            "Identify a pixel",
            "Tells what is seen at a pixel: position, normal, depth, row in the file and attributes. Give the paths, \
             view, size and options of the image.",
            common(json!({
                "view": one_view,
                "at": {
                    "type": "array", "items": { "type": "integer", "minimum": 0 }, "minItems": 2, "maxItems": 2,
                    "description": "Pixel [X, Y], counted from the left top corner.",
                },
            })),
            &["paths", "at"],
        ),
        tool(
            "compare",
            "Measure a difference",
            "Draws one view of two scenes or with two settings, and measures the difference of b from a: largest \
             absolute difference, RMSE, PSNR and FLIP, with FLIP's error map and the milliseconds of both.",
            common(json!({ "view": one_view, "a": side, "b": side })),
            &["a", "b"],
        ),
    ])
}

/// Arguments of a tool call, by name.
struct Arguments<'a>(&'a Map<String, Value>);

impl Arguments<'_> {
    /// Returns an error if an argument isn't in `known`, the names of the tool's arguments.
    fn check(&self, known: &[&str]) -> Result<(), String> {
        match self.0.keys().find(|key| !known.contains(&key.as_str())) {
            Some(key) => Err(format!("there is no argument {key}, expected {}", known.join(", "))),
            None => Ok(()),
        }
    }

    fn paths(&self, access: &Access) -> Result<Vec<PathBuf>, String> {
        let list = self.0.get("paths").and_then(Value::as_array).filter(|list| !list.is_empty());
        let list = list.ok_or("paths: expected a list of files")?;
        if list.len() > MAX_FILES {
            return Err(format!("paths: has {} files, expected at most {MAX_FILES}", list.len()));
        }
        let path = |value: &Value| {
            let text = value.as_str().ok_or_else(|| format!("paths: expected names of files, found {value}"))?;
            access.check(text)
        };
        list.iter().map(path).collect()
    }

    /// Returns an argument that is a pair of whole numbers; `None` if it is absent.
    fn pair(&self, name: &str) -> Result<Option<[u32; 2]>, String> {
        let Some(value) = self.0.get(name) else { return Ok(None) };
        let list = value.as_array().filter(|list| list.len() == 2);
        let number = |i: usize| u32::try_from(list?.get(i)?.as_u64()?).ok();
        let wrong = || format!("{name}: expected two whole numbers, found {value}");
        Ok(Some([number(0).ok_or_else(wrong)?, number(1).ok_or_else(wrong)?]))
    }

    /// Returns the argument `options`: options of `surfel render` by their long names.
    fn options(&self) -> Result<State, String> {
        match self.0.get("options") {
            None => Ok(State::new()),
            Some(Value::Object(options)) => Ok(options.clone()),
            Some(other) => Err(format!("options: expected a JSON object, found {other}")),
        }
    }

    fn text(&self, name: &str) -> Result<Option<&str>, String> {
        match self.0.get(name) {
            None => Ok(None),
            Some(value) => value.as_str().map(Some).ok_or_else(|| format!("{name}: expected text, found {value}")),
        }
    }

    fn is_true(&self, name: &str) -> Result<bool, String> {
        match self.0.get(name) {
            None => Ok(false),
            Some(value) => value.as_bool().ok_or_else(|| format!("{name}: expected true or false, found {value}")),
        }
    }
}

/// Request of a tool for an image: a scene's files, options, and the image's size in pixels.
struct Asked {
    fixed: Fixed,
    state: State,
    size: [u32; 2],
    key: Key,
    options: Options,
}

impl Asked {
    fn new(paths: Vec<PathBuf>, mut state: State, view: Option<&str>, size: [u32; 2]) -> Result<Self, String> {
        if let Some(view) = view {
            state.insert("view".to_owned(), view.into());
        }
        let fixed = Fixed { names: paths.clone(), inputs: paths, flags: Vec::new() };
        let options = state::options(&fixed, &state, size)?;
        options.render.check().map_err(|e| e.to_string())?;
        let key = Key { backend: options.backend_name().to_owned(), inputs: fixed.inputs.clone() };
        Ok(Self { fixed, state, size, key, options })
    }

    /// Returns the view, camera and size of the image, and the command that draws it.
    fn described(&self, session: &Session) -> Result<Value, String> {
        let camera = session.shown().map(|shown| &shown.file.camera);
        let command = state::command(&self.fixed, &self.state, self.size)?;
        let view = self.state.get("view").cloned().unwrap_or_else(|| "auto".into());
        Ok(json!({ "view": view, "camera": camera, "command": command, "size": self.size }))
    }
}

/// Returns a content block of a tool's result, with `value` as text.
fn text_block(value: &Value) -> Value {
    json!({ "type": "text", "text": value.to_string() })
}

/// Returns a content block of a tool's result, with a PNG image.
fn image_block(png: &[u8]) -> Value {
    json!({ "type": "image", "data": BASE64.encode(png), "mimeType": "image/png" })
}

/// Returns the result of a tool call. `value` is given both as text and as structured content; images follow.
fn result(value: Value, images: Vec<Value>) -> Value {
    let content: Vec<Value> = std::iter::once(text_block(&value)).chain(images).collect();
    json!({ "content": content, "structuredContent": value, "isError": false })
}

/// Tools, with the scenes that are in memory for them.
pub(super) struct Tools {
    access: Access,
    sessions: Sessions,
}

impl Tools {
    pub(super) fn new(access: Access, backend_options: BackendOptions) -> Self {
        Self { access, sessions: Sessions::new(None, backend_options) }
    }

    /// Calls a tool. The result of a call that fails is a text that describes the problem to the model.
    ///
    /// # Errors
    /// A message if there is no such tool, or if `arguments` isn't an object.
    pub(super) fn call(&mut self, name: &str, arguments: &Value) -> Result<Value, String> {
        let empty = Map::new();
        let arguments = match arguments {
            Value::Null => &empty,
            Value::Object(arguments) => arguments,
            other => return Err(format!("arguments: expected a JSON object, found {other}")),
        };
        let arguments = Arguments(arguments);
        let called = match name {
            "inspect" => self.inspect(&arguments),
            "render" => self.render(&arguments),
            "pick" => self.pick(&arguments),
            "compare" => self.compare(&arguments),
            _ => return Err(format!("there is no tool {name}, expected inspect, render, pick or compare")),
        };
        let failed =
            |problem: String| json!({ "content": [{ "type": "text", "text": as_flags(&problem) }], "isError": true });
        Ok(called.unwrap_or_else(failed))
    }

    fn inspect(&mut self, arguments: &Arguments<'_>) -> Result<Value, String> {
        arguments.check(&["path"])?;
        let path = arguments.text("path")?.ok_or("path: expected the name of a file")?;
        let path = self.access.check(path)?;
        if !is_scene_file(&path) {
            let mut facts = surfel_load::info::info(&path, &LoadOptions::default(), None).map_err(|e| e.to_string())?;
            notes_as_flags(&mut facts);
            return Ok(result(facts, Vec::new()));
        }
        let asked = Asked::new(vec![path], State::new(), None, SIZE)?;
        let notes = self.show(&asked)?;
        let session = self.sessions.of(&asked.key)?;
        let mut facts = session.description();
        facts["camera"] = json!(session.shown().map(|shown| &shown.file.camera));
        facts["notes"] = json!(notes);
        Ok(result(facts, Vec::new()))
    }

    /// Applies a request's options to its session, and loads the scene if necessary. Returns notes about the scene.
    fn show(&mut self, asked: &Asked) -> Result<Vec<String>, String> {
        let mut notes = Vec::new();
        let session = self.sessions.of(&asked.key)?;
        let shown =
            session.show(&asked.options.render, &NoProgress, &mut |text| notes.push(as_flags(&text).into_owned()));
        shown.map(|_| ()).map_err(|e| e.to_string())?;
        notes.truncate(MAX_NOTES);
        Ok(notes)
    }

    fn render(&mut self, arguments: &Arguments<'_>) -> Result<Value, String> {
        arguments.check(&["paths", "views", "size", "options", "sheet"])?;
        let (paths, state) = (arguments.paths(&self.access)?, arguments.options()?);
        let is_sheet = arguments.is_true("sheet")?;
        let size = arguments.pair("size")?.unwrap_or(if is_sheet { SHEET_SIZE } else { SIZE });
        let views = match arguments.0.get("views") {
            None => vec![None],
            Some(Value::Array(views)) if (1..=MAX_VIEWS).contains(&views.len()) => {
                let text = |view: &Value| view.as_str().map(|text| Some(text.to_owned()));
                let views: Option<Vec<_>> = views.iter().map(text).collect();
                views.ok_or("views: expected a list of views, as text")?
            }
            Some(_) => return Err(format!("views: expected a list of 1 to {MAX_VIEWS} views")),
        };
        check_pixels(size, views.len())?;
        let (mut described, mut notes, mut images, mut panels) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut backend = "";
        for view in &views {
            let asked = Asked::new(paths.clone(), state.clone(), view.as_deref(), size)?;
            for note in self.show(&asked)? {
                if !notes.contains(&note) {
                    notes.push(note);
                }
            }
            let session = self.sessions.of(&asked.key)?;
            if is_sheet {
                session.draw(&asked.options.render, Planes::COLOR).map_err(|e| e.to_string())?;
                panels.push(panel(session, view.as_deref().unwrap_or("auto"), panels.len() + 1));
            } else {
                let mut png = Vec::new();
                draw_png(session, &asked.options, &mut png)?;
                images.push(image_block(&png));
            }
            described.push(asked.described(session)?);
            backend = session.backend().info().backend;
        }
        if is_sheet {
            images.push(image_block(&sheet(panels, size)));
        }
        let facts = json!({ "images": described, "notes": notes, "backend": backend, "sheet": is_sheet });
        Ok(result(facts, images))
    }

    fn pick(&mut self, arguments: &Arguments<'_>) -> Result<Value, String> {
        arguments.check(&["paths", "view", "size", "options", "at"])?;
        let size = arguments.pair("size")?.unwrap_or(SIZE);
        check_pixels(size, 1)?;
        let at = arguments.pair("at")?.ok_or("at: expected [X, Y] in pixels")?;
        if at[0] >= size[0] || at[1] >= size[1] {
            return Err(format!("at: {at:?} is outside of the image of {} x {} pixels", size[0], size[1]));
        }
        let asked = Asked::new(arguments.paths(&self.access)?, arguments.options()?, arguments.text("view")?, size)?;
        let notes = self.show(&asked)?;
        let names: Vec<String> = asked.key.inputs.iter().map(|path| name_of(path)).collect();
        let picked = self.sessions.of(&asked.key)?.pick(at).map_err(|e| e.to_string())?;
        let picked = picked.map(|picked| picked_json(picked, at, &names));
        Ok(result(json!({ "picked": picked, "notes": notes }), Vec::new()))
    }

    fn compare(&mut self, arguments: &Arguments<'_>) -> Result<Value, String> {
        arguments.check(&["paths", "view", "size", "options", "a", "b"])?;
        let size = arguments.pair("size")?.unwrap_or(SIZE);
        check_pixels(size, 2)?;
        let mut drawn: Vec<(Frame, f64)> = Vec::new();
        let mut notes = Vec::new();
        for name in ["a", "b"] {
            let own = arguments.0.get(name).and_then(Value::as_object);
            let own = Arguments(own.ok_or_else(|| format!("{name}: expected an object with paths or options"))?);
            own.check(&["paths", "options"]).map_err(|e| format!("{name}: {e}"))?;
            let of_paths = if own.0.contains_key("paths") { &own } else { arguments };
            let mut state = arguments.options()?;
            state.extend(own.options()?);
            let asked = Asked::new(of_paths.paths(&self.access)?, state, arguments.text("view")?, size)?;
            notes.extend(self.show(&asked)?.into_iter().map(|note| format!("{name}: {note}")));
            drawn.push(draw_timed(self.sessions.of(&asked.key)?, &asked.options)?);
        }
        let [(a, a_ms), (b, b_ms)] = &drawn[..] else { return Err("expected two sides".to_owned()) };
        let difference = Difference::between(a, b)?;
        let mut facts = difference.to_json();
        facts["frame_ms"] = json!([a_ms, b_ms]);
        facts["notes"] = json!(notes);
        Ok(result(facts, vec![image_block(&difference.map)]))
    }
}

/// Returns an error if `count` images of this size have more than [`MAX_PIXELS`] pixels together.
fn check_pixels(size: [u32; 2], count: usize) -> Result<(), String> {
    let pixels = (u64::from(size[0]) * u64::from(size[1])).saturating_mul(count as u64);
    if pixels == 0 || pixels > MAX_PIXELS {
        let [width, height] = size;
        return Err(format!(
            "size: {count} of {width} x {height} are {pixels} pixels, expected 1 to {MAX_PIXELS} in all"
        ));
    }
    Ok(())
}

/// Returns the last drawn frame as a panel of a contact sheet, with its number and the view's name as caption.
fn panel(session: &Session, view: &str, number: usize) -> Panel {
    let frame = session.frame();
    let picture = Picture { size: [frame.width(), frame.height()], rgba: to_srgb8(frame.color()) };
    Panel::new(picture).with_caption(&format!("{number}: {view}"))
}

/// Arranges panels in an approximately square grid, and encodes the grid as a PNG.
fn sheet(panels: Vec<Panel>, size: [u32; 2]) -> Vec<u8> {
    let columns = (panels.len() as f64).sqrt().ceil() as usize;
    let mut rows = Vec::new();
    let mut panels = panels.into_iter().map(Some).peekable();
    while panels.peek().is_some() {
        rows.push(Row::from(panels.by_ref().take(columns.max(1)).collect::<Vec<_>>()));
    }
    let font = (SHEET_FONT * f64::from(size[0].min(size[1]))).max(10.0);
    Figure { rows, style: Style::new(font), ..Figure::default() }.layout().png(None)
}
