//! Detection of arrays that aren't tables of points: images and camera poses.

use super::evidence::Column;
use crate::error::Problem;
#[cfg(feature = "npy")]
use crate::strided::Strided;

/// Largest error of a rotation matrix that is accepted as rounding: the difference between a scalar product of two of
/// its rows and 0, or of a row with itself and 1.
const ROUNDING: f64 = 2e-3;
/// Smallest number of rows and of columns from which an array may be an image.
#[cfg(feature = "npy")]
const IMAGE_SIDE: usize = 8;
/// Number of columns from which an array whose neighbouring columns have similar ranges counts as an image, even if
/// values of neighbouring columns differ much.
#[cfg(feature = "npy")]
const MIN_IMAGE_COLUMNS: usize = 20;

/// Returns a problem if each sampled row contains a camera pose: a matrix of 12 or 16 numbers.
pub(super) fn poses(columns: &[Column]) -> Option<Problem> {
    let width = columns.len();
    if !matches!(width, 12 | 16) {
        return None;
    }
    let rows = columns[0].sample.len();
    let row = |i: usize| columns.iter().map(|c| c.sample[i]).collect::<Vec<f64>>();
    let are_poses = (0..rows).all(|i| is_pose(&row(i)));
    let problem = || {
        Problem::new(format!("holds matrices in rows of {width} numbers, as of camera poses"))
            .expected("a row for each point: x y z [intensity] [r g b] [nx ny nz]")
            .help("the cameras' centres are points: save these as x y z")
    };
    are_poses.then(problem)
}

/// True if the numbers are a camera pose: three or four rows of four numbers, whose left part is a rotation within
/// [`ROUNDING`]. It may also mirror. Four rows may be stored column by column.
fn is_pose(m: &[f64]) -> bool {
    if m.len() == 16 && m[12..] != [0.0, 0.0, 0.0, 1.0] {
        // Column-major order.
        let transposed: Vec<f64> = (0..16).map(|i| m[i % 4 * 4 + i / 4]).collect();
        return transposed[12..] == [0.0, 0.0, 0.0, 1.0] && is_pose(&transposed);
    }
    m.len() >= 12 && is_rotation([[m[0], m[1], m[2]], [m[4], m[5], m[6]], [m[8], m[9], m[10]]])
}

fn is_rotation(rows: [[f64; 3]; 3]) -> bool {
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
    let expected = |i: usize, j: usize| if i == j { 1.0 } else { 0.0 };
    (0..3).all(|i| (i..3).all(|j| (dot(rows[i], rows[j]) - expected(i, j)).abs() <= ROUNDING))
}

/// Kind of camera matrices that an array contains instead of points: world-to-camera transforms (or their inverses), or
/// matrices K of focal lengths and principal point.
#[cfg(feature = "npy")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Matrix {
    Poses,
    Intrinsics,
}

/// Returns the kind of camera matrices that an array contains, or `None` if it may be a table of points. `columns`
/// contains the matrices one below the other, with `height` rows each. If `interleaved`, it contains all first rows,
/// then all second rows, and so on. At most 100 matrices are examined, spread evenly over the array.
#[cfg(feature = "npy")]
pub(crate) fn matrix_kind(columns: &[Strided<'_>], height: usize, interleaved: bool) -> Option<Matrix> {
    const MOST: usize = 100;
    let rows = columns.first()?.len();
    if !matches!((height, columns.len()), (3 | 4, 4) | (3, 3)) || !rows.is_multiple_of(height) || rows == 0 {
        return None;
    }
    let count = rows / height;
    let all = (0..count).step_by(count.div_ceil(MOST));
    let mut matrices = all.map(|i| {
        let place = |r: usize| if interleaved { i + count * r } else { i * height + r };
        let row = |r: usize| columns.iter().map(move |c| c.at(place(r)));
        (0..height).flat_map(row).collect::<Vec<f64>>()
    });
    if columns.len() == 4 {
        return matrices.all(|m| is_pose(&m)).then_some(Matrix::Poses);
    }
    // Focal lengths and a principal point, in pixels.
    let is_intrinsics = |m: Vec<f64>| m[3] == 0.0 && m[6..] == [0.0, 0.0, 1.0] && m[0] > 1.0 && m[4] > 1.0;
    matrices.all(is_intrinsics).then_some(Matrix::Intrinsics)
}

/// True if three columns are the red, green and blue of an image: bytes divided by 255.
#[cfg(feature = "npy")]
pub(crate) fn are_image_colors(columns: &[Strided<'_>]) -> bool {
    let measured = super::measure(columns);
    let [red, green, blue] = &measured[..] else { return false };
    let triple = super::Triple::of([red, green, blue]);
    triple.color_scale() == Some(super::Scale::One) && triple.are_bytes_over_255()
}

/// True if an array of at least [`IMAGE_SIDE`] rows and columns is an image. At least 90 % of the pairs of neighbouring
/// columns, among them the first three pairs, must have similar ranges. In addition there must be [`MIN_IMAGE_COLUMNS`]
/// columns, or neighbouring values must differ by at most 15 % of the whole range on average.
#[cfg(feature = "npy")]
pub(crate) fn is_image(columns: &[Strided<'_>]) -> bool {
    let (rows, width) = (columns.first().map_or(0, Strided::len), columns.len());
    if rows < IMAGE_SIDE || width < IMAGE_SIDE {
        return false;
    }
    let measured = super::measure(columns);
    let least = measured.iter().fold(f64::INFINITY, |least, c| least.min(c.least));
    let most = measured.iter().fold(f64::NEG_INFINITY, |most, c| most.max(c.most));
    // Neighbours are similar if their ranges mostly overlap, or begin and end at nearly the same values.
    let is_alike = |pair: &&[Column]| {
        let [a, b] = [&pair[0], &pair[1]];
        let both = a.most.min(b.most) - a.least.max(b.least);
        let either = a.most.max(b.most) - a.least.min(b.least);
        let apart = (a.least - b.least).abs() + (a.most - b.most).abs();
        both >= 0.5 * either || apart <= 0.1 * (most - least)
    };
    let alike = measured.windows(2).filter(is_alike).count();
    let are_coordinates_alike = measured.windows(2).take(3).all(|pair| is_alike(&pair));
    if !are_coordinates_alike || alike * 10 < (width - 1) * 9 {
        return false;
    }
    let sampled = measured[0].sample.len();
    let difference = |pair: &[Column]| (0..sampled).map(|i| (pair[0].sample[i] - pair[1].sample[i]).abs()).sum::<f64>();
    let mean = measured.windows(2).map(difference).sum::<f64>() / (sampled * (width - 1)) as f64;
    width >= MIN_IMAGE_COLUMNS || mean <= 0.15 * (most - least)
}
