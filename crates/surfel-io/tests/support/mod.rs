//! Scanner files for tests, written by established crates.

#![allow(dead_code, unreachable_pub, missing_docs, reason = "each test uses a part")]

use ::las::{Builder, Color, Point, Transform, Vector, Vlr, Writer, point::Classification, point::Format};
use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue, Transform as Pose};
use std::io::Cursor;
use std::path::PathBuf;
use surfel_io::copc::{CopcOptions, Prepare, save_copc};
use surfel_io::{Content, LoadOptions, load};
use surfel_model::PointCloud;

/// Origin and step of the grid on which points lie, in metres.
pub const OFFSET: [f64; 3] = [637_000.0, 4_851_000.0, -20.0];
pub const STEP: f64 = 0.001;

/// Returns a number for point `i` that looks random and is the same in each run. `salt` selects one of several
/// sequences.
pub fn hash(i: usize, salt: u64) -> u64 {
    let mut z = (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(salt.wrapping_mul(0xD1B5_4A32_D192_ED03));
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Returns the grid steps of point `i`.
pub fn grid(i: usize) -> [i64; 3] {
    [i as i64 * 7 % 700_001, (hash(i, 1) % 900_000) as i64, (hash(i, 2) % 90_000) as i64]
}

pub fn is_withheld(i: usize) -> bool {
    hash(i, 3).is_multiple_of(50)
}

/// Returns point `i` of a file of this format.
pub fn point(i: usize, format: &Format) -> Point {
    let at = grid(i);
    let world = |k: usize| OFFSET[k] + at[k] as f64 * STEP;
    let color = Color { red: hash(i, 4) as u16, green: hash(i, 5) as u16, blue: hash(i, 6) as u16 };
    Point {
        x: world(0),
        y: world(1),
        z: world(2),
        intensity: hash(i, 7) as u16,
        return_number: (hash(i, 8) % 5 + 1) as u8,
        number_of_returns: 5,
        classification: Classification::new((hash(i, 9) % 8) as u8).unwrap(),
        is_withheld: is_withheld(i),
        is_key_point: i.is_multiple_of(3),
        scan_angle: (hash(i, 10) % 60) as f32 - 30.0,
        user_data: hash(i, 11) as u8,
        point_source_id: hash(i, 12) as u16,
        gps_time: format.has_gps_time.then_some(1e8 + i as f64 * 1e-6),
        color: format.has_color.then_some(color),
        nir: format.has_nir.then_some(hash(i, 13) as u16),
        extra_bytes: (0..format.extra_bytes).map(|k| hash(i, 20 + u64::from(k)) as u8).collect(),
        ..Point::default()
    }
}

pub fn vlr(user_id: &str, record_id: u16, data: Vec<u8>) -> Vlr {
    Vlr { user_id: user_id.into(), record_id, description: String::new(), data }
}

/// Builds a LAS or LAZ file of the points with these indices. The tuple has the minor version, the point format, the
/// number of extra bytes per point, and true for LAZ.
pub fn las_file(
    (minor, format, extra, packed): (u8, u8, u16, bool),
    vlrs: Vec<Vlr>,
    points: impl Iterator<Item = usize>,
    change: impl Fn(&mut Point),
) -> Vec<u8> {
    let mut builder = Builder::from((1, minor));
    builder.point_format = Format::new(format).unwrap();
    builder.point_format.extra_bytes = extra;
    builder.point_format.is_compressed = packed;
    let axis = |k: usize| Transform { scale: STEP, offset: OFFSET[k] };
    builder.transforms = Vector { x: axis(0), y: axis(1), z: axis(2) };
    builder.generating_software = "surfel's test".into();
    builder.vlrs = vlrs;
    let mut writer = Writer::new(Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
    for i in points {
        let mut made = point(i, &writer.header().point_format().clone());
        change(&mut made);
        writer.write_point(made).unwrap();
    }
    writer.into_inner().unwrap().into_inner()
}

/// A scan of an E57 file.
pub struct Scan {
    pub prototype: Vec<Record>,
    pub rows: Vec<Vec<RecordValue>>,
    pub pose: Option<Pose>,
}

pub fn record(name: RecordName, data_type: RecordDataType) -> Record {
    Record { name, data_type }
}

/// Builds an E57 file of these scans.
pub fn e57_file(crs: Option<&str>, scans: &[Scan]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut bytes, "{file}").unwrap();
    writer.set_coordinate_metadata(crs.map(str::to_owned));
    writer.register_extension(e57::Extension::new("nor", "http://www.libe57.org/E57_NOR_surface_normals.txt")).unwrap();
    for scan in scans {
        let mut points = writer.add_pointcloud("{scan}", scan.prototype.clone()).unwrap();
        points.set_transform(scan.pose.clone());
        for row in &scan.rows {
            points.add_point(row.clone()).unwrap();
        }
        points.finalize().unwrap();
    }
    writer.finalize().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// Corrects the checksums of an E57 file's pages, and pads the file to a whole number of pages.
pub fn seal(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.resize(bytes.len().div_ceil(1024) * 1024, 0);
    for page in bytes.chunks_exact_mut(1024) {
        // CRC-32C, bit by bit; big endian in the file.
        let mut crc = !0_u32;
        for byte in &page[..1020] {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                crc = (crc >> 1) ^ (0x82f6_3b78 & (crc & 1).wrapping_neg());
            }
        }
        page[1020..].copy_from_slice(&(!crc).to_be_bytes());
    }
    bytes
}

/// Builds a small E57 file with every feature that Surfel supports.
pub fn small_e57() -> Vec<u8> {
    let coordinate = RecordDataType::ScaledInteger { min: -1_000_000, max: 1_000_000, scale: 0.001, offset: 0.5 };
    let float = RecordDataType::Single { min: None, max: None };
    let flat = Scan {
        prototype: vec![
            record(RecordName::CartesianX, coordinate.clone()),
            record(RecordName::CartesianY, coordinate.clone()),
            record(RecordName::CartesianZ, coordinate),
            Record::CARTESIAN_INVALID_STATE,
            Record::COLOR_RED_U8,
            Record::COLOR_GREEN_U8,
            Record::COLOR_BLUE_U8,
            Record::INTENSITY_U16,
        ],
        rows: (0..60_i64)
            .map(|i| {
                let mut row = [i * 100, i * i, -i].map(RecordValue::ScaledInteger).to_vec();
                row.extend([i64::from(i % 7 == 6) * 2, i * 4, 255 - i, 7, i * 1000].map(RecordValue::Integer));
                row
            })
            .collect(),
        pose: Some(Pose {
            rotation: e57::Quaternion { w: 0.5_f64.sqrt(), x: 0.0, y: 0.0, z: 0.5_f64.sqrt() },
            translation: e57::Translation { x: 4e5, y: 5e6, z: 100.0 },
        }),
    };
    let round = Scan {
        prototype: vec![
            record(RecordName::SphericalRange, float.clone()),
            record(RecordName::SphericalAzimuth, float.clone()),
            record(RecordName::SphericalElevation, float),
        ],
        rows: (0..40).map(|i| [2.0, i as f32 * 0.1, i as f32 * 0.02].map(RecordValue::Single).to_vec()).collect(),
        pose: Some(Pose {
            rotation: e57::Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 },
            translation: e57::Translation { x: 4e5, y: 5e6, z: 0.0 },
        }),
    };
    e57_file(Some("PROJCS[\"Zone\",AUTHORITY[\"EPSG\",\"25832\"]]"), &[flat, round])
}

/// The points of a file, and their order by a column with distinct values.
pub struct Ordered {
    pub points: PointCloud,
    order: Vec<usize>,
}

impl Ordered {
    fn load(path: &PathBuf, key: &str) -> Result<Self, String> {
        let Content::Points(points) = load(path, &LoadOptions::default()).map_err(|e| e.to_string())?.content else {
            panic!("{path:?} holds no points")
        };
        let column = &points.extras.iter().find(|e| e.name == key).unwrap().values;
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|a, b| column.get(*a).total_cmp(&column.get(*b)));
        Ok(Self { points, order })
    }

    pub fn place(&self, i: usize) -> glam::DVec3 {
        self.points.origin + self.points.positions.get(self.order[i])
    }
}

/// Converts a file to COPC and compares its points with the same points read at once. Positions must agree within
/// `metres` and all else exactly, except for colours, which become 16 bits. Returns both, with the notes of the
/// conversion.
pub fn same_by_levels(
    name: &str,
    bytes: &[u8],
    (key, metres): (&str, f64),
    prepare: Option<Prepare<'_>>,
) -> Result<(Ordered, Ordered, Vec<String>), String> {
    let folder = std::env::temp_dir().join(format!("surfel-by-levels-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let (input, output) = (folder.join(name), folder.join("out.copc.laz"));
    std::fs::write(&input, bytes).unwrap();
    let written = save_copc(std::slice::from_ref(&input), &output, &CopcOptions::default(), prepare, &|_, _, _| ());
    let read = written
        .map_err(|e| e.to_string())
        .and_then(|report| Ok((Ordered::load(&input, key)?, Ordered::load(&output, key)?, report.notes)));
    std::fs::remove_dir_all(&folder).unwrap();
    let (all, levels, notes) = read?;
    assert_eq!(all.points.len(), levels.points.len(), "{name}");
    for i in 0..all.points.len() {
        let off = all.place(i).distance(levels.place(i));
        assert!(off <= metres, "{name}, point {i}: {off}");
        let (a, b) = (all.order[i], levels.order[i]);
        if let Some(colors) = &all.points.colors {
            let encoded = |c: [f32; 3]| c.map(|v| surfel_math::srgb::encode(f64::from(v)));
            let (x, y) = (encoded(colors[a]), encoded(levels.points.colors.as_ref().unwrap()[b]));
            assert!((0..3).all(|k| (x[k] - y[k]).abs() < 0.6 / 65_535.0), "{name}, point {i}: {x:?} {y:?}");
        }
        if let Some(normals) = &all.points.normals {
            assert_eq!(normals.get(a), levels.points.normals.as_ref().unwrap().get(b), "{name}, point {i}");
        }
        for extra in &all.points.extras {
            let found = levels.points.extras.iter().find(|e| e.name == extra.name);
            assert_eq!(found.map(|e| e.values.get(b)), Some(extra.values.get(a)), "{name}, {}, point {i}", extra.name);
        }
    }
    Ok((all, levels, notes))
}
