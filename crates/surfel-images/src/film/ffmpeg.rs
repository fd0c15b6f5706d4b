//! Writing of MP4 films by the installed program `ffmpeg`.
//!
//! Surfel contains no encoder of H.264. It starts ffmpeg as a child process, and writes raw frames to its standard
//! input. Frames have sRGB-encoded RGB levels, which ffmpeg converts to BT.709 with 4:2:0 subsampling. Subsampling
//! needs even sides, so that the last column or row of a frame with an odd side is written twice.

use super::{FilmOptions, Frames, Pixels, cannot_write};
use std::fmt;
use std::io::{self, BufWriter, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use surfel_files::atomic::Pending;
use surfel_files::error::IoError;
use surfel_files::programs::Program;

/// Name of ffmpeg's encoder for H.264 video.
const ENCODER: &str = "libx264";
/// Command-line options of ffmpeg for speed and quality. The quality is visually lossless, so that flat areas and thin
/// lines show no artefacts.
const QUALITY: [&str; 4] = ["-preset", "fast", "-crf", "17"];

/// Advice in error messages if ffmpeg is missing.
const HELP: &str = "install ffmpeg, or write .gif or .apng, which need no other program";
/// Maximum number of bytes of ffmpeg's messages that are stored. The last line of these is shown in an error.
const MESSAGE: usize = 1 << 16;

/// Installed ffmpeg that has an encoder for H.264.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ffmpeg {
    version: String,
}

/// Formats program, version and encoder for the note that states how a film is encoded.
impl fmt::Display for Ffmpeg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the installed ffmpeg {} ({ENCODER})", self.version)
    }
}

impl Ffmpeg {
    /// Finds `ffmpeg` on the search path, and checks that it has an encoder for H.264.
    ///
    /// # Errors
    /// A message that states what is missing, and how to proceed.
    pub(super) fn find() -> Result<Self, String> {
        let output = match Command::new("ffmpeg").arg("-encoders").stdin(Stdio::null()).output() {
            Ok(output) => output,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Err(format!("MP4 is encoded by ffmpeg, which isn't installed\n  help: {HELP}"));
            }
            Err(error) => return Err(format!("ffmpeg can't be started: {error}\n  help: {HELP}")),
        };
        let [list, banner] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
        let version = version(&banner).or_else(|| version(&list)).unwrap_or("of unknown version").to_owned();
        if !list.lines().any(|line| line.split_whitespace().nth(1) == Some(ENCODER)) {
            return Err(format!(
                "ffmpeg {version} has no encoder {ENCODER}\n  help: install another, or write .gif or .apng"
            ));
        }
        Ok(Self { version })
    }

    /// Writes the frames as MP4. ffmpeg writes to a temporary file, which replaces `path` when it is complete.
    pub(super) fn write(
        &self,
        path: &Path,
        overwrite: bool,
        options: &FilmOptions,
        frames: &Frames,
    ) -> Result<(), IoError> {
        let pending = Pending::new(path, overwrite)?;
        let cannot = |source| cannot_write(path, source);
        let program = Program::start(&mut Self::command(pending.temporary_path(), options)).map_err(cannot)?;
        let messages = program.stderr();
        let reader = std::thread::spawn(move || {
            let mut text = Vec::new();
            if let Some(mut messages) = messages {
                // All messages must be read, since ffmpeg would block otherwise.
                let _ = messages.by_ref().take(MESSAGE as u64).read_to_end(&mut text);
                let _ = io::copy(&mut messages, &mut io::sink());
            }
            String::from_utf8_lossy(&text).into_owned()
        });
        let fed = feed(&program, options.size, frames);
        if fed.as_ref().is_err_and(|error| error.kind() != io::ErrorKind::BrokenPipe) {
            drop(program);
            return fed.map_err(cannot);
        }
        let status = program.wait().map_err(cannot)?;
        let messages = reader.join().unwrap_or_default();
        if !status.success() || fed.is_err() {
            let said = messages.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it gave no reason");
            return Err(cannot(io::Error::other(format!("ffmpeg failed ({status}): {}", said.trim()))));
        }
        pending.publish()
    }

    /// Returns the command that encodes raw RGB frames from its standard input to the file `path`.
    fn command(path: &Path, options: &FilmOptions) -> Command {
        let [width, height] = even(options.size);
        let mut command = Command::new("ffmpeg");
        command.args(["-nostdin", "-hide_banner", "-loglevel", "error", "-f", "rawvideo", "-pixel_format", "rgb24"]);
        command.args(["-video_size", &format!("{width}x{height}")]);
        command.args(["-framerate", &format!("{}/100", options.rate.hundredths()), "-i", "pipe:0"]);
        let convert = "scale=in_range=pc:out_range=tv:out_color_matrix=bt709:flags=accurate_rnd+full_chroma_int,\
                       format=yuv420p";
        command.args(["-vf", convert, "-c:v", ENCODER]).args(QUALITY);
        command.args(["-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709"]);
        command.args(["-color_range", "tv", "-movflags", "+faststart", "-f", "mp4", "-y"]);
        let mut place = std::ffi::OsString::from("file:");
        place.push(path);
        command.arg(place).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        command
    }
}

/// Returns ffmpeg's version, such as 7.1, from the first line of its output.
fn version(text: &str) -> Option<&str> {
    text.lines().next()?.strip_prefix("ffmpeg version ")?.split_whitespace().next()
}

/// Returns a frame size with both sides rounded up to even numbers, which chroma subsampling needs.
fn even(size: [u32; 2]) -> [u32; 2] {
    size.map(|side| side.next_multiple_of(2))
}

/// Writes all frames to the standard input of ffmpeg.
fn feed(program: &Program, size: [u32; 2], frames: &Frames) -> io::Result<()> {
    let mut pipe = BufWriter::with_capacity(1 << 18, program.stdin().ok_or(io::ErrorKind::BrokenPipe)?);
    let mut bytes = Vec::new();
    while let Some(pixels) = frames.next()? {
        bytes.clear();
        put_rgb(&mut bytes, &pixels, size);
        pipe.write_all(&bytes)?;
    }
    pipe.flush()
}

/// Appends the RGB levels of a frame. The last column and row are repeated if necessary, so that both sides are even.
fn put_rgb(bytes: &mut Vec<u8>, pixels: &Pixels, [width, height]: [u32; 2]) {
    let (width, height) = (width as usize, height as usize);
    let rgb = |[r, g, b, _]: &[u8; 4]| [*r, *g, *b];
    let rows = pixels.chunks_exact(width);
    for row in rows.clone().chain(rows.last().filter(|_| height % 2 == 1)) {
        row.iter().for_each(|pixel| bytes.extend(rgb(pixel)));
        if let Some(last) = row.last().filter(|_| width % 2 == 1) {
            bytes.extend(rgb(last));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::tests::{SIZE, film, frame};

    #[test]
    fn odd_sides_get_their_last_pixels_twice() {
        let pixels: Pixels = (0..6).map(|level| [level, 0, 0, 255]).collect();
        let mut bytes = Vec::new();
        put_rgb(&mut bytes, &pixels, [3, 2]);
        let levels = |bytes: &[u8]| bytes.chunks(3).map(|rgb| rgb[0]).collect::<Vec<u8>>();
        assert_eq!(levels(&bytes), [0, 1, 2, 2, 3, 4, 5, 5]);
        bytes.clear();
        put_rgb(&mut bytes, &pixels, [2, 3]);
        assert_eq!(levels(&bytes), [0, 1, 2, 3, 4, 5, 4, 5]);
        assert_eq!((even([3, 2]), even([1, 1])), ([4, 2], [2, 2]));
    }

    #[test]
    fn versions_are_found() {
        assert_eq!(version("ffmpeg version 5.1.6-0+deb12u1 Copyright (c) 2000"), Some("5.1.6-0+deb12u1"));
        assert_eq!(version("Encoders:\n"), None);
    }

    #[test]
    fn mp4_is_a_film_of_all_frames() {
        if let Err(missing) = Ffmpeg::find() {
            println!("skipped: {missing}");
            return;
        }
        let bytes = film("a.mp4", 25.0).unwrap();
        assert_eq!(&bytes[4..8], b"ftyp");
        let find = |name: &[u8]| bytes.windows(4).position(|window| window == name);
        assert!(find(b"moov") < find(b"mdat"), "players start before all is loaded");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        std::fs::write(&path, &bytes).unwrap();
        let mut command = Command::new("ffmpeg");
        command.args(["-loglevel", "error", "-i"]).arg(&path).args(["-f", "rawvideo", "-pix_fmt", "rgb24", "pipe:1"]);
        let raw = command.output().unwrap().stdout;
        let [width, height] = even(SIZE).map(|side| side as usize);
        assert_eq!(raw.len(), 3 * width * height * 3);
        // Blue is blurred by 4:2:0; the mean of each frame shows the order.
        let mean = |levels: &mut dyn Iterator<Item = u8>| {
            let all: Vec<f64> = levels.map(f64::from).collect();
            all.iter().sum::<f64>() / all.len() as f64
        };
        for index in 0..3_u32 {
            let found = &raw[index as usize * width * height * 3..][..width * height * 3];
            let mut want = frame(index);
            crate::film::blend(&mut want, [1.0; 3]);
            let mut padded = Vec::new();
            put_rgb(&mut padded, &want, SIZE);
            let red = |bytes: &[u8]| mean(&mut bytes.iter().step_by(3).copied());
            assert!((red(found) - red(&padded)).abs() < 12.0, "{index}: {} {}", red(found), red(&padded));
        }
    }
}
