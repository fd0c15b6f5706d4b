//! Colours per face. Vertices are duplicated if the faces that share them have different colours.

use crate::context::Context;
use std::collections::HashMap;
use surfel_model::Mesh;

/// Colour of a face, in linear RGB and alpha.
pub(crate) type FaceColor = [f32; 4];

/// Replaces vertex colours by face colours: duplicates vertices so that each triangle has its face's colour. Vertices
/// that no triangle uses are dropped. If the vertices have differing colours of their own, the mesh stays unchanged,
/// and a note states this. A triangle without a face colour keeps its vertex colours.
///
/// `of_triangle` is the face colour of each triangle; it may have fewer items than the mesh has triangles. A mesh with
/// vertex indices out of range stays unchanged.
pub(crate) fn show(mesh: &mut Mesh, of_triangle: &[Option<FaceColor>], context: &mut Context<'_>) {
    // Programs that write face colours write at most one colour for all vertices.
    if mesh.colors.as_ref().is_some_and(|all| all.windows(2).any(|pair| pair[0] != pair[1])) {
        context.note("ignored the colours of its faces: its vertices have colours of their own".into());
        return;
    }
    if mesh.triangles.iter().flatten().any(|i| *i as usize >= mesh.positions.len()) {
        return;
    }
    let mut palette: Vec<FaceColor> = Vec::new();
    let mut number_of: HashMap<[u32; 4], u32> = HashMap::new();
    let mut known: HashMap<(u32, u32), u32> = HashMap::with_capacity(mesh.positions.len());
    // Source vertex and colour index of each new vertex.
    let mut sources: Vec<(u32, u32)> = Vec::new();
    for (i, triangle) in mesh.triangles.iter_mut().enumerate() {
        let number = of_triangle.get(i).copied().flatten().map_or(u32::MAX, |color| {
            *number_of.entry(color.map(f32::to_bits)).or_insert_with(|| {
                palette.push(color);
                palette.len() as u32 - 1
            })
        });
        for vertex in triangle {
            *vertex = *known.entry((*vertex, number)).or_insert_with(|| {
                sources.push((*vertex, number));
                sources.len() as u32 - 1
            });
        }
    }
    let own = |vertex: usize| {
        let [r, g, b] = mesh.colors.as_ref().map_or([1.0; 3], |all| all[vertex]);
        [r, g, b, mesh.alphas.as_ref().map_or(1.0, |all| all[vertex])]
    };
    let color =
        |(vertex, number): &(u32, u32)| palette.get(*number as usize).copied().unwrap_or_else(|| own(*vertex as usize));
    let all: Vec<FaceColor> = sources.iter().map(color).collect();
    mesh.select_vertices(&sources.iter().map(|(vertex, _)| *vertex).collect::<Vec<u32>>());
    mesh.colors = Some(all.iter().map(|c| [c[0], c[1], c[2]]).collect());
    mesh.alphas = all.iter().any(|c| c[3] < 1.0).then(|| all.iter().map(|c| c[3]).collect());
}
