//! Cost of each plane of an image compared with colour alone, and errors of planes against the reference and the ideal
//! image.

use std::sync::Arc;

use crate::page::Table;
use glam::DVec3;
use surfel_model::{Geometry, OnInvalid};
use surfel_model::{Scene, Settings, SplatCloud};
use surfel_render::{Frame, Planes, Renderer, View};

use super::costs;
use super::features::{Case, gaussians};
use super::measure::{Backends, angle_deg, median, relative_depth};
use super::subjects::{self, IdealImage};
use super::truth::Truth;
use crate::Failure;

/// Plane to be measured, with its bytes per pixel and its error measures.
struct Plane {
    name: &'static str,
    planes: Planes,
    bytes: usize,
    /// Description of the error measure.
    error: &'static str,
    /// Function that measures the error between two frames in the pixels of a mask.
    between: fn(&Frame, &Frame, &[bool]) -> f64,
    /// Function that measures the error against the closed form of the sphere; `None` if the plane has no closed form.
    truth: Option<fn(&Frame, &Truth) -> Option<f64>>,
    /// True if the plane is measured in the scene of trained Gaussians; false for the scene of surface splats.
    of_gaussians: bool,
}

/// Returns the largest value of `error` over the pixels of a mask; 0 for an empty mask.
fn largest(mask: &[bool], error: impl Fn(usize) -> f64) -> f64 {
    (0..mask.len()).filter(|&i| mask[i]).map(error).fold(0.0, f64::max)
}

/// Returns |a − b| relative to |b|; 0 if both are equal, even infinite.
fn relative(a: f32, b: f32) -> f64 {
    if a == b { 0.0 } else { f64::from((a - b) / b).abs() }
}

/// Returns the fraction of the mask's pixels in which two planes differ.
fn differ(a: &[u32], b: &[u32], mask: &[bool]) -> f64 {
    let count = mask.iter().filter(|m| **m).count().max(1);
    (0..mask.len()).filter(|&i| mask[i] && a[i] != b[i]).count() as f64 / count as f64
}

fn vector(v: [f64; 3]) -> DVec3 {
    DVec3::from(v)
}

fn all() -> Vec<Plane> {
    let plane = |name, planes, bytes, error, between| Plane {
        name,
        planes,
        bytes,
        error,
        between,
        truth: None,
        of_gaussians: false,
    };
    let color = Planes::COLOR;
    let of_gaussians = |plane: Plane| Plane { of_gaussians: true, ..plane };
    vec![
        plane("color", color, 16, "largest difference", |a, b, mask| {
            largest(mask, |i| (0..4).map(|k| f64::from((a.color()[i][k] - b.color()[i][k]).abs())).fold(0.0, f64::max))
        }),
        plane("color in 8 bits", Planes::RGBA8, 4, "largest difference, steps", |a, b, mask| {
            let step =
                |i: usize| (0..4).map(|k| f64::from(a.rgba8()[i][k].abs_diff(b.rgba8()[i][k]))).fold(0.0, f64::max);
            largest(mask, step)
        }),
        Plane {
            truth: Some(|frame, truth| relative_depth(frame.depth(), truth)),
            ..plane("Z", color.with_depth(true), 4, "relative", |a, b, mask| {
                largest(mask, |i| relative(a.depth()[i], b.depth()[i]))
            })
        },
        Plane {
            truth: Some(|frame, truth| angle_deg(frame.normal(), truth)),
            ..plane("normal", color.with_normal(true), 12, "degrees", |a, b, mask| {
                let of = |frame: &Frame, i: usize| vector(frame.normal()[i].map(f64::from));
                largest(mask, |i| {
                    let (a, b) = (of(a, i), of(b, i));
                    a.cross(b).length().atan2(a.dot(b)).to_degrees()
                })
            })
        },
        plane("weight", color.with_weight(true), 4, "relative", |a, b, mask| {
            largest(mask, |i| relative(a.weight()[i], b.weight()[i]))
        }),
        Plane {
            truth: Some(sphere_distance),
            ..plane("position", color.with_position(true), 24, "of the radius", |a, b, mask| {
                let apart = |i: usize| (vector(a.position()[i]) - vector(b.position()[i])).length();
                largest(mask, |i| Some(apart(i)).filter(|d| d.is_finite()).unwrap_or(0.0))
            })
        },
        plane("index, object", color.with_index(true), 8, "share of pixels, with ties", |a, b, mask| {
            differ(a.index(), b.index(), mask)
        }),
        plane("label", color.with_label(true), 4, "share of pixels, with ties", |a, b, mask| {
            differ(a.label(), b.label(), mask)
        }),
        of_gaussians(plane("color", color, 16, "largest difference", |a, b, mask| {
            largest(mask, |i| (0..4).map(|k| f64::from((a.color()[i][k] - b.color()[i][k]).abs())).fold(0.0, f64::max))
        })),
        of_gaussians(plane("alpha", color.with_alpha(true), 4, "largest difference", |a, b, mask| {
            largest(mask, |i| f64::from((a.alpha()[i] - b.alpha()[i]).abs()))
        })),
        of_gaussians(plane("median_depth", color.with_median_depth(true), 4, "relative", |a, b, mask| {
            largest(mask, |i| relative(a.median_depth()[i], b.median_depth()[i]))
        })),
        of_gaussians(plane("distortion", color.with_distortion(true), 4, "largest difference", |a, b, mask| {
            largest(mask, |i| f64::from((a.distortion()[i] - b.distortion()[i]).abs()))
        })),
    ]
}

/// Returns the RMS distance of positions from the unit sphere, in the pixels where the sphere is visible.
fn sphere_distance(frame: &Frame, truth: &Truth) -> Option<f64> {
    let there = frame.position().iter().zip(&truth.depth).filter(|(p, z)| z.is_finite() && p[0].is_finite());
    let (sum, n) = there.fold((0.0, 0.0), |(s, n), (p, _)| (s + (vector(*p).length() - 1.0).powi(2), n + 1.0));
    (n > 0.0).then(|| (sum / n).sqrt())
}

/// Measures a frame with each plane, and a frame with colour alone for comparison.
pub(crate) fn table(backends: &mut Backends, runs: usize, size: u32) -> Result<Table, Failure> {
    let mut ball = subjects::ball(size)?;
    for object in &mut ball.scene.objects {
        if let Geometry::Splats(cloud) = &object.geometry {
            let mut data = (**cloud).clone().into_data();
            super::features::rows(&mut data);
            object.geometry = Geometry::Splats(Arc::new(SplatCloud::new(data, OnInvalid::Refuse)?.0));
        }
    }
    let IdealImage::Surface(truth) = &ball.truth else { return Err("the ball has no closed form".into()) };
    let view = View::new(&ball.camera)?;
    let gaussians = gaussians()?;
    let settings = Settings::default();
    let all = all();
    let scene = |plane: &Plane| if plane.of_gaussians { gaussians.clone() } else { ball.scene.clone() };
    let cases: Vec<Case> = all
        .iter()
        .map(|plane| Case { planes: plane.planes, ..Case::new(plane.name, scene(plane), settings) })
        .collect();
    let measured = costs::measure(backends, &cases, &view, runs)?;
    let mut table = Table::new(&[
        "plane",
        "of",
        "bytes a pixel",
        "over color alone",
        "error is",
        "from the reference",
        "from the truth",
    ]);
    let mut alone = [None; 2];
    for ((plane, case), measured) in all.iter().zip(&cases).zip(&measured) {
        let ms = median(&measured.ms);
        let base = &mut alone[usize::from(plane.of_gaussians)];
        *base = base.or(ms);
        let [from_reference, from_truth] = errors(backends, plane, &case.scene, &view, truth)?;
        let dash = || "-".to_owned();
        let number = |error: Option<f64>| {
            error.map_or_else(dash, |e| if e == 0.0 { "0".to_owned() } else { format!("{e:.1e}") })
        };
        table.rows.push(vec![
            plane.name.to_owned(),
            if plane.of_gaussians { "Gaussians" } else { "splats" }.to_owned(),
            plane.bytes.to_string(),
            ms.zip(*base).map_or_else(|| "not drawn".to_owned(), |(ms, base)| format!("{:.2}×", ms / base)),
            plane.error.to_owned(),
            number(from_reference),
            number(from_truth),
        ]);
    }
    Ok(table)
}

/// Returns the largest error of a plane outside of decision margins, and its error against the sphere. The first is
/// `None` if the backend doesn't draw the plane, the second also if the plane has no closed form.
fn errors(
    backends: &mut Backends,
    plane: &Plane,
    scene: &Scene,
    view: &View,
    truth: &Truth,
) -> Result<[Option<f64>; 2], Failure> {
    let settings = Settings::default();
    let (mut got, mut want) = (Frame::default(), Frame::default());
    let uploaded = backends.wide.upload(scene)?;
    if backends.wide.render_into(&uploaded, view, &settings, plane.planes, &mut got).is_err() {
        return Ok([None; 2]);
    }
    let uploaded = backends.reference.upload(scene)?;
    backends.reference.render_into(&uploaded, view, &settings, plane.planes.with_margin(true), &mut want)?;
    let mask: Vec<bool> = want.margin().iter().map(|&m| m == 0.0).collect();
    Ok([Some((plane.between)(&got, &want, &mask)), plane.truth.and_then(|of| of(&got, truth))])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_planes_are_of_the_pixels_that_count() {
        assert_eq!(differ(&[1, 2, 3, 4], &[1, 5, 3, 0], &[true, true, true, false]), 1.0 / 3.0);
        assert_eq!(largest(&[true, false, true], |i| [0.1, 9.0, 0.3][i]), 0.3);
        assert_eq!((relative(f32::INFINITY, f32::INFINITY), relative(2.5, 2.0)), (0.0, 0.25));
    }

    #[test]
    fn each_plane_has_a_row() {
        let has = |wanted: fn(&Planes) -> bool| all().iter().any(|plane| wanted(&plane.planes));
        for wanted in [
            (|p| p.color) as fn(&Planes) -> bool,
            |p| p.rgba8,
            |p| p.depth,
            |p| p.normal,
            |p| p.weight,
            |p| p.index,
            |p| p.label,
            |p| p.position,
            |p| p.alpha,
            |p| p.median_depth,
            |p| p.distortion,
        ] {
            assert!(has(wanted));
        }
    }
}
