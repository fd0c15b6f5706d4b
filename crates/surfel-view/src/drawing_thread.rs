//! Drawing thread, which answers the requests of all pages, one after another.

use crate::hub::{Hub, Job, Next, Outgoing};
use crate::request_handler::{Answer, RequestHandler, layer_of};
use serde_json::{Value, json};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use surfel_app::session::{Loaded, Loader};
use surfel_app::wording::as_flags;
use surfel_load::Error;
use surfel_sample::Progress;

/// Largest number of requests that wait until the scene is loaded. Further requests are dropped.
const MAX_DEFERRED: usize = 64;
/// Image size, in pixels, that is assumed while the scene is loaded first, before a page has stated its size.
const FIRST_SIZE: [u32; 2] = [1024, 768];
/// Minimum time between two messages about progress.
const PROGRESS_TIME: Duration = Duration::from_millis(100);

/// Progress of loading, which is sent to all pages at most once per [`PROGRESS_TIME`].
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

/// Drawing thread: the queues of all clients, the handler that answers their requests, and requests that wait until the
/// scene is loaded.
pub(crate) struct DrawingThread {
    hub: Arc<Hub>,
    handler: RequestHandler,
    /// Requests that need all points, and wait until they are loaded.
    deferred: Vec<Job>,
}

impl DrawingThread {
    pub(crate) fn new(hub: Arc<Hub>, handler: RequestHandler) -> Self {
        Self { hub, handler, deferred: Vec::new() }
    }

    /// Loads the scene, and answers requests until the program ends.
    pub(crate) fn run(mut self, note: &mut dyn FnMut(&str)) -> ! {
        let hub = self.hub.clone();
        if let Err(problem) = self.load_first(note) {
            note(&format!("error: {problem}"));
        }
        // Until here, deferred requests have at most an image of the sample as an answer.
        for job in std::mem::take(&mut self.deferred) {
            self.reply(&job);
        }
        let mut is_first = true;
        loop {
            let Next::Job(job) = hub.next() else { continue };
            // The metadata of an exact image needs the hash of each file, which takes time. The page first gets an
            // image without metadata.
            if job.request["do"] == "draw" && std::mem::take(&mut is_first) {
                let _ = self.answer_by_sample(&job);
            }
            self.reply(&job);
        }
    }

    /// Answers a request. If it fails, sends the error message to the page instead.
    fn reply(&mut self, job: &Job) {
        if let Err(problem) = &self.answer(job) {
            let request = &job.request;
            let (id, layer, of) = (&request["id"], &request["layer"], &request["do"]);
            let answer = json!({ "do": "error", "id": id, "layer": layer, "of": of, "message": as_flags(problem) });
            job.outbox.push(Outgoing::Text(answer.to_string()));
        }
    }

    /// Answers a request, and reports progress to all pages.
    fn answer(&mut self, job: &Job) -> Result<(), String> {
        let hub = self.hub.clone();
        let report = Report::new(&hub);
        match self.handler.answer(Arc::as_ptr(&job.outbox) as usize, &job.request, &report)? {
            Answer::Text(answer) => job.outbox.push(Outgoing::Text(answer.to_string())),
            Answer::Image(file) => job.outbox.put_image(layer_of(&job.request), file),
            Answer::File(file) => job.outbox.push(Outgoing::Binary(file)),
        }
        Ok(())
    }

    /// Loads the files before the first request. With several threads, and if the files allow a sample, pages meanwhile
    /// show a sample of the points and can move the camera.
    fn load_first(&mut self, note: &mut dyn FnMut(&str)) -> Result<(), String> {
        let text = |e: Error| e.to_string();
        let asked = self.handler.image_request(&Value::Null, &self.handler.initial, FIRST_SIZE)?;
        let hub = self.hub.clone();
        let report = Report::new(&hub);
        let session = self.handler.session(&asked.key)?;
        // With a single thread, this function occupies the pool, and nothing can be loaded beside it.
        let can_share = rayon::current_num_threads() > 1;
        let loader = if can_share { session.show_coarse(&asked.options.render, &report).map_err(text)? } else { None };
        if let Some(loader) = loader {
            let loaded = self.show_sample(loader)?;
            self.handler.session(&asked.key)?.adopt(loaded.map_err(text)?);
        }
        let mut notes = Vec::new();
        // An open page already has its own size and options, which its image needs.
        let of_page = self.hub.waiting_draw().and_then(|request| self.handler.page_image_request(&request).ok());
        let asked = of_page.filter(|of_page| of_page.key == asked.key).unwrap_or(asked);
        let session = self.handler.session(&asked.key)?;
        let shown = session.show(&asked.options.render, &report, &mut |text| notes.push(text)).map(|_| ());
        notes.iter().for_each(|text| note(text));
        shown.map_err(text)
    }

    /// Loads all points on another thread. Meanwhile, answers requests by images of the resident sample. Returns the
    /// loaded points or the error of loading; the outer error is a message if the loading thread ended without a
    /// result.
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
            if job.request["do"] == "draw" && self.answer_by_sample(&job).is_ok() && job.request["moving"] == true {
                continue;
            }
            // The exact image, and every other answer, follows when all points are loaded.
            let layer = |job: &Job| layer_of(&job.request);
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

    /// Answers a request for an image by a preview, as if the camera were moving. Used while only a sample of the
    /// points is loaded, and before the first exact image.
    fn answer_by_sample(&mut self, job: &Job) -> Result<(), String> {
        let mut request = job.request.clone();
        request["moving"] = true.into();
        self.answer(&Job { outbox: job.outbox.clone(), request })
    }
}
