//! PLY: Surfel's splat profile, point clouds, meshes, and Gaussian splats.

mod body;
mod gaussians;
mod header;
mod mesh;
mod splats;
mod write;

pub use write::{save_splat_ply, write_splat_ply};

use crate::error::{Fault, Problem, quote};
use crate::load::{Content, Context};
use body::{Table, Want};
use glam::DVec3;
use surfel_model::{Column3, Up};

/// The three encodings of PLY data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PlyEncoding {
    /// Decimal text.
    Ascii,
    /// Binary, least significant byte first.
    #[default]
    BinaryLittleEndian,
    /// Binary, most significant byte first.
    BinaryBigEndian,
}

impl PlyEncoding {
    fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::BinaryLittleEndian => "binary_little_endian",
            Self::BinaryBigEndian => "binary_big_endian",
        }
    }
}

/// Names of the list of a face's or strip's corners.
const INDEX_LISTS: &[&str] = &["vertex_indices", "vertex_index"];

/// Reads a PLY file.
pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let header = header::parse(bytes)?;
    if header.elements.iter().any(|e| e.properties.iter().any(|p| p.name == "packed_position")) {
        let problem = Problem::new("holds compressed Gaussian splats ('packed_position'), which are not read");
        return Err(problem.help("export it as an uncompressed PLY, e.g. with splat-transform").into());
    }
    let tables = body::read(bytes, &header, |element| match element.name.as_str() {
        "vertex" => Want::Scalars,
        "face" | "tristrips" => Want::Lists(INDEX_LISTS),
        _ => Want::Nothing,
    })?;
    let (mut vertices, mut faces, mut strips) = (None, None, None);
    for (name, table) in tables {
        match name.as_str() {
            "vertex" => vertices = Some(table),
            "face" => faces = table.lists.into_iter().next().map(|(_, lists)| lists),
            _ => strips = table.lists.into_iter().next().map(|(_, lists)| lists),
        }
    }
    let Some(vertices) = vertices else {
        let names: Vec<&str> = header.elements.iter().map(|e| e.name.as_str()).collect();
        let what = format!("the PLY file has no 'vertex' element; it has {}", list(&names));
        return Err(Problem::new(what).expected("'element vertex N' with properties x y z").into());
    };
    require(&vertices, &["x", "y", "z"])?;
    let faces = faces.filter(|f| !f.lengths.is_empty());
    let strips = strips.filter(|s| !s.lengths.is_empty());
    if faces.is_some() || strips.is_some() {
        return mesh::build(vertices, faces, strips, header.comments, context);
    }
    if gaussians::recognise(&vertices)? {
        return gaussians::build(vertices, header.comments, context);
    }
    splats::build(vertices, header.comments, context)
}

/// The axis that a comment declares to be up: `Vertical axis: z`, `up +z`.
fn comment_up(comment: &str) -> Option<Up> {
    let text = comment.trim().to_ascii_lowercase();
    let axis = text.strip_prefix("vertical axis:").or_else(|| text.strip_prefix("up "))?;
    axis.trim().parse().ok()
}

/// The value of a comment `interior_weight W0`.
fn comment_interior_weight(comment: &str) -> Option<Result<f64, Problem>> {
    let mut words = comment.split_ascii_whitespace();
    if words.next() != Some("interior_weight") {
        return None;
    }
    let word = words.next().unwrap_or("");
    let value = word.parse().ok().filter(|w: &f64| *w > 0.0 && w.is_finite() && words.next().is_none());
    Some(value.ok_or_else(|| {
        Problem::new(format!("the comment {} has no valid weight", quote(comment)))
            .expected("'comment interior_weight W0' with a finite number W0 > 0")
    }))
}

/// Takes x, y and z, whose presence has been checked.
fn take_positions(table: &mut Table) -> Result<(DVec3, Column3), Fault> {
    take(table, ["x", "y", "z"]).map(crate::columns::positions)
}

/// Takes columns that have to be there.
fn take<const N: usize>(table: &mut Table, names: [&str; N]) -> Result<[surfel_model::ExtraValues; N], Fault> {
    require(table, &names)?;
    let columns: Vec<_> = names.iter().filter_map(|n| table.take(n)).collect();
    columns.try_into().map_err(|_| Problem::new(format!("the properties {} are incomplete", list(&names))).into())
}

/// Takes a set of columns if all are there; some but not all is an error.
fn take_set<const N: usize>(
    table: &mut Table,
    names: [&str; N],
) -> Result<Option<[surfel_model::ExtraValues; N]>, Fault> {
    if names.iter().any(|n| table.has(n)) { take(table, names).map(Some) } else { Ok(None) }
}

/// An error unless all of `names` are there.
fn require(table: &Table, names: &[&str]) -> Result<(), Fault> {
    let (found, missing): (Vec<&str>, Vec<&str>) = names.iter().partition(|n| table.has(n));
    if missing.is_empty() {
        return Ok(());
    }
    let what = if found.is_empty() {
        let all: Vec<&str> = table.scalars.iter().map(|(n, _)| n.as_str()).collect();
        format!("its vertices lack {}; they have {}", list(&missing), list(&all))
    } else {
        format!("its vertices have {} but lack {}", list(&found), list(&missing))
    };
    Err(Problem::new(what).expected(format!("all of {}", names.join(" "))).help(EXPECTED_SETS).into())
}

const EXPECTED_SETS: &str = "splats need x y z and nx ny nz radius, or x y z and su sv sw tu tv tw; points need x y z";

/// Names in a message, at most 24 of them.
fn list(names: &[&str]) -> String {
    if names.is_empty() {
        return "nothing".into();
    }
    let mut shown: Vec<String> = names.iter().take(24).map(|n| quote(n).trim_matches('\'').to_owned()).collect();
    if names.len() > shown.len() {
        shown.push(format!("… ({} in all)", names.len()));
    }
    shown.join(" ")
}

/// The comments' own say about the up axis and the interior weight.
fn interpret_comments(header_comments: &[String]) -> Result<(Option<Up>, Option<f64>), Fault> {
    let up = header_comments.iter().find_map(|c| comment_up(c));
    let weight = header_comments.iter().find_map(|c| comment_interior_weight(c)).transpose()?;
    Ok((up, weight))
}
