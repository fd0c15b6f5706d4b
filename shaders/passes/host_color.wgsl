// The shader of a host. `surfel_wgpu::Renderer::set_shader` replaces this function by a text of the host. The struct
// is a part of the public interface: its fields keep their names, types and meaning.
fn host_color(surface: HostSurface) -> vec3f {
    return surface.lit;
}
