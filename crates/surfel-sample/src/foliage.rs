//! Splats of points that lie in no surface, such as those of leaves.

use crate::eigen::smallest3;
use crate::nearest::Search;
use crate::normals::{WIDE, covariance, wider};
use crate::orient::{NEAREST, Oriented, Outside};
use crate::parallel::map_each;
use crate::progress::NoProgress;
use crate::radii::{DENSITY, Sizes};
use crate::sorted::SortedPoints;
use glam::{DVec3, Vec3};

/// Share of the neighbours that lie in no surface themselves, from which a point is among foliage; of one whose disk is
/// large, and in a forest, less is enough, here and below.
const AMONG: [f64; 2] = [0.4, 0.25];
/// Share of the variance of these neighbours that is across the plane which fits them best, at least; of a ball it is a
/// third, of noise as large as the spacing of a plane's points a tenth.
const THICK: [f64; 2] = [0.08, 0.04];
/// Share of all points that lie in no surface, from which each point is looked at: a forest.
const FOREST: f64 = 0.25;
/// Cosine of how far disks of the ground of such a cloud lean at most.
const STEEP: f64 = 0.5;
/// How much of a normal is the direction that such points are seen from, over the distance of their neighbours.
const OUTSIDE: f64 = 0.5;
/// Radius of a disk in no surface, at most, and that beyond which a disk in a surface is looked at, in those that the
/// density rule gives where points are as far apart as is typical.
const MOST: f64 = 1.3;
const LARGE: f64 = 2.0;

/// Gives points among foliage that have no normals of their own those of the crown that they are part of: away from
/// the middle of what is around them, and some toward the outside. Those of planes through leaves point anywhere. Their
/// disks reach to the fourth neighbour, no farther than the disks of a surface with as many points: what is between
/// leaves isn't known.
pub(crate) fn soften(
    points: &SortedPoints,
    oriented: &mut [Oriented],
    sizes: &mut Sizes,
    is_given: impl Fn(usize) -> bool,
    outside: Outside,
) {
    let usual = DENSITY * sizes.typical;
    let mut is_tangled = vec![false; points.len()];
    sizes.tangled.iter().for_each(|slot| is_tangled[*slot as usize] = true);
    let is_large = |slot: usize| sizes.radius(slot) > LARGE * usual;
    let is_forest = sizes.tangled.len() as f64 > FOREST * points.len() as f64;
    let is_suspect = |slot: usize| is_forest || is_tangled[slot] || is_large(slot);
    let mut is_candidate: Vec<bool> = (0..points.len()).map(|slot| !is_given(slot) && is_suspect(slot)).collect();
    let crown = |search: &mut Search, slot: usize| -> Option<Leaf> {
        let (near, _) = search.nearest(slot, WIDE, wider(oriented[slot].farthest2(), 16));
        let among = near.iter().filter(|j| is_tangled[**j as usize]).count() as f64;
        let (variances, _) = smallest3(covariance(points, slot, near));
        let sum = variances.iter().sum::<f64>();
        let least = usize::from(is_forest || is_large(slot));
        if among < AMONG[least] * near.len() as f64 || variances[0] < THICK[least] * sum {
            return None;
        }
        let p = points.point(slot);
        let middle = near.iter().map(|j| points.point(*j as usize)).sum::<DVec3>() / near.len() as f64;
        let (toward, spread) = (outside.at(p), (sum / near.len() as f64).sqrt());
        let normal = (p - middle + toward * (OUTSIDE * spread)).normalize_or(toward).as_vec3();
        let radius = near.get(3).map_or(usual, |j| points.point(*j as usize).distance(p).min(usual));
        let nearest = std::array::from_fn(|k| near.get(k).map_or(slot as u32, |j| *j));
        Some(Leaf { normal, radius, nearest })
    };
    let all = |slots: Vec<u32>| -> Vec<(u32, Option<Leaf>)> {
        let block = || Search::new(points);
        let found = map_each(slots.len(), &NoProgress, block, |search, i| crown(search, slots[i] as usize));
        slots.into_iter().zip(found).collect()
    };
    let first = all((0..points.len() as u32).filter(|slot| is_candidate[*slot as usize]).collect());
    // Some leaves lie in one plane by chance.
    let mut beside = Vec::new();
    for slot in first.iter().filter_map(|(_, leaf)| leaf.as_ref()).flat_map(|leaf| leaf.nearest) {
        if !is_given(slot as usize) && !std::mem::replace(&mut is_candidate[slot as usize], true) {
            beside.push(slot);
        }
    }
    let beside = all(beside);
    // In a forest there are no walls, but trunks.
    let is_steep = |normal: Vec3, slot: usize| normal.as_dvec3().dot(outside.at(points.point(slot))).abs() < STEEP;
    for (slot, leaf) in first.into_iter().chain(beside) {
        let slot = slot as usize;
        if let Some(leaf) = leaf {
            oriented[slot].normal = leaf.normal;
            sizes.limit(slot, leaf.radius);
        } else if is_tangled[slot] || is_forest && is_steep(oriented[slot].normal, slot) {
            sizes.limit(slot, MOST * usual);
        }
    }
}

/// A point among foliage: its normal, how large its disk is at most, and the nearest others.
#[derive(Clone)]
struct Leaf {
    normal: Vec3,
    radius: f64,
    nearest: [u32; NEAREST],
}
