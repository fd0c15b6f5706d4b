// Footprints as linear forms over pixels (rendering model §3). Twin: surfel-math, mapping.rs.
//
// Source: Guennebaud et al. 2006 §3: at pixel offset d from the projected centre, (u·w, v·w, w) = (U(d), V(d), W(d)).
// (u, v) is the position on the splat's unit disk, and w is 1/z up to a factor that makes W(0) = 1.

// The linear form c + x·d.x + y·d.y of a pixel offset d (x to the right, y down) from an anchor. Clips also use it over
// (u, v).
struct Linear {
    c: f32,
    x: f32,
    y: f32,
}

// A splat's plane over pixel offsets: the linear forms U of u·w, V of v·w and W of w, where (u, v) is the position on
// the splat's unit disk. W is constantly 1 for an affine footprint.
struct Footprint {
    u: Linear,
    v: Linear,
    w: Linear,
}

// Creates a form from its value c at the anchor and its change per pixel to the right and down.
fn linear_new(c: f32, gradient: vec2f) -> Linear {
    return Linear(c, gradient.x, gradient.y);
}

// Returns the value of a form at offset d.
fn linear_at(form: Linear, d: vec2f) -> f32 {
    return fma(form.x, d.x, fma(form.y, d.y, form.c));
}

// Returns the values (u·w, v·w, w) of a footprint's forms at pixel offset d.
fn footprint_at(footprint: Footprint, d: vec2f) -> vec3f {
    return vec3f(linear_at(footprint.u, d), linear_at(footprint.v, d), linear_at(footprint.w, d));
}

// True if the ray through the pixel at offset d meets the splat's unit disk: W > 0 and U² + V² ≤ W², without division.
fn footprint_contains(footprint: Footprint, d: vec2f) -> bool {
    let uvw = footprint_at(footprint, d);
    return 0.0 < uvw.z && fma(uvw.x, uvw.x, uvw.y * uvw.y) <= uvw.z * uvw.z;
}

// Returns the footprint, about the projected centre, of half-axes s and t with the affine projections j_s and j_t in
// pixels. `det_j` is the determinant of their matrix. `slope` is (s_z/p_z, t_z/p_z), or zero for an affine footprint.
fn footprint_about_center(j_s: vec2f, j_t: vec2f, det_j: f32, slope: vec2f) -> Footprint {
    let inverse = 1.0 / det_j;
    let u = vec2f(j_t.y * inverse, -(j_t.x * inverse));
    let v = vec2f(-(j_s.y * inverse), j_s.x * inverse);
    let w = -(u * slope.x + v * slope.y);
    return Footprint(linear_new(0.0, u), linear_new(0.0, v), linear_new(1.0, w));
}

// Returns the footprint of a splat without a filter. If `projective` is true, it is that of the exact mapping in
// perspective; otherwise the affine one, with W ≡ 1.
fn footprint_unfiltered(projected: Projected, projective: bool) -> Footprint {
    var footprint = footprint_about_center(projected.j_s, projected.j_t, projected.det_j, vec2f(0.0, 0.0));
    if projective {
        // Near edge-on, the plane's gradient as computed from the normal is more accurate than a combination of U and
        // V.
        footprint.w = linear_new(1.0, -projected.depth_gradient);
    }
    return footprint;
}
