// Layers of transparent splats (rendering model §8): what limits their fragments, and how each layer is put behind the ones
// before it.

// What transparent splats add to a pixel, front to back. All zero but the limits before the first layer.
struct Veil {
    // Colour of the layers so far, premultiplied, and their opacity.
    color: vec3f,
    opacity: f32,
    // Of the nearest layer; a depth of 0 says that there is none yet.
    normal: vec3f,
    z: f32,
    weight: f32,
    // Number of fragments.
    fragments: f32,
    // Fragments are deeper than this comparable depth, and at most as deep as that of what is opaque (0: nothing).
    beyond: f32,
    opaque: f32,
}

@group(2) @binding(3) var<storage, read> layer_limits: array<Veil>;

fn remains(position: vec4f, z: f32) -> bool {
    let pixel = vec2u(floor(position.xy));
    let at = pixel.y * frame.size_px.x + pixel.x;
    let depth = comparable(z);
    return depth < layer_limits[at].beyond && layer_limits[at].opaque <= depth;
}

fn peeled_shows(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0 && remains(in.position, z);
}

fn peeled_adds(in: AttributeVertex, z: f32) -> bool {
    return is_kept(in, z) && remains(in.position, z);
}

fn remaining_adds(in: AttributeVertex, z: f32) -> bool {
    return remains(in.position, z);
}
