// Shadow map lookup (rendering model §5). Twin: surfel-math, shadow.rs and, for the slope, depth.rs.

// Bias of a lookup as a fraction of the depth in the map, or of the map's height in an orthographic projection.
const LOOKUP_BIAS: f32 = 5e-4;

// Returns the bias of a lookup at depth z of a map: the distance by which the point is moved toward the light.
fn lookup_bias(z: f32, projection: Projection) -> f32 {
    return LOOKUP_BIAS * select(z, projection.height, projection.kind == ORTHOGRAPHIC);
}

// Texels along an axis that a lookup reads: the first of four, and their weights.
struct Taps {
    first: f32,
    weights: vec4f,
}

// Returns the texels along an axis that a lookup reads: a box around the point, three texels wide.
fn taps(texel: f32) -> Taps {
    let from_center = texel - 0.5;
    let whole = floor(from_center);
    let share = from_center - whole;
    return Taps(whole - 1.0, tap_weights(share));
}

// Returns the weights of the four texels that a lookup reads along an axis. `share` is the position of the point
// between the second texel's centre (0) and the third's (1).
fn tap_weights(share: f32) -> vec4f {
    let third = 1.0 / 3.0;
    return vec4f((1.0 - share) * third, third, third, share * third);
}

// Returns the largest distance behind a polygon's depth z at which a texel may still show the same surface.
fn slope_allowance(z: f32, gradient: vec2f, projection: Projection) -> f32 {
    let scale = select(z, projection.height, projection.kind == ORTHOGRAPHIC);
    return min(SLOPE_MARGIN_PX * v2_length(gradient), 0.2 * scale);
}
