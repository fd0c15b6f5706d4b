//! Drawing of sweeps and measurement of their errors.

use super::exact::Exact;
use super::{Image, Measure, Probe, Sweep, Truth, naive};
use surfel_math::kernel;
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes, RenderError, Renderer};

/// Function that draws an image with all planes.
pub type Draw<'a> = dyn FnMut(&Image) -> Result<Frame, RenderError> + 'a;

/// Precision of a backend's arithmetic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Precision {
    /// Largest relative rounding error of one operation.
    pub roundoff: f64,
    /// Additional error of every measure except [`Measure::Coverage`], from the kernel's approximation and the rounding
    /// of planes to f32.
    pub fixed: f64,
}

impl Precision {
    /// Precision of `reference`: f64, except for the planes.
    pub const F64: Self = Self { roundoff: 1.0 / (1u64 << 53) as f64, fixed: 1.2e-7 };
    /// Precision of `cpu`: correctly rounded f32, and a kernel polynomial with an error of 1.3e-6 at c = 2
    /// (`surfel-cpu/src/setup/kernel.rs`).
    pub const F32: Self = Self { roundoff: 1.0 / (1u64 << 24) as f64, fixed: 2e-6 };
    /// Precision of `wgpu` and `ash`: in Vulkan, a division has an error of 2.5 ulp, and an exponential of 3 + 2|x|
    /// ulp.
    pub const GPU: Self = Self { roundoff: 4.0 / (1u64 << 24) as f64, fixed: 2e-6 };
}

/// Result of a backend at one value of the parameter.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point {
    /// Value of the parameter.
    pub value: f64,
    /// Error of the image at this value whose error is largest relative to its bound; NaN if no pixel could be
    /// compared.
    pub error: f64,
    /// Largest error that the sweep's law allows for the same image.
    pub bound: f64,
    /// Number of pixels outside of decision margins that only one of the two images hits, in all images at this value.
    pub stray: usize,
    /// Number of pixels with NaN, or with an infinity other than the depth of an empty pixel.
    pub non_finite: usize,
    /// Number of pixels that were compared, in all images at this value.
    pub compared: usize,
    /// Reason why the backend drew no image, if it didn't.
    pub refused: Option<String>,
    /// True if the backend reports that it doesn't support the image.
    pub unsupported: bool,
}

impl Point {
    /// Returns a description of all faults; `None` if there are none.
    pub fn fault(&self) -> Option<String> {
        let Self { error, bound, stray, non_finite, refused, .. } = self;
        let mut faults: Vec<String> = refused.iter().cloned().collect();
        if *non_finite > 0 {
            faults.push(format!("{non_finite} pixels are not finite"));
        }
        if *stray > 0 {
            faults.push(format!("{stray} pixels are stray or missing"));
        }
        if error > bound {
            faults.push(format!("error {error:.1e}, bound {bound:.1e}"));
        }
        (!faults.is_empty()).then(|| faults.join("; "))
    }
}

/// Result of a backend in a sweep: one point per value.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Points in the order of the sweep's values.
    pub points: Vec<Point>,
}

/// Returns the first point with a fault; `None` if there is none.
pub fn first_break(outcome: &Outcome) -> Option<&Point> {
    outcome.points.iter().find(|point| point.fault().is_some())
}

/// Image with which a backend's image is compared, plane by plane, and the reference's plane of decision margins.
struct Want {
    weight: Vec<f64>,
    depth: Vec<f64>,
    color: Option<Vec<[f32; 4]>>,
    margin: Vec<f32>,
}

/// Runs a sweep on backends and returns one outcome each. `reference` provides decision margins, and the truths that
/// aren't exact.
///
/// # Errors
/// [`RenderError`] if the reference can't draw a truth.
pub fn run(
    sweep: &Sweep,
    reference: &mut Reference,
    backends: &mut [(Precision, Box<Draw<'_>>)],
) -> Result<Vec<Outcome>, RenderError> {
    let mut outcomes = vec![Outcome { points: Vec::new() }; backends.len()];
    for &value in &sweep.values {
        for outcome in &mut outcomes {
            outcome.points.push(Point { value, error: f64::NAN, ..Point::default() });
        }
        for probe in (sweep.probes)(value) {
            let want = want(&probe, reference)?;
            for ((precision, draw), outcome) in backends.iter_mut().zip(&mut outcomes) {
                let Some(point) = outcome.points.last_mut() else { continue };
                match draw(&probe.image) {
                    Ok(got) => measure(sweep.measure, &probe, &want, &got, *precision, point),
                    Err(RenderError::Unsupported { .. }) => point.unsupported = true,
                    Err(error) => point.refused = Some(error.to_string()),
                }
            }
        }
    }
    Ok(outcomes)
}

/// Returns the errors of the published formula, as pairs of value and error; the error is NaN without a formula.
pub fn naive_points(sweep: &Sweep) -> Vec<[f64; 2]> {
    let worst = |value: f64| (sweep.probes)(value).iter().map(naive::error).fold(f64::NAN, f64::max);
    sweep.values.iter().map(|&value| [value, worst(value)]).collect()
}

/// Returns a function for [`run`] that draws images with a backend.
pub fn drawer<R: Renderer + 'static>(mut renderer: R) -> Box<Draw<'static>> {
    Box::new(move |image| {
        let resident = renderer.upload(&image.scene)?;
        let mut frame = Frame::default();
        renderer.render_into(&resident, &image.view(), &image.settings, Planes::ALL, &mut frame)?;
        Ok(frame)
    })
}

/// Draws an image with the reference, with all planes including the decision margin.
fn reference_frame(image: &Image, reference: &mut Reference) -> Result<Frame, RenderError> {
    let resident = reference.upload(&image.scene)?;
    let mut frame = Frame::default();
    let planes = Planes::ALL.with_margin(true);
    reference.render_into(&resident, &image.view(), &image.settings, planes, &mut frame)?;
    Ok(frame)
}

fn want(probe: &Probe, reference: &mut Reference) -> Result<Want, RenderError> {
    let frame = match &probe.truth {
        Truth::Easier(image) => reference_frame(image, reference)?,
        Truth::Exact(..) | Truth::Reference => reference_frame(&probe.image, reference)?,
    };
    let Truth::Exact(splat, count) = &probe.truth else {
        let wide = |plane: &[f32]| plane.iter().map(|&v| f64::from(v)).collect();
        let (weight, depth) = (wide(frame.weight()), wide(frame.depth()));
        return Ok(Want { weight, depth, color: Some(frame.color().to_vec()), margin: frame.margin().to_vec() });
    };
    let view = probe.image.view();
    let exact = Exact::new(splat, &view.projection);
    let (mut weight, mut depth) = (Vec::new(), Vec::new());
    for i in 0..view.pixels() as u32 {
        let pixel = [view.region.x + i % view.region.width, view.region.y + i / view.region.width];
        let hit = exact.hit(pixel);
        let of_one = |rho_squared| kernel::weight(rho_squared, probe.image.settings.cutoff);
        weight.push(hit.map_or(0.0, |h| f64::from(*count) * of_one(h.rho_squared)));
        depth.push(hit.map_or(f64::INFINITY, |h| h.z));
    }
    // No pass draws an edge-on splat, whatever its exact forms are (rendering model §2).
    if frame.weight().iter().all(|&w| w == 0.0) && is_edge_on(splat) {
        weight.fill(0.0);
    }
    Ok(Want { weight, depth, color: None, margin: frame.margin().to_vec() })
}

fn is_edge_on(splat: &surfel_math::project::ViewSplat<f64>) -> bool {
    let cosine = splat.n.dot(splat.p).abs() / splat.p.length();
    // The limit is a little larger than the rule's, because rounding decides near it.
    cosine.is_nan() || cosine <= 1.01 * surfel_math::project::EDGE_ON
}

fn measure(measure: Measure, probe: &Probe, want: &Want, got: &Frame, precision: Precision, point: &mut Point) {
    let (mut worst, mut compared, mut missed, mut hits) = (f64::NAN, 0, 0, 0);
    for i in 0..want.weight.len() {
        let weight = got.weight()[i];
        let is_finite = weight.is_finite() && got.color()[i].iter().chain(&got.normal()[i]).all(|v| v.is_finite());
        let is_depth = !got.depth()[i].is_nan() && (weight == 0.0 || got.depth()[i].is_finite());
        point.non_finite += usize::from(!(is_finite && is_depth));
        let (has, should) = (weight > 0.0, want.weight[i] > 0.0);
        hits += usize::from(should);
        if has != should {
            missed += usize::from(want.margin[i] == 0.0);
            continue;
        }
        // If the truth isn't a single splat, rounding of inputs may change decisions within the margin.
        if !has || (want.margin[i] != 0.0 && want.color.is_some()) {
            continue;
        }
        let color = |c: &Vec<[f32; 4]>| {
            got.color()[i].iter().zip(c[i]).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
        };
        let error = match measure {
            Measure::Weight => (f64::from(weight) - want.weight[i]).abs() / probe.scale,
            Measure::Depth => (f64::from(got.depth()[i]) - want.depth[i]).abs() / want.depth[i],
            Measure::Color => want.color.as_ref().map_or(0.0, color),
            Measure::Coverage => 0.0,
        };
        compared += 1;
        worst = error.max(worst);
    }
    if measure == Measure::Coverage {
        worst = missed as f64 / f64::from(hits.max(1) as u32);
    }
    let fixed = if measure == Measure::Coverage { 0.0 } else { precision.fixed };
    let bound = probe.floor + fixed + precision.roundoff * probe.amplification;
    point.stray += missed;
    point.compared += compared;
    // The reference isn't compared with itself.
    if precision == Precision::F64 && matches!(probe.truth, Truth::Reference) {
        return;
    }
    // The result is that of the image with the largest error relative to its bound.
    let share = |error: f64, bound: f64| {
        if bound > 0.0 {
            error / bound
        } else if error > 0.0 {
            f64::INFINITY
        } else {
            0.0
        }
    };
    if point.error.is_nan() || share(worst, bound) > share(point.error, point.bound) {
        (point.error, point.bound) = (worst, bound);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_says_what_is_wrong_with_it() {
        let fine = Point { error: 1e-6, bound: 1e-5, ..Point::default() };
        assert_eq!(fine.fault(), None);
        assert!(Point { error: 1e-4, ..fine.clone() }.fault().is_some_and(|f| f.contains("1.0e-4")));
        assert!(Point { stray: 2, ..fine.clone() }.fault().is_some_and(|f| f.contains("2 pixels")));
        assert!(Point { non_finite: 1, ..fine.clone() }.fault().is_some());
        // A comparison without pixels is no fault.
        assert_eq!(Point { error: f64::NAN, ..fine }.fault(), None);
    }
}
