//! Tests for watertight and consistently wound meshes, and the comments that record the results.

use glam::{DVec3, Vec3};
use std::collections::HashMap;
use surfel_model::Mesh;

/// Comment stored with a cloud that covers a watertight mesh from outside: no splat is visible from behind.
pub const CLOSED_MESH: &str = "covers a closed mesh";

/// Comment stored with a cloud whose back-facing splats are always drawn, without a test whether the cloud is
/// watertight.
pub const BOTH_SIDES: &str = "shows both sides";

/// Comment stored with a cloud whose splats are almost coplanar where they overlap. Its mesh consists of flat parts, or
/// the conversion of feature `sharp` clipped the splats.
pub const FLAT_PARTS: &str = "made of flat parts";

/// Comment stored with a cloud sampled from a curved mesh, with at least as many splats as triangles. Overlapping
/// splats of such a cloud are apart by only a small fraction of their radii.
pub const FINE_SPLATS: &str = "as fine as their mesh";

/// Largest fraction of wrongly wound edges at which a mesh counts as consistently wound. Two triangles run through such
/// an edge in the same direction; scans and exports have a few.
const MISWOUND: f64 = 0.01;

/// True if the mesh is watertight: it bounds a volume, and no back of a triangle is visible from outside. As many
/// triangles run along every edge in one direction as in the other, the enclosed volume is positive, and nothing is
/// transparent. Vertices at the same position count as one (texture seams split them); triangles with two corners at
/// one position are ignored. False for a mesh that is invalid or has no triangles.
pub fn is_closed(mesh: &Mesh) -> bool {
    let walk = EdgeBalance::new(mesh);
    !mesh.is_see_through() && walk.volume > 0.0 && walk.edges.values().all(|&sum| sum == 0)
}

/// True if the mesh's triangles are wound consistently, so that their normals all point to the same side of the
/// surface, open or watertight. At most one edge in a hundred may be an exception. Vertices at the same position count
/// as one. False for a mesh that is invalid or has no triangles.
pub fn is_oriented(mesh: &Mesh) -> bool {
    let walk = EdgeBalance::new(mesh);
    let miswound = walk.edges.values().filter(|sum| sum.abs() > 1).count();
    !walk.edges.is_empty() && miswound as f64 <= MISWOUND * walk.edges.len() as f64
}

/// Largest openness at which a surface counts as enclosing a volume. Openness is the length of the sum of all
/// triangles' area vectors (area times normal), relative to the total area; it is 0 for a watertight surface.
const OPEN: f64 = 0.05;
/// Smallest enclosed volume of a surface that [`turn_outward`] may reverse, relative to the volume of a sphere with the
/// same area.
const ROUND: f64 = 0.01;

/// Reverses the winding of a mesh that is inside out, as some exporters write it. Such a mesh is wound consistently,
/// has almost no openings, and bounds a negative volume. The mesh's stored normals are all negated too if, on the
/// whole, they agree with the old winding. Returns true if the mesh was reversed.
pub fn turn_outward(mesh: &mut Mesh) -> bool {
    if mesh.triangles.is_empty() || mesh.validate().is_err() {
        return false;
    }
    let corners = |t: &[u32; 3]| t.map(|i| mesh.positions.get(i as usize));
    let count = 3.0 * mesh.triangles.len() as f64;
    let center = mesh.triangles.iter().flat_map(corners).map(|p| p / count).sum::<DVec3>();
    // Twice the areas, and six times the volume.
    let (mut whole, mut area, mut volume, mut agreement) = (DVec3::ZERO, 0.0, 0.0, 0.0);
    for triangle in &mesh.triangles {
        let [p, q, r] = corners(triangle).map(|p| p - center);
        let normal = (q - p).cross(r - p);
        whole += normal;
        area += normal.length();
        volume += p.dot(q.cross(r));
        if let Some(normals) = &mesh.normals {
            agreement += triangle.iter().map(|i| Vec3::from(normals[*i as usize]).as_dvec3().dot(normal)).sum::<f64>();
        }
    }
    // For a sphere, 36π V² = A³, so the volume grows with A^1.5.
    let least = ROUND * (0.5 * area).powf(1.5) / (6.0 * std::f64::consts::PI.sqrt());
    let is_closed = whole.length() <= OPEN * area;
    let is_negative = volume / 6.0 < -least;
    // The test of all edges costs most, so it comes last.
    if !(is_closed && is_negative && is_oriented(mesh)) {
        return false;
    }
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    if agreement > 0.0
        && let Some(normals) = &mut mesh.normals
    {
        normals.as_flattened_mut().iter_mut().for_each(|c| *c = -*c);
    }
    true
}

/// Sums over the edges and triangles of a mesh, which show whether it is watertight and consistently wound.
#[derive(Default)]
struct EdgeBalance {
    /// Balance of each edge, by its two vertices: +1 per triangle that runs along it one way, −1 for the other way. All
    /// sums are 0 on a watertight, consistently wound surface.
    edges: HashMap<(u32, u32), i32>,
    /// Six times the volume that the triangles enclose; negative if the surface is inside out.
    volume: f64,
}

impl EdgeBalance {
    /// Traverses the triangles of a mesh; an invalid mesh counts as empty.
    fn new(mesh: &Mesh) -> Self {
        let mut walk = Self::default();
        if mesh.triangles.is_empty() || mesh.validate().is_err() {
            return walk;
        }
        let mut first_at = HashMap::with_capacity(mesh.positions.len());
        let welded: Vec<u32> = (0..mesh.positions.len())
            .map(|i| {
                // Adding zero makes −0 and 0 the same position.
                let key = (mesh.positions.get(i) + 0.0).to_array().map(f64::to_bits);
                *first_at.entry(key).or_insert(i as u32)
            })
            .collect();
        walk.edges.reserve(mesh.triangles.len() * 3 / 2);
        let center = mesh.positions.get(0);
        for corners in &mesh.triangles {
            let [a, b, c] = corners.map(|i| welded[i as usize]);
            if a == b || b == c || c == a {
                continue;
            }
            for (from, to) in [(a, b), (b, c), (c, a)] {
                let (key, way) = if from < to { ((from, to), 1) } else { ((to, from), -1) };
                *walk.edges.entry(key).or_default() += way;
            }
            let [p, q, r] = [a, b, c].map(|i| mesh.positions.get(i as usize) - center);
            walk.volume += p.dot(q.cross(r));
        }
        walk
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
    fn what_can_be_seen_through_is_not_closed() {
        let glass = Mesh { alphas: Some(vec![1.0, 1.0, 0.5, 1.0]), ..tetrahedron() };
        assert!(!is_closed(&glass) && is_closed(&Mesh { alphas: Some(vec![1.0; 4]), ..tetrahedron() }));
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

    #[test]
    fn a_mesh_is_oriented_if_it_is_wound_alike_open_or_not() {
        let mut mesh = tetrahedron();
        assert!(is_oriented(&mesh));
        mesh.triangles.pop();
        assert!(is_oriented(&mesh));
        mesh.triangles[1].swap(0, 1);
        assert!(!is_oriented(&mesh));
        assert!(!is_oriented(&Mesh::default()));
    }

    #[test]
    fn what_is_wound_inside_out_is_turned_around_once() {
        let mut mesh = tetrahedron();
        assert!(!turn_outward(&mut mesh) && mesh == tetrahedron());
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        let outward = vec![[-1.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for (scale, offset) in [(1.0, 0.0), (1e-15, 0.0), (1e12, 0.0), (1.0, 1e7)] {
            let place = |i| tetrahedron().positions.get(i) * scale + offset;
            let positions = Column3::from_f64(&(0..4).map(place).collect::<Vec<_>>());
            let mut other = Mesh { positions: positions.clone(), normals: Some(outward.clone()), ..mesh.clone() };
            assert!(turn_outward(&mut other), "{scale} {offset}");
            let wound = Mesh { positions, triangles: tetrahedron().triangles, ..Mesh::default() };
            assert!(is_closed(&Mesh { triangles: other.triangles.clone(), ..wound }));
            // Normals that already point outward are preserved; those that agree with the winding are negated too.
            assert!(other.normals.as_ref() == Some(&outward));
            assert!(!turn_outward(&mut other));
        }
        let inward = outward.iter().map(|n| n.map(|c: f32| -c)).collect();
        let mut other = Mesh { normals: Some(inward), ..mesh };
        assert!(turn_outward(&mut other));
        assert_eq!(other.normals, Some(outward));
    }

    #[test]
    fn open_and_flat_surfaces_are_never_turned_around() {
        let mut bowl = tetrahedron();
        bowl.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        bowl.triangles.pop();
        assert!(!turn_outward(&mut bowl));
        // A sheet and its copy, wound alike, enclose nothing.
        let positions = Column3::from_f32(vec![Vec3::ZERO, Vec3::X, Vec3::Y]);
        let mut sheet = Mesh { positions, triangles: vec![[0, 2, 1], [0, 1, 2]], ..Mesh::default() };
        assert!(!turn_outward(&mut sheet) && !turn_outward(&mut Mesh::default()));
    }
}
