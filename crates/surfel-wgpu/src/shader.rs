//! Shader function of the embedding application, as WGSL text that becomes a part of the passes.

use crate::error::{failed, scoped};
use crate::pipelines::{Pipelines, Shaders, module};
use crate::renderer::Renderer;
use surfel_render::RenderError;
use surfel_shaders::HostShader;

/// Function that the application's text has to define.
const FUNCTION: &str = "fn host_color(surface: HostSurface) -> vec3f";

impl Renderer {
    /// Replaces the shader `phong` of all further frames by a WGSL function of the application. `None` restores
    /// `phong`. Frames with another shader in their settings don't change.
    ///
    /// The text defines `fn host_color(surface: HostSurface) -> vec3f`, which returns the linear colour of a surface.
    /// It may define further functions and constants, and use everything of WGSL that a compute shader may, but no
    /// bindings and no entry points. `HostSurface` has these fields, all of them interpolated over the splats of a
    /// pixel:
    ///
    /// | field | value |
    /// | --- | --- |
    /// | `albedo: vec3f` | linear albedo |
    /// | `normal: vec3f` | unit normal in world axes, or 0 if the splats' normals cancel out |
    /// | `position: vec3f` | position relative to the eye, in world axes and units |
    /// | `to_eye: vec3f` | unit direction to the eye, in world axes |
    /// | `depth: f32` | planar depth in world units: the distance along the viewing direction |
    /// | `material: vec4f` | ambient, diffuse and specular factor, and shininess |
    /// | `lit: vec3f` | colour of `phong`, with the scene's lights and shadows |
    ///
    /// The function colours everything that `phong` colours: splats, polygons, balls, transparent layers and what lies
    /// behind edges. Trained Gaussians have no shader. Colours beyond the range of f32 are limited, as those of
    /// `phong` are.
    ///
    /// ```no_run
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut renderer = surfel_wgpu::Renderer::new(Default::default())?;
    /// // Fog that begins 2 units before the eye.
    /// renderer.set_shader(Some(
    ///     "fn host_color(surface: HostSurface) -> vec3f {
    ///          let fog = 1.0 - exp(-0.3 * max(surface.depth - 2.0, 0.0));
    ///          return mix(surface.lit, vec3f(0.6, 0.7, 0.8), fog);
    ///      }",
    /// ))?;
    /// let settings = surfel_model::Settings::default().with_shader(surfel_model::Shader::Phong);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// All pipelines are built again when they are next used, which takes as long as in a new renderer.
    ///
    /// # Errors
    /// [`RenderError::Backend`] with the line of the text and naga's message if the text is invalid. The renderer then
    /// continues to use its previous shader.
    pub fn set_shader(&mut self, wgsl: Option<&str>) -> Result<(), RenderError> {
        let device = self.device.clone();
        let pipelines = match wgsl {
            None => scoped(&device, || Pipelines::new(&device, self.wgsl))?,
            Some(wgsl) => {
                let shader = HostShader::new(wgsl);
                check_text(wgsl).map_err(failed)?;
                let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
                let module = module(&device, &shader.text);
                if let Some(error) = pollster::block_on(scope.pop()) {
                    let info = pollster::block_on(module.get_compilation_info());
                    return Err(failed(refusal(&shader, &info, &error)));
                }
                scoped(&device, || Pipelines::of(&device, Shaders::Wgsl(module)))?
            }
        };
        self.pipelines = pipelines;
        // The bind groups of these targets have the layouts of the old pipelines.
        (self.targets, self.map_targets) = (None, None);
        self.has_host_shader = wgsl.is_some();
        Ok(())
    }
}

/// Returns an error if the text has bindings or entry points, which the passes don't provide for.
fn check_text(wgsl: &str) -> Result<(), String> {
    for (line, text) in (1..).zip(wgsl.lines()) {
        let code = text.split("//").next().unwrap_or_default();
        if let Some(found) = ["@group", "@compute", "@vertex", "@fragment"].into_iter().find(|word| code.contains(word))
        {
            return Err(format!(
                "the host's shader has `{found}` in line {line}, but it may have neither bindings nor entry points"
            ));
        }
    }
    Ok(())
}

/// Returns the error message for a text that naga refuses, with the line of the application's own text.
fn refusal(shader: &HostShader, info: &wgpu::CompilationInfo, error: &wgpu::Error) -> String {
    let is_error = |message: &&wgpu::CompilationMessage| message.message_type == wgpu::CompilationMessageType::Error;
    let Some(first) = info.messages.iter().find(is_error) else {
        return format!("the host's shader isn't valid: {error}");
    };
    let text = first.message.trim();
    let text = text.split_once("error: ").map_or(text, |(_, text)| text);
    let whole = quoted_line(text).or(first.location.map(|at| at.line_number));
    let found = whole.and_then(|whole| Some((whole, shader.line(whole)?)));
    let Some((whole, line)) = found else {
        return format!("the host's shader isn't valid, it has to define `{FUNCTION}`: {text}");
    };
    // The message quotes its place in the whole text.
    let text = text.replace(&format!(":{whole}:"), &format!(":{line}:"));
    let text = text.replace(&format!("{whole} │"), &format!("{line} │"));
    format!("the host's shader isn't valid in line {line}: {text}")
}

/// Returns the line number of the whole text that a message of naga quotes, as in `┌─ name:12:5`; `None` without one.
fn quoted_line(message: &str) -> Option<u32> {
    let (_, place) = message.split_once("┌─ ")?;
    place.split(':').nth(1)?.parse().ok()
}
