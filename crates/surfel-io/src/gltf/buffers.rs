//! Buffers and buffer views, decompressed if they use `EXT_meshopt_compression`.

use super::document::CheckedDocument;
use super::uri;
use crate::error::{Fault, Problem, quote};
use crate::files::Siblings;
use gltf::buffer::View;
use serde_json::Value;
use std::borrow::Cow;
use std::cell::{Cell, OnceCell};

/// Maximum number of bytes that all compressed buffer views and meshes of a file together may unpack to; more are an
/// error.
pub(super) const MAX_DECOMPRESSED: usize = 2 << 30;

/// A glTF document with the bytes of its buffers.
pub(super) struct Asset<'a> {
    pub(super) document: &'a CheckedDocument,
    buffers: Vec<Cow<'a, [u8]>>,
    /// Decompressed bytes of each buffer view, by the view's index. Only views with `EXT_meshopt_compression` are
    /// decompressed, each on first use.
    decompressed: Vec<OnceCell<Result<Vec<u8>, Problem>>>,
    decompressed_bytes: Cell<usize>,
}

/// Reads all buffers of a document. `binary` is the buffer inside a GLB file, which is the document's first one.
pub(super) fn load<'a>(
    document: &'a CheckedDocument,
    binary: Option<&'a [u8]>,
    siblings: &Siblings,
) -> Result<Asset<'a>, Fault> {
    let mut buffers = Vec::new();
    for (i, buffer) in document.gltf.as_json().buffers.iter().enumerate() {
        let data: Cow<'_, [u8]> = match (&buffer.uri, binary) {
            (Some(uri), _) => match uri::read(uri, siblings) {
                Ok(data) => Cow::Owned(data),
                Err(why) => {
                    let shown = uri.get(..60).unwrap_or(uri);
                    let problem = Problem::new(format!("can't read buffer {i}, {}: {why}", quote(shown)));
                    return Err(problem.help("keep the .bin file beside the .gltf file").into());
                }
            },
            (None, Some(binary)) if i == 0 => Cow::Borrowed(binary),
            // A fallback buffer for readers without meshopt; the compressed views are in another buffer.
            _ if document.meshopt("buffers", i).is_some() => {
                buffers.push(Cow::Borrowed(&[][..]));
                continue;
            }
            (None, _) => return Err(Problem::new(format!("buffer {i} has no data")).expected("a uri").into()),
        };
        let needed = buffer.byte_length.0;
        if (data.len() as u64) < needed {
            let what = format!("buffer {i} has {} bytes", data.len());
            return Err(Problem::new(what).expected(format!("{needed}, as it says")).into());
        }
        buffers.push(data);
    }
    let decompressed = document.gltf.views().map(|_| OnceCell::new()).collect();
    Ok(Asset { document, buffers, decompressed, decompressed_bytes: Cell::new(0) })
}

impl Asset<'_> {
    /// Returns the number of bytes of all buffers together.
    pub(super) fn total_bytes(&self) -> usize {
        self.buffers.iter().map(|b| b.len()).sum()
    }

    /// Returns the bytes of a buffer view, decompressed if necessary.
    pub(super) fn view(&self, view: &View<'_>) -> Result<&[u8], Problem> {
        let packed = self.document.meshopt("bufferViews", view.index());
        let Some((packed, cell)) = packed.zip(self.decompressed.get(view.index())) else {
            return self.range(view.buffer().index(), view.offset(), view.length(), view.index());
        };
        match cell.get_or_init(|| self.decompress(view, packed)) {
            Ok(data) => Ok(data),
            Err(problem) => Err(problem.clone()),
        }
    }

    /// Returns the bytes of the buffer view with index `index`, which may not exist.
    pub(super) fn view_at(&self, index: usize) -> Result<&[u8], Problem> {
        let views = self.document.gltf.views();
        let count = views.len();
        let view = self.document.gltf.views().nth(index);
        self.view(&view.ok_or_else(|| super::document::out_of_range("bufferView", index, count))?)
    }

    fn range(&self, buffer: usize, offset: usize, length: usize, view: usize) -> Result<&[u8], Problem> {
        let buffers = self.buffers.len();
        let data = self.buffers.get(buffer);
        let data = data.ok_or_else(|| super::document::out_of_range("buffer", buffer, buffers))?;
        offset.checked_add(length).and_then(|end| data.get(offset..end)).ok_or_else(|| {
            let what = format!("bufferView {view} reaches beyond buffer {buffer}");
            Problem::new(what).expected(format!("at most {} bytes", data.len()))
        })
    }

    /// Counts `bytes` more decompressed bytes of the file; returns an error beyond [`MAX_DECOMPRESSED`]. The limit is
    /// necessary because any number of views and meshes can refer to the same few bytes.
    pub(super) fn spend_decompressed(&self, bytes: usize) -> Result<(), Problem> {
        let total = self.decompressed_bytes.get().saturating_add(bytes);
        if total > MAX_DECOMPRESSED {
            let what = format!("what is compressed comes to more than {MAX_DECOMPRESSED} bytes");
            return Err(Problem::new(what).help("split it into several files"));
        }
        self.decompressed_bytes.set(total);
        Ok(())
    }

    fn decompress(&self, view: &View<'_>, packed: &Value) -> Result<Vec<u8>, Problem> {
        let number = |key: &str| packed.get(key).and_then(Value::as_u64).and_then(|n| usize::try_from(n).ok());
        let text = |key: &str| packed.get(key).and_then(Value::as_str);
        let wrong = |why: &str| {
            Problem::new(format!("bufferView {} is not well compressed: {why}", view.index()))
                .help("export the file again: it is damaged")
        };
        let (Some(buffer), Some(length), Some(stride), Some(count), Some(mode)) =
            (number("buffer"), number("byteLength"), number("byteStride"), number("count"), text("mode"))
        else {
            return Err(wrong("it lacks its buffer, byteLength, byteStride, count or mode"));
        };
        let source = self.range(buffer, number("byteOffset").unwrap_or(0), length, view.index())?;
        let size = count.checked_mul(stride).ok_or_else(|| wrong("its size is beyond any memory"))?;
        // The densest possible data: four columns of 256 equal bytes are compressed to one byte.
        if size > source.len().saturating_mul(1100).saturating_add(4096) {
            return Err(wrong("it says that it has more elements than its bytes can hold"));
        }
        if size < view.length() {
            return Err(wrong("it has fewer elements than its byteLength says"));
        }
        self.spend_decompressed(size)?;
        unpack(source, count, stride, mode, text("filter").unwrap_or("NONE")).map_err(|why| wrong(&why))
    }
}

#[cfg(feature = "meshopt")]
fn unpack(source: &[u8], count: usize, stride: usize, mode: &str, filter: &str) -> Result<Vec<u8>, String> {
    use draco_gltf::meshopt::{MeshoptFilter, MeshoptMode, decode_buffer_view};
    let mode = MeshoptMode::from_name(mode).map_err(|e| e.to_string())?;
    let filter = MeshoptFilter::from_name(filter).map_err(|e| e.to_string())?;
    if stride == 0 || stride > 256 {
        return Err(format!("its elements have {stride} bytes"));
    }
    let mut data = vec![0; count * stride];
    // The decoder checks its bounds. If it panics nevertheless, the file is refused and the program continues.
    let decode = || decode_buffer_view(&mut data, source, mode, filter, count, stride).map_err(|e| e.to_string());
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode))
        .unwrap_or_else(|_| Err("it can't be read".into()))?;
    Ok(data)
}

#[cfg(not(feature = "meshopt"))]
fn unpack(_: &[u8], _: usize, _: usize, _: &str, _: &str) -> Result<Vec<u8>, String> {
    Err("this build reads no compressed buffers (Cargo feature \"meshopt\" of surfel-io)".into())
}
