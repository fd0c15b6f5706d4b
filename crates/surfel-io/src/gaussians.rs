//! Conversion of 2D and 3D Gaussian splats to surface splats.

use crate::color::linear_of_unit;
use crate::content::Content;
use crate::context::Context;
use crate::error::Fault;
use glam::{DQuat, DVec3};
use surfel_model::{CloudData, Column3, Shape, Up};

/// Value of the constant spherical harmonic, ½·√(1/π).
pub(crate) const SH_C0: f64 = 0.282_094_791_773_878_14;
/// Opacity below which a Gaussian is left out: haze, which a surface does not have.
const MIN_OPACITY: f32 = 0.05;
/// Half-axis of a splat in standard deviations: √(2c) at the default cutoff c = 2 makes the kernels equal.
const HALF_AXIS_SIGMAS: f64 = 2.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// 2DGS: the third axis is the normal.
    Flat,
    /// 3DGS: ellipsoids.
    Solid,
}

/// Gaussians after their activations, in columns of the same length.
pub(crate) struct Gaussians {
    pub(crate) origin: DVec3,
    pub(crate) centers: Column3,
    pub(crate) kind: Kind,
    /// Standard deviations along the rotated axes.
    pub(crate) sigmas: Vec<DVec3>,
    /// Rotations of any length but zero.
    pub(crate) rotations: Vec<DQuat>,
    /// Opacity in [0, 1].
    pub(crate) alphas: Vec<f32>,
    /// Colours as displayed; clamped to [0, 1] here.
    pub(crate) display_colors: Vec<[f64; 3]>,
    /// The colours are linear and not sRGB-encoded.
    pub(crate) linear_colors: bool,
    pub(crate) up: Option<Up>,
    pub(crate) comments: Vec<String>,
}

impl Context<'_> {
    /// Splats spanned by the Gaussians' own axes, by the two largest where there are three.
    pub(crate) fn gaussians(&mut self, g: Gaussians) -> Result<Content, Fault> {
        self.gaussian = true;
        let total = g.centers.len();
        // NaN stays, so that an invalid splat is reported and not lost here.
        let faint = |a: f32| a < MIN_OPACITY;
        let keep: Vec<u32> = (0u32..).zip(&g.alphas).filter(|&(_, &a)| !faint(a)).map(|(i, _)| i).collect();
        if keep.len() < total {
            self.note(format!("dropped {} Gaussians with an opacity below {MIN_OPACITY}", total - keep.len()));
        }
        if g.kind == Kind::Solid && total > 0 {
            self.note("3D Gaussians are drawn as disks spanned by their two largest axes".into());
        }
        let (mut s, mut t) = (Vec::with_capacity(keep.len()), Vec::with_capacity(keep.len()));
        for &i in &keep {
            let (q, sigma) = (g.rotations[i as usize], g.sigmas[i as usize]);
            // A rotation of length 0 or NaN makes NaN axes, which the cloud refuses by name.
            let q = q * (1.0 / q.length());
            let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|a| q * a);
            let (a, b) = match g.kind {
                Kind::Flat => (0, 1),
                Kind::Solid => {
                    let least = (0..3).reduce(|a, b| if sigma[b] < sigma[a] { b } else { a }).unwrap_or(2);
                    ((least + 1) % 3, (least + 2) % 3)
                }
            };
            s.push((axes[a] * (HALF_AXIS_SIGMAS * sigma[a])).as_vec3());
            t.push((axes[b] * (HALF_AXIS_SIGMAS * sigma[b])).as_vec3());
        }
        let decode = |c: f64| if g.linear_colors { c.max(0.0) as f32 } else { linear_of_unit(c) };
        let shape = Shape::Ellipses { s: Column3::from_f32(s), t: Column3::from_f32(t) };
        self.splats(CloudData {
            colors: Some(keep.iter().map(|&i| g.display_colors[i as usize].map(decode)).collect()),
            alphas: Some(keep.iter().map(|&i| g.alphas[i as usize]).collect()),
            up: g.up,
            comments: g.comments,
            rows: (keep.len() < total).then_some(keep.clone()),
            ..CloudData::new(g.origin, g.centers.select(&keep), shape)
        })
    }
}
