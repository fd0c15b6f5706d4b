//! Reader of COLMAP's `cameras` and `images` files, binary and text.

use super::{Lens, MAX_CAMERAS, NamedCamera, Pose, distorted, lens};
use crate::error::{Fault, Location, Problem};
use glam::{DMat3, DQuat, DVec3};
use std::collections::BTreeMap;

/// Image size and lens of a COLMAP camera, which several images may share.
pub(super) struct Intrinsics {
    size: [u32; 2],
    lens: Lens,
}

/// COLMAP's cameras by id, to which the images refer. A camera that can't be used is stored as its problem, which is
/// reported only if an image uses the camera.
pub(super) type Lenses = BTreeMap<u32, Result<Intrinsics, Problem>>;

/// COLMAP's camera models in the order of their ids: name and number of parameters. Binary files state only the id.
const MODELS: [(&str, usize); 12] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

/// Returns size and lens of a camera with COLMAP's camera model `model`. Its parameters `p` are one or two focal
/// lengths, the principal point (x, y), then distortion. Distortion must be zero. Models other than pinhole, radial and
/// OpenCV, such as fisheye models, are refused.
fn intrinsics(id: u32, model: &str, size: [u64; 2], p: &[f64]) -> Result<Intrinsics, Problem> {
    let of = |problem: Problem| Problem { what: format!("camera {id} {}", problem.what), ..problem };
    let (focal, principal, rest) = match model {
        "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" => ([p[0], p[0]], [p[1], p[2]], &p[3..]),
        "PINHOLE" | "OPENCV" | "FULL_OPENCV" => ([p[0], p[1]], [p[2], p[3]], &p[4..]),
        _ => return Err(distorted(format!("camera {id} is a {model}"))),
    };
    if rest.iter().any(|k| *k != 0.0) {
        return Err(distorted(format!("camera {id} is a {model} with distortion {rest:?}")));
    }
    let sides = size.map(|side| u32::try_from(side).ok().filter(|side| *side > 0));
    let [Some(width), Some(height)] = sides else {
        return Err(Problem::new(format!("camera {id} has images of {}x{}", size[0], size[1])));
    };
    Ok(Intrinsics { size: [width, height], lens: lens(focal, principal).map_err(of)? })
}

/// Returns the camera of an image. Its pose is the view-from-world transform: the quaternion `q`, as w, x, y, z, and
/// the translation `t`.
fn image(name: &str, q: [f64; 4], t: [f64; 3], camera: u32, lenses: &Lenses) -> Result<NamedCamera, Problem> {
    let of = |problem: Problem| Problem { what: format!("image {name} {}", problem.what), ..problem };
    let Some(intrinsics) = lenses.get(&camera) else {
        return Err(Problem::new(format!("image {name} is of camera {camera}, which the cameras' file hasn't")));
    };
    let unusable = |p: &Problem| Problem { what: format!("image {name}: {}", p.what), ..p.clone() };
    let intrinsics = intrinsics.as_ref().map_err(unusable)?;
    let quaternion = DQuat::from_xyzw(q[1], q[2], q[3], q[0]);
    if !(quaternion.length() > 0.0 && quaternion.is_finite()) {
        return Err(of(Problem::new(format!("has the quaternion {q:?}")).expected("one that is not zero")));
    }
    let pose = Pose { view_from_world: DMat3::from_quat(quaternion.normalize()), translation: DVec3::from(t) };
    let (eye, axes) = pose.in_world().map_err(of)?;
    Ok(NamedCamera { name: name.to_owned(), size: Some(intrinsics.size), eye, axes, lens: intrinsics.lens })
}

/// Reader of consecutive little-endian numbers.
struct Bytes<'a> {
    all: &'a [u8],
    at: usize,
}

impl<'a> Bytes<'a> {
    fn take(&mut self, count: u64) -> Result<&'a [u8], Problem> {
        let rest = &self.all[self.at..];
        match usize::try_from(count).ok().and_then(|count| rest.get(..count)) {
            Some(bytes) => {
                self.at += bytes.len();
                Ok(bytes)
            }
            None => Err(Problem::new("ends in the middle of a record")
                .at(Location::Byte(self.at))
                .expected(format!("{count} bytes more, found {}", rest.len()))),
        }
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Problem> {
        let bytes = self.take(N as u64)?;
        // The slice has exactly N bytes.
        Ok(bytes.try_into().unwrap_or([0; N]))
    }

    fn u32(&mut self) -> Result<u32, Problem> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    fn u64(&mut self) -> Result<u64, Problem> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn f64s<const N: usize>(&mut self) -> Result<[f64; N], Problem> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = f64::from_le_bytes(self.array()?);
        }
        Ok(values)
    }

    fn text(&mut self) -> Result<String, Problem> {
        let rest = &self.all[self.at..];
        let end = rest.iter().position(|byte| *byte == 0).unwrap_or(rest.len());
        let text = String::from_utf8_lossy(self.take(end as u64)?).into_owned();
        self.take(1)?;
        Ok(text)
    }
}

pub(super) fn cameras_bin(bytes: &[u8]) -> Result<Lenses, Fault> {
    let mut bytes = Bytes { all: bytes, at: 0 };
    let mut lenses = Lenses::new();
    for _ in 0..bytes.u64()? {
        let (id, model) = (bytes.u32()?, bytes.u32()?);
        let Some((name, count)) = MODELS.get(model as usize) else {
            let problem = Problem::new(format!("camera {id} is of model {model}, which is not known"));
            return Err(problem.at(Location::Byte(bytes.at)).expected("0 to 11").into());
        };
        let size = [bytes.u64()?, bytes.u64()?];
        let parameters = (0..*count).map(|_| bytes.f64s::<1>().map(|[value]| value)).collect::<Result<Vec<_>, _>>()?;
        lenses.insert(id, intrinsics(id, name, size, &parameters));
    }
    Ok(lenses)
}

pub(super) fn images_bin(bytes: &[u8], lenses: &Lenses) -> Result<Vec<NamedCamera>, Fault> {
    let mut bytes = Bytes { all: bytes, at: 0 };
    let mut images = Vec::new();
    for _ in 0..bytes.u64()? {
        let _id = bytes.u32()?;
        let (q, t) = (bytes.f64s::<4>()?, bytes.f64s::<3>()?);
        let camera = bytes.u32()?;
        let name = bytes.text()?;
        // Skips the image's points: x, y and the id of the 3D point.
        let points = bytes.u64()?;
        bytes.take(points.saturating_mul(24))?;
        push(&mut images, image(&name, q, t, camera, lenses)?)?;
    }
    Ok(images)
}

fn push(images: &mut Vec<NamedCamera>, image: NamedCamera) -> Result<(), Problem> {
    if images.len() == MAX_CAMERAS {
        return Err(Problem::new(format!("has more than {MAX_CAMERAS} images")).expected("fewer"));
    }
    images.push(image);
    Ok(())
}

/// Returns the lines of a text file with their numbers from 1, without lines that begin with `#`.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    numbered.filter(|(_, line)| !line.starts_with('#'))
}

fn numbers<const N: usize>(line: usize, words: &[&str]) -> Result<[f64; N], Problem> {
    let mut values = [0.0; N];
    for (value, word) in values.iter_mut().zip(words) {
        *value = word
            .parse()
            .map_err(|_| Problem::new(format!("has '{word}'")).at(Location::Line(line)).expected("a number"))?;
    }
    Ok(values)
}

fn whole<T: std::str::FromStr>(line: usize, word: &str) -> Result<T, Problem> {
    let wrong = |_| Problem::new(format!("has '{word}'")).at(Location::Line(line)).expected("a whole number");
    word.parse().map_err(wrong)
}

pub(super) fn cameras_txt(bytes: &[u8]) -> Result<Lenses, Fault> {
    let text = String::from_utf8_lossy(bytes);
    let mut lenses = Lenses::new();
    for (number, line) in lines(&text).filter(|(_, line)| !line.is_empty()) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [id, model, width, height, parameters @ ..] = words.as_slice() else {
            let problem = Problem::new(format!("has {} values", words.len())).at(Location::Line(number));
            return Err(problem.expected("CAMERA_ID MODEL WIDTH HEIGHT PARAMS").into());
        };
        let id = whole(number, id)?;
        let of_line = || {
            let count = MODELS.iter().find(|(name, _)| name == model).map(|(_, count)| *count);
            if count != Some(parameters.len()) {
                let what = format!("camera {id} has {} parameters of a {model}", parameters.len());
                let expected = count.map_or("a model of COLMAP".to_owned(), |count| format!("{count}"));
                return Err(Problem::new(what).expected(expected));
            }
            let parameters = parameters.iter().map(|p| numbers::<1>(number, &[p]).map(|[p]| p));
            let parameters = parameters.collect::<Result<Vec<_>, _>>()?;
            let size = [whole(number, width)?, whole(number, height)?];
            intrinsics(id, model, size, &parameters)
        };
        lenses.insert(id, of_line());
    }
    Ok(lenses)
}

pub(super) fn images_txt(bytes: &[u8], lenses: &Lenses) -> Result<Vec<NamedCamera>, Fault> {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = lines(&text);
    let mut images = Vec::new();
    while let Some((number, line)) = lines.next() {
        if line.is_empty() {
            continue;
        }
        // Ten words, the last of which may contain spaces.
        let words: Vec<&str> = line.splitn(10, ' ').collect();
        let [_id, pose @ .., camera, name] = words.as_slice() else { return Err(too_short(number, words.len())) };
        if pose.len() != 7 {
            return Err(too_short(number, words.len()));
        }
        let [w, x, y, z, tx, ty, tz] = numbers::<7>(number, pose)?;
        let camera = whole(number, camera)?;
        let image = image(name.trim(), [w, x, y, z], [tx, ty, tz], camera, lenses);
        push(&mut images, image.map_err(|problem| problem.at(Location::Line(number)))?)?;
        // Skips the line of the image's points, which may be empty.
        lines.next();
    }
    Ok(images)
}

/// Returns the fault of an image's line with too few words.
fn too_short(number: usize, words: usize) -> Fault {
    let problem = Problem::new(format!("has {words} values")).at(Location::Line(number));
    problem.expected("IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME").into()
}
