//! Cost of a scene's features: the passes of its plan, and measured times.

use crate::page::Table;
use surfel_backend::BackendScene;
use surfel_gpu::PlanCost;
use surfel_render::{Capabilities, FramePlan, Pass, SceneSummary, plan};
use surfel_render::{Frame, Renderer, View};

use super::features::{Case, cases};
use super::measure::{Backends, median};
use super::subjects;
use crate::Failure;
use crate::machine::busy_ms;

fn planned(case: &Case, view: &View) -> Result<FramePlan, Failure> {
    let everything = Capabilities::everything("plan");
    Ok(plan(&SceneSummary::of(&case.scene), view, &case.settings, case.planes, &everything)?)
}

/// Returns the names of a plan's passes other than visibility, attributes and shading. A pass that runs several times
/// has its number of runs.
fn passes(plan: &FramePlan) -> String {
    let always = [Pass::Visibility, Pass::Attributes, Pass::Shade];
    let mut found: Vec<(Pass, usize)> = Vec::new();
    for pass in plan.passes.iter().filter(|pass| !always.contains(pass)) {
        match found.iter_mut().find(|(p, _)| p == pass) {
            Some((_, count)) => *count += 1,
            None => found.push((*pass, 1)),
        }
    }
    let words = found.iter().map(|(pass, count)| match count {
        1 => name(*pass).to_owned(),
        _ => format!("{count} × {}", name(*pass)),
    });
    let words: Vec<String> = words.collect();
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}

fn name(pass: Pass) -> &'static str {
    match pass {
        Pass::ShadowMap => "shadow map",
        Pass::Polygons => "polygons",
        Pass::Balls => "balls",
        Pass::Visibility => "visibility",
        Pass::Attributes => "attributes",
        Pass::Shade => "shading",
        Pass::EdgeAntialiasing => "edges",
        Pass::EdgeSamples => "edge samples",
        Pass::Outlines => "outlines",
        Pass::EyeDome => "eye-dome",
        Pass::Nearest => "nearest splats",
        Pass::PeelLayer => "peeled layer",
        Pass::RemainingLayer => "what remains",
        Pass::ABuffer => "A-buffer",
        Pass::Gaussians => "Gaussians",
    }
}

/// Measurements of a case: the time of each frame in milliseconds, and the memory of the uploaded scene.
#[derive(Clone, Default)]
pub(super) struct Measured {
    pub(super) ms: Vec<f64>,
    bytes_per_splat: Option<f64>,
}

/// Plans and times every case. Returns the table of costs.
pub(crate) fn table(backends: &mut Backends, runs: usize, size: u32) -> Result<Table, Failure> {
    let view = View::new(&subjects::camera([0.0, 0.3, 4.6], [0.0; 3], 32.0, size))?;
    let cases = cases(&view)?;
    let measured = measure(backends, &cases, &view, runs)?;
    let plans = cases.iter().map(|case| planned(case, &view)).collect::<Result<Vec<_>, _>>()?;
    let (Some(plain), Some(base)) = (plans.first(), measured.first().map(|m| median(&m.ms))) else {
        return Err("there is no plain scene".into());
    };
    let head = [
        "feature",
        "passes more than 3",
        "sums a pixel (bytes)",
        "GPU: targets",
        "bytes a pixel",
        "shaders",
        "bytes a splat",
        "ms",
        "over nothing",
    ];
    let mut table = Table::new(&head);
    for ((case, plan), measured) in cases.iter().zip(&plans).zip(&measured) {
        if case.absent && !decides_alike(plan, plain) {
            return Err(format!("{}: the plan is not the plain one", case.name).into());
        }
        let ms = median(&measured.ms);
        let dash = || "-".to_owned();
        let kept = plan.attributes.sums();
        let gpu = PlanCost::of(plan);
        let ratio = ms.zip(base).filter(|_| !case.other_scene);
        table.rows.push(vec![
            case.name.to_owned(),
            passes(plan),
            format!("{kept} ({})", 4 * kept),
            gpu.targets.len().to_string(),
            gpu.bytes_per_pixel.to_string(),
            gpu.shaders.len().to_string(),
            measured.bytes_per_splat.map_or_else(dash, |b| format!("{b:.1}")),
            ms.map_or_else(|| "not drawn".to_owned(), |ms| format!("{ms:.2}")),
            ratio.map_or_else(dash, |(ms, base)| format!("{:.2}×", ms / base)),
        ]);
        if case.absent {
            table.marked.push((table.rows.len() - 1, true));
        }
    }
    Ok(table)
}

/// True if two plans are equal apart from the number of splats, which isn't a decision of planning.
fn decides_alike(plan: &FramePlan, other: &FramePlan) -> bool {
    *plan == FramePlan { splats: plan.splats, ..other.clone() }
}

/// Draws all cases in alternation, several times; the first round warms up. Each case is drawn twice and timed once, as
/// in [`super::measure`]. A case that the backend can't draw has no times.
pub(super) fn measure(
    backends: &mut Backends,
    cases: &[Case],
    view: &View,
    runs: usize,
) -> Result<Vec<Measured>, Failure> {
    let mut uploads: Vec<BackendScene> = Vec::new();
    for case in cases {
        let backend = if case.quantised { &mut backends.narrow } else { &mut backends.wide };
        uploads.push(backend.upload(&case.scene)?);
    }
    let mut measured = vec![Measured::default(); cases.len()];
    let mut frame = Frame::default();
    for round in 0..=runs {
        for ((case, upload), measured) in cases.iter().zip(&uploads).zip(&mut measured) {
            let backend = if case.quantised { &mut backends.narrow } else { &mut backends.wide };
            let mut draw = || backend.render_into(upload, view, &case.settings, case.planes, &mut frame);
            if draw().is_err() {
                continue;
            }
            let (clock, busy) = (std::time::Instant::now(), busy_ms());
            let stats = draw()?;
            let elapsed = clock.elapsed().as_secs_f64() * 1e3;
            let busy = busy_ms().zip(busy).map(|(end, start)| end - start).filter(|_| backends.on_cpu);
            measured.bytes_per_splat = Some(stats.bytes_per_splat);
            if round > 0 {
                measured.ms.push(busy.unwrap_or(elapsed));
            }
        }
    }
    Ok(measured)
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_render::{Feature, unsupported};

    #[test]
    fn each_feature_of_scenes_has_a_case() {
        let view = View::new(&subjects::camera([0.0, 0.3, 4.6], [0.0; 3], 32.0, 128)).unwrap();
        let cases = cases(&view).unwrap();
        // Callers request the margin, and a sky is stored in splats before a backend gets the scene: see `light`.
        let in_scenes = |feature: &&Feature| !matches!(feature, Feature::Margin | Feature::Sky);
        for feature in Feature::ALL.iter().filter(in_scenes) {
            let without = Capabilities { backend: "test", lacks: std::slice::from_ref(feature) };
            let needs = |c: &Case| unsupported(&SceneSummary::of(&c.scene), &c.settings, c.planes, &without).is_some();
            assert!(cases.iter().any(needs), "{feature:?}");
        }
    }

    #[test]
    fn feature_that_is_absent_costs_nothing_in_the_plan_and_each_that_is_there_does() {
        let view = View::new(&subjects::camera([0.0, 0.3, 4.6], [0.0; 3], 32.0, 128)).unwrap();
        let cases = cases(&view).unwrap();
        let plain = planned(&cases[0], &view).unwrap();
        let plain_cost = PlanCost::of(&plain);
        assert_eq!((plain.attributes.sums(), plain_cost.targets.len()), (1, 2));
        assert!(cases.iter().filter(|case| case.absent).count() >= 5);
        for case in &cases[1..] {
            let plan = planned(case, &view).unwrap();
            // Shape and storage of splats don't affect the plan, only the backend.
            let same = case.absent || case.quantised || case.name == "ellipses";
            assert_eq!(decides_alike(&plan, &plain), same, "{}", case.name);
            // The same holds for the resources of a GPU. Every present feature adds a target, a byte or a shader,
            // except colours in 8 bits, which the host encodes.
            let cost_more = PlanCost::of(&plan) != plain_cost;
            assert_eq!(cost_more, !same && case.name != "colours" && !case.planes.rgba8, "{}", case.name);
        }
    }

    #[test]
    fn octree_is_of_splats_and_polygons() {
        let view = View::new(&subjects::camera([0.0, 0.3, 4.6], [0.0; 3], 32.0, 256)).unwrap();
        let octree = cases(&view).unwrap().into_iter().find(|case| case.name.starts_with("an octree")).unwrap();
        let plan = planned(&octree, &view).unwrap();
        assert!(plan.has(Pass::Polygons) && plan.splats > 100, "{plan:?}");
    }
}
