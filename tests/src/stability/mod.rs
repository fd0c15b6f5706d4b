//! Sweeps to the extremes: one parameter of an image runs from harmless to absurd, and every backend's image is held
//! against exact arithmetic or a reference that has no difficulty.
//!
//! - [`exact`]: a splat in exact arithmetic; `naive`: the formulas that ours replace, in f32;
//! - [`Sweep`]: a parameter, its images, the error that rounding may cause by the derived law; `splats`, `scenes`: all
//!   of them;
//! - [`run`]: what a backend makes of a sweep; [`page`], [`breaks`]: how it is shown.

mod draw;
pub mod exact;
mod naive;
mod report;
mod scenes;
mod splats;

pub use draw::{Draw, Outcome, Point, Precision, drawer, first_break, naive_points, run};
pub use report::{Measured, breaks, page};

use surfel_math::project::ViewSplat;
use surfel_model::{Camera, Scene, Settings};
use surfel_render::{Region, View};

/// An image to be drawn.
#[derive(Clone, Debug)]
pub struct Image {
    /// What is drawn.
    pub scene: Scene,
    /// From where.
    pub camera: Camera,
    /// Which part of the image.
    pub region: Option<Region>,
    /// How.
    pub settings: Settings,
}

impl Image {
    /// The view of its region.
    ///
    /// # Panics
    /// If the camera or the region is invalid: sweeps are written here, not read.
    pub fn view(&self) -> View {
        View::of_region(&self.camera, self.region).expect("sweeps have valid cameras")
    }
}

/// What an image should be.
#[derive(Clone, Debug)]
pub enum Truth {
    /// One unfiltered splat, so many times, in exact arithmetic.
    Exact(ViewSplat<f64>, u32),
    /// What the f64 reference makes of the image itself.
    Reference,
    /// What the f64 reference makes of another image, which has no such difficulty.
    Easier(Box<Image>),
}

/// What is compared, over pixels that both images hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measure {
    /// Σw, absolute, in units of [`Probe::scale`].
    Weight,
    /// Z, relative.
    Depth,
    /// Colour, absolute.
    Color,
    /// Share of the hit pixels that one of the two images has and the other hasn't.
    Coverage,
}

/// An image at one value of a parameter.
#[derive(Clone, Debug)]
pub struct Probe {
    /// The image.
    pub image: Image,
    /// What it should be.
    pub truth: Truth,
    /// How much the rounding of one operation may matter: the law's error is this times the unit roundoff.
    pub amplification: f64,
    /// What of the error doesn't come from the rounding of the backend's arithmetic.
    pub floor: f64,
    /// What weights are measured in: the splat's largest, or how many there are.
    pub scale: f64,
    /// What ours replaces.
    pub naive: Naive,
}

/// The formula that ours replaces, in f32.
#[derive(Clone, Debug)]
pub enum Naive {
    /// Nothing to compare with.
    Nothing,
    /// The published matrix form of this splat.
    Matrix(ViewSplat<f64>),
    /// The published filter of this splat, by its covariance matrix.
    Covariance(ViewSplat<f64>),
    /// Another splat, exactly: what the rounding of inputs makes of the one that is meant.
    Moved(ViewSplat<f64>),
    /// This error.
    Known(f64),
}

/// A parameter on its way to an extreme.
pub struct Sweep {
    /// Short, for tables and tests.
    pub name: &'static str,
    /// What the parameter is, with its unit.
    pub parameter: &'static str,
    /// What is hard about it, for a reader who hasn't read the papers.
    pub about: &'static str,
    /// Where the bound comes from.
    pub law: &'static str,
    /// What the formula is that ours replaces; empty without one.
    pub naive: &'static str,
    /// What is compared.
    pub measure: Measure,
    /// Values of the parameter, the harmless end first.
    pub values: Vec<f64>,
    /// The farthest value at which nothing may break.
    pub required: f64,
    /// Images at a value.
    pub probes: fn(f64) -> Vec<Probe>,
}

impl Sweep {
    /// True if nothing may break at this value.
    pub fn requires(&self, value: f64) -> bool {
        let rises = self.values.first() < self.values.last();
        if rises { value <= self.required * (1.0 + 1e-9) } else { value >= self.required * (1.0 - 1e-9) }
    }
}

/// All sweeps.
pub fn sweeps() -> Vec<Sweep> {
    let mut all = splats::sweeps();
    all.extend(scenes::sweeps());
    all
}

/// Powers of ten from 10^`from` to 10^`to`, every `step` of the exponent.
fn powers(from: f64, to: f64, step: f64) -> Vec<f64> {
    let count = ((to - from).abs() / step).round() as i32;
    let sign = if to < from { -step } else { step };
    (0..=count).map(|i| 10f64.powf(from + sign * f64::from(i))).collect()
}
