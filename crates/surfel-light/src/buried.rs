//! Detection of buried splats: splats that are dark although their neighbours are lit.
//!
//! In folds of scanned surfaces, some splats are below their neighbours or face inward or along the fold, so that they
//! receive little light from the sky. Where the rims of these splats are visible, they would be dark spots.

use crate::receivers::Light;
use surfel_model::SplatCloud;

/// Largest light of a splat that counts as black, as a fraction of the mean over the cloud's splats. Where light fades
/// gradually, splats have values between `DARK` and `BRIGHT`.
const DARK: f32 = 0.05;
/// Smallest light at which a neighbour of a black splat counts as lit, as a fraction of the mean over the cloud's
/// splats.
const BRIGHT: f32 = 0.25;
/// Number of splats before and after a splat, in Morton order, that are searched for its neighbours.
const WINDOW: usize = 32;
/// Largest distance of a splat's neighbours from its centre, in lengths of its half-axis s.
const AROUND: f64 = 3.0;
/// Smallest number of neighbours from which a splat can count as buried.
const FEWEST: u32 = 8;
/// Fraction of its neighbours that must be lit for a black splat to count as buried. On a thin surface whose lower side
/// is dark, only half of the neighbours are lit.
const MIN_LIT_FRACTION: f64 = 0.6;
/// Ratio of a neighbour's light to the light of a splat that isn't black, from which the neighbour counts as lit.
const BRIGHTER: f32 = 2.0;
/// Fraction of its neighbours that must be lit for a splat that isn't black to count as buried. At the corner of a
/// shadow with right angles, only three quarters of the neighbours are lit.
const MIN_LIT_FRACTION_UNLESS_BLACK: f64 = 0.8;

/// Finds the buried splats of a cloud: dark ones whose neighbours are mostly lit. Returns pairs of a buried splat and
/// its nearest lit neighbour, whose light replaces the buried splat's own. `light` has one entry per splat.
pub(crate) fn buried(cloud: &SplatCloud, light: &[Light]) -> Vec<(usize, usize)> {
    let mean = light.iter().map(|own| f64::from(own.total())).sum::<f64>() / light.len().max(1) as f64;
    if mean <= 0.0 {
        return Vec::new();
    }
    let (dark, bright) = (DARK * mean as f32, BRIGHT * mean as f32);
    let order = cloud.morton_order();
    let total: Vec<f32> = order.iter().map(|i| light[*i as usize].total()).collect();
    let lit_near = |at: usize| {
        let window = at.saturating_sub(WINDOW)..(at + WINDOW + 1).min(order.len());
        let (least, fraction) = if total[at] <= dark {
            (bright, MIN_LIT_FRACTION)
        } else {
            (BRIGHTER * total[at], MIN_LIT_FRACTION_UNLESS_BLACK)
        };
        // Distances are computed only where enough splats are lit.
        let lit = total[window.clone()].iter().filter(|light| **light >= least).count();
        if (lit as f64) < fraction * f64::from(FEWEST) {
            return None;
        }
        let i = order[at] as usize;
        let (center, reach) = (cloud.center(i), AROUND * cloud.axes(i).0.length());
        let (mut count, mut lit, mut nearest) = (0u32, 0u32, None::<(f64, usize)>);
        for other in window.filter(|other| *other != at) {
            let j = order[other] as usize;
            let distance = cloud.center(j).distance(center);
            if distance > reach {
                continue;
            }
            count += 1;
            if total[other] >= least {
                lit += 1;
                nearest = nearest.filter(|(least, _)| *least <= distance).or(Some((distance, j)));
            }
        }
        let is_buried = count >= FEWEST && f64::from(lit) >= fraction * f64::from(count);
        nearest.filter(|_| is_buried).map(|(_, j)| (i, j))
    };
    (0..order.len()).filter_map(lit_near).collect()
}
