// The attribute pass (rendering model §5): fragments of filtered footprints that are no deeper than the depth threshold
// add their weighted attributes to the sums of their pixel, by additive blending.

// Depth buffer of the visibility pass: the reversed depth threshold of each pixel; 0 without one.
@group(2) @binding(0) var depth_threshold: texture_depth_2d;

// Record of a splat, as a fragment of the filtered footprint needs it; see Record for the fields.
struct AttributeVertex {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) base: vec2i,
    // Fraction of the anchor, scale of the depth form, factor of the weight.
    @location(1) @interpolate(flat, either) anchor: vec4f,
    // Gradients of the filtered u·w and v·w.
    @location(2) @interpolate(flat, either) uv: vec4f,
    // Gradient and range of the depth form.
    @location(3) @interpolate(flat, either) depth: vec4f,
    // u·w, v·w, w at the anchor.
    @location(4) @interpolate(flat, either) at_anchor: vec3f,
    // Gradient of the filtered w, coverage of a unit of weight, ε.
    @location(5) @interpolate(flat, either) w: vec4f,
    @location(6) @interpolate(flat, either) color: vec3f,
    @location(7) @interpolate(flat, either) normal: vec3f,
    @location(8) @interpolate(flat, either) flags: u32,
}

@vertex
fn attribute_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> AttributeVertex {
    return attribute_corner(vertex, instance);
}

// Returns corner 0 … 3 of the quad over the filtered box of record number `instance`.
fn attribute_corner(vertex: u32, instance: u32) -> AttributeVertex {
    let r = records[instance];
    return AttributeVertex(
        corner_of(r.filtered_box, vertex),
        r.base,
        vec4f(r.fraction, r.scale, r.weight_scale),
        vec4f(r.u, r.v),
        vec4f(r.depth, r.range),
        vec3f(r.at_anchor, r.w_at_anchor),
        vec4f(r.w, r.coverage, r.epsilon),
        r.color,
        r.normal,
        r.flags,
    );
}

// What a splat adds to a pixel: its weight and its depth there. `is_there` is false if the filtered footprint doesn't
// cover the pixel, or if the depth isn't between the near and the far plane.
struct Contribution {
    weight: f32,
    z: f32,
    is_there: bool,
}

// Returns the contribution of a fragment.
fn contribution(in: AttributeVertex) -> Contribution {
    return contribution_by(in, in.anchor.w);
}

// Returns the contribution of a fragment with another factor of the weight than the record's.
fn contribution_by(in: AttributeVertex, weight_scale: f32) -> Contribution {
    let d = offset_of(in.position, in.base, in.anchor.xy);
    return contribution_at(d, in.uv, in.w.xy, in.at_anchor, in.depth, in.anchor.z, in.flags, weight_scale);
}

// Returns the contribution of a splat at pixel offset d from its anchor. `uv` and `w_gradient` are the gradients of its
// filtered (u·w, v·w) and w. `depth` is the gradient and range of its depth form, and `scale` the form's scale.
fn contribution_at(
    d: vec2f,
    uv: vec4f,
    w_gradient: vec2f,
    at_anchor: vec3f,
    depth: vec4f,
    scale: f32,
    flags: u32,
    weight_scale: f32,
) -> Contribution {
    let u = form_at(uv.xy, d, at_anchor.x);
    let v = form_at(uv.zw, d, at_anchor.y);
    let w = form_at(w_gradient, d, at_anchor.z);
    let square = fma(u, u, v * v);
    var inside = 0.0 < w && square <= w * w;
    var rho_squared = square / (select(1.0, w * w, inside));
    if (flags & RECORD_CLAMP) != 0u {
        let disk = fma(d.x, d.x, d.y * d.y) / (frame.radius_px * frame.radius_px);
        rho_squared = min(select(disk, rho_squared, inside), disk);
        inside = inside || disk <= 1.0;
    }
    let z = fragment_depth(d, depth, scale, at_anchor.z, flags);
    return Contribution(weight(rho_squared, frame.cutoff) * weight_scale, z, inside && exists(z));
}

// True for fragments no deeper than the depth threshold of the visibility pass.
fn is_within_threshold(in: AttributeVertex, z: f32) -> bool {
    return textureLoad(depth_threshold, vec2i(floor(in.position.xy)), 0) <= reversed_depth(z);
}

// True if a fragment at depth z adds to the sums of the layer `front`, the nearest surface.
fn front_accumulates(in: AttributeVertex, z: f32) -> bool {
    return is_within_threshold(in, z);
}

// Depth of each pixel's nearest polygon, or 0 without one (rendering model §6).
@group(2) @binding(2) var polygon_limit: texture_2d<f32>;

// True if a fragment at depth z adds to the sums of the layer `front` in a frame with polygons. Where a polygon shows
// that no splat occludes, the fragment also has to be at most ε behind the polygon.
fn mesh_blend_accumulates(in: AttributeVertex, z: f32) -> bool {
    let pixel = vec2i(floor(in.position.xy));
    let nearest = textureLoad(depth_threshold, pixel, 0);
    let polygon = textureLoad(polygon_limit, pixel, 0).r;
    let shows = polygon > 0.0 && nearest <= reversed_depth(polygon);
    return nearest <= reversed_depth(z) && (!shows || z - in.w.w <= polygon);
}

// Returns what a fragment of weight w adds to the sums of colour and weight: w·(colour, 1).
fn color_sums_of(in: AttributeVertex, c: Contribution) -> vec4f {
    return vec4f(in.color, 1.0) * c.weight;
}

// Output of attribute passes that sum normals and depths, too.
struct SurfaceSums {
    @location(0) color: vec4f,
    @location(1) surface: vec4f,
}

// Returns what a fragment of weight w adds to the sums: w·(colour, 1) and w·(normal, z), with z in Frame.depth_unit.
fn surface_sums_of(in: AttributeVertex, c: Contribution) -> SurfaceSums {
    return SurfaceSums(color_sums_of(in, c), vec4f(in.normal, c.z * frame.per_depth_unit) * c.weight);
}

// Returns what a fragment of weight w adds to the sums of material factors: w·(ambient, diffuse and specular factor,
// shininess).
fn material_sums_of(in: AttributeVertex, c: Contribution) -> vec4f {
    return objects[in.flags >> RECORD_OBJECT].material * c.weight;
}

// Output of the attribute pass that sums material factors and counts.
struct MaterialCountsSums {
    @location(0) material: vec4f,
    // Number of fragments; coverage, or Σw·alpha where records store alpha.
    @location(1) counts: vec2f,
}

// Returns what a fragment adds to the sums of material factors, of fragments and of coverage. These sums have their own
// pass, because few frames need them, and because all targets together would exceed the 32 bytes per sample that every
// adapter supports.
fn material_counts_sums_of(in: AttributeVertex, c: Contribution) -> MaterialCountsSums {
    return MaterialCountsSums(material_sums_of(in, c), vec2f(1.0, c.weight * in.w.z));
}
