//! Tests the visibility of the sky, and shadows of its bright areas, against closed forms and ray casting.

use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::f64::consts::{PI, TAU};
use surfel_light::{LightOptions, light_scene};
use surfel_model::{
    CloudData, Column3, Cull, Geometry, Ground, GroundStyle, Mesh, Object, OnInvalid, Scene, Shape, Sky, SkyArea,
    SplatCloud,
};

/// Largest accepted error of the fraction of the sky that is visible from a point. It is the error of 512 directions
/// and of depth maps of 384² texels.
const TOLERANCE: f64 = 0.02;

fn cloud(points: &[(DVec3, DVec3)], radius: f64) -> SplatCloud {
    let centers = Column3::from_f64(&points.iter().map(|(p, _)| *p).collect::<Vec<_>>());
    let normals = Column3::from_f64(&points.iter().map(|(_, n)| *n).collect::<Vec<_>>());
    let shape = Shape::Disks { normals, radii: vec![radius as f32; points.len()] };
    let data = CloudData { oriented: true, ..CloudData::new(DVec3::ZERO, centers, shape) };
    SplatCloud::new(data, OnInvalid::Refuse).unwrap().0
}

/// Returns disks on the plane z = 0 that face up, `step` apart, in a square of half-width `half` about the origin.
fn floor(half: f64, step: f64) -> SplatCloud {
    let count = (half / step) as i32;
    let at = |i: i32| f64::from(i) * step;
    let points: Vec<_> = (-count..=count)
        .flat_map(|y| (-count..=count).map(move |x| (DVec3::new(at(x), at(y), 0.0), DVec3::Z)))
        .collect();
    cloud(&points, step)
}

/// Returns `count` points of the unit sphere whose z is at least `lowest`, each for an equal area.
fn sphere(count: u32, lowest: f64) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |i| {
        let z = lowest + (1.0 - lowest) * (f64::from(i) + 0.5) / f64::from(count);
        let (sine, turn) = ((1.0 - z * z).sqrt(), TAU * 0.618_033_988_749_895 * f64::from(i));
        DVec3::new(sine * turn.cos(), sine * turn.sin(), z)
    })
}

fn sky() -> Sky {
    Sky { directions: 512, ..Sky::new([0.0, 0.0, 1.0]) }
}

/// Returns the position and the brightness of every splat of the object with index `object`, after the scene's light is
/// stored.
fn lit(objects: Vec<Object>, sky: Sky, object: usize) -> Vec<(DVec3, f64)> {
    let scene = Scene { sky: Some(sky), objects, ..Scene::default() };
    let lit = light_scene(&scene, &LightOptions::default()).unwrap();
    let Geometry::Splats(cloud) = &lit.scene.objects[object].geometry else { panic!("no splats") };
    (0..cloud.len()).map(|i| (cloud.center(i), f64::from(cloud.color(i)[0]))).collect()
}

fn assert_near(found: &[(DVec3, f64)], expected: impl Fn(DVec3) -> Option<f64>) {
    let mut compared = 0;
    let mut worst = (0.0, DVec3::ZERO, 0.0, 0.0);
    for (p, value) in found {
        let Some(expected) = expected(*p) else { continue };
        compared += 1;
        let error = (value - expected).abs();
        if error > worst.0 {
            worst = (error, *p, *value, expected);
        }
    }
    let (error, p, value, expected) = worst;
    assert!(compared > 50, "only {compared} points were compared");
    assert!(error < TOLERANCE, "{p}: {value}, expected {expected}");
}

/// Returns the fraction of the sky that is visible from a point of the plane z = 0, on which a sphere of radius 1 rests
/// at the origin. The sphere hides its form factor, D⁻³ for a centre at the distance D and at height 1. Returns `None`
/// for points that aren't compared: at the rim of the plane, and near the contact, where the offset of the lookup along
/// the normal isn't small compared with the gap.
fn below_a_sphere(p: DVec3) -> Option<f64> {
    let distance = (p.x * p.x + p.y * p.y + 1.0).sqrt();
    let is_resolved = p.x.hypot(p.y) > 0.5 && p.abs().max_element() < 1.9;
    is_resolved.then_some(1.0 - distance.powi(-3))
}

#[test]
fn a_sphere_on_a_plane_hides_its_form_factor() {
    let ball = cloud(&sphere(6000, -1.0).map(|n| (n + DVec3::Z, n)).collect::<Vec<_>>(), 0.06);
    let found = lit(vec![floor(2.0, 0.05).into(), ball.into()], sky(), 0);
    assert_near(&found, below_a_sphere);
}

#[test]
fn a_ball_on_a_plane_hides_as_much() {
    let ball = SplatCloud::balls(&[[0.0, 0.0, 1.0]], &[1.0]).unwrap();
    let found = lit(vec![floor(2.0, 0.05).into(), ball.into()], sky(), 0);
    assert_near(&found, below_a_sphere);
}

#[test]
fn every_point_of_a_hemispherical_bowl_sees_half_of_the_sky() {
    // Disks at the rim reach up to the height of the centre.
    let bowl: Vec<_> = sphere(8000, 0.05).map(|n| (-n, n)).collect();
    let found = lit(vec![cloud(&bowl, 0.05).into()], sky(), 0);
    // By reciprocity, the upper half of the sphere receives half of the light that leaves any point of the lower half.
    assert_near(&found, |p| (p.z < -0.1).then_some(0.5));
}

#[test]
fn two_walls_hide_the_angles_below_their_tops() {
    let wall = |x: f32| {
        let corners = [[x, -30.0, 0.0], [x, 30.0, 0.0], [x, 30.0, 1.0], [x, -30.0, 1.0]];
        let positions = Column3::from_f32(corners.map(Vec3::from).to_vec());
        Object::from(Mesh { positions, triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() })
    };
    // The depth maps cover the floor, but only the near parts of the walls, which are longer.
    let strip: Vec<_> = (-18..=18)
        .flat_map(|x| (-10..=10).map(move |y| (DVec3::new(f64::from(x) * 0.05, f64::from(y) * 0.05, 0.0), DVec3::Z)))
        .collect();
    let found = lit(vec![cloud(&strip, 0.05).into(), wall(-1.0), wall(1.0)], sky(), 0);
    // A wall of height 1 at the distance d hides (1 - cos(atan(1/d)))/2.
    assert_near(&found, |p| {
        let seen = |distance: f64| 0.5 * distance / distance.hypot(1.0);
        Some(seen(1.0 - p.x) + seen(1.0 + p.x))
    });
}

#[test]
fn the_shadow_of_a_disk_below_an_area_equals_that_of_rays() {
    let toward = DVec3::new(0.3, 0.0, 1.0).normalize();
    let area = SkyArea { toward: toward.into(), half_angle_deg: 12.0, strength: 1.0 };
    let sky = Sky { above: 0.0, areas: vec![area], directions: 256, ..sky() };
    let disk = SplatCloud::disks(&[[0.0f32, 0.0, 1.0]], &[[0.0f32, 0.0, 1.0]], &[0.5]).unwrap();
    let found = lit(vec![floor(1.5, 0.03).into(), disk.into()], sky, 0);
    let (right, up) = (DVec3::Y, toward.cross(DVec3::Y));
    let rays: Vec<DVec3> = (0..4096)
        .map(|i| {
            let cosine = 1.0 - (1.0 - (12.0 * PI / 180.0).cos()) * (f64::from(i) + 0.5) / 4096.0;
            let (sine, turn) = ((1.0 - cosine * cosine).sqrt(), TAU * 0.618_033_988_749_895 * f64::from(i));
            toward * cosine + (right * turn.cos() + up * turn.sin()) * sine
        })
        .collect();
    let (mut whole, mut sum, mut count) = (0.0, 0.0, 0);
    for ray in &rays {
        whole += ray.dot(toward);
    }
    for (p, value) in found.iter().filter(|(p, _)| p.abs().max_element() < 1.2) {
        let is_open = |ray: &&DVec3| (*p + **ray / ray.z).truncate().length() > 0.5;
        let expected: f64 = rays.iter().filter(is_open).map(|ray| ray.z).sum::<f64>() / whole;
        sum += (value - expected) * (value - expected);
        count += 1;
    }
    let rmse = (sum / f64::from(count)).sqrt();
    assert!(count > 5000 && rmse < 0.02, "{rmse} over {count} points");
}

#[test]
fn an_object_far_away_neither_widens_the_maps_nor_takes_light() {
    let near = floor(1.0, 0.05);
    let disk = SplatCloud::disks(&[[0.0f32, 0.0, 0.3]], &[[0.0f32, 0.0, 1.0]], &[0.3]).unwrap();
    let alone = lit(vec![near.clone().into(), disk.clone().into()], sky(), 0);
    let stray = SplatCloud::disks(&[[1e5f32, 0.0, 0.0]], &[[0.0f32, 0.0, 1.0]], &[0.1]).unwrap();
    let beside = lit(vec![near.into(), disk.into(), stray.into()], sky(), 0);
    let difference = alone.iter().zip(&beside).map(|((_, a), (_, b))| (a - b).abs()).fold(0.0, f64::max);
    assert!(difference < 0.01, "{difference}");
    assert!(alone.iter().any(|(_, value)| *value < 0.6), "the disk hides a part of the sky");
}

#[test]
fn stored_light_is_the_same_for_any_number_of_threads() {
    let objects = || vec![floor(1.0, 0.05).into(), SplatCloud::balls(&[[0.0, 0.0, 0.3]], &[0.3]).unwrap().into()];
    let area = SkyArea { toward: [1.0, 0.0, 1.0], half_angle_deg: 5.0, strength: 0.5 };
    let ground = Ground { style: GroundStyle::Shadow, point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let sky = Sky { areas: vec![area], below: 0.2, bounce: true, directions: 32, ..sky() };
        let scene = Scene { sky: Some(sky), ground: Some(ground), objects: objects(), ..Scene::default() };
        let lit = pool.install(|| light_scene(&scene, &LightOptions::default())).unwrap();
        assert_eq!(lit.scene.background, [0.0; 4]);
        lit.scene.objects.iter().map(|object| format!("{:?}", object.geometry)).collect::<Vec<_>>()
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn scenes_without_a_sky_stay_as_they_are_and_ground_needs_one() {
    let scene = Scene::from(floor(1.0, 0.5));
    let lit = light_scene(&scene, &LightOptions::default()).unwrap();
    let [Geometry::Splats(before), Geometry::Splats(after)] = [&scene, &lit.scene].map(|s| &s.objects[0].geometry)
    else {
        panic!("no splats")
    };
    assert!(std::sync::Arc::ptr_eq(before, after) && lit.ground.is_none());
    let ground = Ground { style: GroundStyle::Shadow, point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
    assert!(Scene { ground: Some(ground), ..scene }.validate().is_err());
}

#[test]
fn backs_of_closed_surfaces_may_be_left_out_also_mirrored() {
    let ball = cloud(&sphere(3000, -1.0).map(|n| (n + DVec3::Z, n)).collect::<Vec<_>>(), 0.08);
    let found = |cull: Cull, matrix: DMat3| {
        let mut ball = Object::from(ball.clone());
        ball.material.cull = cull;
        ball.world_from_object = DAffine3::from_mat3(matrix);
        let sky = Sky { directions: 64, ..sky() };
        [0, 1].map(|object| lit(vec![floor(2.0, 0.1).into(), ball.clone()], sky.clone(), object))
    };
    for matrix in [DMat3::IDENTITY, DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0))] {
        let [all, front] = [Cull::None, Cull::Back].map(|cull| found(cull, matrix));
        for (all, front) in all.iter().zip(&front) {
            let pairs = all.iter().zip(front);
            let worst = pairs.map(|((_, a), (_, b))| (a - b).abs()).fold(0.0, f64::max);
            // Disks at the silhouette, half of which are left out, end less than half a texel apart.
            assert!(worst < 0.03, "{worst}");
            assert!(front.iter().any(|(_, light)| *light < 0.3), "the ball casts a shadow");
        }
    }
}

#[test]
fn splats_and_triangles_smaller_than_a_texel_cast_no_shadow_on_their_plane() {
    let sky = Sky { directions: 48, ..sky() };
    let brightest = |found: &[(DVec3, f64)]| found.iter().map(|(_, value)| *value).fold(0.0, f64::max);
    // A texel of the depth maps is 0.0074 wide.
    let dense = floor(1.0, 0.005);
    let found = lit(vec![dense.into()], sky.clone(), 0);
    let whole = brightest(&found);
    assert!((whole - 1.0).abs() < 0.01, "{whole}");
    let darkest = found.iter().map(|(_, value)| *value).fold(1.0, f64::min);
    assert!(whole - darkest < 0.01, "{darkest} to {whole}");

    const SIDE: u32 = 240;
    let at = |i: u32| f64::from(i) / f64::from(SIDE - 1) * 2.0 - 1.0;
    let positions: Vec<Vec3> =
        (0..SIDE * SIDE).map(|i| DVec3::new(at(i % SIDE), at(i / SIDE), 0.0).as_vec3()).collect();
    let squares = (0..SIDE - 1).flat_map(|y| (0..SIDE - 1).map(move |x| y * SIDE + x));
    let triangles = squares.flat_map(|i| [[i, i + 1, i + SIDE], [i + 1, i + SIDE + 1, i + SIDE]]).collect();
    let mesh = Mesh { positions: Column3::from_f32(positions), triangles, ..Mesh::default() };
    let scene = Scene { sky: Some(sky), objects: vec![mesh.into()], ..Scene::default() };
    let lit = light_scene(&scene, &LightOptions::default()).unwrap();
    let Geometry::Mesh(mesh) = &lit.scene.objects[0].geometry else { panic!("no mesh") };
    let darkest = mesh.colors.as_ref().unwrap().iter().map(|color| color[0]).fold(1.0, f32::min);
    assert!(f64::from(darkest) > whole - 0.01, "{darkest}");
}

#[test]
fn a_stray_disk_that_reaches_out_of_the_maps_keeps_to_them() {
    // The stray disk's centre is in the scene, and its radius doesn't widen the sphere that the depth maps cover.
    let normals = sphere(40, -1.0);
    for normal in normals {
        let stray = cloud(&[(DVec3::new(0.7, -0.6, 0.2), normal)], 40.0);
        let found = lit(vec![floor(1.0, 0.05).into(), stray.into()], Sky { directions: 32, ..sky() }, 0);
        assert!(found.iter().all(|(_, value)| (0.0..=1.01).contains(value)), "{normal}");
    }
}

#[test]
fn noisy_points_of_a_plane_do_not_hide_each_other() {
    let at = |i: i32| f64::from(i) * 0.05;
    // The points' heights, up to two fifths of a radius as in the noise of a scanner, vary irregularly.
    let height = |i: i32, j: i32| 0.02 * (TAU * 0.618_033_988_749_895 * f64::from(i * 41 + j)).sin();
    let points: Vec<_> =
        (-40..=40).flat_map(|j| (-40..=40).map(move |i| (DVec3::new(at(i), at(j), height(i, j)), DVec3::Z))).collect();
    let found = lit(vec![cloud(&points, 0.05).into()], sky(), 0);
    let inner = found.iter().filter(|(p, _)| p.x.abs() < 1.8 && p.y.abs() < 1.8);
    let darkest = inner.map(|(_, light)| *light).fold(1.0, f64::min);
    assert!(darkest > 0.85, "{darkest}");
}

#[test]
fn splats_that_face_into_a_body_have_the_light_of_its_outside() {
    let plane = floor(1.0, 0.05);
    let found = |points: &[(DVec3, DVec3)], cull: Cull| {
        let mut object = Object::from(cloud(points, 0.05));
        object.material.cull = cull;
        lit(vec![object], sky(), 0)
    };
    // A floor of which every 41st splat faces down: these splats get the light of their other side, or of the splats
    // around.
    let normal = |i: usize| if i % 41 == 7 { DVec3::NEG_Z } else { DVec3::Z };
    let points: Vec<_> = (0..plane.len()).map(|i| (plane.center(i), normal(i))).collect();
    for cull in [Cull::None, Cull::Back] {
        assert_near(&found(&points, cull), |_| Some(1.0));
    }
    // A floor of which every 41st splat is tilted, as in folds, so far that it would get at most (1 − 0.31)/2 of the
    // sky. These splats get the light of a neighbour, on which other tilted splats cast shadows.
    let tilted = DVec3::new(0.95, 0.0, -0.31).normalize();
    let in_folds = points.iter().enumerate().map(|(i, (p, n))| (*p, if i % 41 == 7 { tilted } else { *n }));
    let in_folds = found(&in_folds.collect::<Vec<_>>(), Cull::None);
    let darkest = in_folds.iter().map(|(_, light)| *light).fold(1.0, f64::min);
    assert!(darkest > 0.6, "{darkest}");
    // A floor of which all splats face down.
    let down: Vec<_> = points.iter().map(|(p, _)| (*p, DVec3::NEG_Z)).collect();
    assert_near(&found(&down, Cull::None), |_| Some(1.0));
    assert_near(&found(&down, Cull::Back), |_| Some(0.0));
    // A floor with additional splats for its lower side, which stay dark.
    let sides = |(p, _): &(DVec3, DVec3)| [DVec3::Z, DVec3::NEG_Z].map(|normal| (*p + 0.001 * normal, normal));
    let both: Vec<_> = points.iter().flat_map(sides).collect();
    assert_near(&found(&both, Cull::Back), |p| Some(if p.z > 0.0 { 1.0 } else { 0.0 }));
}
