//! Project chores, run as `cargo xtask COMMAND`. This package depends on no other package of the workspace; it starts
//! cargo as a separate process.

mod assets;
mod bench;
mod ci;
mod conformance;
mod front_page;
mod gallery;
mod gpu_kit;
mod graph;
mod growth;
mod lab;
mod licences;
mod page;
mod python;
mod release;
mod rename;
mod scaling;
mod suites;
mod tidy;
mod vulkan;
mod web;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use suites::Gpu;

/// Cargo features that are tested although no package enables them by default: GPU backends, `surfel mcp`, and all
/// features of the facade.
const FEATURES: &str = "surfel-cli/wgpu,surfel-cli/ash,surfel-cli/mcp,\
                        surfel/wgpu,surfel/ash,surfel/reference,surfel/sharp";

const HELP: &str = "\
The project's chores.

Usage: cargo xtask COMMAND

Commands:
  test    Run every test of the workspace, doc tests included, all backends built in, and sum up.
          Where Vulkan's loader, a driver or the validation layer is missing, install it (as root,
          with apt-get) or say what is skipped. The Python package is tested where python3 has venv
          and pip finds its packages, and the page of surfel view where node, Chromium and the packages
          in target/page-tests are installed; --full installs those and runs the Python package's
          notebooks, Ray, Dask and rivals, too, and builds the GPU kit and the program of README.md as a
          crate of its own, and runs both
  wheel   Build the Python package into target/wheels, by maturin and zig of pip: for manylinux2014
          and musllinux_1_2 on x86-64 and aarch64, where rustup has the targets
  web     Build the drawing module of exported pages, WebAssembly with SIMD, into
          crates/surfel-web-module/module; Cargo's feature export of surfel-cli needs it. The target
          wasm32-unknown-unknown is installed by rustup if it is missing
  ci      Everything that must pass before a change is merged: formatting, clippy, the program
          with its default features, docs, tests, tidy, and cargo-deny where it is installed
  tidy    Cheap checks of the tree: sizes of files, lengths of lines, leftovers, machine paths,
          manifests, tense and paths of pages, packages missing from docs/architecture.md
  conformance [OPTIONS]
          Hold the backends against the reference and print a table; --report FILE writes a page
          with images, --random N draws random scenes, --help says more
  stability [OPTIONS]
          Drive sizes, distances, tilts and counts to their extremes and hold the backends against
          exact arithmetic; writes a page of curves, --help says more
  assets  Write generated scenes (a checkerboard, a sphere, glass spheres, a CAD part, Spot
          cut in two) to assets/generated
  gallery [--models FOLDER]
          Draw the images of docs/gallery.md into docs/images; or those of models that you have
          and that aren't shipped (a lion with its shadow, igea drawn as a toon) into target/gallery
  bench   Time frames of known scenes on a backend; --markdown docs/data/bench.md keeps the table,
          --help says more
  growth FOLDER MILLIONS...
          Convert so many million generated points to levels, and draw them: time, memory and disk
  scaling [OPTIONS] [NAME...]
          Time the program on hostile inputs of some 90 shapes at n, 2n, 4n and 8n, and fail where
          the exponent is above 1.2; --markdown docs/data/scaling.md keeps the table
  tradeoff [OPTIONS]
          Measure what every setting costs in time and in error, and write a page; --quick takes two
          minutes, --backend all measures GPU backends too, --markdown docs/data/tradeoff.md keeps
          the tables, --help says more
  gpu-kit Build target/gpu-kit, a folder that measures a GPU in eight minutes on a machine with
          nothing but a graphics driver: copy it there, and run ./run.sh OUT
  gpu-report OUT
          Write docs/data/gpu.md of what the kit measured
  shader-stats
          Print a table of the shaders' SPIR-V: bytes, instructions, loops, barriers and workgroup
          memory of each entry point, and what naga's checks add. A second table has registers and
          occupancy of compute shaders on an AMD GPU (RADV_FORCE_FAMILY, by default navi21), where
          Mesa's driver for AMD is installed; the GPU need not be there
  licences
          Write the licences of all dependencies to THIRD-PARTY.txt and the bill of materials (SBOM)
          to packaging/surfel.cdx.json
  rename PREFIX [--dry-run]
          Rename the published packages from surfel… to PREFIX…, where a name is taken; code stays
  release --dry-run [STEP...]
          Make all packages of a release, try them as a stranger would, print times and sizes, and
          the list of what only the owner can do; nothing is uploaded (docs/packages.md)
  help    Print this

Environment:
  SURFEL_REQUIRE    Comma-separated list of what must not be skipped: vulkan, wgpu, ash,
                    validation, test-data, cargo-deny, python, page, web, and steps of a release
  SURFEL_TEST_DATA  Folder of golden scenes and models that aren't shipped; without it the folder
                    'shared' beside the workspace, where there is one

Exit codes: 0 all passed, 1 something failed, 2 usage";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let root = workspace_root();
    let passed = match words[..] {
        ["test"] => suites::run(&root, Gpu::IfPresent, false),
        ["test", "--full"] => suites::run(&root, Gpu::IfPresent, true),
        ["web"] => web::build(&root),
        ["wheel"] => python::wheel(&root),
        ["ci"] => ci::run(&root),
        ["tidy"] => tidy::run(&root),
        ["assets"] => assets::run(&root),
        ["gallery"] => gallery::run(&root),
        ["gallery", "--models", folder] => gallery::run_models(&root, folder),
        [program @ ("conformance" | "stability"), ref options @ ..] => {
            return conformance::run(&root, program, options);
        }
        ["bench", ref rest @ ..] => bench::run(&root, rest),
        ["gpu-kit"] => gpu_kit::run(&root),
        ["gpu-report", out] => gpu_kit::report_page(&root, out),
        ["shader-stats"] => shader_stats(&root),
        ["growth", ref rest @ ..] => growth::run(&root, rest),
        ["scaling", ref rest @ ..] => scaling::run(&root, rest),
        ["licences"] => licences::run(&root),
        ["rename", prefix] => rename::run(&root, prefix, false),
        ["rename", prefix, "--dry-run"] | ["rename", "--dry-run", prefix] => rename::run(&root, prefix, true),
        ["release", "--dry-run", ref steps @ ..] => release::run(&root, steps),
        ["tradeoff", ..] => bench::run(&root, &words),
        [] => {
            eprintln!("{HELP}");
            return ExitCode::from(2);
        }
        [.., "help" | "--help" | "-h"] => {
            println!("{HELP}");
            return ExitCode::SUCCESS;
        }
        _ => {
            eprintln!("error: unknown command '{}'\n\n{HELP}", words.join(" "));
            return ExitCode::from(2);
        }
    };
    if passed { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Prints the statistics of the shaders, by a program of their package.
fn shader_stats(root: &Path) -> bool {
    let example = |package: &str, name: &str| {
        let mut command = cargo(root);
        command.args(["run", "--quiet", "--package", package, "--example", name]);
        command
    };
    let is_counted = example("surfel-shaders", "shader_stats").status().is_ok_and(|status| status.success());
    let Some(driver) = vulkan::amd_driver() else {
        println!("\nRegisters aren't counted: Mesa's Vulkan driver for AMD's GPUs is missing (mesa-vulkan-drivers).");
        return is_counted;
    };
    println!();
    let mut registers = example("surfel-ash", "registers");
    // Both variables name the driver: the second is that of loaders before 1.3.207.
    registers.env("VK_DRIVER_FILES", &driver).env("VK_ICD_FILENAMES", &driver);
    if std::env::var_os("RADV_FORCE_FAMILY").is_none() {
        registers.env("RADV_FORCE_FAMILY", "navi21");
    }
    is_counted && registers.status().is_ok_and(|status| status.success())
}

/// Returns the folder of the workspace, which is the parent of this package's folder.
fn workspace_root() -> PathBuf {
    // Cargo sets the variable when it runs this program. The program thus works in a checkout that was moved after the
    // build.
    let package =
        std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    package.parent().map_or_else(|| package.clone(), Path::to_path_buf)
}

/// Returns a command that runs the current cargo in the workspace.
fn cargo(root: &Path) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root);
    command
}

/// Returns a command that runs cargo for tests. If Surfel's packages have no incremental files yet, the command
/// disables incremental compilation, unless `CARGO_INCREMENTAL` is set. Writing these files lengthens the build by up
/// to half, and they speed up only later builds.
fn cargo_for_tests(root: &Path) -> Command {
    let mut command = cargo(root);
    let kept = std::fs::read_dir(python::target(root).join("debug").join("incremental"));
    let is_ours = |name: &std::ffi::OsStr| name.to_string_lossy().starts_with("surfel");
    let was_compiled = kept.is_ok_and(|kept| kept.flatten().any(|entry| is_ours(&entry.file_name())));
    if !was_compiled && std::env::var_os("CARGO_INCREMENTAL").is_none() {
        command.env("CARGO_INCREMENTAL", "0");
    }
    command
}

/// True if the environment variable `SURFEL_REQUIRE` forbids skipping `what`.
fn required(what: &str) -> bool {
    std::env::var("SURFEL_REQUIRE").is_ok_and(|list| list.split(',').any(|word| word.trim() == what))
}
