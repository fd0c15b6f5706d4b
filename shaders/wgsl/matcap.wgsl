// Lookup coordinates of a normal on an image of a lit sphere (rendering model §5). Twin: surfel-math, matcap.rs.

// Returns the coordinates of a unit normal on the image: (0, 0) faces the eye, x points right and y down, and the rim
// is at distance 1. `to_eye` is the unit direction to the eye, and `down` the view's y axis.
fn matcap_coordinates(normal: vec3f, to_eye: vec3f, down: vec3f) -> vec2f {
    let across = v3_cross(to_eye, down);
    let length = v3_length(across);
    let x = across * (1.0 / select(1.0, length, 0.0 < length));
    let y = v3_cross(x, to_eye);
    return vec2f(v3_dot(normal, x), v3_dot(normal, y));
}
