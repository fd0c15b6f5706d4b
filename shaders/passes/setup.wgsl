// Splat setup (rendering model §2–§5): one invocation projects a stored splat and writes its screen-space record. It
// skips splats that reach the near plane: the CPU sets them up in f64, and they have records of their own. A segment is
// the part of an object's splats that shares a buffer.

// Chunks of the segment.
@group(1) @binding(2) var<storage, read> chunks: array<Chunk>;
// Bits of the splats of those chunks in which some splat reaches the near plane, eight words per chunk from Chunk.state
// on. Bit i is set if the CPU sets up splat i of the chunk.
@group(1) @binding(3) var<storage, read> near_bits: array<u32>;
// Records of the segment, one per splat, in the order of `splats`.
@group(1) @binding(4) var<storage, read_write> records_out: array<Record>;
// Number of splats that take part in a pass; incremented here.
@group(1) @binding(5) var<storage, read_write> drawn: atomic<u32>;
// Clips of the records, in the same order. Only bound for clipped splats.
@group(1) @binding(6) var<storage, read_write> record_clips_out: array<RecordClip>;

// The texture `pixel_steps` (samples.wgsl) of the tile of pixels that a frame of samples belongs to. The first number
// is above 0 if a pixel is sampled.
@group(1) @binding(7) var sampled_pixels: texture_2d<f32>;

// Length, in pixels, by which pixel boxes are enlarged on each side. It exceeds the f32 rounding of box and anchor many
// times over, and is far below a pixel.
const BOX_SLACK_PX: f32 = 2e-3;
// Largest absolute value of an anchor's coordinates, in pixels. i32 can represent such a coordinate and its offset to
// any pixel.
const FARTHEST_PX: f32 = 1e9;

// Returns the box of the pixels of the targets whose centres lie between two offsets from the pixel position `base`:
// first column and row, then one past the last column and row.
fn pixel_box(base: vec2f, extent: Extent) -> vec4f {
    let limit = vec2f(frame.size_px);
    let start = base - vec2f(frame.origin_px);
    let first = start + ceil(extent.least - 0.5);
    let end = start + floor(extent.greatest - 0.5) + 1.0;
    return vec4f(clamp(first, vec2f(0.0, 0.0), limit), clamp(end, vec2f(0.0, 0.0), limit));
}

// True if a box (first column and row, end column and row) contains no pixel.
fn box_is_empty(pixels: vec4f) -> bool {
    return !(pixels.x < pixels.z && pixels.y < pixels.w);
}

// Maximum number of pixels of a box that are searched for sampled ones, one by one. Boxes of more pixels, which are
// few, aren't reduced.
const MAX_SEARCHED: i32 = 4096;

// Returns the part of a box of samples that sampled pixels span: the smallest box around the samples of all sampled
// pixels in it. The part is empty if no pixel is sampled. Returns the box itself if it covers more than MAX_SEARCHED
// pixels, or if the frame isn't one of samples.
fn sampled_part(samples: vec4f) -> vec4f {
    if frame.is_of_samples == 0u || box_is_empty(samples) {
        return samples;
    }
    let side = i32(SAMPLES_SIDE);
    let first = vec2i(samples.xy) / side;
    let end = (vec2i(samples.zw) + (side - 1)) / side;
    if (end.x - first.x) * (end.y - first.y) > MAX_SEARCHED {
        return samples;
    }
    var least = end;
    var greatest = first;
    for (var y = first.y; y < end.y; y++) {
        for (var x = first.x; x < end.x; x++) {
            let pixel = vec2i(x, y);
            if textureLoad(sampled_pixels, vec2i(frame.first_pixel) + pixel, 0).x > 0.0 {
                least = min(least, pixel);
                greatest = max(greatest, pixel + 1);
            }
        }
    }
    return vec4f(max(samples.xy, vec2f(least * side)), min(samples.zw, vec2f(greatest * side)));
}

// Returns a box of pixels in the format of Record.visible_box.
fn packed_box(pixels: vec4f) -> vec2u {
    if box_is_empty(pixels) {
        return vec2u(0u, 0u);
    }
    let p = vec4u(pixels);
    return vec2u(p.x | (p.y << 16u), p.z | (p.w << 16u));
}

// Returns the box of pixels that `packed_box` packed.
fn unpacked_box(pixels: vec2u) -> vec4f {
    return vec4f(vec4u(pixels.x & 0xffffu, pixels.x >> 16u, pixels.y & 0xffffu, pixels.y >> 16u));
}

// In a frame of samples, reduces a splat's boxes to the parts that sampled pixels span (`sampled_part`). The splat is
// there no longer if both boxes become empty.
fn among_sampled(splat: SetUpSplat) -> SetUpSplat {
    if frame.is_of_samples == 0u || !splat.is_there {
        return splat;
    }
    var reduced = splat;
    reduced.record.visible_box = packed_box(sampled_part(unpacked_box(splat.record.visible_box)));
    reduced.record.filtered_box = packed_box(sampled_part(unpacked_box(splat.record.filtered_box)));
    reduced.is_there = reduced.record.visible_box.y != 0u || reduced.record.filtered_box.y != 0u;
    return reduced;
}

// Returns the smallest box that contains both boxes.
fn extent_union(a: Extent, b: Extent) -> Extent {
    return Extent(min(a.least, b.least), max(a.greatest, b.greatest));
}

// Applies the frame's filter to a projected splat with the unfiltered footprint `visible`.
fn filtered_by(projected: Projected, visible: Footprint) -> Filtered {
    let projective = frame.projective != 0u;
    switch frame.filter_kind {
        case FILTER_CLAMP: {
            return Filtered(visible, 1.0, area_ratio(projected, frame.radius_px), turn_none());
        }
        case FILTER_ADJUST: {
            return adjust(projected, frame.radius_px, projective);
        }
        case FILTER_PRINCIPAL: {
            return principal(projected, frame.radius_px, projective);
        }
        case FILTER_EWA: {
            return ewa(projected, frame.radius_px);
        }
        default: {
            return filtered_unfiltered(visible);
        }
    }
}

// Unfiltered (`visible`) and filtered footprint of a splat, and the map from the (u, v) of each to those of the splat's
// clip.
struct ClipFootprints {
    visible: Footprint,
    filtered: Footprint,
    visible_turn: Turn,
    filtered_turn: Turn,
}

// A splat after setup. `is_there` is false if it takes part in no pass.
struct SetUpSplat {
    record: Record,
    footprints: ClipFootprints,
    is_there: bool,
}

// Returns a splat that takes part in no pass.
fn no_set_up_splat() -> SetUpSplat {
    var none: SetUpSplat;
    return none;
}

@compute @workgroup_size(WORKGROUP)
fn setup(@builtin(global_invocation_id) id: vec3u) {
    if id.x < segment.count {
        write_record(id.x, set_up_of_chunk(id.x));
    }
}

// Sets up the splats of a segment of clipped splats, and writes their clips, too.
@compute @workgroup_size(WORKGROUP)
fn clipped_setup(@builtin(global_invocation_id) id: vec3u) {
    let i = id.x;
    if i >= segment.count {
        return;
    }
    let splat = set_up_of_chunk(i);
    write_record(i, splat);
    if splat.is_there {
        record_clips_out[i] = clips_of(i, splat.footprints);
    }
}

// Returns the clips of splat i over pixels, for both of its footprints.
fn clips_of(i: u32, footprints: ClipFootprints) -> RecordClip {
    let clip = stored_clip(i);
    return RecordClip(
        clip_through(clip, footprints.visible, footprints.visible_turn),
        clip_through(clip, footprints.filtered, footprints.filtered_turn),
    );
}

// Writes the record of splat i; a splat that takes part in no pass has empty boxes.
fn write_record(i: u32, splat: SetUpSplat) {
    if splat.is_there {
        records_out[i] = splat.record;
        atomicAdd(&drawn, 1u);
    } else {
        records_out[i].visible_box = vec2u(0u, 0u);
        records_out[i].filtered_box = vec2u(0u, 0u);
    }
}

// Sets up splat i of the segment. The result takes part in no pass if the splat is hidden, its chunk is outside of the
// view, or the CPU has set the splat up.
fn set_up_of_chunk(i: u32) -> SetUpSplat {
    let code = stored_word(i * segment.stride);
    if code == SPLAT_HIDDEN {
        return no_set_up_splat();
    }
    let chunk = chunks[code / CHUNK_SPLATS];
    if chunk.state == CHUNK_OUTSIDE || is_set_up_by_host(code, chunk.state) {
        return no_set_up_splat();
    }
    return among_sampled(set_up(i, code / CHUNK_SPLATS, chunk.center));
}

// True if the CPU sets up a splat because it reaches the near plane. `code` is the splat's first word, and `state` the
// Chunk.state of its chunk.
fn is_set_up_by_host(code: u32, state: u32) -> bool {
    if state == CHUNK_ORDINARY {
        return false;
    }
    let in_chunk = code % CHUNK_SPLATS;
    return (near_bits[state + in_chunk / 32u] & (1u << (in_chunk % 32u))) != 0u;
}

// Sets up splat i of the segment. `chunk` is the index of its chunk in the segment, and `center` the view position of
// the chunk's origin.
fn set_up(i: u32, chunk: u32, center: vec3f) -> SetUpSplat {
    let at = i * segment.stride;
    let scales = stored_scales(chunk);
    let shape_at = at + segment.shape_at;
    let object = objects[segment.object];
    var pair: Pair;
    var outward: vec3f;
    if segment.is_disk != 0u {
        outward = stored_unit(shape_at);
        let radius = stored_number(shape_at + select(3u, 2u, is_quantised()), 0u, scales.y);
        let axes = orthonormal(outward);
        pair = Pair(axes.s * radius, axes.t * radius);
    } else {
        pair.s = vec3f(stored_f32(shape_at, 0u), stored_f32(shape_at, 1u), stored_f32(shape_at, 2u));
        pair.t = vec3f(stored_f32(shape_at, 3u), stored_f32(shape_at, 4u), stored_f32(shape_at, 5u));
        outward = v3_cross(pair.s * (1.0 / v3_max_abs(pair.s)), pair.t * (1.0 / v3_max_abs(pair.t)));
    }
    let world_normal = unit(object.normals * outward);
    let p = object.linear * stored_numbers(at + segment.center_at, scales.x) + center;
    let n = frame.view_from_world * world_normal;
    let splat = ViewSplat(p, object.linear * pair.s, object.linear * pair.t, n);
    var shading = world_normal;
    if segment.shading_normal_at != ABSENT {
        shading = unit(object.normals * stored_unit(at + segment.shading_normal_at));
    }
    var color = vec3f(1.0, 1.0, 1.0);
    if segment.color_at != ABSENT {
        color = stored_numbers(at + segment.color_at, scales.z);
    }
    return project(i, splat, shading, color, object);
}

// Largest length of a half-axis that f32 can project, in distances of the splat from the eye. Splats with longer ones
// are set up like near splats (rendering model §3, "Near splats").
const VAST: f32 = 1e7;

// True if f32 can't project a splat: its centre is nearer than the near plane, its depth range in perspective is at
// least its centre's depth, or a half-axis is longer than VAST times its distance (orthographic: the view's height).
// `extent` is half the depth range of its disk. The CPU sets up such splats in f64, unless the application places them:
// they are then not drawn.
fn reaches_near(splat: ViewSplat, extent: f32) -> bool {
    let projection = frame.projection;
    let perspective = projection.kind == PERSPECTIVE;
    let distance = select(projection.height, splat.p.z, perspective);
    let size = max(v3_max_abs(splat.s), v3_max_abs(splat.t));
    let is_close = perspective && extent >= 0.5 * splat.p.z;
    return splat.p.z < projection.near || is_close || distance * VAST < size;
}

// Projects splat i of the segment, given in view space, and fills its record. The result takes part in no pass if the
// splat touches no pixel, lies before the near or behind the far plane, is edge-on, or faces away and is culled. The
// splat's centre is at or beyond z_near, unless the application places the splat. A placed splat that reaches the near
// plane takes part in no pass, either. `shading` is its shading normal in world space, and `color` its linear albedo.
fn project(i: u32, splat: ViewSplat, shading: vec3f, color: vec3f, object: Object) -> SetUpSplat {
    let projection = frame.projection;
    let projective = frame.projective != 0u;
    let perspective = projection.kind == PERSPECTIVE;
    let z = splat.p.z;
    let radius = radius_max(splat.s, splat.t);
    let epsilon = tolerance(splat, radius, frame.radius_px, frame.tolerance, projection);
    var adjusted = splat;
    var turn = turn_none();
    if frame.filter_kind == FILTER_ADJUST {
        let pair = adjust_axes_turned(splat, perspective);
        adjusted.s = pair.axes.s;
        adjusted.t = pair.axes.t;
        turn = pair.turn;
    }
    let projected = projected_new(adjusted, projection);
    let extent = projected.depth_extent;
    let back_facing = 0.0 <= projected.facing;
    let outside = z + extent < projection.near || projection.far < z - extent;
    if segment.is_placed != 0u && reaches_near(splat, extent) {
        return no_set_up_splat();
    }
    if outside || projected_is_edge_on(projected) || (back_facing && object.cull_back != 0u) {
        return no_set_up_splat();
    }
    let visible = footprint_unfiltered(projected, projective);
    let filtered = filtered_by(projected, visible);
    let slack = Extent(vec2f(-BOX_SLACK_PX, -BOX_SLACK_PX), vec2f(BOX_SLACK_PX, BOX_SLACK_PX));
    let visible_extent = bounds_unfiltered(projected, projective);
    var filtered_extent = visible_extent;
    if frame.filter_kind == FILTER_CLAMP {
        let h = vec2f(frame.radius_px, frame.radius_px);
        filtered_extent = extent_union(visible_extent, Extent(-h, h));
    } else if frame.filter_kind != FILTER_NONE {
        filtered_extent = bounds_footprint(filtered.footprint);
    }
    let along = select(splat.p.xy, splat.p.xy / z, perspective) * projection.focal_px + projection.principal_px;
    let base = clamp(floor(along), vec2f(-FARTHEST_PX, -FARTHEST_PX), vec2f(FARTHEST_PX, FARTHEST_PX));
    let fraction = projection_offset_from(projection, splat.p, base);
    let about = Extent(fraction + slack.least, fraction + slack.greatest);
    let visible_pixels =
        pixel_box(base, Extent(about.least + visible_extent.least, about.greatest + visible_extent.greatest));
    let filtered_pixels =
        pixel_box(base, Extent(about.least + filtered_extent.least, about.greatest + filtered_extent.greatest));
    if box_is_empty(visible_pixels) && box_is_empty(filtered_pixels) {
        return no_set_up_splat();
    }
    var record: Record;
    record.base = vec2i(base);
    record.fraction = fraction;
    record.visible_u = vec2f(visible.u.x, visible.u.y);
    record.visible_v = vec2f(visible.v.x, visible.v.y);
    record.scale = z;
    if projective {
        record.depth = -projected.depth_gradient;
        record.range = vec2f(z / (z + extent), z / (z - extent));
        record.flags = RECORD_RECIPROCAL;
    } else {
        record.depth = projected.depth_gradient * select(1.0, z, perspective);
        record.range = vec2f(z - extent, z + extent);
    }
    if frame.filter_kind == FILTER_CLAMP {
        record.flags |= RECORD_CLAMP;
    }
    if object.keeps_facings != 0u {
        record.flags |= select(RECORD_FRONT, RECORD_BACK, back_facing);
    }
    record.flags |= segment.object << RECORD_OBJECT;
    record.epsilon = epsilon;
    record.weight_scale = filtered.weight_scale;
    record.u = vec2f(filtered.footprint.u.x, filtered.footprint.u.y);
    record.v = vec2f(filtered.footprint.v.x, filtered.footprint.v.y);
    record.w = vec2f(filtered.footprint.w.x, filtered.footprint.w.y);
    record.at_anchor = vec2f(0.0, 0.0);
    record.w_at_anchor = 1.0;
    record.color = color;
    record.normal = shading * select(1.0, -1.0, back_facing && object.two_sided != 0u);
    if back_facing && object.two_sided != 0u && object.oriented != 0u {
        let to_eye = frame.world_from_view * select(vec3f(0.0, 0.0, -1.0), -unit(splat.p), perspective);
        record.normal = back_normal(shading, projected.facing_cosine, to_eye);
    }
    record.coverage = filtered.coverage_scale * object.coverage;
    if frame.has_layers != 0u && segment.alpha_at != ABSENT {
        record.coverage = stored_f32(i * segment.stride + segment.alpha_at, 0u);
        record.flags |= RECORD_LAYERED;
        if frame.has_abuffer != 0u && scale_is_coverage() {
            record.weight_scale = filtered.coverage_scale;
        }
    }
    record.visible_box = packed_box(visible_pixels);
    record.filtered_box = packed_box(filtered_pixels);
    let footprints = ClipFootprints(visible, filtered.footprint, turn, turn_after(turn, filtered.turn));
    return SetUpSplat(record, footprints, true);
}
