//! The model Spot, cut into two meshes for images with half splats and half polygons.

use std::io;
use std::path::Path;

/// Path of the model, relative to the workspace.
pub(super) const MODEL: &str = "assets/spot/spot.obj";
/// Names of the model's other files, in the same folder: materials and texture.
pub(super) const MATERIALS: [&str; 2] = ["spot.mtl", "spot_texture.png"];

/// Returns two OBJ files: the faces whose centroids have negative x, and all other faces. Both contain all vertices of
/// the model.
pub(super) fn halves(root: &Path) -> io::Result<[Vec<u8>; 2]> {
    let text = std::fs::read_to_string(root.join(MODEL))?;
    Ok(cut(&text))
}

fn cut(text: &str) -> [Vec<u8>; 2] {
    let model = Model::read(text);
    let normals = model.normals();
    let mut halves = [Vec::new(), Vec::new()];
    for line in text.lines() {
        if line.split_ascii_whitespace().next() != Some("f") {
            halves.iter_mut().for_each(|half| put(half, line));
        }
    }
    for [x, y, z] in normals {
        halves.iter_mut().for_each(|half| put(half, &format!("vn {x:.6} {y:.6} {z:.6}")));
    }
    for face in &model.faces {
        let sum: f64 = face.iter().map(|[vertex, _]| model.positions[*vertex][0]).sum();
        let corners: Vec<String> =
            face.iter().map(|[vertex, texture]| format!("{0}/{texture}/{0}", vertex + 1)).collect();
        put(&mut halves[usize::from(sum >= 0.0)], &format!("f {}", corners.join(" ")));
    }
    halves
}

fn put(half: &mut Vec<u8>, line: &str) {
    half.extend_from_slice(line.as_bytes());
    half.push(b'\n');
}

pub(super) struct Model {
    pub(super) positions: Vec<[f64; 3]>,
    /// Corners of each face: index of the vertex, from 0, and number of the texture coordinates, from 1 as in the file.
    pub(super) faces: Vec<Vec<[usize; 2]>>,
}

impl Model {
    /// Parses an OBJ file in which every corner has the form `1/2` and vertices precede faces.
    pub(super) fn read(text: &str) -> Self {
        let (mut positions, mut faces) = (Vec::new(), Vec::new());
        for line in text.lines() {
            let mut words = line.split_ascii_whitespace();
            match words.next() {
                Some("v") => {
                    let mut next = || words.next().and_then(|w| w.parse().ok()).unwrap_or(0.0);
                    positions.push([next(), next(), next()]);
                }
                Some("f") => {
                    let corner = |word: &str| {
                        let (vertex, texture) = word.split_once('/')?;
                        let vertex = vertex.parse::<usize>().ok()?.checked_sub(1).filter(|&i| i < positions.len())?;
                        Some([vertex, texture.parse().ok()?])
                    };
                    faces.push(words.filter_map(corner).collect());
                }
                _ => {}
            }
        }
        Self { positions, faces }
    }

    /// Returns the unit normals of the vertices, which are means of the adjacent faces' normals, weighted by area. They
    /// are equal on both sides of the cut.
    fn normals(&self) -> Vec<[f64; 3]> {
        let mut normals = vec![[0.0; 3]; self.positions.len()];
        for face in self.faces.iter().filter(|face| face.len() >= 3) {
            let [a, b, c] = [0, 1, 2].map(|i| self.positions[face[i][0]]);
            let (u, v) = ([0, 1, 2].map(|i| b[i] - a[i]), [0, 1, 2].map(|i| c[i] - a[i]));
            let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            for [vertex, _] in face {
                normals[*vertex].iter_mut().zip(cross).for_each(|(n, c)| *n += c);
            }
        }
        for n in &mut normals {
            let length = n.iter().map(|c| c * c).sum::<f64>().sqrt();
            *n = if length > 0.0 { n.map(|c| c / length) } else { [0.0, 0.0, 1.0] };
        }
        normals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_share_vertices_and_normals_and_divide_the_faces() {
        let text = "mtllib a.mtl\nv -1 0 0\nv 1 0 0\nv -1 1 0\nv 1 1 0\nf 1/1 2/2 3/3\nf 2/2 4/4 3/3\n";
        let [negative, positive] = cut(text).map(|half| String::from_utf8(half).unwrap());
        let shared = "mtllib a.mtl\nv -1 0 0\nv 1 0 0\nv -1 1 0\nv 1 1 0\n".to_owned()
            + &"vn 0.000000 0.000000 1.000000\n".repeat(4);
        assert_eq!(negative, format!("{shared}f 1/1/1 2/2/2 3/3/3\n"));
        assert_eq!(positive, format!("{shared}f 2/2/2 4/4/4 3/3/3\n"));
    }
}
