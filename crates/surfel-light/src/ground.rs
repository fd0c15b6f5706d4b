//! Ground below a scene: computes its light, and draws it behind a frame.

use crate::casters::Sphere;
use crate::directions::{Ray, open};
use crate::receivers::{Light, Receiver, Sides};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use surfel_math::V2;
use surfel_math::basis::{orthonormal, unit};
use surfel_math::toon::smoothstep;
use surfel_model::{Ground, GroundStyle};
use surfel_render::View;

/// Number of points at which the ground's light is computed, along each side of the square [`Plane`].
const POINTS: usize = 448;
/// Half-width of the square [`Plane`], in radii of the scene's sphere.
const EXTENT: f64 = 4.0;
/// Exponent by which the points of the square [`Plane`] are denser toward its middle. A point with parameter u from −1
/// to 1 lies at sinh(u·CROWDING)/sinh(CROWDING) half-widths.
const CROWDING: f64 = 2.0;
/// Distance from the middle of the square [`Plane`] at which the ground begins to fade, as a fraction of its
/// half-width.
const FADE: f64 = 0.5;
/// Width of the image's border in which the ground's shadow fades, as a fraction of the image's shorter side. Framed
/// objects don't reach into this border.
const BORDER: f64 = 0.1;
/// Albedo (linear grey) of the ground in the style [`GroundStyle::Plane`].
const PLANE_ALBEDO: f64 = 0.75;
/// Colour (linear grey) and opacity of the lines in the style [`GroundStyle::Grid`].
const LINE: (f64, f64) = (0.1, 0.5);
/// Width of the lines in the style [`GroundStyle::Grid`], in pixels.
const LINE_PX: f64 = 1.2;
/// Smallest number of grid lines per radius of the scene's sphere. The distance between lines is the largest round
/// length ([`round_length`]) with which there are at least so many.
const LINES: f64 = 4.0;

/// Square part of the ground, centred below the scene, in which shadows are computed.
#[derive(Clone, Debug)]
pub(crate) struct Plane {
    style: GroundStyle,
    /// Middle of the square in world space: the projection of the scene's centre onto the ground.
    origin: DVec3,
    /// Unit vectors along the sides of the square.
    axes: [DVec3; 2],
    /// Unit normal of the ground, which points up.
    normal: DVec3,
    /// Half-width of the square, in world units.
    half: f64,
    /// Sphere around the scene, whose coordinates the depth maps use.
    sphere: Sphere,
}

impl Plane {
    /// Creates the square of the ground below a scene with this sphere.
    pub(crate) fn of(ground: &Ground, sphere: &Sphere) -> Self {
        let normal = unit(ground.normal.into());
        let origin = sphere.center - normal * normal.dot(sphere.center - DVec3::from(ground.point));
        let (u, v) = orthonormal(normal);
        Self { style: ground.style, origin, axes: [u, v], normal, half: EXTENT * sphere.radius, sphere: *sphere }
    }

    /// Returns the points of the square at which light is computed, row by row.
    pub(crate) fn receivers(&self) -> Vec<Receiver> {
        let coordinate = |i: usize| self.half * warped(2.0 * i as f64 / (POINTS - 1) as f64 - 1.0);
        let [u, v] = self.axes;
        let receiver = |at: usize| Receiver {
            position: self.sphere.point(self.origin + u * coordinate(at % POINTS) + v * coordinate(at / POINTS)),
            normal: self.normal.as_vec3(),
            noise: 0.0,
            sides: Sides::Front,
        };
        (0..POINTS * POINTS).map(receiver).collect()
    }
}

/// Ground below a scene, with the light that reaches it around the scene.
#[derive(Clone, Debug)]
pub struct LitGround {
    plane: Plane,
    /// Distance between the lines of the style [`GroundStyle::Grid`], in world units.
    spacing: f64,
    /// Brightness of a white ground without shadows, by which a [`GroundStyle::Plane`] is shaded.
    whole: f32,
    /// Fraction of the unoccluded light that reaches each of the points [`Plane::receivers`], row by row.
    shares: Vec<f32>,
}

impl LitGround {
    /// Creates the ground from the light of its [`Plane::receivers`].
    pub(crate) fn of(plane: Plane, rays: &[Ray], light: &[Light]) -> Self {
        let whole: f32 = open(rays, plane.normal.as_vec3()).into_iter().sum();
        let share = |light: &Light| {
            let [sky, areas] = light.front;
            if whole > 0.0 { ((sky + areas) / whole).min(1.0) } else { 1.0 }
        };
        let shares = light.iter().map(share).collect();
        let spacing = round_length(plane.sphere.radius / LINES);
        Self { plane, spacing, whole, shares }
    }

    /// Returns the fraction of the unoccluded light that reaches a point of the ground; 1 outside of the square
    /// [`Plane`]. `at` is the point's position along the plane's axes, in world units.
    fn share(&self, at: DVec2) -> f64 {
        let place = |x: f64| 0.5 * (unwarped(x / self.plane.half) + 1.0) * (POINTS - 1) as f64;
        let (x, y) = (place(at.x), place(at.y));
        let last = (POINTS - 1) as f64;
        if !(x >= 0.0 && y >= 0.0 && x < last && y < last) {
            return 1.0;
        }
        let (fx, fy) = (x.fract(), y.fract());
        let first = y as usize * POINTS + x as usize;
        let at = |i: usize| f64::from(self.shares[i]);
        let mix = |a: f64, b: f64, f: f64| a + (b - a) * f;
        let top = mix(at(first), at(first + 1), fx);
        mix(top, mix(at(first + POINTS), at(first + POINTS + 1), fx), fy)
    }

    /// Returns the colour of a point of the ground as linear premultiplied RGBA. `at` is its position along the plane's
    /// axes, and `footprint` the size of a pixel along them, in world units.
    fn color(&self, at: DVec2, footprint: DVec2) -> [f64; 4] {
        let far = at.length() / self.plane.half;
        let fade = 1.0 - smoothstep(far, FADE, 1.0);
        let share = 1.0 - (1.0 - self.share(at)) * fade;
        let shadow = [0.0, 0.0, 0.0, 1.0 - share];
        match self.plane.style {
            GroundStyle::Shadow => shadow,
            GroundStyle::Plane => {
                let level = PLANE_ALBEDO * f64::from(self.whole) * share;
                [level * fade, level * fade, level * fade, fade]
            }
            GroundStyle::Grid => {
                let lines = [(at.x, footprint.x), (at.y, footprint.y)].map(|(x, pixel)| self.line(x, pixel));
                let alpha = LINE.1 * fade * (1.0 - (1.0 - lines[0]) * (1.0 - lines[1]));
                let level = LINE.0 * alpha;
                over([level, level, level, alpha], shadow)
            }
        }
    }

    /// Returns the fraction of a pixel that grid lines cover, for the lines at multiples of the spacing along one axis.
    /// `x` is the pixel's position along this axis and `pixel` its width, in world units.
    fn line(&self, x: f64, pixel: f64) -> f64 {
        let half = 0.5 * LINE_PX * pixel;
        // The mean of the lines over the pixel is a difference of the integral of a comb of lines.
        let integral = |x: f64| {
            let turns = x / self.spacing;
            let width = (2.0 * half / self.spacing).min(1.0);
            let (whole, part) = ((turns + 0.5 * width).floor(), (turns + 0.5 * width).rem_euclid(1.0));
            (whole * width + part.min(width)) * self.spacing
        };
        if pixel > 0.0 {
            ((integral(x + 0.5 * pixel) - integral(x - 0.5 * pixel)) / pixel).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }

    /// Draws the ground behind the colours of a frame, and `background` behind both. `colors` are linear premultiplied
    /// RGBA in the view's region, row by row. From below, the ground isn't visible.
    pub fn draw_behind(&self, view: &View, background: [f32; 4], colors: &mut [[f32; 4]]) {
        let width = view.region.width as usize;
        let background = background.map(f64::from);
        colors.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, colors)| {
            for (column, color) in colors.iter_mut().enumerate() {
                if color[3] >= 1.0 {
                    continue;
                }
                let pixel = [view.region.x as usize + column, view.region.y as usize + row].map(|i| i as f64 + 0.5);
                let ground = self.seen(view, pixel).map_or([0.0; 4], |(at, footprint)| self.color(at, footprint));
                let ground = ground.map(|c| c * self.fade(view.size, pixel));
                *color = over(color.map(f64::from), over(ground, background)).map(|c| c as f32);
            }
        });
    }

    /// Returns the factor, 0 to 1, by which the ground fades toward the border of an image of `size` pixels. Only the
    /// style [`GroundStyle::Shadow`] fades, so that the image shows no edge on a page of the same colour.
    fn fade(&self, size: [u32; 2], pixel: [f64; 2]) -> f64 {
        if self.plane.style != GroundStyle::Shadow {
            return 1.0;
        }
        let [width, height] = size.map(f64::from);
        let inside = pixel[0].min(width - pixel[0]).min(pixel[1]).min(height - pixel[1]);
        smoothstep(inside, 0.0, BORDER * width.min(height))
    }

    /// Returns the point of the ground that a pixel shows, and the size of the pixel on the ground. Both are in world
    /// units along the plane's axes. `None` if the pixel shows no ground.
    fn seen(&self, view: &View, [x, y]: [f64; 2]) -> Option<(DVec2, DVec2)> {
        let at = self.hit(view, x, y)?;
        let (right, below) = (self.hit(view, x + 1.0, y)?, self.hit(view, x, y + 1.0)?);
        Some((at, (right - at).abs() + (below - at).abs()))
    }

    /// Returns the point, in world units along the plane's axes, at which the ray through image position (x, y) meets
    /// the ground from above. `None` if the ray doesn't meet it.
    fn hit(&self, view: &View, x: f64, y: f64) -> Option<DVec2> {
        let (from, direction) = view.projection.ray(V2::new(x, y));
        let world_from_view = view.view_from_world.transpose();
        let in_world = |v: surfel_math::V3<f64>| world_from_view * DVec3::new(v.x, v.y, v.z);
        let (from, direction) = (view.eye + in_world(from), in_world(direction));
        let (height, fall) = (self.plane.normal.dot(from - self.plane.origin), -self.plane.normal.dot(direction));
        let distance = height / fall;
        if !(fall > 0.0 && distance > 0.0 && distance.is_finite()) {
            return None;
        }
        let point = from + direction * distance - self.plane.origin;
        Some(DVec2::new(point.dot(self.plane.axes[0]), point.dot(self.plane.axes[1])))
    }
}

/// Composites one premultiplied colour over another.
fn over(front: [f64; 4], back: [f64; 4]) -> [f64; 4] {
    std::array::from_fn(|i| front[i] + (1.0 - front[3]) * back[i])
}

/// Maps a parameter from −1 to 1 to a coordinate in the square, in half-widths, so that points are dense in the middle.
fn warped(u: f64) -> f64 {
    (CROWDING * u).sinh() / CROWDING.sinh()
}

/// Returns the parameter, from −1 to 1 inside the square, that [`warped`] maps to the coordinate `x`.
fn unwarped(x: f64) -> f64 {
    (x * CROWDING.sinh()).asinh() / CROWDING
}

/// Returns the largest of 1, 2 and 5 times a power of ten that isn't larger than a length. The scale bars of
/// `surfel-figure` follow the same rule, but this crate doesn't depend on that one.
fn round_length(length: f64) -> f64 {
    let power = 10f64.powf(length.log10().floor());
    let digit = [5.0, 2.0].into_iter().find(|digit| digit * power <= length * (1.0 + 1e-9)).unwrap_or(1.0);
    digit * power
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Camera;
    use surfel_render::Region;

    #[test]
    fn points_of_the_ground_crowd_toward_the_middle() {
        for u in [-1.0, -0.5, 0.0, 0.25, 1.0] {
            assert!((unwarped(warped(u)) - u).abs() < 1e-12);
        }
        assert!(warped(0.1) < 0.06 && warped(1.0) == 1.0);
    }

    #[test]
    fn shadows_fade_toward_the_border_of_an_image_and_planes_do_not() {
        let sphere = Sphere { center: DVec3::ZERO, radius: 1.0 };
        let ground = |style| LitGround {
            plane: Plane::of(&Ground { style, point: [0.0; 3], normal: [0.0, 0.0, 1.0] }, &sphere),
            spacing: 1.0,
            whole: 1.0,
            shares: vec![0.5; POINTS * POINTS],
        };
        // From 1 above the plane, so that nearly all of the image has the whole shadow.
        let camera = Camera::perspective([0.0, -0.1, 1.0], [0.0; 3], 45.0, [200, 100]);
        let drawn = |style, region: Option<Region>| {
            let view = View::of_region(&camera, region).unwrap();
            let mut colors = vec![[0.0; 4]; view.pixels()];
            ground(style).draw_behind(&view, [0.0; 4], &mut colors);
            colors
        };
        let shadow = drawn(GroundStyle::Shadow, None);
        let alpha = |x: usize, y: usize| shadow[y * 200 + x][3];
        assert!((alpha(100, 50) - 0.5).abs() < 1e-6 && (alpha(10, 50) - 0.5).abs() < 1e-6);
        for (x, y) in [(0, 50), (199, 50), (100, 0), (100, 99)] {
            assert!(alpha(x, y) < 0.02, "{x} {y}: {}", alpha(x, y));
        }
        assert!(drawn(GroundStyle::Plane, None)[0][3] > 0.99);
        // The border is that of the image, not of a region.
        let region = drawn(GroundStyle::Shadow, Some(Region { x: 100, y: 50, width: 20, height: 20 }));
        assert!((region[0][3] - 0.5).abs() < 1e-6);
    }

    #[test]
    fn lines_of_the_grid_are_round_distances_apart() {
        for (length, expected) in [(0.3, 0.2), (1.0, 1.0), (4.99, 2.0), (7.0, 5.0), (99.0, 50.0), (1e-3, 1e-3)] {
            let found = round_length(length);
            assert!((found - expected).abs() < 1e-9 * expected, "{length}: {found}, expected {expected}");
        }
    }

    #[test]
    fn lines_cover_their_share_of_pixels_of_any_size() {
        let sphere = Sphere { center: DVec3::ZERO, radius: 1.5 };
        let ground = Ground { style: GroundStyle::Grid, point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
        let ground = LitGround {
            plane: Plane::of(&ground, &sphere),
            spacing: 1.0,
            whole: 1.0,
            shares: vec![1.0; POINTS * POINTS],
        };
        assert!((ground.line(0.0, 0.01) - 1.0).abs() < 1e-9 && ground.line(0.5, 0.01) == 0.0);
        // A pixel beside a line, and pixels that are as wide as three lines are apart.
        let beside = ground.line(0.01, 0.01);
        assert!((beside - 0.1).abs() < 1e-9, "{beside}");
        assert!((ground.line(0.3, 3.0) - 1.0).abs() < 1e-9);
        let mean: f64 = (0..1000).map(|i| ground.line(f64::from(i) * 0.001, 0.02)).sum::<f64>() / 1000.0;
        assert!((mean - LINE_PX * 0.02).abs() < 1e-4, "{mean}");
    }
}
