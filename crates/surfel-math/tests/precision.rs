//! Tests of the building blocks: product differences, singular values, directions.

use crate::common;

use common::{Random, q, to_f64};
use num_traits::Signed;
use surfel_math::svd::Svd2;
use surfel_math::{Real, V2};

fn ulp(value: f64) -> f64 {
    let exponent = value.abs().log2().floor();
    (exponent - 23.0).exp2()
}

/// Tests the bound of Jeannerod, Louvet and Muller 2013: an error of at most 1.5 ulp, however much cancels.
#[test]
fn difference_of_products_is_within_one_and_a_half_ulp() {
    let mut random = Random(3);
    let (mut worst, mut naive_worst) = (0.0f64, 0.0f64);
    for i in 0..20_000 {
        let e = random.range(-6.0, 6.0);
        let [a, b, c] = [0; 3].map(|_: i32| (random.range(-1.0, 1.0) * 10f64.powf(e)) as f32);
        // For every other sample a·b ≈ c·d to the last bits.
        let d = if i % 2 == 0 { a * b / c } else { random.range(-1.0, 1.0) as f32 };
        let exact = q(a.into()) * q(b.into()) - q(c.into()) * q(d.into());
        let want = to_f64(&exact);
        if want == 0.0 {
            assert_eq!(f32::difference_of_products(a, b, c, d), 0.0);
            continue;
        }
        let error = |got: f32| to_f64(&(q(got.into()) - &exact).abs()) / ulp(want);
        worst = worst.max(error(f32::difference_of_products(a, b, c, d)));
        naive_worst = naive_worst.max(error(a * b - c * d));
        assert_eq!(f32::sum_of_products(a, b, c, d), f32::difference_of_products(a, b, -c, d));
    }
    println!("{worst} ulp; without care {naive_worst:e}");
    assert!(worst <= 1.5, "{worst}");
    assert!(naive_worst > 1e4, "{naive_worst}");
}

/// Tests aspects up to 1e8 and sizes 1e±15 in f32. The larger singular value is precise to a few ulp, the smaller one
/// as precise as the determinant.
#[test]
fn singular_values_of_needles_in_f32() {
    let mut random = Random(5);
    for _ in 0..20_000 {
        let major = 10f64.powf(random.range(-15.0, 15.0));
        let minor = major * 10f64.powf(random.range(-8.0, 0.0));
        let (a, b) = (random.range(0.0, 7.0), random.range(0.0, 7.0));
        let (u, v) = (V2::new(a.cos(), a.sin()), V2::new(-a.sin(), a.cos()));
        let s = u * (major * b.cos()) + v * (minor * b.sin());
        let t = u * (-major * b.sin()) + v * (minor * b.cos());
        let f = |v: V2<f64>| V2::new(v.x as f32, v.y as f32);
        let determinant = major * minor;
        let svd = Svd2::of_columns(f(s), f(t), determinant as f32);
        assert!((f64::from(svd.major) / major - 1.0).abs() < 4e-7, "{svd:?} {major:e}");
        if determinant.abs() > 1e-35 && determinant.abs() < 1e37 {
            assert!((f64::from(svd.minor) / minor - 1.0).abs() < 6e-7, "{svd:?} {minor:e}");
        }
        assert!(svd.minor <= svd.major && svd.minor >= 0.0);
        // The precision of the axis depends on the gap between the values.
        let off = f64::from(svd.major_axis.x) * u.y - f64::from(svd.major_axis.y) * u.x;
        if minor < 0.9 * major {
            assert!(off.abs() < 1e-6, "{off}");
        }
    }
}
