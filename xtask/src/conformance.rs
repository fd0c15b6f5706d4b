//! `cargo xtask conformance` and `stability`: the backends against the truth, by programs of the package
//! `surfel-conformance`.

use std::path::Path;
use std::process::ExitCode;

use crate::{cargo, vulkan};

/// Where distributions put Chromium's Vulkan driver for processors: a second opinion where there is one.
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
    let Some(driver) = second_driver(program, options) else { return first };
    println!("\nonce more on {driver}");
    let second = run_on(root, program, &second_options(options), Some(driver));
    if first == ExitCode::SUCCESS { second } else { first }
}

/// A driver that conformance also runs on: if there is one, and the user hasn't chosen driver, adapter, kind of scenes or report.
fn second_driver(program: &str, options: &[&str]) -> Option<&'static str> {
    let chosen = |name: &str| options.iter().any(|option| *option == name || option.starts_with(&format!("{name}=")));
    let free = ["--adapter", "--random", "--store", "--report", "--help", "-h"].iter().all(|name| !chosen(name));
    let on_gpu = !chosen("--backend") || options.iter().any(|option| option.contains("wgpu") || option.contains("ash"));
    if program != "conformance" || !free || !on_gpu || std::env::var_os(DRIVERS).is_some() {
        return None;
    }
    SECOND_DRIVERS.into_iter().find(|path| Path::new(path).is_file())
}

/// Of the backends, those that a driver makes a difference to.
fn second_options<'a>(options: &[&'a str]) -> Vec<&'a str> {
    let backends = ["--backend", "wgpu", "--backend", "ash"];
    let mut left = options.iter().copied().peekable();
    let (mut kept, mut some) = (Vec::new(), false);
    while let Some(option) = left.next() {
        let named = match option.strip_prefix("--backend=") {
            Some(name) => Some(name),
            None if option == "--backend" => left.next(),
            None => None,
        };
        match named {
            Some(name) if matches!(name, "wgpu" | "ash") => {
                some = true;
                kept.extend(["--backend", name]);
            }
            Some(_) => {}
            None => kept.push(option),
        }
    }
    if !some {
        kept.extend(backends);
    }
    kept
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
        command.env(DRIVERS, driver);
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
    fn second_run_keeps_options_and_takes_backends_with_drivers() {
        assert_eq!(second_options(&[]), ["--backend", "wgpu", "--backend", "ash"]);
        assert_eq!(
            second_options(&["--backend=cpu", "--scene", "grid", "--backend", "ash"]),
            ["--scene", "grid", "--backend", "ash"]
        );
    }
}
