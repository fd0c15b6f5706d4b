//! Options and report of the conversion of meshes to splats.

use super::detail::Detail;
use super::geometry::Geometry;
use surfel_model::Mesh;

/// The way in which a mesh becomes splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshMethod {
    /// One ellipse a triangle, through its three vertices (Bézier clipping paper 2012, §5.1).
    PerFace,
    /// The vertices as points: for dense scans.
    PerVertex,
    /// This many samples, spread evenly over the surface.
    Count(usize),
    /// This many samples where they are spread evenly, but closer together, and so more of them, where disks would
    /// stand out of the bent surface by more than a third of a pixel of an image of 1024².
    Adaptive(usize),
    /// As many samples as shape and colours ask for ([`Detail`]).
    Detail,
}

impl MeshMethod {
    /// True of samples that are spread over the surface.
    pub fn is_spread(self) -> bool {
        matches!(self, Self::Count(_) | Self::Adaptive(_) | Self::Detail)
    }
}

/// How a mesh becomes splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshOptions {
    /// The method.
    pub method: MeshMethod,
    /// Multiplies every radius; greater than 0, default 1.
    pub radius_scale: f64,
}

/// Report of a conversion of a mesh to splats.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshReport {
    /// The method used.
    pub method: MeshMethod,
    /// What the number of samples was chosen by, with [`MeshMethod::Detail`].
    pub detail: Option<Detail>,
    /// Splats made.
    pub splats: usize,
    /// Triangles without area, which no splat was made of.
    pub degenerate: usize,
    /// Triangles that repeat others, which no splat was made of.
    pub repeated: usize,
    /// Creases and open edges of the surface, at which splats end, as a number of mesh edges.
    pub feature_edges: usize,
    /// At least nine in ten samples shade by their facet's own normal: the mesh consists of flat parts.
    pub flat: bool,
    /// Median of the larger semi-axes, in object units.
    pub median_radius: f64,
    /// The cloud's interior weight, as stored in it.
    pub interior_weight: Option<f64>,
}

/// Vertices from which a mesh counts as dense.
const DENSE: usize = 50_000;
/// Spacing of automatic samples as a share of the largest side of the bounds: 2 px in an image of 1024², where
/// one standard deviation of a splat is 1.7 px.
const SPACING: f64 = 2.0 / 1024.0;
/// Fewest and most automatic samples.
const AUTOMATIC: (f64, f64) = (20_000.0, 500_000.0);

impl MeshOptions {
    /// Options with a method and the radius scale 1.
    pub fn new(method: MeshMethod) -> Self {
        Self { method, radius_scale: 1.0 }
    }

    /// The options where none are given. A mesh that is dense (above 50,000 vertices), even and without
    /// a texture: its vertices. Any other: samples about 2 px apart in an image of 1024², 20,000 to 500,000 of them,
    /// and more where it bends. One without triangles or area: its vertices.
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
