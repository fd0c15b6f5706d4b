//! Builds the scene for files without a scene file: chooses up axis, view, camera, lights and settings.

use super::{
    Request, Resolved, absolute_paths, apply_gaussian_filter, beside, cull, matcap, note_near, note_strays, up_note,
    with_shadows,
};
use crate::camera::{self, Turntable};
use crate::sky::SkyAndGround;
use std::path::Path;
use surfel_framing::{ChosenView, NamedView, Samples, ViewChoice};
use surfel_io::ShowPath as _;
use surfel_load::scene::assemble;
use surfel_load::{Error, LoadedObjects};
use surfel_model::{Scene, Up};
use surfel_sample::Progress;
use surfel_stage::{
    AutoOptions, DEFAULT_SIZE, auto_composite, auto_depth_tolerance, auto_points_as, auto_transparency, auto_up, stage,
};

impl Request {
    /// Builds the scene from loaded objects for a request without a scene file: chooses up axis, view, camera, lights
    /// and settings. Passes notes for the user to `note`.
    pub(super) fn scene_of_geometry(
        mut self,
        loaded: LoadedObjects,
        progress: &dyn Progress,
        note: &mut dyn FnMut(String),
    ) -> Result<Resolved, Error> {
        let (mut settings, given_camera, mut objects) = (self.settings, self.camera.take(), self.objects.clone());
        let options = &self.options;
        let paths: Vec<&Path> = objects.iter().filter_map(|object| object.splats.as_deref()).collect();
        if let Some((over, about)) = auto_composite(&loaded, &paths, settings) {
            settings = apply_gaussian_filter(over, options);
            if options.composite.is_none() {
                note(format!("{}: {}", about.path.shown(), about.text));
            }
        }
        if options.transparency.is_none()
            && let Some((transparency, about)) = auto_transparency(&loaded, &paths)
        {
            settings.transparency = transparency;
            note(format!("{}: {}", about.path.shown(), about.text));
        }
        for about in auto_points_as(&loaded, &mut objects) {
            note(format!("{}: {}", about.path.shown(), about.text));
        }
        if options.depth_tolerance.is_none()
            && let Some(tolerance) = auto_depth_tolerance(&loaded)
        {
            settings.depth_tolerance = tolerance;
        }
        let framed = self.estimates.framed(&loaded);
        let up = options.up.flatten().unwrap_or_else(|| note_up(&framed, self.estimates.samples(&framed), note));
        let view = match options.view.unwrap_or_default() {
            ViewChoice::Auto if given_camera.is_none() && options.eye.is_none() && options.target.is_none() => {
                let ChosenView { angles, reason } = surfel_framing::view_of(self.estimates.samples(&framed), up);
                note(format!("seen from --view {angles} (azimuth and elevation; {reason})"));
                ViewChoice::From(angles)
            }
            // If options give only the eye or only the target, the other is computed from the default view.
            ViewChoice::Auto => ViewChoice::Named(NamedView::Iso),
            given => given,
        };
        let own_near = given_camera.is_none();
        let auto = AutoOptions::default()
            .with_view(view)
            .with_projection(camera::projection(options))
            .with_size(options.size.unwrap_or(DEFAULT_SIZE))
            .with_camera(given_camera)
            .with_background(options.background)
            .with_settings(settings)
            .with_turning(options.turntable)
            .with_ground(options.light(true).2.is_some());
        let mut staged = stage(&self.estimates, objects, &framed, up, &auto)?;
        let objects_only = Scene { objects: framed.objects.clone(), ..Scene::default() };
        if own_near && options.eye.is_none() && options.target.is_none() {
            note_strays(&objects_only, self.estimates.kept(&framed, &objects_only), note);
        }
        let center = self.estimates.center(&framed, &objects_only).unwrap_or_default();
        if options.eye.is_some() && options.target.is_none() && own_near {
            staged.camera.target = center.into();
        }
        camera::apply_flags(&mut staged.camera, &objects_only, up, own_near, options);
        camera::view(&staged.camera, options)?;
        // The lights follow the camera, wherever the options have placed it.
        let lighting = self.estimates.lighting(&framed, up);
        let lights = match (&options.lights, options.cameras) {
            (Some(lights), _) => Some(lights.clone()),
            // All cameras share the light along the view, so that the scene doesn't change.
            (None, true) => None,
            (None, false) => Some(lighting.lights(&staged.camera)),
        };
        let lighting = (options.lights.is_none() && !options.cameras).then_some(lighting);
        let lights = if options.shadows { lights.map(with_shadows) } else { lights };
        let mut file = staged.into_scene(up, lights, settings);
        let kept = self.estimates.kept(&framed, &objects_only);
        let found = (up.vector(), &file.camera);
        let none = SkyAndGround::default();
        SkyAndGround::of(none, file.settings.shader, options, (&objects_only, kept), found)?.put(&mut file);
        let lighting = lighting.filter(|_| file.sky.is_none());
        drop((framed, objects_only));
        cull(&mut file, options);
        let turntable = Turntable { center, axis: up.vector() };
        let frames_all = loaded.frames_all();
        let mut loaded = self.refine(loaded, (&file, &turntable), progress, note)?;
        let (beside, colorings) = (beside(&loaded)?, loaded.colorings.clone());
        loaded.draw_points(&file.objects)?;
        let mut scene = assemble(&file, loaded.objects)?;
        absolute_paths(&mut file, Path::new(""))?;
        scene.matcap = matcap(&mut file, options)?;
        note_near(&scene, &file.camera, note);
        let has_own_camera = !own_near;
        Ok(Resolved { file, scene, turntable, up, has_own_camera, beside, colorings, lighting, frames_all })
    }
}

/// Estimates the up axis from the files' statements or their shape. Passes a note to `note` that states how to override
/// it.
fn note_up(loaded: &LoadedObjects, samples: &Samples, note: &mut dyn FnMut(String)) -> Up {
    let found = auto_up(loaded, samples);
    note(up_note(found));
    found.up
}
