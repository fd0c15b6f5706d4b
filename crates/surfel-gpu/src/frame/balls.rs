//! Balls and dots that may touch a tile (rendering model §11). They are set up in f64, as in the reference, listed by
//! cells of pixels, and uploaded. A *cell* is a square of a tile's pixels that has its own list of balls; a *record* is
//! a projected ball in the uploaded buffer.

use crate::frame::object_transform::ObjectTransform;
use crate::passes::pass_list::{has_layers, is_of_shadow_map};
use crate::scene::segment::UploadedBalls;
use crate::struct_writer::StructWriter;
use glam::DVec3;
use rayon::prelude::*;
use surfel_math::V3;
use surfel_math::ball::{LARGE_PX, MIN_TEXELS, Outline};
use surfel_model::{Shader, Shape};
use surfel_render::{FramePlan, Pass, Region, View, ball_scale};
use surfel_shaders::layout;

/// Number of balls per task when balls are set up in parallel; results don't depend on it.
const BALLS_PER_TASK: usize = 1024;

/// Smallest number of balls with which a tile is refused. Targets store indices of balls as f32, which is exact below
/// 2²⁴.
pub(crate) const MAX_BALLS: usize = 1 << 24;

/// Size of the shaders' ball record in words.
const WORDS: usize = layout::BALL_WORDS as usize;

/// Balls that may touch a tile, in the layout of the shaders.
#[derive(Clone, Debug, Default)]
pub(crate) struct TileBalls {
    /// Contents of the shaders' buffer `balls`, in 32-bit words; at least one word.
    pub words: Vec<u32>,
    /// Identity of each ball: its object's index among the scene's objects of balls, and the ball's index in the
    /// object's cloud.
    pub members: Vec<[u32; 2]>,
}

/// Ball projected to the screen, as it is listed and uploaded.
struct ScreenBall {
    /// Words of the shaders' ball record.
    record: [u32; WORDS],
    /// Cells (squares of pixels by which a tile's balls are listed) that the ball may touch: first column, first row,
    /// last column, last row. All are included.
    cells: [u32; 4],
    /// Identity of the ball, as in [`TileBalls::members`].
    member: [u32; 2],
}

impl TileBalls {
    /// Returns the balls of a scene that may touch `targets`, the image region that the tile's textures cover.
    pub(crate) fn new(balls: &[UploadedBalls], view: &View, plan: &FramePlan, targets: Region) -> Self {
        if !plan.has(Pass::Balls) {
            return Self { words: vec![0], members: Vec::new() };
        }
        let of_object = |(index, balls): (usize, &UploadedBalls)| {
            let placed = BallView::new(balls, index as u32, view, plan, targets);
            let count = balls.cloud.len();
            let some = |first: usize| -> Vec<ScreenBall> {
                (first..count.min(first + BALLS_PER_TASK)).filter_map(|i| placed.ball(i)).collect()
            };
            // The results are collected in order, whatever the number of threads.
            (0..count).into_par_iter().step_by(BALLS_PER_TASK).map(some).collect::<Vec<_>>()
        };
        let all: Vec<ScreenBall> = balls.iter().enumerate().flat_map(of_object).flatten().collect();
        let columns = targets.width.max(1).div_ceil(layout::BALL_CELL);
        let rows = targets.height.max(1).div_ceil(layout::BALL_CELL);
        let cells_of = |ball: &ScreenBall| {
            let [x0, y0, x1, y1] = ball.cells;
            (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| (y * columns + x) as usize))
        };
        let cells = (columns * rows) as usize;
        let mut counts = vec![0u32; cells + 1];
        all.iter().flat_map(cells_of).for_each(|cell| counts[cell + 1] += 1);
        let first = layout::BALLS_STARTS + cells as u32 + 1;
        counts[0] = first;
        for i in 1..counts.len() {
            counts[i] += counts[i - 1];
        }
        let records_at = counts[cells] as usize;
        let states_at = records_at + WORDS * all.len();
        let states = if has_layers(plan) { 2 * (targets.width * targets.height) as usize } else { 0 };
        let mut words = vec![0; states_at + states];
        words[layout::BALLS_COLUMNS as usize] = columns;
        words[layout::BALLS_RECORDS_AT as usize] = records_at as u32;
        words[layout::BALLS_STATES_AT as usize] = states_at as u32;
        words[layout::BALLS_STARTS as usize..first as usize].copy_from_slice(&counts);
        for (number, ball) in (0..).zip(&all) {
            for cell in cells_of(ball) {
                words[counts[cell] as usize] = number;
                counts[cell] += 1;
            }
        }
        for (ball, to) in all.iter().zip(words[records_at..].chunks_exact_mut(WORDS)) {
            to.copy_from_slice(&ball.record);
        }
        Self { words, members: all.into_iter().map(|ball| ball.member).collect() }
    }
}

/// Object of balls in a view, for the setup of its balls.
struct BallView<'a> {
    balls: &'a UploadedBalls,
    /// Index of the object among the scene's objects of balls.
    index: u32,
    view: &'a View,
    plan: &'a FramePlan,
    /// Image region that the tile's textures cover.
    targets: Region,
    transform: ObjectTransform,
    /// Form that gives the length of an image pixel, in world units, at each point of the object. `None` unless the
    /// balls' radii are in pixels.
    pixel: Option<surfel_render::BallPixelForm>,
    /// Scale from object to world units, by which radii are multiplied.
    scale: f64,
    /// Smallest radius with which a ball is drawn, in pixels of the view: smaller balls are enlarged to it. Only shadow
    /// maps have a value above 0.
    least_px: f64,
    /// Radius of each ball, in object units or in pixels.
    radii: &'a [f32],
    /// True if the balls are dots: disks parallel to the image.
    flat: bool,
}

impl<'a> BallView<'a> {
    fn new(balls: &'a UploadedBalls, index: u32, view: &'a View, plan: &'a FramePlan, targets: Region) -> Self {
        let (radii, in_pixels, flat) = match &balls.cloud.data().shape {
            Shape::Balls { radii, in_pixels, flat } => (radii.as_slice(), *in_pixels, *flat),
            _ => (&[][..], false, false),
        };
        let place = &balls.world_from_object;
        Self {
            balls,
            index,
            view,
            plan,
            targets,
            transform: ObjectTransform::new(place, view),
            pixel: plan.ball_pixel.filter(|_| in_pixels).map(|pixel| pixel.in_object(place)),
            scale: ball_scale(place),
            least_px: if is_of_shadow_map(plan) { MIN_TEXELS } else { 0.0 },
            radii,
            flat,
        }
    }

    /// Projects ball `i` of the cloud. `None` if the ball isn't drawn because of the near or far plane, or can't touch
    /// the targets.
    fn ball(&self, i: usize) -> Option<ScreenBall> {
        let (cloud, projection) = (&self.balls.cloud, &self.view.projection);
        let local = cloud.center(i);
        let center = self.transform.point(local);
        let given = f64::from(*self.radii.get(i)?) * self.pixel.map_or(self.scale, |pixel| pixel.at(local));
        let radius = given.max(self.least_px * self.length_of_pixel(center));
        let front = if self.flat { center.z } else { center.z - radius };
        if front < projection.near || center.z > projection.far() {
            return None;
        }
        let p = V3::from(center);
        let outline = match self.flat {
            true => Outline::of_dot(p, radius, projection),
            false => Outline::of_ball(p, radius, projection),
        };
        let anchor = projection.pixel(p);
        let middle = anchor + outline.center;
        let [x0, x1] = self.cells(middle.x, outline.extent.x, [self.targets.x, self.targets.width])?;
        let [y0, y1] = self.cells(middle.y, outline.extent.y, [self.targets.y, self.targets.height])?;
        let perspective = projection.is_perspective();
        let inverse = if perspective { 1.0 / center.z } else { 1.0 };
        let whole = |v: f64| v.floor().clamp(-1e9, 1e9);
        let base = [whole(anchor.x), whole(anchor.y)];
        let at = |word: u32| 4 * word as usize;
        let mut words = StructWriter::new(4 * WORDS);
        let origin = [self.targets.x, self.targets.y];
        words.i32x2(at(layout::BALL_BASE), [0, 1].map(|k: usize| base[k] as i32 - origin[k].cast_signed()));
        words.f64s(at(layout::BALL_ANCHOR), [anchor.x - base[0], anchor.y - base[1]]);
        words.f64s(at(layout::BALL_MIDDLE), [middle.x - base[0], middle.y - base[1]]);
        words.f64s(at(layout::BALL_EXTENT), [outline.extent.x, outline.extent.y]);
        words.f64(at(layout::BALL_SKEW), outline.skew).f64(at(layout::BALL_WIDTH), outline.width);
        words.f64s(at(layout::BALL_SLOPE), [center.x * inverse, center.y * inverse]);
        words.f64(at(layout::BALL_SIZE), radius * inverse).f64(at(layout::BALL_Z), center.z);
        let alpha = if self.plan.ball_alphas { cloud.alpha(i) } else { 1.0 };
        let is_large = outline.extent.x * outline.extent.y > LARGE_PX * LARGE_PX;
        let stored = cloud.data().ball_light.as_ref().filter(|_| self.plan.shader == Shader::Unlit);
        let flag = |is_set: bool, flag: u32| if is_set { flag } else { 0 };
        let flags = flag(self.flat, layout::BALL_IS_FLAT)
            | flag(is_large, layout::BALL_IS_LARGE)
            | flag(stored.is_some(), layout::BALL_HAS_LIGHT);
        words.f32(at(layout::BALL_ALPHA), alpha).u32(at(layout::BALL_FLAGS), flags);
        words.f64s(at(layout::BALL_COLOR), cloud.color(i).map(f64::from));
        match stored {
            Some(light) => words.f64s(at(layout::BALL_LIGHT), light[i].to_array().map(f64::from)),
            None => words.f64s(at(layout::BALL_MATERIAL), self.balls.material.factors()),
        };
        let record = words.into_words().try_into().ok()?;
        Some(ScreenBall { record, cells: [x0, y0, x1, y1], member: [self.index, i as u32] })
    }

    /// Returns the length that a pixel of the view spans at the depth of a point in view space, in world units.
    fn length_of_pixel(&self, center: DVec3) -> f64 {
        let [fx, fy] = self.view.projection.focal_px;
        if self.view.projection.is_perspective() { center.z / (fx * fy).sqrt() } else { 1.0 / (fx * fy).sqrt() }
    }

    /// Returns the first and the last cell along an axis that the interval `middle` ± `half` overlaps. `start` and
    /// `length` are the first pixel and the number of pixels of the targets along the axis. All are in pixels of the
    /// image. `None` if the interval overlaps no cell.
    fn cells(&self, middle: f64, half: f64, [start, length]: [u32; 2]) -> Option<[u32; 2]> {
        // Slack for the rounding of f32 in shaders. Casts saturate.
        let slack = 1e-3;
        let low = (middle - half - slack - f64::from(start)).floor().max(0.0);
        let high = (middle + half + slack - f64::from(start)).floor().min(f64::from(length) - 1.0);
        (low <= high).then(|| [low, high].map(|pixel| pixel as u32 / layout::BALL_CELL))
    }
}
