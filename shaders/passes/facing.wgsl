// Separation of front- and back-facing splats of oriented clouds (rendering model §5). A separate pass finds the side
// that each pixel shows: that of its nearest fragment. The other side then contributes neither to visibility nor to
// sums.

const RECORD_FACING: u32 = 24u;

// RECORD_FRONT, RECORD_BACK, or 0 where a pixel has no oriented fragment.
@group(2) @binding(4) var shown_facing: texture_2d<f32>;

struct FacingOutput {
    @builtin(frag_depth) depth: f32,
    @location(0) facing: f32,
}

fn facing_output(in: VisibilityVertex, z: f32) -> FacingOutput {
    let facing = in.flags & RECORD_FACING;
    return FacingOutput(reversed_depth(nearness(z, in.anchor.w, facing == RECORD_BACK)), f32(facing));
}

fn facing_is_visible(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0 && (in.flags & RECORD_FACING) != 0u;
}

// True if a pixel shows the side of a splat. Splats of clouds that aren't oriented have no side and always show.
fn shows(position: vec4f, flags: u32) -> bool {
    let own = flags & RECORD_FACING;
    let shown = u32(textureLoad(shown_facing, vec2i(floor(position.xy)), 0).r);
    return own == 0u || shown == 0u || own == shown;
}

fn shown_is_visible(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0 && shows(in.position, in.flags);
}

fn shown_accumulates(in: AttributeVertex, z: f32) -> bool {
    return is_within_threshold(in, z) && shows(in.position, in.flags);
}

fn shown_mesh_blend_accumulates(in: AttributeVertex, z: f32) -> bool {
    return mesh_blend_accumulates(in, z) && shows(in.position, in.flags);
}
