//! FLIP against the authors' own program, `flip-evaluator` 1.7 from PyPI.
//!
//! The expected numbers come from this recipe (NumPy, flip_evaluator), run once; no Python runs here:
//! ```python
//! def images(w, h):
//!     y, x, c = numpy.meshgrid(range(h), range(w), range(3), indexing="ij")
//!     a = (x * 37 + y * 59 + c * 101 + (x * y) % 17 * 13) % 256
//!     a = numpy.where(x > w // 2, (x * (7 + c) + y * (11 - 3 * c) + 40 * c) % 256, a)
//!     b = numpy.minimum(a + ((x // 5 + y // 3) % 2) * 40, 255)
//!     b = numpy.where((x + 2 * y) % 23 == 0, 255 - b, b)
//!     return (a / 255).astype("f4"), (b / 255).astype("f4")
//! a, b = images(w, h)
//! # for HDR: a = (a * a) * (a * a) * float32(1000), b alike
//! error, mean, parameters = flip_evaluator.evaluate(
//!     a, b, "LDR" or "HDR", inputsRGB=srgb, applyMagma=False, parameters={"ppd": ppd} or {})
//! ```
//! Measured agreement: see [`TOLERANCE`].

use surfel_metrics::flip::{self, Encoding, FlipOptions};

/// Largest accepted difference between our FLIP errors and those of flip-evaluator, which computes in f32 and takes the
/// square root of feature differences. The root turns its rounding of about 1e-7 into 3e-4 of an exponent where nothing
/// differs: a few 1e-5 of an error. Measured over all pixels of the images below, the difference is at most 6.4e-6. In
/// one image (20 pixels per degree) it is 1.1e-4, at a pixel that isn't probed here. Means agree to 2e-7, the mean of
/// the single-pixel image to 6.4e-6.
const TOLERANCE: f64 = 2e-5;

type Pixels = Vec<[f32; 3]>;

fn images(w: usize, h: usize) -> (Pixels, Pixels) {
    let level = |x: usize, y: usize, c: usize| {
        if x > w / 2 {
            ((x * (7 + c) + y * 11 + 40 * c) as i64 - (3 * c * y) as i64).rem_euclid(256)
        } else {
            ((x * 37 + y * 59 + c * 101 + (x * y) % 17 * 13) % 256) as i64
        }
    };
    let changed = |x: usize, y: usize, level: i64| {
        let level = (level + ((x / 5 + y / 3) % 2) as i64 * 40).min(255);
        if (x + 2 * y).is_multiple_of(23) { 255 - level } else { level }
    };
    let channels = [0, 1, 2];
    let value = |level: i64| (level as f64 / 255.0) as f32;
    (0..h)
        .flat_map(|y| (0..w).map(move |x| (x, y)))
        .map(|(x, y)| {
            let levels = channels.map(|c| level(x, y, c));
            (levels.map(value), levels.map(|l| value(changed(x, y, l))))
        })
        .unzip()
}

struct Expected {
    width: usize,
    height: usize,
    options: FlipOptions,
    mean: f64,
    /// FLIP errors at the pixels of `probe_indices`: the first, the last, and two inner pixels.
    probes: [f64; 4],
}

fn probe_indices(w: usize, h: usize) -> [usize; 4] {
    [0, w * h - 1, h / 2 * w + w / 2, h / 3 * w + w / 4]
}

fn check(name: &str, e: &Expected, map: &flip::FlipMap) {
    assert_eq!(map.error.len(), e.width * e.height);
    assert!((map.mean - e.mean).abs() < TOLERANCE, "{name}: mean {} expected {}", map.mean, e.mean);
    for (i, expected) in probe_indices(e.width, e.height).into_iter().zip(e.probes) {
        let found = map.error[i];
        assert!((f64::from(found) - expected).abs() < TOLERANCE, "{name}: pixel {i} {found} expected {expected}");
    }
}

fn ppd(pixels_per_degree: f64, encoding: Encoding) -> FlipOptions {
    FlipOptions { pixels_per_degree, encoding }
}

const DENSITY: f64 = flip::DEFAULT_PIXELS_PER_DEGREE;

#[test]
fn flip_ldr_agrees_with_the_authors_program() {
    let cases = [
        (
            "srgb",
            Expected {
                width: 16,
                height: 12,
                options: ppd(DENSITY, Encoding::Srgb),
                mean: 0.328915466,
                probes: [0.7984750, 0.3435118, 0.2947668, 0.2809774],
            },
        ),
        (
            "linear",
            Expected {
                width: 16,
                height: 12,
                options: ppd(DENSITY, Encoding::Linear),
                mean: 0.259332167,
                probes: [0.7214730, 0.1852661, 0.2355148, 0.2452628],
            },
        ),
        (
            "ppd20",
            Expected {
                width: 40,
                height: 30,
                options: ppd(20.0, Encoding::Linear),
                mean: 0.297396643,
                probes: [0.9636629, 0.0079075, 0.5150211, 0.3947079],
            },
        ),
        (
            "ppd150",
            Expected {
                width: 64,
                height: 48,
                options: ppd(150.0, Encoding::Srgb),
                mean: 0.280212757,
                probes: [0.6893619, 0.5132568, 0.2167727, 0.2328282],
            },
        ),
        (
            "wide",
            Expected {
                width: 97,
                height: 61,
                options: ppd(DENSITY, Encoding::Linear),
                mean: 0.263223799,
                probes: [0.7219656, 0.4232242, 0.2627877, 0.1818953],
            },
        ),
        (
            "tiny",
            Expected {
                width: 1,
                height: 1,
                options: ppd(DENSITY, Encoding::Linear),
                mean: 0.962833822,
                probes: [0.9628338, 0.9628338, 0.9628338, 0.9628338],
            },
        ),
        (
            "row",
            Expected {
                width: 5,
                height: 1,
                options: ppd(DENSITY, Encoding::Linear),
                mean: 0.650454652,
                probes: [0.9449564, 0.3528875, 0.6493526, 0.8063313],
            },
        ),
    ];
    for (name, e) in cases {
        let (a, b) = images(e.width, e.height);
        let map = flip::ldr(e.width as u32, e.height as u32, &a, &b, &e.options).unwrap();
        check(name, &e, &map);
    }
}

#[test]
fn flip_ldr_every_pixel_agrees_with_the_authors_program() {
    let (a, b) = images(16, 12);
    let map = flip::ldr(16, 12, &a, &b, &ppd(DENSITY, Encoding::Srgb)).unwrap();
    for (i, (&found, expected)) in map.error.iter().zip(SRGB_16X12.into_iter().flatten()).enumerate() {
        assert!(f64::from((found - expected).abs()) < TOLERANCE, "pixel {i}: {found} expected {expected}");
    }
}

#[test]
fn flip_hdr_agrees_with_the_authors_program() {
    let e = Expected {
        width: 32,
        height: 24,
        options: ppd(DENSITY, Encoding::Linear),
        mean: 0.452438393,
        probes: [0.9222564, 0.3074383, 0.4318324, 0.3554541],
    };
    let (a, b) = images(e.width, e.height);
    let bright = |p: Pixels| -> Pixels { p.into_iter().map(|c| c.map(|v| (v * v) * (v * v) * 1000.0)).collect() };
    let hdr = flip::hdr(e.width as u32, e.height as u32, &bright(a), &bright(b), &e.options).unwrap();
    check("hdr", &e, &hdr.map);
    // 1e-5: the program's exposures are f32 logarithms of about 5.
    assert!((hdr.start_exposure - (-8.4739904)).abs() < 1e-5, "{}", hdr.start_exposure);
    assert!((hdr.stop_exposure - (-5.7889690)).abs() < 1e-5, "{}", hdr.stop_exposure);
    assert_eq!(hdr.exposures, 3);
}

/// FLIP errors that flip-evaluator computes for all pixels of the 16×12 images, read as sRGB, row by row from the top.
#[rustfmt::skip]
const SRGB_16X12: [[f32; 16]; 12] = [
    [
        0.798475, 0.622325, 0.452446, 0.339423, 0.307915, 0.361990, 0.413223, 0.384220,
        0.428693, 0.370145, 0.259535, 0.170712, 0.136320, 0.169657, 0.302776, 0.416891,
    ],
    [
        0.607780, 0.484670, 0.380874, 0.299315, 0.278667, 0.311633, 0.347110, 0.346138,
        0.376559, 0.341940, 0.244628, 0.179766, 0.151635, 0.164534, 0.260690, 0.355574,
    ],
    [
        0.452305, 0.388986, 0.346325, 0.291599, 0.279198, 0.273117, 0.285992, 0.321350,
        0.343311, 0.322411, 0.257523, 0.247668, 0.237030, 0.228802, 0.262779, 0.336008,
    ],
    [
        0.423580, 0.375839, 0.340486, 0.307854, 0.288127, 0.229271, 0.188057, 0.233292,
        0.259080, 0.286620, 0.318669, 0.328279, 0.325674, 0.337397, 0.312685, 0.221177,
    ],
    [
        0.385616, 0.351246, 0.329905, 0.308611, 0.280977, 0.220074, 0.148662, 0.126336,
        0.171900, 0.251783, 0.329331, 0.352800, 0.367745, 0.351404, 0.296979, 0.271824,
    ],
    [
        0.314511, 0.286647, 0.289293, 0.304805, 0.283725, 0.259342, 0.215127, 0.200991,
        0.222352, 0.254236, 0.291328, 0.314430, 0.297826, 0.262558, 0.279873, 0.263554,
    ],
    [
        0.238081, 0.212737, 0.225112, 0.246606, 0.273997, 0.307333, 0.309597, 0.317633,
        0.294767, 0.235080, 0.187152, 0.176381, 0.178138, 0.211203, 0.324787, 0.423508,
    ],
    [
        0.203737, 0.199787, 0.200217, 0.217047, 0.276175, 0.335831, 0.354308, 0.345836,
        0.303346, 0.218642, 0.164518, 0.172325, 0.209440, 0.268006, 0.361122, 0.456018,
    ],
    [
        0.297681, 0.287095, 0.287433, 0.293185, 0.348251, 0.397455, 0.377282, 0.329163,
        0.311027, 0.297242, 0.316000, 0.339501, 0.351253, 0.355859, 0.370727, 0.415190,
    ],
    [
        0.428667, 0.413847, 0.401217, 0.398972, 0.422477, 0.419233, 0.350784, 0.263017,
        0.274146, 0.351024, 0.432931, 0.466611, 0.470018, 0.447698, 0.402590, 0.362704,
    ],
    [
        0.477999, 0.508587, 0.503741, 0.463402, 0.440230, 0.378430, 0.273740, 0.169008,
        0.222760, 0.373818, 0.482498, 0.529382, 0.536118, 0.489657, 0.406923, 0.341836,
    ],
    [
        0.536833, 0.589546, 0.573875, 0.521743, 0.454655, 0.348330, 0.223042, 0.112497,
        0.222985, 0.393255, 0.497849, 0.555975, 0.551078, 0.494170, 0.403005, 0.343512,
    ],
];
