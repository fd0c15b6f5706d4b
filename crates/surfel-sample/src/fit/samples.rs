//! Samples of a surface with their target values, sorted into grid cells.

use super::kernels::Kernels;
use crate::mesh::count::stratified;
use crate::mesh::geometry::Geometry;
use crate::parallel::{for_chunks, map_each};
use crate::progress::NoProgress;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use surfel_model::SplatCloud;

/// Smallest and largest number of samples of a mesh per splat. With fewer samples, the result of the fit depends on
/// chance; more samples than texels only repeat each other.
const SAMPLES_PER_SPLAT: [f64; 2] = [9.0, 36.0];
/// Total number of samples above which the number per splat is reduced toward its minimum ([`SAMPLES_PER_SPLAT`]). A
/// sample needs 32 to 44 bytes.
const MANY: f64 = 16e6;
/// Smallest mean number of samples per triangle, if there are at least as many splats as triangles. With fewer splats,
/// the number is reduced in proportion.
const SAMPLES_PER_TRIANGLE: f64 = 4.0;
/// Number of texels per sample above which a sample's value is the mean of nine places around it.
const FINE: f64 = 1.5;
/// Maximum number of grid cells along the largest side of the samples' bounds, so that the three coordinates of a cell
/// fit 64 bits.
const MAX_CELLS: f64 = (1 << 20) as f64;

/// Place on a surface, with the value that the blend of splats should have there, and the place's weight in the fit.
#[derive(Clone, Copy)]
pub(super) struct Sample<const N: usize> {
    /// Position of the place, relative to [`Samples::center`].
    at: Vec3,
    /// Index of the normal in [`Samples::normals`], which is also the index of the face or point.
    normal: u32,
    pub(super) weight: f32,
    pub(super) value: [f32; N],
}

impl<const N: usize> Default for Sample<N> {
    fn default() -> Self {
        Self { at: Vec3::ZERO, normal: 0, weight: 0.0, value: [0.0; N] }
    }
}

/// Samples of a surface, sorted by grid cell.
pub(super) struct Samples<const N: usize> {
    center: DVec3,
    normals: Vec<DVec3>,
    items: Vec<Sample<N>>,
    /// End of each cell's samples, as an index in `items`.
    ends: Vec<u32>,
}

/// Packs the coordinates of a cell into 21 bits each.
fn key(cell: [i64; 3]) -> u64 {
    cell.iter().fold(0, |key, c| key << 21 | (c + (1 << 20)) as u64 & 0x1f_ffff)
}

impl<const N: usize> Samples<N> {
    /// Sorts samples into cells that only a few splats reach. Samples of one cell stay in the order of `items`.
    fn sorted(center: DVec3, normals: Vec<DVec3>, mut items: Vec<Sample<N>>, kernels: &Kernels) -> Self {
        let extent = items.iter().map(|s| s.at.abs().max_element()).fold(0.0, f32::max);
        let side = (1.5 * kernels.median_radius()).max(2.0 * f64::from(extent) / MAX_CELLS).max(f64::MIN_POSITIVE);
        let key_of = |s: &Sample<N>| key(s.at.to_array().map(|c| (f64::from(c) / side).floor() as i64));
        items.par_sort_by_cached_key(key_of);
        let keys = map_each(items.len(), &NoProgress, || (), |(), i| key_of(&items[i]));
        let mut end = 0;
        let end_of = |cell: &[u64]| {
            end += cell.len() as u32;
            end
        };
        let ends = keys.chunk_by(|a, b| a == b).map(end_of).collect();
        Self { center, normals, items, ends }
    }

    /// Samples the points of a cloud themselves. `value` maps a point's index to its value; points with `None` are
    /// skipped.
    pub(super) fn of_points(cloud: &SplatCloud, kernels: &Kernels, value: &dyn Fn(usize) -> Option<[f32; N]>) -> Self {
        let position = |i: usize| cloud.data().centers.get(i);
        let center = middle((0..cloud.len()).map(position));
        let normals = (0..cloud.len()).map(|i| cloud.normal(i)).collect();
        let sample = |i: usize| {
            let value = value(i)?;
            Some(Sample { at: (position(i) - center).as_vec3(), normal: i as u32, weight: 1.0, value })
        };
        Self::sorted(center, normals, (0..cloud.len()).filter_map(sample).collect(), kernels)
    }

    /// Samples a mesh as densely as its texels require, weighted by area and opacity. `value` maps a face, barycentric
    /// coordinates and the side of the square that a sample stands for to a value and an opacity. A side of 0 is a
    /// point sample. `offset` is the vector from the mesh's origin to the cloud's.
    pub(super) fn of_mesh(
        geometry: &Geometry,
        offset: DVec3,
        kernels: &Kernels,
        value: &(dyn Fn(usize, [f64; 3], f64) -> ([f32; N], f32) + Sync),
    ) -> Self {
        let measure = Measure::new(geometry, kernels.len());
        let center = middle(geometry.positions.iter().copied());
        let places = stratified(&measure.samples, measure.count, measure.total, &NoProgress);
        let mut items = vec![Sample::default(); places.len()];
        for_chunks(&mut items, 4096, &|first, items| {
            for (item, (face, b)) in items.iter_mut().zip(&places[first..]) {
                let f = *face as usize;
                let area = geometry.areas[f] / measure.samples[f] * measure.total / measure.count as f64;
                let [p, q, r] = geometry.corners(f);
                let point = p + (q - p) * b[1] + (r - p) * b[2];
                let (value, opacity) = value(f, *b, if measure.coarse[f] { area.sqrt() } else { 0.0 });
                *item = Sample {
                    at: (point - center).as_vec3(),
                    normal: *face,
                    weight: (area / measure.mean_area) as f32 * opacity,
                    value,
                };
            }
        });
        Self::sorted(center - offset, geometry.normals.clone(), items, kernels)
    }

    pub(super) fn len(&self) -> usize {
        self.items.len()
    }

    pub(super) fn point(&self, sample: &Sample<N>) -> DVec3 {
        self.center + sample.at.as_dvec3()
    }

    pub(super) fn normal(&self, sample: &Sample<N>) -> DVec3 {
        self.normals[sample.normal as usize]
    }

    /// Returns the source of a sample: the index of the point for [`Self::of_points`], or of the face for
    /// [`Self::of_mesh`].
    pub(super) fn source(&self, sample: &Sample<N>) -> usize {
        sample.normal as usize
    }

    /// Returns all samples.
    pub(super) fn all(&self) -> &[Sample<N>] {
        &self.items
    }

    /// Returns the number of cells.
    pub(super) fn cells(&self) -> usize {
        self.ends.len()
    }

    /// Returns the samples of a cell, which are contiguous.
    pub(super) fn of_cell(&self, cell: usize) -> &[Sample<N>] {
        let start = if cell == 0 { 0 } else { self.ends[cell - 1] };
        &self.items[start as usize..self.ends[cell] as usize]
    }
}

/// Returns the centre of the points' bounding box.
fn middle(points: impl Iterator<Item = DVec3>) -> DVec3 {
    let (lo, hi) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)));
    if lo.is_finite() { 0.5 * lo + 0.5 * hi } else { DVec3::ZERO }
}

/// Sampling plan of a mesh: the number of samples of each triangle.
struct Measure {
    /// Number of samples per triangle, not rounded; 0 for triangles without area.
    samples: Vec<f64>,
    total: f64,
    count: usize,
    /// Flag per triangle, true if each of its samples represents several texels and is averaged.
    coarse: Vec<bool>,
    /// Mean area of the surface per splat.
    mean_area: f64,
}

impl Measure {
    fn new(geometry: &Geometry, splats: usize) -> Self {
        let (faces, area) = (geometry.areas.len(), geometry.total_area());
        let mean_area = area / splats.max(1) as f64;
        let a_triangle = SAMPLES_PER_TRIANGLE * (splats as f64 / faces.max(1) as f64).min(1.0);
        let texels = map_each(faces, &NoProgress, || (), |(), face| geometry.texels(face));
        let samples_at = |most: f64, face: usize| {
            let splats = geometry.areas[face] / mean_area;
            let wanted = texels[face].clamp(SAMPLES_PER_SPLAT[0] * splats, most * splats).max(a_triangle);
            if geometry.areas[face] > 0.0 { wanted } else { 0.0 }
        };
        let total_at = |most: f64| (0..faces).map(|face| samples_at(most, face)).sum::<f64>();
        let mut most = SAMPLES_PER_SPLAT[1];
        while most > SAMPLES_PER_SPLAT[0] && total_at(most) > MANY {
            most = (0.7 * most).max(SAMPLES_PER_SPLAT[0]);
        }
        let samples: Vec<f64> = (0..faces).map(|face| samples_at(most, face)).collect();
        let total: f64 = samples.iter().sum();
        let coarse = samples.iter().zip(&texels).map(|(s, t)| *t > FINE * s).collect();
        Self { samples, total, count: total.ceil().max(1.0) as usize, coarse, mean_area }
    }
}
