// Screen-space filters (rendering model §4). Twin: surfel-math, filter.rs.

struct Filtered {
    footprint: Footprint,
    // Factor of the weight: the area ratio where the filter carries it in the weight, else 1.
    weight_scale: f32,
    // Area ratio of §5's coverage where the weight doesn't carry it, else 1.
    coverage_scale: f32,
}

fn filtered_plain(footprint: Footprint) -> Filtered {
    return Filtered(footprint, 1.0, 1.0);
}

// Ours (§4): the projected ellipse's axes are lengthened to at least h pixels, weight × ∏ min(1, ℓ/h). An axis of at least
// h stays exact; a lengthened one becomes parallel to the screen (Guennebaud et al. 2006 eq. 9).
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
    return Filtered(footprint, (svd.major / long) * (svd.minor / short), 1.0);
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
    return Filtered(footprint, (svd.major / long) * (svd.minor / short), 1.0);
}

// ∏ ℓ/max(ℓ, h): the area ratio that `clamp` and `adjust` leave to the coverage (§5).
fn area_ratio(projected: Projected, h_px: f32) -> f32 {
    let svd = svd2_of_columns(projected.j_s, projected.j_t, projected.det_j);
    return (svd.major / max(svd.major, h_px)) * (svd.minor / max(svd.minor, h_px));
}
