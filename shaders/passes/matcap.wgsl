// The shader `matcap` (rendering model §5): looks up an image of a lit sphere by the normal.

// Width and height of the image, then its linear RGB texels, three f32 each, row by row from the top. A single word if
// the frame has another shader.
@group(0) @binding(5) var<storage, read> matcap: array<u32>;

// Returns the colour of the texel at a column and row.
fn matcap_texel(at: vec2u, width: u32) -> vec3f {
    let first = 2u + 3u * (at.y * width + at.x);
    return vec3f(bitcast<f32>(matcap[first]), bitcast<f32>(matcap[first + 1u]), bitcast<f32>(matcap[first + 2u]));
}

// Returns the image's colour at the point of the sphere with this unit normal, bilinearly interpolated. The sphere's
// rim lies on the centres of the outermost texels. Directions are in world axes.
fn matcap_color(normal: vec3f, to_eye: vec3f) -> vec3f {
    let on_sphere = matcap_coordinates(normal, to_eye, frame.world_from_view[1]);
    let last = vec2u(matcap[0] - 1u, matcap[1] - 1u);
    let at = clamp(on_sphere * 0.5 + 0.5, vec2f(0.0, 0.0), vec2f(1.0, 1.0)) * vec2f(last);
    let low = min(vec2u(at), last);
    let high = min(low + 1u, last);
    let f = at - vec2f(low);
    let width = matcap[0];
    let upper = matcap_texel(low, width) * (1.0 - f.x) + matcap_texel(vec2u(high.x, low.y), width) * f.x;
    let lower = matcap_texel(vec2u(low.x, high.y), width) * (1.0 - f.x) + matcap_texel(high, width) * f.x;
    return upper * (1.0 - f.y) + lower * f.y;
}
