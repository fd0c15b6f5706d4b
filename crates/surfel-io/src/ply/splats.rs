//! Builds splats or points from the vertices of a PLY file. In Surfel's splat profile, a vertex has half-axes (`su` …
//! `tw`), or a normal and a radius. Other vertices become points.

use super::colors::{FloatColors, take_alphas, take_colors};
use super::comments::{interpret_comments, is_oriented};
use super::table::{Table, require, take, take_positions, take_set};
use crate::columns::{self, Numbers};
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Problem};
use surfel_model::{
    ClipColumns, ClipCurve, ClipLine, ClipMode, CloudData, ExtraColumn, ExtraValues, NO_LINE, PointCloud, Shape,
};

const AXES: [&str; 6] = ["su", "sv", "sw", "tu", "tv", "tw"];
const CURVE: [&str; 5] = ["clip_theta1", "clip_theta3", "clip_u", "clip_v", "clip_w"];

pub(super) fn build(mut table: Table<'_>, comments: Vec<String>, context: &mut Context<'_>) -> Result<Content, Fault> {
    let axes = AXES.iter().any(|n| table.has(n));
    // A file with radii but without normals contains points, whose orientation is estimated.
    let radius = table.has("radius") && table.has("nx");
    let (up, interior_weight) = interpret_comments(&comments)?;
    if axes {
        require(&table, &AXES)?;
    } else if radius {
        require(&table, &["nx", "ny", "nz", "radius"])?;
    }
    let (origin, centers) = take_positions(&mut table, context)?;
    let normals = take_set(&mut table, ["nx", "ny", "nz"])?.map(columns::vectors);
    // Vertices with half-axes, or with normals and radii, follow Surfel's splat profile. Its float colours are linear,
    // even above 1.
    let is_profile = axes || radius;
    let floats = if is_profile { FloatColors::Linear } else { FloatColors::of_comments(&comments) };
    let colors = take_colors(&mut table, floats, context)?;
    let alphas = take_alphas(&mut table, is_profile, context);
    let clips = take_clips(&mut table)?;
    let (shape, shading_normals) = if axes {
        let [su, sv, sw, tu, tv, tw] = take(&mut table, AXES)?;
        let (s, t) = (columns::vectors([su, sv, sw]), columns::vectors([tu, tv, tw]));
        (Some(Shape::Ellipses { s, t }), normals)
    } else if let (true, Some(normals)) = (radius, normals.clone()) {
        let [radii] = take(&mut table, ["radius"])?;
        (Some(Shape::Disks { normals, radii: columns::to_f32(radii) }), None)
    } else {
        (None, normals)
    };
    let is_points = shape.is_none();
    let radii = table.take("radius").map(ExtraValues::from);
    let points_radii = radii.clone().filter(|_| is_points).map(columns::to_f32);
    let radii = radii.map(|values| ("radius".to_owned(), Numbers::InMemory(values)));
    table.scalars.extend(radii);
    let extras = table.scalars.into_iter().map(|(name, values)| ExtraColumn { name, values: values.into() }).collect();
    let Some(shape) = shape else {
        if clips.is_some() {
            let problem = Problem::new("has clip properties, but no half-axes su sv sw tu tv tw to measure them in");
            return Err(problem.expected("half-axes beside clip_*, or neither").into());
        }
        let normals = shading_normals;
        let points = PointCloud {
            origin,
            positions: centers,
            normals,
            colors,
            alphas,
            radii: points_radii,
            extras,
            up,
            comments,
            ..PointCloud::default()
        };
        return context.points(points);
    };
    context.splats(CloudData {
        colors,
        alphas,
        shading_normals,
        clips,
        interior_weight,
        oriented: comments.iter().any(|comment| is_oriented(comment)),
        up,
        extras,
        comments,
        ..CloudData::new(origin, centers, shape)
    })
}

fn take_clips(table: &mut Table<'_>) -> Result<Option<ClipColumns>, Fault> {
    let curves = take_set(table, CURVE)?.map(|columns| {
        let [theta1, theta3, u, v, w] = columns.map(columns::to_f32);
        (0..w.len()).map(|i| ClipCurve { theta1: theta1[i], theta3: theta3[i], u: u[i], v: v[i], w: w[i] }).collect()
    });
    let mut lines: Option<Vec<[ClipLine; 4]>> = None;
    for k in 0..4 {
        let [a, b, c] = ["a", "b", "c"].map(|x| format!("clip_line{k}_{x}"));
        let Some(columns) = take_set(table, [a.as_str(), b.as_str(), c.as_str()])? else { continue };
        let [a, b, c] = columns.map(columns::to_f32);
        let lines = lines.get_or_insert_with(|| vec![[NO_LINE; 4]; a.len()]);
        for (i, line) in lines.iter_mut().enumerate() {
            line[k] = ClipLine { a: a[i], b: b[i], c: c[i] };
        }
    }
    let modes = match table.take("clip_mode") {
        None => None,
        Some(values) => Some(
            columns::to_f64(&values.into())
                .iter()
                .enumerate()
                .map(|(i, mode)| match mode {
                    0.0 => Ok(ClipMode::And),
                    1.0 => Ok(ClipMode::Or),
                    _ => Err(Problem::new(format!("clip_mode of splat {i} is {mode}")).expected("0 (and) or 1 (or)")),
                })
                .collect::<Result<Vec<_>, _>>()?,
        ),
    };
    let some = curves.is_some() || lines.is_some() || modes.is_some();
    Ok(some.then_some(ClipColumns { curves, lines, modes }))
}
