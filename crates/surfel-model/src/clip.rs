//! Clip curves and lines (rendering model §7).

use crate::ClipPolicy;
use surfel_math::V2;
use surfel_math::clip::{Clip, Curve};

/// Rational quadratic Bézier curve that clips a splat (rendering model §7), in the splat's own coordinates (u, v). Its
/// control points are P1, P2 and P3; P1 and P3 are on the unit circle, which is the splat's rim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipCurve {
    /// Angle of the control point P1 on the unit circle, in radians.
    pub theta1: f32,
    /// Angle of the control point P3 on the unit circle, in radians.
    pub theta3: f32,
    /// Coordinate u of the middle control point P2.
    pub u: f32,
    /// Coordinate v of the middle control point P2.
    pub v: f32,
    /// Weight of the middle control point P2, at least 0; NaN means that there is no curve.
    pub w: f32,
}

/// Line a·u + b·v + c = 0 that clips a splat (rendering model §7), in the splat's own coordinates (u, v). The side with
/// a·u + b·v + c ≥ 0 is visible. A NaN coefficient means that there is no line.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(missing_docs, reason = "the coefficients of the type's own formula")]
pub struct ClipLine {
    pub a: f32,
    pub b: f32,
    pub c: f32,
}

/// Value of an absent clip line: all coefficients are NaN.
pub const NO_LINE: ClipLine = ClipLine { a: f32::NAN, b: f32::NAN, c: f32::NAN };

/// Rule by which several clip lines of one splat are combined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClipMode {
    /// A point of the splat is visible if it is on the visible side of every line (convex).
    And,
    /// A point of the splat is visible if it is on the visible side of any line (concave).
    Or,
}

/// Columns of a cloud with the splats' clips; `None` for columns that the file doesn't have.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClipColumns {
    /// Clip curve of each splat.
    pub curves: Option<Vec<ClipCurve>>,
    /// Clip lines of each splat: up to four, the others are [`NO_LINE`].
    pub lines: Option<Vec<[ClipLine; 4]>>,
    /// Rule by which the clip lines of each splat are combined; `None` means [`ClipMode::And`] for all.
    pub modes: Option<Vec<ClipMode>>,
}

impl ClipColumns {
    /// Returns the clip columns of some splats, in the order of `indices`.
    pub(crate) fn select(&self, indices: &[u32]) -> Self {
        fn pick<T: Copy>(column: Option<&Vec<T>>, indices: &[u32]) -> Option<Vec<T>> {
            column.map(|column| indices.iter().map(|&i| column[i as usize]).collect())
        }
        Self {
            curves: pick(self.curves.as_ref(), indices),
            lines: pick(self.lines.as_ref(), indices),
            modes: pick(self.modes.as_ref(), indices),
        }
    }

    /// Returns the clip curve of splat `i`, if it has one.
    pub fn curve(&self, i: usize) -> Option<Curve> {
        let c = self.curves.as_ref().map(|c| c[i]).filter(|c| !c.w.is_nan())?;
        let [theta1, theta3, u, v, w] = [c.theta1, c.theta3, c.u, c.v, c.w].map(f64::from);
        Some(Curve::from_angles(theta1, theta3, V2::new(u, v), w))
    }

    /// True if splat `i` has a clip curve or line.
    pub fn is_clipped(&self, i: usize) -> bool {
        let is_there = |l: &ClipLine| !(l.a.is_nan() || l.b.is_nan() || l.c.is_nan());
        self.lines.as_ref().is_some_and(|lines| lines[i].iter().any(is_there))
            || self.curves.as_ref().is_some_and(|curves| !curves[i].w.is_nan())
    }

    /// Returns the clip of splat `i` under a policy; `None` if nothing clips the splat. [`ClipPolicy::Paper`] and
    /// [`ClipPolicy::Exact`] give the same clip.
    pub fn clip(&self, i: usize, policy: ClipPolicy) -> Option<Clip<f64>> {
        if policy == ClipPolicy::Off || !self.is_clipped(i) {
            return None;
        }
        let lines: Vec<[f64; 3]> = self
            .lines
            .iter()
            .flat_map(|lines| lines[i])
            .map(|l| [l.a, l.b, l.c].map(f64::from))
            .filter(|l| l.iter().all(|x| !x.is_nan()))
            .collect();
        let curve = self.curve(i);
        let any = self.modes.as_ref().is_some_and(|modes| modes[i] == ClipMode::Or);
        let clip = Clip::nothing().with_lines(&lines, any);
        Some(match (curve, policy) {
            (None, _) => clip,
            (Some(curve), ClipPolicy::Line) => clip.with_chord(&curve),
            (Some(curve), _) => clip.with_curve(&curve),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CloudData, Column3, OnInvalid, Shape, SplatCloud};
    use glam::{DVec3, Vec3};

    fn is_accepted(clips: ClipColumns) -> bool {
        let column = |v: Vec3| Column3::from_f32(vec![v]);
        let shape = Shape::Ellipses { s: column(Vec3::X), t: column(Vec3::Y) };
        let data = CloudData { clips: Some(clips), ..CloudData::new(DVec3::ZERO, column(Vec3::ZERO), shape) };
        SplatCloud::new(data, OnInvalid::Refuse).is_ok()
    }

    #[test]
    fn clips_of_some_splats_are_theirs_in_every_column() {
        let curve = |w: f32| ClipCurve { theta1: 0.0, theta3: 1.5, u: 0.4, v: 0.4, w };
        let line = |c: f32| [ClipLine { a: 1.0, b: 0.0, c }; 4];
        let clips = ClipColumns {
            curves: Some([1.0, 2.0, 3.0].map(curve).to_vec()),
            lines: Some([0.1, 0.2, 0.3].map(line).to_vec()),
            modes: Some(vec![ClipMode::And, ClipMode::Or, ClipMode::And]),
        };
        let some = clips.select(&[2, 1]);
        assert_eq!(some.curves, Some(vec![curve(3.0), curve(2.0)]));
        assert_eq!(some.lines, Some(vec![line(0.3), line(0.2)]));
        assert_eq!(some.modes, Some(vec![ClipMode::And, ClipMode::Or]));
        assert_eq!(ClipColumns::default().select(&[5]), ClipColumns::default());
    }

    #[test]
    fn clip_weight_is_at_least_zero_or_nan_for_none() {
        let curve = |w: f32, u: f32| {
            let curves = Some(vec![ClipCurve { theta1: 0.0, theta3: 1.0, u, v: 0.0, w }]);
            is_accepted(ClipColumns { curves, ..ClipColumns::default() })
        };
        assert!(curve(0.0, 0.5) && curve(1e9, 0.5) && curve(f32::NAN, f32::NAN));
        assert!(!curve(-1e-6, 0.5) && !curve(f32::INFINITY, 0.5) && !curve(1.0, f32::NAN));
    }

    #[test]
    fn clip_is_absent_where_a_splat_has_none_or_the_policy_is_off() {
        let curve = |w: f32| ClipCurve { theta1: 0.0, theta3: 1.5, u: 0.4, v: 0.4, w };
        let (none, half) = ([NO_LINE; 4], ClipLine { a: 1.0, b: 0.0, c: 0.0 });
        let clips = ClipColumns {
            curves: Some(vec![curve(1.0), curve(f32::NAN), curve(f32::NAN)]),
            lines: Some(vec![none, none, [half, NO_LINE, ClipLine { b: f32::NAN, ..half }, NO_LINE]]),
            modes: Some(vec![ClipMode::Or; 3]),
        };
        assert!(clips.clip(0, ClipPolicy::Off).is_none() && clips.clip(1, ClipPolicy::Exact).is_none());
        let at = |i, policy, u, v| clips.clip(i, policy).is_some_and(|c| c.keeps(V2::new(u, v)));
        assert!(at(2, ClipPolicy::Exact, 0.1, 0.0) && !at(2, ClipPolicy::Line, -0.1, 0.0));
        // Between curve and chord: P2 is left of the chord, and the curve removes more than its chord.
        assert!(!at(0, ClipPolicy::Exact, 0.55, 0.45) && at(0, ClipPolicy::Line, 0.55, 0.45));
        assert!(!at(0, ClipPolicy::Paper, 0.55, 0.45));
    }

    #[test]
    fn clip_lines_are_finite_or_nan_for_none() {
        let line = |c: f32| {
            let lines = Some(vec![[ClipLine { a: 1.0, b: 0.0, c }; 4]]);
            is_accepted(ClipColumns { lines, ..ClipColumns::default() })
        };
        assert!(line(0.25) && line(f32::NAN) && !line(f32::NEG_INFINITY));
    }
}
