//! Accelerated projected gradient method for the bounded normal equations.
//!
//! A *slot* is a splat's place in the order of the k-d tree of the splats' centres ([`KdTree`](crate::tree::KdTree)).

use super::system::Gram;
use crate::parallel::{for_chunks, map_chunks};
use std::ops::{AddAssign, Mul, Sub};

/// Number of splats per parallel task.
const CHUNK: usize = 4096;

/// Number type in which the solver computes: f32, with errors of at most 3·10⁻⁶, or f64.
pub(super) trait Scalar: Copy + Default + Send + Sync + PartialOrd + From<f32> + Into<f64> + AddAssign
where
    Self: Mul<Output = Self> + Sub<Output = Self>,
{
    fn from_f64(value: f64) -> Self;
}

impl Scalar for f32 {
    fn from_f64(value: f64) -> Self {
        value as f32
    }
}

impl Scalar for f64 {
    fn from_f64(value: f64) -> Self {
        value
    }
}

/// Values of one splat in the solver: up to three channels, and zeros that fill the four lanes of a SIMD register.
pub(super) type Lanes<T> = [T; 4];

/// Smallest and largest allowed change of a splat's value in each of the four lanes ([`Lanes`]).
pub(super) type Bounds = [[f64; 2]; 4];

/// Criterion by which the solver's iteration stops.
#[derive(Clone, Copy)]
pub(super) struct Stop {
    /// Largest KKT residual at which the iteration stops. The residual is the largest change of a value by one gradient
    /// step within the bounds, whose length is 1/mass for each splat ([`Gram::mass`]).
    pub(super) residual: f64,
    /// Largest number of steps, after which the iteration stops in any case.
    pub(super) steps: usize,
}

/// Result of a minimisation by [`Problem::minimise`].
pub(super) struct Solution<T> {
    /// Change d of each splat's present values that minimises the error, by slot.
    pub(super) d: Vec<Lanes<T>>,
    pub(super) steps: usize,
    /// KKT residual of the solution, as defined in [`Stop::residual`].
    pub(super) residual: f64,
}

/// Minimisation of ½dᵀGd − bᵀd over the changes d of the splats' values, with bounds for each. G is the matrix
/// [`Self::gram`], and b the right-hand side of the normal equations.
pub(super) struct Problem<'a, T> {
    pub(super) gram: &'a Gram,
    pub(super) b: &'a [Lanes<T>],
    /// Bounds of a splat's change, which must contain 0; the argument is the splat's slot.
    pub(super) bounds: &'a (dyn Fn(usize) -> Bounds + Sync),
}

impl<T: Scalar> Problem<'_, T> {
    /// Minimises from d = 0 by FISTA (Beck and Teboulle 2009), with the step length 1/[`Gram::mass`] for each splat.
    /// The momentum is restarted if it leads uphill (O'Donoghue and Candès 2015, the gradient scheme). Calls `watch`
    /// with d after each step, and stops if `watch` returns false.
    pub(super) fn minimise(&self, stop: Stop, watch: &mut dyn FnMut(&[Lanes<T>]) -> bool) -> Solution<T> {
        let n = self.b.len();
        let mut d = vec![Lanes::default(); n];
        let mut y = d.clone();
        let mut next = d.clone();
        let steppers = self.steppers();
        let (mut t, mut steps) = (1.0f64, 0);
        while steps < stop.steps {
            let change = self.project(&steppers, &y, &d, &mut next);
            let uphill: f64 = change.iter().map(|c| c.uphill).sum();
            let largest = change.iter().map(|c| c.largest).fold(0.0, f64::max);
            steps += 1;
            let restart = uphill > 0.0;
            let from = if restart { 1.0 } else { t };
            t = 0.5 * (1.0 + (1.0 + 4.0 * from * from).sqrt());
            let momentum = T::from_f64(if restart { 0.0 } else { (from - 1.0) / t });
            for_chunks(&mut y, CHUNK, &|first, y| {
                for (k, y) in (first..).zip(y) {
                    *y = next[k];
                    for c in 0..4 {
                        y[c] += momentum * (next[k][c] - d[k][c]);
                    }
                }
            });
            std::mem::swap(&mut d, &mut next);
            if !watch(&d) || largest <= 0.8 * stop.residual && self.residual(&steppers, &d, &mut next) <= stop.residual
            {
                break;
            }
        }
        let residual = self.residual(&steppers, &d, &mut next);
        Solution { d, steps, residual }
    }

    fn steppers(&self) -> Vec<Stepper<T>> {
        let mut steppers = vec![Stepper::default(); self.b.len()];
        for_chunks(&mut steppers, CHUNK, &|first, steppers| {
            for (k, stepper) in (first..).zip(steppers) {
                let (mass, bounds) = (self.gram.mass[k], (self.bounds)(k));
                let bound = |side: usize| bounds.map(|b| T::from_f64(b[side]));
                // Splats without samples don't change.
                let step = T::from_f64(if mass > 0.0 { 1.0 / mass } else { 0.0 });
                *stepper = Stepper { low: bound(0), high: bound(1), step };
            }
        });
        steppers
    }

    /// Makes a projected gradient step from `y`, writes the result to `next`, and returns the changes per chunk of
    /// splats. `d` is the result of the previous step, from which [`Change::uphill`] is computed.
    fn project(&self, steppers: &[Stepper<T>], y: &[Lanes<T>], d: &[Lanes<T>], next: &mut [Lanes<T>]) -> Vec<Change> {
        map_chunks(next, CHUNK, &|first, next| {
            let mut change = Change::default();
            for (k, next) in (first..).zip(next) {
                let Stepper { low, high, step } = steppers[k];
                let (gd, b, y) = (self.gram.row_times(k, y), self.b[k], y[k]);
                let mut uphill = 0.0;
                for c in 0..4 {
                    let free = y[c] - step * (gd[c] - b[c]);
                    let at_least = if free < low[c] { low[c] } else { free };
                    next[c] = if at_least > high[c] { high[c] } else { at_least };
                    let moved = difference(y[c], next[c]);
                    uphill += moved * difference(next[c], d[k][c]);
                    change.largest = change.largest.max(moved.abs());
                }
                change.uphill += self.gram.mass[k] * uphill;
            }
            change
        })
    }

    fn residual(&self, steppers: &[Stepper<T>], d: &[Lanes<T>], next: &mut [Lanes<T>]) -> f64 {
        self.project(steppers, d, d, next).iter().map(|change| change.largest).fold(0.0, f64::max)
    }
}

fn difference<T: Scalar>(a: T, b: T) -> f64 {
    a.into() - b.into()
}

/// Bounds of a splat's change and the length of its gradient steps.
#[derive(Clone, Copy, Default)]
struct Stepper<T> {
    low: Lanes<T>,
    high: Lanes<T>,
    /// Length of a gradient step, 1/mass; 0 if the splat has no samples.
    step: T,
}

/// Change of the values of one chunk of splats by a gradient step.
#[derive(Clone, Copy, Default)]
struct Change {
    /// Dot product of the gradient and the movement of this step; positive if the momentum led uphill.
    uphill: f64,
    /// Largest absolute change of a value by the gradient step.
    largest: f64,
}
