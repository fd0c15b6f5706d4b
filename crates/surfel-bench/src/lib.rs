//! What measurements are shown with: [`chart::Chart`]s as SVG, and [`page::Page`]s that are one HTML file of words,
//! tables, charts and images. Nothing is fetched from elsewhere, and no script runs.
//!
//! The program of this package times frames and weighs settings; it runs as `cargo xtask bench` and
//! `cargo xtask tradeoff`.

pub mod chart;
pub mod page;
