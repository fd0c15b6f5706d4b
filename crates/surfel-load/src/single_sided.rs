//! Splats of meshes in which some triangles are single-sided, as glTF's `doubleSided` states for each material.
//!
//! Culling of back faces is a property of a whole cloud. In a cloud with both kinds of triangles, back faces are
//! culled, and double-sided triangles get two splats, one for each side.

use surfel_model::{CloudData, Column3, Mesh, ModelError, OnInvalid, Shape, SplatCloud};
use surfel_sample::MeshPlaces;

/// Name of the column of a mesh's triangles that marks single-sided ones. It is 1 for triangles visible only from
/// outside, and 0 for others.
const COLUMN: &str = "single_sided";

/// Comment that marks a cloud with separate splats for each visible side. Its back faces are always culled.
pub(crate) const EACH_SIDE: &str = "has splats for each side";

/// True if the mesh's file has both single-sided and double-sided triangles.
pub(crate) fn states_sides(mesh: &Mesh) -> bool {
    mesh.triangle_extras.iter().any(|extra| extra.name == COLUMN)
}

/// Returns the cloud with additional, reversed splats for the double-sided triangles of `mesh`. Returns `None` if the
/// file doesn't distinguish sides, or if splats are clipped by curves. Row numbers aren't copied.
pub(crate) fn with_each_side(mesh: &Mesh, cloud: &SplatCloud) -> Result<Option<SplatCloud>, ModelError> {
    let column = mesh.triangle_extras.iter().find(|extra| extra.name == COLUMN);
    let has_curves = cloud.data().clips.as_ref().is_some_and(|clips| clips.curves.is_some());
    let Some(column) = column.filter(|_| !has_curves) else { return Ok(None) };
    let is_single = MeshPlaces::new(mesh, cloud).of_triangles(&column.values);
    let mut indices: Vec<u32> = (0..cloud.len() as u32).collect();
    indices.extend((0..cloud.len() as u32).filter(|i| is_single.get(*i as usize) != 1.0));
    let mut data = selected(cloud.data(), &indices);
    reverse_from(&mut data, cloud.len());
    data.comments.push(EACH_SIDE.into());
    Ok(Some(SplatCloud::new(data, OnInvalid::Refuse)?.0))
}

/// Returns the splats at `indices`, in this order; indices may be repeated.
fn selected(data: &CloudData, indices: &[u32]) -> CloudData {
    fn pick<T: Clone>(values: &Option<Vec<T>>, indices: &[u32]) -> Option<Vec<T>> {
        values.as_ref().map(|values| indices.iter().map(|i| values[*i as usize].clone()).collect())
    }
    let shape = match &data.shape {
        Shape::Disks { normals, radii } => Shape::Disks {
            normals: normals.select(indices),
            radii: indices.iter().map(|i| radii[*i as usize]).collect(),
        },
        Shape::Ellipses { s, t } => Shape::Ellipses { s: s.select(indices), t: t.select(indices) },
        Shape::Balls { radii, in_pixels, flat } => Shape::Balls {
            radii: indices.iter().map(|i| radii[*i as usize]).collect(),
            in_pixels: *in_pixels,
            flat: *flat,
        },
    };
    let mut clips = data.clips.clone();
    if let Some(clips) = &mut clips {
        clips.lines = pick(&clips.lines, indices);
        clips.modes = pick(&clips.modes, indices);
    }
    let mut extras = data.extras.clone();
    extras.iter_mut().for_each(|extra| extra.values = extra.values.select(indices));
    CloudData {
        colors: pick(&data.colors, indices),
        alphas: pick(&data.alphas, indices),
        shading_normals: data.shading_normals.as_ref().map(|normals| normals.select(indices)),
        clips,
        interior_weight: data.interior_weight,
        oriented: data.oriented,
        up: data.up,
        labels: pick(&data.labels, indices),
        extras,
        comments: data.comments.clone(),
        ..CloudData::new(data.origin, data.centers.select(indices), shape)
    }
}

/// Reverses the normals and shading normals of the splats from index `first` on. For ellipses, the half-axis t is
/// negated, and clip lines are mirrored with it.
fn reverse_from(data: &mut CloudData, first: usize) {
    let negate = |column: &mut Column3| {
        let from = |values: &[glam::Vec3]| {
            values.iter().enumerate().map(|(i, v)| if i < first { *v } else { -*v }).collect::<Vec<_>>()
        };
        *column = Column3::from_parts(from(column.high()), column.low().map(from));
    };
    match &mut data.shape {
        Shape::Disks { normals, .. } => negate(normals),
        Shape::Ellipses { t, .. } => negate(t),
        Shape::Balls { .. } => {}
    }
    if let Some(normals) = &mut data.shading_normals {
        negate(normals);
    }
    let lines = data.clips.as_mut().and_then(|clips| clips.lines.as_mut());
    lines.into_iter().flat_map(|lines| lines.iter_mut().skip(first)).flatten().for_each(|line| line.b = -line.b);
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use surfel_model::{ExtraColumn, ExtraValues};
    use surfel_sample::{MeshMethod, MeshOptions, NoProgress, splats_from_mesh};

    /// Returns two squares side by side in the plane z = 0 that face +z; one has x < 0.
    fn squares(single_sided: Option<Vec<u8>>) -> Mesh {
        let at = |x: f32, y: f32| glam::Vec3::new(x, y, 0.0);
        let positions = [at(-2.0, 0.0), at(-1.0, 0.0), at(-1.0, 1.0), at(-2.0, 1.0)];
        let other = positions.map(|p| p + glam::Vec3::X * 3.0);
        let column = |values| ExtraColumn { name: COLUMN.into(), values: ExtraValues::U8(values) };
        Mesh {
            positions: Column3::from_f32([positions, other].concat()),
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
            triangle_extras: single_sided.map(column).into_iter().collect(),
            ..Mesh::default()
        }
    }

    #[test]
    fn splats_of_triangles_with_two_sides_are_there_for_each() {
        let mesh = squares(Some(vec![1, 1, 0, 0]));
        assert!(states_sides(&mesh));
        let (cloud, _) = splats_from_mesh(&mesh, &MeshOptions::new(MeshMethod::Count(400)), &NoProgress).unwrap();
        let found = with_each_side(&mesh, &cloud).unwrap().unwrap();
        let count = |is_left: bool, facing: f64| {
            (0..found.len())
                .filter(|&i| (found.center(i).x < 0.0) == is_left && found.normal(i).dot(DVec3::Z) * facing > 0.99)
                .count()
        };
        let [single, other] = [count(true, 1.0), count(false, 1.0)];
        assert!(single + other == 400 && single.abs_diff(200) < 10, "{single} {other}");
        assert_eq!((count(true, -1.0), count(false, -1.0)), (0, other));
        assert!(found.data().comments.iter().any(|comment| comment == EACH_SIDE));
        // Clip lines at the open edges keep the same part of a splat.
        let clips = found.data().clips.as_ref().unwrap();
        let mut clipped = 0;
        for (copy, i) in (400..found.len()).zip((0..400).filter(|&i| cloud.center(i).x > 0.0)) {
            let [of, own] = [i, copy].map(|i| (found.axes(i), clips.clip(i, surfel_model::ClipPolicy::Exact)));
            assert!(of.0.0 == own.0.0 && of.0.1 == -own.0.1);
            let (Some(a), Some(b)) = (of.1, own.1) else { continue };
            clipped += 1;
            for k in 0..64 {
                let (u, v) = (f64::from(k % 8) / 4.0 - 0.9, f64::from(k / 8) / 4.0 - 0.9);
                let keeps = |clip: &surfel_math::clip::Clip<f64>, v| clip.keeps(surfel_math::V2::new(u, v));
                assert_eq!(keeps(&a, v), keeps(&b, -v));
            }
        }
        assert!(clipped > 20, "{clipped}");
    }

    #[test]
    fn clouds_of_files_without_the_column_stay_as_they_are() {
        let mesh = squares(None);
        let (cloud, _) = splats_from_mesh(&mesh, &MeshOptions::new(MeshMethod::Count(400)), &NoProgress).unwrap();
        assert!(!states_sides(&mesh) && with_each_side(&mesh, &cloud).unwrap().is_none());
    }
}
