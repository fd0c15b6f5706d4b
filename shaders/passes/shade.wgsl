// Once a pixel (rendering model §5): divide by Σw, renormalise, rebuild the position, shade.

@group(1) @binding(0) var color_sums: texture_2d<f32>;
@group(1) @binding(1) var surface_sums: texture_2d<f32>;
@group(1) @binding(2) var material_sums: texture_2d<f32>;
@group(1) @binding(3) var count_sums: texture_2d<f32>;
@group(1) @binding(4) var<storage, read_write> planes: array<f32>;
// Where edges are antialiased.
@group(1) @binding(5) var edge_limit: texture_2d<f32>;
@group(1) @binding(6) var writers: texture_2d<f32>;
@group(1) @binding(7) var color_behind: texture_2d<f32>;
@group(1) @binding(8) var surface_behind: texture_2d<f32>;
@group(1) @binding(9) var material_behind: texture_2d<f32>;

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

// The surface of a pixel's sums: colour and weight, normal and depth, material factors.
fn shaded(pixel: vec2i, sums: vec4f, surface_sum: vec4f, material_sum: vec4f) -> Surface {
    if !(LEAST_WEIGHT <= sums.w) {
        return Surface(vec3f(0.0, 0.0, 0.0), vec3f(0.0, 0.0, 0.0), 0.0, 0.0, false);
    }
    let inverse = 1.0 / sums.w;
    let surface = surface_sum * inverse;
    let normal = unit_or_zero(surface.xyz);
    let z = surface.w * frame.depth_unit;
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
                material = material_sum * inverse;
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

fn front(pixel: vec2i) -> Surface {
    let material = textureLoad(material_sums, pixel, 0);
    return shaded(pixel, textureLoad(color_sums, pixel, 0), textureLoad(surface_sums, pixel, 0), material);
}

// Colour of a pixel over a background, premultiplied. At an edge the surface covers its share of what lies behind (§5).
fn over(surface: Surface, pixel: vec2i, background: vec4f) -> vec4f {
    if !surface.is_there {
        return background;
    }
    let own = vec4f(surface.color, 1.0);
    if frame.has_edges == 0u {
        return own;
    }
    let is_edge = textureLoad(edge_limit, pixel, 0).r > 0.0 || textureLoad(writers, pixel, 0).x <= 0.0;
    if !is_edge {
        return own;
    }
    let material = textureLoad(material_behind, pixel, 0);
    let behind = shaded(pixel, textureLoad(color_behind, pixel, 0), textureLoad(surface_behind, pixel, 0), material);
    let beyond = select(background, vec4f(behind.color, 1.0), behind.is_there);
    let q = min(textureLoad(count_sums, pixel, 0).g, 1.0);
    return own * q + beyond * (1.0 - q);
}

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.shade_size_px.x || id.y >= frame.shade_size_px.y {
        return;
    }
    let pixel = vec2i(id.xy + frame.shade_origin_px);
    let at = id.y * frame.shade_size_px.x + id.x;
    let surface = front(pixel);
    if frame.color_at != ABSENT {
        let color = over(surface, pixel, frame.background);
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

struct Composite {
    @location(0) color: vec4f,
    @builtin(frag_depth) depth: f32,
}

// The picture as a part of a host's: its depth test decides where it shows, and edges blend over what is there.
@fragment
fn composite_fragment(@builtin(position) position: vec4f) -> Composite {
    let pixel = vec2i(floor(position.xy)) + vec2i(frame.shade_origin_px);
    let surface = front(pixel);
    if !surface.is_there {
        discard;
    }
    var along = 1.0 / surface.z;
    if frame.projection.kind == ORTHOGRAPHIC {
        along = surface.z;
    }
    return Composite(over(surface, pixel, vec4f(0.0, 0.0, 0.0, 0.0)), fma(frame.host_depth.y, along, frame.host_depth.x));
}
