// Edge antialiasing by coverage in the compute path (rendering model §5). A workgroup finds the edge pixels of its cell.
// If there are any, it draws what lies behind their nearest surface: the cell's pairs are visited once more, in their
// order, and only fragments deeper than that surface count. Then the colours are blended by coverage.

// Number of edge pixels of a cell, and the same number for uniform control flow.
var<workgroup> counted_edges: atomic<u32>;
var<workgroup> edges_of_cell: u32;

// True if a neighbour steps back behind the end of a pixel's nearest surface.
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

// Draws the edges of a cell.
fn draw_edges(cell: vec2u, i: u32, full: bool) {
    let corner = cell * CELL_SIDE;
    let own = corner + pixel_in_cell(i);
    let shaded = own - frame.shade_origin_px;
    let is_shaded = all(frame.shade_origin_px <= own) && all(shaded < frame.shade_size_px);
    // Reversed depth of the nearest surface of an edge pixel; 0 if nothing lies behind it.
    var nearest = 0.0;
    var is_edge = false;
    if is_shaded {
        let threshold = edge_threshold_of(own);
        if threshold.x > 0.0 {
            is_edge = is_cell_edge(own, threshold);
            nearest = select(0.0, reversed_depth(threshold.x), is_edge);
        } else {
            is_edge = has_cell_surface(own);
        }
    }
    if i == 0u {
        atomicStore(&counted_edges, 0u);
    }
    workgroupBarrier();
    if is_edge {
        atomicAdd(&counted_edges, 1u);
    }
    workgroupBarrier();
    if i == 0u {
        edges_of_cell = atomicLoad(&counted_edges);
    }
    if workgroupUniformLoad(&edges_of_cell) == 0u {
        return;
    }
    let range = pairs_of(cell);
    clear_cell(i);
    atomicStore(&sides[i], bitcast<u32>(nearest));
    let drawn = CellPass(true, full, false, false, true);
    let limit = find_limit(range, corner, i, drawn);
    let sums = sum_pixel(range, corner, i, limit, drawn);
    if !is_edge {
        return;
    }
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
    let at = shaded.y * frame.shade_size_px.x + shaded.x;
    let to = frame.color_at + 4u * at;
    let front = vec4f(planes[to], planes[to + 1u], planes[to + 2u], planes[to + 3u]);
    write_color(at, front * q + behind * (1.0 - q));
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_edges(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_edges(cell.xy, i, false);
}

// Draws the edges of an image with shadows or the shader `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_shadowed_edges(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_edges(cell.xy, i, true);
}
