//! Detection of foliage, and the normals of its points.
//!
//! Leaves form no surface, and planes through their points have arbitrary normals. A point is foliage if many points
//! around it are incoherent (no common plane, disagreeing normals) and the neighbourhood is thick. The normal of a
//! foliage point approximates the outside of the tree's crown. It points away from the mean of the points around, with
//! some weight toward the outside of the cloud.

use crate::class::{Evidence, PointClass};
use crate::eigen::smallest3;
use crate::nearest::Search;
use crate::normals::{WIDE, covariance, wider};
use crate::orient::{NEAREST, Oriented, Outside};
use crate::parallel::map_each;
use crate::progress::NoProgress;
use crate::radii::{DENSITY, Sizes};
use crate::sorted::SortedPoints;
use glam::{DVec3, Vec3};

/// Smallest fraction of incoherent points ([`Evidence::INCOHERENT`]) among a point's neighbours at which the point may
/// be foliage. The second value is for points with large disks ([`LARGE`]) and for forests.
const AMONG: [f64; 2] = [0.4, 0.25];
/// Smallest variance of the neighbours' positions perpendicular to their best-fitting plane at which a neighbourhood is
/// thick, as a fraction of the total variance. The second value is for points with large disks and for forests. The
/// value is a third for points in a ball, and a tenth for a plane with noise as large as its points' spacing.
const THICK: [f64; 2] = [0.08, 0.04];
/// Fraction of incoherent points ([`Evidence::INCOHERENT`]) in a cloud above which the cloud may be a forest. In a
/// forest, every point without a stored normal is tested as foliage, unless it is isolated and coherent.
const FOREST: f64 = 0.25;
/// A cloud with many incoherent points ([`FOREST`], [`Evidence::INCOHERENT`]) is a forest if more than this fraction of
/// them has a thick neighbourhood ([`THICK`]). A noisy surface may have as many incoherent points, but is thin: with
/// noise as large as the spacing, 0.4 % of its points have a thick neighbourhood.
const FOREST_THICK: f64 = 0.25;
/// Maximum number of incoherent points whose neighbourhoods are measured to decide whether a cloud is a forest.
const FOREST_SAMPLE: usize = 4096;
/// Cosine of the largest tilt (60°) at which a disk in a forest counts as ground. Steeper disks, as on trunks, are
/// limited in size ([`MOST`]).
const STEEP: f64 = 0.5;
/// Weight of the direction to the outside of the cloud in the normal of a foliage point, relative to the spread of the
/// point's neighbours.
const OUTSIDE: f64 = 0.5;
/// Largest radius of points that were tested as foliage but aren't, relative to the density radius for the typical
/// spacing. It applies to incoherent points ([`Evidence::INCOHERENT`]) and, in a forest, to steep disks ([`STEEP`]).
const MOST: f64 = 1.3;
/// Radius above which a surface point is tested as foliage, relative to the density radius for the typical spacing.
const LARGE: f64 = 2.0;

/// Finds and reclassifies foliage among the points without stored normals (`is_given` is false), and turns their
/// normals out of the crown. Their disks reach to the fourth neighbour at most, because the space between leaves was
/// not measured. Some other tested points are limited to a smaller radius ([`MOST`]).
pub(crate) fn find(
    points: &SortedPoints,
    oriented: &mut [Oriented],
    sizes: &mut Sizes,
    is_given: impl Fn(usize) -> bool,
    outside: Outside,
) {
    let usual = DENSITY * sizes.typical;
    let is_tangled: Vec<bool> = (0..points.len()).map(|slot| sizes.evidence(slot).has(Evidence::INCOHERENT)).collect();
    let is_large = |sizes: &Sizes, slot: usize| sizes.radius(slot) > LARGE * usual;
    let is_forest = is_forest(points, oriented, &is_tangled);
    let is_suspect = |slot: usize| is_forest || is_tangled[slot] || is_large(sizes, slot);
    let is_in_question = |slot: usize| sizes.class(slot) != PointClass::Isolated || is_tangled[slot];
    let mut is_candidate: Vec<bool> =
        (0..points.len()).map(|slot| is_in_question(slot) && is_suspect(slot) && !is_given(slot)).collect();
    let measured = &*sizes;
    let crown = |search: &mut Search, slot: usize| -> Option<Leaf> {
        let (near, _) = search.nearest(slot, WIDE, wider(oriented[slot].farthest2, 16));
        let among = near.iter().filter(|j| is_tangled[**j as usize]).count() as f64;
        let (variances, _) = smallest3(covariance(points, slot, near));
        let sum = variances.iter().sum::<f64>();
        let least = usize::from(is_forest || is_large(measured, slot));
        if among < AMONG[least] * near.len() as f64 || variances[0] < THICK[least] * sum {
            return None;
        }
        let p = points.point(slot);
        let middle = near.iter().map(|j| points.point(*j as usize)).sum::<DVec3>() / near.len() as f64;
        let (toward, spread) = (outside.at(p), (sum / near.len() as f64).sqrt());
        let normal = (p - middle + toward * (OUTSIDE * spread)).normalize_or(toward).as_vec3();
        let radius = near.get(3).map_or(usual, |j| points.point(*j as usize).distance(p));
        let nearest = std::array::from_fn(|k| near.get(k).map_or(slot as u32, |j| *j));
        Some(Leaf { normal, radius, nearest })
    };
    let all = |slots: Vec<u32>| -> Vec<(u32, Option<Leaf>)> {
        let block = || Search::new(points);
        let found = map_each(slots.len(), &NoProgress, block, |search, i| crown(search, slots[i] as usize));
        slots.into_iter().zip(found).collect()
    };
    let first = all((0..points.len() as u32).filter(|slot| is_candidate[*slot as usize]).collect());
    // Some leaves are in one plane by chance, so the neighbours of foliage are tested too.
    let mut beside = Vec::new();
    for slot in first.iter().filter_map(|(_, leaf)| leaf.as_ref()).flat_map(|leaf| leaf.nearest) {
        if !is_given(slot as usize) && !std::mem::replace(&mut is_candidate[slot as usize], true) {
            beside.push(slot);
        }
    }
    let beside = all(beside);
    // Steep disks in a forest are on trunks, not on walls, so their size is limited.
    let is_steep = |normal: Vec3, slot: usize| normal.as_dvec3().dot(outside.at(points.point(slot))).abs() < STEEP;
    for (slot, leaf) in first.into_iter().chain(beside) {
        let slot = slot as usize;
        if let Some(leaf) = leaf {
            oriented[slot].normal = leaf.normal;
            sizes.reclassify(slot, Evidence::AMONG_INCOHERENT, leaf.radius);
        } else if is_tangled[slot] || is_forest && is_steep(oriented[slot].normal, slot) {
            sizes.limit(slot, MOST * usual);
        }
    }
}

/// True if the cloud is a forest: many points are incoherent, and these points have thick neighbourhoods.
fn is_forest(points: &SortedPoints, oriented: &[Oriented], is_tangled: &[bool]) -> bool {
    let tangled: Vec<usize> = (0..points.len()).filter(|slot| is_tangled[*slot]).collect();
    if tangled.len() as f64 <= FOREST * points.len() as f64 {
        return false;
    }
    let mut search = Search::new(points);
    let mut is_thick = |slot: usize| {
        let (near, _) = search.nearest(slot, WIDE, wider(oriented[slot].farthest2, 16));
        let (variances, _) = smallest3(covariance(points, slot, near));
        variances[0] >= THICK[0] * variances.iter().sum::<f64>()
    };
    let step = tangled.len().div_ceil(FOREST_SAMPLE);
    let sample = tangled.iter().step_by(step);
    let (count, thick) = sample.fold((0, 0), |(n, thick), slot| (n + 1, thick + usize::from(is_thick(*slot))));
    thick as f64 > FOREST_THICK * count as f64
}

/// Properties of a foliage point: its normal, the largest radius of its disk in grid steps, and the slots of its
/// nearest neighbours.
#[derive(Clone)]
struct Leaf {
    normal: Vec3,
    radius: f64,
    nearest: [u32; NEAREST],
}
