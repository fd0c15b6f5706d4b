// The shading pass (rendering model §5), once per pixel: divides the sums by Σw, normalises the normal, reconstructs
// the position, and shades it. Sums are written by the attribute passes (attributes.wgsl).

// Sums w·(colour, 1) of each pixel.
@group(1) @binding(0) var color_sums: texture_2d<f32>;
// Sums w·(normal, z), with z in Frame.depth_unit.
@group(1) @binding(1) var surface_sums: texture_2d<f32>;
// Sums w·(ambient, diffuse and specular factor, shininess).
@group(1) @binding(2) var material_sums: texture_2d<f32>;
// Number of fragments, and coverage.
@group(1) @binding(3) var count_sums: texture_2d<f32>;
// Planes of the tile at the offsets Frame.…_at, each row by row.
@group(1) @binding(4) var<storage, read_write> planes: array<f32>;
// The next five are read only if edges are antialiased. `edge_threshold` of the edge background: the reversed depth
// threshold of edge pixels, 0 elsewhere.
@group(1) @binding(5) var shade_edge_threshold: texture_2d<f32>;
// The z + ε and the ε of the splat that defines each pixel's depth threshold; zeros without one.
@group(1) @binding(6) var threshold_tolerance: texture_2d<f32>;
// Sums of the surface behind edge pixels, like the sums above.
@group(1) @binding(7) var edge_background_color: texture_2d<f32>;
@group(1) @binding(8) var edge_background_surface: texture_2d<f32>;
@group(1) @binding(9) var edge_background_material: texture_2d<f32>;
// Reversed depth threshold of each pixel; 0 without one. Shading reads it only if there are polygons.
@group(1) @binding(10) var shade_threshold: texture_depth_2d;
// Depth of each pixel's nearest polygon, and the polygon's index plus one; zeros without one. Read only if there are
// polygons.
@group(1) @binding(11) var polygon_hits: texture_2d<f32>;

// Smallest Σw, the sum of weights, with which a pixel has a surface. With a smaller sum, attributes have been lost to
// underflow, and the pixel is empty. Only splats smaller than 1e-18 pixels weigh less.
const LEAST_WEIGHT: f32 = 1e-36;

// A surface point to be lit. A pixel has up to three: splats, a polygon, and the surface behind an edge.
struct Point {
    albedo: vec3f,
    // Unit normal in world axes, or 0 if there is none.
    normal: vec3f,
    // Ambient, diffuse and specular factor, shininess.
    material: vec4f,
    z: f32,
    weight: f32,
    is_there: bool,
}

// A visible surface as the application's shader gets it (host_color.wgsl). Colours are linear.
struct HostSurface {
    albedo: vec3f,
    // Unit normal in world axes, or 0 if there is none.
    normal: vec3f,
    // Position relative to the eye, in world axes.
    position: vec3f,
    // Unit direction to the eye, in world axes.
    to_eye: vec3f,
    // Planar depth: distance from the eye along the viewing direction.
    depth: f32,
    // Ambient, diffuse and specular factor, shininess.
    material: vec4f,
    // Colour by Phong's model, with the scene's lights and shadows.
    lit: vec3f,
}

// The nearest surface of a pixel after lighting: linear colour, unit normal in world axes (or 0), depth and Σw.
// `is_there` is false for an empty pixel.
struct Surface {
    color: vec3f,
    normal: vec3f,
    z: f32,
    weight: f32,
    is_there: bool,
}

// Returns v scaled to unit length, or zero if v is shorter than 1e-15.
fn unit_or_zero(v: vec3f) -> vec3f {
    let square = v3_dot(v, v);
    return select(vec3f(0.0, 0.0, 0.0), v * (1.0 / sqrt(max(square, 1e-30))), square > 1e-30);
}

// Returns the slope (x/z, y/z) of the ray through the centre of a pixel of the targets, or its (x, y) in an
// orthographic projection.
fn ray_of(pixel: vec2i) -> vec2f {
    return frame.ray_start + vec2f(pixel + frame.origin_px) * frame.ray_step;
}

// Returns the view position at depth z on the ray through a pixel of the targets.
fn position_at(pixel: vec2i, z: f32) -> vec3f {
    return vec3f(ray_of(pixel) * select(1.0, z, frame.projection.kind == PERSPECTIVE), z);
}

// Returns the linear colour of a point at the view position `at` by the frame's shader. `full` is a compile-time
// constant of the entry points: false omits everything that frames of opaque splats don't need, such as shadows.
fn color_of(at: vec3f, point: Point, full: bool) -> vec3f {
    // Sums of colours may exceed f32's range, and would cause NaN below.
    return limit_rgb(unlimited_color_of(at, point, limit_rgb(point.albedo), full));
}

// Clamps each channel of a colour to f32's range less a margin.
fn limit_rgb(color: vec3f) -> vec3f {
    return vec3f(limit_color(color.r), limit_color(color.g), limit_color(color.b));
}

// Returns the colour like `color_of`, from an albedo within f32's range, before the result is clamped.
fn unlimited_color_of(at: vec3f, point: Point, albedo: vec3f, full: bool) -> vec3f {
    let z = point.z;
    let normal = point.normal;
    let material = point.material;
    switch frame.shader_kind {
        case SHADER_PHONG, SHADER_TOON, SHADER_HOST: {
            let position = frame.world_from_view * at;
            let to_eye = select(frame.to_eye, -unit(position), frame.projection.kind == PERSPECTIVE);
            let color = lit(albedo, normal, position, to_eye, material, full);
            if frame.shader_kind == SHADER_HOST {
                return host_color(HostSurface(albedo, normal, position, to_eye, z, material, color));
            }
            return color;
        }
        case SHADER_MATCAP: {
            let position = frame.world_from_view * at;
            let to_eye = select(frame.to_eye, -unit(position), frame.projection.kind == PERSPECTIVE);
            return albedo * matcap_color(normal, to_eye);
        }
        case SHADER_NORMAL: {
            return select(vec3f(0.0, 0.0, 0.0), normal * 0.5 + 0.5, v3_dot(normal, normal) > 0.0);
        }
        case SHADER_DEPTH: {
            let projection = frame.projection;
            var stored = projection.near / z;
            if projection.kind == ORTHOGRAPHIC {
                stored = 1.0 - (z - projection.near) / (projection.far - projection.near);
            }
            return vec3f(stored, stored, stored);
        }
        default: {
            return albedo;
        }
    }
}

// Returns a point of an empty pixel.
fn no_point() -> Point {
    return Point(vec3f(0.0, 0.0, 0.0), vec3f(0.0, 0.0, 0.0), vec4f(0.0, 0.0, 0.0, 0.0), 0.0, 0.0, false);
}

// Returns the surface point that the sums of a pixel give. The sums are those of colour and weight, of normal and
// depth, and of material factors.
fn point_of(sums: vec4f, surface_sum: vec4f, material_sum: vec4f) -> Point {
    if !(LEAST_WEIGHT <= sums.w) {
        return no_point();
    }
    let inverse = 1.0 / sums.w;
    let surface = surface_sum * inverse;
    var albedo = vec3f(1.0, 1.0, 1.0);
    if frame.has_colors != 0u {
        albedo = sums.rgb * inverse;
    }
    var material = frame.material;
    if frame.has_materials != 0u {
        material = material_sum * inverse;
    }
    return Point(albedo, unit_or_zero(surface.xyz), material, surface.w * frame.depth_unit, sums.w, true);
}

// Returns the depth of a pixel's nearest polygon, and the polygon's index plus one; zeros without a polygon.
fn polygon_hit(pixel: vec2i) -> vec2f {
    if frame.has_polygons == 0u {
        return vec2f(0.0, 0.0);
    }
    return textureLoad(polygon_hits, pixel, 0).xy;
}

// True if no splat occludes the pixel's polygon.
fn polygon_is_visible(pixel: vec2i, hit: vec2f) -> bool {
    return hit.x > 0.0 && textureLoad(shade_threshold, pixel, 0) <= reversed_depth(hit.x);
}

// Returns the fraction, 0 to 1, of a pixel with a visible polygon that splats in front of the polygon cover.
fn splat_coverage(pixel: vec2i) -> f32 {
    return min(textureLoad(count_sums, pixel, 0).g / frame.full_coverage, 1.0);
}

// Returns the depth Z of a pixel's nearest opaque surface, blended where splats lie over a polygon; +∞ without a
// surface.
fn front_depth(pixel: vec2i) -> f32 {
    let weight = textureLoad(color_sums, pixel, 0).w;
    let is_there = LEAST_WEIGHT <= weight;
    let z = select(frame.empty_depth, textureLoad(surface_sums, pixel, 0).w / weight * frame.depth_unit, is_there);
    let hit = polygon_hit(pixel);
    if !polygon_is_visible(pixel, hit) {
        return z;
    }
    let share = splat_coverage(pixel);
    return select(hit.x, z * share + hit.x * (1.0 - share), is_there);
}

// Returns the depth beyond which a neighbour belongs to another surface than the pixel (rendering model §5, toon).
fn outline_limit(pixel: vec2i, surface: Surface, projection: Projection) -> f32 {
    let at = position_at(pixel, surface.z);
    var gradient = vec2f(0.0, 0.0);
    if v3_dot(surface.normal, surface.normal) > 0.0 {
        gradient = plane_gradient(at, frame.view_from_world * surface.normal, projection);
    }
    return toon_step_back_limit(surface.z, gradient, projection);
}

// True if `toon` draws an outline at a pixel: the surface of one of its neighbours inside the image lies beyond the
// limit.
fn has_outline(pixel: vec2i, surface: Surface) -> bool {
    let limit = outline_limit(pixel, surface, frame.projection);
    let last = vec2i(frame.size_px) - 1;
    var line = false;
    for (var y = max(pixel.y - 1, 0); y <= min(pixel.y + 1, last.y); y++) {
        for (var x = max(pixel.x - 1, 0); x <= min(pixel.x + 1, last.x); x++) {
            line = line || front_depth(vec2i(x, y)) > limit;
        }
    }
    return line;
}

// A pixel of the image without transparent splats and balls.
struct Pixel {
    // The nearest surface.
    front: Surface,
    // Premultiplied colour.
    color: vec4f,
    // Depth of the nearest surface or, at an edge, the smaller depth of that surface and the one behind it; +∞ without
    // any.
    end: f32,
    // Fraction of the pixel that the nearest surface covers, 1 if the pixel is no edge.
    share: f32,
    // At an edge, premultiplied colour of what lies behind the nearest surface; else the pixel's colour.
    behind: vec4f,
    // At an edge, depth of the surface behind the nearest one, +∞ without one; else the nearest surface's.
    back: f32,
}

// Shades a pixel of the image without transparent splats and balls. `background` is linear and premultiplied. The
// nearest surface is splats, a polygon, or splats blended over a polygon (rendering model §6).
//
// At an edge the nearest surface covers only a part of the pixel (rendering model §5). Behind it is the nearer of the
// edge background's splats and the nearest polygon, over the background.
fn shaded_pixel(pixel: vec2i, background: vec4f, full: bool) -> Pixel {
    let splats = point_of(
        textureLoad(color_sums, pixel, 0),
        textureLoad(surface_sums, pixel, 0),
        textureLoad(material_sums, pixel, 0),
    );
    var hit = vec2f(0.0, 0.0);
    var shown = false;
    if full {
        hit = polygon_hit(pixel);
        shown = polygon_is_visible(pixel, hit);
    }
    var polygon = no_point();
    if full && hit.x > 0.0 {
        polygon = polygon_point(hit, pixel);
    }
    var backdrop = no_point();
    var is_edge = false;
    if full && frame.has_edges != 0u && !shown {
        let has_threshold = textureLoad(threshold_tolerance, pixel, 0).x > 0.0;
        // A pixel with a depth threshold but no filtered fragment is an edge, too: its splats cover nothing.
        is_edge = (splats.is_there && !has_threshold) || textureLoad(shade_edge_threshold, pixel, 0).r > 0.0;
        if is_edge {
            backdrop = point_of(
                textureLoad(edge_background_color, pixel, 0),
                textureLoad(edge_background_surface, pixel, 0),
                textureLoad(edge_background_material, pixel, 0),
            );
            if has_threshold && polygon.is_there && (!backdrop.is_there || polygon.z < backdrop.z) {
                backdrop = polygon;
            }
        }
    }
    // The loop prevents compilers from inlining three copies of the shading code.
    var colors = array<vec3f, 3>();
    let count = select(1u, 3u, full);
    for (var i = 0u; i < count; i++) {
        var point = splats;
        if i == 1u {
            point = polygon;
            point.is_there = shown;
        } else if i == 2u {
            point = backdrop;
        }
        if point.is_there {
            colors[i] = color_of(position_at(pixel, point.z), point, full);
        }
    }
    var front = Surface(colors[0], splats.normal, splats.z, splats.weight, splats.is_there);
    if shown && splats.is_there {
        let share = splat_coverage(pixel);
        front.color = colors[0] * share + colors[1] * (1.0 - share);
        front.normal = unit_or_zero(splats.normal * share + polygon.normal * (1.0 - share));
        front.z = splats.z * share + polygon.z * (1.0 - share);
    } else if shown {
        front = Surface(colors[1], polygon.normal, polygon.z, 0.0, true);
    }
    if full && frame.has_outlines != 0u && front.is_there && has_outline(pixel, front) {
        front.color = vec3f(0.0, 0.0, 0.0);
    }
    if full && frame.has_eye_dome != 0u {
        if front.is_there {
            front.color *= eye_dome_shading(pixel, front.z);
        }
        if backdrop.is_there {
            colors[2] *= eye_dome_shading(pixel, backdrop.z);
        }
    }
    let color = select(background, vec4f(front.color, 1.0), front.is_there);
    let end = select(frame.empty_depth, front.z, front.is_there);
    if is_edge {
        let q = min(textureLoad(count_sums, pixel, 0).g, 1.0);
        let behind = select(background, vec4f(colors[2], 1.0), backdrop.is_there);
        let back = select(frame.empty_depth, backdrop.z, backdrop.is_there);
        return Pixel(front, color * q + behind * (1.0 - q), min(end, back), q, behind, back);
    }
    return Pixel(front, color, end, 1.0, color, end);
}

// Composites transparent layers over a premultiplied colour.
fn composite_over(layers: LayerComposite, color: vec4f) -> vec4f {
    return vec4f(layers.color, layers.opacity) + color * (1.0 - layers.opacity);
}

// Writes a colour to the colour plane. `at` is the pixel's number in the shaded region, row by row.
fn write_color(at: u32, color: vec4f) {
    let to = frame.color_at + 4u * at;
    planes[to] = color.r;
    planes[to + 1u] = color.g;
    planes[to + 2u] = color.b;
    planes[to + 3u] = color.a;
}

// Entry point for frames with more than opaque splats: polygons, edges, outlines, layers, shadows or `toon`.
@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) id: vec3u) {
    shade_pixel(id, true);
}

// Entry point for frames that have only opaque splats: all other branches are compiled away.
@compute @workgroup_size(8, 8)
fn shade_splats(@builtin(global_invocation_id) id: vec3u) {
    shade_pixel(id, false);
}

// Shades the pixel of an invocation and writes its planes.
fn shade_pixel(id: vec3u, full: bool) {
    if id.x >= frame.shade_size_px.x || id.y >= frame.shade_size_px.y {
        return;
    }
    let pixel = vec2i(id.xy + frame.shade_origin_px);
    let at = id.y * frame.shade_size_px.x + id.x;
    let opaque = shaded_pixel(pixel, frame.background, full);
    var surface = opaque.front;
    var layers: LayerComposite;
    if full && frame.has_layers != 0u {
        layers = layer_composites[u32(pixel.y) * frame.size_px.x + u32(pixel.x)];
        if layers.z > 0.0 {
            surface = Surface(layers.color, layers.normal, layers.z, layers.weight, true);
        }
    }
    if frame.color_at != ABSENT {
        write_color(at, composite_over(layers, opaque.color));
    }
    write_planes(at, surface);
    if frame.fragments_at != ABSENT {
        planes[frame.fragments_at + at] = textureLoad(count_sums, pixel, 0).r + f32(fragments_of(layers));
    }
}

// Writes the planes Z, normal and weight of a pixel's nearest surface. `at` is the pixel's number in the shaded region,
// row by row.
fn write_planes(at: u32, surface: Surface) {
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
}

// Composited transparent layers of each pixel of the targets, row by row: the buffer `layer_composites`, for passes
// that only read it.
@group(1) @binding(15) var<storage, read> host_layer_composites: array<LayerComposite>;

// Premultiplied colour and depth that are written into the application's render target.
struct Composite {
    @location(0) color: vec4f,
    @builtin(frag_depth) depth: f32,
}

// Composites the image into the render target of the embedding application. The application's depth test decides which
// pixels show, and edges blend over the target's contents.
@fragment
fn composite_fragment(@builtin(position) position: vec4f) -> Composite {
    let pixel = vec2i(floor(position.xy)) + vec2i(frame.shade_origin_px);
    let opaque = shaded_pixel(pixel, vec4f(0.0, 0.0, 0.0, 0.0), true);
    var layers: LayerComposite;
    if frame.has_layers != 0u {
        layers = host_layers_at(pixel);
    }
    // Layers and the opaque surface behind them are drawn at once, so the depth is that of the opaque surface, if there
    // is one.
    let z = select(layers.z, opaque.front.z, opaque.front.is_there);
    if z <= 0.0 {
        discard;
    }
    return Composite(composite_over(layers, opaque.color), host_depth_of(z));
}

// Returns the composited transparent layers of a pixel of the targets.
fn host_layers_at(pixel: vec2i) -> LayerComposite {
    return host_layer_composites[u32(pixel.y) * frame.size_px.x + u32(pixel.x)];
}

// Returns the value of the application's depth buffer for depth z.
fn host_depth_of(z: f32) -> f32 {
    let along = select(1.0 / z, z, frame.projection.kind == ORTHOGRAPHIC);
    return fma(frame.host_depth.y, along, frame.host_depth.x);
}

// Composites the opaque surface into the application's render target: the first of two passes that composition takes if
// the application's depth buffer can be read.
@fragment
fn composite_opaque_fragment(@builtin(position) position: vec4f) -> Composite {
    let pixel = vec2i(floor(position.xy)) + vec2i(frame.shade_origin_px);
    let opaque = shaded_pixel(pixel, vec4f(0.0, 0.0, 0.0, 0.0), true);
    if !opaque.front.is_there {
        discard;
    }
    return Composite(opaque.color, host_depth_of(opaque.front.z));
}

// Composites the transparent layers into the application's render target: the second of two passes, see
// `composite_opaque_fragment`. Peeling has already cut the layers off at the application's depth.
@fragment
fn composite_layers_fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let layers = host_layers_at(vec2i(floor(position.xy)) + vec2i(frame.shade_origin_px));
    if layers.z <= 0.0 {
        discard;
    }
    return vec4f(layers.color, layers.opacity);
}

// The planes of the shaded region (`planes`), as written by shading, by the samples of edges or by a pass of Gaussians.
@group(1) @binding(62) var<storage, read> host_planes: array<f32>;

// Returns the number of a pixel of the shaded region, row by row.
fn host_plane_at(pixel: vec2i) -> u32 {
    return u32(pixel.y) * frame.shade_size_px.x + u32(pixel.x);
}

// Returns the colour plane at a pixel of the shaded region.
fn host_plane_color(pixel: vec2i) -> vec4f {
    let at = frame.color_at + 4u * host_plane_at(pixel);
    return vec4f(host_planes[at], host_planes[at + 1u], host_planes[at + 2u], host_planes[at + 3u]);
}

// Returns the depth with which a pixel of the shaded region passes the application's depth test. It is the pixel's own
// or, where only samples beside the pixel's centre show a surface, the nearest of its neighbours. +∞ without either.
fn host_plane_depth(pixel: vec2i) -> f32 {
    let own = host_planes[frame.depth_at + host_plane_at(pixel)];
    if own < frame.empty_depth {
        return own;
    }
    let last = vec2i(frame.shade_size_px) - 1;
    var nearest = frame.empty_depth;
    for (var y = max(pixel.y - 1, 0); y <= min(pixel.y + 1, last.y); y++) {
        for (var x = max(pixel.x - 1, 0); x <= min(pixel.x + 1, last.x); x++) {
            nearest = min(nearest, host_planes[frame.depth_at + host_plane_at(vec2i(x, y))]);
        }
    }
    return nearest;
}

// Composites the planes into the application's render target. This is for frames whose final colours exist only in the
// planes, not in the targets.
@fragment
fn composite_planes_fragment(@builtin(position) position: vec4f) -> Composite {
    let pixel = vec2i(floor(position.xy));
    let color = host_plane_color(pixel);
    let z = host_plane_depth(pixel);
    if color.a <= 0.0 || !(z < frame.empty_depth) {
        discard;
    }
    return Composite(color, host_depth_of(z));
}

// Composites the planes into the application's render target without a depth test, for frames whose fragments have
// already been cut off at the application's depth.
@fragment
fn composite_planes_over_fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let color = host_plane_color(vec2i(floor(position.xy)));
    if color.a <= 0.0 {
        discard;
    }
    return color;
}

// Output for a render target of indices.
struct CompositeIndex {
    // Number of the draw, and number of the record. The draw of a polygon is −2, that of a ball −3.
    @location(0) found: vec2i,
    @builtin(frag_depth) depth: f32,
}

// Writes the nearest splat, polygon or ball of each pixel that passes the application's depth test.
@fragment
fn composite_index_fragment(@builtin(position) position: vec4f) -> CompositeIndex {
    let at = host_plane_at(vec2i(floor(position.xy)));
    let nearest = frame.nearest_at + 2u * at;
    let z = host_planes[frame.depth_at + at];
    if host_planes[nearest] == 0.0 || !(z < frame.empty_depth) {
        discard;
    }
    return CompositeIndex(vec2i(i32(host_planes[nearest]) - 1, i32(host_planes[nearest + 1u])), host_depth_of(z));
}
