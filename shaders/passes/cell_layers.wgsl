// Transparent layers in the compute path (rendering model §8). After the opaque surface was drawn, passes draw one
// layer after another, from near to far. A layer is drawn like the opaque surface: a workgroup visits the pairs of its
// cell twice, and dense cells are drawn in parts. The layers so far, composited, are stored between passes. A cell
// without fragments behind the last layer is skipped. Layers are those of transparent_layers.wgsl.
//
// Layers of samples are drawn by the same functions (cell_samples.wgsl).

// Numbers of the words of a pixel's layers: premultiplied colour of the composited layers, and their opacity; the
// reversed depth threshold of the last layer; and the number of layers that aren't empty.
const LAYER_COLOR: u32 = 0u;
const LAYER_OPACITY: u32 = 3u;
const LAYER_PEELED: u32 = 4u;
const LAYERS_THERE: u32 = 5u;
// Number of these words.
const LAYER_WORDS: u32 = 6u;
// Numbers of the words of a cell's layers: number of layers drawn, also empty ones; and 1 if fragments remain behind
// the last layer.
const CELL_LAYERS: u32 = 0u;
const CELL_REMAINS: u32 = 1u;
// Number of these words.
const CELL_LAYER_WORDS: u32 = 2u;
// Words of a sample after LAYER_WORDS: reversed depth of the opaque surface, 0 without one; and the colour without
// layers, four words.
const SAMPLE_DEPTH: u32 = 6u;
const SAMPLE_COLOR: u32 = 7u;
// Number of words of a sample. The words of the cell follow, in place of those of the cell's first sample.
const SAMPLE_CELL: u32 = 11u;
const SAMPLE_WORDS: u32 = 13u;

// A cell that a workgroup draws.
struct DrawnCell {
    // Number of the cell, row by row, in the grid or, in a frame of samples, among active cells.
    number: u32,
    // First pixel of the cell in the targets.
    corner: vec2u,
    // Indices of the cell's first pair and one past its last.
    range: vec2u,
}

// A pixel of a cell: the cell's number as in DrawnCell, the pixel in the targets, and its invocation.
struct LayeredPixel {
    cell: u32,
    own: vec2u,
    i: u32,
}

// Returns the pixel of invocation i of a cell.
fn layered_pixel(cell: DrawnCell, i: u32) -> LayeredPixel {
    return LayeredPixel(cell.number, cell.corner + pixel_in_cell(i), i);
}

// Returns the cell of pixels in this column and row of the grid.
fn cell_of_pixels(cell: vec2u) -> DrawnCell {
    return DrawnCell(cell.y * frame.cell_columns + cell.x, cell * CELL_SIDE, pairs_of(cell));
}

// Returns the index in `planes` of a word of the layers of the pixel `own` of the targets of pixels. The first word of
// all pixels, row by row, is stored before the second.
fn layer_word(word: u32, own: vec2u) -> u32 {
    let size = pixel_targets_px();
    return frame.layers_at + (word * size.y + own.y) * size.x + own.x;
}

// Returns the index in `planes` of a word of the layers of a cell of pixels. These words follow those of all pixels.
fn cell_layer_word(word: u32, cell: u32) -> u32 {
    return frame.layers_at + LAYER_WORDS * frame.size_px.x * frame.size_px.y + word * frame.cell_count + cell;
}

// Returns the index in `planes` of a word of the sample of invocation i of an active cell.
fn sample_word(word: u32, cell: u32, i: u32) -> u32 {
    return frame.samples_at + (cell * SAMPLE_WORDS + word) * CELL_WORKGROUP + i;
}

// Returns the index in `planes` of a word of the layers of a pixel or sample.
fn layer_at(word: u32, pixel: LayeredPixel) -> u32 {
    return select(layer_word(word, pixel.own), sample_word(word, pixel.cell, pixel.i), frame.is_of_samples != 0u);
}

// Returns the index in `planes` of a word of the layers of a cell, given by its number.
fn cell_layer_at(word: u32, cell: u32) -> u32 {
    return select(cell_layer_word(word, cell), sample_word(SAMPLE_CELL + word, cell, 0u), frame.is_of_samples != 0u);
}

// True if fragments may remain behind the last layer of a cell, given by its number.
fn cell_remains(cell: u32) -> bool {
    return planes[cell_layer_at(CELL_REMAINS, cell)] > 0.0;
}

// Starts the layers of a cell: of the pixel of invocation i and, in the first invocation, of the cell.
fn begin_layers_of(cell: DrawnCell, i: u32) {
    let pixel = layered_pixel(cell, i);
    if all(pixel.own < frame.size_px) {
        for (var word = 0u; word < LAYER_WORDS; word++) {
            // Reversed depths are at most 1, so every fragment lies behind 2.
            planes[layer_at(word, pixel)] = select(0.0, 2.0, word == LAYER_PEELED);
        }
    }
    if i == 0u {
        planes[cell_layer_at(CELL_LAYERS, cell.number)] = 0.0;
        planes[cell_layer_at(CELL_REMAINS, cell.number)] = select(0.0, 1.0, cell.range.x < cell.range.y);
    }
}

// Starts the layers of a cell of pixels.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_begin_layers(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    begin_layers_of(cell_of_pixels(group.xy), i);
}

// Lights transparent splats at their centres for the last layer, like `lit_corner`. The colours replace the centres in
// the records.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_light(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let record = workgroup_number(group) * CELL_WORKGROUP + i;
    if record >= min(cell_counts[frame.cell_part].records, frame.cell_record_room) {
        return;
    }
    let flags = cell_records_out[part_at(3u, record)].w;
    if (flags & RECORD_LAYERED) == 0u {
        return;
    }
    var material = frame.material;
    if frame.has_materials != 0u {
        material = objects[flags >> RECORD_OBJECT].material;
    }
    var albedo = vec3f(1.0, 1.0, 1.0);
    if frame.has_colors != 0u {
        albedo = bitcast<vec3f>(cell_records_out[part_at(6u, record)].xyz);
    }
    let normal = bitcast<vec3f>(cell_records_out[part_at(7u, record)].xyz);
    let place = cell_records_out[part_at(RECORD_PLACE, record)];
    let center = bitcast<vec3f>(place.yzw);
    // The centre may be nearer than z_near, where the stored depth would exceed 1.
    let z = max(center.z, frame.projection.near);
    let color = color_of(center, Point(albedo, normal, material, z, 0.0, true), true);
    cell_records_out[part_at(RECORD_PLACE, record)] = vec4u(place.x, bitcast<vec3u>(color));
}

// Reversed depths between which a layer has its fragments at a pixel: those of the last layer's threshold and of the
// opaque surface.
struct LayerDepths {
    peeled: f32,
    opaque: f32,
}

// Returns the reversed depth of the opaque surface of a pixel or sample of the targets; 0 without one.
fn opaque_depth_of(pixel: LayeredPixel) -> f32 {
    if frame.is_of_samples != 0u {
        return planes[layer_at(SAMPLE_DEPTH, pixel)];
    }
    let z = cell_depth(vec2i(pixel.own));
    return select(0.0, reversed_depth(z), z < frame.empty_depth);
}

// Returns the depths of a pixel. Outside of the targets nothing lies between them.
fn layer_depths(pixel: LayeredPixel) -> LayerDepths {
    if any(pixel.own >= frame.size_px) {
        return LayerDepths(0.0, 2.0);
    }
    return LayerDepths(planes[layer_at(LAYER_PEELED, pixel)], opaque_depth_of(pixel));
}

// Runs the first loop of a layer: returns the reversed depth threshold of the pixel of invocation i.
fn layer_threshold_of(range: vec2u, corner: vec2u, i: u32, depths: LayerDepths, drawn: u32) -> f32 {
    clear_cell(i);
    atomicStore(&sides[i], bitcast<u32>(depths.peeled));
    atomicStore(&pixel_bits[i], bitcast<u32>(depths.opaque));
    let threshold = find_maxima(range, corner, i, drawn).threshold;
    atomicStore(&pixel_bits[i], 0u);
    return threshold;
}

// Runs the second loop of a layer: returns the sums of the pixel of invocation i up to a reversed depth threshold. A
// barrier has to precede. If `is_lit`, splats are those that `cell_light` has lit.
fn layer_sums(
    range: vec2u,
    corner: vec2u,
    i: u32,
    depths: LayerDepths,
    threshold: f32,
    drawn: u32,
    is_lit: bool,
) -> CellSums {
    let limit = CellLimit(max(threshold, depths.opaque), 0u, vec2f(0.0, 0.0));
    atomicStore(&sides[i], bitcast<u32>(depths.peeled));
    store_limit(i, limit, drawn);
    return sum_lit_pixel(range, corner, i, limit, drawn, is_lit);
}

// Adds a layer, the sums `sums` up to a reversed depth threshold, behind the layers of a pixel. If `is_lit`, the sum of
// colours is that of lit colours.
fn add_layer(pixel: LayeredPixel, sums: CellSums, threshold: f32, is_lit: bool) {
    let own = pixel.own;
    if any(own >= frame.size_px) {
        return;
    }
    let shaded = own - frame.shade_origin_px;
    let is_inside = all(frame.shade_origin_px <= own) && all(shaded < frame.shade_size_px);
    let is_shaded = is_inside && frame.is_of_samples == 0u;
    let at = shaded.y * frame.shade_size_px.x + shaded.x;
    if is_shaded && frame.fragments_at != ABSENT {
        planes[frame.fragments_at + at] += sums.fragments;
    }
    // A threshold of 0 means that no fragments remain behind the layer.
    planes[layer_at(LAYER_PEELED, pixel)] = threshold;
    let point = point_of(sums.color, sums.surface, sums.material);
    if !point.is_there {
        return;
    }
    if is_shaded && planes[layer_at(LAYERS_THERE, pixel)] == 0.0 {
        write_planes(at, Surface(vec3f(0.0, 0.0, 0.0), point.normal, point.z, point.weight, true));
        if frame.nearest_at != ABSENT {
            write_nearest(at, sums.nearest);
        }
    }
    planes[layer_at(LAYERS_THERE, pixel)] += 1.0;
    var color = limit_rgb(sums.color.rgb / point.weight);
    if !is_lit {
        color = color_of(position_at(vec2i(own), point.z), point, true);
    }
    let share = select(1.0, min(sums.layer_coverage / frame.full_coverage, 1.0), frame.has_abuffer != 0u);
    let alpha = sums.coverage / point.weight * share;
    let through = 1.0 - planes[layer_at(LAYER_OPACITY, pixel)];
    for (var c = 0u; c < 3u; c++) {
        planes[layer_at(LAYER_COLOR + c, pixel)] += color[c] * (alpha * through);
    }
    planes[layer_at(LAYER_OPACITY, pixel)] = 1.0 - through * (1.0 - alpha);
}

// Counts a layer of a cell, given by its number. `threshold` is the reversed depth threshold of the pixel of invocation
// i. All invocations of the workgroup have to call it.
fn count_cell_layer(cell: u32, i: u32, threshold: f32) {
    let remains = holds_in_cell(i, threshold > 0.0);
    if i == 0u {
        planes[cell_layer_at(CELL_LAYERS, cell)] += 1.0;
        planes[cell_layer_at(CELL_REMAINS, cell)] = select(0.0, 1.0, remains);
    }
}

// What every pass of layers draws.
const DRAWN_LAYER: u32 = DRAW_SURFACE | DRAW_FULL | DRAW_CLIPPED | DRAW_LAYERS;

// Draws the next layer of a cell, up to its depth threshold.
fn draw_peeled_layer(cell: DrawnCell, i: u32) {
    let pixel = layered_pixel(cell, i);
    let depths = layer_depths(pixel);
    let threshold = layer_threshold_of(cell.range, cell.corner, i, depths, DRAWN_LAYER);
    add_layer(pixel, layer_sums(cell.range, cell.corner, i, depths, threshold, DRAWN_LAYER, false), threshold, false);
    count_cell_layer(cell.number, i, threshold);
}

// Draws the last layer of a cell, all remaining fragments.
fn draw_remaining_layer(cell: DrawnCell, i: u32) {
    let pixel = layered_pixel(cell, i);
    clear_cell(i);
    workgroupBarrier();
    let depths = layer_depths(pixel);
    add_layer(pixel, layer_sums(cell.range, cell.corner, i, depths, 0.0, DRAWN_LAYER, true), 0.0, true);
    count_cell_layer(cell.number, i, 0.0);
}

// Draws the next layer of a cell of pixels, unless the cell is dense.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_peeled_layer(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = cell_of_pixels(group.xy);
    if is_dense(cell.range) || !holds_in_cell(i, cell_remains(cell.number)) {
        return;
    }
    draw_peeled_layer(cell, i);
}

// Draws the last layer of a cell of pixels, unless the cell is dense.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_remaining_layer(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = cell_of_pixels(group.xy);
    if is_dense(cell.range) || !holds_in_cell(i, cell_remains(cell.number)) {
        return;
    }
    draw_remaining_layer(cell, i);
}

// Finds the depth thresholds of the next layer among the pairs of a part of a dense cell.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_layer_thresholds(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let number = workgroup_number(group);
    let part = part_of(number);
    let cell = cell_of_pixels(numbered_cell(part.cell));
    if part.range.x == part.range.y || !holds_in_cell(i, cell_remains(cell.number)) {
        return;
    }
    let depths = layer_depths(layered_pixel(cell, i));
    let threshold = layer_threshold_of(part.range, cell.corner, i, depths, DRAWN_LAYER);
    put_part_f32(number, 0u, i, DRAWN_LAYER, threshold);
}

// Sums the contributions of a part of a dense cell to a layer. If `is_last`, the layer is the last one.
fn sum_layer_part(number: u32, i: u32, is_last: bool) {
    let part = part_of(number);
    let cell = cell_of_pixels(numbered_cell(part.cell));
    if part.range.x == part.range.y || !holds_in_cell(i, cell_remains(cell.number)) {
        return;
    }
    let depths = layer_depths(layered_pixel(cell, i));
    var threshold = 0.0;
    if !is_last {
        threshold = maxima_of_parts(cell.range, i, DRAWN_LAYER).maxima.threshold;
    }
    clear_cell(i);
    workgroupBarrier();
    let sums = layer_sums(part.range, cell.corner, i, depths, threshold, DRAWN_LAYER, is_last);
    put_part_sums(number, i, DRAWN_LAYER, sums);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_peeled_layer(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    sum_layer_part(workgroup_number(group), i, false);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_remaining_layer(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    sum_layer_part(workgroup_number(group), i, true);
}

// Adds a layer of a dense cell (column, row) from the sums of its parts.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine_peeled_layer(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = cell_of_pixels(group.xy);
    if !is_dense(cell.range) || !holds_in_cell(i, cell_remains(cell.number)) {
        return;
    }
    let threshold = maxima_of_parts(cell.range, i, DRAWN_LAYER).maxima.threshold;
    add_layer(layered_pixel(cell, i), sums_of_parts(cell.range, i, DRAWN_LAYER), threshold, false);
    count_cell_layer(cell.number, i, threshold);
}

// Adds the last layer of a dense cell (column, row) from the sums of its parts.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine_remaining_layer(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = cell_of_pixels(group.xy);
    if !is_dense(cell.range) || !holds_in_cell(i, cell_remains(cell.number)) {
        return;
    }
    add_layer(layered_pixel(cell, i), sums_of_parts(cell.range, i, DRAWN_LAYER), 0.0, true);
    count_cell_layer(cell.number, i, 0.0);
}

// Composites the layers over the colours of the image.
@compute @workgroup_size(8, 8)
fn cell_composite_layers(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.shade_size_px) || frame.color_at == ABSENT {
        return;
    }
    let own = id.xy + frame.shade_origin_px;
    if planes[layer_word(LAYERS_THERE, own)] == 0.0 {
        return;
    }
    let at = id.y * frame.shade_size_px.x + id.x;
    let to = frame.color_at + 4u * at;
    let opaque = vec4f(planes[to], planes[to + 1u], planes[to + 2u], planes[to + 3u]);
    let color = vec3f(
        planes[layer_word(LAYER_COLOR, own)],
        planes[layer_word(LAYER_COLOR + 1u, own)],
        planes[layer_word(LAYER_COLOR + 2u, own)],
    );
    let opacity = planes[layer_word(LAYER_OPACITY, own)];
    write_color(at, vec4f(color, opacity) + opaque * (1.0 - opacity));
}

// Writes the largest number of layers of all cells to the tile's counters, and if any of their cells has fragments
// behind them.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_count_layers(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = workgroup_number(group) * CELL_WORKGROUP + i;
    var cells = frame.cell_count;
    if frame.is_of_samples != 0u {
        cells = min(atomicLoad(&cell_counters[frame.cell_part].active_cells), frame.cell_active_room);
    }
    if cell < cells {
        atomicMax(&cell_counters[frame.cell_part].layers, u32(planes[cell_layer_at(CELL_LAYERS, cell)]));
        if cell_remains(cell) {
            atomicMax(&cell_counters[frame.cell_part].layers_remain, 1u);
        }
    }
}

// What the passes draw that find the nearest transparent fragments, for steps of edge samples: those not behind the
// opaque surface, whose depth is in `sides`.
const DRAWN_LAYER_EDGES: u32 = DRAW_SURFACE | DRAW_FULL | DRAW_EDGES | DRAW_CLIPPED | DRAW_LAYERS;

// Runs the first loop of the nearest layer: returns the maxima of the pixel of invocation i, and their splats.
fn layer_edge_of(range: vec2u, corner: vec2u, pixel: LayeredPixel) -> CellMaxima {
    clear_cell(pixel.i);
    var opaque = 2.0;
    if all(pixel.own < frame.size_px) {
        opaque = opaque_depth_of(pixel);
    }
    atomicStore(&sides[pixel.i], bitcast<u32>(opaque));
    return find_maxima_and_writers(range, corner, pixel.i, DRAWN_LAYER_EDGES);
}

// Writes the edge data of the nearest layer of the pixel `own` of the targets.
fn write_layer_edge(own: vec2u, found: CellMaxima) {
    if all(own < frame.size_px) {
        planes[edge_word(EDGE_LAYER_THRESHOLD, own)] = found.writers.threshold.x;
        planes[edge_word(EDGE_LAYER_EPSILON, own)] = found.writers.threshold.y;
    }
}

// Finds the nearest transparent fragments of a cell, unless the cell is dense. The next two entry points do so in dense
// cells.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_layer_edges(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = cell_of_pixels(group.xy);
    if is_dense(cell.range) {
        return;
    }
    let pixel = layered_pixel(cell, i);
    write_layer_edge(pixel.own, layer_edge_of(cell.range, cell.corner, pixel));
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_layer_edges(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let number = workgroup_number(group);
    let part = part_of(number);
    if part.range.x == part.range.y {
        return;
    }
    let cell = cell_of_pixels(numbered_cell(part.cell));
    put_part_maxima(number, i, DRAWN_LAYER_EDGES, layer_edge_of(part.range, cell.corner, layered_pixel(cell, i)));
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine_layer_edges(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = cell_of_pixels(group.xy);
    if is_dense(cell.range) {
        write_layer_edge(layered_pixel(cell, i).own, maxima_of_parts(cell.range, i, DRAWN_LAYER_EDGES));
    }
}
