//! Benchmark scenes: a ladder of sizes after Guennebaud, extremes of splat size, and real models if their files exist.

use std::path::Path;
use std::sync::Arc;

use glam::DAffine3;
use surfel_model::{Camera, Material, Scene, Settings, SplatCloud};
use surfel_model::{ClipPolicy, Cull, EdgeAa, Geometry, Object, Projection, Shader};
use surfel_render::Planes;
use surfel_sample::NoProgress;

use crate::{Arguments, Failure, clouds};

/// Width and height of every image, in pixels.
const SIZE: u32 = 1024;

/// Vertical field of view, in degrees.
const FOV_Y_DEG: f64 = 30.0;

/// Source of a scene's geometry. Scenes with the same source share one upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    /// Bumpy ball with this number of splats.
    Ball(usize),
    /// Spheres at this number of points of the bumpy ball.
    Balls(usize),
    /// Wavy sheet with this number of splats.
    Sheet(usize),
    /// Wavy sheet with this number of splats. Twelve splats cover each point on average.
    Thick(usize),
    /// Twelve wavy sheets one behind another, with this number of splats each.
    Stack(usize),
    /// Model from a file in the models' folder.
    Model(&'static str),
    /// Mesh from a file in the models' folder, as one clipped splat per face.
    Sharp(&'static str),
    /// Machine part that `cargo xtask assets` generates, as clipped splats.
    Part,
}

/// Position of the camera's eye.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Eye {
    /// Position from which the surface fills the height of the view.
    Fits,
    /// The same position as `Fits`, with the height of the view multiplied by this factor. A factor below 1 gives a
    /// close-up.
    Zoomed(f64),
}

/// Scene that can be timed.
#[derive(Clone, Debug)]
pub(crate) struct Case {
    pub name: &'static str,
    pub about: &'static str,
    pub source: Source,
    eye: Eye,
    pub shader: Shader,
    /// Edge antialiasing with which the scene is drawn.
    edges: EdgeAa,
    /// Evaluation of the splats' clips.
    clip: ClipPolicy,
    /// Planes to draw.
    pub planes: Planes,
    /// True if the scene belongs to `--quick`.
    quick: bool,
}

/// Loaded source, ready to be uploaded.
pub(crate) struct Loaded {
    pub scene: Scene,
    /// Camera that frames the scene.
    pub camera: Camera,
    /// Settings of the scene, before those of a [`Case`].
    pub settings: Settings,
}

/// Description of the scenes that differ only in their number of splats.
const LADDER: &str = "closed surface, fills the height, back faces culled (Guennebaud 2006, table 1)";

/// Factor by which the view of the scene `far` is higher than the surface. The surface then covers about 5 % of the
/// image.
const FAR: f64 = 3.7;

/// Returns all benchmark scenes.
fn all() -> Vec<Case> {
    use Eye::{Fits, Zoomed};
    use Source::{Ball, Balls, Model, Part, Sharp, Sheet, Stack, Thick};
    let case = |name, about, source, eye, quick| {
        let (shader, edges, clip, planes) = (Shader::Phong, EdgeAa::Off, ClipPolicy::Exact, Planes::COLOR);
        Case { name, about, source, eye, shader, edges, clip, planes, quick }
    };
    let (igea, lion) = (Model("igea.ply"), Model("lion_takanawa.ply"));
    let shader = |name, shader| Case { shader, ..case(name, "igea by another shader", igea, Fits, true) };
    let edges = |name, source| Case {
        edges: EdgeAa::Coverage,
        ..case(name, "the same with edges antialiased by coverage", source, Fits, false)
    };
    let samples = |name, source| Case {
        edges: EdgeAa::Samples,
        ..case(name, "the same with edges antialiased by samples", source, Fits, false)
    };
    let clipped = |name, source| case(name, "a mesh as splats clipped along its creases", source, Fits, false);
    let whole = |name, source| Case {
        clip: ClipPolicy::Off,
        about: "the same, unclipped",
        ..case(name, "", source, Fits, false)
    };
    vec![
        case("154k", LADDER, Ball(154_000), Fits, true),
        case("460k", LADDER, Ball(460_000), Fits, true),
        case("1.4M", LADDER, Ball(1_400_000), Fits, false),
        case("2.5M", LADDER, Ball(2_500_000), Fits, false),
        case("5M", LADDER, Ball(5_000_000), Fits, false),
        case("igea", "a scanned head of 134 k points", igea, Fits, true),
        shader("igea-normal", Shader::Normal),
        shader("igea-unlit", Shader::Unlit),
        shader("igea-matcap", Shader::Matcap),
        shader("igea-toon", Shader::Toon),
        shader("igea-edl", Shader::Edl),
        Case { planes: Planes::RGBA8, ..case("igea-rgba8", "igea in 8 bits, as a PNG holds it", igea, Fits, true) },
        edges("igea-edges", igea),
        samples("igea-samples", igea),
        case("lion", "a coloured scan of 273 k points", lion, Fits, false),
        edges("lion-edges", lion),
        samples("lion-samples", lion),
        case("20k", LADDER, Ball(20_000), Fits, false),
        edges("20k-edges", Ball(20_000)),
        samples("20k-samples", Ball(20_000)),
        case("200k", LADDER, Ball(200_000), Fits, false),
        edges("200k-edges", Ball(200_000)),
        samples("200k-samples", Ball(200_000)),
        edges("2.5M-edges", Ball(2_500_000)),
        samples("2.5M-samples", Ball(2_500_000)),
        case("1M", LADDER, Ball(1_000_000), Fits, false),
        samples("1M-samples", Ball(1_000_000)),
        case("1M-balls", "the same points as balls, whose edges are always smooth", Balls(1_000_000), Fits, false),
        case("sheet", "a wavy sheet, all splats seen, about ten fragments each", Sheet(400_000), Fits, true),
        case(
            "overlap-2",
            "the sheet, twelve splats over each point, about ten fragments each",
            Thick(1_260_000),
            Fits,
            false,
        ),
        case("overlap-8", "the same, splats of 8 pixels", Thick(62_500), Fits, false),
        case("overlap-16", "the same, splats of 16 pixels", Thick(15_600), Fits, false),
        case("stack", "twelve sheets, one behind another", Stack(400_000), Fits, false),
        case("radius-8", "the ladder's surface of splats of 8 pixels", Ball(63_000), Fits, true),
        case("radius-32", "the ladder's surface of splats of 32 pixels", Ball(3_900), Fits, true),
        case("near", "close-up of the 154k surface: few huge splats", Ball(154_000), Zoomed(1.0 / 16.0), true),
        clipped("part", Part),
        whole("part-whole", Part),
        clipped("fandisk", Sharp("fandisk.obj")),
        whole("fandisk-whole", Sharp("fandisk.obj")),
        case("far", "5 M splats below a pixel on about 5 % of the image", Ball(5_000_000), Zoomed(FAR), false),
    ]
}

/// Number of splats of the generated scene that replaces the model igea in the kit.
const IGEA_SPLATS: usize = 134_345;

/// Names of the benchmark scenes that the kit draws, too.
const KIT: [&str; 8] = ["154k", "near", "460k", "1.4M", "2.5M", "5M", "far", "sheet"];

/// Returns the scenes of a GPU kit, the most important first. None needs a file. Their numbers of splats are divided by
/// `fewer`.
pub(crate) fn kit(fewer: usize) -> Vec<Case> {
    let igea_like = |name, about, shader, edges, planes| Case {
        name,
        about,
        source: Source::Ball(IGEA_SPLATS),
        eye: Eye::Fits,
        shader,
        edges,
        clip: ClipPolicy::Exact,
        planes,
        quick: true,
    };
    let (off, color) = (EdgeAa::Off, Planes::COLOR);
    let another = "igea-like by another shader";
    let mut cases = vec![
        igea_like("igea-like", "a bumpy ball of as many splats as igea has", Shader::Phong, off, color),
        igea_like("igea-like-edges", "edges antialiased by coverage", Shader::Phong, EdgeAa::Coverage, color),
        igea_like("igea-like-normal", another, Shader::Normal, off, color),
        igea_like("igea-like-unlit", another, Shader::Unlit, off, color),
        igea_like("igea-like-toon", another, Shader::Toon, off, color),
        igea_like("igea-like-edl", another, Shader::Edl, off, color),
        igea_like("igea-like-samples", "edges antialiased by samples", Shader::Phong, EdgeAa::Samples, color),
        igea_like("igea-like-rgba8", "in 8 bits, as a PNG holds it", Shader::Phong, off, Planes::RGBA8),
    ];
    let all = all();
    cases.extend(KIT.iter().filter_map(|name| all.iter().find(|case| case.name == *name).cloned()));
    cases.iter_mut().for_each(|case| case.source = case.source.shrunk(fewer));
    cases
}

/// Returns the requested scenes whose files exist.
pub(crate) fn chosen(arguments: &Arguments) -> Result<Vec<Case>, Failure> {
    let names = all().iter().map(|case| case.name).collect::<Vec<_>>().join(", ");
    let wanted = |case: &Case| match arguments.scene.as_slice() {
        [] => case.quick || !arguments.quick,
        words => words.iter().any(|word| match word.strip_prefix('=') {
            Some(name) => case.name == name,
            None => case.name.contains(word.as_str()),
        }),
    };
    let there = |case: &Case| match case.source {
        Source::Model(file) | Source::Sharp(file) => arguments.models.join(file).is_file(),
        _ => true,
    };
    let (cases, missing): (Vec<Case>, Vec<Case>) = all().into_iter().filter(wanted).partition(there);
    for case in missing {
        eprintln!("left out: {} (no model in {})", case.name, arguments.models.display());
    }
    if cases.is_empty() {
        return Err(format!("no scene is called {}, expected a part of: {names}", arguments.scene.join(" or ")).into());
    }
    Ok(cases)
}

impl Source {
    /// Returns the source with its number of splats divided by `fewer`. Sources without such a parameter don't change.
    fn shrunk(self, fewer: usize) -> Self {
        match self {
            Self::Ball(count) => Self::Ball(count / fewer),
            Self::Balls(count) => Self::Balls(count / fewer),
            Self::Sheet(count) => Self::Sheet(count / fewer),
            Self::Thick(count) => Self::Thick(count / fewer),
            Self::Stack(count) => Self::Stack(count / fewer),
            Self::Model(_) | Self::Sharp(_) | Self::Part => self,
        }
    }

    /// Generates the source, or reads its file from the folder `models`.
    pub(crate) fn load(self, models: &Path) -> Result<Loaded, Failure> {
        match self {
            Self::Ball(count) => Ok(framed(clouds::ball(count)?, Cull::Back)),
            Self::Balls(count) => Ok(framed(clouds::balls(count)?, Cull::None)),
            Self::Sheet(count) => Ok(framed(clouds::sheet(count, clouds::LAYERS)?, Cull::None)),
            Self::Thick(count) => Ok(framed(clouds::sheet(count, 12.0)?, Cull::None)),
            Self::Stack(count) => Ok(framed(clouds::stack(count)?, Cull::None)),
            Self::Sharp(file) => sharp(&models.join(file)),
            Self::Part => sharp(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/generated/part.obj")),
            Self::Model(file) => {
                let path = models.join(file);
                let opened = surfel_stage::open(&[&path], &NoProgress)?;
                let camera = Camera { size: [SIZE; 2], ..opened.file.camera };
                Ok(Loaded { scene: opened.scene, camera, settings: opened.file.settings })
            }
        }
    }
}

/// Loads a mesh as clipped splats. The camera is that of the program's default view of the mesh.
fn sharp(path: &Path) -> Result<Loaded, Failure> {
    let loaded = surfel_io::load(path, &surfel_io::LoadOptions::default())?;
    let surfel_io::Content::Mesh(mesh) = loaded.content else {
        return Err(format!("{}: holds no mesh", path.display()).into());
    };
    let options = surfel_sample::SharpOptions::default();
    let (cloud, _) = surfel_sample::sharp_splats_from_mesh(&mesh, &options, &NoProgress)?;
    let opened = surfel_stage::open(&[path], &NoProgress)?;
    let camera = Camera { size: [SIZE; 2], ..opened.file.camera };
    Ok(Loaded { camera, ..framed(cloud, Cull::Back) })
}

/// Returns a scene of a cloud with the default lights. The camera is on the z axis, as near as possible while the
/// centres of all splats are visible.
fn framed(cloud: SplatCloud, cull: Cull) -> Loaded {
    let slope = (0.5 * FOV_Y_DEG).to_radians().tan();
    // A centre is visible if |x| and |y| are at most (eye − z)·slope.
    let needs = |i: usize| {
        let p = cloud.center(i);
        p.z + p.x.abs().max(p.y.abs()) / slope
    };
    let eye_z = (0..cloud.len()).map(needs).fold(0.0, f64::max);
    let camera = Camera {
        eye: [0.0, 0.0, eye_z],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg: FOV_Y_DEG },
        near: 0.01,
        far: None,
        size: [SIZE; 2],
    };
    // Antialiased edges need the interior weight.
    let interior_weight = surfel_sample::interior_weight(&cloud);
    let object = Object {
        geometry: Geometry::Splats(Arc::new(cloud)),
        world_from_object: DAffine3::IDENTITY,
        material: Material { cull, interior_weight, ..Material::default() },
    };
    let lights = Some(surfel_stage::studio_lights(&camera));
    let scene = Scene { ambient: [0.1; 3], lights, objects: vec![object], ..Scene::default() };
    Loaded { scene, camera, settings: Settings::default() }
}

impl Case {
    /// Returns the camera of the loaded source, with the zoom of this scene.
    pub(crate) fn camera(&self, loaded: &Loaded) -> Camera {
        let mut camera = loaded.camera.clone();
        if let (Eye::Zoomed(factor), Projection::Perspective { fov_y_deg }) = (self.eye, &mut camera.projection) {
            let half = (0.5 * *fov_y_deg).to_radians().tan() * factor;
            *fov_y_deg = 2.0 * half.atan().to_degrees();
        }
        camera
    }

    /// Returns the settings of the loaded source with this scene's shader, edge antialiasing and clipping.
    pub(crate) fn settings(&self, loaded: &Loaded) -> Settings {
        loaded.settings.with_shader(self.shader).with_edge_aa(self.edges).with_clip(self.clip)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kit_draws_scenes_without_files_that_all_have_names_of_their_own() {
        let cases = kit(10);
        assert_eq!(cases.len(), 8 + KIT.len());
        assert!(cases.iter().all(|case| matches!(case.source, Source::Ball(_) | Source::Sheet(_))));
        assert_eq!(cases[0].source, Source::Ball(IGEA_SPLATS / 10));
        let names: std::collections::BTreeSet<&str> = cases.iter().map(|case| case.name).collect();
        assert_eq!(names.len(), cases.len());
    }
}
