// Looking up a shadow map (rendering model §5). Twin: surfel-math, shadow.rs and, for the slope, depth.rs.

const LOOKUP_BIAS: f32 = 5e-4;

// How much nearer to the light than it is a point at depth z of a map counts.
fn lookup_bias(z: f32, projection: Projection) -> f32 {
    return LOOKUP_BIAS * select(z, projection.height, projection.kind == ORTHOGRAPHIC);
}

struct Taps {
    first: f32,
    weights: vec4f,
}

// The texels along an axis that a lookup reads: a box three texels wide about the point.
fn taps(texel: f32) -> Taps {
    let from_center = texel - 0.5;
    let whole = floor(from_center);
    let share = from_center - whole;
    return Taps(whole - 1.0, tap_weights(share));
}

// Of the taps, by how far the point lies from the second texel's centre towards the third's.
fn tap_weights(share: f32) -> vec4f {
    let third = 1.0 / 3.0;
    return vec4f((1.0 - share) * third, third, third, share * third);
}

// How far behind a polygon's depth z its own surface may lie within a texel.
fn slope_allowance(z: f32, gradient: vec2f, projection: Projection) -> f32 {
    let scale = select(z, projection.height, projection.kind == ORTHOGRAPHIC);
    return min(SLOPE_MARGIN_PX * v2_length(gradient), 0.2 * scale);
}
