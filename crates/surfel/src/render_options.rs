//! What may be said about an image and about the files that it shows: the flags of `surfel render`, as data.

use crate::Error;
use crate::camera::CameraSource;
use crate::coloring::{ColorScale, Coloring};
use crate::framing::ViewChoice;
use crate::values::{self, Part, RangeChoice, switch};
use std::path::PathBuf;
use std::sync::Arc;
use surfel_model::{
    Accumulate, Camera, ClipPolicy, Colormap, Composite, Condition, ConvertOptions, Cull, DepthTolerance, EdgeAa,
    Filter, Light, Mapping, Shader, Sort, TextureSampling, Transparency, Up,
};
use surfel_render::{Planes, Preset, Region};

/// The flags of `surfel render` that decide what an image shows. What isn't said is left to the scene file, the preset
/// and the defaults, in this order ([`crate::request`]).
///
/// ```
/// let mut options = surfel::request::RenderOptions::default();
/// options.set("size", "640x480")?;
/// options.set("edge-aa", "samples")?;
/// assert_eq!(options.size, Some([640, 480]));
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct RenderOptions {
    /// How files become splats.
    pub splats: SplatOptions,
    /// Image width and height in pixels.
    pub size: Option<[u32; 2]>,
    /// A scene file's camera object.
    pub camera: Option<CameraSource>,
    /// Lights in place of the scene's, or of those that stay with the camera; no flag has them.
    pub lights: Option<Vec<Light>>,
    /// Cameras of another program give the images: one light along the view serves all, and near planes are chosen.
    pub cameras: bool,
    /// Where to look from.
    pub view: Option<ViewChoice>,
    /// Position of the eye, world units.
    pub eye: Option<[f64; 3]>,
    /// Point to look at, world units.
    pub target: Option<[f64; 3]>,
    /// Direction that appears upward; not zero.
    pub camera_up: Option<[f64; 3]>,
    /// The scene's up axis; `Some(None)`: as the file or its format says, else by the shape.
    pub up: Option<Option<Up>>,
    /// The part of the image that is rendered.
    pub region: Option<Region>,
    /// Only this band of the image's rows is rendered, of so many.
    pub tile: Option<Part>,
    /// Vertical field of view, in degrees between 0 and 180.
    pub fov_y: Option<f64>,
    /// Parallel projection.
    pub ortho: bool,
    /// Named trade of speed for accuracy.
    pub preset: Option<Preset>,
    /// Screen-space filter.
    pub filter: Option<Filter>,
    /// How splats are mapped to the screen.
    pub mapping: Option<Mapping>,
    /// Kernel cutoff: more than 0, at most 50.
    pub cutoff: Option<f64>,
    /// Least half-width of a filtered splat, in pixels.
    pub prefilter: Option<f64>,
    /// How far behind the nearest surface splats still blend.
    pub depth_tolerance: Option<DepthTolerance>,
    /// Precision of sums, at least.
    pub accumulate: Option<Accumulate>,
    /// How transparent splats are drawn.
    pub transparency: Option<Transparency>,
    /// How trained Gaussians are drawn; `None`: over one another, unless options are given that surfaces alone have a
    /// use for.
    pub composite: Option<Composite>,
    /// In which order trained Gaussians are drawn over one another.
    pub sort: Option<Sort>,
    /// How clip curves are evaluated.
    pub clip: Option<ClipPolicy>,
    /// How pixels are shaded.
    pub shader: Option<Shader>,
    /// Image of a lit sphere for the shader matcap, which this chooses; `builtin` is one without a file.
    pub matcap: Option<PathBuf>,
    /// Octrees and COPC files: splats of at most this many pixels.
    pub lod_error: Option<f64>,
    /// COPC files: all points, not only as many as the view needs.
    pub all_levels: bool,
    /// Lights cast shadows.
    pub shadows: bool,
    /// How edges are antialiased.
    pub edge_aa: Option<EdgeAa>,
    /// Background: linear RGB and straight alpha.
    pub background: Option<[f64; 4]>,
    /// So many unfiltered samples along a pixel's side (backend reference only).
    pub samples: Option<u32>,
    /// Planes besides others: some of [`RenderOptions::MORE_PLANES`].
    pub planes: Vec<String>,
    /// The attribute that the plane `label` shows, which this asks for; `None`: [`crate::labels::DEFAULT_LABEL`].
    pub label: Option<String>,
    /// The framed camera leaves room for the scene to turn about its up axis.
    pub turntable: bool,
    /// Interior weights are estimated for the preset that the image is verified against.
    pub verify: bool,
}

/// How files become splats: the flags that `surfel render` and `surfel convert` share.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SplatOptions {
    /// All but the others here, by the names of a scene file's `convert`.
    pub convert: ConvertOptions,
    /// Splats that face away are left out, or none; `None`: those of what closes.
    pub cull: Option<Cull>,
    /// True if images of one input each share a range ([`crate::request::shared_coloring`]).
    pub shared_range: bool,
    /// Image of the colours of values to write.
    pub colorbar: Option<PathBuf>,
    /// Colouring that the image shows, if the values of other images count, too.
    pub legend: Option<Arc<Coloring>>,
    /// An existing file of that name is overwritten.
    pub force: bool,
    /// Most bytes of memory that points may take; `None`: [`crate::memory::default_budget`].
    pub memory: Option<u64>,
}

/// Filters that trained Gaussians are drawn with.
const OF_GAUSSIANS: [Filter; 2] = [Filter::Clamp, Filter::Principal];

fn whole(text: &str, range: std::ops::RangeInclusive<u32>) -> Result<u32, String> {
    let wrong = || format!("expected a whole number from {} to {}", range.start(), range.end());
    text.trim().parse::<u32>().ok().filter(|n| range.contains(n)).ok_or_else(wrong)
}

fn file(text: &str) -> Result<PathBuf, String> {
    if text.is_empty() { Err("expected a file's name".to_owned()) } else { Ok(text.into()) }
}

impl SplatOptions {
    /// Sets a flag by its long name without dashes, from its text; a switch from `on` or `off`. False for a name that
    /// is none of these flags.
    ///
    /// # Errors
    /// What was expected, if the text is no value of the flag.
    pub fn set(&mut self, flag: &str, text: &str) -> Result<bool, String> {
        let convert = &mut self.convert;
        match flag {
            "repair" => convert.repair = switch(text)?,
            "texture" => self.add_texture(file(text)?)?,
            "per-vertex" => convert.per_vertex = switch(text)?,
            "per-face" => convert.per_face = switch(text)?,
            "colors" => convert.colors = Some(values::point_colors(text)?),
            "splats" => convert.splats = Some(values::splat_count(text)?),
            "radius-scale" => convert.radius_scale = Some(values::positive(text)?),
            "max-points" => convert.max_points = Some(whole(text, 1..=u32::MAX)?),
            "memory" => self.memory = Some(values::memory(text)?),
            "cull" => self.cull = Some(values::cull(text)?),
            "sharp" => convert.sharp = switch(text)?,
            "crease-angle" => convert.crease_angle = Some(values::angle(text)?),
            "error" => convert.error = Some(values::positive(text)?),
            "color-by" => convert.color_by = Some(text.to_owned()),
            "colormap" => convert.colormap = Some(values::colormap(text)?),
            "range" => self.set_range(values::range_choice(text)?),
            "colorbar" => self.colorbar = Some(file(text)?),
            "crop" => convert.crop = Some(values::crop(text)?),
            "classes" => convert.classes = Some(values::classes(text)?),
            "returns" => convert.returns = Some(values::returns(text)?),
            "where" => self.add_condition(values::condition(text)?),
            "every" => convert.every = Some(whole(text, 1..=u32::MAX)?),
            "all-points" => convert.all_points = switch(text)?,
            "outliers" => convert.outliers = Some(values::outliers(text)?),
            "allow-outside" => convert.allow_outside = switch(text)?,
            "max-texture" => convert.max_texture = Some(whole(text, 1..=32_768)?),
            "columns" => convert.columns = Some(values::columns(text)?),
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Takes a value of `--range`.
    pub fn set_range(&mut self, choice: RangeChoice) {
        (self.shared_range, self.convert.range) = match choice {
            RangeChoice::Shared => (true, None),
            RangeChoice::Values(range) => (false, Some(range)),
        };
    }

    /// Takes the colouring of all images ([`crate::request::shared_coloring`]).
    pub fn set_coloring(&mut self, coloring: Coloring) {
        match &coloring.scale {
            ColorScale::Range { range, .. } => self.set_range(RangeChoice::Values(*range)),
            ColorScale::Categories(all) if all.iter().all(|category| category.name.is_none()) => {
                self.convert.colormap.get_or_insert(Colormap::Tab20);
            }
            ColorScale::Categories(_) | ColorScale::Direct => {}
        }
        self.legend = Some(Arc::new(coloring));
    }

    /// Adds a condition; all of them must hold.
    pub fn add_condition(&mut self, condition: String) {
        let known = self.convert.condition.take();
        self.convert.condition = Some(Condition::all(&known.into_iter().chain([condition]).collect::<Vec<_>>()));
    }

    /// Takes a value of `--texture`: the name of a sampling, or else a texture's file.
    ///
    /// # Errors
    /// What is expected, if there is one of its kind already.
    pub fn add_texture(&mut self, value: PathBuf) -> Result<(), String> {
        let option = &mut self.convert.texture;
        let is_first = match value.to_str().and_then(TextureSampling::from_name) {
            Some(sampling) => option.sampling.replace(sampling).is_none(),
            None => option.file.replace(value).is_none(),
        };
        if is_first {
            Ok(())
        } else {
            Err("is given twice: expected one of point, ewa and fit, and one file".to_owned())
        }
    }

    fn contradiction(&self) -> Option<(&'static str, &'static str)> {
        let c: &ConvertOptions = &self.convert;
        [
            (c.per_vertex && c.per_face, ("per-vertex", "per-face")),
            (c.per_vertex && c.splats.is_some(), ("per-vertex", "splats")),
            (c.per_face && c.splats.is_some(), ("per-face", "splats")),
            (c.sharp && c.per_vertex, ("sharp", "per-vertex")),
            (c.sharp && c.per_face, ("sharp", "per-face")),
        ]
        .into_iter()
        .find_map(|(both, flags)| both.then_some(flags))
    }

    /// Refuses flags that contradict or need each other.
    ///
    /// # Errors
    /// [`Error::Usage`] naming two flags.
    pub fn check(&self) -> Result<(), Error> {
        if let Some((a, b)) = self.contradiction() {
            return Err(Error::Usage(format!("--{a} and --{b} contradict each other: give one of them")));
        }
        let alone = [("crease-angle", self.convert.crease_angle), ("error", self.convert.error)];
        match alone.into_iter().find(|(_, value)| value.is_some() && !self.convert.sharp) {
            Some((flag, _)) => Err(Error::Usage(format!("--{flag} is for --sharp: give it, too"))),
            None => Ok(()),
        }
    }
}

impl RenderOptions {
    /// The names that [`RenderOptions::planes`] may hold: of what is nearest, of Gaussians, and two that every file of
    /// planes has.
    pub const MORE_PLANES: [&str; 9] =
        ["index", "object", "label", "position", "alpha", "median_depth", "distortion", "depth", "normal"];

    fn asks_for(&self, plane: &str) -> bool {
        self.planes.iter().any(|asked| asked == plane)
    }

    /// Whether splats are drawn with their rows.
    pub(crate) fn wants_rows(&self) -> bool {
        self.asks_for("index") || self.asks_for("object")
    }

    /// Whether splats are drawn with their labels.
    pub(crate) fn wants_label(&self) -> bool {
        self.label.is_some() || self.asks_for("label")
    }

    /// The first option that is given and that surfaces alone have a use for.
    pub(crate) fn of_surfaces(&self) -> Option<&'static str> {
        let convert = ConvertOptions {
            repair: false,
            allow_outside: false,
            max_texture: None,
            columns: None,
            ..self.splats.convert.clone()
        };
        let given = [
            (self.composite == Some(Composite::Surface), "composite surface"),
            (self.shader.is_some(), "shader"),
            (self.matcap.is_some(), "matcap"),
            (self.shadows, "shadows"),
            (self.edge_aa.is_some(), "edge-aa"),
            (self.transparency.is_some(), "transparency"),
            (self.clip.is_some(), "clip"),
            (self.filter.is_some_and(|filter| !OF_GAUSSIANS.contains(&filter)), "filter"),
            (self.mapping.is_some(), "mapping"),
            (self.cutoff.is_some(), "cutoff"),
            (self.prefilter.is_some() && self.filter != Some(Filter::Principal), "prefilter"),
            (self.depth_tolerance.is_some(), "depth-tolerance"),
            (self.splats.cull.is_some(), "cull"),
            (self.wants_label(), "label"),
            (self.wants_rows(), "planes"),
            (!convert.is_default(), "crop, --every, --color-by or what else chooses and changes splats"),
        ];
        given.into_iter().find_map(|(is_given, flag)| is_given.then_some(flag))
    }

    /// These planes and those that the options ask for.
    #[must_use]
    pub fn planes_besides(&self, others: Planes) -> Planes {
        let others = others.with_index(others.index || self.wants_rows());
        let others = others.with_label(others.label || self.wants_label());
        let others = others.with_alpha(others.alpha || self.asks_for("alpha"));
        let others = others.with_median_depth(others.median_depth || self.asks_for("median_depth"));
        let others = others.with_distortion(others.distortion || self.asks_for("distortion"));
        let others = others.with_depth(others.depth || self.asks_for("depth"));
        let others = others.with_normal(others.normal || self.asks_for("normal"));
        others.with_position(others.position || self.asks_for("position"))
    }

    /// Sets a flag by its long name without dashes, from its text; a switch from `on` or `off`.
    ///
    /// # Errors
    /// What was expected, if the text is no value of the flag or there is no such flag here: flags on who draws,
    /// and on what is written, are the caller's.
    pub fn set(&mut self, flag: &str, text: &str) -> Result<(), String> {
        if self.splats.set(flag, text)? {
            return Ok(());
        }
        match flag {
            "size" => self.size = Some(values::size(text)?),
            "camera" => self.camera = Some(CameraSource::File(file(text)?)),
            "view" => self.view = Some(values::view(text)?),
            "eye" => self.eye = Some(values::point(text)?),
            "target" => self.target = Some(values::point(text)?),
            "camera-up" => self.camera_up = Some(values::direction(text)?),
            "up" => self.up = Some(values::up(text)?),
            "region" => self.region = Some(values::region(text)?),
            "tile" => self.tile = Some(values::part(text)?),
            "fov-y" => self.fov_y = Some(values::fov(text)?),
            "ortho" => self.ortho = switch(text)?,
            "preset" => self.preset = Some(values::preset(text)?),
            "filter" => self.filter = Some(values::filter(text)?),
            "mapping" => self.mapping = Some(values::mapping(text)?),
            "cutoff" => self.cutoff = Some(values::cutoff(text)?),
            "prefilter" => self.prefilter = Some(values::prefilter(text)?),
            "depth-tolerance" => self.depth_tolerance = Some(values::depth_tolerance(text)?),
            "accumulate" => self.accumulate = Some(values::accumulate(text)?),
            "transparency" => self.transparency = Some(values::transparency(text)?),
            "composite" => self.composite = Some(values::composite(text)?),
            "sort" => self.sort = Some(values::sort(text)?),
            "clip" => self.clip = Some(values::clip(text)?),
            "shader" => self.shader = Some(values::shader(text)?),
            "matcap" => self.matcap = Some(file(text)?),
            "lod-error" => self.lod_error = Some(values::positive(text)?),
            "all-levels" => self.all_levels = switch(text)?,
            "shadows" => self.shadows = switch(text)?,
            "edge-aa" => self.edge_aa = Some(values::edge_aa(text)?),
            "background" => self.background = Some(values::background(text)?),
            "samples" => self.samples = Some(whole(text, 1..=64)?),
            "planes" => {
                let planes: Vec<String> = text.split(',').map(|plane| plane.trim().to_owned()).collect();
                if planes.iter().any(|plane| !Self::MORE_PLANES.contains(&plane.as_str())) {
                    return Err(format!("expected some of {}", Self::MORE_PLANES.join(", ")));
                }
                self.planes = planes;
            }
            "label" => self.label = Some(text.to_owned()),
            _ => return Err("there is no such flag here".to_owned()),
        }
        Ok(())
    }

    /// Refuses flags that contradict or need each other.
    ///
    /// # Errors
    /// [`Error::Usage`] naming two flags.
    pub fn check(&self) -> Result<(), Error> {
        self.splats.check()?;
        let (view, camera, ortho) = (self.view.is_some(), self.camera.is_some(), self.ortho);
        let eye = [(self.eye.is_some(), "eye"), (self.target.is_some(), "target"), (camera, "camera")];
        let of_view = eye.into_iter().filter(|(given, _)| view && *given).map(|(_, other)| ("view", other));
        let of_cameras = [
            (camera, "camera"),
            (view, "view"),
            (self.eye.is_some(), "eye"),
            (self.target.is_some(), "target"),
            (self.camera_up.is_some(), "camera-up"),
            (self.fov_y.is_some(), "fov-y"),
            (ortho, "ortho"),
        ];
        let of_cameras = of_cameras.into_iter().filter(|(given, _)| self.cameras && *given);
        let of_cameras = of_cameras.map(|(_, other)| ("cameras", other));
        let lens = (ortho && self.fov_y.is_some()).then_some(("fov-y", "ortho"));
        if self.samples.is_some() && (!self.planes.is_empty() || self.label.is_some()) {
            let what = "--samples averages, and planes of what is nearest have no mean: leave out one";
            return Err(Error::Usage(what.to_owned()));
        }
        let over = if self.sort.is_some() { "sort" } else { "composite over" };
        if (self.composite == Some(Composite::Over) || self.sort.is_some())
            && let Some(flag) = self.of_surfaces()
        {
            return Err(Error::Usage(format!(
                "--{flag} is for surfaces, and --{over} for Gaussians drawn as they were trained: leave out one"
            )));
        }
        let part = (self.region.is_some() && self.tile.is_some()).then_some(("region", "tile"));
        match of_view.chain(of_cameras).chain(lens).chain(part).next() {
            Some((a, b)) => Err(Error::Usage(format!("--{a} and --{b} contradict each other: give one of them"))),
            None => Ok(()),
        }
    }

    /// The part of a camera's image that is rendered: a tile is a band of rows, as wide as the image. `None`: all.
    ///
    /// # Errors
    /// [`Error::Usage`] for more tiles than the image has rows.
    pub fn region_of(&self, camera: &Camera) -> Result<Option<Region>, Error> {
        let Some(part) = self.tile else { return Ok(self.region) };
        let [width, height] = camera.size;
        if part.count() > height {
            return Err(Error::Usage(format!(
                "--tile {}/{}: the image has {height} rows, expected at most as many tiles",
                part.index(),
                part.count()
            )));
        }
        let rows = part.of(height.into());
        Ok(Some(Region { x: 0, y: rows.start as u32, width, height: (rows.end - rows.start) as u32 }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_that_contradict_or_need_each_other_are_refused() {
        let checked = |flags: &[(&str, &str)]| {
            let mut options = RenderOptions::default();
            flags.iter().try_for_each(|(flag, text)| options.set(flag, text)).unwrap();
            options.check().map_err(|e| e.to_string())
        };
        for wrong in [
            [("per-vertex", "on"), ("per-face", "on")],
            [("per-vertex", "on"), ("splats", "9")],
            [("sharp", "on"), ("per-face", "on")],
            [("crease-angle", "30"), ("sharp", "off")],
            [("error", "0.1"), ("size", "9x9")],
            [("view", "top"), ("eye", "1,2,3")],
            [("fov-y", "30"), ("ortho", "on")],
            [("region", "0,0,4,4"), ("tile", "1/2")],
            [("shader", "phong"), ("composite", "over")],
            [("crop", "0,0,0,1,1,1"), ("composite", "over")],
            [("shader", "phong"), ("sort", "pixel")],
            [("composite", "surface"), ("sort", "center")],
        ] {
            let error = checked(&wrong).unwrap_err();
            assert!(error.contains(&format!("--{}", wrong[0].0)), "{error}");
        }
        assert_eq!(checked(&[("sharp", "on"), ("crease-angle", "30"), ("splats", "9")]), Ok(()));
        assert_eq!(checked(&[("eye", "1,2,3"), ("target", "0,0,0"), ("fov-y", "30")]), Ok(()));
        let cameras = RenderOptions { cameras: true, ortho: true, ..RenderOptions::default() };
        assert!(cameras.check().is_err());
    }

    #[test]
    fn wrong_values_say_what_is_expected() {
        let mut options = RenderOptions::default();
        for (flag, text) in [
            ("size", "9"),
            ("preset", "best"),
            ("every", "0"),
            ("sharp", "1"),
            ("classes", "a"),
            ("up", "w"),
            ("samples", "65"),
            ("planes", "index,uv"),
            ("composite", "under"),
            ("sort", "depth"),
            ("matcap", ""),
            ("output", "a.png"),
            ("radius-scale", "0"),
        ] {
            assert!(options.set(flag, text).is_err(), "{flag} {text}");
        }
        assert_eq!(options, RenderOptions::default());
        assert!(options.set("preset", "best").unwrap_err().contains("balanced"));
    }
}
