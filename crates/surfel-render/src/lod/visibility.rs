//! Test of the visibility of an object's points in views.

use super::{Eye, MARGIN_PX};
use crate::View;
use glam::{DAffine3, DVec3};
use surfel_model::{Cull, Settings};

/// Largest distance, in splat radii, from a splat's centre to a visible part of its footprint. An affine footprint
/// extends beyond the splat's own outline by less than half its distance from the centre, so 3 is ample.
const REACH: f64 = 3.0;

/// Test whether splats of an object may be visible in any of several views, by which loaders drop points.
pub struct SplatVisibility<'a> {
    /// Views in which splats may be visible, each with the object's placement in it.
    eyes: Vec<Eye<'a>>,
    /// Largest distance, in pixels, of a filtered footprint from the splat's own extent.
    margin_px: f64,
}

impl<'a> SplatVisibility<'a> {
    /// Prepares the test for views in which drawn footprints extend up to `margin_px` pixels beyond their splats.
    /// [`SplatVisibility::margin_px`] computes the number from settings.
    pub fn new(world_from_object: &'a DAffine3, views: &'a [View], margin_px: f64) -> Self {
        let eyes = views.iter().map(|view| Eye::new(world_from_object, Cull::None, view)).collect();
        Self { eyes, margin_px }
    }

    /// Returns the largest distance, in pixels, by which drawn footprints extend beyond their splats. The result
    /// includes the margin with which LOD nodes are selected.
    pub fn margin_px(settings: &Settings) -> f64 {
        // No filter lengthens a splat by more than 1.5 times the prefilter's radius.
        MARGIN_PX + 1.5 * settings.prefilter_radius_px
    }

    /// True if a part of a splat may be visible in any of the views. Lengths are in object units.
    pub fn shows(&self, center: DVec3, radius: f64) -> bool {
        self.eyes.iter().any(|eye| eye.may_be_visible_within((center, REACH * radius), self.margin_px, |_| 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::Camera;

    #[test]
    fn splats_that_show_are_in_sight_and_few_others() {
        let mut random = 1_u64;
        let mut next = |low: f64, high: f64| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            low + (high - low) * (random >> 11) as f64 / (1_u64 << 53) as f64
        };
        let settings = Settings::default().with_prefilter_radius_px(2.0);
        let (mut shown, mut dropped) = (0, 0);
        for round in 0..3000 {
            let mut place = || [(); 3].map(|()| next(-9.0, 9.0));
            let (eye, target, center) = (place(), place(), DVec3::from(place()));
            let camera = match round % 4 {
                0 => Camera::orthographic(eye, target, next(0.5, 9.0), 30.0, [640, 480]),
                _ => Camera::perspective(eye, target, next(5.0, 120.0), [640, 480]),
            };
            let view = View::new(&camera).unwrap();
            let world_from_object = DAffine3::from_scale(DVec3::splat(next(0.5, 2.0)));
            let visibility = SplatVisibility::new(
                &world_from_object,
                std::slice::from_ref(&view),
                SplatVisibility::margin_px(&settings),
            );
            let (radius, projection) = (next(0.0, 0.5), &view.projection);
            let shows = (0..100).any(|_| {
                let around = DVec3::from([(); 3].map(|()| next(-1.0, 1.0))).normalize_or_zero() * radius;
                let world = world_from_object.transform_point3(center + around);
                let p = view.view_from_world * (world - view.eye);
                let depth = if projection.is_perspective() { p.z } else { 1.0 };
                let px = |k: usize| p[k] / depth * projection.focal_px[k] + projection.principal_px[k];
                // The margin of two pixels for the prefilter.
                let inside = (-2.0..642.0).contains(&px(0)) && (-2.0..482.0).contains(&px(1));
                inside && p.z >= projection.near && p.z <= projection.far()
            });
            let is_kept = visibility.shows(center, radius);
            assert!(is_kept || !shows, "{round}");
            shown += u32::from(shows);
            dropped += u32::from(!is_kept);
        }
        assert!(shown > 300 && dropped > 1000, "{shown} {dropped}");
    }
}
