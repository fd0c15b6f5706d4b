//! Cameras of other programs: COLMAP, nerfstudio and instant-ngp, 3DGS, Open3D, KITTI, and K, R, t as JSON.
//!
//! All readers return one convention (rendering model §1). Pixel coordinates start at the image's upper left corner, so
//! the first pixel's centre is (0.5, 0.5). COLMAP, nerfstudio, instant-ngp and 3DGS use this convention. OpenCV, Open3D
//! and KITTI start at the first pixel's centre, so that half a pixel is added to their principal points. No reader
//! undistorts: a camera with distortion is refused with a command that undistorts.

mod colmap;
mod json;
mod kitti;

use crate::error::{Fault, IoError, Problem};
use crate::files;
use glam::{DMat3, DVec3};
use std::path::{Component, Path, PathBuf};
use surfel_model::Camera;

/// Largest size, in bytes, of a camera file that is read. COLMAP's `images.bin` is large, because it includes the
/// points of each image.
const MAX_BYTES: u64 = 4 << 30;
/// Maximum number of cameras that are read from a file or folder; more are an error.
const MAX_CAMERAS: usize = 10_000_000;
/// Largest error of an element of a rotation matrix times its transpose, relative to the identity, that is accepted as
/// rounding. Some files have only three decimals.
const ROUNDING: f64 = 2e-3;
/// Distance of the near plane from the eye, in world units. The formats state none.
const NEAR: f64 = 0.01;

/// A camera from a file of another program, with the name of its image.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedCamera {
    /// Name of the camera's image, without the extension of an image format. Leading folders that all images share are
    /// left out; other folders precede the name, joined by `_`. A camera without an image name has its index, from
    /// `0000`.
    pub name: String,
    /// Width and height of the camera's image in pixels, if the file states them.
    pub size: Option<[u32; 2]>,
    eye: DVec3,
    /// Camera axes in world space, as columns: right, down, forward.
    axes: DMat3,
    lens: Lens,
}

/// Projection of a camera, as its file states it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Lens {
    /// Focal lengths, and principal point from the upper left corner, both in pixels of the stated image size. If the
    /// file states no size, they are in pixels of any requested size.
    Pixels { focal: [f64; 2], principal: [f64; 2] },
    /// Horizontal field of view in radians. Pixels are square, and the principal point is the image's centre.
    FieldOfView { x_rad: f64 },
}

impl NamedCamera {
    /// Returns the camera for images of a size (width and height in pixels), by default the stated one. Focal lengths
    /// and principal point scale with the image if the file states its size. The near plane is 0.01 world units.
    ///
    /// # Errors
    /// [`Problem`] if neither the file nor the caller states a size.
    pub fn camera(&self, size: Option<[u32; 2]>) -> Result<Camera, Problem> {
        let Some([width, height]) = size.or(self.size) else {
            let problem = Problem::new(format!("camera {} has no image size", self.name));
            return Err(problem.expected("a file with width and height").help("give the images' size: `size=WxH`"));
        };
        let (focal, principal) = match self.lens {
            Lens::Pixels { focal, principal } => {
                let own = self.size.unwrap_or([width, height]).map(f64::from);
                let scale = [f64::from(width) / own[0], f64::from(height) / own[1]];
                ([focal[0] * scale[0], focal[1] * scale[1]], [principal[0] * scale[0], principal[1] * scale[1]])
            }
            Lens::FieldOfView { x_rad } => {
                let focal = 0.5 * f64::from(width) / (0.5 * x_rad).tan();
                ([focal; 2], [0.5 * f64::from(width), 0.5 * f64::from(height)])
            }
        };
        let target = self.eye + self.axes.z_axis * reach(self.eye);
        let camera = Camera::intrinsics(self.eye.into(), target.into(), focal, principal, [width, height]);
        Ok(camera.with_up((-self.axes.y_axis).into()).with_near(NEAR))
    }
}

/// Returns the distance from the eye at which a camera's target is placed, in world units. The distance is the largest
/// absolute coordinate of the eye, but at least 1, so that rounding of the target changes the direction by about 10⁻¹⁵
/// only.
fn reach(eye: DVec3) -> f64 {
    eye.abs().max_element().max(1.0)
}

/// Reads the cameras of a file, or of a folder of COLMAP, nerfstudio, 3DGS or KITTI. The files may also be in the
/// subfolders `sparse` and `sparse/0`.
///
/// | format | files |
/// | --- | --- |
/// | COLMAP | `cameras` and `images`, both .bin or both .txt |
/// | nerfstudio, instant-ngp | `transforms.json` |
/// | 3DGS | `cameras.json` |
/// | Open3D | a `PinholeCameraParameters` or `PinholeCameraTrajectory` as JSON |
/// | OpenCV | JSON of `K`, `R` and `t` (x = K(RX + t)), with `width` and `height` or `size`, or a list of them |
/// | KITTI | `calib.txt` and its relatives, `calib_cam_to_cam.txt` with `calib_velo_to_cam.txt` |
///
/// KITTI's world is that of the laser scanner if its calibration is available, else that of the first rectified camera.
///
/// # Errors
/// [`IoError::System`] for missing files. [`IoError::Invalid`] for unsupported content, if there is no camera, for
/// cameras with distortion or skew, and for poses that aren't rotations.
pub fn read(path: &Path) -> Result<Vec<NamedCamera>, IoError> {
    let (path, kind) = find(path)?;
    let bytes = files::read(&path, MAX_BYTES)?;
    let beside = |name: &str| {
        let other = path.with_file_name(name);
        files::read(&other, MAX_BYTES).map(|bytes| (other, bytes))
    };
    let mut cameras = match kind {
        Kind::ColmapBinary | Kind::ColmapText => {
            let is_binary = kind == Kind::ColmapBinary;
            let (other, images) = beside(if is_binary { "images.bin" } else { "images.txt" })?;
            let lenses = if is_binary { colmap::cameras_bin(&bytes) } else { colmap::cameras_txt(&bytes) };
            let lenses = lenses.map_err(|fault| fault.of(&path))?;
            let images =
                if is_binary { colmap::images_bin(&images, &lenses) } else { colmap::images_txt(&images, &lenses) };
            images.map_err(|fault| fault.of(&other))
        }
        Kind::Json => json::parse(&bytes).map_err(|fault| fault.of(&path)),
        Kind::Kitti => kitti::parse(&bytes, || beside("calib_velo_to_cam.txt").ok().map(|(_, bytes)| bytes))
            .map_err(|fault| fault.of(&path)),
    }?;
    if cameras.is_empty() {
        return Err(Fault::from(Problem::new("holds no camera").expected("one at least")).of(&path));
    }
    name_all(&mut cameras);
    Ok(cameras)
}

/// Reads cameras from the contents of a JSON file that [`read`] supports; `name` is for messages. Returns no cameras if
/// the file lists none.
///
/// # Errors
/// [`IoError::Invalid`], as [`read`], except that a file without cameras is no error.
pub fn read_json(bytes: &[u8], name: &Path) -> Result<Vec<NamedCamera>, IoError> {
    let mut cameras = json::parse(bytes).map_err(|fault| fault.of(name))?;
    name_all(&mut cameras);
    Ok(cameras)
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    ColmapBinary,
    ColmapText,
    Json,
    Kitti,
}

/// Returns the path and the format of the file to read first. `path` is a file or a folder. A file counts as KITTI's if
/// its name is neither one of COLMAP's nor ends in `.json`.
fn find(path: &Path) -> Result<(PathBuf, Kind), IoError> {
    if !path.is_dir() {
        let name = path.file_name().map(|name| name.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        return Ok(match name.as_str() {
            "cameras.bin" | "images.bin" => (path.with_file_name("cameras.bin"), Kind::ColmapBinary),
            "cameras.txt" | "images.txt" => (path.with_file_name("cameras.txt"), Kind::ColmapText),
            name if name.ends_with(".json") => (path.to_path_buf(), Kind::Json),
            _ => (path.to_path_buf(), Kind::Kitti),
        });
    }
    let names = [
        ("cameras.bin", Kind::ColmapBinary),
        ("cameras.txt", Kind::ColmapText),
        ("transforms.json", Kind::Json),
        ("cameras.json", Kind::Json),
        ("calib_cam_to_cam.txt", Kind::Kitti),
        ("calib.txt", Kind::Kitti),
    ];
    for folder in ["", "sparse", "sparse/0"] {
        for (name, kind) in names {
            let file = path.join(folder).join(name);
            if file.is_file() {
                return Ok((file, kind));
            }
        }
    }
    let problem = Problem::new("is a folder without cameras")
        .expected("cameras.bin or .txt of COLMAP (in sparse/0, too), transforms.json, cameras.json or calib.txt");
    Err(Fault::from(problem).of(path))
}

/// Converts the cameras' names from paths of images to names as [`NamedCamera::name`] describes: without common folders
/// and without extension.
fn name_all(cameras: &mut [NamedCamera]) {
    let parts = |name: &str| -> Vec<String> {
        let name = name.replace('\\', "/");
        let normal = Path::new(&name).components().filter_map(|part| match part {
            Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
            _ => None,
        });
        normal.collect()
    };
    let mut all: Vec<Vec<String>> = cameras.iter().map(|camera| parts(&camera.name)).collect();
    let folders = all.iter().map(|parts| parts.len().saturating_sub(1)).min().unwrap_or(0);
    let shared = (0..folders).take_while(|i| all.iter().all(|parts| parts[*i] == all[0][*i])).count();
    for (number, (camera, parts)) in cameras.iter_mut().zip(&mut all).enumerate() {
        if let Some(last) = parts.last_mut()
            && let Some((stem, extension)) = last.rsplit_once('.')
            && !stem.is_empty()
            && EXTENSIONS.contains(&extension.to_ascii_lowercase().as_str())
        {
            *last = stem.to_owned();
        }
        camera.name = parts.get(shared..).unwrap_or_default().join("_");
        if camera.name.is_empty() {
            camera.name = format!("{number:04}");
        }
    }
}

/// Extensions of image files, which are removed from a camera's name.
const EXTENSIONS: [&str; 12] = ["png", "jpg", "jpeg", "tif", "tiff", "exr", "webp", "bmp", "ppm", "pgm", "heic", "dng"];

/// Position and rotation of a camera whose axes are OpenCV's: x right, y down, z forward.
struct Pose {
    /// World-to-camera rotation; the field `translation` is applied after it.
    view_from_world: DMat3,
    translation: DVec3,
}

impl Pose {
    /// Returns the eye in world space, and a matrix whose columns are the camera's axes right, down and forward in
    /// world space.
    fn in_world(&self) -> Result<(DVec3, DMat3), Problem> {
        let axes = rotation(self.view_from_world.transpose())?;
        let eye = -(axes * self.translation);
        if !eye.is_finite() {
            return Err(Problem::new("has a position that is not finite").expected("finite numbers"));
        }
        Ok((eye, axes))
    }
}

/// Orthonormalises a rotation matrix whose digits were rounded. Returns an error for matrices that mirror, or that
/// differ from a rotation by more than [`ROUNDING`].
fn rotation(m: DMat3) -> Result<DMat3, Problem> {
    let wrong = |what: &str| Problem::new(format!("has {what}")).expected("a rotation");
    let error = (m * m.transpose() - DMat3::IDENTITY).to_cols_array().map(f64::abs);
    if !error.into_iter().all(|e| e <= ROUNDING) {
        return Err(wrong("a pose that stretches or shears"));
    }
    if m.determinant() < 0.0 {
        return Err(wrong("a pose that mirrors"));
    }
    let forward = m.z_axis.normalize();
    let right = m.y_axis.cross(forward).normalize();
    Ok(DMat3::from_cols(right, forward.cross(right), forward))
}

/// Returns a lens with focal lengths and principal point in pixels, the latter from the upper left corner. Returns an
/// error unless all numbers are finite and the focal lengths positive.
fn lens(focal: [f64; 2], principal: [f64; 2]) -> Result<Lens, Problem> {
    if !focal.iter().all(|f| *f > 0.0 && f.is_finite()) || !principal.iter().all(|c| c.is_finite()) {
        let problem = Problem::new(format!("has the focal lengths {focal:?} and the principal point {principal:?}"));
        return Err(problem.expected("finite numbers, focal lengths above 0"));
    }
    Ok(Lens::Pixels { focal, principal })
}

/// Returns the problem of a camera with distortion, with a command that undistorts. `what` describes the camera.
fn distorted(what: String) -> Problem {
    Problem::new(what).expected("a pinhole camera").help(
        "undistort the images first: colmap image_undistorter --image_path IMAGES --input_path SPARSE --output_path \
         OUT, then `cameras=OUT`",
    )
}

#[cfg(test)]
mod tests;
