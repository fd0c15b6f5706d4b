// Where on an image of a lit sphere a normal lies (rendering model §5). Twin: surfel-math, matcap.rs.

// (0, 0) faces the eye, x to the right and y down, 1 at the rim.
fn matcap_coordinates(normal: vec3f, to_eye: vec3f, down: vec3f) -> vec2f {
    let across = v3_cross(to_eye, down);
    let length = v3_length(across);
    let x = across * (1.0 / select(1.0, length, 0.0 < length));
    let y = v3_cross(x, to_eye);
    return vec2f(v3_dot(normal, x), v3_dot(normal, y));
}
