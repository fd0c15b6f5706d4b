//! Tests of sweeps to the extremes: no fault within the required ranges.

use crate::validated_gpu;
use surfel_conformance::stability::{Draw, Measured, Precision, drawer, run, sweeps};
use surfel_reference::Renderer as Reference;

/// Returns the faults of backends within the required ranges, at every `step`-th value; the last one always counts.
fn faults(mut backends: Vec<(Precision, Box<Draw<'_>>)>, step: usize) -> Vec<String> {
    let mut reference = Reference::new(Default::default()).unwrap();
    let mut found = Vec::new();
    for mut sweep in sweeps() {
        let wanted: Vec<f64> = sweep.values.iter().copied().filter(|&v| sweep.requires(v)).collect();
        let last = wanted.len() - 1;
        sweep.values =
            wanted.into_iter().enumerate().filter(|(i, _)| (last - i).is_multiple_of(step)).map(|(_, v)| v).collect();
        let outcomes = run(&sweep, &mut reference, &mut backends).unwrap();
        // A sweep whose images are all empty would test nothing.
        for points in outcomes.iter().map(|outcome| &outcome.points) {
            let compared: usize = points.iter().map(|p| p.compared).sum();
            let drawn = points.iter().all(|p| !p.unsupported);
            assert!(!drawn || compared > 10, "{}: {compared} pixels compared", sweep.name);
        }
        let measured = Measured { sweep, outcomes, naive: Vec::new() };
        found.extend((0..backends.len()).flat_map(|backend| measured.faults(backend)));
    }
    found
}

#[test]
fn stability_of_the_reference_and_the_cpu() {
    let reference = Reference::new(Default::default()).unwrap();
    let cpu = surfel_cpu::Renderer::new(Default::default()).unwrap();
    let found = faults(vec![(Precision::F64, drawer(reference)), (Precision::F32, drawer(cpu))], 2);
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
#[ignore = "52 s on lavapipe with two cores: cargo xtask test --full"]
fn stability_of_gpus() {
    let ash = validated_gpu::ash().map(|ash| (Precision::GPU, drawer(ash)));
    let wgpu = validated_gpu::wgpu().map(|wgpu| (Precision::GPU, drawer(wgpu)));
    let found = faults(ash.into_iter().chain(wgpu).collect(), 3);
    assert!(found.is_empty(), "{}", found.join("\n"));
    validated_gpu::no_messages();
}
