//! Tile-by-tile drawing of the image, and screen-space passes over a G-buffer of a tile and its neighbours.
//!
//! A *tile* is a square of 8 to 32 pixels a side ([`Grid`](crate::tiles::grid::Grid)).

pub(crate) mod composite;
pub(crate) mod eye_dome;
pub(crate) mod gbuffer;
pub(crate) mod layer_steps;
pub(crate) mod neighbourhood;
pub(crate) mod samples;
pub(crate) mod steps;
pub(crate) mod tile;
