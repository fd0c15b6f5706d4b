//! Points to splats.

use crate::neighbours::Neighbours;
use crate::radii::{self, Sizes, Spacing, median};
use crate::{Outliers, PointOptions, PointReport, Progress, SampleError};
use crate::{assemble, interior, normals, orient};
use glam::DVec3;
use std::borrow::Cow;
use surfel_math::basis::{orthonormal, unit};
use surfel_model::{CloudData, Column3, OnInvalid, PointCloud, Shape, SplatCloud, Up};

/// Radius of a cloud that has no spacing (one point, or all of them in one place), in object units.
const LONE_RADIUS: f64 = 1.0;

/// Makes a splat of each point.
///
/// Normals that are there (finite, not zero) are kept; others are estimated from neighbours and oriented as
/// [`PointOptions::viewpoint`] says. Radii come from the local spacing, so that the surface closes; where sampling is
/// stretched (scan lines) splats are ellipses, and the whole cloud then is [`Shape::Ellipses`]. Order, origin,
/// colours, alphas, extras, up and comments carry over, and the cloud's `interior_weight` is set. It is declared
/// oriented if no normal is given: estimated ones all point out of the same surface.
///
/// Coincident points get the same splat. A single point, or points that all coincide, get a radius of 1.
///
/// # Errors
/// [`SampleError::Empty`] without points, [`SampleError::NotFinite`] where [`PointCloud::drop_non_finite`] was not
/// called, [`SampleError::Option`] for options out of range, [`SampleError::TooMany`] above 268 million points, and
/// [`SampleError::Model`] for columns of unequal length or invalid colours.
pub fn splats_from_points(
    points: &PointCloud,
    options: &PointOptions,
    progress: &dyn Progress,
) -> Result<(SplatCloud, PointReport), SampleError> {
    options.check()?;
    points.check_columns()?;
    if points.is_empty() {
        return Err(SampleError::Empty { what: "point cloud", missing: "points" });
    }
    let positions: Vec<DVec3> = (0..points.len()).map(|i| points.positions.get(i)).collect();
    let cloud = Neighbours::new(&positions, options.neighbours, progress)?;
    drop(positions);

    let mut report = PointReport { duplicates: points.len() - cloud.len(), ..PointReport::default() };
    let given = GivenNormals(points.normals.as_ref());
    report.normals_given = (0..points.len()).filter(|i| given.get(*i).is_some()).count();
    report.normals_estimated = points.len() - report.normals_given;
    let unit_normals = complete_normals(points, &given, &cloud, options, progress);
    let sizes =
        radii::sizes(&cloud, &unit_normals, Spacing::Unknown(LONE_RADIUS / radii::DENSITY), options.ellipses, progress);

    report.outliers = cloud.slot_of.iter().filter(|s| sizes.isolated[**s as usize]).count();
    let mut source = Cow::Borrowed(points);
    let mut kept: Vec<u32> = (0..points.len() as u32).collect();
    let drop_outliers = options.outliers == Outliers::Drop && report.outliers > 0 && report.outliers < points.len();
    if drop_outliers || report.duplicates >= options.coincident.max(1) {
        let mut in_slot = vec![0_usize; cloud.len()];
        let mut keep = vec![true; points.len()];
        for (keep, slot) in keep.iter_mut().zip(&cloud.slot_of) {
            let slot = *slot as usize;
            in_slot[slot] += 1;
            let is_room = in_slot[slot] <= options.coincident.max(1);
            report.left_out += usize::from(!is_room);
            *keep = is_room && !(drop_outliers && sizes.isolated[slot]);
        }
        source.to_mut().retain(&keep);
        kept.retain(|i| keep[*i as usize]);
    }
    let scale = cloud.scale * options.radius_scale;
    let shape = shape(&kept, &cloud, &sizes, &unit_normals, &given, scale);
    let slots = kept.iter().map(|i| cloud.slot_of[*i as usize] as usize);
    let mut larger: Vec<f64> = slots.clone().map(|s| sizes.radii[s] * scale).collect();
    report.splats = kept.len();
    report.median_radius = median(&mut larger).unwrap_or(0.0);
    report.ellipses = sizes.stretched;

    let source = source.into_owned();
    let data = CloudData {
        colors: source.colors,
        alphas: source.alphas,
        up: source.up,
        rows: source.rows,
        extras: source.extras,
        comments: source.comments,
        oriented: report.normals_given == 0,
        ..CloudData::new(source.origin, source.positions, shape)
    };
    let (mut splats, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
    progress.stage("interior weight", 1);
    report.interior_weight = interior::interior_weight(&splats);
    if let Some(weight) = report.interior_weight {
        splats.set_interior_weight(weight);
    }
    progress.advance(1);
    Ok((splats, report))
}

/// A file's normals, where they say something.
struct GivenNormals<'a>(Option<&'a Column3>);

impl GivenNormals<'_> {
    fn get(&self, i: usize) -> Option<DVec3> {
        self.0.map(|c| c.get(i)).filter(|n| n.is_finite() && *n != DVec3::ZERO)
    }
}

/// A unit normal for each slot: given where one of its points has one, else estimated and oriented.
fn complete_normals(
    points: &PointCloud,
    given: &GivenNormals,
    cloud: &Neighbours,
    options: &PointOptions,
    progress: &dyn Progress,
) -> Vec<DVec3> {
    let mut known = vec![DVec3::ZERO; cloud.len()];
    for (i, slot) in cloud.slot_of.iter().enumerate() {
        if known[*slot as usize] == DVec3::ZERO {
            known[*slot as usize] = given.get(i).map_or(DVec3::ZERO, unit);
        }
    }
    let is_given: Vec<bool> = known.iter().map(|n| *n != DVec3::ZERO).collect();
    if is_given.iter().all(|g| *g) {
        return known;
    }
    normals::estimate(cloud, &mut known, progress);
    match options.viewpoint.or(points.viewpoint) {
        Some(v) => orient::toward(cloud, &mut known, &is_given, (v - points.origin - cloud.center) / cloud.scale),
        None => {
            let up = points.up.map_or(DVec3::Z, Up::vector);
            orient::orient(cloud, &mut known, &is_given, up, progress);
        }
    }
    known
}

/// The shape column of the points `kept`.
fn shape(
    kept: &[u32],
    cloud: &Neighbours,
    sizes: &Sizes,
    unit_normals: &[DVec3],
    given: &GivenNormals,
    scale: f64,
) -> Shape {
    let slot = |i: u32| cloud.slot_of[i as usize] as usize;
    let Some(axes) = &sizes.axes else {
        let normal = |i: &u32| given.get(*i as usize).unwrap_or(unit_normals[slot(*i)]).as_vec3();
        // A given normal may be too short for f32, or too long.
        let sound = |n: glam::Vec3, i: &u32| {
            if n.is_finite() && n != glam::Vec3::ZERO { n } else { unit_normals[slot(*i)].as_vec3() }
        };
        return Shape::Disks {
            normals: Column3::from_f32(kept.iter().map(|i| sound(normal(i), i)).collect()),
            radii: kept.iter().map(|i| assemble::radius32(sizes.radii[slot(*i)] * scale)).collect(),
        };
    };
    let own = |i: &u32| {
        let (s, t) = axes[slot(*i)];
        let (s, t) = (s * scale, t * scale);
        // Coincident points share a slot, but not always a normal.
        let normal = given.get(*i as usize).map_or(unit_normals[slot(*i)], unit);
        match normal.dot(unit_normals[slot(*i)]) {
            same if same > 0.999 => (s, t),
            opposite if opposite < -0.999 => (s, -t),
            _ => {
                let (u, v) = orthonormal(normal);
                let radius = (s.length() * t.length()).sqrt();
                (u * radius, v * radius)
            }
        }
    };
    assemble::ellipses(&kept.iter().map(own).collect::<Vec<_>>())
}
