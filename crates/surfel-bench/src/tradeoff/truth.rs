//! What images approximate: closed forms, sampled.

use glam::DVec3;
use surfel::{Camera, View};

/// Samples a pixel and side of closed forms.
const SAMPLES: u32 = 8;

/// What an image should be.
pub(crate) struct Truth {
    /// Linear, premultiplied.
    pub color: Vec<[f32; 4]>,
    /// Planar depth; +∞ where nothing is.
    pub depth: Vec<f32>,
    /// World normals; zero where nothing is.
    pub normal: Vec<[f32; 3]>,
    /// Pixels that count.
    pub mask: Vec<bool>,
}

impl Truth {
    /// Pixels that count and are wholly covered, as their eight neighbours are: inside of the silhouette.
    pub(crate) fn inside(&self, [width, height]: [u32; 2]) -> Vec<bool> {
        let covered = |x: i64, y: i64| {
            let there = x >= 0 && y >= 0 && x < i64::from(width) && y < i64::from(height);
            // Eight by eight f32 samples of 1 make 1 but for rounding.
            there && self.color[(y * i64::from(width) + x) as usize][3] > 0.9999
        };
        let inside = |i: usize| {
            let (x, y) = (i64::from(i as u32 % width), i64::from(i as u32 / width));
            self.mask[i] && (-1..=1).all(|dy| (-1..=1).all(|dx| covered(x + dx, y + dy)))
        };
        (0..self.mask.len()).map(inside).collect()
    }
}

/// Where a ray meets a surface.
#[derive(Clone, Copy)]
pub(crate) struct Met {
    pub albedo: [f64; 3],
    pub point: DVec3,
    pub normal: DVec3,
}

/// A surface that rays can be cast at: eye and direction.
pub(crate) type Surface = dyn Fn(DVec3, DVec3) -> Option<Met> + Sync;

/// The surface box-filtered over pixels, before transparent black. Where `whole`, pixels that it doesn't fill don't
/// count.
pub(crate) fn cast(camera: &Camera, surface: &Surface, whole: bool) -> Result<Truth, crate::Failure> {
    let view = View::new(camera)?;
    let [width, height] = camera.size;
    let n = (width * height) as usize;
    let mut truth = Truth {
        color: vec![[0.0; 4]; n],
        depth: vec![f32::INFINITY; n],
        normal: vec![[0.0; 3]; n],
        mask: vec![true; n],
    };
    let world_from_view = view.view_from_world.transpose();
    let cast_at = |x: f64, y: f64| {
        let (_, d) = view.projection.ray(surfel::math::V2::new(x, y));
        surface(view.eye, world_from_view * DVec3::new(d.x, d.y, d.z))
    };
    for i in 0..n {
        let (x, y) = (f64::from(i as u32 % width), f64::from(i as u32 / width));
        let (mut color, mut depth, mut normal, mut count) = ([0.0; 4], 0.0, DVec3::ZERO, 0u32);
        for k in 0..SAMPLES * SAMPLES {
            let offset = |k: u32| (f64::from(k) + 0.5) / f64::from(SAMPLES);
            let Some(met) = cast_at(x + offset(k % SAMPLES), y + offset(k / SAMPLES)) else { continue };
            count += 1;
            depth += (met.point - view.eye).dot(view.forward());
            normal += met.normal;
            for (sum, albedo) in color.iter_mut().zip(met.albedo.into_iter().chain([1.0])) {
                *sum += albedo;
            }
        }
        truth.color[i] = color.map(|c| (c / f64::from(SAMPLES * SAMPLES)) as f32);
        if count > 0 {
            truth.depth[i] = (depth / f64::from(count)) as f32;
            truth.normal[i] = normal.normalize_or_zero().as_vec3().to_array();
        }
        truth.mask[i] = !whole || count == SAMPLES * SAMPLES;
    }
    Ok(truth)
}

/// The plane through `center` that `across` and `away` (orthogonal, of the plane's half size) span, where a and b are
/// within ±1; `pattern` gives its albedo there.
pub(crate) fn plane(
    center: DVec3,
    [across, away]: [DVec3; 2],
    pattern: impl Fn(f64, f64) -> [f64; 3] + Sync,
) -> impl Fn(DVec3, DVec3) -> Option<Met> + Sync {
    let normal = across.cross(away).normalize();
    move |eye, ray| {
        let t = normal.dot(center - eye) / normal.dot(ray);
        let point = eye + ray * t;
        let q = point - center;
        let (a, b) = (q.dot(across) / across.length_squared(), q.dot(away) / away.length_squared());
        let hit = t > 0.0 && a.abs() <= 1.0 && b.abs() <= 1.0;
        let facing = if normal.dot(ray) > 0.0 { -normal } else { normal };
        hit.then(|| Met { albedo: pattern(a, b), point, normal: facing })
    }
}

/// The unit sphere about the origin, its albedo by `pattern` of the normal.
pub(crate) fn sphere(pattern: impl Fn(DVec3) -> [f64; 3] + Sync) -> impl Fn(DVec3, DVec3) -> Option<Met> + Sync {
    move |eye, ray| {
        let d = ray.normalize();
        let b = eye.dot(d);
        let discriminant = b * b - (eye.length_squared() - 1.0);
        let t = -b - discriminant.max(0.0).sqrt();
        let point = eye + d * t;
        (discriminant >= 0.0 && t > 0.0).then(|| Met { albedo: pattern(point), point, normal: point })
    }
}
