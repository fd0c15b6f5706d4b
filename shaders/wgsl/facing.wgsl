// Front- and back-facing splats of one oriented surface (rendering model §2, §5). Twin: surfel-math, facing.rs.

// Fraction of its depth tolerance ε by which a back-facing fragment has to be nearer than all front-facing ones.
// Otherwise the pixel shows the front side.
const BACK_FACING_LAG: f32 = 0.125;

// Largest sine of the angle between a back-facing splat's plane and the ray to it at which the splat is lit like a
// front-facing one: the sine of 10°.
const RIM_SINE: f32 = 0.173648178;

// Returns the depth by which a visibility fragment competes for the side, front or back, that its pixel shows. Depths
// of back-facing fragments are increased by BACK_FACING_LAG times ε.
fn nearness(z: f32, epsilon: f32, back_facing: bool) -> f32 {
    return select(z, fma(BACK_FACING_LAG, epsilon, z), back_facing);
}

// Returns the depth behind which no fragment blends with the side that a pixel shows: the middle between the nearest
// depths, as given by `nearness`, of the shown side and of the other side (rendering model §5, sheets).
fn sheet_limit(shown: f32, other: f32) -> f32 {
    return (shown + other) * 0.5;
}

// Returns the shading normal of a back-facing splat of an oriented two-sided surface. It is usually the reversed
// normal. Near the contour, where |cosine| ≤ RIM_SINE, it is the normal itself if that faces the eye, otherwise the
// normal mirrored in the plane perpendicular to the ray. `cosine` is that of the angle between the splat's geometric
// normal and the unit direction `to_eye`.
fn back_normal(shading: vec3f, cosine: f32, to_eye: vec3f) -> vec3f {
    let along = v3_dot(shading, to_eye);
    let mirrored = shading - to_eye * (min(along, 0.0) * 2.0);
    return select(-shading, mirrored, abs(cosine) <= RIM_SINE);
}
