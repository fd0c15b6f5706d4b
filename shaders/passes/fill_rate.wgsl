// Fill-rate probes: full-screen triangles whose fragments compute nothing. They measure upper bounds of a device's
// speed.

@vertex
fn probe_vertex(
    @builtin(vertex_index) vertex: u32,
    @builtin(instance_index) instance: u32,
) -> @builtin(position) vec4f {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    // Every triangle is nearer than the one before, so that all pass the depth test.
    return vec4f(corner * 2.0 - 1.0, f32(instance + 1u) / 64.0, 1.0);
}

@fragment
fn probe_depth_fragment(@builtin(position) position: vec4f) -> @builtin(frag_depth) f32 {
    return position.z;
}

@fragment
fn probe_color_fragment() -> @location(0) vec4f {
    return vec4f(0.25, 0.25, 0.25, 1.0);
}

@fragment
fn probe_surface_fragment() -> SurfaceSums {
    return SurfaceSums(vec4f(0.25, 0.25, 0.25, 1.0), vec4f(0.0, 0.0, 1.0, 0.5));
}
