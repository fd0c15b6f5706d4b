//! One program compiled with each backend crate: the versions differ only in the line that names the crate.

#![cfg(all(feature = "cpu", feature = "reference"))]

mod on_reference {
    use surfel_reference as backend;
    include!("swap/program.rs");
}

mod on_cpu {
    use surfel_cpu as backend;
    include!("swap/program.rs");
}

#[cfg(feature = "wgpu")]
mod on_wgpu {
    use surfel_wgpu as backend;
    include!("swap/program.rs");
}

#[cfg(feature = "ash")]
mod on_ash {
    use surfel_ash as backend;
    include!("swap/program.rs");
}

/// Fails if a colour differs from the reference's by more than rounding.
fn is_the_reference_image(frame: &surfel_render::Frame) {
    let want = on_reference::draw().unwrap();
    assert_eq!((frame.width(), frame.height()), (80, 60));
    let colors = frame.color().as_flattened().iter().zip(want.color().as_flattened());
    let worst = colors.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-4, "{worst}");
    let covered = want.color().iter().filter(|c| c[3] > 0.0).count();
    assert!((900..3000).contains(&covered), "{covered} pixels are covered");
}

#[test]
fn cpu_is_the_reference_by_another_name() {
    is_the_reference_image(&on_cpu::draw().unwrap());
}

/// Compares with the reference, except on machines without a GPU or with a software driver.
#[cfg(any(feature = "wgpu", feature = "ash"))]
fn is_the_reference_image_where_there_is_an_adapter(
    name: &str,
    drawn: Result<surfel_render::Frame, Box<dyn std::error::Error>>,
) {
    match drawn {
        Ok(frame) => is_the_reference_image(&frame),
        Err(error) => {
            let required = std::env::var("SURFEL_REQUIRE").unwrap_or_default();
            assert!(!required.split(',').any(|word| word.trim() == name), "SURFEL_REQUIRE asks for {name}: {error}");
            println!("skipped: {error}");
        }
    }
}

#[cfg(feature = "wgpu")]
#[test]
fn wgpu_is_the_reference_by_another_name() {
    is_the_reference_image_where_there_is_an_adapter("wgpu", on_wgpu::draw());
}

#[cfg(feature = "ash")]
#[test]
fn ash_is_the_reference_by_another_name() {
    is_the_reference_image_where_there_is_an_adapter("ash", on_ash::draw());
}
