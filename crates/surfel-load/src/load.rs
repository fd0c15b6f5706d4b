//! Loading of files as splats: splats are read directly, points and meshes are converted.

use crate::coloring::together::{ColorJob, Colors, Lacking, Member};
use crate::coloring::{Coloring, Colorings};
use crate::effects::{self, UnusedOption};
use crate::levels::{self, LevelReport, Levels};
use crate::mesh_columns::MeshColumns;
use crate::single_sided::{states_sides, with_each_side};
use crate::words::counted;
use crate::{Error, LevelStore, convert, labels, memory};
use glam::DVec3;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_framing::{UpConvention, UpReason};
use surfel_io::{Content, Format, Loaded};
use surfel_model::{
    Classes, Colormap, Composite, ConvertOptions, EdgeAa, Mesh, Octree, Outliers, PointColors, PointsAs, Returns,
    Settings, SplatCloud, SplatCount, TableColumns, TextureSampling, Transparency, Up,
};
use surfel_sample::{MeshMethod, MeshReport, PointReport, Progress};

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
    /// True if points are used that are otherwise dropped: more than 16 at exactly (0, 0, 0), and more than 16 at one
    /// place.
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

    /// Adds what these settings may need from a file: Gaussians as trained, and interior weights for A-buffers and
    /// edges antialiased by coverage. Once a scene is loaded, [`surfel_render::needs_interior_weight`] returns whether
    /// it does need the latter.
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

/// Conversion that made splats from a file's content.
#[derive(Clone, Debug, PartialEq)]
pub enum Conversion {
    /// The file held splats.
    None,
    /// The file held points.
    Points(PointReport),
    /// The file held a mesh.
    Mesh(MeshReport),
    /// The file held a mesh, and the splats are clipped along its creases.
    #[cfg(feature = "sharp")]
    SharpMesh(Box<surfel_sample::SharpReport>),
}

/// A file loaded as splats.
#[derive(Clone, Debug)]
pub struct LoadedCloud {
    /// The splats; at least one.
    pub cloud: SplatCloud,
    /// Format of the file.
    pub format: Format,
    /// Up axis stated in the file, else the format's default.
    pub up: Up,
    /// Reason why the up axis is certain; `None` for the default of a format whose files occur with any axis up.
    pub up_reason: Option<UpReason>,
    /// True if the splats cover a closed mesh from outside, so that their backs are never visible.
    pub closed: bool,
    /// True if the splats were Gaussians, whose alphas are opacities of a volume.
    pub gaussian: bool,
    /// Conversion that made the splats.
    pub conversion: Conversion,
    /// Colouring by an attribute, if the options ask for one.
    pub coloring: Option<Coloring>,
    /// Octree of the file, if it is one; `cloud` then holds its finest splats.
    pub octree: Option<Arc<Octree>>,
    /// Report of the nodes read from a COPC file, if some weren't.
    pub levels: Option<LevelReport>,
    /// Notes for the user on what was dropped, assumed or estimated: sentences without a full stop.
    pub notes: Vec<String>,
    /// Files that the file refers to, such as textures and buffers, whether they exist or not; sorted.
    pub beside: Vec<PathBuf>,
    /// Options without effect on what the file holds.
    pub unused: Vec<UnusedOption>,
}

/// Returns the options that readers use.
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

/// Reads a file, or the bytes of stdin for the name [`STDIN`].
pub fn read(path: &Path, options: &LoadOptions) -> Result<Loaded, Error> {
    let io_options = io_options(options);
    Ok(match &options.stdin {
        Some(bytes) if path == Path::new(STDIN) => surfel_io::load_bytes(bytes, None, Path::new("stdin"), &io_options)?,
        _ => surfel_io::load(path, &io_options)?,
    })
}

/// Loads a file as splats: splats are read directly, points and meshes are converted.
///
/// # Errors
/// [`Error::Io`] if the file can't be read or is damaged, [`Error::Sample`] if it can't be converted to splats,
/// [`Error::Unsuitable`] if it holds no splat, or `options.sharp` is set without Cargo's feature `sharp`.
pub fn load(path: &Path, options: &LoadOptions, progress: &dyn Progress) -> Result<LoadedCloud, Error> {
    let options = &options.clone().with_gaussians(false);
    progress.stage("reading", 0);
    let (loaded, levels) = read_needed(path, options, progress)?;
    let (mut made, job) = splats_of(loaded, path, options, progress)?;
    if let Some(job) = job {
        color(&mut made, &job)?;
    }
    Ok(LoadedCloud { levels, ..made })
}

/// Colours splats that don't share a colouring with other files.
fn color(made: &mut LoadedCloud, job: &ColorJob) -> Result<(), Error> {
    let empty = SplatCloud::disks::<[f32; 3], [f32; 3]>(&[], &[], &[])?;
    let mut cloud = Arc::new(std::mem::replace(&mut made.cloud, empty));
    let mut colorings = Colorings::default();
    let lacking = colorings.color(&mut [Member { job, cloud: &mut cloud, is_colored: false }])?;
    made.cloud = Arc::unwrap_or_clone(cloud);
    made.coloring = colorings.iter().next().map(|(_, coloring)| coloring.clone());
    made.notes.extend(colorings.notes().map(|(_, note)| note.to_owned()));
    made.unused.extend(lacking.iter().map(|lacking| without_attribute(job, lacking)));
    Ok(())
}

/// Describes a file that lacks the attribute it is to be coloured by.
pub fn without_attribute(job: &ColorJob, lacking: &Lacking) -> UnusedOption {
    let holds = format!("no attribute '{}' but {}", job.attribute.escape_debug(), lacking.known.join(", "));
    UnusedOption { option: "color_by", holds: holds.into(), expected: "one of these".into() }
}

/// Reads a file, or the selected levels of a file with levels of detail. The report is `None` if all points were read.
pub(crate) fn read_needed(
    path: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<(Loaded, Option<LevelReport>), Error> {
    let partly = |(loaded, report): (Loaded, LevelReport)| (loaded, Some(report).filter(|report| !report.is_whole()));
    if let Some(found) = levels::read(path, path, options)? {
        return Ok(partly(found));
    }
    let Err(too_large) = check_size(path, options) else { return Ok((read(path, options)?, None)) };
    let store = options.level_store.as_ref().filter(|_| levels::chosen(path, options).is_some());
    let by_levels = store.map(|store| store.by_levels(path, options, progress)).transpose()?.flatten();
    let Some((copc, note)) = by_levels else { return Err(too_large) };
    let (mut loaded, report) = levels::read(path, copc.path(), options)?.ok_or(too_large)?;
    loaded.notes.insert(0, note);
    if let Some((format, up, is_said)) = surfel_io::copc::up_of_columns(path, options.columns.as_ref()) {
        // COPC files are z-up; the source file's own format and up axis are restored.
        (loaded.format, loaded.up) = (format, up);
        if let (Content::Points(points), true) = (&mut loaded.content, is_said) {
            points.up = Some(up);
        }
    }
    Ok(partly((loaded, report)))
}

/// Refuses a scan that won't fit into memory, before it is read.
pub fn check_size(path: &Path, options: &LoadOptions) -> Result<(), Error> {
    let is_file = options.stdin.is_none() || path != Path::new(STDIN);
    let is_all = is_file && !options.chooses_points();
    let Some(count) = surfel_io::survey_points(path, options.columns.as_ref()).filter(|_| is_all) else {
        return Ok(());
    };
    let points = options.max_points.map_or(count.points, |most| count.points.min(most as u64));
    let remedy = if count.has_radii { memory::Remedy::Fewer } else { memory::Remedy::Levels };
    let bytes = memory::loaded_bytes(&count);
    memory::check(path, points, bytes, options.memory, remedy)
}

/// Makes splats from a file's content, and returns how they are to be coloured.
pub fn splats_of(
    loaded: Loaded,
    path: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<(LoadedCloud, Option<ColorJob>), Error> {
    let up_reason = up_reason(&loaded);
    let mut notes = loaded.notes;
    let unused = effects::unused(&loaded.content, options);
    let (mut closed, mut octree, mut on_mesh) = (false, None, None);
    let (mut cloud, conversion) = match loaded.content {
        Content::Octree(found) => {
            closed = surfel_sample::is_closed(found.mesh());
            let cloud = found.cloud_of(&found.finest().collect::<Vec<_>>())?;
            octree = Some(found);
            (cloud, Conversion::None)
        }
        Content::Splats(cloud) => {
            closed = cloud.data().comments.iter().any(|c| c == surfel_sample::CLOSED_MESH);
            let cloud = convert::chosen_splats(cloud, path, options, &mut notes)?;
            let scaled = options.radius_scale != 1.0;
            (if scaled { convert::scaled(cloud, options.radius_scale)? } else { cloud }, Conversion::None)
        }
        Content::Gaussians(_) => return Err(not_splats(path)),
        Content::Points(mut points) => {
            // Ground faces up where the format says which way that is.
            points.up = points.up.or(up_reason.map(|_| loaded.up));
            convert::points(points, path, options, &mut notes, progress)?
        }
        Content::Mesh(mut mesh) => {
            // An inverted mesh may be a room seen from inside, so its backs are drawn.
            closed = surfel_sample::is_closed(&mesh);
            // Materials that are single-sided tell which side is meant.
            if !states_sides(&mesh) && surfel_sample::turn_outward(&mut mesh) {
                notes.push("turned its triangles around: they are wound inside out".to_owned());
            }
            let mut made = convert::mesh(&mesh, path, options, &mut notes, progress)?;
            if !closed && let Some(each_side) = with_each_side(&mesh, &made.0)? {
                let doubled = counted((each_side.len() - made.0.len()) as u64, "splats");
                notes.push(format!(
                    "some materials are double-sided, others not: back faces are culled, and {doubled} of double-sided \
                     ones are there for each side (--cull none shows all back faces)"
                ));
                (made.0, closed) = (each_side, true);
            }
            on_mesh = MeshColumns::new(mesh);
            made
        }
    };
    if cloud.is_empty() {
        let problem = "holds no splat, expected at least one: check that the file is complete".to_owned();
        return Err(Error::Unsuitable { path: path.to_path_buf(), problem });
    }
    if let Some(columns) = &mut on_mesh {
        if options.mesh_columns {
            cloud = columns.all(cloud)?;
        }
        if let Some(attribute) = &options.label {
            cloud = columns.labels(cloud, attribute)?;
        }
    }
    let of_mesh = on_mesh.as_ref().map(MeshColumns::names).unwrap_or_default();
    if let Some(attribute) = &options.label
        && !labels::label(&mut cloud, attribute, path)?
    {
        let mut known = of_mesh.clone();
        known.extend(cloud.data().extras.iter().map(|e| e.name.escape_debug().to_string()));
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        notes.push(format!("no attribute {attribute}, so its splats have no label (attributes: {known})"));
    }
    if options.rows || options.label.is_some() {
        cloud.number_rows();
    } else {
        cloud.discard_rows();
    }
    let colors = options.color_by.as_ref().map(|_| Colors::of(options)).transpose()?.unwrap_or_default();
    if let (Some(columns), Some(attribute)) = (&mut on_mesh, &options.color_by) {
        cloud = columns.values(cloud, attribute, &colors)?;
    }
    let is_of_points = matches!(conversion, Conversion::Points(_))
        || cloud.data().comments.iter().any(|comment| comment == surfel_sample::OF_POINTS);
    let job = options.color_by.as_ref().filter(|_| octree.is_none()).map(|attribute| ColorJob {
        path: path.to_path_buf(),
        attribute: attribute.clone(),
        colors,
        up: options.up.or_else(|| up_reason.map(|_| loaded.up)),
        convention: UpConvention::of(is_of_points, loaded.up),
        others: of_mesh.clone(),
    });
    if options.interior_weight
        && cloud.data().interior_weight.is_none()
        && let Some(weight) = surfel_sample::interior_weight(&cloud)
    {
        cloud.set_interior_weight(weight);
        if let Some(octree) = &mut octree {
            octree.set_interior_weight(weight);
        }
        notes.push(format!("the file says no interior weight: estimated {weight:.3}"));
    }
    let octree = octree.map(Arc::from);
    let made = LoadedCloud {
        cloud,
        format: loaded.format,
        up: loaded.up,
        up_reason,
        closed,
        gaussian: loaded.gaussian,
        conversion,
        coloring: None,
        octree,
        levels: None,
        notes,
        beside: loaded.beside,
        unused,
    };
    Ok((made, job))
}

/// Returns the error for Gaussians where splats are expected.
fn not_splats(path: &Path) -> Error {
    let problem = "holds trained Gaussians, expected splats: leave out --composite over".to_owned();
    Error::Unsuitable { path: path.to_path_buf(), problem }
}

/// Length in metres below which the content of an E57 or PTS file is an object, not a place.
const THING_M: f64 = 1.0;

/// Returns why a file's up axis is certain: the file or its format states it. `None` for OBJ, STL, OFF, PLY, Draco, PCD
/// and tables of numbers, which occur with any axis up. Also `None` for E57 and PTS files of an object that wasn't
/// recorded by a scanner on site.
pub fn up_reason(loaded: &Loaded) -> Option<UpReason> {
    if loaded.content.own_up().is_some() {
        return Some(UpReason::Stated);
    }
    // Gaussian splats are the only PLY files whose default up axis is −y.
    let is_any = matches!(
        loaded.format,
        Format::Ply
            | Format::Obj
            | Format::Stl
            | Format::Off
            | Format::Drc
            | Format::Xyz
            | Format::Pcd
            | Format::Npy
            | Format::Npz
            | Format::Raw
            | Format::Surfel
    ) || is_thing(loaded);
    (!is_any || loaded.up == Up::MinusY).then_some(UpReason::Format)
}

/// True if an E57 or PTS file holds a small object without a scanner position. Other programs export such objects with
/// any axis up, while a scanner on site stands upright.
fn is_thing(loaded: &Loaded) -> bool {
    let Content::Points(points) = &loaded.content else { return false };
    let is_of_one = points.viewpoint.is_none() && points.extras.iter().all(|extra| extra.name != "scan");
    let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    matches!(loaded.format, Format::E57 | Format::Pts)
        && is_of_one
        && (0..points.len()).all(|i| {
            let p = points.positions.get(i);
            (lo, hi) = (lo.min(p), hi.max(p));
            (hi - lo).max_element() < THING_M
        })
}

/// Polygons of a file.
pub(crate) struct LoadedMesh {
    pub(crate) mesh: Arc<Mesh>,
    pub(crate) up: Up,
    pub(crate) up_reason: Option<UpReason>,
    pub(crate) notes: Vec<String>,
}

/// Loads a file that is drawn as polygons. Adds the files it refers to to `beside`.
///
/// # Errors
/// Errors of [`load`]; also [`Error::Unsuitable`] if the file holds no triangles.
pub(crate) fn load_mesh(
    path: &Path,
    options: &LoadOptions,
    beside: &mut BTreeSet<PathBuf>,
) -> Result<LoadedMesh, Error> {
    let loaded = read(path, options)?;
    let (up, up_reason) = (loaded.up, up_reason(&loaded));
    beside.extend(loaded.beside);
    let mut notes = loaded.notes;
    if options.color_by.is_some() {
        notes.push("drew polygons without color_by: give the file as \"splats\" to colour it by values".into());
    }
    let found = match loaded.content {
        Content::Mesh(mesh) if !mesh.triangles.is_empty() => {
            if mesh.is_see_through() {
                notes.push("drew all polygons opaque and whole: give the file as \"splats\" to see through it".into());
            }
            if mesh.has_normal_maps() {
                notes.push("drew polygons without their normal maps: give the file as \"splats\" to see them".into());
            }
            return Ok(LoadedMesh { mesh: Arc::new(mesh), up, up_reason, notes });
        }
        Content::Octree(octree) => {
            return Ok(LoadedMesh { mesh: Arc::new(octree.mesh().clone()), up, up_reason, notes });
        }
        Content::Mesh(_) => "a mesh without triangles",
        Content::Points(_) => "points",
        Content::Splats(_) => "splats",
        Content::Gaussians(_) => "Gaussians",
    };
    let problem = format!("holds {found}, expected triangles for an object's \"mesh\": give it as \"splats\"");
    Err(Error::Unsuitable { path: path.to_path_buf(), problem })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_things_in_e57_and_pts_stand_as_their_shape_says() {
        let file = |text: &str, viewpoint: Option<DVec3>| {
            let name = Path::new("t.xyz");
            let options = surfel_io::LoadOptions::default();
            let mut loaded = surfel_io::load_bytes(text.as_bytes(), Some(Format::Xyz), name, &options).unwrap();
            loaded.format = Format::E57;
            if let Content::Points(points) = &mut loaded.content {
                points.viewpoint = viewpoint;
            }
            loaded
        };
        // Sizes are measured correctly far from the origin.
        let (bunny, room) = ("7 8 9\n7.1 8.9 9.2\n", "7 8 9\n7.1 9.1 9.2\n");
        assert_eq!(up_reason(&file(bunny, None)), None);
        let points = |text: &str| Loaded { format: Format::Pts, ..file(text, None) };
        assert_eq!([bunny, room].map(|text| up_reason(&points(text))), [None, Some(UpReason::Format)]);
        assert_eq!(up_reason(&file(room, None)), Some(UpReason::Format));
        assert_eq!(up_reason(&file(bunny, Some(DVec3::ZERO))), Some(UpReason::Format), "a scanner stood there");
        let scans = "x y z scan\n7 8 9 0\n7.1 8.2 9.2 1\n";
        assert_eq!(up_reason(&file(scans, None)), Some(UpReason::Format), "several scans");
    }
}
