//! `cargo xtask conformance` and `stability`: compare the backends with the reference or with exact results, by
//! programs of the package `surfel-conformance`.

use std::path::Path;
use std::process::ExitCode;

use crate::{cargo, vulkan};

/// Paths at which Linux distributions install Chromium's software Vulkan driver. It is used as a second driver if it
/// exists.
const SECOND_DRIVERS: [&str; 3] = [
    "/usr/lib/chromium/vk_swiftshader_icd.json",
    "/usr/lib64/chromium-browser/vk_swiftshader_icd.json",
    "/opt/google/chrome/vk_swiftshader_icd.json",
];

/// Environment variable that lists drivers for the Vulkan loader.
const DRIVERS: &str = "VK_DRIVER_FILES";

/// Runs a program of the package `surfel-conformance` with these options. The program `conformance` runs once more on a
/// second driver, if one is installed and the environment selects none. Fails if either run fails.
pub(crate) fn run(root: &Path, program: &str, options: &[&str]) -> ExitCode {
    // If Vulkan is incomplete, the program itself reports the missing backends.
    if let Err(problem) = vulkan::prepare(root) {
        eprintln!("error: {problem}");
        return ExitCode::FAILURE;
    }
    let first = run_on(root, program, options, None);
    // The program has reported the usage error.
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

/// Returns the options of a second run, with the backends that use a Vulkan driver. `None` if there are no such
/// backends, or if there are options other than `--backend`, `--scene` and `--report`.
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
    // A second run is useful only on another driver.
    kept.extend(["--adapter".to_owned(), "swiftshader".to_owned()]);
    (!backends.is_empty()).then_some(kept)
}

fn run_on(root: &Path, program: &str, options: &[&str], driver: Option<&str>) -> ExitCode {
    let mut command = cargo(root);
    // The program's paths are relative to the current folder, not to the workspace.
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
