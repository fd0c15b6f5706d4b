// Depth peeling of transparent splats (rendering model §8): the composited layers of each pixel so far, and the test
// for fragments that no layer has drawn yet. Layers are drawn from near to far.

// The layers of a pixel, composited front to back. Before the first layer, all fields except peeled_depth and
// opaque_depth are zero.
struct LayerComposite {
    // Premultiplied colour of the composited layers, and their opacity.
    color: vec3f,
    opacity: f32,
    // Normal, depth and weight Σw of the nearest layer that has fragments; a depth of 0 means that no layer has
    // fragments yet.
    normal: vec3f,
    z: f32,
    weight: f32,
    // Bits below LAYER_COUNT: number of fragments. From bit LAYER_COUNT on: number of layers that aren't empty.
    counts: u32,
    // Reversed depth threshold of the last layer drawn, and reversed depth of the opaque surface (0: none). Fragments
    // still to be drawn lie between the two.
    peeled_depth: f32,
    opaque_depth: f32,
}

// Number of the bit at which the number of layers begins in LayerComposite.counts.
const LAYER_COUNT: u32 = 24u;

// Layers of each pixel of the targets so far, row by row: the buffer `layer_composites`.
@group(2) @binding(3) var<storage, read> layer_limits: array<LayerComposite>;

// Returns the number of fragments in the layers of a pixel.
fn fragments_of(layers: LayerComposite) -> u32 {
    return layers.counts & ((1u << LAYER_COUNT) - 1u);
}

// True if a fragment at depth z lies behind the layers drawn so far, and not behind the opaque surface.
fn is_unpeeled(position: vec4f, z: f32) -> bool {
    let pixel = vec2u(floor(position.xy));
    let at = pixel.y * frame.size_px.x + pixel.x;
    let depth = reversed_depth(z);
    return depth < layer_limits[at].peeled_depth && layer_limits[at].opaque_depth <= depth;
}

// True if a fragment takes part in the visibility pass of the layer `peeled`, the nearest one not drawn yet.
fn peeled_is_visible(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0 && is_unpeeled(in.position, z);
}

// True if a fragment at depth z adds to the sums of the layer `peeled`.
fn peeled_accumulates(in: AttributeVertex, z: f32) -> bool {
    return is_within_threshold(in, z) && is_unpeeled(in.position, z);
}

// True if a fragment at depth z adds to the sums of the layer `remaining`: the last one, of all fragments not drawn
// yet.
fn remaining_accumulates(in: AttributeVertex, z: f32) -> bool {
    return is_unpeeled(in.position, z);
}

// True if a fragment at depth z adds to the sums of the layer `gathered`, a surface of an A-buffer. Its fragments are
// those of a peeled layer, and its coverage is summed, too.
fn gathered_accumulates(in: AttributeVertex, z: f32) -> bool {
    return peeled_accumulates(in, z);
}

// True if the frame's filter scales the coverage (rendering model §5), false if it scales the weight. The other of the
// two factors is 1 with every filter. In an A-buffer, the record's field weight_scale stores the one that isn't, and
// the field `coverage` stores alpha.
fn scale_is_coverage() -> bool {
    return frame.filter_kind == FILTER_CLAMP || frame.filter_kind == FILTER_ADJUST;
}

// Returns the contribution of a fragment in an A-buffer, where the record's weight_scale may be a factor of the
// coverage.
fn gathered_contribution(in: AttributeVertex) -> Contribution {
    return contribution_by(in, select(in.anchor.w, 1.0, scale_is_coverage()));
}

// Output of the attribute pass of an A-buffer that sums material factors and counts.
struct MaterialCoverageSums {
    @location(0) material: vec4f,
    // Number of fragments, Σw·alpha, coverage, 0.
    @location(1) counts: vec4f,
}

// Returns what a fragment adds to the sums of material factors, fragments, alpha and coverage in an A-buffer.
fn material_coverage_sums_of(in: AttributeVertex, c: Contribution) -> MaterialCoverageSums {
    let share = select(1.0, in.anchor.w, scale_is_coverage());
    let coverage = c.weight * share * objects[in.flags >> RECORD_OBJECT].coverage;
    return MaterialCoverageSums(material_sums_of(in, c), vec4f(1.0, c.weight * in.w.z, coverage, 0.0));
}
