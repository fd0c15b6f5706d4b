use super::*;
use crate::kit::record::Kit;
use crate::kit::work::Work;
use crate::report::{Row, Samples, Subject};
use surfel_render::PassTime;
use surfel_render::Stats;

fn frame(backend: &str, adapter: &str, is_software: bool, hashes: [&str; 2]) -> Record {
    let passes = vec![PassTime { name: "setup", ms: 2.0 }, PassTime { name: "attributes", ms: 6.0 }];
    let stats = Stats::default().with_passes(passes).with_splats(1000).with_drawn(500);
    let subject = Subject {
        scene: "igea-like".into(),
        about: String::new(),
        shader: "phong".into(),
        threads: 0,
        size: [1024, 1024],
    };
    let samples = Samples { frames_ms: vec![9.0], stats: vec![stats], fragments: 4_000_000, ..Samples::default() };
    let setup = Work { pass: "setup".into(), bytes: 1e9, compute_flops: 1e6, ..Work::default() };
    let fill = vec![("blend".to_owned(), 4e6)];
    let attributes = Work { pass: "attributes".into(), bytes: 1e6, fill, ..Work::default() };
    Record::Frame(Box::new(Frame {
        backend: backend.into(),
        adapter: adapter.into(),
        is_software,
        load_ms: 0.0,
        upload_ms: 5.0,
        first_ms: 0.0,
        hashes: [("color".to_owned(), hashes.map(str::to_owned).to_vec())].into(),
        work: vec![setup, attributes],
        row: Row::new(subject, samples),
    }))
}

fn probe(name: &str, per_s: f64) -> Record {
    let (backend, unit) = ("wgpu".to_owned(), "byte".to_owned());
    Record::Probe(Probe { backend, adapter: "card".into(), is_software: false, name: name.into(), unit, per_s })
}

fn scene(backend: &str, name: &str, verdict: &str, passes: &[&str], hashes: [&str; 2]) -> Record {
    Record::Conformance(Conformance {
        backend: backend.into(),
        scene: name.into(),
        verdict: verdict.into(),
        why: if verdict == "passed" { String::new() } else { "3 pixels of Z are off".into() },
        plane: Some("Z".into()),
        worst: Some(0.5),
        passes: passes.iter().map(|pass| (*pass).to_owned()).collect(),
        hashes: [("color".to_owned(), hashes.map(str::to_owned).to_vec())].into(),
        ..Conformance::default()
    })
}

#[test]
fn page_names_the_gpu_that_was_measured_and_passes_far_from_their_bound() {
    let records = [
        Record::Kit(Kit { commit: "abc".into(), glibc: "2.35".into() }),
        frame("ash", "Card 9000", false, ["1", "1"]),
        probe("memory copy", 1e12),
        probe("fill: blend", 2e9),
    ];
    let page = page(&records, &[]);
    assert!(page.contains("Measured on **Card 9000**") && !page.contains(NOT_MEASURED), "{page}");
    assert!(page.contains("commit abc"), "{page}");
    // 10⁹ bytes take 1 of 2 ms, 4·10⁶ fragments 2 of 6 ms.
    assert!(page.contains("| setup | 2.000 | 1000.00 | 1.00 | - | - | memory | 1.0000 | 2.0 |"), "{page}");
    assert!(page.contains("1. **attributes** on ash, igea-like at 1024×1024: 6.000 ms, 3.0 times"), "{page}");
    assert!(page.contains("2. **setup** on ash"), "{page}");
}

#[test]
fn page_of_software_or_of_nothing_says_that_no_gpu_was_measured() {
    let software = page(&[frame("wgpu", "llvmpipe", true, ["1", "1"])], &[7]);
    assert!(software.contains(NOT_MEASURED) && software.contains("llvmpipe"), "{software}");
    assert!(software.contains("cut off or unknown: 7."), "{software}");
    // Frames drawn by a CPU measure no GPU.
    let nothing = page(&[frame("cpu", "AVX-512", false, ["1", "1"])], &[]);
    assert!(nothing.contains(NOT_MEASURED) && !nothing.contains("Measured on **"), "{nothing}");
}

#[test]
fn page_tells_failed_scenes_and_passes_that_are_not_the_same_each_time() {
    let records = [
        scene("ash", "plain", "passed", &["setup", "shade"], ["1", "1"]),
        scene("ash", "glass", "FAILED", &["setup", "layers"], ["1", "2"]),
        scene("wgpu", "plain", "passed", &["setup"], ["1", "1"]),
    ];
    let page = page(&records, &[]);
    assert!(page.contains("| ash | 2 | 1 | 0 | 0 | 1 |"), "{page}");
    assert!(page.contains("- ash, glass: FAILED: 3 pixels of Z are off"), "{page}");
    let steady = "- ash: 1 of 2 scenes are the same bits each time. Passes that occur in such scenes: setup, shade; in \
                  others alone: layers.\n  - glass: color differ\n";
    assert!(page.contains(steady), "{page}");
    assert!(page.contains("- wgpu: 1 of 1 scenes"), "{page}");
}

#[test]
fn folder_without_results_is_refused_with_what_to_do() {
    let absent = run(Path::new("absent-folder"), None).unwrap_err().to_string();
    assert!(absent.contains("results.jsonl") && absent.contains("run.sh"), "{absent}");
}
