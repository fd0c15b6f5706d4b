//! Panels and words of a figure, as the user asks for them.

use std::path::PathBuf;
use surfel_model::Colormap;

/// A length on paper or on a screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Length {
    /// Number of pixels.
    Pixels(f64),
    /// Length in inches.
    Inches(f64),
}

/// A mark over all panels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MarkKind {
    /// A scale bar.
    Scale,
    /// Directions of x, y and z.
    Axes,
    /// An arrow along y.
    North,
}

/// Panels and words of a figure: the flags of `surfel figure` besides those of `surfel render`.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct FigureOptions {
    /// Title above the panels.
    pub title: Option<String>,
    /// Titles below the panels: one for each file, or one for each column.
    pub titles: Vec<String>,
    /// Titles to the left of the rows.
    pub row_titles: Vec<String>,
    /// Number of things that the files show, with equally many files each; at least 1.
    pub subjects: Option<u32>,
    /// Largest number of panels side by side; at least 1.
    pub wrap: Option<u32>,
    /// Colour map of a row of distances to the first file.
    pub error_row: Option<Colormap>,
    /// Distance at the end of the error row's colour map; more than 0.
    pub error_max: Option<f64>,
    /// Marks over the panels.
    pub marks: Vec<MarkKind>,
    /// Unit of the coordinates.
    pub unit: Option<String>,
    /// Title of the colour bar or legend of values.
    pub value_title: Option<String>,
    /// True if colour bars and legends are left out.
    pub no_legend: bool,
    /// File of cameras that are drawn as frusta.
    pub frusta: Option<PathBuf>,
    /// Texts beside points in world space.
    pub texts: Vec<([f64; 3], String)>,
    /// Width of the figure.
    pub width: Option<Length>,
    /// Pixels per inch; more than 0.
    pub dpi: Option<f64>,
    /// Size of the words in points; more than 0.
    pub font_pt: Option<f64>,
}
