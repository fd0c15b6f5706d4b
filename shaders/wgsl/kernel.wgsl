// The reconstruction kernel (rendering model §2). Twin: surfel-math, kernel.rs.

// Returns exp(−c·ρ²) for ρ² ≤ 1: the Gaussian of Zwicker et al. 2001 §4, cut off where its exponent reaches c.
fn weight(rho_squared: f32, cutoff: f32) -> f32 {
    return exp(-cutoff * rho_squared);
}
