//! Request for an orthoimage, as made by the command `surfel ortho`.

use crate::render_options::SplatOptions;
use crate::splats;
use serde_json::{Value, json};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_io::IoError;
use surfel_io::ShowPath as _;
use surfel_io::atomic::target;
use surfel_load::paths::{display, is_stdin};
use surfel_load::words::counted;
use surfel_load::{Error, LoadOptions};
use surfel_model::{ConvertOptions, ModelError, Outliers};
use surfel_ortho::{Ortho, OrthoFiles, OrthoOptions, OrthoStats};
use surfel_sample::Progress;

/// Request for an orthoimage, made from files and options.
#[derive(Clone, Debug)]
pub struct OrthoRequest<'a> {
    /// Paths of the input files; `-` stands for the content of `stdin`.
    pub inputs: &'a [PathBuf],
    /// Grid and content of the image. Its loading options are ignored, because they are derived from `splats`.
    pub options: OrthoOptions,
    /// Options for converting files to splats.
    pub splats: &'a SplatOptions,
    /// Paths of the images to write.
    pub files: &'a OrthoFiles,
    /// Content of the input named `-`.
    pub stdin: Option<Arc<[u8]>>,
}

impl OrthoRequest<'_> {
    /// Loads the files. Passes notes for the user to `note`, as sentences without a full stop.
    ///
    /// # Errors
    /// [`Error::Usage`] for a grid that is out of range, file names that aren't TIFF or are equal, and options that
    /// contradict each other or have no effect; [`Error::Io`] for files that exist already; and as [`Ortho::open`].
    pub fn open(&self, progress: &dyn Progress, note: &mut dyn FnMut(String)) -> Result<Ortho, Error> {
        self.check_files()?;
        if self.options.bounds.is_some() && self.options.size.is_some() {
            return Err(Error::Usage("--size cannot be used with --bounds: both say what to draw".to_owned()));
        }
        self.splats.check()?;
        let mut convert = ConvertOptions::default();
        splats::apply(self.splats, &mut convert)?;
        let load = LoadOptions::default()
            .with_convert(&convert, Path::new(""))
            .with_stdin(self.stdin.clone())
            .with_memory(self.splats.memory)
            .with_surface(true)
            .with_interior_weight(true);
        let keeps_lone = self.splats.convert.outliers == Some(Outliers::Keep);
        let options = self.options.clone().with_load(load).with_lone(self.options.lone || keeps_lone);
        let inputs: Vec<&Path> = self.inputs.iter().map(PathBuf::as_path).collect();
        let ortho = Ortho::open(&inputs, &options, progress).map_err(|error| match error {
            // An invalid grid was caused by a flag, so that the error names the flag.
            Error::Model(e @ ModelError::OutOfRange { .. }) => Error::Usage(format!("--{e}")),
            other => other,
        })?;
        for (path, text) in &ortho.notes {
            match path {
                Some(path) => note(format!("{}: {text}", display(path))),
                None => note(text.clone()),
            }
        }
        splats::check_used(self.splats, &ortho.unused, note)?;
        splats::write_color_bar(self.splats, ortho.coloring.iter().map(|(path, c)| (path.as_path(), c)), note)?;
        Ok(ortho)
    }

    /// Checks that there is an image to write, and that images have TIFF names and don't exist yet, unless they may be
    /// overwritten. No output may be an input or have the name of another output.
    fn check_files(&self) -> Result<(), Error> {
        let OrthoFiles { color, dsm, normals, overwrite } = self.files;
        let images = [("-o", color), ("--dsm", dsm), ("--normals", normals)];
        if images.iter().all(|(_, file)| file.is_none()) {
            let what = "nothing says what to write, expected -o RGB.tif, --dsm F.tif or --normals F.tif";
            return Err(Error::Usage(what.to_owned()));
        }
        let is_input = |path: &&PathBuf| !is_stdin(path);
        let inputs: HashSet<PathBuf> = self.inputs.iter().filter(is_input).map(|path| target(path)).collect();
        let mut known = HashMap::new();
        for (flag, file) in images.into_iter().chain([("--colorbar", &self.splats.colorbar)]) {
            let Some(file) = file else { continue };
            let extension = file.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
            let wrong = |what: &str| Err(Error::Usage(format!("{flag} {}: {what}", file.shown())));
            let is_image = flag != "--colorbar";
            if is_image && !matches!(extension.as_deref(), Some("tif" | "tiff")) {
                return wrong("expected a name that ends in .tif");
            }
            if let Some(other) = known.insert(target(file), flag) {
                return wrong(&format!("is the name of {other}'s file, too"));
            }
            if inputs.contains(&target(file)) {
                return wrong("is an input, too");
            }
            if is_image && file.exists() && !overwrite {
                return Err(IoError::Exists { path: file.clone() }.into());
            }
        }
        Ok(())
    }
}

/// Returns the JSON object that `surfel ortho --stats` prints. `backend` is the name of the backend that drew the
/// image.
pub fn stats_json(ortho: &Ortho, stats: &OrthoStats, backend: &str) -> Value {
    let ms = |time: std::time::Duration| time.as_secs_f64() * 1e3;
    json!({
        "size": ortho.size(), "bounds": ortho.rounded_bounds(), "gsd": ortho.gsd(), "pixels": stats.pixels,
        "covered": stats.covered, "filled": stats.filled, "lone": stats.lone, "splats": stats.splats,
        "prepare_ms": ms(stats.preparing), "draw_ms": ms(stats.drawing), "write_ms": ms(stats.writing),
        "backend": backend,
    })
}

/// Returns notes about an image that was drawn, as sentences without a full stop.
pub fn notes_of(stats: &OrthoStats) -> Vec<String> {
    let mut notes = Vec::new();
    if stats.lone > 0 {
        let points = counted(stats.lone, "points");
        notes.push(format!(
            "left out {points} of the image that stand alone in height, as birds and reflections do (--outliers keep \
             keeps them)"
        ));
    }
    notes
}
