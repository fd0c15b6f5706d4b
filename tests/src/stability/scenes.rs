//! Sweeps of many splats.

use super::{Image, Measure, Naive, Probe, Sweep, Truth, powers};
use crate::build::{Splat, camera, confetti, scene};
use crate::scenes::{gaussian_scene, random_gaussians};
use glam::DVec3;
use surfel_math::V3;
use surfel_math::project::ViewSplat;
use surfel_model::{Camera, Column3, Filter, GaussianKind, Settings, Sort};

/// Largest error of a value of 1 that the conformance harness allows: 2e-4 + 1e-3 of the value.
const TOLERANCE: f64 = 1.2e-3;

pub(super) fn sweeps() -> Vec<Sweep> {
    let scale = |name, values, required| Sweep {
        name,
        parameter: "unit of the scene's coordinates",
        about: "A ball of 80 splats of every tilt, camera included, in larger or smaller units: the image has to stay \
                the same. f32 ends at 3.4e38; squares of coordinates do at 1.8e19 and 1e-19, and denormal numbers \
                begin at 1.2e-38.",
        law: "the conformance tolerance, 1.2e-3 of a colour, outside of decision margins: the tilts of random splats \
              have no one law",
        naive: "the weight of one of the splats by adj[s t p]/det as printed (G06 eq. 5-6), in f32: products of three \
                coordinates overflow or vanish first",
        measure: Measure::Color,
        values,
        required,
        probes: scaled,
    };
    vec![
        scale("unit-large", powers(0.0, 38.0, 1.0), 1e15),
        scale("unit-small", powers(0.0, -44.0, 1.0), 1e-15),
        Sweep {
            name: "overlap",
            parameter: "splats on a pixel",
            about: "Equal splats one upon another: how well sums keep up.",
            law: "|ΔΣw|/Σw ≤ n·unit roundoff, the worst that n roundings can add up to; and the kernel's own error",
            naive: "sums in half precision",
            measure: Measure::Weight,
            values: powers(0.0, 6.0, 0.5).into_iter().map(f64::round).collect(),
            required: 1e6,
            probes: overlap,
        },
        Sweep {
            name: "gaussian-distance",
            parameter: "distance of the eye from the middle of trained Gaussians",
            about: "Flat and solid Gaussians in a box of half a unit, in both orders: from 0.5 on the eye is among \
                    them, and what is nearer than 0.2 is left out, of flat ones pixel by pixel.",
            law: "the conformance tolerance, 1.2e-3 of a colour, outside of decision margins",
            naive: "",
            measure: Measure::Color,
            values: powers(1.0, -6.0, 0.5),
            required: 1e-6,
            probes: near_gaussians,
        },
    ]
}

fn scaled(unit: f64) -> Vec<Probe> {
    let by = |v: DVec3| (v * unit).as_vec3().as_dvec3();
    let scaled = |s: Splat| Splat { p: by(s.p), s: by(s.s), t: by(s.t), ..s };
    let all = confetti(80, 0.12, 3.0, 5);
    // The published formula is evaluated for the splat in the middle of the image that faces the eye most, because
    // tilted splats have larger errors.
    let facing = |s: &Splat| s.s.cross(s.t).normalize().dot((s.p - DVec3::Z * 3.0).normalize()).abs();
    let middle = all.iter().copied().filter(|s| s.p.truncate().length() < 0.6);
    let facing_most = middle.max_by(|a, b| facing(a).total_cmp(&facing(b))).map(scaled);
    let view = camera(3.0, 45.0, [40, 40]);
    let view = Camera { eye: view.eye.map(|v| v * unit), near: 0.01 * unit, ..view };
    // Rounding of coordinates may reduce a splat's area to zero, which is invalid.
    let is_valid = |s: &Splat| {
        let (a, b) = (s.s / s.s.abs().max_element(), s.t / s.t.abs().max_element());
        s.p.is_finite() && a.is_finite() && b.is_finite() && a.normalize().cross(b.normalize()).length() > 1e-6
    };
    let of_eye = |v: DVec3| V3::new(v.x, -v.y, -v.z);
    let seen = |s: Splat| ViewSplat {
        p: of_eye(s.p - DVec3::Z * (3.0 * unit)),
        s: of_eye(s.s),
        t: of_eye(s.t),
        // The published form doesn't use the normal.
        n: V3::new(0.0, 0.0, -1.0),
    };
    let naive = facing_most.map_or(Naive::Nothing, |s| Naive::Matrix(seen(s)));
    let splats: Vec<Splat> = all.into_iter().map(scaled).filter(is_valid).collect();
    let image = Image { scene: scene(&splats), camera: view, region: None, settings: Settings::default() };
    vec![Probe { image, truth: Truth::Reference, amplification: 0.0, floor: TOLERANCE, scale: 1.0, naive }]
}

fn overlap(count: f64) -> Vec<Probe> {
    let (z, focal) = (2.0, 8.0);
    let r = 0.9f32;
    let splat = Splat {
        p: DVec3::new(0.0625, -0.03125, -z),
        s: DVec3::X * f64::from(r),
        t: DVec3::Y * f64::from(r),
        color: [0.3, 0.7, 0.1],
    };
    let splats = vec![splat; count as usize];
    let camera = Camera {
        eye: [0.0; 3],
        target: [0.0, 0.0, -1.0],
        projection: surfel_model::Projection::Intrinsics { fx: focal, fy: focal, cx: 4.0, cy: 4.0 },
        ..camera(0.0, 45.0, [8, 8])
    };
    let view = |v: DVec3| V3::new(v.x, -v.y, -v.z);
    let one = ViewSplat { p: view(splat.p), s: view(splat.s), t: view(splat.t), n: V3::new(0.0, 0.0, -1.0) };
    let settings = Settings::default().with_filter(Filter::None);
    vec![Probe {
        image: Image { scene: scene(&splats), camera, region: None, settings },
        truth: Truth::Exact(one, count as u32),
        amplification: count + 64.0,
        floor: 0.0,
        scale: count,
        naive: Naive::Known(super::naive::half_sum(count as u32, 0.75)),
    }]
}

fn near_gaussians(distance: f64) -> Vec<Probe> {
    let probe = |(kind, sort): (GaussianKind, Sort)| {
        let mut data = random_gaussians(60, kind, 9);
        let centers: Vec<DVec3> = (0..60).map(|i| 0.5 * data.centers.get(i)).collect();
        data.centers = Column3::from_f64(&centers);
        let image = Image {
            scene: gaussian_scene(data),
            camera: camera(distance, 60.0, [40, 40]),
            region: None,
            settings: Settings::default().with_sort(sort),
        };
        let (truth, naive) = (Truth::Reference, Naive::Nothing);
        Probe { image, truth, amplification: 0.0, floor: TOLERANCE, scale: 1.0, naive }
    };
    let kinds = [GaussianKind::Flat, GaussianKind::Solid];
    kinds.into_iter().flat_map(|kind| [Sort::Center, Sort::Pixel].map(|sort| (kind, sort))).map(probe).collect()
}
