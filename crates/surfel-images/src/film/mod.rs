//! Films: frames as animated PNG, GIF or MP4.
//!
//! A [`FilmWriter`] encodes the frames on a thread of its own while the next ones are drawn. Only a few frames are in
//! memory at a time, and the file appears once it is complete. Animated PNG and GIF are encoded here. MP4 is encoded by
//! `ffmpeg`, which is started as a program of its own and gets the frames through a pipe.
//!
//! Animated PNG alone has alpha; frames of the other formats are blended onto a background.

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

/// Number of drawn frames that wait for the encoder.
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
    /// Returns the format that a file's name states; `None` for other names. A `.png` is a still image.
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

/// Number of frames a second, in hundredths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRate(u32);

impl FrameRate {
    /// Largest rate in frames a second.
    pub const MOST: f64 = 240.0;
    /// Largest rate of a GIF, whose delays are hundredths of a second. Browsers slow down shorter delays than two.
    pub const MOST_OF_GIF: f64 = 50.0;

    /// Returns a rate in frames a second, rounded to hundredths; `None` if it isn't from 0.01 to [`Self::MOST`].
    pub fn new(per_second: f64) -> Option<Self> {
        (0.01..=Self::MOST).contains(&per_second).then(|| Self((100.0 * per_second).round() as u32))
    }

    /// Returns the number of frames in 100 seconds.
    pub fn hundredths(self) -> u32 {
        self.0
    }

    /// Returns the number of frames a second.
    pub fn per_second(self) -> f64 {
        f64::from(self.0) / 100.0
    }

    #[cfg(any(feature = "gif", test))]
    /// Returns the time of a frame, by its number, in units of 1/`unit` seconds, rounded.
    fn time(self, frame: u64, unit: u64) -> u64 {
        let rate = u64::from(self.0);
        (2 * 100 * unit * frame + rate) / (2 * rate)
    }
}

/// The rate of films for which none is stated: a delay of exactly four hundredths of a second in a GIF.
impl Default for FrameRate {
    fn default() -> Self {
        Self(2500)
    }
}

/// Frames a second, without trailing zeros.
impl fmt::Display for FrameRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.per_second())
    }
}

/// Program part that encodes a film.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FilmEncoder {
    /// The encoder of animated PNG.
    Apng,
    /// The encoder of GIF.
    #[cfg(feature = "gif")]
    Gif,
    /// The installed ffmpeg.
    Mp4(Ffmpeg),
}

impl FilmEncoder {
    /// Finds the encoder of the film at `path`, before any frame is drawn.
    ///
    /// # Errors
    /// [`IoError::System`] if the name is of no film, for MP4 without a suitable `ffmpeg`, and for a format that isn't
    /// built in.
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

    /// Returns the format of the film.
    pub fn format(&self) -> FilmFormat {
        match self {
            Self::Apng => FilmFormat::Apng,
            #[cfg(feature = "gif")]
            Self::Gif => FilmFormat::Gif,
            Self::Mp4(_) => FilmFormat::Mp4,
        }
    }
}

/// The encoder's name, as in a note.
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

/// Properties of a film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmOptions {
    /// Width and height of the frames in pixels.
    pub size: [u32; 2],
    /// Number of frames, at least 1.
    pub frames: u32,
    /// Number of frames a second.
    pub rate: FrameRate,
    /// Background in linear RGB, for formats without alpha.
    pub background: [f32; 3],
}

/// Pixels of a frame: sRGB-encoded, with straight alpha, row by row from the top.
type Pixels = Vec<[u8; 4]>;

/// Frames on their way to the encoder.
struct Frames(Receiver<Option<Pixels>>);

impl Frames {
    /// Returns the next frame; `None` after the last.
    fn next(&self) -> io::Result<Option<Pixels>> {
        // Without the message for the end, the writer was dropped: nothing may appear.
        self.0.recv().map_err(|_| io::Error::other("the film is incomplete"))
    }
}

fn cannot_write(path: &Path, source: io::Error) -> IoError {
    IoError::System { path: path.to_path_buf(), action: WRITE, source }
}

/// A film that is being written. The file appears when [`FilmWriter::finish`] succeeds; dropping the writer before
/// leaves nothing behind.
#[derive(Debug)]
pub struct FilmWriter {
    path: PathBuf,
    options: FilmOptions,
    has_alpha: bool,
    pushed: u32,
    /// Channel to the encoder's thread; `None` once it has ended.
    frames: Option<SyncSender<Option<Pixels>>>,
    thread: Option<JoinHandle<Result<(), IoError>>>,
}

impl FilmWriter {
    /// Starts the encoder of a film. An existing file is replaced only if `overwrite` is true.
    ///
    /// # Errors
    /// [`IoError::Exists`], and [`IoError::System`] if the format can't hold such frames, or the system starts no
    /// thread.
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

    /// Adds a frame: the encoded plane (`rgba8`) if it exists, else the colour plane.
    ///
    /// # Errors
    /// [`IoError::System`] if the frame has another size or the film has enough frames; and errors of writing earlier
    /// frames.
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

    /// Completes the film.
    ///
    /// # Errors
    /// [`IoError::System`] if frames are missing or the file can't be written; [`IoError::Exists`] if it appeared
    /// meanwhile.
    pub fn finish(mut self) -> Result<(), IoError> {
        if self.pushed == self.options.frames
            && let Some(frames) = &self.frames
        {
            // The thread's result tells if it has ended early.
            let _ = frames.send(None);
        }
        self.end()
    }

    /// Waits for the encoder.
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

/// Refuses frames that a format can't hold.
fn check(format: FilmFormat, options: &FilmOptions) -> Result<(), String> {
    let [width, height] = options.size;
    if options.frames == 0 || width == 0 || height == 0 {
        return Err("a film has at least one frame and one pixel".to_owned());
    }
    if format == FilmFormat::Gif && width.max(height) > u32::from(u16::MAX) {
        return Err(format!("a GIF has at most {} pixels a side, found {width}x{height}", u16::MAX));
    }
    if format == FilmFormat::Gif && options.rate.per_second() > FrameRate::MOST_OF_GIF {
        let most = FrameRate::MOST_OF_GIF;
        return Err(format!("a GIF has at most {most} frames a second, found {}", options.rate));
    }
    Ok(())
}

/// Writes a film of all frames of a channel.
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

/// Blends pixels with straight alpha onto a background in linear RGB, in linear light.
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
