// The reconstruction kernel (rendering model §2). Twin: surfel-math, kernel.rs.

// Returns the weight of a splat, exp(−c·ρ²), at squared distance ρ² from its centre, where ρ² = 1 is the rim and c the
// cutoff. Callers ensure ρ² ≤ 1. It is the Gaussian of Zwicker et al. 2001 §4, cut off where its exponent reaches c.
fn weight(rho_squared: f32, cutoff: f32) -> f32 {
    return exp(-cutoff * rho_squared);
}
