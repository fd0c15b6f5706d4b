//! Gaussians in a view, in the form from which backends draw them.

use crate::{FramePlan, SplatFilter, View};
use glam::{DAffine3, DVec3};
use surfel_math::gaussian::{self, GaussianRules, ProjectedGaussian, ViewGaussian};
use surfel_math::{V3, projection::Projection};
use surfel_model::{Filter, GaussianCloud, GaussianKind, Sort};

/// A cloud of Gaussians in a view, which projects and colours the Gaussians one by one.
pub struct GaussianView<'a> {
    cloud: &'a GaussianCloud,
    view_from_object: DAffine3,
    /// Position of the eye in object space; in orthographic views, the viewing direction instead.
    eye: DVec3,
    projection: Projection,
    size_px: [f64; 2],
    rules: GaussianRules,
}

fn v3(v: DVec3) -> V3<f64> {
    V3::new(v.x, v.y, v.z)
}

impl<'a> GaussianView<'a> {
    /// Prepares an object's Gaussians for a view.
    pub fn new(cloud: &'a GaussianCloud, world_from_object: &DAffine3, (view, plan): (&View, &FramePlan)) -> Self {
        let view_from_world = DAffine3::from_mat3(view.view_from_world) * DAffine3::from_translation(-view.eye);
        let object_from_world = world_from_object.inverse();
        let eye = match view.projection.is_perspective() {
            true => object_from_world.transform_point3(view.eye),
            false => object_from_world.transform_vector3(view.forward()),
        };
        let SplatFilter { filter, radius_px, .. } = plan.splat_filter;
        Self {
            cloud,
            view_from_object: view_from_world * *world_from_object,
            eye,
            projection: view.projection,
            size_px: view.size.map(f64::from),
            rules: GaussianRules {
                depth_along_ray: plan.sort == Sort::Pixel,
                principal_px: (filter == Filter::Principal).then_some(radius_px),
            },
        }
    }

    /// Returns the planar depth of the centre of Gaussian `i`, in world units. All callers get the same bits, so that
    /// sorting and drawing agree.
    pub fn depth(&self, i: usize) -> f64 {
        self.view_from_object.transform_point3(self.cloud.center(i)).z
    }

    /// Projects Gaussian `i` to the image; `None` if the Gaussian isn't visible.
    pub fn project(&self, i: usize) -> Option<ProjectedGaussian> {
        let view_gaussian = ViewGaussian {
            center: v3(self.view_from_object.transform_point3(self.cloud.center(i))),
            axes: self.cloud.axes(i).map(|axis| v3(self.view_from_object.transform_vector3(axis))),
            sigmas: self.cloud.sigmas(i),
            flat: self.cloud.data().kind == GaussianKind::Flat,
            opacity: self.cloud.data().opacities[i].into(),
        };
        view_gaussian.project(&self.projection, self.size_px, &self.rules)
    }

    /// Returns the RGB colour of Gaussian `i` as seen from the eye, in the cloud's own colour space: linear or
    /// sRGB-encoded.
    pub fn color(&self, i: usize) -> [f64; 3] {
        let direction = match self.projection.is_perspective() {
            true => self.cloud.center(i) - self.eye,
            false => self.eye,
        };
        gaussian::color(self.cloud.coefficients(i), direction.normalize_or_zero().to_array())
    }
}
