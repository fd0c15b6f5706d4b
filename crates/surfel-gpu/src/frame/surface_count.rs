//! Lower bound of the number of surfaces in a pixel of an A-buffer (rendering model §8), counted in f64 at a few
//! pixels. A frame that needs more layers than a GPU draws is thus refused before most layers are drawn.

use crate::frame::uniforms::FrameScene;
use crate::passes::pass_list::is_of_shadow_map;
use crate::scene::clip::Variant;
use crate::scene::segment::{Segment, UploadedScene};
use glam::DVec3;
use rayon::prelude::*;
use surfel_math::basis::unit;
use surfel_math::depth::{DepthForm, DepthPlane, tolerance};
use surfel_math::mapping::{Footprint, through_near};
use surfel_math::project::{EDGE_ON, Placement, Projected, ViewSplat, radius_max};
use surfel_math::{V2, V3};
use surfel_model::{Cull, Filter, StoredSplat};
use surfel_render::{FramePlan, Pass, Region, View};

/// Largest number of pixels in which surfaces are counted. Each of these pixels contains the projected centre of a
/// transparent splat, so that a stack of splats is found.
const SAMPLES: usize = 32;
/// Relative difference of two depths, computed in f64, above which they surely differ in single precision, too.
const APART: f64 = 1e-6;

/// Unfiltered splat, projected to the screen.
struct Shape {
    /// Centre in view space.
    center: V3<f64>,
    /// Half the depth range of the disk, in world units.
    extent: f64,
    /// Upper bound of the distance of the disk's points from the centre, in world units.
    reach: f64,
    /// Position in the image, in pixels, from which `footprint` and `depth` measure offsets.
    anchor: V2<f64>,
    footprint: Footprint<f64>,
    depth: DepthPlane<f64>,
    depth_form: DepthForm,
    /// Depth tolerance ε of the splat, in world units.
    epsilon: f64,
}

/// Fragments of one pixel.
#[derive(Clone, Default)]
struct PixelFragments {
    /// Depths z and z + ε of each fragment of a transparent splat.
    fragments: Vec<[f64; 2]>,
    /// Smallest depth from which on an opaque splat may hide the pixel's fragments; `None` if no opaque splat covers
    /// the pixel.
    opaque: Option<f64>,
}

/// Returns a lower bound of the largest number of transparent surfaces in any pixel of a region; 0 if it can't be
/// determined.
pub fn min_surface_count(
    scene: &UploadedScene,
    frame: &FrameScene,
    view: &View,
    plan: &FramePlan,
    region: Region,
) -> usize {
    // Polygons may hide any fragment, so nothing can be concluded.
    if plan.has(Pass::Polygons) || !plan.separates_transparent || is_of_shadow_map(plan) {
        return 0;
    }
    let transparent: Vec<&Segment> = scene.segments.iter().filter(|segment| segment.is_transparent).collect();
    let total: usize = transparent.iter().map(|segment| segment.members.len()).sum();
    let sample = |k: usize| {
        let mut index = k * total / SAMPLES;
        for segment in &transparent {
            if index < segment.members.len() {
                let transform = frame.transforms.get(segment.object as usize)?;
                let cloud = &scene.objects.get(segment.object as usize)?.cloud;
                let p = V3::from(transform.point(cloud.center(*segment.members.get(index)? as usize)));
                let px = view.projection.pixel(p);
                let inside =
                    |at: f64, start: u32, length: u32| (f64::from(start)..f64::from(start + length)).contains(&at);
                let is_seen = inside(px.x, region.x, region.width) && inside(px.y, region.y, region.height);
                return is_seen.then(|| V2::new(px.x.floor() + 0.5, px.y.floor() + 0.5));
            }
            index -= segment.members.len();
        }
        None
    };
    let samples: Vec<V2<f64>> = (0..SAMPLES.min(total)).filter_map(sample).collect();
    let none = || vec![PixelFragments::default(); samples.len()];
    let add = |mut piles: Vec<PixelFragments>, segment: &Segment| {
        add_segment(scene, frame, segment, (view, plan), &samples, &mut piles);
        piles
    };
    let join = |mut all: Vec<PixelFragments>, more: Vec<PixelFragments>| {
        all.iter_mut().zip(more).for_each(|(pile, more)| pile.join(more));
        all
    };
    let piles = scene.segments.par_iter().fold(none, add).reduce(none, join);
    piles.into_iter().map(PixelFragments::surfaces).max().unwrap_or(0)
}

/// Adds the fragments of a segment at each sampled pixel. `samples` are the centres of these pixels, and `piles` the
/// fragments at each. Transparent splats with clips are left out, so that the count stays a lower bound.
fn add_segment(
    scene: &UploadedScene,
    frame: &FrameScene,
    segment: &Segment,
    (view, plan): (&View, &FramePlan),
    samples: &[V2<f64>],
    piles: &mut [PixelFragments],
) {
    let index = segment.object as usize;
    let (Some(object), Some(transform)) = (scene.objects.get(index), frame.transforms.get(index)) else { return };
    // Clips aren't evaluated here. A clipped opaque splat is treated as whole, since it hides at most as much.
    if segment.is_transparent && segment.variant == Variant::Clipped {
        return;
    }
    let selection = object.octree.as_ref().and_then(|(index, _)| plan.selection_of(*index));
    for chunk in &segment.chunks {
        let members = segment.members.get(chunk.first as usize..(chunk.first + chunk.count) as usize);
        for &i in members.into_iter().flatten() {
            if selection.is_some_and(|chosen| !chosen.has_splat(i)) {
                continue;
            }
            // The splat is rounded as in the GPU's buffers.
            let stored = StoredSplat::of(&object.cloud, i as usize, &chunk.space, scene.storage);
            let (s, t) = (transform.linear * stored.axes.0, transform.linear * stored.axes.1);
            let n = view.view_from_world * unit(transform.normals * stored.normal);
            let center = transform.point(stored.center);
            let splat = ViewSplat { p: V3::from(center), s: V3::from(s), t: V3::from(t), n: V3::from(n) };
            let Some(shape) = Shape::new(&splat, object.material.cull, view, plan) else { continue };
            for (pile, &pixel) in piles.iter_mut().zip(samples) {
                pile.add(&shape, segment.is_transparent, pixel, (view, plan));
            }
        }
    }
}

impl Shape {
    /// Projects a splat; `None` if no pass draws it.
    fn new(splat: &ViewSplat<f64>, cull: Cull, view: &View, plan: &FramePlan) -> Option<Self> {
        let (projection, settings) = (&view.projection, &plan.splat_filter);
        let ViewSplat { p, s, t, n } = *splat;
        let perspective = projection.is_perspective();
        let facing = if perspective { n.dot(p) / p.length() } else { n.z };
        let extent = s.z.hypot(t.z);
        let placement = Placement::of(p.z, extent, projection);
        let is_before = placement == Placement::CenterBeforeNear;
        let is_drawn = facing.abs() > EDGE_ON && (cull != Cull::Back || facing < 0.0);
        if !is_drawn || placement == Placement::Outside || (is_before && settings.drop_before_near) {
            return None;
        }
        let (z_min, z_max) = (p.z - extent, p.z + extent);
        let is_unfiltered = placement != Placement::Ordinary || settings.filter == Filter::None;
        let h_px = if is_unfiltered { 0.0 } else { settings.radius_px };
        let epsilon = tolerance(splat, radius_max(s, t), h_px, settings.tolerance, projection);
        let (anchor, footprint, depth, depth_form) = if perspective && placement != Placement::Ordinary {
            let mapped = through_near(splat, projection);
            let w = mapped.footprint.w;
            let gradient = V2::new(w.x, w.y);
            let depth = DepthPlane { scale: mapped.depth_scale, gradient, at_anchor: w.c, z_min, z_max };
            (mapped.anchor_px, mapped.footprint, depth, DepthForm::Reciprocal)
        } else {
            let projected = Projected::new(splat, projection);
            let (gradient, form) = match (settings.projective, perspective) {
                (true, _) => (-projected.depth_gradient, DepthForm::Reciprocal),
                (false, true) => (projected.depth_gradient * p.z, DepthForm::Linear),
                (false, false) => (projected.depth_gradient, DepthForm::Linear),
            };
            let depth = DepthPlane { scale: p.z, gradient, at_anchor: 1.0, z_min, z_max };
            (projection.pixel(p), Footprint::unfiltered(&projected, settings.projective), depth, form)
        };
        let reach = s.length() + t.length();
        Some(Self { center: p, extent, reach, anchor, footprint, depth, depth_form, epsilon })
    }

    /// True if the splat, taken as opaque, may cover the pixel with this centre under any filter and mapping.
    fn may_cover(&self, pixel: V2<f64>, (view, plan): (&View, &FramePlan)) -> bool {
        let (origin, direction) = view.projection.ray(pixel);
        let [origin, direction, center] = [origin, direction, self.center].map(|v| DVec3::new(v.x, v.y, v.z));
        let distance = (center - origin).cross(unit(direction)).length();
        let [fx, fy] = view.projection.focal_px;
        let per_pixel = if view.projection.is_perspective() { self.center.z.abs() } else { 1.0 } / fx.min(fy);
        // Three times the reach bounds how far an affine footprint exceeds the splat's exact one.
        distance <= 3.0 * self.reach + (plan.splat_filter.reach_px() + 2.0) * per_pixel
    }
}

impl PixelFragments {
    /// Adds a splat to the pixel with the centre `pixel`: the fragment of a transparent splat, if it has one there, or
    /// an opaque splat that may cover the pixel as an occluder.
    fn add(&mut self, shape: &Shape, is_transparent: bool, pixel: V2<f64>, (view, plan): (&View, &FramePlan)) {
        if !is_transparent {
            if shape.may_cover(pixel, (view, plan)) {
                self.add_occluder(shape.center.z - shape.extent);
            }
            return;
        }
        let d = pixel - shape.anchor;
        let z = shape.depth.at(d, shape.depth_form);
        if z >= view.projection.near && z <= view.projection.far() && shape.footprint.contains(d) {
            self.fragments.push([z, z + shape.epsilon]);
        }
    }

    /// Adds an opaque splat that may hide fragments from depth z on.
    fn add_occluder(&mut self, z: f64) {
        self.opaque = Some(self.opaque.map_or(z, |opaque| opaque.min(z)));
    }

    /// Adds all fragments of the same pixel that another thread has found.
    fn join(&mut self, more: Self) {
        self.fragments.extend(more.fragments);
        more.opaque.into_iter().for_each(|z| self.add_occluder(z));
    }

    /// Returns the number of surfaces in the pixel. Fragments are merged in order of ascending depth. A fragment beyond
    /// the current surface's threshold z + ε begins a new surface.
    fn surfaces(mut self) -> usize {
        let opaque = self.opaque.unwrap_or(f64::INFINITY);
        self.fragments.retain(|[z, _]| *z < opaque);
        self.fragments.sort_by(|[a, _], [b, _]| a.total_cmp(b));
        let (mut count, mut threshold) = (0, f64::NEG_INFINITY);
        for [z, end] in self.fragments {
            if z * (1.0 - APART) > threshold {
                (count, threshold) = (count + 1, end);
            } else {
                // A nearer threshold would end the surface earlier, and single precision may decide that differently.
                // The farthest threshold gives a lower bound.
                threshold = threshold.max(end);
            }
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_are_counted_before_what_is_opaque_and_where_depths_are_surely_apart() {
        let pile = |ends: &[[f64; 2]], opaque| PixelFragments { fragments: ends.to_vec(), opaque }.surfaces();
        let apart = [[3.0, 3.1], [1.0, 1.1], [2.0, 2.1]];
        assert_eq!([pile(&apart, None), pile(&apart, Some(2.5)), pile(&[], None)], [3, 2, 0]);
        // Depths within each other's tolerance, and nearly so, form one surface.
        assert_eq!(pile(&[[1.0, 1.5], [1.2, 1.7], [1.6, 2.0], [2.1, 2.2]], None), 2);
        assert_eq!(pile(&[[1.0, 1.5], [1.500_000_1, 1.6]], None), 1);
    }
}
