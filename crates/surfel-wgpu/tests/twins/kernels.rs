//! Kernels: formulas as functions of plain numbers, in WGSL and in Rust over `Real`.

use super::inputs::{self, Random, f32s};
use surfel_math::clip::Turn;
use surfel_math::depth::{DepthForm, DepthPlane, Tolerance, tolerance as epsilon};
use surfel_math::filter::{self, Filtered};
use surfel_math::mapping::{Footprint, Linear};
use surfel_math::project::{Projected, ViewSplat, radius_max as largest_radius};
use surfel_math::projection::{Projection, ProjectionKind};
use surfel_math::svd::Svd2;
use surfel_math::{Real, V2, V3, basis, bounds, kernel, quantise};

/// Formula that both the CPU and a GPU run.
pub(crate) struct Kernel {
    /// Name of the WGSL function. If a function has several kernels, the branch that the inputs select follows after a
    /// slash.
    pub name: &'static str,
    /// Number of inputs: x0, x1 … in WGSL.
    pub inputs: usize,
    /// Number of outputs.
    pub outputs: usize,
    /// Lengths of the output groups: each is a vector, or a number of its own.
    pub workgroups: &'static [usize],
    /// WGSL statements before the results.
    pub wgsl: &'static str,
    /// WGSL expressions of the results, separated by semicolons.
    pub results: &'static str,
    /// Twin in f32.
    pub rounded: fn(&[f32]) -> Vec<f32>,
    /// Twin in f64, whose results count as exact.
    pub exact: fn(&[f64]) -> Vec<f64>,
    /// Generator of ordinary inputs.
    pub ordinary: fn(&mut Random) -> Vec<f32>,
    /// Generator of inputs at which rounding matters.
    pub adversarial: fn(&mut Random) -> Vec<f32>,
    /// Function that returns the size to which errors of an output group are relative, from the inputs and the group's
    /// index. It is for sums that may cancel, and for results as uncertain as their inputs. Errors are relative to the
    /// group's largest output if that is larger, or if this is `None`.
    pub scale: Option<fn(&[f64], usize) -> f64>,
}

macro_rules! kernel {
    ($name:literal, $inputs:literal => $workgroups:expr, $f:ident, $wgsl:expr, $results:literal, $ordinary:expr,
     $adversarial:expr, $scale:expr) => {
        Kernel { rounded: $f::<f32>, ..wide!($name, $inputs => $workgroups, $f::<f64>, $wgsl, $results, $ordinary,
        $adversarial, $scale) }
    };
}

/// Defines a kernel whose twin exists in f64 alone: the CPU's error is that of rounding the result.
macro_rules! wide {
    ($name:literal, $inputs:literal => $workgroups:expr, $f:expr, $wgsl:expr, $results:literal, $ordinary:expr,
     $adversarial:expr, $scale:expr) => {
        Kernel {
            name: $name,
            inputs: $inputs,
            outputs: sum($workgroups),
            workgroups: $workgroups,
            wgsl: $wgsl,
            results: $results,
            rounded: |x| f32s(&$f(&x.iter().map(|&v| v.into()).collect::<Vec<f64>>())),
            exact: $f,
            ordinary: $ordinary,
            adversarial: $adversarial,
            scale: $scale,
        }
    };
}

pub(crate) const fn sum(lengths: &[usize]) -> usize {
    let (mut total, mut i) = (0, 0);
    while i < lengths.len() {
        total += lengths[i];
        i += 1;
    }
    total
}

pub(crate) const PERSPECTIVE: Projection = Projection {
    kind: ProjectionKind::Perspective,
    focal_px: [700.0, 650.0],
    principal_px: [320.5, 240.25],
    near: 0.01,
};
pub(crate) const ORTHOGRAPHIC: Projection =
    Projection { kind: ProjectionKind::Orthographic { height: 4.0, far: 100.0 }, ..PERSPECTIVE };

pub(crate) fn v2<R: Real>(x: &[R]) -> V2<R> {
    V2::new(x[0], x[1])
}

pub(crate) fn v3<R: Real>(x: &[R]) -> V3<R> {
    V3::new(x[0], x[1], x[2])
}

fn list3<R: Real>(v: V3<R>) -> Vec<R> {
    vec![v.x, v.y, v.z]
}

pub(crate) fn flag<R: Real>(mask: R::Mask, like: R) -> Vec<R> {
    vec![R::select(mask, like.one(), like.zero())]
}

pub(crate) fn splat<R: Real>(x: &[R]) -> ViewSplat<R> {
    ViewSplat { p: v3(x), s: v3(&x[3..]), t: v3(&x[6..]), n: v3(&x[9..]) }
}

/// Returns a `Projected` from its fields in order. The last input, which isn't read here, is the filter radius h.
fn fields<R: Real>(x: &[R]) -> Projected<R> {
    Projected {
        j_s: v2(x),
        j_t: v2(&x[2..]),
        det_j: x[4],
        slope: v2(&x[5..]),
        depth_gradient: v2(&x[7..]),
        depth_extent: x[9],
        facing: x[10],
        facing_cosine: x[11],
    }
}

pub(crate) fn coefficients<R: Real>(x: &[R]) -> Footprint<R> {
    let linear = |i: usize| Linear::new(x[i], v2(&x[i + 1..]));
    Footprint { u: linear(0), v: linear(3), w: linear(6) }
}

fn gradients<R: Real>(f: &Footprint<R>) -> Vec<R> {
    vec![f.u.x, f.u.y, f.v.x, f.v.y, f.w.x, f.w.y]
}

fn filtered<R: Real>(f: &Filtered<R>) -> Vec<R> {
    let mut list = gradients(&f.footprint);
    let Turn { first, second } = f.turn;
    list.extend([f.weight_scale, f.coverage_scale, first.x, first.y, second.x, second.y]);
    list
}

fn box_of<R: Real>(e: bounds::Extent<R>) -> Vec<R> {
    vec![e.min.x, e.min.y, e.max.x, e.max.y]
}

fn projected_list<R: Real>(p: &Projected<R>) -> Vec<R> {
    let (g, s) = (p.depth_gradient, p.slope);
    let list = [p.j_s.x, p.j_s.y, p.j_t.x, p.j_t.y, p.det_j, s.x, s.y, g.x, g.y, p.depth_extent, p.facing];
    list.into_iter().chain([p.facing_cosine]).collect()
}

fn difference_of_products<R: Real>(x: &[R]) -> Vec<R> {
    vec![R::difference_of_products(x[0], x[1], x[2], x[3])]
}
fn sum_of_products<R: Real>(x: &[R]) -> Vec<R> {
    vec![R::sum_of_products(x[0], x[1], x[2], x[3])]
}
fn v2_dot<R: Real>(x: &[R]) -> Vec<R> {
    vec![v2(x).dot(v2(&x[2..]))]
}
fn v2_cross<R: Real>(x: &[R]) -> Vec<R> {
    vec![v2(x).cross(v2(&x[2..]))]
}
fn v2_length<R: Real>(x: &[R]) -> Vec<R> {
    vec![v2(x).length()]
}
fn v3_dot<R: Real>(x: &[R]) -> Vec<R> {
    vec![v3(x).dot(v3(&x[3..]))]
}
fn v3_cross<R: Real>(x: &[R]) -> Vec<R> {
    list3(v3(x).cross(v3(&x[3..])))
}
fn v3_length<R: Real>(x: &[R]) -> Vec<R> {
    vec![v3(x).length()]
}
fn v3_max_abs<R: Real>(x: &[R]) -> Vec<R> {
    vec![v3(x).max_abs()]
}
fn unit(x: &[f64]) -> Vec<f64> {
    basis::unit(glam::DVec3::new(x[0], x[1], x[2])).to_array().to_vec()
}
fn orthonormal(x: &[f64]) -> Vec<f64> {
    let (s, t) = basis::orthonormal(glam::DVec3::new(x[0], x[1], x[2]));
    [s.to_array(), t.to_array()].concat()
}
fn unfolded<R: Real>(x: &[R]) -> Vec<R> {
    let v = quantise::unfolded(x[0], x[1]);
    vec![v.x, v.y, v.z]
}
fn svd<R: Real>(x: &[R]) -> Vec<R> {
    let svd = Svd2::of_columns(v2(x), v2(&x[2..]), x[4]);
    vec![svd.major, svd.minor, svd.major_axis.x, svd.major_axis.y]
}
fn singular_values<R: Real>(x: &[R]) -> Vec<R> {
    svd(x)[..2].to_vec()
}
fn minor_axis<R: Real>(x: &[R]) -> Vec<R> {
    let axis = Svd2 { major: x[0], minor: x[0], major_axis: v2(x) }.minor_axis();
    vec![axis.x, axis.y]
}
fn projected_perspective<R: Real>(x: &[R]) -> Vec<R> {
    projected_list(&Projected::new(&splat(x), &PERSPECTIVE))
}
fn projected_orthographic<R: Real>(x: &[R]) -> Vec<R> {
    projected_list(&Projected::new(&splat(x), &ORTHOGRAPHIC))
}
fn is_edge_on<R: Real>(x: &[R]) -> Vec<R> {
    let facing_cosine = x[0];
    let zero = V2::new(x[0], x[0]);
    let p = Projected {
        j_s: zero,
        j_t: zero,
        det_j: x[0],
        slope: zero,
        depth_gradient: zero,
        depth_extent: x[0],
        facing: x[0],
        facing_cosine,
    };
    flag(p.is_edge_on(), x[0])
}
fn radius_max<R: Real>(x: &[R]) -> Vec<R> {
    vec![largest_radius(v3(x), v3(&x[3..]))]
}
fn offset_perspective<R: Real>(x: &[R]) -> Vec<R> {
    let d = PERSPECTIVE.offset_from(v3(x), v2(&x[3..]));
    vec![d.x, d.y]
}
fn offset_orthographic<R: Real>(x: &[R]) -> Vec<R> {
    let d = ORTHOGRAPHIC.offset_from(v3(x), v2(&x[3..]));
    vec![d.x, d.y]
}
fn linear_new<R: Real>(x: &[R]) -> Vec<R> {
    let l = Linear::new(x[0], v2(&x[1..]));
    vec![l.c, l.x, l.y]
}
fn linear_at<R: Real>(x: &[R]) -> Vec<R> {
    vec![Linear::new(x[0], v2(&x[1..])).at(v2(&x[3..]))]
}
fn footprint_at<R: Real>(x: &[R]) -> Vec<R> {
    let (u, v, w) = coefficients(x).at(v2(&x[9..]));
    vec![u, v, w]
}
fn footprint_contains<R: Real>(x: &[R]) -> Vec<R> {
    flag(coefficients(x).contains(v2(&x[9..])), x[0])
}
fn about_center<R: Real>(x: &[R]) -> Vec<R> {
    gradients(&Footprint::about_center(v2(x), v2(&x[2..]), x[4], v2(&x[5..])))
}
fn unfiltered_projective<R: Real>(x: &[R]) -> Vec<R> {
    gradients(&Footprint::unfiltered(&fields(x), true))
}
fn unfiltered_affine<R: Real>(x: &[R]) -> Vec<R> {
    gradients(&Footprint::unfiltered(&fields(x), false))
}
fn unfiltered<R: Real>(x: &[R]) -> Vec<R> {
    filtered(&Filtered::unfiltered(coefficients(x)))
}
fn principal<R: Real>(x: &[R]) -> Vec<R> {
    filtered(&filter::principal(&fields(x), x[12], true))
}
fn ewa<R: Real>(x: &[R]) -> Vec<R> {
    filtered(&filter::ewa(&fields(x), x[12]))
}
fn area_ratio<R: Real>(x: &[R]) -> Vec<R> {
    vec![filter::area_ratio(&fields(x), x[12])]
}
fn adjust<R: Real>(x: &[R]) -> Vec<R> {
    filtered(&filter::adjust(&fields(x), x[12], true))
}
fn bounds_ellipse<R: Real>(x: &[R]) -> Vec<R> {
    box_of(bounds::ellipse(v2(x), v2(&x[2..]), v2(&x[5..])))
}
fn bounds_unfiltered<R: Real>(x: &[R]) -> Vec<R> {
    box_of(bounds::unfiltered(&fields(x), true))
}
fn bounds_footprint<R: Real>(x: &[R]) -> Vec<R> {
    let (zero, one) = (x[0].zero(), x[0].one());
    let linear = |c, i: usize| Linear::new(c, v2(&x[i..]));
    box_of(bounds::footprint(&Footprint { u: linear(zero, 0), v: linear(zero, 2), w: linear(one, 4) }))
}
fn plane<R: Real>(x: &[R]) -> DepthPlane<R> {
    DepthPlane { scale: x[0], gradient: v2(&x[1..]), at_anchor: x[0].one(), z_min: x[3], z_max: x[4] }
}
fn depth_reciprocal<R: Real>(x: &[R]) -> Vec<R> {
    vec![plane(x).at(v2(&x[5..]), DepthForm::Reciprocal)]
}
fn depth_linear<R: Real>(x: &[R]) -> Vec<R> {
    vec![plane(x).at(v2(&x[5..]), DepthForm::Linear)]
}
fn tolerance_relative<R: Real>(x: &[R]) -> Vec<R> {
    vec![epsilon(&splat(x), x[12], x[13], Tolerance::Relative(1.0), &PERSPECTIVE)]
}
fn tolerance_absolute<R: Real>(x: &[R]) -> Vec<R> {
    vec![epsilon(&splat(x), x[12], x[13], Tolerance::Absolute(0.25), &ORTHOGRAPHIC)]
}
fn weight(x: &[f64]) -> Vec<f64> {
    vec![kernel::weight(x[0], x[1])]
}

fn dot3_terms(x: &[f64], _: usize) -> f64 {
    (0..3).map(|i| (x[i] * x[i + 3]).abs()).sum()
}
fn linear_terms(x: &[f64], _: usize) -> f64 {
    x[0].abs() + (x[1] * x[3]).abs() + (x[2] * x[4]).abs()
}
fn footprint_terms(x: &[f64], _: usize) -> f64 {
    let form = |i: usize| x[i].abs() + (x[i + 1] * x[9]).abs() + (x[i + 2] * x[10]).abs();
    form(0).max(form(3)).max(form(6))
}
fn offset_terms(x: &[f64], _: usize) -> f64 {
    700.0 * x[0].abs().max(x[1].abs()) / x[2] + x[3].abs().max(x[4].abs())
}
fn depth_terms(x: &[f64], _: usize) -> f64 {
    let terms = 1.0 + (x[1] * x[5]).abs() + (x[2] * x[6]).abs();
    let w = (1.0 + x[1] * x[5] + x[2] * x[6]).abs().max(x[0] / x[4]);
    x[0] / w * (terms / w).min(1e6)
}
fn depth_linear_terms(x: &[f64], _: usize) -> f64 {
    x[0].abs() + (x[1] * x[5]).abs() + (x[2] * x[6]).abs()
}
/// Returns the size to which errors of an output group are relative (see [`Kernel::scale`]). The gradient of w is a
/// component of the plane's, which may be nearly parallel to the other axis.
fn principal_terms(x: &[f64], group: usize) -> f64 {
    if group == 2 { x[7].hypot(x[8]) } else { 0.0 }
}

/// Returns the size to which errors of an output group are relative (see [`Kernel::scale`]). The exponent's rounding
/// error is multiplied by the exponent's size.
fn weight_terms(x: &[f64], _: usize) -> f64 {
    kernel::weight(x[0], x[1]) * (1.0 + x[0] * x[1])
}

fn with_radius(make: fn(&mut Random) -> Vec<f32>, random: &mut Random) -> Vec<f32> {
    let mut x = make(random);
    x.extend(f32s(&[random.range(0.001, 1.0), random.range(0.0, 2.0)]));
    x
}
fn depth(random: &mut Random) -> Vec<f32> {
    let z = random.range(1.0, 10.0);
    let (g, d) = ([0.02 * random.signed(), 0.02 * random.signed()], [8.0 * random.signed(), 8.0 * random.signed()]);
    f32s(&[z, g[0], g[1], 0.5 * z, 1.5 * z, d[0], d[1]])
}
fn wild_depth(random: &mut Random) -> Vec<f32> {
    let z = random.wild(5.0).abs();
    let (g, d) = ([random.wild(3.0), random.wild(3.0)], [random.wild(1.0), random.wild(1.0)]);
    f32s(&[z, g[0], g[1], 0.5 * z, 1.5 * z, d[0], d[1]])
}
fn point_and_base(random: &mut Random) -> Vec<f32> {
    let z = random.range(1.0, 10.0);
    let p = [0.4 * z * random.signed(), 0.3 * z * random.signed()];
    let base = [700.0 * p[0] / z + 320.5, 650.0 * p[1] / z + 240.25].map(f64::floor);
    f32s(&[p[0], p[1], z, base[0], base[1]])
}
fn wild_point_and_base(random: &mut Random) -> Vec<f32> {
    let z = random.wild(5.0).abs();
    let p = [2.0 * z * random.signed(), 2.0 * z * random.signed()];
    let base = [700.0 * p[0] / z + 320.5, 650.0 * p[1] / z + 240.25].map(f64::floor);
    f32s(&[p[0], p[1], z, base[0], base[1]])
}

pub(crate) const KERNELS: &[Kernel] = &[
    kernel!("difference_of_products", 4 => &[1], difference_of_products, "",
        "difference_of_products(x0, x1, x2, x3)", inputs::numbers::<4>, inputs::cancelling, None),
    kernel!("sum_of_products", 4 => &[1], sum_of_products, "", "sum_of_products(x0, x1, x2, x3)",
        inputs::numbers::<4>, inputs::cancelling, None),
    kernel!("v2_dot", 4 => &[1], v2_dot, "", "v2_dot(vec2f(x0, x1), vec2f(x2, x3))", inputs::numbers::<4>,
        inputs::cancelling_pair, None),
    kernel!("v2_cross", 4 => &[1], v2_cross, "", "v2_cross(vec2f(x0, x1), vec2f(x2, x3))", inputs::numbers::<4>,
        inputs::cancelling_pair, None),
    kernel!("v2_length", 2 => &[1], v2_length, "", "v2_length(vec2f(x0, x1))", inputs::numbers::<2>,
    inputs::wild::<2>, None),
    kernel!("v3_dot", 6 => &[1], v3_dot, "", "v3_dot(vec3f(x0, x1, x2), vec3f(x3, x4, x5))", inputs::numbers::<6>,
        inputs::wild::<6>, Some(dot3_terms)),
    kernel!("v3_cross", 6 => &[3], v3_cross, "let c = v3_cross(vec3f(x0, x1, x2), vec3f(x3, x4, x5));",
        "c.x; c.y; c.z", inputs::numbers::<6>, inputs::wild::<6>, None),
    kernel!("v3_length", 3 => &[1], v3_length, "", "v3_length(vec3f(x0, x1, x2))", inputs::numbers::<3>,
        inputs::wild::<3>, None),
    kernel!("v3_max_abs", 3 => &[1], v3_max_abs, "", "v3_max_abs(vec3f(x0, x1, x2))", inputs::numbers::<3>,
        inputs::wild::<3>, None),
    wide!("unit", 3 => &[3], unit, "let v = unit(vec3f(x0, x1, x2));", "v.x; v.y; v.z", inputs::numbers::<3>,
        inputs::wild::<3>, None),
    wide!("orthonormal", 3 => &[3, 3], orthonormal, "let o = orthonormal(vec3f(x0, x1, x2));",
        "o.s.x; o.s.y; o.s.z; o.t.x; o.t.y; o.t.z", |r| f32s(&r.direction()),
        |r| { let e = 10f64.powf(r.range(-8.0, 0.0)); let d = r.direction();
              let z = if r.signed() < 0.0 { -1.0 } else { 1.0 }; let v = [d[0] * e, d[1] * e, z];
              let l = v.iter().map(|c| c * c).sum::<f64>().sqrt(); f32s(&v.map(|c| c / l)) }, None),
    // Coordinates are sums of up to three numbers below 1.
    kernel!("unfolded", 2 => &[3], unfolded, "let v = unfolded(x0, x1);", "v.x; v.y; v.z",
        |r| f32s(&[r.signed(), r.signed()]), |r| f32s(&[r.signed().signum(), 1e-6 * r.signed()]), Some(|_, _| 1.0)),
    kernel!("svd2_of_columns", 5 => &[1, 1, 2], svd, "let d = svd2_of_columns(vec2f(x0, x1), vec2f(x2, x3), x4);",
        "d.major; d.minor; d.major_axis.x; d.major_axis.y", inputs::ellipse, inputs::wild_ellipse, None),
    kernel!("svd2_of_columns/circles", 5 => &[1, 1], singular_values,
        "let d = svd2_of_columns(vec2f(x0, x1), vec2f(x2, x3), x4);", "d.major; d.minor", inputs::circle,
        inputs::circle, None),
    kernel!("svd2_minor_axis", 2 => &[2], minor_axis, "let v = svd2_minor_axis(Svd2(1.0, 1.0, vec2f(x0, x1)));",
        "v.x; v.y", inputs::numbers::<2>, inputs::wild::<2>, None),
    kernel!("projected_new/perspective", 12 => &[2, 2, 1, 2, 2, 1, 1, 1], projected_perspective,
        "let p = projected_new(ViewSplat(vec3f(x0, x1, x2), vec3f(x3, x4, x5), vec3f(x6, x7, x8), vec3f(x9, x10, x11)),
             Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 3e38, 0.0, PERSPECTIVE));",
        "p.j_s.x; p.j_s.y; p.j_t.x; p.j_t.y; p.det_j; p.slope.x; p.slope.y; p.depth_gradient.x; p.depth_gradient.y;
         p.depth_extent; p.facing; p.facing_cosine",
        inputs::splat, inputs::wild_splat, None),
    kernel!("projected_new/orthographic", 12 => &[2, 2, 1, 2, 2, 1, 1, 1], projected_orthographic,
        "let p = projected_new(ViewSplat(vec3f(x0, x1, x2), vec3f(x3, x4, x5), vec3f(x6, x7, x8), vec3f(x9, x10, x11)),
             Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 100.0, 4.0, ORTHOGRAPHIC));",
        "p.j_s.x; p.j_s.y; p.j_t.x; p.j_t.y; p.det_j; p.slope.x; p.slope.y; p.depth_gradient.x; p.depth_gradient.y;
         p.depth_extent; p.facing; p.facing_cosine",
        inputs::splat, inputs::wild_splat, None),
    kernel!("projected_is_edge_on", 1 => &[1], is_edge_on,
        "let z = vec2f(0.0, 0.0); let p = Projected(z, z, 1.0, z, z, 1.0, x0, x0);", "flag(projected_is_edge_on(p))",
        |r| f32s(&[r.range(0.001, 1.0)]), |r| f32s(&[1e-5 * (1.0 + r.wild(3.0) * 1e-3).abs()]), None),
    kernel!("radius_max", 6 => &[1], radius_max, "", "radius_max(vec3f(x0, x1, x2), vec3f(x3, x4, x5))",
        inputs::numbers::<6>, |r| r.axes(), None),
    kernel!("projection_offset_from/perspective", 5 => &[2], offset_perspective,
        "let d = projection_offset_from(Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 3e38, 0.0, \
         PERSPECTIVE),
             vec3f(x0, x1, x2), vec2f(x3, x4));", "d.x; d.y", point_and_base, wild_point_and_base, None),
    kernel!("projection_offset_from/orthographic", 5 => &[2], offset_orthographic,
        "let d = projection_offset_from(Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 100.0, 4.0, \
         ORTHOGRAPHIC),
             vec3f(x0, x1, x2), vec2f(x3, x4));", "d.x; d.y", point_and_base, wild_point_and_base, Some(offset_terms)),
    kernel!("linear_new", 3 => &[3], linear_new, "let l = linear_new(x0, vec2f(x1, x2));", "l.c; l.x; l.y",
        inputs::numbers::<3>, inputs::wild::<3>, None),
    kernel!("linear_at", 5 => &[1], linear_at, "", "linear_at(Linear(x0, x1, x2), vec2f(x3, x4))", inputs::numbers::<5>,
        inputs::wild::<5>, Some(linear_terms)),
    kernel!("footprint_at", 11 => &[3], footprint_at,
        "let v = footprint_at(Footprint(Linear(x0, x1, x2), Linear(x3, x4, x5), Linear(x6, x7, x8)), vec2f(x9, x10));",
        "v.x; v.y; v.z", inputs::footprint, inputs::wild_footprint, Some(footprint_terms)),
    kernel!("footprint_contains", 11 => &[1], footprint_contains,
        "let f = Footprint(Linear(x0, x1, x2), Linear(x3, x4, x5), Linear(x6, x7, x8));",
        "flag(footprint_contains(f, vec2f(x9, x10)))", inputs::clear_of_the_rim, inputs::clear_of_the_rim, None),
    kernel!("footprint_about_center", 13 => &[2, 2, 2], about_center,
        "let f = footprint_about_center(vec2f(x0, x1), vec2f(x2, x3), x4, vec2f(x5, x6));",
        "f.u.x; f.u.y; f.v.x; f.v.y; f.w.x; f.w.y", inputs::projected, inputs::wild_projected, None),
    kernel!("footprint_unfiltered/projective", 13 => &[2, 2, 2], unfiltered_projective,
        "let f = footprint_unfiltered(Projected(vec2f(x0, x1), vec2f(x2, x3), x4, vec2f(x5, x6), vec2f(x7, x8), x9, \
         x10, x11), true);",
        "f.u.x; f.u.y; f.v.x; f.v.y; f.w.x; f.w.y", inputs::projected, inputs::wild_projected, None),
    kernel!("footprint_unfiltered/affine", 13 => &[2, 2, 2], unfiltered_affine,
        "let f = footprint_unfiltered(Projected(vec2f(x0, x1), vec2f(x2, x3), x4, vec2f(x5, x6), vec2f(x7, x8), x9, \
         x10, x11), false);",
        "f.u.x; f.u.y; f.v.x; f.v.y; f.w.x; f.w.y", inputs::projected, inputs::wild_projected, None),
    kernel!("filtered_unfiltered", 11 => &[2, 2, 2, 1, 1, 2, 2], unfiltered,
        "let f = filtered_unfiltered(Footprint(Linear(x0, x1, x2), Linear(x3, x4, x5), Linear(x6, x7, x8)));",
        "f.footprint.u.x; f.footprint.u.y; f.footprint.v.x; f.footprint.v.y; f.footprint.w.x; f.footprint.w.y;
         f.weight_scale; f.coverage_scale;
         f.turn.first.x; f.turn.first.y; f.turn.second.x; f.turn.second.y", inputs::footprint, inputs::wild_footprint,
        None),
    kernel!("principal", 13 => &[2, 2, 2, 1, 1, 2, 2], principal,
        "let f = principal(Projected(vec2f(x0, x1), vec2f(x2, x3), x4, vec2f(x5, x6), vec2f(x7, x8), x9, x10, x11), \
         x12, true);",
        "f.footprint.u.x; f.footprint.u.y; f.footprint.v.x; f.footprint.v.y; f.footprint.w.x; f.footprint.w.y;
         f.weight_scale; f.coverage_scale;
         f.turn.first.x; f.turn.first.y; f.turn.second.x; f.turn.second.y", inputs::projected, inputs::wild_projected,
        Some(principal_terms)),
    kernel!("ewa", 13 => &[2, 2, 2, 1, 1, 2, 2], ewa,
        "let f = ewa(Projected(vec2f(x0, x1), vec2f(x2, x3), x4, vec2f(x5, x6), vec2f(x7, x8), x9, x10, x11), x12);",
        "f.footprint.u.x; f.footprint.u.y; f.footprint.v.x; f.footprint.v.y; f.footprint.w.x; f.footprint.w.y;
         f.weight_scale; f.coverage_scale;
         f.turn.first.x; f.turn.first.y; f.turn.second.x; f.turn.second.y", inputs::projected, inputs::wild_projected,
        None),
    kernel!("area_ratio", 13 => &[1], area_ratio, "",
        "area_ratio(Projected(vec2f(x0, x1), vec2f(x2, x3), x4, vec2f(x5, x6), vec2f(x7, x8), x9, x10, x11), x12)",
        inputs::projected, inputs::wild_projected, None),
    kernel!("adjust", 13 => &[2, 2, 2, 1, 1, 2, 2], adjust,
        "let f = adjust(Projected(vec2f(x0, x1), vec2f(x2, x3), x4, vec2f(x5, x6), vec2f(x7, x8), x9, x10, x11), x12, \
         true);",
        "f.footprint.u.x; f.footprint.u.y; f.footprint.v.x; f.footprint.v.y; f.footprint.w.x; f.footprint.w.y;
         f.weight_scale; f.coverage_scale;
         f.turn.first.x; f.turn.first.y; f.turn.second.x; f.turn.second.y", inputs::projected,
        inputs::sized_projected, None),
    kernel!("bounds_ellipse", 13 => &[4], bounds_ellipse,
        "let e = bounds_ellipse(vec2f(x0, x1), vec2f(x2, x3), vec2f(x5, x6));",
        "e.least.x; e.least.y; e.greatest.x; e.greatest.y", inputs::projected, inputs::wild_projected, None),
    kernel!("bounds_unfiltered", 13 => &[4], bounds_unfiltered,
        "let e = bounds_unfiltered(Projected(vec2f(x0, x1), vec2f(x2, x3), x4, vec2f(x5, x6), vec2f(x7, x8), x9, x10, \
         x11), true);",
        "e.least.x; e.least.y; e.greatest.x; e.greatest.y", inputs::projected, inputs::wild_projected, None),
    kernel!("bounds_footprint", 6 => &[4], bounds_footprint,
        "let e = bounds_footprint(Footprint(Linear(0.0, x0, x1), Linear(0.0, x2, x3), Linear(1.0, x4, x5)));",
        "e.least.x; e.least.y; e.greatest.x; e.greatest.y", inputs::forms, inputs::wild_forms, None),
    kernel!("depth_plane_at/reciprocal", 7 => &[1], depth_reciprocal, "",
        "depth_plane_at(DepthPlane(vec2f(x1, x2), x0, 1.0, x3, x4), vec2f(x5, x6), DEPTH_RECIPROCAL)", depth,
        wild_depth,
        Some(depth_terms)),
    kernel!("depth_plane_at/linear", 7 => &[1], depth_linear, "",
        "depth_plane_at(DepthPlane(vec2f(x1, x2), x0, 1.0, x3, x4), vec2f(x5, x6), DEPTH_LINEAR)", depth, wild_depth,
        Some(depth_linear_terms)),
    kernel!("tolerance/relative", 14 => &[1], tolerance_relative,
        "let s = ViewSplat(vec3f(x0, x1, x2), vec3f(x3, x4, x5), vec3f(x6, x7, x8), vec3f(x9, x10, x11));",
        "tolerance(s, x12, x13, Tolerance(1.0, TOLERANCE_RELATIVE),
         Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 3e38, 0.0, PERSPECTIVE))",
        |r| with_radius(inputs::splat, r), |r| with_radius(inputs::wild_splat, r), None),
    kernel!("tolerance/absolute", 14 => &[1], tolerance_absolute,
        "let s = ViewSplat(vec3f(x0, x1, x2), vec3f(x3, x4, x5), vec3f(x6, x7, x8), vec3f(x9, x10, x11));",
        "tolerance(s, x12, x13, Tolerance(0.25, TOLERANCE_ABSOLUTE),
         Projection(vec2f(700.0, 650.0), vec2f(320.5, 240.25), 0.01, 100.0, 4.0, ORTHOGRAPHIC))",
        |r| with_radius(inputs::splat, r), |r| with_radius(inputs::wild_splat, r), None),
    wide!("weight", 2 => &[1], weight, "", "weight(x0, x1)", |r| f32s(&[r.range(0.0, 1.0), 2.0]),
        |r| f32s(&[r.range(0.0, 1.0), r.wild(1.3).abs()]), Some(weight_terms)),
];
