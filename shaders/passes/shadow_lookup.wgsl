// Shadow map lookup (rendering model §5): returns the fraction of a light that reaches a point.

// A shadow map: the view of a light, and the location of the map's texels.
struct ShadowMap {
    view_from_world: mat3x3f,
    // Vector from the eye of the map's view (the light) to the eye of the image, in world axes.
    eye: vec3f,
    // Index of the map's first texel in `shadow_texels`.
    texels_at: u32,
    @align(16) projection: Projection,
}

// Shadow maps of all lights, in the order of the lights.
@group(0) @binding(3) var<storage, read> shadow_maps: array<ShadowMap>;
// Depth threshold of each texel, in world units, row by row. A point is lit in a texel if its depth, less the lookup's
// bias, is at most the threshold; +∞ where nothing casts a shadow.
@group(0) @binding(4) var<storage, read> shadow_texels: array<f32>;

// Returns the fraction of a light, 0 to 1, that reaches a point according to one map. The point p and the unit normal
// of its surface are in the map's view space. A point nearer than the map's near plane is lit.
fn map_visibility(map: ShadowMap, p: vec3f, normal: vec3f) -> f32 {
    let projection = map.projection;
    if p.z < projection.near {
        return 1.0;
    }
    let slope = select(p.xy / p.z, p.xy, projection.kind == ORTHOGRAPHIC);
    let at = slope * projection.focal_px + projection.principal_px;
    let gradient = plane_gradient(p, normal, projection);
    let columns = taps(at.x);
    let rows = taps(at.y);
    let nearer = p.z - lookup_bias(p.z, projection);
    let side = f32(frame.shadow_side);
    var share = 0.0;
    for (var j = 0u; j < 4u; j++) {
        for (var i = 0u; i < 4u; i++) {
            let tap = vec2f(columns.first + f32(i), rows.first + f32(j));
            let z = nearer + v2_dot(gradient, tap + 0.5 - at);
            // Outside of the map nothing casts a shadow.
            var lit_up_to = frame.empty_depth;
            if 0.0 <= tap.x && tap.x < side && 0.0 <= tap.y && tap.y < side {
                lit_up_to = shadow_texels[map.texels_at + u32(tap.y) * frame.shadow_side + u32(tap.x)];
            }
            share += select(0.0, columns.weights[i] * rows.weights[j], z <= lit_up_to);
        }
    }
    return share;
}

// Returns the fraction of a light, 0 to 1, that reaches a point. `position` is relative to the eye and, like the unit
// normal, in world axes.
fn light_visibility(light: Light, position: vec3f, normal: vec3f) -> f32 {
    if light.map_count == 0u {
        return 1.0;
    }
    // If several maps contain the point, the map along whose axis the point lies farthest is used.
    var best = light.first_map;
    var p = vec3f(0.0, 0.0, 0.0);
    for (var i = 0u; i < light.map_count; i++) {
        let map = light.first_map + i;
        let seen = shadow_maps[map].view_from_world * (position + shadow_maps[map].eye);
        if i == 0u || p.z <= seen.z {
            best = map;
            p = seen;
        }
    }
    return map_visibility(shadow_maps[best], p, shadow_maps[best].view_from_world * normal);
}
