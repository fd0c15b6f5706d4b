//! Steps from files to a scene: reading scene files, loading and colouring objects, and assembling the scene.

use crate::coloring::linear;
use crate::coloring::together::{ColorJob, Member, Tallies};
use crate::effects::{self, UnusedOption};
use crate::levels::ViewSelection;
use crate::load::up_reason;
use crate::load::{LoadedMesh, load_mesh, read_needed, splats_of, without_attribute};
use crate::loaded_objects::{LoadedObjects, ObjectFacts, ObjectNote};
use crate::noise::{noise_points, surface_of};
use crate::options::STDIN;
use crate::points_as;
use crate::points_as::SparseReason;
use crate::single_sided::EACH_SIDE;
use crate::{Conversion, Error, LoadOptions, LoadedCloud};
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_io::{Content, IoError, Loaded};
use surfel_model::{
    Classes, CloudData, Color, ConvertOptions, GaussianCloud, Geometry, Matcap, Material, Mesh, Object, ObjectFile,
    OnInvalid, Scene, SceneFile, Shader, SplatCloud,
};
use surfel_sample::Progress;

/// Largest accepted size of scene files in bytes, far above that of any real one.
const MAX_SCENE_BYTES: u64 = 64 << 20;

/// Splats that one or several objects share, and the request for colouring them.
struct Shared {
    cloud: Arc<SplatCloud>,
    job: ColorJob,
    is_colored: bool,
    /// Indices, among the scene's objects, of those that share the splats.
    objects: Vec<usize>,
}

impl Shared {
    fn member(&mut self) -> Member<'_> {
        Member { job: &self.job, cloud: &mut self.cloud, is_colored: self.is_colored }
    }
}

/// True for a file name that ends in `.json`, unless it is that of a 3D Tiles tileset or an SOG file.
pub fn is_scene_file(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) && !surfel_io::names_geometry(path)
}

/// Creates an object for a bare file, drawn as splats at its own position.
pub fn bare_object(path: &Path) -> ObjectFile {
    ObjectFile {
        splats: Some(path.to_path_buf()),
        mesh: None,
        matrix: glam::DMat4::IDENTITY.to_cols_array(),
        material: Material::default(),
        convert: ConvertOptions::default(),
    }
}

/// Reads a scene file, and the set of keys in its `settings` object.
///
/// # Errors
/// [`Error::Io`], with line and column, if the file can't be read or isn't a scene file.
pub fn read_scene_file(path: &Path) -> Result<(SceneFile, BTreeSet<String>), Error> {
    let system = |source| IoError::System { path: path.to_path_buf(), action: "read it", source };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(system)?;
    // Reads one byte more than the limit, so that the parser sees a truncated file and reports it.
    file.take(MAX_SCENE_BYTES + 1).read_to_end(&mut bytes).map_err(system)?;
    parse_scene_file(&bytes, path)
}

/// Parses a scene file from memory, like [`read_scene_file`]. Messages use `name`.
///
/// # Errors
/// Errors of [`read_scene_file`].
pub fn parse_scene_file(bytes: &[u8], name: &Path) -> Result<(SceneFile, BTreeSet<String>), Error> {
    let scene = surfel_io::scene_file::parse(bytes, name)?;
    let json = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let raw: serde_json::Value = serde_json::from_slice(json).unwrap_or_default();
    let keys = raw.get("settings").and_then(|s| s.as_object()).map(|s| s.keys().cloned().collect());
    Ok((scene, keys.unwrap_or_default()))
}

/// Result of loading a file, cached for further objects with the same file and options.
#[derive(Clone)]
struct LoadedGeometry {
    geometry: Geometry,
    facts: ObjectFacts,
    unused: Vec<UnusedOption>,
    color_job: Option<ColorJob>,
}

/// Returns trained Gaussians as geometry for an object, and notes about them.
fn gaussians(
    cloud: &Arc<GaussianCloud>,
    read: &Loaded,
    path: &Path,
    options: &LoadOptions,
) -> Result<(LoadedGeometry, Vec<String>), Error> {
    if cloud.is_empty() {
        let problem = "holds no Gaussian, expected at least one: check that the file is complete".to_owned();
        return Err(Error::Unsuitable { path: path.to_path_buf(), problem });
    }
    let facts = ObjectFacts { up: read.up, up_reason: up_reason(read), ..ObjectFacts::default() };
    let unused = effects::unused(&read.content, options);
    let geometry = Geometry::Gaussians(cloud.clone());
    Ok((LoadedGeometry { geometry, facts, unused, color_job: None }, read.notes.clone()))
}

/// Loads objects like [`load_objects`], for files without a scene file. Trained Gaussians remain Gaussians only if all
/// files contain them; otherwise all files become surfaces.
///
/// # Errors
/// Errors of [`load_objects`].
pub fn load_bare_objects(
    objects: &[ObjectFile],
    base_dir: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<LoadedObjects, Error> {
    let loaded = load_objects(objects, base_dir, &options.clone().with_gaussians(true), progress)?;
    if !loaded.has_gaussians() || loaded.all_gaussians() {
        return Ok(loaded);
    }
    // Gaussians and surfaces can't be drawn together, so that all files are loaded as surfaces.
    load_objects(objects, base_dir, &options.clone().with_gaussians(false), progress)
}

impl LoadedObjects {
    /// Colours splats by their attributes: those of objects that are partial ([`ObjectFacts::partial`]), or all splats
    /// if `all` is true. Splats with the same attribute share one scale, which also covers splats that were coloured
    /// before.
    fn color(&mut self, all: bool) -> Result<(), Error> {
        let is_new = |facts: &ObjectFacts| all || facts.partial;
        let Self { objects, facts, color_jobs, colorings, notes, unused, .. } = self;
        // Objects of the same file share their splats.
        let mut clouds: Vec<Shared> = Vec::new();
        let mut place_of: HashMap<*const SplatCloud, usize> = HashMap::new();
        for (i, (object, job)) in objects.iter().zip(&color_jobs.0).enumerate() {
            let (Geometry::Splats(cloud), Some(job)) = (&object.geometry, job) else { continue };
            let place = *place_of.entry(Arc::as_ptr(cloud)).or_insert(clouds.len());
            if place == clouds.len() {
                let (cloud, job) = (cloud.clone(), job.clone());
                clouds.push(Shared { cloud, job, is_colored: !is_new(&facts[i]), objects: Vec::new() });
            }
            clouds[place].objects.push(i);
        }
        if clouds.is_empty() {
            return Ok(());
        }
        // The objects release their splats for the moment, so that the splats can be changed in place.
        let nothing: Geometry = SplatCloud::disks::<[f32; 3], [f32; 3]>(&[], &[], &[])?.into();
        clouds.iter().flat_map(|cloud| &cloud.objects).for_each(|i| objects[*i].geometry = nothing.clone());
        let lacking = colorings.color(&mut clouds.iter_mut().map(Shared::member).collect::<Vec<_>>())?;
        let all_lack = lacking.len() == clouds.len()
            && objects
                .iter()
                .zip(&color_jobs.0)
                .all(|(object, job)| job.is_some() || !matches!(object.geometry, Geometry::Splats(_)));
        for lacking in &lacking {
            let Shared { job, is_colored, .. } = &clouds[lacking.member];
            let option = without_attribute(job, lacking);
            if all_lack {
                *unused = vec![(job.path.clone(), option)].into_iter().chain(unused.drain(..)).collect();
                break;
            }
            if !is_colored {
                notes.push(ObjectNote::new(&job.path, &format!("holds {}, so that it is grey", option.holds)));
            }
        }
        for (path, note) in colorings.notes() {
            notes.push(ObjectNote::new(path, note));
        }
        for Shared { cloud, objects: used, .. } in clouds {
            used.into_iter().for_each(|i| objects[i].geometry = Geometry::Splats(cloud.clone()));
        }
        Ok(())
    }

    /// Adds the attribute values of the objects to `tallies`, from which the images of a series derive a shared
    /// colouring.
    pub fn tally(mut self, tallies: &mut Tallies) {
        let jobs = std::mem::take(&mut self.color_jobs.0);
        let mut clouds: Vec<Shared> = Vec::new();
        for (object, job) in self.objects.into_iter().zip(jobs) {
            if let (Geometry::Splats(cloud), Some(job)) = (object.geometry, job) {
                clouds.push(Shared { cloud, job, is_colored: true, objects: Vec::new() });
            }
        }
        tallies.add(&mut clouds.iter_mut().map(Shared::member).collect::<Vec<_>>());
    }

    /// Replaces splats that were made from points by balls, disks or dots, as the scene file's objects state. This must
    /// be the last step before [`assemble`], because up axis, view and lights are derived from the surface.
    ///
    /// # Errors
    /// [`Error::Model`] for a radius that is out of range.
    pub fn draw_points(&mut self, objects: &[ObjectFile]) -> Result<(), Error> {
        let chosen = |facts: &ObjectFacts, file: &ObjectFile| file.convert.points_as.filter(|_| facts.points);
        let own = self.objects.iter().zip(&self.facts).zip(objects);
        let own = own.filter_map(|((object, facts), file)| points_as::own_radius(object, chosen(facts, file)?));
        let shared = if self.has_one_radius { points_as::median(own.collect()) } else { None };
        for ((object, facts), file) in self.objects.iter_mut().zip(&self.facts).zip(objects) {
            if let Some(points_as) = chosen(facts, file) {
                points_as::redraw(object, points_as, shared)?;
            }
        }
        Ok(())
    }

    /// True if some object consists of trained Gaussians.
    pub fn has_gaussians(&self) -> bool {
        self.objects.iter().any(|object| matches!(object.geometry, Geometry::Gaussians(_)))
    }

    /// Returns the objects with only the splats that influence the camera. Splats of noise (classes 7 and 18) and
    /// withheld points are left out, unless an object has no others.
    pub fn framed(&self) -> Self {
        let surface = |(object, facts): (&Object, &ObjectFacts)| match &object.geometry {
            Geometry::Splats(cloud) if facts.noise => {
                let geometry = surface_of(cloud).map_or_else(|| object.geometry.clone(), Into::into);
                Object { geometry, ..object.clone() }
            }
            _ => object.clone(),
        };
        let objects = self.objects.iter().zip(&self.facts).map(surface).collect();
        Self { objects, facts: self.facts.clone(), ..Self::default() }
    }

    /// True if automatic framing includes stray points, such as isolated ones far from the others, because the options
    /// select all classes.
    pub fn frames_all(&self) -> bool {
        self.facts.iter().any(|facts| facts.all_classes)
    }

    /// True if there are objects, and all of them are trained Gaussians.
    pub fn all_gaussians(&self) -> bool {
        let mut geometries = self.objects.iter().map(|object| &object.geometry);
        self.has_gaussians() && geometries.all(|geometry| matches!(geometry, Geometry::Gaussians(_)))
    }
}

/// Loads the files of `objects`; a file that several objects use is loaded once. Paths are relative to `base_dir`.
/// Interior weights that neither the file nor the object's material states are estimated if the options request this,
/// or if splats and meshes are drawn together.
///
/// # Errors
/// Errors of [`crate::load()`], and [`Error::Model`] for a matrix that isn't an invertible affine map.
pub fn load_objects(
    objects: &[ObjectFile],
    base_dir: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<LoadedObjects, Error> {
    let mut loaded = load_uncolored(objects, base_dir, options, progress)?;
    loaded.color(true)?;
    for (object, facts) in loaded.objects.iter().zip(&mut loaded.facts) {
        facts.colored = is_colored(&object.geometry);
    }
    Ok(loaded)
}

fn is_colored(geometry: &Geometry) -> bool {
    match geometry {
        Geometry::Splats(cloud) => cloud.data().colors.is_some(),
        Geometry::Mesh(mesh) => mesh.colors.is_some() || mesh.is_textured(),
        Geometry::Octree(octree) => octree.cloud().data().colors.is_some(),
        Geometry::Gaussians(_) => true,
    }
}

/// Returns geometry in which a single colour replaces the file's colours.
fn painted(geometry: Geometry, Color(levels): Color, path: &Path) -> Result<Geometry, Error> {
    let color = levels.map(|level| linear(f64::from(level) / 255.0));
    let unsuitable = |holds: &str| {
        let problem = format!("holds {holds}, expected splats, points or a mesh for `color` and material.color");
        Error::Unsuitable { path: path.to_path_buf(), problem }
    };
    match geometry {
        Geometry::Splats(cloud) => {
            let data = Arc::unwrap_or_clone(cloud).into_data();
            let colors = Some(vec![color; data.centers.len()]);
            Ok(SplatCloud::new(CloudData { colors, ..data }, OnInvalid::Refuse)?.0.into())
        }
        Geometry::Mesh(mesh) => {
            let mesh = Arc::unwrap_or_clone(mesh);
            let colors = Some(vec![color; mesh.positions.len()]);
            Ok(Geometry::Mesh(Arc::new(Mesh { colors, texture: None, materials: None, ..mesh })))
        }
        Geometry::Octree(_) => Err(unsuitable("an octree")),
        Geometry::Gaussians(_) => Err(unsuitable("trained Gaussians")),
    }
}

/// Key of a loaded file: its path, and its use by an object, apart from conversion options. Objects with the same key
/// and conversion options share the loaded file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct FileUse {
    path: PathBuf,
    as_mesh: bool,
    /// True if the interior weight of the splats must be estimated when they are loaded.
    interior_weight: bool,
    /// True if the object's material states the interior weight, so that it isn't estimated.
    has_stated_weight: bool,
}

impl FileUse {
    /// Returns the key of the file that an object uses; `None` for an object without a file. Splats that are drawn with
    /// meshes need their interior weight, because they are blended over polygons by their coverage (rendering model
    /// §6).
    fn of(object: &ObjectFile, base_dir: &Path, options: &LoadOptions, among_meshes: bool) -> Option<Self> {
        let (file, as_mesh) = match (&object.splats, &object.mesh) {
            (Some(file), _) => (file, false),
            (None, Some(file)) => (file, true),
            (None, None) => return None,
        };
        let from_stdin = options.stdin.is_some() && file.as_os_str() == STDIN;
        let path = if from_stdin { file.clone() } else { base_dir.join(file) };
        // A material's interior weight takes precedence, so that none is estimated.
        let has_stated_weight = object.material.interior_weight.is_some();
        let interior_weight = (options.interior_weight || among_meshes) && !has_stated_weight;
        Some(Self { path, as_mesh, interior_weight, has_stated_weight })
    }

    /// Returns the loading options with the settings of this use for interior weights.
    fn options(&self, options: &LoadOptions) -> LoadOptions {
        options.clone().with_interior_weight(self.interior_weight).with_has_stated_weight(self.has_stated_weight)
    }
}

/// Loaded file, its notes, and the paths of files to which it refers.
struct LoadedFile {
    known: LoadedGeometry,
    notes: Vec<String>,
    beside: BTreeSet<PathBuf>,
}

/// Loads a file as geometry for an object, without colouring it by an attribute.
fn load_file(file: &FileUse, options: &LoadOptions, progress: &dyn Progress) -> Result<LoadedFile, Error> {
    progress.stage("reading", 0);
    let path = &file.path;
    let mut beside = BTreeSet::new();
    if file.as_mesh {
        let LoadedMesh { mesh, up, up_reason, notes } = load_mesh(path, options, &mut beside)?;
        let facts = ObjectFacts { up, up_reason, ..ObjectFacts::default() };
        let known = LoadedGeometry { geometry: Geometry::Mesh(mesh), facts, unused: Vec::new(), color_job: None };
        return Ok(LoadedFile { known, notes, beside });
    }
    let (read, levels) = read_needed(path, options, progress)?;
    if let Content::Gaussians(cloud) = &read.content {
        let (known, notes) = gaussians(cloud, &read, path, options)?;
        return Ok(LoadedFile { known, notes, beside });
    }
    let most = options.max_points().unwrap_or(usize::MAX);
    let thinned = matches!(&read.content, Content::Points(points) if points.len() > most);
    let (made, color_job) = splats_of(read, path, options, progress)?;
    let (facts, about_noise) = facts_of(&made, options);
    let facts = ObjectFacts { partial: levels.is_some(), thinned, ..facts };
    let LoadedCloud { cloud, octree, notes, beside: asked, unused, .. } = made;
    beside.extend(asked);
    let geometry = octree.map_or_else(|| cloud.into(), Geometry::Octree);
    let notes = notes.into_iter().chain(about_noise).collect();
    Ok(LoadedFile { known: LoadedGeometry { geometry, facts, unused, color_job }, notes, beside })
}

/// Returns facts about the splats of a file. Also returns a note if the file has noise or withheld points, which don't
/// influence up axis and view.
fn facts_of(made: &LoadedCloud, options: &LoadOptions) -> (ObjectFacts, Option<String>) {
    let cloud = made.octree.is_none().then_some(&made.cloud);
    let says = |comment: &str| cloud.is_some_and(|cloud| cloud.data().comments.iter().any(|c| c == comment));
    let (sparse, few) = match &made.conversion {
        Conversion::Points(report) => (SparseReason::of(report, &made.cloud), SparseReason::may_be_few(report)),
        _ => (None, false),
    };
    let transparent = match &made.octree {
        Some(octree) => octree.cloud().is_transparent(),
        None => made.cloud.is_transparent() && !made.gaussian,
    };
    let points = matches!(made.conversion, Conversion::Points(_)) || says(surfel_sample::OF_POINTS);
    let of_mesh = !points && !matches!(made.conversion, Conversion::None);
    let noise = cloud.and_then(|cloud| noise_points(&cloud.data().extras, cloud.len(), options));
    let about_noise = noise
        .as_ref()
        .map(|noise| format!("up and view don't count {} (`classes=all` makes them count)", noise.words()));
    let facts = ObjectFacts {
        up: made.up,
        up_reason: made.up_reason,
        points,
        sparse,
        few,
        sides_known: of_mesh || made.is_watertight || says(surfel_sample::BOTH_SIDES),
        is_watertight: made.is_watertight,
        flat: says(surfel_sample::FLAT_PARTS),
        fine: says(surfel_sample::FINE_SPLATS),
        each_side: says(EACH_SIDE),
        all_classes: options.convert.classes == Some(Classes::All),
        noise: noise.is_some(),
        transparent,
        ..ObjectFacts::default()
    };
    (facts, about_noise)
}

/// Counter of options without effect, over all objects of splats. It finds the options that affect none of these
/// objects.
#[derive(Default)]
struct UnusedOptions {
    /// Number of objects of splats that were counted.
    objects: usize,
    /// Options that don't affect some object of splats, by key. Each has the number of the objects that it doesn't
    /// affect, and the path and report of the first one.
    options: BTreeMap<&'static str, (usize, (PathBuf, UnusedOption))>,
}

impl UnusedOptions {
    fn add(&mut self, path: &Path, unused: Vec<UnusedOption>) {
        self.objects += 1;
        for option in unused {
            self.options.entry(option.option).or_insert((0, (path.to_path_buf(), option))).0 += 1;
        }
    }

    /// Returns the options that have no effect on any object.
    fn everywhere(self) -> impl Iterator<Item = (PathBuf, UnusedOption)> {
        let Self { objects, options } = self;
        options.into_values().filter(move |(times, _)| *times == objects).map(|(_, first)| first)
    }
}

/// Loads objects like [`load_objects`], without colouring them by attributes.
fn load_uncolored(
    objects: &[ObjectFile],
    base_dir: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<LoadedObjects, Error> {
    let mut loaded = LoadedObjects::default();
    let among_meshes = objects.iter().any(|o| o.mesh.is_some());
    // Files that were loaded so far, by their use and conversion options.
    let mut known: BTreeMap<FileUse, Vec<(&ConvertOptions, LoadedGeometry)>> = BTreeMap::new();
    let mut useless = UnusedOptions::default();
    for (i, object) in objects.iter().enumerate() {
        object.convert.validate(i)?;
        let world_from_object = object.world_from_object()?;
        let Some(file) = FileUse::of(object, base_dir, options, among_meshes) else { continue };
        let (path, as_mesh) = (file.path.clone(), file.as_mesh);
        let same_file = known.entry(file.clone()).or_default();
        let found = same_file.iter().find(|(convert, _)| **convert == object.convert).map(|(_, found)| found.clone());
        let LoadedGeometry { geometry, facts, unused, color_job } = match found {
            Some(found) => found,
            None => {
                let options = file.options(options).with_convert(&object.convert, base_dir);
                let LoadedFile { known, notes, beside } = load_file(&file, &options, progress)?;
                loaded.beside.extend(beside);
                loaded.notes.extend(notes.into_iter().map(|text| ObjectNote { path: path.clone(), text }));
                same_file.push((&object.convert, known.clone()));
                known
            }
        };
        if !as_mesh {
            useless.add(&path, unused);
        }
        loaded.facts.push(facts);
        loaded.color_jobs.0.push(color_job);
        let geometry = match object.material.color {
            Some(color) => painted(geometry, color, &path)?,
            None => geometry,
        };
        loaded.objects.push(Object { geometry, world_from_object, material: object.material });
    }
    drop(known);
    let labelled = |o: &Object| matches!(&o.geometry, Geometry::Splats(cloud) if cloud.data().labels.is_some());
    if let Some(attribute) = &options.label
        && !loaded.objects.iter().any(labelled)
    {
        let first = objects.iter().find_map(|o| o.splats.clone().or(o.mesh.clone())).unwrap_or_default();
        let problem = format!("no file has the attribute {attribute} for labels: choose another by `label=ATTRIBUTE`");
        return Err(Error::Unsuitable { path: first, problem });
    }
    loaded.unused.extend(useless.everywhere());
    Ok(loaded)
}

/// Reads the LOD nodes that views need, for objects of which only an overview was read
/// ([`crate::levels::Levels::Overview`]).
///
/// # Errors
/// Errors of [`load_objects`].
pub fn refine_objects(
    loaded: &mut LoadedObjects,
    objects: &[ObjectFile],
    base_dir: &Path,
    options: &LoadOptions,
    selection: &ViewSelection<'_>,
    progress: &dyn Progress,
) -> Result<(), Error> {
    let named = objects.iter().filter(|o| o.splats.is_some() || o.mesh.is_some());
    let partial: Vec<(usize, &ObjectFile)> =
        named.enumerate().filter(|(i, _)| loaded.facts.get(*i).is_some_and(|f| f.partial)).collect();
    let colored: HashSet<(&Path, &str)> = loaded.colorings.notes().collect();
    loaded.notes.retain(|note| !colored.contains(&(note.path.as_path(), note.text.as_str())));
    // Notes on each file, with the index of the object that was read last.
    let mut fresh: HashMap<PathBuf, (usize, Vec<ObjectNote>)> = HashMap::new();
    for (i, object) in &partial {
        let levels = selection.levels(object.world_from_object()?);
        let options = options.clone().with_levels(Some(levels));
        let mut finer = load_uncolored(std::slice::from_ref(object), base_dir, &options, progress)?;
        let (Some(new), Some(facts)) = (finer.objects.pop(), finer.facts.pop()) else { continue };
        loaded.objects[*i].geometry = new.geometry;
        loaded.color_jobs.0[*i] = finer.color_jobs.0.pop().flatten();
        // The new splats are marked as partial until they are coloured.
        loaded.facts[*i] = ObjectFacts { partial: true, noise: loaded.facts[*i].noise || facts.noise, ..facts };
        for note in finer.notes {
            let (of, notes) = fresh.entry(note.path.clone()).or_default();
            if *of != *i {
                notes.clear();
            }
            *of = *i;
            notes.push(note);
        }
    }
    loaded.notes.retain(|note| !fresh.contains_key(&note.path));
    let mut fresh: Vec<_> = fresh.into_iter().collect();
    fresh.sort_by(|(a, (i, _)), (b, (j, _))| (i, a).cmp(&(j, b)));
    loaded.notes.extend(fresh.into_iter().flat_map(|(_, (_, notes))| notes));
    loaded.color(false)?;
    for (i, _) in partial {
        let colored = is_colored(&loaded.objects[i].geometry);
        loaded.facts[i] = ObjectFacts { partial: false, colored, ..loaded.facts[i] };
    }
    Ok(())
}

/// Loads the matcap that a scene file names. Returns `None` if it names none, or if its shader isn't `matcap`. The path
/// in the file is relative to `base_dir`.
///
/// # Errors
/// [`Error::Io`] if the file can't be read or isn't a matcap.
pub fn load_matcap(file: &SceneFile, base_dir: &Path) -> Result<Option<Arc<Matcap>>, Error> {
    let named = file.matcap.as_ref().filter(|_| file.settings.shader == Shader::Matcap);
    Ok(named.map(|path| surfel_io::load_matcap(&base_dir.join(path))).transpose()?.map(Arc::new))
}

/// Assembles a scene from a scene file and its loaded objects, in the file's order. The matcap isn't loaded; see
/// [`load_matcap`].
///
/// # Errors
/// [`Error::Model`] for the first number that is out of range.
pub fn assemble(file: &SceneFile, objects: Vec<Object>) -> Result<Scene, Error> {
    let mut scene = Scene {
        up: file.up,
        background: file.background,
        ambient: file.ambient,
        lights: file.lights.clone(),
        sky: file.sky.clone(),
        ground: file.ground,
        matcap: None,
        objects,
    };
    for (object, described) in scene.objects.iter_mut().zip(&file.objects) {
        object.material = described.material;
    }
    scene.validate()?;
    Ok(scene)
}

/// Loads all files that a scene file names, and assembles the scene. Also returns notes on the files. Interior weights
/// are estimated if the options request them, or if the scene file's settings or meshes may need them.
///
/// # Errors
/// Errors of [`load_objects`], [`load_matcap`] and [`assemble`].
pub fn load_scene(
    file: &SceneFile,
    base_dir: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<(Scene, Vec<ObjectNote>), Error> {
    let options = options.clone().for_settings(&file.settings);
    let mut loaded = load_objects(&file.objects, base_dir, &options, progress)?;
    loaded.draw_points(&file.objects)?;
    let scene = Scene { matcap: load_matcap(file, base_dir)?, ..assemble(file, loaded.objects)? };
    Ok((scene, loaded.notes))
}
