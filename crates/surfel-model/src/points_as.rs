//! Kinds of splats that the points of a cloud are drawn as.

#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// Kind of splat that each point of a point cloud is drawn as. Written as `surface`, `balls`, `disks` or `dots`, the
/// last three optionally with a radius: `balls:0.02`, `dots:2px`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize), serde(try_from = "String", into = "String"))]
pub enum PointsAs {
    /// Splats whose radii and normals cover the surface that the points sample.
    Surface,
    /// Balls (rendering model §11) with this radius; `None` means half the spacing of the points.
    Balls(Option<PointRadius>),
    /// Disks with this radius in the units of the file, perpendicular to the estimated normals; `None` means half the
    /// spacing of the points.
    Disks(Option<PointRadius>),
    /// Dots (rendering model §11), disks parallel to the image, with this radius; `None` means 1.5 pixels.
    Dots(Option<PointRadius>),
}

/// Radius of all points of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PointRadius {
    /// Radius in the units of the file, greater than 0.
    World(f64),
    /// Radius in pixels of the image, greater than 0.
    Pixels(f64),
}

/// Default radius of a dot, in pixels of the image.
pub const DOT_PX: f64 = 1.5;

/// Largest accepted radius in pixels: the side of the largest square image ([`crate::MAX_IMAGE_PIXELS`]).
const MAX_PX: f64 = 16_384.0;

impl std::fmt::Display for PointRadius {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::World(radius) => write!(f, "{radius}"),
            Self::Pixels(radius) => write!(f, "{radius}px"),
        }
    }
}

impl std::fmt::Display for PointsAs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (name, radius) = match self {
            Self::Surface => ("surface", &None),
            Self::Balls(radius) => ("balls", radius),
            Self::Disks(radius) => ("disks", radius),
            Self::Dots(radius) => ("dots", radius),
        };
        match radius {
            Some(radius) => write!(f, "{name}:{radius}"),
            None => f.write_str(name),
        }
    }
}

impl std::str::FromStr for PointsAs {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, radius) = match text.split_once(':') {
            Some((name, radius)) => (name, Some(radius.parse::<PointRadius>()?)),
            None => (text, None),
        };
        match (name, radius) {
            ("surface", None) => Ok(Self::Surface),
            ("balls", radius) => Ok(Self::Balls(radius)),
            ("disks", Some(PointRadius::Pixels(_))) => Err(
                "disks lie in space, so that their radius can't be in pixels: choose disks:R in the file's units, or \
                     dots"
                    .to_owned(),
            ),
            ("disks", radius) => Ok(Self::Disks(radius)),
            ("dots", radius) => Ok(Self::Dots(radius)),
            _ => Err("expected surface, balls, disks or dots, the last three optionally with a radius in the file's \
                      units or in pixels (balls:0.02, dots:2px)"
                .to_owned()),
        }
    }
}

impl std::str::FromStr for PointRadius {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (number, in_pixels) = match text.strip_suffix("px") {
            Some(number) => (number, true),
            None => (text, false),
        };
        let radius = number.trim().parse::<f64>().ok().filter(|r| *r > 0.0 && (*r as f32).is_normal());
        match radius {
            Some(radius) if in_pixels && radius <= MAX_PX => Ok(Self::Pixels(radius)),
            Some(radius) if !in_pixels => Ok(Self::World(radius)),
            _ => Err(format!(
                "the radius is '{text}', expected a number greater than 0 in the file's units, or up to {MAX_PX}px"
            )),
        }
    }
}

impl TryFrom<String> for PointsAs {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<PointsAs> for String {
    fn from(points_as: PointsAs) -> Self {
        points_as.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_read_as_they_are_written() {
        for text in ["surface", "balls", "balls:0.02", "balls:3px", "disks", "disks:1.5", "dots", "dots:2px", "dots:7"]
        {
            assert_eq!(text.parse::<PointsAs>().map(|kind| kind.to_string()).as_deref(), Ok(text));
        }
        for (text, part) in [
            ("ball", "expected surface, balls"),
            ("surface:1", "expected surface, balls"),
            ("balls:", "the radius is ''"),
            ("balls:0", "greater than 0"),
            ("balls:-1px", "greater than 0"),
            ("balls:1e-60", "greater than 0"),
            ("balls:nan", "greater than 0"),
            ("dots:1e9px", "16384px"),
            ("disks:2px", "can't be in pixels"),
        ] {
            let error = text.parse::<PointsAs>().unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
