//! Tests of the GPU backends' scene storage: in 16 bits like the CPU's, in parts, and within the available memory.

use crate::validated_gpu;
use glam::DVec3;
use surfel_ash::Limits;
use surfel_conformance::build;
use surfel_conformance::harness::{Truth, compare_frames, render};
use surfel_conformance::scenes;
use surfel_model::Storage;
use surfel_model::{OnInvalid, Scene, SplatCloud};
use surfel_render::{Frame, Planes, RenderError, Renderer, UploadProgress};

/// Compares images of 16-bit storage with the CPU's. The stored numbers are the same, so images differ no more than in
/// f32. Every fifth scene is drawn, and all with splats at the near plane.
fn draws_what_the_cpu_does(narrow: &mut impl Renderer, wide: &mut impl Renderer) {
    let options = surfel_cpu::Options::default().with_storage(Storage::Quantised);
    let mut cpu = surfel_cpu::Renderer::new(options).unwrap();
    let (mut as_in_f32, mut compared) = (0, 0);
    let drawn = Truth::of_every_scene().unwrap().iter().zip(validated_gpu::every_scene(wide));
    let drawn = drawn.filter_map(|(truth, wide)| Some((truth, wide.got.as_ref()?))).enumerate();
    for (_, (truth, wide)) in drawn.filter(|(i, (truth, _))| i % 5 == 0 || truth.case.name.contains("near")) {
        let case = &truth.case;
        let [got, want] = [render(narrow, case, Planes::ALL), render(&mut cpu, case, Planes::ALL)].map(Result::unwrap);
        // The pixels within the margin are nearly the same for splats in 16 bits.
        let margin = truth.want.as_ref().unwrap().margin();
        let report = compare_frames(&case.name, &got, &want, margin);
        assert!(report.is_ok(), "{report}");
        as_in_f32 += usize::from(got == *wide);
        compared += 1;
    }
    assert!(compared > 15, "{compared}");
    // A single splat is at its chunk's origin, and is the largest: none of its numbers is rounded.
    assert!(as_in_f32 * 3 < compared, "{as_in_f32} of {compared}");
}

#[test]
fn splats_in_16_bits_are_those_of_the_cpu() {
    let all = Limits::default();
    if let (Some(mut narrow), Some(mut wide)) = (validated_gpu::ash_with(all, Storage::Quantised), validated_gpu::ash())
    {
        draws_what_the_cpu_does(&mut narrow, &mut wide);
    }
}

#[test]
#[ignore = "94 s on lavapipe with two cores: cargo xtask test --full"]
fn splats_in_16_bits_on_wgpu_are_those_of_the_cpu() {
    let all = Limits::default();
    if let (Some(mut narrow), Some(mut wide)) =
        (validated_gpu::wgpu_with(all, Storage::Quantised), validated_gpu::wgpu())
    {
        draws_what_the_cpu_does(&mut narrow, &mut wide);
        validated_gpu::no_messages();
    }
}

/// Returns a ball of 20,000 disks, white or coloured.
fn ball(is_coloured: bool) -> Scene {
    let n = 20_000;
    let normal = |i: usize| {
        let (z, angle) = (1.0 - (2 * i + 1) as f64 / n as f64, i as f64 * 2.399_963);
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * angle.cos(), r * angle.sin(), z)
    };
    let disks: Vec<_> = (0..n).map(normal).map(|v| (v, v, 0.03)).collect();
    let mut data = build::disk_cloud(&disks, [1.0; 3]).data().clone();
    data.colors = is_coloured.then(|| disks.iter().map(|(v, ..)| (v.as_vec3() * 0.5 + 0.5).to_array()).collect());
    let cloud = SplatCloud::new(data, OnInvalid::Refuse).unwrap().0;
    Scene { objects: vec![build::object(cloud)], ..scenes::facing_splat().scene }
}

fn bytes_per_splat(renderer: &mut impl Renderer, scene: &Scene) -> f64 {
    let case = scenes::facing_splat();
    let resident = renderer.upload(scene).unwrap();
    let planes = Planes::COLOR;
    renderer
        .render_into(&resident, &case.view(), &case.settings, planes, &mut Frame::default())
        .unwrap()
        .bytes_per_splat
}

fn halves_memory(wide: &mut impl Renderer, narrow: &mut impl Renderer) {
    // In 32-bit words, a splat's chunk, centre, normal and radius have 32 bytes. In 16 bits, the chunk's word and six
    // numbers have 16. Colours add 12 and 6 bytes.
    for (is_coloured, words, halves) in [(false, 32.0, 16.0), (true, 44.0, 22.0)] {
        let scene = ball(is_coloured);
        assert_eq!(bytes_per_splat(wide, &scene), words);
        let bytes = bytes_per_splat(narrow, &scene);
        // Plus three scales per chunk of 256.
        assert!(bytes > halves && bytes < halves + 0.1, "{bytes}");
    }
}

#[test]
fn splats_in_16_bits_take_half_the_memory() {
    let all = Limits::default();
    if let (Some(mut wide), Some(mut narrow)) = (validated_gpu::ash(), validated_gpu::ash_with(all, Storage::Quantised))
    {
        halves_memory(&mut wide, &mut narrow);
    }
    if let (Some(mut wide), Some(mut narrow)) =
        (validated_gpu::wgpu(), validated_gpu::wgpu_with(all, Storage::Quantised))
    {
        halves_memory(&mut wide, &mut narrow);
        validated_gpu::no_messages();
    }
}

/// Limits of 5000 records per buffer.
const SMALL_BUFFERS: Limits = Limits {
    buffer_bytes: 5000 * 144,
    texture_side: u32::MAX,
    record_bytes: u64::MAX,
    cell_bytes: u64::MAX,
    memory_bytes: u64::MAX,
};

/// Limits of memory for all of the ball's splats, and half of their records.
const LITTLE_MEMORY: Limits = Limits { memory_bytes: 20_000 * 32 + 10_000 * 144, ..SMALL_BUFFERS };

fn says_how_far_it_is(renderer: &mut impl Renderer) {
    let mut seen: Vec<UploadProgress> = Vec::new();
    renderer.upload_reporting(&ball(false), &mut |progress| seen.push(progress)).unwrap();
    assert!(seen.len() > 4 && seen.iter().all(|p| p.total_bytes == 20_000 * 32), "{seen:?}");
    assert!(seen.windows(2).all(|pair| pair[0].done_bytes < pair[1].done_bytes), "{seen:?}");
    assert_eq!((seen[0].done_bytes, seen[seen.len() - 1].done_bytes), (0, 20_000 * 32));
}

fn says_by_how_much_it_is_too_small(renderer: &mut impl Renderer) {
    let mut began = false;
    let result = renderer.upload_reporting(&ball(false), &mut |_| began = true);
    let Err(error @ RenderError::SceneTooLarge { needed, available, .. }) = result else {
        panic!("the scene is taken to fit");
    };
    // Splats and their records, without textures.
    assert_eq!((needed, available), (20_000 * (32 + 144), LITTLE_MEMORY.memory_bytes));
    let text = error.to_string();
    assert!(text.contains("3520000 bytes") && text.contains("2080000") && text.contains(": 1440000 too few"), "{text}");
    assert!(!began, "something was copied");
}

#[test]
fn uploads_come_in_parts_and_stop_before_they_begin_where_memory_is_short() {
    if let (Some(mut small), Some(mut little)) =
        (validated_gpu::ash_with(SMALL_BUFFERS, Storage::F32), validated_gpu::ash_with(LITTLE_MEMORY, Storage::F32))
    {
        says_how_far_it_is(&mut small);
        says_by_how_much_it_is_too_small(&mut little);
    }
    if let (Some(mut small), Some(mut little)) =
        (validated_gpu::wgpu_with(SMALL_BUFFERS, Storage::F32), validated_gpu::wgpu_with(LITTLE_MEMORY, Storage::F32))
    {
        says_how_far_it_is(&mut small);
        says_by_how_much_it_is_too_small(&mut little);
        validated_gpu::no_messages();
    }
}
