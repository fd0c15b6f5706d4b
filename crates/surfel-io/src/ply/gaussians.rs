//! Gaussian-splat PLY files, recognised by their properties (2DGS: two scales, 3DGS: three).

use super::colors::{FloatColors, take_printed};
use super::comments::interpret_comments;
use super::table::{Table, require, take, take_positions};
use crate::columns::{to_f32, to_f64};
use crate::content::Content;
use crate::context::Context;
use crate::error::Fault;
use crate::gaussians::{Gaussians, Harmonics, Kind, SH_C0};
use glam::{DQuat, DVec3};

const REQUIRED: [&str; 7] = ["scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3", "opacity"];
const CONSTANT: [&str; 3] = ["f_dc_0", "f_dc_1", "f_dc_2"];
/// Name of the property with the standard deviation of the 3D smoothing filter. Mip-Splatting and GOF store it in
/// addition to the scales.
const FILTER: &str = "filter_3D";

/// True if the vertices are Gaussian splats. Vertices with a radius or half-axes aren't: they are Surfel's own splats.
/// Returns an error if Gaussian splats lack required properties.
pub(super) fn recognise(table: &Table<'_>) -> Result<bool, Fault> {
    if table.has("radius") || table.has("su") || !["scale_0", "rot_0", "f_dc_0"].iter().any(|n| table.has(n)) {
        return Ok(false);
    }
    // nerfstudio optionally writes red, green and blue instead of the constant harmonics.
    let colors = if table.has("red") && !table.has("f_dc_0") { ["red", "green", "blue"] } else { CONSTANT };
    match require(table, &[&REQUIRED[..], &colors].concat()) {
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
    let (origin, centers) = take_positions(&mut table, context)?;
    let third = table.take("scale_2").map(|v| to_f64(&v.into()));
    let kind = if third.is_some() { Kind::Solid } else { Kind::Flat };
    let filter = table.take(FILTER).map(|v| to_f64(&v.into()));
    let scales = take(&mut table, REQUIRED)?;
    let [s0, s1, w, x, y, z, opacity] = scales.map(|v| to_f64(&v.into()));
    let n = centers.len();
    let (display_colors, linear_colors) = if table.has(CONSTANT[0]) {
        let [red, green, blue] = take(&mut table, CONSTANT)?.map(to_f32);
        let display = |dc: f32| 0.5 + SH_C0 * f64::from(dc);
        ((0..n).map(|i| [display(red[i]), display(green[i]), display(blue[i])]).collect(), false)
    } else {
        take_printed(&mut table, FloatColors::of_comments(&comments), context)?
    };
    let harmonics = harmonics(&mut table, n, context);
    let sigma = |i: usize| DVec3::new(s0[i].exp(), s1[i].exp(), third.as_ref().map_or(0.0, |s| s[i].exp()));
    let mut sigmas: Vec<DVec3> = (0..n).map(sigma).collect();
    let mut alphas: Vec<f32> = opacity.iter().map(|o| (1.0 / (1.0 + (-o).exp())) as f32).collect();
    if let Some(filter) = filter {
        for ((sigma, alpha), filter) in sigmas.iter_mut().zip(&mut alphas).zip(filter) {
            let share;
            (*sigma, share) = smoothed(*sigma, filter, kind);
            *alpha *= share as f32;
        }
        context.note("applied the 3D smoothing filter that the file has beside the scales".into());
    }
    context.gaussians(Gaussians {
        origin,
        centers,
        kind,
        sigmas,
        rotations: (0..n).map(|i| DQuat::from_xyzw(x[i], y[i], z[i], w[i])).collect(),
        alphas,
        display_colors,
        harmonics,
        linear_colors,
        up,
        comments,
    })
}

/// Returns the standard deviations of a Gaussian after smoothing by a filter, and the factor by which its opacity
/// decreases (Yu et al., Mip-Splatting, 2024, equation 9). `filter` is the standard deviation of the filter, in the
/// same units as `sigma`.
fn smoothed(sigma: DVec3, filter: f64, kind: Kind) -> (DVec3, f64) {
    // The third axis of a flat Gaussian isn't used.
    let own = if kind == Kind::Flat { sigma.with_z(0.0) } else { sigma };
    let wide = (own * own + filter * filter).map(f64::sqrt);
    let ratio = own / wide;
    let ratio = if kind == Kind::Flat { ratio.x * ratio.y } else { ratio.x * ratio.y * ratio.z };
    if filter == 0.0 { (sigma, 1.0) } else { (if kind == Kind::Flat { wide.with_z(0.0) } else { wide }, ratio) }
}

/// Removes the columns `f_rest_N` from a table, and returns them as spherical harmonics. The columns are first all
/// coefficients of red, then those of green, then those of blue. They stay unread if the load options don't request
/// Gaussians, or if their number fits no degree from 0 to 3, or if they aren't numbered from 0.
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
