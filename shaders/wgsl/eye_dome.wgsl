// Eye-dome lighting, the shader `edl` (rendering model §5): pixels are darker the more their neighbours rise toward the
// eye. Twin: surfel-math, eye_dome.rs.

// Distance of the sampled neighbours, in pixels.
const EYE_DOME_REACH: i32 = 2;

// Returns the weight of one of a pixel's eight neighbours, at an offset in pixels. The mean rise is the sum, over the
// neighbours, of this weight times the depth by which the neighbour is nearer than the pixel.
fn eye_dome_rise_weight(offset: vec2f, projection: Projection) -> f32 {
    return 0.125 / v2_length(offset / projection.focal_px);
}

// Returns the brightness of a pixel with depth z, from 0 to 1, given the mean rise of its neighbours.
fn eye_dome_brightness(z: f32, rise: f32, projection: Projection) -> f32 {
    let k = 3.1415927 * select(rise / z, rise, projection.kind == ORTHOGRAPHIC);
    return 1.0 / sqrt(fma(k, k, 1.0));
}
