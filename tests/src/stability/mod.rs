//! Sweeps to the extremes: one parameter of an image runs from harmless to absurd. Every backend's image is compared
//! with exact arithmetic, or with a reference that has no difficulty.
//!
//! - [`exact`]: a splat in exact arithmetic; `naive`: the published formulas that ours replace, in f32;
//! - [`Sweep`]: a parameter, its images, and the rounding error by the derived law; `splats`, `scenes`,
//!   `sheets`, `balls`: all sweeps;
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

/// An image to draw.
#[derive(Clone, Debug)]
pub struct Image {
    /// Scene to draw.
    pub scene: Scene,
    /// Camera of the image.
    pub camera: Camera,
    /// Region of the image that is drawn.
    pub region: Option<Region>,
    /// Settings of the image.
    pub settings: Settings,
}

impl Image {
    /// Returns the view of the region.
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
    /// Exact arithmetic of one unfiltered splat, which the image has this number of times.
    Exact(ViewSplat<f64>, u32),
    /// The f64 reference's image.
    Reference,
    /// The f64 reference's image of another case, without the difficulty.
    Easier(Box<Image>),
}

/// Quantity that is compared, over pixels that both images hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// Σw, absolute, in units of [`Probe::scale`].
    Weight,
    /// Z, relative.
    Depth,
    /// Colour, absolute.
    Color,
    /// Fraction of the hit pixels that only one of the two images hits.
    Coverage,
}

/// An image at one value of a parameter.
#[derive(Clone, Debug)]
pub struct Probe {
    /// The image.
    pub image: Image,
    /// Source of the expected image.
    pub truth: Truth,
    /// Amplification of the rounding of one operation: the law's error is this times the unit roundoff.
    pub amplification: f64,
    /// Part of the error that isn't due to the backend's rounding.
    pub floor: f64,
    /// Unit of weights: the splat's largest weight, or the number of splats.
    pub scale: f64,
    /// The formula that ours replaces.
    pub naive: Naive,
}

/// The published formula that ours replaces, in f32.
#[derive(Clone, Debug)]
pub enum Naive {
    /// No formula to compare with.
    Nothing,
    /// The published matrix form of this splat.
    Matrix(ViewSplat<f64>),
    /// The published filter of this splat, by its covariance matrix.
    Covariance(ViewSplat<f64>),
    /// Exact arithmetic of this splat, which rounding of inputs yields from the intended one.
    Moved(ViewSplat<f64>),
    /// A known error.
    Known(f64),
}

/// A sweep: a parameter that approaches an extreme.
pub struct Sweep {
    /// Short name, for tables and tests.
    pub name: &'static str,
    /// Description of the parameter, with its unit.
    pub parameter: &'static str,
    /// The difficulty, for a reader who hasn't read the papers.
    pub about: &'static str,
    /// Origin of the bound.
    pub law: &'static str,
    /// Description of the formula that ours replaces; empty without one.
    pub naive: &'static str,
    /// Quantity that is compared.
    pub measure: Measure,
    /// Values of the parameter, from the harmless end.
    pub values: Vec<f64>,
    /// The farthest value at which no fault is allowed.
    pub required: f64,
    /// Returns the images at a value.
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

/// Returns powers of ten from 10^`from` to 10^`to`, in steps of the exponent.
fn powers(from: f64, to: f64, step: f64) -> Vec<f64> {
    let count = ((to - from).abs() / step).round() as i32;
    let sign = if to < from { -step } else { step };
    (0..=count).map(|i| 10f64.powf(from + sign * f64::from(i))).collect()
}
