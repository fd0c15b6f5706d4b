// Attributes of a polygon at a pixel: interpolated vertex attributes, and textures sampled by the rules of surfel-model
// (rendering model §6).

// Polygons of the tile: the buffer `drawn_polygons`.
@group(1) @binding(12) var<storage, read> polygons: array<Polygon>;
// Textures of all polygons; TEXTURE_HEADER describes the layout.
@group(1) @binding(13) var<storage, read> texels: array<u32>;

// Returns the linear colour of texel number `index`, row by row, of a texture level whose words begin at `at`. Level 0,
// the full size, stores bytes; smaller levels store f32.
fn texel_of(at: u32, level: u32, index: u32) -> vec3f {
    if level == 0u {
        let bytes = texels[at + index];
        return vec3f(
            bitcast<f32>(texels[bytes & 0xffu]),
            bitcast<f32>(texels[(bytes >> 8u) & 0xffu]),
            bitcast<f32>(texels[(bytes >> 16u) & 0xffu]),
        );
    }
    let first = at + 3u * index;
    return vec3f(bitcast<f32>(texels[first]), bitcast<f32>(texels[first + 1u]), bitcast<f32>(texels[first + 2u]));
}

// Returns a bilinear sample, with repeat addressing, of a texture level whose words start at `at` and whose width and
// height are `size`. `uv` are texture coordinates; [0, 1] spans the texture.
fn bilinear(at: u32, level: u32, size: vec2u, uv: vec2f) -> vec3f {
    let p = (uv - floor(uv)) * vec2f(size) - 0.5;
    let whole = floor(p);
    let f = p - whole;
    let n = vec2i(size);
    // The coordinate is at least −1 before it wraps around.
    let low = vec2u((vec2i(whole) + n) % n);
    let high = (low + 1u) % size;
    let top = low.y * size.x;
    let bottom = high.y * size.x;
    let upper = texel_of(at, level, top + low.x) * (1.0 - f.x) + texel_of(at, level, top + high.x) * f.x;
    let lower = texel_of(at, level, bottom + low.x) * (1.0 - f.x) + texel_of(at, level, bottom + high.x) * f.x;
    return upper * (1.0 - f.y) + lower * f.y;
}

// Returns a trilinear sample of a texture. `footprint` is the larger of the distances, in texels of the full size, that
// the texture coordinates `uv` cover over one pixel to the right and one down.
fn texture_color(texture_at: u32, uv: vec2f, footprint: f32) -> vec3f {
    let levels = texels[texture_at + 2u];
    let level = min(log2(max(footprint, 1.0)), f32(levels));
    let lower = u32(level);
    let share = level - f32(lower);
    var size = vec2u(texels[texture_at], texels[texture_at + 1u]);
    var at = texture_at + TEXTURE_HEADER;
    for (var i = 0u; i < lower; i++) {
        at += size.x * size.y * select(3u, 1u, i == 0u);
        size = max(size / 2u, vec2u(1u, 1u));
    }
    let fine = bilinear(at, lower, size, uv);
    if share == 0.0 {
        return fine;
    }
    at += size.x * size.y * select(3u, 1u, lower == 0u);
    let coarse = bilinear(at, lower + 1u, max(size / 2u, vec2u(1u, 1u)), uv);
    return fine + (coarse - fine) * share;
}

// Returns the attributes of the polygon that a pixel hits, at the pixel's centre. `hit` is the pixel's PolygonHit.hit.
fn polygon_point(hit: vec2f, pixel: vec2i) -> Point {
    let p = polygons[u32(hit.y) - 1u];
    let shape = triangle_of(p);
    let d = offset_on(p, pixel);
    let b = triangle_barycentric(shape, d);
    var albedo = p.color0 * b.x + p.color1 * b.y + p.color2 * b.z;
    if p.texture_at != ABSENT {
        let u = interpolate(b, p.u);
        let v = interpolate(b, p.v);
        let du = triangle_gradient(shape, p.u, u, d) * f32(texels[p.texture_at]);
        let dv = triangle_gradient(shape, p.v, v, d) * f32(texels[p.texture_at + 1u]);
        let footprint = max(v2_length(vec2f(du.x, dv.x)), v2_length(vec2f(du.y, dv.y)));
        albedo *= texture_color(p.texture_at, vec2f(u, v), footprint);
    }
    var normal = unit(p.normal0 * b.x + p.normal1 * b.y + p.normal2 * b.z);
    if v3_dot(normal, normal) <= 0.0 {
        normal = p.flat_normal;
    }
    return Point(albedo, normal, p.material, hit.x, 0.0, true);
}
