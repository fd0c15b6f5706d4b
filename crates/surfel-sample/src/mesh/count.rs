//! Sampling of a mesh by a given number of splats at a given density.

use super::borders::Borders;
use super::density::Density;
use super::eliminate::{Candidate, PartFacts, eliminate, reach};
use super::gaps;
use super::geometry::{Geometry, Kind, SAME_NORMAL, Smooth};
use super::options::MeshReport;
use super::parts::Sample;
use super::placed::{ClippedShape, Placed};
use super::scatter::{PartPlace, Scatter, slender};
use super::see_through;
use crate::orient::Oriented;
use crate::parallel::map_each;
use crate::radii::Spacing;
use crate::sorted::SortedPoints;
use crate::tree::{KdTree, Nearest};
use crate::{Progress, SampleError, assemble, radii};
use glam::DVec3;
use surfel_math::basis::unit;
use surfel_model::{CloudData, Mesh};

/// Number of candidates per sample from which elimination starts. Three take half as long as the five that Yuksel uses,
/// and the smallest distance between samples is lower by a tenth.
const OVERSAMPLING: usize = 3;
/// Largest number of samples that are spread as blue noise. More samples are stratified only, because elimination takes
/// seconds per million.
const MAX_ELIMINATED: usize = 1_000_000;
/// Cosine of 1°, the largest angle between a sample's smooth normal and its facet's normal at which the sample counts
/// as flat.
const FLAT: f64 = 0.999_847_695;
/// Number of nearest splats, including the splat itself, of which the largest spacing determines a splat's radius if
/// the density isn't even.
const BESIDE: usize = 7;
/// Largest factor by which a splat's radius grows because of coarser neighbours ([`BESIDE`]).
const MAX_GAP_GROWTH: f64 = 1.2;

/// Makes `count` splats of a mesh, evenly spread. On a partly transparent mesh, some of them are then removed or
/// divided ([`see_through`]).
pub(crate) fn even_splats(
    mesh: &Mesh,
    count: usize,
    radius_scale: f64,
    report: &mut MeshReport,
    progress: &dyn Progress,
) -> Result<CloudData, SampleError> {
    splats_and_faces(mesh, &|_| false, count, radius_scale, report, progress).map(|(data, _)| data)
}

/// Makes evenly spread splats as [`even_splats`] does, and returns the triangle of each splat. The mesh may be part of
/// a larger one. `is_cut` is true for open edges where the larger mesh continues; its argument is the corner
/// (3·triangle + 0..3) at which the edge starts.
pub(crate) fn splats_and_faces(
    mesh: &Mesh,
    is_cut: &dyn Fn(u32) -> bool,
    count: usize,
    radius_scale: f64,
    report: &mut MeshReport,
    progress: &dyn Progress,
) -> Result<(CloudData, Vec<u32>), SampleError> {
    SampleError::check_splats(count)?;
    let geometry = Geometry::new(mesh);
    let area = geometry.total_area();
    if area <= 0.0 || !area.is_finite() {
        return Err(SampleError::NoArea { triangles: mesh.triangles.len() });
    }
    let density = Density::even(&geometry, (area / count as f64).sqrt());
    spread((&geometry, geometry.smooth()), &density, count, is_cut, radius_scale, report, progress)
}

/// Makes `count` splats with a given density; `count` must be the density's number of splats.
pub(crate) fn splats(
    geometry: &Geometry,
    smooth: Smooth,
    density: &Density,
    count: usize,
    radius_scale: f64,
    report: &mut MeshReport,
    progress: &dyn Progress,
) -> Result<CloudData, SampleError> {
    spread((geometry, smooth), density, count, &|_| false, radius_scale, report, progress).map(|(data, _)| data)
}

fn spread(
    (geometry, smooth): (&Geometry, Smooth),
    density: &Density,
    count: usize,
    is_cut: &dyn Fn(u32) -> bool,
    radius_scale: f64,
    report: &mut MeshReport,
    progress: &dyn Progress,
) -> Result<(CloudData, Vec<u32>), SampleError> {
    let mesh = geometry.mesh;
    (report.degenerate, report.repeated) = (geometry.degenerate(), geometry.repeated);
    let Smooth { corner_normals, feature_edges, mut borders, regions } = smooth;
    borders.iter_mut().filter(|b| b.kind == Kind::Open && is_cut(b.corner)).for_each(|b| b.kind = Kind::Cut);
    report.feature_edges = feature_edges;

    let samples = places(geometry, density, count, progress);
    let positions = map_each(samples.len(), &crate::NoProgress, || (), |(), i| samples[i].place(geometry));
    // The position and facing of a splat depend on the geometry alone, not on vertex normals.
    let planes: Vec<DVec3> = samples.iter().map(|s| geometry.normals[s.face as usize]).collect();
    let mut radii = if count > MAX_ELIMINATED {
        measured_radii(&positions, &planes, density.coarsest, progress)?
    } else {
        // In blue noise, gaps are at most one spacing wide, and the density radius of 1.65 spacings covers them.
        reaching(density, &samples, &positions).iter().map(|spacing| radii::DENSITY * spacing).collect()
    };
    radii.iter_mut().for_each(|r| *r *= radius_scale);
    let mut on = Placed { geometry, density, radius_scale, samples, positions, planes, radii };
    let borders = Borders::new(geometry, &borders, &regions, (density, radius_scale), count);
    let mut kept = on.all_grown(&borders, &regions, progress);
    // Splats that are scaled down leave gaps anyway.
    if count <= MAX_ELIMINATED && radius_scale >= 1.0 {
        gaps::fill(&borders, &regions, &mut on, &mut kept);
    }
    let ClippedShape { shape, clips } = on.bordered(&kept);
    let Placed { samples, positions, planes, .. } = on;
    let smooth = |i: usize| {
        let (face, b) = (samples[i].face as usize, samples[i].barycentric);
        let sum: DVec3 = corner_normals[face].iter().zip(b).map(|(n, b)| *n * b).sum();
        if sum.length() > 1e-6 { unit(sum) } else { geometry.normals[face] }
    };
    let smooth = map_each(samples.len(), &crate::NoProgress, || (), |(), i| smooth(i));
    drop(corner_normals);
    let mut data = CloudData { clips, ..CloudData::new(mesh.origin, assemble::centers(mesh, &positions), shape) };
    let of_facets = planes.iter().zip(&smooth).filter(|(plane, smooth)| plane.dot(**smooth) >= FLAT).count();
    report.flat = 10 * of_facets >= 9 * count;
    let mapped = |i: usize| {
        let sample = &samples[i];
        geometry.mapped_normal(sample.face as usize, sample.barycentric, smooth[i], density.at(sample))
    };
    let smooth = map_each(samples.len(), &crate::NoProgress, || (), |(), i| mapped(i));
    // Flat facets need no shading normals.
    if planes.iter().zip(&smooth).any(|(plane, smooth)| plane.dot(*smooth) < SAME_NORMAL) {
        data.shading_normals = Some(assemble::normals32(&smooth));
    }
    let color = |sample: &Sample| geometry.color_about(sample.face as usize, sample.barycentric, density.at(sample));
    let rgba =
        geometry.is_painted().then(|| map_each(samples.len(), &crate::NoProgress, || (), |(), i| color(&samples[i])));
    (data.colors, data.alphas) = assemble::paint(rgba);
    Ok(see_through::cut(geometry, data, samples.iter().map(|s| s.face).collect()))
}

/// Returns the spacing, in object units, by which the radius of each splat is computed. Where the density changes, it
/// is the largest spacing among the splat and its neighbours, so that no gap opens between finer and coarser splats. It
/// is at most [`MAX_GAP_GROWTH`] times the splat's own spacing.
fn reaching(density: &Density, samples: &[Sample], positions: &[DVec3]) -> Vec<f64> {
    if density.is_even() {
        return vec![density.coarsest; samples.len()];
    }
    let own: Vec<f64> = samples.iter().map(|sample| density.at(sample)).collect();
    let tree = KdTree::new(positions);
    map_each(
        samples.len(),
        &crate::NoProgress,
        || Nearest::within(BESIDE, f64::INFINITY),
        |found, i| {
            tree.nearest(positions[i], found);
            let largest = found.items().iter().map(|(_, slot)| own[tree.index(*slot as usize)]).fold(own[i], f64::max);
            largest.min(MAX_GAP_GROWTH * own[i])
        },
    )
}

/// Estimates the radii of stratified samples from their local spacing, so that disks leave no gaps. `spacing` is the
/// mean distance between samples; all lengths are in object units.
fn measured_radii(
    positions: &[DVec3],
    planes: &[DVec3],
    spacing: f64,
    progress: &dyn Progress,
) -> Result<Vec<f64>, SampleError> {
    let points = SortedPoints::new(positions.len(), |i| positions[i])?;
    let normal = |slot: usize| planes[points.inputs(slot)[0] as usize].as_vec3();
    let oriented: Vec<Oriented> = (0..points.len()).map(|slot| Oriented::alone(normal(slot))).collect();
    let sizes = radii::sizes(&points, (&oriented, &[]), 16, Spacing::Known(spacing / points.step), false, progress);
    let step = points.step;
    Ok(points.into_slots().into_iter().map(|slot| sizes.radius(slot as usize) * step).collect())
}

/// Spreads `count` samples over a mesh, as blue noise or, if they are too many for elimination, stratified.
fn places(geometry: &Geometry, density: &Density, count: usize, progress: &dyn Progress) -> Vec<Sample> {
    let splats = density.splats(geometry);
    let (weights, total) =
        if density.is_even() { (&geometry.areas, geometry.total_area()) } else { (&splats, splats.iter().sum()) };
    let parts = density.parts();
    let samples = |places: Vec<PartPlace>| -> Vec<Sample> {
        places.into_iter().map(|(part, b)| parts.place(part as usize, b)).collect()
    };
    if count > MAX_ELIMINATED {
        return samples(Scatter::new(weights, count, total).even(progress));
    }
    let scatter = Scatter::new(weights, count * OVERSAMPLING, total);
    let slender_corners = |part: usize, expected: f64| slender(geometry.corners(parts.face(part)), expected);
    let mut candidates = scatter.irregular(&slender_corners, progress, &|(part, b)| {
        let position = parts.place(part as usize, b).place(geometry);
        Candidate { position, part, number: 0 }
    });
    candidates.iter_mut().zip(0..).for_each(|(candidate, number)| candidate.number = number);
    let even = reach(geometry.total_area(), count as f64);
    let of_part = |part: u32| {
        let part = part as usize;
        let reach = if density.is_even() { even } else { reach(density.of_part(part).powi(2), 1.0) };
        PartFacts { normal: geometry.normals[parts.face(part)], reach }
    };
    let left = eliminate(candidates, &of_part, count, progress);
    samples(scatter.some_irregular(&slender_corners, &left, progress))
}

/// Returns `count` places, each as a triangle and barycentric coordinates, stratified by area ([`Scatter::even`]).
/// `total` is the sum of `areas`.
pub(crate) fn stratified(areas: &[f64], count: usize, total: f64, progress: &dyn Progress) -> Vec<PartPlace> {
    Scatter::new(areas, count, total).even(progress)
}
