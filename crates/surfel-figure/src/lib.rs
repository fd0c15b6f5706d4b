//! Layout of figures: images in rows, with titles, legends, colour bars, scale bars and other marks. Figures are
//! written as PNG, SVG or PDF.
//!
//! Modules, in reading order:
//!
//! 1. `figure`: [`Figure`], its panels, marks and keys: the content of a figure, without positions;
//! 2. `layout`, `keys` and `marks`: [`Figure::layout`] places the content and returns a [`Drawing`];
//! 3. `drawing`: a [`Drawing`] is a list of images, polygons, lines and texts at fixed positions;
//! 4. `raster`, `svg` and `pdf`: [`Drawing::picture`], [`Drawing::svg`] and [`Drawing::pdf`] convert the list to a
//!    file. SVG and PDF files contain the words as text.
//!
//! ```
//! use surfel_figure::{Figure, Key, Panel, Picture, Style};
//! let picture = Picture::filled([64, 48], [200, 80, 40, 255]);
//! let figure = Figure {
//!     title: Some("A title".to_owned()),
//!     rows: vec![vec![Some(Panel::new(picture).with_caption("a"))].into()],
//!     keys: vec![Key::bar("height [m]", vec![[0, 0, 0], [255, 255, 255]], [0.0, 2.5])],
//!     style: Style::new(12.0),
//!     ..Figure::default()
//! };
//! let drawing = figure.layout();
//! assert!(drawing.svg().contains(">A title<"));
//! assert_eq!(drawing.png(None)[1..4], *b"PNG");
//! ```
//!
//! # Font
//! Text is set in Inter (SIL Open Font License 1.1, `fonts/OFL.txt`). `fonts/Inter-Regular-subset.ttf` has its Latin
//! and Greek letters and mathematical signs; `fonts/subset.py` made this subset.
//!
//! # Layer
//! The crate has no terms of splatting, opens no file and depends on no other crate of Surfel. `surfel-app` builds its
//! figures.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::panic))]

mod drawing;
mod figure;
pub mod font;
mod keys;
mod layout;
mod marks;
mod pdf;
mod raster;
mod svg;
mod ticks;

pub use drawing::{Anchor, Drawing, Item, Picture, Rect, Rgb, Text};
pub use figure::{Axis, Figure, Key, KeyContent, Mark, Panel, Row, Style};
pub use ticks::{Ticks, round_end, round_length};
