//! Input files of an orthoimage: their points and splats, sorted into bins by position.

use super::canonical::Canonical;
use super::layout::{Layout, Sampling};
use super::lone::lone;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use std::cmp::Ordering;
use std::collections::{BTreeMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_io::copc::RADIUS;
use surfel_io::{Content, Crs, IN_DEGREES};
use surfel_load::coloring::together::ColorJob;
use surfel_load::effects::{self, UnusedOption};
use surfel_load::noise::water;
use surfel_load::{Error, LoadOptions};
use surfel_load::{LoadedCloud, steps};
use surfel_model::{Column3, ExtraColumn, ExtraValues, OnInvalid, PointCloud, SplatCloud};
use surfel_sample::{NoProgress, Progress};

/// Expected maximum number of points from which the density of a file's points is estimated.
const SAMPLE: usize = 1 << 17;
/// Average number of sampled points per grid cell when the density is estimated.
const IN_A_CELL: f64 = 16.0;

/// Input file of an orthoimage, with its points or splats.
pub(crate) struct Source {
    pub(crate) path: PathBuf,
    pub(crate) holds: SourceContent,
    /// Corners of the bounding box of the points or splats.
    pub(crate) bounds: (DVec3, DVec3),
    pub(crate) crs: Option<Crs>,
    /// True if the names or the steps of the columns x and y indicate degrees.
    pub(crate) is_named_degrees: bool,
}

/// Computes the density of the points and splats of all files, by which blocks are laid out.
pub(crate) fn sampling_of(sources: &[Source]) -> Sampling {
    let mut sampling = Sampling::default();
    let own_density = |source: &Source| match &source.holds {
        SourceContent::Points(points) if points.density.is_finite() => points.density,
        _ => 0.0,
    };
    for source in sources {
        if let SourceContent::Splats(cloud) = &source.holds {
            sampling.reach = (0..cloud.len()).map(|i| cloud.radius_max(i)).fold(sampling.reach, f64::max);
        }
        let own = own_density(source);
        if own > 0.0 {
            let middle = 0.5 * (source.bounds.0 + source.bounds.1);
            let at = [middle.x, middle.y, middle.x, middle.y];
            // Overlapping files have the sum of their densities, whereas adjacent files don't.
            let mut all: Vec<f64> = sources.iter().filter(|other| other.meets(at)).map(own_density).collect();
            // The densities are sorted, so that the sum doesn't depend on the order of files.
            all.sort_unstable_by(f64::total_cmp);
            sampling.density = sampling.density.max(all.iter().sum());
            sampling.spacing = sampling.spacing.max(own.sqrt().recip());
        }
    }
    sampling
}

/// Function that returns the position of a point or splat by its index.
pub(crate) type PositionOf<'a> = Box<dyn Fn(usize) -> DVec3 + 'a>;

/// Content of an input file.
pub(crate) enum SourceContent {
    /// Points, which are converted to splats block by block.
    Points(Box<Points>),
    /// Splats that were read from a splat file or made from a mesh.
    Splats(Arc<SplatCloud>),
}

/// Points of an input file. They may be freed to save memory, and are then loaded again when a block needs them.
pub(crate) struct Points {
    /// Number of points per unit of the area that they cover.
    pub(crate) density: f64,
    pub(crate) bytes: usize,
    pub(crate) has_colors: bool,
    pub(crate) has_intensity: bool,
    /// Rules by which positions are rounded, so that they are identical for all file formats.
    pub(crate) canonical: Canonical,
    cloud: Option<PointCloud>,
    /// Flag per point, true if the point is on water, where points aren't dropped as isolated in height. Empty if no
    /// point is on water.
    water: Vec<bool>,
    /// Range of the points in each bin; `None` until the points are sorted into bins.
    bins: Option<Bins>,
    /// Number of the block that used the points most recently, counted from 1; 0 before the first.
    used: u64,
}

/// Results of loading a file besides its content: notes for the user, options without effect, and a colouring request.
#[derive(Default)]
pub(crate) struct LoadReport {
    pub(crate) notes: Vec<String>,
    pub(crate) unused: Vec<UnusedOption>,
    /// Request to colour the splats by an attribute, for splat files and meshes.
    pub(crate) color_job: Option<ColorJob>,
}

impl Source {
    /// Loads a file, and stores notes, options without effect and the colouring request in `told`.
    pub(crate) fn load(
        path: &Path,
        options: &LoadOptions,
        told: &mut LoadReport,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let mut loaded = steps::read(path, options)?;
        let comments = match &loaded.content {
            Content::Points(points) => points.comments.as_slice(),
            Content::Splats(cloud) => cloud.data().comments.as_slice(),
            _ => &[],
        };
        let crs = Crs::of_comments(comments);
        let is_named_degrees = comments.iter().any(|comment| comment == IN_DEGREES);
        told.unused = effects::unused(&loaded.content, options);
        let path = path.to_path_buf();
        if let Content::Points(points) = loaded.content {
            told.notes.append(&mut loaded.notes);
            let points = chosen(points, &path, options, &mut told.notes, progress)?;
            let Some(bounds) = points.bounds() else { return Err(empty(&path)) };
            let canonical = Canonical::new(&points, bounds);
            let bounds = canonical.bounds(bounds);
            let density = density(&points, &canonical, bounds);
            let holds = SourceContent::Points(Box::new(Points {
                density,
                canonical,
                water: Vec::new(),
                bytes: bytes(&points),
                has_colors: points.colors.is_some(),
                has_intensity: ExtraColumn::find(&points.extras, "intensity").is_some(),
                cloud: Some(points),
                bins: None,
                used: 0,
            }));
            return Ok(Self { path, holds, bounds, crs, is_named_degrees });
        }
        let (LoadedCloud { cloud, notes, .. }, color_job) = steps::splats_of(loaded, &path, options, progress)?;
        told.notes.extend(notes);
        told.color_job = color_job;
        let Some(bounds) = cloud.bounds() else { return Err(empty(&path)) };
        Ok(Self { path, holds: SourceContent::Splats(Arc::new(cloud)), bounds, crs, is_named_degrees })
    }

    /// Returns the number of points or splats in memory, and a function that returns their positions. `None` if the
    /// points were freed.
    pub(crate) fn positions(&self) -> Option<(usize, PositionOf<'_>)> {
        match &self.holds {
            SourceContent::Points(points) => {
                let cloud = points.cloud.as_ref()?;
                Some((cloud.len(), Box::new(|i| points.canonical.position(cloud, i))))
            }
            SourceContent::Splats(cloud) => Some((cloud.len(), Box::new(|i| cloud.center(i)))),
        }
    }

    /// True if the file's bounds overlap a rectangle: minimum x, minimum y, maximum x, maximum y.
    pub(crate) fn meets(&self, [x0, y0, x1, y1]: [f64; 4]) -> bool {
        let (lo, hi) = self.bounds;
        lo.x <= x1 && hi.x >= x0 && lo.y <= y1 && hi.y >= y0
    }
}

/// Returns the points of a file that the options select. Normals that Surfel added to a COPC file are removed, because
/// a COPC file must give the same surface as its source file.
fn chosen(
    mut points: PointCloud,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<PointCloud, Error> {
    let has_radii = ExtraColumn::find(&points.extras, RADIUS).is_some();
    if has_radii && points.normals.as_ref().is_some_and(are_estimated) {
        points.normals = None;
    }
    steps::chosen_points(points, path, options, notes, progress)
}

/// True if all components of the normals are multiples of 1/127, as Surfel stores estimated normals in COPC files.
fn are_estimated(normals: &Column3) -> bool {
    let is_step = |v: f64| (v * 127.0 - (v * 127.0).round()).abs() < 1e-4;
    (0..normals.len()).all(|i| normals.get(i).to_array().into_iter().all(is_step))
}

fn empty(path: &Path) -> Error {
    let problem = "holds no point and no splat, expected at least one: check that the file is complete".to_owned();
    Error::Unsuitable { path: path.to_path_buf(), problem }
}

impl Points {
    /// Returns the points in memory, in file order until [`Self::prepare`] sorts them into bins; `None` if they were
    /// freed.
    pub(crate) fn as_loaded(&self) -> Option<&PointCloud> {
        self.cloud.as_ref()
    }

    /// Frees the points, and returns their former size in bytes. [`Self::prepare`] loads them again.
    pub(crate) fn free(&mut self) -> usize {
        (self.cloud, self.bins, self.water) = (None, None, Vec::new());
        self.bytes
    }

    pub(crate) fn is_loaded(&self) -> bool {
        self.cloud.is_some()
    }

    pub(crate) fn last_used(&self) -> u64 {
        self.used
    }

    /// Sorts the points into bins, after loading them again if they were freed. Of the extra columns, only `column` is
    /// retained. `time` is the number of the block that needs the points.
    pub(crate) fn prepare(
        &mut self,
        path: &Path,
        options: &LoadOptions,
        layout: &Layout,
        column: Option<&str>,
        time: u64,
    ) -> Result<(), Error> {
        self.used = time;
        let mut cloud = match (self.cloud.take(), &self.bins) {
            (Some(cloud), Some(_)) => {
                self.cloud = Some(cloud);
                return Ok(());
            }
            (Some(cloud), None) => cloud,
            (None, _) => match steps::read(path, options)?.content {
                Content::Points(points) => chosen(points, path, options, &mut Vec::new(), &NoProgress)?,
                _ => return Err(empty(path)),
            },
        };
        let is_water = water(&cloud.extras, cloud.len());
        // Files may spell the name of the column differently.
        let named = column.and_then(|name| ExtraColumn::find(&cloud.extras, name)).map(|extra| extra.name.clone());
        cloud.extras.retain(|extra| Some(&extra.name) == named.as_ref());
        let (cloud, order, bins) = binned(&cloud, &self.canonical, layout);
        self.bytes = bytes(&cloud);
        self.water = is_water.map(|flags| order.iter().map(|i| flags[*i as usize]).collect()).unwrap_or_default();
        (self.cloud, self.bins) = (Some(cloud), Some(bins));
        Ok(())
    }

    /// Appends the points within the rectangle `within` (minimum x, minimum y, maximum x, maximum y) to the points of a
    /// block.
    pub(crate) fn gather(&self, within: [f64; 4], layout: &Layout, into: &mut Gathered) {
        let (Some(cloud), Some(bins)) = (&self.cloud, &self.bins) else { return };
        let [x0, y0, x1, y1] = within;
        let (columns, rows) = (layout.bin(0, x0)..=layout.bin(0, x1), layout.bin(1, y0)..=layout.bin(1, y1));
        for row in rows {
            for (_, range) in bins.range((row, *columns.start())..=(row, *columns.end())) {
                for i in range.clone() {
                    let p = self.canonical.position(cloud, i);
                    if p.x >= x0 && p.x < x1 && p.y >= y0 && p.y < y1 {
                        into.push(cloud, i, p, self.water.get(i).is_some_and(|water| *water));
                    }
                }
            }
        }
    }
}

/// Points of a block and its surroundings, collected from all files.
#[derive(Default)]
pub(crate) struct Gathered {
    positions: Vec<DVec3>,
    normals: Vec<glam::Vec3>,
    has_normals: bool,
    colors: Vec<[f32; 3]>,
    has_colors: bool,
    values: Vec<f64>,
    water: Vec<bool>,
}

impl Gathered {
    fn push(&mut self, cloud: &PointCloud, i: usize, p: DVec3, is_water: bool) {
        self.positions.push(p);
        self.water.push(is_water);
        // Normals that are missing are zero here, and are estimated later.
        self.normals.push(cloud.normals.as_ref().map_or(glam::Vec3::ZERO, |n| n.get(i).as_vec3()));
        self.has_normals |= cloud.normals.is_some();
        self.colors.push(cloud.colors.as_ref().and_then(|c| c.get(i)).copied().unwrap_or([1.0; 3]));
        self.has_colors |= cloud.colors.is_some();
        self.values.push(cloud.extras.first().map_or(f64::NAN, |extra| extra.values.get(i)));
    }

    /// Returns the points as one cloud, in an order that depends only on the points. If the points' mean `spacing` is
    /// given, points that are isolated in height are dropped, except on water. The second result has the positions of
    /// the dropped points. `column` is the name of the extra column of the points' values; `None` drops the values.
    pub(crate) fn finish(self, column: Option<&str>, spacing: Option<f64>) -> (PointCloud, Vec<DVec3>) {
        let mut order: Vec<u32> = (0..self.positions.len() as u32).collect();
        order.par_sort_unstable_by(|a, b| self.compare(*a as usize, *b as usize));
        let mut left_out = Vec::new();
        if let Some(spacing) = spacing {
            let is_lone = lone(&self.positions, spacing);
            let is_out = |i: u32| is_lone[i as usize] && !self.water[i as usize];
            left_out = order.iter().filter(|i| is_out(**i)).map(|i| self.positions[*i as usize]).collect();
            order.retain(|i| !is_out(*i));
        }
        fn sorted<T: Copy>(values: &[T], order: &[u32]) -> Vec<T> {
            order.iter().map(|i| values[*i as usize]).collect()
        }
        let Self { positions, normals, has_normals, colors, has_colors, values, .. } = self;
        let (positions, values) = (sorted(&positions, &order), sorted(&values, &order));
        let normals = has_normals.then(|| Column3::from_f32(sorted(&normals, &order)));
        let colors = has_colors.then(|| sorted(&colors, &order));
        let (origin, positions) = Column3::with_origin(&positions);
        let extras = column.map(|name| ExtraColumn { name: name.into(), values: ExtraValues::F64(values) });
        let extras = extras.into_iter().collect();
        (PointCloud { origin, positions, normals, colors, extras, ..PointCloud::default() }, left_out)
    }
}

impl Gathered {
    /// Compares two points by position, then by colour, normal and value, so that the order doesn't depend on the
    /// files.
    fn compare(&self, a: usize, b: usize) -> Ordering {
        let three =
            |a: [f64; 3], b: [f64; 3]| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])).then(a[2].total_cmp(&b[2]));
        let wide = |v: [f32; 3]| v.map(f64::from);
        three(self.positions[a].to_array(), self.positions[b].to_array())
            .then_with(|| three(wide(self.colors[a]), wide(self.colors[b])))
            .then_with(|| three(wide(self.normals[a].to_array()), wide(self.normals[b].to_array())))
            .then_with(|| self.values[a].total_cmp(&self.values[b]))
    }
}

/// Returns the splats whose centres are within a rectangle (minimum x, minimum y, maximum x, maximum y), or `None` if
/// there are none.
pub(crate) fn splats_within(cloud: &SplatCloud, within: [f64; 4]) -> Result<Option<SplatCloud>, Error> {
    let [x0, y0, x1, y1] = within;
    let inside = |p: DVec3| p.x >= x0 && p.x < x1 && p.y >= y0 && p.y < y1;
    let keep: Vec<bool> = (0..cloud.len()).map(|i| inside(cloud.center(i))).collect();
    splats_kept(cloud, &keep)
}

/// Returns the splats whose flag in `keep` is true, or `None` if no flag is true.
pub(crate) fn splats_kept(cloud: &SplatCloud, keep: &[bool]) -> Result<Option<SplatCloud>, Error> {
    if !keep.contains(&true) {
        return Ok(None);
    }
    let mut data = cloud.data().clone();
    data.retain(keep);
    Ok(Some(SplatCloud::new(data, OnInvalid::Refuse)?.0))
}

fn bytes(points: &PointCloud) -> usize {
    points.positions.bytes()
        + points.normals.as_ref().map_or(0, Column3::bytes)
        + points.colors.as_ref().map_or(0, |c| size_of_val(c.as_slice()))
        + points.alphas.as_ref().map_or(0, |c| size_of_val(c.as_slice()))
        + points.extras.iter().map(|e| e.values.bytes()).sum::<usize>()
}

/// Range of the points in each bin, by the bin's row and column.
type Bins = BTreeMap<(i64, i64), Range<usize>>;

/// Sorts points by their bins, and preserves their order within a bin. Returns the sorted points, their previous
/// indices, and the range of each bin.
fn binned(cloud: &PointCloud, canonical: &Canonical, layout: &Layout) -> (PointCloud, Vec<u32>, Bins) {
    let bin = |i: usize| {
        let p = canonical.position(cloud, i);
        (layout.bin(1, p.y), layout.bin(0, p.x))
    };
    let mut counts: BTreeMap<(i64, i64), usize> = BTreeMap::new();
    let mut last = None;
    // Successive points are mostly in the same bin, so that runs are counted.
    let mut run = 0;
    for key in (0..cloud.len()).map(bin) {
        if last != Some(key) {
            if let Some(last) = last {
                *counts.entry(last).or_default() += run;
            }
            (last, run) = (Some(key), 0);
        }
        run += 1;
    }
    if let Some(last) = last {
        *counts.entry(last).or_default() += run;
    }
    let mut start = 0;
    let mut bins = BTreeMap::new();
    for (key, count) in counts {
        bins.insert(key, start..start);
        start += count;
    }
    let mut order = vec![0_u32; cloud.len()];
    for i in 0..cloud.len() {
        if let Some(range) = bins.get_mut(&bin(i)) {
            order[range.end] = i as u32;
            range.end += 1;
        }
    }
    let pick = |values: &ExtraValues| ExtraValues::F64(order.iter().map(|i| values.get(*i as usize)).collect());
    let sorted = PointCloud {
        origin: cloud.origin,
        positions: cloud.positions.select(&order),
        normals: cloud.normals.as_ref().map(|n| n.select(&order)),
        colors: cloud.colors.as_ref().map(|c| order.iter().map(|i| c[*i as usize]).collect()),
        extras: cloud.extras.iter().map(|e| ExtraColumn { name: e.name.clone(), values: pick(&e.values) }).collect(),
        ..PointCloud::default()
    };
    (sorted, order, bins)
}

/// Estimates the number of points per unit of the covered area. The area is that of the cells of a square grid that
/// contain sampled points. Infinite if all points have the same x and y. The result doesn't depend on the order of the
/// points.
fn density(points: &PointCloud, canonical: &Canonical, (lo, hi): (DVec3, DVec3)) -> f64 {
    let share = if points.len() <= SAMPLE { u64::MAX } else { u64::MAX / points.len() as u64 * SAMPLE as u64 };
    let plane = |i: usize| canonical.position(points, i).truncate();
    let is_taken = |p: &DVec2| mixed(p.x.to_bits() ^ mixed(p.y.to_bits())) <= share;
    let sample: Vec<DVec2> = (0..points.len()).into_par_iter().with_min_len(4096).map(plane).filter(is_taken).collect();
    let count = sample.len();
    let extent = hi - lo;
    let longest = extent.x.max(extent.y);
    let mut side = (extent.x * extent.y * IN_A_CELL / count as f64).sqrt().max(longest * IN_A_CELL / count as f64);
    if count == 0 || side <= 0.0 {
        return f64::INFINITY;
    }
    loop {
        let cell = |p: &DVec2| (((p.x - lo.x) / side) as i64, ((p.y - lo.y) / side) as i64);
        let cells = sample.iter().map(cell).collect::<HashSet<_>>().len();
        // If there are distant strays, the first cells are too large and are refined.
        if cells as f64 * IN_A_CELL * 2.0 >= count as f64 || cells > count / 4 || side < longest * 1e-9 {
            return points.len() as f64 / (cells as f64 * side * side);
        }
        side *= 0.5;
    }
}

/// Returns a hash of 64 bits (the finaliser of SplitMix64), by which points are sampled independently of their order.
fn mixed(bits: u64) -> u64 {
    let bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn density_is_that_of_the_covered_area() {
        // Hashed twice, since simple multiples lie on few lines.
        let random = |i: u64| {
            let mixed = (i.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 29 ^ i).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            ((mixed >> 32 ^ mixed).wrapping_mul(0x94D0_49BB_1331_11EB) >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut positions: Vec<DVec3> =
            (0..40_000).map(|i| DVec3::new(100.0 * random(2 * i), 50.0 * random(7 * i + 3), 0.0)).collect();
        let of = |positions: &[DVec3]| {
            let (origin, positions) = Column3::with_origin(positions);
            let cloud = PointCloud { origin, positions, ..PointCloud::default() };
            density(&cloud, &Canonical::new(&cloud, cloud.bounds().unwrap()), cloud.bounds().unwrap())
        };
        assert!((of(&positions) - 8.0).abs() < 1.5, "{}", of(&positions));
        // A distant stray changes little.
        positions.push(DVec3::new(1e6, 1e6, 0.0));
        assert!((of(&positions) - 8.0).abs() < 4.0, "{}", of(&positions));
        assert_eq!(of(&[DVec3::ONE; 5]), f64::INFINITY);
    }
}
