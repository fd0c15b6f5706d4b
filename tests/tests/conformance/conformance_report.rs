//! Tests of the reports of results: the table and the page.

use surfel_conformance::backends::{Backend, Run};
use surfel_conformance::expectations::Extent;
use surfel_conformance::harness::{Truth, Verdict, check_all};
use surfel_conformance::report::{Entry, page, table};
use surfel_reference::Renderer as Reference;
use surfel_render::Renderer;

const SCENES: [&str; 2] = ["facing-splat", "tilted-splat"];

/// Returns a run of the reference on two scenes; unless `is_right`, the second is marked as failed.
fn run(truths: &[Truth], is_right: bool) -> Run {
    let mut reference = Reference::new(surfel_reference::Options::default().with_threads(1)).unwrap();
    let mut checked = check_all(&mut reference, truths, Extent::SomeScenes);
    if !is_right {
        checked[1].report.verdict = Verdict::Failed("spoilt <here>".into());
    }
    Run { info: reference.info().clone(), note: None, checked }
}

fn truths() -> Vec<Truth> {
    Truth::all(|name| SCENES.contains(&name)).unwrap()
}

#[test]
fn table_has_failures_first_and_says_what_is_skipped() {
    let truths = truths();
    let right = vec![Entry::Ran(run(&truths, true)), Entry::Absent(Backend::Ash, "no driver".into())];
    let text = table(&right);
    assert!(right.iter().all(Entry::is_ok) && text.starts_with("backend") && !text.contains("FAILED"), "{text}");
    assert!(text.contains("2 passed") && text.contains("skipped: ash: no driver"), "{text}");
    let missing = Entry::Missing(Backend::Wgpu, "no adapter".into());
    assert!(!missing.is_ok());
    let wrong = vec![Entry::Ran(run(&truths, true)), Entry::Ran(run(&truths, false)), missing];
    let text = table(&wrong);
    assert!(text.contains("tilted-splat: FAILED: spoilt <here>") && text.contains("1 passed, 1 failed"), "{text}");
    assert!(text.contains("SURFEL_REQUIRE asks for wgpu, but: no adapter"), "{text}");
    let verdicts = text.lines().skip_while(|line| !line.starts_with("backend")).skip(1);
    let verdicts: Vec<bool> = verdicts.take(3).map(|line| line.ends_with("FAILED")).collect();
    assert_eq!(verdicts, [true, true, false], "{text}");
}

#[test]
fn page_has_failures_first_and_its_images_inside() {
    let truths = truths();
    let page = page(&[Entry::Ran(run(&truths, false))], &truths).unwrap();
    let at = |text: &str| page.find(text).unwrap_or_else(|| panic!("no {text}"));
    assert!(at("<h2 class=\"bad\">tilted-splat") < at("<h2>facing-splat"));
    assert!(at("Conformance: FAILED") < at("spoilt &lt;here&gt;"));
    // Reference, margin, image and difference of two scenes; nothing external.
    assert_eq!(page.matches("src=\"data:image/png;base64,iVBORw0KGgo").count(), 8);
    assert_eq!(page.matches("src=").count(), 8);
    assert!(!page.contains("http") && !page.contains("<link") && !page.contains("<script"));
}
