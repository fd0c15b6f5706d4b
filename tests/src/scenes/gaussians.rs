//! Scenes of trained Gaussians.

use super::Case;
use crate::build::camera;
use crate::random::Random;
use glam::{DAffine3, DQuat, DVec3};
use surfel_model::{
    Column3, GaussianCloud, GaussianData, GaussianKind, Geometry, Object, OnInvalid, Projection, Scene,
};

/// Background colour that no Gaussian has.
const BACKGROUND: [f64; 4] = [0.02, 0.3, 0.6, 0.5];

pub(super) fn gaussian_cases() -> Vec<Case> {
    let flat = gaussian_field(GaussianKind::Flat);
    let mut orthographic = Case { name: "gaussians orthographic".into(), ..flat.clone() };
    orthographic.camera.projection = Projection::Orthographic { height: 3.0 };
    orthographic.camera.far = Some(4.4);
    vec![flat, gaussian_field(GaussianKind::Solid), orthographic, gaussian_extremes(), two_gaussian_objects()]
}

/// Returns `count` random Gaussians in a box, with spherical harmonics of degree 3.
pub fn random_gaussians(count: usize, kind: GaussianKind, seed: u64) -> GaussianData {
    let mut random = Random::new(seed);
    let mut data = no_gaussians(kind);
    data.degree = 3;
    let mut centers = Vec::new();
    for _ in 0..count {
        centers.push(DVec3::from([(); 3].map(|()| random.range(-1.0, 1.0))));
        data.sigmas.push([(); 3].map(|()| random.factor(0.01, 0.3) as f32));
        let axis = random.direction();
        data.rotations.push(DQuat::from_axis_angle(axis, random.range(0.0, 6.0)).as_quat().to_array());
        data.opacities.push(random.range(0.0, 1.0) as f32);
        for k in 0..16 {
            let most = if k == 0 { 1.5 } else { 0.3 };
            data.harmonics.push([(); 3].map(|()| random.range(-most, most) as f32));
        }
    }
    data.centers = Column3::from_f64(&centers);
    data
}

/// Returns columns without entries, with spherical harmonics of degree 0.
pub fn no_gaussians(kind: GaussianKind) -> GaussianData {
    GaussianData {
        origin: DVec3::ZERO,
        centers: Column3::default(),
        kind,
        sigmas: Vec::new(),
        rotations: Vec::new(),
        opacities: Vec::new(),
        degree: 0,
        harmonics: Vec::new(),
        linear_colors: false,
        up: None,
    }
}

/// Creates an object of Gaussians.
///
/// # Panics
/// If a Gaussian is invalid: scenes are written in code, not read.
pub fn gaussian_object(data: GaussianData) -> Object {
    GaussianCloud::new(data, OnInvalid::Refuse).expect("scenes hold valid Gaussians").0.into()
}

/// Creates a scene that has only Gaussians.
///
/// # Panics
/// If a Gaussian is invalid, like [`gaussian_object`].
pub fn gaussian_scene(data: GaussianData) -> Scene {
    Scene { background: BACKGROUND, ..Scene::from(gaussian_object(data)) }
}

/// Returns two hundred Gaussians of all sizes, some of them nearer than the near plane.
pub fn gaussian_field(kind: GaussianKind) -> Case {
    let name = if kind == GaussianKind::Flat { "flat gaussians" } else { "solid gaussians" };
    // The size of the image isn't a multiple of the tile size.
    let mut case = Case::new(name, gaussian_scene(random_gaussians(200, kind, 7)), camera(3.2, 45.0, [61, 43]));
    case.camera.eye = [0.3, 0.4, 3.2];
    case
}

/// Returns extreme Gaussians: needles, points, sheets that extend past the eye, edge-on ones, all kinds of opacities,
/// and many in one place.
pub fn gaussian_extremes() -> Case {
    let mut data = no_gaussians(GaussianKind::Flat);
    let mut centers = Vec::new();
    let mut random = Random::new(3);
    let mut add = |p: [f64; 3], sigmas: [f32; 2], rotation: DQuat, opacity: f32| {
        centers.push(DVec3::from(p));
        data.sigmas.push([sigmas[0], sigmas[1], 0.0]);
        data.rotations.push(rotation.as_quat().to_array());
        data.opacities.push(opacity);
        data.harmonics.push([(); 3].map(|()| random.range(-1.7, 1.7) as f32));
    };
    let half = std::f64::consts::FRAC_PI_2;
    for i in 0..10 {
        let x = 0.2 * f64::from(i) - 0.9;
        let tilt = DQuat::from_rotation_z(0.3 * f64::from(i)) * DQuat::from_rotation_y(half * f64::from(i) / 12.0);
        add([x, 0.6, 0.0], [0.3 * 10f32.powi(-i / 2 - 1), 0.3], tilt, 0.9);
        add([x, 0.3, 0.1], [1e-30, 1e-30], tilt, 1.0);
        add([x, 0.0, 0.2], [0.0, 0.1], tilt, 0.7);
        // Some are edge-on, or nearly so.
        let from_edge = [1.0, 0.1, 1e-2, 1e-3, 1e-4, 1e-6, 0.0, 0.3, 0.03, 3e-3][i as usize];
        add(
            [x, if from_edge == 0.0 { 0.0 } else { -0.3 }, -0.2],
            [0.05, 0.05],
            DQuat::from_rotation_x(half - from_edge),
            1.0,
        );
        add([x, -0.6, -0.1], [0.08, 0.05], tilt, [0.0, 1.0, 0.5, 0.0039, 0.00393][i as usize % 5]);
        // These Gaussians all have the same position, so that their index decides the order.
        add([0.0, -0.8, 0.4], [0.1, 0.2], DQuat::IDENTITY, 0.3);
    }
    // A floor under the eye, a floor without visible end, and a Gaussian that is too near.
    add([0.0, -1.0, 0.0], [3.0, 3.0], DQuat::from_rotation_x(half), 0.6);
    add([0.0, -0.4, 0.5], [1e4, 1e4], DQuat::from_rotation_x(half + 0.1), 0.3);
    add([0.0, 0.0, 1.85], [1.0, 1.0], DQuat::IDENTITY, 1.0);
    // Sheets that intersect each other in front of the eye and at the near plane.
    add([0.2, 0.1, 1.6], [0.3, 0.5], DQuat::from_rotation_y(1.2), 0.2);
    add([0.2, 0.1, 1.7], [0.4, 0.2], DQuat::from_rotation_y(-1.3) * DQuat::from_rotation_x(0.4), 0.2);
    data.centers = Column3::from_f64(&centers);
    Case::new("extreme gaussians", gaussian_scene(data), camera(2.0, 60.0, [48, 48]))
}

/// Returns two clouds that intersect; one of them is mirrored and scaled unevenly.
pub fn two_gaussian_objects() -> Case {
    let mut scene = gaussian_scene(random_gaussians(60, GaussianKind::Flat, 21));
    let mut other = gaussian_object(random_gaussians(60, GaussianKind::Solid, 22));
    other.world_from_object = DAffine3::from_scale_rotation_translation(
        DVec3::new(-0.5, 1.5, 0.8),
        DQuat::from_rotation_y(0.7),
        DVec3::new(0.1, 0.0, -0.2),
    );
    scene.objects.push(other);
    Case::new("two objects of gaussians", scene, camera(3.0, 50.0, [40, 50]))
}

/// Returns the Gaussians of a case's first object; `None` if the object has another geometry.
pub fn gaussians_of(case: &Case) -> Option<&GaussianCloud> {
    match &case.scene.objects.first()?.geometry {
        Geometry::Gaussians(cloud) => Some(cloud),
        _ => None,
    }
}
