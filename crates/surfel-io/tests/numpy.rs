//! NumPy arrays, alone and several in a file. The tests build the files byte by byte.

use flate2::Compression;
use flate2::write::DeflateEncoder;
use glam::DVec3;
use std::io::Write;
use surfel_io::{Content, Format};
use surfel_model::{ExtraValues, Up};

use crate::point_formats::{HALF_OF_255, le, load, places, points, refused, refused_when_cut, try_load};

pub(crate) fn npy(descr: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}, }}");
    let header = format!("{header:<width$}\n", width = (header.len() + 11).next_multiple_of(64) - 11);
    [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), data].concat()
}

#[test]
fn npy_of_every_type_and_order() {
    let values: Vec<f64> = (1..=6).map(f64::from).collect();
    let bytes =
        |f: &dyn Fn(f64) -> Vec<u8>, order: [usize; 6]| order.iter().flat_map(|&i| f(values[i])).collect::<Vec<u8>>();
    let (c, fortran) = ([0, 1, 2, 3, 4, 5], [0, 3, 1, 4, 2, 5]);
    type Encode<'a> = &'a dyn Fn(f64) -> Vec<u8>;
    let kinds: [(&str, Encode<'_>); 12] = [
        ("'<f4'", &|v| (v as f32).to_le_bytes().into()),
        ("'>f4'", &|v| (v as f32).to_be_bytes().into()),
        ("'<f8'", &|v| v.to_le_bytes().into()),
        ("'>f8'", &|v| v.to_be_bytes().into()),
        ("'<f2'", &|v| half::f16::from_f64(v).to_le_bytes().into()),
        ("'|i1'", &|v| vec![v as u8]),
        ("'|u1'", &|v| vec![v as u8]),
        ("'>i2'", &|v| (v as i16).to_be_bytes().into()),
        ("'<u2'", &|v| (v as u16).to_le_bytes().into()),
        ("'<i4'", &|v| (v as i32).to_le_bytes().into()),
        ("'>u4'", &|v| (v as u32).to_be_bytes().into()),
        ("'<i8'", &|v| (v as i64).to_le_bytes().into()),
    ];
    let expected = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)];
    for (descr, f) in kinds {
        for (order, name, shape) in [(c, "False", "(2, 3)"), (fortran, "True", "(2, 3)"), (c, "False", "(1, 2L, 3)")] {
            let file = npy(descr, name, shape, &bytes(f, order));
            assert_eq!(places(&points(load("a", &file))), expected, "{descr} {name} {shape}");
            refused_when_cut("a.npy", &file, 0);
        }
    }
}

#[test]
fn npy_columns_are_told_by_content_or_by_name() {
    for (row, attributes) in [
        (&[1.0, 2.0, 3.0, 0.5][..], "position intensity"),
        (&[1.0, 2.0, 3.0, 0.5, 0.25, 0.125], "position colour"),
        (&[1.0, 2.0, 3.0, 0.6, 0.0, -0.8], "position normal"),
        (&[1.0, 2.0, 3.0, 0.6, 0.0, -0.8, 10.0, 20.0, 255.0], "position normal colour"),
        (&[1.0, 2.0, 3.0, 0.5, 7.0], "position column_4 column_5"),
    ] {
        let loaded = load("a", npy("'<f4'", "False", &format!("(1, {})", row.len()), &le(row)));
        assert_eq!(loaded.attributes.join(" "), attributes);
        assert!(loaded.notes[0].contains(&format!("the array of 1×{} as points", row.len())), "{:?}", loaded.notes);
    }
    let descr = "[('xyz', '<f4', (3,)), ('', '|V2'), ('rgb', '|u1', (3,)), (('title', 'label'), '>i2'), ('id', '<U2'), \
                 ('ok', '|b1')]";
    let row = [&le(&[1.0, 2.0, 3.0])[..], &[9, 9], &[255, 128, 0], &[1, 2], &[0; 8], &[1]].concat();
    let loaded = load("a", npy(descr, "False", "(1,)", &row));
    assert_eq!(loaded.notes, ["left out the fields id: they aren't numbers"]);
    let cloud = points(loaded);
    assert_eq!(
        (cloud.positions.get(0), cloud.colors.unwrap()[0]),
        (DVec3::new(1.0, 2.0, 3.0), [1.0, HALF_OF_255, 0.0])
    );
    assert_eq!((cloud.extras[0].name.as_str(), &cloud.extras[0].values), ("label", &ExtraValues::I16(vec![258])));
    assert_eq!((cloud.extras[1].name.as_str(), &cloud.extras[1].values), ("ok", &ExtraValues::U8(vec![1])));
}

#[test]
fn npy_faults_are_errors() {
    let data = le(&[0.0; 6]);
    for (descr, shape, expected) in [
        ("'<f4'", "(3, 3)", "24 bytes for an array of 3×3"),
        ("'<f4'", "(18446744073709551615, 3)", "18446744073709551615×3 elements"),
        ("'<f4'", "(0, 18446744073709551615, 18446744073709551615)", "bytes for an array"),
        ("'<f4'", "(0, 3)", "holds no point"),
        ("'<f4'", "(3, 2)", "an array of 3×2 numbers"),
        ("'<f4'", "(6,)", "an array of 6 numbers"),
        ("'<f4'", "()", "an array of  numbers"),
        ("'<c8'", "(1, 3)", "NumPy's type '<c8'"),
        ("'|O'", "(1, 3)", "NumPy's type '|O'"),
        ("'<f99999999999999999999'", "(1, 3)", "the array's header is"),
        ("[('x', '<f4'), ('y', '<f4')]", "(1,)", "no position: they have x y"),
        ("[[[[[[[[[[[[1]]]]]]]]]]]]", "(1,)", "the array's header is"),
        ("'<f4', 'x'", "(1, 3)", "the array's header is"),
    ] {
        refused("a.npy", npy(descr, "False", shape, &data), expected);
    }
    refused("a.npy", b"\x93NUMPY\x09\x00", "format 9");
    refused("a.npy", b"hello", "is no array of NumPy");
    refused("a", npy("'<f4'", "False", "(480, 640)", &[0; 480 * 640 * 4]), "480×640");
}

#[test]
fn npy_of_a_depth_camera_s_pixels_states_the_camera() {
    // A wall with a step in the space of a camera of 60 px focal length: x right, y down, z ahead. Some pixels have no
    // depth.
    let (columns, rows) = (64, 48);
    let pixel = |i: usize| {
        let (column, row) = ((i % columns) as f32, (i / columns) as f32);
        let depth = if column > 40.0 { 1.2 } else { 2.0 + 0.1 * (0.3 * row).sin() };
        let missing = if i.is_multiple_of(9) { f32::NAN } else { 1.0 };
        [(column - 31.0) / 60.0 * depth, (row - 23.0) / 60.0 * depth, missing * depth]
    };
    let image: Vec<[f32; 3]> = (0..columns * rows).map(pixel).collect();
    let read = |pixels: &[[f32; 3]], shape: &str| {
        let loaded = load("a", npy("'<f4'", "False", shape, &le(pixels.as_flattened())));
        let is_noted = loaded.notes.iter().any(|note| note.contains("a camera's depth image"));
        let found = points(loaded);
        (found.up, found.viewpoint, is_noted)
    };
    let at_origin = Some(DVec3::ZERO);
    assert_eq!(read(&image, "(48, 64, 3)"), (Some(Up::MinusY), at_origin, true));
    let opengl: Vec<[f32; 3]> = image.iter().map(|[x, y, z]| [*x, -y, -z]).collect();
    assert_eq!(read(&opengl, "(48, 64, 3)"), (Some(Up::PlusY), at_origin, true));
    // In the camera's axes turned by a quarter, without rows, and with rows and columns exchanged, it is none.
    let turned: Vec<[f32; 3]> = image.iter().map(|[x, y, z]| [*z, -x, -y]).collect();
    for (pixels, shape) in [(&turned, "(48, 64, 3)"), (&image, "(3072, 3)"), (&image, "(64, 48, 3)")] {
        assert_eq!(read(pixels, shape), (None, None, false), "{shape}");
    }
}

#[test]
fn arrays_are_counted_with_their_normals_and_colours() {
    let folder = std::env::temp_dir().join(format!("surfel-numpy-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let array = |descr: &str, width: usize, bytes: usize| {
        npy(descr, "False", &format!("(10, {width})"), &vec![1; 10 * width * bytes])
    };
    let xyz = array("'<f4'", 3, 4);
    let record = "[('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('nx', '<f4'), ('ny', '<f4'), ('nz', '<f4')]";
    let colors = ("colors.npy", array("'|u1'", 3, 1));
    let normals = ("normals.npy", array("'<f4'", 3, 4));
    let points = || ("points.npy", xyz.clone());
    for (name, bytes, has_normals, has_colors) in [
        ("a.npy", xyz.clone(), false, false),
        ("b.npy", array("'<f8'", 4, 8), false, false),
        ("c.npy", array("'<f4'", 6, 4), false, true),
        ("d.npy", npy(record, "False", "(10,)", &[1; 240]), true, false),
        ("e.npz", zip(&[points()], false, b""), false, false),
        ("f.npz", zip(&[points(), colors.clone()], true, b""), false, true),
        ("g.npz", zip(&[points(), normals.clone()], false, b""), true, false),
        ("h.npz", zip(&[points(), colors, normals], false, b""), true, true),
    ] {
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        let count = surfel_io::survey_points(&path, None).unwrap();
        assert_eq!((count.points, count.has_normals, count.has_colors), (10, has_normals, has_colors), "{name}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Builds a ZIP file with a comment. Its members are deflated if `deflate`.
pub(crate) fn zip(members: &[(&str, Vec<u8>)], deflate: bool, comment: &[u8]) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in members {
        let packed = if deflate {
            let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
            encoder.write_all(content).unwrap();
            encoder.finish().unwrap()
        } else {
            content.clone()
        };
        let start = bytes.len() as u32;
        let method = [if deflate { 8 } else { 0 }, 0];
        let sizes = [(packed.len() as u32).to_le_bytes(), (content.len() as u32).to_le_bytes()].concat();
        let length = (name.len() as u16).to_le_bytes();
        // As in NumPy's files, only the directory states the sizes.
        bytes.extend([b"PK\x03\x04\x14\0\0\0", &method[..], &[0; 4], &[0; 4], &[0xff; 8], &length, &[0, 0]].concat());
        bytes.extend(name.as_bytes());
        bytes.extend(&packed);
        directory.extend([b"PK\x01\x02\x14\0\x14\0\0\0", &method[..], &[0; 8], &sizes, &length, &[0; 12]].concat());
        directory.extend(start.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let (count, start) = ((members.len() as u16).to_le_bytes(), (bytes.len() as u32).to_le_bytes());
    let size = (directory.len() as u32).to_le_bytes();
    bytes.extend(&directory);
    let end =
        [b"PK\x05\x06\0\0\0\0", &count[..], &count, &size, &start, &(comment.len() as u16).to_le_bytes(), comment];
    bytes.extend(end.concat());
    bytes
}

#[test]
fn npz_goes_by_names() {
    let xyz = npy("'<f4'", "False", "(2, 3)", &le(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
    let colors = npy("'|u1'", "False", "(2, 3)", &[255, 128, 0, 0, 0, 255]);
    let normals = npy("'<f4'", "True", "(2, 3)", &le(&[0.0, 0.0, 0.0, 1.0, 1.0, 0.0]));
    let radii = npy("'<f4'", "False", "(2,)", &le(&[0.5, 0.25]));
    let label = npy("'<i8'", "False", "(2,)", &[[7_u8, 0, 0, 0, 0, 0, 0, 0], [8, 0, 0, 0, 0, 0, 0, 0]].concat());
    let title = npy("'<U5'", "False", "()", &[0; 20]);
    let members = [("points.npy", xyz.clone()), ("colors.npy", colors), ("label.npy", label), ("title.npy", title)];
    for (deflate, comment) in [(false, &b""[..]), (true, b"a comment PK\x05\x06")] {
        let loaded = load("a", zip(&members, deflate, comment));
        assert_eq!((loaded.format, loaded.up), (Format::Npz, Up::PlusZ));
        assert!(loaded.notes[0].starts_with("ignored the arrays title:"), "{:?}", loaded.notes);
        assert_eq!(loaded.attributes.join(" "), "position colour label");
        let cloud = points(loaded);
        assert_eq!(cloud.colors.as_ref().unwrap()[0], [1.0, HALF_OF_255, 0.0]);
        assert_eq!(cloud.extras[0].values, ExtraValues::F64(vec![7.0, 8.0]));
    }
    // Normals and radii make disks.
    let members = [("xyz.npy", xyz.clone()), ("normals.npy", normals), ("radii.npy", radii)];
    let Content::Splats(cloud) = load("a", zip(&members, true, b"")).content else { panic!() };
    assert_eq!((cloud.radius_max(0), cloud.radius_max(1)), (0.5, 0.25));
    // Separate x, y and z; any name if there is only one array; a mesh.
    let one = |v: f32| npy("'<f4'", "False", "(1,)", &le(&[v]));
    let members = [("y.npy", one(2.0)), ("x.npy", one(1.0)), ("z.npy", one(3.0))];
    assert_eq!(places(&points(load("a", zip(&members, false, b"")))), [DVec3::new(1.0, 2.0, 3.0)]);
    assert_eq!(points(load("a", zip(&[("cloud.npy", xyz)], false, b""))).len(), 2);
    let vertices = npy(
        "'<f8'",
        "False",
        "(3, 3)",
        &[[0.0_f64, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
            .as_flattened()
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect::<Vec<u8>>(),
    );
    let face = |i: i8| npy("'|i1'", "False", "(1, 3)", &[0, 1, i as u8]);
    let Content::Mesh(mesh) = load("a", zip(&[("v.npy", vertices.clone()), ("faces.npy", face(2))], true, b"")).content
    else {
        panic!()
    };
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    for i in [3, -1] {
        assert!(try_load("a", &zip(&[("vertices.npy", vertices.clone()), ("faces.npy", face(i))], true, b"")).is_err());
    }
}

#[test]
fn npz_faults_are_errors() {
    let xyz = npy("'<f4'", "False", "(2, 3)", &le(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
    let whole = zip(&[("points.npy", xyz.clone())], true, b"");
    refused_when_cut("a.npz", &whole, 0);
    refused(
        "a.npz",
        zip(&[("a.npy", npy("'<f4'", "False", "(2,)", &[0; 8]))], false, b""),
        "no array of positions among a",
    );
    refused("a", zip(&[("readme.txt", vec![])], false, b""), "is a ZIP archive");
    // A wrong directory: more than deflate can expand to, more than the file has, an unknown method.
    let at = whole.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
    for (offset, bytes, expected) in [
        (24, &0xffff_fff0_u32.to_le_bytes()[..], "claims to be 4294967280 bytes"),
        (24, &[1, 0, 0, 0], "is damaged"),
        (20, &[0xf0, 0xff, 0, 0], "ends within 'points.npy'"),
        (10, &[9, 0], "method 9"),
        (8, &[1, 0], "encrypted"),
        (42, &[9, 9, 0, 0], "ends within 'points.npy'"),
    ] {
        let mut wrong = whole.clone();
        wrong[at + offset..at + offset + bytes.len()].copy_from_slice(bytes);
        refused("a.npz", wrong, expected);
    }
}
