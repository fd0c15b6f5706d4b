//! glTF accessors as columns of floats or indices, every bound checked.

use super::Gltf;
use super::document::{Accessor, BufferView};
use crate::error::{Problem, quote};

/// The raw elements of an accessor or of its sparse part.
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

fn components(kind: &str) -> Option<usize> {
    Some(match kind {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" => 4,
        _ => return None,
    })
}

fn component_bytes(component_type: u32) -> Option<usize> {
    Some(match component_type {
        5120 | 5121 => 1,
        5122 | 5123 => 2,
        5125 | 5126 => 4,
        _ => return None,
    })
}

impl Gltf<'_> {
    fn accessor(&self, index: usize) -> Result<&Accessor, Problem> {
        let accessors = &self.document.accessors;
        accessors.get(index).ok_or_else(|| out_of_range("accessor", index, accessors.len()))
    }

    fn view(&self, index: usize) -> Result<(&BufferView, &[u8]), Problem> {
        let views = &self.document.buffer_views;
        let view = views.get(index).ok_or_else(|| out_of_range("bufferView", index, views.len()))?;
        let buffer = self.buffers.get(view.buffer);
        let buffer = buffer.ok_or_else(|| out_of_range("buffer", view.buffer, self.buffers.len()))?;
        let end = view.byte_offset.checked_add(view.byte_length);
        let data = end.and_then(|end| buffer.get(view.byte_offset..end)).ok_or_else(|| {
            let what = format!("bufferView {index} reaches beyond buffer {}", view.buffer);
            Problem::new(what).expected(format!("at most {} bytes", buffer.len()))
        })?;
        Ok((view, data))
    }

    /// The bytes of a buffer view.
    pub(super) fn view_bytes(&self, index: usize) -> Result<&[u8], Problem> {
        Ok(self.view(index)?.1)
    }

    fn elements(&self, view: usize, offset: usize, count: usize, size: usize) -> Result<Elements<'_>, Problem> {
        let (view_def, data) = self.view(view)?;
        let stride = view_def.byte_stride.unwrap_or(size);
        if stride < size {
            let what = format!("bufferView {view} has a stride of {stride} bytes");
            return Err(Problem::new(what).expected(format!("at least {size}, an element's size")));
        }
        let needed = count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size));
        match data.get(offset..).filter(|data| needed.is_some_and(|n| n <= data.len())) {
            Some(data) => Ok(Elements { data, count, stride, size }),
            None => Err(Problem::new(format!("an accessor of {count} elements reaches beyond bufferView {view}"))
                .expected(format!("at most {} bytes from offset {offset} on", data.len()))
                .help("export the file again: it is damaged")),
        }
    }

    /// An accessor's values, `N` a vertex; normalised integers become fractions. A VEC3 may be asked for as four
    /// numbers, which gives it a 1 at the end.
    pub(super) fn floats<const N: usize>(&self, index: usize) -> Result<Vec<[f32; N]>, Problem> {
        let accessor = self.accessor(index)?;
        let found = components(&accessor.kind).filter(|&n| n == N || (n == 3 && N == 4));
        let bytes = component_bytes(accessor.component_type);
        let (Some(found), Some(bytes)) = (found, bytes) else {
            let kind = quote(&accessor.kind);
            let what = format!("accessor {index} is {kind} of type {}", accessor.component_type);
            return Err(Problem::new(what).expected(format!("{N} numbers an element")));
        };
        let decode = |raw: &[u8]| -> [f32; N] {
            let mut value = [1.0; N];
            for (v, raw) in value.iter_mut().zip(raw.chunks_exact(bytes)) {
                *v = component(raw, accessor.component_type, accessor.normalized);
            }
            value
        };
        let size = found * bytes;
        let mut values: Vec<[f32; N]> = match accessor.buffer_view {
            Some(view) => self.elements(view, accessor.byte_offset, accessor.count, size)?.iter().map(decode).collect(),
            None => {
                // All zeros: the only count that no bytes back, so it is held against the whole file.
                let limit = self.buffers.iter().map(|b| b.len()).sum::<usize>();
                if accessor.count > limit {
                    let what = format!("accessor {index} has {} elements and no data", accessor.count);
                    return Err(Problem::new(what).expected("a bufferView"));
                }
                vec![[0.0; N]; accessor.count]
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let places = self.integers(
                sparse.indices.buffer_view,
                sparse.indices.byte_offset,
                sparse.count,
                sparse.indices.component_type,
            )?;
            let replacements =
                self.elements(sparse.values.buffer_view, sparse.values.byte_offset, sparse.count, size)?;
            for (place, raw) in places.into_iter().zip(replacements.iter()) {
                let total = values.len();
                let value = values.get_mut(place as usize);
                *value.ok_or_else(|| out_of_range("sparse element", place as usize, total))? = decode(raw);
            }
        }
        Ok(values)
    }

    /// An accessor's indices.
    pub(super) fn indices(&self, index: usize) -> Result<Vec<u32>, Problem> {
        let accessor = self.accessor(index)?;
        let (Some(view), None, "SCALAR") = (accessor.buffer_view, &accessor.sparse, accessor.kind.as_str()) else {
            return Err(Problem::new(format!("accessor {index} holds no plain indices")).expected("SCALAR integers"));
        };
        self.integers(view, accessor.byte_offset, accessor.count, accessor.component_type)
    }

    fn integers(&self, view: usize, offset: usize, count: usize, kind: u32) -> Result<Vec<u32>, Problem> {
        let Some(size) = component_bytes(kind).filter(|_| matches!(kind, 5121 | 5123 | 5125)) else {
            return Err(Problem::new(format!("indices are of type {kind}")).expected("5121, 5123 or 5125"));
        };
        let elements = self.elements(view, offset, count, size)?;
        Ok(elements.iter().map(|raw| raw.iter().rev().fold(0, |value, &b| value << 8 | u32::from(b))).collect())
    }
}

fn component(raw: &[u8], kind: u32, normalized: bool) -> f32 {
    let (value, largest): (f32, f32) = match (kind, raw) {
        (5120, &[a]) => (f32::from(a as i8), 127.0),
        (5121, &[a]) => (f32::from(a), 255.0),
        (5122, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), 32_767.0),
        (5123, &[a, b]) => (f32::from(u16::from_le_bytes([a, b])), 65_535.0),
        (5125, &[a, b, c, d]) => (u32::from_le_bytes([a, b, c, d]) as f32, u32::MAX as f32),
        (5126, &[a, b, c, d]) => return f32::from_le_bytes([a, b, c, d]),
        _ => return f32::NAN,
    };
    if normalized { (value / largest).max(-1.0) } else { value }
}

pub(super) fn out_of_range(what: &str, index: usize, count: usize) -> Problem {
    Problem::new(format!("{what} {index} does not exist: there are {count}"))
        .help("export the file again: it is damaged")
}
