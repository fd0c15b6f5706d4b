//! Tests of octrees of splats and polygons (§6, G06 §5.2): watertight at every size, selected for the view, without
//! pops.

use crate::drawing::{drawn_once, frame_and_stats};
use crate::validated_gpu;
use glam::DVec3;
use std::collections::BTreeSet;
use std::ops::Range;
use surfel_conformance::build::{axes, camera};
use surfel_conformance::harness::{Truth, compare_frames, render};
use surfel_conformance::polygons::{cube, mesh_sphere};
use surfel_conformance::scenes::{self, Case, without_transitions};
use surfel_model::{Camera, Cull, Light, Octree, Shader};
use surfel_reference::Renderer as Reference;
use surfel_render::{Capabilities, Frame, Pass, Planes, Region, Renderer, SceneSummary, Selection, View, plan, select};
use surfel_sample::{NoProgress, OctreeOptions, octree_from_mesh};

/// Returns a ball of 8192 triangles with smooth colours, as an octree.
fn ball() -> Octree {
    let mut mesh = mesh_sphere(5);
    let color = |p: DVec3| [0.5 + 0.4 * (3.0 * p.x).sin(), 0.5 + 0.4 * (4.0 * p.y).cos(), 0.5 + 0.3 * p.z];
    mesh.colors = Some((0..mesh.positions.len()).map(|i| color(mesh.positions.get(i)).map(|c| c as f32)).collect());
    octree_from_mesh(&mesh, &OctreeOptions::default(), &NoProgress).unwrap()
}

fn chosen(octree: &Octree, camera: &Camera, cull: Cull, error_px: f64) -> Selection {
    select(octree, &glam::DAffine3::IDENTITY, cull, &View::new(camera).unwrap(), error_px)
}

fn case(octree: &Octree, selection: &Selection, camera: &Camera) -> Case {
    let scene = scenes::scene_of(octree, selection);
    Case::new("octree", scene, camera.clone()).with("lit", |s| s.shader = Shader::Phong)
}

fn image(octree: &Octree, selection: &Selection, camera: &Camera) -> Frame {
    render(&mut Reference::new(Default::default()).unwrap(), &case(octree, selection, camera), Planes::ALL).unwrap()
}

/// Returns the pixels whose rays pass the ball's centre at a distance below `reach`.
fn inside(camera: &Camera, reach: f64) -> Vec<usize> {
    let [right, down, forward] = axes(camera);
    let surfel_model::Projection::Perspective { fov_y_deg } = camera.projection else { panic!("perspective") };
    let [w, h] = camera.size.map(f64::from);
    let f = h / (2.0 * (0.5 * fov_y_deg.to_radians()).tan());
    let distance = |at: usize| {
        let (x, y) = ((at % w as usize) as f64 + 0.5 - 0.5 * w, (at / w as usize) as f64 + 0.5 - 0.5 * h);
        DVec3::from(camera.eye).cross((forward + right * (x / f) + down * (y / f)).normalize()).length()
    };
    (0..(w * h) as usize).filter(|at| distance(*at) < reach).collect()
}

/// Returns the largest and the root mean square difference of colours over these pixels.
fn difference(a: &Frame, b: &Frame, pixels: &[usize]) -> (f64, f64) {
    let (mut worst, mut sum) = (0.0f64, 0.0);
    for &at in pixels {
        for c in 0..3 {
            let d = f64::from(a.color()[at][c] - b.color()[at][c]).abs();
            (worst, sum) = (worst.max(d), sum + d * d);
        }
    }
    (worst, (sum / (3 * pixels.len()) as f64).sqrt())
}

fn count(ranges: &[Range<u32>]) -> usize {
    ranges.iter().map(ExactSizeIterator::len).sum()
}

#[test]
fn octree_is_whole_at_every_size() {
    let octree = ball();
    let camera = camera(3.2, 45.0, [128, 128]);
    let truth = image(&octree, &chosen(&octree, &camera, Cull::Back, 1e-6), &camera);
    let pixels = inside(&camera, 0.97);
    assert!(pixels.len() > 5000);
    let mut kinds = [0; 3];
    for error_px in [1.0, 2.0, 3.0, 4.0, 5.0, 8.0, 16.0, 1e3] {
        let selection = chosen(&octree, &camera, Cull::Back, error_px);
        let frame = image(&octree, &selection, &camera);
        let bare = pixels.iter().filter(|at| frame.depth()[**at].is_infinite()).count();
        let (worst, rmse) = difference(&frame, &truth, &pixels);
        let (splats, triangles) = (count(&selection.splats), count(&selection.triangles));
        println!(
            "{error_px} px: {splats} splats, {triangles} triangles; worst {worst:.4}, RMSE {rmse:.4}, {bare} bare"
        );
        assert_eq!(bare, 0, "{error_px}");
        let kind = usize::from(splats > 0) + 2 * usize::from(triangles > 0) - 1;
        kinds[kind] += 1;
        // Splats of r px blur variations over a radian of the ball, 47 px, by about (r/47)²/8; splats of the whole ball
        // blur everything.
        if error_px <= 5.0 {
            assert!(rmse < 0.01 && worst < 0.12, "{error_px}: {worst} {rmse}");
        }
    }
    // Splats alone, polygons alone, and both together.
    assert!(kinds.iter().all(|k| *k > 0), "{kinds:?}");
}

#[test]
fn octree_selection_follows_the_view() {
    let octree = ball();
    let far = camera(3.2, 45.0, [128, 128]);
    let all = chosen(&octree, &far, Cull::None, 1e-6);
    assert_eq!(count(&all.triangles), octree.mesh().triangles.len());
    assert!(all.splats.is_empty(), "polygons alone need no transitions");
    let front = chosen(&octree, &far, Cull::Back, 1e-6);
    // Of the far half, the leaves whose cone and sphere reach the silhouette remain.
    let share = count(&front.triangles) as f64 / count(&all.triangles) as f64;
    assert!((0.35..0.8).contains(&share), "{share}");
    // Close up, little of the ball is in view.
    let near = chosen(&octree, &camera(1.2, 20.0, [64, 64]), Cull::None, 1e-6);
    assert!(count(&near.triangles) < count(&all.triangles) / 4, "{}", count(&near.triangles));
    // From far away one node's splats are enough.
    let dot = chosen(&octree, &camera(300.0, 45.0, [64, 64]), Cull::None, 1.0);
    assert_eq!((dot.splats.as_slice(), dot.triangles.len()), (&[octree.nodes()[0].splats.clone()][..], 0));
    // Behind the eye nothing is selected.
    let mut away = far.clone();
    away.target = [0.0, 0.0, 9.0];
    assert_eq!(chosen(&octree, &away, Cull::None, 1.0), Selection::default());
}

#[test]
fn octree_transitions_are_drawn_once_where_splats_meet_polygons() {
    let octree = ball();
    let mixed = (1..40)
        .map(|i| chosen(&octree, &camera(3.2, 45.0, [128, 128]), Cull::None, f64::from(i) * 0.25))
        .filter(|s| !s.triangles.is_empty() && !s.splats.is_empty());
    let first_on_edges = octree.transitions()[0].splats.start;
    let mut seen = 0;
    for selection in mixed {
        for ranges in [&selection.splats, &selection.triangles] {
            assert!(ranges.windows(2).all(|r| r[0].end <= r[1].start), "drawn twice");
        }
        seen += usize::from(selection.splats.iter().any(|r| r.start >= first_on_edges));
    }
    assert!(seen > 0);
    for transition in octree.transitions() {
        let spans = transition.leaves.map(|leaf| octree.nodes()[leaf as usize].clone());
        for i in transition.splats.clone() {
            let p = octree.cloud().center(i as usize);
            for node in &spans {
                // On an edge of both leaves' triangles.
                assert!((p - octree.center_of(node)).length() <= node.radius);
            }
        }
    }
}

/// The conformance scene has all kinds of parts: near polygons, splats of leaves, splats of higher nodes, transitions.
#[test]
fn octree_of_the_conformance_scene_has_every_part() {
    let mut found = [0; 4];
    scenes::octree_by(|octree, view| {
        let selection = select(octree, &glam::DAffine3::IDENTITY, Cull::Back, view, scenes::OCTREE_ERROR_PX);
        let own = |range: &Range<u32>| octree.nodes().iter().find(|node| node.splats == *range);
        for range in &selection.splats {
            let of = own(range).map_or(2, |node| usize::from(!node.is_leaf()));
            found[of] += range.len();
        }
        found[3] = count(&selection.triangles);
        selection
    });
    println!("{found:?}: splats of leaves, of nodes above, of transitions; triangles");
    assert!(found.iter().all(|count| *count >= 20), "{found:?}");
}

/// An octree drawn as splats alone costs as much as those splats: without polygons, their passes, or coverage.
#[test]
fn octree_of_splats_alone_plans_no_polygons() {
    let octree = ball();
    let far = camera(40.0, 45.0, [64, 64]);
    let capabilities =
        Reference::new(surfel_reference::Options::default().with_threads(1)).unwrap().info().capabilities;
    let planned = |error_px: f64| {
        let case = case(&octree, &chosen(&octree, &far, Cull::Back, error_px), &far);
        let plan = plan(&SceneSummary::of(&case.scene), &case.view(), &case.settings, Planes::COLOR, &capabilities);
        (case.scene.objects.len(), plan.unwrap())
    };
    let (objects, splats) = planned(1.0);
    assert!(objects == 1 && !splats.has(Pass::Polygons) && !splats.attributes.coverage, "{splats:?}");
    let (objects, polygons) = planned(1e-6);
    assert!(objects == 2 && polygons.has(Pass::Polygons), "{polygons:?}");
}

/// A resident octree, with nodes selected by the plan, shows the same as a scene of the selected parts: bit-identical
/// on the reference.
#[test]
fn octree_that_is_resident_shows_what_its_chosen_parts_do() {
    let octree = ball();
    let mut reference = Reference::new(Default::default()).unwrap();
    let mut cpu = surfel_cpu::Renderer::new(Default::default()).unwrap();
    let camera = camera(3.2, 45.0, [64, 64]);
    let mut whole = case(&octree, &chosen(&octree, &camera, Cull::Back, 1.5), &camera);
    whole.scene.objects.truncate(1);
    whole.scene.objects[0].geometry = octree.clone().into();
    let mut kinds = [0; 2];
    // Polygons alone, both, and splats alone, from one upload.
    for error_px in [1e-6, 1.5, 1e3] {
        let selection = chosen(&octree, &camera, whole.scene.objects[0].material.cull, error_px);
        kinds[0] += usize::from(!selection.splats.is_empty());
        kinds[1] += usize::from(!selection.triangles.is_empty());
        let parts = case(&octree, &selection, &camera);
        let resident = whole.with("resident", |s| s.lod_error_px = error_px);
        let [want, got] = [&parts, &resident].map(|case| render(&mut reference, case, Planes::ALL).unwrap());
        assert!(want == got, "{error_px}");
        let on_cpu = render(&mut cpu, &resident, Planes::ALL).unwrap();
        let pixels: Vec<usize> = (0..64 * 64).collect();
        assert!(difference(&on_cpu, &want, &pixels).1 < 1e-4, "{error_px}");
    }
    assert_eq!(kinds, [2, 2]);
}

/// The splats of a cube's octree cover the same pixels as its polygons, up to one pixel at the outline, since clips cut
/// them at the cube's edges.
#[test]
fn octree_of_a_cube_ends_at_its_edges() {
    let octree = octree_from_mesh(&cube(), &OctreeOptions::default(), &NoProgress).unwrap();
    assert!(octree.cloud().data().clips.is_some());
    let mut reference = Reference::new(Default::default()).unwrap();
    let mut cpu = surfel_cpu::Renderer::new(Default::default()).unwrap();
    let mut camera = camera(0.0, 40.0, [64, 64]);
    (camera.eye, camera.target) = ([2.6, 2.2, 4.5], [0.0; 3]);
    let mut case = case(&octree, &Selection::default(), &camera);
    case.scene.objects[0].geometry = octree.into();
    let covered = |frame: &Frame| frame.depth().iter().map(|z| z.is_finite()).collect::<Vec<bool>>();
    let polygons =
        covered(&render(&mut reference, &case.with("polygons", |s| s.lod_error_px = 1e-6), Planes::ALL).unwrap());
    let splats = case.with("splats", |s| s.lod_error_px = 6.0);
    let of_backends =
        [render(&mut reference, &splats, Planes::ALL), render(&mut cpu, &splats, Planes::ALL)].map(Result::unwrap);
    for frame in &of_backends {
        let differs: Vec<usize> = (0..64 * 64).filter(|at| covered(frame)[*at] != polygons[*at]).collect();
        // Among some 200 pixels of outline, those whose centres a filtered footprint reaches.
        println!("{} pixels differ", differs.len());
        assert!(differs.len() < 60 && polygons.iter().filter(|c| **c).count() > 1000, "{}", differs.len());
        // None of them is more than a pixel away from the outline.
        let around = |at: usize| [at - 65, at - 64, at - 63, at - 1, at + 1, at + 63, at + 64, at + 65];
        assert!(differs.iter().all(|at| around(*at).iter().any(|near| polygons[*near] != polygons[*at])));
    }
}

/// Returns the octree as one resident object, under lights that cast shadows.
fn resident(octree: &Octree) -> Case {
    let mut case = case(octree, &Selection::default(), &camera(3.2, 45.0, [64, 64]));
    case.scene.objects[0].geometry = octree.clone().into();
    for light in case.scene.lights.iter_mut().flatten() {
        if let Light::Directional { shadow, .. } = light {
            *shadow = true;
        }
    }
    case
}

/// Returns truths of the ball for several distances and values of `--lod-error`.
fn views() -> Vec<Truth> {
    let case = resident(&ball());
    let mut reference = Reference::new(Default::default()).unwrap();
    let views = [(3.2, 2.0), (12.0, 2.0), (1.6, 2.0), (3.2, 1e3), (3.2, 1e-6), (3.2, 2.0)];
    let view = |(distance, error_px)| {
        let mut case = case.with(&format!("{error_px} px at {distance}"), |s| s.lod_error_px = error_px);
        case.camera = camera(distance, 45.0, [64, 64]);
        Truth::of(&mut reference, case)
    };
    views.map(view).into()
}

/// Frames of one upload equal those of separate uploads, and drawing stores nothing.
fn draws_every_view_from_one_upload(renderer: &mut impl Renderer, views: &[Truth]) {
    let scene = renderer.upload(&views[0].case.scene).unwrap();
    let (mut bytes, mut chosen) = (BTreeSet::new(), BTreeSet::new());
    for Truth { case, want } in views {
        let (frame, stats) = frame_and_stats(renderer, &scene, case, Planes::ALL);
        let (fresh, _) = drawn_once(renderer, case, Planes::ALL);
        assert!(frame == fresh, "{}", case.name);
        bytes.insert(stats.bytes_per_splat.to_bits());
        chosen.insert(stats.splats);
        let truth = want.as_ref().unwrap();
        let report = compare_frames(&case.name, &frame, truth, truth.margin());
        assert!(report.is_ok(), "{report}");
    }
    assert!(bytes.len() == 1 && chosen.len() > 3, "{bytes:?} {chosen:?}");
}

#[test]
fn octree_is_uploaded_once_for_every_view() {
    let views = views();
    draws_every_view_from_one_upload(&mut Reference::new(Default::default()).unwrap(), &views);
    draws_every_view_from_one_upload(&mut surfel_cpu::Renderer::new(Default::default()).unwrap(), &views);
    if let Some(mut ash) = validated_gpu::ash() {
        draws_every_view_from_one_upload(&mut ash, &views);
    }
    if let Some(mut wgpu) = validated_gpu::wgpu() {
        draws_every_view_from_one_upload(&mut wgpu, &views);
        validated_gpu::no_messages();
    }
}

/// Nodes outside a region are selected too, since they cast shadows into it.
#[test]
fn octree_in_a_region_is_that_part_of_the_whole() {
    let case = resident(&ball()).with("2 px", |s| s.lod_error_px = 2.0);
    let mut reference = Reference::new(Default::default()).unwrap();
    let whole = render(&mut reference, &case, Planes::COLOR).unwrap();
    let region = Region { x: 20, y: 9, width: 16, height: 12 };
    let part = render(&mut reference, &Case { region: Some(region), ..case }, Planes::COLOR).unwrap();
    for (i, pixel) in (0u32..).zip(part.color()) {
        let (x, y) = (region.x + i % region.width, region.y + i / region.width);
        assert_eq!(*pixel, whole.color()[(y * whole.width() + x) as usize], "{x},{y}");
    }
}

#[test]
fn scenes_without_octrees_have_nothing_chosen() {
    let capabilities = Capabilities::everything("test");
    for case in scenes::all() {
        let summary = SceneSummary::of(&case.scene);
        let plan = plan(&summary, &case.view(), &case.settings, Planes::COLOR, &capabilities).unwrap();
        assert!(plan.octrees.is_empty() && plan.selection_of(0).is_none(), "{}", case.name);
        assert_eq!(plan.splats, summary.splats + summary.balls, "{}", case.name);
    }
    let case = resident(&ball());
    let plan =
        plan(&SceneSummary::of(&case.scene), &case.view(), &case.settings, Planes::COLOR, &capabilities).unwrap();
    assert!(plan.selection_of(0).is_some());
}

/// Number of frames of a flight towards the ball.
const FRAMES: i32 = 48;

/// `--lod-error` of the flight, in pixels.
const FLIGHT_PX: f64 = 1.5;

/// Maximum change of a pixel by a change of level, and maximum excess of a step over that of polygons. A splat shows
/// the mean of the surface that it covers, which differs from the middle by ½σ²·∇²c. σ² is 0.17·r² by the kernel, with
/// r = 0.14 units (1.5 px from the 11 units at the start). ∇²c is about 8 (0.4·4² of the green waves, times the light,
/// and the light's own): 0.014. As much again for splats that aren't spread evenly. Measured: 0.022, and a step 0.013
/// above the polygons' 0.084.
const POP: f64 = 0.03;

/// Maximum change of a frame by a change of level, root mean square. Measured: 0.0044.
const POP_RMSE: f64 = 0.005;

/// Returns the camera at a frame of the flight. Its distance falls from 12 to 1.5, by the same factor in each frame.
fn flown(frame: i32) -> Camera {
    camera(12.0 * 0.125f64.powf(f64::from(frame) / f64::from(FRAMES)), 45.0, [96, 96])
}

/// Measures of a flight: largest differences of colour in pixels within the ball's contour.
#[derive(Debug, Default)]
struct Flight {
    /// Number of frames whose selection differs from the previous frame's.
    changes: usize,
    /// Largest change by the selection alone: the same eye with the previous frame's parts.
    pop: f64,
    /// Largest root mean square of a frame's change by the selection alone.
    pop_rmse: f64,
    /// Largest change from a frame to the next.
    step: f64,
    /// Largest change from a frame to the next with polygons alone.
    step_of_polygons: f64,
    /// Largest excess of a step over that of polygons.
    excess: f64,
}

fn fly(octree: &Octree, choose: impl Fn(i32) -> Selection) -> Flight {
    // The reference's image within 2e-4, in a hundredth of the time.
    let mut cpu = surfel_cpu::Renderer::new(Default::default()).unwrap();
    let mut draw = |selection: &Selection, frame: i32| {
        render(&mut cpu, &case(octree, selection, &flown(frame)), Planes::ALL).unwrap()
    };
    let polygons = |frame: i32| chosen(octree, &flown(frame), Cull::Back, 1e-6);
    let mut flight = Flight::default();
    let mut before = choose(0);
    let mut shown = [draw(&before, 0), draw(&polygons(0), 0)];
    for frame in 1..=FRAMES {
        let after = choose(frame);
        let next = [draw(&after, frame), draw(&polygons(frame), frame)];
        let pixels = inside(&flown(frame), 0.95);
        if before != after {
            // Parts in view from farther away are still in view.
            let (pop, rmse) = difference(&next[0], &draw(&before, frame), &pixels);
            (flight.pop, flight.pop_rmse) = (flight.pop.max(pop), flight.pop_rmse.max(rmse));
            flight.changes += 1;
        }
        // Within the smaller contour, that of the previous frame.
        let pixels = inside(&flown(frame - 1), 0.95);
        let [step, own] = [0, 1].map(|i| difference(&shown[i], &next[i], &pixels).0);
        flight.step = flight.step.max(step);
        flight.step_of_polygons = flight.step_of_polygons.max(own);
        flight.excess = flight.excess.max(step - own);
        (before, shown) = (after, next);
    }
    flight
}

#[test]
fn octree_zoom_does_not_pop() {
    let octree = ball();
    let at = |frame: i32, error_px: f64| chosen(&octree, &flown(frame), Cull::Back, error_px);
    let right = fly(&octree, |frame| at(frame, FLIGHT_PX));
    println!("{right:?}");
    assert!(right.changes > 10 && right.pop_rmse < POP_RMSE, "{right:?}");
    assert!(right.pop < POP && right.excess < POP, "{right:?}");
    // Without transitions, or with a sudden change of the threshold, the flight pops.
    let bare = fly(&octree, |frame| without_transitions(&octree, at(frame, FLIGHT_PX)));
    println!("without transitions {bare:?}");
    assert!(bare.pop > POP && bare.excess > POP && bare.pop_rmse > POP_RMSE, "{bare:?}");
    let jumping = fly(&octree, |frame| at(frame, if frame < FRAMES / 2 { FLIGHT_PX } else { 8.0 }));
    println!("the threshold jumps {jumping:?}");
    assert!(jumping.pop > POP && jumping.excess > POP && jumping.pop_rmse > POP_RMSE, "{jumping:?}");
}

/// Leaves of different depth side by side, some of them slivers: no gaps beside their edges.
#[test]
fn octree_is_whole_where_coarse_leaves_meet_fine_ones() {
    let mut mesh = mesh_sphere(6);
    // Triangles that shrink towards one side of a tilted, flattened ball.
    let squeezed = |p: DVec3| {
        let q = DVec3::new(p.x + 0.3 * p.y, p.y, 0.4 * p.z + 0.2 * p.x);
        q * (0.15 + 0.5 * (q.x + 1.2).powi(2))
    };
    let vertices: Vec<DVec3> = (0..mesh.positions.len()).map(|i| squeezed(mesh.positions.get(i))).collect();
    mesh = surfel_conformance::polygons::mesh(&vertices, mesh.triangles);
    let octree = octree_from_mesh(&mesh, &OctreeOptions::default(), &NoProgress).unwrap();
    let depths = |n: &surfel_model::OctreeNode| (n.splat_radius / octree.nodes()[0].splat_radius).log2().round() as i32;
    let leaves: BTreeSet<i32> = octree.nodes().iter().filter(|n| n.is_leaf()).map(depths).collect();
    assert!(leaves.len() >= 3, "{leaves:?}");
    // Each leaf must cover its triangles by its own splats and those on its edges, whatever is drawn beside it.
    let (mut bare, mut looked) = (0, 0);
    for (i, leaf) in (0u32..).zip(octree.nodes()).filter(|(_, n)| n.is_leaf()) {
        let edges = octree.transitions().iter().filter(|t| t.leaves.contains(&i)).flat_map(|t| t.splats.clone());
        let splats: Vec<(DVec3, f64)> = leaf
            .splats
            .clone()
            .chain(edges)
            .map(|k| (octree.cloud().center(k as usize), octree.cloud().radius_max(k as usize)))
            .collect();
        for t in leaf.triangles.clone() {
            let corners = octree.mesh().triangles[t as usize].map(|k| octree.mesh().positions.get(k as usize));
            for b in [[1.0, 1.0, 1.0], [4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0]] {
                let p = (corners[0] * b[0] + corners[1] * b[1] + corners[2] * b[2]) / b.iter().sum::<f64>();
                looked += 1;
                bare += usize::from(!splats.iter().any(|(center, radius)| (p - *center).length() < *radius));
            }
        }
    }
    assert!(bare == 0 && looked > 10_000, "{bare} of {looked}");
}
