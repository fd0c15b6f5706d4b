//! Shapes of points: in one place, in a line, in a plane, in clusters, and in tables of unusual proportions.

use super::Shape;
use super::documents::words;
use std::fmt::Write;
use std::io;
use std::path::Path;

/// Returns a pseudo-random number in [0, 1) for each `i` and `salt` (SplitMix64).
pub(super) fn random(i: usize, salt: u64) -> f64 {
    let mut z =
        (i as u64).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ salt.wrapping_mul(0xD1B5_4A32_D192_ED03);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

fn random_point(i: usize) -> [f64; 3] {
    [1, 2, 3].map(|salt| random(i, salt))
}

/// Writes a binary PLY file of `n` points; `place` returns their positions.
fn write_points(path: &Path, n: usize, place: impl Fn(usize) -> [f64; 3]) -> io::Result<()> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {n}\nproperty double x\nproperty double y\n\
         property double z\nend_header\n"
    )
    .into_bytes();
    bytes.extend((0..n).flat_map(|i| place(i).map(f64::to_le_bytes)).flatten());
    std::fs::write(path, bytes)
}

type Command = fn(&Path, usize) -> io::Result<Vec<String>>;

/// Returns a function that writes points and returns the words of `command`.
fn with(
    command: &'static str,
    place: impl Fn(usize, usize) -> [f64; 3] + 'static,
) -> impl Fn(&Path, usize) -> io::Result<Vec<String>> {
    move |folder, n| {
        write_points(&folder.join("in.ply"), n, |i| place(i, n))?;
        Ok(words(command))
    }
}

const TO_SPLATS: &str = "convert in.ply -o out.ply --force";
const TO_ALL: &str = "convert in.ply -o out.ply --force --all-points";
const TO_LEVELS: &str = "convert in.ply -o out.copc.laz --force";
const SHARP: &str = "convert in.ply -o out.ply --force --sharp";
const ORTHO: &str = "ortho in.ply -o out.tif --force --gsd 0.01";
const RENDER: &str = "render in.ply -o out.png --force --size 64x64";

fn one_place(_: usize, _: usize) -> [f64; 3] {
    [1.0, 2.0, 3.0]
}

fn few_places(i: usize, _: usize) -> [f64; 3] {
    [(i % 10) as f64, (i / 10 % 10) as f64, 0.0]
}

fn line(i: usize, n: usize) -> [f64; 3] {
    [i as f64 / n as f64, 0.0, 0.0]
}

fn grid(i: usize, n: usize) -> [f64; 3] {
    let side = (n as f64).sqrt().ceil() as usize;
    [(i % side) as f64, (i / side) as f64, 0.0]
}

fn spiral(i: usize, n: usize) -> [f64; 3] {
    let turn = 2.399_963_229_728_653 * i as f64;
    let radius = (i as f64 / n as f64).sqrt();
    [radius * turn.cos(), radius * turn.sin(), 0.0]
}

/// Returns a point of a coil with a hundred turns.
fn coil(i: usize, n: usize) -> [f64; 3] {
    let turn = 200.0 * std::f64::consts::PI * i as f64 / n as f64;
    [turn.cos(), turn.sin(), 0.01 * turn]
}

fn ball_in_a_field(i: usize, _: usize) -> [f64; 3] {
    let [x, y, z] = random_point(i);
    if i.is_multiple_of(10) { [1e4 * x, 1e4 * y, z] } else { [5e3 + x, 5e3 + y, z] }
}

/// Returns a point of a cloud that becomes denser toward the origin without limit.
fn powers(i: usize, n: usize) -> [f64; 3] {
    let [x, y, z] = random_point(i);
    [x, y, z].map(|c| (c - 0.5) * (-40.0 * i as f64 / n as f64).exp2())
}

fn two_clusters(i: usize, _: usize) -> [f64; 3] {
    let [x, y, z] = random_point(i);
    [x + 1e6 * (i % 2) as f64, y, 0.01 * z]
}

fn volume(i: usize, _: usize) -> [f64; 3] {
    random_point(i)
}

/// Returns a point of a circle, or its centre, which is equally near to all others.
fn circle(i: usize, n: usize) -> [f64; 3] {
    let turn = std::f64::consts::TAU * i as f64 / n as f64;
    if i == 0 { [0.0; 3] } else { [turn.cos(), turn.sin(), 0.0] }
}

/// Returns a point of a sphere, or its centre.
fn sphere(i: usize, n: usize) -> [f64; 3] {
    let (z, turn) = (2.0 * i as f64 / n as f64 - 1.0, 2.399_963_229_728_653 * i as f64);
    let radius = (1.0 - z * z).sqrt();
    if i == 0 { [0.0; 3] } else { [radius * turn.cos(), radius * turn.sin(), z] }
}

/// Writes a table of `n` rows and 60 columns, with a header line.
fn long_columns(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let mut text = String::from("x y z");
    (0..57).for_each(|k| _ = write!(text, " c{k}"));
    for i in 0..n {
        let [x, y, z] = random_point(i);
        let _ = write!(text, "\n{x:.4} {y:.4} {z:.4}");
        (0..57).for_each(|k| _ = write!(text, " {}", (i * k) % 997));
    }
    std::fs::write(folder.join("in.txt"), text)?;
    Ok(words("convert in.txt -o out.ply --force"))
}

/// Writes a table of ten rows and `n` columns, with or without a header line.
fn wide(folder: &Path, n: usize, is_named: bool) -> io::Result<Vec<String>> {
    let mut text = String::new();
    if is_named {
        text.push_str("x,y,z");
        (3..n).for_each(|k| _ = write!(text, ",c{k}"));
        text.push('\n');
    }
    for i in 0..10 {
        let row: Vec<String> = (0..n).map(|k| format!("{:.3}", random(i * n + k, 5))).collect();
        text += &row.join(",");
        text.push('\n');
    }
    std::fs::write(folder.join("in.csv"), text)?;
    Ok(words("info in.csv --json"))
}

/// Writes a table of points after `n` lines of comments.
fn comments(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let mut text = String::new();
    (0..n).for_each(|i| _ = writeln!(text, "# line {i} of a long preamble"));
    (0..100).for_each(|i| _ = writeln!(text, "{i} {} 0", i % 10));
    std::fs::write(folder.join("in.xyz"), text)?;
    Ok(words("info in.xyz --json"))
}

/// Writes `n` scans of 2×2 points, each with its own pose.
fn ptx_scans(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let mut text = String::new();
    for i in 0..n {
        let _ = write!(text, "2\n2\n{i} 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{i} 0 0 1\n");
        (0..4).for_each(|k| _ = writeln!(text, "{} {} {} 0.5", k % 2, k / 2, 0.1 * f64::from(k)));
    }
    std::fs::write(folder.join("in.ptx"), text)?;
    Ok(words("info in.ptx --json"))
}

/// Writes a PCD file of ten points with `n` fields.
fn pcd_fields(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    let repeated = |word: &str| vec![word; n].join(" ");
    let names: Vec<String> = (3..n).map(|k| format!("f{k}")).collect();
    let mut text = format!(
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z {}\nSIZE {}\nTYPE {}\nCOUNT {}\nWIDTH 10\nHEIGHT 1\n\
         VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 10\nDATA ascii\n",
        names.join(" "),
        repeated("4"),
        repeated("F"),
        repeated("1")
    );
    for i in 0..10 {
        let row: Vec<String> = (0..n).map(|k| format!("{:.3}", random(i * n + k, 6))).collect();
        text += &row.join(" ");
        text.push('\n');
    }
    std::fs::write(folder.join("in.pcd"), text)?;
    Ok(words("info in.pcd --json"))
}

/// Writes points, and returns a command with a condition of `n` comparisons.
fn conditions(folder: &Path, n: usize) -> io::Result<Vec<String>> {
    write_points(&folder.join("in.ply"), 1000, |i| [i as f64, 0.0, 0.0])?;
    let terms: Vec<String> = (0..n).map(|i| format!("x<{i}")).collect();
    let mut command = words("convert in.ply -o out.ply --force --where");
    command.push(terms.join(" or "));
    Ok(command)
}

pub(super) fn shapes() -> Vec<Shape> {
    let points = |n: usize| (n, "points");
    let tables: [(&str, usize, &str, Command); 7] = [
        ("long text columns", 2000, "rows", long_columns),
        ("CSV of many named columns", 10_000, "columns", |folder, n| wide(folder, n, true)),
        ("CSV of many columns without names", 10_000, "columns", |folder, n| wide(folder, n, false)),
        ("text of many comments", 100_000, "lines", comments),
        ("PTX of many scans", 4000, "scans", ptx_scans),
        ("PCD of many fields", 5000, "fields", pcd_fields),
        ("condition of many comparisons", 500, "comparisons", conditions),
    ];
    let mut all = vec![
        Shape::new("points in one place", points(40_000), with(TO_SPLATS, one_place)),
        Shape::new("points in one place, all kept", points(10_000), with(TO_ALL, one_place)),
        Shape::new("points in one place, to levels", points(40_000), with(TO_LEVELS, one_place)),
        Shape::new("points in a hundred places, all kept", points(10_000), with(TO_ALL, few_places)),
        Shape::new("points in a line", points(10_000), with(TO_SPLATS, line)),
        Shape::new("points of a coplanar grid", points(10_000), with(TO_SPLATS, grid)),
        Shape::new("points of a coplanar grid, sharp", points(4000), with(SHARP, grid)),
        Shape::new("points of a coplanar grid, to levels", points(40_000), with(TO_LEVELS, grid)),
        Shape::new("points of a spiral", points(10_000), with(TO_SPLATS, spiral)),
        // With fewer points, the turns of the coil aren't lines.
        Shape::new("points of a coil", points(80_000), with(TO_SPLATS, coil)),
        Shape::new("dense ball in a sparse field", points(10_000), with(TO_SPLATS, ball_in_a_field)),
        Shape::new("dense ball in a sparse field, drawn", points(10_000), with(RENDER, ball_in_a_field)),
        Shape::new("dense ball in a sparse field, to levels", points(40_000), with(TO_LEVELS, ball_in_a_field)),
        Shape::new("points nearing the origin", points(10_000), with(TO_SPLATS, powers)),
        Shape::new("points nearing the origin, to levels", points(40_000), with(TO_LEVELS, powers)),
        Shape::new("two far clusters", points(10_000), with(TO_SPLATS, two_clusters)),
        Shape::new("points in a volume", points(10_000), with(TO_SPLATS, volume)),
        Shape::new("points of a circle about one", points(10_000), with(TO_SPLATS, circle)),
        Shape::new("points of a sphere about one", points(10_000), with(TO_SPLATS, sphere)),
        Shape::new(
            "points of an ortho image",
            points(20_000),
            with(ORTHO, |i, n| {
                let [x, y, z] = random_point(i);
                let side = (n as f64 / 1e4).sqrt();
                [side * x, side * y, 0.1 * z]
            }),
        ),
    ];
    // The program refuses tables with more than 128 columns.
    all.extend(tables.map(|(name, n, counts, make)| {
        let shape = Shape::new(name, (n, counts), make);
        if name.starts_with("CSV of many") { shape.refused() } else { shape }
    }));
    all
}
