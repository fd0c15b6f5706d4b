// The edge background (rendering model §5, edge antialiasing): the surface behind the nearest one at edge pixels. The
// visibility and attribute passes run again over fragments deeper than the nearest surface's threshold.

// Threshold of the nearest surface at edge pixels, as a reversed depth; 0 elsewhere, so that no fragment lies behind
// it.
@group(2) @binding(1) var edge_threshold: texture_2d<f32>;

// True if a fragment at depth z lies behind the nearest surface of an edge pixel.
fn is_edge_background(position: vec4f, z: f32) -> bool {
    return reversed_depth(z) < textureLoad(edge_threshold, vec2i(floor(position.xy)), 0).r;
}

// True if a fragment takes part in the visibility pass of the layer `edge_background`.
fn edge_background_is_visible(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0 && is_edge_background(in.position, z);
}

// True if a fragment at depth z adds to the sums of the layer `edge_background`.
fn edge_background_accumulates(in: AttributeVertex, z: f32) -> bool {
    return is_within_threshold(in, z) && is_edge_background(in.position, z);
}
