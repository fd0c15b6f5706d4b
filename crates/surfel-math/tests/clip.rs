//! Tests of clip curves and lines against exact arithmetic, against the region that they are defined to remove, and
//! through footprints.

use crate::common;

use common::{Exact, Q, Random, Spec, UHD, int, q, reach, single_splat};
use num_traits::Signed;
use surfel_math::V2;
use surfel_math::clip::{Clip, Curve, Turn};
use surfel_math::clip_paper::PaperCurve;
use surfel_math::filter;
use surfel_math::mapping::Footprint;
use surfel_math::project::Projected;

/// Returns a ring of `count` points around a centre; any sector wider than 360°/count contains one of them.
fn around(center: V2<f64>, step: f64, count: u32) -> impl Iterator<Item = V2<f64>> {
    (0..count).map(move |i| {
        let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / f64::from(count)).sin_cos();
        center + V2::new(cos, sin) * step
    })
}

fn cross(a: &[Q; 2], b: &[Q; 2], c: &[Q; 2]) -> Q {
    (&b[0] - &a[0]) * (&c[1] - &a[1]) - (&b[1] - &a[1]) * (&c[0] - &a[0])
}

/// True if a clip curve keeps the homogeneous point (U, V, W), W > 0. Evaluates the definition of rendering model §7 in
/// exact arithmetic.
fn exactly_kept(curve: &Curve, point: &[Q; 3]) -> bool {
    let exact = |v: V2<f64>| [q(v.x), q(v.y)];
    let (p1, p2, p3) = (exact(curve.p1), exact(curve.p2), exact(curve.p3));
    if p1 == p3 {
        return true;
    }
    let x = [&point[0] / &point[2], &point[1] / &point[2]];
    let right_of_chord = cross(&p1, &p3, &x).is_negative();
    let area = cross(&p1, &p2, &p3);
    if curve.w == 0.0 || area.abs() < q(1e-9) {
        return !right_of_chord;
    }
    let tau = [cross(&p2, &p3, &x), cross(&p3, &p1, &x), cross(&p1, &p2, &x)].map(|a| a / &area);
    let w = q(curve.w);
    let lens = tau.iter().all(|t| !t.is_negative()) && &tau[1] * &tau[1] <= int(4) * &w * &w * &tau[0] * &tau[2];
    if area.is_positive() { !right_of_chord || lens } else { !right_of_chord && !lens }
}

fn exact_point(p: V2<f64>) -> [Q; 3] {
    [q(p.x), q(p.y), int(1)]
}

/// Returns a curve of one of many kinds: ordinary curves and every extreme case that rendering model §7 mentions.
fn random_curve(random: &mut Random, kind: usize) -> Curve {
    let theta1 = random.range(-7.0, 7.0);
    let mut theta3 = random.range(-7.0, 7.0);
    let mut p2 = V2::new(random.range(-1.5, 1.5), random.range(-1.5, 1.5));
    let mut w = random.log_range(0.05, 20.0);
    match kind % 10 {
        1 => w = random.log_range(1e-20, 1e-2),
        2 => w = random.log_range(1e2, 3e38),
        3 => theta3 = theta1 + random.log_range(1e-6, 1e-2) * random.range(-1.0, 1.0).signum(),
        4 => p2 = p2 * random.log_range(1e2, 1e30),
        5 => theta3 = theta1,
        6 => w = 0.0,
        _ => {}
    }
    let mut curve = Curve::from_angles(theta1, theta3, p2, w);
    match kind % 10 {
        // Collinear to the last bits, or nearly so; coincident control points.
        7 => {
            let t = random.range(-1.0, 2.0);
            curve.p2 = curve.p1 * (1.0 - t) + curve.p3 * t + p2 * random.log_range(1e-18, 1e-6);
        }
        8 => curve.p2 = if random.range(0.0, 1.0) < 0.5 { curve.p1 } else { curve.p3 },
        9 => curve.p2 = curve.p1 + p2 * random.log_range(1e-9, 1e-3),
        _ => {}
    }
    curve
}

/// Returns a point of the disk; every other point is near the curve or near its control polygon.
fn random_point(random: &mut Random, curve: &Curve, i: usize) -> V2<f64> {
    let near = random.log_range(1e-16, 1e-2);
    let off = V2::new(random.range(-near, near), random.range(-near, near));
    let t = random.range(-0.1, 1.1);
    let p = match i % 6 {
        0 => curve.at(t.clamp(0.0, 1.0)) + off,
        1 => curve.p1 * (1.0 - t) + curve.p3 * t + off,
        2 => curve.p1 * (1.0 - t) + curve.p2 * t + off,
        _ => V2::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0)),
    };
    if p.length() <= 1.0 { p } else { V2::new(random.range(-0.7, 0.7), random.range(-0.7, 0.7)) }
}

/// Counts the random points that a classifier assigns to the wrong side of a curve, although they are farther than
/// `band` from the exact border, in (u, v).
fn misclassified(band: f64, mut kept: impl FnMut(&Curve, V2<f64>) -> bool) -> usize {
    let mut random = Random(71);
    let (mut wrong, mut both) = (0, [0; 2]);
    for i in 0..20_000 {
        let curve = random_curve(&mut random, i / 6);
        let point = random_point(&mut random, &curve, i);
        // The point is rounded, since an f32 classifier receives an f32.
        let point = V2::new(f64::from(point.x as f32), f64::from(point.y as f32));
        let want = exactly_kept(&curve, &exact_point(point));
        both[usize::from(want)] += 1;
        if kept(&curve, point) != want {
            // At an end, curve and chord may enclose a wedge of one degree.
            let decided = around(point, band, 1000).all(|p| exactly_kept(&curve, &exact_point(p)) == want);
            wrong += usize::from(decided);
            assert!(!decided, "{curve:?} at {point:?}: exactly {want}");
        }
    }
    assert!(both.iter().all(|n| *n > 3_000), "{both:?}");
    wrong
}

#[test]
fn clip_curve_exact_f64_misclassifies_nothing() {
    // Coefficients and values are differences of products of numbers up to 1: a few times 1.1e-16, in (u, v). The
    // straight threshold itself is rounded: a turn of 1e-9 over a chord of any length.
    assert_eq!(misclassified(1e-14, |curve, p| Clip::nothing().with_curve(curve).keeps(p)), 0);
}

#[test]
fn clip_curve_exact_f32_misclassifies_nothing() {
    // Three coefficients and three roundings of 6e-8 each.
    let single = |v: V2<f64>| V2::new(v.x as f32, v.y as f32);
    let kept = |curve: &Curve, p| Clip::nothing().with_curve(curve).map(|x| x as f32).keeps(single(p));
    assert_eq!(misclassified(6e-7, kept), 0);
}

#[test]
fn clip_curve_of_the_paper_repaired_misclassifies_nothing() {
    // The crossing's position along the line is a quotient of areas, so it is as precise as the control triangle is
    // wide: turns down to 1e-9 leave 7 of 16 digits.
    assert_eq!(misclassified(1e-7, |curve, p| PaperCurve::new(curve).keeps(p)), 0);
}

/// Compares the removed part with a polygon between the arc P1 → P3 and the curve, filled by the even–odd rule. C12
/// §3.2 describes this part in words.
#[test]
fn clip_curve_removes_what_lies_between_arc_and_curve() {
    const STEPS: usize = 4000;
    let mut random = Random(5);
    for _ in 0..60 {
        let (theta1, arc) = (random.range(-3.0, 3.0), random.range(0.3, 5.9));
        // Inside the disk the curve stays within the hull of its control points.
        let p2 = V2::new(random.range(-0.7, 0.7), random.range(-0.7, 0.7));
        let curve = Curve::from_angles(theta1, theta1 + arc, p2, random.log_range(0.1, 10.0));
        let share = |i: usize| i as f64 / STEPS as f64;
        let on_arc = (0..STEPS).map(|i| {
            let (sin, cos) = (theta1 + arc * share(i)).sin_cos();
            V2::new(cos, sin)
        });
        let outline: Vec<V2<f64>> = on_arc.chain((0..STEPS).map(|i| curve.at(1.0 - share(i)))).collect();
        let in_outline = |x: V2<f64>| {
            let edges = outline.iter().zip(outline.iter().cycle().skip(1));
            edges
                .filter(|(a, b)| (a.y > x.y) != (b.y > x.y) && x.x < a.x + (x.y - a.y) / (b.y - a.y) * (b.x - a.x))
                .count()
                % 2
                == 1
        };
        let clip = Clip::nothing().with_curve(&curve);
        for _ in 0..60 {
            let point = V2::new(random.range(-0.7, 0.7), random.range(-0.7, 0.7));
            // A polygon of 4000 sides is within 1e-4 of a curve of weight 10.
            if around(point, 1e-3, 8).all(|p| in_outline(p) == in_outline(point)) {
                assert_eq!(clip.keeps(point), !in_outline(point), "{curve:?} at {point:?}");
            }
        }
    }
}

#[test]
fn clip_curve_special_cases() {
    let origin = V2::new(0.0, 0.0);
    let quarter = |w: f64| Curve { p1: V2::new(1.0, 0.0), p2: V2::new(1.0, 1.0), p3: V2::new(0.0, 1.0), w };
    let kept = |curve: &Curve, x: f64, y: f64| Clip::nothing().with_curve(curve).keeps(V2::new(x, y));
    // A quarter circle: w = √½ is the arc itself, so nothing is between the two.
    assert!(kept(&quarter(0.5f64.sqrt()), 0.70, 0.70));
    // The parabola's middle is ¾ of the corner less ¼: (0.75, 0.75) with P2 = (1, 1); the chord's is ½.
    assert!(kept(&quarter(0.0), 0.49, 0.49) && !kept(&quarter(0.0), 0.51, 0.51));
    let inner = Curve { p2: V2::new(0.8, 0.8), ..quarter(1.0) };
    assert!(kept(&inner, 0.649, 0.649) && !kept(&inner, 0.651, 0.651));
    // Concave: the arc (1,0) → (0,1) counter-clockwise, P2 left of the chord.
    let concave = Curve { p2: origin, ..quarter(1.0) };
    assert!(kept(&concave, 0.249, 0.249) && !kept(&concave, 0.251, 0.251));
    // In the other direction, the other part is removed.
    let reversed = Curve { p1: concave.p3, p3: concave.p1, ..concave };
    assert!(!kept(&reversed, 0.249, 0.249) && kept(&reversed, 0.251, 0.251));
    // P1 = P3 removes nothing, on any side.
    let closed = Curve::from_angles(0.3, 0.3, V2::new(-0.5, 0.2), 1.0);
    assert!(around(origin, 0.9, 8).all(|p| kept(&closed, p.x, p.y)) && PaperCurve::new(&closed).keeps(origin));
}

/// Tests that a clip under the policy `line` uses the chord of any curve.
#[test]
fn clip_chord_ignores_the_curve() {
    let mut random = Random(13);
    for i in 0..2000 {
        let curve = random_curve(&mut random, i);
        let point = random_point(&mut random, &curve, i);
        let straight = Curve { w: 0.0, ..curve };
        let clip = Clip::nothing().with_chord(&curve);
        assert_eq!(clip.keeps(point), Clip::nothing().with_curve(&straight).keeps(point));
    }
}

#[test]
fn clip_lines_and_or_absent() {
    let keeps = |lines: &[[f64; 3]], any, x: f64, y: f64| {
        let clip = Clip::nothing().with_lines(lines, any);
        let single = clip.map(|v| v as f32).keeps(V2::new(x as f32, y as f32));
        assert_eq!(clip.keeps(V2::new(x, y)), single);
        single
    };
    // u ≥ ½, and v ≥ ½ with both coefficients times 1e30: scale doesn't matter.
    let lines = [[1.0, 0.0, -0.5], [0.0, 1e30, -0.5e30]];
    for (x, y) in [(0.75, 0.75), (0.75, 0.25), (0.25, 0.75), (0.25, 0.25)] {
        assert_eq!(keeps(&lines, false, x, y), x > 0.5 && y > 0.5);
        assert_eq!(keeps(&lines, true, x, y), x > 0.5 || y > 0.5);
        assert!(keeps(&[], false, x, y) && keeps(&[], true, x, y));
        assert!(keeps(&[[0.0; 3]], true, x, y) && keeps(&[[0.0; 3]], false, x, y));
    }
    // Points on the line are retained.
    assert!(keeps(&lines, false, 0.5, 0.5) && keeps(&lines, true, 0.5, 0.0));
    let four = [[1.0, 0.0, 0.5], [-1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, -1.0, 0.5]];
    assert!(keeps(&four, false, 0.5, -0.5) && !keeps(&four, false, 0.5, -0.51) && keeps(&four, true, 0.5, -0.51));
    // A curve and lines: a point must be inside both.
    let curve = Curve { p1: V2::new(1.0, 0.0), p2: V2::new(0.0, 0.0), p3: V2::new(0.0, 1.0), w: 0.0 };
    let both = Clip::nothing().with_curve(&curve).with_lines(&four[..1], false);
    assert!(both.keeps(V2::new(0.0, 0.0)) && !both.keeps(V2::new(0.6, 0.6)) && !both.keeps(V2::new(-0.6, 0.0)));
}

/// Composed in f32 with footprints of f32 splats, clips are wrong nowhere farther than a thousandth of a pixel from a
/// border.
#[test]
fn clip_through_exact_footprints_in_f32() {
    let mut random = Random(29);
    let mut compared = 0;
    for i in 0..6000 {
        let splat = Spec { radius_px: random.log_range(2.0, 300.0), ..Spec::random(&mut random, 0.02) }.splat(&UHD);
        if reach(&splat) > 0.3 {
            continue;
        }
        let curve = random_curve(&mut random, i);
        let uv = random_point(&mut random, &curve, i) * 0.98;
        let p = splat.p + splat.s * uv.x + splat.t * uv.y;
        let center = UHD.pixel(splat.p);
        let single = single_splat(&splat);
        let projected = Projected::new(&single, &UHD);
        let footprint = Footprint::unfiltered(&projected, true);
        let clip = Clip::nothing().with_curve(&curve).map(|x| x as f32).through(&footprint, &Turn::none(0f32));
        // The offset is an f32; the exact side uses the same offset, from the exact centre.
        let offset = UHD.pixel(p) - center;
        let offset = V2::new(offset.x as f32, offset.y as f32);
        let exact = Exact::new(&splat);
        let ray = |value: f64, axis: usize, own: f64| {
            let center = q(own) / q(splat.p.z);
            center + q(value) / q(UHD.focal_px[axis])
        };
        let at = |d: V2<f64>| exact.at(&ray(d.x, 0, splat.p.x), &ray(d.y, 1, splat.p.y));
        let d = V2::new(f64::from(offset.x), f64::from(offset.y));
        let here = at(d);
        if !here[2].is_positive() {
            continue;
        }
        compared += 1;
        let want = exactly_kept(&curve, &here);
        if clip.keeps(offset) != want {
            let decided = around(d, 1e-3, 1000).all(|p| exactly_kept(&curve, &at(p)) == want);
            assert!(!decided, "{curve:?} {splat:?} at {offset:?}");
        }
    }
    assert!(compared > 4000, "{compared}");
}

/// A splat that its filter doesn't change has the same (u, v) through the filter and its turn as without the filter.
#[test]
fn clip_turns_bring_filtered_coordinates_back() {
    let mut random = Random(31);
    let mut compared = 0;
    for i in 0..2000 {
        let spec = Spec {
            radius_px: random.log_range(40.0, 300.0),
            aspect: if i % 2 == 0 { 1.0 } else { random.range(1.1, 3.0) },
            ..Spec::random(&mut random, 0.2)
        };
        let mut splat = spec.splat(&UHD);
        if i % 3 == 0 {
            // A mirrored object: the axes are left-handed on the screen.
            (splat.s, splat.t) = (splat.t, splat.s);
        }
        if reach(&splat) > 0.3 {
            continue;
        }
        compared += 1;
        let projected = Projected::new(&splat, &UHD);
        let (s, t, adjust_turn) = filter::adjust_axes_turned(&splat, true);
        let adjusted =
            filter::adjust(&Projected::new(&surfel_math::project::ViewSplat { s, t, ..splat }, &UHD), 0.7, true);
        let principal = filter::principal(&projected, 0.7, true);
        // With h = 0, `ewa` is the affine projection.
        let ewa = filter::ewa(&projected, 0.0);
        let at = |f: &Footprint<f64>, d: V2<f64>| {
            let (u, v, w) = f.at(d);
            V2::new(u, v) * (1.0 / w)
        };
        let (exact, affine) = (Footprint::unfiltered(&projected, true), Footprint::unfiltered(&projected, false));
        for d in around(V2::new(0.0, 0.0), 10.0, 8) {
            let pairs = [
                (principal.turn.apply(at(&principal.footprint, d)), at(&exact, d), "principal"),
                (adjust_turn.apply(at(&adjusted.footprint, d)), at(&exact, d), "adjust"),
                (ewa.turn.apply(at(&ewa.footprint, d)), at(&affine, d), "ewa"),
            ];
            for (got, want, name) in pairs {
                // A few roundings for disks of 1e2 px, over a sine of 0.2 · 1/3.
                assert!((got - want).length() < 1e-11, "{name}: {got:?} {want:?} {splat:?}");
            }
        }
    }
    assert!(compared > 1000, "{compared}");
}

/// A clip composed with a footprint decides as the clip does at that footprint's (u, v).
#[test]
fn clip_through_a_turn_is_the_clip_of_the_turned_point() {
    let mut random = Random(37);
    for i in 0..3000 {
        let splat = Spec { radius_px: random.log_range(0.1, 30.0), ..Spec::random(&mut random, 0.05) }.splat(&UHD);
        if reach(&splat) > 0.4 {
            continue;
        }
        let filtered = filter::principal(&Projected::new(&splat, &UHD), 3.0, true);
        let curve = random_curve(&mut random, i);
        let line = [random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-0.5, 0.5)];
        let clip = Clip::nothing().with_curve(&curve).with_lines(&[line], i % 2 == 0);
        let composed = clip.through(&filtered.footprint, &filtered.turn);
        let d = V2::new(random.range(-3.0, 3.0), random.range(-3.0, 3.0));
        let (u, v, w) = filtered.footprint.at(d);
        if w <= 0.0 {
            continue;
        }
        let uv = filtered.turn.apply(V2::new(u, v) * (1.0 / w));
        let decided = around(uv, 1e-9, 64).all(|p| clip.keeps(p) == clip.keeps(uv));
        assert!(!decided || composed.keeps(d) == clip.keeps(uv), "{curve:?} {uv:?}");
    }
}
