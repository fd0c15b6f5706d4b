//! 3D Tiles of points, written to their specification: `pnts`, glTF, nested tilesets, refinement, georeferenced
//! tilesets, and damaged, missing or outside files.

#![cfg(feature = "gltf")]

use glam::DVec3;
use serde_json::{Value, json};
use std::path::Path;
use surfel_io::{Content, Format, LoadOptions, Loaded, load, load_bytes, names_geometry};
use surfel_model::{ExtraValues, PointCloud, Up};

/// Builds a `pnts` tile: its feature table with the table's bytes, then its batch table with the table's bytes.
fn pnts(features: &Value, body: &[u8], batch: &Value, batch_body: &[u8]) -> Vec<u8> {
    let text = |json: &Value| if json.is_null() { String::new() } else { json.to_string() };
    let (features, batch) = (text(features), text(batch));
    let parts = [features.as_bytes(), body, batch.as_bytes(), batch_body];
    let mut tile = b"pnts".to_vec();
    let length = 28 + parts.iter().map(|p| p.len()).sum::<usize>();
    for number in [1, length].into_iter().chain(parts.map(<[u8]>::len)) {
        tile.extend((number as u32).to_le_bytes());
    }
    parts.iter().for_each(|part| tile.extend(*part));
    tile
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Builds a `pnts` tile of points without attributes.
fn plain(points: &[[f32; 3]]) -> Vec<u8> {
    let features = json!({"POINTS_LENGTH": points.len(), "POSITION": {"byteOffset": 0}});
    pnts(&features, &floats(points.as_flattened()), &Value::Null, &[])
}

/// Builds a GLB file of points, or of one triangle whose corners are the points.
fn glb(points: &[[f32; 3]], triangles: bool) -> Vec<u8> {
    let body = floats(points.as_flattened());
    let json = json!({
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"mode": if triangles { 4 } else { 0 }, "attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": points.len()}],
        "bufferViews": [{"buffer": 0, "byteLength": body.len()}], "buffers": [{"byteLength": body.len()}],
    })
    .to_string();
    let mut glb = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, chunk) in [(b"JSON", json.as_bytes()), (b"BIN\0", &body)] {
        glb.extend((chunk.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(chunk);
    }
    glb
}

fn cube(center: f64, half: f64) -> Value {
    json!({"box": [center, center, center, half, 0, 0, 0, half, 0, 0, 0, half]})
}

fn tileset(root: Value) -> Vec<u8> {
    json!({"asset": {"version": "1.1"}, "geometricError": 9, "root": root}).to_string().into_bytes()
}

/// Loads `tileset.json` from a folder with these files.
fn read(files: &[(&str, Vec<u8>)], repair: bool) -> Result<Loaded, String> {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    let path = folder.path().join("tileset.json");
    assert!(names_geometry(&path));
    let error = |e: surfel_io::IoError| e.to_string().replace(&*folder.path().to_string_lossy(), "");
    let loaded = load(&path, &LoadOptions { repair, ..LoadOptions::default() }).map_err(error);
    loaded.inspect_err(|e| assert!(e.lines().count() <= 4, "{e}"))
}

fn cloud(loaded: &Loaded) -> &PointCloud {
    match &loaded.content {
        Content::Points(points) => points,
        other => panic!("{other:?}"),
    }
}

fn places(loaded: &Loaded) -> Vec<[f64; 3]> {
    let cloud = cloud(loaded);
    (0..cloud.len()).map(|i| (cloud.origin + cloud.positions.get(i)).to_array()).collect()
}

#[test]
fn pnts_with_all_its_columns_is_read() {
    let mut body = floats(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    body.extend([255, 0, 128, 255, 255, 255]);
    body.extend([128, 128, 255, 128]);
    let features = json!({"POINTS_LENGTH": 2, "RTC_CENTER": [10, 20, 30], "POSITION": {"byteOffset": 0},
        "RGB": {"byteOffset": 24}, "NORMAL_OCT16P": {"byteOffset": 30}});
    let batch = json!({"class": {"byteOffset": 0, "type": "SCALAR", "componentType": "UNSIGNED_BYTE"},
        "height": {"byteOffset": 2, "type": "SCALAR", "componentType": "FLOAT"}, "names": ["a", "b"],
        "wild": {"byteOffset": 99, "type": "SCALAR", "componentType": "FLOAT"}});
    let mut rows = vec![2, 6];
    rows.extend(floats(&[0.5, -1.0]));
    let tile = pnts(&features, &body, &batch, &rows);
    let loaded = load_bytes(&tile, None, Path::new("t"), &LoadOptions::default()).unwrap();
    assert_eq!((loaded.format, loaded.up), (Format::Pnts, Up::PlusZ));
    assert_eq!(places(&loaded), [[11.0, 22.0, 33.0], [14.0, 25.0, 36.0]]);
    let points = cloud(&loaded);
    // IEC 61966-2-1: level 128 of 255.
    assert_eq!(points.colors, Some(vec![[1.0, 0.0, 0.215_860_5], [1.0; 3]]));
    let normals = points.normals.as_ref().unwrap();
    // Half a step of eight bits, 1/255, from +z and +x.
    assert!(normals.get(0).distance(DVec3::Z) < 0.006 && normals.get(1).distance(DVec3::X) < 0.006, "{normals:?}");
    let extras: Vec<_> = points.extras.iter().map(|e| (e.name.as_str(), e.values.clone())).collect();
    assert_eq!(extras, [("class", ExtraValues::U8(vec![2, 6])), ("height", ExtraValues::F32(vec![0.5, -1.0]))]);
}

#[test]
fn quantised_positions_and_colours_of_every_kind_are_read() {
    let place = |x: u16| [x, 0, 65_535].map(u16::to_le_bytes).as_flattened().to_vec();
    let body = [place(0), place(32_768), vec![0, 0xf8, 0xe0, 0x07]].concat();
    let with = |more: Value| {
        let mut features = json!({"POINTS_LENGTH": 2, "POSITION_QUANTIZED": {"byteOffset": 0},
            "QUANTIZED_VOLUME_OFFSET": [-1, -2, -3], "QUANTIZED_VOLUME_SCALE": [65_535, 1, 2]});
        features.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        load_bytes(&pnts(&features, &body, &Value::Null, &[]), None, Path::new("t"), &LoadOptions::default()).unwrap()
    };
    let loaded = with(json!({"RGB565": {"byteOffset": 12}}));
    assert_eq!(places(&loaded), [[-1.0, -2.0, -1.0], [32_767.0, -2.0, -1.0]]);
    assert_eq!(cloud(&loaded).colors, Some(vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]));
    let loaded = with(json!({"CONSTANT_RGBA": [255, 0, 255, 51]}));
    assert_eq!(cloud(&loaded).colors, Some(vec![[1.0, 0.0, 1.0]; 2]));
    assert_eq!(cloud(&loaded).alphas, Some(vec![0.2; 2]));
}

#[test]
fn finest_tiles_are_taken_and_added_ones_beside_them() {
    let files = [
        ("a.pnts", plain(&[[1.0, 0.0, 0.0]])),
        ("b.pnts", plain(&[[2.0, 0.0, 0.0]])),
        ("sub/c.pnts", plain(&[[3.0, 0.0, 0.0]])),
        (
            "sub/inner.json",
            tileset(json!({"content": {"uri": "c.pnts?v=2"}, "transform":
            [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 10, 1]})),
        ),
    ];
    let with = |refine: &str| {
        let root = json!({"refine": refine, "content": {"uri": "a.pnts"}, "children": [
            {"content": {"url": "./b.pnts"}, "transform": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 100, 0, 0, 1]},
            {"content": {"uri": "sub/inner.json"}}, {"children": []}]});
        let files: Vec<_> = files.iter().cloned().chain([("tileset.json", tileset(root))]).collect();
        let mut places = places(&read(&files, false).unwrap());
        places.sort_by(|a, b| a[0].total_cmp(&b[0]));
        places
    };
    assert_eq!(with("REPLACE"), [[6.0, 0.0, 10.0], [102.0, 0.0, 0.0]]);
    assert_eq!(with("ADD"), [[1.0, 0.0, 0.0], [6.0, 0.0, 10.0], [102.0, 0.0, 0.0]]);
}

#[test]
fn gltf_tiles_are_turned_upright_unless_their_boxes_say_that_they_are() {
    let with = |points: &[[f32; 3]], asset: Value, volume: Value| {
        let root = json!({"content": {"uri": "a.glb"}, "boundingVolume": volume});
        let tileset = json!({"asset": asset, "geometricError": 1, "root": root}).to_string().into_bytes();
        read(&[("a.glb", glb(points, false)), ("tileset.json", tileset)], false).unwrap()
    };
    let points = [[1.0, 2.0, 3.0], [1.0, 2.0, 3.5]];
    let asset = json!({"version": "1.1"});
    let turned = [[1.0, -3.0, 2.0], [1.0, -3.5, 2.0]];
    let stored = [[1.0, 2.0, 3.0], [1.0, 2.0, 3.5]];
    assert_eq!(places(&with(&points, asset.clone(), json!({"sphere": [0, 0, 0, 9]}))), turned);
    assert_eq!(places(&with(&points, asset.clone(), cube(0.0, 5.0))), turned);
    let loaded = with(&points, asset, cube(2.0, 2.0));
    assert_eq!(places(&loaded), stored);
    assert!(loaded.notes.iter().any(|n| n.contains("z-up")), "{:?}", loaded.notes);
    let legacy = json!({"version": "0.0", "gltfUpAxis": "Z"});
    assert_eq!(places(&with(&points, legacy, cube(0.0, 5.0))), stored);
}

#[test]
fn places_on_earth_are_turned_to_east_north_and_up() {
    // On the equator at longitude 90°: east is −x, north is +z, up is +y.
    let root = json!({"content": {"uri": "a.pnts"}, "transform":
        [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 6_378_137.0, 0, 1]});
    let tile = plain(&[[-1.0, -2.0, -3.0], [1.0, 2.0, 3.0]]);
    let loaded = read(&[("a.pnts", tile), ("tileset.json", tileset(root))], false).unwrap();
    for (found, expected) in places(&loaded).into_iter().zip([[1.0, -3.0, -2.0], [-1.0, 3.0, 2.0]]) {
        assert!((DVec3::from(found) - DVec3::from(expected)).length() < 1e-6, "{found:?}");
    }
    let note = loaded.notes.iter().find(|n| n.contains("EPSG:4978")).unwrap();
    assert!(note.contains("latitude 0.000000000°, longitude 90.000000000°"), "{note}");
}

#[test]
fn coordinates_about_the_earths_centre_as_floats_are_said_to_be_rounded() {
    let square = |x: f32| [[x, -20.0, 5.0], [x, 20.0, 5.0], [x + 9.0, 0.0, -20.0], [x, 0.0, 20.0]];
    let rounding = |loaded: &Loaded| loaded.notes.iter().find(|n| n.contains("rounded to steps")).cloned();
    let alone = |tile: &[u8]| load_bytes(tile, None, Path::new("t"), &LoadOptions::default()).unwrap();
    let note = "its coordinates are 32-bit floats far from the origin: they are rounded to steps of 0.5 there";
    assert_eq!(rounding(&alone(&plain(&square(6_378_137.0)))).as_deref(), Some(note));
    // A centre, or the tile's transform, keeps the floats small.
    let features = json!({"POINTS_LENGTH": 4, "RTC_CENTER": [6_378_137, 0, 0], "POSITION": {"byteOffset": 0}});
    let tile = pnts(&features, &floats(square(0.0).as_flattened()), &Value::Null, &[]);
    assert_eq!(rounding(&alone(&tile)), None);
    let with = |points: &[[f32; 3]], uri: &str, transform: Value| {
        let root = json!({"content": {"uri": uri}, "transform": transform});
        let tile = if uri == "a.pnts" { plain(points) } else { glb(points, false) };
        read(&[(uri, tile), ("tileset.json", tileset(root))], false).unwrap()
    };
    let moved = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 6_378_137.0, 0, 0, 1]);
    let scaled = json!([0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]);
    for uri in ["a.pnts", "a.glb"] {
        assert_eq!(rounding(&with(&square(0.0), uri, moved.clone())), None);
        // Steps are those after the transform: of 1 m in the tile, and 0.5 m in the world.
        let loaded = with(&square(12_756_274.0), uri, scaled.clone());
        assert_eq!(rounding(&loaded).as_deref(), Some(note), "{uri}");
    }
}

#[test]
fn what_cannot_be_read_is_told_and_left_out_on_request() {
    let root = json!({"refine": "ADD", "contents": [{"uri": "a.pnts"}, {"uri": "gone.pnts"}]});
    let files = [("a.pnts", plain(&[[1.0; 3]])), ("tileset.json", tileset(root))];
    let error = read(&files, false).unwrap_err();
    assert!(error.contains("can't read the tile 'gone.pnts'") && error.contains("`repair`"), "{error}");
    let loaded = read(&files, true).unwrap();
    assert_eq!(cloud(&loaded).len(), 1);
    assert!(loaded.notes.iter().any(|n| n.contains("left out 1 tiles that can't be read")), "{:?}", loaded.notes);
    assert_eq!(loaded.beside.len(), 2, "{:?}", loaded.beside);
    let only = |uri: &str, bytes: Vec<u8>| {
        let root = json!({"content": {"uri": uri}});
        read(&[("t", bytes), ("tileset.json", tileset(root))], false).map(|l| l.content).unwrap_err()
    };
    for (uri, bytes, expected) in [
        ("../../secret", vec![], "`allow_outside`"),
        ("/etc/passwd", vec![], "`allow_outside`"),
        ("https://example.org/t", vec![], "only files"),
        ("tileset.json", vec![], "32 tilesets"),
        ("t", glb(&[[0.0; 3], [1.0; 3], [2.0, 0.0, 0.0]], true), "no points"),
        ("t", b"b3dm".to_vec(), "no points"),
        ("t", plain(&[[1.0; 3]])[..60].to_vec(), "cut off"),
        (
            "t",
            pnts(&json!({"POINTS_LENGTH": 1_u64 << 60, "POSITION": {"byteOffset": 0}}), &[], &Value::Null, &[]),
            "beyond",
        ),
        ("t", pnts(&json!({"POINTS_LENGTH": 0}), &[], &Value::Null, &[]), "no positions"),
    ] {
        let error = only(uri, bytes);
        assert!(error.contains(expected), "{error}\nexpected: {expected}");
    }
    let implicit = tileset(json!({"implicitTiling": {}, "content": {"uri": "{level}.glb"}}));
    assert!(read(&[("tileset.json", implicit)], false).unwrap_err().contains("implicit tiling"));
}
