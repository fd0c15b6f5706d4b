//! Sequences: files that are the frames of one film.
//!
//! [`Sequence::survey`] loads a sample of the files and thins it. The sample is framed, lit and coloured as one scene
//! of several objects. The result is one scene file with a single object, whose file changes from frame to frame. Each
//! frame therefore depends only on its own file and on the choices made for all frames. The scene file of a frame
//! ([`Sequence::scene`]) is enough to draw that frame again.

use crate::render_options::{RenderOptions, SplatOptions};
use crate::request::{Pictures, Request, Resolved, SceneSource, Source, Turntable, up_note, with_shadows};
use crate::splats;
use std::collections::{BTreeSet, HashSet};
use std::path::PathBuf;
use std::sync::Arc;
use surfel_framing::{Samples, Upright};
use surfel_load::Error;
use surfel_load::LoadedObjects;
use surfel_load::coloring::ColorScale;
use surfel_load::coloring::together::Tallies;
use surfel_load::effects::UnusedOption;
use surfel_load::paths::{absolute, display, is_stdin};
use surfel_load::points_as;
use surfel_load::scene::is_scene_file;
use surfel_model::{
    Camera, Geometry, Light, Material, Object, ObjectFile, OnInvalid, PointRadius, PointsAs, Projection, SceneFile,
    SplatCloud,
};
use surfel_sample::Progress;
use surfel_stage::Lighting;
use surfel_stage::auto_up;

/// Largest number of files that are sampled to choose camera, light and colours for all frames.
const SAMPLE: usize = 12;
/// Largest number of splats of each sampled file that are kept in memory; larger files are thinned to it.
const MAX_SPLATS_PER_FILE: usize = 100_000;
/// Factor by which the near distance of the camera is multiplied, since surfaces of files outside of the sample may be
/// nearer.
const NEAR: f64 = 0.1;

/// Movement of the camera in the course of a film whose frames are files.
#[derive(Clone, Debug)]
enum Motion {
    Still,
    /// One turn about the scene's up axis.
    Turn,
    /// A separate camera for each frame.
    Path(Vec<Camera>),
}

/// Files that are the frames of one film, with the camera, light and other choices that all frames share.
#[derive(Clone, Debug)]
pub struct Sequence {
    inputs: Vec<PathBuf>,
    options: RenderOptions,
    /// Scene that all frames share, with a single object. For each frame, the object's file, the camera and the lights
    /// are replaced.
    scene: SceneFile,
    motion: Motion,
    turntable: Turntable,
    /// Properties from which lights that follow a camera on a path are derived; `None` if the options state lights.
    lighting: Option<Lighting>,
}

impl Sequence {
    /// Chooses camera, lights, materials, colours and settings from a sample of the files. Passes notes for the user to
    /// `note`, as sentences without a full stop.
    ///
    /// # Errors
    /// [`Error::Usage`] without files, for scene files and stdin, and for a turntable or camera path whose number of
    /// frames differs from the number of files. Otherwise, errors of [`Request::load`] and [`Request::resolve`].
    pub fn survey(
        inputs: &[PathBuf],
        options: &RenderOptions,
        motion: &Pictures,
        progress: &dyn Progress,
        note: &mut dyn FnMut(String),
    ) -> Result<Self, Error> {
        check(inputs, motion)?;
        let mut options = RenderOptions { turntable: matches!(motion, Pictures::Turn(_)), ..options.clone() };
        options.splats.shared_range = false;
        let bar = options.splats.colorbar.take();
        let sample: Vec<PathBuf> = picked(inputs.len()).map(|index| inputs[index].clone()).collect();
        let survey = Survey::of(&sample, &options, progress)?;
        if let Some(upright) = most_frequent(&survey.uprights).filter(|_| options.up.flatten().is_none()) {
            // The union of all files has another shape than each of them.
            options.up = Some(Some(upright.up));
            note(up_note(upright));
        }
        survey.share_colors(&mut options, progress).into_iter().for_each(&mut *note);
        let Survey { loaded, spacings, weights, .. } = survey;
        let request = Request::new(Source::Geometry(sample.clone()), motion, &options)?;
        let mut told = UniqueNotes::new(&sample);
        let resolved = request.resolve(loaded, progress, &mut |text| told.once(text, note))?;
        options.splats.colorbar = bar;
        splats::write_color_bar(&options.splats, resolved.colorings.iter(), note)?;
        let count = inputs.len();
        if sample.len() < count {
            let of = sample.len();
            note(format!("camera, light and colours of all {count} frames are chosen from {of} of them"));
        }
        let Resolved { mut file, turntable, lighting, has_own_camera, .. } = resolved;
        file.objects = vec![object(&file.objects, &options, spacings)?];
        share_weight(&mut file.objects, weights, sample.len());
        if !has_own_camera {
            make_room(&mut file.camera);
        }
        let motion = match motion {
            Pictures::Turn(_) => Motion::Turn,
            Pictures::Path(cameras) => Motion::Path(cameras.clone()),
            _ => Motion::Still,
        };
        let inputs = inputs.iter().map(|path| absolute(path)).collect::<Result<_, _>>()?;
        Ok(Self { inputs, options: of_frame(&options), scene: file, motion, turntable, lighting })
    }

    /// Returns the number of frames.
    pub fn len(&self) -> usize {
        self.inputs.len()
    }

    /// True if there are no frames. A sequence from [`Sequence::survey`] always has one.
    pub fn is_empty(&self) -> bool {
        self.inputs.is_empty()
    }

    /// Returns the scene file of a frame.
    pub fn scene(&self, index: usize) -> SceneFile {
        let mut file = self.scene.clone();
        let path = self.inputs.get(index).cloned().unwrap_or_default();
        file.objects.iter_mut().for_each(|object| object.splats = Some(path.clone()));
        let lights = file.lights.clone().unwrap_or_default();
        match &self.motion {
            Motion::Still => {}
            Motion::Turn if index == 0 => {}
            Motion::Turn => {
                let turn = index as f64 / self.inputs.len() as f64;
                let (camera, lights) = self.turntable.at(turn, &file.camera, &lights);
                (file.camera, file.lights) = (camera, Some(lights));
            }
            Motion::Path(cameras) => {
                file.camera = cameras.get(index).unwrap_or(&file.camera).clone();
                if let Some(lighting) = self.lighting {
                    let has_shadows = lights.iter().any(Light::casts_shadow);
                    let lights = lighting.lights(&file.camera);
                    file.lights = Some(if has_shadows { with_shadows(lights) } else { lights });
                }
            }
        }
        file
    }

    /// Loads the scene of a frame.
    ///
    /// # Errors
    /// Errors of [`Request::load`] and [`Request::resolve`].
    pub fn load(&self, index: usize, progress: &dyn Progress, note: &mut dyn FnMut(String)) -> Result<Resolved, Error> {
        let file = self.scene(index);
        let name = self.inputs.get(index).cloned().unwrap_or_default();
        let pictures = Pictures::Cameras(vec![file.camera.clone()]);
        // The settings are complete, so that no preset changes them.
        let keys = BTreeSet::from(["shader".to_owned()]);
        let source = SceneSource { file, keys, name, base: PathBuf::new() };
        let request = Request::new(Source::Scene(Box::new(source)), &pictures, &self.options)?;
        let loaded = request.load(progress)?;
        request.resolve(loaded, progress, note)
    }
}

/// Checks that there are inputs, and that none is a scene file or stdin. A turntable or camera path must have as many
/// frames as there are inputs.
fn check(inputs: &[PathBuf], motion: &Pictures) -> Result<(), Error> {
    let usage = |text: String| Err(Error::Usage(text));
    if inputs.is_empty() {
        return usage("a sequence has no file, expected at least one".to_owned());
    }
    if let Some(path) = inputs.iter().find(|path| is_stdin(path) || is_scene_file(path)) {
        let expected = "expected files of points, splats or meshes, one for each frame";
        return usage(format!("{}: is no frame of a sequence, {expected}", display(path)));
    }
    let frames = match motion {
        Pictures::Turn(frames) => *frames as usize,
        Pictures::Path(cameras) => cameras.len(),
        _ => inputs.len(),
    };
    if frames != inputs.len() {
        return usage(format!("a sequence of {} files has {} frames, found {frames}", inputs.len(), inputs.len()));
    }
    Ok(())
}

/// Returns the indices of the sampled files: evenly distributed, with the first and the last frame.
fn picked(count: usize) -> impl Iterator<Item = usize> {
    let picked = count.min(SAMPLE);
    (0..picked).map(move |i| i * (count - 1) / (picked - 1).max(1))
}

/// Objects of the sampled files, thinned, with estimates for each file, from which the choices for all frames are made.
struct Survey {
    loaded: LoadedObjects,
    /// Typical spacing of the points of each point file, in world units.
    spacings: Vec<f64>,
    /// Interior weight (rendering model §5) of each point file that has one.
    weights: Vec<f64>,
    /// Estimated up axis of each file; empty if the options state the axis.
    uprights: Vec<Upright>,
}

impl Survey {
    /// Loads the sample, one file after another, and thins it. Estimates spacing, interior weight and up axis of each
    /// file.
    fn of(sample: &[PathBuf], options: &RenderOptions, progress: &dyn Progress) -> Result<Self, Error> {
        let (mut all, mut spacings, mut uprights) = (LoadedObjects::default(), Vec::new(), Vec::new());
        let mut weights = Vec::new();
        for path in sample {
            let request = Request::new(Source::Geometry(vec![path.clone()]), &Pictures::One, options)?;
            let one = request.load(progress)?;
            if options.up.flatten().is_none() {
                let framed = one.framed();
                uprights.push(auto_up(&framed, &Samples::new(&framed.objects)));
            }
            for (object, mut facts) in one.objects.into_iter().zip(one.facts) {
                if let Geometry::Splats(cloud) = &object.geometry
                    && facts.points
                {
                    spacings.push(points_as::spacing(cloud));
                    weights.extend(cloud.data().interior_weight);
                }
                // The overview of a file that is read by levels suffices here, and must not be refined.
                facts.partial = false;
                all.objects.push(thinned(object)?);
                all.facts.push(facts);
            }
            all.color_jobs.append(one.color_jobs);
            // For similar files, the notes on the first suffice. Notes on colours hold for one file only, and are left
            // out.
            let of_colors: Vec<&str> = one.colorings.notes().map(|(_, text)| text).collect();
            for note in &one.notes {
                let is_known = all.notes.iter().any(|other| are_alike(&other.text, &note.text));
                if !is_known && !of_colors.contains(&note.text.as_str()) {
                    all.notes.push(note.clone());
                }
            }
            let is_unused = |option: &UnusedOption| one.unused.iter().any(|(_, other)| other.option == option.option);
            if path == &sample[0] {
                all.unused.clone_from(&one.unused);
            } else {
                // An option has no effect if it has none on any file.
                all.unused.retain(|(_, option)| is_unused(option));
            }
            all.colorings = one.colorings;
        }
        Ok(Self { loaded: all, spacings, weights, uprights })
    }

    /// Determines one colour scale for all frames, if they are coloured by values, and stores it in `options`, unless
    /// these state a range. Returns a note about the scale; `None` if no option colours the frames by an attribute.
    fn share_colors(&self, options: &mut RenderOptions, progress: &dyn Progress) -> Option<String> {
        let attribute = options.splats.convert.color_by.clone()?;
        progress.stage("colours", 0);
        let mut tallies = Tallies::default();
        let mut loaded = self.loaded.clone();
        // Heights need an up axis. Files that state none get the chosen one.
        if let Some(up) = options.up.flatten() {
            loaded.color_jobs.assume_up(up);
        }
        loaded.tally(&mut tallies);
        let (coloring, note) = tallies.coloring(&attribute)?;
        if coloring.scale != ColorScale::Direct && options.splats.convert.range.is_none() {
            options.splats.set_coloring(coloring);
        }
        Some(note)
    }
}

/// True if two texts differ only in digits and decimal points.
fn are_alike(a: &str, b: &str) -> bool {
    let words = |text: &str| text.chars().filter(|c| !c.is_ascii_digit() && *c != '.').collect::<String>();
    words(a) == words(b)
}

/// Returns an object with at most [`MAX_SPLATS_PER_FILE`] splats, evenly selected. Other kinds of geometry are returned
/// unchanged.
fn thinned(object: Object) -> Result<Object, Error> {
    let Geometry::Splats(cloud) = &object.geometry else { return Ok(object) };
    let step = cloud.len().div_ceil(MAX_SPLATS_PER_FILE);
    if step < 2 {
        return Ok(object);
    }
    let mut data = Arc::unwrap_or_clone(cloud.clone()).into_data();
    data.retain(&(0..data.centers.len()).map(|i| i % step == 0).collect::<Vec<_>>());
    let (cloud, _) = SplatCloud::new(data, OnInvalid::Refuse)?;
    Ok(Object { geometry: cloud.into(), ..object })
}

/// Returns the object that all frames share, apart from its file. Its material and its kind of splat are those of most
/// files. Points drawn as balls or disks get one radius for all frames.
fn object(objects: &[ObjectFile], options: &RenderOptions, mut spacings: Vec<f64>) -> Result<ObjectFile, Error> {
    let materials: Vec<Material> = objects.iter().map(|object| object.material).collect();
    let kinds: Vec<Option<PointsAs>> = objects.iter().map(|object| object.convert.points_as).collect();
    let Some(first) = objects.first() else { return Err(Error::Usage("a sequence has no file".to_owned())) };
    let mut object = ObjectFile { material: most_frequent(&materials).unwrap_or(first.material), ..first.clone() };
    splats::apply(&options.splats, &mut object.convert)?;
    spacings.sort_unstable_by(f64::total_cmp);
    let radius =
        spacings.get(spacings.len() / 2).map(|spacing| PointRadius::World(points_as::RADIUS_OF_SPACING * spacing));
    // The kind of splat is fixed for all frames, so that it isn't chosen for each file.
    object.convert.points_as = Some(match most_frequent(&kinds).flatten().unwrap_or(PointsAs::Surface) {
        PointsAs::Balls(None) => PointsAs::Balls(radius),
        PointsAs::Disks(None) => PointsAs::Disks(radius),
        other => other,
    });
    Ok(object)
}

/// Sets the interior weight of the object that all frames share to the median of `weights`, if the points of every
/// sampled file have one and the object's material has none. Frames then needn't estimate their own weights, which
/// would take a sixth of the time for making their splats.
fn share_weight(objects: &mut [ObjectFile], mut weights: Vec<f64>, files: usize) {
    if weights.len() != files {
        return;
    }
    weights.sort_unstable_by(f64::total_cmp);
    let median = weights.get(weights.len() / 2);
    for object in objects {
        object.material.interior_weight = object.material.interior_weight.or(median.copied());
    }
}

/// Returns the most frequent value; among equally frequent ones, the first. `None` if there are no values.
fn most_frequent<T: PartialEq + Clone>(values: &[T]) -> Option<T> {
    let count = |value: &&T| values.iter().filter(|other| other == value).count();
    values.iter().rev().max_by_key(count).cloned()
}

/// Moves the near plane of the camera that was framed on the sample closer, and an orthographic camera's far plane
/// away. Files outside of the sample may extend farther.
fn make_room(camera: &mut Camera) {
    camera.near *= NEAR;
    if matches!(camera.projection, Projection::Orthographic { .. }) {
        camera.far = camera.far.map(|far| 2.0 * far);
    }
}

/// Returns the options for loading a frame: only those that the frame's scene file doesn't contain, such as region and
/// planes.
fn of_frame(options: &RenderOptions) -> RenderOptions {
    let splats = SplatOptions { memory: options.splats.memory, ..SplatOptions::default() };
    RenderOptions {
        splats,
        region: options.region,
        samples: options.samples,
        planes: options.planes.clone(),
        label: options.label.clone(),
        all_levels: options.all_levels,
        ..RenderOptions::default()
    }
}

/// Filter for notes about frames. It passes on each text once, ignoring the name of the file at its beginning.
struct UniqueNotes {
    names: Vec<String>,
    known: HashSet<String>,
}

impl UniqueNotes {
    fn new(sample: &[PathBuf]) -> Self {
        let names = sample.iter().map(|path| format!("{}: ", display(path))).collect();
        Self { names, known: HashSet::new() }
    }

    fn once(&mut self, text: String, note: &mut dyn FnMut(String)) {
        let bare = self.names.iter().find_map(|name| text.strip_prefix(name.as_str())).unwrap_or(&text).to_owned();
        if self.known.insert(bare) {
            note(text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_have_both_ends() {
        let of = |count: usize| picked(count).collect::<Vec<_>>();
        assert_eq!((of(1), of(3)), (vec![0], vec![0, 1, 2]));
        let many = of(300);
        assert_eq!((many.len(), many[0], many[SAMPLE - 1]), (SAMPLE, 0, 299));
        assert!(many.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn most_files_decide() {
        assert_eq!(most_frequent(&[1, 2, 3, 2]), Some(2));
        assert_eq!(most_frequent(&[3, 1, 1, 3]), Some(3));
        assert_eq!(most_frequent::<u8>(&[]), None);
    }

    #[test]
    fn notes_are_told_once() {
        let mut told = UniqueNotes::new(&["a.ply".into(), "b.ply".into()]);
        let mut notes = Vec::new();
        for text in ["a.ply: no normals", "b.ply: no normals", "up is +z", "b.ply: other"] {
            told.once(text.to_owned(), &mut |note| notes.push(note));
        }
        assert_eq!(notes, ["a.ply: no normals", "up is +z", "b.ply: other"]);
        assert!(are_alike("9 points of 10.5", "12 points of 0.25") && !are_alike("9 points", "9 splats"));
    }

    #[test]
    fn frames_of_a_sequence_are_files() {
        let refused = |names: &[&str], motion: &Pictures| {
            check(&names.iter().map(PathBuf::from).collect::<Vec<_>>(), motion).is_err()
        };
        assert!(refused(&[], &Pictures::One) && refused(&["-"], &Pictures::One));
        assert!(refused(&["a.ply", "b.json"], &Pictures::One) && refused(&["a.ply"], &Pictures::Turn(2)));
        assert!(!refused(&["a.ply", "b.ply"], &Pictures::Turn(2)));
    }
}
