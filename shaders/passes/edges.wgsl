// Edge pixels (rendering model §5): those with a neighbour that steps back by more than both tolerances.

@group(1) @binding(0) var edge_kept: texture_depth_2d;
@group(1) @binding(1) var edge_writers: texture_2d<f32>;

// Three corners that hold the whole target.
@vertex
fn everywhere_vertex(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4f(corner * 2.0 - 1.0, 0.0, 1.0);
}

// True if a neighbour's surface lies beyond a pixel's own. Nothing kept there (0) is infinitely far.
fn steps_back(own: vec2f, neighbour: vec2f) -> bool {
    return neighbour.x <= 0.0 || own.x + own.y < neighbour.x - neighbour.y;
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
            edge = edge || (is_other && steps_back(own, textureLoad(edge_writers, vec2i(x, y), 0).xy));
        }
    }
    return select(0.0, textureLoad(edge_kept, pixel, 0), edge);
}
