//! Normal equations of a fit as a sparse matrix with one row per splat, in tree order.
//!
//! A *slot* is a splat's place in the order of the k-d tree of the splats' centres ([`KdTree`](crate::tree::KdTree)). A
//! *cell* is a cubic cell of the grid into which samples are sorted ([`Samples`]).

use super::kernels::{Kernels, Sphere};
use super::samples::{Sample, Samples};
use super::solve::{Lanes, Scalar};
use crate::parallel::{map_each, map_tasks};
use crate::progress::{NoProgress, Progress};
use glam::DVec3;
use std::ops::Range;

/// Number of matrix rows that one task computes. It is fixed, so that sums don't depend on the number of threads.
const OWN: usize = 2048;
/// Largest relative difference of two values that counts as rounding. An f32 value is multiplied by weights whose sum
/// has four roundings.
const ROUNDING: f32 = 4.0 * f32::EPSILON;

/// Matrix G of the normal equations, with sparse rows: G_kj = Σ ω·r̂_k·r̂_j over the samples. ω is a sample's weight in
/// the fit, and r̂_k = w_k/Σw the normalised weight of splat k at the sample.
#[derive(Default)]
pub(super) struct Gram {
    /// Index of each row's first entry, followed by the number of all entries.
    pub(super) starts: Vec<usize>,
    pub(super) columns: Vec<u32>,
    pub(super) values: Vec<f32>,
    /// Sum of each row's entries. Since no entry is negative, diag(mass) − G is positive semidefinite (Gershgorin).
    pub(super) mass: Vec<f64>,
}

impl Gram {
    /// Returns row `k` of the product G·d.
    pub(super) fn row_times<T: Scalar>(&self, k: usize, d: &[Lanes<T>]) -> Lanes<T> {
        let mut sum = Lanes::default();
        let entries = self.starts[k]..self.starts[k + 1];
        for (column, value) in self.columns[entries.clone()].iter().zip(&self.values[entries]) {
            let (d, value) = (&d[*column as usize], T::from(*value));
            for c in 0..4 {
                sum[c] += value * d[c];
            }
        }
        sum
    }
}

/// Normal equations of a fit: minimisation of ½dᵀGd − bᵀd over the change d of the splats' present values. Its N
/// channels share the matrix G ([`Gram`]), and each has a right-hand side b of its own.
pub(super) struct System<const N: usize> {
    pub(super) gram: Gram,
    /// Right-hand side b_k = Σ ω·r̂_k·(f − Σ r̂_j·c_j). ω are the samples' weights, f their values, r̂ the splats'
    /// normalised weights ([`Gram`]), and c the splats' present values.
    pub(super) b: Vec<[f64; N]>,
    /// Change of each splat's value that view-independent EWA would make. It is the mean difference of the samples'
    /// values from the splat's present value, weighted by the splat's weight w at the samples.
    pub(super) ewa: Vec<[f64; N]>,
    /// Smallest and largest value of the samples under each splat, per channel; infinities in reverse order if there
    /// are none.
    pub(super) local: Vec<[[f32; 2]; N]>,
    /// Weighted squared error Σ ω·(f − Σ r̂_j·c_j)² of each channel for the present values, with the symbols of
    /// [`Self::b`], over the samples that some splat covers.
    energy: [f64; N],
    /// Sum of the weights, Σ ω, of the samples that some splat covers.
    weight: f64,
}

impl<const N: usize> System<N> {
    /// Builds the equations; `present` are the splats' values, by slot.
    pub(super) fn new(kernels: &Kernels, samples: &Samples<N>, present: &[[f32; N]], progress: &dyn Progress) -> Self {
        let tasks = kernels.len().div_ceil(OWN);
        progress.stage("texture", tasks as u64);
        let near = map_each(
            samples.cells(),
            &NoProgress,
            || (),
            |(), cell| {
                let (center, radius) = sphere(samples, samples.of_cell(cell));
                kernels.near(center, radius)
            },
        );
        let mut cells = vec![Vec::new(); tasks];
        for (cell, near) in near.iter().enumerate() {
            // Slots ascend, and so do their tasks.
            for slots in near.chunk_by(|a, b| *a as usize / OWN == *b as usize / OWN) {
                cells[slots[0] as usize / OWN].push(cell);
            }
        }
        let parts = map_tasks(tasks, |task| {
            let own = task * OWN..kernels.len().min((task + 1) * OWN);
            let near = cells[task].iter().map(|&cell| (samples.of_cell(cell), &*near[cell]));
            let part = Part::new(kernels, samples, present, own, near);
            progress.advance(1);
            part
        });
        drop(near);
        let entries: usize = parts.iter().map(|p| p.columns.len()).sum();
        let mut gram = Gram {
            starts: vec![0],
            columns: Vec::with_capacity(entries),
            values: Vec::with_capacity(entries),
            mass: Vec::new(),
        };
        let (mut b, mut ewa) = (Vec::with_capacity(kernels.len()), Vec::with_capacity(kernels.len()));
        let mut local = Vec::with_capacity(kernels.len());
        let (mut energy, mut weight) = ([0.0; N], 0.0);
        for part in parts {
            for length in part.lengths {
                gram.starts.push(gram.starts[gram.starts.len() - 1] + length);
            }
            gram.columns.extend(part.columns);
            gram.values.extend(part.values);
            b.extend(part.b);
            ewa.extend(part.ewa);
            local.extend(part.local);
            weight += part.weight;
            energy.iter_mut().zip(part.energy).for_each(|(sum, e)| *sum += e);
        }
        let row_sum = |k: usize| gram.values[gram.starts[k]..gram.starts[k + 1]].iter().map(|v| f64::from(*v)).sum();
        gram.mass = (0..kernels.len()).map(row_sum).collect();
        Self { gram, b, ewa, local, energy, weight }
    }

    /// Returns the root mean square error of the blend of present values over the samples that some splat covers, per
    /// channel.
    pub(super) fn rms(&self) -> [f64; N] {
        self.energy.map(|e| (e / self.weight.max(f64::MIN_POSITIVE)).sqrt())
    }

    /// Returns the root mean square error of the blend after the change `d` of the splats' values, for up to three
    /// channels from `first` on.
    pub(super) fn rms_after<T: Scalar>(&self, first: usize, d: &[Lanes<T>]) -> [f64; 3] {
        let mut energy: [f64; 3] = std::array::from_fn(|c| self.energy.get(first + c).copied().unwrap_or(0.0));
        let added = map_tasks(self.b.len().div_ceil(OWN), |task| {
            let mut added = [0.0; 3];
            for k in task * OWN..self.b.len().min((task + 1) * OWN) {
                let gd = self.gram.row_times(k, d);
                for (c, e) in added.iter_mut().enumerate().take(N - first) {
                    *e += d[k][c].into() * (gd[c].into() - 2.0 * self.b[k][first + c]);
                }
            }
            added
        });
        added.iter().for_each(|added| energy.iter_mut().zip(added).for_each(|(e, a)| *e += a));
        energy.map(|e| (e.max(0.0) / self.weight.max(f64::MIN_POSITIVE)).sqrt())
    }

    /// Returns the right-hand side b as [`Lanes`], for up to three channels from `first` on; unused lanes are 0.
    pub(super) fn lanes<T: Scalar>(&self, first: usize) -> Vec<Lanes<T>> {
        let lane = |b: &[f64; N], c: usize| if c < 3 { b.get(first + c).copied().unwrap_or(0.0) } else { 0.0 };
        self.b.iter().map(|b| std::array::from_fn(|c| T::from_f64(lane(b, c)))).collect()
    }
}

/// Matrix rows and right-hand sides of the splats of one task.
#[derive(Clone)]
struct Part<const N: usize> {
    lengths: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f32>,
    b: Vec<[f64; N]>,
    ewa: Vec<[f64; N]>,
    local: Vec<[[f32; 2]; N]>,
    energy: [f64; N],
    weight: f64,
}

impl<const N: usize> Default for Part<N> {
    fn default() -> Self {
        Self {
            lengths: Vec::new(),
            columns: Vec::new(),
            values: Vec::new(),
            b: Vec::new(),
            ewa: Vec::new(),
            local: Vec::new(),
            energy: [0.0; N],
            weight: 0.0,
        }
    }
}

impl<const N: usize> Part<N> {
    /// Computes the rows of the splats at the slots `own`. `cells` are the cells close to these splats; each is given
    /// by its samples, and by the slots of all splats close to it.
    fn new<'a>(
        kernels: &Kernels,
        samples: &Samples<N>,
        present: &[[f32; N]],
        own: Range<usize>,
        cells: impl Iterator<Item = (&'a [Sample<N>], &'a [u32])>,
    ) -> Self {
        let mut part = Self { b: vec![[0.0; N]; own.len()], ..Self::default() };
        part.local = vec![[[f32::INFINITY, f32::NEG_INFINITY]; N]; own.len()];
        let mut rows: Vec<Vec<(u32, f64)>> = vec![Vec::new(); own.len()];
        let mut ewa = vec![([0.0; N], 0.0); own.len()];
        let (mut near, mut hits, mut block) = (Near::default(), Vec::new(), Vec::new());
        for (cell, slots) in cells {
            near.set(kernels, slots);
            let first = slots.partition_point(|slot| (*slot as usize) < own.start);
            let last = slots.partition_point(|slot| (*slot as usize) < own.end);
            block.clear();
            block.resize((last - first) * slots.len(), 0.0);
            for sample in cell {
                let Some(total) = shares(kernels, samples, sample, &near, first..last, &mut hits) else {
                    continue;
                };
                let weight = f64::from(sample.weight);
                let missing = missing(&sample.value, present, &near, &hits);
                let is_first = hits.first().is_some_and(|(place, _)| (first..last).contains(place));
                if is_first {
                    part.weight += weight;
                    part.energy.iter_mut().zip(missing).for_each(|(sum, m)| *sum += weight * m * m);
                }
                for &(k, share) in hits.iter().filter(|(place, _)| (first..last).contains(place)) {
                    let share = weight * share;
                    let row = &mut block[(k - first) * slots.len()..(k - first + 1) * slots.len()];
                    for &(j, other) in &hits {
                        row[j] += share * other;
                    }
                    let slot = slots[k] as usize;
                    let own_row = slot - own.start;
                    let (sum, mass) = &mut ewa[own_row];
                    *mass += share * total;
                    for c in 0..N {
                        let [least, largest] = part.local[own_row][c];
                        part.local[own_row][c] = [least.min(sample.value[c]), largest.max(sample.value[c])];
                        part.b[own_row][c] += share * missing[c];
                        sum[c] += share * total * f64::from(difference(sample.value[c], present[slot][c]));
                    }
                }
            }
            for (k, values) in (first..last).zip(block.chunks(slots.len())) {
                let entries = slots.iter().zip(values).filter(|(_, v)| **v != 0.0).map(|(j, v)| (*j, *v));
                rows[slots[k] as usize - own.start].extend(entries);
            }
        }
        for row in &mut rows {
            // The sort is stable, so that the terms of a sum stay in the order of their cells.
            row.sort_by_key(|(column, _)| *column);
            let before = part.columns.len();
            for same in row.chunk_by(|a, b| a.0 == b.0) {
                part.columns.push(same[0].0);
                part.values.push(same.iter().map(|(_, v)| v).sum::<f64>() as f32);
            }
            part.lengths.push(part.columns.len() - before);
        }
        let mean = |(sum, mass): ([f64; N], f64)| if mass > 0.0 { sum.map(|s| s / mass) } else { [0.0; N] };
        part.ewa = ewa.into_iter().map(mean).collect();
        part
    }
}

/// Splats close to a cell, and the spheres in which they have weight. The spheres are contiguous in memory, because
/// most splats are excluded from a sample by their sphere alone.
#[derive(Default)]
struct Near {
    slots: Vec<u32>,
    spheres: Vec<Sphere>,
}

impl Near {
    fn set(&mut self, kernels: &Kernels, slots: &[u32]) {
        self.slots.clear();
        self.slots.extend(slots);
        self.spheres.clear();
        self.spheres.extend(slots.iter().map(|slot| kernels.sphere(*slot)));
    }
}

/// Computes the normalised weights w/Σw of the splats at a sample. Fills `hits` with the indices in `near` of the
/// splats with weight, ascending, and their normalised weights. Returns Σw; `None` if the sample's own weight is 0, or
/// if no splat with an index in `own` has weight.
fn shares<const N: usize>(
    kernels: &Kernels,
    samples: &Samples<N>,
    sample: &Sample<N>,
    near: &Near,
    own: Range<usize>,
    hits: &mut Vec<(usize, f64)>,
) -> Option<f64> {
    let (point, normal) = (samples.point(sample), samples.normal(sample));
    hits.clear();
    let weight = |place: usize| {
        let reaches = near.spheres[place].contains(point);
        if reaches { kernels.get(near.slots[place] as usize).weight(point, normal) } else { 0.0 }
    };
    if sample.weight <= 0.0 || !own.into_iter().any(|place| weight(place) > 0.0) {
        return None;
    }
    for place in 0..near.slots.len() {
        let w = weight(place);
        if w > 0.0 {
            hits.push((place, w));
        }
    }
    let total: f64 = hits.iter().map(|(_, w)| w).sum();
    hits.iter_mut().for_each(|(_, w)| *w /= total);
    Some(total)
}

/// Returns the difference of a sample's value from the blend of present values there, per channel. The difference is
/// exactly 0 if all blended values equal the sample's.
fn missing<const N: usize>(value: &[f32; N], present: &[[f32; N]], near: &Near, hits: &[(usize, f64)]) -> [f64; N] {
    let mut missing = [0.0; N];
    for (place, share) in hits {
        let present = &present[near.slots[*place] as usize];
        for c in 0..N {
            missing[c] += share * f64::from(difference(value[c], present[c]));
        }
    }
    missing
}

/// Returns the difference of two values, or 0 if it is within [`ROUNDING`].
fn difference(a: f32, b: f32) -> f32 {
    let d = a - b;
    if d.abs() <= ROUNDING * a.abs().max(b.abs()) { 0.0 } else { d }
}

/// Returns the centre and radius of a sphere around the samples of a cell.
fn sphere<const N: usize>(samples: &Samples<N>, cell: &[Sample<N>]) -> (DVec3, f64) {
    let points = || cell.iter().map(|s| samples.point(s));
    let (lo, hi) = points().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
    let center = 0.5 * (lo + hi);
    (center, points().map(|p| p.distance(center)).fold(0.0, f64::max))
}

/// Returns the slot and the normalised weight w/Σw of each splat that has weight at a sample.
pub(super) fn shares_at<const N: usize>(
    kernels: &Kernels,
    samples: &Samples<N>,
    sample: &Sample<N>,
) -> Vec<(u32, f64)> {
    let (mut near, mut hits) = (Near::default(), Vec::new());
    let slots = kernels.near(samples.point(sample), 0.0);
    near.set(kernels, &slots);
    shares(kernels, samples, sample, &near, 0..slots.len(), &mut hits);
    hits.iter().map(|(place, share)| (slots[*place], *share)).collect()
}
