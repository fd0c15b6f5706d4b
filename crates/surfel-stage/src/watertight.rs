//! Detection of watertight clouds of splats: closed surfaces whose inner side isn't visible from any direction.

use glam::DVec3;
use rayon::prelude::*;
use std::cell::LazyCell;
use surfel_framing::ViewAxes;
use surfel_framing::patches::{MOST, Patch, Patches};
use surfel_framing::viewpoint::draw;

/// Side in pixels of the small images that are drawn to test whether a cloud is watertight. Holes as large as a pixel
/// are detected, such as those in the web of a rocker arm of 10,000 points.
const SIDE: usize = 128;
/// Largest fraction of a cloud's covered pixels that may show back-facing splats in any view if the cloud is
/// watertight. Disks of the far side extend beyond silhouettes: the fraction is 0.1 for a teapot and 0.125 for a wolf,
/// each of 2,000 points. An open surface has a view in which a third of the pixels show back faces.
const MAX_BACK_FRACTION: f64 = 0.15;
/// Largest fraction of a cloud's covered pixels that may show back-facing splats away from silhouettes, in any view, if
/// the cloud is watertight. Measured: 0.001 for a cat's thin tail, 0.0026 for visible holes in a rocker arm's web.
const MAX_HOLE_FRACTION: f64 = 0.0012;
/// Largest slope, as depth divided by lateral distance, at which neighbouring pixels belong to one surface. Steeper
/// steps in depth are silhouettes.
const STEEPEST: f64 = 3.0;
/// Factor on the half-axes of front-facing patches if the patches are only a sample of a cloud. The enlarged patches
/// leave no gaps through which back faces would be visible.
const GROWN: f64 = 2.0;

/// True if a cloud is watertight: in every view, its image is the same with and without back-facing splats, except at
/// silhouettes. The views are along the axes and diagonals of a cube. Where estimated normals point inwards, the cloud
/// seems to have a hole.
pub(crate) fn is_watertight(patches: &Patches) -> bool {
    // Of the directions from the centre of a 3×3×3 grid to its cells, those to the 6 face centres and the 8 corners are
    // used.
    let all = (0..27).map(|i| DVec3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9)) - 1.0);
    let directions: Vec<DVec3> = all.filter(|d| [1.0, 3.0].contains(&d.length_squared())).collect();
    directions.into_par_iter().all(|forward| {
        let (away, holes) = back_facing_fractions(patches, forward.normalize());
        away <= MAX_BACK_FRACTION && holes <= MAX_HOLE_FRACTION
    })
}

/// Returns two fractions of the pixels that the cloud covers, seen along the unit vector `forward`. The first fraction
/// counts pixels whose nearest patch is back-facing and has no front-facing patch close behind. The second fraction
/// leaves out the pixels among these that are near a silhouette, where a pixel within the patch's reach is much farther
/// away.
fn back_facing_fractions(patches: &Patches, forward: DVec3) -> (f64, f64) {
    let (right, up) = forward.any_orthonormal_pair();
    let axes = ViewAxes { right, up, forward };
    let faces_away = |patch: &Patch| patch.normal.dot(forward) > 0.0;
    let numbered = || patches.all.iter().enumerate();
    let growth = if patches.all.len() < MOST { 1.0 } else { GROWN };
    let all = draw(numbered(), 1.0, &axes, SIDE);
    let outer = draw(numbered().filter(|(_, patch)| !faces_away(patch)), growth, &axes, SIDE);
    let farthest = LazyCell::new(|| MaxDepths::of(&all));
    let (mut seen, mut away, mut holes) = (0, 0, 0);
    for (pixel, (depth, number)) in all.iter().enumerate() {
        let Some(patch) = patches.all.get(*number) else { continue };
        seen += 1;
        let reach_px = 1.0 + patch.axes[0].length().max(patch.axes[1].length()) * 0.5 * SIDE as f64;
        let step = STEEPEST * reach_px * 2.0 / SIDE as f64;
        if faces_away(patch) && outer[pixel].0 - depth > step {
            away += 1;
            holes += usize::from(farthest.around(pixel, reach_px) - depth <= step);
        }
    }
    let share = |count: usize| count as f64 / seen.max(1) as f64;
    (share(away), share(holes))
}

/// Table of maximum depths over squares of the test image, for each pixel and each power of two as the square's side.
/// It answers a query in constant time, even if a few splats cover the whole image.
struct MaxDepths {
    /// Largest depths, row by row: `levels[k][pixel]` is for the square of side 2ᵏ whose upper left corner is the
    /// pixel.
    levels: Vec<Vec<f64>>,
}

impl MaxDepths {
    fn of(pixels: &[(f64, usize)]) -> Self {
        let mut levels = vec![pixels.iter().map(|(depth, _)| *depth).collect::<Vec<f64>>()];
        while 1 << levels.len() <= SIDE {
            let (half, last) = (1 << (levels.len() - 1), &levels[levels.len() - 1]);
            // Squares that extend beyond the image are never queried.
            let at = |x: usize, y: usize| last[y.min(SIDE - 1) * SIDE + x.min(SIDE - 1)];
            let largest = |i: usize| {
                let (x, y) = (i % SIDE, i / SIDE);
                at(x, y).max(at(x + half, y)).max(at(x, y + half)).max(at(x + half, y + half))
            };
            levels.push((0..SIDE * SIDE).map(largest).collect());
        }
        Self { levels }
    }

    /// Returns the largest depth within the square that extends `reach_px` pixels from a pixel to each side. Returns
    /// infinity if the square extends beyond the image.
    fn around(&self, pixel: usize, reach_px: f64) -> f64 {
        let (x, y, reach) = (pixel % SIDE, pixel / SIDE, reach_px.ceil().min(SIDE as f64) as usize);
        if x.min(y) < reach || x.max(y) + reach >= SIDE {
            return f64::INFINITY;
        }
        let side = 2 * reach + 1;
        let power = side.ilog2();
        // Four overlapping squares with sides of a power of two cover the square.
        let rest = side - (1 << power);
        let at = |dx: usize, dy: usize| self.levels[power as usize][(y - reach + dy) * SIDE + x - reach + dx];
        at(0, 0).max(at(rest, 0)).max(at(0, rest)).max(at(rest, rest))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, Vec3};
    use std::f64::consts::{PI, TAU};
    use std::sync::Arc;
    use surfel_model::{Geometry, Material, Object, SplatCloud};

    /// Returns the result of [`is_watertight`] for disks of this radius at the given points with normals.
    fn is_closed_of(splats: &[(DVec3, DVec3)], radius: f64) -> bool {
        is_closed_at(splats, radius, DAffine3::IDENTITY)
    }

    fn is_closed_at(splats: &[(DVec3, DVec3)], radius: f64, world_from_object: DAffine3) -> bool {
        let positions: Vec<Vec3> = splats.iter().map(|(p, _)| p.as_vec3()).collect();
        let normals: Vec<Vec3> = splats.iter().map(|(_, n)| n.as_vec3()).collect();
        let cloud = SplatCloud::disks(&positions, &normals, &vec![radius as f32; splats.len()]).unwrap();
        let geometry = Geometry::Splats(Arc::new(cloud));
        let object = Object { geometry, world_from_object, material: Material::default() };
        is_watertight(&Patches::of(&[object]).unwrap())
    }

    /// Returns points spread evenly over a unit sphere, with their normals.
    fn ball(count: usize) -> Vec<(DVec3, DVec3)> {
        let golden = PI * (3.0 - 5f64.sqrt());
        let point = |i: usize| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let (sin, cos) = (golden * i as f64 % TAU).sin_cos();
            let p = DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z);
            (p, p)
        };
        (0..count).map(point).collect()
    }

    /// Returns a radius of disks that cover a sphere with `count` points.
    fn radius(count: usize) -> f64 {
        1.5 * (4.0 * PI / count as f64).sqrt()
    }

    /// Returns the points, with their outward normals, of the two opposite sides across each of `axes` of a box of size
    /// 1×1×`thickness` around the origin. Each side has `side` × `side` points.
    fn sides(axes: &[usize], side: usize, thickness: f64) -> Vec<(DVec3, DVec3)> {
        let at = |i: usize| (i as f64 + 0.5) / side as f64 - 0.5;
        let mut splats = Vec::new();
        for &axis in axes {
            for i in 0..side * side {
                for sign in [-0.5, 0.5] {
                    let mut p = DVec3::ZERO;
                    p[axis] = sign;
                    p[(axis + 1) % 3] = at(i % side);
                    p[(axis + 2) % 3] = at(i / side);
                    let mut normal = DVec3::ZERO;
                    normal[axis] = sign.signum();
                    splats.push((p * DVec3::new(1.0, 1.0, thickness), normal));
                }
            }
        }
        splats
    }

    #[test]
    fn largest_depths_are_those_of_the_square_or_infinite_beyond_the_image() {
        let depth = |i: usize| ((i * 7919) % 104_729) as f64;
        let pixels: Vec<(f64, usize)> = (0..SIDE * SIDE).map(|i| (depth(i), 0)).collect();
        let farthest = MaxDepths::of(&pixels);
        for (x, y, reach) in
            [(64, 64, 0), (64, 64, 1), (50, 70, 2), (40, 90, 37), (63, 63, 63), (64, 64, 63), (3, 9, 3)]
        {
            let square = (y - reach..=y + reach).flat_map(|y| (x - reach..=x + reach).map(move |x| y * SIDE + x));
            let largest = square.map(depth).fold(0.0, f64::max);
            assert_eq!(farthest.around(y * SIDE + x, reach as f64 - 0.5), largest, "{x} {y} {reach}");
        }
        for (x, y, reach) in [(63, 63, 64.0), (0, 64, 1.0), (64, 127, 1.0), (126, 3, 2.0), (64, 64, 1e9)] {
            assert_eq!(farthest.around(y * SIDE + x, reach), f64::INFINITY, "{x} {y} {reach}");
        }
    }

    #[test]
    fn what_covers_a_body_is_closed_whatever_its_size_place_and_detail() {
        for count in [100, 1000, 8000, 30_000] {
            assert!(is_closed_of(&ball(count), radius(count)), "{count}");
        }
        for (scale, offset) in [(1e-12, 0.0), (1e12, 0.0), (1.0, 1e9), (-1.0, 3.0)] {
            let matrix = DAffine3::from_scale(DVec3::splat(scale));
            let matrix = DAffine3::from_translation(DVec3::splat(offset)) * matrix;
            assert!(is_closed_at(&ball(8000), radius(8000), matrix), "{scale} {offset}");
        }
        assert!(is_closed_of(&sides(&[0, 1, 2], 40, 1.0), 1.0 / 40.0));
        assert!(is_closed_of(&sides(&[0, 1, 2], 40, 0.1), 1.0 / 40.0));
    }

    #[test]
    fn what_is_open_anywhere_is_not_closed() {
        let ball = ball(8000);
        let without = |share: f64| -> Vec<_> {
            ball.iter().copied().filter(|(p, _)| p.dot(DVec3::new(0.48, 0.6, 0.64)) < 1.0 - 2.0 * share).collect()
        };
        for share in [0.5, 0.1, 0.01] {
            assert!(!is_closed_of(&without(share), radius(8000)), "{share}");
        }
        // An open sheet, and a box without lids.
        let sheet: Vec<_> = sides(&[2], 60, 0.0).into_iter().step_by(2).collect();
        assert!(!is_closed_of(&sheet, 1.0 / 60.0));
        assert!(!is_closed_of(&sides(&[0, 1], 40, 1.0), 1.0 / 40.0));
        // A room: a sphere whose normals point inward.
        let inward: Vec<_> = ball.iter().map(|(p, n)| (*p, -*n)).collect();
        assert!(!is_closed_of(&inward, radius(8000)));
    }

    #[test]
    fn normals_that_point_inward_somewhere_keep_a_cloud_open() {
        let turned = |share: f64| -> Vec<_> {
            let turn = |(p, n): (DVec3, DVec3)| (p, if p.z < 1.0 - 2.0 * share { n } else { -n });
            ball(8000).into_iter().map(turn).collect()
        };
        for share in [0.3, 0.03, 0.01] {
            assert!(!is_closed_of(&turned(share), radius(8000)), "{share}");
        }
    }
}
