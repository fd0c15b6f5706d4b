//! The reconstruction kernel and coverage (rendering model §2, §5).

/// Returns the kernel's weight w = exp(−c·ρ²), for the cutoff c in (0, 50]. ρ² ≤ 1 is the squared distance from the
/// centre, in radii. The kernel is Z01 §4's Gaussian, cut off where its exponent reaches c.
#[inline(always)]
pub fn weight(rho_squared: f64, cutoff: f64) -> f64 {
    (-cutoff * rho_squared).exp()
}

/// Smallest coverage q at which a surface that is blended by coverage counts as opaque: Z01 §7's τ at c = 1 (rendering
/// model §6, §8).
pub const FULL_COVERAGE: f64 = 0.633;

/// Converts an interior weight, the Σw inside a cloud's own surface, from cutoff 2 to another cutoff. The factor is the
/// ratio of the kernels' integrals over their disk, [(1 − e^(−c))/c]/[(1 − e^(−2))/2] (rendering model §5).
pub fn interior_weight_at_cutoff(interior_weight: f64, cutoff: f64) -> f64 {
    let integral = |c: f64| -(-c).exp_m1() / c;
    interior_weight * integral(cutoff) / integral(2.0)
}

#[cfg(test)]
mod tests {
    #[test]
    fn interior_weight_is_unchanged_at_the_cutoff_it_was_measured_at() {
        assert!((super::interior_weight_at_cutoff(5.43, 2.0) - 5.43).abs() < 1e-14);
        // A box kernel (c → 0) counts every overlapping splat fully: 2/(1 − e^−2) times as much.
        let limit = 1.0 / ((1.0 - (-2.0f64).exp()) / 2.0);
        assert!((super::interior_weight_at_cutoff(1.0, 1e-9) - limit).abs() < 1e-8);
    }
}
