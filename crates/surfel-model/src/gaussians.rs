//! Clouds of trained Gaussians (2DGS and 3DGS), as radiance fields are stored.

use crate::{Column3, ModelError, OnInvalid, Repaired, Up};
use glam::{DQuat, DVec3};

/// Kind of trained Gaussians, which all Gaussians of a cloud share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GaussianKind {
    /// Flat Gaussians in the plane of their first two axes (2DGS).
    Flat,
    /// Ellipsoids (3DGS).
    Solid,
}

/// Columns of a cloud of Gaussians, one entry per Gaussian. Values are those after the activation functions of the file
/// format.
#[derive(Clone, Debug, PartialEq)]
pub struct GaussianData {
    /// Origin of `centers`, in object units.
    pub origin: DVec3,
    /// Centres relative to `origin`, in object units.
    pub centers: Column3,
    /// Kind of the Gaussians: flat or solid.
    pub kind: GaussianKind,
    /// Standard deviations along the three rotated axes, in object units, at least 0. The third is unused for flat
    /// Gaussians.
    pub sigmas: Vec<[f32; 3]>,
    /// Rotations as quaternions x, y, z, w of any length but zero.
    pub rotations: Vec<[f32; 4]>,
    /// Opacity in [0, 1].
    pub opacities: Vec<f32>,
    /// Degree of the spherical harmonics, 0 to 3.
    pub degree: u32,
    /// Spherical harmonics, one Gaussian after another: (degree + 1)² RGB coefficients for each, the constant one
    /// first.
    pub harmonics: Vec<[f32; 3]>,
    /// True if colours are linear; false if they are sRGB-encoded, as displayed. Both are blended without conversion.
    pub linear_colors: bool,
    /// Up axis that the file states; `None` if it states none.
    pub up: Option<Up>,
}

impl GaussianData {
    /// Returns the number of spherical-harmonics coefficients per Gaussian, per colour channel.
    pub fn coefficients(&self) -> usize {
        (self.degree as usize + 1).pow(2)
    }

    fn check_columns(&self) -> Result<(), ModelError> {
        if self.degree > 3 {
            return Err(ModelError::range("degree of spherical harmonics", self.degree, "0, 1, 2 or 3"));
        }
        let expected = self.centers.len();
        let columns = [
            ("sigma", self.sigmas.len(), expected),
            ("rotation", self.rotations.len(), expected),
            ("opacity", self.opacities.len(), expected),
            ("harmonics", self.harmonics.len(), expected * self.coefficients()),
        ];
        match columns.into_iter().find(|(_, found, expected)| found != expected) {
            Some((column, found, expected)) => Err(ModelError::ColumnLength { column, found, expected }),
            None => Ok(()),
        }
    }

    /// Returns a description of what makes Gaussian `i` invalid, or `None` if it is valid.
    fn problem(&self, i: usize) -> Option<String> {
        let center = self.centers.get(i);
        if !center.is_finite() {
            return Some(format!("its position is ({}, {}, {}), expected finite", center.x, center.y, center.z));
        }
        let sigmas = self.sigmas[i];
        if sigmas.iter().any(|s| !(*s >= 0.0 && s.is_finite())) {
            return Some(format!("its standard deviations are {sigmas:?}, expected finite numbers, at least 0"));
        }
        let length = DQuat::from_array(self.rotations[i].map(f64::from)).length();
        if !(length > 0.0 && length.is_finite()) {
            return Some(format!("its rotation is {:?}, expected finite and not zero", self.rotations[i]));
        }
        let opacity = self.opacities[i];
        if !(0.0..=1.0).contains(&opacity) {
            return Some(format!("its opacity is {opacity}, expected a number in [0, 1]"));
        }
        let each = self.coefficients();
        let finite = self.harmonics[i * each..(i + 1) * each].iter().flatten().all(|c| c.is_finite());
        (!finite).then(|| "its colour has a coefficient that is not finite".to_owned())
    }

    fn retain(&mut self, keep: &[bool]) {
        let each = self.coefficients();
        self.centers.retain(keep);
        let mut i = 0;
        self.harmonics.retain(|_| {
            i += 1;
            keep[(i - 1) / each]
        });
        retain(&mut self.sigmas, keep);
        retain(&mut self.rotations, keep);
        retain(&mut self.opacities, keep);
    }
}

fn retain<T>(column: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    column.retain(|_| keep.next().copied().unwrap_or(false));
}

/// A validated cloud of Gaussians.
#[derive(Clone, Debug, PartialEq)]
pub struct GaussianCloud {
    data: GaussianData,
}

impl GaussianCloud {
    /// Opacity below which a Gaussian counts as haze instead of surface. The camera ignores haze when it frames a
    /// scene.
    pub const FAINT: f32 = 0.05;

    /// Validates `data` and creates a cloud.
    ///
    /// # Errors
    /// [`ModelError::InvalidElements`] naming the first invalid Gaussian and their number, [`ModelError::ColumnLength`]
    /// for a column of the wrong length, [`ModelError::OutOfRange`] for an origin or a degree that is out of range.
    pub fn new(mut data: GaussianData, on_invalid: OnInvalid) -> Result<(Self, Repaired), ModelError> {
        data.check_columns()?;
        if !data.origin.is_finite() {
            return Err(ModelError::range("origin", data.origin, "finite coordinates"));
        }
        let total = data.centers.len();
        let problems: Vec<(usize, String)> = (0..total).filter_map(|i| Some((i, data.problem(i)?))).collect();
        let repaired = Repaired { dropped: problems.len(), first: problems.first().cloned() };
        match (problems.first(), on_invalid) {
            (None, _) => {}
            (Some((index, problem)), OnInvalid::Refuse) => {
                return Err(ModelError::InvalidElements {
                    what: "splat",
                    index: *index,
                    problem: problem.clone(),
                    count: problems.len(),
                    total,
                    advice: "`repair` drops them",
                });
            }
            (Some(_), OnInvalid::Drop) => {
                let mut keep = vec![true; total];
                problems.iter().for_each(|(i, _)| keep[*i] = false);
                data.retain(&keep);
            }
        }
        Ok((Self { data }, repaired))
    }

    /// Returns the columns.
    pub fn data(&self) -> &GaussianData {
        &self.data
    }

    /// Returns the number of Gaussians.
    pub fn len(&self) -> usize {
        self.data.opacities.len()
    }

    /// True if there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.data.opacities.is_empty()
    }

    /// Returns the centre of Gaussian `i` in object space.
    pub fn center(&self, i: usize) -> DVec3 {
        self.data.origin + self.data.centers.get(i)
    }

    /// Returns the unit axes of Gaussian `i` in object space: the columns of its rotation.
    pub fn axes(&self, i: usize) -> [DVec3; 3] {
        let rotation = DQuat::from_array(self.data.rotations[i].map(f64::from)).normalize();
        [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| rotation * axis)
    }

    /// Returns the standard deviations of Gaussian `i` along its axes, in object units; the third of a flat one is 0.
    pub fn sigmas(&self, i: usize) -> [f64; 3] {
        let [a, b, c] = self.data.sigmas[i].map(f64::from);
        [a, b, if self.data.kind == GaussianKind::Flat { 0.0 } else { c }]
    }

    /// Returns the RGB coefficients of the spherical harmonics of Gaussian `i`, the constant one first.
    pub fn coefficients(&self, i: usize) -> &[[f32; 3]] {
        let each = self.data.coefficients();
        &self.data.harmonics[i * each..(i + 1) * each]
    }

    /// Returns the half-axes, in object space, of the ellipse that represents Gaussian `i` wherever a splat is needed.
    /// They have a length of two standard deviations along the larger two axes of the Gaussian.
    pub fn ellipse(&self, i: usize) -> (DVec3, DVec3) {
        let (axes, sigmas) = (self.axes(i), self.sigmas(i));
        let least = (0..3).reduce(|a, b| if sigmas[b] < sigmas[a] { b } else { a }).unwrap_or(2);
        let (a, b) = ((least + 1) % 3, (least + 2) % 3);
        (axes[a] * (2.0 * sigmas[a]), axes[b] * (2.0 * sigmas[b]))
    }

    /// Returns the heap memory in use, in bytes.
    pub fn bytes(&self) -> usize {
        let d = &self.data;
        d.centers.bytes()
            + size_of_val(d.sigmas.as_slice())
            + size_of_val(d.rotations.as_slice())
            + size_of_val(d.opacities.as_slice())
            + size_of_val(d.harmonics.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn three() -> GaussianData {
        GaussianData {
            origin: DVec3::ZERO,
            centers: Column3::from_f32(vec![Vec3::ZERO, Vec3::X, Vec3::Y]),
            kind: GaussianKind::Flat,
            sigmas: vec![[1.0, 2.0, 9.0], [0.0, 1e-30, 0.0], [1e30, 1.0, 0.0]],
            rotations: vec![[0.0, 0.0, 0.0, 2.0]; 3],
            opacities: vec![0.0, 1.0, 0.5],
            degree: 1,
            harmonics: (0..12).map(|i| [i as f32; 3]).collect(),
            linear_colors: false,
            up: None,
        }
    }

    #[test]
    fn invalid_gaussians_are_refused_by_name_or_dropped() {
        let (cloud, repaired) = GaussianCloud::new(three(), OnInvalid::Refuse).unwrap();
        assert_eq!((cloud.len(), repaired), (3, Repaired::default()));
        assert_eq!((cloud.axes(0)[1], cloud.sigmas(0)), (DVec3::Y, [1.0, 2.0, 0.0]));
        type Change = fn(&mut GaussianData);
        let wrong: [(&str, Change); 6] = [
            ("position", |d| d.centers = Column3::from_f32(vec![Vec3::ZERO, Vec3::NAN, Vec3::Y])),
            ("deviations", |d| d.sigmas[1][0] = f32::INFINITY),
            ("deviations", |d| d.sigmas[1][1] = -1.0),
            ("rotation", |d| d.rotations[1] = [0.0; 4]),
            ("opacity", |d| d.opacities[1] = f32::NAN),
            ("colour", |d| d.harmonics[4][2] = f32::NAN),
        ];
        for (what, change) in wrong {
            let mut data = three();
            change(&mut data);
            let error = GaussianCloud::new(data.clone(), OnInvalid::Refuse).unwrap_err().to_string();
            assert!(error.contains("splat 1") && error.contains(what), "{error}");
            let (left, repaired) = GaussianCloud::new(data, OnInvalid::Drop).unwrap();
            assert_eq!((left.len(), repaired.dropped, left.center(1)), (2, 1, DVec3::Y));
            assert_eq!(left.coefficients(1), &three().harmonics[8..12]);
        }
        let short = GaussianData { opacities: vec![1.0], ..three() };
        assert!(GaussianCloud::new(short, OnInvalid::Drop).is_err());
        let high = GaussianData { degree: 4, ..three() };
        assert!(GaussianCloud::new(high, OnInvalid::Drop).is_err());
    }
}
