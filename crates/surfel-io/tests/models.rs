//! The real models and golden pictures beside the repository, where they are there.

use std::path::{Path, PathBuf};
use surfel_io::{Content, LoadOptions, load, read_image, scene_file};

/// A folder of `../shared`, or `None`, which is printed.
fn shared(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared").join(name);
    if !path.is_dir() {
        println!("skipped: ../shared/{name} is not there");
        return None;
    }
    Some(path)
}

#[test]
fn models_have_the_documented_sizes() {
    let Some(folder) = shared("models") else { return };
    for (name, vertices, triangles) in [
        ("igea.ply", 134_345, 268_686),
        ("lion_takanawa.ply", 272_768, 0),
        ("fandisk.obj", 6_475, 12_946),
        ("rocker-arm.obj", 10_044, 20_088),
        ("stanford-bunny.obj", 35_947, 69_451),
        ("teapot.obj", 3_644, 6_320),
        // 2,930 positions, more with the texture's seams.
        ("spot/spot.obj", 3_225, 5_856),
    ] {
        let loaded = load(&folder.join(name), &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        let found = match &loaded.content {
            Content::Splats(s) => (s.len(), usize::MAX),
            Content::Points(p) => (p.len(), 0),
            Content::Mesh(m) => (m.positions.len(), m.triangles.len()),
            Content::Hybrid(h) => (h.cloud().len(), h.mesh().triangles.len()),
        };
        assert_eq!(found, (vertices, triangles), "{name}");
        assert!(loaded.notes.is_empty(), "{name}: {:?}", loaded.notes);
    }
}

#[test]
fn models_strips_make_a_closed_oriented_surface() {
    let Some(folder) = shared("models") else { return };
    let Content::Mesh(mesh) = load(&folder.join("igea.ply"), &LoadOptions::default()).unwrap().content else {
        panic!("igea.ply is a mesh");
    };
    // The divergence theorem: a strip whose winding does not alternate would cancel most of the volume.
    let corner = |i: u32| mesh.positions.get(i as usize);
    let signed: Vec<f64> =
        mesh.triangles.iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0).collect();
    let (volume, area): (f64, f64) = (
        signed.iter().sum(),
        mesh.triangles
            .iter()
            .map(|t| (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0])).length() / 2.0)
            .sum(),
    );
    // A head is no worse than a quarter of the sphere of its area; inconsistent winding gives almost nothing.
    let sphere = (area / (4.0 * std::f64::consts::PI)).powf(1.5) * 4.0 / 3.0 * std::f64::consts::PI;
    assert!(volume > 0.25 * sphere, "{volume} {sphere}");
}

#[test]
fn golden_pictures_and_scenes_are_read_with_all_planes() {
    let Some(folder) = shared("golden") else { return };
    let mut pictures = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.extension().and_then(|e| e.to_str()) {
            Some("exr") => {
                let planes = read_image(&path).unwrap_or_else(|e| panic!("{e}"));
                let pixels = (planes.width * planes.height) as usize;
                assert_eq!(planes.color.as_ref().map(Vec::len), Some(pixels), "{}", path.display());
                assert_eq!(planes.normal.as_ref().map(Vec::len), Some(pixels));
                assert_eq!(planes.weight.as_ref().map(Vec::len), Some(pixels));
                let depth = planes.depth.unwrap();
                assert!(depth.iter().all(|z| *z > 0.0) && depth.iter().any(|z| z.is_finite()));
                let [(name, mask)] = &planes.other[..] else { panic!("{}: one other plane", path.display()) };
                assert_eq!(name, "mask");
                assert!(mask.iter().all(|m| *m == 0.0 || *m == 1.0));
                pictures += 1;
            }
            Some("json") => {
                let scene = scene_file::read(&path).unwrap_or_else(|e| panic!("{e}"));
                assert!(!scene.objects.is_empty());
            }
            Some("ply" | "obj") => {
                load(&path, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
            }
            _ => {}
        }
    }
    assert!(pictures > 0);
}
