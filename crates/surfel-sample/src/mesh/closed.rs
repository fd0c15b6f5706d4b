//! Whether a mesh has an inside.

use std::collections::HashMap;
use surfel_model::Mesh;

/// True if the mesh bounds a volume: every edge has one triangle on either side, wound the same way, and the volume inside
/// is positive, so that no back of a triangle is ever seen from outside. Vertices at the same position count as
/// one (texture seams split them); triangles without area are ignored.
pub fn is_closed(mesh: &Mesh) -> bool {
    if mesh.triangles.is_empty() || mesh.validate().is_err() {
        return false;
    }
    let mut first_at = HashMap::with_capacity(mesh.positions.len());
    let welded: Vec<u32> = (0..mesh.positions.len())
        .map(|i| {
            // Adding zero makes −0 and 0 the same position.
            let key = (mesh.positions.get(i) + 0.0).to_array().map(f64::to_bits);
            *first_at.entry(key).or_insert(i as u32)
        })
        .collect();
    // +1 for an edge walked one way, −1 for the other: all cancel on a closed, consistently wound surface.
    let mut edges: HashMap<(u32, u32), i32> = HashMap::with_capacity(mesh.triangles.len() * 3 / 2);
    let mut volume = 0.0;
    let center = mesh.positions.get(0);
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|i| welded[i as usize]);
        if a == b || b == c || c == a {
            continue;
        }
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let (key, way) = if from < to { ((from, to), 1) } else { ((to, from), -1) };
            *edges.entry(key).or_default() += way;
        }
        let [p, q, r] = [a, b, c].map(|i| mesh.positions.get(i as usize) - center);
        volume += p.dot(q.cross(r));
    }
    volume > 0.0 && edges.values().all(|&sum| sum == 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use surfel_model::Column3;

    fn tetrahedron() -> Mesh {
        Mesh {
            positions: Column3::from_f32(vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z]),
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
            ..Mesh::default()
        }
    }

    #[test]
    fn a_tetrahedron_is_closed_also_with_split_vertices() {
        let mut mesh = tetrahedron();
        assert!(is_closed(&mesh));
        mesh.positions = Column3::from_f32(vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z, -Vec3::ZERO]);
        mesh.triangles[0] = [4, 2, 1];
        assert!(is_closed(&mesh));
    }

    #[test]
    fn an_open_an_inside_out_and_an_inconsistent_mesh_are_not() {
        let mut open = tetrahedron();
        open.triangles.pop();
        assert!(!is_closed(&open));
        let mut inside_out = tetrahedron();
        inside_out.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        assert!(!is_closed(&inside_out));
        let mut inconsistent = tetrahedron();
        inconsistent.triangles[1].swap(0, 1);
        assert!(!is_closed(&inconsistent));
        assert!(!is_closed(&Mesh::default()));
    }
}
