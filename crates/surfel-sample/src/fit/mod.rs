//! Texture acquisition (Z01 §5): fits the colours and normals of splats so that their blend equals the surface's
//! values.
//!
//! The blend at a place is Σ r̂_k·c_k, where c_k is the colour (or normal) of splat k, and r̂_k = w_k/Σw its normalised
//! weight in a close view. The fit minimises ∫ (f − Σ r̂_k·c_k)² over the surface, where f is the surface's colour,
//! with colours bounded. Z01 eq. 11 has w in place of r̂, and no bounds: its solutions leave [0, 1]
//! (docs/decisions/020).

mod kernels;
mod points;
mod samples;
mod solve;
mod system;
#[cfg(test)]
mod tests;

use crate::mesh::geometry::Geometry;
use crate::{Progress, SampleError};
use glam::DVec3;
use kernels::Kernels;
use samples::Samples;
use solve::{Bounds, Problem, Stop};
use surfel_math::basis::unit;
use surfel_model::{Column3, Mesh, OnInvalid, SplatCloud, TextureSampling};
use system::System;

pub use points::{PointFitReport, fit_point_colors};

/// Stop criterion for fits of colours: no step changes a colour by 1e-4, a fortieth of an 8-bit step. A fit ends after
/// 400 steps at the latest.
const STOP: Stop = Stop { residual: 1e-4, steps: 400 };

/// Largest change of a component of a shading normal by the fit. If the mesh's normals vary faster than its splats can
/// represent, an unbounded solution overshoots.
const NORMAL_CHANGE: f64 = 0.25;

/// Largest overshoot of a splat's colour beyond the colours under the splat, relative to the range of these colours.
/// Sharp peaks need a quarter to a third. Without this bound, fits ripple in uniform areas some splats away from an
/// edge.
const BEYOND: f64 = 0.35;
/// Smallest range of a channel's values under a splat at which the channel limits the overshoot ([`BEYOND`]): a quarter
/// of 1/255 of linear light.
const MIN_VARIATION: f64 = 1e-3;
/// Stop criterion for fits of normals: no step turns a normal by a thirtieth of a degree. A fit ends after 100 steps at
/// the latest.
const NORMAL_STOP: Stop = Stop { residual: 5e-4, steps: 100 };
/// Smallest error of blended normals at which they are fitted, as root mean square of their components: half a degree.
const MIN_NORMAL_ERROR: f64 = 0.005;

/// Maximum number of splats in one fit; each needs about a kilobyte.
const MAX_SPLATS: usize = 1 << 25;
/// Largest mean number of splats that overlap at a place of the surface; with more, fits fail. The work grows with its
/// square; splats with radii of twice the spacing have 13.
const MAX_MEAN_OVERLAP: usize = 200;
/// Number of places at which overlapping splats are counted to check [`MAX_MEAN_OVERLAP`].
const PROBES: usize = 1024;

/// Report of a fit to a mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FitReport {
    /// Number of sample points on the mesh's surface.
    pub samples: usize,
    /// Number of solver steps for the colours; 0 for [`TextureSampling::Ewa`], and if only normals are fitted.
    pub steps: usize,
    /// Residual of the solution for the colours, by its optimality (KKT) conditions: the largest change of a linear
    /// colour value by one further step. 0 where [`Self::steps`] is.
    pub residual: f64,
    /// Root mean square errors of the blend's colours in linear light, over surface and channels: before and after the
    /// fit. Zeros if colours weren't fitted.
    pub color_rms: [f64; 2],
    /// Root mean square errors of the components of blended shading normals, before and after the fit; `None` unless
    /// normals were to be fitted. Normals stay unchanged if the first value is at most 0.005.
    pub normal_rms: Option<[f64; 2]>,
}

/// Fits the colours of splats made from a mesh, so that their blend shows the mesh's colours. With
/// [`TextureSampling::Fit`], shading normals are fitted too. The cloud's present values must be point samples;
/// [`TextureSampling::Point`] returns the cloud unchanged. Alphas never change. Colours change only if the mesh has
/// colours, alphas or textures and the cloud has colours, and normals only if the cloud has shading normals.
///
/// Splats blend at places inside their clips where their normals and the surface's agree within 60°. Colours are
/// limited to the range 0 to 1, extended to the smallest and largest value of mesh and cloud, and to the neighbourhood
/// of the colours under the splat. Splats that cover no part of the mesh don't change. A surface of one colour gets
/// exactly this colour. The result doesn't depend on the number of threads.
///
/// Source: Z01 §5 (texture acquisition), with normalised weights in place of weights, and with bounds.
///
/// # Errors
/// [`SampleError::Model`] for an invalid mesh, [`SampleError::Empty`] for a mesh without triangles, and
/// [`SampleError::NoArea`] if no triangle has an area. [`SampleError::TooMany`] above 33 million splats, or if more
/// than 200 splats overlap at a place on average.
pub fn fit_to_mesh(
    cloud: SplatCloud,
    mesh: &Mesh,
    sampling: TextureSampling,
    progress: &dyn Progress,
) -> Result<(SplatCloud, FitReport), SampleError> {
    mesh.validate()?;
    SampleError::check_count("triangles", mesh.triangles.len())?;
    if mesh.triangles.is_empty() {
        return Err(SampleError::Empty { what: "mesh", missing: "triangles" });
    }
    let geometry = Geometry::new(mesh);
    let area = geometry.total_area();
    if area <= 0.0 || !area.is_finite() {
        return Err(SampleError::NoArea { triangles: mesh.triangles.len() });
    }
    let painted = geometry.is_painted() && cloud.data().colors.is_some();
    let shaded = cloud.data().shading_normals.is_some() && sampling == TextureSampling::Fit;
    if sampling == TextureSampling::Point || !(painted || shaded) || cloud.is_empty() {
        return Ok((cloud, FitReport::default()));
    }
    check_splats(cloud.len())?;
    let target = Target { geometry: &geometry, cloud: &cloud, sampling, progress };
    let color = |face: usize, b: [f64; 3], side: f64| {
        let [r, g, b, a] = if side > 0.0 { geometry.color_about(face, b, side) } else { geometry.color(face, b) };
        ([r, g, b], a)
    };
    let corners = if shaded { geometry.smooth().corner_normals } else { Vec::new() };
    let normal = |face: usize, b: [f64; 3], side: f64| {
        let sum: DVec3 = corners[face].iter().zip(b).map(|(n, b)| *n * b).sum();
        geometry.mapped_normal(face, b, unit(sum), side).as_vec3().to_array()
    };
    let own = |i: usize| cloud.shading_normal(i).as_vec3().to_array();
    let (colors, normals, report) = if painted && shaded {
        let value = |face: usize, b: [f64; 3], side: f64| {
            let (c, a) = color(face, b, side);
            (joined(c, normal(face, b, side)), a)
        };
        let (values, report) = target.fit(3, &value, &|i| joined(cloud.color(i), own(i)))?;
        (Some(part(&values, 0)), Some(part(&values, 3)), report)
    } else if painted {
        let (values, report) = target.fit(3, &color, &|i| cloud.color(i))?;
        (Some(values), None, report)
    } else {
        let (values, report) = target.fit(0, &|face, b, side| (normal(face, b, side), 1.0), &own)?;
        (None, Some(values), report)
    };
    let mut data = cloud.into_data();
    if let Some(colors) = colors {
        data.colors = Some(colors);
    }
    if let Some(normals) = normals {
        let unit32 = |n: &[f32; 3]| unit(DVec3::from(n.map(f64::from))).as_vec3();
        data.shading_normals = Some(Column3::from_f32(normals.iter().map(unit32).collect()));
    }
    Ok((SplatCloud::new(data, OnInvalid::Refuse)?.0, report))
}

fn joined(a: [f32; 3], b: [f32; 3]) -> [f32; 6] {
    [a[0], a[1], a[2], b[0], b[1], b[2]]
}

/// Returns three of the six channels of each value, from channel `first` on.
fn part(values: &[[f32; 6]], first: usize) -> Vec<[f32; 3]> {
    values.iter().map(|v| std::array::from_fn(|c| v[first + c])).collect()
}

/// Mesh, cloud and settings that the fits of colours and of normals share.
struct Target<'a> {
    geometry: &'a Geometry<'a>,
    cloud: &'a SplatCloud,
    sampling: TextureSampling,
    progress: &'a dyn Progress,
}

impl Target<'_> {
    /// Fits the values of all splats, and returns them by splat index, with a report. The first `colors` channels are
    /// bounded as colours, the others as normals. `value` maps a face, barycentric coordinates and the side of a square
    /// to the surface's mean value and opacity there. `present` returns the present value of a splat.
    fn fit<const N: usize>(
        &self,
        colors: usize,
        value: &(dyn Fn(usize, [f64; 3], f64) -> ([f32; N], f32) + Sync),
        present: &dyn Fn(usize) -> [f32; N],
    ) -> Result<(Vec<[f32; N]>, FitReport), SampleError> {
        let kernels = Kernels::new(self.cloud);
        let offset = self.cloud.data().origin - self.geometry.mesh.origin;
        let samples = Samples::of_mesh(self.geometry, offset, &kernels, value);
        check_overlap(&kernels, &samples)?;
        let present: Vec<[f32; N]> = (0..kernels.len()).map(|slot| present(kernels.tree.index(slot))).collect();
        let system = System::new(&kernels, &samples, &present, self.progress);
        let mut report = FitReport { samples: samples.len(), ..FitReport::default() };
        let range = ranges(samples.all().iter().map(|s| &s.value).chain(&present));
        drop(samples);
        let mut values = present.clone();
        let before = system.rms();
        let mean = |rms: &[f64]| (rms.iter().map(|r| r * r).sum::<f64>() / rms.len().max(1) as f64).sqrt();
        if colors > 0 {
            let d = if self.sampling == TextureSampling::Ewa {
                system.ewa.iter().map(|d| std::array::from_fn(|c| if c < colors { d[c] as f32 } else { 0.0 })).collect()
            } else {
                let bounds = |k: usize| within(&range, &system.local[k], &present[k]);
                let problem = Problem { gram: &system.gram, b: &system.lanes(0), bounds: &bounds };
                let solution = problem.minimise(STOP, &mut |_| true);
                (report.steps, report.residual) = (solution.steps, solution.residual);
                solution.d
            };
            report.color_rms = [mean(&before[..colors]), mean(&system.rms_after(0, &d)[..colors])];
            for (value, d) in values.iter_mut().zip(&d) {
                let bounded = |c: usize| (value[c] + d[c]).clamp(range[c][0] as f32, range[c][1] as f32);
                let bounded: [f32; 3] = std::array::from_fn(bounded);
                value[..3].copy_from_slice(&bounded);
            }
        }
        if colors < N {
            let off = mean(&before[colors..]);
            let mut after = off;
            if off > MIN_NORMAL_ERROR {
                let bounds = |_: usize| [[-NORMAL_CHANGE, NORMAL_CHANGE]; 4];
                let problem = Problem { gram: &system.gram, b: &system.lanes(colors), bounds: &bounds };
                let solution = problem.minimise(NORMAL_STOP, &mut |_| true);
                after = mean(&system.rms_after(colors, &solution.d));
                for (value, d) in values.iter_mut().zip(&solution.d) {
                    value[colors..].iter_mut().zip(d).for_each(|(value, d): (&mut f32, &f32)| *value += d);
                }
            }
            report.normal_rms = Some([off, after]);
        }
        let mut by_index = vec![[0.0; N]; values.len()];
        values.into_iter().enumerate().for_each(|(slot, value)| by_index[kernels.tree.index(slot)] = value);
        Ok((by_index, report))
    }
}

/// Returns [`SampleError::TooMany`] if so many splats overlap ([`MAX_MEAN_OVERLAP`]) that the normal equations would
/// not be sparse.
fn check_overlap<const N: usize>(kernels: &Kernels, samples: &Samples<N>) -> Result<(), SampleError> {
    let probes = samples.all().iter().step_by(samples.len().div_ceil(PROBES).max(1));
    let (mut found, mut count) = (0, 0);
    for sample in probes {
        (found, count) = (found + kernels.near(samples.point(sample), 0.0).len(), count + 1);
    }
    let (found, limit) = (found / count.max(1), MAX_MEAN_OVERLAP);
    let what = "splats over each other, whose colours are to be fitted,";
    if found > limit { Err(SampleError::TooMany { what, found, limit }) } else { Ok(()) }
}

fn check_splats(found: usize) -> Result<(), SampleError> {
    let (what, limit) = ("splats to be fitted", MAX_SPLATS);
    if found > limit { Err(SampleError::TooMany { what, found, limit }) } else { Ok(()) }
}

/// Returns the range of each of the first three channels: 0 to 1, extended to the smallest and largest value.
fn ranges<'a, const N: usize>(values: impl Iterator<Item = &'a [f32; N]>) -> Bounds {
    let mut range = [[0.0f64, 1.0]; 4];
    for value in values {
        for (range, v) in range.iter_mut().zip(&value[..N.min(3)]) {
            *range = [range[0].min(f64::from(*v)), range[1].max(f64::from(*v))];
        }
    }
    range
}

/// Returns the bounds for the change of a splat's present value. The changed value stays in `range`, and close to the
/// range `local` of the samples under the splat; no change is always allowed. All varying channels may overshoot by the
/// same fraction of their variation, because a channel limited on its own would change the hue.
fn within<const N: usize>(range: &Bounds, local: &[[f32; 2]; N], present: &[f32; N]) -> Bounds {
    let local = |c: usize| local[c].map(f64::from);
    let varies = (0..N.min(3)).filter(|&c| local(c)[1] - local(c)[0] > MIN_VARIATION);
    let (mut below, mut above) = (BEYOND, BEYOND);
    for c in varies {
        let ([least, largest], [low, high]) = (local(c), range[c]);
        let span = largest - least;
        (below, above) = (below.min((least - low) / span), above.min((high - largest) / span));
    }
    std::array::from_fn(|c| {
        if c >= N.min(3) {
            return [0.0; 2];
        }
        let ([least, largest], present) = (local(c), f64::from(present[c]));
        let span = (largest - least).max(0.0);
        let low = range[c][0].max(least - below * span).min(present);
        let high = range[c][1].min(largest + above * span).max(present);
        if least <= largest { [low - present, high - present] } else { [0.0; 2] }
    })
}
