//! Helpers that run the program on small inputs in a temporary folder.

#![allow(dead_code, unreachable_pub, missing_docs, reason = "backends that are left out use a part of this")]

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};

/// A temporary folder, removed when dropped.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new(name: &str) -> Self {
        static MADE: AtomicUsize = AtomicUsize::new(0);
        let (process, made) = (std::process::id(), MADE.fetch_add(1, Ordering::Relaxed));
        let path = std::env::temp_dir().join(format!("surfel-cli-{process}-{made}-{name}"));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub fn path(&self) -> &Path {
        &self.0
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.0.join(name), content).unwrap();
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.0.join(name)).unwrap()
    }

    pub fn has(&self, name: &str) -> bool {
        self.0.join(name).exists()
    }

    /// Returns the names of files in the folder, sorted.
    pub fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    /// Runs `surfel` in the folder with words separated by spaces.
    pub fn run(&self, words: &str) -> Run {
        let output = Command::new(env!("CARGO_BIN_EXE_surfel"))
            .current_dir(&self.0)
            .args(words.split_whitespace())
            .env("NO_COLOR", "1")
            .output()
            .unwrap();
        Run(output, words.to_owned())
    }

    /// Starts `surfel` in the folder with words separated by spaces, discarding its output.
    pub fn spawn(&self, words: &str) -> Child {
        self.spawn_with(words, &[])
    }

    /// Starts `surfel` like [`Self::spawn`], with environment variables.
    pub fn spawn_with(&self, words: &str, variables: &[(&str, &str)]) -> Child {
        let mut command = Command::new(env!("CARGO_BIN_EXE_surfel"));
        command.current_dir(&self.0).args(words.split_whitespace()).envs(variables.iter().copied());
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    }

    /// Runs `surfel` in the folder with words that may contain spaces.
    pub fn run_words(&self, words: &[&str]) -> Run {
        let program = env!("CARGO_BIN_EXE_surfel");
        let output = Command::new(program).current_dir(&self.0).args(words).env("NO_COLOR", "1").output().unwrap();
        Run(output, words.join(" "))
    }

    /// Runs `surfel` like [`Self::run_words`], with environment variables.
    pub fn run_words_with(&self, words: &[&str], variables: &[(&str, &str)]) -> Run {
        let mut command = Command::new(env!("CARGO_BIN_EXE_surfel"));
        command.current_dir(&self.0).args(words).env("NO_COLOR", "1").envs(variables.iter().copied());
        Run(command.output().unwrap(), words.join(" "))
    }

    /// Runs `surfel` in a subfolder, with `stdin`.
    pub fn run_in(&self, folder: &str, words: &str, stdin: &[u8]) -> Run {
        let mut child = Command::new(env!("CARGO_BIN_EXE_surfel"))
            .current_dir(self.0.join(folder))
            .args(words.split_whitespace())
            .env("NO_COLOR", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // Writing fails if the program doesn't read stdin.
        let _ = child.stdin.take().unwrap().write_all(stdin);
        Run(child.wait_with_output().unwrap(), format!("{words} (in {folder:?})"))
    }

    /// Returns the planes of an image.
    pub fn image(&self, name: &str) -> surfel_io::Planes {
        surfel_io::read_image(&self.0.join(name)).unwrap()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// True if this process, and so its children, ignores the signal of this number; false where that isn't known.
#[cfg(unix)]
pub fn ignores_signal(number: u32) -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).map(str::trim);
    ignored.and_then(|mask| u64::from_str_radix(mask, 16).ok()).is_some_and(|mask| mask >> (number - 1) & 1 == 1)
}

/// Output of a finished run of `surfel`, and the arguments of the run.
pub struct Run(Output, String);

impl Run {
    pub fn stdout(&self) -> String {
        String::from_utf8_lossy(&self.0.stdout).into_owned()
    }

    pub fn bytes(&self) -> &[u8] {
        &self.0.stdout
    }

    pub fn stderr(&self) -> String {
        String::from_utf8_lossy(&self.0.stderr).into_owned()
    }

    /// Returns the exit code (−1 if a signal ended the run), stdout and stderr.
    pub fn parts(&self) -> (i32, Vec<u8>, String) {
        (self.0.status.code().unwrap_or(-1), self.0.stdout.clone(), self.stderr())
    }

    pub fn json(&self) -> serde_json::Value {
        serde_json::from_slice(&self.0.stdout).unwrap_or_else(|e| panic!("{e}: {}\n{}", self.stdout(), self.stderr()))
    }

    /// Asserts the exit code.
    #[track_caller]
    pub fn code(self, expected: i32) -> Self {
        assert_eq!(self.0.status.code(), Some(expected), "surfel {}\n{}", self.1, self.stderr());
        self
    }

    /// Asserts an exit code, and an error of one to four lines that contains `part`.
    #[track_caller]
    pub fn fails(self, expected: i32, part: &str) -> Self {
        let run = self.code(expected);
        let text = run.stderr();
        let error: Vec<&str> = text.lines().skip_while(|l| !l.starts_with("error: ")).collect();
        assert!((1..=4).contains(&error.len()), "surfel {}\n{text}", run.1);
        assert!(error.join("\n").contains(part), "surfel {}: '{part}' is not in\n{text}", run.1);
        run
    }
}

/// Returns a ball of disks with colours, as an ASCII splat PLY.
pub fn ball() -> String {
    let count = 200;
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\nproperty float radius\nproperty uchar red\n\
         property uchar green\nproperty uchar blue\nend_header\n"
    );
    for i in 0..count {
        let [x, y, z] = on_sphere(i, count);
        text += &format!("{x} {y} {z} {x} {y} {z} 0.25 {} {} 90\n", 55 + i, 255 - i);
    }
    text
}

/// Returns bare points of a sphere, as XYZ.
pub fn points() -> String {
    (0..300).map(|i| on_sphere(i, 300)).map(|[x, y, z]| format!("{x} {y} {z}\n")).collect()
}

/// Returns a cube as OBJ.
pub fn cube() -> String {
    let mut text = String::new();
    for i in 0..8 {
        text += &format!("v {} {} {}\n", i & 1, i >> 1 & 1, i >> 2 & 1);
    }
    text + "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
}

fn on_sphere(i: usize, count: usize) -> [f64; 3] {
    let (z, a) = (1.0 - (2.0 * i as f64 + 1.0) / count as f64, 2.399_963 * i as f64);
    let r = (1.0 - z * z).sqrt();
    [r * a.cos(), r * a.sin(), z]
}

/// Returns a scene file of `a.ply` with `settings`.
pub fn scene(settings: &str) -> String {
    format!(
        r#"{{"camera": {{"eye": [0,0,5], "target": [0,0,0], "projection": {{"perspective": {{"fov_y_deg": 30}}}},
            "size": [40, 30]}}, "objects": [{{"splats": "a.ply"}}], "settings": {{{settings}}}}}"#
    )
}

/// Returns a LAS file of format 7: a hilly sheet of `side`² coloured points, in millimetres. The points are 0.1 apart
/// and jittered. The sheet is shifted east by `east` times its side. The header has the points' own bounds.
pub fn las_at(side: u32, east: u32) -> Vec<u8> {
    let mut bytes = vec![0; 375];
    bytes[..4].copy_from_slice(b"LASF");
    bytes[24..26].copy_from_slice(&[1, 4]);
    bytes[94..96].copy_from_slice(&375_u16.to_le_bytes());
    bytes[96..100].copy_from_slice(&375_u32.to_le_bytes());
    bytes[104] = 7;
    bytes[105..107].copy_from_slice(&36_u16.to_le_bytes());
    let offsets = [600_000.0, 5_000_000.0, 100.0];
    for (k, offset) in offsets.into_iter().enumerate() {
        let mut put = |at: usize, v: f64| bytes[at + 8 * k..at + 8 * k + 8].copy_from_slice(&v.to_le_bytes());
        put(131, 0.001);
        put(155, offset);
    }
    bytes[247..255].copy_from_slice(&u64::from(side * side).to_le_bytes());
    let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
    let mut random = 1_u64;
    let mut jitter = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 40) as f64 / f64::from(1 << 24) * 0.05
    };
    for i in 0..side * side {
        let (x, y) = (f64::from(i % side) * 0.1 + jitter(), f64::from(i / side) * 0.1 + jitter());
        let z = 3.0 * (x * 0.2).sin() * (y * 0.17).cos();
        for (k, v) in [x + f64::from(east * side) * 0.1, y, z].into_iter().enumerate() {
            let step = (v * 1000.0).round() as i32;
            (low[k], high[k]) = (low[k].min(step), high[k].max(step));
            bytes.extend_from_slice(&step.to_le_bytes());
        }
        bytes.extend_from_slice(&[0, 0, 0x11, 0, 2, 0, 0, 0, 0, 0]);
        bytes.extend_from_slice(&f64::from(i).to_le_bytes());
        let level = |on: bool| if on { 52_000_u16 } else { 9_000 };
        let stripe = (x / 5.0).floor() as i64 + (y / 5.0).floor() as i64;
        let color = [level(stripe % 2 == 0), 30_000, level(stripe % 3 == 0)];
        color.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
    }
    for (k, offset) in offsets.into_iter().enumerate() {
        for (at, step) in [(179 + 16 * k, high[k]), (187 + 16 * k, low[k])] {
            bytes[at..at + 8].copy_from_slice(&(f64::from(step) * 0.001 + offset).to_le_bytes());
        }
    }
    bytes
}
