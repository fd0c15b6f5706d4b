//! From inputs and flags to one scene: flag > scene-file key > preset > default.

use crate::args::RenderArgs;
use crate::camera::{self, Turntable};
use crate::console::Console;
use crate::failure::Failure;
use glam::DVec3;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel::model::{Matcap, ObjectFile, Shader};
use surfel::{
    AutoOptions, Camera, DEFAULT_SIZE, HybridObject, Light, LoadOptions, LoadedObjects, Preset, Scene, SceneFile,
    Settings, Up,
};

/// A scene, and the scene file that gives the same picture.
pub(crate) struct Resolved {
    pub(crate) file: SceneFile,
    pub(crate) scene: Scene,
    pub(crate) turntable: Turntable,
    /// Objects that are octrees.
    pub(crate) hybrids: Vec<HybridObject>,
}

pub(crate) fn resolve(args: &RenderArgs, console: &Console) -> Result<Resolved, Failure> {
    let scene_file = args.inputs.iter().find(|path| surfel::is_scene_file(path));
    match scene_file {
        Some(path) if args.inputs.len() > 1 => Err(Failure::usage(format!(
            "{}: a scene file goes alone, expected one scene file or any number of splat, point and mesh files",
            path.display()
        ))),
        Some(path) => of_scene_file(path, args, console),
        None => of_geometry(args, console),
    }
}

fn load_options(args: &RenderArgs, settings: &Settings) -> LoadOptions {
    LoadOptions {
        repair: args.repair,
        texture: args.texture.clone(),
        // The preset that a picture is verified against antialiases edges.
        interior_weight: surfel::may_need_interior_weight(settings) || args.verify,
        ..LoadOptions::default()
    }
}

fn load(
    objects: &[ObjectFile],
    base: &Path,
    options: &LoadOptions,
    console: &Console,
) -> Result<LoadedObjects, Failure> {
    let progress = console.progress();
    let loaded = surfel::load_objects(objects, base, options, &progress)?;
    drop(progress);
    for note in &loaded.notes {
        console.note(&format!("{}: {}", note.path.display(), note.text));
    }
    Ok(loaded)
}

fn of_scene_file(path: &Path, args: &RenderArgs, console: &Console) -> Result<Resolved, Failure> {
    let (mut file, keys) = surfel::read_scene_file(path)?;
    file.settings = settings(preset_under(args.preset, file.settings, &keys), args);
    if let Some(given) = camera_file(args)? {
        file.camera = given;
    }
    // Numbers out of range are told before minutes go into loading.
    let out_of_range = |e: surfel::model::ModelError| Failure::input(format!("{}: {e}", path.display()));
    file.settings.validate().map_err(out_of_range)?;
    if args.view.is_none() {
        file.camera.validate().map_err(out_of_range)?;
    }
    file.objects.iter().try_for_each(|object| object.world_from_object().map(drop)).map_err(out_of_range)?;
    let base = path.parent().unwrap_or(Path::new(""));
    let loaded = load(&file.objects, base, &load_options(args, &file.settings), console)?;
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
    let hybrids = loaded.hybrids;
    let mut scene =
        surfel::assemble(&file, loaded.objects).map_err(|e| Failure::input(format!("{}: {e}", path.display())))?;
    absolute_paths(&mut file, base)?;
    scene.matcap = matcap(&mut file, args)?;
    // A scene file's camera turns about what it looks at, about the scene's up axis or else its own.
    let axis = file.up.map_or(DVec3::from(file.camera.up).normalize_or(DVec3::Y), Up::vector);
    let turntable = Turntable { center: file.camera.target.into(), axis };
    Ok(Resolved { file, scene, turntable, hybrids })
}

fn of_geometry(args: &RenderArgs, console: &Console) -> Result<Resolved, Failure> {
    let preset = args.preset.unwrap_or_default();
    let settings = settings(preset.apply(Settings { shader: Shader::Phong, ..Settings::default() }), args);
    let objects: Vec<ObjectFile> = args.inputs.iter().map(|path| surfel::bare_object(path)).collect();
    let loaded = load(&objects, Path::new(""), &load_options(args, &settings), console)?;
    let given = args.up.and_then(|choice| choice.0);
    let format_up = loaded.facts.first().map_or(Up::PlusY, |f| f.up);
    let up = given.unwrap_or(format_up);
    if given.is_none() {
        console.note(&format!("up is {up} (by the file or its format; --up says otherwise)"));
    }
    let given_camera = camera_file(args)?;
    let own_near = given_camera.is_none();
    let options = AutoOptions {
        up: Some(up),
        view: args.view.unwrap_or_default(),
        projection: camera::projection(args),
        size: args.size.unwrap_or(DEFAULT_SIZE),
        camera: given_camera,
        background: args.background.unwrap_or([1.0; 4]),
        settings,
        turning: args.turntable,
    };
    let mut file = surfel::auto_scene(objects, &loaded, &options)?;
    let objects_only = Scene { objects: loaded.objects.clone(), ..Scene::default() };
    let center = surfel::scene_center(&objects_only).unwrap_or_default();
    if args.eye.is_some() && args.target.is_none() && own_near {
        file.camera.target = center.into();
    }
    camera::apply_flags(&mut file.camera, &objects_only, up, own_near, args);
    camera::view(&file.camera, args)?;
    // The lights belong to the camera, wherever the flags have put it.
    let lights = surfel::studio_lights(&file.camera);
    file.lights = Some(if args.shadows { with_shadows(lights) } else { lights });
    let hybrids = loaded.hybrids;
    let mut scene = surfel::assemble(&file, loaded.objects)?;
    absolute_paths(&mut file, Path::new(""))?;
    scene.matcap = matcap(&mut file, args)?;
    Ok(Resolved { file, scene, turntable: Turntable { center, axis: up.vector() }, hybrids })
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
    Settings {
        filter: args.filter.unwrap_or(base.filter),
        cutoff: args.cutoff.unwrap_or(base.cutoff),
        prefilter_radius_px: args.prefilter.unwrap_or(base.prefilter_radius_px),
        mapping: args.mapping.unwrap_or(base.mapping),
        depth_tolerance: args.depth_tolerance.unwrap_or(base.depth_tolerance),
        shader: args.shader.or(args.matcap.as_ref().map(|_| Shader::Matcap)).unwrap_or(base.shader),
        edge_aa: args.edge_aa.unwrap_or(base.edge_aa),
        transparency: args.transparency.unwrap_or(base.transparency),
        clip: args.clip.unwrap_or(base.clip),
        accumulate: args.accumulate.unwrap_or(base.accumulate),
    }
}

fn with_shadows(mut lights: Vec<Light>) -> Vec<Light> {
    for light in &mut lights {
        if let Light::Directional { shadow, .. } | Light::Spot { shadow, .. } = light {
            *shadow = true;
        }
    }
    lights
}

/// A printed scene may be saved anywhere.
fn absolute_paths(file: &mut SceneFile, base: &Path) -> Result<(), Failure> {
    for object in &mut file.objects {
        for path in [&mut object.splats, &mut object.mesh].into_iter().flatten() {
            *path = absolute(&base.join(&*path))?;
        }
    }
    if let Some(path) = &mut file.matcap {
        *path = absolute(&base.join(&*path))?;
    }
    Ok(())
}

fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    std::path::absolute(path).map_err(|e| Failure::other(format!("{}: has no absolute path: {e}", path.display())))
}

/// The matcap that the flag or else the file names, whose paths are absolute; `None` for the built-in one, and where none is
/// asked for.
fn matcap(file: &mut SceneFile, args: &RenderArgs) -> Result<Option<Arc<Matcap>>, Failure> {
    if let Some(given) = &args.matcap {
        file.matcap = if given.as_os_str() == "builtin" { None } else { Some(absolute(given)?) };
    }
    Ok(surfel::load_matcap(file, Path::new(""))?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel::model::{Filter, Mapping};

    #[test]
    fn preset_changes_only_what_the_file_leaves_open() {
        let file = Settings { filter: Filter::Ewa, ..Settings::default() };
        let keys = BTreeSet::from(["filter".to_owned()]);
        let settings = preset_under(Some(Preset::Fastest), file, &keys);
        assert_eq!((settings.filter, settings.mapping, settings.cutoff), (Filter::Ewa, Mapping::Affine, 2.0));
        assert_eq!(preset_under(None, file, &keys), file);
    }
}
