//! A given number of samples, spread evenly over the surface.

use super::MeshReport;
use super::eliminate::eliminate;
use super::features::Features;
use super::geometry::Geometry;
use super::random::Random;
use crate::neighbours::{Neighbours, map_each};
use crate::radii::Spacing;
use crate::tree::KdTree;
use crate::{Progress, SampleError, assemble, radii};
use glam::DVec3;
use surfel_math::basis::unit;
use surfel_model::{CloudData, Mesh, Shape};

/// Candidates a sample for elimination. Three cost half of Yuksel's five; the least distance falls by a tenth.
const OVERSAMPLING: usize = 3;
/// Above this many samples, stratification is all there is: elimination takes seconds a million.
const MOST_ELIMINATED: usize = 1_000_000;
/// Cosine of 20°: a disk tilted more than that against its face no longer covers its share of it, and stands out
/// of the surface.
const MOST_TILTED: f64 = 0.939_692_620_785_908;

/// A place on the surface.
#[derive(Clone, Copy)]
struct Sample {
    face: u32,
    barycentric: [f64; 3],
}

pub(crate) fn splats(
    mesh: &Mesh,
    count: usize,
    radius_scale: f64,
    report: &mut MeshReport,
    progress: &dyn Progress,
) -> Result<CloudData, SampleError> {
    splats_and_faces(mesh, count, radius_scale, report, progress).map(|(data, _)| data)
}

/// The same, with the triangle that each splat lies on.
pub(crate) fn splats_and_faces(
    mesh: &Mesh,
    count: usize,
    radius_scale: f64,
    report: &mut MeshReport,
    progress: &dyn Progress,
) -> Result<(CloudData, Vec<u32>), SampleError> {
    if count == 0 {
        return Err(SampleError::option("the number of splats", count, "at least 1"));
    }
    SampleError::check_count("splats", count)?;
    let geometry = Geometry::new(mesh);
    report.degenerate = geometry.degenerate();
    let area = geometry.total_area();
    if area <= 0.0 || !area.is_finite() {
        return Err(SampleError::NoArea { triangles: mesh.triangles.len() });
    }
    let (corner_normals, features) = geometry.smooth();
    report.feature_edges = features.len();

    let samples = spread(&geometry, count, area, progress);
    let positions: Vec<DVec3> = samples.iter().map(|s| place(&geometry, s)).collect();
    let smooth: Vec<DVec3> = samples
        .iter()
        .map(|s| {
            let (face, b) = (s.face as usize, s.barycentric);
            let sum: DVec3 = corner_normals[face].iter().zip(b).map(|(n, b)| *n * b).sum();
            if sum.length() > 1e-6 { unit(sum) } else { geometry.normals[face] }
        })
        .collect();
    drop(corner_normals);
    let planes: Vec<DVec3> =
        samples.iter().zip(&smooth).map(|(s, n)| plane_normal(geometry.normals[s.face as usize], *n)).collect();

    let spacing = (area / count as f64).sqrt();
    let mut radii = if count > MOST_ELIMINATED {
        measured_radii(&positions, &planes, spacing, progress)?
    } else {
        // Blue noise of known density: gaps of more than a spacing don't occur, and the density rule covers 1.65.
        vec![radii::DENSITY * spacing; count]
    };
    radii.iter_mut().for_each(|r| *r *= radius_scale);
    let shape = shape(&positions, &planes, &radii, &features, radii::DENSITY * spacing * radius_scale, progress);
    let mut data = CloudData::new(mesh.origin, super::centers(mesh, &positions), shape);
    if planes != smooth {
        data.shading_normals = Some(assemble::normals32(&smooth));
    }
    let rgba = geometry.is_painted().then(|| {
        map_each(
            samples.len(),
            &crate::NoProgress,
            || (),
            |(), i| geometry.color(samples[i].face as usize, samples[i].barycentric),
        )
    });
    (data.colors, data.alphas) = assemble::paint(rgba);
    Ok((data, samples.iter().map(|s| s.face).collect()))
}

/// Normal of a disk on a face: the smooth one, unless that leans too far.
pub(crate) fn plane_normal(face: DVec3, smooth: DVec3) -> DVec3 {
    if face.dot(smooth) >= MOST_TILTED { smooth } else { face }
}

/// Radii that cover the gaps that stratified samples leave.
fn measured_radii(
    positions: &[DVec3],
    planes: &[DVec3],
    spacing: f64,
    progress: &dyn Progress,
) -> Result<Vec<f64>, SampleError> {
    let cloud = Neighbours::new(positions, 16, progress)?;
    let normals: Vec<DVec3> = cloud.first_of.iter().map(|i| planes[*i as usize]).collect();
    let sizes = radii::sizes(&cloud, &normals, Spacing::Known(spacing / cloud.scale), false, progress);
    Ok(cloud.slot_of.iter().map(|s| sizes.radii[*s as usize] * cloud.scale).collect())
}

/// Disks, or ellipses where the surface has features to trim them to.
fn shape(
    positions: &[DVec3],
    planes: &[DVec3],
    radii: &[f64],
    features: &[[DVec3; 2]],
    typical: f64,
    progress: &dyn Progress,
) -> Shape {
    let disks = || Shape::Disks {
        normals: assemble::normals32(planes),
        radii: radii.iter().map(|r| assemble::radius32(*r)).collect(),
    };
    if features.is_empty() {
        return disks();
    }
    let features = Features::new(features, typical, 4 * positions.len() + features.len());
    progress.stage("creases", positions.len() as u64);
    let trimmed = map_each(positions.len(), progress, || (), |(), i| features.trim(positions[i], planes[i], radii[i]));
    if trimmed.iter().all(Option::is_none) {
        return disks();
    }
    let axes = trimmed.into_iter().zip(planes).zip(radii).map(|((axes, normal), radius)| {
        axes.unwrap_or_else(|| {
            let (u, v) = surfel_math::basis::orthonormal(*normal);
            (u * *radius, v * *radius)
        })
    });
    assemble::ellipses(&axes.collect::<Vec<_>>())
}

fn place(geometry: &Geometry, sample: &Sample) -> DVec3 {
    let [a, b, c] = geometry.corners(sample.face as usize);
    // From a corner: a triangle far from the origin keeps its shape.
    a + (b - a) * sample.barycentric[1] + (c - a) * sample.barycentric[2]
}

/// `count` samples.
fn spread(geometry: &Geometry, count: usize, area: f64, progress: &dyn Progress) -> Vec<Sample> {
    if count > MOST_ELIMINATED {
        return stratified(geometry, count, area, progress);
    }
    let samples = stratified(geometry, count * OVERSAMPLING, area, progress);
    let positions: Vec<DVec3> = samples.iter().map(|s| place(geometry, s)).collect();
    let normals: Vec<DVec3> = samples.iter().map(|s| geometry.normals[s.face as usize]).collect();
    let tree = KdTree::new(&positions);
    let left = eliminate(&tree, &normals, count, area, progress);
    left.into_iter().map(|slot| samples[tree.index(slot as usize)]).collect()
}

/// Samples stratified by area along the order of the triangles, and by the low-discrepancy sequence R₂ (Roberts 2018,
/// frac(½ + i/g), frac(½ + i/g²), g³ = g + 1) within each triangle.
fn stratified(geometry: &Geometry, count: usize, area: f64, progress: &dyn Progress) -> Vec<Sample> {
    const STEPS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];
    progress.stage("samples", count as u64);
    let mut sum = 0.0;
    let ends: Vec<f64> = geometry
        .areas
        .iter()
        .map(|a| {
            sum += a;
            sum
        })
        .collect();
    let last = geometry.areas.iter().rposition(|a| *a > 0.0).unwrap_or(0);
    map_each(
        count,
        progress,
        || (),
        |(), i| {
            let target = (i as f64 + Random::new(i as u64).unit()) / count as f64 * area;
            // Rounding may lead past the end; faces without area end where they begin and are never met.
            let face = ends.partition_point(|end| *end <= target).min(last);
            let [mut a, mut b] = STEPS.map(|step| (0.5 + i as f64 * step).fract());
            if a + b > 1.0 {
                (a, b) = (1.0 - a, 1.0 - b);
            }
            Sample { face: face as u32, barycentric: [1.0 - a - b, a, b] }
        },
    )
}
