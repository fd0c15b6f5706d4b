// Front- and back-facing splats of one oriented surface (rendering model §2, §5). Twin: surfel-math, facing.rs.

// Fraction of its ε by which a back-facing fragment has to be nearer than all front-facing ones. Otherwise the pixel
// shows the front side.
const BACK_FACING_LAG: f32 = 0.125;

// Largest sine of the angle between a back-facing splat's plane and the ray to it at which the splat is lit like a
// front-facing one: the sine of 10°.
const RIM_SINE: f32 = 0.173648178;

// Returns the depth by which a fragment competes for the side that its pixel shows.
fn nearness(z: f32, epsilon: f32, back_facing: bool) -> f32 {
    return select(z, fma(BACK_FACING_LAG, epsilon, z), back_facing);
}

// Returns the depth limit of blending with the side that a pixel shows, from the nearest depths of both sides.
fn sheet_limit(shown: f32, other: f32) -> f32 {
    return (shown + other) * 0.5;
}

// Returns the shading normal of a back-facing splat of an oriented two-sided surface. It is the reversed normal, or
// near the contour the normal mirrored in the plane across the ray.
fn back_normal(shading: vec3f, cosine: f32, to_eye: vec3f) -> vec3f {
    let along = v3_dot(shading, to_eye);
    let mirrored = shading - to_eye * (min(along, 0.0) * 2.0);
    return select(-shading, mirrored, abs(cosine) <= RIM_SINE);
}
