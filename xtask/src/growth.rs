//! `cargo xtask growth`: measures the cost of converting points to levels of detail and drawing them, by number of
//! points.

use crate::cargo;
use std::path::Path;
use std::process::{Command, Stdio};

const HELP: &str = "\
Usage: cargo xtask growth FOLDER MILLIONS...

Generates so many million points as LAZ tiles in FOLDER, converts them to COPC, and draws 1024x1024 pixels of all of it
and of a place near by; prints a table. The first view's file is not in the system's cache. A million points take some
65 MB of disk while they are converted. Needs GNU time as /usr/bin/time, and dd.";

const TITLES: &str = "\
| million points | LAZ, MB | COPC, MB | to COPC, s | CPU, s | peak, MB | whole view, cold, s | warm, s | CPU, s \
| peak, MB | near view, warm, s | CPU, s | peak, MB |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |";

/// Resources that a run of a program used.
pub(crate) struct Cost {
    wall_s: f64,
    pub(crate) cpu_s: f64,
    pub(crate) peak_mb: f64,
}

impl Cost {
    fn cells(&self) -> String {
        format!("{:.1} | {:.1} | {:.0}", self.wall_s, self.cpu_s, self.peak_mb)
    }
}

pub(crate) fn run(root: &Path, words: &[&str]) -> bool {
    let Some((folder, counts)) = words.split_first().filter(|(_, counts)| !counts.is_empty()) else {
        eprintln!("{HELP}");
        return false;
    };
    let done = build(root, &[&["surfel-cli"], &["surfel-io", "--example", "tiles"]]).and_then(|()| {
        println!("{TITLES}");
        counts.iter().try_for_each(|count| {
            let millions = count.parse().map_err(|_| format!("'{count}': expected a number of millions of points"))?;
            println!("{}", row(root, Path::new(folder), millions)?);
            Ok(())
        })
    });
    done.map_err(|problem: String| eprintln!("error: {problem}")).is_ok()
}

/// Builds packages for release. Each item has cargo's arguments for one build.
pub(crate) fn build(root: &Path, packages: &[&[&str]]) -> Result<(), String> {
    for of in packages {
        let status = cargo(root).args(["build", "--release", "--locked", "--quiet", "-p"]).args(*of).status();
        if !status.is_ok_and(|status| status.success()) {
            return Err("the release build fails".into());
        }
    }
    Ok(())
}

fn row(root: &Path, folder: &Path, millions: u32) -> Result<String, String> {
    let programs = root.join("target/release");
    let tiles = folder.join(format!("tiles-{millions}"));
    if !tiles.is_dir() {
        measured(Command::new(programs.join("examples/tiles")).arg(&tiles).arg(millions.to_string()))?;
    }
    let entries = std::fs::read_dir(&tiles).map_err(|e| format!("{}: {e}", tiles.display()))?;
    let mut inputs: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    inputs.sort();
    let copc = folder.join(format!("{millions}.copc.laz"));
    let surfel = || Command::new(programs.join("surfel"));
    let converted = measured(surfel().arg("convert").args(&inputs).arg("-o").arg(&copc).args(["--force", "-q"]))?;
    let view = |flags: &[&str], cold: bool| {
        if cold {
            let mut drop = Command::new("dd");
            drop.arg(format!("if={}", copc.display())).args(["iflag=nocache", "count=0", "status=none"]);
            drop.status().map_err(|e| format!("dd: {e}"))?;
        }
        let image = folder.join(format!("{millions}-{}.png", if flags.is_empty() { "whole" } else { "near" }));
        let size = ["--size", "1024x1024", "--force", "-q"];
        measured(surfel().arg("render").arg(&copc).args(size).args(flags).arg("-o").arg(image))
    };
    let near = ["--eye", "500050,5000010,430", "--target", "500050,5000070,400", "--fov-y", "45"];
    let [cold, warm] = [view(&[], true)?, view(&[], false)?];
    let near = view(&near, false)?;
    let megabytes = |path: &Path| std::fs::metadata(path).map_or(0.0, |m| m.len() as f64 / 1e6);
    let laz: f64 = inputs.iter().map(|path| megabytes(path)).sum();
    let sizes = format!("{millions} | {laz:.0} | {:.0}", megabytes(&copc));
    let (converted, warm, near) = (converted.cells(), warm.cells(), near.cells());
    Ok(format!("| {sizes} | {converted} | {:.1} | {warm} | {near} |", cold.wall_s))
}

/// Runs a program under GNU time, and returns the cost. Returns an error if the program fails.
fn measured(program: &mut Command) -> Result<Cost, String> {
    measured_with_code(program, 0)
}

/// Runs a program under GNU time, and returns the cost. Returns an error if the exit code isn't `code`.
pub(crate) fn measured_with_code(program: &mut Command, code: i32) -> Result<Cost, String> {
    let mut timed = Command::new("/usr/bin/time");
    timed.args(["-f", "cost %e %U %S %M"]).arg(program.get_program()).args(program.get_args());
    if let Some(folder) = program.get_current_dir() {
        timed.current_dir(folder);
    }
    let output = timed.stdout(Stdio::null()).stderr(Stdio::piped()).output().map_err(|e| format!("GNU time: {e}"))?;
    let text = String::from_utf8_lossy(&output.stderr);
    if output.status.code() != Some(code) {
        return Err(text.into_owned());
    }
    let cost = text.lines().rev().find_map(|line| line.strip_prefix("cost ")).unwrap_or_default();
    match cost.split(' ').map(str::parse).collect::<Result<Vec<f64>, _>>().as_deref() {
        Ok([wall, user, system, kib]) => Ok(Cost { wall_s: *wall, cpu_s: user + system, peak_mb: kib * 1024.0 / 1e6 }),
        _ => Err(format!("GNU time says '{text}'")),
    }
}
