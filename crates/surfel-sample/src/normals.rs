//! Unoriented normals by principal component analysis (Hoppe et al. 1992, "Surface reconstruction from unorganized
//! points", §3.2).
//!
//! A *grid step* is the unit of the coordinates of [`SortedPoints`].

use crate::eigen::{Symmetric3, smallest3, symmetric3};
use crate::lanes::LANES;
use crate::nearest::{MAX_NEIGHBOURS, Search};
use crate::sorted::SortedPoints;
use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x16};
use glam::{DVec3, Vec3};

/// Largest ratio of the middle to the largest variance of a neighbourhood at which its points count as collinear, as on
/// a single scan line. A wider search then follows. Sixteen neighbours that include points of adjacent scan lines have
/// a ratio above 0.05.
pub(crate) const COLLINEAR: f64 = 0.02;

/// Number of neighbours in the second search for a normal, if the first neighbours are collinear. A circle of 48 points
/// reaches the adjacent scan line up to a spacing ratio of 1:20.
pub(crate) const WIDE: usize = 48;

/// Number of neighbours in the last search for a normal, if those of the second search are collinear too. A circle of
/// 128 points reaches the adjacent scan line up to a spacing ratio of 1:50.
pub(crate) const WIDEST: usize = MAX_NEIGHBOURS;
/// Largest ratio of the smallest to the middle variance at which neighbours form a plane that may override a stored
/// normal. The first value applies to the neighbours on the point's side of the surface. If fewer than [`FEWEST`] are
/// on that side, as in a corner, all neighbours are used, with the stricter second value.
const PLANAR: [f64; 2] = [0.1, 0.01];
/// Smallest cosine (20°) between a stored normal and the normal of the neighbours' plane at which the stored normal
/// fits.
const FITS: f64 = 0.94;
/// Smallest cosine (60°) between the stored normals of a neighbour and a point at which both are on the same side of
/// the surface.
const SAME_SIDE: f32 = 0.5;
/// Largest mean squared sine at which stored normals fit a curved surface. The angle is between the line to a neighbour
/// and the plane perpendicular to the mean of both stored normals. The value is 0 on spheres and cylinders, and reaches
/// the limit if all normals are tilted alike by 14°.
const CURVED: f32 = 0.03;
/// Smallest number of neighbours on the point's side of the surface at which only they determine the plane
/// ([`PLANAR`]).
const FEWEST: usize = 6;

/// Estimates the unit normal of a point, with arbitrary sign, from its nearest neighbours `near`. `farthest2` is the
/// squared distance of the farthest one, in squared grid steps.
pub(crate) fn estimate(search: &mut Search, points: &SortedPoints, slot: usize, near: &[u32], farthest2: f32) -> DVec3 {
    let is_line = |values: [f64; 3]| values[1] <= COLLINEAR * values[2];
    let (values, normal) = smallest3(covariance(points, slot, near));
    if !is_line(values) || near.len() < 3 {
        return normal;
    }
    let (wide, wide2) = search.nearest(slot, WIDE, wider(farthest2, near.len()));
    let (values, normal) = smallest3(covariance(points, slot, wide));
    if !is_line(values) {
        return normal;
    }
    let reach = WIDEST as f32 / WIDE as f32;
    let (widest, _) = search.nearest(slot, WIDEST, wide2 * reach * reach);
    smallest3(covariance(points, slot, widest)).1
}

/// Returns the unit normal of the disk of a point with a stored normal. The stored normal is used if it fits the plane
/// or the curve of the neighbours, or if these form no plane. Otherwise the normal of the neighbours' plane is used, on
/// the same side. `given` returns a neighbour's stored normal, or zero. Neighbours whose stored normals disagree are
/// ignored, because they are beyond a crease or on the back of a thin surface.
///
/// On a curved surface, the neighbours to one side of a point form another plane than the point's own. Stored normals
/// reveal such curvature: on a circle, the line between two points is perpendicular to the mean of their normals.
pub(crate) fn fitted_stored_normal(
    points: &SortedPoints,
    slot: usize,
    near: &[u32],
    stored: Vec3,
    given: impl Fn(usize) -> Vec3,
) -> Vec3 {
    let is_of_side = |j: &u32| {
        let other = given(*j as usize);
        other == Vec3::ZERO || other.dot(stored) >= SAME_SIDE
    };
    let mut side = [0; MAX_NEIGHBOURS];
    let mut count = 0;
    for j in near.iter().filter(|j| is_of_side(j)) {
        side[count] = *j;
        count += 1;
    }
    let (row, planar) = if count >= FEWEST { (&side[..count], PLANAR[0]) } else { (near, PLANAR[1]) };
    let (values, normal) = smallest3(covariance(points, slot, row));
    let is_plane = values[0] <= planar * values[1] && values[1] > COLLINEAR * values[2];
    let fits = |n: Vec3| normal.dot(n.as_dvec3()).abs() >= FITS;
    let chord = |j: &u32| {
        let (d, mean) = (offset(points, slot, *j as usize), stored + given(*j as usize));
        d.dot(mean).powi(2) / (d.length_squared() * mean.length_squared()).max(f32::MIN_POSITIVE)
    };
    let is_curved = || row.iter().map(chord).sum::<f32>() <= CURVED * row.len() as f32;
    if !is_plane || fits(stored) || is_curved() {
        return stored;
    }
    let cosine = normal.dot(stored.as_dvec3());
    (if cosine < 0.0 { -normal } else { normal }).as_vec3()
}

/// Returns the unit normal of the disk of a point on a line of points: perpendicular to the line, and toward `outside`
/// as far as possible. `None` if the neighbours aren't collinear, because a plane through them is a better estimate,
/// and if the line itself leads to `outside`.
pub(crate) fn across_line(points: &SortedPoints, slot: usize, near: &[u32], outside: DVec3) -> Option<DVec3> {
    let (values, vectors) = symmetric3(covariance(points, slot, near));
    let is_line = values[1] <= COLLINEAR * values[2] && values[2] > 0.0;
    is_line.then(|| outside.reject_from_normalized(vectors[2]).try_normalize()).flatten()
}

/// Estimates the squared distance of the farthest of [`WIDE`] neighbours from `farthest2`, that of the farthest of
/// `count`. The estimate is somewhat too large for points spread evenly over a surface.
pub(crate) fn wider(farthest2: f32, count: usize) -> f32 {
    1.3 * farthest2 * (WIDE as f32 / count.max(1) as f32)
}

/// Returns the covariance matrix of the positions of a point and its `neighbours`, times the number of points, in
/// squared grid steps.
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

/// Returns the vector from point `a` to point `b`, in grid steps.
#[inline]
pub(crate) fn offset(points: &SortedPoints, a: usize, b: usize) -> Vec3 {
    let (p, q) = (points.at(a), points.at(b));
    Vec3::new((q[0] - p[0]) as f32, (q[1] - p[1]) as f32, (q[2] - p[2]) as f32)
}

/// Returns the sum of the offsets of `neighbours` from a point, in grid steps, and the sums of the offsets' products
/// xx, xy, xz, yy, yz, zz.
#[inline(always)]
fn sums_by<S: Simd>(simd: S, points: &SortedPoints, slot: usize, neighbours: &[u32]) -> ([f64; 3], [f64; 6]) {
    let p = points.at(slot);
    let zero = f32x16::splat(simd, 0.0);
    let (mut first, mut second) = ([zero; 3], [zero; 6]);
    for part in neighbours.chunks(LANES) {
        // Offsets from the point are exact, so no precision is lost far from the origin. Unused lanes are zero.
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

/// Returns the sum of all lanes, in the same order on every machine.
pub(crate) fn sum(mut lanes: [f32; LANES]) -> f64 {
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            lanes[i] += lanes[i + half];
        }
        half /= 2;
    }
    f64::from(lanes[0])
}
