//! Film output of a run: frames are sent to a video encoder one by one.

use crate::console::Console;
use crate::failure::Failure;
use crate::output::Output;
use std::path::{Path, PathBuf};
use surfel_app::film::{FilmEncoder, FilmOptions, FilmWriter, FrameRate};
use surfel_io::ShowPath as _;
use surfel_render::Frame;

/// Film that is being written. The encoder starts with the first frame, which gives the size of the film.
pub(crate) struct Film<'a> {
    path: PathBuf,
    encoder: &'a FilmEncoder,
    overwrite: bool,
    frames: u32,
    rate: FrameRate,
    writer: Option<FilmWriter>,
}

impl<'a> Film<'a> {
    /// Prepares a film of this many frames.
    pub(crate) fn new(path: &Path, output: &Output, encoder: &'a FilmEncoder, frames: u32, rate: FrameRate) -> Self {
        let (path, overwrite) = (path.to_path_buf(), output.overwrites());
        Self { path, encoder, overwrite, frames, rate, writer: None }
    }

    /// Appends a frame. If the film has no alpha, the frame is blended onto the background colour, which is linear RGB.
    pub(crate) fn push(&mut self, frame: &Frame, [r, g, b, _]: [f64; 4], console: &Console) -> Result<(), Failure> {
        let planes = frame.planes();
        let writer = match &mut self.writer {
            Some(writer) => writer,
            None => {
                let background = [r, g, b].map(|c| c as f32);
                let size = [frame.width(), frame.height()];
                let options = FilmOptions { size, frames: self.frames, rate: self.rate, background };
                tell_of_alpha(&self.path, self.encoder, frame, [r, g, b], console);
                let writer = FilmWriter::create(&self.path, self.overwrite, self.encoder, &options)?;
                self.writer.insert(writer)
            }
        };
        Ok(writer.push(&planes)?)
    }

    /// Completes the film, and prints a note on its length and encoder.
    pub(crate) fn finish(self, console: &Console) -> Result<PathBuf, Failure> {
        let Some(writer) = self.writer else { return Ok(self.path) };
        writer.finish()?;
        let (frames, rate) = (self.frames, self.rate);
        let seconds = f64::from(frames) / rate.per_second();
        let frames = if frames == 1 { "1 frame".to_owned() } else { format!("{frames} frames") };
        let path = self.path.shown();
        console.note(&format!("{path}: {frames}, {seconds:.1} s at {rate} a second, encoded by {}", self.encoder));
        Ok(self.path)
    }
}

/// Prints a note if the film's format has no alpha, but the first frame has some. `[r, g, b]` is the background that
/// replaces it.
fn tell_of_alpha(path: &Path, encoder: &FilmEncoder, frame: &Frame, [r, g, b]: [f64; 3], console: &Console) {
    let is_transparent = frame.rgba8().iter().any(|pixel| pixel[3] < 255);
    if is_transparent && !encoder.format().has_alpha() {
        let path = path.shown();
        console.note(&format!(
            "{path}: this format has no transparency, so the frames are blended onto the background's colour \
             {r},{g},{b}"
        ));
    }
}
