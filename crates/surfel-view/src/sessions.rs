//! Sessions of a viewer, which have scenes in memory, and the files and measures made from their images.

use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_app::metadata;
use surfel_app::options::Options;
use surfel_app::request::Resolved;
use surfel_app::session::{Picked, Session};
use surfel_backend::BackendOptions;
use surfel_io::{PlanesView, PngOptions, write_png};
use surfel_load::Error;
use surfel_metrics::{CompareOptions, Comparison, Image};
use surfel_render::{Frame, Planes, Renderer as _, Stats};

/// Largest number of sessions in memory: the two sides of a comparison may have different backends or inputs. If a
/// session is large, starting another one ends all older ones.
pub(crate) const MAX_SESSIONS: usize = 2;

/// Key of a session. Requests with the same backend and inputs share a session.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Key {
    pub(crate) backend: String,
    pub(crate) inputs: Vec<PathBuf>,
}

/// Sessions in memory, the most recently used one first.
pub(crate) struct Sessions {
    stdin: Option<Arc<[u8]>>,
    backend_options: BackendOptions,
    all: Vec<(Key, Session)>,
}

impl Sessions {
    /// Creates an empty list. `stdin` is the content of the input `-`.
    pub(crate) fn new(stdin: Option<Arc<[u8]>>, backend_options: BackendOptions) -> Self {
        Self { stdin, backend_options, all: Vec::new() }
    }

    /// Returns the session with this key. If no session has the key, starts one, and ends older sessions to limit the
    /// memory.
    pub(crate) fn of(&mut self, key: &Key) -> Result<&mut Session, String> {
        match self.all.iter().position(|(known, _)| known == key) {
            Some(place) => self.all[..=place].rotate_right(1),
            None => {
                let is_large = self.all.iter().any(|(_, session)| session.is_large());
                self.all.truncate(if is_large { 0 } else { MAX_SESSIONS - 1 });
                let (stdin, options) = (self.stdin.clone(), self.backend_options.clone());
                let session = Session::start(key.inputs.clone(), stdin, &key.backend, options);
                self.all.insert(0, (key.clone(), session.map_err(|e| e.to_string())?));
            }
        }
        self.all.first_mut().map(|(_, session)| session).ok_or_else(|| "no session".to_owned())
    }
}

/// Draws the shown scene and encodes it as the file that `surfel render` writes. The file replaces the content of
/// `bytes`.
pub(crate) fn draw_png(session: &mut Session, options: &Options, bytes: &mut Vec<u8>) -> Result<Stats, String> {
    bytes.clear();
    let stats = session.draw(&options.render, Planes::RGBA8).map_err(|e| e.to_string())?;
    let metadata = if options.no_metadata { Vec::new() } else { metadata_of(session, options)? };
    let png = PngOptions { metadata, ..PngOptions::default() };
    write_png(bytes, &session.frame().planes(), &png).map_err(|e| format!("can't encode the image: {e}"))?;
    Ok(stats)
}

/// Draws the shown scene for a comparison. Returns the frame and the time of drawing it, in milliseconds.
pub(crate) fn draw_timed(session: &mut Session, options: &Options) -> Result<(Frame, f64), String> {
    let text = |e: Error| e.to_string();
    // The first image after an upload also fills caches, so it isn't timed.
    session.draw(&options.render, Planes::COLOR).map_err(text)?;
    let stats = session.draw(&options.render, Planes::COLOR).map_err(text)?;
    Ok((session.frame().clone(), stats.frame_ms))
}

/// Returns the metadata that `surfel render` would write for the shown scene's image in the current folder.
fn metadata_of(session: &mut Session, options: &Options) -> Result<Vec<(String, String)>, String> {
    let text = |e: Error| e.to_string();
    let hashes = session.hashes().map_err(text)?;
    let Some(Resolved { file, .. }) = session.shown() else { return Err("no scene is shown".to_owned()) };
    let info = session.backend().info();
    let drawn = metadata::drawn(&options.render, &file.camera, options.quantised, info).map_err(text)?;
    let entries = metadata::entries(Path::new("."), file, &hashes, &drawn, false).map_err(text)?;
    Ok(entries.unwrap_or_default())
}

/// Returns a description of the picked point at pixel `at`, as JSON. `inputs` are the names of the objects' files.
pub(crate) fn picked_json(picked: Picked, at: [u32; 2], inputs: &[String]) -> Value {
    let values: Map<String, Value> = picked.values.into_iter().map(|(name, v)| (name, json!(v))).collect();
    json!({
        "position": picked.position, "normal": picked.normal, "depth": picked.depth, "at": at,
        "object": picked.row.map(|(object, _)| object),
        "input": picked.row.and_then(|(object, _)| inputs.get(object)),
        "row": picked.row.map(|(_, row)| row), "values": values,
    })
}

/// Returns a frame's colours as an image that FLIP compares with another frame's.
fn image_of(frame: &Frame) -> Result<Image<'_>, String> {
    Image::new(frame.width(), frame.height(), frame.color().as_flattened()).map_err(|e| e.to_string())
}

/// Measured difference between two frames.
pub(crate) struct Difference {
    comparison: Comparison,
    /// Error map of FLIP (the difference that a person sees, per pixel), encoded as a PNG. Empty if FLIP wasn't
    /// computed.
    pub(crate) map: Vec<u8>,
}

impl Difference {
    /// Measures the difference of `b` from the reference `a`.
    pub(crate) fn between(a: &Frame, b: &Frame) -> Result<Self, String> {
        let comparison = surfel_metrics::compare(&image_of(a)?, &image_of(b)?, &CompareOptions::default());
        let comparison = comparison.map_err(|e| e.to_string())?;
        let mut map = Vec::new();
        if let Some(flip) = &comparison.flip {
            let linear = |c: u8| surfel_math::srgb::decode(f64::from(c) / 255.0) as f32;
            let colors: Vec<[f32; 4]> =
                flip.to_magma().into_iter().map(|[r, g, b]| [linear(r), linear(g), linear(b), 1.0]).collect();
            let view =
                PlanesView { width: flip.width, height: flip.height, color: Some(&colors), ..PlanesView::default() };
            write_png(&mut map, &view, &PngOptions::default()).map_err(|e| e.to_string())?;
        }
        Ok(Self { comparison, map })
    }

    /// Returns the measures as JSON; an infinite PSNR is null.
    pub(crate) fn to_json(&self) -> Value {
        let Comparison { max_abs, rmse, flip_mean, psnr, .. } = &self.comparison;
        let psnr = if psnr.is_finite() { json!(psnr) } else { Value::Null };
        json!({ "max_abs": max_abs, "rmse": rmse, "flip": flip_mean, "psnr": psnr })
    }
}
