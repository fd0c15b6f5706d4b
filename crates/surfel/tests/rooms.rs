//! Views of rooms and of equal things: rooms are viewed through their open side, and equal things as one of them would
//! be.

use std::path::Path;
use std::sync::Arc;
use surfel_framing::{UpConvention, ViewAngles, ViewAxes, ViewReason, best_view, choose_view, upright};
use surfel_load::LoadOptions;
use surfel_model::glam::{DAffine3, DMat3, DQuat, DVec3};
use surfel_model::{Column3, ConvertOptions, Geometry, Material, Mesh, Object, PointCloud, SplatCount, Up};
use surfel_sample::NoProgress;
use surfel_sample::{MeshMethod, MeshOptions, PointOptions, splats_from_mesh, splats_from_points};

/// Rectangles in y-up coordinates.
#[derive(Clone, Default)]
struct Faces(Vec<[DVec3; 4]>);

impl Faces {
    /// Adds a rectangle that faces `(b − a) × (c − a)`.
    fn face(mut self, a: DVec3, b: DVec3, c: DVec3) -> Self {
        self.0.push([a, b, b + c - a, c]);
        self
    }

    /// Adds the six sides of a block, facing outward or inward, except the sides that face one of `without`.
    fn block(self, lo: [f64; 3], hi: [f64; 3], inward: bool, without: &[DVec3]) -> Self {
        let (lo, hi) = (DVec3::from(lo), DVec3::from(hi));
        let (mut all, size) = (self, hi - lo);
        for k in 0..3 {
            for sign in [-1.0, 1.0] {
                let outward = DVec3::AXES[k] * sign;
                if without.contains(&outward) {
                    continue;
                }
                let (u, v) = (DVec3::AXES[(k + 1) % 3] * size, DVec3::AXES[(k + 2) % 3] * size);
                let at = if sign > 0.0 { lo + DVec3::AXES[k] * size } else { lo };
                all = if (sign > 0.0) != inward { all.face(at, at + u, at + v) } else { all.face(at, at + v, at + u) };
            }
        }
        all
    }

    fn mapped(&self, map: DAffine3) -> Self {
        Self(self.0.iter().map(|corners| corners.map(|p| map.transform_point3(p))).collect())
    }

    fn with(mut self, other: Self) -> Self {
        self.0.extend(other.0);
        self
    }

    fn object(&self, splats: usize) -> Object {
        let positions: Vec<DVec3> = self.0.iter().flatten().copied().collect();
        let triangles = (0..self.0.len() as u32).flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|c| c + 4 * i)));
        let mesh = Mesh { positions: Column3::from_f64(&positions), triangles: triangles.collect(), ..Mesh::default() };
        let options = MeshOptions { method: MeshMethod::Count(splats), ..MeshOptions::auto(&mesh) };
        object(splats_from_mesh(&mesh, &options, &NoProgress).unwrap().0)
    }
}

fn object(cloud: surfel_model::SplatCloud) -> Object {
    let geometry = Geometry::Splats(Arc::new(cloud));
    Object { geometry, world_from_object: DAffine3::IDENTITY, material: Material::default() }
}

/// Returns the rotation of y-up coordinates that makes another axis up.
fn turned(up: Up) -> DAffine3 {
    if up == Up::PlusZ { DAffine3::from_rotation_x(std::f64::consts::FRAC_PI_2) } else { DAffine3::IDENTITY }
}

/// Returns the angle between a view and the direction straight into an opening, in degrees about the up axis.
fn off(view: ViewAngles, up: Up, opening: DVec3) -> f64 {
    let level = ViewAxes::turned(ViewAngles { elevation_deg: 0.0, ..view }, up).forward;
    level.angle_between(-opening).to_degrees()
}

/// Returns a room of walls that face inward, without the wall on the open side, and a block inside.
fn room(size: [f64; 3], open: DVec3) -> Faces {
    let [x, y, z] = size;
    let walls = Faces::default().block([0.0; 3], size, true, &[open]);
    walls.block([0.4 * x, 0.0, 0.4 * z], [0.6 * x, 0.3 * y, 0.6 * z], false, &[])
}

#[test]
fn rooms_that_open_to_one_side_are_looked_into() {
    let sides = [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z];
    for size in [[1.0, 1.0, 1.0], [4.0, 2.5, 3.0], [1.0, 0.5, 2.0]] {
        for (up, open) in [Up::PlusY, Up::PlusZ].into_iter().flat_map(|up| sides.map(|open| (up, open))) {
            let objects = [room(size, open).mapped(turned(up)).object(8000)];
            let view = choose_view(&objects, up);
            let opening = turned(up).transform_vector3(open);
            assert!(off(view.angles, up, opening) < 31.0, "{size:?} {up} {open}: {view:?}");
            assert_eq!(view.reason, ViewReason::Opening, "{size:?} {up} {open}: {view:?}");
        }
    }
    // Rooms open at the top, like doll's houses, are viewed from above.
    let objects = [room([3.0, 2.0, 3.0], DVec3::Y).object(8000)];
    assert_eq!(best_view(&objects, Up::PlusY).elevation_deg, 40.0);
    // The file in which this case occurred.
    let faces = "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 2 4 8 6\nf 10 12 11 9\nf 15 16 14 13\nf 13 14 10 9\n\
                 f 12 16 15 11\nf 11 15 13 9\nf 14 16 12 10\n";
    let mut text = String::new();
    for (lo, hi) in [([0.0; 3], [1.0; 3]), ([0.4, 0.0, 0.4], [0.6, 0.3, 0.6])] {
        for i in 0..8 {
            let at = |k: usize| if i >> (2 - k) & 1 == 0 { lo[k] } else { hi[k] };
            text += &format!("v {} {} {}\n", at(0), at(1), at(2));
        }
    }
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("room.obj");
    std::fs::write(&path, text + faces).unwrap();
    let convert = ConvertOptions { splats: Some(SplatCount::Count(8000)), ..ConvertOptions::default() };
    let options = LoadOptions::default().with_convert(&convert, Path::new(""));
    let loaded = surfel_load::load(&path, &options, &NoProgress).unwrap();
    let view = best_view(&[object(loaded.cloud)], Up::PlusY);
    assert!(off(view, Up::PlusY, DVec3::NEG_Z) < 31.0, "{view}");
}

#[test]
fn closed_rooms_and_bodies_inside_out_are_seen_from_outside() {
    // The facing direction is meaningless if all faces point away from every view.
    for shape in [
        Faces::default().block([0.0; 3], [1.0, 1.0, 1.0], true, &[]),
        Faces::default().block([0.0; 3], [1.0, 0.8, 1.2], true, &[DVec3::NEG_Y]),
    ] {
        let view = choose_view(&[shape.object(6000)], Up::PlusY);
        assert_eq!((view.angles.elevation_deg, view.reason), (20.0, ViewReason::Details), "{view:?}");
    }
}

/// Returns a chair with its backrest at −z.
fn chair() -> Faces {
    let leg =
        |faces: Faces, x: f64, z: f64| faces.block([x - 0.03, 0.0, z - 0.03], [x + 0.03, 0.5, z + 0.03], false, &[]);
    let legs = [(-0.22, -0.22), (0.22, -0.22), (-0.22, 0.22), (0.22, 0.22)];
    let chair = legs.into_iter().fold(Faces::default(), |faces, (x, z)| leg(faces, x, z));
    let chair = chair.block([-0.26, 0.5, -0.26], [0.26, 0.55, 0.26], false, &[]);
    chair.block([-0.26, 0.55, -0.26], [0.26, 1.1, -0.22], false, &[])
}

#[test]
fn equal_things_side_by_side_are_seen_from_where_each_would_be() {
    for up in [Up::PlusY, Up::PlusZ] {
        for turn in [0.0, 90.0_f64] {
            let map = turned(up) * DAffine3::from_rotation_y(turn.to_radians());
            let one = chair().mapped(map);
            let alone = best_view(&[one.object(6000)], up);
            let front = map.transform_vector3(DVec3::Z);
            assert!(off(alone, up, front) <= 60.5, "{up} {turn}: {alone}");
            let across = front.cross(up.vector());
            // Two in one file, beside and behind each other, four, and several files.
            let moved = |by: DVec3| one.mapped(DAffine3::from_translation(by));
            let row = [1, 2, 3].iter().fold(one.clone(), |row, i| row.with(moved(across * 0.8 * f64::from(*i))));
            let square = one.clone().with(moved(across)).with(moved(front)).with(moved(across + front));
            let of = |faces: &Faces| [faces.object(12_000)];
            for (name, view) in [
                ("two", choose_view(&of(&one.clone().with(moved(across * 0.8))), up)),
                ("behind", choose_view(&of(&one.clone().with(moved(front * 1.5))), up)),
                ("four", choose_view(&of(&row), up)),
                ("square", choose_view(&of(&square), up)),
                ("files", choose_view(&[one.object(6000), moved(across * 0.9).object(6000)], up)),
                ("three", choose_view(&[0.0, 0.9, 1.8].map(|by| moved(across * by).object(6000)), up)),
            ] {
                // A chair looks the same from the left and from the right.
                let offs = [view.angles, alone].map(|view| off(view, up, front));
                assert!((offs[0] - offs[1]).abs() < 0.5, "{up} {turn} {name}: {view:?}, alone {alone}");
                assert_eq!(view.angles.elevation_deg, alone.elevation_deg, "{up} {turn} {name}: {view:?}");
            }
            for convention in [UpConvention::Meshes, UpConvention::Points] {
                let found = upright(&of(&one.clone().with(moved(across * 0.8))), convention);
                assert_eq!(found, upright(&of(&one), convention), "{up} {turn}");
            }
        }
    }
}

/// Returns a grid whose stored normals are tilted by `degrees`.
fn leaning(axes: DMat3, degrees: f64) -> Object {
    let place = |i: i32| axes * DVec3::new(f64::from(i / 30) * 0.1, f64::from(i % 30) * 0.1, 0.0);
    let normal = axes * (DQuat::from_rotation_x(degrees.to_radians()) * DVec3::Z);
    let cloud = PointCloud {
        positions: Column3::from_f64(&(0..900).map(place).collect::<Vec<_>>()),
        normals: Some(Column3::from_f64(&[normal; 900])),
        ..PointCloud::default()
    };
    object(splats_from_points(&cloud, &PointOptions::default(), &NoProgress).unwrap().0)
}

#[test]
fn normals_off_the_layout_decide_no_up_axis() {
    // A wall along x, whose normals are tilted so far that they face along y.
    let wall = DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y);
    for (axes, degrees) in [(DMat3::IDENTITY, 30.0), (wall, 60.0), (wall, 85.0), (DMat3::IDENTITY, 85.0)] {
        let found = upright(&[leaning(axes, degrees)], UpConvention::Points);
        assert_ne!(found.reason, surfel_framing::UpReason::Floor, "{degrees}: {found:?}");
    }
    // Normals that fit the layout decide.
    let found = upright(&[leaning(DMat3::IDENTITY, 5.0)], UpConvention::Points);
    assert_eq!((found.up, found.reason), (Up::PlusZ, surfel_framing::UpReason::Floor));
}
