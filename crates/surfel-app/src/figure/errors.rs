//! Distances of clouds to a reference, and panels coloured by values so that they can be read against a colour bar.

use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_io::Content;
use surfel_load::coloring::ColorMap;
use surfel_load::coloring::{ColorScale, paint_values};
use surfel_load::steps::io_options;
use surfel_load::{Error, LoadOptions};
use surfel_model::{Geometry, Material, Mesh, Object, Settings, Shader, SplatCloud};
use surfel_model::{Light, Scene};
use surfel_render::View;
use surfel_sample::Distances;
use surfel_sample::Progress;

/// Share of the brightness that doesn't depend on the surface's direction, in panels coloured by values.
const EVEN_LIGHT: f64 = 0.68;
/// Percentile of all distances at the end of the colour map.
const PERCENTILE: f64 = 0.98;

/// Returns the splats of an object.
fn splats<'a>(object: &'a Object, path: &Path) -> Result<&'a Arc<SplatCloud>, Error> {
    let holds = match &object.geometry {
        Geometry::Splats(cloud) => return Ok(cloud),
        Geometry::Mesh(_) => "polygons",
        Geometry::Octree(_) => "an octree",
        Geometry::Gaussians(_) => "trained Gaussians",
    };
    let problem = format!("holds {holds}, which --error-row can't measure: expected points, splats or a mesh file");
    Err(Error::Unsuitable { path: path.to_path_buf(), problem })
}

fn centers(cloud: &SplatCloud) -> Vec<DVec3> {
    (0..cloud.len()).map(|i| cloud.center(i)).collect()
}

/// Returns the triangles of a file that holds a mesh; `None` for points and splats.
fn mesh(path: &Path, options: &LoadOptions) -> Result<Option<Vec<[DVec3; 3]>>, Error> {
    let corners = |mesh: &Mesh| {
        let at = |i: u32| mesh.origin + mesh.positions.get(i as usize);
        mesh.triangles.iter().map(|triangle| triangle.map(at)).collect::<Vec<_>>()
    };
    Ok(match surfel_io::load(path, &io_options(options))?.content {
        Content::Mesh(mesh) if !mesh.triangles.is_empty() => Some(corners(&mesh)),
        _ => None,
    })
}

/// Returns the distances from the splats of every object but the first to the first object: to the surface of its
/// file's mesh, or else to its points. `is_of_points` is true if the first file contains points.
pub(super) fn distances(
    objects: &[Object],
    paths: &[PathBuf],
    is_of_points: bool,
    progress: &dyn Progress,
) -> Result<Vec<Vec<f64>>, Error> {
    let (Some((first, others)), Some((path, other_paths))) = (objects.split_first(), paths.split_first()) else {
        return Ok(Vec::new());
    };
    let clouds: Vec<&Arc<SplatCloud>> =
        others.iter().zip(other_paths).map(|(object, path)| splats(object, path)).collect::<Result<_, _>>()?;
    let triangles = if is_of_points { None } else { mesh(path, &LoadOptions::default())? };
    let reference = match triangles {
        Some(triangles) => Distances::to_triangles(triangles),
        None => Distances::to_points(centers(splats(first, path)?)),
    };
    Ok(clouds.into_iter().map(|cloud| reference.of(&centers(cloud), progress)).collect())
}

/// Returns the end of the colour map for distances: the 98th percentile, rounded up to two digits.
pub(super) fn end_of_range<'a>(all: impl Iterator<Item = &'a Vec<f64>>) -> f64 {
    let mut values: Vec<f64> = all.flatten().copied().filter(|value| value.is_finite()).collect();
    let Some(last) = values.len().checked_sub(1) else { return 1.0 };
    let at = (PERCENTILE * last as f64).ceil() as usize;
    let value = *values.select_nth_unstable_by(at, f64::total_cmp).1;
    if value <= 0.0 {
        // All points lie on the reference.
        return 1.0;
    }
    let digit = 10_f64.powf(value.log10().floor() - 1.0);
    (value / digit * (1.0 - 1e-12)).ceil() * digit
}

/// Returns the mean of the finite distances.
pub(super) fn mean(distances: &[f64]) -> f64 {
    let finite = || distances.iter().filter(|value| value.is_finite());
    finite().sum::<f64>() / finite().count().max(1) as f64
}

/// Returns an object whose splats are coloured by their distances.
pub(super) fn painted(object: &Object, distances: &[f64], map: &ColorMap, end: f64) -> Result<Object, Error> {
    let Geometry::Splats(cloud) = &object.geometry else { return Ok(object.clone()) };
    let mut cloud = SplatCloud::clone(cloud);
    let scale = ColorScale::Range { map: map.clone(), range: [0.0, end] };
    paint_values(&mut cloud, distances.iter().copied(), &scale)?;
    Ok(Object { geometry: Geometry::Splats(Arc::new(cloud)), ..object.clone() })
}

/// Changes a scene and its settings so that light changes the lightness of colours a little and never their hue: the
/// light is white and mostly even, and nothing shines. Unlit scenes aren't changed.
pub(super) fn make_readable(scene: &mut Scene, settings: &mut Settings, view: &View) {
    if let Some(sky) = &mut scene.sky {
        sky.even = EVEN_LIGHT;
        return;
    }
    if settings.shader == Shader::Unlit {
        return;
    }
    settings.shader = Shader::Phong;
    let grey = |[r, g, b]: [f64; 3]| 0.212_6 * r + 0.715_2 * g + 0.072_2 * b;
    let along_view = || vec![Light::directional(view.forward().into())];
    let mut lights = scene.lights.take().filter(|lights| !lights.is_empty()).unwrap_or_else(along_view);
    let sum: f64 = lights.iter().map(|light| grey(light.color())).sum();
    let scale = (1.0 - EVEN_LIGHT) / sum.max(f64::MIN_POSITIVE);
    for light in &mut lights {
        let level = grey(light.color()) * scale;
        light.set_color([level; 3]);
    }
    scene.lights = Some(lights);
    scene.ambient = [EVEN_LIGHT; 3];
    for object in &mut scene.objects {
        object.material = Material { ambient: 1.0, diffuse: 1.0, specular: 0.0, ..object.material };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_end_at_a_round_percentile() {
        let values: Vec<f64> = (0..=100).map(|i| f64::from(i) * 0.012_34).collect();
        assert!((end_of_range([values].iter()) - 1.3).abs() < 1e-12, "98 x 0.01234 is 1.209");
        assert_eq!(end_of_range([vec![0.0, 0.0]].iter()), 1.0);
        assert_eq!(end_of_range([vec![f64::INFINITY]].iter()), 1.0);
        assert_eq!(mean(&[1.0, 3.0, f64::INFINITY]), 2.0);
    }
}
