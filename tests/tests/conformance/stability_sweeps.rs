//! Sweeps to the extremes: nothing may break where it has to work.

use crate::validated_gpu;
use surfel_conformance::stability::{Draw, Measured, Precision, drawer, run, sweeps};
use surfel_reference::Renderer as Reference;
use surfel_render::Renderer;

/// What breaks within the required ranges. Every `step`-th value of each sweep, the required one always.
fn faults(precision: Precision, renderer: impl Renderer + 'static, step: usize) -> Vec<String> {
    let mut reference = Reference::new(Default::default()).unwrap();
    let draw: Box<Draw<'_>> = drawer(renderer);
    let mut backends = [(precision, draw)];
    let mut found = Vec::new();
    for mut sweep in sweeps() {
        let wanted: Vec<f64> = sweep.values.iter().copied().filter(|&v| sweep.requires(v)).collect();
        let last = wanted.len() - 1;
        sweep.values =
            wanted.into_iter().enumerate().filter(|(i, _)| (last - i).is_multiple_of(step)).map(|(_, v)| v).collect();
        let outcomes = run(&sweep, &mut reference, &mut backends).unwrap();
        // A sweep whose images are all empty shows nothing.
        let points = &outcomes[0].points;
        let compared: usize = points.iter().map(|p| p.compared).sum();
        let drawn = points.iter().all(|p| !p.unsupported);
        assert!(!drawn || compared > 10, "{}: {compared} pixels compared", sweep.name);
        found.extend(Measured { sweep, outcomes, naive: Vec::new() }.faults(0));
    }
    found
}

#[test]
fn stability_of_the_reference() {
    let found = faults(Precision::F64, Reference::new(Default::default()).unwrap(), 2);
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn stability_of_the_cpu() {
    let found = faults(Precision::F32, surfel_cpu::Renderer::new(Default::default()).unwrap(), 2);
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn stability_of_wgpu() {
    if let Some(renderer) = validated_gpu::wgpu() {
        let found = faults(Precision::GPU, renderer, 3);
        assert!(found.is_empty(), "{}", found.join("\n"));
        validated_gpu::no_messages();
    }
}

#[test]
fn stability_of_ash() {
    if let Some(renderer) = validated_gpu::ash() {
        let found = faults(Precision::GPU, renderer, 3);
        assert!(found.is_empty(), "{}", found.join("\n"));
    }
}
