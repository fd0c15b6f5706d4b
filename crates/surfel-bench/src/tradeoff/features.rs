//! Scenes with one feature each, compared with the plain scene. The cost must depend only on the content. A scene
//! without a feature must have the plan of the plain scene whatever its settings, and so must a scene whose settings
//! disable its feature.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, Vec3};
use surfel_model::{
    ClipColumns, ClipCurve, ClipLine, ClipMode, ClipPolicy, CloudData, Column3, EdgeAa, Filter, GaussianCloud,
    GaussianData, GaussianKind, Geometry, Matcap, Mesh, ModelError, NO_LINE, Object, OnInvalid, Shader, Shape, Sort,
    Transparency,
};
use surfel_model::{Light, Material, Scene, Settings, SplatCloud};
use surfel_render::{Planes, View};
use surfel_sample::NoProgress;
use surfel_sample::{OctreeOptions, octree_from_mesh};

use crate::{Failure, clouds};

/// Number of disks of the plain scene.
pub(crate) const SPLATS: usize = 40_000;

/// Variation of the plain scene by one feature.
pub(crate) struct Case {
    pub name: &'static str,
    pub scene: Scene,
    pub settings: Settings,
    pub planes: Planes,
    /// True if splats are stored in 16 bits.
    pub quantised: bool,
    /// True if the feature has no effect: the settings disable it, or the settings request a feature that the scene
    /// doesn't have. The plan must then equal the plan of the plain scene.
    pub absent: bool,
    /// True if the scene has other splats than the plain scene, so that times can't be compared.
    pub other_scene: bool,
}

impl Case {
    pub(super) fn new(name: &'static str, scene: Scene, settings: Settings) -> Self {
        let planes = Planes::COLOR;
        Self { name, scene, settings, planes, quantised: false, absent: false, other_scene: false }
    }

    fn absent(self) -> Self {
        Self { absent: true, ..self }
    }
}

/// Returns all cases, the plain one first.
pub(crate) fn cases(view: &View) -> Result<Vec<Case>, Failure> {
    let with = |change: fn(&mut CloudData)| cloud(change).map(scene);
    let plain = || with(|_| ());
    let set = |change: fn(&mut Settings)| {
        let mut settings = Settings::default();
        change(&mut settings);
        settings
    };
    let unlit = Settings::default();
    let phong = set(|s| s.shader = Shader::Phong);
    let peel = set(|s| s.transparency = Transparency::Peel { layers: 4, drop_last: false });
    let abuffer = set(|s| s.transparency = Transparency::ABuffer { layers: 8 });
    let by_pixel = set(|s| s.sort = Sort::Pixel);
    let principal = set(|s| s.gaussian_filter = Filter::Principal);
    let whole = set(|s| s.clip = ClipPolicy::Off);
    // 4 px of an image of 256: with this level of detail, the octree has both splats and polygons.
    let octree_px = f64::from(view.size[0]) / 64.0;
    Ok(vec![
        Case::new("nothing: white disks, unlit", plain()?, unlit),
        Case::new("colours", with(colors)?, unlit),
        Case::new("ellipses", with(ellipses)?, unlit),
        Case::new("front and back of an oriented cloud", with(|data| data.oriented = true)?, unlit),
        Case { quantised: true, ..Case::new("16-bit storage", plain()?, unlit) },
        Case { planes: Planes::RGBA8, ..Case::new("colours in 8 bits in place of floats", plain()?, unlit) },
        Case { planes: Planes::ALL, ..Case::new("depth, normal and weight planes", plain()?, unlit) },
        Case { planes: Planes::COLOR.with_index(true), ..Case::new("index and object planes", with(rows)?, unlit) },
        Case { planes: Planes::COLOR.with_label(true), ..Case::new("label plane", with(rows)?, unlit) },
        Case { planes: Planes::COLOR.with_position(true), ..Case::new("position plane", plain()?, unlit) },
        Case::new("light (phong)", plain()?, phong),
        Case::new("light, objects of different material", materials(plain()?), phong),
        Case::new("light that casts a shadow", sunny(plain()?), phong),
        Case::new("toon", plain()?, set(|s| s.shader = Shader::Toon)),
        Case::new("matcap", clay(plain()?), set(|s| s.shader = Shader::Matcap)),
        Case::new("eye-dome lighting (edl)", plain()?, set(|s| s.shader = Shader::Edl)),
        Case::new("edges by coverage", plain()?, set(|s| s.edge_aa = EdgeAa::Coverage)),
        Case::new("edges by samples", plain()?, set(|s| s.edge_aa = EdgeAa::Samples)),
        Case::new("clip lines, one a splat", with(clip_lines)?, unlit),
        Case::new("clip curves, one a splat", with(clip_curves)?, unlit),
        Case::new("transparent splats, peel:4", with(alphas)?, peel),
        Case::new("transparent splats, abuffer:8", with(alphas)?, abuffer),
        Case::new("a polygon mesh", with_quad(plain()?)?, unlit),
        Case { other_scene: true, ..Case::new("balls in place of the disks", with(balls)?, unlit) },
        Case {
            other_scene: true,
            ..Case::new("an octree, of splats and polygons", octree()?, unlit.with_lod_error_px(octree_px))
        },
        Case { other_scene: true, ..Case::new("trained Gaussians, one over another", gaussians()?, unlit) },
        Case { other_scene: true, ..Case::new("the same in the order of each pixel", gaussians()?, by_pixel) },
        Case { other_scene: true, ..Case::new("the same, filter principal", gaussians()?, principal) },
        Case {
            other_scene: true,
            planes: Planes::COLOR.with_alpha(true).with_median_depth(true).with_distortion(true),
            ..Case::new("the same, planes alpha, median depth, distortion", gaussians()?, unlit)
        },
        Case::new("peel:4, nothing transparent", plain()?, peel).absent(),
        Case::new("abuffer:8, nothing transparent", plain()?, abuffer).absent(),
        Case::new("rows and labels, planes not asked for", with(rows)?, unlit).absent(),
        Case::new("order of each pixel, no Gaussians", plain()?, by_pixel).absent(),
        Case::new("filter of Gaussians, none there", plain()?, principal).absent(),
        Case::new("alphas, transparency off", with(alphas)?, unlit).absent(),
        Case::new("clip lines, clip off", with(clip_lines)?, whole).absent(),
        Case::new("a shadow, materials and a matcap, unlit", clay(materials(sunny(plain()?))), unlit).absent(),
    ])
}

/// Returns the splats of the plain scene after `change`.
fn cloud(change: impl FnOnce(&mut CloudData)) -> Result<SplatCloud, Failure> {
    let mut data = clouds::ball(SPLATS)?.into_data();
    data.colors = None;
    data.interior_weight = Some(3.0);
    change(&mut data);
    Ok(SplatCloud::new(data, OnInvalid::Refuse)?.0)
}

/// Returns a scene of flat Gaussians at the centres of the plain scene's splats. Their opacity is 0.5, and their
/// standard deviations are half of the splats' radii.
pub(super) fn gaussians() -> Result<Scene, Failure> {
    let ball = clouds::ball(SPLATS)?;
    let count = ball.len();
    let sigma = |i: usize| 0.5 * ball.radius_max(i) as f32;
    let turn = |i: usize| DQuat::from_rotation_arc(DVec3::Z, ball.normal(i).normalize()).as_quat().to_array();
    let data = GaussianData {
        origin: ball.data().origin,
        centers: ball.data().centers.clone(),
        kind: GaussianKind::Flat,
        sigmas: (0..count).map(|i| [sigma(i), sigma(i), 0.0]).collect(),
        rotations: (0..count).map(turn).collect(),
        opacities: vec![0.5; count],
        degree: 0,
        harmonics: vec![[0.4, 0.2, 0.0]; count],
        linear_colors: false,
        up: None,
    };
    Ok(Scene::from(GaussianCloud::new(data, OnInvalid::Refuse)?.0))
}

fn object(geometry: Geometry) -> Object {
    Object { geometry, world_from_object: DAffine3::IDENTITY, material: Material::default() }
}

fn scene(cloud: SplatCloud) -> Scene {
    Scene { objects: vec![object(Geometry::Splats(Arc::new(cloud)))], ..Scene::default() }
}

fn colors(data: &mut CloudData) {
    data.colors = Some(vec![[0.5, 0.6, 0.7]; data.centers.len()]);
}

/// Adds numbers of input rows and class labels to the splats.
pub(super) fn rows(data: &mut CloudData) {
    let n = data.centers.len() as u32;
    data.rows = Some((0..n).collect());
    data.labels = Some((0..n).map(|i| i % 7).collect());
}

/// Replaces the disks by balls of the same radii.
fn balls(data: &mut CloudData) {
    if let Shape::Disks { radii, .. } = &data.shape {
        data.shape = Shape::Balls { radii: radii.clone(), in_pixels: false, flat: false };
    }
}

fn alphas(data: &mut CloudData) {
    data.alphas = Some(vec![0.5; data.centers.len()]);
}

/// Replaces the splats by ellipses, which can be clipped.
fn ellipses(data: &mut CloudData) {
    if let Shape::Disks { normals, radii } = &data.shape {
        let axes = |i: usize| {
            let (s, t) = surfel_math::basis::orthonormal(normals.get(i));
            (s * f64::from(radii[i]), t * f64::from(radii[i]))
        };
        let (s, t): (Vec<DVec3>, Vec<DVec3>) = (0..radii.len()).map(axes).unzip();
        let column = |v: &[DVec3]| Column3::from_f32(v.iter().map(|v| v.as_vec3()).collect());
        data.shape = Shape::Ellipses { s: column(&s), t: column(&t) };
    }
}

fn clip_lines(data: &mut CloudData) {
    ellipses(data);
    let n = data.centers.len();
    let line = ClipLine { a: 1.0, b: 0.3, c: 0.6 };
    data.clips = Some(ClipColumns {
        curves: None,
        lines: Some(vec![[line, NO_LINE, NO_LINE, NO_LINE]; n]),
        modes: Some(vec![ClipMode::And; n]),
    });
}

fn clip_curves(data: &mut CloudData) {
    ellipses(data);
    let curve = ClipCurve { theta1: 0.3, theta3: 2.6, u: 0.1, v: 0.7, w: 1.2 };
    data.clips = Some(ClipColumns { curves: Some(vec![curve; data.centers.len()]), lines: None, modes: None });
}

fn sunny(scene: Scene) -> Scene {
    let sun = Light::Directional { direction: [-1.0, -1.0, -1.0], color: [1.0; 3], shadow: true };
    Scene { lights: Some(vec![sun]), ..scene }
}

fn clay(scene: Scene) -> Scene {
    Scene { matcap: Some(Matcap::builtin()), ..scene }
}

/// Adds an object with another material, which is outside of the view.
fn materials(mut scene: Scene) -> Scene {
    let away = DAffine3::from_translation(DVec3::X * 50.0);
    let other = scene.objects.first().map(|first| Object {
        material: Material { specular: 0.8, ..first.material },
        world_from_object: away,
        geometry: first.geometry.clone(),
    });
    scene.objects.extend(other);
    scene
}

/// Adds a quad of polygons that intersects the splats.
fn with_quad(mut scene: Scene) -> Result<Scene, ModelError> {
    let corners = [[-2.0, -0.4, -2.0], [2.0, -0.4, -2.0], [2.0, -0.4, 2.0], [-2.0, -0.4, 2.0]].map(Vec3::from);
    let mesh = Mesh {
        positions: Column3::from_f32(corners.to_vec()),
        triangles: vec![[0, 2, 1], [0, 3, 2]],
        ..Mesh::default()
    };
    mesh.validate()?;
    scene.objects.push(object(Geometry::Mesh(Arc::new(mesh))));
    Ok(scene)
}

/// Returns the surface of the plain scene as an octree.
fn octree() -> Result<Scene, Failure> {
    let mut mesh = clouds::bumpy_mesh(64);
    mesh.colors = None;
    let octree = octree_from_mesh(&mesh, &OctreeOptions::default(), &NoProgress)?;
    Ok(Scene { objects: vec![object(octree.into())], ..Scene::default() })
}
