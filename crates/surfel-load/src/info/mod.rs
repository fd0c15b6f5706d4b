//! Summary of a file's content without converting all of it.

pub mod attributes;
mod radii;
mod survey;

use crate::error::Error;
use crate::load::up_reason;
use crate::paths::is_stdin;
use crate::scene::is_scene_file;
use glam::DVec3;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use surfel_framing::UpReason;
use surfel_io::{Content, LoadOptions, Loaded};
use surfel_model::{Column3, Mesh};
#[cfg(feature = "sharp")]
use surfel_sample::SharpErrors;

use self::radii::{ALL, Radii, bytes_of_points, radii_of_mesh, radii_of_points};
use self::survey::{Survey, survey};

/// Describes a file's content without converting all of it. Returns the JSON object that `surfel info --json` prints.
/// Notes name options in code quotes, such as `` `classes=all` ``; a program replaces them by its own spelling. The
/// object contains:
///
/// - format, counts (`points`, `splats`, `vertices`, `triangles`, …) and `bounds` (minimum and maximum coordinates);
/// - up axis, attributes and their ranges, and estimated radii;
/// - memory in bytes, and notes.
///
/// `stdin` is the content of the input named `-`. Large LAS, LAZ and COPC files are read twice in blocks, so memory
/// doesn't grow with their size.
///
/// # Errors
/// [`Error::Io`] if the file can't be read or is damaged, [`Error::Unsuitable`] for a scene file.
pub fn info(path: &Path, options: &LoadOptions, stdin: Option<&[u8]>) -> Result<Value, Error> {
    if is_scene_file(path) {
        let what = "is a scene file, expected splats, points or a mesh: surfel render SCENE `print_scene` shows it";
        return Err(Error::Unsuitable { path: path.to_path_buf(), problem: what.to_owned() });
    }
    // Gaussians are described as they are stored: all of them, with their harmonics.
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

/// Summarises a file with many points, which is read in blocks. Returns `None` for small files, and for formats that
/// can't be read in blocks.
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
        // Approximation errors that `convert --sharp` measured against the mesh and stored as a comment.
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

/// Returns the size of all textures in bytes. A texture that several materials use is counted once.
fn bytes_of_textures(m: &Mesh) -> usize {
    let textures: BTreeMap<_, _> = m.textures().map(|t| (Arc::as_ptr(t), size_of_val(t.srgba8.as_slice()))).collect();
    textures.values().sum()
}

/// Converts a number to JSON, which has no infinities or NaN: they become `"inf"`, `"-inf"` and `"nan"`.
pub fn json_number(value: f64) -> Value {
    match value {
        v if v.is_finite() => Value::from(v),
        v if v.is_nan() => Value::from("nan"),
        v => Value::from(if v > 0.0 { "inf" } else { "-inf" }),
    }
}
