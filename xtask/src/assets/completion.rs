//! Point sets of a chair, a table and a shelf, as in papers on shape completion. Each shape has the whole shape, its
//! visible part, and four completions of that part, with at most 2,048 points each.

use super::scan::SplitMix;
use std::fmt::Write as _;

/// Number of points of a whole shape.
const POINTS: usize = 2048;

/// Description of a file of a shape.
struct File {
    /// Suffix of the file's name.
    name: &'static str,
    /// Standard deviation of the noise along each axis, in units of the shape, for points that aren't in the visible
    /// part.
    far: f64,
    /// Standard deviation of the noise along each axis, in units of the shape, for points in the visible part.
    near: f64,
    /// Side of a grid of cells. Points that aren't in the visible part are moved to the centres of their cells before
    /// noise is added; 0 for no grid.
    cell: f64,
    /// True if each point has the label of its part.
    has_labels: bool,
}

/// File of a whole shape without noise, from which the other files differ.
const EXACT: File = File { name: "truth.xyz", far: 0.0, near: 0.0, cell: 0.0, has_labels: false };

/// Files of each shape: the whole shape, its visible part, four completions, and the whole shape with labels.
const FILES: [File; 7] = [
    EXACT,
    File { name: "partial.xyz", ..EXACT },
    File { name: "coarse.xyz", far: 0.022, near: 0.008, ..EXACT },
    File { name: "fine.xyz", far: 0.007, near: 0.003, ..EXACT },
    File { name: "voxels.xyz", far: 0.006, near: 0.002, cell: 0.05, ..EXACT },
    File { name: "loose.xyz", far: 0.014, near: 0.014, ..EXACT },
    File { name: "parts.csv", has_labels: true, ..EXACT },
];

type Point = [f64; 3];

/// Axis-aligned box as a part of a shape: centre, size and label; z is up.
struct Part(Point, Point, u8);

/// Label of seats, table tops and boards; assets/gallery/parts.txt has the names of labels.
const SEAT: u8 = 1;
/// Label of backs and of the sides of the shelf.
const BACK: u8 = 2;
/// Label of legs.
const LEG: u8 = 3;

fn chair() -> Vec<Part> {
    let legs =
        [-0.22, 0.22].into_iter().flat_map(|x| [-0.22, 0.22].map(|y| Part([x, y, 0.21], [0.05, 0.05, 0.42], LEG)));
    let seat = [Part([0.0, 0.0, 0.45], [0.5, 0.5, 0.06], SEAT), Part([0.0, -0.22, 0.8], [0.5, 0.06, 0.65], BACK)];
    seat.into_iter().chain(legs).collect()
}

fn table() -> Vec<Part> {
    let legs = [-0.44, 0.44].into_iter().flat_map(|x| [-0.3, 0.3].map(|y| Part([x, y, 0.24], [0.06, 0.06, 0.48], LEG)));
    std::iter::once(Part([0.0, 0.0, 0.5], [1.0, 0.7, 0.05], SEAT)).chain(legs).collect()
}

fn shelf() -> Vec<Part> {
    let sides = [-0.3, 0.3].into_iter().map(|x| Part([x, 0.0, 0.5], [0.04, 0.28, 1.0], BACK));
    let boards = [0.04, 0.35, 0.66, 0.97].into_iter().map(|z| Part([0.0, 0.0, z], [0.56, 0.28, 0.04], SEAT));
    sides.chain(boards).collect()
}

/// Returns the names and contents of all files. A line of a file is a point.
pub(super) fn files() -> Vec<(String, Vec<u8>)> {
    let shapes = [("chair", chair()), ("table", table()), ("shelf", shelf())];
    let files = shapes.iter().enumerate().flat_map(|(s, (name, parts))| {
        FILES.iter().enumerate().map(move |(f, file)| {
            let mut random = SplitMix(1000 + 10 * s as u64 + f as u64);
            (format!("{name}-{}", file.name), points(parts, file, &mut random).into_bytes())
        })
    });
    files.collect()
}

/// True for a point that the simulated scanner sees.
fn is_seen([x, y, _]: Point) -> bool {
    x + 0.5 * y < 0.05
}

fn points(parts: &[Part], file: &File, random: &mut SplitMix) -> String {
    let faces = |Part(_, [x, y, z], _): &Part| [y * z, x * z, x * y];
    let total: f64 = parts.iter().flat_map(faces).sum();
    let mut text = if file.has_labels { "x,y,z,part\n".to_owned() } else { String::new() };
    for _ in 0..POINTS {
        // The face is random, weighted by area; so are the position on it and its side.
        let mut left = random.unit() * total;
        let of_part = |part| faces(part).into_iter().enumerate().map(move |(k, area)| (part, k, area));
        let all = parts.iter().flat_map(of_part);
        let found = all.into_iter().find(|(_, _, area)| {
            left -= area;
            left < 0.0
        });
        let Some((Part(center, size, label), axis, _)) = found else { continue };
        let mut p = [0, 1, 2].map(|k| center[k] + (random.unit() - 0.5) * size[k]);
        p[axis] = center[axis] + if random.unit() < 0.5 { -0.5 } else { 0.5 } * size[axis];
        if file.name == "partial.xyz" && !is_seen(p) {
            continue;
        }
        if file.cell > 0.0 && !is_seen(p) {
            p = p.map(|c| ((c / file.cell).floor() + 0.5) * file.cell);
        }
        let noise = if is_seen(p) { file.near } else { file.far };
        let [x, y, z] = p.map(|c| c + noise * (random.unit() + random.unit() + random.unit() - 1.5) * 2.0);
        // Writing to a string can't fail.
        let _ = match file.has_labels {
            true => writeln!(text, "{x:.5},{y:.5},{z:.5},{label}"),
            false => writeln!(text, "{x:.5} {y:.5} {z:.5}"),
        };
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_whole_or_seen_from_one_side() {
        let files = files();
        assert_eq!(files.len(), 21);
        for (name, bytes) in &files {
            let text = std::str::from_utf8(bytes).unwrap();
            let count = text.lines().count();
            let is_partial = name.contains("partial");
            let count = count - usize::from(name.ends_with(".csv"));
            assert_eq!(count == POINTS, !is_partial, "{name}: {count}");
            assert!(count > 600, "{name}: {count}");
        }
    }
}
