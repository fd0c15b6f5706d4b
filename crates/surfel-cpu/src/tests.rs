//! What no choice inside of the crate may change: images of scenes with everything in them, cut in different ways.

mod background;
mod clips;
mod evaluators;
mod scenes;
mod tuning;
