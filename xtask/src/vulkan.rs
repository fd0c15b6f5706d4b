//! A Vulkan driver for the tests of the GPU backends.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::required;

/// Packages that draw with Vulkan.
const USERS: [&str; 2] = ["crates/surfel-wgpu", "crates/surfel-ash"];

/// Debian's and Ubuntu's loader, software driver (lavapipe) and validation layers.
const PACKAGES: [&str; 3] = ["libvulkan1", "mesa-vulkan-drivers", "vulkan-validationlayers"];

/// Sees to a driver where a package of ours needs one. Returns what will be skipped, if anything.
///
/// # Errors
/// What is missing, where `SURFEL_REQUIRE` says that it must not be.
pub(crate) fn prepare(root: &Path) -> Result<Option<String>, String> {
    if !cfg!(target_os = "linux") || !USERS.iter().any(|user| root.join(user).is_dir()) {
        return Ok(None);
    }
    let Some(missing) = missing() else { return Ok(None) };
    println!("vulkan: no {missing}");
    let reason = match install() {
        Ok(()) => match self::missing() {
            None => return Ok(None),
            Some(still) => format!("still no {still} after installing {}", PACKAGES.join(" ")),
        },
        Err(reason) => format!("no {missing}, {reason}"),
    };
    if required("vulkan") {
        Err(format!("SURFEL_REQUIRE asks for vulkan, but: {reason}"))
    } else {
        Ok(Some(format!("tests that need it are skipped ({reason})")))
    }
}

/// The first part of a Vulkan installation that isn't there.
fn missing() -> Option<&'static str> {
    let loader_folders = ["/usr/lib", "/usr/lib64", "/lib", "/usr/local/lib"];
    let architecture = format!("/usr/lib/{}-linux-gnu", std::env::consts::ARCH);
    let mut loaders = loader_folders.into_iter().chain([architecture.as_str()]);
    let chosen = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].iter().any(|name| std::env::var_os(name).is_some());
    let drivers = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d"];
    let layers = ["/usr/share/vulkan/explicit_layer.d", "/etc/vulkan/explicit_layer.d"];
    if !loaders.any(|folder| Path::new(folder).join("libvulkan.so.1").exists()) {
        Some("loader (libvulkan.so.1)")
    } else if !chosen && !drivers.iter().any(|folder| holds_json(folder)) {
        Some("driver")
    } else if std::env::var_os("VK_LAYER_PATH").is_none() && !layers.iter().any(|folder| holds_json(folder)) {
        Some("validation layer")
    } else {
        None
    }
}

fn holds_json(folder: &str) -> bool {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).any(|path| path.extension().is_some_and(|e| e == "json"))
}

fn install() -> Result<(), String> {
    let user = Command::new("id").arg("-u").output().map(|output| output.stdout).unwrap_or_default();
    if user.trim_ascii() != b"0" {
        return Err(format!("and not root, so nothing was installed: apt-get install {}", PACKAGES.join(" ")));
    }
    if !runs(Command::new("apt-get").arg("--version").stdout(Stdio::null())) {
        return Err("and no apt-get to install it with".into());
    }
    println!("vulkan: installing {}", PACKAGES.join(" "));
    let apt = |arguments: &[&str]| {
        // On stderr, so that it isn't taken for a result.
        runs(Command::new("apt-get").args(arguments).env("DEBIAN_FRONTEND", "noninteractive").stdout(std::io::stderr()))
    };
    // A stale list may still do.
    if !apt(&["update", "-q"]) {
        eprintln!("warning: apt-get update failed");
    }
    let mut arguments = vec!["install", "-q", "-y", "--no-install-recommends"];
    arguments.extend(PACKAGES);
    if apt(&arguments) { Ok(()) } else { Err("and apt-get could not install it".into()) }
}

fn runs(command: &mut Command) -> bool {
    command.status().is_ok_and(|status| status.success())
}
