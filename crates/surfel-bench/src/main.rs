//! The program `surfel-bench`. Run it as `cargo xtask bench`, which builds it for release.

fn main() -> std::process::ExitCode {
    surfel_bench::main(std::env::args_os())
}
