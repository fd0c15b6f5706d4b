// A splat's first-order projection (rendering model §3, §4). Twin: surfel-math, project.rs and projection.rs.
//
// Source: Guennebaud et al. 2006 §3, adj(M)/det(M), written about the projected centre. There its constant terms are 0,
// 0, 1, and no term is a difference of screen coordinates.

// Kinds of a Projection.
const PERSPECTIVE: u32 = 0u;
const ORTHOGRAPHIC: u32 = 1u;

// Largest |n·p|/|p| at which a splat is edge-on (rendering model §2). No pass draws an edge-on splat.
const EDGE_ON: f32 = 1e-5;

// Projection of view space to pixels (rendering model §1).
struct Projection {
    // Pixels per unit of slope (perspective) or per world unit (orthographic).
    focal_px: vec2f,
    // Pixel coordinates of the optical axis.
    principal_px: vec2f,
    // Planar depth of the near plane; nothing nearer is drawn.
    near: f32,
    // Planar depth of the far plane of an orthographic view; nothing farther is drawn. In perspective the largest f32.
    far: f32,
    // Height of an orthographic view, in world units.
    height: f32,
    // PERSPECTIVE or ORTHOGRAPHIC.
    kind: u32,
}

// A splat in view space: x right, y down, z forward, eye at the origin.
struct ViewSplat {
    // Centre.
    p: vec3f,
    // Half-axes.
    s: vec3f,
    t: vec3f,
    // Unit outward normal.
    n: vec3f,
}

// A splat's projection to first order about its projected centre. d is a pixel offset from there.
struct Projected {
    // Affine projections of s and t at the centre, in pixels: the columns of J.
    j_s: vec2f,
    j_t: vec2f,
    // Determinant of J, computed from the normal.
    det_j: f32,
    // s_z/p_z and t_z/p_z; zero in an orthographic projection.
    slope: vec2f,
    // Gradient g of the splat's plane: per pixel to the right and down. Perspective: p_z/z = 1 − g·d; orthographic: z =
    // p_z + g·d.
    depth_gradient: vec2f,
    // Half the disk's depth range, in world units.
    depth_extent: f32,
    // n·p/p_z, with n the unit normal and p the centre (orthographic: n_z). The splat is back-facing if it is at least
    // 0.
    facing: f32,
    // |n·p|/|p| (orthographic: |n_z|): the sine of the angle between the splat's plane and the ray to its centre.
    facing_cosine: f32,
}

// Projects a splat. Perspective requires p.z > 0.
fn projected_new(splat: ViewSplat, projection: Projection) -> Projected {
    let p = splat.p;
    let s = splat.s;
    let t = splat.t;
    let n = splat.n;
    let focal = projection.focal_px;
    // |s × t| with both scaled to their largest coordinate, so that nothing overflows or underflows at 1e±15.
    let k_s = v3_max_abs(s);
    let k_t = v3_max_abs(t);
    let s_cross_t = v3_cross(s * (1.0 / k_s), t * (1.0 / k_t));
    let length = v3_length(s_cross_t);
    let sine = select(-length, length, 0.0 <= v3_dot(s_cross_t, n));
    let depth_extent = sqrt(fma(s.z, s.z, t.z * t.z));
    if projection.kind == ORTHOGRAPHIC {
        let per_pixel = 1.0 / n.z;
        return Projected(
            s.xy * focal,
            t.xy * focal,
            sine * n.z * (k_s * focal.x) * (k_t * focal.y),
            vec2f(0.0, 0.0),
            vec2f(-(n.x / focal.x) * per_pixel, -(n.y / focal.y) * per_pixel),
            depth_extent,
            n.z,
            abs(n.z),
        );
    }
    let inverse = 1.0 / p.z;
    let center = vec2f(p.x * inverse, p.y * inverse);
    // f∘(s_xy·p_z − s_z·p_xy)/p_z², in the scale-free form s' = s/p_z.
    let a = s * inverse;
    let b = t * inverse;
    let facing = v3_dot(n, vec3f(center, 1.0));
    let distance = sqrt(fma(center.x, center.x, fma(center.y, center.y, 1.0)));
    let per_pixel = 1.0 / facing;
    return Projected(
        vec2f(fma(-a.z, center.x, a.x), fma(-a.z, center.y, a.y)) * focal,
        vec2f(fma(-b.z, center.x, b.x), fma(-b.z, center.y, b.y)) * focal,
        sine * facing * (k_s * inverse * focal.x) * (k_t * inverse * focal.y),
        vec2f(s.z * inverse, t.z * inverse),
        vec2f(-(n.x / focal.x) * per_pixel, -(n.y / focal.y) * per_pixel),
        depth_extent,
        facing,
        abs(facing) / distance,
    );
}

// True if a splat is edge-on. No pass draws it.
fn projected_is_edge_on(projected: Projected) -> bool {
    return projected.facing_cosine <= EDGE_ON;
}

// Returns r_max (rendering model §2), the larger semi-axis of a splat with the half-axes s and t: the larger singular
// value of the matrix [s t]. Nothing overflows or underflows, whatever the scale of s and t.
fn radius_max(s: vec3f, t: vec3f) -> f32 {
    let scale = max(v3_max_abs(s), v3_max_abs(t));
    let u = s * (1.0 / scale);
    let v = t * (1.0 / scale);
    let a = v3_dot(u, u);
    let b = v3_dot(u, v);
    let c = v3_dot(v, v);
    let difference = (a - c) * 0.5;
    let root = sqrt(fma(difference, difference, b * b));
    return scale * sqrt(fma(a + c, 0.5, root));
}

// Returns the offset, in pixels, of the projection of the view position p from the pixel position `base_px`. Pixel
// coordinates aren't subtracted, so their digits don't cancel (rendering model §3).
fn projection_offset_from(projection: Projection, p: vec3f, base_px: vec2f) -> vec2f {
    let b = base_px - projection.principal_px;
    let focal = projection.focal_px;
    if projection.kind == ORTHOGRAPHIC {
        return vec2f(fma(focal.x, p.x, -b.x), fma(focal.y, p.y, -b.y));
    }
    let inverse = 1.0 / p.z;
    return vec2f(
        difference_of_products(focal.x, p.x, b.x, p.z) * inverse,
        difference_of_products(focal.y, p.y, b.y, p.z) * inverse,
    );
}
