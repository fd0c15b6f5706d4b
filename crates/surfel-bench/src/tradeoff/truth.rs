//! Ideal images ("truths") that drawn images approximate: sampled closed forms.

use glam::DVec3;
use surfel_model::Camera;
use surfel_render::View;

/// Number of samples along the side of a pixel.
const SAMPLES: u32 = 8;

/// Ideal image of a subject: planes with a value per pixel, row by row.
pub(crate) struct Truth {
    /// Colours, linear and premultiplied.
    pub color: Vec<[f32; 4]>,
    /// Planar depths; +∞ in empty pixels.
    pub depth: Vec<f32>,
    /// World normals; zero in empty pixels.
    pub normal: Vec<[f32; 3]>,
    /// Flag per pixel, true if the pixel is compared.
    pub mask: Vec<bool>,
}

impl Truth {
    /// Returns a mask of the pixels inside silhouettes: pixels of the mask that are completely covered, as are their
    /// eight neighbours.
    pub(crate) fn inside(&self, [width, height]: [u32; 2]) -> Vec<bool> {
        let covered = |x: i64, y: i64| {
            let there = x >= 0 && y >= 0 && x < i64::from(width) && y < i64::from(height);
            // The sum of 8×8 samples of 1 in f32 is 1 up to rounding.
            there && self.color[(y * i64::from(width) + x) as usize][3] > 0.9999
        };
        let inside = |i: usize| {
            let (x, y) = (i64::from(i as u32 % width), i64::from(i as u32 / width));
            self.mask[i] && (-1..=1).all(|dy| (-1..=1).all(|dx| covered(x + dx, y + dy)))
        };
        (0..self.mask.len()).map(inside).collect()
    }
}

/// Intersection of a ray with a surface.
#[derive(Clone, Copy)]
pub(crate) struct SurfaceHit {
    pub albedo: [f64; 3],
    pub point: DVec3,
    pub normal: DVec3,
}

/// Surface as a function from the origin and direction of a ray to the nearest intersection.
pub(crate) type Surface = dyn Fn(DVec3, DVec3) -> Option<SurfaceHit> + Sync;

/// Renders the ideal image of a surface: box-filtered over pixels, on transparent black. With `whole`, pixels that the
/// surface doesn't cover completely are excluded from the mask.
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
        let (_, d) = view.projection.ray(surfel_math::V2::new(x, y));
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

/// Returns a rectangle as a surface. `center` is its centre; `across` and `away` are its orthogonal half-axes.
/// `pattern` returns the albedo at coordinates a and b along them, from −1 to 1.
pub(crate) fn plane(
    center: DVec3,
    [across, away]: [DVec3; 2],
    pattern: impl Fn(f64, f64) -> [f64; 3] + Sync,
) -> impl Fn(DVec3, DVec3) -> Option<SurfaceHit> + Sync {
    let normal = across.cross(away).normalize();
    move |eye, ray| {
        let t = normal.dot(center - eye) / normal.dot(ray);
        let point = eye + ray * t;
        let q = point - center;
        let (a, b) = (q.dot(across) / across.length_squared(), q.dot(away) / away.length_squared());
        let hit = t > 0.0 && a.abs() <= 1.0 && b.abs() <= 1.0;
        let facing = if normal.dot(ray) > 0.0 { -normal } else { normal };
        hit.then(|| SurfaceHit { albedo: pattern(a, b), point, normal: facing })
    }
}

/// Returns the unit sphere about the origin as a surface. `pattern` returns the albedo for a normal.
pub(crate) fn sphere(pattern: impl Fn(DVec3) -> [f64; 3] + Sync) -> impl Fn(DVec3, DVec3) -> Option<SurfaceHit> + Sync {
    move |eye, ray| {
        let d = ray.normalize();
        let b = eye.dot(d);
        let discriminant = b * b - (eye.length_squared() - 1.0);
        let t = -b - discriminant.max(0.0).sqrt();
        let point = eye + d * t;
        (discriminant >= 0.0 && t > 0.0).then(|| SurfaceHit { albedo: pattern(point), point, normal: point })
    }
}
