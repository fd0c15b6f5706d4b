//! From inputs and flags to one scene: flag > scene-file key > preset > default.

use crate::args::RenderArgs;
use crate::camera::{self, Turntable};
use crate::console::Console;
use crate::failure::Failure;
use crate::paths::absolute;
use crate::splats;
use crate::stdin::{self, Stdin, is_stdin};
use glam::DVec3;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel::framing::{NamedView, Upright, ViewChoice};
use surfel::levels::Levels;
use surfel::model::{Matcap, ObjectFile, SceneFile, Shader, Up};
use surfel::scene::{AutoOptions, DEFAULT_SIZE, LoadedObjects};
use surfel::{Camera, Light, LoadOptions, Preset, Scene, Settings, View};

/// What an image is of.
pub(crate) enum Source {
    /// A scene file.
    Scene(Box<SceneSource>),
    /// Files that make one scene.
    Geometry(Vec<PathBuf>),
}

/// A scene file that has been read.
pub(crate) struct SceneSource {
    pub(crate) file: SceneFile,
    /// Which keys its `settings` have.
    pub(crate) keys: BTreeSet<String>,
    /// What messages call it.
    pub(crate) name: PathBuf,
    /// What its paths are relative to.
    pub(crate) base: PathBuf,
}

impl Source {
    /// What these inputs are.
    pub(crate) fn of(inputs: &[PathBuf], stdin: &Stdin) -> Result<Self, Failure> {
        for path in inputs {
            let scene = if is_stdin(path) {
                let bytes = stdin.bytes()?;
                let name = Path::new("stdin");
                looks_like_scene(&bytes).then(|| surfel::scene::parse_scene_file(&bytes, name)).transpose()?
            } else if surfel::scene::is_scene_file(path) && inputs.len() == 1 {
                Some(surfel::scene::read_scene_file(path)?)
            } else {
                None
            };
            if inputs.len() > 1 && (scene.is_some() || surfel::scene::is_scene_file(path)) {
                return Err(Failure::usage(format!(
                    "{}: a scene file goes alone, expected one scene file or any number of splat, point and mesh files",
                    stdin::display(path)
                )));
            }
            if let Some((file, keys)) = scene {
                let name = if is_stdin(path) { PathBuf::from("stdin") } else { path.clone() };
                let base = path.parent().unwrap_or(Path::new("")).to_path_buf();
                return Ok(Self::Scene(Box::new(SceneSource { file, keys, name, base })));
            }
        }
        Ok(Self::Geometry(inputs.to_vec()))
    }
}

/// True for JSON with the keys of a scene file, which glTF hasn't.
fn looks_like_scene(bytes: &[u8]) -> bool {
    let json = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if !json.trim_ascii_start().starts_with(b"{") {
        return false;
    }
    let json: serde_json::Value = serde_json::from_slice(json).unwrap_or_default();
    json.get("asset").is_none() && (json.get("camera").is_some() || json.get("objects").is_some())
}

/// A scene, and the scene file that gives the same image. Its paths are absolute, or `-` for stdin.
pub(crate) struct Resolved {
    pub(crate) file: SceneFile,
    pub(crate) scene: Scene,
    pub(crate) turntable: Turntable,
    /// Files that the objects' files refer to, found or not; absolute.
    pub(crate) beside: BTreeSet<PathBuf>,
}

/// Loads a scene; `cameras` are those of `--cameras`.
pub(crate) fn resolve(
    source: Source,
    cameras: &[(String, Camera)],
    args: &RenderArgs,
    stdin: &Stdin,
    console: &Console,
) -> Result<Resolved, Failure> {
    let first = cameras.first().map(|(_, camera)| camera.clone());
    let camera = first.map_or_else(|| camera_file(args), |camera| Ok(Some(camera)))?;
    let camera = (camera, cameras);
    match source {
        Source::Scene(scene) => of_scene_file(*scene, camera, args, stdin, console),
        Source::Geometry(inputs) => of_geometry(&inputs, camera, args, stdin, console),
    }
}

/// Loads objects, whose `convert` has the flags' say, with paths relative to `base`: large files of levels as far as
/// placing a camera takes it.
fn load(
    objects: &[ObjectFile],
    base: &Path,
    (settings, up): (&Settings, Option<Up>),
    args: &RenderArgs,
    stdin: &Stdin,
    console: &Console,
) -> Result<(LoadedObjects, LoadOptions), Failure> {
    let from_stdin = objects.iter().flat_map(|o| [&o.splats, &o.mesh]).flatten().any(|path| is_stdin(path));
    let bytes = if from_stdin { Some(stdin.bytes()?) } else { None };
    // The preset that an image is verified against antialiases edges.
    let options = LoadOptions::default().with_interior_weight(args.verify).for_settings(settings).with_stdin(bytes);
    let options = options.with_up(args.up.and_then(|choice| choice.0).or(up));
    let progress = console.progress();
    let options = options.with_levels(Some(Levels::Overview));
    let loaded = surfel::scene::load_objects(objects, base, &options, &progress)?;
    drop(progress);
    if !loaded.facts.iter().any(|facts| facts.partial) {
        tell(&loaded, args, console)?;
    }
    Ok((loaded, options))
}

/// Reads what the views need of files of levels.
fn refine(
    loaded: &mut LoadedObjects,
    (objects, base, options): (&[ObjectFile], &Path, &LoadOptions),
    (views, error_px): (&[View], f64),
    args: &RenderArgs,
    console: &Console,
) -> Result<(), Failure> {
    if loaded.facts.iter().any(|facts| facts.partial) {
        let progress = console.progress();
        surfel::scene::refine_objects(loaded, objects, base, options, (views, error_px), &progress)?;
        drop(progress);
        tell(loaded, args, console)?;
    }
    Ok(())
}

/// The views of all pictures.
fn views(
    camera: &Camera,
    given: &[(String, Camera)],
    turntable: &Turntable,
    args: &RenderArgs,
) -> Result<Vec<View>, Failure> {
    if !given.is_empty() {
        return given.iter().map(|(_, camera)| camera::view(camera, args)).collect();
    }
    let frames = args.frames.unwrap_or(1);
    let turned = |i: u32| turntable.at(f64::from(i) / f64::from(frames), camera, &[]).0;
    (0..frames).map(|i| camera::view(&turned(i), args)).collect()
}

/// Says what was found in files.
fn tell(loaded: &LoadedObjects, args: &RenderArgs, console: &Console) -> Result<(), Failure> {
    for note in &loaded.notes {
        console.note(&format!("{}: {}", stdin::display(&note.path), note.text));
    }
    splats::check_used(&args.splats, &loaded.unused, console)?;
    let colorings = loaded.colorings.iter().map(|(path, coloring)| (path.as_path(), coloring));
    splats::write_color_bar(&args.splats, args.force, colorings, console)
}

fn of_scene_file(
    source: SceneSource,
    (given_camera, cameras): (Option<Camera>, &[(String, Camera)]),
    args: &RenderArgs,
    stdin: &Stdin,
    console: &Console,
) -> Result<Resolved, Failure> {
    let SceneSource { mut file, keys, name: path, base } = source;
    file.settings = settings(preset_under(args.preset, file.settings, &keys), args);
    if let Some(given) = given_camera {
        file.camera = given;
    }
    // Numbers out of range are told before minutes go into loading.
    let out_of_range = |e: surfel::model::ModelError| Failure::input(format!("{}: {e}", path.display()));
    file.settings.validate().map_err(out_of_range)?;
    if args.view.is_none() {
        file.camera.validate().map_err(out_of_range)?;
    }
    for (i, object) in file.objects.iter_mut().enumerate() {
        object.world_from_object().map_err(out_of_range)?;
        splats::apply(&args.splats, &mut object.convert)?;
        object.convert.all_levels |= args.all_levels;
        object.convert.validate(i).map_err(out_of_range)?;
    }
    let (mut loaded, options) = load(&file.objects, &base, (&file.settings, file.up), args, stdin, console)?;
    if let Some(choice) = args.up {
        file.up = choice.0.or(file.up);
    }
    if let Some(background) = args.background {
        file.background = background;
    }
    if args.shadows {
        // Nobody sees the shadows of the default headlight.
        file.lights = file.lights.take().map(with_shadows);
    }
    let up = file.up.or_else(|| loaded.facts.first().map(|f| f.up)).unwrap_or(Up::PlusY);
    let objects_only = Scene { objects: loaded.objects.clone(), ..Scene::default() };
    if let Some(framed) = camera::reframe(&file.camera, &objects_only, up, args) {
        file.camera = framed;
    }
    file.camera.validate().map_err(out_of_range)?;
    camera::apply_flags(&mut file.camera, &objects_only, up, false, args);
    cull(&mut file, args);
    // A scene file's camera turns about what it looks at, about the scene's up axis or else its own.
    let axis = file.up.map_or(DVec3::from(file.camera.up).normalize_or(DVec3::Y), Up::vector);
    let turntable = Turntable { center: file.camera.target.into(), axis };
    let seen = (&views(&file.camera, cameras, &turntable, args)?[..], file.settings.lod_error_px);
    refine(&mut loaded, (&file.objects, &base, &options), seen, args, console)?;
    let beside = loaded.beside.iter().map(|path| absolute(path)).collect::<Result<_, _>>()?;
    let mut scene = surfel::scene::assemble(&file, loaded.objects)
        .map_err(|e| Failure::input(format!("{}: {e}", path.display())))?;
    absolute_paths(&mut file, &base)?;
    scene.matcap = matcap(&mut file, args)?;
    Ok(Resolved { file, scene, turntable, beside })
}

fn of_geometry(
    inputs: &[PathBuf],
    (given_camera, cameras): (Option<Camera>, &[(String, Camera)]),
    args: &RenderArgs,
    stdin: &Stdin,
    console: &Console,
) -> Result<Resolved, Failure> {
    let preset = args.preset.unwrap_or_default();
    let mut settings = settings(preset.apply(Settings::default().with_shader(Shader::Phong)), args);
    let mut objects: Vec<ObjectFile> = inputs.iter().map(|path| surfel::scene::bare_object(path)).collect();
    for object in &mut objects {
        splats::apply(&args.splats, &mut object.convert)?;
        object.convert.all_levels |= args.all_levels;
    }
    let (mut loaded, load_options) = load(&objects, Path::new(""), (&settings, None), args, stdin, console)?;
    let paths: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
    if args.transparency.is_none()
        && let Some((transparency, note)) = surfel::scene::auto_transparency(&loaded, &paths)
    {
        settings.transparency = transparency;
        console.note(&format!("{}: {}", note.path.display(), note.text));
    }
    if args.depth_tolerance.is_none()
        && let Some(tolerance) = surfel::scene::auto_depth_tolerance(&loaded)
    {
        settings.depth_tolerance = tolerance;
    }
    let given = args.up.and_then(|choice| choice.0);
    let up = given.unwrap_or_else(|| note_up(&loaded, console));
    let view = match args.view.unwrap_or_default() {
        ViewChoice::Auto if given_camera.is_none() && args.eye.is_none() && args.target.is_none() => {
            let angles = surfel::framing::best_view(&loaded.objects, up);
            console.note(&format!("seen from --view {angles} (azimuth and elevation, by what it shows)"));
            ViewChoice::From(angles)
        }
        // Where flags say the eye or the target, the other is that of the usual view.
        ViewChoice::Auto => ViewChoice::Named(NamedView::Iso),
        given => given,
    };
    let own_near = given_camera.is_none();
    let options = AutoOptions::default()
        .with_up(Some(up))
        .with_view(view)
        .with_projection(camera::projection(args))
        .with_size(args.size.unwrap_or(DEFAULT_SIZE))
        .with_camera(given_camera)
        .with_background(args.background)
        .with_settings(settings)
        .with_turning(args.turntable);
    let mut file = surfel::scene::auto_scene(objects, &loaded, &options)?;
    let objects_only = Scene { objects: loaded.objects.clone(), ..Scene::default() };
    let center = surfel::framing::scene_center(&objects_only).unwrap_or_default();
    if args.eye.is_some() && args.target.is_none() && own_near {
        file.camera.target = center.into();
    }
    camera::apply_flags(&mut file.camera, &objects_only, up, own_near, args);
    camera::view(&file.camera, args)?;
    // The lights belong to the camera, wherever the flags have put it.
    let lights = surfel::scene::studio_lights(&file.camera);
    file.lights = match (&args.cameras, args.shadows) {
        // One for all cameras, so that the scene stays as it is: the light along the view.
        (Some(_), _) => None,
        (None, true) => Some(with_shadows(lights)),
        (None, false) => Some(lights),
    };
    cull(&mut file, args);
    let turntable = Turntable { center, axis: up.vector() };
    let seen = (&views(&file.camera, cameras, &turntable, args)?[..], file.settings.lod_error_px);
    refine(&mut loaded, (&file.objects, Path::new(""), &load_options), seen, args, console)?;
    let beside = loaded.beside.iter().map(|path| absolute(path)).collect::<Result<_, _>>()?;
    let mut scene = surfel::scene::assemble(&file, loaded.objects)?;
    absolute_paths(&mut file, Path::new(""))?;
    scene.matcap = matcap(&mut file, args)?;
    Ok(Resolved { file, scene, turntable, beside })
}

/// The up axis that the files or their shape say, and what to do if it is wrong.
fn note_up(loaded: &LoadedObjects, console: &Console) -> Up {
    let Upright { up, reason } = surfel::scene::auto_up(loaded);
    let other = if up == Up::PlusZ { Up::PlusY } else { Up::PlusZ };
    console.note(&format!("up is {up} ({reason}); if that is wrong: --up {other}"));
    up
}

fn camera_file(args: &RenderArgs) -> Result<Option<Camera>, Failure> {
    let Some(path) = &args.camera else { return Ok(None) };
    let camera = surfel::io::scene_file::read_camera(path)?;
    camera.validate().map_err(|e| Failure::input(format!("{}: {e}", path.display())))?;
    Ok(Some(camera))
}

/// The preset's choices, but what the file says itself stays.
fn preset_under(preset: Option<Preset>, file: Settings, keys: &BTreeSet<String>) -> Settings {
    let Some(preset) = preset else { return file };
    let mut settings = preset.apply(file);
    let says = |key: &str| keys.contains(key);
    if says("filter") {
        settings.filter = file.filter;
    }
    if says("cutoff") {
        settings.cutoff = file.cutoff;
    }
    if says("prefilter_radius_px") {
        settings.prefilter_radius_px = file.prefilter_radius_px;
    }
    if says("mapping") {
        settings.mapping = file.mapping;
    }
    if says("edge_aa") {
        settings.edge_aa = file.edge_aa;
    }
    settings
}

fn settings(base: Settings, args: &RenderArgs) -> Settings {
    base.with_filter(args.filter.unwrap_or(base.filter))
        .with_cutoff(args.cutoff.unwrap_or(base.cutoff))
        .with_prefilter_radius_px(args.prefilter.unwrap_or(base.prefilter_radius_px))
        .with_mapping(args.mapping.unwrap_or(base.mapping))
        .with_depth_tolerance(args.depth_tolerance.unwrap_or(base.depth_tolerance))
        .with_shader(args.shader.or(args.matcap.as_ref().map(|_| Shader::Matcap)).unwrap_or(base.shader))
        .with_edge_aa(args.edge_aa.unwrap_or(base.edge_aa))
        .with_transparency(args.transparency.unwrap_or(base.transparency))
        .with_clip(args.clip.unwrap_or(base.clip))
        .with_accumulate(args.accumulate.unwrap_or(base.accumulate))
        .with_lod_error_px(args.lod_error.unwrap_or(base.lod_error_px))
}

fn with_shadows(mut lights: Vec<Light>) -> Vec<Light> {
    for light in &mut lights {
        if let Light::Directional { shadow, .. } | Light::Spot { shadow, .. } = light {
            *shadow = true;
        }
    }
    lights
}

/// What `--cull` says, which decides for all objects.
fn cull(file: &mut SceneFile, args: &RenderArgs) {
    if let Some(cull) = args.splats.cull {
        file.objects.iter_mut().for_each(|object| object.material.cull = cull);
    }
}

/// Makes all paths of a scene file absolute, but the name of stdin.
fn absolute_paths(file: &mut SceneFile, base: &Path) -> Result<(), Failure> {
    crate::paths::for_each(file, |path| {
        *path = absolute(&base.join(&*path))?;
        Ok(())
    })
}

/// The matcap that the flag or else the file names, whose paths are absolute; `None` for the built-in one, and where
/// none is asked for.
fn matcap(file: &mut SceneFile, args: &RenderArgs) -> Result<Option<Arc<Matcap>>, Failure> {
    if let Some(given) = &args.matcap {
        file.matcap = if given.as_os_str() == "builtin" { None } else { Some(absolute(given)?) };
    }
    Ok(surfel::scene::load_matcap(file, Path::new(""))?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel::model::{Filter, Mapping};

    #[test]
    fn preset_changes_only_what_the_file_leaves_open() {
        let file = Settings::default().with_filter(Filter::Ewa);
        let keys = BTreeSet::from(["filter".to_owned()]);
        let settings = preset_under(Some(Preset::Fastest), file, &keys);
        assert_eq!((settings.filter, settings.mapping, settings.cutoff), (Filter::Ewa, Mapping::Affine, 2.0));
        assert_eq!(preset_under(None, file, &keys), file);
    }
}
