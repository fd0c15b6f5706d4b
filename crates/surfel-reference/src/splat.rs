//! Projection of splats to their footprints in the image (rendering model §2–§4).

use crate::clip::SplatClip;
use crate::margin;
use crate::scene::ResidentObject;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use surfel_math::basis::{largest_singular_value, normal_matrix, unit};
use surfel_math::bounds::{self, Extent};
use surfel_math::clip::Turn;
use surfel_math::depth::{DepthForm, DepthPlane, tolerance};
use surfel_math::facing::{RIM_SINE, back_normal};
use surfel_math::filter::{self, Filtered};
use surfel_math::kernel::interior_weight_at_cutoff;
use surfel_math::mapping::{Footprint, through_near};
use surfel_math::project::{EDGE_ON, Placement, Projected, ViewSplat};
use surfel_math::{V2, V3};
use surfel_model::{Cull, Filter, SplatCloud};
use surfel_render::{FramePlan, View};

/// Side of an oriented splat's surface that the view shows, if the plan separates front and back sides (rendering model
/// §5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Facing {
    /// No side: the splat's cloud isn't oriented, or the plan doesn't separate sides.
    Undeclared,
    Front,
    Back,
}

/// Splat projected to the view, with everything that the passes need.
#[derive(Clone)]
pub(crate) struct ScreenSplat {
    /// Index of the splat among all splats of the scene: objects in order, splats in order.
    pub index: u32,
    /// Pixel position from which offsets `d` in both footprints are measured.
    pub anchor: V2<f64>,
    /// Unfiltered footprint: the splat's outline in the image, used by the visibility pass.
    pub visible: Footprint<f64>,
    /// Filtered footprint: the outline widened by the filter, used by the attribute pass.
    pub filtered: Footprint<f64>,
    /// Radius of the fixed disk that the filter `clamp` adds to the filtered footprint, in pixels; `None` for other
    /// filters, and for splats near the eye, which aren't filtered.
    pub clamp_radius: Option<f64>,
    /// Factor by which the filter scales the weights of the splat's fragments.
    pub weight_scale: f64,
    /// Coverage that a fragment adds per unit of its weight: a/W0 (rendering model §5).
    pub coverage_per_weight: f64,
    /// Clip of the splat; `None` if it isn't clipped.
    pub clip: Option<SplatClip>,
    /// Plane that gives the depth of the splat's fragments.
    pub depth: DepthPlane<f64>,
    /// Form in which depth varies over the image: linear or reciprocal.
    pub depth_form: DepthForm,
    /// Depth tolerance ε of the splat, in world units.
    pub epsilon: f64,
    /// Side of the splat that the view shows; [`Facing::Undeclared`] if sides don't matter.
    pub facing: Facing,
    /// Bounding box of the unfiltered footprint, in pixels.
    pub visible_box: Extent<f64>,
    /// Bounding box of the filtered footprint, in pixels.
    pub filtered_box: Extent<f64>,
    /// Centre of the splat in view space.
    pub center: DVec3,
    /// Linear RGB albedo.
    pub color: [f64; 3],
    /// Opacity, 0 to 1.
    pub alpha: f64,
    /// Unit normal for shading in world space, turned to the eye if the material is two-sided.
    pub normal: DVec3,
    /// Ambient, diffuse, specular and shininess factors of the material.
    pub material: [f64; 4],
    /// Largest distance of a pixel from a footprint's rim, in pixels of the view, at which rounding could change
    /// whether it is inside.
    pub rim_px: f64,
    /// Distance between the cosine n·p/|p| of the splat's facing and the nearest limit at which a facing decision
    /// changes. For the limit of edge-on splats, the distance is relative to the limit.
    pub facing_margin: f64,
}

/// Maps from an object's space to view and world space, shared by all of the object's splats.
pub(crate) struct ObjectView {
    /// Matrix that maps directions from object to view space.
    linear: DMat3,
    /// Position of the object's origin in view space.
    origin: DVec3,
    /// Matrix that maps normals from object to world space: the inverse transpose, up to a positive factor.
    normals: DMat3,
}

impl ObjectView {
    pub(crate) fn new(object: &ResidentObject, view: &View) -> Self {
        let m = object.world_from_object.matrix3;
        // The eye is subtracted before the rotation, so that scenes far from the origin stay exact.
        let origin = view.view_from_world * (object.world_from_object.translation - view.eye);
        Self { linear: view.view_from_world * m, origin, normals: normal_matrix(&m) }
    }

    /// Converts a point from object space to view space.
    pub(crate) fn point(&self, local: DVec3) -> DVec3 {
        self.origin + self.linear * local
    }
}

/// Projects all splats that some pass draws, in index order.
pub(crate) fn project_all(objects: &[ResidentObject], view: &View, plan: &FramePlan) -> Vec<ScreenSplat> {
    let of_object = |object: &ResidentObject| {
        let object_view = ObjectView::new(object, view);
        let each = |i| project(object, &object_view, i, view, plan);
        let selection = plan.selection_of(object.source);
        let splats = (0..object.cloud.len()).into_par_iter();
        splats.filter(|i| selection.is_none_or(|s| s.has_splat(*i as u32))).filter_map(each).collect::<Vec<_>>()
    };
    objects.iter().filter(|object| !object.cloud.is_balls()).flat_map(of_object).collect()
}

/// Projects splat `i` of an object; `None` if no pass draws it.
fn project(
    object: &ResidentObject,
    object_view: &ObjectView,
    i: usize,
    view: &View,
    plan: &FramePlan,
) -> Option<ScreenSplat> {
    let cloud: &SplatCloud = &object.cloud;
    let projection = &view.projection;
    let settings = &plan.splat_filter;
    let linear = object_view.linear;
    let p = object_view.origin + linear * cloud.center(i);
    let (s, t) = cloud.axes(i);
    let (s, t) = (linear * s, linear * t);
    let world_normal = unit(object_view.normals * cloud.normal(i));
    let n = view.view_from_world * world_normal;
    let perspective = projection.is_perspective();
    let (facing, cosine) = if perspective { (n.dot(p), n.dot(unit(p))) } else { (n.z, n.z) };
    if cosine.abs() <= EDGE_ON {
        return None;
    }
    let back_facing = facing >= 0.0;
    if object.material.cull == Cull::Back && back_facing {
        return None;
    }
    let radius_max = largest_singular_value(s, t);
    let mut splat = ViewSplat { p: V3::from(p), s: V3::from(s), t: V3::from(t), n: V3::from(n) };
    let extent = splat.s.z.hypot(splat.t.z);
    let placement = Placement::of(p.z, extent, projection);
    let unfiltered = match placement {
        Placement::Outside => return None,
        Placement::CenterBeforeNear if settings.drop_before_near => return None,
        Placement::CenterBeforeNear | Placement::Close => true,
        Placement::Ordinary => settings.filter == Filter::None,
    };
    let radius_px = if unfiltered { 0.0 } else { settings.radius_px };
    let epsilon = tolerance(&splat, radius_max, radius_px, settings.tolerance, projection);
    let oriented = object.material.is_oriented(cloud);
    let mut clip = SplatClip::new(cloud, i, plan.clip, oriented);
    if !unfiltered && settings.filter == Filter::Adjust {
        let turn;
        (splat.s, splat.t, turn) = filter::adjust_axes_turned(&splat, perspective);
        if let Some(clip) = &mut clip {
            (clip.visible_turn, clip.filtered_turn) = (turn, turn);
        }
    }
    let range = (p.z - extent, p.z + extent);
    let (mut shape, turn) = if perspective && placement != Placement::Ordinary {
        (near_shape(&splat, range, view)?, Turn::none(1.0))
    } else {
        ordinary_shape(&splat, range, radius_px, view, plan, unfiltered)
    };
    if let Some(clip) = &mut clip {
        clip.filtered_turn = clip.filtered_turn.after(&turn);
    }
    shape.clip = clip;
    let mut normal = unit(object_view.normals * cloud.shading_normal(i));
    if object.material.two_sided && back_facing {
        normal = match oriented {
            true => {
                let to_eye = view.view_from_world.transpose() * if perspective { -unit(p) } else { DVec3::NEG_Z };
                let V3 { x, y, z } = back_normal(V3::from(normal), cosine, V3::from(to_eye));
                DVec3::new(x, y, z)
            }
            false => -normal,
        };
    }
    let interior = object.interior_weight.map_or(1.0, |w| interior_weight_at_cutoff(w, settings.cutoff));
    shape.index = object.first_splat + i as u32;
    shape.coverage_per_weight /= interior;
    shape.epsilon = epsilon;
    shape.center = p;
    shape.color = cloud.color(i).map(f64::from);
    shape.alpha = f64::from(cloud.alpha(i));
    shape.normal = normal;
    shape.material = object.material.factors();
    shape.facing = match (plan.keeps_facings && oriented, back_facing) {
        (false, _) => Facing::Undeclared,
        (true, false) => Facing::Front,
        (true, true) => Facing::Back,
    };
    let sided = object.material.two_sided || object.material.cull == Cull::Back || shape.facing != Facing::Undeclared;
    let edge_margin = cosine.abs() - EDGE_ON;
    shape.facing_margin = if sided { cosine.abs().min(edge_margin / EDGE_ON) } else { edge_margin / EDGE_ON };
    if oriented && back_facing && object.material.two_sided {
        shape.facing_margin = shape.facing_margin.min((cosine.abs() - RIM_SINE).abs());
    }
    Some(shape)
}

/// Projects a splat that reaches or passes z_near, or whose extent is large relative to its distance; `None` if no part
/// of it is at or beyond z_near. The projection is exact, and the splat isn't filtered.
fn near_shape(splat: &ViewSplat<f64>, range: (f64, f64), view: &View) -> Option<ScreenSplat> {
    let mapped = through_near(splat, &view.projection);
    let near_box = bounds::through_near(splat, &view.projection)?;
    let w = mapped.footprint.w;
    let depth = DepthPlane {
        scale: mapped.depth_scale,
        gradient: V2::new(w.x, w.y),
        at_anchor: w.c,
        z_min: range.0,
        z_max: range.1,
    };
    Some(screen_splat(
        mapped.anchor_px,
        mapped.footprint,
        Filtered::unfiltered(mapped.footprint),
        near_box,
        near_box,
        depth,
    ))
}

/// Projects a splat that is wholly beyond z_near and not large relative to its distance, or any splat of an
/// orthographic view. The second value maps the filtered footprint's (u, v) to the (u, v) of the splat's axes.
fn ordinary_shape(
    splat: &ViewSplat<f64>,
    range: (f64, f64),
    radius_px: f64,
    view: &View,
    plan: &FramePlan,
    unfiltered: bool,
) -> (ScreenSplat, Turn<f64>) {
    let projection = &view.projection;
    let settings = &plan.splat_filter;
    let projective = settings.projective;
    let anchor = projection.pixel(splat.p);
    let projected = Projected::new(splat, projection);
    let visible = Footprint::unfiltered(&projected, projective);
    let around = |e: Extent<f64>| Extent { min: e.min + anchor, max: e.max + anchor };
    let visible_extent = bounds::unfiltered(&projected, projective);
    let filtered = match settings.filter {
        _ if unfiltered => Filtered::unfiltered(visible),
        Filter::None => Filtered::unfiltered(visible),
        Filter::Clamp => {
            Filtered { coverage_scale: filter::area_ratio(&projected, radius_px), ..Filtered::unfiltered(visible) }
        }
        Filter::Adjust => filter::adjust(&projected, radius_px, projective),
        Filter::Ewa => filter::ewa(&projected, radius_px),
        // `Filter::Principal`, the default, also serves filters that may be added to the enum.
        _ => filter::principal(&projected, radius_px, projective),
    };
    let clamp_radius = (!unfiltered && settings.filter == Filter::Clamp).then_some(radius_px);
    let filtered_extent = match clamp_radius {
        Some(r) => visible_extent.union(Extent::symmetric(V2::new(r, r))),
        None => bounds::footprint(&filtered.footprint),
    };
    let z = splat.p.z;
    let linear = !projective;
    let gradient = match (linear, projection.is_perspective()) {
        (false, _) => -projected.depth_gradient,
        (true, true) => projected.depth_gradient * z,
        (true, false) => projected.depth_gradient,
    };
    let depth = DepthPlane { scale: z, gradient, at_anchor: 1.0, z_min: range.0, z_max: range.1 };
    let mut shape = screen_splat(anchor, visible, filtered, around(visible_extent), around(filtered_extent), depth);
    shape.clamp_radius = clamp_radius;
    shape.depth_form = if linear { DepthForm::Linear } else { DepthForm::Reciprocal };
    (shape, filtered.turn)
}

fn screen_splat(
    anchor: V2<f64>,
    visible: Footprint<f64>,
    filtered: Filtered<f64>,
    visible_box: Extent<f64>,
    filtered_box: Extent<f64>,
    depth: DepthPlane<f64>,
) -> ScreenSplat {
    ScreenSplat {
        index: 0,
        anchor,
        visible,
        filtered: filtered.footprint,
        clamp_radius: None,
        weight_scale: filtered.weight_scale,
        coverage_per_weight: filtered.coverage_scale,
        clip: None,
        depth,
        depth_form: DepthForm::Reciprocal,
        epsilon: 0.0,
        facing: Facing::Undeclared,
        visible_box,
        filtered_box,
        center: DVec3::ZERO,
        color: [1.0; 3],
        alpha: 1.0,
        normal: DVec3::ZERO,
        material: [0.0; 4],
        rim_px: margin::RIM_PX,
        facing_margin: f64::INFINITY,
    }
}

impl ScreenSplat {
    /// Returns the depth of the splat at a pixel; `None` if it isn't between z_near and z_far.
    pub(crate) fn depth_at(&self, pixel: V2<f64>, view: &View) -> Option<f64> {
        let z = self.depth.at(pixel - self.anchor, self.depth_form);
        (z >= view.projection.near && z <= view.projection.far()).then_some(z)
    }

    /// Returns the depth of the splat at a pixel where it isn't drawn, if rounding could change that. The depth is then
    /// within the margin of z_near or z_far.
    pub(crate) fn depth_nearly_at(&self, pixel: V2<f64>, view: &View) -> Option<f64> {
        let z = self.depth.at(pixel - self.anchor, self.depth_form);
        let (near, far) = (view.projection.near, view.projection.far());
        let missing = z < near || z > far;
        (missing && (margin::on_depth(near, z) || margin::on_depth(far, z))).then_some(z)
    }

    /// True if the pixel is inside the unfiltered, clipped footprint.
    pub(crate) fn is_visible_at(&self, pixel: V2<f64>) -> bool {
        let d = pixel - self.anchor;
        self.visible.contains(d) && self.clip.as_ref().is_none_or(|c| c.keeps_at(&self.visible, &c.visible_turn, d))
    }

    /// Returns ρ² of the filtered footprint at a pixel; `None` if the pixel is outside or clipped.
    pub(crate) fn rho_squared_at(&self, pixel: V2<f64>) -> Option<f64> {
        let d = pixel - self.anchor;
        let keeps = |c: &SplatClip| {
            c.keeps_at(&self.filtered, &c.filtered_turn, d) || (c.includes_visible && self.is_visible_at(pixel))
        };
        self.unclipped_rho_squared_at(d).filter(|_| self.clip.as_ref().is_none_or(keeps))
    }

    /// Returns ρ² of the filtered footprint at the offset `d` from the anchor, ignoring the clip; `None` outside of the
    /// footprint.
    pub(crate) fn unclipped_rho_squared_at(&self, d: V2<f64>) -> Option<f64> {
        let (u, v, w) = self.filtered.at(d);
        let exact = if w > 0.0 { u.mul_add(u, v * v) / (w * w) } else { f64::INFINITY };
        let rho_squared = match self.clamp_radius {
            Some(h) => exact.min(d.dot(d) / (h * h)),
            None => exact,
        };
        (rho_squared <= 1.0).then_some(rho_squared)
    }
}
