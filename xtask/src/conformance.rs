//! `cargo xtask conformance` and `stability`: the backends against the truth, by programs of the package
//! `surfel-conformance`.

use std::path::Path;
use std::process::ExitCode;

use crate::{cargo, vulkan};

/// Where distributions put Chromium's Vulkan driver for CPUs: a second opinion where there is one.
const SECOND_DRIVERS: [&str; 3] = [
    "/usr/lib/chromium/vk_swiftshader_icd.json",
    "/usr/lib64/chromium-browser/vk_swiftshader_icd.json",
    "/opt/google/chrome/vk_swiftshader_icd.json",
];

/// What the loader takes drivers from.
const DRIVERS: &str = "VK_DRIVER_FILES";

/// Runs one of its programs.
pub(crate) fn run(root: &Path, program: &str, options: &[&str]) -> ExitCode {
    // What is missing is said again, backend by backend, by the program.
    if let Err(problem) = vulkan::prepare(root) {
        eprintln!("error: {problem}");
        return ExitCode::FAILURE;
    }
    let first = run_on(root, program, options, None);
    // Usage errors have been said.
    if first != ExitCode::SUCCESS && first != ExitCode::FAILURE {
        return first;
    }
    let chosen = [DRIVERS, "VK_ICD_FILENAMES"].iter().any(|name| std::env::var_os(name).is_some());
    let driver = SECOND_DRIVERS.into_iter().find(|path| Path::new(path).is_file());
    let (Some(driver), Some(options), false) = (driver, second_options(options), program != "conformance" || chosen)
    else {
        return first;
    };
    println!("\nonce more on {driver}");
    let second = run_on(root, program, &options.iter().map(String::as_str).collect::<Vec<_>>(), Some(driver));
    if first == ExitCode::SUCCESS { second } else { first }
}

/// Options of a second run, by backends that a driver makes a difference to; none if there are no such, or if the
/// adapter, or scenes that aren't the usual ones, are chosen.
fn second_options(options: &[&str]) -> Option<Vec<String>> {
    let (mut kept, mut backends, mut all) = (Vec::new(), Vec::new(), true);
    let mut left = options.iter();
    while let Some(option) = left.next() {
        let (name, value) = match option.split_once('=') {
            Some((name, value)) => (name, value),
            None => (*option, left.next().copied().unwrap_or_default()),
        };
        match name {
            "--backend" => {
                all = false;
                backends.extend(value.split(',').filter(|name| matches!(*name, "wgpu" | "ash")));
            }
            "--scene" => kept.extend([name.to_owned(), value.to_owned()]),
            "--report" => {
                let path = Path::new(value).with_extension("");
                kept.extend([name.to_owned(), format!("{}-swiftshader.html", path.display())]);
            }
            _ => return None,
        }
    }
    if all {
        backends = vec!["wgpu", "ash"];
    }
    kept.extend(backends.iter().flat_map(|name| ["--backend".to_owned(), (*name).to_owned()]));
    // Another driver than the one that is asked for would be no second opinion.
    kept.extend(["--adapter".to_owned(), "swiftshader".to_owned()]);
    (!backends.is_empty()).then_some(kept)
}

fn run_on(root: &Path, program: &str, options: &[&str], driver: Option<&str>) -> ExitCode {
    let mut command = cargo(root);
    // Files are named from where the user is, not from the workspace.
    if let Ok(here) = std::env::current_dir() {
        command.current_dir(here).arg("run").arg("--manifest-path").arg(root.join("Cargo.toml"));
    }
    command.args(["--quiet", "--locked", "--package", "surfel-conformance", "--example", program, "--"]);
    command.args(options);
    if let Some(driver) = driver {
        command.env(DRIVERS, driver).env("SURFEL_REQUIRE", "wgpu,ash");
    }
    match command.status() {
        Ok(status) => match status.code().map(u8::try_from) {
            Some(Ok(code)) => ExitCode::from(code),
            _ => {
                eprintln!("error: the run ended early ({status}): a driver crashed, or someone stopped it");
                ExitCode::FAILURE
            }
        },
        Err(error) => {
            eprintln!("error: could not run {}: {error}", command.get_program().display());
            ExitCode::FAILURE
        }
    }
}

#[cfg(test)]
mod tests {
    use super::second_options;

    #[test]
    fn second_run_keeps_scenes_and_takes_backends_with_drivers() {
        let second = |options: &[&str]| second_options(options).map(|options| options.join(" "));
        let of = |options: &str| Some(format!("{options} --adapter swiftshader"));
        assert_eq!(second(&[]), of("--backend wgpu --backend ash"));
        assert_eq!(second(&["--backend=cpu,ash", "--scene", "wgpu"]), of("--scene wgpu --backend ash"));
        assert_eq!(second(&["--report", "a/b.html"]), of("--report a/b-swiftshader.html --backend wgpu --backend ash"));
        assert_eq!(second(&["--backend", "cpu", "--scene=ash"]), None);
        assert_eq!(second(&["--random", "3"]), None);
    }
}
