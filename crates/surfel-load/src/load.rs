//! Loading of files as splats. Splat files are used as they are; points and meshes are converted.

use crate::coloring::Colorings;
use crate::coloring::together::{ColorJob, Colors, Member, MissingAttribute};
use crate::effects::{self, UnusedOption};
use crate::levels::{self, LevelReport};
use crate::loaded_cloud::{Conversion, LoadedCloud};
use crate::mesh_columns::MeshColumns;
use crate::options::{LoadOptions, STDIN, io_options};
use crate::single_sided::{states_sides, with_each_side};
use crate::words::counted;
use crate::{Error, convert, labels, memory};
use glam::DVec3;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_framing::{UpConvention, UpReason};
use surfel_io::{Content, Format, Loaded};
use surfel_model::{Mesh, Octree, SplatCloud, Up};
use surfel_sample::Progress;

/// Reads a file, or the bytes of stdin if the path is [`STDIN`].
pub fn read(path: &Path, options: &LoadOptions) -> Result<Loaded, Error> {
    let io_options = io_options(options);
    Ok(match &options.stdin {
        Some(bytes) if path == Path::new(STDIN) => surfel_io::load_bytes(bytes, None, Path::new("stdin"), &io_options)?,
        _ => surfel_io::load(path, &io_options)?,
    })
}

/// Loads a file as splats. Splat files are used as they are; points and meshes are converted.
///
/// # Errors
/// [`Error::Io`] if the file can't be read or is damaged, [`Error::Sample`] if it can't be converted to splats.
/// [`Error::Unsuitable`] if it has no splat, or if `options.convert.sharp` is true without Cargo's feature `sharp`.
pub fn load(path: &Path, options: &LoadOptions, progress: &dyn Progress) -> Result<LoadedCloud, Error> {
    let options = &options.clone().with_gaussians(false);
    progress.stage("reading", 0);
    let (loaded, levels) = read_needed(path, options, progress)?;
    let (mut made, job) = splats_of(loaded, path, options, progress)?;
    if let Some(job) = job {
        color(&mut made, &job)?;
    }
    Ok(LoadedCloud { levels, ..made })
}

/// Colours the splats of a single file, on their own scale.
fn color(made: &mut LoadedCloud, job: &ColorJob) -> Result<(), Error> {
    let empty = SplatCloud::disks::<[f32; 3], [f32; 3]>(&[], &[], &[])?;
    let mut cloud = Arc::new(std::mem::replace(&mut made.cloud, empty));
    let mut colorings = Colorings::default();
    let lacking = colorings.color(&mut [Member { job, cloud: &mut cloud, is_colored: false }])?;
    made.cloud = Arc::unwrap_or_clone(cloud);
    made.coloring = colorings.iter().next().map(|(_, coloring)| coloring.clone());
    made.notes.extend(colorings.notes().map(|(_, note)| note.to_owned()));
    made.unused.extend(lacking.iter().map(|lacking| without_attribute(job, lacking)));
    Ok(())
}

/// Returns the report that the option `color_by` has no effect on the file of `job`, because it lacks the attribute.
/// The report lists the file's attributes.
pub fn without_attribute(job: &ColorJob, lacking: &MissingAttribute) -> UnusedOption {
    let holds = format!("no attribute '{}' but {}", job.attribute.escape_debug(), lacking.known.join(", "));
    UnusedOption { option: "color_by", holds: holds.into(), expected: "one of these".into() }
}

/// Reads a file, or the selected nodes of a file with levels of detail. The report is `None` if all points were read.
pub(crate) fn read_needed(
    path: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<(Loaded, Option<LevelReport>), Error> {
    let partly = |(loaded, report): (Loaded, LevelReport)| (loaded, Some(report).filter(|report| !report.is_whole()));
    if let Some(found) = levels::read(path, path, options)? {
        return Ok(partly(found));
    }
    let Err(too_large) = check_size(path, options) else { return Ok((read(path, options)?, None)) };
    let store = options.level_store.as_ref().filter(|_| levels::chosen(path, options).is_some());
    let by_levels = store.map(|store| store.by_levels(path, options, progress)).transpose()?.flatten();
    let Some((copc, note)) = by_levels else { return Err(too_large) };
    let (mut loaded, report) = levels::read(path, copc.path(), options)?.ok_or(too_large)?;
    loaded.notes.insert(0, note);
    if let Some((format, up, is_said)) = surfel_io::copc::up_of_columns(path, options.convert.columns.as_ref()) {
        // The COPC copy is z-up; format and up axis of the source file are restored.
        (loaded.format, loaded.up) = (format, up);
        if let (Content::Points(points), true) = (&mut loaded.content, is_said) {
            points.up = Some(up);
        }
    }
    Ok(partly((loaded, report)))
}

/// Returns an error for a point file that won't fit into memory, before it is read. Stdin isn't checked, nor is any
/// file if the options select some of its points.
pub fn check_size(path: &Path, options: &LoadOptions) -> Result<(), Error> {
    let is_file = options.stdin.is_none() || path != Path::new(STDIN);
    let is_all = is_file && !options.chooses_points();
    let Some(count) = surfel_io::survey_points(path, options.convert.columns.as_ref()).filter(|_| is_all) else {
        return Ok(());
    };
    let points = options.max_points().map_or(count.points, |most| count.points.min(most as u64));
    let remedy = if count.has_radii { memory::Remedy::Fewer } else { memory::Remedy::Levels };
    let bytes = memory::loaded_bytes(&count);
    memory::check(path, points, bytes, options.memory, remedy)
}

/// Splats made from a file's content, and facts about them that the conversion determines.
struct Converted {
    cloud: SplatCloud,
    conversion: Conversion,
    /// True if the splats cover a watertight surface from outside, according to the file or its mesh, or if there are
    /// splats for each visible side.
    is_watertight: bool,
    /// Octree, if the file contains one; `cloud` then has its finest splats.
    octree: Option<Box<Octree>>,
    /// Mesh from which the splats were made, whose columns can be transferred to them.
    on_mesh: Option<MeshColumns>,
}

/// Converts a file's content to splats. `up` is the up axis, or `None` if it isn't certain.
fn converted(
    content: Content,
    up: Option<Up>,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Converted, Error> {
    let (mut is_watertight, mut octree, mut on_mesh) = (false, None, None);
    let (cloud, conversion) = match content {
        Content::Octree(found) => {
            is_watertight = surfel_sample::is_closed(found.mesh());
            let cloud = found.cloud_of(&found.finest().collect::<Vec<_>>())?;
            octree = Some(found);
            (cloud, Conversion::None)
        }
        Content::Splats(cloud) => {
            is_watertight = cloud.data().comments.iter().any(|c| c == surfel_sample::CLOSED_MESH);
            let cloud = convert::chosen_splats(cloud, path, options, notes)?;
            let scaled = options.radius_scale() != 1.0;
            (if scaled { convert::scaled(cloud, options.radius_scale())? } else { cloud }, Conversion::None)
        }
        Content::Gaussians(_) => return Err(not_splats(path)),
        Content::Points(mut points) => {
            // Normals of ground points are oriented upwards if the up axis is certain.
            points.up = points.up.or(up);
            convert::points(points, path, options, notes, progress)?
        }
        Content::Mesh(mut mesh) => {
            // The back faces of an inverted mesh aren't culled, since it may be a room seen from inside.
            is_watertight = surfel_sample::is_closed(&mesh);
            // Single-sided materials determine the outward side, so that such meshes aren't inverted.
            if !states_sides(&mesh) && surfel_sample::turn_outward(&mut mesh) {
                notes.push("turned its triangles around: they are wound inside out".to_owned());
            }
            let mut made = convert::mesh(&mesh, path, options, notes, progress)?;
            if !is_watertight && let Some(each_side) = with_each_side(&mesh, &made.0)? {
                let doubled = counted((each_side.len() - made.0.len()) as u64, "splats");
                notes.push(format!(
                    "some materials are double-sided, others not: back faces are culled, and {doubled} of double-sided \
                     ones are there for each side (`cull=none` shows all back faces)"
                ));
                (made.0, is_watertight) = (each_side, true);
            }
            on_mesh = MeshColumns::new(mesh);
            made
        }
    };
    if cloud.is_empty() {
        let problem = "holds no splat, expected at least one: check that the file is complete".to_owned();
        return Err(Error::Unsuitable { path: path.to_path_buf(), problem });
    }
    Ok(Converted { cloud, conversion, is_watertight, octree, on_mesh })
}

/// Adds labels and row numbers to splats if the options request them. `of_mesh` has the names of the mesh's columns,
/// for messages.
fn numbered(
    mut cloud: SplatCloud,
    of_mesh: &[String],
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
) -> Result<SplatCloud, Error> {
    if let Some(attribute) = &options.label
        && !labels::label(&mut cloud, attribute, path)?
    {
        let mut known = of_mesh.to_vec();
        known.extend(cloud.data().extras.iter().map(|e| e.name.escape_debug().to_string()));
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        notes.push(format!("no attribute {attribute}, so its splats have no label (attributes: {known})"));
    }
    if options.rows || options.label.is_some() {
        cloud.number_rows();
    } else {
        cloud.discard_rows();
    }
    Ok(cloud)
}

/// Converts a file's content to splats. Also returns the request for colouring them by an attribute, or `None` if no
/// attribute is requested.
pub fn splats_of(
    loaded: Loaded,
    path: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<(LoadedCloud, Option<ColorJob>), Error> {
    let up_reason = up_reason(&loaded);
    let certain_up = up_reason.map(|_| loaded.up);
    let mut notes = loaded.notes;
    let unused = effects::unused(&loaded.content, options);
    let Converted { mut cloud, conversion, is_watertight, mut octree, mut on_mesh } =
        converted(loaded.content, certain_up, path, options, &mut notes, progress)?;
    if let Some(columns) = &mut on_mesh {
        if options.mesh_columns {
            cloud = columns.all(cloud)?;
        }
        if let Some(attribute) = &options.label {
            cloud = columns.labels(cloud, attribute)?;
        }
    }
    let of_mesh = on_mesh.as_ref().map(MeshColumns::names).unwrap_or_default();
    cloud = numbered(cloud, &of_mesh, path, options, &mut notes)?;
    let colors = options.convert.color_by.as_ref().map(|_| Colors::of(options)).transpose()?.unwrap_or_default();
    if let (Some(columns), Some(attribute)) = (&mut on_mesh, &options.convert.color_by) {
        cloud = columns.values(cloud, attribute, &colors)?;
    }
    let is_of_points = matches!(conversion, Conversion::Points(_))
        || cloud.data().comments.iter().any(|comment| comment == surfel_sample::OF_POINTS);
    let job = options.convert.color_by.as_ref().filter(|_| octree.is_none()).map(|attribute| ColorJob {
        path: path.to_path_buf(),
        attribute: attribute.clone(),
        colors,
        up: options.up.or(certain_up),
        convention: UpConvention::of(is_of_points, loaded.up),
        others: of_mesh,
    });
    if options.interior_weight
        && cloud.data().interior_weight.is_none()
        && let Some(weight) = surfel_sample::interior_weight(&cloud)
    {
        cloud.set_interior_weight(weight);
        if let Some(octree) = &mut octree {
            octree.set_interior_weight(weight);
        }
        notes.push(format!("the file says no interior weight: estimated {weight:.3}"));
    }
    let made = LoadedCloud {
        cloud,
        format: loaded.format,
        up: loaded.up,
        up_reason,
        is_watertight,
        gaussian: loaded.gaussian,
        conversion,
        coloring: None,
        octree: octree.map(Arc::from),
        levels: None,
        notes,
        beside: loaded.beside,
        unused,
    };
    Ok((made, job))
}

/// Returns the error for a file of trained Gaussians where splats are expected.
fn not_splats(path: &Path) -> Error {
    let problem = "holds trained Gaussians, expected splats: leave out `composite=over`".to_owned();
    Error::Unsuitable { path: path.to_path_buf(), problem }
}

/// Extent, in metres, below which the content of an E57 or PTS file counts as a small object, not as a scanned site.
const MAX_OBJECT_M: f64 = 1.0;

/// Returns the reason why a file's up axis is certain: the file or its format states it. Returns `None` for OBJ, STL,
/// OFF, PLY, Draco, PCD, `.surfel` and tables of numbers, which occur with any axis up, unless their default up axis is
/// −y, as for Gaussian splats. Also returns `None` for E57 and PTS files of a small object without a scanner position.
pub fn up_reason(loaded: &Loaded) -> Option<UpReason> {
    if loaded.content.own_up().is_some() {
        return Some(UpReason::Stated);
    }
    // Among PLY files, only Gaussian splats have the default up axis −y.
    let is_any = matches!(
        loaded.format,
        Format::Ply
            | Format::Obj
            | Format::Stl
            | Format::Off
            | Format::Drc
            | Format::Xyz
            | Format::Pcd
            | Format::Npy
            | Format::Npz
            | Format::Raw
            | Format::Surfel
    ) || is_small_object(loaded);
    (!is_any || loaded.up == Up::MinusY).then_some(UpReason::Format)
}

/// True if an E57 or PTS file contains a small object without a scanner position. Other programs export such objects
/// with any up axis, whereas a scanner on site is upright.
fn is_small_object(loaded: &Loaded) -> bool {
    let Content::Points(points) = &loaded.content else { return false };
    let is_of_one = points.viewpoint.is_none() && points.extras.iter().all(|extra| extra.name != "scan");
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    matches!(loaded.format, Format::E57 | Format::Pts)
        && is_of_one
        && (0..points.len()).all(|i| {
            let p = points.positions.get(i);
            (lo, hi) = (lo.min(p), hi.max(p));
            (hi - lo).max_element() < MAX_OBJECT_M
        })
}

/// Mesh of a file that is drawn as polygons.
pub(crate) struct LoadedMesh {
    pub(crate) mesh: Arc<Mesh>,
    pub(crate) up: Up,
    pub(crate) up_reason: Option<UpReason>,
    pub(crate) notes: Vec<String>,
}

/// Loads a file that is drawn as polygons. Adds the files to which it refers to `beside`.
///
/// # Errors
/// Errors of [`load`]; also [`Error::Unsuitable`] if the file holds no triangles.
pub(crate) fn load_mesh(
    path: &Path,
    options: &LoadOptions,
    beside: &mut BTreeSet<PathBuf>,
) -> Result<LoadedMesh, Error> {
    let loaded = read(path, options)?;
    let (up, up_reason) = (loaded.up, up_reason(&loaded));
    beside.extend(loaded.beside);
    let mut notes = loaded.notes;
    if options.convert.color_by.is_some() {
        notes.push("drew polygons without color_by: give the file as \"splats\" to colour it by values".into());
    }
    let found = match loaded.content {
        Content::Mesh(mesh) if !mesh.triangles.is_empty() => {
            if mesh.is_see_through() {
                notes.push("drew all polygons opaque and whole: give the file as \"splats\" to see through it".into());
            }
            if mesh.has_normal_maps() {
                notes.push("drew polygons without their normal maps: give the file as \"splats\" to see them".into());
            }
            return Ok(LoadedMesh { mesh: Arc::new(mesh), up, up_reason, notes });
        }
        Content::Octree(octree) => {
            return Ok(LoadedMesh { mesh: Arc::new(octree.mesh().clone()), up, up_reason, notes });
        }
        Content::Mesh(_) => "a mesh without triangles",
        Content::Points(_) => "points",
        Content::Splats(_) => "splats",
        Content::Gaussians(_) => "Gaussians",
    };
    let problem = format!("holds {found}, expected triangles for an object's \"mesh\": give it as \"splats\"");
    Err(Error::Unsuitable { path: path.to_path_buf(), problem })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_things_in_e57_and_pts_stand_as_their_shape_says() {
        let file = |text: &str, viewpoint: Option<DVec3>| {
            let name = Path::new("t.xyz");
            let options = surfel_io::LoadOptions::default();
            let mut loaded = surfel_io::load_bytes(text.as_bytes(), Some(Format::Xyz), name, &options).unwrap();
            loaded.format = Format::E57;
            if let Content::Points(points) = &mut loaded.content {
                points.viewpoint = viewpoint;
            }
            loaded
        };
        // Sizes are measured correctly far from the origin.
        let (bunny, room) = ("7 8 9\n7.1 8.9 9.2\n", "7 8 9\n7.1 9.1 9.2\n");
        assert_eq!(up_reason(&file(bunny, None)), None);
        let points = |text: &str| Loaded { format: Format::Pts, ..file(text, None) };
        assert_eq!([bunny, room].map(|text| up_reason(&points(text))), [None, Some(UpReason::Format)]);
        assert_eq!(up_reason(&file(room, None)), Some(UpReason::Format));
        assert_eq!(up_reason(&file(bunny, Some(DVec3::ZERO))), Some(UpReason::Format), "a scanner stood there");
        let scans = "x y z scan\n7 8 9 0\n7.1 8.2 9.2 1\n";
        assert_eq!(up_reason(&file(scans, None)), Some(UpReason::Format), "several scans");
    }
}
