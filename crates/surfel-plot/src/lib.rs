//! Charts as SVG, tables, and pages that are one file: what measurements are shown with.
//!
//! [`Chart`] draws curves and labelled points over linear or logarithmic axes; [`Page`] puts charts, tables and words
//! together. Nothing is fetched from elsewhere, no script runs.

mod axis;
mod chart;
mod page;

pub use axis::{Axis, Scale};
pub use chart::{Chart, Series, Style};
pub use page::{Page, Table, escape};
