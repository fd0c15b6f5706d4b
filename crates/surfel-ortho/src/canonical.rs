//! Canonical coordinates: identical numbers for the same points, whatever the file format.
//!
//! LAS files store multiples of a scale, text files store decimals, and PLY and NPY files store 32-bit or 64-bit
//! floats. Each reader has its own rounding error, at most 2⁻²⁴ of the distance from an origin. But a surface model is
//! identical to the last bit only if its points are. Therefore, coordinates that are multiples of a decimal step to
//! within the rounding error are replaced by these multiples. Other coordinates near the origin are rounded to 32-bit
//! floats. No coordinate moves by more than its rounding error.

use glam::DVec3;
use rayon::prelude::*;
use surfel_model::PointCloud;

/// Largest number of decimal places that are tried for the step of coordinates: the finest decade is 10⁻⁸.
const MAX_DIGITS: i32 = 8;
/// Steps that are tried in each decade 1, 0.1, …, as numerator and denominator: 1, 0.5, 0.25 and 0.2.
const STEPS: [(f64, f64); 4] = [(1.0, 1.0), (5.0, 10.0), (25.0, 100.0), (2.0, 10.0)];
/// Largest rounding error of coordinates, relative to a step, at which the step is tried.
const MAX_OF_A_STEP: f64 = 0.3;
/// Step of the coordinates in COPC files, as a fraction of the file's extent. COPC stores multiples of 2⁻³⁰ of the
/// extent.
const COUNTED: f64 = 1.0 / (1_u64 << 30) as f64;
/// Largest distance of the points from the coordinate origin, relative to their extent, at which coordinates may have
/// been stored as 32-bit floats.
const NEAR: f64 = 32.0;

/// Rule by which the coordinates along one axis are rounded.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Axis {
    /// Rounding to the nearest multiple of the decimal step `numerator / denominator`.
    Decimal { numerator: f64, denominator: f64 },
    /// Rounding to the nearest 32-bit float.
    F32,
    /// No rounding: coordinates are used as they are.
    Exact,
}

/// Rules by which a file's coordinates x, y and z are rounded, so that they are identical for all file formats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Canonical([Axis; 3]);

impl Axis {
    /// Returns a coordinate rounded by this rule.
    fn of(self, value: f64) -> f64 {
        match self {
            // The quotient of integers is correctly rounded, so that all steps that divide the value give the same
            // number.
            Self::Decimal { numerator, denominator } => {
                (value * denominator / numerator).round() * numerator / denominator
            }
            Self::F32 => f64::from(value as f32),
            Self::Exact => value,
        }
    }
}

impl Canonical {
    /// Determines the rounding rules for the points of a file, whose bounds are `lo` and `hi`.
    pub(crate) fn new(points: &PointCloud, (lo, hi): (DVec3, DVec3)) -> Self {
        let from_origin = (lo - points.origin).abs().max((hi - points.origin).abs());
        let largest = lo.abs().max(hi.abs());
        let extent = (hi - lo).max_element();
        let in_f32 = if points.positions.low().is_some() { 0.0 } else { (-24_f64).exp2() };
        let is_near = largest.max_element() <= NEAR * extent;
        Self([0, 1, 2].map(|axis| {
            let lost = in_f32 * from_origin[axis] + COUNTED * extent + 4.0 * f64::EPSILON * largest[axis];
            // The step must be coarser than the resolution of 32-bit floats, so that coordinates in this form are
            // multiples of it, too.
            let least = if is_near { 4.0 * f64::from(f32::EPSILON) * largest[axis] } else { 0.0 };
            let step = |(numerator, denominator): &(f64, f64)| numerator / denominator;
            let is_usable = |s: &(f64, f64)| step(s) >= least && lost <= MAX_OF_A_STEP * step(s);
            let fits = |s: &(f64, f64)| {
                let axis_of = Axis::Decimal { numerator: s.0, denominator: s.1 };
                let is_multiple = |i: usize| {
                    let value = points.origin[axis] + points.positions.get(i)[axis];
                    (axis_of.of(value) - value).abs() <= lost
                };
                (0..points.len()).into_par_iter().with_min_len(4096).all(is_multiple)
            };
            let steps = (0..=MAX_DIGITS).flat_map(|digits| {
                STEPS.map(|(numerator, denominator)| (numerator, denominator * 10_f64.powi(digits)))
            });
            let found = steps.filter(is_usable).find(fits);
            match found {
                Some((numerator, denominator)) => Axis::Decimal { numerator, denominator },
                None if is_near => Axis::F32,
                None => Axis::Exact,
            }
        }))
    }

    /// Returns the position of point `i`, with each coordinate rounded by its axis's rule.
    pub(crate) fn position(&self, points: &PointCloud, i: usize) -> DVec3 {
        let p = points.origin + points.positions.get(i);
        DVec3::new(self.0[0].of(p.x), self.0[1].of(p.y), self.0[2].of(p.z))
    }

    /// Returns the corners of a bounding box, with each coordinate rounded by its axis's rule.
    pub(crate) fn bounds(&self, (lo, hi): (DVec3, DVec3)) -> (DVec3, DVec3) {
        [lo, hi].map(|p| DVec3::new(self.0[0].of(p.x), self.0[1].of(p.y), self.0[2].of(p.z))).into()
    }

    /// Returns the decimal steps of which x, y and z are multiples; `None` for an axis without a step.
    pub(crate) fn steps(&self) -> [Option<f64>; 3] {
        self.0.map(|axis| match axis {
            Axis::Decimal { numerator, denominator } => Some(numerator / denominator),
            Axis::F32 | Axis::Exact => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Column3;

    fn cloud(positions: &[DVec3]) -> PointCloud {
        let (origin, positions) = Column3::with_origin(positions);
        PointCloud { origin, positions, ..PointCloud::default() }
    }

    fn positions(points: &PointCloud) -> Vec<DVec3> {
        let canonical = Canonical::new(points, points.bounds().unwrap());
        (0..points.len()).map(|i| canonical.position(points, i)).collect()
    }

    /// Returns points with `digits` decimals, between `offset` and `offset + extent`.
    fn decimals(offset: f64, extent: f64, digits: i32) -> Vec<DVec3> {
        let per_unit = 10_f64.powi(digits);
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 / (1_u64 << 53) as f64 * extent * per_unit).floor()
        };
        (0..500).map(|_| DVec3::from([next(), next(), next()].map(|n| (offset * per_unit + n) / per_unit))).collect()
    }

    #[test]
    fn points_are_the_same_from_steps_decimals_and_floats() {
        for (offset, extent, digits) in [(0.0, 30.0, 3), (5.4e6, 300.0, 3), (637_000.0, 9_000.0, 2), (-80.0, 40.0, 4)] {
            let exact = decimals(offset, extent, digits);
            assert_eq!(positions(&cloud(&exact)), exact, "{offset} {extent}");
            // As in LAS: a product, and 32 bits relative to an origin.
            let steps: Vec<DVec3> = exact.iter().map(|p| *p + DVec3::splat(3e-10)).collect();
            let (lo, hi) = cloud(&exact).bounds().unwrap();
            let origin = Column3::origin_of(lo, hi);
            let high = Column3::from_f32(steps.iter().map(|p| (*p - origin).as_vec3()).collect());
            let las = PointCloud { origin, positions: high, ..PointCloud::default() };
            if extent * (-24_f64).exp2() < 0.25 * 10_f64.powi(-digits) {
                assert_eq!(positions(&las), exact, "{offset} {extent}");
            }
            // As in COPC: steps of a power of two.
            let step = extent.log2().ceil().exp2() * COUNTED;
            let counted: Vec<DVec3> = exact.iter().map(|p| (*p / step).round() * step).collect();
            assert_eq!(positions(&cloud(&counted)), exact, "{offset} {extent}");
        }
        // Quarters of a millimetre, and half centimetres.
        let quarters: Vec<DVec3> = decimals(1000.0, 100.0, 2).iter().map(|p| *p / 40.0).collect();
        let shifted: Vec<DVec3> = quarters.iter().map(|p| *p + DVec3::splat(1e-9)).collect();
        assert_eq!(positions(&cloud(&shifted)), positions(&cloud(&quarters)));
    }

    #[test]
    fn other_numbers_move_by_their_rounding_at_most() {
        for (offset, extent) in [(0.0, 1.0), (5.4e6, 300.0)] {
            let odd: Vec<DVec3> =
                decimals(0.0, 1.0, 8).iter().map(|p| DVec3::splat(offset) + p.map(f64::sqrt) * extent).collect();
            for few in [3, 500] {
                for (a, b) in positions(&cloud(&odd[..few])).iter().zip(&odd) {
                    assert!((*a - *b).abs().max_element() <= extent * 2e-7, "{a} {b}");
                }
            }
        }
    }
}
