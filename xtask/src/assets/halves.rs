//! Spot cut into two meshes, for pictures that are half splats and half polygons.

use std::io;
use std::path::Path;

/// The model, relative to the workspace, and where its materials are seen from the generated files.
const MODEL: &str = "assets/spot/spot.obj";
const MATERIALS: &str = "mtllib ../spot/spot.mtl";

/// The OBJ files of the faces whose centroids lie at negative x, and of the others. Vertices are those of the model.
pub(super) fn halves(root: &Path) -> io::Result<[Vec<u8>; 2]> {
    let text = std::fs::read_to_string(root.join(MODEL))?;
    Ok(cut(&text))
}

fn cut(text: &str) -> [Vec<u8>; 2] {
    let mut x = Vec::new();
    let mut halves = [Vec::new(), Vec::new()];
    for line in text.lines() {
        let mut words = line.split_ascii_whitespace();
        let line = match words.next() {
            Some("v") => {
                x.push(words.next().and_then(|w| w.parse::<f64>().ok()).unwrap_or(0.0));
                line
            }
            Some("f") => {
                // `1/2` is a vertex and its texture coordinates.
                let corner = |word: &str| word.split('/').next()?.parse::<usize>().ok()?.checked_sub(1);
                let sum: f64 = words.filter_map(corner).filter_map(|i| x.get(i)).sum();
                let half = &mut halves[usize::from(sum >= 0.0)];
                half.extend_from_slice(line.as_bytes());
                half.push(b'\n');
                continue;
            }
            Some("mtllib") => MATERIALS,
            _ => line,
        };
        for half in &mut halves {
            half.extend_from_slice(line.as_bytes());
            half.push(b'\n');
        }
    }
    halves
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_share_vertices_and_divide_the_faces() {
        let text = "mtllib a.mtl\nv -1 0 0\nv 1 0 0\nv -1 1 0\nv 1 1 0\nf 1/1 2/2 3/3\nf 2/2 4/4 3/3\n";
        let [negative, positive] = cut(text).map(|half| String::from_utf8(half).unwrap());
        assert_eq!(negative, text.replace("a.mtl", "../spot/spot.mtl").replace("f 2/2 4/4 3/3\n", ""));
        assert_eq!(positive, text.replace("a.mtl", "../spot/spot.mtl").replace("f 1/1 2/2 3/3\n", ""));
    }
}
