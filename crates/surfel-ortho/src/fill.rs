//! Filling of gaps in an image by interpolation.
//!
//! An empty pixel is filled unless a circle of the given radius that covers the pixel contains no pixel with data. This
//! is morphological closing by a disk, with exact distances (Felzenszwalb and Huttenlocher 2012). Wider gaps remain,
//! and the outer border doesn't move.
//!
//! For each filled pixel, the nearest data in 32 directions are used. Its height is that of the best-fitting plane
//! through their heights, weighted by the inverse squared distance and clamped to their range. Colours and normals are
//! means weighted by the inverse distance.
//!
//! Pixels are stored block by block in an unnamed file, because a gap may extend over several blocks. Filling doesn't
//! change pixels with data.

use super::block::{BlockPixels, StoredPlanes};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Largest radius, in pixels, of the circle by which the gaps to fill are limited.
pub(crate) const MAX_PX: u32 = 512;
/// Number of directions from an empty pixel in which the nearest data are searched.
const DIRECTIONS: usize = 32;
/// Weight that pulls the fitted plane toward a horizontal one, relative to the sum of the data's weighted squared
/// distances. Without it, data on one line wouldn't determine the slope across the line.
const LEVEL: f64 = 2e-3;

/// Values of a rectangle of an image's pixels, one plane per kind of value, in rows from the top.
#[derive(Clone, Default)]
pub(crate) struct Planes {
    pub(crate) width: usize,
    /// Height z of each pixel; NaN at empty pixels.
    pub(crate) height: Vec<f32>,
    /// Colour of each pixel as premultiplied linear RGBA. Empty if colours aren't needed.
    pub(crate) color: Vec<[f32; 4]>,
    /// Unit normal of each pixel. Empty if normals aren't needed.
    pub(crate) normal: Vec<[f32; 3]>,
    /// Flag per pixel, true if the pixel was filled by interpolation. Empty if gaps weren't filled.
    pub(crate) filled: Vec<bool>,
}

impl Planes {
    /// Copies a part of a drawn block: `width` columns from `left` on, and the given rows.
    pub(crate) fn cut(pixels: &BlockPixels, left: usize, width: usize, rows: impl Iterator<Item = usize>) -> Self {
        fn of<T: Copy>(plane: &[T], starts: &[usize], width: usize) -> Vec<T> {
            starts.iter().flat_map(|at| plane.get(*at..at + width).unwrap_or_default()).copied().collect()
        }
        let starts: Vec<usize> = rows.map(|row| row * pixels.side + left).collect();
        Self {
            width,
            height: of(&pixels.height, &starts, width),
            color: of(&pixels.color, &starts, width),
            normal: of(&pixels.normal, &starts, width),
            filled: Vec::new(),
        }
    }

    fn empty(width: usize, height: usize, has: StoredPlanes) -> Self {
        let count = width * height;
        Self {
            width,
            height: vec![f32::NAN; count],
            color: if has.color { vec![[0.0; 4]; count] } else { Vec::new() },
            normal: if has.normal { vec![[f32::NAN; 3]; count] } else { Vec::new() },
            filled: Vec::new(),
        }
    }
}

/// Temporary file that stores drawn blocks until gaps are filled.
pub(crate) struct BlockStore {
    file: BufWriter<File>,
    bytes: u64,
    has: StoredPlanes,
    /// Offset of each block in the file in bytes, by the block's row and column.
    places: BTreeMap<(i64, i64), u64>,
    block_px: usize,
}

impl BlockStore {
    /// Creates an empty store, in the folder of the image file `path`.
    pub(crate) fn beside(path: &Path, block_px: usize, has: StoredPlanes) -> io::Result<Self> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let file = BufWriter::with_capacity(1 << 20, surfel_io::atomic::unnamed_in(folder)?);
        Ok(Self { file, bytes: 0, has, places: BTreeMap::new(), block_px })
    }

    /// Returns which kinds of values are stored in addition to heights.
    pub(crate) fn has(&self) -> StoredPlanes {
        self.has
    }

    /// Stores the pixels of the block at this column and row, without its margin.
    pub(crate) fn put(&mut self, [column, row]: [i64; 2], planes: &Planes) -> io::Result<()> {
        self.places.insert((row, column), self.bytes);
        for i in 0..planes.height.len() {
            let color = planes.color.get(i).into_iter().flatten();
            let normal = planes.normal.get(i).into_iter().flatten();
            for number in std::iter::once(&planes.height[i]).chain(color).chain(normal) {
                self.file.write_all(&number.to_le_bytes())?;
            }
        }
        self.bytes += (planes.height.len() * self.has.numbers() * 4) as u64;
        Ok(())
    }

    /// Reads a rectangle of pixels: `width` columns from `west` to the east, and `height` rows from `north` to the
    /// south. Columns and rows are counted from the grid's origin, rows to the north. Pixels of blocks that weren't
    /// stored are empty.
    pub(crate) fn get(&mut self, [west, north]: [i64; 2], width: usize, height: usize) -> io::Result<Planes> {
        self.file.flush()?;
        let (side, has) = (self.block_px as i64, self.has);
        let mut planes = Planes::empty(width, height, has);
        let numbers = has.numbers();
        let south = north - height as i64 + 1;
        let mut run = Vec::new();
        let (columns, rows) = (
            west.div_euclid(side)..=(west + width as i64 - 1).div_euclid(side),
            south.div_euclid(side)..=north.div_euclid(side),
        );
        for row in rows {
            for (&(_, column), &place) in self.places.range((row, *columns.start())..=(row, *columns.end())) {
                let from = (column * side).max(west);
                let count = ((column + 1) * side).min(west + width as i64) - from;
                for y in (row * side).max(south)..((row + 1) * side).min(north + 1) {
                    let in_block = ((row + 1) * side - 1 - y) * side + from - column * side;
                    run.resize(count as usize * numbers * 4, 0);
                    let file = self.file.get_mut();
                    file.seek(SeekFrom::Start(place + in_block as u64 * numbers as u64 * 4))?;
                    file.read_exact(&mut run)?;
                    let first = (north - y) as usize * width + (from - west) as usize;
                    for (i, pixel) in run.chunks_exact(numbers * 4).enumerate() {
                        let number = |k: usize| f32::from_le_bytes([0, 1, 2, 3].map(|b| pixel[4 * k + b]));
                        planes.height[first + i] = f32::from_le_bytes([0, 1, 2, 3].map(|b| pixel[b]));
                        if has.color {
                            planes.color[first + i] = [1, 2, 3, 4].map(number);
                        }
                        if has.normal {
                            let at = numbers - 3;
                            planes.normal[first + i] = [at, at + 1, at + 2].map(number);
                        }
                    }
                }
            }
        }
        self.file.seek(SeekFrom::Start(self.bytes))?;
        Ok(planes)
    }
}

/// Returns the width, in pixels, of the margin around a window on which the values of the window's filled pixels
/// depend.
pub(crate) fn margin_px(radius_px: f64) -> u32 {
    2 * radius_px.ceil() as u32 + 2
}

/// Fills the gaps into which no circle with a radius of `radius_px` pixels fits. Returns the pixels without the margin,
/// `margin` pixels on each side.
pub(crate) fn close(mut planes: Planes, radius_px: f64, margin: usize) -> Planes {
    let width = planes.width;
    let height = planes.height.len() / width.max(1);
    let inner = |i: usize| {
        let (x, y) = (i % width, i / width);
        x >= margin && x + margin < width && y >= margin && y + margin < height
    };
    let is_data: Vec<bool> = planes.height.iter().map(|z| !z.is_nan()).collect();
    let mut filled = vec![false; is_data.len()];
    if is_data.contains(&true) && (0..is_data.len()).any(|i| !is_data[i] && inner(i)) {
        let far = radius_px * radius_px;
        let near: Vec<bool> = distances(&is_data, width).into_iter().map(|d| d > far).collect();
        let from_open = distances(&near, width);
        let gaps: Vec<usize> =
            (0..is_data.len()).filter(|i| !is_data[*i] && from_open[*i] > far && inner(*i)).collect();
        let found: Vec<_> =
            gaps.par_iter().map(|i| interpolated(&planes, &is_data, *i, 2.0 * radius_px.ceil() + 1.0)).collect();
        for (i, value) in gaps.into_iter().zip(found) {
            let Some((z, color, normal)) = value else { continue };
            planes.height[i] = z;
            filled[i] = true;
            planes.color.get_mut(i).into_iter().for_each(|c| *c = color);
            planes.normal.get_mut(i).into_iter().for_each(|n| *n = normal);
        }
    }
    let rows = margin..height.saturating_sub(margin);
    fn cut<T: Copy>(plane: &[T], rows: std::ops::Range<usize>, width: usize, margin: usize) -> Vec<T> {
        if plane.is_empty() {
            return Vec::new();
        }
        rows.flat_map(|row| &plane[row * width + margin..(row + 1) * width - margin]).copied().collect()
    }
    Planes {
        width: width - 2 * margin,
        height: cut(&planes.height, rows.clone(), width, margin),
        color: cut(&planes.color, rows.clone(), width, margin),
        normal: cut(&planes.normal, rows.clone(), width, margin),
        filled: cut(&filled, rows, width, margin),
    }
}

/// Interpolates the empty pixel with index `at` from the nearest data in all directions, at most `reach` pixels away.
/// Returns height, colour and normal; `None` if there are no data.
fn interpolated(planes: &Planes, is_data: &[bool], at: usize, reach: f64) -> Option<(f32, [f32; 4], [f32; 3])> {
    let width = planes.width;
    let height = is_data.len() / width;
    let (x, y) = ((at % width) as f64, (at / width) as f64);
    // Σw, Σwx, Σwy, Σwx², Σwxy, Σwy²; Σwz, Σwzx, Σwzy, with the offset (x, y), distance d, height z and weight w = 1/d²
    // of the data.
    let (mut sums, mut color, mut normal, mut total) = ([0.0_f64; 9], [0.0_f64; 4], [0.0_f64; 3], 0.0);
    let (mut least, mut largest, mut spread) = (f32::INFINITY, f32::NEG_INFINITY, 0.0);
    for k in 0..DIRECTIONS {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / DIRECTIONS as f64).sin_cos();
        let mut step = 1.0;
        let hit = loop {
            if step > reach {
                break None;
            }
            let (px, py) = ((x + step * cos).round(), (y + step * sin).round());
            if px < 0.0 || py < 0.0 || px >= width as f64 || py >= height as f64 {
                break None;
            }
            let i = py as usize * width + px as usize;
            if is_data[i] {
                break Some((i, px - x, py - y));
            }
            step += 1.0;
        };
        let Some((i, dx, dy)) = hit else { continue };
        let (z, squared) = (planes.height[i], dx * dx + dy * dy);
        let w = 1.0 / squared;
        let value = f64::from(z);
        let terms = [1.0, dx, dy, dx * dx, dx * dy, dy * dy, value, value * dx, value * dy];
        sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += w * term);
        spread += w * squared;
        (least, largest) = (least.min(z), largest.max(z));
        let w = w.sqrt();
        total += w;
        if let Some(c) = planes.color.get(i) {
            (0..4).for_each(|k| color[k] += w * f64::from(c[k]));
        }
        if let Some(n) = planes.normal.get(i) {
            (0..3).for_each(|k| normal[k] += w * f64::from(n[k]));
        }
    }
    if total == 0.0 {
        return None;
    }
    let [m0, mx, my, mxx, mxy, myy, v0, vx, vy] = sums;
    let (mxx, myy) = (mxx + LEVEL * spread, myy + LEVEL * spread);
    // This is the value of the best-fitting plane at this pixel, by cofactors.
    let [c00, c01, c02] = [mxx * myy - mxy * mxy, mxy * my - mx * myy, mx * mxy - mxx * my];
    let plane = (c00 * v0 + c01 * vx + c02 * vy) / (m0 * c00 + mx * c01 + my * c02);
    let z = if plane.is_finite() { plane } else { v0 / m0 };
    let length = normal.iter().map(|v| v * v).sum::<f64>().sqrt();
    let normal = if length > 0.0 { normal.map(|v| (v / length) as f32) } else { [0.0, 0.0, 1.0] };
    Some(((z as f32).clamp(least, largest), color.map(|c| (c / total) as f32), normal))
}

/// Returns the squared distance of each pixel to the nearest pixel whose flag is set; infinite if there is none.
fn distances(is_set: &[bool], width: usize) -> Vec<f64> {
    let height = is_set.len() / width;
    // Distances are first computed along columns, and then along rows by lower envelopes of parabolas.
    let mut vertical = vec![f64::INFINITY; is_set.len()];
    for rows in [(0..height).collect::<Vec<_>>(), (0..height).rev().collect()] {
        let mut last = vec![f64::INFINITY; width];
        for y in rows {
            for x in 0..width {
                last[x] = if is_set[y * width + x] { 0.0 } else { last[x] + 1.0 };
                let i = y * width + x;
                vertical[i] = vertical[i].min(last[x]);
            }
        }
    }
    let mut all = vec![0.0; is_set.len()];
    all.par_chunks_mut(width).zip(vertical.par_chunks(width)).for_each(|(out, column)| {
        let f: Vec<f64> = column.iter().map(|d| d * d).collect();
        let (mut apexes, mut starts): (Vec<usize>, Vec<f64>) = (Vec::new(), Vec::new());
        for q in (0..width).filter(|q| f[*q].is_finite()) {
            loop {
                let Some(&p) = apexes.last() else {
                    starts.push(f64::NEG_INFINITY);
                    break;
                };
                let (a, b) = (p as f64, q as f64);
                let meet = (f[q] + b * b - f[p] - a * a) / (2.0 * (b - a));
                if meet > starts[starts.len() - 1] {
                    starts.push(meet);
                    break;
                }
                apexes.pop();
                starts.pop();
            }
            apexes.push(q);
        }
        let mut k = 0;
        for (x, out) in out.iter_mut().enumerate() {
            let Some(&first) = apexes.first() else {
                *out = f64::INFINITY;
                continue;
            };
            while k + 1 < starts.len() && starts[k + 1] < x as f64 {
                k += 1;
            }
            let apex = apexes.get(k).copied().unwrap_or(first);
            *out = (x as f64 - apex as f64).powi(2) + f[apex];
        }
    });
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_the_nearest() {
        let width = 37;
        for seed in 0..6_u64 {
            let is_set: Vec<bool> =
                (0..37 * 23).map(|i| (i as u64 * 2_654_435_761 + seed * 97) % 1009 < seed * 3).collect();
            let found = distances(&is_set, width);
            for (i, found) in found.into_iter().enumerate() {
                let squared = |j: usize| {
                    let (dx, dy) = ((i % width) as f64 - (j % width) as f64, (i / width) as f64 - (j / width) as f64);
                    dx * dx + dy * dy
                };
                let exact = (0..is_set.len()).filter(|j| is_set[*j]).map(squared).fold(f64::INFINITY, f64::min);
                assert_eq!(found, exact, "{seed} {i}");
            }
        }
    }

    /// Returns a plane with a disk-shaped hole, a bay at the border, and no data outside a square.
    fn scene(radius: f64) -> Planes {
        let (width, middle) = (120, 59.5);
        let is_data = |x: f64, y: f64| {
            let hole = (x - middle).hypot(y - middle) < radius;
            (20.0..100.0).contains(&x) && (20.0..100.0).contains(&y) && !hole
        };
        let of = |i: usize| ((i % width) as f64, (i / width) as f64);
        let height = (0..width * width)
            .map(|i| if is_data(of(i).0, of(i).1) { (3.0 * of(i).0 - of(i).1) as f32 } else { f32::NAN });
        let height: Vec<f32> = height.collect();
        let color = height.iter().map(|z| if z.is_nan() { [0.0; 4] } else { [0.5, 0.25, 0.125, 1.0] }).collect();
        Planes { width, height, color, ..Planes::default() }
    }

    #[test]
    fn gaps_are_planes_where_a_circle_does_not_fit_and_stay_where_it_does() {
        for (radius, of_circle, closes) in [(8.0, 9.0, true), (8.0, 7.0, false), (3.0, 12.0, true)] {
            let before = scene(radius);
            let after = close(before.clone(), of_circle, 0);
            let mut count = 0;
            for i in 0..before.height.len() {
                let (x, y) = ((i % 120) as f64, (i / 120) as f64);
                let is_hole = (x - 59.5).hypot(y - 59.5) < radius;
                assert!(before.height[i].is_nan() || before.height[i] == after.height[i] && !after.filled[i]);
                // Nothing extends beyond the border.
                assert!(is_hole || before.height[i].is_nan() == after.height[i].is_nan(), "{x} {y}");
                if is_hole && closes {
                    let exact = (3.0 * x - y) as f32;
                    assert!(after.filled[i] && (after.height[i] - exact).abs() < 0.1, "{x} {y} {}", after.height[i]);
                    assert!((after.color[i][0] - 0.5).abs() < 1e-6 && (after.color[i][3] - 1.0).abs() < 1e-6);
                    count += 1;
                } else if is_hole && (x - 59.5).hypot(y - 59.5) < 1.0 {
                    assert!(!after.filled[i]);
                }
            }
            assert!(!closes || count as f64 > 3.0 * radius * radius);
        }
    }

    #[test]
    fn parts_are_closed_as_the_whole_is() {
        let (whole, radius) = (scene(6.0), 7.5);
        let margin = margin_px(radius) as usize;
        let all = close(whole.clone(), radius, 0);
        // A window of 20 × 20 pixels from (50, 52) on, with its margin.
        let (left, top, side) = (50 - margin, 52 - margin, 20 + 2 * margin);
        let rows = (top..top + side).flat_map(|y| y * 120 + left..y * 120 + left + side);
        let height: Vec<f32> = rows.map(|i| whole.height[i]).collect();
        let part = close(Planes { width: side, height, ..Planes::default() }, radius, margin);
        for i in 0..400 {
            let j = (52 + i / 20) * 120 + 50 + i % 20;
            assert_eq!((part.height[i].to_bits(), part.filled[i]), (all.height[j].to_bits(), all.filled[j]), "{i}");
        }
        assert!(part.filled.iter().filter(|filled| **filled).count() > 50);
    }
}
