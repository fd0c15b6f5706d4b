//! Descriptions of the levels of detail that are read from a COPC file.

use glam::DAffine3;
use std::sync::Arc;
use surfel_render::View;

/// Selection of the nodes that are read from a COPC file.
#[derive(Clone, Debug, PartialEq)]
pub enum Levels {
    /// The coarsest levels, which are enough to place a camera. Their splats aren't enlarged and have gaps, so that
    /// they cover no larger area than all points.
    Overview,
    /// The nodes that one or several views need, so that no splat appears larger than an error limit.
    Views {
        /// Views of one image, or of all images of one movie.
        views: Arc<[View]>,
        /// Transformation from the file's coordinates to world space.
        world_from_object: DAffine3,
        /// Largest projected splat radius in pixels, more than 0, that is accepted. Finer nodes are read until splats
        /// are below it, or the point budget is reached.
        error_px: f64,
        /// Margin in pixels around the view frustum. Points whose splats are farther outside are skipped if the file
        /// stores radii and normals, and if the points are used for images only. `None` skips no points.
        margin_px: Option<f64>,
    },
}

/// Views of images with their accuracy, by which the levels of detail of all objects are selected.
#[derive(Clone, Copy, Debug)]
pub struct ViewSelection<'a> {
    /// Views of one image, or of all images of one movie, which then share the selection.
    pub views: &'a [View],
    /// Largest projected splat radius in pixels that is accepted, as in [`Levels::Views`].
    pub error_px: f64,
    /// Margin around the view frustum in pixels beyond which points are skipped, as in [`Levels::Views`].
    pub margin_px: Option<f64>,
}

impl ViewSelection<'_> {
    /// Returns the selection of levels for an object with this transformation.
    pub(crate) fn levels(&self, world_from_object: DAffine3) -> Levels {
        let Self { views, error_px, margin_px } = *self;
        Levels::Views { views: views.into(), world_from_object, error_px, margin_px }
    }
}
