// What a device does at best: triangles over everything whose fragments compute nothing.

@vertex
fn ceiling_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    // Every triangle is nearer than the one before.
    return vec4f(corner * 2.0 - 1.0, f32(instance + 1u) / 64.0, 1.0);
}

@fragment
fn ceiling_depth_fragment(@builtin(position) position: vec4f) -> @builtin(frag_depth) f32 {
    return position.z;
}

@fragment
fn ceiling_color_fragment() -> @location(0) vec4f {
    return vec4f(0.25, 0.25, 0.25, 1.0);
}

@fragment
fn ceiling_surface_fragment() -> SurfaceSums {
    return SurfaceSums(vec4f(0.25, 0.25, 0.25, 1.0), vec4f(0.0, 0.0, 1.0, 0.5));
}
