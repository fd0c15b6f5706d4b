// Edge pixels (rendering model §5): those with a neighbour that steps back by more than both tolerances.

@group(1) @binding(0) var edge_kept: texture_depth_2d;
@group(1) @binding(1) var edge_writers: texture_2d<f32>;

// Three corners that hold the whole target.
@vertex
fn everywhere_vertex(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4f(corner * 2.0 - 1.0, 0.0, 1.0);
}

@group(1) @binding(2) var edge_polygons: texture_2d<f32>;

// True if a neighbour's surface lies beyond the reach of a pixel's own: splats (nothing kept there, 0, is infinitely far) and
// the nearest polygon, if any. One that splats hide lies beyond what they keep, and decides nothing.
fn steps_back(reach: f32, at: vec2i) -> bool {
    let neighbour = textureLoad(edge_writers, at, 0).xy;
    if neighbour.x > 0.0 && neighbour.x - neighbour.y <= reach {
        return false;
    }
    if frame.has_polygons == 0u {
        return true;
    }
    let polygon = textureLoad(edge_polygons, at, 0).x;
    return polygon <= 0.0 || reach < polygon;
}

// `limit` for the passes behind. Where nothing is kept nothing lies behind, edge or not.
@fragment
fn edges_fragment(@builtin(position) position: vec4f) -> @location(0) f32 {
    let pixel = vec2i(floor(position.xy));
    let own = textureLoad(edge_writers, pixel, 0).xy;
    if own.x <= 0.0 {
        return 0.0;
    }
    let last = vec2i(frame.size_px) - 1;
    var edge = false;
    for (var y = max(pixel.y - 1, 0); y <= min(pixel.y + 1, last.y); y++) {
        for (var x = max(pixel.x - 1, 0); x <= min(pixel.x + 1, last.x); x++) {
            let is_other = x != pixel.x || y != pixel.y;
            edge = edge || (is_other && steps_back(own.x + own.y, vec2i(x, y)));
        }
    }
    return select(0.0, textureLoad(edge_kept, pixel, 0), edge);
}
