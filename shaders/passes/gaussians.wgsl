// Trained Gaussians, one over another (docs/gaussians.md), once a pixel. The host has projected them, put them in
// order, and listed them by cells of 16×16 pixels.

// A Gaussian as the view shows it.
struct GaussianRecord {
    // The pixel that its centre is in, and where in it.
    base: vec2i,
    fraction: vec2f,
    forms: GaussianForms,
    color: vec3f,
    opacity: f32,
    // World space.
    normal: vec3f,
    // What α is multiplied by.
    weight: f32,
    // Depth before which it doesn't show: no less than that of those before it in a list for the order of pixels.
    nearest: f32,
    // Its place among the scene's.
    number: u32,
}

// Pixels on a side of a cell.
const GAUSSIAN_CELL: u32 = 16u;
const MAX_ALPHA: f32 = 0.99;
const MIN_ALPHA: f32 = 0.003921569;
const MIN_TRANSMITTANCE: f32 = 1e-4;
const MIN_GAUSSIAN_WEIGHT: f32 = 1e-12;

@group(1) @binding(28) var<storage, read> gaussian_records: array<GaussianRecord>;
// Where each cell's entries begin, and where the last one's end; then the entries: numbers of records, ascending.
@group(1) @binding(29) var<storage, read> gaussian_lists: array<u32>;

// What is blended of a pixel.
struct GaussianSums {
    // In the Gaussians' colour space.
    color: vec3f,
    transmittance: f32,
    normal: vec3f,
    weight: f32,
    depth: f32,
    median_depth: f32,
    distortion: f32,
    // Σw·m and Σw·m², m the depth that the distortion compares.
    moments: vec2f,
    fragments: u32,
    // Light may be left.
    is_open: bool,
}

// A Gaussian at a pixel. α is negative where it doesn't show; 0 may be what a filter leaves of a tiny one.
struct GaussianFragment {
    alpha: f32,
    z: f32,
}

fn gaussian_fragment(record: u32, pixel: vec2i) -> GaussianFragment {
    // Whole numbers, exact: only the fraction rounds.
    let offset = vec2f(pixel - gaussian_records[record].base) - (gaussian_records[record].fraction - 0.5);
    let at = gaussian_forms_at(gaussian_records[record].forms, offset);
    // exp(−ρ²/2), where it isn't nothing.
    let alpha = min(gaussian_records[record].opacity * exp2(max(at.x * -0.72134752, -126.0)), MAX_ALPHA);
    let shows = MIN_ALPHA <= alpha && frame.gaussian_near <= at.y && at.y < 1e30;
    return GaussianFragment(select(-1.0, alpha * gaussian_records[record].weight, shows), at.y);
}

// Blends a fragment behind what is there.
fn blend_gaussian(sums: ptr<function, GaussianSums>, record: u32, fragment: GaussianFragment) {
    let before = (*sums).transmittance;
    let left = before * (1.0 - fragment.alpha);
    if left < MIN_TRANSMITTANCE {
        (*sums).is_open = false;
        return;
    }
    let w = fragment.alpha * before;
    let m = distortion_depth(fragment.z);
    let moments = (*sums).moments;
    (*sums).color += gaussian_records[record].color * w;
    (*sums).normal += gaussian_records[record].normal * w;
    (*sums).weight += w;
    (*sums).depth += fragment.z * w;
    if before > 0.5 {
        (*sums).median_depth = fragment.z;
    }
    (*sums).distortion += w * (fma(m * m, 1.0 - before, moments.y) - 2.0 * m * moments.x);
    (*sums).moments = moments + vec2f(w * m, w * m * m);
    (*sums).fragments += 1u;
    (*sums).transmittance = left;
}

// Linear premultiplied colour over the background.
fn resolved_gaussians(sums: GaussianSums) -> vec4f {
    let behind = frame.gaussian_background;
    let alpha = 1.0 - sums.transmittance + sums.transmittance * behind.a;
    let color = sums.color + sums.transmittance * behind.rgb;
    if frame.has_linear_gaussians != 0u || alpha <= 0.0 {
        return vec4f(color, alpha);
    }
    let straight = color / alpha;
    return vec4f(vec3f(srgb_decode(straight.r), srgb_decode(straight.g), srgb_decode(straight.b)) * alpha, alpha);
}

fn write_gaussians(at: u32, sums: GaussianSums) {
    if frame.color_at != ABSENT {
        write_color(at, resolved_gaussians(sums));
    }
    let is_there = sums.weight > MIN_GAUSSIAN_WEIGHT;
    if frame.depth_at != ABSENT {
        planes[frame.depth_at + at] = select(frame.empty_depth, sums.depth / sums.weight, is_there);
    }
    if frame.normal_at != ABSENT {
        let to = frame.normal_at + 3u * at;
        planes[to] = sums.normal.x;
        planes[to + 1u] = sums.normal.y;
        planes[to + 2u] = sums.normal.z;
    }
    if frame.weight_at != ABSENT {
        planes[frame.weight_at + at] = 1.0 - sums.transmittance;
    }
    if frame.alpha_at != ABSENT {
        planes[frame.alpha_at + at] = 1.0 - sums.transmittance;
    }
    if frame.median_depth_at != ABSENT {
        planes[frame.median_depth_at + at] = select(frame.empty_depth, sums.median_depth, is_there);
    }
    if frame.distortion_at != ABSENT {
        planes[frame.distortion_at + at] = sums.distortion;
    }
    if frame.fragments_at != ABSENT {
        planes[frame.fragments_at + at] = f32(sums.fragments);
    }
}

// First entry of a pixel's cell, and the end of its entries.
fn gaussian_list(id: vec3u) -> vec2u {
    let cell = id.y / GAUSSIAN_CELL * frame.gaussian_columns + id.x / GAUSSIAN_CELL;
    return vec2u(gaussian_lists[cell], gaussian_lists[cell + 1u]);
}

fn no_gaussian_sums() -> GaussianSums {
    var sums: GaussianSums;
    sums.transmittance = 1.0;
    sums.is_open = true;
    return sums;
}

// In the order of the list.
@compute @workgroup_size(8, 8)
fn gaussians(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.shade_size_px.x || id.y >= frame.shade_size_px.y {
        return;
    }
    let pixel = vec2i(id.xy) + frame.origin_px;
    let list = gaussian_list(id);
    var sums = no_gaussian_sums();
    for (var at = list.x; at < list.y && sums.is_open; at++) {
        let record = gaussian_lists[at];
        let fragment = gaussian_fragment(record, pixel);
        if fragment.alpha >= 0.0 {
            blend_gaussian(&sums, record, fragment);
        }
    }
    write_gaussians(id.y * frame.shade_size_px.x + id.x, sums);
}

// A fragment that waits until none before it can follow.
struct WaitingGaussian {
    // Fragments are in the order of these: a step of depth, and the place among the scene's.
    key: vec2u,
    record: u32,
    fragment: GaussianFragment,
}

// Fragments that wait at most, a power of two.
const GAUSSIANS_WAITING: u32 = 32u;
const NO_LIMIT: u32 = 0xffffffffu;

fn is_before(a: vec2u, b: vec2u) -> bool {
    return a.x < b.x || (a.x == b.x && a.y < b.y);
}

// In the order of the pixel, exactly. Records come by the depth at which they begin, and what is nearer than that of
// the next is blended. Where more fragments wait than there is room for, the farthest are left for another turn through
// the list, which begins where this one has to end.
@compute @workgroup_size(8, 8)
fn gaussians_by_pixel(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.shade_size_px.x || id.y >= frame.shade_size_px.y {
        return;
    }
    let pixel = vec2i(id.xy) + frame.origin_px;
    let list = gaussian_list(id);
    var sums = no_gaussian_sums();
    // A ring in ascending order.
    var waiting: array<WaitingGaussian, GAUSSIANS_WAITING>;
    var first = vec2u(0u, 0u);
    loop {
        var limit = vec2u(NO_LIMIT, NO_LIMIT);
        var head = 0u;
        var count = 0u;
        for (var at = list.x; at < list.y && sums.is_open; at++) {
            let record = gaussian_lists[at];
            let nearest = gaussian_records[record].nearest;
            let begins = vec2u(depth_step_f32(nearest), 0u);
            if !is_before(begins, limit) {
                break;
            }
            while count > 0u && sums.is_open && is_before(waiting[head % GAUSSIANS_WAITING].key, begins) {
                let next = waiting[head % GAUSSIANS_WAITING];
                blend_gaussian(&sums, next.record, next.fragment);
                head++;
                count--;
            }
            let fragment = gaussian_fragment(record, pixel);
            // Rounding never takes it before where its record begins.
            let key = vec2u(depth_step_f32(max(fragment.z, nearest)), gaussian_records[record].number);
            if fragment.alpha < 0.0 || is_before(key, first) || !is_before(key, limit) {
                continue;
            }
            if count == GAUSSIANS_WAITING {
                let farthest = waiting[(head + count - 1u) % GAUSSIANS_WAITING].key;
                if !is_before(key, farthest) {
                    limit = key;
                    continue;
                }
                limit = farthest;
                count--;
            }
            var place = head + count;
            while place > head && is_before(key, waiting[(place - 1u) % GAUSSIANS_WAITING].key) {
                waiting[place % GAUSSIANS_WAITING] = waiting[(place - 1u) % GAUSSIANS_WAITING];
                place--;
            }
            waiting[place % GAUSSIANS_WAITING] = WaitingGaussian(key, record, fragment);
            count++;
        }
        while count > 0u && sums.is_open {
            let next = waiting[head % GAUSSIANS_WAITING];
            blend_gaussian(&sums, next.record, next.fragment);
            head++;
            count--;
        }
        if !sums.is_open || limit.x == NO_LIMIT {
            break;
        }
        first = limit;
    }
    write_gaussians(id.y * frame.shade_size_px.x + id.x, sums);
}
