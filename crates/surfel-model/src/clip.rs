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
