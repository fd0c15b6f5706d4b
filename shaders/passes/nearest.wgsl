// Finds the nearest splat in each pixel (rendering model §5, planes). Fragments that add their attributes to sums are
// drawn once more with a depth buffer, and write the numbers of their draw and record. A draw is all calls that draw
// the records of a segment, or of the splats that reach the near plane and are drawn by the same pipelines. A record is
// a splat as set up for a tile (types.wgsl).

// AttributeVertex with the index of the record and the number of the draw.
struct NearestVertex {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(flat, either) base: vec2i,
    @location(1) @interpolate(flat, either) anchor: vec4f,
    @location(2) @interpolate(flat, either) uv: vec4f,
    @location(3) @interpolate(flat, either) depth: vec4f,
    @location(4) @interpolate(flat, either) at_anchor: vec3f,
    @location(5) @interpolate(flat, either) w: vec4f,
    @location(6) @interpolate(flat, either) color: vec3f,
    @location(7) @interpolate(flat, either) normal: vec3f,
    @location(8) @interpolate(flat, either) flags: u32,
    @location(9) @interpolate(flat, either) record: u32,
    // Number of the draw. The vertices of a draw begin at four times this number, so that the shader can compute it.
    @location(10) @interpolate(flat, either) source: u32,
}

// Returns corner 0 … 3 of a record's quad. `vertex` is the corner plus four times the number of the draw.
fn nearest_corner(vertex: u32, instance: u32) -> NearestVertex {
    let v = attribute_corner(vertex, instance);
    return NearestVertex(
        v.position, v.base, v.anchor, v.uv, v.depth, v.at_anchor, v.w, v.color, v.normal, v.flags,
        instance, vertex / 4u,
    );
}

@vertex
fn nearest_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> NearestVertex {
    return nearest_corner(vertex, instance);
}

@vertex
fn clipped_nearest_vertex(
    @builtin(vertex_index) vertex: u32,
    @builtin(instance_index) instance: u32,
) -> NearestVertex {
    return nearest_corner(vertex, instance);
}

// Nearest splat of a pixel.
struct NearestOutput {
    @builtin(frag_depth) depth: f32,
    // Number of the draw plus one, and number of the record; both are exact as floats.
    @location(0) source: vec2f,
}

// Returns the output of a fragment at depth z.
fn nearest_output(z: f32, source: u32, record: u32) -> NearestOutput {
    return NearestOutput(reversed_depth(z), vec2f(f32(source + 1u), f32(record)));
}

// True if a fragment at depth z isn't hidden by a polygon: it is no deeper than its pixel's nearest polygon, or splats
// occlude that polygon.
fn is_before_polygon(position: vec4f, z: f32) -> bool {
    let pixel = vec2i(floor(position.xy));
    let polygon = textureLoad(polygon_limit, pixel, 0).r;
    let shows = polygon > 0.0 && textureLoad(depth_threshold, pixel, 0) <= reversed_depth(polygon);
    return !shows || z <= polygon;
}

// Nearest splat of the opaque image: number of the draw plus one, and number of the record; zeros without one.
@group(1) @binding(26) var nearest_front: texture_2d<f32>;
// Nearest splat among the transparent layers, in the same format.
@group(1) @binding(27) var nearest_layer: texture_2d<f32>;

// Returns the depth of a pixel's nearest surface or transparent layer, balls ignored; +∞ without any.
fn nearest_depth(pixel: vec2i) -> f32 {
    var z = front_depth(pixel);
    if frame.has_layers != 0u {
        let layer = layer_composites[u32(pixel.y) * frame.size_px.x + u32(pixel.x)].z;
        z = select(z, min(z, layer), layer > 0.0);
    }
    return z;
}

// Value of the draw number plus one that marks a polygon. The record number is then the polygon's.
const NEAREST_POLYGON: f32 = -1.0;

// Value of the draw number plus one that marks a ball. The record number is then the ball's.
const NEAREST_BALL: f32 = -2.0;

// Writes the plane of nearest surfaces: for each pixel the draw number plus one and the record number of the nearest
// splat, polygon or ball; zeros for an empty pixel.
@compute @workgroup_size(8, 8)
fn nearest(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.shade_size_px.x || id.y >= frame.shade_size_px.y {
        return;
    }
    let pixel = vec2i(id.xy + frame.shade_origin_px);
    var found = vec2f(0.0, 0.0);
    if LEAST_WEIGHT <= textureLoad(color_sums, pixel, 0).w {
        found = textureLoad(nearest_front, pixel, 0).xy;
    }
    let hit = polygon_hit(pixel);
    if found.x == 0.0 && polygon_is_visible(pixel, hit) {
        found = vec2f(NEAREST_POLYGON, hit.y - 1.0);
    }
    if frame.has_layers != 0u && layer_composites[u32(pixel.y) * frame.size_px.x + u32(pixel.x)].z > 0.0 {
        found = textureLoad(nearest_layer, pixel, 0).xy;
    }
    let ball = shown_ball(pixel, nearest_depth(pixel));
    if ball.z > 0.0 {
        found = vec2f(NEAREST_BALL, f32(ball.record));
    }
    let to = frame.nearest_at + 2u * (id.y * frame.shade_size_px.x + id.x);
    planes[to] = found.x;
    planes[to + 1u] = found.y;
}
