//! Kernels (formulas that the tests compare) of triangles, slopes of planes, the shaders `toon`, `matcap` and `edl`,
//! and trained Gaussians.

use super::inputs::{self, Random, f32s};
use super::kernels::{Kernel, ORTHOGRAPHIC, PERSPECTIVE, flag, sum, v2, v3};
use surfel_math::mapping::Linear;
use surfel_math::triangle::Triangle;
use surfel_math::{Real, V2, V3, depth, eye_dome, facing, gaussian, matcap, shadow, srgb, toon, triangle};

/// WGSL statement that makes a triangle from the first twelve inputs.
const TRIANGLE: &str = "let t = Triangle(array<Linear, 3>(Linear(x0, x1, x2), Linear(x3, x4, x5), Linear(x6, x7, x8)), \
 vec3f(x9, x10, x11));";

fn triangle<R: Real>(x: &[R]) -> Triangle<R> {
    let linear = |i: usize| Linear::new(x[i], v2(&x[i + 1..]));
    Triangle { edges: [0, 3, 6].map(linear), z: [x[9], x[10], x[11]] }
}

fn contains<R: Real>(x: &[R]) -> Vec<R> {
    flag(triangle(x).contains(v2(&x[12..])), x[0])
}
fn barycentric<R: Real>(x: &[R]) -> Vec<R> {
    triangle(x).barycentric(v2(&x[12..])).to_vec()
}
fn triangle_depth<R: Real>(x: &[R]) -> Vec<R> {
    vec![triangle(x).depth([x[12], x[13], x[14]])]
}
fn gradient<R: Real>(x: &[R]) -> Vec<R> {
    let g = triangle(x).gradient([x[14], x[15], x[16]], x[17], v2(&x[12..]));
    vec![g.x, g.y]
}
fn interpolate<R: Real>(x: &[R]) -> Vec<R> {
    vec![triangle::interpolate([x[0], x[1], x[2]], [x[3], x[4], x[5]])]
}
fn gradient_perspective<R: Real>(x: &[R]) -> Vec<R> {
    let g = depth::plane_gradient(v3(x), v3(&x[3..]), &PERSPECTIVE);
    vec![g.x, g.y]
}
fn gradient_orthographic<R: Real>(x: &[R]) -> Vec<R> {
    let g = depth::plane_gradient(v3(x), v3(&x[3..]), &ORTHOGRAPHIC);
    vec![g.x, g.y]
}
fn nearness<R: Real>(x: &[R]) -> Vec<R> {
    [false, true].map(|back_facing| facing::nearness(x[0], x[1], back_facing)).to_vec()
}
fn sheet_limit<R: Real>(x: &[R]) -> Vec<R> {
    vec![facing::sheet_limit(x[0], x[1])]
}
fn back_normal<R: Real>(x: &[R]) -> Vec<R> {
    let V3 { x, y, z } = facing::back_normal(v3(x), x[3], v3(&x[4..]));
    vec![x, y, z]
}
/// Returns a shading normal, the cosine of the angle between a back-facing splat's normal and the direction to the eye,
/// and that direction.
fn at_a_rim(random: &mut Random) -> Vec<f32> {
    let cosine = [random.range(0.0, 0.173), random.range(0.174, 1.0)][usize::from(random.signed() < 0.0)];
    f32s(&[random.direction().to_vec(), vec![-cosine], random.direction().to_vec()].concat())
}
fn smoothstep<R: Real>(x: &[R]) -> Vec<R> {
    vec![toon::smoothstep(x[0], 0.25, 0.5)]
}
fn ramp<R: Real>(x: &[R]) -> Vec<R> {
    vec![toon::ramp(x[0])]
}
fn highlight<R: Real>(x: &[R]) -> Vec<R> {
    vec![toon::highlight(x[0])]
}
fn line<R: Real>(x: &[R]) -> Vec<R> {
    vec![toon::line(x[0])]
}
fn limit<R: Real>(x: &[R]) -> Vec<R> {
    vec![toon::step_back_limit(x[0], v2(&x[1..]), &PERSPECTIVE)]
}

fn on_ball<R: Real>(x: &[R]) -> Vec<R> {
    let at = matcap::coordinates(v3(x), v3(&x[3..]), v3(&x[6..]));
    vec![at.x, at.y]
}
fn rise_weight<R: Real>(x: &[R]) -> Vec<R> {
    vec![eye_dome::rise_weight(v2(x), &PERSPECTIVE)]
}
fn brightness<R: Real>(x: &[R]) -> Vec<R> {
    vec![eye_dome::brightness(x[0], x[1], &PERSPECTIVE), eye_dome::brightness(x[0], x[1], &ORTHOGRAPHIC)]
}
fn gaussian_forms<R: Real>(x: &[R]) -> Vec<R> {
    let forms = gaussian::GaussianForms {
        u: [x[0], x[1]],
        v: [x[2], x[3]],
        w: [x[4], x[5], x[6]],
        z: [x[7], x[8], x[9]],
        low_pass: x[10],
    };
    let (rho, z) = forms.at(v2(&x[11..]));
    vec![rho, z]
}
/// Returns forms of a Gaussian, and an offset at which it is visible. Denominators are clear of 0.
fn gaussian_inputs(random: &mut Random) -> Vec<f32> {
    let mut x: Vec<f64> = (0..4).map(|_| random.wild(2.0)).collect();
    x.extend([1e-3 * random.signed(), 1e-3 * random.signed(), random.range(0.2, 1.0)]);
    x.extend([1e-2 * random.signed(), 1e-2 * random.signed(), random.range(0.2, 9.0)]);
    x.extend([if random.signed() < 0.0 { 2.0 } else { 1e30 }, 20.0 * random.signed(), 20.0 * random.signed()]);
    f32s(&x)
}
/// Returns the size to which errors of an output group are relative. Sums of products may cancel.
fn gaussian_terms(x: &[f64], group: usize) -> f64 {
    let [dx, dy] = [x[11].abs(), x[12].abs()];
    let sum = |f: &[f64]| f[0].abs() * dx + f[1].abs() * dy + f.get(2).map_or(0.0, |c| c.abs());
    let w = x[4] * x[11] + x[5] * x[12] + x[6];
    let per_w = sum(&x[4..7]) / (w * w);
    match group {
        0 => (sum(&x[..2]) * per_w).powi(2) + (sum(&x[2..4]) * per_w).powi(2),
        _ => sum(&x[7..10]) * per_w,
    }
}
fn limited_color<R: Real>(x: &[R]) -> Vec<R> {
    vec![srgb::limit_color(x[0])]
}
fn distortion_depth<R: Real>(x: &[R]) -> Vec<R> {
    vec![gaussian::distortion_depth(x[0])]
}
/// Returns the size to which errors of an output are relative. Products of unit vectors may cancel, the more the nearer
/// the view direction is to straight down.
fn ball_terms(x: &[f64], _: usize) -> f64 {
    1.0 / v3(&x[3..]).cross(v3(&x[6..])).length().max(1e-9)
}
fn three_directions(random: &mut Random) -> Vec<f32> {
    f32s(&[random.direction(), random.direction(), random.direction()].concat())
}

fn lookup_bias<R: Real>(x: &[R]) -> Vec<R> {
    vec![shadow::lookup_bias(x[0], &PERSPECTIVE), shadow::lookup_bias(x[0], &ORTHOGRAPHIC)]
}
fn tap_weights<R: Real>(x: &[R]) -> Vec<R> {
    shadow::tap_weights(x[0]).to_vec()
}
fn taps(x: &[f64]) -> Vec<f64> {
    let (first, weights) = shadow::taps(x[0]);
    [vec![first], weights.to_vec()].concat()
}
fn slope_allowance(x: &[f64]) -> Vec<f64> {
    vec![depth::slope_allowance(x[0], V2::new(x[1], x[2]), &PERSPECTIVE)]
}
fn step_allowance(x: &[f64]) -> Vec<f64> {
    [PERSPECTIVE, ORTHOGRAPHIC].map(|p| depth::step_allowance(x[0], V2::new(x[1], x[2]), &p)).to_vec()
}
/// Returns the size to which errors of the outputs are relative: that of the position, which is rounded.
fn taps_terms(x: &[f64], _: usize) -> f64 {
    x[0].abs()
}
/// Returns a position in texels that isn't near the middle of a texel, since rounding may there decide either way.
fn texel(random: &mut Random, size: f64) -> Vec<f32> {
    f32s(&[(size * random.signed()).floor() + 0.5 + random.range(0.01, 0.99)])
}

/// Returns the factor by which errors grow: the sum of the absolute terms of the edge values, which may cancel, over
/// the sum of the values.
fn edge_terms(x: &[f64]) -> f64 {
    let edge = |i: usize| [x[i], x[i + 1] * x[12], x[i + 2] * x[13]];
    let terms: f64 = [0, 3, 6].into_iter().flat_map(edge).map(f64::abs).sum();
    let whole: f64 = [0, 3, 6].into_iter().flat_map(edge).sum();
    terms / whole.abs()
}
fn barycentric_terms(x: &[f64], _: usize) -> f64 {
    let b = barycentric(x).iter().fold(1.0f64, |a, b| a.max(b.abs()));
    edge_terms(x) * b
}
fn gradient_terms(x: &[f64], _: usize) -> f64 {
    let largest = |x: &[f64]| x.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    let sum: f64 = [0, 3, 6].into_iter().map(|i| x[i] + x[i + 1] * x[12] + x[i + 2] * x[13]).sum();
    largest(&x[14..18]) * largest(&[x[1], x[2], x[4], x[5], x[7], x[8]]) / sum.abs() * edge_terms(x)
}
fn interpolate_terms(x: &[f64], _: usize) -> f64 {
    (0..3).map(|i| (x[i] * x[i + 3]).abs()).sum()
}
fn depth_terms(x: &[f64], _: usize) -> f64 {
    (0..3).map(|i| (x[i + 9] * x[i + 12]).abs()).sum()
}
/// Returns the size to which errors of the output are relative. Depth and tolerance of either sign may cancel.
fn nearness_terms(x: &[f64], _: usize) -> f64 {
    x[0].abs().max(x[1].abs())
}
/// Returns the size to which errors of the outputs are relative. The terms of the denominator n·p may cancel.
fn plane_terms(x: &[f64], _: usize) -> f64 {
    let (p, n) = (v3(x), v3(&x[3..]));
    let terms: f64 = (0..3).map(|i| (x[i] * x[i + 3]).abs()).sum();
    let steep = n.dot(p).abs().max(0.02 * p.length());
    let g = depth::plane_gradient(p, n, &PERSPECTIVE);
    g.length() * (terms / steep)
}
/// Returns the size to which errors of a step are relative: the largest slope of any step, by which a step multiplies
/// the rounding error of its argument.
fn steep(_: &[f64], _: usize) -> f64 {
    1.5 / 0.04
}

/// Returns edges of a triangle and an offset inside or outside of it, clear of all edges.
fn edges(random: &mut Random, scale: f64) -> Vec<f32> {
    loop {
        let mut x: Vec<f64> = Vec::with_capacity(14);
        for turn in 0..3 {
            let (sin, cos) = (f64::from(turn) * 2.1 + 0.5 * random.signed()).sin_cos();
            let k = scale * random.range(0.5, 2.0);
            x.extend([k * random.range(1.0, 20.0), k * cos, k * sin]);
        }
        x.extend([random.range(1.0, 4.0), random.range(1.0, 4.0), random.range(1.0, 4.0)]);
        x.extend([20.0 * random.signed(), 20.0 * random.signed()]);
        let values = [0, 3, 6].map(|i| x[i] + x[i + 1] * x[12] + x[i + 2] * x[13]);
        if values.iter().all(|v| v.abs() > 1e-3 * scale) && values.iter().sum::<f64>().abs() > 0.1 * scale {
            return f32s(&x);
        }
    }
}
fn with(mut x: Vec<f32>, values: &[f64]) -> Vec<f32> {
    x.extend(f32s(values));
    x
}
fn point_and_normal(random: &mut Random) -> Vec<f32> {
    let z = random.range(1.0, 10.0);
    let n = random.direction();
    f32s(&[0.4 * z * random.signed(), 0.3 * z * random.signed(), z, n[0], n[1], n[2]])
}
fn wild_point_and_normal(random: &mut Random) -> Vec<f32> {
    let z = random.wild(4.0).abs();
    let n = random.direction();
    f32s(&[2.0 * z * random.signed(), 2.0 * z * random.signed(), z, n[0], n[1], n[2]])
}
/// Returns a number between 0 and 1, the range in which `toon` has its steps.
fn share(random: &mut Random) -> Vec<f32> {
    f32s(&[random.range(0.0, 1.0)])
}
fn at_a_step(random: &mut Random) -> Vec<f32> {
    let steps = [0.03, 0.05, 0.07, 0.12, 0.22, 0.33, 0.48, 0.5, 0.52, 0.7];
    let step = steps[(random.range(0.0, 9.99)) as usize];
    f32s(&[step + random.wild(3.0) * 1e-6])
}

pub(crate) const KERNELS: &[Kernel] = &[
    kernel!("triangle_contains", 14 => &[1], contains, TRIANGLE, "flag(triangle_contains(t, vec2f(x12, x13)))",
        |r| edges(r, 1.0), |r| { let k = r.wild(6.0).abs(); edges(r, k) }, None),
    kernel!("triangle_barycentric", 14 => &[3], barycentric, "let t = Triangle(array<Linear, 3>(Linear(x0, x1, x2),
         Linear(x3, x4, x5), Linear(x6, x7, x8)), vec3f(x9, x10, x11)); let b = triangle_barycentric(t, vec2f(x12, \
         x13));",
        "b.x; b.y; b.z", |r| edges(r, 1.0), |r| { let k = r.wild(6.0).abs(); edges(r, k) }, Some(barycentric_terms)),
    kernel!("triangle_depth", 15 => &[1], triangle_depth, TRIANGLE, "triangle_depth(t, vec3f(x12, x13, x14))",
        inputs::numbers::<15>, inputs::wild::<15>, Some(depth_terms)),
    kernel!("triangle_gradient", 18 => &[2], gradient, "let t = Triangle(array<Linear, 3>(Linear(x0, x1, x2),
         Linear(x3, x4, x5), Linear(x6, x7, x8)), vec3f(x9, x10, x11));
         let g = triangle_gradient(t, vec3f(x14, x15, x16), x17, vec2f(x12, x13));", "g.x; g.y",
        |r| { let v = [r.signed(), r.signed(), r.signed(), r.signed()]; with(edges(r, 1.0), &v) },
        |r| { let v = [r.wild(3.0), r.wild(3.0), r.wild(3.0), r.wild(3.0)]; with(edges(r, 1e-4), &v) },
        Some(gradient_terms)),
    kernel!("interpolate", 6 => &[1], interpolate, "", "interpolate(vec3f(x0, x1, x2), vec3f(x3, x4, x5))",
        inputs::numbers::<6>, inputs::wild::<6>, Some(interpolate_terms)),
    kernel!("plane_gradient/perspective", 6 => &[2], gradient_perspective,
        "let g = plane_gradient(vec3f(x0, x1, x2), vec3f(x3, x4, x5),
         Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 3e38, 0.0, PERSPECTIVE));", "g.x; g.y",
        point_and_normal, wild_point_and_normal, Some(plane_terms)),
    kernel!("plane_gradient/orthographic", 6 => &[2], gradient_orthographic,
        "let g = plane_gradient(vec3f(x0, x1, x2), vec3f(x3, x4, x5),
         Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 100.0, 4.0, ORTHOGRAPHIC));", "g.x; g.y",
        point_and_normal, wild_point_and_normal, None),
    kernel!("nearness", 2 => &[1, 1], nearness, "", "nearness(x0, x1, false); nearness(x0, x1, true)",
        inputs::numbers::<2>, inputs::wild::<2>, Some(nearness_terms)),
    kernel!("sheet_limit", 2 => &[1], sheet_limit, "", "sheet_limit(x0, x1)",
        inputs::numbers::<2>, inputs::wild::<2>, Some(nearness_terms)),
    kernel!("back_normal", 7 => &[3], back_normal,
        "let n = back_normal(vec3f(x0, x1, x2), x3, vec3f(x4, x5, x6));", "n.x; n.y; n.z", at_a_rim, at_a_rim, None),
    kernel!("lookup_bias", 1 => &[1, 1], lookup_bias,
        "let p = Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 3e38, 0.0, PERSPECTIVE);
         let o = Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 100.0, 4.0, ORTHOGRAPHIC);",
        "lookup_bias(x0, p); lookup_bias(x0, o)", inputs::numbers::<1>, inputs::wild::<1>, None),
    kernel!("tap_weights", 1 => &[4], tap_weights, "let w = tap_weights(x0);", "w.x; w.y; w.z; w.w", share, share,
    None),
    wide!("taps", 1 => &[1, 4], taps, "let t = taps(x0);",
    "t.first; t.weights.x; t.weights.y; t.weights.z; t.weights.w",
        |r| texel(r, 100.0), |r| texel(r, 1e4), Some(taps_terms)),
    wide!("slope_allowance", 3 => &[1], slope_allowance, "",
        "slope_allowance(x0, vec2f(x1, x2), Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 3e38, 0.0, \
         PERSPECTIVE))",
        |r| f32s(&[r.range(1.0, 10.0), r.signed(), r.signed()]), |r| f32s(&[r.wild(5.0).abs(), r.wild(3.0),
        r.wild(3.0)]), None),
    wide!("step_allowance", 3 => &[1, 1], step_allowance,
        "let p = Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 3e38, 0.0, PERSPECTIVE);
         let o = Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 100.0, 4.0, ORTHOGRAPHIC);",
        "step_allowance(x0, vec2f(x1, x2), p); step_allowance(x0, vec2f(x1, x2), o)",
        |r| f32s(&[r.range(1.0, 10.0), 0.1 * r.signed(), 0.1 * r.signed()]),
        |r| f32s(&[r.wild(5.0).abs(), r.wild(3.0), r.wild(3.0)]), None),
    kernel!("toon_smoothstep", 1 => &[1], smoothstep, "", "toon_smoothstep(x0, 0.25, 0.5)", share, at_a_step,
    Some(steep)),
    kernel!("toon_ramp", 1 => &[1], ramp, "", "toon_ramp(x0)", share, at_a_step, Some(steep)),
    kernel!("toon_highlight", 1 => &[1], highlight, "", "toon_highlight(x0)", share, at_a_step, Some(steep)),
    kernel!("toon_line", 1 => &[1], line, "", "toon_line(x0)", share, at_a_step, Some(steep)),
    kernel!("matcap_coordinates", 9 => &[2], on_ball,
        "let b = matcap_coordinates(vec3f(x0, x1, x2), vec3f(x3, x4, x5), vec3f(x6, x7, x8));", "b.x; b.y",
        three_directions, three_directions, Some(ball_terms)),
    kernel!("eye_dome_rise_weight", 2 => &[1], rise_weight, "",
        "eye_dome_rise_weight(vec2f(x0, x1), Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 3e38, 0.0, \
         PERSPECTIVE))",
        inputs::numbers::<2>, inputs::wild::<2>, None),
    kernel!("eye_dome_brightness", 2 => &[1, 1], brightness,
        "let p = Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 3e38, 0.0, PERSPECTIVE);
         let o = Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 100.0, 4.0, ORTHOGRAPHIC);",
        "eye_dome_brightness(x0, x1, p); eye_dome_brightness(x0, x1, o)",
        |r| f32s(&[r.range(1.0, 10.0), r.range(0.0, 5.0)]), |r| f32s(&[r.wild(4.0).abs(), r.wild(4.0).abs()]), None),
    kernel!("gaussian_forms_at", 13 => &[1, 1], gaussian_forms,
        "let g = gaussian_forms_at(GaussianForms(vec2f(x0, x1), vec2f(x2, x3), vec3f(x4, x5, x6), vec3f(x7, x8, x9), \
         x10), vec2f(x11, x12));",
        "g.x; g.y", gaussian_inputs, gaussian_inputs, Some(gaussian_terms)),
    wide!("depth_step_f32", 1 => &[1], |x: &[f64]| vec![f64::from(gaussian::depth_step_f32(x[0] as f32))], "",
        "f32(depth_step_f32(x0))", |r| f32s(&[r.range(0.2, 9.0)]), |r| f32s(&[r.wild(9.0).abs()]), None),
    kernel!("distortion_depth", 1 => &[1], distortion_depth, "", "distortion_depth(x0)",
        |r| f32s(&[r.range(0.2, 9.0)]), |r| f32s(&[0.2 + r.wild(4.0).abs()]), Some(|_, _| 1.0)),
    kernel!("limit_color", 1 => &[1], limited_color, "", "limit_color(x0)", inputs::numbers::<1>,
        |r| f32s(&[(2e38 * r.wild(1.0)).clamp(-3.4e38, 3.4e38)]), None),
    // A power is exp2(2.4·log2 x) in WGSL; below 1 its logarithm is off by at most 2⁻²¹.
    wide!("srgb_decode", 1 => &[1], |x: &[f64]| vec![srgb::decode(x[0])], "", "srgb_decode(x0)", share, share,
        Some(|_, _| 1.0)),
    kernel!("toon_step_back_limit", 3 => &[1], limit, "",
        "toon_step_back_limit(x0, vec2f(x1, x2), Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 3e38, \
         0.0, PERSPECTIVE))",
        |r| f32s(&[r.range(1.0, 10.0), r.signed(), r.signed()]), |r| f32s(&[r.wild(5.0).abs(), r.wild(3.0),
        r.wild(3.0)]), None),
];
