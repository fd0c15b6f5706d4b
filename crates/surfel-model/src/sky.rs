//! Light from all around, and the ground below a scene, as described in the scene file.

use crate::ModelError;
use crate::range::finite;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// Default number of directions by which a sky is sampled ([`Sky::directions`]).
const DIRECTIONS: u32 = 128;
/// Largest accepted number of directions by which a sky is sampled ([`Sky::directions`]).
const MAX_DIRECTIONS: u32 = 65_536;

/// Light from all around (rendering model §12): a sky, and areas of it that shine more strongly. It is computed once
/// per scene and stored in the colours of the splats, or in coefficients of balls. Later images of the scene are
/// therefore as fast as without it.
///
/// All strengths are relative: a white surface that faces up below a sky with `above` = 1 has brightness 1.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct Sky {
    /// Direction, in world space, toward the middle of the upper half of the sky; not zero.
    pub up: [f64; 3],
    /// Strength of the upper half of the sky, at least 0: the brightness that it alone gives to a white surface that
    /// faces up.
    #[cfg_attr(feature = "serde", serde(default = "one"))]
    pub above: f64,
    /// Strength of the lower half of the sky, at least 0, on the scale of `above`.
    #[cfg_attr(feature = "serde", serde(default))]
    pub below: f64,
    /// Bright areas of the sky, which shine in addition to its two halves.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub areas: Vec<SkyArea>,
    /// Number of directions by which the sky is sampled, 1 to 65,536. Each bright area is sampled by additional
    /// directions: a quarter of this number, but at least 16.
    #[cfg_attr(feature = "serde", serde(default = "directions"))]
    pub directions: u32,
    /// True if light that surfaces reflect to each other is added, by the closed form of Jimenez et al. 2016.
    #[cfg_attr(feature = "serde", serde(default))]
    pub bounce: bool,
    /// Fraction of the light that is constant everywhere, 0 to 1; the rest comes from the sky. With a fraction near 1,
    /// colours can be compared with a colour bar.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "is_zero"))]
    pub even: f64,
}

/// Bright area of a [`Sky`]: a disk, which contains all directions near its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct SkyArea {
    /// Direction toward the area's middle, in world space; not zero.
    pub toward: [f64; 3],
    /// Angle between the area's middle and its rim, in degrees; more than 0 and at most 90.
    pub half_angle_deg: f64,
    /// Brightness that the area gives to a white surface that faces the area's middle; at least 0.
    pub strength: f64,
}

/// Ground below a scene: a plane that receives the shadows of a [`Sky`] (rendering model §12). It belongs to the
/// background, and has neither depth nor normals.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(deny_unknown_fields))]
pub struct Ground {
    /// Appearance of the plane.
    pub style: GroundStyle,
    /// Point of the plane, in world space.
    pub point: [f64; 3],
    /// Upward normal of the plane, in world space; not zero.
    pub normal: [f64; 3],
}

/// Appearance of a [`Ground`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "lowercase"))]
pub enum GroundStyle {
    /// Only the shadow.
    Shadow,
    /// A light grey plane, which fades away from the scene.
    Plane,
    /// The shadow, and lines at round distances, which fade away from the scene.
    Grid,
}

#[cfg(feature = "serde")]
fn one() -> f64 {
    1.0
}

#[cfg(feature = "serde")]
fn directions() -> u32 {
    DIRECTIONS
}

#[cfg(feature = "serde")]
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Sky {
    /// Creates a sky that shines equally from the upper half, and not from the lower one. `up` is not zero.
    pub fn new(up: [f64; 3]) -> Self {
        Self { up, above: 1.0, below: 0.0, areas: Vec::new(), directions: DIRECTIONS, bounce: false, even: 0.0 }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] naming the field as in the scene file.
    pub fn validate(&self) -> Result<(), ModelError> {
        direction("sky.up", &self.up)?;
        strength("sky.above", self.above)?;
        strength("sky.below", self.below)?;
        if !(1..=MAX_DIRECTIONS).contains(&self.directions) {
            return Err(ModelError::range("sky.directions", self.directions, "a whole number from 1 to 65536"));
        }
        if !(0.0..=1.0).contains(&self.even) {
            return Err(ModelError::range("sky.even", self.even, "a number from 0 to 1"));
        }
        for (i, area) in self.areas.iter().enumerate() {
            direction(&format!("sky.areas[{i}].toward"), &area.toward)?;
            strength(&format!("sky.areas[{i}].strength"), area.strength)?;
            if !(area.half_angle_deg > 0.0 && area.half_angle_deg <= 90.0) {
                let expected = "a number greater than 0, at most 90";
                return Err(ModelError::range(format!("sky.areas[{i}].half_angle_deg"), area.half_angle_deg, expected));
            }
        }
        Ok(())
    }
}

impl Ground {
    /// Checks every number.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] naming the field as in the scene file.
    pub fn validate(&self) -> Result<(), ModelError> {
        finite("ground.point", &self.point)?;
        direction("ground.normal", &self.normal)
    }
}

fn direction(field: &str, value: &[f64; 3]) -> Result<(), ModelError> {
    finite(field, value)?;
    if *value == [0.0; 3] {
        return Err(ModelError::range(field, "zero", "a direction that is not zero"));
    }
    Ok(())
}

fn strength(field: &str, value: f64) -> Result<(), ModelError> {
    if value >= 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(ModelError::range(field, value, "a finite number, at least 0"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_number_of_a_sky_has_its_range() {
        let with = |change: fn(&mut Sky)| {
            let mut sky = Sky::new([0.0, 0.0, 1.0]);
            sky.areas.push(SkyArea { toward: [1.0, 0.0, 0.0], half_angle_deg: 10.0, strength: 1.0 });
            change(&mut sky);
            sky.validate().map_err(|e| e.to_string())
        };
        assert_eq!(with(|_| ()), Ok(()));
        type Change = fn(&mut Sky);
        let wrong: [(Change, &str); 9] = [
            (|s| s.up = [0.0; 3], "sky.up"),
            (|s| s.above = -1.0, "sky.above"),
            (|s| s.below = f64::NAN, "sky.below"),
            (|s| s.directions = 0, "sky.directions"),
            (|s| s.directions = 65_537, "sky.directions"),
            (|s| s.even = 1.5, "sky.even"),
            (|s| s.areas[0].toward[0] = f64::INFINITY, "sky.areas[0].toward"),
            (|s| s.areas[0].half_angle_deg = 0.0, "sky.areas[0].half_angle_deg"),
            (|s| s.areas[0].strength = f64::INFINITY, "sky.areas[0].strength"),
        ];
        for (change, field) in wrong {
            let error = with(change).unwrap_err();
            assert!(error.contains(field), "{field}: {error}");
        }
        let ground = Ground { style: GroundStyle::Shadow, point: [0.0; 3], normal: [0.0, 1.0, 0.0] };
        assert!(ground.validate().is_ok() && Ground { normal: [0.0; 3], ..ground }.validate().is_err());
        assert!(Ground { point: [f64::NAN, 0.0, 0.0], ..ground }.validate().is_err());
    }
}
