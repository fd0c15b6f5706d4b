// Reads splats from their storage buffer in the layout of surfel-gpu: 32-bit words, or 16-bit half-words if splats are
// quantised. Offsets within a splat are in that unit.

@group(1) @binding(0) var<uniform> segment: Segment;
@group(1) @binding(1) var<storage, read> splats: array<u32>;

fn is_quantised() -> bool {
    return segment.scales_at != ABSENT;
}

fn stored_half(at: u32) -> u32 {
    return (splats[at / 2u] >> (16u * (at % 2u))) & 0xffffu;
}

fn stored_word(at: u32) -> u32 {
    if is_quantised() {
        return stored_half(at) | (stored_half(at + 1u) << 16u);
    }
    return splats[at];
}

// Returns the n-th of consecutive f32 numbers.
fn stored_f32(at: u32, n: u32) -> f32 {
    return bitcast<f32>(stored_word(at + n * select(1u, 2u, is_quantised())));
}

// Returns the n-th of consecutive numbers that are relative to a scale of their chunk.
fn stored_number(at: u32, n: u32, scale: f32) -> f32 {
    if is_quantised() {
        return (f32(stored_half(at + n)) - 32768.0) * scale;
    }
    return bitcast<f32>(splats[at + n]);
}

fn stored_numbers(at: u32, scale: f32) -> vec3f {
    return vec3f(stored_number(at, 0u, scale), stored_number(at, 1u, scale), stored_number(at, 2u, scale));
}

fn stored_unit(at: u32) -> vec3f {
    if is_quantised() {
        let v = unfolded(stored_number(at, 0u, 1.0 / 32767.0), stored_number(at, 1u, 1.0 / 32767.0));
        return v * (1.0 / v3_length(v));
    }
    return stored_numbers(at, 0.0);
}

// Returns a chunk's quantisation steps of centres, radii and colours.
fn stored_scales(chunk: u32) -> vec3f {
    if !is_quantised() {
        return vec3f(0.0, 0.0, 0.0);
    }
    let at = segment.scales_at + 3u * chunk;
    return vec3f(bitcast<f32>(splats[at]), bitcast<f32>(splats[at + 1u]), bitcast<f32>(splats[at + 2u]));
}

fn stored_form(at: u32, n: u32) -> Linear {
    return Linear(stored_f32(at, n), stored_f32(at, n + 1u), stored_f32(at, n + 2u));
}

// Returns the clip of splat i over its (u, v), by the frame's clip policy. A stored clip has nine numbers of the curve
// and its sign, twelve numbers of the lines and their sign, and three numbers of the chord.
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
