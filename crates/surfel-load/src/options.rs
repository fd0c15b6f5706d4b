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

/// File name that stands for the content in [`LoadOptions::stdin`].
pub const STDIN: &str = "-";

/// Options for loading files and converting them to splats.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LoadOptions {
    /// True if damaged files are read as far as possible. Invalid splats and unreadable chunks of a truncated LAZ file
    /// are then skipped, and a note counts them.
    pub repair: bool,
    /// Texture file (PNG, JPEG or WebP) for meshes that have texture coordinates but name no texture.
    pub texture: Option<PathBuf>,
    /// Method by which splats sample a mesh's texture ([`surfel_sample::fit_to_mesh`]); `None` uses
    /// [`TextureSampling::Point`].
    pub texture_sampling: Option<TextureSampling>,
    /// Colours of splats that are made from points: unchanged, or fitted ([`surfel_sample::fit_point_colors`]).
    pub colors: PointColors,
    /// Kind of splat by which points are drawn when a scene is assembled; `None` uses the default.
    pub points_as: Option<PointsAs>,
    /// Method for converting meshes to splats; `None` chooses one for each mesh ([`surfel_sample::MeshOptions::auto`]).
    pub method: Option<MeshMethod>,
    /// Factor on all radii, greater than 0. Unless it is 1, interior weights that splat files state are estimated
    /// again.
    pub radius_scale: f64,
    /// Largest number of points of a point cloud that become splats, at least 1; `None` for no limit. Larger clouds are
    /// thinned ([`surfel_model::PointCloud::thin`]).
    pub max_points: Option<usize>,
    /// True if splats are clipped along the creases of meshes and points (Cargo feature `sharp`). The number in
    /// [`MeshMethod::Count`] is then the maximum for a mesh.
    pub sharp: bool,
    /// Crease angle in degrees, 1 to 179: the smallest angle at an edge that counts as a crease. `None` means 40. It is
    /// used if `sharp` is true.
    pub crease_angle_deg: Option<f64>,
    /// Largest deviation from the mesh, in object units, that simplification may cause if `sharp` is true. `None` sets
    /// no limit; the mesh is then simplified only if a number of splats is given.
    pub sharp_error: Option<f64>,
    /// True if interior weights that splat files don't state are estimated. Edge antialiasing needs them.
    pub interior_weight: bool,
    /// True if the object's material states the interior weight, so that it isn't estimated for points.
    pub has_stated_weight: bool,
    /// Attribute by which splats are coloured: `rgb`, `height`, `normal`, or a property of the file. `None` uses the
    /// file's colours.
    pub color_by: Option<String>,
    /// Colour map for the attribute in `color_by`. `None` uses class colours for classes, tab20 for other integers with
    /// at most 20 distinct values, grey for intensity, and viridis for other attributes.
    pub colormap: Option<Colormap>,
    /// File with the colours of a colour map, which takes precedence over `colormap`.
    pub colormap_file: Option<PathBuf>,
    /// File with the names, and optionally the colours, of categories.
    pub labels: Option<PathBuf>,
    /// Range of attribute values that the colour map covers, minimum and maximum. `None` uses the 2nd and the 98th
    /// percentile.
    pub range: Option<[f64; 2]>,
    /// True if splats of a mesh get all properties of its vertices and faces; false if they get only those needed for
    /// colours and labels.
    pub mesh_columns: bool,
    /// True if each splat stores its row in the file, counted before any rows were dropped. The planes `index` and
    /// `label` need rows.
    pub rows: bool,
    /// Attribute for the plane `label`: [`crate::labels::DEFAULT_LABEL`] or another one of the file. `None` stores no
    /// labels.
    pub label: Option<String>,
    /// Axis along which `height` is measured; `None` uses the file's up axis, or else an estimate from the shape.
    pub up: Option<Up>,
    /// Box of points and splats that are read, in the file's coordinates: minimum x, y, z, then maximum x, y, z.
    pub crop: Option<[f64; 6]>,
    /// Classes of points that are read; `None` reads all classes.
    pub classes: Option<Classes>,
    /// Returns of laser pulses that are read; `None` reads all returns.
    pub returns: Option<Returns>,
    /// Condition that points must satisfy to be read ([`surfel_model::Condition`]).
    pub condition: Option<String>,
    /// Step n of decimation, at least 1: every n-th of the otherwise selected points is used. `None` uses all points.
    pub every: Option<u32>,
    /// True if all coincident points are used. If false, positions shared by more than 16 points are dropped, such as
    /// the origin (0, 0, 0).
    pub all_points: bool,
    /// True if points are read that the file marks as withheld.
    pub withheld: bool,
    /// True if points that aren't part of a surface are dropped, for surface models. These are noise (classes 7 and 18)
    /// and withheld points, unless `classes` or `condition` selects them by class.
    pub surface: bool,
    /// Treatment of isolated points ([`surfel_sample::outliers`]). If they are dropped, COPC files are read completely.
    pub outliers: Outliers,
    /// Levels of detail that are read from a COPC file; `None` reads all points.
    pub levels: Option<Levels>,
    /// Cache of files with levels of detail, which images share. If it and `levels` are set, LAS and LAZ files that
    /// don't fit into memory are drawn with levels of detail, too.
    pub level_store: Option<Arc<LevelStore>>,
    /// Memory budget for points in bytes; `None` uses [`crate::memory::default_budget`].
    pub memory: Option<u64>,
    /// True if trained Gaussians are loaded as Gaussians, false if they become a surface. Only
    /// [`crate::scene::load_objects`] supports true.
    pub gaussians: bool,
    /// True if a file may refer to files outside of its own folder.
    pub allow_outside: bool,
    /// Largest side of a texture in texels, 1 to 32,768; larger textures are reduced. `None` means 8192.
    pub max_texture: Option<u32>,
    /// Column names for tables: text, NumPy arrays and, with types, binary files without a header.
    pub columns: Option<TableColumns>,
    /// Bytes for the file name `-` ([`STDIN`]); their format is detected from the content. `None` treats `-` as an
    /// ordinary file name.
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

    /// Applies an object's conversion options. Relative paths in them are relative to `base_dir`.
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
        // The coarsest levels place the camera even if all levels are drawn later. They can't if a selection may
        // exclude all of their points.
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
    /// True if the options exclude some classes of points.
    pub(crate) fn chooses_classes(&self) -> bool {
        self.classes.as_ref().is_some_and(|classes| *classes != Classes::All)
    }

    /// True if the options select points by position, class, return, attribute or step.
    pub(crate) fn chooses_points(&self) -> bool {
        self.crop.is_some()
            || self.chooses_classes()
            || self.returns.is_some()
            || self.condition.is_some()
            || self.every.is_some()
    }

    /// Enables the loading options that the render settings may need: trained Gaussians for [`Composite::Over`], and
    /// interior weights for A-buffers and coverage antialiasing. [`surfel_render::needs_interior_weight`] determines
    /// whether a loaded scene actually needs interior weights.
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

/// Converts loading options to options for the readers of `surfel-io`.
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
