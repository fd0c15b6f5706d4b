//! Compares ways to evaluate the clip curve of a splat, over blocks of sixteen pixels. Run it as `cargo bench -p
//! surfel-benches --bench clips`.
//!
//! It uses one thread. Curves and splats are random, and blocks lie anywhere on the splat's disk. Before the times, it
//! prints how often each way differs from the implicit test in f64. It prints this for all pixels of the blocks, and
//! for pixels within [`NEAR_PX`] of the curves.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use fearless_simd::prelude::*;
use fearless_simd::{Simd, mask32x16};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::hint::black_box;
use surfel_math::clip::{Clip, Curve, Turn};
use surfel_math::clip_paper::PaperCurve;
use surfel_math::mapping::{Footprint, Linear};
use surfel_math::{Real, V2};

// The renderer's own lanes and instruction levels. The benchmark needs only a part of them.
#[allow(dead_code, unused_imports, unreachable_pub)]
#[path = "../../crates/surfel-cpu/src/simd"]
mod simd {
    pub(crate) mod fused;
    pub(crate) mod lanes;
    pub(crate) mod level;
}

use simd::lanes::{LANES, Lanes};
use simd::level::{Instructions, SimdLevel, with_instructions};

/// Number of pairs of a splat and a block of pixels over which each way is timed. They fit the second-level cache.
const TIMED: usize = 1024;
/// Number of pairs of a splat and a block of pixels over which differences from the implicit test in f64 are counted.
const COUNTED: usize = 1 << 16;

/// Way to evaluate a splat's clip curve over a block of pixels.
#[derive(Clone, Copy, Debug)]
enum Way {
    /// Implicit form of the conic, composed with the mapping into forms over pixels.
    Implicit,
    /// `Implicit` if a pixel of the block is within the triangle of the curve's control points, else the chord (C12
    /// §3.3).
    ImplicitBounded,
    /// Test by C12 eq. 7, corrected (see [`PaperCurve`]), evaluated in (u, v).
    Paper,
    /// `Paper` if a pixel of the block is within the triangle of the curve's control points, else the chord (C12 §3.3).
    PaperBounded,
    /// The chord in place of the curve (C12 §3.3).
    Chord,
}

/// All ways, in the order of the results.
const WAYS: [Way; 5] = [Way::Implicit, Way::ImplicitBounded, Way::Paper, Way::PaperBounded, Way::Chord];

/// Splat with a clip curve, and a block of its pixels.
struct Pair {
    footprint: Footprint<f32>,
    clip: Clip<f32>,
    paper: PaperCurve<f32>,
    /// Offset of the block's first pixel from the splat's anchor.
    first: [f32; 2],
}

/// Generator of random numbers in [0, 1): SplitMix64 (Steele, Lea and Flood 2014).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// Largest offset along each axis, in pixels, between a point of the curve and the first pixel of a block beside the
/// curve.
const NEAR_PX: f64 = 1e-4;

/// Returns the pixel offset at which a footprint has the coordinates (u, v) = `q`.
fn pixel_of(footprint: &Footprint<f64>, q: V2<f64>) -> V2<f64> {
    let Footprint { u, v, w } = footprint;
    // Solves U(d) = q.x·W(d) and V(d) = q.y·W(d) for the offset d; U, V and W are the footprint's homogeneous
    // coordinates.
    let row = |l: &Linear<f64>, k: f64| (V2::new(l.x - k * w.x, l.y - k * w.y), k * w.c - l.c);
    let ((a, e), (b, f)) = (row(u, q.x), row(v, q.y));
    V2::new(e * b.y - f * a.y, f * a.x - e * b.x) * (1.0 / a.cross(b))
}

/// Returns `count` pairs of a splat and a block of its pixels. If `near` is true, the first pixel of each block is
/// beside the clip curve; otherwise blocks lie anywhere on the disk. Curves are like those of `convert --sharp`, from
/// nearly straight to strongly bent in either direction. The longer half-axes of splats are 4 to 32 pixels.
fn pairs(count: usize, near: bool) -> Vec<Pair> {
    let mut random = Random(5);
    let pair = |_| {
        let (from, arc) = (random.within(0.0, TAU), random.within(0.8, 3.0));
        let at = |angle: f64, radius: f64| V2::new(radius * angle.cos(), radius * angle.sin());
        let (p1, p3) = (at(from, 1.0), at(from + arc, 1.0));
        let p2 = (p1 + p3) * 0.5 + at(from + 0.5 * arc, random.within(-0.8, 0.8));
        let curve = Curve { p1, p2, p3, w: random.within(0.3, 2.0) };
        let (turn, long, short) = (random.within(0.0, TAU), random.within(4.0, 32.0), random.within(0.3, 1.0));
        let (s, t) = (at(turn, long), at(turn + FRAC_PI_2, long * short));
        let slope = V2::new(random.within(-0.05, 0.05), random.within(-0.05, 0.05));
        let footprint = Footprint::about_center(s, t, s.cross(t), slope);
        let narrow = |l: Linear<f64>| Linear { c: l.c as f32, x: l.x as f32, y: l.y as f32 };
        let on_curve = pixel_of(&footprint, curve.at(random.unit()));
        let Footprint { u, v, w } = footprint;
        let footprint = Footprint { u: narrow(u), v: narrow(v), w: narrow(w) };
        let clip = Clip::nothing().with_curve(&curve).map(|v| v as f32);
        let PaperCurve { p1, p2, p3, w, turn } = PaperCurve::new(&curve);
        let point = |p: V2<f64>| V2::new(p.x as f32, p.y as f32);
        let paper = PaperCurve { p1: point(p1), p2: point(p2), p3: point(p3), w: w as f32, turn: turn as f32 };
        let anywhere = [0, 1].map(|_| random.within(-long, long).floor() as f32 + 0.25);
        let beside = [on_curve.x, on_curve.y].map(|v| (v + random.within(-NEAR_PX, NEAR_PX)) as f32);
        let first = if near { beside } else { anywhere };
        // Both ways to evaluate a clip start from the numbers of the same stored clip.
        Pair { clip: clip.through(&footprint, &Turn::none(1.0)), footprint, paper, first }
    };
    (0..count).map(pair).collect()
}

#[inline(always)]
fn wide<S: Simd>(simd: S, l: &Linear<f32>) -> Linear<Lanes<S>> {
    let k = |v| Lanes::splat(simd, v);
    Linear { c: k(l.c), x: k(l.x), y: k(l.y) }
}

#[inline(always)]
fn offsets<S: Simd>(simd: S, pair: &Pair) -> V2<Lanes<S>> {
    let [x, y] = pair.first.map(|v| Lanes::splat(simd, v));
    V2::new(Lanes::block_columns(simd) + x, Lanes::block_rows(simd) + y)
}

#[inline(always)]
fn implicit<S: Simd>(simd: S, pair: &Pair, d: V2<Lanes<S>>) -> mask32x16<S> {
    let clip = &pair.clip;
    let zero = d.x.zero();
    let none = Linear { c: zero, x: zero, y: zero };
    let clip = Clip {
        chord: wide(simd, &clip.chord),
        side1: wide(simd, &clip.side1),
        side3: wide(simd, &clip.side3),
        curve_sign: Lanes::splat(simd, clip.curve_sign),
        lines: [none; 4],
        line_sign: zero,
    };
    clip.curve_keeps(d)
}

#[inline(always)]
fn paper<S: Simd>(simd: S, pair: &Pair, d: V2<Lanes<S>>) -> mask32x16<S> {
    let k = |v| Lanes::splat(simd, v);
    let Footprint { u, v, w } = &pair.footprint;
    let inverse = d.x.one() / wide(simd, w).at(d);
    let q = V2::new(wide(simd, u).at(d) * inverse, wide(simd, v).at(d) * inverse);
    let PaperCurve { p1, p2, p3, w, turn } = &pair.paper;
    let point = |p: &V2<f32>| V2::new(k(p.x), k(p.y));
    PaperCurve { p1: point(p1), p2: point(p2), p3: point(p3), w: k(*w), turn: k(*turn) }.keeps(q)
}

/// Returns true if some pixel of the block is within the triangle of the curve's control points, and the mask of the
/// pixels that the chord alone retains.
#[inline(always)]
fn bounded<S: Simd>(simd: S, pair: &Pair, d: V2<Lanes<S>>) -> (bool, mask32x16<S>) {
    let zero = d.x.zero();
    let chord = wide(simd, &pair.clip.chord).at(d);
    let sides = zero.le(wide(simd, &pair.clip.side1).at(d)) & zero.le(wide(simd, &pair.clip.side3).at(d));
    let inside = chord.le(zero);
    let kept = if pair.clip.curve_sign < 0.0 { !inside } else { inside };
    ((zero.le(chord) & sides).to_bitmask() != 0, kept)
}

#[inline(always)]
fn keeps<S: Simd>(simd: S, way: Way, pair: &Pair) -> mask32x16<S> {
    let d = offsets(simd, pair);
    match way {
        Way::Implicit => implicit(simd, pair, d),
        Way::Paper => paper(simd, pair, d),
        Way::Chord => {
            let inside = wide(simd, &pair.clip.chord).at(d).le(d.x.zero());
            if pair.clip.curve_sign < 0.0 { !inside } else { inside }
        }
        Way::ImplicitBounded | Way::PaperBounded => match (bounded(simd, pair, d), way) {
            ((false, kept), _) => kept,
            (_, Way::PaperBounded) => paper(simd, pair, d),
            _ => implicit(simd, pair, d),
        },
    }
}

/// Calls `each` with the index of each pair, and the mask of its block's pixels that the clip retains, one bit per
/// pixel.
#[inline(always)]
fn run<S: Simd>(simd: S, way: Way, pairs: &[Pair], mut each: impl FnMut(usize, u64)) {
    macro_rules! all {
        ($way:expr) => {
            for (i, pair) in pairs.iter().enumerate() {
                each(i, u64::from(keeps(simd, $way, pair).to_bitmask()));
            }
        };
    }
    // Each way has its own loop, so that the choice costs nothing.
    simd.vectorize(
        #[inline(always)]
        || match way {
            Way::Implicit => all!(Way::Implicit),
            Way::ImplicitBounded => all!(Way::ImplicitBounded),
            Way::Paper => all!(Way::Paper),
            Way::PaperBounded => all!(Way::PaperBounded),
            Way::Chord => all!(Way::Chord),
        },
    );
}

/// Returns two masks of the block's pixels: pixels that pass the implicit test in f64, inside of the disk or not, and
/// pixels inside of the disk.
fn truth(pair: &Pair) -> [u64; 2] {
    let wide = |l: &Linear<f32>| Linear { c: f64::from(l.c), x: f64::from(l.x), y: f64::from(l.y) };
    let Footprint { u, v, w } = &pair.footprint;
    let footprint = Footprint { u: wide(u), v: wide(v), w: wide(w) };
    let PaperCurve { p1, p2, p3, w, .. } = &pair.paper;
    let point = |p: &V2<f32>| V2::new(f64::from(p.x), f64::from(p.y));
    let curve = Curve { p1: point(p1), p2: point(p2), p3: point(p3), w: f64::from(*w) };
    let clip = Clip::nothing().with_curve(&curve).through(&footprint, &Turn::none(1.0));
    let mut bits = [0; 2];
    for i in 0..LANES {
        let d = V2::new(f64::from(pair.first[0] + (i % 4) as f32), f64::from(pair.first[1] + (i / 4) as f32));
        bits[0] |= u64::from(clip.curve_keeps(d)) << i;
        bits[1] |= u64::from(footprint.contains(d)) << i;
    }
    bits
}

fn clips(criterion: &mut Criterion) {
    let instructions = Instructions::new(SimdLevel::Best).unwrap();
    for near in [false, true] {
        // In a block beside the curve only the first pixel is close to it.
        let looked_at = if near { 1 } else { u64::MAX };
        let counted = pairs(COUNTED, near);
        let truths: Vec<[u64; 2]> = counted.iter().map(truth).collect();
        let inside: u32 = truths.iter().map(|[_, inside]| (inside & looked_at).count_ones()).sum();
        let kept: u32 = truths.iter().map(|[kept, inside]| (kept & inside & looked_at).count_ones()).sum();
        let place = if near { "beside the curves" } else { "anywhere" };
        println!("{inside} pixels within {COUNTED} disks, {place}, {kept} of them kept");
        for way in WAYS {
            let mut wrong = 0;
            let mut count =
                |i: usize, bits: u64| wrong += ((bits ^ truths[i][0]) & truths[i][1] & looked_at).count_ones();
            with_instructions!(instructions, simd => run(simd, way, &counted, &mut count));
            println!("{way:?}: {wrong} decided otherwise than in f64");
        }
    }
    let timed = pairs(TIMED, false);
    let mut group = criterion.benchmark_group("a clip curve over sixteen pixels");
    group.throughput(Throughput::Elements((TIMED * LANES) as u64));
    for way in WAYS {
        group.bench_function(BenchmarkId::from_parameter(format!("{way:?}")), |bencher| {
            bencher.iter(|| {
                let mut sum = 0;
                with_instructions!(instructions, simd => run(simd, black_box(way), &timed, |_, bits| sum ^= bits));
                sum
            });
        });
    }
    group.finish();
}

criterion_group!(benches, clips);
criterion_main!(benches);
