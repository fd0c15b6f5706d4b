//! Draws a conformance scene with the reference for visual inspection, larger than in the tests: `cargo run -p
//! surfel-conformance --example scene_image -- panes/lit/peel-3 6 panes.png`. Without arguments it lists the scenes.

use std::path::Path;
use surfel_conformance::{harness, scenes};
use surfel_io::{PlanesView, PngOptions};
use surfel_render::Planes;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, scale, out] = arguments.as_slice() else {
        scenes::all().iter().for_each(|case| println!("{}", case.name));
        return Ok(());
    };
    let found = scenes::all().into_iter().find(|case| case.name == *name);
    let mut case = found.ok_or_else(|| format!("no scene '{name}': without arguments this lists them"))?;
    let scale: u32 = scale.parse()?;
    case.camera.size = case.camera.size.map(|pixels| pixels * scale);
    let mut reference = surfel_reference::Renderer::new(Default::default())?;
    let frame = harness::render(&mut reference, &case, Planes::COLOR)?;
    let planes = PlanesView {
        width: frame.width(),
        height: frame.height(),
        color: Some(frame.color()),
        ..PlanesView::default()
    };
    surfel_io::save_png(Path::new(out), true, &planes, &PngOptions::default())?;
    Ok(())
}
