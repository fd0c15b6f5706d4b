//! `surfel figure`: draws a figure of several panels.

use crate::console::Console;
use crate::failure::Failure;
use crate::render;
use crate::stdin::{Stdin, is_stdin};
use crate::stdout;
use std::path::Path;
use surfel_app::figure::{FigureRequest, check_output};
use surfel_app::options::Options;
use surfel_io::ShowPath as _;

pub(crate) fn run(args: &Options, threads: usize, console: &Console) -> Result<(), Failure> {
    let output = args.output.as_deref().unwrap_or(Path::new("-"));
    let format = check_output(output, args.force)?;
    let stdin = if args.inputs.iter().any(|path| is_stdin(path)) { Some(Stdin::default().bytes()?) } else { None };
    let request = FigureRequest { inputs: &args.inputs, render: &args.render, figure: &args.figure, stdin };
    request.check()?;
    let mut backend = render::start(args, threads, console)?;
    let (progress, mut notes) = (console.progress(), Vec::new());
    let drawn = request.draw(&mut backend, &progress, &mut |note| notes.push(note));
    drop(progress);
    notes.iter().for_each(|note| console.note(note));
    let image = drawn?;
    if is_stdin(output) {
        return stdout::result(&image.bytes(format));
    }
    image.save(output, args.force)?;
    let [width, height] = image.drawing.size;
    let mm = |pixels: u32| f64::from(pixels) / image.dpi * 25.4;
    let (size, dpi) = (format!("{:.1} x {:.1} mm", mm(width), mm(height)), image.dpi);
    console.detail(&format!("{}: {width} x {height} pixels, {size} at {dpi} per inch", output.shown()));
    Ok(())
}
