//! Orthoimages: what points and splats look like from above, north up, on an exact grid, with their heights.
//!
//! [`Ortho::open`] loads the files and settles the grid, [`Ortho::draw`] writes GeoTIFF images. The plane is drawn in
//! blocks whose splats are made of the points within and around them, so that memory doesn't grow with the image, and
//! images of the same files with other bounds have the same pixels.

mod block;
mod grid;
mod layout;
mod outline;
mod request;
mod sides;
mod source;

use crate::coloring::{self, ColorBy, ColorScale, Colored, Coloring};
use crate::load::{Conversion, UnusedOption};
use crate::{Backend, Error, LoadOptions, LoadedCloud};
use block::{BlockPixels, BlockSplats, Frames};
use glam::DVec3;
use grid::Grid;
use layout::Layout;
pub use request::OrthoRequest;
use source::{Gathered, Holds, Source, Told, splats_within};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use surfel_io::ShowPath as _;
use surfel_io::{Crs, GeoImage, GeoSamples, GeoTiles, IoError, write_geotiffs};
use surfel_model::{Colormap, ExtraColumn, ModelError};
use surfel_sample::{NoProgress, Progress};

/// Bytes of points that stay in memory between blocks; those of other files are loaded again.
const KEPT_BYTES: usize = 2 << 30;
/// How far above a block its points' normals look, in its sides.
const VIEWPOINT_SIDES: f64 = 1e3;

/// What an orthoimage shows, and on which grid.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct OrthoOptions {
    /// Ground sampling distance: side of a pixel in the units of x and y; greater than 0.
    pub gsd: f64,
    /// A corner of pixels.
    pub origin: [f64; 2],
    /// Least x and y, then largest; grown to whole pixels. `None`: those of the points.
    pub bounds: Option<[f64; 4]>,
    /// Columns and rows, whose lower left corner is `origin`, in place of bounds.
    pub size: Option<[u32; 2]>,
    /// EPSG code of the coordinate reference system; `None`: as the files say.
    pub epsg: Option<u16>,
    /// How files are loaded and made into splats.
    pub load: LoadOptions,
}

impl OrthoOptions {
    /// The whole of the files, at this ground sampling distance.
    pub fn new(gsd: f64) -> Self {
        Self { gsd, origin: [0.0; 2], bounds: None, size: None, epsg: None, load: LoadOptions::default() }
    }

    surfel_model::setters! {
        with_gsd gsd: f64,
        with_origin origin: [f64; 2],
        with_bounds bounds: Option<[f64; 4]>,
        with_size size: Option<[u32; 2]>,
        with_epsg epsg: Option<u16>,
        with_load load: LoadOptions,
    }
}

/// The images to write.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OrthoFiles {
    /// Colours: RGBA of 8 bits, sRGB-encoded; alpha is 255 where something is, else 0.
    pub color: PathBuf,
    /// Heights z, f32; −9999 where nothing is.
    pub dsm: Option<PathBuf>,
    /// Unit normals, upward, three f32; −9999 where nothing is.
    pub normals: Option<PathBuf>,
    /// Files that are there are replaced.
    pub overwrite: bool,
}

/// What was drawn, and what it took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OrthoStats {
    /// Pixels that show something.
    pub covered: u64,
    /// Pixels of the image.
    pub pixels: u64,
    /// Splats that were drawn, those of blocks' margins again for each block.
    pub splats: u64,
    /// Time that loading files again and making splats of points took.
    pub preparing: Duration,
    /// Time that drawing took.
    pub drawing: Duration,
    /// Time that encoding and writing took.
    pub writing: Duration,
}

/// Files that are loaded, and the grid of their image.
pub struct Ortho {
    sources: Vec<Source>,
    grid: Grid,
    layout: Layout,
    options: OrthoOptions,
    /// What points are coloured by.
    color_by: Option<FixedColor>,
    /// The coordinate reference system of the image.
    pub crs: Option<Crs>,
    /// What the user should know of each file, as sentences without a full stop; no file: of the image.
    pub notes: Vec<(Option<PathBuf>, String)>,
    /// Options that what the files hold left without effect.
    pub unused: Vec<(PathBuf, UnusedOption)>,
    /// What is coloured by values, and how.
    pub coloring: Option<(PathBuf, Coloring)>,
}

/// A colouring that is the same for all blocks.
struct FixedColor {
    attribute: String,
    /// The column whose values it needs, as the files call it.
    column: Option<String>,
    map: Option<Colormap>,
    range: Option<[f64; 2]>,
}

impl Ortho {
    /// Loads files: points, splats and meshes, whose z is up.
    ///
    /// # Errors
    /// As [`crate::load`]; also [`Error::Model`] for a grid that is out of range, and [`Error::Unsuitable`] for files
    /// whose coordinates are degrees or whose coordinate reference systems differ, and bounds that hold nothing.
    pub fn open(inputs: &[&Path], options: &OrthoOptions, progress: &dyn Progress) -> Result<Self, Error> {
        let mut options = options.clone();
        // Checked before anything is loaded.
        let asked = match (options.bounds, options.size) {
            (Some(bounds), _) => Some(bounds),
            (None, Some([width, height])) => {
                let [x, y] = options.origin;
                Some([x, y, x + f64::from(width) * options.gsd, y + f64::from(height) * options.gsd])
            }
            (None, None) => None,
        };
        Grid::of_bounds(options.gsd, options.origin, asked.unwrap_or([0.0, 0.0, options.gsd, options.gsd]))?;
        let (mut sources, mut notes, mut unused) = (Vec::<Source>::new(), Vec::new(), Vec::new());
        let (mut coloring, mut color_by) = (None, None);
        let mut kept = 0;
        for path in inputs {
            let mut told = Told::default();
            let mut source = Source::load(path, &options.load, &mut told, progress)?;
            let Told { notes: own, unused: own_unused, loaded } = told;
            notes.extend(own.into_iter().map(|note| (Some(path.to_path_buf()), note)));
            unused.extend(own_unused.into_iter().map(|option| (path.to_path_buf(), option)));
            if let Some(LoadedCloud { coloring: Some(found), .. }) = loaded {
                coloring = coloring.or(Some((path.to_path_buf(), found)));
            }
            if let Holds::Points(points) = &mut source.holds {
                if color_by.is_none() {
                    let attribute = options.load.color_by.clone().or_else(|| own_color(points));
                    if let (Some(attribute), Some(cloud)) = (attribute, points.as_loaded()) {
                        let by = ColorBy {
                            attribute: &attribute,
                            map: options.load.colormap,
                            range: options.load.range,
                            up: DVec3::Z,
                        };
                        match coloring::scale_of(cloud, &by) {
                            Colored::By(found, note) => {
                                notes.push((Some(path.to_path_buf()), note));
                                let column = ExtraColumn::find(&cloud.extras, &attribute).map(|c| c.name.clone());
                                color_by = Some(FixedColor::new(attribute, column, &options.load, &found));
                                coloring = coloring.or(Some((path.to_path_buf(), found)));
                            }
                            Colored::Unknown(known) => unused.push((
                                path.to_path_buf(),
                                UnusedOption {
                                    option: "color_by",
                                    holds: format!(
                                        "no attribute '{}' but {}",
                                        attribute.escape_debug(),
                                        known.join(", ")
                                    )
                                    .into(),
                                    expected: "one of these",
                                },
                            )),
                        }
                    }
                }
                kept += points.bytes;
                if kept > KEPT_BYTES {
                    kept -= points.free();
                }
            }
            sources.push(source);
        }
        let crs = crs_of(&sources, options.epsg, &mut notes)?;
        let bounds = bounds_of(&sources);
        let grid = Grid::of_bounds(options.gsd, options.origin, asked.unwrap_or(bounds))?;
        if let Some(asked) = asked.filter(|asked| !sources.iter().any(|source| source.meets(*asked))) {
            let words = |b: [f64; 4]| format!("{},{},{},{}", b[0], b[1], b[2], b[3]);
            let first = inputs.first().map_or_else(PathBuf::new, |path| path.to_path_buf());
            let problem = format!("nothing lies within the bounds {}, but within {}", words(asked), words(bounds));
            return Err(Error::Unsuitable { path: first, problem });
        }
        let layout = Layout::new(grid, &sources);
        options.load.color_by = None;
        Ok(Self { sources, grid, layout, options, color_by, crs, notes, unused, coloring })
    }

    /// Columns and rows of the image.
    pub fn size(&self) -> [u32; 2] {
        self.grid.size
    }

    /// Bounds of the image: least x and y, then largest.
    pub fn bounds(&self) -> [f64; 4] {
        self.grid.bounds()
    }

    /// Draws the images; `software` is who writes them. They appear when all are whole.
    ///
    /// # Errors
    /// [`Error::Io`] if a file is there already or can't be written, and what loading and drawing say.
    pub fn draw(
        &mut self,
        files: &OrthoFiles,
        software: &str,
        backend: &mut Backend,
        progress: &dyn Progress,
    ) -> Result<OrthoStats, Error> {
        let image = |path: &Path, samples: GeoSamples| GeoImage {
            path: path.to_path_buf(),
            size: self.grid.size,
            samples,
            left_top: self.grid.left_top(),
            pixel: self.grid.gsd,
            crs: self.crs.clone(),
            software: software.to_owned(),
        };
        let mut images = vec![image(&files.color, GeoSamples::Rgba8)];
        images.extend(files.dsm.iter().map(|path| image(path, GeoSamples::F32(1))));
        images.extend(files.normals.iter().map(|path| image(path, GeoSamples::F32(3))));
        let wanted = Wanted { dsm: files.dsm.is_some(), normals: files.normals.is_some() };
        let mut stats = OrthoStats { pixels: self.grid.size.map(u64::from).iter().product(), ..OrthoStats::default() };
        write_geotiffs(&images, files.overwrite, |tiles| {
            self.draw_blocks(tiles, wanted, backend, progress, &mut stats)
        })?;
        Ok(stats)
    }

    /// From north to south, so that few tiles of a file are begun at a time.
    fn draw_blocks(
        &mut self,
        tiles: &mut [GeoTiles<'_, '_>],
        wanted: Wanted,
        backend: &mut Backend,
        progress: &dyn Progress,
        stats: &mut OrthoStats,
    ) -> Result<(), Error> {
        let (columns, rows) = (self.layout.blocks(0), self.layout.blocks(1));
        let blocks = rows.rev().flat_map(|row| columns.clone().map(move |column| [column, row]));
        let blocks: Vec<[i64; 2]> = blocks.filter(|block| self.meets_any(*block)).collect();
        progress.stage("orthoimage", blocks.len() as u64);
        let mut frames = Frames::default();
        for (time, block) in blocks.into_iter().enumerate() {
            let start = Instant::now();
            let splats = self.splats_of(block, time as u64 + 1)?;
            stats.preparing += start.elapsed();
            if !splats.clouds.is_empty() {
                stats.splats += splats.clouds.iter().map(|cloud| cloud.len() as u64).sum::<u64>();
                let start = Instant::now();
                let (grid, layout) = (&self.grid, &self.layout);
                let pixels = block::draw(splats, grid, layout, block, wanted.normals, backend, &mut frames)?;
                stats.drawing += start.elapsed();
                let start = Instant::now();
                stats.covered += self.write_block(&pixels, block, wanted, tiles)?;
                stats.writing += start.elapsed();
            }
            progress.advance(1);
        }
        Ok(())
    }

    fn meets_any(&self, block: [i64; 2]) -> bool {
        let within = self.layout.drawn(block, self.layout.halo);
        self.sources.iter().any(|source| source.meets(within))
    }

    /// The splats of a block and of what is around it.
    fn splats_of(&mut self, block: [i64; 2], time: u64) -> Result<BlockSplats, Error> {
        let Self { sources, layout, options, color_by, .. } = self;
        let within = layout.drawn(block, layout.halo);
        let column = color_by.as_ref().and_then(|by| by.column.as_deref());
        let mut splats = BlockSplats::default();
        let (mut gathered, mut path) = (Gathered::default(), None);
        for k in 0..sources.len() {
            if !sources[k].meets(within) {
                continue;
            }
            if let Holds::Points(points) = &sources[k].holds
                && !points.is_loaded()
            {
                make_room(sources, time);
            }
            let Source { path: own, holds, .. } = &mut sources[k];
            match holds {
                Holds::Points(points) => {
                    points.prepare(own, &options.load, layout, column, time)?;
                    points.gather(within, layout, &mut gathered);
                    path = path.or_else(|| Some(own.clone()));
                }
                Holds::Splats(cloud) => splats.clouds.extend(splats_within(cloud, within)?),
            }
        }
        let points = gathered.finish(column);
        if let Some((lo, hi)) = points.bounds() {
            let path = path.unwrap_or_default();
            let side = (within[2] - within[0]).max(hi.z - lo.z);
            let above = 0.5 * (lo + hi) + DVec3::Z * VIEWPOINT_SIDES * side;
            let (load, progress) = (&options.load, &NoProgress);
            let made = crate::convert::splats_of_points(&points, Some(above), &path, load, &mut Vec::new(), progress)?;
            let (mut cloud, made) = made;
            splats.leaves = vec![false; cloud.len()];
            if let Conversion::Points(report) = made {
                report.level.iter().for_each(|i| splats.leaves[*i as usize] = true);
            }
            if let Some(by) = color_by {
                let by = ColorBy { attribute: &by.attribute, map: by.map, range: by.range, up: DVec3::Z };
                coloring::color(&mut cloud, &by)?;
            }
            splats.clouds.push(cloud);
        }
        Ok(splats)
    }

    /// Writes what of a block is inside of the image, and says how many pixels of that show something.
    fn write_block(
        &self,
        pixels: &BlockPixels,
        block: [i64; 2],
        wanted: Wanted,
        tiles: &mut [GeoTiles<'_, '_>],
    ) -> Result<u64, IoError> {
        let Layout { block_px, margin_px, .. } = self.layout;
        let overlap = |axis: usize| {
            let (first, count) = (self.grid.first[axis], i64::from(self.grid.size[axis]));
            let start = block[axis] * block_px;
            (start.max(first), (start + block_px).min(first + count))
        };
        let ((x0, x1), (y0, y1)) = (overlap(0), overlap(1));
        // Rows count from the top here, and from the south in the grid.
        let top = (block[1] + 1) * block_px + margin_px;
        let left = block[0] * block_px - margin_px;
        let rows: Vec<usize> = (y0..y1).rev().map(|y| (top - 1 - y) as usize * pixels.side).collect();
        let (from, width) = ((x0 - left) as usize, (x1 - x0) as usize);
        let at = [(x0 - self.grid.first[0]) as u32, (self.grid.first[1] + i64::from(self.grid.size[1]) - y1) as u32];
        fn cut<T: Copy>(plane: &[T], rows: &[usize], from: usize, width: usize) -> Vec<T> {
            rows.iter().flat_map(|row| &plane[row + from..row + from + width]).copied().collect()
        }
        let or_no_data = |v: f32| if v.is_nan() { GeoSamples::NODATA } else { v };
        let color = cut(&pixels.color, &rows, from, width);
        let covered = color.iter().filter(|c| c[3] > 0.0).count() as u64;
        tiles[0].write_color(at, width as u32, &color)?;
        if wanted.dsm {
            let height: Vec<f32> = cut(&pixels.height, &rows, from, width).into_iter().map(or_no_data).collect();
            tiles[1].write_f32(at, width as u32, &height)?;
        }
        if wanted.normals {
            let normal = cut(&pixels.normal, &rows, from, width);
            let normal: Vec<f32> = normal.into_iter().flatten().map(or_no_data).collect();
            tiles[usize::from(wanted.dsm) + 1].write_f32(at, width as u32, &normal)?;
        }
        Ok(covered)
    }
}

/// Which images there are beside the colours.
#[derive(Clone, Copy)]
struct Wanted {
    dsm: bool,
    normals: bool,
}

impl FixedColor {
    /// The colouring that gives what another one gave, whatever values it is given.
    fn new(attribute: String, column: Option<String>, load: &LoadOptions, found: &Coloring) -> Self {
        let (map, range) = match &found.scale {
            ColorScale::Range { map, range } => (Some(*map), Some(*range)),
            // Of classes the colours are their own.
            ColorScale::Categories(all) if load.colormap.is_none() && all.iter().any(|c| c.name.is_some()) => {
                (None, None)
            }
            ColorScale::Categories(_) => (Some(Colormap::Tab20), None),
            ColorScale::Direct => (None, None),
        };
        Self { attribute, column, map, range }
    }
}

/// What points without colours are coloured by.
fn own_color(points: &source::Points) -> Option<String> {
    match (points.has_colors, points.has_intensity) {
        (true, _) => None,
        (false, true) => Some("intensity".into()),
        (false, false) => Some("height".into()),
    }
}

/// Frees the points that were needed longest ago, until the others leave room; those of this block stay.
fn make_room(sources: &mut [Source], time: u64) {
    loop {
        let mut loaded: Vec<_> = sources
            .iter_mut()
            .filter_map(|source| if let Holds::Points(points) = &mut source.holds { Some(points) } else { None })
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

/// Bounds of all files in the plane; larger by something where they have no extent.
fn bounds_of(sources: &[Source]) -> [f64; 4] {
    let start = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let [x0, y0, x1, y1] = sources.iter().fold(start, |[x0, y0, x1, y1], source| {
        let (lo, hi) = source.bounds;
        [x0.min(lo.x), y0.min(lo.y), x1.max(hi.x), y1.max(hi.y)]
    });
    let beyond = |low: f64, high: f64| if high > low { high } else { low + low.abs().max(1.0) * 1e-9 };
    [x0, y0, beyond(x0, x1), beyond(y0, y1)]
}

/// The system of all files, or of the code that was given.
fn crs_of(
    sources: &[Source],
    epsg: Option<u16>,
    notes: &mut Vec<(Option<PathBuf>, String)>,
) -> Result<Option<Crs>, Error> {
    let degrees = |source: &Source| source.bounds.0.abs().max(source.bounds.1.abs()).truncate().max_element() <= 360.0;
    if let Some(code) = epsg {
        let crs = Crs::of_epsg(code);
        if crs.is_geographic() {
            let (field, found) = ("crs".into(), format!("EPSG:{code}, whose coordinates are degrees"));
            return Err(ModelError::OutOfRange { field, found, expected: "a projected system" }.into());
        }
        return Ok(Some(crs));
    }
    let mut first: Option<(&Source, &Crs)> = None;
    for source in sources {
        let Some(crs) = &source.crs else { continue };
        let unsuitable = |problem: String| Error::Unsuitable { path: source.path.clone(), problem };
        if crs.is_geographic() && degrees(source) {
            let problem = format!(
                "its x and y are degrees ({}), expected lengths: project it first, as by pdal translate IN OUT \
                 reprojection --filters.reprojection.out_srs=EPSG:N; or give --crs if it is projected",
                crs.words()
            );
            return Err(unsuitable(problem));
        }
        if crs.is_geographic() {
            let note = format!("says that its x and y are degrees ({}), which they can't be: ignored", crs.words());
            notes.push((Some(source.path.clone()), note));
            continue;
        }
        match first {
            None => first = Some((source, crs)),
            Some((_, known)) if known == crs || (known.epsg().is_some() && known.epsg() == crs.epsg()) => {}
            Some((other, known)) => {
                let (other, known) = (other.path.shown(), known.words());
                return Err(unsuitable(format!(
                    "has {}, but {other} has {known}: project one of them, or give --crs if they are the same",
                    crs.words()
                )));
            }
        }
    }
    match first {
        None => notes.push((None, "no coordinate reference system is known: --crs EPSG:N gives one".into())),
        Some((known, crs)) => {
            for source in sources.iter().filter(|source| source.crs.is_none()) {
                let note = format!("has no CRS: taken to be as in {}, {}", known.path.shown(), crs.words());
                notes.push((Some(source.path.clone()), note));
            }
        }
    }
    Ok(first.map(|(_, crs)| crs.clone()))
}
