// Screen-space filters (rendering model §4): they widen splats that are smaller than a pixel. h_px is the filter radius
// h in pixels. J = U·diag(ℓ)·Vᵀ is the affine projection of the half-axes s and t, in pixels, and ℓ are the half-axes
// of the projected ellipse. Twin: surfel-math, filter.rs.

// Footprint and weight of a splat after a filter.
struct Filtered {
    footprint: Footprint,
    // Factor of the weight: the ratio of the splat's area to the filtered one if the filter includes it in the weight,
    // else 1.
    weight_scale: f32,
    // Factor of the coverage (rendering model §5): the area ratio if the weight doesn't include it, else 1.
    coverage_scale: f32,
    // Map from the footprint's (u, v) to the splat's own. Only clips use it (rendering model §7).
    turn: Turn,
}

// Returns a footprint unchanged, with factors of 1.
fn filtered_unfiltered(footprint: Footprint) -> Filtered {
    return Filtered(footprint, 1.0, 1.0, turn_none());
}

// Applies `principal`, Surfel's own filter (rendering model §4): lengthens the projected ellipse's half-axes ℓ to at
// least h pixels, and multiplies the weight by ∏ min(1, ℓ/h). A half-axis of at least h stays exact; a lengthened one
// becomes parallel to the screen (Guennebaud et al. 2006 eq. 9).
fn principal(projected: Projected, h_px: f32, projective: bool) -> Filtered {
    let svd = svd2_of_columns(projected.j_s, projected.j_t, projected.det_j);
    let major = svd.major_axis;
    let minor = svd2_minor_axis(svd);
    let long = max(svd.major, h_px);
    let short = max(svd.minor, h_px);
    let u = major * (1.0 / long);
    let v = minor * (1.0 / short);
    var gradient = vec2f(0.0, 0.0);
    if projective {
        // Component of the depth gradient along each axis that isn't lengthened.
        let g = projected.depth_gradient;
        let along = select(v2_dot(g, major), 0.0, svd.major < h_px);
        let across = select(v2_dot(g, minor), 0.0, svd.minor < h_px);
        gradient = -(major * along + minor * across);
    }
    let footprint = Footprint(linear_new(0.0, u), linear_new(0.0, v), linear_new(1.0, gradient));
    return Filtered(footprint, (svd.major / long) * (svd.minor / short), 1.0, principal_turn(projected, svd));
}

// Applies `ewa` (Zwicker et al. 2001 eq. 6–9): ρ² = dᵀ(JJᵀ + h²I)⁻¹d at pixel offset d, evaluated along the ellipse's
// axes. The weight is multiplied by ∏ ℓ/√(ℓ² + h²).
fn ewa(projected: Projected, h_px: f32) -> Filtered {
    let svd = svd2_of_columns(projected.j_s, projected.j_t, projected.det_j);
    let long = sqrt(fma(svd.major, svd.major, h_px * h_px));
    let short = sqrt(fma(svd.minor, svd.minor, h_px * h_px));
    let u = svd.major_axis * (1.0 / long);
    let v = svd2_minor_axis(svd) * (1.0 / short);
    let flat_form = linear_new(1.0, vec2f(0.0, 0.0));
    let footprint = Footprint(linear_new(0.0, u), linear_new(0.0, v), flat_form);
    return Filtered(footprint, (svd.major / long) * (svd.minor / short), 1.0, principal_turn(projected, svd));
}

// Returns V of J = U·diag(ℓ)·Vᵀ: the map from coordinates along the ellipse's axes on the screen to the splat's (u, v).
// The second column is the quarter turn with the sign of det J, so that nothing is divided by the smaller value.
fn principal_turn(projected: Projected, svd: Svd2) -> Turn {
    let along = vec2f(v2_dot(projected.j_s, svd.major_axis), v2_dot(projected.j_t, svd.major_axis));
    let length = v2_length(along);
    let first = along * (1.0 / select(1.0, length, 0.0 < length));
    return Turn(first, vec2f(-first.y, first.x) * select(1.0, -1.0, projected.det_j < 0.0));
}

// Returns ∏ ℓ/max(ℓ, h): the ratio of the splat's area to the filtered one. The filters `clamp` and `adjust` multiply
// the coverage by it instead of the weight (rendering model §5).
fn area_ratio(projected: Projected, h_px: f32) -> f32 {
    let svd = svd2_of_columns(projected.j_s, projected.j_t, projected.det_j);
    return (svd.major / max(svd.major, h_px)) * (svd.minor / max(svd.minor, h_px));
}

// A projected half-axis after the filter `adjust`.
struct Lengthened {
    // The half-axis on the screen, in pixels.
    j: vec2f,
    // Change of depth along the half-axis, relative to p_z; 0 if the half-axis was lengthened, which makes it parallel
    // to the screen.
    slope: f32,
    // True if the half-axis was too short and was lengthened.
    short: bool,
}

// Lengthens the projected half-axis `j` to h pixels if its diameter projects to less than 2h. It grows along itself or,
// if it is zero, along the perpendicular of the second half-axis, `other`. `a` is the change of depth along `j`,
// relative to p_z. The test is Guennebaud et al. 2006 eq. 8 with both sides multiplied by p_z² − t_z², factored.
fn adjust_lengthen(j: vec2f, other: vec2f, a: f32, h_px: f32) -> Lengthened {
    let length = v2_length(j);
    let limit = h_px * ((1.0 - a) * (1.0 + a));
    let direction = select(j, vec2f(-other.y, other.x), length <= 0.0);
    let norm = v2_length(direction);
    let along = direction * (1.0 / select(1.0, norm, 0.0 < norm));
    if length < limit {
        return Lengthened(along * h_px, 0.0, true);
    }
    return Lengthened(j, a, false);
}

// Applies `adjust` (Guennebaud et al. 2006 §4.1, eq. 8–9) to a splat that was projected with the half-axes of
// adjust_axes_turned. Each half-axis is lengthened by itself.
fn adjust(projected: Projected, h_px: f32, projective: bool) -> Filtered {
    let s = adjust_lengthen(projected.j_s, projected.j_t, projected.slope.x, h_px);
    let t = adjust_lengthen(projected.j_t, projected.j_s, projected.slope.y, h_px);
    let determinant = select(projected.det_j, v2_cross(s.j, t.j), s.short || t.short);
    let slope = select(vec2f(0.0, 0.0), vec2f(s.slope, t.slope), projective);
    let footprint = footprint_about_center(s.j, t.j, determinant, slope);
    return Filtered(footprint, 1.0, area_ratio(projected, h_px), turn_none());
}

// Returns the half-axes that `adjust` lengthens (rendering model §4), and the map from their (u, v) to the splat's own.
//
// For an ellipse they are its principal half-axes. For a disk (half-axes equal within 1e-3) they are those of
// Guennebaud et al. 2006 eq. 10: s along p × n, t along n × s, where p is the view direction in an orthographic
// projection. The twin uses an arctangent. Here the cosine and sine of half the angle follow from the larger absolute
// value of the whole angle's cosine and sine.
fn adjust_axes_turned(splat: ViewSplat, perspective: bool) -> TurnedPair {
    let scale = radius_max(splat.s, splat.t);
    let s = splat.s * (1.0 / scale);
    let t = splat.t * (1.0 / scale);
    let difference = v3_dot(s, s) - v3_dot(t, t);
    let twice = 2.0 * v3_dot(s, t);
    let length = sqrt(sum_of_products(difference, difference, twice, twice));
    let turn = turn_by(vec2f(length + abs(difference), abs(twice)));
    // (cos, sin) of half the angle of the vector (difference, twice).
    let half = select(
        vec2f(turn.y, select(turn.x, -turn.x, twice < 0.0)),
        vec2f(turn.x, select(turn.y, -turn.y, twice < 0.0)),
        0.0 <= difference,
    );
    let pair = turned(splat.s, splat.t, half);
    if scale - v3_length(pair.t) > 1e-3 * scale {
        return TurnedPair(pair, turn_of(half));
    }
    let p = select(vec3f(0.0, 0.0, 1.0), unit(splat.p), perspective);
    let along = v3_cross(p, splat.n);
    let on_axes = vec2f(v3_dot(along, pair.s), v3_dot(along, pair.t)) * (1.0 / scale);
    // A smaller p × n has no reliable direction in f32, and a disk seen face-on needs none.
    if v3_length(along) <= 1e-7 {
        return TurnedPair(pair, turn_of(half));
    }
    let to_view = turn_by(on_axes);
    return TurnedPair(turned(pair.s, pair.t, to_view), turn_after(turn_of(half), turn_of(to_view)));
}

// Half-axes of a splat, and the map from their (u, v) to those of the half-axes that the splat was given.
struct TurnedPair {
    axes: Pair,
    turn: Turn,
}

// Returns the map from the (u, v) of the half-axes that `turned` gives to the original (u, v). `half` is the (cos, sin)
// of the angle of the turn.
fn turn_of(half: vec2f) -> Turn {
    return Turn(half, vec2f(-half.y, half.x));
}

// Returns the unit vector along v; (1, 0) for zero.
fn turn_by(v: vec2f) -> vec2f {
    let largest = max(abs(v.x), abs(v.y));
    if !(0.0 < largest) {
        return vec2f(1.0, 0.0);
    }
    let scaled = v * (1.0 / largest);
    return scaled * (1.0 / v2_length(scaled));
}

// Turns half-axes s and t by an angle, given as (cos, sin): returns s·cos + t·sin and t·cos − s·sin, another pair of
// conjugate half-axes of the same ellipse.
fn turned(s: vec3f, t: vec3f, turn: vec2f) -> Pair {
    return Pair(s * turn.x + t * turn.y, t * turn.x - s * turn.y);
}
