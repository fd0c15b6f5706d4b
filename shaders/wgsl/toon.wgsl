// The shader `toon` (rendering model §5): stepped light, and outlines. Twin: surfel-math, toon.rs.

// Half the width of the smooth transition between two steps of light, in units of light (0 to 1).
const TOON_HALF_WIDTH: f32 = 0.02;
// Strength of a highlight, 0 to 1, at which its spot ends.
const TOON_HIGHLIGHT: f32 = 0.5;

// Returns 0 up to `low`, 1 from `high` on, and 3x² − 2x³ in between.
fn toon_smoothstep(x: f32, low: f32, high: f32) -> f32 {
    let t = min(max((x - low) / (high - low), 0.0), 1.0);
    return t * t * (3.0 - 2.0 * t);
}

// Returns a smooth step of the light from 0 to 1 around the value `at`.
fn toon_step(light: f32, at: f32) -> f32 {
    return toon_smoothstep(light, at - TOON_HALF_WIDTH, at + TOON_HALF_WIDTH);
}

// Quantises diffuse light, 0 to 1, in steps of 0, ⅓, ⅔ and 1.
fn toon_ramp(light: f32) -> f32 {
    return (toon_step(light, 0.05) + toon_step(light, 0.35) + toon_step(light, 0.7)) * (1.0 / 3.0);
}

// Quantises a highlight's strength, 0 to 1, to 0 and 1 with a short transition. The highlight becomes a spot with a
// sharp edge.
fn toon_highlight(strength: f32) -> f32 {
    return toon_step(strength, TOON_HIGHLIGHT);
}

// Returns the factor, 0 to 1, by which a silhouette line darkens the colour. `cosine` is |n·v|, with n the unit normal
// and v the unit direction to the eye.
fn toon_line(cosine: f32) -> f32 {
    return toon_smoothstep(cosine, 0.12, 0.22);
}

// Returns the depth beyond which a pixel's neighbour shows another surface than the pixel, whose depth is z. `gradient`
// is the change of the surface's depth per pixel to the right and down.
fn toon_step_back_limit(z: f32, gradient: vec2f, projection: Projection) -> f32 {
    let scale = select(z, projection.height, projection.kind == ORTHOGRAPHIC);
    return z + (0.02 * scale + 2.0 * v2_length(gradient));
}
