//! Detection of depth images: points in the order of a camera's pixels, in the camera's axes.

use crate::content::Content;
use crate::context::Context;
use glam::{DVec2, DVec3};
use surfel_model::{PointCloud, Up};

/// Smallest number of rows, and of columns, of pixels for which points may be a depth image. The number of sampled
/// points with a depth must be at least `MIN_SIDE`² / 4 = 64.
const MIN_SIDE: usize = 16;
/// Maximum number of points that are sampled for the test.
const MOST: usize = 20_000;
/// Smallest correlation of the slopes x/z and y/z with column and row from which points count as a depth image. Lens
/// distortion and rounded depths lower it slightly.
const MIN_CORRELATION: f64 = 0.99;

/// Detects whether points are a camera's depth image of `columns` × `rows` pixels, row by row, with the camera at the
/// origin. If so, sets the points' up axis and viewpoint, and adds a note. The axes are either x right, y down, z
/// forward, so that −y is up, or OpenGL's, with y up and z backward. Content other than points, and points with a known
/// up axis or viewpoint, stay unchanged.
pub(crate) fn recognise(content: &mut Content, [columns, rows]: [usize; 2], context: &mut Context<'_>) {
    let Content::Points(points) = content else { return };
    if points.up.is_some() || points.viewpoint.is_some() {
        return;
    }
    for (up, ahead, name) in [(Up::MinusY, 1.0, "-y"), (Up::PlusY, -1.0, "+y")] {
        if is_depth_image(points, [columns, rows], ahead) {
            (points.up, points.viewpoint) = (Some(up), Some(DVec3::ZERO));
            let size = format!("{columns}×{rows}");
            context.note(format!("its {size} points are a camera's depth image: {name} is up, the camera at 0,0,0"));
            return;
        }
    }
}

/// True if the slopes x/z and y/z of the points grow linearly with column and row, as in a pinhole camera at the
/// origin. False if a sampled point is behind the camera. The camera looks along z with y down if `ahead` is 1, or
/// along −z with y up if `ahead` is −1.
fn is_depth_image(points: &PointCloud, [columns, rows]: [usize; 2], ahead: f64) -> bool {
    // Points without a depth may have been dropped; the others' row numbers then give their pixels.
    let place = |i: usize| points.rows.as_ref().map_or(i, |rows| rows[i] as usize);
    let count = points.len().checked_sub(1).map_or(0, |last| place(last) + 1);
    if columns < MIN_SIDE || rows < MIN_SIDE || columns.checked_mul(rows).is_none_or(|all| count > all) {
        return false;
    }
    if points.rows.is_none() && count < columns * rows {
        return false;
    }
    let step = points.len().div_ceil(MOST);
    // A step without a common divisor with the number of columns samples all columns and rows evenly.
    let step = (step..).find(|step| gcd(*step, columns) == 1).unwrap_or(1);
    let mut seen = Vec::new();
    for i in (0..points.len()).step_by(step) {
        let p = (points.origin + points.positions.get(i)) * DVec3::new(1.0, ahead, ahead);
        if !p.is_finite() || p == DVec3::ZERO {
            continue;
        }
        if p.z <= 0.0 {
            return false;
        }
        let pixel = DVec2::new((place(i) % columns) as f64, (place(i) / columns) as f64);
        seen.push((pixel, DVec2::new(p.x / p.z, p.y / p.z)));
    }
    seen.len() >= MIN_SIDE * MIN_SIDE / 4
        && (0..2).all(|k| correlation(seen.iter().map(|(a, b)| (a[k], b[k]))) > MIN_CORRELATION)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Returns Pearson's correlation of pairs of numbers; NaN if one of the two doesn't vary.
fn correlation(pairs: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let count = pairs.clone().count() as f64;
    let (a, b) = pairs.clone().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / count, b + y / count));
    let moments = |(aa, ab, bb): (f64, f64, f64), (x, y): (f64, f64)| {
        let (x, y) = (x - a, y - b);
        (aa + x * x, ab + x * y, bb + y * y)
    };
    let (aa, ab, bb) = pairs.fold((0.0, 0.0, 0.0), moments);
    ab / (aa * bb).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Column3;

    const SIZE: [usize; 2] = [64, 48];

    /// Returns a wavy wall as seen by a camera of 60 px focal length, in axes transformed by `turned`.
    fn image(turned: impl Fn(DVec3) -> DVec3) -> PointCloud {
        let at = |i: usize| {
            let (column, row) = ((i % SIZE[0]) as f64, (i / SIZE[0]) as f64);
            let depth = if column > 40.0 { 1.2 } else { 2.0 + 0.1 * (0.3 * row).sin() };
            let missing = i.is_multiple_of(7);
            if missing {
                DVec3::NAN
            } else {
                turned(DVec3::new((column - 31.0) / 60.0, (row - 23.0) / 60.0, 1.0) * depth)
            }
        };
        let positions: Vec<DVec3> = (0..SIZE[0] * SIZE[1]).map(at).collect();
        PointCloud { positions: Column3::from_f64(&positions), ..PointCloud::default() }
    }

    #[test]
    fn pixels_of_a_camera_in_its_axes_are_told_from_others() {
        assert!(is_depth_image(&image(|p| p), SIZE, 1.0));
        let mut dropped = image(|p| p);
        assert!(dropped.drop_non_finite() > 400 && is_depth_image(&dropped, SIZE, 1.0));
        assert!(!is_depth_image(&dropped, [SIZE[0] - 1, SIZE[1] + 2], 1.0));
        let tells: [fn(DVec3) -> DVec3; 5] = [
            |p| DVec3::new(p.z, -p.x, -p.y),
            |p| DVec3::new(p.x, -p.y, -p.z),
            |p| DVec3::new(p.x, -p.y, p.z),
            |p| p + DVec3::new(0.0, 0.0, -3.0),
            |p| p + DVec3::new(0.0, 4.0 * p.z * p.z, 0.0),
        ];
        for (i, turned) in tells.into_iter().enumerate() {
            assert!(!is_depth_image(&image(turned), SIZE, 1.0), "{i}");
        }
        let as_opengl = image(|p| DVec3::new(p.x, -p.y, -p.z));
        assert!(is_depth_image(&as_opengl, SIZE, -1.0));
        assert!(!is_depth_image(&image(|p| p), SIZE, -1.0));
        assert!(!is_depth_image(&image(|p| DVec3::new(p.x, p.y, -p.z)), SIZE, -1.0));
        // Another order, or not an image.
        assert!(!is_depth_image(&image(|p| p), [SIZE[1], SIZE[0]], 1.0));
        assert!(!is_depth_image(&image(|p| p), [SIZE[0] * SIZE[1], 1], 1.0));
        assert!(!is_depth_image(&image(|p| p), [SIZE[0], SIZE[1] + 1], 1.0));
        assert!(!is_depth_image(&image(|_| DVec3::NAN), SIZE, 1.0));
        assert!(!is_depth_image(&image(|_| DVec3::ZERO), SIZE, 1.0));
        assert!(!is_depth_image(&image(|_| DVec3::Z), SIZE, 1.0));
    }
}
