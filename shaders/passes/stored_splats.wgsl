// Reads splats from their storage buffer in the layout of surfel-gpu: 32-bit words, or 16-bit half-words if splats are
// quantised. Positions in the buffer (`at`) and offsets within a splat are in words or half-words accordingly.

@group(1) @binding(0) var<uniform> segment: Segment;
@group(1) @binding(1) var<storage, read> splats: array<u32>;

// True if the segment's splats are stored as 16-bit half-words.
fn is_quantised() -> bool {
    return segment.scales_at != ABSENT;
}

// Returns the half-word at a position in half-words.
fn stored_half(at: u32) -> u32 {
    return (splats[at / 2u] >> (16u * (at % 2u))) & 0xffffu;
}

// Returns the 32-bit word at a position. In quantised splats it consists of two half-words, the lower one first.
fn stored_word(at: u32) -> u32 {
    if is_quantised() {
        return stored_half(at) | (stored_half(at + 1u) << 16u);
    }
    return splats[at];
}

// Returns the n-th, from 0, of consecutive f32 numbers that begin at `at`. They are f32 in quantised splats, too.
fn stored_f32(at: u32, n: u32) -> f32 {
    return bitcast<f32>(stored_word(at + n * select(1u, 2u, is_quantised())));
}

// Returns the n-th, from 0, of consecutive numbers that begin at `at`. In quantised splats a number is a half-word less
// 32768, times `scale`; otherwise it is an f32.
fn stored_number(at: u32, n: u32, scale: f32) -> f32 {
    if is_quantised() {
        return (f32(stored_half(at + n)) - 32768.0) * scale;
    }
    return bitcast<f32>(splats[at + n]);
}

// Returns three consecutive numbers like `stored_number`.
fn stored_numbers(at: u32, scale: f32) -> vec3f {
    return vec3f(stored_number(at, 0u, scale), stored_number(at, 1u, scale), stored_number(at, 2u, scale));
}

// Returns a direction: in quantised splats a unit vector from two octahedral coordinates, otherwise three f32 numbers.
fn stored_unit(at: u32) -> vec3f {
    if is_quantised() {
        let v = unfolded(stored_number(at, 0u, 1.0 / 32767.0), stored_number(at, 1u, 1.0 / 32767.0));
        return v * (1.0 / v3_length(v));
    }
    return stored_numbers(at, 0.0);
}

// Returns a chunk's quantisation steps: of centres (object units), of radii (object units) and of colours. Zeros if
// splats aren't quantised.
fn stored_scales(chunk: u32) -> vec3f {
    if !is_quantised() {
        return vec3f(0.0, 0.0, 0.0);
    }
    let at = segment.scales_at + 3u * chunk;
    return vec3f(bitcast<f32>(splats[at]), bitcast<f32>(splats[at + 1u]), bitcast<f32>(splats[at + 2u]));
}

// Returns the form whose c, x and y are the n-th f32 number from `at` and the two after it.
fn stored_form(at: u32, n: u32) -> Linear {
    return Linear(stored_f32(at, n), stored_f32(at, n + 1u), stored_f32(at, n + 2u));
}

// Returns the clip of splat i over its (u, v), with the chord in place of the curve if the frame says so. A stored clip
// has 26 numbers: the curve's forms chord, side1 and side3, three numbers each, and its sign; four lines, three numbers
// each, and their sign; then the form that keeps the curve's side of its chord.
fn stored_clip(i: u32) -> Clip {
    let at = i * segment.stride + segment.clip_at;
    let lines = array<Linear, 4>(
        stored_form(at, 10u),
        stored_form(at, 13u),
        stored_form(at, 16u),
        stored_form(at, 19u),
    );
    let line_sign = stored_f32(at, 22u);
    if frame.clip_by_chord != 0u {
        let none = linear_new(0.0, vec2f(0.0, 0.0));
        return Clip(stored_form(at, 23u), none, none, 1.0, lines, line_sign);
    }
    return Clip(stored_form(at, 0u), stored_form(at, 3u), stored_form(at, 6u), stored_f32(at, 9u), lines, line_sign);
}
