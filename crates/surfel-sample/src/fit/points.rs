//! Fit of a scan's colours, so that the blend of its splats approximates the measured colours.
//!
//! A *slot* is a splat's place in the order of the k-d tree of the splats' centres ([`KdTree`](crate::tree::KdTree)).

use super::kernels::Kernels;
use super::samples::{Sample, Samples};
use super::solve::{Lanes, Problem, Stop};
use super::system::{System, shares_at};
use super::{check_overlap, check_splats, ranges, within};
use crate::parallel::map_each;
use crate::{NoProgress, Progress, SampleError};
use surfel_model::{OnInvalid, SplatCloud};

/// Interval, in tree order, of the points that are held out of the first fit. The number of solver steps that predicts
/// the held-out points best is used for the fit of all points.
const HELD_OUT: usize = 10;
/// Maximum number of solver steps for the colours of points; more would only fit noise.
const STEPS: usize = 64;
/// Number of solver steps without a better prediction of held-out points after which the search for the best number
/// ends.
const PATIENCE: usize = 8;

/// Report of a fit to the colours of points.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointFitReport {
    /// Number of solver steps, starting from the colours of the blend, after which the held-out points are predicted
    /// best. `None` if the original colours predict them best.
    pub steps: Option<usize>,
    /// Root mean square error of the held-out points' colours, in linear light, as predicted by the blend of the other
    /// points. The first value is for the original colours, the second one for the fitted colours.
    pub held_out_rms: [f64; 2],
}

/// Sharpens the colours of a scan's splats, so that their blend is close to the measured colours instead of blurred,
/// without fitting noise. The cloud must have one splat per point, whose colour is the measured colour.
///
/// The fit starts with the blend's own colours and sharpens them step by step. A first pass holds out every tenth
/// point, and finds the number of steps that predicts these points best. Colours are limited to the range 0 to 1,
/// extended to the largest and smallest present value; alphas don't change. The result doesn't depend on the number of
/// threads. A cloud without colours, or with fewer than ten splats, is returned unchanged. So is a cloud whose original
/// colours predict the held-out points best.
///
/// # Errors
/// [`SampleError::TooMany`] above 33 million splats, or if more than 200 splats overlap at a place on average.
pub fn fit_point_colors(
    cloud: SplatCloud,
    progress: &dyn Progress,
) -> Result<(SplatCloud, PointFitReport), SampleError> {
    check_splats(cloud.len())?;
    let mut report = PointFitReport::default();
    if cloud.data().colors.is_none() || cloud.len() < HELD_OUT {
        return Ok((cloud, report));
    }
    let mut kernels = Kernels::new(&cloud);
    let present: Vec<[f32; 3]> = (0..kernels.len()).map(|slot| cloud.color(kernels.tree.index(slot))).collect();
    let range = ranges(present.iter());

    // Neighbours in the tree are neighbours in space, so every tenth slot selects a tenth of each neighbourhood.
    let mut is_held_out = vec![false; cloud.len()];
    for slot in (0..kernels.len()).filter(|slot| slot % HELD_OUT == HELD_OUT / 2) {
        is_held_out[kernels.tree.index(slot)] = true;
        kernels.remove(slot);
    }
    let color = |held_out: bool, i: usize| (is_held_out[i] == held_out).then(|| cloud.color(i));
    let known = Samples::of_points(&cloud, &kernels, &|i| color(false, i));
    check_overlap(&kernels, &known)?;
    let unknown = Samples::of_points(&cloud, &kernels, &|i| color(true, i));
    let rows = map_each(unknown.len(), &NoProgress, || (), |(), i| shares_at(&kernels, &unknown, &unknown.all()[i]));
    let error = |start: &[[f32; 3]], d: &[Lanes<f32>]| {
        let blend = |shares: &[(u32, f64)], c: usize| -> f64 {
            shares.iter().map(|&(k, w)| w * f64::from(start[k as usize][c] + d[k as usize][c])).sum()
        };
        let shown = unknown.all().iter().zip(&rows).filter(|(_, shares)| !shares.is_empty());
        let squared = |(sample, shares): (&Sample<3>, &Vec<(u32, f64)>)| -> f64 {
            (0..3).map(|c| (blend(shares, c) - f64::from(sample.value[c])).powi(2)).sum()
        };
        (shown.clone().map(squared).sum::<f64>() / (3 * shown.count()).max(1) as f64).sqrt()
    };
    let as_is = error(&present, &vec![Lanes::default(); kernels.len()]);
    let start = blended(&kernels, &known, &present);
    let (mut best, mut step) = ((None, as_is), 0);
    let mut watch = |d: &[Lanes<f32>]| {
        let found = error(&start, d);
        if found < best.1 {
            best = (Some(step), found);
        }
        step += 1;
        step <= best.0.unwrap_or(0) + PATIENCE
    };
    watch(&vec![Lanes::default(); kernels.len()]);
    let system = System::new(&kernels, &known, &start, progress);
    let bounds = |k: usize| within(&range, &system.local[k], &start[k]);
    let problem = Problem { gram: &system.gram, b: &system.lanes(0), bounds: &bounds };
    problem.minimise(Stop { residual: 0.0, steps: STEPS }, &mut watch);
    report.held_out_rms = [as_is, best.1];
    report.steps = best.0;
    let Some(steps) = best.0 else { return Ok((cloud, report)) };

    let kernels = Kernels::new(&cloud);
    let samples = Samples::of_points(&cloud, &kernels, &|i| Some(cloud.color(i)));
    let start = blended(&kernels, &samples, &present);
    let system = System::new(&kernels, &samples, &start, progress);
    let bounds = |k: usize| within(&range, &system.local[k], &start[k]);
    let problem = Problem { gram: &system.gram, b: &system.lanes(0), bounds: &bounds };
    let solution = problem.minimise(Stop { residual: 0.0, steps }, &mut |_| true);
    let mut colors = vec![[0.0; 3]; cloud.len()];
    let found: &[Lanes<f32>] = &solution.d;
    for (slot, (start, d)) in start.iter().zip(found).enumerate() {
        let bounded = |c: usize| (start[c] + d[c]).clamp(range[c][0] as f32, range[c][1] as f32);
        colors[kernels.tree.index(slot)] = std::array::from_fn(bounded);
    }
    let data = surfel_model::CloudData { colors: Some(colors), ..cloud.into_data() };
    Ok((SplatCloud::new(data, OnInvalid::Refuse)?.0, report))
}

/// Returns the colour of the blend at each splat's centre, by slot; splats without a sample keep their present colour.
fn blended(kernels: &Kernels, samples: &Samples<3>, present: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut slot_of = vec![0; kernels.len()];
    (0..kernels.len()).for_each(|slot| slot_of[kernels.tree.index(slot)] = slot);
    let blend = |i: usize| -> [f32; 3] {
        let shares = shares_at(kernels, samples, &samples.all()[i]);
        std::array::from_fn(|c| shares.iter().map(|&(k, w)| w * f64::from(present[k as usize][c])).sum::<f64>() as f32)
    };
    let values = map_each(samples.len(), &NoProgress, || (), |(), i| blend(i));
    let mut colors = present.to_vec();
    for (sample, value) in samples.all().iter().zip(values) {
        colors[slot_of[samples.source(sample)]] = value;
    }
    colors
}
