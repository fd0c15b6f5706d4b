//! Sweeps of a thin sheet over a floor. What is behind the sheet's underside must never blend with its top (rendering
//! model, §5).

use super::{Image, Measure, Naive, Probe, Sweep, Truth, powers};
use crate::build::{Splat, camera, cloud, object, scene, sheet};
use glam::DVec3;
use surfel_model::{Camera, Filter, Projection, Settings};

/// Largest error of a value of 1 that the conformance harness allows: 2e-4 + 1e-3 of the value.
const TOLERANCE: f64 = 1.2e-3;
/// Colour of the sheet's top, linear.
const TOP: [f32; 3] = [0.9, 0.5, 0.1];
/// Radius of the disks, in units of the sheet's half size.
const RADIUS: f64 = 0.07;
/// Distance between the sheet's top and its underside, and between the underside and the floor, in units of the sheet's
/// half size.
const THICKNESS: f64 = 0.02;
/// Half the height of the view at the middle of the sheet, in units of the sheet's half size.
const HALF_VIEW: f64 = 0.2;

/// Parameters of a view of the sheet: the unit of all lengths, the camera's elevation and distance, and the sheet's
/// thickness.
#[derive(Clone, Copy)]
struct Seen {
    unit: f64,
    elevation_deg: f64,
    distance: f64,
    thickness: f64,
}

/// View from which each sweep varies one parameter.
const USUAL: Seen = Seen { unit: 1.0, elevation_deg: 30.0, distance: 3.0, thickness: THICKNESS };

pub(super) fn sweeps() -> Vec<Sweep> {
    let sweep = |name, parameter, about, values, required, probes| Sweep {
        name,
        parameter,
        about,
        law: "the conformance tolerance, 1.2e-3 of a colour, outside of decision margins: what the sheet hides has no \
              weight at all",
        naive: "",
        measure: Measure::Color,
        values,
        required,
        probes,
    };
    let units = "A thin sheet over a floor, camera included, in larger or smaller units: the floor never shows.";
    vec![
        sweep(
            "sheet-unit-large",
            "unit of a thin sheet's coordinates",
            units,
            powers(0.0, 38.0, 1.0),
            // Beyond this unit, squares of coordinates exceed the range of f32 on GPUs, as in other scenes.
            1e15,
            (|unit| probes(Seen { unit, ..USUAL })) as fn(f64) -> Vec<Probe>,
        ),
        sweep(
            "sheet-unit-small",
            "unit of a thin sheet's coordinates",
            units,
            powers(0.0, -38.0, 1.0),
            1e-30,
            |unit| probes(Seen { unit, ..USUAL }),
        ),
        sweep(
            "sheet-elevation",
            "degrees above a thin sheet's plane",
            "A thin sheet over a floor, seen at a more and more grazing angle: the depth tolerance of the top's disks \
             grows without bound and reaches through the sheet, and the floor still doesn't show.",
            powers(1.75, -2.25, 0.25),
            0.01,
            |elevation_deg| probes(Seen { elevation_deg, ..USUAL }),
        ),
        sweep(
            "sheet-distance",
            "distance of the eye from a thin sheet",
            "A thin sheet over a floor through a longer and longer lens, until its thickness is within the decision \
             margin of depths: 1e-4 of them.",
            powers(0.5, 2.0, 0.25),
            100.0,
            |distance| probes(Seen { distance, ..USUAL }),
        ),
        sweep(
            "sheet-thickness",
            "thickness of a sheet over the radius of its disks",
            "A thinner and thinner sheet over a floor that is as far below it: from a twenty-fourth of the depth \
             tolerance on, the sides count as one surface (a known limit).",
            powers(0.5, -4.0, 0.25),
            0.05,
            |radii| probes(Seen { thickness: radii * RADIUS, ..USUAL }),
        ),
    ]
}

/// Returns images of a sheet's top, its underside and the floor below it. The camera is above, and the view is within
/// the top. The truth is the image in which underside and floor also have the top's colour.
fn probes(seen: Seen) -> Vec<Probe> {
    let (sin, cos) = seen.elevation_deg.to_radians().sin_cos();
    // The sheet is lengthened to compensate for its foreshortening, and the eye is moved away by the same factor. The
    // image and the size of disks in pixels stay the same.
    let (stretched, distance) = (DVec3::new(1.0, 1.0, 0.5 / sin), seen.distance * 0.5 / sin);
    let image = |filter, others: [[f32; 3]; 2]| {
        let layer = |depth: f64, facing: f64, color: [f32; 3]| {
            let axes = [DVec3::Z, DVec3::X * facing];
            sheet(DVec3::NEG_Y * depth, axes, [40, 40], RADIUS, |_, _| color)
        };
        let [underside, floor] = others;
        let layers = [(0.0, 1.0, TOP), (1.0, -1.0, underside), (2.0, 1.0, floor)];
        let splats = layers.map(|(depth, facing, color)| layer(depth * seen.thickness, facing, color)).concat();
        let scaled = |v: DVec3| (v * stretched * seen.unit).as_vec3().as_dvec3();
        let splats: Vec<Splat> =
            splats.into_iter().map(|s| Splat { p: scaled(s.p), s: scaled(s.s), t: scaled(s.t), ..s }).collect();
        let mut object = object(cloud(&splats));
        object.material.oriented = Some(true);
        object.material.interior_weight = Some(3.0);
        let eye = DVec3::new(0.0, sin, cos) * (distance * seen.unit);
        let fov_y_deg = 2.0 * (HALF_VIEW / distance).atan().to_degrees();
        let camera = Camera {
            eye: eye.to_array(),
            projection: Projection::Perspective { fov_y_deg },
            near: 0.01 * seen.unit * distance,
            ..camera(0.0, 45.0, [24, 24])
        };
        let settings = Settings::default().with_filter(filter);
        let scene = surfel_model::Scene { objects: vec![object], ..scene(&[]) };
        Image { scene, camera, region: None, settings }
    };
    let probe = |filter| Probe {
        image: image(filter, [[0.1, 0.3, 0.9], [0.0, 1.0, 0.0]]),
        truth: Truth::Easier(Box::new(image(filter, [TOP; 2]))),
        amplification: 0.0,
        floor: TOLERANCE,
        scale: 1.0,
        naive: Naive::Nothing,
    };
    [Filter::None, Filter::Principal].map(probe).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stability::{Precision, drawer, run};
    use surfel_reference::Renderer as Reference;

    #[test]
    fn floor_shows_where_the_underside_is_culled() {
        // Without the underside, nothing limits the depth tolerance, and the floor shows. So the sweeps do measure the
        // rule for sheets.
        fn culled(elevation_deg: f64) -> Vec<Probe> {
            let mut probes = probes(Seen { elevation_deg, ..USUAL });
            probes.iter_mut().for_each(|p| p.image.scene.objects[0].material.cull = surfel_model::Cull::Back);
            probes
        }
        let mut sweep = sweeps().remove(2);
        sweep.values = vec![3.0];
        sweep.probes = culled;
        let mut reference = Reference::new(Default::default()).unwrap();
        let other = drawer(Reference::new(Default::default()).unwrap());
        let outcome = run(&sweep, &mut reference, &mut [(Precision::F64, other)]).unwrap().remove(0);
        assert!(outcome.points[0].compared > 500 && outcome.points[0].error > 0.1, "{:?}", outcome.points);
    }
}
