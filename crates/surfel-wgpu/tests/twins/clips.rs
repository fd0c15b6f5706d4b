//! Kernels (formulas that the tests compare) of clips, and of the rotations that filters apply to them.

use super::inputs::{self, Random, f32s};
use super::kernels::{Kernel, coefficients, flag, splat, sum, v2, v3};
use surfel_math::clip::{Clip, Curve, Turn};
use surfel_math::mapping::Linear;
use surfel_math::{Real, V2, filter};

/// WGSL statement that makes a clip from the first 23 inputs.
const CLIP: &str = "let clip = Clip(Linear(x0, x1, x2), Linear(x3, x4, x5), Linear(x6, x7, x8), x9, array<Linear, 4>(
    Linear(x10, x11, x12), Linear(x13, x14, x15), Linear(x16, x17, x18), Linear(x19, x20, x21)), x22);";

fn clip<R: Real>(x: &[R]) -> Clip<R> {
    let linear = |i: usize| Linear::new(x[i], v2(&x[i + 1..]));
    Clip {
        chord: linear(0),
        side1: linear(3),
        side3: linear(6),
        curve_sign: x[9],
        lines: [10, 13, 16, 19].map(linear),
        line_sign: x[22],
    }
}

fn turn<R: Real>(x: &[R]) -> Turn<R> {
    Turn { first: v2(x), second: v2(&x[2..]) }
}

fn turn_list<R: Real>(t: &Turn<R>) -> Vec<R> {
    vec![t.first.x, t.first.y, t.second.x, t.second.y]
}

fn clip_list<R: Real>(c: &Clip<R>) -> Vec<R> {
    let linear = |l: &Linear<R>| [l.c, l.x, l.y];
    let mut list: Vec<R> = [c.chord, c.side1, c.side3].iter().flat_map(linear).collect();
    list.push(c.curve_sign);
    list.extend(c.lines.iter().flat_map(linear));
    list.push(c.line_sign);
    list
}

fn turn_none<R: Real>(x: &[R]) -> Vec<R> {
    turn_list(&Turn::none(x[0]))
}
fn turn_apply<R: Real>(x: &[R]) -> Vec<R> {
    let p = turn(x).apply(v2(&x[4..]));
    vec![p.x, p.y]
}
fn turn_after<R: Real>(x: &[R]) -> Vec<R> {
    turn_list(&turn(x).after(&turn(&x[4..])))
}
fn through<R: Real>(x: &[R]) -> Vec<R> {
    clip_list(&clip(x).through(&coefficients(&x[23..]), &turn(&x[32..])))
}
fn curve_keeps<R: Real>(x: &[R]) -> Vec<R> {
    flag(clip(x).curve_keeps(v2(&x[23..])), x[0])
}
fn lines_keep<R: Real>(x: &[R]) -> Vec<R> {
    flag(clip(x).lines_keep(v2(&x[23..])), x[0])
}
fn keeps<R: Real>(x: &[R]) -> Vec<R> {
    flag(clip(x).keeps(v2(&x[23..])), x[0])
}
fn adjust_axes_turned(x: &[f64]) -> Vec<f64> {
    let (s, t, turn) = filter::adjust_axes_turned(&splat(x), true);
    [vec![s.x, s.y, s.z, t.x, t.y, t.z], turn_list(&turn)].concat()
}

/// Returns the size to which errors of an output group of `adjust_axes_turned` are relative. Groups 0 and 1 are the
/// half-axes s and t, group 2 is the rotation. The size grows where rounding does: the rotation of an ellipse is
/// ill-conditioned if its axes are nearly equal, and that of a disk if the disk faces the eye.
fn adjust_terms(x: &[f64], group: usize) -> f64 {
    let length = |v: &[f64]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
    let (s, t) = (length(&x[3..6]), length(&x[6..9]));
    let p = v3(x);
    let sine = p.cross(v3(&x[9..])).length() / p.length();
    let scale = if group < 2 { s.max(t) } else { 1.0 };
    4.0 * scale / if (s - t).abs() > 1e-2 * s { (s - t).abs() / s } else { sine }
}

/// Returns the size to which errors of an output group are relative. Products of a form's coefficients with the rotated
/// gradients may cancel.
fn through_terms(x: &[f64], group: usize) -> f64 {
    let first = [0, 3, 6, 9, 10, 13, 16, 19, 22][group];
    if matches!(group, 3 | 8) {
        return 0.0;
    }
    let largest = |x: &[f64]| x.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    largest(&x[first..first + 3]) * largest(&x[23..32]) * 2.0
}

fn turned_terms(x: &[f64], _: usize) -> f64 {
    x.iter().fold(0.0f64, |a, b| a.max(b.abs())).powi(2)
}

/// Returns the 23 numbers of a clip with a curve, whose middle control point has this weight, and up to four lines.
fn random_clip(random: &mut Random, weight: f64) -> Vec<f32> {
    let (theta1, theta3) = (random.range(0.0, 6.3), random.range(0.0, 6.3));
    let p2 = V2::new(random.signed() * 1.5, random.signed() * 1.5);
    let lines: Vec<[f64; 3]> = (0..random.range(0.0, 4.99) as usize)
        .map(|_| [random.signed(), random.signed(), random.range(-0.2, 1.0)])
        .collect();
    let any = random.signed() < 0.0;
    f32s(&clip_list(
        &Clip::nothing().with_lines(&lines, any).with_curve(&Curve::from_angles(theta1, theta3, p2, weight)),
    ))
}

/// Returns a clip and a point of the disk's bounding square, far enough from the curve and the lines that rounding
/// doesn't move it across. The curve's weight is 10^-`reach` to 10^`reach`.
fn clear_of_the_curve(random: &mut Random, reach: f64) -> Vec<f32> {
    loop {
        let weight = 10f64.powf(random.range(-reach, reach));
        let mut x = random_clip(random, weight);
        x.extend(f32s(&[random.signed(), random.signed()]));
        let wide: Vec<f64> = x.iter().map(|&v| v.into()).collect();
        let (clip, at) = (clip(&wide), v2(&wide[23..]));
        let around = |k: f64| {
            let (sin, cos) = (k * 0.5).sin_cos();
            at + V2::new(cos, sin) * 2e-3
        };
        let is_clear = |kept: fn(&Clip<f64>, V2<f64>) -> bool| {
            (0..13).all(|k| kept(&clip, around(f64::from(k))) == kept(&clip, at))
        };
        if is_clear(Clip::curve_keeps) && is_clear(Clip::lines_keep) {
            return x;
        }
    }
}

fn through_input(random: &mut Random, footprint: fn(&mut Random) -> Vec<f32>) -> Vec<f32> {
    let mut x = random_clip(random, 1.0);
    x.extend(&footprint(random)[..9]);
    let (sin, cos) = random.range(0.0, 6.3).sin_cos();
    let side = if random.signed() < 0.0 { -1.0 } else { 1.0 };
    x.extend(f32s(&[cos, sin, -sin * side, cos * side]));
    x
}

pub(crate) const KERNELS: &[Kernel] = &[
    kernel!("turn_none", 1 => &[2, 2], turn_none, "let t = turn_none();",
        "t.first.x; t.first.y; t.second.x; t.second.y + 0.0 * x0", inputs::numbers::<1>, inputs::numbers::<1>, None),
    kernel!("turn_apply", 6 => &[2], turn_apply,
        "let p = turn_apply(Turn(vec2f(x0, x1), vec2f(x2, x3)), vec2f(x4, x5));", "p.x; p.y", inputs::numbers::<6>,
        inputs::wild::<6>, Some(turned_terms)),
    kernel!("turn_after", 8 => &[2, 2], turn_after,
        "let t = turn_after(Turn(vec2f(x0, x1), vec2f(x2, x3)), Turn(vec2f(x4, x5), vec2f(x6, x7)));",
        "t.first.x; t.first.y; t.second.x; t.second.y", inputs::numbers::<8>, inputs::wild::<8>, Some(turned_terms)),
    kernel!("clip_through", 36 => &[3, 3, 3, 1, 3, 3, 3, 3, 1], through,
        "let clip = Clip(Linear(x0, x1, x2), Linear(x3, x4, x5), Linear(x6, x7, x8), x9, array<Linear, 4>(Linear(x10, \
         x11, x12),
             Linear(x13, x14, x15), Linear(x16, x17, x18), Linear(x19, x20, x21)), x22);
         let c = clip_through(clip, Footprint(Linear(x23, x24, x25), Linear(x26, x27, x28), Linear(x29, x30, x31)),
             Turn(vec2f(x32, x33), vec2f(x34, x35)));",
        "c.chord.c; c.chord.x; c.chord.y; c.side1.c; c.side1.x; c.side1.y; c.side3.c; c.side3.x; c.side3.y; \
         c.curve_sign;
         c.lines[0].c; c.lines[0].x; c.lines[0].y; c.lines[1].c; c.lines[1].x; c.lines[1].y; c.lines[2].c; c.lines[2].x;
         c.lines[2].y; c.lines[3].c; c.lines[3].x; c.lines[3].y; c.line_sign",
        |r| through_input(r, inputs::footprint), |r| through_input(r, inputs::wild_footprint), Some(through_terms)),
    kernel!("clip_curve_keeps", 25 => &[1], curve_keeps, CLIP, "flag(clip_curve_keeps(clip, vec2f(x23, x24)))",
        |r| clear_of_the_curve(r, 0.5), |r| clear_of_the_curve(r, 6.0), None),
    kernel!("clip_lines_keep", 25 => &[1], lines_keep, CLIP, "flag(clip_lines_keep(clip, vec2f(x23, x24)))",
        |r| clear_of_the_curve(r, 0.5), |r| clear_of_the_curve(r, 6.0), None),
    kernel!("clip_keeps", 25 => &[1], keeps, CLIP, "flag(clip_keeps(clip, vec2f(x23, x24)))",
        |r| clear_of_the_curve(r, 0.5), |r| clear_of_the_curve(r, 6.0), None),
    wide!("adjust_axes_turned", 12 => &[3, 3, 2, 2], adjust_axes_turned,
        "let a = adjust_axes_turned(ViewSplat(vec3f(x0, x1, x2), vec3f(x3, x4, x5), vec3f(x6, x7, x8), vec3f(x9, x10, \
         x11)), true);",
        "a.axes.s.x; a.axes.s.y; a.axes.s.z; a.axes.t.x; a.axes.t.y; a.axes.t.z;
         a.turn.first.x; a.turn.first.y; a.turn.second.x; a.turn.second.y",
        inputs::clear_ellipse, inputs::tilted_disk, Some(adjust_terms)),
];
