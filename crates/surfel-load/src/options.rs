//! Options for loading files.

use crate::LevelStore;
use crate::level_choice::Levels;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_model::{Classes, Composite, ConvertOptions, EdgeAa, Settings, SplatCount, Transparency, Up};
use surfel_sample::MeshMethod;

/// File name that stands for the content in [`LoadOptions::stdin`].
pub const STDIN: &str = "-";

/// Options for loading files and converting them to splats.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct LoadOptions {
    /// Conversion of the file to splats. Paths are relative to the current folder. Objects of a scene have their own
    /// conversion options instead.
    pub convert: ConvertOptions,
    /// True if interior weights that splat files don't state are estimated. Edge antialiasing needs them.
    pub interior_weight: bool,
    /// True if the object's material states the interior weight, so that it isn't estimated for points.
    pub has_stated_weight: bool,
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
    /// True if points are read that the file marks as withheld.
    pub withheld: bool,
    /// True if points that aren't part of a surface are dropped, for surface models. Noise (classes 7 and 18) is
    /// dropped unless `classes` lists classes to draw or is `all`, or `condition` names the class. Withheld points are
    /// dropped unless `classes` is `all`.
    pub surface: bool,
    /// Levels of detail that are read from a COPC file; `None` reads all points.
    pub levels: Option<Levels>,
    /// Cache of files with levels of detail, which images share. If this cache and `levels` are set, point files of
    /// other formats that don't fit into memory are drawn with levels of detail, too.
    pub level_store: Option<Arc<LevelStore>>,
    /// Memory budget for points in bytes; `None` uses [`crate::memory::default_budget`].
    pub memory: Option<u64>,
    /// True if trained Gaussians are loaded as Gaussians, false if they become a surface. Only
    /// [`crate::scene::load_objects`] supports true.
    pub gaussians: bool,
    /// Bytes for the file name `-` ([`STDIN`]); their format is detected from the content. `None` treats `-` as an
    /// ordinary file name.
    pub stdin: Option<Arc<[u8]>>,
}

impl LoadOptions {
    surfel_model::setters! {
        with_interior_weight interior_weight: bool,
        with_has_stated_weight has_stated_weight: bool,
        with_mesh_columns mesh_columns: bool,
        with_rows rows: bool,
        with_label label: Option<String>,
        with_up up: Option<Up>,
        with_withheld withheld: bool,
        with_surface surface: bool,
        with_levels levels: Option<Levels>,
        with_level_store level_store: Option<Arc<LevelStore>>,
        with_memory memory: Option<u64>,
        with_gaussians gaussians: bool,
        with_stdin stdin: Option<Arc<[u8]>>,
    }

    /// Replaces the conversion options by those of an object. Relative paths in them are relative to `base_dir`.
    /// Options for colouring are dropped without `color_by`. With `all_levels`, [`Self::levels`] becomes `None`, unless
    /// it is an overview and no option selects points.
    #[must_use]
    pub fn with_convert(mut self, convert: &ConvertOptions, base_dir: &Path) -> Self {
        let join = |file: &Option<PathBuf>| file.as_ref().map(|file| base_dir.join(file));
        self.convert = convert.clone();
        self.convert.texture.file = join(&convert.texture.file);
        match convert.color_by {
            Some(_) => {
                self.convert.colormap_file = join(&convert.colormap_file);
                self.convert.labels = join(&convert.labels);
            }
            None => {
                (self.convert.colormap, self.convert.colormap_file) = (None, None);
                (self.convert.labels, self.convert.range) = (None, None);
            }
        }
        // An overview places the camera even if all levels are drawn later. It can't if a selection may exclude all of
        // its points.
        if convert.all_levels && (self.levels != Some(Levels::Overview) || self.chooses_points()) {
            self.levels = None;
        }
        self
    }

    /// True if the options exclude some classes of points.
    pub(crate) fn chooses_classes(&self) -> bool {
        self.convert.classes.as_ref().is_some_and(|classes| *classes != Classes::All)
    }

    /// True if the options select points by position, class, return, attribute or step.
    pub(crate) fn chooses_points(&self) -> bool {
        let ConvertOptions { crop, returns, condition, every, .. } = &self.convert;
        self.chooses_classes() || crop.is_some() || returns.is_some() || condition.is_some() || every.is_some()
    }

    /// Returns the method for converting meshes to splats. `None` lets the mesh decide
    /// ([`surfel_sample::MeshOptions::auto`]).
    pub(crate) fn method(&self) -> Option<MeshMethod> {
        match self.convert.splats {
            Some(SplatCount::Count(n)) => Some(MeshMethod::Count(n as usize)),
            Some(SplatCount::Auto) => Some(MeshMethod::Detail),
            None if self.convert.per_face => Some(MeshMethod::PerFace),
            None if self.convert.per_vertex => Some(MeshMethod::PerVertex),
            None => None,
        }
    }

    /// Returns the factor by which every radius is multiplied. Unless it is 1, the interior weight of splat files is
    /// estimated again.
    pub(crate) fn radius_scale(&self) -> f64 {
        self.convert.radius_scale.unwrap_or(1.0)
    }

    /// Returns the largest number of points of a point cloud that become splats; `None` without a limit.
    pub(crate) fn max_points(&self) -> Option<usize> {
        self.convert.max_points.map(|n| n as usize)
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

/// Converts loading options to options for the readers of `surfel-io`.
pub fn io_options(options: &LoadOptions) -> surfel_io::LoadOptions {
    let ConvertOptions { repair, texture, allow_outside, max_texture, columns, classes, .. } = &options.convert;
    surfel_io::LoadOptions {
        repair: *repair,
        texture: texture.file.clone(),
        gaussians: options.gaussians,
        allow_outside: *allow_outside,
        max_texture: *max_texture,
        columns: columns.clone(),
        withheld: options.withheld || *classes == Some(Classes::All),
    }
}
