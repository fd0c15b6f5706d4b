//! A given number of samples, spread evenly over the surface.

use super::borders::{Borders, Kind, clip_columns};
use super::eliminate::eliminate;
use super::geometry::{Geometry, SAME_NORMAL, Smooth};
use super::options::MeshReport;
use super::random::Random;
use super::see_through;
use crate::orient::Oriented;
use crate::parallel::map_each;
use crate::radii::Spacing;
use crate::sorted::SortedPoints;
use crate::tree::KdTree;
use crate::{Progress, SampleError, assemble, radii};
use glam::DVec3;
use surfel_math::basis::{orthonormal, unit};
use surfel_model::{ClipColumns, CloudData, Mesh, Shape};

/// Candidates a sample for elimination. Three cost half of Yuksel's five; the least distance falls by a tenth.
const OVERSAMPLING: usize = 3;
/// Above this many samples, stratification is all there is: elimination takes seconds a million.
const MOST_ELIMINATED: usize = 1_000_000;
/// Radii that a splat is tried at, over its own, where lines leave too little of it: what they cut off doesn't grow.
const GROWTH: [f64; 3] = [1.3, 1.7, MOST_GROWN];
/// The largest.
pub(crate) const MOST_GROWN: f64 = 2.2;

/// Cosine of 1°: a sample whose smooth normal is nearer to its facet's lies in a flat part.
const FLAT: f64 = 0.999_847_695;

/// A place on the surface.
#[derive(Clone, Copy, Default)]
struct Sample {
    face: u32,
    barycentric: [f64; 3],
}

impl From<(u32, [f64; 3])> for Sample {
    fn from((face, barycentric): (u32, [f64; 3])) -> Self {
        Self { face, barycentric }
    }
}

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
    let on = Placed { positions: &positions, planes: &planes, radii: &radii };
    let borders = Borders::new(&geometry, &borders, &regions, spacing * radius_scale, count);
    let Bordered { shape, clips } = bordered(&on, &borders, |i| regions[samples[i].face as usize], progress);
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

/// Splats on the surface, before borders cut them.
struct Placed<'a> {
    positions: &'a [DVec3],
    /// Unit normals.
    planes: &'a [DVec3],
    radii: &'a [f64],
}

/// Splats that end at the borders of the surface.
struct Bordered {
    shape: Shape,
    clips: Option<ClipColumns>,
}

/// Disks, or ellipses and the lines that clip them where a border cuts any.
fn bordered(
    on: &Placed,
    borders: &Borders,
    region_of: impl Fn(usize) -> u32 + Sync,
    progress: &dyn Progress,
) -> Bordered {
    let disks = || Bordered {
        shape: Shape::Disks {
            normals: assemble::normals32(on.planes),
            radii: on.radii.iter().map(|r| assemble::radius32(*r)).collect(),
        },
        clips: None,
    };
    let count = on.positions.len();
    if borders.is_empty() {
        return disks();
    }
    progress.stage("borders", count as u64);
    let axes = |i: usize, scale: f64| {
        let (u, v) = orthonormal(on.planes[i]);
        (u * on.radii[i] * scale, v * on.radii[i] * scale)
    };
    let kept = map_each(
        count,
        progress,
        || (),
        |(), i| {
            let at = |scale: f64| borders.keep(on.positions[i], axes(i, scale), region_of(i));
            let (mut scale, mut kept) = (1.0, at(1.0)?);
            for larger in GROWTH {
                if kept.area * scale * scale >= kept.least() {
                    break;
                }
                // It meets every border that a smaller one does.
                (scale, kept) = (larger, at(larger)?);
            }
            kept.widen(kept.least() / (scale * scale));
            Some((scale, kept))
        },
    );
    let clips = clip_columns(kept.iter().map(|kept| kept.as_ref().map(|(_, kept)| kept)));
    if clips.is_none() {
        return disks();
    }
    let scale = |i: usize| kept[i].as_ref().map_or(1.0, |(scale, _)| *scale);
    let shape = assemble::ellipses(&(0..count).map(|i| axes(i, scale(i))).collect::<Vec<_>>());
    Bordered { shape, clips }
}

fn place(geometry: &Geometry, sample: &Sample) -> DVec3 {
    let [a, b, c] = geometry.corners(sample.face as usize);
    // From a corner: a triangle far from the origin keeps its shape.
    a + (b - a) * sample.barycentric[1] + (c - a) * sample.barycentric[2]
}

/// `count` samples.
fn spread(geometry: &Geometry, count: usize, area: f64, progress: &dyn Progress) -> Vec<Sample> {
    if count > MOST_ELIMINATED {
        return stratified(&geometry.areas, count, area, progress).into_iter().map(Sample::from).collect();
    }
    let samples: Vec<Sample> =
        stratified(&geometry.areas, count * OVERSAMPLING, area, progress).into_iter().map(Sample::from).collect();
    let positions: Vec<DVec3> = samples.iter().map(|s| place(geometry, s)).collect();
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
