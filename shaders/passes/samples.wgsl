// Edge antialiasing by samples (rendering model §5): selects the pixels to sample, and averages their samples. Samples
// are the pixels of an image four times as wide and high. They are drawn part by part into the same targets, as frames
// of samples.

// Smallest depth threshold, z + ε, of a pixel's transparent splats, and the ε of the splat that defines it; zeros
// without one.
@group(1) @binding(24) var layer_tolerance: texture_2d<f32>;
// Result of `steps_fragment` for the tile of pixels: 1 for a sampled pixel, else 0; and the depth that the pixel shows,
// for shaders that read neighbours.
@group(1) @binding(25) var pixel_steps: texture_2d<f32>;

// Depth interval, in world units, that contains a pixel's nearest surface. Both ends are +∞ without a surface.
struct Reach {
    begin: f32,
    end: f32,
}

// What two neighbouring pixels compare to find a step.
struct PixelReach {
    opaque_surface: Reach,
    nearest_layer: Reach,
    // Number of transparent layers with fragments.
    layers: u32,
}

// Returns the depth interval of splats with a depth threshold z + ε and an ε: the threshold ∓ ε. A threshold of 0 means
// no splats.
fn reach_of(threshold_tolerance: vec2f) -> Reach {
    if threshold_tolerance.x <= 0.0 {
        return Reach(frame.empty_depth, frame.empty_depth);
    }
    return Reach(
        threshold_tolerance.x - threshold_tolerance.y,
        threshold_tolerance.x + threshold_tolerance.y,
    );
}

// Returns the depth interval of a pixel's nearest opaque surface, splats or a polygon.
fn opaque_reach(pixel: vec2i) -> Reach {
    let threshold = textureLoad(threshold_tolerance, pixel, 0).xy;
    var reach = reach_of(threshold);
    let hit = polygon_hit(pixel);
    if hit.x <= 0.0 {
        // If only one of the filtered and the unfiltered footprints has a fragment here, the surface ends: every
        // neighbour is then a step.
        let has_weight = LEAST_WEIGHT <= textureLoad(color_sums, pixel, 0).w;
        if has_weight != (threshold.x > 0.0) {
            reach.end = -frame.empty_depth;
        }
        return reach;
    }
    if reach.begin <= hit.x {
        return reach;
    }
    let p = polygons[u32(hit.y) - 1u];
    let gradient = triangle_gradient(triangle_of(p), p.z, hit.x, offset_on(p, pixel));
    return Reach(hit.x, hit.x + step_allowance(hit.x, gradient, frame.projection));
}

// Returns the depth intervals and the number of layers of a pixel.
fn pixel_reach(pixel: vec2i) -> PixelReach {
    var reach = PixelReach(opaque_reach(pixel), reach_of(vec2f(0.0, 0.0)), 0u);
    if frame.has_layers != 0u {
        reach.nearest_layer = reach_of(textureLoad(layer_tolerance, pixel, 0).xy);
        reach.layers = host_layers_at(pixel).counts >> LAYER_COUNT;
    }
    return reach;
}

// True if one interval lies behind the other: the pixels show different surfaces.
fn steps_to(a: Reach, b: Reach) -> bool {
    return b.begin > a.end || a.begin > b.end;
}

// True if there is a step between two neighbouring pixels, which are then both sampled.
fn is_step(a: PixelReach, b: PixelReach) -> bool {
    return steps_to(a.opaque_surface, b.opaque_surface)
        || steps_to(a.nearest_layer, b.nearest_layer)
        || a.layers != b.layers;
}

// Writes `pixel_steps` for each pixel: compares the pixel with the four neighbours that share a side with it.
@fragment
fn steps_fragment(@builtin(position) position: vec4f) -> @location(0) vec2f {
    let pixel = vec2i(floor(position.xy));
    let last = vec2i(frame.size_px) - 1;
    let own = pixel_reach(pixel);
    var is_sampled = false;
    for (var i = 0u; i < 4u; i++) {
        let along = select(-1, 1, (i & 1u) != 0u);
        let at = pixel + select(vec2i(along, 0), vec2i(0, along), (i & 2u) != 0u);
        if all(vec2i(0, 0) <= at) && all(at <= last) {
            is_sampled = is_sampled || is_step(own, pixel_reach(at));
        }
    }
    var z = 0.0;
    if frame.has_outlines != 0u || frame.has_eye_dome != 0u {
        z = front_depth(pixel);
    }
    return vec2f(select(0.0, 1.0, is_sampled), z);
}

// Returns the colour of the opaque surface of the sample `at`, which belongs to `pixel`. The colour includes the
// effects of shaders that read the pixel's neighbours.
fn among_neighbours(at: vec2i, surface: Surface, pixel: vec2i) -> vec3f {
    let is_toon = frame.shader_kind == SHADER_TOON;
    if !is_toon && frame.shader_kind != SHADER_EDL {
        return surface.color;
    }
    // Distances between neighbours are measured in pixels of the image, not in samples.
    var projection = frame.projection;
    projection.focal_px *= 1.0 / f32(SAMPLES_SIDE);
    let limit = outline_limit(at, surface, projection);
    let reach = select(EYE_DOME_REACH, 1, is_toon);
    var line = false;
    var rise = 0.0;
    for (var j = -1; j <= 1; j++) {
        for (var i = -1; i <= 1; i++) {
            let offset = vec2i(i, j) * reach;
            let beside = pixel + offset;
            if (i == 0 && j == 0) || any(beside < vec2i(0, 0)) || any(beside >= vec2i(frame.pixels_size_px)) {
                continue;
            }
            let z = textureLoad(pixel_steps, beside, 0).y;
            line = line || z > limit;
            rise += eye_dome_rise_weight(vec2f(offset), projection) * select(0.0, surface.z - z, z < surface.z);
        }
    }
    if is_toon {
        return select(surface.color, vec3f(0.0, 0.0, 0.0), line);
    }
    return surface.color * eye_dome_brightness(surface.z, rise, projection);
}

// Returns the premultiplied colour of the sample `at`, which belongs to `pixel`, without transparent layers and balls.
fn sample_color(at: vec2i, opaque: Pixel, pixel: vec2i) -> vec4f {
    if opaque.front.is_there {
        return vec4f(among_neighbours(at, opaque.front, pixel), 1.0);
    }
    return opaque.color;
}

// Writes the colours of sampled pixels, the means of their samples. Each pixel whose samples are in the targets has an
// invocation.
@compute @workgroup_size(8, 8)
fn resolve_samples(@builtin(global_invocation_id) id: vec3u) {
    if any(id.xy >= frame.size_px / SAMPLES_SIDE) {
        return;
    }
    let pixel = id.xy + frame.first_pixel;
    if textureLoad(pixel_steps, vec2i(pixel), 0).x <= 0.0 {
        return;
    }
    var sum = vec4f(0.0, 0.0, 0.0, 0.0);
    for (var i = 0u; i < SAMPLES_SIDE * SAMPLES_SIDE; i++) {
        let at = vec2i(id.xy * SAMPLES_SIDE + vec2u(i % SAMPLES_SIDE, i / SAMPLES_SIDE));
        let color = sample_color(at, shaded_pixel(at, frame.background, true), vec2i(pixel));
        var layers: LayerComposite;
        if frame.has_layers != 0u {
            layers = layer_composites[u32(at.y) * frame.size_px.x + u32(at.x)];
        }
        // Each colour is scaled before it is added, because colours may be as large as the largest f32.
        sum += composite_over(layers, color) * (1.0 / f32(SAMPLES_SIDE * SAMPLES_SIDE));
    }
    let shaded = pixel - frame.shade_origin_px;
    write_color(shaded.y * frame.shade_size_px.x + shaded.x, sum);
}
