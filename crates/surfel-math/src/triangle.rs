//! Triangles over pixels (rendering model §6): edge functions, coverage, perspective-correct interpolation, bounds.
//!
//! After Olano and Greer, *Triangle Scan Conversion Using 2D Homogeneous Coordinates* (1997). Edge functions are formed
//! from homogeneous pixel coordinates, so a triangle that reaches behind the eye needs no clipping. A fragment in front
//! of z_near is rejected by its own depth.

use crate::bounds::Extent;
use crate::mapping::Linear;
use crate::projection::{Projection, ProjectionKind};
use crate::{Real, V2, V3};

/// Converts a view-space point to homogeneous pixel coordinates relative to `anchor_px`: (x, y)/z of the result is the
/// point's pixel offset from there.
///
/// Edges of adjacent triangles meet exactly if all triangles have the same anchor.
#[inline(always)]
pub fn homogeneous<R: Real>(p: V3<R>, anchor_px: V2<R>, projection: &Projection) -> V3<R> {
    let k = |value: f64| p.x.constant(value);
    let (fx, fy) = (k(projection.focal_px[0]), k(projection.focal_px[1]));
    let (bx, by) = (anchor_px.x - k(projection.principal_px[0]), anchor_px.y - k(projection.principal_px[1]));
    match projection.kind {
        ProjectionKind::Perspective => {
            V3::new(R::difference_of_products(fx, p.x, bx, p.z), R::difference_of_products(fy, p.y, by, p.z), p.z)
        }
        ProjectionKind::Orthographic { .. } => V3::new(fx.mul_add(p.x, -bx), fy.mul_add(p.y, -by), p.x.one()),
    }
}

/// Returns the linear form over pixel offsets d that is 0 on the line through two homogeneous points: det[a b (d, 1)].
///
/// With swapped points the form is exactly the negative, whatever was rounded. Both triangles at an edge therefore test
/// a pixel by the same number. (Around a vertex within rounding of a pixel's centre, rounding decides several edges.)
#[inline(always)]
pub fn edge<R: Real>(a: V3<R>, b: V3<R>) -> Linear<R> {
    let equal = |a: R, b: R| !a.lt(b) & !b.lt(a);
    let later = equal(a.y, b.y) & b.z.lt(a.z) | b.y.lt(a.y);
    let swap = b.x.lt(a.x) | (equal(a.x, b.x) & later);
    let (first, second) = (V3::select(swap, b, a), V3::select(swap, a, b));
    let n = first.cross(second);
    let n = V3::select(swap, -n, n);
    Linear { x: n.x, y: n.y, c: n.z }
}

/// A triangle prepared for rasterisation: linear forms of its edges over pixels, and the depths of its vertices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle<R> {
    /// Linear forms over pixels of the edges opposite each vertex; all are positive inside the triangle. Each is the
    /// vertex's barycentric coordinate times a common positive factor, which varies over the image like 1/z.
    pub edges: [Linear<R>; 3],
    /// Planar depths of the vertices, in world units.
    pub z: [R; 3],
}

impl<R: Real> Triangle<R> {
    /// Prepares the triangle of view-space vertices `p`, relative to `anchor_px`.
    #[inline(always)]
    pub fn new(p: [V3<R>; 3], anchor_px: V2<R>, projection: &Projection) -> Self {
        let [a, b, c] = p.map(|p| homogeneous(p, anchor_px, projection));
        let determinant = a.dot(b.cross(c));
        let backward = determinant.lt(determinant.zero());
        let oriented = |f: Linear<R>| {
            let turn = |v: R| R::select(backward, -v, v);
            Linear { c: turn(f.c), x: turn(f.x), y: turn(f.y) }
        };
        Self { edges: [edge(b, c), edge(c, a), edge(a, b)].map(oriented), z: p.map(|p| p.z) }
    }

    /// True where the triangle covers the pixel centre at offset `d`. A centre exactly on an edge belongs to the
    /// triangle below or to the right of it. Exactly one of the triangles that meet at an edge therefore covers it.
    #[inline(always)]
    pub fn contains(&self, d: V2<R>) -> R::Mask {
        let covers = |e: &Linear<R>| {
            let (value, zero) = (e.at(d), e.c.zero());
            let right_of = zero.lt(e.x) | (!e.x.lt(zero) & zero.lt(e.y));
            zero.lt(value) | (!value.lt(zero) & right_of)
        };
        covers(&self.edges[0]) & covers(&self.edges[1]) & covers(&self.edges[2])
    }

    /// Returns the perspective-correct barycentric coordinates of the triangle's point at pixel offset `d`; they sum to
    /// 1.
    #[inline(always)]
    pub fn barycentric(&self, d: V2<R>) -> [R; 3] {
        let values = self.edges.map(|e| e.at(d));
        let inverse = values[0].one() / (values[0] + values[1] + values[2]);
        values.map(|v| v * inverse)
    }

    /// Returns the planar depth, in world units, of the point with these barycentric coordinates.
    #[inline(always)]
    pub fn depth(&self, barycentric: [R; 3]) -> R {
        interpolate(barycentric, self.z)
    }

    /// Returns the change per pixel to the right and down of an attribute, given its values at the vertices. `value` is
    /// the attribute at offset `d`.
    #[inline(always)]
    pub fn gradient(&self, attribute: [R; 3], value: R, d: V2<R>) -> V2<R> {
        // attribute = A/W with A = Σ a·E and W = Σ E: its gradient is (∇A − value·∇W)/W = Σ (a − value)·∇E/W.
        let [e0, e1, e2] = self.edges;
        let inverse = value.one() / (e0.at(d) + e1.at(d) + e2.at(d));
        let apart = attribute.map(|a| a - value);
        V2::new(interpolate(apart, [e0.x, e1.x, e2.x]) * inverse, interpolate(apart, [e0.y, e1.y, e2.y]) * inverse)
    }
}

/// Interpolates values `a` at a triangle's vertices by barycentric coordinates `b`: Σ b·a.
#[inline(always)]
pub fn interpolate<R: Real>(b: [R; 3], a: [R; 3]) -> R {
    b[0].mul_add(a[0], b[1].mul_add(a[1], b[2] * a[2]))
}

/// Returns the box, in pixel coordinates, of the part of a triangle at or beyond z_near, or `None` if there is none.
pub fn bounds(p: [V3<f64>; 3], projection: &Projection) -> Option<Extent<f64>> {
    let near = projection.near;
    let mut extent: Option<Extent<f64>> = None;
    let mut add = |p: V3<f64>| {
        let at = projection.pixel(p);
        let point = Extent { min: at, max: at };
        extent = Some(extent.map_or(point, |b| b.union(point)));
    };
    for i in 0..3 {
        let (a, b) = (p[i], p[(i + 1) % 3]);
        if a.z >= near {
            add(a);
        }
        if (a.z < near) != (b.z < near) {
            let cut = a + (b - a) * ((near - a.z) / (b.z - a.z));
            // Rounding must not move the cut behind the eye.
            add(V3 { z: near, ..cut });
        }
    }
    extent
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERSPECTIVE: Projection = Projection {
        kind: ProjectionKind::Perspective,
        focal_px: [60.0, 55.0],
        principal_px: [32.25, 31.5],
        near: 0.1,
    };

    /// Returns a pseudo-random number in [−1, 1).
    fn noise(i: u32) -> f64 {
        let x = (f64::from(i) * 12.9898).sin() * 43758.5453;
        2.0 * (x - x.floor()) - 1.0
    }

    fn vertices(seed: u32) -> [V3<f64>; 3] {
        [0, 1, 2].map(|i| {
            let k = seed * 9 + i * 3;
            V3::new(noise(k) * 2.0, noise(k + 1) * 2.0, 2.0 + 1.5 * noise(k + 2))
        })
    }

    fn orthographic() -> Projection {
        Projection { kind: ProjectionKind::Orthographic { height: 4.0, far: 20.0 }, focal_px: [16.0; 2], ..PERSPECTIVE }
    }

    #[test]
    fn triangle_interpolation_is_the_rays_own_hit() {
        for projection in [PERSPECTIVE, orthographic()] {
            let mut hits = 0;
            for seed in 0..50 {
                let p = vertices(seed);
                let anchor = V2::new(7.5, -3.0);
                let triangle = Triangle::new(p, anchor, &projection);
                for i in 0..64 {
                    let pixel = V2::new(f64::from(i % 8) * 8.0 + 0.5, f64::from(i / 8) * 8.0 + 0.5);
                    if !triangle.contains(pixel - anchor) {
                        continue;
                    }
                    let b = triangle.barycentric(pixel - anchor);
                    let z = triangle.depth(b);
                    let (origin, direction) = projection.ray(pixel);
                    let hit = origin + direction * z;
                    let at = p[0] * b[0] + p[1] * b[1] + p[2] * b[2];
                    assert!((at - hit).length() < 1e-11, "{seed} {at:?} {hit:?}");
                    // The gradient of x over a pixel, against a difference quotient.
                    let step = V2::new(1e-6, 0.0);
                    let x = p.map(|p| p.x);
                    let slope = triangle.gradient(x, at.x, pixel - anchor).x;
                    let there = interpolate(triangle.barycentric(pixel + step - anchor), x);
                    assert!(((there - at.x) / 1e-6 - slope).abs() < 1e-5 * slope.abs().max(1.0), "{seed}");
                    hits += 1;
                }
            }
            assert!(hits > 200, "{hits}");
        }
    }

    #[test]
    fn triangle_edge_is_exactly_negated_the_other_way_round() {
        for i in 0..2000 {
            let [a, b, _] = vertices(i).map(|p| V3::new(p.x as f32, p.y as f32, p.z as f32));
            for (a, b) in [(a, b), (a, V3::new(a.x, b.y, b.z)), (a, V3::new(a.x, a.y, b.z)), (a, a)] {
                let (forth, back) = (edge(a, b), edge(b, a));
                assert_eq!((forth.c, forth.x, forth.y), (-back.c, -back.x, -back.y));
            }
        }
    }

    /// A fan around a vertex covers each pixel inside exactly once, in f32 too. In even fans, whose numbers are all
    /// exact in f32, vertices are on pixel centres and edges run through them.
    #[test]
    fn triangle_fans_are_watertight_and_cover_no_pixel_twice() {
        let projection = Projection { focal_px: [64.0; 2], principal_px: [32.0; 2], ..PERSPECTIVE };
        for seed in 0..60u32 {
            let (spokes, even) = (5 + seed % 7, seed % 2 == 0);
            let point = |i: u32, x: f64, y: f64| {
                let exact = [1.0, 2.0, 4.0][((seed + i) % 3) as usize];
                let z = if even { exact } else { 1.5 + 0.5 * noise(seed * 31 + i) };
                let snap = |v: f64| if even { (v - 0.5).round() + 0.5 } else { v };
                let slope = |v: f64| (snap(v) - 32.0) / 64.0;
                V3::new((slope(x) * z) as f32, (slope(y) * z) as f32, z as f32)
            };
            let center = point(0, 32.0 + 4.0 * noise(seed), 32.0);
            let rim: Vec<V3<f32>> = (0..spokes)
                .map(|i| {
                    let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(spokes)).sin_cos();
                    point(i + 1, 32.0 + 25.0 * cos, 32.0 + 25.0 * sin)
                })
                .collect();
            let mut counts = vec![0; 64 * 64];
            for i in 0..rim.len() {
                let p = [center, rim[i], rim[(i + 1) % rim.len()]];
                let triangle = Triangle::new(p, V2::new(0.0, 0.0), &projection);
                for (at, count) in counts.iter_mut().enumerate() {
                    let d = V2::new((at % 64) as f32 + 0.5, (at / 64) as f32 + 0.5);
                    *count += u32::from(triangle.contains(d));
                }
            }
            assert!(counts.iter().all(|c| *c <= 1), "{seed}: a pixel is covered twice");
            for (at, count) in counts.iter().enumerate() {
                let from_center = V2::new((at % 64) as f64 - 31.5, (at / 64) as f64 - 31.5).length();
                // A rim of five spokes is at least 25·cos 36° = 20 px from the centre, minus a pixel of snapping.
                assert!(from_center > 19.0 || *count == 1, "{seed}: a hole at {at}");
            }
        }
    }

    #[test]
    fn triangle_that_reaches_behind_the_eye_is_cut_at_the_near_plane() {
        // The floor y = 1 from behind the eye to far ahead.
        let p = [V3::new(0.0, 1.0, -2.0), V3::new(40.0, 1.0, 50.0), V3::new(-40.0, 1.0, 50.0)];
        let triangle = Triangle::new(p, V2::new(0.0, 0.0), &PERSPECTIVE);
        for y in [33, 40, 60] {
            let d = V2::new(32.5, f64::from(y) + 0.5);
            assert!(triangle.contains(d), "{y}");
            let z = triangle.depth(triangle.barycentric(d));
            // 55·1/z + 31.5 = y + ½.
            assert!((z - 55.0 / (f64::from(y) - 31.0)).abs() < 1e-9, "{y} {z}");
        }
        // The mirror image behind the eye isn't drawn.
        assert!(!triangle.contains(V2::new(32.5, 20.5)));
        let extent = bounds(p, &PERSPECTIVE).unwrap();
        // The cut at z = 0.1: y = 55/0.1 + 31.5; farthest: z = 50.
        assert!((extent.max.y - 581.5).abs() < 1e-9 && (extent.min.y - (31.5 + 1.1)).abs() < 1e-9, "{extent:?}");
        assert!(bounds(p.map(|p| V3 { z: 0.05, ..p }), &PERSPECTIVE).is_none());
    }

    #[test]
    fn triangle_without_area_covers_nothing() {
        let a = V3::new(0.0, 0.0, 2.0);
        for b in [a, V3::new(0.5, 0.0, 2.0)] {
            let triangle = Triangle::new([a, b, b], V2::new(0.0, 0.0), &PERSPECTIVE);
            for at in 0..64 * 64 {
                assert!(!triangle.contains(V2::new(f64::from(at % 64) + 0.25, f64::from(at / 64) + 0.5)));
            }
        }
    }
}
