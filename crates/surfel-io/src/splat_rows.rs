//! Reader of `.splat` files: Gaussians in rows of 32 bytes, without a header.

use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Location, Problem};
use crate::gaussians::{Gaussians, Harmonics, Kind};
use glam::{DQuat, DVec3};
use surfel_model::Column3;

/// Bytes of a row: centre and standard deviations as `f32`, then red, green, blue and alpha, and the rotation w, x, y,
/// z, as bytes.
const ROW: usize = 32;

pub(crate) fn read(bytes: &[u8], context: &mut Context<'_>) -> Result<Content, Fault> {
    let (rows, rest) = bytes.as_chunks::<ROW>();
    if !rest.is_empty() || rows.is_empty() {
        let problem =
            Problem::new(format!("is {} bytes long", bytes.len())).at(Location::Byte(bytes.len() - rest.len()));
        let help = "copy or download the file again: it is incomplete, or no SPLAT file";
        return Err(problem.expected("a multiple of 32: SPLAT has 32 bytes a splat").help(help).into());
    }
    let float =
        |row: &[u8; ROW], i: usize| f32::from_le_bytes([row[4 * i], row[4 * i + 1], row[4 * i + 2], row[4 * i + 3]]);
    let unit = |b: u8| f64::from(b) / 255.0;
    let vector = |row: &[u8; ROW], i: usize| DVec3::from([0, 1, 2].map(|k| f64::from(float(row, i + k))));
    context.gaussians(Gaussians {
        origin: DVec3::ZERO,
        centers: Column3::from_f32(rows.iter().map(|r| vector(r, 0).as_vec3()).collect()),
        kind: Kind::Solid,
        sigmas: rows.iter().map(|r| vector(r, 3)).collect(),
        rotations: rows
            .iter()
            .map(|r| {
                let [w, x, y, z] = [28, 29, 30, 31].map(|i| (f64::from(r[i]) - 128.0) / 128.0);
                DQuat::from_xyzw(x, y, z, w)
            })
            .collect(),
        alphas: rows.iter().map(|r| unit(r[27]) as f32).collect(),
        display_colors: rows.iter().map(|r| [24, 25, 26].map(|i| unit(r[i]))).collect(),
        harmonics: Harmonics::None,
        linear_colors: false,
        up: None,
        comments: Vec::new(),
    })
}
