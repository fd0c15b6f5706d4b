// Balls and dots (rendering model §11), pixel by pixel: each invocation searches the balls of its cell for the
// fragments that it composites, from near to far.

// Lists of balls per cell, and records, which are projected balls; set up by the CPU in f64. A cell is a square of
// BALL_CELL pixels. The words are, in order: the header of BALLS_STARTS words; the index of the first entry of each
// cell, and the end of the last cell's entries; the entries, which are numbers of records; the records of BALL_WORDS
// words each; and two words of state per pixel if there are transparent layers.
@group(1) @binding(31) var<storage, read_write> balls: array<u32>;

// Indices of the header's words: number of columns of cells; index of the first word of the records; index of the first
// word of the pixels' states. BALLS_STARTS is the index at which the header ends and the first entries of the cells
// begin.
const BALLS_COLUMNS: u32 = 0u;
const BALLS_RECORDS_AT: u32 = 1u;
const BALLS_STATES_AT: u32 = 2u;
const BALLS_STARTS: u32 = 3u;

// Side of a cell in pixels.
const BALL_CELL: u32 = 8u;

// Offsets of a record's fields, in words. BALL_BASE is a whole pixel of the targets, relative to which positions are in
// pixels: the projected centre (BALL_ANCHOR) and the middle of the outline (BALL_MIDDLE). BALL_EXTENT, BALL_SKEW and
// BALL_WIDTH are the fields of Outline. BALL_SLOPE and BALL_SIZE are the centre's (x, y) and the radius, both divided
// by the centre's depth (orthographic: undivided). BALL_Z is that depth.
const BALL_BASE: u32 = 0u;
const BALL_ANCHOR: u32 = 2u;
const BALL_MIDDLE: u32 = 4u;
const BALL_EXTENT: u32 = 6u;
const BALL_SKEW: u32 = 8u;
const BALL_WIDTH: u32 = 9u;
const BALL_SLOPE: u32 = 10u;
const BALL_SIZE: u32 = 12u;
const BALL_Z: u32 = 13u;
const BALL_ALPHA: u32 = 14u;
const BALL_FLAGS: u32 = 15u;
const BALL_COLOR: u32 = 16u;
const BALL_MATERIAL: u32 = 19u;
// Offset of the stored light in a record. It takes the place of the material, which the shader that shows stored light
// doesn't need.
const BALL_LIGHT: u32 = 19u;
// Number of words of a record.
const BALL_WORDS: u32 = 28u;

// Bits of a record's BALL_FLAGS: the ball is a dot; its outline is too large for `outline_coverage`; it has stored
// light.
const BALL_IS_FLAT: u32 = 1u;
const BALL_IS_LARGE: u32 = 2u;
const BALL_HAS_LIGHT: u32 = 4u;

// A fragment of a ball: its depth, the coverage of the pixel, and the number of its record. A depth of 0 means no
// fragment.
struct BallFragment {
    z: f32,
    coverage: f32,
    record: u32,
}

// Returns the f32 number at word `at`.
fn ball_number(at: u32) -> f32 {
    return bitcast<f32>(balls[at]);
}

// Returns the two f32 numbers from word `at` on.
fn ball_pair(at: u32) -> vec2f {
    return vec2f(ball_number(at), ball_number(at + 1u));
}

// Returns the index of the first word of a record.
fn ball_record_at(record: u32) -> u32 {
    return balls[BALLS_RECORDS_AT] + BALL_WORDS * record;
}

// Returns the offset, in pixels, of a pixel's upper left corner from a point of the record at word `at`. `point` is
// BALL_ANCHOR or BALL_MIDDLE.
fn ball_offset(at: u32, pixel: vec2i, point: u32) -> vec2f {
    let base = bitcast<vec2i>(vec2u(balls[at + BALL_BASE], balls[at + BALL_BASE + 1u]));
    return vec2f(pixel - base) - ball_pair(at + point);
}

// Returns the outline of the record at word `at`.
fn ball_outline(at: u32) -> Outline {
    return Outline(ball_pair(at + BALL_EXTENT), ball_number(at + BALL_SKEW), ball_number(at + BALL_WIDTH));
}

// Returns the coverage of a pixel, 0 to 1, by the record at word `at`.
fn ball_coverage(at: u32, pixel: vec2i) -> f32 {
    let outline = ball_outline(at);
    let corner = ball_offset(at, pixel, BALL_MIDDLE);
    if (balls[at + BALL_FLAGS] & BALL_IS_LARGE) != 0u {
        return outline_coverage_of_large(outline, corner);
    }
    let area = outline_coverage(outline, corner);
    return select(0.0, area, outline_rounding(outline) < area);
}

// Returns the normal (in view axes) and the depth, in world units, of the record at word `at` at a pixel's centre.
fn ball_hit(at: u32, pixel: vec2i) -> BallHit {
    let z = ball_number(at + BALL_Z);
    let slope = ball_pair(at + BALL_SLOPE);
    let perspective = frame.projection.kind == PERSPECTIVE;
    if (balls[at + BALL_FLAGS] & BALL_IS_FLAT) != 0u {
        return BallHit(select(vec3f(0.0, 0.0, -1.0), unit(vec3f(-slope, -1.0)), perspective), z);
    }
    let offset = (ball_offset(at, pixel, BALL_ANCHOR) + 0.5) / frame.projection.focal_px;
    let hit = ball_hit_new(slope, ball_number(at + BALL_SIZE), offset, frame.projection);
    return BallHit(hit.normal, select(z + hit.depth, z * hit.depth, perspective));
}

// Returns the index of the first entry of a pixel's cell, and one past that of its last.
fn ball_entries(pixel: vec2i) -> vec2u {
    let cell = vec2u(pixel) / BALL_CELL;
    let at = BALLS_STARTS + cell.y * balls[BALLS_COLUMNS] + cell.x;
    return vec2u(balls[at], balls[at + 1u]);
}

// Returns the nearest fragment of a pixel that lies behind the fragment `last` and before the depth `until`; without
// one, a fragment of depth 0. Fragments of equal depth are in the order of their records.
fn next_ball(pixel: vec2i, last: BallFragment, until: f32) -> BallFragment {
    let entries = ball_entries(pixel);
    var found = BallFragment(0.0, 0.0, 0u);
    var end = until;
    for (var i = entries.x; i < entries.y; i++) {
        let record = balls[i];
        let at = ball_record_at(record);
        let z = ball_hit(at, pixel).depth;
        let is_behind = z > last.z || (z == last.z && record > last.record);
        if z < end && is_behind {
            let coverage = ball_coverage(at, pixel);
            if coverage > 0.0 {
                found = BallFragment(z, coverage, record);
                end = z;
            }
        }
    }
    return found;
}

// Returns the alpha of the record at word `at`.
fn ball_alpha(at: u32) -> f32 {
    return ball_number(at + BALL_ALPHA);
}

// Returns the depth of the nearest opaque fragment that covers the whole pixel; +∞ without one.
fn full_ball_depth(pixel: vec2i) -> f32 {
    var end = frame.empty_depth;
    if frame.has_balls == 0u {
        return end;
    }
    let entries = ball_entries(pixel);
    for (var i = entries.x; i < entries.y; i++) {
        let at = ball_record_at(balls[i]);
        let z = ball_hit(at, pixel).depth;
        if z < end && ball_alpha(at) >= 1.0 && ball_coverage(at, pixel) >= 1.0 {
            end = z;
        }
    }
    return end;
}

// True if a pixel contains the projection of a ball's centre.
fn has_ball_center(at: u32, pixel: vec2i) -> bool {
    let along = -ball_offset(at, pixel, BALL_ANCHOR);
    return all(along >= vec2f(0.0, 0.0)) && all(along < vec2f(1.0, 1.0));
}

// Returns the nearest fragment of a pixel, before the depth `until`, that shows in the planes of depth, normal and
// nearest splat; without one, a fragment of depth 0.
fn shown_ball(pixel: vec2i, until: f32) -> BallFragment {
    var found = BallFragment(0.0, 0.0, 0u);
    if frame.has_balls == 0u {
        return found;
    }
    var end = min(until, full_ball_depth(pixel));
    let entries = ball_entries(pixel);
    for (var i = entries.x; i < entries.y; i++) {
        let record = balls[i];
        let at = ball_record_at(record);
        let z = ball_hit(at, pixel).depth;
        // Nothing is visible behind the opaque ball that covers the whole pixel. That ball's own fragment, at depth
        // `end`, is.
        if z < end || (z == end && z < until && found.z == 0.0) {
            let coverage = ball_coverage(at, pixel);
            if coverage >= BALL_SOLID || (coverage > 0.0 && has_ball_center(at, pixel)) {
                found = BallFragment(z, coverage, record);
                end = z;
            }
        }
    }
    return found;
}

// Returns the three f32 numbers from word `at` on.
fn ball_triple(at: u32) -> vec3f {
    return vec3f(ball_pair(at), ball_number(at + 2u));
}

// Returns the light that is stored from word `at` on for a surface with the unit normal n in world axes: max(0, b·n +
// nᵀQn) (rendering model §12). The nine numbers are b, the diagonal of Q, and its elements xy, xz and yz.
fn stored_light(at: u32, n: vec3f) -> f32 {
    let linear = v3_dot(ball_triple(at), n);
    let squares = v3_dot(ball_triple(at + 3u), n * n);
    let products = v3_dot(ball_triple(at + 6u), vec3f(n.x * n.y, n.x * n.z, n.y * n.z));
    return max(0.0, linear + squares + 2.0 * products);
}

// Returns the surface point of a fragment, to be lit.
fn ball_point(fragment: BallFragment, pixel: vec2i) -> Point {
    let at = ball_record_at(fragment.record);
    let normal = frame.world_from_view * ball_hit(at, pixel).normal;
    var color = ball_triple(at + BALL_COLOR);
    if (balls[at + BALL_FLAGS] & BALL_HAS_LIGHT) != 0u {
        color *= stored_light(at + BALL_LIGHT, normal);
    }
    let material = vec4f(ball_pair(at + BALL_MATERIAL), ball_pair(at + BALL_MATERIAL + 2u));
    return Point(color, normal, material, fragment.z, fragment.coverage, true);
}

// Returns the colour of a fragment by the frame's shader.
fn ball_color(fragment: BallFragment, pixel: vec2i) -> vec3f {
    let point = ball_point(fragment, pixel);
    let at = position_at(pixel, point.z);
    let color = color_of(at, point, true);
    if frame.shader_kind == SHADER_EDL {
        // Eye-dome lighting darkens a tilted plane by about its cosine.
        let position = frame.world_from_view * at;
        let to_eye = select(frame.to_eye, -unit(position), frame.projection.kind == PERSPECTIVE);
        return color * abs(v3_dot(point.normal, to_eye));
    }
    return color;
}

// Result so far of compositing a pixel's balls, from near to far.
struct BallColors {
    // Premultiplied colour and opacity.
    color: vec4f,
    // The last fragment that was composited; of depth 0 before the first.
    last: BallFragment,
    // Number of fragments that were composited.
    fragments: u32,
}

// Returns the result before the first fragment.
fn no_balls() -> BallColors {
    return BallColors(vec4f(0.0, 0.0, 0.0, 0.0), BallFragment(0.0, 0.0, 0u), 0u);
}

// Composites those fragments of a pixel that lie behind the last fragment of `so_far` and before the depth `until`.
fn composite_balls(so_far: BallColors, pixel: vec2i, until: f32) -> BallColors {
    var colors = so_far;
    while colors.color.a < 1.0 {
        let fragment = next_ball(pixel, colors.last, until);
        if fragment.z <= 0.0 {
            break;
        }
        let alpha = fragment.coverage * ball_alpha(ball_record_at(fragment.record));
        let through = 1.0 - colors.color.a;
        let color = ball_color(fragment, pixel);
        colors.color = vec4f(colors.color.rgb + color * (alpha * through), 1.0 - through * (1.0 - alpha));
        colors.last = fragment;
        colors.fragments += 1u;
    }
    return colors;
}

// Returns the index of the first of two words of a pixel's state: depth and record of the last fragment that was
// composited.
fn ball_state_at(pixel: vec2i) -> u32 {
    return balls[BALLS_STATES_AT] + 2u * (u32(pixel.y) * frame.size_px.x + u32(pixel.x));
}

// Returns the fragment in a pixel's state; its coverage isn't stored.
fn last_ball(pixel: vec2i) -> BallFragment {
    let at = ball_state_at(pixel);
    return BallFragment(ball_number(at), 0.0, balls[at + 1u]);
}

// Writes a fragment to a pixel's state.
fn put_last_ball(pixel: vec2i, last: BallFragment) {
    let at = ball_state_at(pixel);
    balls[at] = bitcast<u32>(last.z);
    balls[at + 1u] = last.record;
}

// Composites a pixel's fragments before the depth `until`, and behind those composited so far, under the pixel's
// layers.
fn balls_under(layers: LayerComposite, pixel: vec2i, until: f32) -> LayerComposite {
    if frame.has_balls == 0u {
        return layers;
    }
    var colors = BallColors(vec4f(layers.color, layers.opacity), BallFragment(0.0, 0.0, 0u), 0u);
    if frame.has_layers != 0u {
        colors.last = last_ball(pixel);
    }
    colors = composite_balls(colors, pixel, until);
    if frame.has_layers != 0u {
        put_last_ball(pixel, colors.last);
    }
    var more = layers;
    more.color = colors.color.rgb;
    more.opacity = colors.color.a;
    more.counts += colors.fragments;
    return more;
}

// Returns what balls behind the nearest surface add to the premultiplied colour of an edge pixel; 0 for other pixels.
fn balls_behind(pixel: vec2i, opaque: Pixel) -> vec4f {
    if frame.has_balls == 0u || opaque.share >= 1.0 {
        return vec4f(0.0, 0.0, 0.0, 0.0);
    }
    var colors = no_balls();
    // Fragments at exactly the depth `opaque.end` count, too.
    colors.last = BallFragment(before_depth(opaque.end), 0.0, 0xffffffffu);
    colors = composite_balls(colors, pixel, opaque.back);
    return (colors.color - opaque.behind * colors.color.a) * (1.0 - opaque.share);
}

// Returns the next smaller f32 of a depth; 0 for 0.
fn before_depth(z: f32) -> f32 {
    return select(bitcast<f32>(bitcast<u32>(z) - 1u), 0.0, z <= 0.0);
}

// Entry point of the shading pass for frames with balls. It binds one more buffer than `shade`.
@compute @workgroup_size(8, 8)
fn shade_balls(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.shade_size_px.x || id.y >= frame.shade_size_px.y {
        return;
    }
    let pixel = vec2i(id.xy + frame.shade_origin_px);
    let at = id.y * frame.shade_size_px.x + id.x;
    let opaque = shaded_pixel(pixel, frame.background, true);
    var surface = opaque.front;
    var layers: LayerComposite;
    if frame.has_layers != 0u {
        layers = layer_composites[u32(pixel.y) * frame.size_px.x + u32(pixel.x)];
        if layers.z > 0.0 {
            surface = Surface(layers.color, layers.normal, layers.z, layers.weight, true);
        }
    }
    let ball = shown_ball(pixel, select(opaque.end, min(opaque.end, surface.z), surface.is_there));
    if ball.z > 0.0 {
        let point = ball_point(ball, pixel);
        surface = Surface(point.albedo, point.normal, point.z, point.weight, true);
    }
    layers = balls_under(layers, pixel, opaque.end);
    if frame.color_at != ABSENT {
        write_color(at, composite_over(layers, opaque.color + balls_behind(pixel, opaque)));
    }
    write_planes(at, surface);
    if frame.fragments_at != ABSENT {
        planes[frame.fragments_at + at] = textureLoad(count_sums, pixel, 0).r + f32(fragments_of(layers));
    }
}

// Writes the colours of sampled pixels like `resolve_samples`, in frames with balls.
@compute @workgroup_size(8, 8)
fn resolve_samples_balls(@builtin(global_invocation_id) id: vec3u) {
    let pixel = id.xy + frame.first_pixel;
    if any(id.xy >= frame.size_px / SAMPLES_SIDE) || textureLoad(pixel_steps, vec2i(pixel), 0).x <= 0.0 {
        return;
    }
    var sum = vec4f(0.0, 0.0, 0.0, 0.0);
    for (var i = 0u; i < SAMPLES_SIDE * SAMPLES_SIDE; i++) {
        let at = vec2i(id.xy * SAMPLES_SIDE + vec2u(i % SAMPLES_SIDE, i / SAMPLES_SIDE));
        let opaque = shaded_pixel(at, frame.background, true);
        var layers: LayerComposite;
        if frame.has_layers != 0u {
            layers = layer_composites[u32(at.y) * frame.size_px.x + u32(at.x)];
        }
        layers = balls_under(layers, at, opaque.end);
        let color = sample_color(at, opaque, vec2i(pixel));
        sum += composite_over(layers, color) * (1.0 / f32(SAMPLES_SIDE * SAMPLES_SIDE));
    }
    let shaded = pixel - frame.shade_origin_px;
    write_color(shaded.y * frame.shade_size_px.x + shaded.x, sum);
}

// True if the ball of the record at word `at` covers the centre of a texel of a shadow map.
fn ball_hides(at: u32, texel: vec2i) -> bool {
    return outline_contains(ball_outline(at), ball_offset(at, texel, BALL_MIDDLE) + 0.5);
}

// Returns the smallest of `z` and the depths of the centres of the opaque balls that cover a texel's centre.
fn ball_shadow(z: f32, texel: vec2i) -> f32 {
    var least = z;
    if frame.has_balls == 0u {
        return least;
    }
    let entries = ball_entries(texel);
    for (var i = entries.x; i < entries.y; i++) {
        let at = ball_record_at(balls[i]);
        let center = ball_number(at + BALL_Z);
        if center < least && ball_alpha(at) >= 1.0 && ball_hides(at, texel) {
            least = center;
        }
    }
    return least;
}
