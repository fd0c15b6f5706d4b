//! Page of a kit's measurements, such as `docs/data/gpu.md`.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use super::record::{Conformance, Device, Frame, Probe, RESULTS, Record, Step, parse};
use super::roofline::{Roofline, farthest};
use crate::Failure;
use crate::machine::Machine;
use crate::page::Table;

/// GPU backends, in the order of the page's columns.
const GPU_BACKENDS: [&str; 2] = ["ash", "wgpu"];

/// Text that marks a page without a measured GPU. `cargo xtask tidy` searches for it.
const NOT_MEASURED: &str = "**Not measured.**";

/// Properties of devices that the page shows, by their names in Vulkan or in wgpu. `results.jsonl` contains more.
const FACTS: [&str; 12] = [
    "deviceType",
    "memoryHeaps",
    "timestampPeriod",
    "subgroupSize",
    "maxImageDimension2D",
    "maxStorageBufferRange",
    "blends R32G32B32A32_SFLOAT",
    "occlusionQueryPrecise",
    "pipelineStatisticsQuery",
    "max_texture_dimension_2d",
    "max_storage_buffer_binding_size",
    "max_buffer_size",
];

/// Names of the scenes whose passes the page lists, for the first image size. `results.jsonl` contains the passes of
/// all scenes.
const SHOWN: [&str; 5] = ["igea-like", "igea-like-unlit", "igea-like-edges", "5M", "far"];

/// Writes the page about `results.jsonl` in the folder `out` to the file `markdown`, or prints it.
pub(super) fn run(out: &Path, markdown: Option<&Path>) -> Result<(), Failure> {
    let path = out.join(RESULTS);
    let text = std::fs::read_to_string(&path)
        .map_err(|error| format!("{}: {error}; expected a folder that the kit's run.sh wrote", path.display()))?;
    let (records, bad) = parse(&text);
    if records.is_empty() {
        return Err(format!("{}: holds no record, expected lines of JSON that run.sh wrote", path.display()).into());
    }
    let page = page(&records, &bad);
    match markdown {
        None => print!("{page}"),
        Some(path) => {
            surfel_io::atomic::write(path, true, |out| out.write_all(page.as_bytes()))?;
            println!("written to {}", path.display());
        }
    }
    Ok(())
}

/// Records of a kit, grouped by kind.
#[derive(Default)]
struct Found<'a> {
    commit: &'a str,
    machine: Option<&'a Machine>,
    devices: Vec<&'a Device>,
    steps: Vec<&'a Step>,
    notes: Vec<&'a str>,
    frames: Vec<&'a Frame>,
    conformance: Vec<&'a Conformance>,
    probes: Vec<&'a Probe>,
}

impl<'a> Found<'a> {
    fn of(records: &'a [Record]) -> Self {
        let mut found = Self::default();
        for record in records {
            match record {
                Record::Kit(kit) => found.commit = &kit.commit,
                Record::Machine(machine) => found.machine = Some(machine),
                Record::Device(device) => found.devices.push(device),
                Record::Step(step) => found.steps.push(step),
                Record::Note { text } => found.notes.push(text),
                Record::Frame(frame) => found.frames.push(frame),
                Record::Conformance(scene) => found.conformance.push(scene),
                Record::Probe(probe) => found.probes.push(probe),
            }
        }
        found
    }

    /// Returns the frames that GPU backends drew.
    fn on_gpu(&self) -> impl Iterator<Item = &'a Frame> {
        self.frames.iter().copied().filter(|frame| GPU_BACKENDS.contains(&frame.backend.as_str()))
    }

    /// Returns the name of the GPU whose frames were timed; `None` if no hardware GPU was.
    fn measured(&self) -> Option<&'a str> {
        self.on_gpu().find(|frame| !frame.is_software).map(|frame| frame.adapter.as_str())
    }
}

fn page(records: &[Record], bad: &[usize]) -> String {
    let found = Found::of(records);
    let mut text = String::from("<!-- Written by `cargo xtask gpu-report FOLDER`. -->\n\n# Figures of a GPU\n\n");
    text += &head(&found);
    let sections: [fn(&Found<'_>) -> String; 7] = [steps, devices, conformance, frames, passes, probes, determinism];
    for section in sections {
        text += &section(&found);
    }
    if !bad.is_empty() {
        let lines: Vec<String> = bad.iter().map(ToString::to_string).collect();
        // Writing to a string can't fail.
        let _ = writeln!(text, "\nLines of `{RESULTS}` that are cut off or unknown: {}.", lines.join(", "));
    }
    text
}

/// Returns the sentence of the page that names the measured device.
fn head(found: &Found<'_>) -> String {
    let software = found.on_gpu().next().map(|frame| frame.adapter.as_str());
    let mut text = match (found.measured(), software) {
        (Some(gpu), _) => format!("Measured on **{gpu}**"),
        (None, Some(adapter)) => format!(
            "{NOT_MEASURED} No GPU has run this kit. What follows is of {adapter}, which computes on the CPU: it \
             shows that the kit works and what the page holds. Its times, of small images of few splats, say nothing \
             about GPUs. Run"
        ),
        (None, None) => format!("{NOT_MEASURED} No GPU backend drew a frame. Run"),
    };
    if let Some(machine) = found.machine {
        let cpu = if machine.cpu.is_empty() { "an unnamed CPU" } else { &machine.cpu };
        let _ = write!(text, " on {cpu}, {} threads", machine.threads);
    }
    let _ = writeln!(text, ", commit {}.", if found.commit.is_empty() { "unknown" } else { found.commit });
    let _ = writeln!(text, "[performance.md](../performance.md#a-gpu) says how to measure another.");
    text
}

fn steps(found: &Found<'_>) -> String {
    let mut table = Table::new(&["step", "s", "outcome"]);
    for step in &found.steps {
        table.rows.push(vec![step.name.clone(), format!("{:.0}", step.seconds), step.outcome.clone()]);
    }
    let total: f64 = found.steps.iter().map(|step| step.seconds).sum();
    let mut text = format!("\n## Steps\n\n{}\nTogether {total:.0} s.\n", table.markdown());
    for note in &found.notes {
        let _ = write!(text, "\n- {note}");
    }
    text + if found.notes.is_empty() { "" } else { "\n" }
}

fn devices(found: &Found<'_>) -> String {
    let mut table = Table::new(&["backend", "device", "driver", "kind", "limits and features"]);
    for device in &found.devices {
        let facts: Vec<String> =
            FACTS.iter().filter_map(|name| Some(format!("{name} {}", device.facts.get(*name)?))).collect();
        let kind = if device.is_software { "CPU" } else { "GPU" };
        table.rows.push(vec![
            device.backend.clone(),
            device.adapter.clone(),
            device.driver.clone(),
            kind.to_owned(),
            facts.join("; "),
        ]);
    }
    format!("\n## Devices\n\n{}", table.markdown())
}

fn conformance(found: &Found<'_>) -> String {
    let mut table =
        Table::new(&["backend", "scenes", "passed", "as expected", "skipped", "failed", "worst", "of tolerance", "s"]);
    let mut failures = String::new();
    for backend in GPU_BACKENDS {
        let scenes: Vec<_> = found.conformance.iter().filter(|scene| scene.backend == backend).collect();
        let count = |verdict: &str| scenes.iter().filter(|scene| scene.verdict == verdict).count().to_string();
        let Some(worst) = scenes.iter().max_by(|a, b| a.worst.unwrap_or(-1.0).total_cmp(&b.worst.unwrap_or(-1.0)))
        else {
            continue;
        };
        let seconds = scenes.iter().map(|scene| scene.ms).sum::<f64>() * 1e-3;
        table.rows.push(vec![
            backend.to_owned(),
            scenes.len().to_string(),
            count("passed"),
            count("as expected"),
            count("skipped"),
            count("FAILED"),
            format!("{} of {}", worst.plane.as_deref().unwrap_or("nothing"), worst.scene),
            worst.worst.map_or("-".to_owned(), |worst| format!("{worst:.3}")),
            format!("{seconds:.1}"),
        ]);
        for scene in scenes.iter().filter(|scene| scene.verdict == "FAILED" || !scene.why.is_empty()) {
            let _ = writeln!(failures, "- {backend}, {}: {}: {}", scene.scene, scene.verdict, scene.why);
        }
    }
    let intro = "Every scene of at most 256² against the reference, whose images are in the kit.";
    let failures = if failures.is_empty() { failures } else { format!("\n{failures}") };
    format!("\n## Conformance\n\n{intro}\n\n{}{failures}", table.markdown())
}

fn frames(found: &Found<'_>) -> String {
    let all = ["ash", "wgpu", "cpu"];
    let titles = ["scene", "size", "splats", "drawn", "Mfragments", "ash, ms (least)", "wgpu, ms (least)"];
    let titles: Vec<&str> =
        titles.into_iter().chain(["cpu, ms (least)", "passes, ms: ash", "wgpu", "upload, ms: ash", "wgpu"]).collect();
    let mut table = Table::new(&titles);
    let mut keys: Vec<(&str, [u32; 2])> = Vec::new();
    for frame in &found.frames {
        let key = (frame.row.scene.as_str(), frame.row.size);
        if !keys.contains(&key) {
            keys.push(key);
        }
    }
    for (scene, size) in keys {
        let of = |backend: &str| {
            let same = |frame: &&&Frame| (frame.row.scene.as_str(), frame.row.size) == (scene, size);
            found.frames.iter().filter(same).find(|frame| frame.backend == backend)
        };
        let Some(any) = all.iter().find_map(|backend| of(backend)) else { continue };
        let cell = |backend: &str, value: &dyn Fn(&Frame) -> String| of(backend).map_or("-".to_owned(), |f| value(f));
        let time = |frame: &Frame| format!("{:.2} ({:.2})", frame.row.median_ms, frame.row.min_ms);
        let passes = |frame: &Frame| format!("{:.2}", frame.row.stages_ms.values().sum::<f64>());
        let upload = |frame: &Frame| format!("{:.1}", frame.upload_ms);
        let fragments = all.iter().find_map(|backend| of(backend)?.row.fragments);
        table.rows.push(vec![
            scene.to_owned(),
            format!("{}×{}", size[0], size[1]),
            any.row.splats.to_string(),
            any.row.drawn.to_string(),
            fragments.map_or("-".to_owned(), |count| format!("{:.2}", count as f64 * 1e-6)),
            cell("ash", &time),
            cell("wgpu", &time),
            cell("cpu", &time),
            cell("ash", &passes),
            cell("wgpu", &passes),
            cell("ash", &upload),
            cell("wgpu", &upload),
        ]);
    }
    let intro = "Medians and least times of a frame, from the call to planes in the CPU's memory; the sum of the \
                 passes by the device's clock; the upload of the scene.";
    format!("\n## Frames\n\n{intro}\n\n{}", table.markdown())
}

fn passes(found: &Found<'_>) -> String {
    let roofline = Roofline::of(&found.probes);
    let mut table = Table::new(&[
        "backend",
        "scene",
        "size",
        "pass",
        "ms",
        "MB",
        "Mflop",
        "Mfragments",
        "Mquads",
        "bound by",
        "bound, ms",
        "times over",
    ]);
    let judged: Vec<_> = found.on_gpu().flat_map(|frame| roofline.judge(frame)).collect();
    let first = found.on_gpu().next().map(|frame| frame.row.size);
    let is_shown = |frame: &Frame| Some(frame.row.size) == first && SHOWN.contains(&frame.row.scene.as_str());
    for pass in judged.iter().filter(|pass| is_shown(pass.frame)) {
        let work = pass.work.cloned().unwrap_or_default();
        let number = |value: f64| if value > 0.0 { format!("{:.2}", value * 1e-6) } else { "-".to_owned() };
        let (by, ms, over) = match &pass.bound {
            Some(bound) => (bound.by.clone(), format!("{:.4}", bound.ms), format!("{:.1}", pass.ratio_to_bound())),
            None => ("-".to_owned(), "-".to_owned(), "-".to_owned()),
        };
        table.rows.push(vec![
            pass.frame.backend.clone(),
            pass.frame.row.scene.clone(),
            format!("{}×{}", pass.frame.row.size[0], pass.frame.row.size[1]),
            pass.name.to_owned(),
            format!("{:.3}", pass.ms),
            number(work.bytes),
            number(work.compute_flops + work.fragment_flops),
            number(work.fill.iter().map(|fill| fill.1).sum()),
            number(work.quads),
            by,
            ms,
            over,
        ]);
    }
    let mut text = format!(
        "\n## Passes and the roofline\n\nTimes by the device's clock, medians. Bytes are those that have to be moved \
         once, operations are counted by hand in the shaders, to a factor of two. A pass can't take less time than the \
         largest of its bytes, operations, fragments and quads over what the probes below reach: its \
         bound.\n\n{}",
        table.markdown()
    );
    let farthest = farthest(&judged);
    if !farthest.is_empty() {
        text += "\nFarthest from their bound, of passes that take a fiftieth of their frame's passes or more:\n\n";
        for (i, pass) in farthest.iter().enumerate() {
            let Some(bound) = &pass.bound else { continue };
            let _ = writeln!(
                text,
                "{}. **{}** on {}, {} at {}×{}: {:.3} ms, {:.1} times its bound by {}",
                i + 1,
                pass.name,
                pass.frame.backend,
                pass.frame.row.scene,
                pass.frame.row.size[0],
                pass.frame.row.size[1],
                pass.ms,
                pass.ratio_to_bound(),
                bound.by
            );
        }
    }
    text
}

fn probes(found: &Found<'_>) -> String {
    let mut table = Table::new(&["backend", "probe", "10⁹ a second", "of"]);
    for probe in &found.probes {
        table.rows.push(vec![
            probe.backend.clone(),
            probe.name.clone(),
            format!("{:.2}", probe.per_s * 1e-9),
            format!("{}s", probe.unit),
        ]);
    }
    format!("\n## Probes\n\nWhat the device does at best, of several runs.\n\n{}", table.markdown())
}

/// Returns the section on the reproducibility of frames. It lists the passes of scenes whose repeated images are
/// identical, the passes that occur only in other scenes, and the planes that differ.
fn determinism(found: &Found<'_>) -> String {
    let mut text = "\n## Repeated frames\n\nEvery conformance scene and every scene above is drawn five times, by \
                    software twice, and its planes are hashed.\n\n"
        .to_owned();
    for backend in GPU_BACKENDS {
        let scenes = found.conformance.iter().filter(|scene| scene.backend == backend && !scene.hashes.is_empty());
        let of_scenes = scenes.map(|scene| Repeats {
            scene: scene.scene.clone(),
            passes: scene.passes.iter().map(String::as_str).collect(),
            hashes: &scene.hashes,
        });
        let frames = found.frames.iter().filter(|frame| frame.backend == backend);
        let of_frames = frames.map(|frame| Repeats {
            scene: format!("{} at {}×{}", frame.row.scene, frame.row.size[0], frame.row.size[1]),
            passes: frame.row.stages_ms.keys().map(String::as_str).collect(),
            hashes: &frame.hashes,
        });
        let all: Vec<Repeats<'_>> = of_scenes.chain(of_frames).collect();
        if !all.is_empty() {
            text += &repeats(backend, &all);
        }
    }
    text
}

/// Hashes of a scene's planes from repeated frames.
struct Repeats<'a> {
    scene: String,
    passes: Vec<&'a str>,
    hashes: &'a BTreeMap<String, Vec<String>>,
}

impl Repeats<'_> {
    /// Returns the names of the planes whose hashes differ between frames.
    fn unsteady(&self) -> Vec<&str> {
        let differs = |hashes: &[String]| hashes.iter().any(|hash| *hash != hashes[0]);
        self.hashes.iter().filter(|plane| differs(plane.1)).map(|plane| plane.0.as_str()).collect()
    }
}

fn repeats(backend: &str, all: &[Repeats<'_>]) -> String {
    let (unsteady, steady): (Vec<&Repeats<'_>>, Vec<&Repeats<'_>>) =
        all.iter().partition(|scene| !scene.unsteady().is_empty());
    let names = |scenes: &[&Repeats<'_>]| {
        let mut names: Vec<String> =
            scenes.iter().flat_map(|scene| scene.passes.iter().map(|pass| (*pass).to_owned())).collect();
        names.sort();
        names.dedup();
        names
    };
    let of_steady = names(&steady);
    let mut suspects = names(&unsteady);
    suspects.retain(|pass| !of_steady.contains(pass));
    let list = |names: &[String]| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    let mut text = format!(
        "- {backend}: {} of {} scenes are the same bits each time. Passes that occur in such scenes: {}; in others \
         alone: {}.\n",
        steady.len(),
        all.len(),
        list(&of_steady),
        list(&suspects)
    );
    for scene in &unsteady {
        let _ = writeln!(text, "  - {}: {} differ", scene.scene, scene.unsteady().join(", "));
    }
    text
}

#[cfg(test)]
mod tests;
