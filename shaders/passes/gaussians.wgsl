// Trained Gaussians (docs/gaussians.md). One invocation blends all Gaussians of a pixel. The host has projected and
// sorted them, and listed them by cells of 16×16 pixels. A record is a projected Gaussian; an entry of a list is the
// index of a record.
//
// A dispatch runs a bounded number of steps, because drivers stop shaders that run for long. Some software drivers
// silently stop after 65,535 iterations of all loops together. The progress of a pixel is stored in its state, and the
// host dispatches again until every pixel is finished.

// A Gaussian projected into the view.
struct GaussianRecord {
    // The image's pixel (column, row) that contains the projected centre, and the centre's position within the pixel, 0
    // to 1.
    base: vec2i,
    fraction: vec2f,
    forms: GaussianForms,
    // Colour in the Gaussians' colour space.
    color: vec3f,
    opacity: f32,
    // Unit normal in world axes, toward the eye.
    normal: vec3f,
    // Factor by which the filter `principal` multiplies α; 1 with other filters.
    weight: f32,
    // Smallest depth at which the Gaussian has fragments, in world units. If each pixel sorts its own fragments,
    // records are in ascending order of this depth.
    nearest: f32,
    // Index of the Gaussian among all Gaussians of the scene.
    number: u32,
}

// Side of a cell, a square of pixels with its own list of Gaussians, in pixels.
const GAUSSIAN_CELL: u32 = 16u;
// Largest α of a fragment; larger values are reduced to it.
const MAX_ALPHA: f32 = 0.99;
// Smallest α of a fragment that is drawn, before α is multiplied by the filter's factor: 1/255.
const MIN_ALPHA: f32 = 0.003921569;
// Smallest transmittance, the fraction of the light from behind that passes a pixel's fragments. A fragment that would
// make it smaller ends the blending.
const MIN_TRANSMITTANCE: f32 = 1e-4;
// Largest sum of weights of a pixel that counts as empty. Sums are divided only by larger ones.
const MIN_GAUSSIAN_WEIGHT: f32 = 1e-12;

// Gaussians that may touch the tile, in the order in which pixels read them.
@group(1) @binding(28) var<storage, read> gaussian_records: array<GaussianRecord>;
// Lists of the cells, row by row: the index of the first of each cell's entries, and the end of the last cell's; then
// the entries, which are ascending indices of records.
//
// If pixels have states, the words of the states begin at `frame.gaussian_states_at`, and the fragments that wait to be
// blended follow. Word k of all pixels is stored before word k + 1.
@group(1) @binding(29) var<storage, read_write> gaussian_lists: array<u32>;

// Number of words of a pixel's state. Words 0 to 14 are its GaussianSums, word 15 is GAUSSIAN_DISPATCHES, and word 16
// is the index of the next entry to read. The further words are those of gaussians_by_pixel.wgsl.
const GAUSSIAN_STATE_WORDS: u32 = 24u;
// Number of words of a fragment that waits to be blended (see gaussians_by_pixel.wgsl).
const GAUSSIAN_ROOM_WORDS: u32 = 3u;
// Index in `planes` of the number of the last dispatch that left a pixel unfinished. The planes themselves follow.
const GAUSSIANS_UNFINISHED_AT: u32 = 0u;
// Maximum number of entries that a dispatch reads per pixel, if the pixel blends in the order of the list.
const GAUSSIAN_READS: u32 = 32768u;

// Sums of the fragments blended at a pixel.
struct GaussianSums {
    // Colour in the Gaussians' colour space.
    color: vec3f,
    // Product of 1 − α over the fragments: the fraction of the light from behind that passes.
    transmittance: f32,
    // Sums Σw·normal, Σw and Σw·z, with the weight w = α times the transmittance before the fragment.
    normal: vec3f,
    weight: f32,
    depth: f32,
    // Depth of the last fragment before which the transmittance was above ½.
    median_depth: f32,
    // Value of the plane `distortion` so far.
    distortion: f32,
    // Σw·m and Σw·m², where m is the depth that the plane `distortion` compares (`distortion_depth`).
    moments: vec2f,
    fragments: u32,
    // True until a fragment would make the transmittance smaller than MIN_TRANSMITTANCE. While it is true, fragments
    // are blended.
    is_open: bool,
}

// A fragment of a Gaussian: α, the fraction of the pixel that it covers, and its depth. α is negative if there is no
// fragment. α can be 0, since a filter may reduce a tiny value to 0.
struct GaussianFragment {
    alpha: f32,
    z: f32,
}

// Returns the fragment of a record at a pixel of the image.
fn gaussian_fragment(record: u32, pixel: vec2i) -> GaussianFragment {
    // The difference of integers is exact: only the fraction rounds.
    let offset = vec2f(pixel - gaussian_records[record].base) - (gaussian_records[record].fraction - 0.5);
    let at = gaussian_forms_at(gaussian_records[record].forms, offset);
    // exp(−ρ²/2), clamped to normal numbers.
    let alpha = min(gaussian_records[record].opacity * exp2(max(at.x * -0.72134752, -126.0)), MAX_ALPHA);
    let shows = MIN_ALPHA <= alpha && frame.gaussian_near <= at.y && at.y < 1e30;
    return GaussianFragment(select(-1.0, alpha * gaussian_records[record].weight, shows), at.y);
}

// Blends a fragment behind the fragments in the sums, or ends the blending.
fn blend_gaussian(sums: ptr<function, GaussianSums>, record: u32, fragment: GaussianFragment) {
    let before = (*sums).transmittance;
    let left = before * (1.0 - fragment.alpha);
    if left < MIN_TRANSMITTANCE {
        (*sums).is_open = false;
        return;
    }
    let w = fragment.alpha * before;
    let m = distortion_depth(fragment.z);
    let moments = (*sums).moments;
    (*sums).color += gaussian_records[record].color * w;
    (*sums).normal += gaussian_records[record].normal * w;
    (*sums).weight += w;
    (*sums).depth += fragment.z * w;
    if before > 0.5 {
        (*sums).median_depth = fragment.z;
    }
    (*sums).distortion += w * (fma(m * m, 1.0 - before, moments.y) - 2.0 * m * moments.x);
    (*sums).moments = moments + vec2f(w * m, w * m * m);
    (*sums).fragments += 1u;
    (*sums).transmittance = left;
}

// Returns the linear premultiplied colour of a pixel, blended over the background.
fn resolved_gaussians(sums: GaussianSums) -> vec4f {
    let behind = frame.gaussian_background;
    let alpha = 1.0 - sums.transmittance + sums.transmittance * behind.a;
    let color = sums.color + sums.transmittance * behind.rgb;
    if frame.has_linear_gaussians != 0u || alpha <= 0.0 {
        return vec4f(limit_rgb(color), alpha);
    }
    let straight = limit_rgb(color / alpha);
    let linear = vec3f(srgb_decode(straight.r), srgb_decode(straight.g), srgb_decode(straight.b));
    return vec4f(limit_rgb(linear * alpha), alpha);
}

// Writes the planes of a pixel. `at` is the pixel's number in the shaded region, row by row.
fn write_gaussians(at: u32, sums: GaussianSums) {
    if frame.color_at != ABSENT {
        write_color(at, resolved_gaussians(sums));
    }
    let is_there = sums.weight > MIN_GAUSSIAN_WEIGHT;
    if frame.depth_at != ABSENT {
        planes[frame.depth_at + at] = select(frame.empty_depth, sums.depth / sums.weight, is_there);
    }
    if frame.normal_at != ABSENT {
        let to = frame.normal_at + 3u * at;
        planes[to] = sums.normal.x;
        planes[to + 1u] = sums.normal.y;
        planes[to + 2u] = sums.normal.z;
    }
    if frame.weight_at != ABSENT {
        planes[frame.weight_at + at] = 1.0 - sums.transmittance;
    }
    if frame.alpha_at != ABSENT {
        planes[frame.alpha_at + at] = 1.0 - sums.transmittance;
    }
    if frame.median_depth_at != ABSENT {
        planes[frame.median_depth_at + at] = select(frame.empty_depth, sums.median_depth, is_there);
    }
    if frame.distortion_at != ABSENT {
        planes[frame.distortion_at + at] = sums.distortion;
    }
    if frame.fragments_at != ABSENT {
        planes[frame.fragments_at + at] = f32(sums.fragments);
    }
}

// Returns the index in `gaussian_lists` of the first entry of a pixel's cell, and one past that of its last. `id` is
// the pixel in the shaded region.
fn gaussian_list(id: vec3u) -> vec2u {
    let cell = id.y / GAUSSIAN_CELL * frame.gaussian_columns + id.x / GAUSSIAN_CELL;
    return vec2u(gaussian_lists[cell], gaussian_lists[cell + 1u]);
}

// Returns the sums of a pixel before its first fragment.
fn no_gaussian_sums() -> GaussianSums {
    var sums: GaussianSums;
    sums.transmittance = 1.0;
    sums.is_open = true;
    return sums;
}

// Returns the index in `gaussian_lists` of a word of a pixel's state. `pixel` is the pixel's number in the shaded
// region, row by row, here and below.
fn gaussian_state_at(pixel: u32, word: u32) -> u32 {
    return frame.gaussian_states_at + word * (frame.shade_size_px.x * frame.shade_size_px.y) + pixel;
}

// Returns a word of a pixel's state.
fn gaussian_state(pixel: u32, word: u32) -> u32 {
    return gaussian_lists[gaussian_state_at(pixel, word)];
}

// Returns a word of a pixel's state as an f32 number.
fn gaussian_number(pixel: u32, word: u32) -> f32 {
    return bitcast<f32>(gaussian_state(pixel, word));
}

// Writes a word of a pixel's state.
fn set_gaussian_state(pixel: u32, word: u32, value: u32) {
    gaussian_lists[gaussian_state_at(pixel, word)] = value;
}

// Writes an f32 number to a word of a pixel's state.
fn set_gaussian_number(pixel: u32, word: u32, value: f32) {
    set_gaussian_state(pixel, word, bitcast<u32>(value));
}

// Reads words 0 to 14 of a pixel's state.
fn load_gaussian_sums(pixel: u32) -> GaussianSums {
    var sums: GaussianSums;
    sums.color = vec3f(gaussian_number(pixel, 0u), gaussian_number(pixel, 1u), gaussian_number(pixel, 2u));
    sums.transmittance = gaussian_number(pixel, 3u);
    sums.normal = vec3f(gaussian_number(pixel, 4u), gaussian_number(pixel, 5u), gaussian_number(pixel, 6u));
    sums.weight = gaussian_number(pixel, 7u);
    sums.depth = gaussian_number(pixel, 8u);
    sums.median_depth = gaussian_number(pixel, 9u);
    sums.distortion = gaussian_number(pixel, 10u);
    sums.moments = vec2f(gaussian_number(pixel, 11u), gaussian_number(pixel, 12u));
    sums.fragments = gaussian_state(pixel, 13u);
    sums.is_open = gaussian_state(pixel, 14u) != 0u;
    return sums;
}

// Writes words 0 to 14 of a pixel's state.
fn store_gaussian_sums(pixel: u32, sums: GaussianSums) {
    set_gaussian_number(pixel, 0u, sums.color.x);
    set_gaussian_number(pixel, 1u, sums.color.y);
    set_gaussian_number(pixel, 2u, sums.color.z);
    set_gaussian_number(pixel, 3u, sums.transmittance);
    set_gaussian_number(pixel, 4u, sums.normal.x);
    set_gaussian_number(pixel, 5u, sums.normal.y);
    set_gaussian_number(pixel, 6u, sums.normal.z);
    set_gaussian_number(pixel, 7u, sums.weight);
    set_gaussian_number(pixel, 8u, sums.depth);
    set_gaussian_number(pixel, 9u, sums.median_depth);
    set_gaussian_number(pixel, 10u, sums.distortion);
    set_gaussian_number(pixel, 11u, sums.moments.x);
    set_gaussian_number(pixel, 12u, sums.moments.y);
    set_gaussian_state(pixel, 13u, sums.fragments);
    set_gaussian_state(pixel, 14u, select(0u, 1u, sums.is_open));
}

// Number of the word of a pixel's state that counts the dispatches which left the pixel unfinished.
const GAUSSIAN_DISPATCHES: u32 = 15u;
// Value of the word GAUSSIAN_DISPATCHES once the pixel is finished.
const GAUSSIANS_FINISHED: u32 = 0xffffffffu;

// Ends a pixel's dispatch: writes the pixel's planes if it is finished, otherwise stores its sums for the next
// dispatch.
fn end_gaussian_dispatch(pixel: u32, sums: GaussianSums, is_finished: bool) {
    if is_finished {
        write_gaussians(pixel, sums);
        set_gaussian_state(pixel, GAUSSIAN_DISPATCHES, GAUSSIANS_FINISHED);
        return;
    }
    store_gaussian_sums(pixel, sums);
    let dispatches = gaussian_state(pixel, GAUSSIAN_DISPATCHES) + 1u;
    set_gaussian_state(pixel, GAUSSIAN_DISPATCHES, dispatches);
    // All pixels write the same number here.
    planes[GAUSSIANS_UNFINISHED_AT] = f32(dispatches);
}

// Blends Gaussians in the order of the list.
@compute @workgroup_size(8, 8)
fn gaussians(@builtin(global_invocation_id) id: vec3u) {
    if id.x < frame.shade_size_px.x && id.y < frame.shade_size_px.y {
        blend_gaussians(id, frame.empty_depth);
    }
}

// Blends Gaussians like `gaussians`, without the fragments behind the application's geometry.
@compute @workgroup_size(8, 8)
fn gaussians_in_host(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.shade_size_px.x || id.y >= frame.shade_size_px.y {
        return;
    }
    var z = host_depth_along(vec2i(id.xy));
    if frame.projection.kind == PERSPECTIVE {
        // A reversed depth of 0 is infinitely far.
        z = select(frame.empty_depth, 1.0 / z, z > 0.0);
    }
    blend_gaussians(id, z);
}

// Blends the fragments of a pixel that are no deeper than `farthest`.
fn blend_gaussians(id: vec3u, farthest: f32) {
    let place = vec2i(id.xy) + frame.origin_px;
    let pixel = id.y * frame.shade_size_px.x + id.x;
    let list = gaussian_list(id);
    let has_state = frame.gaussian_states_at != ABSENT;
    var at = list.x;
    var sums = no_gaussian_sums();
    if has_state {
        let dispatches = gaussian_state(pixel, GAUSSIAN_DISPATCHES);
        if dispatches == GAUSSIANS_FINISHED {
            return;
        }
        if dispatches > 0u {
            sums = load_gaussian_sums(pixel);
            at = gaussian_state(pixel, 16u);
        }
    }
    let end = select(list.y, min(list.y, at + GAUSSIAN_READS), has_state);
    for (; at < end && sums.is_open; at++) {
        let record = gaussian_lists[at];
        let fragment = gaussian_fragment(record, place);
        if fragment.alpha >= 0.0 && fragment.z <= farthest {
            blend_gaussian(&sums, record, fragment);
        }
    }
    if !has_state {
        write_gaussians(pixel, sums);
        return;
    }
    set_gaussian_state(pixel, 16u, at);
    end_gaussian_dispatch(pixel, sums, at >= list.y || !sums.is_open);
}
