//! Sequences: each input is a frame. The next frame is loaded while a frame is drawn.

use super::{Drawn, Job, Session, Sink, planes, print_scene};
use crate::failure::Failure;
use crate::stats;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use surfel_app::film::Sequence;
use surfel_app::progressive::Detail;
use surfel_app::request::Resolved;
use surfel_backend::Backend;
use surfel_load::Error;
use surfel_render::Renderer as _;
use surfel_sample::{NoProgress, Progress as _};

/// A loaded frame with the notes on its file, or the error of loading it. The loading thread sends it to the drawing
/// thread.
type Loaded = Result<(Resolved, Vec<String>), Error>;

impl Session<'_> {
    /// Draws each input as a frame of one film, or as a numbered image.
    pub(super) fn draw_sequence(&mut self) -> Result<Drawn, Failure> {
        let (args, console) = (self.args, self.console);
        let sequence = self.survey()?;
        if args.print_scene {
            print_scene(&sequence.scene(0))?;
        }
        let Some(mut backend) = self.backend.take() else { return Ok(Drawn::default()) };
        let label = args.inputs.first().map_or(Path::new(""), PathBuf::as_path);
        let mut frames: Vec<(u32, Option<PathBuf>)> =
            self.frames_of(label).iter().map(|index| (*index, None)).collect();
        frames.iter_mut().zip(self.paths(&backend, label)).for_each(|((_, path), own)| *path = Some(own));
        let all = frames.len();
        frames.retain(|(_, path)| !path.as_ref().is_some_and(|path| self.skips(path)));
        if frames.len() < all {
            console.note(&format!("left out {} of {all} pictures, which exist", all - frames.len()));
        }
        let planes = planes(&args.render, false, self.output.as_ref());
        let mut job = Job::new(args, console, planes, true);
        let mut sink = Sink::new(self.film(&backend, label, frames.len()));
        let other = self.draw_frames(&sequence, &frames, &mut backend, (&mut job, &mut sink))?;
        let files = sink.finish(console, frames.len() as u32, job.why_blank)?;
        let stats = args.stats.then(|| {
            let (size, info) = ([job.frame.width(), job.frame.height()], other.as_ref().unwrap_or(&backend).info());
            stats::json(&job.runs, info, size, frames.len() as u32, None)
        });
        self.backend = Some(backend);
        Ok(Drawn { files, stats, verified: None })
    }

    /// Determines the up axis, camera and other choices that all frames share, and prints the notes.
    fn survey(&self) -> Result<Sequence, Failure> {
        let (progress, mut notes) = (self.console.progress(), Vec::new());
        let note = &mut |note| notes.push(note);
        let found = Sequence::survey(&self.args.inputs, &self.args.render, &self.series.pictures, &progress, note);
        drop(progress);
        notes.iter().for_each(|note| self.console.note(note));
        Ok(found?)
    }

    /// Draws the frames in order. Returns the backend that drew them if it isn't `backend`.
    fn draw_frames(
        &self,
        sequence: &Sequence,
        frames: &[(u32, Option<PathBuf>)],
        backend: &mut Backend,
        (job, sink): (&mut Job<'_>, &mut Sink<'_>),
    ) -> Result<Option<Backend>, Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads).build();
        let pool = pool.map_err(|error| Failure::other(format!("can't start {} threads: {error}", self.threads)))?;
        let indices: Vec<usize> = frames.iter().map(|(index, _)| *index as usize).collect();
        // A loaded frame is received when the previous one has been drawn, so that at most two are in memory.
        let (sender, receiver) = sync_channel(0);
        std::thread::scope(|scope| {
            scope.spawn(move || pool.install(|| load(sequence, &indices, &sender)));
            self.draw_loaded(frames, &receiver, backend, (job, sink))
        })
    }

    fn draw_loaded(
        &self,
        frames: &[(u32, Option<PathBuf>)],
        loaded: &Receiver<Loaded>,
        backend: &mut Backend,
        (job, sink): (&mut Job<'_>, &mut Sink<'_>),
    ) -> Result<Option<Backend>, Failure> {
        let bar = self.console.progress();
        bar.stage("frames", frames.len() as u64);
        let mut other = None;
        for ((_, path), next) in frames.iter().zip(loaded) {
            let (mut resolved, notes) = next?;
            notes.iter().for_each(|note| self.console.detail(note));
            if other.is_none() {
                other = self.suitable(backend, &resolved, job.planes)?;
            }
            let backend = other.as_mut().unwrap_or(backend);
            self.draw_frame(job, backend, &mut resolved, (path.as_deref(), sink))?;
            bar.advance(1);
        }
        Ok(other)
    }

    fn draw_frame(
        &self,
        job: &mut Job<'_>,
        backend: &mut Backend,
        resolved: &mut Resolved,
        (path, sink): (Option<&Path>, &mut Sink<'_>),
    ) -> Result<(), Failure> {
        job.scene = None;
        let camera = resolved.file.camera.clone();
        job.render(backend, resolved, Detail::Full, &camera, None)?;
        let file = resolved.file.clone();
        // The inputs of each frame differ, so that no hashes can be cached.
        self.put(sink, path, job, (&file, &resolved.beside), (backend, &mut None))
    }
}

/// Loads frames in order and sends them, until all are loaded, one fails, or the receiver is closed.
fn load(sequence: &Sequence, indices: &[usize], frames: &SyncSender<Loaded>) {
    for index in indices {
        let mut notes = Vec::new();
        let loaded = sequence.load(*index, &NoProgress, &mut |note| notes.push(note));
        let is_last = loaded.is_err();
        if frames.send(loaded.map(|resolved| (resolved, notes))).is_err() || is_last {
            return;
        }
    }
}
