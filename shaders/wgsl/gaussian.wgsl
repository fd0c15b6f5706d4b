// Trained Gaussians (docs/gaussians.md). Twins: surfel-math, gaussian.rs and srgb.rs.

// Linear forms of the offset d of a pixel from a projected centre. The ray intersects the Gaussian's plane at (u, v)/w
// standard deviations and at depth z/w.
struct GaussianForms {
    u: vec2f,
    v: vec2f,
    w: vec3f,
    z: vec3f,
    // Factor of |d|² in the low-pass filter, a disk on the screen that a Gaussian is never smaller than.
    low_pass: f32,
}

// Returns ρ² and the depth. WGSL has no infinity: if the ray is parallel to the plane, the depth exceeds all visible
// ones.
fn gaussian_forms_at(forms: GaussianForms, d: vec2f) -> vec2f {
    let inverse = 1.0 / away_from_zero(fma(forms.w.x, d.x, fma(forms.w.y, d.y, forms.w.z)), 1e-37);
    let u = clamp(fma(forms.u.x, d.x, forms.u.y * d.y) * inverse, -1e18, 1e18);
    let v = clamp(fma(forms.v.x, d.x, forms.v.y * d.y) * inverse, -1e18, 1e18);
    let on_plane = fma(u, u, v * v);
    let on_screen = forms.low_pass * fma(d.x, d.x, d.y * d.y);
    return vec2f(min(on_plane, on_screen), fma(forms.z.x, d.x, fma(forms.z.y, d.y, forms.z.z)) * inverse);
}

// Returns a positive depth rounded to 17 bits of significand, by which pixels sort fragments.
fn depth_step_f32(z: f32) -> u32 {
    return (bitcast<u32>(z) + 64u) >> 7u;
}

// Returns the mapped depth that the plane `distortion` compares.
fn distortion_depth(z: f32) -> f32 {
    return (1.0 - 0.2 / z) * 1.002004008;
}

// Largest absolute value of a colour channel: the largest f32, minus a margin for a few roundings.
const LARGEST_COLOR: f32 = 3.4028e38;

// Clamps a channel of a colour to ±LARGEST_COLOR.
fn limit_color(channel: f32) -> f32 {
    return max(min(channel, LARGEST_COLOR), -LARGEST_COLOR);
}

// Returns the linear value of an sRGB-encoded one.
fn srgb_decode(encoded: f32) -> f32 {
    let curve = pow((max(encoded, 0.0) + 0.055) / 1.055, 2.4);
    return select(curve, encoded / 12.92, encoded <= 0.04045);
}
