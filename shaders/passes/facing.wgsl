// Separation of front- and back-facing splats of oriented clouds (rendering model §5). A separate pass finds the side
// that each pixel shows, which is the side of the nearest fragment. Splats of the other side add nothing to sums. In
// the visibility pass, they only limit the depth of blending.

// Both flags of a record's side, RECORD_FRONT and RECORD_BACK.
const RECORD_FACING: u32 = 24u;

// Smallest `nearness` of the fragments of each pixel, in world units. It is negated if the fragment is back-facing: the
// pixel then shows the back side. 0 without a fragment of an oriented cloud.
@group(2) @binding(4) var shown_facing: texture_2d<f32>;

// Output of the pass that finds the side which each pixel shows.
struct FacingOutput {
    @builtin(frag_depth) depth: f32,
    @location(0) shown: f32,
}

// Returns the `nearness` of a fragment at depth z.
fn fragment_nearness(in: VisibilityVertex, z: f32) -> f32 {
    return nearness(z, in.anchor.w, (in.flags & RECORD_FACING) == RECORD_BACK);
}

// Returns the output of a fragment at depth z for `shown_facing`.
fn facing_output(in: VisibilityVertex, z: f32) -> FacingOutput {
    let near = fragment_nearness(in, z);
    return FacingOutput(reversed_depth(near), select(near, -near, (in.flags & RECORD_FACING) == RECORD_BACK));
}

// True if a fragment takes part in the pass that finds shown sides: it exists, and its splat has a side.
fn facing_is_visible(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0 && (in.flags & RECORD_FACING) != 0u;
}

// Returns the number of `shown_facing` at a fragment's pixel.
fn shown_nearness(position: vec4f) -> f32 {
    return textureLoad(shown_facing, vec2i(floor(position.xy)), 0).r;
}

// True if a pixel shows the side of a splat. Splats of clouds that aren't oriented have no side and always show.
fn shows(position: vec4f, flags: u32) -> bool {
    let own = flags & RECORD_FACING;
    let shown = shown_nearness(position);
    return own == 0u || shown == 0.0 || (own == RECORD_BACK) == (shown < 0.0);
}

// True if a fragment takes part in the visibility pass of the layer `shown`, the nearest surface in frames that
// separate sides.
fn shown_is_visible(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0;
}

// Returns the depth to which a fragment at depth z limits blending in its pixel: z + ε if the pixel shows the splat's
// side, else the middle between the two sides (`sheet_limit`).
fn shown_limit(in: VisibilityVertex, z: f32) -> f32 {
    if shows(in.position, in.flags) {
        return z + in.anchor.w;
    }
    return sheet_limit(abs(shown_nearness(in.position)), fragment_nearness(in, z));
}

// True if a fragment at depth z adds to the sums of the layer `shown`, the nearest surface in frames that separate
// sides.
fn shown_accumulates(in: AttributeVertex, z: f32) -> bool {
    return is_within_threshold(in, z) && shows(in.position, in.flags);
}

// True if a fragment at depth z adds to the sums of the layer `shown` in a frame with polygons.
fn shown_mesh_blend_accumulates(in: AttributeVertex, z: f32) -> bool {
    return mesh_blend_accumulates(in, z) && shows(in.position, in.flags);
}
