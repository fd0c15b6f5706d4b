//! What each shader needs, in one table: a new shader gets a line here, and a plan has what it asks for and no more.

use crate::{Feature, Pass};
use surfel_model::Shader;

/// What a shader reads of a pixel, and the pass that it draws with besides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ShaderNeeds {
    /// Albedo.
    pub albedo: bool,
    /// Shading normal.
    pub normal: bool,
    /// Depth.
    pub depth: bool,
    /// Lights, shadows and material factors; needs albedo and normal, and depth where light depends on the place.
    pub lights: bool,
    /// A pass over all pixels that looks at their neighbours.
    pub pass: Option<Pass>,
    /// What a backend says that draws it; `None` where every backend has to.
    pub feature: Option<Feature>,
}

impl ShaderNeeds {
    /// The shader's.
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
            // Shader::Unlit, and what a model to come may have besides.
            _ => Self { albedo: true, ..none },
        }
    }
}
