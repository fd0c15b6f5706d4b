// Once a pixel (rendering model §5): divide by Σw, renormalise, rebuild the position, shade.

@group(1) @binding(0) var color_sums: texture_2d<f32>;
@group(1) @binding(1) var surface_sums: texture_2d<f32>;
@group(1) @binding(2) var material_sums: texture_2d<f32>;
@group(1) @binding(3) var count_sums: texture_2d<f32>;
@group(1) @binding(4) var<storage, read_write> planes: array<f32>;

// Σw below this has lost its attributes to underflow: the pixel is empty. Only splats smaller than 1e-18 pixels weigh less.
const LEAST_WEIGHT: f32 = 1e-36;

struct Surface {
    color: vec3f,
    normal: vec3f,
    z: f32,
    weight: f32,
    is_there: bool,
}

fn unit_or_zero(v: vec3f) -> vec3f {
    let square = v3_dot(v, v);
    return select(vec3f(0.0, 0.0, 0.0), v * (1.0 / sqrt(max(square, 1e-30))), square > 1e-30);
}

fn shaded(pixel: vec2i) -> Surface {
    let sums = textureLoad(color_sums, pixel, 0);
    if !(LEAST_WEIGHT <= sums.w) {
        return Surface(vec3f(0.0, 0.0, 0.0), vec3f(0.0, 0.0, 0.0), 0.0, 0.0, false);
    }
    let inverse = 1.0 / sums.w;
    let surface = textureLoad(surface_sums, pixel, 0) * inverse;
    let normal = unit_or_zero(surface.xyz);
    let z = surface.w;
    var albedo = vec3f(1.0, 1.0, 1.0);
    if frame.has_colors != 0u {
        albedo = sums.rgb * inverse;
    }
    var color = albedo;
    switch frame.shader_kind {
        case SHADER_PHONG: {
            let slope = frame.ray_start + vec2f(pixel + frame.origin_px) * frame.ray_step;
            var material = frame.material;
            if frame.has_materials != 0u {
                material = textureLoad(material_sums, pixel, 0) * inverse;
            }
            if frame.projection.kind == PERSPECTIVE {
                let ray = frame.world_from_view * vec3f(slope, 1.0);
                color = phong(albedo, normal, ray * z, -unit(ray), material);
            } else {
                color = phong(albedo, normal, frame.world_from_view * vec3f(slope, z), frame.to_eye, material);
            }
        }
        case SHADER_NORMAL: {
            color = select(vec3f(0.0, 0.0, 0.0), normal * 0.5 + 0.5, v3_dot(normal, normal) > 0.0);
        }
        case SHADER_DEPTH: {
            let projection = frame.projection;
            var stored = projection.near / z;
            if projection.kind == ORTHOGRAPHIC {
                stored = 1.0 - (z - projection.near) / (projection.far - projection.near);
            }
            color = vec3f(stored, stored, stored);
        }
        default: {
        }
    }
    return Surface(color, normal, z, sums.w, true);
}

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.size_px.x || id.y >= frame.size_px.y {
        return;
    }
    let pixel = vec2i(id.xy);
    let at = id.y * frame.size_px.x + id.x;
    let surface = shaded(pixel);
    if frame.color_at != ABSENT {
        let color = select(frame.background, vec4f(surface.color, 1.0), surface.is_there);
        let to = frame.color_at + 4u * at;
        planes[to] = color.r;
        planes[to + 1u] = color.g;
        planes[to + 2u] = color.b;
        planes[to + 3u] = color.a;
    }
    if frame.depth_at != ABSENT {
        planes[frame.depth_at + at] = select(frame.empty_depth, surface.z, surface.is_there);
    }
    if frame.normal_at != ABSENT {
        let to = frame.normal_at + 3u * at;
        planes[to] = surface.normal.x;
        planes[to + 1u] = surface.normal.y;
        planes[to + 2u] = surface.normal.z;
    }
    if frame.weight_at != ABSENT {
        planes[frame.weight_at + at] = surface.weight;
    }
    if frame.fragments_at != ABSENT {
        planes[frame.fragments_at + at] = textureLoad(count_sums, pixel, 0).r;
    }
}

// Three corners that hold the whole target.
@vertex
fn composite_vertex(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4f(corner * 2.0 - 1.0, 0.0, 1.0);
}

struct Composite {
    @location(0) color: vec4f,
    @builtin(frag_depth) depth: f32,
}

// The picture as a part of a host's: its depth test decides where it shows.
@fragment
fn composite_fragment(@builtin(position) position: vec4f) -> Composite {
    let surface = shaded(vec2i(floor(position.xy)));
    if !surface.is_there {
        discard;
    }
    var along = 1.0 / surface.z;
    if frame.projection.kind == ORTHOGRAPHIC {
        along = surface.z;
    }
    return Composite(vec4f(surface.color, 1.0), fma(frame.host_depth.y, along, frame.host_depth.x));
}
