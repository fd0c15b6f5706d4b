// Singular values of 2×2 matrices. Twin: surfel-math, svd.rs.

// The parts U and ℓ of the singular value decomposition J = U·diag(ℓ)·Vᵀ of a 2×2 matrix: for a projected splat, the
// directions and lengths of the ellipse's half-axes on the screen.
struct Svd2 {
    // Larger and smaller singular value, at least 0.
    major: f32,
    minor: f32,
    // First column of U: the unit vector along the larger half-axis. The second column is its quarter turn.
    major_axis: vec2f,
}

// Decomposes the matrix with columns s and t, whose determinant is `determinant`. The caller may know the determinant
// more precisely than the columns give it.
fn svd2_of_columns(s: vec2f, t: vec2f, determinant: f32) -> Svd2 {
    let scale = max(max(abs(s.x), abs(s.y)), max(abs(t.x), abs(t.y)));
    let safe = select(1.0, scale, 0.0 < scale);
    let inverse = 1.0 / safe;
    let a = s.x * inverse;
    let b = t.x * inverse;
    let c = s.y * inverse;
    let d = t.y * inverse;
    // JJᵀ = [[p, q], [q, r]]; (cos 2φ, sin 2φ) of its major axis is along ((p − r)/2, q). The difference is factored,
    // since it would cancel exactly where p ≈ r.
    let difference = sum_of_products(a + c, a - c, b + d, b - d) * 0.5;
    let q = sum_of_products(a, c, b, d);
    let sum = (fma(a, a, b * b) + fma(c, c, d * d)) * 0.5;
    let length = sqrt(sum_of_products(difference, difference, q, q));
    let major = sqrt(sum + length);
    // Half the angle, from the larger of |cos| and |sin| so that nothing cancels.
    let positive = 0.0 <= difference;
    let big = length + abs(difference);
    let x = select(abs(q), big, positive);
    let y = select(select(big, -big, q < 0.0), q, positive);
    let norm = sqrt(sum_of_products(x, x, y, y));
    let round = norm <= 0.0;
    let inverse_norm = 1.0 / select(norm, 1.0, round);
    let major_axis = vec2f(select(x * inverse_norm, 1.0, round), y * inverse_norm);
    let major_px = major * scale;
    let safe_major = select(1.0, major_px, 0.0 < major_px);
    // For a circle, rounding may put the quotient above the larger value.
    let minor = min(abs(determinant) / safe_major, major_px);
    return Svd2(major_px, minor, major_axis);
}

// Returns the second column of U: the unit vector along the smaller half-axis.
fn svd2_minor_axis(svd: Svd2) -> vec2f {
    return vec2f(-svd.major_axis.y, svd.major_axis.x);
}
