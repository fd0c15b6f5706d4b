//! `surfel convert`: splats of points and meshes.

use crate::args::{ConvertArgs, SplatArgs};
use crate::console::Console;
use crate::failure::Failure;
use crate::stdin::{self, Stdin, is_stdin};
use crate::{splats, stdout};
use std::path::{Path, PathBuf};
use surfel::io::{IoError, PlyEncoding};
use surfel::model::{ConvertOptions, Cull, OnInvalid, Shape, Up};
use surfel::sample::CLOSED_MESH;
use surfel::{LoadOptions, SplatCloud};

pub(crate) fn run(args: &ConvertArgs, console: &Console) -> Result<(), Failure> {
    check_output(args)?;
    if is_copc(&args.output) {
        return copc(args, console);
    }
    if let Some(second) = args.more.first() {
        let what = "is a second input, expected one (any number with -o OUT.copc.laz)";
        return Err(Failure::usage(format!("{}: {what}", second.display())));
    }
    if args.hybrid {
        return hybrid(args, console);
    }
    save(args, &converted(args, console)?, console)
}

fn options(args: &ConvertArgs) -> Result<LoadOptions, Failure> {
    let mut convert = ConvertOptions::default();
    splats::apply(&args.splats, &mut convert)?;
    let stdin = if is_stdin(&args.input) { Some(Stdin::default().bytes()?) } else { None };
    Ok(LoadOptions::default().with_convert(&convert, Path::new("")).with_stdin(stdin))
}

fn converted(args: &ConvertArgs, console: &Console) -> Result<SplatCloud, Failure> {
    let progress = console.progress();
    let loaded = surfel::load(&args.input, &options(args)?.with_interior_weight(true), &progress)?;
    drop(progress);
    for note in &loaded.notes {
        console.note(&format!("{}: {note}", stdin::display(&args.input)));
    }
    let unused: Vec<_> = loaded.unused.into_iter().map(|option| (args.input.clone(), option)).collect();
    splats::check_used(&args.splats, &unused, console)?;
    let colorings = loaded.coloring.iter().map(|coloring| (args.input.as_path(), coloring));
    splats::write_color_bar(&args.splats, args.force, colorings, console)?;
    let mut cloud = loaded.cloud;
    // PLY's own default needs no words.
    if loaded.up != Up::PlusY || cloud.data().up.is_some() {
        cloud.set_up(loaded.up);
    }
    match args.splats.cull {
        Some(cull) => culled(cloud, cull),
        None => Ok(cloud),
    }
}

/// Splats with the comment that lets their backs be left out, or without it.
fn culled(cloud: SplatCloud, cull: Cull) -> Result<SplatCloud, Failure> {
    let mut data = cloud.into_data();
    data.comments.retain(|comment| comment != CLOSED_MESH);
    if cull == Cull::Back {
        data.comments.push(CLOSED_MESH.to_owned());
    }
    Ok(SplatCloud::new(data, OnInvalid::Refuse).map_err(surfel::Error::from)?.0)
}

fn save(args: &ConvertArgs, cloud: &SplatCloud, console: &Console) -> Result<(), Failure> {
    let encoding = if args.ascii { PlyEncoding::Ascii } else { PlyEncoding::BinaryLittleEndian };
    if args.output.as_os_str() == "-" {
        let mut bytes = Vec::new();
        let written = surfel::io::write_splat_ply(&mut bytes, cloud, encoding);
        written.map_err(|e| Failure::other(format!("can't encode the splats: {e}")))?;
        stdout::result(&bytes)?;
    } else {
        surfel::io::save_splat_ply(&args.output, args.force, cloud, encoding)?;
    }
    console.note(&format!("{}: {}", args.output.display(), summary(cloud)));
    Ok(())
}

/// An octree of splats and polygons.
fn hybrid(args: &ConvertArgs, console: &Console) -> Result<(), Failure> {
    let progress = console.progress();
    let (octree, notes) = surfel::load_octree(&args.input, &options(args)?, &progress)?;
    drop(progress);
    for note in &notes {
        console.note(&format!("{}: {note}", stdin::display(&args.input)));
    }
    if args.output.as_os_str() == "-" {
        let mut bytes = Vec::new();
        let written = surfel::io::write_octree(&mut bytes, &octree);
        written.map_err(|e| Failure::other(format!("can't encode the octree: {e}")))?;
        stdout::result(&bytes)?;
    } else {
        surfel::io::save_octree(&args.output, args.force, &octree)?;
    }
    let leaves = octree.nodes().iter().filter(|n| n.is_leaf()).count();
    console.note(&format!(
        "{}: {} nodes, {leaves} of them leaves with {} triangles; {} splats, {} of them on edges between leaves",
        args.output.display(),
        octree.nodes().len(),
        octree.mesh().triangles.len(),
        octree.cloud().len(),
        octree.transitions().iter().map(|t| t.splats.len()).sum::<usize>()
    ));
    Ok(())
}

fn is_copc(output: &Path) -> bool {
    output.file_name().is_some_and(|name| name.to_string_lossy().to_ascii_lowercase().ends_with(".copc.laz"))
}

/// Points by levels, as COPC.
fn copc(args: &ConvertArgs, console: &Console) -> Result<(), Failure> {
    if args.splats != SplatArgs::default() || args.ascii {
        let what = "takes the points as they are, so that no flag on splats, colours or choice goes with it";
        return Err(Failure::usage(format!("-o {}: {what}", args.output.display())));
    }
    let inputs: Vec<PathBuf> = std::iter::once(&args.input).chain(&args.more).cloned().collect();
    let progress = console.progress();
    let report = surfel::levels::save_copc(&inputs, &args.output, args.force, &progress)?;
    drop(progress);
    report.notes.iter().for_each(|note| console.note(note));
    console.note(&format!(
        "{}: {} points in {} nodes of {} levels",
        args.output.display(),
        report.points,
        report.nodes,
        report.levels
    ));
    Ok(())
}

fn check_output(args: &ConvertArgs) -> Result<(), Failure> {
    let output = &args.output;
    let name = output.display();
    let extension = output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        _ if output.as_os_str() == "-" => return Ok(()),
        Some("ply") if !args.hybrid => {}
        Some("laz") if is_copc(output) && !args.hybrid => {}
        Some("surfel") if args.hybrid => {}
        _ if args.hybrid => {
            return Err(Failure::usage(format!("-o {name}: --hybrid needs a name that ends in .surfel")));
        }
        Some("surfel") => {
            return Err(Failure::usage(format!("-o {name}: only --hybrid writes .surfel files, expected a .ply")));
        }
        _ => {
            return Err(Failure::usage(format!(
                "-o {name}: expected a name that ends in .ply or .copc.laz, or - for stdout"
            )));
        }
    }
    if output.is_file() && !args.force {
        return Err(IoError::Exists { path: output.clone() }.into());
    }
    Ok(())
}

fn summary(cloud: &SplatCloud) -> String {
    let shape = match cloud.data().shape {
        Shape::Disks { .. } => "disks",
        Shape::Ellipses { .. } => "ellipses",
    };
    let mut radii: Vec<f64> = (0..cloud.len()).map(|i| cloud.radius_max(i)).collect();
    radii.sort_unstable_by(f64::total_cmp);
    let at = |share: usize| radii.get((radii.len().saturating_sub(1)) * share / 2).copied().unwrap_or(0.0);
    let weight = cloud.data().interior_weight.map(|w| format!(", interior weight {w:.3}")).unwrap_or_default();
    format!("{} {shape}, radii {:.4} to {:.4}, median {:.4}{weight}", cloud.len(), at(0), at(2), at(1))
}
