//! Chunks of neighbouring splats, with bounds for culling. A *segment* is the part of an object's splats that shares a
//! buffer ([`Segment`](crate::Segment)); it consists of chunks.

use surfel_math::cone::NormalCone;
use surfel_model::SplatCloud;
use surfel_model::{CHUNK_SPLATS, ChunkSpace};
use surfel_shaders::layout;

const _: () = assert!(CHUNK_SPLATS == layout::CHUNK_SPLATS as usize, "shaders count the splats of a chunk, too");

/// Up to 256 neighbouring splats, which are culled together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chunk {
    /// Object-space origin of the centres, and the scales of quantised numbers.
    pub space: ChunkSpace,
    /// Radius of a bounding sphere about the origin of `space`, in object units. It contains whole splats, not only
    /// their centres.
    pub bounding_radius: f64,
    /// Largest semi-axis of all splats, in object units.
    pub largest_radius: f64,
    /// Cone that contains the normals of all splats; `None` if it isn't narrower than a half space.
    pub cone: Option<NormalCone>,
    /// Index of the first splat in the segment.
    pub first: u32,
    /// Number of splats.
    pub count: u32,
}

impl Chunk {
    /// Creates the chunk of the splats `members`, which are indices into the cloud. `first` is the index of the first
    /// member in the segment.
    pub(crate) fn new(cloud: &SplatCloud, members: &[u32], space: ChunkSpace, first: u32) -> Self {
        let cone = NormalCone::about(members.iter().map(|&i| cloud.normal(i as usize)));
        let count = members.len() as u32;
        let mut chunk = Self { space, bounding_radius: 0.0, largest_radius: 0.0, cone, first, count };
        for &i in members {
            let radius = cloud.radius_max(i as usize);
            chunk.largest_radius = chunk.largest_radius.max(radius);
            chunk.bounding_radius =
                chunk.bounding_radius.max((cloud.center(i as usize) - space.origin).length() + radius);
        }
        // Stored centres and radii are rounded: with 16 bits, by at most 1e-4 of the bounding radius.
        let rounded = 1.0 + 1e-4;
        Self {
            bounding_radius: chunk.bounding_radius * rounded,
            largest_radius: chunk.largest_radius * rounded,
            ..chunk
        }
    }
}
