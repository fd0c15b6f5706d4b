// Compositing of transparent layers (rendering model §8), once per pixel and layer: shades a layer's sums and
// composites them under the layers before it.

// Composited layers of each pixel of the targets, row by row.
@group(1) @binding(14) var<storage, read_write> layer_composites: array<LayerComposite>;
// Sums of the current layer, like `color_sums`, `surface_sums` and `material_sums`.
@group(1) @binding(16) var layer_color: texture_2d<f32>;
@group(1) @binding(17) var layer_surface: texture_2d<f32>;
@group(1) @binding(18) var layer_material: texture_2d<f32>;
// Number of fragments, and Σw·alpha, of a peeled layer or the layer `remaining`.
@group(1) @binding(19) var layer_counts: texture_2d<f32>;
// Number of fragments, Σw·alpha and coverage of a layer of an A-buffer.
@group(1) @binding(30) var layer_coverage: texture_2d<f32>;
// Depth buffer of the layer's visibility pass: its reversed depth threshold, 0 without one.
@group(1) @binding(20) var layer_threshold: texture_depth_2d;

// Arguments of an indirect draw of records, in the layout of the graphics API.
struct DrawArguments {
    vertices: u32,
    instances: u32,
    first_vertex: u32,
    first_instance: u32,
}

// Indirect draws of the records of each segment and of splats that reach the near plane. All layers use those of
// transparent splats. The instance counts become 0 after the first layer without fragments.
struct LayerDraws {
    // 1 if any pixel has a depth threshold in the current layer. Where a pixel has none, no fragment can lie behind the
    // layer.
    any_remaining: atomic<u32>,
    // Number of layers drawn, including the current one.
    drawn: u32,
    arguments: array<DrawArguments>,
}

@group(1) @binding(22) var<storage, read_write> layer_draws: LayerDraws;

// True if an invocation has a pixel of the targets.
fn is_in_targets(id: vec3u) -> bool {
    return id.x < frame.size_px.x && id.y < frame.size_px.y;
}

// Starts the layers of each pixel, behind no layer and before the pixel's opaque surface.
@compute @workgroup_size(8, 8)
fn begin_layers(@builtin(global_invocation_id) id: vec3u) {
    if is_in_targets(id) {
        begin_pixel_layers(id, 0.0);
    }
}

// Depth buffer of the embedding application, of the size of the shaded region.
@group(1) @binding(23) var host_depths: texture_depth_2d;

// Returns 1/z of the application's geometry at a pixel of the shaded region, or z itself in an orthographic projection.
fn host_depth_along(at: vec2i) -> f32 {
    return (textureLoad(host_depths, at, 0) - frame.host_depth.x) / frame.host_depth.y;
}

// Starts the layers like begin_layers. The application's depth buffer also occludes the transparent splats behind it.
@compute @workgroup_size(8, 8)
fn begin_layers_in_host(@builtin(global_invocation_id) id: vec3u) {
    if !is_in_targets(id) {
        return;
    }
    let at = vec2i(id.xy) - vec2i(frame.shade_origin_px);
    var occluder_depth = 0.0;
    if all(vec2i(0, 0) <= at) && all(at < vec2i(frame.shade_size_px)) {
        let along = host_depth_along(at);
        occluder_depth = max(frame.projection.near * along, 0.0);
        if frame.projection.kind == ORTHOGRAPHIC {
            occluder_depth = reversed_depth(max(along, frame.projection.near));
        }
    }
    begin_pixel_layers(id, occluder_depth);
}

// Starts the layers of an invocation's pixel. Fragments behind the reversed depth `occluder_depth`, or behind the
// opaque surface, aren't drawn.
fn begin_pixel_layers(id: vec3u, occluder_depth: f32) {
    let pixel = vec2i(id.xy);
    var layers: LayerComposite;
    // Reversed depths are at most 1, so every fragment lies behind 2.
    layers.peeled_depth = 2.0;
    let sums = textureLoad(color_sums, pixel, 0);
    if LEAST_WEIGHT <= sums.w {
        layers.opaque_depth = reversed_depth(textureLoad(surface_sums, pixel, 0).w / sums.w * frame.depth_unit);
    }
    let hit = polygon_hit(pixel);
    if polygon_is_visible(pixel, hit) {
        layers.opaque_depth = max(layers.opaque_depth, reversed_depth(hit.x));
    }
    layers.opaque_depth = max(layers.opaque_depth, occluder_depth);
    if frame.has_balls != 0u {
        let z = full_ball_depth(pixel);
        if z < frame.empty_depth {
            layers.opaque_depth = max(layers.opaque_depth, reversed_depth(z));
        }
        put_last_ball(pixel, BallFragment(0.0, 0.0, 0u));
    }
    layer_composites[id.y * frame.size_px.x + id.x] = layers;
}

// Composites a layer, with its surface point, lit colour and alpha, behind the layers before it (Porter and Duff's
// "under"). Front-to-back compositing gives the same result as "over" from back to front.
fn composite_under(layers: LayerComposite, point: Point, color: vec3f, alpha: f32) -> LayerComposite {
    var more = layers;
    let through = 1.0 - layers.opacity;
    more.color += color * (alpha * through);
    more.opacity = 1.0 - through * (1.0 - alpha);
    more.counts += 1u << LAYER_COUNT;
    if layers.z <= 0.0 {
        more.normal = point.normal;
        more.z = point.z;
        more.weight = point.weight;
    }
    return more;
}

// Returns the surface point of the current layer at a pixel.
fn layer_point(pixel: vec2i) -> Point {
    let material = textureLoad(layer_material, pixel, 0);
    return point_of(textureLoad(layer_color, pixel, 0), textureLoad(layer_surface, pixel, 0), material);
}

// Composites a layer of depth peeling.
@compute @workgroup_size(8, 8)
fn peeled_layer(@builtin(global_invocation_id) id: vec3u) {
    if is_in_targets(id) {
        composite_layer(id, textureLoad(layer_counts, vec2i(id.xy), 0).xy, 1.0);
    }
}

// Composites a layer of an A-buffer: one surface, whose alpha is multiplied by its coverage.
@compute @workgroup_size(8, 8)
fn gathered_layer(@builtin(global_invocation_id) id: vec3u) {
    if is_in_targets(id) {
        let counts = textureLoad(layer_coverage, vec2i(id.xy), 0);
        composite_layer(id, counts.xy, min(counts.z / frame.full_coverage, 1.0));
    }
}

// Composites the current layer of an invocation's pixel. `counts` are its number of fragments and Σw·alpha. The layer
// covers the fraction `share` of the pixel.
fn composite_layer(id: vec3u, counts: vec2f, share: f32) {
    let pixel = vec2i(id.xy);
    let at = id.y * frame.size_px.x + id.x;
    var layers = layer_composites[at];
    let point = layer_point(pixel);
    if point.is_there {
        let color = color_of(position_at(pixel, point.z), point, true);
        layers = composite_under(balls_under(layers, pixel, point.z), point, color, counts.y / point.weight * share);
    }
    layers.counts += u32(counts.x);
    // A threshold of 0 means that no fragments remain behind the layer.
    layers.peeled_depth = textureLoad(layer_threshold, pixel, 0);
    layer_composites[at] = layers;
    if layers.peeled_depth > 0.0 && atomicLoad(&layer_draws.any_remaining) == 0u {
        atomicStore(&layer_draws.any_remaining, 1u);
    }
}

// Runs between two layers. If the layer just drawn has no fragments, sets the instance counts of all draws to 0;
// otherwise counts the next layer.
@compute @workgroup_size(8, 8)
fn next_layer(@builtin(global_invocation_id) id: vec3u) {
    if id.x + id.y > 0u {
        return;
    }
    if atomicExchange(&layer_draws.any_remaining, 0u) != 0u {
        layer_draws.drawn += 1u;
        return;
    }
    for (var i = 0u; i < arrayLength(&layer_draws.arguments); i++) {
        layer_draws.arguments[i].instances = 0u;
    }
}

// Composites the layer `remaining`, whose splats were lit one by one.
@compute @workgroup_size(8, 8)
fn remaining_layer(@builtin(global_invocation_id) id: vec3u) {
    if !is_in_targets(id) {
        return;
    }
    let pixel = vec2i(id.xy);
    let at = id.y * frame.size_px.x + id.x;
    var layers = layer_composites[at];
    let counts = textureLoad(layer_counts, pixel, 0).xy;
    let point = layer_point(pixel);
    if point.is_there {
        // The splats were lit before they were summed, so the sum of colours is that of lit colours.
        let color = limit_rgb(textureLoad(layer_color, pixel, 0).rgb / point.weight);
        layers = composite_under(balls_under(layers, pixel, point.z), point, color, counts.y / point.weight);
    }
    layers.counts += u32(counts.x);
    layer_composites[at] = layers;
}
