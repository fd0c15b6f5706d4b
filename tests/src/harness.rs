//! Holds a backend against the reference, pixel by pixel.
//!
//! Every plane is compared linearly. A pixel that is farther off than the tolerance is an outlier; it is forgiven only
//! where the reference says that a decision of the model is within its margin there, and only a few in a picture.

use crate::scenes::{self, Case};
use std::fmt;
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, RenderError, Renderer};

/// Absolute tolerance of colour, normal and weight; of Z times the median |Z|. An eighth of an 8-bit level's half: nothing
/// that shows, and 16 times what summing a hundred f32 fragments loses.
pub const ABSOLUTE: f64 = 2e-4;
/// Relative tolerance of every plane.
pub const RELATIVE: f64 = 1e-3;
/// Share of a picture's pixels that may be outliers, all of them within their margin (rendering model, ties).
pub const FORGIVEN_SHARE: f64 = 0.025;

/// How far one plane is off.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaneError {
    /// Name: `color`, `Z`, `normal` or `weight`.
    pub plane: &'static str,
    /// Greatest error outside of the margin as a multiple of the tolerance; above 1 is a failure.
    pub worst: f64,
    /// Where that is: column and row.
    pub at: [u32; 2],
    /// Values there: got and wanted.
    pub values: [f32; 2],
    /// Pixels outside of the margin that are off by more than the tolerance.
    pub outliers: usize,
}

/// What a comparison found.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Within tolerance.
    Passed,
    /// The backend says that it doesn't draw this.
    Skipped(String),
    /// Something is wrong, in words.
    Failed(String),
}

/// A compared picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Name of the case.
    pub name: String,
    /// Plane by plane.
    pub planes: Vec<PlaneError>,
    /// Outliers within the margin.
    pub forgiven: usize,
    /// Share of pixels within the margin.
    pub margin_share: f64,
    /// Passed or not.
    pub verdict: Verdict,
}

impl Report {
    /// True unless the verdict is a failure.
    pub fn is_ok(&self) -> bool {
        !matches!(self.verdict, Verdict::Failed(_))
    }

    fn of_verdict(name: &str, verdict: Verdict) -> Self {
        Self { name: name.into(), planes: Vec::new(), forgiven: 0, margin_share: 0.0, verdict }
    }

    fn failed(name: &str, message: impl fmt::Display) -> Self {
        Self::of_verdict(name, Verdict::Failed(message.to_string()))
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.verdict {
            Verdict::Passed => write!(f, "{}: passed", self.name)?,
            Verdict::Skipped(why) => write!(f, "skipped: {}: {why}", self.name)?,
            Verdict::Failed(why) => write!(f, "{}: FAILED: {why}", self.name)?,
        }
        for p in &self.planes {
            write!(f, "\n  {:6} worst {:.3} of the tolerance at {:?}", p.plane, p.worst, p.at)?;
            write!(f, ": got {}, want {}; {} outliers", p.values[0], p.values[1], p.outliers)?;
        }
        write!(f, "\n  {} forgiven, {:.2} % within the margin", self.forgiven, 100.0 * self.margin_share)
    }
}

/// Compares the planes that `want` has. `margin` is the reference's plane: 1 where a decision is within its margin.
pub fn compare_frames(name: &str, got: &Frame, want: &Frame, margin: &[f32]) -> Report {
    let pixels = want.width as usize * want.height as usize;
    if (got.width, got.height) != (want.width, want.height) || margin.len() != pixels {
        let message = format!(
            "sizes differ: got {}x{}, want {}x{}, margin of {} pixels",
            got.width,
            got.height,
            want.width,
            want.height,
            margin.len()
        );
        return Report::failed(name, message);
    }
    let mut finite: Vec<f32> = want.depth.iter().copied().filter(|z| z.is_finite()).map(f32::abs).collect();
    finite.sort_by(f32::total_cmp);
    let median = finite.get(finite.len() / 2).map_or(1.0, |&z| f64::from(z));
    let mut outliers = vec![false; pixels];
    let mut broken = Vec::new();
    let planes: [(_, &[f32], &[f32], f64); 4] = [
        ("color", got.color.as_flattened(), want.color.as_flattened(), ABSOLUTE),
        ("Z", &got.depth, &want.depth, ABSOLUTE * median),
        ("normal", got.normal.as_flattened(), want.normal.as_flattened(), ABSOLUTE),
        ("weight", &got.weight, &want.weight, ABSOLUTE),
    ];
    let mut errors = Vec::new();
    for (plane, got, want_plane, absolute) in planes {
        if got.len() != want_plane.len() {
            broken.push(format!("plane {plane} has {} values, not {}", got.len(), want_plane.len()));
            continue;
        }
        if got.iter().any(|v| v.is_nan()) {
            broken.push(format!("plane {plane} has NaN"));
        }
        if !want_plane.is_empty() {
            errors.push(compare_plane(plane, got, want_plane, absolute, want.width, margin, &mut outliers));
        }
    }
    for e in errors.iter().filter(|e| e.outliers > 0) {
        broken.push(format!("{} pixels of {} are off outside of the margin", e.outliers, e.plane));
    }
    let forgiven = outliers.iter().zip(margin).filter(|(o, m)| **o && **m != 0.0).count();
    if forgiven as f64 > FORGIVEN_SHARE * pixels as f64 {
        broken.push(format!("{forgiven} outliers within the margin, more than {FORGIVEN_SHARE} of {pixels} pixels"));
    }
    let margin_share = margin.iter().filter(|m| **m != 0.0).count() as f64 / pixels.max(1) as f64;
    let verdict = if broken.is_empty() { Verdict::Passed } else { Verdict::Failed(broken.join("; ")) };
    Report { name: name.into(), planes: errors, forgiven, margin_share, verdict }
}

fn compare_plane(
    plane: &'static str,
    got: &[f32],
    want: &[f32],
    absolute: f64,
    width: u32,
    margin: &[f32],
    outliers: &mut [bool],
) -> PlaneError {
    let channels = want.len() / margin.len().max(1);
    let mut worst = PlaneError { plane, worst: 0.0, at: [0; 2], values: [0.0; 2], outliers: 0 };
    for (i, pixel) in outliers.iter_mut().enumerate() {
        let mut off = false;
        for (&a, &b) in got[i * channels..].iter().zip(&want[i * channels..(i + 1) * channels]) {
            // Equal infinities are equal; one infinity, or a NaN, is infinitely off.
            let error = if a == b { 0.0 } else { f64::from(a - b).abs() / (absolute + RELATIVE * f64::from(b).abs()) };
            let error = if error.is_finite() { error } else { f64::INFINITY };
            off |= error > 1.0;
            if margin[i] == 0.0 && error > worst.worst {
                (worst.worst, worst.values) = (error, [a, b]);
                worst.at = [i as u32 % width.max(1), i as u32 / width.max(1)];
            }
        }
        worst.outliers += usize::from(off && margin[i] == 0.0);
        *pixel |= off;
    }
    worst
}

/// The reference's picture of a case, margin included.
///
/// # Errors
/// [`RenderError`] if the reference refuses the case.
pub fn reference_frame(reference: &mut Reference, case: &Case) -> Result<Frame, RenderError> {
    let resident = reference.upload(&case.scene)?;
    let mut frame = Frame::default();
    let planes = Planes { margin: true, ..Planes::ALL };
    reference.render(&resident, &case.view(), &case.settings, planes, &mut frame)?;
    Ok(frame)
}

/// Renders a case on a backend.
///
/// # Errors
/// [`RenderError`] as the backend gives it.
pub fn render<R: Renderer>(backend: &mut R, case: &Case, planes: Planes) -> Result<Frame, RenderError> {
    let resident = backend.upload(&case.scene)?;
    let mut frame = Frame::default();
    backend.render(&resident, &case.view(), &case.settings, planes, &mut frame)?;
    Ok(frame)
}

/// Renders one case on a backend and compares it with the reference.
pub fn check_case<R: Renderer>(backend: &mut R, reference: &mut Reference, case: &Case) -> Report {
    let want = match reference_frame(reference, case) {
        Ok(frame) => frame,
        Err(error) => return Report::failed(&case.name, format!("the reference refuses it: {error}")),
    };
    match render(backend, case, Planes::ALL) {
        Ok(got) => compare_frames(&case.name, &got, &want, &want.margin),
        Err(error @ RenderError::Unsupported { .. }) => {
            Report::of_verdict(&case.name, Verdict::Skipped(error.to_string()))
        }
        Err(error) => Report::failed(&case.name, error),
    }
}

/// Holds a backend against the reference in every scene.
///
/// One report a case, in the order of [`scenes::all`]. What the backend says it doesn't draw is skipped; it is for the
/// caller to know which those may be.
pub fn check_backend<R: Renderer>(backend: &mut R) -> Vec<Report> {
    let mut reference = match Reference::new(0) {
        Ok(reference) => reference,
        Err(error) => return vec![Report::failed("reference", error)],
    };
    scenes::all().iter().map(|case| check_case(backend, &mut reference, case)).collect()
}
