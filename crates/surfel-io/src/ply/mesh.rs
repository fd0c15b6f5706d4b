//! PLY meshes: polygons and triangle strips.

use super::comments::interpret_comments;
use super::table::{Lists, Table, take_colors, take_positions, take_set};
use crate::columns;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, list};
use crate::images::texture;
use std::sync::Arc;
use surfel_model::Mesh;

pub(super) fn build(
    mut table: Table<'_>,
    faces: Option<Lists>,
    strips: Option<Lists>,
    comments: Vec<String>,
    context: &mut Context<'_>,
) -> Result<Content, Fault> {
    let (up, _) = interpret_comments(&comments)?;
    let (origin, positions) = take_positions(&mut table)?;
    let normals = take_set(&mut table, ["nx", "ny", "nz"])?.map(|n| to_arrays(n.map(columns::to_f32)));
    let colors = take_colors(&mut table, context)?;
    let alphas = table.take("alpha").map(columns::alphas);
    let uv_names = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]];
    let uvs = match uv_names.into_iter().find(|names| names.iter().all(|n| table.has(n))) {
        // PLY has v upwards, as OpenGL; the model has it downwards, as images.
        Some(names) => take_set(&mut table, names)?.map(|uv| {
            let [u, v] = uv.map(columns::to_f32);
            u.into_iter().zip(v).map(|(u, v)| [u, 1.0 - v]).collect()
        }),
        None => None,
    };
    if !table.scalars.is_empty() {
        let names: Vec<&str> = table.scalars.iter().map(|(n, _)| n.as_str()).collect();
        context.note(format!("ignored the vertex properties {}: a mesh has no use for them", list(&names)));
    }
    let mut triangles = Vec::new();
    if let Some(faces) = faces {
        fan(&faces, &mut triangles, context);
    }
    if let Some(strips) = strips {
        unroll(&strips, &mut triangles);
    }
    let mut mesh = Mesh { origin, positions, triangles, normals, colors, alphas, uvs, up, comments, ..Mesh::default() };
    let named = mesh.comments.iter().find_map(|c| c.trim().strip_prefix("TextureFile")).map(|n| n.trim().to_owned());
    if let (Some(name), true) = (named, mesh.uvs.is_some()) {
        match context.siblings.read(&name).and_then(|bytes| context.textures.decode(&bytes)) {
            Ok(texture) => mesh.texture = Some(Arc::new(texture)),
            Err(why) => context.note(texture::missing(&name, &why)),
        }
    }
    context.mesh(mesh)
}

fn to_arrays([x, y, z]: [Vec<f32>; 3]) -> Vec<[f32; 3]> {
    x.into_iter().zip(y).zip(z).map(|((x, y), z)| [x, y, z]).collect()
}

/// Polygons as fans about their first corner.
fn fan(faces: &Lists, triangles: &mut Vec<[u32; 3]>, context: &mut Context<'_>) {
    // Every item beyond a polygon's second makes a triangle, so this is exact.
    triangles.reserve(faces.lengths.iter().map(|&n| (n as usize).saturating_sub(2)).sum());
    let (mut rest, mut skipped) = (faces.items.as_slice(), 0);
    for &length in &faces.lengths {
        let (polygon, after) = rest.split_at(rest.len().min(length as usize));
        rest = after;
        match polygon {
            [first, middle @ ..] if middle.len() >= 2 => {
                triangles.extend(middle.windows(2).map(|w| [*first, w[0], w[1]]));
            }
            _ => skipped += 1,
        }
    }
    if skipped > 0 {
        context.note(format!("skipped {skipped} faces with fewer than 3 corners"));
    }
}

/// Strips, in which −1 begins a new one. Triangles without area only steer the strip.
fn unroll(strips: &Lists, triangles: &mut Vec<[u32; 3]>) {
    let mut rest = strips.items.as_slice();
    triangles.reserve(rest.len());
    for &length in &strips.lengths {
        let (strip, after) = rest.split_at(rest.len().min(length as usize));
        rest = after;
        for run in strip.split(|&i| i == u32::MAX) {
            for (i, w) in run.windows(3).enumerate() {
                if w[0] != w[1] && w[1] != w[2] && w[0] != w[2] {
                    triangles.push(if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] });
                }
            }
        }
    }
}
