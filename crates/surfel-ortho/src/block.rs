//! Drawing of one block of an orthoimage, by orthographic projection from above.
//!
//! Splats extend beyond the edge of a surface by up to a radius, so that the nearest surface alone would make each roof
//! too large. Each pixel is therefore drawn twice: with all splats, and with the splats behind the nearest surface. At
//! pixels that both surfaces cover, the points around the pixel determine the position of the edge (`sides.rs`).

use super::edge::Edge;
use super::grid::Grid;
use super::layout::Layout;
use super::sides::{EdgeLocator, NearbyPoints};
use super::source::splats_kept;
use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;
use std::sync::Arc;
use surfel_backend::Backend;
use surfel_load::Error;
use surfel_math::projection::{Projection, ProjectionKind};
use surfel_model::{Geometry, Material, Object, Scene, Settings, SplatCloud};
use surfel_render::{Frame, Planes, Region, Renderer, View};

/// Interior weight (sum of splat weights Σw inside a surface) for clouds that state none.
const WEIGHT: f64 = 4.0;
/// Smallest Σw of a pixel, relative to the interior Σw, at which surfaces behind the nearest one are ignored. Their
/// contribution would be below 1 %, since the weights of two surfaces that meet at an edge sum to about 1 there.
const FULL: f64 = 1.5;
/// Largest side, in pixels, of the squares whose pixels share one located edge.
const SQUARE_PX: usize = 4;
/// Radii, relative to the splat's, of the rings on a splat at whose points its depth is compared with the nearest
/// surface's.
const RINGS: [f64; 2] = [0.5, 0.95];
/// Number of test points on each ring of a splat ([`RINGS`]).
const DIRECTIONS: usize = 8;
/// Smallest |n_z| of a splat's unit normal in the depth tolerance, as in the rendering model. It limits the tolerance
/// of steep splats.
const MIN_SLOPE: f64 = 0.02;
/// Horizontal distance, in pixels, whose rise or fall along a splat's slope is added to the splat's depth tolerance.
const SLOPE_PX: f64 = 1.4;

/// Pixels of a block and its margin, in rows from the top.
pub(crate) struct BlockPixels {
    /// Number of pixels along each side of the block with its margin.
    pub(crate) side: usize,
    /// Colours as premultiplied linear RGBA, with alpha 0 at empty pixels. Empty if colours aren't needed.
    pub(crate) color: Vec<[f32; 4]>,
    /// Height z of the surface in each pixel; NaN at empty pixels.
    pub(crate) height: Vec<f32>,
    /// Unit normal of the surface in each pixel, turned to face up; NaN at empty pixels. Empty if normals aren't
    /// needed.
    pub(crate) normal: Vec<[f32; 3]>,
}

/// Splats from which a block is drawn.
#[derive(Default)]
pub(crate) struct BlockSplats {
    pub(crate) clouds: Vec<SplatCloud>,
    /// Flag per splat of the last cloud, which is the one made from the block's points: true if the splat is foliage
    /// without a stored normal. Empty if the block has no points.
    pub(crate) is_foliage: Vec<bool>,
}

/// Frame buffers that are reused from block to block.
#[derive(Default)]
pub(crate) struct Frames {
    nearest: Frame,
    behind: Frame,
}

/// Draws a block of the orthoimage, and returns the pixels of the block and its margin.
pub(crate) fn draw(
    splats: BlockSplats,
    grid: &Grid,
    layout: &Layout,
    block: [i64; 2],
    has: StoredPlanes,
    backend: &mut Backend,
    frames: &mut Frames,
) -> Result<BlockPixels, Error> {
    let BlockSplats { clouds, is_foliage } = splats;
    let view = view(&clouds, grid, layout, block);
    let planes = Planes::COLOR.with_depth(true).with_weight(true).with_normal(has.normal);
    let settings = Settings::default();
    let clouds: Vec<Arc<SplatCloud>> = clouds.into_iter().map(Arc::new).collect();
    render(&clouds, &view, &settings, planes, backend, &mut frames.nearest)?;
    let own_weight = |cloud: &Arc<SplatCloud>| cloud.data().interior_weight.unwrap_or(WEIGHT);
    let full_weight = (FULL * clouds.iter().map(own_weight).fold(0.0, f64::max)) as f32;
    let surface = Surface { frame: &frames.nearest, view: &view, gsd: grid.gsd, full_weight };
    let hidden_of = |cloud: &Arc<SplatCloud>| -> Vec<bool> {
        (0..cloud.len()).into_par_iter().with_min_len(1024).map(|i| surface.hides(cloud, i)).collect()
    };
    let mut keep: Vec<Vec<bool>> = clouds.iter().map(hidden_of).collect();
    let mut behind = None;
    if keep.iter().any(|keep| keep.contains(&true)) {
        let within = layout.drawn(block, layout.halo);
        // Splats that are certainly beneath a surface are excluded, since they aren't visible at its edges.
        let is_foliage = |cloud: usize, i: usize| cloud + 1 == clouds.len() && is_foliage.get(i) == Some(&true);
        let of_block = clouds.iter().map(|cloud| &**cloud);
        let sides = EdgeLocator::new(of_block, is_foliage, within, |cloud, i| keep[cloud][i] = false);
        // Foliage isn't a surface: lower foliage of a crown counts as part of the foliage above it.
        for (cloud, keep) in clouds.iter().zip(&mut keep) {
            let is_behind = |(i, keep): (usize, &mut bool)| {
                if *keep {
                    let p = cloud.center(i);
                    *keep = !sides.is_within_foliage([p.x, p.y], p.z as f32, cloud.radius_max(i));
                }
            };
            keep.par_iter_mut().enumerate().with_min_len(1024).for_each(is_behind);
        }
        let mut hidden = Vec::new();
        for (cloud, keep) in clouds.iter().zip(&keep) {
            hidden.extend(splats_kept(cloud, keep)?.map(Arc::new));
        }
        if !hidden.is_empty() {
            render(&hidden, &view, &settings, planes, backend, &mut frames.behind)?;
            let [left, _, _, top] = layout.drawn(block, 0.0);
            behind = Some(Behind { frame: &frames.behind, sides, left_top: [left, top] });
        }
    }
    Ok(blend(&surface, behind.as_ref(), has))
}

fn render(
    clouds: &[Arc<SplatCloud>],
    view: &View,
    settings: &Settings,
    planes: Planes,
    backend: &mut Backend,
    frame: &mut Frame,
) -> Result<(), Error> {
    // From above, the back of a surface is never visible, so that both sides of a splat count as front.
    let material = Material { oriented: Some(false), ..Material::default() };
    let object = |cloud: &Arc<SplatCloud>| Object {
        geometry: Geometry::Splats(cloud.clone()),
        world_from_object: DAffine3::IDENTITY,
        material,
    };
    let scene = Scene { objects: clouds.iter().map(object).collect(), ..Scene::default() };
    let resident = backend.upload(&scene)?;
    backend.render_into(&resident, view, settings, planes, frame)?;
    Ok(())
}

/// Returns the view of a block: north up, with the eye above the highest splat.
fn view(clouds: &[SplatCloud], grid: &Grid, layout: &Layout, block: [i64; 2]) -> View {
    let side = (layout.block_px + 2 * layout.margin_px) as u32;
    let [x0, y0, ..] = layout.drawn(block, 0.0);
    let half = 0.5 * f64::from(side);
    let (lowest, highest) = clouds
        .iter()
        .filter_map(SplatCloud::bounds)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), (min, max)| (lo.min(min.z), hi.max(max.z)));
    let height = f64::from(side) * grid.gsd;
    // A splat's radius is less than a block's side, so that this margin contains all splats.
    let above = 1.0 + height;
    let kind = ProjectionKind::Orthographic { height, far: highest - lowest + 2.0 * above };
    View {
        eye: DVec3::new(x0 + half * grid.gsd, y0 + half * grid.gsd, highest + above),
        view_from_world: DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
        projection: Projection { kind, focal_px: [1.0 / grid.gsd; 2], principal_px: [half; 2], near: 0.5 },
        size: [side; 2],
        region: Region { x: 0, y: 0, width: side, height: side },
    }
}

/// Nearest surface in each pixel of a block, as drawn with all splats.
struct Surface<'a> {
    frame: &'a Frame,
    view: &'a View,
    gsd: f64,
    /// Smallest Σw of a pixel at which surfaces behind the nearest one are ignored.
    full_weight: f32,
}

impl Surface<'_> {
    /// True if a part of the splat is behind the nearest surface at a pixel where this surface may end. The splat's
    /// centre and points on its [`RINGS`] are tested.
    fn hides(&self, cloud: &SplatCloud, i: usize) -> bool {
        let ((s, t), center) = (cloud.axes(i), cloud.center(i));
        let n = s.cross(t);
        let length = n.length();
        let slope = n.truncate().length() / n.z.abs().max(MIN_SLOPE * length);
        let tolerance = s.length().max(t.length()) + SLOPE_PX * self.gsd * slope;
        let behind = |u: f64, v: f64| self.is_behind(center + u * s + v * t, tolerance);
        let on_ring = |k: usize| {
            let angle = (k % DIRECTIONS) as f64 * std::f64::consts::TAU / DIRECTIONS as f64;
            let (sin, cos) = angle.sin_cos();
            let radius = RINGS[k / DIRECTIONS];
            behind(radius * cos, radius * sin)
        };
        behind(0.0, 0.0) || (0..RINGS.len() * DIRECTIONS).any(on_ring)
    }

    fn is_behind(&self, p: DVec3, tolerance: f64) -> bool {
        let p = p - self.view.eye;
        let [cx, cy] = self.view.projection.principal_px;
        let (x, y) = ((p.x / self.gsd + cx).floor(), (cy - p.y / self.gsd).floor());
        let [width, height] = self.view.size.map(f64::from);
        if !(x >= 0.0 && x < width && y >= 0.0 && y < height) {
            return false;
        }
        let at = y as usize * self.view.size[0] as usize + x as usize;
        let weight = self.frame.weight()[at];
        weight > 0.0 && weight < self.full_weight && -p.z > f64::from(self.frame.depth()[at]) + tolerance
    }
}

/// Second surface in each pixel of a block, drawn with the splats behind the nearest surface.
struct Behind<'a> {
    frame: &'a Frame,
    sides: EdgeLocator,
    /// Coordinates of the frame's upper left corner: x of its left edge and y of its upper edge.
    left_top: [f64; 2],
}

/// Returns the coverage of each pixel by the nearest surface, 0 to 1; `None` at empty pixels.
fn shares(surface: &Surface<'_>, behind: Option<&Behind<'_>>) -> Vec<Option<f32>> {
    let (frame, side) = (surface.frame, surface.frame.width() as usize);
    let is_there = |i: usize| frame.weight()[i] > 0.0 && frame.depth()[i].is_finite();
    let mut shares: Vec<Option<f32>> =
        (0..side * side).into_par_iter().with_min_len(4096).map(|i| is_there(i).then_some(1.0)).collect();
    let Some(behind) = behind else { return shares };
    let rows = shares.par_chunks_mut(SQUARE_PX * side).enumerate();
    rows.for_each_init(NearbyPoints::default, |near, (row, shares)| {
        let first = row * SQUARE_PX;
        let rows = Square { left: 0, top: first, width: side, height: shares.len() / side };
        for square in rows.parts(SQUARE_PX) {
            behind.each_share(surface, square, near, &mut |x, y, share| shares[(y - first) * side + x] = Some(share));
        }
    });
    shares
}

/// Rectangle of pixels in a frame whose pixels may share one edge.
#[derive(Clone, Copy)]
struct Square {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Square {
    /// Iterates over the pixels of the rectangle, each as column and row.
    fn pixels(self) -> impl Iterator<Item = (usize, usize)> {
        let columns = self.left..self.left + self.width;
        (self.top..self.top + self.height).flat_map(move |y| columns.clone().map(move |x| (x, y)))
    }

    /// Splits the rectangle into squares with a side of `px` pixels. Squares at the right and at the bottom may be
    /// smaller.
    fn parts(self, px: usize) -> impl Iterator<Item = Self> {
        let (right, bottom) = (self.left + self.width, self.top + self.height);
        (self.top..bottom).step_by(px).flat_map(move |top| {
            let part = move |left| Self { left, top, width: px.min(right - left), height: px.min(bottom - top) };
            (self.left..right).step_by(px).map(part)
        })
    }
}

impl Behind<'_> {
    /// Locates the edge between both surfaces in a square of pixels. Calls `each` with column, row and coverage by the
    /// nearest surface, for each pixel that both surfaces cover. If no edge is found, a pixel's coverage is 1 if the
    /// nearest surface has at least the weight of the second one, and 0 otherwise.
    fn each_share(
        &self,
        surface: &Surface<'_>,
        square: Square,
        near: &mut NearbyPoints,
        each: &mut dyn FnMut(usize, usize, f32),
    ) {
        let (first, second, side) = (surface.frame, self.frame, surface.frame.width() as usize);
        let is_between = |(x, y): &(usize, usize)| {
            let i = y * side + x;
            let (w1, z1, w2, z2) = (first.weight()[i], first.depth()[i], second.weight()[i], second.depth()[i]);
            w1 > 0.0 && z1.is_finite() && w2 > 0.0 && w1 < surface.full_weight && z2 > z1 && z2.is_finite()
        };
        if !square.pixels().any(|pixel| is_between(&pixel)) {
            return;
        }
        let at = |x: f64, y: f64| self.place(surface, [x, y]);
        let middle = |s: Square| {
            let half = |first: usize, length: usize| first as f64 + 0.5 * length as f64;
            at(half(s.left, s.width), half(s.top, s.height))
        };
        let mut edge_of = |part: Square| {
            let between = || part.pixels().filter(is_between);
            let count = between().count();
            let height = |frame: &Frame| {
                let depths = between().map(|(x, y)| f64::from(frame.depth()[y * side + x]));
                surface.view.eye.z - depths.sum::<f64>() / count as f64
            };
            let [x, y] = middle(part);
            if count > 0 { self.sides.edge(x, y, height(first), height(second), near) } else { None }
        };
        let mut set = |part: Square, edge: Option<Edge>| {
            let [x, y] = middle(part);
            for (px, py) in part.pixels().filter(is_between) {
                let i = py * side + px;
                let by_weight = if first.weight()[i] < second.weight()[i] { 0.0 } else { 1.0 };
                let [of_x, of_y] = at(px as f64 + 0.5, py as f64 + 0.5);
                each(px, py, edge.map_or(by_weight, |edge| edge.share(of_x - x, of_y - y) as f32));
            }
        };
        let px_of = |s: Square, found: Option<Edge>| {
            let [x, y] = middle(s);
            self.sides.square_px(x, y, surface.gsd, found)
        };
        for part in square.parts(px_of(square, None)) {
            let edge = edge_of(part);
            let px = px_of(part, edge);
            if px >= part.width.max(part.height) {
                set(part, edge);
            } else {
                part.parts(px).for_each(|smaller| set(smaller, edge_of(smaller)));
            }
        }
    }

    /// Converts a position in the frame, in pixels, to the coordinates x and y.
    fn place(&self, surface: &Surface<'_>, [x, y]: [f64; 2]) -> [f64; 2] {
        let [left, top] = self.left_top;
        [left + x * surface.gsd, top - y * surface.gsd]
    }
}

/// Kinds of values that blocks have in addition to heights.
#[derive(Clone, Copy)]
pub(crate) struct StoredPlanes {
    pub(crate) color: bool,
    pub(crate) normal: bool,
}

impl StoredPlanes {
    /// Returns the number of f32 values per pixel, including the height.
    pub(super) fn numbers(self) -> usize {
        1 + if self.color { 4 } else { 0 } + if self.normal { 3 } else { 0 }
    }
}

/// Blends colours and heights of the nearest and the second surface at each pixel, weighted by the coverage of the
/// nearest one. A normal is that of the surface with the larger coverage.
fn blend(surface: &Surface<'_>, behind: Option<&Behind<'_>>, has: StoredPlanes) -> BlockPixels {
    let frame = surface.frame;
    let eye = surface.view.eye.z;
    let side = frame.width() as usize;
    let shares = shares(surface, behind);
    let mix = |share: f32, of: &dyn Fn(&Frame) -> f64| match behind.filter(|_| share < 1.0) {
        Some(behind) => f64::from(share) * of(frame) + f64::from(1.0 - share) * of(behind.frame),
        None => of(frame),
    };
    let color = |(i, share): (usize, &Option<f32>)| {
        share.map_or([0.0; 4], |share| [0, 1, 2, 3].map(|k| mix(share, &|f| f64::from(f.color()[i][k])) as f32))
    };
    let height = |(i, share): (usize, &Option<f32>)| {
        share.map_or(f32::NAN, |share| (eye - mix(share, &|f| f64::from(f.depth()[i]))) as f32)
    };
    let normal = |(i, share): (usize, &Option<f32>)| {
        // Normals of two surfaces aren't blended. The normal is that of the surface with the larger coverage.
        let of = |share: f32| if share < 0.5 { behind.map_or(frame, |b| b.frame) } else { frame }.normal()[i];
        share.map_or([f32::NAN; 3], |share| {
            let n = of(share);
            if n[2] < 0.0 { n.map(|v| -v) } else { n }
        })
    };
    BlockPixels {
        side,
        color: if has.color {
            shares.par_iter().enumerate().with_min_len(4096).map(color).collect()
        } else {
            Vec::new()
        },
        height: shares.par_iter().enumerate().with_min_len(4096).map(height).collect(),
        normal: if has.normal {
            shares.par_iter().enumerate().with_min_len(4096).map(normal).collect()
        } else {
            Vec::new()
        },
    }
}
