// Eye-dome lighting, the shader `edl` (rendering model §5): a pixel is darker the farther it lies behind its
// neighbours.

// Returns what a neighbour adds to the rise of the surface around a pixel of depth z. `offset` is the neighbour's in
// pixels, and `neighbour` its depth.
fn eye_dome_rise(offset: vec2i, z: f32, neighbour: f32) -> f32 {
    return eye_dome_rise_weight(vec2f(offset), frame.projection) * select(0.0, z - neighbour, neighbour < z);
}

// Returns the brightness, 0 to 1, of a surface at depth z in a pixel, from the nearest surfaces of the pixel's
// neighbours.
fn eye_dome_shading(pixel: vec2i, z: f32) -> f32 {
    let last = vec2i(frame.size_px) - 1;
    var rise = 0.0;
    for (var j = -1; j <= 1; j++) {
        for (var i = -1; i <= 1; i++) {
            let offset = vec2i(i, j) * EYE_DOME_REACH;
            let at = pixel + offset;
            // Neighbours outside of the image contribute nothing; the targets have a border for all others.
            if (i == 0 && j == 0) || at.x < 0 || at.y < 0 || at.x > last.x || at.y > last.y {
                continue;
            }
            rise += eye_dome_rise(offset, z, front_depth(at));
        }
    }
    return eye_dome_brightness(z, rise, frame.projection);
}
