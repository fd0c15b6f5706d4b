//! Places beside creases and open edges that no splat covers: in facets narrower than splats are apart, and at the ends
//! of creases, whose lines cut splats beyond them. Each gets a splat, in place of one that its neighbours stand in for.

use super::borders::Borders;
use super::parts::Sample;
use super::placed::{EYES, Grown, Placed};
use crate::NoProgress;
use crate::parallel::map_each;
use crate::radii;
use crate::tree::{KdTree, Nearest};
use glam::DVec3;
use std::collections::HashSet;
use std::f64::consts::FRAC_1_SQRT_2;
use surfel_math::basis::orthonormal;

/// How often what moved splats cover is looked at again.
const ROUNDS: usize = 4;
/// Of how many splats one moves at most in a round, and how many may.
const MOST_MOVED: usize = 64;
const LEAST_MOVED: usize = 16;
/// Least number of splats for each place along an edge: what these are looked at for must not cost more than splats do.
const SPLATS_A_PLACE: f64 = 2.0;
/// How far apart along edges places are, and how far inside of them, over a splat's radius.
const STEP: f64 = 0.2;
const INSETS: [f64; 3] = [0.03, 0.3, 1.0];
/// How far apart places are that get a splat each in one round, over its radius.
const APART: f64 = 0.5;
/// Angles from a face's normal that it is seen at, in degrees.
const TILTS: [f64; 2] = [25.0, 50.0];
/// Splats about a place that are asked whether they cover it: at first, and where these don't.
const ASKED: [usize; 2] = [6, 32];
/// Splats of which one may go: the one whose neighbour is nearest.
const CHOICE: usize = 8;
/// Nearest splats, itself among them, that must stay where one goes, and how they must face.
const NEIGHBOURS: usize = 8;
const ALIKE: f64 = 0.5;

/// A place of a face.
type Place = (u32, DVec3);

/// Moves splats to places that none covers.
pub(super) fn fill(borders: &Borders, regions: &[u32], on: &mut Placed, kept: &mut [Option<Grown>]) {
    let Some(radius) = radii::median(&mut on.radii.clone()) else { return };
    let geometry = on.geometry;
    let step = (STEP * radius).max(SPLATS_A_PLACE * borders.length() / kept.len() as f64);
    let mut bare: Vec<Place> = INSETS.iter().flat_map(|inset| borders.places(geometry, step, inset * radius)).collect();
    // What covers a place beside a border is cut by it.
    let cut: Vec<usize> = (0..kept.len()).filter(|i| kept[*i].is_some()).collect();
    let of_cut = KdTree::new(&cut.iter().map(|i| on.positions[*i]).collect::<Vec<_>>());
    for asked in ASKED {
        bare = uncovered(on, kept, (&of_cut, &cut, asked), &bare);
    }
    if bare.is_empty() {
        return;
    }
    let most_moved = (kept.len() / MOST_MOVED).max(LEAST_MOVED);
    let wanted = (2 * apart(&bare, radius, regions).count()).min(ROUNDS * most_moved);
    let mut spare = spared(on, kept, wanted).into_iter();
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
        bare = uncovered(on, kept, (&of_moved, &moved, ASKED[1]), &bare);
    }
}

/// Of places, the first in each cube that is as wide as splats are apart that get there, and region.
fn apart<'a>(places: &'a [Place], radius: f64, regions: &'a [u32]) -> impl Iterator<Item = Place> + 'a {
    let mut cells = HashSet::new();
    let cell = move |(face, q): &Place| {
        ((*q / (APART * radius)).to_array().map(|c| c.floor() as i64), regions[*face as usize])
    };
    places.iter().filter(move |place| cells.insert(cell(place))).copied()
}

/// The places that none of some splats covers, of which so many nearest to each are asked.
fn uncovered(
    on: &Placed,
    kept: &[Option<Grown>],
    (tree, splats, asked): (&KdTree, &[usize], usize),
    places: &[Place],
) -> Vec<Place> {
    let reach = splats.iter().map(|i| on.reach(*i, kept)).fold(0.0, f64::max);
    let is_bare = map_each(
        places.len(),
        &NoProgress,
        || Nearest::within(asked, reach),
        |found, at| {
            let (face, q) = places[at];
            let eyes = seen_from(on.geometry.normals[face as usize]);
            let mut bare = [true; EYES];
            let mut cover = |found: &Nearest| {
                found.items().iter().any(|(_, slot)| {
                    on.cover(splats[tree.index(*slot as usize)], kept, q, &eyes, &mut bare);
                    bare == [false; EYES]
                })
            };
            // What covers a place often covers the next one, too.
            if cover(found) {
                return false;
            }
            tree.nearest(q, found);
            !cover(found)
        },
    );
    places.iter().zip(is_bare).filter(|(_, is_bare)| *is_bare).map(|(place, _)| *place).collect()
}

/// At most so many splats that can go: no border cuts them, and none of their neighbours goes. Those are first that
/// others are nearest to, over their radius.
fn spared(on: &Placed, kept: &[Option<Grown>], most: usize) -> Vec<usize> {
    let tree = KdTree::new(&on.positions);
    let whole: Vec<usize> = (0..tree.len()).filter(|slot| kept[tree.index(*slot)].is_none()).collect();
    // Evenly over the tree, which is evenly over the surface. Of two that are chosen, one may be a neighbour of others.
    let choices = (2 * most).min(whole.len() / CHOICE);
    let nearest_of = |slot: usize, found: &mut Nearest| {
        tree.nearest(tree.point(slot), found);
        let normal = |slot: usize| on.planes[tree.index(slot)];
        let is_other = |other: usize| other != slot && normal(other).dot(normal(slot)) > ALIKE;
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

/// Unit vectors toward eyes that see a face: along its normal, and tilted from it to several sides.
fn seen_from(normal: DVec3) -> [DVec3; EYES] {
    let (u, v) = orthonormal(normal);
    let [(sin, cos), (far_sin, far_cos)] = TILTS.map(|degrees| degrees.to_radians().sin_cos());
    let [up, far_up] = [normal * cos, normal * far_cos];
    let [a, b, c, d] = [u * sin, v * sin, (u + v) * (far_sin * FRAC_1_SQRT_2), (u - v) * (far_sin * FRAC_1_SQRT_2)];
    [normal, up + a, up - a, up + b, up - b, far_up + c, far_up - c, far_up + d, far_up - d]
}
