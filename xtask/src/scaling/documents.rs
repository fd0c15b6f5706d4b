//! Shapes of files with many parts: PLY, OBJ, glTF, 3D Tiles, NPZ and E57.

use super::Shape;
use std::fmt::Write;
use std::io;
use std::path::Path;

/// Splits a command into its words.
pub(super) fn words(command: &str) -> Vec<String> {
    command.split_whitespace().map(str::to_owned).collect()
}

/// Returns `n` numbered texts, joined by commas.
fn list(n: usize, text: impl Fn(usize) -> String) -> String {
    (0..n).map(text).collect::<Vec<_>>().join(",")
}

/// Writes a text PLY file with additional lines in the header, and additional values in each of its ten rows.
fn ply(folder: &Path, lines: &str, values: &str) -> io::Result<Vec<String>> {
    let mut text = String::from("ply\nformat ascii 1.0\nelement vertex 10\nproperty float x\nproperty float y\n");
    let _ = write!(text, "property float z\n{lines}end_header\n");
    (0..10).for_each(|i| _ = writeln!(text, "{i} {} {}{values}", i % 3, i % 4));
    std::fs::write(folder.join("in.ply"), text)?;
    Ok(words("info in.ply --json"))
}

fn lines(n: usize, text: impl Fn(usize) -> String) -> String {
    (0..n).map(|i| text(i) + "\n").collect()
}

fn ply_comments(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    ply(folder, &lines(n, |i| format!("comment number {i}")), "")
}

fn ply_properties(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    ply(folder, &lines(n, |i| format!("property float p{i}")), &" 1".repeat(n))
}

fn ply_elements(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    ply(folder, &lines(n, |i| format!("element e{i} 0\nproperty float a")), "")
}

fn ply_textures(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    ply(folder, &lines(n, |i| format!("comment TextureFile t{i}.png")), "")
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n";
const CONVERT: &str = "convert in.obj -o out.ply --force --per-face";

/// Writes an OBJ file of `n` faces and its material library. `before` returns the lines before each face.
fn obj(folder: &Path, n: usize, library: &str, before: impl Fn(usize) -> String) -> io::Result<Vec<String>> {
    let faces = lines(n, |i| before(i) + "\nf 1/1 2/2 3/3");
    std::fs::write(folder.join("in.obj"), format!("mtllib in.mtl\n{TRIANGLE}{faces}"))?;
    std::fs::write(folder.join("in.mtl"), library)?;
    Ok(words(CONVERT))
}

fn obj_groups(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    obj(folder, n, "newmtl a\n", |i| format!("o o{i}\ng g{i}\ns {i}\nusemtl a"))
}

fn obj_materials(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    obj(folder, n, &lines(n, |i| format!("newmtl m{i}\nKd 0.5 0.5 0.5")), |i| format!("usemtl m{i}"))
}

/// Writes an OBJ file in which every material has its own image of 2×2 pixels.
fn obj_textures(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let image = png();
    (0..n).try_for_each(|i| std::fs::write(folder.join(format!("t{i}.png")), &image))?;
    obj(folder, n, &lines(n, |i| format!("newmtl m{i}\nmap_Kd t{i}.png")), |i| format!("usemtl m{i}"))
}

/// Writes an OBJ file in which all materials have the same image.
fn obj_shared_texture(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    std::fs::write(folder.join("t.png"), png())?;
    obj(folder, n, &lines(n, |i| format!("newmtl m{i}\nmap_Kd t.png")), |i| format!("usemtl m{i}"))
}

fn obj_missing_materials(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    obj(folder, n, "newmtl a\n", |i| format!("usemtl m{i}"))
}

fn obj_libraries(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    std::fs::write(folder.join("in.obj"), lines(n, |i| format!("mtllib l{i}.mtl")) + TRIANGLE + "f 1 2 3\n")?;
    Ok(words(CONVERT))
}

fn obj_unknown_lines(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    std::fs::write(folder.join("in.obj"), lines(n, |i| format!("what{i} 1 2 3")) + TRIANGLE + "f 1 2 3\n")?;
    Ok(words(CONVERT))
}

/// Returns a PNG image of 2×2 pixels, in an uncompressed block.
fn png() -> Vec<u8> {
    let rows = [0, 255, 0, 0, 0, 255, 0, 0, 0, 0, 255, 9, 9, 9];
    let (a, b) =
        rows.iter().fold((1_u32, 0_u32), |(a, b), x| ((a + u32::from(*x)) % 65_521, (b + a + u32::from(*x)) % 65_521));
    let length = (rows.len() as u16).to_le_bytes();
    let not = (!(rows.len() as u16)).to_le_bytes();
    let packed = [&[0x78, 1, 1][..], &length, &not, &rows, &(b << 16 | a).to_be_bytes()].concat();
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    for (kind, data) in [(b"IHDR", &[0, 0, 0, 2, 0, 0, 0, 2, 8, 2, 0, 0, 0][..]), (b"IDAT", &packed), (b"IEND", &[])] {
        file.extend((data.len() as u32).to_be_bytes());
        file.extend(kind);
        file.extend(data);
        let all = kind.iter().chain(data);
        file.extend((!all.fold(!0, |crc, byte| crc_step(crc, *byte, 0xedb8_8320))).to_be_bytes());
    }
    file
}

fn crc_step(crc: u32, byte: u8, polynomial: u32) -> u32 {
    (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (polynomial & (crc & 1).wrapping_neg()))
}

/// Writes a glTF file with the top-level members `parts`, and a buffer that contains one triangle. Returns the words of
/// the command that converts it.
fn gltf(folder: &Path, parts: &str) -> io::Result<Vec<String>> {
    let positions = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    let bytes: Vec<u8> = positions.iter().flat_map(|x| x.to_le_bytes()).collect();
    std::fs::write(folder.join("in.bin"), bytes)?;
    let buffer = r#""asset":{"version":"2.0"},"buffers":[{"uri":"in.bin","byteLength":48}]"#;
    std::fs::write(folder.join("in.gltf"), format!("{{{buffer},{parts}}}"))?;
    Ok(words("convert in.gltf -o out.ply --force --per-face"))
}

const VIEW: &str = r#""bufferViews":[{"buffer":0,"byteLength":36}]"#;
const ACCESSOR: &str = r#"{"bufferView":0,"count":3,"componentType":5126,"type":"VEC3"}"#;
const MESH: &str = r#""meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}]"#;

fn gltf_nodes(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let nodes = list(n, |i| format!(r#"{{"mesh":0,"name":"n{i}","translation":[{i},0,0]}}"#));
    let roots = list(n, |i| i.to_string());
    gltf(
        folder,
        &format!(r#"{VIEW},"accessors":[{ACCESSOR}],{MESH},"nodes":[{nodes}],"scenes":[{{"nodes":[{roots}]}}]"#),
    )
}

/// Writes a glTF file with a chain of nodes, each the child of the previous one.
fn gltf_chain(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let nodes = list(n, |i| {
        let children = if i + 1 < n { format!(r#","children":[{}]"#, i + 1) } else { String::new() };
        format!(r#"{{"mesh":0,"translation":[0.001,0,0]{children}}}"#)
    });
    gltf(folder, &format!(r#"{VIEW},"accessors":[{ACCESSOR}],{MESH},"nodes":[{nodes}],"scenes":[{{"nodes":[0]}}]"#))
}

/// Writes a glTF file in which every node has its own mesh, accessor and buffer view.
fn gltf_accessors(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let views = list(n, |_| r#"{"buffer":0,"byteLength":36}"#.into());
    let accessors = list(n, |i| ACCESSOR.replace(r#"View":0"#, &format!(r#"View":{i}"#)));
    let meshes = list(n, |i| format!(r#"{{"primitives":[{{"attributes":{{"POSITION":{i}}}}}]}}"#));
    let nodes = list(n, |i| format!(r#"{{"mesh":{i},"translation":[{i},0,0]}}"#));
    let roots = list(n, |i| i.to_string());
    gltf(
        folder,
        &format!(
            r#""bufferViews":[{views}],"accessors":[{accessors}],"meshes":[{meshes}],"nodes":[{nodes}],
                "scenes":[{{"nodes":[{roots}]}}]"#
        ),
    )
}

/// Writes a glTF mesh of `n` primitives, each with its own material. All materials have the same texture, or each has
/// its own missing texture.
fn gltf_materials(folder: &Path, n: usize, is_missing: bool) -> io::Result<Vec<String>> {
    std::fs::write(folder.join("t.png"), png())?;
    let own = |i: usize| if is_missing { i } else { 0 };
    let count = if is_missing { n } else { 1 };
    let primitives = list(n, |i| format!(r#"{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"material":{i}}}"#));
    let materials = list(n, |i| format!(r#"{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":{}}}}}}}"#, own(i)));
    let textures = list(count, |i| format!(r#"{{"source":{i}}}"#));
    let images =
        list(count, |i| if is_missing { format!(r#"{{"uri":"m{i}.png"}}"#) } else { r#"{"uri":"t.png"}"#.into() });
    let uvs = r#"{"bufferView":0,"count":3,"componentType":5126,"type":"VEC2"}"#;
    gltf(
        folder,
        &format!(
            r#"{VIEW},"accessors":[{ACCESSOR},{uvs}],"meshes":[{{"primitives":[{primitives}]}}],
                "materials":[{materials}],"textures":[{textures}],"images":[{images}],"nodes":[{{"mesh":0}}],
                "scenes":[{{"nodes":[0]}}]"#
        ),
    )
}

/// Writes a glTF mesh with `n` morph targets.
fn gltf_targets(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let targets = list(n, |_| r#"{"POSITION":0}"#.into());
    let weights = list(n, |_| "0.001".into());
    gltf(
        folder,
        &format!(
            r#"{VIEW},"accessors":[{ACCESSOR}],"meshes":[{{"weights":[{weights}],
                "primitives":[{{"attributes":{{"POSITION":0}},"targets":[{targets}]}}]}}],
                "nodes":[{{"mesh":0}}],"scenes":[{{"nodes":[0]}}]"#
        ),
    )
}

/// Writes a glTF primitive with `n` attributes of one number per vertex.
fn gltf_attributes(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let attributes = list(n, |i| format!(r#""_A{i}":1"#));
    let scalar = r#"{"bufferView":0,"count":3,"componentType":5126,"type":"SCALAR"}"#;
    gltf(
        folder,
        &format!(
            r#"{VIEW},"accessors":[{ACCESSOR},{scalar}],
                "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,{attributes}}}}}]}}],
                "nodes":[{{"mesh":0}}],"scenes":[{{"nodes":[0]}}]"#
        ),
    )
}

/// Writes a tileset of `n` tiles with the same bounds that share one content file.
fn tiles(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let positions: Vec<u8> = (0..30).flat_map(|i| (i as f32).to_le_bytes()).collect();
    let features = format!("{:<50}", r#"{"POINTS_LENGTH":10,"POSITION":{"byteOffset":0}}"#);
    let mut tile = b"pnts".to_vec();
    let length = 28 + features.len() + positions.len();
    for number in [1, length, features.len(), positions.len(), 0, 0] {
        tile.extend((number as u32).to_le_bytes());
    }
    tile.extend([features.as_bytes(), &positions].concat());
    std::fs::write(folder.join("t.pnts"), tile)?;
    let volume = r#""boundingVolume":{"box":[0,0,0,9,0,0,0,9,0,0,0,9]},"geometricError":0"#;
    let children = list(n, |_| format!(r#"{{{volume},"content":{{"uri":"t.pnts"}}}}"#));
    let json = format!(
        r#"{{"asset":{{"version":"1.0"}},"geometricError":1,
            "root":{{{volume},"refine":"ADD","children":[{children}]}}}}"#
    );
    std::fs::write(folder.join("tileset.json"), json)?;
    Ok(words("info tileset.json --json"))
}

/// Writes an NPZ file of `n` arrays of ten numbers.
fn npz_arrays(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let npy = |shape: &str, numbers: usize| {
        let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}\n");
        let data: Vec<u8> = (0..numbers).flat_map(|i| (i as f32 % 7.0).to_le_bytes()).collect();
        [b"\x93NUMPY\x01\0", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), &data].concat()
    };
    let column = npy("10,", 10);
    let files = (0..n).map(|i| (format!("a{i}.npy"), column.clone()));
    zip(&folder.join("in.npz"), std::iter::once(("points.npy".to_owned(), npy("10, 3", 30))).chain(files))?;
    Ok(words("info in.npz --json"))
}

/// Writes a ZIP file that stores these files without compression.
fn zip(path: &Path, files: impl Iterator<Item = (String, Vec<u8>)>) -> io::Result<()> {
    let (mut zip, mut directory, mut count) = (Vec::new(), Vec::new(), 0_u16);
    for (name, content) in files {
        let start = (zip.len() as u32).to_le_bytes();
        let crc = !content.iter().fold(!0, |crc, byte| crc_step(crc, *byte, 0xedb8_8320));
        let size = (content.len() as u32).to_le_bytes();
        let sizes = [&crc.to_le_bytes()[..], &size, &size, &(name.len() as u16).to_le_bytes(), &[0, 0]].concat();
        zip.extend([b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0", &sizes[..], name.as_bytes(), &content].concat());
        let head = b"PK\x01\x02\x14\0\x14\0\0\0\0\0\0\0\0\0";
        directory.extend([&head[..], &sizes, &[0; 10], &start, name.as_bytes()].concat());
        count = count.wrapping_add(1);
    }
    let (size, start) = ((directory.len() as u32).to_le_bytes(), (zip.len() as u32).to_le_bytes());
    let count = count.to_le_bytes();
    zip.extend([&directory[..], b"PK\x05\x06\0\0\0\0", &count, &count, &size, &start, &[0, 0]].concat());
    std::fs::write(path, zip)
}

/// Writes an E57 file of scans without points. `fields` is the number of fields per point besides the coordinates.
fn e57(folder: &Path, fields: usize, scans: usize) -> io::Result<Vec<String>> {
    let prototype: String = (0..fields).map(|i| format!(r#"<f{i} type="Float"/>"#)).collect();
    let axes = r#"<cartesianX type="Float"/><cartesianY type="Float"/><cartesianZ type="Float"/>"#;
    let scan = format!(
        r#"<vectorChild type="Structure"><guid type="String"><![CDATA[g]]></guid>
            <points type="CompressedVector" fileOffset="48" recordCount="0">
            <prototype type="Structure">{axes}{prototype}</prototype>
            <codecs type="Vector" allowHeterogeneousChildren="1"></codecs></points></vectorChild>"#
    );
    let xml = format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
            <e57Root type="Structure" xmlns="http://www.astm.org/COMMIT/E57/2010-e57-v1.0">
            <formatName type="String"><![CDATA[ASTM E57 3D Imaging Data File]]></formatName>
            <guid type="String"><![CDATA[g]]></guid><versionMajor type="Integer">1</versionMajor>
            <versionMinor type="Integer">0</versionMinor>
            <data3D type="Vector" allowHeterogeneousChildren="1">{}</data3D></e57Root>"#,
        scan.repeat(scans)
    );
    // An empty section of points precedes the XML text.
    let section: Vec<u8> = [1_u64, 32, 80, 0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let pages = (48 + section.len() + xml.len()).div_ceil(1020);
    let mut content = b"ASTM-E57\x01\0\0\0\0\0\0\0".to_vec();
    for number in [1024 * pages as u64, 48 + section.len() as u64, xml.len() as u64, 1024] {
        content.extend(number.to_le_bytes());
    }
    content.extend([&section, xml.as_bytes()].concat());
    content.resize(1020 * pages, 0);
    let mut file = Vec::with_capacity(1024 * pages);
    for page in content.chunks_exact(1020) {
        let crc = !page.iter().fold(!0, |crc, byte| crc_step(crc, *byte, 0x82f6_3b78));
        file.extend([page, &crc.to_be_bytes()].concat());
    }
    std::fs::write(folder.join("in.e57"), file)?;
    Ok(words("info in.e57 --json"))
}

pub(super) fn shapes() -> Vec<Shape> {
    type Command = fn(&Path, usize) -> io::Result<Vec<String>>;
    let all: [(&str, usize, &str, Command); 23] = [
        ("PLY header of many comments", 5000, "comments", ply_comments),
        ("PLY header of many properties", 4000, "properties", ply_properties),
        ("PLY header of many elements", 3500, "elements", ply_elements),
        ("PLY header of many textures", 4000, "textures", ply_textures),
        ("OBJ of many groups", 40_000, "groups", obj_groups),
        ("OBJ of many materials", 20_000, "materials", obj_materials),
        ("OBJ of many textures", 1000, "images", obj_textures),
        ("OBJ of many materials with one texture", 20_000, "materials", obj_shared_texture),
        ("OBJ of many missing materials", 10_000, "materials", obj_missing_materials),
        ("OBJ of many missing libraries", 4000, "libraries", obj_libraries),
        ("OBJ of many unknown lines", 40_000, "lines", obj_unknown_lines),
        ("glTF of many nodes", 10_000, "nodes", gltf_nodes),
        ("glTF of a deep chain", 4000, "nodes", gltf_chain),
        ("glTF of many accessors", 10_000, "accessors", gltf_accessors),
        ("glTF of many materials with one texture", 4000, "materials", |folder, n| gltf_materials(folder, n, false)),
        ("glTF of many missing images", 4000, "images", |folder, n| gltf_materials(folder, n, true)),
        ("glTF of many morph targets", 10_000, "targets", gltf_targets),
        ("glTF of many attributes", 16_000, "attributes", gltf_attributes),
        ("3D Tiles of many tiles", 4000, "tiles", tiles),
        ("NPZ of many arrays", 4000, "arrays", npz_arrays),
        ("E57 of many scans", 4000, "scans", |folder, n| e57(folder, 0, n)),
        ("E57 of many fields", 20_000, "fields", |folder, n| e57(folder, n, 1)),
        ("E57 of many wide scans", 30, "scans", |folder, n| e57(folder, 500, n)),
    ];
    let shape = |(name, n, counts, make)| Shape::new(name, (n, counts), make);
    // These E57 files have no points, so the program refuses them.
    let of = |shape: Shape| if shape.name.starts_with("E57") { shape.refused() } else { shape };
    all.into_iter().map(shape).map(of).collect()
}
