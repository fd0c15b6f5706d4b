//! Options and report of the conversion of points to splats.

use crate::{PointClass, SampleError};
use glam::DVec3;

/// How splats are made of points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointOptions {
    /// Multiplies every radius; greater than 0, default 1.
    pub radius_scale: f64,
    /// Neighbours that normals and spacing come from; 6 to 64, default 16.
    pub neighbours: usize,
    /// Where estimated normals point to, in world coordinates; `None`: to where the scanner stood, if the
    /// points say it, else outward, as far as they show it.
    pub viewpoint: Option<DVec3>,
    /// Most points in one place that become splats, at least 1; default all. So many splats in one place would look the
    /// same, and make the image slow.
    pub coincident: usize,
    /// Makes elliptical splats where the sampling is anisotropic (scan lines); default true.
    pub ellipses: bool,
    /// Makes splats level (their normals are +z) where a point has no normal and its neighbours lie in no surface, as
    /// those of leaves: seen from above, they close. Default false.
    pub level_where_scattered: bool,
    /// Lays disks by the points' own normals even where these don't fit the layout of the neighbours: normals of a
    /// mesh's faces say where its surface is. Default false.
    pub lays_by_normals: bool,
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
    /// Splats made.
    pub splats: usize,
    /// Points whose own normal was kept.
    pub normals_given: usize,
    /// Points whose normal was estimated.
    pub normals_estimated: usize,
    /// Splats whose radius is the one that the file gives the point.
    pub radii_given: usize,
    /// Median of the radii that the file gives, over the cloud's spacing, where they are too large to be radii of
    /// splats: they are a column of the splats then.
    pub radii_too_large: Option<f64>,
    /// Points that coincide with an earlier one.
    pub duplicates: usize,
    /// How many of these are left out, because there are more in their place, to 2⁻³⁰ of the extent, than the options
    /// want.
    pub left_out: usize,
    /// Number of points of each class, in the order of [`PointClass::ALL`].
    pub classes: [usize; PointClass::ALL.len()],
    /// Points of [`PointClass::Isolated`]: far from their neighbours, or so sparse and uneven that no surface is there.
    /// Their radii are no larger than the cloud's typical one.
    pub isolated: usize,
    /// Points whose normal from the file doesn't fit the layout of the points around: it shades only.
    pub normals_off: usize,
    /// Which splats are level because their points lie in no surface, in ascending order, where the options ask for it.
    pub level: Vec<u32>,
    /// Splats that are ellipses with an axis ratio above 1.5; 0 when the cloud came out as disks.
    pub ellipses: usize,
    /// Median of the larger semi-axes, in object units.
    pub median_radius: f64,
    /// The cloud's interior weight, as stored in it.
    pub interior_weight: Option<f64>,
}
