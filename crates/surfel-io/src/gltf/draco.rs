//! Meshes compressed by `KHR_draco_mesh_compression`.

use super::buffers::Asset;
use super::document::DRACO;
use crate::error::Problem;
use gltf::Primitive;

#[cfg(feature = "draco")]
pub(super) use enabled::DracoMesh;

/// Decompresses a primitive of the mesh with index `mesh`. Returns `None` if the primitive isn't compressed.
#[cfg(feature = "draco")]
pub(super) fn decode(asset: &Asset<'_>, primitive: &Primitive<'_>, mesh: usize) -> Result<Option<DracoMesh>, Problem> {
    asset
        .document
        .primitive_extension(primitive, mesh, DRACO)
        .map(|extension| enabled::decode(asset, extension))
        .transpose()
}

/// Replacement in builds without Draco: returns an error for a compressed primitive without uncompressed data.
#[cfg(not(feature = "draco"))]
pub(super) fn decode(asset: &Asset<'_>, primitive: &Primitive<'_>, mesh: usize) -> Result<Option<DracoMesh>, Problem> {
    let has_data = primitive.get(&gltf::Semantic::Positions).is_some_and(|a| a.view().is_some());
    if asset.document.primitive_extension(primitive, mesh, DRACO).is_none() || has_data {
        return Ok(None);
    }
    let problem = Problem::new(format!("needs the glTF extension {DRACO}, which is not read"));
    Err(problem.help("build with the Cargo feature \"draco\" of surfel-io"))
}

/// Placeholder for decompressed meshes, which don't exist in builds without Draco.
#[cfg(not(feature = "draco"))]
pub(super) enum DracoMesh {}

#[cfg(not(feature = "draco"))]
impl DracoMesh {
    pub(super) fn floats<const N: usize>(&self, _: &str, _: bool) -> Option<Vec<[f32; N]>> {
        match *self {}
    }

    pub(super) fn corners(&self) -> Vec<u32> {
        match *self {}
    }
}

#[cfg(feature = "draco")]
mod enabled {
    use super::super::accessor::fraction;
    use super::super::buffers::Asset;
    use crate::error::Problem;
    use draco_core::Mesh;
    use draco_core::draco_types::DataType as DracoType;
    use gltf::accessor::DataType;
    use serde_json::Value;
    use std::collections::BTreeMap;

    /// A mesh that was decompressed from a primitive.
    pub(crate) struct DracoMesh {
        mesh: Mesh,
        /// Ids of the attributes in the Draco stream, by glTF name.
        ids: BTreeMap<String, u32>,
    }

    pub(super) fn decode(asset: &Asset<'_>, extension: &Value) -> Result<DracoMesh, Problem> {
        let wrong = |why: &str| {
            Problem::new(format!("a mesh compressed by Draco can't be read: {why}"))
                .help("export the file again: it is damaged")
        };
        let view = extension.get("bufferView").and_then(Value::as_u64).ok_or_else(|| wrong("it has no bufferView"))?;
        let attributes = extension.get("attributes").and_then(Value::as_object);
        let attributes = attributes.ok_or_else(|| wrong("it has no attributes"))?;
        let ids = attributes
            .iter()
            .filter_map(|(name, id)| Some((name.clone(), u32::try_from(id.as_u64()?).ok()?)))
            .collect();
        let bytes = asset.view_at(usize::try_from(view).unwrap_or(usize::MAX))?;
        let mesh = crate::drc::decode(bytes).map_err(|why| wrong(&why))?;
        asset.spend_decompressed(bytes_of(&mesh))?;
        Ok(DracoMesh { mesh, ids })
    }

    /// Returns the memory that a decompressed mesh takes, in bytes, with each attribute's point indices.
    fn bytes_of(mesh: &Mesh) -> usize {
        let attributes = 0..mesh.num_attributes();
        let per_attribute = |i| mesh.attribute(i).buffer().data_size().saturating_add(4 * mesh.num_points());
        attributes.map(per_attribute).fold(12 * mesh.num_faces(), usize::saturating_add)
    }

    impl DracoMesh {
        /// Returns an attribute's values, `N` per vertex, if the stream has it. Numbers that the stream lacks are 1 if
        /// `N` is 4, else 0.
        pub(crate) fn floats<const N: usize>(&self, name: &str, normalized: bool) -> Option<Vec<[f32; N]>> {
            let attribute = self.mesh.attribute_by_unique_id(*self.ids.get(name)?)?;
            let (points, found) = (self.mesh.num_points(), usize::from(attribute.num_components()));
            let kind = match attribute.data_type() {
                DracoType::Int8 => DataType::I8,
                DracoType::Uint8 => DataType::U8,
                DracoType::Int16 => DataType::I16,
                DracoType::Uint16 => DataType::U16,
                DracoType::Uint32 => DataType::U32,
                _ => DataType::F32,
            };
            let mut values = attribute.read_f32s(points, N).as_chunks::<N>().0.to_vec();
            for value in &mut values {
                for (i, v) in value.iter_mut().enumerate() {
                    *v = match (i < found, normalized) {
                        (true, true) => fraction(*v, kind),
                        (true, false) => *v,
                        (false, _) => f32::from(u8::from(N == 4)),
                    };
                }
            }
            Some(values)
        }

        /// Returns the three vertex indices of each face.
        pub(crate) fn corners(&self) -> Vec<u32> {
            self.mesh.faces().iter().flatten().map(|point| point.0).collect()
        }
    }
}

#[cfg(all(test, feature = "draco"))]
mod tests {
    use crate::files::Siblings;
    use crate::gltf::{buffers, document};
    use serde_json::json;
    use std::path::Path;

    /// A unit square of two triangles with a colour per vertex: `tests/data/square.drc`, which the published package
    /// lacks.
    const SQUARE: &[u8] = &[
        68, 82, 65, 67, 79, 2, 2, 1, 1, 0, 0, 0, 4, 2, 1, 2, 0, 0, 1, 31, 255, 1, 17, 255, 1, 17, 2, 255, 0, 0, 0, 0,
        0, 1, 0, 9, 3, 0, 0, 0, 1, 2, 2, 3, 1, 1, 1, 0, 0, 0, 0, 0, 0, 128, 63, 0, 0, 0, 0, 0, 0, 128, 63, 0, 0, 0, 0,
        0, 0, 0, 0, 0, 0, 128, 63, 0, 0, 128, 63, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 0, 2, 3, 1,
        64, 1, 0, 1, 1, 0, 0, 0, 0, 255, 0, 0, 0,
    ];

    #[test]
    fn decompressed_meshes_count_against_the_files_limit() {
        let json = json!({"asset": {"version": "2.0"}, "buffers": [{"byteLength": SQUARE.len()}],
            "bufferViews": [{"buffer": 0, "byteLength": SQUARE.len()}]});
        let document = document::parse(json.to_string().as_bytes()).unwrap();
        let asset = buffers::load(&document, Some(SQUARE), &Siblings::of(Path::new("t"), false)).unwrap();
        let extension = json!({"bufferView": 0, "attributes": {"POSITION": 0}});
        // One mesh fits: two faces of 12 bytes, and four points with 12 and 3 bytes and two 4-byte indices.
        asset.spend_decompressed(buffers::MAX_DECOMPRESSED - 200).unwrap();
        super::enabled::decode(&asset, &extension).unwrap();
        let error = super::enabled::decode(&asset, &extension).err().unwrap();
        assert!(error.to_string().contains("what is compressed comes to more"), "{error}");
    }
}
