// Depth of a fragment, and depth tolerance between fragments of one surface (rendering model §3, §5). Twin:
// surfel-math, depth.rs.

// Kind of a DepthPlane in perspective with the exact mapping: at pixel offset d, z = scale/(at_anchor + gradient·d).
const DEPTH_RECIPROCAL: u32 = 0u;
// Kind of a DepthPlane in an orthographic projection, or with the affine mapping: at pixel offset d, z = scale +
// gradient·d.
const DEPTH_LINEAR: u32 = 1u;

// Kind of a Tolerance whose value is a multiple of the splat's larger radius.
const TOLERANCE_RELATIVE: u32 = 0u;
// Kind of a Tolerance whose value is a length in world units.
const TOLERANCE_ABSOLUTE: u32 = 1u;

// Distance in pixels, in addition to the filter radius, over which a splat's slope counts in its depth tolerance: half
// a pixel's diagonal.
const SLOPE_MARGIN_PX: f32 = 0.7;

// Planar depth of a splat's plane as a function of the pixel offset d from an anchor, usually the projected centre. The
// functions are those of DEPTH_RECIPROCAL and DEPTH_LINEAR. Depths are clamped to the disk's own range.
struct DepthPlane {
    // Change per pixel to the right and down: of the denominator (DEPTH_RECIPROCAL) or of the depth (DEPTH_LINEAR).
    gradient: vec2f,
    // Depth at the anchor (DEPTH_LINEAR), or numerator of the depth (DEPTH_RECIPROCAL). If the anchor is the projected
    // centre, both are the centre's depth.
    scale: f32,
    // Value of the denominator at the anchor; 1 if the anchor is the projected centre.
    at_anchor: f32,
    // Smallest and largest planar depth of the disk, in world units.
    z_min: f32,
    z_max: f32,
}

// Setting of the depth tolerance: a number, and what it measures (TOLERANCE_RELATIVE or TOLERANCE_ABSOLUTE).
struct Tolerance {
    value: f32,
    kind: u32,
}

// Returns the depth of the splat's plane at pixel offset d. `form` is DEPTH_RECIPROCAL or DEPTH_LINEAR. The depth is
// clamped to the disk's range [z_min, z_max]; where the plane lies behind the eye, it is z_max (rendering model §3).
fn depth_plane_at(plane: DepthPlane, d: vec2f, form: u32) -> f32 {
    let value = fma(plane.gradient.x, d.x, plane.gradient.y * d.y);
    if form == DEPTH_LINEAR {
        return max(min(plane.scale + value, plane.z_max), plane.z_min);
    }
    let w = plane.at_anchor + value;
    let z = plane.scale / select(1.0, w, 0.0 < w);
    return select(plane.z_max, max(min(z, plane.z_max), plane.z_min), 0.0 < w);
}

// Returns the depth tolerance ε of a splat (rendering model §5) in world units. `radius_max` is the splat's larger
// semi-axis in world units. `h_px` is the filter radius in pixels, 0 for a splat drawn without a filter. With
// TOLERANCE_RELATIVE, the multiple of the semi-axis is at most a tenth, and ε at most a fifth, of the centre's depth
// (orthographic: of the view's height). The slope term is Surfel's own: without the term, a surface seen at a grazing
// angle rejects half of its own filter.
fn tolerance(splat: ViewSplat, radius_max: f32, h_px: f32, setting: Tolerance, projection: Projection) -> f32 {
    let p = splat.p;
    let n = splat.n;
    let per_pixel = v2_length(vec2f(n.x / projection.focal_px.x, n.y / projection.focal_px.y));
    var z = projection.height;
    var slope = per_pixel / max(abs(n.z), 0.02);
    if projection.kind == PERSPECTIVE {
        // The slope term needs n·p and |p|. Both are divided by p's largest coordinate, so that nothing overflows for
        // coordinates up to 1e15 or down to 1e−15.
        let inverse = 1.0 / max(max(max(abs(p.z), abs(p.x)), abs(p.y)), 1e-37);
        let q = p * inverse;
        let facing = abs(fma(n.x, q.x, fma(n.y, q.y, n.z * q.z)));
        let length = sqrt(fma(q.x, q.x, fma(q.y, q.y, q.z * q.z)));
        // For a splat at the eye, both facing and length are 0, and so is the slope term.
        slope = per_pixel * (q.z * p.z) / max(max(facing, 0.02 * length), 1e-30);
        z = max(p.z, projection.near);
    }
    slope = (h_px + SLOPE_MARGIN_PX) * slope;
    if setting.kind == TOLERANCE_ABSOLUTE {
        return setting.value + slope;
    }
    return min(0.2 * z, min(setting.value * radius_max, 0.1 * z) + slope);
}

// Returns v if its absolute value is at least `least`, otherwise `least` with the sign of v.
fn away_from_zero(v: f32, least: f32) -> f32 {
    return select(max(v, least), -max(-v, least), v < 0.0);
}

// Returns the change of planar depth over a pixel to the right and over a pixel down, in world units. The plane
// contains the view position p and has the unit normal n in view space. Its steepness is limited as in ε (rendering
// model §5).
fn plane_gradient(p: vec3f, n: vec3f, projection: Projection) -> vec2f {
    let across = vec2f(n.x / projection.focal_px.x, n.y / projection.focal_px.y);
    if projection.kind == ORTHOGRAPHIC {
        return across * -(1.0 / away_from_zero(n.z, 0.02));
    }
    return across * -(p.z * p.z / away_from_zero(v3_dot(n, p), 0.02 * v3_length(p)));
}

// Distance, in pixels, to which a polygon's slope is extended to explain a depth step to one of its eight neighbours.
const STEP_PX: f32 = 2.0;

// Returns the largest distance behind a polygon's depth z, in world units, at which a neighbouring pixel may still show
// the same surface. It is 1/1000 to 1/10 of z (orthographic: of the view's height). `gradient` is the change of the
// polygon's depth per pixel to the right and down.
fn step_allowance(z: f32, gradient: vec2f, projection: Projection) -> f32 {
    let scale = select(z, projection.height, projection.kind == ORTHOGRAPHIC);
    return max(min(STEP_PX * v2_length(gradient), 0.1 * scale), 1e-3 * scale);
}
