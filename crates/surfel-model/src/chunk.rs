//! Chunks of neighbouring splats, and the reference values relative to which their numbers are stored in 16 bits. All
//! backends use the same chunks, so that they store the same numbers.

use crate::{ClipPolicy, SplatCloud};
use glam::{DVec3, Vec3};
#[cfg(feature = "rayon")]
use rayon::prelude::*;
use surfel_math::V3;
use surfel_math::basis::{principal_axes, unit};
use surfel_math::quantise::{folded, quantised, unfolded};

/// Precision in which splats are stored in memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Storage {
    /// Single precision.
    #[default]
    F32,
    /// 16 bits for centres, colours, normals and disks' radii. Half-axes of ellipses remain f32: a needle's shorter
    /// axis would vanish next to its neighbours' longer axes. Alphas remain f32 too, because 1 must be exact.
    ///
    /// A centre moves by at most 1.5e-5 of its chunk's half extent, a colour by 1.5e-5 of the chunk's largest colour
    /// component, and a normal by 1e-4. A radius changes by at most 1.5e-5 of the chunk's largest radius, which is at
    /// most sixteen times the smallest.
    Quantised,
}

/// Maximum number of splats in a chunk.
pub const CHUNK_SPLATS: usize = 256;

/// Largest side of the bounds of a chunk's centres, in radii of the chunk's smallest splat. A splat that would exceed
/// it begins the next chunk.
///
/// An offset within the chunk is rounded to 512·2⁻²⁴ = 3e-5 of a radius. The rounding changes a splat's weight by at
/// most 7e-5 (2.4 times the offset's error at cutoff 2). Neighbours on a surface are far below the limit. Isolated
/// splats and splats of very different size get chunks of their own.
const MAX_EXTENT_RADII: f64 = 512.0;

/// Maximum number of chunks cut at once, per thread. The limit keeps the chunks' data in cache until they are stored.
const MAX_CHUNKS_AHEAD: usize = 16;

/// Largest ratio of the largest to the smallest radius in a chunk with 16-bit storage. It limits the rounding errors of
/// small radii. A splat that would exceed it begins the next chunk.
const MAX_RADII: f64 = 16.0;

/// Reference values of a chunk, relative to which the numbers of its splats are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChunkSpace {
    /// Origin of the stored centres: the centre of the centres' bounds, in object space.
    pub origin: DVec3,
    /// Largest absolute coordinate of a centre relative to `origin`, in object units. Centres are stored as multiples
    /// of it.
    pub center: f32,
    /// Largest linear colour component of the chunk's splats, of which colours are stored as fractions; 0 if they have
    /// no colours.
    pub color: f32,
    /// Largest radius of the chunk's splats, in object units, of which radii are stored as fractions.
    pub radius: f32,
}

impl ChunkSpace {
    /// Computes the reference values of a chunk with the splats `members`, which are indices into the cloud.
    pub fn of(cloud: &SplatCloud, members: &[u32]) -> Self {
        let centers = members.iter().map(|&i| cloud.center(i as usize));
        let (min, max) = centers.clone().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let origin = 0.5 * (min + max);
        let color =
            |&i: &u32| cloud.data().colors.as_ref().map_or(0.0, |_| Vec3::from(cloud.color(i as usize)).max_element());
        Self {
            origin,
            center: centers.fold(0.0, |a, p| a.max((p - origin).as_vec3().abs().max_element())),
            color: members.iter().map(color).fold(0.0, f32::max),
            radius: members.iter().map(|&i| cloud.radius_max(i as usize) as f32).fold(0.0, f32::max),
        }
    }
}

/// Cuts splats into chunks of at most [`CHUNK_SPLATS`]. `order` has the splats' indices; neighbours in it must be close
/// together in space. Returns each chunk's reference values and splats.
pub fn chunks<'a>(
    cloud: &'a SplatCloud,
    order: &'a [u32],
    storage: Storage,
) -> impl Iterator<Item = (ChunkSpace, &'a [u32])> {
    let chunk = move |rest: &'a [u32]| {
        let members = &rest[..chunk_length(cloud, rest, storage)];
        (ChunkSpace::of(cloud, members), members)
    };
    #[cfg(feature = "rayon")]
    let most_ahead = MAX_CHUNKS_AHEAD * rayon::current_num_threads();
    #[cfg(not(feature = "rayon"))]
    let most_ahead = MAX_CHUNKS_AHEAD;
    let (mut rest, mut ahead) = (order, 1);
    let batch = move || {
        // A chunk's start depends on the chunks before it. Most chunks are full, so several are cut at once as if all
        // were full; those after a shorter chunk are cut again.
        let starts: Vec<&[u32]> = (0..rest.len()).step_by(CHUNK_SPLATS).take(ahead).map(|at| &rest[at..]).collect();
        #[cfg(feature = "rayon")]
        let mut found: Vec<_> = starts.into_par_iter().map(chunk).collect();
        #[cfg(not(feature = "rayon"))]
        let mut found: Vec<_> = starts.into_iter().map(chunk).collect();
        let full = found.iter().take_while(|(_, members)| members.len() == CHUNK_SPLATS).count();
        ahead = if full + 1 < found.len() { full + 1 } else { (2 * ahead).min(most_ahead) };
        found.truncate(full + 1);
        rest = &rest[found.iter().map(|(_, members)| members.len()).sum()..];
        (!found.is_empty()).then_some(found)
    };
    std::iter::from_fn(batch).flatten()
}

/// Returns the number of splats, from the first of `order` on, that form the next chunk.
fn chunk_length(cloud: &SplatCloud, order: &[u32], storage: Storage) -> usize {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (mut smallest, mut largest) = (f64::INFINITY, 0.0f64);
    for (count, &i) in order.iter().take(CHUNK_SPLATS).enumerate() {
        let p = cloud.center(i as usize);
        (min, max) = (min.min(p), max.max(p));
        let radius = cloud.radius_max(i as usize);
        (smallest, largest) = (smallest.min(radius), largest.max(radius));
        let uneven = storage == Storage::Quantised && largest > MAX_RADII * smallest;
        if count > 0 && (uneven || (max - min).max_element() > MAX_EXTENT_RADII * smallest) {
            return count;
        }
    }
    order.len().min(CHUNK_SPLATS)
}

/// Absolute cosine of the angle between half-axes (that of 60° and 120°) above which [`stored_axes`] replaces them by
/// the principal axes.
const SKEW: f64 = 0.5;

/// Returns the half-axes of splat `i` as they are stored in f32, in object units.
///
/// Half-axes at an angle of less than 60° or more than 120° are replaced by the ellipse's principal axes. Otherwise the
/// coordinates in the splat would be a small difference of large numbers, and lose their precision in f32. Clipped
/// splats retain their half-axes, because clips are relative to them.
pub fn stored_axes(cloud: &SplatCloud, i: usize) -> (Vec3, Vec3) {
    let (s, t) = cloud.axes(i);
    let is_clipped = || cloud.data().clips.as_ref().is_some_and(|c| c.clip(i, ClipPolicy::Exact).is_some());
    let (a, b) = (unit(s), unit(t));
    let (s, t) = if a.dot(b).abs() > SKEW && !is_clipped() { principal_axes(s, t) } else { (s, t) };
    (s.as_vec3(), t.as_vec3())
}

/// A splat with the precision of its storage. It is used for the few splats that are set up one by one in f64, such as
/// those across the near plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StoredSplat {
    /// Centre in object space.
    pub center: DVec3,
    /// Half-axes in object space.
    pub axes: (DVec3, DVec3),
    /// Outward normal in object space, of any length.
    pub normal: DVec3,
    /// Shading normal in object space, of any length.
    pub shading_normal: DVec3,
    /// Linear RGB albedo.
    pub color: [f32; 3],
}

impl StoredSplat {
    /// Returns splat `i` as stored in a chunk.
    pub fn of(cloud: &SplatCloud, i: usize, space: &ChunkSpace, storage: Storage) -> Self {
        let exact = Self {
            center: cloud.center(i),
            axes: cloud.axes(i),
            normal: cloud.normal(i),
            shading_normal: cloud.shading_normal(i),
            color: cloud.color(i),
        };
        if storage == Storage::F32 {
            return exact;
        }
        let offset = (exact.center - space.origin).as_vec3().to_array().map(|c| quantised(c, space.center));
        let direction = |v: DVec3| {
            let [x, y] = folded(V3::new(v.x as f32, v.y as f32, v.z as f32)).map(|c| f64::from(quantised(c, 1.0)));
            let v = unfolded(x, y);
            DVec3::new(v.x, v.y, v.z).normalize()
        };
        let mut stored = Self { center: space.origin + Vec3::from(offset).as_dvec3(), ..exact };
        if matches!(cloud.data().shape, crate::Shape::Disks { .. }) {
            stored.normal = direction(exact.normal);
            let (s, t) = surfel_math::basis::orthonormal(stored.normal);
            let radius = f64::from(quantised(cloud.radius_max(i) as f32, space.radius));
            stored.axes = (s * radius, t * radius);
        }
        stored.shading_normal = match cloud.data().shading_normals {
            Some(_) => direction(exact.shading_normal),
            None => stored.normal,
        };
        if cloud.data().colors.is_some() {
            stored.color = exact.color.map(|c| quantised(c, space.color));
        }
        stored
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ClipColumns, ClipLine, CloudData, Column3, NO_LINE, OnInvalid, Shape};

    fn cloud(centers: Vec<Vec3>, radii: Vec<f32>) -> SplatCloud {
        let normals = Column3::from_f32(vec![Vec3::new(0.36, 0.48, 0.8); centers.len()]);
        let data = CloudData::new(DVec3::ZERO, Column3::from_f32(centers), Shape::Disks { normals, radii });
        SplatCloud::new(data, OnInvalid::Refuse).unwrap().0
    }

    fn lengths(cloud: &SplatCloud, storage: Storage) -> Vec<usize> {
        let order: Vec<u32> = (0..cloud.len() as u32).collect();
        chunks(cloud, &order, storage).map(|(_, members)| members.len()).collect()
    }

    #[test]
    fn chunk_ends_before_a_splat_far_away_or_much_smaller() {
        let far = cloud(vec![Vec3::ZERO, Vec3::X, Vec3::X * 600.0], vec![1.0; 3]);
        assert_eq!(lengths(&far, Storage::F32), [2, 1]);
        let small = cloud(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![1.0, 1.0, 1e-4]);
        assert_eq!(lengths(&small, Storage::F32), [2, 1]);
        let uneven = cloud(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![1.0, 1.0, 0.05]);
        assert_eq!((lengths(&uneven, Storage::F32), lengths(&uneven, Storage::Quantised)), (vec![3], vec![2, 1]));
        let space = ChunkSpace::of(&far, &[0, 1]);
        assert_eq!(space, ChunkSpace { origin: DVec3::X * 0.5, center: 0.5, color: 0.0, radius: 1.0 });
        assert!(lengths(&cloud(Vec::new(), Vec::new()), Storage::F32).is_empty());
    }

    #[test]
    fn chunks_cut_at_once_are_those_cut_one_by_one() {
        // Jumps of 600 radii at various distances, with full chunks in between.
        let jumps = [1, 700, 701, 956, 4000, 4300, 9000];
        let before = |i: usize| jumps.iter().filter(|jump| **jump <= i).count() as f32;
        let centers = (0..12_000).map(|i| Vec3::new(600.0 * before(i), 0.01 * i as f32, 0.0)).collect();
        let cloud = cloud(centers, vec![1.0; 12_000]);
        let order: Vec<u32> = (0..12_000).collect();
        let (mut rest, mut expected) = (&order[..], Vec::new());
        while !rest.is_empty() {
            expected.push(chunk_length(&cloud, rest, Storage::F32));
            rest = &rest[expected[expected.len() - 1]..];
        }
        assert_eq!(lengths(&cloud, Storage::F32), expected);
        assert!(expected.starts_with(&[1, 256, 256, 187, 1, 255]), "{:?}", &expected[..6]);
    }

    #[test]
    fn chunk_stores_principal_axes_of_skewed_ellipses_and_others_as_they_are() {
        let skewed = (Vec3::X, Vec3::new(1.5, 1e-3, 0.0));
        let (s, t): (Vec<Vec3>, Vec<Vec3>) = [skewed, (Vec3::X, Vec3::new(0.1, 0.5, 0.0))].into_iter().unzip();
        let shape = Shape::Ellipses { s: Column3::from_f32(s), t: Column3::from_f32(t) };
        let data = CloudData::new(DVec3::ZERO, Column3::from_f32(vec![Vec3::ZERO; 2]), shape);
        let both = |data| SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
        let (a, b) = stored_axes(&both(data.clone()), 0);
        assert!((a.normalize().dot(b.normalize())).abs() < 1e-6 && (a.cross(b).z - 1e-3).abs() < 1e-9, "{a} {b}");
        assert_eq!(stored_axes(&both(data.clone()), 1), (Vec3::X, Vec3::new(0.1, 0.5, 0.0)));
        let line = ClipLine { a: 1.0, b: 0.0, c: 0.5 };
        let lines = Some(vec![[line, NO_LINE, NO_LINE, NO_LINE]; 2]);
        let clips = Some(ClipColumns { curves: None, lines, modes: None });
        assert_eq!(stored_axes(&both(CloudData { clips, ..data }), 0), skewed);
    }

    #[test]
    fn chunk_holds_splats_to_the_bounds_of_16_bits() {
        let one = cloud(vec![Vec3::ZERO, Vec3::new(7.0, -3.1, 1.3)], vec![0.3, 1.1]);
        let space = ChunkSpace::of(&one, &[0, 1]);
        let exact = StoredSplat::of(&one, 0, &space, Storage::F32);
        assert_eq!((exact.center, exact.axes), (one.center(0), one.axes(0)));
        let stored = StoredSplat::of(&one, 0, &space, Storage::Quantised);
        let moved = (stored.center - exact.center).abs().max_element();
        assert!(moved > 0.0 && moved <= 1.6e-5 * 3.5, "{moved}");
        assert!((stored.normal - exact.normal).length() < 1e-4);
        let radius = stored.axes.0.length();
        assert!(radius != 0.3 && (radius - 0.3).abs() < 1.6e-5 * 1.1, "{radius}");
        assert_eq!(stored.color, [1.0; 3]);
    }
}
