// Depth peeling of transparent splats (rendering model §8): the composited layers of each pixel so far, and the test
// for fragments still to be drawn.

// The layers of a pixel, composited front to back. All fields except the two depths are zero before the first layer.
struct LayerComposite {
    // Premultiplied colour of the composited layers, and their opacity.
    color: vec3f,
    opacity: f32,
    // Attributes of the nearest layer; a depth of 0 means that no layer has fragments yet.
    normal: vec3f,
    z: f32,
    weight: f32,
    // Number of fragments; from bit LAYER_COUNT on, number of layers that aren't empty.
    counts: u32,
    // Reversed depths of the last peeled layer and of the opaque surface (0: none). Fragments to be drawn lie between
    // the two.
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

// True for fragments of an A-buffer layer, which are also weighted by their coverage.
fn gathered_accumulates(in: AttributeVertex, z: f32) -> bool {
    return peeled_accumulates(in, z);
}

// True if a record's factor scales the coverage (§5), false if it scales the weight. With every filter, the other
// factor is 1. A record of an A-buffer thus stores both factors, and alpha, in full precision.
fn scale_is_coverage() -> bool {
    return frame.filter_kind == FILTER_CLAMP || frame.filter_kind == FILTER_ADJUST;
}

fn gathered_contribution(in: AttributeVertex) -> Contribution {
    return contribution_by(in, select(in.anchor.w, 1.0, scale_is_coverage()));
}

struct MaterialCoverageSums {
    @location(0) material: vec4f,
    // Number of fragments, Σw·alpha, coverage.
    @location(1) counts: vec4f,
}

fn material_coverage_sums_of(in: AttributeVertex, c: Contribution) -> MaterialCoverageSums {
    let share = select(1.0, in.anchor.w, scale_is_coverage());
    let coverage = c.weight * share * objects[in.flags >> RECORD_OBJECT].coverage;
    return MaterialCoverageSums(material_sums_of(in, c), vec4f(1.0, c.weight * in.w.z, coverage, 0.0));
}
