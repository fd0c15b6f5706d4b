//! `surfel convert`: converts points and meshes to splats.

use crate::console::Console;
use crate::failure::Failure;
use crate::stdin::{self, Stdin, is_stdin};
use crate::{pieces, stdout};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_app::copc_output;
use surfel_app::options::Options;
use surfel_app::splat_file::ConvertRequest;
use surfel_app::values::Part;
use surfel_io::ShowPath as _;
use surfel_io::atomic::target;
use surfel_io::{IoError, PlyEncoding};
use surfel_load::levels::{self, CopcRequest};
use surfel_model::SplatCloud;

pub(crate) fn run(args: &Options, console: &Console) -> Result<(), Failure> {
    let shard = shard(args, console)?;
    let output = pieces::with_shard(output(args), shard);
    check_output(args, &output)?;
    if levels::is_copc(&output) || levels::is_shard(&output) {
        return copc(args, &output, shard, console);
    }
    copc_output::check_shard(&output, shard)?;
    if args.resume {
        return Err(Failure::usage(format!("-o {}: --resume is of OUT.copc.laz and of NAME.shard", output.shown())));
    }
    if let Some(second) = args.inputs.get(1) {
        let what = "is a second input, expected one (any number with -o OUT.copc.laz)";
        return Err(Failure::usage(format!("{}: {what}", second.shown())));
    }
    if args.hybrid {
        return hybrid(args, console);
    }
    save(args, &converted(args, console)?, console)
}

/// Returns the path of the first input.
fn input(args: &Options) -> &Path {
    args.inputs.first().map_or(Path::new(""), PathBuf::as_path)
}

/// Returns the path of the file to write; empty if none is given.
fn output(args: &Options) -> &Path {
    args.output.as_deref().unwrap_or(Path::new(""))
}

/// Refuses combinations of options for a shard that are wrong for any input.
pub(crate) fn check(args: &Options) -> Result<(), Failure> {
    let output = pieces::with_shard(output(args), args.shard);
    check_output(args, &output)?;
    Ok(copc_output::check_copc(&output, &args.render.splats, args.ascii, args.shard)?)
}

fn converted(args: &Options, console: &Console) -> Result<SplatCloud, Failure> {
    let progress = console.progress();
    let options = &args.render.splats;
    let request = ConvertRequest { path: input(args), options, stdin: bytes(args)? };
    let loaded = request.load(&progress)?;
    drop(progress);
    Ok(request.convert(loaded, &mut |note| console.note(&note))?)
}

/// Returns the content of stdin if the input is `-`, else `None`.
fn bytes(args: &Options) -> Result<Option<Arc<[u8]>>, Failure> {
    Ok(if is_stdin(input(args)) { Some(Stdin::default().bytes()?) } else { None })
}

fn save(args: &Options, cloud: &SplatCloud, console: &Console) -> Result<(), Failure> {
    let encoding = if args.ascii { PlyEncoding::Ascii } else { PlyEncoding::BinaryLittleEndian };
    if output(args).as_os_str() == "-" {
        let mut bytes = Vec::new();
        let written = surfel_io::write_splat_ply(&mut bytes, cloud, encoding);
        written.map_err(|e| Failure::other(format!("can't encode the splats: {e}")))?;
        stdout::result(&bytes)?;
    } else {
        surfel_io::save_splat_ply(output(args), args.force, cloud, encoding)?;
    }
    console.note(&format!("{}: {}", output(args).shown(), surfel_app::splat_file::summary(cloud)));
    Ok(())
}

/// Converts a mesh to an octree of splats and polygons.
fn hybrid(args: &Options, console: &Console) -> Result<(), Failure> {
    let progress = console.progress();
    let options = &args.render.splats;
    let request = ConvertRequest { path: input(args), options, stdin: bytes(args)? };
    let (octree, notes) = surfel_load::octree::load_octree(input(args), &request.load_options()?, &progress)?;
    drop(progress);
    for note in &notes {
        console.note(&format!("{}: {note}", stdin::display(input(args))));
    }
    if output(args).as_os_str() == "-" {
        let mut bytes = Vec::new();
        let written = surfel_io::write_octree(&mut bytes, &octree);
        written.map_err(|e| Failure::other(format!("can't encode the octree: {e}")))?;
        stdout::result(&bytes)?;
    } else {
        surfel_io::save_octree(output(args), args.force, &octree)?;
    }
    let leaves = octree.nodes().iter().filter(|n| n.is_leaf()).count();
    console.note(&format!(
        "{}: {} nodes, {leaves} of them leaves with {} triangles; {} splats, {} of them on edges between leaves",
        output(args).shown(),
        octree.nodes().len(),
        octree.mesh().triangles.len(),
        octree.cloud().len(),
        octree.transitions().iter().map(|t| t.splats.len()).sum::<usize>()
    ));
    Ok(())
}

/// Returns the shard that this run converts. It comes from the flag or, if the output is named like a shard, from a
/// cluster's environment variables.
fn shard(args: &Options, console: &Console) -> Result<Option<Part>, Failure> {
    if args.shard.is_some() || !levels::is_shard(output(args)) {
        return Ok(args.shard);
    }
    let said = pieces::from_environment(|name| std::env::var(name).ok()).map_err(Failure::usage)?;
    Ok(said.map(|(part, from)| {
        console.note(&format!("shard {} of {} (by {from})", part.index(), part.count()));
        part
    }))
}

/// Writes points as a COPC file, or as one shard of a COPC file.
fn copc(args: &Options, output: &Path, shard: Option<Part>, console: &Console) -> Result<(), Failure> {
    let options = &args.render.splats;
    copc_output::check_copc(output, options, args.ascii, shard)?;
    let progress = console.progress();
    let columns = options.convert.columns.clone();
    let request = CopcRequest {
        overwrite: args.force,
        memory: options.memory,
        resume: args.resume,
        shard: shard.map(Part::index_and_count),
        columns,
    };
    let saved = levels::save_copc(&args.inputs, output, &request, &progress);
    drop(progress);
    let folder = levels::resume_folder(output);
    let report = match saved {
        Err(error) => {
            if args.resume && folder.is_dir() {
                let help = "the same command goes on with it, and deleting it gives it up";
                console.note(&format!("{} has what is done: {help}", folder.shown()));
            }
            return Err(error.into());
        }
        Ok(report) => report,
    };
    report.notes.iter().for_each(|note| console.note(note));
    console.note(&format!("{}: {}", output.shown(), levels::summary(&report)));
    if folder.is_dir() {
        console.note(&format!("{} is left of an interrupted run with --resume: delete it", folder.shown()));
    }
    Ok(())
}

fn check_output(args: &Options, output: &Path) -> Result<(), Failure> {
    let name = output.shown();
    let extension = output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        _ if output.as_os_str() == "-" => return Ok(()),
        Some("ply") if !args.hybrid => {}
        Some("laz") if levels::is_copc(output) && !args.hybrid => {}
        Some("shard") if !args.hybrid => {}
        Some("surfel") if args.hybrid => {}
        _ if args.hybrid => {
            return Err(Failure::usage(format!("-o {name}: --hybrid needs a name that ends in .surfel")));
        }
        Some("surfel") => {
            return Err(Failure::usage(format!("-o {name}: only --hybrid writes .surfel files, expected a .ply")));
        }
        _ => {
            return Err(Failure::usage(format!(
                "-o {name}: expected a name that ends in .ply, .copc.laz or .shard, or - for stdout"
            )));
        }
    }
    if let Some(bar) = &args.render.splats.colorbar
        && target(bar) == target(output)
    {
        return Err(Failure::usage(format!("--colorbar {}: is the name of -o's file, too", bar.shown())));
    }
    // An interrupted run may have written the file already.
    if output.is_file() && !args.force && !args.resume {
        return Err(IoError::Exists { path: output.to_path_buf() }.into());
    }
    Ok(())
}
