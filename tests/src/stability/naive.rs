//! Published formulas that Surfel replaces, in f32, and their errors.

use super::exact::Exact;
use super::{Image, Naive, Probe, Truth};
use surfel_math::clip::Curve;
use surfel_math::project::{Projected, ViewSplat};
use surfel_math::{V2, V3, filter, kernel};

fn single(v: V3<f64>) -> V3<f32> {
    V3::new(v.x as f32, v.y as f32, v.z as f32)
}

fn cross(a: V3<f32>, b: V3<f32>) -> V3<f32> {
    V3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}

/// Returns the error of a probe's published formula, in units of [`Probe::scale`]; NaN without a formula. A pixel whose
/// result isn't a number counts as not drawn.
pub(super) fn error(probe: &Probe) -> f64 {
    match (&probe.naive, &probe.truth) {
        (Naive::Matrix(splat), _) => matrix(splat, &probe.image) / probe.scale,
        (Naive::Covariance(splat), _) => covariance(splat, &probe.image) / probe.scale,
        (Naive::Moved(drawn), Truth::Exact(meant, _)) => moved(meant, drawn, &probe.image),
        (Naive::Known(error), _) => *error,
        (Naive::Nothing | Naive::Moved(_), _) => f64::NAN,
    }
}

/// Returns the weight error if the splat `drawn` is drawn exactly instead of the intended splat `meant`. It is the cost
/// of rounding the inputs.
fn moved(meant: &ViewSplat<f64>, drawn: &ViewSplat<f64>, image: &Image) -> f64 {
    let view = image.view();
    let (a, b) = (Exact::new(meant, &view.projection), Exact::new(drawn, &view.projection));
    let mut worst = 0.0f64;
    for pixel in pixels(image) {
        let weight = |e: &Exact| e.hit(pixel).map_or(0.0, |h| kernel::weight(h.rho_squared, image.settings.cutoff));
        worst = worst.max((weight(&a) - weight(&b)).abs());
    }
    worst
}

fn pixels(image: &Image) -> impl Iterator<Item = [u32; 2]> + use<> {
    let region = image.view().region;
    (0..region.width * region.height).map(move |i| [region.x + i % region.width, region.y + i / region.width])
}

/// Returns the largest weight error of G06 eq. 5–6 as printed: rows of adj[s t p]/det, with constant terms at pixel (0,
/// 0).
fn matrix(splat: &ViewSplat<f64>, image: &Image) -> f64 {
    let projection = image.view().projection;
    let exact = Exact::new(splat, &projection);
    let (p, s, t) = (single(splat.p), single(splat.s), single(splat.t));
    let [fx, fy] = projection.focal_px.map(|v| v as f32);
    let [cx, cy] = projection.principal_px.map(|v| v as f32);
    let rows = [cross(t, p), cross(p, s), cross(s, t)];
    let det = rows[2].x * p.x + rows[2].y * p.y + rows[2].z * p.z;
    let forms = rows.map(|r| {
        let (x, y) = (r.x / det / fx, r.y / det / fy);
        [x, y, r.z / det - x * cx - y * cy]
    });
    let cutoff = image.settings.cutoff as f32;
    let mut worst = f64::NAN;
    for pixel in pixels(image) {
        let at = |f: [f32; 3]| f[0] * (pixel[0] as f32 + 0.5) + f[1] * (pixel[1] as f32 + 0.5) + f[2];
        let [u, v, w] = forms.map(at);
        let rho_squared = (u * u + v * v) / (w * w);
        let got = if w > 0.0 && rho_squared <= 1.0 { (-cutoff * rho_squared).exp() } else { 0.0 };
        let want = exact.hit(pixel).map_or(0.0, |h| kernel::weight(h.rho_squared, f64::from(cutoff)));
        // A GPU draws nothing for NaN, so the pixel is lost.
        let got = if got.is_nan() { 0.0 } else { got };
        // If only one of the two hits the pixel, an error up to half of the step at the rim isn't due to the
        // arithmetic.
        if (got > 0.0 && want > 0.0) || (want - f64::from(got)).abs() > 0.5 {
            worst = (f64::from(got) - want).abs().max(worst);
        }
    }
    worst
}

/// Returns the largest weight error of Z01 eq. 6–9 as printed: V = JJᵀ/(2c) + σ²·I as a matrix, inverted by its
/// determinant, around the projected centre in absolute pixels. The truth is Surfel's formula for the same filter in
/// f64. G06 and B05 print no formula for a splat's decreasing weight.
fn covariance(splat: &ViewSplat<f64>, image: &Image) -> f64 {
    let (projection, settings) = (image.view().projection, &image.settings);
    let projected = Projected::new(splat, &projection);
    let wanted = filter::ewa(&projected, settings.prefilter_radius_px);
    let center = V2::new(
        projection.focal_px[0] * splat.p.x / splat.p.z + projection.principal_px[0],
        projection.focal_px[1] * splat.p.y / splat.p.z + projection.principal_px[1],
    );
    let (p, s, t) = (single(splat.p), single(splat.s), single(splat.t));
    let [fx, fy] = projection.focal_px.map(|v| v as f32);
    let [cx, cy] = projection.principal_px.map(|v| v as f32);
    let at = V2::new(fx * p.x / p.z + cx, fy * p.y / p.z + cy);
    let column =
        |a: V3<f32>| V2::new(fx * (a.x / p.z - p.x * a.z / (p.z * p.z)), fy * (a.y / p.z - p.y * a.z / (p.z * p.z)));
    let (s, t) = (column(s), column(t));
    let cutoff = settings.cutoff as f32;
    let variance = (settings.prefilter_radius_px as f32).powi(2) / (2.0 * cutoff);
    let [xx, xy, yy] =
        [s.x * s.x + t.x * t.x, s.x * s.y + t.x * t.y, s.y * s.y + t.y * t.y].map(|term| term / (2.0 * cutoff));
    let (a, b, c) = (xx + variance, xy, yy + variance);
    let determinant = a * c - b * b;
    let scale = ((xx * yy - xy * xy) / determinant).sqrt();
    let mut worst = f64::NAN;
    for pixel in pixels(image) {
        let d = V2::new(pixel[0] as f32 + 0.5 - at.x, pixel[1] as f32 + 0.5 - at.y);
        let beta = 0.5 * (c * d.x * d.x - 2.0 * b * d.x * d.y + a * d.y * d.y) / determinant;
        let got = scale * (-beta).exp();
        // A GPU draws nothing for NaN.
        let got = if beta < cutoff && got > 0.0 { f64::from(got) } else { 0.0 };
        let d = V2::new(f64::from(pixel[0]) + 0.5 - center.x, f64::from(pixel[1]) + 0.5 - center.y);
        let (u, v, _) = wanted.footprint.at(d);
        let rho_squared = u * u + v * v;
        let is_hit = rho_squared < 1.0;
        let want = if is_hit { wanted.weight_scale * kernel::weight(rho_squared, settings.cutoff) } else { 0.0 };
        // As above, the step at the rim isn't an error of the arithmetic.
        if (got > 0.0 && want > 0.0) || (got - want).abs() > 0.5 * wanted.weight_scale {
            worst = (got - want).abs().max(worst);
        }
    }
    worst
}

/// Returns the relative error of a depth that is stored in a 24-bit depth buffer, at most 1. The far plane is ten times
/// as far as the depth.
pub(super) fn depth_buffer(near: f64, z: f64) -> f64 {
    let far = 10.0 * z;
    let stored = far / (far - near) * (1.0 - near / z);
    let steps = f64::from(1 << 24);
    let stored = (stored * steps).round() / steps;
    let back = near * far / (far - stored * (far - near));
    ((back - z) / z).abs().min(1.0)
}

/// Returns the relative error of summing `count` equal weights in half precision.
pub(super) fn half_sum(count: u32, weight: f64) -> f64 {
    let half = |value: f64| {
        // Half precision has 11 significant bits and a minimum normal exponent of −14.
        let unit = value.abs().log2().floor().max(-14.0) - 10.0;
        let unit = unit.exp2();
        if value == 0.0 { 0.0 } else { (value / unit).round_ties_even() * unit }
    };
    let weight_in_half = half(weight);
    let mut sum = 0.0;
    for _ in 0..count {
        let next = half(sum + weight_in_half);
        if next == sum {
            break;
        }
        sum = next;
    }
    (sum / (f64::from(count) * weight) - 1.0).abs()
}

/// True if the clip leaves a point of the disk visible, by C12 eq. 7 as printed, evaluated in f32.
pub(super) fn clip_keeps(curve: &Curve, point: V2<f64>) -> bool {
    let narrow = |v: V2<f64>| V2::new(v.x as f32, v.y as f32);
    let (p1, p2, p3, q) = (narrow(curve.p1), narrow(curve.p2), narrow(curve.p3), narrow(point));
    let w = curve.w as f32;
    let left = |a: V2<f32>, b: V2<f32>| (b.x - a.x) * (q.y - a.y) - (b.y - a.y) * (q.x - a.x);
    let turn = (p2.x - p1.x) * (p3.y - p1.y) - (p2.y - p1.y) * (p3.x - p1.x);
    let sign = if turn < 0.0 { -1.0 } else { 1.0 };
    let (a1, a2, a3) = (left(p2, p3) * sign, left(p3, p1) * sign, left(p1, p2) * sign);
    let left_of_chord = left(p1, p3) >= 0.0;
    if a1 < 0.0 || a2 < 0.0 || a3 < 0.0 {
        return left_of_chord;
    }
    // The line from q to the chord's middle meets the curve where b(1−t)² + 2e·t(1−t) + f·t² = 0; e includes the weight
    // w.
    let d = V2::new(0.5 * (p1.x + p3.x) - q.x, 0.5 * (p1.y + p3.y) - q.y);
    let side = |p: V2<f32>| d.y * (p.x - q.x) - d.x * (p.y - q.y);
    let (b, e, f) = (side(p1), w * side(p2), side(p3));
    // Solved as t = (a ± √(a² − b·c))/c.
    let (a, c) = (b - e, b - 2.0 * e + f);
    let root = (a * a - b * c).max(0.0).sqrt();
    let t = [(a + root) / c, (a - root) / c].into_iter().find(|t| (0.0..=1.0).contains(t));
    let Some(t) = t else { return left_of_chord };
    let (k1, k2, k3) = ((1.0 - t) * (1.0 - t), 2.0 * t * (1.0 - t) * w, t * t);
    let sum = k1 + k2 + k3;
    let x = V2::new((k1 * p1.x + k2 * p2.x + k3 * p3.x) / sum, (k1 * p1.y + k2 * p2.y + k3 * p3.y) / sum);
    // The point is outside of the curve if the curve's point is between q and the middle.
    let outside = (x.x - q.x) * d.x + (x.y - q.y) * d.y > 0.0;
    if sign > 0.0 { !outside } else { outside }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_sums_stagnate_where_the_sum_is_2048_times_the_term() {
        assert!(half_sum(64, 1.0) == 0.0 && half_sum(2048, 1.0) == 0.0);
        assert!((half_sum(1 << 20, 1.0) - (1.0 - 2048.0 / f64::from(1 << 20))).abs() < 1e-12);
    }

    #[test]
    fn paper_clip_agrees_with_ours_where_nothing_is_extreme() {
        let curve = Curve::from_angles(0.3, 2.4, V2::new(0.1, 1.1), 1.0);
        let ours = surfel_math::clip::Clip::nothing().with_curve(&curve);
        let mut random = crate::random::Random::new(3);
        let wrong = (0..4000).filter(|_| {
            let q = V2::new(random.range(-0.7, 0.7), random.range(-0.7, 0.7));
            ours.curve_keeps(q) != clip_keeps(&curve, q)
        });
        // A few points are so close to the curve that rounding to f32 changes the result.
        assert!(wrong.count() < 4);
    }
}
