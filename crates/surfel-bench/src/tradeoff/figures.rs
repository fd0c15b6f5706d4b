//! Results of the trade-off measurements, as stored in JSON.

use serde::{Deserialize, Serialize};

use crate::machine::Machine;
use crate::report::BackendFacts;

/// Version of the JSON format. It increases whenever a field changes its meaning, but not with new fields.
const VERSION: u32 = 1;

/// Results of a run of the trade-off measurements with one backend.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Figures {
    version: u32,
    pub machine: Machine,
    pub backend: BackendFacts,
    /// Width and height of every image, in pixels.
    pub size: [u32; 2],
    /// Number of frames per variant; times are medians of these.
    pub runs: usize,
    pub subjects: Vec<SubjectFacts>,
    pub rows: Vec<Row>,
    /// Subjects that weren't drawn, with the reason.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
    /// Duration of the whole run, in seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Results of other backends, with fewer subjects and smaller images.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub others: Vec<Self>,
}

/// Description of a subject: a scene with its view, and the ideal image that its image approximates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SubjectFacts {
    pub name: String,
    pub about: String,
    /// Description of the ideal image that model errors are measured against.
    pub truth: String,
    pub splats: u64,
}

/// Difference between the colours of two images, which are linear and premultiplied.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Error {
    pub max_abs: f64,
    /// The 99.9 % quantile of the pixels' errors; the error of a pixel is the largest difference of a channel.
    pub p999: f64,
    /// Root mean square of the differences of the four channels.
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
    /// Reason why the backend can't draw the image, so that the figures describe the reference's image; `None` if it
    /// can.
    pub not_drawn: Option<String>,
    /// Median time of a frame, in milliseconds; `None` if the backend can't draw the image. It is CPU time on one
    /// thread, or wall-clock time for GPUs and on systems that don't report CPU times.
    pub ms: Option<f64>,
    /// Number of splats of the scene divided by the time `ms`, per second; `None` without a time.
    pub splats_per_s: Option<f64>,
    /// Memory of the uploaded scene in the backend, in bytes per splat; `None` if the backend can't draw the image.
    pub bytes_per_splat: Option<f64>,
    /// Total number of fragments of the frame that contribute to any pixel; `None` if the backend doesn't count them.
    pub fragments: Option<u64>,
    /// Difference between the backend's image and the reference's with the same settings, outside of decision margins.
    pub fidelity: Option<Error>,
    /// Model error: difference from the subject's ideal image; `None` if there is none for this setting.
    pub model: Option<Error>,
    /// Model error without silhouettes: only in pixels that the ideal image covers completely, together with their
    /// neighbours. `None` if there are no such pixels, or if an opaque background hides the silhouettes.
    pub model_inside: Option<Error>,
    /// Mean FLIP of the image against the subject's ideal image; `None` if there is no model error.
    pub model_flip: Option<f64>,
    /// Relative RMS difference of depth `Z` in pixels where both images have a depth; `None` if there are none.
    pub model_depth: Option<f64>,
    /// RMS angle between normals, in degrees, in pixels where both images have a normal; `None` if there are none.
    pub model_normal_deg: Option<f64>,
    /// For presets: PSNR between two images of the reference backend, one with this preset and one with the preset
    /// `reference`, in dB. `None` for equal images, and for settings other than presets.
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

    /// Returns the row with this subject, setting (`knob`) and value.
    pub(crate) fn row(&self, subject: &str, knob: &str, value: &str) -> Option<&Row> {
        self.rows.iter().find(|r| r.subject == subject && r.knob == knob && r.value == value)
    }
}
