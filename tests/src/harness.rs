//! Comparison of a backend with the reference, pixel by pixel.
//!
//! Every plane is compared linearly. A pixel whose error exceeds the tolerance is an outlier. An outlier is forgiven
//! only if a decision of the model in this pixel is within its margin in the reference, and only for a small fraction
//! of the image. Known differences of backends are listed in [`crate::expectations`].

use crate::expectations::{self, EXPECTATIONS, Extent};
use crate::scenes::{self, Case};
use std::fmt;
use std::sync::OnceLock;
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, RenderError, Renderer, RendererInfo};

/// Absolute tolerance of colour, normal and weight; the absolute tolerance of Z is this value times the median |Z|. The
/// tolerance is about 1/16 of an 8-bit level, which is invisible. It is also 16 times the rounding error of a sum of a
/// hundred f32 fragments.
pub const ABSOLUTE: f64 = 2e-4;
/// Tolerance of every plane relative to the expected value, in addition to [`ABSOLUTE`].
pub const RELATIVE: f64 = 1e-3;
/// Largest fraction of an image's pixels whose outliers may be forgiven (rendering model, *Ties and margins*).
pub const MAX_FORGIVEN_FRACTION: f64 = 0.025;

/// Plane of an image that is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plane {
    /// Linear premultiplied RGBA.
    Color,
    /// Planar depth.
    Z,
    /// World normal.
    Normal,
    /// Sum of weights.
    Weight,
}

impl Plane {
    /// Returns the name of the plane in messages and EXR files: `color`, `Z`, `normal` or `weight`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Color => "color",
            Self::Z => "Z",
            Self::Normal => "normal",
            Self::Weight => "weight",
        }
    }
}

/// Error of one plane.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaneError {
    /// Plane in which the error was measured.
    pub plane: Plane,
    /// Largest error outside of decision margins, in multiples of the tolerance; above 1 is a failure.
    pub worst: f64,
    /// Column and row of the largest error.
    pub at: [u32; 2],
    /// Values at the largest error: actual and expected.
    pub values: [f32; 2],
    /// Number of outliers outside of decision margins: pixels with an error above the tolerance.
    pub outliers: usize,
}

/// Result of a comparison.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// All errors are within the tolerance.
    Passed,
    /// Errors are within the limits of [`EXPECTATIONS`]. Contains the reason.
    Expected(String),
    /// The backend reports that it doesn't support this scene. Contains the reason.
    Skipped(String),
    /// The comparison failed. Contains a description.
    Failed(String),
}

/// Report of the comparison of one image.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Name of the case.
    pub name: String,
    /// Errors by plane.
    pub planes: Vec<PlaneError>,
    /// Number of forgiven outliers, which are within a decision margin.
    pub forgiven: usize,
    /// Fraction of pixels within a decision margin.
    pub margin_share: f64,
    /// Faults other than errors of planes: NaN, a missing plane, too many forgiven pixels. No expectation excuses them.
    pub broken: Vec<String>,
    /// Verdict on the image.
    pub verdict: Verdict,
}

impl Report {
    /// True unless the verdict is a failure.
    pub fn is_ok(&self) -> bool {
        !matches!(self.verdict, Verdict::Failed(_))
    }

    fn of_verdict(name: &str, verdict: Verdict) -> Self {
        Self { name: name.into(), planes: Vec::new(), forgiven: 0, margin_share: 0.0, broken: Vec::new(), verdict }
    }

    /// Creates a report of a failure without an image.
    pub fn failed(name: &str, message: impl fmt::Display) -> Self {
        let message = message.to_string();
        Self { broken: vec![message.clone()], ..Self::of_verdict(name, Verdict::Failed(message)) }
    }

    /// Adds faults that were found outside of the comparison. The verdict becomes a failure if there are any.
    pub(crate) fn fail(&mut self, messages: impl IntoIterator<Item = String>) {
        let before = self.broken.len();
        self.broken.extend(messages);
        if self.broken.len() > before {
            self.verdict = Verdict::Failed(self.faults(|_| 1.0).join("; "));
        }
    }

    /// Returns descriptions of all faults. `allowed` returns the maximum error of a plane in multiples of the
    /// tolerance.
    pub(crate) fn faults(&self, allowed: impl Fn(Plane) -> f64) -> Vec<String> {
        let off = self.planes.iter().filter(|p| p.worst > allowed(p.plane));
        let words =
            |p: &PlaneError| format!("{} pixels of {} are off outside of the margin", p.outliers, p.plane.name());
        self.broken.iter().cloned().chain(off.map(words)).collect()
    }

    /// Returns the plane with the largest error; `None` if no plane was compared.
    pub fn worst_plane(&self) -> Option<&PlaneError> {
        self.planes.iter().max_by(|a, b| a.worst.total_cmp(&b.worst))
    }

    /// Returns the number of outliers outside of decision margins in the plane that has most of them.
    pub fn outliers(&self) -> usize {
        self.planes.iter().map(|p| p.outliers).max().unwrap_or(0)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.verdict {
            Verdict::Passed => write!(f, "{}: passed", self.name)?,
            Verdict::Expected(why) => write!(f, "{}: as expected: {why}", self.name)?,
            Verdict::Skipped(why) => write!(f, "skipped: {}: {why}", self.name)?,
            Verdict::Failed(why) => write!(f, "{}: FAILED: {why}", self.name)?,
        }
        for p in &self.planes {
            write!(f, "\n  {:6} worst {:.3} of the tolerance at {:?}", p.plane.name(), p.worst, p.at)?;
            write!(f, ": got {}, want {}; {} outliers", p.values[0], p.values[1], p.outliers)?;
        }
        write!(f, "\n  {} forgiven, {:.2} % within the margin", self.forgiven, 100.0 * self.margin_share)
    }
}

/// Compares the planes of two frames. `margin` is the reference's plane of decision margins: 1 in pixels where a
/// decision is within its margin.
pub fn compare_frames(name: &str, got: &Frame, want: &Frame, margin: &[f32]) -> Report {
    let pixels = want.width() as usize * want.height() as usize;
    if (got.width(), got.height()) != (want.width(), want.height()) || margin.len() != pixels {
        let message = format!(
            "sizes differ: got {}x{}, want {}x{}, margin of {} pixels",
            got.width(),
            got.height(),
            want.width(),
            want.height(),
            margin.len()
        );
        return Report::failed(name, message);
    }
    let mut outliers = vec![false; pixels];
    let mut broken = Vec::new();
    let mut errors = Vec::new();
    for planes in pairs(got, want) {
        let Pair { plane, got, want: wanted, .. } = planes;
        if got.len() != wanted.len() {
            broken.push(format!("plane {} has {} values, not {}", plane.name(), got.len(), wanted.len()));
            continue;
        }
        if got.iter().any(|v| v.is_nan()) {
            broken.push(format!("plane {} has NaN", plane.name()));
        }
        if !wanted.is_empty() {
            errors.push(compare_plane(&planes, want.width(), margin, &mut outliers));
        }
    }
    let forgiven = outliers.iter().zip(margin).filter(|(o, m)| **o && **m != 0.0).count();
    if forgiven as f64 > MAX_FORGIVEN_FRACTION * pixels as f64 {
        broken.push(format!(
            "{forgiven} outliers within the margin, more than {MAX_FORGIVEN_FRACTION} of {pixels} pixels"
        ));
    }
    let margin_share = margin.iter().filter(|m| **m != 0.0).count() as f64 / pixels.max(1) as f64;
    let passed = Report::of_verdict(name, Verdict::Passed);
    let mut report = Report { planes: errors, forgiven, margin_share, broken, ..passed };
    let faults = report.faults(|_| 1.0);
    if !faults.is_empty() {
        report.verdict = Verdict::Failed(faults.join("; "));
    }
    report
}

/// Returns the largest error of each pixel over all planes, in multiples of the tolerance. Both frames must have the
/// same size; planes of different lengths are skipped.
pub fn pixel_errors(got: &Frame, want: &Frame) -> Vec<f64> {
    let mut worst = vec![0.0f64; want.width() as usize * want.height() as usize];
    for planes in pairs(got, want).iter().filter(|p| p.got.len() == p.want.len() && !p.want.is_empty()) {
        let channels = planes.want.len() / worst.len().max(1);
        for (i, worst) in worst.iter_mut().enumerate() {
            *worst = planes.errors(i, channels).fold(*worst, |worst, (error, _)| worst.max(error));
        }
    }
    worst
}

/// One plane of two frames, as flat arrays, with its absolute tolerance.
struct Pair<'a> {
    plane: Plane,
    got: &'a [f32],
    want: &'a [f32],
    absolute: f64,
}

impl Pair<'_> {
    /// Returns the errors of a pixel's channels in multiples of the tolerance, each with the actual and the expected
    /// value.
    fn errors(&self, pixel: usize, channels: usize) -> impl Iterator<Item = (f64, [f32; 2])> {
        let of_pixel = pixel * channels..(pixel + 1) * channels;
        self.got[of_pixel.clone()].iter().zip(&self.want[of_pixel]).map(|(&a, &b)| {
            let tolerance = self.absolute + RELATIVE * f64::from(b).abs();
            // Equal infinities have no error. An infinity in only one of the frames, or NaN, is an infinite error.
            let error = if a == b { 0.0 } else { f64::from(a - b).abs() / tolerance };
            (if error.is_finite() { error } else { f64::INFINITY }, [a, b])
        })
    }
}

fn pairs<'a>(got: &'a Frame, want: &'a Frame) -> [Pair<'a>; 4] {
    let mut finite: Vec<f32> = want.depth().iter().copied().filter(|z| z.is_finite()).map(f32::abs).collect();
    finite.sort_by(f32::total_cmp);
    let median = finite.get(finite.len() / 2).map_or(1.0, |&z| f64::from(z));
    let pair = |plane, got, want| Pair { plane, got, want, absolute: ABSOLUTE };
    [
        pair(Plane::Color, got.color().as_flattened(), want.color().as_flattened()),
        Pair { absolute: ABSOLUTE * median, ..pair(Plane::Z, got.depth(), want.depth()) },
        pair(Plane::Normal, got.normal().as_flattened(), want.normal().as_flattened()),
        pair(Plane::Weight, got.weight(), want.weight()),
    ]
}

fn compare_plane(planes: &Pair<'_>, width: u32, margin: &[f32], outliers: &mut [bool]) -> PlaneError {
    let channels = planes.want.len() / margin.len().max(1);
    let mut worst = PlaneError { plane: planes.plane, worst: 0.0, at: [0; 2], values: [0.0; 2], outliers: 0 };
    for (i, pixel) in outliers.iter_mut().enumerate() {
        let mut off = false;
        for (error, values) in planes.errors(i, channels) {
            off |= error > 1.0;
            if margin[i] == 0.0 && error > worst.worst {
                (worst.worst, worst.values) = (error, values);
                worst.at = [i as u32 % width.max(1), i as u32 / width.max(1)];
            }
        }
        worst.outliers += usize::from(off && margin[i] == 0.0);
        *pixel |= off;
    }
    worst
}

/// Draws a case with the reference, including the plane of decision margins.
///
/// # Errors
/// [`RenderError`] if the reference refuses the case.
pub fn reference_frame(reference: &mut Reference, case: &Case) -> Result<Frame, RenderError> {
    let resident = reference.upload(&case.scene)?;
    let mut frame = Frame::default();
    let planes = Planes::ALL.with_margin(true);
    reference.render_into(&resident, &case.view(), &case.settings, planes, &mut frame)?;
    Ok(frame)
}

/// Draws a case with a backend.
///
/// # Errors
/// The backend's [`RenderError`].
pub fn render<R: Renderer>(backend: &mut R, case: &Case, planes: Planes) -> Result<Frame, RenderError> {
    let resident = backend.upload(&case.scene)?;
    let mut frame = Frame::default();
    backend.render_into(&resident, &case.view(), &case.settings, planes, &mut frame)?;
    Ok(frame)
}

/// Case with the reference's image of it.
pub struct Truth {
    /// Case that was drawn.
    pub case: Case,
    /// The reference's image, including decision margins, or the reason why there is none.
    pub want: Result<Frame, RenderError>,
}

impl Truth {
    /// Draws a case with the reference.
    pub fn of(reference: &mut Reference, case: Case) -> Self {
        let want = reference_frame(reference, &case);
        Self { case, want }
    }

    /// Draws the scenes that `is_wanted` selects by name, with the reference, in the order of [`scenes::all`].
    ///
    /// # Errors
    /// [`RenderError`] if the reference doesn't start.
    pub fn all(is_wanted: impl Fn(&str) -> bool) -> Result<Vec<Self>, RenderError> {
        let mut reference = Reference::new(Default::default())?;
        let cases = scenes::all().into_iter().filter(|case| is_wanted(&case.name));
        Ok(cases.map(|case| Self::of(&mut reference, case)).collect())
    }

    /// Returns the truths of all scenes. The reference draws them once per process.
    ///
    /// # Errors
    /// [`RenderError`] if the reference doesn't start.
    pub fn of_every_scene() -> Result<&'static [Self], &'static RenderError> {
        static TRUTHS: OnceLock<Result<Vec<Truth>, RenderError>> = OnceLock::new();
        TRUTHS.get_or_init(|| Self::all(|_| true)).as_deref()
    }
}

/// Image of a backend with the report of its comparison.
pub struct Checked {
    /// Report of the comparison.
    pub report: Report,
    /// Image that the backend drew; `None` if it drew none.
    pub got: Option<Frame>,
}

/// Draws one case with a backend and compares the image with the reference's.
pub fn check<R: Renderer>(backend: &mut R, truth: &Truth) -> Checked {
    let name = &truth.case.name;
    let without = |report| Checked { report, got: None };
    let want = match &truth.want {
        Ok(frame) => frame,
        Err(error) => return without(Report::failed(name, format!("the reference refuses it: {error}"))),
    };
    match render(backend, &truth.case, Planes::ALL) {
        Ok(got) => Checked { report: compare_frames(name, &got, want, want.margin()), got: Some(got) },
        Err(error @ RenderError::Unsupported { .. }) => {
            without(Report::of_verdict(name, Verdict::Skipped(error.to_string())))
        }
        Err(error) => without(Report::failed(name, error)),
    }
}

/// Compares like [`check`], after drawing the truth with the reference.
pub fn check_case<R: Renderer>(backend: &mut R, reference: &mut Reference, case: &Case) -> Report {
    check(backend, &Truth::of(reference, case.clone())).report
}

/// Compares a backend with the reference in the cases of `truths`, and applies the expectations.
///
/// Returns one result per truth, in their order, followed by one result without an image for each unused expectation.
pub fn check_all<R: Renderer>(backend: &mut R, truths: &[Truth], extent: Extent) -> Vec<Checked> {
    let mut checked: Vec<Checked> = truths.iter().map(|truth| check(backend, truth)).collect();
    expect(backend.info(), extent, &mut checked);
    checked
}

/// Applies [`EXPECTATIONS`] to the results of a backend. If every scene was compared, appends a failure for each unused
/// expectation.
pub(crate) fn expect(info: &RendererInfo, extent: Extent, checked: &mut Vec<Checked>) {
    let reports = checked.iter_mut().map(|c| &mut c.report);
    let unused = expectations::apply(EXPECTATIONS, info, extent, reports);
    checked.extend(unused.into_iter().map(|report| Checked { report, got: None }));
}

/// Compares a backend with the reference in every scene, like [`check_all`].
///
/// Scenes that the backend reports as unsupported are skipped. The caller has to check that these are the right ones.
pub fn check_backend<R: Renderer>(backend: &mut R) -> Vec<Report> {
    match Truth::of_every_scene() {
        Ok(truths) => check_all(backend, truths, Extent::EveryScene).into_iter().map(|c| c.report).collect(),
        Err(error) => vec![Report::failed("reference", error)],
    }
}
