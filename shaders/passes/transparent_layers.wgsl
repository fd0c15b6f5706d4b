// Depth peeling of transparent splats (rendering model §8): what a pixel's layers have come to so far, and which
// fragments are still to be drawn.

// The layers of a pixel, composited front to back. All of it but the two depths is zero before the first layer.
struct LayerComposite {
    // Premultiplied colour of the layers so far, and their opacity.
    color: vec3f,
    opacity: f32,
    // Attributes of the nearest layer; a depth of 0 says that there is none yet.
    normal: vec3f,
    z: f32,
    weight: f32,
    // Number of fragments; from LAYER_COUNT on, of layers that aren't empty.
    counts: u32,
    // Reversed depths: unpeeled fragments are deeper than the first, and no deeper than the opaque surface (0: none).
    peeled_depth: f32,
    opaque_depth: f32,
}

const LAYER_COUNT: u32 = 24u;

@group(2) @binding(3) var<storage, read> layer_limits: array<LayerComposite>;

fn fragments_of(layers: LayerComposite) -> u32 {
    return layers.counts & ((1u << LAYER_COUNT) - 1u);
}

fn is_unpeeled(position: vec4f, z: f32) -> bool {
    let pixel = vec2u(floor(position.xy));
    let at = pixel.y * frame.size_px.x + pixel.x;
    let depth = reversed_depth(z);
    return depth < layer_limits[at].peeled_depth && layer_limits[at].opaque_depth <= depth;
}

fn peeled_is_visible(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0 && is_unpeeled(in.position, z);
}

fn peeled_accumulates(in: AttributeVertex, z: f32) -> bool {
    return is_within_threshold(in, z) && is_unpeeled(in.position, z);
}

fn remaining_accumulates(in: AttributeVertex, z: f32) -> bool {
    return is_unpeeled(in.position, z);
}

// A layer of an A-buffer: fragments count by their coverage, too.
fn gathered_accumulates(in: AttributeVertex, z: f32) -> bool {
    return peeled_accumulates(in, z);
}

// Largest share in 15 bits.
const SHARE_STEPS: f32 = 32767.0;

// Alpha and the coverage's share of its object's in one f32: both in [0, 1], to 1.5e-5. Two bits of the exponent are
// always 01, so that it is an ordinary number whatever they are.
fn packed_shares(alpha: f32, coverage: f32) -> f32 {
    let shares = vec2u(round(clamp(vec2f(alpha, coverage), vec2f(0.0, 0.0), vec2f(1.0, 1.0)) * SHARE_STEPS));
    let both = shares.x << 15u | shares.y;
    return bitcast<f32>((both >> 29u) << 31u | 0x20000000u | (both & 0x1fffffffu));
}

fn unpacked_shares(packed: f32) -> vec2f {
    let bits = bitcast<u32>(packed);
    let both = (bits >> 31u) << 29u | (bits & 0x1fffffffu);
    return vec2f(f32(both >> 15u), f32(both & 0x7fffu)) / SHARE_STEPS;
}

struct MaterialCoverageSums {
    @location(0) material: vec4f,
    // Number of fragments, Σw·alpha, coverage.
    @location(1) counts: vec4f,
}

fn material_coverage_sums_of(in: AttributeVertex, c: Contribution) -> MaterialCoverageSums {
    let shares = unpacked_shares(in.w.z) * c.weight;
    let coverage = shares.y * objects[in.flags >> RECORD_OBJECT].coverage;
    return MaterialCoverageSums(material_sums_of(in, c), vec4f(1.0, shares.x, coverage, 0.0));
}
