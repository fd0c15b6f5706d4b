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
    use crate::stdin::{self, Stdin, is_stdin};
    use crate::{options, stdout};
    use serde_json::json;
    use std::path::{Path, PathBuf};
    use surfel::io::IoError;
    use surfel::model::ConvertOptions;
    use surfel::ortho::{Ortho, OrthoFiles, OrthoOptions};
    use surfel::render::Renderer;
    use surfel::{Backend, BackendOptions, Error, LoadOptions, splats};

    pub(crate) fn run(args: &OrthoArgs, threads: usize, console: &Console) -> Result<(), Failure> {
        check_outputs(args)?;
        let mut convert = ConvertOptions::default();
        let splat_options = options::splats(&args.splats, args.force)?;
        splats::apply(&splat_options, &mut convert)?;
        let stdin = if args.inputs.iter().any(|path| is_stdin(path)) { Some(Stdin::default().bytes()?) } else { None };
        let load = LoadOptions::default()
            .with_convert(&convert, Path::new(""))
            .with_stdin(stdin)
            .with_memory(splat_options.memory);
        let options = OrthoOptions::new(args.gsd)
            .with_origin(args.origin)
            .with_bounds(args.bounds)
            .with_size(args.size)
            .with_epsg(args.crs)
            .with_load(load.with_interior_weight(true));
        let inputs: Vec<&Path> = args.inputs.iter().map(PathBuf::as_path).collect();
        let progress = console.progress();
        let mut ortho = Ortho::open(&inputs, &options, &progress).map_err(usage_of_grid)?;
        drop(progress);
        for (path, note) in &ortho.notes {
            match path {
                Some(path) => console.note(&format!("{}: {note}", stdin::display(path))),
                None => console.note(note),
            }
        }
        splats::check_used(&splat_options, &ortho.unused, &mut |note| console.note(&note))?;
        let colorings = ortho.coloring.iter().map(|(path, coloring)| (path.as_path(), coloring));
        splats::write_color_bar(&splat_options, colorings, &mut |note| console.note(&note))?;
        let mut backend = match args.backend.as_str() {
            "auto" => Backend::choose(&BackendOptions::default().with_threads(threads), |_| None)?.backend,
            name => Backend::by_name(name, &BackendOptions::default().with_threads(threads))?,
        };
        let files = OrthoFiles {
            color: args.output.clone(),
            dsm: args.dsm.clone(),
            normals: args.normals.clone(),
            overwrite: args.force,
        };
        let software = concat!("surfel ", env!("CARGO_PKG_VERSION"));
        let progress = console.progress();
        let stats = ortho.draw(&files, software, &mut backend, &progress)?;
        drop(progress);
        // Sums of decimal numbers are a little off in binary.
        let rounded = |v: f64| (v * 1e6).round() / 1e6;
        let ([width, height], [x0, y0, x1, y1]) = (ortho.size(), ortho.bounds().map(rounded));
        let crs = ortho.crs.as_ref().map_or_else(|| "no CRS".into(), surfel::io::Crs::words);
        let covered = 100.0 * stats.covered as f64 / stats.pixels.max(1) as f64;
        console.note(&format!(
            "{}: {width} x {height} pixels of {}, {x0},{y0},{x1},{y1}, {crs}, {covered:.1} % covered",
            args.output.display(),
            args.gsd
        ));
        if args.stats {
            let json = json!({
                "size": [width, height], "bounds": [x0, y0, x1, y1], "gsd": args.gsd,
                "pixels": stats.pixels, "covered": stats.covered, "splats": stats.splats,
                "prepare_ms": stats.preparing.as_secs_f64() * 1e3, "draw_ms": stats.drawing.as_secs_f64() * 1e3,
                "write_ms": stats.writing.as_secs_f64() * 1e3, "backend": backend.info().backend,
            });
            stdout::json_result(&json)?;
        }
        Ok(())
    }

    /// Refuses names that aren't TIFF's, that are the same, or that are taken.
    fn check_outputs(args: &OrthoArgs) -> Result<(), Failure> {
        let files = [("-o", Some(&args.output)), ("--dsm", args.dsm.as_ref()), ("--normals", args.normals.as_ref())];
        let files: Vec<(&str, &PathBuf)> = files.into_iter().filter_map(|(flag, file)| Some((flag, file?))).collect();
        for (i, (flag, file)) in files.iter().enumerate() {
            let extension = file.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
            if !matches!(extension.as_deref(), Some("tif" | "tiff")) {
                return Err(Failure::usage(format!("{flag} {}: expected a name that ends in .tif", file.display())));
            }
            if let Some((other, _)) = files[..i].iter().find(|(_, known)| known == file) {
                return Err(Failure::usage(format!("{flag} {}: is the name of {other}'s file, too", file.display())));
            }
            if args.inputs.contains(file) {
                return Err(Failure::usage(format!("{flag} {}: is an input, too", file.display())));
            }
            if file.exists() && !args.force {
                return Err(IoError::Exists { path: (*file).clone() }.into());
            }
        }
        Ok(())
    }

    /// A grid that can't be is the command line's fault.
    fn usage_of_grid(error: Error) -> Failure {
        match error {
            Error::Model(e @ surfel::model::ModelError::OutOfRange { .. }) => Failure::usage(format!("--{e}")),
            other => other.into(),
        }
    }
}
