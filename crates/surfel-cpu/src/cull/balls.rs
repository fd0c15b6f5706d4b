//! Objects of balls in a view: their transform to view space, and the chunks of their balls that may be visible.

use crate::cull::object::pixels_of_box;
use crate::scene::balls::{BallChunk, StoredBalls};
use glam::{DMat3, DVec3};
use surfel_render::{BallPixelForm, FramePlan, View};

/// A chunk of balls that may be visible.
#[derive(Clone, Copy)]
pub(crate) struct BallPart {
    /// Index of the object among the scene's objects of balls.
    pub object: u32,
    /// Index of the chunk in the object.
    pub chunk: u32,
}

/// An object of balls in a view: the values that all of its balls share.
pub(crate) struct BallView<'a> {
    pub balls: &'a StoredBalls,
    /// Index of the object among the scene's objects of balls.
    pub index: u32,
    /// Number of the object's first ball ([`SplatNumbers`](crate::scene::numbers::SplatNumbers)); 0 unless the frame
    /// outputs the nearest splat.
    pub first_number: u32,
    pub view: &'a View,
    /// Linear map of directions from object to view space.
    linear: DMat3,
    /// View position of the object's origin.
    origin: DVec3,
    /// Side of an image pixel in world units, as a function of the position in object space, by which radii in pixels
    /// are multiplied. `None` if the balls' radii are in world units.
    pixel: Option<BallPixelForm>,
    /// Smallest radius with which a ball is drawn, in pixels of the view; 0 unless the view is a shadow map's.
    pub least_px: f64,
}

impl<'a> BallView<'a> {
    /// Returns a scene's objects of balls in a view. `least_px` is the smallest radius of a ball in pixels: 0 in a view
    /// of the image, larger in the view of a shadow map.
    pub(crate) fn all(balls: &'a [StoredBalls], view: &'a View, plan: &FramePlan, least_px: f64) -> Vec<Self> {
        let of_object = |(index, balls): (usize, &'a StoredBalls)| {
            let m = balls.world_from_object;
            Self {
                balls,
                index: index as u32,
                first_number: 0,
                view,
                linear: view.view_from_world * m.matrix3,
                // The eye is subtracted before the rotation, so that scenes far from the origin stay exact.
                origin: view.view_from_world * (m.translation - view.eye),
                pixel: plan.ball_pixel.filter(|_| balls.in_pixels).map(|pixel| pixel.in_object(&m)),
                least_px,
            }
        };
        balls.iter().enumerate().map(of_object).collect()
    }

    /// Returns the linear map of a chunk's directions to view space, and the view position of the chunk's origin.
    pub(crate) fn placement(&self, chunk: &BallChunk) -> (DMat3, DVec3) {
        (self.linear, self.origin + self.linear * chunk.origin)
    }

    /// Returns the side of an image pixel in world units, as a function of the position relative to the chunk's origin.
    /// `None` if the balls' radii are in world units.
    pub(crate) fn pixel(&self, chunk: &BallChunk) -> Option<BallPixelForm> {
        self.pixel.map(|pixel| pixel.about(chunk.origin))
    }

    /// Returns an upper bound of the radii of a chunk's balls in the view, in world units. The balls' centres are
    /// within `reach` of the chunk's origin, which is at depth `z`.
    fn largest(&self, chunk: &BallChunk, z: f64, reach: f64) -> f64 {
        let pixel = self.pixel(chunk);
        let longest = |p: BallPixelForm| (p.constant + p.slope.length() * chunk.centers).max(p.least);
        let radius = chunk.largest * pixel.map_or(1.0, longest);
        let [fx, fy] = self.view.projection.focal_px;
        let scale = if self.view.projection.is_perspective() { (z + reach).max(0.0) } else { 1.0 };
        radius.max(self.least_px * scale / (fx * fy).sqrt())
    }
}

/// Returns the chunks of balls that may be within a view's depth range. Each chunk comes with the bounds of the pixels
/// it may touch (minimum x and y, maximum x and y), its nearest and farthest depth, and its number of balls.
pub(crate) fn ball_parts<'a>(
    views: &'a [BallView<'a>],
) -> impl Iterator<Item = (BallPart, [f64; 4], [f64; 2], usize)> + 'a {
    views.iter().flat_map(|of| {
        // The Frobenius norm bounds the largest singular value; the slack is far above rounding.
        let stretch = of.linear.to_cols_array().iter().map(|x| x * x).sum::<f64>().sqrt() * (1.0 + 1e-6);
        let projection = &of.view.projection;
        of.balls.chunks.iter().enumerate().filter_map(move |(index, chunk)| {
            let (_, center) = of.placement(chunk);
            let reach = chunk.centers * stretch;
            let radius = reach + of.largest(chunk, center.z, reach) * (1.0 + 1e-6);
            let visible = center.z + reach >= projection.near && center.z - reach <= projection.far();
            let part = BallPart { object: of.index, chunk: index as u32 };
            let pixels = pixels_of_box(projection, center, DVec3::splat(radius), 1.0);
            visible.then_some((part, pixels, [center.z - radius, center.z + radius], chunk.count))
        })
    })
}
