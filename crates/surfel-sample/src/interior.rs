//! The interior weight: the Σw that a cloud has inside its own surface.

use crate::parallel::map_tasks;
use crate::tree::KdTree;
use glam::DVec3;
use std::collections::HashMap;
use surfel_math::basis::orthonormal;
use surfel_model::{Shape, SplatCloud};

/// Splats that are probed.
const PROBES: usize = 4096;
/// Splats summed by one task. Fixed, so that the order of summation doesn't depend on the number of threads.
const CHUNK: usize = 1 << 14;

/// A line along a splat's normal through the middle of one quarter of it.
struct Probe {
    at: DVec3,
    normal: DVec3,
    reach: f64,
}

/// Σw inside the cloud's own surface at cutoff 2, as the rendering model defines it (§5, coverage): the lower median
/// over the splats k = ⌊i·n/m⌋, m = min(n, 4096), of Σ w_j at p_k + ½s_k + ½t_k seen along k's normal, over the
/// splats, k included, whose normals agree within 60° and whose plane that line meets within r_max of that point.
/// Clips are ignored. Dimensionless; `None` for an empty cloud.
///
/// The few probes are put into a tree and all splats run past them, which costs memory for the probes only.
pub fn interior_weight(cloud: &SplatCloud) -> Option<f64> {
    let count = cloud.len();
    let (probes, of) = {
        let m = count.min(PROBES);
        let index = |i: usize| (i as u128 * count as u128 / m as u128) as usize;
        distinct((0..m).map(|i| probe(cloud, index(i))).collect())
    };
    let places: Vec<DVec3> = probes.iter().map(|p| p.at).collect();
    let reach: Vec<f64> = probes.iter().map(|p| p.reach).collect();
    let tree = KdTree::new(&places);
    let largest = tree.largest_below(&reach);

    let partial = map_tasks(count.div_ceil(CHUNK), |chunk| {
        let mut sums = vec![0.0; probes.len()];
        for j in chunk * CHUNK..count.min((chunk + 1) * CHUNK) {
            // Relative to the origin: adding it would cost digits.
            let center = cloud.data().centers.get(j);
            let radius = cloud.radius_max(j);
            tree.near(center, radius, &largest, &mut |slot| {
                let probe = tree.index(slot);
                sums[probe] += weight(cloud, j, center, radius, &probes[probe]);
            });
        }
        sums
    });
    let mut sums = vec![0.0; probes.len()];
    for chunk in partial {
        sums.iter_mut().zip(chunk).for_each(|(sum, part)| *sum += part);
    }
    let mut sums: Vec<f64> = of.into_iter().map(|probe| sums[probe]).collect();
    crate::radii::median(&mut sums).filter(|w| w.is_finite() && *w > 0.0)
}

/// The different ones of `probes`, and which of them each is: of many splats in one place all would sum the same.
fn distinct(probes: Vec<Probe>) -> (Vec<Probe>, Vec<usize>) {
    let mut known = HashMap::with_capacity(probes.len());
    let mut different = Vec::with_capacity(probes.len());
    let mut of = Vec::with_capacity(probes.len());
    for probe in probes {
        let (p, n) = (probe.at.to_array().map(f64::to_bits), probe.normal.to_array().map(f64::to_bits));
        of.push(*known.entry((p, n, probe.reach.to_bits())).or_insert_with(|| {
            different.push(probe);
            different.len() - 1
        }));
    }
    (different, of)
}

fn probe(cloud: &SplatCloud, k: usize) -> Probe {
    let (s, t) = cloud.axes(k);
    Probe { at: cloud.data().centers.get(k) + 0.5 * (s + t), normal: cloud.normal(k), reach: cloud.radius_max(k) }
}

/// w of splat `j` where the probe's line meets its plane.
fn weight(cloud: &SplatCloud, j: usize, center: DVec3, radius: f64, probe: &Probe) -> f64 {
    let d = probe.at - center;
    if d.length_squared() > (radius + probe.reach).powi(2) {
        return 0.0;
    }
    let normal = cloud.normal(j);
    let facing = normal.dot(probe.normal);
    if facing < 0.5 {
        return 0.0;
    }
    let along = -normal.dot(d) / facing;
    if along.abs() > probe.reach {
        return 0.0;
    }
    let hit = d + along * probe.normal;
    let rho2 = match &cloud.data().shape {
        Shape::Disks { radii, .. } => {
            let (s, t) = orthonormal(normal);
            let r = f64::from(radii[j]);
            (hit.dot(s) / r).powi(2) + (hit.dot(t) / r).powi(2)
        }
        Shape::Ellipses { s, t } => {
            // hit = u s + v t in the plane: the ratios of areas, with lengths scaled out.
            let (s, t) = (s.get(j), t.get(j));
            let (a, b) = (s.abs().max_element(), t.abs().max_element());
            let (s, t) = (s / a, t / b);
            let m = s.cross(t);
            let scale = m.length_squared();
            (hit.cross(t).dot(m) / scale / a).powi(2) + (s.cross(hit).dot(m) / scale / b).powi(2)
        }
    };
    if rho2 <= 1.0 { (-2.0 * rho2).exp() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splats_in_one_place_are_probed_once() {
        let place = |i: usize| if i < 3000 { glam::Vec3::ZERO } else { glam::Vec3::X * i as f32 };
        let centers: Vec<glam::Vec3> = (0..3020).map(place).collect();
        let cloud = SplatCloud::disks(&centers, &vec![glam::Vec3::Z; 3020], &vec![0.25; 3020]).unwrap();
        let probes = || (0..3020).map(|k| probe(&cloud, k)).collect::<Vec<_>>();
        let (different, of) = distinct(probes());
        // One of 3000 and twenty others: 21 probes, and 3000 + 20 pairs are looked at instead of nine million.
        assert_eq!((different.len(), of.len()), (21, 3020));
        assert!(of.iter().zip(probes()).all(|(d, p)| different[*d].at == p.at && different[*d].reach == p.reach));
        // exp(−2ρ²) at (½, ½) is exp(−1), of 3000 splats.
        let weight = interior_weight(&cloud).unwrap();
        assert!((weight - 3000.0 * (-1.0_f64).exp()).abs() < 1e-6 * weight, "{weight}");
    }
}
