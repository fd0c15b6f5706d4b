//! Subjects of the trade-off measurements: scenes that are sensitive to settings, each with its ideal image.

use std::f64::consts::{PI, TAU};
use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};
use surfel_model::{Camera, Light, Material, Scene, Settings, SplatCloud};
use surfel_model::{
    CloudData, Column3, Cull, Geometry, Matcap, Mesh, ModelError, Object, OnInvalid, Projection, Shader, Shape,
    Transparency,
};
use surfel_sample::NoProgress;

use super::truth::{self, Truth};
use crate::{Failure, clouds};

/// Scene with its view, and with the ideal image that its image approximates.
pub(crate) struct Subject {
    pub name: &'static str,
    /// Description of the features to which the scene is sensitive.
    pub about: &'static str,
    pub scene: Scene,
    pub camera: Camera,
    pub settings: Settings,
    /// Ideal image, against which model errors are measured.
    pub truth: IdealImage,
    /// True if splats have clips, so that variants for clips are measured.
    pub clips: bool,
    /// True if splats are transparent, so that variants for transparency are measured.
    pub transparent: bool,
    /// True if the subject is generated; false if it is read from a file.
    pub is_generated: bool,
}

/// Ideal image that a subject's image approximates.
pub(crate) enum IdealImage {
    /// Surface in closed form, box-filtered over pixels.
    Surface(Truth),
    /// Supersampled image of the subject's splats without a filter. The number is that of samples along a pixel's side.
    Samples(u32),
    /// Image that the reference draws with these settings.
    Drawn(Settings),
}

impl IdealImage {
    /// Returns a description of the ideal image.
    pub(crate) fn words(&self) -> String {
        match self {
            Self::Surface(_) => "the surface in closed form, 8×8 samples a pixel".into(),
            Self::Samples(n) => format!("the exact, unfiltered kernels, {n}×{n} samples a pixel"),
            Self::Drawn(_) => "all layers (A-buffer), on the reference".into(),
        }
    }
}

/// Subjects to measure, and subjects that are skipped.
pub(crate) struct Subjects {
    pub wanted: Vec<Subject>,
    /// Names of skipped subjects, with the reasons.
    pub left_out: Vec<(&'static str, String)>,
}

/// Returns the subjects to measure and the skipped ones. Skipped are models whose files are missing and, with `quick`,
/// the lion. Images are `size` pixels wide and high.
pub(crate) fn all(size: u32, quick: bool, models: &Path) -> Result<Subjects, Failure> {
    let samples = if quick { 4 } else { 8 };
    let mut subjects = vec![
        horizon(size)?,
        zone_plate(size)?,
        ball(size)?,
        needles(size, samples)?,
        bumpy(size, samples, quick)?,
        cylinder(size, samples)?,
        glass(size)?,
    ];
    let mut left_out = Vec::new();
    let scans = [
        ("igea", "igea.ply", "a scanned head of 134 k points"),
        ("lion", "lion_takanawa.ply", "a coloured scan of 273 k points"),
    ];
    for (name, file, about) in scans {
        let path = models.join(file);
        if quick && name == "lion" {
            left_out.push((name, "--quick: its truth alone takes half a minute".to_owned()));
        } else if path.is_file() {
            subjects.push(model(name, about, &path, size, samples)?);
        } else {
            left_out.push((name, missing(&path)));
        }
    }
    let fandisk = models.join("fandisk.obj");
    if fandisk.is_file() {
        subjects.push(sharp_model(&fandisk, size, samples)?);
    } else {
        left_out.push(("fandisk", missing(&fandisk)));
    }
    Ok(Subjects { wanted: subjects, left_out })
}

fn missing(path: &Path) -> String {
    format!("there is no {} (--models says where models are)", path.display())
}

pub(super) fn camera(eye: [f64; 3], target: [f64; 3], fov_y_deg: f64, size: u32) -> Camera {
    Camera {
        eye,
        target,
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg },
        near: 0.01,
        far: None,
        size: [size; 2],
    }
}

fn object(cloud: SplatCloud) -> Object {
    Object {
        geometry: Geometry::Splats(Arc::new(cloud)),
        world_from_object: DAffine3::IDENTITY,
        material: Material::default(),
    }
}

fn scene(mut cloud: SplatCloud) -> Scene {
    if let Some(weight) = surfel_sample::interior_weight(&cloud) {
        cloud.set_interior_weight(weight);
    }
    Scene { objects: vec![object(cloud)], matcap: Some(Matcap::builtin()), ..Scene::default() }
}

/// Disk to be created: centre, normal, radius and linear colour.
type Disk = (DVec3, DVec3, f64, [f64; 3]);

fn disks(all: &[Disk]) -> Result<SplatCloud, ModelError> {
    let vectors = |f: fn(&Disk) -> Vec3| all.iter().map(f).collect::<Vec<Vec3>>();
    let normals = Column3::from_f32(vectors(|d| d.1.as_vec3()));
    let shape = Shape::Disks { normals, radii: all.iter().map(|d| d.2 as f32).collect() };
    let colors = all.iter().map(|d| d.3.map(|c| c as f32)).collect();
    let data = CloudData::new(DVec3::ZERO, Column3::from_f32(vectors(|d| d.0.as_vec3())), shape);
    Ok(SplatCloud::new(CloudData { colors: Some(colors), ..data }, OnInvalid::Refuse)?.0)
}

/// Returns `n`×`n` disks on a plane (see [`truth::plane`]). The colour of each disk is the albedo of the pattern at its
/// centre.
fn sheet(
    center: DVec3,
    [across, away]: [DVec3; 2],
    n: usize,
    pattern: impl Fn(f64, f64) -> [f64; 3],
) -> Result<SplatCloud, ModelError> {
    let normal = across.cross(away).normalize();
    let radius = 2.0 * across.length() / n as f64;
    let at = |i: usize| (2.0 * i as f64 + 1.0) / n as f64 - 1.0;
    let disk = |i: usize| {
        let (a, b) = (at(i % n), at(i / n));
        (center + across * a + away * b, normal, radius, pattern(a, b))
    };
    disks(&(0..n * n).map(disk).collect::<Vec<_>>())
}

/// Returns a checkerboard that extends to the horizon. It is the scene of docs/decisions/017-principal-filter.md, with
/// squares and disks twice as large.
fn horizon(size: u32) -> Result<Subject, Failure> {
    let (sin, cos) = 80f64.to_radians().sin_cos();
    let (center, axes) = (DVec3::new(0.0, 0.0, -1.2), [DVec3::X, DVec3::new(0.0, cos, -sin)]);
    let pattern = |a: f64, b: f64| {
        let index = |v: f64| ((v + 1.0) * 0.5 * 20.0).floor() as i64;
        [if (index(a) + index(b)).rem_euclid(2) == 0 { 1.0 } else { 0.0 }; 3]
    };
    let camera = camera([0.0; 3], [0.0, 0.0, -1.0], 60.0, size);
    let truth = truth::cast(&camera, &truth::plane(center, axes, pattern), true)?;
    Ok(Subject {
        name: "horizon",
        about: "a checkerboard seen at 10 degrees: large splats in front, splats below a pixel far away",
        scene: scene(sheet(center, axes, 200, pattern)?),
        camera,
        settings: Settings::default(),
        truth: IdealImage::Surface(truth),
        clips: false,
        transparent: false,
        is_generated: true,
    })
}

/// Returns a zone plate: rings that become finer outward, until they are finer than pixels.
fn zone_plate(size: u32) -> Result<Subject, Failure> {
    let (center, axes) = (DVec3::ZERO, [DVec3::X, DVec3::new(0.0, 0.9, 0.4358)]);
    // At the corners of an image of 256² pixels, the pattern has 0.7 cycles per pixel.
    let pattern = |a: f64, b: f64| [0.5 + 0.45 * (45.0 * PI * (a * a + b * b)).cos(); 3];
    let camera = camera([0.0, 0.0, 2.6], [0.0; 3], 45.0, size);
    let truth = truth::cast(&camera, &truth::plane(center, axes, pattern), true)?;
    Ok(Subject {
        name: "zone plate",
        about: "rings from wide to finer than pixels, splats of 0.8 px: blur and aliasing",
        scene: scene(sheet(center, axes, 300, pattern)?),
        camera,
        settings: Settings::default(),
        truth: IdealImage::Surface(truth),
        clips: false,
        transparent: false,
        is_generated: true,
    })
}

/// Returns a banded sphere, which has splats of every tilt and a silhouette.
pub(super) fn ball(size: u32) -> Result<Subject, Failure> {
    let pattern = |n: DVec3| [0.5 + 0.4 * (9.0 * n.x).sin(), 0.5 + 0.4 * (11.0 * n.y + 4.0 * n.z).sin(), 0.6];
    let count = 12_000;
    let golden = PI * (3.0 - 5f64.sqrt());
    let radius = 1.1 * (4.0 * PI / f64::from(count)).sqrt();
    let disk = |i: i32| {
        let y = 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(count);
        let (sine, cosine) = (golden * f64::from(i) % TAU).sin_cos();
        let across = (1.0 - y * y).sqrt();
        let n = DVec3::new(across * cosine, y, across * sine);
        (n, n, radius, pattern(n))
    };
    let camera = camera([0.0, 0.4, 3.4], [0.0; 3], 40.0, size);
    let truth = truth::cast(&camera, &truth::sphere(pattern), false)?;
    let mut scene = scene(disks(&(0..count).map(disk).collect::<Vec<_>>())?);
    scene.objects[0].material.cull = Cull::Back;
    Ok(Subject {
        name: "ball",
        about: "a coloured sphere before nothing, splats of 3 px: every tilt, and a rim that pixels cover in part",
        scene,
        camera,
        settings: Settings::default(),
        truth: IdealImage::Surface(truth),
        clips: false,
        transparent: false,
        is_generated: true,
    })
}

/// Returns a ball of ellipses with aspect ratio 100.
fn needles(size: u32, samples: u32) -> Result<Subject, Failure> {
    let mut numbers = clouds::Random(1);
    let mut random = move || numbers.next();
    let mut direction = move || {
        let z = 2.0 * random() - 1.0;
        let (sine, cosine) = (TAU * random()).sin_cos();
        let across = (1.0 - z * z).sqrt();
        (DVec3::new(across * cosine, across * sine, z), random())
    };
    let (mut centers, mut s, mut t, mut colors) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for _ in 0..3000 {
        let ((place, share), (along, _), (other, hue)) = (direction(), direction(), direction());
        let across = along.cross(other).normalize();
        centers.push((place * share.cbrt()).as_vec3());
        s.push((along * 0.12).as_vec3());
        t.push((across * 0.0012).as_vec3());
        colors.push([0.2 + 0.8 * hue as f32, 0.9 - 0.7 * hue as f32, 0.4]);
    }
    let shape = Shape::Ellipses { s: Column3::from_f32(s), t: Column3::from_f32(t) };
    let data = CloudData::new(DVec3::ZERO, Column3::from_f32(centers), shape);
    let cloud = SplatCloud::new(CloudData { colors: Some(colors), ..data }, OnInvalid::Refuse)?.0;
    Ok(Subject {
        name: "needles",
        about: "3000 loose ellipses of aspect 100, a tenth of a pixel wide",
        scene: Scene {
            objects: vec![Object {
                material: Material { interior_weight: Some(2.0), ..Material::default() },
                ..object(cloud)
            }],
            ..Scene::default()
        },
        camera: camera([0.0, 0.0, 3.2], [0.0; 3], 40.0, size),
        settings: Settings::default(),
        truth: IdealImage::Samples(2 * samples),
        clips: false,
        transparent: false,
        is_generated: true,
    })
}

/// Returns the benchmark's bumpy ball with lights.
fn bumpy(size: u32, samples: u32, quick: bool) -> Result<Subject, Failure> {
    let mut scene = scene(clouds::ball(if quick { 60_000 } else { 154_000 })?);
    scene.objects[0].material.cull = Cull::Back;
    let camera = camera([0.0, 0.3, 4.6], [0.0; 3], 32.0, size);
    scene.lights = Some(surfel_stage::studio_lights(&camera));
    Ok(Subject {
        name: "bumpy",
        about: "a bumpy closed surface, lit: what a scan is to a renderer",
        scene,
        camera,
        settings: Settings::default().with_shader(Shader::Phong),
        truth: IdealImage::Samples(samples),
        clips: false,
        transparent: false,
        is_generated: true,
    })
}

/// Returns a cylinder with caps as clipped splats, which has curved creases.
fn cylinder(size: u32, samples: u32) -> Result<Subject, Failure> {
    let sides = 32u32;
    let mut positions = vec![Vec3::new(0.0, 0.8, 0.0), Vec3::new(0.0, -0.8, 0.0)];
    let mut triangles = Vec::new();
    for i in 0..sides {
        let (sine, cosine) = (TAU * f64::from(i) / f64::from(sides)).sin_cos();
        for y in [0.8, -0.8] {
            positions.push(Vec3::new(0.7 * cosine as f32, y, 0.7 * sine as f32));
        }
        let at = |k: u32| 2 + 2 * (k % sides);
        let (a, b) = (at(i), at(i + 1));
        triangles.extend([[0, b, a], [1, a + 1, b + 1], [a, b, a + 1], [b, b + 1, a + 1]]);
    }
    let mesh = Mesh { positions: Column3::from_f32(positions), triangles, ..Mesh::default() };
    let options = surfel_sample::SharpOptions::default();
    let (cloud, _) = surfel_sample::sharp_splats_from_mesh(&mesh, &options, &NoProgress)?;
    Ok(Subject {
        name: "cylinder",
        about: "a hundred large splats clipped along circular creases, by normals",
        scene: scene(cloud),
        camera: camera([1.9, 1.7, 2.6], [0.0; 3], 38.0, size),
        settings: Settings::default().with_shader(Shader::Normal),
        truth: IdealImage::Samples(samples),
        clips: true,
        transparent: false,
        is_generated: true,
    })
}

/// Returns 27 glass spheres (G06 figure 6).
fn glass(size: u32) -> Result<Subject, Failure> {
    let (count, golden) = (400, PI * (3.0 - 5f64.sqrt()));
    let radius = 0.4 * 1.25 * (4.0 * PI / f64::from(count)).sqrt();
    let mut all = Vec::new();
    for i in 0..27 {
        let place = DVec3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9)) - 1.0;
        let color = [0.3 + 0.3 * f64::from(i % 3), 0.9 - 0.3 * f64::from(i / 3 % 3), 0.2 + 0.35 * f64::from(i / 9)];
        for k in 0..count {
            let y = 1.0 - 2.0 * (f64::from(k) + 0.5) / f64::from(count);
            let (sine, cosine) = (golden * f64::from(k) % TAU).sin_cos();
            let across = (1.0 - y * y).sqrt();
            let n = DVec3::new(across * cosine, y, across * sine);
            all.push((place + n * 0.4, n, radius, color));
        }
    }
    let mut data = disks(&all)?.into_data();
    data.alphas = Some(vec![0.4; all.len()]);
    let mut scene = scene(SplatCloud::new(data, OnInvalid::Refuse)?.0);
    scene.lights = Some(vec![Light::Directional { direction: [-0.6, -0.7, -0.5], color: [0.9; 3], shadow: false }]);
    scene.background = [1.0; 4];
    let settings = Settings::default()
        .with_shader(Shader::Phong)
        .with_transparency(Transparency::Peel { layers: 6, drop_last: false });
    Ok(Subject {
        name: "27 spheres",
        about: "27 transparent spheres, up to a dozen layers (G06, figure 6)",
        scene,
        camera: camera([2.0, 1.4, 4.5], [0.0; 3], 40.0, size),
        truth: IdealImage::Drawn(settings.with_transparency(Transparency::ABuffer { layers: 64 })),
        settings,
        clips: false,
        transparent: true,
        is_generated: true,
    })
}

fn model(name: &'static str, about: &'static str, path: &Path, size: u32, samples: u32) -> Result<Subject, Failure> {
    let opened = surfel_stage::open(&[path], &NoProgress)?;
    let mut scene = opened.scene;
    // The comparison excludes the background.
    scene.background = [0.0; 4];
    scene.matcap = Some(Matcap::builtin());
    for object in &mut scene.objects {
        if let Geometry::Splats(cloud) = &object.geometry {
            object.material.interior_weight =
                cloud.data().interior_weight.or_else(|| surfel_sample::interior_weight(cloud));
        }
    }
    Ok(Subject {
        name,
        about,
        scene,
        camera: Camera { size: [size; 2], ..opened.file.camera },
        settings: Settings::default().with_shader(Shader::Phong),
        truth: IdealImage::Samples(samples),
        clips: false,
        transparent: false,
        is_generated: false,
    })
}

fn sharp_model(path: &Path, size: u32, samples: u32) -> Result<Subject, Failure> {
    let loaded = surfel_io::load(path, &surfel_io::LoadOptions::default())?;
    let surfel_io::Content::Mesh(mesh) = loaded.content else {
        return Err(format!("{}: holds no mesh", path.display()).into());
    };
    let options = surfel_sample::SharpOptions { splats: Some(2500), ..surfel_sample::SharpOptions::default() };
    let (cloud, _) = surfel_sample::sharp_splats_from_mesh(&mesh, &options, &NoProgress)?;
    let opened = surfel_stage::open(&[path], &NoProgress)?;
    Ok(Subject {
        name: "fandisk",
        about: "a CAD part as 2500 clipped splats, by normals",
        scene: scene(cloud),
        camera: Camera { size: [size; 2], ..opened.file.camera },
        settings: Settings::default().with_shader(Shader::Normal),
        truth: IdealImage::Samples(samples),
        clips: true,
        transparent: false,
        is_generated: false,
    })
}
