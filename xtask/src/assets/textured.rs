//! Painted squares, which show how splats sample textures (Z01, figure 6). The colours are stored in the vertices.

use std::fmt::Write as _;

/// Number of vertices along a side of the square of [`photograph`].
const PHOTOGRAPH: usize = 161;

/// Returns an OBJ file of the square from −1 to 1, divided into `count`×`count` black and white squares.
pub(super) fn checkerboard(count: usize) -> Vec<u8> {
    let mut text = String::new();
    for i in 0..count * count {
        let (column, row) = (i % count, i / count);
        let color = (column + row) % 2;
        for (dx, dy) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
            let at = |k: usize| 2.0 * k as f64 / count as f64 - 1.0;
            let _ = writeln!(text, "v {:.6} {:.6} 0 {color} {color} {color}", at(column + dx), at(row + dy));
        }
    }
    for i in 0..count * count {
        let _ = writeln!(text, "f {} {} {} {}", 4 * i + 1, 4 * i + 2, 4 * i + 3, 4 * i + 4);
    }
    text.into_bytes()
}

/// Returns an OBJ file of the square from −1 to 1 with soft shapes of many sizes. Their contrast decreases with their
/// size, as in photographs.
pub(super) fn photograph() -> Vec<u8> {
    let mut text = String::new();
    let at = |k: usize| k as f64 / (PHOTOGRAPH - 1) as f64;
    for (u, v) in (0..PHOTOGRAPH * PHOTOGRAPH).map(|i| (at(i % PHOTOGRAPH), at(i / PHOTOGRAPH))) {
        let channel = |phase: f64| {
            let wave = |i: i32| {
                let (sin, cos) = (2.4 * f64::from(i)).sin_cos();
                let frequency = 5.0 * 1.5f64.powi(i);
                (frequency * (u * sin + v * cos) + phase + f64::from(i)).sin() * 0.72f64.powi(i)
            };
            (0.5 + 0.19 * (0..8).map(wave).sum::<f64>()).clamp(0.0, 1.0)
        };
        let (x, y) = (2.0 * u - 1.0, 2.0 * v - 1.0);
        let _ = writeln!(text, "v {x:.5} {y:.5} 0 {:.4} {:.4} {:.4}", channel(0.0), channel(0.9), channel(1.7));
    }
    for (column, row) in (0..(PHOTOGRAPH - 1).pow(2)).map(|i| (i % (PHOTOGRAPH - 1), i / (PHOTOGRAPH - 1))) {
        let a = row * PHOTOGRAPH + column + 1;
        let _ = writeln!(text, "f {a} {} {} {}", a + 1, a + 1 + PHOTOGRAPH, a + PHOTOGRAPH);
    }
    text.into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_are_whole() {
        let lines = |bytes: Vec<u8>, kind: &str| {
            String::from_utf8(bytes).unwrap().lines().filter(|line| line.starts_with(kind)).count()
        };
        assert_eq!([lines(checkerboard(12), "v "), lines(checkerboard(12), "f ")], [576, 144]);
        assert_eq!([lines(photograph(), "v "), lines(photograph(), "f ")], [161 * 161, 160 * 160]);
        assert!(String::from_utf8(checkerboard(2)).unwrap().starts_with("v -1.000000 -1.000000 0 0 0 0\n"));
    }
}
