//! Clip curves and lines (rendering model §7).

/// One rational quadratic Bézier clip curve a splat (rendering model §7), in the splat's own (u, v).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipCurve {
    /// Angle of P1 on the unit circle, radians.
    pub theta1: f32,
    /// Angle of P3 on the unit circle, radians.
    pub theta3: f32,
    /// u of P2.
    pub u: f32,
    /// v of P2.
    pub v: f32,
    /// Weight of P2, at least 0; NaN: no curve.
    pub w: f32,
}

/// Keeps a·u + b·v + c ≥ 0; NaN: absent.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(missing_docs, reason = "the coefficients of the type's own formula")]
pub struct ClipLine {
    pub a: f32,
    pub b: f32,
    pub c: f32,
}

/// How a splat's clip lines combine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClipMode {
    /// Every line must keep (convex).
    And,
    /// One is enough (concave).
    Or,
}

/// Clip columns of a cloud; each is there only if the file had it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClipColumns {
    /// One curve a splat.
    pub curves: Option<Vec<ClipCurve>>,
    /// Up to four lines a splat.
    pub lines: Option<Vec<[ClipLine; 4]>>,
    /// How the lines combine; all `And` when absent.
    pub modes: Option<Vec<ClipMode>>,
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
    fn clip_weight_is_at_least_zero_or_nan_for_none() {
        let curve = |w: f32, u: f32| {
            let curves = Some(vec![ClipCurve { theta1: 0.0, theta3: 1.0, u, v: 0.0, w }]);
            is_accepted(ClipColumns { curves, ..ClipColumns::default() })
        };
        assert!(curve(0.0, 0.5) && curve(1e9, 0.5) && curve(f32::NAN, f32::NAN));
        assert!(!curve(-1e-6, 0.5) && !curve(f32::INFINITY, 0.5) && !curve(1.0, f32::NAN));
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
