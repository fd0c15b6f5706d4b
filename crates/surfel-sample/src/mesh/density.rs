//! Sampling density of a mesh: the distance between splats, constant, or smaller where colours vary or the surface
//! bends.

use super::geometry::Geometry;
use super::parts::{Parts, Sample};
use crate::parallel::map_each;
use crate::progress::NoProgress;
use crate::tree::{KdTree, Nearest};
use surfel_math::basis::orthonormal;

/// Number of parts into which faces are divided for a density by colours, beyond one part per face: an approximate
/// limit, which rounding may exceed by a factor of two.
const MAX_PARTS: usize = 1 << 18;
/// Number of parts into which faces are divided for a density by curvature, beyond one part per face; approximate as
/// [`MAX_PARTS`]. Where a mesh bends, its faces are already small.
const MAX_BENT: usize = 1 << 15;
/// Number of parts of a face, side by side, per largest distance between splats.
const FINENESS: f64 = 4.0;
/// Number of colour samples along each side of the square in which the variation of colours is measured. The square's
/// side is half the largest distance between splats.
const ACROSS: usize = 8;
/// Number of times that the square for the variation of colours is halved. The smallest squares have two samples along
/// each side.
const HALVINGS: usize = 2;
/// Number of distances between splats that are compared for each part: the largest distance divided by powers of √2.
const CHOICES: usize = 2 * HALVINGS + 3;
/// Number of bisection steps that find the price of a splat: the smallest reduction of the error for which a splat is
/// added. At this price, colours vary as much as requested.
const BISECTIONS: usize = 30;
/// Largest growth of the distance between splats per unit of distance from one part of the surface to another.
const GRADE: f64 = 0.3;
/// Number of nearest parts, including the part itself, that limit a part's distance between splats by [`GRADE`]. The
/// curvature is averaged over the same parts.
const NEIGHBOURS: usize = 16;
/// Maximum number of passes over all parts in which distances between splats are reduced until none grows faster than
/// [`GRADE`]. Faster growth that then remains is accepted.
const SWEEPS: usize = 12;

/// Sampling density of a mesh, as a distance between splats that varies over the mesh.
pub(crate) struct Density {
    parts: Parts,
    /// Distance between splats in each part, in object units.
    spacing: Vec<f64>,
    /// Largest distance between splats, in object units.
    pub(crate) coarsest: f64,
    is_even: bool,
}

impl Density {
    /// Creates a density with the same distance between splats everywhere.
    pub(crate) fn even(geometry: &Geometry, spacing: f64) -> Self {
        let parts = Parts::new(geometry, f64::INFINITY, usize::MAX);
        Self { spacing: vec![spacing; parts.len()], parts, coarsest: spacing, is_even: true }
    }

    /// Computes a density from the variation of colours. The distance between splats is at most `coarsest`, and at
    /// least an eighth of that and half a texel. Within these limits, colours vary by at most `variation` (RMS over
    /// surface and channels, linear light) inside the square that a splat represents. Of all such densities, the result
    /// has close to the fewest splats.
    pub(crate) fn by_colors(geometry: &Geometry, coarsest: f64, variation: f64) -> Self {
        let parts = Parts::new(geometry, coarsest / FINENESS, MAX_PARTS);
        let each = map_each(
            parts.len(),
            &NoProgress,
            || (),
            |(), part| {
                let middle = parts.place(part, [1.0 / 3.0; 3]);
                Part {
                    area: parts.area(geometry, part),
                    variances: variances(geometry, &middle, 0.5 * coarsest),
                    finest: finest(geometry, middle.face as usize, coarsest),
                }
            },
        );
        let area: f64 = each.iter().map(|part| part.area).sum();
        // A splat is added if it reduces the squared error times area by at least the price.
        let sides: [f64; CHOICES] = std::array::from_fn(|choice| coarsest * 0.5_f64.powf(0.5 * choice as f64));
        let splats = sides.map(|side| side.powi(-2));
        let is_too_coarse = |price: f64| {
            let error: f64 = each.iter().map(|part| part.area * part.variances[part.choice(price, &splats)]).sum();
            error > variation * variation * area
        };
        let mut range = [(1e-12 * coarsest * coarsest).ln(), (1e3 * coarsest * coarsest).ln()];
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (range[0] + range[1]);
            range[usize::from(is_too_coarse(middle.exp()))] = middle;
        }
        let price = range[0].exp();
        let spacing: Vec<f64> = each.iter().map(|part| sides[part.choice(price, &splats)]).collect();
        let spacing = Neighbours::new(geometry, &parts).graded(spacing);
        Self { parts, spacing, coarsest, is_even: false }
    }

    /// Computes a density from the curvature of the surface; the distance between splats is at most `coarsest`.
    /// `squares` has the squared curvature of each face. `asked` maps the mean squared curvature of neighbouring parts
    /// to the distance between splats.
    pub(crate) fn by_curvature(
        geometry: &Geometry,
        coarsest: f64,
        squares: &[f64],
        asked: &(dyn Fn(f64) -> f64 + Sync),
    ) -> Self {
        let parts = Parts::new(geometry, coarsest / FINENESS, MAX_BENT);
        let near = Neighbours::new(geometry, &parts);
        let of = |part: usize| {
            let (mut sum, mut total) = (0.0, 0.0);
            for (_, other) in &near.of[part] {
                let area = parts.area(geometry, *other as usize);
                sum += area * squares[parts.face(*other as usize)];
                total += area;
            }
            if total > 0.0 { asked(sum / total).min(coarsest) } else { coarsest }
        };
        let spacing = near.graded(map_each(parts.len(), &NoProgress, || (), |(), part| of(part)));
        Self { parts, spacing, coarsest, is_even: false }
    }

    /// Returns the parts into which the mesh is divided. Within a part, the distance between splats is constant.
    pub(crate) fn parts(&self) -> &Parts {
        &self.parts
    }

    /// Returns the distance between splats at a place.
    pub(crate) fn at(&self, sample: &Sample) -> f64 {
        self.spacing[self.parts.at(sample)]
    }

    /// Returns the distance between splats in a part.
    pub(crate) fn of_part(&self, part: usize) -> f64 {
        self.spacing[part]
    }

    /// Returns the constant distance between splats that would give a face the number of splats that its parts have.
    pub(crate) fn of_face(&self, face: usize) -> f64 {
        let parts = &self.spacing[self.parts.of(face)];
        match parts {
            [one] => *one,
            all => (all.iter().map(|s| s.powi(-2)).sum::<f64>() / all.len() as f64).powf(-0.5),
        }
    }

    /// Returns the number of splats of each part, not rounded.
    pub(crate) fn splats(&self, geometry: &Geometry) -> Vec<f64> {
        (0..self.parts.len()).map(|part| self.parts.area(geometry, part) / self.spacing[part].powi(2)).collect()
    }

    /// True if the distance between splats is the same everywhere.
    pub(crate) fn is_even(&self) -> bool {
        self.is_even
    }
}

/// Part of the surface for which one of the compared distances between splats is selected.
#[derive(Clone, Copy, Default)]
struct Part {
    area: f64,
    /// Variance of the colours inside the square of a splat, for each compared distance.
    variances: [f64; CHOICES],
    /// Index of the smallest compared distance at which splats are at least half a texel apart.
    finest: usize,
}

impl Part {
    /// Returns the index of the compared distance with the smallest cost per area: colour variance plus price of the
    /// splats. `splats` is the number of splats per unit of area for each distance.
    fn choice(&self, price: f64, splats: &[f64; CHOICES]) -> usize {
        let cost = |choice: usize| self.variances[choice] + price * splats[choice];
        (0..=self.finest).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(0)
    }
}

/// Returns the index of the smallest compared distance at which a face's splats are at least half a texel apart.
fn finest(geometry: &Geometry, face: usize, coarsest: f64) -> usize {
    let texels = geometry.texels(face);
    let is_apart = |choice: &usize| {
        let across = 2.0 * coarsest * 0.5_f64.powf(0.5 * *choice as f64);
        texels == 0.0 || across * across * texels >= geometry.areas[face]
    };
    (0..CHOICES).take_while(is_apart).last().unwrap_or(0)
}

/// Computes the variances of the colours around a place, averaged over channels, for squares of decreasing size. The
/// square of side `side` is halved repeatedly, and the variance averaged over all squares of one size. The first value
/// of the result is for a square twice as wide as `side`, and extrapolated. Each further value is for a square narrower
/// by √2; every other one is a geometric mean of its neighbours.
fn variances(geometry: &Geometry, sample: &Sample, side: f64) -> [f64; CHOICES] {
    let (face, b) = (sample.face as usize, sample.barycentric);
    let (s, t) = orthonormal(geometry.normals[face]);
    let (Some(u), Some(v)) = (geometry.barycentric_change(face, s), geometry.barycentric_change(face, t)) else {
        return [0.0; CHOICES];
    };
    let offset = |i: usize| ((i as f64 + 0.5) / ACROSS as f64 - 0.5) * side;
    let mut colors = [[None; ACROSS]; ACROSS];
    for (j, row) in colors.iter_mut().enumerate() {
        for (i, color) in row.iter_mut().enumerate() {
            let at: [f64; 3] = std::array::from_fn(|k| b[k] + offset(i) * u[k] + offset(j) * v[k]);
            // Beyond an edge, the surface belongs to another triangle, and perhaps to another part of the texture.
            let is_inside = at.iter().all(|b| *b >= 0.0);
            *color = is_inside.then(|| geometry.color(face, at));
        }
    }
    let mut whole = [0.0; HALVINGS + 2];
    for (halving, variance) in whole[1..].iter_mut().enumerate() {
        let across = ACROSS >> halving;
        let (mut sum, mut weight) = (0.0, 0.0);
        for square in 0..(1usize << (2 * halving)) {
            let (x, y) = ((square & ((1 << halving) - 1)) * across, (square >> halving) * across);
            let inside = colors[y..y + across].iter().flat_map(|row| &row[x..x + across]).flatten();
            let (mut sums, mut squares, mut count) = ([0.0; 3], [0.0; 3], 0.0);
            for color in inside {
                count += 1.0;
                for c in 0..3 {
                    let value = f64::from(color[c]);
                    sums[c] += value;
                    squares[c] += value * value;
                }
            }
            if count > 1.0 {
                let of = |c: usize| (squares[c] - sums[c] * sums[c] / count).max(0.0) / (count - 1.0);
                sum += count * (of(0) + of(1) + of(2)) / 3.0;
                weight += count;
            }
        }
        *variance = if weight > 0.0 { sum / weight } else { 0.0 };
    }
    // The variance grows with the square of the width where colours change steadily, and not at all for noise.
    let growth = if whole[2] > 0.0 { (whole[1] / whole[2]).clamp(1.0, 4.0) } else { 4.0 };
    whole[0] = growth * whole[1];
    std::array::from_fn(|choice| {
        let (half, odd) = (choice / 2, choice % 2);
        if odd == 0 { whole[half] } else { (whole[half] * whole[half + 1]).sqrt() }
    })
}

/// Nearest parts of each part of a mesh, including the part itself.
struct Neighbours {
    /// Distances and indices of the parts nearest to each part.
    of: Vec<Vec<(f64, u32)>>,
}

impl Neighbours {
    fn new(geometry: &Geometry, parts: &Parts) -> Self {
        let middle = |part: usize| parts.place(part, [1.0 / 3.0; 3]).place(geometry);
        let middles: Vec<_> = (0..parts.len()).map(middle).collect();
        let tree = KdTree::new(&middles);
        let of = map_each(
            parts.len(),
            &NoProgress,
            || Nearest::within(NEIGHBOURS, f64::INFINITY),
            |found, part| {
                tree.nearest(middles[part], found);
                let number = |slot: u32| tree.index(slot as usize) as u32;
                found.items().iter().map(|(square, slot)| (square.sqrt(), number(*slot))).collect()
            },
        );
        Self { of }
    }

    /// Reduces the distances between splats until none grows faster than [`GRADE`] from a part to its neighbours, in at
    /// most [`SWEEPS`] passes.
    fn graded(&self, mut spacing: Vec<f64>) -> Vec<f64> {
        for _ in 0..SWEEPS {
            let least = |part: usize| {
                let reached = self.of[part].iter().map(|(distance, other)| spacing[*other as usize] + GRADE * distance);
                reached.fold(spacing[part], f64::min)
            };
            let next: Vec<f64> = (0..spacing.len()).map(least).collect();
            if next == spacing {
                break;
            }
            spacing = next;
        }
        spacing
    }
}
