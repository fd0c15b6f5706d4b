//! Culling of chunks outside the view, back-facing or occluded, and the division of a frame into cells.

pub(crate) mod balls;
pub(crate) mod cells;
pub(crate) mod chunks;
pub(crate) mod groups;
pub(crate) mod object;
pub(crate) mod occlusion;
