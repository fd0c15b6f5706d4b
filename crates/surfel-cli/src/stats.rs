//! Option `--stats`: prints median times and counts as JSON.

use serde_json::{Map, Value, json};
use surfel_render::RendererInfo;
use surfel_render::{Preset, Stats};

fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    let (_, m, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    *m
}

/// Returns a timed run with the number of fragments that another run of the same frame counted. Counters that only the
/// other run has are added.
pub(crate) fn with_fragments(mut run: Stats, counted: &Stats) -> Stats {
    run.fragments = counted.fragments;
    let unknown = |(name, _): &&(&str, f64)| run.counters.iter().all(|(known, _)| known != name);
    let more: Vec<_> = counted.counters.iter().filter(unknown).copied().collect();
    run.counters.extend(more);
    run
}

/// Returns the object that `--stats` prints: medians over `runs`, which has at least one run. `preset` is the preset
/// whose promise of accuracy applies.
pub(crate) fn json(runs: &[Stats], info: &RendererInfo, size: [u32; 2], frames: u32, preset: Option<Preset>) -> Value {
    let of = |f: fn(&Stats) -> f64| median(runs.iter().map(f).collect());
    let mut passes = Map::new();
    let mut counters = Map::new();
    for pass in runs.iter().flat_map(|s| &s.passes) {
        if !passes.contains_key(pass.name) {
            let same = runs.iter().flat_map(|s| &s.passes).filter(|p| p.name == pass.name);
            passes.insert(pass.name.to_owned(), json!(median(same.map(|p| p.ms).collect())));
        }
    }
    for (name, _) in runs.iter().flat_map(|s| &s.counters) {
        if !counters.contains_key(*name) {
            let same = runs.iter().flat_map(|s| &s.counters).filter(|c| c.0 == *name);
            counters.insert((*name).to_owned(), json!(median(same.map(|c| c.1).collect())));
        }
    }
    let moved = |s: &Stats| s.counters.iter().find(|c| c.0 == "bytes_moved").map(|c| c.1 * 1e-6 / s.frame_ms);
    let rates: Vec<f64> = runs.iter().filter_map(moved).filter(|rate| rate.is_finite()).collect();
    if !rates.is_empty() {
        counters.insert("gb_per_s".to_owned(), json!(median(rates)));
    }
    // Settings that match no preset have no promise of accuracy.
    let promise = preset.map(Preset::promise);
    json!({
        "preset": preset.map(Preset::name),
        "promise": promise.map(
            |p| json!({ "fidelity_db": p.fidelity_db, "fidelity_depth": p.fidelity_depth,
                        "fidelity_normal_deg": p.fidelity_normal_deg, "model_db": p.model_db,
                            "inside_db": p.inside_db })
        ),
        "frame_ms": of(|s| s.frame_ms),
        "passes": passes,
        "splats": of(|s| s.splats as f64) as u64,
        "drawn": of(|s| s.drawn as f64) as u64,
        "fragments": of(|s| s.fragments as f64) as u64,
        "bytes_per_splat": of(|s| s.bytes_per_splat),
        "backend": info.backend,
        "adapter": info.adapter,
        "driver": info.driver,
        "threads": of(|s| s.threads as f64) as u64,
        "width": size[0],
        "height": size[1],
        "frames": frames,
        "runs": runs.len(),
        "counters": counters,
    })
}
