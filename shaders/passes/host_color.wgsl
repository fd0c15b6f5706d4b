// Returns the colour of a surface by the shader of the embedding application. `surfel_wgpu::Renderer::set_shader`
// replaces this function by WGSL of the application. The struct HostSurface is a part of the public interface: its
// fields keep their names, types and meaning.
fn host_color(surface: HostSurface) -> vec3f {
    return surface.lit;
}
