//! Options and report of the conversion of points to splats.

use crate::{PointClass, SampleError};
use glam::DVec3;

/// Options of the conversion of points to splats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointOptions {
    /// Factor for every radius; greater than 0, default 1.
    pub radius_scale: f64,
    /// Number of neighbours for normals and spacing; 6 to 64, default 16.
    pub neighbours: usize,
    /// Position that estimated normals point to, in world coordinates. `None` uses the scanner's position if the points
    /// store one; otherwise normals point outward, as far as the points allow to detect it.
    pub viewpoint: Option<DVec3>,
    /// Largest number of points in one place that become splats, at least 1; default all. More splats in one place look
    /// the same, and they slow rendering down.
    pub coincident: usize,
    /// True to make elliptical splats where the sampling is anisotropic (scan lines); default true.
    pub ellipses: bool,
    /// True to make the splats of foliage level (normal +z), for points without stored normals: seen from above, level
    /// splats leave no gaps. Default false.
    pub level_where_scattered: bool,
    /// True to orient disks by stored normals even if these don't fit the layout of the neighbours. The normals of a
    /// mesh's faces, for example, are those of its surface. Default false.
    pub lays_by_normals: bool,
    /// True to estimate the cloud's interior weight, which takes about a sixth of the time; default true.
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
    /// Number of points with a stored normal.
    pub normals_given: usize,
    /// Number of points whose normal was estimated.
    pub normals_estimated: usize,
    /// Number of splats whose radius is stored in the file.
    pub radii_given: usize,
    /// Median of the stored radii, relative to the cloud's spacing, if they are too large for splats. Such radii become
    /// an extra column of the splats.
    pub radii_too_large: Option<f64>,
    /// Number of points that coincide with an earlier one.
    pub duplicates: usize,
    /// Number of coincident points that were dropped because of [`PointOptions::coincident`]. Points coincide if they
    /// are within 2⁻³⁰ of the extent.
    pub left_out: usize,
    /// Number of points of each class, in the order of [`PointClass::ALL`].
    pub classes: [usize; PointClass::ALL.len()],
    /// Number of points of [`PointClass::Isolated`]: far from their neighbours, or too sparse and uneven for a surface.
    /// Their radii are no larger than the cloud's typical one.
    pub isolated: usize,
    /// Number of points whose stored normal doesn't fit the layout of the points around; such a normal is for shading
    /// only.
    pub normals_off: usize,
    /// Indices, ascending, of the splats made level because their points are foliage; empty unless the options request
    /// it.
    pub level: Vec<u32>,
    /// Number of splats that are ellipses with an axis ratio above 1.5; 0 if the cloud consists of disks.
    pub ellipses: usize,
    /// Median of the larger semi-axes, in object units.
    pub median_radius: f64,
    /// The cloud's interior weight, as stored in the cloud; `None` unless it was estimated.
    pub interior_weight: Option<f64>,
}
