// Screen-space filters (rendering model §4). Twin: surfel-math, filter.rs.

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

fn filtered_unfiltered(footprint: Footprint) -> Filtered {
    return Filtered(footprint, 1.0, 1.0, turn_none());
}

// Surfel's own filter (rendering model §4): lengthens the projected ellipse's axes to at least h pixels, and multiplies
// the weight by ∏ min(1, ℓ/h). An axis of at least h stays exact; a lengthened one becomes parallel to the screen
// (Guennebaud et al. 2006 eq. 9).
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

// Zwicker et al. 2001 eq. 6–9: ρ² = dᵀ(JJᵀ + h²I)⁻¹d, evaluated along the ellipse's axes; weight ∏ ℓ/√(ℓ² + h²).
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

// Returns ∏ ℓ/max(ℓ, h): the area ratio that `clamp` and `adjust` apply to the coverage (rendering model §5) instead of
// the weight.
fn area_ratio(projected: Projected, h_px: f32) -> f32 {
    let svd = svd2_of_columns(projected.j_s, projected.j_t, projected.det_j);
    return (svd.major / max(svd.major, h_px)) * (svd.minor / max(svd.minor, h_px));
}

// Projected half-axis, lengthened to the filter radius h if it was too short, with its change of depth.
struct Lengthened {
    j: vec2f,
    slope: f32,
    short: bool,
}

// Returns a projected half-axis lengthened to h if its diameter projects to less than 2h: along itself, or if it is
// zero along the perpendicular of the other. Guennebaud et al. 2006 eq. 8 with both sides multiplied by p_z² − t_z²,
// factored.
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

// Guennebaud et al. 2006 §4.1, eq. 8–9, with the half-axes of adjust_axes_turned. Each is lengthened by itself.
fn adjust(projected: Projected, h_px: f32, projective: bool) -> Filtered {
    let s = adjust_lengthen(projected.j_s, projected.j_t, projected.slope.x, h_px);
    let t = adjust_lengthen(projected.j_t, projected.j_s, projected.slope.y, h_px);
    let determinant = select(projected.det_j, v2_cross(s.j, t.j), s.short || t.short);
    let slope = select(vec2f(0.0, 0.0), vec2f(s.slope, t.slope), projective);
    let footprint = footprint_about_center(s.j, t.j, determinant, slope);
    return Filtered(footprint, 1.0, area_ratio(projected, h_px), turn_none());
}

// Returns the half-axes that `adjust` lengthens (rendering model §4), and the map from their (u, v) to the given ones.
//
// The axes are an ellipse's principal ones. For a disk (axes equal within 1e-3) they are those of Guennebaud et al.
// 2006 eq. 10: s along p × n, t along n × s, where p is the view direction in an orthographic projection. The twin uses
// an arctangent; here half the angle follows from the larger of |cos| and |sin| of the whole.
fn adjust_axes_turned(splat: ViewSplat, perspective: bool) -> TurnedPair {
    let scale = radius_max(splat.s, splat.t);
    let s = splat.s * (1.0 / scale);
    let t = splat.t * (1.0 / scale);
    let difference = v3_dot(s, s) - v3_dot(t, t);
    let twice = 2.0 * v3_dot(s, t);
    let length = sqrt(sum_of_products(difference, difference, twice, twice));
    let turn = turn_by(vec2f(length + abs(difference), abs(twice)));
    // (cos, sin) of half the angle of (difference, twice).
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

struct TurnedPair {
    axes: Pair,
    turn: Turn,
}

// Returns the rotation by an angle, given its (cos, sin).
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

// Returns (s·cos + t·sin, t·cos − s·sin).
fn turned(s: vec3f, t: vec3f, turn: vec2f) -> Pair {
    return Pair(s * turn.x + t * turn.y, t * turn.x - s * turn.y);
}
