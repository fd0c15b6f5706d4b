//! Test of the aarch64 wheel on a machine with another processor, without containers. QEMU emulates the processor for
//! one process, and a folder with Debian's packages for arm64 contains the Python interpreter. Nothing is installed
//! into the machine.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::programs::is_bootstrapped;
use super::{Place, files_in, fresh, is_here, ran};
use crate::python;

/// Names of QEMU's emulator of the processor, in packages of distributions.
const EMULATORS: [&str; 2] = ["qemu-aarch64-static", "qemu-aarch64"];

/// Debian release whose Python interpreter is tested. Its mirror, and the interpreter's path and version, follow.
const RELEASE: &str = "bookworm";
const MIRROR: &str = "http://deb.debian.org/debian";
const INTERPRETER: &str = "usr/bin/python3.11";
const PYTHON: &str = "3.11";

/// Target of Rust whose wheel is tested.
pub(super) const TRIPLE: &str = "aarch64-unknown-linux-gnu";

/// Options of debootstrap: the packages are downloaded, but their installation scripts don't run.
const OPTIONS: [&str; 4] = ["--variant=minbase", "--foreign", "--arch=arm64", "--include=python3"];

/// Tags of the wheels that glibc of the Debian release can load, for pip.
const TAGS: [&str; 3] = ["manylinux2014_aarch64", "manylinux_2_27_aarch64", "manylinux_2_28_aarch64"];

/// Emulator, and a folder with Python for aarch64.
pub(super) struct Emulated {
    emulator: &'static str,
    folder: PathBuf,
}

impl Emulated {
    /// Finds the emulator, and unpacks Python for it. Downloads Debian's packages if the folder of the dry run doesn't
    /// contain them yet. The error names the missing program.
    pub(super) fn new(place: &Place) -> Result<Self, String> {
        let found = EMULATORS.into_iter().find(|emulator| is_here(emulator, "--version"));
        let emulator = found.ok_or("no qemu-aarch64-static (apt-get install qemu-user-static)")?;
        for (program, package) in [("debootstrap", "debootstrap"), ("dpkg-deb", "dpkg")] {
            if !is_here(program, "--version") {
                return Err(format!("no {program} (apt-get install {package})"));
            }
        }
        let downloaded = place.out.join("arm64-packages");
        if !is_bootstrapped(&downloaded, RELEASE, MIRROR, &OPTIONS)? {
            return Err(format!("debootstrap can't download Debian {RELEASE}"));
        }
        let folder = place.out.join("arm64");
        fresh(&folder)?;
        for package in files_in(&downloaded.join("var/cache/apt/archives"), &[".deb"]) {
            ran(Command::new("dpkg-deb").arg("--extract").arg(package).arg(&folder))?;
        }
        Ok(Self { emulator, folder })
    }

    /// Installs a wheel and the packages that it needs into an empty folder, and runs a program with them, in the
    /// program's own folder.
    pub(super) fn run(&self, place: &Place, wheel: &Path, program: &Path) -> Result<(), String> {
        let site = place.out.join("arm64-site");
        fresh(&site)?;
        let mut install = Command::new(python::environment(&place.root, &[])?);
        install.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary", ":all:"]);
        install.args(["--python-version", PYTHON]).args(TAGS.iter().flat_map(|tag| ["--platform", tag]));
        ran(install.arg("--target").arg(&site).arg(wheel))?;
        let mut draw = Command::new(self.emulator);
        draw.arg("-L").arg(&self.folder).arg(self.folder.join(INTERPRETER)).arg(program);
        ran(draw.env("PYTHONPATH", &site).current_dir(program.parent().unwrap_or(&site)))
    }
}
