//! Places that are spread over a surface, as many on each part as are asked for.

use super::random::Random;
use crate::parallel::map_each;
use crate::progress::Progress;

/// A place: a part's number, and barycentric coordinates of it.
pub(crate) type PartPlace = (u32, [f64; 3]);

/// Where the four triangles of half a triangle's size begin, in its barycentric coordinates 1 and 2, and their size;
/// that of the middle one is negative, as it is turned.
const QUARTERS: [([f64; 2], f64); 4] = [([0.5, 0.5], -0.5), ([0.0, 0.0], 0.5), ([0.5, 0.0], 0.5), ([0.0, 0.5], 0.5)];
/// Most digits of a number that choose between four parts.
const MOST_DIGITS: u32 = 16;

/// Numbered places, stratified by each part's share of the sum of weights along the order of the parts: the i-th of n
/// lies in the i-th n-th of the sum.
pub(crate) struct Scatter<'a> {
    weights: &'a [f64],
    /// Sums of weights up to the end of each part.
    ends: Vec<f64>,
    /// The last part of any weight.
    last: usize,
    /// Number of places.
    count: usize,
    /// Sum of all weights.
    total: f64,
}

impl<'a> Scatter<'a> {
    /// `count` places on parts with these weights, whose sum is `total`.
    pub(crate) fn new(weights: &'a [f64], count: usize, total: f64) -> Self {
        let mut sum = 0.0;
        let ends = weights.iter().map(|weight| {
            sum += weight;
            sum
        });
        let last = weights.iter().rposition(|weight| *weight > 0.0).unwrap_or(0);
        Self { weights, ends: ends.collect(), last, count, total }
    }

    /// All places, by the low-discrepancy sequence R₂ (Roberts 2018, frac(½ + i/g), frac(½ + i/g²), g³ = g + 1) within
    /// each part.
    pub(crate) fn even(&self, progress: &dyn Progress) -> Vec<PartPlace> {
        const STEPS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];
        self.map(self.count, &|k| k, progress, &|i, part, _| {
            let [a, b] = STEPS.map(|step| (0.5 + i as f64 * step).fract());
            (part as u32, folded(a, b))
        })
    }

    /// All places, as [`Self::irregular_place`] places them; `of` makes something of each.
    pub(crate) fn irregular<T: Clone + Default + Send>(
        &self,
        progress: &dyn Progress,
        of: &(dyn Fn(PartPlace) -> T + Sync),
    ) -> Vec<T> {
        self.map(self.count, &|k| k, progress, &|i, part, random| of(self.irregular_place(i, part, random)))
    }

    /// Some of the places of [`Self::irregular`], whose numbers ascend.
    pub(crate) fn some_irregular(&self, numbers: &[u32], progress: &dyn Progress) -> Vec<PartPlace> {
        let number = |k: usize| numbers[k] as usize;
        self.map(numbers.len(), &number, progress, &|i, part, random| self.irregular_place(i, part, random))
    }

    /// Results of `of` for `count` numbers, which ascend, in parallel and in order; `of` is given a number, its part
    /// and its random numbers.
    fn map<T: Clone + Default + Send>(
        &self,
        count: usize,
        number: &(dyn Fn(usize) -> usize + Sync),
        progress: &dyn Progress,
        of: &(dyn Fn(usize, usize, Random) -> T + Sync),
    ) -> Vec<T> {
        progress.stage("samples", count as u64);
        // Parts are searched from the one before on.
        let before = || None::<usize>;
        map_each(count, progress, before, |before: &mut Option<usize>, k| {
            let i = number(k);
            let mut random = Random::new(i as u64);
            let target = (i as f64 + random.unit()) / self.count as f64 * self.total;
            let mut part = before.unwrap_or_else(|| self.ends.partition_point(|end| *end <= target));
            // Parts without weight end where they begin and are never met.
            while part < self.last && self.ends[part] <= target {
                part += 1;
            }
            // Rounding may lead past the end.
            part = part.min(self.last);
            *before = Some(part);
            of(i, part, random)
        })
    }

    /// The i-th place, in part `part`, by the triangular van der Corput sequence (Basu and Owen 2015, "Low discrepancy
    /// constructions in the triangle", §3). Its digits end at triangles that have one place each; there, places are
    /// random.
    ///
    /// Regular sequences coincide in some places and leave gaps in others where two of them meet: in the halves of R₂'s
    /// square, beside an edge. Elimination would make holes of two spacings there.
    fn irregular_place(&self, i: usize, part: usize, mut random: Random) -> PartPlace {
        let expected = self.weights[part] / self.total * self.count as f64;
        let bits = 64 - (expected.ceil() as u64).saturating_sub(1).leading_zeros();
        let ([mut v, mut w], mut scale) = ([0.0, 0.0], 1.0);
        for digit in (0..bits.div_ceil(2).min(MOST_DIGITS)).map(|k| i >> (2 * k) & 3) {
            let (start, factor) = QUARTERS[digit];
            (v, w) = (v + scale * start[0], w + scale * start[1]);
            scale *= factor;
        }
        let [_, b, c] = folded(random.unit(), random.unit());
        (v, w) = (v + scale * b, w + scale * c);
        (part as u32, [1.0 - v - w, v, w])
    }
}

/// Barycentric coordinates of a point of the unit square, whose farther half is turned onto the nearer one.
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
        // 4096 places in the middle part: one in each of its 4⁶ triangles, but for where its first one falls.
        let weights = [0.0, 1.0, 16.0, 0.0, 0.1, 0.0];
        let scatter = Scatter::new(&weights, 4378, 17.1);
        for places in [scatter.even(&NoProgress), scatter.irregular(&NoProgress, &|place| place)] {
            for (part, weight) in weights.iter().enumerate() {
                let count = places.iter().filter(|place| place.0 as usize == part).count() as f64;
                assert!((count - weight * 4378.0 / 17.1).abs() <= 1.0, "{part}: {count}");
            }
            assert!(places.iter().all(|(_, b)| b.iter().all(|b| (-1e-15..=1.0).contains(b))));
        }
        let places = scatter.irregular(&NoProgress, &|place| place);
        let mut cells = std::collections::HashSet::new();
        for (_, b) in places.iter().filter(|place| place.0 == 2) {
            // Two triangles to each cell of a grid of 64.
            let [x, y] = [b[1] * 64.0, b[2] * 64.0];
            cells.insert((x as usize, y as usize, x.fract() + y.fract() > 1.0));
        }
        assert!(cells.len() > 4000, "{}", cells.len());
        // Chosen numbers give the same places.
        let numbers = [0, 17, 18, 900, 4377];
        let some = scatter.some_irregular(&numbers, &NoProgress);
        assert!(numbers.iter().zip(some).all(|(i, place)| places[*i as usize] == place));
    }
}
