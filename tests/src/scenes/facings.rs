//! Scenes of oriented clouds, whose front and back faces are separated.

use super::Case;
use crate::build::{Clipped, Splat, camera, clipped_cloud, cloud, confetti, object, scene, sheet, sphere, with_alpha};
use crate::polygons::{mesh_object, quad};
use crate::random::Random;
use glam::{DAffine3, DMat3, DVec3, Vec3Swizzles};
use surfel_model::{
    ClipLine, ClipMode, Cull, DepthTolerance, EdgeAa, Filter, Light, Mapping, Object, Scene, Shader, Transparency,
};

pub(super) fn facing_cases() -> Vec<Case> {
    let (shell, bowl, cube) = (thin_shell(), open_bowl(), oriented_cube());
    let peel = Transparency::Peel { layers: 3, drop_last: false };
    let mut cases = vec![
        shell.with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        shell.sampled(),
        bowl.sampled(),
        shell.with("affine", |s| s.mapping = Mapping::Affine),
        shell.with("absolute", |s| s.depth_tolerance = DepthTolerance::Absolute(0.15)),
        shell.with("orthographic", |_| ()).in_orthographic(2.3, 8.0),
        shell.with("toon", |s| s.shader = Shader::Toon),
        back_before_front(),
        bowl.with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        bowl.with("orthographic", |_| ()).in_orthographic(2.6, 9.0),
        bowl.with("peel", |s| s.transparency = peel),
        bowl.with("matcap", |s| s.shader = Shader::Matcap),
        cube.with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        cube.with("affine", |s| s.mapping = Mapping::Affine),
        cube,
        shell_among_undeclared(),
        shell_among_undeclared().with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        shell_among_polygons(),
        shell_among_polygons().with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        shell_among_polygons().with("orthographic", |_| ()).in_orthographic(2.3, 8.0),
        shell_over_floor(),
        inside_a_shell(),
        inside_a_shell().with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        oriented_glass().with("peel", |s| s.transparency = peel),
        oriented_glass().with("abuffer", |s| s.transparency = Transparency::ABuffer { layers: 4 }),
    ];
    for filter in Filter::ALL {
        cases.push(shell.with(filter.name(), |s| s.filter = filter));
        cases.push(bowl.with(filter.name(), |s| (s.filter, s.prefilter_radius_px) = (filter, 1.5)));
    }
    cases.extend([shell, bowl]);
    cases.extend(sheet_cases());
    cases
}

/// Returns scenes of thin sheets, which separate what is above them from what is below.
fn sheet_cases() -> Vec<Case> {
    let (roof, thin) = (roof_over_walls(20.0), thin_box());
    let peel = Transparency::Peel { layers: 3, drop_last: false };
    let mut cases = vec![
        roof.with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        roof.sampled(),
        roof.with("affine", |s| s.mapping = Mapping::Affine),
        roof.with("absolute", |s| s.depth_tolerance = DepthTolerance::Absolute(0.15)),
        roof.with("orthographic", |_| ()).in_orthographic(2.3, 8.0),
        roof.with("toon", |s| s.shader = Shader::Toon),
        roof.with("peel", |s| s.transparency = peel),
        roof_over_walls(60.0),
        roof_over_polygons(),
        roof_over_polygons().with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        thin.with("edge-aa", |s| s.edge_aa = EdgeAa::Coverage),
        thin.sampled(),
        grazing_ground(true),
    ];
    cases.extend(Filter::ALL.map(|filter| roof.with(filter.name(), |s| s.filter = filter)));
    cases.extend([roof, thin]);
    cases
}

/// Linear colour of front sides.
const FRONT: [f32; 3] = [0.9, 0.5, 0.1];
/// Linear colour of back sides.
const BACK: [f32; 3] = [0.1, 0.3, 0.9];

fn oriented(mut object: Object, interior_weight: f64) -> Object {
    object.material.oriented = Some(true);
    object.material.interior_weight = Some(interior_weight);
    object
}

fn two_lights() -> Option<Vec<Light>> {
    Some(vec![
        Light::Directional { direction: [1.0, -0.5, -1.0], color: [0.7, 0.6, 0.5], shadow: false },
        Light::Point { position: [-2.0, 2.0, 1.0], color: [0.2, 0.3, 0.6] },
    ])
}

/// Returns the splats of a plate whose thickness is a quarter of a splat's radius, seen at a slant. Its sides have two
/// colours.
fn plate() -> Vec<Splat> {
    let (across, along) = (DVec3::new(0.8, 0.1, 0.35), DVec3::new(-0.15, 0.75, 0.3));
    let out = across.cross(along).normalize() * 0.015;
    let front = sheet(out, [across, along], [22, 20], 0.12, |_, _| FRONT);
    let back = sheet(-out, [along, across], [20, 22], 0.12, |_, _| BACK);
    [front, back].concat()
}

/// Returns a thin plate, seen from the front and from behind. Both sides are within the depth tolerance. Catches
/// blending of the two sides.
pub fn thin_shell() -> Case {
    let turned = DAffine3::from_translation(DVec3::new(0.5, -0.35, -0.8)) * DAffine3::from_rotation_y(2.6);
    let twice: Vec<Splat> = plate().into_iter().chain(plate().iter().map(|splat| splat.transformed(&turned))).collect();
    let scene = Scene { lights: two_lights(), objects: vec![oriented(object(cloud(&twice)), 4.0)], ..scene(&[]) };
    Case::new("thin-shell", scene, camera(2.8, 45.0, [72, 64])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns back-facing sheets, some in front of and some behind front-facing ones. The gap between them grows through
/// zero and the tolerance. Catches errors in the choice of the nearer side, in ties, and the threshold or tolerance of
/// the wrong side.
pub fn back_before_front() -> Case {
    let mut random = Random::new(151);
    let slope = DVec3::new(0.9, 0.0, 0.16);
    let front = sheet(DVec3::ZERO, [DVec3::X, DVec3::Y * 0.9], [24, 20], 0.09, |_, _| FRONT);
    // Swapped axes (along, across) reverse the sheet's normal.
    let back = sheet(DVec3::new(0.0, 0.3, 0.0), [DVec3::Y * 0.4, slope], [9, 22], 0.06, |_, _| random.color());
    let far = sheet(DVec3::new(0.0, -0.5, 0.05), [DVec3::Y * 0.3, slope * 0.8], [7, 14], 0.17, |_, _| BACK);
    let objects = vec![oriented(object(cloud(&[front, back, far].concat())), 4.0)];
    Case::new("back-before-front", Scene { objects, ..scene(&[]) }, camera(3.0, 45.0, [72, 72]))
}

/// Returns half of a sphere twice, seen from inside and from outside. Catches errors at contours, and in lighting the
/// inside of an open surface.
pub fn open_bowl() -> Case {
    let bowl = |turn: DMat3, at: DVec3| {
        let place = DAffine3::from_mat3_translation(turn * 0.75, at);
        sphere(1400, 1.2, 157).into_iter().filter(|s| s.p.z < 0.2).map(move |s| s.transformed(&place))
    };
    let into = DMat3::from_rotation_x(0.7);
    let away = DMat3::from_rotation_y(2.2);
    let splats: Vec<Splat> =
        bowl(into, DVec3::new(-0.6, 0.1, 0.0)).chain(bowl(away, DVec3::new(0.65, 0.0, -0.2))).collect();
    let scene = Scene { lights: two_lights(), objects: vec![oriented(object(cloud(&splats)), 2.4)], ..scene(&[]) };
    Case::new("open-bowl", scene, camera(3.4, 45.0, [96, 64])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns a cube of six splats, each clipped to its face by four lines. The faces share edges, and no back face is
/// visible.
pub fn oriented_cube() -> Case {
    let line = |a: f32, b: f32| ClipLine { a, b, c: 0.5f32.sqrt() };
    let faces = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|n| [n, -n]).map(|n| Clipped {
        splat: Splat {
            p: n * 0.6,
            s: DVec3::new(n.y.abs(), n.z.abs(), n.x.abs()) * (0.6 * 2f64.sqrt()),
            t: n.cross(DVec3::new(n.y.abs(), n.z.abs(), n.x.abs())) * (0.6 * 2f64.sqrt()),
            color: [0.5 + 0.4 * n.x as f32, 0.5 + 0.4 * n.y as f32, 0.5 + 0.4 * n.z as f32],
        },
        curve: None,
        lines: vec![line(1.0, 0.0), line(-1.0, 0.0), line(0.0, 1.0), line(0.0, -1.0)],
        mode: ClipMode::And,
    });
    let mut cube = oriented(object(clipped_cloud(&faces.collect::<Vec<_>>())), 1.0);
    cube.world_from_object = DAffine3::from_rotation_y(0.6) * DAffine3::from_rotation_x(0.5);
    Case::new("oriented-cube", Scene { objects: vec![cube], ..scene(&[]) }, camera(3.0, 45.0, [64, 64]))
}

/// Returns the plate among splats that aren't declared oriented, an oriented object with back-face culling, and an
/// object whose material overrides its cloud. Catches fragments that count for the wrong side.
pub fn shell_among_undeclared() -> Case {
    let mut random = Random::new(163);
    let axes = [DVec3::new(0.8, 0.0, 0.5), DVec3::new(0.0, 0.6, 0.1)];
    let through = sheet(DVec3::new(0.1, -0.1, 0.02), axes, [14, 10], 0.1, |_, _| random.color());
    let mut ball = oriented(object(cloud(&sphere(300, 1.2, 167))), 2.4);
    ball.world_from_object = DAffine3::from_scale_rotation_translation(
        DVec3::splat(0.35),
        glam::DQuat::IDENTITY,
        DVec3::new(-0.5, 0.35, 0.2),
    );
    ball.material.cull = Cull::Back;
    let mut declared = cloud(&confetti(60, 0.09, 3.0, 173));
    declared.set_oriented(true);
    let mut undeclared = object(declared);
    (undeclared.material.oriented, undeclared.material.interior_weight) = (Some(false), Some(2.0));
    let mut other = object(cloud(&through));
    other.material.interior_weight = Some(2.0);
    let shell = oriented(object(cloud(&plate())), 4.0);
    let objects = vec![other, shell, ball, undeclared];
    let scene = Scene { lights: two_lights(), objects, ..scene(&[]) };
    Case::new("shell-among-undeclared", scene, camera(2.8, 45.0, [64, 64])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns the plate and a polygon that intersects it. Only splats of one side are blended over the polygon.
pub fn shell_among_polygons() -> Case {
    let mut scene = scene(&[]);
    scene.objects = vec![
        oriented(object(cloud(&plate())), 4.0),
        mesh_object(quad(DVec3::ZERO, [DVec3::new(0.7, 0.0, -0.2), DVec3::new(0.0, 0.5, 0.1)], 1.0)),
    ];
    scene.lights = two_lights();
    Case::new("shell-among-polygons", scene, camera(2.8, 45.0, [64, 64])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns the plate above a floor. Both sides of the plate cast shadows on the floor.
pub fn shell_over_floor() -> Case {
    let floor = sheet(DVec3::new(0.0, -0.8, 0.0), [DVec3::X * 1.6, DVec3::NEG_Z * 1.6], [24, 24], 0.12, |_, _| BACK);
    let objects = vec![oriented(object(cloud(&plate())), 4.0), object(cloud(&floor))];
    let light = Light::Directional { direction: [0.3, -1.0, -0.4], color: [1.0; 3], shadow: true };
    let scene = Scene { lights: Some(vec![light]), objects, ..scene(&[]) };
    Case::new("shell-over-floor", scene, camera(3.4, 45.0, [64, 64])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns plates around the eye and across the near plane, seen from inside and from outside. The CPU backend draws
/// splats so near in f64, by code of its own.
pub fn inside_a_shell() -> Case {
    let mut random = Random::new(179);
    let sides = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y].into_iter().flat_map(|out| {
        let along = DVec3::NEG_Z * 1.5;
        // The eye is inside, so the outward direction points away from it. Every second plate is reversed and faces the
        // eye.
        let across = out.cross(DVec3::Z) * 0.5;
        let color = random.color();
        let at = out * 0.32 + DVec3::Z * 1.6;
        let outer = sheet(at, [across, along], [5, 12], 0.24, |_, _| color);
        let inner = sheet(at - out * 0.02, [along, across], [12, 5], 0.24, |_, _| color.map(|c| 1.0 - c));
        [outer, inner].concat()
    });
    let objects = vec![oriented(object(cloud(&sides.collect::<Vec<_>>())), 4.0)];
    let mut case = Case::new("inside-a-shell", Scene { objects, lights: two_lights(), ..scene(&[]) }, {
        let mut camera = camera(3.0, 60.0, [64, 56]);
        camera.near = 0.2;
        camera
    });
    case.settings.shader = Shader::Phong;
    case
}

/// Returns the splats of a watertight box around the origin, with a spacing of 0.05.
fn closed_box(half: DVec3, radius: f64, mut color: impl FnMut(DVec3) -> [f32; 3]) -> Vec<Splat> {
    let outward = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|n| [n, -n]);
    let side = |out: DVec3| {
        let across = out.abs().zxy() * half;
        let along = out.cross(out.abs().zxy()) * half;
        let count = |axis: DVec3| (axis.length() / 0.025).round().max(1.0) as usize;
        sheet(out * half, [across, along], [count(across), count(along)], radius, |_, _| color(out))
    };
    outward.flat_map(side).collect()
}

/// Colour of the top of [`roof_over_walls`].
pub const ROOF: [f32; 3] = FRONT;

/// Returns the splats of a watertight roof, 0.03 thick, and of four boxes as walls, which end at the roof's underside.
fn roof_and_walls() -> [Vec<Splat>; 2] {
    let roof = closed_box(DVec3::new(0.9, 0.015, 0.7), 0.07, |out| if out.y > 0.0 { ROOF } else { BACK });
    let mut random = Random::new(191);
    let mut wall = |half: DVec3, at: DVec3| {
        let splats = closed_box(half, 0.05, |_| random.color());
        splats.into_iter().map(move |splat| Splat { p: splat.p + at - DVec3::Y * (half.y + 0.015), ..splat })
    };
    let mut walls = Vec::new();
    for at in [-0.4, 0.4] {
        walls.extend(wall(DVec3::new(0.7, 0.2, 0.05), DVec3::Z * at));
        walls.extend(wall(DVec3::new(0.05, 0.2, 0.3), DVec3::X * at));
    }
    [roof, walls]
}

/// Returns a thin roof over walls that end at its underside, seen from an elevation in degrees. No wall should be
/// visible through the roof.
pub fn roof_over_walls(elevation_deg: f64) -> Case {
    let mut house = oriented(object(cloud(&roof_and_walls().concat())), 4.0);
    house.world_from_object = DAffine3::from_rotation_x(elevation_deg.to_radians()) * DAffine3::from_rotation_y(0.4);
    let scene = Scene { lights: two_lights(), objects: vec![house], ..scene(&[]) };
    let name = format!("roof-over-walls-{elevation_deg}");
    Case::new(&name, scene, camera(3.0, 45.0, [72, 64]))
}

/// Returns the roof over polygons that it hides, and over walls of splats that aren't oriented.
pub fn roof_over_polygons() -> Case {
    let place = DAffine3::from_rotation_x(0.35) * DAffine3::from_rotation_y(0.4);
    let [roof, walls] = roof_and_walls();
    let mut ceiling =
        mesh_object(quad(DVec3::new(0.0, -0.02, 0.0), [DVec3::Z * 0.5, DVec3::new(0.6, 0.005, 0.0)], 1.0));
    let (mut roof, mut walls) = (oriented(object(cloud(&roof)), 4.0), object(cloud(&walls)));
    walls.material.interior_weight = Some(3.0);
    for object in [&mut roof, &mut walls, &mut ceiling] {
        object.world_from_object = place;
    }
    let scene = Scene { lights: two_lights(), objects: vec![walls, roof, ceiling], ..scene(&[]) };
    Case::new("roof-over-polygons", scene, camera(3.0, 45.0, [72, 64])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns a watertight box that is thinner than the depth tolerance of its splats, with nothing near it.
pub fn thin_box() -> Case {
    let mut random = Random::new(193);
    let splats = closed_box(DVec3::new(0.8, 0.02, 0.6), 0.06, |_| random.color());
    let mut object = oriented(object(cloud(&splats)), 3.0);
    object.world_from_object = DAffine3::from_rotation_x(0.5) * DAffine3::from_rotation_y(-0.6);
    let scene = Scene { lights: two_lights(), objects: vec![object], ..scene(&[]) };
    Case::new("thin-box", scene, camera(2.8, 45.0, [72, 64])).with("lit", |s| s.shader = Shader::Phong)
}

/// Returns ground without an underside, seen at 5 degrees. Nothing limits the filter, whether the ground is oriented or
/// not.
pub fn grazing_ground(is_oriented: bool) -> Case {
    let mut random = Random::new(197);
    let ground = sheet(DVec3::Y * -0.3, [DVec3::Z * 3.0, DVec3::X * 1.5], [90, 46], 0.07, |_, _| random.color());
    let mut object = oriented(object(cloud(&ground)), 4.0);
    object.material.oriented = Some(is_oriented);
    Case::new("grazing-ground", Scene { objects: vec![object], ..scene(&[]) }, camera(3.4, 45.0, [72, 64]))
}

/// Returns an oriented shell of glass around an opaque one. Transparent layers don't separate the sides.
pub fn oriented_glass() -> Case {
    let glass = oriented(object(with_alpha(cloud(&sphere(500, 1.2, 181)), |_| 0.4)), 2.4);
    let mut shell = oriented(object(cloud(&plate())), 4.0);
    shell.world_from_object = DAffine3::from_scale(DVec3::splat(0.7));
    let scene = Scene { objects: vec![glass, shell], lights: two_lights(), ..scene(&[]) };
    Case::new("oriented-glass", scene, camera(3.2, 45.0, [64, 64])).with("lit", |s| s.shader = Shader::Phong)
}
