// Triangles over pixels (rendering model §6). Twin: surfel-math, triangle.rs, which also makes the edges, in f64.
//
// Source: Olano and Greer 1997, edges from homogeneous coordinates: nothing is clipped.

// A triangle prepared for rasterisation, over pixel offsets from an anchor.
struct Triangle {
    // Linear form of the edge opposite each vertex, positive inside the triangle. Its value is the vertex's barycentric
    // coordinate times a positive factor that all three share.
    edges: array<Linear, 3>,
    // Planar depths of the vertices, in world units.
    z: vec3f,
}

// True if the pixel centre at offset d is inside the edge with the form e. A centre exactly on an edge belongs to the
// triangle below or to the right of it.
fn edge_covers(e: Linear, d: vec2f) -> bool {
    let value = linear_at(e, d);
    let right_of = 0.0 < e.x || (!(e.x < 0.0) && 0.0 < e.y);
    return 0.0 < value || (!(value < 0.0) && right_of);
}

// True if a triangle covers the pixel centre at offset d.
fn triangle_contains(t: Triangle, d: vec2f) -> bool {
    return edge_covers(t.edges[0], d) && edge_covers(t.edges[1], d) && edge_covers(t.edges[2], d);
}

// Returns the perspective-correct barycentric coordinates of the triangle's point at pixel offset d. They sum to 1.
fn triangle_barycentric(t: Triangle, d: vec2f) -> vec3f {
    let values = vec3f(linear_at(t.edges[0], d), linear_at(t.edges[1], d), linear_at(t.edges[2], d));
    return values * (1.0 / (values.x + values.y + values.z));
}

// Returns the planar depth of the point with these barycentric coordinates.
fn triangle_depth(t: Triangle, barycentric: vec3f) -> f32 {
    return interpolate(barycentric, t.z);
}

// Returns the change of an attribute over a pixel to the right and over a pixel down, at pixel offset d. `values` are
// the attribute's values at the vertices, `value` is the one at d.
fn triangle_gradient(t: Triangle, values: vec3f, value: f32, d: vec2f) -> vec2f {
    let inverse = 1.0 / (linear_at(t.edges[0], d) + linear_at(t.edges[1], d) + linear_at(t.edges[2], d));
    let apart = values - value;
    return vec2f(
        interpolate(apart, vec3f(t.edges[0].x, t.edges[1].x, t.edges[2].x)) * inverse,
        interpolate(apart, vec3f(t.edges[0].y, t.edges[1].y, t.edges[2].y)) * inverse,
    );
}

// Interpolates the values a of an attribute at the vertices by barycentric coordinates b: Σ b·a.
fn interpolate(b: vec3f, a: vec3f) -> f32 {
    return fma(b.x, a.x, fma(b.y, a.y, b.z * a.z));
}
