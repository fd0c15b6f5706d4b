//! Compares each WGSL formula with its twin in surfel-math, on a real driver. Both run on the same f32 inputs, and
//! their errors are measured against the twin's f64 instantiation. The GPU's error may be at most twice the CPU's plus
//! 4 ulp.

#[macro_use]
mod kernels;
mod balls;
mod clips;
mod device;
mod inputs;
mod surfaces;

use device::Device;
use kernels::Kernel;
use std::collections::BTreeSet;
use surfel_shaders::TWINS;

/// Returns all kernels: the formulas that are compared.
fn all() -> impl Iterator<Item = &'static Kernel> {
    kernels::KERNELS.iter().chain(balls::KERNELS).chain(clips::KERNELS).chain(surfaces::KERNELS)
}

/// Number of samples of each kind of input.
const SAMPLES: usize = 2048;

/// Largest error of a kernel's outputs, in ulp of the scale of its result, and the number of the sample that has it.
#[derive(Clone, Copy, Debug, Default)]
struct Error {
    ulp: f64,
    sample: usize,
}

/// Returns the largest error of the outputs `got` against the kernel's results in f64. Samples whose exact result is
/// NaN or beyond f32's range are skipped.
fn error(kernel: &Kernel, inputs: &[Vec<f32>], got: &[f32]) -> Error {
    let mut worst = Error::default();
    for (i, (x, got)) in inputs.iter().zip(got.chunks_exact(kernel.outputs)).enumerate() {
        let wide: Vec<f64> = x.iter().map(|&v| v.into()).collect();
        let exact = (kernel.exact)(&wide);
        assert_eq!(exact.len(), kernel.outputs, "{}", kernel.name);
        if exact.iter().any(|e| !e.is_finite() || e.abs() > f64::from(f32::MAX)) {
            continue;
        }
        let mut at = 0;
        for (index, &length) in kernel.workgroups.iter().enumerate() {
            let group = &exact[at..at + length];
            // The scale of a vector is its largest coordinate; a kernel with sums that may cancel defines a larger one.
            let largest = group.iter().fold(0.0f64, |a, b| a.max(b.abs()));
            let scale = kernel.scale.map_or(largest, |scale| scale(&wide, index).max(largest));
            // Below the least normal number a GPU may return zero.
            let ulp = scale.max(f64::from(f32::MIN_POSITIVE) * 16.0) * f64::from(f32::EPSILON);
            for (g, e) in got[at..at + length].iter().zip(group) {
                let error = (f64::from(*g) - e).abs() / ulp;
                if error.is_nan() || error > worst.ulp {
                    worst = Error { ulp: if error.is_nan() { f64::INFINITY } else { error }, sample: i };
                }
            }
            at += length;
        }
    }
    worst
}

#[test]
fn formulas_on_the_gpu_err_at_most_twice_as_much_as_on_the_cpu() {
    let Some(device) = Device::open() else { return };
    let mut failures = Vec::new();
    for kernel in all() {
        for (kind, make) in [("ordinary", kernel.ordinary), ("adversarial", kernel.adversarial)] {
            let mut random = inputs::Random::new(kernel.name);
            let inputs: Vec<Vec<f32>> = (0..SAMPLES).map(|_| make(&mut random)).collect();
            let cpu: Vec<f32> = inputs.iter().flat_map(|x| (kernel.rounded)(x)).collect();
            let gpu = device.run(kernel, &inputs);
            let (cpu, gpu) = (error(kernel, &inputs, &cpu), error(kernel, &inputs, &gpu));
            println!("{:24} {kind:11} cpu {:10.2} gpu {:10.2} ulp", kernel.name, cpu.ulp, gpu.ulp);
            // A NaN counts as an infinite error.
            if gpu.ulp > 2.0 * cpu.ulp + 4.0 {
                let x = &inputs[gpu.sample];
                failures.push(format!("{} {kind}: cpu {}, gpu {} ulp at {x:?}", kernel.name, cpu.ulp, gpu.ulp));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn every_twin_is_measured() {
    let measured: BTreeSet<&str> = all().map(|kernel| kernel.name.split('/').next().unwrap()).collect();
    let twins: BTreeSet<&str> = TWINS.iter().map(|twin| twin.wgsl).collect();
    assert_eq!(measured, twins);
}
