// Once a pixel and layer (rendering model §8): shade what a layer summed up, and put it behind the layers before it.

@group(1) @binding(14) var<storage, read_write> veils: array<Veil>;
@group(1) @binding(16) var layer_color: texture_2d<f32>;
@group(1) @binding(17) var layer_surface: texture_2d<f32>;
@group(1) @binding(18) var layer_material: texture_2d<f32>;
// Number of fragments, and Σw·alpha.
@group(1) @binding(19) var layer_counts: texture_2d<f32>;
@group(1) @binding(20) var layer_kept: texture_depth_2d;

// A draw of transparent splats, as indirect drawing reads it.
struct DrawArguments {
    vertices: u32,
    instances: u32,
    first_vertex: u32,
    first_instance: u32,
}

// What the layers' draws are to do, so that none is drawn behind the last that has anything.
struct LayerDraws {
    // Some pixel keeps something of the current layer: only then is there anything behind it.
    remains: atomic<u32>,
    // Layers that were drawn, the current one included.
    drawn: u32,
    arguments: array<DrawArguments>,
}

@group(1) @binding(22) var<storage, read_write> layer_draws: LayerDraws;

fn is_in_targets(id: vec3u) -> bool {
    return id.x < frame.size_px.x && id.y < frame.size_px.y;
}

@compute @workgroup_size(8, 8)
fn begin_layers(@builtin(global_invocation_id) id: vec3u) {
    if is_in_targets(id) {
        begin_veil(id, 0.0);
    }
}

// A host's depth buffer, of the size of what is shaded.
@group(1) @binding(23) var host_depths: texture_depth_2d;

// The same among a host's own things, which hide transparent splats behind them.
@compute @workgroup_size(8, 8)
fn begin_layers_in_host(@builtin(global_invocation_id) id: vec3u) {
    if !is_in_targets(id) {
        return;
    }
    let at = vec2i(id.xy) - vec2i(frame.shade_origin_px);
    var hidden_from = 0.0;
    if all(vec2i(0, 0) <= at) && all(at < vec2i(frame.shade_size_px)) {
        let along = (textureLoad(host_depths, at, 0) - frame.host_depth.x) / frame.host_depth.y;
        // 1/z, or z itself.
        hidden_from = max(frame.projection.near * along, 0.0);
        if frame.projection.kind == ORTHOGRAPHIC {
            hidden_from = comparable(max(along, frame.projection.near));
        }
    }
    begin_veil(id, hidden_from);
}

// Nothing is seen behind the comparable depth `hidden_from`.
fn begin_veil(id: vec3u, hidden_from: f32) {
    let pixel = vec2i(id.xy);
    var veil: Veil;
    // Nothing is as near as that.
    veil.beyond = 2.0;
    let sums = textureLoad(color_sums, pixel, 0);
    if LEAST_WEIGHT <= sums.w {
        veil.opaque = comparable(textureLoad(surface_sums, pixel, 0).w / sums.w * frame.depth_unit);
    }
    let hit = polygon_hit(pixel);
    if is_shown(pixel, hit) {
        veil.opaque = max(veil.opaque, comparable(hit.x));
    }
    veil.opaque = max(veil.opaque, hidden_from);
    veils[id.y * frame.size_px.x + id.x] = veil;
}

// The same as blending back to front.
fn put_behind(veil: Veil, point: Point, color: vec3f, alpha: f32) -> Veil {
    var more = veil;
    let through = 1.0 - veil.opacity;
    more.color += color * (alpha * through);
    more.opacity = 1.0 - through * (1.0 - alpha);
    if veil.z <= 0.0 {
        more.normal = point.normal;
        more.z = point.z;
        more.weight = point.weight;
    }
    return more;
}

fn layer_point(pixel: vec2i) -> Point {
    let material = textureLoad(layer_material, pixel, 0);
    return point_of(textureLoad(layer_color, pixel, 0), textureLoad(layer_surface, pixel, 0), material);
}

@compute @workgroup_size(8, 8)
fn peeled_layer(@builtin(global_invocation_id) id: vec3u) {
    if !is_in_targets(id) {
        return;
    }
    let pixel = vec2i(id.xy);
    let at = id.y * frame.size_px.x + id.x;
    var veil = veils[at];
    let counts = textureLoad(layer_counts, pixel, 0).xy;
    let point = layer_point(pixel);
    if point.is_there {
        veil = put_behind(veil, point, color_of(position_at(pixel, point.z), point, true), counts.y / point.weight);
    }
    veil.fragments += counts.x;
    // Where nothing is kept the layer took all that remained.
    veil.beyond = textureLoad(layer_kept, pixel, 0);
    veils[at] = veil;
    if veil.beyond > 0.0 && atomicLoad(&layer_draws.remains) == 0u {
        atomicStore(&layer_draws.remains, 1u);
    }
}

// Between two layers, once: no splat is drawn any more where nothing remains.
@compute @workgroup_size(8, 8)
fn next_layer(@builtin(global_invocation_id) id: vec3u) {
    if id.x + id.y > 0u {
        return;
    }
    if atomicExchange(&layer_draws.remains, 0u) != 0u {
        layer_draws.drawn += 1u;
        return;
    }
    for (var i = 0u; i < arrayLength(&layer_draws.arguments); i++) {
        layer_draws.arguments[i].instances = 0u;
    }
}

@compute @workgroup_size(8, 8)
fn remaining_layer(@builtin(global_invocation_id) id: vec3u) {
    if !is_in_targets(id) {
        return;
    }
    let pixel = vec2i(id.xy);
    let at = id.y * frame.size_px.x + id.x;
    var veil = veils[at];
    let counts = textureLoad(layer_counts, pixel, 0).xy;
    let point = layer_point(pixel);
    if point.is_there {
        // Lit splat by splat before it was summed.
        let color = textureLoad(layer_color, pixel, 0).rgb / point.weight;
        veil = put_behind(veil, point, color, counts.y / point.weight);
    }
    veil.fragments += counts.x;
    veils[at] = veil;
}
