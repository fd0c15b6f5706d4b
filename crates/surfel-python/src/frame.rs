//! Planes of an image as NumPy arrays, and writing of image files.

use crate::draw::{Drawn, Recipe};
use crate::errors;
use crate::memory;
use crate::memory::py_bytes;
use numpy::{Element, PyArray1, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PySlice};
use serde_json::json;
use std::path::{Path, PathBuf};
use surfel_io::ShowPath as _;
use surfel_io::{BitDepth, ExrOptions, JpegOptions, PlanesView, PngOptions};
use surfel_load::Error;
use surfel_render::Stats;

/// Drawn image. Its arrays are read-only views of the memory that the backend wrote.
#[pyclass(frozen, module = "surfel._native", name = "Frame")]
pub(crate) struct NativeFrame {
    #[pyo3(get)]
    width: u32,
    #[pyo3(get)]
    height: u32,
    linear: Option<Py<PyAny>>,
    depth: Option<Py<PyAny>>,
    normal: Option<Py<PyAny>>,
    weight: Option<Py<PyAny>>,
    index: Option<Py<PyAny>>,
    object: Option<Py<PyAny>>,
    label: Option<Py<PyAny>>,
    position: Option<Py<PyAny>>,
    alpha: Option<Py<PyAny>>,
    median_depth: Option<Py<PyAny>>,
    distortion: Option<Py<PyAny>>,
    recipe: Option<Recipe>,
    /// Statistics of the frame, as JSON.
    #[pyo3(get)]
    stats: String,
}

/// Maximum memory for encoding an image, in bytes per pixel: rows of a file, and their compressed form.
const ENCODED_BYTES: u64 = 32;

/// Returns a range of a plane's values as a read-only array of this shape, without copying; `None` for a missing plane,
/// which has no values.
pub(crate) fn array<T: Element>(
    py: Python<'_>,
    values: Vec<T>,
    range: std::ops::Range<usize>,
    shape: &[usize],
) -> PyResult<Option<Py<PyAny>>> {
    if values.is_empty() {
        return Ok(None);
    }
    let all = PyArray1::from_vec(py, values).into_any();
    let part = all.get_item(PySlice::new(py, range.start as isize, range.end as isize, 1))?;
    let shaped = part.call_method1("reshape", (shape.to_vec(),))?;
    let arguments = PyDict::new(py);
    arguments.set_item("write", false)?;
    shaped.call_method("setflags", (), Some(&arguments))?;
    Ok(Some(shaped.unbind()))
}

fn stats_json(stats: &Stats, recipe: &Recipe) -> String {
    let passes: serde_json::Map<_, _> = stats.passes.iter().map(|p| (p.name.to_owned(), json!(p.ms))).collect();
    let text = json!({
        "frame_ms": stats.frame_ms, "passes": passes, "splats": stats.splats, "drawn": stats.drawn,
        "bytes_per_splat": stats.bytes_per_splat, "threads": stats.threads, "backend": recipe.drawn.get("backend"),
    });
    text.to_string()
}

/// Borrowed values of a plane's array; `None` for a missing plane.
type Values<'py, T> = Option<PyReadonlyArrayDyn<'py, T>>;

fn values<'py, T: Element>(py: Python<'py>, plane: Option<&Py<PyAny>>) -> PyResult<Values<'py, T>> {
    plane.map(|plane| plane.bind(py).extract()).transpose()
}

fn slice<'a, T: Element>(values: &'a Values<'_, T>) -> PyResult<Option<&'a [T]>> {
    Ok(values.as_ref().map(|values| values.as_slice()).transpose()?)
}

impl NativeFrame {
    /// Calls `use_colors` with the colour plane and the background, which is linear RGBA; transparent black without a
    /// recipe.
    pub(crate) fn with_colors<T: Send>(
        &self,
        py: Python<'_>,
        use_colors: impl FnOnce(&PlanesView<'_>, [f64; 4]) -> T + Send,
    ) -> PyResult<T> {
        let linear = values::<f32>(py, self.linear.as_ref())?;
        let color = slice(&linear)?.map(|values| values.as_chunks().0);
        let planes = PlanesView { width: self.width, height: self.height, color, ..PlanesView::default() };
        let background = self.recipe.as_ref().map_or([0.0; 4], |recipe| recipe.scene.background);
        Ok(py.detach(|| use_colors(&planes, background)))
    }

    pub(crate) fn new(py: Python<'_>, drawn: Drawn) -> PyResult<Self> {
        let Drawn { frame, stats, recipe } = drawn;
        let stats = stats_json(&stats, &recipe);
        let planes = frame.into_planes();
        let (w, h) = (planes.width as usize, planes.height as usize);
        let pixels = w * h;
        let first = 4 * planes.first;
        Ok(Self {
            width: planes.width,
            height: planes.height,
            linear: array(py, planes.color.into_flattened(), first..first + 4 * pixels, &[h, w, 4])?,
            depth: array(py, planes.depth, 0..pixels, &[h, w])?,
            normal: array(py, planes.normal.into_flattened(), 0..3 * pixels, &[h, w, 3])?,
            weight: array(py, planes.weight, 0..pixels, &[h, w])?,
            index: array(py, planes.index, 0..pixels, &[h, w])?,
            object: array(py, planes.object, 0..pixels, &[h, w])?,
            label: array(py, planes.label, 0..pixels, &[h, w])?,
            position: array(py, planes.position.into_flattened(), 0..3 * pixels, &[h, w, 3])?,
            alpha: array(py, planes.alpha, 0..pixels, &[h, w])?,
            median_depth: array(py, planes.median_depth, 0..pixels, &[h, w])?,
            distortion: array(py, planes.distortion, 0..pixels, &[h, w])?,
            recipe: Some(recipe),
            stats,
        })
    }

    /// Runs `work` on the planes without holding Python's global lock.
    pub(crate) fn with_planes<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&PlanesView<'_>) -> T + Send,
    ) -> PyResult<T> {
        let [linear, depth] = [values(py, self.linear.as_ref())?, values(py, self.depth.as_ref())?];
        let [normal, weight] = [values(py, self.normal.as_ref())?, values(py, self.weight.as_ref())?];
        let nearest = [&self.index, &self.object, &self.label].map(Option::as_ref);
        let [index, object, label] = nearest.map(|plane| values::<u32>(py, plane));
        let (index, object, label) = (index?, object?, label?);
        let position = values::<f64>(py, self.position.as_ref())?;
        let position = slice(&position)?;
        let of_gaussians = [&self.alpha, &self.median_depth, &self.distortion].map(Option::as_ref);
        let [alpha, median_depth, distortion] = of_gaussians.map(|plane| values::<f32>(py, plane));
        let (alpha, median_depth, distortion) = (alpha?, median_depth?, distortion?);
        let other =
            [("alpha", slice(&alpha)?), ("median_depth", slice(&median_depth)?), ("distortion", slice(&distortion)?)];
        let whole = [("index", slice(&index)?), ("object", slice(&object)?), ("label", slice(&label)?)];
        let (linear, depth) = (slice(&linear)?, slice(&depth)?);
        let (normal, weight) = (slice(&normal)?, slice(&weight)?);
        let (width, height) = (self.width, self.height);
        Ok(py.detach(move || {
            let planes = PlanesView {
                width,
                height,
                color: linear.map(|values| values.as_chunks::<4>().0),
                rgba8: None,
                depth,
                normal: normal.map(|values| values.as_chunks::<3>().0),
                weight,
                position: position.map(|values| values.as_chunks::<3>().0),
                other: other.into_iter().filter_map(|(name, plane)| Some((name, plane?))).collect(),
                whole: whole.into_iter().filter_map(|(name, plane)| Some((name, plane?))).collect(),
            };
            work(&planes)
        }))
    }

    /// Returns an error unless `pixel_bytes` bytes of additional memory per pixel are available.
    pub(crate) fn check_memory(&self, py: Python<'_>, pixel_bytes: u64) -> PyResult<()> {
        let pixels = u64::from(self.width) * u64::from(self.height);
        memory::check("image", pixels * pixel_bytes, 1, None).map_err(|error| errors::raise(py, &error))
    }

    fn png_options(&self, folder: &Path, sixteen: bool, metadata: bool) -> Result<PngOptions, Error> {
        let format = if sixteen { vec![("png16", json!(true))] } else { Vec::new() };
        let recipe = self.recipe.as_ref().filter(|_| metadata);
        let entries = recipe.map(|recipe| recipe.entries(folder, &format, false)).transpose()?;
        let depth = if sixteen { BitDepth::Sixteen } else { BitDepth::Eight };
        Ok(PngOptions { depth, metadata: entries.unwrap_or_default() })
    }
}

#[pymethods]
impl NativeFrame {
    #[getter]
    fn linear(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.linear.as_ref().map(|plane| plane.clone_ref(py))
    }

    #[getter]
    fn depth(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.depth.as_ref().map(|plane| plane.clone_ref(py))
    }

    #[getter]
    fn normal(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.normal.as_ref().map(|plane| plane.clone_ref(py))
    }

    #[getter]
    fn weight(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.weight.as_ref().map(|plane| plane.clone_ref(py))
    }

    #[getter]
    fn index(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.index.as_ref().map(|plane| plane.clone_ref(py))
    }

    #[getter]
    fn object(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.object.as_ref().map(|plane| plane.clone_ref(py))
    }

    #[getter]
    fn label(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.label.as_ref().map(|plane| plane.clone_ref(py))
    }

    #[getter]
    fn position(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.position.as_ref().map(|plane| plane.clone_ref(py))
    }

    #[getter]
    fn alpha(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.alpha.as_ref().map(|plane| plane.clone_ref(py))
    }

    #[getter]
    fn median_depth(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.median_depth.as_ref().map(|plane| plane.clone_ref(py))
    }

    #[getter]
    fn distortion(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        self.distortion.as_ref().map(|plane| plane.clone_ref(py))
    }

    /// Returns notes for the user, with what Surfel estimated, chose or omitted.
    #[getter]
    fn notes(&self) -> Vec<String> {
        let notes = self.recipe.as_ref().map(|recipe| &*recipe.notes);
        notes.unwrap_or_default().iter().map(|note| errors::in_python(note)).collect()
    }

    /// Returns the scene file of the image, as JSON.
    fn scene_json(&self, py: Python<'_>) -> PyResult<Option<String>> {
        let text = self.recipe.as_ref().map(Recipe::scene_json).transpose();
        text.map_err(|error| errors::raise(py, &error))
    }

    /// Returns the camera as in a scene file, as JSON.
    fn camera_json(&self, py: Python<'_>) -> PyResult<Option<String>> {
        let text = self.recipe.as_ref().map(Recipe::camera_json).transpose();
        text.map_err(|error| errors::raise(py, &error))
    }

    /// Returns the recipe as JSON. `frame_of` makes an image of the recipe and the planes.
    fn recipe(&self, py: Python<'_>) -> PyResult<Option<String>> {
        let recipe = self.recipe.as_ref();
        let text = py.detach(|| recipe.map(Recipe::to_json).transpose());
        Ok(text.map_err(|error| errors::raise(py, &error))?.flatten())
    }

    /// Returns the colours as 8-bit sRGB, as in a PNG.
    fn rgba(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        self.check_memory(py, 8)?;
        let made = self.with_planes(py, |planes| planes.color.map(surfel_io::to_srgb8))?;
        let Some(pixels) = made else { return Ok(None) };
        let (w, h) = (self.width as usize, self.height as usize);
        array(py, pixels.into_flattened(), 0..4 * w * h, &[h, w, 4])
    }

    /// Encodes the image as the PNG that `surfel -o -` writes.
    fn png<'py>(&self, py: Python<'py>, png16: bool, metadata: bool) -> PyResult<Bound<'py, PyBytes>> {
        self.check_memory(py, ENCODED_BYTES)?;
        let options = py.detach(|| self.png_options(Path::new("."), png16, metadata));
        let options = options.map_err(|error| errors::raise(py, &error))?;
        let bytes = self.with_planes(py, |planes| {
            let mut bytes = Vec::new();
            surfel_io::write_png(&mut bytes, planes, &options).map(|()| bytes)
        })?;
        py_bytes(py, &bytes?)
    }

    /// Writes the image as PNG, EXR, NPZ or JPEG, by the extension of the path.
    fn save(
        &self,
        py: Python<'_>,
        path: PathBuf,
        force: bool,
        png16: bool,
        exr_f32: bool,
        metadata: bool,
    ) -> PyResult<()> {
        self.check_memory(py, ENCODED_BYTES)?;
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let recipe = self.recipe.as_ref().filter(|_| metadata);
        let background = self.recipe.as_ref().map_or([1.0; 4], |recipe| recipe.scene.background);
        let raise = |error: Error| errors::raise(py, &error);
        let written = match extension.as_str() {
            "png" => {
                let options = py.detach(|| self.png_options(folder, png16, metadata)).map_err(raise)?;
                self.with_planes(py, |planes| surfel_io::save_png(&path, force, planes, &options))?
            }
            "exr" => {
                let format = if exr_f32 { vec![("exr-f32", json!(true))] } else { Vec::new() };
                let entries = py.detach(|| recipe.map(|recipe| recipe.entries(folder, &format, true)).transpose());
                let metadata = entries.map_err(raise)?.unwrap_or_default();
                let options = ExrOptions { f32_color: exr_f32, metadata };
                self.with_planes(py, |planes| surfel_io::save_exr(&path, force, planes, &options))?
            }
            "npz" => self.with_planes(py, |planes| surfel_io::save_npz(&path, force, planes))?,
            "jpg" | "jpeg" => {
                let [r, g, b, _] = background.map(|c| c as f32);
                let options = JpegOptions { background: [r, g, b], ..JpegOptions::default() };
                self.with_planes(py, |planes| surfel_io::save_jpeg(&path, force, planes, &options))?
            }
            _ => {
                let what = format!("path={}: expected a name that ends in .png, .jpg, .exr or .npz", path.shown());
                return Err(errors::usage(py, &what));
            }
        };
        written.map_err(|error| raise(error.into()))
    }
}

/// Creates an image from planes, given by name, and from the `stats` and `recipe` of the original image.
#[pyfunction]
#[pyo3(signature = (planes, stats = "{}".to_owned(), recipe = None))]
pub(crate) fn frame_of(
    py: Python<'_>,
    planes: &Bound<'_, PyDict>,
    stats: String,
    recipe: Option<&str>,
) -> PyResult<NativeFrame> {
    let mut size = None;
    let linear = given::<f32>(planes, "linear", &[4], &mut size)?;
    let [depth, weight, alpha, median_depth, distortion] = ["depth", "weight", "alpha", "median_depth", "distortion"]
        .map(|name| given::<f32>(planes, name, &[], &mut size));
    let normal = given::<f32>(planes, "normal", &[3], &mut size)?;
    let [index, object, label] = ["index", "object", "label"].map(|name| given::<u32>(planes, name, &[], &mut size));
    let position = given::<f64>(planes, "position", &[3], &mut size)?;
    let wrong = || errors::usage(py, "an image without a plane, or that another version of surfel drew");
    let [height, width] = size.ok_or_else(wrong)?;
    let recipe = recipe.map(|text| Recipe::from_json(text).ok_or_else(wrong)).transpose()?;
    Ok(NativeFrame {
        width: width as u32,
        height: height as u32,
        linear,
        depth: depth?,
        normal,
        weight: weight?,
        index: index?,
        object: object?,
        label: label?,
        position,
        alpha: alpha?,
        median_depth: median_depth?,
        distortion: distortion?,
        recipe,
        stats,
    })
}

/// Returns the plane `name` from `planes`; `None` if there is no such plane. Checks that the plane is contiguous and
/// has the same height and width as the planes before it, which `size` stores. Makes the plane's array read-only.
fn given<T: Element>(
    planes: &Bound<'_, PyDict>,
    name: &str,
    channels: &[usize],
    size: &mut Option<[usize; 2]>,
) -> PyResult<Option<Py<PyAny>>> {
    let Some(plane) = planes.get_item(name)? else { return Ok(None) };
    let values: PyReadonlyArrayDyn<'_, T> = plane.extract()?;
    let fits = match *values.shape() {
        [height, width, ref rest @ ..] => rest == channels && *size.get_or_insert([height, width]) == [height, width],
        _ => false,
    };
    if !fits || values.as_slice().is_err() {
        let what = format!("{name}: an array of shape {:?}, expected contiguous rows of pixels", values.shape());
        return Err(errors::usage(planes.py(), &what));
    }
    drop(values);
    let arguments = PyDict::new(planes.py());
    arguments.set_item("write", false)?;
    plane.call_method("setflags", (), Some(&arguments))?;
    Ok(Some(plane.unbind()))
}
