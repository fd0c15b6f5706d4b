//! `surfel ortho`: orthoimages and surface models.

use crate::args::OrthoArgs;
use crate::console::Console;
use crate::failure::Failure;

#[cfg(not(feature = "ortho"))]
pub(crate) fn run(_: &OrthoArgs, _: usize, _: &Console) -> Result<(), Failure> {
    let what = "surfel ortho is not built into this program: build it with Cargo's feature 'ortho', as in cargo build \
                --release --features ortho";
    Err(Failure::usage(what))
}

#[cfg(feature = "ortho")]
pub(crate) use with_ortho::run;

#[cfg(feature = "ortho")]
mod with_ortho {
    use super::{Console, Failure, OrthoArgs};
    use crate::stdin::{Stdin, is_stdin};
    use crate::{options, stdout};
    use surfel::io::ShowPath as _;
    use surfel::ortho::{OrthoFiles, OrthoOptions, OrthoRequest};
    use surfel::render::Renderer;
    use surfel::{Backend, BackendOptions};

    pub(crate) fn run(args: &OrthoArgs, threads: usize, console: &Console) -> Result<(), Failure> {
        let files = OrthoFiles {
            color: args.output.clone(),
            dsm: args.dsm.clone(),
            normals: args.normals.clone(),
            overwrite: args.force,
        };
        let stdin = if args.inputs.iter().any(|path| is_stdin(path)) { Some(Stdin::default().bytes()?) } else { None };
        let options = OrthoOptions::new(args.gsd)
            .with_origin(args.origin)
            .with_bounds(args.bounds)
            .with_size(args.size)
            .with_epsg(args.crs);
        let splats = &options::splats(&args.splats, args.force)?;
        let request = OrthoRequest { inputs: &args.inputs, options, splats, files: &files, stdin };
        let (progress, mut notes) = (console.progress(), Vec::new());
        let opened = request.open(&progress, &mut |note| notes.push(note));
        drop(progress);
        notes.iter().for_each(|note| console.note(note));
        let mut ortho = opened?;
        let drawer = BackendOptions::default().with_threads(threads);
        let mut backend = match args.backend.as_str() {
            "auto" => Backend::choose(&drawer, |_| None)?.backend,
            name => Backend::by_name(name, &drawer)?,
        };
        let software = concat!("surfel ", env!("CARGO_PKG_VERSION"));
        let progress = console.progress();
        let stats = ortho.draw(&files, software, &mut backend, &progress)?;
        drop(progress);
        let ([width, height], [x0, y0, x1, y1]) = (ortho.size(), ortho.rounded_bounds());
        let crs = ortho.crs.as_ref().map_or_else(|| "no CRS".into(), surfel::io::Crs::words);
        let covered = 100.0 * stats.covered as f64 / stats.pixels.max(1) as f64;
        console.note(&format!(
            "{}: {width} x {height} pixels of {}, {x0},{y0},{x1},{y1}, {crs}, {covered:.1} % covered",
            args.output.shown(),
            args.gsd
        ));
        if args.stats {
            stdout::json_result(&ortho.stats_json(&stats, backend.info().backend))?;
        }
        Ok(())
    }
}
