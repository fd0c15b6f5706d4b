//! Number of points of a file, and the memory that each needs.

/// Number of points and memory per point, estimated from the start of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointCount {
    /// Number of points; an estimate for text files.
    pub points: u64,
    /// True if points have splat radii, which Surfel adds to LAS files.
    pub has_radii: bool,
    /// True if points have normals, judging from the start of the file.
    pub has_normals: bool,
    /// True if points have colours, or may have them, judging from the start of the file.
    pub has_colors: bool,
    /// Memory in bytes for reading one point: its record in the file or, for LAS, its columns in memory without
    /// colours.
    pub row_bytes: u64,
}
