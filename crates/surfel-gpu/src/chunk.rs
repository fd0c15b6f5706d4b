//! Splats in an order in which neighbours lie together, cut into chunks that f32 offsets describe well.

use glam::DVec3;
use surfel_model::SplatCloud;
use surfel_shaders::layout;

/// Largest extent of a chunk in radii of its smallest splat. An offset within it is rounded to 512·2⁻²⁴ = 3e-5 of a radius,
/// which moves a weight by 7e-5 (2.4 times as much at cutoff 2). Neighbours on a surface are far below it; splats of very
/// different size, and strays, get chunks of their own.
const MAX_EXTENT_RADII: f64 = 512.0;

/// Up to 256 splats that lie close together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chunk {
    /// Object-space origin of the centres.
    pub origin: DVec3,
    /// Radius about `origin` of a ball that holds the splats (not only their centres), object units.
    pub ball: f64,
    /// The largest splat's larger half-axis, object units.
    pub largest_radius: f64,
    /// First splat, counted within the segment.
    pub first: u32,
    /// Number of splats.
    pub count: u32,
}

impl Chunk {
    /// The chunk of these splats, which come `first` in their segment.
    pub(crate) fn new(cloud: &SplatCloud, members: &[u32], first: u32) -> Self {
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &i in members {
            let p = cloud.center(i as usize);
            (min, max) = (min.min(p), max.max(p));
        }
        let origin = 0.5 * (min + max);
        let mut chunk = Self { origin, ball: 0.0, largest_radius: 0.0, first, count: members.len() as u32 };
        for &i in members {
            let radius = cloud.radius_max(i as usize);
            chunk.largest_radius = chunk.largest_radius.max(radius);
            chunk.ball = chunk.ball.max((cloud.center(i as usize) - origin).length() + radius);
        }
        chunk
    }
}

/// How many of the splats, in order, make the next chunk.
pub(crate) fn chunk_length(cloud: &SplatCloud, order: &[u32]) -> usize {
    let most = layout::CHUNK_SPLATS as usize;
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let mut smallest = f64::INFINITY;
    for (count, &i) in order.iter().take(most).enumerate() {
        let p = cloud.center(i as usize);
        (min, max) = (min.min(p), max.max(p));
        smallest = smallest.min(cloud.radius_max(i as usize));
        if count > 0 && (max - min).max_element() > MAX_EXTENT_RADII * smallest {
            return count;
        }
    }
    order.len().min(most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use surfel_model::{CloudData, Column3, OnInvalid, Shape};

    fn cloud(centers: Vec<Vec3>, radii: Vec<f32>) -> SplatCloud {
        let normals = Column3::from_f32(vec![Vec3::Z; centers.len()]);
        let data = CloudData::new(DVec3::ZERO, Column3::from_f32(centers), Shape::Disks { normals, radii });
        SplatCloud::new(data, OnInvalid::Refuse).unwrap().0
    }

    #[test]
    fn a_chunk_ends_before_a_splat_far_away_or_much_smaller() {
        let far = cloud(vec![Vec3::ZERO, Vec3::X, Vec3::X * 600.0], vec![1.0; 3]);
        assert_eq!(chunk_length(&far, &[0, 1, 2]), 2);
        let small = cloud(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![1.0, 1.0, 1e-4]);
        assert_eq!(chunk_length(&small, &[0, 1, 2]), 2);
        let chunk = Chunk::new(&far, &[0, 1], 7);
        assert_eq!((chunk.origin, chunk.ball, chunk.first, chunk.count), (DVec3::X * 0.5, 1.5, 7, 2));
    }
}
