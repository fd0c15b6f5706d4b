//! Measurements, as stored in JSON.

use serde::{Deserialize, Serialize};

use crate::machine::Machine;
use crate::report::BackendFacts;

/// Version of the JSON format. It increases whenever a field changes its meaning, but not with new fields.
const VERSION: u32 = 1;

/// Figures of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Figures {
    version: u32,
    pub machine: Machine,
    pub backend: BackendFacts,
    /// Size of every image, pixels.
    pub size: [u32; 2],
    /// Number of frames of which times are the median.
    pub runs: usize,
    pub subjects: Vec<SubjectFacts>,
    pub rows: Vec<Row>,
    /// Subjects that weren't drawn, with the reason.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
    /// Duration of the whole run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Figures of other backends, with fewer subjects and smaller images.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub others: Vec<Self>,
}

/// Description of a subject.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SubjectFacts {
    pub name: String,
    pub about: String,
    /// Truth that model errors are relative to.
    pub truth: String,
    pub splats: u64,
}

/// Difference between the colours of two images, linear and premultiplied.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Error {
    pub max_abs: f64,
    /// Quantile: 99.9 % of the pixels have at most this error.
    pub p999: f64,
    pub rmse: f64,
    /// PSNR in dB; `None` for equal images.
    pub psnr_db: Option<f64>,
}

/// Measurement of one variant of one subject.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    pub subject: String,
    pub knob: String,
    pub value: String,
    /// Reason why the backend can't draw the image. The figures then describe the reference's image.
    pub not_drawn: Option<String>,
    /// Median time of a frame, milliseconds: CPU time on one thread, or wall-clock time of a GPU.
    pub ms: Option<f64>,
    /// All splats of the scene divided by that time.
    pub splats_per_s: Option<f64>,
    pub bytes_per_splat: Option<f64>,
    pub fragments: Option<u64>,
    /// Difference between the backend and the reference at the same settings, outside of decision margins.
    pub fidelity: Option<Error>,
    /// Difference from the subject's truth; `None` if there is no truth for this knob.
    pub model: Option<Error>,
    /// Difference from the truth without rims: in pixels that the truth covers completely, together with their
    /// neighbours. `None` if there are none.
    pub model_inside: Option<Error>,
    pub model_flip: Option<f64>,
    /// Relative RMS difference of Z where both images have one.
    pub model_depth: Option<f64>,
    /// RMS angle between normals where both images have one, degrees.
    pub model_normal_deg: Option<f64>,
    /// PSNR against the reference's image with the preset `reference`, dB; `None` for equal images.
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

    /// Returns the row of a subject, knob and value.
    pub(crate) fn row(&self, subject: &str, knob: &str, value: &str) -> Option<&Row> {
        self.rows.iter().find(|r| r.subject == subject && r.knob == knob && r.value == value)
    }
}
