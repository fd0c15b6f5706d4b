// Per-splat lighting of the layer `remaining`, the last one of depth peeling (rendering model §8). Each splat is lit at
// its centre. Its lit colour replaces the albedo, and its weight is multiplied by alpha, which records of transparent
// splats store in place of the coverage.

// Returns the view position of a splat's centre.
fn center_of(r: Record) -> vec3f {
    if (r.flags & RECORD_CENTERED) != 0u {
        return vec3f(r.visible_u, r.visible_v.x);
    }
    let slope = (vec2f(r.base) + r.fraction - frame.projection.principal_px) / frame.projection.focal_px;
    return vec3f(slope * select(1.0, r.scale, frame.projection.kind == PERSPECTIVE), r.scale);
}

// Returns a corner of a splat's quad like `attribute_corner`, with the lit colour and the weight's factor times alpha.
fn lit_corner(vertex: u32, instance: u32) -> AttributeVertex {
    let r = records[instance];
    var v = attribute_corner(vertex, instance);
    let center = center_of(r);
    var material = frame.material;
    if frame.has_materials != 0u {
        material = objects[r.flags >> RECORD_OBJECT].material;
    }
    var albedo = vec3f(1.0, 1.0, 1.0);
    if frame.has_colors != 0u {
        albedo = r.color;
    }
    // The centre may be nearer than z_near, where the stored depth would exceed 1.
    let z = max(center.z, frame.projection.near);
    v.color = color_of(center, Point(albedo, r.normal, material, z, 0.0, true), true);
    v.anchor.w *= r.coverage;
    return v;
}

@vertex
fn lit_attribute_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> AttributeVertex {
    return lit_corner(vertex, instance);
}

@vertex
fn clipped_lit_attribute_vertex(
    @builtin(vertex_index) vertex: u32,
    @builtin(instance_index) instance: u32,
) -> ClippedAttributeVertex {
    return clipped_attribute_corner(lit_corner(vertex, instance), instance);
}
