//! Splats that lie together, as culling sees them.

use surfel_model::SplatCloud;
use surfel_render::{CHUNK_SPLATS, ChunkSpace};
use surfel_shaders::layout;

const _: () = assert!(CHUNK_SPLATS == layout::CHUNK_SPLATS as usize, "shaders count the splats of a chunk, too");

/// Up to 256 splats that lie close together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chunk {
    /// Object-space origin of the centres, and what their numbers are relative to.
    pub space: ChunkSpace,
    /// Radius about the origin of a ball that holds the splats (not only their centres), object units.
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
    pub(crate) fn new(cloud: &SplatCloud, members: &[u32], space: ChunkSpace, first: u32) -> Self {
        let mut chunk = Self { space, ball: 0.0, largest_radius: 0.0, first, count: members.len() as u32 };
        for &i in members {
            let radius = cloud.radius_max(i as usize);
            chunk.largest_radius = chunk.largest_radius.max(radius);
            chunk.ball = chunk.ball.max((cloud.center(i as usize) - space.origin).length() + radius);
        }
        // Stored centres and radii are rounded, by 16 bits to 1e-4 of the ball at most.
        let rounded = 1.0 + 1e-4;
        Self { ball: chunk.ball * rounded, largest_radius: chunk.largest_radius * rounded, ..chunk }
    }
}
