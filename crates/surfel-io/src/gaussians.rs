//! Conversion of 2D and 3D Gaussian splats to surface splats.

use crate::color::linear_of_unit;
use crate::content::Content;
use crate::context::Context;
use crate::error::Fault;
use glam::{DQuat, DVec3};
use std::sync::Arc;
use surfel_model::{CloudData, Column3, GaussianCloud, GaussianData, GaussianKind, OnInvalid, Shape, Up};

/// Value of the constant spherical harmonic, ½·√(1/π). The coefficient of a colour is multiplied by it.
pub(crate) const SH_C0: f64 = 0.282_094_791_773_878_14;
/// Length of a surface splat's half-axis, in standard deviations of the Gaussian: √(2c). With it, the splat's kernel at
/// the default cutoff c = 2 equals the Gaussian.
const HALF_AXIS_SIGMAS: f64 = 2.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Gaussians of 2DGS, which are flat: the third axis is the normal.
    Flat,
    /// Gaussians of 3DGS, which are ellipsoids.
    Solid,
}

/// Gaussians of a file, with activation functions applied. Each column has a value for each Gaussian.
pub(crate) struct Gaussians {
    pub(crate) origin: DVec3,
    pub(crate) centers: Column3,
    pub(crate) kind: Kind,
    /// Standard deviations along the Gaussian's three axes, which `rotations` turns from x, y and z, in the file's
    /// units.
    pub(crate) sigmas: Vec<DVec3>,
    /// Rotations as quaternions of any nonzero length.
    pub(crate) rotations: Vec<DQuat>,
    /// Opacity in [0, 1], from 0 for transparent.
    pub(crate) alphas: Vec<f32>,
    /// Colours without their view-dependent part, sRGB-encoded unless `linear_colors` is true. Surface splats clamp
    /// sRGB-encoded colours to [0, 1], and linear ones only from below, to 0.
    pub(crate) display_colors: Vec<[f64; 3]>,
    /// View-dependent part of the colours, as spherical harmonics.
    pub(crate) harmonics: Harmonics,
    /// True if `display_colors` are linear instead of sRGB-encoded.
    pub(crate) linear_colors: bool,
    pub(crate) up: Option<Up>,
    pub(crate) comments: Vec<String>,
}

/// Coefficients of spherical harmonics of degree 1 and higher, which make colours depend on the viewing direction.
#[derive(Default)]
pub(crate) enum Harmonics {
    /// The file has no coefficients: colours don't depend on the view.
    #[default]
    None,
    /// Coefficients that the reader skips, with their number per splat if the file states it.
    Unread(Option<usize>),
    /// The degree, 0 to 3, and (degree + 1)² − 1 RGB coefficients for each splat, splat by splat.
    Read(u32, Vec<[f32; 3]>),
}

impl Harmonics {
    /// Returns a note for the user that the splats don't use the coefficients; `None` if there are none.
    fn left_out(&self) -> Option<String> {
        let count = match self {
            Self::None | Self::Read(0, _) => return None,
            Self::Unread(count) => *count,
            Self::Read(degree, _) => Some(3 * ((*degree as usize + 1).pow(2) - 1)),
        };
        let count = count.map_or_else(|| "the file's".to_owned(), |n| n.to_string());
        Some(format!("used the splats' base colours only: {count} spherical-harmonics coefficients are ignored"))
    }
}

impl Gaussians {
    /// Converts the Gaussians to the type that `surfel-model` has for trained Gaussians.
    fn trained(self) -> GaussianData {
        let constant = |c: &[f64; 3]| c.map(|c| ((c - 0.5) / SH_C0) as f32);
        let (degree, rest) = match self.harmonics {
            Harmonics::Read(degree, rest) => (degree, rest),
            _ => (0, Vec::new()),
        };
        let each = (degree as usize + 1).pow(2) - 1;
        let mut harmonics = Vec::with_capacity(self.display_colors.len() * (each + 1));
        for (i, color) in self.display_colors.iter().enumerate() {
            harmonics.push(constant(color));
            harmonics.extend_from_slice(&rest[i * each..(i + 1) * each]);
        }
        GaussianData {
            origin: self.origin,
            centers: self.centers,
            kind: if self.kind == Kind::Flat { GaussianKind::Flat } else { GaussianKind::Solid },
            sigmas: self.sigmas.iter().map(|s| s.as_vec3().to_array()).collect(),
            rotations: self.rotations.iter().map(|q| (*q * q.length().recip()).as_quat().to_array()).collect(),
            opacities: self.alphas,
            degree,
            harmonics,
            linear_colors: self.linear_colors,
            up: self.up,
        }
    }
}

impl Context<'_> {
    /// Converts a file's Gaussians to trained Gaussians or to surface splats, as
    /// [`LoadOptions::gaussians`](crate::LoadOptions::gaussians) requests.
    pub(crate) fn gaussians(&mut self, g: Gaussians) -> Result<Content, Fault> {
        self.gaussian = true;
        if !self.options.gaussians {
            return self.surface(g);
        }
        if let Harmonics::Unread(_) = g.harmonics {
            self.notes.extend(g.harmonics.left_out());
        }
        let on_invalid = if self.options.repair { OnInvalid::Drop } else { OnInvalid::Refuse };
        let (cloud, repaired) = GaussianCloud::new(g.trained(), on_invalid)?;
        if let Some((index, problem)) = repaired.first {
            self.note(format!("dropped {} invalid splats; the first was splat {index}: {problem}", repaired.dropped));
        }
        Ok(Content::Gaussians(Arc::new(cloud)))
    }

    /// Converts Gaussians to surface splats. A splat is spanned by the first two axes of a 2D Gaussian, or by the two
    /// longest of a 3D Gaussian. Gaussians with an opacity below [`GaussianCloud::FAINT`] are dropped with a note.
    fn surface(&mut self, g: Gaussians) -> Result<Content, Fault> {
        self.notes.extend(g.harmonics.left_out());
        let total = g.centers.len();
        // NaN isn't faint, so that an invalid splat is reported instead of dropped here.
        let faint = |a: f32| a < GaussianCloud::FAINT;
        let keep: Vec<u32> = (0u32..).zip(&g.alphas).filter(|&(_, &a)| !faint(a)).map(|(i, _)| i).collect();
        if keep.len() < total {
            let (dropped, least) = (total - keep.len(), GaussianCloud::FAINT);
            self.note(format!("dropped {dropped} Gaussians with an opacity below {least}"));
        }
        if g.kind == Kind::Solid && total > 0 {
            self.note("3D Gaussians are drawn as disks spanned by their two largest axes".into());
        }
        let (mut s, mut t) = (Vec::with_capacity(keep.len()), Vec::with_capacity(keep.len()));
        for &i in &keep {
            let (q, sigma) = (g.rotations[i as usize], g.sigmas[i as usize]);
            // A rotation of length 0 or NaN makes NaN axes, which the cloud refuses with a precise error.
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
