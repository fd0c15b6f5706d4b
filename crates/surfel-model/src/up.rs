//! Up axes.

use glam::DVec3;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// A signed coordinate axis, as in `--up +z`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[expect(missing_docs, reason = "the names say it")]
pub enum Up {
    #[cfg_attr(feature = "serde", serde(rename = "+x"))]
    PlusX,
    #[cfg_attr(feature = "serde", serde(rename = "-x"))]
    MinusX,
    #[cfg_attr(feature = "serde", serde(rename = "+y"))]
    PlusY,
    #[cfg_attr(feature = "serde", serde(rename = "-y"))]
    MinusY,
    #[cfg_attr(feature = "serde", serde(rename = "+z"))]
    PlusZ,
    #[cfg_attr(feature = "serde", serde(rename = "-z"))]
    MinusZ,
}

impl Up {
    /// All six axes, in the order of their names.
    pub const ALL: [Self; 6] = [Self::PlusX, Self::MinusX, Self::PlusY, Self::MinusY, Self::PlusZ, Self::MinusZ];

    /// Returns the unit vector of the axis.
    pub fn vector(self) -> DVec3 {
        match self {
            Self::PlusX => DVec3::X,
            Self::MinusX => DVec3::NEG_X,
            Self::PlusY => DVec3::Y,
            Self::MinusY => DVec3::NEG_Y,
            Self::PlusZ => DVec3::Z,
            Self::MinusZ => DVec3::NEG_Z,
        }
    }

    /// Returns the name, `+x` … `-z`.
    pub fn name(self) -> &'static str {
        match self {
            Self::PlusX => "+x",
            Self::MinusX => "-x",
            Self::PlusY => "+y",
            Self::MinusY => "-y",
            Self::PlusZ => "+z",
            Self::MinusZ => "-z",
        }
    }
}

impl std::fmt::Display for Up {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Up {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let s = s.to_ascii_lowercase();
        let s = if s.len() == 1 { format!("+{s}") } else { s };
        Self::ALL.into_iter().find(|up| up.name() == s).ok_or_else(|| format!("'{s}' is not one of +x -x +y -y +z -z"))
    }
}
