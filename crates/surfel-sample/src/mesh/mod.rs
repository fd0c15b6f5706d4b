//! Conversion of meshes to splats.

mod borders;
mod closed;
mod columns;
pub(crate) mod count;
mod creases;
mod density;
mod detail;
mod eliminate;
mod face_tree;
mod gaps;
pub(crate) mod geometry;
mod octree;
mod options;
pub(crate) mod parts;
pub(crate) mod per_face;
mod placed;
pub(crate) mod random;
mod scatter;
pub(crate) mod see_through;
mod transitions;
mod vertices;

use crate::parallel::map_each;
use crate::{NoProgress, Progress, SampleError, interior};
use surfel_model::{CloudData, Mesh, OnInvalid, SplatCloud};

pub use closed::{BOTH_SIDES, CLOSED_MESH, FINE_SPLATS, FLAT_PARTS, is_closed, is_oriented, turn_outward};
pub use columns::MeshPlaces;
pub use detail::Detail;
pub use octree::{OctreeOptions, octree_from_mesh};
pub use options::{MeshMethod, MeshOptions, MeshReport};
pub use vertices::points_from_mesh;

/// Converts a mesh to splats by the method of the options.
///
/// Colours come from the texture (times the vertex colours) or the vertex colours; alphas likewise. Origin, up axis and
/// comments are copied, and the cloud's `interior_weight` is set if it can be measured. The cloud is declared oriented
/// if the mesh is ([`is_oriented`]).
///
/// A splat lies in the plane of its triangle, which determines its visible side. If the shading normal differs, it
/// comes from the mesh's own normals, or from angle-weighted normals that aren't averaged across creases. Lines clip a
/// splat (rendering model §7) where its smooth region ends: at creases above 40°, at open edges, and where more than
/// two triangles meet. An opaque mesh without such edges has no clip columns. On a partly transparent mesh, invisible
/// splats are removed, and partly visible ones are divided or clipped, so that the number of splats may change. With
/// [`MeshMethod::PerVertex`], splats are only removed.
///
/// - [`MeshMethod::PerFace`]: the Steiner circumellipse of each triangle, clipped. Axes s and t are the principal
///   half-axes, with s × t outward. Without stored normals, the splats shade flat.
/// - [`MeshMethod::PerVertex`]: [`points_from_mesh`], then radii from the local spacing as for points, unclipped, and
///   large enough to cover the triangles around a vertex. A splat is in the mean plane of these triangles.
/// - [`MeshMethod::Count`]: exactly the given number of samples. Up to a million samples are blue noise (weighted
///   sample elimination), more are stratified. Splats are also clipped at bends of 15° to 40° between triangles that
///   are large enough for three splats each. Disks thus protrude from the surface by at most 0.15 of the distance
///   between them. If lines leave little of a splat, it grows up to 2.2 times. In strips narrower than about a third of
///   the distance between splats, a splat reaches over the edge, because few such strips have a splat. If no splat
///   covers a place near an edge, viewed at up to 50° from its normal, a splat that its neighbours can replace is moved
///   to the place. At most a sixteenth of all splats are moved (or 64, if that is more), and none if there are more
///   than a million or if radii are scaled down.
/// - [`MeshMethod::Adaptive`]: the given number of samples if the mesh is nearly flat. On thin parts, samples are
///   closer together.
/// - [`MeshMethod::Detail`]: the number of samples in [`Detail`]. Samples are closer where colours vary, if that needs
///   fewer in total.
///
/// Sources: C12 §5.1 (one ellipse per triangle); weighted sample elimination (Yuksel 2015); Z04 (clip lines).
///
/// # Errors
/// [`SampleError::Empty`] without vertices. [`SampleError::Empty`] without triangles and [`SampleError::NoArea`] if no
/// triangle has an area, both unless the method is [`MeshMethod::PerVertex`]. [`SampleError::Option`] for options out
/// of range, [`SampleError::TooMany`] above 268 million elements, and [`SampleError::Model`] for an invalid mesh.
pub fn splats_from_mesh(
    mesh: &Mesh,
    options: &MeshOptions,
    progress: &dyn Progress,
) -> Result<(SplatCloud, MeshReport), SampleError> {
    SampleError::check_scale(options.radius_scale)?;
    mesh.validate()?;
    if mesh.positions.is_empty() {
        return Err(SampleError::Empty { what: "mesh", missing: "vertices" });
    }
    if options.method == MeshMethod::PerVertex {
        return vertices::splats(mesh, options, progress);
    }
    if mesh.triangles.is_empty() {
        return Err(SampleError::Empty { what: "mesh", missing: "triangles" });
    }
    SampleError::check_count("triangles", mesh.triangles.len())?;
    let mut report = MeshReport {
        method: options.method,
        detail: None,
        splats: 0,
        degenerate: 0,
        repeated: 0,
        feature_edges: 0,
        flat: false,
        median_radius: 0.0,
        interior_weight: None,
    };
    if matches!(options.method, MeshMethod::Detail | MeshMethod::Adaptive(_)) {
        let geometry = geometry::Geometry::new(mesh);
        if geometry.total_area() <= 0.0 {
            return Err(SampleError::NoArea { triangles: mesh.triangles.len() });
        }
        let smooth = geometry.smooth();
        let (count, density) = if let MeshMethod::Adaptive(count) = options.method {
            SampleError::check_splats(count)?;
            detail::adaptive(&geometry, &smooth, count)
        } else {
            let (detail, density) = Detail::new(&geometry, &smooth);
            report.detail = Some(detail);
            (detail.splats, density)
        };
        report.method = MeshMethod::Count(count);
        let data = count::splats(&geometry, smooth, &density, count, options.radius_scale, &mut report, progress)?;
        return finish(mesh, data, report, progress);
    }
    let data = match report.method {
        MeshMethod::Count(count) => count::even_splats(mesh, count, options.radius_scale, &mut report, progress)?,
        _ => per_face::splats(mesh, options.radius_scale, &mut report, progress)?,
    };
    finish(mesh, data, report, progress)
}

/// Adds the mesh's up axis, comments and orientation to the splats' data, and the comment [`FLAT_PARTS`] or
/// [`FINE_SPLATS`] if it applies. Validates the cloud, measures its interior weight, and completes the report.
fn finish(
    mesh: &Mesh,
    data: CloudData,
    mut report: MeshReport,
    progress: &dyn Progress,
) -> Result<(SplatCloud, MeshReport), SampleError> {
    let oriented = is_oriented(mesh);
    let mut comments = mesh.comments.clone();
    comments.retain(|comment| comment != FLAT_PARTS && comment != FINE_SPLATS);
    let fine = matches!(report.method, MeshMethod::Count(_)) && data.centers.len() >= mesh.triangles.len();
    if report.flat {
        comments.push(FLAT_PARTS.into());
    } else if fine {
        comments.push(FINE_SPLATS.into());
    }
    let data = CloudData { up: mesh.up, comments, oriented, ..data };
    let (mut cloud, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
    progress.stage("interior weight", 1);
    report.splats = cloud.len();
    let mut radii = map_each(cloud.len(), &NoProgress, || (), |(), i| cloud.radius_max(i));
    report.median_radius = crate::radii::median(&mut radii).unwrap_or(0.0);
    report.interior_weight = interior::interior_weight(&cloud);
    if let Some(weight) = report.interior_weight {
        cloud.set_interior_weight(weight);
    }
    progress.advance(1);
    Ok((cloud, report))
}
