//! The README's example: a file in, a picture out.
//!
//! `cargo run --release -p surfel --example picture -- assets/spot/spot.obj spot.png`

use surfel::{Backend, Frame, NoProgress, Planes, Renderer, View};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args_os().skip(1);
    let (Some(input), Some(output)) = (arguments.next(), arguments.next()) else {
        return Err("usage: picture INPUT OUTPUT.png".into());
    };
    let opened = surfel::open(&[input.as_ref()], &NoProgress)?;
    let mut backend = Backend::auto()?;
    let scene = backend.upload(&opened.scene)?;
    let view = View::new(&opened.file.camera)?;
    let mut frame = Frame::default();
    let stats = backend.render(&scene, &view, &opened.file.settings, Planes::COLOR, &mut frame)?;
    surfel::io::save_png(output.as_ref(), false, &surfel::planes(&frame), &Default::default())?;
    println!("{} splats, {:.0} ms", stats.splats, stats.frame_ms);
    Ok(())
}
