//! Up axis and view of shapes made for the tests, of Spot, and of shapes without evidence.

use std::path::Path;
use std::sync::Arc;
use surfel_framing::{
    FrameOptions, FrameProjection, UpConvention, UpReason, Upright, ViewAngles, ViewAxes, best_view, frame_camera,
    upright,
};
use surfel_load::LoadOptions;
use surfel_model::glam::{DAffine3, DMat3, DVec2, DVec3, Quat, Vec3};
use surfel_model::{
    Column3, GaussianCloud, GaussianData, GaussianKind, Geometry, Material, Mesh, Object, OnInvalid, PointCloud, Scene,
    Up,
};
use surfel_model::{ConvertOptions, SplatCloud, SplatCount};
use surfel_sample::NoProgress;
use surfel_sample::{MeshMethod, MeshOptions, PointOptions, splats_from_mesh, splats_from_points};

const MESHES: UpConvention = UpConvention::Meshes;
const POINTS: UpConvention = UpConvention::Points;
const STL: UpConvention = UpConvention::Stl;

/// A triangle mesh in y-up coordinates.
#[derive(Default)]
struct Shape {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// Adds a surface over a grid of parameters in [0, 1]².
    fn grid(mut self, [nu, nv]: [u32; 2], at: impl Fn(f64, f64) -> DVec3) -> Self {
        let first = self.positions.len() as u32;
        for j in 0..=nv {
            for i in 0..=nu {
                self.positions.push(at(f64::from(i) / f64::from(nu), f64::from(j) / f64::from(nv)));
            }
        }
        for (i, j) in (0..nv).flat_map(|j| (0..nu).map(move |i| (i, j))) {
            let a = first + j * (nu + 1) + i;
            let [b, c, d] = [a + 1, a + nu + 1, a + nu + 2];
            self.triangles.extend([[a, b, d], [a, d, c]]);
        }
        self
    }

    fn block(self, lo: [f64; 3], hi: [f64; 3]) -> Self {
        let (lo, hi) = (DVec3::from(lo), DVec3::from(hi));
        let corner = |x: f64, y: f64, z: f64| lo + (hi - lo) * DVec3::new(x, y, z);
        self.grid([1, 1], |u, v| corner(u, v, 1.0))
            .grid([1, 1], |u, v| corner(1.0 - u, v, 0.0))
            .grid([1, 1], |u, v| corner(1.0, v, 1.0 - u))
            .grid([1, 1], |u, v| corner(0.0, v, u))
            .grid([1, 1], |u, v| corner(u, 1.0, 1.0 - v))
            .grid([1, 1], |u, v| corner(u, 0.0, v))
    }

    fn ball(self, center: [f64; 3], radii: [f64; 3]) -> Self {
        self.grid([48, 24], |u, v| {
            let ((sin, cos), polar) = ((std::f64::consts::TAU * u).sin_cos(), std::f64::consts::PI * (v - 0.5));
            DVec3::from(center) + DVec3::from(radii) * DVec3::new(sin * polar.cos(), polar.sin(), cos * polar.cos())
        })
    }

    fn table() -> Self {
        let leg = |shape: Self, x: f64, z: f64| shape.block([x - 0.05, 0.0, z - 0.05], [x + 0.05, 0.9, z + 0.05]);
        let legs = [(-0.7, -0.4), (0.7, -0.4), (-0.7, 0.4), (0.7, 0.4)];
        legs.into_iter().fold(Self::default(), |s, (x, z)| leg(s, x, z)).block([-0.8, 0.9, -0.5], [0.8, 1.0, 0.5])
    }

    fn chair() -> Self {
        let leg = |shape: Self, x: f64, z: f64| shape.block([x - 0.03, 0.0, z - 0.03], [x + 0.03, 0.5, z + 0.03]);
        let legs = [(-0.22, -0.22), (0.22, -0.22), (-0.22, 0.22), (0.22, 0.22)];
        let chair = legs.into_iter().fold(Self::default(), |s, (x, z)| leg(s, x, z));
        chair.block([-0.26, 0.5, -0.26], [0.26, 0.55, 0.26]).block([-0.26, 0.55, -0.26], [0.26, 1.1, -0.22])
    }

    /// Returns a bust: a head on a neck, on a plinth, with a nose toward +z.
    fn bust() -> Self {
        let head = Self::default().ball([0.0, 1.2, 0.0], [0.32, 0.42, 0.38]).ball([0.0, 1.15, 0.38], [0.06, 0.1, 0.12]);
        head.ball([0.0, 0.7, 0.0], [0.17, 0.3, 0.17]).block([-0.35, 0.0, -0.3], [0.35, 0.5, 0.3])
    }

    /// Returns a person: feet, legs, a trunk, arms and a head.
    fn figure() -> Self {
        let leg = |shape: Self, x: f64| {
            let foot = shape.block([x - 0.05, 0.0, -0.2], [x + 0.05, 0.06, 0.06]);
            foot.ball([x, 0.45, 0.0], [0.08, 0.44, 0.09]).ball([3.0 * x, 1.1, 0.0], [0.05, 0.36, 0.05])
        };
        let legs = leg(leg(Self::default(), -0.1), 0.1);
        legs.ball([0.0, 1.15, 0.0], [0.2, 0.36, 0.12]).ball([0.0, 1.63, 0.0], [0.09, 0.13, 0.11])
    }

    /// Returns a calf: four legs, a body along z, and a head held high at −z.
    fn calf() -> Self {
        let leg = |shape: Self, x: f64, z: f64| shape.block([x - 0.06, 0.0, z - 0.06], [x + 0.06, 0.6, z + 0.06]);
        let legs = [(-0.2, -0.5), (0.2, -0.5), (-0.2, 0.5), (0.2, 0.5)];
        let calf = legs.into_iter().fold(Self::default(), |s, (x, z)| leg(s, x, z));
        calf.ball([0.0, 0.75, 0.0], [0.3, 0.3, 0.75]).ball([0.0, 1.25, -0.75], [0.2, 0.22, 0.3])
    }

    /// Returns a bull: four legs, a body along z, a head held low at -z, and a tail.
    fn bull() -> Self {
        let leg = |shape: Self, x: f64, z: f64| shape.block([x - 0.06, 0.0, z - 0.06], [x + 0.06, 0.6, z + 0.06]);
        let legs = [(-0.2, -0.5), (0.2, -0.5), (-0.2, 0.5), (0.2, 0.5)];
        let bull = legs.into_iter().fold(Self::default(), |s, (x, z)| leg(s, x, z));
        let bull = bull.ball([0.0, 0.75, 0.0], [0.3, 0.3, 0.75]).ball([0.0, 0.75, -0.85], [0.2, 0.25, 0.3]);
        bull.block([-0.03, 0.85, 0.6], [0.03, 0.91, 1.3])
    }

    /// Returns hills 0.2 high over a square with sides of 2.
    fn hills() -> Self {
        let height = |x: f64, z: f64| 0.06 * (3.0 * x).sin() * (2.0 * z + 1.0).cos() + 0.04 * (7.0 * x + 4.0 * z).sin();
        Self::default().grid([60, 60], |u, v| {
            let (x, z) = (2.0 * u - 1.0, 1.0 - 2.0 * v);
            DVec3::new(x, height(x, z), z)
        })
    }

    /// Returns this shape transformed by `map`.
    fn mesh(&self, map: DAffine3) -> Mesh {
        let positions: Vec<DVec3> = self.positions.iter().map(|p| map.transform_point3(*p)).collect();
        let origin = positions[0];
        let local = positions.iter().map(|p| (*p - origin).as_vec3()).collect();
        Mesh { origin, positions: Column3::from_f32(local), triangles: self.triangles.clone(), ..Mesh::default() }
    }

    /// Returns splats of the shape, as a program would make them from a mesh.
    fn object(&self, map: DAffine3, splats: usize) -> Object {
        let mesh = self.mesh(map);
        let options = MeshOptions { method: MeshMethod::Count(splats), ..MeshOptions::auto(&mesh) };
        object(splats_from_mesh(&mesh, &options, &NoProgress).unwrap().0)
    }
}

fn object(cloud: SplatCloud) -> Object {
    let geometry = Geometry::Splats(Arc::new(cloud));
    Object { geometry, world_from_object: DAffine3::IDENTITY, material: Material::default() }
}

/// Returns the rotation of y-up coordinates that makes another axis up.
fn turned(up: Up) -> DAffine3 {
    let axis = up.vector();
    let side = DVec3::new(axis.y.abs() + axis.z.abs(), axis.x.abs(), 0.0);
    DAffine3::from_mat3(DMat3::from_cols(side, axis, side.cross(axis)))
}

fn spot() -> Object {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/spot/spot.obj");
    let convert = ConvertOptions { splats: Some(SplatCount::Count(20_000)), ..ConvertOptions::default() };
    let options = LoadOptions::default().with_convert(&convert, Path::new(""));
    object(surfel_load::load(&path, &options, &NoProgress).unwrap().cloud)
}

#[test]
fn standing_things_stand_in_either_convention() {
    let shapes =
        [("table", Shape::table()), ("chair", Shape::chair()), ("bust", Shape::bust()), ("calf", Shape::calf())];
    for (name, shape) in &shapes {
        for up in [Up::PlusY, Up::PlusZ] {
            for convention in [MESHES, POINTS] {
                let found = upright(&[shape.object(turned(up), 8000)], convention);
                assert_eq!((found.up, found.reason), (up, UpReason::Base), "{name}, {up} up, {convention:?}");
            }
        }
    }
    // A clear base decides even for an axis that is hardly ever up in files.
    let found = upright(&[Shape::bust().object(turned(Up::MinusZ), 8000)], MESHES);
    assert_eq!((found.up, found.reason), (Up::MinusZ, UpReason::Base));
}

#[test]
fn ground_lies_level_by_its_coordinates_or_its_shape() {
    let hills = Shape::hills();
    for up in [Up::PlusY, Up::PlusZ] {
        let found = upright(&[hills.object(turned(up), 8000)], MESHES);
        assert_eq!((found.up, found.reason), (up, UpReason::Ground), "{up}");
    }
    // A hillside counts as terrain, but a roof doesn't.
    for (angle, is_ground) in [(10.0_f64, true), (18.0, true), (28.0, true), (36.0, false)] {
        for up in [Up::PlusY, Up::PlusZ] {
            for axis in [DVec3::X, DVec3::Z, DVec3::new(0.8, 0.0, -0.6)] {
                let lean = DAffine3::from_axis_angle(axis, angle.to_radians());
                let found = upright(&[hills.object(turned(up) * lean, 8000)], MESHES);
                assert_eq!(found == Upright { up, reason: UpReason::Ground }, is_ground, "{angle} {axis} {found:?}");
            }
        }
    }
    // UTM coordinates: a hundred metres, and quite flat.
    let utm = DAffine3::from_translation(DVec3::new(691_600.0, 5_336_400.0, 520.0))
        * DAffine3::from_mat3(DMat3::from_cols(DVec3::X * 50.0, DVec3::Z * 0.1, DVec3::NEG_Y * 50.0));
    for convention in [MESHES, POINTS, STL] {
        let found = upright(&[hills.object(utm, 8000)], convention);
        assert_eq!((found.up, found.reason), (Up::PlusZ, UpReason::Georeferenced));
    }
    // A drawing in the plane of x and y isn't terrain.
    let drawing = Shape::default().grid([1, 1], |u, v| DVec3::new(u, v, 0.0));
    assert_eq!(upright(&[drawing.object(DAffine3::IDENTITY, 2000)], MESHES).up, Up::PlusY);
}

/// Returns points of a corner of a room in a camera's coordinates, y down: a floor, a wall behind it and one beside it.
/// The normals are stored or estimated.
fn corner(normals: bool) -> Object {
    let side = |n: DVec3, at: fn(f64, f64) -> DVec3| {
        (0..3600).map(move |i| (at(f64::from(i % 60) / 60.0, f64::from(i / 60) / 60.0), n)).collect::<Vec<_>>()
    };
    let floor = side(DVec3::NEG_Y, |u, v| DVec3::new(2.0 * u, 1.0, 2.0 + 2.0 * v));
    let behind = side(DVec3::NEG_Z, |u, v| DVec3::new(2.0 * u, v - 0.2, 4.0));
    let beside = side(DVec3::X, |u, v| DVec3::new(0.0, u - 0.2, 2.0 + 2.0 * v));
    let (positions, own): (Vec<DVec3>, Vec<DVec3>) = [floor, behind, beside].concat().into_iter().unzip();
    let points = PointCloud {
        positions: Column3::from_f64(&positions),
        normals: normals.then(|| Column3::from_f64(&own)),
        ..PointCloud::default()
    };
    object(splats_from_points(&points, &PointOptions::default(), &NoProgress).unwrap().0)
}

#[test]
fn floors_face_up_by_normals_of_the_file() {
    let found = upright(&[corner(true)], POINTS);
    assert_eq!((found.up, found.reason), (Up::MinusY, UpReason::Floor));
    // Estimated normals face the presumed outside, and meshes have normals on both sides of walls.
    assert_ne!(upright(&[corner(false)], POINTS).reason, UpReason::Floor);
    assert_ne!(upright(&[corner(true)], MESHES).reason, UpReason::Floor);
    // Ground with gaps and trees isn't a height field, but none of it faces down.
    let balls = |s: Shape, i: u32| {
        let (x, z) = (f64::from(i % 6) / 3.0 - 0.9, f64::from(i / 6) / 3.0 - 0.9);
        s.ball([x, 0.15, z], [0.13, 0.13, 0.13])
    };
    let garden = (0..36).fold(Shape::hills(), balls);
    for (up, is_floor) in [(Up::MinusY, true), (Up::PlusZ, true), (Up::MinusZ, false)] {
        let mesh = garden.mesh(turned(up));
        let (cloud, _) = splats_from_mesh(&mesh, &MeshOptions::new(MeshMethod::Count(12_000)), &NoProgress).unwrap();
        let normal = |i: usize| cloud.normal(i);
        let seen: Vec<usize> = (0..cloud.len()).filter(|i| normal(*i).dot(up.vector()) > -0.2).collect();
        let column = |of: &dyn Fn(usize) -> DVec3| Column3::from_f64(&seen.iter().map(|i| of(*i)).collect::<Vec<_>>());
        let points = PointCloud {
            positions: column(&|i| cloud.center(i)),
            normals: Some(column(&normal)),
            ..PointCloud::default()
        };
        let cloud = splats_from_points(&points, &PointOptions::default(), &NoProgress).unwrap().0;
        let found = upright(&[object(cloud)], POINTS);
        assert_eq!(found == Upright { up, reason: UpReason::Floor }, is_floor, "{up}: {found:?}");
    }
}

#[test]
fn pictures_have_as_much_room_on_either_side() {
    let size = [1200, 800];
    for shape in [Shape::hills(), Shape::table(), Shape::bust(), Shape::bull()] {
        for view in [ViewAngles::ISO, ViewAngles { azimuth_deg: 300.0, elevation_deg: 50.0 }] {
            let geometry = Geometry::Mesh(Arc::new(shape.mesh(turned(Up::PlusZ))));
            let object = Object { geometry, world_from_object: DAffine3::IDENTITY, material: Material::default() };
            let axes = ViewAxes::turned(view, Up::PlusZ);
            let projection = FrameProjection::Perspective(35.0);
            let options = FrameOptions { axes, projection, size, fill: 0.9, turning: None };
            let scene = Scene { objects: vec![object], ..Scene::default() };
            let camera = frame_camera(&scene, &options).unwrap();
            let half = (17.5_f64).to_radians().tan() / 400.0;
            let mut bounds = [DVec2::INFINITY, DVec2::NEG_INFINITY];
            for p in &shape.positions {
                let q = turned(Up::PlusZ).transform_point3(*p) - DVec3::from(camera.eye);
                let at = DVec2::new(q.dot(axes.right), q.dot(axes.up)) / (q.dot(axes.forward) * half);
                bounds = [bounds[0].min(at), bounds[1].max(at)];
            }
            let [lo, hi] = bounds;
            assert!((lo + hi).abs().max_element() < 2.0, "{view} {lo} {hi}");
            let full = (hi / DVec2::new(600.0, 400.0)).max_element();
            assert!((0.88..0.901).contains(&full), "{view}: {full}");
        }
    }
}

#[test]
fn what_says_nothing_follows_the_convention() {
    let ball = Shape::default().ball([2.0; 3], [1.0; 3]).object(DAffine3::IDENTITY, 8000);
    let cube = Shape::default().block([0.0; 3], [1.0; 3]).object(DAffine3::IDENTITY, 8000);
    for object in [ball, cube] {
        let objects = [object];
        let [mesh, points] = [MESHES, POINTS].map(|convention| upright(&objects, convention));
        assert_eq!((mesh.up, mesh.reason), (Up::PlusY, UpReason::Convention));
        assert_eq!((points.up, points.reason), (Up::PlusZ, UpReason::Convention));
        // All sides show as much, so the preferred view is chosen; it shows a corner of the cube.
        assert_eq!(best_view(&objects, Up::PlusY), ViewAngles::ISO);
    }
    assert_eq!(upright(&[], MESHES).up, Up::PlusY);
    assert_eq!(best_view(&[], Up::PlusZ), ViewAngles::ISO);
}

/// Returns the angle between a view and the direction of a front, in degrees about the up axis.
fn off(view: ViewAngles, up: Up, front: DVec3) -> f64 {
    let level = ViewAxes::turned(ViewAngles { elevation_deg: 0.0, ..view }, up).forward;
    level.angle_between(-front).to_degrees()
}

#[test]
fn spot_shows_its_face() {
    let objects = [spot()];
    assert_eq!(upright(&objects, MESHES).up, Up::PlusY);
    let view = best_view(&objects, Up::PlusY);
    assert!(off(view, Up::PlusY, DVec3::NEG_Z) <= 60.5, "{view}");
    // The default view would show its tail.
    assert!(off(ViewAngles::ISO, Up::PlusY, DVec3::NEG_Z) > 120.0);
}

#[test]
fn animals_show_their_head_in_either_convention() {
    for up in [Up::PlusY, Up::PlusZ] {
        let head = turned(up).transform_vector3(DVec3::NEG_Z);
        for animal in [Shape::calf(), Shape::bull()] {
            let view = best_view(&[animal.object(turned(up), 8000)], up);
            assert!(off(view, up, head) <= 60.5, "{up}: {view}");
        }
    }
}

#[test]
fn what_lies_low_is_seen_from_above() {
    let elevation_deg = |shape: Shape| best_view(&[shape.object(DAffine3::IDENTITY, 8000)], Up::PlusY).elevation_deg;
    assert_eq!(elevation_deg(Shape::hills()), 50.0);
    assert_eq!(elevation_deg(Shape::default().block([0.0; 3], [3.0, 0.1, 1.0])), 50.0);
    // Shapes whose sides show as much as their tops: posts, four by four.
    let posts = (0..16).fold(Shape::default(), |shape, i| {
        let (x, z) = (f64::from(i % 4) / 4.0, f64::from(i / 4) / 4.0);
        shape.block([x, 0.0, z], [x + 0.025, 0.28, z + 0.025])
    });
    assert_eq!(elevation_deg(posts), 40.0);
    let pebble = |height: f64| Shape::default().ball([0.0; 3], [1.0, 0.5 * height, 0.5]);
    assert_eq!([0.2, 0.35, 0.45].map(|height| elevation_deg(pebble(height))), [50.0, 40.0, 20.0]);
    assert_eq!(elevation_deg(Shape::bust()), 20.0);
}

#[test]
fn seats_show_their_front() {
    for up in [Up::PlusY, Up::PlusZ] {
        // The chair is also turned around, so that the default front doesn't decide.
        for turn in [DMat3::IDENTITY, DMat3::from_rotation_y(std::f64::consts::PI)] {
            let map = turned(up) * DAffine3::from_mat3(turn);
            let view = best_view(&[Shape::chair().object(map, 8000)], up);
            assert!(off(view, up, map.transform_vector3(DVec3::Z)) <= 60.5, "{up}: {view}");
        }
    }
}

/// Returns a figure that faces +x, which only its feet show; one of them is raised by `raised`.
fn figure(raised: f64) -> Shape {
    let limb = |shape: Shape, z: f64, up: f64| {
        let shape = shape.block([-0.06, up, z - 0.05], [0.2, up + 0.08, z + 0.05]);
        shape.block([-0.05, up + 0.08, z - 0.04], [0.05, 0.9, z + 0.04])
    };
    let body = Shape::default().block([-0.1, 0.9, -0.22], [0.1, 1.5, 0.22]);
    limb(limb(body, -0.13, 0.0), 0.13, raised).ball([0.0, 1.66, 0.0], [0.14; 3])
}

#[test]
fn figures_on_two_feet_are_seen_from_where_their_toes_point() {
    for up in [Up::PlusY, Up::PlusZ] {
        for degrees in [0.0f64, 90.0, 180.0, 270.0] {
            let map = turned(up) * DAffine3::from_mat3(DMat3::from_rotation_y(degrees.to_radians()));
            // One figure stands, one is in mid-step.
            for raised in [0.0, 0.1] {
                let view = best_view(&[figure(raised).object(map, 20_000)], up);
                assert!(off(view, up, map.transform_vector3(DVec3::X)) <= 60.5, "{up}, {degrees}, {raised}: {view}");
            }
        }
    }
    // Two runners aren't feet: their direction has no influence.
    let runner = |shape: Shape, z: f64| {
        let shape = shape.block([-0.1, 0.0, z - 0.05], [0.8, 0.04, z + 0.05]);
        shape.block([-0.1, 0.04, z - 0.05], [0.0, 1.0, z + 0.05])
    };
    let bench = runner(runner(Shape::default(), -0.5), 0.5).block([-0.1, 0.9, -0.5], [0.8, 1.0, 0.5]);
    for degrees in [90.0f64, -90.0] {
        let map = DAffine3::from_rotation_y(degrees.to_radians());
        let view = best_view(&[bench.object(map, 20_000)], Up::PlusY);
        assert!(off(view, Up::PlusY, DVec3::Z) <= 60.5, "{degrees}: {view}");
    }
}

#[test]
fn gaussians_show_their_colourful_side_whichever_way_they_face() {
    // A ball that is grey except where it faces −x; the axes of all Gaussians face −z.
    let most = 4000u32;
    let at = |i: u32| {
        let height = 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(most);
        let (sin, cos) = (2.4 * f64::from(i)).sin_cos();
        DVec3::new(cos, 0.0, sin) * (1.0 - height * height).sqrt() + DVec3::Y * height
    };
    let axis = |i: u32| (at(i) * -at(i).z.signum()).as_vec3();
    let color = |i: u32| [0, 1, 2].map(|c| if at(i).x < 0.0 { f32::from(u8::from(i * 7 % 11 > 3 * c)) } else { 0.0 });
    let view = |color: &dyn Fn(u32) -> [f32; 3]| {
        let data = GaussianData {
            origin: DVec3::ZERO,
            centers: Column3::from_f32((0..most).map(|i| at(i).as_vec3()).collect()),
            kind: GaussianKind::Flat,
            sigmas: vec![[0.02, 0.02, 0.0]; most as usize],
            rotations: (0..most).map(|i| Quat::from_rotation_arc(Vec3::Z, axis(i)).to_array()).collect(),
            opacities: vec![0.9; most as usize],
            degree: 0,
            harmonics: (0..most).map(color).collect(),
            linear_colors: false,
            up: None,
        };
        let cloud = GaussianCloud::new(data, OnInvalid::Refuse).unwrap().0;
        let (geometry, world_from_object) = (Geometry::Gaussians(Arc::new(cloud)), DAffine3::IDENTITY);
        best_view(&[Object { geometry, world_from_object, material: Material::default() }], Up::PlusY)
    };
    assert_eq!(view(&|_| [0.0; 3]), ViewAngles::ISO);
    assert!(off(view(&color), Up::PlusY, DVec3::NEG_X) <= 60.5);
}

#[test]
fn open_surfaces_show_the_side_that_they_face() {
    // Half a sphere whose inside faces the default view, and a relief that faces −z.
    let shell = Shape::default().grid([48, 48], |u, v| {
        let ((sin, cos), polar) = ((std::f64::consts::PI * u).sin_cos(), std::f64::consts::PI * (v - 0.5));
        DVec3::new(cos * polar.cos(), polar.sin(), -sin * polar.cos())
    });
    let objects = [shell.object(DAffine3::IDENTITY, 8000)];
    let view = best_view(&objects, Up::PlusY);
    assert!(off(view, Up::PlusY, DVec3::NEG_Z) <= 60.5, "{view}");
}

#[test]
fn fish_lie_along_their_length() {
    // A fish tapers at both ends, with a fin on its back and a tail. Its length is along y in the first map, along z in
    // the second.
    let fin = |shape: Shape, lo: [f64; 3], hi: [f64; 3]| shape.block(lo, hi);
    let fish = Shape::default().ball([0.0; 3], [0.22, 0.3, 1.0]);
    let fish = fin(fin(fish, [-0.02, 0.2, -0.2], [0.02, 0.75, 0.2]), [-0.02, -0.2, 0.95], [0.02, 0.7, 1.2]);
    let (along_y, along_z) = (DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y), DMat3::IDENTITY);
    let found = |map: DMat3, usual| upright(&[fish.object(DAffine3::from_mat3(map), 8000)], usual);
    assert_eq!(found(along_y, MESHES).up, Up::PlusZ);
    assert_eq!(found(along_z, POINTS).up, Up::PlusY);
    assert_eq!(found(along_z, POINTS).reason, UpReason::Lying);
    assert_eq!((found(along_z, STL).up, found(along_z, STL).reason), (Up::PlusY, UpReason::Lying));
}

#[test]
fn posts_stand() {
    // A thin post with an arm and a crossbar, as thick below as above. It has no base, but one clear mirror plane.
    let post = Shape::default()
        .block([-0.05, 0.0, -0.05], [0.05, 6.0, 0.05])
        .block([-1.2, 3.9, -0.1], [0.0, 4.1, 0.1])
        .block([-0.01, 4.6, -0.5], [0.01, 4.7, 0.5]);
    for (up, usual) in [(Up::PlusY, MESHES), (Up::PlusZ, POINTS), (Up::PlusZ, STL)] {
        let found = upright(&[post.object(turned(up), 8000)], usual);
        assert_eq!(found.up, up, "{usual:?}: {}", found.reason);
    }
}

#[test]
fn stl_stands_as_printers_have_it() {
    let rocket = Shape::default()
        .ball([0.0, 1.5, 0.0], [0.2, 1.5, 0.2])
        .block([-0.6, 0.1, -0.02], [0.6, 0.7, 0.02])
        .block([-0.02, 0.1, -0.6], [0.02, 0.7, 0.6]);
    let ball = Shape::default().ball([0.0; 3], [1.0; 3]);
    for (name, shape) in [("rocket", rocket), ("figure", Shape::figure()), ("ball", ball)] {
        let found = upright(&[shape.object(turned(Up::PlusZ), 8000)], STL);
        assert_eq!(found.up, Up::PlusZ, "{name}: {}", found.reason);
    }
    // Models from games are y-up in STL, too.
    assert_eq!(upright(&[Shape::table().object(turned(Up::PlusY), 8000)], STL).up, Up::PlusY);
}

#[test]
fn plates_lie_in_stl_and_hang_elsewhere() {
    let plate = |[x, y, z]: [f64; 3]| [Shape::default().block([0.0; 3], [x, y, z]).object(DAffine3::IDENTITY, 8000)];
    let found = upright(&plate([1.0, 0.02, 1.0]), STL);
    assert_eq!((found.up, found.reason), (Up::PlusY, UpReason::Lying));
    assert_eq!(upright(&plate([1.0, 1.0, 0.02]), STL).up, Up::PlusZ);
    // A wall stands, and so does a picture in a frame.
    assert_eq!(upright(&plate([1.0, 0.15, 1.0]), STL).up, Up::PlusZ);
    assert_eq!(upright(&plate([1.0, 1.0, 0.02]), MESHES).up, Up::PlusY);
}

/// Returns the cloud with every centre moved by up to a thousandth of the diagonal along each axis.
fn shaken(cloud: &SplatCloud, seed: u32) -> SplatCloud {
    let (lo, hi) = cloud.bounds().unwrap();
    let reach = 0.002 * (hi - lo).length() as f32;
    let mut state = seed.wrapping_mul(0x9e37_79b9) | 1;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        ((state >> 8) as f32 / (1u32 << 24) as f32 - 0.5) * reach
    };
    let mut data = cloud.clone().into_data();
    let moved = data.centers.high().iter().map(|p| *p + Vec3::new(random(), random(), random()));
    data.centers = Column3::from_f32(moved.collect());
    SplatCloud::new(data, OnInvalid::Refuse).unwrap().0
}

#[test]
fn small_changes_change_neither() {
    let of = |shape: Shape| shape.object(turned(Up::PlusZ), 12_000);
    for original in [of(Shape::table()), of(Shape::bust()), spot()] {
        let Geometry::Splats(cloud) = &original.geometry else { panic!("made of splats") };
        let (up, view) = {
            let objects = [original.clone()];
            let found = upright(&objects, MESHES);
            (found, best_view(&objects, found.up))
        };
        for seed in 0..4 {
            let objects = [object(shaken(cloud, seed))];
            assert_eq!(upright(&objects, MESHES), up);
            assert_eq!(best_view(&objects, up.up), view, "seed {seed}");
        }
    }
}

/// Writes a file for a test, and returns its path.
fn written(name: &str, text: &str) -> std::path::PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn depth_images_are_seen_from_their_camera() {
    // A wall with a box before it, in the coordinates of a camera with 60 px focal length: right, down and forward.
    let pixel = |i: usize| {
        let (column, row) = ((i % 64) as f64, (i / 64) as f64);
        let depth = if (20.0..40.0).contains(&column) && row > 20.0 { 1.2 } else { 2.0 };
        if i.is_multiple_of(11) {
            DVec3::NAN
        } else {
            DVec3::new((column - 31.5) / 60.0, (row - 23.5) / 60.0, 1.0) * depth
        }
    };
    let points: Vec<DVec3> = (0..64 * 48).map(pixel).collect();
    let loaded = |name: &str, size: [usize; 2], viewpoint: &str, points: &[DVec3]| {
        let [columns, rows] = size;
        let mut text = format!(
            "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {columns}\nHEIGHT {rows}\n\
             VIEWPOINT {viewpoint}\nPOINTS {}\nDATA ascii\n",
            points.len()
        );
        points.iter().for_each(|p| text.push_str(&format!("{} {} {}\n", p.x, p.y, p.z)));
        surfel_load::load(&written(name, &text), &LoadOptions::default(), &NoProgress).unwrap()
    };
    let view = |cloud: SplatCloud, up: Up| best_view(&[object(cloud)], up);
    let identity = "0 0 0 1 0 0 0";
    let level = ViewAngles { azimuth_deg: 0.0, elevation_deg: 0.0 };
    let image = loaded("image.pcd", [64, 48], identity, &points);
    assert_eq!((image.up, image.up_reason), (Up::MinusY, Some(UpReason::Stated)));
    assert!((0..image.cloud.len()).all(|i| image.cloud.normal(i).dot(image.cloud.center(i)) < 0.0));
    assert_eq!(view(image.cloud, image.up), level);
    // The same points in OpenGL's axes.
    let back: Vec<_> = points.iter().map(|p| DVec3::new(p.x, -p.y, -p.z)).collect();
    let opengl = loaded("opengl.pcd", [64, 48], identity, &back);
    assert_eq!((opengl.up, opengl.up_reason), (Up::PlusY, Some(UpReason::Stated)));
    assert!((0..opengl.cloud.len()).all(|i| opengl.cloud.normal(i).dot(opengl.cloud.center(i)) < 0.0));
    assert_eq!(view(opengl.cloud, opengl.up), level);
    // Points alone don't reveal a camera, but a sensor's pose does, here upside down.
    let alone = loaded("alone.pcd", [64 * 48, 1], identity, &points);
    assert_eq!(alone.up_reason, None);
    let turned = loaded("turned.pcd", [64 * 48, 1], "0 0 0 0 1 0 0", &points);
    assert_eq!((turned.up, turned.up_reason), (Up::MinusY, Some(UpReason::Stated)));
    assert_eq!(view(turned.cloud, turned.up), level);
    // An invalid pose is ignored.
    let broken = loaded("broken.pcd", [64 * 48, 1], "0 nan 0 0 1 0 0", &points);
    assert_eq!(broken.up_reason, None);
}

/// Returns what a depth camera at the origin sees of a floor, a wall and a ball: x to the right, y down, z ahead.
fn seen_by_camera() -> Vec<DVec3> {
    let (center, radius) = (DVec3::new(0.15, 0.2, 1.5), 0.35);
    let depth = |ray: DVec3| {
        let along = ray.dot(center) / ray.length_squared();
        let half = (radius * radius - (ray * along - center).length_squared()).max(-1.0) / ray.length_squared();
        let ball = if half > 0.0 { along - half.sqrt() } else { f64::INFINITY };
        let floor = if ray.y > 0.0 { 0.55 / ray.y } else { f64::INFINITY };
        ball.min(floor).min(2.2)
    };
    let ray = |i: usize| DVec3::new((i % 80) as f64 / 80.0 - 0.5, 0.75 * ((i / 80) as f64 / 60.0 - 0.5), 1.0);
    (0..80 * 60).map(ray).map(|ray| ray * depth(ray)).collect()
}

#[test]
fn points_that_a_camera_at_the_origin_sees_have_its_axes() {
    let found = |name: &str, points: &[DVec3]| {
        let text: String = points.iter().map(|p| format!("{} {} {}\n", p.x, p.y, p.z)).collect();
        let loaded = surfel_load::load(&written(name, &text), &LoadOptions::default(), &NoProgress).unwrap();
        let objects = [object(loaded.cloud)];
        let up = upright(&objects, POINTS);
        (up, best_view(&objects, up.up))
    };
    let level = ViewAngles { azimuth_deg: 0.0, elevation_deg: 0.0 };
    let seen = seen_by_camera();
    let camera = Upright { up: Up::MinusY, reason: UpReason::Camera };
    assert_eq!(found("camera.txt", &seen), (camera, level));
    // With y up, the wall is also seen to stand on the floor.
    let opengl: Vec<DVec3> = seen.iter().map(|p| *p * DVec3::new(1.0, -1.0, -1.0)).collect();
    let (up, view) = found("opengl.txt", &opengl);
    assert_eq!((up.up, view), (Up::PlusY, level));
    // A whole ball has two surfaces in each direction.
    let ball: Vec<DVec3> = Shape::default().ball([0.0, 0.0, 3.0], [1.0, 1.0, 1.0]).positions;
    // Terrain whose heights are above sea level.
    let hills = Shape::hills().positions.into_iter().map(|p| DVec3::new(50.0 * p.x, -50.0 * p.z, 300.0 + 50.0 * p.y));
    let terrain: Vec<DVec3> = hills.collect();
    // Too few points to tell a closed shape from its front.
    let few: Vec<DVec3> = ball.iter().step_by(8).copied().collect();
    for (name, points) in [("whole_ball.txt", ball), ("few.txt", few), ("terrain.txt", terrain)] {
        assert_ne!(found(name, &points).0.reason, UpReason::Camera, "{name}");
    }
}

#[test]
fn one_stray_point_hides_no_camera() {
    let mut points = seen_by_camera();
    points.push(DVec3::new(0.0, 0.1, -0.2));
    let cloud = PointCloud { positions: Column3::from_f64(&points), ..PointCloud::default() };
    let found = |cloud: &PointCloud| {
        upright(&[object(splats_from_points(cloud, &PointOptions::default(), &NoProgress).unwrap().0)], POINTS)
    };
    assert_eq!(found(&cloud), Upright { up: Up::MinusY, reason: UpReason::Camera });
    // With a tenth elsewhere it is no depth image.
    let elsewhere =
        (0..points.len() / 10).map(|i| DVec3::new((i as f64 * 0.618).fract(), 0.1, -0.2 - i as f64 / 500.0));
    let cloud = PointCloud {
        positions: Column3::from_f64(&points.iter().copied().chain(elsewhere).collect::<Vec<_>>()),
        ..PointCloud::default()
    };
    assert_ne!(found(&cloud).reason, UpReason::Camera);
}

#[test]
fn walls_whose_stored_normals_face_a_camera_stand() {
    // A bent wall beside the origin, as fragments of several depth images are: y down, z ahead.
    let wall = |up: Up, normals: bool| {
        let place = |i: usize| DVec3::new((i % 90) as f64 / 90.0, (i / 90) as f64 / 60.0, 0.0);
        let bent = |p: DVec3| DVec3::new(2.0 + p.x, 2.0 + p.y, 1.0 + 0.6 * (p.x - 0.5).abs());
        let normal = |p: DVec3| DVec3::new(0.6 * (p.x - 0.5).signum(), 0.0, -1.0).normalize();
        let map = if up == Up::PlusY { DVec3::new(1.0, -1.0, -1.0) } else { DVec3::ONE };
        let column =
            |of: &dyn Fn(DVec3) -> DVec3| Column3::from_f64(&(0..5400).map(|i| of(place(i)) * map).collect::<Vec<_>>());
        let positions = column(&bent);
        let normals = normals.then(|| column(&normal));
        let cloud = PointCloud { positions, normals, ..PointCloud::default() };
        upright(&[object(splats_from_points(&cloud, &PointOptions::default(), &NoProgress).unwrap().0)], POINTS)
    };
    assert_eq!(wall(Up::MinusY, true), Upright { up: Up::MinusY, reason: UpReason::Camera });
    assert_ne!(wall(Up::MinusY, false).reason, UpReason::Camera);
    // Facing +z it may be ground.
    assert_ne!(wall(Up::PlusY, true).reason, UpReason::Camera);
}

#[test]
fn wires_over_a_street_dont_make_it_a_mirror_image() {
    // A street 40 long with bumps, and a wire far above it: the street is its own image upside down.
    let street = (0..6000).map(|i| {
        let (x, y) = ((i % 100) as f64 * 0.4, (i / 100) as f64 * 0.4);
        DVec3::new(x, y + 3.0 * (0.1 * x).sin() - 0.3 * x, 0.2 * (x * y).sin())
    });
    let wire = (0..80).map(|i| DVec3::new(f64::from(i) * 0.5, f64::from(i) * 0.2, 19.0));
    let cloud =
        PointCloud { positions: Column3::from_f64(&street.chain(wire).collect::<Vec<_>>()), ..PointCloud::default() };
    let cloud = splats_from_points(&cloud, &PointOptions::default(), &NoProgress).unwrap().0;
    assert_eq!(upright(&[object(cloud)], POINTS).up, Up::PlusZ);
}

/// Returns a ball of 2000 trained Gaussians, `needles` of which are needles with the standard deviation `length`.
fn ball_with_needles(needles: usize, length: f32) -> Scene {
    let most = 2000;
    let at = |i: usize| {
        let height = 1.0 - 2.0 * (i as f64 + 0.5) / most as f64;
        let (sin, cos) = (2.4 * i as f64).sin_cos();
        (DVec3::new(cos, 0.0, sin) * (1.0 - height * height).sqrt() + DVec3::Y * height).as_vec3()
    };
    let is_needle = |i: usize| i * needles / most != (i + 1) * needles / most;
    let data = GaussianData {
        origin: DVec3::ZERO,
        centers: Column3::from_f32((0..most).map(at).collect()),
        kind: GaussianKind::Flat,
        sigmas: (0..most).map(|i| [if is_needle(i) { length } else { 0.02 }, 0.02, 0.0]).collect(),
        rotations: vec![[0.0, 0.0, 0.0, 1.0]; most],
        opacities: vec![0.9; most],
        degree: 0,
        harmonics: vec![[0.5; 3]; most],
        linear_colors: false,
        up: None,
    };
    let cloud = GaussianCloud::new(data, OnInvalid::Refuse).unwrap().0;
    let geometry = Geometry::Gaussians(Arc::new(cloud));
    let ball = Object { geometry, world_from_object: DAffine3::IDENTITY, material: Material::default() };
    Scene { objects: vec![ball], ..Scene::default() }
}

#[test]
fn a_few_needles_dont_make_gaussians_small() {
    let axes = ViewAxes::turned(ViewAngles::ISO, Up::PlusY);
    let projection = FrameProjection::Perspective(40.0);
    let options = FrameOptions { axes, projection, size: [512, 512], fill: 0.9, turning: None };
    let away = |needles: usize| {
        let camera = frame_camera(&ball_with_needles(needles, 8.0), &options).unwrap();
        (DVec3::from(camera.eye) - DVec3::from(camera.target)).length()
    };
    assert!((away(30) / away(0) - 1.0).abs() < 0.02, "{} {}", away(30), away(0));
    assert!(away(200) > 3.0 * away(0), "long ones that are many are a part of the scene");
}

#[test]
fn meshes_that_are_wound_inside_out_are_turned_around() {
    let ball = Shape::default().ball([0.0; 3], [1.0; 3]);
    let of = |name: &str, turned: bool| {
        let mut text: String = ball.positions.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z)).collect();
        for [a, b, c] in &ball.triangles {
            let [b, c] = if turned { [c, b] } else { [b, c] };
            text.push_str(&format!("f {} {} {}\n", a + 1, b + 1, c + 1));
        }
        surfel_load::load(&written(name, &text), &LoadOptions::default(), &NoProgress).unwrap()
    };
    let says = |notes: &[String]| notes.iter().any(|note| note.contains("inside out"));
    for (name, turned) in [("ball.obj", false), ("inside_out.obj", true)] {
        let loaded = of(name, turned);
        assert_eq!(says(&loaded.notes), turned, "{:?}", loaded.notes);
        assert!((0..loaded.cloud.len()).all(|i| loaded.cloud.normal(i).dot(loaded.cloud.center(i)) > 0.0), "{name}");
    }
}
