//! Transfer of the attributes of a mesh's vertices and faces to columns of its splats.

use crate::coloring::tally::Tally;
use crate::coloring::together::Colors;
use crate::coloring::{ColorScale, is_class};
use surfel_model::{ExtraColumn, ExtraValues, Mesh, ModelError, OnInvalid, SplatCloud};
use surfel_sample::MeshPlaces;

/// Mesh with attribute columns, and the positions of its splats on its triangles. The positions are computed on first
/// use.
pub(crate) struct MeshColumns {
    mesh: Mesh,
    places: Option<MeshPlaces>,
}

impl MeshColumns {
    /// Prepares the transfer; `None` for a mesh without columns.
    pub(crate) fn new(mesh: Mesh) -> Option<Self> {
        let has_any = !mesh.vertex_extras.is_empty() || !mesh.triangle_extras.is_empty();
        has_any.then_some(Self { mesh, places: None })
    }

    /// Returns the names of the columns of vertices and of faces.
    pub(crate) fn names(&self) -> Vec<String> {
        let all = self.mesh.vertex_extras.iter().chain(&self.mesh.triangle_extras);
        all.map(|extra| extra.name.escape_debug().to_string()).collect()
    }

    /// Adds all columns to the splats. Floating-point columns are interpolated over triangles; integer columns get the
    /// value of the nearest vertex. A column of faces gives each splat the value of its face.
    pub(crate) fn all(&mut self, cloud: SplatCloud) -> Result<SplatCloud, ModelError> {
        let columns: Vec<(String, bool)> = self.mesh.vertex_extras.iter().map(named).collect();
        let of_triangles: Vec<String> = self.mesh.triangle_extras.iter().map(|extra| extra.name.clone()).collect();
        let names = columns.into_iter().chain(of_triangles.into_iter().map(|name| (name, true)));
        names
            .collect::<Vec<_>>()
            .into_iter()
            .try_fold(cloud, |cloud, (name, is_nearest)| self.with_column(cloud, &name, is_nearest))
    }

    /// Adds a column for labels. Each splat gets the value of the nearest vertex, or of its face.
    pub(crate) fn labels(&mut self, cloud: SplatCloud, attribute: &str) -> Result<SplatCloud, ModelError> {
        self.with_column(cloud, attribute, true)
    }

    /// Adds the column by which splats are coloured. Measurements are interpolated over triangles. Categories get the
    /// value of the nearest vertex, because a value between two categories is meaningless. A column with few distinct
    /// integers has categories. If its type is floating-point, most triangles must also have one value at all corners,
    /// as labels do.
    pub(crate) fn values(
        &mut self,
        cloud: SplatCloud,
        attribute: &str,
        colors: &Colors,
    ) -> Result<SplatCloud, ModelError> {
        let Some(column) = ExtraColumn::find(&self.mesh.vertex_extras, attribute) else {
            return self.with_column(cloud, attribute, true);
        };
        let mut tally = Tally::new(&column.name, colors);
        tally.add((0..column.values.len()).map(|i| column.values.get(i)));
        let is_sure = column.values.is_integer() || is_class(&column.name) || colors.are_categories();
        let are_categories = matches!(tally.scale(None), ColorScale::Categories(_))
            && (is_sure || is_constant_over_most(&self.mesh, &column.values));
        self.with_column(cloud, attribute, are_categories)
    }

    /// Adds the column `name` to the splats, if the mesh has it. If `is_nearest` is true, each splat gets the value of
    /// the nearest vertex; otherwise values are interpolated. A column of faces gives each splat the value of its face.
    fn with_column(&mut self, cloud: SplatCloud, name: &str, is_nearest: bool) -> Result<SplatCloud, ModelError> {
        let Self { mesh, places } = self;
        let of_vertices = ExtraColumn::find(&mesh.vertex_extras, name);
        let Some(column) = of_vertices.or_else(|| ExtraColumn::find(&mesh.triangle_extras, name)) else {
            return Ok(cloud);
        };
        let places = places.get_or_insert_with(|| MeshPlaces::new(mesh, &cloud));
        let values: ExtraValues = match of_vertices {
            Some(_) if is_nearest => places.of_nearest_vertices(&column.values, mesh),
            Some(_) => places.interpolated(&column.values),
            None => places.of_triangles(&column.values),
        };
        let name = column.name.clone();
        let mut data = cloud.into_data();
        data.extras.retain(|extra| extra.name != name);
        data.extras.push(ExtraColumn { name, values });
        Ok(SplatCloud::new(data, OnInvalid::Refuse)?.0)
    }
}

/// True if a vertex column has the same value at all three corners of more than half of the triangles.
fn is_constant_over_most(mesh: &Mesh, column: &ExtraValues) -> bool {
    let is_constant = |triangle: &&[u32; 3]| {
        let [a, b, c] = triangle.map(|i| column.get(i as usize));
        a == b && b == c
    };
    2 * mesh.triangles.iter().filter(is_constant).count() > mesh.triangles.len()
}

/// Returns a column's name, and true if its values are integers, which aren't interpolated.
fn named(extra: &ExtraColumn) -> (String, bool) {
    (extra.name.clone(), extra.values.is_integer())
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Column3;

    #[test]
    fn whole_numbers_with_a_fraction_s_type_are_labels_where_triangles_have_one() {
        let positions = (0..12).map(|i| glam::DVec3::new(f64::from(i / 2), f64::from(i % 2), 0.0)).collect::<Vec<_>>();
        let triangles: Vec<[u32; 3]> = (0..10).map(|i| [i, i + 1 + i % 2, i + 2 - i % 2]).collect();
        let splats = |values: ExtraValues| {
            let vertex_extras = vec![ExtraColumn { name: "a".into(), values }];
            let positions = Column3::from_f64(&positions);
            let mesh = Mesh { positions, triangles: triangles.clone(), vertex_extras, ..Mesh::default() };
            let cloud = SplatCloud::disks(&[[0.7, 0.5, 0.0]], &[[0.0, 0.0, 1.0_f32]], &[1.0_f32]).unwrap();
            let cloud = MeshColumns::new(mesh).unwrap().values(cloud, "a", &Colors::default()).unwrap();
            cloud.data().extras[0].values.get(0)
        };
        let columns = |f: fn(u32) -> u32| (0..12).map(|i| f(i / 2)).collect::<Vec<u32>>();
        let floats = |f: fn(u32) -> u32| ExtraValues::F32(columns(f).iter().map(|v| *v as f32).collect());
        // Measurements in steps of ten, and labels of two halves.
        assert!((splats(floats(|x| 10 * x)) - 7.0).abs() < 1e-5);
        assert_eq!(splats(ExtraValues::U32(columns(|x| 10 * x))), 10.0);
        assert_eq!(splats(floats(|x| if x < 1 { 5 } else { 9 })), 9.0);
    }
}
