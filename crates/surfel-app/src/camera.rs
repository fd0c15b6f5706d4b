//! The camera that options define, and its rotation in a turntable movie.

use crate::render_options::{CameraSource, RenderOptions};
use glam::{DQuat, DVec3};
use std::collections::HashSet;
use std::path::Path;
use surfel_framing::strays::Sphere;
use surfel_framing::{DEFAULT_FOV_Y_DEG, FrameOptions, FrameProjection, ViewAxes};
use surfel_io::cameras::NamedCamera;
use surfel_load::Error;
use surfel_model::{Camera, Light, Projection, Scene, Up};
use surfel_render::View;

/// Fraction of the image's width or height that the framed scene fills.
const FILL: f64 = 0.9;

/// Returns the projection that `--ortho` and `--fov-y` define.
pub(crate) fn projection(options: &RenderOptions) -> FrameProjection {
    if options.ortho {
        FrameProjection::Orthographic
    } else {
        FrameProjection::Perspective(options.fov_y.unwrap_or(DEFAULT_FOV_Y_DEG))
    }
}

/// True if an option other than `--camera` and `--view` changes the camera or the region of its image. An error of the
/// camera is then reported as a usage error.
pub(crate) fn is_flagged(options: &RenderOptions) -> bool {
    options.eye.is_some()
        || options.target.is_some()
        || options.camera_up.is_some()
        || options.fov_y.is_some()
        || options.ortho
        || options.size.is_some()
        || options.region.is_some()
        || options.tile.is_some()
}

/// Returns a camera that frames the scene from the direction of `--view`; `None` without this option, and for a scene
/// that can't be framed. The camera frames the part of the scene inside the world-space sphere `kept`, or all of it if
/// `kept` is `None`. The projection is that of `camera`, unless the options state another.
pub(crate) fn reframe(
    camera: &Camera,
    scene: &Scene,
    kept: Option<Sphere>,
    up: Up,
    options: &RenderOptions,
) -> Option<Camera> {
    let view = options.view?;
    let size = options.size.unwrap_or(camera.size);
    let projection = match (options.ortho || options.fov_y.is_some(), camera.projection) {
        (true, _) => projection(options),
        (false, Projection::Orthographic { .. }) => FrameProjection::Orthographic,
        (false, Projection::Perspective { fov_y_deg }) => FrameProjection::Perspective(fov_y_deg),
        (false, Projection::Intrinsics { fy, .. }) => FrameProjection::Perspective(fov_of(fy, size[1])),
    };
    let axes = ViewAxes::of_choice(view, &scene.objects, up);
    let turning = options.turntable.then(|| up.vector());
    surfel_framing::frame_within(scene, kept, &FrameOptions { axes, projection, size, fill: FILL, turning })
}

fn fov_of(focal_px: f64, height_px: u32) -> f64 {
    2.0 * (0.5 * f64::from(height_px) / focal_px).atan().to_degrees()
}

/// Returns the camera for an image of another size. The intrinsics of a calibrated camera are scaled with the image
/// along x and y; other projections retain their vertical extent.
pub(crate) fn resized(camera: &Camera, size: [u32; 2]) -> Camera {
    let [x, y] = [0, 1].map(|k| f64::from(size[k]) / f64::from(camera.size[k]));
    let projection = match camera.projection {
        Projection::Intrinsics { fx, fy, cx, cy } => {
            Projection::Intrinsics { fx: fx * x, fy: fy * y, cx: cx * x, cy: cy * y }
        }
        other => other,
    };
    Camera { size, projection, ..camera.clone() }
}

/// Applies the options for eye, target, up direction, projection and size to a camera. `own_near` is true if neither
/// options nor files state a near plane. In this case, a camera that the options change gets near and far planes that
/// are fitted to the scene ([`refit_depth`]). A new eye or target without an option for the up direction then also sets
/// this direction to the scene's up axis. A camera source with `fits_depth` is always fitted.
pub(crate) fn apply_flags(camera: &mut Camera, scene: &Scene, up: Up, own_near: bool, options: &RenderOptions) {
    let before = camera.clone();
    if let Some(size) = options.size {
        camera.size = size;
    }
    if let Some(eye) = options.eye {
        camera.eye = eye;
    }
    if let Some(target) = options.target {
        camera.target = target;
    }
    if let Some(camera_up) = options.camera_up {
        camera.up = camera_up;
    } else if (options.eye.is_some() || options.target.is_some()) && own_near {
        camera.up = upward(camera, up);
    }
    if options.ortho && !matches!(camera.projection, Projection::Orthographic { .. }) {
        let distance = DVec3::from(camera.eye).distance(DVec3::from(camera.target));
        let height = match camera.projection {
            Projection::Perspective { fov_y_deg } => 2.0 * distance * (0.5 * fov_y_deg.to_radians()).tan(),
            Projection::Intrinsics { fy, .. } => distance * f64::from(camera.size[1]) / fy,
            Projection::Orthographic { height } => height,
        };
        camera.projection = Projection::Orthographic { height };
    }
    if let (Some(given), Projection::Orthographic { height }) = (options.ortho_height, &mut camera.projection) {
        *height = given;
    }
    if let Some(fov_y_deg) = options.fov_y {
        camera.projection = Projection::Perspective { fov_y_deg };
    }
    let fits_depth = options.camera.as_ref().is_some_and(CameraSource::fits_depth);
    if *camera != before || fits_depth {
        refit_depth(camera, scene, own_near || fits_depth);
    }
}

/// Returns the direction that appears upward in a new view: the scene's up axis. If the camera looks along the up axis,
/// returns the up direction of the top or bottom view instead.
fn upward(camera: &Camera, up: Up) -> [f64; 3] {
    let forward = (DVec3::from(camera.target) - DVec3::from(camera.eye)).normalize_or_zero();
    let along = up.vector();
    if forward.cross(along).length() > 1e-6 {
        return along.into();
    }
    let view =
        if forward.dot(along) < 0.0 { surfel_framing::NamedView::Top } else { surfel_framing::NamedView::Bottom };
    ViewAxes::named(view, up).up.into()
}

/// Fits the near and far planes of a camera to the scene. Planes change only if `own_near` is true (no option or file
/// states the near plane). However, an orthographic camera without a far plane always gets one. A perspective camera
/// then loses its far plane. Nothing changes for an empty scene.
fn refit_depth(camera: &mut Camera, scene: &Scene, own_near: bool) {
    let forward = ViewAxes::of(camera).forward;
    let Some((first, last)) = surfel_framing::depth_range(scene, camera.eye.into(), forward) else { return };
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

/// Reads another program's cameras, with their names. `size` is the width and height of the images in pixels; `None`
/// uses the size in the file.
///
/// # Errors
/// [`Error::Io`] for a file that can't be read or has unsupported content, such as lens distortion.
/// [`Error::Unsuitable`] for equal names, cameras out of range, and a missing image size.
pub fn named(path: &Path, size: Option<[u32; 2]>) -> Result<Vec<(String, Camera)>, Error> {
    let cameras = surfel_io::cameras::read(path)?;
    with_names(cameras, path, size)
}

/// Reads cameras like [`named`], from JSON text.
///
/// # Errors
/// Errors of [`named`].
pub fn named_in_json(json: &[u8], name: &Path, size: Option<[u32; 2]>) -> Result<Vec<(String, Camera)>, Error> {
    with_names(surfel_io::cameras::read_json(json, name)?, name, size)
}

fn with_names(cameras: Vec<NamedCamera>, path: &Path, size: Option<[u32; 2]>) -> Result<Vec<(String, Camera)>, Error> {
    let of = |problem: String| Error::Unsuitable { path: path.to_path_buf(), problem };
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

/// Fits the near plane of another program's camera, which has none, to the scene. The near plane is halfway to the
/// scene, or close to the eye if the scene extends behind the eye.
pub fn with_near(mut camera: Camera, scene: &Scene) -> Camera {
    refit_depth(&mut camera, scene, true);
    camera
}

/// Axis around which the camera and its lights turn in a turntable movie.
#[derive(Clone, Copy, Debug)]
pub struct Turntable {
    /// A point on the axis, in world space.
    pub center: DVec3,
    /// Direction of the axis, a unit vector.
    pub axis: DVec3,
}

impl Turntable {
    /// Returns camera and lights after a fraction `turn` (0 to 1) of a revolution. Camera and lights turn backwards, so
    /// that the scene appears to turn forwards.
    pub fn at(&self, turn: f64, camera: &Camera, lights: &[Light]) -> (Camera, Vec<Light>) {
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

/// Creates the view of a camera, or of the region of its image that the options state. Validates the camera.
///
/// # Errors
/// [`Error::Usage`] if options changed the camera, otherwise [`Error::Model`].
pub fn view(camera: &Camera, options: &RenderOptions) -> Result<View, Error> {
    View::of_region(camera, options.region_of(camera)?)
        .map_err(|e| if is_flagged(options) { Error::Usage(e.to_string()) } else { e.into() })
}
