//! Answers to the requests of pages: images, picked points, copied commands and scenes, saved images, and comparisons.
//! This code uses no server and no threads, and therefore also runs in a notebook's kernel and in a page's own
//! WebAssembly.

use crate::Config;
use crate::sessions::{Difference, Key, MAX_SESSIONS, Sessions, draw_png, draw_timed, picked_json};
use crate::state::{self, Fixed, State, name_of};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use surfel_app::options::{Commands, Options, Setter, table};
use surfel_app::request::Resolved;
use surfel_app::session::Session;
use surfel_app::wording::as_flags;
use surfel_backend::BackendOptions;
use surfel_io::{JpegOptions, to_srgb8, write_jpeg};
use surfel_render::clock::Instant;
use surfel_render::{Frame, Planes, Renderer as _, Stats};
use surfel_sample::Progress;

/// Largest accepted number of pixels of an image on the page.
const MAX_PIXELS: u64 = 1 << 24;
/// Largest accepted number of pixels of an image that the user saves.
const MAX_SAVED_PIXELS: u64 = 1 << 25;
/// Largest accepted number of pixels of an image by the backend `reference`, which is about a hundred times slower than
/// others.
const MAX_REFERENCE_PIXELS: u64 = 1 << 21;
/// Quality, 0 to 100, of the JPEG previews that are sent while the camera moves.
const JPEG_QUALITY: u8 = 85;
/// Error message for a request that refers to an input by a number that doesn't exist.
const OTHER_INPUT: &str = "input: expected the number of an input";
/// Media type of an image that is sent as raw pixels, in 8-bit sRGB and alpha, row by row.
const PIXELS: &str = "image/x-rgba";

/// Answer to a request.
pub(crate) enum Answer {
    /// A JSON message without a file.
    Text(Value),
    /// A header and an image of one layer of the page. It replaces an older image of the layer that the client hasn't
    /// read yet.
    Image(Vec<u8>),
    /// A header and a file, such as a saved image.
    File(Vec<u8>),
}

/// Parsed request of a client for an image: its options, and identifiers for the answer.
pub(crate) struct Asked {
    id: Value,
    layer: usize,
    state: State,
    size: [u32; 2],
    pub(crate) key: Key,
    /// Names of the inputs as shown on the page and in copied commands; they may differ from the paths.
    names: Vec<PathBuf>,
    pub(crate) options: Options,
}

/// Handler of the requests of all pages: the sessions that load and draw the scene, and the options that pages can't
/// change.
pub(crate) struct RequestHandler {
    pub(crate) fixed: Fixed,
    pub(crate) initial: Map<String, Value>,
    sessions: Sessions,
    /// True if images are sent as raw pixels instead of image files.
    sends_pixels: bool,
    /// Scratch buffer for encoded images, reused between images.
    bytes: Vec<u8>,
    /// For each session, by its key: the client and the layer whose options the session shows; `None` if these options
    /// belong to no client. A session has no entry while only a sample of its points is loaded.
    shown_client_layer: Vec<(Key, Option<Side>)>,
}

/// Image on one client's page: identifier of the client, and number of the layer (0, or 1 for the second image of a
/// comparison).
type Side = (usize, usize);

impl RequestHandler {
    /// Creates the handler for these inputs and options. Nothing is loaded yet.
    ///
    /// # Errors
    /// A message that names a flag that isn't an option.
    pub(crate) fn new(config: &Config) -> Result<Self, String> {
        let inputs = config.inputs.clone();
        let names = config.names.clone().unwrap_or_else(|| inputs.clone());
        let (mut initial, mut fixed) = (Map::new(), Fixed { inputs, names, flags: Vec::new() });
        for (name, text) in &config.flags {
            let row = table().find(Commands::VIEW, name).ok_or_else(|| format!("there is no option --{name}"))?;
            if name == "size" {
                continue;
            }
            let is_path = matches!(row.set, Setter::Path(_)) && !row.has_name(text);
            match state::is_for_clients(row) && !is_path {
                false => fixed.flags.push((name.clone(), text.clone())),
                true if row.is_repeated => {
                    let list = initial.entry(name.clone()).or_insert_with(|| Value::Array(Vec::new()));
                    list.as_array_mut().into_iter().for_each(|list| list.push(text.as_str().into()));
                }
                true => _ = initial.insert(name.clone(), text.as_str().into()),
            }
        }
        let flag = |name: &str| fixed.flags.iter().find(|(known, _)| known == name).map(|(_, text)| text.clone());
        let options = BackendOptions::default().with_threads(config.threads).with_adapter(flag("adapter"));
        let backend_options = options.with_quantised(flag("storage").as_deref() == Some("16"));
        let sessions = Sessions::new(config.stdin.clone(), backend_options);
        let (sends_pixels, bytes) = (config.sends_pixels, Vec::new());
        Ok(Self { fixed, initial, sessions, sends_pixels, bytes, shown_client_layer: Vec::new() })
    }

    /// Returns the first message to a page, with its options and initial state.
    pub(crate) fn welcome(&self) -> Value {
        state::welcome(&self.fixed, &self.initial)
    }

    /// Answers a request of the client with the identifier `client`.
    pub(crate) fn answer(&mut self, client: usize, request: &Value, progress: &dyn Progress) -> Result<Answer, String> {
        match request["do"].as_str() {
            Some("draw") if request["moving"] == true => self.draw_preview(client, request, progress),
            Some("draw") => self.draw(client, request, progress),
            Some("pick") => self.pick(request, progress),
            Some("copy") => self.copy(request, progress),
            Some("save") => self.save(request, progress),
            Some("compare") => self.compare(request, progress),
            _ => Err("expected \"do\": draw, pick, copy, save or compare".to_owned()),
        }
    }

    /// Applies the options of a client's request to its session, which all clients share. Does nothing if the session
    /// shows the options of the same client and layer, or while only a sample of the points is loaded.
    fn show_for(&mut self, client: usize, asked: &Asked, progress: &dyn Progress) -> Result<(), String> {
        let side = (client, asked.layer);
        match self.shown_client_layer.iter().find(|(key, _)| *key == asked.key) {
            Some((_, shown)) if *shown != Some(side) => {
                self.show(asked, progress)?;
                self.remember(asked, Some(side));
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn remember(&mut self, asked: &Asked, side: Option<Side>) {
        self.shown_client_layer.retain(|(key, _)| *key != asked.key);
        self.shown_client_layer.insert(0, (asked.key.clone(), side));
        self.shown_client_layer.truncate(MAX_SESSIONS);
    }

    /// Parses a page's request for an image, of at most [`MAX_PIXELS`] pixels.
    #[cfg(feature = "server")]
    pub(crate) fn page_image_request(&self, request: &Value) -> Result<Asked, String> {
        self.asked(request, MAX_PIXELS)
    }

    /// Parses a request for an image of at most `most_pixels` pixels.
    fn asked(&self, request: &Value, most_pixels: u64) -> Result<Asked, String> {
        let side = |i: usize| request["size"][i].as_u64().and_then(|side| u32::try_from(side).ok());
        let size = side(0).zip(side(1)).map(|(w, h)| [w, h]).ok_or("size: expected [WIDTH, HEIGHT] in pixels")?;
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        if pixels == 0 || pixels > most_pixels {
            return Err(format!("size: {}x{} pixels, expected 1 to {most_pixels}", size[0], size[1]));
        }
        let empty = State::new();
        let state = request["state"].as_object().unwrap_or(&empty);
        self.image_request(request, state, size)
    }

    pub(crate) fn image_request(&self, request: &Value, state: &State, size: [u32; 2]) -> Result<Asked, String> {
        let mut fixed = self.fixed.clone();
        let mut state = state.clone();
        // If there are several inputs, the page may show one of them, given by its number.
        if let Some(number) = state.remove("input") {
            let found = number.as_u64().and_then(|i| usize::try_from(i).ok());
            let names = found.and_then(|i| fixed.names.get(i).cloned());
            fixed.inputs = vec![found.and_then(|i| fixed.inputs.get(i)).ok_or(OTHER_INPUT)?.clone()];
            fixed.names = names.into_iter().collect();
        }
        let options = state::options(&fixed, &state, size)?;
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        if options.backend_name() == "reference" && pixels > MAX_REFERENCE_PIXELS {
            return Err(format!(
                "size: {}x{} pixels, and a page's image by the backend reference has at most {MAX_REFERENCE_PIXELS}",
                size[0], size[1]
            ));
        }
        let key = Key { backend: options.backend_name().to_owned(), inputs: fixed.inputs };
        Ok(Asked { id: request["id"].clone(), layer: layer_of(request), state, size, key, names: fixed.names, options })
    }

    pub(crate) fn session(&mut self, key: &Key) -> Result<&mut Session, String> {
        self.sessions.of(key)
    }

    /// Loads and shows a scene, without reporting progress or notes.
    #[cfg(feature = "export")]
    pub(crate) fn show_once(&mut self, asked: &Asked) -> Result<(), String> {
        self.show(asked, &surfel_sample::NoProgress).map(|_| ())
    }

    /// Applies a request's options to its session, and loads the scene if necessary. Returns notes about the scene.
    fn show(&mut self, asked: &Asked, progress: &dyn Progress) -> Result<Vec<String>, String> {
        let session = self.session(&asked.key)?;
        let mut notes = Vec::new();
        session
            .show(&asked.options.render, progress, &mut |text| notes.push(as_flags(&text).into_owned()))
            .map_err(|e| e.to_string())?;
        self.remember(asked, None);
        Ok(notes)
    }

    /// Draws the image of a request in full quality, as `surfel render` would.
    fn draw(&mut self, client: usize, request: &Value, progress: &dyn Progress) -> Result<Answer, String> {
        let start = Instant::now();
        let asked = self.asked(request, MAX_PIXELS)?;
        let notes = self.show(&asked, progress)?;
        self.remember(&asked, Some((client, asked.layer)));
        let (kind, file, stats) = if self.sends_pixels { self.pixels(&asked)? } else { self.png(&asked)? };
        let session = self.session(&asked.key)?;
        let Some(Resolved { file: shown, .. }) = session.shown() else { return Err("no scene is shown".to_owned()) };
        let (camera, background, settings) = (json!(shown.camera), shown.background, json!(shown.settings));
        let (backend, scene) = (session.backend().info().backend, session.description());
        let header = json!({
            "do": "image", "id": asked.id, "layer": asked.layer, "moving": false, "type": kind,
            "size": asked.size, "camera": camera, "background": background, "settings": settings, "scene": scene,
            "notes": notes, "backend": backend, "splats": stats.splats, "drawn": stats.drawn,
            "frame_ms": stats.frame_ms, "ms": start.elapsed().as_secs_f64() * 1e3,
        });
        Ok(Answer::Image(packed(&header, &file)))
    }

    /// Draws the shown scene and encodes it as the PNG file that `surfel render` writes. Returns the media type, the
    /// file and the statistics.
    fn png(&mut self, asked: &Asked) -> Result<(&'static str, Vec<u8>, Stats), String> {
        let mut bytes = std::mem::take(&mut self.bytes);
        let stats = draw_png(self.session(&asked.key)?, &asked.options, &mut bytes)?;
        let png = bytes.clone();
        self.bytes = bytes;
        Ok(("image/png", png, stats))
    }

    /// Draws the shown scene as raw pixels. Returns the media type, the pixels and the statistics.
    fn pixels(&mut self, asked: &Asked) -> Result<(&'static str, Vec<u8>, Stats), String> {
        let session = self.session(&asked.key)?;
        let stats = session.draw(&asked.options.render, Planes::RGBA8).map_err(|e| e.to_string())?;
        Ok((PIXELS, session.frame().rgba8().as_flattened().to_vec(), stats))
    }

    /// Draws a preview, faster and less accurate, while the camera moves. If the session shows no scene yet, draws the
    /// image in full quality instead.
    fn draw_preview(&mut self, client: usize, request: &Value, progress: &dyn Progress) -> Result<Answer, String> {
        let start = Instant::now();
        let asked = self.asked(request, MAX_PIXELS)?;
        let session = self.session(&asked.key)?;
        if session.shown().is_none() {
            return self.draw(client, request, progress);
        }
        self.show_for(client, &asked, progress)?;
        let session = self.session(&asked.key)?;
        let (camera, stats) = session.draw_preview(&asked.options.render).map_err(|e| e.to_string())?;
        let background = session.shown().map_or([0.0; 4], |shown| shown.file.background);
        let [r, g, b, _] = background.map(|c| c as f32);
        let mut bytes = std::mem::take(&mut self.bytes);
        bytes.clear();
        let sends_pixels = self.sends_pixels;
        let frame = self.session(&asked.key)?.frame();
        let kind = if sends_pixels {
            bytes.extend_from_slice(to_srgb8(frame.color()).as_flattened());
            PIXELS
        } else {
            let options = JpegOptions { quality: JPEG_QUALITY, background: [r, g, b] };
            write_jpeg(&mut bytes, &frame.planes(), &options).map_err(|e| format!("can't encode the image: {e}"))?;
            "image/jpeg"
        };
        let header = json!({
            "do": "image", "id": asked.id, "layer": asked.layer, "moving": true, "type": kind,
            "size": asked.size, "camera": camera, "frame_ms": stats.frame_ms, "drawn": stats.drawn,
            "ms": start.elapsed().as_secs_f64() * 1e3,
        });
        let packed = packed(&header, &bytes);
        self.bytes = bytes;
        Ok(Answer::Image(packed))
    }

    fn pick(&mut self, request: &Value, progress: &dyn Progress) -> Result<Answer, String> {
        let asked = self.asked(request, MAX_PIXELS)?;
        self.show(&asked, progress)?;
        let at = |i: usize| request["at"][i].as_f64().filter(|x| x.is_finite()).map(|x| x.max(0.0) as u32);
        let at = at(0).zip(at(1)).map(|(x, y)| [x, y]).ok_or("at: expected [X, Y] in pixels")?;
        let inputs: Vec<String> = asked.names.iter().map(|path| name_of(path)).collect();
        let session = self.session(&asked.key)?;
        let picked = session.pick(at).map_err(|e| e.to_string())?;
        let found = picked.map(|picked| picked_json(picked, at, &inputs));
        let answer = json!({ "do": "picked", "id": asked.id, "picked": found });
        Ok(Answer::Text(answer))
    }

    fn copy(&mut self, request: &Value, progress: &dyn Progress) -> Result<Answer, String> {
        let asked = self.asked(request, MAX_SAVED_PIXELS)?;
        let fixed = Fixed { names: asked.names.clone(), ..self.fixed.clone() };
        let text = match request["as"].as_str() {
            Some("command") => state::command(&fixed, &asked.state, asked.size)?,
            Some("python") => state::python(&fixed, &asked.state, asked.size)?,
            Some("scene") => {
                self.show(&asked, progress)?;
                let session = self.session(&asked.key)?;
                let Some(Resolved { file, .. }) = session.shown() else { return Err("no scene is shown".to_owned()) };
                let file = surfel_load::paths::relative_to(Path::new("."), file).map_err(|e| e.to_string())?;
                surfel_io::scene_file::to_json_pretty(&file)
            }
            _ => return Err("as: expected command, python or scene".to_owned()),
        };
        let answer = json!({ "do": "copied", "id": asked.id, "as": request["as"], "text": text });
        Ok(Answer::Text(answer))
    }

    fn save(&mut self, request: &Value, progress: &dyn Progress) -> Result<Answer, String> {
        let asked = self.asked(request, MAX_SAVED_PIXELS)?;
        self.show(&asked, progress)?;
        let (_, png, _) = self.png(&asked)?;
        // A large image's memory is freed.
        self.bytes = Vec::new();
        self.session(&asked.key)?.release_memory();
        let header = json!({ "do": "saved", "id": asked.id, "type": "image/png", "size": asked.size });
        Ok(Answer::File(packed(&header, &png)))
    }

    /// Draws the images of two states of the page and measures their difference. The first image is the reference.
    fn compare(&mut self, request: &Value, progress: &dyn Progress) -> Result<Answer, String> {
        let mut sides: Vec<(Frame, f64)> = Vec::new();
        let first = self.asked(request, MAX_PIXELS)?;
        for side in ["a", "b"] {
            let state = request[side].as_object().ok_or("a, b: expected two states")?.clone();
            let asked = self.image_request(request, &state, first.size)?;
            self.show(&asked, progress)?;
            sides.push(draw_timed(self.session(&asked.key)?, &asked.options)?);
        }
        let [(a, a_ms), (b, b_ms)] = &sides[..] else { return Err("expected two states".to_owned()) };
        let difference = Difference::between(a, b)?;
        let mut header = json!({ "do": "compared", "id": first.id, "type": "image/png", "frame_ms": [a_ms, b_ms] });
        if let (Value::Object(header), Value::Object(measures)) = (&mut header, difference.to_json()) {
            header.extend(measures);
        }
        Ok(Answer::File(packed(&header, &difference.map)))
    }
}

/// Returns the number of the layer, the image on the page, that a request is about: 0, or 1 for the second image of a
/// comparison.
pub(crate) fn layer_of(request: &Value) -> usize {
    usize::from(request["layer"].as_u64().is_some_and(|layer| layer > 0))
}

/// Joins a header and a file into one message: the header's length in four bytes, little-endian, the header, and the
/// file.
fn packed(header: &Value, file: &[u8]) -> Vec<u8> {
    let header = header.to_string();
    let length = u32::try_from(header.len()).unwrap_or(u32::MAX);
    [&length.to_le_bytes(), header.as_bytes(), file].concat()
}
