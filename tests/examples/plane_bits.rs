//! Prints a hash of every plane of every conformance scene as `cpu` draws it, with splats in f32 and in 16 bits: `cargo
//! run -p surfel-conformance --example plane_bits`. Every machine prints the same hashes, emulated CPUs included
//! (docs/testing.md).

use surfel_conformance::{harness, scenes};
use surfel_cpu::{Options, Renderer, Storage};
use surfel_render::{Frame, Planes, Renderer as _};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let started = |storage| Renderer::new(Options::default().with_storage(storage));
    let mut renderers = [started(Storage::F32)?, started(Storage::Quantised)?];
    eprintln!("{}", renderers[0].info().adapter);
    let planes = Planes::ALL.with_fragments(true).with_rgba8(true);
    for case in scenes::all() {
        let mut line = format!("{:44}", case.name);
        for renderer in &mut renderers {
            let frame = harness::render(renderer, &case, planes)?;
            line += &numbers(&frame).map(|number| format!(" {number:016x}")).concat();
        }
        println!("{line}");
    }
    Ok(())
}

/// Returns the hashes of six planes: colour, depth, normal, weight, fragments, and colour in 8 bits.
fn numbers(frame: &Frame) -> [u64; 6] {
    let of = |values: &[f32]| fnv1a(values.iter().map(|value| value.to_bits()));
    [
        of(frame.color().as_flattened()),
        of(frame.depth()),
        of(frame.normal().as_flattened()),
        of(frame.weight()),
        fnv1a(frame.fragments().iter().copied()),
        fnv1a(frame.rgba8().iter().copied().map(u32::from_le_bytes)),
    ]
}

/// Returns the FNV-1a hash of 32-bit words.
fn fnv1a(words: impl Iterator<Item = u32>) -> u64 {
    words.fold(0xcbf2_9ce4_8422_2325, |sum, word| (sum ^ u64::from(word)).wrapping_mul(0x100_0000_01b3))
}
