// Writes the depth thresholds of a shadow map (rendering model §5) from the visibility pass of a light's view, its
// nearest polygons and its balls.

// Texels of all shadow maps: the buffer `shadow_texels`.
@group(1) @binding(21) var<storage, read_write> shadow_texels_out: array<f32>;

@compute @workgroup_size(8, 8)
fn store_shadow(@builtin(global_invocation_id) id: vec3u) {
    if !is_in_targets(id) {
        return;
    }
    let pixel = vec2i(id.xy);
    let threshold = textureLoad(shade_threshold, pixel, 0);
    var z = frame.empty_depth;
    if threshold > 0.0 {
        z = frame.projection.near / threshold;
    }
    let hit = polygon_hit(pixel);
    if hit.x > 0.0 {
        let p = polygons[u32(hit.y) - 1u];
        let gradient = triangle_gradient(triangle_of(p), p.z, hit.x, offset_on(p, pixel));
        z = min(z, hit.x + slope_allowance(hit.x, gradient, frame.projection));
    }
    z = ball_shadow(z, pixel);
    let texel = vec2u(pixel + frame.origin_px);
    shadow_texels_out[frame.shadow_at + texel.y * frame.shadow_side + texel.x] = z;
}
