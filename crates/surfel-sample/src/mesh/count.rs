//! A given number of samples, spread evenly over the surface.

use super::borders::{Borders, Kind};
use super::eliminate::eliminate;
use super::gaps;
use super::geometry::{Geometry, SAME_NORMAL, Smooth};
use super::options::MeshReport;
use super::placed::{Bordered, Placed, Sample};
use super::random::Random;
use super::see_through;
use crate::orient::Oriented;
use crate::parallel::map_each;
use crate::radii::Spacing;
use crate::sorted::SortedPoints;
use crate::tree::KdTree;
use crate::{Progress, SampleError, assemble, radii};
use glam::DVec3;
use surfel_math::basis::unit;
use surfel_model::{CloudData, Mesh};

/// Candidates a sample for elimination. Three cost half of Yuksel's five; the least distance falls by a tenth.
const OVERSAMPLING: usize = 3;
/// Above this many samples, stratification is all there is: elimination takes seconds a million.
const MOST_ELIMINATED: usize = 1_000_000;
/// Cosine of 1°: a sample whose smooth normal is nearer to its facet's lies in a flat part.
const FLAT: f64 = 0.999_847_695;

pub(crate) fn splats(
    mesh: &Mesh,
    count: usize,
    radius_scale: f64,
    report: &mut MeshReport,
    progress: &dyn Progress,
) -> Result<CloudData, SampleError> {
    let whole = |_: u32| false;
    splats_and_faces(mesh, &whole, count, radius_scale, report, progress).map(|(data, _)| data)
}

/// The columns of [`splats`], and the triangle that each splat lies on. `is_cut` says of an open edge, by the corner
/// (3·triangle + 0..3) that it starts at, that the mesh is part of a larger one, which goes on there.
pub(crate) fn splats_and_faces(
    mesh: &Mesh,
    is_cut: &dyn Fn(u32) -> bool,
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
    (report.degenerate, report.repeated) = (geometry.degenerate(), geometry.repeated);
    let area = geometry.total_area();
    if area <= 0.0 || !area.is_finite() {
        return Err(SampleError::NoArea { triangles: mesh.triangles.len() });
    }
    let Smooth { corner_normals, feature_edges, mut borders, regions } = geometry.smooth();
    borders.iter_mut().filter(|b| b.kind == Kind::Open && is_cut(b.corner)).for_each(|b| b.kind = Kind::Cut);
    report.feature_edges = feature_edges;

    let samples = spread(&geometry, count, area, progress);
    let positions: Vec<DVec3> = samples.iter().map(|s| s.place(&geometry)).collect();
    // Geometry alone decides where a splat lies and which side of it is seen.
    let planes: Vec<DVec3> = samples.iter().map(|s| geometry.normals[s.face as usize]).collect();
    let spacing = (area / count as f64).sqrt();
    let mut radii = if count > MOST_ELIMINATED {
        measured_radii(&positions, &planes, spacing, progress)?
    } else {
        // Blue noise of known density: gaps of more than a spacing don't occur, and the density rule covers 1.65.
        vec![radii::DENSITY * spacing; count]
    };
    radii.iter_mut().for_each(|r| *r *= radius_scale);
    let mut on = Placed { samples, positions, planes, radii };
    let borders = Borders::new(&geometry, &borders, &regions, spacing * radius_scale, count);
    let mut kept = on.all_grown(&borders, &regions, progress);
    // Splats that are scaled down leave gaps anyway.
    if count <= MOST_ELIMINATED && radius_scale >= 1.0 {
        gaps::fill(&geometry, &borders, &regions, &mut on, &mut kept);
    }
    let Bordered { shape, clips } = on.bordered(&kept);
    let Placed { samples, positions, planes, .. } = on;
    let smooth: Vec<DVec3> = samples
        .iter()
        .map(|s| {
            let (face, b) = (s.face as usize, s.barycentric);
            let sum: DVec3 = corner_normals[face].iter().zip(b).map(|(n, b)| *n * b).sum();
            if sum.length() > 1e-6 { unit(sum) } else { geometry.normals[face] }
        })
        .collect();
    drop(corner_normals);
    let mut data = CloudData { clips, ..CloudData::new(mesh.origin, assemble::centers(mesh, &positions), shape) };
    let of_facets = planes.iter().zip(&smooth).filter(|(plane, smooth)| plane.dot(**smooth) >= FLAT).count();
    report.flat = 10 * of_facets >= 9 * count;
    let mapped = |i: usize| {
        let sample = &samples[i];
        geometry.mapped_normal(sample.face as usize, sample.barycentric, smooth[i], spacing)
    };
    let smooth = map_each(samples.len(), &crate::NoProgress, || (), |(), i| mapped(i));
    // A flat facet's splats have no other normals than their own.
    if planes.iter().zip(&smooth).any(|(plane, smooth)| plane.dot(*smooth) < SAME_NORMAL) {
        data.shading_normals = Some(assemble::normals32(&smooth));
    }
    let rgba = geometry.is_painted().then(|| {
        map_each(
            samples.len(),
            &crate::NoProgress,
            || (),
            |(), i| geometry.color_about(samples[i].face as usize, samples[i].barycentric, spacing),
        )
    });
    (data.colors, data.alphas) = assemble::paint(rgba);
    Ok(see_through::cut(&geometry, data, samples.iter().map(|s| s.face).collect()))
}

/// Radii that cover the gaps that stratified samples leave.
fn measured_radii(
    positions: &[DVec3],
    planes: &[DVec3],
    spacing: f64,
    progress: &dyn Progress,
) -> Result<Vec<f64>, SampleError> {
    let points = SortedPoints::new(positions.len(), |i| positions[i])?;
    let normal = |slot: usize| planes[points.inputs(slot)[0] as usize].as_vec3();
    let oriented: Vec<Oriented> =
        (0..points.len()).map(|slot| Oriented { normal: normal(slot), farthest2: 0.0 }).collect();
    let sizes = radii::sizes(&points, &oriented, 16, Spacing::Known(spacing / points.step), false, progress);
    Ok(points.slots().iter().map(|s| sizes.radius(*s as usize) * points.step).collect())
}

/// `count` samples.
fn spread(geometry: &Geometry, count: usize, area: f64, progress: &dyn Progress) -> Vec<Sample> {
    if count > MOST_ELIMINATED {
        return stratified(&geometry.areas, count, area, progress).into_iter().map(Sample::from).collect();
    }
    let samples: Vec<Sample> =
        stratified(&geometry.areas, count * OVERSAMPLING, area, progress).into_iter().map(Sample::from).collect();
    let positions: Vec<DVec3> = samples.iter().map(|s| s.place(geometry)).collect();
    let normals: Vec<DVec3> = samples.iter().map(|s| geometry.normals[s.face as usize]).collect();
    let tree = KdTree::new(&positions);
    let left = eliminate(&tree, &normals, count, area, progress);
    left.into_iter().map(|slot| samples[tree.index(slot as usize)]).collect()
}

/// Triangles and barycentric coordinates, stratified by each triangle's share of the sum `total` of `areas` along the
/// order of the triangles, and by the low-discrepancy sequence R₂ (Roberts 2018, frac(½ + i/g), frac(½ + i/g²),
/// g³ = g + 1) within each triangle.
pub(crate) fn stratified(areas: &[f64], count: usize, total: f64, progress: &dyn Progress) -> Vec<(u32, [f64; 3])> {
    const STEPS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];
    progress.stage("samples", count as u64);
    let mut sum = 0.0;
    let ends: Vec<f64> = areas
        .iter()
        .map(|a| {
            sum += a;
            sum
        })
        .collect();
    let last = areas.iter().rposition(|a| *a > 0.0).unwrap_or(0);
    map_each(
        count,
        progress,
        || (),
        |(), i| {
            let target = (i as f64 + Random::new(i as u64).unit()) / count as f64 * total;
            // Rounding may lead past the end; faces without area end where they begin and are never met.
            let face = ends.partition_point(|end| *end <= target).min(last);
            let [mut a, mut b] = STEPS.map(|step| (0.5 + i as f64 * step).fract());
            if a + b > 1.0 {
                (a, b) = (1.0 - a, 1.0 - b);
            }
            (face as u32, [1.0 - a - b, a, b])
        },
    )
}
