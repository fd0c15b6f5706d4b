//! Tests of meshes' normal maps in the shading normals of their splats.

use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;
use surfel_model::{Column3, Mesh, MeshMaterial, NormalMap, SplatCloud, Texture, TriangleMaterials};
use surfel_sample::{MeshMethod, MeshOptions, NoProgress, splats_from_mesh};

/// Returns a normal map of `size`² texels. `normal` maps a place in the image (u right, v down, 0 to 1) to a normal
/// with the components right, up and out.
fn map(size: u32, scale: f32, normal: impl Fn(DVec2) -> DVec3) -> NormalMap {
    let level = |v: f64| (127.5 * (v + 1.0)).round() as u8;
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(size);
    let texel = |i: u32| {
        let n = normal(DVec2::new(at(i % size), at(i / size)));
        [level(n.x), level(n.y), level(n.z), 255]
    };
    let image = Texture { width: size, height: size, srgba8: (0..size * size).map(texel).collect() };
    NormalMap { image: Arc::new(image), scale }
}

/// Returns a unit square turned by `turned`, whose image axes right and up are x and y before the turn. `uv` maps a
/// place of the square to texture coordinates.
fn square(turned: DMat3, uv: impl Fn(DVec2) -> [f32; 2], map: NormalMap) -> Mesh {
    let places = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(DVec2::from);
    let material = MeshMaterial { normal_map: Some(map), ..MeshMaterial::default() };
    Mesh {
        positions: Column3::from_f64(&places.map(|p| turned * p.extend(0.0))),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        uvs: Some(places.map(uv).to_vec()),
        materials: Some(TriangleMaterials { materials: vec![material], of_triangle: vec![0; 2] }),
        ..Mesh::default()
    }
}

fn splats(mesh: &Mesh, count: usize) -> SplatCloud {
    splats_from_mesh(mesh, &MeshOptions::new(MeshMethod::Count(count)), &NoProgress).unwrap().0
}

fn upright(p: DVec2) -> [f32; 2] {
    [p.x as f32, 1.0 - p.y as f32]
}

#[test]
fn normals_follow_the_images_axes_however_it_lies() {
    // Levels 204, 153 and 217 are 0.6, 0.2 and 0.7.
    let own = DVec3::new(0.6, 0.2, 0.7020);
    for turned in
        [DMat3::IDENTITY, DMat3::from_rotation_x(1.1), DMat3::from_rotation_y(2.0) * DMat3::from_rotation_z(0.4)]
    {
        type Place = fn(DVec2) -> [f32; 2];
        let quarter = |p: DVec2| [p.y as f32, p.x as f32];
        let cases: [(Place, [DVec3; 2]); 4] = [
            (upright, [DVec3::X, DVec3::Y]),
            // Mirrored, upside down, three times as small, and far from the image.
            (|p| [7.0 - 3.0 * p.x as f32, 1.0 - p.y as f32], [-DVec3::X, DVec3::Y]),
            (|p| [p.x as f32, p.y as f32], [DVec3::X, -DVec3::Y]),
            (quarter, [DVec3::Y, -DVec3::X]),
        ];
        for (uv, [right, up]) in cases {
            let cloud = splats(&square(turned, uv, map(2, 1.0, |_| own)), 50);
            let level = |v: f64| 2.0 * (127.5 * (v + 1.0)).round() / 255.0 - 1.0;
            let expected = right * level(own.x) + up * level(own.y) + DVec3::Z * level(own.z);
            let expected = (turned * expected).normalize();
            for i in 0..cloud.len() {
                let found = cloud.shading_normal(i);
                assert!((found - expected).length() < 1e-6, "{found} for {expected}");
                // The map doesn't move the surface.
                assert!((cloud.normal(i).normalize() - turned * DVec3::Z).length() < 1e-6);
            }
        }
    }
}

#[test]
fn normals_of_relief_are_those_of_its_slope() {
    let slope = |p: DVec2| DVec3::new(-0.5 * (TAU * p.x).cos(), 0.3 * (2.0 * TAU * p.y).sin(), 1.0).normalize();
    let turned = DMat3::from_rotation_x(FRAC_PI_2);
    let cloud = splats(&square(turned, upright, map(128, 1.0, slope)), 4000);
    let mut worst = 0.0_f64;
    for i in 0..cloud.len() {
        let place = turned.transpose() * cloud.center(i);
        let expected = turned * slope(DVec2::new(place.x, 1.0 - place.y));
        worst = worst.max((cloud.shading_normal(i) - expected).length());
    }
    // Half a level of 255 is 0.004 per component; the mean over a splat's area and the image's resolution add the rest.
    assert!(worst < 0.02, "{worst}");
}

#[test]
fn maps_that_say_nothing_leave_the_surface_as_it_is() {
    let tilted = DVec3::new(0.6, 0.0, 0.8);
    let flat = [
        square(DMat3::IDENTITY, upright, map(2, 0.0, |_| tilted)),
        // All of the square shows one place of the image.
        square(DMat3::IDENTITY, |_| [0.5, 0.5], map(2, 1.0, |_| tilted)),
        square(DMat3::IDENTITY, |_| [f32::NAN, 0.5], map(2, 1.0, |_| tilted)),
        Mesh { uvs: None, ..square(DMat3::IDENTITY, upright, map(2, 1.0, |_| tilted)) },
    ];
    for mesh in flat {
        let cloud = splats(&mesh, 20);
        assert!((0..cloud.len()).all(|i| (cloud.shading_normal(i) - DVec3::Z).length() < 1e-6));
    }
    // Steep normals remain finite and of unit length.
    for scale in [1e30, -1e30, f32::MAX] {
        let cloud = splats(&square(DMat3::IDENTITY, upright, map(2, scale, |_| tilted)), 20);
        assert!((0..cloud.len()).all(|i| (cloud.shading_normal(i).length() - 1.0).abs() < 1e-6));
    }
}
