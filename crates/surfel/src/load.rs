//! From a file to splats: splats as they are, points and meshes converted.

use crate::coloring::together::{ColorJob, Lacking, Member};
use crate::coloring::{Coloring, Colorings};
use crate::framing::{UpConvention, UpReason};
use crate::levels::{self, LevelReport, Levels};
use crate::mesh_columns::MeshColumns;
use crate::{Error, LevelStore, convert, labels, memory};
use glam::DVec3;
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_io::{Content, Format, Loaded};
use surfel_model::{
    Classes, Colormap, Composite, ConvertOptions, EdgeAa, Mesh, Octree, Outliers, PointColors, Returns, Settings,
    SplatCloud, SplatCount, TableColumns, TextureSampling, Transparency, Up,
};
use surfel_sample::{MeshMethod, MeshReport, PointReport, Progress};

/// The name that stands for [`LoadOptions::stdin`].
pub const STDIN: &str = "-";

/// How files are loaded and made into splats.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LoadOptions {
    /// Drops invalid splats, and takes the whole chunks of a LAZ file that is cut off, and says how many, instead of
    /// refusing the file.
    pub repair: bool,
    /// A texture (PNG, JPEG or WebP) for meshes with texture coordinates that name none themselves.
    pub texture: Option<PathBuf>,
    /// How splats take the colours of meshes ([`surfel_sample::fit_to_mesh`]); `None`: [`TextureSampling::Point`].
    pub texture_sampling: Option<TextureSampling>,
    /// What splats of points take of their colours ([`surfel_sample::fit_point_colors`]).
    pub colors: PointColors,
    /// How meshes become splats; `None`: as suits the mesh ([`surfel_sample::MeshOptions::auto`]).
    pub method: Option<MeshMethod>,
    /// Multiplies every radius; greater than 0. The interior weight of splat files is then estimated anew.
    pub radius_scale: f64,
    /// Most points of a point cloud that become splats ([`surfel_model::PointCloud::thin`]); `None`: all.
    pub max_points: Option<usize>,
    /// Clips splats along the creases of meshes and points (Cargo feature `sharp`); of meshes at most as many as
    /// [`MeshMethod::Count`] says.
    pub sharp: bool,
    /// With `sharp`: angle from which an edge is a crease, in degrees from 1 to 179; `None`: 40.
    pub crease_angle_deg: Option<f64>,
    /// With `sharp`: largest distance from a mesh that its simplification may cause, in object units; `None`: no
    /// bound, and no simplification unless a number of splats is asked for.
    pub sharp_error: Option<f64>,
    /// Estimates the interior weight of splat files that don't say it, which edge antialiasing needs.
    pub interior_weight: bool,
    /// The attribute that splats are coloured by: `rgb`, `height`, `normal`, or a property of the file; `None`: their
    /// own colours.
    pub color_by: Option<String>,
    /// Colours of that attribute's values; `None`: classes their own, other whole numbers of at most 20 kinds tab20,
    /// intensity grey, the rest viridis.
    pub colormap: Option<Colormap>,
    /// Values at the ends of the colour map; `None`: the 2nd and the 98th percentile.
    pub range: Option<[f64; 2]>,
    /// Carries all properties of a mesh's vertices and faces over to its splats, not only those that colours and labels
    /// need.
    pub mesh_columns: bool,
    /// Keeps which row of its file each splat came from, before any was dropped, for the planes `index` and `label`.
    pub rows: bool,
    /// The attribute that the plane `label` shows ([`crate::labels::DEFAULT_LABEL`], or another of the file); `None`:
    /// none is kept.
    pub label: Option<String>,
    /// The axis of `height`; `None`: as the file says, else by its shape.
    pub up: Option<Up>,
    /// Only points and splats within this box count: least x, y, z, then largest.
    pub crop: Option<[f64; 6]>,
    /// Only points of these classes count; `None`: of all.
    pub classes: Option<Classes>,
    /// Only these of a pulse's returns count.
    pub returns: Option<Returns>,
    /// Only points for which this condition holds count ([`surfel_model::Condition`]).
    pub condition: Option<String>,
    /// Only every so-manyth point counts, after all else.
    pub every: Option<u32>,
    /// Points at exactly (0, 0, 0), where they are more than 16, count, and all of more than 16 in one place.
    pub all_points: bool,
    /// Points that their file flags as withheld are read, too.
    pub withheld: bool,
    /// Points that are no surface are left out, as surface models need it: noise (classes 7 and 18), and points that
    /// are withheld, unless `classes` or `condition` choose them by their class.
    pub surface: bool,
    /// Whether points that stand alone count ([`surfel_sample::outliers`]). Where not, COPC files are read whole.
    pub outliers: Outliers,
    /// What is read of a COPC file; `None`: all of it.
    pub levels: Option<Levels>,
    /// What stays of files by levels from one picture to the next. With it, and `levels`, LAS and LAZ files that don't
    /// fit into memory are drawn by levels too.
    pub level_store: Option<Arc<LevelStore>>,
    /// Most bytes of memory that points may take, by estimate; `None`: [`crate::memory::default_budget`].
    pub memory: Option<u64>,
    /// Files of trained Gaussians are kept as such, and not made a surface: by [`crate::scene::load_objects`] alone.
    pub gaussians: bool,
    /// The file may refer to files outside of its own folder.
    pub allow_outside: bool,
    /// Longest side of a texture in texels, 1 to 32,768; larger ones are reduced. `None`: 8192.
    pub max_texture: Option<u32>,
    /// Names of the columns of tables: of text, of NumPy's arrays, and, with types, of binary files without a header.
    pub columns: Option<TableColumns>,
    /// What the name `-` ([`STDIN`]) stands for: the bytes of a file of any format, told by its content. `None`: a
    /// file of that name.
    pub stdin: Option<Arc<[u8]>>,
}

impl LoadOptions {
    surfel_model::setters! {
        with_repair repair: bool,
        with_texture texture: Option<PathBuf>,
        with_texture_sampling texture_sampling: Option<TextureSampling>,
        with_colors colors: PointColors,
        with_method method: Option<MeshMethod>,
        with_radius_scale radius_scale: f64,
        with_max_points max_points: Option<usize>,
        with_sharp sharp: bool,
        with_crease_angle_deg crease_angle_deg: Option<f64>,
        with_sharp_error sharp_error: Option<f64>,
        with_interior_weight interior_weight: bool,
        with_color_by color_by: Option<String>,
        with_colormap colormap: Option<Colormap>,
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

    /// With what an object's `convert` says; its texture is relative to `base_dir`.
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
        self.method = method.or(self.method);
        self.radius_scale = convert.radius_scale.unwrap_or(self.radius_scale);
        self.max_points = convert.max_points.map(|n| n as usize).or(self.max_points);
        self.sharp |= convert.sharp;
        self.crease_angle_deg = convert.crease_angle.or(self.crease_angle_deg);
        self.sharp_error = convert.error.or(self.sharp_error);
        if convert.color_by.is_some() {
            (self.color_by, self.colormap) = (convert.color_by.clone(), convert.colormap);
            self.range = convert.range;
        }
        self.crop = convert.crop.or(self.crop);
        self.classes = convert.classes.clone().or(self.classes);
        self.returns = convert.returns.or(self.returns);
        self.condition = convert.condition.clone().or(self.condition);
        self.every = convert.every.or(self.every);
        self.all_points |= convert.all_points;
        self.outliers = convert.outliers.unwrap_or(self.outliers);
        // The coarsest levels place a camera, whatever is drawn then, unless they may hold none of the points.
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
    /// True if some classes don't count.
    pub(crate) fn chooses_classes(&self) -> bool {
        self.classes.as_ref().is_some_and(|classes| *classes != Classes::All)
    }

    /// Whether a part of the points is asked for: a place, classes, returns, attributes.
    pub(crate) fn chooses_points(&self) -> bool {
        self.crop.is_some()
            || self.chooses_classes()
            || self.returns.is_some()
            || self.condition.is_some()
            || self.every.is_some()
    }

    /// With what these settings may need of a file: Gaussians as they were trained, and a cloud's interior weight, for
    /// edges antialiased by coverage and A-buffers. Whether a scene does need that,
    /// [`surfel_render::needs_interior_weight`] knows once it is loaded.
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
            method: None,
            radius_scale: 1.0,
            max_points: None,
            sharp: false,
            crease_angle_deg: None,
            sharp_error: None,
            interior_weight: false,
            color_by: None,
            colormap: None,
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

/// What was made of a file's content.
#[derive(Clone, Debug, PartialEq)]
pub enum Conversion {
    /// It held splats.
    None,
    /// It held points.
    Points(PointReport),
    /// It held a mesh.
    Mesh(MeshReport),
    /// It held a mesh, whose splats are clipped along its creases.
    #[cfg(feature = "sharp")]
    SharpMesh(Box<surfel_sample::SharpReport>),
}

/// A file as splats.
#[derive(Clone, Debug)]
pub struct LoadedCloud {
    /// The splats; at least one.
    pub cloud: SplatCloud,
    /// The format it was in.
    pub format: Format,
    /// Which axis is up: as the file says, else the format's default.
    pub up: Up,
    /// Why that is known for certain; `None` for the default of a format that is used with any axis up.
    pub up_reason: Option<UpReason>,
    /// They cover a closed mesh from outside: nobody sees the back of one.
    pub closed: bool,
    /// They were Gaussians, whose alphas are shares of a volume.
    pub gaussian: bool,
    /// How the splats were made.
    pub conversion: Conversion,
    /// What they are coloured by, if that was asked for.
    pub coloring: Option<Coloring>,
    /// The octree that the file holds; `cloud` is then its finest splats.
    pub octree: Option<Arc<Octree>>,
    /// What was read of a COPC file, where that isn't all of it.
    pub levels: Option<LevelReport>,
    /// What the user should know, as sentences without a full stop: what was dropped, assumed or estimated.
    pub notes: Vec<String>,
    /// Files beside it that it refers to, such as textures and buffers, whether they are there or not, sorted.
    pub beside: Vec<PathBuf>,
    /// Options that what the file holds left without effect.
    pub unused: Vec<UnusedOption>,
}

/// An option that had nothing to act on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnusedOption {
    /// Its key in the scene file's `convert`: "splats", "max_points", …
    pub option: &'static str,
    /// What the file holds: "splats", "points", "a mesh" or "an octree"; or which attributes.
    pub holds: Cow<'static, str>,
    /// What the option is for.
    pub expected: &'static str,
}

/// The options that reading takes.
pub(crate) fn io_options(options: &LoadOptions) -> surfel_io::LoadOptions {
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

/// Reads a file, or what its name [`STDIN`] stands for.
pub(crate) fn read(path: &Path, options: &LoadOptions) -> Result<Loaded, Error> {
    let io_options = io_options(options);
    Ok(match &options.stdin {
        Some(bytes) if path == Path::new(STDIN) => surfel_io::load_bytes(bytes, None, Path::new("stdin"), &io_options)?,
        _ => surfel_io::load(path, &io_options)?,
    })
}

/// Loads a file and makes splats of it: a splat file as it is, points and meshes converted.
///
/// # Errors
/// [`Error::Io`] if the file can't be read or is damaged, [`Error::Sample`] if no splats can be made of it,
/// [`Error::Unsuitable`] if it holds no splat, or `options.sharp` is set and Cargo's feature `sharp` isn't.
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

/// Colours splats that are drawn alone.
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

/// Describes a file that lacks the attribute that it is to be coloured by.
pub(crate) fn without_attribute(job: &ColorJob, lacking: &Lacking) -> UnusedOption {
    let holds = format!("no attribute '{}' but {}", job.attribute.escape_debug(), lacking.known.join(", "));
    UnusedOption { option: "color_by", holds: holds.into(), expected: "one of these" }
}

/// Reads a file, and of one by levels what the options ask for, with what was left out of it.
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
        // LAS has z up; a file that was something else is seen as that.
        (loaded.format, loaded.up) = (format, up);
        if let (Content::Points(points), true) = (&mut loaded.content, is_said) {
            points.up = Some(up);
        }
    }
    Ok(partly((loaded, report)))
}

/// Refuses a scan that won't fit into memory, before it is read.
pub(crate) fn check_size(path: &Path, options: &LoadOptions) -> Result<(), Error> {
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

/// Makes splats of what was read, and says what they are to be coloured by.
pub(crate) fn splats_of(
    loaded: Loaded,
    path: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<(LoadedCloud, Option<ColorJob>), Error> {
    let up_reason = up_reason(&loaded);
    let mut notes = loaded.notes;
    let unused = convert::unused(&loaded.content, options);
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
        Content::Points(points) => convert::points(points, path, options, &mut notes, progress)?,
        Content::Mesh(mut mesh) => {
            // One that is turned around may be a room, seen from inside: its backs are drawn.
            closed = surfel_sample::is_closed(&mesh);
            if surfel_sample::turn_outward(&mut mesh) {
                notes.push("turned its triangles around: they are wound inside out".to_owned());
            }
            let made = convert::mesh(&mesh, path, options, &mut notes, progress)?;
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
    if let (Some(columns), Some(attribute)) = (&mut on_mesh, &options.color_by) {
        cloud = columns.values(cloud, attribute, (options.colormap, options.range))?;
    }
    let is_of_points = matches!(conversion, Conversion::Points(_))
        || cloud.data().comments.iter().any(|comment| comment == surfel_sample::OF_POINTS);
    let job = options.color_by.as_ref().filter(|_| octree.is_none()).map(|attribute| ColorJob {
        path: path.to_path_buf(),
        attribute: attribute.clone(),
        map: options.colormap,
        range: options.range,
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

/// Gaussians where splats are wanted.
fn not_splats(path: &Path) -> Error {
    let problem = "holds trained Gaussians, expected splats: leave out --composite over".to_owned();
    Error::Unsuitable { path: path.to_path_buf(), problem }
}

/// Length in metres below which what an E57 or PTS file holds is a thing, not a place.
const THING_M: f64 = 1.0;

/// Why a file's up axis is known: it says it, or its format does. `None` for OBJ, STL, OFF, PLY, Draco, PCD and
/// columns of numbers, which come with any axis up, and for E57 and PTS files of a thing that no scanner stood
/// before.
pub fn up_reason(loaded: &Loaded) -> Option<UpReason> {
    if loaded.content.own_up().is_some() {
        return Some(UpReason::Stated);
    }
    // Gaussian splats are the only PLY files that are −y by default.
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

/// Whether an E57 or PTS file holds something small without a scanner's place, which other programs export as they have
/// it: scanners of places stand upright.
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

/// A file's polygons.
pub(crate) struct LoadedMesh {
    pub(crate) mesh: Arc<Mesh>,
    pub(crate) up: Up,
    pub(crate) up_reason: Option<UpReason>,
    pub(crate) notes: Vec<String>,
}

/// Loads a file that is drawn as polygons. Files beside it that it refers to are added to `beside`.
///
/// # Errors
/// As [`load`]; also [`Error::Unsuitable`] if the file holds no triangles.
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
        // Far from the origin as well as near.
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
