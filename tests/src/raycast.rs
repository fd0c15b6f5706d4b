//! Exact images of meshes by ray casting: the truth for splats made from a mesh.

use crate::build::axes;
use glam::DVec3;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use std::time::Duration;
use surfel_model::{Camera, Mesh, Projection};
use surfel_render::Frame;

/// Vertical field of view of the cameras, in degrees.
const FOV_Y_DEG: f64 = 30.0;
/// Largest angle between two normals, in degrees, with which they count as the same.
const DIFFERENT_DEG: f64 = 20.0;

/// Mesh prepared for ray casting. Traversal uses boxes in f32, and intersections are in f64.
pub struct RayCaster {
    corners: Vec<[DVec3; 3]>,
    bvh: Bvh2,
}

/// Exact image: the unit normal of the first surface that each pixel's ray hits, turned to the eye; `None` without a
/// hit.
pub type Truth = Vec<Option<DVec3>>;

impl RayCaster {
    /// Builds the acceleration structure for the triangles of a valid mesh.
    pub fn new(mesh: &Mesh) -> Self {
        let at = |i: u32| mesh.positions.get(i as usize);
        let corners: Vec<[DVec3; 3]> = mesh.triangles.iter().map(|t| t.map(at)).collect();
        let triangle = |c: &[DVec3; 3]| Triangle { v0: c[0].as_vec3a(), v1: c[1].as_vec3a(), v2: c[2].as_vec3a() };
        let triangles: Vec<Triangle> = corners.iter().map(triangle).collect();
        let bvh = build_bvh2_from_tris(&triangles, obvhs::BvhBuildParams::medium_build(), &mut Duration::default());
        Self { corners, bvh }
    }

    fn normal(&self, origin: DVec3, direction: DVec3) -> Option<DVec3> {
        let mut best: (f64, Option<DVec3>) = (f64::INFINITY, None);
        let ray = Ray::new_inf(origin.as_vec3a(), direction.as_vec3a());
        self.bvh.ray_traverse(ray, &mut RayHit::none(), |_, i| {
            let [a, b, c] = self.corners[self.bvh.primitive_indices[i] as usize];
            // Möller and Trumbore 1997.
            let (e, f, p) = (b - a, c - a, direction.cross(c - a));
            let det = e.dot(p);
            let s = origin - a;
            let (u, q) = (s.dot(p) / det, s.cross(e));
            let (v, t) = (direction.dot(q) / det, f.dot(q) / det);
            if !(u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0) {
                return f32::INFINITY;
            }
            if t < best.0 {
                let normal = e.cross(f).normalize_or_zero();
                best = (t, Some(if normal.dot(direction) > 0.0 { -normal } else { normal }));
            }
            // The distance is rounded up, so that no nearer triangle is skipped.
            (t as f32).next_up()
        });
        best.1
    }

    /// Returns the exact image of a perspective camera.
    ///
    /// # Panics
    /// For other projections.
    pub fn image(&self, camera: &Camera) -> Truth {
        let Projection::Perspective { fov_y_deg } = camera.projection else { panic!("perspective") };
        let [right, down, forward] = axes(camera);
        let [w, h] = camera.size;
        let f = f64::from(h) / (2.0 * (0.5 * fov_y_deg).to_radians().tan());
        let eye = DVec3::from(camera.eye);
        let ray = |x: u32, y: u32| {
            let across = (f64::from(x) + 0.5 - 0.5 * f64::from(w)) / f;
            forward + right * across + down * ((f64::from(y) + 0.5 - 0.5 * f64::from(h)) / f)
        };
        (0..w * h).map(|i| self.normal(eye, ray(i % w, i / w))).collect()
    }

    /// Returns a camera that looks at the middle of the mesh along −`view`. Its distance is such that the mesh covers
    /// about the fraction `share` of the image. The distance is limited to 1.2 to 60 half-diagonals of the mesh's
    /// bounds.
    pub fn camera_covering(&self, view: DVec3, share: f64, size: u32) -> Camera {
        let (mut near, mut far) = (1.2f64, 60.0f64);
        for _ in 0..14 {
            let middle = (near * far).sqrt();
            let covered = self.image(&self.camera(view, middle, 100)).iter().flatten().count() as f64 / 1e4;
            if covered > share { near = middle } else { far = middle }
        }
        self.camera(view, (near * far).sqrt(), size)
    }

    /// Returns a camera that looks at the middle of the mesh along −`view`. `distance` is in half-diagonals of the
    /// mesh's bounds.
    fn camera(&self, view: DVec3, distance: f64, size: u32) -> Camera {
        let points = || self.corners.iter().flatten().copied();
        let (lo, hi) = (points().fold(DVec3::INFINITY, DVec3::min), points().fold(DVec3::NEG_INFINITY, DVec3::max));
        let (middle, radius) = (0.5 * (lo + hi), 0.5 * (hi - lo).length());
        Camera {
            eye: (middle + view.normalize() * radius * distance).to_array(),
            target: middle.to_array(),
            up: [0.0, 1.0, 0.0],
            projection: Projection::Perspective { fov_y_deg: FOV_Y_DEG },
            near: 0.01 * radius,
            far: None,
            size: [size; 2],
        }
    }
}

/// Result of comparing one pixel with the exact image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pixel {
    /// Neither image has a surface.
    Empty,
    /// Both images have a surface, with normals within 20°.
    Same,
    /// Only the exact image has a surface.
    Missing,
    /// Only the drawn frame has a surface.
    Extra,
    /// Both images have a surface, with normals more than 20° apart.
    Normal,
}

/// Compares the coverage (Σw > 0) and the normals of a frame with the exact image.
pub fn compare(truth: &Truth, frame: &Frame) -> Vec<Pixel> {
    let cosine = DIFFERENT_DEG.to_radians().cos();
    let pixel = |(hit, (weight, normal)): (&Option<DVec3>, (&f32, &[f32; 3]))| match (hit, *weight > 0.0) {
        (None, false) => Pixel::Empty,
        (None, true) => Pixel::Extra,
        (Some(_), false) => Pixel::Missing,
        (Some(hit), true) if DVec3::from(normal.map(f64::from)).dot(*hit) < cosine => Pixel::Normal,
        (Some(_), true) => Pixel::Same,
    };
    truth.iter().zip(frame.weight().iter().zip(frame.normal())).map(pixel).collect()
}

/// Counts of differing pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Difference {
    /// Number of pixels that the mesh covers.
    pub covered: usize,
    /// Number of pixels whose coverage differs.
    pub coverage: usize,
    /// Number of pixels whose normals differ.
    pub normals: usize,
    /// Number of holes: pixels without a splat that, like their eight neighbours, are covered by the mesh.
    pub holes: usize,
}

impl Difference {
    /// Counts the results of an image that is `width` pixels wide.
    pub fn of(pixels: &[Pixel], width: usize) -> Self {
        let count = |kind: fn(&Pixel) -> bool| pixels.iter().filter(|p| kind(p)).count();
        let height = pixels.len() / width.max(1);
        let covered = |x: usize, y: usize| !matches!(pixels[y * width + x], Pixel::Empty | Pixel::Extra);
        let is_hole = |at: &usize| {
            let (x, y) = (at % width, at / width);
            let inside = x > 0 && y > 0 && x + 1 < width && y + 1 < height;
            inside && (y - 1..=y + 1).all(|y| (x - 1..=x + 1).all(|x| covered(x, y))) && pixels[*at] == Pixel::Missing
        };
        Self {
            covered: count(|p| !matches!(p, Pixel::Empty | Pixel::Extra)),
            coverage: count(|p| matches!(p, Pixel::Missing | Pixel::Extra)),
            normals: count(|p| *p == Pixel::Normal),
            holes: (0..pixels.len()).filter(is_hole).count(),
        }
    }

    /// Returns the number of differing pixels divided by the number of covered ones.
    pub fn share(&self) -> f64 {
        (self.coverage + self.normals) as f64 / self.covered.max(1) as f64
    }
}
