//! Limits of a conversion, which follow from the memory that it may use. A *grid cell* is the unit in which points are
//! sorted on disk ([`Grid`](super::grid::Grid)). A *part* is a subtree of the octree that is built in memory.

/// Memory per point of a part, in bytes, including the point's normal and radius.
const HELD_POINT_BYTES: u64 = 160;
/// Memory of a conversion apart from its points, in bytes.
const OTHER_BYTES: u64 = 64 << 20;
/// Record size, in bytes, that [`HELD_POINT_BYTES`] includes.
const USUAL_POINT_BYTES: u64 = 64;
/// Minimum memory of a conversion, in bytes: the memory of one part.
pub const MIN_MEMORY: u64 = 200 << 20;

/// Limits on the points per grid cell, per part, in memory, and between two saved states.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    /// Approximate number of points in a grid cell if the points are on a surface. The size of cells is selected for
    /// it.
    pub(super) cell_points: u64,
    /// Maximum number of grid cells.
    pub(super) most_cells: usize,
    /// Maximum number of points of a part; a part whose points no subdivision separates may have more, up to
    /// `most_in_place`.
    pub(super) most_points: u64,
    /// Maximum number of points of all parts in memory together; a single larger part is still built.
    pub(super) held_points: u64,
    /// Maximum number of points in about one place, which no subdivision separates; more are an error, as they wouldn't
    /// fit into memory.
    pub(super) most_in_place: u64,
    /// Number of bytes of sorted points after which the state is synced to disk, if the conversion can be resumed.
    pub(super) kept_bytes: u64,
}

impl Limits {
    /// Returns the limits that fit into `memory` bytes; less than [`MIN_MEMORY`] gives the same limits as
    /// [`MIN_MEMORY`]. Memory decides how many parts are built at once, and how many points may be in one place, but
    /// not the output.
    pub(super) fn new(memory: u64) -> Self {
        let (cell_points, most_points) = (1_000_000, 1_000_000);
        let useful = cell_points * rayon::current_num_threads() as u64;
        let room = memory.saturating_sub(OTHER_BYTES) / HELD_POINT_BYTES;
        let held_points = room.min(useful).max(most_points);
        Self {
            cell_points,
            most_cells: 1 << 18,
            most_points,
            held_points,
            most_in_place: room.max(most_points),
            kept_bytes: 256 << 20,
        }
    }

    /// Scales the limits to records of `bytes` bytes: fewer points fit if records are larger than usual.
    pub(super) fn of_points(self, bytes: u64) -> Self {
        let fewer = |points: u64| match bytes {
            0..=USUAL_POINT_BYTES => points,
            _ => points.saturating_mul(HELD_POINT_BYTES) / (HELD_POINT_BYTES - USUAL_POINT_BYTES + bytes),
        };
        let Self { most_points, held_points, most_in_place, .. } = self;
        let [most_points, held_points, most_in_place] =
            [most_points, held_points, most_in_place].map(|n| fewer(n).max(1));
        Self { most_points, held_points, most_in_place, ..self }
    }
}
