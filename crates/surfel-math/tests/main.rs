//! Formulas against f64 and exact truth.

mod bounds;
mod clip;
mod common;
mod depth;
mod filters;
mod mapping;
mod near;
mod precision;
