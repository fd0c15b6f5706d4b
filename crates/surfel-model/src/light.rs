//! Lights, as described in the scene file.

use crate::ModelError;
use crate::range::finite;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// A light in world space. Colours are linear RGB; intensity doesn't depend on distance.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(rename_all = "snake_case", deny_unknown_fields))]
#[non_exhaustive]
pub enum Light {
    /// Parallel light.
    Directional {
        /// Direction in which the light travels; not zero.
        direction: [f64; 3],
        /// Colour of the light in linear RGB.
        #[cfg_attr(feature = "serde", serde(default = "white"))]
        color: [f64; 3],
        /// True if the light casts shadows.
        #[cfg_attr(feature = "serde", serde(default))]
        shadow: bool,
    },
    /// Light from a point in all directions.
    Point {
        /// Position of the light.
        position: [f64; 3],
        /// Colour of the light in linear RGB.
        #[cfg_attr(feature = "serde", serde(default = "white"))]
        color: [f64; 3],
    },
    /// Light from a point into a cone.
    Spot {
        /// Position of the light.
        position: [f64; 3],
        /// Axis of the cone, the direction in which the light travels; not zero.
        direction: [f64; 3],
        /// Colour of the light in linear RGB.
        #[cfg_attr(feature = "serde", serde(default = "white"))]
        color: [f64; 3],
        /// Half-angle of the cone within which the light has full intensity, in degrees.
        inner_deg: f64,
        /// Half-angle at which the intensity reaches zero, in degrees; at least `inner_deg`.
        outer_deg: f64,
        /// True if the light casts shadows.
        #[cfg_attr(feature = "serde", serde(default))]
        shadow: bool,
    },
}

fn white() -> [f64; 3] {
    [1.0; 3]
}

impl Light {
    /// Creates a white parallel light that travels along `direction`, which is not zero; it casts no shadow.
    pub fn directional(direction: [f64; 3]) -> Self {
        Self::Directional { direction, color: white(), shadow: false }
    }

    /// Creates a white light at `position` that shines in all directions.
    pub fn point(position: [f64; 3]) -> Self {
        Self::Point { position, color: white() }
    }

    /// Creates a white light at `position` that shines along `direction`, which is not zero. The intensity is full
    /// within a half-angle of `inner_deg`, and zero from `outer_deg` on. It casts no shadow.
    pub fn spot(position: [f64; 3], direction: [f64; 3], inner_deg: f64, outer_deg: f64) -> Self {
        Self::Spot { position, direction, color: white(), inner_deg, outer_deg, shadow: false }
    }

    /// Sets the colour, in linear RGB.
    #[must_use]
    pub fn with_color(mut self, new: [f64; 3]) -> Self {
        let (Self::Directional { color, .. } | Self::Point { color, .. } | Self::Spot { color, .. }) = &mut self;
        *color = new;
        self
    }

    /// Enables or disables the shadow. Point lights have none.
    #[must_use]
    pub fn with_shadow(mut self, casts: bool) -> Self {
        if let Self::Directional { shadow, .. } | Self::Spot { shadow, .. } = &mut self {
            *shadow = casts;
        }
        self
    }

    pub(crate) fn validate(&self, i: usize) -> Result<(), ModelError> {
        let direction_ok = |d: &[f64; 3]| {
            finite(&format!("lights[{i}].direction"), d)?;
            if *d == [0.0; 3] {
                return Err(ModelError::range(
                    format!("lights[{i}].direction"),
                    "zero",
                    "a direction that is not zero",
                ));
            }
            Ok(())
        };
        let color = match self {
            Self::Directional { direction, color, .. } => {
                direction_ok(direction)?;
                color
            }
            Self::Point { position, color } => {
                finite(&format!("lights[{i}].position"), position)?;
                color
            }
            Self::Spot { position, direction, color, inner_deg, outer_deg, .. } => {
                finite(&format!("lights[{i}].position"), position)?;
                direction_ok(direction)?;
                if !(*inner_deg >= 0.0 && inner_deg <= outer_deg && *outer_deg <= 180.0) {
                    let found = format!("{inner_deg}, {outer_deg}");
                    let expected = "0 <= inner_deg <= outer_deg <= 180";
                    return Err(ModelError::range(format!("lights[{i}].inner_deg, outer_deg"), found, expected));
                }
                color
            }
        };
        finite(&format!("lights[{i}].color"), color)
    }

    /// Returns the colour, linear RGB.
    pub fn color(&self) -> [f64; 3] {
        match self {
            Self::Directional { color, .. } | Self::Point { color, .. } | Self::Spot { color, .. } => *color,
        }
    }

    /// Sets the colour, linear RGB.
    pub fn set_color(&mut self, linear: [f64; 3]) {
        match self {
            Self::Directional { color, .. } | Self::Point { color, .. } | Self::Spot { color, .. } => *color = linear,
        }
    }

    /// True if the light needs a shadow map.
    pub fn casts_shadow(&self) -> bool {
        matches!(self, Self::Directional { shadow: true, .. } | Self::Spot { shadow: true, .. })
    }
}
