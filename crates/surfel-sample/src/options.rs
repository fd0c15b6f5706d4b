//! Options and report of the conversion of points to splats.

use crate::{PointClass, SampleError};
use glam::DVec3;

/// Options of the conversion of points to splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointOptions {
    /// Factor for every radius; greater than 0, default 1.
    pub radius_scale: f64,
    /// Number of neighbours from which normals and spacing are estimated; 6 to 64, default 16.
    pub neighbours: usize,
    /// Position that estimated normals face, in world coordinates. `None` uses the scanner's position if the file
    /// states one. Otherwise normals face out of the surface, as far as the points show its outside.
    pub viewpoint: Option<DVec3>,
    /// Largest number of coincident points that become splats, at least 1; default all. Further splats in the same
    /// place look the same and slow rendering down.
    pub coincident: usize,
    /// True to make elliptical splats where the sampling is anisotropic (scan lines); default true.
    pub ellipses: bool,
    /// True to make splats level (normal +z) where the points form no surface, as in foliage, unless a normal is
    /// stored. Seen from above, level splats leave no gaps. Default false.
    pub level_where_scattered: bool,
    /// True to orient disks by stored normals even if these don't fit the arrangement of the neighbours. Suitable for
    /// normals that come from the faces of a mesh. Default false.
    pub lays_by_normals: bool,
    /// True to estimate the cloud's interior weight
    /// ([`CloudData::interior_weight`](surfel_model::CloudData::interior_weight)), which takes about a sixth of the
    /// conversion's time; default true.
    pub interior_weight: bool,
}

impl Default for PointOptions {
    fn default() -> Self {
        Self {
            radius_scale: 1.0,
            neighbours: 16,
            viewpoint: None,
            coincident: usize::MAX,
            ellipses: true,
            level_where_scattered: false,
            lays_by_normals: false,
            interior_weight: true,
        }
    }
}

impl PointOptions {
    pub(crate) fn check(&self) -> Result<(), SampleError> {
        SampleError::check_scale(self.radius_scale)?;
        if !(6..=64).contains(&self.neighbours) {
            return Err(SampleError::option("neighbours", self.neighbours, "a whole number from 6 to 64"));
        }
        match self.viewpoint {
            Some(v) if !v.is_finite() => Err(SampleError::option("viewpoint", v, "finite coordinates")),
            _ => Ok(()),
        }
    }
}

/// Report of a conversion of points to splats.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointReport {
    /// Number of splats made.
    pub splats: usize,
    /// Number of points whose normal is stored in the file.
    pub normals_given: usize,
    /// Number of points whose normal was estimated.
    pub normals_estimated: usize,
    /// Number of splats whose radius is the one stored in the file.
    pub radii_given: usize,
    /// Median of the radii stored in the file, relative to the cloud's spacing, if they are too large for splats
    /// ([`MAX_SPACINGS`](crate::MAX_SPACINGS)); else `None`. Radii are then estimated, and the stored ones remain only
    /// in an extra column, if the input has one.
    pub radii_too_large: Option<f64>,
    /// Number of points at the position of an earlier point, so that they coincide.
    pub duplicates: usize,
    /// Number of coincident points dropped because of [`PointOptions::coincident`]. Points coincide if their
    /// coordinates are equal when rounded to 2⁻³⁰ of half the cloud's extent.
    pub left_out: usize,
    /// Number of points of each class, in the order of [`PointClass::ALL`].
    pub classes: [usize; PointClass::ALL.len()],
    /// Number of points of class [`PointClass::Isolated`]: far from their neighbours, or too sparse and uneven for a
    /// surface. Their estimated radii are no larger than the density radius ([`DENSITY`](crate::DENSITY)) for the
    /// cloud's typical spacing.
    pub isolated: usize,
    /// Number of points whose stored normal doesn't fit the surface that the points around them form. Such a normal is
    /// used for shading only.
    pub normals_off: usize,
    /// Indices, ascending, of the splats made level because of [`PointOptions::level_where_scattered`].
    pub level: Vec<u32>,
    /// Number of positions whose splats are ellipses with an axis ratio above 1.5; coincident points count once. 0 if
    /// the cloud consists of disks.
    pub ellipses: usize,
    /// Median of the splats' larger half-axes, in object units.
    pub median_radius: f64,
    /// Interior weight of the cloud: the typical sum of kernel weights Σw inside its surface. `None` unless
    /// [`PointOptions::interior_weight`] is set and the weight could be measured.
    pub interior_weight: Option<f64>,
}
