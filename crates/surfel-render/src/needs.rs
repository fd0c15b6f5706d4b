//! Table of the needs of each shader. A new shader gets a line here, and a plan computes what it needs and no more.

use crate::{Feature, Pass};
use surfel_model::Shader;

/// Pixel attributes that a shader reads, and the additional pass that it draws with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ShaderNeeds {
    /// True if the shader reads the albedo.
    pub albedo: bool,
    /// True if the shader reads the shading normal.
    pub normal: bool,
    /// True if the shader reads the depth.
    pub depth: bool,
    /// True if the shader reads lights, shadows and material factors. Lights require albedo and normal, and depth where
    /// light depends on the position.
    pub lights: bool,
    /// Additional pass over all pixels, in which the shader reads their neighbours.
    pub pass: Option<Pass>,
    /// Feature that a backend must support to draw the shader; `None` if every backend must draw it.
    pub feature: Option<Feature>,
}

impl ShaderNeeds {
    /// Returns the needs of a shader.
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
