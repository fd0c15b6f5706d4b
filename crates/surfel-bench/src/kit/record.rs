//! Lines of a kit's `results.jsonl`. Each line is a JSON object, which is written as soon as its values are known.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::work::Work;
use crate::machine::Machine;
use crate::report::Row;

/// Record in `results.jsonl`, one per line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(crate) enum Record {
    /// Description of the kit; the first line, written by the script.
    Kit(Kit),
    /// CPU and operating system of the machine.
    Machine(Machine),
    /// Device that a backend finds.
    Device(Device),
    /// Result of a step of the kit's script `run.sh`.
    Step(Step),
    /// Message of the kit's script, for example about a missing driver.
    Note { text: String },
    /// Times of one scene at one size on one backend.
    Frame(Box<Frame>),
    /// Comparison of one scene with the reference, as the conformance runner writes it.
    Conformance(Conformance),
    /// Measured peak rate of the device.
    Probe(Probe),
}

/// Commit and build of the kit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Kit {
    /// Commit of the source, with a trailing `+` if the working tree has changes.
    pub commit: String,
    /// Oldest version of glibc on which the programs run.
    pub glibc: String,
}

/// Device that a backend finds. The backend's default device comes first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Device {
    pub backend: String,
    pub adapter: String,
    pub driver: String,
    /// True if the device computes on the CPU.
    pub is_software: bool,
    /// Limits and features, by their names in the graphics API.
    pub facts: BTreeMap<String, String>,
}

/// Result of a step of the kit's script `run.sh`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Step {
    pub name: String,
    pub seconds: f64,
    /// `ok`, or a description of the failure.
    pub outcome: String,
}

/// Times of one scene at one size on one backend.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Frame {
    pub backend: String,
    pub adapter: String,
    pub is_software: bool,
    /// Time to generate the scene, in milliseconds.
    pub load_ms: f64,
    /// Time to upload the scene, in milliseconds.
    pub upload_ms: f64,
    /// Time of the first frame, in milliseconds. It includes the compilation of pipelines.
    pub first_ms: f64,
    /// Hashes of each plane, one per repeated frame, by the plane's name. They differ if frames aren't reproducible.
    /// Empty if frames weren't repeated.
    pub hashes: BTreeMap<String, Vec<String>>,
    /// Estimated work of each pass.
    pub work: Vec<Work>,
    /// Measured times and counts of the scene.
    pub row: Row,
}

/// Comparison of one scene with the reference.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Conformance {
    /// Name of the backend.
    pub backend: String,
    /// Name of the adapter.
    pub adapter: String,
    /// True if the adapter computes on the CPU.
    pub is_software: bool,
    /// Name of the scene.
    pub scene: String,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// `passed`, `as expected`, `skipped` or `FAILED`.
    pub verdict: String,
    /// Reason for the verdict; empty if it is `passed`.
    pub why: String,
    /// Plane with the largest error; `None` if nothing was compared.
    pub plane: Option<String>,
    /// Largest error as a multiple of the tolerance; `None` if nothing was compared or the error is infinite.
    pub worst: Option<f64>,
    /// Number of pixels outside of the decision margin whose error exceeds the tolerance.
    pub outliers: u64,
    /// Number of pixels within the decision margin whose error exceeds the tolerance.
    pub forgiven: u64,
    /// Names of the frame's passes.
    pub passes: Vec<String>,
    /// Hashes of each plane, one per repeated frame, by the plane's name. They differ if frames aren't reproducible.
    pub hashes: BTreeMap<String, Vec<String>>,
    /// Drawing time including repeated frames, in milliseconds.
    pub ms: f64,
}

/// Measured peak rate of the device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Probe {
    pub backend: String,
    pub adapter: String,
    pub is_software: bool,
    pub name: String,
    /// Unit in which the rate counts: `byte`, `flop`, `fragment`, `quad` or `atomic`.
    pub unit: String,
    /// Largest measured rate, as the amount of `unit` per second.
    pub per_s: f64,
}

/// Writer of conformance results to a kit's `results.jsonl`, for programs that compare scenes with the reference.
pub struct Lines(Writer);

impl Lines {
    /// Opens `results.jsonl` in a folder, creating both if they don't exist.
    ///
    /// # Errors
    /// [`std::io::Error`] if the folder or the file can't be created.
    pub fn open(folder: &Path) -> std::io::Result<Self> {
        Writer::open(folder).map(Self)
    }

    /// Appends a line with the comparison of a scene.
    ///
    /// # Errors
    /// [`std::io::Error`] if the file can't be written.
    pub fn append(&mut self, scene: &Conformance) -> std::io::Result<()> {
        self.0.write(&Record::Conformance(scene.clone()))
    }
}

/// File of records, opened for appending. Each line is written by a single call, so that a killed program loses at most
/// one line.
pub(crate) struct Writer(File);

impl Writer {
    /// Opens `results.jsonl` in a folder, creating both if they don't exist.
    pub(crate) fn open(folder: &Path) -> std::io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        let path = folder.join(RESULTS);
        Ok(Self(OpenOptions::new().create(true).append(true).open(path)?))
    }

    pub(crate) fn write(&mut self, record: &Record) -> std::io::Result<()> {
        let mut line = serde_json::to_vec(record)?;
        line.push(b'\n');
        self.0.write_all(&line)
    }
}

/// Name of the file of records.
pub(crate) const RESULTS: &str = "results.jsonl";

/// Parses the lines of a file of records. Returns the records, and the numbers of lines that aren't records, such as an
/// incomplete last line.
pub(crate) fn parse(text: &str) -> (Vec<Record>, Vec<usize>) {
    let (mut records, mut bad) = (Vec::new(), Vec::new());
    for (i, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        match serde_json::from_str(line) {
            Ok(record) => records.push(record),
            Err(_) => bad.push(i + 1),
        }
    }
    (records, bad)
}

/// Returns a hash of 32-bit words (FNV-1a on words), by which images are compared.
fn hash(bytes: impl IntoIterator<Item = u32>) -> String {
    let mixed = bytes.into_iter().fold(0xcbf2_9ce4_8422_2325u64, |hash, word| {
        (hash ^ u64::from(word)).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23)
    });
    format!("{mixed:016x}")
}

/// Returns the name and a hash of each plane that a frame has, among colour, depth, normals and weights.
pub fn plane_hashes(frame: &surfel_render::Frame) -> Vec<(&'static str, String)> {
    let words = |values: &[f32]| hash(values.iter().map(|value| value.to_bits()));
    let planes = [
        ("color", frame.color().as_flattened()),
        ("Z", frame.depth()),
        ("normal", frame.normal().as_flattened()),
        ("weight", frame.weight()),
    ];
    planes.into_iter().filter(|plane| !plane.1.is_empty()).map(|(name, values)| (name, words(values))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_survive_a_file_whose_last_line_is_cut_off() {
        let folder = std::env::temp_dir().join(format!("surfel-kit-records-{}", std::process::id()));
        let note = Record::Note { text: "a \"note\"\nof two lines".into() };
        let probe = Record::Probe(Probe {
            backend: "wgpu".into(),
            adapter: "card".into(),
            is_software: false,
            name: "memory copy".into(),
            unit: "byte".into(),
            per_s: 3e12,
        });
        for record in [&note, &probe] {
            Writer::open(&folder).unwrap().write(record).unwrap();
        }
        let mut text = std::fs::read_to_string(folder.join(RESULTS)).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        text += "{\"kind\":\"note\",\"te";
        assert_eq!(parse(&text), (vec![note, probe], vec![3]));
        assert_eq!(parse("{\"kind\":\"another\"}\n\n"), (vec![], vec![1]));
    }

    #[test]
    fn hashes_tell_the_last_bit_and_the_order_apart() {
        let one = hash([1, 2, 3]);
        assert_eq!(one, hash([1, 2, 3]));
        assert!(one != hash([1, 2, 2]) && one != hash([2, 1, 3]) && one != hash([1, 2, 3, 0]));
    }
}
