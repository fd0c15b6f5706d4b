//! What was measured, as it is written to JSON.

use serde::{Deserialize, Serialize};

use crate::machine::Machine;
use crate::report::BackendFacts;

/// Version of the JSON. Raised whenever a field changes its meaning; new fields don't raise it.
const VERSION: u32 = 1;

/// A run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Figures {
    version: u32,
    pub machine: Machine,
    pub backend: BackendFacts,
    /// Of every image, pixels.
    pub size: [u32; 2],
    /// Frames that times are medians of.
    pub runs: usize,
    pub subjects: Vec<SubjectFacts>,
    pub rows: Vec<Row>,
    /// Subjects that weren't drawn, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
    /// What the whole run took.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Other backends, on fewer subjects and smaller images.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub others: Vec<Self>,
}

/// What is drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SubjectFacts {
    pub name: String,
    pub about: String,
    /// What model errors are against.
    pub truth: String,
    pub splats: u64,
}

/// How far two images' colours are apart, linear and premultiplied.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Error {
    pub max_abs: f64,
    /// 99.9 % of the pixels are off by no more.
    pub p999: f64,
    pub rmse: f64,
    /// dB; none for equal images.
    pub psnr_db: Option<f64>,
}

/// One variant of one subject.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    pub subject: String,
    pub knob: String,
    pub value: String,
    /// Why the backend draws no such image; what follows is then the reference's.
    pub not_drawn: Option<String>,
    /// Median time on the CPU of a frame on one thread, milliseconds; of a GPU the time on the clock.
    pub ms: Option<f64>,
    /// All splats over that.
    pub splats_per_s: Option<f64>,
    pub bytes_per_splat: Option<f64>,
    pub fragments: Option<u64>,
    /// The backend against the reference at the same settings, outside of decision margins.
    pub fidelity: Option<Error>,
    /// Against the subject's truth; none where it has none for this knob.
    pub model: Option<Error>,
    /// The same of pixels that the truth covers wholly, their neighbours too: without rims. None where there are none.
    pub model_inside: Option<Error>,
    pub model_flip: Option<f64>,
    /// Relative RMS of Z where both have one.
    pub model_depth: Option<f64>,
    /// RMS angle between normals where both have one, degrees.
    pub model_normal_deg: Option<f64>,
    /// Against the image of the preset `reference` by the reference, dB; none for equal images.
    pub from_reference_preset_db: Option<f64>,
}

impl Figures {
    pub(crate) fn new(machine: Machine, backend: BackendFacts, size: [u32; 2], runs: usize) -> Self {
        Self {
            version: VERSION,
            machine,
            backend,
            size,
            runs,
            subjects: Vec::new(),
            rows: Vec::new(),
            left_out: Vec::new(),
            seconds: None,
            others: Vec::new(),
        }
    }

    /// The row of a subject.
    pub(crate) fn row(&self, subject: &str, knob: &str, value: &str) -> Option<&Row> {
        self.rows.iter().find(|r| r.subject == subject && r.knob == knob && r.value == value)
    }
}
