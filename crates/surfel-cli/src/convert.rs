//! `surfel convert`: splats of points and meshes.

use crate::args::ConvertArgs;
use crate::console::{self, Console};
use crate::failure::Failure;
use surfel::io::{Content, IoError, PlyEncoding};
use surfel::model::{Column3, OnInvalid, Shape};
use surfel::sample::{MeshMethod, SharpOptions};
use surfel::{Conversion, LoadOptions, SplatCloud, Up};

pub(crate) fn run(args: &ConvertArgs, console: &Console) -> Result<(), Failure> {
    check_output(args)?;
    if args.hybrid {
        return hybrid(args, console);
    }
    let cloud = if args.sharp { sharp(args, console)? } else { spread(args, console)? };
    save(args, &cloud, console)
}

/// Clipped splats of a mesh.
fn sharp(args: &ConvertArgs, console: &Console) -> Result<SplatCloud, Failure> {
    let name = args.input.display();
    let io_options = surfel::io::LoadOptions { repair: args.repair, texture: args.texture.clone() };
    let loaded = surfel::io::load(&args.input, &io_options)?;
    let mesh = match loaded.content {
        Content::Mesh(mesh) => mesh,
        Content::Points(_) => return sharp_points(args, console),
        _ => return Err(Failure::usage(format!("{name}: holds splats, expected a mesh or points for --sharp"))),
    };
    for note in &loaded.notes {
        console.note(&format!("{name}: {note}"));
    }
    let defaults = SharpOptions::default();
    let options = SharpOptions {
        crease_angle_deg: args.crease_angle.unwrap_or(defaults.crease_angle_deg),
        splats: args.splats.map(|n| n as usize),
        error: args.error,
        radius_scale: args.radius_scale.unwrap_or(1.0),
    };
    let progress = console.progress();
    let made = surfel::sample::sharp_splats_from_mesh(&mesh, &options, &progress);
    drop(progress);
    let (mut cloud, r) = made.map_err(|source| surfel::Error::Sample { path: args.input.clone(), source })?;
    let [ridges, edges] = r.ridges;
    console.note(&format!(
        "{name}: a mesh of {} triangles, {ridges} ridges of {edges} edges: {} splats, {} clipped by a curve, {} by lines",
        mesh.triangles.len(),
        r.splats,
        r.with_curve,
        r.with_lines
    ));
    console.note(&format!("{name}: {}", r.errors.comment()));
    if loaded.up != Up::PlusY || cloud.data().up.is_some() {
        cloud.set_up(loaded.up);
    }
    Ok(cloud)
}

/// Splats of points, clipped along the edges that they show.
fn sharp_points(args: &ConvertArgs, console: &Console) -> Result<SplatCloud, Failure> {
    let name = args.input.display();
    if args.splats.is_some() || args.error.is_some() {
        let message = format!("{name}: holds points, each of which is a splat: --splats and --error are for meshes");
        return Err(Failure::usage(message));
    }
    let cloud = spread(args, console)?;
    let angle = args.crease_angle.unwrap_or(SharpOptions::default().crease_angle_deg);
    let progress = console.progress();
    let made = surfel::sample::sharpen_points(&cloud, angle, &progress);
    drop(progress);
    let (cloud, r) = made.map_err(|source| surfel::Error::Sample { path: args.input.clone(), source })?;
    console.note(&if r.clipped == 0 {
        format!("{name}: no edge of {angle} degrees or more is found in the points, nothing is clipped")
    } else {
        format!("{name}: {} splats clipped along edges, {} of them at corners", r.clipped, r.corners)
    });
    Ok(cloud)
}

/// Splats of points or of a mesh without clips, or of splats.
fn spread(args: &ConvertArgs, console: &Console) -> Result<SplatCloud, Failure> {
    let method = match args.splats {
        Some(n) => Some(MeshMethod::Count(n as usize)),
        None if args.per_face => Some(MeshMethod::PerFace),
        None if args.per_vertex => Some(MeshMethod::PerVertex),
        None => None,
    };
    let options = LoadOptions {
        repair: args.repair,
        texture: args.texture.clone(),
        method,
        radius_scale: args.radius_scale.unwrap_or(1.0),
        interior_weight: true,
    };
    let progress = console.progress();
    let prepared = surfel::prepare(&args.input, &options, &progress)?;
    drop(progress);
    let name = args.input.display();
    for note in &prepared.notes {
        console.note(&format!("{name}: {note}"));
    }
    let fits = match (&prepared.conversion, method) {
        (_, None) | (Conversion::Mesh(_), _) => true,
        (Conversion::Points(_), Some(method)) => method == MeshMethod::PerVertex,
        (Conversion::None, Some(_)) => false,
    };
    if !fits {
        let what = if prepared.conversion == Conversion::None { "splats" } else { "points" };
        let message = format!("{name}: holds {what}, expected a mesh for --per-vertex, --per-face and --splats");
        return Err(Failure::usage(message));
    }
    let mut cloud = prepared.cloud;
    if let (Conversion::None, Some(scale)) = (&prepared.conversion, args.radius_scale) {
        cloud = scaled(cloud, scale)?;
    }
    // PLY's own default needs no words.
    if prepared.up != Up::PlusY || cloud.data().up.is_some() {
        cloud.set_up(prepared.up);
    }
    Ok(cloud)
}

fn save(args: &ConvertArgs, cloud: &SplatCloud, console: &Console) -> Result<(), Failure> {
    let encoding = if args.ascii { PlyEncoding::Ascii } else { PlyEncoding::BinaryLittleEndian };
    if args.output.as_os_str() == "-" {
        let mut bytes = Vec::new();
        let written = surfel::io::write_splat_ply(&mut bytes, cloud, encoding);
        written.map_err(|e| Failure::other(format!("can't encode the splats: {e}")))?;
        console::result(&bytes)?;
    } else {
        surfel::io::save_splat_ply(&args.output, args.force, cloud, encoding)?;
    }
    console.note(&format!("{}: {}", args.output.display(), summary(cloud)));
    Ok(())
}

/// An octree of splats and polygons.
fn hybrid(args: &ConvertArgs, console: &Console) -> Result<(), Failure> {
    let options = LoadOptions { texture: args.texture.clone(), ..LoadOptions::default() };
    let progress = console.progress();
    let (octree, notes) = surfel::prepare_hybrid(&args.input, &options, &progress)?;
    drop(progress);
    for note in &notes {
        console.note(&format!("{}: {note}", args.input.display()));
    }
    if args.output.as_os_str() == "-" {
        let mut bytes = Vec::new();
        let written = surfel::io::write_hybrid(&mut bytes, &octree);
        written.map_err(|e| Failure::other(format!("can't encode the octree: {e}")))?;
        console::result(&bytes)?;
    } else {
        surfel::io::save_hybrid(&args.output, args.force, &octree)?;
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

fn check_output(args: &ConvertArgs) -> Result<(), Failure> {
    let output = &args.output;
    let name = output.display();
    let extension = output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match extension.as_deref() {
        _ if output.as_os_str() == "-" => return Ok(()),
        Some("ply") if !args.hybrid => {}
        Some("surfel") if args.hybrid => {}
        _ if args.hybrid => {
            return Err(Failure::usage(format!("-o {name}: --hybrid needs a name that ends in .surfel")));
        }
        Some("surfel") => {
            return Err(Failure::usage(format!("-o {name}: only --hybrid writes .surfel files, expected a .ply")));
        }
        _ => return Err(Failure::usage(format!("-o {name}: expected a name that ends in .ply, or - for stdout"))),
    }
    if output.is_file() && !args.force {
        return Err(IoError::Exists { path: output.clone() }.into());
    }
    Ok(())
}

/// Splats with other radii, and the interior weight that goes with them.
fn scaled(cloud: SplatCloud, scale: f64) -> Result<SplatCloud, Failure> {
    let mut data = cloud.into_data();
    let column = |c: &Column3| Column3::from_f32(c.high().iter().map(|v| *v * scale as f32).collect());
    match &mut data.shape {
        Shape::Disks { radii, .. } => radii.iter_mut().for_each(|r| *r *= scale as f32),
        Shape::Ellipses { s, t } => (*s, *t) = (column(s), column(t)),
    }
    data.interior_weight = None;
    let (mut cloud, _) = SplatCloud::new(data, OnInvalid::Refuse).map_err(surfel::Error::from)?;
    if let Some(weight) = surfel::sample::interior_weight(&cloud) {
        cloud.set_interior_weight(weight);
    }
    Ok(cloud)
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
