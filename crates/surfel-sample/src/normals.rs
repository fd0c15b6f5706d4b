//! Unoriented normals by principal component analysis (Hoppe et al. 1992, "Surface reconstruction from unorganized
//! points", §3.2).

use crate::eigen::{Symmetric3, symmetric3};
use crate::neighbours::{Neighbours, WIDE};
use crate::parallel::map_each;
use crate::progress::Progress;
use crate::tree::Nearest;
use glam::DVec3;

/// Below this ratio of the middle to the largest variance, neighbours lie on one line (all on one scan line, say)
/// and more of them are looked at. A 16-neighbourhood that touches the adjacent scan lines is above 0.05.
const COLLINEAR: f64 = 0.02;

/// Fills the zero entries of `normals` (one a slot) with unit normals of arbitrary sign.
pub(crate) fn estimate(cloud: &Neighbours, normals: &mut [DVec3], progress: &dyn Progress) {
    progress.stage("normals", cloud.len() as u64);
    let state = || (Nearest::new(WIDE + 1), Vec::new());
    let estimated = map_each(cloud.len(), progress, state, |(found, wide), slot| {
        if normals[slot] != DVec3::ZERO {
            return normals[slot];
        }
        let (values, vectors) = symmetric3(covariance(cloud, slot, cloud.of(slot)));
        if values[1] > COLLINEAR * values[2] || cloud.degree < 3 {
            return vectors[0];
        }
        cloud.widen(slot, found, wide);
        symmetric3(covariance(cloud, slot, wide)).1[0]
    });
    normals.copy_from_slice(&estimated);
}

/// Covariance of a point and `neighbours` about their mean, without the division by their number.
pub(crate) fn covariance(cloud: &Neighbours, slot: usize, neighbours: &[u32]) -> Symmetric3 {
    let p = cloud.point(slot);
    // Relative to the point, so that nothing cancels far from the working origin.
    let offset = |j: &u32| cloud.point(*j as usize) - p;
    let mean = neighbours.iter().map(offset).sum::<DVec3>() / (neighbours.len() + 1) as f64;
    let mut m = [0.0; 6];
    for d in neighbours.iter().map(offset).chain([DVec3::ZERO]) {
        let d = d - mean;
        for (sum, product) in m.iter_mut().zip([d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z]) {
            *sum += product;
        }
    }
    m
}
