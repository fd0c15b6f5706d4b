//! Series of images: the cameras of a turntable, of a camera path or of another program, or a sequence of files.

use crate::failure::Failure;
use crate::output::Output;
use std::path::Path;
use surfel_app::camera;
use surfel_app::film::{self, CameraPath, FrameRate};
use surfel_app::options::Options;
use surfel_app::request::Pictures;
use surfel_io::ShowPath as _;

/// Largest length, in bytes, of a camera's name that becomes part of a file name. File systems allow 255, including the
/// extension.
const MAX_NAME_BYTES: usize = 200;

/// Images of a scene that differ in their cameras, or images of a sequence of files.
#[derive(Debug)]
pub(crate) struct Series {
    /// Cameras of the images, as a request describes them.
    pub(crate) pictures: Pictures,
    /// Names of the cameras for file names, one per image; empty if they have none.
    names: Vec<String>,
    /// Number of images.
    count: u32,
}

impl Series {
    /// Creates the series that the options request. Reads the files of cameras.
    pub(crate) fn of(args: &Options, output: Option<&Output>) -> Result<Self, Failure> {
        if let Some(path) = &args.cameras {
            return Self::of_cameras(path, args, output);
        }
        // No command line has more than a million inputs.
        let files = args.sequence.then_some(args.inputs.len() as u32);
        let rate = args.fps.unwrap_or_default();
        let (pictures, count) = match (&args.path, args.render.turntable) {
            (Some(path), _) => {
                let path = CameraPath::read(path, &args.render)?;
                let count = files.or(args.frames).unwrap_or_else(|| path.frames(rate));
                (Pictures::Path(path.cameras(count)?), count)
            }
            (None, true) => {
                let count = files.or(args.frames).unwrap_or_else(|| film::turn_frames(rate));
                (Pictures::Turn(count), count)
            }
            (None, false) => (Pictures::One, files.unwrap_or(1)),
        };
        Ok(Self { pictures, names: Vec::new(), count })
    }

    fn of_cameras(path: &Path, args: &Options, output: Option<&Output>) -> Result<Self, Failure> {
        let (names, cameras): (Vec<_>, Vec<_>) = camera::named(path, args.render.size)?.into_iter().unzip();
        let is_film = output.is_some_and(|output| output.format.is_film());
        if cameras.len() > 1 && output.is_some_and(|o| !o.names_cameras()) && !is_film {
            return Err(Failure::usage(format!(
                "--cameras has {} cameras, expected {{name}} in the name, as in -o out/{{name}}.png",
                cameras.len()
            )));
        }
        if output.is_some_and(Output::names_cameras) {
            names.iter().try_for_each(|name| check_camera_name(name, path))?;
        }
        // No set of cameras has more than 10 million.
        let count = cameras.len() as u32;
        Ok(Self { pictures: Pictures::Cameras(cameras), names, count })
    }

    /// Returns the number of images.
    pub(crate) fn count(&self) -> u32 {
        self.count
    }

    /// Returns the name of an image's camera; empty if it has none.
    pub(crate) fn name(&self, index: u32) -> &str {
        self.names.get(index as usize).map_or("", String::as_str)
    }
}

/// Refuses a camera whose name can't be part of a file name. `path` is the file of the cameras.
fn check_camera_name(name: &str, path: &Path) -> Result<(), Failure> {
    let what = if name.len() > MAX_NAME_BYTES {
        format!("of {} bytes, expected at most {MAX_NAME_BYTES}", name.len())
    } else if name.contains('\0') {
        "with a zero byte".to_owned()
    } else {
        return Ok(());
    };
    let start: String = name.chars().take(40).collect();
    Err(Failure::input(format!(
        "{}: has a camera name {what}, which no image can be called by: {start}…\n  help: rename the camera, or call \
         the images by {{frame}}",
        path.shown()
    )))
}

/// Refuses combinations of flags for several images that contradict each other.
pub(crate) fn check(args: &Options, output: Option<&Output>) -> Result<(), Failure> {
    let is_film = output.is_some_and(|output| output.format.is_film());
    let moves = args.render.turntable || args.path.is_some();
    if args.frames.is_some() && !moves {
        return Err(Failure::usage("--frames is for --turntable and --path: give one of them, too"));
    }
    if args.fps.is_some() && !is_film && !moves {
        return Err(Failure::usage("--fps is for films: give -o a name that ends in .mp4, .gif or .apng"));
    }
    let several = if args.sequence { args.inputs.len() > 1 } else { moves && args.frames != Some(1) };
    if several && !is_film && output.is_some_and(|o| !(o.names_frames() || args.sequence && o.names_inputs())) {
        let flag = match (args.sequence, &args.path, args.frames) {
            (true, _, _) => "--sequence",
            (false, _, Some(_)) => "--frames",
            (false, Some(_), None) => "--path",
            (false, None, None) => "--turntable",
        };
        return Err(Failure::usage(format!(
            "{flag} writes several files, expected {{frame}} in the name, as in -o f_{{frame}}.png, or a film's name, \
             as in -o film.mp4"
        )));
    }
    if !is_film {
        return Ok(());
    }
    let refused = [
        (
            !moves && !args.sequence && args.cameras.is_none(),
            "a film has several frames: give --turntable, --path KEYS.json or --sequence",
        ),
        (
            output.is_some_and(|o| o.names_frames() || o.names_cameras()),
            "all frames are in one film: leave {frame} and {name} out of its name",
        ),
        (
            args.sequence && output.is_some_and(Output::names_inputs),
            "all files of a sequence are in one film: leave {input} out of its name",
        ),
        (args.render.tile.is_some(), "--tile is for images, but -o names a film"),
        (args.progressive, "--progressive is of one picture, but -o names a film"),
        (args.png16, "--png16 is for PNG, but -o names a film"),
        (args.exr_f32, "--exr-f32 is for EXR, but -o names a film"),
        (args.shard.is_some(), "--shard is for images: draw -o f_{frame}.png by shards, and join them by ffmpeg"),
    ];
    match refused.into_iter().find_map(|(is_wrong, what)| is_wrong.then_some(what)) {
        Some(what) => Err(Failure::usage(what)),
        None => Ok(()),
    }
}

/// Returns the frame rate, in frames per second.
pub(crate) fn rate(args: &Options) -> FrameRate {
    args.fps.unwrap_or_default()
}
