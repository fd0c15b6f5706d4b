//! The splats of a block's list, four after four.

use crate::fragment::{Fragment, four, fragment};
use crate::lanes::{LANES, Lanes};
use crate::lists::{BlockList, FOUR};
use crate::raster::Shared;
use crate::record::{Record, Together};
use fearless_simd::Simd;

/// The pixels of the block whose first one is (x, y).
#[derive(Clone, Copy)]
pub(crate) struct Pixels<S: Simd> {
    first: (i32, i32),
    /// Columns and rows.
    at: (Lanes<S>, Lanes<S>),
}

impl<S: Simd> Pixels<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S, (x, y): (i32, i32)) -> Self {
        let k = |v: i32| Lanes::splat(simd, v as f32);
        Self { first: (x, y), at: (Lanes::block_columns(simd) + k(x), Lanes::block_rows(simd) + k(y)) }
    }
}

/// What is done with fragments. Not a closure: one that is called in several places isn't inlined into SIMD code.
pub(crate) trait Visit<S: Simd> {
    /// Told which four comes next.
    #[inline(always)]
    fn begin(&mut self, _number: usize) {}

    /// Takes in one of the four.
    fn add(&mut self, simd: S, fragment: Fragment<S>, j: usize, record: &Record);

    /// Depth behind which nothing matters any more, if it has changed.
    fn farthest(&self) -> Option<f32>;
}

/// How many fours are drawn before it is asked again what lies behind them.
const ASKED: usize = 4;

/// Computes the fragments of a list's splats, four together where they can be, but those behind a depth or what is kept so far:
/// how many were computed.
#[inline(always)]
pub(crate) fn each_four<S: Simd>(
    simd: S,
    list: BlockList<'_, '_>,
    mut farthest: f32,
    pixels: &Pixels<S>,
    shared: &Shared<'_>,
    visit: &mut impl Visit<S>,
) -> u32 {
    let (mut tested, mut last) = (0, 0);
    let all = list.fours();
    for (number, &[i, j, k, l]) in all.iter().enumerate() {
        let [(a, a_z), (b, b_z), (c, c_z), (d, d_z)] = [list.get(i), list.get(j), list.get(k), list.get(l)];
        // The first alone decides, nearly always.
        if farthest < a_z && farthest < b_z && farthest < c_z && farthest < d_z {
            continue;
        }
        tested += FOUR as u32;
        last = number;
        let records = [a, b, c, d];
        visit.begin(number);
        match Together::of(&records) {
            Together::Simple => {
                let [e, f, g, h] = four::<S, false>(simd, records, [pixels.at; FOUR], shared);
                visit.add(simd, e, 0, a);
                visit.add(simd, f, 1, b);
                visit.add(simd, g, 2, c);
                visit.add(simd, h, 3, d);
            }
            Together::Soft => {
                let [e, f, g, h] = four::<S, true>(simd, records, [pixels.at; FOUR], shared);
                visit.add(simd, e, 0, a);
                visit.add(simd, f, 1, b);
                visit.add(simd, g, 2, c);
                visit.add(simd, h, 3, d);
            }
            Together::Nothing => {
                for (j, record) in records.into_iter().enumerate() {
                    visit.add(simd, fragment(simd, record, pixels.at, pixels.first, shared), j, record);
                }
            }
        }
        if number % ASKED == ASKED - 1
            && number + 1 < all.len()
            && let Some(depth) = visit.farthest()
        {
            farthest = depth;
        }
    }
    // The last four may be filled up with a splat that is nowhere.
    let filled = if last + 1 == all.len() { (FOUR * all.len() - list.len()) as u32 } else { 0 };
    tested.saturating_sub(filled)
}

/// The largest lane; none is NaN.
#[inline(always)]
pub(crate) fn largest<S: Simd>(v: Lanes<S>) -> f32 {
    let mut lanes = v.to_array();
    let mut half = LANES / 2;
    while half > 0 {
        for i in 0..half {
            lanes[i] = if lanes[i] > lanes[i + half] { lanes[i] } else { lanes[i + half] };
        }
        half /= 2;
    }
    lanes[0]
}
