//! Tests of metrics on images small enough to check by hand.

use surfel_metrics::flip::{self, Encoding, FlipOptions};
use surfel_metrics::{CompareOptions, Image, MetricsError, PlaneOptions, abs_difference, compare, compare_plane};
use surfel_metrics::{max_abs, psnr, rmse};

const INF: f32 = f32::INFINITY;

#[test]
fn difference_rule_for_infinities_and_nan() {
    assert_eq!(abs_difference(INF, INF), 0.0);
    assert_eq!(abs_difference(-INF, -INF), 0.0);
    assert_eq!(abs_difference(0.0, -0.0), 0.0);
    for (a, b) in [(INF, 1.0), (INF, -INF), (f32::NAN, 1.0), (f32::NAN, INF), (f32::NAN, f32::NAN)] {
        assert_eq!(abs_difference(a, b), f64::INFINITY, "{a} {b}");
        assert_eq!(abs_difference(b, a), f64::INFINITY, "{b} {a}");
    }
    assert_eq!(abs_difference(f32::MAX, -f32::MAX), 2.0 * f64::from(f32::MAX));
}

#[test]
fn plane_metrics_by_hand() {
    let (a, b) = ([0.0, 1.0, INF, 2.0], [0.0, 4.0, INF, 6.0]);
    let c = compare_plane(&a, &b, &PlaneOptions { mask: None, tolerance: 3.0 }).unwrap();
    assert_eq!((c.compared, c.max_abs, c.max_abs_index), (4, 4.0, Some(3)));
    assert_eq!(c.rmse, (25.0f64 / 4.0).sqrt());
    assert_eq!((c.differing, c.non_finite), (1, 0));
    // 1e-12: two logarithms in f64.
    assert!((c.psnr(25.0).unwrap() - 20.0).abs() < 1e-12);
}

#[test]
fn plane_mask_hides_everything_about_a_value() {
    let (a, b) = ([1.0, f32::NAN, 3.0], [1.0, 7.0, 5.0]);
    let mask = [true, false, true];
    let c = compare_plane(&a, &b, &PlaneOptions { mask: Some(&mask), tolerance: 0.0 }).unwrap();
    assert_eq!((c.compared, c.max_abs, c.max_abs_index, c.differing, c.non_finite), (2, 2.0, Some(2), 1, 0));
    assert_eq!(rmse(&a, &b, Some(&mask)).unwrap(), 2.0f64.sqrt());
    assert_eq!(max_abs(&a, &b, None).unwrap(), f64::INFINITY);
    assert_eq!(rmse(&a, &b, None).unwrap(), f64::INFINITY);
}

#[test]
fn psnr_extremes() {
    assert_eq!(psnr(&[1.0], &[1.0], None, 1.0).unwrap(), f64::INFINITY);
    assert_eq!(psnr(&[1.0], &[INF], None, 1.0).unwrap(), f64::NEG_INFINITY);
    assert_eq!(psnr(&[], &[], None, 1.0).unwrap(), f64::INFINITY);
    for peak in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(psnr(&[1.0], &[1.0], None, peak), Err(MetricsError::OutOfRange { field: "peak", .. })));
    }
}

#[test]
fn lengths_and_sizes_are_checked() {
    let length = |e| matches!(e, MetricsError::Length { .. });
    assert!(length(max_abs(&[1.0], &[], None).unwrap_err()));
    assert!(length(max_abs(&[1.0], &[1.0], Some(&[])).unwrap_err()));
    assert!(length(Image::new(2, 2, &[0.0; 15]).unwrap_err()));
    assert!(Image::new(u32::MAX, u32::MAX, &[]).is_err());
    assert!(length(flip::ldr(1, 1, &[], &[], &FlipOptions::default()).unwrap_err()));
    let pixels = [0.0; 8];
    let (wide, tall) = (Image::new(2, 1, &pixels).unwrap(), Image::new(1, 2, &pixels).unwrap());
    let error = compare(&wide, &tall, &CompareOptions::default()).unwrap_err();
    assert!(error.to_string().contains("2x1 and 1x2"), "{error}");
    for pixels_per_degree in [0.0, 0.5, 1001.0, f64::NAN] {
        let options = FlipOptions { pixels_per_degree, encoding: Encoding::Linear };
        assert!(flip::ldr(1, 1, &[[0.0; 3]], &[[0.0; 3]], &options).is_err(), "{pixels_per_degree}");
    }
}

/// Returns an image of 40x30 opaque pixels with some structure.
fn image() -> Vec<f32> {
    (0..40 * 30).flat_map(|i| [(i % 40) as f32 / 39.0, ((i / 7) % 2) as f32, 0.25, 1.0]).collect()
}

#[test]
fn compare_equal_images() {
    let a = image();
    let a = Image::new(40, 30, &a).unwrap();
    let c = compare(&a, &a, &CompareOptions::default()).unwrap();
    assert_eq!((c.compared, c.max_abs, c.max_abs_at, c.rmse, c.differing), (1200, 0.0, None, 0.0, 0));
    assert_eq!((c.psnr, c.flip_mean), (f64::INFINITY, Some(0.0)));
}

#[test]
fn compare_one_changed_pixel() {
    let a = image();
    let mut b = a.clone();
    b[4 * (11 * 40 + 23) + 2] += 0.5;
    let (a, b) = (Image::new(40, 30, &a).unwrap(), Image::new(40, 30, &b).unwrap());
    let c = compare(&a, &b, &CompareOptions::default()).unwrap();
    assert_eq!((c.max_abs, c.max_abs_at, c.differing), (0.5, Some((23, 11)), 1));
    assert_eq!(c.rmse, (0.25f64 / 4800.0).sqrt());
    let map = c.flip.unwrap();
    let worst = (0..1200).max_by(|&i, &j| map.error[i].total_cmp(&map.error[j])).unwrap();
    // A neighbour of the pixel: the filter spreads the pixel's colour, and the feature next to it adds to that.
    assert!((worst % 40).abs_diff(23) <= 2 && (worst / 40).abs_diff(11) <= 2, "{worst}");
    // The filters' radius at the default density is 10 pixels.
    assert_eq!(map.error[11 * 40 + 23 - 11], 0.0);
    assert!(map.error[11 * 40 + 23 - 3] > 0.0);

    let mut mask = vec![true; 1200];
    mask[11 * 40 + 23] = false;
    let options = CompareOptions { mask: Some(&mask), ..CompareOptions::default() };
    let c = compare(&a, &b, &options).unwrap();
    assert_eq!((c.compared, c.max_abs, c.flip_mean), (1199, 0.0, Some(0.0)));
}

#[test]
fn compare_sees_alpha_alone() {
    // A missing black shape: premultiplied colours are equal, alpha isn't.
    let (a, b) = ([0.0, 0.0, 0.0, 1.0].repeat(25), [0.0; 100]);
    let c = compare(&Image::new(5, 5, &a).unwrap(), &Image::new(5, 5, &b).unwrap(), &CompareOptions::default());
    let c = c.unwrap();
    assert_eq!((c.max_abs, c.rmse, c.differing), (1.0, 0.5, 25));
    assert!(c.flip_mean.unwrap() > 0.3, "{:?}", c.flip_mean);
}

#[test]
fn flip_of_black_against_white_is_nearly_the_largest() {
    let map = flip::ldr(9, 9, &[[0.0; 3]; 81], &[[1.0; 3]; 81], &FlipOptions::default()).unwrap();
    // Without structure only the colour term remains, HyAB = 100 against 308 for green and blue (0.97).
    assert!(map.error.iter().all(|&e| e > 0.95 && e < 1.0), "{}", map.mean);
    assert_eq!(map.to_magma()[0], surfel_metrics::colormap::magma(map.error[0]));
}

#[test]
fn flip_nan_is_one_there_and_nowhere_else() {
    let a = vec![[0.5; 3]; 30 * 30];
    let mut b = a.clone();
    b[465] = [0.5, f32::NAN, 0.5];
    for (a, b) in [(&a, &b), (&b, &a), (&b, &b)] {
        let map = flip::ldr(30, 30, a, b, &FlipOptions::default()).unwrap();
        assert_eq!(map.error[465], 1.0);
        assert_eq!(map.error.iter().filter(|&&e| e != 0.0).count(), 1);
        let hdr = flip::hdr(30, 30, a, b, &FlipOptions::default()).unwrap();
        assert_eq!(hdr.map.error.iter().filter(|&&e| e != 0.0).count(), 1);
    }
}

#[test]
fn flip_clamps_what_a_screen_cannot_show() {
    let options = FlipOptions::default();
    let white = vec![[1.0; 3]; 25];
    let bright = vec![[INF, 3.0, 1.0]; 25];
    assert_eq!(flip::ldr(5, 5, &white, &bright, &options).unwrap().mean, 0.0);
    assert_eq!(flip::ldr(5, 5, &[[0.0; 3]; 25], &[[-1.0, -INF, 0.0]; 25], &options).unwrap().mean, 0.0);
    // HDR-FLIP, in contrast, shows the difference, at an exposure that it chooses.
    assert!(flip::hdr(5, 5, &white, &bright, &options).unwrap().map.mean > 0.1);
}

#[test]
fn flip_srgb_encoding_equals_decoding_first() {
    let (a, _) = encoded_pair();
    let (_, b) = encoded_pair();
    let decode = |p: &[[f32; 3]]| -> Vec<[f32; 3]> {
        p.iter().map(|c| c.map(|v| surfel_math::srgb::decode(f64::from(v)) as f32)).collect()
    };
    let srgb = FlipOptions { encoding: Encoding::Srgb, ..FlipOptions::default() };
    let encoded = flip::ldr(16, 8, &a, &b, &srgb).unwrap();
    let linear = flip::ldr(16, 8, &decode(&a), &decode(&b), &FlipOptions::default()).unwrap();
    // 1e-4: decoding to f32 changes a colour by 6e-8, which the feature term's square root turns into 3e-4 of an
    // exponent at worst.
    assert!((encoded.mean - linear.mean).abs() < 1e-4 && encoded.mean > 0.01);
    assert!(flip::hdr(16, 8, &a, &b, &srgb).is_err());
}

fn encoded_pair() -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
    (0..128usize)
        .map(|i| {
            let v = (i * 37 % 128) as f32 / 127.0;
            ([v, 1.0 - v, 0.5], [0.9 * v, 1.0 - v, 0.4])
        })
        .unzip()
}

#[test]
fn flip_of_images_without_pixels_is_empty() {
    for (w, h) in [(0, 0), (0, 5), (5, 0)] {
        let map = flip::ldr(w, h, &[], &[], &FlipOptions::default()).unwrap();
        assert_eq!((map.error.len(), map.mean), (0, 0.0));
        assert_eq!(flip::hdr(w, h, &[], &[], &FlipOptions::default()).unwrap().map.mean, 0.0);
        let empty = Image::new(w, h, &[]).unwrap();
        assert_eq!(compare(&empty, &empty, &CompareOptions::default()).unwrap().flip_mean, Some(0.0));
    }
}
