// The visibility pass (rendering model §5): splats are drawn as quads over their records' pixel boxes. The depth buffer
// stores the depth threshold, which is the smallest z + ε of a pixel. The attribute pass uses the same quads and
// depths.

// Records of the draw's splats, one per instance.
@group(1) @binding(0) var<storage, read> records: array<Record>;

// Record of a splat, as a fragment of the unfiltered footprint needs it; see Record for the fields.
struct VisibilityVertex {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) base: vec2i,
    // Fraction of the anchor, scale of the depth form, ε.
    @location(1) @interpolate(flat, either) anchor: vec4f,
    // Gradients of the unfiltered u·w and v·w.
    @location(2) @interpolate(flat, either) uv: vec4f,
    // Gradient and range of the depth form.
    @location(3) @interpolate(flat, either) depth: vec4f,
    // u·w, v·w, w at the anchor.
    @location(4) @interpolate(flat, either) at_anchor: vec3f,
    @location(5) @interpolate(flat, either) flags: u32,
}

// Returns corner 0 … 3 of a triangle strip over a box of the targets' pixels, in clip space. The box has the format of
// Record.visible_box. An empty box has no area and no fragments.
fn corner_of(pixels: vec2u, vertex: u32) -> vec4f {
    let first = vec2u(pixels.x & 0xffffu, pixels.x >> 16u);
    let end = vec2u(pixels.y & 0xffffu, pixels.y >> 16u);
    let corner = vec2f(select(first, end, vec2<bool>((vertex & 1u) != 0u, (vertex & 2u) != 0u)));
    let ndc = corner / vec2f(frame.size_px) * 2.0 - 1.0;
    return vec4f(ndc.x, -ndc.y, 0.0, 1.0);
}

// Returns the offset, in pixels, from a record's anchor to the centre of the fragment's pixel. `position` is the
// fragment's position in the targets. Integers are exact, so an offset is rounded once.
fn offset_of(position: vec4f, base: vec2i, fraction: vec2f) -> vec2f {
    let pixel = vec2i(floor(position.xy)) + frame.origin_px;
    return vec2f(pixel - base) + (vec2f(0.5, 0.5) - fraction);
}

// Returns the value of a linear form at pixel offset d: gradient·d + constant.
fn form_at(gradient: vec2f, d: vec2f, constant: f32) -> f32 {
    return fma(gradient.x, d.x, fma(gradient.y, d.y, constant));
}

// Returns the depth of the splat's plane at pixel offset d, clamped to the disk's range (rendering model §3). `depth`
// is the gradient and the range of the depth form. Visibility and attribute pass call this with the same numbers, so a
// fragment's depth is the same in both.
fn fragment_depth(d: vec2f, depth: vec4f, scale: f32, w_at_anchor: f32, flags: u32) -> f32 {
    if (flags & RECORD_RECIPROCAL) != 0u {
        return scale / clamp(form_at(depth.xy, d, w_at_anchor), depth.z, depth.w);
    }
    return clamp(form_at(depth.xy, d, scale), depth.z, depth.w);
}

// Returns the reversed depth z_near/z, which an f32 depth buffer stores accurately, near or far.
fn reversed_depth(z: f32) -> f32 {
    return frame.projection.near / z;
}

// True if a fragment at depth z lies between the near and the far plane.
fn exists(z: f32) -> bool {
    return frame.projection.near <= z && z <= frame.projection.far;
}

@vertex
fn visibility_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> VisibilityVertex {
    return visibility_corner(vertex, instance);
}

// Returns corner 0 … 3 of the quad over the unfiltered box of record number `instance`.
fn visibility_corner(vertex: u32, instance: u32) -> VisibilityVertex {
    let r = records[instance];
    return VisibilityVertex(
        corner_of(r.visible_box, vertex),
        r.base,
        vec4f(r.fraction, r.scale, r.epsilon),
        vec4f(r.visible_u, r.visible_v),
        vec4f(r.depth, r.range),
        vec3f(r.at_anchor, r.w_at_anchor),
        r.flags,
    );
}

// True if the unfiltered splat covers the pixel at offset d. `uv` are the gradients of its (u·w, v·w), `depth` is the
// gradient of its depth form, and `at_anchor` are u·w, v·w and w at the anchor.
fn is_in_unfiltered(d: vec2f, uv: vec4f, depth: vec2f, at_anchor: vec3f, flags: u32) -> bool {
    let u = form_at(uv.xy, d, at_anchor.x);
    let v = form_at(uv.zw, d, at_anchor.y);
    var w = 1.0;
    if (flags & RECORD_RECIPROCAL) != 0u {
        w = form_at(depth, d, at_anchor.z);
    }
    return 0.0 < w && fma(u, u, v * v) <= w * w;
}

// Returns the depth of the unfiltered splat at the fragment's pixel; 0 if the splat doesn't cover the pixel or isn't
// between the near and the far plane.
fn visible_depth(in: VisibilityVertex) -> f32 {
    let d = offset_of(in.position, in.base, in.anchor.xy);
    let z = fragment_depth(d, in.depth, in.anchor.z, in.at_anchor.z, in.flags);
    return select(0.0, z, is_in_unfiltered(d, in.uv, in.depth.xy, in.at_anchor, in.flags) && exists(z));
}

// Output of visibility passes that also find the splat which defines each pixel's depth threshold.
struct ThresholdOutput {
    @builtin(frag_depth) depth: f32,
    // The z + ε and the ε of the splat that defines the threshold, for edge detection. If several splats give the same
    // threshold, the first one drawn remains, in the order of the buffers, not of the cloud.
    @location(0) threshold_tolerance: vec2f,
}

// Returns the output of a fragment at depth z, which lowers its pixel's depth threshold to `limit`, if that is smaller.
fn threshold_output(in: VisibilityVertex, z: f32, limit: f32) -> ThresholdOutput {
    return ThresholdOutput(reversed_depth(limit), vec2f(z + in.anchor.w, in.anchor.w));
}

// True if a fragment takes part in the visibility pass of the layer `front`, the nearest surface. z is 0 if the splat
// doesn't cover the pixel. The generated entry points (build/fragment_variants.rs) call this function, and those of
// other layers with the same ending.
fn front_is_visible(in: VisibilityVertex, z: f32) -> bool {
    return z > 0.0;
}
