//! Options for an image and its input files: the flags of `surfel render` as data.

use crate::style::{Choices, Style};
use crate::values::{self, Part, RangeChoice};
use std::path::PathBuf;
use std::sync::Arc;
use surfel_framing::ViewChoice;
use surfel_load::Error;
use surfel_load::coloring::{ColorScale, Coloring};
use surfel_model::{
    Accumulate, Camera, ClipPolicy, Color, Colormap, Composite, Condition, ConvertOptions, Cull, DepthTolerance,
    EdgeAa, Filter, GroundStyle, Light, Mapping, Shader, Sort, TextureSampling, Transparency, Up,
};
use surfel_render::{Planes, Preset, Region};
use surfel_stage::NamedLight;

/// Source of the camera in the options.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraSource {
    /// A file that contains only the camera object of a scene file.
    File(PathBuf),
    /// A camera passed as a value, by a program.
    Given {
        /// The camera.
        camera: Box<Camera>,
        /// True if the camera's near and far planes are replaced by ones fitted to the scene.
        fits_depth: bool,
    },
}

impl CameraSource {
    /// True if the camera's near and far planes are replaced by ones fitted to the scene.
    pub fn fits_depth(&self) -> bool {
        matches!(self, Self::Given { fits_depth: true, .. })
    }
}

/// The flags of `surfel render` that determine an image. Values that aren't set come from the scene file, the preset or
/// the defaults, in this order ([`crate::request`]).
///
/// ```
/// let mut options = surfel_app::request::RenderOptions::default();
/// options.set("size", "640x480")?;
/// options.set("edge-aa", "samples")?;
/// assert_eq!(options.size, Some([640, 480]));
/// # Ok::<(), String>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct RenderOptions {
    /// Options for converting files to splats.
    pub splats: SplatOptions,
    /// Image width and height in pixels.
    pub size: Option<[u32; 2]>,
    /// Camera: a file or a value, in the form of a scene file's camera object.
    pub camera: Option<CameraSource>,
    /// Lights that replace the scene's own or default lights. `None` uses the scene's own or default lights. There is
    /// no flag for lights; only programs can set them.
    pub lights: Option<Vec<Light>>,
    /// True if the images have another program's cameras. One light along the view then serves all cameras, and near
    /// planes are fitted to the scene.
    pub cameras: bool,
    /// Direction from which the scene is viewed, by name or by angles, if no camera is given.
    pub view: Option<ViewChoice>,
    /// Position of the eye in world space.
    pub eye: Option<[f64; 3]>,
    /// World-space point in the centre of the view.
    pub target: Option<[f64; 3]>,
    /// Direction in world space that appears upward in the image; not zero.
    pub camera_up: Option<[f64; 3]>,
    /// Up axis of the scene. `None` and `Some(None)` use the axis that the scene file, the input file or its format
    /// states, or else an estimate from the shape.
    pub up: Option<Option<Up>>,
    /// Rectangle of the image that is rendered; `None` renders the whole image.
    pub region: Option<Region>,
    /// Tile of the image that is rendered: one of several bands of rows. `None` renders all rows.
    pub tile: Option<Part>,
    /// Vertical field of view, in degrees between 0 and 180.
    pub fov_y: Option<f64>,
    /// True if the projection is orthographic.
    pub ortho: bool,
    /// Height of the view in world units, for orthographic projection. `None` frames the scene, or retains the height
    /// that a given camera shows at its target.
    pub ortho_height: Option<f64>,
    /// Named set of settings, which promises an accuracy.
    pub preset: Option<Preset>,
    /// Screen-space filter.
    pub filter: Option<Filter>,
    /// Mapping by which a pixel finds its position on a splat: exact or approximate.
    pub mapping: Option<Mapping>,
    /// Kernel cutoff: more than 0, at most 50.
    pub cutoff: Option<f64>,
    /// Smallest half-width h of a filtered splat in pixels, 0 to 10,000.
    pub prefilter: Option<f64>,
    /// Depth tolerance: largest distance behind the nearest surface at which fragments are blended with it.
    pub depth_tolerance: Option<DepthTolerance>,
    /// Smallest precision in which fragments are summed.
    pub accumulate: Option<Accumulate>,
    /// Method for drawing transparent splats.
    pub transparency: Option<Transparency>,
    /// Compositing of trained Gaussians. `None` composites them over one another if all files are Gaussians without a
    /// scene file, and no option applies only to surfaces.
    pub composite: Option<Composite>,
    /// Order in which trained Gaussians are composited, per Gaussian or per pixel.
    pub sort: Option<Sort>,
    /// Method by which clip curves and lines cut splats.
    pub clip: Option<ClipPolicy>,
    /// Shader: rule for the colour of a pixel.
    pub shader: Option<Shader>,
    /// Path of the matcap, an image of a lit sphere. It selects the shader matcap; `builtin` names the built-in image.
    pub matcap: Option<PathBuf>,
    /// Largest projected splat radius, in pixels, that is accepted when LOD nodes of octrees and COPC files are
    /// selected; more than 0.
    pub lod_error: Option<f64>,
    /// True if all points of COPC files are drawn; false if only LOD nodes that the view needs are drawn.
    pub all_levels: bool,
    /// True if lights cast shadows.
    pub shadows: bool,
    /// Named light. `None` uses the first of: the light of the style, `studio` if the options state a ground, the light
    /// of the scene file, lights that follow the camera.
    pub light: Option<NamedLight>,
    /// Number of directions by which a sky's light is sampled, 1 to 65,536.
    pub light_directions: Option<u32>,
    /// True if light that surfaces reflect to each other is included.
    pub bounce: Option<bool>,
    /// Style of the ground below the scene. `Some(None)` draws no ground; `None` draws that of the style or the scene
    /// file, if any.
    pub ground: Option<Option<GroundStyle>>,
    /// Style: named set of defaults for options that aren't set.
    pub style: Option<Style>,
    /// Colour of all objects, which replaces the colours in their files; `None` shows the colours in the files.
    pub color: Option<Color>,
    /// Method of edge antialiasing.
    pub edge_aa: Option<EdgeAa>,
    /// Background colour: linear RGB, and straight alpha in [0, 1].
    pub background: Option<[f64; 4]>,
    /// Number of unfiltered samples along a pixel's side, 1 to 64 (backend reference only). `None` draws with the
    /// filter.
    pub samples: Option<u32>,
    /// Names of additional planes, from [`RenderOptions::MORE_PLANES`].
    pub planes: Vec<String>,
    /// Attribute for the plane `label`. If it is set, the plane is added; `None` uses
    /// [`surfel_load::labels::DEFAULT_LABEL`].
    pub label: Option<String>,
    /// True if the framed camera leaves enough space for the scene to turn about its up axis.
    pub turntable: bool,
    /// True if the image's error is compared with the bound that its preset promises (`--verify`). Interior weights are
    /// then estimated when files are loaded.
    pub verify: bool,
}

/// Options for converting files to splats: the flags that `surfel render` and `surfel convert` share.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SplatOptions {
    /// Conversion options that scene files have, too, in their `convert` objects.
    pub convert: ConvertOptions,
    /// Culling of back-facing splats; `None` culls them for watertight objects only.
    pub cull: Option<Cull>,
    /// True if several images, one per input, share one range of values ([`crate::request::shared_coloring`]).
    pub shared_range: bool,
    /// Path of the image file to which the colour bar is written; `None` writes none.
    pub colorbar: Option<PathBuf>,
    /// Colouring shared with other images; `None` derives it from the values of this image.
    pub legend: Option<Arc<Coloring>>,
    /// True if an existing colour-bar file is overwritten.
    pub force: bool,
    /// Memory budget for points, in bytes; `None` uses [`surfel_load::memory::default_budget`].
    pub memory: Option<u64>,
}

/// Screen-space filters that trained Gaussians support.
const OF_GAUSSIANS: [Filter; 2] = [Filter::Clamp, Filter::Principal];

impl SplatOptions {
    /// Sets the range of values, from the value of `--range`.
    pub fn set_range(&mut self, choice: RangeChoice) {
        (self.shared_range, self.convert.range) = match choice {
            RangeChoice::Shared => (true, None),
            RangeChoice::Values(range) => (false, Some(range)),
        };
    }

    /// Sets a colouring that all images share ([`crate::request::shared_coloring`]). Also sets its range of values, or,
    /// for categories without names, the colour map `tab20` if no map is set.
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

    /// Adds a condition on points, in conjunction with earlier ones.
    pub fn add_condition(&mut self, condition: String) {
        let known = self.convert.condition.take();
        self.convert.condition = Some(Condition::all(&known.into_iter().chain([condition]).collect::<Vec<_>>()));
    }

    /// Sets the colour map from a value of `--colormap`: the name of a colour map, or else a file of colours.
    ///
    /// # Errors
    /// The names of all colour maps, if the value is neither a name nor looks like a file's name.
    pub fn set_colormap(&mut self, value: PathBuf) -> Result<(), String> {
        let name = value.to_str().map(str::to_ascii_lowercase).unwrap_or_default();
        let is_file = || value.extension().is_some() || value.components().count() > 1 || value.is_file();
        let (map, file) = match values::colormap(&name) {
            Ok(map) => (Some(map), None),
            Err(_) if is_file() => (None, Some(value)),
            Err(names) => return Err(format!("{names}, or a file with a colour in each line")),
        };
        (self.convert.colormap, self.convert.colormap_file) = (map, file);
        Ok(())
    }

    /// Sets sampling or file of the texture from a value of `--texture`: the name of a sampling method, or else a file.
    ///
    /// # Errors
    /// A message that states what was expected, if the same kind of value was given before.
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

    /// Checks that no flags contradict each other, and that no flag lacks another.
    ///
    /// # Errors
    /// [`Error::Usage`] with the names of the two flags.
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
    /// Names that [`RenderOptions::planes`] may contain: planes of the nearest splat, planes of Gaussians, and the
    /// planes depth and normal, which every file of planes has.
    pub const MORE_PLANES: [&str; 9] =
        ["index", "object", "label", "position", "alpha", "median_depth", "distortion", "depth", "normal"];

    /// Applies the style's defaults to options that aren't set. Light and ground are excluded, since they depend on the
    /// objects ([`RenderOptions::light`]).
    pub(crate) fn apply_style(&mut self) {
        let Some(Choices { size, background, edge_aa, .. }) = self.style.map(Style::choices) else { return };
        self.size.get_or_insert(size);
        self.background.get_or_insert(background);
        self.edge_aa.get_or_insert(edge_aa);
    }

    fn asks_for(&self, plane: &str) -> bool {
        self.planes.iter().any(|asked| asked == plane)
    }

    /// True if a requested plane needs the row numbers of splats.
    pub(crate) fn wants_rows(&self) -> bool {
        self.asks_for("index") || self.asks_for("object")
    }

    /// True if a requested plane needs the labels of splats.
    pub(crate) fn wants_label(&self) -> bool {
        self.label.is_some() || self.asks_for("label")
    }

    /// Returns the name of the first option in use that applies only to surfaces, not to trained Gaussians; `None` if
    /// no such option is in use.
    pub(crate) fn first_surface_option(&self) -> Option<&'static str> {
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
            (self.light.is_some(), "light"),
            (self.ground.flatten().is_some(), "ground"),
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

    /// Returns the planes `others` together with the planes that the options request.
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

    /// Checks that no flags contradict each other, and that no flag lacks another.
    ///
    /// # Errors
    /// [`Error::Usage`] with the names of the two flags, or of the flag that is missing.
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
        if self.ortho_height.is_some() && !ortho {
            return Err(Error::Usage("--ortho-height is for --ortho: give it, too".to_owned()));
        }
        let over = if self.sort.is_some() { "sort" } else { "composite over" };
        if (self.composite == Some(Composite::Over) || self.sort.is_some())
            && let Some(flag) = self.first_surface_option()
        {
            return Err(Error::Usage(format!(
                "--{flag} is for surfaces, and --{over} for Gaussians drawn as they were trained: leave out one"
            )));
        }
        self.check_light()?;
        let part = (self.region.is_some() && self.tile.is_some()).then_some(("region", "tile"));
        match of_view.chain(of_cameras).chain(lens).chain(part).next() {
            Some((a, b)) => Err(Error::Usage(format!("--{a} and --{b} contradict each other: give one of them"))),
            None => Ok(()),
        }
    }

    /// True if no option conflicts with the light of a sky, so that the style's light is used.
    fn takes_light_of_style(&self) -> bool {
        let is_plain = self.shader.is_none_or(|shader| shader == Shader::Phong);
        is_plain && self.matcap.is_none() && !self.shadows && self.lights.is_none() && !self.cameras
    }

    /// Returns three choices from options and style: the named light, whether light reflected between surfaces is
    /// included, and the ground. `can_store` is true if the objects can store light.
    pub(crate) fn light(&self, can_store: bool) -> (Option<NamedLight>, bool, Option<GroundStyle>) {
        let style = self.style.filter(|_| can_store && self.takes_light_of_style()).map(Style::choices);
        let of_ground = self.ground.flatten().map(|_| NamedLight::Studio);
        let light = self.light.or(style.as_ref().map(|style| style.light)).or(of_ground);
        let style = style.filter(|_| light != Some(NamedLight::Headlight));
        let bounce = self.bounce.unwrap_or(style.as_ref().is_some_and(|style| style.bounce));
        (light, bounce, self.ground.unwrap_or(style.map(|style| style.ground)))
    }

    /// Checks that no flag contradicts the light.
    fn check_light(&self) -> Result<(), Error> {
        let follows = self.light == Some(NamedLight::Headlight);
        let of_sky = [
            (self.ground.flatten().is_some(), "ground"),
            (self.bounce == Some(true), "bounce"),
            (self.light_directions.is_some(), "light-directions"),
        ];
        if let Some((_, flag)) = of_sky.into_iter().find(|(given, _)| follows && *given) {
            return Err(Error::Usage(format!("--{flag} is for --light studio, sky or sun: give one of them")));
        }
        let is_lit = self.light.is_some_and(|light| light != NamedLight::Headlight);
        let others = [
            (self.shader.is_some_and(|shader| !matches!(shader, Shader::Phong | Shader::Unlit)), "shader"),
            (self.matcap.is_some(), "matcap"),
            (self.shadows, "shadows"),
        ];
        match others.into_iter().find(|(given, _)| is_lit && *given) {
            Some((_, flag)) => Err(Error::Usage(format!(
                "--{flag} and --light contradict each other: light of a sky is stored in the colours, with its shadows"
            ))),
            None => Ok(()),
        }
    }

    /// Returns the region of a camera's image that is rendered; `None` for the whole image. A tile is a band of rows
    /// across the whole width.
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
            [("ortho-height", "2"), ("size", "9x9")],
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
