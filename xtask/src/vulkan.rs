//! Installation of Vulkan for the tests of the GPU backends.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::required;

/// Packages that draw with Vulkan.
const USERS: [&str; 2] = ["crates/surfel-wgpu", "crates/surfel-ash"];

/// Packages of Debian and Ubuntu with the loader, the software driver (lavapipe) and the validation layers.
const PACKAGES: [&str; 3] = ["libvulkan1", "mesa-vulkan-drivers", "vulkan-validationlayers"];

/// Name of the Khronos validation layer. Other explicit layers, of Mesa and of vendors, may be installed in the same
/// folders.
const LAYER: &str = "VK_LAYER_KHRONOS_validation";

/// Result of the check: which tests of the GPU backends can run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// All tests can run, with the validation layer enabled.
    Validated,
    /// All tests can run except tests of validation. Contains the reason.
    Unvalidated(String),
    /// No test can run. Contains the reason.
    Skipped(String),
}

/// Parts of a Vulkan installation; each is true if it exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Parts {
    loader: bool,
    driver: bool,
    layer: bool,
}

/// Installs Vulkan if a part is missing and can be installed. Returns which tests can run.
///
/// # Errors
/// A message that names the missing part, if `SURFEL_REQUIRE` requires it.
pub(crate) fn prepare(root: &Path) -> Result<Verdict, String> {
    if !cfg!(target_os = "linux") || !USERS.iter().any(|user| root.join(user).is_dir()) {
        return Ok(Verdict::Skipped("no Vulkan on this platform".into()));
    }
    let found = Parts::find();
    let (after, problem) = if found.missing().is_empty() {
        (found, String::new())
    } else {
        println!("vulkan: no {}", found.missing().join(", no "));
        match install() {
            Ok(()) => (Parts::find(), format!("even after installing {}", PACKAGES.join(" "))),
            Err(reason) => (found, reason),
        }
    };
    let verdict = after.verdict(&problem);
    match &verdict {
        Verdict::Skipped(reason) if required("vulkan") => Err(format!("SURFEL_REQUIRE asks for vulkan, but: {reason}")),
        Verdict::Unvalidated(reason) | Verdict::Skipped(reason) if required("validation") => {
            Err(format!("SURFEL_REQUIRE asks for validation, but: {reason}"))
        }
        _ => Ok(verdict),
    }
}

impl Parts {
    fn find() -> Self {
        let system = System::from_environment();
        Self { loader: system.has_loader(), driver: system.has_driver(), layer: system.has_layer() }
    }

    fn missing(self) -> Vec<&'static str> {
        let parts = [
            (self.loader, "loader (libvulkan.so.1)"),
            (self.driver, "driver"),
            (self.layer, "validation layer (VK_LAYER_KHRONOS_validation)"),
        ];
        parts.into_iter().filter(|(is_there, _)| !is_there).map(|(_, name)| name).collect()
    }

    /// Returns which tests can run with these parts. `problem` is the reason why missing parts weren't installed.
    fn verdict(self, problem: &str) -> Verdict {
        let reason = format!("no {}, {problem}", self.missing().join(", no "));
        match self {
            Self { loader: true, driver: true, layer: true } => Verdict::Validated,
            Self { loader: true, driver: true, layer: false } => Verdict::Unvalidated(reason),
            _ => Verdict::Skipped(reason),
        }
    }
}

/// Folders and files in which Linux's Vulkan loader searches for libraries, drivers and layers.
struct System {
    /// Folders of libraries.
    libraries: Vec<PathBuf>,
    /// Driver manifests, or folders of driver manifests.
    drivers: Vec<PathBuf>,
    /// Manifests of explicit layers, or folders of such manifests.
    layers: Vec<PathBuf>,
}

impl System {
    fn from_environment() -> Self {
        let paths = |name: &str| -> Vec<PathBuf> {
            let value = std::env::var_os(name).unwrap_or_default();
            std::env::split_paths(&value).filter(|path| path != OsStr::new("")).collect()
        };
        let or = |paths: Vec<PathBuf>, usual: &[&str]| match paths.is_empty() {
            true => usual.iter().map(PathBuf::from).collect(),
            false => paths,
        };
        let home = std::env::home_dir().unwrap_or_default();
        let in_home = |paths: Vec<PathBuf>, usual: &str| or(paths, &[home.join(usual).to_string_lossy().as_ref()]);
        let mut roots = in_home(paths("XDG_CONFIG_HOME"), ".config");
        roots.extend(or(paths("XDG_CONFIG_DIRS"), &["/etc/xdg"]));
        roots.extend(["/etc", "/usr/local/etc"].map(PathBuf::from));
        roots.extend(in_home(paths("XDG_DATA_HOME"), ".local/share"));
        roots.extend(or(paths("XDG_DATA_DIRS"), &["/usr/local/share", "/usr/share"]));
        let usual = |folder: &str| roots.iter().map(|root| root.join("vulkan").join(folder)).collect::<Vec<_>>();
        // A variable of files or folders replaces the default folders. A variable of additional files doesn't replace
        // them.
        let chosen = |names: &[&str], added: &str, folder: &str| {
            let named: Vec<PathBuf> = names.iter().flat_map(|name| paths(name)).collect();
            let searched = if named.is_empty() { usual(folder) } else { named };
            paths(added).into_iter().chain(searched).collect()
        };
        let mut libraries = paths("LD_LIBRARY_PATH");
        libraries.push(format!("/usr/lib/{}-linux-gnu", std::env::consts::ARCH).into());
        libraries.extend(["/usr/lib", "/usr/lib64", "/lib", "/lib64", "/usr/local/lib"].map(PathBuf::from));
        Self {
            libraries,
            drivers: chosen(&["VK_DRIVER_FILES", "VK_ICD_FILENAMES"], "VK_ADD_DRIVER_FILES", "icd.d"),
            layers: chosen(&["VK_LAYER_PATH"], "VK_ADD_LAYER_PATH", "explicit_layer.d"),
        }
    }

    fn has_loader(&self) -> bool {
        self.has_library(Path::new(""), "libvulkan.so.1")
    }

    fn has_driver(&self) -> bool {
        manifests(&self.drivers).any(|path| self.manifest_works(&path))
    }

    fn has_layer(&self) -> bool {
        manifests(&self.layers).any(|path| {
            let is_named = |text: String| values(&text, "name").any(|name| name == LAYER);
            std::fs::read_to_string(&path).is_ok_and(is_named) && self.manifest_works(&path)
        })
    }

    /// True if the library exists that a manifest names.
    fn manifest_works(&self, manifest: &Path) -> bool {
        let text = std::fs::read_to_string(manifest).unwrap_or_default();
        let folder = manifest.parent().unwrap_or(Path::new(""));
        values(&text, "library_path").next().is_some_and(|library| self.has_library(folder, library))
    }

    /// True if the library exists. If its name contains a folder, it is relative to the manifest's folder; otherwise it
    /// is searched for in the folders of libraries.
    fn has_library(&self, folder: &Path, library: &str) -> bool {
        match library.contains('/') {
            true => folder.join(library).is_file(),
            false => self.libraries.iter().any(|folder| folder.join(library).is_file()),
        }
    }
}

/// Returns the manifest of Mesa's driver for AMD's GPUs, if it is installed.
pub(crate) fn amd_driver() -> Option<PathBuf> {
    let system = System::from_environment();
    let is_of_amd = |path: &PathBuf| {
        path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("radeon_icd"))
            && system.manifest_works(path)
    };
    manifests(&system.drivers).find(is_of_amd)
}

/// Returns the JSON files among `paths`, and those in folders among `paths`.
fn manifests(paths: &[PathBuf]) -> impl Iterator<Item = PathBuf> {
    let files = paths.iter().flat_map(|path| match std::fs::read_dir(path) {
        Ok(entries) => entries.flatten().map(|entry| entry.path()).collect(),
        Err(_) => vec![path.clone()],
    });
    files.filter(|path| path.extension().is_some_and(|extension| extension == "json"))
}

/// Returns the string values of a key in a JSON text.
fn values<'a>(text: &'a str, key: &str) -> impl Iterator<Item = &'a str> {
    let key = format!("\"{key}\"");
    let mut rest = text;
    std::iter::from_fn(move || {
        loop {
            rest = &rest[rest.find(&key)? + key.len()..];
            let value = rest.trim_start().strip_prefix(':').map(str::trim_start).and_then(|v| v.strip_prefix('"'));
            if let Some((value, _)) = value.and_then(|value| value.split_once('"')) {
                return Some(value);
            }
        }
    })
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
        // The output goes to stderr, so that it isn't mistaken for the command's result.
        runs(Command::new("apt-get").args(arguments).env("DEBIAN_FRONTEND", "noninteractive").stdout(std::io::stderr()))
    };
    // The existing package list may still suffice.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes a file of a mock installation.
    fn write(path: &Path, text: &str) {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    #[test]
    fn each_of_eight_installations_has_its_verdict() {
        let root = std::env::temp_dir().join(format!("surfel-vulkan-{}", std::process::id()));
        for bits in 0..8 {
            let expected = Parts { loader: bits & 1 != 0, driver: bits & 2 != 0, layer: bits & 4 != 0 };
            let folder = root.join(bits.to_string());
            let (libraries, drivers, layers) = (folder.join("lib"), folder.join("icd.d"), folder.join("layer.d"));
            // Mesa installs an explicit layer of its own beside the validation layer.
            write(
                &layers.join("overlay.json"),
                r#"{ "layer": { "name": "VK_LAYER_MESA_overlay", "library_path": "liboverlay.so" },
                     "note": "VK_LAYER_KHRONOS_validation" }"#,
            );
            write(&libraries.join("liboverlay.so"), "");
            if expected.loader {
                write(&libraries.join("libvulkan.so.1"), "");
            }
            if expected.driver {
                write(&drivers.join("lvp.json"), r#"{"ICD": {"library_path": "../lib/liblvp.so"}}"#);
                write(&libraries.join("liblvp.so"), "");
            } else {
                write(&drivers.join("gone.json"), r#"{"ICD": {"library_path": "libgone.so"}}"#);
            }
            if expected.layer {
                let layer = r#"{"layers": [{"name" : "VK_LAYER_KHRONOS_validation", "library_path":"libval.so"}]}"#;
                write(&layers.join("khronos.json"), layer);
                write(&libraries.join("libval.so"), "");
            }
            let system = System { libraries: vec![libraries], drivers: vec![drivers], layers: vec![layers] };
            let found = Parts { loader: system.has_loader(), driver: system.has_driver(), layer: system.has_layer() };
            assert_eq!(found, expected);
            // The problem is empty if all parts are found at once; the others follow a failed installation, or one
            // without root.
            for problem in ["", "and apt-get could not install it", "and not root"] {
                match (found.verdict(problem), expected.loader && expected.driver, expected.layer) {
                    (Verdict::Validated, true, true) => (),
                    (Verdict::Unvalidated(reason), true, false) => {
                        assert_eq!(reason, format!("no validation layer ({LAYER}), {problem}"));
                    }
                    (Verdict::Skipped(reason), false, _) => {
                        assert!(reason.ends_with(problem) && reason.starts_with("no "), "{reason}");
                    }
                    (verdict, ..) => panic!("{expected:?}: {verdict:?}"),
                }
            }
        }
        std::fs::remove_dir_all(root).unwrap();
    }
}
