//! PLY: the splat profile, points, meshes and Gaussian splats; round trips of splats.

use glam::{DVec3, Vec3};
use std::path::Path;
use surfel_io::{Content, Format, LoadOptions, Loaded, PlyEncoding, load_bytes, write_splat_ply};
use surfel_model::{
    ClipColumns, ClipCurve, ClipLine, ClipMode, CloudData, Column3, ExtraColumn, ExtraValues, Mesh, OnInvalid,
    PointCloud, Shape, SplatCloud, Up,
};

const ENCODINGS: [PlyEncoding; 3] = [PlyEncoding::Ascii, PlyEncoding::BinaryLittleEndian, PlyEncoding::BinaryBigEndian];

fn load(bytes: impl AsRef<[u8]>) -> Loaded {
    try_load(bytes).unwrap_or_else(|e| panic!("{e}"))
}

fn try_load(bytes: impl AsRef<[u8]>) -> Result<Loaded, String> {
    load_bytes(bytes.as_ref(), Some(Format::Ply), Path::new("t.ply"), &LoadOptions::default())
        .map_err(|e| e.to_string())
        .inspect_err(|e| assert!(e.lines().count() <= 4 && e.starts_with("t.ply: "), "{e}"))
}

fn ascii(properties: &str, rows: &str) -> String {
    let count = rows.lines().count();
    let properties: String = properties.split(',').map(|p| format!("property {}\n", p.trim())).collect();
    format!("ply\nformat ascii 1.0\nelement vertex {count}\n{properties}end_header\n{rows}\n")
}

fn splats(loaded: Loaded) -> SplatCloud {
    match loaded.content {
        Content::Splats(s) => s,
        other => panic!("{other:?}"),
    }
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

fn written(cloud: &SplatCloud, encoding: PlyEncoding) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_splat_ply(&mut bytes, cloud, encoding).unwrap();
    bytes
}

/// Returns a cloud with every column of the model.
fn full_cloud() -> SplatCloud {
    let n = 5000; // more than one block of rows
    let v = |i: usize, k: f32| Vec3::new((i as f32 * 0.37 + k).sin(), (i as f32 * 0.61 + k).cos(), 0.25 + k);
    let column = |k: f32| Column3::from_f32((0..n).map(|i| v(i, k)).collect());
    let nan = ClipLine { a: f32::NAN, b: f32::NAN, c: f32::NAN };
    let mut data = CloudData::new(DVec3::ZERO, column(0.0), Shape::Ellipses { s: column(1.0), t: column(2.0) });
    data.colors = Some((0..n).map(|i| [0.1 * (i % 7) as f32, 1.5, 0.0]).collect());
    data.alphas = Some((0..n).map(|i| (i % 11) as f32 / 10.0).collect());
    data.shading_normals = Some(column(3.0));
    let curve = |i: usize| ClipCurve { theta1: 0.1, theta3: i as f32, u: 1e-40, v: -0.0, w: 1e30 };
    data.clips = Some(ClipColumns {
        curves: Some((0..n).map(curve).collect()),
        lines: Some((0..n).map(|i| [ClipLine { a: i as f32, b: -1.0, c: 0.5 }; 4]).collect()),
        modes: Some((0..n).map(|i| if i % 2 == 0 { ClipMode::And } else { ClipMode::Or }).collect()),
    });
    if let Some(ClipColumns { lines: Some(lines), .. }) = &mut data.clips {
        lines.iter_mut().for_each(|l| l[2] = ClipLine { c: 7.0, ..l[1] });
        assert!(lines.iter().flatten().all(|l| *l != nan));
    }
    data.interior_weight = Some(5.43);
    data.oriented = true;
    data.up = Some(Up::MinusZ);
    data.extras = vec![
        ExtraColumn { name: "id".into(), values: ExtraValues::U32((0..n as u32).rev().collect()) },
        ExtraColumn { name: "time".into(), values: ExtraValues::F64((0..n).map(|i| i as f64 / 3.0).collect()) },
        ExtraColumn { name: "class".into(), values: ExtraValues::I8((0..n).map(|i| i as i8).collect()) },
    ];
    data.comments = vec!["a scan".into(), "  of mine ".into()];
    SplatCloud::new(data, OnInvalid::Refuse).unwrap().0
}

#[test]
fn splat_round_trip_loses_nothing_in_any_encoding() {
    let cloud = full_cloud();
    for encoding in ENCODINGS {
        let loaded = load(written(&cloud, encoding));
        assert_eq!(loaded.up, Up::MinusZ);
        let mut data = splats(loaded).into_data();
        assert_eq!(
            data.comments.drain(2..).collect::<Vec<_>>(),
            ["up -z", "interior_weight 5.43", "oriented", "colors linear"]
        );
        data.comments = cloud.data().comments.iter().map(|c| c.trim_end().to_owned()).collect();
        let mut expected = cloud.data().clone();
        expected.comments = data.comments.clone();
        assert_eq!(data, expected, "{encoding:?}");
        // A cloud that was read can be written again without change.
        let again = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
        assert_eq!(splats(load(written(&again, encoding))).data().extras, expected.extras);
    }
}

#[test]
fn splat_round_trip_keeps_georeferenced_positions() {
    let world = |i: u32| DVec3::new(4.5e6 + f64::from(i) * 1.234_567e-3, -7.1e6, 312.25 + f64::from(i) / 3.0);
    let positions: Vec<DVec3> = (0..100).map(world).collect();
    let (origin, centers) = Column3::with_origin(&positions);
    assert_ne!(origin, DVec3::ZERO);
    let normals = Column3::from_f32(vec![Vec3::Z; 100]);
    let data = CloudData::new(origin, centers, Shape::Disks { normals, radii: vec![0.1; 100] });
    let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
    for encoding in ENCODINGS {
        let bytes = written(&cloud, encoding);
        assert!(String::from_utf8_lossy(&bytes[..200]).contains("property double x"));
        let read = splats(load(bytes));
        for (i, p) in positions.iter().enumerate() {
            // Centres have 48 bits of the extent (33 m) relative to an exact origin: less than a nanometre, the last
            // digit of an f64 at 7e6.
            assert!((read.center(i) - *p).abs().max_element() < 1e-9, "{i}: {} {p}", read.center(i));
        }
        assert_eq!(read.data().origin, origin);
    }
}

#[test]
fn splat_colors_are_uchar_only_where_that_is_exact() {
    let text = ascii(
        "float x,float y,float z,float nx,float ny,float nz,float radius,uchar red,uchar green,uchar blue,uchar alpha",
        "0 0 0 0 0 1 1 0 128 255 51",
    );
    let cloud = splats(load(&text));
    // IEC 61966-2-1 of 128/255, computed in f64.
    assert_eq!(cloud.color(0), [0.0, 0.215_860_5, 1.0]);
    assert_eq!(cloud.alpha(0), 0.2);
    let bytes = written(&cloud, PlyEncoding::Ascii);
    let written_text = String::from_utf8(bytes).unwrap();
    assert!(written_text.contains("property uchar red") && written_text.ends_with("0 128 255 51\n"), "{written_text}");
    let mut data = cloud.into_data();
    data.colors = Some(vec![[0.5, 0.0, 0.0]]);
    let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
    let text = String::from_utf8(written(&cloud, PlyEncoding::Ascii)).unwrap();
    assert!(text.contains("property float red"), "{text}");
}

#[test]
fn splat_properties_in_any_order_and_of_any_type() {
    let text = ascii(
        "double radius,int8 nz,short ny,list uchar int junk,uint8 nx,ushort z,int32 y,float64 x,ushort red,ushort \
         green,ushort blue",
        "0.5 -1 0 3 9 9 9 0 7 -8 1.5 0 65535 32896\n0.25 1 0 0 0 7 -8 2.5 0 65535 32896",
    );
    let cloud = splats(load(&text));
    assert_eq!(cloud.len(), 2);
    assert_eq!((cloud.center(0), cloud.center(1)), (DVec3::new(1.5, -8.0, 7.0), DVec3::new(2.5, -8.0, 7.0)));
    assert_eq!((cloud.normal(0), cloud.radius_max(1)), (DVec3::NEG_Z, 0.25));
    // 32896/65535 = 128/255.
    assert_eq!(cloud.color(0), [0.0, 1.0, 0.215_860_5]);
}

#[test]
fn splat_binary_lists_are_skipped_in_both_byte_orders() {
    for (name, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
        let mut bytes = format!(
            "ply\r\nformat {name} 1.0\r\nelement junk 2\r\nproperty list ushort double d\r\nelement vertex \
             1\r\nproperty float x\r\nproperty list uint short l\r\nproperty float y\r\nproperty double \
             z\r\nend_header\r\n"
        )
        .into_bytes();
        let mut put = |little: &[u8]| {
            let mut raw = little.to_vec();
            if big {
                raw.reverse();
            }
            bytes.extend(raw);
        };
        put(&1_u16.to_le_bytes());
        put(&1e9_f64.to_le_bytes());
        put(&0_u16.to_le_bytes());
        put(&1.5_f32.to_le_bytes());
        put(&2_u32.to_le_bytes());
        put(&7_i16.to_le_bytes());
        put(&8_i16.to_le_bytes());
        put(&2.5_f32.to_le_bytes());
        put(&1e-300_f64.to_le_bytes());
        let cloud = points(load(&bytes));
        assert_eq!(cloud.positions.get(0).x, 1.5);
        assert_eq!(cloud.positions.get(0).y, 2.5);
        for end in 0..bytes.len() {
            assert!(try_load(&bytes[..end]).is_err(), "{end}");
        }
    }
}

#[test]
fn splat_header_counts_are_held_against_the_file() {
    for format in ["ascii", "binary_little_endian"] {
        for count in ["99999999999", "18446744073709551615", "4000000000"] {
            let text = format!(
                "ply\nformat {format} 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float \
                 z\nend_header\n1 2 3\n"
            );
            let error = try_load(&text).unwrap_err();
            assert!(error.contains("within element 'vertex' number"), "{error}");
        }
    }
    let text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty list int int x\nend_header\n2000000000 1\n";
    assert!(try_load(text).unwrap_err().contains("the file ends"), "list count");
    let text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty list int int x\nend_header\n-1\n";
    assert!(try_load(text).unwrap_err().contains("0 or more list items"), "negative list count");
    let text = "ply\nformat ascii 1.0\nelement vertex 123456789012\nend_header\n";
    assert!(try_load(text).unwrap_err().contains("lack x y z"));
    let text = text.replace("ascii", "binary_big_endian");
    assert!(try_load(text).unwrap_err().contains("lack x y z"));
}

#[test]
fn splat_ascii_faults_name_line_and_property() {
    let p = "float x,float y,float z";
    let error = try_load(ascii(p, "1 2 3\n4 five 6")).unwrap_err();
    assert!(error.contains("found 'five' as property 'y' of element 'vertex' number 1 (line 9)"), "{error}");
    let error = try_load(ascii(p, "1 2 3 4\n5 6 7")).unwrap_err();
    assert!(error.contains("more values than the header has properties (line 8)"), "{error}");
    let error = try_load(ascii("uchar x,float y,float z", "300 2 3")).unwrap_err();
    assert!(error.contains("found '300'"), "{error}");
}

#[test]
fn splat_partial_sets_name_found_and_missing() {
    for (properties, row, expected) in [
        ("float x,float y", "1 2", "have x y but lack z"),
        ("float a", "1", "lack x y z; they have a"),
        ("float x,float y,float z,float nx,float nz", "1 2 3 4 5", "have nx nz but lack ny"),
        ("float x,float y,float z,float nx,float radius", "1 2 3 0 4", "have nx radius but lack ny nz"),
        ("float x,float y,float z,float su,float sv,float sw", "1 2 3 4 5 6", "have su sv sw but lack tu tv tw"),
        ("float x,float y,float z,uchar red", "1 2 3 4", "have red but lack green blue"),
        ("float x,float y,float z,float rot_0", "1 2 3 4", "looks like Gaussian splats, but its vertices have rot_0"),
        ("float x,float y,float z,float clip_w", "1 2 3 4", "have clip_w but lack clip_theta1"),
    ] {
        let error = try_load(ascii(properties, row)).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn splat_clip_needs_half_axes() {
    let disk = "float x,float y,float z,float nx,float ny,float nz,float radius";
    let clip = "float clip_line0_a,float clip_line0_b,float clip_line0_c";
    let error = try_load(ascii(&format!("{disk},{clip}"), "0 0 0 0 0 1 1 1 0 0")).unwrap_err();
    assert!(error.contains("half-axes"), "{error}");
    let error = try_load(ascii(&format!("float x,float y,float z,{clip}"), "0 0 0 1 0 0")).unwrap_err();
    assert!(error.contains("half-axes"), "{error}");
    let axes = "float x,float y,float z,float su,float sv,float sw,float tu,float tv,float tw";
    let cloud = splats(load(ascii(&format!("{axes},{clip},int clip_mode"), "0 0 0 1 0 0 0 1 0 1 0 nan 1")));
    let clips = cloud.data().clips.clone().unwrap();
    assert_eq!(clips.modes, Some(vec![ClipMode::Or]));
    let lines = clips.lines.unwrap()[0];
    assert!(lines[0].a == 1.0 && lines[0].c.is_nan() && lines[1].a.is_nan());
    let error = try_load(ascii(&format!("{axes},{clip},int clip_mode"), "0 0 0 1 0 0 0 1 0 1 0 0 2")).unwrap_err();
    assert!(error.contains("clip_mode of splat 0 is 2"), "{error}");
}

#[test]
fn splat_invalid_is_refused_and_repaired_on_request() {
    let p = "float x,float y,float z,float nx,float ny,float nz,float radius";
    let text = ascii(p, "0 0 0 0 0 1 1\n0 0 0 0 0 1 -1\nnan 0 0 0 0 1 1");
    let error = try_load(&text).unwrap_err();
    assert!(error.contains("splat 1 is invalid") && error.contains("2 of 3"), "{error}");
    let repair = LoadOptions { repair: true, ..LoadOptions::default() };
    let loaded = load_bytes(text.as_bytes(), None, Path::new("t.ply"), &repair).unwrap();
    assert!(loaded.notes[0].starts_with("dropped 2 invalid splats; the first was splat 1"), "{:?}", loaded.notes);
    assert_eq!(splats(loaded).len(), 1);
}

#[test]
fn splat_comments_say_up_and_interior_weight() {
    let with = |comment: &str| {
        let p = "float x,float y,float z,float nx,float ny,float nz,float radius";
        let text = ascii(p, "0 0 0 0 0 1 1").replace("element", &format!("comment {comment}\nelement"));
        try_load(text)
    };
    for (comment, up) in [("Vertical axis: z", Up::PlusZ), ("up -x", Up::MinusX), ("growing up", Up::PlusY)] {
        assert_eq!(with(comment).unwrap().up, up, "{comment}");
    }
    let cloud = splats(with("interior_weight 3.25").unwrap());
    assert_eq!(cloud.data().interior_weight, Some(3.25));
    assert!(!cloud.data().oriented);
    let cloud = splats(with("oriented").unwrap());
    assert!(cloud.data().oriented);
    // The comment is written once, and only if it is true.
    let said = |cloud: &SplatCloud| {
        String::from_utf8(written(cloud, PlyEncoding::Ascii)).unwrap().matches("comment oriented\n").count()
    };
    let mut undeclared = cloud.clone();
    undeclared.set_oriented(false);
    assert_eq!((said(&cloud), said(&undeclared)), (1, 0));
    for bad in ["interior_weight -1", "interior_weight", "interior_weight x", "interior_weight inf"] {
        assert!(with(bad).unwrap_err().contains("interior_weight W0"), "{bad}");
    }
}

#[test]
fn splat_comment_cannot_smuggle_in_header_lines() {
    let mut data = full_cloud().into_data();
    data.comments = vec!["a\nelement vertex 7\r\nend_header".into(), "up +x".into()];
    data.extras[0].name = "two words".into();
    data.extras[1].name = "x".into();
    data.up = None;
    let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
    let read = splats(load(written(&cloud, PlyEncoding::Ascii)));
    assert_eq!(read.len(), cloud.len());
    assert_eq!(read.data().up, None, "a comment that contradicts the cloud is left out");
    let names: Vec<&str> = read.data().extras.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["two_words", "x_", "class"]);
}

#[test]
fn points_keep_normals_and_extras_and_drop_what_is_nowhere() {
    let text = ascii("float x,float y,float z,float nx,float ny,float nz,int label", "1 2 3 0 0 1 5\nnan 0 0 0 0 1 6");
    let loaded = load(text);
    assert_eq!(loaded.notes, ["dropped 1 point whose coordinates are not finite"]);
    assert_eq!(loaded.attributes, ["position", "normal", "label"]);
    let cloud = points(loaded);
    assert_eq!(cloud.len(), 1);
    assert_eq!(cloud.extras[0].values, ExtraValues::I32(vec![5]));
}

#[test]
fn mesh_polygons_become_fans_and_attributes_stay() {
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float \
                z\nproperty float s\nproperty float t\nproperty uchar red\nproperty uchar green\nproperty uchar \
                blue\nelement face 3\nproperty uchar flags\nproperty list uchar int vertex_index\nend_header\n0 0 0 0 \
                0 255 0 0\n1 0 0 1 0 255 0 0\n1 1 0 1 1 255 0 0\n0 1 0 0 1 255 0 0\n9 4 0 1 2 3\n9 2 0 1\n9 3 3 2 1\n";
    let loaded = load(text);
    assert_eq!(loaded.notes, ["skipped 1 face with fewer than 3 corners"]);
    let m = mesh(loaded);
    assert_eq!(m.triangles, [[0, 1, 2], [0, 2, 3], [3, 2, 1]]);
    assert_eq!(m.uvs.unwrap()[2], [1.0, 0.0]);
    assert_eq!(m.colors.unwrap()[0], [1.0, 0.0, 0.0]);
    let bad = text.replace("3 3 2 1", "3 3 2 4");
    assert!(try_load(bad).unwrap_err().contains("triangle 2 is invalid"));
}

#[test]
fn mesh_strips_alternate_and_restart() {
    let text = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\nelement \
                tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n1 2 \
                0\n10 0 1 2 3 -1 2 3 3 4 5\n";
    let m = mesh(load(text));
    // The second strip's first two triangles are degenerate and only reverse its winding.
    assert_eq!(m.triangles, [[0, 1, 2], [2, 1, 3], [3, 4, 5]]);
    // All triangles of a strip have one orientation, facing +z.
    for t in &m.triangles[..2] {
        let [a, b, c] = t.map(|i| m.positions.get(i as usize));
        assert!((b - a).cross(c - a).z > 0.0);
    }
}

fn gaussian_text(third: Option<&str>, rotation: &str, opacity: &str) -> String {
    let scale_2 = if third.is_some() { ",float scale_2" } else { "" };
    ascii(
        &format!(
            "float x,float y,float z,float nx,float ny,float nz,float f_dc_0,float f_dc_1,float f_dc_2,float \
             f_rest_0,float opacity,float scale_0,float scale_1{scale_2},float rot_0,float rot_1,float rot_2,float \
             rot_3"
        ),
        // ln 0.1, ln 0.2
        &format!("1 2 3 0 0 0 0 9 -9 0.5 {opacity} -2.302585093 -1.609437912 {} {rotation}", third.unwrap_or("")),
    )
}

#[test]
fn gaussian_2d_becomes_an_ellipse_of_two_sigma() {
    // A quarter turn about z, unnormalised: x goes to y.
    let loaded = load(gaussian_text(None, "2 0 0 2", "0"));
    assert_eq!(loaded.up, Up::MinusY);
    assert!(loaded.notes[0].contains("1 spherical-harmonics"), "{:?}", loaded.notes);
    let cloud = splats(loaded);
    let (s, t) = cloud.axes(0);
    // Tolerance: logarithms and axes are stored in f32.
    assert!((s - DVec3::new(0.0, 0.2, 0.0)).length() < 1e-6, "{s}");
    assert!((t - DVec3::new(-0.4, 0.0, 0.0)).length() < 1e-6, "{t}");
    assert_eq!(cloud.alpha(0), 0.5);
    // sRGB ½, decoded; the others are clamped.
    assert_eq!(cloud.color(0), [0.214_041_14, 1.0, 0.0]);
}

/// Loads Gaussians as trained Gaussians instead of splats.
fn trained(text: impl AsRef<[u8]>) -> Result<Loaded, String> {
    let options = LoadOptions { gaussians: true, ..LoadOptions::default() };
    load_bytes(text.as_ref(), Some(Format::Ply), Path::new("a.ply"), &options).map_err(|e| e.to_string())
}

fn gaussians(loaded: Loaded) -> std::sync::Arc<surfel_model::GaussianCloud> {
    match loaded.content {
        Content::Gaussians(cloud) => cloud,
        other => panic!("{other:?}"),
    }
}

#[test]
fn trained_gaussians_keep_their_columns_in_any_order() {
    use surfel_model::GaussianKind;
    for degree in 0..=3_usize {
        let rest = 3 * ((degree + 1).pow(2) - 1);
        // Names in reverse order: the number in the name counts, and the coefficients of a channel are consecutive.
        let names: String = (0..rest).rev().map(|i| format!("float f_rest_{i},")).collect();
        let values: String = (0..rest).rev().map(|i| format!("{i} ")).collect();
        let text = ascii(
            &format!(
                "{names}float opacity,float x,float y,float z,float f_dc_0,float f_dc_1,float f_dc_2,float scale_0,\
                 float scale_1,float rot_0,float rot_1,float rot_2,float rot_3"
            ),
            &format!("{values}-9 1 2 3 0.5 -1 9 -2.302585093 -1.609437912 0 0 2 0"),
        );
        let loaded = trained(&text).unwrap();
        assert!(loaded.gaussian && loaded.notes.is_empty(), "{:?}", loaded.notes);
        let cloud = gaussians(loaded);
        let d = cloud.data();
        assert_eq!(
            (cloud.len(), d.kind, d.degree, cloud.center(0)),
            (1, GaussianKind::Flat, degree as u32, DVec3::new(1.0, 2.0, 3.0))
        );
        assert!((d.opacities[0] - 1.0 / (1.0 + 9f32.exp())).abs() < 1e-9, "haze stays");
        assert!((d.sigmas[0][0] - 0.1).abs() < 1e-7 && (d.sigmas[0][1] - 0.2).abs() < 1e-7);
        // w, x, y, z in the file: half a turn about y.
        assert_eq!(d.rotations[0], [0.0, 1.0, 0.0, 0.0]);
        let coefficients = cloud.coefficients(0);
        for (found, want) in coefficients[0].iter().zip([0.5, -1.0, 9.0]) {
            assert!((found - want).abs() < 1e-6, "{coefficients:?}");
        }
        let each = rest / 3;
        for (k, found) in coefficients[1..].iter().enumerate() {
            assert_eq!(*found, [k, each + k, 2 * each + k].map(|i| i as f32));
        }
    }
}

#[test]
fn trained_gaussians_that_are_odd_are_told() {
    let solid = gaussians(trained(gaussian_text(Some("0"), "1 0 0 0", "0")).unwrap());
    assert_eq!((solid.data().kind, solid.sigmas(0)[2]), (surfel_model::GaussianKind::Solid, 1.0));
    let loaded = trained(gaussian_text(None, "1 0 0 0", "0")).unwrap();
    assert!(loaded.notes[0].contains("1 spherical-harmonics"), "{:?}", loaded.notes);
    assert!(trained(gaussian_text(None, "0 0 0 0", "0")).unwrap_err().contains("splat 0 is invalid: its rotation"));
    assert!(trained(gaussian_text(None, "1 0 0 0", "nan")).unwrap_err().contains("opacity"));
    // Files without Gaussians are unaffected.
    let points = trained(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                          end_header\n1 2 3\n",
    );
    assert!(matches!(points.unwrap().content, Content::Points(_)));
}

#[test]
fn gaussian_3d_is_spanned_by_its_two_largest_axes() {
    // The first axis is the smallest here.
    let loaded = load(gaussian_text(Some("0"), "1 0 0 0", "0"));
    assert!(loaded.notes.iter().any(|n| n.contains("two largest axes")), "{:?}", loaded.notes);
    let cloud = splats(loaded);
    assert_eq!(cloud.normal(0), DVec3::X);
    assert!((cloud.radius_max(0) - 2.0).abs() < 1e-6);
}

#[test]
fn gaussian_haze_is_dropped_and_an_invalid_one_is_not_hidden() {
    let loaded = load(gaussian_text(None, "1 0 0 0", "-3"));
    assert!(loaded.notes.iter().any(|n| n.starts_with("dropped 1 Gaussians")), "{:?}", loaded.notes);
    assert!(splats(loaded).is_empty());
    assert!(try_load(gaussian_text(None, "0 0 0 0", "0")).unwrap_err().contains("splat 0 is invalid"));
    assert!(try_load(gaussian_text(None, "1 0 0 0", "nan")).unwrap_err().contains("alpha"));
}

#[test]
fn meshes_have_columns_of_vertices_and_of_triangles() {
    let text = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                property double heat\nproperty uchar kind\nelement face 3\nproperty list uchar int vertex_indices\n\
                property int part\nproperty float Heat\nend_header\n\
                0 0 0 1.5 1\n1 0 0 2.5 2\n1 1 0 3.5 3\n0 1 0 4.5 4\n0 2 0 nan 5\n\
                4 0 1 2 3 -7 0.5\n2 0 1 8 0.25\n3 3 2 4 9 0.75\n";
    let loaded = load(text);
    assert_eq!(loaded.attributes, ["position", "heat", "kind", "part", "face_Heat"]);
    let m = mesh(loaded);
    let column = |name: &str, values| ExtraColumn { name: name.into(), values };
    assert_eq!(m.vertex_extras[1], column("kind", ExtraValues::U8(vec![1, 2, 3, 4, 5])));
    assert_eq!(m.vertex_extras[0].values.range(), Some((1.5, 4.5)));
    // A quad is two triangles; a face of two corners is none.
    assert_eq!(m.triangles.len(), 3);
    let parts = column("part", ExtraValues::I32(vec![-7, -7, 9]));
    assert_eq!(m.triangle_extras, [parts, column("face_Heat", ExtraValues::F32(vec![0.5, 0.5, 0.75]))]);
    // Vertices that textures split keep their values.
    let corners = "property list uchar float texcoord\nend_header";
    let split = text.replace("end_header", corners);
    let split = split.replacen("ply\nformat ascii 1.0\n", "ply\nformat ascii 1.0\ncomment TextureFile none.png\n", 1);
    let split = split.replace("-7 0.5\n", "-7 0.5 8 0 0 1 0 1 1 0 1\n").replace("8 0.25\n", "8 0.25 0\n");
    let split = mesh(load(split.replace("9 0.75\n", "9 0.75 6 .5 .5 .6 .6 .7 .7\n")));
    assert_eq!(split.positions.len(), 7);
    for i in 0..7 {
        let (x, y) = (split.positions.get(i).x, split.positions.get(i).y);
        let expected = match (x as i32, y as i32) {
            (0, 0) => 1.0,
            (1, 0) => 2.0,
            (1, 1) => 3.0,
            (0, 1) => 4.0,
            _ => 5.0,
        };
        assert_eq!(split.vertex_extras[1].values.get(i), expected, "{x} {y}");
    }
}
