//! Sweeps of one splat, compared with exact arithmetic.

use super::{Image, Measure, Naive, Probe, Sweep, Truth, powers};
use crate::build::{Clipped, Splat, clipped_cloud, cloud, object};
use crate::random::Random;
use glam::DVec3;
use surfel_math::clip::{Clip, Curve};
use surfel_math::mapping::through_near;
use surfel_math::project::{Projected, ViewSplat};
use surfel_math::projection::Projection;
use surfel_math::svd::Svd2;
use surfel_math::{V2, V3, basis};
use surfel_model::{
    Camera, ClipCurve, ClipMode, CloudData, Column3, Filter, OnInvalid, Scene, Settings, Shape, SplatCloud,
};
use surfel_render::Region;

/// Largest absolute slope of the kernel exp(−2ρ²) over ρ.
const STEEPEST: f64 = 1.213;
/// Number of roundings in the f32 setup between a splat's coordinates and a pixel's offset in units of its axes. There
/// are three each for normal, view, centre and column, two for the determinant, one each for the offset and the form.
const ROUNDINGS: f64 = 16.0;
/// Focal length of the 4K camera, in pixels.
const FOCAL_PX: f64 = 2000.0;
/// Width and height of the 4K camera's image, in pixels.
const SIZE: [u32; 2] = [3840, 2160];
/// Principal point of the 4K camera, in pixels.
const PRINCIPAL_PX: [f64; 2] = [1920.25, 1080.5];
/// Distance of splats from the eye, in world units.
const Z: f64 = 4.0;
/// Linear colour of the splats.
const COLOR: [f32; 3] = [0.7, 0.4, 0.2];

/// Error bound of the weight of one splat, with its derivation, for reports.
const LAW: &str = "|Δw| ≤ 1.213·δ/r_minor: 1.213 is the kernel's steepest slope, r_minor the projected minor radius in \
                   pixels (at least h under a filter, whose factor ℓ/h adds as much again), δ = 16·(r_major + 1)·unit \
                   roundoff pixels for 16 roundings between a coordinate and an offset; besides, the kernel \
                   polynomial's 1.3e-6 and the planes' rounding to f32";
/// Error bound of the weight of a splat smaller than the filter, with its derivation.
const SHARE_LAW: &str = "as before, in units of the splat's own weight ℓ/h, and 16·unit roundoff·r_major/ℓ for ℓ, \
                         which has the same 16 roundings";
/// Error bound of the weight of a splat with nearly parallel half-axes, with its derivation.
const SKEW_LAW: &str = "as elevation-filtered, in units of the splat's own weight ℓ/h, and 32·unit roundoff for ℓ: \
                        principal axes are stored, so that nearly parallel ones add nothing";
/// Error bound of the weight of a splat near the eye, with its derivation.
const NEAR_LAW: &str = "|Δw| ≤ 1.213·4·(|U| + |V| + ρ|W|)/W·unit roundoff, the forms by the sizes of their terms about \
                        the image's middle: the image need not be an ellipse";
/// Description of the published matrix form of a splat, with which Surfel's is compared.
const MATRIX: &str = "adj[s t p]/det as printed (G06 eq. 5-6), constant terms at pixel (0, 0), in f32";
/// Description of the published filter by a covariance matrix, with which Surfel's is compared.
const COVARIANCE: &str = "the filter of Z01 eq. 6-9 as printed, its covariance matrix inverted by its determinant and \
                          the weight the root of two determinants' quotient, in f32; held against the same filter in \
                          f64, since it is another than ours";

pub(super) fn sweeps() -> Vec<Sweep> {
    let elevations = || [90.0, 45.0].into_iter().chain(powers(1.0, -9.0, 1.0)).collect();
    let sides = (0..=16).map(|k| f64::from(1u32 << k)).collect();
    let sweep = |name, parameter, values, required, probes| Sweep {
        name,
        parameter,
        about: "",
        law: LAW,
        naive: "",
        measure: Measure::Weight,
        values,
        required,
        probes,
    };
    vec![
        Sweep {
            about: "A disk of 12 px in the corner of a 4K image, tilted until it is seen from its edge and its image \
                    is a line. Below 5.7e-4° it is edge-on and not drawn, by definition.",
            naive: MATRIX,
            ..sweep("elevation", "elevation above edge-on, degrees", elevations(), 1e-9, elevation)
        },
        Sweep {
            about: "The same with the filter: its footprint keeps half a pixel's width, so the error stays bounded.",
            naive: COVARIANCE,
            ..sweep("elevation-filtered", "elevation above edge-on, degrees", elevations(), 1e-9, elevation_filtered)
        },
        Sweep {
            about: "The same again, the error in units of the splat's own largest weight, which shrinks with its \
                    width: what shows where it lies beside nothing but others like it. The width is the disk's times \
                    the sine of its elevation, of which f32 has the sine to 1e-6 at most: 0.6 % of the weight at 0.01 \
                    degrees, 10 % at 5.7e-4, the last that is drawn. This is stated and not mended: such a splat is \
                    2e-4 and 1e-5 of its length wide, and in an image counts by that. Closer to edge-on, pixels are \
                    within the margin of that decision and not compared.",
            law: SHARE_LAW,
            naive: COVARIANCE,
            ..sweep(
                "elevation-alone",
                "elevation above edge-on, degrees",
                powers(1.5, -3.0, 0.5),
                1e-3,
                elevation_alone,
            )
        },
        Sweep {
            about: "An ellipse of 12 px that becomes a needle: its minor axis is 1/aspect of its major one. Beyond 1e4 \
                    it lies between all pixel centres: that is what filters are for.",
            naive: MATRIX,
            ..sweep("aspect", "aspect ratio", powers(0.0, 12.0, 1.0), 1e8, aspect)
        },
        Sweep {
            about: "The same needles with the filter.",
            naive: COVARIANCE,
            ..sweep("aspect-filtered", "aspect ratio", powers(0.0, 12.0, 1.0), 1e8, aspect_filtered)
        },
        Sweep {
            about: "An ellipse given by half-axes that are nearly parallel: its normal is the cross product of two \
                    nearly equal vectors. Files with axes that are parallel in f32 are refused.",
            naive: MATRIX,
            ..sweep("skew", "sine of the angle between the half-axes", powers(0.0, -6.0, 0.5), 1e-6, skew)
        },
        Sweep {
            about: "A needle with the filter, given by half-axes that are both nearly along it: the longer one, and \
                    one and a half of it beside the shorter one. Errors are in units of the splat's own weight.",
            law: SKEW_LAW,
            naive: COVARIANCE,
            ..sweep("aspect-skewed", "aspect ratio", powers(0.0, 6.0, 0.5), 1e5, aspect_skewed)
        },
        Sweep {
            about: "A splat that shrinks far below a pixel, with the filter: its weight shrinks by its area. A pixel \
                    whose sum of weights is below 1e-36, where f32's normal numbers are about to end, is left empty; \
                    that is reached at a radius of 1e-21. Errors are in units of the splat's own weight.",
            naive: COVARIANCE,
            ..sweep("radius-small", "radius at distance 4, world units", powers(-2.0, -30.0, 1.0), 1e-15, radius_small)
        },
        Sweep {
            about: "A disk that grows until it is everything that is seen: facing the eye, tilted about the image's \
                    axes, and any other way.",
            law: NEAR_LAW,
            naive: MATRIX,
            ..sweep("radius-large", "radius at distance 4, world units", powers(0.0, 30.0, 1.0), 1e30, radius_large)
        },
        Sweep {
            about: "A disk of radius 1 that moves away, with the filter, until its weight is below 1e-36. Errors are \
                    in units of the splat's own weight.",
            naive: COVARIANCE,
            ..sweep("distance", "distance, world units", powers(1.0, 30.0, 1.0), 1e15, distance)
        },
        Sweep {
            about: "A disk of radius 1 around the camera, whose plane comes closer and closer to the eye: most of it \
                    lies behind the eye, the rest reaches to the horizon. Below 1e-5 of the distance to its centre it \
                    is edge-on and not drawn.",
            law: NEAR_LAW,
            naive: MATRIX,
            ..sweep("eye-plane", "distance of the eye from the disk's plane", powers(-1.0, -12.0, 1.0), 1e-9, eye_plane)
        },
        Sweep {
            about: "A disk at distance 4 and a near plane that is closer and closer to the eye: how well depth is \
                    kept.",
            law: "|Δz|/z ≤ 16·unit roundoff/sin(elevation): depth is p_z times the reciprocal of a form that is linear \
                  over pixels; nothing depends on the near plane",
            naive: "a 24-bit depth buffer with far = 10·z, read back",
            measure: Measure::Depth,
            ..sweep("near", "distance over z_near", powers(0.5, 30.0, 0.5), 1e12, near)
        },
        Sweep {
            about: "Scene and camera moved away from the origin together, as georeferenced data is.",
            law: "as elevation, with δ + 4·offset·2⁻⁵³·f/z pixels: what f64 coordinates that far out can hold",
            naive: "positions and eye in f32, everything else exact",
            ..sweep("offset", "distance from the origin over the disk's distance", powers(0.0, 15.0, 1.0), 1e9, offset)
        },
        Sweep {
            about: "A disk of 4 px in the last corner of larger and larger images, of which only that corner is \
                    rendered.",
            naive: MATRIX,
            ..sweep("image", "image side, pixels", sides, 16384.0, image)
        },
        Sweep {
            about: "A disk whose centre is far outside of the image, and of which just a rim of 8 px reaches in.",
            naive: MATRIX,
            ..sweep("outside", "distance of the centre from the image, px", powers(0.0, 9.0, 1.0), 1e6, outside)
        },
        Sweep {
            about: "A disk cut by a rational Bézier curve of larger and larger weight: the curve becomes its control \
                    polygon.",
            law: "no pixel is on the wrong side of the curve but within 1e-3 px of it",
            naive: "C12 eq. 7 as printed, t = (a ± √(a² − bc))/c, in f32",
            measure: Measure::Coverage,
            ..sweep("clip-weight-large", "curve weight", powers(0.0, 12.0, 1.0), 1e9, clip)
        },
        Sweep {
            about: "The same with a weight that vanishes: the curve becomes its chord.",
            law: "no pixel is on the wrong side of the curve but within 1e-3 px of it",
            naive: "C12 eq. 7 as printed, t = (a ± √(a² − bc))/c, in f32",
            measure: Measure::Coverage,
            ..sweep("clip-weight-small", "curve weight", powers(0.0, -12.0, 1.0), 1e-9, clip)
        },
    ]
}

/// Rounds the coordinates of a vector to f32.
fn single(v: DVec3) -> DVec3 {
    v.as_vec3().as_dvec3()
}

/// Creates an ellipse in view space. Its numbers are rounded to f32, so that clouds store them exactly.
fn ellipse(p: DVec3, s: DVec3, t: DVec3) -> ViewSplat<f64> {
    let (p, s, t) = (single(p), single(s), single(t));
    let n = basis::unit(basis::unit(s).cross(basis::unit(t)));
    ViewSplat { p: V3::from(p), s: V3::from(s), t: V3::from(t), n: V3::from(n) }
}

/// Creates an ellipse whose centre projects to a pixel. Its half-axes have the lengths `radii`. Its plane is at
/// `elevation` (radians) from edge-on; `turn` (radians) is the rotation around the line of sight.
fn tilted(pixel: [f64; 2], z: f64, radii: [f64; 2], elevation: f64, turn: f64) -> ViewSplat<f64> {
    let [x, y] = [0, 1].map(|axis| (pixel[axis] - PRINCIPAL_PX[axis]) / FOCAL_PX);
    let p = DVec3::new(x, y, 1.0) * z;
    let along = basis::unit(p);
    let a = basis::unit(along.cross(DVec3::new(0.3, 0.5, -0.81)));
    let b = along.cross(a);
    let (sin, cos) = turn.sin_cos();
    let (a, b) = (a * cos + b * sin, b * cos - a * sin);
    let tilted = b * elevation.sin() + along * elevation.cos();
    ellipse(p, a * radii[0], tilted * radii[1])
}

fn camera(focal: f64, principal: [f64; 2], size: [u32; 2], near: f64) -> Camera {
    Camera {
        eye: [0.0; 3],
        target: [0.0, 0.0, -1.0],
        up: [0.0, 1.0, 0.0],
        projection: surfel_model::Projection::Intrinsics { fx: focal, fy: focal, cx: principal[0], cy: principal[1] },
        near,
        far: None,
        size,
    }
}

/// Returns the 4K camera with a region of `side`×`side` pixels around a pixel.
fn corner(pixel: [f64; 2], side: u32, near: f64) -> (Camera, Region) {
    let start = |axis: usize| (pixel[axis] as u32).saturating_sub(side / 2).min(SIZE[axis] - side);
    (camera(FOCAL_PX, PRINCIPAL_PX, SIZE, near), Region { x: start(0), y: start(1), width: side, height: side })
}

/// Converts a vector from view to world coordinates. The camera at the origin looks along −z with +y up.
fn world(v: V3<f64>) -> DVec3 {
    DVec3::new(v.x, -v.y, -v.z)
}

fn unfiltered() -> Settings {
    Settings::default().with_filter(Filter::None)
}

fn scene(splats: &[Splat]) -> Scene {
    Scene { objects: vec![object(cloud(splats))], background: [0.0; 4], ..Scene::default() }
}

fn in_scene(splat: &ViewSplat<f64>) -> Splat {
    Splat { p: world(splat.p), s: world(splat.s), t: world(splat.t), color: COLOR }
}

/// Returns the singular values ℓ of a splat's projection in pixels, major and minor.
fn lengths(splat: &ViewSplat<f64>, projection: &Projection) -> [f64; 2] {
    let projected = Projected::new(splat, projection);
    let svd = Svd2::of_columns(projected.j_s, projected.j_t, projected.det_j);
    [svd.major, svd.minor]
}

/// Returns the factor of the unit roundoff in the error bound [`LAW`] of a splat.
fn amplification(splat: &ViewSplat<f64>, projection: &Projection, h_px: f64) -> f64 {
    let [major, minor] = lengths(splat, projection);
    // With a filter, the weight's factor ℓ/h adds the rounding error of ℓ.
    let factor = if minor < h_px { 1.0 } else { 0.0 };
    (STEEPEST + factor) * ROUNDINGS * (major.max(h_px) + 1.0) / minor.max(h_px)
}

/// Returns a probe of one splat. If it is unfiltered, it is compared with exact arithmetic. If it is filtered by
/// `principal`, it is compared with the f64 reference.
fn probe(splat: ViewSplat<f64>, (camera, region): (Camera, Region), filtered: bool) -> Probe {
    let settings = if filtered { Settings::default() } else { unfiltered() };
    let h = if filtered { settings.prefilter_radius_px } else { 0.0 };
    let image = Image { scene: scene(&[in_scene(&splat)]), camera, region: Some(region), settings };
    let projection = image.view().projection;
    Probe {
        amplification: amplification(&splat, &projection, h),
        image,
        truth: if filtered { Truth::Reference } else { Truth::Exact(splat, 1) },
        floor: 0.0,
        scale: 1.0,
        naive: if filtered { Naive::Covariance(splat) } else { Naive::Matrix(splat) },
    }
}

/// Returns a probe of a filtered splat, with weights in units of the splat's largest weight, ∏ min(1, ℓ/h). Here ℓ are
/// the projected half-axes and h is the filter radius, in pixels. The error bound is raised by the relative error of ℓ,
/// 16 roundings times ℓ_major/ℓ_minor.
fn shrunk(splat: ViewSplat<f64>, crop: (Camera, Region)) -> Probe {
    let probe = probe(splat, crop, true);
    let [major, minor] = lengths(&splat, &probe.image.view().projection);
    let h = probe.image.settings.prefilter_radius_px;
    let scale = (major / h).min(1.0) * (minor / h).min(1.0);
    Probe { scale, amplification: probe.amplification + ROUNDINGS * major / minor, ..probe }
}

/// Returns a probe of an unfiltered splat near the eye, whose image need not be an ellipse. The law's amplification is
/// that of the splat's forms divided by W. Each form has the error of four roundings of its terms, around the middle of
/// the image.
fn near_probe(splat: ViewSplat<f64>, crop: (Camera, Region)) -> Probe {
    let probe = probe(splat, crop, false);
    let view = probe.image.view();
    let Region { x, y, width, height } = view.region;
    let mapped = through_near(&splat, &view.projection);
    let forms = [mapped.footprint.u, mapped.footprint.v, mapped.footprint.w];
    let middle = V2::new(f64::from(x) + 0.5 * f64::from(width), f64::from(y) + 0.5 * f64::from(height));
    let mut amplification = 0.0f64;
    for i in 0..width * height {
        let pixel = V2::new(f64::from(x + i % width) + 0.5, f64::from(y + i / width) + 0.5);
        let [u, v, w] = forms.map(|f| f.at(pixel - mapped.anchor_px));
        let rho = u.hypot(v) / w;
        if w > 0.0 && rho <= 1.0 {
            let d = pixel - middle;
            let terms = forms.map(|f| f.at(middle - mapped.anchor_px).abs() + (f.x * d.x).abs() + (f.y * d.y).abs());
            amplification = amplification.max(4.0 * STEEPEST * (terms[0] + terms[1] + rho * terms[2]) / w);
        }
    }
    Probe { amplification, ..probe }
}

/// Position of the splats: a pixel near a corner of the 4K image.
const CORNER: [f64; 2] = [3600.3, 1900.7];
/// Rotations of the splats around the line of sight, in radians.
const TURNS: [f64; 3] = [0.2, 1.4, 2.9];
/// Returns the radius in world units that spans `px` pixels at the distance [`Z`].
fn radius(px: f64) -> f64 {
    px * Z / FOCAL_PX
}

fn elevated(degrees: f64, filtered: bool) -> Vec<Probe> {
    let one = |turn: f64| {
        let splat = tilted(CORNER, Z, [radius(12.0); 2], degrees.to_radians(), turn);
        probe(splat, corner(CORNER, 28, 0.01), filtered)
    };
    TURNS.map(one).into()
}

fn elevation(degrees: f64) -> Vec<Probe> {
    elevated(degrees, false)
}

fn elevation_filtered(degrees: f64) -> Vec<Probe> {
    elevated(degrees, true)
}

fn elevation_alone(degrees: f64) -> Vec<Probe> {
    let one =
        |turn: f64| shrunk(tilted(CORNER, Z, [radius(12.0); 2], degrees.to_radians(), turn), corner(CORNER, 28, 0.01));
    TURNS.map(one).into()
}

fn needle(aspect: f64, filtered: bool) -> Vec<Probe> {
    let one = |turn: f64| {
        let splat = tilted(CORNER, Z, [radius(12.0), radius(12.0) / aspect], 1.0, turn);
        probe(splat, corner(CORNER, 28, 0.01), filtered)
    };
    TURNS.map(one).into()
}

fn aspect(aspect: f64) -> Vec<Probe> {
    needle(aspect, false)
}

fn aspect_filtered(aspect: f64) -> Vec<Probe> {
    needle(aspect, true)
}

fn aspect_skewed(aspect: f64) -> Vec<Probe> {
    let one = |turn: f64| {
        let across = tilted(CORNER, Z, [radius(12.0), radius(12.0) / aspect], 1.0, turn);
        let [p, s, t] = [across.p, across.s, across.t].map(|v| DVec3::new(v.x, v.y, v.z));
        let skewed = ellipse(p, s, t + s * 1.5);
        let amplification = probe(skewed, corner(CORNER, 28, 0.01), true).amplification + 2.0 * ROUNDINGS;
        Probe { amplification, ..shrunk(skewed, corner(CORNER, 28, 0.01)) }
    };
    TURNS.map(one).into()
}

fn skew(sine: f64) -> Vec<Probe> {
    let one = |turn: f64| {
        let disk = tilted(CORNER, Z, [radius(12.0); 2], 1.0, turn);
        let (s, t) = (DVec3::new(disk.s.x, disk.s.y, disk.s.z), DVec3::new(disk.t.x, disk.t.y, disk.t.z));
        let t = s * (1.0 - sine * sine).max(0.0).sqrt() + t * sine;
        let p = DVec3::new(disk.p.x, disk.p.y, disk.p.z);
        let probe = probe(ellipse(p, s, t), corner(CORNER, 28, 0.01), false);
        // The minor axis is the difference of nearly parallel half-axes in f32, so it has their rounding error.
        Probe { amplification: probe.amplification * 2.0, ..probe }
    };
    TURNS.map(one).into()
}

fn radius_small(radius: f64) -> Vec<Probe> {
    let one = |turn: f64| shrunk(tilted(CORNER, Z, [radius; 2], 1.0, turn), corner(CORNER, 8, 0.01));
    TURNS.map(one).into()
}

fn radius_large(radius: f64) -> Vec<Probe> {
    let turned = TURNS.map(|turn| tilted(CORNER, Z, [radius; 2], 0.6, turn)).map(|splat| (splat, CORNER));
    // Splats at the middle of the image, on its axes and off them. Each faces the eye, or is tilted about an axis.
    let facing = |[x, y]: [f64; 2]| {
        let n = basis::unit(DVec3::new(x, y, -1.0));
        let (s, t) = basis::orthonormal(n);
        (ellipse(DVec3::new(0.0, 0.0, Z), s * radius, t * radius), PRINCIPAL_PX)
    };
    let facing = [[0.0, 0.0], [0.3, 0.0], [-3.0, 0.0], [0.0, 0.3], [0.0, -3.0], [0.2, 0.3]].map(facing);
    let one = |(splat, pixel): (ViewSplat<f64>, [f64; 2])| near_probe(splat, corner(pixel, 12, 0.01));
    turned.into_iter().chain(facing).map(one).collect()
}

fn distance(distance: f64) -> Vec<Probe> {
    let one = |turn: f64| shrunk(tilted(CORNER, distance, [1.0; 2], 1.0, turn), corner(CORNER, 8, 0.01));
    TURNS.map(one).into()
}

fn eye_plane(distance: f64) -> Vec<Probe> {
    let one = |turn: f64| {
        // The plane's normal, tilted from the line of sight.
        let (sin, cos) = turn.sin_cos();
        let n = basis::unit(DVec3::new(0.4 * sin, cos, 0.1));
        let s = basis::unit(n.cross(DVec3::new(0.2, 0.1, 1.0)));
        let t = n.cross(s);
        let p = n * distance + s * 0.2 + t * 0.3;
        let splat = ellipse(p, s, t);
        let pixel = [1920.0, 1080.0];
        let (camera, region) = (camera(24.0, pixel, SIZE, distance * 1e-3), corner(pixel, 32, 0.1).1);
        near_probe(splat, (camera, region))
    };
    TURNS.map(one).into()
}

fn near(ratio: f64) -> Vec<Probe> {
    let elevation = 0.5f64;
    let one = |turn: f64| {
        let splat = tilted(CORNER, Z, [radius(10.0); 2], elevation, turn);
        let probe = probe(splat, corner(CORNER, 24, Z / ratio), false);
        let amplification = ROUNDINGS / elevation.sin();
        Probe { amplification, naive: Naive::Known(super::naive::depth_buffer(Z / ratio, Z)), ..probe }
    };
    TURNS.map(one).into()
}

fn offset(distance: f64) -> Vec<Probe> {
    let offset = DVec3::new(1.0, -0.7, 0.6) * (distance * Z);
    let one = |turn: f64| {
        let splat = tilted(CORNER, Z, [radius(12.0); 2], 1.0, turn);
        let mut probe = probe(splat, corner(CORNER, 28, 0.01), false);
        let [_, minor] = lengths(&splat, &probe.image.view().projection);
        let rounding_px = 4.0 * offset.length() * f64::EPSILON * 0.5 * FOCAL_PX / Z;
        let local = in_scene(&splat);
        let column = |v: DVec3| Column3::from_f64(&[v]);
        let shape = Shape::Ellipses { s: column(local.s), t: column(local.t) };
        let mut data = CloudData::new(offset, column(local.p), shape);
        data.colors = Some(vec![COLOR]);
        let cloud = SplatCloud::new(data, OnInvalid::Refuse).expect("sweeps hold valid splats").0;
        probe.image.scene.objects = vec![object(cloud)];
        probe.image.camera.eye = offset.to_array();
        probe.image.camera.target = (offset + DVec3::NEG_Z * distance.max(1.0)).to_array();
        let drawn = single(offset + local.p) - single(offset);
        let drawn = ViewSplat { p: V3::from(DVec3::new(drawn.x, -drawn.y, -drawn.z)), ..splat };
        Probe { floor: (STEEPEST * rounding_px / minor).min(1.0), naive: Naive::Moved(drawn), ..probe }
    };
    TURNS.map(one).into()
}

fn image(side: f64) -> Vec<Probe> {
    let (pixels, radius_px) = (side as u32, (0.25 * side).min(4.0));
    let crop = pixels.min(16);
    let center = side - 1.5 * radius_px;
    let one = |turn: f64| {
        // The splat spans as many pixels as the image is wide.
        let place = |v: f64| (v - 0.5 * side) / side * Z;
        let p = DVec3::new(place(center), place(center - 0.2), Z);
        let (sin, cos) = turn.sin_cos();
        let r = radius_px * Z / side;
        let splat = ellipse(p, DVec3::new(cos, sin, 0.3) * r, DVec3::new(-sin, cos, -0.2) * r);
        let camera = camera(side, [0.5 * side; 2], [pixels; 2], 0.01);
        let region = Region { x: pixels - crop, y: pixels - crop, width: crop, height: crop };
        probe(splat, (camera, region), false)
    };
    TURNS.map(one).into()
}

fn outside(distance_px: f64) -> Vec<Probe> {
    let place = |px: f64, axis: usize| (px - PRINCIPAL_PX[axis]) / FOCAL_PX * Z;
    let p = DVec3::new(place(-distance_px, 0), place(900.3, 1), Z);
    let r = radius(distance_px + 8.0);
    let (camera, region) = (camera(FOCAL_PX, PRINCIPAL_PX, SIZE, 0.01), Region { x: 0, y: 888, width: 16, height: 24 });
    // The splat faces the eye. Its axes are rotated, so that no form is zero.
    let splat = ellipse(p, DVec3::new(0.8, 0.6, 0.0) * r, DVec3::new(-0.6, 0.8, 0.0) * r);
    vec![probe(splat, (camera, region), false)]
}

fn clip(weight: f64) -> Vec<Probe> {
    let mut random = Random::new(11);
    let one = |_| {
        let theta1 = random.range(0.0, 6.0);
        let theta3 = theta1 + random.range(0.8, 4.0);
        let [u, v] = [random.range(-1.2, 1.2), random.range(-1.2, 1.2)].map(|v| v as f32);
        let curve = ClipCurve { theta1: theta1 as f32, theta3: theta3 as f32, u, v, w: weight as f32 };
        let r = radius(14.0);
        let [x, y] = [0, 1].map(|axis| (CORNER[axis] - PRINCIPAL_PX[axis]) / FOCAL_PX * Z);
        let splat = ellipse(DVec3::new(x, y, Z), DVec3::X * r, DVec3::NEG_Y * r);
        let mut probe = probe(splat, corner(CORNER, 30, 0.01), false);
        let clipped = Clipped { splat: in_scene(&splat), curve: Some(curve), lines: Vec::new(), mode: ClipMode::And };
        probe.image.scene.objects = vec![object(clipped_cloud(&[clipped]))];
        let control = V2::new(f64::from(u), f64::from(v));
        let curve = Curve::from_angles(f64::from(curve.theta1), f64::from(curve.theta3), control, f64::from(curve.w));
        Probe { truth: Truth::Reference, amplification: 0.0, naive: Naive::Known(misjudged(&curve)), ..probe }
    };
    (0..10).map(one).collect()
}

/// Returns the fraction of the disk's points that C12 eq. 7 puts on the wrong side of the curve.
fn misjudged(curve: &Curve) -> f64 {
    let ours = Clip::nothing().with_curve(curve);
    let mut random = Random::new(5);
    let (mut wrong, count) = (0u32, 4000);
    for _ in 0..count {
        let (radius, angle) = (random.range(0.0, 1.0).sqrt(), random.range(0.0, std::f64::consts::TAU));
        let q = V2::new(radius * angle.cos(), radius * angle.sin());
        wrong += u32::from(ours.curve_keeps(q) != super::naive::clip_keeps(curve, q));
    }
    f64::from(wrong) / f64::from(count)
}
