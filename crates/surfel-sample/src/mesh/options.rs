//! Options and report of the conversion of meshes to splats.

use super::detail::Detail;
use super::geometry::Geometry;
use surfel_model::Mesh;

/// Method by which a mesh is converted to splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshMethod {
    /// One ellipse per triangle, through its three vertices (Bézier clipping paper 2012, §5.1).
    PerFace,
    /// One splat per vertex, as for a point cloud; suitable for dense scans. Vertices at one position with similar
    /// normals share a splat.
    PerVertex,
    /// A given number of samples, spread evenly over the surface.
    Count(usize),
    /// A given number of samples, spread evenly over a flat mesh. Where disks would protrude from a curved surface,
    /// samples are closer together, so that the total is larger. Disks then protrude by at most a third of a pixel in
    /// an image of 1024², if splats a quarter as far apart as on flat parts suffice. If the total would reach a
    /// million, samples stay evenly spread.
    Adaptive(usize),
    /// The number of samples that the mesh's shape and colours need ([`Detail`]).
    Detail,
}

impl MeshMethod {
    /// True for methods that spread samples over the surface.
    pub fn is_spread(self) -> bool {
        matches!(self, Self::Count(_) | Self::Adaptive(_) | Self::Detail)
    }
}

/// Options of the conversion of a mesh to splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshOptions {
    /// Method of the conversion.
    pub method: MeshMethod,
    /// Factor for every radius; greater than 0, default 1.
    pub radius_scale: f64,
}

/// Report of a conversion of a mesh to splats.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshReport {
    /// Method by which the mesh was converted. For [`MeshMethod::Adaptive`] and [`MeshMethod::Detail`], it is
    /// [`MeshMethod::Count`] with the number of samples that was chosen.
    pub method: MeshMethod,
    /// Numbers of splats that shape and colours need; `None` unless the method in the options is
    /// [`MeshMethod::Detail`].
    pub detail: Option<Detail>,
    /// Number of splats made.
    pub splats: usize,
    /// Number of triangles without area; they get no splats.
    pub degenerate: usize,
    /// Number of triangles that repeat another one; they get no splats. 0 for a mesh whose area is too small, relative
    /// to its extent, for many triangles in one place.
    pub repeated: usize,
    /// Number of mesh edges that are creases or open edges, at which splats end; 0 for [`MeshMethod::PerVertex`].
    pub feature_edges: usize,
    /// True if the mesh consists of flat parts: at least nine in ten samples have a smooth normal within 1° of their
    /// own triangle's normal. Always false for [`MeshMethod::PerFace`] and [`MeshMethod::PerVertex`].
    pub flat: bool,
    /// Median of the splats' larger half-axes, in object units.
    pub median_radius: f64,
    /// Interior weight of the cloud ([`CloudData::interior_weight`](surfel_model::CloudData::interior_weight)): the
    /// typical sum of kernel weights Σw inside its surface. `None` if it couldn't be measured.
    pub interior_weight: Option<f64>,
}

/// Number of vertices above which a mesh counts as dense, so that it becomes one splat per vertex by default.
const DENSE: usize = 50_000;
/// Distance between samples with the default options, relative to the largest side of the mesh's bounding box. It is 2
/// px in an image of 1024², in which the standard deviation of a splat is 1.7 px.
const SPACING: f64 = 2.0 / 1024.0;
/// Smallest and largest number of samples of the default options, on a flat mesh.
const AUTOMATIC: (f64, f64) = (20_000.0, 500_000.0);

impl MeshOptions {
    /// Creates options with a method and the radius scale 1.
    pub fn new(method: MeshMethod) -> Self {
        Self { method, radius_scale: 1.0 }
    }

    /// Returns the default options for a mesh. A dense mesh (above 50,000 vertices) without texture becomes one splat
    /// per vertex if triangles with an edge longer than 1/64 of the mesh's extent cover less than 1 % of its area. So
    /// does a mesh without triangles, without a finite area, or with indices of missing vertices. Any other mesh is
    /// sampled about every 2 px in an image of 1024², by 20,000 to 500,000 samples, and more where the surface bends.
    pub fn auto(mesh: &Mesh) -> Self {
        let bad = |i: &u32| *i as usize >= mesh.positions.len();
        if mesh.triangles.is_empty() || mesh.triangles.iter().flatten().any(bad) {
            return Self::new(MeshMethod::PerVertex);
        }
        let geometry = Geometry::new(mesh);
        let (extent, area) = (geometry.extent, geometry.total_area());
        if area <= 0.0 || !area.is_finite() {
            return Self::new(MeshMethod::PerVertex);
        }
        let textured = mesh.is_textured();
        if mesh.positions.len() > DENSE && !textured && geometry.area_of_long_triangles(extent / 64.0) < 0.01 * area {
            return Self::new(MeshMethod::PerVertex);
        }
        let count = (area / (SPACING * extent).powi(2)).clamp(AUTOMATIC.0, AUTOMATIC.1);
        Self::new(MeshMethod::Adaptive(count as usize))
    }
}
