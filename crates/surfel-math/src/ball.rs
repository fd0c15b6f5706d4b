//! Balls and dots (rendering model §11): their ellipse on the screen, its coverage of a pixel, and the point of the
//! sphere that a pixel shows.

use crate::projection::{Projection, ProjectionKind};
use crate::{Real, V2, V3};
use std::f64::consts::FRAC_PI_4;

/// Smallest coverage of a pixel by a ball that counts as complete, so that nothing behind the ball shows. The slack
/// absorbs rounding.
pub const FULL: f64 = 1.0 - 1.0 / 4096.0;

/// Smallest coverage of a pixel at which a ball's fragment also shows in the planes of depth, normal and nearest splat.
/// Fragments with less coverage show there only in the pixel of the ball's centre.
pub const SOLID: f64 = 0.5;

/// Smallest size of an ellipse at which [`Outline::coverage_of_large`] is more accurate in f32 than
/// [`Outline::coverage`]. The size is the geometric mean of the ellipse's half extents, in pixels.
pub const LARGE_PX: f64 = 32.0;

/// Smallest radius of a ball in a shadow map, in texels; smaller balls are enlarged. At this radius every ball covers a
/// texel's centre, so that none loses its shadow.
pub const MIN_TEXELS: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// The ellipse that a ball or a dot covers on the screen. Its points are dx = `extent.x`·(`skew`·v + `width`·u), dy =
/// `extent.y`·v over the unit disk u² + v² ≤ 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline<R> {
    /// Offset of the ellipse's centre from the projection of the ball's centre, in pixels.
    pub center: V2<R>,
    /// Largest distances of the ellipse's points from its centre along x and y, in pixels.
    pub extent: V2<R>,
    /// Slant of the ellipse: correlation of dx and dy, in (−1, 1); 0 if the ellipse's axes are along x and y.
    pub skew: R,
    /// √(1 − skew²), stored because every pixel needs it.
    pub width: R,
}

impl<R: Real> Outline<R> {
    /// Returns the outline of a ball with centre `p` in view space, which lies in front of the eye: `radius` < p.z.
    #[inline(always)]
    pub fn of_ball(p: V3<R>, radius: R, projection: &Projection) -> Self {
        let (one, zero) = (p.x.one(), p.x.zero());
        let focal = [p.x.constant(projection.focal_px[0]), p.x.constant(projection.focal_px[1])];
        match projection.kind {
            // The cone of tangents from the eye is (X·c + 1)² = (|X|² + 1)·(|c|² + 1 − s²) over slopes X, with c =
            // p_xy/p_z and s = radius/p_z. As an ellipse of X, its covariance is b²·(I + w·c·cᵀ) and its centre c +
            // b²·c, with w = 1/(1 − s²) and b² = s²·w.
            ProjectionKind::Perspective => {
                let inverse = one / p.z;
                let (x, y, size) = (p.x * inverse, p.y * inverse, radius * inverse);
                let w = one / (-size).mul_add(size, one);
                let square = size * size * w;
                let (xx, yy) = ((x * x).mul_add(w, one), (y * y).mul_add(w, one));
                let of_both = xx * yy;
                Self {
                    center: V2::new(focal[0] * (x * square), focal[1] * (y * square)),
                    extent: V2::new(focal[0] * (square * xx).sqrt(), focal[1] * (square * yy).sqrt()),
                    skew: x * y * w / of_both.sqrt(),
                    width: (x.mul_add(x, y * y).mul_add(w, one) / of_both).sqrt(),
                }
            }
            ProjectionKind::Orthographic { .. } => Self {
                center: V2::new(zero, zero),
                extent: V2::new(focal[0] * radius, focal[1] * radius),
                skew: zero,
                width: one,
            },
        }
    }

    /// Returns the outline of a dot: a disk around `p` that is parallel to the image.
    #[inline(always)]
    pub fn of_dot(p: V3<R>, radius: R, projection: &Projection) -> Self {
        let zero = p.x.zero();
        let size = if projection.is_perspective() { radius / p.z } else { radius };
        let focal = [p.x.constant(projection.focal_px[0]), p.x.constant(projection.focal_px[1])];
        Self {
            center: V2::new(zero, zero),
            extent: V2::new(focal[0] * size, focal[1] * size),
            skew: zero,
            width: p.x.one(),
        }
    }

    /// True where the outline contains a point, given by its offset from the ellipse's centre in pixels.
    #[inline(always)]
    pub fn contains(&self, from_center: V2<R>) -> R::Mask {
        let (u, v) = self.unit(from_center);
        u.mul_add(u, v * v).le(u.one())
    }

    /// Converts a point, given by its offset from the ellipse's centre in pixels, to (u, v) in the unit disk.
    #[inline(always)]
    fn unit(&self, from_center: V2<R>) -> (R, R) {
        let v = from_center.y / self.extent.y;
        (((-self.skew).mul_add(v, from_center.x / self.extent.x)) / self.width, v)
    }

    /// Returns the area of the ellipse inside a pixel, in square pixels, which is the pixel's coverage. `corner` is the
    /// offset of the pixel's upper left corner from the ellipse's centre. `S` computes an integral: [`Rounded`] or, for
    /// f64, [`Exact`]. The sum of the coverages of all pixels is the ellipse's area.
    ///
    /// The area left of a column at X is ∫ clamp(X − c(y), −h, h) dy plus a constant, where c ± h are the ends of a
    /// row's chord. The pixel's area is the difference of two such integrals. The integrand is linear in y where the
    /// column crosses the chord, and ±h before and after.
    #[inline(always)]
    pub fn coverage<S: Segment<R>>(&self, corner: V2<R>) -> R {
        let one = corner.x.one();
        // A type in place of a closure, and no other closures: they aren't inlined into SIMD code.
        let (above, below) = (corner.y / self.extent.y, (corner.y + one) / self.extent.y);
        let down = [above.max(-one).min(one), below.max(-one).min(one)];
        let rows = [S::of(down[0]), S::of(down[1])];
        let left = self.left_of::<S>(corner.x / self.extent.x, down, rows);
        let right = self.left_of::<S>((corner.x + one) / self.extent.x, down, rows);
        Self::limited((right - left) * (self.extent.x * self.extent.y))
    }

    /// Returns the largest coverage that rounding in f32 can make [`Self::coverage`] return for a pixel outside the
    /// ellipse.
    #[inline(always)]
    pub fn rounding(&self) -> R {
        self.extent.x * self.extent.y * self.extent.x.constant(4e-7)
    }

    /// Returns the ellipse's area left of a column at `x`, between the rows `down[0]` and `down[1]`, up to a constant.
    /// Lengths are in units of the half extents. `rows` are the integral `S` at these two rows. [`Self::coverage`] is
    /// the difference of two such areas.
    #[inline(always)]
    fn left_of<S: Segment<R>>(&self, x: R, down: [R; 2], rows: [R; 2]) -> R {
        let one = x.one();
        let inside = x.max(-one).min(one);
        // The rows between which the column crosses the ellipse.
        let half = self.width * (-inside).mul_add(inside, one).max(x.zero()).sqrt();
        let first = inside.mul_add(self.skew, -half).max(down[0]).min(down[1]);
        let last = inside.mul_add(self.skew, half).max(down[0]).min(down[1]);
        let (before, after) = (S::of(first) - rows[0], rows[1] - S::of(last));
        let full = signed(x + self.skew, before) + signed(x - self.skew, after);
        let middle = (first + last) * x.constant(0.5);
        full.mul_add(self.width, (last - first) * (-self.skew).mul_add(middle, inside))
    }

    /// Approximates [`Self::coverage`] for a large ellipse by the half plane inside the tangent nearest to the pixel.
    /// The error is below 10⁻³ for ellipses of at least [`LARGE_PX`].
    #[inline(always)]
    pub fn coverage_of_large(&self, corner: V2<R>) -> R {
        let (half, one) = (corner.x.constant(0.5), corner.x.one());
        let (u, v) = self.unit(V2::new(corner.x + half, corner.y + half));
        let length = u.mul_add(u, v * v).sqrt();
        // The gradient of the length over pixels.
        let (u_x, v_y) = (one / (self.width * self.extent.x), one / self.extent.y);
        let u_y = -(self.skew / self.width) * v_y;
        let safe = length.max(length.constant(1e-3));
        let gradient = V2::new(u * u_x / safe, u.mul_add(u_y, v * v_y) / safe);
        let slope = gradient.length();
        let distance = (one - length) / slope;
        let (a, b) = (gradient.x.abs() / slope, gradient.y.abs() / slope);
        let (area, chord) = half_plane(distance, a.max(b), a.min(b));
        // The arc lies inside of its tangent by a mean of c²/(24·R) over a chord c.
        let sagitta = slope * chord * chord * half.constant(1.0 / 24.0);
        Self::limited((-sagitta).mul_add(chord, area))
    }

    /// Limits a coverage to [0, 1], and rounds one of at least [`FULL`] to 1.
    #[inline(always)]
    fn limited(area: R) -> R {
        R::select(area.constant(FULL).le(area), area.one(), area.max(area.zero()))
    }
}

/// Returns `area`, negated if the coordinate `at` is negative.
#[inline(always)]
fn signed<R: Real>(at: R, area: R) -> R {
    R::select(at.lt(at.zero()), -area, area)
}

/// Returns `distance`, or 0 if it is negative.
#[inline(always)]
fn beyond<R: Real>(distance: R) -> R {
    distance.max(distance.zero())
}

/// Returns the area of a unit square inside a half plane, and the length of the half plane's border inside the square.
/// `distance` is the distance of the square's centre from the border, positive inside. `a` ≥ `b` are the absolute
/// coordinates of the border's unit normal.
#[inline(always)]
fn half_plane<R: Real>(distance: R, a: R, b: R) -> (R, R) {
    let (half, b) = (a.constant(0.5), b.max(a.constant(1e-3)));
    let (sum, difference) = ((a + b) * half, (a - b) * half);
    // Farther inside the area is 1, too, but its differences of squares lose all digits.
    let distance = distance.min(sum);
    let (p, q) = (beyond(distance + sum), beyond(distance + difference));
    let (r, s) = (beyond(distance - difference), beyond(distance - sum));
    let scale = a.one() / (a * b);
    let area = (p.mul_add(p, -(q * q)) - r.mul_add(r, -(s * s))) * half * scale;
    (area, ((p - q) - (r - s)) * scale)
}

/// Returns ∫√(1 − v²) from 0 to v, for |v| ≤ 1, with an absolute error below 6·10⁻⁸, plus rounding.
#[inline(always)]
pub fn segment<R: Real>(v: R) -> R {
    // With S the integral, π/4 − S(v) = (1 − v)^1.5·T(v); T is smooth, here its interpolation at Chebyshev's points.
    const T: [f64; 7] = [
        0.785_398_183_368_698_5,
        0.178_095_274_762_166_7,
        -0.027_345_830_707_390_193,
        0.009_515_733_952_772_467,
        -0.004_008_634_128_051_572,
        0.001_421_922_226_394_859_2,
        -0.000_267_620_049_580_078_26,
    ];
    let a = v.abs();
    let rest = (a.one() - a).max(a.zero());
    let mut t = a.constant(T[6]);
    for c in T[..6].iter().rev() {
        t = t.mul_add(a, a.constant(*c));
    }
    let area = (-(rest * rest.sqrt())).mul_add(t, a.constant(FRAC_PI_4));
    R::select(v.lt(v.zero()), -area, area)
}

/// The integral ∫√(1 − v²) from 0 to v, for |v| ≤ 1, as a type parameter: [`Rounded`] or [`Exact`].
pub trait Segment<R> {
    /// Returns the integral ∫√(1 − v²) from 0 to `v`.
    fn of(v: R) -> R;
}

/// Implementation of [`Segment`] by the approximation [`segment`], for any number type.
#[derive(Clone, Copy, Debug)]
pub enum Rounded {}

/// Implementation of [`Segment`] by the closed form [`exact_segment`], for f64.
#[derive(Clone, Copy, Debug)]
pub enum Exact {}

impl<R: Real> Segment<R> for Rounded {
    #[inline(always)]
    fn of(v: R) -> R {
        segment(v)
    }
}

impl Segment<f64> for Exact {
    fn of(v: f64) -> f64 {
        exact_segment(v)
    }
}

/// Returns ∫√(1 − v²) from 0 to v, for |v| ≤ 1, by its closed form with an arcsine.
pub fn exact_segment(v: f64) -> f64 {
    0.5 * v.mul_add((1.0 - v * v).max(0.0).sqrt(), v.clamp(-1.0, 1.0).asin())
}

/// The point of a ball that a pixel shows: the nearest intersection of the ray through the pixel's centre with the
/// sphere. If the ray misses the ball, the point of the ray that is nearest to the ball's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallHit<R> {
    /// Planar depth of the point: divided by the depth of the ball's centre (perspective), or relative to the centre's
    /// depth, in world units (orthographic).
    pub depth: R,
    /// Unit outward normal of the ball at the point, in view space.
    pub normal: V3<R>,
}

impl<R: Real> BallHit<R> {
    /// Computes the point that a pixel shows. `center` is p_xy/p_z of the ball's centre (orthographic: unused). `size`
    /// is the ball's radius over p_z (orthographic: the radius). `offset` is the pixel's offset from the centre's
    /// projection, in pixels divided by the focal length.
    #[inline(always)]
    pub fn new(center: V2<R>, size: R, offset: V2<R>, projection: &Projection) -> Self {
        let (one, zero) = (size.one(), size.zero());
        let V2 { x, y } = offset;
        match projection.kind {
            // |t·D − c·p_z| = radius on the ray D = c + offset, for t = p_z·(1 + τ). No term is a difference of large
            // numbers: in f32 the depth of a ball far away is as exact as that of its centre.
            ProjectionKind::Perspective => {
                let ray = V3::new(center.x + x, center.y + y, one);
                let square = ray.dot(ray);
                let along = ray.x.mul_add(x, ray.y * y);
                let turn = R::difference_of_products(center.x, y, center.y, x);
                let missed = x.mul_add(x, y.mul_add(y, turn * turn));
                let root = (square * size).mul_add(size, -missed).max(zero).sqrt();
                let tau = -(along + root) / square;
                let normal = V3::new(ray.x.mul_add(tau, x), ray.y.mul_add(tau, y), tau);
                Self { depth: one + tau, normal: normal * normal.dot(normal).inverse_sqrt() }
            }
            ProjectionKind::Orthographic { .. } => {
                let root = size.mul_add(size, -x.mul_add(x, y * y)).max(zero).sqrt();
                let normal = V3::new(x, y, -root);
                Self { depth: -root, normal: normal * normal.dot(normal).inverse_sqrt() }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERSPECTIVE: Projection = Projection {
        kind: ProjectionKind::Perspective,
        focal_px: [300.0, 280.0],
        principal_px: [128.0, 100.5],
        near: 0.01,
    };

    fn orthographic() -> Projection {
        Projection { kind: ProjectionKind::Orthographic { height: 2.0, far: 9.0 }, ..PERSPECTIVE }
    }

    /// True if the ray through a pixel position meets the ball.
    fn is_hit(p: V3<f64>, radius: f64, projection: &Projection, pixel: V2<f64>) -> bool {
        let (o, d) = projection.ray(pixel);
        let to = p - o;
        let miss = to.cross(d).length() / d.length();
        miss <= radius
    }

    #[test]
    fn the_segment_is_within_its_error() {
        for i in -1000..=1000 {
            let v = f64::from(i) / 1000.0;
            assert!((segment(v) - exact_segment(v)).abs() < 2.1e-8, "{v}");
            assert!((f64::from(segment(v as f32)) - exact_segment(f64::from(v as f32))).abs() < 1.2e-7, "{v}");
        }
    }

    #[test]
    fn coverage_is_the_fraction_of_rays_that_meet_the_ball() {
        let balls = [(0.3, 0.2, 2.0, 0.05), (-1.1, 0.9, 1.5, 0.02), (0.8, -0.5, 1.2, 0.3), (0.01, 0.0, 3.0, 0.004)];
        for projection in [PERSPECTIVE, orthographic()] {
            for (x, y, z, radius) in balls {
                let p = V3::new(x, y, z);
                let outline = Outline::of_ball(p, radius, &projection);
                let center = projection.pixel(p) + outline.center;
                let (mut worst, mut squares, mut count) = (0.0f64, 0.0, 0u32);
                let (w, h) = (outline.extent.x.ceil() as i32 + 1, outline.extent.y.ceil() as i32 + 1);
                for j in -h..=h {
                    for i in -w..=w {
                        let corner = V2::new(center.x.floor() + f64::from(i), center.y.floor() + f64::from(j));
                        let exact = outline.coverage::<Exact>(corner - center);
                        const SIDE: i32 = 32;
                        let at = |k: i32| (f64::from(k) + 0.5) / f64::from(SIDE);
                        let hits = (0..SIDE * SIDE)
                            .filter(|k| is_hit(p, radius, &projection, corner + V2::new(at(k % SIDE), at(k / SIDE))))
                            .count();
                        let sampled = hits as f64 / f64::from(SIDE * SIDE);
                        if sampled > 0.0 && sampled < 1.0 {
                            worst = worst.max((exact - sampled).abs());
                            squares += (exact - sampled).powi(2);
                            count += 1;
                        }
                    }
                }
                let rmse = (squares / f64::from(count.max(1))).sqrt();
                assert!(count > 0 && rmse < 1.0 / 255.0 && worst < 0.02, "{p:?} {radius}: {rmse} {worst}");
            }
        }
    }

    #[test]
    fn the_area_of_a_small_ball_is_never_lost() {
        for radius in [1e-5, 3e-4, 2e-3, 1e-2] {
            let p = V3::new(0.4, -0.3, 2.0);
            for offset in [0.0, 0.13, 0.5, 0.77] {
                let outline = Outline::of_ball(p, radius, &PERSPECTIVE);
                let mut sums = [0.0; 2];
                for j in -3..3 {
                    for i in -3..3 {
                        let corner = V2::new(f64::from(i) + offset, f64::from(j) + 0.3);
                        sums[0] += outline.coverage::<Exact>(corner);
                        let corner = V2::new(corner.x as f32, corner.y as f32);
                        let p = V3::new(p.x as f32, p.y as f32, p.z as f32);
                        let outline = Outline::of_ball(p, radius as f32, &PERSPECTIVE);
                        sums[1] += f64::from(outline.coverage::<Rounded>(corner));
                    }
                }
                let area = std::f64::consts::PI * outline.extent.x * outline.extent.y * outline.width;
                assert!((sums[0] / area - 1.0).abs() < 2e-3, "{radius} {offset}: {} of {area}", sums[0]);
                assert!((sums[1] / area - 1.0).abs() < 2e-3, "{radius} {offset}: {} of {area} in f32", sums[1]);
            }
        }
    }

    #[test]
    fn both_formulas_in_f32_are_near_the_area() {
        for radius in [0.02, 0.1, 0.19, 0.21, 0.24, 0.3, 0.6, 1.2] {
            let p = V3::new(0.5, -0.4, 2.0);
            let exact = Outline::of_ball(p, radius, &PERSPECTIVE);
            let size = (exact.extent.x * exact.extent.y).sqrt();
            let single = Outline::of_ball(V3::new(0.5f32, -0.4, 2.0), radius as f32, &PERSPECTIVE);
            let mut worst = 0.0f64;
            for i in 0..4000 {
                let angle = f64::from(i) * 0.77;
                let (u, v) = (angle.cos(), angle.sin());
                let shift = V2::new(f64::from(i % 7) * 0.21 - 1.2, f64::from(i % 11) * 0.17 - 1.3);
                let on = V2::new(exact.extent.x * exact.skew.mul_add(v, exact.width * u), exact.extent.y * v);
                let corner = V2::new(on.x + shift.x, on.y + shift.y);
                let corner = V2::new(corner.x as f32, corner.y as f32);
                let truth = exact.coverage::<Exact>(V2::new(corner.x.into(), corner.y.into()));
                let found = if size >= LARGE_PX {
                    single.coverage_of_large(corner)
                } else {
                    single.coverage::<Rounded>(corner)
                };
                worst = worst.max((f64::from(found) - truth).abs());
            }
            assert!(worst < 1.1e-3, "{radius} ({size} px): {worst}");
        }
    }

    #[test]
    fn hits_lie_on_the_ball_and_on_the_ray() {
        for projection in [PERSPECTIVE, orthographic()] {
            let (p, radius) = (V3::new(0.4, -0.3, 2.0), 0.2);
            let (focal, anchor) = (projection.focal_px, projection.pixel(p));
            let scale = if projection.is_perspective() { p.z } else { 1.0 };
            for i in 0..60 {
                let d = V2::new(f64::from(i % 8) * 7.0 - 24.0, f64::from(i / 8) * 6.0 - 20.0);
                let hit = BallHit::new(
                    V2::new(p.x / p.z, p.y / p.z),
                    radius / scale,
                    V2::new(d.x / focal[0], d.y / focal[1]),
                    &projection,
                );
                let z = if projection.is_perspective() { p.z * hit.depth } else { p.z + hit.depth };
                let (o, direction) = projection.ray(anchor + d);
                let at = o + direction * z;
                let from = at - p;
                if is_hit(p, radius, &projection, anchor + d) {
                    assert!((from.length() - radius).abs() < 1e-12 && from.dot(direction) <= 0.0);
                } else {
                    assert!(from.dot(direction).abs() < 1e-12 || !projection.is_perspective());
                }
                assert!((hit.normal.dot(from) / from.length() - 1.0).abs() < 1e-9);
            }
        }
    }
}
