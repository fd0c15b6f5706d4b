// The last pass of the compute path: a workgroup draws a cell, an invocation each of its pixels. The cell's records pass
// through workgroup memory in batches, twice: the first loop finds the depth threshold, the second sums attributes up
// to it. Then the pixel is divided, lit and written from registers.

// Records of a batch.
const BATCH: u32 = 128u;
const BATCH_WORDS: u32 = 4u;
// Blocks of 8×4 pixels of a cell. Which records of a batch touch a block is found once for all of its pixels.
const BLOCK_COLUMNS: u32 = 8u;
const BLOCK_ROWS: u32 = 4u;
const CELL_BLOCKS: u32 = 8u;
// Parts of a record that are staged in workgroup memory.
const STAGED_PARTS: u32 = 7u;

// Part k of record r of the batch is at k·BATCH + r.
var<workgroup> staged: array<vec4u, 896>;
// The part of each record's box in the cell: first column and row, end column and row, five bits each.
var<workgroup> staged_boxes: array<u32, BATCH>;
// A bit for each record that touches a block, by block and word.
var<workgroup> block_bits: array<atomic<u32>, 32>;

fn staged_part(part: u32, r: u32) -> vec4u {
    return staged[part * BATCH + r];
}

// The pixel of invocation i of a cell: blocks of pixels are invocations that follow each other.
fn pixel_in_cell(i: u32) -> vec2u {
    let block = i / 32u;
    let in_block = i % 32u;
    return vec2u(
        (block % 2u) * BLOCK_COLUMNS + in_block % BLOCK_COLUMNS,
        (block / 2u) * BLOCK_ROWS + in_block / BLOCK_COLUMNS,
    );
}

// Stages the part of a record's box in a cell, and marks the blocks that it touches.
fn stage_box(corner: vec2u, pixels: vec2u, r: u32) {
    let first_px = max(vec2u(pixels.x & 0xffffu, pixels.x >> 16u), corner);
    let end_px = min(vec2u(pixels.y & 0xffffu, pixels.y >> 16u), corner + CELL_SIDE);
    if first_px.x >= end_px.x || first_px.y >= end_px.y {
        return;
    }
    let first = first_px - corner;
    let end = end_px - corner;
    staged_boxes[r] = first.x | (first.y << 5u) | (end.x << 10u) | (end.y << 15u);
    let size = vec2u(BLOCK_COLUMNS, BLOCK_ROWS);
    let first_block = first / size;
    let end_block = (end + (size - 1u)) / size;
    for (var row = first_block.y; row < end_block.y; row++) {
        for (var column = first_block.x; column < end_block.x; column++) {
            atomicOr(&block_bits[(row * 2u + column) * BATCH_WORDS + r / 32u], 1u << (r % 32u));
        }
    }
}

// True if the box of record r holds a pixel of the cell.
fn staged_box_holds(r: u32, in_cell: vec2u) -> bool {
    let box = staged_boxes[r];
    let first = vec2u(box & 31u, (box >> 5u) & 31u);
    let end = vec2u((box >> 10u) & 31u, box >> 15u);
    return all(first <= in_cell) && all(in_cell < end);
}

// Brings a batch into workgroup memory: what the first loop reads, or what the second does. Two invocations bring a
// record.
fn stage(first: u32, count: u32, corner: vec2u, i: u32, visible: bool, surface: bool) {
    let r = i / 2u;
    if r >= count {
        return;
    }
    let at = RECORD_PARTS * pairs_in[first + r].record;
    if i % 2u == 0u {
        let boxes = cell_records[at + 8u];
        stage_box(corner, select(boxes.zw, boxes.xy, visible), r);
        staged[r] = cell_records[at];
        staged[BATCH + r] = cell_records[at + 2u];
        staged[2u * BATCH + r] = cell_records[at + 3u];
    } else {
        staged[3u * BATCH + r] = cell_records[at + select(4u, 1u, visible)];
        staged[4u * BATCH + r] = cell_records[at + 5u];
        staged[5u * BATCH + r] = cell_records[at + 6u];
        if !visible && surface {
            staged[6u * BATCH + r] = cell_records[at + 7u];
        }
    }
}

// From the anchor of record r to the centre of a pixel.
fn staged_offset(r: u32, pixel: vec2i) -> vec2f {
    let anchor = staged_part(0u, r);
    let whole = pixel + frame.origin_px - bitcast<vec2i>(anchor.xy);
    return vec2f(whole) + (vec2f(0.5, 0.5) - bitcast<vec2f>(anchor.zw));
}

// Sums of a pixel.
struct CellSums {
    color: vec4f,
    surface: vec4f,
    material: vec4f,
    fragments: f32,
}

// Reversed depth z_near/(z + ε) of the unfiltered splat of record r at a pixel; 0 where it has no fragment.
fn threshold_of(r: u32, pixel: vec2i) -> f32 {
    let d = staged_offset(r, pixel);
    let plane = bitcast<vec4f>(staged_part(1u, r));
    let more = staged_part(2u, r);
    let range = bitcast<vec2f>(more.xy);
    let flags = more.w;
    let at_anchor = vec3f(bitcast<vec2f>(staged_part(4u, r).zw), bitcast<f32>(staged_part(5u, r).w));
    let uv = bitcast<vec4f>(staged_part(3u, r));
    let z = fragment_depth(d, vec4f(plane.xy, range), plane.z, at_anchor.z, flags);
    let is_there = is_in_unfiltered(d, uv, plane.xy, at_anchor, flags) && exists(z);
    return select(0.0, reversed_depth(z + plane.w), is_there);
}

// Adds what record r contributes to a pixel. `surface` is a compile-time constant: false leaves out normals and depths.
fn add_contribution(r: u32, pixel: vec2i, threshold: f32, surface: bool, sums: ptr<function, CellSums>) {
    let d = staged_offset(r, pixel);
    let plane = bitcast<vec4f>(staged_part(1u, r));
    let more = staged_part(2u, r);
    let range = bitcast<vec2f>(more.xy);
    let flags = more.w;
    let gradients = bitcast<vec4f>(staged_part(3u, r));
    let w_and_anchor = bitcast<vec4f>(staged_part(4u, r));
    let color_and_w = bitcast<vec4f>(staged_part(5u, r));
    let c = contribution_at(
        d,
        gradients,
        w_and_anchor.xy,
        vec3f(w_and_anchor.zw, color_and_w.w),
        vec4f(plane.xy, range),
        plane.z,
        flags,
        bitcast<f32>(more.z),
    );
    if !(c.is_there && threshold <= reversed_depth(c.z)) {
        return;
    }
    (*sums).color += vec4f(color_and_w.xyz, 1.0) * c.weight;
    if surface {
        let normal = bitcast<vec3f>(staged_part(6u, r).xyz);
        (*sums).surface += vec4f(normal, c.z * frame.per_depth_unit) * c.weight;
    }
    if frame.has_materials != 0u {
        (*sums).material += objects[flags >> RECORD_OBJECT].material * c.weight;
    }
    (*sums).fragments += 1.0;
}

// Draws a pixel of a cell. `surface` and `full` (see `shade`) are compile-time constants.
fn draw_cell(cell: vec2u, i: u32, surface: bool, full: bool) {
    let corner = cell * CELL_SIDE;
    let in_cell = pixel_in_cell(i);
    let own = corner + in_cell;
    let pixel = vec2i(own);
    let pairs = pairs_in[cell.y * frame.cell_columns + cell.x];
    let range = vec2u(pairs.cell, pairs.record);
    let words = (i / 32u) * BATCH_WORDS;
    var threshold = 0.0;
    for (var first = range.x; first < range.y; first += BATCH) {
        workgroupBarrier();
        if i < CELL_BLOCKS * BATCH_WORDS {
            atomicStore(&block_bits[i], 0u);
        }
        workgroupBarrier();
        stage(first, min(range.y - first, BATCH), corner, i, true, surface);
        workgroupBarrier();
        for (var word = 0u; word < BATCH_WORDS; word++) {
            var bits = atomicLoad(&block_bits[words + word]);
            while bits != 0u {
                let r = word * 32u + firstTrailingBit(bits);
                bits &= bits - 1u;
                if staged_box_holds(r, in_cell) {
                    threshold = max(threshold, threshold_of(r, pixel));
                }
            }
        }
    }
    let none = vec4f(0.0, 0.0, 0.0, 0.0);
    var sums = CellSums(none, none, none, 0.0);
    for (var first = range.x; first < range.y; first += BATCH) {
        workgroupBarrier();
        if i < CELL_BLOCKS * BATCH_WORDS {
            atomicStore(&block_bits[i], 0u);
        }
        workgroupBarrier();
        stage(first, min(range.y - first, BATCH), corner, i, false, surface);
        workgroupBarrier();
        for (var word = 0u; word < BATCH_WORDS; word++) {
            var bits = atomicLoad(&block_bits[words + word]);
            while bits != 0u {
                let r = word * 32u + firstTrailingBit(bits);
                bits &= bits - 1u;
                if staged_box_holds(r, in_cell) {
                    add_contribution(r, pixel, threshold, surface, &sums);
                }
            }
        }
    }
    if own.x < frame.size_px.x && own.y < frame.size_px.y {
        write_cell_pixel(own, sums, full);
    }
}

// Divides a pixel's sums by Σw, lights it, and writes its planes.
fn write_cell_pixel(own: vec2u, sums: CellSums, full: bool) {
    let pixel = vec2i(own);
    let point = point_of(sums.color, sums.surface, sums.material);
    if frame.surfaces_at != ABSENT {
        write_surface(own, point);
    }
    let shaded = own - frame.shade_origin_px;
    if own.x < frame.shade_origin_px.x || own.y < frame.shade_origin_px.y
        || shaded.x >= frame.shade_size_px.x || shaded.y >= frame.shade_size_px.y {
        return;
    }
    let at = shaded.y * frame.shade_size_px.x + shaded.x;
    if frame.color_at != ABSENT {
        var color = frame.background;
        if point.is_there {
            color = vec4f(color_of(position_at(pixel, point.z), point, full), 1.0);
        }
        write_color(at, color);
    }
    write_planes(at, Surface(vec3f(0.0, 0.0, 0.0), point.normal, point.z, point.weight, point.is_there));
    if frame.fragments_at != ABSENT {
        planes[frame.fragments_at + at] = sums.fragments;
    }
}

// Where passes look at neighbours, `planes` hold a surface of each pixel of the targets: its normal and depth.
fn write_surface(own: vec2u, point: Point) {
    let to = frame.surfaces_at + 4u * (own.y * frame.size_px.x + own.x);
    planes[to] = point.normal.x;
    planes[to + 1u] = point.normal.y;
    planes[to + 2u] = point.normal.z;
    planes[to + 3u] = select(frame.empty_depth, point.z, point.is_there);
}

// Draws cells of an image that has neither normals nor depths.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_colors(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, false, false);
}

// Draws cells.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, true, false);
}

// Draws cells of an image with shadows, or by `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_shadowed_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, true, true);
}

// Draws what depends on neighbours into the colours: outlines and eye-dome lighting.
@compute @workgroup_size(8, 8)
fn cell_neighbours(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.shade_size_px.x || id.y >= frame.shade_size_px.y {
        return;
    }
    let own = id.xy + frame.shade_origin_px;
    let at = frame.surfaces_at + 4u * (own.y * frame.size_px.x + own.x);
    let normal = vec3f(planes[at], planes[at + 1u], planes[at + 2u]);
    let z = planes[at + 3u];
    if !(z < frame.empty_depth) {
        return;
    }
    var share = 1.0;
    if frame.has_outlines != 0u {
        let surface = Surface(vec3f(0.0, 0.0, 0.0), normal, z, 0.0, true);
        share = select(1.0, 0.0, has_outline(vec2i(own), surface));
    }
    if frame.has_eye_dome != 0u {
        share *= eye_dome_shading(vec2i(own), z);
    }
    let to = frame.color_at + 4u * (id.y * frame.shade_size_px.x + id.x);
    planes[to] *= share;
    planes[to + 1u] *= share;
    planes[to + 2u] *= share;
}
