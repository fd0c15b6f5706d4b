//! Tests of the planes of the nearest splat (§5): index, object, label and position, on every backend.
//!
//! Outside the reference's margin a backend shows the reference's values. If depths of several splats are within the
//! margin of the nearest, it shows one of these.

use glam::{DAffine3, DVec3};
use std::collections::BTreeSet;
use std::sync::Arc;
use surfel_conformance::build::{Splat, camera, cloud, object, with_alpha};
use surfel_conformance::polygons::{mesh_object, quad};
use surfel_conformance::scenes::{self, Case};
use surfel_model::{Cull, EdgeAa, Filter, Geometry, NO_LABEL, Projection, Scene, SplatCloud};
use surfel_reference::Renderer as Reference;
use surfel_render::{
    Capabilities, Frame, Identity, Pass, Planes, Region, RenderError, Renderer, SceneSummary, View, plan,
};

/// Relative distance of depths within which the nearest is undecided: the model's own margin.
const MARGIN: f64 = 1e-4;

/// Returns the row of a test's splat `i`. Rows differ from indices, and aren't in ascending order.
fn row(i: usize) -> u32 {
    (i as u32 ^ 1) * 3 + 5
}

fn label(i: usize) -> u32 {
    if i.is_multiple_of(7) { NO_LABEL } else { (i % 5) as u32 }
}

fn numbered(cloud: &SplatCloud) -> SplatCloud {
    let column = |of: fn(usize) -> u32| (0..cloud.len()).map(of).collect::<Vec<_>>();
    cloud.clone().with_rows(&column(row)).unwrap().with_labels(&column(label)).unwrap()
}

/// Returns the scenes without octrees and Gaussians, with rows and labels on their splats, and some that combine
/// features.
fn cases() -> Vec<Case> {
    let mut cases = scenes::all();
    cases.push(scenes::thin_shell().with("edges", |s| s.edge_aa = EdgeAa::Samples));
    cases.push(scenes::glass_spheres().with("dropped", |s| s.transparency = "peel:1:drop".parse().unwrap()));
    cases.retain(|case| {
        !case.scene.objects.iter().any(|o| matches!(o.geometry, Geometry::Octree(_) | Geometry::Gaussians(_)))
    });
    for case in &mut cases {
        for object in &mut case.scene.objects {
            if let Geometry::Splats(cloud) = &mut object.geometry {
                *cloud = Arc::new(numbered(cloud));
            }
        }
    }
    cases
}

fn drawn(renderer: &mut impl Renderer, case: &Case, planes: Planes) -> Result<Frame, RenderError> {
    let resident = renderer.upload(&case.scene)?;
    let mut frame = Frame::default();
    renderer.render_into(&resident, &case.view(), &case.settings, planes, &mut frame)?;
    Ok(frame)
}

fn nearest() -> Planes {
    Planes::ALL.with_index(true).with_label(true).with_position(true)
}

fn identities(frame: &Frame) -> Vec<Identity> {
    let of = |i: usize| Identity { row: frame.index()[i], object: frame.object()[i], label: frame.label()[i] };
    (0..frame.index().len()).map(of).collect()
}

/// Returns the properties that determine a case's passes: transparency, antialiasing, and polygons.
fn kind(case: &Case) -> String {
    let transparency = case.settings.transparency.to_string();
    let transparency = transparency.split(':').next().unwrap_or_default();
    let has_polygons = case.scene.objects.iter().any(|o| matches!(o.geometry, Geometry::Mesh(_)));
    format!("{transparency} {:?} {has_polygons}", case.settings.edge_aa)
}

/// Compares a backend with the reference in the first case of each kind, and in every `step`th that it draws.
fn agrees(renderer: &mut impl Renderer, step: usize) {
    let mut reference = Reference::new(Default::default()).unwrap();
    let capabilities = renderer.info().capabilities;
    let (mut pixels, mut open, mut others, mut failed) = (0, 0, 0, Vec::new());
    let all = cases();
    let drawable = all.iter().filter(|case| case.is_drawn_by(&capabilities));
    let mut count = 0;
    let mut kinds = BTreeSet::new();
    for (i, case) in drawable.enumerate() {
        let is_new = kinds.insert(kind(case));
        if !is_new && !i.is_multiple_of(step) {
            continue;
        }
        count += 1;
        let resident = reference.upload(&case.scene).unwrap();
        let mut want = Frame::default();
        reference.render_into(&resident, &case.view(), &case.settings, nearest().with_margin(true), &mut want).unwrap();
        let candidates = reference.nearest_candidates(&resident, &case.view(), &case.settings, MARGIN).unwrap();
        let got = drawn(renderer, case, nearest()).unwrap();
        let plain = drawn(renderer, case, Planes::ALL).unwrap();
        let bits = |frame: &Frame| -> Vec<u32> {
            let floats = frame.color().as_flattened().iter().chain(frame.normal().as_flattened());
            floats.chain(frame.depth()).chain(frame.weight()).map(|v| v.to_bits()).collect()
        };
        assert!(bits(&got) == bits(&plain), "{}: other planes change", case.name);
        assert!(plain.index().is_empty() && plain.object().is_empty() && plain.position().is_empty());
        let (got_all, want_all) = (identities(&got), identities(&want));
        for (i, (found, candidates)) in got_all.iter().zip(&candidates).enumerate() {
            pixels += 1;
            others += usize::from(candidates.len() > 1 && *found != want_all[i]);
            assert_eq!(candidates.first().unwrap_or(&Identity::NOTHING), &want_all[i], "{}", case.name);
            let is_there = candidates.contains(found) || (candidates.is_empty() && *found == Identity::NOTHING);
            if want.margin()[i] != 0.0 {
                open += 1;
            } else if !is_there {
                failed.push(format!("{} at pixel {i}: {found:?}, expected one of {candidates:?}", case.name));
            } else if (found.object == NO_LABEL) != (got.depth()[i] == f32::INFINITY) {
                failed.push(format!("{} at pixel {i}: {found:?}, but Z is {}", case.name, got.depth()[i]));
            }
        }
    }
    assert!(failed.is_empty(), "{} of {pixels} pixels: {}", failed.len(), failed[..failed.len().min(20)].join("\n"));
    println!("{count} scenes, {pixels} pixels: {open} within the margin, {others} show another of equally near splats");
    assert!(count * step >= 40 && pixels > 0);
}

#[test]
fn cpu_shows_the_nearest_splat() {
    agrees(&mut surfel_cpu::Renderer::new(Default::default()).unwrap(), 1);
}

/// GPUs draw the first case of each kind and every 40th case, because a software driver takes minutes for all cases.
#[test]
#[ignore = "32 s on lavapipe with two cores: cargo xtask test --full"]
fn wgpu_shows_the_nearest_splat() {
    if let Some(mut renderer) = crate::validated_gpu::wgpu() {
        agrees(&mut renderer, 40);
        crate::validated_gpu::no_messages();
    }
}

#[test]
fn ash_shows_the_nearest_splat() {
    if let Some(mut renderer) = crate::validated_gpu::ash() {
        agrees(&mut renderer, 40);
    }
}

#[test]
fn rows_are_the_same_for_any_threads_regions_and_reuse() {
    let mut renderers = [1, 3, 16]
        .map(|threads| surfel_cpu::Renderer::new(surfel_cpu::Options::default().with_threads(threads)).unwrap());
    for case in cases().iter().step_by(3) {
        let frames = renderers.each_mut().map(|r| identities(&drawn(r, case, nearest()).unwrap()));
        assert!(frames.windows(2).all(|pair| pair[0] == pair[1]), "{}", case.name);
        let [width, height] = case.camera.size;
        let region = Region { x: width / 3, y: height / 4, width: width.div_ceil(2), height: height.div_ceil(2) };
        if case.region.is_some() {
            continue;
        }
        // The same frame, reused for a part of the image and back.
        let renderer = &mut renderers[0];
        let resident = renderer.upload(&case.scene).unwrap();
        let mut frame = Frame::default();
        let view = View::of_region(&case.camera, Some(region)).unwrap();
        for (view, planes) in [(&case.view(), Planes::COLOR), (&view, nearest()), (&view, nearest())] {
            renderer.render_into(&resident, view, &case.settings, planes, &mut frame).unwrap();
        }
        let whole = drawn(renderer, case, nearest()).unwrap();
        for (i, found) in identities(&frame).iter().enumerate() {
            let at = (region.y as usize + i / region.width as usize) * width as usize
                + region.x as usize
                + i % region.width as usize;
            assert_eq!(*found, identities(&whole)[at], "{} pixel {i}", case.name);
            let (a, b) = (DVec3::from(frame.position()[i]), DVec3::from(whole.position()[at]));
            assert!(a == b || a.distance(b) <= 1e-5 * b.length(), "{a} {b}");
        }
    }
}

/// Returns a facing disk of radius 0.5 at a depth.
fn disk(z: f64) -> Splat {
    Splat::disk(DVec3::Z * z, DVec3::Z, 0.5, [0.5; 3])
}

fn seen(scene: Scene, change: impl FnOnce(&mut Case), check: &dyn Fn(&Frame, &str)) {
    let mut case = Case::new("seen", scene, camera(4.0, 30.0, [33, 33]));
    change(&mut case);
    check(&drawn(&mut Reference::new(Default::default()).unwrap(), &case, nearest()).unwrap(), "reference");
    check(&drawn(&mut surfel_cpu::Renderer::new(Default::default()).unwrap(), &case, nearest()).unwrap(), "cpu");
}

/// Returns the identities that the middle pixel and the first pixel of an image of 33×33 pixels show.
fn ends(frame: &Frame) -> [Identity; 2] {
    let all = identities(frame);
    [all[16 * 33 + 16], all[0]]
}

fn scene(mut objects: Vec<surfel_model::Object>) -> Scene {
    // Among polygons and in an A-buffer splats count by their coverage.
    objects.iter_mut().for_each(|object| object.material.interior_weight = Some(1.0));
    Scene { objects, ..Scene::from(cloud(&[disk(0.0)])) }
}

#[test]
fn equally_near_splats_show_the_lower_row_of_the_lower_object() {
    let rows = |rows: &[u32]| cloud(&vec![disk(0.0); rows.len()]).with_rows(rows).unwrap();
    // In Morton order these stay in place: the lower row is neither the first nor the last.
    let first = rows(&[9, 4, 7, 4_294_967_294]);
    let check = |frame: &Frame, backend: &str| {
        let [middle, corner] = ends(frame);
        assert_eq!((middle.row, middle.object, middle.label), (4, 0, NO_LABEL), "{backend}");
        assert_eq!(corner, Identity::NOTHING, "{backend}");
    };
    seen(scene(vec![object(first.clone()), object(rows(&[0, 1]))]), |_| (), &check);
    // Splats at the near plane, set up one by one.
    seen(scene(vec![object(first.clone())]), |case| case.camera.near = 3.999, &check);
    // Transparent splats.
    let glass = with_alpha(first, |_| 0.5);
    for mode in ["peel:1", "peel:3", "peel:2:drop", "abuffer:4"] {
        seen(scene(vec![object(glass.clone())]), |c| c.settings.transparency = mode.parse().unwrap(), &check);
    }
}

#[test]
fn nearer_wins_whatever_it_weighs_and_transparent_layers_come_before_what_is_opaque() {
    let pair = cloud(&[disk(0.0), disk(0.01)]).with_rows(&[3, 8]).unwrap().with_labels(&[30, 80]).unwrap();
    let middle = |row, object, label| {
        move |frame: &Frame, backend: &str| assert_eq!(ends(frame)[0], Identity { row, object, label }, "{backend}")
    };
    seen(scene(vec![object(pair.clone())]), |_| (), &middle(8, 0, 80));
    // Culled splats don't count.
    let mut culled = object(pair.clone());
    culled.material.cull = Cull::Back;
    culled.world_from_object = DAffine3::from_rotation_x(std::f64::consts::PI);
    let behind = object(cloud(&[disk(-1.0)]).with_rows(&[1]).unwrap());
    seen(scene(vec![culled, behind.clone()]), |_| (), &middle(1, 1, NO_LABEL));
    let glass = object(with_alpha(cloud(&[disk(0.5), disk(0.4)]), |_| 0.25).with_rows(&[6, 2]).unwrap());
    for (mode, expected) in
        [("off", (6, 1)), ("peel:2", (6, 1)), ("peel:1", (6, 1)), ("abuffer:2", (6, 1)), ("peel:1:drop", (1, 0))]
    {
        let change = |c: &mut Case| c.settings.transparency = mode.parse().unwrap();
        let objects = vec![behind.clone(), glass.clone()];
        seen(scene(objects), change, &middle(expected.0, expected.1, NO_LABEL));
    }
    // A polygon has an object and no row; a splat at the same depth comes first.
    let pane = |z: f64| mesh_object(quad(DVec3::Z * z, [DVec3::X * 0.5, DVec3::Y * 0.5], 1.0));
    let splats = || object(pair.clone());
    seen(scene(vec![splats(), pane(0.015)]), |_| (), &middle(NO_LABEL, 1, NO_LABEL));
    seen(scene(vec![pane(0.005), splats()]), |_| (), &middle(8, 1, 80));
    seen(scene(vec![pane(0.5), splats()]), |_| (), &middle(NO_LABEL, 0, NO_LABEL));
    seen(scene(vec![pane(0.25)]), |_| (), &middle(NO_LABEL, 0, NO_LABEL));
}

#[test]
fn positions_are_in_the_world_however_far_away_that_is() {
    // A facing wall at z = 1 of worlds moved and turned; an f32 depth of 3 has an error of 2e-7.
    for offset in [DVec3::ZERO, DVec3::new(4.5e6, -7.1e6, 312.0)] {
        for projection in [Projection::Perspective { fov_y_deg: 30.0 }, Projection::Orthographic { height: 2.0 }] {
            let wall: Vec<Splat> = (0..81)
                .map(|i| DVec3::new(f64::from(i % 9) - 4.0, f64::from(i / 9) - 4.0, 4.0) * 0.25 + offset)
                .map(|p| Splat::disk(p, DVec3::Z, 0.4, [0.5; 3]))
                .collect();
            let mut wall = cloud(&wall);
            wall.number_rows();
            let change = |case: &mut Case| {
                case.camera.projection = projection;
                case.camera.far = Some(100.0);
                case.camera.eye = (offset + DVec3::Z * 4.0).to_array();
                case.camera.target = offset.to_array();
            };
            let check = |frame: &Frame, backend: &str| {
                let half = match projection {
                    Projection::Perspective { .. } => 3.0 * 15f64.to_radians().tan(),
                    _ => 1.0,
                };
                for (i, p) in frame.position().iter().enumerate() {
                    let pixel = [i % 33, i / 33].map(|k| (k as f64 - 16.0) / 16.5 * half);
                    let want = offset + DVec3::new(pixel[0], -pixel[1], 1.0);
                    let error = (DVec3::from(*p) - want).abs().max_element();
                    assert!(error < 1e-6 + offset.length() * 2e-16, "{backend}: {p:?} {want} {error}");
                }
            };
            seen(scene(vec![object(wall)]), change, &check);
        }
    }
    let nothing = |frame: &Frame, _: &str| assert_eq!(frame.position()[0], [f64::INFINITY; 3]);
    let mut one = cloud(&[disk(0.0)]);
    one.number_rows();
    seen(scene(vec![object(one)]), |_| (), &nothing);
}

#[test]
fn plan_without_these_planes_has_no_pass_for_them_and_clouds_without_rows_are_refused() {
    let case = scenes::closed_sphere();
    let summary = SceneSummary::of(&case.scene);
    let capabilities = Capabilities::everything("test");
    let planned = |planes| plan(&summary, &case.view(), &case.settings, planes, &capabilities);
    for planes in [Planes::COLOR, Planes::ALL, Planes::ALL.with_position(true), Planes::ALL.with_fragments(true)] {
        assert!(!planned(planes).unwrap().has(Pass::Nearest));
    }
    let refused = planned(Planes::COLOR.with_label(true));
    assert!(matches!(refused, Err(RenderError::NoRows { object: 0 })));
    let mut numbered = case.scene.clone();
    numbered.number_rows();
    let summary = SceneSummary::of(&numbered);
    let with = plan(&summary, &case.view(), &case.settings, Planes::COLOR.with_label(true), &capabilities).unwrap();
    assert!(with.has(Pass::Nearest) && with.planes.index && !with.planes.depth);
    assert!(!with.of_samples().has(Pass::Nearest) && !with.of_samples().planes.index);
    let octree = scenes::octree();
    let error = drawn(&mut Reference::new(Default::default()).unwrap(), &octree, nearest()).unwrap_err();
    assert!(matches!(error, RenderError::NoRows { .. }), "{error}");
    assert!(
        drawn(&mut Reference::new(Default::default()).unwrap(), &octree, Planes::COLOR.with_position(true)).is_ok()
    );
}

#[test]
fn every_splat_is_nearest_somewhere_under_every_filter() {
    // Splats side by side: each shows, and no other row.
    for filter in Filter::ALL {
        let splats: Vec<Splat> = (0..16)
            .map(|i| DVec3::new(f64::from(i % 4) - 1.5, f64::from(i / 4) - 1.5, 0.0) * 0.5)
            .map(|p| Splat::disk(p, DVec3::Z, 0.2, [0.5; 3]))
            .collect();
        let cloud = numbered(&cloud(&splats));
        let check = |frame: &Frame, backend: &str| {
            let rows: BTreeSet<u32> = frame.index().iter().copied().filter(|row| *row != NO_LABEL).collect();
            assert_eq!(rows, (0..16).map(row).collect(), "{backend} {filter:?}");
        };
        seen(scene(vec![object(cloud)]), |case| case.settings.filter = filter, &check);
    }
}
