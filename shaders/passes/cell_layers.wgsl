// Transparent layers in the compute path (rendering model §8). After the opaque surface was drawn, passes draw one
// layer after another, from near to far. A layer is drawn like the opaque surface: a workgroup visits the pairs of its
// cell twice, and dense cells are drawn in parts. The layers so far, composited, are stored between passes. A cell
// without fragments behind the last layer is skipped. Layers are those of transparent_layers.wgsl.

// Numbers of the words of a pixel's layers at Frame.layers_at: premultiplied colour of the composited layers, and their
// opacity; the reversed depth threshold of the last layer; and the number of layers that aren't empty. The first word
// of all pixels of the targets, row by row, is stored before the second.
const LAYER_COLOR: u32 = 0u;
const LAYER_OPACITY: u32 = 3u;
const LAYER_PEELED: u32 = 4u;
const LAYERS_THERE: u32 = 5u;
// Number of these words.
const LAYER_WORDS: u32 = 6u;
// Numbers of the words of a cell's layers, which follow those of all pixels: number of layers drawn, also empty ones;
// and 1 if fragments remain behind the last layer.
const CELL_LAYERS: u32 = 0u;
const CELL_REMAINS: u32 = 1u;
// Number of these words.
const CELL_LAYER_WORDS: u32 = 2u;

// Returns the index in `planes` of a word of the layers of the pixel `own` of the targets.
fn layer_word(word: u32, own: vec2u) -> u32 {
    return frame.layers_at + (word * frame.size_px.y + own.y) * frame.size_px.x + own.x;
}

// Returns the index in `planes` of a word of the layers of the cell with this number.
fn cell_layer_word(word: u32, cell: u32) -> u32 {
    return frame.layers_at + LAYER_WORDS * frame.size_px.x * frame.size_px.y + word * frame.cell_count + cell;
}

// Returns the number of a cell (column, row).
fn number_of_cell(cell: vec2u) -> u32 {
    return cell.y * frame.cell_columns + cell.x;
}

// True if fragments may remain behind the last layer of a cell, given by its number.
fn cell_remains(cell: u32) -> bool {
    return planes[cell_layer_word(CELL_REMAINS, cell)] > 0.0;
}

// Starts the layers of a cell.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_begin_layers(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = group.xy;
    let own = cell * CELL_SIDE + pixel_in_cell(i);
    if all(own < frame.size_px) {
        for (var word = 0u; word < LAYER_WORDS; word++) {
            // Reversed depths are at most 1, so every fragment lies behind 2.
            planes[layer_word(word, own)] = select(0.0, 2.0, word == LAYER_PEELED);
        }
    }
    if i == 0u {
        let range = pairs_of(cell);
        planes[cell_layer_word(CELL_LAYERS, number_of_cell(cell))] = 0.0;
        planes[cell_layer_word(CELL_REMAINS, number_of_cell(cell))] = select(0.0, 1.0, range.x < range.y);
    }
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

// Returns the depths of the pixel `own` of the targets. Outside of the targets nothing lies between them.
fn layer_depths(own: vec2u) -> LayerDepths {
    if any(own >= frame.size_px) {
        return LayerDepths(0.0, 2.0);
    }
    let z = cell_depth(vec2i(own));
    let opaque = select(0.0, reversed_depth(z), z < frame.empty_depth);
    return LayerDepths(planes[layer_word(LAYER_PEELED, own)], opaque);
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

// Adds a layer, the sums `sums` up to a reversed depth threshold, behind the layers of the pixel `own` of the targets.
// If `is_lit`, the sum of colours is that of lit colours.
fn add_layer(own: vec2u, sums: CellSums, threshold: f32, is_lit: bool) {
    if any(own >= frame.size_px) {
        return;
    }
    let shaded = own - frame.shade_origin_px;
    let is_shaded = all(frame.shade_origin_px <= own) && all(shaded < frame.shade_size_px);
    let at = shaded.y * frame.shade_size_px.x + shaded.x;
    if is_shaded && frame.fragments_at != ABSENT {
        planes[frame.fragments_at + at] += sums.fragments;
    }
    // A threshold of 0 means that no fragments remain behind the layer.
    planes[layer_word(LAYER_PEELED, own)] = threshold;
    let point = point_of(sums.color, sums.surface, sums.material);
    if !point.is_there {
        return;
    }
    let layers_there = planes[layer_word(LAYERS_THERE, own)];
    if is_shaded && layers_there == 0.0 {
        write_planes(at, Surface(vec3f(0.0, 0.0, 0.0), point.normal, point.z, point.weight, true));
        if frame.nearest_at != ABSENT {
            write_nearest(at, sums.nearest);
        }
    }
    planes[layer_word(LAYERS_THERE, own)] = layers_there + 1.0;
    var color = limit_rgb(sums.color.rgb / point.weight);
    if !is_lit {
        color = color_of(position_at(vec2i(own), point.z), point, true);
    }
    let share = select(1.0, min(sums.layer_coverage / frame.full_coverage, 1.0), frame.has_abuffer != 0u);
    let alpha = sums.coverage / point.weight * share;
    let through = 1.0 - planes[layer_word(LAYER_OPACITY, own)];
    for (var c = 0u; c < 3u; c++) {
        planes[layer_word(LAYER_COLOR + c, own)] += color[c] * (alpha * through);
    }
    planes[layer_word(LAYER_OPACITY, own)] = 1.0 - through * (1.0 - alpha);
}

// Counts a layer of a cell, given by its number. `threshold` is the reversed depth threshold of the pixel of invocation
// i. All invocations of the workgroup have to call it.
fn count_cell_layer(cell: u32, i: u32, threshold: f32) {
    let remains = holds_in_cell(i, threshold > 0.0);
    if i == 0u {
        planes[cell_layer_word(CELL_LAYERS, cell)] += 1.0;
        planes[cell_layer_word(CELL_REMAINS, cell)] = select(0.0, 1.0, remains);
    }
}

// What every pass of layers draws.
const DRAWN_LAYER: u32 = DRAW_SURFACE | DRAW_FULL | DRAW_CLIPPED | DRAW_LAYERS;

// Draws the next layer of a cell, up to its depth threshold, unless the cell is dense.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_peeled_layer(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = number_of_cell(group.xy);
    let range = pairs_of(group.xy);
    if !cell_remains(cell) || is_dense(range) {
        return;
    }
    let corner = group.xy * CELL_SIDE;
    let own = corner + pixel_in_cell(i);
    let depths = layer_depths(own);
    let threshold = layer_threshold_of(range, corner, i, depths, DRAWN_LAYER);
    let sums = layer_sums(range, corner, i, depths, threshold, DRAWN_LAYER, false);
    add_layer(own, sums, threshold, false);
    count_cell_layer(cell, i, threshold);
}

// Draws the last layer of a cell, all remaining fragments, unless the cell is dense.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_remaining_layer(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = number_of_cell(group.xy);
    let range = pairs_of(group.xy);
    if !cell_remains(cell) || is_dense(range) {
        return;
    }
    let corner = group.xy * CELL_SIDE;
    let own = corner + pixel_in_cell(i);
    clear_cell(i);
    workgroupBarrier();
    add_layer(own, layer_sums(range, corner, i, layer_depths(own), 0.0, DRAWN_LAYER, true), 0.0, true);
    count_cell_layer(cell, i, 0.0);
}

// Finds the depth thresholds of the next layer among the pairs of a part of a dense cell.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_layer_thresholds(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let number = workgroup_number(group);
    let part = part_of(number);
    if part.range.x == part.range.y || !cell_remains(part.cell) {
        return;
    }
    let corner = corner_of_cell(part.cell);
    let depths = layer_depths(corner + pixel_in_cell(i));
    let threshold = layer_threshold_of(part.range, corner, i, depths, DRAWN_LAYER);
    put_part_f32(number, 0u, i, DRAWN_LAYER, threshold);
}

// Sums the contributions of a part of a dense cell to a layer. If `is_last`, the layer is the last one.
fn sum_layer_part(number: u32, i: u32, is_last: bool) {
    let part = part_of(number);
    if part.range.x == part.range.y || !cell_remains(part.cell) {
        return;
    }
    let corner = corner_of_cell(part.cell);
    let depths = layer_depths(corner + pixel_in_cell(i));
    var threshold = 0.0;
    if !is_last {
        let of_cell = vec2u(pairs_in[part.cell].cell, pairs_in[part.cell].record);
        threshold = maxima_of_parts(of_cell, i, DRAWN_LAYER).maxima.threshold;
    }
    clear_cell(i);
    workgroupBarrier();
    let sums = layer_sums(part.range, corner, i, depths, threshold, DRAWN_LAYER, is_last);
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
    let cell = number_of_cell(group.xy);
    let range = pairs_of(group.xy);
    if !cell_remains(cell) || !is_dense(range) {
        return;
    }
    let threshold = maxima_of_parts(range, i, DRAWN_LAYER).maxima.threshold;
    let own = group.xy * CELL_SIDE + pixel_in_cell(i);
    add_layer(own, sums_of_parts(range, i, DRAWN_LAYER), threshold, false);
    count_cell_layer(cell, i, threshold);
}

// Adds the last layer of a dense cell (column, row) from the sums of its parts.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine_remaining_layer(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = number_of_cell(group.xy);
    let range = pairs_of(group.xy);
    if !cell_remains(cell) || !is_dense(range) {
        return;
    }
    let own = group.xy * CELL_SIDE + pixel_in_cell(i);
    add_layer(own, sums_of_parts(range, i, DRAWN_LAYER), 0.0, true);
    count_cell_layer(cell, i, 0.0);
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
    if cell < frame.cell_count {
        let layers = planes[cell_layer_word(CELL_LAYERS, cell)];
        atomicMax(&cell_counters[frame.cell_part].layers, u32(layers));
        if cell_remains(cell) {
            atomicMax(&cell_counters[frame.cell_part].layers_remain, 1u);
        }
    }
}
