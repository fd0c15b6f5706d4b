//! How many splats a mesh asks for: by how its surface bends, and by how its colours vary.

use super::count::stratified;
use super::geometry::Geometry;
use crate::parallel::map_each;
use crate::progress::NoProgress;
use crate::radii;
use surfel_math::basis::orthonormal;

/// Largest distance of a splat's rim from the surface, as a share of the extent: half a pixel of 1024.
const RIM: f64 = 0.5 / 1024.0;
/// Root mean square, in linear light and over the surface, of what colours vary by within the square that a splat
/// stands for.
const VARIATION: f64 = 0.03;
/// Fewest and most splats.
const SPLATS: (f64, f64) = (5_000.0, 2_000_000.0);
/// Places that colours are looked at.
const PLACES: usize = 2048;
/// Samples along each side of a square.
const ACROSS: i32 = 5;

/// Splats that a mesh asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detail {
    /// By its shape: so many that disks stand out of the curved surface by half a pixel of an image of 1024².
    pub shape: usize,
    /// By its colours: so many that these vary by .03 (RMS, linear light) within what a splat stands for, but no more
    /// than there are texels; 0 where nothing varies.
    pub colors: usize,
}

impl Detail {
    /// The larger one, within 5,000 and 2,000,000.
    pub fn splats(self) -> usize {
        (self.shape.max(self.colors) as f64).clamp(SPLATS.0, SPLATS.1) as usize
    }

    pub(crate) fn new(geometry: &Geometry) -> Self {
        let area = geometry.total_area();
        let splats = |spacing: f64| (area / (spacing * spacing)).min(SPLATS.1);
        // A rim at radius r of a surface of curvature κ is r²κ/2 away from it.
        let radius = (2.0 * RIM * geometry.extent / curvature(geometry)).sqrt();
        let shape = splats(radius / radii::DENSITY) as usize;
        let colors = if geometry.is_painted() { colors(geometry, area) } else { 0 };
        Self { shape, colors }
    }
}

/// Root mean square over the surface of how fast its normal turns, radians a unit of length; creases don't count.
fn curvature(geometry: &Geometry) -> f64 {
    let normals = geometry.smooth().corner_normals;
    let squared = |face: usize| {
        let (p, n) = (geometry.corners(face), &normals[face]);
        let edge = |i: usize, j: usize| n[i].distance_squared(n[j]) / p[i].distance_squared(p[j]);
        geometry.areas[face] * (edge(0, 1) + edge(1, 2) + edge(2, 0)) / 3.0
    };
    let sum: f64 = (0..geometry.areas.len()).filter(|face| geometry.areas[*face] > 0.0).map(squared).sum();
    (sum / geometry.total_area()).sqrt()
}

/// Splats whose squares vary by [`VARIATION`].
fn colors(geometry: &Geometry, area: f64) -> usize {
    let places = stratified(&geometry.areas, PLACES, area, &NoProgress);
    let is_too_coarse = |splats: f64| {
        let side = (area / splats).sqrt();
        let each = map_each(places.len(), &NoProgress, || (), |(), i| variance(geometry, places[i], side));
        each.iter().sum::<f64>() / each.len() as f64 > VARIATION * VARIATION
    };
    let most = texels(geometry).clamp(SPLATS.0, SPLATS.1);
    if !is_too_coarse(SPLATS.0) {
        return 0;
    }
    let mut range = [SPLATS.0.ln(), most.ln()];
    for _ in 0..7 {
        let middle = 0.5 * (range[0] + range[1]);
        range[usize::from(!is_too_coarse(middle.exp()))] = middle;
    }
    range[1].exp() as usize
}

/// Texels that the surface shows; without textures as many as there may be splats.
fn texels(geometry: &Geometry) -> f64 {
    let mesh = geometry.mesh;
    if !mesh.is_textured() {
        return SPLATS.1;
    }
    (0..mesh.triangles.len()).map(|face| geometry.texels(face)).sum()
}

/// Variance of the colours in a square about a place, the mean of the channels.
fn variance(geometry: &Geometry, (face, b): (u32, [f64; 3]), side: f64) -> f64 {
    let face = face as usize;
    let (s, t) = orthonormal(geometry.normals[face]);
    let (Some(u), Some(v)) = (geometry.barycentric_change(face, s), geometry.barycentric_change(face, t)) else {
        return 0.0;
    };
    let (mut sum, mut squares, mut count) = ([0.0; 3], [0.0; 3], 0.0);
    for (i, j) in (0..ACROSS).flat_map(|j| (0..ACROSS).map(move |i| (i, j))) {
        let offset = |i: i32| (f64::from(i) + 0.5) / f64::from(ACROSS) - 0.5;
        let at: [f64; 3] = std::array::from_fn(|k| b[k] + (offset(i) * u[k] + offset(j) * v[k]) * side);
        // Beyond an edge another triangle has the surface, and perhaps another part of the texture.
        if at.iter().all(|b| *b >= 0.0) {
            let color = geometry.color(face, at);
            count += 1.0;
            for c in 0..3 {
                let value = f64::from(color[c]);
                sum[c] += value;
                squares[c] += value * value;
            }
        }
    }
    let of = |c: usize| (squares[c] / count - (sum[c] / count).powi(2)).max(0.0);
    if count > 1.0 { (of(0) + of(1) + of(2)) / 3.0 } else { 0.0 }
}
