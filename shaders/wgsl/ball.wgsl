// Balls and dots (rendering model §11): coverage of a pixel by the ellipse on the screen, and the point of the sphere
// that a pixel shows. Twin: surfel-math, ball.rs.

// Smallest coverage with which a fragment counts as covering the whole pixel: 1 − 2⁻¹², which allows for rounding.
const BALL_FULL: f32 = 0.999755859375;
// Smallest coverage with which a fragment is visible in the planes of depth, normal and nearest splat.
const BALL_SOLID: f32 = 0.5;

// Ellipse that a ball covers on the screen, about the ellipse's own centre, in pixels. Its points are dx =
// extent.x·(skew·v + width·u), dy = extent.y·v over the unit disk u² + v² ≤ 1, with width = √(1 − skew²).
struct Outline {
    extent: vec2f,
    skew: f32,
    width: f32,
}

// Returns the coverage of a pixel, from 0 to 1, given the area of the ellipse inside the pixel, in square pixels. The
// coverage is 1 from an area of BALL_FULL on.
fn ball_limited(area: f32) -> f32 {
    return select(max(area, 0.0), 1.0, BALL_FULL <= area);
}

// Returns the coordinates (u, v) of a point in the outline's unit disk. `from_center` is the point's offset from the
// ellipse's centre in pixels.
fn outline_unit(outline: Outline, from_center: vec2f) -> vec2f {
    let v = from_center.y / outline.extent.y;
    return vec2f((from_center.x / outline.extent.x - outline.skew * v) / outline.width, v);
}

// True if the ellipse contains the point at this offset from its centre, in pixels.
fn outline_contains(outline: Outline, from_center: vec2f) -> bool {
    let at = outline_unit(outline, from_center);
    return at.x * at.x + at.y * at.y <= 1.0;
}

// Returns the integral of √(1 − v²) over v from 0 to the argument, which is in [−1, 1]: half the area of the unit disk
// between these two rows. A polynomial approximates the integral.
fn ball_segment(v: f32) -> f32 {
    let a = abs(v);
    let rest = max(1.0 - a, 0.0);
    var t = -0.00026762004958;
    t = t * a + 0.00142192222639;
    t = t * a - 0.00400863412805;
    t = t * a + 0.00951573395277;
    t = t * a - 0.02734583070739;
    t = t * a + 0.17809527476217;
    t = t * a + 0.78539818336870;
    let area = 0.785398163397 - rest * sqrt(rest) * t;
    return select(area, -area, v < 0.0);
}

// Returns the area of the outline's ellipse that lies left of the vertical line `x` and between two rows. All three are
// distances from the ellipse's centre, relative to `extent`: `x` along x, and `down` (upper row, lower row) along y, in
// [−1, 1]. `rows` are the values of ball_segment at the two rows. The area is in units of extent.x·extent.y.
fn ball_left_of(outline: Outline, x: f32, down: vec2f, rows: vec2f) -> f32 {
    let inside = clamp(x, -1.0, 1.0);
    let half = outline.width * sqrt(max(1.0 - inside * inside, 0.0));
    let first = clamp(inside * outline.skew - half, down.x, down.y);
    let last = clamp(inside * outline.skew + half, down.x, down.y);
    let before = ball_segment(first) - rows.x;
    let after = rows.y - ball_segment(last);
    let full = select(before, -before, x + outline.skew < 0.0) + select(after, -after, x - outline.skew < 0.0);
    let middle = (first + last) * 0.5;
    return full * outline.width + (last - first) * (inside - outline.skew * middle);
}

// Returns the coverage of a pixel by the ellipse, from 0 to 1. `corner` is the offset of the pixel's upper left corner
// from the ellipse's centre, in pixels.
fn outline_coverage(outline: Outline, corner: vec2f) -> f32 {
    let down = clamp(vec2f(corner.y, corner.y + 1.0) / outline.extent.y, vec2f(-1.0, -1.0), vec2f(1.0, 1.0));
    let rows = vec2f(ball_segment(down.x), ball_segment(down.y));
    let left = ball_left_of(outline, corner.x / outline.extent.x, down, rows);
    let right = ball_left_of(outline, (corner.x + 1.0) / outline.extent.x, down, rows);
    return ball_limited((right - left) * (outline.extent.x * outline.extent.y));
}

// Returns the largest coverage that rounding errors alone can produce.
fn outline_rounding(outline: Outline) -> f32 {
    return outline.extent.x * outline.extent.y * 4e-7;
}

// Approximates outline_coverage for a large ellipse: the ellipse's edge is replaced by its tangent near the pixel, with
// a correction for its curvature. `corner` is the offset of the pixel's upper left corner from the ellipse's centre, in
// pixels.
fn outline_coverage_of_large(outline: Outline, corner: vec2f) -> f32 {
    let at = outline_unit(outline, corner + 0.5);
    let length = sqrt(at.x * at.x + at.y * at.y);
    let u_x = 1.0 / (outline.width * outline.extent.x);
    let v_y = 1.0 / outline.extent.y;
    let u_y = -(outline.skew / outline.width) * v_y;
    let safe = max(length, 1e-3);
    let gradient = vec2f(at.x * u_x / safe, (at.x * u_y + at.y * v_y) / safe);
    let slope = v2_length(gradient);
    let distance = (1.0 - length) / slope;
    let normal = abs(gradient) / slope;
    let a = max(normal.x, normal.y);
    let b = max(min(normal.x, normal.y), 1e-3);
    let sum = (a + b) * 0.5;
    let difference = (a - b) * 0.5;
    // At distances above `sum`, the pixel is inside the tangent and its area is 1. Larger distances are reduced to
    // `sum`, since the differences of squares below would lose all digits.
    let inside = min(distance, sum);
    let p = max(inside + sum, 0.0);
    let q = max(inside + difference, 0.0);
    let r = max(inside - difference, 0.0);
    let s = max(inside - sum, 0.0);
    let scale = 1.0 / (a * b);
    let chord = ((p - q) - (r - s)) * scale;
    let area = ((p * p - q * q) - (r * r - s * s)) * 0.5 * scale;
    return ball_limited(area - slope * chord * chord * (1.0 / 24.0) * chord);
}

// Point of a ball that is visible at a pixel's centre.
struct BallHit {
    // Unit outward normal in view axes.
    normal: vec3f,
    // Perspective: quotient of the point's depth and the centre's. Orthographic: difference of the point's depth and
    // the centre's.
    depth: f32,
}

// Returns the point of a ball that a pixel's ray meets first. If the ray misses the ball, it is the ray's point nearest
// to the ball's centre (rendering model §11). With p the ball's centre in view space, `center` is p_xy/p_z and `size`
// is radius/p_z (orthographic: the radius). `offset` is the vector from the projection of p to the pixel's centre, in
// pixels, divided by the focal lengths.
fn ball_hit_new(center: vec2f, size: f32, offset: vec2f, projection: Projection) -> BallHit {
    if projection.kind == ORTHOGRAPHIC {
        let root = sqrt(max(size * size - v2_dot(offset, offset), 0.0));
        return BallHit(unit(vec3f(offset, -root)), -root);
    }
    let ray = vec3f(center + offset, 1.0);
    let square = v3_dot(ray, ray);
    let along = v2_dot(ray.xy, offset);
    let turn = difference_of_products(center.x, offset.y, center.y, offset.x);
    let missed = v2_dot(offset, offset) + turn * turn;
    let root = sqrt(max(square * size * size - missed, 0.0));
    let tau = -(along + root) / square;
    return BallHit(unit(vec3f(ray.xy * tau + offset, tau)), 1.0 + tau);
}
