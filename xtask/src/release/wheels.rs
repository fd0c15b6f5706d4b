//! Steps on the Python package: wheels and the source distribution.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{Place, Verdict, bytes_of, epoch, files_in, fresh, is_here, name_of, output, ran};
use crate::python::{self, Platform, TARGETS};

/// Maximum size of a wheel in bytes.
const MOST_BYTES: u64 = 25_000_000;

/// Program that a fresh environment runs: the image of a few points, drawn without any file of the checkout.
const SNIPPET: &str = "\
import numpy, surfel
points = numpy.random.default_rng(1).normal(size=(2000, 3))
points /= numpy.linalg.norm(points, axis=1)[:, None]
image = surfel.scene(points).render(size=(64, 48))
assert image.rgba.shape == (48, 64, 4) and image.rgba[24, 32, 3] == 255, image.rgba[24, 32]
print('drew', image.rgba.shape)
";

fn wheels(place: &Place) -> PathBuf {
    place.out.join("wheels")
}

/// Builds the wheels twice, in different folders, and compares their bits. Checks sizes and contents.
pub(super) fn build(place: &Place) -> Verdict {
    let installed: Vec<&Platform> = TARGETS.iter().filter(|platform| platform.is_installed(&place.root)).collect();
    if installed.is_empty() {
        return Verdict::Skipped(format!("rustup has no target: rustup target add {}", TARGETS[0].triple));
    }
    let built = || {
        let (first, second) = (wheels(place), place.out.join("wheels-again"));
        for (folder, target) in [(&first, "wheels-target"), (&second, "wheels-again-target")] {
            fresh(folder)?;
            for platform in &installed {
                python::wheel_of(&place.root, platform, folder, &place.out.join(target), &epoch(&place.root))?;
            }
        }
        let made = files_in(&first, &[".whl"]);
        for wheel in &made {
            let bytes = bytes_of(wheel);
            println!("{:>8} KB  {}", bytes / 1000, name_of(wheel));
            if bytes > MOST_BYTES {
                return Err(format!("{}: {bytes} bytes, expected at most {MOST_BYTES}", name_of(wheel)));
            }
            if std::fs::read(wheel).ok() != std::fs::read(second.join(name_of(wheel))).ok() {
                return Err(format!("{}: two builds differ", name_of(wheel)));
            }
            let listed = output(Command::new("python3").args(["-m", "zipfile", "-l"]).arg(wheel))?;
            let listed = String::from_utf8_lossy(&listed);
            for part in ["/sboms/surfel.cdx.json", "THIRD-PARTY.txt", "surfel/__init__.py", "_native.abi3.so"] {
                if !listed.contains(part) {
                    return Err(format!("{}: lacks {part}", name_of(wheel)));
                }
            }
        }
        if made.len() != installed.len() {
            return Err(format!("{} wheels, expected {}", made.len(), installed.len()));
        }
        let missing = TARGETS.len() - installed.len();
        let missing = if missing == 0 { String::new() } else { format!("; {missing} targets aren't installed") };
        Ok(format!("{} wheels, each built twice with the same bits{missing}", made.len()))
    };
    built().into()
}

/// Installs each wheel into a fresh environment and draws: this machine's in a virtual environment, and all in
/// containers of their platforms, where docker runs them (other processors by qemu-user).
pub(super) fn environments(place: &Place) -> Verdict {
    let made = files_in(&wheels(place), &[".whl"]);
    if made.is_empty() {
        return Verdict::Skipped("no wheels were built".to_owned());
    }
    let tried = || {
        let snippet = place.out.join("snippet.py");
        std::fs::write(&snippet, SNIPPET).map_err(|error| error.to_string())?;
        let own = format!("_{}.whl", std::env::consts::ARCH);
        let mut tried = 0;
        if cfg!(target_env = "gnu") {
            for wheel in
                made.iter().filter(|wheel| name_of(wheel).contains("manylinux") && name_of(wheel).ends_with(&own))
            {
                in_environment(place, &place.out.join("environment"), wheel, &snippet)?;
                tried += 1;
            }
        }
        let has_docker = is_here("docker", "info");
        for platform in TARGETS.iter().filter(|_| has_docker) {
            for wheel in made.iter().filter(|wheel| platform.made(&name_of(wheel))) {
                in_container(place, platform, wheel)?;
                tried += 1;
            }
        }
        let rest = if has_docker { "" } else { "; without docker, those of other platforms weren't tried" };
        Ok(format!("{tried} environments drew{rest}"))
    };
    tried().into()
}

/// Installs a wheel into a virtual environment, and draws from an empty folder.
fn in_environment(place: &Place, folder: &Path, wheel: &Path, snippet: &Path) -> Result<(), String> {
    fresh(folder)?;
    ran(Command::new("python3").args(["-m", "venv"]).arg(folder))?;
    let python = folder.join("bin").join("python");
    ran(Command::new(&python).args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]).arg(wheel))?;
    ran(Command::new(&python).arg(snippet).current_dir(&place.out))
}

/// Installs a wheel into a container, and draws.
fn in_container(place: &Place, platform: &Platform, wheel: &Path) -> Result<(), String> {
    let script = format!("pip install --quiet /out/wheels/{} && python /out/snippet.py", name_of(wheel));
    let mut command = Command::new("docker");
    command.args(["run", "--rm", "--platform", platform.docker, "--volume"]);
    command.arg(format!("{}:/out:ro", place.out.display()));
    ran(command.args([platform.image, "sh", "-c", &script]))
}

/// Makes the source distribution, and builds and tries a wheel of it outside of the checkout.
pub(super) fn source(place: &Place) -> Verdict {
    let python = match python::environment(&place.root, &python::BUILT_BY) {
        Ok(python) => python,
        Err(why) => return Verdict::Skipped(why),
    };
    let built = || {
        let folder = place.out.join("sdist");
        fresh(&folder)?;
        let mut sdist = Command::new(&python);
        ran(sdist.current_dir(&place.root).args(["-m", "maturin", "sdist", "--out"]).arg(&folder))?;
        let archive = files_in(&folder, &[".tar.gz"]).pop().ok_or("maturin made no source distribution")?;
        let elsewhere = std::env::temp_dir().join("surfel-sdist");
        fresh(&elsewhere)?;
        let mut build = Command::new(&python);
        build.current_dir(&elsewhere).args(["-m", "pip", "wheel", "--no-deps", "--wheel-dir"]).arg(&elsewhere);
        ran(build.arg(&archive))?;
        let wheel = files_in(&elsewhere, &[".whl"]).pop().ok_or("pip made no wheel")?;
        let snippet = place.out.join("snippet.py");
        std::fs::write(&snippet, SNIPPET).map_err(|error| error.to_string())?;
        in_environment(place, &elsewhere.join("environment"), &wheel, &snippet)?;
        Ok(format!("{}, {} KB, builds and draws", name_of(&archive), bytes_of(&archive) / 1000))
    };
    built().into()
}
