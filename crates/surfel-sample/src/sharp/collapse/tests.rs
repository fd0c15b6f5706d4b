//! Properties that a collapse preserves.

use super::super::conic;
use super::*;
use crate::NoProgress;
use crate::mesh::geometry::Geometry;
use glam::Vec3;
use surfel_model::{Column3, Mesh};

/// Returns a flat disc of radius 1: a vertex in the middle, and `rings` circles of `n` vertices around it.
fn disc(n: u32, rings: u32) -> Mesh {
    let (mut positions, mut triangles) = (vec![Vec3::ZERO], Vec::new());
    for ring in 1..=rings {
        let radius = ring as f32 / rings as f32;
        positions.extend((0..n).map(|i| {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / n as f32).sin_cos();
            Vec3::new(radius * cos, radius * sin, 0.0)
        }));
        let (inner, outer) = (1 + (ring.max(2) - 2) * n, 1 + (ring - 1) * n);
        for (i, j) in (0..n).map(|i| (i, (i + 1) % n)) {
            if ring == 1 {
                triangles.push([0, outer + i, outer + j]);
            } else {
                triangles.extend([[inner + i, outer + i, outer + j], [inner + i, outer + j, inner + j]]);
            }
        }
    }
    Mesh { positions: Column3::from_f32(positions), triangles, ..Mesh::default() }
}

#[test]
fn collapse_leaves_each_triangle_one_curved_ridge_that_its_splat_reaches() {
    let mesh = disc(64, 6);
    let mut surface = Surface::new(&Geometry::new(&mesh), 0.766);
    let limits = Limits { faces: 6, error: f64::INFINITY, straight: 1e-4, crease_cos: 0.766 };
    collapse(&mut surface, limits, &|_| 0.0, &NoProgress);
    // Ears would have two pieces of the border.
    assert!(surface.faces.len() < 40, "{}", surface.faces.len());
    let mut border = 0;
    for face in &surface.faces {
        let corners = surface.corners(*face);
        assert!(normal_of(corners).z > 0.999);
        let mut curved = 0;
        for k in 0..3 {
            let Some(piece) = surface.pieces.get(&edge(face[k], face[(k + 1) % 3])) else { continue };
            border += (piece.to - piece.from) as usize;
            let chord = (corners[(k + 1) % 3] - corners[k]).normalize();
            let off = |p: DVec3| (p - corners[k]).reject_from_normalized(chord).length();
            let bulge = surface.line(piece).into_iter().map(off).fold(0.0, f64::max);
            curved += usize::from(bulge > 1e-4);
            // The ellipse reaches a third of the height beyond an edge.
            assert!(bulge < off(corners[(k + 2) % 3]) / 3.0, "{bulge}");
        }
        assert!(curved <= 1);
    }
    // The border is complete.
    assert_eq!(border, 64);
}

/// Returns [`disc`] as a lid on a wall that is `height` high; the whole border of the disc is a crease.
fn lidded(n: u32, rings: u32, height: f32) -> Mesh {
    let mut mesh = disc(n, rings);
    let mut positions = mesh.positions.high().to_vec();
    let levels = 6;
    for _ in 0..levels {
        let (above, below) = ((positions.len() as u32) - n, positions.len() as u32);
        let rim: Vec<Vec3> = positions[positions.len() - n as usize..].to_vec();
        positions.extend(rim.iter().map(|p| *p - Vec3::Z * (height / levels as f32)));
        for (i, j) in (0..n).map(|i| (i, (i + 1) % n)) {
            mesh.triangles.extend([[above + i, below + i, below + j], [above + i, below + j, above + j]]);
        }
    }
    Mesh { positions: Column3::from_f32(positions), ..mesh }
}

#[test]
fn collapse_keeps_a_crease_between_two_faces() {
    let n = 64;
    // A wall below the lid makes a convex crease, a wall above it a concave one.
    for height in [1.0, -1.0] {
        let mesh = lidded(n, 6, height);
        let mut surface = Surface::new(&Geometry::new(&mesh), 0.766);
        let before = surface.faces.len();
        let limits = Limits { faces: 60, error: f64::INFINITY, straight: 1e-4, crease_cos: 0.766 };
        collapse(&mut surface, limits, &|_| 0.0, &NoProgress);
        assert!(surface.faces.len() < before / 8, "{} of {before}", surface.faces.len());
        let is_lid = |face: &[u32; 3]| normal_of(surface.corners(*face)).z > 0.999;
        let mut kept = 0;
        for face in &surface.faces {
            // The lid stays plane, and no wall becomes part of it.
            let normal = normal_of(surface.corners(*face));
            assert!(normal.z > 0.999 || normal.z.abs() < 0.5, "{normal}");
            for k in 0..3 {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                let beyond: Vec<_> =
                    surface.faces.iter().filter(|f| *f != face && f.contains(&a) && f.contains(&b)).collect();
                let is_crease = beyond.iter().any(|f| is_lid(f) != is_lid(face));
                let piece = surface.pieces.get(&edge(a, b));
                // Creases are exactly at the pieces; other pieces are the wall's border.
                assert_eq!(is_crease, piece.is_some() && beyond.len() == 1, "{height}: {face:?} {k}");
                let Some(piece) = piece.filter(|_| is_crease) else { continue };
                kept += piece.to - piece.from;
                // The polygon of n sides is up to 1 − cos(π/n) = 1.2e-3 inside the circle, and the curve deviates as
                // much. The search for the curve leaves the plane by a hundredth of that.
                for p in conic::fit(&surface.line(piece)).conic.even_points(33) {
                    assert!((p.truncate().length() - 1.0).abs() < 2.4e-3 && p.z.abs() < 1.2e-5, "{height}: {p}");
                }
            }
        }
        // All of the crease, from either side.
        assert_eq!(kept, 2 * n, "{height}");
    }
}
