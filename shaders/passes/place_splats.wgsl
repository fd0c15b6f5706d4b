// Writes positions, normals and colours from a buffer of the embedding application into the segment's stored f32
// splats. One invocation places one splat.
//
// A splat keeps its radius, clip and alpha. A disk's half-axes follow from its normal and radius wherever it is set up;
// an ellipse keeps its half-axes and can't be given a normal.

// Layout of the application's buffer `host_words`, and the box of valid positions. `stride` is the distance from one
// splat to the next, and the fields …_at are offsets within a splat, all in words.
struct HostSplats {
    // Smallest and largest coordinates, in object space, of a valid centre. A splat whose centre is outside isn't
    // drawn.
    box_low: vec3f,
    stride: u32,
    box_high: vec3f,
    // Number of splats in the buffer.
    count: u32,
    position_at: u32,
    // Each is ABSENT if the splats keep that attribute as it was uploaded.
    normal_at: u32,
    color_at: u32,
    // Format of normals and of colours: one of HOST_….
    normal_format: u32,
    color_format: u32,
}

// Three f32 numbers.
const HOST_F32X3: u32 = 0u;
// Four bytes from 0 to 1, of which the last is ignored. A normal's components are mapped to −1 to 1.
const HOST_UNORM8X4: u32 = 1u;
// Four bytes of an sRGB-encoded colour, of which the last is ignored.
const HOST_SRGB8X4: u32 = 2u;

@group(1) @binding(58) var<uniform> host_splats: HostSplats;
// The application's buffer.
@group(1) @binding(59) var<storage, read> host_words: array<u32>;
// Index in the application's buffer of each splat of the segment.
@group(1) @binding(60) var<storage, read> host_members: array<u32>;
// The words of the segment's stored splats (`splats` of the other passes).
@group(1) @binding(61) var<storage, read_write> placed_splats: array<u32>;

// Returns three f32 numbers of the application's buffer, from word `at` on.
fn host_numbers(at: u32) -> vec3f {
    return vec3f(
        bitcast<f32>(host_words[at]),
        bitcast<f32>(host_words[at + 1u]),
        bitcast<f32>(host_words[at + 2u]),
    );
}

// Returns an attribute at word `at` of the application's buffer, in one of the formats HOST_…. Bytes become numbers
// from 0 to 1, still encoded or unmapped.
fn host_attribute(at: u32, format: u32) -> vec3f {
    if format == HOST_F32X3 {
        return host_numbers(at);
    }
    return unpack4x8unorm(host_words[at]).xyz;
}

// True if no component is infinite or NaN. Comparisons with NaN aren't reliable in WGSL, so the bits are compared.
fn is_finite(v: vec3f) -> bool {
    let exponent = vec3u(0x7f800000u);
    return all((bitcast<vec3u>(v) & exponent) != exponent);
}

// Writes three f32 numbers to the stored splats, from word `at` on.
fn place_numbers(at: u32, v: vec3f) {
    placed_splats[at] = bitcast<u32>(v.x);
    placed_splats[at + 1u] = bitcast<u32>(v.y);
    placed_splats[at + 2u] = bitcast<u32>(v.z);
}

@compute @workgroup_size(WORKGROUP)
fn place_splats(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= segment.count {
        return;
    }
    let to = id.x * segment.stride;
    let member = host_members[id.x];
    placed_splats[to] = SPLAT_HIDDEN;
    if member >= host_splats.count {
        return;
    }
    let from_word = member * host_splats.stride;
    let position = host_numbers(from_word + host_splats.position_at);
    if !is_finite(position) || any(position < host_splats.box_low) || any(position > host_splats.box_high) {
        return;
    }
    if host_splats.normal_at != ABSENT {
        var normal = host_attribute(from_word + host_splats.normal_at, host_splats.normal_format);
        if host_splats.normal_format != HOST_F32X3 {
            normal = normal * 2.0 - 1.0;
        }
        if !is_finite(normal) || v3_max_abs(normal) <= 0.0 {
            return;
        }
        normal = unit(normal);
        place_numbers(to + segment.shape_at, normal);
        if segment.shading_normal_at != ABSENT {
            place_numbers(to + segment.shading_normal_at, normal);
        }
    }
    if host_splats.color_at != ABSENT {
        var color = host_attribute(from_word + host_splats.color_at, host_splats.color_format);
        if host_splats.color_format == HOST_SRGB8X4 {
            color = vec3f(srgb_decode(color.r), srgb_decode(color.g), srgb_decode(color.b));
        }
        if !is_finite(color) {
            return;
        }
        place_numbers(to + segment.color_at, max(color, vec3f(0.0, 0.0, 0.0)));
    }
    place_numbers(to + segment.center_at, position);
    placed_splats[to] = 0u;
}
