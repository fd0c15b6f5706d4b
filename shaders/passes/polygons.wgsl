// The polygon pass (rendering model §6): depth and index of the nearest polygon of every pixel, whether or not splats
// occlude it.

// A triangle, set up by the CPU in f64.
struct Polygon {
    // Edges relative to the centre of the pixel `base`, for the interpolation of attributes.
    edges: array<Linear, 3>,
    // Offset of the texture in `texels`, in words, or ABSENT.
    texture_at: u32,
    base: vec2i,
    // Constants of the edges relative to the targets' first pixel. All polygons share this anchor, so that neighbours
    // classify their common edge by the same number.
    covers: vec3f,
    // Depths of the vertices.
    @align(16) z: vec3f,
    // Box of pixels that the polygon may touch, in the format of a record's boxes.
    box: vec2u,
    // Texture coordinates of the vertices.
    u: vec3f,
    v: vec3f,
    // Linear albedo of the vertices.
    color0: vec3f,
    color1: vec3f,
    color2: vec3f,
    // Unit world normals of the vertices, and of the plane; turned to the eye if the material is two-sided.
    normal0: vec3f,
    normal1: vec3f,
    normal2: vec3f,
    flat_normal: vec3f,
    // Ambient, diffuse and specular factor, shininess.
    material: vec4f,
}

// Header of a texture: width, height, number of smaller levels. The full size follows with four bytes a texel, then the
// levels with three floats a texel. The linear values of the 256 bytes precede all textures.
const TEXTURE_HEADER: u32 = 3u;

@group(1) @binding(0) var<storage, read> drawn_polygons: array<Polygon>;

struct PolygonVertex {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) polygon: u32,
}

@vertex
fn polygon_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> PolygonVertex {
    return PolygonVertex(corner_of(drawn_polygons[instance].box, vertex), instance);
}

fn triangle_of(p: Polygon) -> Triangle {
    return Triangle(p.edges, p.z);
}

// Returns the offset from the polygon's base to a pixel of the targets.
fn offset_on(p: Polygon, pixel: vec2i) -> vec2f {
    return vec2f(pixel + frame.origin_px - p.base);
}

// The same binding as `sampled_pixels` of splat setup.
@group(2) @binding(5) var polygon_sampled_pixels: texture_2d<f32>;

// False for a sample whose pixel isn't antialiased by samples.
fn is_wanted(pixel: vec2i) -> bool {
    let pixels = vec2i(frame.first_pixel) + pixel / i32(SAMPLES_SIDE);
    return frame.is_of_samples == 0u || textureLoad(polygon_sampled_pixels, pixels, 0).x > 0.0;
}

struct PolygonHit {
    @builtin(frag_depth) depth: f32,
    // Depth, and the polygon's index plus one.
    @location(0) hit: vec2f,
}

// A polygon is drawn as a quad over its pixel box, and its fragments evaluate the exact edges. A rasteriser would snap
// the vertices to a fraction of a pixel.
@fragment
fn polygon_fragment(in: PolygonVertex) -> PolygonHit {
    let pixel = vec2i(floor(in.position.xy));
    if !is_wanted(pixel) {
        discard;
    }
    let p = drawn_polygons[in.polygon];
    var shape = triangle_of(p);
    let d = offset_on(p, pixel);
    let z = triangle_depth(shape, triangle_barycentric(shape, d));
    shape.edges[0].c = p.covers.x;
    shape.edges[1].c = p.covers.y;
    shape.edges[2].c = p.covers.z;
    if !(triangle_contains(shape, vec2f(pixel)) && exists(z)) {
        discard;
    }
    return PolygonHit(reversed_depth(z), vec2f(z, f32(in.polygon + 1u)));
}
