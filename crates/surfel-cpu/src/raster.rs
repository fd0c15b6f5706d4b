//! Rasterisation: computes the sums of every block's pixels from the lists of splats and triangles per tile. It
//! comprises fragments, visibility and attributes (rendering model §5), triangles (§6), and transparent layers (§8).

pub(crate) mod balls;
pub(crate) mod batch;
pub(crate) mod block;
pub(crate) mod depth;
pub(crate) mod facing;
pub(crate) mod filter;
pub(crate) mod fragment;
pub(crate) mod inputs;
pub(crate) mod layers;
pub(crate) mod listing;
pub(crate) mod nearest;
pub(crate) mod pixel_sums;
pub(crate) mod sums;
pub(crate) mod surfaces;
pub(crate) mod tiny_fragments;
pub(crate) mod tiny_tile;
pub(crate) mod triangles;
