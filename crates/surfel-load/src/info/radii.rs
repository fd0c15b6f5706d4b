//! Estimates of the radii that splats of a file would have in an image, from a sample of the file.

use surfel_model::{Column3, Mesh, PointCloud, SplatCloud};
use surfel_sample::{MeshMethod, MeshOptions, NoProgress, PointOptions};

/// Largest number of points at which the radii of all points are estimated. For larger clouds, patches are sampled.
pub(crate) const ALL: usize = 12_000;

/// Number of patches (points with their neighbours) from which the radii of larger clouds are estimated.
pub(crate) const PATCHES: usize = 16;

/// Number of points nearest to a patch's centre that are converted to splats, and number of the nearest of these whose
/// radii are used. Points farther out lack neighbours, which biases their radii.
pub(crate) const PATCH: (usize, usize) = (600, 200);

/// Statistics of splat radii, in object units.
pub(crate) struct Radii {
    pub(crate) median: f64,
    pub(crate) min: f64,
    pub(crate) max: f64,
    /// Description, for the user, of how the radii were estimated, or "given" for radii from the file.
    pub(crate) how: &'static str,
}

impl Radii {
    pub(crate) fn of(mut radii: Vec<f64>, how: &'static str) -> Option<Self> {
        radii.sort_unstable_by(f64::total_cmp);
        let (min, max) = (*radii.first()?, *radii.last()?);
        Some(Self { median: *radii.get(radii.len() / 2)?, min, max, how })
    }
}

/// Returns the memory that the columns of a point cloud take, in bytes.
pub(crate) fn bytes_of_points(p: &PointCloud) -> usize {
    p.positions.bytes()
        + p.normals.as_ref().map_or(0, Column3::bytes)
        + p.colors.as_ref().map_or(0, |c| size_of_val(c.as_slice()))
        + p.alphas.as_ref().map_or(0, |c| size_of_val(c.as_slice()))
        + p.extras.iter().map(|e| e.values.bytes()).sum::<usize>()
}

fn radii_of(cloud: &SplatCloud, count: usize) -> impl Iterator<Item = f64> {
    (0..count.min(cloud.len())).map(|i| cloud.radius_max(i))
}

/// Estimates the radii of the first `count` points, with all of `points` as neighbours. The flag is true if the radii
/// come from the file. Returns no radii if no splats can be made.
fn radii_among(points: &PointCloud, count: usize) -> (Vec<f64>, bool) {
    let made = surfel_sample::splats_from_points(points, &PointOptions::default(), &NoProgress);
    made.map(|(cloud, report)| (radii_of(&cloud, count).collect(), report.radii_given > 0)).unwrap_or_default()
}

/// Estimates the radii of the points nearest to a patch's centre. `near` has the patch's points, nearest first.
pub(crate) fn radii_of_patch(near: &PointCloud) -> Vec<f64> {
    radii_among(near, PATCH.1).0
}

/// Estimates the radii that splats of the points would have in an image. Large clouds are sampled in patches. Returns
/// `None` if there are no radii.
pub(crate) fn radii_of_points(points: &PointCloud) -> Option<Radii> {
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

/// Estimates the radii that splats of a mesh would have in an image; `None` if there are no splats. If splats are
/// spread over the surface, a smaller number of them is generated, and their radii are scaled.
pub(crate) fn radii_of_mesh(mesh: &Mesh) -> Option<Radii> {
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
