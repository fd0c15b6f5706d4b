//! The drawing thread: answers the requests of all pages, one after another.

use crate::Config;
use crate::hub::{Hub, Job, Next, Outgoing};
use crate::sessions::{Difference, Key, MAX_SESSIONS, Sessions, draw_png, draw_timed, picked_json};
use crate::state::{self, Fixed, State, name_of};
use serde_json::{Map, Value, json};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use surfel::io::{JpegOptions, write_jpeg};
use surfel::options::Options;
use surfel::request::Resolved;
use surfel::session::{Loaded, Loader, Session};
use surfel::{BackendOptions, Error, Frame, Progress, Renderer as _, Stats};

/// Largest number of pixels of an image on the page.
const MAX_PIXELS: u64 = 1 << 24;
/// Largest number of pixels of a saved image.
const MAX_SAVED_PIXELS: u64 = 1 << 25;
/// Largest number of requests that wait for loading.
const MAX_DEFERRED: usize = 64;
/// Size of the image that the scene is first framed for.
const FIRST_SIZE: [u32; 2] = [1024, 768];
/// Quality of images while something moves.
const JPEG_QUALITY: u8 = 85;
/// Least time between two messages about progress.
const PROGRESS_TIME: Duration = Duration::from_millis(100);

/// Progress of loading, sent to all pages.
struct Report<'a> {
    hub: &'a Hub,
    state: Mutex<Stage>,
}

struct Stage {
    name: String,
    done: u64,
    total: u64,
    told: Option<Instant>,
}

impl<'a> Report<'a> {
    fn new(hub: &'a Hub) -> Self {
        Self { hub, state: Mutex::new(Stage { name: String::new(), done: 0, total: 0, told: None }) }
    }

    fn change(&self, change: impl FnOnce(&mut Stage)) {
        let mut stage = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut stage);
        if stage.told.is_some_and(|told| told.elapsed() < PROGRESS_TIME) {
            return;
        }
        stage.told = Some(Instant::now());
        let part = if stage.total > 1 { json!(stage.done as f64 / stage.total as f64) } else { Value::Null };
        self.hub.broadcast(&json!({ "do": "progress", "stage": stage.name, "part": part }));
    }
}

impl Progress for Report<'_> {
    fn stage(&self, name: &str, total: u64) {
        self.change(|stage| (stage.name, stage.done, stage.total) = (name.to_owned(), 0, total));
    }

    fn advance(&self, steps: u64) {
        self.change(|stage| stage.done = (stage.done + steps).min(stage.total));
    }
}

/// Options and identifiers of a request for an image, read from the client's message.
struct Asked {
    id: Value,
    layer: usize,
    state: State,
    size: [u32; 2],
    key: Key,
    options: Options,
}

/// The drawing thread's state.
pub(crate) struct Artist {
    hub: Arc<Hub>,
    fixed: Fixed,
    initial: Map<String, Value>,
    sessions: Sessions,
    /// Scratch space for images.
    bytes: Vec<u8>,
    /// Requests that wait until all points are loaded.
    deferred: Vec<Job>,
    /// Client and layer whose options each session shows, by the session's key: `None` if neither drew them. Without an
    /// entry while only a sample is loaded.
    shown_for: Vec<(Key, Option<Side>)>,
}

/// A client, by the address of its outbox, and one of its layers.
type Side = (usize, usize);

impl Artist {
    pub(crate) fn new(hub: Arc<Hub>, fixed: Fixed, initial: Map<String, Value>, config: &Config) -> Self {
        let flag = |name: &str| fixed.flags.iter().find(|(known, _)| known == name).map(|(_, text)| text.clone());
        let options = BackendOptions::default().with_threads(config.threads).with_adapter(flag("adapter"));
        let backend_options = options.with_quantised(flag("storage").as_deref() == Some("16"));
        let sessions = Sessions::new(config.stdin.clone(), backend_options);
        Self { hub, fixed, initial, sessions, bytes: Vec::new(), deferred: Vec::new(), shown_for: Vec::new() }
    }

    /// Shows the options of a moving image's client and layer, if the session shows those of another.
    fn show_for(&mut self, job: &Job, asked: &Asked) -> Result<(), String> {
        let side = (Arc::as_ptr(&job.outbox) as usize, asked.layer);
        match self.shown_for.iter().find(|(key, _)| *key == asked.key) {
            Some((_, shown)) if *shown != Some(side) => {
                self.show(asked)?;
                self.remember(asked, Some(side));
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn remember(&mut self, asked: &Asked, side: Option<Side>) {
        self.shown_for.retain(|(key, _)| *key != asked.key);
        self.shown_for.insert(0, (asked.key.clone(), side));
        self.shown_for.truncate(MAX_SESSIONS);
    }

    /// Loads the scene, and answers requests until the program ends.
    pub(crate) fn run(mut self, note: &mut dyn FnMut(&str)) -> ! {
        let hub = self.hub.clone();
        if let Err(problem) = self.load_first(note) {
            note(&format!("error: {problem}"));
        }
        // Requests that only got a sample.
        for job in std::mem::take(&mut self.deferred) {
            self.reply(&job);
        }
        loop {
            if let Next::Job(job) = hub.next() {
                self.reply(&job);
            }
        }
    }

    /// Answers a request, or sends its error.
    fn reply(&mut self, job: &Job) {
        if let Err(problem) = self.answer(job) {
            let request = &job.request;
            let (id, layer, of) = (&request["id"], &request["layer"], &request["do"]);
            let answer = json!({ "do": "error", "id": id, "layer": layer, "of": of, "message": problem });
            job.outbox.push(Outgoing::Text(answer.to_string()));
        }
    }

    /// Loads the files before the first request. Pages see a sample of many points meanwhile, and can move it.
    fn load_first(&mut self, note: &mut dyn FnMut(&str)) -> Result<(), String> {
        let text = |e: Error| e.to_string();
        let asked = self.asked_of(&Value::Null, &self.initial, FIRST_SIZE)?;
        let hub = self.hub.clone();
        let report = Report::new(&hub);
        let session = self.session(&asked.key)?;
        // A pool of one thread is busy with this function.
        let can_share = rayon::current_num_threads() > 1;
        let loader = if can_share { session.show_coarse(&asked.options.render, &report).map_err(text)? } else { None };
        if let Some(loader) = loader {
            let loaded = self.show_sample(loader)?;
            self.session(&asked.key)?.adopt(loaded.map_err(text)?);
        }
        let mut notes = Vec::new();
        let session = self.session(&asked.key)?;
        let shown = session.show(&asked.options.render, &report, &mut |text| notes.push(text)).map(|_| ());
        notes.iter().for_each(|text| note(text));
        shown.map_err(text)
    }

    /// Loads all points on another thread, and answers requests by the resident sample meanwhile.
    fn show_sample(&mut self, loader: Loader) -> Result<Result<Loaded, Error>, String> {
        let hub = self.hub.clone();
        let (sender, receiver) = std::sync::mpsc::sync_channel(1);
        let loading = hub.clone();
        rayon::spawn(move || {
            let report = Report::new(&loading);
            let _ = sender.send(loader.load(&report));
            loading.report_loaded();
        });
        while let Next::Job(job) = hub.next() {
            if job.request["do"] == "draw" && self.glance(&job).is_ok() && job.request["moving"] == true {
                continue;
            }
            // The exact image, and everything else, follows once all points are there.
            let layer = |job: &Job| job.request["layer"].as_u64().unwrap_or(0);
            self.deferred.retain(|other| {
                let are_draws = other.request["do"] == "draw" && job.request["do"] == "draw";
                !Arc::ptr_eq(&other.outbox, &job.outbox) || !are_draws || layer(other) != layer(&job)
            });
            if self.deferred.len() < MAX_DEFERRED {
                self.deferred.push(job);
            }
        }
        receiver.try_recv().map_err(|_| "the points could not be loaded".to_owned())
    }

    /// Reads a request for an image.
    fn asked(&self, request: &Value, most_pixels: u64) -> Result<Asked, String> {
        let side = |i: usize| request["size"][i].as_u64().and_then(|side| u32::try_from(side).ok());
        let size = side(0).zip(side(1)).map(|(w, h)| [w, h]).ok_or("size: expected [WIDTH, HEIGHT] in pixels")?;
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        if pixels == 0 || pixels > most_pixels {
            return Err(format!("size: {}x{} pixels, expected 1 to {most_pixels}", size[0], size[1]));
        }
        let empty = State::new();
        let state = request["state"].as_object().unwrap_or(&empty);
        self.asked_of(request, state, size)
    }

    fn asked_of(&self, request: &Value, state: &State, size: [u32; 2]) -> Result<Asked, String> {
        let mut fixed = self.fixed.clone();
        let mut state = state.clone();
        // Of several inputs the page may show one, by its number.
        if let Some(number) = state.remove("input") {
            let found = number.as_u64().and_then(|i| self.fixed.inputs.get(usize::try_from(i).ok()?));
            fixed.inputs = vec![found.ok_or("input: expected the number of an input")?.clone()];
        }
        let options = state::options(&fixed, &state, size)?;
        let key = Key { backend: options.backend_name().to_owned(), inputs: fixed.inputs };
        let layer = usize::try_from(request["layer"].as_u64().unwrap_or(0)).unwrap_or(0).min(1);
        Ok(Asked { id: request["id"].clone(), layer, state, size, key, options })
    }

    fn session(&mut self, key: &Key) -> Result<&mut Session, String> {
        self.sessions.of(key)
    }

    fn answer(&mut self, job: &Job) -> Result<(), String> {
        match job.request["do"].as_str() {
            Some("draw") if job.request["moving"] == true => self.glance(job),
            Some("draw") => self.draw(job),
            Some("pick") => self.pick(job),
            Some("copy") => self.copy(job),
            Some("save") => self.save(job),
            Some("compare") => self.compare(job),
            _ => Err("expected \"do\": draw, pick, copy, save or compare".to_owned()),
        }
    }

    /// Shows a scene, with progress for all pages. Returns notes.
    fn show(&mut self, asked: &Asked) -> Result<Vec<String>, String> {
        let hub = self.hub.clone();
        let report = Report::new(&hub);
        let session = self.session(&asked.key)?;
        let mut notes = Vec::new();
        session.show(&asked.options.render, &report, &mut |text| notes.push(text)).map_err(|e| e.to_string())?;
        self.remember(asked, None);
        Ok(notes)
    }

    /// Draws an exact image.
    fn draw(&mut self, job: &Job) -> Result<(), String> {
        let start = Instant::now();
        let asked = self.asked(&job.request, MAX_PIXELS)?;
        let notes = self.show(&asked)?;
        self.remember(&asked, Some((Arc::as_ptr(&job.outbox) as usize, asked.layer)));
        let (png, stats) = self.png(&asked)?;
        let session = self.session(&asked.key)?;
        let Some(Resolved { file, .. }) = session.shown() else { return Err("no scene is shown".to_owned()) };
        let camera = json!(file.camera);
        let background = file.background;
        let settings = json!(file.settings);
        let (backend, scene) = (session.backend().info().backend, session.description());
        let header = json!({
            "do": "image", "id": asked.id, "layer": asked.layer, "moving": false, "type": "image/png",
            "size": asked.size, "camera": camera, "background": background, "settings": settings, "scene": scene,
            "notes": notes, "backend": backend, "splats": stats.splats, "drawn": stats.drawn,
            "frame_ms": stats.frame_ms, "ms": start.elapsed().as_secs_f64() * 1e3,
        });
        job.outbox.put_image(asked.layer, packed(&header, &png));
        Ok(())
    }

    /// Draws the shown scene and encodes it as the file that `surfel render` writes.
    fn png(&mut self, asked: &Asked) -> Result<(Vec<u8>, Stats), String> {
        let mut bytes = std::mem::take(&mut self.bytes);
        let stats = draw_png(self.session(&asked.key)?, &asked.options, &mut bytes)?;
        let png = bytes.clone();
        self.bytes = bytes;
        Ok((png, stats))
    }

    /// Draws an image while something moves.
    fn glance(&mut self, job: &Job) -> Result<(), String> {
        let start = Instant::now();
        let asked = self.asked(&job.request, MAX_PIXELS)?;
        let session = self.session(&asked.key)?;
        if session.shown().is_none() {
            return self.draw(job);
        }
        self.show_for(job, &asked)?;
        let session = self.session(&asked.key)?;
        let (camera, stats) = session.glance(&asked.options.render).map_err(|e| e.to_string())?;
        let background = session.shown().map_or([0.0; 4], |shown| shown.file.background);
        let [r, g, b, _] = background.map(|c| c as f32);
        let mut bytes = std::mem::take(&mut self.bytes);
        bytes.clear();
        let options = JpegOptions { quality: JPEG_QUALITY, background: [r, g, b] };
        let session = self.session(&asked.key)?;
        write_jpeg(&mut bytes, &session.frame().planes(), &options)
            .map_err(|e| format!("can't encode the image: {e}"))?;
        let header = json!({
            "do": "image", "id": asked.id, "layer": asked.layer, "moving": true, "type": "image/jpeg",
            "size": asked.size, "camera": camera, "frame_ms": stats.frame_ms, "drawn": stats.drawn,
            "ms": start.elapsed().as_secs_f64() * 1e3,
        });
        job.outbox.put_image(asked.layer, packed(&header, &bytes));
        self.bytes = bytes;
        Ok(())
    }

    fn pick(&mut self, job: &Job) -> Result<(), String> {
        let asked = self.asked(&job.request, MAX_PIXELS)?;
        self.show(&asked)?;
        let at = |i: usize| job.request["at"][i].as_f64().filter(|x| x.is_finite()).map(|x| x.max(0.0) as u32);
        let at = at(0).zip(at(1)).map(|(x, y)| [x, y]).ok_or("at: expected [X, Y] in pixels")?;
        let inputs: Vec<String> = asked.key.inputs.iter().map(|path| name_of(path)).collect();
        let session = self.session(&asked.key)?;
        let picked = session.pick(at).map_err(|e| e.to_string())?;
        let found = picked.map(|picked| picked_json(picked, at, &inputs));
        let answer = json!({ "do": "picked", "id": asked.id, "picked": found });
        job.outbox.push(Outgoing::Text(answer.to_string()));
        Ok(())
    }

    fn copy(&mut self, job: &Job) -> Result<(), String> {
        let asked = self.asked(&job.request, MAX_SAVED_PIXELS)?;
        let fixed = Fixed { inputs: asked.key.inputs.clone(), flags: self.fixed.flags.clone() };
        let text = match job.request["as"].as_str() {
            Some("command") => state::command(&fixed, &asked.state, asked.size)?,
            Some("python") => state::python(&fixed, &asked.state, asked.size)?,
            Some("scene") => {
                self.show(&asked)?;
                let session = self.session(&asked.key)?;
                let Some(Resolved { file, .. }) = session.shown() else { return Err("no scene is shown".to_owned()) };
                let file = surfel::paths::relative_to(Path::new("."), file).map_err(|e| e.to_string())?;
                surfel::io::scene_file::to_json_pretty(&file)
            }
            _ => return Err("as: expected command, python or scene".to_owned()),
        };
        let answer = json!({ "do": "copied", "id": asked.id, "as": job.request["as"], "text": text });
        job.outbox.push(Outgoing::Text(answer.to_string()));
        Ok(())
    }

    fn save(&mut self, job: &Job) -> Result<(), String> {
        let asked = self.asked(&job.request, MAX_SAVED_PIXELS)?;
        self.show(&asked)?;
        let (png, _) = self.png(&asked)?;
        // The memory of a large image isn't kept.
        self.bytes = Vec::new();
        self.session(&asked.key)?.release_memory();
        let header = json!({ "do": "saved", "id": asked.id, "type": "image/png", "size": asked.size });
        job.outbox.push(Outgoing::Binary(packed(&header, &png)));
        Ok(())
    }

    /// Draws two states and measures their difference; the first is the reference.
    fn compare(&mut self, job: &Job) -> Result<(), String> {
        let mut sides: Vec<(Frame, f64)> = Vec::new();
        let first = self.asked(&job.request, MAX_PIXELS)?;
        for side in ["a", "b"] {
            let state = job.request[side].as_object().ok_or("a, b: expected two states")?.clone();
            let asked = self.asked_of(&job.request, &state, first.size)?;
            self.show(&asked)?;
            sides.push(draw_timed(self.session(&asked.key)?, &asked.options)?);
        }
        let [(a, a_ms), (b, b_ms)] = &sides[..] else { return Err("expected two states".to_owned()) };
        let difference = Difference::between(a, b)?;
        let mut header = json!({ "do": "compared", "id": first.id, "type": "image/png", "frame_ms": [a_ms, b_ms] });
        if let (Value::Object(header), Value::Object(measures)) = (&mut header, difference.to_json()) {
            header.extend(measures);
        }
        job.outbox.push(Outgoing::Binary(packed(&header, &difference.map)));
        Ok(())
    }
}

/// Joins a header and a file: the header's length in four bytes, little-endian, the header and the file.
fn packed(header: &Value, file: &[u8]) -> Vec<u8> {
    let header = header.to_string();
    let length = u32::try_from(header.len()).unwrap_or(u32::MAX);
    [&length.to_le_bytes(), header.as_bytes(), file].concat()
}
