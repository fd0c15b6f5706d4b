//! Tests of the harness itself: right images pass, faulty ones don't.

use crate::faulty_renderer::{FAULTS, Faulty, KnownFault};
use surfel_conformance::harness::{Report, Truth, check, check_backend, compare_frames, reference_frame};
use surfel_conformance::scenes;
use surfel_reference::Renderer as Reference;
use surfel_render::{Frame, Planes};

fn failures(faulty: &mut Faulty) -> Vec<String> {
    check_backend(faulty).into_iter().filter(|r| !r.is_ok()).map(|r| r.name).collect()
}

#[test]
fn harness_passes_the_reference_itself_without_forgiving_anything() {
    let reports = check_backend(&mut Reference::new(surfel_reference::Options::default().with_threads(1)).unwrap());
    assert!(reports.len() > 45, "{}", reports.len());
    for report in &reports {
        assert!(report.is_ok() && report.forgiven == 0, "{report}");
        assert!(report.planes.len() == 4 && report.planes.iter().all(|p| p.worst == 0.0), "{report}");
    }
}

/// Scenes that are almost empty, or almost all margin, would test nothing.
#[test]
fn harness_scenes_show_something_outside_of_the_margin() {
    let mut marginal = Vec::new();
    for Truth { case, want } in Truth::of_every_scene().unwrap() {
        let frame = want.as_ref().unwrap();
        let covered = frame.depth().iter().filter(|z| z.is_finite()).count() as f64 / frame.depth().len() as f64;
        let share = frame.margin().iter().sum::<f32>() / frame.margin().len() as f32;
        println!("{:34} covered {:5.1} %, margin {:5.2} %", case.name, 100.0 * covered, 100.0 * share);
        assert!(covered > 0.004, "{} covers {covered}", case.name);
        if share > 0.15 {
            marginal.push((&case.name, share));
        }
    }
    assert!(marginal.is_empty(), "{marginal:?}");
}

#[test]
fn harness_passes_rounding_of_every_plane() {
    let mut faulty = Faulty::new();
    faulty.frame = |frame| {
        let mut sign = 1.0f32;
        let planes = frame.planes_mut();
        let planes = [planes.color.as_flattened_mut(), planes.normal.as_flattened_mut(), planes.depth, planes.weight];
        for value in planes.into_iter().flatten() {
            sign = -sign;
            *value *= 1.0 + sign * 2e-5;
        }
    };
    assert_eq!(failures(&mut faulty), Vec::<String>::new());
}

#[test]
fn harness_fails_faults() {
    let truths = Truth::of_every_scene().unwrap();
    for KnownFault { name: fault, make: change, scene } in FAULTS {
        let truth = truths.iter().find(|truth| truth.case.name == *scene).unwrap();
        let mut faulty = Faulty::new();
        change(&mut faulty);
        assert!(!check(&mut faulty, truth).report.is_ok(), "{fault} passes {scene}");
    }
}

fn compared(change: impl FnOnce(&mut Frame), margin: impl FnOnce(&mut Vec<f32>)) -> Report {
    let want = reference_frame(&mut Reference::new(Default::default()).unwrap(), &scenes::closed_sphere()).unwrap();
    let (mut got, mut mask) = (want.clone(), vec![0.0; want.margin().len()]);
    change(&mut got);
    margin(&mut mask);
    compare_frames("test", &got, &want, &mask)
}

#[test]
fn harness_forgives_few_outliers_and_only_within_the_margin() {
    let pixels = 72 * 72;
    let few = pixels / 41;
    assert!(compared(|_| (), |_| ()).is_ok());
    assert!(!compared(|f| f.color_mut()[100][1] += 0.01, |_| ()).is_ok());
    assert!(compared(|f| f.color_mut()[100][1] += 0.01, |m| m[100] = 1.0).is_ok());
    assert!(!compared(|f| f.color_mut()[100][1] += 0.01, |m| m[101] = 1.0).is_ok());
    let spoil = |n: usize| move |f: &mut Frame| f.weight_mut()[..n].iter_mut().for_each(|w| *w += 1.0);
    assert!(compared(spoil(few), |m| m.fill(1.0)).is_ok());
    assert!(!compared(spoil(few + 10), |m| m.fill(1.0)).is_ok());
}

#[test]
fn harness_fails_nan_infinity_and_missing_planes() {
    let middle = 36 * 72 + 36;
    assert!(!compared(|f| f.normal_mut()[middle][0] = f32::NAN, |m| m.fill(1.0)).is_ok());
    assert!(!compared(|f| f.depth_mut()[middle] = f32::INFINITY, |_| ()).is_ok());
    assert!(!compared(|f| f.depth_mut()[0] = 1.0, |_| ()).is_ok());
    assert!(!compared(|f| f.resize(f.width(), f.height(), Planes::ALL.with_weight(false)), |_| ()).is_ok());
    assert!(!compared(|f| f.resize(f.width() + 1, f.height(), Planes::ALL), |_| ()).is_ok());
}
