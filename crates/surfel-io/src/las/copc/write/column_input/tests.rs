//! Tests of points that are read from columns.

use super::super::{CopcOptions, Limits, save};
use super::*;
use crate::{Content, LoadOptions};
use std::path::PathBuf;
use surfel_model::PointCloud;

/// A point of a bumpy sheet: x y z, red green blue, nx ny nz, and its index.
type Row = ([f32; 3], [u8; 3], [f32; 3], u32);

fn rows(count: u32) -> Vec<Row> {
    let row = |i: u32| {
        let [u, v] = [i % 300, i / 300].map(|v| v as f32 / 300.0 - 0.3);
        let at = [u * 40.0, v * 40.0, (u * 9.0).sin() + (i % 7) as f32 * 1e-4];
        let color = [i % 256, i / 256 % 256, 200].map(|c| c as u8);
        (at, color, [0.6, 0.0, if i.is_multiple_of(2) { 0.8 } else { -0.8 }], i)
    };
    (0..count).map(row).collect()
}

fn ply(rows: &[Row], format: &str) -> Vec<u8> {
    let properties = "property float x\nproperty float y\nproperty float z\nproperty uchar red\n\
         property uchar green\nproperty uchar blue\nproperty float nx\nproperty float ny\nproperty float nz\n\
         property uint number\n";
    let count = rows.len();
    let head = format!("ply\nformat {format} 1.0\nelement vertex {count}\n{properties}end_header\n");
    let mut bytes = head.into_bytes();
    let is_big = format == "binary_big_endian";
    for (at, color, normal, number) in rows {
        if format == "ascii" {
            bytes.extend_from_slice(line(&(*at, *color, *normal, *number)).as_bytes());
            continue;
        }
        let mut put = |little: [u8; 4]| {
            bytes.extend(if is_big { [little[3], little[2], little[1], little[0]] } else { little });
        };
        at.iter().for_each(|v| put(v.to_le_bytes()));
        bytes.extend_from_slice(color);
        let mut put = |little: [u8; 4]| {
            bytes.extend(if is_big { [little[3], little[2], little[1], little[0]] } else { little });
        };
        normal.iter().for_each(|v| put(v.to_le_bytes()));
        put(number.to_le_bytes());
    }
    bytes
}

fn line((at, color, normal, number): &Row) -> String {
    let [x, y, z] = at;
    let [r, g, b] = color;
    let [nx, ny, nz] = normal;
    format!("{x} {y} {z} {r} {g} {b} {nx} {ny} {nz} {number}\n")
}

fn pcd(rows: &[Row], data: &str) -> Vec<u8> {
    let count = rows.len();
    let names = "x y z red green blue nx ny nz number";
    let mut bytes = format!(
        "# .PCD v0.7\nVERSION 0.7\nFIELDS {names}\nSIZE 4 4 4 1 1 1 4 4 4 4\nTYPE F F F U U U F F F U\n\
         COUNT 1 1 1 1 1 1 1 1 1 1\nWIDTH {count}\nHEIGHT 1\nPOINTS {count}\nDATA {data}\n"
    )
    .into_bytes();
    match data {
        "ascii" => rows.iter().for_each(|row| bytes.extend_from_slice(line(row).as_bytes())),
        "binary" => {
            for (at, color, normal, number) in rows {
                at.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
                bytes.extend_from_slice(color);
                normal.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
                bytes.extend(number.to_le_bytes());
            }
        }
        _ => {
            let mut fields = Vec::new();
            (0..3).for_each(|k| rows.iter().for_each(|row| fields.extend(row.0[k].to_le_bytes())));
            (0..3).for_each(|k| rows.iter().for_each(|row| fields.push(row.1[k])));
            (0..3).for_each(|k| rows.iter().for_each(|row| fields.extend(row.2[k].to_le_bytes())));
            rows.iter().for_each(|row| fields.extend(row.3.to_le_bytes()));
            // LZF-compressed fields: literals, and a back reference where one byte repeats.
            let mut packed = Vec::new();
            for part in fields.chunks(32) {
                match part.iter().all(|b| *b == part[0]) && part.len() == 32 {
                    true => packed.extend_from_slice(&[0, part[0], 0xe0, 31 - 9, 0]),
                    false => {
                        packed.push(part.len() as u8 - 1);
                        packed.extend_from_slice(part);
                    }
                }
            }
            bytes.extend((packed.len() as u32).to_le_bytes());
            bytes.extend((fields.len() as u32).to_le_bytes());
            bytes.extend(packed);
        }
    }
    bytes
}

fn npy(rows: &[Row]) -> Vec<u8> {
    let fields = "[('x','<f4'),('y','<f4'),('z','<f4'),('red','u1'),('green','u1'),('blue','u1'),('nx','<f4'),\
         ('ny','<f4'),('nz','<f4'),('number','<u4')]";
    let dict = format!("{{'descr': {fields}, 'fortran_order': False, 'shape': ({},)}}\n", rows.len());
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((dict.len() as u16).to_le_bytes());
    bytes.extend(dict.into_bytes());
    let binary = pcd(rows, "binary");
    bytes.extend_from_slice(&binary[binary.len() - 31 * rows.len()..]);
    bytes
}

fn xyz(rows: &[Row]) -> Vec<u8> {
    let text: String = rows.iter().map(line).collect();
    format!("x y z red green blue nx ny nz number\n{text}").into_bytes()
}

fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("surfel-columns-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

const OVER: CopcOptions = CopcOptions { overwrite: true, memory: 0, resume: false, shard: None, columns: None };
const LARGE: Limits = Limits {
    cell_points: 20_000,
    most_cells: 1 << 18,
    most_points: 30_000,
    held_points: u64::MAX,
    kept_bytes: 0,
    most_in_place: u64::MAX,
};

fn written(input: &Path, limits: Limits) -> Result<(Vec<u8>, Vec<String>), IoError> {
    let output = input.with_extension("copc.laz");
    let report = save(&[input.to_path_buf()], &output, &OVER, None, &|_, _, _| (), limits)?;
    Ok((std::fs::read(output).unwrap(), report.notes))
}

fn loaded(bytes: &[u8]) -> PointCloud {
    let name = Path::new("a.laz");
    match crate::load_bytes(bytes, None, name, &LoadOptions::default()).unwrap().content {
        Content::Points(points) => points,
        _ => panic!("no points"),
    }
}

fn number(points: &PointCloud, i: usize) -> usize {
    points.extras.iter().find(|e| e.name == "number").unwrap().values.get(i) as usize
}

/// Points read block by block get the same colours, in the 16 bits of LAS, and the same notes as those read at once.
#[test]
fn colors_of_ply_mean_the_same_where_points_are_read_block_by_block() {
    let folder = folder("colors");
    let cases: [(&str, &str, [&str; 3], [f64; 3]); 7] = [
        ("", "ushort", ["red", "green", "blue"], [200.0, 100.0, 3.0]),
        ("", "ushort", ["red", "green", "blue"], [60_000.0, 100.0, 3.0]),
        ("", "float", ["red", "green", "blue"], [0.5, 0.25, 1.0]),
        ("comment colors linear\n", "float", ["red", "green", "blue"], [0.5, 0.25, 1.0]),
        ("", "float", ["R", "G", "B"], [128.0, 64.0, 0.0]),
        ("", "int", ["Red", "Green", "Blue"], [255.0, 64.0, 0.0]),
        ("", "uchar", ["diffuse_red", "diffuse_green", "diffuse_blue"], [255.0, 64.0, 0.0]),
    ];
    for (comment, kind, names, color) in cases {
        let properties = names.map(|name| format!("property {kind} {name}\n")).concat();
        let [r, g, b] = color;
        let rows: String = (0..500).map(|i| format!("{} {} 5 {r} {g} {b}\n", i % 20, i / 20)).collect();
        let head = format!("ply\nformat ascii 1.0\n{comment}element point 500\n");
        let text =
            format!("{head}property float X\nproperty float Y\nproperty float Z\n{properties}end_header\n{rows}");
        let input = folder.join("a.ply");
        std::fs::write(&input, &text).unwrap();
        let at_once = crate::load(&input, &LoadOptions::default()).unwrap();
        let (bytes, notes) = written(&input, LARGE).unwrap();
        for note in &at_once.notes {
            assert!(notes.iter().any(|n| n.contains(note)), "{kind}: {note:?} isn't in {notes:?}");
        }
        let Content::Points(at_once) = at_once.content else { panic!() };
        let (expected, found) = (at_once.colors.unwrap()[0], loaded(&bytes).colors.unwrap()[0]);
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-4, "{kind} {color:?}: {found:?} {expected:?}");
        }
    }
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn points_of_every_format_are_the_same_whatever_fits_into_memory() {
    let (folder, rows) = (folder("formats"), rows(70_000));
    let files = [
        ("little.ply", ply(&rows, "binary_little_endian")),
        ("big.ply", ply(&rows, "binary_big_endian")),
        ("text.ply", ply(&rows, "ascii")),
        ("text.pcd", pcd(&rows, "ascii")),
        ("rows.pcd", pcd(&rows, "binary")),
        ("packed.pcd", pcd(&rows, "binary_compressed")),
        ("rows.npy", npy(&rows)),
        ("text.xyz", xyz(&rows)),
    ];
    let mut first: Option<Vec<u8>> = None;
    for (name, bytes) in files {
        let input = folder.join(name);
        std::fs::write(&input, bytes).unwrap();
        assert_eq!(crate::survey_points(&input, None).map(|count| count.points.abs_diff(70_000) < 7_000), Some(true));
        let (one_by_one, notes) = written(&input, Limits { held_points: 0, ..LARGE }).unwrap();
        assert!(written(&input, LARGE).unwrap().0 == one_by_one, "{name}");
        assert!(notes.is_empty(), "{name}: {notes:?}");
        let points = loaded(&one_by_one);
        assert_eq!(points.len(), rows.len());
        let (colors, normals) = (points.colors.as_ref().unwrap(), points.normals.as_ref().unwrap());
        for i in 0..points.len() {
            let (at, color, normal, _) = rows[number(&points, i)];
            let far = at.map(|v| v.abs() >= 32.0 / 128.0);
            let found = (points.origin + points.positions.get(i)).to_array();
            for k in 0..3 {
                let off = (found[k] - f64::from(at[k])).abs();
                // The step is 2⁵⁻³⁰, and coordinates far enough from 0 lose nothing.
                assert!(off <= if far[k] { 0.0 } else { 2f64.powi(-26) }, "{name} {i}: {off}");
            }
            assert_eq!(colors[i], color.map(|c| crate::color::linear_of_8_bit()[usize::from(c)]), "{name}");
            assert_eq!(normals.get(i).as_vec3().to_array(), normal, "{name}");
        }
        // Printed numbers are stored as f32, all others with their own types.
        match name {
            "text.xyz" => {}
            _ => assert!(*first.get_or_insert_with(|| one_by_one.clone()) == one_by_one, "{name}"),
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn system_that_comments_of_a_ply_file_state_is_written() {
    let (folder, rows) = (folder("system"), rows(500));
    let text = String::from_utf8(ply(&rows, "ascii")).unwrap();
    let input = folder.join("a.ply");
    let wkt = r#"PROJCS["WGS 84 / UTM zone 32N",AUTHORITY["EPSG","32632"]]"#;
    std::fs::write(&input, text.replacen("element", &format!("comment crs_wkt {wkt}\nelement"), 1)).unwrap();
    let stated = crate::load(&input, &LoadOptions::default()).unwrap().content;
    let Content::Points(stated) = stated else { panic!("no points") };
    let (bytes, _) = written(&input, LARGE).unwrap();
    assert!(loaded(&bytes).comments.iter().any(|comment| comment.contains(wkt)), "{:?}", stated.comments);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Values of an attribute of the points, in the order of their attribute `row`.
fn values(points: &PointCloud, name: &str) -> Vec<f64> {
    let column = |name: &str| &points.extras.iter().find(|e| e.name == name).unwrap_or_else(|| panic!("{name}")).values;
    let (rows, values) = (column("row"), column(name));
    let mut sorted: Vec<(u64, f64)> = (0..points.len()).map(|i| (rows.get(i) as u64, values.get(i))).collect();
    sorted.sort_by_key(|(row, _)| *row);
    sorted.into_iter().map(|(_, value)| value).collect()
}

/// Returns the names of extra bytes as a LAS file stores them, without those that Surfel adds.
fn stored_names(bytes: &[u8]) -> Vec<String> {
    // The first record of extra bytes begins with this user name and the number 4. Its data follows a head of 54 bytes,
    // whose size is at byte 20.
    let head = [&[0, 0], &b"LASF_Spec"[..], &[0; 7], &[4, 0]].concat();
    let at = bytes.windows(head.len()).position(|window| window == head).unwrap();
    let size = usize::from(u16::from_le_bytes([bytes[at + 20], bytes[at + 21]]));
    let names = bytes[at + 54..at + 54 + size]
        .chunks_exact(192)
        .map(|record| String::from_utf8_lossy(&record[4..36]).trim_end_matches('\0').to_owned());
    let is_own = |name: &String| {
        [RADIUS].iter().chain(&NORMALS).chain(&LEVEL_COLORS).chain(&LEVEL_NORMALS).any(|own| own == name)
    };
    names.filter(|name| !is_own(name)).collect()
}

#[test]
fn columns_named_like_fields_of_las_fill_them_or_are_renamed() {
    let folder = folder("fields");
    let text = |class: &dyn Fn(u32) -> f64| {
        let row = |i: u32| {
            let [x, y] = [i % 30, i / 30];
            let time = 1000.25 + f64::from(i);
            format!("{x} {y} 0 {i} {} {} {} {time} 1\n", class(i), 1 + i % 2, 2)
        };
        let rows: String = (0..900).map(row).collect();
        format!("x y z row Classification return_number number_of_returns gps_time withheld\n{rows}")
    };
    let input = folder.join("a.txt");
    let points_of = |class: &dyn Fn(u32) -> f64| {
        std::fs::write(&input, text(class)).unwrap();
        let (bytes, notes) = written(&input, LARGE).unwrap();
        (loaded(&bytes), notes, stored_names(&bytes))
    };
    let (points, notes, stored) = points_of(&|i| f64::from(i % 3));
    assert_eq!(points.len(), 900, "{notes:?}");
    // A name of the standard among the extra bytes would make other programs refuse the file. Surfel reads such a
    // column under its own name.
    assert_eq!(stored, ["row", "withheld_2"]);
    assert!(notes.len() == 1 && notes[0].contains("'withheld'") && notes[0].contains("withheld_2"), "{notes:?}");
    let expected = |value: &dyn Fn(u32) -> f64| (0..900).map(value).collect::<Vec<f64>>();
    assert_eq!(values(&points, "classification"), expected(&|i| f64::from(i % 3)));
    assert_eq!(values(&points, "return_number"), expected(&|i| f64::from(1 + i % 2)));
    assert_eq!(values(&points, "number_of_returns"), expected(&|_| 2.0));
    assert_eq!(values(&points, "gps_time"), expected(&|i| 1000.25 + f64::from(i)));
    assert_eq!(values(&points, "withheld"), expected(&|_| 1.0));
    // Classes beyond 255 don't fit.
    let (points, notes, stored) = points_of(&|i| f64::from(i));
    assert_eq!(stored, ["row", "Classification_2", "withheld_2"]);
    assert!(notes.iter().any(|note| note.contains("Classification_2")), "{notes:?}");
    assert_eq!(values(&points, "Classification"), expected(&f64::from));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn inputs_share_their_steps() {
    let (folder, rows) = (folder("inputs"), rows(30_000));
    let whole = folder.join("whole.ply");
    std::fs::write(&whole, ply(&rows, "binary_little_endian")).unwrap();
    let inputs = [folder.join("a.ply"), folder.join("b.pcd")];
    std::fs::write(&inputs[0], ply(&rows[..10_000], "binary_little_endian")).unwrap();
    std::fs::write(&inputs[1], pcd(&rows[10_000..], "ascii")).unwrap();
    let output = folder.join("out.copc.laz");
    save(&inputs, &output, &OVER, None, &|_, _, _| (), LARGE).unwrap();
    assert!(std::fs::read(&output).unwrap() == written(&whole, LARGE).unwrap().0);
    // Shards use the same steps, too.
    let shard = |index: u32| {
        let output = folder.join(format!("{index}.shard"));
        let options = CopcOptions { shard: Some([index, 2]), ..OVER };
        save(&inputs, &output, &options, None, &|_, _, _| (), LARGE).unwrap();
        output
    };
    let shards = [shard(0), shard(1)];
    let merged = folder.join("merged.copc.laz");
    super::super::save_copc(&shards, &merged, &OVER, None, &|_, _, _| ()).unwrap();
    assert!(std::fs::read(&merged).unwrap() == std::fs::read(&output).unwrap());
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn points_without_a_place_are_left_out_and_headers_that_lie_are_refused() {
    let (folder, mut rows) = (folder("wrong"), rows(1000));
    rows[3].0[1] = f32::NAN;
    rows[5].0[2] = f32::INFINITY;
    let input = folder.join("a.ply");
    std::fs::write(&input, ply(&rows, "binary_little_endian")).unwrap();
    let (bytes, notes) = written(&input, LARGE).unwrap();
    assert_eq!((loaded(&bytes).len(), notes.len()), (998, 1));
    assert!(notes[0].contains("dropped 2 points"), "{notes:?}");
    let whole = ply(&rows, "binary_little_endian");
    let replaced = |bytes: &[u8], from: &str, to: &str| {
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    let most = u64::MAX.to_string();
    for (name, bytes, says) in [
        ("cut.ply", whole[..whole.len() - 1].to_vec(), "number 999 of 1000"),
        ("lie.ply", replaced(&whole, "vertex 1000", &format!("vertex {most}")), "the file ends"),
        ("text.ply", replaced(&ply(&rows, "ascii"), "vertex 1000", "vertex 1001"), "number 1000 of 1001"),
        (
            "face.ply",
            replaced(&whole, "end_header", "element face 1\nproperty int a\nend_header"),
            "without radii or faces",
        ),
        ("radius.ply", replaced(&whole, "uint number", "float radius"), "without radii or faces"),
        (
            "lie.pcd",
            replaced(&pcd(&rows, "binary"), "POINTS 1000", &format!("POINTS {most}")),
            "more than there can be",
        ),
        ("cut.pcd", replaced(&pcd(&rows, "binary_compressed"), "POINTS 1000", "POINTS 900000000"), "can't become"),
        ("cut.npy", replaced(&npy(&rows), "(1000,)", "(9999,)"), "incomplete"),
        ("word.xyz", replaced(&xyz(&rows), "0.6 0 -0.8", "0.6 o -0.8"), "line 3"),
        ("none.xyz", b"# nothing\n".to_vec(), "can be written as COPC"),
    ] {
        let input = folder.join(name);
        std::fs::write(&input, bytes).unwrap();
        let error = written(&input, LARGE).unwrap_err().to_string();
        assert!(error.contains(says) && error.contains(name), "{name}: {error}");
        if name.starts_with("lie") {
            assert_eq!(crate::survey_points(&input, None), None, "{name}");
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn damaged_files_are_written_or_refused() {
    let (folder, rows) = (folder("damaged"), rows(40));
    let files = [
        ("a.ply", ply(&rows, "binary_big_endian")),
        ("b.ply", ply(&rows, "ascii")),
        ("a.pcd", pcd(&rows, "ascii")),
        ("b.pcd", pcd(&rows, "binary")),
        ("c.pcd", pcd(&rows, "binary_compressed")),
        ("a.npy", npy(&rows)),
        ("a.xyz", xyz(&rows)),
    ];
    let mut random = 5_u64;
    let mut next = |below: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as usize % below
    };
    let (mut written_files, mut refused) = (0, 0);
    for (name, whole) in files {
        let input = folder.join(name);
        for _ in 0..150 {
            let mut bytes = whole.clone();
            for _ in 0..1 + next(3) {
                // Most changes are in the header; changed digits make other counts.
                let below = if next(4) == 0 { bytes.len() } else { bytes.len().min(400) };
                let at = next(below);
                bytes[at] = if bytes[at].is_ascii_digit() { b'0' + next(10) as u8 } else { next(256) as u8 };
            }
            if next(5) == 0 {
                bytes.truncate(next(bytes.len()));
            }
            std::fs::write(&input, bytes).unwrap();
            crate::survey_points(&input, None);
            match written(&input, LARGE) {
                Ok(_) => written_files += 1,
                Err(_) => refused += 1,
            }
        }
    }
    assert!(written_files > 100 && refused > 100, "{written_files} {refused}");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn steps_are_the_coarsest_that_lose_nothing_or_the_finest_that_reach() {
    let steps_of = |points: &[[f64; 3]]| {
        let mut all = Measured::none(0);
        for at in points {
            all.count += 1;
            all.position.iter_mut().zip(at).for_each(|(range, v)| range.add(*v));
            all.finest = at.iter().fold(all.finest, |finest, v| finest.min(last_bit(*v)));
        }
        let (scale, offset) = steps(&all);
        for at in points {
            let steps = ((DVec3::from(*at) - offset) / scale).round();
            assert!(steps.abs().max_element() <= 2f64.powi(STEP_BITS), "{at:?} {scale} {offset}");
            let off = (steps * scale + offset - DVec3::from(*at)).abs().max_element();
            let farthest = points.iter().map(|p| (DVec3::from(*p) - offset).abs().max_element());
            let most = farthest.fold(0.0, f64::max) * 2f64.powi(-STEP_BITS);
            assert!(off <= most.max(2f64.powi(-501)), "{at:?} {scale} {offset}: {off}");
        }
        (scale, offset)
    };
    assert_eq!(steps_of(&[[0.0; 3]]), (1.0, DVec3::ZERO));
    assert_eq!(steps_of(&[[1.0, 2.5, -3.0], [4.0, 0.0, 0.0]]), (0.5, DVec3::ZERO));
    assert_eq!(steps_of(&[[0.1, 0.2, 0.3], [1.0, 1.5, -1.9]]).0, 2f64.powi(1 - STEP_BITS));
    // f32 numbers far away have no finer digits; f64 numbers have.
    let far = [637_012.25, 4_851_233.125, 312.0];
    let (scale, offset) = steps_of(&[far.map(|v| f64::from(v as f32)), [637_512.0, 4_851_733.5, 300.0]]);
    assert!(scale >= 2f64.powi(-5) && offset != DVec3::ZERO, "{scale} {offset}");
    let (scale, offset) = steps_of(&[far.map(|v| v + 0.001), [637_512.0, 4_851_733.5, 300.0]]);
    assert_eq!(scale, 2f64.powi(9 - STEP_BITS));
    assert!((offset - DVec3::from(far)).abs().max_element() < 1024.0);
    for at in [1e-300, 5e-324, 1e300] {
        steps_of(&[[at, 0.0, 0.0], [-at, at, 0.0]]);
        steps_of(&[[at; 3]]);
    }
}
