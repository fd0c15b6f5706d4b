//! Where to look from: a camera that shows all of a scene, as large as the image allows.

use crate::patches::Patches;
pub use crate::upright::{UpConvention, UpReason, Upright};
use crate::{upright, viewpoint};
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use std::fmt;
use std::ops::Range;
use surfel_math::V2;
use surfel_math::basis::unit;
use surfel_math::clip::Clip;
use surfel_model::{Camera, ClipPolicy, GaussianCloud, Geometry, Object, Projection, Scene, Shape, SplatCloud, Up};

/// Vertical field of view of automatic cameras, in degrees: that of a short telephoto lens, which distorts little.
pub const DEFAULT_FOV_Y_DEG: f64 = 35.0;

/// Views by name, from the scene's up axis. "Front" looks along −z where y is up, and along +y where z is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NamedView {
    /// From the front, 30° to its right and 20° above.
    #[default]
    Iso,
    /// From the front.
    Front,
    /// From behind.
    Back,
    /// From the left of the front view.
    Left,
    /// From the right of the front view.
    Right,
    /// From above.
    Top,
    /// From below.
    Bottom,
}

/// Where a view is from, relative to the front: both 0 are [`NamedView::Front`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewAngles {
    /// About the up axis, toward the right of the front view, in degrees: 90 is [`NamedView::Right`].
    pub azimuth_deg: f64,
    /// Above the horizon, in degrees: 90 is [`NamedView::Top`].
    pub elevation_deg: f64,
}

impl ViewAngles {
    /// Those of [`NamedView::Iso`].
    pub const ISO: Self = Self { azimuth_deg: 30.0, elevation_deg: 20.0 };
}

impl fmt::Display for ViewAngles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{},{}", self.azimuth_deg, self.elevation_deg)
    }
}

/// Evidence that decided from where a scene is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ViewReason {
    /// The view shows most details: places, directions, colours and curvature.
    Details,
    /// The scene's front is there.
    Front,
    /// The scene is open to that side, and shows its inside.
    Opening,
    /// All that is there faces that way, as a depth camera or a relief has it.
    Camera,
    /// Too little is there to judge.
    Convention,
}

impl fmt::Display for ViewReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Details => "it shows most",
            Self::Front => "the front is there",
            Self::Opening => "that side is open",
            Self::Camera => "all faces that way",
            Self::Convention => "the usual view",
        })
    }
}

/// A view and the evidence that decided it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChosenView {
    /// Where the view is from.
    pub angles: ViewAngles,
    /// The evidence that decided.
    pub reason: ViewReason,
}

/// Which side a scene is shown from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum ViewChoice {
    /// The one of a ring of views that shows most: [`best_view`].
    #[default]
    Auto,
    /// One with a name.
    Named(NamedView),
    /// One by its angles.
    From(ViewAngles),
}

/// Directions of a view, unit vectors in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewAxes {
    /// Toward the right of the image.
    pub right: DVec3,
    /// Toward its upper edge.
    pub up: DVec3,
    /// Into the image.
    pub forward: DVec3,
}

impl ViewAxes {
    /// Axes of a camera.
    pub fn of(camera: &Camera) -> Self {
        let forward = unit(DVec3::from(camera.target) - DVec3::from(camera.eye));
        let right = unit(forward.cross(unit(DVec3::from(camera.up))));
        Self { right, up: right.cross(forward), forward }
    }

    /// Axes of the view of `objects` that is chosen.
    pub fn of_choice(choice: ViewChoice, objects: &[Object], up: Up) -> Self {
        match choice {
            ViewChoice::Auto => Self::turned(best_view(objects, up), up),
            ViewChoice::Named(view) => Self::named(view, up),
            ViewChoice::From(angles) => Self::turned(angles, up),
        }
    }

    fn looking(forward: DVec3, up: DVec3) -> Self {
        let right = unit(forward.cross(up));
        Self { right, up: right.cross(forward), forward: unit(forward) }
    }

    /// Axes of a view from these angles. Straight above and below, the front is at the lower edge of the image, as in
    /// [`NamedView::Top`], or at the upper one.
    pub fn turned(angles: ViewAngles, up: Up) -> Self {
        let u = up.vector();
        let front = front(up);
        let right = front.cross(u);
        let (azimuth, elevation) = (angles.azimuth_deg.to_radians(), angles.elevation_deg.to_radians());
        let level = front * azimuth.cos() - right * azimuth.sin();
        let upward = u * elevation.cos() + level * elevation.sin();
        Self::looking(level * elevation.cos() - u * elevation.sin(), upward)
    }

    /// Axes of a named view.
    pub fn named(view: NamedView, up: Up) -> Self {
        let u = up.vector();
        let front = front(up);
        let right = front.cross(u);
        let looking = Self::looking;
        match view {
            NamedView::Front => looking(front, u),
            NamedView::Back => looking(-front, u),
            NamedView::Left => looking(right, u),
            NamedView::Right => looking(-right, u),
            NamedView::Top => looking(-u, front),
            NamedView::Bottom => looking(u, -front),
            NamedView::Iso => {
                let ViewAngles { azimuth_deg, elevation_deg } = ViewAngles::ISO;
                let (azimuth, elevation) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
                let level = front * azimuth.cos() - right * azimuth.sin();
                looking(level * elevation.cos() - u * elevation.sin(), u)
            }
        }
    }
}

/// Direction in which a front view looks. The front is where people expect it: before a y-up model at +z, before a
/// z-up model at −y, and before Gaussian splats, whose cameras look along +z with y down, at −z.
fn front(up: Up) -> DVec3 {
    match up {
        Up::PlusX | Up::MinusX | Up::PlusY => DVec3::NEG_Z,
        Up::MinusY => DVec3::Z,
        Up::PlusZ => DVec3::Y,
        Up::MinusZ => DVec3::NEG_Y,
    }
}

/// Projection of a framed view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameProjection {
    /// Perspective with this vertical field of view, in degrees.
    Perspective(f64),
    /// Parallel; the view's height is chosen.
    Orthographic,
}

/// How a scene is framed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameOptions {
    /// Where to look.
    pub axes: ViewAxes,
    /// Projection.
    pub projection: FrameProjection,
    /// Image width and height in pixels.
    pub size: [u32; 2],
    /// Share of the image's width or height that the scene takes, in (0, 1].
    pub fill: f64,
    /// The scene fits also while it turns about this axis through its middle.
    pub turning: Option<DVec3>,
}

/// What is centred to this share of half the image's height, to a pixel of 1000, or after so many steps.
const CENTRED: f64 = 0.002;
const STEPS: usize = 4;
/// Angles at which a turning scene must fit.
const TURNS: u32 = 24;

/// Least value over the scene of a linear function of position, for each of several functions.
#[derive(Clone)]
struct Support {
    /// Gradients, and their lengths.
    directions: Vec<(DVec3, f64)>,
    least: Vec<f64>,
}

impl Support {
    fn new(directions: Vec<DVec3>) -> Self {
        let least = vec![f64::INFINITY; directions.len()];
        Self { directions: directions.into_iter().map(|g| (g, g.length())).collect(), least }
    }

    /// Of the splats for which `at` gives a position.
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

    /// Whether a splat at `p` may reach farther than what was added.
    fn may_grow(&self, p: DVec3, splat: &Extent) -> bool {
        let mut all = self.directions.iter().zip(&self.least);
        all.any(|((g, length), least)| g.dot(p) - length * splat.reach < *least)
    }

    /// Adds a splat at `p`.
    fn add(&mut self, p: DVec3, splat: &Extent) {
        for ((g, length), least) in self.directions.iter().zip(&mut self.least) {
            let middle = g.dot(p);
            // Most splats are too far inside to matter.
            if middle - length * splat.reach < *least {
                // An ellipse p + u·s + v·t reaches |(g·s, g·t)| to either side.
                let (s, t) = (splat.axes)();
                *least = least.min(middle - g.dot(s).hypot(g.dot(t)));
            }
        }
    }
}

/// How far a splat reaches from its centre, in world space.
struct Extent<'a> {
    /// No point of it is farther away.
    reach: f64,
    /// Its half-axes; zero for what is a point.
    axes: &'a dyn Fn() -> (DVec3, DVec3),
    /// Points on the outline of what a clip keeps, which count in its place. To find them takes longer than all else:
    /// only where the splat may matter.
    outline: Option<&'a Outline<'a>>,
}

/// Calls a function with points.
type Outline<'a> = dyn Fn(&mut dyn FnMut(DVec3)) + 'a;

const POINT: Extent = Extent { reach: 0.0, axes: &|| (DVec3::ZERO, DVec3::ZERO), outline: None };

impl Extent<'_> {
    /// Calls a function with what the splat at `p` is made of: itself, or the points of its outline.
    fn parts(&self, p: DVec3, f: &mut dyn FnMut(DVec3, &Extent)) {
        match self.outline {
            Some(outline) => outline(&mut |q| f(q, &POINT)),
            None => f(p, self),
        }
    }
}

/// Calls `f` with centre and extent of splats of an object, in world space; with none for vertices of a mesh. `range`
/// is of splats, or of vertices; of octrees all are taken with the first.
fn for_each_of(object: &Object, range: Range<usize>, f: &mut dyn FnMut(DVec3, &Extent)) {
    let m = object.world_from_object;
    // No vector gets longer than this many times: the 2-norm is at most √ of the 1-norm times the ∞-norm. And a little
    // more, for what rounding adds.
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
            Shape::Disks { radii, .. } => f64::from(radii[i]),
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
            // Where all are faint, all of them count.
            let are_faint = !opacities.iter().any(is_shown);
            for i in range.filter(|i| are_faint || is_shown(&opacities[*i])) {
                let (s, t) = gaussians.ellipse(i);
                let axes = || (m.transform_vector3(s), m.transform_vector3(t));
                let reach = (s.length_squared() + t.length_squared()).sqrt() * growth;
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

/// What `add` makes of all of a scene, part by part on all threads; what the parts give, which begin with `none`, goes
/// to `join` in their order.
fn gathered<T: Clone + Send + Sync>(
    scene: &Scene,
    none: &T,
    add: impl Fn(&mut T, DVec3, &Extent) + Sync,
    join: impl Fn(T, T) -> T,
) -> T {
    const PART: usize = 1 << 15;
    let part = |object: &Object, range: Range<usize>| {
        let mut found = none.clone();
        for_each_of(object, range, &mut |p, splat| add(&mut found, p, splat));
        found
    };
    let of_object = |object: &Object| {
        let count = object.geometry.len();
        let parts = (0..count.div_ceil(PART)).into_par_iter();
        parts.map(|i| part(object, i * PART..count.min((i + 1) * PART))).collect::<Vec<T>>()
    };
    scene.objects.iter().flat_map(of_object).fold(none.clone(), join)
}

/// How far such points are outside of an ellipse, at most.
const OUTSIDE: f64 = 1.02;

/// Points (u, v) just outside of what a clip keeps: on rays from the centre, a step beyond the farthest that is kept,
/// moved out by what lies between two rays. A clip that keeps nothing has none.
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

/// A sphere about the scene without its stray points: at most 1 splat in 200, each four times as far out as the
/// rest. Everything, where there are no such points.
fn trimmed(scene: &Scene, (lo, hi): (DVec3, DVec3)) -> (DVec3, f64) {
    let mut coordinates: [Vec<f64>; 3] = Default::default();
    let total: usize = scene.objects.iter().map(|o| o.geometry.len()).sum();
    let step = (total / 20_000).max(1);
    let mut add = |p: DVec3| coordinates.iter_mut().zip(p.to_array()).for_each(|(c, x)| c.push(x));
    let mut index = 0_usize;
    for object in &scene.objects {
        let len = object.geometry.len();
        if matches!(object.geometry, Geometry::Splats(_) | Geometry::Mesh(_)) {
            // All of them count, so that those between need not be visited.
            let first = index.next_multiple_of(step) - index;
            (first..len).step_by(step).for_each(|i| for_each_of(object, i..i + 1, &mut |p, _| add(p)));
            index += len;
        } else {
            for_each_of(object, 0..len, &mut |p, _| {
                if index % step == 0 {
                    add(p);
                }
                index += 1;
            });
        }
    }
    let everything = ((lo + hi) * 0.5, f64::INFINITY);
    let count = coordinates[0].len();
    if count < 200 {
        return everything;
    }
    let mut distances = vec![0.0; count];
    let middle = coordinates.clone().map(|mut c| *c.select_nth_unstable_by(count / 2, f64::total_cmp).1);
    let middle = DVec3::from(middle);
    for (i, d) in distances.iter_mut().enumerate() {
        *d = DVec3::new(coordinates[0][i], coordinates[1][i], coordinates[2][i]).distance(middle);
    }
    let core = *distances.select_nth_unstable_by(count - 1 - count / 200, f64::total_cmp).1;
    let farthest = (hi - middle).abs().max((middle - lo).abs()).max_element();
    if core > 0.0 && farthest > 4.0 * core { (middle, 4.0 * core) } else { everything }
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

/// A camera that shows all of the scene, centred and as large as `options.fill` says: the ellipses themselves are
/// fitted, not their bounding box. Stray points (at most 1 in 200, four times as far out as the rest) don't count.
/// `None` if there is nothing to see.
pub fn frame_camera(scene: &Scene, options: &FrameOptions) -> Option<Camera> {
    let all = bounds(scene, |_| true)?;
    let (middle, radius) = trimmed(scene, all);
    let keep = |p: DVec3| p.distance(middle) <= radius;
    let (lo, hi) = if radius.is_finite() { bounds(scene, keep)? } else { all };
    let center = (lo + hi) * 0.5;
    let ViewAxes { right, up, forward } = options.axes;
    let [w, h] = options.size.map(f64::from);
    let fill = options.fill.clamp(0.01, 1.0);

    // Tangents of the half-angles that the scene may take; 0 makes the four functions below plain bounds.
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
    // Flat or tiny scenes still need a distance.
    let size = (hi - lo).length().max(f64::MIN_POSITIVE.sqrt());
    let (x, y) = (0.5 * (b - a), 0.5 * (d - c));
    let (z, projection) = match options.projection {
        FrameProjection::Perspective(fov_y_deg) => {
            // |x − x_eye| ≤ kx (z − z_eye) for all points: two planes a side, met at the eye (likewise for y).
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

/// What reaches farthest to one side of an image: how far, as a tangent, and at what depth.
#[derive(Clone, Copy)]
struct Reach {
    tangent: f64,
    depth: f64,
}

/// The place beside `eye` from which what is kept of a scene has as much room on one side of the image as on the other,
/// and above as below, nearly: as if what reaches farthest stayed the same. With it how far it was off, as a tangent.
/// Planes that meet at the eye leave that to the two sides alone that limit its distance.
fn centred(scene: &Scene, eye: DVec3, axes: &ViewAxes, keep: &(impl Fn(DVec3) -> bool + Sync)) -> (DVec3, f64) {
    let ViewAxes { right, up, forward } = *axes;
    let across = [-right, right, -up, up];
    // How far at most, for most splats are too far inside to matter.
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
            // The plane through eye and centre, and how far an ellipse p + u·s + v·t reaches beyond it.
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
    // By a step aside everything moves the other way, the nearer the farther.
    let step = |a: Reach, b: Reach| (b.tangent - a.tangent) / (1.0 / a.depth + 1.0 / b.depth);
    let moved = eye + right * step(left, on_right) + up * step(below, above);
    let off = (on_right.tangent - left.tangent).abs().max((above.tangent - below.tangent).abs());
    if moved.is_finite() { (moved, off) } else { (eye, 0.0) }
}

/// The middle of the scene's bounds, without stray points, as [`frame_camera`] centres it; `None` without objects.
pub fn scene_center(scene: &Scene) -> Option<DVec3> {
    let all = bounds(scene, |_| true)?;
    let (middle, radius) = trimmed(scene, all);
    let kept = if radius.is_finite() { bounds(scene, |p| p.distance(middle) <= radius) } else { Some(all) };
    kept.map(|(lo, hi)| (lo + hi) * 0.5)
}

/// Least and largest planar depth of the scene from `eye` along the unit vector `forward`; `None` without objects.
pub fn depth_range(scene: &Scene, eye: DVec3, forward: DVec3) -> Option<(f64, f64)> {
    let support = Support::of(scene, vec![forward, -forward], |p| Some(p - eye));
    let (first, last) = (support.least[0], -support.least[1]);
    (first.is_finite() && last.is_finite()).then_some((first, last))
}

/// Which axis is up in objects whose files don't say it, by their shape.
///
/// The evidence is of map coordinates (two of 1e5 to 3e7 m, the third of at most 1e4 m: the third is up); of a base
/// that they stand on steadily, but not on the opposite side; of ground, a thin height field; and of a mirror plane, in
/// which up lies. Without evidence the convention decides. Only coordinate axes are considered, and negative ones and x
/// only if much speaks for them. At most 20,000 splats or triangles are looked at, always the same.
pub fn upright(objects: &[Object], convention: UpConvention) -> Upright {
    upright::upright(Patches::of(objects), |all| all.one_of(objects), convention)
}

/// The view that shows most of objects: of twelve around them, 30° apart and 20° above, the one with the largest
/// viewpoint entropy and visible curvature, or the same from 40° above if that shows clearly more; of what is lower
/// than 0.4 of its smaller width, of twelve 40° above, and than 0.22 of it, 50° above.
///
/// Three-quarter views win over slightly better straight ones, and views of the front over those of the back. The front
/// is that of [`NamedView::Front`], or of a mirror-symmetric body that stands on feet where it is taller, opposite to
/// its tail, and away from its backrest. A room that is open to one side is looked into from there. Equal things side
/// by side are seen from where each would be. At most 20,000 splats or triangles are looked at, always the same; of
/// objects with less than 24 it is [`ViewAngles::ISO`].
pub fn best_view(objects: &[Object], up: Up) -> ViewAngles {
    choose_view(objects, up).angles
}

/// The view of [`best_view`], and the evidence that decided it.
pub fn choose_view(objects: &[Object], up: Up) -> ChosenView {
    viewpoint::choose_view(Patches::of(objects), |all| all.one_of(objects), up)
}
