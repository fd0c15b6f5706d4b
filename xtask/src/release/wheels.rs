//! Steps for the Python package: wheels and the source distribution.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use super::emulated::{self, Emulated};
use super::{Place, Verdict, bytes_of, epoch, files_in, fresh, is_here, name_of, output, ran};
use crate::front_page;
use crate::python::{self, Platform, TARGETS};

/// Maximum size of a wheel, in bytes.
const MAX_BYTES: u64 = 25_000_000;

/// Python code appended to README.md's program, which checks the drawn image.
const CHECKS: &str = "\
assert image.rgba.shape == (768, 1024, 4), image.rgba.shape
assert image.rgba[384, 512, 3] == 255, image.rgba[384, 512]
print('drew', image.rgba.shape)
";

/// Python code appended to the program if GPU backends aren't installed. It checks that the error names a pip command.
const WITHOUT_GPU: &str = "\
try:
    surfel.open('scan.ply').render(size=(8, 8), backend='wgpu')
except surfel.BackendError as error:
    assert 'pip install' in str(error) and '--features gpu' in str(error), error
else:
    raise SystemExit('wgpu is built in')
";

/// Number of points in the file that README.md's Python program opens.
const POINTS: u32 = 4000;

/// Name of the folder, in that of the dry run, with README.md's Python program and the file that it opens.
const PAGE: &str = "front-page";

/// Writes README.md's Python program with checks appended, and the scan that it opens: points on a sphere. Returns the
/// path of the program.
fn write_page(place: &Place, checks: &[&str]) -> Result<PathBuf, String> {
    let folder = place.out.join(PAGE);
    fresh(&folder)?;
    let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
    let readme = std::fs::read_to_string(place.root.join("README.md")).map_err(failed)?;
    let program = front_page::python_of(&readme).ok_or("README.md has no program under '## In Python'")?;
    std::fs::write(folder.join("scan.ply"), sphere(POINTS)).map_err(failed)?;
    let file = folder.join("page.py");
    std::fs::write(&file, format!("{program}{}", checks.concat())).map_err(failed)?;
    Ok(file)
}

/// Returns a PLY file of points that are evenly distributed over the unit sphere, along a spiral.
fn sphere(points: u32) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {points}\nproperty float x\nproperty float y\nproperty float z\n"
    );
    text += "end_header\n";
    let turn = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    for i in 0..points {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(points);
        let radius = (1.0 - z * z).sqrt();
        let (sin, cos) = (turn * f64::from(i)).sin_cos();
        text += &format!("{:.6} {:.6} {z:.6}\n", radius * cos, radius * sin);
    }
    text
}

fn wheels(place: &Place) -> PathBuf {
    place.out.join("wheels")
}

/// Builds the wheels of all platforms whose targets rustup has installed. Builds them twice, in different folders, and
/// checks that both builds are identical. Checks sizes and contents.
pub(super) fn build(place: &Place) -> Verdict {
    let installed: Vec<&Platform> = TARGETS.iter().filter(|platform| platform.is_installed(&place.root)).collect();
    if installed.is_empty() {
        return Verdict::Skipped(format!("rustup has no target: rustup target add {}", TARGETS[0].triple));
    }
    let built = || {
        let (first, second) = (wheels(place), place.out.join("wheels-again"));
        let builds = [(&first, place.out.join("wheels-target")), (&second, place.out.join("wheels-again-target"))];
        for (folder, _) in &builds {
            fresh(folder)?;
        }
        for platform in &installed {
            for (folder, target) in &builds {
                let start = Instant::now();
                python::wheel_of(&place.root, platform, folder, target, &epoch(&place.root))?;
                println!("{}: built in {:.0} s", platform.triple, start.elapsed().as_secs_f64());
            }
        }
        let made = files_in(&first, &[".whl"]);
        for wheel in &made {
            let bytes = bytes_of(wheel);
            println!("{:>8} KB  {}", bytes / 1000, name_of(wheel));
            if bytes > MAX_BYTES {
                return Err(format!("{}: {bytes} bytes, expected at most {MAX_BYTES}", name_of(wheel)));
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
        let sizes: Vec<String> =
            made.iter().map(|wheel| format!("{} {} KB", name_of(wheel), bytes_of(wheel) / 1000)).collect();
        let missing: Vec<&str> = TARGETS.iter().map(|platform| platform.triple).collect();
        let missing = python::not_installed(&place.root, &missing);
        Ok(format!("{}, each built twice with the same bits{missing}", sizes.join(", ")))
    };
    built().into()
}

/// Installs each wheel into a fresh environment, and runs README.md's program there. This machine's wheel is tested in
/// a virtual environment. All wheels are tested in containers of their platforms if docker is installed (other
/// processors by qemu-user). Without docker, QEMU alone tests the manylinux wheel for aarch64.
pub(super) fn environments(place: &Place) -> Verdict {
    let made = files_in(&wheels(place), &[".whl"]);
    if made.is_empty() {
        return Verdict::Skipped("there are no wheels: run the step wheels before environments".to_owned());
    }
    let tried = || {
        let page = write_page(place, &[CHECKS])?;
        let has_docker = is_here("docker", "info");
        let own = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
        let (mut tried, mut untried) = (0, Vec::new());
        for wheel in &made {
            let name = name_of(wheel);
            let platform = TARGETS.iter().find(|platform| platform.made(&name));
            let platform = platform.ok_or_else(|| format!("{name}: is for no known platform"))?;
            let is_own = cfg!(target_env = "gnu") && platform.triple == own;
            if is_own {
                in_environment(&place.out.join("environment"), wheel, &page)?;
            }
            if has_docker {
                in_container(place, platform, wheel)?;
            }
            if is_own || has_docker {
                tried += 1;
            } else if platform.triple == emulated::TRIPLE {
                match Emulated::new(place) {
                    Ok(emulated) => {
                        emulated.run(place, wheel, &page)?;
                        tried += 1;
                    }
                    Err(why) => untried.push(format!("{name} ({why})")),
                }
            } else {
                untried.push(name);
            }
        }
        Ok(outcome(tried, has_docker, &untried))
    };
    tried().unwrap_or_else(Verdict::Failed)
}

/// Returns the verdict if `tried` wheels drew an image. It passes if at least one did.
fn outcome(tried: usize, has_docker: bool, untried: &[String]) -> Verdict {
    let mut detail = format!("{tried} of {} wheels drew in a fresh environment", tried + untried.len());
    if !untried.is_empty() {
        detail += &format!("; not tried: {}", untried.join(", "));
    }
    if !has_docker {
        detail += "; docker doesn't run, so none was tried in a container";
    }
    if tried == 0 { Verdict::Skipped(detail) } else { Verdict::Passed(detail) }
}

/// Installs a wheel into a new virtual environment, and runs a program in the program's own folder.
fn in_environment(folder: &Path, wheel: &Path, program: &Path) -> Result<(), String> {
    fresh(folder)?;
    ran(Command::new("python3").args(["-m", "venv"]).arg(folder))?;
    let python = folder.join("bin").join("python");
    ran(Command::new(&python).args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]).arg(wheel))?;
    let mut draw = Command::new(&python);
    ran(draw.arg(program).current_dir(program.parent().unwrap_or(folder)))
}

/// Installs a wheel into a container, and runs README.md's program.
fn in_container(place: &Place, platform: &Platform, wheel: &Path) -> Result<(), String> {
    let script = format!("pip install --quiet /out/wheels/{} && cd /out/{PAGE} && python page.py", name_of(wheel));
    let mut command = Command::new("docker");
    command.args(["run", "--rm", "--platform", platform.docker, "--volume"]);
    command.arg(format!("{}:/out:ro", place.out.display()));
    ran(command.args([platform.image, "sh", "-c", &script]))
}

/// Makes the source distribution. Builds a wheel from it outside of the checkout, and tests the wheel.
pub(super) fn source(place: &Place) -> Verdict {
    let python = match python::environment(&place.root, &python::BUILD_PACKAGES) {
        Ok(python) => python,
        Err(why) => return Verdict::Skipped(why),
    };
    let built = || {
        let folder = place.out.join("sdist");
        fresh(&folder)?;
        let mut sdist = Command::new(&python);
        ran(sdist.current_dir(&place.root).args(["-m", "maturin", "sdist", "--out"]).arg(&folder))?;
        let archive = files_in(&folder, &[".tar.gz"]).pop().ok_or("maturin made no source distribution")?;
        let elsewhere = std::env::temp_dir().join(format!("surfel-sdist-{}", std::process::id()));
        fresh(&elsewhere)?;
        let mut build = Command::new(&python);
        build.current_dir(&elsewhere).args(["-m", "pip", "wheel", "--no-deps", "--wheel-dir"]).arg(&elsewhere);
        ran(build.arg(&archive).env("CARGO_TARGET_DIR", place.out.join("sdist-target")))?;
        let wheel = files_in(&elsewhere, &[".whl"]).pop().ok_or("pip made no wheel")?;
        in_environment(&elsewhere.join("environment"), &wheel, &write_page(place, &[CHECKS, WITHOUT_GPU])?)?;
        std::fs::remove_dir_all(&elsewhere).map_err(|error| format!("{}: {error}", elsewhere.display()))?;
        Ok(format!("{}, {} KB, builds and draws", name_of(&archive), bytes_of(&archive) / 1000))
    };
    built().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn environments_pass_only_if_a_wheel_drew() {
        let untried = ["a.whl".to_owned(), "b.whl".to_owned()];
        assert!(matches!(outcome(0, true, &untried), Verdict::Skipped(why) if why.contains("a.whl, b.whl")));
        assert!(matches!(outcome(1, false, &untried), Verdict::Passed(detail) if detail.starts_with("1 of 3")));
    }

    #[test]
    fn sphere_is_a_file_of_points_at_distance_one() {
        let text = sphere(100);
        let (header, rows) = text.split_once("end_header\n").unwrap();
        assert!(header.contains("element vertex 100\n"));
        assert_eq!(rows.lines().count(), 100);
        for row in rows.lines() {
            let squares = row.split(' ').map(|number| number.parse::<f64>().unwrap().powi(2));
            assert!((squares.sum::<f64>() - 1.0).abs() < 1e-5, "{row}");
        }
    }
}
