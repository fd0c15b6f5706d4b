//! From a scene file to a scene.

use crate::load::load_mesh;
use crate::{Error, HybridObject, LoadOptions, Prepared, prepare};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_io::IoError;
use surfel_model::{
    Geometry, Hybrid, Matcap, Object, ObjectFile, Scene, SceneFile, Settings, Shader, Transparency, Up,
};
use surfel_sample::Progress;

/// Largest scene file that is read, in bytes: far above any real one.
const MAX_SCENE_BYTES: u64 = 64 << 20;

/// Something the user should know about a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectNote {
    /// The file.
    pub path: PathBuf,
    /// A sentence without a full stop.
    pub text: String,
}

/// A scene's objects, loaded.
#[derive(Clone, Debug, Default)]
pub struct LoadedObjects {
    /// The objects, in the scene file's order.
    pub objects: Vec<Object>,
    /// Those of the objects that are octrees; the objects themselves are their finest splats.
    pub hybrids: Vec<HybridObject>,
    /// What is known of each object.
    pub facts: Vec<ObjectFacts>,
    /// What was dropped, assumed or estimated, file by file.
    pub notes: Vec<ObjectNote>,
}

/// What automatic framing and lighting need to know of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectFacts {
    /// Which axis is up in its file.
    pub up: Up,
    /// It has colours.
    pub colored: bool,
    /// Its splats cover a closed mesh from outside.
    pub closed: bool,
}

/// Reads a scene file, and which keys its `settings` object has.
///
/// # Errors
/// [`Error::Io`] if it can't be read or isn't a scene file, with line and column.
pub fn read_scene_file(path: &Path) -> Result<(SceneFile, BTreeSet<String>), Error> {
    let system = |source| IoError::System { path: path.to_path_buf(), action: "read it", source };
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(system)?;
    // One byte more than is allowed: the parser then meets a cut-off file and says so.
    file.take(MAX_SCENE_BYTES + 1).read_to_end(&mut bytes).map_err(system)?;
    let scene = surfel_io::scene_file::parse(&bytes, path)?;
    let json = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    let raw: serde_json::Value = serde_json::from_slice(json).unwrap_or_default();
    let keys = raw.get("settings").and_then(|s| s.as_object()).map(|s| s.keys().cloned().collect());
    Ok((scene, keys.unwrap_or_default()))
}

/// True if settings need interior weights in some scene ([`surfel_render::needs_interior_weight`] knows once it is loaded).
pub fn may_need_interior_weight(settings: &Settings) -> bool {
    settings.edge_aa || matches!(settings.transparency, Transparency::ABuffer { .. })
}

/// What is known of a file that was loaded already.
#[derive(Clone)]
struct Known {
    geometry: Geometry,
    up: Up,
    closed: bool,
    hybrid: Option<Arc<Hybrid>>,
}

/// Loads the files of `objects`; each file once, however often it is used. Paths are relative to `base_dir`. Interior
/// weights are estimated where the options ask for it and where there are meshes among splats.
///
/// # Errors
/// As [`prepare`], and [`Error::Model`] for a matrix that is no invertible affine map.
pub fn load_objects(
    objects: &[ObjectFile],
    base_dir: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<LoadedObjects, Error> {
    let mut loaded = LoadedObjects::default();
    // Splats are blended over polygons by their coverage (rendering model §6).
    let among_meshes = objects.iter().any(|o| o.mesh.is_some());
    let mut known: BTreeMap<(PathBuf, bool, bool), Known> = BTreeMap::new();
    for object in objects {
        let world_from_object = object.world_from_object()?;
        let (file, as_mesh) = match (&object.splats, &object.mesh) {
            (Some(file), _) => (file, false),
            (None, Some(file)) => (file, true),
            (None, None) => continue,
        };
        let path = base_dir.join(file);
        // A material's own interior weight wins, so then none need be estimated.
        let interior_weight = (options.interior_weight || among_meshes) && object.material.interior_weight.is_none();
        let options = &LoadOptions { interior_weight, ..options.clone() };
        let key = (path.clone(), as_mesh, interior_weight);
        let Known { geometry, up, closed, hybrid } = match known.get(&key) {
            Some(found) => found.clone(),
            None => {
                let (found, notes) = if as_mesh {
                    let (mesh, up, notes) = load_mesh(&path, options)?;
                    (Known { geometry: Geometry::Mesh(mesh), up, closed: false, hybrid: None }, notes)
                } else {
                    let Prepared { cloud, up, closed, hybrid, notes, .. } = prepare(&path, options, progress)?;
                    (Known { geometry: Geometry::Splats(Arc::new(cloud)), up, closed, hybrid }, notes)
                };
                loaded.notes.extend(notes.into_iter().map(|text| ObjectNote { path: path.clone(), text }));
                known.insert(key, found.clone());
                found
            }
        };
        let colored = match &geometry {
            Geometry::Splats(cloud) => cloud.data().colors.is_some(),
            Geometry::Mesh(mesh) => mesh.colors.is_some() || mesh.texture.is_some(),
        };
        loaded.hybrids.extend(hybrid.map(|hybrid| HybridObject { object: loaded.objects.len(), hybrid }));
        loaded.facts.push(ObjectFacts { up, colored, closed });
        loaded.objects.push(Object { geometry, world_from_object, material: object.material });
    }
    Ok(loaded)
}

/// The matcap that a scene file names, if its settings draw with one. Its path is relative to `base_dir`.
///
/// # Errors
/// [`Error::Io`] if it can't be read or isn't one.
pub fn load_matcap(file: &SceneFile, base_dir: &Path) -> Result<Option<Arc<Matcap>>, Error> {
    let named = file.matcap.as_ref().filter(|_| file.settings.shader == Shader::Matcap);
    Ok(named.map(|path| surfel_io::load_matcap(&base_dir.join(path))).transpose()?.map(Arc::new))
}

/// The scene that a scene file describes, with its objects already loaded (in the file's order), and without its matcap
/// ([`load_matcap`]).
///
/// # Errors
/// [`Error::Model`] naming the number that is out of range.
pub fn assemble(file: &SceneFile, objects: Vec<Object>) -> Result<Scene, Error> {
    let mut scene = Scene {
        up: file.up,
        background: file.background,
        ambient: file.ambient,
        lights: file.lights.clone(),
        matcap: None,
        objects,
    };
    for (object, described) in scene.objects.iter_mut().zip(&file.objects) {
        object.material = described.material;
    }
    scene.validate()?;
    Ok(scene)
}

/// Loads everything that a scene file names. Interior weights are estimated only where its settings need them.
///
/// # Errors
/// As [`load_objects`] and [`assemble`].
pub fn load_scene(
    file: &SceneFile,
    base_dir: &Path,
    options: &LoadOptions,
    progress: &dyn Progress,
) -> Result<(Scene, Vec<ObjectNote>), Error> {
    let needed = options.interior_weight || may_need_interior_weight(&file.settings);
    let options = LoadOptions { interior_weight: needed, ..options.clone() };
    let loaded = load_objects(&file.objects, base_dir, &options, progress)?;
    let scene = Scene { matcap: load_matcap(file, base_dir)?, ..assemble(file, loaded.objects)? };
    Ok((scene, loaded.notes))
}
