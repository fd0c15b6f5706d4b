//! Gaussian splats of the extension `KHR_gaussian_splatting`.

use super::document::GAUSSIANS;
use super::primitive::{Attributes, same_count};
use crate::columns::measured_positions;
use crate::content::Content;
use crate::context::Context;
use crate::error::{Fault, Problem, quote};
use crate::gaussians::{Gaussians, Harmonics, Kind, SH_C0};
use glam::{DAffine3, DQuat, DVec3};
use serde_json::Value;

/// The Gaussian splats of all primitives, in world space.
#[derive(Default)]
pub(super) struct GatheredSplats {
    pub(super) positions: Vec<DVec3>,
    sigmas: Vec<DVec3>,
    rotations: Vec<DQuat>,
    alphas: Vec<f32>,
    colors: Vec<[f64; 3]>,
    /// True if the colours of the primitives so far are linear, false if they are sRGB-encoded; `None` before the first
    /// primitive.
    is_linear: Option<bool>,
    /// True if some primitive has spherical harmonics. They aren't read, because the nodes' rotations would have to
    /// rotate them.
    harmonics: bool,
    /// True if a node's scale isn't uniform, or mirrors. The axes of its splats then follow the scale only
    /// approximately.
    sheared: bool,
}

impl GatheredSplats {
    /// Adds the splats of a primitive with the extension `KHR_gaussian_splatting`. `positions` are in world space, and
    /// `world` is the primitive's world-from-node transform.
    pub(super) fn add(
        &mut self,
        attributes: &Attributes<'_>,
        extension: &Value,
        positions: Vec<DVec3>,
        world: DAffine3,
    ) -> Result<(), Problem> {
        let text = |key: &str| extension.get(key).and_then(Value::as_str);
        if let Some((name, _)) = extension.get("extensions").and_then(Value::as_object).and_then(|e| e.iter().next()) {
            let what = format!("the Gaussian splats need the extension {}", quote(name));
            return Err(Problem::new(what).help("export them uncompressed, or as PLY"));
        }
        let is_linear = text("colorSpace").is_some_and(|c| c.starts_with("lin"));
        if *self.is_linear.get_or_insert(is_linear) != is_linear {
            let problem = Problem::new("primitives of Gaussian splats have different values of \"colorSpace\"");
            return Err(problem.expected("one value in all").help("export them into a file for each colour space"));
        }
        if text("kernel").is_some_and(|k| k != "ellipse") {
            return Err(Problem::new("the Gaussian splats have an unknown kernel").expected("\"ellipse\""));
        }
        let n = positions.len();
        let rotations = attribute::<4>(attributes, "ROTATION", n)?;
        let scales = attribute::<3>(attributes, "SCALE", n)?;
        let alphas = attribute::<1>(attributes, "OPACITY", n)?;
        let colors = attribute::<3>(attributes, "SH_DEGREE_0_COEF_0", n)?;
        self.harmonics |= attributes.named_floats::<3>(&format!("{GAUSSIANS}:SH_DEGREE_1_COEF_0"))?.is_some();
        let (scale, rotation, _) = world.to_scale_rotation_translation();
        let uniform = scale.abs().max_element() - scale.abs().min_element() <= 1e-6 * scale.abs().max_element();
        self.sheared |= !uniform || scale.min_element() < 0.0;
        let scale = scale.abs().element_product().cbrt();
        self.positions.extend(positions);
        self.sigmas.extend(scales.iter().map(|s| DVec3::from(s.map(f64::from)) * scale));
        self.rotations.extend(rotations.iter().map(|q| rotation * DQuat::from_array(q.map(f64::from))));
        self.alphas.extend(alphas.iter().map(|a| a[0]));
        self.colors.extend(colors.iter().map(|c| c.map(|c| 0.5 + SH_C0 * f64::from(c))));
        Ok(())
    }

    pub(super) fn finish(self, context: &mut Context<'_>) -> Result<Content, Fault> {
        if self.sheared {
            context.note("a node scales its Gaussian splats unevenly or mirrors them: their size is an average".into());
        }
        // Splats whose third axis is zero are flat.
        let flat = self.sigmas.iter().all(|s| s.z == 0.0);
        let (origin, centers) = measured_positions(&self.positions);
        context.gaussians(Gaussians {
            origin,
            centers,
            kind: if flat { Kind::Flat } else { Kind::Solid },
            sigmas: self.sigmas,
            rotations: self.rotations,
            alphas: self.alphas,
            display_colors: self.colors,
            harmonics: if self.harmonics { Harmonics::Unread(None) } else { Harmonics::None },
            linear_colors: self.is_linear.unwrap_or(false),
            up: None,
            comments: Vec::new(),
        })
    }
}

/// Returns the values of a required attribute of the extension `KHR_gaussian_splatting`, one per splat.
fn attribute<const N: usize>(attributes: &Attributes<'_>, name: &str, splats: usize) -> Result<Vec<[f32; N]>, Problem> {
    let values = attributes.named_floats(&format!("{GAUSSIANS}:{name}"))?;
    let values = values.ok_or_else(|| {
        Problem::new(format!("Gaussian splats without {GAUSSIANS}:{name}")).expected("that attribute")
    })?;
    same_count(name, Some(values.len()), splats)?;
    Ok(values)
}
