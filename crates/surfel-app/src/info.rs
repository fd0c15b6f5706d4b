//! Summary of a file's content without converting all of it.

use crate::attributes;
use crate::survey::{Survey, survey};
use crate::values::json_number;
use glam::DVec3;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use surfel_framing::UpReason;
use surfel_io::{Content, LoadOptions, Loaded};
use surfel_load::Error;
use surfel_load::paths::is_stdin;
use surfel_load::scene::is_scene_file;
use surfel_load::up_reason;
use surfel_model::{Column3, Mesh, PointCloud, SplatCloud};
use surfel_sample::NoProgress;
#[cfg(feature = "sharp")]
use surfel_sample::SharpErrors;
use surfel_sample::{MeshMethod, MeshOptions, PointOptions};

/// Largest number of points for which radii are estimated from all of them.
const ALL: usize = 12_000;
/// Number of patches from which the radii of larger clouds are estimated.
pub(crate) const PATCHES: usize = 16;
/// Points around each patch's centre that are converted, and the ones nearest to it whose radii are used. The others
/// are near the rim, where neighbours are missing.
pub(crate) const PATCH: (usize, usize) = (600, 200);

/// Statistics of splat radii, in object units.
pub(crate) struct Radii {
    median: f64,
    min: f64,
    max: f64,
    how: &'static str,
}

impl Radii {
    pub(crate) fn of(mut radii: Vec<f64>, how: &'static str) -> Option<Self> {
        radii.sort_unstable_by(f64::total_cmp);
        let (min, max) = (*radii.first()?, *radii.last()?);
        Some(Self { median: *radii.get(radii.len() / 2)?, min, max, how })
    }
}

/// Describes a file's content without converting all of it, as the object that `surfel info --json` prints. It contains
/// format, counts (`points`, `splats`, `vertices`, `triangles`, …), `bounds` (least and largest coordinates), up axis,
/// attributes and their ranges, estimated radii, memory and notes. `stdin` is the content for the name `-`. LAS, LAZ
/// and COPC files are read twice in blocks, so memory doesn't grow with their size.
///
/// # Errors
/// [`Error::Io`] if the file can't be read or is damaged, [`Error::Unsuitable`] for a scene file.
pub fn info(path: &Path, options: &LoadOptions, stdin: Option<&[u8]>) -> Result<Value, Error> {
    if is_scene_file(path) {
        let what = "is a scene file, expected splats, points or a mesh: surfel render SCENE --print-scene shows it";
        return Err(Error::Unsuitable { path: path.to_path_buf(), problem: what.to_owned() });
    }
    // Gaussians are described as trained: all of them, with their harmonics.
    let options = &LoadOptions { gaussians: true, ..options.clone() };
    let file_bytes = |path: &Path| std::fs::metadata(path).map(|m| m.len()).unwrap_or(0);
    let (loaded, file_bytes) = match stdin.filter(|_| is_stdin(path)) {
        Some(bytes) => (surfel_io::load_bytes(bytes, None, Path::new("stdin"), options)?, bytes.len() as u64),
        None => match survey_of_many(path, options)? {
            Some(survey) => return Ok(facts_of_survey(path, survey, file_bytes(path))),
            None => (surfel_io::load(path, options)?, file_bytes(path)),
        },
    };
    Ok(facts(path, &loaded, file_bytes))
}

/// Summarises a file of many points, if its format can be read in blocks.
fn survey_of_many(path: &Path, options: &LoadOptions) -> Result<Option<Survey>, Error> {
    match surfel_io::survey_points(path, options.columns.as_ref()) {
        Some(count) if count.points > ALL as u64 => survey(path, count.points, options),
        _ => Ok(None),
    }
}

fn facts_of_survey(path: &Path, survey: Survey, file_bytes: u64) -> Value {
    let mut facts = facts(path, &survey.read.loaded, file_bytes);
    facts["points"] = json!(survey.points);
    facts["bounds"] = bounds_json(survey.read.bounds);
    facts["attributes"] = survey.attributes;
    facts["classes"] = survey.classes;
    facts["radii"] = radii_json(survey.radii);
    facts["memory_bytes"] = json!(survey.bytes);
    facts
}

fn bounds_json(bounds: Option<(DVec3, DVec3)>) -> Value {
    bounds.map_or(Value::Null, |(lo, hi)| json!([lo.to_array(), hi.to_array()]))
}

fn radii_json(radii: Option<Radii>) -> Value {
    radii.map_or(Value::Null, |r| {
        json!({ "median": json_number(r.median), "min": json_number(r.min), "max": json_number(r.max),
                "estimated": r.how != "given", "how": r.how })
    })
}

fn facts(path: &Path, loaded: &Loaded, file_bytes: u64) -> Value {
    let reason = match up_reason(loaded) {
        Some(UpReason::Stated) => "the file says so".to_owned(),
        Some(_) => format!("as always in {}", loaded.format),
        None => format!("default of {}; images judge by the shape", loaded.format),
    };
    let mut facts = json!({
        "file": path.to_string_lossy(),
        "format": loaded.format.name(),
        "file_bytes": file_bytes,
        "up": loaded.up.name(),
        "up_reason": reason,
        "notes": loaded.notes,
    });
    let (kind, counts, bounds, radii, memory, interior_weight) = match &loaded.content {
        Content::Splats(cloud) => {
            let radii = Radii::of((0..cloud.len()).map(|i| cloud.radius_max(i)).collect(), "given");
            let counts = vec![("splats", cloud.len())];
            ("splats", counts, cloud.bounds(), radii, cloud.bytes(), cloud.data().interior_weight)
        }
        Content::Points(points) => {
            let counts = vec![("points", points.len())];
            ("points", counts, points.bounds(), radii_of_points(points), bytes_of_points(points), None)
        }
        Content::Octree(octree) => {
            let (cloud, mesh) = (octree.cloud(), octree.mesh());
            let radii = Radii::of((0..cloud.len()).map(|i| cloud.radius_max(i)).collect(), "given");
            let counts = vec![
                ("splats", cloud.len()),
                ("vertices", mesh.positions.len()),
                ("triangles", mesh.triangles.len()),
                ("nodes", octree.nodes().len()),
                ("transitions", octree.transitions().len()),
            ];
            let bounds = bounds(mesh.origin, &mesh.positions);
            let bytes = octree.bytes() + bytes_of_mesh(mesh);
            ("octree", counts, bounds, radii, bytes, cloud.data().interior_weight)
        }
        Content::Gaussians(gaussians) => {
            let counts = vec![("splats", gaussians.len())];
            let bounds = bounds(gaussians.data().origin, &gaussians.data().centers);
            ("Gaussians", counts, bounds, None, gaussians.bytes(), None)
        }
        Content::Mesh(mesh) => {
            let counts = vec![("vertices", mesh.positions.len()), ("triangles", mesh.triangles.len())];
            let bounds = bounds(mesh.origin, &mesh.positions);
            ("mesh", counts, bounds, radii_of_mesh(mesh), bytes_of_mesh(mesh), None)
        }
    };
    let (extras, comments) = match &loaded.content {
        Content::Splats(cloud) => (cloud.data().extras.as_slice(), cloud.data().comments.as_slice()),
        Content::Points(points) => (points.extras.as_slice(), points.comments.as_slice()),
        _ => (&[][..], &[][..]),
    };
    facts["attributes"] = Value::Object(match &loaded.content {
        Content::Mesh(mesh) => attributes::of_mesh_with_columns(&loaded.content, &loaded.attributes, mesh),
        _ => attributes::ranges(&loaded.content, &loaded.attributes, extras),
    });
    facts["classes"] = attributes::class_counts(extras).map_or(Value::Null, |counts| attributes::classes(&counts));
    facts["crs"] = attributes::crs(comments);
    facts["kind"] = json!(kind);
    if let Content::Gaussians(gaussians) = &loaded.content {
        facts["harmonics_degree"] = json!(gaussians.data().degree);
    }
    counts.into_iter().for_each(|(name, count)| facts[name] = json!(count));
    facts["bounds"] = bounds_json(bounds);
    facts["radii"] = radii_json(radii);
    facts["memory_bytes"] = json!(memory);
    facts["interior_weight"] = json!(interior_weight);
    #[cfg(feature = "sharp")]
    if let Content::Splats(cloud) = &loaded.content {
        // Errors that `convert --sharp` measured against the mesh.
        let errors = cloud.data().comments.iter().find_map(|c| c.strip_prefix(SharpErrors::PREFIX));
        facts["sharp_errors"] = json!(errors);
    }
    facts
}

fn bounds(origin: DVec3, positions: &Column3) -> Option<(DVec3, DVec3)> {
    let first = origin + positions.high().first().map(|_| positions.get(0))?;
    Some((0..positions.len()).fold((first, first), |(lo, hi), i| {
        let p = origin + positions.get(i);
        (lo.min(p), hi.max(p))
    }))
}

pub(crate) fn bytes_of_points(p: &PointCloud) -> usize {
    p.positions.bytes()
        + p.normals.as_ref().map_or(0, Column3::bytes)
        + p.colors.as_ref().map_or(0, |c| size_of_val(c.as_slice()))
        + p.alphas.as_ref().map_or(0, |c| size_of_val(c.as_slice()))
        + p.extras.iter().map(|e| e.values.bytes()).sum::<usize>()
}

fn bytes_of_mesh(m: &Mesh) -> usize {
    m.positions.bytes()
        + size_of_val(m.triangles.as_slice())
        + m.normals.as_ref().map_or(0, |c| size_of_val(c.as_slice()))
        + m.colors.as_ref().map_or(0, |c| size_of_val(c.as_slice()))
        + m.alphas.as_ref().map_or(0, |c| size_of_val(c.as_slice()))
        + m.uvs.as_ref().map_or(0, |c| size_of_val(c.as_slice()))
        + m.materials.as_ref().map_or(0, |all| size_of_val(all.of_triangle.as_slice()))
        + m.vertex_extras.iter().chain(&m.triangle_extras).map(|extra| extra.values.bytes()).sum::<usize>()
        + bytes_of_textures(m)
}

/// Counts each texture once, however many materials use it.
fn bytes_of_textures(m: &Mesh) -> usize {
    let textures: BTreeMap<_, _> = m.textures().map(|t| (Arc::as_ptr(t), size_of_val(t.srgba8.as_slice()))).collect();
    textures.values().sum()
}

fn radii_of(cloud: &SplatCloud, count: usize) -> impl Iterator<Item = f64> {
    (0..count.min(cloud.len())).map(|i| cloud.radius_max(i))
}

/// Estimates the radii of the first `count` points; true if they are the file's.
fn radii_among(points: &PointCloud, count: usize) -> (Vec<f64>, bool) {
    let made = surfel_sample::splats_from_points(points, &PointOptions::default(), &NoProgress);
    made.map(|(cloud, report)| (radii_of(&cloud, count).collect(), report.radii_given > 0)).unwrap_or_default()
}

/// Estimates the radii of the points nearest to a patch's centre. `near` holds the points around it, nearest first.
pub(crate) fn radii_of_patch(near: &PointCloud) -> Vec<f64> {
    radii_among(near, PATCH.1).0
}

/// Estimates the radii that a render would give the points, from all points or from patches of a large cloud.
fn radii_of_points(points: &PointCloud) -> Option<Radii> {
    if points.len() <= ALL {
        let (radii, are_given) = radii_among(points, points.len());
        return Radii::of(radii, if are_given { "given" } else { "estimated from neighbours" });
    }
    let positions = points.positions.high();
    let (mut radii, mut are_given) = (Vec::new(), false);
    for patch in 0..PATCHES {
        let middle = positions[(2 * patch + 1) * points.len() / (2 * PATCHES)];
        let mut near: Vec<(f32, u32)> =
            (0..points.len() as u32).map(|i| (positions[i as usize].distance_squared(middle), i)).collect();
        let order = |a: &(f32, u32), b: &(f32, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        near.select_nth_unstable_by(PATCH.0, order);
        near.truncate(PATCH.0);
        near.sort_unstable_by(order);
        let indices: Vec<u32> = near.iter().map(|n| n.1).collect();
        let local = PointCloud {
            positions: points.positions.select(&indices),
            normals: points.normals.as_ref().map(|n| n.select(&indices)),
            radii: points.radii.as_ref().map(|radii| indices.iter().map(|i| radii[*i as usize]).collect()),
            ..PointCloud::default()
        };
        let (of_patch, given) = radii_among(&local, PATCH.1);
        are_given |= given;
        radii.extend(of_patch);
    }
    Radii::of(radii, if are_given { "given" } else { "estimated from neighbours, on a sample of the points" })
}

/// Estimates the radii that a render would give a mesh's splats. If splats are spread over the surface, fewer of them
/// are used.
fn radii_of_mesh(mesh: &Mesh) -> Option<Radii> {
    let options = MeshOptions::auto(mesh);
    match options.method {
        MeshMethod::Adaptive(count) => {
            let few = count.min(4000);
            let options = MeshOptions { method: MeshMethod::Count(few), ..options };
            let (cloud, _) = surfel_sample::splats_from_mesh(mesh, &options, &NoProgress).ok()?;
            // The spacing of n samples is proportional to 1/√n.
            let scale = (few as f64 / count as f64).sqrt();
            let radii = radii_of(&cloud, cloud.len()).map(|r| r * scale).collect();
            Radii::of(radii, "estimated for splats spread over the surface, from fewer of them")
        }
        _ => {
            let points = surfel_sample::points_from_mesh(mesh).ok()?;
            let radii = radii_of_points(&points)?;
            Some(Radii { how: "estimated for one splat a vertex, on a sample of them", ..radii })
        }
    }
}
