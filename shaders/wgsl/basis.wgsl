// Directions and orthonormal bases. Twin: surfel-math, basis.rs.

// Returns v scaled to unit length at any magnitude; zero stays zero.
fn unit(v: vec3f) -> vec3f {
    let largest = v3_max_abs(v);
    let scaled = v * (1.0 / select(1.0, largest, 0.0 < largest));
    let length = v3_length(scaled);
    return scaled * (1.0 / select(1.0, length, 0.0 < length));
}

// Half-axes s and t of a splat, or two orthonormal vectors.
struct Pair {
    s: vec3f,
    t: vec3f,
}

// Returns two orthonormal vectors s and t with s × t = n, a unit normal. Source: Duff et al. 2017.
fn orthonormal(n: vec3f) -> Pair {
    let side = select(1.0, -1.0, n.z < 0.0);
    let a = -1.0 / (side + n.z);
    let b = n.x * n.y * a;
    let s = vec3f(fma(side * n.x * n.x, a, 1.0), side * b, -side * n.x);
    return Pair(s, vec3f(b, fma(n.y * n.y, a, side), -n.y));
}

// Decodes two octahedral coordinates, each from −1 to 1, to a direction, which isn't of unit length. Twin: surfel-math,
// quantise.rs.
fn unfolded(x: f32, y: f32) -> vec3f {
    let z = 1.0 - abs(x) - abs(y);
    let below = max(-z, 0.0);
    return vec3f(x + select(-below, below, x < 0.0), y + select(-below, below, y < 0.0), z);
}
