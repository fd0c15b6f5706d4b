//! The drawing thread: answers the requests of all pages, one after another.

use crate::desk::{Answer, Desk, layer_of};
use crate::hub::{Hub, Job, Next, Outgoing};
use serde_json::{Value, json};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use surfel_app::session::{Loaded, Loader};
use surfel_app::wording::as_flags;
use surfel_load::Error;
use surfel_sample::Progress;

/// Largest number of requests that wait for loading.
const MAX_DEFERRED: usize = 64;
/// Size of the image that the scene is first framed for.
const FIRST_SIZE: [u32; 2] = [1024, 768];
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

/// The drawing thread's state.
pub(crate) struct Artist {
    hub: Arc<Hub>,
    desk: Desk,
    /// Requests that wait until all points are loaded.
    deferred: Vec<Job>,
}

impl Artist {
    pub(crate) fn new(hub: Arc<Hub>, desk: Desk) -> Self {
        Self { hub, desk, deferred: Vec::new() }
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
        let mut is_first = true;
        loop {
            let Next::Job(job) = hub.next() else { continue };
            // The metadata of an exact image need the hash of each file: before the first, the page gets one without.
            if job.request["do"] == "draw" && std::mem::take(&mut is_first) {
                let _ = self.answer_by_sample(&job);
            }
            self.reply(&job);
        }
    }

    /// Answers a request, or sends its error.
    fn reply(&mut self, job: &Job) {
        if let Err(problem) = &self.answer(job) {
            let request = &job.request;
            let (id, layer, of) = (&request["id"], &request["layer"], &request["do"]);
            let answer = json!({ "do": "error", "id": id, "layer": layer, "of": of, "message": as_flags(problem) });
            job.outbox.push(Outgoing::Text(answer.to_string()));
        }
    }

    /// Answers a request, with progress for all pages.
    fn answer(&mut self, job: &Job) -> Result<(), String> {
        let hub = self.hub.clone();
        let report = Report::new(&hub);
        match self.desk.answer(Arc::as_ptr(&job.outbox) as usize, &job.request, &report)? {
            Answer::Text(answer) => job.outbox.push(Outgoing::Text(answer.to_string())),
            Answer::Image(file) => job.outbox.put_image(layer_of(&job.request), file),
            Answer::File(file) => job.outbox.push(Outgoing::Binary(file)),
        }
        Ok(())
    }

    /// Loads the files before the first request. Pages see a sample of many points meanwhile, and can move it.
    fn load_first(&mut self, note: &mut dyn FnMut(&str)) -> Result<(), String> {
        let text = |e: Error| e.to_string();
        let asked = self.desk.asked_of(&Value::Null, &self.desk.initial, FIRST_SIZE)?;
        let hub = self.hub.clone();
        let report = Report::new(&hub);
        let session = self.desk.session(&asked.key)?;
        // A pool of one thread is busy with this function.
        let can_share = rayon::current_num_threads() > 1;
        let loader = if can_share { session.show_coarse(&asked.options.render, &report).map_err(text)? } else { None };
        if let Some(loader) = loader {
            let loaded = self.show_sample(loader)?;
            self.desk.session(&asked.key)?.adopt(loaded.map_err(text)?);
        }
        let mut notes = Vec::new();
        // A page that is open already has a size and options of its own, which its image needs.
        let of_page = self.hub.waiting_draw().and_then(|request| self.desk.asked_by_page(&request).ok());
        let asked = of_page.filter(|of_page| of_page.key == asked.key).unwrap_or(asked);
        let session = self.desk.session(&asked.key)?;
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
            if job.request["do"] == "draw" && self.answer_by_sample(&job).is_ok() && job.request["moving"] == true {
                continue;
            }
            // The exact image, and everything else, follows once all points are there.
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

    /// Sends an image of the resident sample.
    fn answer_by_sample(&mut self, job: &Job) -> Result<(), String> {
        let mut request = job.request.clone();
        request["moving"] = true.into();
        self.answer(&Job { outbox: job.outbox.clone(), request })
    }
}
