//! Orthoimages: images of points and splats straight from above, north up, on an exact grid, with heights and normals.
//!
//! [`Ortho::open`] loads the files and determines the grid; [`Ortho::draw`] writes GeoTIFF images. The image is drawn
//! block by block. The splats of a block are made from the points in and around it, so that memory doesn't grow with
//! the image. Images of the same files with other bounds have the same pixels.
//!
//! Main types, in reading order:
//!
//! 1. [`OrthoOptions`]: ground sampling distance, bounds and content of an image;
//! 2. [`Ortho`]: opened files, and the grid of their image;
//! 3. [`OrthoFiles`]: the images to write: colours, heights and normals;
//! 4. [`OrthoStats`]: statistics of an image, and the time of each step.
//!
//! ```no_run
//! use surfel_backend::Backend;
//! use surfel_ortho::{Ortho, OrthoFiles, OrthoOptions};
//! use surfel_sample::NoProgress;
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut ortho = Ortho::open(&["tile.laz".as_ref()], &OrthoOptions::new(0.5), &NoProgress)?;
//! let files = OrthoFiles { dsm: Some("heights.tif".into()), ..OrthoFiles::default() };
//! ortho.draw(&files, "example", &mut Backend::auto()?, &NoProgress)?;
//! # Ok(())
//! # }
//! ```
//!
//! # Layer
//! The crate is above `surfel-load`, which reads the points, and `surfel-backend`, which draws. `surfel-io` writes
//! GeoTIFF.
//!
//! # Features
//! `cpu`, on by default, enables the CPU backend. Any other backend of `surfel-backend` suffices as well.

mod block;
mod canonical;
mod edge;
mod extent;
mod fill;
mod grid;
mod layout;
mod lone;
mod outline;
mod output;
mod sides;
mod source;
mod system;

use block::{BlockSplats, Frames};
use fill::BlockStore;
use glam::DVec3;
use grid::Grid;
use layout::Layout;
use output::{Out, Shown, Sink, unwritable};
use source::{Gathered, LoadReport, Source, SourceContent, sampling_of, splats_within};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use surfel_backend::Backend;
use surfel_framing::UpConvention;
use surfel_io::{Crs, GeoImage, GeoSamples, write_geotiffs};
use surfel_load::Conversion;
use surfel_load::coloring::together::{ColorJob, Colors, Member, MissingAttribute, Tallies};
use surfel_load::coloring::{Attribute, ColorScale, Coloring, paint};
use surfel_load::effects::UnusedOption;
use surfel_load::steps::{splats_of_points, without_attribute};
use surfel_load::{Error, LoadOptions};
use surfel_model::{ExtraColumn, ModelError, SplatCloud, Up};
use surfel_sample::{NoProgress, Progress};
use system::crs_of;

/// Memory limit, in bytes, for the points that stay in memory from the first reading of the files. A file's points that
/// would exceed it are freed, and loaded again when a block needs them. Before they are loaded, [`make_room`] frees
/// other files' points until the rest takes at most half of the limit.
const KEPT_BYTES: usize = 2 << 30;
/// Smallest side, in pixels, of the windows in which gaps are filled one after another.
const WINDOW_PX: u32 = 512;
/// Height above the middle of a block's points of the viewpoint toward which their estimated normals are turned. The
/// unit is the larger of the side of the block with its surroundings and the points' range of heights.
const VIEWPOINT_SIDES: f64 = 1e3;

/// Options for the grid and the content of an orthoimage.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct OrthoOptions {
    /// Ground sampling distance: side of a pixel in the units of x and y; greater than 0.
    pub gsd: f64,
    /// Position (x, y) of a corner of the pixel grid, in the units of x and y.
    pub origin: [f64; 2],
    /// Bounds of the image in the units of x and y: minimum x, minimum y, maximum x, maximum y. They are enlarged to
    /// whole pixels. `None` uses `size`, or else the bounds of the points and splats.
    pub bounds: Option<[f64; 4]>,
    /// Number of columns and rows, at least 1, as an alternative to `bounds`; ignored if `bounds` is given. The lower
    /// left corner of the image is then `origin`.
    pub size: Option<[u32; 2]>,
    /// EPSG code of the coordinate reference system, 1024 to 32,766; `None` uses the system that the files state.
    pub epsg: Option<u16>,
    /// Limit on the gaps that are filled by interpolation: no circle of this radius, in the units of x and y, fits into
    /// them. It is more than 0 and at most 512 pixels. `None` fills no gaps.
    pub fill: Option<f64>,
    /// True if points that are isolated in height are drawn, such as birds and reflections. False if they are dropped.
    pub lone: bool,
    /// Options for loading files and converting them to splats.
    pub load: LoadOptions,
}

impl OrthoOptions {
    /// Creates options with a ground sampling distance, for the whole area of the files.
    pub fn new(gsd: f64) -> Self {
        let load = LoadOptions::default().with_surface(true);
        Self { gsd, origin: [0.0; 2], bounds: None, size: None, epsg: None, fill: None, lone: false, load }
    }

    surfel_model::setters! {
        with_gsd gsd: f64,
        with_origin origin: [f64; 2],
        with_bounds bounds: Option<[f64; 4]>,
        with_size size: Option<[u32; 2]>,
        with_epsg epsg: Option<u16>,
        with_fill fill: Option<f64>,
        with_lone lone: bool,
        with_load load: LoadOptions,
    }
}

/// Paths of the image files to write, at least one.
///
/// With [`OrthoOptions::fill`], each file has an additional band that marks interpolated pixels. Its value there is 255
/// in 8-bit files and 1 in f32 files; elsewhere it is 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OrthoFiles {
    /// Colour image: 8-bit RGBA, sRGB-encoded. Alpha is 255 at pixels with data, else 0.
    pub color: Option<PathBuf>,
    /// Height image: z as f32, −9999 at empty pixels.
    pub dsm: Option<PathBuf>,
    /// Normal image: unit normals that face up, as three f32; −9999 at empty pixels.
    pub normals: Option<PathBuf>,
    /// True if existing files are replaced.
    pub overwrite: bool,
}

/// Statistics of an orthoimage that was drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OrthoStats {
    /// Number of pixels with data, including interpolated ones.
    pub covered: u64,
    /// Number of pixels whose values were interpolated; [`Self::covered`] includes them.
    pub filled: u64,
    /// Number of points in the image that were dropped because they are isolated in height.
    pub lone: u64,
    /// Number of pixels of the image.
    pub pixels: u64,
    /// Number of splats that were drawn, summed over blocks. Splats in the margins of blocks count once per block.
    pub splats: u64,
    /// Time spent on reloading files and converting points to splats.
    pub preparing: Duration,
    /// Time spent on drawing blocks.
    pub drawing: Duration,
    /// Time spent on filling gaps, and on encoding and writing the image files.
    pub writing: Duration,
}

/// Opened files, and the grid of their orthoimage.
pub struct Ortho {
    sources: Vec<Source>,
    grid: Grid,
    layout: Layout,
    options: OrthoOptions,
    /// Colouring by an attribute that all blocks share; `None` if points have their own colours.
    color_by: Option<FixedColor>,
    /// Coordinate reference system of the image; `None` if neither the options nor a file state one.
    pub crs: Option<Crs>,
    /// Notes for the user, as sentences without a full stop. Each has the path of a file, or `None` for notes about the
    /// image.
    pub notes: Vec<(Option<PathBuf>, String)>,
    /// Loading options that have no effect on a file, each with the file's path.
    pub unused: Vec<(PathBuf, UnusedOption)>,
    /// Attribute and scale that colour the image, with the path of the first coloured file. `None` if no file is
    /// coloured by an attribute.
    pub coloring: Option<(PathBuf, Coloring)>,
}

/// Colouring that all files and blocks share, and the legend of the image with the path of the first coloured file.
type SharedColors = (Option<FixedColor>, Option<(PathBuf, Coloring)>);

/// Attribute and colour scale that all files and blocks share.
struct FixedColor {
    attribute: String,
    /// True if `attribute` is a column of some file, so that blocks must retain this column.
    is_column: bool,
    scale: ColorScale,
}

impl FixedColor {
    /// Returns the name of the column that blocks must retain, if the attribute is one.
    fn column(&self) -> Option<&str> {
        self.is_column.then_some(self.attribute.as_str())
    }
}

impl Ortho {
    /// Opens files of points, splats and meshes, in which z is up. Files are loaded, and checked for consistency.
    ///
    /// # Errors
    /// Errors of [`surfel_load::load()`]; [`Error::Model`] for a grid that is out of range. [`Error::Unsuitable`] for
    /// empty files, for files in degrees, for files with different coordinate reference systems, for bounds without
    /// data, and for stray points that would enlarge the image more than 100 times.
    pub fn open(inputs: &[&Path], options: &OrthoOptions, progress: &dyn Progress) -> Result<Self, Error> {
        let mut options = options.clone();
        let asked = asked(&options)?;
        if let Some(distance) = options.fill {
            let found = distance / options.gsd;
            if !(distance > 0.0 && found.is_finite() && found <= f64::from(fill::MAX_PX)) {
                let expected = "a number greater than 0, and at most 512 pixels";
                return Err(
                    ModelError::OutOfRange { field: "fill".into(), found: distance.to_string(), expected }.into()
                );
            }
        }
        let (mut sources, mut notes, mut unused) = (Vec::<Source>::new(), Vec::new(), Vec::new());
        // Height is measured along z, as in surface models.
        options.load.up = Some(Up::PlusZ);
        let mut colors = ColorChoice::default();
        let mut kept = 0;
        for path in inputs {
            let mut told = LoadReport::default();
            let mut source = Source::load(path, &options.load, &mut told, progress)?;
            let LoadReport { notes: own, unused: own_unused, color_job } = told;
            notes.extend(own.into_iter().map(|note| (Some(path.to_path_buf()), note)));
            unused.extend(own_unused.into_iter().map(|option| (path.to_path_buf(), option)));
            match &mut source.holds {
                SourceContent::Splats(cloud) => colors.add_splats(color_job, cloud),
                SourceContent::Points(points) => {
                    colors.add_points(path, points, &options.load)?;
                    kept += points.bytes;
                    if kept > KEPT_BYTES {
                        kept -= points.free();
                    }
                }
            }
            sources.push(source);
        }
        for source in &sources {
            extent::check_not_degrees(source, options.epsg.is_some())?;
        }
        let (color_by, coloring) = colors.finish(&mut sources, &options.load, &mut notes, &mut unused)?;
        let crs = crs_of(&sources, options.epsg, &mut notes)?;
        let bounds = bounds_of(&sources);
        let grid = match asked {
            Some(asked) => grid_of(&options, asked)?,
            None => extent::grid_of_points(&options, bounds, &sources)?,
        };
        if let Some(asked) = asked.filter(|asked| !sources.iter().any(|source| source.meets(*asked))) {
            let words = |b: [f64; 4]| format!("{},{},{},{}", b[0], b[1], b[2], b[3]);
            let first = inputs.first().map_or_else(PathBuf::new, |path| path.to_path_buf());
            let problem = format!("nothing lies within the bounds {}, but within {}", words(asked), words(bounds));
            return Err(Error::Unsuitable { path: first, problem });
        }
        let layout = Layout::new(grid, sampling_of(&sources));
        options.load.convert.color_by = None;
        Ok(Self { sources, grid, layout, options, color_by, crs, notes, unused, coloring })
    }

    /// Returns the number of columns and rows of the image.
    pub fn size(&self) -> [u32; 2] {
        self.grid.size
    }

    /// Returns the bounds of the image: minimum x, minimum y, maximum x, maximum y.
    pub fn bounds(&self) -> [f64; 4] {
        self.grid.bounds()
    }

    /// Returns the bounds of the image (minimum x, minimum y, maximum x, maximum y) rounded to six decimals, which
    /// removes binary rounding errors.
    pub fn rounded_bounds(&self) -> [f64; 4] {
        self.bounds().map(|v| (v * 1e6).round() / 1e6)
    }

    /// Returns the ground sampling distance: side of a pixel in the units of x and y.
    pub fn gsd(&self) -> f64 {
        self.options.gsd
    }

    /// Draws the images, and writes them to `files`. `software` is the program name stored in the files. The files
    /// appear when all are complete.
    ///
    /// # Errors
    /// [`Error::Usage`] if `files` names no image, [`Error::Io`] if a file exists already or can't be written.
    /// [`Error::Render`] if a block can't be drawn. Files are loaded again, with the errors of [`Ortho::open`].
    pub fn draw(
        &mut self,
        files: &OrthoFiles,
        software: &str,
        backend: &mut Backend,
        progress: &dyn Progress,
    ) -> Result<OrthoStats, Error> {
        let kinds = [
            (Shown::Color, files.color.as_ref(), GeoSamples::Rgba8, vec!["red", "green", "blue", "alpha", "filled"]),
            (Shown::Height, files.dsm.as_ref(), GeoSamples::F32(1), vec!["height", "filled"]),
            (Shown::Normal, files.normals.as_ref(), GeoSamples::F32(3), vec!["x", "y", "z", "filled"]),
        ];
        let has_marks = self.options.fill.is_some();
        let (mut shown, mut images) = (Vec::new(), Vec::new());
        for (kind, path, samples, bands) in kinds {
            let Some(path) = path else { continue };
            shown.push(kind);
            images.push(GeoImage {
                path: path.clone(),
                size: self.grid.size,
                samples,
                bands: if has_marks { bands } else { Vec::new() },
                has_marks,
                left_top: self.grid.left_top(),
                pixel: self.grid.gsd,
                crs: self.crs.clone(),
                software: software.to_owned(),
            });
        }
        let Some(first) = images.first().map(|image| image.path.clone()) else {
            return Err(Error::Usage("there is no image to write, expected colours, heights or normals".to_owned()));
        };
        let mut stats = OrthoStats { pixels: self.grid.size.map(u64::from).iter().product(), ..OrthoStats::default() };
        write_geotiffs(&images, files.overwrite, |tiles| {
            let mut sink = Sink { grid: self.grid, shown, tiles };
            match self.options.fill {
                None => {
                    let grid = self.grid;
                    self.draw_blocks(&grid, &mut Out::Image(&mut sink), backend, progress, &mut stats)
                }
                Some(distance) => self.draw_filled(distance, &first, &mut sink, backend, progress, &mut stats),
            }
        })?;
        Ok(stats)
    }

    /// Draws the image and the margin that the filling of gaps needs, fills the gaps, and writes the image. `distance`
    /// is [`OrthoOptions::fill`], and `beside` an image file in whose folder blocks are stored.
    fn draw_filled(
        &mut self,
        distance: f64,
        beside: &Path,
        sink: &mut Sink<'_, '_>,
        backend: &mut Backend,
        progress: &dyn Progress,
        stats: &mut OrthoStats,
    ) -> Result<(), Error> {
        let radius_px = distance / self.grid.gsd;
        let margin = fill::margin_px(radius_px);
        let failed = |source| unwritable(beside, source);
        let has = sink.has();
        let mut store = BlockStore::beside(beside, self.layout.block_px as usize, has).map_err(failed)?;
        let around = self.grid.grown(margin);
        self.draw_blocks(&around, &mut Out::Store(&mut store, beside), backend, progress, stats)?;
        stats.covered = 0;
        let start = Instant::now();
        let side = WINDOW_PX.max(margin);
        let [width, height] = self.grid.size;
        for top in (0..height).step_by(side as usize) {
            let rows = side.min(height - top);
            for left in (0..width).step_by(side as usize) {
                let columns = side.min(width - left);
                let west = self.grid.first[0] + i64::from(left) - i64::from(margin);
                let north = self.grid.first[1] + i64::from(height) - 1 - i64::from(top) + i64::from(margin);
                let [columns, rows] = [columns, rows].map(|n| (n + 2 * margin) as usize);
                let planes = store.get([west, north], columns, rows).map_err(failed)?;
                let planes = fill::close(planes, radius_px, margin as usize);
                sink.write([left, top], &planes, stats)?;
            }
            sink.done_above(top + rows)?;
        }
        stats.writing += start.elapsed();
        Ok(())
    }

    /// Draws the blocks that contain pixels of `grid`. Blocks are drawn from north to south, so that few tiles of an
    /// image file are incomplete at a time.
    fn draw_blocks(
        &mut self,
        grid: &Grid,
        out: &mut Out<'_, '_, '_>,
        backend: &mut Backend,
        progress: &dyn Progress,
        stats: &mut OrthoStats,
    ) -> Result<(), Error> {
        let (columns, rows) = (self.layout.blocks(grid, 0), self.layout.blocks(grid, 1));
        let blocks = rows.rev().flat_map(|row| columns.clone().map(move |column| [column, row]));
        let blocks: Vec<[i64; 2]> = blocks.filter(|block| self.meets_any(*block)).collect();
        progress.stage("orthoimage", blocks.len() as u64);
        let mut frames = Frames::default();
        for (time, block) in blocks.iter().copied().enumerate() {
            let start = Instant::now();
            let splats = self.splats_of(block, time as u64 + 1, stats)?;
            stats.preparing += start.elapsed();
            if !splats.clouds.is_empty() {
                stats.splats += splats.clouds.iter().map(|cloud| cloud.len() as u64).sum::<u64>();
                let start = Instant::now();
                let (own, layout) = (&self.grid, &self.layout);
                let has = out.has();
                let pixels = block::draw(splats, own, layout, block, has, backend, &mut frames)?;
                stats.drawing += start.elapsed();
                let start = Instant::now();
                out.put(&pixels, layout, block, stats)?;
                stats.writing += start.elapsed();
            }
            // The row of blocks is complete.
            if blocks.get(time + 1).is_none_or(|next| next[1] != block[1]) {
                out.done(&self.layout, block[1])?;
            }
            progress.advance(1);
        }
        Ok(())
    }

    /// True if the bounds of some file overlap a block or its surroundings.
    fn meets_any(&self, block: [i64; 2]) -> bool {
        let within = self.layout.drawn(block, self.layout.halo);
        self.sources.iter().any(|source| source.meets(within))
    }

    /// Returns the splats of a block and its surroundings, made from points and splats of all files. `time` is the
    /// block's number, counted from 1.
    fn splats_of(&mut self, block: [i64; 2], time: u64, stats: &mut OrthoStats) -> Result<BlockSplats, Error> {
        let Self { sources, grid, layout, options, color_by, .. } = self;
        let within = layout.drawn(block, layout.halo);
        let column = color_by.as_ref().and_then(FixedColor::column);
        let mut splats = BlockSplats::default();
        let (mut gathered, mut path) = (Gathered::default(), None);
        for k in 0..sources.len() {
            if !sources[k].meets(within) {
                continue;
            }
            if let SourceContent::Points(points) = &sources[k].holds
                && !points.is_loaded()
            {
                make_room(sources, time);
            }
            let Source { path: own, holds, .. } = &mut sources[k];
            match holds {
                SourceContent::Points(points) => {
                    points.prepare(own, &options.load, layout, column, time)?;
                    points.gather(within, layout, &mut gathered);
                    path = path.or_else(|| Some(own.clone()));
                }
                SourceContent::Splats(cloud) => splats.clouds.extend(splats_within(cloud, within)?),
            }
        }
        let (points, left_out) = gathered.finish(column, Some(layout.spacing).filter(|_| !options.lone));
        let (own, image) = (layout.own(block), grid.bounds());
        let is_in = |[x0, y0, x1, y1]: [f64; 4], p: &DVec3| p.x >= x0 && p.x < x1 && p.y >= y0 && p.y < y1;
        stats.lone += left_out.iter().filter(|p| is_in(own, p) && is_in(image, p)).count() as u64;
        if let Some((lo, hi)) = points.bounds() {
            let path = path.unwrap_or_default();
            let side = (within[2] - within[0]).max(hi.z - lo.z);
            let above = 0.5 * (lo + hi) + DVec3::Z * VIEWPOINT_SIDES * side;
            let (load, progress) = (&options.load, &NoProgress);
            let made = splats_of_points(&points, Some(above), &path, load, &mut Vec::new(), progress)?;
            let (mut cloud, made) = made;
            splats.is_foliage = vec![false; cloud.len()];
            if let Conversion::Points(report) = made {
                report.level.iter().for_each(|i| splats.is_foliage[*i as usize] = true);
            }
            if let Some(by) = color_by {
                let attribute = Attribute::of(&cloud.data().extras, cloud.data().colors.is_some(), &by.attribute);
                paint(&mut cloud, attribute.ok(), &by.scale, DVec3::Z)?;
            }
            splats.clouds.push(cloud);
        }
        Ok(splats)
    }
}

/// Returns the image's bounds if the options state bounds or a size, else `None`. Returns an error if the options state
/// an invalid grid, so that it is found before files are loaded.
fn asked(options: &OrthoOptions) -> Result<Option<[f64; 4]>, Error> {
    let asked = match (options.bounds, options.size) {
        (Some(bounds), _) => Some(bounds),
        (None, Some([width, height])) => {
            let [x, y] = options.origin;
            Some([x, y, x + f64::from(width) * options.gsd, y + f64::from(height) * options.gsd])
        }
        (None, None) => None,
    };
    grid_of(options, asked.unwrap_or([0.0, 0.0, options.gsd, options.gsd]))?;
    Ok(asked)
}

/// Returns the grid of the pixels that overlap `bounds`, with the options' resolution and origin. The error names
/// the option that is invalid.
fn grid_of(options: &OrthoOptions, bounds: [f64; 4]) -> Result<Grid, Error> {
    let size = options.size.filter(|_| options.bounds.is_none());
    Grid::of_bounds(options.gsd, options.origin, bounds).map_err(|fault| fault.of_bounds(bounds, size))
}

/// Attributes that may colour points without colours, if the options name none. The first one that all files have is
/// used.
const OWN_COLORS: [&str; 2] = ["intensity", "height"];

/// Notes, each with the path of a file, or `None` for notes about the image.
type Notes = Vec<(Option<PathBuf>, String)>;
/// Loading options without effect on a file, each with the file's path.
type Unused = Vec<(PathBuf, UnusedOption)>;

/// Attribute values collected from all files, from which one colour scale for the whole image is derived.
#[derive(Default)]
struct ColorChoice {
    tallies: Tallies,
    /// Colouring requests of all files, with a report for each file that lacks the requested attribute.
    jobs: Vec<(ColorJob, Option<MissingAttribute>)>,
    /// True if some file of points has no colours.
    has_uncolored: bool,
    lacks_intensity: bool,
    is_column: bool,
    first_points: Option<PathBuf>,
}

impl ColorChoice {
    fn add_splats(&mut self, job: Option<ColorJob>, cloud: &mut Arc<SplatCloud>) {
        let Some(job) = job else { return };
        self.is_column |= ExtraColumn::find(&cloud.data().extras, &job.attribute).is_some();
        let lacking = self.tallies.add(&mut [Member { job: &job, cloud, is_colored: false }]).pop();
        self.jobs.push((job, lacking));
    }

    fn add_points(&mut self, path: &Path, points: &source::Points, load: &LoadOptions) -> Result<(), Error> {
        let Some(cloud) = points.as_loaded() else { return Ok(()) };
        let colors = Colors::of(load)?;
        self.first_points.get_or_insert_with(|| path.to_path_buf());
        self.has_uncolored |= !points.has_colors;
        self.lacks_intensity |= !points.has_intensity;
        let attributes: Vec<&str> = match &load.convert.color_by {
            Some(attribute) => vec![attribute],
            None => OWN_COLORS.to_vec(),
        };
        for attribute in attributes {
            let job = ColorJob {
                path: path.to_path_buf(),
                attribute: attribute.to_owned(),
                colors: colors.clone(),
                up: load.up,
                convention: UpConvention::Points,
                others: Vec::new(),
            };
            let lacking = self.tallies.add_points(&job, cloud).err().map(|known| MissingAttribute { member: 0, known });
            if load.convert.color_by.is_some() {
                self.is_column |= ExtraColumn::find(&cloud.extras, attribute).is_some();
                self.jobs.push((job, lacking));
            }
        }
        Ok(())
    }

    /// Determines one colour scale for all files. If the options name an attribute, applies the scale to the splats of
    /// splat files.
    fn finish(
        self,
        sources: &mut [Source],
        load: &LoadOptions,
        notes: &mut Notes,
        unused: &mut Unused,
    ) -> Result<SharedColors, Error> {
        let own = || OWN_COLORS[usize::from(self.lacks_intensity)].to_owned();
        let Some(attribute) = load.convert.color_by.clone().or_else(|| self.has_uncolored.then(own)) else {
            return Ok((None, None));
        };
        let is_column = self.is_column || (load.convert.color_by.is_none() && attribute == OWN_COLORS[0]);
        let first = self.jobs.first().map(|(job, _)| job.path.clone()).or(self.first_points);
        let found = self.tallies.coloring(&attribute);
        for (job, lacking) in &self.jobs {
            let Some(lacking) = lacking else { continue };
            let option = without_attribute(job, lacking);
            if found.is_none() {
                unused.push((job.path.clone(), option));
                break;
            }
            notes.push((Some(job.path.clone()), format!("holds {}, so that it is grey", option.holds)));
        }
        let (coloring, note) = found.unzip();
        let scale = coloring.as_ref().map_or(ColorScale::Direct, |coloring| coloring.scale.clone());
        notes.extend(note.map(|note| (first.clone(), note)));
        if load.convert.color_by.is_some() {
            for source in sources {
                let SourceContent::Splats(cloud) = &mut source.holds else { continue };
                let data = cloud.data();
                let own = Attribute::of(&data.extras, data.colors.is_some(), &attribute);
                paint(Arc::make_mut(cloud), own.ok(), &scale, DVec3::Z)?;
            }
        }
        let coloring = coloring.map(|coloring| (first.unwrap_or_default(), coloring));
        Ok((Some(FixedColor { attribute, is_column, scale }), coloring))
    }
}

/// Frees the points of the least recently used files until the points in memory take at most half of [`KEPT_BYTES`].
/// Points that the block with number `time` uses aren't freed.
fn make_room(sources: &mut [Source], time: u64) {
    loop {
        let mut loaded: Vec<_> = sources
            .iter_mut()
            .filter_map(
                |source| if let SourceContent::Points(points) = &mut source.holds { Some(points) } else { None },
            )
            .filter(|points| points.is_loaded())
            .collect();
        let total: usize = loaded.iter().map(|points| points.bytes).sum();
        let oldest =
            loaded.iter_mut().filter(|points| points.last_used() < time).min_by_key(|points| points.last_used());
        match oldest {
            Some(points) if total > KEPT_BYTES / 2 => drop(points.free()),
            _ => return,
        }
    }
}

/// Returns the bounds of all files in x and y. An axis without extent is enlarged slightly.
fn bounds_of(sources: &[Source]) -> [f64; 4] {
    let start = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let [x0, y0, x1, y1] = sources.iter().fold(start, |[x0, y0, x1, y1], source| {
        let (lo, hi) = source.bounds;
        [x0.min(lo.x), y0.min(lo.y), x1.max(hi.x), y1.max(hi.y)]
    });
    let beyond = |low: f64, high: f64| if high > low { high } else { low + low.abs().max(1.0) * 1e-9 };
    [x0, y0, beyond(x0, x1), beyond(y0, y1)]
}
