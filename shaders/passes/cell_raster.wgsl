// The last pass of the compute path. A workgroup draws a cell, one invocation per pixel. The cell's records pass
// through workgroup memory in batches, twice: the first loop finds the depth threshold, the second sums attributes up
// to it. Then the pixel's sums are divided by Σw, lit and written from registers.

// Records of a batch, and number of words with one bit per record.
const BATCH: u32 = 92u;
const BATCH_WORDS: u32 = 3u;
// Blocks of 8×4 pixels of a cell. For each block the records of a batch that touch it are found once for all of its
// pixels.
const BLOCK_COLUMNS: u32 = 8u;
const BLOCK_ROWS: u32 = 4u;
const CELL_BLOCKS: u32 = 8u;
// A splat is small if it touches at most this many pixels of the cell. Two invocations visit the pixels of a small
// splat. Larger ones are visited by the pixels of each block that they touch.
const SMALL_SPLAT_PX: u32 = 64u;
const IS_SMALL: u32 = 0x80000000u;

// Part k of record r of the batch is at k·BATCH + r; a record has seven parts.
var<workgroup> staged: array<vec4u, 644>;
// Intersection of each record's box and the cell, with IS_SMALL: first column and row, end column and row, five bits
// each. 0 if it is empty.
var<workgroup> staged_boxes: array<u32, BATCH>;
// One bit for each larger record that touches a block, by block and word; twice, for the current batch and the next.
var<workgroup> block_bits: array<atomic<u32>, 48>;
// One bit for each small record that contributes to a pixel, by word and pixel.
var<workgroup> pixel_bits: array<atomic<u32>, 768>;
// Depth threshold of each pixel as the bits of its reversed depth. The bits of positive floats compare like the floats.
var<workgroup> thresholds: array<atomic<u32>, CELL_WORKGROUP>;
// Only where sides of oriented splats are separated: in the first loop the nearness of back-facing splats, afterwards
// the side that each pixel shows.
var<workgroup> sides: array<atomic<u32>, CELL_WORKGROUP>;

fn staged_part(part: u32, r: u32) -> vec4u {
    return staged[part * BATCH + r];
}

// Returns the pixel of invocation i in a cell. The pixels of a block have consecutive invocations.
fn pixel_in_cell(i: u32) -> vec2u {
    let block = i / 32u;
    let in_block = i % 32u;
    return vec2u(
        (block % 2u) * BLOCK_COLUMNS + in_block % BLOCK_COLUMNS,
        (block / 2u) * BLOCK_ROWS + in_block / BLOCK_COLUMNS,
    );
}

// Returns the invocation of a pixel.
fn invocation_of(x: u32, y: u32) -> u32 {
    let block = (y / BLOCK_ROWS) * 2u + x / BLOCK_COLUMNS;
    return block * 32u + (y % BLOCK_ROWS) * BLOCK_COLUMNS + x % BLOCK_COLUMNS;
}

// Returns the intersection of a record's box and a cell, in the format of `staged_boxes`.
fn box_in_cell(corner: vec2u, pixels: vec2u) -> u32 {
    let first_px = max(vec2u(pixels.x & 0xffffu, pixels.x >> 16u), corner);
    let end_px = min(vec2u(pixels.y & 0xffffu, pixels.y >> 16u), corner + CELL_SIDE);
    if first_px.x >= end_px.x || first_px.y >= end_px.y {
        return 0u;
    }
    let first = first_px - corner;
    let end = end_px - corner;
    let size = end - first;
    let small = select(0u, IS_SMALL, size.x * size.y <= SMALL_SPLAT_PX);
    return first.x | (first.y << 5u) | (end.x << 10u) | (end.y << 15u) | small;
}

fn first_of(box: u32) -> vec2u {
    return vec2u(box & 31u, (box >> 5u) & 31u);
}

fn end_of(box: u32) -> vec2u {
    return vec2u((box >> 10u) & 31u, (box >> 15u) & 31u);
}

// Sets the bits of the blocks that a box touches.
fn mark_blocks(box: u32, r: u32, bits_at: u32) {
    let size = vec2u(BLOCK_COLUMNS, BLOCK_ROWS);
    let first_block = first_of(box) / size;
    let end_block = (end_of(box) + (size - 1u)) / size;
    for (var row = first_block.y; row < end_block.y; row++) {
        for (var column = first_block.x; column < end_block.x; column++) {
            atomicOr(&block_bits[bits_at + (row * 2u + column) * BATCH_WORDS + r / 32u], 1u << (r % 32u));
        }
    }
}

// True if the box of record r contains the pixel of the cell.
fn staged_box_holds(r: u32, in_cell: vec2u) -> bool {
    let box = staged_boxes[r];
    return all(first_of(box) <= in_cell) && all(in_cell < end_of(box));
}

// Copies a batch into workgroup memory, two invocations per record. `visible` selects the data of the first loop or of
// the second.
fn stage(first: u32, count: u32, corner: vec2u, i: u32, bits_at: u32, visible: bool, surface: bool) {
    let r = i / 2u;
    if r >= count {
        return;
    }
    let record = pairs_in[first + r].record;
    if i % 2u == 0u {
        let boxes = cell_records[part_at(8u, record)];
        let box = box_in_cell(corner, select(boxes.zw, boxes.xy, visible));
        staged_boxes[r] = box;
        if box != 0u && (box & IS_SMALL) == 0u {
            mark_blocks(box, r, bits_at);
        }
        staged[r] = cell_records[part_at(0u, record)];
        staged[BATCH + r] = cell_records[part_at(2u, record)];
        staged[2u * BATCH + r] = cell_records[part_at(3u, record)];
    } else {
        staged[3u * BATCH + r] = cell_records[part_at(select(4u, 1u, visible), record)];
        staged[4u * BATCH + r] = cell_records[part_at(5u, record)];
        staged[5u * BATCH + r] = cell_records[part_at(6u, record)];
        if !visible && surface {
            staged[6u * BATCH + r] = cell_records[part_at(7u, record)];
        }
    }
}

// A staged record in registers. Its gradients are those of the unfiltered (u·w, v·w) in the first loop and of the
// filtered one in the second.
struct CellRecord {
    base: vec2i,
    // Offset from the anchor to the centre of its pixel.
    to_center: vec2f,
    // Gradient and range of the depth form.
    depth: vec4f,
    scale: f32,
    epsilon: f32,
    weight_scale: f32,
    flags: u32,
    uv: vec4f,
    w: vec2f,
    at_anchor: vec3f,
}

fn staged_record(r: u32) -> CellRecord {
    let anchor = staged_part(0u, r);
    let plane = bitcast<vec4f>(staged_part(1u, r));
    let more = staged_part(2u, r);
    let w_and_anchor = bitcast<vec4f>(staged_part(4u, r));
    return CellRecord(
        bitcast<vec2i>(anchor.xy),
        vec2f(0.5, 0.5) - bitcast<vec2f>(anchor.zw),
        vec4f(plane.xy, bitcast<vec2f>(more.xy)),
        plane.z,
        plane.w,
        bitcast<f32>(more.z),
        more.w,
        bitcast<vec4f>(staged_part(3u, r)),
        w_and_anchor.xy,
        vec3f(w_and_anchor.zw, bitcast<f32>(staged_part(5u, r).w)),
    );
}

// Returns the offset from a record's anchor to the centre of a pixel.
fn offset_in(record: CellRecord, pixel: vec2i) -> vec2f {
    return vec2f(pixel + frame.origin_px - record.base) + record.to_center;
}

// Sums of a pixel.
struct CellSums {
    color: vec4f,
    surface: vec4f,
    material: vec4f,
    fragments: f32,
}

// Returns the depth of a record's unfiltered splat at a pixel; 0 if it has no fragment there.
fn visible_depth_of(record: CellRecord, pixel: vec2i) -> f32 {
    let d = offset_in(record, pixel);
    let z = fragment_depth(d, record.depth, record.scale, record.at_anchor.z, record.flags);
    let is_there = is_in_unfiltered(d, record.uv, record.depth.xy, record.at_anchor, record.flags) && exists(z);
    return select(0.0, z, is_there);
}

// Maxima of a pixel in the first loop, all reversed depths (rendering model §5): thresholds of splats without a side,
// of front-facing and of back-facing ones, and the nearness of the two sides. If sides aren't separated, only the first
// is used.
struct Maxima {
    threshold: f32,
    front: f32,
    back: f32,
    front_nearness: f32,
    back_nearness: f32,
}

// Returns the maxima of a record's fragment at depth z.
fn maxima_of(record: CellRecord, z: f32, sided: bool) -> Maxima {
    let threshold = reversed_depth(z + record.epsilon);
    let facing = record.flags & RECORD_FACING;
    if !sided || facing == 0u {
        return Maxima(threshold, 0.0, 0.0, 0.0, 0.0);
    }
    let is_back = facing == RECORD_BACK;
    let nearest = reversed_depth(nearness(z, record.epsilon, is_back));
    if is_back {
        return Maxima(0.0, 0.0, threshold, 0.0, nearest);
    }
    return Maxima(0.0, threshold, 0.0, nearest, 0.0);
}

// Raises the maxima of a pixel in workgroup memory. The maxima of sides use memory that otherwise only the second loop
// needs.
fn raise(at: u32, m: Maxima, sided: bool) {
    if m.threshold > 0.0 {
        atomicMax(&thresholds[at], bitcast<u32>(m.threshold));
    }
    if sided && m.front > 0.0 {
        atomicMax(&pixel_bits[at], bitcast<u32>(m.front));
        atomicMax(&pixel_bits[2u * CELL_WORKGROUP + at], bitcast<u32>(m.front_nearness));
    }
    if sided && m.back > 0.0 {
        atomicMax(&pixel_bits[CELL_WORKGROUP + at], bitcast<u32>(m.back));
        atomicMax(&sides[at], bitcast<u32>(m.back_nearness));
    }
}

fn greatest(a: Maxima, b: Maxima) -> Maxima {
    return Maxima(
        max(a.threshold, b.threshold),
        max(a.front, b.front),
        max(a.back, b.back),
        max(a.front_nearness, b.front_nearness),
        max(a.back_nearness, b.back_nearness),
    );
}

// True if a pixel that shows the side `shown` shows the record, too. 0 is no side.
fn shows_side(shown: u32, flags: u32) -> bool {
    let own = flags & RECORD_FACING;
    return own == 0u || shown == 0u || own == shown;
}

// Returns the contribution of a record to a pixel.
fn contribution_of(record: CellRecord, pixel: vec2i) -> Contribution {
    return contribution_at(
        offset_in(record, pixel),
        record.uv,
        record.w,
        record.at_anchor,
        record.depth,
        record.scale,
        record.flags,
        record.weight_scale,
    );
}

// True if a fragment is no deeper than the threshold.
fn is_within(threshold: f32, c: Contribution) -> bool {
    return c.is_there && threshold <= reversed_depth(c.z);
}

// Fragments that the second loop sums at a pixel: fragments up to a reversed depth and, if sides are separated, of one
// side.
struct CellLimit {
    threshold: f32,
    side: u32,
}

// Adds the contribution of record r to a pixel. `surface` is a compile-time constant: false omits normals and depths.
fn add_contribution(r: u32, pixel: vec2i, limit: CellLimit, surface: bool, sums: ptr<function, CellSums>) {
    let record = staged_record(r);
    let c = contribution_of(record, pixel);
    if !is_within(limit.threshold, c) || !shows_side(limit.side, record.flags) {
        return;
    }
    (*sums).color += vec4f(bitcast<vec3f>(staged_part(5u, r).xyz), 1.0) * c.weight;
    if surface {
        let normal = bitcast<vec3f>(staged_part(6u, r).xyz);
        (*sums).surface += vec4f(normal, c.z * frame.per_depth_unit) * c.weight;
    }
    if frame.has_materials != 0u {
        (*sums).material += objects[record.flags >> RECORD_OBJECT].material * c.weight;
    }
    (*sums).fragments += 1.0;
}

// Raises the thresholds of a small splat's pixels. Two invocations share the splat's rows.
fn raise_thresholds(r: u32, half: u32, corner: vec2u, sided: bool) {
    let box = staged_boxes[r];
    if (box & IS_SMALL) == 0u {
        return;
    }
    let first = first_of(box);
    let end = end_of(box);
    let record = staged_record(r);
    for (var y = first.y + half; y < end.y; y += 2u) {
        for (var x = first.x; x < end.x; x++) {
            let z = visible_depth_of(record, vec2i(corner + vec2u(x, y)));
            if z > 0.0 {
                raise(invocation_of(x, y), maxima_of(record, z, sided), sided);
            }
        }
    }
}

// Sets the bits of the pixels that a small splat contributes to.
fn mark_pixels(r: u32, half: u32, corner: vec2u, sided: bool) {
    let box = staged_boxes[r];
    if (box & IS_SMALL) == 0u {
        return;
    }
    let first = first_of(box);
    let end = end_of(box);
    let record = staged_record(r);
    for (var y = first.y + half; y < end.y; y += 2u) {
        for (var x = first.x; x < end.x; x++) {
            let at = invocation_of(x, y);
            let threshold = bitcast<f32>(atomicLoad(&thresholds[at]));
            var shown = true;
            if sided {
                shown = shows_side(atomicLoad(&sides[at]), record.flags);
            }
            if shown && is_within(threshold, contribution_of(record, vec2i(corner + vec2u(x, y)))) {
                atomicOr(&pixel_bits[(r / 32u) * CELL_WORKGROUP + at], 1u << (r % 32u));
            }
        }
    }
}

// Clears the memory that the loops over batches write. A barrier has to follow before any of it is read.
fn clear_cell(i: u32) {
    if i < 2u * CELL_BLOCKS * BATCH_WORDS {
        atomicStore(&block_bits[i], 0u);
    }
    atomicStore(&thresholds[i], 0u);
    for (var word = 0u; word < BATCH_WORDS; word++) {
        atomicStore(&pixel_bits[word * CELL_WORKGROUP + i], 0u);
    }
}

// The first loop: returns the limit of the invocation's pixel among the pairs of a range, and stores it in `thresholds`
// and `sides`. All bits are clear before and after. `sided` is a compile-time constant: true if sides are separated.
fn find_limit(range: vec2u, corner: vec2u, i: u32, sided: bool) -> CellLimit {
    let in_cell = pixel_in_cell(i);
    let pixel = vec2i(corner + in_cell);
    let words = (i / 32u) * BATCH_WORDS;
    let of_batch = CELL_BLOCKS * BATCH_WORDS;
    // Offset of the batch's bits. The bits of the next batch are in the other half, which is cleared meanwhile.
    var bits_at = 0u;
    var maxima = Maxima(0.0, 0.0, 0.0, 0.0, 0.0);
    if sided {
        atomicStore(&sides[i], 0u);
    }
    for (var first = range.x; first < range.y; first += BATCH) {
        let count = min(range.y - first, BATCH);
        workgroupBarrier();
        stage(first, count, corner, i, bits_at, true, false);
        workgroupBarrier();
        if i / 2u < count {
            raise_thresholds(i / 2u, i % 2u, corner, sided);
        }
        for (var word = 0u; word < BATCH_WORDS; word++) {
            var bits = atomicLoad(&block_bits[bits_at + words + word]);
            while bits != 0u {
                let r = word * 32u + firstTrailingBit(bits);
                bits &= bits - 1u;
                if staged_box_holds(r, in_cell) {
                    let record = staged_record(r);
                    let z = visible_depth_of(record, pixel);
                    if z > 0.0 {
                        maxima = greatest(maxima, maxima_of(record, z, sided));
                    }
                }
            }
        }
        bits_at = of_batch - bits_at;
        if i < of_batch {
            atomicStore(&block_bits[bits_at + i], 0u);
        }
    }
    raise(i, maxima, sided);
    workgroupBarrier();
    if i < 2u * of_batch {
        atomicStore(&block_bits[i], 0u);
    }
    var limit = CellLimit(bitcast<f32>(atomicLoad(&thresholds[i])), 0u);
    if sided {
        let front = bitcast<f32>(atomicExchange(&pixel_bits[i], 0u));
        let back = bitcast<f32>(atomicExchange(&pixel_bits[CELL_WORKGROUP + i], 0u));
        let front_nearness = bitcast<f32>(atomicExchange(&pixel_bits[2u * CELL_WORKGROUP + i], 0u));
        let back_nearness = bitcast<f32>(atomicLoad(&sides[i]));
        if front_nearness > 0.0 && back_nearness <= front_nearness {
            limit = CellLimit(max(limit.threshold, front), RECORD_FRONT);
        } else if back_nearness > 0.0 {
            limit = CellLimit(max(limit.threshold, back), RECORD_BACK);
        }
        if front_nearness > 0.0 && back_nearness > 0.0 {
            let near = frame.projection.near;
            let sheet = reversed_depth(sheet_limit(near / front_nearness, near / back_nearness));
            limit.threshold = max(limit.threshold, sheet);
        }
        atomicStore(&thresholds[i], bitcast<u32>(limit.threshold));
        atomicStore(&sides[i], limit.side);
    }
    return limit;
}

fn no_cell_sums() -> CellSums {
    let none = vec4f(0.0, 0.0, 0.0, 0.0);
    return CellSums(none, none, none, 0.0);
}

// The second loop: returns the sums of the invocation's pixel up to its limit, among the pairs of a range.
fn sum_pixel(range: vec2u, corner: vec2u, i: u32, limit: CellLimit, surface: bool, sided: bool) -> CellSums {
    let in_cell = pixel_in_cell(i);
    let pixel = vec2i(corner + in_cell);
    let words = (i / 32u) * BATCH_WORDS;
    let of_batch = CELL_BLOCKS * BATCH_WORDS;
    var bits_at = 0u;
    var sums = no_cell_sums();
    for (var first = range.x; first < range.y; first += BATCH) {
        let count = min(range.y - first, BATCH);
        workgroupBarrier();
        stage(first, count, corner, i, bits_at, false, surface);
        workgroupBarrier();
        if i / 2u < count {
            mark_pixels(i / 2u, i % 2u, corner, sided);
        }
        workgroupBarrier();
        for (var word = 0u; word < BATCH_WORDS; word++) {
            let of_blocks = atomicLoad(&block_bits[bits_at + words + word]);
            var bits = of_blocks | atomicExchange(&pixel_bits[word * CELL_WORKGROUP + i], 0u);
            while bits != 0u {
                let r = word * 32u + firstTrailingBit(bits);
                bits &= bits - 1u;
                if staged_box_holds(r, in_cell) {
                    add_contribution(r, pixel, limit, surface, &sums);
                }
            }
        }
        bits_at = of_batch - bits_at;
        if i < of_batch {
            atomicStore(&block_bits[bits_at + i], 0u);
        }
    }
    return sums;
}

// Returns the first pair of a cell, and one past its last.
fn pairs_of(cell: vec2u) -> vec2u {
    let pairs = pairs_in[cell.y * frame.cell_columns + cell.x];
    return vec2u(pairs.cell, pairs.record);
}

// Draws a cell, unless it is dense and sides aren't separated: dense cells are drawn in parts. `surface`, `full` (see
// `shade`) and `sided` are compile-time constants.
fn draw_cell(cell: vec2u, i: u32, surface: bool, full: bool, sided: bool) {
    let range = pairs_of(cell);
    if !sided && range.y - range.x > DENSE_PAIRS {
        return;
    }
    let corner = cell * CELL_SIDE;
    clear_cell(i);
    let limit = find_limit(range, corner, i, sided);
    let sums = sum_pixel(range, corner, i, limit, surface, sided);
    write_cell_pixel(corner + pixel_in_cell(i), sums, full);
}

// Divides a pixel's sums by Σw, lights it, and writes its planes.
fn write_cell_pixel(own: vec2u, sums: CellSums, full: bool) {
    if own.x >= frame.size_px.x || own.y >= frame.size_px.y {
        return;
    }
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

// Writes the normal and depth of a pixel of the targets, for the pass that reads its neighbours.
fn write_surface(own: vec2u, point: Point) {
    let to = frame.surfaces_at + 4u * (own.y * frame.size_px.x + own.x);
    planes[to] = point.normal.x;
    planes[to + 1u] = point.normal.y;
    planes[to + 2u] = point.normal.z;
    planes[to + 3u] = select(frame.empty_depth, point.z, point.is_there);
}

// Draws cells of an image without normals and depths.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_colors(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, false, false, false);
}

// Draws cells of an image with normals or depths.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, true, false, false);
}

// Draws cells of an image with shadows or the shader `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_shadowed_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, true, true, false);
}

// Draws cells whose pixels show one side of oriented splats.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_sided_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, true, false, true);
}

// Draws cells whose pixels show one side of oriented splats, in an image with shadows or the shader `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_sided_shadowed_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, true, true, true);
}

// Number of pairs above which a cell is dense. Dense cells are drawn in parts, each by its own workgroup, so that no
// workgroup's work grows with the number of splats. The parts are combined in order.
const DENSE_PAIRS: u32 = 4096u;
// Maximum number of pairs of a part. Within this many pairs two parts may begin: the last of one dense cell and the
// first of the next.
const PART_PAIRS: u32 = 2048u;
// Words of a part per pixel: its threshold, and sums of colours, surface, material and fragments.
const PART_WORDS: u32 = 14u;

// Word k of pixel i of a part is at (part·PART_WORDS + k)·CELL_WORKGROUP + i.
@group(1) @binding(54) var<storage, read_write> cell_parts_out: array<f32>;
@group(1) @binding(55) var<storage, read> cell_parts: array<f32>;

// A part: its cell and its range of pairs, which is empty if the part doesn't exist.
struct CellPart {
    cell: u32,
    range: vec2u,
}

// Returns the part with this number. Let b be a block of PART_PAIRS pairs. Part 2b + 1 belongs to a dense cell whose
// pairs begin in the block, part 2b to one whose pairs begin before it.
fn part_of(number: u32) -> CellPart {
    let count = pair_count();
    let begin = (number / 2u) * PART_PAIRS;
    if begin >= count {
        return CellPart(0u, vec2u(0u, 0u));
    }
    let first = frame.cell_count + begin;
    let end = frame.cell_count + min(begin + PART_PAIRS, count);
    let begins_here = number % 2u == 1u;
    let cell = pairs_in[select(first, end - 1u, begins_here)].cell;
    let of_cell = pairs_in[cell];
    let is_dense = of_cell.record - of_cell.cell > DENSE_PAIRS;
    if !is_dense || (of_cell.cell >= first) != begins_here {
        return CellPart(0u, vec2u(0u, 0u));
    }
    return CellPart(cell, vec2u(max(of_cell.cell, first), min(of_cell.record, end)));
}

// Returns the number of the k-th part of a dense cell with the pairs `range`.
fn part_number(range: vec2u, k: u32) -> u32 {
    let block = (range.x - frame.cell_count) / PART_PAIRS;
    return 2u * (block + k) + select(0u, 1u, k == 0u);
}

fn parts_of(range: vec2u) -> u32 {
    return (range.y - 1u - frame.cell_count) / PART_PAIRS - (range.x - frame.cell_count) / PART_PAIRS + 1u;
}

fn part_word(part: u32, k: u32, i: u32) -> u32 {
    return (part * PART_WORDS + k) * CELL_WORKGROUP + i;
}

fn corner_of_cell(cell: u32) -> vec2u {
    return vec2u(cell % frame.cell_columns, cell / frame.cell_columns) * CELL_SIDE;
}

// Finds the depth thresholds of parts.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_thresholds(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    let number = workgroup_number(group);
    let part = part_of(number);
    if part.range.x == part.range.y {
        return;
    }
    clear_cell(i);
    cell_parts_out[part_word(number, 0u, i)] = find_limit(part.range, corner_of_cell(part.cell), i, false).threshold;
}

// Sums the contributions of a part, up to the threshold of all parts of its cell.
fn sum_part(number: u32, i: u32, surface: bool) {
    let part = part_of(number);
    if part.range.x == part.range.y {
        return;
    }
    let of_cell = vec2u(pairs_in[part.cell].cell, pairs_in[part.cell].record);
    var threshold = 0.0;
    for (var k = 0u; k < parts_of(of_cell); k++) {
        threshold = max(threshold, cell_parts_out[part_word(part_number(of_cell, k), 0u, i)]);
    }
    clear_cell(i);
    workgroupBarrier();
    atomicStore(&thresholds[i], bitcast<u32>(threshold));
    let sums = sum_pixel(part.range, corner_of_cell(part.cell), i, CellLimit(threshold, 0u), surface, false);
    for (var k = 0u; k < 4u; k++) {
        cell_parts_out[part_word(number, 1u + k, i)] = sums.color[k];
        cell_parts_out[part_word(number, 5u + k, i)] = sums.surface[k];
        cell_parts_out[part_word(number, 9u + k, i)] = sums.material[k];
    }
    cell_parts_out[part_word(number, 13u, i)] = sums.fragments;
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_colors(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    sum_part(workgroup_number(group), i, false);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_part_surfaces(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) i: u32) {
    sum_part(workgroup_number(group), i, true);
}

// Draws a dense cell from its parts.
fn combine_cell(cell: vec2u, i: u32, full: bool) {
    let range = pairs_of(cell);
    if range.y - range.x <= DENSE_PAIRS {
        return;
    }
    var sums = no_cell_sums();
    for (var k = 0u; k < parts_of(range); k++) {
        let part = part_number(range, k);
        for (var c = 0u; c < 4u; c++) {
            sums.color[c] += cell_parts[part_word(part, 1u + c, i)];
            sums.surface[c] += cell_parts[part_word(part, 5u + c, i)];
            sums.material[c] += cell_parts[part_word(part, 9u + c, i)];
        }
        sums.fragments += cell_parts[part_word(part, 13u, i)];
    }
    write_cell_pixel(cell * CELL_SIDE + pixel_in_cell(i), sums, full);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    combine_cell(cell.xy, i, false);
}

// Draws dense cells from their parts, in an image with shadows or the shader `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_combine_shadowed(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    combine_cell(cell.xy, i, true);
}

// Returns the depth of the surface at a pixel of the targets, from `planes`. `front_depth`, which shading and host
// targets use, reads textures: another buffer would exceed WebGPU's core limits there.
fn cell_depth(pixel: vec2i) -> f32 {
    return planes[frame.surfaces_at + 4u * (u32(pixel.y) * frame.size_px.x + u32(pixel.x)) + 3u];
}

// Like `has_outline`, from the depths in `planes`.
fn has_cell_outline(pixel: vec2i, surface: Surface) -> bool {
    let limit = outline_limit(pixel, surface, frame.projection);
    let last = vec2i(frame.size_px) - 1;
    var line = false;
    for (var y = max(pixel.y - 1, 0); y <= min(pixel.y + 1, last.y); y++) {
        for (var x = max(pixel.x - 1, 0); x <= min(pixel.x + 1, last.x); x++) {
            line = line || cell_depth(vec2i(x, y)) > limit;
        }
    }
    return line;
}

// Like `eye_dome_shading`, from the depths in `planes`.
fn cell_eye_dome_shading(pixel: vec2i, z: f32) -> f32 {
    let last = vec2i(frame.size_px) - 1;
    var rise = 0.0;
    for (var j = -1; j <= 1; j++) {
        for (var i = -1; i <= 1; i++) {
            let offset = vec2i(i, j) * EYE_DOME_REACH;
            let at = pixel + offset;
            if (i == 0 && j == 0) || at.x < 0 || at.y < 0 || at.x > last.x || at.y > last.y {
                continue;
            }
            rise += eye_dome_rise(offset, z, cell_depth(at));
        }
    }
    return eye_dome_brightness(z, rise, frame.projection);
}

// Applies outlines and eye-dome lighting, which depend on neighbouring pixels, to the colours.
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
        share = select(1.0, 0.0, has_cell_outline(vec2i(own), surface));
    }
    if frame.has_eye_dome != 0u {
        share *= cell_eye_dome_shading(vec2i(own), z);
    }
    let to = frame.color_at + 4u * (id.y * frame.shade_size_px.x + id.x);
    planes[to] *= share;
    planes[to + 1u] *= share;
    planes[to + 2u] *= share;
}
