//! Parsers for the values of figures' flags.

use super::settings::{Length, MarkKind};
use crate::values;

/// Every mark by its name.
pub const MARKS: &[(&str, MarkKind)] =
    &[("scale", MarkKind::Scale), ("axes", MarkKind::Axes), ("north", MarkKind::North)];

/// Parses the name of a mark.
///
/// # Errors
/// The names of all marks.
pub fn mark(text: &str) -> Result<MarkKind, String> {
    let known = MARKS.iter().find(|(name, _)| *name == text).map(|(_, mark)| *mark);
    known.ok_or_else(|| format!("expected some of {}", MARKS.iter().map(|(n, _)| *n).collect::<Vec<_>>().join(", ")))
}

/// Parses `X,Y,Z=TEXT`.
///
/// # Errors
/// A description of the expected value.
pub fn text_at(text: &str) -> Result<([f64; 3], String), String> {
    let wrong = || "expected X,Y,Z=TEXT, such as 1,2,-3=door".to_owned();
    let (point, words) = text.split_once('=').ok_or_else(wrong)?;
    let words = words.trim();
    if words.is_empty() {
        return Err(wrong());
    }
    Ok((values::point(point).map_err(|_| wrong())?, words.to_owned()))
}

/// Parses a length in pixels, or with the unit mm, cm, in or pt.
///
/// # Errors
/// A description of the expected value.
pub fn length(text: &str) -> Result<Length, String> {
    let units = [("mm", 1.0 / 25.4), ("cm", 1.0 / 2.54), ("in", 1.0), ("pt", 1.0 / 72.0)];
    let text = text.trim();
    let number = |digits: &str| digits.trim().parse::<f64>().ok().filter(|value| *value > 0.0 && value.is_finite());
    let with_unit = units.into_iter().find_map(|(unit, inches)| {
        let digits = text.strip_suffix(unit)?;
        number(digits).map(|value| Length::Inches(value * inches))
    });
    let pixels = || number(text.strip_suffix("px").unwrap_or(text)).map(Length::Pixels);
    with_unit
        .or_else(pixels)
        .ok_or_else(|| "expected pixels, or a length such as 174mm, 8.5cm, 7in or 246pt".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_units() {
        assert_eq!((length("800"), length("800 px")), (Ok(Length::Pixels(800.0)), Ok(Length::Pixels(800.0))));
        for text in ["25.4mm", "2.54 cm", "1in", "72pt"] {
            assert!(matches!(length(text), Ok(Length::Inches(inches)) if (inches - 1.0).abs() < 1e-12), "{text}");
        }
        for wrong in ["", "mm", "-1", "0in", "1em", "nan", "inf"] {
            assert!(length(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn texts_have_places() {
        assert_eq!(text_at("1,-2,3.5= a = b "), Ok(([1.0, -2.0, 3.5], "a = b".to_owned())));
        assert!(["1,2=a", "1,2,3", "1,2,3=", "=a"].iter().all(|wrong| text_at(wrong).is_err()));
        assert!(mark("scale").is_ok() && mark("legend").unwrap_err().contains("north"));
    }
}
