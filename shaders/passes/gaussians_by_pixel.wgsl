// Trained Gaussians sorted in each pixel (docs/gaussians.md). The fragments of a pixel wait in a heap, which is a part
// of `gaussian_lists`, until no nearer fragment can follow. The heap's memory is called the pixel's room; its places
// are numbered from the root, 0, level by level.

// A fragment in a pixel's heap.
struct WaitingGaussian {
    // Sort key of fragments: depth_step_f32 of the depth, then the index of the Gaussian among the scene's Gaussians.
    key: vec2u,
    // Index of the record's entry in the lists.
    at: u32,
}

// Maximum number of steps per pixel of a dispatch. A step reads, sorts or blends one fragment. It may traverse a
// pixel's heap three times, in at most 18 iterations of a loop each.
const GAUSSIAN_STEPS: u32 = 1024u;
// Value of both words of a turn's limit, a sort key, if the turn accepts fragments of any key.
const NO_LIMIT: u32 = 0xffffffffu;
// Number of fragments that may wait in a pixel's first turn (see `gaussians_by_pixel`). Each further turn quadruples
// the number, up to the size of the heap.
const FIRST_WAITING: u32 = 32u;

// What a pixel does next: read the list, sort the waiting fragments, blend them, or nothing, because it is finished.
const GAUSSIANS_READ: u32 = 0u;
const GAUSSIANS_SORT: u32 = 1u;
const GAUSSIANS_BLEND: u32 = 2u;
const GAUSSIANS_END: u32 = 3u;

// True if sort key a precedes sort key b.
fn is_before(a: vec2u, b: vec2u) -> bool {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

// Returns the index in `gaussian_lists` of the first word of a place of a pixel's heap.
fn gaussian_room_at(pixel: u32, place: u32) -> u32 {
    return gaussian_state_at(pixel, GAUSSIAN_STATE_WORDS + GAUSSIAN_ROOM_WORDS * place);
}

// Returns the sort key of the fragment at a place of a pixel's heap.
fn waiting_key(pixel: u32, place: u32) -> vec2u {
    let at = gaussian_room_at(pixel, place);
    return vec2u(gaussian_lists[at], gaussian_lists[at + frame.shade_size_px.x * frame.shade_size_px.y]);
}

// Returns the fragment at a place of a pixel's heap.
fn waiting_gaussian(pixel: u32, place: u32) -> WaitingGaussian {
    let at = gaussian_room_at(pixel, place);
    let pixels = frame.shade_size_px.x * frame.shade_size_px.y;
    return WaitingGaussian(vec2u(gaussian_lists[at], gaussian_lists[at + pixels]), gaussian_lists[at + 2u * pixels]);
}

// Writes a fragment to a place of a pixel's heap.
fn set_waiting_gaussian(pixel: u32, place: u32, waiting: WaitingGaussian) {
    let at = gaussian_room_at(pixel, place);
    let pixels = frame.shade_size_px.x * frame.shade_size_px.y;
    gaussian_lists[at] = waiting.key.x;
    gaussian_lists[at + pixels] = waiting.key.y;
    gaussian_lists[at + 2u * pixels] = waiting.at;
}

// Inserts a fragment into a pixel's heap at the free place `last`, the one after all others, and moves it toward the
// root. The heap has the farthest fragment at its root.
fn rise_gaussian(pixel: u32, last: u32, waiting: WaitingGaussian) {
    var place = last;
    while place > 0u {
        let parent = (place - 1u) / 2u;
        let above = waiting_gaussian(pixel, parent);
        if !is_before(above.key, waiting.key) {
            break;
        }
        set_waiting_gaussian(pixel, place, above);
        place = parent;
    }
    set_waiting_gaussian(pixel, place, waiting);
}

// Inserts a fragment into a pixel's heap of `count` places at the free root, and moves it away from the root.
fn sink_gaussian(pixel: u32, count: u32, waiting: WaitingGaussian) {
    var place = 0u;
    while 2u * place + 1u < count {
        var child = 2u * place + 1u;
        if child + 1u < count && is_before(waiting_key(pixel, child), waiting_key(pixel, child + 1u)) {
            child++;
        }
        let below = waiting_gaussian(pixel, child);
        if !is_before(waiting.key, below.key) {
            break;
        }
        set_waiting_gaussian(pixel, place, below);
        place = child;
    }
    set_waiting_gaussian(pixel, place, waiting);
}

// Blends Gaussians exactly in the order of depths in each pixel, in turns. A turn reads the list as long as an entry
// may be among the nearest remaining fragments that fit the heap. Then it sorts the fragments in the heap and blends
// them.
//
// The next turn begins at the first entry that this turn skipped. Records are sorted by their smallest depth
// (GaussianRecord.nearest), so the first record beyond the turn's limit ends the turn.
@compute @workgroup_size(8, 8)
fn gaussians_by_pixel(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.shade_size_px.x || id.y >= frame.shade_size_px.y {
        return;
    }
    let place = vec2i(id.xy) + frame.origin_px;
    let pixel = id.y * frame.shade_size_px.x + id.x;
    let dispatches = gaussian_state(pixel, GAUSSIAN_DISPATCHES);
    if dispatches == GAUSSIANS_FINISHED {
        return;
    }
    let list = gaussian_list(id);
    var sums = no_gaussian_sums();
    var at = list.x;
    // Range of sort keys whose fragments this turn accepts: from `first` on, before `limit`.
    var first = vec2u(0u, 0u);
    var limit = vec2u(NO_LIMIT, NO_LIMIT);
    // Entry of the list at which the next turn begins.
    var next = list.y;
    var state = GAUSSIANS_READ;
    // Numbers of fragments: in the heap (`count`), allowed in the heap (`room`), and already sorted or blended in this
    // turn (`done`).
    var count = 0u;
    var room = min(FIRST_WAITING, frame.gaussian_room);
    var done = 0u;
    if dispatches > 0u {
        sums = load_gaussian_sums(pixel);
        at = gaussian_state(pixel, 16u);
        first = vec2u(gaussian_state(pixel, 17u), gaussian_state(pixel, 18u));
        limit = vec2u(gaussian_state(pixel, 19u), gaussian_state(pixel, 20u));
        next = gaussian_state(pixel, 21u);
        let rest = gaussian_state(pixel, 22u);
        state = rest & 3u;
        room = rest >> 2u;
        done = gaussian_state(pixel, 23u) & 0xffffu;
        count = gaussian_state(pixel, 23u) >> 16u;
    }
    for (var step = 0u; step < GAUSSIAN_STEPS && state != GAUSSIANS_END; step++) {
        if state == GAUSSIANS_READ {
            var is_over = at >= list.y;
            if !is_over {
                let record = gaussian_lists[at];
                let nearest = gaussian_records[record].nearest;
                let number = gaussian_records[record].number;
                is_over = !is_before(vec2u(depth_step_f32(nearest), number), limit);
                if !is_over {
                    let fragment = gaussian_fragment(record, place);
                    // A fragment is never nearer than the smallest depth of its record. The maximum ensures this
                    // despite rounding.
                    let key = vec2u(depth_step_f32(max(fragment.z, nearest)), number);
                    if fragment.alpha >= 0.0 && !is_before(key, first) {
                        let waiting = WaitingGaussian(key, at);
                        if !is_before(key, limit) {
                            next = min(next, at);
                        } else if count < room {
                            rise_gaussian(pixel, count, waiting);
                            count++;
                        } else {
                            let farthest = waiting_gaussian(pixel, 0u);
                            if is_before(key, farthest.key) {
                                sink_gaussian(pixel, count, waiting);
                                limit = farthest.key;
                                next = min(next, farthest.at);
                            } else {
                                limit = key;
                                next = min(next, at);
                            }
                        }
                    }
                    at++;
                }
            }
            if is_over {
                state = GAUSSIANS_SORT;
                next = min(next, at);
                done = 0u;
            }
        } else if state == GAUSSIANS_SORT {
            // The farthest unsorted fragment moves to the last unsorted place.
            if done + 1u < count {
                let last = count - 1u - done;
                let moved = waiting_gaussian(pixel, last);
                set_waiting_gaussian(pixel, last, waiting_gaussian(pixel, 0u));
                sink_gaussian(pixel, last, moved);
                done++;
            } else {
                state = GAUSSIANS_BLEND;
                done = 0u;
            }
        } else if done < count {
            let record = gaussian_lists[waiting_gaussian(pixel, done).at];
            blend_gaussian(&sums, record, gaussian_fragment(record, place));
            done++;
            state = select(GAUSSIANS_END, GAUSSIANS_BLEND, sums.is_open);
        } else if limit.x == NO_LIMIT {
            state = GAUSSIANS_END;
        } else {
            first = limit;
            limit = vec2u(NO_LIMIT, NO_LIMIT);
            at = next;
            next = list.y;
            count = 0u;
            room = min(4u * room, frame.gaussian_room);
            state = GAUSSIANS_READ;
        }
    }
    if state != GAUSSIANS_END {
        set_gaussian_state(pixel, 16u, at);
        set_gaussian_state(pixel, 17u, first.x);
        set_gaussian_state(pixel, 18u, first.y);
        set_gaussian_state(pixel, 19u, limit.x);
        set_gaussian_state(pixel, 20u, limit.y);
        set_gaussian_state(pixel, 21u, next);
        set_gaussian_state(pixel, 22u, state | room << 2u);
        set_gaussian_state(pixel, 23u, done | count << 16u);
    }
    end_gaussian_dispatch(pixel, sums, state == GAUSSIANS_END);
}
