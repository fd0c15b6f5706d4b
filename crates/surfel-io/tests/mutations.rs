//! Damaged files of every format: no reader panics, hangs, or takes much memory. Fixed seeds make each run the same;
//! `fuzz/` has the same readers for a coverage-guided fuzzer, and `finds/` the inputs that it has found.

#![cfg(all(
    feature = "draco",
    feature = "e57",
    feature = "exr",
    feature = "gaussians",
    feature = "laz",
    feature = "meshopt",
    feature = "npy",
    feature = "obj",
    feature = "off",
    feature = "pcd",
    feature = "points",
    feature = "stl",
    feature = "webp"
))]

use crate::support;

use std::path::Path;
use std::time::{Duration, Instant};
use surfel_io::{ExrOptions, Planes, PngOptions};
use surfel_io::{Format, LoadOptions, load_bytes, read_image_bytes, scene_file, write_exr, write_png};

/// Generator of reproducible random numbers: SplitMix64 (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// Words that are inserted into text files. They reach code of parsers that random bytes don't reach.
const WORDS: [&[u8]; 24] = [
    b"-1",
    b"0",
    b"99999999999999999999",
    b"4294967295",
    b"-2147483648",
    b"nan",
    b"inf",
    b"1e999",
    b"\n",
    b" ",
    b"\r",
    b"{",
    b"}",
    b"[",
    b"]",
    b"\"",
    b",",
    b"end_header\n",
    b"property list uchar int vertex_indices\n",
    b"element vertex 1000000000\n",
    b"\0\0\0\0",
    b"\xff\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"#",
];

fn mutate(random: &mut Random, seed: &[u8]) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    for _ in 0..=random.below(6) {
        let at = random.below(bytes.len() + 1);
        match random.below(7) {
            0 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
            1 if at < bytes.len() => bytes[at] = random.next() as u8,
            2 => bytes.truncate(at),
            3 => {
                let word = WORDS[random.below(WORDS.len())];
                bytes.splice(at..at, word.iter().copied());
            }
            4 => {
                let word = WORDS[random.below(WORDS.len())];
                let end = bytes.len().min(at + word.len());
                bytes.splice(at..end, word.iter().copied());
            }
            5 => {
                let end = at + random.below((bytes.len() - at).min(40) + 1);
                bytes.drain(at..end);
            }
            _ => {
                let end = at + random.below((bytes.len() - at).min(40) + 1);
                let copy = bytes[at..end].to_vec();
                let to = random.below(bytes.len() + 1);
                bytes.splice(to..to, copy);
            }
        }
    }
    bytes
}

fn damage(seeds: &[Vec<u8>], rounds: usize, read: impl Fn(&[u8])) {
    let mut random = Random(7);
    for seed in seeds {
        read(seed);
        for _ in 0..rounds {
            let bytes = mutate(&mut random, seed);
            let start = Instant::now();
            read(&bytes);
            // These inputs have a few hundred bytes: time that exceeds seconds depends on a number in them, not on the
            // data.
            assert!(start.elapsed() < Duration::from_secs(2), "slow: {:?}", String::from_utf8_lossy(&bytes));
        }
    }
}

fn load_as(format: Option<Format>) -> impl Fn(&[u8]) {
    move |bytes| {
        for repair in [false, true] {
            let options = LoadOptions { repair, gaussians: repair, ..LoadOptions::default() };
            match load_bytes(bytes, format, Path::new("t"), &options) {
                Ok(loaded) => drop(loaded),
                Err(error) => {
                    let text = error.to_string();
                    let printable = text.chars().all(|c| c == '\n' || !c.is_control());
                    assert!(text.lines().count() <= 4 && printable, "{text:?}");
                }
            }
        }
    }
}

fn ply_seeds() -> Vec<Vec<u8>> {
    let text = |properties: &str, rest: &str| {
        let properties: String = properties.split(' ').map(|p| format!("property float {p}\n")).collect();
        format!("ply\nformat ascii 1.0\ncomment up +z\nelement vertex 2\n{properties}{rest}").into_bytes()
    };
    let mut seeds = vec![
        text("x y z nx ny nz radius", "end_header\n0 0 0 0 0 1 1\n1 2 3 1 0 0 0.5\n"),
        text(
            "x y z su sv sw tu tv tw clip_line0_a clip_line0_b clip_line0_c clip_mode",
            "end_header\n0 0 0 1 0 0 0 1 0 1 0 0 1\n0 0 0 1 0 0 0 1 0 1 0 0 0\n",
        ),
        text("x y z", "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 1 1\n3 0 1 0\n"),
        text(
            "x y z",
            "element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 1 1\n5 0 1 0 -1 1\n",
        ),
        text(
            "x y z opacity scale_0 scale_1 rot_0 rot_1 rot_2 rot_3 f_dc_0 f_dc_1 f_dc_2",
            "end_header\n0 0 0 1 -1 -1 1 0 0 0 0 0 0\n1 1 1 1 -1 -1 1 0 0 0 0 0 0\n",
        ),
    ];
    let mut binary = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty double \
                       y\nproperty ushort z\nelement face 2\nproperty list uchar uint \
                       vertex_index\nend_header\n"
        .to_vec();
    binary.extend([0; 3 * 14]);
    binary.extend([3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 0]);
    seeds.push(binary);
    seeds
}

#[test]
fn mutations_of_ply() {
    damage(&ply_seeds(), 20_000, load_as(Some(Format::Ply)));
}

#[test]
fn mutations_of_points_obj_and_stl() {
    damage(
        &[
            b"# c\n1 2 3 10 255 0 0 0 0 1\n4 5 6 10 255 0 0 0 0 1\n".to_vec(),
            b"2\n1,2,3\n4;5;6\n".to_vec(),
            b"x,y,z,nx,ny,nz,i\n1 2 3 0 0 1 5\n".to_vec(),
        ],
        4000,
        load_as(Some(Format::Pts)),
    );
    damage(
        &[b"mtllib a.mtl\nv 0 0 0 1 0 1\nv 1 0 0\nv 0 1 0\nvt 0 1\nvn 0 0 1\nusemtl a\nf 1/1/1 2/1/1 3/1/1\nf -1 -2 \
            \\\n-3\n"
            .to_vec()],
        8000,
        load_as(Some(Format::Obj)),
    );
    let mut binary = vec![0; 80];
    binary.extend(2_u32.to_le_bytes());
    binary.extend((0..100_u8).map(|i| i.wrapping_mul(5)));
    damage(
        &[
            b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 \
            0\nendloop\nendfacet\nendsolid\n"
                .to_vec(),
            binary,
        ],
        4000,
        load_as(Some(Format::Stl)),
    );
}

#[test]
fn mutations_of_gltf() {
    let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"children":[1],
    "scale":[1,2,3]},{"rotation":[0,0,0,1]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"COLOR_0":2,"TEXCOORD_0":3},"indices":1,"material":0,"mode":4}]}],
"materials":[{"pbrMetallicRoughness":{"baseColorFactor":[1,1,1,0.5],"baseColorTexture":{"index":0}}}],
"textures":[{"source":0}],"images":[{"bufferView":1}],
"accessors":[{"bufferView":0,"count":3,"componentType":5126,"type":"VEC3"},{"bufferView":1,"count":3,
"componentType":5121,"type":"SCALAR"},
{"bufferView":0,"count":3,"componentType":5121,"normalized":true,"type":"VEC4"},
{"count":3,"componentType":5126,"type":"VEC2","sparse":{"count":1,"indices":{"bufferView":1,"componentType":5121},
"values":{"bufferView":0}}}],
"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":4}],
"buffers":[{"byteLength":40,
"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAECAA=="}]}"#;
    damage(&[json.as_bytes().to_vec()], 12_000, load_as(Some(Format::Gltf)));
    let mut glb = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    glb.extend((json.len() as u32).to_le_bytes());
    glb.extend(b"JSON");
    glb.extend(json.as_bytes());
    damage(&[glb], 4000, load_as(None));
    let tile = |body: &str| {
        let json = format!(r#"{{"POINTS_LENGTH":2,"POSITION":{{"byteOffset":0}},"RGB565":{{"byteOffset":24}}{body}}}"#);
        let mut tile = b"pnts\x01\0\0\0\0\0\0\0".to_vec();
        for length in [json.len() as u32, 28, 0, 0] {
            tile.extend(length.to_le_bytes());
        }
        tile.extend(json.as_bytes());
        tile.extend([7; 28]);
        tile
    };
    damage(&[tile(""), tile(r#","RTC_CENTER":[1,2,3]"#)], 6000, load_as(None));
    let tileset = br#"{"asset":{"gltfUpAxis":"z"},"geometricError":1,"root":{"refine":"ADD",
"transform":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],
"boundingVolume":{"box":[0,0,0,1,0,0,0,1,0,0,0,1]},"contents":[{"uri":"a"}],"children":[{"content":{"url":"b"}}]}}"#;
    damage(&[tileset.to_vec()], 6000, load_as(Some(Format::Tileset)));
}

/// Builds a GLB file of this document, with these bytes as buffer.
fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut glb = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, chunk) in [(b"JSON", json.as_bytes()), (b"BIN\0", binary)] {
        glb.extend((chunk.len() as u32).to_le_bytes());
        glb.extend(kind);
        glb.extend(chunk);
    }
    glb
}

#[test]
fn mutations_of_skins_morph_targets_and_extensions() {
    let json = r#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_mesh_quantization"],"scenes":[{"nodes":[0,1]}],
"nodes":[{"mesh":0,"skin":0,"weights":[0.5]},{"children":[2]},{"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}],
"skins":[{"joints":[1,2],"inverseBindMatrices":1}],"meshes":[{"weights":[1],"primitives":[{"attributes":{"POSITION":0,
"JOINTS_0":2,"WEIGHTS_0":2},
"targets":[{"POSITION":0,"NORMAL":0}],"material":0}]}],"materials":[{"extensions":{"KHR_materials_sheen":{},
"KHR_materials_pbrSpecularGlossiness":
{"diffuseTexture":{"index":0,"extensions":{"KHR_texture_transform":{"scale":[1,2]}}}}}}],
"textures":[{"extensions":{"KHR_texture_basisu":{}}}],
"accessors":[{"bufferView":0,"count":3,"componentType":5126,"type":"VEC3"},{"bufferView":1,"count":2,
"componentType":5126,"type":"MAT4"},
{"bufferView":2,"count":3,"componentType":5121,"normalized":true,"type":"VEC4"}],"buffers":[{"byteLength":176}],
"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":128},{"buffer":0,
"byteOffset":164,"byteLength":12}]}"#;
    let binary: Vec<u8> = (0..176_u32).map(|i| if i % 4 == 3 { 63 } else { i as u8 }).collect();
    damage(&[glb(json, &binary)], 12_000, load_as(None));
}

#[test]
fn mutations_of_compressed_meshes() {
    let stream = include_bytes!("data/square.drc");
    let draco = |stream: &[u8]| {
        let json = format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":0}}],"bufferViews":[{{"buffer":0,
            "byteLength":{}}}],
"accessors":[{{"componentType":5126,"type":"VEC3","count":4}}],"nodes":[{{"mesh":0}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},
"extensions":{{"KHR_draco_mesh_compression":{{"bufferView":0,"attributes":{{"POSITION":0}}}}}}}}]}}]}}"#,
            stream.len()
        );
        glb(&json, stream)
    };
    damage(&[stream.to_vec()], 20_000, |bytes| load_as(None)(&draco(bytes)));
    for (mode, filter, start) in [
        ("ATTRIBUTES", "NONE", 0xa0),
        ("ATTRIBUTES", "COLOR", 0xa1),
        ("ATTRIBUTES", "QUATERNION", 0xa1),
        ("TRIANGLES", "NONE", 0xe1),
        ("INDICES", "NONE", 0xd1),
    ] {
        let stride = if mode == "ATTRIBUTES" { 8 } else { 4 };
        let meshopt = |stream: &[u8]| {
            let json = format!(
                r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":0}}],"bufferViews":[{{"buffer":0,
                "byteLength":{},
"extensions":{{"EXT_meshopt_compression":{{"buffer":0,"byteLength":{},"byteStride":{stride},"count":24,
"mode":"{mode}","filter":"{filter}"}}}}}}],
"accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","count":2}}],"nodes":[{{"mesh":0}}],
"meshes":[{{"primitives":[{{"mode":0,"attributes":{{"POSITION":0}}}}]}}]}}"#,
                stride * 24,
                stream.len()
            );
            glb(&json, stream)
        };
        let seed: Vec<u8> = std::iter::once(start).chain((0..90_u8).map(|i| i.wrapping_mul(37))).collect();
        damage(&[seed], 4000, |bytes| load_as(None)(&meshopt(bytes)));
    }
}

#[test]
fn mutations_of_scene_files() {
    let json = br#"{"camera":{"eye":[0,0,5],"target":[0,0,0],"projection":{"orthographic":{"height":2}},"far":9,
    "size":[64,48]},
"lights":[{"spot":{"position":[0,3,0],"direction":[0,-1,0],"inner_deg":20,"outer_deg":30}}],
"objects":[{"splats":"a.ply"}],"settings":{"transparency":"peel:3"}}"#;
    damage(&[json.to_vec()], 10_000, |bytes| drop(scene_file::parse(bytes, Path::new("t"))));
}

#[test]
#[ignore = "28 s: cargo xtask test --full"]
fn mutations_of_scans() {
    let file = |kind| support::las_file(kind, Vec::new(), 0..40, |_| ());
    // The last bytes of a compressed file are its chunk table.
    let cut = |kind| file(kind).split_last_chunk::<12>().unwrap().0.to_vec();
    let seeds = [
        file((2, 3, 0, false)),
        file((4, 7, 3, false)),
        file((2, 3, 2, true)),
        file((4, 8, 3, true)),
        cut((2, 3, 2, true)),
        cut((4, 8, 3, true)),
    ];
    damage(&seeds, 6000, load_as(None));
    // Damages the variable length records, LASzip's record and the first chunk's head: elsewhere most bytes are numbers
    // with any valid value.
    let mut random = Random(11);
    for seed in &seeds {
        for _ in 0..6000 {
            let mut bytes = seed.clone();
            for _ in 0..=random.below(3) {
                let at = 90 + random.below(bytes.len().min(560) - 90);
                bytes[at] = [0, 1, 2, 3, 4, 255, 128, random.next() as u8][random.below(8)];
            }
            load_as(None)(&bytes);
        }
    }
    // Pages with wrong checksums are refused unread, so the checksums are corrected.
    damage(&[support::small_e57()], 3000, |bytes| load_as(None)(&support::seal(bytes.to_vec())));
}

#[test]
fn mutations_of_what_is_written_by_levels() {
    use flate2::{Compression, write::GzEncoder};
    use std::io::Write;
    use surfel_io::copc::{CopcOptions, save_copc};
    let folder = std::env::temp_dir().join(format!("surfel-mutations-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let options = CopcOptions { overwrite: true, ..CopcOptions::default() };
    let write = |name: &str, bytes: &[u8]| {
        let (input, output) = (folder.join(name), folder.join("out.copc.laz"));
        std::fs::write(&input, bytes).unwrap();
        surfel_io::survey_points(&input, None);
        if let Err(error) = save_copc(&[input], &output, &options, None, &|_, _, _| ()) {
            let text = error.to_string();
            let printable = text.chars().all(|c| c == '\n' || !c.is_control());
            assert!(text.lines().count() <= 4 && printable && text.contains(name), "{text:?}");
        }
    };
    damage(&[support::small_e57()], 400, |bytes| write("a.e57", &support::seal(bytes.to_vec())));
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 6), }\n";
    let npy = [b"\x93NUMPY\x01\0", &[header.len() as u8, 0][..], header.as_bytes(), &[63; 48]].concat();
    damage(&[zip(&[("points.npy", &npy)])], 400, |bytes| write("a.npz", bytes));
    let scan = "2\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n5 6 7 1\n1 2 3 0.5\n0 0 0 0.5\n";
    damage(&[scan.as_bytes().to_vec()], 400, |bytes| write("a.ptx", bytes));
    let gzip = |content: &[u8]| {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(content).unwrap();
        encoder.finish().unwrap()
    };
    damage(&[gzip(scan.as_bytes())], 400, |bytes| write("a.ptx.gz", bytes));
    damage(&ply_seeds()[..1], 400, |bytes| write("a.ply.gz", &gzip(bytes)));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn mutations_of_images() {
    let n = 12 * 9;
    let planes = Planes {
        width: 12,
        height: 9,
        color: Some((0..n).map(|i| [i as f32 * 0.01; 4]).collect()),
        depth: Some((0..n).map(|i| i as f32).collect()),
        ..Planes::default()
    };
    let (mut exr, mut png) = (Vec::new(), Vec::new());
    write_exr(&mut exr, &planes.view(), &ExrOptions::default()).unwrap();
    write_png(&mut png, &planes.view(), &PngOptions::default()).unwrap();
    damage(&[exr, png], 4000, |bytes| drop(read_image_bytes(bytes, Path::new("t"))));
}

#[test]
fn mutations_of_pcd() {
    let header = |data: &str| {
        format!(
            "# .PCD v0.7\nFIELDS x y z rgb t\nSIZE 4 4 4 4 2\nTYPE F F F U U\nCOUNT 1 1 1 1 1\nWIDTH 2\nHEIGHT 1\n\
             VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA {data}\n"
        )
        .into_bytes()
    };
    let text = [&header("ascii")[..], b"1 2 3 255 7\nnan 2 3 65280 8\n"].concat();
    let rows: Vec<u8> = (0..36_u8).map(|i| i.wrapping_mul(37)).collect();
    let binary = [&header("binary")[..], &rows].concat();
    // Literals, a short reference, a long one.
    let stream = [3, 1, 2, 3, 4, 0x40, 3, 0xe0, 19, 0];
    let sizes = [(stream.len() as u32).to_le_bytes(), 36_u32.to_le_bytes()].concat();
    let packed = [&header("binary_compressed")[..], &sizes, &stream].concat();
    damage(&[text, binary, packed], 20_000, load_as(None));
}

#[test]
fn mutations_of_arrays() {
    let npy = |header: &str, data: usize| {
        let data: Vec<u8> = (0..data).map(|i| (i as u8).wrapping_mul(37)).collect();
        [b"\x93NUMPY\x01\0", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), &data].concat()
    };
    let plain = npy("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 6), }\n", 48);
    let record = "{'descr': [('xyz', '>f8', (3,)), ('', '|V2'), (('a', 'rgb'), '|u1', (3,)), ('t', '<i8')], \
                  'fortran_order': True, 'shape': (2,), }\n";
    let seeds =
        [plain.clone(), npy("{'descr': '<f2', 'fortran_order': True, 'shape': (1, 2, 3)}", 12), npy(record, 74)];
    damage(&seeds, 20_000, load_as(None));
    let faces = npy("{'descr': '|u1', 'fortran_order': False, 'shape': (1, 3), }\n", 3);
    let zip = zip(&[("points.npy", &plain), ("faces.npy", &faces)]);
    damage(&[zip], 40_000, load_as(Some(Format::Npz)));
}

#[test]
fn mutations_of_tables() {
    let words = "name;x;y;z;r;g;b\n\"a;b\";1,5;2;3;10;20;30\nc;4;5;6;;20;30\nd;7;8;9;1;2;3\n";
    let colmap = "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n1 2 3 4 5 6 7 0.5 1 2\n9 8 7 6 5 4 3 0.25\n";
    damage(&[words.as_bytes().to_vec(), colmap.as_bytes().to_vec()], 10_000, load_as(Some(Format::Xyz)));
    let point = [&[1; 8][..], &[0; 6], &[0xf0, 0x3f], &[0; 16], &[9, 8, 7], &[0; 8]].concat();
    let tracks = [&1_u64.to_le_bytes()[..], &[5; 8]].concat();
    let binary = [&2_u64.to_le_bytes()[..], &point, &tracks, &point, &[0; 8]].concat();
    damage(&[binary], 10_000, load_as(None));
    for columns in ["f4:x,y,z,u1:r,g,b,_", ">f8:x,y,z,i2:label", "x,y,z,_", "_,x,y,z,r,g,b"] {
        let options = LoadOptions { columns: Some(columns.parse().unwrap()), ..LoadOptions::default() };
        let rows: Vec<u8> = (0..3 * 416_u32).map(|i| (i * 37 % 256) as u8).collect();
        damage(&[rows, words.as_bytes().to_vec(), b"1 2 3 4\n5 6 7 8\n".to_vec()], 2000, |bytes| {
            drop(load_bytes(bytes, None, Path::new("t"), &options));
        });
    }
}

/// Builds a ZIP file of stored files, with its directory.
fn zip(files: &[(&str, &[u8])]) -> Vec<u8> {
    let (mut zip, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in files {
        let start = (zip.len() as u32).to_le_bytes();
        let (size, length) = ((content.len() as u32).to_le_bytes(), (name.len() as u16).to_le_bytes());
        zip.extend([b"PK\x03\x04\x14\0\0\0\0\0\0\0\0\0\0\0\0\0", &size[..], &size, &length, &[0, 0]].concat());
        zip.extend([name.as_bytes(), content].concat());
        let head = b"PK\x01\x02\x14\0\x14\0\0\0\0\0\0\0\0\0\0\0\0\0";
        directory.extend([&head[..], &size, &size, &length, &[0; 12], &start, name.as_bytes()].concat());
    }
    let count = (files.len() as u16).to_le_bytes();
    let (size, start) = ((directory.len() as u32).to_le_bytes(), (zip.len() as u32).to_le_bytes());
    zip.extend([&directory[..], b"PK\x05\x06\0\0\0\0", &count, &count, &size, &start, &[0, 0]].concat());
    zip
}

#[test]
fn mutations_of_ptx_off_and_text_dialects() {
    let ptx =
        b"2\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n5 6 7 1\n1 2 3 0.5 1 2 3\n0 0 0 0.5 0 0 0\n";
    damage(&[ptx.to_vec()], 20_000, load_as(Some(Format::Ptx)));
    let texts = [&b"//X Y Z R G B Intensity\n2\n1 2 3 4 5 6 7\n4 5 6 7 8 9 1\n"[..], b"X;Y;Z\n1,5;2,5;3\n1;2;3,25\n"];
    damage(&texts.map(<[u8]>::to_vec), 20_000, load_as(None));
    let offs = [
        &b"COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 0 0 1\n0 1 0 0 0 0 1 # c\n3 0 1 2 9 9 9\n"[..],
        b"ST4OFF 1 0 0\n1 2 3 4 5 6\n",
    ];
    damage(&offs.map(<[u8]>::to_vec), 20_000, load_as(Some(Format::Off)));
}

#[test]
fn mutations_of_gaussians() {
    let row: Vec<u8> = (0..64_u8).map(|i| if i % 4 == 3 && i % 32 < 24 { 63 } else { i.wrapping_mul(5) }).collect();
    damage(&[row], 8000, load_as(Some(Format::Splat)));
    let spz = |version: u8, streams: usize| {
        let head = [b"NGSP", &[version, 0, 0, 0, 2, 0, 0, 0, 1, 12, 0, 6][..]].concat();
        [head, (0..streams).map(|i| (i as u8).wrapping_mul(37)).collect()].concat()
    };
    let mut fourth = spz(4, 0);
    fourth.extend([&[32, 0, 0, 0][..], &[0; 12]].concat());
    for n in [18_u8, 2, 6, 6, 8, 18] {
        fourth.extend([n + 9, 0, 0, 0, 0, 0, 0, 0, n, 0, 0, 0, 0, 0, 0, 0]);
    }
    for n in [18_u8, 2, 6, 6, 8, 18] {
        fourth.extend([&[0x28, 0xb5, 0x2f, 0xfd, 0x20, n, 1 | n << 3, n >> 5, 0][..], &vec![99; n.into()]].concat());
    }
    damage(&[spz(1, 2 * 25), spz(2, 2 * 28), spz(3, 2 * 29), fourth], 10_000, load_as(None));
    let mut ply = b"ply\nformat binary_little_endian 1.0\nelement chunk 1\n".to_vec();
    for name in ["x", "y", "z", "scale_x", "scale_y", "scale_z", "r", "g", "b"] {
        ply.extend(format!("property float min_{name}\nproperty float max_{name}\n").bytes());
    }
    ply.extend(b"element vertex 2\nproperty uint packed_position\nproperty uint packed_rotation\n");
    ply.extend(b"property uint packed_scale\nproperty uint packed_color\nend_header\n");
    ply.extend((0..104_u8).map(|i| if i % 4 == 3 { 63 } else { i }));
    damage(&[ply], 20_000, load_as(None));
    damage(&[include_bytes!("data/points.drc").to_vec()], 20_000, load_as(None));
}

#[test]
fn mutations_of_gzip_and_sog() {
    use flate2::{Compression, write::GzEncoder};
    use std::io::Write;
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(b"x y z\n1 2 3\n4 5 6\n").unwrap();
    damage(&[encoder.finish().unwrap()], 20_000, load_as(None));
    // The description of a SOG file; mutations of its WebP images are a separate test.
    let mut picture = Vec::new();
    let encoder = image::codecs::webp::WebPEncoder::new_lossless(&mut picture);
    encoder.encode(&[9, 99, 199, 252], 1, 1, image::ExtendedColorType::Rgba8).unwrap();
    let part = |name: &str| format!(r#""{name}":{{"mins":[-2,-2,-2,0],"maxs":[2,2,2,1],"files":["p","p"]}}"#);
    let meta = format!(r#"{{"count":1,{},{},{},{}}}"#, part("means"), part("scales"), part("quats"), part("sh0"));
    let zip = zip(&[("meta.json", meta.as_bytes()), ("p", &picture)]);
    damage(&[zip], 20_000, load_as(Some(Format::Sog)));
}

#[test]
fn mutations_found_before_stay_fixed() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/finds");
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let bytes = std::fs::read(&path).unwrap();
        for extension in "ply obj stl gltf xyz pts ptx pcd npy npz off drc splat spz sog surfel".split(' ') {
            load_as(Format::from_extension(&Path::new("a").with_extension(extension)))(&bytes);
        }
        load_as(None)(&bytes);
        drop(read_image_bytes(&bytes, &path));
        drop(scene_file::parse(&bytes, &path));
    }
}
