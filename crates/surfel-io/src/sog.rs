//! Reader of SOG: Gaussians stored as pixels of images, one pixel per splat. The images are in a ZIP file, or in the
//! folder of their `meta.json`.

use crate::bytes::Bytes;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Problem, quote};
use crate::files::Siblings;
use crate::gaussians::{Gaussians, Harmonics, Kind, SH_C0};
use crate::zip::Archive;
use glam::{DQuat, DVec3};
use serde::Deserialize;
use std::borrow::Cow;
use surfel_model::Column3;

/// Contents of `meta.json`. Version 1 has ranges instead of version 2's tables of 256 values.
#[derive(Deserialize)]
struct Meta {
    version: Option<u32>,
    count: Option<u64>,
    means: Part,
    scales: Part,
    quats: Part,
    sh0: Part,
    #[serde(rename = "shN")]
    harmonics: Option<serde::de::IgnoredAny>,
}

#[derive(Deserialize)]
struct Part {
    shape: Option<Vec<u64>>,
    #[serde(default)]
    mins: Vec<f64>,
    #[serde(default)]
    maxs: Vec<f64>,
    #[serde(default)]
    codebook: Vec<f64>,
    files: Vec<String>,
}

impl Part {
    /// Returns the value that a byte of an image encodes: an entry of the table (version 2), or a fraction of the
    /// channel's range (version 1).
    fn value(&self, channel: usize, byte: u8) -> f64 {
        match self.codebook.get(usize::from(byte)) {
            Some(value) => *value,
            None => self.within(channel, f64::from(byte) / 255.0),
        }
    }

    fn within(&self, channel: usize, fraction: f64) -> f64 {
        match (self.mins.get(channel), self.maxs.get(channel)) {
            (Some(min), Some(max)) => min + (max - min) * fraction,
            _ => f64::NAN,
        }
    }
}

/// Largest size, in bytes, of a file that is recognised as SOG's `meta.json`, which is a few tables of 256 numbers.
const MAX_META_BYTES: usize = 1 << 20;

/// True if the bytes are a `meta.json` file, whose images are other files in its folder.
pub(crate) fn looks_like(bytes: &[u8]) -> bool {
    let has = |word: &str| bytes.windows(word.len()).any(|w| w == word.as_bytes());
    bytes.len() <= MAX_META_BYTES && ["\"means\"", "\"quats\"", "\"sh0\"", "\"files\""].iter().all(|word| has(word))
}

/// Location of the images that contain the Gaussians.
enum ImageSource<'a> {
    /// Members of an archive, in the archive's folder that the text names.
    Members(Archive<'a>, String),
    /// Files in the folder of `meta.json`.
    Beside(&'a Siblings),
}

impl<'a> ImageSource<'a> {
    fn read(&mut self, name: &str) -> Result<Cow<'a, [u8]>, Fault> {
        let what = quote(name);
        match self {
            Self::Members(archive, folder) => {
                let member = archive.find(&format!("{folder}{name}"));
                let none = || Problem::new(format!("the SOG file has no {what}, which meta.json names"));
                archive.read(member.ok_or_else(none)?)
            }
            Self::Beside(siblings) => siblings.read(name).map(Cow::Owned).map_err(|why| {
                let problem = Problem::new(format!("can't read the picture {what}, which it names: {why}"));
                problem.help("keep meta.json and its pictures in one folder").into()
            }),
        }
    }
}

pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let (json, mut pictures) = if bytes.starts_with(b"PK") {
        let mut archive = Archive::of(Bytes::Memory(bytes))?;
        // If there are several levels of detail, the first is read.
        let meta_name = archive.names().find(|n| n == "meta.json" || n.ends_with("/meta.json"));
        let Some(meta_name) = meta_name else { return Err(Problem::new("the SOG file has no meta.json").into()) };
        let folder = meta_name.trim_end_matches("meta.json").to_owned();
        let json = archive.read(archive.find(&meta_name).unwrap_or_default())?;
        (json, ImageSource::Members(archive, folder))
    } else {
        (Cow::Borrowed(bytes), ImageSource::Beside(&context.siblings))
    };
    let meta: Meta = serde_json::from_slice(&json).map_err(|why| {
        let why: String = why.to_string().chars().take(200).filter(|c| !c.is_control()).collect();
        Problem::new(format!("its meta.json is no description of SOG: {why}"))
    })?;
    let version = meta.version.unwrap_or(1);
    if version > 2 {
        let problem = Problem::new(format!("is a SOG file of version {version}")).expected("1 or 2");
        return Err(problem.help("convert it to PLY first, e.g. with splat-transform").into());
    }
    let count = meta.count.or_else(|| meta.means.shape.as_ref()?.first().copied());
    let count = count.and_then(|n| usize::try_from(n).ok()).filter(|n| *n > 0);
    let count = count.ok_or_else(|| Problem::new("its meta.json counts no splats"))?;
    let mut picture = |part: &Part, index: usize| -> Result<Vec<[u8; 4]>, Fault> {
        let name = part.files.get(index).ok_or_else(|| Problem::new("its meta.json names too few pictures"))?;
        let what = quote(name);
        let mut texels = context
            .textures
            .decode(&pictures.read(name)?, name)
            .map_err(|why| {
                let why: String = why.chars().take(200).filter(|c| !c.is_control()).collect();
                Problem::new(format!("the picture {what} of the SOG file can't be read: {why}"))
            })?
            .srgba8;
        if texels.len() < count {
            let what = format!("the picture {what} has {} pixels for {count} splats", texels.len());
            return Err(Problem::new(what).help("copy or download the file again: it is damaged").into());
        }
        texels.truncate(count);
        Ok(texels)
    };
    let (low, high) = (picture(&meta.means, 0)?, picture(&meta.means, 1)?);
    let (quats, scales, sh0) = (picture(&meta.quats, 0)?, picture(&meta.scales, 0)?, picture(&meta.sh0, 0)?);
    let harmonics = if meta.harmonics.is_some() { Harmonics::Unread(None) } else { Harmonics::None };
    let center = |low: &[u8; 4], high: &[u8; 4]| {
        DVec3::from([0, 1, 2].map(|i| {
            let fraction = f64::from(u16::from_le_bytes([low[i], high[i]])) / 65_535.0;
            // Coordinates are stored as signed logarithms: sign(x) · ln(|x| + 1).
            let v = meta.means.within(i, fraction);
            v.signum() * (v.abs().exp() - 1.0)
        }))
    };
    let alpha = |c: &[u8; 4]| match version {
        1 => 1.0 / (1.0 + (-meta.sh0.within(3, f64::from(c[3]) / 255.0)).exp()),
        _ => f64::from(c[3]) / 255.0,
    };
    context.gaussians(Gaussians {
        origin: DVec3::ZERO,
        centers: Column3::from_f32(low.iter().zip(&high).map(|(l, h)| center(l, h).as_vec3()).collect()),
        kind: Kind::Solid,
        sigmas: scales.iter().map(|s| DVec3::from([0, 1, 2].map(|i| meta.scales.value(i, s[i]).exp()))).collect(),
        rotations: quats.iter().map(rotation).collect(),
        alphas: sh0.iter().map(|c| alpha(c) as f32).collect(),
        display_colors: sh0.iter().map(|c| [0, 1, 2].map(|i| 0.5 + SH_C0 * meta.sh0.value(i, c[i]))).collect(),
        harmonics,
        linear_colors: false,
        up: None,
        comments: Vec::new(),
    })
}

/// Unpacks a unit quaternion w, x, y, z; the last byte, minus 252, is the index of the omitted largest component. A
/// last byte below 252 is invalid and yields the identity.
fn rotation(&[a, b, c, tag]: &[u8; 4]) -> DQuat {
    let Some(largest) = tag.checked_sub(252).map(usize::from) else { return DQuat::IDENTITY };
    let mut parts = [0.0; 4];
    let others = (0..4).filter(|&i| i != largest).zip([a, b, c]);
    for (i, byte) in others {
        parts[i] = (f64::from(byte) / 255.0 * 2.0 - 1.0) * std::f64::consts::FRAC_1_SQRT_2;
    }
    parts[largest] = (1.0 - parts.iter().map(|p| p * p).sum::<f64>()).max(0.0).sqrt();
    let [w, x, y, z] = parts;
    DQuat::from_xyzw(x, y, z, w)
}
