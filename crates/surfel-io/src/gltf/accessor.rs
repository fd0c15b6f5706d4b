//! Accessors decoded to columns of floats or indices, with every bound checked.

use super::buffers::Asset;
use super::document::out_of_range;
use crate::error::Problem;
use gltf::Accessor;
use gltf::accessor::{DataType, Dimensions};
use gltf::buffer::View;

/// Raw elements of an accessor, or the indices or values of its sparse part, as a buffer stores them.
struct Elements<'a> {
    data: &'a [u8],
    count: usize,
    stride: usize,
    size: usize,
}

impl<'a> Elements<'a> {
    fn iter(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let (data, stride, size) = (self.data, self.stride, self.size);
        (0..self.count).map(move |i| &data[i * stride..i * stride + size])
    }
}

impl Asset<'_> {
    fn elements(&self, view: &View<'_>, offset: usize, count: usize, size: usize) -> Result<Elements<'_>, Problem> {
        let data = self.view(view)?;
        let (stride, index) = (view.stride().unwrap_or(size), view.index());
        if stride < size {
            let what = format!("bufferView {index} has a stride of {stride} bytes");
            return Err(Problem::new(what).expected(format!("at least {size}, an element's size")));
        }
        let needed = count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size));
        match data.get(offset..).filter(|data| needed.is_some_and(|n| n <= data.len())) {
            Some(data) => Ok(Elements { data, count, stride, size }),
            None => Err(Problem::new(format!("an accessor of {count} elements reaches beyond bufferView {index}"))
                .expected(format!("at most {} bytes from offset {offset} on", data.len()))
                .help("export the file again: it is damaged")),
        }
    }

    /// Returns an accessor's values, `N` numbers per element; normalised integers become fractions. A VEC3 can be read
    /// as four numbers, the last of which is 1.
    pub(super) fn floats<const N: usize>(&self, accessor: &Accessor<'_>) -> Result<Vec<[f32; N]>, Problem> {
        let (index, kind) = (accessor.index(), accessor.data_type());
        let found = accessor.dimensions().multiplicity();
        let is_vector = !matches!(accessor.dimensions(), Dimensions::Mat2 | Dimensions::Mat3 | Dimensions::Mat4);
        // Matrix columns are padded to four bytes, which has no effect on floats.
        let matches =
            if is_vector { found == N || (found == 3 && N == 4) } else { found == N && kind == DataType::F32 };
        if !matches || (N == 4 && !is_vector) {
            let name = format!("{:?}", accessor.dimensions()).to_uppercase();
            let what = format!("accessor {index} is '{name}' of type {}", kind.as_gl_enum());
            return Err(Problem::new(what).expected(format!("{N} numbers an element")));
        }
        let (bytes, normalized, count) = (kind.size(), accessor.normalized(), accessor.count());
        let decode = |raw: &[u8]| -> [f32; N] {
            let mut value = [1.0; N];
            for (v, raw) in value.iter_mut().zip(raw.chunks_exact(bytes)) {
                *v = component(raw, kind, normalized);
            }
            value
        };
        let size = found * bytes;
        let mut values: Vec<[f32; N]> = match accessor.view() {
            Some(view) => self.elements(&view, accessor.offset(), count, size)?.iter().map(decode).collect(),
            None => {
                // An accessor without a buffer view is all zeros. Its count, which no data limit, is limited by the
                // size of all buffers.
                if count > self.total_bytes() {
                    let what = format!("accessor {index} has {count} elements and no data");
                    return Err(Problem::new(what).expected("a bufferView"));
                }
                vec![[0.0; N]; count]
            }
        };
        if let Some(sparse) = accessor.sparse() {
            let (indices, replacing) = (sparse.indices(), sparse.values());
            let kind = match indices.index_type() {
                gltf::accessor::sparse::IndexType::U8 => DataType::U8,
                gltf::accessor::sparse::IndexType::U16 => DataType::U16,
                gltf::accessor::sparse::IndexType::U32 => DataType::U32,
            };
            let places = self.integers(&indices.view(), indices.offset(), sparse.count(), kind)?;
            let replacing = self.elements(&replacing.view(), replacing.offset(), sparse.count(), size)?;
            for (place, raw) in places.into_iter().zip(replacing.iter()) {
                let total = values.len();
                let value = values.get_mut(place as usize);
                *value.ok_or_else(|| out_of_range("sparse element", place as usize, total))? = decode(raw);
            }
        }
        Ok(values)
    }

    /// Returns the numbers of an accessor that contains vertex indices. Sparse accessors, and those without a buffer
    /// view, are an error.
    pub(super) fn indices(&self, accessor: &Accessor<'_>) -> Result<Vec<u32>, Problem> {
        let plain = accessor.dimensions() == Dimensions::Scalar && accessor.sparse().is_none();
        let Some(view) = accessor.view().filter(|_| plain) else {
            let what = format!("accessor {} holds no plain indices", accessor.index());
            return Err(Problem::new(what).expected("SCALAR integers"));
        };
        self.integers(&view, accessor.offset(), accessor.count(), accessor.data_type())
    }

    fn integers(&self, view: &View<'_>, offset: usize, count: usize, kind: DataType) -> Result<Vec<u32>, Problem> {
        if !matches!(kind, DataType::U8 | DataType::U16 | DataType::U32) {
            let what = format!("indices are of type {}", kind.as_gl_enum());
            return Err(Problem::new(what).expected("5121, 5123 or 5125"));
        }
        let elements = self.elements(view, offset, count, kind.size())?;
        Ok(elements.iter().map(|raw| raw.iter().rev().fold(0, |value, &b| value << 8 | u32::from(b))).collect())
    }
}

fn component(raw: &[u8], kind: DataType, normalized: bool) -> f32 {
    let value = match (kind, raw) {
        (DataType::I8, &[a]) => f32::from(a as i8),
        (DataType::U8, &[a]) => f32::from(a),
        (DataType::I16, &[a, b]) => f32::from(i16::from_le_bytes([a, b])),
        (DataType::U16, &[a, b]) => f32::from(u16::from_le_bytes([a, b])),
        (DataType::U32, &[a, b, c, d]) => u32::from_le_bytes([a, b, c, d]) as f32,
        (DataType::F32, &[a, b, c, d]) => f32::from_le_bytes([a, b, c, d]),
        _ => f32::NAN,
    };
    if normalized { fraction(value, kind) } else { value }
}

/// Converts a normalised integer to a fraction of its number type's largest value, at least −1; returns floats
/// unchanged.
pub(super) fn fraction(value: f32, kind: DataType) -> f32 {
    let largest = match kind {
        DataType::I8 => 127.0,
        DataType::U8 => 255.0,
        DataType::I16 => 32_767.0,
        DataType::U16 => 65_535.0,
        DataType::U32 => u32::MAX as f32,
        DataType::F32 => return value,
    };
    (value / largest).max(-1.0)
}
