//! `.surfel` files: round trips, and refusal of damaged files.

use glam::{DVec3, Vec3};
use std::path::Path;
use std::sync::Arc;
use surfel_io::{Content, LoadOptions, load_bytes, write_octree};
use surfel_model::{
    CloudData, Column3, Mesh, Octree, OctreeNode, OnInvalid, Shape, SplatCloud, Texture, Transition, Up,
};

/// Returns an octree of two triangles in two leaves, with every possible column.
fn octree() -> Octree {
    let v = |x: f32, y: f32| Vec3::new(x, y, 0.25);
    let mesh = Mesh {
        origin: DVec3::new(1e6, 2.0, 3.0),
        positions: Column3::from_f64(
            &[v(0.0, 0.0), v(1.0, 0.0), v(0.0, 1.0), v(1.0, 1.0)].map(|p| p.as_dvec3() + 1e-9),
        ),
        triangles: vec![[0, 1, 2], [1, 3, 2]],
        normals: Some(vec![[0.0, 0.0, 1.0]; 4]),
        colors: Some((0..4).map(|i| [0.1 * i as f32, 0.5, 0.9]).collect()),
        alphas: Some(vec![1.0, 0.5, 0.25, 0.0]),
        uvs: Some(vec![[0.0, 1.0], [1.0, 1.0], [0.0, 0.0], [1.0, 0.0]]),
        texture: Some(Arc::new(Texture { width: 2, height: 1, srgba8: vec![[1, 2, 3, 4], [250, 128, 0, 255]] })),
        materials: None,
        up: Some(Up::PlusZ),
        ..Mesh::default()
    };
    let centers: Vec<Vec3> = (0..5).map(|i| v(0.2 * i as f32, 0.3)).collect();
    let shape = Shape::Disks { normals: Column3::from_f32(vec![Vec3::Z; 5]), radii: vec![0.4, 0.2, 0.2, 0.2, 0.1] };
    let mut data = CloudData::new(mesh.origin, Column3::from_f32(centers), shape);
    data.interior_weight = Some(2.5);
    data.up = Some(Up::PlusZ);
    let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
    let node = |children, splats, triangles| OctreeNode {
        center: [0.5, 0.5, 0.25],
        radius: 1.5,
        splat_radius: 0.4,
        cone_axis: [0.0, 0.0, 1.0],
        cone_cosine: 0.9,
        children,
        splats,
        triangles,
    };
    let nodes = vec![node(1..3, 0..1, 0..2), node(0..0, 1..2, 0..1), node(0..0, 2..4, 1..2)];
    Octree::new(cloud, mesh, nodes, vec![Transition { leaves: [1, 2], splats: 4..5 }]).unwrap()
}

fn bytes() -> Vec<u8> {
    let mut bytes = Vec::new();
    write_octree(&mut bytes, &octree()).unwrap();
    bytes
}

fn load(bytes: &[u8]) -> Result<Content, String> {
    let loaded = load_bytes(bytes, None, Path::new("t.surfel"), &LoadOptions::default());
    loaded.map(|l| l.content).map_err(|e| e.to_string())
}

#[test]
fn octree_survives_a_round_trip() {
    let Content::Octree(read) = load(&bytes()).unwrap() else { panic!("not an octree") };
    let written = octree();
    assert_eq!((read.nodes(), read.transitions()), (written.nodes(), written.transitions()));
    assert_eq!(read.mesh(), written.mesh());
    assert_eq!(read.cloud().data().shape, written.cloud().data().shape);
    assert_eq!(read.cloud().data().interior_weight, Some(2.5));
    assert!((0..5).all(|i| (read.cloud().center(i) - written.cloud().center(i)).length() < 1e-9));
}

#[test]
fn octree_sections_of_the_future_are_skipped_and_missing_ones_named() {
    let mut more = bytes();
    more[12] += 1;
    more.extend(b"NEWS\x03\0\0\0\0\0\0\0abc");
    assert!(load(&more).is_ok());
    let mut fewer = bytes();
    fewer[12] -= 1;
    assert!(load(&fewer).unwrap_err().contains("EDGE"));
    let mut other = bytes();
    other[8] = 2;
    assert!(load(&other).unwrap_err().contains("version 2"));
}

/// Any truncation, and any changed byte, gives an error or a valid tree.
#[test]
fn octree_damaged_is_refused_or_valid_never_more() {
    let whole = bytes();
    for length in 0..whole.len() {
        assert!(load(&whole[..length]).is_err(), "{length}");
    }
    for at in 8..whole.len() {
        for change in [1u8, 0x80, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] ^= change;
            match load(&bytes) {
                Ok(Content::Octree(read)) => {
                    // A tree that passed validation can be cut at any level.
                    let all: Vec<_> = read.nodes().iter().map(|n| n.splats.clone()).collect();
                    assert!(read.cloud_of(&all).is_ok());
                }
                Ok(other) => panic!("{other:?}"),
                Err(text) => assert!(text.lines().count() <= 4, "{text}"),
            }
        }
    }
}
