//! Prints a table of the errors of surface models against exact surfaces: Surfel's, means with the best radius, and a
//! triangulation of first returns, all from the same scans. Each row averages `SEEDS` scans (default 8). Further
//! arguments select kinds of surfaces by name.
//!
//! ```sh
//! cargo run --release -p surfel --example surface_model -- 8 canopy
//! ```

#[path = "../tests/ortho/truth.rs"]
#[allow(dead_code, reason = "tests use what this doesn't")]
mod truth;

use truth::{Errors, Exact, Folder, NOISE_M, Scan, canopy, compared, deck, roof};

/// Kind of scan. The elements are its name, its surface, and the height that divides the surface's upper part from its
/// lower part. Two flags follow: true if the lower part continues beneath the upper one, and true for random positions.
/// The last element is the noise in metres.
type Kind = (&'static str, Exact, f64, bool, bool, f64);

const KINDS: [Kind; 7] = [
    ("roof in rows", roof, 102.3, false, false, NOISE_M),
    ("roof", roof, 102.3, false, true, NOISE_M),
    ("deck in rows", deck, 3.0, true, false, NOISE_M),
    ("deck", deck, 3.0, true, true, NOISE_M),
    ("canopy", canopy, 4.0, true, true, NOISE_M),
    ("canopy, 15 cm", canopy, 4.0, true, true, 0.15),
    ("canopy, 40 cm", canopy, 4.0, true, true, 0.4),
];

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let seeds: u64 = words.first().map_or(8, |word| word.parse().expect("SEEDS: expected a whole number"));
    println!("| surface | points/m² | RMSE, m: ours, means, TIN | gaps, % | edge off by, m |");
    println!("| --- | --- | --- | --- | --- |");
    for (name, exact, middle, is_double, anywhere, stray_m) in KINDS {
        if words.len() > 1 && !words[1..].iter().any(|word| word == name) {
            continue;
        }
        for density in [4.0, 8.0, 20.0] {
            let of_seed = |seed: u64| {
                let scan = Scan { density, anywhere, seed };
                let folder = Folder::new(&format!("table-{name}-{density}-{seed}"));
                let [all, first] = if is_double {
                    scan.two_surfaces(exact, stray_m)
                } else {
                    let points = scan.points(|x, y| exact(x, y).0, stray_m);
                    [points.clone(), points]
                };
                compared(&folder, exact, middle, [&all, &first])
            };
            let found: Vec<[Errors; 3]> = (0..seeds).map(of_seed).collect();
            let mean = |of: &dyn Fn(&Errors) -> f64| {
                [0, 1, 2].map(|k| found.iter().map(|errors| of(&errors[k])).sum::<f64>() / found.len() as f64)
            };
            let rmse = mean(&|e| e.rmse * e.rmse).map(|v| format!("{:.3}", v.sqrt())).join(", ");
            let gaps = mean(&|e| 100.0 * e.gaps).map(|v| format!("{v:.2}")).join(", ");
            let edge = mean(&|e| e.edge_m).map(|v| format!("{v:.3}")).join(", ");
            println!("| {name} | {density} | {rmse} | {gaps} | {edge} |");
        }
    }
}
