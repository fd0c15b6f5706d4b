//! A chair and a table as completion papers show them: the whole shape, its visible part, and two completions of that
//! part, with 2,048 points or fewer each.

use super::scan::SplitMix;
use std::fmt::Write as _;

const POINTS: usize = 2048;
/// Files of a shape: what the name ends in, and the noise of points that the visible part lacks and of those it has.
const FILES: [(&str, f64, f64); 4] =
    [("truth", 0.0, 0.0), ("partial", 0.0, 0.0), ("coarse", 0.022, 0.008), ("fine", 0.007, 0.003)];

type Point = [f64; 3];

/// An axis-aligned box: centre and size; z is up.
struct Part(Point, Point);

fn chair() -> Vec<Part> {
    let legs = [-0.22, 0.22].into_iter().flat_map(|x| [-0.22, 0.22].map(|y| Part([x, y, 0.21], [0.05, 0.05, 0.42])));
    let seat = [Part([0.0, 0.0, 0.45], [0.5, 0.5, 0.06]), Part([0.0, -0.22, 0.8], [0.5, 0.06, 0.65])];
    seat.into_iter().chain(legs).collect()
}

fn table() -> Vec<Part> {
    let legs = [-0.44, 0.44].into_iter().flat_map(|x| [-0.3, 0.3].map(|y| Part([x, y, 0.24], [0.06, 0.06, 0.48])));
    std::iter::once(Part([0.0, 0.0, 0.5], [1.0, 0.7, 0.05])).chain(legs).collect()
}

/// Returns the files of both shapes: names and points, a line each.
pub(super) fn files() -> Vec<(String, Vec<u8>)> {
    let shapes = [("chair", chair()), ("table", table())];
    let files = shapes.iter().enumerate().flat_map(|(s, (name, parts))| {
        FILES.iter().enumerate().map(move |(f, file)| {
            let mut random = SplitMix(1000 + 10 * s as u64 + f as u64);
            (format!("{name}-{}.xyz", file.0), points(parts, file, &mut random).into_bytes())
        })
    });
    files.collect()
}

/// True for a point of the part that a scanner sees.
fn is_seen([x, y, _]: Point) -> bool {
    x + 0.5 * y < 0.05
}

fn points(parts: &[Part], (name, far, near): &(&str, f64, f64), random: &mut SplitMix) -> String {
    let faces = |Part(_, [x, y, z]): &Part| [y * z, x * z, x * y];
    let total: f64 = parts.iter().flat_map(faces).sum();
    let mut text = String::new();
    for _ in 0..POINTS {
        // A face by its area, and a place on one of its two sides.
        let mut left = random.unit() * total;
        let of_part = |part| faces(part).into_iter().enumerate().map(move |(k, area)| (part, k, area));
        let all = parts.iter().flat_map(of_part);
        let found = all.into_iter().find(|(_, _, area)| {
            left -= area;
            left < 0.0
        });
        let Some((Part(center, size), axis, _)) = found else { continue };
        let mut p = [0, 1, 2].map(|k| center[k] + (random.unit() - 0.5) * size[k]);
        p[axis] = center[axis] + if random.unit() < 0.5 { -0.5 } else { 0.5 } * size[axis];
        if *name == "partial" && !is_seen(p) {
            continue;
        }
        let noise = if is_seen(p) { near } else { far };
        let [x, y, z] = p.map(|c| c + noise * (random.unit() + random.unit() + random.unit() - 1.5) * 2.0);
        // Writing to a string can't fail.
        let _ = writeln!(text, "{x:.5} {y:.5} {z:.5}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_whole_or_seen_from_one_side() {
        let files = files();
        assert_eq!(files.len(), 8);
        for (name, bytes) in &files {
            let text = std::str::from_utf8(bytes).unwrap();
            let count = text.lines().count();
            let is_partial = name.contains("partial");
            assert_eq!(count == POINTS, !is_partial, "{name}: {count}");
            assert!(count > 600, "{name}: {count}");
        }
    }
}
