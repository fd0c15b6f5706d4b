//! Tests that internal choices change no bit of an image: scenes with all features, divided in different ways.

mod background;
mod clips;
mod evaluators;
mod scenes;
mod tuning;
