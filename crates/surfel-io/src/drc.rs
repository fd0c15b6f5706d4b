//! Meshes and points compressed by Draco, in files of their own.

use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Problem};
use draco_core::draco_types::DataType;
use draco_core::{DecodeLimits, DecoderBuffer, GeometryAttributeType, Mesh, MeshDecoder, PointAttribute};
use glam::{DVec3, Vec3};
use surfel_model::{Column3, ExtraColumn, ExtraValues, PointCloud};

/// Faces or points that a byte of a stream may stand for: hostile headers say more, and no real file comes near.
const MOST_PER_BYTE: u64 = 4096;

/// Decompresses a mesh or points, or says why not.
pub(crate) fn decode(bytes: &[u8]) -> Result<Mesh, String> {
    let most = (bytes.len() as u64 * MOST_PER_BYTE).saturating_add(1 << 16);
    let limits = DecodeLimits::default()
        .with_max_points(most.min(1 << 26))
        .with_max_faces(most.min(1 << 26))
        .with_max_decoded_bytes(most.saturating_mul(16).min(1 << 30));
    // The decoder checks what it reads. Should it panic all the same, the file is refused and the program goes on.
    let decode = || {
        let mut mesh = Mesh::new();
        let mut buffer = DecoderBuffer::new(bytes).with_limits(limits);
        MeshDecoder::new().decode(&mut buffer, &mut mesh).map(|()| mesh).map_err(|e| e.to_string())
    };
    let decoded = std::panic::catch_unwind(decode).unwrap_or_else(|_| Err("its stream is damaged".into()));
    decoded.map_err(|why| why.chars().take(200).map(|c| if c.is_control() { ' ' } else { c }).collect())
}

pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let mesh = decode(bytes).map_err(|why| {
        Problem::new(format!("can't be decompressed by Draco: {why}"))
            .help("copy or export the file again: it is damaged")
    })?;
    let n = mesh.num_points();
    let floats = |attribute: &PointAttribute| -> Vec<Vec3> {
        attribute.read_f32s(n, 3).as_chunks::<3>().0.iter().map(|&v| v.into()).collect()
    };
    let positions = mesh.named_attribute(GeometryAttributeType::Position).map(floats);
    let positions = positions.ok_or_else(|| Problem::new("has no positions").expected("an attribute of positions"))?;
    context.note_rounding(&positions);
    let normals = mesh.named_attribute(GeometryAttributeType::Normal).map(floats);
    let (mut colors, mut alphas) = (None, None);
    if let Some(attribute) = mesh.named_attribute(GeometryAttributeType::Color) {
        let scale = match attribute.data_type() {
            DataType::Uint8 => 255.0,
            DataType::Uint16 => 65_535.0,
            _ => 1.0,
        };
        let width = usize::from(attribute.num_components());
        let values = attribute.read_f32s(n, 4);
        let rgba = values.as_chunks::<4>().0;
        colors = (width >= 3).then(|| {
            let level = |c: f32| crate::color::linear_of_unit(f64::from(c) / f64::from(scale));
            rgba.iter().map(|&[r, g, b, _]| [r, g, b].map(level)).collect::<Vec<[f32; 3]>>()
        });
        alphas = (width == 4).then(|| rgba.iter().map(|c| c[3] / scale).collect::<Vec<f32>>());
    }
    if mesh.num_faces() == 0 {
        let mut extras = Vec::new();
        for i in 0..mesh.num_attributes() {
            let attribute = mesh.attribute(i);
            if attribute.attribute_type() == GeometryAttributeType::Generic && attribute.num_components() == 1 {
                let id = attribute.unique_id();
                let metadata = mesh.metadata().and_then(|m| m.attribute_metadata_by_unique_id(id));
                let name = metadata.and_then(|m| m.metadata().get_string("name"));
                let name = name.map_or_else(|| format!("generic_{id}"), |n| n.chars().take(60).collect());
                extras.push(ExtraColumn { name, values: ExtraValues::F32(attribute.read_f32s(n, 1)) });
            }
        }
        let positions = Column3::from_f32(positions);
        let normals = normals.map(Column3::from_f32);
        return context.points(PointCloud { positions, normals, colors, alphas, extras, ..PointCloud::default() });
    }
    let uvs = mesh.named_attribute(GeometryAttributeType::TexCoord).map(|attribute| {
        // Draco's tools keep the v of OBJ, upwards; the model has it downwards, as images.
        attribute.read_f32s(n, 2).as_chunks::<2>().0.iter().map(|&[u, v]| [u, 1.0 - v]).collect()
    });
    context.mesh(surfel_model::Mesh {
        origin: DVec3::ZERO,
        positions: Column3::from_f32(positions),
        triangles: mesh.faces().iter().map(|face| face.map(|point| point.0)).collect(),
        normals: normals.map(|n| n.iter().map(Vec3::to_array).collect()),
        colors,
        alphas,
        uvs,
        ..surfel_model::Mesh::default()
    })
}
