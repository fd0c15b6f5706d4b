// Edge antialiasing by samples in the compute path (rendering model §5). Samples are the pixels of a view four times as
// fine. A cell of that view is the samples of 4×4 pixels, and is active if one of these pixels is sampled. The passes
// of cells.wgsl set up and sort the splats of active cells alone. A workgroup then draws the samples of a cell, and
// writes their means to the colours of the sampled pixels.

// Number of image pixels along the side of a cell of samples.
const SAMPLED_SIDE: u32 = 4u;
// Number of cells along the side of a workgroup of `cell_steps`.
const STEP_CELLS: u32 = 2u;

// 1 for each active cell of the grid, else 0, row by row; then a 0. A scan and `cell_sum_active` make `cell_active` of
// it.
@group(1) @binding(57) var<storage, read_write> cell_active_out: array<u32>;

// Number of sampled pixels of each of the 2×2 cells of a workgroup of `cell_steps`, row by row.
var<workgroup> sampled_in_cell: array<atomic<u32>, 4>;

// Returns the depth interval that contains the nearest surface of a pixel of the targets of pixels.
fn cell_reach(pixel: vec2u) -> Reach {
    let threshold = edge_threshold_of(pixel);
    var reach = reach_of(threshold);
    // If only one of the filtered and the unfiltered footprints has a fragment here, the surface ends: every neighbour
    // is then a step.
    if has_cell_surface(pixel) != (threshold.x > 0.0) {
        reach.end = -frame.empty_depth;
    }
    return reach;
}

// Returns the depth intervals and the number of layers of a pixel of the targets of pixels.
fn cell_pixel_reach(pixel: vec2u) -> PixelReach {
    var reach = PixelReach(cell_reach(pixel), reach_of(vec2f(0.0, 0.0)), 0u);
    if frame.layers_at != ABSENT {
        let threshold = planes[edge_word(EDGE_LAYER_THRESHOLD, pixel)];
        reach.nearest_layer = reach_of(vec2f(threshold, planes[edge_word(EDGE_LAYER_EPSILON, pixel)]));
        reach.layers = u32(planes[layer_word(LAYERS_THERE, pixel)]);
    }
    return reach;
}

// Finds sampled pixels, and the cells that contain one. Each invocation compares a pixel with the four neighbours that
// share a side with it.
@compute @workgroup_size(8, 8)
fn cell_steps(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_id) local: vec3u,
    @builtin(local_invocation_index) i: u32,
) {
    if i < STEP_CELLS * STEP_CELLS {
        atomicStore(&sampled_in_cell[i], 0u);
    }
    workgroupBarrier();
    let pixel = vec2i(id.xy + frame.first_pixel);
    if all(id.xy < frame.size_px / SAMPLES_SIDE) {
        let last = vec2i(frame.pixels_size_px) - 1;
        let own = cell_pixel_reach(vec2u(pixel));
        var is_sampled = false;
        for (var k = 0u; k < 4u; k++) {
            let along = select(-1, 1, (k & 1u) != 0u);
            let at = pixel + select(vec2i(along, 0), vec2i(0, along), (k & 2u) != 0u);
            if all(vec2i(0, 0) <= at) && all(at <= last) {
                is_sampled = is_sampled || is_step(own, cell_pixel_reach(vec2u(at)));
            }
        }
        planes[edge_word(EDGE_SAMPLED, vec2u(pixel))] = select(0.0, 1.0, is_sampled);
        if is_sampled {
            let in_group = local.xy / SAMPLED_SIDE;
            atomicAdd(&sampled_in_cell[in_group.y * STEP_CELLS + in_group.x], 1u);
        }
    }
    workgroupBarrier();
    if i < STEP_CELLS * STEP_CELLS {
        let cell = group.xy * STEP_CELLS + vec2u(i % STEP_CELLS, i / STEP_CELLS);
        let rows = frame.cell_count / frame.cell_columns;
        if cell.x < frame.cell_columns && cell.y < rows {
            let is_active = atomicLoad(&sampled_in_cell[i]) > 0u;
            cell_active_out[cell.y * frame.cell_columns + cell.x] = select(0u, 1u, is_active);
        }
    }
    if all(id.xy == vec2u(0u, 0u)) {
        // Last element of the scan.
        cell_active_out[frame.cell_count] = 0u;
    }
}

// Writes the summed-area table of active cells, one column per invocation, after the scan.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_sum_active(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let column = workgroup_number(group) * CELL_WORKGROUP + i;
    if column > frame.cell_columns {
        return;
    }
    let rows = frame.cell_count / frame.cell_columns;
    var sum = 0u;
    cell_active_out[active_area_at(0u, column)] = 0u;
    for (var row = 0u; row < rows; row++) {
        let first = row * frame.cell_columns;
        sum += cell_active_out[first + column] - cell_active_out[first];
        cell_active_out[active_area_at(row + 1u, column)] = sum;
    }
}

// Writes the list of active cells into the header of the lists (see `cell_lists`).
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_list_active(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let index = workgroup_number(group) * CELL_WORKGROUP + i;
    if index >= frame.cell_count {
        return;
    }
    let number = cell_active[index];
    if number < cell_active[index + 1u] && number < frame.cell_active_room {
        let cell = vec2u(index % frame.cell_columns, index / frame.cell_columns);
        cell_lists_out[2u * frame.cell_active_room + number] = cell_number(cell) + 1u;
    }
}

// Returns the colour of the sample `at`, which belongs to `pixel`, with the effects of neighbours like
// `among_neighbours`, from the depths in `planes`.
fn cell_among_neighbours(at: vec2i, point: Point, color: vec3f, pixel: vec2i) -> vec3f {
    let is_toon = frame.shader_kind == SHADER_TOON;
    if !is_toon && frame.shader_kind != SHADER_EDL {
        return color;
    }
    // Distances between neighbours are measured in pixels of the image, not in samples.
    var projection = frame.projection;
    projection.focal_px *= 1.0 / f32(SAMPLES_SIDE);
    if is_toon {
        let surface = Surface(color, point.normal, point.z, point.weight, true);
        let limit = outline_limit(at, surface, projection);
        return select(color, vec3f(0.0, 0.0, 0.0), has_cell_outline(pixel, limit));
    }
    return color * cell_eye_dome_shading(pixel, point.z, projection);
}

// Returns the active cell with this number, and false if there is none.
fn active_cell(number: u32, cell: ptr<function, DrawnCell>) -> bool {
    if number >= frame.cell_active_room {
        return false;
    }
    let listed = cell_lists[2u * frame.cell_active_room + number];
    if listed == 0u {
        return false;
    }
    *cell = DrawnCell(number, corner_of_cell(listed - 1u), list_of(number));
    return true;
}

// Opaque surface of a sample.
struct OpaqueSample {
    // Premultiplied colour: that of the background without a surface.
    color: vec4f,
    // Reversed depth; 0 without a surface.
    depth: f32,
}

// Draws the opaque surface of the samples of an active cell, and returns that of invocation i.
fn draw_opaque_sample(cell: DrawnCell, i: u32, drawn: u32) -> OpaqueSample {
    clear_cell(i);
    let limit = limit_of(find_maxima(cell.range, cell.corner, i, drawn));
    store_limit(i, limit, drawn);
    let sums = sum_pixel(cell.range, cell.corner, i, limit, drawn);
    let at = cell.corner + pixel_in_cell(i);
    let point = point_of(sums.color, sums.surface, sums.material);
    if !point.is_there {
        return OpaqueSample(frame.background, 0.0);
    }
    let shown = color_of(position_at(vec2i(at), point.z), point, has(drawn, DRAW_FULL));
    let pixel = vec2i(at / SAMPLES_SIDE + frame.first_pixel);
    // The depth is that of front_depth, to the bit.
    let depth = reversed_depth(sums.surface.w / sums.color.w * frame.depth_unit);
    return OpaqueSample(vec4f(cell_among_neighbours(vec2i(at), point, shown, pixel), 1.0), depth);
}

// Writes the means of the samples of an active cell to the colours of its sampled pixels. `color` is that of the sample
// of invocation i. All invocations of the workgroup have to call it.
fn write_means(cell: DrawnCell, i: u32, color: vec4f) {
    // The memory of the batches is free after the loops. Each colour is scaled before it is added, because colours may
    // be as large as the largest f32.
    workgroupBarrier();
    let in_cell = pixel_in_cell(i);
    staged[in_cell.y * CELL_SIDE + in_cell.x] = bitcast<vec4u>(color * (1.0 / f32(SAMPLES_SIDE * SAMPLES_SIDE)));
    workgroupBarrier();
    if i >= SAMPLED_SIDE * SAMPLED_SIDE {
        return;
    }
    let of_cell = vec2u(i % SAMPLED_SIDE, i / SAMPLED_SIDE);
    let in_part = cell.corner / SAMPLES_SIDE + of_cell;
    let pixel = in_part + frame.first_pixel;
    if any(in_part >= frame.size_px / SAMPLES_SIDE) || planes[edge_word(EDGE_SAMPLED, pixel)] <= 0.0 {
        return;
    }
    var sum = vec4f(0.0, 0.0, 0.0, 0.0);
    for (var k = 0u; k < SAMPLES_SIDE * SAMPLES_SIDE; k++) {
        let sample = of_cell * SAMPLES_SIDE + vec2u(k % SAMPLES_SIDE, k / SAMPLES_SIDE);
        sum += bitcast<vec4f>(staged[sample.y * CELL_SIDE + sample.x]);
    }
    let shaded = pixel - frame.shade_origin_px;
    write_color(shaded.y * frame.shade_size_px.x + shaded.x, sum);
}

// Draws the samples of the active cell with this number, and writes their means to the colours of its sampled pixels.
fn draw_samples(number: u32, i: u32, drawn: u32) {
    var cell: DrawnCell;
    if active_cell(number, &cell) {
        write_means(cell, i, draw_opaque_sample(cell, i, drawn).color);
    }
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_samples(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_samples(workgroup_number(group), i, DRAW_SURFACE);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_shadowed_samples(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_samples(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_sided_samples(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_samples(workgroup_number(group), i, DRAW_SURFACE | DRAW_SIDED);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_sided_shadowed_samples(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_samples(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL | DRAW_SIDED);
}

// Draws the samples of an image with clipped splats, with or without shadows and `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_clipped_samples(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_samples(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL | DRAW_CLIPPED);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_clipped_sided_samples(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_samples(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL | DRAW_SIDED | DRAW_CLIPPED);
}

// Draws the opaque surfaces of the samples of the active cell with this number, and starts their layers.
fn draw_layered_samples(number: u32, i: u32, drawn: u32) {
    var cell: DrawnCell;
    if !active_cell(number, &cell) {
        return;
    }
    let sample = draw_opaque_sample(cell, i, drawn);
    begin_layers_of(cell, i);
    let pixel = layered_pixel(cell, i);
    planes[layer_at(SAMPLE_DEPTH, pixel)] = sample.depth;
    for (var c = 0u; c < 4u; c++) {
        planes[layer_at(SAMPLE_COLOR + c, pixel)] = sample.color[c];
    }
}

// Draws the opaque surfaces of samples in a frame with transparent layers, clipped or not, with or without shadows and
// `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_layered_samples(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_layered_samples(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL | DRAW_CLIPPED);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_sided_layered_samples(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_layered_samples(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL | DRAW_SIDED | DRAW_CLIPPED);
}

// Draws the next layer of the samples of an active cell.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_samples_peeled_layer(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    var cell: DrawnCell;
    if !active_cell(workgroup_number(group), &cell) {
        return;
    }
    if holds_in_cell(i, cell_remains(cell.number)) {
        draw_peeled_layer(cell, i);
    }
}

// Draws the last layer of the samples of an active cell.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_samples_remaining_layer(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    var cell: DrawnCell;
    if !active_cell(workgroup_number(group), &cell) {
        return;
    }
    if holds_in_cell(i, cell_remains(cell.number)) {
        draw_remaining_layer(cell, i);
    }
}

// Composites the layers of samples over their opaque surfaces, and writes the means.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_composite_samples(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    var cell: DrawnCell;
    if !active_cell(workgroup_number(group), &cell) {
        return;
    }
    let pixel = layered_pixel(cell, i);
    var layers = vec4f(0.0, 0.0, 0.0, 0.0);
    var opaque = vec4f(0.0, 0.0, 0.0, 0.0);
    for (var c = 0u; c < 4u; c++) {
        layers[c] = planes[layer_at(LAYER_COLOR + c, pixel)];
        opaque[c] = planes[layer_at(SAMPLE_COLOR + c, pixel)];
    }
    write_means(cell, i, layers + opaque * (1.0 - layers.a));
}
