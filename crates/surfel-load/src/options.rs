//! Options for loading files.

use crate::LevelStore;
use crate::level_choice::Levels;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_model::{
    Classes, Colormap, Composite, ConvertOptions, EdgeAa, Outliers, PointColors, PointsAs, Returns, Settings,
    SplatCount, TableColumns, TextureSampling, Transparency, Up,
};
use surfel_sample::MeshMethod;

/// The file name that refers to [`LoadOptions::stdin`].
pub const STDIN: &str = "-";

/// Options for loading files and converting them to splats.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LoadOptions {
    /// True if damaged files are read as far as possible. Invalid splats and the missing end of a cut-off LAZ file are
    /// then skipped and counted in a note.
    pub repair: bool,
    /// Texture file (PNG, JPEG or WebP) for meshes with texture coordinates that name no texture themselves.
    pub texture: Option<PathBuf>,
    /// Sampling of mesh textures by splats ([`surfel_sample::fit_to_mesh`]); `None`: [`TextureSampling::Point`].
    pub texture_sampling: Option<TextureSampling>,
    /// Colours of splats made from points: as they are, or fitted ([`surfel_sample::fit_point_colors`]).
    pub colors: PointColors,
    /// Kind of splat that each point is drawn as, when a scene is assembled; `None` for the default.
    pub points_as: Option<PointsAs>,
    /// Method for converting meshes to splats; `None`: chosen by mesh ([`surfel_sample::MeshOptions::auto`]).
    pub method: Option<MeshMethod>,
    /// Factor on every radius, greater than 0. Unless it is 1, the interior weight of splat files is estimated again.
    pub radius_scale: f64,
    /// Largest number of points of a point cloud that become splats, at least 1 ([`surfel_model::PointCloud::thin`]);
    /// `None`: no limit.
    pub max_points: Option<usize>,
    /// True if splats are clipped along the creases of meshes and points (Cargo feature `sharp`). A mesh then gets at
    /// most [`MeshMethod::Count`] splats.
    pub sharp: bool,
    /// Angle from which an edge is a crease, in degrees from 1 to 179, if `sharp` is set; `None`: 40.
    pub crease_angle_deg: Option<f64>,
    /// Largest deviation from the mesh that simplification may cause, in object units, if `sharp` is set. `None`: no
    /// limit, and no simplification unless a number of splats is given.
    pub sharp_error: Option<f64>,
    /// True if missing interior weights of splat files are estimated; edge antialiasing needs them.
    pub interior_weight: bool,
    /// True if the object's material states its interior weight, so that none is estimated for points.
    pub has_stated_weight: bool,
    /// Attribute that splats are coloured by: `rgb`, `height`, `normal`, or a property of the file. `None`: their own
    /// colours.
    pub color_by: Option<String>,
    /// Colour map for that attribute. `None`: class colours for classes, tab20 for other integers with at most 20
    /// distinct values, grey for intensity, and viridis for the rest.
    pub colormap: Option<Colormap>,
    /// File with the colours of a colour map, which takes precedence.
    pub colormap_file: Option<PathBuf>,
    /// File with the names, and optionally the colours, of categories.
    pub labels: Option<PathBuf>,
    /// Attribute values at the ends of the colour map, the first less than the second; `None`: the 2nd and the 98th
    /// percentile.
    pub range: Option<[f64; 2]>,
    /// True if all properties of a mesh's vertices and faces are transferred to its splats, not only those needed for
    /// colours and labels.
    pub mesh_columns: bool,
    /// True if each splat stores its row in the file, counted before any row was dropped; the planes `index` and
    /// `label` need it.
    pub rows: bool,
    /// Attribute for the plane `label` ([`crate::labels::DEFAULT_LABEL`], or another one of the file); `None`: no
    /// labels.
    pub label: Option<String>,
    /// Axis along which `height` is measured; `None`: as the file states, else estimated from the shape.
    pub up: Option<Up>,
    /// Box of points and splats that are read, in the file's coordinates: least x, y, z, then largest.
    pub crop: Option<[f64; 6]>,
    /// Classes of points that are read; `None`: all.
    pub classes: Option<Classes>,
    /// Returns of a pulse that are read; `None`: all.
    pub returns: Option<Returns>,
    /// Condition on points that are read ([`surfel_model::Condition`]).
    pub condition: Option<String>,
    /// Step of decimation, at least 1: every n-th point is used, after all other selections. `None`: every point.
    pub every: Option<u32>,
    /// True if coincident points are used. By default, points are dropped if more than 16 are at exactly (0, 0, 0), or
    /// at any other position.
    pub all_points: bool,
    /// True if points that their file flags as withheld are read too.
    pub withheld: bool,
    /// True if points that belong to no surface are dropped, as surface models need: noise (classes 7 and 18) and
    /// withheld points, unless `classes` or `condition` select them by class.
    pub surface: bool,
    /// Treatment of isolated points ([`surfel_sample::outliers`]). If they are dropped, COPC files are read whole.
    pub outliers: Outliers,
    /// Selection of the levels of detail read from a COPC file; `None`: all points.
    pub levels: Option<Levels>,
    /// Cache of files with levels of detail, shared between images. With it and `levels`, LAS and LAZ files that don't
    /// fit into memory are drawn with levels of detail too.
    pub level_store: Option<Arc<LevelStore>>,
    /// Memory budget for points in bytes, by estimate; `None`: [`crate::memory::default_budget`].
    pub memory: Option<u64>,
    /// True if trained Gaussians are loaded as Gaussians, not as a surface; only [`crate::scene::load_objects`]
    /// supports this.
    pub gaussians: bool,
    /// True if the file may refer to files outside its own folder.
    pub allow_outside: bool,
    /// Longest side of a texture in texels, 1 to 32,768; larger textures are reduced. `None`: 8192.
    pub max_texture: Option<u32>,
    /// Column names of tables: text, NumPy arrays and, with types, binary files without a header.
    pub columns: Option<TableColumns>,
    /// Bytes that the name `-` ([`STDIN`]) refers to, in any format, which is detected from the content. `None`: a file
    /// of that name.
    pub stdin: Option<Arc<[u8]>>,
}

impl LoadOptions {
    surfel_model::setters! {
        with_repair repair: bool,
        with_texture texture: Option<PathBuf>,
        with_texture_sampling texture_sampling: Option<TextureSampling>,
        with_colors colors: PointColors,
        with_points_as points_as: Option<PointsAs>,
        with_method method: Option<MeshMethod>,
        with_radius_scale radius_scale: f64,
        with_max_points max_points: Option<usize>,
        with_sharp sharp: bool,
        with_crease_angle_deg crease_angle_deg: Option<f64>,
        with_sharp_error sharp_error: Option<f64>,
        with_interior_weight interior_weight: bool,
        with_has_stated_weight has_stated_weight: bool,
        with_color_by color_by: Option<String>,
        with_colormap colormap: Option<Colormap>,
        with_colormap_file colormap_file: Option<PathBuf>,
        with_labels labels: Option<PathBuf>,
        with_range range: Option<[f64; 2]>,
        with_mesh_columns mesh_columns: bool,
        with_rows rows: bool,
        with_label label: Option<String>,
        with_up up: Option<Up>,
        with_crop crop: Option<[f64; 6]>,
        with_classes classes: Option<Classes>,
        with_returns returns: Option<Returns>,
        with_condition condition: Option<String>,
        with_every every: Option<u32>,
        with_all_points all_points: bool,
        with_withheld withheld: bool,
        with_surface surface: bool,
        with_outliers outliers: Outliers,
        with_levels levels: Option<Levels>,
        with_level_store level_store: Option<Arc<LevelStore>>,
        with_memory memory: Option<u64>,
        with_gaussians gaussians: bool,
        with_allow_outside allow_outside: bool,
        with_max_texture max_texture: Option<u32>,
        with_columns columns: Option<TableColumns>,
        with_stdin stdin: Option<Arc<[u8]>>,
    }

    /// Applies an object's conversion options; its texture path is relative to `base_dir`.
    #[must_use]
    pub fn with_convert(mut self, convert: &ConvertOptions, base_dir: &Path) -> Self {
        let method = match convert.splats {
            Some(SplatCount::Count(n)) => Some(MeshMethod::Count(n as usize)),
            Some(SplatCount::Auto) => Some(MeshMethod::Detail),
            None if convert.per_face => Some(MeshMethod::PerFace),
            None if convert.per_vertex => Some(MeshMethod::PerVertex),
            None => None,
        };
        self.repair |= convert.repair;
        self.texture = convert.texture.file.as_ref().map(|file| base_dir.join(file)).or(self.texture);
        self.texture_sampling = convert.texture.sampling.or(self.texture_sampling);
        self.colors = convert.colors.unwrap_or(self.colors);
        self.points_as = convert.points_as.or(self.points_as);
        self.method = method.or(self.method);
        self.radius_scale = convert.radius_scale.unwrap_or(self.radius_scale);
        self.max_points = convert.max_points.map(|n| n as usize).or(self.max_points);
        self.sharp |= convert.sharp;
        self.crease_angle_deg = convert.crease_angle.or(self.crease_angle_deg);
        self.sharp_error = convert.error.or(self.sharp_error);
        if convert.color_by.is_some() {
            (self.color_by, self.colormap) = (convert.color_by.clone(), convert.colormap);
            self.colormap_file = convert.colormap_file.as_ref().map(|file| base_dir.join(file));
            self.labels = convert.labels.as_ref().map(|file| base_dir.join(file));
            self.range = convert.range;
        }
        self.crop = convert.crop.or(self.crop);
        self.classes = convert.classes.clone().or(self.classes);
        self.returns = convert.returns.or(self.returns);
        self.condition = convert.condition.clone().or(self.condition);
        self.every = convert.every.or(self.every);
        self.all_points |= convert.all_points;
        self.outliers = convert.outliers.unwrap_or(self.outliers);
        // A camera is placed by the coarsest levels even if all levels are drawn, unless a selection may exclude all
        // their points.
        if convert.all_levels && (self.levels != Some(Levels::Overview) || self.chooses_points()) {
            self.levels = None;
        }
        self.allow_outside |= convert.allow_outside;
        self.max_texture = convert.max_texture.or(self.max_texture);
        self.columns = convert.columns.clone().or(self.columns);
        self
    }
}

impl LoadOptions {
    /// True if the options exclude some classes.
    pub(crate) fn chooses_classes(&self) -> bool {
        self.classes.as_ref().is_some_and(|classes| *classes != Classes::All)
    }

    /// True if the options select points by place, class, return, attribute or step.
    pub(crate) fn chooses_points(&self) -> bool {
        self.crop.is_some()
            || self.chooses_classes()
            || self.returns.is_some()
            || self.condition.is_some()
            || self.every.is_some()
    }

    /// Enables the loading options that these render settings may need: trained Gaussians for [`Composite::Over`], and
    /// interior weights for A-buffers and coverage antialiasing. For a loaded scene,
    /// [`surfel_render::needs_interior_weight`] returns whether interior weights are needed.
    #[must_use]
    pub fn for_settings(self, settings: &Settings) -> Self {
        let coverage = settings.edge_aa == EdgeAa::Coverage;
        let needed = coverage || matches!(settings.transparency, Transparency::ABuffer { .. });
        let interior_weight = self.interior_weight || needed;
        let gaussians = self.gaussians || settings.composite == Composite::Over;
        self.with_interior_weight(interior_weight).with_gaussians(gaussians)
    }
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            repair: false,
            texture: None,
            texture_sampling: None,
            colors: PointColors::AsIs,
            points_as: None,
            method: None,
            radius_scale: 1.0,
            max_points: None,
            sharp: false,
            crease_angle_deg: None,
            sharp_error: None,
            interior_weight: false,
            has_stated_weight: false,
            color_by: None,
            colormap: None,
            colormap_file: None,
            labels: None,
            range: None,
            mesh_columns: false,
            rows: false,
            label: None,
            up: None,
            crop: None,
            classes: None,
            returns: None,
            condition: None,
            every: None,
            all_points: false,
            withheld: false,
            surface: false,
            outliers: Outliers::Keep,
            levels: None,
            level_store: None,
            memory: None,
            gaussians: false,
            allow_outside: false,
            max_texture: None,
            columns: None,
            stdin: None,
        }
    }
}

/// Converts loading options to the options of `surfel-io`'s readers.
pub fn io_options(options: &LoadOptions) -> surfel_io::LoadOptions {
    surfel_io::LoadOptions {
        repair: options.repair,
        texture: options.texture.clone(),
        gaussians: options.gaussians,
        allow_outside: options.allow_outside,
        max_texture: options.max_texture,
        columns: options.columns.clone(),
        withheld: options.withheld || options.classes == Some(Classes::All),
    }
}
