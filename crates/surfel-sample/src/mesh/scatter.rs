//! Random places spread over a surface, with a given weight per part of the surface.

use super::random::Random;
use crate::parallel::map_each;
use crate::progress::Progress;
use glam::DVec3;

/// Place on the surface: the index of a part, and barycentric coordinates in the part.
pub(crate) type PartPlace = (u32, [f64; 3]);

/// Function that returns the corners of a part if places on it must be spread by halving ([`slender`]). Its arguments
/// are the part's index and the expected number of places.
pub(crate) type SlenderParts<'a> = &'a (dyn Fn(usize, f64) -> Option<[DVec3; 3]> + Sync);

/// Origins of a triangle's four quarters, in its barycentric coordinates 1 and 2, and the quarters' sizes. The middle
/// quarter has a negative size, because it is rotated by half a turn.
const QUARTERS: [([f64; 2], f64); 4] = [([0.5, 0.5], -0.5), ([0.0, 0.0], 0.5), ([0.5, 0.0], 0.5), ([0.0, 0.5], 0.5)];
/// Maximum number of base-4 digits of a place's number that are used. Each digit selects a quarter of the quarter
/// selected so far.
const MAX_DIGITS: u32 = 16;
/// Ratio of a triangle's longest side to its height above which it is halved instead of quartered.
const SLENDER: f64 = 8.0;
/// Smallest width of a halved triangle, in distances between places. Narrower triangles are quartered, because their
/// places are in a row.
const MIN_WIDTH: f64 = 4.0;

/// Returns the corners of a triangle if it is slender and wide enough for several rows of `count` places; else `None`.
pub(crate) fn slender(corners: [DVec3; 3], count: f64) -> Option<[DVec3; 3]> {
    let [a, b, c] = corners;
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    // The width is the height over the longest side. The distance between places is the square root of the area per
    // place.
    let twice_area = (b - a).cross(c - a).length();
    let is_wide = 2.0 * twice_area * count > MIN_WIDTH * MIN_WIDTH * longest;
    (longest > SLENDER * twice_area && is_wide).then_some(corners)
}

/// Numbered places on weighted parts, stratified in the order of the parts. Place i of n is in the i-th of n equal
/// intervals of the sum of weights.
pub(crate) struct Scatter<'a> {
    weights: &'a [f64],
    /// Sum of the weights of each part and all parts before it.
    ends: Vec<f64>,
    /// Index of the last part with a positive weight.
    last: usize,
    /// Number of places that are spread.
    count: usize,
    /// Sum of the parts' weights.
    total: f64,
}

impl<'a> Scatter<'a> {
    /// Prepares `count` places on parts with these weights; `total` is their sum.
    pub(crate) fn new(weights: &'a [f64], count: usize, total: f64) -> Self {
        let mut sum = 0.0;
        let ends = weights.iter().map(|weight| {
            sum += weight;
            sum
        });
        let last = weights.iter().rposition(|weight| *weight > 0.0).unwrap_or(0);
        Self { weights, ends: ends.collect(), last, count, total }
    }

    /// Returns all places. Within each part they follow the low-discrepancy sequence R₂ (Roberts 2018, frac(½ + i/g),
    /// frac(½ + i/g²), g³ = g + 1).
    pub(crate) fn even(&self, progress: &dyn Progress) -> Vec<PartPlace> {
        const STEPS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];
        self.map(self.count, &|k| k, progress, &|i, part, _| {
            let [a, b] = STEPS.map(|step| (0.5 + i as f64 * step).fract());
            (part as u32, folded(a, b))
        })
    }

    /// Returns the results of `of` for all places, in order. Places are random in small triangles
    /// ([`Self::irregular_place`]).
    pub(crate) fn irregular<T: Clone + Default + Send>(
        &self,
        slender: SlenderParts<'_>,
        progress: &dyn Progress,
        of: &(dyn Fn(PartPlace) -> T + Sync),
    ) -> Vec<T> {
        self.map(self.count, &|k| k, progress, &|i, part, random| of(self.irregular_place(i, part, slender, random)))
    }

    /// Returns the places of [`Self::irregular`] with these numbers, which must be in ascending order.
    pub(crate) fn some_irregular(
        &self,
        slender: SlenderParts<'_>,
        numbers: &[u32],
        progress: &dyn Progress,
    ) -> Vec<PartPlace> {
        let number = |k: usize| numbers[k] as usize;
        self.map(numbers.len(), &number, progress, &|i, part, random| self.irregular_place(i, part, slender, random))
    }

    /// Returns the results of `of` for `count` places, in order; they are computed in parallel. `number` maps 0..count
    /// to the places' numbers, which must ascend. The arguments of `of` are a place's number, the part that contains
    /// the place, and a random generator.
    fn map<T: Clone + Default + Send>(
        &self,
        count: usize,
        number: &(dyn Fn(usize) -> usize + Sync),
        progress: &dyn Progress,
        of: &(dyn Fn(usize, usize, Random) -> T + Sync),
    ) -> Vec<T> {
        progress.stage("samples", count as u64);
        // Each search starts from the part of the previous place.
        let before = || None::<usize>;
        map_each(count, progress, before, |before: &mut Option<usize>, k| {
            let i = number(k);
            let mut random = Random::new(i as u64);
            let target = (i as f64 + random.unit()) / self.count as f64 * self.total;
            let mut part = before.unwrap_or_else(|| self.ends.partition_point(|end| *end <= target));
            // Parts without weight end where they begin and are never selected.
            while part < self.last && self.ends[part] <= target {
                part += 1;
            }
            // Rounding may lead past the end.
            part = part.min(self.last);
            *before = Some(part);
            of(i, part, random)
        })
    }

    /// Returns place `i` in part `part` by the triangular van der Corput sequence (Basu and Owen 2015, "Low discrepancy
    /// constructions in the triangle", §3). The sequence is cut off at triangles with one place each, and the place is
    /// random within its triangle.
    ///
    /// The sequence R₂ of [`Self::even`] isn't used here: where two regular sequences meet, as at an edge, places
    /// coincide in some spots and leave gaps in others. Elimination would then leave holes of two spacings.
    ///
    /// The quarters of a slender triangle are as slender, so that places would be uneven along the triangle. The
    /// longest side of such a triangle is halved instead, by the binary digits of `i`.
    fn irregular_place(&self, i: usize, part: usize, slender: SlenderParts<'_>, mut random: Random) -> PartPlace {
        let expected = self.weights[part] / self.total * self.count as f64;
        let bits = 64 - (expected.ceil() as u64).saturating_sub(1).leading_zeros();
        if let Some(corners) = slender(part, expected) {
            return (part as u32, halved_place(corners, bits.min(2 * MAX_DIGITS), i, random));
        }
        let ([mut v, mut w], mut scale) = ([0.0, 0.0], 1.0);
        for digit in (0..bits.div_ceil(2).min(MAX_DIGITS)).map(|k| i >> (2 * k) & 3) {
            let (start, factor) = QUARTERS[digit];
            (v, w) = (v + scale * start[0], w + scale * start[1]);
            scale *= factor;
        }
        let [_, b, c] = folded(random.unit(), random.unit());
        (v, w) = (v + scale * b, w + scale * c);
        (part as u32, [1.0 - v - w, v, w])
    }
}

/// Returns barycentric coordinates of a random place in a part of a triangle. The part remains after halving the
/// longest side `bits` times, and the lowest binary digits of `i` select the halves.
fn halved_place(mut corners: [DVec3; 3], bits: u32, i: usize, mut random: Random) -> [f64; 3] {
    let mut barycentric = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for bit in 0..bits {
        let length = |k: usize| (corners[(k + 1) % 3] - corners[k]).length_squared();
        let longest = (1..3).fold(0, |best, k| if length(k) > length(best) { k } else { best });
        let [from, to] = [longest, (longest + 1) % 3];
        let replaced = if i >> bit & 1 == 0 { to } else { from };
        corners[replaced] = corners[from].midpoint(corners[to]);
        barycentric[replaced] = std::array::from_fn(|k| 0.5 * (barycentric[from][k] + barycentric[to][k]));
    }
    let of_part = folded(random.unit(), random.unit());
    std::array::from_fn(|k| barycentric.iter().zip(of_part).map(|(corner, b)| corner[k] * b).sum())
}

/// Maps a point of the unit square to barycentric coordinates; the farther half of the square is rotated onto the
/// nearer.
fn folded(a: f64, b: f64) -> [f64; 3] {
    let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
    [1.0 - a - b, a, b]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoProgress;

    #[test]
    fn places_share_parts_by_weight_and_lie_evenly_in_each() {
        // 4096 places in the middle part: one in each of its 4⁶ triangles, except for the offset of the first.
        let weights = [0.0, 1.0, 16.0, 0.0, 0.1, 0.0];
        let scatter = Scatter::new(&weights, 4378, 17.1);
        for places in [scatter.even(&NoProgress), scatter.irregular(&|_, _| None, &NoProgress, &|place| place)] {
            for (part, weight) in weights.iter().enumerate() {
                let count = places.iter().filter(|place| place.0 as usize == part).count() as f64;
                assert!((count - weight * 4378.0 / 17.1).abs() <= 1.0, "{part}: {count}");
            }
            assert!(places.iter().all(|(_, b)| b.iter().all(|b| (-1e-15..=1.0).contains(b))));
        }
        let places = scatter.irregular(&|_, _| None, &NoProgress, &|place| place);
        let mut cells = std::collections::HashSet::new();
        for (_, b) in places.iter().filter(|place| place.0 == 2) {
            // Two triangles per cell of a grid of 64.
            let [x, y] = [b[1] * 64.0, b[2] * 64.0];
            cells.insert((x as usize, y as usize, x.fract() + y.fract() > 1.0));
        }
        assert!(cells.len() > 4000, "{}", cells.len());
        // A selection of numbers gives the same places.
        let numbers = [0, 17, 18, 900, 4377];
        let some = scatter.some_irregular(&|_, _| None, &numbers, &NoProgress);
        assert!(numbers.iter().zip(some).all(|(i, place)| places[*i as usize] == place));
    }

    #[test]
    fn places_in_a_slender_triangle_lie_evenly_along_it() {
        let corners = [DVec3::ZERO, DVec3::X * 80.0, DVec3::Y];
        assert!(slender(corners, 4096.0).is_some() && slender(corners, 100.0).is_none());
        assert!(slender([DVec3::ZERO, DVec3::X * 7.0, DVec3::Y], 4096.0).is_none());
        // Any run of places has its share in each stretch of the triangle; the area up to x is 1 − (1 − x/80)².
        for (weights, total) in [(&[1.0, 0.0][..], 1.0), (&[0.37, 1.0][..], 1.37)] {
            let scatter = Scatter::new(weights, 4096, total);
            let places = scatter.irregular(&|_, _| Some(corners), &NoProgress, &|place| place);
            let mut along: Vec<f64> =
                places.iter().filter(|p| p.0 == 0).map(|p| 1.0 - (1.0 - p.1[1]).powi(2)).collect();
            assert!(places.iter().all(|(_, b)| b.iter().all(|b| (-1e-15..=1.0).contains(b))));
            along.sort_unstable_by(f64::total_cmp);
            let count = along.len() as f64;
            let worst =
                along.iter().zip(0..).map(|(a, i)| (a - (f64::from(i) + 0.5) / count).abs()).fold(0.0, f64::max);
            // Random places would deviate by some 50.
            assert!(worst * count < 12.0, "{} of {count}", worst * count);
        }
    }
}
