// The polygon pass (rendering model §6): finds depth and index of the nearest polygon of every pixel, whether or not
// splats occlude it. Polygons are triangles.

// A triangle as set up for a tile by the CPU in f64.
struct Polygon {
    // Edge forms (see Triangle) over pixel offsets from the centre of the pixel `base`, for the interpolation of
    // attributes.
    edges: array<Linear, 3>,
    // Offset in `texels`, in words, of the texture's header; ABSENT without a texture.
    texture_at: u32,
    // Pixel of the image (column, row) from which offsets are measured.
    base: vec2i,
    // Constants of the edge forms over pixel offsets from the targets' first pixel, to test which pixels are covered.
    // All polygons share this anchor, so that neighbours classify their common edge by the same number.
    covers: vec3f,
    // Planar depths of the vertices, in world units.
    @align(16) z: vec3f,
    // Box of pixels that the polygon may touch, in the format of Record.visible_box.
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

// Number of words of a texture's header in `texels`: width, height, number of smaller levels. The texels of the full
// size follow, four bytes of a word each (R, G, B, unused), then those of the smaller levels, three f32 each. Before
// all textures, `texels` lists the linear values of the 256 byte values, f32.
const TEXTURE_HEADER: u32 = 3u;

// Polygons of the tile, one per instance.
@group(1) @binding(0) var<storage, read> drawn_polygons: array<Polygon>;

// Corner of the quad over a polygon's box, and the polygon's index.
struct PolygonVertex {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) polygon: u32,
}

@vertex
fn polygon_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> PolygonVertex {
    return PolygonVertex(corner_of(drawn_polygons[instance].box, vertex), instance);
}

// Returns the triangle over pixel offsets from the centre of the polygon's pixel `base`.
fn triangle_of(p: Polygon) -> Triangle {
    return Triangle(p.edges, p.z);
}

// Returns the offset, in pixels, from a polygon's pixel `base` to a pixel of the targets.
fn offset_on(p: Polygon, pixel: vec2i) -> vec2f {
    return vec2f(pixel + frame.origin_px - p.base);
}

// The texture `pixel_steps` (samples.wgsl) of the tile of pixels that a frame of samples belongs to, like
// `sampled_pixels` of splat setup.
@group(2) @binding(5) var polygon_sampled_pixels: texture_2d<f32>;

// False for a sample whose pixel isn't antialiased by samples.
fn is_wanted(pixel: vec2i) -> bool {
    let pixels = vec2i(frame.first_pixel) + pixel / i32(SAMPLES_SIDE);
    return frame.is_of_samples == 0u || textureLoad(polygon_sampled_pixels, pixels, 0).x > 0.0;
}

// Nearest polygon of a pixel.
struct PolygonHit {
    @builtin(frag_depth) depth: f32,
    // Depth z, and the polygon's index plus one; zeros mean no polygon.
    @location(0) hit: vec2f,
}

// Finds the nearest polygon of a pixel. A polygon is drawn as a quad over its pixel box, and its fragments evaluate the
// exact edges. A rasteriser would snap the vertices to a fraction of a pixel.
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
