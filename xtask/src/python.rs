//! Python package: builds its wheels, and runs its tests in a virtual environment.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::{FEATURES, cargo_for_tests, lab};

/// Folder of the Python package, relative to the workspace.
const PACKAGE: &str = "crates/surfel-python";
/// Folder of the package's Python modules, relative to the workspace.
pub(crate) const SOURCE: &str = "crates/surfel-python/python";
/// Folder of the package's tests, relative to the workspace.
const TESTS: &str = "crates/surfel-python/tests";
/// Packages that the tests need: pip requirement and module name.
const TEST_PACKAGES: [(&str, &str); 3] = [("numpy", "numpy"), ("pytest", "pytest"), ("pytest-xdist", "xdist")];
/// Packages that build the wheels: pip requirement and module name.
pub(crate) const BUILD_PACKAGES: [(&str, &str); 1] = [("maturin>=1.12,<2", "maturin")];
/// Packages for the tests with `full` (notebooks, rendering engines, comparisons with other programs, tests of other
/// packages): pip requirement and module name.
const EXTRA_PACKAGES: [(&str, &str); 18] = [
    ("ray", "ray"),
    ("distributed", "distributed"),
    ("openjd-cli", "openjd"),
    ("kubernetes-validate", "kubernetes_validate"),
    ("snakemake", "snakemake"),
    ("nbconvert", "nbconvert"),
    ("ipykernel", "ipykernel"),
    ("anywidget", "anywidget"),
    ("jupyterlab", "jupyterlab"),
    ("matplotlib", "matplotlib"),
    ("laspy", "laspy"),
    ("open3d", "open3d"),
    ("pyvista", "pyvista"),
    ("trimesh", "trimesh"),
    ("pandas", "pandas"),
    ("polars", "polars"),
    ("pyarrow", "pyarrow"),
    ("torch", "torch"),
];

/// Platform for which a wheel is built.
pub(crate) struct Platform {
    pub(crate) triple: &'static str,
    /// Platform tag of the wheel, without the processor.
    pub(crate) tag: &'static str,
    /// Docker platform of the container in which the wheel is tested.
    pub(crate) docker: &'static str,
    /// Docker image in which the wheel is tested.
    pub(crate) image: &'static str,
}

impl Platform {
    /// True if rustup has installed the standard library of the platform.
    pub(crate) fn is_installed(&self, root: &Path) -> bool {
        has_target(root, self.triple)
    }

    /// True if a wheel with this file name is for this platform.
    pub(crate) fn made(&self, wheel: &str) -> bool {
        let processor = self.triple.split('-').next().unwrap_or_default();
        wheel.contains(self.tag) && wheel.ends_with(&format!("{processor}.whl"))
    }
}

/// Platforms for which wheels are built.
pub(crate) const TARGETS: [Platform; 4] = [
    Platform {
        triple: "x86_64-unknown-linux-gnu",
        tag: "manylinux2014",
        docker: "linux/amd64",
        image: "python:3.9-slim",
    },
    Platform {
        triple: "aarch64-unknown-linux-gnu",
        tag: "manylinux2014",
        docker: "linux/arm64",
        image: "python:3.9-slim",
    },
    Platform {
        triple: "x86_64-unknown-linux-musl",
        tag: "musllinux_1_2",
        docker: "linux/amd64",
        image: "python:3.12-alpine",
    },
    Platform {
        triple: "aarch64-unknown-linux-musl",
        tag: "musllinux_1_2",
        docker: "linux/arm64",
        image: "python:3.12-alpine",
    },
];

/// Result of the package's tests.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Tested {
    Passed,
    Failed,
    Skipped(String),
}

/// Tests the package. With `full`, and on systems other than Linux, maturin builds and installs it first. With `full`,
/// also tests notebooks, engines, comparisons and other packages.
pub(crate) fn test(root: &Path, full: bool) -> Tested {
    println!("\n== Python package");
    let python = match environment(root, &TEST_PACKAGES) {
        Ok(python) => python,
        Err(why) => return Tested::Skipped(why),
    };
    // Earlier tests have built this program. A separate build with fewer features would compile half of the crates
    // again.
    let program = target(root).join("debug").join("surfel");
    let ran = |words: &[&str]| {
        let mut command = Command::new(&python);
        command.current_dir(root).args(words).env("SURFEL_PROGRAM", &program);
        command.env("PYTHONPATH", root.join(SOURCE));
        // Maturin installs into the active virtual environment.
        command.env("VIRTUAL_ENV", folder(root)).status().is_ok_and(|status| status.success())
    };
    let is_built = if full || !cfg!(target_os = "linux") {
        if let Err(why) = install(&python, &BUILD_PACKAGES) {
            return Tested::Skipped(why);
        }
        ran(&["-m", "maturin", "develop", "--quiet", "--locked"])
    } else {
        build(root)
    };
    let quick = "not engines and not packages";
    // One process of pytest per core.
    if !is_built || !ran(&["-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "auto", "-m", quick, TESTS]) {
        return Tested::Failed;
    }
    if !full {
        return Tested::Passed;
    }
    if let Err(why) = install(&python, &EXTRA_PACKAGES) {
        return Tested::Skipped(format!("notebooks, engines, rivals and other packages: {why}"));
    }
    let shown = [
        vec!["-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "engines or packages", TESTS],
        vec!["crates/surfel-python/examples/run_notebooks.py"],
        vec!["crates/surfel-python/examples/rivals.py"],
        vec!["crates/surfel-python/examples/engines.py", "2"],
    ];
    if shown.iter().all(|words| ran(words)) && lab::test(root, &python) { Tested::Passed } else { Tested::Failed }
}

/// Builds the extension module in the folder where Python searches for it. The features are those of the Rust tests,
/// since other features would compile everything again.
fn build(root: &Path) -> bool {
    let mut command = cargo_for_tests(root);
    command.args(["build", "--quiet", "--workspace", "--lib", "--tests", "--features", FEATURES, "--locked"]);
    command.args(["--exclude", "surfel-benches"]);
    // As in builds by maturin, Python itself isn't linked.
    command.env("PYO3_BUILD_EXTENSION_MODULE", "1");
    if !command.status().is_ok_and(|status| status.success()) {
        return false;
    }
    let built = target(root).join("debug").join("libsurfel_python.so");
    match std::fs::copy(&built, root.join(SOURCE).join("surfel").join("_native.abi3.so")) {
        Ok(_) => true,
        Err(why) => {
            eprintln!("error: {} can't be copied into {SOURCE}: {why}", built.display());
            false
        }
    }
}

/// Builds the wheels of all platforms that rustup has installed.
pub(crate) fn wheel(root: &Path) -> bool {
    let out = target(root).join("wheels");
    let mut passed = true;
    for platform in &TARGETS {
        let triple = platform.triple;
        if !platform.is_installed(root) {
            println!("{triple}: skipped, Rust has no such target here: rustup target add {triple}");
        } else if let Err(why) = wheel_of(root, platform, &out, &target(root), "0") {
            eprintln!("error: {triple}: {why}");
            passed = false;
        }
    }
    println!("wheels are in {}", out.display());
    passed
}

/// Builds the wheel of a platform into the folder `out`, with maturin and zig from pip. `epoch` is the modification
/// time of the files in the wheel, in seconds since 1970.
pub(crate) fn wheel_of(root: &Path, platform: &Platform, out: &Path, target: &Path, epoch: &str) -> Result<(), String> {
    let python = environment(root, &[BUILD_PACKAGES[0], ("ziglang", "ziglang")])?;
    let mut command = Command::new(&python);
    let triple = platform.triple;
    command.current_dir(root).args(["-m", "maturin", "build", "--release", "--locked", "--zig", "--target", triple]);
    // With the GPU backends, the compressed wheel has 11 MB.
    command.args(["--features", "gpu", "--compatibility", platform.tag, "--out"]).arg(out);
    // Maturin finds zig by the first python3 in the search path.
    command.env("VIRTUAL_ENV", folder(root)).env("PATH", path(root)?).env("CARGO_TARGET_DIR", target);
    // Zip archives can't store times before 1980; maturin clamps earlier times.
    command.env("SOURCE_DATE_EPOCH", epoch);
    if triple.ends_with("musl") {
        // An extension module is a shared library, into which musl's static C library can't be linked.
        let variable = format!("CARGO_TARGET_{}_RUSTFLAGS", triple.to_uppercase().replace('-', "_"));
        command.env(variable, "-C target-feature=-crt-static");
    }
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("maturin build: {status}")),
        Err(error) => Err(format!("maturin build: {error}")),
    }
}

/// True if rustup has installed the standard library of a target.
pub(crate) fn has_target(root: &Path, triple: &str) -> bool {
    let installed = Command::new("rustup").current_dir(root).args(["target", "list", "--installed"]).output();
    installed.is_ok_and(|output| String::from_utf8_lossy(&output.stdout).lines().any(|line| line.trim() == triple))
}

/// Returns a clause that lists those of these targets that rustup hasn't installed; empty if none is missing.
pub(crate) fn not_installed(root: &Path, triples: &[&str]) -> String {
    let missing: Vec<&str> = triples.iter().filter(|triple| !has_target(root, triple)).copied().collect();
    match missing.is_empty() {
        true => String::new(),
        false => format!("; skipped, rustup target add {}", missing.join(" ")),
    }
}

/// Returns the search path (`PATH`) with the virtual environment's programs first.
pub(crate) fn path(root: &Path) -> Result<std::ffi::OsString, String> {
    let others = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::iter::once(folder(root).join("bin")).chain(std::env::split_paths(&others));
    std::env::join_paths(folders).map_err(|why| format!("{} can't be put on the path: {why}", folder(root).display()))
}

pub(crate) fn target(root: &Path) -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), |folder| root.join(folder))
}

/// Returns the folder of the virtual environment.
fn folder(root: &Path) -> PathBuf {
    target(root).join("python")
}

/// Returns the Python interpreter of a virtual environment with these packages, or the reason why there is none.
pub(crate) fn environment(root: &Path, packages: &[(&str, &str)]) -> Result<PathBuf, String> {
    if !root.join(PACKAGE).is_dir() {
        return Err(format!("there is no {PACKAGE}"));
    }
    let quiet = |command: &mut Command| {
        command.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
    };
    let folder = folder(root);
    let python = folder.join("bin").join("python");
    if !python.is_file() {
        if !quiet(Command::new("python3").args(["-c", "import venv, ensurepip"])) {
            return Err("python3 isn't here, or has no modules venv and ensurepip".to_owned());
        }
        if !quiet(Command::new("python3").args(["-m", "venv"]).arg(&folder)) {
            return Err(format!("python3 -m venv {} failed", folder.display()));
        }
    }
    install(&python, packages)?;
    Ok(python)
}

/// Installs those of the packages that are missing.
fn install(python: &Path, packages: &[(&str, &str)]) -> Result<(), String> {
    let found = "import importlib.util as u, sys; sys.exit(any(u.find_spec(name) is None for name in sys.argv[1:]))";
    let names = packages.iter().map(|(_, module)| module);
    if Command::new(python).args(["-c", found]).args(names).status().is_ok_and(|status| status.success()) {
        return Ok(());
    }
    let wanted: Vec<&str> = packages.iter().map(|(requirement, _)| *requirement).collect();
    let mut pip = Command::new(python);
    pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--retries", "1", "--timeout", "20"]);
    if pip.args(&wanted).status().is_ok_and(|status| status.success()) {
        Ok(())
    } else {
        Err(format!("pip can't install {}", wanted.join(", ")))
    }
}
