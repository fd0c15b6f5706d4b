//! Reader of Draco files: compressed meshes and points.

use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Problem};
use crate::ply::colors::{ColorScale, ColorType, FloatColors, MAX_FLOAT_COLOR};
use draco_core::draco_types::DataType;
use draco_core::geometry_indices::PointIndex;
use draco_core::{DecodeLimits, DecoderBuffer, GeometryAttributeType, Mesh, MeshDecoder, PointAttribute};
use glam::{DVec3, Vec3};
use surfel_model::{Column3, ExtraColumn, ExtraValues, PointCloud};

/// Maximum number of faces, and of points, per byte of a Draco stream. A stream of any size may have 65,536 more, but
/// none may have more than 2²⁶. Valid files have far fewer; headers of hostile files state more, and are refused.
const MAX_PER_BYTE: u64 = 4096;

/// Decompresses a mesh or points, or returns the reason why that fails.
pub(crate) fn decode(bytes: &[u8]) -> Result<Mesh, String> {
    let most = (bytes.len() as u64 * MAX_PER_BYTE).saturating_add(1 << 16);
    let limits = DecodeLimits::default()
        .with_max_points(most.min(1 << 26))
        .with_max_faces(most.min(1 << 26))
        .with_max_decoded_bytes(most.saturating_mul(16).min(1 << 30));
    // The decoder checks its input. If it panics nevertheless, the file is refused and the program continues.
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
    let attribute = mesh
        .named_attribute(GeometryAttributeType::Position)
        .ok_or_else(|| Problem::new("has no positions").expected("an attribute of positions"))?;
    let (origin, positions) = if fits_f32(attribute.data_type()) {
        let positions = floats(attribute);
        context.note_rounding(&positions);
        (DVec3::ZERO, Column3::from_f32(positions))
    } else {
        let rows: Vec<DVec3> = doubles(attribute, n, 3).as_chunks::<3>().0.iter().map(|&v| v.into()).collect();
        Column3::with_origin(&rows)
    };
    let normals = mesh.named_attribute(GeometryAttributeType::Normal).map(floats);
    let (mut colors, mut alphas) = (None, None);
    if let Some(attribute) = mesh.named_attribute(GeometryAttributeType::Color) {
        let width = usize::from(attribute.num_components());
        let values = attribute.read_f32s(n, 4);
        let rgba = values.as_chunks::<4>().0;
        let kind = color_type(attribute.data_type());
        colors = (width >= 3).then(|| linear_colors(rgba, kind, context));
        alphas = (width == 4).then(|| {
            let largest = rgba.iter().map(|c| f64::from(c[3])).filter(|a| a.is_finite()).fold(0.0, f64::max);
            let scale = match kind {
                ColorType::Float if largest <= MAX_FLOAT_COLOR => 1.0,
                _ if largest <= 255.0 => 255.0,
                _ => 65_535.0,
            };
            rgba.iter().map(|c| c[3] / scale).collect::<Vec<f32>>()
        });
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
                extras.push(ExtraColumn { name, values: column(attribute, n) });
            }
        }
        let normals = normals.map(Column3::from_f32);
        return context.points(PointCloud {
            origin,
            positions,
            normals,
            colors,
            alphas,
            extras,
            ..PointCloud::default()
        });
    }
    let uvs = mesh.named_attribute(GeometryAttributeType::TexCoord).map(|attribute| {
        // Draco's tools store OBJ's v, which is upwards; the model has v downwards, as images.
        attribute.read_f32s(n, 2).as_chunks::<2>().0.iter().map(|&[u, v]| [u, 1.0 - v]).collect()
    });
    context.mesh(surfel_model::Mesh {
        origin,
        positions,
        triangles: mesh.faces().iter().map(|face| face.map(|point| point.0)).collect(),
        normals: normals.map(|n| n.iter().map(Vec3::to_array).collect()),
        colors,
        alphas,
        uvs,
        ..surfel_model::Mesh::default()
    })
}

/// True if 32-bit floats represent every number of this type exactly.
fn fits_f32(kind: DataType) -> bool {
    !matches!(
        kind,
        DataType::Int32 | DataType::Uint32 | DataType::Int64 | DataType::Uint64 | DataType::Float64 | DataType::Invalid
    )
}

/// Returns a row of `width` numbers for each point, in f64; numbers that the attribute lacks are 0.
fn doubles(attribute: &PointAttribute, points: usize, width: usize) -> Vec<f64> {
    let (kind, data) = (attribute.data_type(), attribute.buffer().data());
    let (size, stride) = (kind.byte_length(), usize::try_from(attribute.byte_stride()).unwrap_or(0));
    let available = width.min(attribute.num_components().into());
    let mut rows = vec![0.0; points * width];
    for (point, row) in rows.chunks_exact_mut(width).enumerate() {
        let start = (attribute.mapped_index(PointIndex(point as u32)).0 as usize).checked_mul(stride);
        let Some(rest) = start.and_then(|start| data.get(start..)) else { continue };
        let numbers = row[..available].iter_mut().zip(rest.chunks_exact(size.max(1)));
        numbers.for_each(|(number, bytes)| *number = number_of(kind, bytes));
    }
    rows
}

/// Converts the bytes of a number to f64.
fn number_of(kind: DataType, bytes: &[u8]) -> f64 {
    macro_rules! read {
        ($number:ty) => {
            bytes.try_into().map_or(0.0, |bytes| <$number>::from_le_bytes(bytes) as f64)
        };
    }
    match kind {
        DataType::Int8 => read!(i8),
        DataType::Uint8 | DataType::Bool => read!(u8),
        DataType::Int16 => read!(i16),
        DataType::Uint16 => read!(u16),
        DataType::Int32 => read!(i32),
        DataType::Uint32 => read!(u32),
        DataType::Int64 => read!(i64),
        DataType::Uint64 => read!(u64),
        DataType::Float32 => read!(f32),
        DataType::Float64 => read!(f64),
        DataType::Invalid => 0.0,
    }
}

/// Reads an attribute of one number per point as a column of the same number type; 64-bit integers become f64.
fn column(attribute: &PointAttribute, points: usize) -> ExtraValues {
    let kind = attribute.data_type();
    if kind == DataType::Float32 {
        return ExtraValues::F32(attribute.read_f32s(points, 1));
    }
    let values = doubles(attribute, points, 1);
    match kind {
        DataType::Int8 => ExtraValues::I8(values.iter().map(|v| *v as i8).collect()),
        DataType::Uint8 | DataType::Bool => ExtraValues::U8(values.iter().map(|v| *v as u8).collect()),
        DataType::Int16 => ExtraValues::I16(values.iter().map(|v| *v as i16).collect()),
        DataType::Uint16 => ExtraValues::U16(values.iter().map(|v| *v as u16).collect()),
        DataType::Int32 => ExtraValues::I32(values.iter().map(|v| *v as i32).collect()),
        DataType::Uint32 => ExtraValues::U32(values.iter().map(|v| *v as u32).collect()),
        _ => ExtraValues::F64(values),
    }
}

fn color_type(kind: DataType) -> ColorType {
    match kind {
        DataType::Uint8 => ColorType::Byte,
        DataType::Uint16 => ColorType::Short,
        DataType::Float32 | DataType::Float64 => ColorType::Float,
        _ => ColorType::Whole,
    }
}

/// Converts colours to linear light. If their number type doesn't determine their range, it is estimated. The note of
/// [`ColorScale::note`], if there is one, is added, except for floats from 0 to 1.
fn linear_colors(rgba: &[[f32; 4]], kind: ColorType, context: &mut Context<'_>) -> Vec<[f32; 3]> {
    let all = || rgba.iter().flat_map(|c| &c[..3]).map(|c| f64::from(*c)).filter(|c| c.is_finite());
    let largest = all().fold(0.0, f64::max);
    let are_whole = kind == ColorType::Float && all().all(|c| c.fract() == 0.0);
    let scale = ColorScale::of(kind, largest, are_whole, FloatColors::Displayed);
    let says_more = kind != ColorType::Float || scale != ColorScale::Encoded(1.0);
    scale.note(kind, largest).filter(|_| says_more).into_iter().for_each(|note| context.note(note));
    let linear = scale.linear();
    rgba.iter().map(|&[r, g, b, _]| [r, g, b].map(|c| linear(c.into()))).collect()
}
