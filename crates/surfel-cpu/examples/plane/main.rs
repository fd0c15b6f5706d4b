//! Draws frames of equal splats, to count instructions: `plane RADIUS_PX FRAMES`, AVX2, one thread.
//!
//! Prints the number of block pairs per frame. The instructions of one frame, without start and upload, are the
//! difference between runs with eleven frames and with one, divided by ten. See docs/performance.md.

use surfel_cpu::{Options, Renderer, SimdLevel};
use surfel_model::{Settings, Shader};
use surfel_render::{Frame, Planes, Renderer as _};

mod scene;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<f64> = std::env::args().skip(1).map(|word| word.parse()).collect::<Result<_, _>>()?;
    let [radius_px, frames] = arguments[..] else { return Err("expected two arguments: RADIUS_PX FRAMES".into()) };
    if !(0.1..=256.0).contains(&radius_px) {
        return Err("RADIUS_PX is out of range, expected 0.1 to 256".into());
    }
    let (scene, view) = scene::plane(radius_px)?;
    let mut renderer = Renderer::new(Options::default().with_threads(1).with_simd(SimdLevel::Avx2))?;
    let resident = renderer.upload(&scene)?;
    let settings = Settings::default().with_shader(Shader::Phong);
    let mut frame = Frame::default();
    for i in 0..frames as usize {
        let planes = Planes::COLOR.with_fragments(i == 0);
        let stats = renderer.render_into(&resident, &view, &settings, planes, &mut frame)?;
        if i == 0 {
            println!("splats {} drawn {} fragments {}", stats.splats, stats.drawn, stats.fragments);
            stats.counters.iter().for_each(|(name, value)| println!("{name} {value}"));
        }
    }
    Ok(())
}
