// Edge antialiasing by coverage in the compute path (rendering model §5). A workgroup finds the edge pixels of its
// cell. If there are any, it draws what lies behind their nearest surface: the cell's pairs are visited once more, in
// their order, and only fragments deeper than that surface count. Then the colours are blended by coverage.

// Number of pixels of the workgroup's cell for which a condition holds, and a copy of this number for uniform control
// flow.
var<workgroup> counted_pixels: atomic<u32>;
var<workgroup> pixels_of_cell: u32;

// True if the surface of a neighbour of a pixel lies farther than the depth at which the pixel's nearest surface ends.
// `own` is the pixel's z + ε and ε, see `edge_threshold_of`.
fn is_cell_edge(pixel: vec2u, own: vec2f) -> bool {
    let reach = own.x + own.y;
    let last = vec2i(frame.size_px) - 1;
    let center = vec2i(pixel);
    var edge = false;
    for (var y = max(center.y - 1, 0); y <= min(center.y + 1, last.y); y++) {
        for (var x = max(center.x - 1, 0); x <= min(center.x + 1, last.x); x++) {
            let neighbour = edge_threshold_of(vec2u(vec2i(x, y)));
            let is_other = x != center.x || y != center.y;
            edge = edge || (is_other && !(neighbour.x > 0.0 && neighbour.x - neighbour.y <= reach));
        }
    }
    return edge;
}

// A pixel of the targets in the edge pass.
struct EdgePixel {
    // True if the pixel is an edge pixel: what lies behind its nearest surface is visible in part.
    is_edge: bool,
    // Reversed depth threshold of the nearest surface; 0 if the pixel is no edge pixel, or if it has no threshold and
    // only the background lies behind.
    nearest: f32,
}

// Returns the EdgePixel of a pixel of the targets. Pixels outside of the shaded region are no edge pixels.
fn edge_at(own: vec2u) -> EdgePixel {
    let shaded = own - frame.shade_origin_px;
    if any(own < frame.shade_origin_px) || any(shaded >= frame.shade_size_px) {
        return EdgePixel(false, 0.0);
    }
    let threshold = edge_threshold_of(own);
    if threshold.x <= 0.0 {
        return EdgePixel(has_cell_surface(own), 0.0);
    }
    let is_edge = is_cell_edge(own, threshold);
    return EdgePixel(is_edge, select(0.0, reversed_depth(threshold.x), is_edge));
}

// True if a condition holds for any pixel of the workgroup's cell; `holds` is that of invocation i. All invocations of
// the workgroup have to call it.
fn holds_in_cell(i: u32, holds: bool) -> bool {
    if i == 0u {
        atomicStore(&counted_pixels, 0u);
    }
    workgroupBarrier();
    if holds {
        atomicAdd(&counted_pixels, 1u);
    }
    workgroupBarrier();
    if i == 0u {
        pixels_of_cell = atomicLoad(&counted_pixels);
    }
    return workgroupUniformLoad(&pixels_of_cell) > 0u;
}

// Blends the colour of the edge pixel `own` over what lies behind it: the surface of the given sums, or the background.
// With `full` that surface is shaded with all effects (see `shade`).
fn blend_edge(own: vec2u, sums: CellSums, full: bool) {
    let point = point_of(sums.color, sums.surface, sums.material);
    var behind = frame.background;
    if point.is_there {
        var color = color_of(position_at(vec2i(own), point.z), point, full);
        if frame.has_eye_dome != 0u {
            color *= cell_eye_dome_shading(vec2i(own), point.z, frame.projection);
        }
        behind = vec4f(color, 1.0);
    }
    let q = min(planes[edge_word(EDGE_COVERAGE, own)], 1.0);
    let shaded = own - frame.shade_origin_px;
    let at = shaded.y * frame.shade_size_px.x + shaded.x;
    let to = frame.color_at + 4u * at;
    let front = vec4f(planes[to], planes[to + 1u], planes[to + 2u], planes[to + 3u]);
    write_color(at, front * q + behind * (1.0 - q));
}

// Draws what lies behind the edge pixels of a cell (column, row), and blends their colours over it, unless the cell is
// dense.
fn draw_edges(cell: vec2u, i: u32, drawn: u32) {
    let range = pairs_of(cell);
    if is_dense(range) {
        return;
    }
    let corner = cell * CELL_SIDE;
    let own = corner + pixel_in_cell(i);
    let edge = edge_at(own);
    if !holds_in_cell(i, edge.is_edge) {
        return;
    }
    clear_cell(i);
    atomicStore(&sides[i], bitcast<u32>(edge.nearest));
    let limit = limit_of(find_maxima(range, corner, i, drawn));
    store_limit(i, limit, drawn);
    let sums = sum_pixel(range, corner, i, limit, drawn);
    if edge.is_edge {
        blend_edge(own, sums, has(drawn, DRAW_FULL));
    }
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_edges(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_edges(cell.xy, i, DRAW_SURFACE | DRAW_BEHIND);
}

// Draws the edge pixels of an image with shadows or the shader `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_shadowed_edges(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_edges(cell.xy, i, DRAW_SURFACE | DRAW_FULL | DRAW_BEHIND);
}

// Draws the edge pixels of an image with clipped splats, with or without shadows and `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_clipped_edges(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_edges(cell.xy, i, DRAW_SURFACE | DRAW_FULL | DRAW_BEHIND | DRAW_CLIPPED);
}

// Finds the depth thresholds of parts of dense cells, among the fragments behind the nearest surface of edge pixels.
// `cell_part_edges` then sums these fragments. The two entry points after it do the same in frames with clipped splats.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_edge_thresholds(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    find_part_thresholds(workgroup_number(group), i, DRAW_SURFACE | DRAW_BEHIND);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_edges(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    sum_part(workgroup_number(group), i, DRAW_SURFACE | DRAW_BEHIND);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_clipped_edge_thresholds(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    find_part_thresholds(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL | DRAW_BEHIND | DRAW_CLIPPED);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_clipped_edges(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    sum_part(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL | DRAW_BEHIND | DRAW_CLIPPED);
}

// Blends the edge pixels of a dense cell (column, row) over what lies behind them, from the sums of the cell's parts.
fn combine_edges(cell: vec2u, i: u32, full: bool) {
    let range = pairs_of(cell);
    let own = cell * CELL_SIDE + pixel_in_cell(i);
    if is_dense(range) && edge_at(own).is_edge {
        blend_edge(own, sums_of_parts(range, i, DRAW_SURFACE | select(0u, DRAW_FULL, full) | DRAW_BEHIND), full);
    }
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine_edges(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    combine_edges(cell.xy, i, false);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine_shadowed_edges(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    combine_edges(cell.xy, i, true);
}
