//! Distances of point clouds to a reference, and panels whose colours can be read against a colour bar.

use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_figure::round_end;
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

/// Fraction of the light that is ambient in panels coloured by values, so that colours can be compared with the colour
/// bar. The rest depends on the surface's direction.
const AMBIENT_FRACTION: f64 = 0.68;
/// Quantile of all distances at which the colour map of the error row ends. The error row is the row of panels that
/// shows distances to the first file. The distance at the quantile is rounded up to a tick of the colour bar.
const PERCENTILE: f64 = 0.98;
/// Number of ticks of the error row's colour bar, to which the end of its range is rounded up.
const TICKS: usize = 5;

/// Distances between the points of a panel and the reference, which is the first file. They are in the units of the
/// files' coordinates.
pub(super) struct PanelErrors {
    /// Distance of each of the panel's points to the nearest point or surface of the reference.
    pub(super) distances: Vec<f64>,
    /// Mean distance of the reference's points to the nearest points of the panel. `None` if the reference is a mesh,
    /// which has no points.
    pub(super) mean_from_reference: Option<f64>,
}

impl PanelErrors {
    /// Returns the caption of the panel: the Chamfer distance to a reference of points, and the mean distance to a
    /// mesh. The Chamfer distance is the mean of the mean distances in both directions, CD-L1 in papers on completion.
    pub(super) fn caption(&self, unit: Option<&str>) -> String {
        let mean = mean(&self.distances);
        let (name, value) = match self.mean_from_reference {
            Some(back) => ("CD", 0.5 * (mean + back)),
            None => ("mean", mean),
        };
        let unit = unit.map(|unit| format!(" {unit}")).unwrap_or_default();
        format!("{name} {}{unit}", digits(value))
    }
}

/// Formats a distance with three significant digits, or all digits before the decimal point if they are more. Distances
/// below 1e-4 or from 1e7 on are written with an exponent.
fn digits(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    // The exponent after rounding: 0.009999 becomes 0.0100.
    let rounded = format!("{value:.2e}");
    let magnitude: i32 = rounded.split_once('e').and_then(|(_, exponent)| exponent.parse().ok()).unwrap_or(0);
    if !(-4..=6).contains(&magnitude) {
        return rounded;
    }
    format!("{value:.*}", (2 - magnitude).max(0) as usize)
}

/// Returns the splats of an object; an error for other geometry, which can't be measured.
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

/// Returns the triangles of a mesh file in the file's coordinates; `None` for points, splats, and meshes without
/// triangles.
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

/// Measures the distances of every object but the first to the reference, which is the first. The reference is the
/// surface of its file's mesh, or else its points. Returns one element for each object but the first. `paths` are the
/// objects' files. `is_of_points` is true if the first file contains points.
pub(super) fn measure(
    objects: &[Object],
    paths: &[PathBuf],
    is_of_points: bool,
    progress: &dyn Progress,
) -> Result<Vec<PanelErrors>, Error> {
    let (Some((first, others)), Some((path, other_paths))) = (objects.split_first(), paths.split_first()) else {
        return Ok(Vec::new());
    };
    let clouds: Vec<&Arc<SplatCloud>> =
        others.iter().zip(other_paths).map(|(object, path)| splats(object, path)).collect::<Result<_, _>>()?;
    let triangles = if is_of_points { None } else { mesh(path, &LoadOptions::default())? };
    let points = if triangles.is_none() { Some(centers(splats(first, path)?)) } else { None };
    let reference = match (triangles, &points) {
        (Some(triangles), _) => Distances::to_triangles(triangles),
        (None, points) => Distances::to_points(points.clone().unwrap_or_default()),
    };
    let errors = clouds.into_iter().map(|cloud| {
        let own = centers(cloud);
        let distances = reference.of(&own, progress);
        let back = points.as_ref().map(|points| mean(&Distances::to_points(own).of(points, progress)));
        PanelErrors { distances, mean_from_reference: back }
    });
    Ok(errors.collect())
}

/// Returns the distance at which the colour map ends: the 98th percentile of all finite distances, rounded up to a tick
/// of the colour bar. Returns 1 if the percentile is 0 or there are no finite distances.
pub(super) fn end_of_range<'a>(all: impl Iterator<Item = &'a Vec<f64>>) -> f64 {
    let mut values: Vec<f64> = all.flatten().copied().filter(|value| value.is_finite()).collect();
    let Some(last) = values.len().checked_sub(1) else { return 1.0 };
    let at = (PERCENTILE * last as f64).ceil() as usize;
    let value = *values.select_nth_unstable_by(at, f64::total_cmp).1;
    if value <= 0.0 {
        // The percentile is 0: nearly all points lie on the reference.
        return 1.0;
    }
    round_end(value, TICKS)
}

/// Returns the mean of the finite distances; 0 if there are none.
pub(super) fn mean(distances: &[f64]) -> f64 {
    let finite = || distances.iter().filter(|value| value.is_finite());
    finite().sum::<f64>() / finite().count().max(1) as f64
}

/// Returns a copy of an object whose splats are coloured by their distances to the reference. The distance `end` gets
/// the last colour of `map`. Objects of other geometry aren't coloured.
pub(super) fn painted(object: &Object, distances: &[f64], map: &ColorMap, end: f64) -> Result<Object, Error> {
    let Geometry::Splats(cloud) = &object.geometry else { return Ok(object.clone()) };
    let mut cloud = SplatCloud::clone(cloud);
    let scale = ColorScale::Range { map: map.clone(), range: [0.0, end] };
    paint_values(&mut cloud, distances.iter().copied(), &scale)?;
    Ok(Object { geometry: Geometry::Splats(Arc::new(cloud)), ..object.clone() })
}

/// Changes a scene and its settings so that colours can be read against a colour bar: light changes their lightness a
/// little, and never their hue. A sky becomes mostly even light. Without a sky, the shader becomes `phong`, lights
/// become white and mostly ambient, and highlights are removed; unlit scenes aren't changed.
pub(super) fn make_readable(scene: &mut Scene, settings: &mut Settings, view: &View) {
    if let Some(sky) = &mut scene.sky {
        sky.even = AMBIENT_FRACTION;
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
    let scale = (1.0 - AMBIENT_FRACTION) / sum.max(f64::MIN_POSITIVE);
    for light in &mut lights {
        let level = grey(light.color()) * scale;
        light.set_color([level; 3]);
    }
    scene.lights = Some(lights);
    scene.ambient = [AMBIENT_FRACTION; 3];
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
        assert!((end_of_range([values].iter()) - 1.5).abs() < 1e-12, "98 x 0.01234 is 1.209");
        assert_eq!(end_of_range([vec![0.0, 0.0]].iter()), 1.0);
        assert_eq!(end_of_range([vec![f64::INFINITY]].iter()), 1.0);
        assert_eq!(mean(&[1.0, 3.0, f64::INFINITY]), 2.0);
    }

    #[test]
    fn captions_state_chamfer_distances_to_points_and_means_to_meshes() {
        let errors = |mean_from_reference| PanelErrors { distances: vec![0.01, 0.03], mean_from_reference };
        assert_eq!(errors(Some(0.1)).caption(Some("m")), "CD 0.0600 m");
        assert_eq!(errors(None).caption(None), "mean 0.0200");
    }

    #[test]
    fn distances_have_three_digits() {
        let all = [0.0, 1.0, 0.012_345, 0.009_999, 123.456, 98_765.4, 1.5e-7].map(digits);
        assert_eq!(all, ["0", "1.00", "0.0123", "0.0100", "123", "98765", "1.50e-7"]);
    }
}
