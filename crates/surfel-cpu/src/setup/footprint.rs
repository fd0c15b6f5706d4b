//! Helpers of setup over lanes: ranges of pixels, gradients of linear forms, and the axes of the filter `adjust`.

use crate::simd::lanes::{LANES, Lanes};
use fearless_simd::Simd;
use fearless_simd::prelude::SimdFloat;
use surfel_math::clip::Turn;
use surfel_math::mapping::Linear;
use surfel_math::project::ViewSplat;
use surfel_math::{Real, V2, V3, filter};

/// Returns the range of pixels along one axis whose centres may be in [min, max], as the first pixel and the one after
/// the last. `min` and `max` count in pixels from the near side of pixel `base`. The range is clipped to the `length`
/// pixels from `start` on.
#[inline(always)]
pub(crate) fn pixel_range<S: Simd>(
    base: Lanes<S>,
    min: Lanes<S>,
    max: Lanes<S>,
    start: u32,
    length: u32,
) -> (Lanes<S>, Lanes<S>) {
    let half = base.constant(0.5);
    let (lo, hi) = (base.constant(f64::from(start)), base.constant(f64::from(start + length)));
    let first = base + Lanes((min - half).0.ceil());
    let end = base + Lanes((max - half).0.floor()) + base.one();
    (first.max(lo).min(hi), end.max(lo).min(hi))
}

#[inline(always)]
pub(crate) fn gradient_of<R: Real>(form: &Linear<R>) -> V2<R> {
    V2::new(form.x, form.y)
}

/// Computes [`surfel_math::filter::adjust_axes_turned`] for the splats of all lanes: the adjusted axes, and the
/// rotation of each footprint in its splat's plane. The splats are computed one by one in f64, since the rotations need
/// arctangents, which have no SIMD version here.
#[cold]
pub(crate) fn adjust_axes<S: Simd>(
    splat: &ViewSplat<Lanes<S>>,
    perspective: bool,
) -> (ViewSplat<Lanes<S>>, Turn<Lanes<S>>) {
    let simd = splat.p.x.0.simd;
    let arrays = |v: V3<Lanes<S>>| [v.x.to_array(), v.y.to_array(), v.z.to_array()];
    let (p, mut s, mut t, n) = (arrays(splat.p), arrays(splat.s), arrays(splat.t), arrays(splat.n));
    let mut turns = [[0.0; LANES]; 4];
    for i in 0..LANES {
        let get = |a: &[[f32; LANES]; 3]| V3::new(a[0][i].into(), a[1][i].into(), a[2][i].into());
        let one = ViewSplat { p: get(&p), s: get(&s), t: get(&t), n: get(&n) };
        let (a, b, turn) = filter::adjust_axes_turned(&one, perspective);
        (s[0][i], s[1][i], s[2][i]) = (a.x as f32, a.y as f32, a.z as f32);
        (t[0][i], t[1][i], t[2][i]) = (b.x as f32, b.y as f32, b.z as f32);
        let turn = [turn.first.x, turn.first.y, turn.second.x, turn.second.y];
        turns.iter_mut().zip(turn).for_each(|(lanes, value)| lanes[i] = value as f32);
    }
    let load = |a: &[f32; LANES]| Lanes::load(simd, a);
    let lanes = |a: &[[f32; LANES]; 3]| V3::new(load(&a[0]), load(&a[1]), load(&a[2]));
    let turn =
        Turn { first: V2::new(load(&turns[0]), load(&turns[1])), second: V2::new(load(&turns[2]), load(&turns[3])) };
    (ViewSplat { s: lanes(&s), t: lanes(&t), ..*splat }, turn)
}
