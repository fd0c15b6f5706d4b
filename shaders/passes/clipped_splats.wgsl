// Entry points of raster hardware for clipped splats (rendering model §7); the compute path has its own in cells.wgsl
// and cell_raster.wgsl. The vertices of clipped splats also pass the index of the record whose clip the fragments
// evaluate. Splats without a clip have separate entry points, so that drawing them doesn't cost more.

// Clips of the records, in the order of `records`.
@group(1) @binding(1) var<storage, read> record_clips: array<RecordClip>;

// VisibilityVertex with the index of the record.
struct ClippedVisibilityVertex {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) base: vec2i,
    @location(1) @interpolate(flat, either) anchor: vec4f,
    @location(2) @interpolate(flat, either) uv: vec4f,
    @location(3) @interpolate(flat, either) depth: vec4f,
    @location(4) @interpolate(flat, either) at_anchor: vec3f,
    @location(5) @interpolate(flat, either) flags: u32,
    @location(9) @interpolate(flat, either) record: u32,
}

// AttributeVertex with the index of the record.
struct ClippedAttributeVertex {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) base: vec2i,
    @location(1) @interpolate(flat, either) anchor: vec4f,
    @location(2) @interpolate(flat, either) uv: vec4f,
    @location(3) @interpolate(flat, either) depth: vec4f,
    @location(4) @interpolate(flat, either) at_anchor: vec3f,
    @location(5) @interpolate(flat, either) w: vec4f,
    @location(6) @interpolate(flat, either) color: vec3f,
    @location(7) @interpolate(flat, either) normal: vec3f,
    @location(8) @interpolate(flat, either) flags: u32,
    @location(9) @interpolate(flat, either) record: u32,
}

@vertex
fn clipped_visibility_vertex(
    @builtin(vertex_index) vertex: u32,
    @builtin(instance_index) instance: u32,
) -> ClippedVisibilityVertex {
    let v = visibility_corner(vertex, instance);
    return ClippedVisibilityVertex(v.position, v.base, v.anchor, v.uv, v.depth, v.at_anchor, v.flags, instance);
}

// Returns a vertex with the index of its record.
fn clipped_attribute_corner(v: AttributeVertex, record: u32) -> ClippedAttributeVertex {
    return ClippedAttributeVertex(
        v.position, v.base, v.anchor, v.uv, v.depth, v.at_anchor, v.w, v.color, v.normal, v.flags, record,
    );
}

@vertex
fn clipped_attribute_vertex(
    @builtin(vertex_index) vertex: u32,
    @builtin(instance_index) instance: u32,
) -> ClippedAttributeVertex {
    return clipped_attribute_corner(attribute_corner(vertex, instance), instance);
}

// True if the clip of a record keeps a fragment of its unfiltered footprint.
fn clip_keeps_visible(in: VisibilityVertex, record: u32) -> bool {
    return clip_keeps(record_clips[record].visible, offset_of(in.position, in.base, in.anchor.xy));
}

// True if the clips of a record keep a fragment of its filtered footprint. In oriented clouds they also keep what the
// unfiltered footprint and its clip keep. The filtered footprint's own clip follows the stretched half-axes, and alone
// could remove every fragment of a pixel.
fn clip_keeps_filtered(in: AttributeVertex, record: u32) -> bool {
    let d = offset_of(in.position, in.base, in.anchor.xy);
    // If w ≤ 0, which only happens with `clamp`, the clip is evaluated at the centre.
    let w = form_at(in.w.xy, d, in.at_anchor.z);
    if clip_keeps(record_clips[record].filtered, select(vec2f(0.0, 0.0), d, 0.0 < w)) {
        return true;
    }
    if objects[in.flags >> RECORD_OBJECT].oriented == 0u {
        return false;
    }
    let uv = vec4f(records[record].visible_u, records[record].visible_v);
    return is_in_unfiltered(d, uv, in.depth.xy, in.at_anchor, in.flags) && clip_keeps(record_clips[record].visible, d);
}
