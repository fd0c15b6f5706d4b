// Drawing of cells' lists in the compute path. A workgroup draws a cell, one invocation per pixel. The cell's records
// pass through workgroup memory in batches, twice. The first loop finds the depth threshold of each pixel, the second
// sums attributes up to it. Then the pixel's sums are divided by Σw, lit and written from registers. Cells and records
// are defined in cells.wgsl.

// Number of records of a batch, which a workgroup reads at a time.
const BATCH: u32 = 92u;
// Number of 32-bit words that have one bit for each record of a batch.
const BATCH_WORDS: u32 = 3u;
// Size of a block, 8×4 pixels of a cell. The records of a batch that touch a block are found once for all of its
// pixels.
const BLOCK_COLUMNS: u32 = 8u;
const BLOCK_ROWS: u32 = 4u;
// Number of blocks of a cell.
const CELL_BLOCKS: u32 = 8u;
// Largest number of pixels of a cell that the box of a small splat contains. Two invocations visit the pixels of a
// small splat. Larger splats are visited by the pixels of each block that they touch.
const SMALL_SPLAT_PX: u32 = 64u;
// Bit of `staged_boxes` that marks a small splat.
const IS_SMALL: u32 = 0x80000000u;

// Records of the batch: part k of record r is at k·BATCH + r. The seven parts are those that `stage` copies, in another
// order than in `cell_records`.
var<workgroup> staged: array<vec4u, 644>;
// Intersection of each record's box and the cell, relative to the cell: first column and row, end column and row, five
// bits each from bit 0 on. IS_SMALL marks small splats. 0 if the intersection is empty.
var<workgroup> staged_boxes: array<u32, BATCH>;
// One bit for each larger record of the batch that touches a block: word w of block b is at b·BATCH_WORDS + w. The
// memory exists twice, for the current batch and the next.
var<workgroup> block_bits: array<atomic<u32>, 48>;
// One bit for each small record of the batch that contributes to a pixel: word w of the pixel of invocation i is at
// w·CELL_WORKGROUP + i. The first loop of a layer uses word 0 for the reversed depth of the pixel's opaque surface.
var<workgroup> pixel_bits: array<atomic<u32>, 768>;
// Depth threshold of each pixel as the bits of its reversed depth, by invocation. The bits of positive floats compare
// like the floats.
var<workgroup> thresholds: array<atomic<u32>, CELL_WORKGROUP>;
// By invocation, if the sides of oriented splats are separated: in the first loop the nearness of back-facing splats as
// the bits of a reversed depth, afterwards the side that each pixel shows (RECORD_FRONT, RECORD_BACK or 0). In the edge
// pass: the bits of the reversed depth of each pixel's nearest surface, or 0. In a layer: those of the last layer's
// threshold, or of the opaque surface.
var<workgroup> sides: array<atomic<u32>, CELL_WORKGROUP>;

// Flags of what a pass draws, compile-time constants of its entry point. DRAW_SURFACE: sum normals and depths.
// DRAW_FULL: shade with all effects (see `shade`). DRAW_SIDED: separate the sides of oriented splats. DRAW_EDGES: find
// the splat that defines each pixel's threshold, and sum coverage. DRAW_BEHIND: draw only fragments behind the depths
// in `sides`. DRAW_CLIPPED: records may have clips. DRAW_LAYERS: draw a layer of transparent splats, only fragments
// behind the depths in `sides` and not behind the opaque surface. Without this flag only opaque splats are drawn.
const DRAW_SURFACE: u32 = 1u;
const DRAW_FULL: u32 = 2u;
const DRAW_SIDED: u32 = 4u;
const DRAW_EDGES: u32 = 8u;
const DRAW_BEHIND: u32 = 16u;
const DRAW_CLIPPED: u32 = 32u;
const DRAW_LAYERS: u32 = 64u;

// True if what a pass draws includes any of the flags DRAW_….
fn has(drawn: u32, flags: u32) -> bool {
    return (drawn & flags) != 0u;
}

// Returns a part of record r of the batch.
fn staged_part(part: u32, r: u32) -> vec4u {
    return staged[part * BATCH + r];
}

// Returns the pixel of invocation i, relative to its cell. The pixels of a block have consecutive invocations.
fn pixel_in_cell(i: u32) -> vec2u {
    let block = i / 32u;
    let in_block = i % 32u;
    return vec2u(
        (block % 2u) * BLOCK_COLUMNS + in_block % BLOCK_COLUMNS,
        (block / 2u) * BLOCK_ROWS + in_block / BLOCK_COLUMNS,
    );
}

// Returns the invocation of the pixel in column x and row y of its cell.
fn invocation_of(x: u32, y: u32) -> u32 {
    let block = (y / BLOCK_ROWS) * 2u + x / BLOCK_COLUMNS;
    return block * 32u + (y % BLOCK_ROWS) * BLOCK_COLUMNS + x % BLOCK_COLUMNS;
}

// Returns the intersection of a record's box and the cell whose first pixel is `corner`, in the format of
// `staged_boxes`. `pixels` is the box in the format of Record.visible_box.
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

// Returns the first column and row of a box in the format of `staged_boxes`.
fn first_of(box: u32) -> vec2u {
    return vec2u(box & 31u, (box >> 5u) & 31u);
}

// Returns the column and row after the last ones of a box in the format of `staged_boxes`.
fn end_of(box: u32) -> vec2u {
    return vec2u((box >> 10u) & 31u, (box >> 15u) & 31u);
}

// Sets the bit of record r in each block that its box touches. `bits_at` is the index of the batch's first word in
// `block_bits`.
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

// True if the box of record r of the batch contains the pixel `in_cell`, relative to the cell.
fn staged_box_holds(r: u32, in_cell: vec2u) -> bool {
    let box = staged_boxes[r];
    return all(first_of(box) <= in_cell) && all(in_cell < end_of(box));
}

// Copies a batch, the records of `count` pairs from index `first` on, into workgroup memory. Two invocations copy a
// record. `visible` is true for the unfiltered footprints of the first loop, false for the filtered ones of the second.
// If `is_lit`, colours are those that `cell_light` wrote, and weights are multiplied by alpha, for the last layer. The
// boxes of records that the pass doesn't draw are empty.
fn stage(first: u32, count: u32, corner: vec2u, i: u32, bits_at: u32, visible: bool, drawn: u32, is_lit: bool) {
    let r = i / 2u;
    if r >= count {
        return;
    }
    let record = cell_lists[first + r];
    if i % 2u == 0u {
        let boxes = cell_records[part_at(8u, record)];
        var more = cell_records[part_at(3u, record)];
        var box = box_in_cell(corner, select(boxes.zw, boxes.xy, visible));
        if ((more.w & RECORD_LAYERED) != 0u) != has(drawn, DRAW_LAYERS) {
            box = 0u;
        }
        if is_lit {
            more.z = bitcast<u32>(bitcast<f32>(more.z) * bitcast<f32>(cell_records[part_at(7u, record)].w));
        }
        staged_boxes[r] = box;
        if box != 0u && (box & IS_SMALL) == 0u {
            mark_blocks(box, r, bits_at);
        }
        staged[r] = cell_records[part_at(0u, record)];
        staged[BATCH + r] = cell_records[part_at(2u, record)];
        staged[2u * BATCH + r] = more;
    } else {
        staged[3u * BATCH + r] = cell_records[part_at(select(4u, 1u, visible), record)];
        staged[4u * BATCH + r] = cell_records[part_at(5u, record)];
        var colors = cell_records[part_at(6u, record)];
        if is_lit {
            colors = vec4u(cell_records[part_at(RECORD_PLACE, record)].yzw, colors.w);
        }
        staged[5u * BATCH + r] = colors;
        if !visible && has(drawn, DRAW_SURFACE | DRAW_EDGES) {
            staged[6u * BATCH + r] = cell_records[part_at(7u, record)];
        }
    }
}

// A record of the batch in registers; see Record for the fields. `uv` and `w` are the gradients of the unfiltered (u·w,
// v·w) in the first loop, and of the filtered (u·w, v·w) and w in the second.
struct CellRecord {
    base: vec2i,
    // Offset, in pixels, from the anchor to the centre of the pixel `base`.
    to_center: vec2f,
    // Gradient and range of the depth form.
    depth: vec4f,
    scale: f32,
    epsilon: f32,
    weight_scale: f32,
    // Factor of the coverage in an A-buffer.
    coverage_scale: f32,
    flags: u32,
    uv: vec4f,
    w: vec2f,
    at_anchor: vec3f,
    // Index of the record if it has clips, otherwise ABSENT.
    clipped: u32,
}

// Returns record r of the batch whose first pair has the index `batch`.
fn staged_record(batch: u32, r: u32, drawn: u32) -> CellRecord {
    let anchor = staged_part(0u, r);
    let plane = bitcast<vec4f>(staged_part(1u, r));
    let more = staged_part(2u, r);
    let w_and_anchor = bitcast<vec4f>(staged_part(4u, r));
    var weight_scale = bitcast<f32>(more.z);
    var coverage_scale = 1.0;
    if has(drawn, DRAW_LAYERS) && frame.has_abuffer != 0u && scale_is_coverage() {
        coverage_scale = weight_scale;
        weight_scale = 1.0;
    }
    var clipped = ABSENT;
    if has(drawn, DRAW_CLIPPED) && (more.w & RECORD_CLIPPED) != 0u {
        clipped = cell_lists[batch + r];
    }
    return CellRecord(
        bitcast<vec2i>(anchor.xy),
        vec2f(0.5, 0.5) - bitcast<vec2f>(anchor.zw),
        vec4f(plane.xy, bitcast<vec2f>(more.xy)),
        plane.z,
        plane.w,
        weight_scale,
        coverage_scale,
        more.w,
        bitcast<vec4f>(staged_part(3u, r)),
        w_and_anchor.xy,
        vec3f(w_and_anchor.zw, bitcast<f32>(staged_part(5u, r).w)),
        clipped,
    );
}

// Returns the offset, in pixels, from a record's anchor to the centre of a pixel of the targets.
fn offset_in(record: CellRecord, pixel: vec2i) -> vec2f {
    return vec2f(pixel + frame.origin_px - record.base) + record.to_center;
}

// Sums of a pixel, as in the attribute pass: w·(colour, 1), w·(normal, z), w·(material factors), and number of
// fragments.
struct CellSums {
    color: vec4f,
    surface: vec4f,
    material: vec4f,
    fragments: f32,
    // Sum of coverage, only for edges. In a layer the sum of w·alpha.
    coverage: f32,
    // In a layer of an A-buffer, its coverage.
    layer_coverage: f32,
    // Depth and record of the nearest fragment. They are only found if the plane of nearest splats is requested; +∞ and
    // 0 otherwise.
    nearest_z: f32,
    nearest: u32,
}

// Returns the first three words of a part as a form.
fn cell_clip_form(words: vec4u) -> Linear {
    let form = bitcast<vec4f>(words);
    return Linear(form.x, form.y, form.z);
}

// Reads the clip of a record that `write_clip` wrote into its parts from number `part` on.
fn cell_clip(record: u32, part: u32) -> Clip {
    let chord = cell_records[part_at(part, record)];
    let side1 = cell_records[part_at(part + 1u, record)];
    let side3 = cell_records[part_at(part + 2u, record)];
    let line0 = cell_records[part_at(part + 3u, record)];
    let line1 = cell_records[part_at(part + 4u, record)];
    let line2 = cell_records[part_at(part + 5u, record)];
    let lines = array<Linear, 4>(
        cell_clip_form(line0),
        cell_clip_form(line1),
        cell_clip_form(line2),
        cell_clip_form(vec4u(side3.w, line0.w, line1.w, 0u)),
    );
    return Clip(
        cell_clip_form(chord),
        cell_clip_form(side1),
        cell_clip_form(side3),
        bitcast<f32>(chord.w),
        lines,
        bitcast<f32>(side1.w),
    );
}

// True if the clip of a record keeps its unfiltered footprint at pixel offset d from the anchor.
fn cell_clip_keeps_visible(record: CellRecord, d: vec2f) -> bool {
    return record.clipped == ABSENT || clip_keeps(cell_clip(record.clipped, CLIP_PART), d);
}

// True if the clips of a record keep its filtered footprint at pixel offset d from the anchor, like
// `clip_keeps_filtered`.
fn cell_clip_keeps_filtered(record: CellRecord, d: vec2f) -> bool {
    if record.clipped == ABSENT {
        return true;
    }
    // If w ≤ 0, which only happens with `clamp`, the clip is evaluated at the centre.
    let at = select(vec2f(0.0, 0.0), d, 0.0 < form_at(record.w, d, record.at_anchor.z));
    if clip_keeps(cell_clip(record.clipped, CLIP_PART + CLIP_PARTS), at) {
        return true;
    }
    if objects[record.flags >> RECORD_OBJECT].oriented == 0u {
        return false;
    }
    let uv = bitcast<vec4f>(cell_records[part_at(1u, record.clipped)]);
    return is_in_unfiltered(d, uv, record.depth.xy, record.at_anchor, record.flags)
        && clip_keeps(cell_clip(record.clipped, CLIP_PART), d);
}

// Returns the depth of a record's unfiltered splat at a pixel of the targets; 0 if it has no fragment there.
fn visible_depth_of(record: CellRecord, pixel: vec2i) -> f32 {
    let d = offset_in(record, pixel);
    let z = fragment_depth(d, record.depth, record.scale, record.at_anchor.z, record.flags);
    let is_inside = is_in_unfiltered(d, record.uv, record.depth.xy, record.at_anchor, record.flags);
    return select(0.0, z, is_inside && exists(z) && cell_clip_keeps_visible(record, d));
}

// Maxima over the fragments of a pixel in the first loop (rendering model §5): thresholds of splats without a side, of
// front-facing and of back-facing ones, and the nearness of the two sides. All are reversed depths, so that a maximum
// is the nearest depth; 0 without a fragment. If sides aren't separated, only `threshold` is used.
struct Maxima {
    threshold: f32,
    front: f32,
    back: f32,
    front_nearness: f32,
    back_nearness: f32,
}

// Returns the maxima of a single fragment, a record's at depth z. `sided` is true if sides are separated.
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

// Raises the maxima of the pixel of invocation `at` in workgroup memory to those of a fragment. The maxima of sides use
// memory that otherwise only the second loop needs.
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

// Returns the larger of each of two maxima.
fn greatest(a: Maxima, b: Maxima) -> Maxima {
    return Maxima(
        max(a.threshold, b.threshold),
        max(a.front, b.front),
        max(a.back, b.back),
        max(a.front_nearness, b.front_nearness),
        max(a.back_nearness, b.back_nearness),
    );
}

// True if a pixel that shows the side `shown` (RECORD_FRONT or RECORD_BACK, 0 for no side) also shows splats with these
// record flags.
fn shows_side(shown: u32, flags: u32) -> bool {
    let own = flags & RECORD_FACING;
    return own == 0u || shown == 0u || own == shown;
}

// Returns the contribution of a record to a pixel of the targets.
fn contribution_of(record: CellRecord, pixel: vec2i) -> Contribution {
    let d = offset_in(record, pixel);
    var found = contribution_at(
        d,
        record.uv,
        record.w,
        record.at_anchor,
        record.depth,
        record.scale,
        record.flags,
        record.weight_scale,
    );
    found.is_there = found.is_there && cell_clip_keeps_filtered(record, d);
    return found;
}

// True if a contribution exists and is no deeper than a threshold, given as a reversed depth.
fn is_within(threshold: f32, c: Contribution) -> bool {
    return c.is_there && threshold <= reversed_depth(c.z);
}

// Limit of the fragments that the second loop sums at a pixel: a depth threshold, as a reversed depth, and the side
// that the pixel shows (RECORD_FRONT, RECORD_BACK or 0) if sides are separated.
struct CellLimit {
    threshold: f32,
    side: u32,
    // The z + ε and the ε of the splat that defines the threshold, or zeros. They are only found for edges.
    writer: vec2f,
}

// True if a pass draws fragments at depth z in the pixel of invocation `at`: in the edge pass those behind the pixel's
// nearest surface, in a layer those behind the layers before it, and in other passes all.
fn is_behind(at: u32, z: f32, drawn: u32) -> bool {
    return !has(drawn, DRAW_BEHIND | DRAW_LAYERS) || reversed_depth(z) < bitcast<f32>(atomicLoad(&sides[at]));
}

// True if a fragment at depth z takes part in the first loop: like `is_behind`, and in a layer not behind the opaque
// surface. In the second loop, the threshold of a layer is at least as near as the opaque surface. For edges of the
// nearest layer, `sides` is the depth of the opaque surface.
fn is_open(at: u32, z: f32, drawn: u32) -> bool {
    if has(drawn, DRAW_LAYERS) && has(drawn, DRAW_EDGES) {
        return bitcast<f32>(atomicLoad(&sides[at])) <= reversed_depth(z);
    }
    if !is_behind(at, z, drawn) {
        return false;
    }
    return !has(drawn, DRAW_LAYERS) || bitcast<f32>(atomicLoad(&pixel_bits[at])) <= reversed_depth(z);
}

// Adds the contribution of record r of the batch whose first pair has the index `first` to the sums of a pixel, that of
// invocation i, if the contribution is within the pixel's limit.
fn add_contribution(
    first: u32,
    r: u32,
    pixel: vec2i,
    i: u32,
    limit: CellLimit,
    drawn: u32,
    sums: ptr<function, CellSums>,
) {
    let record = staged_record(first, r, drawn);
    let c = contribution_of(record, pixel);
    if !is_within(limit.threshold, c) || !shows_side(limit.side, record.flags) {
        return;
    }
    if !is_behind(i, c.z, drawn) {
        return;
    }
    (*sums).color += vec4f(bitcast<vec3f>(staged_part(5u, r).xyz), 1.0) * c.weight;
    if has(drawn, DRAW_SURFACE) {
        let normal = bitcast<vec3f>(staged_part(6u, r).xyz);
        (*sums).surface += vec4f(normal, c.z * frame.per_depth_unit) * c.weight;
    }
    if has(drawn, DRAW_EDGES | DRAW_LAYERS) {
        (*sums).coverage += bitcast<f32>(staged_part(6u, r).w) * c.weight;
    }
    if has(drawn, DRAW_LAYERS) {
        let object = record.flags >> RECORD_OBJECT;
        (*sums).layer_coverage += c.weight * record.coverage_scale * objects[object].coverage;
    }
    if frame.has_materials != 0u {
        (*sums).material += objects[record.flags >> RECORD_OBJECT].material * c.weight;
    }
    (*sums).fragments += 1.0;
    if frame.nearest_at != ABSENT && !has(drawn, DRAW_BEHIND) && c.z < (*sums).nearest_z {
        (*sums).nearest_z = c.z;
        (*sums).nearest = cell_lists[first + r];
    }
}

// Raises the maxima of the pixels of a small splat, record r of the batch whose first pair has the index `batch`.
// `corner` is the first pixel of the cell. Two invocations share the splat's rows: `half` is 0 or 1.
fn raise_thresholds(batch: u32, r: u32, half: u32, corner: vec2u, drawn: u32) {
    let box = staged_boxes[r];
    if (box & IS_SMALL) == 0u {
        return;
    }
    let first = first_of(box);
    let end = end_of(box);
    let record = staged_record(batch, r, drawn);
    for (var y = first.y + half; y < end.y; y += 2u) {
        for (var x = first.x; x < end.x; x++) {
            let z = visible_depth_of(record, vec2i(corner + vec2u(x, y)));
            let at = invocation_of(x, y);
            if z > 0.0 && is_open(at, z, drawn) {
                raise(at, maxima_of(record, z, has(drawn, DRAW_SIDED)), has(drawn, DRAW_SIDED));
            }
        }
    }
}

// Sets the bit of a small splat at the pixels whose threshold the splat may define. These are the pixels at which it is
// visible and, unless sides are separated, raises the threshold. Parameters are those of `raise_thresholds`.
//
// Whatever the order of execution, splats that define the final threshold have their bits set. Bits of other splats
// depend on the order, and change no result: the pixel finds that those splats don't define its threshold.
fn mark_raised_pixels(batch: u32, r: u32, half: u32, corner: vec2u, drawn: u32) {
    let box = staged_boxes[r];
    if (box & IS_SMALL) == 0u {
        return;
    }
    let first = first_of(box);
    let end = end_of(box);
    let record = staged_record(batch, r, drawn);
    for (var y = first.y + half; y < end.y; y += 2u) {
        for (var x = first.x; x < end.x; x++) {
            let z = visible_depth_of(record, vec2i(corner + vec2u(x, y)));
            let at = invocation_of(x, y);
            if z > 0.0 && is_open(at, z, drawn) {
                var is_raised = true;
                if !has(drawn, DRAW_SIDED) {
                    let threshold = bitcast<u32>(reversed_depth(z + record.epsilon));
                    is_raised = atomicMax(&thresholds[at], threshold) <= threshold;
                }
                if is_raised {
                    atomicOr(&pixel_bits[(r / 32u) * CELL_WORKGROUP + at], 1u << (r % 32u));
                }
            }
        }
    }
}

// Sets the bit of a small splat at the pixels that it contributes to. Parameters are those of `raise_thresholds`.
fn mark_pixels(batch: u32, r: u32, half: u32, corner: vec2u, drawn: u32) {
    let box = staged_boxes[r];
    if (box & IS_SMALL) == 0u {
        return;
    }
    let first = first_of(box);
    let end = end_of(box);
    let record = staged_record(batch, r, drawn);
    for (var y = first.y + half; y < end.y; y += 2u) {
        for (var x = first.x; x < end.x; x++) {
            let at = invocation_of(x, y);
            let threshold = bitcast<f32>(atomicLoad(&thresholds[at]));
            var shown = true;
            if has(drawn, DRAW_SIDED) {
                shown = shows_side(atomicLoad(&sides[at]), record.flags);
            }
            let c = contribution_of(record, vec2i(corner + vec2u(x, y)));
            if shown && is_within(threshold, c) && is_behind(at, c.z, drawn) {
                atomicOr(&pixel_bits[(r / 32u) * CELL_WORKGROUP + at], 1u << (r % 32u));
            }
        }
    }
}

// Clears the workgroup memory that the loops over batches write; i is the invocation. A barrier has to follow before
// any of the memory is read.
fn clear_cell(i: u32) {
    if i < 2u * CELL_BLOCKS * BATCH_WORDS {
        atomicStore(&block_bits[i], 0u);
    }
    atomicStore(&thresholds[i], 0u);
    for (var word = 0u; word < BATCH_WORDS; word++) {
        atomicStore(&pixel_bits[word * CELL_WORKGROUP + i], 0u);
    }
}

// Runs the first loop: returns the maxima of the pixel of invocation i among the pairs whose indices are in `range`.
// All bits of records are clear before and after.
fn find_maxima(range: vec2u, corner: vec2u, i: u32, drawn: u32) -> Maxima {
    let sided = has(drawn, DRAW_SIDED);
    let in_cell = pixel_in_cell(i);
    let pixel = vec2i(corner + in_cell);
    let words = (i / 32u) * BATCH_WORDS;
    let of_batch = CELL_BLOCKS * BATCH_WORDS;
    // Index of the batch's first word in `block_bits`. The bits of the next batch are in the other half, which is
    // cleared meanwhile.
    var bits_at = 0u;
    var maxima = Maxima(0.0, 0.0, 0.0, 0.0, 0.0);
    if sided {
        atomicStore(&sides[i], 0u);
    }
    for (var first = range.x; first < range.y; first += BATCH) {
        let count = min(range.y - first, BATCH);
        workgroupBarrier();
        stage(first, count, corner, i, bits_at, true, drawn, false);
        workgroupBarrier();
        if i / 2u < count {
            raise_thresholds(first, i / 2u, i % 2u, corner, drawn);
        }
        for (var word = 0u; word < BATCH_WORDS; word++) {
            var bits = atomicLoad(&block_bits[bits_at + words + word]);
            while bits != 0u {
                let r = word * 32u + firstTrailingBit(bits);
                bits &= bits - 1u;
                if staged_box_holds(r, in_cell) {
                    let record = staged_record(first, r, drawn);
                    let z = visible_depth_of(record, pixel);
                    if z > 0.0 && is_open(i, z, drawn) {
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
    var found = Maxima(bitcast<f32>(atomicLoad(&thresholds[i])), 0.0, 0.0, 0.0, 0.0);
    if sided {
        found.front = bitcast<f32>(atomicExchange(&pixel_bits[i], 0u));
        found.back = bitcast<f32>(atomicExchange(&pixel_bits[CELL_WORKGROUP + i], 0u));
        found.front_nearness = bitcast<f32>(atomicExchange(&pixel_bits[2u * CELL_WORKGROUP + i], 0u));
        found.back_nearness = bitcast<f32>(atomicLoad(&sides[i]));
    }
    return found;
}

// Returns the limit that the maxima of a pixel give. Its writer isn't found.
fn limit_of(m: Maxima) -> CellLimit {
    var limit = CellLimit(m.threshold, 0u, vec2f(0.0, 0.0));
    if m.front_nearness > 0.0 && m.back_nearness <= m.front_nearness {
        limit.threshold = max(m.threshold, m.front);
        limit.side = RECORD_FRONT;
    } else if m.back_nearness > 0.0 {
        limit.threshold = max(m.threshold, m.back);
        limit.side = RECORD_BACK;
    }
    if m.front_nearness > 0.0 && m.back_nearness > 0.0 {
        let near = frame.projection.near;
        let sheet = reversed_depth(sheet_limit(near / m.front_nearness, near / m.back_nearness));
        limit.threshold = max(limit.threshold, sheet);
    }
    return limit;
}

// The z + ε and the ε of the splats that define the fields of a pixel's Maxima.
struct Writers {
    threshold: vec2f,
    front: vec2f,
    back: vec2f,
    front_nearest: vec2f,
    back_nearest: vec2f,
}

// Returns the z + ε and the ε of the splat that defines the threshold of a limit, which `limit_of` computed from the
// maxima.
fn writer_of(limit: CellLimit, m: Maxima, writers: Writers) -> vec2f {
    if limit.threshold == m.threshold || limit.side == 0u {
        return writers.threshold;
    }
    let is_front = limit.side == RECORD_FRONT;
    if limit.threshold == select(m.back, m.front, is_front) {
        return select(writers.back, writers.front, is_front);
    }
    return select(writers.front_nearest, writers.back_nearest, is_front);
}

// Maxima of a pixel, and the splats that define them.
struct CellMaxima {
    maxima: Maxima,
    // Only found for edges; zeros otherwise.
    writers: Writers,
}

// Runs the first loop like `find_maxima`, and also finds the splats that define the maxima. Of several such splats it
// is the first, because a pixel visits candidates in order.
fn find_maxima_and_writers(range: vec2u, corner: vec2u, i: u32, drawn: u32) -> CellMaxima {
    let sided = has(drawn, DRAW_SIDED);
    let in_cell = pixel_in_cell(i);
    let pixel = vec2i(corner + in_cell);
    let words = (i / 32u) * BATCH_WORDS;
    let of_batch = CELL_BLOCKS * BATCH_WORDS;
    var bits_at = 0u;
    var maxima = Maxima(0.0, 0.0, 0.0, 0.0, 0.0);
    var writers: Writers;
    for (var first = range.x; first < range.y; first += BATCH) {
        let count = min(range.y - first, BATCH);
        workgroupBarrier();
        stage(first, count, corner, i, bits_at, true, drawn, false);
        workgroupBarrier();
        if i / 2u < count {
            mark_raised_pixels(first, i / 2u, i % 2u, corner, drawn);
        }
        workgroupBarrier();
        for (var word = 0u; word < BATCH_WORDS; word++) {
            let of_blocks = atomicLoad(&block_bits[bits_at + words + word]);
            var bits = of_blocks | atomicExchange(&pixel_bits[word * CELL_WORKGROUP + i], 0u);
            while bits != 0u {
                let r = word * 32u + firstTrailingBit(bits);
                bits &= bits - 1u;
                if staged_box_holds(r, in_cell) {
                    let record = staged_record(first, r, drawn);
                    let z = visible_depth_of(record, pixel);
                    if z > 0.0 && is_open(i, z, drawn) {
                        let own = maxima_of(record, z, sided);
                        let writer = vec2f(z + record.epsilon, record.epsilon);
                        writers.threshold = select(writers.threshold, writer, own.threshold > maxima.threshold);
                        if sided {
                            writers.front = select(writers.front, writer, own.front > maxima.front);
                            writers.back = select(writers.back, writer, own.back > maxima.back);
                            let is_front = own.front_nearness > maxima.front_nearness;
                            writers.front_nearest = select(writers.front_nearest, writer, is_front);
                            let is_back = own.back_nearness > maxima.back_nearness;
                            writers.back_nearest = select(writers.back_nearest, writer, is_back);
                        }
                        maxima = greatest(maxima, own);
                    }
                }
            }
        }
        bits_at = of_batch - bits_at;
        if i < of_batch {
            atomicStore(&block_bits[bits_at + i], 0u);
        }
    }
    workgroupBarrier();
    if i < 2u * of_batch {
        atomicStore(&block_bits[i], 0u);
    }
    return CellMaxima(maxima, writers);
}

// Runs the first loop: returns the maxima of the pixel of invocation i, with their splats if the pass needs them.
fn maxima_by(range: vec2u, corner: vec2u, i: u32, drawn: u32) -> CellMaxima {
    if has(drawn, DRAW_EDGES) {
        return find_maxima_and_writers(range, corner, i, drawn);
    }
    var found: CellMaxima;
    found.maxima = find_maxima(range, corner, i, drawn);
    return found;
}

// Returns the limit that the maxima of a pixel give, with its writer if the pass needs it.
fn limit_by(found: CellMaxima, drawn: u32) -> CellLimit {
    var limit = limit_of(found.maxima);
    if has(drawn, DRAW_EDGES) {
        limit.writer = writer_of(limit, found.maxima, found.writers);
    }
    return limit;
}

// Stores the limit of the pixel of invocation i for the second loop. A barrier has to follow before the memory is read.
fn store_limit(i: u32, limit: CellLimit, drawn: u32) {
    atomicStore(&thresholds[i], bitcast<u32>(limit.threshold));
    if has(drawn, DRAW_SIDED) {
        atomicStore(&sides[i], limit.side);
    }
}

// Returns the sums of a pixel without fragments.
fn no_cell_sums() -> CellSums {
    let none = vec4f(0.0, 0.0, 0.0, 0.0);
    return CellSums(none, none, none, 0.0, 0.0, 0.0, frame.empty_depth, 0u);
}

// Runs the second loop: returns the sums of the pixel of invocation i up to its limit, among the pairs whose indices
// are in `range`.
fn sum_pixel(range: vec2u, corner: vec2u, i: u32, limit: CellLimit, drawn: u32) -> CellSums {
    return sum_lit_pixel(range, corner, i, limit, drawn, false);
}

// Runs the second loop like `sum_pixel`. If `is_lit`, it sums the colours of splats that were lit one by one, for the
// last layer.
fn sum_lit_pixel(range: vec2u, corner: vec2u, i: u32, limit: CellLimit, drawn: u32, is_lit: bool) -> CellSums {
    let in_cell = pixel_in_cell(i);
    let pixel = vec2i(corner + in_cell);
    let words = (i / 32u) * BATCH_WORDS;
    let of_batch = CELL_BLOCKS * BATCH_WORDS;
    var bits_at = 0u;
    var sums = no_cell_sums();
    for (var first = range.x; first < range.y; first += BATCH) {
        let count = min(range.y - first, BATCH);
        workgroupBarrier();
        stage(first, count, corner, i, bits_at, false, drawn, is_lit);
        workgroupBarrier();
        if i / 2u < count {
            mark_pixels(first, i / 2u, i % 2u, corner, drawn);
        }
        workgroupBarrier();
        for (var word = 0u; word < BATCH_WORDS; word++) {
            let of_blocks = atomicLoad(&block_bits[bits_at + words + word]);
            var bits = of_blocks | atomicExchange(&pixel_bits[word * CELL_WORKGROUP + i], 0u);
            while bits != 0u {
                let r = word * 32u + firstTrailingBit(bits);
                bits &= bits - 1u;
                if staged_box_holds(r, in_cell) {
                    add_contribution(first, r, pixel, i, limit, drawn, &sums);
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

// Returns the range of the list of the cell with this number (`cell_number`, or among active cells in a frame of
// samples): the index in `cell_lists` of its first record, and one past that of its last.
fn list_of(number: u32) -> vec2u {
    return vec2u(cell_lists[2u * number], cell_lists[2u * number + 1u]);
}

// Returns the range of the list of a cell (column, row).
fn pairs_of(cell: vec2u) -> vec2u {
    return list_of(cell_number(cell));
}

// Draws a cell (column, row), unless it is dense: dense cells are drawn in parts.
fn draw_cell(cell: vec2u, i: u32, drawn: u32) {
    let range = pairs_of(cell);
    if is_dense(range) {
        return;
    }
    let corner = cell * CELL_SIDE;
    clear_cell(i);
    let limit = limit_by(maxima_by(range, corner, i, drawn), drawn);
    store_limit(i, limit, drawn);
    let sums = sum_pixel(range, corner, i, limit, drawn);
    write_cell_pixel(corner + pixel_in_cell(i), sums, limit.writer, drawn);
}

// Divides the sums of the pixel `own` of the targets by Σw, lights it, and writes its planes. `writer` is the z + ε and
// the ε of the splat that defines its depth threshold.
fn write_cell_pixel(own: vec2u, sums: CellSums, writer: vec2f, drawn: u32) {
    if own.x >= frame.size_px.x || own.y >= frame.size_px.y {
        return;
    }
    let pixel = vec2i(own);
    let point = point_of(sums.color, sums.surface, sums.material);
    if frame.surfaces_at != ABSENT {
        // The depth is that of front_depth, to the bit.
        write_surface(own, point, sums.surface.w / sums.color.w * frame.depth_unit);
    }
    if has(drawn, DRAW_EDGES) && frame.edges_at != ABSENT {
        write_edge_data(own, writer, sums.coverage, point.is_there);
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
            color = vec4f(color_of(position_at(pixel, point.z), point, has(drawn, DRAW_FULL)), 1.0);
        }
        write_color(at, color);
    }
    write_planes(at, Surface(vec3f(0.0, 0.0, 0.0), point.normal, point.z, point.weight, point.is_there));
    if frame.fragments_at != ABSENT {
        planes[frame.fragments_at + at] = sums.fragments;
    }
    if frame.nearest_at != ABSENT {
        if point.is_there {
            write_nearest(at, sums.nearest);
        } else {
            planes[frame.nearest_at + 2u * at] = 0.0;
            planes[frame.nearest_at + 2u * at + 1u] = 0.0;
        }
    }
}

// Writes the place of the nearest splat, whose record has the index `record`, to the plane of nearest splats. `at` is
// the pixel's number in the shaded region, row by row.
fn write_nearest(at: u32, record: u32) {
    let place = cell_records[part_at(RECORD_PLACE, record)].x;
    planes[frame.nearest_at + 2u * at] = f32(place / CELL_WORKGROUP + 1u);
    planes[frame.nearest_at + 2u * at + 1u] = f32(place % CELL_WORKGROUP);
}

// Writes the normal and depth z of the pixel `own` of the targets at Frame.surfaces_at, four words per pixel, for
// passes that read neighbours or draw layers.
fn write_surface(own: vec2u, point: Point, z: f32) {
    let to = frame.surfaces_at + 4u * (own.y * frame.size_px.x + own.x);
    planes[to] = point.normal.x;
    planes[to + 1u] = point.normal.y;
    planes[to + 2u] = point.normal.z;
    planes[to + 3u] = select(frame.empty_depth, z, point.is_there);
}

// Draws cells of an image that needs neither normals nor depths, for planes or shading. Sums colours and weights alone.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_colors(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, 0u);
}

// Draws cells of an image that needs normals or depths, for planes or shading.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE);
}

// Draws cells of an image with shadows or the shader `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_shadowed_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE | DRAW_FULL);
}

// Draws cells whose pixels show one side of oriented splats.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_sided_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE | DRAW_SIDED);
}

// Draws cells whose pixels show one side of oriented splats, in an image with shadows or the shader `toon`.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_sided_shadowed_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE | DRAW_FULL | DRAW_SIDED);
}

// Draws cells in frames with clipped splats. This entry point and the next three differ in whether pixels show one side
// of oriented splats (sided), and in whether edges are antialiased (edged). They sum and shade all that the entry
// points above do, shadows included.
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_clipped_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE | DRAW_FULL | DRAW_CLIPPED);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_clipped_sided_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE | DRAW_FULL | DRAW_SIDED | DRAW_CLIPPED);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_clipped_edged_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE | DRAW_FULL | DRAW_EDGES | DRAW_CLIPPED);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_clipped_sided_edged_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE | DRAW_FULL | DRAW_SIDED | DRAW_EDGES | DRAW_CLIPPED);
}

// Draws cells of images with antialiased edges, in frames without clipped splats. This entry point and the next three
// differ in whether pixels show one side of oriented splats (sided), and in shadows or the shader `toon` (shadowed).
@compute @workgroup_size(CELL_WORKGROUP)
fn cell_edged_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE | DRAW_EDGES);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_shadowed_edged_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE | DRAW_FULL | DRAW_EDGES);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_sided_edged_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE | DRAW_SIDED | DRAW_EDGES);
}

@compute @workgroup_size(CELL_WORKGROUP)
fn cell_sided_shadowed_edged_surfaces(@builtin(workgroup_id) cell: vec3u, @builtin(local_invocation_index) i: u32) {
    draw_cell(cell.xy, i, DRAW_SURFACE | DRAW_FULL | DRAW_SIDED | DRAW_EDGES);
}
