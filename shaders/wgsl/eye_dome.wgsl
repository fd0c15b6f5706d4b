// Eye-dome lighting (rendering model §5). Twin: surfel-math, eye_dome.rs.

// Distance of the sampled neighbours, in pixels.
const EYE_DOME_REACH: i32 = 2;

// Returns the contribution to the mean rise of a neighbour at an offset in pixels, per unit of depth that the neighbour
// is nearer.
fn eye_dome_rise_weight(offset: vec2f, projection: Projection) -> f32 {
    return 0.125 / v2_length(offset / projection.focal_px);
}

// Returns the brightness of a pixel with depth z, given the mean rise of its neighbours.
fn eye_dome_brightness(z: f32, rise: f32, projection: Projection) -> f32 {
    let k = 3.1415927 * select(rise / z, rise, projection.kind == ORTHOGRAPHIC);
    return 1.0 / sqrt(fma(k, k, 1.0));
}
