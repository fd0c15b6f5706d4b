//! `cargo xtask gpu-kit` and `gpu-report`. The first makes a folder that measures a GPU on a machine without other
//! software; the second makes the page of its measurements.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::cargo;

/// Folder into which the kit is built, relative to the workspace.
const FOLDER: &str = "target/gpu-kit";
/// Page of the kit's measurements, relative to the workspace.
const PAGE: &str = "docs/data/gpu.md";
/// Maximum size of the kit's folder, in bytes. It has to fit the 64 MiB that can be transferred to a borrowed machine.
const MAX_BYTES: u64 = 66_000_000;

const SCRIPT: &str = include_str!("gpu_kit/run.sh");

/// Files of the model Spot, which the kit draws.
const SPOT: [&str; 5] = ["spot.json", "spot.obj", "spot.mtl", "spot_texture.png", "LICENSE.txt"];

/// Libraries that other machines may lack: their folder in the kit, their files, and their licence.
const LIBRARIES: [(&str, &[&str], &str); 3] = [
    ("vulkan", &["libvulkan.so.1"], "The Khronos Vulkan loader, Apache License 2.0.\n"),
    ("libgcc", &["libgcc_s.so.1"], "GCC's run-time library, GPL 3 with the GCC Runtime Library Exception.\n"),
    (
        "glvnd",
        &["libGLdispatch.so.0", "libGLX.so.0", "libEGL.so.1"],
        "libglvnd, the GL Vendor-Neutral Dispatch library, MIT licence and alike.\n",
    ),
];

/// Builds the kit. Returns true on success.
pub(crate) fn run(root: &Path) -> bool {
    build(root).map_err(|problem| eprintln!("error: {problem}")).is_ok()
}

fn build(root: &Path) -> Result<(), String> {
    let folder = root.join(FOLDER);
    let status = cargo(root)
        .args(["build", "--release", "--locked", "--package", "surfel-cli", "--package", "surfel-conformance"])
        .args(["--bin", "surfel", "--example", "gpu_kit", "--features", "surfel-cli/gpu"])
        .status();
    if !status.is_ok_and(|status| status.success()) {
        return Err("the release build failed".into());
    }
    let release = crate::python::target(root).join("release");
    // Files of an earlier build would become part of the kit.
    let _ = std::fs::remove_dir_all(&folder);
    make(&folder)?;
    let mut glibc = [2, 0];
    for (from, to) in [("surfel", "surfel"), ("examples/gpu_kit", "gpu-kit")] {
        glibc = glibc.max(program(&release.join(from), &folder.join(to))?);
    }
    for (place, names, licence) in LIBRARIES {
        for name in names {
            match library(name) {
                Some(file) => {
                    let bytes = copy(&file, &folder.join(place).join(name))?;
                    glibc = glibc.max(least_glibc(&bytes));
                    write(&folder.join(place).join("LICENSE.txt"), licence)?;
                }
                None => println!("note: this machine has no {name} to pack: the kit relies on the target's"),
            }
        }
    }
    for name in SPOT {
        copy(&root.join("assets/spot").join(name), &folder.join("spot").join(name))?;
    }
    let truths = folder.join("truths.gz");
    println!("drawing the reference's images");
    let drawn = Command::new(folder.join("gpu-kit")).args(["conformance", "--write-truths"]).arg(&truths).status();
    if !drawn.is_ok_and(|status| status.success()) {
        return Err("the reference's images could not be drawn".into());
    }
    let [major, minor] = glibc;
    let kit = format!("{{\"kind\":\"kit\",\"commit\":\"{}\",\"glibc\":\"{major}.{minor}\"}}\n", commit(root));
    write(&folder.join("kit.json"), &kit)?;
    write(&folder.join("run.sh"), SCRIPT)?;
    executable(&folder.join("run.sh"))?;
    let bytes = size(&folder);
    println!("{FOLDER}: {:.1} MB, for x86-64 Linux with glibc {major}.{minor} or later", bytes as f64 * 1e-6);
    println!("copy it to a machine with a GPU, run ./run.sh OUT there, copy OUT back, and: cargo xtask gpu-report OUT");
    if bytes > MAX_BYTES {
        return Err(format!("{FOLDER} has {bytes} bytes, expected at most {MAX_BYTES}: pack less"));
    }
    Ok(())
}

/// Writes the page of the results in the folder `out`, which the kit's script has written.
pub(crate) fn report(root: &Path, out: &str, page: &Path) -> bool {
    let Ok(out) = std::env::current_dir().map(|here| here.join(out)) else { return false };
    let built = root.join(FOLDER).join("gpu-kit");
    let mut command = if built.is_file() {
        let mut command = Command::new(built);
        command.current_dir(root).arg("bench");
        command
    } else {
        // The report needs no optimised program, because it measures nothing.
        let mut command = cargo(root);
        command.args(["run", "--quiet", "--locked", "--package", "surfel-bench", "--"]);
        command
    };
    command.args(["kit", "report"]).arg(out).arg("--markdown").arg(page);
    command.status().is_ok_and(|status| status.success())
}

/// Runs `cargo xtask gpu-report OUT`: writes the page [`PAGE`] of the results in the folder `out`.
pub(crate) fn report_page(root: &Path, out: &str) -> bool {
    report(root, out, Path::new(PAGE))
}

/// Builds the kit, runs its script on the devices of this machine in an empty environment, and checks the results.
/// Returns true if there are no problems.
pub(crate) fn test(root: &Path) -> bool {
    println!("\n== GPU kit");
    if !run(root) {
        return false;
    }
    let out = crate::python::target(root).join("gpu-kit-out");
    let _ = std::fs::remove_dir_all(&out);
    let mut script = Command::new(root.join(FOLDER).join("run.sh"));
    script.arg(&out).env_clear().env("PATH", "/usr/bin:/bin:/usr/sbin:/sbin");
    // The user's selection of a driver remains in effect.
    for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
        script.envs(std::env::var(name).map(|value| (name, value)));
    }
    let passed = script.status().is_ok_and(|status| status.success());
    let page = out.join("gpu.md");
    let is_written = report(root, &out.to_string_lossy(), &page);
    let results = std::fs::read_to_string(out.join("results.jsonl")).unwrap_or_default();
    let problems = problems(&results, &std::fs::read_to_string(&page).unwrap_or_default());
    problems.iter().for_each(|problem| println!("{problem}"));
    passed && is_written && problems.is_empty()
}

/// Returns the problems in the results of the script, on a machine with Vulkan.
fn problems(results: &str, page: &str) -> Vec<String> {
    let mut problems = Vec::new();
    let mut expect = |is_so: bool, problem: &str| problems.extend((!is_so).then(|| format!("GPU kit: {problem}")));
    for kind in ["kit", "machine", "device", "frame", "conformance", "probe", "step"] {
        expect(results.contains(&format!("{{\"kind\":\"{kind}\"")), &format!("results have no line of kind {kind}"));
    }
    for backend in ["ash", "wgpu", "cpu"] {
        let is_drawn = |line: &str| line.contains("\"kind\":\"frame\"") && line.contains(&format!("\"{backend}\""));
        expect(results.lines().any(is_drawn), &format!("results have no frame on {backend}"));
    }
    for section in ["## Devices", "## Conformance", "## Frames", "## Passes", "## Probes", "## Repeated frames"] {
        expect(page.contains(section), &format!("the page has no section '{section}'"));
    }
    let is_on_gpu = results.lines().any(|line| line.contains("\"kind\":\"frame\"") && is_of_gpu(line));
    expect(is_on_gpu != page.contains(NOT_MEASURED), "the page and the results differ on whether a GPU was measured");
    problems
}

/// Text that the page [`PAGE`] contains until a GPU is measured.
pub(crate) const NOT_MEASURED: &str = "**Not measured.**";

fn is_of_gpu(line: &str) -> bool {
    line.contains("\"is_software\":false") && !line.contains("\"backend\":\"cpu\"")
}

fn make(folder: &Path) -> Result<(), String> {
    std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))
}

/// Copies a file and returns its bytes.
fn copy(from: &Path, to: &Path) -> Result<Vec<u8>, String> {
    to.parent().map_or(Ok(()), make)?;
    let bytes = std::fs::read(from).map_err(|error| format!("{}: {error}", from.display()))?;
    std::fs::write(to, &bytes).map_err(|error| format!("{}: {error}", to.display()))?;
    Ok(bytes)
}

/// Copies a program and removes its symbols. Returns the version of glibc that the program needs.
fn program(from: &Path, to: &Path) -> Result<[u32; 2], String> {
    let bytes = copy(from, to)?;
    // Every linker's installation has `strip`. Without it, only the size of the kit is larger.
    if !Command::new("strip").arg(to).status().is_ok_and(|status| status.success()) {
        println!("note: strip can't be run, {} keeps its symbols", to.display());
    }
    executable(to)?;
    Ok(least_glibc(&bytes))
}

#[cfg(unix)]
fn executable(path: &Path) -> Result<(), String> {
    use std::os::unix::fs::PermissionsExt;
    let mode = std::fs::Permissions::from_mode(0o755);
    std::fs::set_permissions(path, mode).map_err(|error| format!("{}: {error}", path.display()))
}

#[cfg(not(unix))]
fn executable(_path: &Path) -> Result<(), String> {
    Err("the kit is for Linux: build it there".into())
}

/// Returns the largest version of glibc among the symbols that a program imports, such as `GLIBC_2.35`. The version is
/// a major and a minor number; both are 0 if there are no such symbols.
fn least_glibc(program: &[u8]) -> [u32; 2] {
    const PREFIX: &[u8] = b"GLIBC_";
    let versions = program.windows(PREFIX.len()).enumerate().filter(|(_, bytes)| *bytes == PREFIX).map(|(at, _)| {
        let rest = &program[at + PREFIX.len()..];
        let end = rest.iter().position(|b| !b.is_ascii_digit() && *b != b'.').unwrap_or(rest.len());
        let mut words = std::str::from_utf8(&rest[..end]).unwrap_or_default().split('.').map(|word| word.parse().ok());
        [words.next().flatten().unwrap_or(0), words.next().flatten().unwrap_or(0)]
    });
    versions.max().unwrap_or_default()
}

/// Returns the path of a library on this machine, if it is installed.
fn library(name: &str) -> Option<PathBuf> {
    let folders = ["/usr/lib/x86_64-linux-gnu", "/lib/x86_64-linux-gnu", "/usr/lib64", "/lib64", "/usr/lib", "/lib"];
    folders.iter().map(|folder| Path::new(folder).join(name)).find(|path| path.is_file())
}

/// Returns the total size of the files in a folder, in bytes.
fn size(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .map(|entry| match entry.file_type() {
            Ok(kind) if kind.is_dir() => size(&entry.path()),
            _ => entry.metadata().map_or(0, |metadata| metadata.len()),
        })
        .sum()
}

/// Returns the commit of the source, with a trailing `+` if the working tree has changes; empty without git.
fn commit(root: &Path) -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").current_dir(root).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let Some(commit) = git(&["rev-parse", "--short=12", "HEAD"]) else { return String::new() };
    let changed = git(&["status", "--porcelain", "--untracked-files=no"]).is_some_and(|text| !text.is_empty());
    commit + if changed { "+" } else { "" }
}

#[cfg(test)]
mod tests;
