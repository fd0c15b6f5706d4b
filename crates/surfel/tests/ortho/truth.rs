//! Exact surfaces, scans of them, and errors of surface models of these scans: Surfel's, means, and a triangulation.

use std::fmt::Write as _;
use std::fs::File;
use std::path::{Path, PathBuf};
use surfel_backend::{Backend, BackendOptions};
use surfel_ortho::{Ortho, OrthoFiles, OrthoOptions, OrthoStats};
use surfel_sample::NoProgress;
use tiff::decoder::{Decoder, DecodingResult};

pub(crate) const NO_DATA: f32 = -9999.0;
/// Side of the square that contains the points, in metres.
pub(crate) const SIDE_M: f64 = 30.0;
/// Standard deviation of a point's height, in metres.
pub(crate) const NOISE_M: f64 = 0.03;
/// Side of a pixel, in metres.
pub(crate) const GSD: f64 = 0.2;
/// Width in metres of the square's border that is ignored: all methods lack the points beyond it.
const BORDER_M: f64 = 2.0;

/// A temporary folder, removed when dropped.
pub(crate) struct Folder(pub(crate) PathBuf);

impl Folder {
    pub(crate) fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("surfel-ortho-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// Writes points as PLY with f64 positions and one colour.
    pub(crate) fn write(&self, name: &str, points: &[[f64; 3]], comment: &str) -> PathBuf {
        let mut text = format!("ply\nformat ascii 1.0\n{comment}element vertex {}\n", points.len());
        text += "property double x\nproperty double y\nproperty double z\n";
        text += "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
        for [x, y, z] in points {
            writeln!(text, "{x} {y} {z} 200 100 50").unwrap();
        }
        let path = self.0.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    pub(crate) fn files(&self, name: &str) -> OrthoFiles {
        let file = |what: &str| self.0.join(format!("{name}-{what}.tif"));
        OrthoFiles { color: Some(file("rgb")), dsm: Some(file("dsm")), normals: Some(file("n")), overwrite: true }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

pub(crate) fn draw(input: &Path, options: &OrthoOptions, files: &OrthoFiles) -> (Ortho, OrthoStats) {
    let mut ortho = Ortho::open(&[input], options, &NoProgress).unwrap();
    let mut backend = Backend::by_name("cpu", &BackendOptions::default()).unwrap();
    let stats = ortho.draw(files, "surfel test", &mut backend, &NoProgress).unwrap();
    (ortho, stats)
}

pub(crate) fn decoder(path: &Path) -> Decoder<File> {
    Decoder::new(File::open(path).unwrap()).unwrap()
}

pub(crate) fn numbers(path: &Path) -> (usize, Vec<f32>) {
    let mut decoder = decoder(path);
    let width = decoder.dimensions().unwrap().0 as usize;
    let DecodingResult::F32(numbers) = decoder.read_image().unwrap() else { panic!("not f32") };
    (width, numbers)
}

/// Draws a surface model of points in the square. Returns its height as a function of x and y; `None` where it has
/// none.
pub(crate) fn heights_of(folder: &Folder, points: &[[f64; 3]]) -> impl Fn(f64, f64) -> Option<f64> {
    let files = folder.files("heights");
    let options = OrthoOptions::new(GSD).with_bounds(Some([0.0, 0.0, SIDE_M, SIDE_M]));
    draw(&folder.write("points.ply", points, ""), &options, &files);
    let (width, heights) = numbers(files.dsm.as_ref().unwrap());
    move |x: f64, y: f64| {
        let row = heights.len() / width - 1 - (y / GSD) as usize;
        Some(f64::from(heights[row * width + (x / GSD) as usize])).filter(|z| *z > f64::from(NO_DATA))
    }
}

/// Returns a random number from 0 to 1 for each i (SplitMix64).
pub(crate) fn random(i: u64) -> f64 {
    let mut z = i.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Returns an approximately normal number: the sum of twelve uniform ones minus 6.
fn normal_from(first: u64) -> f64 {
    (0..12).map(|k| random(first + k)).sum::<f64>() - 6.0
}

pub(crate) fn normal(i: u64) -> f64 {
    normal_from(12 * i)
}

/// Exact surface: returns the height at x and y, and true if the place belongs to the upper of two parts that meet at
/// an edge.
pub(crate) type Exact = fn(f64, f64) -> (f64, bool);

/// Returns terrain with a rotated gable roof.
pub(crate) fn roof(x: f64, y: f64) -> (f64, bool) {
    let terrain = 100.0 + 0.03 * x + 0.6 * (x / 7.0).sin() * (y / 5.0).cos();
    let (sin, cos) = 0.4_f64.sin_cos();
    let (u, v) = ((x - 14.0) * cos + (y - 15.0) * sin, (y - 15.0) * cos - (x - 14.0) * sin);
    let roof = u.abs() <= 5.0 && v.abs() <= 7.0;
    (if roof { 104.0 + 2.5 * (1.0 - u.abs() / 5.0) } else { terrain }, roof)
}

/// Returns a deck with the roof's outline, 6 m above flat ground.
pub(crate) fn deck(x: f64, y: f64) -> (f64, bool) {
    let is_deck = roof(x, y).1;
    (if is_deck { 6.0 } else { 0.0 }, is_deck)
}

/// Returns a canopy 8 m above flat ground, with holes and lanes about 3 m wide. The exact model is the canopy where it
/// exists.
pub(crate) fn canopy(x: f64, y: f64) -> (f64, bool) {
    let is_leaf = (1.3 * x + 0.4 * y).sin() * (1.1 * y - 0.3 * x).cos() > -0.1;
    (if is_leaf { 8.0 } else { 0.0 }, is_leaf)
}

/// Sampling pattern of a scan.
#[derive(Clone, Copy)]
pub(crate) struct Scan {
    /// Points per square metre.
    pub(crate) density: f64,
    /// True for random positions; otherwise points are in rows, each displaced by a fifth of the spacing (standard
    /// deviation).
    pub(crate) anywhere: bool,
    /// Random seed; scans of different seeds are independent.
    pub(crate) seed: u64,
}

impl Scan {
    /// Returns points of a surface whose heights have noise of `stray_m` (standard deviation).
    pub(crate) fn points(self, surface: impl Fn(f64, f64) -> f64, stray_m: f64) -> Vec<[f64; 3]> {
        let along = (SIDE_M * self.density.sqrt()).round() as usize;
        let spacing = SIDE_M / along as f64;
        (0..along * along)
            .map(|i| {
                let k = 3 * i as u64 + (self.seed << 32);
                let [column, row] = [i % along, i / along].map(|i| i as f64 + 0.5);
                let [x, y] = match self.anywhere {
                    true => [random(12 * k), random(12 * k + 12)].map(|v| v * SIDE_M),
                    false => [(column + 0.2 * normal(k)) * spacing, (row + 0.2 * normal(k + 1)) * spacing],
                };
                [x, y, surface(x, y) + stray_m * normal(k + 2)]
            })
            .collect()
    }

    /// Returns two sets of points: first, points of a complete ground at height 0 together with points of equal density
    /// on the noisy surface above it; second, those of them that are visible from above.
    pub(crate) fn two_surfaces(self, above: Exact, stray_m: f64) -> [Vec<[f64; 3]>; 2] {
        let ground = self.points(|_, _| 0.0, NOISE_M);
        let is_above = |x: f64, y: f64| above(x, y).1;
        let upper: Vec<[f64; 3]> = (0_u64..)
            .zip(&ground)
            .map(|(i, p)| (1_000_000 + 12 * i + (self.seed << 40), [SIDE_M - p[0], SIDE_M - p[1]]))
            .filter(|(_, [x, y])| is_above(*x, *y))
            .map(|(i, [x, y])| [x, y, above(x, y).0 + stray_m * normal_from(i)])
            .collect();
        let open = ground.iter().filter(|p| !is_above(p[0], p[1]));
        let first = upper.iter().chain(open).copied().collect();
        [[upper.clone(), ground.clone()].concat(), first]
    }
}

/// Errors of a surface model, in metres except the fraction `gaps`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Errors {
    /// Root mean square error over all pixels with a height.
    pub(crate) rmse: f64,
    /// Root mean square error over the pixels with a height that are at least a metre from the edge.
    pub(crate) flat_rmse: f64,
    /// Fraction of pixels without a height.
    pub(crate) gaps: f64,
    /// Mean distance between the exact edge and the model's: the area of pixels on the wrong side over the edge's
    /// length.
    pub(crate) edge_m: f64,
}

/// Computes errors against a surface whose parts above and below `middle` meet at an edge.
pub(crate) fn errors_of(exact: Exact, middle: f64, height: impl Fn(f64, f64) -> Option<f64>) -> Errors {
    let pixels = (SIDE_M / GSD) as usize;
    let (mut all, mut flat, mut gaps, mut wrong) = ((0.0, 0.0), (0.0, 0.0), 0.0, 0.0);
    let (mut total, mut length) = (0.0, 0.0);
    for i in 0..pixels * pixels {
        let (x, y) = (((i % pixels) as f64 + 0.5) * GSD, ((i / pixels) as f64 + 0.5) * GSD);
        if [x, y].iter().any(|v| *v < BORDER_M || *v > SIDE_M - BORDER_M) {
            continue;
        }
        total += 1.0;
        let (truth, above) = exact(x, y);
        // Crofton's formula: an edge of length L crosses 4/π·L/GSD pixel sides on average over its directions.
        let ahead = [(GSD, 0.0), (0.0, GSD)].map(|(dx, dy)| exact(x + dx, y + dy).1 != above);
        length += ahead.iter().filter(|crosses| **crosses).count() as f64 * GSD * std::f64::consts::FRAC_PI_4;
        let Some(found) = height(x, y) else {
            gaps += 1.0;
            continue;
        };
        all = (all.0 + (found - truth).powi(2), all.1 + 1.0);
        let mut around = (0..16).map(|k| f64::from(k) * std::f64::consts::TAU / 16.0);
        if around.any(|a| exact(x + a.cos(), y + a.sin()).1 != above) {
            wrong += f64::from(u8::from((found > middle) != above));
        } else {
            flat = (flat.0 + (found - truth).powi(2), flat.1 + 1.0);
        }
    }
    let rms = |(sum, n): (f64, f64)| f64::sqrt(sum / n);
    Errors { rmse: rms(all), flat_rmse: rms(flat), gaps: gaps / total, edge_m: wrong * GSD * GSD / length }
}

/// Points of the square, sorted into square cells with sides of `CELL_M` metres. A cell and its neighbours contain all
/// points from which the methods that Surfel is compared with compute a height.
pub(crate) struct Cells {
    all: Vec<Vec<[f64; 3]>>,
    side: usize,
}

const CELL_M: f64 = 2.0;

impl Cells {
    pub(crate) fn new(points: &[[f64; 3]]) -> Self {
        let side = (SIDE_M / CELL_M).ceil() as usize;
        let mut cells = Self { all: vec![Vec::new(); side * side], side };
        for p in points {
            let [x, y] = [p[0], p[1]].map(|v| cells.index(v));
            cells.all[y * side + x].push(*p);
        }
        cells
    }

    fn index(&self, v: f64) -> usize {
        ((v / CELL_M).max(0.0) as usize).min(self.side - 1)
    }

    /// Returns the points within a radius of at most `CELL_M`, relative to (x, y).
    fn within(&self, radius: f64, x: f64, y: f64) -> impl Iterator<Item = [f64; 3]> {
        let range = move |v: f64| self.index(v - radius)..=self.index(v + radius);
        let cells = range(y).flat_map(move |row| range(x).map(move |column| &self.all[row * self.side + column]));
        let from_here = cells.flatten().map(move |p| [p[0] - x, p[1] - y, p[2]]);
        from_here.filter(move |p| p[0] * p[0] + p[1] * p[1] < radius * radius)
    }

    /// Returns the mean of the points within a radius of the pixel's centre, like PDAL's `writers.gdal` with
    /// `output_type=mean`.
    pub(crate) fn mean(&self, radius: f64, x: f64, y: f64) -> Option<f64> {
        let (sum, count) = self.within(radius, x, y).fold((0.0, 0.0), |(sum, count), p| (sum + p[2], count + 1.0));
        (count > 0.0).then(|| sum / count)
    }

    /// Returns the largest height within a radius, like PDAL with `output_type=max`.
    pub(crate) fn largest(&self, radius: f64, x: f64, y: f64) -> Option<f64> {
        self.within(radius, x, y).map(|p| p[2]).reduce(f64::max)
    }

    /// Interpolates in the Delaunay triangulation. If every point is lifted by its squared distance, the place's
    /// Delaunay triangle is the lowest of all triangles around it. The search starts from a distant triangle and
    /// exchanges its corners for lower points. `None` if a corner of the triangle isn't within `CELL_M` metres.
    pub(crate) fn triangulated(&self, x: f64, y: f64) -> Option<f64> {
        const FAR: f64 = 1e4;
        let near: Vec<[f64; 3]> = self.within(CELL_M, x, y).collect();
        let mut corners = [[-FAR, -FAR, 0.0], [FAR, -FAR, 0.0], [0.0, FAR, 0.0]];
        let cross = |a: [f64; 3], b: [f64; 3]| a[0] * b[1] - a[1] * b[0];
        // Barycentric coordinates of the place, which is the origin.
        let shares = |[a, b, c]: [[f64; 3]; 3]| {
            let parts = [cross(b, c), cross(c, a), cross(a, b)];
            parts.map(|part| part / parts.iter().sum::<f64>())
        };
        let lifted = |p: [f64; 3]| p[0] * p[0] + p[1] * p[1];
        loop {
            let [a, b, c] = corners;
            // Height above the plane through the lifted corners.
            let [ab, ac] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1], lifted(p) - lifted(a)]);
            let area = cross(ab, ac);
            let slopes = [(ab[2] * ac[1] - ac[2] * ab[1]) / area, (ab[0] * ac[2] - ac[0] * ab[2]) / area];
            let over = |p: &[f64; 3]| lifted(*p) - lifted(a) - slopes[0] * (p[0] - a[0]) - slopes[1] * (p[1] - a[1]);
            let lowest = near.iter().copied().min_by(|p, q| over(p).total_cmp(&over(q)))?;
            let around = |k: usize| {
                let mut corners = corners;
                corners[k] = lowest;
                Some(corners).filter(|corners| shares(*corners).iter().all(|share| *share >= 0.0))
            };
            match (0..3).find_map(around).filter(|_| over(&lowest) < -1e-9) {
                Some(lower) => corners = lower,
                None => break,
            }
        }
        let is_whole = corners.iter().all(|p| p[0].hypot(p[1]) < CELL_M);
        is_whole.then(|| shares(corners).iter().zip(corners).map(|(share, p)| share * p[2]).sum())
    }
}

/// Returns the errors of Surfel's model, of means with the best radius, and of a triangulation. The triangulation gets
/// only the points visible from above (`first`); the others get all points.
pub(crate) fn compared(folder: &Folder, exact: Exact, middle: f64, [all, first]: [&[[f64; 3]]; 2]) -> [Errors; 3] {
    let ours = errors_of(exact, middle, heights_of(folder, all));
    let (of_all, of_first) = (Cells::new(all), Cells::new(first));
    let spacing = (SIDE_M * SIDE_M / first.len() as f64).sqrt();
    let means = [0.5, 0.7, 1.0, 1.4, 2.0].map(|r| errors_of(exact, middle, |x, y| of_all.mean(r * spacing, x, y)));
    // Means within small radii leave most pixels empty, including the difficult ones.
    let whole = means.into_iter().filter(|errors| errors.gaps < 0.01);
    let best = whole.min_by(|a, b| a.rmse.total_cmp(&b.rmse)).unwrap();
    [ours, best, errors_of(exact, middle, |x, y| of_first.triangulated(x, y))]
}
