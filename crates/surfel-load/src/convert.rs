//! Conversion of points and meshes to splats according to the options, with notes for the user.

use crate::loaded_cloud::Conversion;
use crate::noise::{noise_points, water};
use crate::words::{counted, number};
use crate::{Error, LoadOptions, levels, memory};
use glam::DVec3;
use std::path::Path;
use surfel_model::{
    Column3, ExtraColumn, Mesh, OnInvalid, Outliers, PointCloud, PointColors, Shape, SplatCloud, TextureSampling,
};
use surfel_sample::{MeshMethod, MeshOptions, MeshReport, PointOptions, PointReport, Progress};

/// Multiplies the radii of splats by `scale`, and estimates their interior weight again, since it depends on the radii.
pub(crate) fn scaled(cloud: SplatCloud, scale: f64) -> Result<SplatCloud, Error> {
    let mut data = cloud.into_data();
    let column = |c: &Column3| Column3::from_f32(c.high().iter().map(|v| *v * scale as f32).collect());
    match &mut data.shape {
        Shape::Disks { radii, .. } | Shape::Balls { radii, .. } => radii.iter_mut().for_each(|r| *r *= scale as f32),
        Shape::Ellipses { s, t } => (*s, *t) = (column(s), column(t)),
    }
    data.interior_weight = None;
    let (mut cloud, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
    if let Some(weight) = surfel_sample::interior_weight(&cloud) {
        cloud.set_interior_weight(weight);
    }
    Ok(cloud)
}

/// Returns one flag per point or splat, true if the options select it; `None` if no option restricts the selection.
/// Adds a note about the selection. Returns an error if nothing is selected. `what` names the points or splats in
/// messages.
fn chosen(
    (count, position): (usize, &dyn Fn(usize) -> DVec3),
    extras: &[ExtraColumn],
    (path, what): (&Path, &str),
    options: &LoadOptions,
    notes: &mut Vec<String>,
) -> Result<Option<Vec<bool>>, Error> {
    let unsuitable = |problem| Error::Unsuitable { path: path.to_path_buf(), problem };
    let found =
        surfel_model::choose(&options.convert, count, position, levels::own_columns(extras)).map_err(unsuitable)?;
    let Some((_, left)) = found.left.last() else { return Ok(None) };
    let steps: Vec<String> = found.left.iter().map(|(key, left)| format!("`{key}` leaves {left}")).collect();
    let steps = steps.join(", ");
    if *left == 0 && count > 0 {
        let first = position(0);
        let (lo, hi) = (0..count).fold((first, first), |(lo, hi), i| (lo.min(position(i)), hi.max(position(i))));
        return Err(unsuitable(format!(
            "of its {count} {what} none is left: {steps}; they are within {},{},{},{},{},{}",
            lo.x, lo.y, lo.z, hi.x, hi.y, hi.z
        )));
    }
    notes.push(format!("chose {left} of {count} {what}: {steps}"));
    Ok(Some(found.keep))
}

/// Returns the splats that the options select. Adds a note on the selection.
pub(crate) fn chosen_splats(
    cloud: SplatCloud,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
) -> Result<SplatCloud, Error> {
    let rows: (usize, &dyn Fn(usize) -> DVec3) = (cloud.len(), &|i| cloud.center(i));
    let Some(keep) = chosen(rows, &cloud.data().extras, (path, "splats"), options, notes)? else { return Ok(cloud) };
    let mut data = cloud.into_data();
    data.retain(&keep);
    Ok(SplatCloud::new(data, OnInvalid::Refuse)?.0)
}

/// Largest number of points at exactly the same position, such as the origin, at which all of them are used. Further
/// ones are dropped.
const MAX_COINCIDENT: usize = 16;
/// Reason, as text for notes, for dropping points at a position that many points share.
const CROWDED: &str = "more than 16 are in their place";

/// Returns the points that the options select, without the internal columns for levels of detail. Adds notes on points
/// that are left out.
pub fn chosen_points(
    points: PointCloud,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<PointCloud, Error> {
    let (mut points, _) = chosen_points_of_levels(points, path, options, notes, progress)?;
    levels::Radii::take(&mut points);
    Ok(points)
}

/// Returns the points that the options select, with the internal columns for levels of detail. The flag is true if the
/// points were thinned evenly.
fn chosen_points_of_levels(
    mut points: PointCloud,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<(PointCloud, bool), Error> {
    let keep = {
        let rows: (usize, &dyn Fn(usize) -> DVec3) = (points.len(), &|i| points.origin + points.positions.get(i));
        chosen(rows, &points.extras, (path, "points"), options, notes)?
    };
    if let Some(keep) = keep {
        points.retain(&keep);
    }
    if options.surface
        && let Some(found) = noise_points(&points.extras, points.len(), options)
    {
        let words = found.words();
        if !found.flags.contains(&false) {
            let problem = format!("holds no surface but {words}: `classes=all` draws all points");
            return Err(Error::Unsuitable { path: path.to_path_buf(), problem });
        }
        points.retain(&found.flags.iter().map(|flag| !flag).collect::<Vec<_>>());
        notes.push(format!("left out {words}, which are no surface (`classes=all` keeps them)"));
    }
    let total = points.len();
    let dropped = if options.convert.all_points { 0 } else { points.drop_at_origin(MAX_COINCIDENT) };
    if dropped > 0 {
        notes.push(format!(
            "left out {dropped} of {total} points at exactly 0,0,0, where sensors write that nothing came back \
             (`all_points` keeps them)"
        ));
    }
    if options.convert.outliers == Some(Outliers::Drop) {
        let total = points.len();
        let found = surfel_sample::outliers(&points, progress);
        let mut keep = found.map_err(|source| Error::Sample { path: path.to_path_buf(), source })?;
        keep.iter_mut().for_each(|alone| *alone = !*alone);
        // Water reflects few pulses, so that its points are isolated without being outliers.
        if let Some(water) = water(&points.extras, points.len()) {
            keep.iter_mut().zip(water).for_each(|(keep, water)| *keep |= water);
        }
        points.retain(&keep);
        notes.push(format!(
            "left out {} of {total} points as outliers: they are more than 8 times as far from their 8 nearest as is \
             usual in the cloud or around them",
            total - points.len()
        ));
    }
    let dropped = options.max_points().map_or(0, |most| points.thin(most));
    if dropped > 0 {
        notes.push(format!("{} of {} points are left, evenly chosen", points.len(), points.len() + dropped));
    }
    Ok((points, dropped > 0 || options.convert.every.is_some()))
}

/// Selects points by the options, and converts them to splats.
pub(crate) fn points(
    points: PointCloud,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<(SplatCloud, Conversion), Error> {
    let (mut points, is_thinned) = chosen_points_of_levels(points, path, options, notes, progress)?;
    // If splats are estimated from neighbours, coincident points are dropped there.
    let is_direct = !options.convert.all_points && levels::Radii::are_stated(&points);
    let dropped = if is_direct { points.drop_coincident(MAX_COINCIDENT) } else { 0 };
    if dropped > 0 {
        notes.push(format!(
            "left out {}, because {CROWDED} (`all_points` keeps them)",
            counted(dropped as u64, "points")
        ));
    }
    let radii = levels::Radii::take(&mut points);
    // Radii that the file states cover the surface only if all of its points are used.
    if is_thinned && points.radii.take().is_some() {
        notes.push("left the file's radii a column: they close the surface of all its points only".to_owned());
    }
    if is_thinned || !radii.are_known(&points) {
        return splats_of_points(&points, None, path, options, notes, progress);
    }
    let (cloud, report) = radii.splats(points, options.radius_scale())?;
    notes.push(format!(
        "a point cloud: {}, normals and radii (median {}) as the file has them",
        counted(report.splats as u64, "splats"),
        number(report.median_radius)
    ));
    finished((cloud, true), report, path, options, notes, progress)
}

/// Converts points to splats without selecting points. `above` is a position far above the points, which estimated
/// normals face; `None` if there is no such position.
pub fn splats_of_points(
    points: &PointCloud,
    above: Option<DVec3>,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<(SplatCloud, Conversion), Error> {
    let remedy = memory::Remedy::Points;
    memory::check(path, points.len() as u64, memory::prepared_bytes(points), options.memory, remedy)?;
    let point_options = PointOptions {
        radius_scale: options.radius_scale(),
        viewpoint: above,
        coincident: if options.convert.all_points { usize::MAX } else { MAX_COINCIDENT },
        level_where_scattered: above.is_some(),
        interior_weight: !options.has_stated_weight,
        ..PointOptions::default()
    };
    let made = surfel_sample::splats_from_points(points, &point_options, progress);
    let (cloud, report) = made.map_err(|source| Error::Sample { path: path.to_path_buf(), source })?;
    notes.push(points_note(&report));
    finished((cloud, false), report, path, options, notes, progress)
}

/// Finishes splats made from points. Enlarges them where finer levels of detail are missing, clips them along edges,
/// and fits their colours, as the options state. `stated` is true if the file states the radii.
fn finished(
    (cloud, stated): (SplatCloud, bool),
    report: PointReport,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<(SplatCloud, Conversion), Error> {
    let cloud = levels::close(cloud, options.interior_weight, stated)?;
    let cloud = if options.convert.sharp { sharpen(cloud, path, options, notes, progress)? } else { cloud };
    let cloud = match options.convert.colors {
        Some(PointColors::Fit) => fit_colors(cloud, path, notes, progress)?,
        None | Some(PointColors::AsIs) => cloud,
    };
    Ok((cloud, Conversion::Points(report)))
}

/// Fits the colours of splats so that their blend reproduces the colours of the points. The colours stay unchanged if
/// fitted ones predict held-out points no better.
fn fit_colors(
    cloud: SplatCloud,
    path: &Path,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<SplatCloud, Error> {
    let is_colored = cloud.data().colors.is_some();
    let made = surfel_sample::fit_point_colors(cloud, progress);
    let (cloud, report) = made.map_err(|source| Error::Sample { path: path.to_path_buf(), source })?;
    let [before, after] = report.held_out_rms;
    notes.push(match report.steps {
        _ if !is_colored => "there are no colours to fit".to_owned(),
        None => "colours are kept as they are: fitted ones predict a held-out tenth of the points no better".to_owned(),
        Some(steps) => format!(
            "colours fitted in {steps} steps: a held-out tenth of the points is predicted to {after:.4} (RMS, linear \
             light), {before:.4} as is"
        ),
    });
    Ok(cloud)
}

/// Fits the colours of a mesh's splats so that their blend reproduces the mesh, by the method that the option `texture`
/// states. Point sampling changes nothing.
fn textured(
    cloud: SplatCloud,
    mesh: &Mesh,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<SplatCloud, Error> {
    let sampling = options.convert.texture.sampling.unwrap_or_default();
    if sampling == TextureSampling::Point || mesh.triangles.is_empty() {
        return Ok(cloud);
    }
    let made = surfel_sample::fit_to_mesh(cloud, mesh, sampling, progress);
    let (cloud, report) = made.map_err(|source| Error::Sample { path: path.to_path_buf(), source })?;
    let [before, after] = report.color_rms;
    let mut note = match (sampling, report.samples) {
        (_, 0) => "there is neither colour nor smooth normal to fit".to_owned(),
        (TextureSampling::Fit, samples) => format!(
            "fitted to {samples} samples of the surface in {} steps: colours blend to within {after:.4} (RMS, linear \
             light), {before:.4} before",
            report.steps
        ),
        _ => format!("colours are means under the splats' own kernels: {after:.4} off (RMS), {before:.4} before"),
    };
    if let Some([before, after]) = report.normal_rms {
        let degrees = |rms: f64| (rms * 3f64.sqrt()).to_degrees();
        note += &format!(", normals to {:.3} degrees, {:.3} before", degrees(after), degrees(before));
    }
    notes.push(note);
    Ok(cloud)
}

/// Converts a mesh to splats.
pub(crate) fn mesh(
    mesh: &Mesh,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<(SplatCloud, Conversion), Error> {
    let method = options.method().unwrap_or_else(|| MeshOptions::auto(mesh).method);
    let is_spread = !options.convert.sharp && method.is_spread();
    if mesh.has_normal_maps() && !is_spread {
        notes
            .push("left out the normal maps: they shade splats that are spread over the mesh, as `splats` does".into());
    }
    if options.convert.sharp {
        let (cloud, conversion) = sharp(mesh, path, options, notes, progress)?;
        return Ok((textured(cloud, mesh, path, options, notes, progress)?, conversion));
    }
    let mesh_options = MeshOptions { method, radius_scale: options.radius_scale() };
    let made = surfel_sample::splats_from_mesh(mesh, &mesh_options, progress);
    let (cloud, report) = made.map_err(|source| Error::Sample { path: path.to_path_buf(), source })?;
    notes.push(mesh_note(mesh, &report));
    Ok((textured(cloud, mesh, path, options, notes, progress)?, Conversion::Mesh(report)))
}

/// Clips splats of points along edges that are detected in the points.
#[cfg(feature = "sharp")]
fn sharpen(
    cloud: SplatCloud,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<SplatCloud, Error> {
    let angle = options.convert.crease_angle.unwrap_or(surfel_sample::SharpOptions::default().crease_angle_deg);
    let made = surfel_sample::sharpen_points(&cloud, angle, progress);
    let (cloud, report) = made.map_err(|source| Error::Sample { path: path.to_path_buf(), source })?;
    notes.push(match report.clipped {
        0 => format!("no edge of {angle} degrees or more is found in the points, nothing is clipped"),
        clipped => {
            let clipped = counted(clipped as u64, "splats");
            format!("{clipped} clipped along edges, {} of them at corners", report.corners)
        }
    });
    Ok(cloud)
}

/// Converts a mesh to splats that are clipped along its creases.
#[cfg(feature = "sharp")]
fn sharp(
    mesh: &Mesh,
    path: &Path,
    options: &LoadOptions,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<(SplatCloud, Conversion), Error> {
    let defaults = surfel_sample::SharpOptions::default();
    let sharp_options = surfel_sample::SharpOptions {
        crease_angle_deg: options.convert.crease_angle.unwrap_or(defaults.crease_angle_deg),
        splats: options.method().and_then(|method| if let MeshMethod::Count(n) = method { Some(n) } else { None }),
        error: options.convert.error,
        radius_scale: options.radius_scale(),
    };
    let made = surfel_sample::sharp_splats_from_mesh(mesh, &sharp_options, progress);
    let (cloud, report) = made.map_err(|source| Error::Sample { path: path.to_path_buf(), source })?;
    let [ridges, edges] = report.ridges;
    notes.push(format!(
        "a mesh of {} triangles, {ridges} ridges of {edges} edges: {} splats, {} clipped by a curve, {} by lines",
        mesh.triangles.len(),
        report.splats,
        report.with_curve,
        report.with_lines
    ));
    notes.push(report.errors.comment());
    Ok((cloud, Conversion::SharpMesh(Box::new(report))))
}

#[cfg(not(feature = "sharp"))]
fn sharpen(
    _: SplatCloud,
    path: &Path,
    _: &LoadOptions,
    _: &mut Vec<String>,
    _: &dyn Progress,
) -> Result<SplatCloud, Error> {
    Err(not_built(path))
}

#[cfg(not(feature = "sharp"))]
fn sharp(
    _: &Mesh,
    path: &Path,
    _: &LoadOptions,
    _: &mut Vec<String>,
    _: &dyn Progress,
) -> Result<(SplatCloud, Conversion), Error> {
    Err(not_built(path))
}

#[cfg(not(feature = "sharp"))]
fn not_built(path: &Path) -> Error {
    let problem = "clipped splats are asked for, which need Cargo's feature 'sharp': build with --features sharp";
    Error::Unsuitable { path: path.to_path_buf(), problem: problem.to_owned() }
}

fn points_note(report: &PointReport) -> String {
    let normals = match (report.normals_given, report.normals_estimated) {
        (_, 0) => "normals kept".to_owned(),
        (0, _) => "normals estimated from neighbours".to_owned(),
        (given, estimated) => format!("{given} normals kept, {estimated} estimated from neighbours"),
    };
    let radii = match report.radii_given {
        0 => "radii estimated from neighbours".to_owned(),
        given if given == report.splats => "radii as the file has them".to_owned(),
        given => format!("{given} radii as the file has them, {} estimated", report.splats - given),
    };
    let mut note = format!(
        "a point cloud: {}, {normals}, {radii} (median {})",
        counted(report.splats as u64, "splats"),
        number(report.median_radius)
    );
    if let Some(times) = report.radii_too_large {
        note += &format!(
            "; the file's radii are left a column: their median is {} spacings of the points, expected at most {}",
            number(times),
            surfel_sample::MAX_SPACINGS
        );
    }
    if report.normals_off > 0 {
        let normals = counted(report.normals_off as u64, "normals");
        note +=
            &format!("; {normals} of the file off the layout of the points, which lays the disks: for shading only");
    }
    if report.isolated > 0 {
        let points = counted(report.isolated as u64, "isolated points");
        note += &format!("; {points} (drawn small; `outliers=drop` leaves out what stands alone)");
    }
    if report.left_out > 0 {
        note += &format!(
            "; {} left out, because {CROWDED}, to a billionth of the cloud's size (`all_points` keeps them; \
             `outliers=drop` makes a cloud with a stray point smaller)",
            counted(report.left_out as u64, "points")
        );
    }
    note
}

fn mesh_note(mesh: &Mesh, report: &MeshReport) -> String {
    let how = match report.method {
        MeshMethod::PerFace => "one a face",
        MeshMethod::PerVertex => "one a vertex",
        _ => "spread over the surface",
    };
    let closer = report.detail.is_some_and(|detail| detail.splats < detail.shape.max(detail.colors));
    let how = if closer { "closer together where colours vary" } else { how };
    let mut note = format!(
        "a mesh of {}: {}, {how} (median radius {})",
        counted(mesh.triangles.len() as u64, "triangles"),
        counted(report.splats as u64, "splats"),
        number(report.median_radius)
    );
    if let Some(detail) = report.detail {
        note += &format!("; its shape asks for {}, its colours for {}", detail.shape, detail.colors);
        if closer {
            note += " everywhere";
        }
    }
    if report.degenerate > 0 {
        note += &format!("; {} of no area", counted(report.degenerate as u64, "triangles"));
    }
    if report.repeated > 0 {
        note += &format!("; {} triangles repeat others", report.repeated);
    }
    note
}
