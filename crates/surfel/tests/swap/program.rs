// Program that draws with `backend`, whichever crate that is.

/// Draws two disks, a quarter of each over the other, lit by a headlight.
pub(crate) fn draw() -> Result<surfel_render::Frame, Box<dyn std::error::Error>> {
    let (centers, normals, radii) = ([[-0.4, 0.0, 0.0], [0.4, 0.0, 0.1]], [[0.0, 0.0, 1.0]; 2], [0.6, 0.6]);
    let colors = [[0.8, 0.2, 0.1], [0.1, 0.3, 0.8]];
    let cloud = surfel_model::SplatCloud::disks(&centers, &normals, &radii)?.with_colors(&colors)?;
    let camera = surfel_model::Camera::perspective([0.0, 0.0, 3.0], [0.0; 3], 45.0, [80, 60]);
    let settings = surfel_model::Settings::default().with_shader(surfel_model::Shader::Phong);

    let mut renderer = backend::Renderer::new(backend::Options::default())?;
    let resident: backend::ResidentScene = renderer.upload(&cloud.into())?;
    Ok(renderer.render(&resident, &camera, &settings)?)
}
