//! Reader of cameras in JSON: nerfstudio and instant-ngp, 3DGS, Open3D, and OpenCV's K, R, t.

use super::{Lens, MAX_CAMERAS, NamedCamera, Pose, distorted, lens, rotation};
use crate::error::{Fault, Problem};
use crate::scene_file::json_problem;
use glam::{DMat3, DMat4, DVec3};
use serde_json::{Map, Value};

/// One half. As half a pixel, it is added to the principal points of OpenCV, Open3D and KITTI, which measure from the
/// first pixel's centre; see the module [`cameras`](super). As a factor, it yields the centre of an image.
const HALF: f64 = 0.5;

pub(super) fn parse(bytes: &[u8]) -> Result<Vec<NamedCamera>, Fault> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let value: Value = serde_json::from_slice(text).map_err(|e| json_problem(&e))?;
    let wrong = || {
        Problem::new("holds no cameras that are known")
            .expected("transforms.json of nerfstudio, cameras.json of 3DGS, Open3D's PinholeCamera…, or K, R and t")
    };
    let list = match &value {
        Value::Array(list) => list.iter().collect(),
        Value::Object(map) => match ["frames", "cameras", "parameters"].iter().find_map(|key| map.get(*key)) {
            Some(Value::Array(list)) => list.iter().collect(),
            Some(_) => return Err(wrong().into()),
            None => vec![&value],
        },
        _ => return Err(wrong().into()),
    };
    if list.len() > MAX_CAMERAS {
        return Err(Problem::new(format!("has {} cameras", list.len())).expected(format!("{MAX_CAMERAS}")).into());
    }
    let none = Map::new();
    let shared = value.as_object().unwrap_or(&none);
    let cameras = list.into_iter().enumerate().map(|(i, own)| {
        let keys = Keys { own: own.as_object().unwrap_or(&none), shared };
        let camera = if keys.get(&["transform_matrix"]).is_some() {
            of_transforms(&keys)
        } else if keys.get(&["extrinsic"]).is_some() {
            of_open3d(&keys)
        } else if keys.get(&["position"]).is_some() {
            of_3dgs(&keys)
        } else if keys.get(K).is_some() {
            of_opencv(&keys)
        } else {
            return Err(wrong());
        };
        camera.map(|camera| keys.named(camera, i)).map_err(|p| Problem { what: format!("camera {i} {}", p.what), ..p })
    });
    Ok(cameras.collect::<Result<_, _>>()?)
}

/// Names under which files store OpenCV's matrix K, with focal lengths and principal point.
const K: &[&str] = &["K", "k", "camera_matrix", "intrinsic_matrix"];

/// The JSON values of a camera, and the values of the file that apply to all of its cameras.
struct Keys<'a> {
    own: &'a Map<String, Value>,
    shared: &'a Map<String, Value>,
}

impl Keys<'_> {
    /// Returns the value of the first existing key among `keys`; the camera's values have priority over the file's.
    /// Returns `None` if no key exists, or if the value is null.
    fn get(&self, keys: &[&str]) -> Option<&Value> {
        let of = |map: &'_ Map<String, Value>, key: &str| map.contains_key(key);
        let own = keys.iter().find(|key| of(self.own, key)).and_then(|key| self.own.get(*key));
        own.or_else(|| keys.iter().find_map(|key| self.shared.get(*key))).filter(|value| !value.is_null())
    }

    fn number(&self, key: &str) -> Result<Option<f64>, Problem> {
        let Some(value) = self.get(&[key]) else { return Ok(None) };
        match value.as_f64().filter(|number| number.is_finite()) {
            Some(number) => Ok(Some(number)),
            None => Err(Problem::new(format!("has a {key} that is no number"))),
        }
    }

    /// Returns the `N` numbers of the first existing key among `keys`, or `None` if no key exists or its value is null.
    /// Numbers in nested arrays, such as a matrix, are returned row by row. Any other count, or a number that is not
    /// finite, is an error.
    fn numbers<const N: usize>(&self, keys: &[&str]) -> Result<Option<[f64; N]>, Problem> {
        let Some(value) = self.get(keys) else { return Ok(None) };
        let mut flat = Vec::new();
        flatten(value, N + 1, &mut flat);
        match <[f64; N]>::try_from(flat) {
            Ok(numbers) if numbers.iter().all(|n| n.is_finite()) => Ok(Some(numbers)),
            _ => Err(Problem::new(format!("has a {} of other values", keys[0])).expected(format!("{N} numbers"))),
        }
    }

    fn needed<const N: usize>(&self, keys: &[&str]) -> Result<[f64; N], Problem> {
        self.numbers(keys)?.ok_or_else(|| Problem::new(format!("has no {}", keys[0])).expected(format!("{N} numbers")))
    }

    /// Returns the image's size in pixels, from one key for both or from keys for width and height. Returns `None`
    /// unless both are stated.
    fn size(&self) -> Result<Option<[u32; 2]>, Problem> {
        let sides = match self.numbers::<2>(&["size", "image_size", "resolution"])? {
            Some(size) => Some(size),
            None => {
                let side = |a, b| Ok(self.number(a)?.or(self.number(b)?));
                side("w", "width")?.zip(side("h", "height")?).map(|(w, h)| [w, h])
            }
        };
        let Some(sides) = sides else { return Ok(None) };
        if !sides.iter().all(|side| side.fract() == 0.0 && *side >= 1.0 && *side <= f64::from(u32::MAX)) {
            return Err(Problem::new(format!("has images of {}x{}", sides[0], sides[1])).expected("whole numbers"));
        }
        Ok(Some(sides.map(|side| side as u32)))
    }

    /// Returns an error if the camera has lens distortion, which isn't supported: coefficients other than 0, or a
    /// camera model other than pinhole, radial or OpenCV.
    fn no_distortion(&self) -> Result<(), Problem> {
        let model = self.get(&["camera_model"]).and_then(Value::as_str).unwrap_or("PINHOLE");
        if !matches!(model, "PINHOLE" | "SIMPLE_PINHOLE" | "OPENCV" | "SIMPLE_RADIAL" | "RADIAL" | "FULL_OPENCV") {
            return Err(distorted(format!("is a {model}")));
        }
        for key in ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"] {
            if let Some(k) = self.number(key)?.filter(|k| *k != 0.0) {
                return Err(distorted(format!("has the distortion {key} = {k}")));
            }
        }
        for key in ["dist", "distortion", "dist_coeffs", "distortion_coefficients", "D", "distortion_params"] {
            let mut all = Vec::new();
            self.get(&[key]).into_iter().for_each(|value| flatten(value, 64, &mut all));
            if all.iter().any(|k| *k != 0.0) {
                return Err(distorted(format!("has the {key} {all:?}")));
            }
        }
        Ok(())
    }

    /// Names the camera after its image, or after its index.
    fn named(&self, mut camera: NamedCamera, number: usize) -> NamedCamera {
        let name = self.get(&["file_path", "img_name", "name", "image", "file"]).and_then(Value::as_str);
        camera.name = name.map_or_else(|| format!("{number:04}"), str::to_owned);
        camera
    }
}

/// Appends the numbers of nested arrays to `all`, row by row, until it has `limit` numbers. An object counts as its
/// array `data`, as OpenCV writes matrices. Values that are not numbers become NaN.
fn flatten(value: &Value, limit: usize, all: &mut Vec<f64>) {
    if all.len() >= limit {
        return;
    }
    match value {
        Value::Array(list) => list.iter().for_each(|value| flatten(value, limit, all)),
        Value::Object(map) => map.get("data").into_iter().for_each(|value| flatten(value, limit, all)),
        value => all.push(value.as_f64().unwrap_or(f64::NAN)),
    }
}

/// Parses a nerfstudio or instant-ngp camera: a world-from-camera matrix, whose camera axes are x right, y up and z
/// backward.
fn of_transforms(keys: &Keys<'_>) -> Result<NamedCamera, Problem> {
    keys.no_distortion()?;
    let m = DMat4::from_cols_array(&keys.needed::<16>(&["transform_matrix"])?).transpose();
    let axes = DMat3::from_mat4(m);
    let axes = rotation(DMat3::from_cols(axes.x_axis, -axes.y_axis, -axes.z_axis))?;
    let size = keys.size()?;
    let angle = |key: &str| -> Result<Option<f64>, Problem> {
        let found = keys.number(key)?;
        match found.filter(|a| !(*a > 0.0 && *a < std::f64::consts::PI)) {
            Some(a) => Err(Problem::new(format!("has the {key} {a}")).expected("radians between 0 and π")),
            None => Ok(found),
        }
    };
    let from_angle = |angle: Option<f64>, side: usize| {
        angle.zip(size).map(|(angle, size)| 0.5 * f64::from(size[side]) / (0.5 * angle).tan())
    };
    let (x, y) = (angle("camera_angle_x")?, angle("camera_angle_y")?);
    let fx = keys.number("fl_x")?.or(from_angle(x, 0));
    let fy = keys.number("fl_y")?.or(from_angle(y, 1)).or(fx);
    let center = size.map(|size| size.map(|side| HALF * f64::from(side)));
    let cx = keys.number("cx")?.or(center.map(|c| c[0]));
    let cy = keys.number("cy")?.or(center.map(|c| c[1]));
    let lens = match (fx, fy, cx, cy) {
        (Some(fx), Some(fy), Some(cx), Some(cy)) => lens([fx, fy], [cx, cy])?,
        _ => match x {
            Some(x_rad) => Lens::FieldOfView { x_rad },
            None => return Err(Problem::new("has no focal length").expected("fl_x or camera_angle_x")),
        },
    };
    Ok(NamedCamera { name: String::new(), size, eye: m.w_axis.truncate(), axes, lens })
}

/// Parses a 3DGS camera: position and world-from-camera rotation, with a centred principal point.
fn of_3dgs(keys: &Keys<'_>) -> Result<NamedCamera, Problem> {
    let eye = DVec3::from(keys.needed::<3>(&["position"])?);
    let axes = rotation(DMat3::from_cols_array(&keys.needed::<9>(&["rotation"])?).transpose())?;
    let size = keys.size()?.ok_or_else(|| Problem::new("has no size").expected("width and height"))?;
    let focal = [keys.needed::<1>(&["fx"])?[0], keys.needed::<1>(&["fy"])?[0]];
    let lens = lens(focal, size.map(|side| HALF * f64::from(side)))?;
    Ok(NamedCamera { name: String::new(), size: Some(size), eye, axes, lens })
}

/// Parses an Open3D camera: column-major matrices, pixel coordinates from the first pixel's centre.
fn of_open3d(keys: &Keys<'_>) -> Result<NamedCamera, Problem> {
    let view_from_world = DMat4::from_cols_array(&keys.needed::<16>(&["extrinsic"])?);
    let none = Map::new();
    let own = keys.get(&["intrinsic"]).and_then(Value::as_object).unwrap_or(&none);
    let inner = Keys { own, shared: &none };
    let k = DMat3::from_cols_array(&inner.needed::<9>(&["intrinsic_matrix"])?);
    calibrated(k, DMat3::from_mat4(view_from_world), view_from_world.w_axis.truncate(), inner.size()?)
}

/// Parses an OpenCV camera: x = K(RX + t), R as a matrix or as a rotation vector, pixel coordinates from the first
/// pixel's centre.
fn of_opencv(keys: &Keys<'_>) -> Result<NamedCamera, Problem> {
    keys.no_distortion()?;
    let k = DMat3::from_cols_array(&keys.needed::<9>(K)?).transpose();
    let rotation = match keys.numbers::<3>(&["rvec"])? {
        Some(vector) => {
            let vector = DVec3::from(vector);
            let angle = vector.length();
            if angle > 0.0 { DMat3::from_axis_angle(vector / angle, angle) } else { DMat3::IDENTITY }
        }
        None => DMat3::from_cols_array(&keys.needed::<9>(&["R", "rotation", "rotation_matrix"])?).transpose(),
    };
    let translation = DVec3::from(keys.needed::<3>(&["t", "T", "translation", "tvec"])?);
    calibrated(k, rotation, translation, keys.size()?)
}

/// Returns a camera from its matrix K, and its view-from-world rotation and translation. Pixel coordinates in K start
/// at the first pixel's centre.
pub(super) fn calibrated(
    k: DMat3,
    view_from_world: DMat3,
    translation: DVec3,
    size: Option<[u32; 2]>,
) -> Result<NamedCamera, Problem> {
    let [[fx, below, last], [skew, fy, last_y], [cx, cy, one]] = k.to_cols_array_2d();
    let expected = "fx 0 cx, 0 fy cy, 0 0 1";
    if [below, last, last_y] != [0.0; 3] || one != 1.0 || skew.abs() > 1e-6 * fx.abs() {
        return Err(Problem::new(format!("has the matrix K {:?}", k.transpose().to_cols_array())).expected(expected));
    }
    let lens = lens([fx, fy], [cx + HALF, cy + HALF])?;
    let (eye, axes) = Pose { view_from_world, translation }.in_world()?;
    Ok(NamedCamera { name: String::new(), size, eye, axes, lens })
}
