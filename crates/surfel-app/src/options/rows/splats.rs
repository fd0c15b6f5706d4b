//! Options for converting points and meshes to splats.

use crate::options::row::{Commands, Group, Row, names_of, put};
use crate::values;

const fn splat(row: Row) -> Row {
    row.of(Group::Splats, Commands::SPLATS).image()
}

pub(super) const ROWS: &[Row] = &[
    splat(Row::text("splats", "N|auto", |o, text| put(&mut o.render.splats.convert.splats, values::splat_count(text))))
        .help(
            "Spread this many splats evenly over a mesh, or auto: as many as its shape and texture need.",
            "With --sharp, the target number of splats.",
        )
        .python(r#"int | Literal["auto"]"#)
        .scene("convert.splats")
        .example("7")
        .synonyms(&["count", "n-splats", "number", "sample", "density"]),
    splat(Row::switch("per-vertex", |o, on| o.render.splats.convert.per_vertex = on))
        .help("Create one splat per vertex of a mesh.", "")
        .scene("convert.per_vertex")
        .conflicts(&["per-face", "splats"])
        .synonyms(&["vertices", "vertex"]),
    splat(Row::switch("per-face", |o, on| o.render.splats.convert.per_face = on))
        .help("Create one splat per triangle of a mesh.", "")
        .scene("convert.per_face")
        .conflicts(&["splats"])
        .synonyms(&["faces", "face", "triangles", "per-triangle"]),
    splat(Row::text("radius-scale", "K", |o, text| {
        put(&mut o.render.splats.convert.radius_scale, values::positive(text))
    }))
    .help("Multiply every radius by this factor.", "")
    .python("float")
    .scene("convert.radius_scale")
    .example("7")
    .synonyms(&["radius", "point-size", "pointsize", "splat-size", "scale", "point-radius"]),
    splat(Row::text("cull", "CULL", |o, text| put(&mut o.render.splats.cull, values::cull(text))))
        .of(Group::Splats, Commands::SPLATS.without(Commands::ORTHO))
        .image()
        .names(|| names_of(values::CULLS))
        .help(
            "Cull splats that face away, or none; by default those of watertight meshes and clouds.",
            "`convert` records the choice in the file.",
        )
        .scene("material.cull")
        .synonyms(&["backface-culling", "culling", "two-sided", "double-sided"]),
    splat(Row::switch("sharp", |o, on| o.render.splats.convert.sharp = on))
        .help(
            "Clip splats along creases: few splats with sharp edges for a mesh, one per point along edges detected in \
             points.",
            "",
        )
        .scene("convert.sharp")
        .conflicts(&["per-vertex", "per-face"])
        .built(cfg!(feature = "sharp"))
        .synonyms(&["creases", "edges", "features"]),
    splat(Row::text("crease-angle", "DEG", |o, text| {
        put(&mut o.render.splats.convert.crease_angle, values::crease_angle(text))
    }))
    .help("Angle from which an edge is a crease, with --sharp (default 40).", "")
    .python("float")
    .scene("convert.crease_angle")
    .example("7")
    .requires(&["sharp"])
    .built(cfg!(feature = "sharp"))
    .synonyms(&["feature-angle"]),
    splat(Row::text("error", "E", |o, text| put(&mut o.render.splats.convert.error, values::positive(text))))
        .help("Largest deviation from the mesh that simplification may cause, with --sharp.", "")
        .python("float")
        .scene("convert.error")
        .example("7")
        .requires(&["sharp"])
        .built(cfg!(feature = "sharp"))
        .synonyms(&["tolerance", "max-error", "simplify"]),
];
