// Front- and back-facing splats of one oriented surface (rendering model §2, §5). Twin: surfel-math, facing.rs.

// Fraction of its ε by which a back-facing fragment has to be nearer than all front-facing ones, so that the pixel
// shows its side.
const BACK_FACING_LAG: f32 = 0.125;

// Sine of 10°. A back-facing splat is lit like a front-facing one if the angle between its plane and the ray to it is
// smaller.
const RIM_SINE: f32 = 0.173648178;

// Returns the depth by which a fragment competes for the side that its pixel shows.
fn nearness(z: f32, epsilon: f32, back_facing: bool) -> f32 {
    return select(z, fma(BACK_FACING_LAG, epsilon, z), back_facing);
}

// Returns the depth limit of blending with the side that a pixel shows, from the nearest depths of both sides.
fn sheet_limit(shown: f32, other: f32) -> f32 {
    return (shown + other) * 0.5;
}

// Returns the shading normal of a back-facing splat of an oriented two-sided surface: reversed, or near the contour
// mirrored in the plane across the ray.
fn back_normal(shading: vec3f, cosine: f32, to_eye: vec3f) -> vec3f {
    let along = v3_dot(shading, to_eye);
    let mirrored = shading - to_eye * (min(along, 0.0) * 2.0);
    return select(-shading, mirrored, abs(cosine) <= RIM_SINE);
}
