//! `surfel ortho`: orthoimages and surface models.

use crate::console::Console;
use crate::failure::Failure;
use surfel_app::options::Options;

#[cfg(not(feature = "ortho"))]
pub(crate) fn run(_: &Options, _: usize, _: &Console) -> Result<(), Failure> {
    let what = "surfel ortho is not built into this program: build it with Cargo's feature 'ortho', as in cargo build \
                --release --features ortho";
    Err(Failure::usage(what))
}

#[cfg(feature = "ortho")]
pub(crate) use with_ortho::run;

#[cfg(feature = "ortho")]
mod with_ortho {
    use super::{Console, Failure, Options};
    use crate::stdin::{Stdin, is_stdin};
    use crate::stdout;
    use surfel_app::ortho_request::{self, OrthoRequest};
    use surfel_backend::{Backend, BackendOptions};
    use surfel_io::ShowPath as _;
    use surfel_ortho::{OrthoFiles, OrthoOptions};
    use surfel_render::Renderer;

    pub(crate) fn run(args: &Options, threads: usize, console: &Console) -> Result<(), Failure> {
        let files = OrthoFiles {
            color: args.output.clone(),
            dsm: args.dsm.clone(),
            normals: args.normals.clone(),
            overwrite: args.force,
        };
        let stdin = if args.inputs.iter().any(|path| is_stdin(path)) { Some(Stdin::default().bytes()?) } else { None };
        let options = OrthoOptions::new(args.gsd.unwrap_or_default())
            .with_origin(args.origin.unwrap_or_default())
            .with_bounds(args.bounds)
            .with_size(args.render.size)
            .with_epsg(args.crs)
            .with_fill(args.fill);
        let splats = &args.render.splats;
        let request = OrthoRequest { inputs: &args.inputs, options, splats, files: &files, stdin };
        let (progress, mut notes) = (console.progress(), Vec::new());
        let opened = request.open(&progress, &mut |note| notes.push(note));
        drop(progress);
        notes.iter().for_each(|note| console.note(note));
        let mut ortho = opened?;
        let drawer = BackendOptions::default().with_threads(threads);
        let mut backend = match args.backend_name() {
            "auto" => Backend::choose(&drawer, |_| None)?.backend,
            name => Backend::by_name(name, &drawer)?,
        };
        let software = concat!("surfel ", env!("CARGO_PKG_VERSION"));
        let progress = console.progress();
        let stats = ortho.draw(&files, software, &mut backend, &progress)?;
        drop(progress);
        let ([width, height], [x0, y0, x1, y1]) = (ortho.size(), ortho.rounded_bounds());
        let crs = ortho.crs.as_ref().map_or_else(|| "no CRS".into(), surfel_io::Crs::words);
        ortho_request::notes_of(&stats).iter().for_each(|note| console.note(note));
        let covered = 100.0 * stats.covered as f64 / stats.pixels.max(1) as f64;
        let filled = match stats.filled {
            0 => String::new(),
            n => format!(", {:.1} % interpolated", 100.0 * n as f64 / stats.pixels.max(1) as f64),
        };
        let first = [&args.output, &args.dsm, &args.normals].into_iter().flatten().next();
        console.note(&format!(
            "{}: {width} x {height} pixels of {}, {x0},{y0},{x1},{y1}, {crs}, {covered:.1} % covered{filled}",
            first.map_or_else(String::new, |path| path.shown().to_string()),
            args.gsd.unwrap_or_default()
        ));
        if args.stats {
            stdout::json_result(&ortho_request::stats_json(&ortho, &stats, backend.info().backend))?;
        }
        Ok(())
    }
}
