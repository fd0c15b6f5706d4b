//! Camera framing: places a camera so that the scene fills the image.

use crate::samples::Samples;
use crate::strays::{Kind, Sphere, without_strays};
use crate::up_axis::{UpConvention, Upright};
use crate::view::{ChosenView, ViewAngles, ViewAxes, ViewChoice};
use crate::{up_axis, viewpoint};
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use std::ops::Range;
use surfel_math::V2;
use surfel_math::basis::unit;
use surfel_math::clip::Clip;
use surfel_model::{Camera, ClipPolicy, GaussianCloud, Geometry, Object, Projection, Scene, Shape, SplatCloud, Up};

/// Vertical field of view of automatic cameras, in degrees. It matches a short telephoto lens, which distorts little.
pub const DEFAULT_FOV_Y_DEG: f64 = 35.0;

impl ViewAxes {
    /// Returns the axes of the view that `choice` selects. `objects` are needed for [`ViewChoice::Auto`].
    pub fn of_choice(choice: ViewChoice, objects: &[Object], up: Up) -> Self {
        match choice {
            ViewChoice::Auto => Self::turned(best_view(objects, up), up),
            ViewChoice::Named(view) => Self::named(view, up),
            ViewChoice::From(angles) => Self::turned(angles, up),
        }
    }
}

/// Projection of a framed view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameProjection {
    /// Perspective projection with this vertical field of view, in degrees between 0 and 180.
    Perspective(f64),
    /// Orthographic projection. Framing chooses the height of the view.
    Orthographic,
}

/// Options for framing a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameOptions {
    /// Axes of the camera.
    pub axes: ViewAxes,
    /// Projection of the camera.
    pub projection: FrameProjection,
    /// Image width and height in pixels.
    pub size: [u32; 2],
    /// Fraction of the image's width or height that the scene fills, clamped to [0.01, 1].
    pub fill: f64,
    /// Axis of a turntable through the scene's centre, a unit vector in world space. The scene then fits the image at
    /// all angles. `None` if the scene doesn't turn.
    pub turning: Option<DVec3>,
}

/// Centring error below which the camera isn't moved any more: the difference between opposite margins, as a fraction
/// of half of the image's height. It is 1 pixel of an image that is 1000 pixels high.
const CENTRED: f64 = 0.002;
/// Largest number of times that the camera is moved sideways to centre the scene.
const STEPS: usize = 4;
/// Number of evenly spaced turntable angles at which a turning scene must fit the image.
const TURNS: u32 = 24;

/// Minima, over all splats of a scene, of several linear functions of position, such as distances from the planes of
/// the view frustum. They show how far the scene extends in each direction.
#[derive(Clone)]
struct Support {
    /// Gradient of each function, and the gradient's length.
    directions: Vec<(DVec3, f64)>,
    least: Vec<f64>,
}

impl Support {
    fn new(directions: Vec<DVec3>) -> Self {
        let least = vec![f64::INFINITY; directions.len()];
        Self { directions: directions.into_iter().map(|g| (g, g.length())).collect(), least }
    }

    /// Returns the minima, over a scene's splats, of the linear functions whose gradients are `directions`. `at` maps a
    /// splat's centre, or a point of a clipped splat's outline, to the position at which they are evaluated. It returns
    /// `None` to skip the splat or the point.
    fn of(scene: &Scene, directions: Vec<DVec3>, at: impl Fn(DVec3) -> Option<DVec3> + Sync) -> Self {
        let add = |support: &mut Self, p: DVec3, splat: &Extent| {
            if at(p).is_none_or(|p| support.may_grow(p, splat)) {
                splat.parts(p, &mut |p, part| at(p).into_iter().for_each(|p| support.add(p, part)));
            }
        };
        let join = |mut a: Self, b: Self| {
            a.least.iter_mut().zip(b.least).for_each(|(a, b)| *a = a.min(b));
            a
        };
        gathered(scene, &Self::new(directions), add, join)
    }

    /// True if a splat with centre `p` may lower one of the minima. The test uses only the splat's bounding sphere, and
    /// is fast.
    fn may_grow(&self, p: DVec3, splat: &Extent) -> bool {
        let mut all = self.directions.iter().zip(&self.least);
        all.any(|((g, length), least)| g.dot(p) - length * splat.reach < *least)
    }

    /// Lowers the minima so that they include the ellipse of a splat with centre `p`.
    fn add(&mut self, p: DVec3, splat: &Extent) {
        for ((g, length), least) in self.directions.iter().zip(&mut self.least) {
            let middle = g.dot(p);
            // Most splats are too far inside to lower a minimum, and are skipped here.
            if middle - length * splat.reach < *least {
                // An ellipse p + u·s + v·t reaches |(g·s, g·t)| to either side.
                let (s, t) = (splat.axes)();
                *least = least.min(middle - g.dot(s).hypot(g.dot(t)));
            }
        }
    }
}

/// Shape of a splat around its centre, in world space, without its position.
struct Extent<'a> {
    /// Radius of a sphere around the centre that contains the splat.
    reach: f64,
    /// Function that returns the half-axes of the splat, in world space; zero vectors for a point.
    axes: &'a dyn Fn() -> (DVec3, DVec3),
    /// Function that passes the points on the outline of a clipped splat to its argument; `None` for whole splats. The
    /// points replace the ellipse. They are slow to compute, and are computed only if the splat may change the result.
    outline: Option<&'a Outline<'a>>,
}

/// Function that calls its argument with each point of a splat's outline, in world space.
type Outline<'a> = dyn Fn(&mut dyn FnMut(DVec3)) + 'a;

const POINT: Extent = Extent { reach: 0.0, axes: &|| (DVec3::ZERO, DVec3::ZERO), outline: None };

impl Extent<'_> {
    /// Calls `f` with the position and the shape of the splat with centre `p`, or of each point of its outline if it is
    /// clipped.
    fn parts(&self, p: DVec3, f: &mut dyn FnMut(DVec3, &Extent)) {
        match self.outline {
            Some(outline) => outline(&mut |q| f(q, &POINT)),
            None => f(p, self),
        }
    }
}

/// Calls `f` with the centre and the shape of each splat of an object, in world space. Mesh vertices are points.
/// `range` is the range of splats or vertices to visit. For an octree, a range that begins at 0 visits all splats of
/// the finest level, and any other range visits none. Gaussians that extend farther than `longest` (object units) from
/// their centres are shortened to `longest`. Faint Gaussians are skipped unless all are faint.
fn for_each_of(object: &Object, range: Range<usize>, longest: f64, f: &mut dyn FnMut(DVec3, &Extent)) {
    let m = object.world_from_object;
    // This is an upper bound of the matrix's 2-norm: √ of the 1-norm times the ∞-norm, slightly enlarged for rounding.
    let columns = m.matrix3.to_cols_array_2d().map(|c| c.map(f64::abs));
    let of_column = columns.map(|c| c.iter().sum::<f64>()).into_iter().fold(0.0, f64::max);
    let of_row = (0..3).map(|k| columns.iter().map(|c| c[k]).sum::<f64>()).fold(0.0, f64::max);
    let growth = (of_column * of_row).sqrt() * (1.0 + 1e-9);
    let mut splat = |cloud: &SplatCloud, i: usize| {
        let p = m.transform_point3(cloud.center(i));
        let axes = || {
            let (s, t) = cloud.axes(i);
            (m.transform_vector3(s), m.transform_vector3(t))
        };
        let reach = match &cloud.data().shape {
            Shape::Disks { .. } | Shape::Balls { .. } => cloud.radius_max(i),
            Shape::Ellipses { s, t } => (s.get(i).length_squared() + t.get(i).length_squared()).sqrt(),
        };
        match cloud.data().clips.as_ref().filter(|clips| clips.is_clipped(i)) {
            Some(clips) => {
                let outline = |f: &mut dyn FnMut(DVec3)| {
                    let (s, t) = axes();
                    let clip = clips.clip(i, ClipPolicy::Exact);
                    clip.iter().flat_map(outline).for_each(|d| f(p + s * d.x + t * d.y));
                };
                f(p, &Extent { reach: reach * growth * OUTSIDE, axes: &axes, outline: Some(&outline) });
            }
            None => f(p, &Extent { reach: reach * growth, axes: &axes, outline: None }),
        }
    };
    match &object.geometry {
        Geometry::Splats(cloud) => range.for_each(|i| splat(cloud, i)),
        Geometry::Gaussians(gaussians) => {
            let opacities = &gaussians.data().opacities;
            let is_shown = |opacity: &f32| *opacity >= GaussianCloud::FAINT;
            // If all Gaussians are faint, all of them are included.
            let are_faint = !opacities.iter().any(is_shown);
            for i in range.filter(|i| are_faint || is_shown(&opacities[*i])) {
                let (s, t) = gaussians.ellipse(i);
                let reach = reach_of(gaussians, i);
                let part = if reach > longest { longest / reach } else { 1.0 };
                let axes = || (m.transform_vector3(s * part), m.transform_vector3(t * part));
                let reach = reach * part * growth;
                f(m.transform_point3(gaussians.center(i)), &Extent { reach, axes: &axes, outline: None });
            }
        }
        Geometry::Octree(octree) if range.start == 0 => {
            octree.finest().flatten().for_each(|i| splat(octree.cloud(), i as usize));
        }
        Geometry::Octree(_) => {}
        Geometry::Mesh(mesh) => {
            for i in range {
                f(m.transform_point3(mesh.origin + mesh.positions.get(i)), &POINT);
            }
        }
    }
}

/// Number N where 1 in N Gaussians, the longest ones, count as needles, whose length doesn't influence framing.
const ONE_NEEDLE_IN: usize = 50;
/// Largest number of Gaussians whose length is measured to find the needles ([`ONE_NEEDLE_IN`]). Of more, a regular
/// sample is measured.
const MEASURED: usize = 20_000;

/// Returns the radius of a sphere around a Gaussian's centre that contains its ellipse.
fn reach_of(gaussians: &GaussianCloud, i: usize) -> f64 {
    let (s, t) = gaussians.ellipse(i);
    (s.length_squared() + t.length_squared()).sqrt()
}

/// Returns the extent from its centre to which each Gaussian of an object is limited for framing: the largest one,
/// after excluding needles (the longest 1 in 50). Returns infinity for other geometry, and if there are no Gaussians.
/// Framing needles would make the scene small, although they are hardly visible far from their centres.
fn longest(object: &Object) -> f64 {
    let Geometry::Gaussians(gaussians) = &object.geometry else { return f64::INFINITY };
    let step = gaussians.len().div_ceil(MEASURED).max(1);
    let mut all: Vec<f64> = (0..gaussians.len()).step_by(step).map(|i| reach_of(gaussians, i)).collect();
    let Some(rank) = all.len().checked_sub(1 + all.len() / ONE_NEEDLE_IN) else { return f64::INFINITY };
    *all.select_nth_unstable_by(rank, f64::total_cmp).1
}

/// Folds all splats of a scene with `add`, in chunks on all threads. Each chunk starts from a copy of `none`. `join`
/// combines the results of the chunks in order.
fn gathered<T: Clone + Send + Sync>(
    scene: &Scene,
    none: &T,
    add: impl Fn(&mut T, DVec3, &Extent) + Sync,
    join: impl Fn(T, T) -> T,
) -> T {
    const PART: usize = 1 << 15;
    let part = |object: &Object, range: Range<usize>, longest: f64| {
        let mut found = none.clone();
        for_each_of(object, range, longest, &mut |p, splat| add(&mut found, p, splat));
        found
    };
    let of_object = |object: &Object| {
        let (count, longest) = (object.geometry.len(), longest(object));
        let parts = (0..count.div_ceil(PART)).into_par_iter();
        parts.map(|i| part(object, i * PART..count.min((i + 1) * PART), longest)).collect::<Vec<T>>()
    };
    scene.objects.iter().flat_map(of_object).fold(none.clone(), join)
}

/// Largest distance of the points of [`outline`] from the splat's centre, where the rim of the unclipped splat is at 1.
const OUTSIDE: f64 = 1.02;

/// Returns points (u, v), in half-axes of the splat, slightly outside of the visible part of a clipped splat. There is
/// one point on each of several rays from the centre, one step beyond the farthest visible position on the ray. The
/// points are moved outwards by the distance that neighbouring rays may miss. Returns no points if the clip removes the
/// whole splat.
fn outline(clip: &Clip<f64>) -> impl Iterator<Item = V2<f64>> + '_ {
    const RAYS: u32 = 16;
    const STEPS: u32 = 16;
    let between = (std::f64::consts::PI / f64::from(RAYS)).cos().recip();
    (0..RAYS).filter_map(move |ray| {
        let (y, x) = (std::f64::consts::TAU * f64::from(ray) / f64::from(RAYS)).sin_cos();
        let at = |step: u32| V2::new(x, y) * (f64::from(step) / f64::from(STEPS));
        let farthest = (0..=STEPS).rev().find(|step| clip.keeps(at(*step)))?;
        Some(at((farthest + 1).min(STEPS)) * between)
    })
}

fn bounds(scene: &Scene, keep: impl Fn(DVec3) -> bool + Sync) -> Option<(DVec3, DVec3)> {
    let add = |bounds: &mut Option<(DVec3, DVec3)>, p: DVec3, splat: &Extent| {
        let is_inside =
            |(lo, hi): (DVec3, DVec3)| (p - splat.reach).cmpge(lo).all() && (p + splat.reach).cmple(hi).all();
        if bounds.is_some_and(is_inside) {
            return;
        }
        splat.parts(p, &mut |p, part| {
            if keep(p) {
                let (s, t) = (part.axes)();
                let e = (s * s + t * t).map(f64::sqrt);
                let (lo, hi) = bounds.unwrap_or((p - e, p + e));
                *bounds = Some((lo.min(p - e), hi.max(p + e)));
            }
        });
    };
    let join = |a: Option<(DVec3, DVec3)>, b: Option<(DVec3, DVec3)>| {
        a.zip(b).map(|(a, b)| (a.0.min(b.0), a.1.max(b.1))).or(a).or(b)
    };
    gathered(scene, &None, add, join).filter(|(lo, hi)| lo.is_finite() && hi.is_finite())
}

/// Returns a sphere around a scene without its stray points ([`without_strays`]), or `None` if the scene has no stray
/// points.
pub fn without_strays_of(scene: &Scene) -> Option<Sphere> {
    let mut sample = Vec::new();
    let total: usize = scene.objects.iter().map(|o| o.geometry.len()).sum();
    let step = (total / 20_000).max(1);
    let mut index = 0_usize;
    for object in &scene.objects {
        let len = object.geometry.len();
        if matches!(object.geometry, Geometry::Splats(_) | Geometry::Mesh(_)) {
            // Each splat counts, so that the splats between samples needn't be visited.
            let first = index.next_multiple_of(step) - index;
            (first..len)
                .step_by(step)
                .for_each(|i| for_each_of(object, i..i + 1, f64::INFINITY, &mut |p, _| sample.push(p)));
            index += len;
        } else {
            for_each_of(object, 0..len, f64::INFINITY, &mut |p, _| {
                if index.is_multiple_of(step) {
                    sample.push(p);
                }
                index += 1;
            });
        }
    }
    let far = |middle: DVec3, limit: f64| {
        let add = |found: &mut Vec<DVec3>, p: DVec3, _: &Extent| {
            if p.distance(middle) > limit {
                found.push(p);
            }
        };
        gathered(scene, &Vec::new(), add, |a, b| [a, b].concat())
    };
    without_strays((&sample, total), Kind::of(&scene.objects), far)
}

/// Statistics of the stray points that [`frame_camera`] excludes from the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Number of stray points.
    pub count: usize,
    /// Distance of the farthest stray point from the centre of the framed sphere, as a multiple of the sphere's radius.
    pub times: f64,
}

/// Counts the stray points outside of the framed sphere `kept`, for a note to the user. Returns `None` if no point is
/// outside of the sphere.
pub fn left_out(scene: &Scene, kept: &Sphere) -> Option<LeftOut> {
    let add = |found: &mut LeftOut, p: DVec3, _: &Extent| {
        let times = p.distance(kept.middle) / kept.radius;
        if times > 1.0 {
            *found = LeftOut { count: found.count + 1, times: found.times.max(times) };
        }
    };
    let join = |a: LeftOut, b: LeftOut| LeftOut { count: a.count + b.count, times: a.times.max(b.times) };
    Some(gathered(scene, &LeftOut { count: 0, times: 0.0 }, add, join)).filter(|found| found.count > 0)
}

trait Len {
    fn len(&self) -> usize;
}

impl Len for Geometry {
    fn len(&self) -> usize {
        match self {
            Self::Splats(cloud) => cloud.len(),
            Self::Mesh(mesh) => mesh.positions.len(),
            Self::Octree(octree) => octree.finest().map(|range| range.len()).sum(),
            Self::Gaussians(gaussians) => gaussians.len(),
        }
    }
}

/// Places a camera so that the scene is centred and as large as `options.fill` allows. The ellipses themselves fit the
/// image, not only their bounding box. Returns `None` if the scene is empty or its bounds aren't finite.
///
/// Stray points are ignored ([`crate::strays::without_strays`]), unless the scene has fewer than 200 points:
///
/// - In clouds of splats, strays are isolated points, at most 1 in 25. The farthest stray is at least 1.5 times as far
///   from the centre as all points that aren't strays.
/// - Among Gaussians, at most 1 in 50 is a stray. Each stray is more than 1.5 times as far from the centre as the
///   nearest 98 % of the Gaussians.
/// - In other geometry, at most 1 point in 200 is a stray. Each stray is more than four times as far from the centre as
///   the nearest 99.5 % of the points.
///
/// The longest 1 in 50 Gaussians are framed as if they were only as long as the next longest one.
pub fn frame_camera(scene: &Scene, options: &FrameOptions) -> Option<Camera> {
    frame_within(scene, without_strays_of(scene), options)
}

/// Places a camera like [`frame_camera`], for the part of the scene inside of the sphere `kept`. `None` frames the
/// whole scene, including stray points.
pub fn frame_within(scene: &Scene, kept: Option<Sphere>, options: &FrameOptions) -> Option<Camera> {
    let keep = |p: DVec3| kept.is_none_or(|sphere| sphere.contains(p));
    let (lo, hi) = bounds(scene, keep)?;
    let center = (lo + hi) * 0.5;
    let ViewAxes { right, up, forward } = options.axes;
    let [w, h] = options.size.map(f64::from);
    let fill = options.fill.clamp(0.01, 1.0);

    // Tangents of the half-angles that the scene may fill; 0 for an orthographic camera, so that the first four
    // functions below yield the scene's bounds.
    let slope = match options.projection {
        FrameProjection::Perspective(fov_y_deg) => (0.5 * fov_y_deg.to_radians()).tan() * fill,
        FrameProjection::Orthographic => 0.0,
    };
    let (kx, ky) = (slope * w / h, slope);
    let local = [forward * kx - right, forward * kx + right, forward * ky - up, forward * ky + up, forward, -forward];
    let rotations: Vec<DQuat> = match options.turning {
        Some(axis) => {
            let angle = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(TURNS);
            (0..TURNS).map(|i| DQuat::from_axis_angle(unit(axis), angle(i))).collect()
        }
        None => vec![DQuat::IDENTITY],
    };
    let directions = rotations.iter().flat_map(|r| local.map(|g| *r * g)).collect();
    let support = Support::of(scene, directions, |p| keep(p).then(|| p - center));
    let mut least = [f64::INFINITY; 6];
    for values in support.least.chunks_exact(6) {
        least.iter_mut().zip(values).for_each(|(l, v)| *l = l.min(*v));
    }
    let [a, b, c, d, z_first, z_last] = least;
    let (z_first, z_last) = (z_first, -z_last);
    // Flat and tiny scenes need a positive distance, too.
    let size = (hi - lo).length().max(f64::MIN_POSITIVE.sqrt());
    let (x, y) = (0.5 * (b - a), 0.5 * (d - c));
    let (z, projection) = match options.projection {
        FrameProjection::Perspective(fov_y_deg) => {
            // |x − x_eye| ≤ kx (z − z_eye) for all points: two planes per side, which meet at the eye (likewise for y).
            let z = (0.5 * (a + b) / kx).min(0.5 * (c + d) / ky);
            (z, Projection::Perspective { fov_y_deg })
        }
        FrameProjection::Orthographic => {
            let (width, height) = (-(a + b), -(c + d));
            let height = height.max(width * h / w).max(1e-9 * size) / fill;
            (z_first - size, Projection::Orthographic { height })
        }
    };
    let z = if z_first - z > 1e-6 * size { z } else { z_first - 1e-3 * size };
    let mut eye = center + right * x + up * y + forward * z;
    if matches!(projection, Projection::Perspective { .. }) && options.turning.is_none() {
        let enough = CENTRED * slope / fill;
        for _ in 0..STEPS {
            let (moved, off) = centred(scene, eye, &options.axes, &keep);
            eye = moved;
            if off < enough {
                break;
            }
        }
    }
    let target = eye + forward * (0.5 * (z_first + z_last) - z).max(1e-3 * size);
    let far = matches!(projection, Projection::Orthographic { .. }).then(|| z_last - z + size);
    let near = 0.5 * (z_first - z);
    Some(Camera { eye: eye.into(), target: target.into(), up: up.into(), projection, near, far, size: options.size })
}

/// Largest extent of a scene toward one side of the image, as seen from the eye: the tangent of the angle to the
/// viewing direction, and the depth of the splat that extends farthest.
#[derive(Clone, Copy)]
struct Reach {
    tangent: f64,
    depth: f64,
}

/// Moves `eye` sideways so that the left and right margins of the image become nearly equal, and also the upper and
/// lower ones. The step assumes that the outermost splats remain outermost. Also returns the centring error before the
/// step: the largest difference between opposite margins, as a tangent. If the step isn't finite, returns `eye` and 0.
/// `keep` is true for centres of splats that are framed.
///
/// The step is needed because only two sides of the image limit the distance of the eye. The margins at the other two
/// sides may be unequal.
fn centred(scene: &Scene, eye: DVec3, axes: &ViewAxes, keep: &(impl Fn(DVec3) -> bool + Sync)) -> (DVec3, f64) {
    let ViewAxes { right, up, forward } = *axes;
    let across = [-right, right, -up, up];
    // This upper bound rejects most splats, which are too far inside to matter.
    let most = |direction: DVec3, q: DVec3, splat: &Extent| {
        let tangent = q.dot(direction) / q.dot(forward);
        tangent + splat.reach * (1.0 + tangent.abs()) / q.dot(forward)
    };
    let add_part = |reach: &mut [Reach; 4], p: DVec3, part: &Extent| {
        let q = p - eye;
        let depth = q.dot(forward);
        if !keep(p) || depth <= part.reach {
            return;
        }
        for (direction, farthest) in across.into_iter().zip(reach) {
            if most(direction, q, part) <= farthest.tangent {
                continue;
            }
            // This is the tangent of the plane through eye and centre, and the distance by which an ellipse p + u·s +
            // v·t extends beyond the plane.
            let tangent = q.dot(direction) / depth;
            let (beyond, (s, t)) = (direction - forward * tangent, (part.axes)());
            let tangent = tangent + beyond.dot(s).hypot(beyond.dot(t)) / depth;
            if tangent > farthest.tangent {
                *farthest = Reach { tangent, depth };
            }
        }
    };
    let add = |reach: &mut [Reach; 4], p: DVec3, splat: &Extent| {
        let q = p - eye;
        let mut all = across.into_iter().zip(&*reach);
        if q.dot(forward) <= splat.reach
            || all.any(|(direction, farthest)| most(direction, q, splat) > farthest.tangent)
        {
            splat.parts(p, &mut |p, part| add_part(reach, p, part));
        }
    };
    let farther = |a: Reach, b: Reach| if b.tangent > a.tangent { b } else { a };
    let join = |a: [Reach; 4], b: [Reach; 4]| std::array::from_fn(|k| farther(a[k], b[k]));
    let none = [Reach { tangent: f64::NEG_INFINITY, depth: 1.0 }; 4];
    let [left, on_right, below, above] = gathered(scene, &none, add, join);
    // A sideways step moves all points in the opposite direction, and nearer points by more.
    let step = |a: Reach, b: Reach| (b.tangent - a.tangent) / (1.0 / a.depth + 1.0 / b.depth);
    let moved = eye + right * step(left, on_right) + up * step(below, above);
    let off = (on_right.tangent - left.tangent).abs().max((above.tangent - below.tangent).abs());
    if moved.is_finite() { (moved, off) } else { (eye, 0.0) }
}

/// Returns the centre of the bounds of the part of a scene inside of a sphere, at which [`frame_within`] centres the
/// image. `None` for the sphere selects the whole scene. Returns `None` if there is no geometry or its bounds aren't
/// finite.
pub fn center_within(scene: &Scene, kept: Option<Sphere>) -> Option<DVec3> {
    let keep = |p: DVec3| kept.is_none_or(|sphere| sphere.contains(p));
    bounds(scene, keep).map(|(lo, hi)| (lo + hi) * 0.5)
}

/// Returns the minimum and maximum coordinates of the scene's splats and vertices, or `None` if there is no geometry or
/// its bounds aren't finite.
pub fn scene_bounds(scene: &Scene) -> Option<(DVec3, DVec3)> {
    bounds(scene, |_| true)
}

/// Returns the smallest and largest depth of the scene from `eye` along the unit vector `forward`, in world units.
/// Returns `None` if there is no geometry or its depths aren't finite.
pub fn depth_range(scene: &Scene, eye: DVec3, forward: DVec3) -> Option<(f64, f64)> {
    let support = Support::of(scene, vec![forward, -forward], |p| Some(p - eye));
    let (first, last) = (support.least[0], -support.least[1]);
    (first.is_finite() && last.is_finite()).then_some((first, last))
}

/// Estimates the up axis of objects whose files don't state it, from their shape.
///
/// The evidence:
///
/// - map coordinates: two coordinates of 1e5 to 3e7 m, and a third of at most 1e4 m, which is up. They decide alone;
/// - a base on which the objects rest stably, but not upside down;
/// - terrain, a thin height field;
/// - a floor, according to stored normals of points;
/// - orientations in which the objects would topple;
/// - a mirror plane, which contains the up axis;
/// - the capture of a depth camera.
///
/// Without evidence, the convention decides. Only coordinate axes are considered; x and negative axes need strong
/// evidence. At most 20,000 splats or triangles are sampled, always the same ones.
///
/// Source: Fu, Cohen-Or, Dror, Sheffer 2008, "Upright Orientation of Man-Made Objects", with additional evidence.
pub fn upright(objects: &[Object], convention: UpConvention) -> Upright {
    upright_of(&Samples::new(objects), convention)
}

/// Returns the up axis of [`upright`], from samples that other estimates share.
pub fn upright_of(samples: &Samples, convention: UpConvention) -> Upright {
    up_axis::upright(samples, convention)
}

/// Returns the best view of the objects: the one of twelve candidates with the largest weighted sum of several
/// criteria, mainly viewpoint entropy and visible curvature.
///
/// The candidates are 30° apart around the objects and 20° above the horizon. The best one is also compared with a view
/// from the same side, 40° above the horizon. Objects whose height is less than 0.4 of their smaller width are viewed
/// from 40° above the horizon, and flatter ones (less than 0.22) from 50°.
///
/// Three-quarter views are preferred to slightly better straight ones, and front views to back views. The front is that
/// of [`crate::NamedView::Front`], unless the shape has a semantic front. A semantic front is at the head of an animal,
/// opposite to a tail or a backrest, or at the toes of a figure. A room that is open on one side is viewed through the
/// opening, from 10° above the horizon. Reliefs, and surfaces that a depth camera captured, are viewed straight from
/// the front. Equal objects next to each other are viewed like one of them.
///
/// At most 20,000 splats or triangles are sampled, always the same ones. Objects with fewer than 24 splats or triangles
/// get [`ViewAngles::ISO`].
///
/// Sources: viewpoint entropy by Vázquez, Feixas, Sbert, Heidrich 2001; visible curvature after Lee, Varshney, Jacobs
/// 2005; combined as by Secord, Lu, Finkelstein, Singh, Nealen 2011.
pub fn best_view(objects: &[Object], up: Up) -> ViewAngles {
    choose_view(objects, up).angles
}

/// Returns the view of [`best_view`], and the reason for which it was chosen.
pub fn choose_view(objects: &[Object], up: Up) -> ChosenView {
    view_of(&Samples::new(objects), up)
}

/// Returns the view of [`choose_view`], from samples that other estimates share.
pub fn view_of(samples: &Samples, up: Up) -> ChosenView {
    viewpoint::choose_view(samples, up)
}
