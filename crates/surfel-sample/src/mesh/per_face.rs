//! Conversion of a mesh to one ellipse per triangle (Bézier clipping paper 2012, §5.1).

use super::borders::{Borders, clip_columns};
use super::density::Density;
use super::geometry::{Border, Geometry, Kind, Smooth};
use super::options::MeshReport;
use super::see_through;
use crate::parallel::map_each;
use crate::{Progress, SampleError, assemble};
use glam::DVec3;
use surfel_math::basis::unit;
use surfel_model::{CloudData, Column3, Mesh};

const CENTROID: [f64; 3] = [1.0 / 3.0; 3];

/// Returns the principal half-axes (s, t) of the ellipse through a triangle's corners and around its centroid (the
/// Steiner circumellipse). It is the image of an equilateral triangle's circumscribed circle under the affine map
/// between the two triangles. s × t is along the normal of the counter-clockwise triangle, and s is the longer axis.
///
/// Two conjugate half-axes are corner 0 relative to the centroid, and the opposite edge over √3. One rotation makes
/// them orthogonal. The paper computes the same axes by a scale and a shear in the triangle's plane (eq. 13–16), or
/// from the eigenvectors of a covariance matrix. Here no matrix is squared.
pub(crate) fn steiner_axes([a, b, c]: [DVec3; 3]) -> (DVec3, DVec3) {
    let f = ((a - b) + (a - c)) / 3.0;
    let g = (b - c) / 3.0_f64.sqrt();
    let angle = 0.5 * (2.0 * f.dot(g)).atan2(f.length_squared() - g.length_squared());
    let (sin, cos) = angle.sin_cos();
    (cos * f + sin * g, cos * g - sin * f)
}

pub(crate) fn splats(
    mesh: &Mesh,
    radius_scale: f64,
    report: &mut MeshReport,
    progress: &dyn Progress,
) -> Result<CloudData, SampleError> {
    let geometry = Geometry::new(mesh);
    (report.degenerate, report.repeated) = (geometry.degenerate(), geometry.repeated);
    let faces: Vec<usize> = (0..geometry.areas.len()).filter(|f| geometry.areas[*f] > 0.0).collect();
    if faces.is_empty() {
        return Err(SampleError::NoArea { triangles: mesh.triangles.len() });
    }
    progress.stage("faces", faces.len() as u64);
    let made = map_each(
        faces.len(),
        progress,
        || (),
        |(), i| {
            let corners = geometry.corners(faces[i]);
            let (s, t) = steiner_axes(corners);
            let [a, b, c] = corners;
            // Relative to a corner, so that nothing is lost far from the origin.
            (a + ((b - a) + (c - a)) / 3.0, (s * radius_scale, t * radius_scale))
        },
    );
    let (centers, axes): (Vec<DVec3>, Vec<_>) = made.into_iter().unzip();
    let mut data = CloudData::new(mesh.origin, assemble::centers(mesh, &centers), assemble::ellipses(&axes));
    let Smooth { borders, regions, feature_edges, .. } = geometry.smooth();
    report.feature_edges = feature_edges;
    // Where the surface is smooth, ellipses overlap their triangles and blend.
    let borders: Vec<Border> = borders.into_iter().filter(|border| border.kind != Kind::Bend).collect();
    let spacing = (geometry.total_area() / faces.len() as f64).sqrt();
    let borders = Borders::new(&geometry, &borders, &regions, (&Density::even(&geometry, spacing), 1.0), faces.len());
    let kept = map_each(faces.len(), &crate::NoProgress, Borders::nearest, |found, i| {
        borders.keep(centers[i], axes[i], regions[faces[i]], found)
    });
    data.clips = clip_columns(kept.iter().map(Option::as_ref));
    if let Some(normals) = &mesh.normals {
        let at = |face: &usize| {
            let sum: DVec3 =
                mesh.triangles[*face].iter().map(|i| unit(DVec3::from(normals[*i as usize].map(f64::from)))).sum();
            // If a normal is missing, or three normals cancel, the face's own is used.
            if sum.is_finite() && sum.length() > 1e-6 { unit(sum).as_vec3() } else { geometry.normals[*face].as_vec3() }
        };
        data.shading_normals = Some(Column3::from_f32(faces.iter().map(at).collect()));
    }
    let rgba = geometry.is_painted().then(|| faces.iter().map(|f| geometry.color(*f, CENTROID)).collect());
    (data.colors, data.alphas) = assemble::paint(rgba);
    Ok(see_through::cut(&geometry, data, faces.iter().map(|f| *f as u32).collect()).0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::random::Random;

    #[test]
    fn repeated_triangles_are_counted() {
        let mesh = Mesh {
            positions: Column3::from_f32(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y]),
            triangles: vec![[0, 1, 2]; 20],
            ..Mesh::default()
        };
        let options = crate::MeshOptions { method: crate::MeshMethod::PerFace, radius_scale: 1.0 };
        let (cloud, report) = crate::splats_from_mesh(&mesh, &options, &crate::NoProgress).unwrap();
        assert_eq!((cloud.len(), report.repeated, report.degenerate), (1, 19, 0));
    }

    #[test]
    fn steiner_ellipse_of_a_right_triangle_exact() {
        // The Steiner circumellipse of (0,0) (1,0) (0,1): x² + xy + y² − x − y = 0. About its centroid the form is
        // [1 ½; ½ 1] = 1/3, so the half-axes are √(1/3 / ½) along (1, −1) and √(1/3 / 3/2) along (1, 1).
        let (s, t) = steiner_axes([DVec3::ZERO, DVec3::X, DVec3::Y]);
        assert!((s.length() - (2.0_f64 / 3.0).sqrt()).abs() < 1e-15, "{s}");
        assert!((t.length() - (2.0_f64 / 9.0).sqrt()).abs() < 1e-15, "{t}");
        assert!((s.x + s.y).abs() < 1e-15 && (t.x - t.y).abs() < 1e-15);
        assert!(s.cross(t).z > 0.0);
    }

    #[test]
    fn steiner_ellipse_passes_through_the_corners_with_orthogonal_axes() {
        let mut random = Random::new(1);
        let mut point = || DVec3::new(random.unit(), random.unit(), random.unit()) * 1e-20;
        for _ in 0..1000 {
            let corners = [point(), point(), point()];
            let (s, t) = steiner_axes(corners);
            let centroid = (corners[0] + corners[1] + corners[2]) / 3.0;
            assert!(s.dot(t).abs() <= 1e-14 * s.length_squared());
            assert!(s.length() >= t.length());
            for c in corners {
                let d = c - centroid;
                let rho2 = (d.dot(s) / s.length_squared()).powi(2) + (d.dot(t) / t.length_squared()).powi(2);
                // Roundings of 1e-16 against the short axis of the thinnest of the thousand triangles.
                assert!((rho2 - 1.0).abs() < 1e-9, "{rho2}");
            }
            let outward = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            assert!(s.cross(t).dot(outward) > 0.0);
        }
    }
}
