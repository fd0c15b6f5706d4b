//! Measures against published values.

mod compare;
mod flip_published;
