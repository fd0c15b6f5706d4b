//! Films: paths of a camera, and sequences of files.
//!
//! 1. [`CameraPath`] is a path through keys, which are saved cameras. The path gives the camera of each frame.
//! 2. [`Sequence`] draws several files as frames of one film. Camera, light, up axis, colours and the size of balls are
//!    chosen once, from a sample of all files. So brightness, colours and sizes don't flicker.
//! 3. [`FilmWriter`] encodes frames as animated PNG, GIF or MP4.
//!
//! ```no_run
//! # fn main() -> Result<(), surfel_load::Error> {
//! use surfel_app::film::{FilmEncoder, FilmOptions, FilmWriter, FrameRate};
//! use surfel_app::request::{Pictures, Request, Source};
//! use surfel_backend::Backend;
//! use surfel_render::{Planes, Renderer as _};
//! let (out, frames) = ("turn.gif".as_ref(), 36);
//! let mut options = surfel_app::RenderOptions::default();
//! options.turntable = true;
//! let request = Request::new(Source::of(&["scan.ply".into()], None)?, &Pictures::Turn(frames), &options)?;
//! let loaded = request.load(&surfel_sample::NoProgress)?;
//! let resolved = request.resolve(loaded, &surfel_sample::NoProgress, &mut |note| eprintln!("{note}"))?;
//! let (mut backend, settings) = (Backend::auto()?, resolved.file.settings);
//! let film = FilmOptions { size: [1024, 1024], frames, rate: FrameRate::default(), background: [1.0; 3] };
//! let mut film = FilmWriter::create(out, false, &FilmEncoder::find(out)?, &film)?;
//! for index in 0..frames {
//!     let (camera, moved) = resolved.turned(index, frames);
//!     let resident = backend.upload(moved.as_ref().unwrap_or(&resolved.scene))?;
//!     let mut frame = surfel_render::Frame::default();
//!     let view = surfel_app::camera::view(&camera, &options)?;
//!     backend.render_into(&resident, &view, &settings, Planes::RGBA8, &mut frame)?;
//!     film.push(&frame.planes())?;
//! }
//! film.finish()?;
//! # Ok(())
//! # }
//! ```

mod path;
mod sequence;

pub use path::CameraPath;
pub use sequence::Sequence;
pub use surfel_io::film::{FilmEncoder, FilmFormat, FilmOptions, FilmWriter, FrameRate};

/// Duration, in seconds, of a turntable movie if no number of frames is given.
const TURN_SECONDS: f64 = 4.0;
/// Duration in seconds between two successive keys of a camera path, if the keys have no times and no number of frames
/// is given.
const KEY_SECONDS: f64 = 2.0;

/// Returns the number of frames of a turntable that lasts four seconds.
pub fn turn_frames(rate: FrameRate) -> u32 {
    (TURN_SECONDS * rate.per_second()).round().max(1.0) as u32
}

impl CameraPath {
    /// Returns the number of frames at a frame rate. The duration comes from the keys' times, or is two seconds from
    /// key to key. An open path has one frame more, for its last key.
    pub fn frames(&self, rate: FrameRate) -> u32 {
        let ways = self.keys() - usize::from(!self.is_closed());
        let seconds = self.seconds().unwrap_or(KEY_SECONDS * ways as f64);
        let steps = (seconds * rate.per_second()).round().clamp(1.0, f64::from(MAX_FRAMES)) as u32;
        steps + u32::from(!self.is_closed())
    }
}

/// Largest number of steps between the frames of a camera path; a longer path gets this number.
const MAX_FRAMES: u32 = 1_000_000;
