//! Tests of formulas in f32 and f64 against exact arithmetic.

mod bounds;
mod clip;
mod common;
mod depth;
mod filters;
mod mapping;
mod near;
mod precision;
