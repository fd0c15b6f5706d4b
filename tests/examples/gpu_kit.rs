//! The GPU kit's program, with the commands `bench` and `conformance`. `cargo xtask gpu-kit` packs it.

use std::process::ExitCode;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().collect();
    match words.get(1).map(String::as_str) {
        Some("bench") => surfel_bench::main(words.into_iter().skip(1).map(Into::into)),
        Some("conformance") => surfel_conformance::runner::main(words.into_iter().skip(2)),
        _ => {
            eprintln!("error: expected 'bench' or 'conformance', and what follows it: --help says more");
            ExitCode::from(2)
        }
    }
}
