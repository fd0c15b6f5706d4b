//! PCD, text dialects, PTX, OFF, and gzip files. The tests build the files byte by byte.

#![cfg(all(feature = "npy", feature = "off", feature = "pcd", feature = "points"))]

use crate::numpy::{npy, zip};
use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DVec3;
use pcd_rs::{DataKind, DynReader, DynRecord, Field, ValueKind, WriterInit};
use std::io::Write;
use std::path::Path;
use surfel_io::{Content, Format, LoadOptions, Loaded, load_bytes};
use surfel_model::{ExtraValues, PointCloud, Up};

pub(crate) fn try_load(name: &str, bytes: &[u8]) -> Result<Loaded, String> {
    let hint = Format::from_extension(Path::new(name));
    load_bytes(bytes, hint, Path::new(name), &LoadOptions::default())
        .map_err(|e| e.to_string())
        .inspect_err(|e| assert!(e.lines().count() <= 4, "{e}"))
}

pub(crate) fn load(name: &str, bytes: impl AsRef<[u8]>) -> Loaded {
    try_load(name, bytes.as_ref()).unwrap_or_else(|e| panic!("{e}"))
}

pub(crate) fn points(loaded: Loaded) -> PointCloud {
    match loaded.content {
        Content::Points(points) => points,
        other => panic!("{other:?}"),
    }
}

pub(crate) fn refused(name: &str, bytes: impl AsRef<[u8]>, expected: &str) {
    let error = try_load(name, bytes.as_ref()).map(|l| l.content).unwrap_err();
    assert!(error.contains(expected), "{error}\nexpected: {expected}");
}

/// Asserts that every truncation of a file gives an error.
pub(crate) fn refused_when_cut(name: &str, bytes: &[u8], from: usize) {
    for end in from..bytes.len() {
        assert!(try_load(name, &bytes[..end]).is_err(), "{name} cut at {end} of {}", bytes.len());
    }
}

pub(crate) fn places(cloud: &PointCloud) -> Vec<DVec3> {
    (0..cloud.len()).map(|i| cloud.origin + cloud.positions.get(i)).collect()
}

/// Linear value of the sRGB-encoded level 128 of 255.
pub(crate) const HALF_OF_255: f32 = 0.215_860_5;
const HALF: f32 = 0.214_041_14;

fn pcd(fields: &str, sizes: &str, types: &str, points: usize, data: &str, body: &[u8]) -> Vec<u8> {
    let header = format!(
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {types}\n\
         WIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    );
    [header.as_bytes(), body].concat()
}

/// Encodes bytes by LZF with literals only.
fn lzf_literals(data: &[u8]) -> Vec<u8> {
    data.chunks(32).flat_map(|c| std::iter::once(c.len() as u8 - 1).chain(c.iter().copied())).collect()
}

fn compressed(stream: &[u8], whole: usize) -> Vec<u8> {
    [&(stream.len() as u32).to_le_bytes(), &(whole as u32).to_le_bytes(), stream].concat()
}

pub(crate) fn le(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

const FIELDS: [&str; 3] =
    ["x y z rgb normal_x normal_y normal_z intensity label", "4 4 4 4 4 4 4 4 2", "F F F F F F F F U"];

/// Returns the same three points, the last of them NaN, as text, binary and compressed.
fn three_pcds() -> [Vec<u8>; 3] {
    let [fields, sizes, types] = FIELDS;
    let color = f32::from_bits(0x00ff_8000);
    let rows = [
        ([1.0, 2.0, 3.0, color, 0.0, 0.0, 1.0, 0.25], 7_u16),
        ([4.0, 5.0, 6.0, color, 0.0, 1.0, 0.0, 0.5], 65_535),
        ([f32::NAN, 0.0, 0.0, color, 0.0, 1.0, 0.0, 0.5], 9),
    ];
    let text: String = rows
        .iter()
        .map(|(v, label)| {
            let v: Vec<String> = v.iter().map(|v| format!("{v:e}")).collect();
            format!("{} {label}\n", v.join(" "))
        })
        .collect();
    let binary: Vec<u8> = rows.iter().flat_map(|(v, label)| [le(v), label.to_le_bytes().to_vec()].concat()).collect();
    let by_field: Vec<u8> = (0..8)
        .flat_map(|k| rows.iter().flat_map(move |(v, _)| v[k].to_le_bytes()))
        .chain(rows.iter().flat_map(|(_, label)| label.to_le_bytes()))
        .collect();
    let packed = compressed(&lzf_literals(&by_field), by_field.len());
    [("ascii", text.as_bytes()), ("binary", &binary), ("binary_compressed", &packed)]
        .map(|(name, body)| pcd(fields, sizes, types, 3, name, body))
}

#[test]
fn pcd_is_the_same_in_each_encoding() {
    for bytes in three_pcds() {
        let loaded = load("a", &bytes);
        assert_eq!((loaded.format, loaded.up), (Format::Pcd, Up::PlusZ));
        assert_eq!(loaded.notes, ["dropped 1 point whose coordinates are not finite"]);
        assert_eq!(loaded.attributes.join(" "), "position normal colour intensity label");
        let cloud = points(loaded);
        assert_eq!(places(&cloud), [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)]);
        assert_eq!(cloud.colors.unwrap()[1], [1.0, HALF_OF_255, 0.0]);
        assert_eq!(cloud.normals.unwrap().get(1), DVec3::Y);
        assert_eq!(cloud.extras[0].values, ExtraValues::F32(vec![0.25, 0.5]));
        assert_eq!(cloud.extras[1].values, ExtraValues::U16(vec![7, 65_535]));
    }
    let [text, binary, packed] = three_pcds();
    refused_when_cut("a.pcd", &binary, 0);
    refused_when_cut("a.pcd", &packed, 0);
    // Missing last digits of a text can't be detected.
    refused_when_cut("a.pcd", &text[..text.len() - 2], 0);
}

/// Returns points of all types of PCD, including floats whose text must be parsed exactly.
fn pcd_rs_points() -> (pcd_rs::Schema, Vec<DynRecord>) {
    let kinds = [
        ("x", ValueKind::F32, 1),
        ("y", ValueKind::F64, 1),
        ("z", ValueKind::F32, 1),
        ("a", ValueKind::U8, 1),
        ("b", ValueKind::U16, 3),
        ("c", ValueKind::U32, 1),
        ("d", ValueKind::I8, 1),
        ("e", ValueKind::I16, 1),
        ("f", ValueKind::I32, 2),
    ];
    let row = |i: i64| {
        // Runs of equal values become short and long LZF references; other values become literals.
        let mixed = (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(29);
        let part = |shift: u32| (mixed >> shift) as i32;
        DynRecord(vec![
            Field::F32(vec![i as f32 / 7.0]),
            Field::F64(vec![5.0e6 + i as f64 / 3.0]),
            Field::F32(vec![if i % 900 < 600 { -2.5 } else { f32::from_bits(0x3000_0000 | part(9) as u32 >> 9) }]),
            Field::U8(vec![(i / 300) as u8]),
            Field::U16(vec![part(3) as u16, 7, (i % 5) as u16]),
            Field::U32(vec![part(20) as u32]),
            Field::I8(vec![part(5) as i8]),
            Field::I16(vec![part(1) as i16]),
            Field::I32(vec![part(31), -1]),
        ])
    };
    (kinds.into_iter().collect(), (0..2500).map(row).collect())
}

#[test]
fn pcd_of_another_program_is_read_to_the_bit() {
    let (schema, records) = pcd_rs_points();
    for data_kind in [DataKind::Ascii, DataKind::Binary, DataKind::BinaryCompressed] {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let (width, height) = (records.len() as u64, 1);
        let viewpoint = Default::default();
        let init = WriterInit { width, height, viewpoint, data_kind, schema: Some(schema.clone()), version: None };
        let mut writer = init.build_from_writer(&mut bytes).unwrap();
        records.iter().for_each(|record| writer.push(record).unwrap());
        writer.finish().unwrap();
        let bytes = bytes.into_inner();
        let cloud = points(load("a", &bytes));
        assert_eq!(cloud.len(), records.len(), "{data_kind:?}");
        let value = |i: usize, field: usize, k: usize| match &records[i].0[field] {
            Field::U8(v) => f64::from(v[k]),
            Field::U16(v) => f64::from(v[k]),
            Field::U32(v) => f64::from(v[k]),
            Field::I8(v) => f64::from(v[k]),
            Field::I16(v) => f64::from(v[k]),
            Field::I32(v) => f64::from(v[k]),
            Field::F32(v) => f64::from(v[k]),
            Field::F64(v) => v[k],
            other => panic!("{other:?}"),
        };
        let names = [("a", 3, 0), ("b_0", 4, 0), ("b_1", 4, 1), ("b_2", 4, 2), ("c", 5, 0), ("d", 6, 0), ("e", 7, 0)];
        for i in 0..cloud.len() {
            let p = cloud.origin + cloud.positions.get(i);
            let truth = DVec3::new(value(i, 0, 0), value(i, 1, 0), value(i, 2, 0));
            // f32 pairs have 48 bits of a coordinate that is about 800 from the middle at 5e6: the origin's own
            // rounding is larger.
            assert!((p - truth).abs().max_element() <= 1e-9, "{data_kind:?} {i}: {p} {truth}");
            for (name, field, k) in names.into_iter().chain([("f_0", 8, 0), ("f_1", 8, 1)]) {
                let column = cloud.extras.iter().find(|e| e.name == name).unwrap_or_else(|| panic!("{name}"));
                assert_eq!(column.values.get(i), value(i, field, k), "{data_kind:?} {name} {i}");
            }
        }
    }
}

#[test]
fn pcd_means_the_same_to_another_program() {
    for bytes in three_pcds() {
        let cloud = points(load("a", &bytes));
        let others: Vec<DynRecord> = DynReader::from_bytes(&bytes).unwrap().collect::<Result<_, _>>().unwrap();
        assert_eq!(others.len(), 3);
        for (place, other) in places(&cloud).iter().zip(&others) {
            assert_eq!(Some(place.as_vec3().to_array()), other.to_xyz::<f32>());
        }
    }
}

#[test]
fn pcd_of_every_dialect() {
    // No comment at the start, no COUNT and no POINTS, CRLF.
    let old = "VERSION .7\r\nFIELDS x y z\r\nSIZE 4 4 4\r\nTYPE F F F\r\nWIDTH 2\r\nHEIGHT 1\r\nDATA \
               ascii\r\n1 2 3\r\nnan nan nan\r\n";
    assert_eq!(points(load("a", old)).len(), 1);
    // Packed colours as whole numbers although their type is F; rgba with and without an alpha.
    let color =
        |fields, types, text: &str| points(load("a", pcd(fields, "4 4 4 4", types, 1, "ascii", text.as_bytes())));
    assert_eq!(color("x y z rgb", "F F F F", "1 2 3 16744448\n").colors.unwrap()[0], [1.0, HALF_OF_255, 0.0]);
    assert_eq!(color("x y z rgb", "F F F U", "1 2 3 4286578688\n").colors.unwrap()[0], [HALF_OF_255, 0.0, 0.0]);
    let opaque = color("x y z rgba", "F F F U", "1 2 3 8388608\n");
    assert_eq!((opaque.colors.unwrap()[0], opaque.alphas), ([HALF_OF_255, 0.0, 0.0], None));
    let half = color("x y z rgba", "F F F U", &format!("1 2 3 {}\n", 51_u32 << 24));
    assert_eq!(half.alphas.unwrap(), [0.2]);
    // Padding, a field of two numbers, 64-bit times, and coordinates in f64.
    let header = "# .PCD v0.7\nFIELDS x y z _ two t\nSIZE 8 8 8 1 4 8\nTYPE F F F U I U\nCOUNT 1 1 1 3 2 1\nWIDTH 1\n\
                  HEIGHT 1\nVIEWPOINT 1 2 3 0 1 0 0\nPOINTS 1\nDATA binary\n";
    let mut bytes = header.as_bytes().to_vec();
    [500_000.125_f64, 5_000_000.001, 1.5].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes.extend([9, 9, 9]);
    [-1_i32, 2].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes.extend(1_700_000_000_123_456_u64.to_le_bytes());
    let loaded = load("a", &bytes);
    assert!(loaded.notes[0].contains("VIEWPOINT 1 2 3 0 1 0 0"), "{:?}", loaded.notes);
    let cloud = points(loaded);
    assert_eq!(cloud.comments, ["VIEWPOINT 1 2 3 0 1 0 0"]);
    // Tolerance: the last digit of an f64 at 5e6.
    assert!((places(&cloud)[0] - DVec3::new(500_000.125, 5_000_000.001, 1.5)).length() < 1e-9);
    let names: Vec<&str> = cloud.extras.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["two_0", "two_1", "t"]);
    assert_eq!(cloud.extras[0].values, ExtraValues::I32(vec![-1]));
    assert_eq!(cloud.extras[2].values, ExtraValues::F64(vec![1_700_000_000_123_456.0]));
}

#[test]
fn pcd_references_of_lzf_are_followed() {
    // Twelve zeros: one literal and an overlapping reference; then a long reference of 7 + 15 + 2.
    let short = [0x00, 0, 0xe0, 2, 0];
    let bytes = pcd("x y z", "4 4 4", "F F F", 1, "binary_compressed", &compressed(&short, 12));
    assert_eq!(places(&points(load("a", &bytes))), [DVec3::ZERO]);
    let two: Vec<u8> = [&[11][..], &le(&[1.0, 2.0, 3.0]), &[0x40, 11, 0x40, 11, 0x40, 11]].concat();
    let bytes = pcd("x y z", "4 4 4", "F F F", 2, "binary_compressed", &compressed(&two, 24));
    // Field by field: 1 2, 3 1, 2 3.
    assert_eq!(places(&points(load("a", &bytes))), [DVec3::new(1.0, 3.0, 2.0), DVec3::new(2.0, 1.0, 3.0)]);
    for (damaged, why) in [
        (vec![0x00, 0, 0xe0, 2, 1], "a reference to before the start"),
        (vec![0x00, 0, 0xe0, 3, 0], "too long"),
        (vec![0x00, 0, 0xe0, 1, 0], "too short"),
        (vec![0x00, 0, 0xe0, 2], "cut"),
        (vec![0x0b, 0], "cut literals"),
    ] {
        let bytes = pcd("x y z", "4 4 4", "F F F", 1, "binary_compressed", &compressed(&damaged, 12));
        assert!(try_load("a", &bytes).unwrap_err().contains("compressed points are damaged"), "{why}");
    }
}

#[test]
fn pcd_faults_are_errors() {
    let ok = "# .PCD v0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA \
              ascii\n1 2 3\n";
    assert!(try_load("a", ok.as_bytes()).is_ok());
    for (from, to, expected) in [
        ("POINTS 1", "POINTS 18446744073709551615", "more than there can be"),
        ("POINTS 1", "POINTS 4000000000", "ends after 1 of 4000000000 points"),
        ("POINTS 1", "POINTS -1", "'-1' as its POINTS (line 8)"),
        ("POINTS 1", "POINTS 0", "holds no point"),
        ("COUNT 1 1 1", "COUNT 0 0 0", "no numbers"),
        ("COUNT 1 1 1", "COUNT 1 1 18446744073709551615", "more than there can be"),
        ("SIZE 4 4 4", "SIZE 4 4 3", "the type 'F' of 3 bytes"),
        ("FIELDS x y z", "FIELDS a b c", "no position: the fields are a b c"),
        ("FIELDS x y z", "HELLO x y z", "unknown line 'HELLO' (line 2)"),
        ("DATA ascii", "DATA zip", "the PCD data are 'zip'"),
        ("DATA ascii\n1 2 3\n", "", "no DATA line"),
        ("1 2 3", "1 2", "point 0 has too few numbers (line 10)"),
        ("1 2 3", "1 2 3 4", "point 0 has too many numbers"),
        ("1 2 3", "1 2 c", "found 'c' as 'z' (line 10)"),
    ] {
        // A COUNT of 2⁶⁴ − 1 overflows with more than one point.
        let text = ok.replace(from, to);
        let text = if to.starts_with("COUNT 1 1 18") { text.replace("POINTS 1", "POINTS 2") } else { text };
        refused("a.pcd", text, expected);
    }
    let huge = pcd("x y z", "4 4 4", "F F F", 1 << 40, "binary", &[0; 24]);
    refused("a", huge, "ends within point 2 of 1099511627776");
    let bomb = pcd("x y z", "4 4 4", "F F F", 300_000_000, "binary_compressed", &compressed(&[0; 9], 3_600_000_000));
    refused("a", bomb, "can't become 300000000 points");
}

fn gzip(content: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(content).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn gzip_is_unwrapped_and_content_decides() {
    let ply = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float \
                z\nend_header\n1 2 3";
    assert_eq!(Format::from_extension(Path::new("a.XYZ.gz")), Some(Format::Xyz));
    assert_eq!(Format::from_extension(Path::new("a.gz")), None);
    for name in ["a.ply.gz", "a.xyz.gz", "a.gz", "a"] {
        assert_eq!(load(name, gzip(ply)).format, Format::Ply);
    }
    let text = load("a.pts.gz", gzip(b"1\n1 2 3\n"));
    assert_eq!((text.format, points(text).len()), (Format::Pts, 1));
    // Several members are concatenated; truncation, a wrong checksum and too much data are errors.
    assert_eq!(points(load("a.xyz.gz", [gzip(b"1 2 3\n"), gzip(b"4 5 6\n")].concat())).len(), 2);
    let whole = gzip(&b"1 2 3\n".repeat(500));
    refused_when_cut("a.xyz.gz", &whole, 2);
    refused("a.xyz.gz", &whole[..whole.len() - 9], "ends too early");
    let mut wrong = whole;
    let n = wrong.len();
    wrong[n - 5] ^= 1;
    refused("a.xyz.gz", wrong, "damaged gzip file");
    refused("a.xyz.gz", gzip(&vec![b'\n'; 80 << 20]), "compressed by gzip to");
    refused("a.gz", gzip(&gzip(b"1 2 3\n")), "in no format");
}

#[cfg(all(feature = "laz", feature = "e57"))]
#[test]
fn npz_ptx_and_gzip_are_written_by_levels_as_they_are_read() {
    use crate::support::same_by_levels;
    let rows: Vec<[f32; 3]> = (0..3000).map(|i: u16| [f32::from(i) * 0.5, f32::from(i % 60), 0.25]).collect();
    let shape = |width: usize| format!("(3000, {width})");
    let xyz = npy("'<f4'", "False", &shape(3), &le(rows.as_flattened()));
    let colors = npy("'|u1'", "False", &shape(3), &(0..9000).map(|i| (i % 251) as u8).collect::<Vec<u8>>());
    let label: Vec<u8> = (0..3000_i64).flat_map(|i| (i * 7).to_le_bytes()).collect();
    let label = npy("'<i8'", "False", "(3000,)", &label);
    let title = npy("'<U5'", "False", "()", &[0; 20]);
    let members = [("title.npy", title), ("points.npy", xyz.clone()), ("colors.npy", colors), ("label.npy", label)];
    let line = |(i, [x, y, z]): (usize, &[f32; 3])| format!("{x} {y} {z} {i} 1 2 3\n");
    let text: String = rows.iter().enumerate().map(line).collect();
    let scan = PTX[..PTX.find("1 0 0 0.5").unwrap()].replace("2\n2\n", "3001\n1\n");
    let ptx = format!("{scan}{text}0 0 0 0.5 0 0 0\n{PTX}");
    let named = format!("x y z number red green blue\n{text}");
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 3000\nproperty float x\nproperty float y\nproperty float z\nproperty \
         int number\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n{text}"
    );
    let numbers: Vec<f32> = rows.iter().enumerate().flat_map(|(i, [x, y, z])| [*x, *y, *z, i as f32]).collect();
    let npy = npy("'<f4'", "False", &shape(4), &le(&numbers));
    let binary = pcd("x y z number", "4 4 4 4", "F F F F", 3000, "binary", &le(&numbers));
    for (name, bytes, key, count) in [
        ("stored.npz", zip(&members, false, b""), "label", 3000),
        ("deflated.npz", zip(&members, true, b""), "label", 3000),
        ("a.npz.gz", gzip(&zip(&members, true, b"")), "label", 3000),
        ("a.ptx", ptx.clone().into_bytes(), "intensity", 3003),
        ("a.ptx.gz", gzip(ptx.as_bytes()), "intensity", 3003),
        ("a.ply.gz", gzip(ply.as_bytes()), "number", 3000),
        ("a.xyz.gz", gzip(named.as_bytes()), "number", 3000),
        ("two.xyz.gz", [gzip(&named.as_bytes()[..2000]), gzip(&named.as_bytes()[2000..])].concat(), "number", 3000),
        ("a.npy.gz", gzip(&npy), "index", 3000),
        ("a.pcd.gz", gzip(&binary), "number", 3000),
    ] {
        let (all, ..) = same_by_levels(name, &bytes, (key, 0.0), None).unwrap();
        assert_eq!(all.points.len(), count, "{name}");
        let path = std::env::temp_dir().join(format!("surfel-survey-{}-{name}", std::process::id()));
        std::fs::write(&path, &bytes).unwrap();
        let surveyed = surfel_io::survey_points(&path, None).map(|count| count.points);
        std::fs::remove_file(&path).unwrap();
        // Without a header, the count is estimated, from the first bytes if the file is compressed.
        assert!(surveyed.unwrap().abs_diff(3000) < 600, "{name}: {surveyed:?}");
    }
    let refused = |name: &str, bytes: &[u8], expected: &str| {
        let error = same_by_levels(name, bytes, ("", 0.0), None).map(|_| ()).unwrap_err();
        assert!(error.contains(expected) && error.contains(name), "{error}\nexpected: {expected}");
    };
    let whole = gzip(named.as_bytes());
    refused("a.xyz.gz", &whole[..whole.len() - 9], "ends too early");
    refused("a.xyz.gz", &gzip(&[named.as_bytes(), &vec![b'\n'; 80 << 20]].concat()), "compressed by gzip to");
    refused("a.ptx", &ptx.as_bytes()[..ptx.len() - "0 0 1 0 0 0 255\n".len()], "ends within the points of scan 2");
    let mut damaged = zip(&members, true, b"");
    damaged[100] ^= 255;
    refused("a.npz", &damaged, "damaged");
    let face = ("faces.npy", npy_of_faces());
    let mesh = [members[1].clone(), face];
    refused("mesh.npz", &zip(&mesh, true, b""), "without radii or faces");
}

#[cfg(all(feature = "laz", feature = "e57"))]
fn npy_of_faces() -> Vec<u8> {
    npy("'|i1'", "False", "(1, 3)", &[0, 1, 2])
}

#[test]
fn text_headers_of_other_programs_are_obeyed() {
    for (text, attributes) in [
        ("//X Y Z R G B Intensity\n1 2 3 10 20 30 5\n", "position colour Intensity"),
        ("//X Y Z Intensity R G B Nx Ny Nz\n1\n1 2 3 5 10 20 30 0 0 1\n", "position normal colour Intensity"),
        ("//X,Y,Z,Rf,Gf,Bf,Scalar field\n1,2,3,0.1,0.2,0.3,7\n", "position colour Scalar field"),
        ("# made by hand\n# x y z label\n1 2 3 4\n", "position label"),
        ("\"X\";\"Y\";\"Z\";\"Gps Time\"\n1;2;3;4\n", "position Gps Time"),
        ("Easting[m]\tNorthing[m]\tElevation[m]\n1\t2\t3\n", "position"),
        ("id,x,y,z,r,g,b,a\n9,1,2,3,255,0,0,255\n", "position colour alpha id"),
        ("x y z red green\n1 2 3 4 5\n", "position red green"),
    ] {
        let loaded = load("a", text);
        assert_eq!(loaded.attributes.join(" "), attributes, "{text}");
        assert!(loaded.notes.iter().all(|n| !n.contains("no first line")), "{:?}", loaded.notes);
        assert_eq!(places(&points(loaded)), [DVec3::new(1.0, 2.0, 3.0)], "{text}");
    }
    // Names that don't match the columns are ignored, with a note.
    let loaded = load("a.xyz", "x y z i\n1 2 3 0.5 0.5 0.5\n");
    let expected =
        "took the columns as x y z red green blue: the line of names has 4, columns 4 to 6 share a range, 0 to 1";
    assert_eq!(loaded.notes[0], format!("{expected}; `columns` names them otherwise"));
    // Whole numbers beyond f32, such as times, keep their digits.
    let cloud = points(load("a.csv", "x,y,z,t\n1,2,3,123456789.25\n"));
    assert_eq!(cloud.extras[0].values, ExtraValues::F64(vec![123_456_789.25]));
}

#[test]
fn degrees_are_told_by_their_names() {
    for header in ["lat,lon,alt,id", "Latitude,Longitude,Height,id", "latitude;longitude;elevation;id"] {
        let divider = if header.contains(';') { ";" } else { "," };
        let rows = "\n47.5,8.25,400,1\n47.6,8.5,401,2\n".replace(',', divider);
        let loaded = load("a.csv", header.to_owned() + &rows);
        assert!(
            loaded.notes.iter().any(|n| n.starts_with("x and y are degrees, by their names")),
            "{:?}",
            loaded.notes
        );
        assert_eq!(places(&points(loaded))[1], DVec3::new(8.5, 47.6, 401.0), "{header}");
    }
    assert!(!load("a.csv", "long,x,y,z\n1,8.25,47.5,400\n").notes.join(" ").contains("degrees"));
}

#[test]
fn seven_columns_are_told_by_their_numbers() {
    for (text, names) in [
        ("1 2 3 -2048 10 20 30\n1 2 3 2047 10 20 255\n", "x y z intensity red green blue"),
        ("1 2 3 10 20 30 -2048\n1 2 3 10 20 255 2047\n", "x y z red green blue intensity"),
        ("1 2 3 10 20 30 4000\n", "x y z red green blue intensity"),
        ("1 2 3 10 20 30 0.5\n", "x y z red green blue intensity"),
        ("1 2 3 0.5 10 20 30\n", "x y z intensity red green blue"),
        // Both are possible: the order of PTS is chosen.
        ("1 2 3 10 20 30 40\n", "x y z intensity red green blue"),
        ("1 2 3 117 73 49 255\n1 2 4 91 87 74 255\n", "x y z red green blue intensity"),
        ("1 2 3 255 117 73 49\n1 2 4 255 91 87 74\n", "x y z intensity red green blue"),
        ("1 2 3 0.5 0.6 0 0.8\n", "x y z intensity nx ny nz"),
    ] {
        let loaded = load("a.xyz", text);
        let expected = format!("took the columns as {names}: no first line names them, ");
        assert!(loaded.notes[0].starts_with(&expected), "{:?}", loaded.notes);
    }
}

#[test]
fn pts_of_seven_columns_have_an_intensity_and_colors() {
    // Greens far from grey, over a range that other numbers may have, too.
    let text: String = (0..400)
        .map(|i| {
            let (x, y) = (f64::from(i % 20), f64::from(i / 20));
            format!("{x:.4} {y:.4} {:.4} 0.0000 {} {} {}\n", (x * y).sin(), i % 58, 91 + i % 80, 45 + i % 19)
        })
        .collect();
    let loaded = load("a.pts", &text);
    assert_eq!(loaded.notes, ["took the colours as sRGB-encoded, from 0 to 255"]);
    let cloud = points(loaded);
    assert_eq!(cloud.extras.iter().map(|extra| extra.name.as_str()).collect::<Vec<_>>(), ["intensity"]);
    let colors = cloud.colors.unwrap();
    let linear = ((98.0_f64 / 255.0 + 0.055) / 1.055).powf(2.4);
    assert!((f64::from(colors[7][1]) - linear).abs() < 1e-6);
    // Columns that can't be colours are judged as in other tables.
    let other = points(load("a.pts", text.replace(" 91 ", " 91.5 ")));
    assert!(other.colors.is_none());
}

#[test]
fn pts_of_every_dialect() {
    for (text, rows, attributes) in [
        ("2\n1 2 3\n4 5 6\n", 2, "position"),
        ("1 2 3 -5\n4 5 6 7\n", 2, "position intensity"),
        ("1\n1 2 3 10 20 30\n1\n4 5 6 10 20 30\n", 2, "position colour"),
        ("1\n1 2 3 -2048 10 20 30\n2\n4 5 6 2047 10 20 30\n7 8 9 0 1 2 3\n", 3, "position colour intensity"),
    ] {
        let loaded = load("a.pts", text);
        assert_eq!(loaded.attributes.join(" "), attributes, "{text}");
        assert!(loaded.notes.iter().all(|n| !n.contains("says that it has")), "{:?}", loaded.notes);
        assert_eq!(points(loaded).len(), rows);
    }
    let loaded = load("a.pts", "5\n1 2 3\n4 5 6\n");
    assert!(loaded.notes.contains(&"the file says that it has 5 points, and has 2".to_owned()), "{:?}", loaded.notes);
}

#[test]
fn decimal_commas_are_read_where_nothing_else_fits() {
    for text in [
        "1,5;2,25;3\n4;5,5;6,0\n",
        "X;Y;Z\n1,5;2,25;3,0\n4;5,5;6\n",
        "2\n1,5 2,25 3,0\n4,0 5,5 6,0\n",
        "1,5\t2,25\t3e0\n4\t5,5\t6\n",
    ] {
        let loaded = load("a.txt", text);
        assert!(loaded.notes[0].starts_with("took commas as decimal points"), "{:?}", loaded.notes);
        assert_eq!(places(&points(loaded)), [DVec3::new(1.5, 2.25, 3.0), DVec3::new(4.0, 5.5, 6.0)], "{text}");
    }
    for text in ["1,2,3\n4,5,6\n", "1, 2, 3\n4, 5, 6\n", "1,2,3\n4;5;6\n", "1 ,2 ,3\n4 ,5 ,6\n"] {
        let cloud = points(load("a.txt", text));
        assert_eq!(places(&cloud), [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)], "{text}");
    }
    // Commas as separators and decimal points at once are ambiguous.
    refused("a.csv", "1,5,2,25,3\n4,0,5,5\n", "if its commas are decimal points");
}

const PTX: &str = "2\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n100 200 300 1\n1 0 0 0.5 255 0 0\n\
                   0 0 0 0.5 0 0 0\n0 1 0 0.25 0 255 0\n0 0 1 0 0 0 255\n";

#[test]
fn ptx_scans_are_moved_by_their_poses() {
    let loaded = load("a", format!("{PTX}{}", PTX.replace("100 200 300", "0 0 0").replace('\n', "\r\n")));
    assert_eq!((loaded.format, loaded.up), (Format::Ptx, Up::PlusZ));
    assert!(loaded.notes.contains(&"left out 2 points at 0 0 0: the scanner got no return there".into()));
    assert_eq!(loaded.attributes.join(" "), "position colour intensity scan");
    let cloud = points(loaded);
    // A quarter turn about z: x to y, y to −x.
    let turned = [DVec3::Y, DVec3::NEG_X, DVec3::Z];
    let moved = turned.map(|p| p + DVec3::new(100.0, 200.0, 300.0));
    assert_eq!(places(&cloud), [moved, turned].concat());
    assert_eq!(cloud.rows, Some(vec![0, 2, 3, 4, 6, 7]), "rows of all scans' points, those left out too");
    assert_eq!(cloud.extras[1].values, ExtraValues::F32([[0.0; 3], [1.0; 3]].concat()));
    // A single scan needs no scan number; without colours there are four columns.
    let plain = PTX.lines().map(|l| l.split(' ').take(4).collect::<Vec<_>>().join(" ") + "\n").collect::<String>();
    assert_eq!(load("a.ptx", &plain).attributes.join(" "), "position intensity");
    for (from, to, expected) in [
        ("2\n2\n", "2\n9999999999\n", "ends within the points of scan 1"),
        ("2\n2\n", "2\n3\n", "ends within the points of scan 1"),
        ("0 1 0 0.25 0 255 0", "0 1 0 0.25 0", "found 5 numbers (line 13)"),
        ("0 1 0 0.25 0 255 0", "0 1 0 0.25", "found 4 numbers (line 13)"),
        ("0 1 0 0.25 0 255 0", "0 1 0 a 0 255 0", "found 'a' (line 13)"),
        ("100 200 300 1", "100 200", "found 2 numbers (line 10)"),
    ] {
        refused("a.ptx", PTX.replace(from, to), expected);
    }
}

#[test]
fn off_of_every_kind() {
    let mesh = |text: &str| match load("a", text).content {
        Content::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    };
    let broken = mesh("OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0\n1 2\n\n3\n3 0 1 2\n");
    assert_eq!(broken.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    let square = "4 1 4\n0 0 0\n1 0 0 # a corner\n\n1 1 0\n0 1 0\n4 0 1 2 3\n";
    for head in ["OFF\n", "# a\nOFF ", "OFF"] {
        let m = mesh(&format!("{head}{square}"));
        assert_eq!((m.positions.len(), &m.triangles[..]), (4, &[[0, 1, 2], [0, 2, 3]][..]), "{head}");
    }
    let m = mesh("COFF\n3 1 0\n0 0 0 255 128 0 255\n1 0 0 0 0 0 0\n0 1 0 0 0 0 51\n3 0 1 2 9 9 9\n");
    assert_eq!((m.colors.unwrap()[0], m.alphas.unwrap()), ([1.0, HALF_OF_255, 0.0], vec![1.0, 0.0, 0.2]));
    let m = mesh("CNOFF\n3 1 0\n0 0 0 0 0 1 0.5 1 0\n1 0 0 0 0 1 1 1 1\n0 1 0 0 0 1 1 1 1\n3 0 1 2\n");
    assert_eq!((m.colors.unwrap()[0], m.normals.unwrap()[2]), ([HALF, 1.0, 0.0], [0.0, 0.0, 1.0]));
    let m = mesh("ST4OFF\n3 1 0\n0 0 0 2 0 0\n2 0 0 2 0 0\n0 4 0 4 1 1\n3 0 1 2\n");
    assert_eq!((m.positions.get(1), m.positions.get(2)), (DVec3::X, DVec3::Y));
    let cloud = points(load("a", "NOFF\n1 0 0\n1 2 3 0 0 2\n"));
    assert_eq!((cloud.positions.get(0), cloud.normals.unwrap().get(0)), (DVec3::new(1.0, 2.0, 3.0), DVec3::Z * 2.0));
    let notes = load("a", "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255\n2 0 1\n").notes;
    let ignored = "ignored the colours of some faces: expected 3 or 4 numbers";
    assert_eq!(notes, ["skipped 1 face with fewer than 3 corners", ignored]);
    for (text, expected) in [
        ("OFF\n99999999999 0 0\n0 0 0\n", "ends within its vertices"),
        ("OFF\n1 99999999999 0\n0 0 0\n", "ends within its faces"),
        ("OFF\n1 1 0\n0 0 0\n9999999999 0 0 0\n", "found the face"),
        ("OFF\n1 1 0\n0 0 0\n3 0 0 1\n", "a corner out of range (line 4)"),
        ("OFF\n1 1 0\n0 0 0\n3 0 0 -1\n", "a corner out of range"),
        ("OFF\n1 0 0\n0 0\n", "a vertex has 2 numbers (line 3)"),
        ("OFF\n1 0 0\n0 0 a\n", "found 'a' (line 3)"),
        ("OFF BINARY\n", "binary OFF"),
        ("OFF\n1 -1\n", "found '1 -1'"),
        ("OFF\n", "ends within its header"),
    ] {
        refused("a.off", text, expected);
    }
}

#[test]
fn files_that_are_not_read_are_named() {
    let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
    for (name, bytes, expected) in [
        ("a.ply", pointer.as_bytes(), "git lfs pull"),
        ("a.xyz", b"<!DOCTYPE html><html>", "is a web page"),
        ("a.xyz", b"\n<html>", "is a web page"),
        ("a", b"CCB2\x01", "BIN file of CloudCompare"),
        ("a", b"Kaydara FBX Binary", "FBX"),
        ("a.ksplat", b"\x00\x01\x00\x00", "KSPLAT"),
        ("a", b"\x28\xb5\x2f\xfd....", "Zstandard"),
        ("a.png", b"\x89PNG", "PNG image"),
    ] {
        refused(name, bytes, expected);
    }
    let mut tar = vec![0; 600];
    tar[257..262].copy_from_slice(b"ustar");
    refused("a.tar", tar, "TAR archive");
}

/// Columns of files are read in blocks by several threads, with the same result as from memory.
#[test]
fn columns_of_files_are_those_of_memory() {
    let rows = 40_001;
    let number = |row: usize, column: usize| ((row * 7919 + column * 104_729) % 100_003) as f64 / 64.0;
    let npy = |kind: &str, shape: &str, fortran: &str, data: &[u8]| {
        let header = format!("{{'descr': {kind}, 'fortran_order': {fortran}, 'shape': {shape}}}\n");
        let length = (header.len() as u16).to_le_bytes();
        [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
    };
    let f32s = |columns: usize| -> Vec<u8> {
        (0..rows).flat_map(|r| (0..columns).flat_map(move |c| (number(r, c) as f32).to_le_bytes())).collect()
    };
    let georeferenced: Vec<u8> =
        (0..rows).flat_map(|r| (0..3).flat_map(move |c| (4e6 + number(r, c) / 3.0).to_le_bytes())).collect();
    let by_column: Vec<u8> = (0..3).flat_map(|c| (0..rows).flat_map(move |r| number(r, c).to_be_bytes())).collect();
    let mixed = |big_endian: bool| -> Vec<u8> {
        let row = |r: usize| {
            let mut bytes = Vec::new();
            for c in 0..3 {
                let v = 5e5 + number(r, c) / 7.0;
                bytes.extend(if big_endian { v.to_be_bytes() } else { v.to_le_bytes() });
            }
            bytes.extend([r as u8, (r / 3) as u8, 7]);
            let (v, gps) = (r as u16, number(r, 4));
            bytes.extend(if big_endian { v.to_be_bytes() } else { v.to_le_bytes() });
            bytes.extend(if big_endian { gps.to_be_bytes() } else { gps.to_le_bytes() });
            bytes
        };
        (0..rows).flat_map(row).collect()
    };
    let ply = |big_endian: bool| {
        let format = if big_endian { "big" } else { "little" };
        let properties = "property double x\nproperty double y\nproperty double z\nproperty uchar red\n\
             property uchar green\nproperty uchar blue\nproperty ushort intensity\nproperty double gps\n";
        let header = format!("ply\nformat binary_{format}_endian 1.0\nelement vertex {rows}\n{properties}end_header\n");
        [header.into_bytes(), mixed(big_endian)].concat()
    };
    let pcd = |fields: &str, counts: &str, kinds: &str, sizes: &str, data: &[u8]| {
        let header = format!(
            "# .PCD v0.7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {kinds}\nCOUNT {counts}\nPOINTS {rows}\nDATA binary\n"
        );
        [header.as_bytes(), data].concat()
    };
    let records = "[('x','<f8'),('y','<f8'),('z','<f8'),('rgb','u1',(3,)),('intensity','<u2'),('gps','<f8')]";
    let files = [
        ("a.npy", npy("'<f4'", &format!("({rows},3)"), "False", &f32s(3))),
        ("b.npy", npy("'<f4'", &format!("({rows},6)"), "False", &f32s(6))),
        ("c.npy", npy("'<f8'", &format!("({rows},3)"), "False", &georeferenced)),
        ("d.npy", npy("'>f8'", &format!("({rows},3)"), "True", &by_column)),
        ("e.npy", npy(records, &format!("({rows},)"), "False", &mixed(false))),
        ("f.ply", ply(false)),
        ("g.ply", ply(true)),
        ("h.pcd", pcd("x y z rgb", "1 1 1 1", "F F F F", "4 4 4 4", &f32s(4))),
        ("i.pcd", pcd("x y z feature", "1 1 1 3", "F F F F", "4 4 4 4", &f32s(6))),
    ];
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        let options = LoadOptions::default();
        let of_file = surfel_io::load(&path, &options).unwrap();
        let of_memory = load_bytes(&bytes, None, &path, &options).unwrap();
        assert_eq!(of_file, of_memory, "{name}");
        // Each number has its expected value, also at block boundaries.
        let Content::Points(points) = &of_file.content else { panic!("{name}") };
        let all = [0, 1, 16_383, 16_384, 32_768, rows - 1].map(|r| {
            let p = points.origin + points.positions.get(r);
            let expected = match name {
                "c.npy" => DVec3::from([0, 1, 2].map(|c| 4e6 + number(r, c) / 3.0)),
                "e.npy" | "f.ply" | "g.ply" => DVec3::from([0, 1, 2].map(|c| 5e5 + number(r, c) / 7.0)),
                _ => DVec3::from([0, 1, 2].map(|c| number(r, c))),
            };
            p.distance(expected)
        });
        assert!(all.iter().all(|d| *d < 1e-8), "{name}: {all:?}");
        // A truncated file gives the same error as before.
        let cut = &bytes[..bytes.len() - 1];
        std::fs::write(&path, cut).unwrap();
        let told = surfel_io::load(&path, &options).unwrap_err().to_string();
        assert_eq!(told, load_bytes(cut, None, &path, &options).unwrap_err().to_string());
    }
}

#[test]
fn quoted_values_are_values() {
    let cloud = points(load("a.csv", "\"X\",\"Y\",\"Z\"\n\"1.5\",\"2\",\"3\"\n4,\"5\",\"-6e0\"\n"));
    assert_eq!(places(&cloud), [DVec3::new(1.5, 2.0, 3.0), DVec3::new(4.0, 5.0, -6.0)]);
    let cloud = points(load("a.csv", "\"1,5\";\"2,5\";\"3\"\n\"4\";\"5\";\"6,25\"\n"));
    assert_eq!(places(&cloud), [DVec3::new(1.5, 2.5, 3.0), DVec3::new(4.0, 5.0, 6.25)]);
    // A comma within quotes never ends a cell.
    refused("a.csv", "x,y,z\n1,2,3\n\"1,5\",\"2,5\",\"3,5\"\n", "found '1,5' (line 3)");
}

#[test]
fn rows_with_an_empty_cell_are_left_out_and_counted() {
    for (text, note) in [
        ("x,y,z\n1,2,3\nNaN,,\n4,5,6\n", "left out 1 row with an empty cell, the first in line 3"),
        (
            "x;y;z;i\n1;2;3;9\n;;;\n4;5;6;8\n1;2;;3\n1;2;3;\"\"\n",
            "left out 3 rows with an empty cell, the first in line 3",
        ),
    ] {
        let loaded = load("a.csv", text);
        assert_eq!(loaded.notes, [note]);
        assert_eq!(places(&points(loaded)), [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)]);
    }
    // A separator at the end of all lines makes no cell.
    assert_eq!(points(load("a.csv", "x,y,z\n1,2,3,\n4,5,6,\n")).len(), 2);
    refused("a.csv", "x,y,z\n1,2,3\n4,5\n", "found 2 numbers (line 3)");
}

#[test]
fn utf_16_is_read_by_its_byte_order_mark() {
    let text = "x,y,z\r\n1,2,3\r\n4,5,6\r\n";
    let units = || std::iter::once(0xfeff).chain(text.encode_utf16());
    let little: Vec<u8> = units().flat_map(u16::to_le_bytes).collect();
    let big: Vec<u8> = units().flat_map(u16::to_be_bytes).collect();
    for bytes in [little.clone(), big, [&little[..], &[10]].concat()] {
        let loaded = load("a.csv", bytes);
        assert_eq!((loaded.format, loaded.notes.len()), (Format::Xyz, 0));
        assert_eq!(places(&points(loaded)), [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)]);
    }
    assert!(try_load("a.csv", &little[..2]).is_err());
}
