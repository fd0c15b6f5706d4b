// Edge detection (rendering model §5): a pixel is an edge pixel if the surface of a neighbour lies behind its own by
// more than the depth tolerances of both.

// The z + ε and the ε of the splat that defines each pixel's depth threshold; zeros without one.
@group(1) @binding(1) var edge_pass_tolerance: texture_2d<f32>;

// Draws a triangle that covers the whole target.
@vertex
fn fullscreen_vertex(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4f {
    let corner = vec2f(f32((vertex << 1u) & 2u), f32(vertex & 2u));
    return vec4f(corner * 2.0 - 1.0, 0.0, 1.0);
}

// Depth of each pixel's nearest polygon, and the polygon's index plus one; zeros without one.
@group(1) @binding(2) var edge_pass_polygons: texture_2d<f32>;

// True if the surface of the neighbouring pixel `at` lies beyond `reach`, the depth at which a pixel's own surface
// ends. This tests both the neighbour's splats (a threshold of 0 is infinitely far) and its nearest polygon. A polygon
// behind splats lies beyond their threshold, so it makes no difference.
fn steps_back(reach: f32, at: vec2i) -> bool {
    let neighbour = textureLoad(edge_pass_tolerance, at, 0).xy;
    if neighbour.x > 0.0 && neighbour.x - neighbour.y <= reach {
        return false;
    }
    if frame.has_polygons == 0u {
        return true;
    }
    let polygon = textureLoad(edge_pass_polygons, at, 0).x;
    return polygon <= 0.0 || reach < polygon;
}

// Writes `edge_threshold` for the passes of the edge background: the reversed depth threshold of an edge pixel, 0 for
// others. A pixel without splats has no threshold, edge or not.
@fragment
fn edges_fragment(@builtin(position) position: vec4f) -> @location(0) f32 {
    let pixel = vec2i(floor(position.xy));
    let own = textureLoad(edge_pass_tolerance, pixel, 0).xy;
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
    return select(0.0, reversed_depth(own.x), edge);
}
