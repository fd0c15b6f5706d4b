//! Compressed Gaussian splats of PlayCanvas's tools: four words per splat, relative to the bounds of chunks of 256
//! splats.

use super::comments::interpret_comments;
use super::table::{Table, take};
use crate::columns::to_f64;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Problem};
use crate::gaussians::{Gaussians, Harmonics, Kind};
use glam::{DQuat, DVec3};
use surfel_model::{Column3, ExtraValues};

const CHUNK: usize = 256;
const PACKED: [&str; 4] = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];

/// True if the vertices are compressed Gaussian splats: they have the property `packed_position`.
pub(super) fn recognise(vertices: &Table<'_>) -> bool {
    vertices.has(PACKED[0])
}

/// Returns the number in `bits` bits of a packed value, from bit `shift` on, as a fraction of the number's maximum.
fn fraction(value: u32, shift: u32, bits: u32) -> f64 {
    let most = (1 << bits) - 1;
    f64::from(value >> shift & most) / f64::from(most)
}

/// Bounds of a position, scale or colour in each chunk of 256 splats: the minima of its three components, then the
/// maxima. Each of the six columns has a value for each chunk.
struct Bounds([Vec<f64>; 3], [Vec<f64>; 3]);

impl Bounds {
    fn take(chunks: &mut Table<'_>, min: [&str; 3], max: [&str; 3]) -> Result<Self, Fault> {
        let [a, b, c] = take(chunks, min)?;
        let [d, e, f] = take(chunks, max)?;
        Ok(Self([a, b, c].map(|v| to_f64(&v.into())), [d, e, f].map(|v| to_f64(&v.into()))))
    }

    /// Returns the vector of a splat. Each component interpolates from the minimum (fraction 0) to the maximum
    /// (fraction 1) of the chunk that contains the splat.
    fn at(&self, splat: usize, fractions: [f64; 3]) -> DVec3 {
        let chunk = splat / CHUNK;
        DVec3::from([0, 1, 2].map(|k| self.0[k][chunk] * (1.0 - fractions[k]) + self.1[k][chunk] * fractions[k]))
    }
}

pub(super) fn build(
    mut vertices: Table<'_>,
    chunks: Option<Table<'_>>,
    harmonics: bool,
    comments: Vec<String>,
    context: &mut Context<'_>,
) -> Result<Content, Fault> {
    let (up, _) = interpret_comments(&comments)?;
    let words = take(&mut vertices, PACKED)?.map(ExtraValues::from);
    let [ExtraValues::U32(positions), ExtraValues::U32(rotations), ExtraValues::U32(scales), ExtraValues::U32(colors)] =
        words
    else {
        return Err(Problem::new("its packed properties are not of the type uint").expected("property uint").into());
    };
    let mut chunks = chunks.ok_or_else(|| Problem::new("its splats are packed, but it has no element 'chunk'"))?;
    let center_bounds = Bounds::take(&mut chunks, ["min_x", "min_y", "min_z"], ["max_x", "max_y", "max_z"])?;
    let scale_bounds = Bounds::take(
        &mut chunks,
        ["min_scale_x", "min_scale_y", "min_scale_z"],
        ["max_scale_x", "max_scale_y", "max_scale_z"],
    )?;
    // Early files had no colour bounds.
    let color_bounds = if chunks.has("min_r") {
        Some(Bounds::take(&mut chunks, ["min_r", "min_g", "min_b"], ["max_r", "max_g", "max_b"])?)
    } else {
        None
    };
    let needed = positions.len().div_ceil(CHUNK);
    if center_bounds.0[0].len() < needed {
        let what = format!("has {} chunks for {} splats", center_bounds.0[0].len(), positions.len());
        return Err(Problem::new(what).expected(format!("{needed}, one for each {CHUNK} splats")).into());
    }
    let harmonics = if harmonics { Harmonics::Unread(None) } else { Harmonics::None };
    let three = |v: u32| [fraction(v, 21, 11), fraction(v, 11, 10), fraction(v, 0, 11)];
    let centers = positions.iter().enumerate().map(|(i, &p)| center_bounds.at(i, three(p)).as_vec3());
    let sigmas = scales.iter().enumerate().map(|(i, &s)| {
        let log = scale_bounds.at(i, three(s));
        DVec3::new(log.x.exp(), log.y.exp(), log.z.exp())
    });
    let display = colors.iter().enumerate().map(|(i, &c)| {
        let levels = [24, 16, 8].map(|shift| fraction(c, shift, 8));
        color_bounds.as_ref().map_or(levels, |bounds| bounds.at(i, levels).to_array())
    });
    context.gaussians(Gaussians {
        origin: DVec3::ZERO,
        centers: Column3::from_f32(centers.collect()),
        kind: Kind::Solid,
        sigmas: sigmas.collect(),
        rotations: rotations.iter().map(|&r| rotation(r)).collect(),
        alphas: colors.iter().map(|&c| fraction(c, 0, 8) as f32).collect(),
        display_colors: display.collect(),
        harmonics,
        linear_colors: false,
        up,
        comments,
    })
}

/// Unpacks a unit quaternion w, x, y, z: the index of its largest component in 2 bits, then the others in 10 bits each.
fn rotation(packed: u32) -> DQuat {
    let largest = (packed >> 30) as usize;
    let mut parts = [0.0; 4];
    for (i, shift) in (0..4).filter(|&i| i != largest).zip([20, 10, 0]) {
        parts[i] = (fraction(packed, shift, 10) - 0.5) * std::f64::consts::SQRT_2;
    }
    parts[largest] = (1.0 - parts.iter().map(|p| p * p).sum::<f64>()).max(0.0).sqrt();
    let [w, x, y, z] = parts;
    DQuat::from_xyzw(x, y, z, w)
}
