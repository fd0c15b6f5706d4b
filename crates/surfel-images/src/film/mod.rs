//! Films: sequences of frames as animated PNG, GIF or MP4.
//!
//! A [`FilmWriter`] encodes frames on its own thread, while further frames are drawn. Only a few frames are in memory
//! at a time. The file appears when it is complete. Animated PNG and GIF are encoded in this module. MP4 is encoded by
//! the program `ffmpeg`, which is started as a child process and receives the frames through a pipe.
//!
//! Only animated PNG has alpha. In other formats, frames are blended onto a background.

mod apng;
mod ffmpeg;
#[cfg(feature = "gif")]
mod gif;
#[cfg(feature = "gif")]
mod palette;

pub use ffmpeg::Ffmpeg;

use crate::color::linear_of_8_bit;
use crate::planes::PlanesView;
use crate::png::to_srgb8;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use surfel_files::error::{IoError, WRITE};
use surfel_math::srgb::nearest_8_bit;

/// Maximum number of drawn frames that wait for the encoder. Drawing pauses while there are that many, so that memory
/// stays bounded.
const WAITING: usize = 2;

/// File format of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FilmFormat {
    /// Animated PNG: lossless, with alpha.
    Apng,
    /// GIF: 256 colours per frame, without alpha.
    Gif,
    /// MP4 with H.264: small, lossy, without alpha.
    Mp4,
}

impl FilmFormat {
    /// Returns the format for the extension of a file's name; `None` for other extensions. A `.png` is a still image.
    pub fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_string_lossy().to_ascii_lowercase();
        match extension.as_str() {
            "apng" => Some(Self::Apng),
            "gif" => Some(Self::Gif),
            "mp4" => Some(Self::Mp4),
            _ => None,
        }
    }

    /// True if the format has alpha.
    pub fn has_alpha(self) -> bool {
        self == Self::Apng
    }
}

/// Frame rate, in hundredths of a frame per second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRate(u32);

impl FrameRate {
    /// Largest supported frame rate of films, in frames per second.
    pub const MOST: f64 = 240.0;
    /// Largest rate of a GIF in frames per second. A GIF states delays in hundredths of a second, and browsers slow
    /// down delays of less than two.
    pub const MAX_OF_GIF: f64 = 50.0;

    /// Creates a rate from frames per second, rounded to hundredths; `None` if it isn't from 0.01 to [`Self::MOST`].
    pub fn new(per_second: f64) -> Option<Self> {
        (0.01..=Self::MOST).contains(&per_second).then(|| Self((100.0 * per_second).round() as u32))
    }

    /// Returns the rate in hundredths of a frame per second.
    pub fn hundredths(self) -> u32 {
        self.0
    }

    /// Returns the rate in frames per second.
    pub fn per_second(self) -> f64 {
        f64::from(self.0) / 100.0
    }

    #[cfg(any(feature = "gif", test))]
    /// Returns the time at which a frame begins, by its number, in units of 1/`unit` seconds, rounded.
    fn time(self, frame: u64, unit: u64) -> u64 {
        let rate = u64::from(self.0);
        (2 * 100 * unit * frame + rate) / (2 * rate)
    }
}

/// The default rate is 25 frames per second: a delay of exactly four hundredths of a second in a GIF.
impl Default for FrameRate {
    fn default() -> Self {
        Self(2500)
    }
}

/// Formats the number of frames per second, without trailing zeros.
impl fmt::Display for FrameRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.per_second())
    }
}

/// Encoder of a film.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FilmEncoder {
    /// Surfel's own encoder for animated PNG.
    Apng,
    /// Surfel's own encoder for GIF.
    #[cfg(feature = "gif")]
    Gif,
    /// The installed program ffmpeg, for MP4.
    Mp4(Ffmpeg),
}

impl FilmEncoder {
    /// Finds the encoder for the film at `path`, before frames are drawn.
    ///
    /// # Errors
    /// [`IoError::System`] for an extension other than those of films, for MP4 without a suitable `ffmpeg`, and for a
    /// format whose feature is disabled.
    pub fn find(path: &Path) -> Result<Self, IoError> {
        let refused = |what: String| cannot_write(path, io::Error::other(what));
        match FilmFormat::of(path) {
            Some(FilmFormat::Apng) => Ok(Self::Apng),
            #[cfg(feature = "gif")]
            Some(FilmFormat::Gif) => Ok(Self::Gif),
            #[cfg(not(feature = "gif"))]
            Some(FilmFormat::Gif) => Err(refused("this build has no encoder of GIF (feature \"gif\")".to_owned())),
            Some(FilmFormat::Mp4) => Ffmpeg::find().map(Self::Mp4).map_err(refused),
            None => Err(refused("expected a name that ends in .mp4, .gif or .apng".to_owned())),
        }
    }

    /// Returns the format that the encoder writes.
    pub fn format(&self) -> FilmFormat {
        match self {
            Self::Apng => FilmFormat::Apng,
            #[cfg(feature = "gif")]
            Self::Gif => FilmFormat::Gif,
            Self::Mp4(_) => FilmFormat::Mp4,
        }
    }
}

/// Formats the encoder's name for a note.
impl fmt::Display for FilmEncoder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Apng => f.write_str("Surfel as animated PNG"),
            #[cfg(feature = "gif")]
            Self::Gif => f.write_str("Surfel as GIF"),
            Self::Mp4(ffmpeg) => write!(f, "{ffmpeg}"),
        }
    }
}

/// Frame size, length, frame rate and background of a film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmOptions {
    /// Width and height of the frames in pixels.
    pub size: [u32; 2],
    /// Number of frames, at least 1.
    pub frames: u32,
    /// Frame rate of the film.
    pub rate: FrameRate,
    /// Background in linear RGB, onto which frames are blended in formats without alpha ([`FilmFormat::has_alpha`]).
    pub background: [f32; 3],
}

/// Pixels of a frame: sRGB-encoded with straight alpha, in rows from the top.
type Pixels = Vec<[u8; 4]>;

/// Frames that the encoder's thread receives from the [`FilmWriter`]. The message `None` follows the last one.
struct Frames(Receiver<Option<Pixels>>);

impl Frames {
    /// Returns the next frame, or `None` after the last one.
    fn next(&self) -> io::Result<Option<Pixels>> {
        // If the channel closes without the final message, the writer was dropped, and no file may appear.
        self.0.recv().map_err(|_| io::Error::other("the film is incomplete"))
    }
}

fn cannot_write(path: &Path, source: io::Error) -> IoError {
    IoError::System { path: path.to_path_buf(), action: WRITE, source }
}

/// Writer of a film. The file appears when [`FilmWriter::finish`] succeeds. If the writer is dropped earlier, no file
/// remains.
#[derive(Debug)]
pub struct FilmWriter {
    path: PathBuf,
    options: FilmOptions,
    has_alpha: bool,
    pushed: u32,
    /// Channel to the encoder's thread: frames, then `None` as the end mark. [`Self::end`] drops the sender, which
    /// closes the channel.
    frames: Option<SyncSender<Option<Pixels>>>,
    thread: Option<JoinHandle<Result<(), IoError>>>,
}

impl FilmWriter {
    /// Starts encoding a film. An existing file is replaced only if `overwrite` is true.
    ///
    /// # Errors
    /// [`IoError::Exists`] if the file exists and `overwrite` is false. [`IoError::System`] if the format doesn't
    /// support the frames' size, number or rate, or no thread can be started.
    pub fn create(path: &Path, overwrite: bool, encoder: &FilmEncoder, options: &FilmOptions) -> Result<Self, IoError> {
        check(encoder.format(), options).map_err(|what| cannot_write(path, io::Error::other(what)))?;
        if path.is_file() && !overwrite {
            return Err(IoError::Exists { path: path.to_path_buf() });
        }
        let (sender, receiver) = sync_channel(WAITING);
        let (place, encoder, options) = (path.to_path_buf(), encoder.clone(), *options);
        let has_alpha = encoder.format().has_alpha();
        let work = move || encode(&place, overwrite, &encoder, &options, &Frames(receiver));
        let thread = std::thread::Builder::new().name("film".to_owned()).spawn(work);
        let thread = Some(thread.map_err(|source| cannot_write(path, source))?);
        Ok(Self { path: path.to_path_buf(), options, has_alpha, pushed: 0, frames: Some(sender), thread })
    }

    /// Adds a frame: its 8-bit sRGB plane (`rgba8`) if there is one, or else its colour plane.
    ///
    /// # Errors
    /// [`IoError::System`] if the frame has another size or no colours, or if the film already has all of its frames.
    /// Also errors of writing earlier frames.
    pub fn push(&mut self, planes: &PlanesView<'_>) -> Result<(), IoError> {
        let invalid = |what: String| cannot_write(&self.path, io::Error::new(io::ErrorKind::InvalidInput, what));
        let count = planes.pixels().map_err(|source| cannot_write(&self.path, source))?;
        let (found, expected) = ([planes.width, planes.height], self.options.size);
        if found != expected {
            return Err(invalid(format!("frame {} has {found:?} pixels, expected {expected:?}", self.pushed)));
        }
        if self.pushed == self.options.frames {
            return Err(invalid(format!("a film of {} frames got another", self.pushed)));
        }
        let encoded = planes.rgba8.map(<[_]>::to_vec).or_else(|| planes.color.map(to_srgb8));
        let mut pixels = encoded.filter(|pixels| pixels.len() == count);
        if let Some(pixels) = pixels.as_mut().filter(|_| !self.has_alpha) {
            blend(pixels, self.options.background);
        }
        let pixels = pixels.ok_or_else(|| invalid("a film needs colours".to_owned()))?;
        let sent = self.frames.as_ref().is_some_and(|frames| frames.send(Some(pixels)).is_ok());
        self.pushed += 1;
        if sent { Ok(()) } else { self.end() }
    }

    /// Completes the film, and waits until it is written.
    ///
    /// # Errors
    /// [`IoError::System`] if frames are missing or the file can't be written; [`IoError::Exists`] if another program
    /// created the file in the meantime.
    pub fn finish(mut self) -> Result<(), IoError> {
        if self.pushed == self.options.frames
            && let Some(frames) = &self.frames
        {
            // If the thread has already ended, its result states the reason.
            let _ = frames.send(None);
        }
        self.end()
    }

    /// Closes the channel, waits for the encoder's thread, and returns its result.
    fn end(&mut self) -> Result<(), IoError> {
        self.frames = None;
        let ended = self.thread.take().map(JoinHandle::join);
        let broken = || Err(cannot_write(&self.path, io::Error::other("the encoder has ended")));
        ended.map_or_else(broken, |result| result.unwrap_or_else(|_| broken()))
    }
}

impl Drop for FilmWriter {
    fn drop(&mut self) {
        if self.thread.is_some() {
            let _ = self.end();
        }
    }
}

/// Checks that a format supports the size, number and rate of a film's frames. Returns the reason if it doesn't.
fn check(format: FilmFormat, options: &FilmOptions) -> Result<(), String> {
    let [width, height] = options.size;
    if options.frames == 0 || width == 0 || height == 0 {
        return Err("a film has at least one frame and one pixel".to_owned());
    }
    if format == FilmFormat::Gif && width.max(height) > u32::from(u16::MAX) {
        return Err(format!("a GIF has at most {} pixels a side, found {width}x{height}", u16::MAX));
    }
    if format == FilmFormat::Gif && options.rate.per_second() > FrameRate::MAX_OF_GIF {
        let most = FrameRate::MAX_OF_GIF;
        return Err(format!("a GIF has at most {most} frames a second, found {}", options.rate));
    }
    Ok(())
}

/// Encodes all frames that arrive, and writes the file. This is the work of the encoder's thread.
fn encode(
    path: &Path,
    overwrite: bool,
    encoder: &FilmEncoder,
    options: &FilmOptions,
    frames: &Frames,
) -> Result<(), IoError> {
    match encoder {
        FilmEncoder::Apng => surfel_files::atomic::write(path, overwrite, |out| apng::write(out, options, frames)),
        #[cfg(feature = "gif")]
        FilmEncoder::Gif => surfel_files::atomic::write(path, overwrite, |out| gif::write(out, options, frames)),
        FilmEncoder::Mp4(ffmpeg) => ffmpeg.write(path, overwrite, options, frames),
    }
}

/// Blends pixels with straight alpha onto a background in linear RGB. The blend is computed in linear light.
fn blend(pixels: &mut [[u8; 4]], background: [f32; 3]) {
    let linear = linear_of_8_bit();
    let opaque = background.map(nearest_8_bit);
    for pixel in pixels {
        let [r, g, b, a] = *pixel;
        let [r, g, b] = match a {
            255 => continue,
            0 => opaque,
            _ => {
                let share = f32::from(a) / 255.0;
                let mix = |c: u8, behind: f32| nearest_8_bit(linear[usize::from(c)] * share + behind * (1.0 - share));
                [mix(r, background[0]), mix(g, background[1]), mix(b, background[2])]
            }
        };
        *pixel = [r, g, b, 255];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) const SIZE: [u32; 2] = [9, 7];

    /// Returns a frame with a gradient that moves from frame to frame.
    pub(super) fn frame(index: u32) -> Pixels {
        let [width, height] = SIZE;
        let level = |value: u32| (value % 256) as u8;
        let pixel = |i: u32| {
            let (x, y) = (i % width, i / width);
            [level(20 * x + 40 * index), level(30 * y), level(10 * (x + y)), if x == 0 { 128 } else { 255 }]
        };
        (0..width * height).map(pixel).collect()
    }

    /// Writes a film of three frames and returns it.
    pub(super) fn film(name: &str, rate: f64) -> Result<Vec<u8>, IoError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        let rate = FrameRate::new(rate).unwrap();
        let options = FilmOptions { size: SIZE, frames: 3, rate, background: [1.0; 3] };
        let mut film = FilmWriter::create(&path, false, &FilmEncoder::find(&path)?, &options)?;
        for index in 0..3 {
            let pixels = frame(index);
            let planes = PlanesView { width: SIZE[0], height: SIZE[1], rgba8: Some(&pixels), ..PlanesView::default() };
            film.push(&planes)?;
        }
        film.finish()?;
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        Ok(std::fs::read(&path).unwrap())
    }

    #[test]
    fn incomplete_films_leave_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.apng");
        let options = FilmOptions { size: SIZE, frames: 3, rate: FrameRate::default(), background: [1.0; 3] };
        let pixels = frame(0);
        let planes = PlanesView { width: SIZE[0], height: SIZE[1], rgba8: Some(&pixels), ..PlanesView::default() };
        let create = || FilmWriter::create(&path, false, &FilmEncoder::Apng, &options).unwrap();
        let mut film = create();
        film.push(&planes).unwrap();
        drop(film);
        let mut film = create();
        film.push(&planes).unwrap();
        assert!(film.finish().unwrap_err().to_string().contains("incomplete"));
        let mut film = create();
        assert!(film.push(&PlanesView { height: 6, ..planes.clone() }).is_err());
        (0..3).for_each(|_| film.push(&planes).unwrap());
        assert!(film.push(&planes).is_err());
        drop(film);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        std::fs::write(&path, "x").unwrap();
        assert!(matches!(FilmWriter::create(&path, false, &FilmEncoder::Apng, &options), Err(IoError::Exists { .. })));
        let missing = folder.path().join("missing/a.apng");
        let film = FilmWriter::create(&missing, false, &FilmEncoder::Apng, &options).unwrap();
        assert!(film.finish().is_err());
    }

    #[test]
    fn rates_and_formats_are_checked() {
        assert!([0.0, -1.0, f64::NAN, 241.0].iter().all(|rate| FrameRate::new(*rate).is_none()));
        let rate = FrameRate::new(29.97).unwrap();
        assert_eq!(
            (rate.hundredths(), rate.to_string(), FrameRate::default().to_string()),
            (2997, "29.97".into(), "25".into())
        );
        // 30 frames a second in hundredths of a second: 3, 4, 3, 3, 4, 3, …
        let thirty = FrameRate::new(30.0).unwrap();
        let times: Vec<u64> = (0..7).map(|frame| thirty.time(frame, 100)).collect();
        assert_eq!(times, [0, 3, 7, 10, 13, 17, 20]);
        assert_eq!(thirty.time(3000, 100), 10_000);
        assert_eq!(FilmFormat::of(Path::new("a.MP4")), Some(FilmFormat::Mp4));
        assert!(["a.png", "mp4", "a"].iter().all(|name| FilmFormat::of(Path::new(name)).is_none()));
        assert!(film("a.gif", 51.0).unwrap_err().to_string().contains("at most 50"));
        assert!(FilmEncoder::find(Path::new("a.avi")).is_err());
    }

    #[test]
    fn transparent_pixels_show_the_background() {
        let mut pixels = vec![[9, 9, 9, 0], [0, 0, 0, 128], [1, 2, 3, 255]];
        blend(&mut pixels, [1.0, 0.0, 1.0]);
        // Half of the light: 188 of 255.
        assert_eq!(pixels, [[255, 0, 255, 255], [187, 0, 187, 255], [1, 2, 3, 255]]);
    }
}
