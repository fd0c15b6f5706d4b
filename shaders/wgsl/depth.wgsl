// Depth of a fragment, and depth tolerance between fragments of one surface (rendering model §3, §5). Twin:
// surfel-math, depth.rs.

// Form of the depth z = scale/(at_anchor + gradient·d): a plane in perspective.
const DEPTH_RECIPROCAL: u32 = 0u;
// Form of the depth z = scale + gradient·d: orthographic, or perspective with the affine mapping.
const DEPTH_LINEAR: u32 = 1u;

// Kind of a depth tolerance: a multiple of the larger radius of the splat.
const TOLERANCE_RELATIVE: u32 = 0u;
// Kind of a depth tolerance: a length in world units.
const TOLERANCE_ABSOLUTE: u32 = 1u;

// Margin by which the slope term of the depth tolerance reaches beyond the filter radius, in pixels: half a pixel's
// diagonal.
const SLOPE_MARGIN_PX: f32 = 0.7;

struct DepthPlane {
    gradient: vec2f,
    scale: f32,
    at_anchor: f32,
    // Smallest and largest depth of the disk.
    z_min: f32,
    z_max: f32,
}

// Depth tolerance as a multiple of the larger radius, or in world units.
struct Tolerance {
    value: f32,
    kind: u32,
}

// Returns the depth of the splat's plane at offset d, clamped to the disk's range on 1/z. A plane behind the eye gives
// the far end (rendering model §3).
fn depth_plane_at(plane: DepthPlane, d: vec2f, form: u32) -> f32 {
    let value = fma(plane.gradient.x, d.x, plane.gradient.y * d.y);
    if form == DEPTH_LINEAR {
        return max(min(plane.scale + value, plane.z_max), plane.z_min);
    }
    let w = plane.at_anchor + value;
    let z = plane.scale / select(1.0, w, 0.0 < w);
    return select(plane.z_max, max(min(z, plane.z_max), plane.z_min), 0.0 < w);
}

// Returns the depth tolerance ε (rendering model §5) in world units; h_px is 0 for a splat drawn without a filter. The
// slope term is Surfel's own: without the term, a surface seen at a grazing angle rejects half of its own filter.
fn tolerance(splat: ViewSplat, radius_max: f32, h_px: f32, setting: Tolerance, projection: Projection) -> f32 {
    let p = splat.p;
    let n = splat.n;
    let per_pixel = v2_length(vec2f(n.x / projection.focal_px.x, n.y / projection.focal_px.y));
    var z = projection.height;
    var slope = per_pixel / max(abs(n.z), 0.02);
    if projection.kind == PERSPECTIVE {
        // n·p and |p| relative to p's largest coordinate: no overflow at 1e±15.
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

// Returns v, moved away from zero to an absolute value of at least `least`.
fn away_from_zero(v: f32, least: f32) -> f32 {
    return select(max(v, least), -max(-v, least), v < 0.0);
}

// Returns the change of planar depth over a pixel to the right and over a pixel down. The plane contains the view
// position p and has the unit view normal n. Its steepness is limited as in ε.
fn plane_gradient(p: vec3f, n: vec3f, projection: Projection) -> vec2f {
    let across = vec2f(n.x / projection.focal_px.x, n.y / projection.focal_px.y);
    if projection.kind == ORTHOGRAPHIC {
        return across * -(1.0 / away_from_zero(n.z, 0.02));
    }
    return across * -(p.z * p.z / away_from_zero(v3_dot(n, p), 0.02 * v3_length(p)));
}

// Distance, in pixels, to which a polygon's slope is extended to explain a depth step to one of its eight neighbours.
const STEP_PX: f32 = 2.0;

// Returns the largest distance behind a polygon's depth z at which a neighbouring pixel may still show the same
// surface.
fn step_allowance(z: f32, gradient: vec2f, projection: Projection) -> f32 {
    let scale = select(z, projection.height, projection.kind == ORTHOGRAPHIC);
    return max(min(STEP_PX * v2_length(gradient), 0.1 * scale), 1e-3 * scale);
}
