//! Paths of a camera through keys.
//!
//! Positions follow cubic splines through the keys, so that neither position nor speed jumps. The construction is that
//! of Catmull and Rom (1974), with an interval for each pair of keys (Barry and Goldman 1988). Without times, intervals
//! are the square roots of the distances between keys, the *centripetal* choice, which has no loops (Yuksel, Schaefer,
//! Keyser 2011). Viewing directions and up vectors follow the same construction on the sphere, with arcs of great
//! circles in place of lines. The axes of each camera are orthonormal.
//!
//! The eye or the target, whichever moves less, has a spline of its own. The other one is computed from it by a splined
//! direction and a splined distance; the distance is interpolated as a logarithm. So a camera that circles a target
//! remains at its distance, and one that looks around stays in its place.

use crate::camera::resized;
use crate::render_options::RenderOptions;
use glam::DVec3;
use std::path::Path;
use surfel_io::camera_path::CameraKeys;
use surfel_load::Error;
use surfel_model::{Camera, Projection};

/// Shortest interval between two keys without times, as a fraction of the mean interval. Two keys at the same position
/// get this interval, so that the camera hardly pauses there.
const MIN_INTERVAL: f64 = 1e-3;

/// A camera path through keys, prepared for sampling at any time.
#[derive(Clone, Debug)]
pub struct CameraPath {
    cameras: Vec<Camera>,
    /// Times of the keys, in ascending order: in seconds if `is_timed`, otherwise without a unit. A closed path has one
    /// more time, that of the return to the first key.
    times: Vec<f64>,
    /// True if times are in seconds, as the keys state them; false if times are derived from distances.
    is_timed: bool,
    is_closed: bool,
    /// True if the camera circles its target: the target follows a spline, and the eye is computed from it. False for
    /// the reverse.
    circles: bool,
}

/// Position in time between two successive keys of a camera path. `key` is the index of the earlier one, and `fraction`
/// (0 to 1) the part of the interval that has passed.
#[derive(Clone, Copy, Debug)]
struct Place {
    key: usize,
    fraction: f64,
}

impl CameraPath {
    /// Reads a camera path from a file. The size in `options`, if any, replaces the size of the keys' images.
    ///
    /// # Errors
    /// [`Error::Io`] for a file that can't be read or isn't a camera path; [`Error::Unsuitable`] for cameras of
    /// different projections.
    pub fn read(path: &Path, options: &RenderOptions) -> Result<Self, Error> {
        Self::of(surfel_io::camera_path::read(path)?, path, options)
    }

    /// Parses a camera path from JSON, like [`CameraPath::read`]. `name` appears in messages, and names of files in the
    /// path are relative to its folder.
    ///
    /// # Errors
    /// Errors of [`CameraPath::read`].
    pub fn parse(json: &[u8], name: &Path, options: &RenderOptions) -> Result<Self, Error> {
        Self::of(surfel_io::camera_path::parse(json, name)?, name, options)
    }

    fn of(keys: CameraKeys, path: &Path, options: &RenderOptions) -> Result<Self, Error> {
        let unsuitable = |problem: String| Error::Unsuitable { path: path.to_path_buf(), problem };
        let mut styled = options.clone();
        styled.apply_style();
        Self::new(keys, styled.size).map_err(unsuitable)
    }

    /// Prepares a path for sampling. `size`, in pixels, replaces the size of the cameras' images.
    ///
    /// # Errors
    /// A description of the problem: no keys, keys with different projections, or keys with different sizes if `size`
    /// is `None`.
    pub fn new(path: CameraKeys, size: Option<[u32; 2]>) -> Result<Self, String> {
        let CameraKeys { keys, closed } = path;
        let times: Option<Vec<f64>> = keys.iter().map(|key| key.time).collect();
        let mut cameras: Vec<Camera> = keys.into_iter().map(|key| key.camera).collect();
        let Some(first) = cameras.first().cloned() else { return Err("has no key".to_owned()) };
        for (i, camera) in cameras.iter_mut().enumerate() {
            if std::mem::discriminant(&camera.projection) != std::mem::discriminant(&first.projection) {
                return Err(format!(
                    "keys[{i}] has another kind of projection than keys[0], expected one for all keys"
                ));
            }
            if camera.size != first.size && size.is_none() {
                let ([w, h], [x, y]) = (first.size, camera.size);
                return Err(format!("keys[{i}] has {x}x{y} pixels, and keys[0] {w}x{h}: give one size by --size WxH"));
            }
            *camera = resized(camera, size.unwrap_or(first.size));
        }
        let is_timed = times.is_some();
        let times = times.unwrap_or_else(|| centripetal(&cameras, closed));
        let times = if closed && times.len() == cameras.len() { with_return(times) } else { times };
        let pairs = || cameras.iter().zip(cameras.iter().skip(1));
        let way = |of: fn(&Camera) -> DVec3| pairs().map(|(a, b)| of(a).distance(of(b))).sum::<f64>();
        let circles = way(target) <= way(eye);
        Ok(Self { cameras, times, is_timed, is_closed: closed, circles })
    }

    /// Returns the number of keys.
    pub fn keys(&self) -> usize {
        self.cameras.len()
    }

    /// Returns the duration in seconds, if the keys state times.
    pub fn seconds(&self) -> Option<f64> {
        self.is_timed.then(|| self.duration())
    }

    /// True if the path returns from its last key to its first.
    pub fn is_closed(&self) -> bool {
        self.is_closed
    }

    fn duration(&self) -> f64 {
        self.times.last().zip(self.times.first()).map_or(0.0, |(last, first)| last - first)
    }

    /// Returns one camera for each frame of a film with `frames` frames. The film begins at the first key and ends at
    /// the last; a closed path is sampled so that the film can be repeated.
    ///
    /// # Errors
    /// [`Error::Usage`] if the camera turns by 180° between two keys, so that its direction isn't defined.
    pub fn cameras(&self, frames: u32) -> Result<Vec<Camera>, Error> {
        let steps = if self.is_closed { frames } else { frames.saturating_sub(1).max(1) };
        let (first, duration) = (self.times.first().copied().unwrap_or_default(), self.duration());
        let time = |frame: u32| first + duration * f64::from(frame) / f64::from(steps);
        (0..frames).map(|frame| self.at(time(frame))).collect()
    }

    /// Returns the interpolated camera at a time, in the units of [`Self::times`].
    fn at(&self, time: f64) -> Result<Camera, Error> {
        let place = self.place(time);
        let [from, to] = [place.key, place.key + 1].map(|key| self.camera(key as isize));
        if place.fraction == 0.0 || place.fraction == 1.0 {
            return Ok(if place.fraction == 0.0 { from } else { to }.clone());
        }
        let mix = |a: f64, b: f64| a + (b - a) * place.fraction;
        let forward = self.spline(place, spherical, |camera| toward(camera).normalize()).normalize_or_zero();
        let distance = self.spline(place, linear, |camera| DVec3::splat(toward(camera).length().ln())).x.exp();
        let (eye, target) = if self.circles {
            let target = self.spline(place, linear, target);
            (target - forward * distance, target)
        } else {
            let eye = self.spline(place, linear, eye);
            (eye, eye + forward * distance)
        };
        let up = self.spline(place, spherical, |camera| DVec3::from(camera.up).normalize());
        let camera = Camera {
            eye: eye.into(),
            target: target.into(),
            up: up.into(),
            projection: between(from.projection, to.projection, place.fraction),
            near: mix(from.near, to.near),
            far: from.far.zip(to.far).map(|(a, b)| mix(a, b)),
            size: from.size,
        };
        let turns = |_| {
            let (a, b) = (place.key, (place.key + 1) % self.cameras.len());
            Error::Usage(format!("--path: the camera turns too far between keys[{a}] and keys[{b}]: add a key between"))
        };
        camera.validate().map_err(turns)?;
        Ok(camera)
    }

    fn place(&self, time: f64) -> Place {
        let last = self.times.len().saturating_sub(2);
        let key = self.times.partition_point(|start| *start <= time).saturating_sub(1).min(last);
        let (start, end) = (self.times[key], self.times[key + 1]);
        Place { key, fraction: ((time - start) / (end - start)).clamp(0.0, 1.0) }
    }

    /// Returns the camera of a key. For a closed path, the index wraps around; for an open one, it is clamped to the
    /// ends.
    fn camera(&self, key: isize) -> &Camera {
        let count = self.cameras.len() as isize;
        let at = if self.is_closed { key.rem_euclid(count) } else { key.clamp(0, count - 1) };
        &self.cameras[at as usize]
    }

    /// Returns the length of the time interval that begins at a key; 0 for an index outside of an open path.
    fn interval(&self, key: isize) -> f64 {
        let count = self.times.len() as isize - 1;
        let at = if self.is_closed { key.rem_euclid(count) } else { key };
        usize::try_from(at).ok().and_then(|at| Some(self.times.get(at + 1)? - self.times[at])).unwrap_or(0.0)
    }

    /// Evaluates a spline through the keys at a place between two of them. `of` returns the property of a camera that
    /// is interpolated, such as its eye. `mix` interpolates between two values, and extrapolates for fractions outside
    /// of 0 to 1.
    fn spline(&self, place: Place, mix: Mix, of: impl Fn(&Camera) -> DVec3) -> DVec3 {
        let key = place.key as isize;
        let mut values = [key - 1, key, key + 1, key + 2].map(|key| of(self.camera(key)));
        let [mut before, here, mut behind] = [key - 1, key, key + 1].map(|key| self.interval(key));
        // Beyond its ends, an open path is extended in a straight line.
        if before <= 0.0 {
            (before, values[0]) = (here, mix(values[1], values[2], -1.0));
        }
        if behind <= 0.0 {
            (behind, values[3]) = (here, mix(values[1], values[2], 2.0));
        }
        let since = place.fraction * here;
        let firsts = [
            mix(values[0], values[1], 1.0 + since / before),
            mix(values[1], values[2], place.fraction),
            mix(values[2], values[3], (since - here) / behind),
        ];
        let seconds = [
            mix(firsts[0], firsts[1], (before + since) / (before + here)),
            mix(firsts[1], firsts[2], since / (here + behind)),
        ];
        mix(seconds[0], seconds[1], place.fraction)
    }
}

/// Function that interpolates between two values: from the first at 0 to the second at 1.
type Mix = fn(DVec3, DVec3, f64) -> DVec3;

fn linear(a: DVec3, b: DVec3, t: f64) -> DVec3 {
    a + (b - a) * t
}

/// Interpolates between two unit vectors along the great circle through both. Returns zero if they are opposite.
fn spherical(a: DVec3, b: DVec3, t: f64) -> DVec3 {
    let across = a.cross(b);
    let angle = across.length().atan2(a.dot(b));
    if angle < 1e-9 {
        return linear(a, b, t).normalize_or_zero();
    }
    let aside = across.cross(a).normalize_or_zero();
    let (sine, cosine) = (t * angle).sin_cos();
    if across.length() < 1e-9 { DVec3::ZERO } else { a * cosine + aside * sine }
}

fn eye(camera: &Camera) -> DVec3 {
    camera.eye.into()
}

fn target(camera: &Camera) -> DVec3 {
    camera.target.into()
}

fn toward(camera: &Camera) -> DVec3 {
    target(camera) - eye(camera)
}

/// Interpolates between two projections of the same kind: `from` at t = 0, `to` at t = 1. Returns `from` if their kinds
/// differ.
fn between(from: Projection, to: Projection, t: f64) -> Projection {
    let mix = |a: f64, b: f64| a + (b - a) * t;
    match (from, to) {
        (Projection::Perspective { fov_y_deg: a }, Projection::Perspective { fov_y_deg: b }) => {
            Projection::Perspective { fov_y_deg: mix(a, b) }
        }
        (Projection::Orthographic { height: a }, Projection::Orthographic { height: b }) => {
            Projection::Orthographic { height: mix(a, b) }
        }
        (Projection::Intrinsics { fx, fy, cx, cy }, Projection::Intrinsics { fx: x, fy: y, cx: u, cy: v }) => {
            Projection::Intrinsics { fx: mix(fx, x), fy: mix(fy, y), cx: mix(cx, u), cy: mix(cy, v) }
        }
        _ => from,
    }
}

/// Returns times for keys that state none. Their differences are proportional to the square roots of the distances
/// between keys (of the eyes plus of the targets). The differences have a mean of about 1, and are at least
/// [`MIN_INTERVAL`].
fn centripetal(cameras: &[Camera], closed: bool) -> Vec<f64> {
    let next = cameras.iter().cycle().skip(1);
    let pairs = cameras.iter().zip(next).take(cameras.len() - usize::from(!closed));
    let way = |(a, b): (&Camera, &Camera)| (eye(a).distance(eye(b)) + target(a).distance(target(b))).sqrt();
    let ways: Vec<f64> = pairs.map(way).collect();
    let mean = ways.iter().sum::<f64>() / ways.len().max(1) as f64;
    let mut times = vec![0.0];
    for way in ways {
        let step = if mean > 0.0 { (way / mean).max(MIN_INTERVAL) } else { 1.0 };
        times.push(times.last().copied().unwrap_or_default() + step);
    }
    times
}

/// Appends the time at which a closed path returns to its first key. The interval for the return is the mean of the
/// intervals between the keys.
fn with_return(mut times: Vec<f64>) -> Vec<f64> {
    if let (Some(first), Some(last)) = (times.first().copied(), times.last().copied()) {
        times.push(last + (last - first) / (times.len() - 1).max(1) as f64);
    }
    times
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_io::camera_path::PathKey;

    fn key(eye: [f64; 3], target: [f64; 3], time: Option<f64>) -> PathKey {
        PathKey { camera: Camera::perspective(eye, target, 40.0, [64, 48]).with_up([0.0, 0.0, 1.0]), time }
    }

    fn path(keys: Vec<PathKey>, closed: bool) -> CameraPath {
        CameraPath::new(CameraKeys { keys, closed }, None).unwrap()
    }

    /// Returns keys on a circle about the origin.
    fn circle(count: u32) -> Vec<PathKey> {
        let place = |i: u32| {
            let (y, x) = (std::f64::consts::TAU * f64::from(i) / f64::from(count)).sin_cos();
            key([3.0 * x, 3.0 * y, 1.0], [0.0; 3], None)
        };
        (0..count).map(place).collect()
    }

    #[test]
    fn paths_pass_their_keys_and_are_smooth() {
        let keys = vec![
            key([0.0, -5.0, 1.0], [0.0; 3], Some(1.0)),
            key([4.0, -3.0, 2.0], [0.5, 0.0, 0.0], Some(2.0)),
            key([6.0, 1.0, 1.0], [1.0, 0.0, 0.5], Some(5.0)),
        ];
        let path = path(keys.clone(), false);
        assert_eq!(path.seconds(), Some(4.0));
        let cameras = path.cameras(401).unwrap();
        for (frame, key) in [(0, 0), (100, 1), (400, 2)] {
            assert_eq!(cameras[frame], keys[key].camera, "{key}");
        }
        // Steps change little from frame to frame, at the keys, too.
        let steps: Vec<DVec3> = cameras.windows(2).map(|pair| eye(&pair[1]) - eye(&pair[0])).collect();
        let most = steps.iter().map(|step| step.length()).fold(0.0, f64::max);
        let jump = steps.windows(2).map(|pair| pair[0].distance(pair[1])).fold(0.0, f64::max);
        assert!(jump < 0.05 * most, "{jump} {most}");
        // The field of view is between those of the keys, linearly.
        let mut wide = keys;
        wide[1].camera.projection = Projection::Perspective { fov_y_deg: 60.0 };
        let cameras = self::path(wide, false).cameras(401).unwrap();
        assert_eq!(cameras[50].projection, Projection::Perspective { fov_y_deg: 50.0 });
    }

    #[test]
    fn circles_keep_their_distance_and_close() {
        let path = path(circle(4), true);
        let cameras = path.cameras(40).unwrap();
        let distance = 10.0_f64.sqrt();
        for camera in &cameras {
            assert!((toward(camera).length() - distance).abs() < 1e-9 && target(camera).length() < 1e-9);
            assert_eq!(camera.up, [0.0, 0.0, 1.0], "the horizon is level");
        }
        let step = |i: usize| eye(&cameras[(i + 1) % 40]).distance(eye(&cameras[i]));
        let (least, most) = (0..40).map(step).fold((f64::MAX, 0.0_f64), |(a, b), d| (a.min(d), b.max(d)));
        assert!(most < 1.2 * least, "{least} {most}");
    }

    #[test]
    fn a_camera_that_looks_around_stays_in_its_place() {
        let keys = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [-3.0, 0.0, 1.0]].map(|target| key([0.0; 3], target, None));
        let path = path(keys.to_vec(), false);
        assert!(path.cameras(30).unwrap().iter().all(|camera| camera.eye == [0.0; 3]));
        assert_eq!((path.keys(), path.seconds()), (3, None));
        assert_eq!(path.cameras(1).unwrap().len(), 1);
    }

    #[test]
    fn keys_that_no_path_leads_through_are_refused() {
        let (a, b) = (key([0.0; 3], [1.0, 0.0, 0.0], None), key([0.0; 3], [-1.0, 0.0, 0.0], None));
        let error = path(vec![a.clone(), b.clone()], false).cameras(3).unwrap_err().to_string();
        assert!(error.contains("keys[0] and keys[1]"), "{error}");
        let mut other = b.clone();
        other.camera.projection = Projection::Orthographic { height: 1.0 };
        let refused = |keys: Vec<PathKey>, size| CameraPath::new(CameraKeys { keys, closed: false }, size).unwrap_err();
        assert!(refused(vec![a.clone(), other], None).contains("projection"));
        let mut other = b;
        other.camera.size = [10, 10];
        assert!(refused(vec![a.clone(), other.clone()], None).contains("--size"));
        assert!(CameraPath::new(CameraKeys { keys: vec![a, other], closed: false }, Some([20, 10])).is_ok());
    }
}
