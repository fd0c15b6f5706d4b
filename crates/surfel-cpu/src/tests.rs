//! Tests of several modules together.

mod evaluators;
