//! Table of the pixel attributes and passes that each shader needs. A new shader gets a line here, so that a plan
//! computes only what the shader needs.

use crate::{Feature, Pass};
use surfel_model::Shader;

/// Pixel attributes that a shader reads, and the pass and backend feature that it requires.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ShaderNeeds {
    /// True if the shader reads the pixel's albedo.
    pub albedo: bool,
    /// True if the shader reads the pixel's shading normal.
    pub normal: bool,
    /// True if the shader reads the pixel's depth.
    pub depth: bool,
    /// True if the shader reads lights, shadows and material factors. The plan then adds depth if light depends on the
    /// position.
    pub lights: bool,
    /// Pass in which the shader reads neighbouring pixels; `None` if the shader needs no such pass.
    pub pass: Option<Pass>,
    /// Feature that a backend must support to draw the shader; `None` if every backend must draw it.
    pub feature: Option<Feature>,
}

impl ShaderNeeds {
    /// Returns the pixel attributes, the pass and the backend feature that a shader needs.
    pub(crate) fn of(shader: Shader) -> Self {
        let none = Self::default();
        let lit = Self { albedo: true, normal: true, lights: true, ..none };
        match shader {
            Shader::Phong => lit,
            Shader::Toon => Self { depth: true, pass: Some(Pass::Outlines), feature: Some(Feature::Toon), ..lit },
            Shader::Normal => Self { normal: true, ..none },
            Shader::Depth => Self { depth: true, ..none },
            Shader::Matcap => Self { albedo: true, normal: true, feature: Some(Feature::Matcap), ..none },
            Shader::Edl => {
                Self { albedo: true, depth: true, pass: Some(Pass::EyeDome), feature: Some(Feature::EyeDome), ..none }
            }
            // Shader::Unlit, and shaders that a later model may add.
            _ => Self { albedo: true, ..none },
        }
    }
}
