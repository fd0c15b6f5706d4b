// Front- and back-facing splats of one oriented surface (rendering model §2, §5). Twin: surfel-math, facing.rs.

// Fraction of its ε by which a back-facing fragment has to lie before the front-facing ones for a pixel to show it.
const BACK_FACING_LAG: f32 = 0.125;

// Sine of the largest angle between a back-facing splat's plane and the ray to it at which it is lit as if it were
// front-facing: 10°.
const RIM_SINE: f32 = 0.173648178;

// Returns the depth of a visibility fragment that decides which side a pixel shows.
fn nearness(z: f32, epsilon: f32, back_facing: bool) -> f32 {
    return select(z, fma(BACK_FACING_LAG, epsilon, z), back_facing);
}

// Returns the depth behind which nothing blends with the side that a pixel shows, from the nearest depths of both
// sides.
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
