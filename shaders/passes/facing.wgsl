// Separation of front- and back-facing splats of oriented clouds (rendering model §5). A separate pass finds the side
// that each pixel shows, which is the side of the nearest fragment. The other side adds nothing to sums. In the
// visibility pass, it only limits the depth of blending.

const RECORD_FACING: u32 = 24u;

// Nearness of the side that each pixel shows: negative for the back side, 0 without an oriented fragment.
@group(2) @binding(4) var shown_facing: texture_2d<f32>;

struct FacingOutput {
    @builtin(frag_depth) depth: f32,
    @location(0) shown: f32,
}

fn fragment_nearness(in: VisibilityVertex, z: f32) -> f32 {
    return nearness(z, in.anchor.w, (in.flags & RECORD_FACING) == RECORD_BACK);
}

fn facing_output(in: VisibilityVertex, z: f32) -> FacingOutput {
    let near = fragment_nearness(in, z);
    return FacingOutput(reversed_depth(near), select(near, -near, (in.flags & RECORD_FACING) == RECORD_BACK));
}

fn facing_is_visible(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0 && (in.flags & RECORD_FACING) != 0u;
}

fn shown_nearness(position: vec4f) -> f32 {
    return textureLoad(shown_facing, vec2i(floor(position.xy)), 0).r;
}

// True if a pixel shows the side of a splat. Splats of clouds that aren't oriented have no side and always show.
fn shows(position: vec4f, flags: u32) -> bool {
    let own = flags & RECORD_FACING;
    let shown = shown_nearness(position);
    return own == 0u || shown == 0.0 || (own == RECORD_BACK) == (shown < 0.0);
}

fn shown_is_visible(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0;
}

// Returns the depth limit that a fragment sets for blending in its pixel.
fn shown_limit(in: VisibilityVertex, z: f32) -> f32 {
    if shows(in.position, in.flags) {
        return z + in.anchor.w;
    }
    return sheet_limit(abs(shown_nearness(in.position)), fragment_nearness(in, z));
}

fn shown_accumulates(in: AttributeVertex, z: f32) -> bool {
    return is_within_threshold(in, z) && shows(in.position, in.flags);
}

fn shown_mesh_blend_accumulates(in: AttributeVertex, z: f32) -> bool {
    return mesh_blend_accumulates(in, z) && shows(in.position, in.flags);
}
