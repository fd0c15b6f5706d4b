//! Tests of measures against published values.

mod compare;
mod flip_published;
