//! Conversion of half-axes, radii, normals, colours and centres from f64 to the columns of a cloud.

use glam::{DVec3, Vec3};
use surfel_model::{Column3, Mesh, Shape};

/// Builds the shape of elliptical splats from their half-axes (s, t), rounded to f32.
pub(crate) fn ellipses(axes: &[(DVec3, DVec3)]) -> Shape {
    Shape::Ellipses {
        s: Column3::from_f32(axes.iter().map(|a| a.0.as_vec3()).collect()),
        t: Column3::from_f32(axes.iter().map(|a| a.1.as_vec3()).collect()),
    }
}

/// Converts a radius to f32, clamped to the positive finite values that the model accepts.
pub(crate) fn radius32(radius: f64) -> f32 {
    (radius as f32).clamp(f32::MIN_POSITIVE, f32::MAX)
}

/// Converts normals to a column of f32 vectors.
pub(crate) fn normals32(normals: &[DVec3]) -> Column3 {
    Column3::from_f32(normals.iter().map(|n| n.as_vec3()).collect::<Vec<Vec3>>())
}

/// Linear RGB column and alpha column of a cloud; an absent column means white or opaque.
pub(crate) type Paint = (Option<Vec<[f32; 3]>>, Option<Vec<f32>>);

/// Smallest alpha that counts as opaque. It is below 1, because interpolation weights don't sum to exactly one, and
/// compressed textures are off by a level or two. Splats with a smaller alpha need a transparent pass.
pub(crate) const OPAQUE_ALPHA: f32 = 0.99;

/// Splits a column of RGBA values into a colour column and an alpha column. The alpha column is `None` if all splats
/// are opaque; both are `None` without input.
pub(crate) fn paint(rgba: Option<Vec<[f32; 4]>>) -> Paint {
    let Some(rgba) = rgba else { return (None, None) };
    let alpha = |c: &[f32; 4]| if c[3] >= OPAQUE_ALPHA { 1.0 } else { c[3].max(0.0) };
    let alphas = rgba.iter().any(|c| alpha(c) < 1.0).then(|| rgba.iter().map(alpha).collect());
    (Some(rgba.iter().map(|c| [c[0], c[1], c[2]]).collect()), alphas)
}

/// Converts centres to a column of the same precision as the mesh's positions: about 48 bits if these have a low part,
/// else f32.
pub(crate) fn centers(mesh: &Mesh, centers: &[DVec3]) -> Column3 {
    if mesh.positions.low().is_some() {
        Column3::from_f64(centers)
    } else {
        Column3::from_f32(centers.iter().map(|p| p.as_vec3()).collect())
    }
}
