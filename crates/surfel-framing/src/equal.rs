//! Detection of equal objects or parts next to each other. Estimates for all of them are then made from one.

use crate::patches::Patches;
use glam::DVec3;

/// Limit on the number of objects, and of parts of one object. At more than 33 objects, or at 33 parts or more, they
/// aren't tested for equality.
pub(crate) const MOST: usize = 33;
/// Largest number of successive splits of a shape into equal parts: a part is split again, for example if the shape is
/// a row of rows.
const DEPTH: usize = 3;
/// Smallest width of a gap between two parts, in units of [`Patches::scale`] (half of the diagonal of the bounds).
const GAP: f64 = 0.01;
/// Smallest area of a part, as a fraction of the area of the whole shape. Smaller pieces don't count as parts.
const PART: f64 = 0.02;
/// Largest total area of the pieces that are smaller than [`PART`], as a fraction of the area of the whole shape. With
/// more, the shape isn't a row of equal parts.
const REST: f64 = 0.01;
/// Largest difference between the extents of equal shapes along each axis, as a fraction of the larger shape's half
/// diagonal.
const LENGTHS: f64 = 0.04;
/// Smallest fraction of the area of each of two shapes that must lie on the surface of the other for them to be equal.
const SAME: f64 = 0.95;
/// Largest number of grid cells per unit of length, for comparing two shapes. The unit is half of the diagonal of a
/// shape's bounds.
const CELLS: f64 = 16.0;
/// Number of patches per grid cell for which the cell size is chosen, so that cells on the surface aren't empty. Small
/// samples therefore get larger cells.
const PATCHES_OF_CELLS: f64 = 6.0;

/// Returns one of a shape's parts if they are equal and separated by gaps along an axis, and `None` otherwise.
pub(crate) fn one_part(patches: &Patches) -> Option<Patches> {
    let mut found: Option<Patches> = None;
    for _ in 0..DEPTH {
        let whole = found.as_ref().unwrap_or(patches);
        let Some(part) = (0..3).find_map(|k| one_along(whole, k)) else { break };
        found = Some(part);
    }
    found
}

/// Returns one of a shape's parts, if all parts are equal and gaps separate them along axis `k` (0 to 2 for x, y and
/// z).
fn one_along(patches: &Patches, k: usize) -> Option<Patches> {
    let reach = |number: usize| {
        let [s, t] = patches.all[number].axes;
        let (at, reach) = (patches.all[number].position[k], s[k].hypot(t[k]));
        [at - reach, at + reach]
    };
    let mut order: Vec<usize> = (0..patches.all.len()).collect();
    order.sort_by(|a, b| reach(*a)[0].total_cmp(&reach(*b)[0]).then(a.cmp(b)));
    let mut parts: Vec<Vec<usize>> = Vec::new();
    let mut end = f64::NEG_INFINITY;
    for number in order {
        let [from, to] = reach(number);
        if from > end + GAP {
            parts.push(Vec::new());
        }
        end = end.max(to);
        parts.last_mut()?.push(number);
    }
    let area = |part: &Vec<usize>| part.iter().map(|number| patches.all[*number].area).sum::<f64>() / patches.area;
    let rest: f64 = parts.iter().map(area).filter(|area| *area < PART).sum();
    parts.retain(|part| area(part) >= PART);
    if parts.len() < 2 || parts.len() >= MOST || rest > REST {
        return None;
    }
    let samples = parts.iter().map(|part| patches.some(part)).collect::<Option<Vec<Patches>>>()?;
    let (first, others) = samples.split_first()?;
    others.iter().all(|other| are_equal(first, other)).then(|| first.clone())
}

/// True if two samples have equal shapes and sizes, wherever they are.
pub(crate) fn are_equal(a: &Patches, b: &Patches) -> bool {
    let lengths = [a, b].map(|patches| patches.extent() * patches.scale);
    let is_same_length = |k: usize| (lengths[0][k] - lengths[1][k]).abs() <= LENGTHS * a.scale.max(b.scale);
    (0..3).all(is_same_length) && share_on(a, b) >= SAME && share_on(b, a) >= SAME
}

/// Returns the fraction of the area of `of` that is within one grid cell of the surface of `on`, when the centres of
/// both coincide.
fn share_on(of: &Patches, on: &Patches) -> f64 {
    // Positions are at most 1 from the centre.
    const SIDE: usize = 2 * (CELLS as usize + 2) + 1;
    let fewer = of.all.len().min(on.all.len());
    let cells = (fewer as f64 / PATCHES_OF_CELLS).sqrt().min(CELLS);
    let cell = |p: DVec3| (p * cells).round().to_array().map(|c| (c + CELLS + 2.0) as usize);
    let index = |[x, y, z]: [usize; 3]| (z * SIDE + y) * SIDE + x;
    let mut near = vec![false; SIDE * SIDE * SIDE];
    for p in &on.all {
        let [x, y, z] = cell(p.position);
        for z in z - 1..=z + 1 {
            for y in y - 1..=y + 1 {
                let middle = index([x, y, z]);
                near[middle - 1..=middle + 1].fill(true);
            }
        }
    }
    of.all.iter().filter(|p| near[index(cell(p.position))]).map(|p| p.area).sum::<f64>() / of.area
}
