//! Points as text, OBJ, STL and glTF, and detection of formats.

#![cfg(all(feature = "gltf", feature = "obj", feature = "points", feature = "stl"))]

use glam::DVec3;
use std::fs;
use std::path::{Path, PathBuf};
use surfel_io::{Content, Format, LoadOptions, Loaded, load as load_file, load_bytes};
use surfel_model::{ExtraValues, Mesh, PointCloud, SplatCloud, Up};

fn try_load(format: Format, bytes: impl AsRef<[u8]>) -> Result<Loaded, String> {
    load_bytes(bytes.as_ref(), Some(format), Path::new("t"), &LoadOptions::default())
        .map_err(|e| e.to_string())
        .inspect_err(|e| assert!(e.lines().count() <= 4 && e.starts_with("t: "), "{e}"))
}

fn load(format: Format, bytes: impl AsRef<[u8]>) -> Loaded {
    try_load(format, bytes).unwrap_or_else(|e| panic!("{e}"))
}

fn points(loaded: Loaded) -> PointCloud {
    match loaded.content {
        Content::Points(p) => p,
        other => panic!("{other:?}"),
    }
}

fn mesh(loaded: Loaded) -> Mesh {
    match loaded.content {
        Content::Mesh(m) => m,
        other => panic!("{other:?}"),
    }
}

fn splats(loaded: Loaded) -> SplatCloud {
    match loaded.content {
        Content::Splats(s) => s,
        other => panic!("{other:?}"),
    }
}

/// Linear value of the sRGB-encoded level ½, computed in f64.
const HALF: f32 = 0.214_041_14;

#[test]
fn points_columns_are_recognised_by_number_and_content() {
    for (text, attributes) in [
        ("1 2 3\n", "position"),
        ("# x y z i\n1,2,3,0.5\n4;5;6;0.25\n", "position intensity"),
        ("1 2 3 255 0 128\n", "position colour"),
        ("1 2 3 0.5 0.5 0.25\n", "position colour"),
        ("1 2 3 0 0.6 -0.8\n1 2 3 0 0 0\n", "position normal"),
        ("1 2 3 0.6 0 0.8 10 20 30\n", "position normal colour"),
        ("1\t2\t3\t10\t20\t30\t0.6\t0\t0.8\n", "position normal colour"),
        ("1 2 3 77 10 20 30 0.6 0 0.8\n", "position normal colour intensity"),
        ("1 2 3 -50 10 20 30\n", "position colour intensity"),
        ("1 2 3 4 5\n", "position column_4 column_5"),
        ("x,y,z,blue,green,red\n1,2,3,255,0,0\n", "position colour"),
        ("//X Y Z\n1 2 3\n", "position"),
    ] {
        assert_eq!(load(Format::Xyz, text).attributes.join(" "), attributes, "{text}");
    }
    let cloud = points(load(Format::Xyz, "x,y,z,blue,green,red\n1,2,3,255,0,0\n"));
    assert_eq!(cloud.colors.unwrap()[0], [0.0, 0.0, 1.0]);
    let cloud = points(load(Format::Xyz, "1 2 3 0.5 0 1\n"));
    assert_eq!(cloud.colors.unwrap()[0], [HALF, 0.0, 1.0]);
}

#[test]
fn points_pts_counts_are_not_points() {
    let loaded = load(Format::Pts, "2\n1 2 3 -1203 255 0 0\n4 5 6 10 0 255 0\r\n1\n7 8 9 0 0 0 255");
    assert_eq!(loaded.up, Up::PlusZ);
    let cloud = points(loaded);
    assert_eq!((cloud.len(), cloud.positions.get(2)), (3, DVec3::new(7.0, 8.0, 9.0)));
    assert_eq!(cloud.extras[0].values, ExtraValues::F32(vec![-1203.0, 10.0, 0.0]));
}

#[test]
fn points_far_from_the_origin_keep_their_detail() {
    let cloud = points(load(Format::Xyz, "4500000.123 5 6\n4500001.456 5 6\n"));
    let x = |i: usize| (cloud.origin + cloud.positions.get(i)).x;
    // Tolerance: the last digit of an f64 at 4.5e6.
    assert!((x(0) - 4_500_000.123).abs() < 1e-9 && (x(1) - 4_500_001.456).abs() < 1e-9);
    let near = points(load(Format::Xyz, "0.1 0.2 0.3\n1 2 3\n"));
    assert!(near.positions.low().is_none(), "decimals near the origin are measurements in f32");
}

#[test]
fn points_faults_name_the_line() {
    for (text, expected) in [
        ("hello world\n", "found 'hello' where points were expected (line 1)"),
        ("ncols 120\nnrows 100\n", "gdal2xyz.py writes the points of an Esri ASCII grid"),
        ("1 2 3\n4 5\n", "found 2 numbers (line 2)"),
        ("1 2 3\n4 x 6\n", "found 'x' (line 2)"),
        ("1 2\n", "at least x y z"),
        ("# nothing\n", "holds no point"),
        ("", "is empty"),
    ] {
        let error = try_load(Format::Xyz, text).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
    assert!(try_load(Format::Xyz, "1 ".repeat(100_000)).is_err());
}

#[test]
fn obj_indices_of_every_form() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/1/1 \\\n4/2/1\nf -4//1 \
                -3//1 -2//1\n";
    let m = mesh(load(Format::Obj, text));
    assert_eq!(m.triangles.len(), 3);
    assert_eq!(m.triangles[..2], [[0, 1, 2], [0, 2, 3]]);
    // A corner without a texture coordinate is a separate vertex.
    assert_eq!((m.positions.len(), m.triangles[2]), (7, [4, 5, 6]));
    assert_eq!(m.positions.get(5), DVec3::X);
    assert_eq!((m.uvs.unwrap()[1], m.normals.unwrap()[6]), ([1.0, 0.0], [0.0, 0.0, 1.0]));
}

#[test]
fn concave_polygons_are_cut_within_their_outline() {
    // A door in a wall; the fan about the first corner would cross the opening.
    let corners = ["0 0 0", "2 0 0", "2 0 2", "3 0 2", "3 0 0", "8 0 0", "8 0 3", "0 0 3"];
    let obj: String = corners.iter().map(|c| format!("v {c}\n")).collect::<String>() + "f 1 2 3 4 5 6 7 8\n";
    let off = format!("OFF\n8 1 0\n{}\n8 0 1 2 3 4 5 6 7\n", corners.join("\n"));
    for m in [mesh(load(Format::Obj, obj)), mesh(load(Format::Off, off))] {
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| m.positions.get(i as usize));
            0.5 * (b - a).cross(c - a).length()
        };
        assert_eq!(m.triangles.iter().map(area).sum::<f64>(), 22.0, "{:?}", m.triangles);
        assert_eq!(m.triangles.len(), 6);
    }
}

#[test]
fn obj_without_texture_keeps_its_vertices_as_they_are() {
    let loaded = load(Format::Obj, "# made by hand\nv 0.1 0 0 1 0.5 0\nv 1 0 0\nv 1 1 0\nv 9 9 9\nf 3 2 1\nf 1 2\n");
    assert_eq!(loaded.notes, ["skipped 1 face with fewer than 3 corners"]);
    let m = mesh(loaded);
    assert_eq!((m.positions.len(), &m.triangles[..]), (4, &[[2, 1, 0]][..]));
    // Decimals have 48 bits of precision, more than f32.
    assert!((m.positions.get(0).x - 0.1).abs() < 1e-15);
    assert_eq!(m.colors.unwrap()[..2], [[1.0, HALF, 0.0], [1.0; 3]]);
    assert_eq!(m.comments, ["made by hand"]);
}

#[test]
fn obj_faults_name_the_line() {
    for (text, expected) in [
        ("v 0 0 0\nf 1 2 3\nf 1 2 1\n", "a face refers to vertex '3' of 1 (line 2)"),
        ("v 0 0 0\nf 0 1 1\n", "a face refers to vertex '0' of 1 (line 2)"),
        ("v 0 0 0\nf 1 1 -2\n", "a face refers to vertex '-2' of 1 (line 2)"),
        ("v 0 0 0\nf 1/x 1 1\n", "a face refers to texture coordinate 'x' (line 2)"),
        ("v 0 zero 0\n", "found 'zero', which is not a number (line 1)"),
        ("v 0 0\n", "found 2 numbers (line 1)"),
        ("vn 0 0 1\n", "holds no vertex"),
        ("v nan 0 0\nv 0 0 0\nf 1 2 2\n", "vertex 0 is invalid"),
    ] {
        let error = try_load(Format::Obj, text).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn obj_without_faces_is_a_point_cloud() {
    let cloud = points(load(Format::Obj, "v 1 2 3 0 0 1\nv 4 5 6 1 1 1\nvn 0 0 1\nvn 0 1 0\n"));
    assert_eq!((cloud.len(), cloud.normals.unwrap().get(1)), (2, DVec3::Y));
    assert_eq!(cloud.colors.unwrap()[0], [0.0, 0.0, 1.0]);
}

/// A folder that is removed when dropped.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("surfel-io-formats-{name}-{}", std::process::id()));
        fs::create_dir_all(path.join("sub")).unwrap();
        Self(path)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        fs::write(self.0.join(name), bytes).unwrap();
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn png(texels: &[[u8; 3]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, texels.len() as u32, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(texels.as_flattened()).unwrap();
    bytes
}

#[test]
fn obj_materials_keep_their_textures() {
    let folder = Folder::new("mtl");
    let shape = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.5\nusemtl red one\nf 1/1 2/1 3/1\n";
    folder.write("sub/r.png", png(&[[255, 0, 0], [0, 0, 255]]));
    folder.write("g.png", png(&[[0, 255, 0]]));
    folder.write(
        "a.mtl",
        "newmtl red one\nKd 0 0 0\nmap_Kd -s 1 1 1 -blendu on sub\\r.png\nnewmtl green\nKd 0.5 0.5 0.5\nmap_Kd g.png\n",
    );
    let one =
        mesh(load_file(&folder.write("one.obj", format!("mtllib a.mtl\n{shape}")), &LoadOptions::default()).unwrap());
    let texture = one.texture.unwrap();
    assert_eq!((texture.width, texture.srgba8[1]), (2, [0, 0, 255, 255]));
    assert!(one.uvs.is_some() && one.colors.is_none());
    // Textures of a library are relative to the library, not to the mesh.
    folder.write("sub/b.mtl", "newmtl red one\nmap_Kd r.png\n");
    let beside = folder.write("beside.obj", format!("mtllib sub/b.mtl\n{shape}"));
    let loaded = load_file(&beside, &LoadOptions::default()).unwrap();
    assert!(loaded.notes.iter().all(|note| !note.contains("texture")), "{:?}", loaded.notes);
    let two = format!("mtllib a.mtl\n{shape}usemtl green\nf 1/1 2/1 3/1\n");
    let loaded = load_file(&folder.write("two.obj", two), &LoadOptions::default()).unwrap();
    assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
    let two = mesh(loaded);
    let texel = |triangle: usize| two.material(triangle).texture.map(|t| t.srgba8[0]);
    assert_eq!([texel(0), texel(1)], [Some([255, 0, 0, 255]), Some([0, 255, 0, 255])]);
    // Kd multiplies.
    assert_eq!((two.colors.as_ref().unwrap()[0], two.colors.as_ref().unwrap()[3]), ([1.0; 3], [0.5; 3]));
    assert!(two.texture.is_none() && two.uvs.is_some());
    // Faces before the first material are white.
    let before = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl green\nf 1 3 2\n";
    folder.write("a.mtl", "newmtl green\nKd 0 1 0\n");
    let before = mesh(load_file(&folder.write("before.obj", before), &LoadOptions::default()).unwrap());
    let colors = before.colors.as_ref().unwrap();
    assert_eq!([0, 1].map(|t| colors[before.triangles[t][0] as usize]), [[1.0; 3], [0.0, 1.0, 0.0]]);
}

#[test]
fn ply_faces_have_textures_of_their_own_as_meshlab_writes_them() {
    let folder = Folder::new("wedges");
    folder.write("a.png", png(&[[255, 0, 0], [0, 0, 255]]));
    folder.write("b.png", png(&[[0, 255, 0]]));
    let header = |format: &str, files: &str| {
        format!(
            "ply\nformat {format} 1.0\n{files}element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
             element face 3\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n\
             property int texnumber\nend_header\n"
        )
    };
    let both = "comment TextureFile a.png\ncomment TextureFile b.png\n";
    // A square of two triangles that share a diagonal, one with each texture, and the same square without texture
    // coordinates.
    let vertices = [[0.0_f32, 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
    let faces: [(&[i32], &[f32], i32); 3] = [
        (&[0, 1, 2], &[0., 0., 0.5, 0., 0.5, 1.], 0),
        (&[0, 2, 3], &[0., 0., 0.5, 1., 0., 1.], 1),
        (&[0, 1, 2, 3], &[], -1),
    ];
    let words = |v: &[f32]| v.iter().map(|v| format!("{v} ")).collect::<String>();
    let mut text = header("ascii", both);
    vertices.iter().for_each(|v| text += &format!("{}\n", words(v)));
    let mut binary = header("binary_little_endian", both).into_bytes();
    binary.extend(vertices.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
    for (corners, uvs, texture) in faces {
        let listed: String = corners.iter().map(|i| format!("{i} ")).collect();
        text += &format!("{} {listed}{} {}{texture}\n", corners.len(), uvs.len(), words(uvs));
        binary.push(corners.len() as u8);
        binary.extend(corners.iter().flat_map(|i| i.to_le_bytes()));
        binary.push(uvs.len() as u8);
        binary.extend(uvs.iter().flat_map(|v| v.to_le_bytes()));
        binary.extend(texture.to_le_bytes());
    }
    let big = text.replace("TextureFile b.png", "TextureFile none.png");
    for (name, bytes) in [("ascii.ply", text.clone().into_bytes()), ("binary.ply", binary)] {
        let loaded = load_file(&folder.write(name, bytes), &LoadOptions::default()).unwrap();
        assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
        let mesh = mesh(loaded);
        assert_eq!(mesh.triangles, [[0, 1, 2], [3, 4, 5], [6, 7, 8], [6, 8, 9]], "{name}");
        let uvs = mesh.uvs.as_ref().unwrap();
        assert_eq!((uvs[1], uvs[4], uvs[5]), ([0.5, 1.0], [0.5, 0.0], [0.0, 0.0]), "v is turned downwards");
        let place = |i: usize| mesh.positions.get(i).to_array();
        assert_eq!((place(4), place(9)), ([1.0, 1.0, 0.0], [0.0, 1.0, 0.0]));
        let texel = |triangle: usize| mesh.material(triangle).texture.map(|t| t.srgba8[0]);
        let expected = [Some([255, 0, 0, 255]), Some([0, 255, 0, 255]), None, None];
        assert_eq!([0, 1, 2, 3].map(texel), expected, "{name}");
    }
    let loaded = load_file(&folder.write("big.ply", big), &LoadOptions::default()).unwrap();
    assert!(loaded.notes[0].starts_with("left out the texture 'none.png'"), "{:?}", loaded.notes);
    // One texture for all needs no materials, and equal corners stay one vertex; without a texture nothing is split.
    let one = text.replace("comment TextureFile b.png\n", "").replace("4 0 1 2 3 0 -1", "3 0 1 2 6 0 0 0.5 0 0.5 1 0");
    let one = one.replace("0 1 1\n", "0 1 0\n");
    let whole = mesh(load_file(&folder.write("one.ply", &one), &LoadOptions::default()).unwrap());
    assert!(whole.materials.is_none() && whole.texture.is_some());
    assert_eq!(whole.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    let plain = one.replace("comment TextureFile a.png\n", "");
    let plain = mesh(load_file(&folder.write("plain.ply", plain), &LoadOptions::default()).unwrap());
    assert!(plain.uvs.is_none() && plain.positions.len() == 4);
}

#[test]
fn obj_opacity_maps_are_the_alpha_of_textures() {
    let folder = Folder::new("opacity");
    let shape = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.5\nusemtl m\nf 1/1 2/1 3/1\n";
    folder.write("color.png", png(&[[255, 0, 0], [0, 0, 255]]));
    folder.write("grey.png", png(&[[0; 3], [64; 3], [192; 3], [255; 3]]));
    let load = |maps: &str| {
        folder.write("a.mtl", format!("newmtl m\n{maps}"));
        load_file(&folder.write("a.obj", format!("mtllib a.mtl\n{shape}")), &LoadOptions::default()).unwrap()
    };
    let texels = |maps: &str| mesh(load(maps)).texture.unwrap().srgba8.clone();
    // The nearest texel of the other image.
    assert_eq!(texels("map_Kd color.png\nmap_d -imfchan l grey.png\n"), [[255, 0, 0, 0], [0, 0, 255, 192]]);
    let white = |a| [255, 255, 255, a];
    assert_eq!(texels("map_d grey.png\n"), [white(0), white(64), white(192), white(255)]);
    assert_eq!(texels("map_Kd color.png\nmap_d color.png\n"), [[255, 0, 0, 255], [0, 0, 255, 255]]);
    let loaded = load("map_Kd color.png\nmap_d none.png\n");
    assert!(loaded.notes[0].starts_with("left out the texture 'none.png'"), "{:?}", loaded.notes);
    assert_eq!(mesh(loaded).texture.unwrap().srgba8[1], [0, 0, 255, 255]);
}

#[test]
fn obj_transparency_of_1_is_what_programs_write_for_opaque() {
    let folder = Folder::new("transparency");
    let shape = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
    for (words, alpha) in [("Tr 0.25", 0.75), ("Tr 1", 1.0), ("Tr 1.0\nd 1", 1.0), ("Tr 0", 1.0), ("d 0.5", 0.5)] {
        folder.write("a.mtl", format!("newmtl m\nKd 1 0 0\n{words}\n"));
        let path = folder.write("a.obj", format!("mtllib a.mtl\n{shape}"));
        let mesh = mesh(load_file(&path, &LoadOptions::default()).unwrap());
        assert_eq!(mesh.alphas.map_or(1.0, |alphas| alphas[0]), alpha, "{words}");
    }
}

#[test]
fn obj_normal_maps_are_read_by_what_they_hold() {
    let folder = Folder::new("normals");
    let shape = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.5\nusemtl m\nf 1/1 2/1 3/1\n";
    folder.write("color.png", png(&[[255, 0, 0]]));
    folder.write("n.png", png(&[[204, 128, 230], [128, 128, 255]]));
    folder.write("h.png", png(&[[204; 3], [230; 3]]));
    let load = |maps: &str| {
        folder.write("a.mtl", format!("newmtl m\n{maps}"));
        load_file(&folder.write("a.obj", format!("mtllib a.mtl\n{shape}")), &LoadOptions::default()).unwrap()
    };
    let map = |maps: &str| {
        let loaded = load(maps);
        assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
        let map = mesh(loaded).material(0).normal_map.cloned().unwrap();
        (map.scale, map.image.srgba8[0])
    };
    let normals = [204, 128, 230, 255];
    assert_eq!(map("norm n.png\n"), (1.0, normals));
    assert_eq!(map("map_Bump -bm 0.5 n.png\n"), (0.5, normals));
    assert_eq!(map("map_Kd color.png\nbump -imfchan l n.png\n"), (1.0, normals));
    // `norm` is always a normal map, whatever other map there is.
    for both in ["map_Bump h.png\nnorm n.png\n", "norm n.png\nmap_bump h.png\n"] {
        assert_eq!(map(both), (1.0, normals), "{both}");
    }
    assert_eq!(map("norm h.png\n"), (1.0, [204, 204, 204, 255]));
    let loaded = load("map_Kd color.png\nmap_Bump -bm 2 h.png\n");
    assert_eq!(loaded.notes, ["left out the bump map 'h.png': it holds heights, expected normals"]);
    let m = mesh(loaded);
    assert!(m.material(0).normal_map.is_none() && m.texture.is_some());
    assert!(load("norm none.png\n").notes[0].starts_with("left out the texture 'none.png'"));
}

#[test]
fn obj_missing_library_or_texture_is_a_note() {
    let folder = Folder::new("missing");
    let shape = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";
    let load = |text: String| load_file(&folder.write("a.obj", text), &LoadOptions::default()).unwrap();
    assert!(load(format!("mtllib no.mtl\n{shape}")).notes[0].starts_with("left out the material library 'no.mtl'"));
    folder.write("a.mtl", "newmtl m\nKd 1 0.5 0.25\nd 0.5\nmap_Kd no.png\n");
    let loaded = load(format!("mtllib a.mtl\n{shape}"));
    assert!(loaded.notes[0].starts_with("left out the texture 'no.png'"), "{:?}", loaded.notes);
    let m = mesh(loaded);
    assert_eq!((m.colors.unwrap()[0], m.alphas.unwrap()[0]), ([1.0, 0.5, 0.25], 0.5));
    folder.write("no.png", b"this is no image");
    assert!(load(format!("mtllib a.mtl\n{shape}")).notes[0].starts_with("left out the texture 'no.png'"));
    folder.write("yes.png", png(&[[9, 9, 9]]));
    let options = LoadOptions { texture: Some(folder.0.join("yes.png")), ..LoadOptions::default() };
    let given = mesh(load_file(&folder.write("a.obj", shape), &options).unwrap());
    assert_eq!(given.texture.unwrap().srgba8, [[9, 9, 9, 255]]);
}

fn binary_stl(triangles: &[[[f32; 3]; 3]]) -> Vec<u8> {
    let mut bytes = b"solid but binary".to_vec();
    bytes.resize(80, 0);
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for t in triangles {
        bytes.extend([0; 12]);
        t.as_flattened().iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

#[test]
fn stl_text_and_binary_merge_equal_corners() {
    let square =
        [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]], [[-0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]];
    let mut text = "solid a square\n".to_owned();
    for t in square {
        text += "facet normal 0 0 1\n outer loop\n";
        t.iter().for_each(|p| text += &format!("  vertex {} {} {}\n", p[0], p[1], p[2]));
        text += " endloop\nendfacet\n";
    }
    text += "endsolid a square\n";
    let binary = binary_stl(&square);
    for bytes in [text.as_bytes(), &binary] {
        // Detection also works without an extension.
        let loaded = load_bytes(bytes, None, Path::new("t"), &LoadOptions::default()).unwrap();
        assert_eq!((loaded.format, loaded.up), (Format::Stl, Up::PlusZ));
        let m = mesh(loaded);
        assert_eq!((m.positions.len(), &m.triangles[..]), (4, &[[0, 1, 2], [0, 2, 3]][..]));
    }
    for end in 0..binary.len() {
        assert!(try_load(Format::Stl, &binary[..end]).is_err(), "{end}");
    }
    let error = try_load(Format::Stl, &binary[..150]).unwrap_err();
    assert!(error.contains("ends within triangle 1 of 2 (byte 150)"), "{error}");
    let error = try_load(Format::Stl, text.replace("endsolid a square", "")).unwrap_err();
    assert!(error.contains("ends within facet 2"), "{error}");
    // Truncation at any position gives an error that states it.
    for end in text.find("outer").unwrap()..text.find("endsolid").unwrap() + 8 {
        let error = try_load(Format::Stl, &text[..end]).unwrap_err();
        assert!(error.contains("ends within facet") && error.contains("incomplete"), "{end}: {error}");
    }
    let error = try_load(Format::Stl, text.replace("1 1 0", "1 one 0")).unwrap_err();
    assert!(error.contains("found 'one' as a coordinate (line 6)"), "{error}");
}

/// Builds a glTF document with one buffer, `data`, and accessors (offset, count, componentType, type) into it. `rest`
/// is the JSON of the remaining keys.
fn gltf(data: &[u8], accessors: &[(usize, usize, u32, &str)], rest: &str) -> String {
    let hex: String = data.iter().map(|b| format!("%{b:02x}")).collect();
    let n = data.len();
    let accessors: Vec<String> = accessors
        .iter()
        .map(|(offset, count, component, kind)| {
            format!(
                r#"{{"bufferView": 0, "byteOffset": {offset}, "count": {count},
                    "componentType": {component}, "type": "{kind}"}}"#
            )
        })
        .collect();
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "buffers": [{{"uri": "data:,{hex}", "byteLength": {n}}}],
        "bufferViews": [{{"buffer": 0, "byteLength": {n}}}], "accessors": [{}], {rest}}}"#,
        accessors.join(", ")
    )
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

const QUAD: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];

#[test]
fn gltf_placements_multiply_and_mirrors_keep_the_outside_out() {
    let mut data = floats(&QUAD);
    data.extend(floats(&[0.6, 0.0, 0.8].repeat(4)));
    data.extend([0, 1, 2]);
    let text = gltf(
        &data,
        &[(0, 4, 5126, "VEC3"), (48, 4, 5126, "VEC3"), (96, 3, 5121, "SCALAR")],
        r#""meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2},
            {"attributes": {"POSITION": 0, "NORMAL": 1}, "mode": 5},
            {"attributes": {"POSITION": 0, "NORMAL": 1}, "mode": 6}, {"attributes": {"POSITION": 0}, "mode": 1}]}],
          "nodes": [{"mesh": 0, "scale": [1, 1, -2]}, {"children": [0], "translation": [10, 0, 0],
          "rotation": [0, 0, 1, 0]}, {"mesh": 0}],
          "scenes": [{"nodes": []}, {"nodes": [1]}], "scene": 1"#,
    );
    let loaded = load(Format::Gltf, text);
    assert_eq!((loaded.up, loaded.notes.len()), (Up::PlusY, 1));
    let m = mesh(loaded);
    // One list triangle, two of the strip and two of the fan.
    assert_eq!((m.positions.len(), m.triangles.len()), (12, 5));
    // Half a turn about z, then 10 along x.
    assert!((m.origin + m.positions.get(1) - DVec3::new(9.0, 0.0, 0.0)).length() < 1e-6);
    let normals = m.normals.unwrap();
    for t in &m.triangles[..3] {
        let [a, b, c] = t.map(|i| m.positions.get(i as usize));
        let n = DVec3::from(normals[t[0] as usize].map(f64::from));
        assert!((b - a).cross(c - a).dot(n) > 0.5, "{t:?}");
        // The inverse transpose: z by -1/2, then half a turn about z; stored in f32.
        assert!((n - DVec3::new(-0.6, 0.0, -0.4).normalize()).length() < 1e-6, "{n}");
    }
}

#[test]
fn gltf_materials_color_and_texture() {
    let mut data = floats(&QUAD);
    data.extend(floats(&[0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
    data.extend([255, 0, 0, 128].repeat(4));
    let image = png(&[[0, 255, 0], [0, 0, 255]]);
    let hex: String = image.iter().map(|b| format!("%{b:02x}")).collect();
    let text = gltf(
        &data,
        &[(0, 4, 5126, "VEC3"), (48, 4, 5126, "VEC2"), (80, 4, 5121, "VEC4")],
        &format!(
            r#""meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0, "TEXCOORD_0": 1, "COLOR_0": 2}},
             "mode": 5, "material": 0}}]}}],
          "materials": [{{"alphaMode": "BLEND", "pbrMetallicRoughness": {{"baseColorFactor": [0.5, 1, 1, 0.5],
          "baseColorTexture":
             {{"index": 0, "extensions": {{"KHR_texture_transform": {{"offset": [0.5, 0]}}}}}}}}}}],
          "textures": [{{"source": 0}}], "images": [{{"uri": "data:image/png,{hex}"}}], "nodes": [{{"mesh": 0}}]"#
        ),
    )
    .replace(
        r#""componentType": 5121, "type": "VEC4""#,
        r#""componentType": 5121, "normalized": true, "type": "VEC4""#,
    );
    let m = mesh(load(Format::Gltf, text));
    assert_eq!(m.texture.unwrap().srgba8, [[0, 255, 0, 255], [0, 0, 255, 255]]);
    assert_eq!(m.uvs.unwrap()[0], [0.75, 0.0]);
    assert_eq!(m.colors.unwrap()[0], [0.5, 0.0, 0.0]);
    // 128/255 times ½.
    assert!((m.alphas.unwrap()[0] - 0.250_980_4).abs() < 1e-6);
}

#[test]
fn gltf_points_and_glb() {
    let json = r#"{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 24}],
        "bufferViews": [{"buffer": 0, "byteLength": 24}],
        "accessors": [{"bufferView": 0, "count": 2, "componentType": 5126, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}], "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}]}"#;
    let json = format!("{json:<width$}", width = json.len().next_multiple_of(4));
    let data = floats(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    let mut glb = b"glTF\x02\0\0\0".to_vec();
    glb.extend((28 + json.len() as u32 + 24).to_le_bytes());
    glb.extend((json.len() as u32).to_le_bytes());
    glb.extend(b"JSON");
    glb.extend(json.as_bytes());
    glb.extend(24_u32.to_le_bytes());
    glb.extend(b"BIN\0");
    glb.extend(&data);
    let loaded = load_bytes(&glb, None, Path::new("t"), &LoadOptions::default()).unwrap();
    assert_eq!(loaded.format, Format::Glb);
    assert_eq!(points(loaded).positions.get(1), DVec3::new(4.0, 5.0, 6.0));
    for end in 4..glb.len() {
        let error = try_load(Format::Glb, &glb[..end]).unwrap_err();
        let is_whole_before = end >= 20 + json.len();
        assert!(!is_whole_before || error.contains("cut off: copy"), "{end}: {error}");
    }
    // The same document with an external buffer.
    let folder = Folder::new("gltf");
    folder.write("a b.bin", &data);
    let text = json.replace(r#"{"byteLength": 24}"#, r#"{"byteLength": 24, "uri": "a%20b.bin"}"#);
    let cloud = points(load_file(&folder.write("a.gltf", &text), &LoadOptions::default()).unwrap());
    assert_eq!(cloud.len(), 2);
    assert!(try_load(Format::Gltf, text).unwrap_err().contains("keep the .bin file beside"));
}

#[test]
fn gltf_gaussian_splats_are_lifted() {
    let mut data = floats(&[1.0, 2.0, 3.0]); // position
    data.extend(floats(&[0.0, 0.0, 0.0, 1.0])); // rotation, at 12
    data.extend(floats(&[0.1, 0.2, 0.0])); // scale, at 28
    data.extend(floats(&[0.75])); // opacity, at 40
    data.extend(floats(&[0.0, 9.0, -9.0])); // colour, at 44
    let text = gltf(
        &data,
        &[
            (0, 1, 5126, "VEC3"),
            (12, 1, 5126, "VEC4"),
            (28, 1, 5126, "VEC3"),
            (40, 1, 5126, "SCALAR"),
            (44, 1, 5126, "VEC3"),
        ],
        r#""extensionsUsed": ["KHR_gaussian_splatting"], "nodes": [{"mesh": 0, "scale": [2, 2, 2]}],
          "meshes": [{"primitives": [{"mode": 0, "attributes": {"POSITION": 0, "KHR_gaussian_splatting:ROTATION": 1,
             "KHR_gaussian_splatting:SCALE": 2, "KHR_gaussian_splatting:OPACITY": 3,
             "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0": 4},
             "extensions": {"KHR_gaussian_splatting": {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}}}]}]"#,
    );
    let cloud = splats(load(Format::Gltf, &text));
    let (s, t) = cloud.axes(0);
    // Two standard deviations, doubled by the node; stored in f32.
    assert!((s - DVec3::X * 0.4).length() < 1e-7 && (t - DVec3::Y * 0.8).length() < 1e-7, "{s} {t}");
    assert_eq!((cloud.color(0), cloud.alpha(0)), ([HALF, 1.0, 0.0], 0.75));
    let error = try_load(Format::Gltf, text.replace(":SCALE", ":SIZE")).unwrap_err();
    assert!(error.contains("without KHR_gaussian_splatting:SCALE"), "{error}");
    let start = text.find(r#"{"mode": 0"#).unwrap();
    let primitive = &text[start..start + text[start..].find("}}}").unwrap() + 3];
    let both = text.replace(primitive, &format!("{primitive}, {}", primitive.replace("srgb_", "lin_")));
    let error = try_load(Format::Gltf, both).unwrap_err();
    assert!(error.contains("different values of \"colorSpace\""), "{error}");
    let twice = text.replace(primitive, &format!("{primitive}, {primitive}"));
    assert_eq!(splats(load(Format::Gltf, twice)).len(), 2);
}

#[test]
fn gltf_faults_are_errors() {
    let ok = gltf(
        &floats(&QUAD),
        &[(0, 4, 5126, "VEC3")],
        r#""meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}]"#,
    );
    assert!(try_load(Format::Gltf, &ok).is_ok());
    for (from, to, expected) in [
        (r#""2.0""#, r#""1.0""#, "version is '1.0'"),
        (r#""count": 4"#, r#""count": 5"#, "reaches beyond bufferView 0"),
        (r#""count": 4"#, r#""count": 18446744073709551615"#, "reaches beyond bufferView 0"),
        (r#""count": 4"#, r#""count": -4"#, "not a valid glTF document"),
        (r#""byteOffset": 0"#, r#""byteOffset": 18446744073709551615"#, "reaches beyond bufferView 0"),
        (r#""bufferView": 0, "#, r#""bufferView": 7, "#, "bufferView 7 does not exist"),
        (r#""bufferView": 0, "byteOffset": 0, "count": 4"#, r#""count": 4000000000"#, "and no data"),
        (r#""POSITION": 0"#, r#""POSITION": 3"#, "accessor 3 does not exist"),
        (r#""VEC3""#, r#""MAT4""#, "is 'MAT4' of type 5126"),
        (r#"{"mesh": 0}"#, r#"{"mesh": 0, "children": [1]}, {"children": [0]}"#, "nothing to draw"),
        (r#"{"mesh": 0}"#, r#"{"children": [1, 1]}, {"mesh": 0}"#, "node 1 appears twice"),
        (r#"{"mesh": 0}"#, r#"{"mesh": 9}"#, "mesh 9 does not exist"),
        (r#""POSITION": 0}"#, r#""POSITION": 0}, "mode": 9"#, "mode 9"),
        (r#""POSITION": 0}"#, r#""POSITION": 0}, "indices": 0"#, "no plain indices"),
        (r#""meshes""#, r#""extensionsRequired": ["EXT_unheard_of"], "meshes""#, "requires the glTF extension"),
        ("}", "", "not a valid glTF document"),
    ] {
        let error = try_load(Format::Gltf, ok.replacen(from, to, 1)).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn format_is_told_by_content_before_the_extension() {
    let detect = |bytes: &[u8]| load_bytes(bytes, None, Path::new("t"), &LoadOptions::default()).map(|l| l.format);
    assert_eq!(detect(b"# c\n\nv 0 0 0\n").unwrap(), Format::Obj);
    assert_eq!(detect(b"\n# c\n 1 2 3\n").unwrap(), Format::Xyz);
    let ply = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float \
                z\nend_header\n1 2 3";
    assert_eq!(load(Format::Obj, ply).format, Format::Ply);
    for (bytes, expected) in [(&b"# .PCD v.7"[..], "PCD"), (b"\x89PNG", "PNG image"), (b"\x00\x01\x02", "in no format")]
    {
        let error = detect(bytes).unwrap_err();
        assert!(error.is_bad_input() && error.to_string().contains(expected), "{error}");
    }
    let error = load_file(Path::new("no/such/file.ply"), &LoadOptions::default()).unwrap_err();
    assert!(error.is_bad_input() && error.to_string().starts_with("no/such/file.ply: cannot read it: "), "{error}");
    assert_eq!(Format::from_extension(Path::new("a/B.GLB")), Some(Format::Glb));
}
