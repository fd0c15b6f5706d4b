//! Octrees of splats and polygons (§6, G06 §5.2): whole at every size, cut down to the view, and without pops.

use glam::DVec3;
use std::ops::Range;
use surfel_conformance::build::{axes, camera};
use surfel_conformance::harness::render;
use surfel_conformance::polygons::mesh_sphere;
use surfel_conformance::scenes::{self, Case, without_transitions};
use surfel_model::{Camera, Cull, Hybrid, Shader};
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Pass, Planes, Renderer, SceneSummary, Selection, View, plan, select};
use surfel_sample::{HybridOptions, NoProgress, hybrid_from_mesh};

/// A ball of 8192 triangles with smooth colours.
fn ball() -> Hybrid {
    let mut mesh = mesh_sphere(5);
    let color = |p: DVec3| [0.5 + 0.4 * (3.0 * p.x).sin(), 0.5 + 0.4 * (4.0 * p.y).cos(), 0.5 + 0.3 * p.z];
    mesh.colors = Some((0..mesh.positions.len()).map(|i| color(mesh.positions.get(i)).map(|c| c as f32)).collect());
    hybrid_from_mesh(&mesh, &HybridOptions::default(), &NoProgress).unwrap()
}

fn chosen(hybrid: &Hybrid, camera: &Camera, cull: Cull, error_px: f64) -> Selection {
    select(hybrid, &glam::DAffine3::IDENTITY, cull, &View::new(camera).unwrap(), error_px)
}

fn case(hybrid: &Hybrid, selection: &Selection, camera: &Camera) -> Case {
    let scene = scenes::scene_of(hybrid, selection);
    Case::new("octree", scene, camera.clone()).with("lit", |s| s.shader = Shader::Phong)
}

fn picture(hybrid: &Hybrid, selection: &Selection, camera: &Camera) -> Frame {
    render(&mut Reference::new(0).unwrap(), &case(hybrid, selection, camera), Planes::ALL).unwrap()
}

/// Pixels whose rays pass the ball's centre by less than `reach`.
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

/// Largest and root mean square difference of colours over some pixels.
fn difference(a: &Frame, b: &Frame, pixels: &[usize]) -> (f64, f64) {
    let (mut worst, mut sum) = (0.0f64, 0.0);
    for &at in pixels {
        for c in 0..3 {
            let d = f64::from(a.color[at][c] - b.color[at][c]).abs();
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
    let hybrid = ball();
    let camera = camera(3.2, 45.0, [128, 128]);
    let truth = picture(&hybrid, &chosen(&hybrid, &camera, Cull::Back, 1e-6), &camera);
    let pixels = inside(&camera, 0.97);
    assert!(pixels.len() > 5000);
    let mut kinds = [0; 3];
    for error_px in [1.0, 2.0, 3.0, 4.0, 5.0, 8.0, 16.0, 1e3] {
        let selection = chosen(&hybrid, &camera, Cull::Back, error_px);
        let frame = picture(&hybrid, &selection, &camera);
        let bare = pixels.iter().filter(|at| frame.depth[**at].is_infinite()).count();
        let (worst, rmse) = difference(&frame, &truth, &pixels);
        let (splats, triangles) = (count(&selection.splats), count(&selection.triangles));
        println!(
            "{error_px} px: {splats} splats, {triangles} triangles; worst {worst:.4}, RMSE {rmse:.4}, {bare} bare"
        );
        assert_eq!(bare, 0, "{error_px}");
        let kind = usize::from(splats > 0) + 2 * usize::from(triangles > 0) - 1;
        kinds[kind] += 1;
        // Splats of r px blur what varies over a radian of the ball, 47 px, by (r/47)²/8 or so; of the whole ball, by all.
        if error_px <= 5.0 {
            assert!(rmse < 0.01 && worst < 0.12, "{error_px}: {worst} {rmse}");
        }
    }
    // Splats alone, polygons alone, and both together.
    assert!(kinds.iter().all(|k| *k > 0), "{kinds:?}");
}

#[test]
fn octree_selection_follows_the_view() {
    let hybrid = ball();
    let far = camera(3.2, 45.0, [128, 128]);
    let all = chosen(&hybrid, &far, Cull::None, 1e-6);
    assert_eq!(count(&all.triangles), hybrid.mesh().triangles.len());
    assert!(all.splats.is_empty(), "polygons alone need no transitions");
    let front = chosen(&hybrid, &far, Cull::Back, 1e-6);
    // Of the far half, those leaves are left whose cone and sphere reach the silhouette.
    let share = count(&front.triangles) as f64 / count(&all.triangles) as f64;
    assert!((0.35..0.8).contains(&share), "{share}");
    // Close up, little of it is in view.
    let near = chosen(&hybrid, &camera(1.2, 20.0, [64, 64]), Cull::None, 1e-6);
    assert!(count(&near.triangles) < count(&all.triangles) / 4, "{}", count(&near.triangles));
    // From far away one node is enough, and its splats alone.
    let dot = chosen(&hybrid, &camera(300.0, 45.0, [64, 64]), Cull::None, 1.0);
    assert_eq!((dot.splats.as_slice(), dot.triangles.len()), (&[hybrid.nodes()[0].splats.clone()][..], 0));
    // Behind the eye there is nothing.
    let mut away = far.clone();
    away.target = [0.0, 0.0, 9.0];
    assert_eq!(chosen(&hybrid, &away, Cull::None, 1.0), Selection::default());
}

#[test]
fn octree_transitions_are_drawn_once_where_splats_meet_polygons() {
    let hybrid = ball();
    let mixed = (1..40)
        .map(|i| chosen(&hybrid, &camera(3.2, 45.0, [128, 128]), Cull::None, f64::from(i) * 0.25))
        .filter(|s| !s.triangles.is_empty() && !s.splats.is_empty());
    let first_on_edges = hybrid.transitions()[0].splats.start;
    let mut seen = 0;
    for selection in mixed {
        for ranges in [&selection.splats, &selection.triangles] {
            assert!(ranges.windows(2).all(|r| r[0].end <= r[1].start), "drawn twice");
        }
        seen += usize::from(selection.splats.iter().any(|r| r.start >= first_on_edges));
    }
    assert!(seen > 0);
    for transition in hybrid.transitions() {
        let spans = transition.leaves.map(|leaf| hybrid.nodes()[leaf as usize].clone());
        for i in transition.splats.clone() {
            let p = hybrid.cloud().center(i as usize);
            for node in &spans {
                // On an edge of both leaves' triangles.
                assert!((p - hybrid.center_of(node)).length() <= node.radius);
            }
        }
    }
}

/// The conformance scene shows all there is, on its own: near polygons, splats of leaves, splats of nodes above, transitions.
#[test]
fn octree_of_the_conformance_scene_has_every_part() {
    let mut found = [0; 4];
    scenes::octree_by(|hybrid, view| {
        let selection = select(hybrid, &glam::DAffine3::IDENTITY, Cull::Back, view, scenes::OCTREE_ERROR_PX);
        let own = |range: &Range<u32>| hybrid.nodes().iter().find(|node| node.splats == *range);
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

/// An octree seen as splats alone costs what those do: no polygon, no pass for any, no coverage.
#[test]
fn octree_of_splats_alone_plans_no_polygons() {
    let hybrid = ball();
    let far = camera(40.0, 45.0, [64, 64]);
    let capabilities = Reference::new(1).unwrap().info().capabilities;
    let planned = |error_px: f64| {
        let case = case(&hybrid, &chosen(&hybrid, &far, Cull::Back, error_px), &far);
        let plan = plan(&SceneSummary::of(&case.scene), &case.view(), &case.settings, Planes::COLOR, &capabilities);
        (case.scene.objects.len(), plan.unwrap())
    };
    let (objects, splats) = planned(1.0);
    assert!(objects == 1 && !splats.has(Pass::Polygons) && !splats.attributes.coverage, "{splats:?}");
    let (objects, polygons) = planned(1e-6);
    assert!(objects == 2 && polygons.has(Pass::Polygons), "{polygons:?}");
}

/// Frames of a flight toward the ball.
const FRAMES: i32 = 48;

/// `--lod-error` of the flight, pixels.
const FLIGHT_PX: f64 = 1.5;

/// Most that a change of level may change a pixel, and a step be larger than polygons' own. A splat shows the mean of what it covers,
/// which differs from the middle by ½σ²·∇²c: σ² = 0.17·r² by the kernel, r = 0.14 units (1.5 px from the 11 units at the start), and ∇²c
/// about 8 (0.4·4² of the green waves, times the light, and the light's own): 0.014. As much again for splats that aren't spread
/// evenly. Measured: 0.022, a step 0.013 beyond polygons' 0.084.
const POP: f64 = 0.03;

/// Most that it may change a frame, root mean square. Measured: 0.0044.
const POP_RMSE: f64 = 0.005;

/// The eye at a frame of the flight: each step as large a share of the distance as the last, from 12 to 1.5.
fn flown(frame: i32) -> Camera {
    camera(12.0 * 0.125f64.powf(f64::from(frame) / f64::from(FRAMES)), 45.0, [96, 96])
}

/// What a flight shows: largest differences of colour in pixels within the ball's contour.
#[derive(Debug, Default)]
struct Flight {
    /// Frames that choose other parts of the octree than the one before.
    changes: usize,
    /// What the choice alone changes: the same eye with the parts of the frame before.
    pop: f64,
    /// The same, root mean square of a frame.
    pop_rmse: f64,
    /// From a frame to the next.
    step: f64,
    /// The same of polygons alone.
    step_of_polygons: f64,
    /// By how much a step is larger than that of polygons.
    excess: f64,
}

fn fly(hybrid: &Hybrid, choose: impl Fn(i32) -> Selection) -> Flight {
    // The reference's picture within 2e-4, in a hundredth of the time.
    let mut cpu = surfel_cpu::Renderer::new(0).unwrap();
    let mut draw = |selection: &Selection, frame: i32| {
        render(&mut cpu, &case(hybrid, selection, &flown(frame)), Planes::ALL).unwrap()
    };
    let polygons = |frame: i32| chosen(hybrid, &flown(frame), Cull::Back, 1e-6);
    let mut flight = Flight::default();
    let mut before = choose(0);
    let mut shown = [draw(&before, 0), draw(&polygons(0), 0)];
    for frame in 1..=FRAMES {
        let after = choose(frame);
        let next = [draw(&after, frame), draw(&polygons(frame), frame)];
        let pixels = inside(&flown(frame), 0.95);
        if before != after {
            // What was in view from farther away still is.
            let (pop, rmse) = difference(&next[0], &draw(&before, frame), &pixels);
            (flight.pop, flight.pop_rmse) = (flight.pop.max(pop), flight.pop_rmse.max(rmse));
            flight.changes += 1;
        }
        // Within the smaller contour, that of the frame before.
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
    let hybrid = ball();
    let at = |frame: i32, error_px: f64| chosen(&hybrid, &flown(frame), Cull::Back, error_px);
    let right = fly(&hybrid, |frame| at(frame, FLIGHT_PX));
    println!("{right:?}");
    assert!(right.changes > 10 && right.pop_rmse < POP_RMSE, "{right:?}");
    assert!(right.pop < POP && right.excess < POP, "{right:?}");
    // What would pop does.
    let bare = fly(&hybrid, |frame| without_transitions(&hybrid, at(frame, FLIGHT_PX)));
    println!("without transitions {bare:?}");
    assert!(bare.pop > POP && bare.excess > POP && bare.pop_rmse > POP_RMSE, "{bare:?}");
    let jumping = fly(&hybrid, |frame| at(frame, if frame < FRAMES / 2 { FLIGHT_PX } else { 8.0 }));
    println!("the threshold jumps {jumping:?}");
    assert!(jumping.pop > POP && jumping.excess > POP && jumping.pop_rmse > POP_RMSE, "{jumping:?}");
}

/// Leaves of different depth side by side, some of them slivers: no gaps beside their edges.
#[test]
fn octree_is_whole_where_coarse_leaves_meet_fine_ones() {
    let mut mesh = mesh_sphere(6);
    // Triangles that shrink toward one side of a tilted, flattened ball.
    let squeezed = |p: DVec3| {
        let q = DVec3::new(p.x + 0.3 * p.y, p.y, 0.4 * p.z + 0.2 * p.x);
        q * (0.15 + 0.5 * (q.x + 1.2).powi(2))
    };
    let vertices: Vec<DVec3> = (0..mesh.positions.len()).map(|i| squeezed(mesh.positions.get(i))).collect();
    mesh = surfel_conformance::polygons::mesh(&vertices, mesh.triangles);
    let hybrid = hybrid_from_mesh(&mesh, &HybridOptions::default(), &NoProgress).unwrap();
    let depths = |n: &surfel_model::HybridNode| (n.splat_radius / hybrid.nodes()[0].splat_radius).log2().round() as i32;
    let leaves: std::collections::BTreeSet<i32> = hybrid.nodes().iter().filter(|n| n.is_leaf()).map(depths).collect();
    assert!(leaves.len() >= 3, "{leaves:?}");
    // Each leaf must cover its triangles by its own splats and those on its edges, whatever is drawn beside it.
    let (mut bare, mut looked) = (0, 0);
    for (i, leaf) in (0u32..).zip(hybrid.nodes()).filter(|(_, n)| n.is_leaf()) {
        let edges = hybrid.transitions().iter().filter(|t| t.leaves.contains(&i)).flat_map(|t| t.splats.clone());
        let splats: Vec<(DVec3, f64)> = leaf
            .splats
            .clone()
            .chain(edges)
            .map(|k| (hybrid.cloud().center(k as usize), hybrid.cloud().radius_max(k as usize)))
            .collect();
        for t in leaf.triangles.clone() {
            let corners = hybrid.mesh().triangles[t as usize].map(|k| hybrid.mesh().positions.get(k as usize));
            for b in [[1.0, 1.0, 1.0], [4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0]] {
                let p = (corners[0] * b[0] + corners[1] * b[1] + corners[2] * b[2]) / b.iter().sum::<f64>();
                looked += 1;
                bare += usize::from(!splats.iter().any(|(center, radius)| (p - *center).length() < *radius));
            }
        }
    }
    assert!(bare == 0 && looked > 10_000, "{bare} of {looked}");
}
