//! Options for the panels and words of figures, and parsers of their values.

use crate::values;
use std::path::PathBuf;
use surfel_model::Colormap;

/// Width of a figure, on paper or on a screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Length {
    /// Length in pixels of the image.
    Pixels(f64),
    /// Length in inches on paper.
    Inches(f64),
}

/// Kind of mark that is drawn over all panels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MarkKind {
    /// Scale bar of a round length.
    Scale,
    /// Arrows for the directions of x, y and z.
    Axes,
    /// Arrow along the y axis of the coordinates, which points north on a map.
    North,
}

/// Panels and words of a figure: the options of `surfel figure` in addition to those of `surfel render`.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct FigureOptions {
    /// Title above the panels.
    pub title: Option<String>,
    /// Titles below the panels, one for each file or one for each column. Empty uses the names of the files.
    pub titles: Vec<String>,
    /// Titles to the left of the rows, one for each row.
    pub row_titles: Vec<String>,
    /// Number of subjects, at least 1; `None` means 1. A subject is a group of files with one camera and one light. The
    /// files are divided, in their order, into this many groups of equal size.
    pub subjects: Option<u32>,
    /// Largest number of panels side by side, at least 1. Panels beyond this number begin a new row. `None` places all
    /// panels of a subject in one row.
    pub wrap: Option<u32>,
    /// Colour map for an additional row of panels, which shows distances to the first file. `None` adds no row.
    pub error_row: Option<Colormap>,
    /// Distance to the first file, in the units of the coordinates, that gets the last colour of the error row; more
    /// than 0. `None` uses the 98th percentile of all distances, rounded up to a tick of the colour bar.
    pub error_max: Option<f64>,
    /// Marks over the panels.
    pub marks: Vec<MarkKind>,
    /// Name of the unit of the coordinates, for scale bars and colour bars.
    pub unit: Option<String>,
    /// Title of the colour bar or legend of values; `None` uses the name of the attribute.
    pub value_title: Option<String>,
    /// True if colour bars and legends are left out.
    pub no_legend: bool,
    /// File of cameras that are drawn over the panels as frusta: pyramids that show position and direction.
    pub frusta: Option<PathBuf>,
    /// Labels, each a point in world space and the text that is placed there.
    pub texts: Vec<([f64; 3], String)>,
    /// Width of the whole figure; `None` derives the width from the size of the panels.
    pub width: Option<Length>,
    /// Resolution in pixels per inch, more than 0; `None` means 300.
    pub dpi: Option<f64>,
    /// Font size in points, more than 0. `None` uses 8 points for a width on paper, and otherwise derives the size from
    /// the width in pixels or from the size of a panel.
    pub font_pt: Option<f64>,
}

/// All kinds of marks, each with its name in options.
pub const MARKS: &[(&str, MarkKind)] =
    &[("scale", MarkKind::Scale), ("axes", MarkKind::Axes), ("north", MarkKind::North)];

/// Parses the name of a mark.
///
/// # Errors
/// A message with the names of all marks.
pub fn mark(text: &str) -> Result<MarkKind, String> {
    let known = MARKS.iter().find(|(name, _)| *name == text).map(|(_, mark)| *mark);
    known.ok_or_else(|| format!("expected some of {}", MARKS.iter().map(|(n, _)| *n).collect::<Vec<_>>().join(", ")))
}

/// Parses a label `X,Y,Z=TEXT`: a point in world space and its text.
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

/// Parses a positive length: a number of pixels, or a number with the unit mm, cm, in or pt.
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
