//! Report of a run, as stored in JSON.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use surfel_render::Stats;

use crate::machine::Machine;

/// Version of the JSON format. It increases whenever a field changes its meaning, but not with new fields.
const VERSION: u32 = 1;

/// Report of a run: machine, backend, and a row per scene and number of threads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Report {
    version: u32,
    pub machine: Machine,
    pub backend: BackendFacts,
    /// Peak fill rates of the GPU; empty for backends that don't use a GPU, and in older files.
    #[serde(default)]
    pub fill_rates: Vec<FillRate>,
    pub rows: Vec<Row>,
}

/// Fill rate of a GPU, which no pass over splats can exceed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FillRate {
    /// Name of the probe: `clear`, `depth`, `fill`, `blend` or `blend two`.
    pub name: String,
    /// Pixels cleared or fragments drawn per second.
    pub fragments_per_s: f64,
}

/// Description of the backend that drew the frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct BackendFacts {
    pub name: String,
    /// Name of the GPU, or of the SIMD instructions that the CPU backend uses.
    pub adapter: String,
    pub driver: String,
    /// True for a GPU interface that computes on the CPU. Its times aren't representative of GPUs.
    pub is_software: bool,
}

/// Results of one scene with one number of threads. Counts are per frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    pub scene: String,
    /// Description of the scene.
    pub about: String,
    pub shader: String,
    pub threads: usize,
    pub size: [u32; 2],
    /// Wall-clock time of every frame in drawing order, in milliseconds.
    pub frames_ms: Vec<f64>,
    /// Median wall-clock time per frame, in milliseconds.
    pub median_ms: f64,
    /// Shortest wall-clock time of a frame, in milliseconds.
    pub min_ms: f64,
    /// CPU time of every frame, summed over threads, in milliseconds; empty for GPUs, and if the system doesn't report
    /// it.
    pub busy_frames_ms: Vec<f64>,
    /// Median CPU time per frame, summed over threads, in milliseconds; `None` if `busy_frames_ms` is empty.
    pub busy_ms: Option<f64>,
    /// Median time of each stage, in milliseconds, by the name of the stage.
    pub stages_ms: BTreeMap<String, f64>,
    /// Number of splats of the scene, including culled ones.
    pub splats: u64,
    /// Number of splats that were drawn, without culled ones.
    pub drawn: u64,
    /// Total number of fragments of the frame that contribute to any pixel; `None` if the backend doesn't count them,
    /// or if there are none.
    pub fragments: Option<u64>,
    /// Number of pixels to which at least one splat contributes.
    pub covered_px: u64,
    /// Number of splats of the scene, including culled ones, divided by the median time, per second.
    pub splats_per_s: f64,
    /// Number of drawn splats divided by the median time, per second.
    pub drawn_per_s: f64,
    /// Number of fragments divided by the median time, per second; `None` if the backend doesn't count fragments.
    pub fragments_per_s: Option<f64>,
    /// Fragments per second of the attribute pass, as a fraction of the GPU's fill rate for the same targets. `None` if
    /// fragments, the fill rate or the time of the attribute pass aren't known.
    #[serde(default)]
    pub share_of_blend: Option<f64>,
    /// Fragments per second of the whole frame, as a fraction of the GPU's fill rate for the targets of the attribute
    /// pass. `None` if fragments or the fill rate aren't known.
    #[serde(default)]
    pub frame_share_of_blend: Option<f64>,
    /// Mean number of fragments per drawn splat; `None` if `fragments` is `None`, or if no splat was drawn.
    pub fragments_per_splat: Option<f64>,
    /// Mean number of fragments per covered pixel; `None` if `fragments` is `None`, or if no pixel is covered.
    pub fragments_per_px: Option<f64>,
    /// Number of pairs of a splat and a block of 4×4 pixels that the CPU backend computed; `None` for other backends.
    pub block_pairs: Option<f64>,
    /// Time of the tile loops per thread and pair (see `block_pairs`), in nanoseconds; `None` for backends other than
    /// the CPU backend.
    pub ns_per_pair: Option<f64>,
    /// Memory of the uploaded scene in the backend (device memory on a GPU), in bytes per splat. Culled splats count,
    /// too.
    pub bytes_per_splat: f64,
    /// Memory of the uploaded scene in the backend, in units of 10⁶ bytes; not the process's resident set.
    pub resident_mb: f64,
    /// Memory of the records and lists of each thread's largest cell, summed over the threads, in units of 10⁶ bytes. A
    /// cell is a part of the image that one thread of the CPU backend draws alone. This is the memory of a frame
    /// besides the scene and the image; `None` for other backends.
    pub batch_mb: Option<f64>,
    /// Estimated memory traffic, in units of 10⁹ bytes per second. Splats that are set up are read once; their records
    /// and lists are written once and read once. `None` if the backend doesn't count bytes.
    pub gb_per_s: Option<f64>,
    /// All counters of the backend, by name.
    pub counters: BTreeMap<String, f64>,
}

/// Measurements of one scene with one number of threads.
#[derive(Clone, Debug, Default)]
pub(crate) struct Samples {
    pub frames_ms: Vec<f64>,
    /// CPU time of each frame, summed over threads, in milliseconds.
    pub busy_ms: Vec<f64>,
    /// Statistics of each frame.
    pub stats: Vec<Stats>,
    /// Number of pixels to which at least one splat contributes.
    pub covered_px: u64,
    /// Number of fragments of one frame; 0 if the backend doesn't count them.
    pub fragments: u64,
}

/// Scene and parameters of a row.
pub(crate) struct Subject {
    pub scene: String,
    pub about: String,
    pub shader: String,
    pub threads: usize,
    pub size: [u32; 2],
}

impl Report {
    pub(crate) fn new(machine: Machine, backend: BackendFacts, fill_rates: Vec<FillRate>, mut rows: Vec<Row>) -> Self {
        rows.iter_mut().for_each(|row| row.judge(&fill_rates));
        Self { version: VERSION, machine, backend, fill_rates, rows }
    }

    /// Appends the frame times of a later run of the same scenes. Medians, rates and counts remain those of the first
    /// run.
    pub(crate) fn extend(&mut self, later: Self) {
        for row in &mut self.rows {
            let same = later.rows.iter().find(|other| other.scene == row.scene && other.threads == row.threads);
            if let Some(other) = same {
                row.frames_ms.extend(&other.frames_ms);
                row.busy_frames_ms.extend(&other.busy_frames_ms);
            }
        }
    }

    /// Parses a file written by `-o`.
    pub(crate) fn parse(text: &[u8]) -> Result<Self, String> {
        let value: serde_json::Value = serde_json::from_slice(text).map_err(|e| format!("is no JSON: {e}"))?;
        match value.get("version").and_then(serde_json::Value::as_u64) {
            Some(version) if version == u64::from(VERSION) => {
                serde_json::from_value(value).map_err(|e| format!("is no report of version {VERSION}: {e}"))
            }
            found => {
                let found = found.map_or("none".to_owned(), |v| v.to_string());
                Err(format!("has version {found}, expected {VERSION}: measure again with this program"))
            }
        }
    }
}

impl Row {
    pub(crate) fn new(subject: Subject, samples: Samples) -> Self {
        let Samples { frames_ms, busy_ms, stats, covered_px, fragments } = samples;
        let median_ms = median(&frames_ms);
        let seconds = median_ms * 1e-3;
        let one = stats.last().cloned().unwrap_or_default();
        let middle = |value: &dyn Fn(&Stats) -> Option<f64>| {
            let values: Vec<f64> = stats.iter().filter_map(value).collect();
            (!values.is_empty()).then(|| median(&values))
        };
        let counter = |name: &str| middle(&|s: &Stats| s.counters.iter().find(|c| c.0 == name).map(|c| c.1));
        let stage = |name: &str| middle(&|s: &Stats| s.passes.iter().find(|p| p.name == name).map(|p| p.ms));
        let fragments = (fragments > 0).then_some(fragments);
        let over = |n: f64| fragments.filter(|_| n > 0.0).map(|f| f as f64 / n);
        let batch_bytes = counter("batch_bytes");
        Self {
            scene: subject.scene,
            about: subject.about,
            shader: subject.shader,
            threads: subject.threads,
            size: subject.size,
            median_ms,
            busy_ms: (!busy_ms.is_empty()).then(|| median(&busy_ms)),
            busy_frames_ms: busy_ms,
            min_ms: frames_ms.iter().copied().fold(f64::INFINITY, f64::min),
            frames_ms,
            stages_ms: one.passes.iter().filter_map(|p| Some((p.name.to_owned(), stage(p.name)?))).collect(),
            splats: one.splats,
            drawn: one.drawn,
            fragments,
            covered_px,
            splats_per_s: one.splats as f64 / seconds,
            drawn_per_s: one.drawn as f64 / seconds,
            fragments_per_s: over(seconds),
            share_of_blend: None,
            frame_share_of_blend: None,
            fragments_per_splat: over(one.drawn as f64),
            fragments_per_px: over(covered_px as f64),
            block_pairs: counter("block_pairs"),
            ns_per_pair: counter("tile_ns_per_block_pair"),
            bytes_per_splat: one.bytes_per_splat,
            resident_mb: one.bytes_per_splat * one.splats as f64 * 1e-6,
            batch_mb: batch_bytes.map(|b| b * 1e-6),
            gb_per_s: counter("bytes_moved").map(|bytes| bytes * 1e-9 / seconds),
            counters: one.counters.iter().filter_map(|c| Some((c.0.to_owned(), counter(c.0)?))).collect(),
        }
    }

    /// Computes the fragment rates as fractions of the GPU's fill rate.
    fn judge(&mut self, fill_rates: &[FillRate]) {
        // Unlit images sum only colours; all others sum normals and depths, too.
        let name = if self.shader == "unlit" { "blend" } else { "blend two" };
        let fill_rate =
            fill_rates.iter().find(|fill_rate| fill_rate.name == name).map(|fill_rate| fill_rate.fragments_per_s);
        let attributes_ms = self.stages_ms.get("attributes").copied().filter(|ms| *ms > 0.0);
        let share = |ms: f64| Some(self.fragments? as f64 / (ms * 1e-3) / fill_rate?);
        (self.share_of_blend, self.frame_share_of_blend) = (attributes_ms.and_then(share), share(self.median_ms));
    }
}

/// Returns the median; NaN without values. For an even number of values, it is the mean of the two middle ones.
pub(crate) fn median(values: &[f64]) -> f64 {
    0.5 * (quantile(values, 0.5 - 1e-12) + quantile(values, 0.5 + 1e-12))
}

/// Returns the quantile of the fraction `part`, which is 0 to 1; NaN without values.
pub(crate) fn quantile(values: &[f64], part: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (part * sorted.len() as f64).floor().max(0.0) as usize;
    sorted.get(at.min(sorted.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_render::PassTime;

    #[test]
    fn median_of_few() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(median(&[7.0]), 7.0);
        assert!(median(&[]).is_nan());
    }

    #[test]
    fn report_of_another_version_is_refused() {
        let problem = Report::parse(br#"{"version": 99}"#).unwrap_err();
        assert!(problem.contains("99") && problem.contains("measure again"), "{problem}");
        assert!(Report::parse(b"{}").unwrap_err().contains("none"));
        assert!(Report::parse(b"pixels").is_err());
    }

    #[test]
    fn row_is_judged_by_the_ceiling_of_its_targets() {
        let stats = Stats::default().with_passes(vec![PassTime { name: "attributes", ms: 5.0 }]).with_drawn(1);
        let samples = Samples { frames_ms: vec![10.0], stats: vec![stats], fragments: 4_000_000, ..Samples::default() };
        let subject =
            Subject { scene: "s".into(), about: String::new(), shader: "phong".into(), threads: 0, size: [8, 8] };
        let fill_rates = [("blend", 9e9), ("blend two", 1e9)]
            .map(|(name, fragments_per_s)| FillRate { name: name.into(), fragments_per_s });
        let mut row = Row::new(subject, samples);
        row.judge(&fill_rates);
        // 4·10⁶ fragments in 5 ms are 0.8·10⁹ a second.
        assert!((row.share_of_blend.unwrap() - 0.8).abs() < 1e-12);
        assert!((row.frame_share_of_blend.unwrap() - 0.4).abs() < 1e-12);
        row.shader = "unlit".into();
        row.judge(&fill_rates);
        assert!((row.share_of_blend.unwrap() - 0.8 / 9.0).abs() < 1e-12);
        row.judge(&[]);
        assert_eq!(row.share_of_blend, None);
    }

    #[test]
    fn report_takes_in_a_later_runs_frames_of_the_same_scene_and_threads() {
        let report = |frames: &[(&str, f64)]| {
            let machine =
                Machine { cpu: String::new(), threads: 1, system: String::new(), load: None, commit: String::new() };
            let backend =
                BackendFacts { name: "cpu".into(), adapter: String::new(), driver: String::new(), is_software: false };
            let row = |&(scene, ms): &(&str, f64)| {
                let subject = Subject {
                    scene: scene.into(),
                    about: String::new(),
                    shader: "phong".into(),
                    threads: 1,
                    size: [8, 8],
                };
                Row::new(subject, Samples { frames_ms: vec![ms], busy_ms: vec![2.0 * ms], ..Samples::default() })
            };
            Report::new(machine, backend, Vec::new(), frames.iter().map(row).collect())
        };
        let mut first = report(&[("a", 1.0), ("b", 2.0)]);
        first.extend(report(&[("b", 3.0), ("c", 4.0)]));
        let frames = |row: &Row| (row.frames_ms.clone(), row.busy_frames_ms.clone());
        assert_eq!(
            first.rows.iter().map(frames).collect::<Vec<_>>(),
            [(vec![1.0], vec![2.0]), (vec![2.0, 3.0], vec![4.0, 6.0])]
        );
    }

    #[test]
    fn row_rates_follow_from_the_median() {
        let stats = Stats::default()
            .with_splats(1000)
            .with_drawn(500)
            .with_bytes_per_splat(40.0)
            .with_counters(vec![("bytes_moved", 600.0 * 40.0 + 2.0 * 2e6), ("batch_bytes", 1e6)]);
        let samples = Samples {
            frames_ms: vec![30.0, 10.0, 20.0],
            busy_ms: vec![15.0],
            stats: vec![stats; 3],
            covered_px: 400,
            fragments: 4000,
        };
        let subject =
            Subject { scene: "s".into(), about: String::new(), shader: "phong".into(), threads: 1, size: [8, 8] };
        let row = Row::new(subject, samples);
        assert_eq!((row.median_ms, row.min_ms, row.splats_per_s), (20.0, 10.0, 5e4));
        assert_eq!((row.fragments_per_splat, row.fragments_per_px), (Some(8.0), Some(10.0)));
        // (600·40 + 2·2·10⁶) bytes in 20 ms.
        assert!((row.gb_per_s.unwrap() - 0.2012).abs() < 1e-9);
    }
}
