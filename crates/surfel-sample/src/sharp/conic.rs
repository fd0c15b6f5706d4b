//! Rational quadratic Bézier curves in space, and their fit to a piece of a ridge (C12 §4).

use glam::{DVec3, DVec4};

/// Number of points at which the distance between a curve and a ridge is measured (C12 eq. 12).
const SAMPLES: usize = 24;
/// Number of intervals in the table that converts a curve's parameters to arc length.
const TABLE: usize = 48;
/// Smallest and largest weight of a fitted curve's middle control point.
const WEIGHT: (f64, f64) = (0.05, 20.0);
/// Number of steps of the minimisation in [`fit`]. It has four variables, for which fewer steps suffice.
const STEPS: usize = 160;

/// Rational quadratic Bézier curve (C12 eq. 3): its ends `p1` and `p3`, which have weight 1, and its middle control
/// point `p2` with weight `w`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Conic {
    pub p1: DVec3,
    pub p2: DVec3,
    pub p3: DVec3,
    pub w: f64,
}

impl Conic {
    /// Returns the straight segment between two points, as a curve.
    pub(crate) fn straight(a: DVec3, b: DVec3) -> Self {
        Self { p1: a, p2: 0.5 * (a + b), p3: b, w: 1.0 }
    }

    fn weights(&self, t: f64) -> [f64; 3] {
        [(1.0 - t) * (1.0 - t), 2.0 * t * (1.0 - t) * self.w, t * t]
    }

    /// Returns the point of the curve at parameter `t`. Outside [0, 1] it is a point of the same conic, as long as it
    /// is finite.
    pub(crate) fn at(&self, t: f64) -> DVec3 {
        let [a, b, c] = self.weights(t);
        // Relative to P1, so that nothing is lost far from the origin.
        self.p1 + ((self.p2 - self.p1) * b + (self.p3 - self.p1) * c) / (a + b + c)
    }

    /// Returns the same curve in the opposite direction.
    pub(crate) fn reversed(&self) -> Self {
        Self { p1: self.p3, p3: self.p1, ..*self }
    }

    /// Applies an affine map to the control points, and thus to the curve.
    pub(crate) fn map(&self, f: impl Fn(DVec3) -> DVec3) -> Self {
        Self { p1: f(self.p1), p2: f(self.p2), p3: f(self.p3), w: self.w }
    }

    /// Returns the part of the same conic between parameters `t0` and `t1`, which may be outside [0, 1]. `None` if the
    /// part isn't a Bézier curve with positive weights.
    pub(crate) fn part(&self, t0: f64, t1: f64) -> Option<Self> {
        let homogeneous = |p: DVec3, w: f64| DVec4::from((p * w, w));
        let h = [homogeneous(self.p1, 1.0), homogeneous(self.p2, self.w), homogeneous(self.p3, 1.0)];
        // The blossom b of the homogeneous curve: b(t, t) is the curve's point at t, and b(t0, t1) the part's middle
        // control point.
        let blossom =
            |s: f64, t: f64| h[0] * ((1.0 - s) * (1.0 - t)) + h[1] * ((1.0 - s) * t + s * (1.0 - t)) + h[2] * (s * t);
        let [a, b, c] = [blossom(t0, t0), blossom(t0, t1), blossom(t1, t1)];
        let sound = a.w > 1e-9 && b.w > 1e-9 && c.w > 1e-9;
        let point = |p: DVec4| p.truncate() / p.w;
        sound.then(|| Self { p1: point(a), p2: point(b), p3: point(c), w: b.w / (a.w * c.w).sqrt() })
    }

    /// Returns `count` points evenly spaced in arc length, including both ends.
    pub(crate) fn even_points(&self, count: usize) -> Vec<DVec3> {
        let line: Vec<DVec3> = (0..=TABLE).map(|i| self.at(i as f64 / TABLE as f64)).collect();
        even_points(&line, count)
    }

    /// Returns the error of C12 eq. 12: the mean distance between points evenly spaced on the curve and on the ridge.
    /// `targets` are the ridge's points.
    fn error(&self, targets: &[DVec3]) -> f64 {
        let own = self.even_points(targets.len());
        own.iter().zip(targets).map(|(a, b)| a.distance(*b)).sum::<f64>() / targets.len() as f64
    }

    /// Returns the largest distance of the curve from its chord (the sagitta), sampled at seven points; 0 if both ends
    /// coincide.
    pub(crate) fn sagitta(&self) -> f64 {
        let chord = (self.p3 - self.p1).normalize_or_zero();
        let off = |p: DVec3| (p - self.p1).reject_from_normalized(chord).length();
        if chord == DVec3::ZERO { 0.0 } else { (1..8).map(|i| off(self.at(f64::from(i) / 8.0))).fold(0.0, f64::max) }
    }
}

/// Returns `count` (at least 2) points evenly spaced in arc length on a polyline, including both ends.
pub(crate) fn even_points(line: &[DVec3], count: usize) -> Vec<DVec3> {
    let total: f64 = line.windows(2).map(|w| w[0].distance(w[1])).sum();
    let (mut at, mut before) = (0, 0.0);
    let point = |i: usize| {
        let target = total * i as f64 / (count - 1) as f64;
        while at + 2 < line.len() {
            let length = line[at].distance(line[at + 1]);
            if before + length >= target {
                break;
            }
            before += length;
            at += 1;
        }
        let (a, b) = (line[at], line[(at + 1).min(line.len() - 1)]);
        let length = a.distance(b);
        if length > 0.0 { a.lerp(b, ((target - before) / length).clamp(0.0, 1.0)) } else { a }
    };
    (0..count).map(point).collect()
}

/// Returns the largest distance between a polyline and the parabola between its ends that fits best by least squares.
/// It is a quick estimate of the error of a fitted curve ([`fit`]); 0 for fewer than three points.
pub(crate) fn parabola_error(line: &[DVec3]) -> f64 {
    let (Some(&a), Some(&b)) = (line.first(), line.last()) else { return 0.0 };
    if line.len() < 3 {
        return 0.0;
    }
    let points = even_points(line, 9);
    let t = |i: usize| i as f64 / 8.0;
    let (mut sum, mut squares) = (DVec3::ZERO, 0.0);
    for (i, p) in points.iter().enumerate() {
        let beta = 2.0 * t(i) * (1.0 - t(i));
        sum += beta * ((*p - a) - (b - a) * t(i).powi(2));
        squares += beta * beta;
    }
    let conic = Conic { p1: a, p2: a + sum / squares, p3: b, w: 1.0 };
    points.iter().enumerate().map(|(i, p)| conic.at(t(i)).distance(*p)).fold(0.0, f64::max)
}

/// Curve fitted to a polyline, and its errors.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Fit {
    pub conic: Conic,
    /// Errors, as defined in C12 eq. 12, of the curve from which the fit starts and of the fitted curve, which is never
    /// worse.
    pub errors: [f64; 2],
}

/// Fits a curve through the ends of a polyline (C12 §4). The fit starts with a parabola (w = 1) through the point I at
/// which the polyline meets the plane that bisects its chord. The parabola's middle control point is P2 = 2I − M, where
/// M is the middle of the chord (the paper's eq. 10 prints 2I + M). The fit then minimises the error of eq. 12 over P2
/// and ln w. P2 moves by at most the chord's length along each axis, and w stays in the range [`WEIGHT`]. A polyline of
/// two points, a straight one, and one whose ends coincide get their chord.
///
/// The fit is deterministic and bounded. The result is the best curve found, so it is never worse than the start.
pub(crate) fn fit(line: &[DVec3]) -> Fit {
    let (a, b) = (line[0], line[line.len() - 1]);
    let chord = b - a;
    let start = Conic { p1: a, p2: 2.0 * bisector_point(line) - 0.5 * (a + b), p3: b, w: 1.0 };
    let targets = even_points(line, SAMPLES);
    let first = start.error(&targets);
    if line.len() < 3 || chord.length_squared() == 0.0 || first <= 1e-12 * chord.length() {
        return Fit { conic: Conic::straight(a, b), errors: [first; 2] };
    }
    let size = chord.length();
    let curve = |x: &[f64; 4]| Conic {
        p2: start.p2 + size * DVec3::new(x[0], x[1], x[2]).clamp(DVec3::splat(-1.0), DVec3::ONE),
        w: x[3].exp().clamp(WEIGHT.0, WEIGHT.1),
        ..start
    };
    let best = downhill([0.05, 0.05, 0.05, 0.3], |x| curve(x).error(&targets));
    let conic = curve(&best);
    let last = conic.error(&targets);
    if last < first { Fit { conic, errors: [first, last] } } else { Fit { conic: start, errors: [first; 2] } }
}

/// Returns the intersection of the polyline with the plane that bisects the line between its ends. Of several
/// intersections, the one nearest to the middle of the polyline is returned; without any, the middle itself.
fn bisector_point(line: &[DVec3]) -> DVec3 {
    let (a, b) = (line[0], line[line.len() - 1]);
    let (middle, normal) = (0.5 * (a + b), b - a);
    let half = even_points(line, 3)[1];
    let crossings = line.windows(2).filter_map(|w| {
        let [from, to] = [w[0], w[1]].map(|p| (p - middle).dot(normal));
        (from <= 0.0 && to > 0.0 || from >= 0.0 && to < 0.0).then(|| w[0].lerp(w[1], from / (from - to)))
    });
    crossings.min_by(|p, q| p.distance_squared(half).total_cmp(&q.distance_squared(half))).unwrap_or(half)
}

/// Minimises `cost` by the method of Nelder and Mead 1965, starting at zero. `step` has the length of the first step
/// along each variable. Returns the best point found.
fn downhill(step: [f64; 4], cost: impl Fn(&[f64; 4]) -> f64) -> [f64; 4] {
    let mut simplex: Vec<([f64; 4], f64)> = (0..5)
        .map(|i| {
            let x = std::array::from_fn(|k| if i == k + 1 { step[k] } else { 0.0 });
            (x, cost(&x))
        })
        .collect();
    for _ in 0..STEPS {
        simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
        let worst = simplex[4];
        let center: [f64; 4] = std::array::from_fn(|k| simplex[..4].iter().map(|s| s.0[k]).sum::<f64>() / 4.0);
        let toward = |factor: f64| {
            let x = std::array::from_fn(|k| center[k] + factor * (worst.0[k] - center[k]));
            (x, cost(&x))
        };
        let reflected = toward(-1.0);
        let better = if reflected.1 < simplex[0].1 {
            let expanded = toward(-2.0);
            Some(if expanded.1 < reflected.1 { expanded } else { reflected })
        } else if reflected.1 < simplex[3].1 {
            Some(reflected)
        } else {
            let contracted = toward(if reflected.1 < worst.1 { -0.5 } else { 0.5 });
            (contracted.1 < worst.1.min(reflected.1)).then_some(contracted)
        };
        match better {
            Some(vertex) => simplex[4] = vertex,
            None => {
                let best = simplex[0].0;
                for s in &mut simplex[1..] {
                    let x = std::array::from_fn(|k| 0.5 * (best[k] + s.0[k]));
                    *s = (x, cost(&x));
                }
            }
        }
    }
    simplex.iter().min_by(|a, b| a.1.total_cmp(&b.1)).map_or([0.0; 4], |s| s.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arc(radius: f64, angle: f64, count: usize) -> Vec<DVec3> {
        let at = |i: usize| angle * i as f64 / (count - 1) as f64;
        (0..count).map(|i| DVec3::new(radius * at(i).cos(), radius * at(i).sin(), 0.3)).collect()
    }

    #[test]
    fn fit_of_a_circular_arc_is_the_arc() {
        // A conic represents it exactly: w is the cosine of half the angle, and P2 the intersection of the tangents.
        let line = arc(2.0, 1.2, 400);
        let fit = fit(&line);
        let p2 = DVec3::new(2.0, 2.0 * 0.6f64.tan(), 0.3);
        assert!(fit.errors[1] < 0.05 * fit.errors[0] && fit.errors[1] < 1e-4, "{:?}", fit.errors);
        assert!((fit.conic.w - 0.6f64.cos()).abs() < 0.02 && fit.conic.p2.distance(p2) < 0.02, "{fit:?} {p2}");
    }

    #[test]
    fn fit_is_never_worse_than_its_start_and_bounded() {
        let mut random = crate::mesh::random::Random::new(9);
        for count in [2, 3, 5, 20] {
            for _ in 0..50 {
                let mut p = DVec3::ZERO;
                let line: Vec<DVec3> = (0..count)
                    .map(|_| {
                        p += DVec3::new(random.unit(), random.unit() - 0.5, random.unit() - 0.5);
                        p
                    })
                    .collect();
                let fit = fit(&line);
                assert!(fit.errors[1] <= fit.errors[0], "{fit:?}");
                assert!(fit.conic.w >= WEIGHT.0 && fit.conic.w <= WEIGHT.1 && fit.conic.p2.is_finite());
                assert_eq!(fit.conic.p1, line[0]);
            }
        }
        // All points in one place, and a closed line.
        for line in [vec![DVec3::ONE; 4], vec![DVec3::ZERO, DVec3::X, DVec3::ZERO]] {
            assert!(fit(&line).conic.p2.is_finite());
        }
    }

    #[test]
    fn part_of_a_conic_is_the_same_curve() {
        let conic = Conic { p1: DVec3::ZERO, p2: DVec3::new(1.0, 2.0, 0.5), p3: DVec3::X * 3.0, w: 0.7 };
        for (t0, t1) in [(0.2, 0.9), (-0.15, 1.1)] {
            let part = conic.part(t0, t1).unwrap();
            assert!(part.p1.distance(conic.at(t0)) < 1e-14 && part.p3.distance(conic.at(t1)) < 1e-13);
            // Each point is on the whole curve: the distance is measured to a fine sampling of it.
            let fine: Vec<DVec3> = (0..=20_000).map(|i| conic.at(t0 + (t1 - t0) * f64::from(i) / 2e4)).collect();
            for i in 0..20 {
                let p = part.at(f64::from(i) / 20.0);
                assert!(fine.iter().map(|q| q.distance(p)).fold(1.0, f64::min) < 3e-4);
            }
        }
        assert!(conic.part(-50.0, 1.0).is_none_or(|p| p.w > 0.0));
    }

    #[test]
    fn even_points_keep_ends_and_spacing() {
        let line = [DVec3::ZERO, DVec3::X * 0.1, DVec3::X * 4.0];
        let points = even_points(&line, 5);
        for (i, p) in points.iter().enumerate() {
            assert!((p.x - i as f64).abs() < 1e-14, "{points:?}");
        }
        assert!(parabola_error(&arc(1.0, 0.3, 30)) < 1e-3 && parabola_error(&line) < 1e-12);
    }
}
