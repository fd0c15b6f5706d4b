//! Output of images: file names, formats, metadata.

use crate::failure::Failure;
use crate::stdin::is_stdin;
use crate::stdout;
use std::path::{Path, PathBuf};
use surfel_app::film::FilmFormat;
use surfel_io::ShowPath as _;
use surfel_io::{BitDepth, ExrOptions, IoError, JpegOptions, PngOptions};
use surfel_render::Frame;

/// Format of an image file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Png {
        sixteen: bool,
    },
    Jpeg,
    Exr {
        f32_color: bool,
    },
    Npz,
    /// Video of all frames, written by [`crate::film::Film`].
    Film,
}

impl Format {
    /// True if files of this format contain more planes than the colour.
    pub(crate) fn has_planes(self) -> bool {
        matches!(self, Self::Exr { .. } | Self::Npz)
    }

    /// True for films.
    pub(crate) fn is_film(self) -> bool {
        self == Self::Film
    }
}

/// Returns the text that replaces `{input}` in a file name: the name of the input without extension.
fn stem_of(input: &Path) -> String {
    let input = if is_stdin(input) { Path::new("stdin") } else { input };
    input.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Replaces `{input}` in a name by the name of an input.
pub(crate) fn of_input(name: &Path, input: &Path) -> PathBuf {
    match name.to_str() {
        Some(text) if text.contains("{input}") => text.replace("{input}", &stem_of(input)).into(),
        _ => name.to_path_buf(),
    }
}

/// Destination of images, as given by the option `-o`.
#[derive(Clone, Debug)]
pub(crate) struct Output {
    /// File name with its placeholders, such as `{frame}`; `None` for stdout.
    template: Option<String>,
    pub(crate) format: Format,
    force: bool,
}

impl Output {
    /// Creates an output. Checks the file name and the format.
    pub(crate) fn new(path: &Path, force: bool, png16: bool, exr_f32: bool) -> Result<Self, Failure> {
        let png = Format::Png { sixteen: png16 };
        let name = path.to_string_lossy().into_owned();
        if name == "-" {
            return Ok(Self { template: None, format: png, force });
        }
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        let format = match extension.as_deref() {
            Some("png") => png,
            Some("jpg" | "jpeg") => Format::Jpeg,
            Some("exr") => Format::Exr { f32_color: exr_f32 },
            Some("npz") => Format::Npz,
            _ if FilmFormat::of(path).is_some() => Format::Film,
            _ => {
                let what = "expected a name that ends in .png, .jpg, .exr or .npz, in .mp4, .gif or .apng for a film, \
                            or - for PNG on stdout";
                return Err(Failure::usage(format!("-o {name}: {what}")));
            }
        };
        Ok(Self { template: Some(name), format, force })
    }

    /// Creates an output like [`Output::new`], for commands that write no films.
    pub(crate) fn still(path: &Path, force: bool, png16: bool, exr_f32: bool) -> Result<Self, Failure> {
        let output = Self::new(path, force, png16, exr_f32)?;
        if output.format.is_film() {
            let what = "expected the name of an image, found that of a film, which `surfel render` writes";
            return Err(Failure::usage(format!("-o {}: {what}", path.shown())));
        }
        Ok(output)
    }

    /// Allows existing files to be replaced from now on, since this run has written them itself.
    pub(crate) fn replace(&mut self) {
        self.force = true;
    }

    /// Returns the path of the film; `None` if the output isn't a film.
    pub(crate) fn film(&self) -> Option<&Path> {
        self.template.as_deref().map(Path::new).filter(|_| self.format.is_film())
    }

    /// True if existing files are replaced.
    pub(crate) fn overwrites(&self) -> bool {
        self.force
    }

    /// True if the images go to stdout.
    pub(crate) fn is_stdout(&self) -> bool {
        self.template.is_none()
    }

    /// True if each frame gets its own file name.
    pub(crate) fn names_frames(&self) -> bool {
        self.template.as_ref().is_some_and(|t| t.contains("{frame}"))
    }

    /// True if each input gets its own file name.
    pub(crate) fn names_inputs(&self) -> bool {
        self.template.as_ref().is_some_and(|t| t.contains("{input}"))
    }

    /// True if each camera gets its own file name.
    pub(crate) fn names_cameras(&self) -> bool {
        self.template.as_ref().is_some_and(|t| t.contains("{name}"))
    }

    /// Returns the folder of the image at `path`; the current folder for stdout.
    pub(crate) fn folder(path: Option<&Path>) -> &Path {
        path.and_then(Path::parent).filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
    }

    /// Returns the file name of a frame; `None` for stdout. `camera` is the name of the frame's camera.
    pub(crate) fn path(&self, backend: &str, frame: u32, camera: &str, input: &Path) -> Option<PathBuf> {
        let stem = stem_of(input);
        let frame = format!("{frame:04}");
        // Placeholders are replaced in a single pass, so that placeholders in the name of an input aren't replaced.
        let mut rest = self.template.as_deref()?;
        let mut name = String::new();
        'next: while !rest.is_empty() {
            for (key, value) in [("{backend}", backend), ("{frame}", &frame), ("{input}", &stem), ("{name}", camera)] {
                if let Some(after) = rest.strip_prefix(key) {
                    name.push_str(value);
                    rest = after;
                    continue 'next;
                }
            }
            name.extend(rest.chars().next());
            rest = rest.get(rest.chars().next().map_or(0, char::len_utf8)..).unwrap_or_default();
        }
        Some(name.into())
    }

    /// Checks that the file at `path` can be written: that it doesn't exist or may be replaced, and that its folder
    /// exists. Does nothing for stdout (`None`). Called before the image is drawn.
    pub(crate) fn check(&self, path: Option<&Path>) -> Result<(), Failure> {
        let Some(path) = path else { return Ok(()) };
        if path.is_file() && !self.force {
            return Err(IoError::Exists { path: path.to_path_buf() }.into());
        }
        let folder = Self::folder(Some(path));
        if !folder.is_dir() {
            let message = format!("{}: there is no folder {}: create it first", path.shown(), folder.shown());
            return Err(Failure::other(message));
        }
        Ok(())
    }

    /// Writes a frame. For JPEG, the frame is blended onto the background colour, which is linear RGB.
    pub(crate) fn write(
        &self,
        path: Option<&Path>,
        frame: &Frame,
        background: [f64; 4],
        metadata: Vec<(String, String)>,
    ) -> Result<(), Failure> {
        let planes = frame.planes();
        let png = |sixteen: bool, metadata| {
            let depth = if sixteen { BitDepth::Sixteen } else { BitDepth::Eight };
            PngOptions { depth, metadata }
        };
        match (path, self.format) {
            (Some(path), Format::Png { sixteen }) => {
                surfel_io::save_png(path, self.force, &planes, &png(sixteen, metadata))?;
            }
            (Some(path), Format::Exr { f32_color }) => {
                surfel_io::save_exr(path, self.force, &planes, &ExrOptions { f32_color, metadata })?;
            }
            (Some(path), Format::Film) => {
                let what = "is written frame by frame";
                return Err(Failure::other(format!("{}: {what}", path.shown())));
            }
            (Some(path), Format::Npz) => surfel_io::save_npz(path, self.force, &planes)?,
            (Some(path), Format::Jpeg) => {
                let [r, g, b, _] = background.map(|c| c as f32);
                let options = JpegOptions { background: [r, g, b], ..JpegOptions::default() };
                surfel_io::save_jpeg(path, self.force, &planes, &options)?;
            }
            (None, format) => {
                let sixteen = matches!(format, Format::Png { sixteen: true });
                let mut bytes = Vec::new();
                let written = surfel_io::write_png(&mut bytes, &planes, &png(sixteen, metadata));
                written.map_err(|e| Failure::other(format!("can't encode the image: {e}")))?;
                stdout::result(&bytes)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn templates_are_filled_once() {
        let output = Output::new(Path::new("o_{input}_{backend}_{frame}_{name}_{x}.png"), false, false, false).unwrap();
        let path = output.path("cpu", 7, "a{frame}", Path::new("dir/{frame}.ply")).unwrap();
        assert_eq!(path, Path::new("o_{frame}_cpu_0007_a{frame}_{x}.png"));
    }

    #[test]
    fn other_formats_are_a_usage_error() {
        for name in ["a.bmp", "a", "png", ".png/"] {
            assert!(Output::new(Path::new(name), false, false, false).is_err(), "{name}");
        }
        assert!(Output::new(Path::new("a.gif"), false, false, false).unwrap().format.is_film());
        assert!(Output::still(Path::new("a.gif"), false, false, false).is_err());
    }
}
