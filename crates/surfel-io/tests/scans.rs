//! LAS, LAZ, COPC and E57 files, written by the crates `las`, `laz` and `e57`.

#![cfg(all(feature = "las", feature = "laz", feature = "e57"))]

use crate::support;

use ::las::point::Format as LasFormat;
use e57::{Record, RecordDataType, RecordName, RecordValue};
use glam::{DQuat, DVec3, Vec3};
use std::path::Path;
use support::{OFFSET, STEP, Scan, e57_file, grid, hash, is_withheld, las_file, point, record, vlr};
use surfel_io::{Content, Format, LoadOptions, Loaded, load, load_bytes};
use surfel_model::{ExtraValues, PointCloud, Up};

fn try_read(bytes: &[u8]) -> Result<Loaded, String> {
    // The extension is wrong on purpose.
    load_bytes(bytes, Some(Format::Ply), Path::new("t.ply"), &LoadOptions::default())
        .map_err(|e| e.to_string())
        .inspect_err(|e| assert!(e.lines().count() <= 4 && e.starts_with("t.ply: "), "{e}"))
}

fn read(bytes: &[u8]) -> (Loaded, PointCloud) {
    let loaded = try_read(bytes).unwrap_or_else(|e| panic!("{e}"));
    let Content::Points(points) = loaded.content.clone() else { panic!("{loaded:?}") };
    (loaded, points)
}

fn extra<'a>(points: &'a PointCloud, name: &str) -> Option<&'a ExtraValues> {
    points.extras.iter().find(|e| e.name == name).map(|e| &e.values)
}

fn linear(level: f64) -> f32 {
    surfel_math::srgb::decode(level) as f32
}

/// Compares all fields of points with the fields that `support::point` writes in a LAS point format. `count` is the
/// number of written points, including withheld ones.
fn check_points(points: &PointCloud, format: u8, count: usize) {
    let kind = LasFormat::new(format).unwrap();
    let kept: Vec<usize> = (0..count).filter(|i| !is_withheld(*i)).collect();
    assert_eq!(points.len(), kept.len());
    let rows: Vec<u32> = kept.iter().map(|i| *i as u32).collect();
    assert_eq!(points.rows.as_deref(), (rows.len() < count).then_some(&rows[..]));
    let column = |name: &str| extra(points, name).unwrap_or_else(|| panic!("{format}: {name}"));
    let names = ["intensity", "return_number", "classification", "key_point", "user_data", "point_source_id"];
    let [intensity, returns, class, key, user, source] = names.map(column);
    assert!(matches!(intensity, ExtraValues::U16(_)) && matches!(class, ExtraValues::U8(_)));
    let angles = column("scan_angle");
    let (gps, nir) = (extra(points, "gps_time"), extra(points, "nir"));
    assert_eq!((gps.is_some(), nir.is_some()), (kind.has_gps_time, kind.has_nir));
    assert_eq!(points.colors.is_some(), kind.has_color);
    for (at, &i) in kept.iter().enumerate() {
        let truth = point(i, &kind);
        let world = points.origin + points.positions.get(at);
        let steps = [0, 1, 2].map(|k| ((world[k] - OFFSET[k]) / STEP).round() as i64);
        assert_eq!(steps, grid(i), "point {i} of format {format}");
        assert_eq!(intensity.get(at), f64::from(truth.intensity));
        assert_eq!(returns.get(at), f64::from(truth.return_number));
        assert_eq!(class.get(at), f64::from(u8::from(truth.classification)));
        assert_eq!(key.get(at) == 1.0, truth.is_key_point);
        assert_eq!(user.get(at), f64::from(truth.user_data));
        assert_eq!(source.get(at), f64::from(truth.point_source_id));
        // A step is 0.006 degrees; the writer truncates.
        assert!((angles.get(at) - f64::from(truth.scan_angle)).abs() <= 0.006_001);
        assert!(gps.is_none_or(|gps| gps.get(at) == truth.gps_time.unwrap()));
        assert!(nir.is_none_or(|nir| nir.get(at) == f64::from(truth.nir.unwrap())));
        if let Some(colors) = &points.colors {
            let c = truth.color.unwrap();
            let expected = [c.red, c.green, c.blue].map(|level| linear(f64::from(level) / 65_535.0));
            assert_eq!(colors[at], expected, "point {i} of format {format}");
        }
    }
}

#[test]
fn every_format_of_points_is_read_to_the_step_plain_and_compressed() {
    for (minor, format) in [(0, 0), (1, 1), (2, 2), (2, 3), (4, 6), (4, 7), (4, 8)] {
        for packed in [false, true] {
            let bytes = las_file((minor, format, 0, packed), Vec::new(), 0..3000, |_| ());
            let (loaded, points) = read(&bytes);
            assert_eq!(loaded.format, if packed { Format::Laz } else { Format::Las });
            assert_eq!((loaded.up, points.origin.x > 6e5), (Up::PlusZ, true));
            check_points(&points, format, 3000);
            let notes = loaded.notes.join("\n");
            let name = if packed { format!("LAZ (LAS 1.{minor})") } else { format!("LAS 1.{minor}") };
            let says = |what: &str| assert!(notes.contains(what), "{what}: {notes}");
            says(&format!("{name} of point format {format} by 'surfel\\'s test': {} points, ", points.len()));
            says("no CRS");
            says(&format!("left out {} points flagged as withheld", 3000 - points.len()));
        }
    }
}

#[test]
fn compressed_chunks_and_blocks_come_together_again() {
    // LASzip's chunks have 50,000 points.
    for (minor, format) in [(2, 3), (4, 7)] {
        let bytes = las_file((minor, format, 0, true), Vec::new(), 0..120_000, |_| ());
        check_points(&read(&bytes).1, format, 120_000);
    }
    let bytes = las_file((4, 7, 0, false), Vec::new(), 0..120_000, |_| ());
    let (from_memory, points) = read(&bytes);
    check_points(&points, 7, 120_000);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("named.obj");
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(load(&path, &LoadOptions::default()).unwrap(), from_memory);
}

/// Builds a COPC file as its writers do: nodes are LAZ chunks of different sizes. `nodes` are their numbers of points.
fn copc(nodes: &[usize]) -> Vec<u8> {
    let count = nodes.iter().sum();
    let plain = las_file((4, 7, 0, false), Vec::new(), 0..count, |_| ());
    let start = u32::from_le_bytes(plain[96..100].try_into().unwrap()) as usize;
    let builder = laz::LazVlrBuilder::default().with_point_format(7, 0).unwrap();
    let laz_vlr = builder.with_variable_chunk_size().build();
    let mut out = plain[..375].to_vec();
    let add = |out: &mut Vec<u8>, user: &str, id: u16, data: &[u8]| {
        let mut head = vec![0; 54];
        head[2..2 + user.len()].copy_from_slice(user.as_bytes());
        head[18..20].copy_from_slice(&id.to_le_bytes());
        head[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
        out.extend(head);
        out.extend(data);
    };
    add(&mut out, "copc", 1, &[0; 160]);
    let mut record = Vec::new();
    laz_vlr.write_to(&mut record).unwrap();
    add(&mut out, "laszip encoded", 22_204, &record);
    out[100..104].copy_from_slice(&2_u32.to_le_bytes());
    out[104] |= 0x80;
    let begin = out.len() as u32;
    out[96..100].copy_from_slice(&begin.to_le_bytes());
    let mut target = std::io::Cursor::new(out);
    target.set_position(u64::from(begin));
    let mut compressor = laz::LasZipCompressor::new(target, laz_vlr).unwrap();
    let mut at = start;
    for node in nodes {
        compressor.compress_many(&plain[at..at + node * 36]).unwrap();
        compressor.finish_current_chunk().unwrap();
        at += node * 36;
    }
    compressor.done().unwrap();
    compressor.into_inner().into_inner()
}

#[test]
fn nodes_of_copc_are_all_its_points() {
    let nodes = [1, 700, 3, 4000, 12];
    let (loaded, points) = read(&copc(&nodes));
    assert_eq!((loaded.format, loaded.format.name()), (Format::Copc, "COPC"));
    check_points(&points, 7, nodes.iter().sum());
}

#[test]
fn columns_that_say_nothing_are_left_out_and_8_bit_colours_are_mended() {
    let plain = |p: &mut ::las::Point| {
        *p = ::las::Point { x: p.x, y: p.y, z: p.z, gps_time: Some(0.0), color: p.color, ..::las::Point::default() };
        let color = p.color.as_mut().unwrap();
        *color = ::las::Color { red: color.red & 255, green: color.green & 255, blue: 0 };
    };
    let bytes = las_file((2, 3, 0, false), Vec::new(), 0..50, plain);
    let (loaded, points) = read(&bytes);
    assert_eq!(points.extras, []);
    assert_eq!(loaded.attributes, ["position", "colour"]);
    assert!(loaded.notes.iter().any(|n| n.contains("count to 255 instead of 65535")), "{:?}", loaded.notes);
    let expected = linear(f64::from(hash(0, 4) as u8) / 255.0);
    assert_eq!(points.colors.unwrap()[0][0], expected);
    let black = las_file((2, 3, 0, false), Vec::new(), 0..50, |p| p.color = Some(::las::Color::default()));
    assert!(read(&black).1.colors.is_none());
}

/// Returns the memory per point, in bytes, that the columns without colours take, plus the memory that reading takes.
fn column_bytes(points: &PointCloud) -> u64 {
    let position_bytes = if points.positions.low().is_some() { 24 } else { 12 };
    12 + position_bytes + points.extras.iter().map(|extra| extra.values.value_bytes() as u64).sum::<u64>()
}

#[test]
fn memory_of_points_is_that_of_the_columns_that_hold_values() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    // Files with all columns, with colours and intensities, and with positions alone.
    let keep = |columns: usize, p: &mut ::las::Point| {
        let bare =
            ::las::Point { x: p.x, y: p.y, z: p.z, gps_time: p.gps_time.map(|_| 0.0), ..::las::Point::default() };
        let (color, intensity, nir) = (p.color, p.intensity, p.nir);
        match columns {
            0 => *p = ::las::Point { color: color.map(|_| ::las::Color::default()), nir: nir.map(|_| 0), ..bare },
            1 => *p = ::las::Point { color, intensity, nir: nir.map(|_| 0), ..bare },
            _ => {}
        }
    };
    for format in [0, 1, 2, 3, 6, 7, 8] {
        for (columns, packed) in [0, 1, 2].into_iter().flat_map(|columns| [(columns, false), (columns, true)]) {
            let file = las_file((4, format, 0, packed), Vec::new(), 0..9000, |p| keep(columns, p));
            let (_, points) = read(&file);
            std::fs::write(&path, file).unwrap();
            let count = surfel_io::survey_points(&path, None).unwrap();
            let what = format!("format {format}, {columns} columns, packed {packed}");
            assert_eq!((count.points, count.row_bytes), (9000, column_bytes(&points)), "{what}");
            assert_eq!(count.has_colors, points.colors.is_some(), "{what}");
        }
    }
    // A damaged chunk hides the columns: all are assumed.
    let mut file = las_file((4, 7, 0, true), Vec::new(), 0..9000, |p| keep(0, p));
    let start = u32::from_le_bytes(file[96..100].try_into().unwrap()) as usize;
    file[start + 8 + 36 + 4..start + 8 + 36 + 40].fill(0xff);
    std::fs::write(&path, file).unwrap();
    let count = surfel_io::survey_points(&path, None).unwrap();
    assert_eq!((count.row_bytes, count.has_colors), (12 + 12 + 36, true));
}

fn extra_field(name: &str, kind: u8, scaled: Option<(f64, f64)>) -> Vec<u8> {
    let mut record = vec![0; 192];
    record[2] = kind;
    record[4..4 + name.len()].copy_from_slice(name.as_bytes());
    if let Some((scale, offset)) = scaled {
        record[3] = 8 | 16;
        record[112..120].copy_from_slice(&scale.to_le_bytes());
        record[136..144].copy_from_slice(&offset.to_le_bytes());
    }
    record
}

#[test]
fn extra_bytes_have_their_names_types_and_scales() {
    let fields = [
        extra_field("height above ground", 4, Some((0.01, 5.0))),
        extra_field("id", 5, None),
        extra_field("pair", 13, None),
        extra_field("NormalX", 9, None),
        extra_field("NormalY", 9, None),
        extra_field("NormalZ", 9, None),
    ];
    for (minor, format, packed) in [(2, 1, false), (2, 1, true), (4, 6, true)] {
        let normal = |p: &mut ::las::Point| {
            for (k, v) in [0.0_f32, 0.6, -0.8].into_iter().enumerate() {
                p.extra_bytes[10 + 4 * k..14 + 4 * k].copy_from_slice(&v.to_le_bytes());
            }
            p.is_withheld = false;
        };
        let vlrs = vec![vlr("LASF_Spec", 4, fields.concat())];
        let (_, points) = read(&las_file((minor, format, 22, packed), vlrs, 0..200, normal));
        let byte = |i: usize, k: u64| hash(i, 20 + k) as u8;
        let (height, id) = (extra(&points, "height above ground").unwrap(), extra(&points, "id").unwrap());
        let pair = extra(&points, "pair_1").unwrap();
        assert!(matches!((height, id, pair), (ExtraValues::F64(_), ExtraValues::U32(_), ExtraValues::U16(_))));
        for i in 0..200 {
            let raw = i16::from_le_bytes([byte(i, 0), byte(i, 1)]);
            assert_eq!(height.get(i), f64::from(raw) * 0.01 + 5.0);
            assert_eq!(id.get(i), f64::from(u32::from_le_bytes([2, 3, 4, 5].map(|k| byte(i, k)))));
            assert_eq!(pair.get(i), f64::from(u16::from_le_bytes([byte(i, 8), byte(i, 9)])));
        }
        assert_eq!(points.normals.unwrap().high()[7], Vec3::new(0.0, 0.6, -0.8));
        assert!(points.extras.iter().all(|e| !e.name.starts_with("Normal")));
    }
}

#[test]
fn coordinate_reference_system_scale_and_offset_become_comments() {
    let wkt = "PROJCS[\"A / B\",\nGEOGCS[\"g\",AUTHORITY[\"EPSG\",\"4269\"]],AUTHORITY[\"EPSG\",\"26910\"]]";
    let keys: Vec<u8> =
        [1_u16, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 2994].iter().flat_map(|k| k.to_le_bytes()).collect();
    let vlrs = vec![
        vlr("LASF_Projection", 34_735, keys),
        vlr("LASF_Projection", 34_736, 0.5_f64.to_le_bytes().to_vec()),
        vlr("LASF_Projection", 34_737, b"Oregon|\0".to_vec()),
    ];
    let (loaded, points) = read(&las_file((2, 1, 0, true), vlrs, 0..10, |_| ()));
    let comments = [
        "crs EPSG:2994",
        "crs_geotiff_keys 1 1 0 2 1024 0 1 1 3072 0 1 2994",
        "crs_geotiff_doubles 0.5",
        "crs_geotiff_text Oregon|",
        "las_scale 0.001 0.001 0.001",
        "las_offset 637000 4851000 -20",
    ];
    assert_eq!(points.comments, comments);
    assert!(loaded.notes[0].contains("CRS 'Oregon' (EPSG:2994)"), "{:?}", loaded.notes);
    let vlrs = vec![vlr("LASF_Projection", 2112, format!("{wkt}\0").into_bytes())];
    let (_, points) = read(&las_file((4, 6, 0, false), vlrs, 0..10, |_| ()));
    assert_eq!(points.comments[..2], ["crs EPSG:26910".to_owned(), format!("crs_wkt {}", wkt.replace('\n', " "))]);
}

#[test]
fn headers_that_lie_are_told_and_believed_no_further_than_the_bytes() {
    let plain = las_file((4, 6, 0, false), Vec::new(), 0..100, |p| p.is_withheld = false);
    let packed = las_file((4, 6, 0, true), Vec::new(), 0..100, |p| p.is_withheld = false);
    let old = las_file((2, 1, 0, true), Vec::new(), 0..100, |p| p.is_withheld = false);
    for count in [0, 1_000_000_000_000_000, u64::from(u32::MAX), u64::MAX] {
        for bytes in [&plain, &packed] {
            let mut bytes = bytes.clone();
            bytes[107..111].copy_from_slice(&[0; 4]);
            bytes[247..255].copy_from_slice(&count.to_le_bytes());
            let (loaded, points) = read(&bytes);
            assert_eq!(points.len(), 100, "{count}");
            let said = format!("the header says {count} points");
            assert!(count == 0 || loaded.notes.iter().any(|n| n.contains(&said)), "{:?}", loaded.notes);
        }
    }
    let mut many = old.clone();
    many[107..111].copy_from_slice(&u32::MAX.to_le_bytes());
    // Without layers, only the header states where a chunk ends: what follows the points isn't one.
    assert!(try_read(&many).is_err());
    let mut cut = plain.clone();
    cut.truncate(plain.len() - 45);
    let (loaded, points) = read(&cut);
    assert_eq!(points.len(), 98);
    assert!(loaded.notes.iter().any(|n| n.contains("says 100 points, the file holds 98")), "{:?}", loaded.notes);
    for bytes in [&plain, &packed, &old] {
        for end in [4, 100, 226, 240, 300, 376, bytes.len() / 2] {
            let mut cut = bytes.clone();
            cut.truncate(end);
            if let Ok(loaded) = try_read(&cut) {
                let Content::Points(points) = loaded.content else { panic!() };
                assert!(points.len() < 100 && loaded.notes.iter().any(|n| n.contains("the header says")));
            }
        }
    }
    let start = u32::from_le_bytes(packed[96..100].try_into().unwrap()) as usize;
    let set = |at: usize, value: u32| {
        let mut bytes = packed.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        bytes
    };
    let table = u64::from_le_bytes(packed[start..start + 8].try_into().unwrap()) as usize;
    let refused = [
        (set(table + 4, u32::MAX), "4294967295 chunks"),
        (set(table + 4, 2), "doesn't fit its bytes"),
        // The first layer of the first chunk, after its first point and its count.
        (set(start + 8 + 30 + 4, 0xffff_fff0), "layers don't fit"),
        (set(start, 0x7fff_ffff), "table of its compressed chunks is at byte"),
        (set(96, u32::MAX), "points begin at byte"),
    ];
    for (bytes, why) in refused {
        let error = try_read(&bytes).unwrap_err();
        assert!(error.contains(why), "{why}: {error}");
    }
    let mut vlrs = plain.clone();
    vlrs[100..104].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(read(&vlrs).0.notes.iter().any(|n| n.contains("4294967295 variable length records")));
}

#[test]
fn whole_chunks_of_a_file_that_is_cut_off_are_read_on_request() {
    // Chunks have 50,000 points.
    for (minor, format) in [(4, 6), (2, 1)] {
        let whole = las_file((minor, format, 0, true), Vec::new(), 0..120_000, |p| p.is_withheld = false);
        let (_, all) = read(&whole);
        for (share, least) in [(0.95, 100_000), (0.6, 50_000)] {
            let cut = &whole[..(whole.len() as f64 * share) as usize];
            assert!(try_read(cut).unwrap_err().contains("cut off"));
            let options = LoadOptions { repair: true, ..LoadOptions::default() };
            let loaded = load_bytes(cut, None, Path::new("t.laz"), &options).unwrap();
            let Content::Points(points) = &loaded.content else { panic!() };
            assert_eq!(points.len(), least, "1.{minor}, {share}");
            let position = |cloud: &PointCloud, i: usize| cloud.origin + cloud.positions.get(i);
            let farthest = (0..least).map(|i| position(points, i).distance(position(&all, i))).fold(0.0, f64::max);
            assert!(farthest < 1e-9, "{farthest}");
            assert!(loaded.notes.iter().any(|n| n.contains("is missing")), "{:?}", loaded.notes);
            assert!(loaded.notes.iter().any(|n| n.contains("says 120000 points")), "{:?}", loaded.notes);
        }
        // A wrong count allocates no memory for missing data.
        let mut lies = whole[..whole.len() / 2].to_vec();
        lies[107..111].copy_from_slice(&if minor == 4 { [0; 4] } else { [255; 4] });
        if minor == 4 {
            lies[247..255].copy_from_slice(&u64::MAX.to_le_bytes());
        }
        let options = LoadOptions { repair: true, ..LoadOptions::default() };
        let loaded = load_bytes(&lies, None, Path::new("t.laz"), &options).unwrap();
        let Content::Points(points) = &loaded.content else { panic!() };
        assert_eq!(points.len(), 50_000);
    }
}

/// Returns the point at range 2, azimuth and elevation (in radians).
fn spherical(azimuth: f64, elevation: f64) -> DVec3 {
    2.0 * DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin())
}

#[test]
fn extra_bytes_that_no_record_describes_are_noted() {
    for packed in [false, true] {
        let (loaded, points) = read(&las_file((4, 7, 2, packed), Vec::new(), 0..9, |_| ()));
        let notes = loaded.notes.join("\n");
        assert!(points.len() == 9 && notes.contains("left out 2 extra bytes of each point"), "{notes}");
        let (loaded, _) = read(&las_file((4, 7, 0, packed), Vec::new(), 0..9, |_| ()));
        assert!(!loaded.notes.join("\n").contains("extra bytes"), "{:?}", loaded.notes);
    }
}

#[test]
fn scans_of_e57_have_their_poses_colours_and_columns() {
    let (loaded, points) = read(&support::small_e57());
    assert_eq!((loaded.format, loaded.up), (Format::E57, Up::PlusZ));
    let kept: Vec<i64> = (0..60).filter(|i| i % 7 != 6).collect();
    assert_eq!(points.len(), kept.len() + 40);
    let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let scan = extra(&points, "scan").unwrap();
    let intensity = extra(&points, "intensity").unwrap();
    assert!(matches!(intensity, ExtraValues::U16(_)));
    let colors = points.colors.as_ref().unwrap();
    // f32 at the scans' distance from their middle, about 60 m: 4 µm.
    let near = |at: usize, p: DVec3| {
        let found = points.origin + points.positions.get(at);
        assert!(found.distance(p) < 8e-6, "{at}: {found} {p}");
    };
    for (at, &i) in kept.iter().enumerate() {
        let local = DVec3::new((i * 100) as f64, (i * i) as f64, -i as f64) * 0.001 + 0.5;
        near(at, turn * local + DVec3::new(4e5, 5e6, 100.0));
        assert_eq!((scan.get(at), intensity.get(at)), (0.0, (i * 1000) as f64));
        assert_eq!(colors[at], [i * 4, 255 - i, 7].map(|level| linear(level as f64 / 255.0)));
    }
    for i in 0..40 {
        let at = kept.len() + i;
        let angles = [i as f32 * 0.1, i as f32 * 0.02].map(f64::from);
        near(at, spherical(angles[0], angles[1]) + DVec3::new(4e5, 5e6, 0.0));
        assert_eq!((scan.get(at), intensity.get(at), colors[at]), (1.0, 0.0, [1.0; 3]));
    }
    let rows: Vec<u32> = kept.iter().map(|i| *i as u32).chain(kept.len() as u32 + 8..kept.len() as u32 + 48).collect();
    assert_eq!(points.rows, Some(rows));
    assert_eq!(points.viewpoint, None);
    assert!(points.comments.iter().any(|c| c == "crs EPSG:25832"), "{:?}", points.comments);
    let notes = loaded.notes.join("\n");
    for what in [
        "in 2 scans",
        "left out 8 points flagged as invalid",
        "40 points without a colour",
        "'Zone'",
        "1 of its 2 scans has no 'intensity'",
    ] {
        assert!(notes.contains(what), "{what}: {notes}");
    }
}

#[test]
fn single_scan_of_e57_says_where_its_scanner_stood_and_far_points_keep_their_digits() {
    let double = RecordDataType::Double { min: None, max: None };
    let names = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ];
    let mut prototype: Vec<Record> = names.into_iter().map(|n| record(n, double.clone())).collect();
    let truth: Vec<DVec3> =
        (0..500).map(|i| DVec3::new(hash(i, 1) as f64, hash(i, 2) as f64, hash(i, 3) as f64) * 1e-15).collect();
    let row = |p: &DVec3| p.to_array().map(RecordValue::Double).to_vec();
    let scan = Scan { prototype: prototype.clone(), rows: truth.iter().map(row).collect(), pose: None };
    let (_, points) = read(&e57_file(None, &[scan]));
    assert_eq!(points.viewpoint, None);
    for (i, p) in truth.iter().enumerate() {
        // Up to 18 km: f32 alone would have an error of a millimetre.
        assert!((points.origin + points.positions.get(i)).distance(*p) < 1e-6);
    }
    let index = RecordDataType::Integer { min: 0, max: 100 };
    prototype.extend([record(RecordName::RowIndex, index.clone()), record(RecordName::ColumnIndex, index)]);
    let row = |p: &DVec3| [row(p), [3, 4].map(RecordValue::Integer).to_vec()].concat();
    let translation = e57::Translation { x: 1.0, y: 2.0, z: 3.0 };
    let pose = Some(e57::Transform { translation, ..e57::Transform::default() });
    let scan = Scan { prototype, rows: truth.iter().map(row).collect(), pose };
    let (loaded, points) = read(&e57_file(Some("EPSG:2056"), &[scan]));
    assert_eq!(points.viewpoint, Some(DVec3::new(1.0, 2.0, 3.0)));
    assert_eq!(loaded.attributes, ["position", "column_index", "row_index"]);
    assert_eq!(points.comments, ["crs EPSG:2056"]);
}

/// Builds two scans of 3000 points, identified by their times. The first has a pose with a rotation, millimetre steps,
/// byte colours and some points flagged as invalid. The second has angles, and colours from 0 to 1000. Also returns a
/// function from the index of a point of the first scan to its position.
fn two_scans() -> (Vec<Scan>, impl Fn(usize) -> DVec3) {
    let double = || RecordDataType::Double { min: None, max: None };
    let coordinate = || RecordDataType::ScaledInteger { min: -100_000, max: 100_000, scale: 0.001, offset: 0.5 };
    let level = || RecordDataType::Integer { min: 0, max: 1000 };
    let names = |names: [RecordName; 3], kind: &dyn Fn() -> RecordDataType| names.map(|n| record(n, kind()));
    let xyz = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ];
    let angles = [RecordName::SphericalRange, RecordName::SphericalAzimuth, RecordName::SphericalElevation];
    let rgb = [RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue];
    let normal = ["normalX", "normalY", "normalZ"];
    let normal = normal.map(|n| RecordName::Unknown { namespace: "nor".into(), name: n.into() });
    let mut first = names(xyz, &coordinate).to_vec();
    first.push(Record::CARTESIAN_INVALID_STATE);
    first.extend([Record::COLOR_RED_U8, Record::COLOR_GREEN_U8, Record::COLOR_BLUE_U8, Record::INTENSITY_U16]);
    first.push(record(RecordName::TimeStamp, double()));
    let mut second = names(angles, &double).to_vec();
    second.extend(names(rgb, &level));
    second.extend(names(normal, &|| RecordDataType::Single { min: None, max: None }));
    second.push(record(RecordName::TimeStamp, double()));
    let place = |i: usize| [1, 2, 3].map(|salt| (hash(i, salt) % 200_000) as i64 - 100_000);
    let row = move |i: usize| {
        let mut row = place(i).map(RecordValue::ScaledInteger).to_vec();
        row.push(RecordValue::Integer(i64::from(i % 7 == 6) * 2));
        row.extend([4, 5, 6].map(|salt| RecordValue::Integer((hash(i, salt) % 256) as i64)));
        row.extend([RecordValue::Integer(i as i64 % 60_000), RecordValue::Double(i as f64 + 0.25)]);
        row
    };
    let rotation = e57::Quaternion { w: 0.5_f64.sqrt(), x: 0.0, y: 0.0, z: 0.5_f64.sqrt() };
    let pose =
        |rotation, [x, y, z]: [f64; 3]| Some(e57::Transform { rotation, translation: e57::Translation { x, y, z } });
    let first = Scan { prototype: first, rows: (0..3000).map(row).collect(), pose: pose(rotation, [4e5, 5e6, 100.0]) };
    let row = |i: usize| {
        let unit = |salt| hash(i, salt) as f64 * 2f64.powi(-64);
        let mut row = [10.0 + 90.0 * unit(1), 6.0 * unit(2) - 3.0, unit(3)].map(RecordValue::Double).to_vec();
        row.extend([4, 5, 6].map(|salt| RecordValue::Integer((hash(i, salt) % 1001) as i64)));
        row.extend([0.0, 0.6, 0.8].map(RecordValue::Single));
        row.push(RecordValue::Double(i as f64 + 0.25));
        row
    };
    let same = e57::Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 };
    let second = Scan { prototype: second, rows: (3000..6000).map(row).collect(), pose: pose(same, [4e5, 5e6, 0.0]) };
    let truth = move |i: usize| {
        let [x, y, z] = place(i).map(|v| v as f64 * 0.001 + 0.5);
        DVec3::new(4e5 - y, 5e6 + x, 100.0 + z)
    };
    (vec![first, second], truth)
}

#[test]
fn e57_is_written_by_levels_as_it_is_read() {
    let (scans, truth) = two_scans();
    let bytes = e57_file(Some("PROJCS[\"Zone\",AUTHORITY[\"EPSG\",\"25832\"]]"), &scans);
    // Read at once, positions are accurate to a tenth of a millimetre.
    let (all, levels, notes) = support::same_by_levels("scans.e57", &bytes, ("time_stamp", 1e-4), None).unwrap();
    assert_eq!(levels.points.len(), 6000 - 3000 / 7);
    for (at, i) in (0..3000).filter(|i| i % 7 != 6).enumerate() {
        // Tolerance: a step, 2⁻³⁰ of 256 m (half the octree's side), and the pose's rounding.
        let off = levels.place(at).distance(truth(i));
        assert!(off < 2.0 * 256.0 * 2f64.powi(-30), "{i}: {off}");
    }
    assert!(all.points.normals.is_some() && all.points.extras.iter().any(|e| e.name == "scan"));
    assert_eq!(levels.points.comments[0], all.points.comments[0]);
    assert!(notes.iter().any(|n| n.contains("left out 428 points flagged as invalid")), "{notes:?}");

    // The first scan alone has byte colours and needs no scan number; rows and columns show that it has one scanner
    // position.
    let (mut scans, _) = two_scans();
    let mut first = scans.swap_remove(0);
    first.prototype.push(record(RecordName::RowIndex, RecordDataType::Integer { min: 0, max: 100 }));
    first.prototype.push(record(RecordName::ColumnIndex, RecordDataType::Integer { min: 0, max: 100 }));
    first.rows.iter_mut().for_each(|row| row.extend([3, 4].map(RecordValue::Integer)));
    let bytes = e57_file(Some("EPSG:25832"), &[first]);
    let splats = |points: &PointCloud| {
        assert_eq!(points.viewpoint, Some(DVec3::new(4e5, 5e6, 100.0)));
        Ok(vec![surfel_io::copc::PointSplat { normal: [0.0, 0.6, 0.8], radius: 0.123 }; points.len()])
    };
    let (_, levels, notes) = support::same_by_levels("scan.e57", &bytes, ("time_stamp", 1e-4), Some(&splats)).unwrap();
    assert!(!levels.points.extras.iter().any(|e| e.name == "scan"));
    assert!(notes.iter().any(|n| n.contains("left out its system")), "{notes:?}");
}

#[test]
fn damaged_e57_is_refused_by_levels_as_when_read() {
    let (scans, _) = two_scans();
    let good = e57_file(None, &scans);
    for (at, what) in [(4000, "scan 1, 3000 points"), (200_000, "scan 2, 3000 points"), (good.len() - 900, "no E57")] {
        let mut wrong = good.clone();
        wrong[at] ^= 1;
        let by_levels = support::same_by_levels("a.e57", &wrong, ("time_stamp", 0.0), None).map(|_| ()).unwrap_err();
        let at_once = try_read(&wrong).unwrap_err();
        let said = |error: &str| error.split_once(": ").unwrap().1.to_owned();
        assert_eq!(said(&by_levels), said(&at_once));
        assert!(by_levels.contains(what) && by_levels.contains("a.e57"), "{by_levels}");
    }
    let error = support::same_by_levels("a.e57", &e57_file(None, &[]), ("", 0.0), None).map(|_| ()).unwrap_err();
    assert!(error.contains("no point"), "{error}");
}

#[test]
fn damaged_e57_is_refused_in_one_sentence() {
    let good = support::small_e57();
    let mut flipped = good.clone();
    flipped[200] ^= 1;
    assert!(try_read(&flipped).unwrap_err().contains("checksum"));
    for end in [10, 47, 500, 1024, good.len() - 1024, good.len() - 1] {
        let mut cut = good.clone();
        cut.truncate(end);
        assert!(try_read(&cut).is_err(), "{end}");
    }
    let text = |from: &str, to: &str| {
        let at = good.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        let mut bytes = good.clone();
        bytes[at..at + from.len()].copy_from_slice(to.as_bytes());
        support::seal(bytes)
    };
    // A count for which the page has room, although the points end long before.
    let error = try_read(&text("recordCount=\"60\"", "recordCount=\"99\"")).unwrap_err();
    assert!(error.contains("scan 1, 99 points"), "{error}");
    // A scan whose fields take no bits could have any number of points.
    let little = RecordDataType::Integer { min: 5, max: 9 };
    let names = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ];
    let prototype: Vec<Record> = names.into_iter().map(|n| record(n, little.clone())).collect();
    let rows = vec![vec![RecordValue::Integer(5); 3]; 4];
    let mut bytes = e57_file(None, &[Scan { prototype, rows, pose: None }]);
    assert!(try_read(&bytes).is_ok());
    let word = b"maximum=\"9\"";
    while let Some(at) = bytes.windows(word.len()).position(|w| w == word) {
        bytes[at + 9] = b'5';
    }
    let error = try_read(&support::seal(bytes)).unwrap_err();
    assert!(error.contains("no point"), "{error}");
}

/// Loads an E57 or LAS file with the option `repair`.
fn repaired(bytes: &[u8]) -> Result<Loaded, String> {
    let options = LoadOptions { repair: true, ..LoadOptions::default() };
    load_bytes(bytes, None, Path::new("a"), &options).map_err(|e| e.to_string())
}

#[test]
fn damaged_e57_is_read_up_to_its_damage_if_asked() {
    let double = RecordDataType::Double { min: None, max: None };
    let names = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ];
    let prototype: Vec<Record> = names.into_iter().map(|n| record(n, double.clone())).collect();
    let row = |i: i32| [f64::from(i), f64::from(i % 7), 0.5].map(RecordValue::Double).to_vec();
    let scan =
        |from: i32| Scan { prototype: prototype.clone(), rows: (from..from + 20_000).map(row).collect(), pose: None };
    let good = e57_file(Some("EPSG:2056"), &[scan(0), scan(50_000)]);
    let whole = repaired(&good).unwrap();
    assert_eq!(whole.content, try_read(&good).unwrap().content);
    assert!(!whole.notes.join("\n").contains("damaged"));
    // Damages a page in the middle of the first scan; a point has 24 bytes.
    let mut damaged = good.clone();
    let page = 200;
    damaged[page * 1024 + 77] ^= 4;
    let error = try_read(&damaged).unwrap_err();
    assert!(error.contains("`repair`") && error.contains("scan 1, 20000 points"), "{error}");
    let loaded = repaired(&damaged).unwrap();
    let Content::Points(points) = &loaded.content else { panic!("{:?}", loaded.content) };
    let first = points.len() - 20_000;
    // All packets (at most 64 KiB) that end before the page are read, and their points have the right positions.
    let most = page * 1020 / 24;
    assert!(first <= most && first + 65_536 / 24 >= most, "{first} of {most}");
    for i in [0, 1, first - 1, first, first + 19_999] {
        let x = if i < first { i } else { 50_000 + i - first };
        assert_eq!(points.origin + points.positions.get(i), DVec3::new(x as f64, (x % 7) as f64, 0.5), "{i}");
    }
    let said = format!("scan 1 is damaged: took {first} of its 20000 points");
    assert!(loaded.notes.iter().any(|note| note.starts_with(&said)), "{:?}", loaded.notes);
    // A scan whose start is damaged, and all scans.
    let pages = good.len() / 1024;
    let second = (0..pages).rfind(|page| {
        let mut damaged = good.clone();
        damaged[page * 1024 + 500] ^= 1;
        repaired(&damaged).is_ok_and(|l| matches!(&l.content, Content::Points(p) if p.len() == 20_000))
    });
    assert!(second.is_some_and(|page| page > pages / 3), "{second:?} of {pages}");
    let mut none = good.clone();
    (0..pages / 2 + 20).for_each(|page| none[page * 1024 + 100] ^= u8::from(page > 0));
    let error = repaired(&none).unwrap_err();
    assert!(error.contains("no point") && error.lines().count() <= 4, "{error}");
    // Bytes after the last page are ignored; a file without its end lacks the XML that describes its contents.
    let longer = [&good[..], &[1; 333]].concat();
    assert!(try_read(&longer).is_err());
    assert_eq!(repaired(&longer).unwrap().content, whole.content);
    for end in [10, 47, 500, 1024, 20_000, good.len() / 2, good.len() - 1024, good.len() - 1] {
        assert!(repaired(&good[..end]).is_err(), "{end}");
    }
}

#[test]
fn las_1_5_is_read_as_1_4_in_formats_6_to_10() {
    for format in 6..=10_u8 {
        for packed in [false, true] {
            // The crate doesn't write waveforms, which follow the fields of formats 6 and 8.
            let (like, waveform) = match format {
                9 => (6, 29),
                10 => (8, 29),
                other => (other, 0),
            };
            if packed && waveform > 0 {
                continue;
            }
            let mut older = las_file((4, like, 0, packed), Vec::new(), 0..300, |_| ());
            if waveform > 0 {
                let start = u32::from_le_bytes(older[96..100].try_into().unwrap()) as usize;
                let size = usize::from(u16::from_le_bytes(older[105..107].try_into().unwrap()));
                let rows = older.split_off(start);
                rows.chunks_exact(size).for_each(|row| older.extend([row, &[0; 29]].concat()));
                older[104] = format;
                older[105..107].copy_from_slice(&(size as u16 + waveform).to_le_bytes());
            }
            let (_, expected) = read(&older);
            let mut newer = older.clone();
            newer[25] = 5;
            // With the header of 1.5, which is 18 bytes longer, and without.
            let start = u32::from_le_bytes(newer[96..100].try_into().unwrap());
            let mut longer = newer.clone();
            longer.splice(375..375, [0; 18]);
            longer[94..96].copy_from_slice(&393_u16.to_le_bytes());
            longer[96..100].copy_from_slice(&(start + 18).to_le_bytes());
            if packed {
                let at = start as usize + 18;
                let table = i64::from_le_bytes(longer[at..at + 8].try_into().unwrap()) + 18;
                longer[at..at + 8].copy_from_slice(&table.to_le_bytes());
            }
            for bytes in [newer, longer] {
                let (loaded, points) = read(&bytes);
                assert!(loaded.notes[0].contains("LAS 1.5"), "{:?}", loaded.notes);
                assert_eq!(points, expected, "format {format}");
            }
        }
    }
    let mut old = las_file((3, 3, 0, false), Vec::new(), 0..10, |_| ());
    old[25] = 5;
    let error = try_read(&old).unwrap_err();
    assert!(error.contains("is LAS 1.5 with points of format 3") && error.contains("formats 6 to 10"), "{error}");
    let mut future = las_file((4, 6, 0, false), Vec::new(), 0..10, |_| ());
    future[25] = 6;
    assert!(try_read(&future).unwrap_err().contains("is LAS 1.6"));
    let log = format!("~Version Information\n VERS. 2.0:\n{}", "# a well log\n".repeat(40));
    let by_name = load_bytes(log.as_bytes(), Some(Format::Las), Path::new("t.las"), &LoadOptions::default());
    let error = by_name.unwrap_err().to_string();
    assert!(error.contains("doesn't start with 'LASF'") && error.contains("well logs"), "{error}");
}

/// Builds a scan of `rows` points with coordinates of one bit each, and `fields` further fields.
fn wide_scan(rows: usize, fields: usize, kind: &RecordDataType, value: &RecordValue) -> Scan {
    let bit = RecordDataType::Integer { min: 0, max: 1 };
    let names = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ];
    let mut prototype: Vec<Record> = names.into_iter().map(|name| record(name, bit.clone())).collect();
    prototype.extend((0..fields).map(|i| {
        let name = RecordName::Unknown { namespace: "nor".into(), name: format!("f{i}") };
        record(name, kind.clone())
    }));
    let mut row = vec![RecordValue::Integer(1); 3];
    row.resize(3 + fields, value.clone());
    Scan { prototype, rows: vec![row; rows], pose: None }
}

#[test]
fn e57_of_many_fields_is_bounded() {
    let single = RecordDataType::Single { min: None, max: None };
    let wide = |fields: usize| wide_scan(2, fields, &single, &RecordValue::Single(0.5));
    let (_, points) = read(&e57_file(None, &[wide(997)]));
    assert_eq!((points.len(), points.extras.len()), (2, 997));
    let error = try_read(&e57_file(None, &[wide(998)])).unwrap_err();
    assert!(error.contains("scan 1 has points of 1001 fields") && error.contains("at most 1000"), "{error}");
    // Scans with different fields: the file has all of them.
    let renamed = |scan: usize| {
        let mut scan_of = wide(700);
        for record in &mut scan_of.prototype[3..] {
            if let RecordName::Unknown { name, .. } = &mut record.name {
                *name = format!("s{scan}{name}");
            }
        }
        scan_of
    };
    let error = try_read(&e57_file(None, &[renamed(0), renamed(1)])).unwrap_err();
    assert!(error.contains("its scans have points of 1400 fields"), "{error}");
    // A field with a single value takes no bits in the file, and eight bytes per point in memory.
    let constant = RecordDataType::Integer { min: 1 << 40, max: 1 << 40 };
    let file = |rows: usize| e57_file(None, &[wide_scan(rows, 900, &constant, &RecordValue::Integer(1 << 40))]);
    let (_, points) = read(&file(1000));
    assert_eq!((points.len(), points.extras.len()), (1000, 900));
    let mut lies = file(1000);
    let at = lies.windows(18).position(|w| w == b"recordCount=\"1000\"").unwrap();
    lies[at + 13..at + 17].copy_from_slice(b"9999");
    lies.resize(lies.len() + (60 << 10), 0);
    let error = try_read(&support::seal(lies)).unwrap_err();
    assert!(error.contains("9999 points"), "{error}");
}
