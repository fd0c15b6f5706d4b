//! Steps for the program: tarballs for any Linux, and Debian packages.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{Place, Verdict, bytes_of, epoch, files_in, fresh, is_here, name_of, output, ran, version};
use crate::{cargo, python, web};

/// Platforms of the program: target triple, and Debian's name of the processor architecture.
const PLATFORMS: [(&str, &str); 2] = [("x86_64-unknown-linux-gnu", "amd64"), ("aarch64-unknown-linux-gnu", "arm64")];

/// Maintainer of the Debian packages: name and e-mail address of the owner.
const MAINTAINER: &str = "The Surfel authors <surfel@example.invalid>";

/// Version of the oldest glibc with which the program runs.
const GLIBC: &str = "2.17";

/// Debian releases with their versions of glibc and their mirrors, the oldest first. The program is tested in the first
/// release that can be downloaded.
const OLD_DEBIANS: [[&str; 3]; 4] = [
    ["jessie", "2.19", "http://archive.debian.org/debian"],
    ["buster", "2.28", "http://archive.debian.org/debian"],
    ["bullseye", "2.31", "http://deb.debian.org/debian"],
    ["bookworm", "2.36", "http://deb.debian.org/debian"],
];

/// Text files that every package of the program contains.
const TEXTS: [&str; 6] =
    ["README.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE", "THIRD-PARTY.txt", "packaging/surfel.cdx.json"];

/// Builds the drawing modules of exported pages, which packages and the program embed.
pub(super) fn web(place: &Place) -> Verdict {
    if !web::build(&place.root) {
        return Verdict::Failed("cargo xtask web failed".to_owned());
    }
    let modules = files_in(&place.root.join(web::MODULES), &[".wasm"]);
    let sizes = modules.iter().map(|module| format!("{} {} KB", name_of(module), bytes_of(module) / 1000));
    Verdict::Passed(sizes.collect::<Vec<_>>().join(", "))
}

/// Builds the program with all features for each platform whose target rustup has installed, and makes tarballs with
/// checksums.
pub(super) fn tarball(place: &Place) -> Verdict {
    let zig = [("ziglang", "ziglang"), ("cargo-zigbuild", "cargo_zigbuild")];
    let python = match python::environment(&place.root, &zig) {
        Ok(python) => python,
        Err(why) => return Verdict::Skipped(why),
    };
    let built = || {
        fresh(&place.out.join("programs"))?;
        let (mut made, mut symbols) = (Vec::new(), Vec::new());
        for (triple, _) in PLATFORMS {
            if !python::has_target(&place.root, triple) {
                println!("{triple}: skipped, rustup target add {triple}");
                continue;
            }
            let mut command = cargo(&place.root);
            command.args(["zigbuild", "--release", "--locked", "--package", "surfel-cli", "--all-features"]);
            command.args(["--target", &format!("{triple}.{GLIBC}")]);
            command.env("PATH", python::path(&place.root)?).env("CARGO_ZIGBUILD_PYTHON_PATH", &python);
            ran(&mut command)?;
            let program = python::target(&place.root).join(triple).join("release").join("surfel");
            symbols.push(needed_glibc(&program)?);
            made.push(pack(place, &program, triple)?);
        }
        if made.is_empty() {
            return Err("no platform was built".to_owned());
        }
        checksums(&place.out.join("programs"))?;
        let tried = in_old_debian(place)?;
        let missing = python::not_installed(&place.root, &PLATFORMS.map(|(triple, _)| triple));
        let sizes = made.iter().map(|tarball| format!("{} {} KB", name_of(tarball), bytes_of(tarball) / 1000));
        Ok(format!("{}{missing}; {}; {tried}", sizes.collect::<Vec<_>>().join(", "), symbols.join(", ")))
    };
    built().into()
}

/// Copies the files of an installation into a folder: program, completions, manual page and texts. `documents` is the
/// prefix of the texts' paths in the folder.
fn stage(place: &Place, program: &Path, folder: &Path, documents: &str) -> Result<(), String> {
    // Completions and the manual page don't depend on the processor, so the host's program generates them if it exists.
    let host = python::target(&place.root).join(PLATFORMS[0].0).join("release").join("surfel");
    let printer = if host.is_file() { &host } else { program };
    let write = |name: &str, bytes: &[u8]| {
        let file = folder.join(name);
        let written =
            std::fs::create_dir_all(file.parent().unwrap_or(folder)).and_then(|()| std::fs::write(&file, bytes));
        written.map_err(|error| format!("{}: {error}", file.display()))
    };
    let printed = |words: &[&str]| output(Command::new(printer).args(words));
    write("share/man/man1/surfel.1", &printed(&["man"])?)?;
    write("share/bash-completion/completions/surfel", &printed(&["completions", "bash"])?)?;
    write("share/zsh/site-functions/_surfel", &printed(&["completions", "zsh"])?)?;
    write("share/fish/vendor_completions.d/surfel.fish", &printed(&["completions", "fish"])?)?;
    for name in TEXTS {
        let bytes = std::fs::read(place.root.join(name)).map_err(|error| format!("{name}: {error}"))?;
        write(&format!("{documents}{}", name_of(Path::new(name))), &bytes)?;
    }
    let copy = || {
        std::fs::create_dir_all(folder.join("bin"))?;
        std::fs::copy(program, folder.join("bin").join("surfel"))
    };
    copy().map_err(|error| format!("{}: {error}", program.display()))?;
    Ok(())
}

/// Makes the tarball of a platform. Its bytes don't depend on the time and the machine.
fn pack(place: &Place, program: &Path, triple: &str) -> Result<PathBuf, String> {
    let name = format!("surfel-{}-{triple}", version(&place.root)?);
    let programs = place.out.join("programs");
    let folder = programs.join(&name);
    fresh(&folder)?;
    stage(place, program, &folder, "")?;
    let tarball = programs.join(format!("{name}.tar.gz"));
    let mut tar = Command::new("tar");
    tar.current_dir(&programs).args(["--sort=name", "--owner=0", "--group=0", "--numeric-owner", "--mode=u=rwX,go=rX"]);
    tar.arg(format!("--mtime=@{}", epoch(&place.root))).args(["--use-compress-program=gzip -9 -n", "-cf"]);
    ran(tar.arg(&tarball).arg(&name))?;
    Ok(tarball)
}

/// Writes the file SHA256SUMS with the checksums of a folder's archives.
fn checksums(folder: &Path) -> Result<(), String> {
    let names = files_in(folder, &[".tar.gz", ".deb"]);
    let sums = output(Command::new("sha256sum").current_dir(folder).args(names.iter().map(|file| name_of(file))))?;
    std::fs::write(folder.join("SHA256SUMS"), sums).map_err(|error| format!("SHA256SUMS: {error}"))
}

/// Checks that a program needs no version of glibc that is newer than [`GLIBC`]. The returned text states the version,
/// or that nothing was checked because readelf is missing.
fn needed_glibc(program: &Path) -> Result<String, String> {
    if !is_here("readelf", "--version") {
        return Ok("symbols not checked: no readelf (apt-get install binutils)".to_owned());
    }
    let printed = output(Command::new("readelf").args(["--version-info", "--wide"]).arg(program))?;
    let newest = newest_glibc(&String::from_utf8_lossy(&printed));
    let [major, minor] = newest.ok_or_else(|| format!("{}: needs no symbol of glibc", program.display()))?;
    match numbers(GLIBC) {
        Some(oldest) if [major, minor] <= oldest => Ok(format!("symbols of glibc {major}.{minor} at most")),
        _ => Err(format!("{}: needs glibc {major}.{minor}, expected at most {GLIBC}", program.display())),
    }
}

/// Returns the newest version of glibc in readelf's list of symbol versions, as major and minor number.
fn newest_glibc(listed: &str) -> Option<[u32; 2]> {
    listed.split_whitespace().filter_map(|word| numbers(word.strip_prefix("GLIBC_")?)).max()
}

/// Parses the major and minor number of a version.
fn numbers(version: &str) -> Option<[u32; 2]> {
    let mut parts = version.split('.').map_while(|part| part.parse().ok());
    Some([parts.next()?, parts.next()?])
}

/// Draws an image with the tarball's program, in a folder with an old Debian release. The returned text states what was
/// tested, or why nothing was.
fn in_old_debian(place: &Place) -> Result<String, String> {
    let own = format!("surfel-{}-{}-unknown-linux-gnu", version(&place.root)?, std::env::consts::ARCH);
    let program = place.out.join("programs").join(own).join("bin").join("surfel");
    if !program.is_file() {
        return Ok("not tried in an old Debian: no program for this processor".to_owned());
    }
    if !is_here("debootstrap", "--version") {
        return Ok("not tried in an old Debian: no debootstrap (apt-get install debootstrap)".to_owned());
    }
    let mut unreachable = Vec::new();
    for [release, glibc, mirror] in OLD_DEBIANS {
        let folder = place.out.join(release);
        if !is_bootstrapped(&folder, release, mirror, &["--no-check-gpg", "--variant=minbase"])? {
            unreachable.push(release);
            continue;
        }
        let put = |from: &Path, to: &str| {
            std::fs::copy(from, folder.join(to)).map_err(|error| format!("{}: {error}", from.display()))
        };
        put(&program, "surfel")?;
        put(&place.root.join("assets").join("spot").join("spot.obj"), "spot.obj")?;
        ran(Command::new("chroot").arg(&folder).args(["/surfel", "/spot.obj", "-o", "/spot.png", "--force"]))?;
        let skipped = match unreachable.is_empty() {
            true => String::new(),
            false => format!(", not in {}, which debootstrap can't make here", unreachable.join(" and ")),
        };
        return Ok(format!("draws in Debian {release} (glibc {glibc}){skipped}"));
    }
    Ok(format!("not tried in an old Debian: debootstrap makes none of {}", unreachable.join(", ")))
}

/// Returns true if the folder contains the Debian release. If there is no folder, debootstrap creates it with these
/// options; false means that debootstrap failed. The folder gets its final name when it is complete.
pub(super) fn is_bootstrapped(folder: &Path, release: &str, mirror: &str, options: &[&str]) -> Result<bool, String> {
    if folder.is_dir() {
        return Ok(true);
    }
    let part = folder.with_extension("part");
    fresh(&part)?;
    let mut bootstrap = Command::new("debootstrap");
    bootstrap.args(options).arg(release).arg(&part);
    if let Err(why) = ran(bootstrap.arg(mirror)) {
        println!("{why}");
        return fresh(&part).map(|()| false);
    }
    std::fs::rename(&part, folder).map(|()| true).map_err(|error| format!("{}: {error}", part.display()))
}

/// Makes the Debian packages of the programs that the step `tarball` has built.
pub(super) fn debian(place: &Place) -> Verdict {
    if !is_here("dpkg-deb", "--version") {
        return Verdict::Skipped("no dpkg-deb: apt-get install dpkg".to_owned());
    }
    let built = || {
        let mut made = Vec::new();
        for (triple, processor) in PLATFORMS {
            let program = python::target(&place.root).join(triple).join("release").join("surfel");
            if program.is_file() {
                made.push(package(place, &program, processor)?);
            }
        }
        let tried = made.iter().find(|deb| name_of(deb).contains("amd64")).map(|deb| inspected(deb)).transpose()?;
        match (made.is_empty(), tried) {
            (true, _) => Ok(Verdict::Skipped("no program: run the step tarball before debian".to_owned())),
            (false, tried) => {
                checksums(&place.out.join("programs"))?;
                let sizes = made.iter().map(|deb| format!("{} {} KB", name_of(deb), bytes_of(deb) / 1000));
                let sizes: Vec<String> = sizes.chain(tried).collect();
                Ok(Verdict::Passed(sizes.join(", ")))
            }
        }
    };
    built().unwrap_or_else(Verdict::Failed)
}

/// Makes the Debian package for a processor architecture.
fn package(place: &Place, program: &Path, processor: &str) -> Result<PathBuf, String> {
    let version = version(&place.root)?;
    let programs = place.out.join("programs");
    let folder = programs.join(format!("debian-{processor}"));
    fresh(&folder.join("DEBIAN"))?;
    stage(place, program, &folder.join("usr"), "share/doc/surfel/")?;
    ran(Command::new("gzip").args(["-9", "-n"]).arg(folder.join("usr/share/man/man1/surfel.1")))?;
    // Debian's policy requires other names for these files of the tarball.
    let documents = folder.join("usr/share/doc/surfel");
    let rename = |from: &str, to: &str| {
        std::fs::rename(documents.join(from), documents.join(to)).map_err(|error| format!("{from}: {error}"))
    };
    rename("LICENSE-MIT", "copyright")?;
    rename("CHANGELOG.md", "changelog")?;
    ran(Command::new("gzip").args(["-9", "-n"]).arg(documents.join("changelog")))?;
    let zsh = folder.join("usr/share/zsh");
    std::fs::create_dir_all(zsh.join("vendor-completions")).map_err(|error| error.to_string())?;
    std::fs::rename(zsh.join("site-functions/_surfel"), zsh.join("vendor-completions/_surfel"))
        .and_then(|()| std::fs::remove_dir(zsh.join("site-functions")))
        .map_err(|error| format!("{}: {error}", zsh.display()))?;
    std::fs::write(folder.join("DEBIAN/control"), control(&version, processor, kibibytes(&folder)))
        .map_err(|error| format!("control: {error}"))?;
    let deb = programs.join(format!("surfel_{version}_{processor}.deb"));
    let mut build = Command::new("dpkg-deb");
    build.env("SOURCE_DATE_EPOCH", epoch(&place.root)).args(["--root-owner-group", "-Zxz", "--build"]);
    ran(build.arg(&folder).arg(&deb))?;
    Ok(deb)
}

/// Description of the Debian package, wrapped as Debian's policy requires.
const DESCRIPTION: &str = "\
Description: draws scans, point clouds and meshes as smooth surfaces
 Each point becomes a small disk that lies in the surface, filtered for the
 screen and blended with its neighbours. Surfel draws images with depth and
 normals, and orthoimages and surface models as GeoTIFF. It needs no GPU.
";

fn control(version: &str, processor: &str, kibibytes: u64) -> String {
    format!(
        "Package: surfel\nVersion: {version}\nArchitecture: {processor}\n\
         Maintainer: {MAINTAINER}\nInstalled-Size: {kibibytes}\n\
         Depends: libc6 (>= {GLIBC}), libgcc-s1 | libgcc1\nRecommends: libvulkan1\nSection: graphics\n\
         Priority: optional\nHomepage: https://example.invalid/surfel\n{DESCRIPTION}"
    )
}

/// Returns the total size of the files in a folder, in KiB.
fn kibibytes(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let sizes = entries.map(|path| if path.is_dir() { kibibytes(&path) } else { bytes_of(&path).div_ceil(1024) });
    sizes.sum()
}

/// Unpacks a Debian package and, on x86-64, asks its program for the version. The returned text states the version, or
/// that the program wasn't tried.
fn inspected(deb: &Path) -> Result<String, String> {
    let folder = deb.with_extension("unpacked");
    fresh(&folder)?;
    ran(Command::new("dpkg-deb").arg("--extract").arg(deb).arg(&folder))?;
    if !cfg!(target_arch = "x86_64") {
        return Ok("its program wasn't tried on this processor".to_owned());
    }
    let printed = output(Command::new(folder.join("usr/bin/surfel")).arg("--version"))?;
    Ok(format!("its program is {}", String::from_utf8_lossy(&printed).trim()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newest_version_of_glibc_is_compared_by_number() {
        let listed = "0x0010: Name: GLIBC_2.9  Flags: none\n0x0020: Name: GLIBC_2.2.5\n Name: GLIBC_2.17 Version: 3\n\
                      0x0030: Name: GCC_4.2.0\n 0x40: Name: GLIBC_PRIVATE";
        assert_eq!(newest_glibc(listed), Some([2, 17]));
        assert_eq!(newest_glibc("Name: GCC_4.2.0"), None);
        assert!(numbers("2.9") < numbers(GLIBC) && numbers("2.18") > numbers(GLIBC));
    }

    #[test]
    fn half_made_debian_is_not_reused() {
        let folder = std::env::temp_dir().join(format!("surfel-debian-{}", std::process::id()));
        let part = folder.with_extension("part");
        std::fs::create_dir_all(part.join("usr")).unwrap();
        let made = is_bootstrapped(&folder, "no-such-release", "file:///no-such-mirror", &[]);
        let left = std::fs::read_dir(&part).unwrap().count();
        std::fs::remove_dir_all(&part).unwrap();
        assert_eq!((made, folder.exists(), left), (Ok(false), false, 0));
    }

    #[test]
    fn debian_control_has_the_fields_of_policy() {
        let control = control("1.2.3", "amd64", 7);
        for field in ["Package: surfel", "Version: 1.2.3", "Architecture: amd64", "Installed-Size: 7", "Maintainer: "] {
            assert!(control.lines().any(|line| line.starts_with(field)), "{field}");
        }
        assert!(
            control.ends_with(".\n") && control.lines().all(|line| !line.is_empty() && line.len() <= 80),
            "{control}"
        );
    }
}
