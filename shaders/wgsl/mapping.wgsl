// Footprints as linear forms over pixels (rendering model §3). Twin: surfel-math, mapping.rs.
//
// Source: Guennebaud et al. 2006 §3: at offset d from the projected centre, (u·w, v·w, w) = (U(d), V(d), W(d)).

// The linear form c + x·d.x + y·d.y.
struct Linear {
    c: f32,
    x: f32,
    y: f32,
}

struct Footprint {
    u: Linear,
    v: Linear,
    w: Linear,
}

fn linear_new(c: f32, gradient: vec2f) -> Linear {
    return Linear(c, gradient.x, gradient.y);
}

fn linear_at(form: Linear, d: vec2f) -> f32 {
    return fma(form.x, d.x, fma(form.y, d.y, form.c));
}

// Returns (U, V, W) at an offset.
fn footprint_at(footprint: Footprint, d: vec2f) -> vec3f {
    return vec3f(linear_at(footprint.u, d), linear_at(footprint.v, d), linear_at(footprint.w, d));
}

// True if the unit disk is hit: W > 0 and U² + V² ≤ W², without division.
fn footprint_contains(footprint: Footprint, d: vec2f) -> bool {
    let uvw = footprint_at(footprint, d);
    return 0.0 < uvw.z && fma(uvw.x, uvw.x, uvw.y * uvw.y) <= uvw.z * uvw.z;
}

// Returns the footprint of half-axes with affine projections j_s, j_t (pixels) and slopes s_z/p_z, t_z/p_z (zero:
// affine).
fn footprint_about_center(j_s: vec2f, j_t: vec2f, det_j: f32, slope: vec2f) -> Footprint {
    let inverse = 1.0 / det_j;
    let u = vec2f(j_t.y * inverse, -(j_t.x * inverse));
    let v = vec2f(-(j_s.y * inverse), j_s.x * inverse);
    let w = -(u * slope.x + v * slope.y);
    return Footprint(linear_new(0.0, u), linear_new(0.0, v), linear_new(1.0, w));
}

// Returns the projective footprint, or the affine one (W ≡ 1; always so in an orthographic projection).
fn footprint_unfiltered(projected: Projected, projective: bool) -> Footprint {
    var footprint = footprint_about_center(projected.j_s, projected.j_t, projected.det_j, vec2f(0.0, 0.0));
    if projective {
        // The plane's own gradient, from the normal, is more accurate near edge-on than a combination of U and V.
        footprint.w = linear_new(1.0, -projected.depth_gradient);
    }
    return footprint;
}
