//! Draws a file as an image.
//!
//! `cargo run --release -p surfel --example image -- assets/spot/spot.obj spot.png`

use surfel::{Backend, NoProgress};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args_os().skip(1);
    let (Some(input), Some(output)) = (arguments.next(), arguments.next()) else {
        return Err("usage: image INPUT OUTPUT.png".into());
    };
    let loaded = surfel::open(&[input.as_ref()], &NoProgress)?;
    let mut backend = Backend::auto()?;
    let scene = backend.upload(&loaded.scene)?;
    let frame = backend.render(&scene, &loaded.file.camera, &loaded.file.settings)?;
    frame.save_png(output)?;
    Ok(())
}
