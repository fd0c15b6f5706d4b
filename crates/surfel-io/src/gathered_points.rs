//! Points of several parts of a file, or of several files, merged into one cloud. If only some parts have a column, the
//! points of other parts get a default value in it: white as colour, else 0.

use crate::columns::{measured_positions, rounding_note_of_step, to_f64};
use crate::content::Content;
use crate::context::Context;
use crate::error::Fault;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::HashMap;
use surfel_model::{Column3, ExtraColumn, ExtraValues, PointCloud};

/// Points of one part of a file, or of one of several files. Each column has a value for each point.
#[derive(Default)]
pub(crate) struct PointsPart {
    pub(crate) positions: Vec<DVec3>,
    pub(crate) normals: Option<Vec<[f32; 3]>>,
    /// Point colours, in linear RGB and alpha.
    pub(crate) colors: Option<Vec<[f32; 4]>>,
    pub(crate) extras: Vec<ExtraColumn>,
    /// Largest rounding step of the positions, in the units of the positions, if the file stores them as 32-bit floats;
    /// otherwise 0.
    pub(crate) step: f64,
}

impl PointsPart {
    /// Transforms the part's points and normals to world space.
    pub(crate) fn place(&mut self, world_from_part: DAffine3) {
        self.step *= largest_scale(world_from_part);
        self.positions.iter_mut().for_each(|p| *p = world_from_part.transform_point3(*p));
        let normals = inverse_transpose(world_from_part);
        self.normals.iter_mut().flatten().for_each(|n| *n = transform_normal(normals, *n));
    }
}

/// Returns the largest factor by which a transformation scales one of the x, y and z axes.
pub(crate) fn largest_scale(world: DAffine3) -> f64 {
    let m = world.matrix3;
    [m.x_axis, m.y_axis, m.z_axis].iter().map(|axis| axis.length()).fold(0.0, f64::max)
}

/// Returns the matrix that transforms normals: the inverse transpose of the linear part, times a positive factor. The
/// matrix is finite for any finite `world`, even one that can't be inverted.
pub(crate) fn inverse_transpose(world: DAffine3) -> DMat3 {
    let m = world.matrix3;
    let sign = 1.0_f64.copysign(m.determinant());
    DMat3::from_cols(m.y_axis.cross(m.z_axis) * sign, m.z_axis.cross(m.x_axis) * sign, m.x_axis.cross(m.y_axis) * sign)
}

/// Transforms a normal by the result of [`inverse_transpose`], and normalises it. The identity returns the normal
/// unchanged.
pub(crate) fn transform_normal(matrix: DMat3, normal: [f32; 3]) -> [f32; 3] {
    if matrix == DMat3::IDENTITY {
        return normal;
    }
    surfel_math::basis::unit(matrix * DVec3::from(normal.map(f64::from))).as_vec3().to_array()
}

/// Parts of a point cloud that were merged so far, in world space, in order.
#[derive(Default)]
pub(crate) struct GatheredPoints {
    pub(crate) positions: Vec<DVec3>,
    normals: Vec<[f32; 3]>,
    colors: Vec<[f32; 4]>,
    any_normal: bool,
    any_color: bool,
    extras: Vec<ExtraColumn>,
    /// Largest rounding step of the positions of all parts, in world units.
    step: f64,
    /// Index in `extras` of each column, by name.
    extra_of: HashMap<String, usize>,
}

impl GatheredPoints {
    pub(crate) fn add(&mut self, part: PointsPart) {
        let before = self.positions.len();
        self.step = self.step.max(part.step);
        self.positions.extend(part.positions);
        let total = self.positions.len();
        self.any_normal |= part.normals.is_some();
        self.any_color |= part.colors.is_some();
        self.normals.extend(part.normals.into_iter().flatten());
        self.normals.resize(total, [0.0; 3]);
        self.colors.extend(part.colors.into_iter().flatten());
        self.colors.resize(total, [1.0; 4]);
        for extra in part.extras {
            let place = *self.extra_of.entry(extra.name).or_insert_with_key(|name| {
                let mut values = extra.values.clone();
                values.resize(0);
                self.extras.push(ExtraColumn { name: name.clone(), values });
                self.extras.len() - 1
            });
            // Parts in between may lack this column.
            let known = &mut self.extras[place].values;
            known.resize(before);
            append(known, &extra.values);
        }
    }

    /// Extends all columns to a value for every point. The new values are 0.
    fn filled(mut extras: Vec<ExtraColumn>, total: usize) -> Vec<ExtraColumn> {
        extras.iter_mut().for_each(|extra| extra.values.resize(total));
        extras
    }

    /// Rotates all points about `center` and moves `center` to the origin.
    pub(crate) fn turn(&mut self, center: DVec3, rotation: DMat3) {
        self.positions.iter_mut().for_each(|p| *p = rotation * (*p - center));
        self.normals.iter_mut().for_each(|n| *n = (rotation * DVec3::from(n.map(f64::from))).as_vec3().to_array());
    }

    /// Returns all points as a single part.
    pub(crate) fn into_part(self) -> PointsPart {
        let Self { positions, normals, colors, any_normal, any_color, extras, step, .. } = self;
        let extras = Self::filled(extras, positions.len());
        let (normals, colors) = (any_normal.then_some(normals), any_color.then_some(colors));
        PointsPart { positions, normals, colors, extras, step }
    }

    /// Adds a note if the points are so far from the origin that the rounding of their positions is noticeable.
    pub(crate) fn note_rounding(&self, context: &mut Context<'_>) {
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let finite = self.positions.iter().filter(|p| p.is_finite());
        let (min, max) = finite.fold(none, |(min, max), p| (min.min(*p), max.max(*p)));
        rounding_note_of_step(self.step, min, max).into_iter().for_each(|note| context.note(note));
    }

    /// Returns the merged point cloud, without points whose position isn't finite.
    pub(crate) fn finish(self, context: &mut Context<'_>) -> Result<Content, Fault> {
        let (origin, positions) = measured_positions(&self.positions);
        let alphas = self.any_color && self.colors.iter().any(|c| c[3] < 1.0);
        context.points(PointCloud {
            origin,
            positions,
            normals: self.any_normal.then(|| Column3::from_f32(self.normals.into_iter().map(Into::into).collect())),
            alphas: alphas.then(|| self.colors.iter().map(|c| c[3]).collect()),
            colors: self.any_color.then(|| self.colors.iter().map(|c| [c[0], c[1], c[2]]).collect()),
            extras: Self::filled(self.extras, self.positions.len()),
            ..PointCloud::default()
        })
    }
}

/// Appends values to a column. If the number types differ, the column becomes f64.
fn append(column: &mut ExtraValues, values: &ExtraValues) {
    use ExtraValues::*;
    match (&mut *column, values) {
        (I8(column), I8(values)) => column.extend(values),
        (U8(column), U8(values)) => column.extend(values),
        (I16(column), I16(values)) => column.extend(values),
        (U16(column), U16(values)) => column.extend(values),
        (I32(column), I32(values)) => column.extend(values),
        (U32(column), U32(values)) => column.extend(values),
        (F32(column), F32(values)) => column.extend(values),
        (F64(column), F64(values)) => column.extend(values),
        (other, values) => {
            let mut all = to_f64(other);
            all.extend(to_f64(values));
            *column = F64(all);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_only_some_parts_have_are_filled() {
        let extra = |name: &str, values| ExtraColumn { name: name.into(), values };
        let part = |x: f64, normal: bool, extras| PointsPart {
            positions: vec![DVec3::X * x],
            normals: normal.then(|| vec![[0.0, 0.0, 1.0]]),
            extras,
            ..PointsPart::default()
        };
        let mut all = GatheredPoints::default();
        all.add(part(1.0, false, vec![]));
        all.add(part(2.0, true, vec![extra("a", ExtraValues::U8(vec![7])), extra("b", ExtraValues::U8(vec![9]))]));
        all.add(part(3.0, false, vec![extra("b", ExtraValues::I16(vec![-9]))]));
        assert_eq!(all.normals, [[0.0; 3], [0.0, 0.0, 1.0], [0.0; 3]]);
        let columns = [("a", ExtraValues::U8(vec![0, 7, 0])), ("b", ExtraValues::F64(vec![0.0, 9.0, -9.0]))];
        assert_eq!(all.into_part().extras, columns.map(|(name, values)| extra(name, values)));
    }
}
