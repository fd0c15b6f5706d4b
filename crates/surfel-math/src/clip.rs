//! Clip curves and lines (rendering model §7), which remove a part of a splat's disk. The test needs no root and no
//! division.
//!
//! A clip is a few linear forms over the disk's (u, v). Composed with a [`Footprint`], they are forms over pixels of
//! the homogeneous (U, V, W), with the same signs as over (u, v) wherever W > 0. A pixel costs at most seven forms, one
//! product and one square.
//!
//! 1. [`Curve`], lines → [`Clip`] over (u, v): once per splat, independent of the view;
//! 2. [`Clip::through`] a footprint and the [`Turn`] of its filter: once per splat and frame;
//! 3. [`Clip::keeps`]: once per fragment.
//!
//! Sources: C12 §3 (curves), Z04 (lines).

use crate::mapping::{Footprint, Linear};
use crate::{Real, V2};

/// Smallest absolute [`Curve::turn`] (twice the area of the control polygon) of a curve. A straighter curve is replaced
/// by its chord (rendering model §7).
const STRAIGHT: f64 = 1e-9;
/// Largest weight of a curve's middle control point that is used; larger weights are limited to it. The curve then
/// equals its control polygon within far less than f32's precision.
const MAX_WEIGHT: f64 = 1e12;
/// Smallest scale of a clip's chord form, where the other forms have scale 1. The form's square thereby stays a normal
/// f32.
const MIN_SCALE: f64 = 1e-18;

/// A rational quadratic Bézier curve over the unit disk (C12 eq. 3), with end weights 1.
///
/// The curve removes the part of the disk between the arc from `p1` counter-clockwise to `p3` and the curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curve {
    /// Start of the curve, in (u, v) on the unit circle.
    pub p1: V2<f64>,
    /// Middle control point of the curve, anywhere in (u, v).
    pub p2: V2<f64>,
    /// End of the curve, in (u, v) on the unit circle.
    pub p3: V2<f64>,
    /// Weight of the control point `p2`, at least 0. A larger weight pulls the curve closer to `p2`; 0 makes it the
    /// chord.
    pub w: f64,
}

impl Curve {
    /// Creates a curve between the angles `theta1` and `theta3` of the unit circle, in radians.
    pub fn from_angles(theta1: f64, theta3: f64, p2: V2<f64>, w: f64) -> Self {
        let at = |theta: f64| V2::new(theta.cos(), theta.sin());
        Self { p1: at(theta1), p2, p3: at(theta3), w }
    }

    /// Returns twice the signed area of the control polygon: positive if it turns left at `p2`.
    pub fn turn(&self) -> f64 {
        // Relative to the chord, not to P3 − P2, which for a far P2 is the opposite of P2 − P1 up to rounding.
        (self.p2 - self.p1).cross(self.p3 - self.p1)
    }

    /// True if the curve is replaced by its chord, because w = 0 or the control points are nearly in a line.
    pub fn is_chord(&self) -> bool {
        self.w <= 0.0 || self.turn().abs() < STRAIGHT
    }

    /// Returns the curve's point at parameter `t` in [0, 1] (C12 eq. 3).
    pub fn at(&self, t: f64) -> V2<f64> {
        let (a, b, c) = ((1.0 - t) * (1.0 - t), 2.0 * t * (1.0 - t) * self.w, t * t);
        (self.p1 * a + self.p2 * b + self.p3 * c) * (1.0 / (a + b + c))
    }
}

/// Returns twice the signed area of the triangle (a, b, x) as a linear form over x: positive left of the line a→b.
fn left_of(a: V2<f64>, b: V2<f64>) -> Linear<f64> {
    Linear::new(a.cross(b), V2::new(a.y - b.y, b.x - a.x))
}

/// The orthogonal map from the (u', v') of a filtered footprint, whose half-axes a filter has turned, to the splat's
/// own (u, v). Clips are stated in the latter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn<R> {
    /// The splat's (u, v) at (u', v') = (1, 0) of the filtered footprint.
    pub first: V2<R>,
    /// The splat's (u, v) at (u', v') = (0, 1) of the filtered footprint.
    pub second: V2<R>,
}

impl<R: Real> Turn<R> {
    /// Returns the identity map, with as many SIMD lanes as `like`.
    #[inline(always)]
    pub fn none(like: R) -> Self {
        let (zero, one) = (like.zero(), like.one());
        Self { first: V2::new(one, zero), second: V2::new(zero, one) }
    }

    /// Returns the splat's (u, v) of a point (u', v') of the filtered footprint.
    #[inline(always)]
    pub fn apply(&self, p: V2<R>) -> V2<R> {
        self.first * p.x + self.second * p.y
    }

    /// Returns the composition of two maps: first `inner`, then this one.
    #[inline(always)]
    pub fn after(&self, inner: &Self) -> Self {
        Self { first: self.apply(inner.first), second: self.apply(inner.second) }
    }
}

/// A clip: the part of its disk that a splat retains, as linear forms over (u, v), or over pixels once composed.
///
/// The curve's forms are scaled so that its conic is chord² = side1·side3 (τ2² = 4w²·τ1·τ3 in barycentrics of its
/// control triangle). The inside of the curve is chord ≤ 0 or (side1 ≥ 0 and chord² ≤ side1·side3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clip<R> {
    /// Form proportional to τ2, the barycentric coordinate of the curve's middle control point `p2`: positive on that
    /// point's side of the chord. If only the chord clips, the form is positive on the removed side; without a curve,
    /// it is −1 over (u, v).
    pub chord: Linear<R>,
    /// Form proportional to τ1, the barycentric coordinate of the curve's start `p1`; 0 everywhere if only the chord
    /// clips, and without a curve.
    pub side1: Linear<R>,
    /// Form proportional to τ3, the barycentric coordinate of the curve's end `p3`; 0 everywhere if only the chord
    /// clips, and without a curve.
    pub side3: Linear<R>,
    /// 1 if the splat retains the inside of the curve, −1 if it retains the outside.
    pub curve_sign: R,
    /// Forms of the clip lines, multiplied by `line_sign`; unused forms are positive everywhere.
    pub lines: [Linear<R>; 4],
    /// 1 if the splat retains points inside every line, −1 if it retains points inside at least one line.
    pub line_sign: R,
}

impl Clip<f64> {
    /// Returns a clip that removes nothing.
    pub fn nothing() -> Self {
        let constant = |c| Linear::new(c, V2::new(0.0, 0.0));
        Self {
            chord: constant(-1.0),
            side1: constant(0.0),
            side3: constant(0.0),
            curve_sign: 1.0,
            lines: [constant(1.0); 4],
            line_sign: 1.0,
        }
    }

    /// Returns the clip with a curve in its exact, implicit form. The chord replaces a curve for which
    /// [`Curve::is_chord`] is true. A curve with P1 = P3 removes nothing.
    #[must_use]
    pub fn with_curve(self, curve: &Curve) -> Self {
        if curve.p1 == curve.p3 || curve.is_chord() {
            return self.with_chord(curve);
        }
        let Curve { p1, p2, p3, .. } = *curve;
        // Areas replace barycentrics, with the sign of the whole triangle's area: no division.
        let sign = 1f64.copysign(curve.turn());
        let [a1, a2, a3] = [left_of(p2, p3), left_of(p3, p1), left_of(p1, p2)].map(|l| scaled(&l, sign));
        // 4w²·a1·a3 = a2² as side1·side3 = chord², with sides of scale 1 or less: products stay within f32's range.
        let sides = 1.0 / size(&a1).max(size(&a3));
        let chord = (sides / (2.0 * curve.w.min(MAX_WEIGHT))).max(MIN_SCALE);
        let shrink = 1.0 / (chord * size(&a2)).max(1.0);
        Self {
            chord: scaled(&a2, chord * shrink),
            side1: scaled(&a1, sides * shrink),
            side3: scaled(&a3, sides * shrink),
            curve_sign: sign,
            ..self
        }
    }

    /// Returns the clip with a curve's chord in place of the curve. A curve with P1 = P3 removes nothing.
    #[must_use]
    pub fn with_chord(self, curve: &Curve) -> Self {
        let nothing = Self::nothing();
        // The part right of P1→P3 is removed. The sides are zero, so that the chord form alone decides.
        let chord = if curve.p1 == curve.p3 { nothing.chord } else { left_of(curve.p3, curve.p1) };
        Self { chord, side1: nothing.side1, side3: nothing.side3, curve_sign: 1.0, ..self }
    }

    /// Returns the clip with up to four lines a·u + b·v + c ≥ 0 (coefficients a, b, c; further lines are ignored). With
    /// `any`, a point has to be inside only one of the lines. Without any line nothing is removed.
    #[must_use]
    pub fn with_lines(self, lines: &[[f64; 3]], any: bool) -> Self {
        let line_sign = if any && !lines.is_empty() { -1.0 } else { 1.0 };
        let mut forms = Self::nothing().lines;
        for (form, &[a, b, c]) in forms.iter_mut().zip(lines) {
            let line = Linear { c, x: a, y: b };
            // A positive factor preserves the sign. A form that is 0 everywhere removes nothing.
            *form = scaled(&line, line_sign / if size(&line) > 0.0 { size(&line) } else { 1.0 });
        }
        Self { lines: forms, line_sign, ..self }
    }

    /// Converts every number of the clip to another type: f32, or SIMD lanes.
    pub fn map<S: Real>(&self, f: impl Fn(f64) -> S) -> Clip<S> {
        let linear = |l: &Linear<f64>| Linear { c: f(l.c), x: f(l.x), y: f(l.y) };
        Clip {
            chord: linear(&self.chord),
            side1: linear(&self.side1),
            side3: linear(&self.side3),
            curve_sign: f(self.curve_sign),
            lines: self.lines.each_ref().map(linear),
            line_sign: f(self.line_sign),
        }
    }
}

fn size(l: &Linear<f64>) -> f64 {
    l.c.abs().max(l.x.abs()).max(l.y.abs())
}

fn scaled(l: &Linear<f64>, k: f64) -> Linear<f64> {
    Linear { c: l.c * k, x: l.x * k, y: l.y * k }
}

/// Composes a linear form over the splat's (u, v) with a footprint, and returns a form over pixels. [`Clip::through`]
/// does this with each of its forms.
// A function, since a closure isn't inlined into SIMD code.
#[inline(always)]
pub fn composed<R: Real>(l: &Linear<R>, footprint: &Footprint<R>, turn: &Turn<R>) -> Linear<R> {
    let gradient = V2::new(l.x, l.y);
    let (u, v) = (gradient.dot(turn.first), gradient.dot(turn.second));
    let Footprint { u: fu, v: fv, w: fw } = footprint;
    Linear {
        c: fu.c.mul_add(u, fv.c.mul_add(v, fw.c * l.c)),
        x: fu.x.mul_add(u, fv.x.mul_add(v, fw.x * l.c)),
        y: fu.y.mul_add(u, fv.y.mul_add(v, fw.y * l.c)),
    }
}

impl<R: Real> Clip<R> {
    /// Returns the clip as forms over pixels, by composing it with a footprint. `turn` maps the footprint's (u', v') to
    /// the splat's (u, v).
    ///
    /// The forms have the same signs as over (u, v) where the footprint's W > 0. The filter `clamp` also produces
    /// fragments where W ≤ 0. For them the clip is tested at the splat's projected centre, offset 0 (rendering model
    /// §7).
    #[inline(always)]
    pub fn through(&self, footprint: &Footprint<R>, turn: &Turn<R>) -> Self {
        let mut lines = self.lines;
        for line in &mut lines {
            *line = composed(line, footprint, turn);
        }
        Self {
            chord: composed(&self.chord, footprint, turn),
            side1: composed(&self.side1, footprint, turn),
            side3: composed(&self.side3, footprint, turn),
            curve_sign: self.curve_sign,
            lines,
            line_sign: self.line_sign,
        }
    }

    /// True where the curve retains the point `d`: (u, v), or a pixel offset if the clip is composed with a footprint.
    #[inline(always)]
    pub fn curve_keeps(&self, d: V2<R>) -> R::Mask {
        let (chord, side1, side3) = (self.chord.at(d), self.side1.at(d), self.side3.at(d));
        let zero = chord.zero();
        // If the square is at most their product, side3 has the sign of side1.
        let lens = zero.le(side1) & (chord * chord).le(side1 * side3);
        let inside = chord.le(zero) | lens;
        let outside = self.curve_sign.lt(zero);
        (inside & !outside) | (!inside & outside)
    }

    /// True where the lines retain the point `d`: (u, v), or a pixel offset if the clip is composed with a footprint.
    #[inline(always)]
    pub fn lines_keep(&self, d: V2<R>) -> R::Mask {
        let [a, b, c, e] = self.lines.each_ref().map(|l| l.at(d));
        // One of the lines is at least 0 ⇔ the minimum of their negatives is at most 0.
        let least = a.min(b).min(c.min(e));
        least.zero().le(least * self.line_sign)
    }

    /// True where both the curve and the lines of the clip retain the point `d`: (u, v), or a pixel offset if the clip
    /// is composed with a footprint.
    #[inline(always)]
    pub fn keeps(&self, d: V2<R>) -> R::Mask {
        self.curve_keeps(d) & self.lines_keep(d)
    }
}
