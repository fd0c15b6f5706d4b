//! Projection and blending of trained Gaussians, drawn one over another (`docs/gaussians.md`).
//!
//! Source: Huang et al. 2024 (2DGS), Kerbl et al. 2023 (3DGS) after Zwicker et al. 2001, *EWA Volume Splatting*.

use crate::mapping::{Footprint as SplatFootprint, Linear};
use crate::project::{Projected, ViewSplat};
use crate::projection::{Projection, ProjectionKind};
use crate::{Real, V2, V3, basis, filter, srgb};

/// Smallest planar depth, in world units, at which perspective views draw Gaussians: the near plane used in training.
pub const NEAR: f64 = 0.2;
/// Planar depth, in world units, that [`distortion_depth`] maps to 1.
const FAR: f64 = 100.0;
/// Largest α, the fraction of a pixel that one Gaussian covers; larger values are limited to it, as in training.
pub const MAX_ALPHA: f64 = 0.99;
/// Smallest α, the fraction of a pixel that one Gaussian covers, with which the Gaussian is blended into the pixel.
pub const MIN_ALPHA: f64 = 1.0 / 255.0;
/// Smallest transmittance of a pixel. Blending stops before the Gaussian that would reduce the transmittance below this
/// value.
pub const MIN_TRANSMITTANCE: f64 = 1e-4;
/// Largest sum of weights, Σw, of a pixel that counts as empty and has no depth.
pub const MIN_WEIGHT: f64 = 1e-12;
/// Factor k of the low-pass filter of flat Gaussians: ρ² is at most k·|d|², where d is the offset from the projected
/// centre in pixels.
const LOW_PASS: f64 = 2.0;
/// Variance, in square pixels, that is added to the footprints of solid Gaussians as their low-pass filter.
const DILATION: f64 = 0.3;
/// Value of [`GaussianForms::low_pass`] that disables the low-pass filter: it makes the filter's ρ² larger than any
/// visible one.
const NO_LOW_PASS: f64 = 1e30;
/// Distance from the centre of a Gaussian to its rim, in standard deviations, when it is filtered as a surface splat.
const RADIUS: f64 = 2.0;
/// Smallest filter radius h, in pixels, of the filter `principal` for Gaussians; replaces a radius of zero, which would
/// divide by zero.
const MIN_HALF_WIDTH_PX: f64 = 1e-6;
/// Largest slope x/z or y/z at which solid Gaussians are linearised, in half-widths (half-heights) of the image.
/// Centres farther outside are linearised at this slope, as in training.
const SLOPE_LIMIT: f64 = 1.3;
/// Largest sine of the angle between a flat Gaussian's plane and the view ray at which the Gaussian is edge-on and not
/// drawn (rendering model §2).
const EDGE_ON: f64 = 1e-5;
/// Largest absolute coefficient of the forms u and v of a flat Gaussian that is drawn without the filter `principal`;
/// larger ones are limited to it, so that products stay finite in f32.
const MAX_COEFFICIENT: f64 = 1e15;

/// Returns the smallest planar depth, in world units, at which a projection draws Gaussians: the camera's near plane,
/// but in perspective at least [`NEAR`].
pub fn near(projection: &Projection) -> f64 {
    if projection.is_perspective() { projection.near.max(NEAR) } else { projection.near }
}

/// A Gaussian in view space (x right, y down, z forward, eye at the origin).
#[derive(Clone, Copy, Debug)]
pub struct ViewGaussian {
    /// Position of the centre in view space, in world units.
    pub center: V3<f64>,
    /// Axes in view space: unit vectors of object space, transformed by the object's matrix. The first two axes of a
    /// flat Gaussian span its plane.
    pub axes: [V3<f64>; 3],
    /// Standard deviations along `axes`, in object units.
    pub sigmas: [f64; 3],
    /// True for a flat Gaussian (2DGS), false for a solid one (3DGS).
    pub flat: bool,
    /// Opacity at the centre, in [0, 1].
    pub opacity: f64,
}

/// A Gaussian projected to the image, in the form in which it is evaluated at pixels.
#[derive(Clone, Copy, Debug)]
pub struct ProjectedGaussian {
    /// Projected centre, in pixels from the image's upper left corner.
    pub center_px: V2<f64>,
    /// Linear forms from which ρ² and depth are computed at each pixel.
    pub forms: GaussianForms<f64>,
    /// Unit normal in view space, towards the eye; for a solid Gaussian, along the shortest axis of its ellipsoid.
    pub normal: V3<f64>,
    /// Smallest and largest offset from the centre, in pixels, of pixels where α is at least [`MIN_ALPHA`]. `None` if
    /// the projected ellipse reaches, or nearly reaches, the eye's plane, so that the offsets are unbounded.
    pub bounds_px: Option<[V2<f64>; 2]>,
    /// Smallest planar depth of the Gaussian's visible fragments, in world units.
    pub nearest: f64,
    /// Factor of α for a filtered Gaussian: the ratio of its own area to the filtered footprint's; 1 with the filters
    /// used in training.
    pub weight: f64,
}

/// Linear forms of the offset d, in pixels, from a Gaussian's projected centre. The ray through the pixel meets a flat
/// Gaussian's plane at (u, v)/w standard deviations and depth z/w. For a solid Gaussian, w is 1 and (u, v) is the
/// position in standard deviations of its projected footprint.
#[derive(Clone, Copy, Debug)]
pub struct GaussianForms<R> {
    /// Change of the form u per pixel to the right and down; at the projected centre u is 0.
    pub u: [R; 2],
    /// Change of the form v per pixel to the right and down; at the projected centre v is 0.
    pub v: [R; 2],
    /// Change of the form w per pixel to the right and down, and its value at the projected centre.
    pub w: [R; 3],
    /// Change of the form z per pixel to the right and down, and its value at the projected centre.
    pub z: [R; 3],
    /// Factor k of the low-pass filter of flat Gaussians, which limits ρ² to k·|d|². A huge value disables the filter.
    pub low_pass: R,
}

impl<R: Real> GaussianForms<R> {
    /// Returns ρ², the squared distance from the Gaussian's centre in standard deviations, and the depth at pixel
    /// offset `d`. For flat Gaussians the low-pass filter limits ρ² to `low_pass`·|d|². The depth is infinite or NaN if
    /// the ray is parallel to the plane.
    #[inline(always)]
    pub fn at(&self, d: V2<R>) -> (R, R) {
        let linear = |f: [R; 3]| f[0].mul_add(d.x, f[1].mul_add(d.y, f[2]));
        let inverse = d.x.one() / linear(self.w);
        let u = self.u[0].mul_add(d.x, self.u[1] * d.y) * inverse;
        let v = self.v[0].mul_add(d.x, self.v[1] * d.y) * inverse;
        let on_plane = u.mul_add(u, v * v);
        let on_screen = self.low_pass * d.x.mul_add(d.x, d.y * d.y);
        (on_plane.min(on_screen), linear(self.z) * inverse)
    }
}

impl ViewGaussian {
    /// Projects the Gaussian to an image of `size_px` (width and height in pixels). `None` if it is invisible: too
    /// near, too far, edge-on, without area, or too transparent.
    pub fn project(
        &self,
        projection: &Projection,
        size_px: [f64; 2],
        rules: &GaussianRules,
    ) -> Option<ProjectedGaussian> {
        let p = self.center;
        let far = projection.far();
        // NaN fails the test.
        let is_within = p.z > near(projection) && p.z <= far && self.opacity >= MIN_ALPHA;
        if !is_within {
            return None;
        }
        let reach = 2.0 * (self.opacity / MIN_ALPHA).ln();
        let center_px = projection.pixel(p);
        let Footprint { forms, normal, bounds_px, nearest, weight } = match self.flat {
            true => self.flat(projection, reach, rules)?,
            false => self.solid(projection, size_px, reach, rules),
        };
        let toward = if projection.is_perspective() { normal.dot(p) } else { normal.z };
        let normal = if toward > 0.0 { -normal } else { normal };
        Some(ProjectedGaussian { center_px, forms, normal, bounds_px, nearest, weight })
    }

    /// Projects a flat Gaussian by the exact intersection of rays with its plane. `reach` is the largest visible ρ².
    fn flat(&self, projection: &Projection, reach: f64, rules: &GaussianRules) -> Option<Footprint> {
        let (p, [a, b, _], [fx, fy]) = (self.center, self.axes, projection.focal_px);
        let cross = a.cross(b);
        let area = cross.length();
        let n = cross * (1.0 / area);
        let perspective = projection.is_perspective();
        let (facing, distance) = if perspective { (n.dot(p), p.length()) } else { (n.z, 1.0) };
        let [su, sv, _] = self.sigmas;
        let is_seen = facing.abs() > EDGE_ON * distance && su > 0.0 && sv > 0.0;
        if !is_seen {
            return None;
        }
        if let Some(h_px) = rules.principal_px {
            return Some(self.principal(projection, reach, n, h_px));
        }
        let (of_u, of_v) =
            if perspective { (b.cross(p), p.cross(a)) } else { (V3::new(b.y, -b.x, 0.0), V3::new(-a.y, a.x, 0.0)) };
        let form = |c: V3<f64>, sigma: f64| {
            [c.x / fx, c.y / fy].map(|c| (c / (area * sigma)).clamp(-MAX_COEFFICIENT, MAX_COEFFICIENT))
        };
        let slope = [n.x / fx, n.y / fy];
        let (w, z) = if perspective {
            ([slope[0], slope[1], facing / p.z], [0.0, 0.0, facing])
        } else {
            ([0.0, 0.0, n.z], [-slope[0], -slope[1], p.z * n.z])
        };
        let forms = GaussianForms { u: form(of_u, su), v: form(of_v, sv), w, z, low_pass: LOW_PASS };
        let of_axis = |axis: V3<f64>, sigma: f64| match perspective {
            true => {
                let k = sigma / p.z;
                (V2::new(fx * (axis.x - axis.z * p.x / p.z) * k, fy * (axis.y - axis.z * p.y / p.z) * k), axis.z * k)
            }
            false => (V2::new(fx * axis.x * sigma, fy * axis.y * sigma), 0.0),
        };
        let ((s, s_depth), (t, t_depth)) = (of_axis(a, su), of_axis(b, sv));
        let low_pass = (reach / LOW_PASS).sqrt();
        let bounds = ellipse_bounds([s, t], [s_depth, t_depth], reach).map(|[lo, hi]| {
            [V2::new(lo.x.min(-low_pass), lo.y.min(-low_pass)), V2::new(hi.x.max(low_pass), hi.y.max(low_pass))]
        });
        let on_plane = p.z - (reach * (a.z * su).hypot(b.z * sv).powi(2)).sqrt();
        let per_pixel = slope[0].hypot(slope[1]) / facing.abs();
        let on_screen = match perspective {
            true => (p.z.recip() + low_pass * per_pixel).recip(),
            false => p.z - low_pass * per_pixel,
        };
        Some(Footprint { forms, normal: n, bounds_px: bounds, nearest: on_plane.min(on_screen), weight: 1.0 })
    }

    /// Projects a flat Gaussian as a surface splat of two standard deviations with the filter `principal`. `reach` is
    /// the largest visible ρ², `n` the unit normal, and `h_px` the filter radius.
    fn principal(&self, projection: &Projection, reach: f64, n: V3<f64>, h_px: f64) -> Footprint {
        let (p, [a, b, _], [su, sv, _]) = (self.center, self.axes, self.sigmas);
        let splat = ViewSplat { p, s: a * (RADIUS * su), t: b * (RADIUS * sv), n };
        let filtered = filter::principal(&Projected::new(&splat, projection), h_px.max(MIN_HALF_WIDTH_PX), true);
        let SplatFootprint { u, v, w } = filtered.footprint;
        let per_sigma = |form: Linear<f64>| [RADIUS * form.x, RADIUS * form.y];
        let (u, v) = (per_sigma(u), per_sigma(v));
        // The forms are the rows of an orthogonal matrix divided by the axes' lengths, so these are the columns of the
        // inverse.
        let axis = |[x, y]: [f64; 2]| V2::new(x, y) * (x * x + y * y).recip();
        let (s, t) = (axis(u), axis(v));
        let depth = |axis: V2<f64>| -(w.x * axis.x + w.y * axis.y);
        let (s_depth, t_depth) = (depth(s), depth(t));
        let perspective = projection.is_perspective();
        let (w, z) = match perspective {
            true => ([w.x, w.y, 1.0], [0.0, 0.0, p.z]),
            false => ([0.0, 0.0, 1.0], [-w.x, -w.y, p.z]),
        };
        let slant = s_depth.hypot(t_depth);
        let bounds_px = match perspective {
            true => ellipse_bounds([s, t], [s_depth, t_depth], reach),
            false => ellipse_bounds([s, t], [0.0; 2], reach),
        };
        Footprint {
            forms: GaussianForms { u, v, w, z, low_pass: NO_LOW_PASS },
            normal: n,
            bounds_px,
            nearest: p.z - reach.sqrt() * slant * if perspective { p.z } else { 1.0 },
            weight: filtered.weight_scale,
        }
    }

    /// Projects a solid Gaussian, with the projection linearised at its centre. `reach` is the largest visible ρ².
    fn solid(&self, projection: &Projection, size_px: [f64; 2], reach: f64, rules: &GaussianRules) -> Footprint {
        let (p, [fx, fy]) = (self.center, projection.focal_px);
        let limited = |x: f64, f: f64, size: f64| {
            let limit = SLOPE_LIMIT * 0.5 * size / f;
            (x / p.z).clamp(-limit, limit)
        };
        let (sx, sy) = (limited(p.x, fx, size_px[0]), limited(p.y, fy, size_px[1]));
        let dilation = if rules.principal_px.is_some() { 0.0 } else { DILATION };
        let (mut xx, mut xy, mut yy) = (dilation, 0.0, dilation);
        // Covariances of the depth with a pixel's position.
        let (mut xz, mut yz) = (0.0, 0.0);
        for (axis, sigma) in self.axes.into_iter().zip(self.sigmas) {
            let c = axis * sigma;
            let (x, y) = match projection.kind {
                ProjectionKind::Perspective => (fx * (c.x - sx * c.z) / p.z, fy * (c.y - sy * c.z) / p.z),
                ProjectionKind::Orthographic { .. } => (fx * c.x, fy * c.y),
            };
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
            (xz, yz) = (xz + x * c.z, yz + y * c.z);
        }
        let (u, v, weight) = match rules.principal_px {
            None => {
                let determinant = f64::difference_of_products(xx, yy, xy, xy).max(DILATION * DILATION);
                ([(yy / determinant).sqrt(), -xy / (yy * determinant).sqrt()], [0.0, yy.sqrt().recip()], 1.0)
            }
            Some(h_px) => {
                let h = (h_px / RADIUS).max(MIN_HALF_WIDTH_PX);
                let (half, middle) = (0.5 * (xx - yy), 0.5 * (xx + yy));
                let [long, short] = [1.0, -1.0].map(|sign| (middle + sign * half.hypot(xy)).max(0.0).sqrt());
                let (sin, cos) = (0.5 * xy.atan2(half)).sin_cos();
                let (wide, thin) = (long.max(h), short.max(h));
                (xx, yy) = ((wide * cos).powi(2) + (thin * sin).powi(2), (wide * sin).powi(2) + (thin * cos).powi(2));
                ([cos / wide, sin / wide], [-sin / thin, cos / thin], (long / wide) * (short / thin))
            }
        };
        // Σ⁻¹ is u·uᵀ + v·vᵀ.
        let (zu, zv) = if rules.depth_along_ray { (u[0] * xz + u[1] * yz, v[0] * xz + v[1] * yz) } else { (0.0, 0.0) };
        let forms = GaussianForms {
            u,
            v,
            w: [0.0, 0.0, 1.0],
            z: [u[0] * zu + v[0] * zv, u[1] * zu + v[1] * zv, p.z],
            low_pass: NO_LOW_PASS,
        };
        let half = V2::new((reach * xx).sqrt(), (reach * yy).sqrt());
        let normal = basis::shortest_axis(self.axes, self.sigmas);
        Footprint { forms, normal, bounds_px: Some([-half, half]), nearest: p.z - reach.sqrt() * zu.hypot(zv), weight }
    }
}

/// Fields of a [`ProjectedGaussian`] except its centre; the normal may face away from the eye.
struct Footprint {
    forms: GaussianForms<f64>,
    normal: V3<f64>,
    bounds_px: Option<[V2<f64>; 2]>,
    nearest: f64,
    weight: f64,
}

/// Returns the bounds of a projected ellipse around its centre. Points of the ellipse are at (A·e)/(1 + b·e) with |e|²
/// = `reach`. A has the columns `s` and `t`, and b = (`s_depth`, `t_depth`). `None` if the ellipse reaches the eye's
/// plane, or nearly does, since rounding matters there.
fn ellipse_bounds([s, t]: [V2<f64>; 2], [s_depth, t_depth]: [f64; 2], reach: f64) -> Option<[V2<f64>; 2]> {
    let d = 1.0 - reach * (s_depth * s_depth + t_depth * t_depth);
    let extent = |s: f64, t: f64| {
        let middle = -reach * (s * s_depth + t * t_depth) / d;
        let half = (middle * middle + reach * (s * s + t * t) / d).sqrt();
        [middle - half, middle + half]
    };
    let ([x0, x1], [y0, y1]) = (extent(s.x, t.x), extent(s.y, t.y));
    (d > 1e-6).then(|| [V2::new(x0, y0), V2::new(x1, y1)])
}

/// Options of the projection of Gaussians; the default draws them as they were trained.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GaussianRules {
    /// True to evaluate a solid Gaussian's depth at its densest point along a pixel's ray (Radl et al. 2024,
    /// StopThePop). In the linearised projection this is its mean depth at that pixel. False for the depth of its
    /// centre.
    pub depth_along_ray: bool,
    /// Smallest half-axes, in pixels, of Gaussians drawn with the filter `principal` of surface splats (rendering model
    /// §4); half-axes measure two standard deviations. The filter replaces the low-pass filters used in training.
    /// `None` for those.
    pub principal_px: Option<f64>,
}

/// Rounds a positive depth in world units to 17 significant bits, so that rounding errors rarely decide the order of
/// Gaussians in one plane. Returns integers in the order of depths, for sorting.
pub fn depth_step(z: f64) -> u64 {
    (z.to_bits() + (1 << (DEPTH_BITS_F64 - 1))) >> DEPTH_BITS_F64
}

/// Rounds a positive f32 depth to 17 significant bits like [`depth_step`]. Returns integers in the order of depths,
/// which differ from those of [`depth_step`].
#[inline(always)]
pub fn depth_step_f32(z: f32) -> u32 {
    (z.to_bits() + (1 << (DEPTH_BITS_F32 - 1))) >> DEPTH_BITS_F32
}

/// Number of low bits of an f64 depth that [`depth_step`] omits.
const DEPTH_BITS_F64: u32 = 52 - 16;
/// Number of low bits of an f32 depth that [`depth_step_f32`] omits.
const DEPTH_BITS_F32: u32 = 23 - 16;

/// Returns the depth that the plane `distortion` compares, from a planar depth in world units: 0 at [`NEAR`], 1 at 100
/// units. As in 2DGS, it is linear in 1/z.
#[inline(always)]
pub fn distortion_depth<R: Real>(z: R) -> R {
    let scale = FAR / (FAR - NEAR);
    (z.one() - z.constant(NEAR) / z) * z.constant(scale)
}

/// Constant basis function of real spherical harmonics: ½·√(1/π).
pub const SH_C0: f64 = 0.282_094_791_773_878_14;

/// Evaluates a colour from (degree + 1)² coefficients of real spherical harmonics in a unit direction from the eye. The
/// colour is ½ + Σ c·Y, at least 0. Coefficients beyond the first 16 are ignored.
pub fn color(coefficients: &[[f32; 3]], [x, y, z]: [f64; 3]) -> [f64; 3] {
    const C1: f64 = 0.488_602_511_902_919_9;
    const C2: [f64; 3] = [1.092_548_430_592_079_2, 0.315_391_565_252_520_05, 0.546_274_215_296_039_6];
    const C3: [f64; 5] = [
        0.590_043_589_926_643_5,
        2.890_611_442_640_554,
        0.457_045_799_464_465_8,
        0.373_176_332_590_115_4,
        1.445_305_721_320_277,
    ];
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let basis = [
        SH_C0,
        -C1 * y,
        C1 * z,
        -C1 * x,
        C2[0] * x * y,
        -C2[0] * y * z,
        C2[1] * (2.0 * zz - xx - yy),
        -C2[0] * x * z,
        C2[2] * (xx - yy),
        -C3[0] * y * (3.0 * xx - yy),
        C3[1] * x * y * z,
        -C3[2] * y * (4.0 * zz - xx - yy),
        C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -C3[2] * x * (4.0 * zz - xx - yy),
        C3[4] * z * (xx - yy),
        -C3[0] * x * (xx - 3.0 * yy),
    ];
    let mut sum = [0.5; 3];
    for (c, y) in coefficients.iter().zip(basis) {
        for (sum, c) in sum.iter_mut().zip(c) {
            *sum += f64::from(*c) * y;
        }
    }
    sum.map(|c| srgb::limit_color(c.max(0.0)))
}

/// Converts the scene's background, a linear colour with straight alpha, to the form in which it is blended behind
/// Gaussians: RGB times alpha, and alpha. RGB is in the Gaussians' colour space: linear if `linear_colors`, else
/// sRGB-encoded.
pub fn background([r, g, b, a]: [f64; 4], linear_colors: bool) -> [f64; 4] {
    let [r, g, b] = [r, g, b].map(|c| srgb::limit_color(if linear_colors { c } else { srgb::encode(c.max(0.0)) }) * a);
    [r, g, b, a]
}

/// Returns the linear premultiplied RGBA of a pixel: the blended colours of its Gaussians, plus [`background`] times
/// the transmittance that they leave.
pub fn resolve(colors: [f64; 3], transmittance: f64, background: [f64; 4], linear_colors: bool) -> [f64; 4] {
    let alpha = 1.0 - transmittance + transmittance * background[3];
    let over = |k: usize| transmittance.mul_add(background[k], colors[k]);
    let linear = |c: f64| if linear_colors || alpha <= 0.0 { c } else { srgb::decode(c / alpha) * alpha };
    let [r, g, b] = [0, 1, 2].map(|k| srgb::limit_color(linear(over(k))));
    [r, g, b, alpha]
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEW: Projection = Projection {
        kind: ProjectionKind::Perspective,
        focal_px: [500.0, 480.0],
        principal_px: [320.0, 240.0],
        near: 0.01,
    };
    const ORTHO: Projection =
        Projection { kind: ProjectionKind::Orthographic { height: 2.0, far: 50.0 }, focal_px: [240.0, 240.0], ..VIEW };

    /// Returns unit axes, turned by two angles.
    fn turned(azimuth: f64, tilt: f64) -> [V3<f64>; 3] {
        let ((sa, ca), (st, ct)) = (azimuth.sin_cos(), tilt.sin_cos());
        [V3::new(ca, sa, 0.0), V3::new(-sa * ct, ca * ct, st), V3::new(sa * st, -ca * st, ct)]
    }

    fn gaussian(center: [f64; 3], tilt: f64, sigmas: [f64; 3], flat: bool) -> ViewGaussian {
        let [x, y, z] = center;
        ViewGaussian { center: V3::new(x, y, z), axes: turned(0.7, tilt), sigmas, flat, opacity: 0.8 }
    }

    #[test]
    fn rays_meet_points_of_the_plane_where_they_are() {
        for projection in [VIEW, ORTHO] {
            for tilt in [0.0, 0.5, 1.4, 1.57, 2.5] {
                for scale in [1e-6, 0.01, 0.5] {
                    let g = gaussian([0.3, -0.2, 4.0], tilt, [scale, 2.0 * scale, 0.0], true);
                    let seen = g.project(&projection, [640.0, 480.0], &GaussianRules::default()).unwrap();
                    let [a, b, _] = g.axes;
                    for (u, v) in [(0.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.6, 1.1)] {
                        let q = g.center + a * (u * scale) + b * (v * 2.0 * scale);
                        let d = projection.pixel(q);
                        let d = V2::new(d.x - seen.center_px.x, d.y - seen.center_px.y);
                        // Without the low-pass filter.
                        let (rho, z) = GaussianForms { low_pass: 1e30, ..seen.forms }.at(d);
                        // A pixel's coordinate has an error of 1e-13, which edge-on planes and tiny splats magnify.
                        let error = 1e-9 + 1e-12 / scale / tilt.cos().abs();
                        assert!((rho - (u * u + v * v)).abs() < 20.0 * error, "{tilt} {scale} {u} {v}: {rho}");
                        assert!((z - q.z).abs() < error, "{tilt} {scale}: {z} {}", q.z);
                    }
                    let (rho, _) = seen.forms.at(V2::new(0.3, -0.4));
                    assert!(rho <= 2.0 * 0.25 + 1e-12);
                }
            }
        }
    }

    #[test]
    fn bounds_hold_all_that_shows_and_hardly_more() {
        for (projection, principal_px) in [(VIEW, None), (ORTHO, None), (VIEW, Some(0.7)), (ORTHO, Some(0.7))] {
            let rules = GaussianRules { principal_px, ..GaussianRules::default() };
            for (flat, tilt, scale) in
                [(true, 0.3, 0.05), (true, 1.3, 0.3), (true, 1.0, 1e-4), (false, 0.9, 0.1), (false, 0.2, 1e-5)]
            {
                let g = gaussian([0.3, -0.2, 4.0], tilt, [scale, 2.0 * scale, 0.3 * scale], flat);
                let seen = g.project(&projection, [640.0, 480.0], &rules).unwrap();
                let [lo, hi] = seen.bounds_px.unwrap();
                let (mut found_lo, mut found_hi) = (V2::new(0.0, 0.0), V2::new(0.0, 0.0));
                let steps = 400;
                for i in 0..=steps {
                    for j in 0..=steps {
                        let at = |lo: f64, hi: f64, i: i32| {
                            lo + 1.2 * (hi - lo) * f64::from(i) / f64::from(steps) - 0.1 * (hi - lo)
                        };
                        let d = V2::new(at(lo.x, hi.x, i), at(lo.y, hi.y, j));
                        let (rho, z) = seen.forms.at(d);
                        if g.opacity * (-0.5 * rho).exp() >= MIN_ALPHA && z > 0.0 {
                            found_lo = V2::new(found_lo.x.min(d.x), found_lo.y.min(d.y));
                            found_hi = V2::new(found_hi.x.max(d.x), found_hi.y.max(d.y));
                        }
                    }
                }
                let size = [hi.x - lo.x, hi.y - lo.y];
                let slack = [found_lo.x - lo.x, found_lo.y - lo.y, hi.x - found_hi.x, hi.y - found_hi.y];
                for (k, slack) in slack.into_iter().enumerate() {
                    // A step of the search is 0.003 of the size.
                    assert!(slack >= -1e-9 && slack < 0.02 * size[k % 2], "{flat} {tilt} {scale}: {slack} of {size:?}");
                }
            }
        }
    }

    #[test]
    fn nothing_shows_before_the_nearest_depth_and_something_hardly_behind_it() {
        for (projection, principal_px) in [(VIEW, None), (ORTHO, None), (VIEW, Some(0.7)), (ORTHO, Some(0.7))] {
            let rules = GaussianRules { depth_along_ray: true, principal_px };
            for (flat, tilt, scale) in
                [(true, 0.3, 0.05), (true, 1.3, 0.3), (true, 1.55, 1e-3), (false, 0.9, 0.1), (false, 0.2, 1e-5)]
            {
                let g = gaussian([0.3, -0.2, 4.0], tilt, [scale, 2.0 * scale, 0.3 * scale], flat);
                let seen = g.project(&projection, [640.0, 480.0], &rules).unwrap();
                let [lo, hi] = seen.bounds_px.unwrap();
                let (mut found, steps) = (f64::INFINITY, 600);
                for at in 0..=steps * steps {
                    let part = |k: i32| f64::from(k) / f64::from(steps);
                    let (x, y) = (part(at % (steps + 1)), part(at / (steps + 1)));
                    let (rho, z) = seen.forms.at(V2::new(lo.x + x * (hi.x - lo.x), lo.y + y * (hi.y - lo.y)));
                    if g.opacity * (-0.5 * rho).exp() >= MIN_ALPHA && z > 0.0 {
                        found = found.min(z);
                    }
                }
                let extent = 4.0 - seen.nearest;
                assert!(found >= seen.nearest - 1e-9 && found <= seen.nearest + 0.05 * extent + 1e-9, "{flat} {tilt}");
            }
        }
    }

    #[test]
    fn solid_gaussians_are_as_deep_as_they_are_dense_along_rays() {
        let size = 640.0;
        let rules = GaussianRules { depth_along_ray: true, principal_px: None };
        let g = gaussian([0.3, -0.2, 4.0], 0.9, [0.2, 0.1, 0.05], false);
        // Pixels too small to blur, around the centre, where the projection is linear.
        let fine = Projection { focal_px: [5e5, 4.8e5], principal_px: [3.2e5, 2.4e5], ..VIEW };
        let seen = g.project(&fine, [1e3 * size, 750.0 * size], &rules).unwrap();
        for d in [V2::new(0.0, 0.0), V2::new(40.0, 0.0), V2::new(-10.0, 30.0)] {
            let px = V2::new(seen.center_px.x + d.x, seen.center_px.y + d.y);
            let ray = V3::new((px.x - 3.2e5) / 5e5, (px.y - 2.4e5) / 4.8e5, 1.0);
            // The density at p + t·ray is exp(−½ Σ ((t·ray − c)·axis/σ)²), largest where its derivative is 0.
            let (mut over, mut under) = (0.0, 0.0);
            for (axis, sigma) in g.axes.into_iter().zip(g.sigmas) {
                let (r, c) = (ray.dot(axis) / sigma, g.center.dot(axis) / sigma);
                (over, under) = (over + r * c, under + r * r);
            }
            let (_, z) = seen.forms.at(d);
            assert!((z - over / under).abs() < 1e-6, "{d:?}: {z} {}", over / under);
        }
        let (_, z) = g.project(&fine, [1e3 * size; 2], &GaussianRules::default()).unwrap().forms.at(V2::new(40.0, 0.0));
        assert_eq!(z, 4.0);
    }

    #[test]
    fn principal_lengthens_projected_axes_and_weighs_by_their_area() {
        let h = 0.7;
        let rules = GaussianRules { principal_px: Some(h), ..GaussianRules::default() };
        for projection in [VIEW, ORTHO] {
            for tilt in [0.0, 0.5, 1.4] {
                for scale in [1e-5, 1e-4, 1e-3, 3e-3, 0.1] {
                    for flat in [true, false] {
                        let sigmas = [scale, 2.0 * scale, if flat { 0.0 } else { 0.3 * scale }];
                        let g = gaussian([0.3, -0.2, 4.0], tilt, sigmas, flat);
                        let seen = g.project(&projection, [640.0, 480.0], &rules).unwrap();
                        // The covariance of the projection, by small differences, of two standard deviations.
                        let at = |v: V3<f64>| projection.pixel(g.center + v);
                        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
                        for (axis, sigma) in g.axes.into_iter().zip(sigmas) {
                            let (step, length) = (1e-5, 2.0 * sigma);
                            let (a, b) = (at(axis * step), at(axis * -step));
                            let x = (a.x - b.x) / (2.0 * step) * length;
                            let y = (a.y - b.y) / (2.0 * step) * length;
                            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
                        }
                        let c = glam::DMat2::from_cols_array(&[xx, xy, xy, yy]);
                        let (mean, half) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
                        let lengths = [mean + half, (mean - half).max(0.0)].map(f64::sqrt);
                        let share: f64 = lengths.iter().map(|l| (l / h).min(1.0)).product();
                        assert!((seen.weight - share).abs() < 1e-6 * share, "{flat} {tilt} {scale}: {}", seen.weight);
                        // Projectors onto the two axes.
                        let one = (c - glam::DMat2::IDENTITY * (mean - half)) * (0.5 / half);
                        let other = glam::DMat2::IDENTITY - one;
                        let wide = one * lengths[0].max(h).powi(-2) + other * lengths[1].max(h).powi(-2);
                        for d in [glam::DVec2::new(0.2, 0.1), glam::DVec2::new(-0.3, 0.4)] {
                            let exact = 4.0 * d.dot(wide * d);
                            let (rho, z) = seen.forms.at(V2::new(d.x, d.y));
                            // Perspective within a footprint of half a pixel, except at an edge.
                            assert!((rho - exact).abs() < 1e-2 * exact, "{flat} {tilt} {scale}: {rho} {exact}");
                            assert!((z - 4.0).abs() < 0.1, "{z}");
                        }
                    }
                }
            }
        }
        // A footprint that is wide on the screen stays exact.
        let g = gaussian([0.3, -0.2, 4.0], 1.0, [0.1, 0.2, 0.0], true);
        let [own, trained] =
            [&rules, &GaussianRules::default()].map(|rules| g.project(&VIEW, [640.0, 480.0], rules).unwrap());
        for d in [V2::new(9.0, 3.0), V2::new(-20.0, 11.0)] {
            let (rho, z) = own.forms.at(d);
            let (exact, exact_z) = trained.forms.at(d);
            assert!((rho - exact).abs() < 1e-9 * exact && (z - exact_z).abs() < 1e-9 && own.weight == 1.0);
        }
    }

    #[test]
    fn depth_steps_are_in_order_and_wider_than_rounding() {
        assert!(depth_step(2.0) == depth_step(2.0 - 1e-6) && depth_step(2.0) == depth_step(2.0 + 1e-6));
        assert!(depth_step_f32(2.0) == depth_step_f32(2.0 - 1e-6) && depth_step_f32(0.7) < depth_step_f32(0.7001));
        assert!(depth_step(0.7) < depth_step(0.7001) && depth_step(1e9) < depth_step(f64::INFINITY));
    }

    #[test]
    fn gaussians_that_show_nothing_are_left_out() {
        let shown = |g: ViewGaussian, p: &Projection| g.project(p, [640.0, 480.0], &GaussianRules::default()).is_some();
        let plain = gaussian([0.0, 0.0, 1.0], 0.2, [0.1; 3], true);
        assert!(shown(plain, &VIEW) && shown(plain, &ORTHO));
        let moved = |z: f64| ViewGaussian { center: V3::new(0.0, 0.0, z), ..plain };
        assert!(!shown(moved(0.2), &VIEW) && shown(moved(0.2001), &VIEW) && shown(moved(0.02), &ORTHO));
        assert!(!shown(moved(f64::NAN), &VIEW) && !shown(moved(60.0), &ORTHO));
        assert!(!shown(ViewGaussian { opacity: 0.0039, ..plain }, &VIEW));
        assert!(shown(ViewGaussian { opacity: 1.0, ..plain }, &VIEW));
        let edge = std::f64::consts::FRAC_PI_2;
        assert!(!shown(ViewGaussian { axes: turned(0.0, edge), ..plain }, &VIEW));
        assert!(shown(ViewGaussian { axes: turned(0.0, edge + 1e-4), ..plain }, &VIEW));
        assert!(!shown(ViewGaussian { sigmas: [0.1, 0.0, 0.1], ..plain }, &VIEW));
        // The tiniest Gaussian has the extent of the low-pass filter.
        let point = ViewGaussian { sigmas: [1e-38; 3], ..plain }
            .project(&VIEW, [640.0, 480.0], &GaussianRules::default())
            .unwrap();
        let (rho, z) = point.forms.at(V2::new(0.5, 0.5));
        assert_eq!((rho, (z - 1.0).abs() < 1e-2), (1.0, true));
    }

    #[test]
    fn solid_gaussians_on_the_axis_project_as_their_covariance() {
        let axes = [V3::new(1.0, 0.0, 0.0), V3::new(0.0, 1.0, 0.0), V3::new(0.0, 0.0, 1.0)];
        let g =
            ViewGaussian { center: V3::new(0.0, 0.0, 2.0), axes, sigmas: [0.1, 0.2, 0.3], flat: false, opacity: 1.0 };
        let seen = g.project(&VIEW, [640.0, 480.0], &GaussianRules::default()).unwrap();
        let variance = [(500.0 * 0.1 / 2.0_f64).powi(2) + 0.3, (480.0 * 0.2 / 2.0_f64).powi(2) + 0.3];
        for d in [V2::new(7.0, 0.0), V2::new(0.0, 30.0), V2::new(-12.0, 9.0)] {
            let exact = d.x * d.x / variance[0] + d.y * d.y / variance[1];
            let (rho, z) = seen.forms.at(d);
            assert!((rho - exact).abs() < 1e-12 && z == 2.0, "{rho} {exact}");
        }
        assert!((seen.normal.x.abs() - 1.0).abs() < 1e-12);
    }

    /// Returns the exact value of a real harmonic, from its definition by Legendre functions.
    fn harmonic(l: i32, m: i32, [x, y, z]: [f64; 3]) -> f64 {
        let (theta, phi) = (z.acos(), y.atan2(x));
        let k = m.unsigned_abs() as usize;
        let (s, c) = (theta.sin(), theta.cos());
        // Associated Legendre functions with the Condon–Shortley phase.
        let p = match (l, k) {
            (0, 0) => 1.0,
            (1, 0) => c,
            (1, 1) => -s,
            (2, 0) => 0.5 * (3.0 * c * c - 1.0),
            (2, 1) => -3.0 * c * s,
            (2, 2) => 3.0 * s * s,
            (3, 0) => 0.5 * (5.0 * c.powi(3) - 3.0 * c),
            (3, 1) => -1.5 * (5.0 * c * c - 1.0) * s,
            (3, 2) => 15.0 * c * s * s,
            _ => -15.0 * s.powi(3),
        };
        let factorial = |n: i32| (1..=n).map(f64::from).product::<f64>();
        let m_abs = m.abs();
        let norm =
            (f64::from(2 * l + 1) / (4.0 * std::f64::consts::PI) * factorial(l - m_abs) / factorial(l + m_abs)).sqrt();
        let root2 = std::f64::consts::SQRT_2;
        match m {
            0 => norm * p,
            m if m > 0 => root2 * norm * p * (f64::from(m) * phi).cos(),
            m => root2 * norm * p * (f64::from(-m) * phi).sin(),
        }
    }

    #[test]
    fn harmonics_are_those_of_their_definition() {
        for direction in [[0.6, 0.0, 0.8], [-0.36, 0.48, 0.8], [0.48, -0.6, -0.64], [0.0, 0.6, -0.8]] {
            let mut i = 0;
            for l in 0..=3 {
                for m in -l..=l {
                    let mut coefficients = vec![[0.0; 3]; 16];
                    coefficients[i] = [0.1, -0.2, 0.3];
                    let found = color(&coefficients, direction);
                    for (found, c) in found.into_iter().zip(coefficients[i]) {
                        let exact = 0.5 + f64::from(c) * harmonic(l, m, direction);
                        assert!((found - exact).abs() < 1e-12, "{l} {m} {direction:?}: {found} {exact}");
                    }
                    i += 1;
                }
            }
        }
        assert_eq!(color(&[[-9.0, 0.0, 9.0]], [0.0, 0.0, 1.0])[..2], [0.0, 0.5]);
    }

    #[test]
    fn pixels_blend_as_displayed_and_come_out_linear() {
        let half = background([1.0, 1.0, 1.0, 1.0], false);
        let [r, _, _, a] = resolve([0.25, 0.0, 0.0], 0.5, half, false);
        assert!((srgb::encode(r) - 0.75).abs() < 1e-7 && a == 1.0);
        let [r, _, _, a] = resolve([0.25, 0.0, 0.0], 0.5, [0.0; 4], false);
        assert!((srgb::encode(r / a) - 0.5).abs() < 1e-7 && a == 0.5);
        assert_eq!(resolve([0.25, 0.0, 0.0], 0.5, [0.0; 4], true), [0.25, 0.0, 0.0, 0.5]);
        assert_eq!(resolve([0.0; 3], 1.0, [0.0; 4], false), [0.0; 4]);
        assert!((distortion_depth(0.2), distortion_depth(100.0)) == (0.0, 1.0));
    }
}
