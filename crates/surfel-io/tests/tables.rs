//! Tables of numbers: text, NumPy arrays and binary rows, with columns that have no names or get them by `--columns`.

#![cfg(all(feature = "laz", feature = "npy", feature = "points"))]

use crate::numpy::{npy, zip};
use crate::point_formats::{le, load, places, points, refused};
use crate::support::same_by_levels;
use glam::DVec3;
use std::path::Path;
use surfel_io::{Content, Format, LoadOptions, Loaded, load_bytes};
use surfel_model::PointCloud;

/// Generator of random numbers that are the same in each run.
struct Random(u64);

impl Random {
    /// Returns a random number from 0 to 1.
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f64 / f64::from(1 << 24)
    }

    fn below(&mut self, count: u32) -> f64 {
        (self.unit() * f64::from(count)).floor()
    }
}

/// Returns a colour near grey, of 256 levels.
fn color(random: &mut Random) -> [f64; 3] {
    let grey = 20.0 + random.below(200);
    [0; 3].map(|_| (grey + random.below(60) - 25.0).clamp(0.0, 255.0))
}

fn rounded(values: impl IntoIterator<Item = f64>, digits: i32) -> Vec<f64> {
    let scale = 10_f64.powi(digits);
    values.into_iter().map(|v| (v * scale).round() / scale).collect()
}

/// Returns the numbers of row `i` of a column, or group of columns, of this kind.
fn numbers(kind: &str, i: usize, random: &mut Random) -> Vec<f64> {
    let row = i as f64;
    match kind {
        "local" => rounded([0; 3].map(|_| random.unit() * 10.0 - 5.0), 4),
        "centimetres" => [0; 3].map(|_| random.below(1000)).to_vec(),
        "utm" => rounded([431_000.0, 5_412_000.0, 200.0].map(|at| at + random.unit() * 100.0), 2),
        "sorted" => rounded([row * 0.013, random.unit() * 9.0, random.unit() * 9.0], 3),
        // A raster of heights, with x and y in whole metres, and sorted voxels.
        "raster" => rounded([(i % 20) as f64, (i / 20) as f64, 200.0 + random.unit() * 3.0], 2),
        "voxels" => vec![(i / 100) as f64, (i / 10 % 10) as f64, (i % 10) as f64],
        "index0" => vec![row],
        "index1" => vec![row + 1.0],
        "index9000" => vec![row + 9000.0],
        "tens" => vec![10.0 * row],
        // An index after rows were dropped, and a shuffled index.
        "gaps" => vec![(3 * i + i * i % 3) as f64],
        "shuffled" => vec![(i * 7919 % 65_521) as f64],
        "rgb255" => color(random).to_vec(),
        "vivid" => vec![random.below(256), random.below(256), random.below(256)],
        "red" => vec![255.0, 0.0, 0.0],
        "white" => vec![255.0; 3],
        "palette" => {
            const COLORS: [[u8; 3]; 8] = [
                [31, 119, 180],
                [255, 127, 14],
                [44, 160, 44],
                [214, 39, 40],
                [148, 103, 189],
                [140, 86, 75],
                [227, 119, 194],
                [127, 127, 127],
            ];
            COLORS[random.below(8) as usize].map(f64::from).to_vec()
        }
        "rgb1" => rounded(color(random).map(|c| c / 255.0), 4),
        "rgbfloat" => rounded(color(random).map(|c| c / 256.1), 6),
        "mean255" => rounded(color(random).map(|c| c * 0.99 + 0.37), 2),
        "rgb65535" => color(random).map(|c| c * 257.0).to_vec(),
        "rgb16" => color(random).map(|c| c * 250.0 + random.below(250)).to_vec(),
        "alpha255" => vec![255.0],
        "alpha1" => vec![1.0],
        "normal" => {
            let v = DVec3::from_array([0; 3].map(|_| random.unit() - 0.5)).normalize_or(DVec3::Z);
            rounded(v.to_array(), 5)
        }
        "flow" => rounded([0; 3].map(|_| random.unit() * 4.0 - 2.0), 4),
        "i1" => rounded([random.unit()], 3),
        "i255" => vec![random.below(256)],
        "i4095" => vec![random.below(4096)],
        "ipts" => vec![random.below(4096) - 2048.0],
        "label" => vec![random.below(13)],
        "rings" => vec![random.below(32)],
        "classes" => vec![[0.0, 10.0, 40.0, 44.0, 48.0, 50.0, 70.0, 252.0, 259.0][random.below(9) as usize]],
        "constant" => vec![2.0],
        "returns" => {
            // Pulses of one to three returns.
            let count = 1 + (i / 3 * 7 % 3);
            vec![(i % 3 % count + 1) as f64, count as f64]
        }
        "counts" => numbers("returns", i, random).into_iter().rev().collect(),
        "return" => vec![(i % 3 + 1) as f64],
        "time" => rounded([1_600_000_000.0 + 0.01 * row], 2),
        "signed" => rounded([random.unit() * 7.0 - 3.0], 3),
        _ => panic!("{kind}"),
    }
}

fn rows(layout: &str, count: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut random = Random(seed);
    (0..count).map(|i| layout.split(' ').flat_map(|kind| numbers(kind, i, &mut random)).collect()).collect()
}

fn text(rows: &[Vec<f64>], divider: &str) -> String {
    let line = |row: &Vec<f64>| row.iter().map(f64::to_string).collect::<Vec<_>>().join(divider) + "\n";
    rows.iter().map(line).collect()
}

fn array(rows: &[Vec<f64>], kind: &str) -> Vec<u8> {
    let values = rows.iter().flatten();
    let data: Vec<u8> = match kind {
        "'<f4'" => values.flat_map(|v| (*v as f32).to_le_bytes()).collect(),
        _ => values.flat_map(|v| v.to_le_bytes()).collect(),
    };
    npy(kind, "False", &format!("({}, {})", rows.len(), rows[0].len()), &data)
}

/// Returns the column names that a note of the loaded file states.
fn names(loaded: &Loaded) -> String {
    let note = loaded.notes.iter().find_map(|note| {
        note.strip_prefix("took the columns as ")
            .or_else(|| note.split_once("with the columns ").map(|(_, after)| after))
    });
    let Some(note) = note else { return "x y z".to_owned() };
    note.split([':', ',', ';']).next().unwrap_or_default().to_owned()
}

/// Layouts as kinds of columns (see [`numbers`]), and the expected names of their roles.
const LAYOUTS: &[(&str, &str)] = &[
    ("local i1", "x y z intensity"),
    ("utm i255", "x y z intensity"),
    ("utm i4095", "x y z intensity"),
    ("local rgb255", "x y z red green blue"),
    ("utm vivid", "x y z red green blue"),
    ("local red", "x y z red green blue"),
    ("local white", "x y z red green blue"),
    ("local palette", "x y z red green blue"),
    ("local rgb1", "x y z red green blue"),
    ("local rgbfloat", "x y z red green blue"),
    ("local mean255", "x y z red green blue"),
    ("utm rgb65535", "x y z red green blue"),
    ("utm rgb16", "x y z red green blue"),
    ("raster rgb255", "x y z red green blue"),
    ("voxels rgb255", "x y z red green blue"),
    ("sorted rgb255", "x y z red green blue"),
    ("voxels i255", "x y z intensity"),
    ("raster i255", "x y z intensity"),
    ("local normal", "x y z nx ny nz"),
    ("local normal rgb255", "x y z nx ny nz red green blue"),
    ("utm rgb255 normal", "x y z red green blue nx ny nz"),
    ("local rgb1 normal", "x y z red green blue nx ny nz"),
    ("local normal label", "x y z nx ny nz label"),
    ("local rgb255 alpha255", "x y z red green blue alpha"),
    ("local rgb1 alpha1", "x y z red green blue alpha"),
    ("local rgb255 alpha255 normal", "x y z red green blue alpha nx ny nz"),
    ("utm ipts rgb255", "x y z intensity red green blue"),
    ("utm i255 rgb255", "x y z intensity red green blue"),
    ("local i1 rgb255", "x y z intensity red green blue"),
    ("utm rgb255 i4095", "x y z red green blue intensity"),
    ("utm rgb255 ipts", "x y z red green blue intensity"),
    ("local label", "x y z label"),
    ("local classes", "x y z label"),
    ("local rgb255 label", "x y z red green blue label"),
    ("local rgb1 label", "x y z red green blue label"),
    ("local rgbfloat label", "x y z red green blue label"),
    ("utm rgb65535 label", "x y z red green blue label"),
    ("local palette label", "x y z red green blue label"),
    ("local rgb255 label label", "x y z red green blue label label_2"),
    ("local rgb1 label label", "x y z red green blue label label_2"),
    ("utm ipts rgb255 label", "x y z intensity red green blue label"),
    ("local label label", "x y z label label_2"),
    ("local label label label", "x y z label label_2 label_3"),
    ("local i1 rings", "x y z intensity label"),
    ("utm i4095 return constant", "x y z intensity return_number column_6"),
    ("utm i255 returns", "x y z intensity return_number number_of_returns"),
    ("utm i4095 counts", "x y z intensity number_of_returns return_number"),
    ("utm i255 returns label", "x y z intensity return_number number_of_returns label"),
    ("utm returns label", "x y z return_number number_of_returns label"),
    ("index0 local", "index x y z"),
    ("index1 utm", "index x y z"),
    ("index9000 utm rgb255", "index x y z red green blue"),
    ("index0 index0 local", "index index_2 x y z"),
    ("tens local rgb1", "index x y z red green blue"),
    ("gaps local i1", "index x y z intensity"),
    ("shuffled utm rgb255 label", "index x y z red green blue label"),
    ("index1 raster i255", "index x y z intensity"),
    ("index0 voxels", "index x y z"),
    ("gaps centimetres rgb255", "index x y z red green blue"),
    ("centimetres rgb255", "x y z red green blue"),
    ("index1 local normal rgb255", "index x y z nx ny nz red green blue"),
    ("local rgb255 index0", "x y z red green blue index"),
    ("utm index9000 return constant", "x y z intensity return_number column_6"),
    ("label local rgb255", "label x y z red green blue"),
    ("label local", "label x y z"),
    ("time local i1", "time x y z intensity"),
    ("index0 time local", "index time x y z"),
    ("local i1 time", "x y z intensity time"),
    ("local flow", "x y z column_4 column_5 column_6"),
    ("local rgb255 flow", "x y z red green blue column_7 column_8 column_9"),
    ("local i1 signed signed", "x y z column_4 column_5 column_6"),
    ("raster flow", "x y z column_4 column_5 column_6"),
    ("raster normal rgb1", "x y z nx ny nz red green blue"),
    ("i255 label local signed signed", "column_1 label x y z column_6 column_7"),
];

#[test]
fn columns_without_names_have_the_roles_that_their_numbers_show() {
    let mut wrong = Vec::new();
    for (layout, expected) in LAYOUTS {
        for (count, seed) in [(60, 1), (60, 2), (700, 3), (2100, 4)] {
            // Classes that are many, or far apart, need many rows to be recognised.
            if (layout.contains("classes") || layout.contains("rings")) && count < 512 {
                continue;
            }
            let rows = rows(layout, count, seed);
            let (name, bytes) = match seed {
                1 => ("a.txt", text(&rows, " ").into_bytes()),
                2 => ("a.csv", text(&rows, ",").into_bytes()),
                _ => ("a.npy", array(&rows, "'<f8'")),
            };
            let found = names(&load(name, bytes));
            if found != *expected {
                wrong.push(format!("{layout}, {count} rows, {name}: {found}, expected {expected}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{} wrong:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn floats_show_the_same_roles() {
    for layout in ["local rgb255 label", "index1 local", "local i1 rgb255", "local rgb1 normal", "sorted label label"] {
        let rows = rows(layout, 300, 9);
        let [wide, narrow] = ["'<f8'", "'<f4'"].map(|kind| names(&load("a.npy", array(&rows, kind))));
        assert_eq!(wide, narrow, "{layout}");
    }
}

#[test]
fn the_note_says_what_decided() {
    let note = |layout: &str| load("a.txt", text(&rows(layout, 60, 5), " ")).notes[0].clone();
    for (layout, reasons) in [
        (
            "index1 local rgb255",
            "no first line names them, column 1 counts the rows, columns 5 to 7 share a range, 0 to 255, as colours do",
        ),
        ("local rgb1 label", "columns 4 to 6 share a range, 0 to 1, as colours do, column 7 holds few whole numbers"),
        ("local normal", "columns 4 to 6 have length one"),
        ("time local i1", "column 1 goes up from row to row as times do"),
        ("utm i255 returns", "columns 5 and 6 hold small numbers, one never above the other"),
    ] {
        let note = note(layout);
        assert!(note.contains(reasons) && note.ends_with("`columns` names them otherwise"), "{note}");
    }
}

#[test]
fn comment_that_names_other_columns_is_said_to_be_passed_over() {
    let notes = |text: &str| load("a.txt", text).notes;
    let note = |names: &str, comment: &str| {
        format!(
            "took the columns as {names}: the comment above them, '{comment}', doesn't name x, y and z; `columns` \
             names them otherwise"
        )
    };
    assert_eq!(notes("# foo bar baz\n1 2 3\n4 5 6\n"), [note("x y z", "foo bar baz")]);
    assert_eq!(notes("// foo, bar, baz\n\n1,2,3\n4,5,6\n"), [note("x y z", "foo, bar, baz")]);
    assert_eq!(notes("# a\n# u v w t\n1 2 3 4\n"), [note("x y z intensity", "u v w t")]);
    // Other comments name no columns, and names of positions are obeyed.
    for text in
        ["# foo bar\n1 2 3\n", "# foo bar baz\n# by hand\n1 2 3\n", "# x y z\n1 2 3\n", "1 2 3\n# foo bar baz\n"]
    {
        assert_eq!(notes(text), [""; 0], "{text}");
    }
    let named = LoadOptions { columns: Some("x,y,z".parse().unwrap()), ..LoadOptions::default() };
    let text = &b"# foo bar baz\n1 2 3\n"[..];
    assert_eq!(load_bytes(text, None, Path::new("a.txt"), &named).unwrap().notes, [""; 0]);
}

#[test]
fn few_rows_are_taken_by_their_number_of_columns() {
    for (text, expected) in [
        ("1 2 3 4\n", "x y z intensity"),
        ("1 2 3 4\n2 3 4 5\n3 4 5 6\n", "x y z intensity"),
        ("0 0 0 0\n1 0 0 1\n2 0 0 0\n3 0 0 1\n4 0 0 0\n", "x y z intensity"),
        ("1 2 3 0 0 1\n", "x y z nx ny nz"),
        ("1 2 3 255 0 0\n2 2 3 0 0 255\n", "x y z red green blue"),
        ("0 0.51 1.25 3.75 10 20 30\n1 0.5 1.5 3.25 20 20 20\n2 0.1 1.1 3.1 30 20 10\n", "index x y z red green blue"),
    ] {
        assert_eq!(names(&load("a.txt", text)), expected, "{text}");
    }
}

#[test]
fn positions_are_those_of_the_columns_whatever_is_before_them() {
    let rows = rows("index1 utm rgb255", 60, 7);
    let expected: Vec<DVec3> = rows.iter().map(|row| DVec3::new(row[1], row[2], row[3])).collect();
    let color = |cloud: &PointCloud, i: usize| cloud.colors.as_ref().unwrap()[i].map(f64::from);
    let level = |v: f64| surfel_math::srgb::decode(v / 255.0);
    let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
    for loaded in [load("a.txt", text(&rows, " ")), load("a.npy", array(&rows, "'<f8'"))] {
        let cloud = points(loaded);
        for (i, place) in places(&cloud).iter().enumerate() {
            assert!(place.distance(expected[i]) < 1e-6, "{place} {}", expected[i]);
            let found = color(&cloud, i);
            assert!((0..3).all(|k| near(found[k], level(rows[i][4 + k]))), "{found:?}");
        }
    }
    // A data frame saved with its index, and an R table with row names.
    let lines: String = rows.iter().map(|r| format!("{},{},{},{}\n", r[0] - 1.0, r[1], r[2], r[3])).collect();
    let quoted: String = rows.iter().map(|r| format!("\"{}\" {} {} {}\n", r[0], r[1], r[2], r[3])).collect();
    for (text, attributes) in [
        (format!(",x,y,z\n{lines}"), "position index"),
        (format!("\"\",\"x\",\"y\",\"z\"\n{lines}"), "position index"),
        (format!("Unnamed: 0,x,y,z\n{lines}"), "position Unnamed: 0"),
        (format!("\"x\" \"y\" \"z\"\n{quoted}"), "position index"),
    ] {
        let loaded = load("a.csv", text);
        assert_eq!(loaded.attributes.join(" "), attributes);
        assert!(places(&points(loaded)).iter().zip(&expected).all(|(a, b)| a.distance(*b) < 1e-6));
    }
}

#[test]
fn colours_that_rounding_puts_above_one_are_bright() {
    let mut rows = rows("local rgbfloat", 60, 3);
    rows[7][3] = 1.000_001;
    let cloud = points(load("a.txt", text(&rows, " ")));
    assert!(cloud.colors.unwrap()[7][0] > 0.99);
}

#[test]
fn columns_of_words_are_left_out() {
    for (text, note) in [
        ("name,x,y,z\nA0,1.5,2.5,3.5\nA1,2,3,4\nA2,3,4,5\n", "left out column 1 (name): it holds words, not numbers"),
        ("x,y,z,class\n1.5,2.5,3.5,tall tree\n2,3,4,tree\n3,4,5,\n", "left out column 4 (class): it holds words"),
        ("x;y;what;z\n1.5;2.5;\"a;b\";3.5\n2;3;\"\";4\n3;4;c;5\n", "left out column 3 (what): it holds words"),
        ("x\ty\tz\tdate\n1.5\t2.5\t3.5\t2024-05-01 10:00\n2\t3\t4\t2024-05-01 10:01\n3\t4\t5\tnever\n", "(date)"),
        ("x,y,z,none\n1.5,2.5,3.5,\n2,3,4,\n3,4,5,\n", "left out column 4 (none): it is mostly empty"),
        ("a,x,y,z,b\nq,1.5,2.5,3.5,w\ne,2,3,4,r\nt,3,4,5,y\n", "left out columns 1 (a), 5 (b): they hold words"),
        // Decimal commas, with semicolons as separators.
        ("wer;x;y;z\nBaum;1,5;2,5;3,5\nHaus;2;3;4\nBaum;3;4;5\n", "left out column 1 (wer): it holds words"),
        // Atoms: a count, an empty line, and elements.
        ("3\n\nC 1.5 2.5 3.5\nO 2 3 4\nH 3 4 5\n", "left out column 1: it holds words, not numbers"),
        // Rows that begin with a name, without a line of names.
        ("tree 1.5 2.5 3.5\nhouse 2 3 4\ntree 3 4 5\n", "left out column 1: it holds words, not numbers"),
    ] {
        let loaded = load("a.csv", text);
        assert!(loaded.notes.iter().any(|n| n.contains(note)), "{text}{:?}", loaded.notes);
        assert_eq!(loaded.attributes, ["position"], "{text}");
        let expected = [DVec3::new(1.5, 2.5, 3.5), DVec3::new(2.0, 3.0, 4.0), DVec3::new(3.0, 4.0, 5.0)];
        assert_eq!(places(&points(loaded)), expected, "{text}");
    }
    // A single word among numbers is damage, and a line of words isn't column names.
    refused("a.csv", "x,y,z\n1,2,3\n1,2,oak\n4,5,6\n", "found 'oak' (line 3)");
    refused("a.csv", "1,2,3,4\n1,2,3,oak\n4,5,6,7\n", "found 'oak' (line 2)");
    refused("a.csv", "one,two,three\n1,2,3\n4,5,6\n", "`columns=x,y,z,_,r,g,b` names the columns");
    refused("a.csv", "one,two\nA,B\n", "where points were expected");
    // A row with an empty cell is dropped, also the first one, without shifting columns.
    let loaded = load("a.csv", "x,y,z,intensity\n1,,3,4\n1,2,3,4\n5,6,7,NA\n2,3,4,5\n");
    assert!(loaded.notes.iter().any(|n| n.starts_with("left out 2 rows with an empty cell")), "{:?}", loaded.notes);
    assert_eq!(places(&points(loaded)), [DVec3::new(1.0, 2.0, 3.0), DVec3::new(2.0, 3.0, 4.0)]);
}

#[test]
fn lines_of_other_kinds_beside_lines_of_points_are_left_out() {
    let expected = [DVec3::new(1.5, 2.5, 3.5), DVec3::new(2.0, 3.0, 4.0), DVec3::new(3.0, 4.0, 5.0)];
    let note = |word, line| format!("left out 2 lines that don't begin with '{word}', the first in line {line}");
    for (text, note) in [
        ("p 1.5 2.5 3.5\np 2 3 4\np 3 4 5\nd 1 1 1\ns 1 1 1\n", note("p", 4)),
        ("d 1 1 1\np 1.5 2.5 3.5\np 2 3 4\ng 1 0 0\np 3 4 5\n", note("p", 1)),
        // Lines of other lengths, and a comma between cells.
        ("v,1.5,2.5,3.5\nf,1,2,3\nv,2,3,4\nv,3,4,5\nend\n", note("v", 2)),
        ("point 1.5 2.5 3.5\ncamera 0 0 0\npoint 2 3 4\npoint 3 4 5\ncamera 1 1 1\n", note("point", 2)),
    ] {
        let loaded = load("a.txt", text);
        assert!(loaded.notes.contains(&note), "{text}{:?}", loaded.notes);
        assert_eq!(places(&points(loaded)), expected, "{text}");
    }
    for word in ["p", "v", "pt", "pnt", "point", "vertex", "vtx"] {
        let text = format!("{word} 1.5 2.5 3.5\nother 1 1 1\n{word} 2 3 4\n{word} 3 4 5\n");
        assert_eq!(places(&points(load("a.txt", &text))), expected, "{text}");
    }
    // Words of a named column, elements, and other words say something about their point.
    for text in [
        "kind x y z\np 1.5 2.5 3.5\np 2 3 4\nq 3 4 5\n",
        "P 1.5 2.5 3.5\nP 2 3 4\nV 3 4 5\n",
        "oak 1.5 2.5 3.5\noak 2 3 4\nash 3 4 5\n",
    ] {
        assert_eq!(places(&points(load("a.txt", text))), expected, "{text}");
    }
}

#[test]
fn names_of_other_programs_are_known() {
    let row = "0.6,0,0.8,1.5,2.5,3.5,10,20,30\n";
    for header in [
        "\"Normals:0\",\"Normals:1\",\"Normals:2\",\"Points:0\",\"Points:1\",\"Points:2\",\"RGB:0\",\"RGB:1\",RGB:2",
        "Normals_0,Normals_1,Normals_2,Points_0,Points_1,Points_2,colors_0,colors_1,colors_2",
        "Normals:X,Normals:Y,Normals:Z,Points:X,Points:Y,Points:Z,Color:R,Color:G,Color:B",
        "Normals_X,Normals_Y,Normals_Z,Points_m_XYZ:0,Points_m_XYZ:1,Points_m_XYZ:2,r,g,b",
        "normal.x,normal.y,normal.z,position.x,position.y,position.z,color.r,color.g,color.b",
    ] {
        let loaded = load("a.csv", format!("{header}\n{row}"));
        assert_eq!(loaded.attributes.join(" "), "position normal colour", "{header}");
        let cloud = points(loaded);
        assert_eq!(places(&cloud), [DVec3::new(1.5, 2.5, 3.5)], "{header}");
        assert_eq!(cloud.normals.unwrap().get(0).as_vec3().to_array(), [0.6, 0.0, 0.8], "{header}");
    }
    let velodyne = "\"intensity\",\"laser_id\",\"azimuth\",\"distance_m\",\"adjustedtime\",\"timestamp\",\
                    \"vertical_angle\",\"Points_m_XYZ:0\",\"Points_m_XYZ:1\",\"Points_m_XYZ:2\"\n\
                    9,1,2,3,4,5,6,1.5,2.5,3.5\n";
    let loaded = load("a.csv", velodyne);
    assert_eq!(loaded.attributes[1..3], ["intensity", "laser_id"]);
    assert_eq!(places(&points(loaded)), [DVec3::new(1.5, 2.5, 3.5)]);
}

#[test]
fn arrays_named_means_are_positions() {
    let xyz = npy("'<f4'", "False", "(2, 3)", &le(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
    let colors = npy("'|u1'", "False", "(2, 3)", &[255, 128, 0, 0, 0, 255]);
    let views = npy("'<f4'", "False", "(1, 4, 4)", &le(&[0.0; 16]));
    for name in ["means", "means3d", "Means3D", "xyzs", "points3D"] {
        let file = zip(
            &[("viewmats.npy", views.clone()), (&format!("{name}.npy"), xyz.clone()), ("colors.npy", colors.clone())],
            false,
            b"",
        );
        let loaded = load("a.npz", file);
        assert_eq!(loaded.attributes.join(" "), "position colour", "{name}");
        assert_eq!(places(&points(loaded))[1], DVec3::new(4.0, 5.0, 6.0));
    }
}

fn shaped(shape: &str, values: impl Iterator<Item = f64>) -> Vec<u8> {
    npy("'<f4'", "False", shape, &values.flat_map(|v| (v as f32).to_le_bytes()).collect::<Vec<u8>>())
}

#[test]
fn arrays_that_are_no_table_are_refused() {
    let (height, width) = (48, 64);
    let depth = |i: usize| 2.0 + 0.01 * (i % width) as f64 + 0.3 * ((i / width) as f64 * 0.2).sin();
    refused("a.npy", shaped("(48, 64)", (0..height * width).map(depth)), "48×64 numbers, an image");
    refused("a.npy", shaped("(48, 64)", (0..48 * 64).map(|i| 1.0 + (i % 64) as f64 / 63.0)), "an image");
    refused("a.npy", shaped("(16, 12)", (0..192).map(|i| 2.0 + 0.01 * (i % 12 + i / 12) as f64)), "16×12");
    let mut random = Random(3);
    refused("a.npy", shaped("(40, 40)", (0..1600).map(|_| random.unit())), "an image");
    // Images: bytes, and bytes divided by 255.
    let bytes: Vec<u8> = (0..48 * 64 * 3).map(|i| (i * 31 % 251) as u8).collect();
    refused("a.npy", npy("'|u1'", "False", "(48, 64, 3)", &bytes), "48×64×3 numbers, an image");
    refused("a.npy", shaped("(48, 64, 3)", bytes.iter().map(|b| f64::from(*b) / 255.0)), "an image");
    refused("a.npy", npy("'|u1'", "False", "(36, 64, 4)", &bytes), "an image");
    // Poses, in both orders, and intrinsics.
    let pose = |i: usize| {
        let (s, c) = (i as f64 * 0.1).sin_cos();
        [c, -s, 0.0, 5.0 + i as f64, s, c, 0.0, 2.0, 0.0, 0.0, 1.0, 1.5, 0.0, 0.0, 0.0, 1.0]
    };
    let poses = || (0..30).flat_map(pose);
    refused("a.npy", shaped("(30, 4, 4)", poses()), "30×4×4 numbers, which are camera poses");
    refused("a.npy", shaped("(4, 4)", pose(3).into_iter()), "4×4 numbers, which are camera poses");
    refused("a.npy", shaped("(30, 3, 4)", (0..30).flat_map(|i| pose(i)[..12].to_vec())), "camera poses");
    refused("a.npy", shaped("(30, 12)", (0..30).flat_map(|i| pose(i)[..12].to_vec())), "camera poses");
    refused("a.npy", shaped("(30, 16)", poses()), "camera poses");
    let fortran: Vec<u8> = (0..16)
        .flat_map(|k| (0..30).map(move |i| pose(i)[k % 4 * 4 + k / 4]))
        .flat_map(|v| (v as f32).to_le_bytes())
        .collect();
    refused("a.npy", npy("'<f4'", "True", "(30, 4, 4)", &fortran), "camera poses");
    let text: String =
        (0..30).map(|i| pose(i)[..12].iter().map(|v| format!("{v:e} ")).collect::<String>() + "\n").collect();
    refused("a.txt", text, "as of camera poses");
    let intrinsics = [525.0, 0.0, 319.5, 0.0, 525.0, 239.5, 0.0, 0.0, 1.0];
    refused("a.npy", shaped("(3, 3)", intrinsics.into_iter()), "intrinsics");
    // Rows that are coordinates.
    for (shape, count) in [("(3, 100)", 300), ("(3, 20)", 60), ("(6, 50)", 300), ("(2, 3, 50)", 300), ("(3, 9)", 27)] {
        let mut random = Random(5);
        refused("a.npy", shaped(shape, (0..count).map(|_| random.unit() * 9.0 - 4.0)), "transpose it");
    }
    let named = zip(&[("points.npy", shaped("(3, 100)", (0..300).map(f64::from)))], false, b"");
    refused("a.npz", named, "transpose it");
    // Tables that resemble the cases above.
    let mut random = Random(7);
    let grid = (0..900).flat_map(|i| [(i % 30) as f64, (i / 30) as f64, random.unit()]);
    assert_eq!(points(load("a.npy", shaped("(30, 30, 3)", grid))).len(), 900);
    assert_eq!(
        points(load("a.npy", array(&rows("local rgb255 normal label flow flow flow flow", 90, 3), "'<f4'"))).len(),
        90
    );
    assert_eq!(points(load("a.npy", array(&rows("local rgb255", 3, 3), "'<f4'"))).len(), 3);
    assert_eq!(points(load("a.npy", array(&rows("local i1", 4, 3), "'<f4'"))).len(), 4);
}

fn try_named(name: &str, bytes: &[u8], columns: &str) -> Result<Loaded, String> {
    let options = LoadOptions { columns: Some(columns.parse().unwrap()), ..LoadOptions::default() };
    load_bytes(bytes, Format::from_extension(Path::new(name)), Path::new(name), &options)
        .map_err(|e| e.to_string())
        .inspect_err(|e| assert!(e.lines().count() <= 4, "{e}"))
}

fn named(name: &str, bytes: impl AsRef<[u8]>, columns: &str) -> Loaded {
    try_named(name, bytes.as_ref(), columns).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn columns_name_those_of_text_and_arrays() {
    let first = |loaded: Loaded| places(&points(loaded))[0];
    let rows = vec![vec![9.0, 3.0, 2.0, 1.0, 10.0, 20.0, 30.0, 7.0]; 2];
    for (name, bytes) in [
        ("a.txt", text(&rows, " ").into_bytes()),
        ("a.csv", text(&rows, ",").into_bytes()),
        ("a.csv", format!("some, words, of a header\n{}", text(&rows, ",")).into_bytes()),
        ("a.txt", format!("x y z r g b i j\n{}", text(&rows, " ")).into_bytes()),
        ("a", text(&rows, ";").into_bytes()),
        ("a.npy", array(&rows, "'<f8'")),
        ("a.npz", zip(&[("points.npy", array(&rows, "'<f4'"))], true, b"")),
        ("a.csv", text(&rows, ",").replace(",7\n", ",oak tree\n").into_bytes()),
    ] {
        let loaded = named(name, &bytes, "label,z,y,x,r,g,b,_");
        assert_eq!(loaded.attributes.join(" "), "position colour label", "{name}");
        assert_eq!(first(loaded), DVec3::new(1.0, 2.0, 3.0), "{name}");
    }
    let wrong = |name: &str, bytes: &[u8], columns: &str, says: &str| {
        let error = try_named(name, bytes, columns).map(|l| l.attributes).unwrap_err();
        assert!(error.contains(says), "{error}");
    };
    wrong("a.txt", text(&rows, " ").as_bytes(), "x,y,z", "has 8 columns and `columns` names 3 columns");
    wrong("a.npy", &array(&rows, "'<f8'"), "x,y,z,_", "has 8 columns and `columns` names 4 columns");
    wrong("a.txt", text(&rows, " ").as_bytes(), "a,b,c,d,e,f,g,h", "no position among the columns a b c");
    wrong("a.txt", text(&rows, " ").as_bytes(), "f4:x,y,z", "is text");
    wrong("a.npy", &array(&rows, "'<f8'"), "f4:x,y,z", "states the types");
    wrong("a.csv", b"1,2,3\n1,oak,3\n4,5,6\n", "x,y,z", "found 'oak' (line 2)");
    // Position columns only, and normals with radii, which make disks.
    let disks = named("a.txt", "1 2 3 0 0 1 0.5\n2 2 3 0 0 1 0.5\n", "x,y,z,nx,ny,nz,radius");
    assert!(matches!(disks.content, Content::Splats(_)));
}

#[test]
fn usual_rows_without_a_header_are_detected_by_their_values() {
    let rows = |count: usize, row: &dyn Fn(f32) -> Vec<f32>| -> Vec<u8> {
        (0..count).flat_map(|i| le(&row(i as f32))).collect()
    };
    let place = |i: f32| [10.0 * (0.1 * i).sin(), 10.0 * (0.13 * i).cos(), (0.2 * i).sin()];
    let kitti = |i: f32| [&place(i)[..], &[(0.37 * i).fract()]].concat();
    let nuscenes = |i: f32| [&place(i)[..], &[(i * 7.0) % 255.0, i % 32.0]].concat();
    let indoor = |i: f32| [&place(i)[..], &[i % 255.0, (i * 3.0) % 255.0, (i * 5.0) % 255.0]].concat();
    let load = |name: &str, bytes: &[u8]| {
        load_bytes(bytes, Format::from_extension(Path::new(name)), Path::new(name), &LoadOptions::default())
    };
    for (bytes, layout, attributes) in [
        (rows(500, &kitti), "f4:x,y,z,intensity", "position intensity"),
        (rows(500, &nuscenes), "f4:x,y,z,intensity,_", "position intensity"),
        (rows(500, &indoor), "f4:x,y,z,r,g,b", "position colour"),
    ] {
        let loaded = load("000000.bin", &bytes).unwrap();
        assert_eq!((loaded.format, loaded.attributes.join(" ")), (Format::Raw, attributes.to_owned()), "{layout}");
        let expected = named("000000.bin", &bytes, layout);
        assert_eq!(loaded.content, expected.content, "{layout}");
        assert!(loaded.notes[0].contains(layout) && expected.notes.iter().all(|note| !note.contains("no header")));
        // Another name, too few rows, and a cut row are refused.
        assert!(load("a.raw", &bytes).is_err() && load("a.bin", &bytes[..bytes.len() - 4]).is_err(), "{layout}");
    }
    let refused = |bytes: &[u8]| assert!(load("a.bin", bytes).unwrap_err().to_string().contains("`columns="));
    refused(&rows(99, &kitti));
    // Values that fit two layouts; a fourth column that is no intensity; a number that isn't finite.
    refused(&rows(500, &|i| vec![0.5 + 0.1 * (i % 3.0); 4 * 5 * 6]));
    refused(&rows(500, &|i| [&place(i)[..], &[-1.0 - i]].concat()));
    refused(&rows(500, &|i| [&place(i)[..], &[if i == 77.0 { f32::NAN } else { 0.5 }]].concat()));
    refused(&rows(500, &|i| vec![place(i)[0], place(i)[1], 0.0, 0.5]));
}

#[test]
fn columns_with_types_read_files_without_a_header() {
    let kitti = le(&[1.0, 2.0, 3.0, 0.5, 4.0, 5.0, 6.0, 0.25]);
    refused("000000.bin", &kitti, "`columns=f4:x,y,z,intensity`");
    // A first byte that is a brace, as in a JSON file.
    refused("000001.bin", le(&[f32::from_le_bytes(*b"{FXB"), 2.0, 3.0, 0.5]), "`columns=f4:x,y,z,intensity`");
    let loaded = named("000000.bin", &kitti, "f4:x,y,z,intensity");
    assert_eq!((loaded.format, loaded.attributes.join(" ")), (Format::Raw, "position intensity".to_owned()));
    assert_eq!(places(&points(loaded)), [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)]);
    // nuScenes, without the last column; big-endian; several types.
    let nuscenes = le(&[1.0, 2.0, 3.0, 50.0, 7.0]);
    assert_eq!(named("a.pcd.bin", &nuscenes, "f4:x,y,z,intensity,_").attributes, ["position", "intensity"]);
    let big: Vec<u8> = [1.0_f64, 2.0, 3.0].iter().flat_map(|v| v.to_be_bytes()).collect();
    assert_eq!(places(&points(named("a.raw", &big, ">f8:x,y,z"))), [DVec3::new(1.0, 2.0, 3.0)]);
    let mixed =
        [&le(&[1.0, 2.0, 3.0])[..], &[255, 128, 0, 9], &300_i16.to_le_bytes(), &70_000_u32.to_le_bytes()].concat();
    let cloud = points(named("a", &mixed, "f4:x,y,z,u1:r,g,b,_,i2:label,u4:id"));
    assert_eq!(cloud.colors.as_ref().unwrap()[0][0], 1.0);
    assert_eq!((cloud.extras[0].values.get(0), cloud.extras[1].values.get(0)), (300.0, 70_000.0));
    let wrong = |bytes: &[u8], columns: &str, says: &str| {
        let error = try_named("a.bin", bytes, columns).map(|l| l.attributes).unwrap_err();
        assert!(error.contains(says), "{error}");
    };
    wrong(&kitti[..31], "f4:x,y,z,intensity", "has 31 bytes, which are no whole rows of 16");
    wrong(&kitti, "f4:x,y,z,intensity,_", "no whole rows of 20");
    wrong(&kitti, "f4:a,b,c,d", "no position");
    // Bytes of other types give implausible coordinates.
    let bytes: Vec<u8> = (0..1200_u32).flat_map(|i| i.wrapping_mul(777_733_331).to_le_bytes()).collect();
    wrong(&bytes, "f8:x,y,z", "don't hold f8:x,y,z");
}

/// A COLMAP point: identifier, position, colour, error, track.
type Point3D = (u64, [f64; 3], [u8; 3], f64, Vec<[u32; 2]>);

fn colmap_points(tracks: impl Fn(usize) -> usize) -> Vec<Point3D> {
    let mut random = Random(11);
    let point = |i: usize| {
        let at = [0; 3].map(|_| (random.unit() * 8.0 - 4.0) as f32).map(f64::from);
        let color = color(&mut random).map(|c| c as u8);
        let track = (0..tracks(i)).map(|k| [k as u32, i as u32]).collect();
        ((100 + 7 * (i * 31 % 60)) as u64, at, color, 0.25 + i as f64 / 64.0, track)
    };
    (0..60).map(point).collect()
}

fn colmap_text(points: &[Point3D]) -> String {
    let line = |(id, [x, y, z], [r, g, b], error, track): &Point3D| {
        let track: String = track.iter().map(|[image, point]| format!(" {image} {point}")).collect();
        format!("{id} {x} {y} {z} {r} {g} {b} {error}{track}\n")
    };
    points.iter().map(line).collect()
}

fn colmap_binary(points: &[Point3D]) -> Vec<u8> {
    let mut bytes = (points.len() as u64).to_le_bytes().to_vec();
    for (id, at, color, error, track) in points {
        bytes.extend(id.to_le_bytes());
        at.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.extend(color);
        bytes.extend(error.to_le_bytes());
        bytes.extend((track.len() as u64).to_le_bytes());
        track.as_flattened().iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    bytes
}

#[test]
fn points_of_colmap_are_read_with_their_errors_and_tracks() {
    let comment = "# 3D point list with one line of data per point:\n#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, \
                   TRACK[] as (IMAGE_ID, POINT2D_IDX)\n# Number of points: 60\n";
    type Length = fn(usize) -> usize;
    let lengths: [Length; 3] = [|_| 2, |i| 2 + i % 5, |_| 0];
    for (k, length) in lengths.into_iter().enumerate() {
        let all = colmap_points(length);
        let (text, binary) = (colmap_text(&all), colmap_binary(&all));
        let mut files = vec![
            ("points3D.txt", format!("{comment}{text}").into_bytes()),
            ("renamed.txt", format!("{comment}{text}").into_bytes()),
            ("points3D.txt", text.clone().into_bytes()),
            ("points3D.bin", binary.clone()),
            ("renamed.bin", binary),
        ];
        if k == 1 {
            files.push(("renamed.txt", text.into_bytes()));
        }
        for (name, bytes) in files {
            let loaded = load(name, &bytes);
            assert_eq!(loaded.format, Format::Colmap, "{name}");
            assert_eq!(loaded.attributes.join(" "), "position colour error track_length", "{name}");
            let cloud = points(loaded);
            for (i, place) in places(&cloud).iter().enumerate() {
                let (_, at, color, error, track) = &all[i];
                assert_eq!(place.to_array(), *at, "{name}");
                let level = |v: f32| surfel_math::srgb::encode(f64::from(v)) * 255.0;
                let found = cloud.colors.as_ref().unwrap()[i].map(level);
                assert!((0..3).all(|c| (found[c] - f64::from(color[c])).abs() < 0.01), "{found:?}");
                let values = [cloud.extras[0].values.get(i), cloud.extras[1].values.get(i)];
                assert_eq!(values, [*error, track.len() as f64], "{name}");
            }
            if k == 1 {
                same_by_levels(name, &bytes, ("error", 1e-8), None).unwrap();
            }
        }
    }
}

#[test]
fn damaged_points_of_colmap_are_refused() {
    let all = colmap_points(|i| i % 4);
    let whole = colmap_binary(&all);
    for end in (1..whole.len()).step_by(7) {
        assert!(crate::point_formats::try_load("points3D.bin", &whole[..end]).is_err(), "{end}");
    }
    // Impossible counts, of points and of a track.
    for at in [0, 8 + 43] {
        let mut bytes = whole.clone();
        bytes[at..at + 8].copy_from_slice(&u64::MAX.to_le_bytes());
        assert!(crate::point_formats::try_load("points3D.bin", &bytes).is_err(), "{at}");
    }
    refused("points3D.txt", "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n1 2 3 4 5 6 7 0.5 1\n", "found 9 numbers");
    refused("points3D.txt", "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n", "no point");
}

#[test]
fn tables_have_the_same_columns_whatever_fits_into_memory() {
    let rows = rows("index1 local rgb255 label", 600, 13);
    let words: String = rows.iter().map(|r| format!("A{},{},{},{},{}\n", r[0], r[1], r[2], r[3], r[0])).collect();
    for (name, bytes, key) in [
        ("a.txt", text(&rows, " ").into_bytes(), "index"),
        ("a.csv", format!("name,x,y,z,number\n{words}").into_bytes(), "number"),
        ("a.npy", array(&rows, "'<f4'"), "index"),
    ] {
        let (all, levels, notes) = same_by_levels(name, &bytes, (key, 1e-8), None).unwrap();
        assert!(!all.points.extras.is_empty(), "{name}");
        assert_eq!(all.points.colors.is_some(), levels.points.colors.is_some(), "{name}");
        assert!(
            notes.iter().any(|note| note.contains("left out column 1") || note.contains("counts the rows")),
            "{notes:?}"
        );
    }
}
