//! Sheets that separate what lies above them from what lies below (§5): nothing below a sheet blends with its top, and
//! surfaces without an underside keep all of their filter.

use crate::drawing::{drawn_once, reference_image};
use surfel_conformance::build::ray;
use surfel_conformance::scenes::{self, Case, ROOF};
use surfel_cpu::Renderer as Cpu;
use surfel_model::{Cull, DepthTolerance};
use surfel_render::{Frame, Planes};

fn drawn_by_cpu(case: &Case) -> Frame {
    drawn_once(&mut Cpu::new(Default::default()).unwrap(), case, Planes::ALL).0
}

/// Returns the pixels whose centres show the roof's top, two pixels and more than a splat's radius inside its outline.
fn top_pixels(case: &Case, elevation_deg: f64) -> Vec<usize> {
    let object_from_world = case.scene.objects[0].world_from_object.inverse();
    let eye = object_from_world.transform_point3(case.camera.eye.into());
    let [width, height] = case.camera.size;
    let px = 2.0 * (22.5f64).to_radians().tan() * 3.0 / f64::from(height);
    let margin = 0.08 + 2.0 * px / elevation_deg.to_radians().sin();
    let sees_top = |at: &u32| {
        let direction = object_from_world.transform_vector3(ray(&case.camera, at % width, at / width));
        let hit = eye + direction * ((0.015 - eye.y) / direction.y);
        hit.x.abs() < 0.9 - margin && hit.z.abs() < 0.7 - margin
    };
    (0..width * height).filter(sees_top).map(|at| at as usize).collect()
}

/// Draws a roof seen from an elevation, with a depth tolerance of `radii` splat radii. Returns the number of pixels of
/// its top, and how many of them have colours of the walls: by the reference, by the CPU, and by the reference if the
/// underside is culled.
fn mixed(elevation_deg: f64, radii: f64) -> (usize, [usize; 3]) {
    let tolerance = DepthTolerance::Relative(radii);
    let case = scenes::roof_over_walls(elevation_deg).with("tolerance", |s| s.depth_tolerance = tolerance);
    let top = top_pixels(&case, elevation_deg);
    let is_top = |c: &[f32; 4]| c.iter().zip(ROOF).all(|(c, roof)| (c - roof).abs() < 1e-4);
    let count = |frame: &Frame| top.iter().filter(|at| !is_top(&frame.color()[**at])).count();
    let mut culled = case.clone();
    culled.scene.objects[0].material.cull = Cull::Back;
    let counts = [count(&reference_image(&case)), count(&drawn_by_cpu(&case)), count(&reference_image(&culled))];
    println!("{elevation_deg}°, {radii} radii: {counts:?} of {} pixels mixed", top.len());
    (top.len(), counts)
}

#[test]
fn little_below_a_roof_blends_with_its_top() {
    // The remaining pixels show disks of the walls' sides, which by themselves reach above the middle of the roof.
    // Where splats are smaller than the filter (20°), filtered footprints reach there, too.
    for elevation_deg in [20.0, 30.0, 45.0, 70.0] {
        for radii in [0.25, 1.0, 2.0] {
            let (pixels, [reference, cpu, culled]) = mixed(elevation_deg, radii);
            let most = reference.max(cpu);
            assert!(pixels > 200 && culled > 0, "{culled} of {pixels}");
            assert!(most * 4 < culled, "{elevation_deg}°, {radii} radii: {reference} {cpu} of {culled}");
        }
    }
}

#[test]
fn ground_without_an_underside_keeps_all_of_its_filter() {
    let [oriented, other] = [true, false].map(scenes::grazing_ground);
    for draw in [reference_image, drawn_by_cpu] {
        let [got, want] = [draw(&oriented), draw(&other)];
        assert!(got.color() == want.color() && got.weight() == want.weight() && got.depth() == want.depth());
        assert!(want.weight().iter().filter(|w| **w > 0.0).count() > 1000);
    }
}

#[test]
fn thin_box_has_the_colours_of_one_without_its_back() {
    let case = scenes::thin_box();
    let mut culled = case.clone();
    culled.scene.objects[0].material.cull = Cull::Back;
    let [got, want] = [reference_image(&case), reference_image(&culled)];
    let (mut same, mut seen) = (0, 0);
    for (got, want) in got.color().iter().zip(want.color()) {
        if want[3] > 0.0 {
            seen += 1;
            same += usize::from(got.iter().zip(want).all(|(a, b)| (a - b).abs() < 0.01));
        }
    }
    println!("{same} of {seen} pixels are those of the culled box");
    assert!(seen > 700 && same * 100 > seen * 97, "{same} of {seen}");
}
