//! Kernels (formulas that the tests compare) of balls and dots.

use super::inputs::{Random, f32s};
use super::kernels::{Kernel, ORTHOGRAPHIC, PERSPECTIVE, flag, sum, v2};
use surfel_math::Real;
use surfel_math::ball::{BallHit, Outline, Rounded, segment};

/// WGSL statement that makes an outline from the first four inputs.
const OUTLINE: &str = "let o = Outline(vec2f(x0, x1), x2, x3);";

fn outline<R: Real>(x: &[R]) -> Outline<R> {
    Outline { center: v2(&[x[0].zero(), x[0].zero()]), extent: v2(x), skew: x[2], width: x[3] }
}
fn segment_of<R: Real>(x: &[R]) -> Vec<R> {
    vec![segment(x[0])]
}
fn contains<R: Real>(x: &[R]) -> Vec<R> {
    flag(outline(x).contains(v2(&x[4..])), x[0])
}
fn coverage<R: Real>(x: &[R]) -> Vec<R> {
    vec![outline(x).coverage::<Rounded>(v2(&x[4..]))]
}
fn coverage_of_large<R: Real>(x: &[R]) -> Vec<R> {
    vec![outline(x).coverage_of_large(v2(&x[4..]))]
}
fn rounding<R: Real>(x: &[R]) -> Vec<R> {
    vec![outline(x).rounding()]
}
fn hit_perspective<R: Real>(x: &[R]) -> Vec<R> {
    hit_list(BallHit::new(v2(x), x[2], v2(&x[3..]), &PERSPECTIVE))
}
fn hit_orthographic<R: Real>(x: &[R]) -> Vec<R> {
    hit_list(BallHit::new(v2(x), x[2], v2(&x[3..]), &ORTHOGRAPHIC))
}
fn hit_list<R: Real>(hit: BallHit<R>) -> Vec<R> {
    vec![hit.depth, hit.normal.x, hit.normal.y, hit.normal.z]
}

/// Returns the four numbers of an outline with half extents in the range `extents`, in pixels, and a point. The point's
/// distance from the centre is a multiple, in the range `at`, of the outline's own distance in the same direction.
fn point_of(random: &mut Random, extents: [f64; 2], at: [f64; 2]) -> Vec<f32> {
    let skew: f64 = random.range(-0.6, 0.6);
    let [a, b] = [random.range(extents[0], extents[1]), random.range(extents[0], extents[1])];
    let (sin, cos) = random.range(0.0, 6.3).sin_cos();
    let (width, by) = ((1.0 - skew * skew).sqrt(), random.range(at[0], at[1]));
    let (u, v) = (by * cos, by * sin);
    f32s(&[a, b, skew, width, a * (skew * v + width * u), b * v])
}
fn inside_or_outside(random: &mut Random) -> Vec<f32> {
    let at = if random.signed() < 0.0 { [0.1, 0.95] } else { [1.05, 3.0] };
    point_of(random, [0.1, 40.0], at)
}
/// Returns an outline that covers no pixel wholly, and the upper left corner of a pixel that it touches.
fn small(random: &mut Random) -> Vec<f32> {
    let mut x = point_of(random, [0.05, 0.55], [0.0, 1.2]);
    x[4] -= random.range(0.0, 1.0) as f32;
    x[5] -= random.range(0.0, 1.0) as f32;
    x
}
fn tiny(random: &mut Random) -> Vec<f32> {
    let mut x = point_of(random, [1e-4, 0.05], [0.0, 1.2]);
    x[4] -= random.range(0.0, 1.0) as f32;
    x[5] -= random.range(0.0, 1.0) as f32;
    x
}
/// Returns a large outline, and the upper left corner of a pixel that its border crosses.
fn large(random: &mut Random) -> Vec<f32> {
    let mut x = point_of(random, [40.0, 400.0], [1.0, 1.0]);
    x[4] -= 0.5;
    x[5] -= 0.5;
    x
}
/// Returns the slope of a ball's centre, its size, and an offset inside its outline.
fn ball_and_offset(random: &mut Random, sizes: [f64; 2]) -> Vec<f32> {
    let size = 10f64.powf(random.range(sizes[0], sizes[1]));
    let (sin, cos) = random.range(0.0, 6.3).sin_cos();
    let by = size * random.range(0.05, 0.6);
    f32s(&[0.6 * random.signed(), 0.6 * random.signed(), size, by * cos, by * sin])
}
/// Returns the size to which errors of a coverage are relative: that of the whole ellipse's area.
fn area(x: &[f64], _: usize) -> f64 {
    16.0 * (x[0] * x[1])
}
fn across(x: &[f64], _: usize) -> f64 {
    4.0 * x[0].max(x[1])
}
fn one(_: &[f64], _: usize) -> f64 {
    16.0
}

pub(crate) const KERNELS: &[Kernel] = &[
    kernel!("ball_segment", 1 => &[1], segment_of, "", "ball_segment(x0)", |r| f32s(&[r.signed()]),
        |r| f32s(&[1.0 - 10f64.powf(r.range(-7.0, 0.0))]), Some(one)),
    kernel!("outline_contains", 6 => &[1], contains, OUTLINE, "flag(outline_contains(o, vec2f(x4, x5)))",
        inside_or_outside, inside_or_outside, None),
    kernel!("outline_coverage", 6 => &[1], coverage, OUTLINE, "outline_coverage(o, vec2f(x4, x5))", small, tiny,
        Some(area)),
    kernel!("outline_coverage_of_large", 6 => &[1], coverage_of_large, OUTLINE,
        "outline_coverage_of_large(o, vec2f(x4, x5))", large, large, Some(across)),
    kernel!("outline_rounding", 6 => &[1], rounding, OUTLINE, "outline_rounding(o)", small, large, None),
    kernel!("ball_hit_new/perspective", 5 => &[1, 3], hit_perspective,
        "let b = ball_hit_new(vec2f(x0, x1), x2, vec2f(x3, x4), Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), \
         0.01, 3e38, 0.0, PERSPECTIVE));",
        "b.depth; b.normal.x; b.normal.y; b.normal.z", |r| ball_and_offset(r, [-2.0, -0.5]),
        |r| ball_and_offset(r, [-5.0, -2.0]), Some(one)),
    kernel!("ball_hit_new/orthographic", 5 => &[1, 3], hit_orthographic,
        "let b = ball_hit_new(vec2f(x0, x1), x2, vec2f(x3, x4), Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), \
         0.01, 100.0, 4.0, ORTHOGRAPHIC));",
        "b.depth; b.normal.x; b.normal.y; b.normal.z", |r| ball_and_offset(r, [-2.0, 1.0]),
        |r| ball_and_offset(r, [-5.0, 4.0]), Some(one)),
];
