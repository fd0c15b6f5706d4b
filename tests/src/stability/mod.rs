//! Sweeps of parameters to extremes: one parameter of an image runs from harmless to absurd values. Every backend's
//! image is compared with exact arithmetic, or with a reference that has no difficulty.
//!
//! - [`exact`]: a splat in exact arithmetic; `naive`: published formulas that Surfel replaces, in f32;
//! - [`Sweep`]: a parameter, its images, and the rounding error by the derived law; `splats`, `scenes`, `sheets`,
//!   `balls`: all sweeps;
//! - [`run`]: a backend's results in a sweep; [`page`], [`breaks`]: reports.

mod balls;
mod draw;
pub mod exact;
mod naive;
mod report;
mod scenes;
mod sheets;
mod splats;

pub use draw::{Draw, Outcome, Point, Precision, drawer, first_break, naive_points, run};
pub use report::{Measured, breaks, page};

use surfel_math::project::ViewSplat;
use surfel_model::{Camera, Scene, Settings};
use surfel_render::{Region, View};

/// Image to be drawn.
#[derive(Clone, Debug)]
pub struct Image {
    /// Scene to draw.
    pub scene: Scene,
    /// Camera of the image.
    pub camera: Camera,
    /// Region of the image that is drawn; `None` for the whole image.
    pub region: Option<Region>,
    /// Settings of the image.
    pub settings: Settings,
}

impl Image {
    /// Returns the view of the drawn region.
    ///
    /// # Panics
    /// If the camera or the region is invalid: sweeps are written in code, not read.
    pub fn view(&self) -> View {
        View::of_region(&self.camera, self.region).expect("sweeps have valid cameras")
    }
}

/// Source of the expected image.
#[derive(Clone, Debug)]
pub enum Truth {
    /// One unfiltered splat in exact arithmetic, and the number of its copies in the image.
    Exact(ViewSplat<f64>, u32),
    /// Image that the f64 reference draws.
    Reference,
    /// Image that the f64 reference draws of another case, which avoids the difficulty.
    Easier(Box<Image>),
}

/// Quantity that is compared. All quantities except [`Measure::Coverage`] are measured in pixels that both images hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// Absolute error of Σw, in units of [`Probe::scale`].
    Weight,
    /// Relative error of Z.
    Depth,
    /// Absolute error of the colour.
    Color,
    /// Number of pixels outside of decision margins that only one of the two images hits, divided by the number of
    /// pixels that the expected image hits.
    Coverage,
}

/// Image at one value of a sweep's parameter, with its truth and its error bound.
#[derive(Clone, Debug)]
pub struct Probe {
    /// Image to be drawn.
    pub image: Image,
    /// Source of the expected image.
    pub truth: Truth,
    /// Amplification of the rounding error of one operation. The law's error bound is this factor times the unit
    /// roundoff, plus `floor` and the backend's [`Precision::fixed`].
    pub amplification: f64,
    /// Part of the error bound that isn't due to the backend's arithmetic.
    pub floor: f64,
    /// Unit of weights: the splat's largest weight, or the number of splats.
    pub scale: f64,
    /// Published formula to compare with.
    pub naive: Naive,
}

/// Published formula that Surfel replaces, evaluated in f32 to compare its error.
#[derive(Clone, Debug)]
pub enum Naive {
    /// No published formula.
    Nothing,
    /// The published matrix form of this splat.
    Matrix(ViewSplat<f64>),
    /// The published filter of this splat, by its covariance matrix.
    Covariance(ViewSplat<f64>),
    /// Exact arithmetic of the splat that results from rounding the inputs of the intended one.
    Moved(ViewSplat<f64>),
    /// Error of the published formula, which is known without evaluating it.
    Known(f64),
}

/// Sweep: a parameter that approaches an extreme.
pub struct Sweep {
    /// Short name, for tables and tests.
    pub name: &'static str,
    /// Description of the parameter, with its unit.
    pub parameter: &'static str,
    /// Description of the difficulty, for readers who haven't read the papers.
    pub about: &'static str,
    /// Derivation of the error bound.
    pub law: &'static str,
    /// Description of the published formula; empty without one.
    pub naive: &'static str,
    /// Quantity that is compared.
    pub measure: Measure,
    /// Values of the parameter, from the harmless to the extreme end.
    pub values: Vec<f64>,
    /// Most extreme value at which no fault is allowed.
    pub required: f64,
    /// Function that returns the images at a value.
    pub probes: fn(f64) -> Vec<Probe>,
}

impl Sweep {
    /// True if no fault is allowed at this value.
    pub fn requires(&self, value: f64) -> bool {
        let rises = self.values.first() < self.values.last();
        if rises { value <= self.required * (1.0 + 1e-9) } else { value >= self.required * (1.0 - 1e-9) }
    }
}

/// Returns all sweeps.
pub fn sweeps() -> Vec<Sweep> {
    let mut all = splats::sweeps();
    all.extend(scenes::sweeps());
    all.extend(sheets::sweeps());
    all.extend(balls::sweeps());
    all
}

/// Returns powers of ten from 10^`from` to 10^`to`. The exponents differ by `step`.
fn powers(from: f64, to: f64, step: f64) -> Vec<f64> {
    let count = ((to - from).abs() / step).round() as i32;
    let sign = if to < from { -step } else { step };
    (0..=count).map(|i| 10f64.powf(from + sign * f64::from(i))).collect()
}
