//! Tests that splats of meshes leave no holes and hardly reach over creases.

use crate::common;

use common::{Lcg, coverage, keeps};
use glam::{DVec3, Vec3};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use surfel_model::{Column3, Mesh, Shape, SplatCloud, Texture};
use surfel_sample::{
    FINE_SPLATS, FLAT_PARTS, MeshMethod, MeshOptions, NoProgress, SampleError, points_from_mesh, splats_from_mesh,
};

fn mesh(positions: &[DVec3], triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh { positions: Column3::from_f64(positions), triangles, ..Mesh::default() }
}

fn cube() -> Mesh {
    let positions: Vec<DVec3> =
        (0..8).map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2))).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    mesh(&positions, quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect())
}

/// Returns a sphere of unit radius with vertices at `rows` + 1 latitudes, including the poles.
fn globe(rows: u32) -> Mesh {
    let (columns, mut positions, mut triangles) = (2 * rows, Vec::new(), Vec::new());
    for j in 0..=rows {
        for i in 0..columns {
            let (a, b) = (TAU * f64::from(i) / f64::from(columns), PI * f64::from(j) / f64::from(rows));
            // Exactly one position per pole.
            let r = if j % rows == 0 { 0.0 } else { b.sin() };
            positions.push(DVec3::new(r * a.cos(), r * a.sin(), b.cos()));
            if j < rows {
                let (p, q) = (j * columns + i, j * columns + (i + 1) % columns);
                triangles.extend([[p, p + columns, q], [q, p + columns, q + columns]]);
            }
        }
    }
    mesh(&positions, triangles)
}

/// Returns points that are uniformly distributed over a mesh, with the normals of their faces.
fn places(mesh: &Mesh, count: usize) -> Vec<(DVec3, DVec3)> {
    let mut random = Lcg(77);
    let corners = |t: &[u32; 3]| t.map(|i| mesh.positions.get(i as usize));
    let areas: Vec<f64> = mesh.triangles.iter().map(corners).map(|[a, b, c]| (b - a).cross(c - a).length()).collect();
    let most = areas.iter().fold(0.0, |m: f64, a| m.max(*a));
    let mut all = Vec::new();
    while all.len() < count {
        let i = (random.unit() * areas.len() as f64) as usize;
        if random.unit() * most > areas[i] {
            continue;
        }
        let [a, b, c] = corners(&mesh.triangles[i]);
        let (mut u, mut v) = (random.unit(), random.unit());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        all.push((a + (b - a) * u + (c - a) * v, (b - a).cross(c - a).normalize()));
    }
    all
}

/// Returns points all over the visible part of a splat's disk.
fn kept(cloud: &SplatCloud, i: usize) -> impl Iterator<Item = DVec3> {
    let ((s, t), p) = (cloud.axes(i), cloud.center(i));
    let at = |k: u32| {
        let (radius, angle) = (f64::from(k / 40 + 1) / 10.0, TAU * f64::from(k % 40) / 40.0);
        (radius * angle.cos(), radius * angle.sin())
    };
    (0..400).map(at).filter(move |(u, v)| keeps(cloud, i, *u, *v)).map(move |(u, v)| p + s * u + t * v)
}

fn sampled(mesh: &Mesh, method: MeshMethod) -> SplatCloud {
    splats_from_mesh(mesh, &MeshOptions::new(method), &NoProgress).unwrap().0
}

#[test]
fn count_covers_a_cube_to_its_edges_and_stays_on_it() {
    for count in [600, 1000, 5000, 8000, 30_000] {
        let cube = cube();
        let (cloud, report) =
            splats_from_mesh(&cube, &MeshOptions::new(MeshMethod::Count(count)), &NoProgress).unwrap();
        assert_eq!((cloud.len(), report.splats, report.feature_edges), (count, count, 12));
        let c = coverage(&cloud, &places(&cube, 100_000));
        println!("cube, {count}: {c:?}, {:?}", report.interior_weight);
        assert_eq!(c.holes, 0, "{count}: {c:?}");
        assert!(c.twice > 0.97, "{count}: {c:?}");
        let spacing = (6.0 / count as f64).sqrt();
        for i in 0..count {
            let over = kept(&cloud, i).map(|q| (q - DVec3::ONE).max(-q).max_element()).fold(0.0, f64::max);
            // An overhang of 0.02 radii gets no line, and the polygon that approximates the disk adds a hundredth of a
            // spacing.
            assert!(over <= 0.043 * spacing, "{count}: splat {i} hangs over by {over}");
            let n = cloud.normal(i).abs();
            assert!(n.max_element() > 1.0 - 1e-6, "normals don't average across creases");
        }
    }
}

#[test]
fn detail_covers_a_cube_whose_colours_vary_in_places() {
    let mut cube = cube();
    let stripes =
        |i: usize| if i % 512 < 100 && (i / 4).is_multiple_of(2) { [20, 20, 20, 255] } else { [180, 180, 180, 255] };
    cube.texture = Some(Arc::new(Texture { width: 512, height: 512, srgba8: (0..512 * 512).map(stripes).collect() }));
    let uv = |i: usize| cube.positions.get(i).as_vec3() * 0.7 + Vec3::splat(0.3) * cube.positions.get(i).z as f32;
    cube.uvs = Some((0..8).map(|i| [uv(i).x, uv(i).y]).collect());
    let (cloud, report) = splats_from_mesh(&cube, &MeshOptions::new(MeshMethod::Detail), &NoProgress).unwrap();
    let detail = report.detail.unwrap();
    assert!(detail.splats < detail.colors && detail.splats > 5000, "{detail:?}");
    let c = coverage(&cloud, &places(&cube, 200_000));
    println!("striped cube: {detail:?}, {c:?}");
    assert_eq!(c.holes, 0, "{c:?}");
    assert!(c.twice > 0.97, "{c:?}");
}

#[test]
fn count_covers_facets_narrower_than_splats_are_apart() {
    // A plate whose rim is folded ten times: strips of an eighth of a spacing, few of which have a splat of their own.
    let (length, width) = (24.0, 0.125);
    let slope = |i: u32| f64::from((i + 1) % 2);
    let mut rim = vec![DVec3::X * -20.0];
    rim.extend((0..=10).map(|i| DVec3::new(f64::from(i), 0.0, slope(i)) * width * 0.5_f64.sqrt()));
    let positions = [rim.clone(), rim.iter().map(|p| *p + DVec3::Y * length).collect()].concat();
    let row = rim.len() as u32;
    let plate =
        mesh(&positions, (0..row - 1).flat_map(|i| [[i, i + 1, i + 1 + row], [i, i + 1 + row, i + row]]).collect());
    for count in [400, 510, 600] {
        let cloud = sampled(&plate, MeshMethod::Count(count));
        assert_eq!(cloud.len(), count);
        let c = coverage(&cloud, &places(&plate, 100_000));
        println!("folded, {count}: {c:?}");
        assert_eq!(c.holes, 0, "{count}: {c:?}");
    }
}

#[test]
fn count_covers_a_smooth_globe_with_smooth_normals() {
    let globe = globe(24);
    for count in [2000, 20_000] {
        let (cloud, report) =
            splats_from_mesh(&globe, &MeshOptions::new(MeshMethod::Count(count)), &NoProgress).unwrap();
        assert_eq!((report.feature_edges, report.degenerate), (0, 96));
        assert!(matches!(cloud.data().shape, Shape::Disks { .. }));
        let c = coverage(&cloud, &places(&globe, 50_000));
        println!("globe, {count}: {c:?}, {:?}", report.interior_weight);
        assert_eq!(c.holes, 0, "{count}: {c:?}");
        assert!((3.0..6.0).contains(&report.interior_weight.unwrap()));
        assert!(cloud.data().clips.is_none(), "a surface without edges pays for none");
        for i in 0..count {
            let outward = cloud.center(i).normalize();
            // A sphere's interpolated vertex normals are exact to a fraction of the 7.5° between vertices. Splats are
            // in the faces, whose normals are exact to their half diagonal of 5.3°.
            assert!(cloud.shading_normal(i).dot(outward) > 0.999);
            assert!(cloud.normal(i).dot(outward) > 0.9955);
        }
    }
}

#[test]
fn stratified_samples_cover_too() {
    // Above the limit of elimination; one sheet and few places only, to keep the test short.
    let plane = mesh(&[DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0)], vec![[0, 1, 3], [0, 3, 2]]);
    let cloud = sampled(&plane, MeshMethod::Count(1_000_001));
    let c = coverage(&cloud, &places(&plane, 20_000));
    println!("stratified: {c:?}, {:?}", cloud.data().interior_weight);
    assert_eq!(c.holes, 0, "{c:?}");
}

#[test]
fn per_vertex_covers_triangles_longer_than_vertices_are_apart() {
    // A strip of one row of quads, 5 wide, with vertices 1 apart along it.
    let positions: Vec<DVec3> =
        (0..2 * 41).map(|i| DVec3::new(f64::from(i / 2), 5.0 * f64::from(i % 2), 0.0)).collect();
    let strip =
        mesh(&positions, (0..40).map(|i| 2 * i).flat_map(|i| [[i, i + 2, i + 1], [i + 1, i + 2, i + 3]]).collect());
    let c = coverage(&sampled(&strip, MeshMethod::PerVertex), &places(&strip, 50_000));
    assert_eq!(c.holes, 0, "{c:?}");
}

#[test]
fn per_face_and_per_vertex_cover_a_globe() {
    let globe = globe(40);
    for method in [MeshMethod::PerFace, MeshMethod::PerVertex] {
        let cloud = sampled(&globe, method);
        let c = coverage(&cloud, &places(&globe, 50_000));
        println!("{method:?}: {c:?}, {:?}", cloud.data().interior_weight);
        assert_eq!(c.holes, 0, "{method:?}: {c:?}");
        assert!((0..cloud.len()).all(|i| cloud.normal(i).dot(cloud.center(i)) > 0.9));
    }
    // Each of the two poles has 80 vertices in one place; rows 1 to 39 have 80.
    assert_eq!(sampled(&globe, MeshMethod::PerVertex).len(), 39 * 80 + 2);
    assert_eq!(sampled(&globe, MeshMethod::PerFace).len(), 2 * 39 * 80);
}

#[test]
fn per_face_ellipses_cover_a_cube_and_end_at_its_edges() {
    let cloud = sampled(&cube(), MeshMethod::PerFace);
    assert_eq!(cloud.len(), 12);
    let c = coverage(&cloud, &places(&cube(), 50_000));
    println!("cube, a face: {c:?}");
    assert_eq!(c.holes, 0, "{c:?}");
    let over =
        (0..12).flat_map(|i| kept(&cloud, i)).map(|q| (q - DVec3::ONE).max(-q).max_element()).fold(0.0, f64::max);
    assert!(over <= 1e-4, "hangs over by {over}");
}

#[test]
fn colors_come_from_the_texture_and_the_vertices() {
    let square = mesh(&[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y], vec![[0, 1, 2], [0, 2, 3]]);
    // Left half black, right half white, times a vertex colour.
    let texture = Texture {
        width: 64,
        height: 1,
        srgba8: (0..64).map(|x| if x < 32 { [0, 0, 0, 255] } else { [255; 4] }).collect(),
    };
    let painted = Mesh {
        uvs: Some(vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
        texture: Some(Arc::new(texture)),
        colors: Some(vec![[0.5, 1.0, 0.25]; 4]),
        ..square
    };
    let cloud = sampled(&painted, MeshMethod::Count(500));
    assert!(cloud.data().alphas.is_none());
    for i in 0..500 {
        let (x, c) = (cloud.center(i).x, cloud.color(i));
        // A splat has the mean colour of a square around its centre, a spacing of 0.045 wide.
        if (x - 0.5).abs() > 0.025 && x > 0.025 && x < 0.975 {
            let expected = if x > 0.5 { [0.5, 1.0, 0.25] } else { [0.0; 3] };
            assert!(c.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{x}: {c:?}");
        }
    }
    let mut faceless = painted.clone();
    faceless.triangles.clear();
    assert_eq!(points_from_mesh(&faceless).unwrap().len(), 4);
    assert_eq!(MeshOptions::auto(&faceless).method, MeshMethod::PerVertex);
}

#[test]
fn given_vertex_normals_shade_and_crease_corners_do_not_average() {
    let tilted = Vec3::new(0.0, 0.6, 0.8);
    let mut square = mesh(&[DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y], vec![[0, 1, 2], [0, 2, 3]]);
    square.normals = Some(vec![tilted.to_array(); 4]);
    for method in [MeshMethod::Count(50), MeshMethod::PerFace, MeshMethod::PerVertex] {
        let cloud = sampled(&square, method);
        for i in 0..cloud.len() {
            // The normal is 37° off the face, but the disk stays in the face's plane.
            assert!((cloud.normal(i) - DVec3::Z).length() < 1e-6, "{method:?}");
            assert!((cloud.shading_normal(i) - tilted.as_dvec3()).length() < 1e-6, "{method:?}");
        }
    }
}

#[test]
fn texture_seams_weld_and_hard_edges_do_not() {
    // The cube with separate vertices for each face, as in a file with face normals.
    let shared = cube();
    let mut split = Mesh::default();
    let (mut positions, mut normals) = (Vec::new(), Vec::new());
    for t in &shared.triangles {
        let [a, b, c] = t.map(|i| shared.positions.get(i as usize));
        split.triangles.push([0, 1, 2].map(|k| positions.len() as u32 + k));
        positions.extend([a, b, c]);
        normals.extend([(b - a).cross(c - a).normalize().as_vec3().to_array(); 3]);
    }
    split.positions = Column3::from_f64(&positions);
    let smooth = points_from_mesh(&split).unwrap();
    assert_eq!(smooth.len(), 8);
    assert!(smooth.normals.unwrap().get(0).distance(-DVec3::ONE / 3.0_f64.sqrt()) < 0.1);
    split.normals = Some(normals);
    // Each corner has three vertices, one per face. The first vertex of a corner remains, and those that differ from
    // it.
    assert_eq!(points_from_mesh(&split).unwrap().len(), 8 * 3 + split_doubles(&split));
    let (_, report) = splats_from_mesh(&split, &MeshOptions::new(MeshMethod::Count(100)), &NoProgress).unwrap();
    assert_eq!(report.feature_edges, 12, "the diagonals are no creases");
}

/// Counts the vertices that repeat the position and normal of an earlier vertex, unless that is the normal of the first
/// vertex at the position.
fn split_doubles(mesh: &Mesh) -> usize {
    let normals = mesh.normals.as_ref().unwrap();
    let place = |i: usize| mesh.positions.get(i);
    (0..mesh.positions.len())
        .filter(|&i| {
            let first = (0..i).find(|&j| place(j) == place(i));
            let twin = (0..i).any(|j| place(j) == place(i) && normals[j] == normals[i]);
            first.is_some_and(|f| normals[f] != normals[i]) && twin
        })
        .count()
}

#[test]
fn splats_say_how_little_they_stand_apart() {
    let (flat, smooth) = (cube(), globe(16));
    let said = |mesh: &Mesh, method| {
        let comments = sampled(mesh, method).data().comments.clone();
        [FLAT_PARTS, FINE_SPLATS].map(|what| comments.iter().any(|comment| comment == what))
    };
    let triangles = smooth.triangles.len();
    assert_eq!(said(&flat, MeshMethod::Count(2 * triangles)), [true, false]);
    assert_eq!(said(&smooth, MeshMethod::Count(2 * triangles)), [false, true]);
    assert_eq!(said(&smooth, MeshMethod::Count(triangles / 2)), [false, false]);
    assert_eq!(said(&smooth, MeshMethod::PerVertex), [false, false]);
    // The mesh's own comment doesn't apply to new splats.
    let told = Mesh { comments: vec![FINE_SPLATS.into()], ..smooth };
    assert_eq!(said(&told, MeshMethod::Count(triangles / 2)), [false, false]);
}

#[test]
fn degenerate_meshes_are_refused_or_skipped_with_a_reason() {
    let options = MeshOptions::new(MeshMethod::PerFace);
    let empty = splats_from_mesh(&Mesh::default(), &options, &NoProgress).unwrap_err();
    assert_eq!(empty, SampleError::Empty { what: "mesh", missing: "vertices" });
    let line = mesh(&[DVec3::ZERO, DVec3::X, DVec3::X * 2.0], vec![[0, 1, 2], [1, 1, 0]]);
    for method in [MeshMethod::PerFace, MeshMethod::Count(10)] {
        let error = splats_from_mesh(&line, &MeshOptions::new(method), &NoProgress).unwrap_err();
        assert_eq!(error, SampleError::NoArea { triangles: 2 });
    }
    assert_eq!(MeshOptions::auto(&line).method, MeshMethod::PerVertex);
    assert_eq!(sampled(&line, MeshMethod::PerVertex).len(), 3);
    let mut bad = line.clone();
    bad.triangles.push([0, 1, 9]);
    assert!(matches!(splats_from_mesh(&bad, &options, &NoProgress), Err(SampleError::Model(_))));
    let _ = MeshOptions::auto(&bad);
    assert!(splats_from_mesh(&cube(), &MeshOptions::new(MeshMethod::Count(0)), &NoProgress).is_err());
    let scale = MeshOptions { radius_scale: f64::NAN, ..options };
    assert!(splats_from_mesh(&cube(), &scale, &NoProgress).is_err());
    // A sheet with many layers in one place: the number of neighbours in elimination is bounded.
    let mut layers = cube();
    layers.triangles = vec![layers.triangles[0]; 3000];
    assert_eq!(sampled(&layers, MeshMethod::Count(2000)).len(), 2000);
    for count in [1, 2, 3] {
        assert_eq!(sampled(&cube(), MeshMethod::Count(count)).len(), count);
    }
}

#[test]
fn auto_chooses_by_density() {
    assert_eq!(MeshOptions::auto(&globe(240)).method, MeshMethod::PerVertex);
    let MeshMethod::Adaptive(count) = MeshOptions::auto(&globe(24)).method else { panic!("a coarse globe is sampled") };
    // 4π / (2·2/1024)² = 823,550, capped.
    assert_eq!(count, 500_000);
}

#[test]
fn adaptive_is_closer_on_thin_parts_alone_and_leaves_no_hole() {
    const COUNT: usize = 60_000;
    // A ball, and a needle beside it.
    let (ball, needle) = (globe(48), globe(96));
    let mut positions: Vec<DVec3> = (0..ball.positions.len()).map(|i| ball.positions.get(i)).collect();
    let first = positions.len() as u32;
    let thin = DVec3::new(0.03, 0.03, 1.0);
    positions.extend((0..needle.positions.len()).map(|i| needle.positions.get(i) * thin + DVec3::X * 1.2));
    let mut triangles = ball.triangles.clone();
    triangles.extend(needle.triangles.iter().map(|t| t.map(|i| i + first)));
    let both = mesh(&positions, triangles);

    let (cloud, report) = splats_from_mesh(&both, &MeshOptions::new(MeshMethod::Adaptive(COUNT)), &NoProgress).unwrap();
    let c = coverage(&cloud, &places(&both, 200_000));
    let is_thin = |i: &usize| cloud.center(*i).x > 1.1;
    let on_needle = (0..cloud.len()).filter(is_thin).count();
    // The middle half of the needle, whose curvature is nearly 1 over its radius.
    let middle = (0..cloud.len()).filter(is_thin).filter(|i| cloud.center(*i).z.abs() < 0.5);
    let rim_px = |i: usize| cloud.radius_max(i).powi(2) / (2.0 * 0.03) / 2.23 * 1024.0;
    let largest = middle.map(rim_px).fold(0.0, f64::max);
    let even = sampled(&both, MeshMethod::Count(COUNT));
    let even_on_needle = (0..COUNT).filter(|i| even.center(*i).x > 1.1).count();
    println!("{c:?}, {on_needle} on the needle, {even_on_needle} even ones, {largest} px, {report:?}");
    assert_eq!(c.holes, 0);
    // The ball has the same number, except for the grading; a radius may be 1.2 times what the density requires.
    let on_ball = cloud.len() - on_needle;
    assert!(on_ball.abs_diff(COUNT - even_on_needle) < COUNT / 100, "{on_ball}");
    assert!(on_needle > 5 * even_on_needle && largest < 1.2 * 1.2 / 3.0, "{on_needle}, {largest} px");

    // The unit of length doesn't matter.
    for scale in [1e15, 1e-15] {
        let scaled: Vec<DVec3> = positions.iter().map(|p| *p * scale).collect();
        let count = sampled(&mesh(&scaled, both.triangles.clone()), MeshMethod::Adaptive(COUNT)).len();
        assert!(count.abs_diff(cloud.len()) < cloud.len() / 100, "{scale}: {count}");
    }

    // A flat surface is sampled evenly.
    let spread = |method| sampled(&cube(), method).into_data().centers;
    assert_eq!(spread(MeshMethod::Adaptive(2000)), spread(MeshMethod::Count(2000)));
    assert!(splats_from_mesh(&cube(), &MeshOptions::new(MeshMethod::Adaptive(0)), &NoProgress).is_err());
}
