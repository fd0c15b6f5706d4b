// The pixels that a footprint can touch (rendering model §3): conservative and tight. Twin: surfel-math, bounds.rs.

// A box of pixel offsets from an anchor, such as a splat's projected centre: smallest and greatest offset to the right
// (x) and down (y).
struct Extent {
    least: vec2f,
    greatest: vec2f,
}

// Returns the smallest and largest value of one coordinate of the ellipse that bounds_ellipse describes. `j` is that
// coordinate's row of J, `slope` is a, and `d` is 1 − |a|².
fn ellipse_extremes(j: vec2f, slope: vec2f, d: f32) -> vec2f {
    let b = v2_dot(j, slope);
    let square = v2_dot(j, j);
    let root = sqrt(max(sum_of_products(b, b, square, d), 0.0));
    let q = root + abs(b);
    let far = q / d;
    let near = square / select(1.0, q, 0.0 < q);
    // If b > 0, the ellipse reaches farther toward negative offsets.
    return select(vec2f(-near, far), vec2f(-far, near), 0.0 < b);
}

// Returns the box of the pixel offsets J·(u, v)/(1 + a·(u, v)) over the unit disk of (u, v). J has the columns j_s and
// j_t, and a is `slope`, |a| < 1. Uses the dual conic (Sigg 2006) about the projected centre. The root of larger
// magnitude is formed without cancellation, the other from the product of both.
fn bounds_ellipse(j_s: vec2f, j_t: vec2f, slope: vec2f) -> Extent {
    let length = v2_length(slope);
    let d = (1.0 - length) * (1.0 + length);
    let x = ellipse_extremes(vec2f(j_s.x, j_t.x), slope, d);
    let y = ellipse_extremes(vec2f(j_s.y, j_t.y), slope, d);
    return Extent(vec2f(x.x, y.x), vec2f(x.y, y.y));
}

// Returns the box of pixel offsets, from the projected centre, that the unfiltered splat covers. `projective` is true
// for the exact mapping in perspective.
fn bounds_unfiltered(projected: Projected, projective: bool) -> Extent {
    return bounds_ellipse(projected.j_s, projected.j_t, select(vec2f(0.0, 0.0), projected.slope, projective));
}

// Returns the box of pixel offsets, from the anchor, that a footprint covers. At the anchor the footprint's forms (u,
// v, w) have the values 0, 0 and 1.
fn bounds_footprint(f: Footprint) -> Extent {
    let u = vec2f(f.u.x, f.u.y);
    let v = vec2f(f.v.x, f.v.y);
    let inverse = 1.0 / v2_cross(u, v);
    let j_s = vec2f(v.y * inverse, -(v.x * inverse));
    let j_t = vec2f(-(u.y * inverse), u.x * inverse);
    let g = vec2f(f.w.x, f.w.y);
    return bounds_ellipse(j_s, j_t, vec2f(-(v2_cross(g, v) * inverse), v2_cross(g, u) * inverse));
}
