//! Assignment of the points of a cloud to the levels of an octree.
//!
//! A node's cube is divided into 128³ cells. In each cell, the point nearest to the middle is selected for the node's
//! level and represents all points of the cell. A cell that contains a point selected at a coarser level gets no other.
//! Points that aren't selected go to finer levels. A node with few points contains all of them.

use super::octants::{VoxelKey, cell};
use std::collections::HashSet;
use std::ops::Range;

/// Number of cells along the side of a node's cube, as a power of two: 2⁷ = 128.
pub(super) const CELL_BITS: u32 = 7;
/// Largest number of points of an octant that isn't divided further: a single node contains all of them. Octants with
/// more points also aren't divided where [`CELL_BITS`] or fewer bits per axis of the Morton codes remain.
pub(super) const LEAF_POINTS: u64 = 40_000;
/// Marker for a point that has no level yet.
const NONE: u8 = u8::MAX;

/// A point's Morton code, of [`Part::bits`] bits per axis, and the point's index.
pub(super) type Coded = (u64, u32);

/// Position in the octree of a part of the cloud. The points of a part are assigned to levels in one call of
/// [`levels`].
pub(super) struct Part {
    /// Bits per axis of a Morton code.
    pub(super) bits: u32,
    /// Level of the octant that encloses all points of the part.
    pub(super) depth: u32,
    /// Level of the coarsest enclosing octant with at most [`LEAF_POINTS`] points, which isn't divided; `None` if there
    /// is none. Points not selected at a coarser level get this level.
    pub(super) leaf_at: Option<u32>,
}

/// Assigns a level to each of the points, which are sorted by Morton code, and returns the levels. `stands` receives
/// the index of each selected point, and the range of points that it represents. `taken` contains the level and Morton
/// code of each cell that is larger than the part and for which a point is already selected. This call adds the cells
/// of its own selected points.
pub(super) fn levels(
    points: &[Coded],
    part: &Part,
    taken: &mut HashSet<VoxelKey>,
    stands: &mut dyn FnMut(usize, Range<usize>),
) -> Vec<u8> {
    let mut level_of = vec![NONE; points.len()];
    let mut choose = |range: Range<usize>, level: u32, level_of: &mut [u8]| {
        let free_bits = part.bits - CELL_BITS - level;
        let mut start = range.start;
        for group in points[range].chunk_by(|a, b| a.0 >> (3 * free_bits) == b.0 >> (3 * free_bits)) {
            let members = start..start + group.len();
            start = members.end;
            if level_of[members.clone()].iter().any(|l| *l != NONE) {
                continue;
            }
            if level + CELL_BITS < part.depth && !taken.insert(VoxelKey { level, code: group[0].0 >> (3 * free_bits) })
            {
                continue;
            }
            let from_middle = |code: u64| {
                let side = 1_i64 << free_bits;
                cell(code).map(|c| (2 * (i64::from(c) & (side - 1)) + 1 - side).pow(2)).iter().sum::<i64>()
            };
            let nearest = members.clone().min_by_key(|i| from_middle(points[*i].0));
            if let Some(nearest) = nearest {
                level_of[nearest] = level as u8;
                stands(nearest, members);
            }
        }
    };
    let give = |range: Range<usize>, level: u32, level_of: &mut [u8]| {
        level_of[range].iter_mut().filter(|l| **l == NONE).for_each(|l| *l = level as u8);
    };
    let all = 0..points.len();
    for level in 0..part.depth {
        if part.leaf_at == Some(level) {
            give(all, level, &mut level_of);
            return level_of;
        }
        choose(all.clone(), level, &mut level_of);
    }
    let mut open = vec![(all, part.depth)];
    while let Some((range, level)) = open.pop() {
        if range.len() as u64 <= LEAF_POINTS || level + CELL_BITS >= part.bits {
            give(range, level, &mut level_of);
            continue;
        }
        choose(range.clone(), level, &mut level_of);
        let octant = 3 * (part.bits - level - 1);
        let mut start = range.start;
        for child in points[range].chunk_by(|a, b| a.0 >> octant == b.0 >> octant) {
            open.push((start..start + child.len(), level + 1));
            start += child.len();
        }
    }
    level_of
}

#[cfg(test)]
mod tests {
    use super::super::octants::code;
    use super::*;

    fn plane() -> Vec<Coded> {
        let mut points = Vec::new();
        for y in 0..512_u32 {
            for x in 0..512_u32 {
                points.push((code([x * 4 + 1, y * 4 + 2, 700]), y * 512 + x));
            }
        }
        points.sort_unstable();
        points
    }

    #[test]
    fn levels_have_one_point_a_cell_and_stand_for_the_others() {
        let points = plane();
        let part = Part { bits: 11, depth: 0, leaf_at: None };
        let mut stood = 0;
        let levels = levels(&points, &part, &mut HashSet::new(), &mut |_, group| stood += group.len());
        // The root has a point for each of 128 × 128 cells, and each represents 4 × 4 points.
        assert_eq!(levels.iter().filter(|l| **l == 0).count(), 128 * 128);
        let mut cells: Vec<u64> =
            points.iter().zip(&levels).filter(|(_, l)| **l == 0).map(|(p, _)| p.0 >> (3 * 4)).collect();
        cells.dedup();
        assert_eq!(cells.len(), 128 * 128);
        // On the next level, whose octants have 65,536 points, three of four cells are free.
        assert_eq!(levels.iter().filter(|l| **l == 1).count(), 256 * 256 - 128 * 128);
        assert!(stood >= 512 * 512 && levels.iter().all(|l| *l <= 2));
    }

    #[test]
    fn cloud_cut_into_octants_has_the_same_levels() {
        let points = plane();
        let whole = levels(&points, &Part { bits: 11, depth: 0, leaf_at: None }, &mut HashSet::new(), &mut |_, _| ());
        let mut cut = Vec::new();
        for octant in points.chunk_by(|a, b| a.0 >> 30 == b.0 >> 30) {
            let part = Part { bits: 11, depth: 1, leaf_at: None };
            cut.extend(levels(octant, &part, &mut HashSet::new(), &mut |_, _| ()));
        }
        assert_eq!(whole, cut);
    }

    #[test]
    fn cell_larger_than_a_part_has_one_point_of_all_its_parts() {
        let points: Vec<Coded> = (0..100_000_u32).map(|i| (u64::from(i) << 10, i)).collect();
        let (mut taken, mut parts, mut roots) = (HashSet::new(), 0, 0);
        for part in points.chunk_by(|a, b| a.0 >> 24 == b.0 >> 24) {
            // Octants of level 8 in a tree of 16 bits: eight of them form one cell of the root.
            let of = Part { bits: 16, depth: 8, leaf_at: None };
            parts += 1;
            roots += levels(part, &of, &mut taken, &mut |_, _| ()).iter().filter(|l| **l == 0).count();
        }
        assert_eq!((parts, roots), (7, 1));
    }

    #[test]
    fn equal_points_end_in_one_node() {
        let points: Vec<Coded> = (0..90_000).map(|i| (77, i)).collect();
        let levels = levels(&points, &Part { bits: 12, depth: 0, leaf_at: None }, &mut HashSet::new(), &mut |_, _| ());
        assert_eq!((levels[0], levels.iter().filter(|l| **l == 5).count()), (0, 89_999));
    }
}
