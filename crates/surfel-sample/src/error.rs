//! Errors of the conversions to splats.

use surfel_model::ModelError;

/// Reason why no splats could be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SampleError {
    /// The input has no elements.
    #[error("the {what} has no {missing}, expected at least one: check that the file is complete")]
    Empty {
        /// "point cloud" or "mesh".
        what: &'static str,
        /// "points", "vertices" or "triangles".
        missing: &'static str,
    },
    /// Every triangle of a mesh has zero area.
    #[error(
        "all {triangles} triangles have zero area, expected a surface: convert the vertices (`per_vertex`) instead"
    )]
    NoArea {
        /// Number of triangles.
        triangles: usize,
    },
    /// Some positions are not finite; `PointCloud::drop_non_finite` removes their points.
    #[error("point {index} has a position that is not finite, and so have {count} of {total}: drop them first")]
    NotFinite {
        /// Index of the first such point, counted from 0.
        index: usize,
        /// Number of such points.
        count: usize,
        /// Number of all points.
        total: usize,
    },
    /// There are more elements than indices can address.
    #[error("{found} {what} are too many, expected at most {limit}: thin the data or split it into several files")]
    TooMany {
        /// Kind of element, such as "points".
        what: &'static str,
        /// Number of elements found.
        found: usize,
        /// Largest accepted number of elements.
        limit: usize,
    },
    /// An option is out of its range.
    #[error("{option} is {found}, expected {expected}")]
    Option {
        /// Name of the option.
        option: &'static str,
        /// Value of the option.
        found: String,
        /// Accepted range, in words.
        expected: &'static str,
    },
    /// The data breaks a rule of the model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Largest number of elements in one call: neighbour tables index 16 slots per element with 32 bits.
pub(crate) const MAX_ELEMENTS: usize = u32::MAX as usize / 16;

impl SampleError {
    pub(crate) fn option(option: &'static str, found: impl std::fmt::Display, expected: &'static str) -> Self {
        Self::Option { option, found: found.to_string(), expected }
    }

    pub(crate) fn check_count(what: &'static str, found: usize) -> Result<(), Self> {
        if found > MAX_ELEMENTS { Err(Self::TooMany { what, found, limit: MAX_ELEMENTS }) } else { Ok(()) }
    }

    pub(crate) fn check_splats(count: usize) -> Result<(), Self> {
        if count == 0 {
            return Err(Self::option("the number of splats", count, "at least 1"));
        }
        Self::check_count("splats", count)
    }

    pub(crate) fn check_scale(radius_scale: f64) -> Result<(), Self> {
        if radius_scale > 0.0 && radius_scale <= 1e6 {
            Ok(())
        } else {
            Err(Self::option("radius_scale", radius_scale, "a number greater than 0, at most 1000000"))
        }
    }
}
