// The attribute pass (rendering model §5): fragments of filtered footprints that are no deeper than the depth threshold
// accumulate their weighted attributes by additive blending.

@group(2) @binding(0) var depth_threshold: texture_depth_2d;

struct AttributeVertex {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) base: vec2i,
    // Fraction of the anchor, scale of the depth form, factor of the weight.
    @location(1) @interpolate(flat, either) anchor: vec4f,
    @location(2) @interpolate(flat, either) uv: vec4f,
    @location(3) @interpolate(flat, either) depth: vec4f,
    @location(4) @interpolate(flat, either) at_anchor: vec3f,
    // Gradient of w, coverage of a unit of weight, ε.
    @location(5) @interpolate(flat, either) w: vec4f,
    @location(6) @interpolate(flat, either) color: vec3f,
    @location(7) @interpolate(flat, either) normal: vec3f,
    @location(8) @interpolate(flat, either) flags: u32,
}

@vertex
fn attribute_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> AttributeVertex {
    return attribute_corner(vertex, instance);
}

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

struct Contribution {
    weight: f32,
    z: f32,
    is_there: bool,
}

fn contribution(in: AttributeVertex) -> Contribution {
    return contribution_by(in, in.anchor.w);
}

fn contribution_by(in: AttributeVertex, weight_scale: f32) -> Contribution {
    let d = offset_of(in.position, in.base, in.anchor.xy);
    return contribution_at(d, in.uv, in.w.xy, in.at_anchor, in.depth, in.anchor.z, in.flags, weight_scale);
}

// Returns the contribution at an offset from the anchor. The gradients are those of the filtered footprint.
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

fn front_accumulates(in: AttributeVertex, z: f32) -> bool {
    return is_within_threshold(in, z);
}

// Depth of the nearest polygon, or 0 (rendering model §6).
@group(2) @binding(2) var polygon_limit: texture_2d<f32>;

// Mesh/splat blend: a fragment may also be at most ε behind a polygon that no splat occludes.
fn mesh_blend_accumulates(in: AttributeVertex, z: f32) -> bool {
    let pixel = vec2i(floor(in.position.xy));
    let nearest = textureLoad(depth_threshold, pixel, 0);
    let polygon = textureLoad(polygon_limit, pixel, 0).r;
    let shows = polygon > 0.0 && nearest <= reversed_depth(polygon);
    return nearest <= reversed_depth(z) && (!shows || z - in.w.w <= polygon);
}

// Returns a fragment's sums w·(colour, 1).
fn color_sums_of(in: AttributeVertex, c: Contribution) -> vec4f {
    return vec4f(in.color, 1.0) * c.weight;
}

struct SurfaceSums {
    @location(0) color: vec4f,
    @location(1) surface: vec4f,
}

// Returns a fragment's sums w·(colour, 1) and w·(normal, z).
fn surface_sums_of(in: AttributeVertex, c: Contribution) -> SurfaceSums {
    return SurfaceSums(color_sums_of(in, c), vec4f(in.normal, c.z * frame.per_depth_unit) * c.weight);
}

// Returns a fragment's sums w·(ambient, diffuse and specular factor, shininess).
fn material_sums_of(in: AttributeVertex, c: Contribution) -> vec4f {
    return objects[in.flags >> RECORD_OBJECT].material * c.weight;
}

struct MaterialCountsSums {
    @location(0) material: vec4f,
    // Number of fragments, and coverage.
    @location(1) counts: vec2f,
}

// Returns Σw·material factors, the number of fragments and their coverage. They have their own pass, because few frames
// need them, and all targets together would exceed the 32 bytes a sample that every adapter supports.
fn material_counts_sums_of(in: AttributeVertex, c: Contribution) -> MaterialCountsSums {
    return MaterialCountsSums(material_sums_of(in, c), vec2f(1.0, c.weight * in.w.z));
}
