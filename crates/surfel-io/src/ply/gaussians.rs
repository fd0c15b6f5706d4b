//! Gaussian-splat PLY files, recognised by their properties (2DGS: two scales, 3DGS: three).

use super::comments::interpret_comments;
use super::table::{Table, require, take, take_positions};
use crate::columns::{to_f32, to_f64};
use crate::content::Content;
use crate::context::Context;
use crate::error::Fault;
use crate::gaussians::{Gaussians, Harmonics, Kind, SH_C0};
use glam::{DQuat, DVec3};

const REQUIRED: [&str; 10] =
    ["scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3", "opacity", "f_dc_0", "f_dc_1", "f_dc_2"];

/// True for a Gaussian-splat file; an error for one that lacks a part. A file with a radius or half-axes is in Surfel's
/// own profile.
pub(super) fn recognise(table: &Table<'_>) -> Result<bool, Fault> {
    if table.has("radius") || table.has("su") || !["scale_0", "rot_0", "f_dc_0"].iter().any(|n| table.has(n)) {
        return Ok(false);
    }
    match require(table, &REQUIRED) {
        Ok(()) => Ok(true),
        Err(Fault::Problem(mut problem)) => {
            problem.what = format!("looks like Gaussian splats, but {}", problem.what);
            problem.help = Some("export it again with all properties of 2DGS or 3DGS".into());
            Err(Fault::Problem(problem))
        }
        Err(other) => Err(other),
    }
}

pub(super) fn build(mut table: Table<'_>, comments: Vec<String>, context: &mut Context<'_>) -> Result<Content, Fault> {
    let (up, _) = interpret_comments(&comments)?;
    let (origin, centers) = take_positions(&mut table)?;
    let third = table.take("scale_2").map(|v| to_f64(&v.into()));
    let [s0, s1, r0, r1, r2, r3, opacity, red, green, blue] = take(&mut table, REQUIRED)?;
    let [s0, s1, w, x, y, z, opacity] = [s0, s1, r0, r1, r2, r3, opacity].map(|v| to_f64(&v.into()));
    let [red, green, blue] = [red, green, blue].map(to_f32);
    let n = centers.len();
    let harmonics = harmonics(&mut table, n, context);
    let display = |dc: f32| 0.5 + SH_C0 * f64::from(dc);
    context.gaussians(Gaussians {
        origin,
        centers,
        kind: if third.is_some() { Kind::Solid } else { Kind::Flat },
        sigmas: (0..n)
            .map(|i| DVec3::new(s0[i].exp(), s1[i].exp(), third.as_ref().map_or(0.0, |s| s[i].exp())))
            .collect(),
        rotations: (0..n).map(|i| DQuat::from_xyzw(x[i], y[i], z[i], w[i])).collect(),
        alphas: opacity.iter().map(|o| (1.0 / (1.0 + (-o).exp())) as f32).collect(),
        display_colors: (0..n).map(|i| [display(red[i]), display(green[i]), display(blue[i])]).collect(),
        harmonics,
        linear_colors: false,
        up,
        comments,
    })
}

/// The columns `f_rest_N`: all coefficients of red, then of green, then of blue.
fn harmonics(table: &mut Table<'_>, splats: usize, context: &Context<'_>) -> Harmonics {
    let rest = table.scalars.iter().filter(|(name, _)| name.starts_with("f_rest_")).count();
    let degree = [0, 9, 24, 45].iter().position(|n| *n == rest);
    let (Some(degree), true) = (degree, context.options.gaussians) else {
        return if rest == 0 { Harmonics::None } else { Harmonics::Unread(Some(rest)) };
    };
    let each = rest / 3;
    let mut all = vec![[0.0; 3]; splats * each];
    for number in 0..rest {
        let Some(column) = table.take(&format!("f_rest_{number}")) else { return Harmonics::Unread(Some(rest)) };
        let (channel, k) = (number / each, number % each);
        for (i, value) in to_f32(column).into_iter().enumerate() {
            all[i * each + k][channel] = value;
        }
    }
    Harmonics::Read(degree as u32, all)
}
