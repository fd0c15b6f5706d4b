//! Simulated scan of Spot: points without colours or normals, with noise in their positions.

use super::halves::{MODEL, Model};
use std::fmt::Write as _;
use std::io;
use std::path::Path;

/// Number of points of the scan.
const POINTS: f64 = 120_000.0;
/// Largest displacement of a point by noise along each axis, in the units of the model.
const NOISE: f64 = 0.003;

/// Returns the points as text, one per line.
pub(super) fn scan(root: &Path) -> io::Result<Vec<u8>> {
    let text = std::fs::read_to_string(root.join(MODEL))?;
    Ok(points(&Model::read(&text), POINTS).into_bytes())
}

fn points(model: &Model, count: f64) -> String {
    let fans = model.faces.iter().filter(|face| face.len() >= 3);
    let corners = |i: usize| model.positions[i];
    let triangles: Vec<[[f64; 3]; 3]> =
        fans.flat_map(|face| (2..face.len()).map(|k| [face[0][0], face[k - 1][0], face[k][0]].map(corners))).collect();
    let areas: Vec<f64> = triangles.iter().map(area).collect();
    let total: f64 = areas.iter().sum();
    let mut random = SplitMix(2009);
    let (mut text, mut owed) = (String::new(), 0.0);
    for ([a, b, c], area) in triangles.iter().zip(&areas) {
        owed += area / total * count;
        while owed >= 1.0 {
            owed -= 1.0;
            let (s, t) = (random.unit().sqrt(), random.unit());
            let weights = [1.0 - s, s * (1.0 - t), s * t];
            let [x, y, z] = std::array::from_fn(|k| {
                a[k] * weights[0] + b[k] * weights[1] + c[k] * weights[2] + NOISE * (2.0 * random.unit() - 1.0)
            });
            // Writing to a string can't fail.
            let _ = writeln!(text, "{x:.5} {y:.5} {z:.5}");
        }
    }
    text
}

fn area([a, b, c]: &[[f64; 3]; 3]) -> f64 {
    let [u, v] = [b, c].map(|p| [0, 1, 2].map(|k| p[k] - a[k]));
    let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    0.5 * cross.iter().map(|c| c * c).sum::<f64>().sqrt()
}

/// Generator of pseudo-random numbers (Steele, Lea and Flood 2014, "Fast splittable pseudorandom number generators").
pub(super) struct SplitMix(pub(super) u64);

impl SplitMix {
    /// Returns a number that is uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scan_spreads_points_by_area_and_close_to_the_surface() {
        let model = Model::read(
            "v 0 0 0\nv 1 0 0\nv 1 3 0\nv 0 3 0\nv 9 0 5\nv 10 0 5\nv 10 1 5\nf 1/1 2/2 3/3 4/4\nf 5/5 6/6 7/7\n",
        );
        let text = points(&model, 700.0);
        let z = |line: &str| line.split(' ').next_back().and_then(|z| z.parse::<f64>().ok()).unwrap_or(f64::NAN);
        let (low, high): (Vec<f64>, Vec<f64>) = text.lines().map(z).partition(|z| *z < 2.5);
        // The areas are 3 and ½, which give 600 and 100 points up to a rounding error of one.
        assert!(low.len().abs_diff(600) <= 1 && high.len().abs_diff(100) <= 1, "{} {}", low.len(), high.len());
        assert!(low.iter().all(|z| z.abs() < 0.0031) && high.iter().all(|z| (z - 5.0).abs() < 0.0031));
    }
}
