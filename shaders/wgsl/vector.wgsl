// Products of small vectors with a fixed order of operations, unlike WGSL's own dot, cross and length. Twin:
// surfel-math, vector.rs.

// Returns a.x·b.x + a.y·b.y.
fn v2_dot(a: vec2f, b: vec2f) -> f32 {
    return sum_of_products(a.x, b.x, a.y, b.y);
}

// Returns a.x·b.y − a.y·b.x.
fn v2_cross(a: vec2f, b: vec2f) -> f32 {
    return difference_of_products(a.x, b.y, a.y, b.x);
}

fn v2_length(a: vec2f) -> f32 {
    return sqrt(v2_dot(a, a));
}

fn v3_dot(a: vec3f, b: vec3f) -> f32 {
    return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z));
}

fn v3_cross(a: vec3f, b: vec3f) -> vec3f {
    return vec3f(
        difference_of_products(a.y, b.z, a.z, b.y),
        difference_of_products(a.z, b.x, a.x, b.z),
        difference_of_products(a.x, b.y, a.y, b.x),
    );
}

fn v3_length(a: vec3f) -> f32 {
    return sqrt(v3_dot(a, a));
}

// Returns the largest absolute value of a coordinate.
fn v3_max_abs(a: vec3f) -> f32 {
    return max(max(abs(a.x), abs(a.y)), abs(a.z));
}
