//! Options table: every option of the program in one place.
//!
//! A [`Row`] defines one option: its name, parser, default, purpose, commands, kinds of files, scene-file key and
//! Python type. These parts of the program are derived from the [`Table`]:
//!
//! - the command line, its help and completions;
//! - [`RenderOptions::set`];
//! - Python's keywords and stubs;
//! - the check for options without effect, and suggestions for misspelt options;
//! - the page `docs/options.md`.
//!
//! To add an option, add a row here and a field to [`Options`] or to one of its parts.
//!
//! Values flow in one direction: [`Row::set`] parses text into [`Options`], and [`crate::request::Request`] is built
//! from them.
//!
//! ```
//! use surfel_app::options::{Commands, Options, table};
//! let mut options = Options::default();
//! table().set(&mut options, Commands::RENDER, "cutoff", "3")?;
//! assert_eq!(options.render.cutoff, Some(3.0));
//! assert!(table().set(&mut options, Commands::ORTHO, "cutoff", "3").is_err());
//! # Ok::<(), String>(())
//! ```

mod near;
mod page;
mod row;
mod rows;
mod set;
mod stub;

pub use near::Near;
pub use row::{Audience, Commands, EXPERT, Group, Row, Setter};

use crate::figure_options::FigureOptions;
use crate::film::FrameRate;
use crate::render_options::RenderOptions;
use crate::values::{FrameRange, Part};
use std::path::PathBuf;
use std::sync::LazyLock;

/// Values of the options of a command. An option that isn't given is `None`, false or empty.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Options {
    /// Paths of the input files; `-` stands for stdin.
    pub inputs: Vec<PathBuf>,
    /// True if the output's name is derived from the input's, when no output is given (`surfel INPUT`).
    pub names_output: bool,
    /// Options for an image and for converting files to splats.
    pub render: RenderOptions,
    /// Path of the file to write; `None` if none is given, for which each command has its own default.
    pub output: Option<PathBuf>,
    /// True if existing files are overwritten.
    pub force: bool,
    /// True if the colour bar is written to a file whose name is derived from the output's.
    pub names_colorbar: bool,
    /// True if the scene file with all choices filled in is printed on stdout.
    pub print_scene: bool,
    /// True if colours of EXR files are 32-bit floats.
    pub exr_f32: bool,
    /// True if PNG files have 16 bits per sample.
    pub png16: bool,
    /// True if images get no metadata.
    pub no_metadata: bool,
    /// True if coarse images of some of the points are written first, and then replaced by finer ones up to the full
    /// image.
    pub progressive: bool,
    /// True if timings and counts of the rendering are printed as JSON.
    pub stats: bool,
    /// Number of timed renders of each image, after one for warming up; `None` renders once, without warming up.
    pub repeat: Option<u32>,
    /// True if results are printed as JSON instead of text.
    pub json: bool,
    /// True if `surfel convert` writes an octree.
    pub hybrid: bool,
    /// True if PLY files are written as text.
    pub ascii: bool,
    /// File or folder with the cameras of another program, from each of which an image is drawn.
    pub cameras: Option<PathBuf>,
    /// Number of frames of a turntable or of a camera path. `None` derives the number from the film's duration.
    pub frames: Option<u32>,
    /// JSON file with the keys of a path along which the camera of a film moves.
    pub path: Option<PathBuf>,
    /// True if each input is a frame of one film, instead of an object of one scene.
    pub sequence: bool,
    /// Frame rate of films, in frames per second; `None` means 25.
    pub fps: Option<FrameRate>,
    /// Range of the frames or cameras that are drawn; `None` draws all.
    pub frame_range: Option<FrameRange>,
    /// Shard of the job: the part of all images, or of all points, that this process works on. `None` means the whole
    /// job.
    pub shard: Option<Part>,
    /// True if images whose files exist aren't drawn again.
    pub skip_existing: bool,
    /// True if a conversion to COPC saves its progress in a folder, and continues an interrupted run.
    pub resume: bool,
    /// Name of the backend; `None`: selected automatically.
    pub backend: Option<String>,
    /// Substring of the name of the GPU adapter to use; `None` leaves the choice to the backend.
    pub adapter: Option<String>,
    /// True if backends store splats as 16-bit numbers.
    pub quantised: bool,
    /// Number of threads; `None`: one per CPU.
    pub threads: Option<usize>,
    /// True if only errors are printed.
    pub quiet: bool,
    /// True if additional information is printed.
    pub verbose: bool,
    /// True if `surfel view` opens no browser.
    pub no_open: bool,
    /// TCP port on which `surfel view` serves its page; `None` uses a free port.
    pub port: Option<u16>,
    /// Address of this machine at which `surfel view` serves its page; `None` for 127.0.0.1.
    pub host: Option<String>,
    /// HTML file, or folder for a web server, to which `surfel view` writes the page instead of serving it.
    pub export: Option<PathBuf>,
    /// TOML file from which options are read that the command line doesn't state.
    pub config: Option<PathBuf>,
    /// Ground sampling distance: side of an orthoimage's pixel, in the units of x and y.
    pub gsd: Option<f64>,
    /// Output GeoTIFF of heights (digital surface model).
    pub dsm: Option<PathBuf>,
    /// Output GeoTIFF of normals.
    pub normals: Option<PathBuf>,
    /// Bounds of an orthoimage in the units of x and y: minimum x, minimum y, maximum x, maximum y. `None` uses the
    /// bounds of the data.
    pub bounds: Option<[f64; 4]>,
    /// Point (x, y) with which a corner of the pixel grid of an orthoimage coincides; `None` means (0, 0).
    pub origin: Option<[f64; 2]>,
    /// Largest radius of a circle that fits into a gap that is filled, in the units of x and y. Larger gaps remain.
    /// `None` fills no gaps.
    pub fill: Option<f64>,
    /// EPSG code of an orthoimage's coordinate reference system; `None` uses the system that the files state.
    pub crs: Option<u16>,
    /// Options of `surfel figure` for the arrangement of panels, their titles and marks.
    pub figure: FigureOptions,
}

impl Options {
    /// Returns the name of the backend, or `auto`.
    pub fn backend_name(&self) -> &str {
        self.backend.as_deref().unwrap_or("auto")
    }
}

/// Table of the options of all commands, in the order in which help lists them.
#[derive(Clone, Debug)]
pub struct Table {
    rows: Vec<Row>,
}

/// Returns the table of all options.
pub fn table() -> &'static Table {
    static TABLE: LazyLock<Table> = LazyLock::new(|| {
        let mut rows = rows::all();
        // Experts' options come last, and otherwise a task's options are listed together.
        rows.sort_by_key(|row| (row.audience == Audience::Expert, row.group));
        Table { rows }
    });
    &TABLE
}

impl Table {
    /// Appends a row to the table.
    #[must_use]
    pub fn with(mut self, row: Row) -> Self {
        self.rows.push(row);
        self
    }

    /// Returns all rows, in the order in which help lists the options.
    pub fn rows(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter()
    }

    /// Returns the rows of the options that at least one of `commands` has, in the order in which help lists the
    /// options.
    pub fn of(&self, commands: Commands) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(move |row| row.commands.has(commands))
    }

    /// Returns the row of a command's option with this long name; `None` if the command has no such option.
    pub fn find(&self, commands: Commands, name: &str) -> Option<&Row> {
        self.of(commands).find(|row| row.name == name)
    }

    /// Returns the rows that are keywords of at least one of the given Python functions.
    pub fn keywords(&self, functions: Commands) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(move |row| row.keyword.has(functions))
    }

    /// Sets an option of a command by its long name, from its text. A switch is set by `on` or `off`.
    ///
    /// # Errors
    /// A description of the expected value, or a message that the command has no such option.
    pub fn set(&self, options: &mut Options, command: Commands, name: &str, text: &str) -> Result<(), String> {
        let row = self.find(command, name).ok_or_else(|| "there is no such flag here".to_owned())?;
        row.set(options, text.as_ref())
    }
}
