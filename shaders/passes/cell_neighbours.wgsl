// Data of the compute path's pixels that passes over neighbouring pixels read, and the first of these passes: outlines
// and eye-dome lighting. Shading and host targets use `front_depth` instead, which reads textures. There, another
// buffer would exceed WebGPU's core limits.

// Returns the size of the targets of the tile of pixels, also in a frame of its samples.
fn pixel_targets_px() -> vec2u {
    return select(frame.size_px, frame.pixels_size_px, frame.is_of_samples != 0u);
}

// Returns the depth of the nearest surface at a pixel of the targets of pixels; +∞ without one.
fn cell_depth(pixel: vec2i) -> f32 {
    return planes[frame.surfaces_at + 4u * (u32(pixel.y) * pixel_targets_px().x + u32(pixel.x)) + 3u];
}

// Numbers of the words of a pixel's edge data. The first two are the z + ε and the ε of the splat that defines the
// pixel's depth threshold, or 0. Then follow the coverage, and 1 if the pixel has a surface (Σw is at least
// LEAST_WEIGHT). In frames whose edges are sampled, the fifth word is 1 if the pixel is sampled. If there are also
// transparent layers, the z + ε and the ε of the nearest transparent splat follow, or 0.
const EDGE_THRESHOLD: u32 = 0u;
const EDGE_EPSILON: u32 = 1u;
const EDGE_COVERAGE: u32 = 2u;
const EDGE_SURFACE: u32 = 3u;
const EDGE_SAMPLED: u32 = 4u;
const EDGE_LAYER_THRESHOLD: u32 = 5u;
const EDGE_LAYER_EPSILON: u32 = 6u;
// Number of words of a pixel's edge data, in frames without layers among their samples and with them.
const EDGE_WORDS: u32 = 5u;
const LAYERED_EDGE_WORDS: u32 = 7u;

// Returns the index in `planes` of a word of a pixel's edge data. The first word of all pixels, row by row, is stored
// before the second.
fn edge_word(word: u32, pixel: vec2u) -> u32 {
    let size = pixel_targets_px();
    return frame.edges_at + word * (size.x * size.y) + pixel.y * size.x + pixel.x;
}

// Writes the edge data of a pixel. `writer` is the z + ε and the ε of the splat that defines the pixel's depth
// threshold.
fn write_edge_data(pixel: vec2u, writer: vec2f, coverage: f32, has_surface: bool) {
    planes[edge_word(EDGE_THRESHOLD, pixel)] = writer.x;
    planes[edge_word(EDGE_EPSILON, pixel)] = writer.y;
    planes[edge_word(EDGE_COVERAGE, pixel)] = coverage;
    planes[edge_word(EDGE_SURFACE, pixel)] = select(0.0, 1.0, has_surface);
}

// Returns the z + ε and the ε of the splat that defines a pixel's depth threshold; zeros without one.
fn edge_threshold_of(pixel: vec2u) -> vec2f {
    return vec2f(planes[edge_word(EDGE_THRESHOLD, pixel)], planes[edge_word(EDGE_EPSILON, pixel)]);
}

// True if a pixel has a surface, which means that Σw is at least LEAST_WEIGHT.
fn has_cell_surface(pixel: vec2u) -> bool {
    return planes[edge_word(EDGE_SURFACE, pixel)] > 0.0;
}

// True if the surface of a pixel's neighbour lies beyond the depth `limit`, so that `toon` draws an outline.
fn has_cell_outline(pixel: vec2i, limit: f32) -> bool {
    let last = vec2i(pixel_targets_px()) - 1;
    var line = false;
    for (var y = max(pixel.y - 1, 0); y <= min(pixel.y + 1, last.y); y++) {
        for (var x = max(pixel.x - 1, 0); x <= min(pixel.x + 1, last.x); x++) {
            let is_other = x != pixel.x || y != pixel.y;
            line = line || (is_other && cell_depth(vec2i(x, y)) > limit);
        }
    }
    return line;
}

// Returns the brightness, 0 to 1, of a surface at depth z in a pixel, from the nearest surfaces of the pixel's
// neighbours.
fn cell_eye_dome_shading(pixel: vec2i, z: f32, projection: Projection) -> f32 {
    let last = vec2i(pixel_targets_px()) - 1;
    var rise = 0.0;
    for (var j = -1; j <= 1; j++) {
        for (var i = -1; i <= 1; i++) {
            let offset = vec2i(i, j) * EYE_DOME_REACH;
            let at = pixel + offset;
            if (i == 0 && j == 0) || at.x < 0 || at.y < 0 || at.x > last.x || at.y > last.y {
                continue;
            }
            let neighbour = cell_depth(at);
            let nearer = select(0.0, z - neighbour, neighbour < z);
            rise += eye_dome_rise_weight(vec2f(offset), projection) * nearer;
        }
    }
    return eye_dome_brightness(z, rise, projection);
}

// Applies outlines and eye-dome lighting, which depend on neighbouring pixels, to the colours.
@compute @workgroup_size(8, 8)
fn cell_neighbours(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.shade_size_px.x || id.y >= frame.shade_size_px.y {
        return;
    }
    let own = id.xy + frame.shade_origin_px;
    let at = frame.surfaces_at + 4u * (own.y * frame.size_px.x + own.x);
    let normal = vec3f(planes[at], planes[at + 1u], planes[at + 2u]);
    let z = planes[at + 3u];
    if !(z < frame.empty_depth) {
        return;
    }
    var share = 1.0;
    if frame.has_outlines != 0u {
        let surface = Surface(vec3f(0.0, 0.0, 0.0), normal, z, 0.0, true);
        let limit = outline_limit(vec2i(own), surface, frame.projection);
        share = select(1.0, 0.0, has_cell_outline(vec2i(own), limit));
    }
    if frame.has_eye_dome != 0u {
        share *= cell_eye_dome_shading(vec2i(own), z, frame.projection);
    }
    let to = frame.color_at + 4u * (id.y * frame.shade_size_px.x + id.x);
    planes[to] *= share;
    planes[to + 1u] *= share;
    planes[to + 2u] *= share;
}
