//! Figures for papers: panels of several files under one camera, one light and one colour range, with words and marks.
//!
//! A [`FigureRequest`] loads the files and draws the panels; `surfel-figure` lays them out. The result is a
//! [`FigureImage`], which is saved as PDF, SVG or PNG.
//!
//! ```no_run
//! # fn main() -> Result<(), surfel_load::Error> {
//! use surfel_app::figure::{FigureOptions, FigureRequest};
//! let files = ["truth.ply".into(), "ours.ply".into()];
//! let (render, mut figure) = (surfel_app::request::RenderOptions::default(), FigureOptions::default());
//! figure.title = Some("Completion".to_owned());
//! let request = FigureRequest { inputs: &files, render: &render, figure: &figure, stdin: None };
//! let mut backend = surfel_backend::Backend::auto()?;
//! let image = request.draw(&mut backend, &surfel_sample::NoProgress, &mut |note| eprintln!("{note}"))?;
//! image.save("figure.pdf".as_ref(), false)?;
//! # Ok(())
//! # }
//! ```

mod errors;
mod marks;
mod panels;
mod values;

pub use crate::figure_options::{FigureOptions, Length, MARKS, MarkKind, length, mark, text_at};
pub use surfel_figure::{Drawing, Picture};

use crate::color_bar;
use crate::request::{Pictures, RenderOptions, Request, Resolved, Source, shared_coloring};
use errors::PanelErrors;
use panels::Panels;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_backend::Backend;
use surfel_figure::Key;
use surfel_io::{IoError, ShowPath as _};
use surfel_load::Error;
use surfel_load::coloring::{ColorMap, ColorScale, Coloring, confusions};
use surfel_model::Camera;
use surfel_sample::Progress;

/// Default resolution of figures, in pixels per inch, by which lengths on paper are converted to pixels.
const DPI: f64 = 300.0;
/// Default width and height of a panel, in pixels.
const PANEL: [u32; 2] = [720, 720];

/// Names of the attributes that are coordinates along an axis. Their values have the unit of the coordinates.
const HEIGHTS: [&str; 4] = ["height", "x", "y", "z"];

/// A figure that has been drawn and laid out.
#[derive(Clone, Debug)]
pub struct FigureImage {
    /// Images, lines and words at fixed positions.
    pub drawing: Drawing,
    /// Resolution of the figure in pixels per inch.
    pub dpi: f64,
}

/// File format of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FigureFormat {
    /// PNG: an image of pixels.
    Png,
    /// SVG: images are embedded, and words are text.
    Svg,
    /// PDF: images are embedded, and words are text.
    Pdf,
}

impl FigureFormat {
    /// Returns the format for the extension of a file's name; PNG for `-`, which is stdout.
    ///
    /// # Errors
    /// [`Error::Usage`] for other extensions.
    pub fn of(path: &Path) -> Result<Self, Error> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match extension.as_deref() {
            Some("png") => Ok(Self::Png),
            Some("svg") => Ok(Self::Svg),
            Some("pdf") => Ok(Self::Pdf),
            None if surfel_load::paths::is_stdin(path) => Ok(Self::Png),
            _ => Err(Error::Usage(format!(
                "-o {}: expected a name that ends in .pdf, .svg or .png, or - for PNG on stdout",
                path.shown()
            ))),
        }
    }
}

impl FigureImage {
    /// Encodes the figure in a file format.
    pub fn bytes(&self, format: FigureFormat) -> Vec<u8> {
        match format {
            FigureFormat::Png => self.drawing.png(Some(self.dpi)),
            FigureFormat::Svg => self.drawing.svg_at(Some(self.dpi)).into_bytes(),
            FigureFormat::Pdf => self.drawing.pdf(self.dpi),
        }
    }

    /// Writes the figure in the format for the extension of the file's name.
    ///
    /// # Errors
    /// [`Error::Usage`] for other extensions. [`Error::Io`] if the file can't be written, or if it exists and
    /// `overwrite` is false.
    pub fn save(&self, path: &Path, overwrite: bool) -> Result<(), Error> {
        let bytes = self.bytes(FigureFormat::of(path)?);
        Ok(surfel_io::atomic::write(path, overwrite, |out| out.write_all(&bytes))?)
    }
}

/// Request for a figure, made from files and options.
pub struct FigureRequest<'a> {
    /// A scene file, or files that get one panel each.
    pub inputs: &'a [PathBuf],
    /// Options for drawing the panels. The size is that of one panel.
    pub render: &'a RenderOptions,
    /// Options for the arrangement of panels, their titles and marks.
    pub figure: &'a FigureOptions,
    /// Content of the input named `-`.
    pub stdin: Option<Arc<[u8]>>,
}

/// Group of files that show the same subject. Their panels have one camera and one light.
struct Subject<'a> {
    paths: &'a [PathBuf],
    resolved: Resolved,
    /// True if the first file contains points, to which distances are then measured instead of to a surface.
    is_of_points: bool,
    /// True if each object has its own panel; false if one panel shows the whole scene.
    is_split: bool,
    /// True if the camera was framed automatically, so that it may move back to include frusta.
    is_framed: bool,
    /// Distances to the first file, for each panel but the first; empty if the figure has no row of errors
    /// ([`FigureOptions::error_row`]).
    errors: Vec<PanelErrors>,
}

impl Subject<'_> {
    fn panels(&self) -> usize {
        if self.is_split { self.resolved.scene.objects.len() } else { 1 }
    }
}

/// Colour scale of the error row: the additional row of panels that shows distances to the first file.
struct ErrorColors {
    map: ColorMap,
    end: f64,
    /// True if some distances are larger than `end`, so that the colour bar is marked as open.
    is_exceeded: bool,
}

impl FigureRequest<'_> {
    /// Checks that the options are consistent with each other and with the number of inputs, before files are loaded.
    ///
    /// # Errors
    /// [`Error::Usage`] if they aren't.
    pub fn check(&self) -> Result<(), Error> {
        let (count, subjects) = (self.inputs.len(), self.subjects());
        let usage = |text: String| Err(Error::Usage(text));
        if subjects == 0 || !count.is_multiple_of(subjects) {
            return usage(format!("--subjects {subjects}: expected a multiple of {subjects} inputs, found {count}"));
        }
        let columns = count / subjects;
        if self.figure.error_row.is_some() && columns < 2 {
            return usage(format!(
                "--error-row compares each subject's files with its first: expected at least two files for each, \
                 found {columns}"
            ));
        }
        let titles = self.figure.titles.len();
        if titles != 0 && titles != count && titles != columns {
            let expected = if subjects > 1 { format!("{columns} or {count}") } else { count.to_string() };
            return usage(format!("--titles has {titles} titles, expected {expected}"));
        }
        let (given, rows) = (self.figure.row_titles.len(), columns.div_ceil(self.columns()) * subjects);
        if given != 0 && given != rows {
            return usage(format!("--row-titles has {given} titles, expected {rows}"));
        }
        if self.render.region.is_some() || self.render.tile.is_some() {
            return usage("--region and --tile are for `surfel render`".to_owned());
        }
        Ok(())
    }

    fn subjects(&self) -> usize {
        self.figure.subjects.unwrap_or(1) as usize
    }

    /// Returns the largest number of panels in a row, without a panel of errors beside them.
    fn columns(&self) -> usize {
        let all = self.inputs.len() / self.subjects().max(1);
        self.figure.wrap.map_or(all, |most| all.min(most as usize)).max(1)
    }

    /// True if the distances between two files are shown beside them rather than in a row below.
    fn has_errors_beside(&self) -> bool {
        self.figure.error_row.is_some() && self.inputs.len() == 2 && self.columns() == 2
    }

    /// Returns the resolution in pixels per inch.
    fn dpi(&self) -> f64 {
        self.figure.dpi.unwrap_or(DPI)
    }

    /// Loads the files and draws the figure. Passes notes for the user to `note`, as sentences without a full stop.
    ///
    /// # Errors
    /// [`Error::Usage`] for options that contradict each other; otherwise as [`Request::load`], [`Request::resolve`]
    /// and [`surfel_render::Renderer::render_into`].
    pub fn draw(
        &self,
        backend: &mut Backend,
        progress: &dyn Progress,
        note: &mut dyn FnMut(String),
    ) -> Result<FigureImage, Error> {
        self.check()?;
        let mut subjects = self.load(progress, note)?;
        let error_colors = self.measure(&mut subjects, progress)?;
        let coloring = coloring_of(&subjects);
        if let Some(ColorScale::Categories(all)) = coloring.as_ref().map(|coloring| &coloring.scale) {
            confusions(all).into_iter().for_each(&mut *note);
        }
        let frusta = marks::frusta(self.figure)?;
        let keys = if self.figure.no_legend { Vec::new() } else { self.keys(coloring.as_ref(), error_colors.as_ref()) };
        let mut panels = Panels::new(self, &subjects, keys)?;
        for at in 0..panels.cells.len() {
            panels.draw(at, &subjects, (error_colors.as_ref(), coloring.is_some()), &frusta, backend)?;
        }
        panels.crop(subjects.len());
        let is_perspective = subjects.iter().any(|subject| is_perspective(&subject.resolved.file.camera));
        if self.figure.marks.contains(&MarkKind::Scale) && is_perspective {
            note(
                "the scale bar is true at the distance of the camera's target (--ortho makes it true everywhere)"
                    .into(),
            );
        }
        let drawing = panels.figure.layout();
        let missing = drawing.missing();
        if !missing.is_empty() {
            let missing: String = missing.into_iter().collect();
            note(format!("the figure's font lacks the characters {}, which appear as boxes", missing.escape_debug()));
        }
        Ok(FigureImage { drawing, dpi: self.dpi() })
    }

    /// Loads the files of each subject, and chooses a camera and light for each.
    fn load(&self, progress: &dyn Progress, note: &mut dyn FnMut(String)) -> Result<Vec<Subject<'_>>, Error> {
        let mut options = self.render.clone();
        options.apply_style();
        options.size = Some(panels::first_size(self, options.size));
        let of_subject = self.inputs.len() / self.subjects();
        let source = |paths: &[PathBuf]| Source::of(paths, self.stdin.as_deref());
        let is_scene = matches!(source(self.inputs.get(..of_subject).unwrap_or_default())?, Source::Scene(_));
        if !is_scene {
            options.background.get_or_insert([1.0; 4]);
        }
        if self.subjects() > 1 && options.splats.convert.color_by.is_some() {
            let sources = self.inputs.chunks(of_subject).map(source);
            let found = shared_coloring(sources, &options, self.stdin.clone(), progress)?;
            found.into_iter().for_each(|coloring| options.splats.set_coloring(coloring));
        }
        let mut subjects = Vec::new();
        for paths in self.inputs.chunks(of_subject) {
            let request = Request::new(source(paths)?, &Pictures::One, &options)?.with_stdin(self.stdin.clone());
            let mut loaded = request.load(progress)?;
            loaded.has_one_radius = true;
            let is_of_points = loaded.facts.first().is_some_and(|facts| facts.points);
            let resolved = request.resolve(loaded, progress, note)?;
            let is_split = !is_scene;
            let is_framed = !resolved.has_own_camera && options.eye.is_none() && options.target.is_none();
            subjects.push(Subject { paths, resolved, is_of_points, is_split, is_framed, errors: Vec::new() });
        }
        Ok(subjects)
    }

    /// Measures the distances for the error row, stores them in the subjects, and returns the colour scale of all
    /// distances. `None` without an error row.
    fn measure(&self, subjects: &mut [Subject<'_>], progress: &dyn Progress) -> Result<Option<ErrorColors>, Error> {
        let Some(map) = self.figure.error_row else { return Ok(None) };
        for subject in subjects.iter_mut() {
            let objects = &subject.resolved.scene.objects;
            subject.errors = errors::measure(objects, subject.paths, subject.is_of_points, progress)?;
        }
        let all = || subjects.iter().flat_map(|subject| &subject.errors).map(|errors| &errors.distances);
        let end = self.figure.error_max.unwrap_or_else(|| errors::end_of_range(all()));
        let is_exceeded = all().flatten().any(|distance| *distance > end);
        Ok(Some(ErrorColors { map: map.into(), end, is_exceeded }))
    }

    /// Returns the title of the colour bar or legend of a colouring. For a colour bar of heights, the unit of the
    /// coordinates is appended, unless the title contains a bracket `[`.
    fn value_title(&self, coloring: &Coloring) -> String {
        let title = self.figure.value_title.as_deref().unwrap_or(&coloring.attribute);
        let is_length = HEIGHTS.iter().any(|name| coloring.attribute.eq_ignore_ascii_case(name));
        let is_of_values = matches!(coloring.scale, ColorScale::Range { .. });
        if is_length && is_of_values && !title.contains('[') { self.with_unit(title) } else { title.to_owned() }
    }

    /// Returns the title of a colour bar of lengths, followed by the unit in brackets if it is given.
    fn with_unit(&self, title: &str) -> String {
        match &self.figure.unit {
            Some(unit) => format!("{title} [{unit}]"),
            None => title.to_owned(),
        }
    }

    /// Returns the colour bars and legends of the figure: that of `coloring`, which colours the files, and that of the
    /// distances in the error row.
    fn keys(&self, coloring: Option<&Coloring>, errors: Option<&ErrorColors>) -> Vec<Key> {
        let is_one_row = self.subjects() == 1 && self.columns() == self.inputs.len();
        let has_two_rows = is_one_row && errors.is_some() && !self.has_errors_beside();
        let of_values = coloring.and_then(|coloring| color_bar::key(coloring, Some(&self.value_title(coloring))));
        let of_errors = errors.map(|colors| {
            Key::bar(&self.with_unit("distance"), colors.map.levels(), [0.0, colors.end]).exceeded(colors.is_exceeded)
        });
        // If the figure has one row of values and one of errors, each key is placed beside its row.
        let rows = |row: usize| if has_two_rows { row..row + 1 } else { 0..0 };
        let of_values = of_values.map(|key| key.beside(rows(0)));
        of_values.into_iter().chain(of_errors.map(|key| key.beside(rows(1)))).collect()
    }
}

/// Returns the first colouring of a subject that shows values, from which the figure's colour bar is made; `None` if
/// there is none.
fn coloring_of(subjects: &[Subject<'_>]) -> Option<Coloring> {
    let mut all = subjects.iter().flat_map(|subject| subject.resolved.colorings.iter());
    all.find(|(_, coloring)| coloring.scale != ColorScale::Direct).map(|(_, coloring)| coloring.clone())
}

fn is_perspective(camera: &Camera) -> bool {
    !matches!(camera.projection, surfel_model::Projection::Orthographic { .. })
}

/// Checks the path of a figure's file, before the figure is drawn. Returns the file format.
///
/// # Errors
/// [`Error::Usage`] for an unsupported extension, [`Error::Io`] if the file exists and `overwrite` is false.
pub fn check_output(path: &Path, overwrite: bool) -> Result<FigureFormat, Error> {
    let format = FigureFormat::of(path)?;
    if path.is_file() && !overwrite {
        return Err(IoError::Exists { path: path.to_path_buf() }.into());
    }
    Ok(format)
}
