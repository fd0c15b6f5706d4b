//! PLY meshes: polygons and triangle strips.

use super::body::TEXTURE;
use super::colors::{FloatColors, take_alphas, take_colors};
use super::comments::interpret_comments;
use super::table::{Lists, Table, take_positions, take_set};
use super::wedges::Wedges;
use crate::columns;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, list};
use crate::face_colors::{self, FaceColor};
use crate::polygons::Triangulator;
use crate::texture;
use crate::words::counted;
use glam::DVec3;
use std::sync::Arc;
use surfel_model::{Column3, ExtraColumn, Mesh};

/// Polygons of a PLY file, with texture coordinates and other properties.
pub(super) struct Faces {
    corners: Lists<u32>,
    coordinates: Option<Lists<f32>>,
    /// Texture index of each polygon, as stored; `None` if the file states none.
    textures: Option<Vec<f64>>,
    /// Colour of each polygon; `None` if the file states none.
    colors: Option<Vec<FaceColor>>,
    /// Further properties of the polygons, which become columns of triangles.
    extras: Vec<ExtraColumn>,
}

/// Properties of faces that don't become columns of triangles, because they are colours.
const NOT_EXTRAS: [&str; 4] = ["red", "green", "blue", "alpha"];

impl Faces {
    /// Extracts the polygons and their properties from the table of the element `face`. Returns `None` if there are
    /// none.
    pub(super) fn of(
        mut table: Table<'_>,
        comments: &[String],
        context: &mut Context<'_>,
    ) -> Result<Option<Self>, Fault> {
        let textures = table.take(TEXTURE).map(|numbers| columns::to_f64(&numbers.into()));
        let coordinates = table.coordinates.take().filter(|lists| !lists.items.is_empty());
        let colors = match take_colors(&mut table, FloatColors::of_comments(comments), context)? {
            Some(colors) => {
                let alphas = take_alphas(&mut table, false, context);
                let alphas = alphas.filter(|all| all.iter().any(|a| *a != 0.0));
                let alpha = |i: usize| alphas.as_ref().map_or(1.0, |all| all[i]);
                Some(colors.iter().enumerate().map(|(i, [r, g, b])| [*r, *g, *b, alpha(i)]).collect())
            }
            None => None,
        };
        let scalars = table.scalars.into_iter().filter(|(name, _)| !NOT_EXTRAS.contains(&name.as_str()));
        let extras = scalars.map(|(name, values)| ExtraColumn { name, values: values.into() }).collect();
        let corners = table.lists.into_iter().next().filter(|(_, lists)| !lists.lengths.is_empty());
        Ok(corners.map(|(_, corners)| Self { corners, coordinates, textures, colors, extras }))
    }

    /// Returns the colour of each triangle, which is that of its polygon; `None` if the file states no colours. A
    /// polygon of n corners becomes n − 2 triangles.
    fn triangle_colors(&self) -> Option<Vec<Option<FaceColor>>> {
        let colors = self.colors.as_ref()?;
        let each = self.corners.lengths.iter().zip(colors);
        Some(each.flat_map(|(n, color)| std::iter::repeat_n(Some(*color), (*n as usize).saturating_sub(2))).collect())
    }
}

pub(super) fn build(
    mut table: Table<'_>,
    faces: Option<Faces>,
    strips: Option<Lists<u32>>,
    comments: Vec<String>,
    context: &mut Context<'_>,
) -> Result<Content, Fault> {
    let (up, _) = interpret_comments(&comments)?;
    let (origin, positions) = take_positions(&mut table, context)?;
    let normals = take_set(&mut table, ["nx", "ny", "nz"])?.map(|n| to_arrays(n.map(columns::to_f32)));
    let floats = FloatColors::of_comments(&comments);
    let colors = take_colors(&mut table, floats, context)?;
    let alphas = take_alphas(&mut table, false, context);
    let uv_names = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]];
    let uvs = match uv_names.into_iter().find(|names| names.iter().all(|n| table.has(n))) {
        // PLY has v upwards, as OpenGL; the model has v downwards, as images.
        Some(names) => take_set(&mut table, names)?.map(|uv| {
            let [u, v] = uv.map(columns::to_f32);
            u.into_iter().zip(v).map(|(u, v)| [u, 1.0 - v]).collect()
        }),
        None => None,
    };
    let scalars = table.scalars.into_iter();
    let vertex_extras: Vec<ExtraColumn> =
        scalars.map(|(name, values)| ExtraColumn { name, values: values.into() }).collect();
    let (mut triangles, mut triangle_extras) = (Vec::new(), Vec::new());
    let mut wedges = None;
    if let Some(faces) = &faces {
        let face_of = cut(&faces.corners, &positions, &mut triangles, context);
        triangle_extras = columns_of_triangles(&faces.extras, &face_of, strips.is_some(), &vertex_extras, context);
        let of = |lists| Wedges::new((&faces.corners, &positions), lists, faces.textures.as_deref());
        wedges = faces.coordinates.as_ref().map(of);
    }
    let face_colors = faces.as_ref().and_then(Faces::triangle_colors);
    if let Some(strips) = strips {
        unroll(&strips, &mut triangles);
    }
    let mut mesh = Mesh {
        origin,
        positions,
        triangles,
        normals,
        colors,
        alphas,
        uvs,
        vertex_extras,
        triangle_extras,
        up,
        comments,
        ..Mesh::default()
    };
    let names = mesh.comments.iter().filter_map(|c| c.trim().strip_prefix("TextureFile").map(|n| n.trim().to_owned()));
    let names: Vec<String> = names.collect();
    let mut read =
        |name: &String| match context.siblings.read(name).and_then(|bytes| context.textures.decode(&bytes, name)) {
            Ok(texture) => Some(Arc::new(texture)),
            Err(why) => {
                context.note(texture::missing(name, &why));
                None
            }
        };
    if let Some(wedges) = wedges.filter(|_| !names.is_empty()) {
        wedges.split(&mut mesh, &names.iter().map(&mut read).collect::<Vec<_>>());
    } else if let (Some(name), true) = (names.first(), mesh.uvs.is_some()) {
        mesh.texture = read(name);
    }
    if let Some(of_triangle) = face_colors {
        face_colors::show(&mut mesh, &of_triangle, context);
    }
    context.drop_black_colors(&mut mesh.colors);
    context.mesh(mesh)
}

fn to_arrays([x, y, z]: [Vec<f32>; 3]) -> Vec<[f32; 3]> {
    x.into_iter().zip(y).zip(z).map(|((x, y), z)| [x, y, z]).collect()
}

/// Cuts polygons into triangles of vertex indices, which are appended to `triangles`. Returns the index of each
/// triangle's polygon. Adds a note on polygons with fewer than three corners, which are skipped.
fn cut(faces: &Lists<u32>, positions: &Column3, triangles: &mut Vec<[u32; 3]>, context: &mut Context<'_>) -> Vec<u32> {
    // Every corner beyond a polygon's second makes a triangle, so this capacity is exact.
    triangles.reserve(faces.lengths.iter().map(|&n| (n as usize).saturating_sub(2)).sum());
    let (mut skipped, mut cutter) = (0, Triangulator::default());
    let mut face_of = Vec::with_capacity(triangles.capacity());
    for (face, polygon) in faces.iter().enumerate() {
        let cut = cutter.cut(polygon, |i| place(positions, i));
        triangles.extend(cut.iter().map(|t| t.map(|corner| polygon[corner as usize])));
        face_of.resize(triangles.len(), face as u32);
        skipped += usize::from(polygon.len() < 3);
    }
    if skipped > 0 {
        context.note(format!("skipped {} with fewer than 3 corners", counted(skipped as u64, "faces")));
    }
    face_of
}

/// Converts columns of polygons to columns of triangles. `face_of` states the index of each triangle's polygon. A
/// column gets the prefix `face_` if vertices have a column of the same name. A mesh that also has triangle strips gets
/// no columns, but a note.
fn columns_of_triangles(
    extras: &[ExtraColumn],
    face_of: &[u32],
    has_strips: bool,
    of_vertices: &[ExtraColumn],
    context: &mut Context<'_>,
) -> Vec<ExtraColumn> {
    if has_strips && !extras.is_empty() {
        let names: Vec<&str> = extras.iter().map(|extra| extra.name.as_str()).collect();
        context.note(format!("ignored the face properties {}: triangle strips have none", list(&names)));
        return Vec::new();
    }
    let of = |extra: &ExtraColumn| {
        let is_taken = ExtraColumn::find(of_vertices, &extra.name).is_some();
        let name = if is_taken { format!("face_{}", extra.name) } else { extra.name.clone() };
        // In a damaged file an element may have fewer rows than lists.
        (extra.values.len() > face_of.last().map_or(0, |last| *last as usize))
            .then(|| ExtraColumn { name, values: extra.values.select(face_of) })
    };
    extras.iter().filter_map(of).collect()
}

/// Returns the position of vertex `i`, if the vertex exists.
pub(super) fn place(positions: &Column3, i: u32) -> Option<DVec3> {
    ((i as usize) < positions.len()).then(|| positions.get(i as usize))
}

/// Converts triangle strips to triangles, which are appended to `triangles`. The index −1 (`u32::MAX`) begins a new
/// strip. Degenerate triangles, which connect parts of a strip, are dropped.
fn unroll(strips: &Lists<u32>, triangles: &mut Vec<[u32; 3]>) {
    triangles.reserve(strips.items.len());
    for strip in strips.iter() {
        for run in strip.split(|&i| i == u32::MAX) {
            for (i, w) in run.windows(3).enumerate() {
                if w[0] != w[1] && w[1] != w[2] && w[0] != w[2] {
                    triangles.push(if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] });
                }
            }
        }
    }
}
