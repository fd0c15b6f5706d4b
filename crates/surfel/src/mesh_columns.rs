//! Properties of a mesh's vertices and faces as columns of its splats.

use crate::coloring::ColorScale;
use crate::coloring::tally::Tally;
use surfel_model::{Colormap, ExtraColumn, ExtraValues, Mesh, ModelError, OnInvalid, SplatCloud};
use surfel_sample::MeshPlaces;

/// A mesh with columns, and where its splats are on it once that is needed.
pub(crate) struct MeshColumns {
    mesh: Mesh,
    places: Option<MeshPlaces>,
}

impl MeshColumns {
    /// `None` for a mesh without columns.
    pub(crate) fn new(mesh: Mesh) -> Option<Self> {
        let has_any = !mesh.vertex_extras.is_empty() || !mesh.triangle_extras.is_empty();
        has_any.then_some(Self { mesh, places: None })
    }

    /// The names of the columns, of vertices and of faces.
    pub(crate) fn names(&self) -> Vec<String> {
        let all = self.mesh.vertex_extras.iter().chain(&self.mesh.triangle_extras);
        all.map(|extra| extra.name.escape_debug().to_string()).collect()
    }

    /// Gives splats all columns: numbers with fractions interpolated over triangles, whole numbers those of the nearest
    /// vertex.
    pub(crate) fn all(&mut self, cloud: SplatCloud) -> Result<SplatCloud, ModelError> {
        let columns: Vec<(String, bool)> = self.mesh.vertex_extras.iter().map(named).collect();
        let of_triangles: Vec<String> = self.mesh.triangle_extras.iter().map(|extra| extra.name.clone()).collect();
        let names = columns.into_iter().chain(of_triangles.into_iter().map(|name| (name, true)));
        names
            .collect::<Vec<_>>()
            .into_iter()
            .try_fold(cloud, |cloud, (name, is_nearest)| self.with_column(cloud, &name, is_nearest))
    }

    /// Gives splats the column that labels are made of: each the value of the nearest vertex, or of its face.
    pub(crate) fn labels(&mut self, cloud: SplatCloud, attribute: &str) -> Result<SplatCloud, ModelError> {
        self.with_column(cloud, attribute, true)
    }

    /// Gives splats the column that they are coloured by: interpolated over triangles if it is a measure, else of the
    /// nearest vertex, because nothing lies between two categories.
    pub(crate) fn values(
        &mut self,
        cloud: SplatCloud,
        attribute: &str,
        (map, range): (Option<Colormap>, Option<[f64; 2]>),
    ) -> Result<SplatCloud, ModelError> {
        let Some(column) = ExtraColumn::find(&self.mesh.vertex_extras, attribute) else {
            return self.with_column(cloud, attribute, true);
        };
        let mut tally = Tally::new(&column.name, map, range);
        tally.add((0..column.values.len()).map(|i| column.values.get(i)));
        let are_categories = matches!(tally.scale(None), ColorScale::Categories(_));
        self.with_column(cloud, attribute, are_categories)
    }

    /// With the column of this name, if the mesh has it.
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

/// A column's name, and whether its values are whole numbers.
fn named(extra: &ExtraColumn) -> (String, bool) {
    (extra.name.clone(), extra.values.is_integer())
}
