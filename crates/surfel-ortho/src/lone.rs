//! Detection of points that are isolated in height: birds, and reflections in the air or below the ground.
//!
//! An isolated point has many neighbours in the plane, but few at its height. It has fewer than two neighbours within
//! eight point spacings. Within the same distance in the plane, at any height, there are at least sixteen. The few
//! ground points under a tree aren't isolated, since other ground points are near, and neither are points on a wire.
//! Sparse points, such as from water, have few neighbours at any height and aren't isolated either.

use glam::DVec3;
use rayon::prelude::*;

/// Radius of the neighbourhood in which a point's neighbours are counted, in point spacings.
const REACH: f64 = 8.0;
/// Number of neighbours in space (within [`REACH`]) from which a point isn't isolated.
const COMPANIONS: usize = 2;
/// Smallest number of neighbours in the plane (within [`REACH`] in x and y, at any height) at which a point can be
/// isolated. Sparse points have fewer.
const MIN_AROUND: usize = 16;
/// Number of cells of the search grid along the neighbourhood's radius. Points in the same cell are then always
/// neighbours.
const CELLS: f64 = 2.0;

/// Returns one flag per point, true if the point is isolated in height. `spacing` is the mean distance between points.
pub(crate) fn lone(positions: &[DVec3], spacing: f64) -> Vec<bool> {
    if !(spacing > 0.0 && spacing.is_finite()) || positions.len() <= MIN_AROUND {
        return vec![false; positions.len()];
    }
    let reach_squared = (REACH * spacing).powi(2);
    let side = REACH * spacing / CELLS;
    let least = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let cell = |p: DVec3| ((p - least) / side).to_array().map(|v| v as u32);
    let mut sorted: Vec<([u32; 3], u32)> =
        positions.par_iter().with_min_len(4096).zip(0..positions.len() as u32).map(|(p, i)| (cell(*p), i)).collect();
    sorted.par_sort_unstable();
    let first_at = |key: [u32; 3]| sorted.partition_point(|(cell, _)| *cell < key);
    let reach = CELLS as u32;
    let is_lone = |cell: [u32; 3], i: u32| {
        let p = positions[i as usize];
        let (mut companions, mut around) = (0, 0);
        let [x, y, z] = cell;
        for column in x.saturating_sub(reach)..=x.saturating_add(reach) {
            for row in y.saturating_sub(reach)..=y.saturating_add(reach) {
                let from_here = |entry: &([u32; 3], u32)| positions[entry.1 as usize] - p;
                let near = |entry: &&([u32; 3], u32)| from_here(entry).truncate().length_squared() < reach_squared;
                let beside = |entry: &&([u32; 3], u32)| from_here(entry).length_squared() < reach_squared;
                let from = first_at([column, row, z.saturating_sub(reach)]);
                let to = first_at([column, row, z.saturating_add(reach + 1)]);
                companions += sorted[from..to].iter().filter(beside).take(COMPANIONS + 1).count();
                // The count includes the point itself.
                if companions > COMPANIONS {
                    return false;
                }
                let [from, to] = [row, row.saturating_add(1)].map(|row| first_at([column, row, 0]));
                if around <= MIN_AROUND {
                    around += sorted[from..to].iter().filter(near).take(MIN_AROUND + 1).count();
                }
            }
        }
        around > MIN_AROUND
    };
    // Points in cells with enough points needn't be tested. This holds for most cells.
    let runs: Vec<&[([u32; 3], u32)]> =
        sorted.chunk_by(|a, b| a.0 == b.0).filter(|run| run.len() <= COMPANIONS).collect();
    let found: Vec<u32> = runs
        .into_par_iter()
        .with_min_len(64)
        .flat_map_iter(|run| run.iter().filter(|(cell, i)| is_lone(*cell, *i)).map(|(_, i)| *i))
        .collect();
    let mut lone = vec![false; positions.len()];
    found.into_iter().for_each(|i| lone[i as usize] = true);
    lone
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns rolling hills with point spacing 1, and additional points.
    fn with(more: &[[f64; 3]]) -> Vec<DVec3> {
        let ground = (0..10_000).map(|i| [f64::from(i % 100), f64::from(i / 100)]);
        let at = |[x, y]: [f64; 2]| DVec3::new(x + 0.3 * (y * 12.9).sin(), y, 5.0 * (0.2 * x).sin() + 0.7 * y);
        ground.map(at).chain(more.iter().map(|p| DVec3::from(*p))).collect()
    }

    fn found(more: &[[f64; 3]]) -> Vec<usize> {
        let points = with(more);
        let lone = lone(&points, 1.0);
        (0..points.len()).filter(|i| lone[*i]).collect()
    }

    #[test]
    fn birds_and_pits_stand_alone_and_what_is_one_of_several_does_not() {
        assert_eq!(found(&[]), [0; 0]);
        let ground = |x: f64, y: f64| 5.0 * (0.2 * x).sin() + 0.7 * y;
        let at = |x: f64, y: f64, over: f64| [x, y, ground(x, y) + over];
        // A bird, another with its echo, and a reflection below the ground.
        let birds = [at(20.2, 30.1, 40.0), at(70.0, 20.0, 14.0), at(70.4, 20.1, 14.3), at(50.5, 80.2, -12.0)];
        assert_eq!(found(&birds), [10_000, 10_001, 10_002, 10_003]);
        // A wire, a tree, and a mast.
        let wire: Vec<[f64; 3]> = (0..60).map(|i| [f64::from(i) * 1.5, 40.0, 70.0]).collect();
        let tree: Vec<[f64; 3]> =
            (0..20).map(|i| at(60.0 + 0.3 * f64::from(i % 5), 60.0, 4.0 + f64::from(i))).collect();
        let mast: Vec<[f64; 3]> = (0..15).map(|i| at(30.0, 70.0, 1.5 * f64::from(i))).collect();
        assert_eq!(found(&[wire, tree, mast].concat()), [0; 0]);
    }

    #[test]
    fn sparse_points_and_those_at_the_edge_are_not_judged() {
        // Water in the east: one return in fifty, lower than the bank.
        let water: Vec<[f64; 3]> =
            (0..40).map(|i| [115.0 + 7.0 * f64::from(i % 5), 12.0 * f64::from(i / 5), -8.0]).collect();
        assert_eq!(found(&water), [0; 0]);
        assert_eq!(lone(&[DVec3::ZERO; 3], 1.0), [false; 3]);
        assert_eq!(lone(&with(&[])[..100], 0.0), [false; 100]);
        assert_eq!(lone(&with(&[])[..100], f64::INFINITY), [false; 100]);
    }
}
