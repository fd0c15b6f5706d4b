// Transparent layers in the compute path (rendering model §8). After the opaque surface was drawn, a workgroup visits the
// pairs of its cell again, once or twice per layer, and composites the layers of its pixels from near to far. Layers are
// those of transparent_layers.wgsl.

// Returns the reversed depth of the opaque surface at a pixel of the targets; 0 without one. Outside of the targets it
// is nearer than every fragment.
fn opaque_depth_at(pixel: vec2i) -> f32 {
    if any(vec2u(pixel) >= frame.size_px) {
        return 2.0;
    }
    let z = cell_depth(pixel);
    return select(0.0, reversed_depth(z), z < frame.empty_depth);
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

// Returns the layers of a pixel of the targets with one more layer behind them, that of `sums`. If `is_lit`, the sum of
// colours is that of lit colours.
fn with_cell_layer(layers: LayerComposite, pixel: vec2i, sums: CellSums, is_lit: bool) -> LayerComposite {
    var more = layers;
    let point = point_of(sums.color, sums.surface, sums.material);
    if point.is_there {
        var color = limit_rgb(sums.color.rgb / point.weight);
        if !is_lit {
            color = color_of(position_at(pixel, point.z), point, true);
        }
        let share = select(1.0, min(sums.layer_coverage / frame.full_coverage, 1.0), frame.has_abuffer != 0u);
        more = composite_under(layers, point, color, sums.coverage / point.weight * share);
    }
    more.counts += u32(sums.fragments);
    return more;
}

// Draws the layers of a cell (column, row), and composites them over the planes of its pixels.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_layers(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = group.xy;
    let drawn = DRAW_SURFACE | DRAW_FULL | DRAW_CLIPPED | DRAW_LAYERS;
    let range = pairs_of(cell);
    let corner = cell * CELL_SIDE;
    let own = corner + pixel_in_cell(i);
    let pixel = vec2i(own);
    var layers: LayerComposite;
    // Reversed depths are at most 1, so every fragment lies behind 2.
    layers.peeled_depth = 2.0;
    // Record of the nearest fragment of the nearest layer.
    var nearest = 0u;
    var number = 0u;
    var any_remaining = range.x < range.y;
    while any_remaining && number < frame.layer_count + frame.has_remaining_layer {
        let is_last = number == frame.layer_count;
        clear_cell(i);
        atomicStore(&sides[i], bitcast<u32>(layers.peeled_depth));
        var limit = CellLimit(0.0, 0u, vec2f(0.0, 0.0));
        if !is_last {
            limit = find_limit(range, corner, i, drawn);
        }
        let sums = sum_lit_pixel(range, corner, i, limit, drawn, is_last);
        let had_layer = layers.z > 0.0;
        layers = with_cell_layer(layers, pixel, sums, is_last);
        if !had_layer && layers.z > 0.0 {
            nearest = sums.nearest;
        }
        // A threshold of 0 means that no fragments remain behind the layer.
        layers.peeled_depth = limit.threshold;
        number += 1u;
        any_remaining = holds_in_cell(i, limit.threshold > 0.0);
    }
    if i == 0u {
        let has_more = any_remaining && frame.has_abuffer != 0u;
        planes[frame.layers_at + cell.y * frame.cell_columns + cell.x] = f32(number + select(0u, 1u, has_more));
    }
    write_layers(own, layers, nearest);
}

// Composites the layers of the pixel `own` of the targets over its planes. `nearest` is the record of the nearest
// fragment.
fn write_layers(own: vec2u, layers: LayerComposite, nearest: u32) {
    let shaded = own - frame.shade_origin_px;
    if any(own < frame.shade_origin_px) || any(shaded >= frame.shade_size_px) {
        return;
    }
    let at = shaded.y * frame.shade_size_px.x + shaded.x;
    if frame.fragments_at != ABSENT {
        planes[frame.fragments_at + at] += f32(fragments_of(layers));
    }
    if layers.z <= 0.0 {
        return;
    }
    if frame.color_at != ABSENT {
        let to = frame.color_at + 4u * at;
        let opaque = vec4f(planes[to], planes[to + 1u], planes[to + 2u], planes[to + 3u]);
        write_color(at, composite_over(layers, opaque));
    }
    write_planes(at, Surface(layers.color, layers.normal, layers.z, layers.weight, true));
    if frame.nearest_at != ABSENT {
        write_nearest(at, nearest);
    }
}

// Writes the largest number of layers of all cells to the tile's counters.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_count_layers(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let cell = workgroup_number(group) * CELL_WORKGROUP + i;
    if cell < frame.cell_count {
        atomicMax(&cell_counters[frame.cell_part].layers, u32(planes[frame.layers_at + cell]));
    }
}
