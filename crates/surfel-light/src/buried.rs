//! Detection of buried splats: splats that no light reaches although their neighbours are lit.
//!
//! In folds of scanned surfaces, some splats are below their neighbours or face inward, so that they receive no light
//! from the sky. Visible rims of such splats would be black spots.

use crate::receivers::Light;
use surfel_model::SplatCloud;

/// Largest light of a buried splat, as a fraction of the cloud's mean. Where light fades gradually, splats have values
/// between `DARK` and `BRIGHT`.
const DARK: f32 = 0.05;
/// Smallest light of a lit splat, as a fraction of the cloud's mean.
const BRIGHT: f32 = 0.25;
/// Number of splats, before and after a splat in Morton order, among which neighbours are searched.
const WINDOW: usize = 32;
/// Largest distance from a splat to its neighbours, in lengths of the splat's half-axis s.
const AROUND: f64 = 3.0;
/// Smallest number of neighbours of a buried splat.
const FEWEST: u32 = 8;
/// Smallest fraction of lit neighbours of a buried splat. On a thin surface whose lower side is dark, half of the
/// neighbours are lit.
const LIT: f64 = 0.6;

/// Finds the buried splats of a cloud. Returns pairs of a buried splat and its nearest lit neighbour, whose light
/// replaces the buried splat's own. `light` has one entry per splat.
pub(crate) fn buried(cloud: &SplatCloud, light: &[Light]) -> Vec<(usize, usize)> {
    let total = |i: usize| light[i].total();
    let mean = (0..light.len()).map(|i| f64::from(total(i))).sum::<f64>() / light.len().max(1) as f64;
    let (dark, bright) = (DARK * mean as f32, BRIGHT * mean as f32);
    if mean <= 0.0 || !(0..light.len()).any(|i| total(i) <= dark) {
        return Vec::new();
    }
    let order = cloud.morton_order();
    let lit_near = |at: usize| {
        let i = order[at] as usize;
        let (center, reach) = (cloud.center(i), AROUND * cloud.axes(i).0.length());
        let window = at.saturating_sub(WINDOW)..(at + WINDOW + 1).min(order.len());
        let around = order[window].iter().map(|j| *j as usize).filter(|j| *j != i);
        let around = around.map(|j| (cloud.center(j).distance(center), j)).filter(|(distance, _)| *distance <= reach);
        let (mut count, mut lit, mut nearest) = (0u32, 0u32, None::<(f64, usize)>);
        for (distance, j) in around {
            count += 1;
            if total(j) >= bright {
                lit += 1;
                nearest = nearest.filter(|(least, _)| *least <= distance).or(Some((distance, j)));
            }
        }
        let is_buried = count >= FEWEST && f64::from(lit) >= LIT * f64::from(count);
        nearest.filter(|_| is_buried).map(|(_, j)| (i, j))
    };
    (0..order.len()).filter(|at| total(order[*at] as usize) <= dark).filter_map(lit_near).collect()
}
