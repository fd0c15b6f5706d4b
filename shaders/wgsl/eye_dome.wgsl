// Eye-dome lighting (rendering model §5). Twin: surfel-math, eye_dome.rs.

// Distance of the neighbours that are looked at, pixels.
const EYE_DOME_REACH: i32 = 2;

// What a neighbour at an offset adds to the mean rise for each unit that it is nearer.
fn eye_dome_rise_weight(offset: vec2f, projection: Projection) -> f32 {
    return 0.125 / v2_length(offset / projection.focal_px);
}

// How bright a pixel of depth z is whose neighbours rise so much.
fn eye_dome_brightness(z: f32, rise: f32, projection: Projection) -> f32 {
    let k = 3.1415927 * select(rise / z, rise, projection.kind == ORTHOGRAPHIC);
    return 1.0 / sqrt(fma(k, k, 1.0));
}
