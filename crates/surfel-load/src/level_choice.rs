//! Choices of the levels of detail that are read from a COPC file.

use glam::DAffine3;
use std::sync::Arc;
use surfel_render::View;

/// Selection of the nodes that are read from a COPC file.
#[derive(Clone, Debug, PartialEq)]
pub enum Levels {
    /// The coarsest levels, enough to place a camera. Their splats have gaps, so that the area they cover is no larger
    /// than that of all points.
    Overview,
    /// The nodes that one or more views need.
    Views {
        /// The views: all of one image, or of one movie.
        views: Arc<[View]>,
        /// Transformation from the file's coordinates to world space.
        world_from_object: DAffine3,
        /// Largest projected splat radius in pixels, more than 0. Points of finer levels are skipped.
        error_px: f64,
        /// Margin in pixels around the view frustum. Points whose splats are farther outside are skipped, if the file
        /// stores radii and normals and nothing but an image is needed. `None` skips no points.
        sight_px: Option<f64>,
    },
}

/// View parameters that select levels of detail, for all objects.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Views of one image, or of all images of a movie, so that the selection doesn't change between them.
    pub views: &'a [View],
    /// Largest projected splat radius in pixels, as in [`Levels::Views`].
    pub error_px: f64,
    /// Margin around the view frustum in pixels, as in [`Levels::Views`].
    pub sight_px: Option<f64>,
}

impl Seen<'_> {
    /// Returns the selection for an object with this transformation.
    pub(crate) fn levels(&self, world_from_object: DAffine3) -> Levels {
        let Self { views, error_px, sight_px } = *self;
        Levels::Views { views: views.into(), world_from_object, error_px, sight_px }
    }
}
