//! Panels in which values are blended before they are mapped to colours.
//!
//! Overlapping splats are blended. A mean of two colours of a colour map is often not a colour of the map. Noisy values
//! would therefore show colours that aren't in the colour bar. Here, the values themselves are drawn as greys. Each
//! pixel then gets the colour of its mean value, times the shade of a white surface.

use std::sync::Arc;
use surfel_load::Error;
use surfel_load::coloring::{ColorMap, ColorScale, recolor};
use surfel_model::Scene;
use surfel_model::{Geometry, GroundStyle, Object, Settings, Shader, SplatCloud};

/// Two scenes from which the image of a panel coloured by values is composed.
pub(super) struct ValuePanel {
    /// The objects in white, with the scene's light. Their image gives the shade of each pixel.
    pub(super) white: Scene,
    /// The objects without light, with values as greys from 0 to 1. Their image gives the mean value of each pixel.
    pub(super) values: Scene,
}

/// Splits a scene of one object into a white scene and a scene of values. `values` has one value per splat; the value
/// `end` becomes 1. Returns `None` for geometry that isn't blended (all but disks and ellipses), for values that aren't
/// finite, and for grounds with colours.
pub(super) fn split(scene: &Scene, values: &[f64], end: f64) -> Result<Option<ValuePanel>, Error> {
    let [object] = scene.objects.as_slice() else { return Ok(None) };
    let Geometry::Splats(cloud) = &object.geometry else { return Ok(None) };
    let is_shadow = scene.ground.as_ref().is_none_or(|ground| ground.style == GroundStyle::Shadow);
    let are_colored = values.len() == cloud.len() && values.iter().all(|value| value.is_finite());
    if cloud.is_balls() || !is_shadow || !are_colored {
        return Ok(None);
    }
    let with = |color: &dyn Fn(f64) -> f32| -> Result<Object, Error> {
        let colors = values.iter().map(|value| [color(*value); 3]).collect();
        let mut cloud = SplatCloud::clone(cloud);
        recolor(&mut cloud, colors)?;
        Ok(Object { geometry: Geometry::Splats(Arc::new(cloud)), ..object.clone() })
    };
    // Colours are composited over the background afterwards.
    let bare = Scene { background: [0.0; 4], ..scene.clone() };
    let white = Scene { objects: vec![with(&|_| 1.0)?], ..bare.clone() };
    let objects = vec![with(&|value| (value / end).clamp(0.0, 1.0) as f32)?];
    Ok(Some(ValuePanel { white, values: Scene { objects, sky: None, ground: None, lights: None, ..bare } }))
}

/// Returns the settings for drawing the scene of values: unlit, so that greys remain values.
pub(super) fn of_values(settings: &Settings) -> Settings {
    settings.with_shader(Shader::Unlit)
}

/// Colours the pixels of a white frame by the values of another frame, and composites the result over `background`
/// (linear RGB and straight alpha). Pixels are premultiplied RGBA; `values` are greys from 0 to 1.
pub(super) fn color(frame: &mut [[f32; 4]], values: &[[f32; 4]], map: &ColorMap, background: [f64; 4]) {
    let scale = ColorScale::Range { map: map.clone(), range: [0.0, 1.0] };
    let painter = scale.painter();
    let [r, g, b, a] = background.map(|c| c as f32);
    let behind = [r * a, g * a, b * a, a];
    for (pixel, [value, _, _, alpha]) in frame.iter_mut().zip(values) {
        let light = if *alpha > 0.0 { painter(f64::from(value / alpha)) } else { [0.0; 3] };
        let through = 1.0 - pixel[3];
        let factor = |k: usize| if k < 3 { light[k] } else { 1.0 };
        *pixel = std::array::from_fn(|k| pixel[k] * factor(k) + through * behind[k]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Colormap;

    #[test]
    fn means_of_values_have_the_colours_of_the_map() {
        let map = ColorMap::from(Colormap::Viridis);
        // Half of 0 and half of 1 in half a light; the same at an outline; shadow without a surface.
        let mut frame = [[0.5, 0.5, 0.5, 1.0], [0.25, 0.25, 0.25, 0.5], [0.0, 0.0, 0.0, 0.25]];
        color(&mut frame, &[[0.5, 0.5, 0.5, 1.0], [0.25, 0.25, 0.25, 0.5], [0.0; 4]], &map, [1.0; 4]);
        let scale = ColorScale::Range { map, range: [0.0, 1.0] };
        let middle = scale.painter()(0.5);
        for k in 0..3 {
            assert!((frame[0][k] - 0.5 * middle[k]).abs() < 1e-6, "{frame:?}");
            assert!((frame[1][k] - (0.25 * middle[k] + 0.5)).abs() < 1e-6, "{frame:?}");
            assert!((frame[2][k] - 0.75).abs() < 1e-6, "{frame:?}");
        }
        assert!(frame.iter().all(|pixel| (pixel[3] - 1.0).abs() < 1e-6));
    }
}
