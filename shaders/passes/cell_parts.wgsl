// Dense cells in the compute path. Their pairs are divided into parts, which workgroups of their own draw with the two
// loops of cell_raster.wgsl: one pass finds the depth thresholds of all parts, and the next sums up to the nearest of
// them. A last pass combines the parts in order.

// Largest number of pairs of a cell that isn't dense. Dense cells are drawn in parts, each by its own workgroup, so
// that no workgroup's work grows with the number of splats. The parts are combined in order.
const DENSE_PAIRS: u32 = 4096u;
// Length of a run of pairs in the order of lists, which limits a part's number of pairs. Two parts may begin in a run:
// the last of one dense cell and the first of the next.
const PART_PAIRS: u32 = 2048u;
// Number of words of a part per pixel: its depth threshold (a reversed depth); the z + ε and the ε of the splat that
// defines it; four sums each of colours, surface and material; sums of fragments and coverage; depth and record of its
// nearest fragment; coverage of a layer.
const PART_WORDS: u32 = 20u;
// Number of words of a part per pixel if sides are separated: the four other maxima, and the z + ε and the ε of the
// splats that define them, follow.
const SIDED_PART_WORDS: u32 = 32u;

// Results of the parts: word k of the pixel of invocation i of a part is at (part·words + k)·CELL_WORKGROUP + i, with
// PART_WORDS or SIDED_PART_WORDS words.
@group(1) @binding(54) var<storage, read_write> cell_parts: array<u32>;

// True if a cell with the pairs `range` is dense.
fn is_dense(range: vec2u) -> bool {
    return range.y - range.x > DENSE_PAIRS;
}

// A part of a dense cell: the cell's `cell_number`, and the indices of the part's first pair and one past its last.
// They are equal if the part doesn't exist.
struct CellPart {
    cell: u32,
    range: vec2u,
}

// Returns `cell` plus `step`, at most the last cell, if the list of that cell begins at or before element `at` of
// `cell_lists`; else `cell`.
fn cell_before(at: u32, cell: u32, step: u32) -> u32 {
    let later = min(cell + step, CELL_WORKGROUP * bin_count() - 1u);
    return select(cell, later, list_of(later).x <= at);
}

// Returns the number of the cell whose list contains element `at` of `cell_lists`. Lists are in the order of cells.
fn cell_of_pair(at: u32) -> u32 {
    // Without a loop, like `bin_block`. A tile has at most 65536 cells.
    var cell = cell_before(at, 0u, 32768u);
    cell = cell_before(at, cell, 16384u);
    cell = cell_before(at, cell, 8192u);
    cell = cell_before(at, cell, 4096u);
    cell = cell_before(at, cell, 2048u);
    cell = cell_before(at, cell, 1024u);
    cell = cell_before(at, cell, 512u);
    cell = cell_before(at, cell, 256u);
    cell = cell_before(at, cell, 128u);
    cell = cell_before(at, cell, 64u);
    cell = cell_before(at, cell, 32u);
    cell = cell_before(at, cell, 16u);
    cell = cell_before(at, cell, 8u);
    cell = cell_before(at, cell, 4u);
    cell = cell_before(at, cell, 2u);
    return cell_before(at, cell, 1u);
}

// Returns the part with this number. Pairs, in the order of lists, are divided into runs of PART_PAIRS. Part 2k + 1
// belongs to the dense cell whose pairs begin in run k, part 2k to a dense cell whose pairs begin before the run.
fn part_of(number: u32) -> CellPart {
    let count = pair_count();
    let begin = (number / 2u) * PART_PAIRS;
    if begin >= count {
        return CellPart(0u, vec2u(0u, 0u));
    }
    let first = frame.cell_header + begin;
    let end = frame.cell_header + min(begin + PART_PAIRS, count);
    let begins_here = number % 2u == 1u;
    let cell = cell_of_pair(select(first, end - 1u, begins_here));
    let list = list_of(cell);
    if !is_dense(list) || (list.x >= first) != begins_here {
        return CellPart(0u, vec2u(0u, 0u));
    }
    return CellPart(cell, vec2u(max(list.x, first), min(list.y, end)));
}

// Returns the number of the k-th part, from 0, of a dense cell with the pairs `range`.
fn part_number(range: vec2u, k: u32) -> u32 {
    let block = (range.x - frame.cell_header) / PART_PAIRS;
    return 2u * (block + k) + select(0u, 1u, k == 0u);
}

// Returns the number of parts of a dense cell with the pairs `range`.
fn parts_of(range: vec2u) -> u32 {
    return (range.y - 1u - frame.cell_header) / PART_PAIRS - (range.x - frame.cell_header) / PART_PAIRS + 1u;
}

// Returns the index in `cell_parts` of word k of the pixel of invocation i of a part.
fn part_word(part: u32, k: u32, i: u32, drawn: u32) -> u32 {
    return (part * select(PART_WORDS, SIDED_PART_WORDS, has(drawn, DRAW_SIDED)) + k) * CELL_WORKGROUP + i;
}

// Writes word k of the pixel of invocation i of a part.
fn put_part_f32(part: u32, k: u32, i: u32, drawn: u32, value: f32) {
    cell_parts[part_word(part, k, i, drawn)] = bitcast<u32>(value);
}

// Returns word k of the pixel of invocation i of a part.
fn part_f32(part: u32, k: u32, i: u32, drawn: u32) -> f32 {
    return bitcast<f32>(cell_parts[part_word(part, k, i, drawn)]);
}

// Writes two words, from number k on, of the pixel of invocation i of a part.
fn put_part_vec2(part: u32, k: u32, i: u32, drawn: u32, value: vec2f) {
    put_part_f32(part, k, i, drawn, value.x);
    put_part_f32(part, k + 1u, i, drawn, value.y);
}

// Returns two words, from number k on, of the pixel of invocation i of a part.
fn part_vec2(part: u32, k: u32, i: u32, drawn: u32) -> vec2f {
    return vec2f(part_f32(part, k, i, drawn), part_f32(part, k + 1u, i, drawn));
}

// Writes the maxima of the pixel of invocation i of a part.
fn put_part_maxima(part: u32, i: u32, drawn: u32, found: CellMaxima) {
    put_part_f32(part, 0u, i, drawn, found.maxima.threshold);
    if has(drawn, DRAW_EDGES) {
        put_part_vec2(part, 1u, i, drawn, found.writers.threshold);
    }
    if !has(drawn, DRAW_SIDED) {
        return;
    }
    put_part_vec2(part, PART_WORDS, i, drawn, vec2f(found.maxima.front, found.maxima.back));
    let nearness = vec2f(found.maxima.front_nearness, found.maxima.back_nearness);
    put_part_vec2(part, PART_WORDS + 2u, i, drawn, nearness);
    if has(drawn, DRAW_EDGES) {
        put_part_vec2(part, PART_WORDS + 4u, i, drawn, found.writers.front);
        put_part_vec2(part, PART_WORDS + 6u, i, drawn, found.writers.back);
        put_part_vec2(part, PART_WORDS + 8u, i, drawn, found.writers.front_nearest);
        put_part_vec2(part, PART_WORDS + 10u, i, drawn, found.writers.back_nearest);
    }
}

// Returns the maxima, over all parts of a dense cell with the pairs `range`, of the pixel of invocation i.
fn maxima_of_parts(range: vec2u, i: u32, drawn: u32) -> CellMaxima {
    var all: CellMaxima;
    for (var k = 0u; k < parts_of(range); k++) {
        let part = part_number(range, k);
        var own = Maxima(part_f32(part, 0u, i, drawn), 0.0, 0.0, 0.0, 0.0);
        if has(drawn, DRAW_SIDED) {
            let thresholds = part_vec2(part, PART_WORDS, i, drawn);
            let nearness = part_vec2(part, PART_WORDS + 2u, i, drawn);
            own = Maxima(own.threshold, thresholds.x, thresholds.y, nearness.x, nearness.y);
        }
        // Of equal maxima, the first part's is that of the first splat.
        if has(drawn, DRAW_EDGES) && own.threshold > all.maxima.threshold {
            all.writers.threshold = part_vec2(part, 1u, i, drawn);
        }
        if has(drawn, DRAW_EDGES) && has(drawn, DRAW_SIDED) {
            if own.front > all.maxima.front {
                all.writers.front = part_vec2(part, PART_WORDS + 4u, i, drawn);
            }
            if own.back > all.maxima.back {
                all.writers.back = part_vec2(part, PART_WORDS + 6u, i, drawn);
            }
            if own.front_nearness > all.maxima.front_nearness {
                all.writers.front_nearest = part_vec2(part, PART_WORDS + 8u, i, drawn);
            }
            if own.back_nearness > all.maxima.back_nearness {
                all.writers.back_nearest = part_vec2(part, PART_WORDS + 10u, i, drawn);
            }
        }
        all.maxima = greatest(all.maxima, own);
    }
    return all;
}

// Writes the sums of the pixel of invocation i of a part.
fn put_part_sums(part: u32, i: u32, drawn: u32, sums: CellSums) {
    for (var k = 0u; k < 4u; k++) {
        put_part_f32(part, 3u + k, i, drawn, sums.color[k]);
        put_part_f32(part, 7u + k, i, drawn, sums.surface[k]);
        put_part_f32(part, 11u + k, i, drawn, sums.material[k]);
    }
    put_part_f32(part, 15u, i, drawn, sums.fragments);
    put_part_f32(part, 16u, i, drawn, sums.coverage);
    put_part_f32(part, 17u, i, drawn, sums.nearest_z);
    cell_parts[part_word(part, 18u, i, drawn)] = sums.nearest;
    if has(drawn, DRAW_LAYERS) {
        put_part_f32(part, 19u, i, drawn, sums.layer_coverage);
    }
}

// Returns the first pixel, in the targets, of the cell with this number.
fn corner_of_cell(cell: u32) -> vec2u {
    return numbered_cell(cell) * CELL_SIDE;
}

// Finds the depth thresholds of the pixels of part `number`, among the part's pairs alone. The entry points below call
// it for frames without antialiased edges or with them (edged), and with clipped splats (clipped).
fn find_part_thresholds(number: u32, i: u32, drawn: u32) {
    let part = part_of(number);
    if part.range.x == part.range.y {
        return;
    }
    var nearest = 0.0;
    if has(drawn, DRAW_BEHIND) {
        let edge = edge_at(corner_of_cell(part.cell) + pixel_in_cell(i));
        if !holds_in_cell(i, edge.is_edge) {
            return;
        }
        nearest = edge.nearest;
    }
    clear_cell(i);
    if has(drawn, DRAW_BEHIND) {
        atomicStore(&sides[i], bitcast<u32>(nearest));
    }
    put_part_maxima(number, i, drawn, maxima_by(part.range, corner_of_cell(part.cell), i, drawn));
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_thresholds(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    find_part_thresholds(workgroup_number(group), i, 0u);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_edged_thresholds(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    find_part_thresholds(workgroup_number(group), i, DRAW_EDGES);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_clipped_thresholds(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    find_part_thresholds(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL | DRAW_CLIPPED);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_clipped_edged_thresholds(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    find_part_thresholds(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL | DRAW_EDGES | DRAW_CLIPPED);
}

// Sums the contributions of part `number` to its pixels, up to the smallest depth threshold of all parts of its cell.
// The entry points below call it for images without normals and depths (colors) or with them (surfaces), with
// antialiased edges (edged), and with clipped splats (clipped).
fn sum_part(number: u32, i: u32, drawn: u32) {
    let part = part_of(number);
    if part.range.x == part.range.y {
        return;
    }
    let of_cell = list_of(part.cell);
    let limit = limit_by(maxima_of_parts(of_cell, i, drawn), drawn);
    var nearest = 0.0;
    if has(drawn, DRAW_BEHIND) {
        let edge = edge_at(corner_of_cell(part.cell) + pixel_in_cell(i));
        if !holds_in_cell(i, edge.is_edge) {
            return;
        }
        nearest = edge.nearest;
    }
    clear_cell(i);
    workgroupBarrier();
    if has(drawn, DRAW_BEHIND) {
        atomicStore(&sides[i], bitcast<u32>(nearest));
    }
    store_limit(i, limit, drawn);
    put_part_sums(number, i, drawn, sum_pixel(part.range, corner_of_cell(part.cell), i, limit, drawn));
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_colors(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    sum_part(workgroup_number(group), i, 0u);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_surfaces(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    sum_part(workgroup_number(group), i, DRAW_SURFACE);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_edged_surfaces(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    sum_part(workgroup_number(group), i, DRAW_SURFACE | DRAW_EDGES);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_clipped_surfaces(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    sum_part(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL | DRAW_CLIPPED);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_clipped_edged_surfaces(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    sum_part(workgroup_number(group), i, DRAW_SURFACE | DRAW_FULL | DRAW_EDGES | DRAW_CLIPPED);
}

// Returns the sums, over all parts of a dense cell with the pairs `range`, of the pixel of invocation i.
fn sums_of_parts(range: vec2u, i: u32, drawn: u32) -> CellSums {
    var sums = no_cell_sums();
    for (var k = 0u; k < parts_of(range); k++) {
        let part = part_number(range, k);
        for (var c = 0u; c < 4u; c++) {
            sums.color[c] += part_f32(part, 3u + c, i, drawn);
            sums.surface[c] += part_f32(part, 7u + c, i, drawn);
            sums.material[c] += part_f32(part, 11u + c, i, drawn);
        }
        sums.fragments += part_f32(part, 15u, i, drawn);
        if has(drawn, DRAW_EDGES | DRAW_LAYERS) {
            sums.coverage += part_f32(part, 16u, i, drawn);
        }
        if has(drawn, DRAW_LAYERS) {
            sums.layer_coverage += part_f32(part, 19u, i, drawn);
        }
        if frame.nearest_at != ABSENT && !has(drawn, DRAW_BEHIND) {
            let z = part_f32(part, 17u, i, drawn);
            if z < sums.nearest_z {
                sums.nearest_z = z;
                sums.nearest = cell_parts[part_word(part, 18u, i, drawn)];
            }
        }
    }
    return sums;
}

// Draws a dense cell (column, row) from the sums of its parts. Does nothing for other cells.
fn combine_cell(cell: vec2u, i: u32, drawn: u32) {
    let range = pairs_of(cell);
    if !is_dense(range) {
        return;
    }
    var writer = vec2f(0.0, 0.0);
    if has(drawn, DRAW_EDGES) {
        writer = limit_by(maxima_of_parts(range, i, drawn), drawn).writer;
    }
    write_cell_pixel(cell * CELL_SIDE + pixel_in_cell(i), sums_of_parts(range, i, drawn), writer, drawn);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    combine_cell(cell.xy, i, DRAW_SURFACE);
}

// Draws dense cells from their parts, in an image with shadows or the shader `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine_shadowed(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    combine_cell(cell.xy, i, DRAW_SURFACE | DRAW_FULL);
}

// Draws dense cells from their parts, in an image with antialiased edges. The next entry point does so in an image with
// shadows or the shader `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine_edged(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    combine_cell(cell.xy, i, DRAW_SURFACE | DRAW_EDGES);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine_shadowed_edged(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    combine_cell(cell.xy, i, DRAW_SURFACE | DRAW_FULL | DRAW_EDGES);
}

// Find thresholds, sum attributes and combine the parts of dense cells whose pixels show one side of oriented splats,
// in frames of every kind: with clipped splats, shadows and antialiased edges or without.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_sided_thresholds(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let drawn = DRAW_SURFACE | DRAW_FULL | DRAW_SIDED | DRAW_EDGES | DRAW_CLIPPED;
    find_part_thresholds(workgroup_number(group), i, drawn);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_sided_surfaces(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let drawn = DRAW_SURFACE | DRAW_FULL | DRAW_SIDED | DRAW_EDGES | DRAW_CLIPPED;
    sum_part(workgroup_number(group), i, drawn);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine_sided(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    combine_cell(cell.xy, i, DRAW_SURFACE | DRAW_FULL | DRAW_SIDED | DRAW_EDGES);
}
