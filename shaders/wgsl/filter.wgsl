// Screen-space filters (rendering model §4). Twin: surfel-math, filter.rs.

struct Filtered {
    footprint: Footprint,
    // Factor of the weight: the area ratio where the filter carries it in the weight, else 1.
    weight_scale: f32,
    // Area ratio of §5's coverage where the weight doesn't carry it, else 1.
    coverage_scale: f32,
    // Brings the footprint's (u, v) back to the splat's own: only clips ask (§7).
    turn: Turn,
}

fn filtered_unfiltered(footprint: Footprint) -> Filtered {
    return Filtered(footprint, 1.0, 1.0, turn_none());
}

// Ours (§4): the projected ellipse's axes are lengthened to at least h pixels, weight × ∏ min(1, ℓ/h). An axis of at
// least h stays exact; a lengthened one becomes parallel to the screen (Guennebaud et al. 2006 eq. 9).
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
        // The depth gradient's share along each axis that keeps its length.
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

// V of J = U·diag(ℓ)·Vᵀ: from the coordinates along the ellipse's axes on the screen to the splat's (u, v). The second
// column is the quarter turn that has det J's sign: nothing is divided by the smaller value.
fn principal_turn(projected: Projected, svd: Svd2) -> Turn {
    let along = vec2f(v2_dot(projected.j_s, svd.major_axis), v2_dot(projected.j_t, svd.major_axis));
    let length = v2_length(along);
    let first = along * (1.0 / select(1.0, length, 0.0 < length));
    return Turn(first, vec2f(-first.y, first.x) * select(1.0, -1.0, projected.det_j < 0.0));
}

// ∏ ℓ/max(ℓ, h): the area ratio that `clamp` and `adjust` leave to the coverage (§5).
fn area_ratio(projected: Projected, h_px: f32) -> f32 {
    let svd = svd2_of_columns(projected.j_s, projected.j_t, projected.det_j);
    return (svd.major / max(svd.major, h_px)) * (svd.minor / max(svd.minor, h_px));
}

struct Lengthened {
    j: vec2f,
    slope: f32,
    short: bool,
}

// A projected half-axis whose diameter projects to less than 2h, made h long: along itself, or where it is zero along
// the perpendicular of the other. Guennebaud et al. 2006 eq. 8 with both sides multiplied by p_z² − t_z², factored.
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

// Guennebaud et al. 2006 §4.1, eq. 8–9, given the half-axes that adjust_axes chose: each is lengthened by itself.
fn adjust(projected: Projected, h_px: f32, projective: bool) -> Filtered {
    let s = adjust_lengthen(projected.j_s, projected.j_t, projected.slope.x, h_px);
    let t = adjust_lengthen(projected.j_t, projected.j_s, projected.slope.y, h_px);
    let determinant = select(projected.det_j, v2_cross(s.j, t.j), s.short || t.short);
    let slope = select(vec2f(0.0, 0.0), vec2f(s.slope, t.slope), projective);
    let footprint = footprint_about_center(s.j, t.j, determinant, slope);
    return Filtered(footprint, 1.0, area_ratio(projected, h_px), turn_none());
}

// The half-axes that adjust works on (§4): an ellipse's principal ones; for a disk (axes equal within 1e-3) those of
// Guennebaud et al. 2006 eq. 10, s along p × n, t along n × s, with p the view direction in an orthographic projection.
// With how their (u, v) turn back to the given ones. The twin turns by an arctangent; here half the angle comes from
// the larger of |cos| and |sin| of the whole.
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
    // f32 knows no direction of a smaller p × n, and a disk seen face-on needs none.
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

// By the angle of these cosine and sine.
fn turn_of(half: vec2f) -> Turn {
    return Turn(half, vec2f(-half.y, half.x));
}

// Unit vector along v; (1, 0) for zero.
fn turn_by(v: vec2f) -> vec2f {
    let largest = max(abs(v.x), abs(v.y));
    if !(0.0 < largest) {
        return vec2f(1.0, 0.0);
    }
    let scaled = v * (1.0 / largest);
    return scaled * (1.0 / v2_length(scaled));
}

// (s·cos + t·sin, t·cos − s·sin).
fn turned(s: vec3f, t: vec3f, turn: vec2f) -> Pair {
    return Pair(s * turn.x + t * turn.y, t * turn.x - s * turn.y);
}
