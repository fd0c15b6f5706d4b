//! Balls and dots (rendering model §11): computes their fragments in each pixel, in the order of depth.

use crate::margin;
use crate::pixels;
use crate::scene::ResidentObject;
use crate::shade::{Lighting, Surface};
use crate::splat::ObjectView;
use glam::DVec3;
use rayon::prelude::*;
use surfel_math::ball::{BallHit, Exact, MIN_TEXELS, Outline, SOLID};
use surfel_math::basis::unit;
use surfel_math::bounds::Extent;
use surfel_math::{V2, V3};
use surfel_model::{BallLight, Shape};
use surfel_render::{FramePlan, Region, View, ball_scale};

/// Ball or dot, projected to a view.
#[derive(Clone)]
pub(crate) struct ScreenBall {
    /// Index of the ball among all splats of the scene: objects in order, splats in order.
    pub index: u32,
    /// Position of the ball's centre in view space.
    pub center: DVec3,
    /// Radius in world units.
    radius: f64,
    flat: bool,
    /// Pixel position of the projected centre, from which offsets in the outline are measured.
    anchor: V2<f64>,
    outline: Outline<f64>,
    extent: Extent<f64>,
    /// Linear RGB albedo.
    pub color: [f64; 3],
    /// Opacity of the ball; 1 if the plan ignores the alphas of balls.
    alpha: f64,
    /// Ambient, diffuse, specular and shininess factors of the material.
    pub material: [f64; 4],
    /// Light of a sky that is stored in the ball, which the shader `unlit` applies (rendering model §12); `None` if
    /// there is none.
    pub light: Option<BallLight>,
}

/// Fragment of a ball in a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BallFragment {
    /// Planar depth: distance along the viewing direction.
    pub z: f64,
    /// Fraction of the pixel that the ball covers, times the ball's opacity.
    pub alpha: f64,
    /// True if the fragment is solid (rendering model §11), so that the planes of depth, normal and nearest splat show
    /// it.
    pub is_solid: bool,
    /// True if rounding could change whether the fragment is solid.
    pub is_solid_open: bool,
    /// Index of the ball among all splats of the scene.
    pub splat: u32,
    pub surface: Surface,
}

/// View in which balls are drawn: that of an image or that of a shadow map.
pub(crate) struct BallView<'a> {
    view: &'a View,
    /// Smallest radius of a drawn ball, in pixels of the view; smaller balls are enlarged to this radius.
    least_px: f64,
}

impl<'a> BallView<'a> {
    /// Creates the view of an image.
    pub(crate) fn of_image(view: &'a View) -> Self {
        Self { view, least_px: 0.0 }
    }

    /// Creates the view of a shadow map, in which small balls are enlarged to [`MIN_TEXELS`].
    pub(crate) fn of_shadow_map(view: &'a View) -> Self {
        Self { view, least_px: MIN_TEXELS }
    }

    /// Projects all balls of a scene that are drawn in the view.
    pub(crate) fn project(&self, objects: &[ResidentObject], plan: &FramePlan) -> Vec<ScreenBall> {
        let of_object = |object: &ResidentObject| {
            let Shape::Balls { radii, in_pixels, flat } = &object.cloud.data().shape else { return Vec::new() };
            let (in_view, scale) = (ObjectView::new(object, self.view), ball_scale(&object.world_from_object));
            let pixel = plan.ball_pixel.filter(|_| *in_pixels).map(|p| p.in_object(&object.world_from_object));
            let project = |i: usize| {
                let local = object.cloud.center(i);
                let radius = f64::from(radii[i]) * pixel.map_or(scale, |pixel| pixel.at(local));
                self.place(in_view.point(local), radius, *flat).map(|ball| ScreenBall {
                    index: object.first_splat + i as u32,
                    color: object.cloud.color(i).map(f64::from),
                    alpha: if plan.ball_alphas { f64::from(object.cloud.alpha(i)) } else { 1.0 },
                    material: object.material.factors(),
                    light: object.cloud.data().ball_light.as_ref().map(|light| light[i]),
                    ..ball
                })
            };
            (0..radii.len()).into_par_iter().filter_map(project).collect()
        };
        objects.iter().flat_map(of_object).collect()
    }

    /// Projects a ball, or a dot if `flat` is true. `None` if its nearest point is nearer than z_near, or its centre is
    /// beyond z_far.
    fn place(&self, center: DVec3, radius: f64, flat: bool) -> Option<ScreenBall> {
        let projection = &self.view.projection;
        let radius = radius.max(self.least_px * per_pixel(self.view, center.z));
        let front = if flat { center.z } else { center.z - radius };
        if front < projection.near || center.z > projection.far() {
            return None;
        }
        let p = V3::from(center);
        let outline =
            if flat { Outline::of_dot(p, radius, projection) } else { Outline::of_ball(p, radius, projection) };
        let anchor = projection.pixel(p);
        let middle = anchor + outline.center;
        // The ball touches all pixels whose squares, not only centres, its outline reaches.
        let half = outline.extent + V2::new(0.5, 0.5);
        let extent = Extent { min: middle - half, max: middle + half };
        let (index, color, alpha, material, light) = (0, [1.0; 3], 1.0, [0.0; 4], None);
        Some(ScreenBall { index, center, radius, flat, anchor, outline, extent, color, alpha, material, light })
    }
}

/// Returns the width of a pixel at depth `z` in world units, by the geometric mean of the focal lengths.
fn per_pixel(view: &View, z: f64) -> f64 {
    let [fx, fy] = view.projection.focal_px;
    if view.projection.is_perspective() { z / (fx * fy).sqrt() } else { 1.0 / (fx * fy).sqrt() }
}

impl ScreenBall {
    /// Returns the ball's opacity.
    pub(crate) fn alpha(&self) -> f64 {
        self.alpha
    }

    /// Returns the columns and rows of `rect` whose pixels the ball may touch.
    pub(crate) fn touched(&self, rect: Region) -> (std::ops::Range<u32>, std::ops::Range<u32>) {
        pixels::touched(&self.extent, rect)
    }

    /// True if a pixel position is inside of the ball's projected outline.
    pub(crate) fn contains(&self, pixel: V2<f64>) -> bool {
        self.outline.contains(pixel - self.anchor - self.outline.center)
    }

    /// True if rounding could change whether a pixel position is inside of the ball's projected outline.
    pub(crate) fn is_on_rim(&self, pixel: V2<f64>) -> bool {
        let from = pixel - self.anchor - self.outline.center;
        let scaled = |by: f64| self.outline.contains(from * by);
        let slack = margin::RIM_PX / self.outline.extent.x.min(self.outline.extent.y);
        scaled(1.0 - slack) != scaled(1.0 + slack)
    }

    /// Returns the ball's fragment in a pixel; `None` if the ball doesn't cover the pixel.
    fn fragment(&self, lighting: &Lighting, pixel: V2<f64>) -> Option<BallFragment> {
        let corner = pixel - V2::new(0.5, 0.5);
        let coverage = self.outline.coverage::<Exact>(corner - self.anchor - self.outline.center);
        if coverage <= 0.0 {
            return None;
        }
        let (z, normal) = self.hit(lighting.view, pixel);
        let from = self.anchor - corner;
        let inside = |v: f64, slack: f64| v >= -slack && v < 1.0 + slack;
        let has_center = |slack: f64| inside(from.x, slack) && inside(from.y, slack);
        let is_solid = coverage >= SOLID || has_center(0.0);
        let open_coverage = (coverage - SOLID).abs() < margin::BALL_COVERAGE && !has_center(0.0);
        let open_center = has_center(margin::RIM_PX) != has_center(-margin::RIM_PX) && coverage < SOLID;
        let normal = lighting.view.view_from_world.transpose() * normal;
        let surface = lighting.shade_ball(self, pixel, z, unit(normal), coverage);
        let is_solid_open = open_coverage || open_center;
        Some(BallFragment { z, alpha: coverage * self.alpha, is_solid, is_solid_open, splat: self.index, surface })
    }

    /// Returns the ball's depth and its unit normal, both in view space, at a pixel position.
    fn hit(&self, view: &View, pixel: V2<f64>) -> (f64, DVec3) {
        let (projection, p) = (&view.projection, self.center);
        let perspective = projection.is_perspective();
        if self.flat {
            return (p.z, if perspective { -unit(p) } else { DVec3::NEG_Z });
        }
        let d = pixel - self.anchor;
        let offset = V2::new(d.x / projection.focal_px[0], d.y / projection.focal_px[1]);
        let size = if perspective { self.radius / p.z } else { self.radius };
        let hit = BallHit::new(V2::new(p.x / p.z, p.y / p.z), size, offset, projection);
        let z = if perspective { p.z * hit.depth } else { p.z + hit.depth };
        (z, DVec3::new(hit.normal.x, hit.normal.y, hit.normal.z))
    }
}

/// Fragments of all balls in a frame, per pixel.
pub(crate) struct BallLayer {
    /// Fragments in each pixel, nearest first, up to the first one of an opaque ball that covers the whole pixel.
    pub pixels: Vec<Vec<BallFragment>>,
    /// Number of balls of the frame between z_near and z_far. Balls beside the rectangle count, too.
    pub drawn: usize,
}

impl BallLayer {
    /// Draws the balls of a scene over a rectangle.
    pub(crate) fn draw(objects: &[ResidentObject], lighting: &Lighting, rect: Region) -> Self {
        let balls = BallView::of_image(lighting.view).project(objects, lighting.plan);
        let mut rows = vec![Vec::new(); rect.height as usize];
        for ball in &balls {
            let (columns, touched) = ball.touched(rect);
            touched.for_each(|y| rows[(y - rect.y) as usize].push((ball, columns.clone())));
        }
        let of_row = |(row, balls): (u32, Vec<(&ScreenBall, std::ops::Range<u32>)>)| {
            let mut pixels: Vec<Vec<BallFragment>> = vec![Vec::new(); rect.width as usize];
            for (ball, columns) in balls {
                for x in columns {
                    let fragment = ball.fragment(lighting, pixels::center(x, rect.y + row));
                    pixels[(x - rect.x) as usize].extend(fragment);
                }
            }
            for pixel in &mut pixels {
                pixel.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.splat.cmp(&b.splat)));
                // Nothing is visible behind a fragment that covers the whole pixel.
                let shown = pixel.iter().position(|f| f.alpha >= 1.0).map_or(pixel.len(), |last| last + 1);
                pixel.truncate(shown);
            }
            pixels
        };
        let rows: Vec<_> = (0..).zip(rows).collect();
        let pixels = rows.into_par_iter().flat_map_iter(of_row).collect();
        Self { pixels, drawn: balls.len() }
    }

    /// Returns the fragments of pixel `at`, nearest first; empty if the frame has no balls.
    pub(crate) fn of(layer: Option<&Self>, at: usize) -> &[BallFragment] {
        layer.map_or(&[], |layer| &layer.pixels[at])
    }
}

/// Returns the fragments with depths from `from` up to, but not including, `to`. `fragments` must be sorted by depth,
/// as in [`BallLayer::pixels`].
pub(crate) fn between(fragments: &[BallFragment], from: f64, to: f64) -> &[BallFragment] {
    let first = fragments.partition_point(|f| f.z < from);
    let end = fragments.partition_point(|f| f.z < to).max(first);
    &fragments[first..end]
}

/// Returns the nearest solid fragment, which the planes of depth, normal and nearest splat show; `None` if no fragment
/// is solid. `fragments` are those of one pixel, nearest first.
pub(crate) fn shown(fragments: &[BallFragment]) -> Option<&BallFragment> {
    fragments.iter().find(|f| f.is_solid)
}

/// True if rounding could change the order of a pixel's visible fragments, which of them is solid, or a highlight or
/// shadow on one of them. Also true if it could change their order relative to the depths `surfaces` of other surfaces.
/// `fragments` are those of the pixel, nearest first.
pub(crate) fn is_marginal(fragments: &[BallFragment], surfaces: &[f64]) -> bool {
    let mut transmittance = 1.0;
    for (i, f) in fragments.iter().enumerate() {
        // Fragments behind this transmittance are invisible.
        if transmittance < 1e-5 {
            return false;
        }
        let next = fragments.get(i + 1).is_some_and(|next| margin::on_ball_depth(f.z, next.z));
        let other = surfaces.iter().any(|z| margin::on_depth(f.z, *z));
        if f.is_solid_open || f.surface.marginal || next || other {
            return true;
        }
        transmittance *= 1.0 - f.alpha;
    }
    false
}
