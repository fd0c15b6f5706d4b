// Trained Gaussians (docs/gaussians.md), and conversions of colours. Twins: surfel-math, gaussian.rs and srgb.rs.

// A projected Gaussian as linear forms of the pixel offset d from its projected centre. The pixel's ray meets the
// Gaussian's plane at (u, v)/w standard deviations and at depth z/w. Each form lists its change per pixel to the right,
// its change per pixel down and, for w and z, its value at the centre; u and v are 0 there.
struct GaussianForms {
    u: vec2f,
    v: vec2f,
    w: vec3f,
    z: vec3f,
    // Factor k of the low-pass filter, which limits ρ² to k·|d|²: on the screen a Gaussian is never smaller than the
    // filter's disk. A huge value disables the filter.
    low_pass: f32,
}

// Returns ρ², the squared distance from the Gaussian's centre in standard deviations, and the depth, at pixel offset d.
// If the ray is parallel to the plane, the depth exceeds all visible ones, since WGSL has no infinity.
fn gaussian_forms_at(forms: GaussianForms, d: vec2f) -> vec2f {
    let inverse = 1.0 / away_from_zero(fma(forms.w.x, d.x, fma(forms.w.y, d.y, forms.w.z)), 1e-37);
    let u = clamp(fma(forms.u.x, d.x, forms.u.y * d.y) * inverse, -1e18, 1e18);
    let v = clamp(fma(forms.v.x, d.x, forms.v.y * d.y) * inverse, -1e18, 1e18);
    let on_plane = fma(u, u, v * v);
    let on_screen = forms.low_pass * fma(d.x, d.x, d.y * d.y);
    return vec2f(min(on_plane, on_screen), fma(forms.z.x, d.x, fma(forms.z.y, d.y, forms.z.z)) * inverse);
}

// Returns an integer for a positive depth, rounded to 17 bits of significand. Pixels sort fragments by these integers,
// which have the order of the depths.
fn depth_step_f32(z: f32) -> u32 {
    return (bitcast<u32>(z) + 64u) >> 7u;
}

// Returns the depth that the plane `distortion` compares, from a planar depth z in world units: 0 at 0.2, 1 at 100,
// linear in 1/z.
fn distortion_depth(z: f32) -> f32 {
    return (1.0 - 0.2 / z) * 1.002004008;
}

// Largest absolute value of a colour channel: the largest f32, minus a margin for a few roundings.
const MAX_COLOR: f32 = 3.4028e38;

// Clamps a channel of a colour to ±MAX_COLOR.
fn limit_color(channel: f32) -> f32 {
    return max(min(channel, MAX_COLOR), -MAX_COLOR);
}

// Returns the linear value of an sRGB-encoded one.
fn srgb_decode(encoded: f32) -> f32 {
    let curve = pow((max(encoded, 0.0) + 0.055) / 1.055, 2.4);
    return select(curve, encoded / 12.92, encoded <= 0.04045);
}
