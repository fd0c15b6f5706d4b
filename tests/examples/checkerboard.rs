//! Example that prints the error of each filter on a checkerboard that extends to the horizon:
//! `cargo run --release -p surfel-conformance --example checkerboard`.

use surfel_conformance::checkerboard;

fn main() -> Result<(), surfel_render::RenderError> {
    println!("{:32} far                        near", "RMSE");
    for (name, bands) in checkerboard::measure(&checkerboard::variants())? {
        let cells: Vec<String> = bands.iter().map(|e| format!("{e:.4}")).collect();
        println!("{name:32} {}", cells.join(" "));
    }
    Ok(())
}
