//! Marks over a panel: scale bar, axes, north arrow, frusta and labels, placed by the panel's camera.

use super::{FigureOptions, MarkKind};
use crate::camera;
use glam::DVec3;
use surfel_figure::{Axis, Mark, round_length};
use surfel_load::Error;
use surfel_math::V3;
use surfel_model::Camera;
use surfel_model::Projection;
use surfel_render::View;

/// Largest length of a scale bar, as a fraction of the panel's width.
const SCALE_SHARE: f64 = 0.25;
/// Length of the pyramid that is drawn for a camera, as a fraction of the distance between the panel camera's eye and
/// target.
const FRUSTUM_SHARE: f64 = 0.08;
/// Name, direction and 8-bit sRGB colour of each axis arrow: x, y and z.
const AXES: [(&str, DVec3, [u8; 3]); 3] =
    [("x", DVec3::X, [196, 48, 43]), ("y", DVec3::Y, [44, 140, 60]), ("z", DVec3::Z, [38, 92, 178])];
/// 8-bit sRGB colour of the lines of frusta, which show cameras as pyramids.
const FRUSTUM: [u8; 3] = [200, 70, 20];
/// Fraction of a panel's half-width and half-height within which frusta must fit after the camera has moved back.
const FRUSTA_FILL: f64 = 0.95;
/// Largest number of times that the camera moves back so that frusta fit. The frusta's drawn length grows with the
/// camera's distance, so that one step isn't enough.
const STEPS: u32 = 8;
/// Number of segments into which an edge of a frustum is divided. Each is tested for visibility, and hidden ones aren't
/// drawn.
const PARTS: u32 = 48;
/// Relative distance behind the panel's surface up to which a point of a frustum still counts as visible.
const DEPTH_SLACK: f64 = 1e-3;

/// Returns the position of a world-space point in view space.
fn in_view(view: &View, point: DVec3) -> DVec3 {
    view.view_from_world * (point - view.eye)
}

/// Returns the pixel position of a view-space point; `None` if the point is nearer than the near plane.
fn pixel(view: &View, p: DVec3) -> Option<[f64; 2]> {
    let at = view.projection.pixel(V3::new(p.x, p.y, p.z));
    (p.z >= view.projection.near).then_some([at.x, at.y])
}

/// Returns the marks over a panel. `camera` and `view` are the panel's, and `frusta` are the cameras that are drawn as
/// pyramids. `depth` has the view-space depth of each pixel of the panel, row by row; if it is empty, no frustum is
/// hidden.
pub(super) fn of_panel(
    camera: &Camera,
    view: &View,
    options: &FigureOptions,
    frusta: &[Camera],
    depth: &[f32],
) -> Vec<Mark> {
    let mut marks = Vec::new();
    for kind in &options.marks {
        marks.extend(match kind {
            MarkKind::Scale => scale(camera, view, options.unit.as_deref()),
            MarkKind::Axes => Some(axes(view)),
            MarkKind::North => Some(north(view)),
        });
    }
    let length = frustum_length(camera);
    for camera in frusta {
        marks.extend(frustum(camera, view, length, depth));
    }
    for (point, text) in &options.texts {
        let at = pixel(view, in_view(view, DVec3::from(*point)));
        marks.extend(at.map(|at| Mark::Label { at, text: text.clone() }));
    }
    marks
}

/// Returns a scale bar of a round length in world units. In perspective, its length is true for objects at the distance
/// of the camera's target. `None` if the length would be 0.
fn scale(camera: &Camera, view: &View, unit: Option<&str>) -> Option<Mark> {
    let depth = in_view(view, DVec3::from(camera.target)).z.max(view.projection.near);
    let per_unit = view.projection.focal_px[0] / if view.projection.is_perspective() { depth } else { 1.0 };
    let units = round_length(SCALE_SHARE * f64::from(view.size[0]) / per_unit);
    let label = match unit {
        Some(unit) => format!("{} {unit}", number(units)),
        None => number(units),
    };
    (units > 0.0).then_some(Mark::Scale { length: units * per_unit, label })
}

/// Formats a round number, with an exponent if it is very small or large.
fn number(value: f64) -> String {
    if (1e-4..1e7).contains(&value) { format!("{value}") } else { format!("{value:.0e}") }
}

fn axes(view: &View) -> Mark {
    Mark::Axes(AXES.map(|(name, axis, color)| Axis {
        name: name.to_owned(),
        direction: (view.view_from_world * axis).to_array(),
        color,
    }))
}

fn north(view: &View) -> Mark {
    let north = view.view_from_world * DVec3::Y;
    Mark::North { direction: [north.x, north.y] }
}

/// Returns the length of the frusta in a panel, in world units, for the panel's camera.
fn frustum_length(camera: &Camera) -> f64 {
    FRUSTUM_SHARE * DVec3::from(camera.eye).distance(DVec3::from(camera.target))
}

/// Returns a frustum as a pyramid `length` units long in world space: the eye and the four corners of the base. `None`
/// if the camera is invalid.
fn pyramid(camera: &Camera, length: f64) -> Option<(DVec3, [DVec3; 4])> {
    let own = View::new(camera).ok()?;
    let [width, height] = own.size.map(f64::from);
    let world = |x: f64, y: f64| {
        let (origin, direction) = own.projection.ray(surfel_math::V2::new(x, y));
        let at = origin + direction * length;
        own.view_from_world.transpose() * DVec3::new(at.x, at.y, at.z) + own.eye
    };
    Some((own.eye, [world(0.0, 0.0), world(width, 0.0), world(width, height), world(0.0, height)]))
}

/// Returns the visible parts of the edges of a camera's frustum, `length` world units long. `view` and `depth` are
/// those of the panel ([`of_panel`]).
fn frustum(camera: &Camera, view: &View, length: f64, depth: &[f32]) -> Vec<Mark> {
    let Some((eye, corners)) = pyramid(camera, length) else { return Vec::new() };
    let sides = (0..4).map(|k| [corners[k], corners[(k + 1) % 4]]);
    let edges = corners.iter().map(|corner| [eye, *corner]).chain(sides);
    edges.flat_map(|edge| visible(edge.map(|p| in_view(view, p)), view, depth)).collect()
}

/// Returns a camera like `camera` whose image includes all frusta. A perspective camera moves backwards along its view.
/// An orthographic one gets a larger height, and moves backwards only if frusta reach its near plane. After [`STEPS`]
/// steps, some frusta may still not fit.
pub(super) fn including(camera: &Camera, frusta: &[Camera]) -> Camera {
    let mut wide = camera.clone();
    for _ in 0..STEPS {
        let Ok(view) = View::new(&wide) else { break };
        let length = frustum_length(&wide);
        let pyramids = frusta.iter().filter_map(|camera| pyramid(camera, length));
        let points = pyramids.flat_map(|(eye, corners)| corners.into_iter().chain([eye])).map(|p| in_view(&view, p));
        let points: Vec<DVec3> = points.filter(|p| p.is_finite()).collect();
        let nearest = points.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        let half = [0, 1].map(|k| 0.5 * FRUSTA_FILL * f64::from(view.size[k]) / view.projection.focal_px[k]);
        // If points are outside of the panel or before the near plane, the camera moves back, or its height grows.
        let (mut back, mut factor) = ((wide.near - nearest).max(0.0), 1.0f64);
        for p in &points {
            let reach = (p.x.abs() / half[0]).max(p.y.abs() / half[1]);
            match wide.projection {
                Projection::Orthographic { .. } => factor = factor.max(reach),
                Projection::Perspective { .. } | Projection::Intrinsics { .. } => back = back.max(reach - p.z),
            }
        }
        if points.is_empty() || back == 0.0 && factor == 1.0 {
            break;
        }
        if let Projection::Orthographic { height } = &mut wide.projection {
            *height *= factor;
        }
        wide.eye = (DVec3::from(wide.eye) - view.forward() * back).into();
        wide.near = (wide.near + back).min(nearest + back);
        wide.far = wide.far.map(|far| far + back);
    }
    wide
}

/// Returns the visible parts of a view-space edge, as lines between pixel positions. Parts before the near plane or
/// behind the surfaces in `depth` aren't visible.
fn visible([a, b]: [DVec3; 2], view: &View, depth: &[f32]) -> Vec<Mark> {
    let mut lines: Vec<Vec<[f64; 2]>> = vec![Vec::new()];
    for i in 0..=PARTS {
        let p = a.lerp(b, f64::from(i) / f64::from(PARTS));
        match pixel(view, p).filter(|at| !is_hidden(*at, p.z, view, depth)) {
            Some(at) => lines.last_mut().map(|line| line.push(at)).unwrap_or_default(),
            None => lines.push(Vec::new()),
        }
    }
    let whole = lines.into_iter().filter(|line| line.len() > 1);
    // Two points suffice, because the edge is straight.
    whole.map(|line| Mark::Line { points: vec![line[0], line[line.len() - 1]], color: FRUSTUM }).collect()
}

fn is_hidden([x, y]: [f64; 2], z: f64, view: &View, depth: &[f32]) -> bool {
    let [width, height] = view.size;
    let is_inside = x >= 0.0 && y >= 0.0 && x < f64::from(width) && y < f64::from(height);
    let place = y as usize * width as usize + x as usize;
    is_inside && depth.get(place).is_some_and(|nearest| z > f64::from(*nearest) * (1.0 + DEPTH_SLACK))
}

/// Reads the cameras that are drawn as frusta.
pub(super) fn frusta(options: &FigureOptions) -> Result<Vec<Camera>, Error> {
    let Some(path) = &options.frusta else { return Ok(Vec::new()) };
    // If the files state no image size, 640×480 is assumed, the aspect ratio of most cameras.
    let cameras = camera::named(path, None).or_else(|_| camera::named(path, Some([640, 480])))?;
    Ok(cameras.into_iter().map(|(_, camera)| camera).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        Camera::perspective([0.0, 0.0, 10.0], [0.0; 3], 90.0, [400, 400])
    }

    #[test]
    fn scale_bars_are_round_and_true_at_the_target() {
        let camera = camera();
        let view = View::new(&camera).unwrap();
        // 400 pixels are 20 units at the target.
        let Some(Mark::Scale { length, label }) = scale(&camera, &view, Some("m")) else { panic!() };
        assert!((length - 100.0).abs() < 1e-9 && label == "5 m", "{length} {label}");
        assert_eq!(number(0.002), "0.002");
    }

    #[test]
    fn labels_and_axes_are_where_the_camera_sees_them() {
        let options = FigureOptions {
            texts: vec![([0.0, 10.0, 0.0], "top".into()), ([0.0, 0.0, 20.0], "behind".into())],
            marks: vec![MarkKind::Axes],
            ..FigureOptions::default()
        };
        let camera = camera();
        let view = View::new(&camera).unwrap();
        let marks = of_panel(&camera, &view, &options, &[], &[]);
        let [Mark::Axes(axes), Mark::Label { at, text }] = &marks[..] else { panic!("{marks:?}") };
        assert!((at[0] - 200.0).abs() < 1e-9 && at[1].abs() < 1e-9 && text == "top", "{at:?} {text}");
        assert_eq!(axes[0].direction, [1.0, 0.0, 0.0]);
        assert_eq!(axes[1].direction, [0.0, -1.0, 0.0]);
        assert_eq!(axes[2].direction, [0.0, 0.0, -1.0]);
    }

    #[test]
    fn cameras_move_away_until_they_see_all_frusta() {
        let around = |at: [f64; 3]| Camera::perspective(at, [0.0; 3], 40.0, [100, 100]);
        let others = [around([30.0, 0.0, 0.0]), around([0.0, -8.0, 2.0]), around([1.0, 1.0, 14.0])];
        let mut ortho = camera();
        (ortho.projection, ortho.far) = (Projection::Orthographic { height: 4.0 }, Some(20.0));
        for narrow in [camera(), ortho] {
            let wide = including(&narrow, &others);
            let view = View::new(&wide).unwrap();
            assert!(View::new(&narrow).unwrap().forward().distance(view.forward()) < 1e-12);
            for other in &others {
                let (eye, corners) = pyramid(other, frustum_length(&wide)).unwrap();
                for point in corners.into_iter().chain([eye]) {
                    let at = pixel(&view, in_view(&view, point)).unwrap();
                    assert!(at.iter().all(|x| (0.0..=400.0).contains(x)), "{point} is at {at:?}");
                }
            }
            // What is in the panel already moves nothing.
            assert_eq!(including(&wide, &[around([0.0, 1.0, 0.0])]), wide);
            assert_eq!(including(&narrow, &[]), narrow);
        }
    }

    #[test]
    fn frusta_are_hidden_by_what_is_before_them() {
        let camera = camera();
        let view = View::new(&camera).unwrap();
        let other = Camera::perspective([5.0, 0.0, 0.0], [0.0; 3], 40.0, [100, 100]);
        assert_eq!(frustum(&other, &view, 2.0, &[]).len(), 8);
        // A wall at depth 5 hides all of it.
        assert!(frustum(&other, &view, 2.0, &vec![5.0; 400 * 400]).is_empty());
    }
}
