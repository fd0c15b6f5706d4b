//! Files in which other programs write names, colours, radii and meshes differently from Surfel.

use glam::DVec3;
use std::path::{Path, PathBuf};
use surfel_io::{Content, Format, LoadOptions, Loaded, PlyEncoding, load, load_bytes, write_splat_ply};
use surfel_model::{ExtraValues, Mesh, PointCloud, SplatCloud};

fn try_read(format: Format, bytes: impl AsRef<[u8]>) -> Result<Loaded, String> {
    let name = format!("t.{}", format.name().to_lowercase());
    load_bytes(bytes.as_ref(), Some(format), Path::new(&name), &LoadOptions::default()).map_err(|e| e.to_string())
}

fn read(format: Format, bytes: impl AsRef<[u8]>) -> Loaded {
    try_read(format, bytes).unwrap_or_else(|e| panic!("{e}"))
}

fn points(loaded: Loaded) -> PointCloud {
    match loaded.content {
        Content::Points(points) => points,
        other => panic!("{other:?}"),
    }
}

fn mesh(loaded: Loaded) -> Mesh {
    match loaded.content {
        Content::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

fn splats(loaded: Loaded) -> SplatCloud {
    match loaded.content {
        Content::Splats(splats) => splats,
        other => panic!("{other:?}"),
    }
}

/// Decodes an sRGB level of the range from 0 to `most` to linear light by IEC 61966-2-1.
fn linear(level: f64, most: f64) -> f32 {
    let c = level / most;
    (if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }) as f32
}

fn assert_color(found: [f32; 3], levels: [f64; 3], most: f64) {
    let wanted = levels.map(|level| linear(level, most));
    assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}, not {wanted:?}");
}

/// Builds a PLY file of one element in each of the three encodings. A property is its type and its name.
fn in_all_encodings(element: &str, comments: &[&str], properties: &[(&str, &str)], rows: &[&[f64]]) -> Vec<Vec<u8>> {
    let encodings = ["ascii", "binary_little_endian", "binary_big_endian"];
    let file = |encoding: &&str| {
        let comments: String = comments.iter().map(|c| format!("comment {c}\n")).collect();
        let properties_text: String =
            properties.iter().map(|(kind, name)| format!("property {kind} {name}\n")).collect();
        let count = rows.len();
        let head =
            format!("ply\nformat {encoding} 1.0\n{comments}element {element} {count}\n{properties_text}end_header\n");
        let mut bytes = head.into_bytes();
        for row in rows {
            if *encoding == "ascii" {
                let words: Vec<String> = row.iter().map(f64::to_string).collect();
                bytes.extend(format!("{}\n", words.join(" ")).bytes());
                continue;
            }
            for (value, (kind, _)) in row.iter().zip(properties) {
                let mut raw = match *kind {
                    "uchar" => vec![*value as u8],
                    "ushort" => (*value as u16).to_le_bytes().to_vec(),
                    "int" => (*value as i32).to_le_bytes().to_vec(),
                    "uint" => (*value as u32).to_le_bytes().to_vec(),
                    "float" => (*value as f32).to_le_bytes().to_vec(),
                    "double" => value.to_le_bytes().to_vec(),
                    other => panic!("{other}"),
                };
                if encoding.ends_with("big_endian") {
                    raw.reverse();
                }
                bytes.extend(raw);
            }
        }
        bytes
    };
    encodings.iter().map(file).collect()
}

const XYZ: [(&str, &str); 3] = [("float", "x"), ("float", "y"), ("float", "z")];

fn with<'a>(first: &[(&'a str, &'a str)], more: &[(&'a str, &'a str)]) -> Vec<(&'a str, &'a str)> {
    first.iter().chain(more).copied().collect()
}

#[test]
fn ply_names_are_those_that_text_files_know() {
    let sets = [
        ("vertex", ["x", "y", "z"], ["r", "g", "b"], ["normal_x", "normal_y", "normal_z"]),
        ("point", ["X", "Y", "Z"], ["Red", "Green", "Blue"], ["normalx", "normaly", "normalz"]),
        ("points", ["pos_x", "pos_y", "pos_z"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["NX", "NY", "NZ"]),
        ("vertices", ["Easting", "Northing", "Height"], ["R", "G", "B"], ["n_x", "n_y", "n_z"]),
    ];
    for (element, position, color, normal) in sets {
        let kinds = [("float", position), ("uchar", color), ("float", normal)];
        let mut properties: Vec<(&str, &str)> =
            kinds.iter().flat_map(|(kind, names)| names.iter().map(|name| (*kind, *name))).collect();
        properties.push(("int", "label"));
        for bytes in in_all_encodings(element, &[], &properties, &[&[1., 2., 3., 255., 128., 0., 0., 0., 1., 7.]]) {
            let loaded = read(Format::Ply, bytes);
            assert!(loaded.notes.is_empty(), "{:?}", loaded.notes);
            let found = points(loaded);
            assert_eq!((found.positions.get(0), found.normals.unwrap().get(0)), (DVec3::new(1., 2., 3.), DVec3::Z));
            assert_color(found.colors.unwrap()[0], [255., 128., 0.], 255.);
            assert_eq!((found.extras.len(), found.extras[0].name.as_str()), (1, "label"));
        }
    }
    // Messages use the file's names.
    let xyz = "property float X\nproperty float Y\nproperty float Z\nend_header\n";
    let text = format!("ply\nformat ascii 1.0\nelement point 2\n{xyz}1 2 ");
    let error = try_read(Format::Ply, format!("{text}q")).unwrap_err();
    assert!(error.contains("'q' as property 'Z' of element 'point' number 0"), "{error}");
    let error = try_read(Format::Ply, format!("{text}3\n")).unwrap_err();
    assert!(error.contains("within element 'point' number 1 of 2"), "{error}");
    // Coordinates that aren't lengths are refused.
    let lon_lat = "property float lon\nproperty float lat\nproperty float z\nend_header\n1 2 3\n";
    let degrees = format!("ply\nformat ascii 1.0\nelement point 1\n{lon_lat}");
    assert!(try_read(Format::Ply, degrees).unwrap_err().contains("have z but lack x y"));
}

#[test]
fn ply_splats_and_meshes_have_other_names_too() {
    let properties = with(&XYZ, &[("float", "NX"), ("float", "NY"), ("float", "NZ"), ("float", "Radius")]);
    for bytes in in_all_encodings("points", &[], &properties, &[&[1., 2., 3., 0., 1., 0., 0.5]]) {
        let cloud = splats(read(Format::Ply, bytes));
        assert_eq!((cloud.normal(0), cloud.radius_max(0)), (DVec3::Y, 0.5));
    }
    let text = "ply\nformat ascii 1.0\nelement Vertex 3\nproperty float X\nproperty float Y\nproperty float Z\n\
                property uchar r\nproperty uchar g\nproperty uchar b\nelement faces 1\n\
                property list uchar int corners\nend_header\n0 0 0 255 0 0\n1 0 0 255 0 0\n0 1 0 255 0 0\n\
                3 0 1 2\n";
    let found = mesh(read(Format::Ply, text));
    assert_eq!((found.triangles, found.colors.unwrap()[2]), (vec![[0, 1, 2]], [1.0, 0.0, 0.0]));
    // With two lists, neither is guessed.
    let two = text.replace("corners", "a\nproperty list uchar int b").replace("3 0 1 2", "3 0 1 2 3 0 1 2");
    assert!(matches!(read(Format::Ply, two).content, Content::Points(_)));
}

#[test]
fn ply_packed_colors_are_the_bits_of_a_number() {
    let bits = 0x00ff_8000_u32;
    for (kind, value) in [("uint", f64::from(bits)), ("int", f64::from(bits)), ("float", f32::from_bits(bits).into())] {
        let properties = with(&XYZ, &[(kind, "rgb")]);
        // Text represents such floats exactly unless a program rounds them.
        for bytes in in_all_encodings("vertex", &[], &properties, &[&[1., 2., 3., value]]) {
            let found = points(read(Format::Ply, bytes));
            assert_color(found.colors.unwrap()[0], [255., 128., 0.], 255.);
            assert!(found.extras.is_empty());
        }
    }
    // A float that isn't packed stays a number.
    for bytes in in_all_encodings("vertex", &[], &with(&XYZ, &[("float", "rgb")]), &[&[1., 2., 3., 0.5]]) {
        let found = points(read(Format::Ply, bytes));
        assert!(found.colors.is_none() && found.extras[0].name == "rgb");
    }
}

#[test]
fn ply_whole_colors_count_to_what_they_need() {
    const EIGHT_BITS: &str = "its colours count to 255 instead of 65535: taken as 8 bits";
    for (kind, levels, most, note) in [
        ("uchar", [255., 64., 1.], 255., ""),
        ("ushort", [255., 64., 1.], 255., EIGHT_BITS),
        ("ushort", [200., 100., 3.], 255., EIGHT_BITS),
        ("ushort", [256., 64., 1.], 65_535., ""),
        ("ushort", [65_535., 32_768., 1.], 65_535., ""),
        ("int", [255., 64., 1.], 255., ""),
        ("uint", [40_000., 64., 1.], 65_535., "took the colours as sRGB-encoded, from 0 to 65535"),
    ] {
        let properties = with(&XYZ, &[(kind, "red"), (kind, "green"), (kind, "blue")]);
        // The largest level decides for all.
        let rows: [&[f64]; 2] = [&[1., 2., 3., levels[0], levels[1], levels[2]], &[1., 2., 4., 0., 0., 9.]];
        for bytes in in_all_encodings("vertex", &[], &properties, &rows) {
            let loaded = read(Format::Ply, bytes);
            assert_eq!(loaded.notes.join("; "), note, "{kind} {levels:?}");
            let colors = points(loaded).colors.unwrap();
            assert_color(colors[0], levels, most);
            assert_color(colors[1], [0., 0., 9.], most);
        }
    }
    let properties = with(&XYZ, &[("ushort", "red"), ("ushort", "green"), ("ushort", "blue"), ("ushort", "alpha")]);
    for bytes in in_all_encodings("vertex", &[], &properties, &[&[1., 2., 3., 255., 0., 0., 51.]]) {
        let loaded = read(Format::Ply, bytes);
        assert!(loaded.notes[1].contains("alphas count to 255"), "{:?}", loaded.notes);
        assert_eq!(points(loaded).alphas, Some(vec![0.2]));
    }
}

#[test]
fn ply_float_colors_are_as_displayed_unless_a_comment_says_otherwise() {
    let rgb = [("float", "red"), ("float", "green"), ("double", "blue")];
    let faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let read_both = |comments: &[&str], [r, g, b]: [f64; 3]| {
        let row = [1., 2., 3., r, g, b];
        let mut all: Vec<([f32; 3], String)> = Vec::new();
        for bytes in in_all_encodings("vertex", comments, &with(&XYZ, &rgb), &[&row, &row, &row]) {
            if bytes.starts_with(b"ply\nformat ascii") {
                let text = String::from_utf8(bytes.clone()).unwrap().replace("end_header\n", faces) + "3 0 1 2\n";
                let loaded = read(Format::Ply, text);
                all.push((Default::default(), loaded.notes.join("; ")));
                all.last_mut().unwrap().0 = mesh(loaded).colors.unwrap()[0];
            }
            let loaded = read(Format::Ply, bytes);
            all.push((Default::default(), loaded.notes.join("; ")));
            all.last_mut().unwrap().0 = points(loaded).colors.unwrap()[0];
        }
        assert!(all.windows(2).all(|pair| pair[0] == pair[1]), "points and meshes, text and binary: {all:?}");
        all.swap_remove(0)
    };
    for (color, most, scale) in [
        ([0.5, 0.25, 0.0], 1., "from 0 to 1;"),
        ([1.0, 0.0, 1.0], 1., "from 0 to 1;"),
        ([128., 64., 0.], 255., "from 0 to 255;"),
        ([3., 0., 1.], 255., "from 0 to 255;"),
        ([127.5, 64.25, 0.], 255., "from 0 to 255;"),
        ([32_896., 0., 65_535.], 65_535., "from 0 to 65535;"),
    ] {
        let (found, note) = read_both(&[], color);
        assert_color(found, color, most);
        assert!(note.contains(scale) && note.contains("'colors linear'"), "{note}");
    }
    let (found, note) = read_both(&["made by hand"], [1.02, 0.5, 0.0]);
    assert_color(found, [1.0, 0.5, 0.0], 1.);
    assert!(note.contains("clamped larger ones"), "{note}");
    for comment in ["colors linear", " Colours  Linear "] {
        for color in [[0.5, 0.25, 0.0], [2.0, 0.25, 0.0], [128., 64., 0.]] {
            assert_eq!(read_both(&[comment], color), (color.map(|c| c as f32), String::new()));
        }
    }
    let (found, _) = read_both(&["colors linear or not"], [0.5, 0.25, 0.0]);
    assert_color(found, [0.5, 0.25, 0.0], 1.);
}

#[test]
fn splat_profile_has_linear_floats_and_says_so_when_written() {
    let properties = with(
        &XYZ,
        &[
            ("float", "nx"),
            ("float", "ny"),
            ("float", "nz"),
            ("float", "radius"),
            ("float", "red"),
            ("float", "green"),
            ("float", "blue"),
        ],
    );
    let text = |cloud: &SplatCloud| {
        let mut bytes = Vec::new();
        write_splat_ply(&mut bytes, cloud, PlyEncoding::Ascii).unwrap();
        String::from_utf8(bytes).unwrap()
    };
    for bytes in in_all_encodings("vertex", &[], &properties, &[&[1., 2., 3., 0., 0., 1., 0.5, 0.5, 0.25, 2.]]) {
        let loaded = read(Format::Ply, bytes);
        assert!(loaded.notes.is_empty());
        let cloud = splats(loaded);
        assert_eq!(cloud.color(0), [0.5, 0.25, 2.0]);
        assert_eq!(text(&cloud).matches("comment colors linear\n").count(), 1);
        let again = splats(read(Format::Ply, text(&cloud)));
        assert_eq!((again.color(0), text(&again)), ([0.5, 0.25, 2.0], text(&cloud)), "said once");
        // 8-bit levels are sRGB-encoded, whatever a comment of the source states.
        let mut data = again.into_data();
        data.colors = Some(vec![[1.0, 0.0, linear(128., 255.)]]);
        let cloud = SplatCloud::new(data, surfel_model::OnInvalid::Refuse).unwrap().0;
        assert!(!text(&cloud).contains("linear"), "{}", text(&cloud));
    }
}

#[test]
fn ply_faces_show_their_colors() {
    let head = |vertex: &str, face: &str, kind: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{vertex}\
             element face 3\n{kind}property list uchar int vertex_indices\n{face}end_header\n"
        )
    };
    let rgb = |kind: &str, names: [&str; 3]| names.map(|name| format!("property {kind} {name}\n")).concat();
    let place = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"];
    let file = |vertex: [&str; 4], head: String, rows: [&str; 3]| {
        let vertices: String = place.iter().zip(vertex).map(|(p, v)| format!("{p} {v}\n")).collect();
        format!("{head}{vertices}{}\n", rows.join("\n"))
    };
    let of_triangles = |text: String| {
        let loaded = read(Format::Ply, text);
        let notes = loaded.notes.join("; ");
        let found = mesh(loaded);
        let colors = found.colors.unwrap();
        let of = |t: &[u32; 3]| {
            assert!(t.iter().all(|i| colors[*i as usize] == colors[t[0] as usize]), "one colour a triangle");
            colors[t[0] as usize]
        };
        (found.triangles.iter().map(of).collect::<Vec<_>>(), found.positions.len(), notes)
    };
    // The last face has four corners, and therefore two triangles.
    for (kind, names, rows, most) in [
        ("uchar", ["red", "green", "blue"], ["255 0 0", "0 0 255", "1 2 3"], 255.),
        ("uchar", ["r", "g", "b"], ["255 0 0", "0 0 255", "1 2 3"], 255.),
        ("float", ["Red", "Green", "Blue"], ["1 0 0", "0 0 1", "0.5 0.25 0"], 1.),
        ("ushort", ["diffuse_red", "diffuse_green", "diffuse_blue"], ["255 0 0", "0 0 255", "9 0 0"], 255.),
    ] {
        let corners = ["3 0 1 2", "3 0 2 3", "4 0 1 2 3"];
        let lines = [0, 1, 2].map(|i| format!("{} {}", corners[i], rows[i]));
        let text = file([""; 4], head("", &rgb(kind, names), ""), [&lines[0], &lines[1], &lines[2]]);
        let (colors, vertices, _) = of_triangles(text);
        for (found, row) in colors.iter().zip([rows[0], rows[1], rows[2], rows[2]]) {
            let levels: Vec<f64> = row.split(' ').map(|c| c.parse().unwrap()).collect();
            assert_color(*found, [levels[0], levels[1], levels[2]], most);
        }
        assert_eq!((colors.len(), vertices), (4, 10), "a vertex for each place and colour");
    }
    // Face colours replace vertex colours that are all equal, but not others. A face's colour may precede its corners.
    let vertex = rgb("uchar", ["red", "green", "blue"]);
    let rows = ["255 0 0 3 0 1 2", "0 0 255 3 0 2 3", "1 2 3 3 1 2 3"];
    let text = |colors: [&str; 4]| file(colors, head(&vertex, "", &vertex), rows);
    let (colors, ..) = of_triangles(text(["9 9 9"; 4]));
    assert_eq!(colors[1], [0.0, 0.0, 1.0]);
    let loaded = read(Format::Ply, text(["9 9 9", "9 9 9", "9 9 9", "8 9 9"]));
    assert_eq!(loaded.notes, ["ignored the colours of its faces: its vertices have colours of their own"]);
    assert_eq!(mesh(loaded).positions.len(), 4);
    // Other properties follow their vertices, which are duplicated.
    let lines = ["3 0 1 2 255 0 0", "3 0 2 3 0 0 255", "3 1 2 3 0 0 255"];
    let text = file(["7", "8", "9", "10"], head("property float quality\n", &vertex, ""), lines);
    let found = mesh(read(Format::Ply, text));
    let quality = &found.vertex_extras.iter().find(|extra| extra.name == "quality").unwrap().values;
    assert_eq!(quality.len(), found.positions.len());
    for i in 0..found.positions.len() {
        let same = (0..i).find(|j| found.positions.get(*j) == found.positions.get(i));
        assert_eq!(same.map(|j| quality.get(j)), same.map(|_| quality.get(i)));
    }
    assert!((0..4).all(|i| (0..quality.len()).any(|j| quality.get(j) == f64::from(7 + i))));
    // Alphas of faces; if all are 0, they are ignored.
    let with_alpha = rgb("uchar", ["red", "green", "blue"]) + "property uchar alpha\n";
    for (alpha, expected) in [("51", Some(0.2)), ("0", None)] {
        let lines = ["3 0 1 2", "3 0 2 3", "3 1 2 3"].map(|c| format!("{c} 255 0 0 {alpha}"));
        let text = file([""; 4], head("", &with_alpha, ""), [&lines[0], &lines[1], &lines[2]]);
        assert_eq!(mesh(read(Format::Ply, text)).alphas.map(|all| all[0]), expected);
    }
}

#[test]
fn off_faces_show_their_colors() {
    let text = |colors: [&str; 2]| {
        format!("OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 {}\n3 0 2 3 {}\n", colors[0], colors[1])
    };
    for (colors, expected) in [(["255 0 0", "0 0 255"], 1.0), (["1 0 0", "0 0 1 0.5"], 0.5), (["1. 0 0", "0 0 1"], 1.0)]
    {
        let found = mesh(read(Format::Off, text(colors)));
        let all = found.colors.unwrap();
        let color = |t: usize| all[found.triangles[t][1] as usize];
        assert_eq!((color(0), color(1)), ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]));
        assert_eq!(found.alphas.map_or(1.0, |all| all[found.triangles[1][1] as usize]), expected);
    }
    let loaded = read(Format::Off, text(["7", "8"]));
    assert!(loaded.notes[0].contains("ignored the colours of some faces"), "{:?}", loaded.notes);
    assert!(mesh(loaded).colors.is_none());
}

#[test]
fn obj_vertex_colors_count_to_1_or_255() {
    for (colors, levels, most, note) in [
        ("200 100 50", [200., 100., 50.], 255., "from 0 to 255"),
        ("2 1 0", [2., 1., 0.], 255., "from 0 to 255"),
        ("127.5 0 0", [127.5, 0., 0.], 255., "from 0 to 255"),
        ("1 0.5 0", [1., 0.5, 0.], 1., ""),
        ("1.01 0.5 0", [1., 0.5, 0.], 1., "clamped larger ones"),
        ("65535 0 0", [65_535., 0., 0.], 65_535., "from 0 to 65535"),
    ] {
        let vertices = |more: &str| format!("v 0 0 0 {colors}\nv 1 0 0 {colors}\nv 1 1 0{more}\n");
        for (text, faces) in
            [(vertices(""), "f 1 2 3\n"), (vertices(""), ""), (vertices(&format!(" {colors}")), "f 1 2 3\n")]
        {
            let has_all = text.matches(colors).count() == 3;
            let loaded = read(Format::Obj, text + faces);
            assert!(loaded.notes.join("; ").contains(note), "{colors}: {:?}", loaded.notes);
            assert!(!note.is_empty() || loaded.notes.is_empty(), "{:?}", loaded.notes);
            let found = match loaded.content {
                Content::Mesh(mesh) => mesh.colors,
                Content::Points(points) => points.colors,
                other => panic!("{other:?}"),
            };
            assert_color(found.as_ref().unwrap()[0], levels, most);
            assert_color(found.unwrap()[2], if has_all { levels } else { [most; 3] }, most);
        }
    }
}

#[test]
fn obj_faces_do_without_what_the_file_lacks() {
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
    for (face, note) in [
        ("f 1//1 2//2 3//3 4//4", "the file lacks the normals of 4 corners: "),
        ("f 1/1 2/2 3/3 4/4", "the file lacks the texture coordinates of 4 corners: "),
        ("f 1//-1 2//-2 3//0 4", "the file lacks the normals of 3 corners: "),
        ("f 1/9/9 2/9/9 3/9/9 4/9/9", "the file lacks the texture coordinates of 4 corners: "),
    ] {
        let loaded = read(Format::Obj, format!("{square}{face}\n"));
        assert!(loaded.notes[0].starts_with(note), "{face}: {:?}", loaded.notes);
        let found = mesh(loaded);
        assert_eq!(found.triangles.len(), 2);
        assert!(found.normals.is_none() && found.uvs.is_none());
    }
    // References to elements that are defined later are valid.
    let found = read(Format::Obj, format!("f 1/1/1 2/1/1 3/1/1\n{square}vt 0.5 0.5\nvn 0 0 1\n"));
    assert!(found.notes.is_empty(), "{:?}", found.notes);
    let found = mesh(found);
    assert_eq!((found.normals.unwrap()[0], found.uvs.unwrap()[0]), ([0.0, 0.0, 1.0], [0.5, 0.5]));
    // One corner's normal is missing: the others keep theirs, and 0 0 0 is estimated.
    let loaded = read(Format::Obj, format!("{square}vn 0 0 2\nf 1//1 2//1 3//7\n"));
    assert_eq!(loaded.notes, ["the file lacks the normals of 1 corner: faces are drawn without them"]);
    assert_eq!(mesh(loaded).normals.unwrap(), [[0.0, 0.0, 2.0], [0.0, 0.0, 2.0], [0.0; 3]]);
    for (face, error) in [
        ("f 1 2 9", "a face refers to vertex '9' of 4 (line 5)"),
        ("f 1 2 -5", "a face refers to vertex '-5' of 4 (line 5)"),
        ("f 1 2 0", "a face refers to vertex '0' of 4 (line 5)"),
        ("f 1//x 2 3", "a face refers to normal 'x' (line 5)"),
    ] {
        let found = try_read(Format::Obj, format!("{square}{face}\nf 1 2 3\n")).unwrap_err();
        assert!(found.contains(error), "{found}");
    }
}

/// A folder that is removed when dropped.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("surfel-read-right-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        std::fs::write(self.0.join(name), bytes).unwrap();
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn load_file(path: &Path) -> Loaded {
    load(path, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn png([r, g, b]: [u8; 3]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 2);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&[r, g, b].repeat(4)).unwrap();
    bytes
}

#[test]
fn obj_libraries_may_be_several_or_have_blanks() {
    let folder = Folder::new("libraries");
    folder.write("one.mtl", "newmtl blue\nKd 0 0 1\n");
    folder.write("two.mtl", "newmtl red\nKd 1 0 0\n");
    folder.write("my own.mtl", "newmtl red\nKd 0 1 0\n");
    let color = |libraries: &str| {
        let text = format!("{libraries}\nv 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl red\nf 1 2 3\n");
        let loaded = load_file(&folder.write("a.obj", text));
        let notes = loaded.notes.join("; ");
        (mesh(loaded).colors.map(|all| all[0]), notes)
    };
    let red = (Some([1.0, 0.0, 0.0]), String::new());
    assert_eq!(color("mtllib one.mtl two.mtl"), red);
    assert_eq!(color("mtllib two.mtl\tone.mtl "), red);
    assert_eq!(color("mtllib one.mtl\nmtllib two.mtl"), red);
    assert_eq!(color("mtllib my own.mtl"), (Some([0.0, 1.0, 0.0]), String::new()));
    assert_eq!(color("mtllib one.mtl my own.mtl"), (Some([0.0, 1.0, 0.0]), String::new()));
    let (found, note) = color("mtllib no.mtl two.mtl");
    assert!(found == Some([1.0, 0.0, 0.0]) && note.starts_with("left out the material library 'no.mtl'"), "{note}");
    let (found, note) = color("mtllib none here.mtl");
    assert!(found.is_none() && note.starts_with("left out the material library 'none here.mtl'"), "{note}");
}

#[test]
fn obj_textures_may_have_any_options_and_faces_none() {
    let folder = Folder::new("options");
    folder.write("tex.png", png([255, 0, 0]));
    folder.write("a b.png", png([0, 255, 0]));
    let corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n";
    let read = |map: &str, faces: &str| {
        folder.write("q.mtl", format!("newmtl a\nKd 1 1 1\nmap_Kd {map}\n"));
        load_file(&folder.write("q.obj", format!("mtllib q.mtl\n{corners}usemtl a\n{faces}")))
    };
    for (map, texel) in [
        ("-colorspace sRGB tex.png", [255, 0, 0, 255]),
        ("-s 1 1 1 -colorspace sRGB -blendu on tex.png", [255, 0, 0, 255]),
        ("-strange one two three tex.png", [255, 0, 0, 255]),
        ("-mm 0 1 a b.png", [0, 255, 0, 255]),
        ("tex.png -clamp on", [255, 0, 0, 255]),
    ] {
        let loaded = read(map, "f 1/1 2/2 3/3\n");
        assert!(loaded.notes.is_empty(), "{map}: {:?}", loaded.notes);
        assert_eq!(mesh(loaded).texture.unwrap().srgba8[0], texel, "{map}");
    }
    let loaded = read("-s 2 2 1 tex.png", "f 1/1 2/2 3/3\n");
    assert_eq!(loaded.notes, ["ignored '-s 2 2 1' of the texture 'tex.png'"]);
    // A face without texture coordinates isn't drawn in the colour of a texture's corner.
    let found = mesh(read("tex.png", "f 1/1 2/2 3/3\nf 1 3 2\n"));
    let materials = found.materials.unwrap();
    let textures: Vec<bool> =
        materials.of_triangle.iter().map(|i| materials.materials[*i as usize].texture.is_some()).collect();
    assert_eq!(textures, [true, false]);
}

#[test]
fn emissive_colors_are_added() {
    let folder = Folder::new("emission");
    folder.write("glow.png", png([0, 255, 0]));
    folder.write("base.png", png([255, 0, 0]));
    let corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n";
    let read = |material: &str| {
        folder.write("q.mtl", format!("newmtl a\n{material}\n"));
        let loaded = load_file(&folder.write("q.obj", format!("mtllib q.mtl\n{corners}usemtl a\nf 1/1 2/2 3/3\n")));
        let is_noted =
            loaded.notes.iter().any(|n| n == "added the emissive colours of 1 material to their base colours");
        let found = mesh(loaded);
        (found.colors.map(|all| all[0]), found.texture.map(|t| t.srgba8[0]), is_noted)
    };
    assert_eq!(read("Kd 0 0 0\nKe 1 0.5 0"), (Some([1.0, 0.5, 0.0]), None, true));
    assert_eq!(read("Kd 0.5 0 0.25\nKe 1 0.5 0"), (Some([1.0, 0.5, 0.25]), None, true));
    assert_eq!(read("Kd 0.5 0 0\nKe 0 0 0"), (Some([0.5, 0.0, 0.0]), None, false));
    let (colors, texel, noted) = read("Kd 1 1 1\nmap_Kd base.png\nmap_Ke glow.png");
    assert_eq!((colors, texel, noted), (None, Some([255, 255, 0, 255]), true));
    let (_, texel, _) = read("Kd 0 0 0\nKe 1 1 1\nmap_Ke glow.png");
    assert_eq!(texel, Some([0, 255, 0, 255]));
    let (_, texel, _) = read("Kd 1 1 1\nmap_Kd base.png\nKe 0 0 1");
    assert_eq!(texel, Some([255, 0, 255, 255]));
}

fn stl(header: &[u8], attributes: &[u16]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, 0);
    bytes.extend((attributes.len() as u32).to_le_bytes());
    for (i, attribute) in attributes.iter().enumerate() {
        let x = i as f32;
        let numbers = [0., 0., 1., x, 0., 0., x + 1., 0., 0., x + 1., 1., 0.];
        numbers.iter().for_each(|v: &f32| bytes.extend(v.to_le_bytes()));
        bytes.extend(attribute.to_le_bytes());
    }
    bytes
}

#[test]
fn stl_colors_follow_either_convention() {
    let colors = |header: &[u8], attributes: &[u16]| {
        let loaded = read(Format::Stl, stl(header, attributes));
        let notes = loaded.notes.join("; ");
        let found = mesh(loaded);
        let all = found.colors.clone();
        let of = |t: &[u32; 3]| all.as_ref().map(|all| all[t[1] as usize]);
        (found.triangles.iter().map(of).collect::<Vec<_>>(), found.alphas, notes)
    };
    let (red, blue, white) = (Some([1.0, 0.0, 0.0]), Some([0.0, 0.0, 1.0]), Some([1.0; 3]));
    let visual = [0x8000 | 31 << 10, 0x8000 | 31, 0];
    let (found, _, note) = colors(b"", &visual);
    assert_eq!(found, [red, blue, white]);
    assert!(note.contains("VisCAM"), "{note}");
    let header = b"COLOR=\x00\x00\xff\xff,MATERIAL=\x00";
    let (found, alphas, note) = colors(header, &[31, 31 << 10, 0x8000, 0xffff]);
    assert_eq!((found, alphas), (vec![red, blue, blue, blue], None));
    assert!(note.contains("Magics"), "{note}");
    // All attribute bytes zero: the colour of all triangles, not black; its alpha of 0 is ignored.
    let (found, alphas, _) = colors(b"COLOR=\xff\x00\x00\x00", &[0, 0]);
    assert_eq!((found, alphas), (vec![red, red], None));
    // A blank ends a colour without alpha; other fourth bytes are its alpha.
    let (_, alphas, _) = colors(b"COLOR=\xff\x00\x00 MATERIAL=", &[0, 0]);
    assert_eq!(alphas, None);
    let (_, alphas, _) = colors(b"COLOR=\xff\x00\x00\x33,MATERIAL=", &[0, 0]);
    assert!(alphas.is_some_and(|all| all.iter().all(|alpha| *alpha == 0.2)));
    assert_eq!(colors(b"plain", &[0, 7]), (vec![None, None], None, String::new()));
    // 16 of 31 is level 132 of 255.
    let (found, ..) = colors(b"", &[0x8000 | 16 << 5]);
    assert_color(found[0].unwrap(), [0., 132., 0.], 255.);
}

#[test]
fn alphas_that_are_all_0_mean_opaque() {
    const NOTE: &str = "took everything as opaque: its alphas are all 0";
    let alpha = [("uchar", "red"), ("uchar", "green"), ("uchar", "blue"), ("uchar", "alpha")];
    let rows = |alphas: [f64; 2]| alphas.map(|a| [1., 2., 3., 9., 9., 9., a]);
    for (alphas, expected) in [([0., 0.], None), ([0., 51.], Some(vec![0.0, 0.2]))] {
        let rows = rows(alphas);
        for bytes in in_all_encodings("vertex", &[], &with(&XYZ, &alpha), &[&rows[0], &rows[1]]) {
            let loaded = read(Format::Ply, bytes);
            assert_eq!(loaded.notes.contains(&NOTE.to_owned()), expected.is_none());
            assert_eq!(points(loaded).alphas, expected);
        }
    }
    let float = with(&XYZ, &[("float", "alpha")]);
    let bytes = in_all_encodings("vertex", &[], &float, &[&[1., 2., 3., 0.]]).swap_remove(1);
    assert_eq!(points(read(Format::Ply, bytes)).alphas, None);
    let text = "x y z r g b a\n0 0 0 1 2 3 0\n1 0 0 200 2 3 0\n";
    let loaded = read(Format::Xyz, text);
    assert!(loaded.notes.contains(&NOTE.to_owned()), "{:?}", loaded.notes);
    assert_eq!(points(loaded).alphas, None);
    let loaded = read(Format::Off, "COFF\n3 1 0\n0 0 0 1 0 0 0\n1 0 0 1 0 0 0\n0 1 0 1 0 0 0\n3 0 1 2\n");
    assert!(loaded.notes.contains(&NOTE.to_owned()), "{:?}", loaded.notes);
    assert_eq!(mesh(loaded).alphas, None);
    let splat = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                 property float nx\nproperty float ny\nproperty float nz\nproperty float radius\nproperty float alpha\n\
                 end_header\n0 0 0 0 0 1 1 0\n";
    assert_eq!(splats(read(Format::Ply, splat)).data().alphas, None);
}

#[test]
fn colors_that_are_all_black_are_none() {
    const NOTE: &str = "took it as without colours: they are all black";
    let color = [("uchar", "red"), ("uchar", "green"), ("uchar", "blue")];
    for (level, is_black) in [(0.0, true), (1.0, false)] {
        let rows = [[1., 2., 3., 0., 0., 0.], [2., 2., 3., 0., level, 0.]];
        for bytes in in_all_encodings("vertex", &[], &with(&XYZ, &color), &[&rows[0], &rows[1]]) {
            let loaded = read(Format::Ply, bytes);
            assert_eq!(loaded.notes.contains(&NOTE.to_owned()), is_black);
            assert_eq!(points(loaded).colors.is_none(), is_black);
        }
        let mesh_file = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
             property list uchar int vertex_indices\nend_header\n0 0 0 0 0 0\n1 0 0 0 0 0\n0 1 0 0 {level} 0\n3 0 1 2\n"
        );
        let loaded = read(Format::Ply, mesh_file.as_str());
        assert_eq!(loaded.notes.contains(&NOTE.to_owned()), is_black);
        assert_eq!(mesh(loaded).colors.is_none(), is_black);
    }
}

#[test]
fn ply_radii_without_normals_are_those_of_points() {
    for kind in ["float", "double"] {
        let properties = with(&XYZ, &[(kind, "radius"), ("int", "label")]);
        for bytes in in_all_encodings("vertex", &[], &properties, &[&[1., 2., 3., 0.25, 7.], &[2., 2., 3., -1., 7.]]) {
            let found = points(read(Format::Ply, bytes));
            assert_eq!(found.radii, Some(vec![0.25, -1.0]));
            assert!(found.normals.is_none());
            let names: Vec<&str> = found.extras.iter().map(|e| e.name.as_str()).collect();
            assert_eq!(names, ["label", "radius"], "and a column, to choose and colour by");
        }
    }
    let found = points(read(Format::Xyz, "x y z radius\n1 2 3 0.5\n2 2 3 0.5\n"));
    assert_eq!((found.radii, found.extras[0].name.as_str()), (Some(vec![0.5, 0.5]), "radius"));
    // With normals or half-axes they are splats, as before.
    let error = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                 property float nx\nproperty float radius\nend_header\n0 0 0 0 1\n";
    assert!(try_read(Format::Ply, error).unwrap_err().contains("have nx radius but lack ny nz"));
}

#[test]
fn coordinates_rounded_far_from_the_origin_are_told_with_their_step() {
    const NOTE: &str = "its coordinates are 32-bit floats far from the origin: they are rounded to steps of 0.5 there";
    let rows: [&[f64]; 2] = [&[5e5, 5.4e6, 100.], &[5e5 + 100., 5.4e6 + 100., 120.]];
    let doubles = [("double", "x"), ("double", "y"), ("double", "z")];
    for bytes in in_all_encodings("vertex", &[], &XYZ, &rows) {
        assert_eq!(read(Format::Ply, bytes).notes, [NOTE]);
    }
    for bytes in in_all_encodings("vertex", &[], &doubles, &rows) {
        assert!(read(Format::Ply, bytes).notes.is_empty(), "whole numbers, but not rounded ones");
    }
    // Near the origin, f32 is precise enough.
    let near: [&[f64]; 2] = [&[500., 5400., 1.], &[600., 5500., 1.]];
    for bytes in in_all_encodings("vertex", &[], &XYZ, &near) {
        assert!(read(Format::Ply, bytes).notes.is_empty());
    }
    let triangles = stl(b"", &[0, 0]);
    let mut far = triangles.clone();
    far[84..].chunks_exact_mut(50).for_each(|raw| {
        [12, 24, 36].iter().for_each(|at| raw[*at..at + 4].copy_from_slice(&5e6_f32.to_le_bytes()));
    });
    assert!(read(Format::Stl, triangles).notes.is_empty());
    assert_eq!(read(Format::Stl, far).notes, [NOTE]);
    assert!(read(Format::Xyz, "500000 5400000 100\n500100 5400100 120\n").notes.is_empty());
}

fn gaussian(names: &[&str], row: &[f64]) -> Vec<u8> {
    let kind = |name: &&str| if ["red", "green", "blue"].contains(name) { "uchar" } else { "float" };
    let properties: Vec<(&str, &str)> = names.iter().map(|name| (kind(name), *name)).collect();
    in_all_encodings("vertex", &[], &properties, &[row]).swap_remove(1)
}

fn trained(bytes: &[u8]) -> (std::sync::Arc<surfel_model::GaussianCloud>, Vec<String>) {
    let options = LoadOptions { gaussians: true, ..LoadOptions::default() };
    let loaded = load_bytes(bytes, Some(Format::Ply), Path::new("a.ply"), &options).unwrap();
    match loaded.content {
        Content::Gaussians(cloud) => (cloud, loaded.notes),
        other => panic!("{other:?}"),
    }
}

#[test]
fn gaussians_have_colors_and_filters_of_other_programs() {
    const SHAPE: [&str; 8] = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
    // Standard deviations 1, 2 and 3, opacity ½.
    let shape = [0., 0., 2f64.ln(), 3f64.ln(), 1., 0., 0., 0.];
    let names = [&["x", "y", "z", "red", "green", "blue"][..], &SHAPE].concat();
    let row = [&[1., 2., 3., 255., 128., 0.][..], &shape].concat();
    let (cloud, notes) = trained(&gaussian(&names, &row));
    assert!(notes.is_empty(), "{notes:?}");
    let [r, g, b] = cloud.coefficients(0)[0].map(|c| f64::from(c) * 0.282_094_791_773_878_14 + 0.5);
    assert!([r - 1.0, g - 128. / 255., b].iter().all(|e| e.abs() < 1e-6), "{r} {g} {b}");
    assert_eq!(cloud.data().degree, 0);
    let surface = splats(read(Format::Ply, gaussian(&names, &row)));
    assert_color(surface.color(0), [255., 128., 0.], 255.);
    let error = try_read(Format::Ply, gaussian(&names[..5], &row[..5])).unwrap_err();
    assert!(error.contains("have red green but lack blue"), "{error}");

    let names = [&["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "filter_3D"][..], &SHAPE].concat();
    let with_filter = |filter: f64| {
        let row = [&[1., 2., 3., 0., 0., 0., filter][..], &shape].concat();
        let (cloud, notes) = trained(&gaussian(&names, &row));
        (cloud.sigmas(0), cloud.data().opacities[0], notes)
    };
    // √(1 + 16), √(4 + 16), √(9 + 16) by hand; the opacity decreases like the peak of a density.
    let (sigmas, opacity, notes) = with_filter(4.0);
    let wide = [17f64.sqrt(), 20f64.sqrt(), 5.0];
    assert!(sigmas.iter().zip(wide).all(|(a, b)| (a - b).abs() < 1e-5), "{sigmas:?}");
    let expected = 0.5 * (1.0 * 2.0 * 3.0) / (wide[0] * wide[1] * wide[2]);
    assert!((f64::from(opacity) - expected).abs() < 1e-6, "{opacity} {expected}");
    assert_eq!(notes, ["applied the 3D smoothing filter that the file has beside the scales"]);
    let (sigmas, opacity, _) = with_filter(0.0);
    assert!((sigmas[1] - 2.0).abs() < 1e-6 && (opacity - 0.5).abs() < 1e-6);
}

#[cfg(feature = "jpeg")]
#[test]
fn a_jpeg_texture_that_is_cut_off_is_noted() {
    let folder = Folder::new("jpeg");
    let color = (0..64 * 64).map(|i| [(i % 64) as f32 / 64., (i / 64) as f32 / 64., 0.5, 1.]).collect();
    let planes = surfel_io::Planes { width: 64, height: 64, color: Some(color), ..surfel_io::Planes::default() };
    let whole = folder.0.join("t.jpg");
    surfel_io::save_jpeg(&whole, true, &planes.view(), &surfel_io::JpegOptions::default()).unwrap();
    let bytes = std::fs::read(&whole).unwrap();
    folder.write("a.mtl", "newmtl a\nmap_Kd t.jpg\n");
    let shape = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl a\nf 1/1 2/2 3/3\n";
    let obj = folder.write("a.obj", shape);
    assert!(load_file(&obj).notes.is_empty());
    folder.write("t.jpg", &bytes[..bytes.len() / 2]);
    let loaded = load_file(&obj);
    assert_eq!(loaded.notes, ["the texture 't.jpg' is cut off: the rest of it is filled up"]);
    assert!(mesh(loaded).texture.is_some());
}

#[test]
fn extras_keep_their_type_beside_other_names() {
    let properties = with(&XYZ, &[("ushort", "intensity"), ("uchar", "r")]);
    for bytes in in_all_encodings("vertex", &[], &properties, &[&[1., 2., 3., 40_000., 9.]]) {
        let found = points(read(Format::Ply, bytes));
        assert_eq!(found.extras[0].values, ExtraValues::U16(vec![40_000]));
        assert_eq!(found.extras[1].values, ExtraValues::U8(vec![9]), "one letter alone is no colour");
    }
}

/// Builds a Draco stream of points without compression. An attribute is its kind (0: positions, 2: colours, 4:
/// generic), its number type, its components, and its numbers, little-endian.
#[cfg(feature = "draco")]
fn draco_points(version: [u8; 2], count: u32, attributes: &[(u8, u8, u8, Vec<u8>)]) -> Vec<u8> {
    // Points, sequential, no flags; one decoder of all attributes, stored uncompressed.
    let mut bytes = [&b"DRACO"[..], &version, &[0; 4]].concat();
    bytes.extend(count.to_le_bytes());
    bytes.extend([1, attributes.len() as u8]);
    // Draco 2 has shorter header fields.
    let padding = |zeros: usize| vec![0; if version[0] < 2 { zeros } else { 0 }];
    bytes.extend(padding(3));
    for (i, (purpose, kind, components, _)) in attributes.iter().enumerate() {
        bytes.extend([*purpose, *kind, *components, 0, i as u8]);
        bytes.extend(padding(1));
    }
    bytes.extend(attributes.iter().map(|_| 0));
    attributes.iter().for_each(|(.., numbers)| bytes.extend(numbers));
    bytes
}

#[cfg(feature = "draco")]
#[test]
fn draco_numbers_keep_their_digits_and_colors_count_to_what_they_need() {
    // Draco's ids of number types.
    let [u8s, u16s, i32s, u32s, f32s, f64s] = [2, 4, 5, 6, 9, 10];
    let places = [[637_012.24, 849_028.31, 431.66], [637_013.5, 849_029.75, -2.125]];
    let doubles: Vec<u8> = places.iter().flatten().flat_map(|x: &f64| x.to_le_bytes()).collect();
    let shorts = |levels: &[u16]| levels.iter().flat_map(|c| c.to_le_bytes()).collect::<Vec<u8>>();
    let times = [245_380.782_548_54_f64, 1e9 + 0.25];
    let read_points = |attributes: &[_]| {
        let loaded = read(Format::Drc, draco_points([2, 3], 2, attributes));
        (loaded.notes.clone(), points(loaded))
    };
    let (notes, cloud) = read_points(&[
        (0, f64s, 3, doubles.clone()),
        (2, u16s, 3, shorts(&[68, 77, 88, 255, 0, 1])),
        (4, f64s, 1, times.iter().flat_map(|t| t.to_le_bytes()).collect()),
        (4, u16s, 1, shorts(&[7326, 65_535])),
        (4, i32s, 1, [-3_i32, i32::MAX].iter().flat_map(|t| t.to_le_bytes()).collect()),
    ]);
    for (i, place) in places.iter().enumerate() {
        let error = (cloud.origin + cloud.positions.get(i) - DVec3::from(*place)).length();
        assert!(error < 1e-9, "{i}: {error}");
    }
    let colors = cloud.colors.unwrap();
    assert_color(colors[0], [68.0, 77.0, 88.0], 255.0);
    assert_color(colors[1], [255.0, 0.0, 1.0], 255.0);
    assert_eq!(notes, ["its colours count to 255 instead of 65535: taken as 8 bits"]);
    let values: Vec<_> = cloud.extras.iter().map(|extra| extra.values.clone()).collect();
    let expected =
        [ExtraValues::F64(times.to_vec()), ExtraValues::U16(vec![7326, 65_535]), ExtraValues::I32(vec![-3, i32::MAX])];
    assert_eq!(values, expected);

    // Colours of other types, and their ranges.
    let floats = |levels: &[f32]| levels.iter().flat_map(|c| c.to_le_bytes()).collect::<Vec<u8>>();
    let words = |levels: &[u32]| levels.iter().flat_map(|c| c.to_le_bytes()).collect::<Vec<u8>>();
    for (kind, numbers, levels, most) in [
        (u8s, vec![68, 77, 88, 1, 0, 1], [68.0, 77.0, 88.0], 255.0),
        (u16s, shorts(&[68, 77, 256, 1, 0, 1]), [68.0, 77.0, 256.0], 65_535.0),
        (u32s, words(&[68, 77, 88, 1, 0, 1]), [68.0, 77.0, 88.0], 255.0),
        (f32s, floats(&[0.25, 0.5, 1.0, 0.0, 0.0, 0.0]), [0.25, 0.5, 1.0], 1.0),
        (f32s, floats(&[68.0, 77.0, 88.0, 1.0, 0.0, 1.0]), [68.0, 77.0, 88.0], 255.0),
    ] {
        let (_, cloud) = read_points(&[(0, f64s, 3, doubles.clone()), (2, kind, 3, numbers)]);
        assert_color(cloud.colors.unwrap()[0], levels, most);
    }
    // Opaque where the alpha has the full range of the colours.
    let four = shorts(&[68, 77, 88, 255, 1, 0, 1, 51]);
    let (_, cloud) = read_points(&[(0, f64s, 3, doubles), (2, u16s, 4, four)]);
    assert_eq!(cloud.alphas.unwrap(), [1.0, 0.2]);
    // Draco streams from before 1.0 (bitstream 1.1), which are still common.
    let old = draco_points([1, 1], 2, &[(0, f32s, 3, floats(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.5]))]);
    let cloud = points(read(Format::Drc, old));
    assert_eq!([0, 1].map(|i| cloud.positions.get(i)), [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.5)]);
}
