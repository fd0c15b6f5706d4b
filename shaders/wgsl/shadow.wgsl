// Shadow map lookup (rendering model §5). Twin: surfel-math, shadow.rs and, for the slope, depth.rs.

// Bias of a shadow map lookup as a fraction of the point's depth in the map's view (orthographic: of that view's
// height).
const LOOKUP_BIAS: f32 = 5e-4;

// Returns the bias of a lookup for a point at depth z in a map's view: the distance in world units by which the point
// is moved toward the light.
fn lookup_bias(z: f32, projection: Projection) -> f32 {
    return LOOKUP_BIAS * select(z, projection.height, projection.kind == ORTHOGRAPHIC);
}

// Texels that a lookup reads along one axis: the index of the first of four, and the weights of the four, which sum to
// 1.
struct Taps {
    first: f32,
    weights: vec4f,
}

// Returns the texels that a lookup reads along one axis: those that a box of three texels' width about the point
// overlaps. `texel` is the point's coordinate in texels, where the centre of texel i is at i + ½.
fn taps(texel: f32) -> Taps {
    let from_center = texel - 0.5;
    let whole = floor(from_center);
    let share = from_center - whole;
    return Taps(whole - 1.0, tap_weights(share));
}

// Returns the weights of the four texels that a lookup reads along an axis. `share` is the position of the point
// between the centre of the second texel (0) and that of the third (1).
fn tap_weights(share: f32) -> vec4f {
    let third = 1.0 / 3.0;
    return vec4f((1.0 - share) * third, third, third, share * third);
}

// Returns the largest distance behind a polygon's depth z, in world units, at which a texel of a shadow map may still
// show the same surface. It is at most a fifth of z (orthographic: of the height of the map's view). `gradient` is the
// change of the polygon's depth per texel to the right and down.
fn slope_allowance(z: f32, gradient: vec2f, projection: Projection) -> f32 {
    let scale = select(z, projection.height, projection.kind == ORTHOGRAPHIC);
    return min(SLOPE_MARGIN_PX * v2_length(gradient), 0.2 * scale);
}
