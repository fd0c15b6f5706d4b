//! Splats that reach the near plane or span much of their distance: exact, unfiltered, in f64 (§3, last paragraph).

use crate::record::Record;
use glam::DVec3;
use surfel_math::depth::{DepthForm, DepthPlane, tolerance};
use surfel_math::mapping::{Footprint, through_near};
use surfel_math::project::{EDGE_ON, Placement, Projected, ViewSplat, radius_max};
use surfel_math::{V2, bounds};
use surfel_model::{Cull, Material};
use surfel_render::{FramePlan, View};

/// Such a splat on the screen.
pub(crate) struct NearSplat {
    anchor: V2<f64>,
    footprint: Footprint<f64>,
    depth: DepthPlane<f64>,
    depth_form: DepthForm,
    limits: [f64; 2],
    pub epsilon: f32,
    pub color: [f32; 3],
    pub normal: [f32; 3],
    pub object: u32,
}

impl NearSplat {
    /// Sets one up, with its pixels: first column, first row, end column, end row. `None` if it takes part in no pass.
    pub(crate) fn new(
        splat: &ViewSplat<f64>,
        shading: DVec3,
        color: DVec3,
        object: u32,
        material: &Material,
        view: &View,
        plan: &FramePlan,
    ) -> Option<(Self, [i32; 4])> {
        let projection = &view.projection;
        let perspective = projection.is_perspective();
        let (p, n) = (splat.p, splat.n);
        let facing = if perspective { n.dot(p) } else { n.z };
        let cosine = if perspective { facing / p.length() } else { facing };
        let back_facing = facing >= 0.0;
        let extent = splat.s.z.hypot(splat.t.z);
        let placement = Placement::of(p.z, extent, projection);
        let dropped = placement == Placement::CenterBeforeNear && plan.splat_filter.drop_before_near;
        // A centre at the eye itself has no cosine (NaN), and is edge-on like any plane through the eye.
        let edge_on = cosine.is_nan() || cosine.abs() <= EDGE_ON;
        if edge_on || dropped || placement == Placement::Outside || (back_facing && material.cull == Cull::Back) {
            return None;
        }
        let (z_min, z_max) = (p.z - extent, p.z + extent);
        let (anchor, footprint, depth, depth_form, extent_px) = if perspective {
            let mapped = through_near(splat, projection);
            let w = mapped.footprint.w;
            let gradient = V2::new(w.x, w.y);
            let depth = DepthPlane { scale: mapped.depth_scale, gradient, at_anchor: w.c, z_min, z_max };
            let extent_px = bounds::through_near(splat, projection)?;
            (mapped.anchor_px, mapped.footprint, depth, DepthForm::Reciprocal, extent_px)
        } else {
            let projected = Projected::new(splat, projection);
            let anchor = projection.pixel(p);
            let depth = DepthPlane { scale: p.z, gradient: projected.depth_gradient, at_anchor: 1.0, z_min, z_max };
            let e = bounds::unfiltered(&projected, false);
            let extent_px = bounds::Extent { min: e.min + anchor, max: e.max + anchor };
            (anchor, Footprint::unfiltered(&projected, false), depth, DepthForm::Linear, extent_px)
        };
        let region = view.region;
        let range = |min: f64, max: f64, start: u32, length: u32| {
            let (lo, hi) = (f64::from(start), f64::from(start + length));
            let slack = 1e-6;
            [(min - 0.5 - slack).ceil().clamp(lo, hi) as i32, ((max + 0.5 + slack).floor()).clamp(lo, hi) as i32]
        };
        let columns = range(extent_px.min.x, extent_px.max.x, region.x, region.width);
        let rows = range(extent_px.min.y, extent_px.max.y, region.y, region.height);
        if columns[0] >= columns[1] || rows[0] >= rows[1] {
            return None;
        }
        let epsilon = tolerance(splat, radius_max(splat.s, splat.t), 0.0, plan.splat_filter.tolerance, projection);
        let normal = if back_facing && material.two_sided { -shading } else { shading };
        let near = Self {
            anchor,
            footprint,
            depth,
            depth_form,
            limits: [projection.near, projection.far()],
            epsilon: epsilon as f32,
            color: color.as_vec3().to_array(),
            normal: normal.as_vec3().to_array(),
            object,
        };
        Some((near, [columns[0], rows[0], columns[1], rows[1]]))
    }

    /// Stands for the splat in the tiles' lists.
    pub(crate) fn record(&self, index: usize) -> Record {
        Record::near(index, self.limits[0] as f32 * (1.0 - 1e-6), self.color, self.normal, self.epsilon)
    }

    /// ρ² and depth at a pixel, where the splat is hit.
    pub(crate) fn hit(&self, x: i32, y: i32) -> Option<(f32, f32)> {
        let d = V2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - self.anchor;
        let (u, v, w) = self.footprint.at(d);
        let square = u.mul_add(u, v * v);
        if !(w > 0.0 && square <= w * w) {
            return None;
        }
        let z = self.depth.at(d, self.depth_form);
        (z >= self.limits[0] && z <= self.limits[1]).then_some(((square / (w * w)) as f32, z as f32))
    }
}
