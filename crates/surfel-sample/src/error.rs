//! Errors of the conversions to splats.

use surfel_model::ModelError;

/// Reason why a conversion or a fit failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SampleError {
    /// The input has no points, vertices or triangles.
    #[error("the {what} has no {missing}, expected at least one: check that the file is complete")]
    Empty {
        /// Name of the input: "point cloud" or "mesh".
        what: &'static str,
        /// Name of the missing elements: "points", "vertices" or "triangles".
        missing: &'static str,
    },
    /// Every triangle of a mesh has zero area.
    #[error(
        "all {triangles} triangles have zero area, expected a surface: convert the vertices (`per_vertex`) instead"
    )]
    NoArea {
        /// Number of triangles of the mesh.
        triangles: usize,
    },
    /// Some positions are not finite; `PointCloud::drop_non_finite` removes their points.
    #[error("point {index} has a position that is not finite, and so have {count} of {total}: drop them first")]
    NotFinite {
        /// Index of the first point with such a position, counted from 0.
        index: usize,
        /// Number of points with such positions.
        count: usize,
        /// Number of all points of the cloud.
        total: usize,
    },
    /// The input has more elements than indices can address.
    #[error("{found} {what} are too many, expected at most {limit}: thin the data or split it into several files")]
    TooMany {
        /// Name of the elements, such as "points".
        what: &'static str,
        /// Number of elements that were found.
        found: usize,
        /// Largest number of elements that is accepted.
        limit: usize,
    },
    /// An option of the conversion is out of its range.
    #[error("{option} is {found}, expected {expected}")]
    Option {
        /// Name of the option that is out of its range.
        option: &'static str,
        /// Value that the option has, as text.
        found: String,
        /// Range that the option must be in, in words.
        expected: &'static str,
    },
    /// The input, or the resulting cloud, breaks a rule of the data model.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Largest number of points, triangles or splats in one call: tables of neighbours have up to 16 entries per element,
/// which are indexed by 32 bits.
pub(crate) const MAX_ELEMENTS: usize = u32::MAX as usize / 16;

impl SampleError {
    pub(crate) fn option(option: &'static str, found: impl std::fmt::Display, expected: &'static str) -> Self {
        Self::Option { option, found: found.to_string(), expected }
    }

    #[cfg(feature = "sharp")]
    pub(crate) fn check_crease_angle(degrees: f64) -> Result<(), Self> {
        let is_valid = surfel_model::ConvertOptions::CREASE_ANGLES_DEG.contains(&degrees);
        if is_valid { Ok(()) } else { Err(Self::option("the crease angle", degrees, "1 to 179 degrees")) }
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
