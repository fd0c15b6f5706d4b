//! Closing of gaps near creases and open edges, where no splat covers the surface. Gaps occur in facets narrower than
//! the distance between splats. They also occur at the ends of creases, whose lines clip splats beyond the end. Each
//! gap gets a splat, moved from a place that its neighbours cover.

use super::borders::Borders;
use super::parts::Sample;
use super::placed::{Grown, Placed, TEST_DIRECTIONS};
use crate::NoProgress;
use crate::parallel::map_each;
use crate::radii;
use crate::tree::{KdTree, Nearest};
use glam::DVec3;
use std::collections::HashSet;
use std::f64::consts::FRAC_1_SQRT_2;
use surfel_math::basis::orthonormal;

/// Maximum number of rounds in which splats are moved to gaps. Each round tests which gaps the moved splats cover.
const ROUNDS: usize = 4;
/// Inverse of the largest fraction of splats that may be moved per round.
const MAX_MOVED: usize = 64;
/// Number of splats that may be moved per round even if it exceeds the fraction 1/[`MAX_MOVED`].
const MIN_MOVED: usize = 16;
/// Smallest ratio of the number of splats to the number of places tested along all edges, for each of [`INSETS`]. The
/// limit makes the tests take no longer than the splats.
const SPLATS_PER_PLACE: f64 = 2.0;
/// Distance between tested places along an edge, relative to the splats' median radius; larger if [`SPLATS_PER_PLACE`]
/// allows fewer places.
const STEP: f64 = 0.2;
/// Distances from an edge, toward the middle of the face, at which places are tested, relative to the splats' median
/// radius.
const INSETS: [f64; 3] = [0.03, 0.3, 1.0];
/// Side of the grid cells in each of which one splat is moved per round, relative to the splats' median radius.
const APART: f64 = 0.5;
/// Angles from a face's normal, in degrees, of the tilted directions from which a place must be covered.
const TILTS: [f64; 2] = [25.0, 50.0];
/// Numbers of clipped splats nearest to a place that are tested for covering it: in the first pass, and in the second
/// pass for places that the first leaves uncovered.
const TESTED_SPLATS: [usize; 2] = [6, 32];
/// Number of splats, consecutive in the order of a k-d tree, of which one may be moved: the one with the nearest
/// neighbour.
const CHOICE: usize = 8;
/// Number of nearest splats, including the splat itself, of which only one may be moved to a gap.
const NEIGHBOURS: usize = 8;
/// Smallest cosine (60°) between the normals of a moved splat and of the neighbour that replaces it.
const MIN_NEIGHBOUR_COSINE: f64 = 0.5;

/// Place on the surface that is tested for a gap, as a face and a position.
type Place = (u32, DVec3);

/// Finds places near borders that no splat covers, and moves splats to them. `on` are the splats, and `kept` the growth
/// and the visible part of each clipped splat; both are updated.
pub(super) fn fill(borders: &Borders, regions: &[u32], on: &mut Placed, kept: &mut [Option<Grown>]) {
    let Some(radius) = radii::median(&mut on.radii.clone()) else { return };
    let geometry = on.geometry;
    let step = (STEP * radius).max(SPLATS_PER_PLACE * borders.length() / kept.len() as f64);
    let mut bare: Vec<Place> = INSETS.iter().flat_map(|inset| borders.places(geometry, step, inset * radius)).collect();
    // Only clipped splats can cover a place beside a border.
    let cut: Vec<usize> = (0..kept.len()).filter(|i| kept[*i].is_some()).collect();
    let of_cut = KdTree::new(&cut.iter().map(|i| on.positions[*i]).collect::<Vec<_>>());
    for asked in TESTED_SPLATS {
        bare = uncovered(on, kept, &of_cut, &cut, asked, &bare);
    }
    if bare.is_empty() {
        return;
    }
    let most_moved = (kept.len() / MAX_MOVED).max(MIN_MOVED);
    let wanted = (2 * apart(&bare, radius, regions).count()).min(ROUNDS * most_moved);
    let mut spare = movable_splats(on, kept, wanted).into_iter();
    for _ in 0..ROUNDS {
        let places = apart(&bare, radius, regions).zip(spare.by_ref()).take(most_moved);
        let moved: Vec<usize> = places
            .map(|((face, q), to)| {
                on.put(to, Sample::at(geometry, face, q));
                to
            })
            .collect();
        let grown = map_each(moved.len(), &NoProgress, Borders::nearest, |found, i| {
            on.grown(moved[i], borders, regions, found)
        });
        moved.iter().zip(grown).for_each(|(to, grown)| kept[*to] = grown);
        if moved.is_empty() {
            return;
        }
        let of_moved = KdTree::new(&moved.iter().map(|i| on.positions[*i]).collect::<Vec<_>>());
        bare = uncovered(on, kept, &of_moved, &moved, TESTED_SPLATS[1], &bare);
    }
}

/// Selects one place in each grid cell and smooth region, so that places are apart. The cell's side is [`APART`] times
/// `radius`.
fn apart<'a>(places: &'a [Place], radius: f64, regions: &'a [u32]) -> impl Iterator<Item = Place> + 'a {
    let mut cells = HashSet::new();
    let cell = move |(face, q): &Place| {
        ((*q / (APART * radius)).to_array().map(|c| c.floor() as i64), regions[*face as usize])
    };
    places.iter().filter(move |place| cells.insert(cell(place))).copied()
}

/// Returns those of `places` that the splats with the indices `splats`, taken together, leave uncovered from at least
/// one of the [`test_directions`]. For each place, only the `asked` nearest of these splats are tested. `tree` has the
/// splats' centres, in the order of `splats`.
fn uncovered(
    on: &Placed,
    kept: &[Option<Grown>],
    tree: &KdTree,
    splats: &[usize],
    asked: usize,
    places: &[Place],
) -> Vec<Place> {
    let reach = splats.iter().map(|i| on.reach(*i, kept)).fold(0.0, f64::max);
    let is_bare = map_each(
        places.len(),
        &NoProgress,
        || Nearest::within(asked, reach),
        |found, at| {
            let (face, q) = places[at];
            let eyes = test_directions(on.geometry.normals[face as usize]);
            let mut bare = [true; TEST_DIRECTIONS];
            let mut cover = |found: &Nearest| {
                found.items().iter().any(|(_, slot)| {
                    on.cover(splats[tree.index(*slot as usize)], kept, q, &eyes, &mut bare);
                    bare == [false; TEST_DIRECTIONS]
                })
            };
            // A splat that covers one place often covers the next one, too.
            if cover(found) {
                return false;
            }
            tree.nearest(q, found);
            !cover(found)
        },
    );
    places.iter().zip(is_bare).filter(|(_, is_bare)| *is_bare).map(|(place, _)| *place).collect()
}

/// Selects at most `most` splats that may be moved to gaps. No border clips them, and none of their neighbours is
/// selected too. They are sorted by the distance of their nearest neighbour, relative to their radius.
fn movable_splats(on: &Placed, kept: &[Option<Grown>], most: usize) -> Vec<usize> {
    let tree = KdTree::new(&on.positions);
    let whole: Vec<usize> = (0..tree.len()).filter(|slot| kept[tree.index(*slot)].is_none()).collect();
    // Choices are spread evenly over the tree, and thus over the surface. Twice as many are needed, because some
    // neighbour each other.
    let choices = (2 * most).min(whole.len() / CHOICE);
    let nearest_of = |slot: usize, found: &mut Nearest| {
        tree.nearest(tree.point(slot), found);
        let normal = |slot: usize| on.planes[tree.index(slot)];
        let is_other = |other: usize| other != slot && normal(other).dot(normal(slot)) > MIN_NEIGHBOUR_COSINE;
        found
            .items()
            .iter()
            .find(|(_, other)| is_other(*other as usize))
            .map(|(square, _)| square / on.radii[tree.index(slot)].powi(2))
    };
    let nearest = || Nearest::within(NEIGHBOURS, f64::INFINITY);
    let mut ordered: Vec<(f64, usize)> = map_each(choices, &NoProgress, nearest, |found, i| {
        let first = i * whole.len() / choices;
        let each = whole[first..first + CHOICE].iter().filter_map(|slot| Some((nearest_of(*slot, found)?, *slot)));
        each.min_by(|a, b| a.0.total_cmp(&b.0))
    })
    .into_iter()
    .flatten()
    .collect();
    ordered.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let (mut gone, mut found) = (HashSet::new(), nearest());
    ordered.retain(|(_, slot)| {
        tree.nearest(tree.point(*slot), &mut found);
        let stays = found.items().iter().any(|(_, other)| gone.contains(other));
        !stays && gone.insert(*slot as u32)
    });
    ordered.into_iter().map(|(_, slot)| tree.index(slot)).take(most).collect()
}

/// Returns the directions from which places on a face must be covered, as unit vectors: along its normal, and tilted by
/// [`TILTS`] to several sides.
fn test_directions(normal: DVec3) -> [DVec3; TEST_DIRECTIONS] {
    let (u, v) = orthonormal(normal);
    let [(sin, cos), (far_sin, far_cos)] = TILTS.map(|degrees| degrees.to_radians().sin_cos());
    let [up, far_up] = [normal * cos, normal * far_cos];
    let [a, b, c, d] = [u * sin, v * sin, (u + v) * (far_sin * FRAC_1_SQRT_2), (u - v) * (far_sin * FRAC_1_SQRT_2)];
    [normal, up + a, up - a, up + b, up - b, far_up + c, far_up - c, far_up + d, far_up - d]
}
