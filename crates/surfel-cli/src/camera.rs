//! The camera that the flags ask for, and how it turns.

use crate::args::RenderArgs;
use crate::failure::Failure;
use crate::pieces;
use glam::{DQuat, DVec3};
use std::collections::HashSet;
use std::path::Path;
use surfel::framing::{DEFAULT_FOV_Y_DEG, FrameOptions, FrameProjection, ViewAxes};
use surfel::io::cameras::NamedCamera;
use surfel::model::Projection;
use surfel::model::Up;
use surfel::{Camera, Light, Scene};

/// Share of the image that `--view` fills.
const FILL: f64 = 0.9;

/// The projection that `--ortho` and `--fov-y` ask for.
pub(crate) fn projection(args: &RenderArgs) -> FrameProjection {
    if args.ortho {
        FrameProjection::Orthographic
    } else {
        FrameProjection::Perspective(args.fov_y.unwrap_or(DEFAULT_FOV_Y_DEG))
    }
}

/// True if a flag changes the camera, so that its faults are the command line's.
pub(crate) fn is_flagged(args: &RenderArgs) -> bool {
    args.eye.is_some()
        || args.target.is_some()
        || args.camera_up.is_some()
        || args.fov_y.is_some()
        || args.ortho
        || args.size.is_some()
        || args.region.is_some()
        || args.tile.is_some()
}

/// Frames a scene file's camera anew for `--view`, with the file's projection unless flags say another.
pub(crate) fn reframe(camera: &Camera, scene: &Scene, up: Up, args: &RenderArgs) -> Option<Camera> {
    let view = args.view?;
    let size = args.size.unwrap_or(camera.size);
    let projection = match (args.ortho || args.fov_y.is_some(), camera.projection) {
        (true, _) => projection(args),
        (false, Projection::Orthographic { .. }) => FrameProjection::Orthographic,
        (false, Projection::Perspective { fov_y_deg }) => FrameProjection::Perspective(fov_y_deg),
        (false, Projection::Intrinsics { fy, .. }) => FrameProjection::Perspective(fov_of(fy, size[1])),
    };
    let axes = ViewAxes::of_choice(view, &scene.objects, up);
    let turning = args.turntable.then(|| up.vector());
    surfel::framing::frame_camera(scene, &FrameOptions { axes, projection, size, fill: FILL, turning })
}

fn fov_of(focal_px: f64, height_px: u32) -> f64 {
    2.0 * (0.5 * f64::from(height_px) / focal_px).atan().to_degrees()
}

/// What a camera has to be changed by: the flags, and if its near plane is ours to choose.
pub(crate) fn apply_flags(camera: &mut Camera, scene: &Scene, up: Up, own_near: bool, args: &RenderArgs) {
    let before = camera.clone();
    if let Some(size) = args.size {
        camera.size = size;
    }
    if let Some(eye) = args.eye {
        camera.eye = eye;
    }
    if let Some(target) = args.target {
        camera.target = target;
    }
    if let Some(camera_up) = args.camera_up {
        camera.up = camera_up;
    } else if (args.eye.is_some() || args.target.is_some()) && own_near {
        camera.up = upward(camera, up);
    }
    if args.ortho && !matches!(camera.projection, Projection::Orthographic { .. }) {
        let distance = DVec3::from(camera.eye).distance(DVec3::from(camera.target));
        let height = match camera.projection {
            Projection::Perspective { fov_y_deg } => 2.0 * distance * (0.5 * fov_y_deg.to_radians()).tan(),
            Projection::Intrinsics { fy, .. } => distance * f64::from(camera.size[1]) / fy,
            Projection::Orthographic { height } => height,
        };
        camera.projection = Projection::Orthographic { height };
    }
    if let Some(fov_y_deg) = args.fov_y {
        camera.projection = Projection::Perspective { fov_y_deg };
    }
    if *camera != before {
        refit_depth(camera, scene, own_near);
    }
}

/// The scene's up, or where the camera looks along it, the up of the view from above or below.
fn upward(camera: &Camera, up: Up) -> [f64; 3] {
    let forward = (DVec3::from(camera.target) - DVec3::from(camera.eye)).normalize_or_zero();
    let along = up.vector();
    if forward.cross(along).length() > 1e-6 {
        return along.into();
    }
    let view =
        if forward.dot(along) < 0.0 { surfel::framing::NamedView::Top } else { surfel::framing::NamedView::Bottom };
    ViewAxes::named(view, up).up.into()
}

/// Near and far planes about the scene: near only where it is ours to choose, far only where it is needed.
fn refit_depth(camera: &mut Camera, scene: &Scene, own_near: bool) {
    let forward = ViewAxes::of(camera).forward;
    let Some((first, last)) = surfel::framing::depth_range(scene, camera.eye.into(), forward) else { return };
    let size = (last - first).max(1e-6);
    if own_near {
        camera.near = if first > 0.0 { 0.5 * first } else { 1e-3 * size };
    }
    let orthographic = matches!(camera.projection, Projection::Orthographic { .. });
    if orthographic && (camera.far.is_none() || own_near) {
        camera.far = Some((last + 0.01 * size).max(2.0 * camera.near));
    }
    if !orthographic && own_near {
        camera.far = None;
    }
}

/// Reads `--cameras`, for images of `--size`: names and cameras.
pub(crate) fn named(path: &Path, size: Option<[u32; 2]>) -> Result<Vec<(String, Camera)>, Failure> {
    let of = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    let cameras = surfel::io::cameras::read(path)?;
    let mut names = HashSet::new();
    for camera in &cameras {
        if !names.insert(&camera.name) {
            return Err(of(format!("two cameras have images called {}\n  expected: different names", camera.name)));
        }
    }
    let used = |named: NamedCamera| {
        let camera = named.camera(size).map_err(|problem| of(problem.to_string()))?;
        camera.validate().map_err(|e| of(format!("camera {}: {e}", named.name)))?;
        Ok((named.name, camera))
    };
    cameras.into_iter().map(used).collect()
}

/// A camera of another program, which knows no near plane, with one before the scene.
pub(crate) fn with_near(mut camera: Camera, scene: &Scene) -> Camera {
    refit_depth(&mut camera, scene, true);
    camera
}

/// How the camera and its lights go about the scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turntable {
    pub(crate) center: DVec3,
    pub(crate) axis: DVec3,
}

impl Turntable {
    /// The camera and lights after `turn` of a revolution: the scene turns before them, so they go the other way.
    pub(crate) fn at(&self, turn: f64, camera: &Camera, lights: &[Light]) -> (Camera, Vec<Light>) {
        let rotation = DQuat::from_axis_angle(self.axis, -std::f64::consts::TAU * turn);
        let direction = |v: [f64; 3]| -> [f64; 3] { (rotation * DVec3::from(v)).into() };
        let point = |p: [f64; 3]| -> [f64; 3] { (self.center + rotation * (DVec3::from(p) - self.center)).into() };
        let mut camera = camera.clone();
        (camera.eye, camera.target, camera.up) = (point(camera.eye), point(camera.target), direction(camera.up));
        let mut lights = lights.to_vec();
        for light in &mut lights {
            match light {
                Light::Directional { direction: d, .. } => *d = direction(*d),
                Light::Point { position, .. } => *position = point(*position),
                Light::Spot { position, direction: d, .. } => (*position, *d) = (point(*position), direction(*d)),
                _ => {}
            }
        }
        (camera, lights)
    }
}

/// Checks that the camera can be used; its faults are the command line's where flags made it.
pub(crate) fn view(camera: &Camera, args: &RenderArgs) -> Result<surfel::View, Failure> {
    surfel::View::of_region(camera, pieces::region(args, camera)?)
        .map_err(|e| if is_flagged(args) { Failure::usage(e.to_string()) } else { Failure::input(e.to_string()) })
}
