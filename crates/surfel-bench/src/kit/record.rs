//! Lines of a kit's `results.jsonl`: one JSON object each, written as soon as its value is known.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::work::Work;
use crate::machine::Machine;
use crate::report::Row;

/// Line of the file of records.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(crate) enum Record {
    /// Kit itself; the first line, written by the script.
    Kit(Kit),
    /// CPU and system of the machine.
    Machine(Machine),
    /// Device that a backend sees.
    Device(Device),
    /// Step of the script that has ended.
    Step(Step),
    /// Message of the script.
    Note { text: String },
    /// One scene at one size on one backend.
    Frame(Box<Frame>),
    /// Comparison of one scene with the reference, as the conformance runner writes it.
    Conformance(Conformance),
    /// Peak rate of the device.
    Probe(Probe),
}

/// Commit and build of the kit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Kit {
    /// Commit, with a trailing `+` if files differ from it.
    pub commit: String,
    /// Oldest version of glibc on which the programs run.
    pub glibc: String,
}

/// Device that a backend sees; the backend's default comes first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Device {
    pub backend: String,
    pub adapter: String,
    pub driver: String,
    /// True if the device computes on the CPU.
    pub is_software: bool,
    /// Limits and features by the API's names.
    pub facts: BTreeMap<String, String>,
}

/// Step of the script.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Step {
    pub name: String,
    pub seconds: f64,
    /// `ok`, or a description of the failure.
    pub outcome: String,
}

/// One scene at one size on one backend.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Frame {
    pub backend: String,
    pub adapter: String,
    pub is_software: bool,
    /// Time to generate the scene, milliseconds.
    pub load_ms: f64,
    /// Time to upload the scene, milliseconds.
    pub upload_ms: f64,
    /// Time of the first frame, which compiles pipelines, milliseconds.
    pub first_ms: f64,
    /// Hashes of repeated frames by plane; empty if frames weren't repeated.
    pub hashes: BTreeMap<String, Vec<String>>,
    /// Estimated work of each pass.
    pub work: Vec<Work>,
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
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// `passed`, `as expected`, `skipped` or `FAILED`.
    pub verdict: String,
    /// Reason, unless the verdict is `passed`.
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
    /// Hashes of repeated frames by plane.
    pub hashes: BTreeMap<String, Vec<String>>,
    /// Drawing time, including repeated frames, milliseconds.
    pub ms: f64,
}

/// Peak rate of the device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Probe {
    pub backend: String,
    pub adapter: String,
    pub is_software: bool,
    pub name: String,
    /// Unit of the count: `byte`, `flop`, `fragment`, `quad` or `atomic`.
    pub unit: String,
    pub per_s: f64,
}

/// File of a kit's results, for programs that compare scenes with the reference.
pub struct Lines(Writer);

impl Lines {
    /// Opens `results.jsonl` in a folder, creating both if they don't exist.
    ///
    /// # Errors
    /// [`std::io::Error`] if the folder or the file can't be created.
    pub fn open(folder: &Path) -> std::io::Result<Self> {
        Writer::open(folder).map(Self)
    }

    /// Appends a line.
    ///
    /// # Errors
    /// [`std::io::Error`] if the file can't be written.
    pub fn append(&mut self, scene: &Conformance) -> std::io::Result<()> {
        self.0.write(&Record::Conformance(scene.clone()))
    }
}

/// File of records, opened for appending. Every line is written with one call, so that a killed program loses at most
/// one.
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

/// Returns the records of a text, and the numbers of lines that aren't records, such as the last line of a killed
/// program.
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

/// Returns a hash of values (FNV-1a on words), by which images are compared.
fn hash(bytes: impl IntoIterator<Item = u32>) -> String {
    let mixed = bytes.into_iter().fold(0xcbf2_9ce4_8422_2325u64, |hash, word| {
        (hash ^ u64::from(word)).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23)
    });
    format!("{mixed:016x}")
}

/// Returns hashes of a frame's planes of colour, depth, normals and weights, by the planes' names.
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
