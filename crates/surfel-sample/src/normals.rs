//! Unoriented normals by principal component analysis (Hoppe et al. 1992, "Surface reconstruction from unorganized
//! points", §3.2).

use crate::eigen::{Symmetric3, smallest3};
use crate::lanes::LANES;
use crate::nearest::Search;
use crate::sorted::SortedPoints;
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x16};
use glam::DVec3;

/// Below this ratio of the middle to the largest variance, neighbours lie on one line (all on one scan line, say)
/// and more of them are looked at. A 16-neighbourhood that touches the adjacent scan lines is above 0.05.
const COLLINEAR: f64 = 0.02;

/// Neighbours that a second look takes, where the first ones don't surround a point. 48 reach the adjacent scan line
/// up to a spacing ratio of 1:20.
pub(crate) const WIDE: usize = 48;

/// A unit normal of arbitrary sign from a point's nearest neighbours, the farthest of which has this squared distance.
pub(crate) fn estimate(search: &mut Search, points: &SortedPoints, slot: usize, near: &[u32], farthest2: f32) -> DVec3 {
    let (values, normal) = smallest3(covariance(points, slot, near));
    if values[1] > COLLINEAR * values[2] || near.len() < 3 {
        return normal;
    }
    let (wide, _) = search.nearest(slot, WIDE, wider(farthest2, near.len()));
    smallest3(covariance(points, slot, wide)).1
}

/// A guess of the squared distance of the farthest of [`WIDE`] neighbours from that of `count`: some above what it is
/// where points are spread evenly over a surface.
pub(crate) fn wider(farthest2: f32, count: usize) -> f32 {
    1.3 * farthest2 * (WIDE as f32 / count.max(1) as f32)
}

/// Covariance of a point and `neighbours` about their mean, times their number, in steps.
pub(crate) fn covariance(points: &SortedPoints, slot: usize, neighbours: &[u32]) -> Symmetric3 {
    let ([x, y, z], [xx, xy, xz, yy, yz, zz]) =
        dispatch!(Level::new(), simd => sums_by(simd, points, slot, neighbours));
    let count = (neighbours.len() + 1) as f64;
    [
        xx - x * x / count,
        xy - x * y / count,
        xz - x * z / count,
        yy - y * y / count,
        yz - y * z / count,
        zz - z * z / count,
    ]
}

/// Sums of the offsets of `neighbours` from a point, and of their products: xx xy xz yy yz zz.
#[inline(always)]
fn sums_by<S: Simd>(simd: S, points: &SortedPoints, slot: usize, neighbours: &[u32]) -> ([f64; 3], [f64; 6]) {
    let p = points.at(slot);
    let zero = f32x16::splat(simd, 0.0);
    let (mut first, mut second) = ([zero; 3], [zero; 6]);
    for part in neighbours.chunks(LANES) {
        // Relative to the point, exactly, so that nothing cancels far from the origin; zeros add nothing.
        let mut d = [[0.0_f32; LANES]; 3];
        for (i, j) in part.iter().enumerate() {
            let q = points.at(*j as usize);
            for k in 0..3 {
                d[k][i] = (q[k] - p[k]) as f32;
            }
        }
        let [x, y, z] = d.map(|c| f32x16::load_array(simd, c));
        for (sum, d) in first.iter_mut().zip([x, y, z]) {
            *sum += d;
        }
        for (sum, product) in second.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *sum += product;
        }
    }
    (first.map(|lanes| sum(lanes.to_array())), second.map(|lanes| sum(lanes.to_array())))
}

/// The sum of all lanes, in the same order on every machine.
fn sum(mut lanes: [f32; LANES]) -> f64 {
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            lanes[i] += lanes[i + half];
        }
        half /= 2;
    }
    f64::from(lanes[0])
}
