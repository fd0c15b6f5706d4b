//! Compares backends with the reference; run as `cargo xtask conformance`.

fn main() -> std::process::ExitCode {
    surfel_conformance::runner::main(std::env::args().skip(1))
}
