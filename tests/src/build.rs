//! Building blocks of scenes: single splats, surfaces, cameras.

use crate::random::Random;
use glam::{DAffine3, DVec3};
use std::sync::Arc;
use surfel_math::basis::{orthonormal, unit};
use surfel_model::{
    Camera, ClipColumns, ClipCurve, ClipLine, ClipMode, CloudData, Column3, Geometry, Material, NO_LINE, Object,
    OnInvalid, Projection, Scene, Shape, SplatCloud,
};

/// Elliptical splat: the points p + u·s + v·t with u² + v² ≤ 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Centre.
    pub p: DVec3,
    /// First half-axis.
    pub s: DVec3,
    /// Second half-axis.
    pub t: DVec3,
    /// Linear albedo.
    pub color: [f32; 3],
}

impl Splat {
    /// Creates a disk with outward normal `n`.
    pub fn disk(p: DVec3, n: DVec3, radius: f64, color: [f32; 3]) -> Self {
        let (s, t) = orthonormal(n);
        Self { p, s: s * radius, t: t * radius, color }
    }

    /// Returns the splat transformed by an affine map.
    pub fn transformed(&self, by: &DAffine3) -> Self {
        Self {
            p: by.transform_point3(self.p),
            s: by.transform_vector3(self.s),
            t: by.transform_vector3(self.t),
            ..*self
        }
    }
}

/// Creates a cloud of ellipses.
///
/// # Panics
/// If a splat is invalid: scenes are written in code, not read.
pub fn cloud(splats: &[Splat]) -> SplatCloud {
    let column = |f: fn(&Splat) -> DVec3| Column3::from_f64(&splats.iter().map(f).collect::<Vec<_>>());
    let centers: Vec<DVec3> = splats.iter().map(|s| s.p).collect();
    let (origin, centers) = Column3::with_origin(&centers);
    let shape = Shape::Ellipses { s: column(|s| s.s), t: column(|s| s.t) };
    let mut data = CloudData::new(origin, centers, shape);
    data.colors = Some(splats.iter().map(|s| s.color).collect());
    SplatCloud::new(data, OnInvalid::Refuse).expect("scenes hold valid splats").0
}

/// Splat with its clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Clipped {
    /// The splat without its clip.
    pub splat: Splat,
    /// Clip curve; `None` for no curve.
    pub curve: Option<ClipCurve>,
    /// Clip lines. Only the first four count.
    pub lines: Vec<ClipLine>,
    /// Rule that joins the clip lines: a point must be inside all of them, or inside at least one.
    pub mode: ClipMode,
}

/// Creates a cloud of clipped ellipses.
///
/// # Panics
/// If a splat is invalid, like [`cloud`].
pub fn clipped_cloud(splats: &[Clipped]) -> SplatCloud {
    let none = ClipCurve { theta1: 0.0, theta3: 0.0, u: 0.0, v: 0.0, w: f32::NAN };
    let mut data = cloud(&splats.iter().map(|c| c.splat).collect::<Vec<_>>()).into_data();
    let lines = |c: &Clipped| std::array::from_fn(|k| c.lines.get(k).copied().unwrap_or(NO_LINE));
    data.clips = Some(ClipColumns {
        curves: Some(splats.iter().map(|c| c.curve.unwrap_or(none)).collect()),
        lines: Some(splats.iter().map(lines).collect()),
        modes: Some(splats.iter().map(|c| c.mode).collect()),
    });
    SplatCloud::new(data, OnInvalid::Refuse).expect("scenes hold valid splats").0
}

/// Creates a cloud of disks of one colour, given by centres, normals and radii.
///
/// # Panics
/// If a disk is invalid, like [`cloud`].
pub fn disk_cloud(disks: &[(DVec3, DVec3, f64)], color: [f32; 3]) -> SplatCloud {
    let centers: Vec<DVec3> = disks.iter().map(|d| d.0).collect();
    let normals: Vec<DVec3> = disks.iter().map(|d| d.1).collect();
    let radii = disks.iter().map(|d| d.2 as f32).collect();
    let shape = Shape::Disks { normals: Column3::from_f64(&normals), radii };
    let mut data = CloudData::new(DVec3::ZERO, Column3::from_f64(&centers), shape);
    data.colors = Some(vec![color; disks.len()]);
    SplatCloud::new(data, OnInvalid::Refuse).expect("scenes hold valid splats").0
}

/// Returns the cloud with the alpha `alpha(i)` for splat `i`.
///
/// # Panics
/// If an alpha is outside [0, 1].
pub fn with_alpha(cloud: SplatCloud, alpha: impl Fn(usize) -> f32) -> SplatCloud {
    let mut data = cloud.data().clone();
    data.alphas = Some((0..cloud.len()).map(alpha).collect());
    SplatCloud::new(data, OnInvalid::Refuse).expect("scenes hold valid splats").0
}

/// Creates an object of a cloud with the default material. Its matrix is the identity, so that world and object space
/// are the same.
pub fn object(cloud: SplatCloud) -> Object {
    Object {
        geometry: Geometry::Splats(Arc::new(cloud)),
        world_from_object: DAffine3::IDENTITY,
        material: Material::default(),
    }
}

/// Creates a scene of one cloud before a dark, half-transparent background, which differs from the colours of all
/// splats.
pub fn scene(splats: &[Splat]) -> Scene {
    Scene { background: [0.02, 0.03, 0.05, 0.5], ..Scene::from(cloud(splats)) }
}

/// Returns a camera at (0, 0, `distance`) that looks at the origin, with +y up.
pub fn camera(distance: f64, fov_y_deg: f64, size: [u32; 2]) -> Camera {
    Camera {
        eye: [0.0, 0.0, distance],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        projection: Projection::Perspective { fov_y_deg },
        near: 0.01,
        far: None,
        size,
    }
}

/// Returns `count` disks on the unit sphere, evenly distributed (Fibonacci), in random colours. Their radius is
/// `overlap` times the spacing; `seed` determines the colours.
pub fn sphere(count: usize, overlap: f64, seed: u64) -> Vec<Splat> {
    let mut random = Random::new(seed);
    let radius = overlap * (4.0 * std::f64::consts::PI / count as f64).sqrt();
    let golden = std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let (r, angle) = ((1.0 - z * z).sqrt(), golden * i as f64);
            let n = DVec3::new(r * angle.cos(), r * angle.sin(), z);
            Splat::disk(n, n, radius, random.color())
        })
        .collect()
}

/// Returns `columns`×`rows` disks of radius `radius` on the parallelogram with the centre `center` and the half-sides
/// `across` and `along`. The outward normal is across × along; `color(column, row)` returns the colour of a disk.
pub fn sheet(
    center: DVec3,
    [across, along]: [DVec3; 2],
    [columns, rows]: [usize; 2],
    radius: f64,
    mut color: impl FnMut(usize, usize) -> [f32; 3],
) -> Vec<Splat> {
    let normal = across.cross(along);
    let at = |i: usize, n: usize| (2.0 * i as f64 + 1.0) / n as f64 - 1.0;
    let mut splats = Vec::with_capacity(columns * rows);
    for row in 0..rows {
        for column in 0..columns {
            let p = center + across * at(column, columns) + along * at(row, rows);
            splats.push(Splat::disk(p, normal, radius, color(column, row)));
        }
    }
    splats
}

/// Returns `count` splats in the unit ball with random positions, axes and colours. Their half-axes have lengths from
/// `radius` to `radius`·`aspect`.
pub fn confetti(count: usize, radius: f64, aspect: f64, seed: u64) -> Vec<Splat> {
    let mut random = Random::new(seed);
    (0..count)
        .map(|_| {
            let p = random.direction() * random.range(0.0, 1.0).cbrt();
            let (s, t) = orthonormal(random.direction());
            let (sin, cos) = random.range(0.0, std::f64::consts::TAU).sin_cos();
            let long = radius * aspect.powf(random.range(0.0, 1.0));
            Splat { p, s: (s * cos + t * sin) * long, t: (t * cos - s * sin) * radius, color: random.color() }
        })
        .collect()
}

/// Returns the directions of a camera's image in world space: right, down, forward.
pub fn axes(camera: &Camera) -> [DVec3; 3] {
    let forward = unit(DVec3::from(camera.target) - DVec3::from(camera.eye));
    let right = unit(forward.cross(DVec3::from(camera.up)));
    [right, forward.cross(right), forward]
}

/// Returns the world direction through the centre of a pixel, with planar depth 1. It is computed only from the fields
/// of the camera.
///
/// # Panics
/// If the camera isn't [`Projection::Perspective`].
pub fn ray(camera: &Camera, x: u32, y: u32) -> DVec3 {
    let Projection::Perspective { fov_y_deg } = camera.projection else { panic!("the camera has no field of view") };
    let [right, down, forward] = axes(camera);
    let [w, h] = camera.size.map(f64::from);
    let f = h / (2.0 * (0.5 * fov_y_deg.to_radians()).tan());
    forward + right * ((f64::from(x) + 0.5 - 0.5 * w) / f) + down * ((f64::from(y) + 0.5 - 0.5 * h) / f)
}
